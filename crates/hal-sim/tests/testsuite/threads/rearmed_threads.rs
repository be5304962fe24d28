//! Threads that the path comes back to, and that are armed again (SPN-22).

use super::taps::groove_bound;
use super::*;
use retrace_core::Place;
use retrace_link::{ArmedStretch, CommandRefusal};

/// Records between the two threads.
const GAP: u32 = 120;

/// Two threads with the same records and a move between them. Both lie on their helix in every period.
struct TwoThreads {
    bench: Bench,
    start: GearStart,
    worst: f64,
}

impl TwoThreads {
    fn new(case: ThreadCase, direction: i32) -> Self {
        let mut bench = Bench::new(case, STEADY);
        let start = GearStart { reverse_share: 77, control: SpindleControl::Held, ..bench.start() };
        bench.begin_with(direction, start);
        Self { bench, start, worst: 0.0 }
    }

    fn length(&self) -> u32 {
        self.start.length
    }

    fn second(&self) -> u32 {
        self.length() + GAP
    }

    fn status(&self) -> &retrace_link::CardStatus<1> {
        self.bench.card.status()
    }

    fn is_geared(&self, place: u32) -> bool {
        place < self.length() || place >= self.second()
    }

    fn record(&self, place: u32) -> Record<1> {
        let (length, at) =
            (self.length(), if place < self.length() { place } else { place - self.second().min(place) });
        let increment = if self.is_geared(place) { self.bench.increments[at as usize] } else { 1 };
        let rests = [length, self.second(), self.second() + length].contains(&(place + 1));
        let flags = if self.is_geared(place) { Flags::GEARED } else { Flags::NONE };
        let flags = flags.with(if rests { Flags::REST } else { Flags::NONE });
        Record { increments: [increment], flags, line: 1, ..Record::default() }
    }

    /// Counts before a place.
    fn counts_at(&self, place: u32) -> i64 {
        (0..place).map(|place| i64::from(self.record(place).increments[0])).sum()
    }

    fn send_ahead(&mut self, end: u32) {
        for number in self.status().high.number()..end {
            let command = HostCommand::Ahead { place: RecordIndex::new(number), record: self.record(number) };
            if self.bench.card.send(command).is_err() {
                break;
            }
        }
    }

    fn send_behind(&mut self, oldest: u32) {
        while self.status().low.number() > oldest {
            let place = self.status().low - 1;
            let rests = place.number() == 0 || self.record(place.number() - 1).flags.contains(Flags::REST);
            let command = HostCommand::Behind { place, record: self.record(place.number()), rests };
            if self.bench.card.send(command).is_err() {
                break;
            }
        }
    }

    fn request(&mut self, rate: Rate) {
        self.bench.card.send(HostCommand::rate(rate)).expect("a rate");
    }

    /// Runs with records from `oldest` to `end`, until it is so.
    fn run(&mut self, [oldest, end]: [u32; 2], is_so: impl Fn(&retrace_link::CardStatus<1>) -> bool) {
        for _ in 0..60_000 {
            self.send_behind(oldest);
            self.send_ahead(end);
            let from = self.status().place;
            let was_engaged = self.status().spindle.gear == GearState::Engaged;
            let before = self.status().counts[0];
            self.bench.card.run_period().expect("no alarm");
            let angle = self.bench.card.machine().spindle().expect("a spindle").angle();
            let place = from.record.number();
            let at = if place < self.length() { place } else { place.saturating_sub(self.second()) } as usize;
            let straight = self.bench.ramp + 2..self.bench.increments.len() - self.bench.ramp - 2;
            if self.is_geared(place) && from.fraction != 0 {
                assert!(was_engaged || self.status().spindle.gear == GearState::Engaged, "passed by rate: {from:?}");
            }
            if was_engaged && straight.contains(&at) {
                let first = if place < self.length() { 0 } else { self.second() };
                let direction = if self.bench.is_left { -1.0 } else { 1.0 };
                let turns = (before - self.counts_at(first)) as f64 / self.bench.case.pitch - direction * angle;
                self.worst = self.worst.max((turns - turns.round()).abs() * self.bench.case.pitch);
            }
            if is_so(self.status()) {
                return;
            }
        }
        panic!("it does not come: {:?}", self.status());
    }

