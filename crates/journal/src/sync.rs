//! The locks and atomics of the journal's hand-over, in one place, so that a model checker can substitute its own.

pub(crate) use std::sync::atomic::{AtomicU32, Ordering};
pub(crate) use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
