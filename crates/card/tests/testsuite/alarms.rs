//! What stops a card, one cause after the other, and how it goes on.
//!
//! Invariant: every expectation here is the protocol's or the requirement's, none was read off the card.

use crate::common;

use common::{DOOR, HOME, LOWER_LIMIT, PLAIN, PULSE, STOP, STOPS_WITHIN, TestCard, UPPER_LIMIT};
use common::{identity, levels, moved, opened, record, rests_before, settings};
use retrace_card::{Card, InputLevels};
use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Distance, Place, RapidCap, Rate, Record, RecordIndex};
use retrace_link::{
    Alarm, CardCore, CardSettings, CommandRefusal, HomingCommand, HostCommand, InputUse, InputWait, Instruction,
    OutputAction, OutputChange, RepeatedInstruction, channel,
};

/// A card in motion over 60 records at full rate, ten periods under way.
fn running() -> TestCard {
    let mut card = opened(0);
    for place in 0..60 {
        // without planned stops, so that every stop has to be braked
        let record = Record { flags: retrace_core::Flags::NONE, ..record(place) };
        card.accept(HostCommand::Ahead { place: RecordIndex::new(place), record }).expect("room");
    }
    card.accept(HostCommand::ManualOutput(OutputChange { channel: 3, value: 1 })).expect("an output");
    card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
    for _ in 0..10 {
        card.keep_alive();
        card.run_period(levels(0));
    }
    assert!(card.status().place.record.number() >= 3 && card.status().outputs[3] == 1);
    card
}

/// The alarm is latched in the period that `inputs` come in, and the card comes to rest on the path as the law says.
fn brakes(card: &mut TestCard, inputs: InputLevels, alarm: Alarm) {
    let rate = card.status().rate;
    let status = *card.run_period(inputs);
    assert_eq!((status.alarm, status.outputs[3]), (Some(alarm), 0));
    assert!(status.rate != Rate::ZERO && status.rate <= rate, "braked, not cut off");
    for _ in 1..STOPS_WITHIN {
        card.keep_alive();
        assert_eq!(card.accept(HostCommand::rate(Rate::ONE)), Err(CommandRefusal::Alarm));
        card.run_period(inputs);
    }
    assert!(card.status().at_rest);
    assert_eq!((card.status().counts, card.status().alarm), (moved(0, card.status().place), Some(alarm)));
}

#[test]
fn every_cause_brakes_on_the_path_and_keeps_the_outputs_safe_until_it_is_gone_and_cleared() {
    let causes = [
        (STOP, Alarm::EmergencyStop),
        (DOOR, Alarm::DoorOpen),
        (UPPER_LIMIT, Alarm::LimitSwitch { axis: 0, upper: true }),
        (LOWER_LIMIT, Alarm::LimitSwitch { axis: 0, upper: false }),
    ];
    for (input, alarm) in causes {
        let mut card = running();
        brakes(&mut card, levels(input), alarm);
        let is_limit = matches!(alarm, Alarm::LimitSwitch { .. });
        if !is_limit {
            assert_eq!(card.accept(HostCommand::ClearAlarm), Err(CommandRefusal::Alarm));
        }
        assert_eq!(
            card.accept(HostCommand::ManualOutput(OutputChange { channel: 3, value: 1 })),
            Err(CommandRefusal::Alarm)
        );
        assert_eq!(card.accept(HostCommand::ManualOutput(OutputChange { channel: 4, value: 1 })), Ok(()));
        assert_eq!(card.accept(HostCommand::Instruction(Instruction::default())), Err(CommandRefusal::Alarm));
        assert_eq!(card.accept(HostCommand::Home(HomingCommand::default())), Err(CommandRefusal::Alarm));
        card.accept(HostCommand::Ahead { place: RecordIndex::new(60), record: record(60) })
            .expect("records are taken all the same");
        card.keep_alive();
        card.run_period(levels(0));
        card.accept(HostCommand::ClearAlarm).expect("the cause has gone");
        card.accept(HostCommand::ManualOutput(OutputChange { channel: 3, value: 2 }))
            .expect("nothing keeps it any more");
        let place = card.status().place;
        for _ in 0..20 {
            card.keep_alive();
            assert_eq!((card.run_period(levels(0)).place, card.status().alarm), (place, None));
        }
        card.accept(HostCommand::rate(Rate::ONE)).expect("a new word");
        card.run_period(levels(0));
        assert!(place.distance_to(card.status().place) > Distance::ZERO);
    }
}

