//! Ctrl-C, SIGTERM and SIGHUP for a job without a screen and for manual tasks: they stop it on its path, as the
//! operator's *stop* does.
//!
//! Invariant: a signal never ends the process while a job runs: the machine comes to rest first, the report is written,
//! the breakpoint is saved. A signal that was ignored when the process started (`nohup`) stays ignored.

use retrace_core::Rate;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use retrace_controller::{CommandReceiver, CommandSender, EventKind, OperatorCommand, Telemetry, command_channel};

/// Interval of the polls for a signal.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// Progress of a stopping job.
#[derive(Debug, Default)]
struct Progress {
    line: u32,
    is_moving: bool,
    /// Instruction in execution, and its line.
    instruction: Option<(String, u32)>,
}

impl Progress {
    fn text(&self) -> String {
        match (&self.instruction, self.is_moving) {
            (Some((code, line)), _) => format!("{code} of line {line} must complete first"),
            (None, true) => format!("the machine is braking on its path, at line {}", self.line),
            (None, false) => "the machine is at rest; the report is being written".into(),
        }
    }
}

/// Scope of a stop by signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopPolicy {
    /// Job, whose breakpoint is saved.
    Job,
    /// Homing, a jog or an MDI block.
    Manual,
}

/// Watcher for signals while a job runs.
#[derive(Debug)]
pub struct StopSignals {
    has_signal: Arc<AtomicBool>,
    progress: Arc<Mutex<Progress>>,
    over: Arc<AtomicBool>,
    watcher: Option<JoinHandle<()>>,
}

impl StopSignals {
    /// Starts the watcher. Returns it with the receiver of its commands; `None` where no thread can be started. Signals
    /// end the process until [`StopSignals::listen`] is called.
    #[must_use]
    pub fn watch(kind: StopPolicy) -> Option<(Self, CommandReceiver)> {
        let came = Arc::new(AtomicBool::new(false));
        let (sender, receiver) = command_channel();
        let progress = Arc::<Mutex<Progress>>::default();
        let over = Arc::new(AtomicBool::new(false));
        let watcher = {
            let (came, progress, over) = (Arc::clone(&came), Arc::clone(&progress), Arc::clone(&over));
            let watch = move || {
                // it only waits: the motion thread alone is scheduled in real time
                let _ = retrace_real_time::leave();
                watch_signals(kind, &came, &sender, &progress, &over);
            };
            thread::Builder::new().name("signals".into()).spawn(watch).ok()?
        };
        Some((Self { has_signal: came, progress, over, watcher: Some(watcher) }, receiver))
    }

    /// From now on signals stop the job instead of ending the process. Where the system rejects that, they still end
    /// it.
    pub fn listen(&self) {
        #[cfg(unix)]
        set_at_signal(&self.has_signal);
    }

    /// Applies an item of telemetry.
    pub fn observe<const A: usize>(&self, telemetry: &Telemetry<A>) {
        let mut progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
        match telemetry {
            Telemetry::Period(period) => (progress.line, progress.is_moving) = (period.line, period.rate != Rate::ZERO),
            Telemetry::Event(event) => match &event.kind {
                EventKind::Switching(code) => progress.instruction = Some((code.to_string(), event.line)),
                EventKind::Switched(_) => progress.instruction = None,
                _ => {}
            },
            _ => {}
        }
    }
}

impl Drop for StopSignals {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(watcher) = self.watcher.take() {
            let _ = watcher.join();
        }
    }
}

/// Sends *stop* at the first signal, and prints what is awaited at each further one.
fn watch_signals(
    kind: StopPolicy,
    came: &AtomicBool,
    sender: &CommandSender,
    progress: &Mutex<Progress>,
    over: &AtomicBool,
) {
    let mut is_stopping = false;
    while !over.load(Ordering::Relaxed) {
        thread::sleep(POLL_INTERVAL);
        if !came.swap(false, Ordering::Relaxed) {
            continue;
        }
        if is_stopping {
            let progress = progress.lock().unwrap_or_else(PoisonError::into_inner);
            eprintln!("still stopping: {}", progress.text());
        } else if sender.send(OperatorCommand::Stop).is_ok() {
            is_stopping = true;
            let kept = if kind == StopPolicy::Job { ", the breakpoint is saved" } else { "" };
            eprintln!("stopping: braking on the path, cutting outputs go off{kept}");
        } else {
            came.store(true, Ordering::Relaxed);
        }
    }
}

/// From now on a signal sets this flag instead of ending the process. Where the system rejects that, it still ends it.
#[cfg(unix)]
pub fn set_at_signal(flag: &Arc<AtomicBool>) {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    let ignored = ignored();
    for signal in [SIGHUP, SIGTERM, SIGINT].into_iter().filter(|signal| ignored & (1 << (signal - 1)) == 0) {
        let _ = signal_hook::flag::register(signal, Arc::clone(flag));
    }
}

/// Signals that were ignored when the process started, as a bit mask whose lowest bit is signal 1; 0 where the system
/// does not report them (Linux does).
#[cfg(unix)]
fn ignored() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or_default()
}
