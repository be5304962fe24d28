//! The primitives of the real files and the models, from loom, which decides which thread runs next and what a load may
//! return.
//!
//! Invariant: the same names as `sync` of `retrace-core`, `retrace-journal` and `retrace-controller`, with the
//! guarantees of the standard library and no others: time may pass at any moment, so that a pause is a step in which
//! others run, and a wait with a limit may end without a notice.

use std::time::Duration;

pub(crate) use loom::cell::UnsafeCell;
pub(crate) use loom::sync::Arc;
pub(crate) use loom::sync::atomic::{AtomicBool, AtomicI32, AtomicU32, AtomicU64, Ordering};
pub(crate) use std::sync::{LockResult, PoisonError};

/// A value on its own; loom does not model cache lines.
#[derive(Debug)]
pub(crate) struct CachePadded<T>(pub(crate) T);

/// Mutex whose guards know it.
#[derive(Debug, Default)]
pub(crate) struct Mutex<T>(loom::sync::Mutex<T>);

/// Guard of a [`Mutex`].
#[derive(Debug)]
pub(crate) struct MutexGuard<'a, T> {
    mutex: &'a Mutex<T>,
    held: loom::sync::MutexGuard<'a, T>,
}

impl<T> Mutex<T> {
    pub(crate) fn new(content: T) -> Self {
        Self(loom::sync::Mutex::new(content))
    }

    pub(crate) fn lock(&self) -> LockResult<MutexGuard<'_, T>> {
        let guard = |held| MutexGuard { mutex: self, held };
        self.0.lock().map(guard).map_err(|poisoned| PoisonError::new(guard(poisoned.into_inner())))
    }
}

impl<T> std::ops::Deref for MutexGuard<'_, T> {
    type Target = T;
    fn deref(&self) -> &T {
        &self.held
    }
}

impl<T> std::ops::DerefMut for MutexGuard<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.held
    }
}

/// Condition variable with the waits of the standard library that loom's has not.
#[derive(Debug, Default)]
pub(crate) struct Condvar(loom::sync::Condvar);

impl Condvar {
    pub(crate) fn new() -> Self {
        Self(loom::sync::Condvar::new())
    }

    pub(crate) fn notify_one(&self) {
        self.0.notify_one();
    }

    pub(crate) fn notify_all(&self) {
        self.0.notify_all();
    }

    pub(crate) fn wait<'a, T>(&self, guard: MutexGuard<'a, T>) -> LockResult<MutexGuard<'a, T>> {
        let MutexGuard { mutex, held } = guard;
        let held = self.0.wait(held).unwrap_or_else(PoisonError::into_inner);
        Ok(MutexGuard { mutex, held })
    }

    pub(crate) fn wait_while<'a, T>(
        &self,
        mut guard: MutexGuard<'a, T>,
        mut waits: impl FnMut(&mut T) -> bool,
    ) -> LockResult<MutexGuard<'a, T>> {
        while waits(&mut guard) {
            guard = self.wait(guard)?;
        }
        Ok(guard)
    }

    /// Waits at most once, for as long as the engine lets the others run: the limit may pass at any moment.
    pub(crate) fn wait_timeout_while<'a, T>(
        &self,
        mut guard: MutexGuard<'a, T>,
        _limit: Duration,
        mut waits: impl FnMut(&mut T) -> bool,
    ) -> LockResult<(MutexGuard<'a, T>, bool)> {
        if waits(&mut guard) {
            let mutex = guard.mutex;
            drop(guard);
            thread::yield_now();
            guard = mutex.lock().unwrap_or_else(PoisonError::into_inner);
        }
        let timed_out = waits(&mut guard);
        Ok((guard, timed_out))
    }
}

/// Threads, and the pauses of those that poll.
pub(crate) mod thread {
    pub(crate) use loom::thread::{Thread, park, spawn, yield_now};

    /// Lets the others run.
    pub(crate) fn sleep(_pause: std::time::Duration) {
        yield_now();
    }
}

/// The bounded channel of the standard library: a queue with its capacity under a mutex, and what its ends learn of
/// each other. Nobody here waits in it.
pub(crate) mod mpsc {
    use super::{Arc, Mutex, PoisonError};
    use std::collections::VecDeque;
    pub(crate) use std::sync::mpsc::{TryRecvError, TrySendError};

    #[derive(Debug)]
    struct Channel<T> {
        queue: VecDeque<T>,
        capacity: usize,
        senders: usize,
        has_receiver: bool,
    }

    fn with<T, U>(channel: &Mutex<Channel<T>>, work: impl FnOnce(&mut Channel<T>) -> U) -> U {
        work(&mut channel.lock().unwrap_or_else(PoisonError::into_inner))
    }

    pub(crate) fn sync_channel<T>(capacity: usize) -> (SyncSender<T>, Receiver<T>) {
        let channel = Channel { queue: VecDeque::new(), capacity, senders: 1, has_receiver: true };
        let channel = Arc::new(Mutex::new(channel));
        (SyncSender(Arc::clone(&channel)), Receiver(channel))
    }

    #[derive(Debug)]
    pub(crate) struct SyncSender<T>(Arc<Mutex<Channel<T>>>);

    impl<T> SyncSender<T> {
        pub(crate) fn try_send(&self, message: T) -> Result<(), TrySendError<T>> {
            with(&self.0, |channel| {
                if !channel.has_receiver {
                    return Err(TrySendError::Disconnected(message));
                }
                if channel.queue.len() >= channel.capacity {
                    return Err(TrySendError::Full(message));
                }
                channel.queue.push_back(message);
                Ok(())
            })
        }
    }

    impl<T> Clone for SyncSender<T> {
        fn clone(&self) -> Self {
            with(&self.0, |channel| channel.senders += 1);
            Self(Arc::clone(&self.0))
        }
    }

    impl<T> Drop for SyncSender<T> {
        fn drop(&mut self) {
            with(&self.0, |channel| channel.senders -= 1);
        }
    }

    #[derive(Debug)]
    pub(crate) struct Receiver<T>(Arc<Mutex<Channel<T>>>);

    impl<T> Receiver<T> {
        pub(crate) fn try_recv(&self) -> Result<T, TryRecvError> {
            with(&self.0, |channel| match channel.queue.pop_front() {
                Some(message) => Ok(message),
                None if channel.senders == 0 => Err(TryRecvError::Disconnected),
                None => Err(TryRecvError::Empty),
            })
        }
    }

    impl<T> Drop for Receiver<T> {
        fn drop(&mut self) {
            let left = with(&self.0, |channel| {
                channel.has_receiver = false;
                std::mem::take(&mut channel.queue)
            });
            drop(left);
        }
    }
}
