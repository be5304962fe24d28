//! Host endpoint, serial line, card endpoint, card, pins and switches, together in virtual time.

use std::sync::{Arc, Mutex};

use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Flags, Rate, Record, RecordIndex};
use retrace_hal_sim::{
    CardSimulator, CardSimulatorSettings, Chance, FaultRates, InProcess, LineCounters, PlantSettings, Process,
    SerialChannelSettings, wiring,
};
use retrace_link::{
    Alarm, BytePort, CardSettings, CardStatus, HomingCommand, HostCommand, InputSetting, InputUse, InputWait,
    Instruction, LinkTimeouts, LinkedCard, MotionCard, OutputChange, PathStart, channel,
};

type Host = LinkedCard<3, InProcess<3>>;

fn settings() -> CardSettings<3> {
    CardSettings::new(0, PathStart::at(RecordIndex::new(0)), 1000, limits())
}

fn host(rig: &CardSimulatorSettings, settings: CardSettings<3>) -> Host {
    let rig = CardSimulator::new(rig).expect("a card");
    let mut host = Host::connect(InProcess::new(rig), 7, LinkTimeouts::default()).expect("a card answers");
    host.open(settings).expect("it takes the settings");
    host
}

/// A path to and fro in each axis, of `length` records.
fn record(place: u32, length: u32) -> Record<3> {
    let x = (place % 90) as i16 - 44;
    let flags = if place + 1 == length { Flags::REST } else { Flags::NONE };
    Record {
        increments: [x, -x / 2, if place.is_multiple_of(7) { 3 } else { 0 }],
        line: place,
        flags,
        ..Record::default()
    }
}

fn position(place: u32, length: u32) -> [i64; 3] {
    let mut sums = [0; 3];
    for n in 0..place {
        let increments = record(n, length).increments;
        for axis in 0..3 {
            sums[axis] += i64::from(increments[axis]);
        }
    }
    sums
}

/// Runs at a rate until the card rests at `to`, with the path sent as the window permits; returns the last report.
fn run(host: &mut Host, target: Rate, to: u32, length: u32) -> CardStatus<3> {
    host.send(HostCommand::rate(target)).expect("a rate");
    for _ in 0..200_000 {
        loop {
            let high = host.status().high;
            if high.number() >= length
                || host.send(HostCommand::Ahead { place: high, record: record(high.number(), length) }).is_err()
            {
                break;
            }
        }
        let status = *host.run_period().expect("no fault");
        if status.at_rest && status.place == retrace_core::Place::start_of(RecordIndex::new(to)) {
            return status;
        }
    }
    panic!("it does not come to {to}: {:?}", host.status());
}

fn line(baud: u32, chance: f64, seed: u64) -> SerialChannelSettings {
    let rates = FaultRates { stall_us: 20_000, ..FaultRates::all(Chance::new(chance).expect("a probability")) };
    SerialChannelSettings { baud, latency_us: 100, jitter_us: 500, rates, seed, script: Vec::new() }
}

#[test]
fn there_and_back_over_lines_good_and_bad() {
    for (seed, chance) in [(1, 0.0), (2, 1e-4), (3, 1e-3)] {
        let (up, down) = (line(1_000_000, chance, seed), line(1_000_000, chance, seed + 100));
        let mut host = host(&CardSimulatorSettings { up, down, ..CardSimulatorSettings::default() }, settings());
        let status = run(&mut host, Rate::ONE, 700, 700);
        assert_eq!(status.counts, position(700, 700));
        let status = run(&mut host, -Rate::ONE / 2, 0, 700);
        assert_eq!((status.counts, status.reached), ([0; 3], RecordIndex::new(700)));
        let rig = host.port().simulator();
        assert_eq!(rig.faults(), retrace_hal_sim::SimulationFaults::default(), "chance {chance}");
        assert_eq!(rig.pins().positions(), &[0; 3]);
        let all: i64 = (0..700).map(|n| 2 * i64::from(record(n, 700).increments[0].unsigned_abs())).sum();
        // A period across a turning point makes fewer pulses than its two halves; none makes more.
        let made = rig.pins().pulses()[0] as i64;
        assert!(made <= all && made > all - 100, "no axis goes to and fro on its way: {made} of {all}");
        let faults: u64 = rig.lines().iter().map(|line| line.counters().faults()).sum();
        assert_eq!(faults > 0, chance > 0.0, "{faults} faults at {chance}");
    }
}

