//! The image of the Pico in its emulator against the card crate on this computer: both are given the same bytes, inputs
//! and counts of the handwheel before the same control periods, and the pins must do what that card orders.
//!
//! Invariant: what the image did is taken from its pins, period by period; its reports are not asked.

use std::fmt;

use retrace_card::spindle_pwm::{FULL, PwmSignal};
use retrace_card::{InputLevels, LinkedCard as Card, ProbeReading};
use retrace_config::MachineConfig;
use retrace_controller::{
    CommandSources, JobOptions, JobStart, Observer, RunMode, ScriptPlayer, Telemetry, parse_script, run_job,
};
use retrace_core::{Record, RecordIndex};
use retrace_hal_sim::Random;
use retrace_journal::JournalConfig;
use retrace_link::{
    CardIdentity, CardSettings, CardStatus, CommandRefusal, HostCommand, LinkTimeouts, LinkedCard, LinkedCardError,
    MotionCard, Outputs, PathStart, channel,
};
use serde_json::Value;

use crate::wired::{Decoder, Path, program, script};
use port::{AXES, Given, PicoPort, Surroundings};

mod port;

/// Sizes of the firmware's card (crates/firmware/src/lib.rs).
const WINDOW: usize = 1024;
const MEMORY: usize = 256;
const ENTRIES: usize = 256;
/// Periods after which the card has reported all counts of a handwheel at rest.
const PERIODS_TO_REPORT: usize = 60;
/// Periods in which a card comes to rest without a host.
const PERIODS_TO_REST: usize = 700;
/// A fast machine, up to the limit of the board, with a home switch at input 0, an emergency stop at input 1, and a
/// spindle whose speed is an output.
const FAST: &str = concat!(
    "homed = true\n",
    include_str!("../../../../firmware/emulated-pico.toml"),
    "home = { switch = \"lower\", position_mm = 0.0, search_mm_per_s = 50.0 }\n",
    "[[card.input]]\nnumber = 0\nuse = \"home\"\naxis = \"a\"\nactive_low = true\n",
    "[[card.input]]\nnumber = 1\nuse = \"emergency-stop\"\nactive_low = true\n",
    "[card.spindle_pwm]\nmax_s = 24000\n",
);
/// The cutter of the same machine as a laser, whose power is the output for S.
const LASER: &str = "[[cutter]]\nname = \"laser\"\nkind = \"beam\"\nfire = 64\npower = { least_percent = 5 }\n";

/// What was compared.
#[derive(Clone, Copy, Debug, Default)]
struct Compared {
    periods: usize,
    pulses: u64,
    /// Periods with pulses in which an axis moves backward along its path.
    backward: usize,
    late: u64,
    held: u64,
    /// Periods in which the output for S is neither low nor high all the time.
    modulated: usize,
    longest: u64,
    mean: u64,
}

impl Compared {
    fn add(&mut self, other: Self) {
        self.periods += other.periods;
        self.pulses += other.pulses;
        self.backward += other.backward;
        self.late += other.late;
        self.held += other.held;
        self.modulated += other.modulated;
        self.longest = self.longest.max(other.longest);
        self.mean = self.mean.max(other.mean);
    }
}

/// Step timing of settings, whose change is a period without pulses.
fn shape(settings: &CardSettings<AXES>) -> (u32, u16, u16, u16) {
    (settings.period_us, settings.pulse_ns, settings.direction_setup_ns, settings.direction_inverted)
}

fn laser() -> MachineConfig {
    let text = FAST.replace("max_s = 24000", "max_s = 1000") + LASER;
    MachineConfig::parse(&text, "laser").expect("valid")
}

/// Levels of the pins of outputs 0 … 3, spindle clockwise and counterclockwise, and coolant (docs/firmware.md).
fn output_levels(outputs: &Outputs) -> u16 {
    let [spindle, flood, mist] = [channel::SPINDLE, channel::FLOOD, channel::MIST].map(|c| outputs[usize::from(c)]);
    let on = [outputs[0] != 0, outputs[1] != 0, outputs[2] != 0, outputs[3] != 0];
    let levels = on.into_iter().chain([spindle > 0, spindle < 0, flood != 0 || mist != 0]);
    levels.enumerate().fold(0, |all, (n, is_high)| all | u16::from(is_high) << n)
}

