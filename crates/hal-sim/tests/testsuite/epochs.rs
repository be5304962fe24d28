//! Jobs that are resumed at the card's position: by a host that was killed and restarted, and by one that begins the
//! path again itself.
//!
//! Invariant: what is expected is calculated from the path alone; the state of the card is taken from its own reports.

use std::sync::{Arc, Mutex};

use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::playback::partial_increment;
use retrace_core::{Flags, Place, Rate, Record, RecordIndex};
use retrace_hal_sim::{
    CardSimulator, CardSimulatorSettings, Chance, Clock, FaultRates, InProcess, PlantSettings, Random,
    SerialChannelSettings, SimCard, SimCardError, SimulationFaults, wiring,
};
use retrace_link::{
    Alarm, CardFailure, CardSettings, CommandRefusal, Greeting, HomingCommand, HostCommand, InputSetting, InputUse,
    Instruction, LinkError, LinkTimeouts, LinkedCard, LinkedCardError, MotionCard, OutputChange, PathStart, SpeedCurve,
    SpeedPoint, SpindlePwm, channel,
};

const RECORDS: u32 = 600;
/// An instruction is executed after every so many records, at a planned stop.
const EVERY: u32 = 100;

fn limits<const A: usize>() -> RateLimits<A> {
    let axis = PulseLimits { velocity: 200 << 32, acceleration: 12 << 32, jerk: 1 << 32 };
    RateLimits::new(13, 1 << 15, [axis; A]).expect("valid")
}

fn settings() -> CardSettings<3> {
    CardSettings::new(0, PathStart::at(RecordIndex::new(0)), 1000, limits())
}

fn record(place: u32) -> Record<3> {
    let x = (place % EVERY) as i16;
    let ramp = x.min(EVERY as i16 - 1 - x);
    let flags = if (place + 1).is_multiple_of(EVERY) { Flags::REST } else { Flags::NONE };
    Record { increments: [ramp, -ramp / 3, (place / EVERY % 2) as i16], line: place + 1, flags, ..Record::default() }
}

/// P of a place.
fn position(place: Place) -> [i64; 3] {
    let mut sums = [0; 3];
    for n in 0..place.record.number() {
        for (sum, increment) in sums.iter_mut().zip(record(n).increments) {
            *sum += i64::from(increment);
        }
    }
    for (sum, increment) in sums.iter_mut().zip(record(place.record.number()).increments) {
        *sum += i64::from(partial_increment(increment, place.fraction));
    }
    sums
}

/// Sends what is due and fits: the next instruction, records up to it, records behind.
fn feed(card: &mut impl MotionCard<3>) {
    let next = card.status().executed + 1;
    let gate = ((next - 1) * EVERY).min(RECORDS);
    if gate < RECORDS && !RecordIndex::new(gate).is_before(card.status().reached) {
        let mut instruction =
            Instruction { number: next, place: RecordIndex::new(gate), periods: 3, count: 1, ..Instruction::default() };
        instruction.changes[0] = OutputChange { channel: channel::SPEED, value: next as i32 };
        if card.status().high == RecordIndex::new(gate) && card.acknowledged_high() == RecordIndex::new(gate) {
            // A card in this process refuses an instruction that it already holds; over a serial line it must not be
            // sent twice.
            let _ = card.send(HostCommand::Instruction(instruction));
        }
    }
    while card.status().high.number() < gate {
        let place = card.status().high;
        if card.send(HostCommand::Ahead { place, record: record(place.number()) }).is_err() {
            break;
        }
    }
    for _ in 0..20 {
        let Some(place) = card.status().low.number().checked_sub(1) else { break };
        let rests = place.is_multiple_of(EVERY);
        if card.send(HostCommand::Behind { place: RecordIndex::new(place), record: record(place), rests }).is_err() {
            break;
        }
    }
}

/// A card over a serial line that remembers which instruction was sent, so that it is sent once per epoch.
struct OncePerEpoch<C> {
    card: C,
    told: u32,
}

impl<C: MotionCard<3>> MotionCard<3> for OncePerEpoch<C> {
    type Fault = C::Fault;

    fn window(&self) -> u32 {
        self.card.window()
    }

    fn send(&mut self, command: HostCommand<3>) -> Result<(), CommandRefusal> {
        if let HostCommand::Instruction(instruction) = command {
            if self.told == instruction.number {
                return Ok(());
            }
            self.told = instruction.number;
        }
        self.card.send(command)
    }

