//! Threads by programs on the simulated machine, judged by the true angle of the spindle and the counts of every
//! control period (SPN-6, SPN-8, SPN-13, SPN-17, SPN-18).

use retrace_config::MachineConfig;
use retrace_controller::{
    BlockDecoder, CommandSources, DecodedBlock, JobEnd, JobOptions, JobStart, Observer, Outcome, RunMode, ScriptPlayer,
    Telemetry, interpreter_setup, parse_script, run_job,
};
use retrace_core::RecordIndex;
use retrace_gcode::{CanonStep, Program, Progress};
use retrace_hal_sim::{Clock, PlantSettings, SimCard, SimCardError, SpindleSimulation};
use retrace_journal::JournalConfig;
use retrace_link::{CardStatus, CommandRefusal, GearState, HostCommand, MotionCard, PathStart, channel};

struct Decoder(Program<std::io::Cursor<Vec<u8>>>);

impl BlockDecoder for Decoder {
    fn next_block(&mut self, steps: &mut Vec<CanonStep>) -> DecodedBlock {
        match self.0.advance(steps) {
            Progress::Line => DecodedBlock::Block,
            Progress::End => DecodedBlock::End,
            Progress::BlockError => DecodedBlock::BlockError(format!("{:?}", self.0.interpreter().diagnostics())),
        }
    }
}

struct Silent;

impl Observer<2> for Silent {
    fn on_telemetry(&mut self, _: &Telemetry<2>) {}
}

/// A control period as a judge sees it.
#[derive(Clone, Copy, Debug)]
struct JudgedPeriod {
    counts: [i64; 2],
    /// True angle of the spindle at the end of the period, in turns.
    angle: f64,
    gear: GearState,
    speed: Option<i32>,
    commanded: [i32; 2],
}

/// A card that records every control period.
struct JudgedCard {
    card: SimCard<2>,
    periods: Vec<JudgedPeriod>,
}

impl MotionCard<2> for JudgedCard {
    type Fault = SimCardError;

    fn window(&self) -> u32 {
        self.card.window()
    }

    fn send(&mut self, command: HostCommand<2>) -> Result<(), CommandRefusal> {
        self.card.send(command)
    }

    fn run_period(&mut self) -> Result<&CardStatus<2>, SimCardError> {
        self.card.run_period()?;
        let angle = self.card.machine().spindle().expect("a spindle").angle();
        // The spindle is now where the period before this one ended.
        if let Some(last) = self.periods.last_mut() {
            last.angle = angle;
        }
        let status = self.card.status();
        let commanded = [channel::SPINDLE, channel::SPEED].map(|channel| status.outputs[usize::from(channel)]);
        let (gear, speed) = (status.spindle.gear, status.spindle.speed);
        self.periods.push(JudgedPeriod { counts: status.counts, angle, gear, speed, commanded });
        Ok(self.card.status())
    }

    fn begin_path(&mut self, start: PathStart) -> Result<(), SimCardError> {
        self.card.begin_path(start)
    }

    fn status(&self) -> &CardStatus<2> {
        self.card.status()
    }
}

fn lathe(spindle: &str) -> MachineConfig {
    let axis = |name: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = 1000\nmax_velocity_mm_per_s = \
             100\nmax_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-300, 300]\n"
        )
    };
    let text = format!("{}{}[spindle]\ncounts_per_turn = 400\nmax_rpm = 3000\n{spindle}\n", axis("x"), axis("z"));
    MachineConfig::parse(&text, "lathe").expect("valid")
}

const STEADY: SpindleSimulation = SpindleSimulation {
    counts_per_turn: 400,
    is_inverted: false,
    acceleration: 3000.0,
    coasting: 1500.0,
    swing: [0.0; 2],
    dips: [0.0; 3],
    ripple: 0.0,
    line_error: 0.0,
};

fn run(machine: &MachineConfig, spindle: SpindleSimulation, program: &str) -> JobEnd<JudgedCard> {
    run_with_script(machine, spindle, program, "")
}

