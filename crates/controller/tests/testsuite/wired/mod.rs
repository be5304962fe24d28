//! Whole jobs over a simulated serial line, in virtual time: text, planner, motion path, both endpoints, card, pins.
//!
//! Invariant: what the card did is taken from the card's own side, never from its reports to the host.
// each test file uses its part

use std::sync::{Arc, Mutex};

use retrace_config::MachineConfig;
use retrace_controller::{
    BlockDecoder, CommandSources, DecodedBlock, Event, EventKind, JobOptions, JobStart, LimitMonitor, LimitReport,
    MonitorLimits, Observer, Outcome, RunMode, ScriptPlayer, Telemetry, parse_script, run_job,
};
use retrace_core::playback::partial_increment;
use retrace_core::{Distance, Place, Rate, RecordIndex};
use retrace_gcode::{AxisSet, CanonStep, Program, Progress, Setup};
use retrace_hal_sim::{
    CardSimulator, CardSimulatorSettings, Clock, InFlightPolicy, InProcess, NoFault, Random, SerialChannelSettings,
    SimCard,
};
use retrace_journal::JournalConfig;
use retrace_link::{BytePort, CardStatus, LineCounts, LinkTimeouts, LinkedCard, MotionCard, Outputs, PathStart};

/// Axes of the card; the built-in machine uses three of them.
pub(crate) const AXES: usize = 4;

/// A program being decoded.
pub(crate) struct Decoder(Program<&'static [u8]>);

impl Decoder {
    /// A program from its text, which lives as long as the test.
    pub(crate) fn new(text: &str) -> Self {
        Self::with_setup(text, Setup { axes: AxisSet::XYZABC, ..Setup::default() })
    }

    /// As [`Decoder::new`], with another setup of the interpreter.
    pub(crate) fn with_setup(text: &str, setup: Setup) -> Self {
        Self(Program::new(text.to_owned().leak().as_bytes(), setup))
    }
}

impl BlockDecoder for Decoder {
    fn next_block(&mut self, steps: &mut Vec<CanonStep>) -> DecodedBlock {
        match self.0.advance(steps) {
            Progress::End => DecodedBlock::End,
            Progress::BlockError => DecodedBlock::BlockError(format!("{:?}", self.0.interpreter().diagnostics())),
            Progress::Line => DecodedBlock::Block,
        }
    }
}

/// The result of a program on a card without a link, at rate 1: the increments of every record, and what is switched
/// where.
#[derive(Clone, Debug, Default)]
pub(crate) struct Path {
    /// Counts before each record, and after the last.
    pub counts: Vec<[i64; AXES]>,
    /// Places of the exclusive instructions, in order.
    pub markers: Vec<u32>,
    /// Whether something is switched synchronously.
    pub in_passing: bool,
}

impl Path {
    /// Runs the program on a simulated card in this process.
    pub(crate) fn of(machine: &MachineConfig, text: &str) -> Self {
        struct Rows(Vec<[i64; AXES]>, Vec<u32>);
        impl Observer<AXES> for Rows {
            fn on_telemetry(&mut self, told: &Telemetry<AXES>) {
                match told {
                    Telemetry::Period(period) => {
                        assert_eq!(period.place.fraction, 0, "at rate 1 from record to record");
                        if period.place.record.number() as usize == self.0.len() {
                            self.0.push(period.counts);
                        }
                    }
                    Telemetry::Event(Event {
                        kind: EventKind::Switching(_) | EventKind::FeedOverrideSwitched(_),
                        place,
                        ..
                    }) => self.1.push(place.record.number()),
                    _ => {}
                }
            }
        }
        let mut rows = Rows(vec![[0; AXES]], Vec::new());
        let card = SimCard::<AXES>::new(RecordIndex::new(0), machine.rate_limits().expect("checked"), Clock::Virtual)
            .expect("fits");
        let run_mode = RunMode { wall_time: false, operator: false, real_time: false };
        let operators = CommandSources::from_script(ScriptPlayer::new(Vec::new(), machine.period_us));
        let options =
            JobOptions { start: JobStart::First, commands: operators, run_mode, journal: JournalConfig::default() };
        let end = run_job(machine, Decoder::new(text), options, card, &mut rows).expect("a job");
        assert_eq!(end.outcome, Outcome::Completed);
        Self { counts: rows.0, markers: rows.1, in_passing: text.contains("M62") || text.contains("M63") }
    }

    /// Position of the axes at a place: P(x).
    pub(crate) fn position(&self, place: Place) -> [i64; AXES] {
        let at = place.record.number() as usize;
        let mut counts = self.counts[at];
        if place.fraction != 0 {
            for (count, &next) in counts.iter_mut().zip(&self.counts[at + 1]) {
                *count += i64::from(partial_increment((next - *count) as i16, place.fraction));
            }
        }
        counts
    }
}

/// A control period of the card, as recorded on the card's own side.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Period {
    pub place: Place,
    pub rate: Rate,
    pub at_rest: bool,
    pub short: bool,
    pub counts: [i64; AXES],
    /// Counted at the pins.
    pub positions: [i64; AXES],
    pub executed: u32,
    pub outputs: Outputs,
    pub alarm: bool,
}

