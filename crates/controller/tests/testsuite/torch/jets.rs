//! A jet, which burns where the machine is at rest for a time, and may cut while the path is retraced.

use retrace_controller::{CutterOffReason, CutterState, EventKind, Outcome};
use retrace_core::Place;

use super::{Run, machine_text, parsed, run};

const JET: u8 = 3;
/// Line 5 is a cut of 60 mm in 2 s.
const PROGRAM: &str = "G21 G90 F1800\nG0 X10\nM64 P3\nG4 P0.3\nG1 X70\nM65 P3\nG0 X0\nM2\n";

/// A machine with a jet, which has more keys.
fn jet(more: &str, script: &str, program: &str) -> Run {
    let text = machine_text();
    let axes = &text[text.find("[[axis]]").expect("axes")..];
    let machine = parsed(&format!("[[cutter]]\nname = \"jet\"\nkind = \"jet\"\nfire = 3\n{more}{axes}"));
    run(&machine, program, "", script)
}

fn off(job: &Run, reason: CutterOffReason) -> usize {
    job.count(&EventKind::CutterOff { channel: JET, reason })
}

/// Going back, it is on where the operator has switched it on, up to where the program lit it.
#[test]
fn a_jet_that_may_cut_backward_is_switched_on_by_hand() {
    let script = "at line 5 override 100%\nafter 1s hold\nafter 0.4s reverse 50%\nafter 0.5s hold\n\
        after 0.5s cutter on\n\
        after 0.5s reverse 50%\nafter 5s leave\nafter 3s recover\n";
    let job = jet("retrace_cut = true\n", script, PROGRAM);
    assert_eq!(job.end.outcome, Outcome::Completed);
    assert_eq!(job.count(&EventKind::CutterOn(JET)), 1, "{:?}", job.rejections());
    let backward: Vec<Place> = job
        .periods
        .iter()
        .zip(&job.lit)
        .filter(|(p, lit)| **lit && p.rate.signum() < 0)
        .map(|(p, _)| p.place)
        .collect();
    assert!(backward.len() > 500, "{}", backward.len());
    let asked = job.events.iter().position(|event| event.kind == EventKind::CutterBoundary).expect("it asks");
    let lit_at = job.events.iter().find(|event| event.kind == EventKind::Switching("M64")).expect("lit").place;
    assert_eq!(job.events[asked].place, lit_at);
    assert_eq!(backward[backward.len() - 1], lit_at);
}

#[test]
fn a_jet_that_may_not_cut_backward_is_not_switched_on_there() {
    let script = "at line 5 override 100%\nafter 1s reverse 50%\nafter 1s cutter on\nafter 1s leave\n";
    let job = jet("", script, PROGRAM);
    let rejections = job.rejections();
    assert!(rejections.len() == 1 && rejections[0].contains("retrace_cut"), "{rejections:?}");
    assert_eq!((job.end.outcome.clone(), job.count(&EventKind::CutterOn(JET))), (Outcome::Completed, 0));
    assert_eq!(off(&job, CutterOffReason::Retrace), 1);
    job.assert_safe();
}

#[test]
fn a_program_that_forgets_its_jet_ends_with_the_jet_off() {
    let job = jet("", "", "G21 G90 F1800\nM64 P3\nG1 X20\nM2\n");
    assert_eq!((job.end.outcome.clone(), off(&job, CutterOffReason::ProgramEnd)), (Outcome::Completed, 1));
    job.assert_safe();
    let job = jet("", "at line 5 override 100%\nafter 0.5s stop\n", PROGRAM);
    assert_eq!((job.end.outcome.clone(), off(&job, CutterOffReason::JobStopped)), (Outcome::Stopped, 1));
    assert!(job.lit.contains(&true));
    job.assert_safe();
}

/// In a hold a jet burns for its grace; in a shorter one it burns on.
#[test]
fn a_jet_is_off_after_its_grace_at_rest() {
    let job = jet("", "at line 5 override 100%\nafter 0.3s hold\nafter 2s recover\n", PROGRAM);
    assert_eq!((job.end.outcome.clone(), job.ignitions().len()), (Outcome::Completed, 2));
    let states = job.states().into_iter().map(|(state, _)| state);
    let cuts = states.filter(|&state| state == CutterState::Cutting).count();
    assert_eq!(cuts, 2, "{:?}", job.states());
    let job = jet("", "at line 5 override 100%\nafter 0.3s hold\nafter 0.4s resume\n", PROGRAM);
    assert_eq!((job.end.outcome.clone(), job.ignitions().len()), (Outcome::Completed, 1));
}

/// *Cutter off* is immediate, and holds the program, also on the way to a contour: no M3 lights it until *resume*.
#[test]
fn cutter_off_holds_the_program() {
    let job = jet("", "at line 5 override 100%\nafter 0.3s cutter off\nafter 3s recover\n", PROGRAM);
    assert_eq!((job.end.outcome.clone(), off(&job, CutterOffReason::Operator)), (Outcome::Completed, 1));
    assert!(job.end.stats.held > 2000, "{:?}", job.end.stats);
    let job = jet("", "at line 2 cutter off\nafter 3s resume\n", PROGRAM);
    assert_eq!((job.end.outcome.clone(), job.ignitions().len()), (Outcome::Completed, 1));
    assert!(job.end.stats.held > 2000, "{:?}", job.end.stats);
    // as an output, too
    let job = jet("", "at line 5 override 100%\nafter 0.3s output 3 off\nafter 3s recover\n", PROGRAM);
    assert_eq!((job.end.outcome.clone(), off(&job, CutterOffReason::Operator)), (Outcome::Completed, 1));
}
