//! Both ends of the line, with a line between them that fails, and works that only count: what the host gives out is
//! what the card did, period by period, and every word is taken once.

use crate::dice;

use dice::Dice;
use proptest::prelude::*;
use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Distance, Flags, Place, Rate, Record, RecordIndex};
use retrace_link::{
    CardCore, CardEndpoint, CardFailure, CardIdentity, CardSettings, CardStatus, CommandRefusal, CutterOff,
    CutterOffCause, HostCommand, HostEndpoint, Instruction, LinkError, OutputChange, PROTOCOL, PathStart, channel,
};

const WINDOW: u32 = 256;

/// Works without any motion law: the cursor goes by the rate that was asked for, as far as the window goes.
struct Works {
    identity: CardIdentity,
    status: CardStatus<3>,
    records: Vec<Record<3>>,
    target: Rate,
    open: bool,
    log: Vec<CardStatus<3>>,
    by_hand: Vec<i32>,
}

impl Works {
    fn new() -> Self {
        let identity = CardIdentity {
            protocol: PROTOCOL,
            name: *b"works for a test",
            serial: 77,
            boot: 1,
            axes: 3,
            outputs: 8,
            inputs: 4,
            window: WINDOW,
            memory: 64,
            tick_hz: 1_000_000,
            min_period_us: 100,
            max_period_us: 20_000,
            max_pulses_hz: 1_000_000,
        };
        let records = vec![Record::default(); WINDOW as usize];
        let status = CardStatus { counts: [5, -6, 7], ..CardStatus::at_rest(PathStart::at(RecordIndex::new(0))) };
        Self { identity, status, records, target: Rate::ZERO, open: false, log: Vec::new(), by_hand: Vec::new() }
    }

    fn period(&mut self) {
        let status = &mut self.status;
        let from = status.place;
        let (ahead, behind) =
            (from.distance_to(Place::start_of(status.high)), from.distance_to(Place::start_of(status.low)));
        let to = from.moved(self.target.over(1).clamp(behind, ahead));
        let records = &self.records;
        let increments = retrace_core::playback::emission(from, to, |n| records.get((n.number() % WINDOW) as usize))
            .expect("in the window");
        status.period += 1;
        (status.place, status.rate) = (to, from.distance_to(to).per_period());
        status.at_rest = status.rate == Rate::ZERO;
        for (count, increment) in status.counts.iter_mut().zip(increments) {
            *count += increment;
        }
        status.increments = increments.map(|pulses| pulses as i32);
        // what is said of one period only
        status.wheel = if status.period.is_multiple_of(37) { 2 } else { 0 };
        let off = CutterOff { channels: 1, cause: CutterOffCause::Standing };
        status.cutter_off = status.period.is_multiple_of(53).then_some(off);
        if self.open {
            self.log.push(*status);
        }
    }
}

impl CardCore<3> for Works {
    fn identity(&self) -> &CardIdentity {
        &self.identity
    }
    fn open(&mut self, settings: &CardSettings<3>) -> Result<(), CommandRefusal> {
        let counts = self.status.counts;
        self.status = CardStatus { counts, outputs: self.status.outputs, ..CardStatus::at_rest(settings.start) };
        (self.target, self.open) = (Rate::ZERO, true);
        self.log.clear();
        Ok(())
    }
    fn close(&mut self) -> Result<(), CommandRefusal> {
        if !self.status.at_rest {
            return Err(CommandRefusal::InMotion);
        }
        self.open = false;
        Ok(())
    }
    fn record_host_frame(&mut self) {}
    fn accept(&mut self, command: HostCommand<3>) -> Result<(), CommandRefusal> {
        let status = &mut self.status;
        let full = status.high.since(status.low) == WINDOW;
        match command {
            HostCommand::Ahead { place, record } => {
                if place != status.high {
                    return Err(CommandRefusal::OutOfOrder);
                }
                if full && status.place.record.since(status.low) <= WINDOW / 4 {
                    return Err(CommandRefusal::Full);
                }
                status.low += u32::from(full);
                self.records[(place.number() % WINDOW) as usize] = record;
                status.high = place + 1;
            }
            HostCommand::Behind { place, record, .. } => {
                if place != status.low - 1 {
                    return Err(CommandRefusal::OutOfOrder);
                }
                if full && status.high.since(status.place.boundary_ahead()) <= WINDOW / 4 {
                    return Err(CommandRefusal::Full);
                }
                status.high -= u32::from(full);
                self.records[(place.number() % WINDOW) as usize] = record;
                status.low = place;
            }
            HostCommand::Rate(target) => self.target = target.feed,
            HostCommand::Instruction(Instruction { number, .. }) => {
                if number != status.executed + 1 {
                    return Err(CommandRefusal::Busy);
                }
                status.executed = number;
            }
            HostCommand::ManualOutput(OutputChange { channel, value }) => {
                status.outputs[usize::from(channel)] = value;
                self.by_hand.push(value);
            }
            _ => {}
        }
        Ok(())
    }
    fn status(&self) -> &CardStatus<3> {
        &self.status
    }
}

