//! From records to pins: no period asks for more pulses than it can hold, however the records are played.
//!
//! Invariant: the records are as full as the card takes them, and the rates as high.

use crate::common;

use common::{identity, levels, rates, settings};
use proptest::prelude::*;
use retrace_card::{Card, Edge, PulsePlanError, StepDirection, StepTiming};
use retrace_core::{Flags, RapidCap, Rate, Record, RecordIndex};
use retrace_link::{Alarm, CardCore, CardSettings, CommandRefusal, HostCommand};

/// A card with a longer window, so that high rates have room.
type LongCard = Card<2, 256, 32>;

/// Pulses of two axes, sixteenths of the cap, and whether the path is at rest behind.
fn records() -> impl Strategy<Value = Vec<Record<2>>> {
    let full = prop_oneof![4 => -21i16..=21, 1 => Just(21i16), 1 => Just(-21i16)];
    let cap = prop_oneof![3 => Just(16u8), 1 => 16u8..=128];
    let record = (full.clone(), full, cap, prop::bool::weighted(0.1)).prop_map(|(x, y, cap, rests)| {
        let flags = if rests { Flags::REST } else { Flags::NONE };
        Record { increments: [x, y], flags, cap: RapidCap::sixteenths(cap), ..Record::default() }
    });
    // stretches of one record, which the rate has time to follow
    let stretch = (record, 1usize..40).prop_map(|(record, length)| vec![record; length]);
    prop::collection::vec(stretch, 1..20).prop_map(|stretches| stretches.concat())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// What the card accepts it can emit.
    #[test]
    fn what_is_accepted_can_be_emitted(
        records in records(),
        commands in prop::collection::vec((prop_oneof![Just(Rate::ONE), Just(Rate::ONE * 8), Just(Rate::ONE * -8),
            rates(-8, 8)], 1u32..60), 1..12),
    ) {
        let mut card = LongCard::new(identity()).expect("a memory");
        // 100 ticks: (100 − 9) / 4 pulses
        card.open(&CardSettings { period_us: 100, ..settings(1, 0) }).expect("fit");
        let (timing, most) = card.settings().map(|terms| (terms.timing(), terms.max_increment())).expect("open");
        prop_assert_eq!(most, 22);
        let mut outputs = [StepDirection::new(timing), StepDirection::new(timing)];
        let mut place = 0;
        for mut record in records {
            let product = |record: &Record<2>| {
                let fastest = record.increments.map(i16::unsigned_abs).into_iter().max().unwrap_or(0);
                u32::from(fastest) * u32::from(record.cap.get())
            };
            if product(&record) > 21 * 16 {
                // as much as the bound leaves
                let share = 21 * 16 / i16::from(record.cap.get());
                record.increments = record.increments.map(|i| i.clamp(-share, share));
            }
            match card.accept(HostCommand::Ahead { place: RecordIndex::new(place), record }) {
                Ok(()) => place += 1,
                refused => prop_assert_eq!(refused, Err(CommandRefusal::Full)),
            }
        }
        let mut fullest = 0;
        for (target, periods) in commands {
            card.accept(HostCommand::rate(target)).expect("a rate");
            for _ in 0..periods {
                card.keep_alive();
                let increments = card.run_period(levels(0)).increments;
                for (output, increment) in outputs.iter_mut().zip(increments) {
                    prop_assert_eq!(output.begin_period(increment), Ok(()));
                    fullest = fullest.max(increment.unsigned_abs());
                }
            }
        }
        prop_assert!(fullest <= u32::from(most));
        prop_assert_eq!(card.status().alarm, None);
    }

    /// What it does not accept it says.
    #[test]
    fn what_is_not_accepted_is_an_alarm(increment in any::<i16>(), cap in any::<u8>(), back in any::<bool>()) {
        let mut card = LongCard::new(identity()).expect("a memory");
        card.open(&settings(1, 0)).expect("fit");
        let cap = RapidCap::sixteenths(cap);
        let record = Record { increments: [0, increment], cap, ..Record::default() };
        let place = if back { u32::MAX } else { 0 };
        let command = if back { HostCommand::Behind { place: RecordIndex::new(place), record,
            rests: true } } else { HostCommand::Ahead { place: RecordIndex::new(place), record } };
        let fits = i64::from(increment).abs() * i64::from(cap.get()) <= 246 * 16;
        prop_assert_eq!(card.accept(command), if fits { Ok(()) } else { Err(CommandRefusal::Unsupported) });
        prop_assert_eq!(card.status().alarm, (!fits).then_some(Alarm::TooManyPulses { axis: 1 }));
    }
}

/// A count of pulses has 16 bits, however long the period is.
#[test]
fn more_pulses_than_can_be_counted_are_refused() {
    let timing = StepTiming::new(1 << 20, 1, 1).expect("fits");
    assert_eq!(timing.max_increment(), u16::MAX);
    for backward in [1, -1] {
        let mut output = StepDirection::new(timing);
        assert_eq!(output.begin_period(65_535 * backward), Ok(()));
        assert_eq!(output.edges().filter(|(_, edge)| *edge == Edge::Rise).count(), 65_535);
        for pulses in [65_536, 65_537, 100_000] {
            assert_eq!(output.begin_period(pulses * backward), Err(PulsePlanError), "{pulses}");
        }
    }
}

/// In a hold and in the start after it, no axis uses more than its acceleration, or more than twice its jerk.
#[test]
fn a_hold_keeps_the_limits_of_a_path_at_full_velocity() {
    for sign in [1, -1] {
        let mut card = LongCard::new(identity()).expect("a memory");
        card.open(&settings(1, 0)).expect("fit");
        for place in 0..200 {
            let record = Record { increments: [30 * sign, 0], ..Record::default() };
            card.accept(HostCommand::Ahead { place: RecordIndex::new(place), record }).expect("room");
        }
        let limits = settings(1, 0).limits.axes()[0];
        let (mut last, mut change, mut fastest) = (Rate::ONE, Rate::ZERO, Rate::ZERO);
        for (target, periods) in [(Rate::ONE, 30), (Rate::ZERO, 60), (Rate::ONE, 60)] {
            card.accept(HostCommand::rate(target)).expect("a rate");
            for _ in 0..periods {
                card.keep_alive();
                let rate = card.run_period(levels(0)).rate;
                // the path begins with a planned stop, from which the rate jumps
                let now = rate - last;
                let used = |figure: Rate| 30 * (figure.units().unsigned_abs() - figure.units().unsigned_abs().min(4));
                assert!(used(now) <= limits.acceleration, "{now:?} to {rate:?}");
                assert!(used(now - change) <= 2 * limits.jerk, "{change:?} and {now:?} to {rate:?}");
                (last, change, fastest) = (rate, now, fastest.max(now.abs()));
            }
            assert_eq!(card.status().at_rest, target == Rate::ZERO);
        }
        assert!(fastest > Rate::ONE / 50, "{fastest:?}");
    }
}
