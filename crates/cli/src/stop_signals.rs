//! Ctrl-C, SIGTERM and SIGHUP for a job without a screen, and for work by hand: it is stopped on its path, as by the operator's *stop*.
//!
//! Invariant: a signal never ends the process while a job runs: the machine comes to rest first, the report is written, the breakpoint is kept. A signal
//! that the process was begun with as ignored (`nohup`) stays ignored.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use retrace_controller::command_queue::{CommandReceiver, CommandSender, command_channel};
use retrace_controller::event::EventKind;
use retrace_controller::operator::OperatorCommand;
use retrace_controller::telemetry::Telemetry;

/// How often it is looked whether a signal has come.
const LOOKS_EVERY: Duration = Duration::from_millis(20);

/// What a job that is being stopped still waits for.
#[derive(Debug, Default)]
struct Progress {
    line: u32,
    is_moving: bool,
    /// The instruction that the card executes, and its line.
    instruction: Option<(String, u32)>,
}

impl Progress {
    fn in_words(&self) -> String {
        match (&self.instruction, self.is_moving) {
            (Some((code, line)), _) => format!("{code} of line {line} is being executed, and is completed first"),
            (None, true) => format!("the machine comes to rest on its path, at line {}", self.line),
            (None, false) => "the machine stands; the report is being written".into(),
        }
    }
}

/// What signals stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopPolicy {
    /// A job, whose breakpoint is kept.
    Job,
    /// Homing, a jog or a block by hand.
    ByHand,
}

/// Watches for signals as long as a job runs.
#[derive(Debug)]
pub struct StopSignals {
    came: Arc<AtomicBool>,
    progress: Arc<Mutex<Progress>>,
    over: Arc<AtomicBool>,
    watcher: Option<JoinHandle<()>>,
}

impl StopSignals {
    /// Watches for signals that [`StopSignals::listen`] lets come; and the words that they say to the job. None where there is no thread for it.
    #[must_use]
    pub fn watch(kind: StopPolicy) -> Option<(Self, CommandReceiver)> {
        let came = Arc::new(AtomicBool::new(false));
        let (said, heard) = command_channel();
        let progress = Arc::<Mutex<Progress>>::default();
        let over = Arc::new(AtomicBool::new(false));
        let watcher = {
            let (came, progress, over) = (Arc::clone(&came), Arc::clone(&progress), Arc::clone(&over));
            let watch = move || {
                // it only waits: the motion thread alone is scheduled in real time
                let _ = retrace_controller::real_time::leave();
                look(kind, &came, &said, &progress, &over);
            };
            thread::Builder::new().name("signals".into()).spawn(watch).ok()?
        };
        Some((Self { came, progress, over, watcher: Some(watcher) }, heard))
    }

    /// From now on signals stop the job, and no longer end the process. Where the system does not let us, they still do.
    pub fn listen(&self) {
        #[cfg(unix)]
        {
            use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
            let ignored = ignored();
            for signal in [SIGHUP, SIGTERM, SIGINT].into_iter().filter(|signal| ignored & (1 << (signal - 1)) == 0) {
                let _ = signal_hook::flag::register(signal, Arc::clone(&self.came));
            }
        }
    }

    /// Takes what the job tells.
    pub fn told<const A: usize>(&self, told: &Telemetry<A>) {
        let mut progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
        match told {
            Telemetry::Period(period) => (progress.line, progress.is_moving) = (period.line, period.rate != 0),
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

/// Says *stop* at the first signal, and what is waited for at each one after it.
fn look(kind: StopPolicy, came: &AtomicBool, said: &CommandSender, progress: &Mutex<Progress>, over: &AtomicBool) {
    let mut is_stopping = false;
    while !over.load(Ordering::Relaxed) {
        thread::sleep(LOOKS_EVERY);
        if !came.swap(false, Ordering::Relaxed) {
            continue;
        }
        if is_stopping {
            let progress = progress.lock().unwrap_or_else(PoisonError::into_inner);
            eprintln!("still stopping: {}", progress.in_words());
        } else if said.send(OperatorCommand::Stop).is_ok() {
            is_stopping = true;
            let kept = if kind == StopPolicy::Job { ", and the breakpoint is kept" } else { "" };
            eprintln!("stopping: the machine comes to rest on its path, cutting outputs go off{kept}");
        } else {
            came.store(true, Ordering::Relaxed);
        }
    }
}

/// The signals that the process was begun with as ignored, a bit each, the first for signal 1; where the system tells (Linux).
#[cfg(unix)]
fn ignored() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or_default()
}
