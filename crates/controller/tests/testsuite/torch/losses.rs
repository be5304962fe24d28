//! An arc that is lost in the cut, and its recovery.

use retrace_controller::{
    CutterState, DifferingOutput, Event, EventKind, JobStart, OperatorCommand, Outcome, ResumePoint, ResumedCutEnd,
};
use retrace_core::{Place, Rate, RecordIndex};
use retrace_link::{CardStatus, MotionCard, PathStart};

use super::{FIRE, PROGRAM, PROOF, machine, run, run_part};
use CutterState::{Cutting, Igniting, Lost, Off, Piercing};

/// The end of the cut, the states, the figures of the report, and the part.
#[test]
fn a_lost_arc_is_recovered_where_it_was_lost() {
    let whole = run(&machine(), PROGRAM, "", "");
    let job = run(&machine(), PROGRAM, "lose@20", "at 3s recover\n");
    job.assert_part_of(&whole);
    job.assert_safe();
    let ends = job.picked(|kind| match *kind {
        EventKind::CutEnd { place, line, may_be_longer, .. } => Some((place, line, may_be_longer)),
        _ => None,
    });
    assert_eq!(ends.len(), 1);
    let (place, line, may_be_longer) = ends[0];
    let x_mm = whole.positions()[&place][0] as f64 / 200.0;
    assert!((x_mm - 30.0).abs() < 0.1 && line == 4 && !may_be_longer, "{x_mm} in line {line}");
    let first = [(Igniting, 0), (Piercing, 0), (Cutting, 1), (Lost, 1), (Igniting, 1), (Cutting, 1), (Off, 1)];
    let second = [(Igniting, 1), (Piercing, 1), (Cutting, 2), (Off, 2)];
    assert_eq!(job.states(), [&first[..], &second].concat());
    assert_eq!(job.contours(), [(1, 0.0), (2, 0.0)]);
    let stats = &job.end.stats;
    assert_eq!((stats.cut_interruptions, stats.contours, stats.contours_not_cut, stats.not_cut_um), (1, 2, 0, 0));
    assert_eq!(job.count(&EventKind::CutContinued), 1);
    assert_eq!(job.count(&EventKind::CutFromHere { moving: true }), 1);
}

/// The recovery begins before the place where the program switches the overrides off, which it has passed, on the path
/// and beside it: they are on again there, and are switched off once more.
#[test]
fn a_recovery_has_the_overrides_of_its_place() {
    let program = PROGRAM.replacen("G1 X70", "G1 X29.5\nM49\nG1 X50\nM48\nG1 X70", 1);
    let whole = run(&machine(), &program, "", "");
    for start in ["recover", "shift 3 -4\nafter 0.1s recover"] {
        let job = run(&machine(), &program, "lose@20", &format!("at 0s override 50%\nat 6s {start}\n"));
        job.assert_part_of(&whole);
        job.assert_safe();
        let switched = job.picked(|kind| if let EventKind::FeedOverrideSwitched(on) = kind { Some(*on) } else { None });
        assert_eq!(switched, [false, true, false, true], "{start}");
        let continued = job.events.iter().find(|event| event.kind == EventKind::CutContinued).expect("it is recovered");
        let mut at_one = 0;
        for period in job.periods.iter().filter(|period| period.period > continued.period && !period.off_path) {
            let is_off = period.line == 6;
            let is_right =
                if is_off { period.rate == Rate::ONE } else { period.line > 8 || period.rate <= Rate::ONE / 2 };
            assert!(is_right || period.at_rest, "{start}: {period:?}");
            at_one += u32::from(is_off);
        }
        assert!(at_one > 500, "{start}: {at_one}");
    }
}

#[test]
fn without_an_operator_a_lost_arc_ends_the_job() {
    let job = run(&machine(), PROGRAM, "lose@20", "");
    assert_eq!(job.end.outcome, Outcome::Stopped);
    assert_eq!((job.end.stats.contours, job.end.stats.contours_not_cut), (1, 1));
    job.assert_safe();
}

