//! Threads on the simulated card, judged by the true angle of the spindle and the pulses alone (SPN-4, SPN-11 …
//! SPN-16).

use retrace_core::gear::GearLimits;
use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Distance, Flags, Rate, Record, RecordIndex};
use retrace_hal_sim::{Clock, PlantSettings, Random, SimCard, SimCardError, SpindleSimulation};
use retrace_link::{
    Alarm, CardSettings, GearStart, GearState, HostCommand, InputSetting, InputUse, Instruction, MAX_CHANGES,
    MotionCard, OutputChange, PathStart, RepeatedInstruction, SpindleControl, SpindleSettings, SpindleTask, channel,
};

mod kept_threads;
mod rearmed_threads;
mod retraced_threads;
mod taps;

const EMERGENCY_STOP: u8 = 13;

/// A thread on a machine with pulses of 1 µm: pitch in pulses, and commanded revolutions per minute.
#[derive(Clone, Copy)]
struct ThreadCase {
    period_us: u32,
    counts: u32,
    pitch: f64,
    rpm: f64,
    turns: u32,
}

const LATHE: SpindleSimulation = SpindleSimulation {
    counts_per_turn: 400,
    is_inverted: false,
    // The drive is stiffer than the load: what the speed does is the swing, the dips and the ripple.
    acceleration: 6000.0,
    coasting: 1500.0,
    swing: [0.2, 1.0],
    dips: [0.2, 0.15, 0.7],
    ripple: 0.005,
    line_error: 0.0,
};

struct Bench {
    card: SimCard<1>,
    case: ThreadCase,
    /// Increments of the stretch.
    increments: Vec<i16>,
    records_per_turn: u16,
    /// Records of the ramp at either end.
    ramp: usize,
    sent: u32,
    /// Whether the spindle turns counter-clockwise.
    is_left: bool,
}

impl Bench {
    fn new(case: ThreadCase, spindle: SpindleSimulation) -> Self {
        let period_s = f64::from(case.period_us) / 1e6;
        let axis = |v: f64, a: f64, j: f64| {
            let figure = |per_s: f64, power: i32| (per_s * 1000.0 * period_s.powi(power) * 4_294_967_296.0) as u64;
            PulseLimits { velocity: figure(v, 1), acceleration: figure(a, 2), jerk: figure(j, 3) }
        };
        let limits = axis(200.0, 1000.0, 20_000.0);
        let average = (limits.acceleration.div_ceil(limits.jerk) | 1) as u16;
        let limits = RateLimits::new(average, 58_983, [limits]).expect("valid");
        let start = PathStart::at(RecordIndex::new(0));
        let spindle_settings = SpindleSettings {
            counts_per_turn: case.counts,
            is_inverted: spindle.is_inverted,
            has_index: true,
            at_speed_permille: 300,
            at_speed_periods: (100_000 / case.period_us) as u16,
            timeout_periods: 10_000_000 / case.period_us,
            highest_speed: 4_000_000,
        };
        let mut settings =
            CardSettings { spindle: Some(spindle_settings), ..CardSettings::new(1, start, case.period_us, limits) };
        settings.inputs[usize::from(EMERGENCY_STOP)] =
            InputSetting { used_for: InputUse::EmergencyStop, active_low: false };
        let spindle = SpindleSimulation { counts_per_turn: case.counts, ..spindle };
        let plant = PlantSettings { spindle: Some(spindle), ..PlantSettings::default() };
        let card = SimCard::with_machine(settings, &plant, Clock::Virtual).expect("fits");
        // the plan's speed is a quarter above the commanded one
        let records_per_turn = (60.0 / (case.rpm * 1.25 * period_s)).floor();
        let per_record = case.pitch / records_per_turn;
        // a ramp at 700 mm/s² at most, like a sine
        let ramp =
            (per_record / (2.0 / std::f64::consts::PI * 700.0 * 1000.0 * period_s * period_s)).ceil().max(2.0) as usize;
        let straight = f64::from(case.turns) * records_per_turn;
        let length = 2 * ramp + straight as usize;
        let place = |n: usize| {
            let share = |n: f64| {
                (n - ramp as f64 / std::f64::consts::PI * (std::f64::consts::PI * n / ramp as f64).sin()) / 2.0
            };
            let n = n as f64;
            let end = length as f64;
            per_record
                * if n < ramp as f64 {
                    share(n)
                } else if n <= end - ramp as f64 {
                    n - ramp as f64 / 2.0
                } else {
                    end - ramp as f64 - share(end - n)
                }
        };
        let rounded = |n| place(n).round() as i64;
        let increments = (0..length).map(|n| (rounded(n + 1) - rounded(n)) as i16).collect();
        Self { card, case, increments, records_per_turn: records_per_turn as u16, ramp, sent: 0, is_left: false }
    }

