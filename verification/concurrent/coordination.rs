//! A model of the two threads of GMC-7 and a card that acknowledges late, built on the real gates. No crate ships these
//! threads: the product polls the same gates in its one motion thread. The threads that ship are modelled in
//! `verification/loom/src/models`.
//!
//! The *coarse* thread sends records and sleeps at a front marker on the condition variable until the instruction is
//! done. The *coordinator* sends the instruction when K holds: the motion ahead of it is reported executed, and what
//! was switched before. A mutex guards the gates and the card's last report. The card executes motion and switching in
//! parallel, so that whatever is sent too early is also executed too early.
//!
//! Invariant: in the card's own time line every instruction begins and ends between the record before its marker and
//! the record behind it; every thread ends; the coordinator is woken only when K holds, unless the job is disturbed.

use std::collections::VecDeque;
use std::fmt;

use retrace_core::gate::Gates;
use retrace_core::{Place, RecordIndex};

use crate::sync::{Arc, Condvar, Mutex, MutexGuard, thread};

/// Records with exclusive instructions between them, and the card that runs them.
#[derive(Clone, Debug)]
pub struct Job {
    /// Place number of the first record.
    pub start: u32,
    /// Number of records.
    pub records: u32,
    /// Records, counted from the first, before which an instruction is executed, in order; the number of records:
    /// behind the last.
    pub markers: Vec<u32>,
    /// Number of reports that the card withholds while it has anything to do.
    pub lag: usize,
    /// Number of its first turns in which the card wakes all threads without a cause, as a condition variable may.
    pub disturbed: u32,
}

/// Event of the card, in its own time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Event {
    /// Ran the record of that place.
    Motion(u32),
    /// Began the instruction of that number.
    Begin(u32),
    /// Completed the instruction of that number.
    End(u32),
}

/// Outcome of one execution.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Outcome {
    /// Instructions for which K held as soon as their marker was set.
    pub due_at_once: u32,
    /// Number of times that the coordinator was woken.
    pub woken: u32,
}

impl fmt::Debug for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "due at once {} woken {}", self.due_at_once, self.woken)
    }
}

impl Job {
    /// Runs the three threads and checks the card's time line.
    ///
    /// # Panics
    /// Where a record and an instruction are executed in the wrong order, or the coordinator is woken without K.
    #[must_use]
    pub fn run(self) -> Outcome {
        let host = Arc::new(Host::new(self.start, self.disturbed == 0));
        let coarse = thread::spawn({
            let (host, job) = (Arc::clone(&host), self.clone());
            move || job.feed(&host)
        });
        let coordinator = thread::spawn({
            let (host, count) = (Arc::clone(&host), self.markers.len());
            move || (1..).take(count).map(|number| host.coordinate(number)).sum()
        });
        let line = Card::new(self.start).run(&host, &self);
        let due_at_once = coarse.join().expect("the coarse thread does not panic");
        let woken = coordinator.join().expect("the coordinator does not panic");
        assert_eq!(line, self.as_programmed());
        Outcome { due_at_once, woken }
    }

    /// Runs the coarse thread. Returns the number of instructions that were due at once.
    fn feed(&self, host: &Host) -> u32 {
        let mut due_at_once = 0;
        let mut markers = (1..).zip(&self.markers).peekable();
        for record in 0..=self.records {
            let place = self.start.wrapping_add(record);
            while let Some((number, _)) = markers.next_if(|(_, marker)| **marker == record) {
                due_at_once += u32::from(host.pass_marker(number, place));
            }
            if record < self.records {
                host.wire(|wire| wire.records.push_back(place));
            }
        }
        due_at_once
    }

    fn as_programmed(&self) -> Vec<Event> {
        let mut line = Vec::new();
        let mut markers = (1..).zip(&self.markers).peekable();
        for record in 0..=self.records {
            while let Some((number, _)) = markers.next_if(|(_, marker)| **marker == record) {
                line.extend([Event::Begin(number), Event::End(number)]);
            }
            if record < self.records {
                line.push(Event::Motion(self.start.wrapping_add(record)));
            }
        }
        line
    }
}

/// Data that the mutex guards.
struct SharedState {
    gates: Gates,
    /// The card's last report.
    report: Report,
    /// The instruction that was sent and is not reported complete.
    sent: Option<u32>,
}

#[derive(Clone, Copy)]
struct Report {
    place: u32,
    at_rest: bool,
    executed: u32,
}

impl SharedState {
    /// Whether the accepted instruction may be sent: gate C.
    fn is_due(&self) -> bool {
        self.gates.c_open(Place::start_of(RecordIndex::new(self.report.place)), self.report.at_rest)
    }

    /// Records that the sent instruction is reported executed; false where it is not.
    fn acknowledge(&mut self) -> bool {
        let done = self.gates.acknowledge(self.report.executed).is_some();
        if done {
            self.sent = None;
        }
        done
    }

    /// K: all motion and all switching that was sent is reported executed, and the coordinator has something to do.
    fn k(&self) -> bool {
        self.is_due() || self.sent == Some(self.report.executed)
    }
}

/// Messages on their way to the card.
#[derive(Default)]
struct Wire {
    records: VecDeque<u32>,
    instructions: VecDeque<u32>,
}