    fn run_period(&mut self) -> Result<&retrace_link::CardStatus<3>, C::Fault> {
        self.card.run_period()
    }

    fn begin_path(&mut self, start: PathStart) -> Result<(), C::Fault> {
        self.told = 0;
        self.card.begin_path(start)
    }

    fn status(&self) -> &retrace_link::CardStatus<3> {
        self.card.status()
    }

    fn acknowledged_high(&self) -> retrace_core::RecordIndex {
        self.card.acknowledged_high()
    }
}

/// Runs at a rate for `periods` periods, or until the end.
fn run<C: MotionCard<3, Fault: std::fmt::Debug>>(card: &mut C, target: Rate, periods: u32) {
    card.send(HostCommand::rate(target)).expect("a rate");
    for _ in 0..periods {
        feed(card);
        let status = *card.run_period().expect("no fault");
        assert_eq!(status.counts, position(status.place), "at {:?}", status.place);
        if target > Rate::ZERO && status.at_rest && status.place == Place::start_of(RecordIndex::new(RECORDS)) {
            return;
        }
    }
}

fn start_of(place: Place, reached: u32, executed: u32) -> PathStart {
    PathStart {
        place,
        rests: place.fraction == 0 && place.record.number().is_multiple_of(EVERY),
        reached: RecordIndex::new(reached),
        executed,
        keeps_state: false,
    }
}

/// Stops, and begins the path again at the machine's position.
fn begin_anew<C: MotionCard<3, Fault: std::fmt::Debug>>(card: &mut C) {
    card.send(HostCommand::rate(Rate::ZERO)).expect("a rate");
    let mut stood = 0;
    // A rate that is lost is repeated 12 ms later, and may be lost again: on the worst of these lines about two frames
    // in three are.
    while stood < 200 {
        stood = if card.run_period().expect("no fault").at_rest { stood + 1 } else { 0 };
    }
    let was = *card.status();
    card.begin_path(start_of(was.place, was.reached.number(), was.executed)).expect("it stands");
    let now = card.status();
    assert_eq!((now.place, now.reached, now.counts), (was.place, was.reached, was.counts));
    assert!(now.period >= was.period && now.executed >= was.executed && now.executed <= was.executed + 1);
}

fn legs(seed: u64) -> Vec<(Rate, u32)> {
    let mut random = Random::new(seed);
    (0..12)
        .map(|_| {
            let rate = [Rate::ONE, Rate::ONE / 2, -Rate::ONE, -Rate::ONE / 3][random.up_to(3) as usize];
            (rate, 20 + random.up_to(150))
        })
        .collect()
}

#[test]
fn a_path_that_is_begun_anew_goes_on_exactly() {
    for seed in 0..20 {
        let mut card = SimCard::<3>::new(RecordIndex::new(0), limits(), Clock::Virtual).expect("fits");
        for (rate, periods) in legs(seed) {
            run(&mut card, rate, periods);
            begin_anew(&mut card);
        }
        run(&mut card, Rate::ONE, 4000);
        assert_eq!(
            (card.status().counts, card.status().executed),
            (position(Place::start_of(RecordIndex::new(RECORDS))), RECORDS / EVERY)
        );
    }
}

/// A card simulator, and the numbers of the executed instructions in the order of the card.
fn watched(settings: &CardSimulatorSettings) -> (CardSimulator<3>, Arc<Mutex<Vec<u32>>>) {
    let mut rig = CardSimulator::<3>::new(settings).expect("a card");
    let log = Arc::new(Mutex::new(vec![0]));
    let into = Arc::clone(&log);
    rig.observe(Box::new(move |now| {
        let mut log = into.lock().expect("whole");
        if log.last() != Some(&now.status.executed) {
            log.push(now.status.executed);
        }
    }));
    (rig, log)
}

fn line(chance: f64, seed: u64) -> SerialChannelSettings {
    let rates = FaultRates { stall_us: 20_000, ..FaultRates::all(Chance::new(chance).expect("a probability")) };
    SerialChannelSettings { baud: 1_000_000, latency_us: 100, jitter_us: 500, rates, seed, script: Vec::new() }
}