/// Whether a cycle of the output for S has this duty cycle, within the processor's instructions.
fn is_duty([high, cycle]: [u64; 2], signal: Option<PwmSignal>) -> bool {
    let duty = signal.map_or(0.0, |signal| f64::from(signal.duty) / f64::from(FULL));
    (high as f64 / cycle as f64 - duty).abs() <= 0.0005
}

/// Gives a card what the image was given, and compares what it orders with the pins. `path`: where it has to be.
fn compare(
    identity: CardIdentity,
    given: &[Given],
    nets: &[[i64; AXES]],
    path: Option<&Path>,
) -> Result<Compared, String> {
    let records = vec![Record::ZERO; WINDOW].into_boxed_slice();
    let mut card = Card::<AXES, WINDOW, MEMORY, ENTRIES, Box<[Record<AXES>]>>::with_records(identity, records)
        .expect("the sizes of the image");
    let (mut timing, mut encoder) = ((1000, 2000, 5000, 0), 0u16);
    let (mut ordered, mut compared) = (0, Compared::default());
    // A cycle of the output for S that has ended has the duty cycle of one of the two periods before.
    let mut pwm = [None; 2];
    let mut check = |wanted: [i64; AXES], what: &dyn fmt::Debug| {
        ordered += 1;
        match nets.get(ordered - 1) {
            Some(net) if *net != wanted => Err(format!("{net:?} at the pins, not {wanted:?}: {what:?}")),
            // the last ones are under way
            _ => Ok(()),
        }
    };
    for (period, step) in given.iter().enumerate() {
        for &byte in &step.bytes {
            while card.process_command() {}
            card.receive_byte(byte);
        }
        while card.process_command() {}
        if let Some(wanted) = card.settings().map(|settings| shape(settings.settings()))
            && wanted != timing
        {
            timing = wanted;
            check([0; AXES], &"a change of the step timing")?;
        }
        encoder = encoder.wrapping_add_signed(step.steps);
        let status = *card.run_period(InputLevels {
            levels: step.inputs,
            encoder,
            failed: false,
            probe: ProbeReading { first_change: None, is_period_behind: true },
            ..InputLevels::default()
        });
        let pulses = card.card().pulses().map(i64::from);
        while card.transmit(&mut [0; 64]) > 0 {}
        check(pulses, &(period, &status))?;
        if step.outputs != output_levels(&status.outputs) {
            return Err(format!("period {period}: the outputs are {:#b}: {status:?}", step.outputs));
        }
        if !pwm.iter().any(|&signal| is_duty(step.pwm, signal)) {
            return Err(format!("period {period}: S is out for {:?} cycles, not {pwm:?}: {status:?}", step.pwm));
        }
        pwm = [pwm[1], card.card().spindle_pwm()];
        compared.modulated += usize::from(pwm[1].is_some_and(|signal| 0 < signal.duty && signal.duty < FULL));
        if path.is_some_and(|path| path.position(status.place) != status.counts) {
            return Err(format!("period {period}: off the path: {status:?}"));
        }
        compared.periods += 1;
        compared.pulses += pulses.iter().map(|pulses| pulses.unsigned_abs()).sum::<u64>();
        compared.backward += usize::from(status.rate.signum() < 0);
    }
    if ordered.abs_diff(nets.len()) > 2 || nets.len() > ordered {
        return Err(format!("{} periods at the pins, {ordered} ordered", nets.len()));
    }
    Ok(compared)
}

/// The card on the line, and the counts of the handwheel that it has reported.
struct Watched {
    card: Box<LinkedCard<AXES, PicoPort>>,
    turned: i64,
}

impl MotionCard<AXES> for Watched {
    type Fault = LinkedCardError<port::NoFault>;

    fn window(&self) -> u32 {
        MotionCard::window(&*self.card)
    }

    fn send(&mut self, command: HostCommand<AXES>) -> Result<(), CommandRefusal> {
        self.card.send(command)
    }