    /// Runs until the cursor rests at this place.
    fn run_to(&mut self, [oldest, end]: [u32; 2], place: u32) {
        let there = Place::start_of(RecordIndex::new(place));
        self.run([oldest, end], |status| status.at_rest && status.place == there);
        assert_eq!(self.status().counts[0], self.counts_at(place));
    }

    /// Cuts both threads, and goes back to the beginning of the second one.
    fn cut_both(&mut self) {
        let (length, second) = (self.length(), self.second());
        self.run_to([0, second], second);
        let spindle = Some(SpindleTask::Gear(self.start));
        let instruction = Instruction { number: 2, place: RecordIndex::new(second), spindle, ..Instruction::default() };
        self.bench.card.send(HostCommand::Instruction(instruction)).expect("at its place");
        self.run([length, second], |status| status.executed == 2);
        self.run_to([length, second + length], second + length);
        self.request(-Rate::ONE);
        self.run([length, second + length], |status| status.spindle.gear == GearState::Waiting);
        self.run_to([length, second + length], length);
    }

    fn trim(&mut self, high: u32) {
        self.bench.card.send(HostCommand::Trim { high: RecordIndex::new(high) }).expect("the cursor is before it");
    }

    fn arm(&mut self, first: u32, is_passed: bool, barrier: Option<u32>) -> Result<(), CommandRefusal> {
        let speed = (self.bench.case.rpm * 1000.0) as i32 * if self.bench.is_left { -1 } else { 1 };
        let [first, barrier] = [Some(first), barrier].map(|place| place.map(RecordIndex::new));
        let first = first.expect("a place");
        let armed = ArmedStretch { first, start: self.start, speed, is_passed, barrier };
        self.bench.card.send(HostCommand::ArmStretch(armed))
    }
}

/// Two threads are passed backward and cut again, one after the other, each on its helix and exact in counts.
#[test]
fn an_earlier_thread_is_passed_backward_and_cut_again() {
    for direction in [1, -1] {
        let case = ThreadCase { turns: 12, ..CASE };
        let mut threads = TwoThreads::new(case, direction);
        let (length, second) = (threads.length(), threads.second());
        threads.cut_both();
        // The end of the first one is a barrier, and its records are not taken, until it is armed again.
        let behind = HostCommand::Behind {
            place: RecordIndex::new(length - 1),
            record: threads.record(length - 1),
            rests: false,
        };
        assert_eq!(threads.bench.card.send(behind), Err(CommandRefusal::Unsupported));
        for round in 0..2 {
            // Not as long as records of the other one are held, that would then be of none that is armed.
            assert_eq!(threads.arm(0, true, None), Err(CommandRefusal::OutOfOrder));
            threads.trim(second);
            threads.arm(0, true, None).expect("the cursor is at its end");
            assert_eq!(threads.status().spindle.armed_again, 2 * round + 1);
            // Forward from there the other one is not passed: its records are not taken.
            threads.request(Rate::ONE);
            threads.run_to([length, second + length], second);
            for _ in 0..300 {
                threads.run([length, second + length], |_| true);
            }
            assert_eq!(threads.status().counts[0], threads.counts_at(second));
            assert_eq!(threads.status().high.number(), second);
            threads.request(-Rate::ONE);
            threads.run_to([length, second + length], length);
            threads.run([0, second], |status| status.spindle.gear == GearState::Waiting);
            threads.run_to([0, second], 0);
            threads.request(Rate::ONE);
            threads.run_to([0, second], second);
            threads.arm(second, false, Some(length)).expect("the cursor is in front of it");
            // Nor is the first one passed backward by rate, though its records are held.
            assert!(threads.status().low.number() < length);
            threads.request(-Rate::ONE);
            threads.run_to([length, second], length);
            for _ in 0..300 {
                threads.run([length, second], |_| true);
            }
            assert_eq!(threads.status().counts[0], threads.counts_at(length));
            threads.request(Rate::ONE);
            threads.run_to([length, second + length], second + length);
            threads.request(-Rate::ONE);
            threads.run([length, second + length], |status| status.spindle.gear == GearState::Waiting);
            threads.run_to([length, second + length], length);
        }
        assert!(threads.worst <= groove_bound(&case), "{}", threads.worst);
    }
}