    fn start(&self) -> GearStart {
        // The ramp takes half of its turns more than at full speed.
        let lead = self.ramp as f64 / 2.0 / f64::from(self.records_per_turn);
        let start_angle = ((-lead).rem_euclid(1.0) * 4_294_967_296.0) as u32;
        let per_record = self.case.pitch / f64::from(self.records_per_turn);
        let tolerance = Distance::from_units((20.0 / per_record * 4_294_967_296.0) as i64);
        let limits =
            GearLimits { rate: Rate::ONE * 105 / 100, near_end: Distance::records(self.ramp as i64), tolerance };
        let length = self.increments.len() as u32;
        GearStart {
            length,
            records_per_turn: self.records_per_turn,
            start_angle,
            ahead: 250,
            limits,
            ramp_share: 45_876,
            reverse_share: 0,
            control: SpindleControl::None,
        }
    }

    /// Starts the spindle, and arms the stretch.
    fn begin(&mut self, direction: i32) {
        self.begin_with(direction, self.start());
    }

    fn begin_with(&mut self, direction: i32, start: GearStart) {
        self.is_left = direction < 0;
        for (channel, value) in [(channel::SPINDLE, direction), (channel::SPEED, (self.case.rpm * 1000.0) as i32)] {
            self.card.send(HostCommand::ManualOutput(OutputChange { channel, value })).expect("a channel");
        }
        let spindle = Some(SpindleTask::Gear(start));
        let instruction = Instruction { number: 1, spindle, ..Instruction::default() };
        self.card.send(HostCommand::Instruction(instruction)).expect("at its place");
        self.card.send(HostCommand::rate(Rate::ONE)).expect("a rate");
    }

    fn send_records(&mut self) {
        while let Some(&increment) = self.increments.get(self.sent as usize) {
            let is_last = self.sent as usize + 1 == self.increments.len();
            let flags = Flags::GEARED.with(if is_last { Flags::REST } else { Flags::NONE });
            let record = Record { increments: [increment], flags, line: 1, ..Record::default() };
            if self.card.send(HostCommand::Ahead { place: RecordIndex::new(self.sent), record }).is_err() {
                break;
            }
            self.sent += 1;
        }
    }

    /// Runs a period; returns position and true angle at its end, after the next one has begun.
    fn period(&mut self) -> Result<(i64, f64), SimCardError> {
        if self.card.status().executed == 1 {
            // Records behind take the place of the last ones ahead.
            self.sent = self.card.status().high.number();
            self.send_records();
        }
        let before = self.card.status().counts[0];
        if let Err(fault) = self.card.run_period() {
            let rpm = self.card.machine().spindle().expect("a spindle").speed_rpm();
            println!("{fault:?} at {rpm:.1} rpm: {:?}", self.card.status());
            return Err(fault);
        }
        let angle = self.card.machine().spindle().expect("a spindle").angle();
        Ok((before, angle))
    }

    /// Error of the thread, in pulses: the largest distance from the one helix through the start at the index, where
    /// the records are at constant speed.
    fn thread_error(&mut self, direction: f64) -> f64 {
        let mut worst = 0.0f64;
        for _ in 0..60_000_000 / self.case.period_us {
            let place = self.card.status().place.record.number() as usize;
            let (z, angle) = self.period().expect("no alarm");
            if place >= self.ramp + 2 && place < self.increments.len() - self.ramp - 2 {
                let turns = z as f64 / self.case.pitch - direction * angle;
                worst = worst.max((turns - turns.round()).abs() * self.case.pitch);
            }
            if place == self.increments.len() {
                return worst;
            }
        }
        panic!("it does not end: {:?}", self.card.status());
    }
}

