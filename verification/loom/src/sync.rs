//! What the ring and the models run on, from loom, which decides who goes next and what a load may see.
//!
//! Invariant: the same names as `sync` of `retrace-core`, and those the models use besides.

pub(crate) use loom::cell::UnsafeCell;
pub(crate) use loom::sync::atomic::{AtomicU32, Ordering};
pub(crate) use loom::sync::{Arc, Condvar, Mutex, MutexGuard};
pub(crate) use loom::thread;

/// A value on its own; loom knows no cache lines.
#[derive(Debug)]
pub(crate) struct CachePadded<T>(pub(crate) T);