fn run_with_script(
    machine: &MachineConfig,
    spindle: SpindleSimulation,
    program: &str,
    script: &str,
) -> JobEnd<JudgedCard> {
    let settings = machine.card_settings::<2>(PathStart::at(RecordIndex::new(0)));
    let plant = PlantSettings { spindle: Some(spindle), ..PlantSettings::default() };
    let card = SimCard::with_machine(settings, &plant, Clock::Virtual).expect("it opens");
    let card = JudgedCard { card, periods: Vec::new() };
    let program = std::io::Cursor::new(program.as_bytes().to_vec());
    let script = parse_script(script, "script").expect("a script");
    let run_mode = RunMode { wall_time: false, operator: !script.is_empty(), real_time: false };
    let operators = CommandSources::from_script(ScriptPlayer::new(script, machine.period_us));
    let options =
        JobOptions { start: JobStart::First, commands: operators, run_mode, journal: JournalConfig::default() };
    let decoder = Decoder(Program::new(program, interpreter_setup(machine)));
    run_job(machine, decoder, options, card, &mut Silent).expect("a job")
}

/// Phases of the helix, in turns from 0 up to 1, of every geared period with Z between these counts: how far the
/// spindle is ahead of where Z is on a thread of this pitch towards lower Z.
fn phases(periods: &[JudgedPeriod], z: [i64; 2], pitch: f64) -> Vec<f64> {
    let inside =
        |period: &&JudgedPeriod| period.gear == GearState::Engaged && (z[0]..=z[1]).contains(&period.counts[1]);
    periods
        .iter()
        .filter(inside)
        .map(|period| (period.angle + period.counts[1] as f64 / pitch).rem_euclid(1.0))
        .collect()
}

/// Least interval on the circle of a turn that has all phases, in turns.
fn spread(phases: &[f64]) -> f64 {
    let mut sorted = phases.to_vec();
    sorted.sort_by(f64::total_cmp);
    let ends = sorted.last().zip(sorted.first()).map_or(0.0, |(last, first)| first + 1.0 - last);
    let gap = sorted.windows(2).map(|pair| pair[1] - pair[0]).fold(ends, f64::max);
    1.0 - gap
}

const THREAD: &str = "G21 G18 G90 G8\nS1000 M3\nG0 X10 Z5\nG33 Z-20 K1.5\nG0 X12\nG0 Z5\nM5\nM2\n";

/// The thread begins after the spindle is at speed, is one helix through the start point at the index, and ends where
/// it was programmed.
#[test]
fn a_thread_lies_on_the_helix_through_its_start_point() {
    let end = run(&lathe(""), STEADY, THREAD);
    assert_eq!(end.outcome, Outcome::Completed);
    assert_eq!(end.card.status().counts, [12_000, 5_000]);
    let periods = &end.card.periods;
    let first = periods.iter().find(|period| period.gear == GearState::Engaged).expect("it is geared");
    assert!(first.speed.is_some_and(|speed| (speed - 1_000_000).abs() < 50_000), "{first:?}");
    // At Z5 the phase of the helix is 0: the index is at every whole turn.
    let phases = phases(periods, [-18_000, 3_000], 1500.0);
    let at_start = (5000.0f64 / 1500.0).rem_euclid(1.0);
    let off = phases.iter().map(|phase| {
        let off = (phase - at_start).rem_euclid(1.0);
        off.min(1.0 - off) * 1500.0
    });
    let worst = off.fold(0.0, f64::max);
    println!("a thread of K1.5 at S1000: at most {worst:.2} µm off its helix in {} periods", phases.len());
    assert!(phases.len() > 700 && worst <= 1.0 + 1500.0 / 400.0, "{worst}");
}

/// G33 Q: the second start of a thread with two lies half a turn from the first.
#[test]
fn a_start_angle_turns_the_helix() {
    let phase_of = |angle: &str| {
        let program = THREAD.replace("K1.5", &format!("K1.5 {angle}"));
        let end = run(&lathe(""), STEADY, &program);
        assert_eq!(end.outcome, Outcome::Completed);
        let phases = phases(&end.card.periods, [-18_000, 3_000], 1500.0);
        assert!(spread(&phases) * 1500.0 <= 2.0, "{angle}");
        phases[0]
    };
    let first = phase_of("");
    for (angle, turns) in [("Q180", 0.5), ("Q90", 0.25), ("Q-90", 0.75), ("Q720", 0.0)] {
        let off = (phase_of(angle) - first - turns).rem_euclid(1.0);
        assert!(off.min(1.0 - off) * 1500.0 < 5.0, "{angle}: {off}");
    }
}