const CASE: ThreadCase = ThreadCase { period_us: 1000, counts: 400, pitch: 1500.0, rpm: 1000.0, turns: 100 };

/// Bound of the error in pulses of 1 µm: a pulse, a count, and what a parabola over 12 ms, or 8 ms where counts are
/// fine, leaves of the third derivative of the angle, foreseen by two periods.
fn error_bound(case: &ThreadCase) -> f64 {
    let (turns_per_s, turn) = (case.rpm / 60.0, std::f64::consts::TAU);
    let [swing, dips] =
        [LATHE.swing[0] * (turn * LATHE.swing[1]).powi(2), LATHE.dips[0] / 2.0 * (turn / LATHE.dips[1]).powi(2)];
    let ripple = LATHE.ripple * (turn * turns_per_s).powi(2);
    let third = turns_per_s * (swing + dips + ripple);
    let half_fit: f64 = if case.counts > 1000 { 0.004 } else { 0.006 };
    let y = 2.0 * f64::from(case.period_us) / 1e6 + half_fit;
    let left = case.pitch * third / 6.0 * (y.powi(3) - 0.6 * half_fit.powi(2) * y);
    1.0 + case.pitch / f64::from(case.counts) + left
}

/// The acceptance row: 100 turns, spindle ± 20 % at 1 Hz with dips by 20 % in 150 ms.
#[test]
fn a_thread_is_one_helix_whatever_the_spindle_does() {
    for period_us in [1000, 2000, 5000] {
        for counts in [100, 400, 4096] {
            for (pitch, direction) in [(1500.0, 1), (500.0, -1), (3000.0, 1)] {
                let rpm = if pitch > 2000.0 { 600.0 } else { 1000.0 };
                let case = ThreadCase { period_us, counts, pitch, rpm, ..CASE };
                let mut bench = Bench::new(case, SpindleSimulation { is_inverted: pitch < 1000.0, ..LATHE });
                bench.begin(direction);
                let error = bench.thread_error(f64::from(direction));
                let lag = f64::from(bench.card.status().spindle.largest_lag) / 65_536.0 * pitch
                    / f64::from(bench.records_per_turn);
                let bound = error_bound(&case);
                println!(
                    "T {period_us} µs, C {counts}, K {pitch} µm: error {error:.2} µm of {bound:.2}, lag {lag:.2} µm"
                );
                assert!(error <= bound, "T {period_us} C {counts} K {pitch}: {error} > {bound}");
                let pulses = if period_us > 2000 { 3.0 } else { 1.0 };
                let short = pulses + pitch / f64::from(counts);
                assert!(error <= short || pitch > 1500.0, "T {period_us} C {counts} K {pitch}: {error} > {short}");
                assert_eq!(bench.card.status().counts[0], bench.increments.iter().map(|&n| i64::from(n)).sum::<i64>());
                assert_eq!(bench.card.status().spindle.gear, GearState::Off);
            }
        }
    }
}

/// An encoder whose edges are off by up to a tenth of a count: the error of the thread stays within a count more.
#[test]
fn edges_that_are_off_do_not_spoil_a_thread() {
    for period_us in [1000, 2000, 5000] {
        for counts in [100, 400, 4096] {
            let case = ThreadCase { period_us, counts, turns: 30, ..CASE };
            let mut bench = Bench::new(case, SpindleSimulation { line_error: 0.1, ..LATHE });
            bench.begin(1);
            let (error, count) = (bench.thread_error(1.0), case.pitch / f64::from(counts));
            println!("T {period_us} µs, C {counts}: error {error:.2} µm, a count is {count:.2} µm");
            assert!(error <= error_bound(&case) + count, "T {period_us} C {counts}: {error}");
        }
    }
}

/// A steady spindle that coasts.
const STEADY: SpindleSimulation =
    SpindleSimulation { swing: [0.0; 2], dips: [0.0; 3], ripple: 0.0, acceleration: 3000.0, ..LATHE };

impl Bench {
    /// Runs until the cursor is `turns` turns in the stretch.
    fn run_into(&mut self, turns: f64) {
        let place = (turns * f64::from(self.records_per_turn)) as u32;
        for _ in 0..60_000 {
            self.period().expect("no alarm");
            if self.card.status().place.record.number() >= place {
                return;
            }
        }
        panic!("it does not begin: {:?}", self.card.status());
    }