#[test]
fn a_silent_host_stops_the_card_also_at_rest_and_opening_anew_does_not_clear_it() {
    let mut card = running();
    for n in 1..=60 {
        let silent = card.run_period(levels(0)).alarm == Some(Alarm::HostSilent);
        // the last of the ten periods before had been heard in
        assert_eq!(silent, n >= 29, "{n}");
    }
    assert!(card.status().at_rest && card.status().outputs[3] == 0);
    assert_eq!(card.accept(HostCommand::ClearAlarm), Err(CommandRefusal::Alarm));
    card.open(&settings(2, 500)).expect("at rest");
    assert_eq!(card.status().alarm, Some(Alarm::HostSilent));
    assert_eq!(
        (card.status().place, card.accept(HostCommand::rate(Rate::ONE))),
        (Place::start_of(RecordIndex::new(500)), Err(CommandRefusal::Alarm))
    );
    let mut other = settings(3, 500);
    other.safe[0] = OutputChange { channel: 5, value: 9 };
    card.open(&other).expect("at rest");
    assert_eq!(card.status().outputs[5], 9, "what is safe is said anew and holds at once");
    card.keep_alive();
    card.accept(HostCommand::ClearAlarm).expect("the host is there");

    let mut idle = TestCard::new(identity()).expect("a memory");
    for _ in 0..100 {
        assert_eq!(idle.run_period(levels(!0)).alarm, None, "nobody has opened it");
    }
    idle.open(&settings(1, 0)).expect("fit");
    idle.accept(HostCommand::ManualOutput(OutputChange { channel: 3, value: 1 })).expect("an output");
    for _ in 0..30 {
        idle.run_period(levels(0));
    }
    assert_eq!((idle.status().alarm, idle.status().outputs[3]), (Some(Alarm::HostSilent), 0));
}

#[test]
fn a_door_may_be_open_while_nothing_moves_and_stops_what_is_about_to() {
    let mut card = opened(0);
    for place in 0..40 {
        card.accept(HostCommand::Ahead { place: RecordIndex::new(place), record: record(place) }).expect("room");
        card.keep_alive();
        assert_eq!(card.run_period(levels(DOOR)).alarm, None);
    }
    card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
    assert_eq!((card.run_period(levels(DOOR)).alarm, card.status().rate), (Some(Alarm::DoorOpen), Rate::ZERO));
    let mut card = opened(0);
    card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
    assert_eq!(card.run_period(levels(DOOR)).alarm, None, "there is nothing to run");
    card.accept(HostCommand::Instruction(Instruction { number: 1, periods: 3, ..Instruction::default() }))
        .expect("in order");
    assert_eq!(card.run_period(levels(DOOR)).alarm, Some(Alarm::DoorOpen));
    assert_eq!(card.status().executed, 0);
    let mut card = opened(0);
    let mut instruction = Instruction { number: 1, count: 1, ..Instruction::default() };
    instruction.changes[0] = OutputChange { channel: channel::TOOL, value: 5 };
    card.accept(HostCommand::Instruction(instruction)).expect("in order");
    assert_eq!(card.run_period(levels(DOOR)).alarm, None, "it is kept");
    card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
    assert_eq!(card.run_period(levels(DOOR)).alarm, Some(Alarm::DoorOpen));
    assert_eq!(card.status().outputs[usize::from(channel::TOOL)], 0, "it has not begun");
}

#[test]
fn a_limit_switch_that_was_cleared_lets_the_axis_leave_and_nothing_else() {
    for (wrong, increment) in [(true, 5), (false, -5)] {
        let mut card = opened(0);
        let limit = Alarm::LimitSwitch { axis: 0, upper: true };
        assert_eq!(card.run_period(levels(UPPER_LIMIT)).alarm, Some(limit));
        card.accept(HostCommand::ClearAlarm).expect("at rest; only motion can open the switch");
        for place in 0..40 {
            let record = Record { increments: [increment, 7], ..Record::default() };
            card.accept(HostCommand::Ahead { place: RecordIndex::new(place), record }).expect("room");
        }
        card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
        card.keep_alive();
        let alarm = card.run_period(levels(UPPER_LIMIT)).alarm;
        assert_eq!(alarm, wrong.then_some(limit));
        card.run_period(levels(0));
        assert_eq!(card.run_period(levels(UPPER_LIMIT)).alarm, Some(limit), "it has been open: it counts again");
    }
}

