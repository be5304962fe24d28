//! Where entries are handed over: any thread on one side, the one that writes on the other.
//!
//! Invariant: entries are taken in the order in which they were handed over, and what the job cannot be resumed without is never lost
//! where the motion path follows what is durable.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::entry::{JournalEntry, LostEntries};
use crate::event::{CardError, EventKind};
use crate::place_index::DurablePlace;

/// Entries that may wait where somebody can be made to wait, or entries can be lost.
pub(super) const WAITING: usize = 4096;
/// Entries that are written at once.
const BATCH: usize = 1024;
/// After so long a disk that failed is tried again.
const RETRY: Duration = Duration::from_millis(if cfg!(test) { 3 } else { 500 });
/// For so long entries are gathered where nothing waits for them to be durable.
const GATHER: Duration = Duration::from_millis(5);

/// How the journal is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Durability {
    /// Synced to the disk with every batch, and the motion path follows what is durable: for a card that outlives the process. Whoever
    /// hands over notes never waits: there are never more than the ring's look-ahead holds.
    Synced,
    /// Written only, for a card that ends with the process; nothing is kept back for it.
    Written,
}

/// The end at which entries are handed over; it can be had more than once.
#[derive(Clone, Debug)]
pub(super) struct JournalQueue(Arc<QueueShared>);

#[derive(Debug)]
struct QueueShared {
    state: Mutex<QueueState>,
    changed: Condvar,
    durable: DurablePlace,
    care: Durability,
}

#[derive(Debug, Default)]
pub(super) struct QueueState {
    pub(super) queue: VecDeque<JournalEntry>,
    /// Entries that were taken off the queue and are not kept yet.
    pub(super) in_hand: usize,
    pub(super) lost: u64,
    /// Nothing more will come.
    pub(super) closed: bool,
    /// The writer has ended.
    pub(super) over: bool,
    /// Why the last attempt to write failed, until one does not.
    pub(super) trouble: Option<String>,
    pub(super) news: VecDeque<EventKind>,
}

impl JournalQueue {
    pub(super) fn new(care: Durability, durable: DurablePlace) -> Self {
        Self(Arc::new(QueueShared { state: Mutex::default(), changed: Condvar::new(), durable, care }))
    }

    pub(super) fn care(&self) -> Durability {
        self.0.care
    }

    pub(super) fn durable(&self) -> &DurablePlace {
        &self.0.durable
    }

    /// Waits as long as this holds; [`Desk::changed`] has it looked at again.
    pub(super) fn wait_while(&self, waits: impl FnMut(&mut QueueState) -> bool) -> MutexGuard<'_, QueueState> {
        self.0.changed.wait_while(self.state(), waits).unwrap_or_else(PoisonError::into_inner)
    }

    /// The state has changed.
    pub(super) fn changed(&self) {
        self.0.changed.notify_all();
    }

    pub(super) fn state(&self) -> MutexGuard<'_, QueueState> {
        self.0.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Hands over an entry of the index.
    pub(super) fn note(&self, entry: JournalEntry) {
        let mut state = self.waited(self.state());
        if self.0.care == Durability::Written && state.queue.len() >= WAITING {
            // Nobody will take it up: a card that ends with the process cannot be found again by what was not written.
            state.lost += 1;
            return;
        }
        state.queue.push_back(entry);
        drop(state);
        self.0.changed.notify_all();
    }

    /// Hands over an entry that the job can be resumed without.
    pub(super) fn tell(&self, entry: JournalEntry) {
        let mut state = self.waited(self.state());
        if state.trouble.is_some()
            && let (JournalEntry::Position(_), Some(last @ JournalEntry::Position(_))) =
                (&entry, state.queue.back_mut())
        {
            *last = entry;
            return;
        }
        if state.queue.len() >= WAITING {
            state.lost += 1;
            return;
        }
        state.queue.push_back(entry);
        drop(state);
        self.0.changed.notify_all();
    }

    /// In virtual time, whoever hands over waits for room, as long as there is hope of it.
    fn waited<'s>(&'s self, state: MutexGuard<'s, QueueState>) -> MutexGuard<'s, QueueState> {
        if self.0.care == Durability::Synced {
            return state;
        }
        let waits = |state: &mut QueueState| state.queue.len() >= WAITING && state.trouble.is_none() && !state.over;
        self.0.changed.wait_while(state, waits).unwrap_or_else(PoisonError::into_inner)
    }

    /// The next thing that the operator has to be told of the journal: an alarm where it cannot be written, a message when it can again.
    pub(super) fn news(&self) -> Option<EventKind> {
        self.state().news.pop_front()
    }

    /// What waits to be written, once something does; `None` at the end.
    pub(super) fn take(&self) -> Option<Vec<JournalEntry>> {
        let waits = |state: &mut QueueState| state.queue.is_empty() && state.lost == 0 && !state.closed;
        let mut state = self.0.changed.wait_while(self.state(), waits).unwrap_or_else(PoisonError::into_inner);
        if self.0.care == Durability::Written && !state.closed {
            let gathering = |state: &mut QueueState| !state.closed && state.queue.len() < WAITING;
            let waited = self.0.changed.wait_timeout_while(state, GATHER, gathering);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        let count = state.queue.len().min(BATCH);
        let mut batch: Vec<JournalEntry> = state.queue.drain(..count).collect();
        if state.lost > 0 {
            // In front of the end, which is the last word.
            let at = batch.len() - usize::from(matches!(batch.last(), Some(JournalEntry::End(_))));
            batch.insert(at, JournalEntry::Lost(LostEntries { entries: std::mem::take(&mut state.lost) }));
        }
        state.in_hand = batch.len();
        (!batch.is_empty()).then_some(batch)
    }

    /// The batch is kept, up to this place.
    pub(super) fn kept(&self, place: Option<u32>) {
        if let Some(place) = place {
            self.0.durable.advance(place);
        }
        let mut state = self.state();
        state.in_hand = 0;
        if state.trouble.take().is_some() {
            state.news.push_back(EventKind::Message("the journal can be written again".into()));
        }
        drop(state);
        self.0.changed.notify_all();
    }

    /// The batch could not be kept. Is it to be tried again?
    pub(super) fn failed(&self, why: String) -> bool {
        let mut state = self.state();
        if state.trouble.is_none() {
            let remedy = match self.0.care {
                Durability::Synced => {
                    "make room on its disk, or mend it: the machine stops on the path until the journal can be written, and goes on by itself"
                }
                Durability::Written => {
                    "make room on its disk, or mend it: the job goes on, but it cannot be resumed from here"
                }
            };
            let cause = format!("the journal cannot be written: {why}");
            state.news.push_back(EventKind::Alarm(CardError::Fault { number: "E3020", cause, remedy: remedy.into() }));
        }
        state.trouble = Some(why);
        self.0.changed.notify_all();
        if state.closed {
            return false;
        }
        let waited = self.0.changed.wait_timeout_while(state, RETRY, |state| !state.closed);
        drop(waited.unwrap_or_else(PoisonError::into_inner));
        true
    }
}