    fn switch_spindle(&mut self, value: i32) {
        let change = OutputChange { channel: channel::SPINDLE, value };
        self.card.send(HostCommand::ManualOutput(change)).expect("a channel");
    }

    /// Sum of the records before the place of the cursor, rounded as the playback does.
    fn position_of_place(&self) -> f64 {
        let place = self.card.status().place;
        let whole: i64 = self.increments[..place.record.number() as usize].iter().map(|&n| i64::from(n)).sum();
        let under = self.increments.get(place.record.number() as usize).copied().unwrap_or(0);
        whole as f64 + f64::from(under) * place.fraction_of_record()
    }

    /// Runs until the machine is at rest, and checks in every period that the counts are those of the place and lie on
    /// the helix within `most` pulses.
    fn run_to_rest(&mut self, most: f64) {
        for _ in 0..60_000 {
            let place = self.card.status().place.record.number() as usize;
            let (z, angle) = match self.period() {
                Ok(period) => period,
                Err(_) => return,
            };
            assert!((self.card.status().counts[0] as f64 - self.position_of_place()).abs() <= 0.51);
            if place > self.ramp + 2 && place + self.ramp + 2 < self.increments.len() {
                let turns = z as f64 / self.case.pitch - angle;
                assert!((turns - turns.round()).abs() * self.case.pitch <= most, "{place} {turns}");
            }
            if self.card.status().at_rest {
                return;
            }
        }
        panic!("it does not come to rest: {:?}", self.card.status());
    }
}

/// SPN-16: an alarm in a stretch switches the spindle off, and the axes follow it along the helix until it rests.
/// Turned by hand then, it moves nothing.
#[test]
fn the_brake_is_the_spindle_and_a_spindle_at_rest_moves_nothing() {
    let mut bench = Bench::new(CASE, STEADY);
    bench.begin(1);
    bench.run_into(30.0);
    let before = bench.card.status().counts[0];
    bench.switch_spindle(0);
    bench.run_to_rest(1.0 + 1500.0 / 400.0);
    let stopped = bench.card.status().counts[0];
    assert!(stopped > before + 1500 && stopped < before + 12_000, "{before} {stopped}");
    assert_eq!(bench.card.status().spindle.gear, GearState::Engaged);
    for turns in [1.5, -2.5] {
        bench.card.machine().spindle().expect("a spindle").turn_by_hand(turns);
        for _ in 0..6000 {
            bench.period().expect("no alarm");
            assert_eq!(bench.card.status().counts[0], stopped, "turned by hand");
        }
    }
    // Switched on again at another angle, it does not take the tool along.
    bench.switch_spindle(1);
    let alarm = (0..3000).find_map(|_| bench.period().err());
    assert_eq!(alarm, Some(SimCardError::Alarm(Alarm::ThreadLost)));
    for _ in 0..3000 {
        let _ = bench.period();
    }
    assert_eq!(bench.card.status().counts[0], stopped, "switched on at another angle");
}