/// Passes of a G76 at S, 0.8 S and 1.2 S, with swings, dips and ripple: all lie on one helix.
#[test]
fn all_passes_of_a_cycle_lie_on_one_helix_at_any_speed() {
    let loaded =
        SpindleSimulation { acceleration: 6000.0, swing: [0.05, 1.0], dips: [0.1, 0.15, 0.7], ripple: 0.005, ..STEADY };
    let mut all = Vec::new();
    for (n, rpm) in [800, 640, 960].into_iter().enumerate() {
        let cycle = "G76 P1.5 Z-25 I-1 J0.1 K0.92 R1.2 Q0 H5";
        let program = format!("G21 G18 G90 G8\nS{rpm} M3\nG0 X10 Z5\n{cycle}\nG0 X20 Z20\nM5\nM2\n");
        let spindle = SpindleSimulation { swing: [0.05, 1.0 + 0.3 * n as f64], ..loaded };
        let end = run(&lathe("at_speed_percent = 20"), spindle, &program);
        assert_eq!(end.outcome, Outcome::Completed, "S{rpm}");
        assert_eq!(end.card.status().counts, [20_000, 20_000]);
        let phases = phases(&end.card.periods, [-22_000, 2_000], 1500.0);
        let passes = end
            .card
            .periods
            .windows(2)
            .filter(|pair| pair[0].gear != GearState::Engaged && pair[1].gear == GearState::Engaged)
            .count();
        assert_eq!(passes, 20);
        println!("S{rpm}: {passes} passes, {} periods, spread {:.2} µm", phases.len(), spread(&phases) * 1500.0);
        all.extend(phases);
    }
    let spread = spread(&all) * 1500.0;
    println!("all passes together: {spread:.2} µm");
    assert!(spread <= 2.0 * (1.0 + 1500.0 / 400.0), "{spread}");
}

/// Consecutive threads are one stretch: the tool does not stop between them, and the second begins on the helix of the
/// first.
#[test]
fn consecutive_threads_are_one_stretch() {
    let program =
        "G21 G18 G90 G8 G64 P0.05\nS600 M3\nG0 X10 Z5\nG33 Z-20 K1.5\n(taper)\nG33 X11 Z-30 K2\nG0 X20\nM5\nM2\n";
    let end = run(&lathe(""), STEADY, program);
    assert_eq!(end.outcome, Outcome::Completed);
    let engaged: Vec<_> = end.card.periods.iter().filter(|period| period.gear == GearState::Engaged).collect();
    let stops = engaged
        .windows(2)
        .filter(|pair| pair[0].counts == pair[1].counts && (-29_900..4_900).contains(&pair[1].counts[1]));
    assert_eq!(stops.count(), 0);
    let begins = end
        .card
        .periods
        .windows(2)
        .filter(|pair| pair[0].gear != GearState::Engaged && pair[1].gear == GearState::Engaged);
    assert_eq!(begins.count(), 1);
    let spread = spread(&phases(&end.card.periods, [-18_000, 2_000], 1500.0)) * 1500.0;
    assert!(spread <= 2.0 + 1500.0 / 400.0, "{spread}");
}

/// A hold in a thread lets it finish; the operator's reverse run does not enter it.
#[test]
fn a_hold_in_a_thread_takes_effect_behind_it_and_nothing_runs_back_into_it() {
    let end = run_with_script(&lathe(""), STEADY, THREAD, "at 0.9s hold\nat 4s reverse 100%\nat 8s forward 100%\n");
    assert_eq!(end.outcome, Outcome::Completed);
    let periods = &end.card.periods;
    let at = |s: f64| periods[(s * 1000.0) as usize];
    assert_eq!(at(0.9).gear, GearState::Engaged);
    // held at the end of the thread, and there still while it is asked to run backward
    assert_eq!((at(3.9).counts, at(3.9).gear), ([10_000, -20_000], GearState::Off));
    assert_eq!(at(7.9).counts, [10_000, -20_000]);
    let spread = spread(&phases(periods, [-18_000, 3_000], 1500.0)) * 1500.0;
    assert!(spread <= 2.0 + 1500.0 / 400.0, "{spread}");
}

