//! Watches whether the program waits for its sender.
//!
//! Invariant: a wait of a second or longer is reported once when it has lasted that long, and once when it ends;
//! polling costs next to nothing.

use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use retrace_controller::{EventKind, SourceStatus};
use retrace_journal::Timestamp;

/// Duration after which a wait is reported.
const REPORTED_AFTER: Duration = Duration::from_secs(1);
/// Minimum interval between two polls of the source.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Watch on one source; on nothing for a program in a file.
#[derive(Debug)]
pub struct WaitWatch {
    source: Option<Arc<SourceStatus>>,
    last_poll: Option<Instant>,
    /// Start of the wait that was reported.
    reported: Option<SystemTime>,
}

impl WaitWatch {
    /// Watch on this source.
    #[must_use]
    pub fn new(source: Option<Arc<SourceStatus>>) -> Self {
        Self { source, last_poll: None, reported: None }
    }

    /// Returns an event that is due. It may be called at any rate.
    pub fn poll(&mut self) -> Option<EventKind> {
        if self.last_poll.is_some_and(|looked| looked.elapsed() < POLL_INTERVAL) {
            return None;
        }
        self.poll_now()
    }

    /// Returns an event that is due, regardless of the last poll.
    pub fn poll_now(&mut self) -> Option<EventKind> {
        let source = self.source.as_ref()?;
        self.last_poll = Some(Instant::now());
        let age = |since: SystemTime| since.elapsed().unwrap_or_default();
        let (now, name) = (source.waiting_since(), source.name().to_owned());
        match (self.reported, now) {
            (Some(since), now) if now != Some(since) => {
                self.reported = None;
                Some(EventKind::StreamResumed { source: name, waited_s: age(since).as_secs_f64() })
            }
            (None, Some(since)) if age(since) >= REPORTED_AFTER => {
                self.reported = Some(since);
                let ms = since.duration_since(UNIX_EPOCH).unwrap_or_default().as_millis();
                Some(EventKind::StreamStalled { source: name, since: Timestamp::from_ms(ms as u64) })
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_wait_is_reported_when_it_begins_and_when_it_ends() {
        let source = Arc::new(SourceStatus::new("serial:/dev/ttyS0"));
        let mut watch = WaitWatch::new(Some(Arc::clone(&source)));
        let mut poll = || {
            std::thread::sleep(POLL_INTERVAL);
            watch.poll()
        };
        source.begin_wait();
        assert_eq!(poll(), None);
        source.end_wait();
        std::thread::sleep(REPORTED_AFTER);
        assert_eq!(poll(), None);
        source.begin_wait();
        std::thread::sleep(REPORTED_AFTER);
        assert!(matches!(poll(), Some(EventKind::StreamStalled { source, .. }) if source == "serial:/dev/ttyS0"));
        assert_eq!(poll(), None);
        source.end_wait();
        assert!(matches!(poll(), Some(EventKind::StreamResumed { waited_s, .. }) if waited_s >= 1.0));
        assert_eq!(poll(), None);
    }
}
