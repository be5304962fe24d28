//! The program switches the operator's overrides off and on: M48, M49, M50, and the tapping cycles (SPN-7).
//!
//! Invariant: where they are switched off, the rate of normal run and of the way back to it is exactly 1.

use retrace_controller::{EventKind, PeriodRecord};
use retrace_core::mode::Mode;
use retrace_core::{Rate, RecordIndex};
use retrace_hal_sim::Random;

use super::jobs::{AXES, Log, complete, machine};
use crate::wired::{self, pick};

/// Lines 4 … 6 are run at 100 %.
const PROGRAM: &str = "G21 G64 P0.05 F1200\nG1 X20\nM49\nG1 X30 Y5\nX20 Y10\nG0 X10\nM48\nG1 X0 Y0\nG0 X4\nM2\n";

fn is_off(period: &PeriodRecord<AXES>) -> bool {
    (4..=6).contains(&period.line)
}

fn moving(log: &Log) -> impl Iterator<Item = &PeriodRecord<AXES>> {
    log.periods.iter().filter(|period| period.rate != Rate::ZERO)
}

/// Distance that the machine moves in each period of these lines.
fn increments(log: &Log) -> Vec<[i32; AXES]> {
    moving(log).filter(|period| is_off(period)).map(|period| period.increments).collect()
}

#[test]
fn the_rate_is_exactly_one_where_overrides_are_off_and_the_operators_elsewhere() {
    let (_, plain) = complete(&machine(60.0), PROGRAM, "");
    let (_, log) = complete(&machine(60.0), PROGRAM, "at 0s override 40%\nat 0s rapid override 25%\n");
    assert!(increments(&log) == increments(&plain), "as planned to the pulse");
    for period in moving(&log) {
        assert_eq!((period.override_rate, period.override_is_off), (Rate::percent(40), is_off(period)));
        // Before the end of what is planned, feed motion slows down to the rate of rapids, which may follow.
        let expected = if is_off(period) { Rate::ONE..=Rate::ONE } else { Rate::ZERO..=Rate::percent(40) };
        assert!(expected.contains(&period.rate), "{period:?}");
    }
    assert!(moving(&log).filter(|period| period.rate == Rate::percent(40)).count() > 2000, "the operator's, elsewhere");
    let switched: Vec<_> =
        log.events.iter().filter(|event| matches!(event.kind, EventKind::FeedOverrideSwitched(_))).collect();
    let [off, on] = switched[..] else { panic!("{switched:?}") };
    assert!(off.text().contains("off by the program") && on.text().contains("on again"), "{off:?} {on:?}");
    let count = |log: &Log| log.count(|kind| matches!(kind, EventKind::Switching(_)));
    let switchless = PROGRAM.replace("M49\n", "\n").replace("M48\n", "\n");
    assert_eq!(count(&log), count(&complete(&machine(60.0), &switchless, "").1), "no output is switched");
}

#[test]
fn an_override_above_100_is_not_planned_where_overrides_are_off() {
    let long = "G21 F600\nG1 X20\nM50 P0\nG1 X30 Y5\nX20 Y10\nX10\nM50\nG1 X0 Y0\nM2\n";
    let (_, plain) = complete(&machine(60.0), long, "");
    let (_, log) = complete(&machine(60.0), long, "at 0s override 200%\nat line 5 override 150%\n");
    assert!(increments(&log) == increments(&plain), "as planned to the pulse");
    let periods = |log: &Log, line: u32| moving(log).filter(|period| period.line == line).count();
    assert!(periods(&log, 2) * 10 < periods(&plain, 2) * 8, "{} {}", periods(&log, 2), periods(&plain, 2));
    let (raised, programmed) = (periods(&log, 8), periods(&plain, 8));
    assert!(raised * 100 < programmed * 75 && programmed * 55 < raised * 100, "150 %: {raised} of {programmed}");
}

#[test]
fn the_way_back_to_the_furthest_place_has_the_rate_of_its_place() {
    let script = "at 0s override 40%\nat line 8 reverse 50%\nafter 4s leave\n";
    let (_, log) = complete(&machine(60.0), PROGRAM, script);
    let retraced: Vec<_> = moving(&log).filter(|period| period.mode == Mode::Reverse).collect();
    assert!(retraced.iter().any(|period| period.line == 2), "it goes back to before the switch");
    assert!(retraced.iter().all(|period| period.rate >= -(Rate::ONE / 2)), "a reverse run has its own rate");
    let back: Vec<_> = moving(&log).filter(|period| period.mode == Mode::Rejoin).collect();
    assert!([2, 4, 5, 6].iter().all(|&line| back.iter().any(|period| period.line == line)), "it comes back over all");
    for period in back {
        let is_right = if is_off(period) { period.rate == Rate::ONE } else { period.rate <= Rate::percent(40) };
        assert!(is_right, "{period:?}");
    }
    let switched: Vec<bool> = log.events.iter().filter_map(|event| switched(&event.kind)).collect();
    assert_eq!(switched, [false, true, false, true, false, true], "reported in both directions");
}