/// Everything the card did, while a job was open on it.
pub(crate) type CardLog = Arc<Mutex<Vec<Period>>>;

/// Records every control period of a simulator's card from now on.
pub(crate) fn watched(rig: &mut CardSimulator<AXES>) -> CardLog {
    let log = CardLog::default();
    let sink = Arc::clone(&log);
    rig.observe(Box::new(move |moment| {
        let s = moment.status;
        sink.lock().expect("one thread").push(Period {
            place: s.place,
            rate: s.rate,
            at_rest: s.at_rest,
            short: s.starved,
            counts: s.counts,
            positions: *moment.positions,
            executed: s.executed,
            outputs: s.outputs,
            alarm: s.alarm.is_some(),
        });
    }));
    log
}

/// A port to a simulator, with a cable that is pulled out at times.
pub(crate) struct Cable {
    pub port: InProcess<AXES>,
    /// Times, and what happens to the bytes in flight; the next one last.
    pub pulled: Vec<(u64, InFlightPolicy)>,
    /// All bytes that the host wrote, and that it read, if requested.
    pub taps: Option<[Vec<u8>; 2]>,
}

impl BytePort for Cable {
    type Fault = NoFault;

    fn now_us(&self) -> u64 {
        self.port.now_us()
    }
    fn writable_bytes(&mut self) -> usize {
        self.port.writable_bytes()
    }
    fn write(&mut self, bytes: &[u8]) -> Result<usize, NoFault> {
        let count = self.port.write(bytes)?;
        if let Some([written, _]) = &mut self.taps {
            written.extend(&bytes[..count]);
        }
        Ok(count)
    }
    fn read(&mut self, bytes: &mut [u8], wait_us: u32) -> Result<usize, NoFault> {
        while let Some(&(at_us, leftover)) = self.pulled.last()
            && at_us <= self.port.now_us()
        {
            self.port.simulator_mut().reconnect(leftover);
            self.pulled.pop();
        }
        let count = self.port.read(bytes, wait_us)?;
        if let Some([_, read]) = &mut self.taps {
            read.extend(&bytes[..count]);
        }
        Ok(count)
    }
}

/// A job, and the conditions under which it runs.
pub(crate) struct Trial<'a> {
    pub machine: &'a MachineConfig,
    pub program: &'a str,
    pub script: &'a str,
    pub rig: CardSimulatorSettings,
    pub pulled: Vec<(u64, InFlightPolicy)>,
    pub tapped: bool,
}

/// Results of a trial.
pub(crate) struct Done {
    pub outcome: Outcome,
    pub status: CardStatus<AXES>,
    pub log: Vec<Period>,
    pub line: LineCounts,
    pub cable: Cable,
    pub underruns: u64,
    pub violations: u64,
    pub first_violation: String,
    pub periods: u64,
    pub events: Vec<Event>,
}

impl Done {
    pub(crate) fn completed(&self) -> bool {
        self.outcome == Outcome::Completed
    }
}

struct Watch {
    periods: u64,
    events: Vec<Event>,
}

impl Observer<AXES> for Watch {
    fn on_telemetry(&mut self, told: &Telemetry<AXES>) {
        match told {
            Telemetry::Period(period) => {
                self.periods += 1;
                assert!(self.periods < 4_000_000, "it hangs: {period:?}");
            }
            Telemetry::Event(event) => self.events.push(event.clone()),
            Telemetry::Output(_) | Telemetry::Active(_) => {}
        }
    }
}