    fn run_period(&mut self) -> Result<&CardStatus<AXES>, Self::Fault> {
        self.turned += i64::from(self.card.run_period()?.wheel);
        Ok(self.card.status())
    }

    fn begin_path(&mut self, start: PathStart) -> Result<(), Self::Fault> {
        self.card.begin_path(start)
    }

    fn status(&self) -> &CardStatus<AXES> {
        self.card.status()
    }

    fn acknowledged_high(&self) -> RecordIndex {
        self.card.acknowledged_high()
    }
}

impl Watched {
    /// Whether the handwheel has turned as far as its pins have, once it is let go.
    fn check_turned(&mut self) -> Result<(), String> {
        self.card.port_mut().hand = None;
        for _ in 0..PERIODS_TO_REPORT {
            // an alarm is latched, or the host is dead: no more is reported
            if self.run_period().is_err() {
                return Ok(());
            }
        }
        let wanted: i64 = self.card.port().given.iter().map(|step| i64::from(step.steps)).sum();
        if wanted == self.turned {
            Ok(())
        } else {
            Err(format!("the handwheel has turned {}, not {wanted}", self.turned))
        }
    }
}

struct Ignore;

impl Observer<AXES> for Ignore {
    fn on_telemetry(&mut self, _: &Telemetry<AXES>) {}
}

/// Comes to rest, and compares.
fn finish(identity: CardIdentity, mut port: PicoPort, path: Option<&Path>) -> Result<Compared, String> {
    for _ in 0..PERIODS_TO_REST {
        port.step();
    }
    let (found, given, nets) = port.finish();
    let mut compared = compare(identity, &given, &nets, path)?;
    let number = |value: &Value| value.as_u64().expect("a number");
    compared.late = number(&found["late"]["motion"]);
    compared.held = number(&found["held"]);
    (compared.longest, compared.mean) = (number(&found["max_period"]), number(&found["mean_period"]));
    if found["wrong"] != 0 || found["lost_bytes"] != 0 || found["refused"] != 0 {
        return Err(format!("the emulator has found a fault: {found}"));
    }
    Ok(compared)
}

/// Runs a job on the image, and compares.
fn run(
    machine: &MachineConfig,
    text: &str,
    commands: &str,
    around: Surroundings,
    hand: Option<Random>,
) -> Result<Compared, String> {
    let path = Path::of(machine, text);
    let port = PicoPort::start(around);
    let mut card =
        Box::new(LinkedCard::<AXES, _>::connect(port, 7, LinkTimeouts::default()).map_err(|fault| fault.to_string())?);
    let identity = card.greeting().expect("it has answered").identity;
    card.open(machine.card_settings(PathStart::at(RecordIndex::new(0)))).map_err(|fault| fault.to_string())?;
    let script = parse_script(commands, "script").expect("a script");
    let options = JobOptions {
        start: JobStart::First,
        commands: CommandSources::from_script(ScriptPlayer::new(script, machine.period_us)),
        run_mode: RunMode { wall_time: false, operator: true, real_time: false },
        journal: JournalConfig::default(),
    };
    card.port_mut().hand = hand;
    let mut card = Watched { card, turned: 0 };
    let end = run_job(machine, Decoder::new(text), options, &mut card, &mut Ignore).expect("a job");
    println!("  {:?}", end.outcome);
    card.check_turned()?;
    finish(identity, card.card.into_port(), Some(&path))
}

/// Number of control periods, and the seed of the first job if `cargo xtask campaign pico` gives one.
fn asked(usual: usize) -> (usize, Option<u64>) {
    let number = |name: &str| std::env::var(name).ok()?.parse::<u64>().ok();
    (number("RETRACE_CASES").map_or(usual, |periods| periods as usize), number("RETRACE_FIRST_SEED"))
}

/// What is done to the card in one job.
fn surroundings(random: &mut Random) -> Surroundings {
    let period = |random: &mut Random| 300 + random.up_to(2000) as usize;
    let (mut trips_at, mut dies_at) = (None, None);
    match random.up_to(5) {
        0 => trips_at = Some(period(random)),
        1 => dies_at = Some(period(random)),
        _ => {}
    }
    Surroundings { switch: None, trips_at, dies_at }
}

