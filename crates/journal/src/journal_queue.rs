//! The queue of journal entries: any thread pushes, the writer thread takes batches.
//!
//! Invariant: entries are taken in the order in which they were pushed. Entries that are needed to resume the job are
//! never lost where the motion path follows the durable place. `verification/loom` compiles this file again over the
//! model checker's locks.

use retrace_core::RecordIndex;
use std::collections::VecDeque;
use std::io;
use std::time::Duration;

use retrace_config::NumberedError;

use crate::durable_place::DurablePlace;
use crate::entry::{JournalEntry, LostEntries};
use crate::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Capacity of the queue where a thread can wait or entries can be lost.
pub(crate) const CAPACITY: usize = 4096;
/// Maximum number of entries in a batch.
const MAX_BATCH: usize = 1024;
/// Interval at which writing to a failed disk is tried again.
const RETRY_INTERVAL: Duration = Duration::from_millis(if cfg!(test) { 3 } else { 500 });
/// Time for which entries are gathered where nothing waits for them to be durable.
const GATHER_TIME: Duration = Duration::from_millis(5);

/// Durability of the journal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Durability {
    /// Synced to the disk with every batch, and the motion path follows the durable place: for a card that outlives the
    /// process. Pushing index entries never waits: there are never more than the ring's look-ahead holds.
    Synced,
    /// Written only, for a card that ends with the process. Nothing waits for it.
    Written,
}

/// A notice to the operator about the journal itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum JournalNotice {
    /// `E3020`: it cannot be written.
    Unwritable(NumberedError),
    /// It can be written again.
    Writable,
}

/// A handle to the queue. It can be cloned.
#[derive(Clone, Debug)]
pub(crate) struct JournalQueue(Arc<QueueShared>);

#[derive(Debug)]
struct QueueShared {
    state: Mutex<QueueState>,
    changed: Condvar,
    durable: DurablePlace,
    durability: Durability,
    /// Capacity where a thread can wait or entries can be lost.
    capacity: usize,
}

/// Where the writer thread saves the batches of the queue.
pub(crate) trait BatchStore {
    /// A batch in the form in which it is saved, again where that fails.
    type Batch;

    /// Formats the next entries.
    fn format(&mut self, entries: Vec<JournalEntry>) -> Self::Batch;

    /// Tries to save a batch.
    ///
    /// # Errors
    /// It is not saved.
    fn save(&mut self, batch: &Self::Batch) -> io::Result<()>;

    /// Records that the batch is saved. Returns the place of its last mark.
    fn advance(&mut self, batch: Self::Batch) -> Option<RecordIndex>;
}

#[derive(Debug, Default)]
pub(crate) struct QueueState {
    pub(crate) queue: VecDeque<JournalEntry>,
    /// Number of entries that were taken off the queue and are not saved yet.
    pub(crate) unsaved: usize,
    pub(crate) lost: u64,
    /// No more entries will be pushed.
    pub(crate) closed: bool,
    /// The writer has ended.
    pub(crate) writer_ended: bool,
    /// Error of the last attempt to write, until an attempt succeeds.
    pub(crate) write_error: Option<String>,
    pub(crate) notices: VecDeque<JournalNotice>,
}

impl JournalQueue {
    pub(crate) fn new(care: Durability, durable: DurablePlace) -> Self {
        Self::with_capacity(care, durable, CAPACITY)
    }

    pub(crate) fn with_capacity(durability: Durability, durable: DurablePlace, capacity: usize) -> Self {
        let (state, changed) = (Mutex::default(), Condvar::new());
        Self(Arc::new(QueueShared { state, changed, durable, durability, capacity }))
    }

    pub(crate) fn durability(&self) -> Durability {
        self.0.durability
    }

    pub(crate) fn durable(&self) -> &DurablePlace {
        &self.0.durable
    }

    /// Waits until everything that was pushed is saved.
    ///
    /// # Errors
    /// Why it is not saved.
    pub(crate) fn wait_until_saved(&self) -> Result<(), String> {
        let waits = |state: &mut QueueState| {
            (!state.queue.is_empty() || state.unsaved > 0) && state.write_error.is_none() && !state.writer_ended
        };
        let state = self.0.changed.wait_while(self.state(), waits).unwrap_or_else(PoisonError::into_inner);
        state.write_error.clone().map_or(Ok(()), Err)
    }

    /// Closes the queue: the writer ends when it has saved what is in it.
    pub(crate) fn close(&self) {
        self.state().closed = true;
        self.0.changed.notify_all();
    }

    /// The writer thread: saves batch by batch until the queue is closed and empty, or closed and the disk fails.
    pub(crate) fn write_batches(&self, store: &mut impl BatchStore) {
        while let Some(entries) = self.take_batch() {
            let batch = store.format(entries);
            loop {
                match store.save(&batch) {
                    Ok(()) => break,
                    Err(error) if self.batch_failed(error.to_string()) => {}
                    Err(_) => return self.end_writer(),
                }
            }
            self.batch_saved(store.advance(batch));
        }
        self.end_writer();
    }