/// A limit monitor for a machine's limits.
pub(crate) fn judge(machine: &MachineConfig) -> LimitMonitor<AXES> {
    let axis = |i: usize| {
        let a = machine.axes.get(i).unwrap_or(&machine.axes[0]);
        MonitorLimits {
            pulses_per_mm: a.pulses_per_mm,
            velocity_mm_s: a.max_velocity_mm_per_s,
            acceleration_mm_s2: a.max_acceleration_mm_per_s2,
            jerk_mm_s3: a.max_jerk_mm_per_s3,
        }
    };
    LimitMonitor::new(&std::array::from_fn(axis), machine.period_s())
}

/// Checks the output of the card's pins against the limits.
fn judged(machine: &MachineConfig, log: &[Period]) -> LimitReport<AXES> {
    let mut judge = judge(machine);
    let mut before = [0; AXES];
    for period in log {
        let increments = std::array::from_fn(|axis| (period.positions[axis] - before[axis]) as i32);
        judge.push(&increments, period.rate);
        before = period.positions;
    }
    judge.finish()
}

/// Runs a job over a serial line. `Err`: no job was opened on the card, and why.
pub(crate) fn run(trial: Trial<'_>) -> Result<Done, String> {
    let mut rig = CardSimulator::<AXES>::new(&trial.rig).expect("a card");
    let log = watched(&mut rig);
    let mut pulled = trial.pulled;
    pulled.sort_by_key(|&(at_us, _)| std::cmp::Reverse(at_us));
    let taps = trial.tapped.then(Default::default);
    let cable = Cable { port: InProcess::new(rig), pulled, taps };
    let mut card = Box::new(LinkedCard::connect(cable, 7, LinkTimeouts::default()).map_err(|fault| fault.to_string())?);
    card.open(trial.machine.card_settings(PathStart::at(RecordIndex::new(0)))).map_err(|fault| fault.to_string())?;
    let mut watch = Watch { periods: 0, events: Vec::new() };
    let script = parse_script(trial.script, "script").expect("a script");
    let operators = CommandSources::from_script(ScriptPlayer::new(script, trial.machine.period_us));
    let run_mode = RunMode { wall_time: false, operator: true, real_time: false };
    let options =
        JobOptions { start: JobStart::First, commands: operators, run_mode, journal: JournalConfig::default() };
    let end = run_job(trial.machine, Decoder::new(trial.program), options, &mut *card, &mut watch).expect("a job");
    let (outcome, stats) = (end.outcome, end.stats);
    if outcome == Outcome::Completed {
        card.close().map_err(|fault| format!("not closed: {fault}"))?;
    }
    let (status, line) = (*card.status(), card.host().line_counts());
    let mut cable = card.into_port();
    // However the host ended: the card has time to come to rest by itself.
    let now_us = cable.port.simulator().now_us();
    cable.port.simulator_mut().run(now_us + 3_000_000);
    let log = std::mem::take(&mut *log.lock().expect("one thread"));
    let verdict = judged(trial.machine, &log);
    Ok(Done {
        outcome,
        status,
        log,
        line,
        cable,
        underruns: stats.underruns,
        violations: verdict.violations,
        first_violation: format!("{:?}", verdict.first),
        periods: watch.periods,
        events: watch.events,
    })
}

/// Checks the card's own side of a run: never a pulse off the path, and at rest at the end.
pub(crate) fn on_the_path(path: &Path, done: &Done) -> Result<(), String> {
    for period in &done.log {
        let expected = path.position(period.place);
        if period.counts != expected || period.positions != expected {
            return Err(format!("off the path {expected:?}: {period:?}"));
        }
    }
    let faults = done.cable.port.simulator().faults();
    if faults != Default::default() {
        return Err(format!("at the pins: {faults:?}"));
    }
    match done.log.last() {
        Some(last) if last.rate == Rate::ZERO && last.at_rest => Ok(()),
        last => Err(format!("it does not stand: {last:?}")),
    }
}

