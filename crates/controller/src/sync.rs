//! The locks, atomics and channels of the hand-over between threads, in one place, so that a model checker can
//! substitute its own.

pub(crate) use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU32, AtomicU64, Ordering};
pub(crate) use std::sync::{Arc, Mutex, PoisonError, mpsc};
pub(crate) use std::thread;
