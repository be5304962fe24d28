//! The decoder against a plain model of a turning encoder, and with the card that reads it.
//!
//! Invariant: the model knows the true count of each sample, and nothing of the decoder.

use proptest::prelude::*;
use retrace_card::SpindleEncoder;

use super::*;

/// An encoder's signals in the samples since the start.
struct Signals {
    /// Number of the first sample.
    first: u32,
    /// True count in each sample.
    counts: Vec<i64>,
    counts_per_turn: i64,
    /// Counts for which the index is high.
    index_width: i64,
}

impl Signals {
    fn levels(&self, n: usize) -> u32 {
        let count = self.counts[n.min(self.counts.len() - 1)];
        let circle = [0b00, 0b01, 0b11, 0b10];
        let is_at_index = count.rem_euclid(self.counts_per_turn) < self.index_width;
        circle[count.rem_euclid(4) as usize] | u32::from(is_at_index) << 2 | (n as u32 & 1) << 3
    }

    /// A word by its number.
    fn word(&self, word: u32) -> u32 {
        (0..8).fold(0, |bits, sample| {
            let n = (word * 8 + sample).wrapping_sub(self.first);
            // before the start, nothing is known
            bits | (if n > u32::MAX / 2 { 0b111 } else { self.levels(n as usize) }) << (4 * sample)
        })
    }

    /// The control period that ends before this sample, and is read a little later.
    fn period(&self, end: usize, period_us: u32) -> SampledPeriod {
        let end = self.first.wrapping_add(end as u32);
        let taken = SampledPeriod::written_once_taken(end);
        SampledPeriod { end, taken, next_word: Some(taken / 8 % RING_WORDS as u32), period_us }
    }
}

/// The true count over the time: gaps between counts in microseconds, and whether the direction changes.
fn counts(steps: &[(usize, bool)]) -> Vec<i64> {
    let (mut counts, mut count, mut direction) = (vec![0; 20], 0, 1);
    for &(gap, turns) in steps {
        direction *= if turns { -1 } else { 1 };
        count += direction;
        counts.extend(std::iter::repeat_n(count, gap));
    }
    counts
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    /// Any counts with any directions: counter, edge and index of every sample of every reading are the true ones.
    #[test]
    fn counts_edges_and_indices_are_exact(
        steps in prop::collection::vec((1..200_usize, prop::bool::weighted(0.1)), 10..600),
        counts_per_turn in 8..60_i64, index_width in 1..4_i64, period_us in 1000..4000_u32,
        first in prop_oneof![Just(0), any::<u32>(), u32::MAX - 9000..u32::MAX],
    ) {
        let signals = Signals { first, counts: counts(&steps), counts_per_turn, index_width };
        let mut decoder = SpindleDecoder::new(first);
        let (mut begin, mut end) = (0, period_us as usize);
        let (mut was_down, mut counter) = (false, 0);
        while end < signals.counts.len() {
            let reading = decoder.read(&signals.period(end, period_us), |word| signals.word(word));
            prop_assert!(!reading.is_faulty);
            prop_assert_eq!(u32::from(reading.count), period_us.div_ceil(1000));
            let count = usize::from(reading.count);
            for (n, sample) in reading.samples[..count].iter().enumerate() {
                let until = begin + (end - begin) * (n + 1) / count;
                prop_assert_eq!(sample.counter, signals.counts[until - 1] as u16);
                if sample.counter != counter {
                    let edge = (1..until).rev().find(|&n| signals.counts[n] != signals.counts[n - 1]).expect("one");
                    prop_assert_eq!((u32::from(sample.edge) * period_us) >> 16, (edge - begin) as u32);
                }
                counter = sample.counter;
            }
            // The index is at whole turns, whatever the direction; the sampled one is the last that was passed.
            let mut index = None;
            for n in begin.max(1)..end {
                let (before, after) = (signals.counts[n - 1], signals.counts[n]);
                was_down = if before == after { was_down } else { after < before };
                let passed = if was_down { before } else { after };
                if before != after && passed.rem_euclid(counts_per_turn) == 0 {
                    index = Some(passed as u16);
                }
            }
            prop_assert_eq!(reading.index, index);
            (begin, end) = (end, end + period_us as usize);
        }
    }

    /// A turning spindle in either direction, with a ripple: the card finds no error, and the angle ahead.
    #[test]
    fn the_card_follows_a_spindle_that_is_sampled(
        lines in 25..250_i64, rpm in 60..2000_i64, is_backward: bool, first: u32, index_width in 1..3_i64,
    ) {
        let counts_per_turn = 4 * lines;
        let turns = |us: f64| rpm as f64 / 60e6 * us + 0.0005 * (us / 9000.0).sin();
        let sign = if is_backward { -1.0 } else { 1.0 };
        let count = |us: f64| (sign * turns(us) * counts_per_turn as f64).floor();
        let counts = (0..200_000).map(|us| count(f64::from(us)) as i64).collect();
        let signals = Signals { first, counts, counts_per_turn, index_width };
        let mut decoder = SpindleDecoder::new(first);
        let mut encoder = SpindleEncoder::new(counts_per_turn as u32, false, 3_000_000, 1000);
        for ms in 1..200_usize {
            let reading = decoder.read(&signals.period(ms * 1000, 1000), |word| signals.word(word));
            prop_assert_eq!(encoder.read(&reading), Ok(()), "{}", ms);
            if ms > 50 {
                let ahead = encoder.angle_ahead(2000) as f64 / 256.0;
                let truth = sign * turns((ms as f64 + 2.0) * 1000.0) * counts_per_turn as f64;
                // The card's first count is that of the counter, from 0 to 65 535.
                let off = (ahead - truth + 32_768.0).rem_euclid(65_536.0) - 32_768.0;
                prop_assert!(off.abs() < 1.5, "{} for {} at {}", ahead, truth, ms);
            }
        }
        if rpm > 400 {
            prop_assert!(encoder.zero_angle().is_some());
        }
    }
}

