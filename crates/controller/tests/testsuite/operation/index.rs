//! The index is written ahead: the card does not receive what is not durable in it, and waiting for it does not change
//! the run.
//!
//! Invariant: the index is slower than the path, and that changes nothing.

use std::sync::mpsc::{Sender, channel};
use std::thread;
use std::time::Duration;

use retrace_controller::{JobStart, run_job};
use retrace_core::{Rate, RecordIndex};
use retrace_journal::{DurablePlace, IndexEntry, IndexWriter, JournalConfig, PlaceMark};
use retrace_link::{CardStatus, CommandRefusal, HostCommand, MotionCard, PathStart};

use super::jobs::{AXES, Decoder, Log, boundary, card, complete, machine, options};

const PROGRAM: &str = "G21 G64 P0.05 F2400\nG1 X20\nM3\nG1 X0 Y5\nG1 X7 Y2\nM62 P2\nG1 X0 Y0\nG4 P0.1\nG1 Z3\nM2\n";

/// Index entries on their way to a thread that stores them.
struct Notes(Sender<IndexEntry>);

impl IndexWriter for Notes {
    fn write(&mut self, note: IndexEntry) {
        // The receiver may be gone at the end.
        let _ = self.0.send(note);
    }
}

/// A card that accepts nothing that is not durable.
struct Strict<C>(C, DurablePlace);

impl<C: MotionCard<AXES>> MotionCard<AXES> for Strict<C> {
    type Fault = C::Fault;

    fn window(&self) -> u32 {
        self.0.window()
    }
    fn send(&mut self, word: HostCommand<AXES>) -> Result<(), CommandRefusal> {
        if let HostCommand::Ahead { place, .. } = word {
            assert!(place.is_before(self.1.place()), "record {place}, durable up to {}", self.1.place());
        }
        self.0.send(word)
    }
    fn run_period(&mut self) -> Result<&CardStatus<AXES>, Self::Fault> {
        self.0.run_period()
    }
    fn begin_path(&mut self, start: PathStart) -> Result<(), Self::Fault> {
        self.0.begin_path(start)
    }
    fn status(&self) -> &CardStatus<AXES> {
        self.0.status()
    }
}

/// Runs with an index that takes `slow` to become durable. Returns the telemetry and the entries.
fn kept(script: &str, slow: Duration) -> (Log, Vec<IndexEntry>, [i64; AXES]) {
    let machine = machine(60.0);
    let durable = DurablePlace::starting_at(RecordIndex::new(0));
    let (sender, receiver) = channel::<IndexEntry>();
    let ahead = durable.clone();
    let keeper = thread::spawn(move || {
        let mut notes = Vec::new();
        while let Ok(note) = receiver.recv() {
            notes.push(note.clone());
            thread::sleep(slow);
            if let IndexEntry::Mark(mark) = note {
                ahead.advance(mark.place);
            }
        }
        notes
    });
    let keeping = JournalConfig { index: Box::new(Notes(sender)), durable: Some(durable.clone()) };
    let options = options(&machine, script, JobStart::First, keeping);
    let mut log = Log::default();
    let strict = Strict(card(&machine), durable);
    let end = run_job(&machine, Decoder::new(PROGRAM), options, strict, &mut log).expect("a job");
    (log, keeper.join().expect("it ends"), end.card.status().counts)
}

#[test]
fn waiting_for_the_index_changes_nothing_and_nothing_runs_ahead_of_it() {
    let script = "at 0.5s reverse 100%\nafter 0.3s leave\nafter 0.3s override 140%\n";
    let (_, plain) = complete(&machine(60.0), PROGRAM, script);
    for slow in [Duration::ZERO, Duration::from_millis(2)] {
        let (log, ..) = kept(script, slow);
        assert!(log.events == plain.events);
        let rows = |log: &Log| log.periods.iter().map(|p| (p.place, p.counts, p.rate, p.mode)).collect::<Vec<_>>();
        assert!(rows(&log) == rows(&plain), "the very same run");
    }
}

#[test]
fn marks_come_in_order_often_enough_and_say_what_holds_there() {
    let (log, notes, counts) = kept("", Duration::ZERO);
    let marks: Vec<PlaceMark> =
        notes.iter().filter_map(|note| if let IndexEntry::Mark(mark) = note { Some(*mark) } else { None }).collect();
    let mut last = PlaceMark::default();
    for mark in &marks {
        assert!((1..=64).contains(&mark.place.since(last.place)), "{last:?} {mark:?}");
        let there = log.periods.iter().find(|p| p.place == boundary(mark.place.number())).expect("it was run");
        assert_eq!((mark.counts[..AXES].to_vec(), mark.line), (there.counts.to_vec(), there.line));
        assert!(mark.block >= last.block && mark.block == u64::from(mark.line), "{mark:?}");
        last = *mark;
    }
    assert_eq!(last.counts[..AXES], counts, "the end is marked");
    assert!(marks.len() < log.periods.len() / 20, "and not every record");
}

#[test]
fn an_override_is_noted_where_it_counts() {
    let (log, notes, _) = kept("at 0.2s override 140%\n", Duration::ZERO);
    let noted = notes.iter().position(|note| matches!(note, IndexEntry::Override { .. })).expect("a note");
    let IndexEntry::Override { place, planned } = notes[noted] else { unreachable!() };
    assert_eq!(planned, (Rate::ONE * 7 + Rate::from_units(2)) / 5);
    let told = log.event(|h| matches!(h, retrace_controller::EventKind::OverridePlanned(_)));
    assert_eq!(told.place.record, place);
    let marked_before = |note: &IndexEntry| matches!(note, IndexEntry::Mark(mark) if !place.is_before(mark.place));
    assert!(notes[..noted].iter().all(marked_before), "before any mark beyond it");
}