#[test]
fn a_path_that_is_begun_anew_over_a_line_goes_on_exactly() {
    for (seed, chance) in [(1, 0.0), (2, 2e-4), (3, 1e-3)] {
        let (up, down) = (line(chance, seed), line(chance, seed + 100));
        let (rig, log) = watched(&CardSimulatorSettings { up, down, ..CardSimulatorSettings::default() });
        let mut wired = LinkedCard::connect(InProcess::new(rig), 7, LinkTimeouts::default()).expect("a card answers");
        // The worst of these lines is silent for longer than the usual watchdog in one of 30 runs (4 of 120 seeds).
        wired.open(CardSettings { watchdog_periods: 1000, ..settings() }).expect("it takes the settings");
        let mut card = OncePerEpoch { card: wired, told: 0 };
        for (rate, periods) in legs(seed) {
            run(&mut card, rate, periods);
            begin_anew(&mut card);
        }
        run(&mut card, Rate::ONE, 4000);
        let rig = card.card.port().simulator();
        assert_eq!(
            (rig.status().counts, rig.status().executed),
            (position(Place::start_of(RecordIndex::new(RECORDS))), RECORDS / EVERY)
        );
        assert_eq!((rig.faults(), rig.pins().positions()), (SimulationFaults::default(), &rig.status().counts));
        assert_eq!(*log.lock().expect("whole"), (0..=RECORDS / EVERY).collect::<Vec<_>>(), "each once, in order");
    }
}

/// Steps of a host that is restarted: finds the card, waits until it is at rest, opens at its reported position, clears
/// the alarm.
fn come_back(mut rig: CardSimulator<3>, nonce: u32) -> OncePerEpoch<LinkedCard<3, InProcess<3>>> {
    // sooner than the watchdog, and later
    let until = rig.now_us() + u64::from(nonce % 4) * 200_000;
    rig.run(until);
    let mut wired = LinkedCard::connect(InProcess::new(rig), nonce, LinkTimeouts::default()).expect("a card answers");
    wired.wait_at_rest(nonce + 1000).expect("it stands");
    let stood = *wired.port().simulator().status();
    assert_eq!((stood.alarm, stood.at_rest), (Some(Alarm::HostSilent), true));
    let result: Greeting<3> = *wired.greeting().expect("it was found by it");
    assert_eq!((result.place, result.reached, result.executed), (stood.place, stood.reached, stood.executed));
    assert_eq!((result.counts, result.counts), (stood.counts, position(result.place)));
    let start = start_of(result.place, result.reached.number(), result.executed);
    wired.open(CardSettings { start, ..settings() }).expect("it takes the settings");
    assert_eq!(wired.status().alarm, Some(Alarm::HostSilent));
    wired.send(HostCommand::ClearAlarm).expect("taken");
    while wired.run_period().expect("no fault before it is known what became of it").alarm.is_some() {}
    OncePerEpoch { card: wired, told: 0 }
}

/// Killed at any moment, in motion forward and backward, at rest, in an instruction: the job ends with exact counts,
/// every instruction executed once.
#[test]
fn a_host_that_was_killed_takes_its_job_up_again() {
    let mut inside = 0;
    for seed in 0..12 {
        let chance = [0.0, 2e-4][seed as usize % 2];
        let (up, down) = (line(chance, seed), line(chance, seed + 100));
        let (rig, log) = watched(&CardSimulatorSettings { up, down, ..CardSimulatorSettings::default() });
        let mut wired = LinkedCard::connect(InProcess::new(rig), 7, LinkTimeouts::default()).expect("a card answers");
        wired.open(settings()).expect("it takes the settings");
        let mut card = OncePerEpoch { card: wired, told: 0 };
        for (number, (rate, periods)) in (0u32..).zip(legs(seed).into_iter().take(6)) {
            run(&mut card, rate, periods);
            // killed
            card = come_back(card.card.into_port().into_simulator(), 20 + number);
            inside += u32::from(card.status().place.fraction != 0);
        }
        run(&mut card, Rate::ONE, 6000);
        let rig = card.card.port().simulator();
        assert_eq!(
            (rig.status().counts, rig.status().alarm),
            (position(Place::start_of(RecordIndex::new(RECORDS))), None)
        );
        assert_eq!((rig.faults(), rig.pins().positions()), (SimulationFaults::default(), &rig.status().counts));
        assert_eq!(*log.lock().expect("whole"), (0..=RECORDS / EVERY).collect::<Vec<_>>(), "each once, in order");
    }
    assert!(inside > 8, "it came to rest inside of a record {inside} times");
}