/// The record of a number: made of it, so that any end can tell it.
fn record(place: u32) -> Record<3> {
    let x = place.wrapping_mul(2_654_435_761);
    let flags = if place.is_multiple_of(97) { Flags::REST } else { Flags::NONE };
    let slow = (place / 50 % 40) as i16;
    let wild = if place.is_multiple_of(31) { (x >> 16) as i16 } else { slow / 2 };
    Record { increments: [slow, -slow * 3, wild], line: place / 20, flags, ..Record::default() }
}

struct Bench {
    host: Box<HostEndpoint<3>>,
    end: CardEndpoint<3, 256>,
    works: Works,
    dice: Dice,
    one_in: u64,
    now_us: u64,
    log: Vec<CardStatus<3>>,
}

impl Bench {
    fn new(seed: u64, one_in: u64, start: u32) -> Self {
        let mut bench = Self {
            host: Box::new(HostEndpoint::new(seed as u32)),
            end: CardEndpoint::new(),
            works: Works::new(),
            dice: Dice(seed),
            one_in,
            now_us: 1,
            log: Vec::new(),
        };
        bench.until(|b| b.host.greeting().is_some());
        let smoothing = limits();
        bench.host.open(CardSettings::new(0, PathStart::at(RecordIndex::new(start)), 1000, smoothing));
        bench.until(|b| b.host.is_open());
        bench
    }

    /// A tenth of a control period: some bytes pass, now and then one that is not as it was.
    fn step(&mut self) {
        self.now_us += 100;
        let mut bytes = [0; 10];
        let count = self.host.transmit(self.now_us, &mut bytes);
        for byte in &bytes[..count] {
            for byte in fail(&mut self.dice, self.one_in, *byte) {
                self.end.receive(byte, &mut self.works);
            }
        }
        if self.now_us % 1000 < 100 {
            self.works.period();
            self.end.push_period(&self.works.status);
        }
        let count = self.end.transmit(&self.works, &mut bytes);
        for byte in &bytes[..count] {
            for byte in fail(&mut self.dice, self.one_in, *byte) {
                self.host.receive(&[byte], self.now_us);
            }
        }
    }

    fn until(&mut self, done: impl Fn(&Self) -> bool) {
        for _ in 0..400_000 {
            if done(self) {
                return;
            }
            self.step();
            while self.host.next_period() {
                self.log.push(*self.host.status());
            }
            assert_eq!(self.host.fault(), None, "at {} us", self.now_us);
        }
        panic!("it does not come to an end: {:?}", self.host.status());
    }

    /// Keeps the window filled on the side that is run to, between `oldest` and `end`.
    fn fill(&mut self, oldest: u32, end: u32, forward: bool) {
        loop {
            let status = self.host.status();
            let (low, high) = (status.low, status.high);
            let sent = if forward && high.is_before(RecordIndex::new(end)) {
                self.host.send(HostCommand::Ahead { place: high, record: record(high.number()) })
            } else if !forward && RecordIndex::new(oldest).is_before(low) {
                let place = low - 1;
                self.host.send(HostCommand::Behind { place, record: record(place.number()), rests: false })
            } else {
                return;
            };
            if sent.is_err() {
                return;
            }
        }
    }

    /// Runs at a rate to a place.
    fn run_to(&mut self, target: Rate, to: u32, oldest: u32, end: u32) {
        for _ in 0..40_000 {
            self.fill(oldest, end, target > Rate::ZERO);
            self.host.send(HostCommand::rate(target)).expect("a rate is always taken");
            self.step_period();
            let left = self.host.status().place.distance_to(Place::start_of(RecordIndex::new(to)));
            if left == Distance::ZERO || left.signum() != target.signum() {
                return;
            }
        }
        panic!("it does not come to {to}: {:?}", self.host.status());
    }