/// The torch counts as cutting only when its input proves it: not in the pilot arc of a start in motion.
#[test]
fn a_cutter_cuts_only_when_it_is_proven() {
    let job = run(&machine(), PROGRAM, "lose@20", "at 3s recover\n");
    let begins = job.events.iter().filter(|event| matches!(event.kind, EventKind::CutterState { state: Cutting, .. }));
    let begins: Vec<u64> = begins.map(|event| event.period).collect();
    assert_eq!(begins.len(), 3);
    for begin in begins {
        let period = job.periods.iter().find(|period| period.period == begin).expect("recorded");
        assert!(period.inputs >> PROOF & 1 == 1, "{period:?}");
    }
}

/// On the way back, while the outputs are restored, in the pilot arc, in the kerf, and beyond it.
#[test]
fn a_recovery_in_which_the_torch_is_put_out_begins_anew() {
    let whole = run(&machine(), PROGRAM, "", "");
    for after_s in [0.1, 0.8, 1.0, 1.2, 1.5] {
        for end in ["cutter off", "reverse 5%\nafter 0.5s hold"] {
            if end != "cutter off" && after_s >= 1.0 {
                // it cuts again, so that nothing is left to be recovered
                continue;
            }
            let script = format!("at 3s recover\nafter {after_s}s {end}\nafter 2s recover\n");
            let job = run(&machine(), PROGRAM, "lose@20", &script);
            job.assert_part_of(&whole);
            job.assert_safe();
        }
    }
}

/// From before the pierce the machine goes forward first, with the torch off; at the pierce and behind it, the cut is
/// continued in its kerf, in motion.
#[test]
fn a_cut_is_recovered_from_any_place_behind() {
    let whole = run(&machine(), PROGRAM, "", "");
    for left in ["back 30 mm", "back 25 mm", "back 30 mm\nafter 3s forward 5%\nafter 0.1s hold"] {
        let job = run(&machine(), PROGRAM, "lose@20", &format!("at 3s {left}\nafter 4s recover\n"));
        assert_eq!((job.rejections().len(), job.count(&EventKind::CutFromHere { moving: true })), (0, 1), "{left}");
        assert_eq!((&job.end.outcome, job.counts()), (&Outcome::Completed, whole.counts()), "{left}");
        job.assert_part_of(&whole);
        job.assert_safe();
    }
    // Held on the way, it goes on with the same word; the torch is lit at the end of its cut and nowhere else.
    let held = "at 3s back 30 mm\nafter 4s recover\nafter 0.1s hold\nafter 1s recover\n";
    let job = run(&machine(), PROGRAM, "lose@20", held);
    assert_eq!((&job.end.outcome, job.count(&EventKind::CutFromHere { moving: true })), (&Outcome::Completed, 1));
    job.assert_part_of(&whole);
    job.assert_safe();
    // Whoever takes the machine elsewhere on the way has ended the recovery: nothing is lit without a word.
    let left = "at 3s back 30 mm\nafter 4s recover\nafter 0.1s hold\nafter 1s leave ask\nafter 6s agree\n";
    let job = run(&machine(), PROGRAM, "lose@20", left);
    let period_of = |wanted: OperatorCommand| {
        let event = job.events.iter().find(|event| event.kind == EventKind::Operator(wanted));
        event.map(|event| event.period).expect("a command")
    };
    let waits = period_of(OperatorCommand::Leave { ask: true })..period_of(OperatorCommand::Confirm);
    let lit = job.periods.iter().zip(&job.lit).filter(|(period, lit)| **lit && waits.contains(&period.period));
    assert_eq!(lit.count(), 0);
    // What is ahead is not gone back to.
    let job = run(&machine(), PROGRAM, "lose@20", "at 3s back 30 mm\nafter 4s back to cut end\nafter 2s recover\n");
    assert!(
        job.rejections().len() == 1 && job.rejections()[0].contains("ahead of the machine"),
        "{:?}",
        job.rejections()
    );
    job.assert_part_of(&whole);
    let job = run(&machine(), PROGRAM, "lose@20", "at 3s back 30 mm\nafter 4s cut\n");
    // there is no metal any more where it pierces: what is cut is passed with the torch off, and the rest is cut
    assert_eq!((&job.end.outcome, job.counts()), (&Outcome::Completed, whole.counts()));
    assert_eq!(job.count(&EventKind::CutFromHere { moving: true }), 1);
    job.assert_part_of(&whole);
    job.assert_safe();
    for back in ["back to pierce", "back 10 mm"] {
        let job = run(&machine(), PROGRAM, "lose@20", &format!("at 3s {back}\nafter 4s recover\n"));
        assert_eq!((job.rejections().len(), job.count(&EventKind::CutFromHere { moving: true })), (0, 1), "{back}");
        job.assert_part_of(&whole);
        job.assert_safe();
    }
    let job = run(&machine(), PROGRAM, "lose@20", "at 3s back to cut end\nafter 2s cut pierce\n");
    assert_eq!(job.count(&EventKind::CutFromHere { moving: false }), 1);
}

