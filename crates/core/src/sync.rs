//! The atomics and cells that the ring is built on, in one place, so that a model checker can substitute its own.
//!
//! Invariant: the content of a cell is accessible by pointer only inside the closures.

pub(crate) use core::sync::atomic::{AtomicU32, Ordering};

/// Cell whose content two threads access in turn.
#[derive(Debug, Default)]
pub(crate) struct UnsafeCell<T>(core::cell::UnsafeCell<T>);

impl<T> UnsafeCell<T> {
    #[inline]
    pub(crate) fn new(content: T) -> Self {
        Self(core::cell::UnsafeCell::new(content))
    }

    #[inline]
    pub(crate) fn with<U>(&self, f: impl FnOnce(*const T) -> U) -> U {
        f(self.0.get())
    }

    #[inline]
    pub(crate) fn with_mut<U>(&self, f: impl FnOnce(*mut T) -> U) -> U {
        f(self.0.get())
    }
}

/// Value in a cache line of its own, so that stores of the other thread do not slow down this one.
#[repr(align(128))]
#[derive(Debug)]
pub(crate) struct CachePadded<T>(pub(crate) T);
