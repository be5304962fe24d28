//! The primitives of the ring and the models, from shuttle, which decides which thread runs next.
//!
//! Invariant: the same names as `sync` of `retrace-core`, and further ones that the models use; a cell that two threads
//! access at a time, one of them writing, panics.

use shuttle::sync::atomic::AtomicI32;

pub(crate) use shuttle::sync::atomic::{AtomicU32, Ordering};
pub(crate) use shuttle::sync::{Arc, Condvar, Mutex, MutexGuard};
pub(crate) use shuttle::thread;

/// A cell that counts its accesses; beginning and ending an access are separate steps, between which the other thread
/// may run.
#[derive(Debug, Default)]
pub(crate) struct UnsafeCell<T> {
    content: core::cell::UnsafeCell<T>,
    /// Number of readers, or −1 for a writer.
    inside: AtomicI32,
}

impl<T> UnsafeCell<T> {
    pub(crate) fn new(content: T) -> Self {
        Self { content: core::cell::UnsafeCell::new(content), inside: AtomicI32::new(0) }
    }

    pub(crate) fn with<U>(&self, f: impl FnOnce(*const T) -> U) -> U {
        assert!(self.inside.fetch_add(1, Ordering::SeqCst) >= 0, "a cell is read while it is written");
        let given = f(self.content.get());
        self.inside.fetch_sub(1, Ordering::SeqCst);
        given
    }

    pub(crate) fn with_mut<U>(&self, f: impl FnOnce(*mut T) -> U) -> U {
        assert_eq!(self.inside.swap(-1, Ordering::SeqCst), 0, "a cell is written while another thread is in it");
        let given = f(self.content.get());
        self.inside.store(0, Ordering::SeqCst);
        given
    }
}

/// A value on its own; shuttle does not model cache lines.
#[derive(Debug)]
pub(crate) struct CachePadded<T>(pub(crate) T);