#[test]
fn a_command_that_does_not_apply_is_answered() {
    let job = run(&machine(), PROGRAM, "", "at 0.5s cut\nafter 0s back to cut end\n");
    let reasons = job.rejections();
    assert_eq!(reasons.len(), 2, "{reasons:?}");
    assert!(reasons[0].contains("go back first") && reasons[1].contains("no cut was interrupted"), "{reasons:?}");
    assert_eq!(job.end.outcome, Outcome::Completed);
}

/// Whatever ends a start that has not succeeded: nothing is lit from then on.
#[test]
fn a_start_that_is_ended_by_hand_lights_nothing_any_more() {
    // 1.0 s: in the first attempt, 1.6 s: between two, 2.0 s: in the second one
    for at_s in [1.0, 1.6, 2.0] {
        for end in ["cutter off", "stop", "reverse 20%"] {
            let job = run(&machine(), PROGRAM, "no-start=1", &format!("at {at_s}s {end}\n"));
            let from = (at_s * 1000.0) as u64 + 5;
            let lit = job.periods.iter().zip(&job.lit).filter(|(period, lit)| period.period > from && **lit);
            assert_eq!(lit.count(), 0, "{end} at {at_s} s");
            assert_eq!(job.end.outcome, Outcome::Stopped);
            if end == "stop" {
                assert!(job.periods[job.periods.len() - 1].period < from + 100, "{end} at {at_s} s");
            }
        }
    }
}

/// A job is stopped with its cut interrupted, behind the end of the cut or after going back, and resumed: the machine
/// goes to the furthest place, and the cut is continued from where it ended.
#[test]
fn an_interrupted_cut_of_a_resumed_job_is_recovered() {
    let whole = run(&machine(), PROGRAM, "", "");
    for stopped in ["at 3s stop\n", "at 3s back 15 mm\nafter 3s stop\n"] {
        for recovered_after_s in [0.05, 4.0] {
            let first = run(&machine(), PROGRAM, "lose@20", stopped);
            assert_eq!(first.end.outcome, Outcome::Stopped);
            let place =
                first.picked(|kind| if let EventKind::CutEnd { place, .. } = *kind { Some(place) } else { None })[0];
            let CardStatus { place: at, reached, executed, .. } = *first.end.card.status();
            let cut_end =
                ResumedCutEnd { channel: FIRE, place, latest: place.record, is_interruption: true, is_exact: true };
            let start = PathStart { place: at, rests: false, reached, executed, keeps_state: false };
            let point = ResumePoint { cut_ends: vec![cut_end], ..ResumePoint::at(start, RecordIndex::new(0)) };
            let cut_before = first.cut_squares();
            let script = format!("after {recovered_after_s}s recover\n");
            let rest = run_part(&machine(), PROGRAM, &script, JobStart::At(Box::new(point)), first.end.card);
            assert_eq!((&rest.end.outcome, rest.counts()), (&Outcome::Completed, whole.counts()), "{stopped}");
            rest.assert_safe();
            let cut = rest.cut_squares();
            let missing: Vec<_> =
                whole.cut_squares().into_iter().filter(|at| !cut.contains(at) && !cut_before.contains(at)).collect();
            assert!(missing.is_empty(), "{missing:?} {stopped} {recovered_after_s}");
            assert_eq!(rest.count(&EventKind::CutFromHere { moving: true }), 1, "{stopped} {recovered_after_s}");
        }
    }
}

