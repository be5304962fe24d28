//! The primitives of the ring and the models, from loom, which decides which thread runs next and what a load may
//! return.
//!
//! Invariant: the same names as `sync` of `retrace-core`, and further ones that the models use.

pub(crate) use loom::cell::UnsafeCell;
pub(crate) use loom::sync::atomic::{AtomicU32, Ordering};
pub(crate) use loom::sync::{Arc, Condvar, Mutex, MutexGuard};
pub(crate) use loom::thread;

/// A value on its own; loom does not model cache lines.
#[derive(Debug)]
pub(crate) struct CachePadded<T>(pub(crate) T);