    fn end_writer(&self) {
        self.state().writer_ended = true;
        self.0.changed.notify_all();
    }

    pub(crate) fn state(&self) -> MutexGuard<'_, QueueState> {
        self.0.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Pushes an entry of the index.
    pub(crate) fn push_index_entry(&self, entry: JournalEntry) {
        let mut state = self.wait_for_space(self.state());
        if self.0.durability == Durability::Written && state.queue.len() >= self.0.capacity {
            // This job cannot be resumed: a card that ends with the process cannot be found again.
            state.lost += 1;
            return;
        }
        self.push(state, entry);
    }

    /// Pushes an entry that the job can be resumed without.
    pub(crate) fn push_event(&self, entry: JournalEntry) {
        let mut state = self.wait_for_space(self.state());
        if state.write_error.is_some()
            && let (JournalEntry::Position(new), Some(JournalEntry::Position(last))) = (&entry, state.queue.back_mut())
        {
            let cut = std::mem::take(&mut last.cut);
            last.clone_from(new);
            last.cut.splice(..0, cut);
            return;
        }
        if state.queue.len() >= self.0.capacity {
            state.lost += 1;
            return;
        }
        self.push(state, entry);
    }

    /// Pushes an entry, and wakes the writer only where it waits for this one: the first, or the one that fills the
    /// queue. Otherwise a writer that gathers would be woken by each.
    fn push(&self, mut state: MutexGuard<'_, QueueState>, entry: JournalEntry) {
        state.queue.push_back(entry);
        let wakes = state.queue.len() == 1 || state.queue.len() == self.0.capacity;
        drop(state);
        if wakes {
            self.0.changed.notify_all();
        }
    }

    /// In virtual time, waits for space, as long as writing may still succeed.
    fn wait_for_space<'s>(&'s self, state: MutexGuard<'s, QueueState>) -> MutexGuard<'s, QueueState> {
        if self.0.durability == Durability::Synced {
            return state;
        }
        let waits = |state: &mut QueueState| {
            state.queue.len() >= self.0.capacity && state.write_error.is_none() && !state.writer_ended
        };
        self.0.changed.wait_while(state, waits).unwrap_or_else(PoisonError::into_inner)
    }

    /// Next notice to the operator about the journal: an alarm where it cannot be written, a message when it can again.
    pub(crate) fn next_notice(&self) -> Option<JournalNotice> {
        self.state().notices.pop_front()
    }

    /// Takes the next batch, waiting for one. `None` at the end.
    fn take_batch(&self) -> Option<Vec<JournalEntry>> {
        let waits = |state: &mut QueueState| state.queue.is_empty() && state.lost == 0 && !state.closed;
        let mut state = self.0.changed.wait_while(self.state(), waits).unwrap_or_else(PoisonError::into_inner);
        if self.0.durability == Durability::Written && !state.closed {
            let gathering = |state: &mut QueueState| !state.closed && state.queue.len() < self.0.capacity;
            let waited = self.0.changed.wait_timeout_while(state, GATHER_TIME, gathering);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        let count = state.queue.len().min(MAX_BATCH);
        let mut batch: Vec<JournalEntry> = state.queue.drain(..count).collect();
        if state.lost > 0 {
            // Before the end entry, which is the last one.
            let at = batch.len() - usize::from(matches!(batch.last(), Some(JournalEntry::End(_))));
            batch.insert(at, JournalEntry::Lost(LostEntries { entries: std::mem::take(&mut state.lost) }));
        }
        state.unsaved = batch.len();
        (!batch.is_empty()).then_some(batch)
    }

    /// Records that the batch is saved, up to this place.
    fn batch_saved(&self, place: Option<RecordIndex>) {
        if let Some(place) = place {
            self.0.durable.advance(place);
        }
        let mut state = self.state();
        state.unsaved = 0;
        if state.write_error.take().is_some() {
            state.notices.push_back(JournalNotice::Writable);
        }
        drop(state);
        self.0.changed.notify_all();
    }

    /// Records that the batch could not be saved. Returns whether to try again.
    fn batch_failed(&self, why: String) -> bool {
        let mut state = self.state();
        if state.write_error.is_none() {
            let remedy = match self.0.durability {
                Durability::Synced => {
                    "free space on its disk, or repair it: the machine stops on the path until the journal can be \
                        written, and resumes automatically"
                }
                Durability::Written => {
                    "free space on its disk, or repair it: the job continues, but it cannot be resumed from here"
                }
            };
            let cause = format!("the journal cannot be written: {why}");
            state.notices.push_back(JournalNotice::Unwritable(NumberedError::new("E3020", cause, remedy)));
        }
        state.write_error = Some(why);
        self.0.changed.notify_all();
        if state.closed {
            return false;
        }
        let waited = self.0.changed.wait_timeout_while(state, RETRY_INTERVAL, |state| !state.closed);
        drop(waited.unwrap_or_else(PoisonError::into_inner));
        true
    }
}