/// The host receives the card's reports late: what is executed before the new epoch counts in it.
#[test]
fn what_is_executed_meanwhile_is_executed() {
    let down = SerialChannelSettings { latency_us: 30_000, ..SerialChannelSettings::default() };
    let rig =
        CardSimulator::<3>::new(&CardSimulatorSettings { down, ..CardSimulatorSettings::default() }).expect("a card");
    let mut card = LinkedCard::connect(InProcess::new(rig), 7, LinkTimeouts::default()).expect("a card answers");
    card.open(settings()).expect("it takes the settings");
    let mut instruction = Instruction { number: 1, periods: 20, count: 1, ..Instruction::default() };
    instruction.changes[0] = OutputChange { channel: channel::SPEED, value: 7 };
    card.send(HostCommand::Instruction(instruction)).expect("taken");
    card.send(HostCommand::rate(Rate::ONE)).expect("a rate");
    while card.run_period().expect("no fault").outputs[usize::from(channel::SPEED)] == 0 {}
    assert_eq!((card.status().executed, card.port().simulator().status().executed), (0, 1));
    card.begin_path(PathStart { executed: 40, ..PathStart::at(RecordIndex::new(9)) }).expect("it stands");
    assert_eq!((card.status().executed, card.port().simulator().status().executed), (41, 41));
}

/// An alarm whose cause persists remains, and the host reports so.
#[test]
fn an_alarm_that_cannot_be_cleared_is_a_fault_again() {
    let rig = CardSimulator::<3>::new(&CardSimulatorSettings::default()).expect("a card");
    let mut settings = settings();
    settings.inputs[usize::from(wiring::EMERGENCY_STOP)].used_for = InputUse::EmergencyStop;
    let mut card = LinkedCard::connect(InProcess::new(rig), 7, LinkTimeouts::default()).expect("a card answers");
    card.open(settings).expect("it takes the settings");
    let stop = LinkedCardError::Host(LinkError::Alarm(Alarm::EmergencyStop));
    card.port_mut().simulator_mut().machine().set_input(wiring::EMERGENCY_STOP, true);
    let until_fault = |card: &mut LinkedCard<3, InProcess<3>>| (0..2000).find_map(|_| card.run_period().err());
    assert_eq!(until_fault(&mut card), Some(stop));
    card.send(HostCommand::ClearAlarm).expect("taken");
    assert!(card.run_period().is_ok(), "nothing is known yet");
    assert_eq!(until_fault(&mut card), Some(stop));
    card.port_mut().simulator_mut().machine().set_input(wiring::EMERGENCY_STOP, false);
    assert_eq!(until_fault(&mut card), Some(stop), "the chain is closed, and the alarm latched");
    card.send(HostCommand::ClearAlarm).expect("taken");
    assert_eq!(until_fault(&mut card), None);
    assert_eq!(card.status().alarm, None);
}

fn with_switches() -> SimCard<3> {
    let mut settings = settings();
    let mut wire = |input: u8, used_for| {
        settings.inputs[usize::from(input)] = InputSetting { used_for, active_low: false };
    };
    wire(wiring::HOME + 1, InputUse::Home { axis: 1 });
    wire(wiring::UPPER, InputUse::Limit { axis: 0, upper: true });
    wire(wiring::DOOR, InputUse::Door);
    let machine = PlantSettings::with_switches(&[[-4000, 4000]; 3], 1000);
    SimCard::with_machine(settings, &machine, Clock::Virtual).expect("fits")
}

fn until<const A: usize>(card: &mut SimCard<A>, done: impl Fn(&retrace_link::CardStatus<A>) -> bool) {
    for _ in 0..20_000 {
        if done(card.run_period().expect("no fault")) {
            return;
        }
    }
    panic!("it does not come to that: {:?}", card.status());
}

#[test]
fn the_card_in_this_process_homes_stops_and_is_turned_as_a_served_one() {
    let mut card = with_switches();
    let order = HomingCommand {
        axis: 1,
        upper: false,
        search_speed: 20 << 32,
        latch_speed: 1 << 31,
        acceleration: 1 << 31,
        max_travel: 8000,
        count: 50_000,
    };
    card.send(HostCommand::Home(order)).expect("taken");
    until(&mut card, |status| status.at_rest);
    let apart = card.status().counts[1] - card.counters().positions()[1];
    assert_eq!(apart, 50_000 + 2999, "the switch opens at −2999");
    card.begin_path(PathStart::at(RecordIndex::new(5))).expect("it stands");
    card.send(HostCommand::Ahead { place: RecordIndex::new(5), record: record(1) }).expect("the path is begun anew");
    // the wheel
    card.machine().turn_wheel(-7);
    assert_eq!(card.run_period().expect("no fault").wheel, -7);
    // a door in motion
    card.machine().set_input(wiring::DOOR, true);
    card.send(HostCommand::rate(Rate::ONE)).expect("a rate");
    until(&mut card, |status| status.alarm.is_some());
    assert_eq!(card.run_period().expect_err("it stands"), SimCardError::Alarm(Alarm::DoorOpen));
    assert_eq!(card.send(HostCommand::ClearAlarm), Err(CommandRefusal::Alarm), "the door is open");
    card.machine().set_input(wiring::DOOR, false);
    card.run_period().expect_err("it is still latched");
    card.send(HostCommand::ClearAlarm).expect("the door is shut");
    assert_eq!(card.run_period().expect("no fault").alarm, None);
}