/// The host is killed, and the card plays on to the last records of the contour, which are shorter than anything that
/// an arc shows: the torch finds no metal up to there, and the contour is complete.
#[test]
fn a_kerf_that_ends_in_the_last_records_of_its_contour_is_complete() {
    let whole = run(&machine(), PROGRAM, "", "");
    let lit = |wanted: bool| move |&&is: &&bool| is == wanted;
    let begins = whole.lit.iter().position(|is| *is).expect("it is lit");
    let ends = begins + whole.lit[begins..].iter().take_while(lit(true)).count();
    let end = whole.periods[ends - 1].place.record;
    for before in [1, 4, 7] {
        // the instructions before the cut, and a sheet in which all of it is cut
        let CardStatus { executed, .. } = *run(&machine(), PROGRAM, "", "at 2s stop\n").end.card.status();
        let at = end - before;
        let rests = whole.periods.iter().rfind(|period| period.place == Place::start_of(at)).expect("a period");
        let back = format!("G21 G90 F1800\nG0 X10\nM3 S1\nG1 X70\nM5\nG0 X{}\nM2\n", rests.counts[0] as f64 / 200.0);
        let first = run(&machine(), &back, "", "");
        let place = Place::start_of(at - 900);
        let cut_end =
            ResumedCutEnd { channel: FIRE, place, latest: place.record, is_interruption: false, is_exact: false };
        let start = PathStart { place: Place::start_of(at), rests: false, reached: at, executed, keeps_state: false };
        let point = ResumePoint { cut_ends: vec![cut_end], ..ResumePoint::at(start, RecordIndex::new(0)) };
        let rest =
            run_part(&machine(), PROGRAM, "after 0.05s recover\n", JobStart::At(Box::new(point)), first.end.card);
        assert_eq!((&rest.end.outcome, rest.counts()), (&Outcome::Completed, whole.counts()), "{before}");
    }
}

/// The torch is put out by hand where it is out already: the cut still ends where it was lost.
#[test]
fn putting_out_a_lost_torch_does_not_move_the_end_of_its_cut() {
    let job = run(&machine(), PROGRAM, "lose@20", "at 3s cutter off\nafter 0.5s recover\n");
    job.assert_part_of(&run(&machine(), PROGRAM, "", ""));
    assert_eq!(job.end.stats.cut_interruptions, 1);
}

/// With `ask` the machine waits at the place where it cuts on, and names what switches each output there; nothing is
/// switched before the operator agrees (CUT-42).
#[test]
fn a_recovery_that_asks_switches_nothing_before_it_is_agreed_to() {
    let whole = run(&machine(), PROGRAM, "", "");
    let job = run(&machine(), PROGRAM, "lose@20", "at 3s back to cut end\nafter 2s cut ask\nafter 2s agree\n");
    job.assert_part_of(&whole);
    job.assert_safe();
    let of = |wanted: &dyn Fn(&EventKind) -> bool| {
        job.events.iter().find(|event| wanted(&event.kind)).map(|event| event.period).expect("an event")
    };
    let told = job.picked(|kind| match kind {
        EventKind::OutputsDiffer(some) => Some(some.list().to_vec()),
        _ => None,
    });
    let expected = DifferingOutput { code: "M3", line: 3, ..DifferingOutput::new(64, 0, 1) };
    assert_eq!(told, [vec![expected]]);
    let asked = of(&|kind| matches!(kind, EventKind::OutputsDiffer(_)));
    let agreed = of(&|kind| matches!(kind, EventKind::Operator(OperatorCommand::Confirm)));
    assert!(agreed >= asked + 1000, "{asked} {agreed}");
    let lit =
        job.periods.iter().zip(&job.lit).filter(|(period, lit)| **lit && (asked..agreed).contains(&period.period));
    assert_eq!(lit.count(), 0);
    assert_eq!(job.count(&EventKind::CutFromHere { moving: true }), 1);
    // Who goes elsewhere instead takes nothing of it along.
    let script = "at 3s back to cut end\nafter 2s cut ask\nafter 1s back 5 mm\nafter 2s recover\n";
    let job = run(&machine(), PROGRAM, "lose@20", script);
    job.assert_part_of(&whole);
    job.assert_safe();
}

#[test]
fn what_an_operator_has_held_lights_nothing_any_more() {
    assert_nothing_is_lit_behind("hold", OperatorCommand::Hold);
}

#[test]
fn what_an_operator_has_switched_off_is_not_lit_any_more() {
    assert_nothing_is_lit_behind("cutter off", OperatorCommand::CutterOff);
}

