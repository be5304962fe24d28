//! The order of motion and instructions in the card's own time line, under any delay (GMC, *Beyond the source*).
//!
//! Words and reports take their time, the rate overtakes everything else, and the operator holds and reverses whenever
//! he likes: also while an instruction is on its way that the host sent on an older report. The host's gates are the
//! core's own.
//!
//! Invariant: what is checked is taken from the card's reports as they are made, not as the host hears of them.

use crate::common;

use std::collections::VecDeque;

use common::{TestCard, levels, opened, rates};
use proptest::prelude::*;
use retrace_core::gate::Gates;
use retrace_core::{Distance, Flags, Place, Rate, Record, RecordIndex};
use retrace_link::{CardCore, CardStatus, HostCommand, InputWait, Instruction, OutputChange, channel};

/// Records of a run; they fit the window, so that nothing has to be sent twice.
const RECORDS: u32 = 56;

/// The job: instructions before these records, and how long they take.
#[derive(Debug, Clone)]
struct Job {
    start: u32,
    /// Offset, periods, and the periods after which the input that it waits for comes, if it waits for one.
    markers: Vec<(u32, u32, Option<u32>)>,
    /// Periods that words take, rates take, and reports take.
    delays: [usize; 3],
    /// The instruction is sent as soon as it is in hand, and not when the host hears of the place.
    early: bool,
    /// Rates, and for how many periods.
    rates: Vec<(Rate, u32)>,
}

fn jobs() -> impl Strategy<Value = Job> {
    let rate = prop_oneof![3 => Just(Rate::ONE), 2 => Just(Rate::ZERO), 2 => Just(-Rate::ONE),
        1 => Just(Rate::ONE / 5), 1 => rates(-2, 2)];
    let waits = prop_oneof![2 => Just(None), 1 => (0u32..12).prop_map(Some)];
    let markers = prop::collection::btree_map(0..=RECORDS, (0u32..9, waits), 0..6);
    let rates = prop::collection::vec((rate, 1u32..30), 0..30);
    (any::<u32>(), markers, [0usize..9, 0usize..4, 0usize..9], any::<bool>(), rates).prop_map(
        |(start, markers, delays, early, rates)| {
            let markers = markers.into_iter().map(|(offset, (periods, waits))| (offset, periods, waits)).collect();
            Job { start, markers, delays, early, rates }
        },
    )
}

/// A line with a delay.
struct Line<T>(VecDeque<Vec<T>>);

impl<T> Line<T> {
    fn new(delay: usize) -> Self {
        Self((0..delay).map(|_| Vec::new()).collect())
    }

    /// What was sent in this period goes in, what arrives in it comes out.
    fn pass(&mut self, sent: Vec<T>) -> Vec<T> {
        self.0.push_back(sent);
        self.0.pop_front().unwrap_or_default()
    }
}

/// The host: gates, and what it has sent.
struct Host<'j> {
    job: &'j Job,
    gates: Gates,
    done: usize,
    sent: u32,
    asked: bool,
}

impl Host<'_> {
    fn instruction(&self, n: usize) -> Instruction {
        let (offset, periods, waits) = self.job.markers[n];
        let until = waits.map(|_| InputWait::new(5, true, 0));
        let place = self.job.start.wrapping_add(offset);
        let number = n as u32 + 1;
        let mut instruction =
            Instruction { number, place: RecordIndex::new(place), periods, until, count: 1, ..Instruction::default() };
        instruction.changes[0] = OutputChange { channel: channel::TOOL, value: number as i32 };
        instruction
    }

    fn turn(&mut self, report: &CardStatus<2>) -> Vec<HostCommand<2>> {
        let mut commands = Vec::new();
        if self.gates.acknowledge(report.executed).is_some() {
            (self.done, self.asked) = (self.done + 1, false);
        }
        if self.done < self.job.markers.len() {
            let instruction = self.instruction(self.done);
            self.gates.accept(instruction.number, instruction.place);
            let due = self.gates.c_open(report.place, report.at_rest);
            if !self.asked && (due || self.job.early) {
                self.gates.mark_sent();
                self.asked = true;
                commands.push(HostCommand::Instruction(instruction));
            }
        }
        while self.sent != self.job.start.wrapping_add(RECORDS) && self.gates.b_open(RecordIndex::new(self.sent)) {
            commands
                .push(HostCommand::Ahead { place: RecordIndex::new(self.sent), record: record(self.job, self.sent) });
            self.sent = self.sent.wrapping_add(1);
        }
        commands
    }
}

/// One pulse on one axis, and a planned stop before every instruction.
fn record(job: &Job, place: u32) -> Record<2> {
    let next = place.wrapping_add(1).wrapping_sub(job.start);
    let stops = next == RECORDS || job.markers.iter().any(|&(offset, ..)| offset == next);
    Record { increments: [1, -3], flags: if stops { Flags::REST } else { Flags::NONE }, ..Record::default() }
}