#[test]
fn a_card_that_kept_its_position_stands_there_with_all_that_hangs_on_it() {
    let mut outputs = [0; channel::COUNT];
    outputs[3] = 1;
    let mut card = with_switches().with_position([3990, -50, 7], &outputs);
    assert_eq!((card.status().counts, card.status().outputs[3]), ([3990, -50, 7], 1));
    card.begin_path(start_of(Place { record: RecordIndex::new(110), fraction: 1 << 30 }, 120, 2)).expect("it stands");
    for place in 110..150 {
        card.send(HostCommand::Ahead { place: RecordIndex::new(place), record: record(place) }).expect("room");
    }
    card.send(HostCommand::rate(Rate::ONE)).expect("a rate");
    until(&mut card, |status| status.alarm.is_some());
    let status = card.status();
    assert_eq!(status.alarm, Some(Alarm::LimitSwitch { axis: 0, upper: true }));
    assert!(status.counts[0] >= 4000 && status.counts[0] < 4020, "{:?}", status.counts);
}

/// Axes with backlash, homed, moved to and fro and begun again, over a serial line: the simulator finds the pins where
/// counts and backlash put them, and the driven part is where the path requires.
#[test]
fn play_is_taken_up_beside_the_counts() {
    let rig = CardSimulator::<3>::new(&CardSimulatorSettings::default()).expect("a card");
    let mut settings = settings();
    settings.backlash_pulses = [37, 0, 400];
    let mut wired = LinkedCard::connect(InProcess::new(rig), 7, LinkTimeouts::default()).expect("a card answers");
    wired.open(settings).expect("it takes the settings");
    let mut card = OncePerEpoch { card: wired, told: 0 };
    let mut taken = Vec::new();
    for (rate, periods) in legs(5) {
        run(&mut card, rate, periods);
        begin_anew(&mut card);
        let rig = card.card.port().simulator();
        let apart: [i64; 3] = std::array::from_fn(|axis| rig.pins().positions()[axis] - rig.status().counts[axis]);
        taken.push(apart);
    }
    let rig = card.card.port().simulator();
    assert_eq!(rig.faults(), SimulationFaults::default());
    // The first axis goes up at first, and the third hardly ever reverses.
    assert!(
        taken.iter().all(|apart| [0, -37].contains(&apart[0]) && apart[1] == 0 && [0, -400].contains(&apart[2])),
        "{taken:?}"
    );
    assert!(taken.iter().any(|apart| apart[0] != 0) && taken.iter().any(|apart| apart[2] != 0), "{taken:?}");
}

/// Homing of an axis with backlash: its count is that of the driven part, on whichever side of the backlash it was
/// before.
#[test]
fn an_axis_with_play_is_homed_exactly() {
    for (slow, play) in [(1 << 31, 60), (1 << 28, 60), (3 << 32, 7), (1 << 31, 0)] {
        let mut settings = settings();
        settings.inputs[usize::from(wiring::HOME)].used_for = InputUse::Home { axis: 0 };
        settings.backlash_pulses[0] = play;
        let mut card = SimCard::<3>::with_machine(settings, &PlantSettings::default(), Clock::Virtual).expect("fits");
        let order = HomingCommand {
            axis: 0,
            upper: false,
            search_speed: 20 << 32,
            latch_speed: slow,
            acceleration: 1 << 31,
            max_travel: 8000,
            count: 0,
        };
        card.send(HostCommand::Home(order)).expect("taken");
        let (mut driven, mut edge) = (0i64, None);
        for _ in 0..100_000 {
            // the switch is actuated by the driven part, which the drive pushes down at first
            let closed = driven <= -1000;
            card.machine().set_input(wiring::HOME, closed);
            let at_rest = card.run_period().expect("no fault").at_rest;
            let motor = card.counters().positions()[0];
            driven = driven.clamp(motor - i64::from(play), motor);
            if closed && driven > -1000 {
                edge = Some(driven);
            }
            if at_rest {
                break;
            }
        }
        let edge = edge.expect("it came off the switch");
        let counted = card.status().counts[0] - (driven - edge);
        assert!((-(slow >> 32) - 1..=0).contains(&counted), "{counted} at the edge, {play} pulses of play");
    }
}

