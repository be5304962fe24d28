//! Both ends of the line, with a line between them that fails, and works that only count: what the host gives out is
//! what the card did, period by period, and every word is taken once.

use crate::dice::Dice;
use crate::works::{STARTS, Works, limits, record};
use proptest::prelude::*;
use retrace_core::{Distance, Place, Rate, Record, RecordIndex};
use retrace_link::sequence::FirstNumbers;
use retrace_link::{
    CardEndpoint, CardFailure, CardSettings, CardStatus, HostCommand, HostEndpoint, Instruction, LinkError,
    OutputChange, PROTOCOL, PathStart, channel,
};

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
        Self::starting_at(STARTS[seed as usize % STARTS.len()], seed, one_in, start)
    }

    fn starting_at((numbers, last_epoch): (FirstNumbers, u16), seed: u64, one_in: u64, start: u32) -> Self {
        let mut bench = Self {
            host: Box::new(HostEndpoint::starting_at(seed as u32, numbers)),
            end: CardEndpoint::starting_at(numbers, last_epoch),
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
    for start in STARTS {
        let mut bench = Bench::starting_at(start, 5, 0, 0);
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
}

/// A pulse that the card has lost, or made, is seen by the next report.
#[test]
fn counts_that_are_not_those_of_the_path_are_noticed() {
    for start in STARTS {
        let mut bench = Bench::starting_at(start, 5, 0, 0);
        bench.run_to(Rate::ONE, 100, 0, 200);
        bench.works.status.counts[1] += 1;
        for _ in 0..300 {
            bench.step();
            while bench.host.next_period() {}
        }
        assert_eq!(bench.host.fault(), Some(LinkError::StateMismatch));
    }
}

/// What the card has taken and could not confirm comes again, and is not taken again.
#[test]
fn a_word_that_comes_twice_is_taken_once() {
    for start in STARTS {
        let mut bench = Bench::starting_at(start, 5, 0, 0);
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
}

#[test]
fn a_card_that_was_restarted_is_noticed() {
    for start in STARTS {
        let mut bench = Bench::starting_at(start, 5, 0, 0);
        bench.run_to(Rate::ONE, 100, 0, 200);
        bench.end = CardEndpoint::new();
        bench.works.open = false;
        for _ in 0..3000 {
            bench.step();
            while bench.host.next_period() {}
        }
        assert_eq!(bench.host.fault(), Some(LinkError::Restarted));
    }
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
    for start in STARTS {
        let mut bench = Bench::starting_at(start, 5, 0, 0);
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
}

#[test]
fn a_record_at_constant_speed_costs_little() {
    for start in STARTS {
        let mut bench = Bench::starting_at(start, 5, 0, 0);
        bench.run_to(Rate::ONE, 1000, 0, 1200);
        let line = bench.host.line_counts();
        let cost = (line.written + line.read) as f64 / bench.works.log.len() as f64;
        assert!(cost < 12.0, "{cost} bytes a period, {line:?}");
        assert_eq!((line.damaged, line.retransmitted), (0, 0));
        let outputs = bench.works.status.outputs;
        assert_eq!(outputs, [0; channel::COUNT]);
    }
}

/// Every byte counts, in both directions, whatever it means.
#[test]
fn the_bytes_of_the_line_are_counted() {
    for (numbers, _) in STARTS {
        let mut host = Box::new(HostEndpoint::<3>::starting_at(1, numbers));
        let (mut bytes, mut written, mut read) = ([0; 7], 0, 0);
        for n in 0..50 {
            written += host.transmit(n * 100_000, &mut bytes) as u64;
            let received = &bytes[..n as usize % 8];
            host.receive(received, n * 100_000);
            read += received.len() as u64;
            assert_eq!((host.line_counts().written, host.line_counts().read), (written, read));
        }
        assert!(written > 20, "the host requests the identity of the card");
    }
}
