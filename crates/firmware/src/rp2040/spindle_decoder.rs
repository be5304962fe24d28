//! The spindle's encoder from samples of its signals A, B and index, one each microsecond.
//!
//! Invariant: a count is never guessed: a change of A and B between two samples, an index that never stays, and samples
//! that are not there are errors of the reading.

use retrace_card::{EncoderReading, EncoderSample, MAX_ENCODER_SAMPLES};

/// Samples a second: the unit of time here is the microsecond.
pub const SAMPLES_HZ: u32 = 1_000_000;
/// Bits of a sample: A, B, index, and one that is not used. The first sample of a word is in its lowest bits.
pub const BITS_PER_SAMPLE: u32 = 4;
/// Samples in a word.
pub const SAMPLES_PER_WORD: u32 = 32 / BITS_PER_SAMPLE;
/// Words of the ring: 16 ms.
pub const RING_WORDS: usize = 2048;
/// Highest rate of counts that is promised, in counts per second: a count lasts four samples, and is seen even where
/// the signals leave it a quarter of that.
pub const MAX_COUNTS_HZ: u32 = 250_000;

/// Samples in the ring.
const RING_SAMPLES: u32 = RING_WORDS as u32 * SAMPLES_PER_WORD;
/// Samples that may wait: those of 2 ms less than the ring has, which are written while these are read.
const MAX_WAITING: u32 = RING_SAMPLES - 2_000;
/// Words that may be missing at the end of the ring, for the time until they are written; that time, in samples.
const WORDS_UNDER_WAY: u32 = 1;
const SAMPLES_UNDER_WAY: u32 = 2;
/// Changes of the index in a reading that are looked at: eight, and one in 256 µs. More are no index.
const INDEX_CHANGES: u32 = 8;
const INDEX_CHANGE_US: u32 = 256;
/// Bits of the three signals in a sample, and in all samples of a word.
const SIGNALS: u32 = 0b111;
const ALL_SIGNALS: u32 = 0x7777_7777;
/// The lowest bit of each sample in a word: A.
const EACH: u32 = 0x1111_1111;
const INDEX: u32 = 0b100;

/// What is known of the samples at the end of a control period. Samples are numbered from the first one on; the numbers
/// wrap around.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampledPeriod {
    /// The first sample behind the control period.
    pub end: u32,
    /// Number of samples that were taken, or one more.
    pub taken: u32,
    /// Word of the ring that is written next, modulo [`RING_WORDS`]; `None` where that is not known.
    pub next_word: Option<u32>,
    /// Control period in microseconds, at most 10 000.
    pub period_us: u32,
}

impl SampledPeriod {
    /// Whether all samples before `end` from this one on are in the ring.
    fn has_samples_from(&self, at: u32) -> bool {
        let Some(next_word) = self.next_word else { return false };
        let words = self.taken / SAMPLES_PER_WORD;
        let missing = words.wrapping_sub(next_word) % RING_WORDS as u32;
        let last = self.end.wrapping_sub(1) / SAMPLES_PER_WORD;
        // The numbers of words wrap around where those of the samples do.
        let behind_last = words.wrapping_sub(missing).wrapping_sub(last) % (u32::MAX / SAMPLES_PER_WORD + 1);
        let is_written = (1..=RING_WORDS as u32).contains(&behind_last);
        missing <= WORDS_UNDER_WAY && is_written && self.taken.wrapping_sub(at) <= MAX_WAITING
    }

    /// Number of samples that were taken once those before `end` are in the ring.
    #[must_use]
    pub const fn written_once_taken(end: u32) -> u32 {
        (end.wrapping_sub(1) | (SAMPLES_PER_WORD - 1)).wrapping_add(1 + SAMPLES_UNDER_WAY)
    }
}

/// Counts and index of an encoder, from one control period to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpindleDecoder {
    /// The next sample.
    at: u32,
    /// Levels of the last sample; `None` before the first.
    levels: Option<u32>,
    counter: u16,
    last: Counts,
    /// Counter at the index that was seen last in this reading.
    index: Option<u16>,
    /// Not 0 once A and B have changed at once in this reading.
    both: u32,
    /// Changes of the index that this reading may still have.
    index_changes_left: u32,
}

/// Counts in samples of a word, one bit in the place of A for each sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Counts {
    /// Number of the first sample.
    first: u32,
    up: u32,
    down: u32,
}

impl Counts {
    /// Sample of the last count; the first one without any.
    const fn edge(&self) -> u32 {
        self.first.wrapping_add((31 - (self.up | self.down | 1).leading_zeros()) / BITS_PER_SAMPLE)
    }

    /// Whether the last count was down.
    const fn is_down(&self) -> bool {
        self.down > self.up
    }

    const fn added_to(&self, counter: u16) -> u16 {
        counter.wrapping_add(number_of(self.up)).wrapping_sub(number_of(self.down))
    }
}

/// Returns the number of samples of a word whose bit is set.
const fn number_of(samples: u32) -> u16 {
    (samples.wrapping_mul(EACH) >> (32 - BITS_PER_SAMPLE)) as u16
}