/// A restart that switches the spindle on, or changes its speed, is complete once it is at speed; nothing moves before
/// (SPN-6). A spindle that does not come to its speed is an alarm.
#[test]
fn a_restart_waits_for_the_speed_of_the_spindle() {
    let (spindle, speed) = ((channel::SPINDLE, 1), (channel::SPEED, 1_000_000));
    for (first, repeated, is_stalled) in
        [(speed, spindle, false), (spindle, speed, false), (speed, spindle, true), (spindle, speed, true)]
    {
        let mut bench = Bench::new(CASE, STEADY);
        let change = |(channel, value): (u8, i32)| OutputChange { channel, value };
        bench.card.send(HostCommand::ManualOutput(change(first))).expect("a channel");
        bench.card.run_period().expect("no alarm");
        bench.card.machine().spindle().expect("a spindle").set_stalled(is_stalled);
        for number in 0..200 {
            let (place, record) = (RecordIndex::new(number), Record { increments: [1], ..Record::default() });
            bench.card.send(HostCommand::Ahead { place, record }).expect("there is room");
        }
        bench.card.send(HostCommand::Restart { last: 1 }).expect("at rest");
        let mut changes = [OutputChange::default(); MAX_CHANGES];
        changes[0] = change(repeated);
        let repeat = RepeatedInstruction { number: 1, changes, count: 1, ..RepeatedInstruction::default() };
        bench.card.send(HostCommand::Repeat(repeat)).expect("the next one");
        bench.card.send(HostCommand::rate(Rate::ONE)).expect("a rate");
        let mut periods = 0;
        let alarm = loop {
            if let Err(alarm) = bench.card.run_period() {
                break Some(alarm);
            }
            if bench.card.status().counts[0] > 0 {
                break None;
            }
            periods += 1;
            assert!(periods < 20_000, "neither an alarm nor motion");
        };
        let rpm = bench.card.machine().spindle().expect("a spindle").speed_rpm();
        if is_stalled {
            assert_eq!(alarm, Some(SimCardError::Alarm(Alarm::NotAtSpeed)));
            assert_eq!(bench.card.status().counts[0], 0);
        } else {
            // 30 % of 1000 turns a minute are allowed, for 0.1 s.
            assert!(alarm.is_none() && rpm > 700.0 && periods > 100, "{alarm:?} {rpm} {periods}");
        }
    }
}

/// After an alarm that was cleared, a spindle that is switched on moves no axis.
#[test]
fn a_stretch_that_an_alarm_has_ended_does_not_go_on() {
    let mut bench = Bench::new(CASE, STEADY);
    bench.begin(1);
    bench.run_into(20.0);
    bench.card.machine().spindle().expect("a spindle").set_load(-0.6, 300_000);
    let alarm = (0..2000).find_map(|_| bench.period().err());
    assert_eq!(alarm, Some(SimCardError::Alarm(Alarm::ThreadLost)));
    for _ in 0..3000 {
        let _ = bench.period();
    }
    let stopped = bench.card.status().counts[0];
    bench.card.send(HostCommand::ClearAlarm).expect("its cause is gone");
    bench.switch_spindle(1);
    for _ in 0..3000 {
        bench.period().expect("no alarm");
        assert_eq!(bench.card.status().counts[0], stopped, "it goes on by itself");
    }
}

/// The spindle the other way: the same helix back to the beginning, with a net sum of zero, and forward again.
#[test]
fn a_reversed_spindle_brings_the_tool_back_on_the_helix() {
    let mut bench = Bench::new(CASE, STEADY);
    bench.begin(1);
    bench.run_into(8.0);
    bench.switch_spindle(-1);
    let mut deepest = 0;
    for _ in 0..20_000 {
        bench.period().expect("no alarm");
        assert!((bench.card.status().counts[0] as f64 - bench.position_of_place()).abs() <= 0.51);
        deepest = deepest.max(bench.card.status().counts[0]);
        if bench.card.status().spindle.gear == GearState::Waiting {
            break;
        }
    }
    let status = bench.card.status();
    assert_eq!((status.counts[0], status.place.record.number(), status.at_rest), (0, 0, true));
    assert!(deepest > 12_000, "{deepest}");
    bench.switch_spindle(1);
    let error = bench.thread_error(1.0);
    assert!(error <= 1.0 + 1500.0 / 400.0, "{error}");
}

/// What the machine must not do: begin while it is held, or without an index, or with records that nobody has geared.
#[test]
fn a_stretch_begins_only_at_its_angle_with_a_rate_and_an_index() {
    let mut bench = Bench::new(CASE, STEADY);
    let record = Record { increments: [1], flags: Flags::GEARED, ..Record::default() };
    bench.card.send(HostCommand::Ahead { place: RecordIndex::new(0), record }).expect_err("not geared");
    bench.begin(1);
    bench.card.send(HostCommand::rate(Rate::ZERO)).expect("a rate");
    for _ in 0..3000 {
        bench.period().expect("no alarm");
    }
    assert_eq!((bench.card.status().counts[0], bench.card.status().executed), (0, 0), "held");
    bench.card.send(HostCommand::rate(Rate::ONE)).expect("a rate");
    while bench.card.status().spindle.gear != GearState::Waiting {
        bench.period().expect("no alarm");
    }
    // Held while the angle is awaited: it comes round several times.
    bench.card.send(HostCommand::rate(Rate::ZERO)).expect("a rate");
    for _ in 0..500 {
        bench.period().expect("no alarm");
    }
    assert_eq!((bench.card.status().counts[0], bench.card.status().spindle.gear), (0, GearState::Waiting));
    bench.card.send(HostCommand::rate(Rate::ONE)).expect("a rate");
    assert!(bench.thread_error(1.0) <= 1.0 + 1500.0 / 400.0);
    let mut bench = Bench::new(CASE, STEADY);
    bench.card.machine().spindle().expect("a spindle").lose_index();
    bench.begin(1);
    let alarm = (0..12_000).find_map(|_| bench.period().err());
    assert_eq!((alarm, bench.card.status().counts[0]), (Some(SimCardError::Alarm(Alarm::NotAtSpeed)), 0));
}

