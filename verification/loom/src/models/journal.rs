//! The journal's queue between the threads that push, the writer thread and a disk that may fail.
//!
//! Runs `crates/journal/src/journal_queue.rs` and `durable_place.rs`: pushing, waiting for space and for the disk,
//! writing batch by batch, retrying, closing. The entries are the journal's own; the disk is a list.
//!
//! Invariant: every model ends with the writer's end, and compares what was pushed with what is on the disk.

use std::io;

use retrace_core::RecordIndex;
use retrace_journal::{JournalEntry, PlaceMark, PlannedRest};

use crate::durable_place::DurablePlace;
use crate::journal_queue::{BatchStore, Durability, JournalQueue};
use crate::sync::{Arc, Mutex, PoisonError, thread};

/// Shape of a model.
#[derive(Clone, Copy, Debug)]
pub struct Journal {
    /// Whether entries are synced, so that none is ever lost, or written only.
    pub durability: Durability,
    /// Capacity of the queue.
    pub capacity: usize,
    /// Number of marks that the planning thread pushes.
    pub marks: u32,
    /// Number of events that the reporting thread pushes.
    pub events: u32,
    /// Number of attempts to save, from the first, that fail; `u32::MAX`: the disk never works again.
    pub failures: u32,
    /// Whether the reporting thread waits until what it pushed is saved.
    pub waits: bool,
}

/// What was saved, in order: the place of a mark, or the block of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Saved {
    Mark(u32),
    Event(u64),
    Lost(u64),
}

#[derive(Debug)]
struct Disk {
    saved: Arc<Mutex<Vec<Saved>>>,
    failures: u32,
}

impl BatchStore for Disk {
    type Batch = Vec<Saved>;

    fn format(&mut self, entries: Vec<JournalEntry>) -> Vec<Saved> {
        let saved = |entry| match entry {
            JournalEntry::Mark(mark) => Saved::Mark(mark.place.number()),
            JournalEntry::Rest(rest) => Saved::Event(rest.block),
            JournalEntry::Lost(lost) => Saved::Lost(lost.entries),
            other => panic!("nobody pushed {other:?}"),
        };
        entries.into_iter().map(saved).collect()
    }

    fn save(&mut self, batch: &Vec<Saved>) -> io::Result<()> {
        if self.failures > 0 {
            self.failures -= u32::from(self.failures < u32::MAX);
            return Err(io::Error::other("no space left"));
        }
        self.saved.lock().unwrap_or_else(PoisonError::into_inner).extend(batch);
        Ok(())
    }

    fn advance(&mut self, batch: Vec<Saved>) -> Option<RecordIndex> {
        let place = |saved: &Saved| if let Saved::Mark(place) = saved { Some(RecordIndex::new(*place)) } else { None };
        batch.iter().rev().find_map(place)
    }
}

/// Place before the first mark.
const START: u32 = u32::MAX - 1;

fn mark(number: u32) -> JournalEntry {
    let place = RecordIndex::new(START.wrapping_add(1 + number));
    JournalEntry::Mark(PlaceMark { place, block: 0, line: 0, counts: Default::default() })
}

/// Number of events on the disk, with all entries that were lost.
fn events(saved: &[Saved]) -> u64 {
    let one = |saved: &Saved| match saved {
        Saved::Mark(_) => 0,
        Saved::Event(_) => 1,
        Saved::Lost(count) => *count,
    };
    saved.iter().map(one).sum()
}

impl Journal {
    /// Runs planning, reporting and writing, and closes the queue. Returns the number of entries that were lost.
    ///
    /// # Panics
    /// Where an entry is missing, repeated or out of order, where a place is durable that is not on the disk, or where
    /// waiting ends before everything is saved.
    #[must_use]
    pub fn run(self) -> u64 {
        let durable = DurablePlace::starting_at(RecordIndex::new(START));
        let queue = JournalQueue::with_capacity(self.durability, durable, self.capacity);
        let saved = Arc::new(Mutex::new(Vec::new()));
        let writer = thread::spawn({
            let (queue, saved, failures) = (queue.clone(), Arc::clone(&saved), self.failures);
            move || queue.write_batches(&mut Disk { saved, failures })
        });
        let planning = thread::spawn({
            let queue = queue.clone();
            move || (0..self.marks).for_each(|number| queue.push_index_entry(mark(number)))
        });
        let on_disk = || saved.lock().unwrap_or_else(PoisonError::into_inner).clone();
        for block in 0..u64::from(self.events) {
            queue.push_event(JournalEntry::Rest(PlannedRest { block }));
        }
        if self.waits {
            match queue.wait_until_saved() {
                Ok(()) => assert!(events(&on_disk()) >= u64::from(self.events), "waiting ended early"),
                Err(why) => assert!(self.failures > 0, "{why}"),
            }
        }
        // what the motion path reads
        let place = queue.durable().place().number();
        assert!(place == START || on_disk().contains(&Saved::Mark(place)), "durable, and not on the disk: {place}");
        planning.join().expect("planning does not panic");
        queue.close();
        writer.join().expect("the writer does not panic");
        self.check(&queue, &on_disk())
    }

    fn check(&self, queue: &JournalQueue, saved: &[Saved]) -> u64 {
        let marks: Vec<_> = saved.iter().filter(|saved| matches!(saved, Saved::Mark(_))).collect();
        let events: Vec<_> = saved.iter().filter(|saved| matches!(saved, Saved::Event(_))).collect();
        let lost = saved.iter().map(|saved| if let Saved::Lost(count) = saved { *count } else { 0 }).sum();
        if self.failures == u32::MAX {
            assert!(saved.is_empty() && queue.state().write_error.is_some(), "the failure is reported");
            return 0;
        }
        let place = |number: u32| Saved::Mark(START.wrapping_add(1 + number));
        assert!(marks.iter().zip(0..).all(|(mark, number)| lost > 0 || **mark == place(number)), "{saved:?}");
        assert!(events.iter().zip(0..).all(|(event, block)| lost > 0 || **event == Saved::Event(block)), "{saved:?}");
        let all = u64::from(self.marks + self.events);
        assert_eq!((marks.len() + events.len()) as u64 + lost, all, "every entry is saved, or counted: {saved:?}");
        assert!(self.durability == Durability::Written || marks.len() == self.marks as usize, "a mark is lost");
        let last = if self.marks == 0 { START } else { START.wrapping_add(self.marks) };
        assert!(lost > 0 || queue.durable().place().number() == last, "what is saved is durable");
        lost
    }
}