#[test]
fn a_record_with_too_many_pulses_is_refused_brakes_the_card_and_is_never_emitted() {
    let mut card = running();
    // 1000 ticks a period, 2 a pulse, 5 to set the direction up: (1000 − 9) / 4; one is kept for rounding
    assert_eq!(card.settings().map(|terms| terms.max_increment()), Some(247));
    let place = card.status().high;
    let too_many = |increment, cap| Record { increments: [0, increment], cap, ..Record::default() };
    assert_eq!(card.accept(HostCommand::Ahead { place, record: too_many(246, RapidCap::PLANNED) }), Ok(()));
    assert_eq!(card.status().alarm, None);
    let fast = HostCommand::Ahead { place: place + 1, record: too_many(130, RapidCap::sixteenths(32)) };
    assert_eq!(card.accept(fast), Err(CommandRefusal::Unsupported));
    assert_eq!(card.status().alarm, Some(Alarm::TooManyPulses { axis: 1 }));
    brakes(&mut card, levels(0), Alarm::TooManyPulses { axis: 1 });
    assert_eq!(card.status().high, place + 1);
    for increment in [247, -247, i16::MIN] {
        let mut card = opened(0);
        assert_eq!(
            card.accept(HostCommand::Ahead {
                place: RecordIndex::new(0),
                record: too_many(increment, RapidCap::PLANNED)
            }),
            Err(CommandRefusal::Unsupported)
        );
        assert_eq!(card.status().alarm, Some(Alarm::TooManyPulses { axis: 1 }));
    }
}

#[test]
fn an_instruction_that_fails_or_takes_too_long_is_not_executed_and_its_number_stays() {
    let until = Some(InputWait::new(5, true, 10));
    let instruction = Instruction { number: 1, periods: 5, until, ..Instruction::default() };
    let begun = || {
        let mut card = opened(0);
        card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
        card.accept(HostCommand::Instruction(instruction)).expect("in order");
        card
    };
    let mut card = begun();
    for n in 1..=15 {
        let alarm = (n == 15).then_some(Alarm::TimedOut { instruction: 1 });
        assert_eq!((card.run_period(levels(0)).alarm, card.status().executed), (alarm, 0));
    }
    card.accept(HostCommand::ClearAlarm).expect("nothing stands against it");
    card.keep_alive();
    card.accept(HostCommand::Instruction(instruction)).expect("the number is the next still");
    for _ in 0..8 {
        assert_eq!(card.run_period(levels(PLAIN)).executed, 0, "the target is 0 since the alarm");
    }
    card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
    for n in 1..=5 {
        assert_eq!(card.run_period(levels(PLAIN)).executed, u32::from(n == 5));
    }
    let mut card = begun();
    let failed = InputLevels { failed: true, ..InputLevels::default() };
    card.run_period(levels(0));
    assert_eq!(card.run_period(failed).alarm, Some(Alarm::Failed { instruction: 1 }));
    assert_eq!((card.accept(HostCommand::ClearAlarm), card.status().executed), (Err(CommandRefusal::Alarm), 0));
    card.run_period(levels(0));
    assert_eq!(card.accept(HostCommand::ClearAlarm), Ok(()));
}

/// A wait for an input that the card does not have would never end.
#[test]
fn a_wait_for_an_input_that_the_card_does_not_have_is_refused() {
    for (input, accepted) in [(0, true), (5, true), (6, false), (15, false), (16, false), (255, false)] {
        let until = Some(InputWait::new(input, true, 10));
        let instruction = Instruction { number: 1, until, ..Instruction::default() };
        let repeated = RepeatedInstruction { number: 1, until, ..RepeatedInstruction::default() };
        for command in [HostCommand::Instruction(instruction), HostCommand::Repeat(repeated)] {
            let expected = if accepted { Ok(()) } else { Err(CommandRefusal::Unsupported) };
            assert_eq!(opened(0).accept(command), expected, "input {input}: {command:?}");
        }
    }
}

#[test]
fn an_action_that_is_passed_while_braking_does_not_undo_what_is_safe() {
    let mut card = opened(0);
    for place in 0..60 {
        for channel in [3, 4] {
            let action = OutputAction { place: RecordIndex::new(place), channel, before: 0, after: 1 };
            card.accept(HostCommand::Action(action)).expect("room");
        }
        card.accept(HostCommand::Ahead { place: RecordIndex::new(place), record: record(place) }).expect("room");
    }
    card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
    card.run_period(levels(0));
    assert_eq!(card.status().outputs[3..5], [1, 1]);
    card.accept(HostCommand::ManualOutput(OutputChange { channel: 4, value: 0 })).expect("an output");
    for _ in 0..STOPS_WITHIN {
        card.run_period(levels(STOP));
        assert_eq!(card.status().outputs[3], 0);
    }
    assert_eq!(card.status().outputs[4], 1, "only what is called safe is kept");
}