/// The card's time line, as it is.
struct Judge<'j> {
    job: &'j Job,
    /// Since when the instruction that is not executed yet has been at the outputs.
    begun: Option<u64>,
}

impl Judge<'_> {
    fn look(&mut self, before_it: &CardStatus<2>, now: &CardStatus<2>) {
        let next = self.job.markers.get(before_it.executed as usize);
        let Some(&(offset, periods, _)) = next else { return };
        let place = self.job.start.wrapping_add(offset);
        if now.outputs[usize::from(channel::TOOL)] == before_it.executed as i32 + 1 && self.begun.is_none() {
            assert_eq!(before_it.place, Place::start_of(RecordIndex::new(place)), "it began beside its place");
            self.begun = Some(before_it.period);
        }
        if let Some(begun) = self.begun {
            let done = now.executed != before_it.executed;
            // a word that was taken has not moved anything: the increments are the last period's
            let stood = now.increments == [0; 2] || now.period == before_it.period;
            assert!(stood, "motion beside an instruction");
            assert!(!done || now.period - begun >= u64::from(periods));
        }
        if now.executed == before_it.executed {
            assert!(
                now.place.distance_to(Place::start_of(RecordIndex::new(place))) >= Distance::ZERO,
                "motion on the wrong side"
            );
        } else {
            assert_eq!(now.executed, before_it.executed + 1);
            self.begun = None;
        }
    }
}

/// Plays a job to its end.
fn run(job: &Job) {
    let mut card: TestCard = opened(job.start);
    let mut host = Host { job, gates: Gates::default(), done: 0, sent: job.start, asked: false };
    let mut judge = Judge { job, begun: None };
    let (mut commands, mut rates) = (Line::new(job.delays[0]), Line::new(job.delays[1]));
    let mut reports = Line::new(job.delays[2]);
    let mut keep_alive = *card.status();
    let end = (Rate::ONE, 2000);
    let asked = job.rates.iter().copied().chain([end]).flat_map(|(rate, n)| (0..n).map(move |_| rate));
    let mut last = None;
    for rate in asked {
        let command = (last != Some(rate)).then_some(HostCommand::rate(rate));
        last = Some(rate);
        for command in rates.pass(command.into_iter().collect()) {
            card.accept(command).expect("a rate");
        }
        for command in commands.pass(host.turn(&keep_alive)) {
            let was = *card.status();
            card.accept(command).expect("every word of this host is in order");
            judge.look(&was, card.status());
        }
        card.keep_alive();
        let was = *card.status();
        let waits = was.executed as usize;
        let due = judge.begun.zip(job.markers.get(waits).and_then(|m| m.2));
        let input = due.is_some_and(|(begun, after)| was.period >= begun + u64::from(after));
        card.run_period(levels(if input { common::PLAIN } else { 0 }));
        judge.look(&was, card.status());
        for report in reports.pass(vec![*card.status()]) {
            keep_alive = report;
        }
        if was.executed as usize == job.markers.len()
            && was.place == Place::start_of(RecordIndex::new(job.start.wrapping_add(RECORDS)))
            && was.at_rest
        {
            break;
        }
    }
    let status = card.status();
    assert_eq!(status.executed as usize, job.markers.len(), "it came to its end");
    assert!(!status.reached.is_before(RecordIndex::new(job.start.wrapping_add(RECORDS))) && status.alarm.is_none());
    if status.place == Place::start_of(RecordIndex::new(job.start.wrapping_add(RECORDS))) {
        assert_eq!(status.counts, [i64::from(RECORDS), -3 * i64::from(RECORDS)]);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Every delay, every duration, every hold and reversal: nothing stands on the wrong side, and the job comes to its
    /// end.
    #[test]
    fn no_motion_stands_on_the_wrong_side(job in jobs()) {
        run(&job);
    }
}

/// The case that the instruction's place is for: on an old report of rest the host sends it, and a reverse run
/// overtakes it.
#[test]
fn a_reverse_run_that_overtakes_an_instruction_defers_it() {
    let rates = vec![(Rate::ONE, 24), (-Rate::ONE, 60), (Rate::ZERO, 20)];
    run(&Job { start: 7, markers: vec![(16, 5, None)], delays: [8, 0, 4], early: false, rates });
}

/// An instruction that comes before the records in front of it is kept also while the cursor runs into a planned stop
/// at full rate.
#[test]
fn an_instruction_beyond_the_window_does_not_shorten_the_road() {
    let rates = vec![(Rate::ONE, 17), (-Rate::ONE, 1), (Rate::ONE, 1)];
    run(&Job { start: 0, markers: vec![(3, 0, Some(7)), (4, 0, None)], delays: [3, 0, 6], early: true, rates });
}