/// SPN-20: the feed override changes neither the pitch nor the speed of a thread, in either direction.
#[test]
fn no_override_of_the_feed_acts_in_a_thread() {
    let whole = run(&lathe(""), STEADY, THREAD);
    let geared =
        |end: &JobEnd<JudgedCard>| end.card.periods.iter().filter(|period| period.gear == GearState::Engaged).count();
    for percent in [40, 150] {
        let script = format!("at 0.1s override {percent}%\n");
        let end = run_with_script(&lathe(""), STEADY, THREAD, &script);
        assert_eq!((&end.outcome, end.card.status().counts), (&Outcome::Completed, [12_000, 5_000]));
        let spread = spread(&phases(&end.card.periods, [-18_000, 3_000], 1500.0)) * 1500.0;
        assert!(spread <= 2.0, "{percent} %: {spread}");
        assert!(geared(&end).abs_diff(geared(&whole)) <= 3, "{percent} %: {} {}", geared(&end), geared(&whole));
    }
}

/// SPN-6: no feed before the spindle is at speed, after its start, and after a change of S by more than 5 %.
#[test]
fn feed_waits_until_the_spindle_is_at_speed_and_rapids_do_not() {
    let slow = SpindleSimulation { acceleration: 600.0, ..STEADY };
    let program = "G21 G18 G90\nS600 M3\nG0 Z-10\nG1 Z-12 F600\nS620\nG1 Z-14\nS1200\nG1 Z-16\nG0 Z0\nM2\n";
    let end = run(&lathe(""), slow, program);
    assert_eq!(end.outcome, Outcome::Completed);
    let periods = &end.card.periods;
    let reached = |z: i64| periods.iter().position(|period| period.counts[1] <= z).expect("it gets there");
    // one second to 600, another to 1200; the rapid move needs 0.3 s
    assert!(reached(-9_900) < 500 && reached(-10_100) > 950, "{} {}", reached(-9_900), reached(-10_100));
    assert!(reached(-14_100) > reached(-13_900) + 800);
    for period in periods.iter().filter(|period| period.counts[1] < -10_010 && period.counts[1] > -15_990) {
        let [spindle, commanded] = period.commanded;
        let speed = period.speed.expect("measured");
        let is_before_wait = period.counts[1] == -14_000;
        assert!(spindle == 1 && (is_before_wait || (speed - commanded).abs() <= commanded * 6 / 100), "{period:?}");
    }
}

/// SPN-8: the feed per turn is never above its word, and a spindle that is braked brakes the feed.
#[test]
fn the_feed_per_turn_follows_the_measured_speed() {
    let dips = SpindleSimulation { acceleration: 6000.0, dips: [0.4, 1.5, 3.0], ..STEADY };
    let program = "G21 G18 G90\nS600 M3\nG0 Z0\nG95 F0.5\nG1 Z-40\nG94\nM5\nM2\n";
    let end = run(&lathe("at_speed_percent = 50"), dips, program);
    assert_eq!(end.outcome, Outcome::Completed);
    let cut: Vec<_> = end.card.periods.iter().filter(|period| (-39_000..-1_000).contains(&period.counts[1])).collect();
    // Over a fifth of a second each: a feed of 0.5 mm per turn, but for what the rate law is behind in a dip.
    let mut slowest = f64::INFINITY;
    for pair in cut.windows(200) {
        let (first, last) = (pair[0], pair[199]);
        let mm = (first.counts[1] - last.counts[1]) as f64 / 1000.0;
        let per_turn = mm / (last.angle - first.angle);
        assert!((0.42..0.53).contains(&per_turn), "{per_turn}");
        slowest = slowest.min(mm / 0.199);
    }
    assert!(slowest < 4.0, "{slowest}: the feed at full speed is 5 mm/s");
}