#[test]
fn settings_that_do_not_fit_are_refused_and_change_nothing() {
    let mut card = TestCard::new(identity()).expect("a memory");
    assert_eq!((card.identity().window, card.identity().memory, card.identity().axes), (64, 32, 2));
    let good = settings(1, 9);
    let axis = PulseLimits { velocity: 30 << 32, acceleration: 8 << 32, jerk: 1 << 32 };
    let limits = RateLimits::new(41, 1 << 15, [axis; 2]).expect("valid");
    let door = |number: usize| {
        let mut bad = good;
        bad.inputs[number].used_for = InputUse::Door;
        bad
    };
    let mut no_axis = good;
    no_axis.inputs[0].used_for = InputUse::Home { axis: 2 };
    let mut no_output = good;
    no_output.safe[0].channel = 8;
    let unfit: [CardSettings<2>; 14] = [
        CardSettings { epoch: 0, ..good },
        CardSettings { axes: 0, ..good },
        CardSettings { axes: 3, ..good },
        CardSettings { period_us: 99, ..good },
        CardSettings { period_us: 10_001, ..good },
        CardSettings { limits, ..good },
        CardSettings { report_periods: 0, ..good },
        CardSettings { watchdog_periods: 0, ..good },
        CardSettings { safe_count: 17, ..good },
        CardSettings { pulse_ns: u16::MAX, period_us: 200, ..good },
        CardSettings { direction_setup_ns: u16::MAX, period_us: 100, ..good },
        door(6),
        door(15),
        no_axis,
    ];
    for (number, bad) in unfit.iter().enumerate() {
        assert_eq!(card.open(bad), Err(CommandRefusal::Unsupported), "number {number}");
    }
    assert_eq!(card.open(&no_output), Err(CommandRefusal::NoSuchChannel));
    assert!(card.settings().is_none() && card.status().place == Place::start_of(RecordIndex::new(0)));
    let commands: [HostCommand<2>; 5] = [
        HostCommand::rate(Rate::from_units(1)),
        HostCommand::Ahead { place: RecordIndex::new(0), record: record(0) },
        HostCommand::ClearAlarm,
        HostCommand::ManualOutput(OutputChange::default()),
        HostCommand::Instruction(Instruction { number: 1, ..Instruction::default() }),
    ];
    for command in commands {
        assert_eq!(card.accept(command), Err(CommandRefusal::Unsupported), "nobody has opened it");
    }
    card.accept(HostCommand::rate(Rate::ZERO)).expect("a stop is always taken");
    card.open(&good).expect("fit");
    card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
    let place = card.status().high;
    card.accept(HostCommand::Ahead { place, record: record(place.number()) }).expect("room");
    card.accept(HostCommand::Ahead { place: place + 1, record: record(place.number() + 1) }).expect("room");
    card.accept(HostCommand::rate(Rate::ONE / 9)).expect("a rate");
    card.run_period(levels(0));
    assert_eq!(card.open(&settings(2, 0)), Err(CommandRefusal::InMotion));
    let one_axis = CardSettings { axes: 1, inputs: Default::default(), ..settings(3, 0) };
    let mut card = TestCard::new(identity()).expect("a memory");
    card.open(&one_axis).expect("fit");
    let both = Record { increments: [1, 1], ..Record::default() };
    assert_eq!(
        card.accept(HostCommand::Ahead { place: RecordIndex::new(0), record: both }),
        Err(CommandRefusal::Unsupported)
    );
    assert_eq!(card.status().alarm, None);
}