/// A spindle that turns up by a count in so many microseconds.
fn turning(gap: usize) -> Signals {
    let counts = (0..60_000).map(|us| (us / gap) as i64).collect();
    Signals { first: 0, counts, counts_per_turn: 400, index_width: 1 }
}

fn read(decoder: &mut SpindleDecoder, signals: &Signals, end: usize) -> EncoderReading {
    decoder.read(&signals.period(end, 1000), |word| signals.word(word))
}

#[test]
fn a_change_of_both_signals_is_an_error_of_its_reading() {
    let mut signals = turning(20);
    for count in &mut signals.counts[1_500..] {
        *count += 1;
    }
    signals.counts[1_500] = signals.counts[1_499] + 2;
    let mut decoder = SpindleDecoder::new(0);
    let faults = [1000, 2000, 3000].map(|end| read(&mut decoder, &signals, end).is_faulty);
    assert_eq!(faults, [false, true, false]);
}

/// Four times the rate that is promised is the rate of the samples: the counts are exact up to there.
#[test]
fn a_count_in_every_sample_is_counted() {
    let mut decoder = SpindleDecoder::new(0);
    let counters = [1, 2, 3].map(|ms| {
        let reading = read(&mut decoder, &turning(1), ms * 1000);
        (reading.is_faulty, reading.samples[0].counter, reading.index)
    });
    assert_eq!(counters, [(false, 999, Some(800)), (false, 1_999, Some(1_600)), (false, 2_999, Some(2_800))]);
}

#[test]
fn an_index_that_never_stays_is_an_error() {
    let mut decoder = SpindleDecoder::new(0);
    let signals = turning(10);
    let often = |word: u32| signals.word(word) ^ (word % 4) << 14;
    let readings = [1, 2, 3].map(|ms| decoder.read(&signals.period(ms * 1000, 1000), often));
    assert!(readings.iter().all(|reading| reading.is_faulty));
}

#[test]
fn a_ring_that_has_run_over_is_an_error_and_the_counts_begin_anew() {
    let signals = turning(10);
    let mut decoder = SpindleDecoder::new(0);
    assert!(!read(&mut decoder, &signals, 14_000).is_faulty, "the longest time");
    assert!(read(&mut decoder, &signals, 28_500).is_faulty, "and longer");
    let reading = read(&mut decoder, &signals, 29_500);
    assert_eq!((reading.is_faulty, reading.samples[0].counter), (false, 1_399 + 99));
    assert!(read(&mut decoder, &signals, 29_000).is_faulty, "back in time");
}

/// The state machine or the DMA has stopped, or is behind: the ring has other samples than those of that time.
#[test]
fn samples_that_are_not_there_are_an_error() {
    let signals = turning(10);
    let of = signals.period(1000, 1000);
    let words = [None, Some(0), Some(123), Some(124), Some(125), Some(126)];
    let faulty = words.map(|next_word| {
        SpindleDecoder::new(0).read(&SampledPeriod { next_word, ..of }, |word| signals.word(word)).is_faulty
    });
    assert_eq!(faulty, [true, true, true, true, false, true]);
    let early = SampledPeriod { taken: 999, next_word: Some(124), ..of };
    assert!(SpindleDecoder::new(0).read(&early, |word| signals.word(word)).is_faulty);
    let stopped = SampledPeriod { taken: 2_000, next_word: Some(126), ..of };
    assert!(SpindleDecoder::new(0).read(&stopped, |word| signals.word(word)).is_faulty, "behind the period");
    // a word under way behind the end is not needed
    let later = SampledPeriod { taken: 1_010, next_word: Some(125), ..of };
    assert!(!SpindleDecoder::new(0).read(&later, |word| signals.word(word)).is_faulty);
}

#[test]
fn the_last_word_of_a_period_is_waited_for() {
    assert_eq!([1, 8, 9, 1000, u32::MAX, 0].map(SampledPeriod::written_once_taken), [10, 10, 18, 1002, 2, 2]);
}

/// An index between two counts is where the last one was counting to.
#[test]
fn an_index_beside_the_counts_has_the_direction_of_the_last_one() {
    // A rises and falls again: a count up, and one down.
    for (index_end, expected) in [(50, Some(1)), (100, Some(0)), (135, None)] {
        let word = |word: u32| {
            (0..8).fold(0, |bits, n| {
                let sample = word * 8 + n;
                let a = u32::from((16..64).contains(&sample));
                bits | (a | u32::from((index_end - 10..index_end).contains(&sample)) << 2) << (4 * n)
            })
        };
        let of = SampledPeriod { end: 130, taken: 138, next_word: Some(17), period_us: 1000 };
        let reading = SpindleDecoder::new(0).read(&of, word);
        assert_eq!((reading.is_faulty, reading.samples[0].counter, reading.index), (false, 0, expected));
    }
}

#[test]
fn a_late_period_has_its_edges_before_its_end() {
    let signals = turning(100);
    let mut decoder = SpindleDecoder::new(0);
    let reading = read(&mut decoder, &signals, 3_050);
    let edges: Vec<u32> = reading.samples[..4].iter().map(|sample| (u32::from(sample.edge) * 1000) >> 16).collect();
    assert_eq!((reading.count, edges), (4, vec![0, 0, 150, 950]));
}
