//! Operator at a terminal, for a job in wall time without a screen and without a script: M0, M1 and M6 wait, and Enter
//! is cycle start; a cut that was interrupted waits, and Enter is `recover`.
//!
//! Invariant: nothing resumes unless Enter was pressed after the prompt. Standard input is read only while the job
//! waits, only where it is a terminal with this process in the foreground, and never where it is the program.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use retrace_controller::{CommandReceiver, CommandSender, Event, EventKind, OperatorCommand, command_channel};

/// Interval of the polls for a wait and for input.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Command that Enter sends; `None` while the job waits for nothing.
type Awaited = Arc<Mutex<Option<OperatorCommand>>>;

/// Keyboard of the operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keyboard {
    /// A terminal.
    Terminal,
    /// Nowhere: standard input is not a terminal.
    None,
    /// Nowhere: standard input is the program.
    Program,
}

/// Operator at a terminal, while a job runs.
#[derive(Debug)]
pub struct TerminalOperator {
    keyboard: Keyboard,
    saves_breakpoint: bool,
    awaited: Awaited,
    /// Command that Enter sent last: the job waits for it again where it is rejected.
    answered: Awaited,
    over: Arc<AtomicBool>,
    reader: Option<JoinHandle<()>>,
}

impl TerminalOperator {
    /// Starts the reader. Returns the receiver of its commands. `optional_stop` is whether M1 stops, `keeps_breakpoint`
    /// whether the job has a journal.
    #[must_use]
    pub fn new(keyboard: Keyboard, optional_stop: bool, keeps_breakpoint: bool) -> (Self, CommandReceiver) {
        let (sender, receiver) = command_channel();
        // The channel has room for the first command.
        let _ = sender.send(OperatorCommand::OptionalStop(optional_stop));
        let (awaited, answered, over) = (Awaited::default(), Awaited::default(), Arc::<AtomicBool>::default());
        let reader = {
            let (awaited, answered, over) = (Arc::clone(&awaited), Arc::clone(&answered), Arc::clone(&over));
            let read = move || {
                // it only waits: the motion thread alone is scheduled in real time
                let _ = retrace_real_time::leave();
                while !over.load(Ordering::Relaxed) {
                    thread::sleep(POLL_INTERVAL);
                    read_terminal(keyboard, &awaited, &answered, &sender, &over);
                }
            };
            // Without the thread Enter has no effect, and the job waits for a signal.
            thread::Builder::new().name("terminal".into()).spawn(read).ok()
        };
        (Self { keyboard, saves_breakpoint: keeps_breakpoint, awaited, answered, over, reader }, receiver)
    }

    /// Applies an event of the job. Returns the prompt to print, if the job waits now. `tool_name` looks up a tool of
    /// the tool table.
    pub fn observe(&self, event: &Event, tool_name: impl Fn(u32) -> Option<String>) -> Option<String> {
        let line = event.line;
        let (command, what) = match &event.kind {
            EventKind::ProgramStop(code) => (OperatorCommand::CycleStart, format!("{code} of line {line} waits")),
            EventKind::ToolChange(tool) => {
                let name = tool_name(tool.unsigned_abs()).map_or(String::new(), |name| format!(" ({name})"));
                let insert =
                    if *tool == 0 { "remove the tool".to_owned() } else { format!("insert tool {tool}{name}") };
                (OperatorCommand::CycleStart, format!("M6 of line {line} waits: {insert}"))
            }
            EventKind::OutputsDiffer(_) => {
                (OperatorCommand::Confirm, format!("line {line} waits: resuming restores the outputs that differ"))
            }
            EventKind::CutterOff { reason, .. } if reason.waits_for_recovery() && lock(&self.awaited).is_none() => {
                (OperatorCommand::Recover, format!("the cut of line {line} waits for `recover`"))
            }
            EventKind::CommandRejected(_) => {
                let again = lock(&self.answered).take()?;
                (again, format!("line {line} waits"))
            }
            EventKind::RunResumed | EventKind::Switching(_) | EventKind::OutputsRestored | EventKind::Alarm(_) => {
                *lock(&self.awaited) = None;
                return None;
            }
            _ => return None,
        };
        *lock(&self.awaited) = Some(command);
        Some(format!("{what}; {}", self.resume_hint()))
    }

    /// Instruction how to resume and how to stop.
    fn resume_hint(&self) -> String {
        let pid = std::process::id();
        let kept = if self.saves_breakpoint { "; `retrace resume` at a terminal resumes from here" } else { "" };
        match self.keyboard {
            Keyboard::Terminal if in_foreground() => "press Enter to resume, Ctrl-C to stop".into(),
            Keyboard::Terminal => format!(
                "this command runs in the background: bring it to the foreground (fg) and press Enter, or stop it \
                    with `kill {pid}`{kept}"
            ),
            Keyboard::None => format!("no terminal to press Enter at: stop it with `kill {pid}`{kept}"),
            Keyboard::Program => {
                format!("standard input is the program, not a keyboard: stop it with `kill {pid}`{kept}")
            }
        }
    }
}