/// A fault of the encoder or the spindle.
#[derive(Clone, Copy, Debug)]
enum SpindleFault {
    Dead,
    WrongCounts(i64),
    NoIndex,
    Stalled,
    TooFast(f64),
}

/// Runs a short thread into a fault. Returns the alarm, and the turns that the spindle then made until it came.
fn faulty_run(random: &mut Random, fault: SpindleFault) -> (Option<Alarm>, f64) {
    let mut bench = Bench::new(ThreadCase { turns: 12, ..CASE }, STEADY);
    bench.begin(1);
    bench.run_into(2.0 + f64::from(random.up_to(6000)) / 1000.0);
    let spindle = bench.card.machine().spindle().expect("a spindle");
    let from = spindle.angle();
    match fault {
        SpindleFault::Dead => spindle.kill_encoder(),
        SpindleFault::WrongCounts(counts) => spindle.add_wrong_counts(counts),
        SpindleFault::NoIndex => spindle.lose_index(),
        SpindleFault::Stalled => spindle.set_stalled(true),
        SpindleFault::TooFast(by) => spindle.set_load(-by, 60_000_000),
    }
    for _ in 0..4000 {
        let was = bench.card.machine().spindle().expect("a spindle").angle();
        if let Err(SimCardError::Alarm(alarm)) = bench.period() {
            return (Some(alarm), was - from);
        }
        if let Some(alarm) = bench.card.status().alarm {
            return (Some(alarm), was - from);
        }
        if bench.card.status().spindle.gear == GearState::Off {
            break;
        }
    }
    (None, 0.0)
}

/// Every fault is an alarm, within 1.2 turns where counts are lost, and the spindle is off then.
#[test]
fn no_fault_of_the_encoder_is_silent() {
    let number = |name: &str, usual: u64| std::env::var(name).ok().and_then(|n| n.parse().ok()).unwrap_or(usual);
    let (cases, first) = (number("RETRACE_CASES", 60), number("RETRACE_FIRST_SEED", 1));
    for case in 0..cases {
        let mut random = Random::new(first + case);
        let wrong = 3 + i64::from(random.up_to(150));
        let counts = if random.up_to(1) == 0 { wrong } else { -wrong };
        for fault in [
            SpindleFault::Dead,
            SpindleFault::WrongCounts(counts),
            SpindleFault::NoIndex,
            SpindleFault::Stalled,
            SpindleFault::TooFast(0.5 + f64::from(random.up_to(300)) / 1000.0),
        ] {
            let (alarm, turns) = faulty_run(&mut random, fault);
            let (expected, most) = match fault {
                SpindleFault::Dead => (&[Alarm::EncoderFailed][..], 1.3),
                SpindleFault::WrongCounts(_) => (&[Alarm::EncoderFailed, Alarm::ThreadLost][..], 1.3),
                SpindleFault::NoIndex => (&[Alarm::EncoderFailed][..], 2.3),
                SpindleFault::Stalled => (&[Alarm::EncoderFailed, Alarm::SpindleStalled, Alarm::ThreadLost][..], 0.1),
                SpindleFault::TooFast(_) => (&[Alarm::ThreadLost][..], 6.0),
            };
            let seed = first + case;
            assert!(alarm.is_some_and(|alarm| expected.contains(&alarm)), "seed {seed}, {fault:?}: {alarm:?}");
            assert!(turns <= most, "seed {seed}, {fault:?}: {turns} turns");
        }
    }
}