#[test]
fn what_an_operator_has_stopped_lights_nothing_any_more() {
    assert_nothing_is_lit_behind("stop", OperatorCommand::Stop);
}

/// Whenever a hold, *cutter off* or a stop comes behind a word that is to light the torch, even in the same control
/// period, the torch is lit by a new word only.
fn assert_nothing_is_lit_behind(word: &str, command: OperatorCommand) {
    let starts = [
        "at 3s recover\n",
        "at 3s back to cut end\nafter 2s cut\n",
        "at 3s back 30 mm\nafter 4s recover\n",
        "at 3s hold\nafter 1s reverse 50%\nafter 3s hold\nafter 1s cut\n",
        "at 3s back to contour 1\nafter 2s cut all\n",
        "at 3s back 30 mm\nafter 4s leave\n",
        "at 3s back 30 mm\nafter 4s leave ask\nafter 6s agree\n",
        "at 3s resume\nafter 1s agree\n",
        "at 3s skip contour\n",
    ];
    let mut lit_again = Vec::new();
    for start in starts {
        for delay_ms in [0, 1, 2, 3, 5, 10, 50, 150, 250, 400, 600, 900, 1300, 2000] {
            let script = format!("{start}after {:.3}s {word}\n", f64::from(delay_ms) / 1000.0);
            let job = run(&machine(), PROGRAM, "lose@20", &script);
            let given = job.events.iter().rfind(|event| event.kind == EventKind::Operator(command));
            let given = given.unwrap_or_else(|| panic!("{script}: {:?}", job.rejections())).period;
            let behind = job.periods.iter().zip(&job.lit).skip_while(|(period, _)| period.period <= given);
            let lit: Vec<bool> = behind.map(|(_, &lit)| lit).collect();
            if lit.windows(2).any(|pair| !pair[0] && pair[1]) {
                lit_again.push(script);
            }
        }
    }
    assert!(lit_again.is_empty(), "{lit_again:#?}");
}

/// A flicker of the contact that is no loss in a cut is none while a cutter that started in motion is proven either: it
/// was cut from where the contact closed first. What a flicker right before the loss hides is not known.
#[test]
fn a_flicker_while_the_arc_is_proven_leaves_nothing_that_is_not_cut() {
    let mut late = 0;
    for seed in 1..=150 {
        let faults = format!("lose@20,flicker-per-m=150,flicker-ms=5,seed={seed}");
        let job = run(&machine(), PROGRAM, &faults, "at 3s recover\n");
        let ends = job.events.iter().filter(|event| matches!(event.kind, EventKind::CutEnd { .. })).count();
        let proven = job.events.iter().find(|event| event.kind == EventKind::CutContinued);
        let (1, Some(proven)) = (ends, proven) else { continue };
        late += usize::from(proven.period > 4012);
        let not_cut_mm = job.events.iter().filter_map(|event| match event.kind {
            EventKind::NotCut(mm) => Some(mm),
            _ => None,
        });
        assert!(not_cut_mm.sum::<f64>() < 0.2, "{seed}");
    }
    assert!(late > 0, "no flicker");
}

/// The contact opens for longer than a flicker, and the arc burns until it is switched off: the arc of the recovery
/// finds metal only behind what that one has cut, which is not missing.
#[test]
fn what_an_arc_has_burnt_without_its_contact_is_cut() {
    let whole = run(&machine(), PROGRAM, "", "");
    let script: String = (1..40).map(|at| format!("at {}s recover\n", 3 * at)).collect();
    let mut losses = 0;
    for seed in 1..=20 {
        let job = run(&machine(), PROGRAM, &format!("flicker-per-m=20,flicker-ms=11,seed={seed}"), &script);
        assert_eq!((&job.end.outcome, job.counts()), (&Outcome::Completed, whole.counts()), "{seed}");
        job.assert_safe();
        losses += job.end.stats.cut_interruptions;
        let texts = || job.events.iter().map(Event::text).collect::<Vec<_>>();
        assert_eq!(job.contours(), [(1, 0.0), (2, 0.0)], "{seed}: {:#?}", texts());
        let not_cut = job.picked(|kind| if let EventKind::NotCut(mm) = kind { Some(*mm) } else { None });
        assert_eq!((job.end.stats.not_cut_um, not_cut), (0, vec![]), "{seed}");
    }
    assert!(losses > 20, "{losses}");
}