#[test]
fn an_epoch_begins_at_the_counts_as_they_are_with_nothing_on_the_window() {
    let mut card = opened(0);
    for place in 0..16 {
        card.accept(HostCommand::Ahead { place: RecordIndex::new(place), record: record(place) }).expect("room");
    }
    card.accept(HostCommand::Instruction(Instruction { number: 1, ..Instruction::default() })).expect("in order");
    card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
    card.accept(HostCommand::ManualOutput(OutputChange { channel: channel::FLOOD, value: 1 })).expect("an output");
    for _ in 0..20 {
        card.run_period(levels(0));
    }
    let counts = moved(0, Place::start_of(RecordIndex::new(16)));
    assert_eq!((card.status().counts, card.status().executed), (counts, 1));
    let start = RecordIndex::new(u32::MAX - 5);
    card.open(&settings(2, start.number())).expect("at rest");
    let status = *card.status();
    assert_eq!((status.counts, status.low, status.high, status.reached), (counts, start, start, start));
    assert_eq!((status.place, status.executed, status.period), (Place::start_of(start), 0, 20));
    assert_eq!(status.outputs[usize::from(channel::FLOOD)], 1);
    for n in 0..16 {
        let place = start + n;
        card.accept(HostCommand::Ahead { place: RecordIndex::new(place.number()), record: record(place.number()) })
            .expect("room");
    }
    card.run_period(levels(0));
    assert_eq!(
        card.status().place,
        Place::start_of(RecordIndex::new(start.number())),
        "the rate of the last epoch is gone"
    );
    card.accept(HostCommand::Behind {
        place: start - 1,
        record: record(start.number() - 1),
        rests: rests_before(start.number() - 1, 0),
    })
    .expect("room");
}

#[test]
fn actions_of_another_epoch_are_not_executed() {
    let mut card = opened(0);
    card.accept(HostCommand::Action(OutputAction { place: RecordIndex::new(2), channel: 4, before: 0, after: 1 }))
        .expect("room");
    card.open(&settings(2, 0)).expect("at rest");
    for place in 0..16 {
        card.accept(HostCommand::Ahead { place: RecordIndex::new(place), record: record(place) }).expect("room");
    }
    card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
    for _ in 0..20 {
        card.run_period(levels(0));
    }
    assert_eq!((card.status().place, card.status().outputs[4]), (Place::start_of(RecordIndex::new(16)), 0));
}

#[test]
fn the_wheel_and_the_inputs_are_reported() {
    let mut card = opened(0);
    card.run_period(InputLevels { levels: PLAIN, encoder: 65_530, failed: false, ..InputLevels::default() });
    assert_eq!((card.status().inputs, card.status().wheel), (PLAIN, 0));
    card.run_period(InputLevels { levels: 0xFFC0, encoder: 4, failed: false, ..InputLevels::default() });
    assert_eq!((card.status().inputs, card.status().wheel), (0, 10));
}

/// Homes a card whose switch closes at `at` pulses above where it stands, and returns the card and the position it
/// moved to.
fn home(card: &mut TestCard, at: i64, farthest: u32, mut each: impl FnMut(&mut TestCard, u32)) -> i64 {
    let order = HomingCommand {
        axis: 0,
        upper: true,
        search_speed: PULSE * 5,
        latch_speed: PULSE / 4,
        acceleration: PULSE / 4,
        max_travel: farthest,
        count: 1000,
    };
    card.accept(HostCommand::Home(order)).expect("at rest, nothing on the window");
    let mut position = 0;
    for n in 0..20_000 {
        card.keep_alive();
        each(card, n);
        // the limit switch lies right behind the home switch
        let inputs = if position >= at { HOME | UPPER_LIMIT } else { 0 };
        let status = card.run_period(levels(inputs));
        position += i64::from(status.increments[0]);
        assert_eq!(
            (status.rate, status.increments[1], status.place),
            (Rate::ZERO, 0, Place::start_of(RecordIndex::new(0)))
        );
        if status.at_rest {
            return position;
        }
        let path: [HostCommand<2>; 3] = [
            HostCommand::Ahead { place: RecordIndex::new(0), record: record(0) },
            HostCommand::rate(Rate::ONE),
            HostCommand::Instruction(Instruction { number: 1, ..Instruction::default() }),
        ];
        assert!(path.into_iter().all(|command| card.accept(command).is_err()));
        assert_eq!(card.open(&settings(2, 0)), Err(CommandRefusal::InMotion));
        assert_eq!(
            card.accept(HostCommand::Home(order)),
            Err(if status_alarm(card) { CommandRefusal::Alarm } else { CommandRefusal::InMotion })
        );
        assert!(!card.status().at_rest);
    }
    panic!("homing has no end");
}

fn status_alarm(card: &TestCard) -> bool {
    card.status().alarm.is_some()
}