fn switched(kind: &EventKind) -> Option<bool> {
    if let EventKind::FeedOverrideSwitched(on) = kind { Some(*on) } else { None }
}

/// An override of 0 stops the machine where the overrides are switched on again, and there the operator starts it.
#[test]
fn an_override_of_0_waits_for_the_end_of_the_stretch_and_starts_nothing() {
    let script = "at line 5 override 0%\nafter 5s override 60%\n";
    let (_, log) = complete(&machine(60.0), PROGRAM, script);
    let first = log.periods.iter().position(|period| period.override_rate == Rate::ZERO).expect("it is set");
    let stood: Vec<_> = log.periods[first..].iter().filter(|period| period.override_rate == Rate::ZERO).collect();
    let rests = stood.iter().position(|period| period.rate == Rate::ZERO).expect("it comes to rest");
    assert!(stood[..rests].iter().all(|period| is_off(period) && period.rate == Rate::ONE), "it runs on");
    assert!(stood[rests..].iter().all(|period| period.rate == Rate::ZERO), "and rests where overrides apply again");
    assert!(stood.len() - rests > 2000, "until the operator starts it: {}", stood.len() - rests);

    // At an override of 0 the program does not begin with switching it off.
    let begins = format!("M49\n{PROGRAM}");
    let (_, log) = complete(&machine(60.0), &begins, "at 0s override 0%\nafter 2s override 60%\n");
    assert!(log.periods[..1990].iter().all(|period| period.place.record == RecordIndex::new(0)), "nothing moves");
}

/// A hold, a pause and a stop act at once where overrides are off.
#[test]
fn a_hold_acts_at_once() {
    let (_, log) = complete(&machine(60.0), PROGRAM, "at line 5 hold\nafter 2s resume\n");
    let held = log.event(|kind| matches!(kind, EventKind::Operator(retrace_controller::OperatorCommand::Hold)));
    let rest = log.periods.iter().find(|period| period.period > held.period && period.rate == Rate::ZERO);
    let rest = rest.expect("it rests");
    assert!(rest.period - held.period < 300 && rest.line == 5, "{rest:?}");
}

/// Codes that change nothing cost nothing: the very same run.
#[test]
fn switches_that_change_nothing_do_not_stop_the_path() {
    let rows = |between: &str| {
        let text = format!("G21 G64 P0.5 F1200\nG1 X20\n{between}\nX20 Y10\nM2\n");
        let (_, log) = complete(&machine(60.0), &text, "");
        log.periods.iter().map(|period| (period.place, period.counts)).collect::<Vec<_>>()
    };
    let plain = rows("");
    for same in ["M48", "M50 P1", "M49\nM48", "M50 P0\nM50", "M51 P0", "M53 P0", "M52 P0"] {
        assert!(rows(same) == plain, "{same}");
    }
    assert!(rows("M49").len() > plain.len(), "a switch is passed at rest");
}

/// Whatever the operator does with the overrides, where they are off the machine does what was planned.
#[test]
fn whatever_the_operator_overrides_the_program_runs_at_1_where_it_wants_to() {
    let machine = machine(60.0);
    let mut off_stretches = 0;
    for seed in 1..=30 {
        let mut random = Random::new(seed);
        let text = wired::program(&mut random, 24);
        let mut script = String::new();
        for _ in 0..6 {
            let (wait, rapid) = (f64::from(random.up_to(900)) / 1000.0, pick(&mut random, &["", "", "rapid "]));
            script += &format!("after {wait}s {rapid}override {}%\n", 10 + random.up_to(130));
        }
        let (_, plain) = complete(&machine, &text, "");
        let (_, log) = complete(&machine, &text, &script);
        let off = |log: &Log| {
            let off = moving(log).filter(|period| period.override_is_off);
            off.map(|period| (period.line, period.increments)).collect::<Vec<_>>()
        };
        assert!(off(&log) == off(&plain), "seed {seed}\n{text}\n{script}");
        assert_eq!(log.periods.last().map(|p| p.counts), plain.periods.last().map(|p| p.counts), "seed {seed}");
        off_stretches += log.count(|kind| *kind == EventKind::FeedOverrideSwitched(false));
    }
    assert!(off_stretches > 8, "{off_stretches}");
}