struct Host {
    state: Mutex<SharedState>,
    /// K holds, or the instruction is done.
    changed: Condvar,
    wire: Mutex<Wire>,
    arrived: Condvar,
    /// Whether no thread is woken without a cause.
    is_undisturbed: bool,
}

impl Host {
    fn new(start: u32, is_undisturbed: bool) -> Self {
        let report = Report { place: start, at_rest: true, executed: 0 };
        Self {
            state: Mutex::new(SharedState { gates: Gates::default(), report, sent: None }),
            changed: Condvar::new(),
            wire: Mutex::new(Wire::default()),
            arrived: Condvar::new(),
            is_undisturbed,
        }
    }

    fn state(&self) -> MutexGuard<'_, SharedState> {
        self.state.lock().expect("no thread panics")
    }

    fn sleep<'a>(&'a self, state: MutexGuard<'a, SharedState>) -> MutexGuard<'a, SharedState> {
        self.changed.wait(state).expect("no thread panics")
    }

    /// Puts something on the wire.
    fn wire(&self, put: impl FnOnce(&mut Wire)) {
        put(&mut self.wire.lock().expect("no thread panics"));
        self.arrived.notify_one();
    }

    /// Passes a front marker in the coarse thread: shuts gate B, and sleeps until the instruction is done. Returns
    /// whether K held at once.
    fn pass_marker(&self, number: u32, place: u32) -> bool {
        let mut state = self.state();
        assert!(state.gates.accept(number, RecordIndex::new(place)), "gate A: one instruction at a time");
        let due = state.k();
        if due {
            // the card had reported before the marker was set, and will not report again
            self.changed.notify_all();
        }
        while !state.gates.b_open(RecordIndex::new(place)) {
            state = self.sleep(state);
        }
        due
    }

    /// Coordinates one instruction: sends it through gate C, and waits for its acknowledgement. Returns how often the
    /// thread was woken.
    fn coordinate(&self, number: u32) -> u32 {
        let mut woken = 0;
        let mut state = self.state();
        while !state.is_due() {
            state = self.sleep(state);
            assert!(state.k() || !self.is_undisturbed, "woken although K does not hold");
            woken += 1;
        }
        state.gates.mark_sent();
        state.sent = Some(number);
        self.wire(|wire| wire.instructions.push_back(number));
        while !state.acknowledge() {
            state = self.sleep(state);
            assert!(state.k() || !self.is_undisturbed, "woken although K does not hold");
            woken += 1;
        }
        self.changed.notify_all();
        woken
    }

    /// Applies a report from the card.
    fn apply_report(&self, report: Report) {
        let mut state = self.state();
        state.report = report;
        if state.k() {
            self.changed.notify_all();
        }
    }
}

struct Card {
    place: u32,
    running: Option<u32>,
    executed: u32,
    line: Vec<Event>,
    /// Reports that are not sent yet.
    reports: VecDeque<Report>,
}

impl Card {
    fn new(start: u32) -> Self {
        Self { place: start, running: None, executed: 0, line: Vec::new(), reports: VecDeque::new() }
    }

    /// Serves the wire until the whole job is executed and reported; returns its time line.
    fn run(mut self, host: &Host, job: &Job) -> Vec<Event> {
        let end = job.start.wrapping_add(job.records);
        let done =
            |card: &Self| card.place == end && card.executed as usize == job.markers.len() && card.reports.is_empty();
        for turn in 0.. {
            if done(&self) {
                break;
            }
            if turn < job.disturbed {
                host.changed.notify_all();
            }
            let acted = self.turn(host);
            if (self.reports.len() > job.lag || !acted)
                && let Some(report) = self.reports.pop_front()
            {
                host.apply_report(report);
            }
        }
        self.line
    }

    /// Runs one turn: at most one record, and one step of switching. Returns false where there was nothing to do. With
    /// nothing to report either, waits for the wire.
    fn turn(&mut self, host: &Host) -> bool {
        let (record, at_rest, instruction) = self.receive(host);
        if record.is_none() && instruction.is_none() && self.running.is_none() {
            return false;
        }
        if let Some(record) = record {
            self.line.push(Event::Motion(record));
            self.place = record.wrapping_add(1);
        }
        if let Some(number) = self.running.take() {
            self.line.push(Event::End(number));
            self.executed = number;
        } else if let Some(number) = instruction {
            self.line.push(Event::Begin(number));
            self.running = Some(number);
        }
        self.reports.push_back(Report { place: self.place, at_rest, executed: self.executed });
        true
    }

    /// Receives the next record, whether motion rests behind it, and the next instruction unless one is running.
    fn receive(&self, host: &Host) -> (Option<u32>, bool, Option<u32>) {
        let is_idle = self.running.is_none() && self.reports.is_empty();
        let mut wire = host.wire.lock().expect("no thread panics");
        while is_idle && wire.records.is_empty() && wire.instructions.is_empty() {
            wire = host.arrived.wait(wire).expect("no thread panics");
        }
        let record = wire.records.pop_front();
        let instruction = if self.running.is_none() { wire.instructions.pop_front() } else { None };
        (record, wire.records.is_empty(), instruction)
    }
}