/// The same seeds give the same run, to the microsecond.
#[test]
fn a_run_can_be_repeated() {
    let one = || {
        let log = Arc::new(Mutex::new(Vec::new()));
        let into = Arc::clone(&log);
        let (up, down) = (line(230_400, 1e-3, 5), line(230_400, 1e-3, 6));
        let mut rig = CardSimulator::new(&CardSimulatorSettings { up, down, ..CardSimulatorSettings::default() })
            .expect("a card");
        rig.observe(Box::new(move |now| {
            into.lock().expect("whole").push((now.at_us, now.status.place, *now.positions))
        }));
        let mut host = Host::connect(InProcess::new(rig), 7, LinkTimeouts::default()).expect("a card answers");
        host.open(settings()).expect("it takes the settings");
        run(&mut host, Rate::ONE, 400, 400);
        let (tallies, now) =
            (host.port().simulator().lines().map(|line| *line.counters()), host.port().simulator().now_us());
        drop(host);
        (Arc::try_unwrap(log).expect("ours").into_inner().expect("whole"), tallies, now)
    };
    let (first, second) = (one(), one());
    assert!(first.0.len() > 400 && first.1[0].faults() > 0);
    assert_eq!(first, second);
}

fn done() -> Process {
    Process {
        channel: channel::SPINDLE,
        input: wiring::DONE,
        min_us: 5_000,
        max_us: 80_000,
        hangs: Chance::NEVER,
        fails: Chance::NEVER,
    }
}

/// Switches the spindle at place 0 and waits for it, then runs; returns the first report with an alarm, or the last
/// one.
fn switch_and_run(process: Process) -> (CardStatus<3>, u64) {
    let machine = PlantSettings { processes: vec![process], seed: 9, ..PlantSettings::default() };
    let mut host = host(&CardSimulatorSettings { machine, ..CardSimulatorSettings::default() }, settings());
    let mut instruction = Instruction { number: 1, count: 1, periods: 1, ..Instruction::default() };
    instruction.changes[0] = OutputChange { channel: channel::SPINDLE, value: 1 };
    instruction.until = Some(InputWait::new(wiring::DONE, true, 100));
    host.send(HostCommand::Instruction(instruction)).expect("taken");
    host.send(HostCommand::rate(Rate::ONE)).expect("a rate");
    for _ in 0..1000 {
        let high = host.status().high;
        if high.number() < 50 && host.status().executed == 1 {
            host.send(HostCommand::Ahead { place: high, record: record(high.number(), 50) }).expect("room");
        }
        match host.run_period() {
            Ok(status) if status.place.record == RecordIndex::new(50) && status.at_rest => break,
            Ok(_) => {}
            Err(_) => break,
        }
    }
    let rig = host.port().simulator();
    (*rig.status(), rig.now_us())
}

#[test]
fn a_process_is_waited_for_and_one_that_hangs_or_fails_is_an_alarm() {
    let certain = Chance::new(1.0).expect("a probability");
    let (status, _) = switch_and_run(done());
    assert_eq!((status.alarm, status.executed, status.counts), (None, 1, position(50, 50)));
    let (status, _) = switch_and_run(Process { hangs: certain, ..done() });
    assert_eq!((status.alarm, status.executed, status.counts), (Some(Alarm::TimedOut { instruction: 1 }), 0, [0; 3]));
    let (status, _) = switch_and_run(Process { fails: certain, ..done() });
    assert_eq!((status.alarm, status.executed, status.counts), (Some(Alarm::Failed { instruction: 1 }), 0, [0; 3]));
}

