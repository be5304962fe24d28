//! The low-latency setting of USB serial adapters.
//!
//! Adapters with FTDI's chip delay received bytes until 16 ms have passed or a packet is full. On Linux the delay is in
//! a file of its driver, which the device's owner may write. Ports of a card's own USB (CDC-ACM, `/dev/ttyACM0`), UARTs
//! of the computer and pseudo-terminals have no such delay.
//!
//! Invariant: a setting that fails does not keep a port from being opened.

use std::path::Path;

/// Delay of received bytes in an adapter.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LatencyTimer {
    /// The port has no such delay.
    None,
    /// Delay in force, as found or as set.
    Set {
        /// Milliseconds.
        ms: u32,
    },
    /// Delay in force, which this program may not change.
    ReadOnly {
        /// Milliseconds.
        ms: u32,
        /// What to do about it.
        remedy: String,
    },
}

/// Shortest delay of FTDI's chips, in milliseconds.
const MIN_MS: u32 = 1;

/// Sets the shortest delay that the adapter has, and returns the delay in force.
#[must_use]
pub(crate) fn set_low_latency(path: &Path) -> LatencyTimer {
    path.canonicalize().map_or(LatencyTimer::None, |path| match path.file_name() {
        Some(name) => shorten(&Path::new("/sys/bus/usb-serial/devices").join(name).join("latency_timer")),
        None => LatencyTimer::None,
    })
}

fn shorten(timer: &Path) -> LatencyTimer {
    let read = || std::fs::read_to_string(timer).ok()?.trim().parse::<u32>().ok();
    let Some(ms) = read() else { return LatencyTimer::None };
    if ms <= MIN_MS {
        return LatencyTimer::Set { ms };
    }
    match std::fs::write(timer, MIN_MS.to_string()) {
        Ok(()) => LatencyTimer::Set { ms: read().unwrap_or(MIN_MS) },
        Err(_) => LatencyTimer::ReadOnly {
            ms,
            remedy: format!("echo {MIN_MS} | sudo tee {} (after each plugging in)", timer.display()),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_timer_is_set_where_there_is_one() {
        let folder = tempfile::tempdir().expect("a folder");
        let timer = folder.path().join("latency_timer");
        assert_eq!(shorten(&timer), LatencyTimer::None);
        std::fs::write(&timer, "16\n").expect("a file");
        assert_eq!(shorten(&timer), LatencyTimer::Set { ms: 1 });
        assert_eq!(std::fs::read_to_string(&timer).expect("there"), "1");
        std::fs::write(&timer, "no number").expect("a file");
        assert_eq!(shorten(&timer), LatencyTimer::None);
        assert_eq!(set_low_latency(Path::new("/dev/null")), LatencyTimer::None);
    }
}