#[test]
fn homing_sets_the_count_at_the_switch_and_asks_for_a_new_epoch() {
    for at in [0, 1, 400] {
        let mut card = opened(0);
        let position = home(&mut card, at, 1000, |_, _| {});
        assert_eq!(card.status().alarm, None);
        assert!((-4..=0).contains(&(position - at)), "off the switch, at rest: {position}");
        // the switch opened on the pulse below its edge, seen in the next period
        assert!((0..=1).contains(&(card.status().counts[0] - 1000 - (position - at))), "{:?}", card.status().counts);
        assert_eq!(card.accept(HostCommand::rate(Rate::ONE)), Err(CommandRefusal::Unsupported));
        assert_eq!(
            card.accept(HostCommand::Ahead { place: RecordIndex::new(0), record: record(0) }),
            Err(CommandRefusal::Unsupported)
        );
        let counts = card.status().counts;
        card.open(&settings(2, 77)).expect("at rest");
        assert_eq!((card.status().counts, card.status().low), (counts, RecordIndex::new(77)));
        card.accept(HostCommand::Ahead { place: RecordIndex::new(77), record: record(77) }).expect("an epoch is open");
    }
}

#[test]
fn homing_ends_in_an_alarm_or_cleanly_and_always_at_rest() {
    let mut card = opened(0);
    assert!(home(&mut card, 5000, 1000, |_, _| {}) >= 1000);
    assert_eq!(card.status().alarm, Some(Alarm::HomingFailed { axis: 0 }));
    card.accept(HostCommand::ClearAlarm).expect("no cause is left");
    card.accept(HostCommand::Home(HomingCommand {
        axis: 1,
        search_speed: 1,
        latch_speed: 1,
        acceleration: 1,
        ..HomingCommand::default()
    }))
    .expect_err("no switch");

    let mut card = opened(0);
    let stop = |card: &mut TestCard, n: u32| {
        if n == 50 {
            card.accept(HostCommand::rate(Rate::ZERO)).expect("always taken");
        }
    };
    let position = home(&mut card, 5000, 100_000, stop);
    assert_eq!((card.status().alarm, card.status().counts[0]), (None, position));
    assert_eq!(
        card.accept(HostCommand::Ahead { place: RecordIndex::new(0), record: record(0) }),
        Err(CommandRefusal::Unsupported)
    );

    let mut card = opened(0);
    let order = HomingCommand {
        axis: 0,
        upper: true,
        search_speed: PULSE * 5,
        latch_speed: PULSE,
        acceleration: PULSE,
        max_travel: 1000,
        count: 0,
    };
    card.accept(HostCommand::Home(order)).expect("at rest");
    for _ in 0..20 {
        card.run_period(levels(0));
    }
    assert_eq!(card.run_period(levels(LOWER_LIMIT)).alarm, Some(Alarm::LimitSwitch { axis: 0, upper: false }));
    for _ in 0..6 {
        card.run_period(levels(LOWER_LIMIT));
    }
    assert!(card.status().at_rest && card.status().increments == [0, 0]);
    card.accept(HostCommand::Ahead { place: RecordIndex::new(0), record: record(0) }).expect_err("a new epoch first");
}

#[test]
fn homing_needs_an_empty_window_and_a_card_at_rest() {
    let order = HomingCommand {
        axis: 0,
        upper: true,
        search_speed: PULSE,
        latch_speed: PULSE,
        acceleration: PULSE,
        max_travel: 10,
        count: 0,
    };
    let mut card = running();
    assert_eq!(card.accept(HostCommand::Home(order)), Err(CommandRefusal::InMotion));
    let mut card = opened(0);
    card.accept(HostCommand::Ahead { place: RecordIndex::new(0), record: record(0) }).expect("room");
    assert_eq!(card.accept(HostCommand::Home(order)), Err(CommandRefusal::InMotion));
    let mut card = opened(0);
    assert_eq!(
        card.accept(HostCommand::Home(HomingCommand { search_speed: PULSE * 300, ..order })),
        Err(CommandRefusal::Unsupported)
    );
    assert_eq!(card.accept(HostCommand::Home(HomingCommand { axis: 9, ..order })), Err(CommandRefusal::Unsupported));
    card.accept(HostCommand::Ahead { place: RecordIndex::new(0), record: record(0) })
        .expect("a refused order changes nothing");
}

/// What a microcontroller has to find room for.
#[test]
fn a_card_of_four_axes_fits_30_kib() {
    assert!(size_of::<Card<4, 1024, 256>>() <= 30 * 1024, "{}", size_of::<Card<4, 1024, 256>>());
    println!(
        "Card<4, 1024, 256>: {} bytes; <…, 64>: {}",
        size_of::<Card<4, 1024, 256>>(),
        size_of::<Card<4, 1024, 64>>()
    );
}
