//! The channel of two batches from decoding to planning. Each side has a batch, and exchanges it for the pending one.
//!
//! Invariant: neither side waits in the other's lock for longer than an exchange, and neither wakes the other. Batches
//! are taken whole and in order; nothing that was sent before the end is lost. `verification/loom` compiles this file
//! again over the model checker's locks.

use std::time::Duration;

use crate::sync::{AtomicBool, Mutex, Ordering, PoisonError, thread};

/// Interval at which a sender without space polls: less than a planner takes for a batch.
const POLL_INTERVAL: Duration = Duration::from_micros(300);

/// What the channel exchanges.
pub(crate) trait Batch {
    /// Whether there is nothing in it.
    fn is_empty(&self) -> bool;
    /// Whether something may be added.
    fn has_space(&self) -> bool;
    /// Empties the batch and keeps its capacity.
    fn clear(&mut self);
}

/// The channel, with the batch that is pending.
#[derive(Debug)]
pub(crate) struct BatchChannel<B> {
    pending: Mutex<B>,
    /// The receiver takes nothing any more.
    cancelled: AtomicBool,
    /// The sender sends nothing any more.
    ended: AtomicBool,
}

impl<B: Batch> BatchChannel<B> {
    /// Creates a channel with this batch, which is empty.
    pub(crate) fn new(pending: B) -> Self {
        let pending = Mutex::new(pending);
        Self { pending, cancelled: AtomicBool::new(false), ended: AtomicBool::new(false) }
    }

    /// Whether nothing more will be sent.
    #[cfg(test)]
    pub(crate) fn has_ended(&self) -> bool {
        self.ended.load(Ordering::Acquire)
    }
}

/// The decoding thread's end; dropped, it ends the channel.
#[derive(Debug)]
pub(crate) struct BatchSender<'c, B>(&'c BatchChannel<B>);

impl<'c, B: Batch> BatchSender<'c, B> {
    /// Creates the one sender of a channel.
    pub(crate) fn new(channel: &'c BatchChannel<B>) -> Self {
        Self(channel)
    }

    /// Adds something to the pending batch. Returns false where the channel is cancelled. Waits for space with short
    /// pauses: neither side wakes the other.
    pub(crate) fn send(&self, add: impl FnOnce(&mut B)) -> bool {
        while !self.0.cancelled.load(Ordering::Relaxed) {
            let mut pending = self.0.pending.lock().unwrap_or_else(PoisonError::into_inner);
            if pending.has_space() {
                add(&mut pending);
                return true;
            }
            drop(pending);
            thread::sleep(POLL_INTERVAL);
        }
        false
    }
}

impl<B> Drop for BatchSender<'_, B> {
    fn drop(&mut self) {
        self.0.ended.store(true, Ordering::Release);
    }
}

/// The planning thread's end; dropped, it cancels the channel.
#[derive(Debug)]
pub(crate) struct BatchReceiver<'c, B>(&'c BatchChannel<B>);

impl<'c, B: Batch> BatchReceiver<'c, B> {
    /// Creates the one receiver of a channel.
    pub(crate) fn new(channel: &'c BatchChannel<B>) -> Self {
        Self(channel)
    }

    /// Exchanges `batch` for the pending one, if that is not empty. Returns whether it did.
    pub(crate) fn try_receive(&self, batch: &mut B) -> bool {
        // A batch contains whole blocks at all times, also where its holder panicked.
        let mut pending = self.0.pending.lock().unwrap_or_else(PoisonError::into_inner);
        if pending.is_empty() {
            return false;
        }
        batch.clear();
        std::mem::swap(&mut *pending, batch);
        true
    }

    /// Exchanges `batch` for the pending one, and calls `pause` with the number of attempts before it while there is
    /// none. `None` where nothing will come, or where `pause` returns it.
    pub(crate) fn receive(&self, batch: &mut B, mut pause: impl FnMut(u32) -> Option<()>) -> Option<()> {
        for tries in 0u32.. {
            // In this order: what was sent before the end is there when the end is seen.
            let ended = self.0.ended.load(Ordering::Acquire);
            if self.try_receive(batch) {
                break;
            }
            if ended {
                return None;
            }
            pause(tries)?;
        }
        Some(())
    }

    /// Cancels the channel: the sender ends.
    pub(crate) fn cancel(&self) {
        self.0.cancelled.store(true, Ordering::Relaxed);
    }
}

impl<B> Drop for BatchReceiver<'_, B> {
    fn drop(&mut self) {
        self.0.cancelled.store(true, Ordering::Relaxed);
    }
}
