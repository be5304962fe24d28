//! Probing moves at the card: the touch is what was emitted by the edge, and the card stops by itself (PRB-1 … PRB-4,
//! PRB-10).

use proptest::prelude::*;
use retrace_card::{InputLevels, ProbeReading};
use retrace_core::fine::pulse_slots;
use retrace_core::{Flags, Rate, Record, RecordIndex};
use retrace_link::{
    Alarm, CardCore, CommandRefusal, HostCommand, InputUse, PathStart, ProbeArming, ProbeLatch, channel,
};

use crate::common::{STOPS_WITHIN, TestCard, identity, settings};

/// The probe's input.
const PROBE: u8 = 5;
const LEVEL: u16 = 1 << PROBE;

/// A card with a probe, and 64 records of a straight move.
fn probing_card(increments: [i16; 2], flags: Flags) -> TestCard {
    let mut card = TestCard::new(identity()).expect("a memory");
    let mut with_probe = settings(1, 0);
    with_probe.inputs[usize::from(PROBE)].used_for = InputUse::Probe;
    with_probe.watchdog_periods = 1000;
    card.open(&with_probe).expect("fit");
    for n in 0..64 {
        let flags = if n == 63 { flags.with(Flags::REST) } else { flags };
        let record = Record { increments, line: 1, flags, ..Record::default() };
        card.accept(HostCommand::Ahead { place: RecordIndex::new(n), record }).expect("room");
    }
    card
}

fn arming(active: bool, filter_periods: u16) -> HostCommand<2> {
    HostCommand::ArmProbe(ProbeArming { input: PROBE, active, filter_periods })
}

fn inputs(level: bool, first_change: Option<u16>) -> InputLevels {
    let probe = ProbeReading { first_change, is_period_behind: false };
    InputLevels { levels: if level { LEVEL } else { 0 }, probe, ..InputLevels::default() }
}

fn run(card: &mut TestCard, inputs: InputLevels) {
    card.run_period(inputs);
}

proptest! {
    /// The touch is the sum of the pulses of each axis up to the part of the period, and lies between the counts at
    /// both ends of it; the card then stops, whatever rates arrive.
    #[test]
    fn the_touch_is_exact_and_the_card_stops(
        x in -30i16..=30, y in -30i16..=30, after in 1u32..12, part in any::<u16>(), asked in 1i64..=1 << 32,
    ) {
        let mut card = probing_card([x, y], Flags::PROBING);
        card.accept(arming(true, 0)).expect("at rest");
        card.accept(HostCommand::rate(Rate::from_units(asked))).expect("a rate");
        for _ in 0..after {
            card.run_period(inputs(false, None));
        }
        let (end, increments) = (card.status().counts, card.status().increments);
        let touch: Vec<i64> = (0..2).map(|axis| {
            let pulses = increments[axis].unsigned_abs() as u16;
            let emitted = pulse_slots(pulses, 1 << 16).filter(|&slot| slot <= u32::from(part)).count() as i64;
            end[axis] - i64::from(increments[axis]) + emitted * i64::from(increments[axis].signum())
        }).collect();
        card.run_period(inputs(true, Some(part)));
        prop_assert_eq!(card.status().probe, ProbeLatch::Touched([touch[0], touch[1]]));
        for _ in 0..STOPS_WITHIN {
            card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
            card.run_period(inputs(part % 2 == 0, Some(part)));
        }
        let rest = *card.status();
        prop_assert!(rest.at_rest && rest.alarm.is_none());
        for rate in [Rate::ONE, -Rate::ONE, Rate::ONE / 2] {
            card.accept(HostCommand::rate(rate)).expect("a rate");
            card.run_period(inputs(true, None));
        }
        prop_assert_eq!(card.status().counts, rest.counts);
        prop_assert_eq!(card.status().probe, ProbeLatch::Touched([touch[0], touch[1]]), "the first edge only");
    }
}

#[test]
fn while_armed_it_moves_forward_only_and_no_faster_than_planned() {
    let mut card = probing_card([4, 0], Flags::PROBING);
    card.accept(arming(true, 0)).expect("at rest");
    card.accept(HostCommand::rate(Rate::ONE * 2)).expect("a rate");
    for _ in 0..30 {
        assert!(card.run_period(inputs(false, None)).rate <= Rate::ONE);
    }
    card.accept(HostCommand::rate(-Rate::ONE)).expect("a rate");
    for _ in 0..60 {
        assert!(card.run_period(inputs(false, None)).rate >= Rate::ZERO);
    }
    assert!(card.status().at_rest, "it holds");
    card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
    (0..20).for_each(|_| run(&mut card, inputs(false, None)));
    card.run_period(inputs(true, Some(0)));
    assert!(matches!(card.status().probe, ProbeLatch::Touched(_)), "the latch stays live through a hold");
}

