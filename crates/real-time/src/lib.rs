//! Real-time scheduling of a thread (SCHED_FIFO), and memory that stays resident, on Linux.
//!
//! A thread [`enter`]s real-time scheduling and [`leave`]s it. Threads that it spawns meanwhile inherit it, so each of
//! these calls [`leave`] first, unless it is meant to have it. [`permitted`] reports the reason where it is refused.
//!
//! Invariant: without permission everything works as before. A thread that leaves real-time scheduling is scheduled as
//! usual.
//!
//! # Examples
//!
//! ```
//! let is_real_time = retrace_real_time::enter().is_ok();
//! // … the motion …
//! if is_real_time {
//!     retrace_real_time::leave()?;
//! }
//! # Ok::<(), retrace_real_time::RealTimeDenied>(())
//! ```
#![forbid(unsafe_code)]

use std::fmt;

/// Priority of the motion thread under SCHED_FIFO, of 1 to 99: above everything that is not real-time, below the
/// kernel's own interrupt threads where these have a higher one.
pub const PRIORITY: u8 = 40;

/// The system does not permit real-time scheduling.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RealTimeDenied {
    /// What was requested.
    pub what: &'static str,
    /// The system's reason.
    pub why: String,
}

impl fmt::Display for RealTimeDenied {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} is not permitted ({})", self.what, self.why)
    }
}

impl std::error::Error for RealTimeDenied {}

/// Schedules the calling thread under SCHED_FIFO. Threads that it spawns from then on are scheduled so, too.
///
/// # Errors
/// It is not permitted, or the system has no such scheduling.
pub fn enter() -> Result<(), RealTimeDenied> {
    platform::schedule(Some(PRIORITY))
}

/// Schedules the calling thread as usual again.
///
/// # Errors
/// The error of the system; none in practice.
pub fn leave() -> Result<(), RealTimeDenied> {
    platform::schedule(None)
}

/// Checks whether a thread may be scheduled under SCHED_FIFO, on a thread of its own.
///
/// # Errors
/// The reason why it may not.
pub fn permitted() -> Result<(), RealTimeDenied> {
    let tried = std::thread::Builder::new().name("real-time check".into()).spawn(enter);
    let denied = |why: &str| RealTimeDenied { what: "SCHED_FIFO", why: why.into() };
    tried.map_err(|error| denied(&error.to_string()))?.join().unwrap_or_else(|_| Err(denied("the check failed")))
}

/// Locks all memory of the process, present and future. Only where there is no limit on it: with one, a later
/// allocation would fail.
///
/// # Errors
/// It is limited, or not permitted.
pub fn lock_memory() -> Result<(), RealTimeDenied> {
    platform::lock_memory()
}

#[cfg(target_os = "linux")]
mod platform {
    use super::RealTimeDenied;
    use rustix::mm::{MlockAllFlags, mlockall};
    use rustix::process::getpriority_process;
    use rustix::process::{Resource, getrlimit};
    use thread_priority::{
        Error, NormalThreadSchedulePolicy, RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue,
        ThreadSchedulePolicy, set_thread_priority_and_policy, thread_native_id,
    };

    pub(super) fn schedule(priority: Option<u8>) -> Result<(), RealTimeDenied> {
        let denied = |why: String| RealTimeDenied { what: "SCHED_FIFO", why };
        let (priority, policy) = match priority {
            Some(priority) => {
                let value = ThreadPriorityValue::try_from(priority).map_err(denied)?;
                let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
                (ThreadPriority::Crossplatform(value), policy)
            }
            None => {
                let policy = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other);
                let priority = same_niceness(policy).ok_or_else(|| denied("the niceness is not known".into()))?;
                (priority, policy)
            }
        };
        set_thread_priority_and_policy(thread_native_id(), priority, policy).map_err(|error| match error {
            Error::OS(code) => denied(std::io::Error::from_raw_os_error(code).to_string()),
            other => denied(other.to_string()),
        })
    }

    /// The priority that stands for the niceness that the thread has: it is set together with the policy.
    fn same_niceness(policy: ThreadSchedulePolicy) -> Option<ThreadPriority> {
        priority_of(getpriority_process(None).ok()?, policy)
    }

    /// The priority that stands for a niceness, −20 to 19.
    pub(super) fn priority_of(niceness: i32, policy: ThreadSchedulePolicy) -> Option<ThreadPriority> {
        let mut values = (0..=u8::MAX).filter_map(|value| ThreadPriorityValue::try_from(value).ok());
        values.find_map(|value| {
            let priority = ThreadPriority::Crossplatform(value);
            (priority.to_posix(policy) == Ok(niceness)).then_some(priority)
        })
    }

    pub(super) fn lock_memory() -> Result<(), RealTimeDenied> {
        let denied = |why: String| RealTimeDenied { what: "locking memory", why };
        let is_root = rustix::process::geteuid().is_root();
        if !is_root && let Some(limit) = getrlimit(Resource::Memlock).current {
            return Err(denied(format!("it is limited to {} KiB", limit >> 10)));
        }
        mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).map_err(|error| denied(error.to_string()))
    }
}

#[cfg(not(target_os = "linux"))]
mod platform {
    use super::RealTimeDenied;

    pub(super) fn schedule(_: Option<u8>) -> Result<(), RealTimeDenied> {
        Err(RealTimeDenied { what: "SCHED_FIFO", why: "it is used on Linux only".into() })
    }

    pub(super) fn lock_memory() -> Result<(), RealTimeDenied> {
        Err(RealTimeDenied { what: "locking memory", why: "it is used on Linux only".into() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_that_may_enters_and_leaves() {
        let tried = std::thread::spawn(|| (enter(), leave())).join().expect("no panic");
        assert_eq!(tried.0.is_ok(), permitted().is_ok());
        assert!(tried.0.is_err() || tried.1.is_ok(), "{tried:?}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn every_niceness_has_a_priority() {
        use thread_priority::{NormalThreadSchedulePolicy, ThreadSchedulePolicy};
        let policy = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other);
        let without: Vec<i32> = (-20..20).filter(|&nice| platform::priority_of(nice, policy).is_none()).collect();
        assert_eq!(without, []);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_thread_that_leaves_is_as_nice_as_before() {
        let niceness = || rustix::process::getpriority_process(None).ok();
        let seen = std::thread::spawn(move || {
            let before = niceness();
            let left = enter().and_then(|()| leave());
            // what anybody may do: be nicer
            let nicer = rustix::process::setpriority_process(None, 7).ok().and_then(|()| niceness());
            let again = enter().and_then(|()| leave());
            (before, left, nicer, again, niceness())
        });
        let (before, left, nicer, again, after) = seen.join().expect("no panic");
        assert_eq!((nicer, after), (Some(7), Some(7)), "{before:?} {left:?} {again:?}");
    }
}