/// A caller that uses an old report cannot begin a path where the machine no longer is: E3021, and the card retains its
/// path.
#[test]
fn a_path_is_not_begun_where_the_machine_has_moved_on() {
    let down = SerialChannelSettings { latency_us: 30_000, ..SerialChannelSettings::default() };
    let rig =
        CardSimulator::<3>::new(&CardSimulatorSettings { down, ..CardSimulatorSettings::default() }).expect("a card");
    let mut card = LinkedCard::connect(InProcess::new(rig), 7, LinkTimeouts::default()).expect("a card answers");
    card.open(settings()).expect("it takes the settings");
    for place in 0..EVERY {
        card.send(HostCommand::Ahead { place: RecordIndex::new(place), record: record(place) }).expect("room");
    }
    card.send(HostCommand::rate(Rate::ONE)).expect("a rate");
    let was = *card.status();
    assert_eq!((was.place, was.at_rest), (Place::start_of(RecordIndex::new(0)), true), "as far as the host knows");
    let epoch = card.port().simulator().status().period;
    let fault = card.begin_path(PathStart::at(RecordIndex::new(0))).expect_err("it has moved on");
    assert_eq!(fault, LinkedCardError::Host(LinkError::Moved));
    assert_eq!((fault.number(), fault.remedy()), ("E3021", "resume the job; check the line if it happens again"));
    let rig = card.port().simulator();
    assert_eq!(
        (rig.status().place, rig.status().at_rest),
        (Place::start_of(RecordIndex::new(EVERY)), true),
        "its own path goes on"
    );
    assert_eq!(
        (rig.status().counts, rig.faults()),
        (position(Place::start_of(RecordIndex::new(EVERY))), SimulationFaults::default())
    );
    assert!(rig.status().period > epoch && rig.pins().positions() == &rig.status().counts);
    // After the report of its position it can be begun.
    while card.status().place != Place::start_of(RecordIndex::new(EVERY)) {
        card.run_period().expect("no fault");
    }
    card.begin_path(PathStart::at(RecordIndex::new(EVERY))).expect("it stands there");
}

/// The curve of the output for S arrives behind each opening, before anything switches, on lines that damage frames as
/// well; the card keeps it while an epoch begins anew with the spindle on.
#[test]
fn the_curve_of_the_output_for_s_follows_the_opening() {
    let mut curve = SpeedCurve { count: 2, ..SpeedCurve::default() };
    curve.points[..2].copy_from_slice(&[
        SpeedPoint { speed: 1_000_000, duty: 6_000 },
        SpeedPoint { speed: 3_000_000, duty: 60_000 },
    ]);
    for (seed, chance) in [(1, 0.0), (2, 1e-3)] {
        let (up, down) = (line(chance, seed), line(chance, seed + 100));
        let rig = CardSimulator::<3>::new(&CardSimulatorSettings { up, down, ..CardSimulatorSettings::default() });
        let rig = rig.expect("a card");
        let mut card = LinkedCard::connect(InProcess::new(rig), 7, LinkTimeouts::default()).expect("a card answers");
        let spindle_pwm = Some(SpindlePwm { full_scale: SpindlePwm::BY_CURVE, hz: 1000 });
        let patient = CardSettings { watchdog_periods: 1000, spindle_pwm, speed_curve: Some(curve), ..settings() };
        card.open(patient).expect("it takes the settings");
        for (channel, value) in [(channel::SPEED, 2_000_000), (channel::SPINDLE, 1)] {
            card.send(HostCommand::ManualOutput(OutputChange { channel, value })).expect("a channel");
        }
        let duty = |card: &LinkedCard<3, InProcess<3>>| {
            card.port().simulator().card().card().spindle_pwm().expect("used").duty
        };
        while card.port().simulator().status().outputs[usize::from(channel::SPINDLE)] == 0 {
            assert_eq!(duty(&card), 0, "the spindle is off");
            card.run_period().expect("no fault");
        }
        for _ in 0..3 {
            assert_eq!(duty(&card), 33_000);
            card.begin_path(PathStart::at(RecordIndex::new(0))).expect("it is at rest");
        }
    }
}