/// The axis runs onto its limit switch, whose position the pins determine, not the plan.
#[test]
fn a_limit_switch_stops_the_motion_on_the_path() {
    let machine = PlantSettings::with_switches(&[[-10_000, 10_000], [-10_000, 10_000], [-10_000, 30]], 10);
    let mut settings = settings();
    settings.inputs[usize::from(wiring::UPPER + 2)] =
        InputSetting { used_for: InputUse::Limit { axis: 2, upper: true }, active_low: false };
    let mut host = host(&CardSimulatorSettings { machine, ..CardSimulatorSettings::default() }, settings);
    host.send(HostCommand::rate(Rate::ONE)).expect("a rate");
    for _ in 0..400 {
        let high = host.status().high;
        if high.number() < 300 {
            host.send(HostCommand::Ahead { place: high, record: record(high.number(), 300) }).expect("room");
        }
        if host.run_period().is_err() {
            break;
        }
    }
    let rig = host.port_mut().simulator_mut();
    let until = rig.now_us() + 200_000;
    rig.run(until);
    let status = *rig.status();
    assert_eq!(status.alarm, Some(Alarm::LimitSwitch { axis: 2, upper: true }));
    assert!(status.at_rest && status.counts[2] >= 30 && status.counts[2] < 60, "{status:?}");
    assert_eq!((rig.pins().positions(), rig.faults().count_mismatches), (&status.counts, 0));
}

/// The axis finds its switch, which counts pulses like a real one; what homing sets is not a fault of the counts.
#[test]
fn homing_sets_the_count_where_the_switch_is() {
    let machine = PlantSettings::with_switches(&[[-4000, 4000], [-4000, 4000], [-4000, 4000]], 1000);
    let mut settings = settings();
    let home = InputSetting { used_for: InputUse::Home { axis: 1 }, active_low: false };
    settings.inputs[usize::from(wiring::HOME + 1)] = home;
    let mut host = host(&CardSimulatorSettings { machine, ..CardSimulatorSettings::default() }, settings);
    let pulses = |n: i64| n << 32;
    let order = HomingCommand {
        axis: 1,
        upper: false,
        search_speed: pulses(20),
        latch_speed: pulses(1) / 2,
        acceleration: pulses(1) / 2,
        max_travel: 8000,
        count: 50_000,
    };
    host.send(HostCommand::Home(order)).expect("taken");
    let mut status = *host.run_period().expect("no fault");
    for _ in 0..20_000 {
        if status.at_rest && status.counts[1] != 0 {
            break;
        }
        status = *host.run_period().expect("no fault");
    }
    let rig = host.port().simulator();
    assert_eq!((rig.status().alarm, rig.status().at_rest), (None, true));
    // the switch opens at −2999, and there the count is the value that was set
    let apart = rig.status().counts[1] - rig.pins().positions()[1];
    assert_eq!(apart, 50_000 + 2999);
    assert!((-2999..-2900).contains(&rig.pins().positions()[1]), "{:?}", rig.pins().positions());
    assert_eq!(rig.faults(), retrace_hal_sim::SimulationFaults::default());
}

/// The handwheel counts are in the reports, over a line that loses some of them, to the count.
#[test]
fn the_wheel_is_told_to_the_count() {
    let (up, down) = (line(1_000_000, 5e-4, 3), line(1_000_000, 5e-4, 4));
    let mut host = host(&CardSimulatorSettings { up, down, ..CardSimulatorSettings::default() }, settings());
    let (mut turned, mut told) = (0i64, 0i64);
    for round in 0..3000i64 {
        if round < 2500 {
            let counts = (round * 7 % 23 - 11) as i16;
            host.port_mut().simulator_mut().machine().turn_wheel(counts);
            turned += i64::from(counts);
        }
        told += i64::from(host.run_period().expect("no fault").wheel);
    }
    assert!(turned != 0 && told == turned, "{told} of {turned}");
}

/// The host stops sending in motion: the card comes to rest on the path by itself, and reports why.
#[test]
fn a_silent_host_is_an_alarm() {
    let mut host = host(&CardSimulatorSettings::default(), settings());
    host.send(HostCommand::rate(Rate::ONE)).expect("a rate");
    while host.status().high.number() < 2000 {
        let high = host.status().high;
        if host.send(HostCommand::Ahead { place: high, record: record(high.number(), 2000) }).is_err() {
            host.run_period().expect("no fault");
        }
    }
    while host.run_period().expect("no fault").place.record.number() < 100 {}
    let rig = host.port_mut().simulator_mut();
    rig.run(rig.now_us() + 600_000);
    let status = *rig.status();
    assert_eq!((status.alarm, status.at_rest), (Some(Alarm::HostSilent), true));
    let at = status.place.record;
    assert!(at.number() > 100 && at.number() < 1000, "{at}");
    let under =
        retrace_core::playback::partial_increment(record(at.number(), 2000).increments[0], status.place.fraction);
    assert_eq!(status.counts[0], position(at.number(), 2000)[0] + i64::from(under));
}