#[test]
#[ignore = "needs the image and its emulator: cargo xtask firmware test, cargo xtask campaign pico"]
fn pins_of_random_jobs_are_those_of_the_simulator() {
    let (periods, seed) = asked(1000);
    let built_in = MachineConfig::built_in().expect("valid");
    let fast = MachineConfig::parse(FAST, "fast").expect("valid");
    let laser = laser();
    // The suite has short jobs. A seed of a campaign has the same job for any number of periods.
    let (first, moves) = seed.map_or((1, 4), |seed| (seed, 12));
    let (mut all, mut jobs) = (Compared::default(), 0);
    for seed in first.. {
        let mut random = Random::new(seed);
        // the board has outputs 0 … 3
        let text = program(&mut random, moves).replace(" P4\n", " P0\n").replace(" P5\n", " P1\n");
        let commands = script(&mut random);
        let s = random.up_to(30_000);
        let (machine, text) = match random.up_to(3) {
            0 => (&built_in, text),
            1 => (&laser, format!("S{}\n{}", s / 25, text.replace("M3\n", "M4\n"))),
            _ => (&fast, format!("S{s}\n{text}")),
        };
        let around = surroundings(&mut random);
        let hand = (random.up_to(1) == 0).then(|| Random::new(random.next()));
        let done = run(machine, &text, &commands, around.clone(), hand)
            .unwrap_or_else(|what| panic!("seed {seed}: {what}\n{text}\n{commands}\n{around:?}"));
        println!("seed {seed}: {done:?}");
        jobs += 1;
        all.add(done);
        if all.periods >= periods {
            break;
        }
    }
    println!("{jobs} jobs: {all:?}");
    assert!(all.late <= all.held, "a period was late in motion though nothing held it");
}

/// The power of a laser follows the speed at the pin, and is off in a hold.
#[test]
#[ignore = "needs the image and its emulator: cargo xtask firmware test, cargo xtask campaign pico"]
fn the_power_of_a_laser_is_at_its_pin() {
    let program = "S800\nG21 G90 G64 P0.05\nF1200\nM4\nG1 X3 Y1\nX1 Y3\nS300\nX4 Y4\nM5\nG0 X0 Y0\nM2\n";
    let commands = "at 0.35s hold\nafter 0.1s resume\n";
    let done = run(&laser(), program, commands, Surroundings::default(), None).expect("as the card crate has it");
    println!("laser: {done:?}");
    assert!(done.modulated > 300, "{done:?}");
}

/// The axis goes to its switch and off it, and its count is set where the switch opens, by the pins alone.
#[test]
#[ignore = "needs the image and its emulator: cargo xtask firmware test, cargo xtask campaign pico"]
fn homing_finds_the_switch_at_the_pins() {
    let machine = MachineConfig::parse(FAST, "fast").expect("valid");
    let (axis, at) = (3, -1500);
    let port = PicoPort::start(Surroundings { switch: Some((axis, at)), ..Surroundings::default() });
    let mut card = Box::new(LinkedCard::<AXES, _>::connect(port, 7, LinkTimeouts::default()).expect("it answers"));
    let identity = card.greeting().expect("it has answered").identity;
    card.open(machine.card_settings(PathStart::at(RecordIndex::new(0)))).expect("opened");
    card.send(HostCommand::Home(machine.homing(axis).expect("it has a switch"))).expect("accepted");
    let mut periods = 0;
    while periods < 20 || !card.status().at_rest {
        card.run_period().expect("it answers");
        periods += 1;
        assert!(periods < 10_000, "{:?}", card.status());
    }
    let counts = card.status().counts;
    let (positions, compared) = (card.port().positions(), finish(identity, card.into_port(), None));
    println!("homing: {:?}", compared.expect("as the simulator"));
    // 0 is where the switch opens: what the axis is away from it by its counts, it is by its pins, within what it moves
    // (6 pulses a period) until its pins are seen, the switch is set, and the axis has stopped
    let away = positions[axis] - at - counts[axis];
    assert!((0..=60).contains(&away), "{counts:?} after homing, {positions:?} at the pins");
}