/// In front of a thread that another epoch has made the card forget, it is armed again, and its spindle switched on.
#[test]
fn a_thread_that_was_forgotten_is_armed_again() {
    for (direction, is_off) in [(1, false), (-1, true)] {
        let case = ThreadCase { turns: 12, ..CASE };
        let mut threads = TwoThreads::new(case, direction);
        let (length, second) = (threads.length(), threads.second());
        threads.cut_both();
        let (place, executed) = (Place::start_of(RecordIndex::new(length)), 2);
        let reached = RecordIndex::new(second + length);
        threads.request(Rate::ZERO);
        threads.run([length, second], |status| status.at_rest);
        let elsewhere = PathStart { executed, ..PathStart::at(RecordIndex::new(7)) };
        threads.bench.card.begin_path(elsewhere).expect("it rests");
        let back = PathStart { place, rests: true, reached, executed, keeps_state: true };
        threads.bench.card.begin_path(back).expect("it rests");
        assert_eq!(threads.status().spindle.gear, GearState::Off);
        if is_off {
            let change = OutputChange { channel: channel::SPINDLE, value: 0 };
            threads.bench.card.send(HostCommand::ManualOutput(change)).expect("a channel");
        }
        threads.request(Rate::ONE);
        threads.run_to([length, second + length], second);
        assert_eq!(threads.status().high.number(), second, "its records are not taken");
        threads.arm(second, false, Some(length)).expect("the cursor is in front of it");
        threads.run_to([length, second + length], second + length);
        assert_eq!(threads.status().outputs[usize::from(channel::SPINDLE)], direction);
        assert!(threads.worst <= groove_bound(&case), "{}", threads.worst);
    }
}

/// Nothing is armed that does not fit, while another thread has the cursor, or where the cursor is elsewhere.
#[test]
fn a_thread_is_armed_again_only_where_it_can_be_entered() {
    let mut threads = TwoThreads::new(ThreadCase { turns: 12, ..CASE }, 1);
    let (length, second) = (threads.length(), threads.second());
    threads.run([0, second], |status| status.spindle.gear == GearState::Engaged);
    assert_eq!(threads.arm(second, false, None), Err(CommandRefusal::InMotion), "another one has the cursor");
    threads.run_to([0, second], second);
    assert_eq!(threads.arm(0, true, None), Err(CommandRefusal::InMotion), "the cursor is behind its end");
    assert_eq!(threads.arm(second - 1, false, None), Err(CommandRefusal::InMotion), "the cursor is behind it");
    threads.send_ahead(second);
    assert_eq!(threads.arm(second, false, Some(length)), Ok(()), "no record behind its beginning is held");
    threads.send_ahead(second + 9);
    assert_eq!(threads.arm(second, false, Some(length)), Err(CommandRefusal::OutOfOrder));
    threads.trim(second);
    let start = threads.start;
    for wrong in [
        GearStart { control: SpindleControl::Tap(5), ..start },
        GearStart { length: 0, ..start },
        GearStart { records_per_turn: 0, ..start },
    ] {
        threads.start = wrong;
        assert_eq!(threads.arm(second, false, None), Err(CommandRefusal::Unsupported));
    }
    threads.start = start;
    for rpm in [0.0, 5000.0] {
        threads.bench.case.rpm = rpm;
        assert_eq!(threads.arm(second, false, None), Err(CommandRefusal::Unsupported), "{rpm}");
    }
    assert_eq!(threads.status().spindle.armed_again, 1);
    assert_eq!(threads.status().counts[0], threads.counts_at(length + GAP));
}
