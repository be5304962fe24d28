//! The atomics and cells the ring is built on, in one place, so that a model checker can put its own in their stead.
//!
//! Invariant: a cell's content is reached by pointer inside the closures only.

pub(crate) use core::sync::atomic::{AtomicU32, Ordering};

/// A cell whose content two threads reach in turn.
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

/// A value in a cache line of its own, so that the other side's stores do not slow down ours.
#[repr(align(128))]
#[derive(Debug)]
pub(crate) struct CachePadded<T>(pub(crate) T);
