//! The end of a program that is not released yet: the part is still clamped, and reverse run is possible.

use retrace_config::MachineConfig;
use retrace_controller::{EventKind, JobEnd, JobOptions, JobStart, Outcome, run_job};
use retrace_core::Rate;
use retrace_core::mode::Mode;
use retrace_hal_sim::SimCard;
use retrace_journal::{HoldReason, JournalConfig};
use retrace_link::MotionCard;

use super::jobs::{AXES, Decoder, Log, card, complete, machine, options};

const PROGRAM: &str = "G21 G90 F2400\nG1 X20\nG1 Y20\nM2\n";

/// Runs the program; the job ends only when the operator releases it.
fn unreleased(machine: &MachineConfig, script: &str) -> (JobEnd<SimCard<AXES>>, Log) {
    let options = options(machine, script, JobStart::First, JournalConfig::default());
    let options = JobOptions { commands: options.commands.with_release_at_end(), ..options };
    let mut log = Log::default();
    let end = run_job(machine, Decoder::new(PROGRAM), options, card(machine), &mut log).expect("a job");
    (end, log)
}

/// It waits at its end, also after a reverse run from there, and is complete when it is released.
#[test]
fn a_program_waits_at_its_end_until_it_is_released() {
    let machine = machine(600.0);
    let (plain, _) = complete(&machine, PROGRAM, "");
    for (script, back) in [("at 20s stop\n", false), ("at 6s reverse 100%\nafter 0.5s leave\nafter 4s stop\n", true)] {
        let (end, log) = unreleased(&machine, script);
        assert_eq!((end.outcome, end.card.status().counts), (Outcome::Completed, plain.card.status().counts));
        assert_eq!(log.count(|kind| *kind == EventKind::ProgramEnd), 1);
        let ended = log.event(|kind| *kind == EventKind::ProgramEnd).period;
        for period in log.periods.iter().filter(|period| period.period > ended) {
            let waits = period.hold_reason == HoldReason::Ended;
            assert_eq!(waits, period.mode == Mode::Run, "{period:?}");
        }
        let reverses = log.periods.iter().any(|period| period.rate < Rate::ZERO);
        assert_eq!(reverses, back);
        assert!(end.stats.held > 2000, "{:?}", end.stats);
    }
}

/// Stopped behind the end, wherever the machine is then, the job is complete.
#[test]
fn a_job_that_is_stopped_behind_its_end_is_complete() {
    let machine = machine(600.0);
    let script = "at 6s reverse 100%\nafter 0.5s stop\n";
    let (end, _) = unreleased(&machine, script);
    assert_eq!(end.outcome, Outcome::Completed);
    assert!(end.card.status().place.record.is_before(end.card.status().reached));
}