    fn step_period(&mut self) {
        for _ in 0..10 {
            self.step();
        }
        while self.host.next_period() {
            self.log.push(*self.host.status());
        }
        assert_eq!(self.host.fault(), None, "at {} us", self.now_us);
    }
}

fn fail(dice: &mut Dice, one_in: u64, byte: u8) -> Vec<u8> {
    if !dice.one_in(one_in) {
        return vec![byte];
    }
    match dice.next() % 4 {
        0 => vec![],
        1 => vec![byte, byte],
        2 => vec![byte ^ 1 << (dice.next() % 8)],
        _ => vec![dice.next() as u8],
    }
}

/// What the card logged, as far as the host has been told of it, is what the host gave out.
fn agrees(bench: &Bench) {
    // how far the host may be behind depends on how much the line loses
    let lag = if bench.one_in == 0 { 20 } else { 400_000 / bench.one_in as usize };
    assert!(bench.log.len() <= bench.works.log.len() && bench.log.len() + lag > bench.works.log.len());
    for (told, was) in bench.log.iter().zip(&bench.works.log) {
        assert_eq!((told.period, told.place, told.rate), (told.period, was.place, was.rate));
        assert_eq!((told.counts, told.increments, told.at_rest), (was.counts, was.increments, was.at_rest));
        assert_eq!((told.executed, told.outputs), (was.executed, was.outputs));
        assert_eq!((told.wheel, told.cutter_off), (was.wheel, was.cutter_off));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// There, back, and there again, over a line that fails more or less often, with instructions on the way.
    #[test]
    fn what_the_host_gives_out_is_what_the_card_did(
        seed in any::<u64>(),
        one_in in prop_oneof![Just(0u64), Just(10_000), Just(1000), Just(200), Just(80)],
        start in prop_oneof![Just(0u32), Just(u32::MAX - 700), any::<u32>()],
        rate in prop_oneof![Just(Rate::ONE), Just(Rate::ONE / 3), Just(Rate::ONE * 2 - Rate::from_units(1))],
    ) {
        let mut bench = Bench::new(seed, one_in, start);
        let at = |n: u32| start.wrapping_add(n);
        bench.run_to(rate, at(900), start, at(1500));
        bench.host.send(HostCommand::ManualOutput(OutputChange { channel: 3, value: 1 })).expect("room");
        bench.run_to(-rate, at(100), start, at(1500));
        bench.host.send(HostCommand::Instruction(Instruction { number: 1, ..Instruction::default() })).expect("room");
        bench.run_to(rate, at(1500), start, at(1500));
        bench.host.send(HostCommand::ManualOutput(OutputChange { channel: 3, value: 7 })).expect("room");
        bench.until(|b| b.host.status().executed == 1 && b.host.status().outputs[3] == 7);
        agrees(&bench);
        prop_assert_eq!(&bench.works.by_hand, &[1, 7]);
        prop_assert_eq!(bench.works.status.place, Place::start_of(RecordIndex::new(at(1500))));
        // and it is over in good order
        bench.host.send(HostCommand::rate(Rate::ZERO)).expect("a rate");
        bench.until(|b| b.host.status().at_rest);
        bench.host.close();
        bench.until(|b| b.host.is_closed());
        prop_assert!(!bench.works.open && bench.end.epoch() == 0);
    }

    /// Any bytes at either end: no panic, and nothing is taken that was not sent.
    #[test]
    fn any_bytes_are_harmless(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        let mut bench = Bench::new(1, 0, 0);
        let before = bench.works.status;
        for &byte in &bytes {
            bench.end.receive(byte, &mut bench.works);
        }
        bench.host.receive(&bytes, 10_000_000);
        let after = bench.works.status;
        prop_assert_eq!((after.high, after.outputs, after.executed), (before.high, before.outputs, before.executed));
        prop_assert_eq!(bench.host.fault(), None);
    }
}

/// A stop does not wait behind a long frame: the frame is cut short, and its records come again.
#[test]
fn a_stop_cuts_a_long_frame_short() {
    let mut bench = Bench::new(5, 0, 0);
    bench.run_to(Rate::ONE, 100, 0, 150);
    // everything that was on its way has arrived, and long records wait
    for _ in 0..100 {
        bench.step_period();
    }
    for place in 150..200 {
        let wild = (place as i16).wrapping_mul(7919);
        let record = Record { increments: [wild, !wild, wild / 3], line: place * 1000, ..Record::default() };
        bench.host.send(HostCommand::Ahead { place: RecordIndex::new(place), record }).expect("room");
    }
    let mut bytes = [0; 30];
    assert_eq!(bench.host.transmit(bench.now_us, &mut bytes), 30, "the beginning of a long frame");
    bytes.iter().for_each(|&byte| bench.end.receive(byte, &mut bench.works));
    bench.host.send(HostCommand::rate(Rate::ZERO)).expect("a rate");
    assert_eq!(bench.host.transmit(bench.now_us, &mut bytes), 30);
    bytes.iter().for_each(|&byte| bench.end.receive(byte, &mut bench.works));
    assert_eq!(
        (bench.works.target, bench.works.status.high),
        (Rate::ZERO, RecordIndex::new(150)),
        "the stop is there before the records"
    );
    bench.until(|b| b.works.status.high == RecordIndex::new(200));
}

/// A pulse that the card has lost, or made, is seen by the next report.
#[test]
fn counts_that_are_not_those_of_the_path_are_noticed() {
    let mut bench = Bench::new(5, 0, 0);
    bench.run_to(Rate::ONE, 100, 0, 200);
    bench.works.status.counts[1] += 1;
    for _ in 0..300 {
        bench.step();
        while bench.host.next_period() {}
    }
    assert_eq!(bench.host.fault(), Some(LinkError::StateMismatch));
}

/// What the card has taken and could not confirm comes again, and is not taken again.
#[test]
fn a_word_that_comes_twice_is_taken_once() {
    let mut bench = Bench::new(5, 0, 0);
    for value in 1..=3 {
        bench.host.send(HostCommand::ManualOutput(OutputChange { channel: 3, value })).expect("room");
        // no report comes through for 150 ms
        for _ in 0..1500 {
            bench.now_us += 100;
            let mut bytes = [0; 10];
            let count = bench.host.transmit(bench.now_us, &mut bytes);
            bytes[..count].iter().for_each(|&byte| bench.end.receive(byte, &mut bench.works));
        }
    }
    bench.until(|b| b.host.status().outputs[3] == 3);
    assert_eq!(bench.works.by_hand, [1, 2, 3]);
    assert!(bench.host.line_counts().retransmitted > 0, "words were sent again");
}

#[test]
fn a_card_that_was_restarted_is_noticed() {
    let mut bench = Bench::new(5, 0, 0);
    bench.run_to(Rate::ONE, 100, 0, 200);
    bench.end = CardEndpoint::new();
    bench.works.open = false;
    for _ in 0..3000 {
        bench.step();
        while bench.host.next_period() {}
    }
    assert_eq!(bench.host.fault(), Some(LinkError::Restarted));
}

#[test]
fn a_card_of_another_protocol_version_is_refused() {
    let mut bench = Bench::new(5, 0, 0);
    (bench.host, bench.end) = (Box::new(HostEndpoint::new(9)), CardEndpoint::new());
    bench.works = Works::new();
    bench.works.identity.protocol = PROTOCOL + 1;
    for _ in 0..3000 {
        bench.step();
    }
    assert_eq!(bench.host.fault().map(|fault| fault.number()), Some("E3007"));
}

/// The line is down for longer than the card can store the entries of its reports.
#[test]
fn reports_that_the_card_could_not_keep_are_noticed() {
    let mut bench = Bench::new(5, 0, 0);
    bench.run_to(Rate::ONE, 100, 0, 200);
    for _ in 0..2000 {
        bench.works.period();
        bench.works.status.outputs[2] ^= 1;
        bench.end.push_period(&bench.works.status);
    }
    for _ in 0..3000 {
        bench.step();
        while bench.host.next_period() {}
    }
    assert_eq!(bench.host.fault().map(|fault| fault.number()), Some("E3005"));
}

#[test]
fn a_record_at_constant_speed_costs_little() {
    let mut bench = Bench::new(5, 0, 0);
    bench.run_to(Rate::ONE, 1000, 0, 1200);
    let line = bench.host.line_counts();
    let cost = (line.written + line.read) as f64 / bench.works.log.len() as f64;
    assert!(cost < 12.0, "{cost} bytes a period, {line:?}");
    assert_eq!((line.damaged, line.retransmitted), (0, 0));
    let outputs = bench.works.status.outputs;
    assert_eq!(outputs, [0; channel::COUNT]);
}

/// Limits of a machine that stops within some tens of periods.
fn limits<const A: usize>() -> RateLimits<A> {
    let axis = PulseLimits { velocity: 200 << 32, acceleration: 12 << 32, jerk: 1 << 32 };
    RateLimits::new(13, 1 << 15, [axis; A]).expect("valid")
}