/// Bytes that the host writes, with their times in microseconds.
type Written = Vec<(u64, Vec<u8>)>;

/// A port that records what the host writes.
struct RecordingPort {
    port: InProcess<3>,
    written: Arc<Mutex<Written>>,
}

impl BytePort for RecordingPort {
    type Fault = <InProcess<3> as BytePort>::Fault;

    fn now_us(&self) -> u64 {
        self.port.now_us()
    }

    fn writable_bytes(&mut self) -> usize {
        self.port.writable_bytes()
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, Self::Fault> {
        let count = self.port.write(bytes)?;
        self.written.lock().expect("whole").push((self.port.now_us(), bytes[..count].to_vec()));
        Ok(count)
    }

    fn read(&mut self, bytes: &mut [u8], wait_us: u32) -> Result<usize, Self::Fault> {
        self.port.read(bytes, wait_us)
    }
}

/// Positions after each period, bytes for the host, and the counters of the channels.
type Replay = (Vec<(u64, [i64; 3])>, Vec<u8>, [LineCounters; 2]);

/// Result of a card simulator when these bytes are sent to it at these times, and time advances in steps of `step_us`
/// microseconds.
fn replay(settings: &CardSimulatorSettings, written: &Written, step_us: u64) -> Replay {
    let mut rig = CardSimulator::<3>::new(settings).expect("a card");
    let log = Arc::new(Mutex::new(Vec::new()));
    let into = Arc::clone(&log);
    rig.observe(Box::new(move |now| into.lock().expect("whole").push((now.at_us, *now.positions))));
    let (mut bytes, mut buffer) = (Vec::new(), [0; 64]);
    for (at, sent) in written {
        while rig.now_us() < *at {
            rig.run((rig.now_us() + step_us).min(*at));
            let count = rig.receive(&mut buffer);
            bytes.extend_from_slice(&buffer[..count]);
        }
        rig.send(sent);
    }
    rig.run(rig.now_us() + 50_000);
    loop {
        match rig.receive(&mut buffer) {
            0 => break,
            count => bytes.extend_from_slice(&buffer[..count]),
        }
    }
    let tallies = rig.lines().map(|line| *line.counters());
    drop(rig);
    (Arc::try_unwrap(log).expect("ours").into_inner().expect("whole"), bytes, tallies)
}

#[test]
fn the_steps_in_which_time_passes_change_nothing() {
    for baud in [0, 115_200, 1_000_000] {
        let (up, down) = (line(baud, 2e-4, 15), line(baud, 2e-4, 16));
        let settings_of_rig = CardSimulatorSettings { up, down, ..CardSimulatorSettings::default() };
        let written = Arc::new(Mutex::new(Vec::new()));
        let port = InProcess::new(CardSimulator::new(&settings_of_rig).expect("a card"));
        let tap = RecordingPort { port, written: Arc::clone(&written) };
        let mut host = LinkedCard::connect(tap, 7, LinkTimeouts::default()).expect("a card answers");
        host.open(settings()).expect("it takes the settings");
        host.send(HostCommand::rate(Rate::ONE)).expect("a rate");
        while !(host.status().place.record == RecordIndex::new(150) && host.status().at_rest) {
            let high = host.status().high;
            if high.number() < 150 {
                let _ = host.send(HostCommand::Ahead { place: high, record: record(high.number(), 150) });
            }
            host.run_period().expect("no fault");
        }
        let written = written.lock().expect("whole").clone();
        let whole = replay(&settings_of_rig, &written, 1_000_000);
        assert!(whole.0.last().is_some_and(|(_, positions)| *positions == position(150, 150)), "at {baud}");
        for step_us in [1, 37, 1000] {
            assert!(replay(&settings_of_rig, &written, step_us) == whole, "steps of {step_us} µs at {baud}");
        }
    }
}

/// Limits of a machine that stops within some tens of periods.
fn limits<const A: usize>() -> RateLimits<A> {
    let axis = PulseLimits { velocity: 200 << 32, acceleration: 12 << 32, jerk: 1 << 32 };
    RateLimits::new(13, 1 << 15, [axis; A]).expect("valid")
}
