//! The threads that the motion path has entered, and which of them the card has armed (SPN-22).
//!
//! Invariant: in the order of their places; the records of a thread are sent only where the card has it armed.

use std::collections::VecDeque;

use retrace_core::{Distance, Place, RecordIndex};
use retrace_link::{ArmedStretch, GearStart, Outputs, SpindleControl, channel};

/// A thread that the motion path has entered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EnteredThread {
    /// Where it begins.
    pub first: RecordIndex,
    /// How motion follows the spindle in it.
    pub start: GearStart,
    /// Commanded speed of the spindle in it, in thousandths of a revolution per minute, positive clockwise.
    pub speed: i32,
    /// Its program line.
    pub line: u32,
}

impl EnteredThread {
    /// A thread before which the program expects these outputs.
    pub(crate) fn new(first: RecordIndex, start: GearStart, line: u32, expected: &Outputs) -> Self {
        let [direction, speed] = [channel::SPINDLE, channel::SPEED].map(|of| expected[usize::from(of)]);
        Self { first, start, speed: direction.signum() * speed.saturating_abs(), line }
    }

    /// Where it ends.
    #[must_use]
    pub fn end(&self) -> RecordIndex {
        self.first + self.start.length
    }

    /// Whether the requested rate acts on the spindle; otherwise the thread is finished whatever is requested.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.start.control == SpindleControl::Held
    }

    /// Whether the spindle can be turned the other way in it.
    #[must_use]
    pub const fn is_reversible(&self) -> bool {
        self.start.reverse_share > 0
    }

    /// Whether a place is behind its beginning and before its end.
    #[must_use]
    pub fn is_around(&self, place: Place) -> bool {
        self.is_behind_beginning(place) && place.record.is_before(self.end())
    }

    fn is_behind_beginning(&self, place: Place) -> bool {
        Place::start_of(self.first).distance_to(place) > Distance::ZERO
    }
}

/// Threads that are retained: what is kept of them takes no memory on the motion path.
const RETAINED: usize = 256;

/// The last threads, and the one that the card has armed.
#[derive(Clone, Debug)]
pub(crate) struct EnteredThreads {
    threads: VecDeque<EnteredThread>,
    armed: Option<RecordIndex>,
}

impl Default for EnteredThreads {
    fn default() -> Self {
        Self { threads: VecDeque::with_capacity(RETAINED), armed: None }
    }
}

impl EnteredThreads {
    /// Adds the thread behind all others, armed by its instruction. Where there is no space the first is forgotten.
    pub(crate) fn enter(&mut self, thread: EnteredThread) {
        if self.threads.len() == RETAINED {
            self.threads.pop_front();
        }
        self.threads.push_back(thread);
        self.armed = Some(thread.first);
    }

    /// The thread that the card has armed, or was told to.
    pub(crate) fn armed(&self) -> Option<EnteredThread> {
        let armed = self.armed?;
        self.threads.iter().find(|thread| thread.first == armed).copied()
    }

    /// Sets what the card has armed.
    pub(crate) const fn set_armed(&mut self, first: Option<RecordIndex>) {
        self.armed = first;
    }

    /// The thread that has this record.
    pub(crate) fn with_record(&self, record: RecordIndex) -> Option<EnteredThread> {
        let has = |thread: &&EnteredThread| !record.is_before(thread.first) && record.is_before(thread.end());
        self.threads.iter().find(has).copied()
    }

    /// The thread that ends at this place.
    pub(crate) fn ending_at(&self, place: Place) -> Option<EnteredThread> {
        self.threads.iter().find(|thread| Place::start_of(thread.end()) == place).copied()
    }

    /// Whether a thread begins at this place.
    pub(crate) fn begins_at(&self, place: Place) -> bool {
        self.threads.iter().any(|thread| Place::start_of(thread.first) == place)
    }

    /// The threads that begin at a place or behind it, the nearest first.
    pub(crate) fn ahead(&self, place: Place) -> impl Iterator<Item = &EnteredThread> {
        self.threads.iter().filter(move |thread| !thread.is_behind_beginning(place))
    }

    /// What arms a thread again, which is passed backward from its end, or lies ahead.
    pub(crate) fn arming(&self, thread: &EnteredThread, is_passed: bool) -> ArmedStretch {
        let EnteredThread { first, start, speed, .. } = *thread;
        let barrier = self.threads.iter().map(EnteredThread::end).rfind(|end| !first.is_before(*end));
        ArmedStretch { first, start, speed, is_passed, barrier }
    }
}