impl Drop for TerminalOperator {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(reader) = self.reader.take() {
            let _ = reader.join();
        }
    }
}

fn lock(awaited: &Awaited) -> std::sync::MutexGuard<'_, Option<OperatorCommand>> {
    awaited.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Reads the terminal while the job waits. Earlier input is discarded: it was typed for something else.
#[cfg(unix)]
fn read_terminal(keyboard: Keyboard, awaited: &Awaited, answered: &Awaited, sender: &CommandSender, over: &AtomicBool) {
    use rustix::event::{PollFd, PollFlags, Timespec, poll};
    use rustix::termios::{QueueSelector, tcflush};

    if keyboard != Keyboard::Terminal || lock(awaited).is_none() {
        return;
    }
    let stdin = std::io::stdin();
    let mut is_flushed = false;
    while !over.load(Ordering::Relaxed) && lock(awaited).is_some() {
        // In the background, reading and flushing would stop the whole process, and the machine with it.
        if !in_foreground() {
            is_flushed = false;
            thread::sleep(POLL_INTERVAL);
            continue;
        }
        if !is_flushed {
            is_flushed = tcflush(&stdin, QueueSelector::IFlush).is_ok();
        }
        let patience = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };
        let has_line = poll(&mut [PollFd::new(&stdin, PollFlags::IN)], Some(&patience)).is_ok_and(|ready| ready > 0);
        if !has_line || !in_foreground() {
            continue;
        }
        let mut bytes = [0; 256];
        match rustix::io::read(&stdin, &mut bytes) {
            // The terminal is gone: there is no further input.
            Ok(0) => thread::sleep(POLL_INTERVAL),
            Ok(read) if bytes.iter().take(read).any(|&byte| byte == b'\n') => {
                let Some(command) = lock(awaited).take() else { return };
                *lock(answered) = Some(command);
                if sender.send(command).is_err() {
                    *lock(awaited) = Some(command);
                }
                return;
            }
            _ => {}
        }
    }
}

/// Without a terminal interface there is nothing to read.
#[cfg(not(unix))]
fn read_terminal(_: Keyboard, _: &Awaited, _: &Awaited, _: &CommandSender, _: &AtomicBool) {}

/// Whether this process is in the foreground of the terminal on its standard input.
#[cfg(unix)]
fn in_foreground() -> bool {
    rustix::termios::tcgetpgrp(std::io::stdin()).is_ok_and(|group| group == rustix::process::getpgrp())
}

#[cfg(not(unix))]
fn in_foreground() -> bool {
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use retrace_controller::{CutterOffReason, DifferingOutput, DifferingOutputs};
    use retrace_core::Place;

    fn event(kind: EventKind) -> Event {
        Event { period: 1, time_s: 0.0, place: Place::default(), line: 7, kind }
    }

    #[test]
    fn what_is_waited_for_is_said_with_the_way_on_and_the_way_out() {
        let (operator, mut receiver) = TerminalOperator::new(Keyboard::None, true, true);
        assert_eq!(receiver.next_command(), Some(OperatorCommand::OptionalStop(true)));
        let prompt = |kind| operator.observe(&event(kind), |tool| (tool == 3).then(|| "end mill".to_owned()));
        let stop = prompt(EventKind::ProgramStop("M0")).expect("it waits");
        assert!(stop.starts_with("M0 of line 7 waits; no terminal to press Enter at: stop it with `kill "), "{stop}");
        assert!(stop.contains("`retrace resume`"), "{stop}");
        assert_eq!(*lock(&operator.awaited), Some(OperatorCommand::CycleStart));
        let change = prompt(EventKind::ToolChange(3)).expect("it waits");
        assert!(change.contains("insert tool 3 (end mill)"), "{change}");
        assert!(prompt(EventKind::ToolChange(0)).is_some_and(|text| text.contains("remove the tool")));
        let differ = DifferingOutputs::first(&mut [DifferingOutput::new(3, 0, 1)].into_iter());
        assert!(prompt(EventKind::OutputsDiffer(differ)).is_some_and(|text| text.contains("restores the outputs")));
        assert_eq!(*lock(&operator.awaited), Some(OperatorCommand::Confirm));
        assert_eq!((prompt(EventKind::RunResumed), *lock(&operator.awaited)), (None, None));
        let off = |reason| EventKind::CutterOff { channel: 64, reason };
        assert_eq!(prompt(off(CutterOffReason::ProgramEnd)), None);
        let lost = prompt(off(CutterOffReason::NotLatched)).expect("it waits");
        assert!(lost.starts_with("the cut of line 7 waits for `recover`; no terminal"), "{lost}");
        assert_eq!(*lock(&operator.awaited), Some(OperatorCommand::Recover));
        assert_eq!((prompt(EventKind::RunResumed), *lock(&operator.awaited)), (None, None));
        assert_eq!(receiver.next_command(), None, "nothing is said by itself");
    }
}
