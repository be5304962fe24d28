//! A job from text on a simulated card in this process, and all its telemetry.
//!
//! Invariant: time is virtual, so that a run is the same at any speed.

use retrace_config::MachineConfig;
use retrace_controller::{
    CommandSources, Event, EventKind, JobEnd, JobOptions, JobStart, Observer, Outcome, PeriodRecord, RunMode,
    ScriptPlayer, Telemetry, parse_script, run_job,
};
use retrace_core::{Place, RecordIndex};
use retrace_hal_sim::{Clock, SimCard};
use retrace_journal::JournalConfig;
use retrace_link::channel;

pub(super) use crate::wired::{AXES, Decoder};

/// All telemetry of a run.
#[derive(Default)]
pub(super) struct Log {
    pub periods: Vec<PeriodRecord<AXES>>,
    /// The output of the spindle in each period.
    pub spindle: Vec<i32>,
    spindle_now: i32,
    pub events: Vec<Event>,
}

impl Observer<AXES> for Log {
    fn on_telemetry(&mut self, told: &Telemetry<AXES>) {
        match told {
            Telemetry::Period(period) => {
                self.periods.push(*period);
                self.spindle.push(self.spindle_now);
            }
            Telemetry::Output(change) if change.channel == channel::SPINDLE => self.spindle_now = change.value,
            Telemetry::Event(event) => self.events.push(event.clone()),
            Telemetry::Output(_) | Telemetry::Active(_) => {}
        }
        assert!(self.periods.len() < 1_000_000, "it hangs");
    }
}

impl Log {
    /// The first such event.
    pub(super) fn event(&self, what: impl Fn(&EventKind) -> bool) -> &Event {
        let found = self.events.iter().find(|event| what(&event.kind));
        found
            .unwrap_or_else(|| panic!("it is not among {:#?}", self.events.iter().map(Event::text).collect::<Vec<_>>()))
    }

    /// Number of such events.
    pub(super) fn count(&self, what: impl Fn(&EventKind) -> bool) -> usize {
        self.events.iter().filter(|event| what(&event.kind)).count()
    }
}

/// A machine with this many seconds of history, output 1 being the jet.
pub(super) fn machine(history_s: f64) -> MachineConfig {
    let jet = "[[cutter]]\nname = \"jet\"\nkind = \"jet\"\nfire = 1\nrapid_lit = true\n";
    let text = format!("history_hours = {}\n{jet}", history_s / 3600.0);
    MachineConfig::parse(&text, "test").expect("valid")
}

/// A card at record 0, all counts 0.
pub(super) fn card(machine: &MachineConfig) -> SimCard<AXES> {
    SimCard::new(RecordIndex::new(0), machine.rate_limits().expect("checked"), Clock::Virtual).expect("fits")
}

/// Options of a job with a script in virtual time.
pub(super) fn options(machine: &MachineConfig, script: &str, begin: JobStart, keeping: JournalConfig) -> JobOptions {
    let script = parse_script(script, "script").expect("a script");
    let operators = CommandSources::from_script(ScriptPlayer::new(script, machine.period_us));
    JobOptions {
        start: begin,
        commands: operators,
        run_mode: RunMode { wall_time: false, operator: true, real_time: false },
        journal: keeping,
    }
}

/// Runs a program from its beginning.
pub(super) fn run(machine: &MachineConfig, text: &str, script: &str) -> (JobEnd<SimCard<AXES>>, Log) {
    let mut log = Log::default();
    let options = options(machine, script, JobStart::First, JournalConfig::default());
    let end = run_job(machine, Decoder::new(text), options, card(machine), &mut log).expect("a job");
    (end, log)
}

/// A run from its beginning to its end.
pub(super) fn complete(machine: &MachineConfig, text: &str, script: &str) -> (JobEnd<SimCard<AXES>>, Log) {
    let (end, log) = run(machine, text, script);
    assert_eq!(end.outcome, Outcome::Completed);
    (end, log)
}

/// Place of a record boundary.
pub(super) fn boundary(record: u32) -> Place {
    Place::start_of(RecordIndex::new(record))
}
