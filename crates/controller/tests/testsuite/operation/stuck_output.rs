//! A card that goes on reporting an output on, although the job has switched it off.
//!
//! Invariant: the card is the simulated one; only its reports are changed.

use retrace_controller::{JobEnd, JobStart, Outcome, run_job};
use retrace_hal_sim::SimCard;
use retrace_journal::JournalConfig;
use retrace_link::{CardStatus, CommandRefusal, HostCommand, MotionCard, PathStart};

use super::jobs::{AXES, Decoder, Log, card, machine, options};

/// The channel of the jet.
const JET: usize = 1;

struct StuckOutput {
    card: SimCard<AXES>,
    status: CardStatus<AXES>,
}

impl StuckOutput {
    /// What it reports: once on, for ever on.
    fn report(&mut self) {
        let on = self.status.outputs[JET];
        self.status = *self.card.status();
        self.status.outputs[JET] = self.status.outputs[JET].max(on);
    }
}

impl MotionCard<AXES> for StuckOutput {
    type Fault = <SimCard<AXES> as MotionCard<AXES>>::Fault;

    fn window(&self) -> u32 {
        self.card.window()
    }
    fn send(&mut self, command: HostCommand<AXES>) -> Result<(), CommandRefusal> {
        self.card.send(command)
    }
    fn run_period(&mut self) -> Result<&CardStatus<AXES>, Self::Fault> {
        self.card.run_period()?;
        self.report();
        Ok(&self.status)
    }
    fn begin_path(&mut self, start: PathStart) -> Result<(), Self::Fault> {
        self.card.begin_path(start)?;
        self.report();
        Ok(())
    }
    fn status(&self) -> &CardStatus<AXES> {
        &self.status
    }
}

fn outcome(script: &str) -> Outcome {
    let machine = machine(60.0);
    let card = card(&machine);
    let card = StuckOutput { status: *card.status(), card };
    let program = "G21 F2400\nG1 X20\nM64 P1\nG1 X40\nM65 P1\nG1 X45\nM2\n";
    let options = options(&machine, script, JobStart::First, JournalConfig::default());
    let JobEnd { outcome, .. } =
        run_job(&machine, Decoder::new(program), options, card, &mut Log::default()).expect("a job");
    outcome
}

#[test]
fn a_cutting_output_that_is_reported_on_behind_the_end_is_an_alarm() {
    for script in ["", "at 0.2s stop\nafter 5s reverse 20%\n", "at 0.8s stop\n"] {
        let ended = outcome(script);
        let is_lit = !script.starts_with("at 0.2s");
        match ended {
            Outcome::Alarm("E3026", cause, _) => assert!(is_lit && cause.contains("jet"), "{script:?} {cause}"),
            other => assert!(!is_lit, "{script:?} {other:?}"),
        }
    }
}