impl SpindleDecoder {
    /// Creates a decoder at 0 that begins with this sample.
    #[must_use]
    pub const fn new(at: u32) -> Self {
        Self {
            at,
            levels: None,
            counter: 0,
            last: Counts { first: at, up: 0, down: 0 },
            index: None,
            both: 0,
            index_changes_left: 0,
        }
    }

    /// Reads the samples up to the end of a control period: one of the counter for each millisecond. `word` returns a
    /// word of the ring by its number.
    pub fn read(&mut self, of: &SampledPeriod, word: impl Fn(u32) -> u32) -> EncoderReading {
        let (begin, length) = (self.at, of.end.wrapping_sub(self.at));
        (self.index, self.both) = (None, 0);
        self.index_changes_left = INDEX_CHANGES + length / INDEX_CHANGE_US;
        let mut reading = EncoderReading::default();
        if length > RING_SAMPLES || !of.has_samples_from(begin) {
            // What was missed is not known: the counts begin anew.
            *self = Self { counter: self.counter, ..Self::new(of.end) };
            return EncoderReading { is_faulty: true, ..reading };
        }
        self.levels = self.levels.or_else(|| Some(word(begin / SAMPLES_PER_WORD) >> place_of(begin) & SIGNALS));
        let count = length.div_ceil(1000).clamp(1, MAX_ENCODER_SAMPLES as u32);
        for (n, sample) in (1..=count).zip(&mut reading.samples) {
            self.read_until(begin.wrapping_add(length * n / count), &word);
            *sample = EncoderSample { counter: self.counter, edge: part_of(self.last.edge(), of) };
        }
        let is_faulty = self.both != 0 || self.index_changes_left == 0;
        EncoderReading { count: count as u8, index: self.index, is_faulty, ..reading }
    }

    /// Reads the samples before this one. It is a function of its own, so that most of its values are in registers.
    #[inline(never)]
    fn read_until(&mut self, end: u32, word: &impl Fn(u32) -> u32) {
        let (mut at, mut levels) = (self.at, self.levels.unwrap_or(0));
        while at != end {
            let mut samples = word(at / SAMPLES_PER_WORD);
            // Most words have no change.
            if samples & ALL_SIGNALS == levels * EACH && end.wrapping_sub(at) >= SAMPLES_PER_WORD {
                at = (at | (SAMPLES_PER_WORD - 1)).wrapping_add(1);
                continue;
            }
            samples >>= place_of(at);
            let count = (SAMPLES_PER_WORD - at % SAMPLES_PER_WORD).min(end.wrapping_sub(at));
            levels = self.read_samples(at, samples, count, levels);
            at = at.wrapping_add(count);
        }
        (self.at, self.levels) = (at, Some(levels));
    }

    /// Reads so many samples of a word, all at once. A leads B where it counts up: then the level of A after a change
    /// is not that of B before it. Returns the levels of the last sample.
    fn read_samples(&mut self, at: u32, samples: u32, count: u32, levels: u32) -> u32 {
        let before = samples << BITS_PER_SAMPLE | levels;
        let changed = (samples ^ before) & u32::MAX >> (32 - BITS_PER_SAMPLE * count);
        let (a, b, index) = (changed & EACH, changed >> 1 & EACH, changed >> 2 & EACH);
        let up = (samples ^ before >> 1) & (a ^ b);
        let counts = Counts { first: at, up, down: up ^ a ^ b };
        if index != 0 {
            self.read_index(samples, index, &counts);
        }
        if a != b {
            (self.counter, self.last) = (counts.added_to(self.counter), counts);
        }
        self.both |= a & b;
        samples >> (BITS_PER_SAMPLE * (count - 1)) & SIGNALS
    }

    /// Reads changes of the index in samples of a word with these counts. The index is where it begins, counting up,
    /// and where it ends, counting down: at the same angle, whatever its width.
    #[cold]
    #[inline(never)]
    fn read_index(&mut self, samples: u32, changes: u32, counts: &Counts) {
        self.index_changes_left = self.index_changes_left.saturating_sub(1);
        if self.index_changes_left == 0 {
            return;
        }
        let (mut is_down, mut counter) = (self.last.is_down(), self.counter);
        for n in 0..SAMPLES_PER_WORD {
            let shift = BITS_PER_SAMPLE * n;
            let is_in = |bits: u32| bits >> shift & 1 == 1;
            let before = counter;
            if is_in(counts.up | counts.down) {
                is_down = is_in(counts.down);
                counter = if is_down { before.wrapping_sub(1) } else { before.wrapping_add(1) };
            }
            if is_in(changes) && (samples >> shift & INDEX != 0) != is_down {
                self.index = Some(if is_down { before } else { counter });
            }
        }
    }
}

/// Returns the lowest bit of a sample in its word.
const fn place_of(sample: u32) -> u32 {
    sample % SAMPLES_PER_WORD * BITS_PER_SAMPLE
}

/// The part of the control period at which a sample was, in units of 2⁻¹⁶: rounded up, so that the microsecond is
/// recovered by rounding down. In a period that was longer than planned, its beginning is as long.
fn part_of(sample: u32, of: &SampledPeriod) -> u16 {
    let at_us = of.period_us.saturating_sub(of.end.wrapping_sub(sample));
    (at_us << 16).div_ceil(of.period_us.max(1)).min(u32::from(u16::MAX)) as u16
}

#[cfg(test)]
mod tests;