#[test]
fn a_probe_that_has_touched_already_moves_nothing() {
    for awaited in [true, false] {
        let mut card = probing_card([4, 4], Flags::PROBING);
        card.run_period(inputs(awaited, None));
        card.accept(arming(awaited, 0)).expect("at rest");
        card.run_period(inputs(awaited, None));
        assert_eq!(card.status().probe, ProbeLatch::Touched([0; 2]));
        card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
        (0..9).for_each(|_| run(&mut card, inputs(awaited, None)));
        assert_eq!((card.status().counts, card.status().at_rest), ([0; 2], true));
    }
}

#[test]
fn it_is_armed_at_rest_once_in_an_epoch_and_with_an_input_of_the_card() {
    let mut card = probing_card([4, 0], Flags::PROBING);
    let beyond = HostCommand::ArmProbe(ProbeArming { input: 6, active: true, filter_periods: 0 });
    assert_eq!(card.accept(beyond), Err(CommandRefusal::Unsupported));
    card.accept(arming(true, 0)).expect("at rest");
    assert_eq!(card.accept(arming(true, 0)), Err(CommandRefusal::Busy));
    card.open(&settings(2, 0)).expect("at rest");
    assert_eq!(card.status().probe, ProbeLatch::Idle);
    let mut card = probing_card([4, 0], Flags::PROBING);
    card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
    (0..9).for_each(|_| run(&mut card, inputs(false, None)));
    assert_eq!(card.accept(arming(true, 0)), Err(CommandRefusal::InMotion));
}

#[test]
fn a_probe_that_trips_in_another_move_is_an_alarm_and_in_its_own_move_retraced_it_is_none() {
    for (flags, alarm) in [(Flags::NONE, Some(Alarm::ProbeTripped { input: PROBE })), (Flags::PROBING, None)] {
        let mut card = probing_card([4, 0], flags);
        card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
        (0..20).for_each(|_| run(&mut card, inputs(false, None)));
        card.run_period(inputs(true, None));
        assert_eq!(card.status().alarm, alarm);
        (0..STOPS_WITHIN).for_each(|_| run(&mut card, inputs(true, None)));
        assert!(card.status().at_rest);
        assert_eq!(card.status().counts[0] == 64 * 4, alarm.is_none(), "it stops on the way");
        assert!(card.status().outputs[usize::from(channel::SPINDLE)] == 0);
    }
    // Where it is retraced, the contact closes again where it opened.
    let mut card = probing_card([4, 0], Flags::NONE);
    card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
    (0..30).for_each(|_| run(&mut card, inputs(false, None)));
    card.accept(HostCommand::rate(-Rate::ONE)).expect("a rate");
    (0..STOPS_WITHIN).for_each(|_| run(&mut card, inputs(false, None)));
    (0..3).for_each(|_| run(&mut card, inputs(true, None)));
    assert!(card.status().rate < Rate::ZERO);
    assert_eq!(card.status().alarm, None);
    (0..40).for_each(|_| run(&mut card, inputs(false, None)));
    card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
    let reached = card.status().reached;
    let mut is_closed = false;
    while card.status().place.record.is_before(reached - 1) {
        is_closed = card.status().place.record.is_before(reached - 4) && card.status().rate > Rate::ZERO;
        run(&mut card, inputs(is_closed, None));
    }
    assert_eq!((is_closed, card.status().alarm), (false, None), "forward again over what was passed");
    (0..24).for_each(|_| run(&mut card, inputs(false, None)));
    run(&mut card, inputs(true, None));
    assert_eq!(card.status().alarm, Some(Alarm::ProbeTripped { input: PROBE }), "and beyond it");
    // At rest a hand may touch it, and what is closed already may be left.
    let mut card = probing_card([4, 0], Flags::NONE);
    (0..5).for_each(|n| run(&mut card, inputs(n > 2, None)));
    card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
    (0..20).for_each(|n| run(&mut card, inputs(n < 9, None)));
    assert_eq!(card.status().alarm, None);
}

#[test]
fn a_new_epoch_may_begin_behind_the_touch() {
    let mut card = probing_card([4, 0], Flags::PROBING);
    card.accept(arming(true, 0)).expect("at rest");
    card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
    (0..20).for_each(|_| run(&mut card, inputs(false, None)));
    (0..=STOPS_WITHIN).for_each(|_| run(&mut card, inputs(true, None)));
    let counts = card.status().counts;
    card.open(&retrace_link::CardSettings { start: PathStart::at(RecordIndex::new(500)), ..settings(2, 0) })
        .expect("at rest");
    let away = Record { increments: [-4, 0], flags: Flags::REST, ..Record::default() };
    card.accept(HostCommand::Ahead { place: RecordIndex::new(500), record: away }).expect("room");
    card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
    (0..9).for_each(|_| run(&mut card, inputs(true, None)));
    assert_eq!(card.status().counts, [counts[0] - 4, counts[1]]);
}