/// Checks the order in the card's own time: no motion goes beyond the first incomplete instruction, and what an
/// instruction switches is switched, and it is completed, at rest on its place.
pub(crate) fn in_order(markers: &[u32], log: &[Period]) -> Result<(), String> {
    let (mut executed, mut outputs) = (0, None);
    for period in log {
        let at = |number: u32| markers.get(number as usize - 1).map(|&place| Place::start_of(RecordIndex::new(place)));
        if period.executed != executed {
            if period.executed != executed + 1 || at(period.executed) != Some(period.place) || period.rate != Rate::ZERO
            {
                return Err(format!("instruction {} complete elsewhere: {period:?}", period.executed));
            }
            executed = period.executed;
        }
        if let Some(next) = at(executed + 1)
            && next.distance_to(period.place) > Distance::ZERO
        {
            return Err(format!("beyond instruction {}, which is not complete: {period:?}", executed + 1));
        }
        if outputs.is_some_and(|outputs| outputs != period.outputs) && period.rate != Rate::ZERO && !period.alarm {
            return Err(format!("switched in motion: {period:?}"));
        }
        outputs = Some(period.outputs);
    }
    Ok(())
}

/// Checks the end of a run: the program's exact counts, or a latched alarm with a known position.
pub(crate) fn ended_well(path: &Path, done: &Done) -> Result<(), String> {
    on_the_path(path, done)?;
    if !path.in_passing {
        in_order(&path.markers, &done.log)?;
    }
    let last = done.log.last().ok_or("the card did nothing")?;
    match &done.outcome {
        Outcome::Completed => {
            let end = path.counts.last().ok_or("no path")?;
            if last.counts != *end || done.status.counts != *end {
                return Err(format!(
                    "completed at {:?}, told {:?}, and not at {end:?}",
                    last.counts, done.status.counts
                ));
            }
            // An alarm may have been latched since: that the host, having finished, was silent.
            Ok(())
        }
        Outcome::Alarm(number, cause, _) => {
            // However it ended for the host, the card has latched an alarm by now: at least that the host was silent.
            last.alarm.then_some(()).ok_or(format!("{number} {cause}, and the card knows of none"))
        }
        other => Err(format!("{other:?}")),
    }
}

/// A serial line without faults, at a baud rate.
pub(crate) fn good_line(baud: u32) -> SerialChannelSettings {
    SerialChannelSettings { baud, latency_us: 100, ..SerialChannelSettings::default() }
}

/// A random element.
pub(crate) fn pick<T: Copy>(random: &mut Random, from: &[T]) -> T {
    from[random.up_to(from.len() as u32 - 1) as usize]
}

/// A program with this many moves, with arcs, dwells, instructions and output actions between.
pub(crate) fn program(random: &mut Random, moves: u32) -> String {
    use std::fmt::Write as _;
    let mut text = format!("G21 G90 G64 P0.05\nF{}\n", pick(random, &[600, 2400, 6000]));
    let mut at = [0.0f64; 2];
    for _ in 0..moves {
        let to = [0, 1].map(|_| f64::from(random.up_to(80)) / 10.0);
        let _ = match random.up_to(9) {
            0 => writeln!(text, "M{}", pick(random, &[3, 5, 7, 8, 9, 48, 49, 49])),
            1 => writeln!(text, "G4 P0.0{}", 1 + random.up_to(8)),
            2 => writeln!(text, "M6{} P{}", 2 + random.up_to(1), random.up_to(5)),
            3 if to != at => {
                let [i, j] = [(to[0] - at[0]) / 2.0, (to[1] - at[1]) / 2.0];
                let [x, y] = to;
                at = to;
                writeln!(text, "G{} X{x} Y{y} I{i} J{j}", 2 + random.up_to(1))
            }
            4 => writeln!(text, "G0 Z{}", random.up_to(3)),
            _ => {
                at = to;
                writeln!(text, "G1 X{} Y{}", to[0], to[1])
            }
        };
    }
    text.push_str("M2\n");
    text
}

/// An operator who holds, reverses and resumes.
pub(crate) fn script(random: &mut Random) -> String {
    let mut text = String::new();
    for _ in 0..random.up_to(4) {
        let wait = f64::from(10 + random.up_to(300)) / 1000.0;
        let (a, b) = (20 + random.up_to(80), f64::from(50 + random.up_to(400)) / 1000.0);
        text += &match random.up_to(4) {
            0 => format!("after {wait}s hold\nafter {b}s resume\n"),
            1 => format!("after {wait}s reverse {a}%\nafter {b}s leave\n"),
            2 => format!("after {wait}s reverse {a}%\nafter {b}s forward 50%\nafter {b}s leave\n"),
            3 => format!("after {wait}s override {a}%\n"),
            _ => format!("after {wait}s wheel -{a} for {b}s\nafter {b}s leave\n"),
        };
    }
    text
}
