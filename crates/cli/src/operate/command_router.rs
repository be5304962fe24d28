//! Router of the operator's commands: to the job that runs, or to the machine thread.
//!
//! Invariant: nothing blocks here; a command that cannot be queued is reported on the screen.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};

use retrace_controller::{CommandQueueFull, CommandReceiver, CommandSender, OperatorCommand, command_channel};
use retrace_tui::{ScreenModel, UiCommand, lock_model};

/// Routes commands from the screen.
#[derive(Debug)]
pub(super) struct CommandRouter {
    /// Model of the screen.
    pub(super) model: Arc<Mutex<ScreenModel>>,
    commands: Sender<UiCommand>,
    job: Mutex<Option<CommandSender>>,
}

impl CommandRouter {
    /// Router for this model, and the receiver of commands while no job runs.
    pub(super) fn new(model: Arc<Mutex<ScreenModel>>) -> (Arc<Self>, Receiver<UiCommand>) {
        let (commands, receiver) = channel();
        (Arc::new(Self { model, commands, job: Mutex::new(None) }), receiver)
    }

    /// Starts routing to a job or a manual move. Returns its receiver of commands.
    pub(super) fn begin_job(&self) -> CommandReceiver {
        let (sender, receiver) = command_channel();
        *self.job() = Some(sender);
        receiver
    }

    /// Ends routing to the job.
    pub(super) fn end_job(&self) {
        *self.job() = None;
    }

    /// Routes a command from the screen.
    pub(super) fn route(&self, command: UiCommand) {
        match command {
            UiCommand::Job(command) => self.send_to_job(command),
            UiCommand::Turn(counts) => {
                if let Some(job) = &*self.job() {
                    job.turn_wheel(counts);
                }
            }
            UiCommand::CutterOff if self.job().is_some() => self.send_to_job(OperatorCommand::CutterOff),
            UiCommand::OptionalStop(on) => {
                self.send_to_job(OperatorCommand::OptionalStop(on));
                drop(self.commands.send(command));
            }
            // A key that is held down does not queue up moves.
            UiCommand::Task(_) if self.job().is_some() => {}
            // The machine thread receives every command until it ends.
            other => {
                if lock_model(&self.model).is_at_program_end() {
                    // The next command releases a job whose program has ended.
                    self.send_to_job(OperatorCommand::Stop);
                }
                drop(self.commands.send(other));
            }
        }
    }

    /// Sends a command to the job that runs; without one there is nothing to hold or stop.
    pub(super) fn send_to_job(&self, command: OperatorCommand) {
        let sent = self.job().as_ref().map(|job| job.send(command));
        if sent == Some(Err(CommandQueueFull)) {
            let mut model = lock_model(&self.model);
            let (time_s, line) = (model.period as f64 * model.facts.period_s, model.line);
            model.add_message(time_s, line, "command queue full: the key was ignored, press it again");
        }
    }

    /// Stops what runs and ends the machine thread: the operator is gone. It is called until the thread has ended.
    pub(super) fn stop_and_quit(&self) {
        self.send_to_job(OperatorCommand::Stop);
        // The receiver is gone where the machine thread has ended already.
        let _ = self.commands.send(UiCommand::Quit);
    }

    fn job(&self) -> std::sync::MutexGuard<'_, Option<CommandSender>> {
        // The value is valid after a panic of another thread.
        self.job.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
