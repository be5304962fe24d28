//! Where the operator's words go: to the job that runs, or to the machine that waits for one.
//!
//! Invariant: nobody waits for anybody here; a word that cannot be taken is answered on the screen.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};

use retrace_controller::command_queue::{CommandQueueFull, CommandReceiver, CommandSender, command_channel};
use retrace_controller::operator::OperatorCommand;

use crate::screen::UiCommand;
use crate::screen::model::ScreenModel;
use crate::screen::model_observer::locked;

/// The operator's desk.
#[derive(Debug)]
pub(super) struct CommandRouter {
    /// What the screen shows.
    pub(super) model: Arc<Mutex<ScreenModel>>,
    words: Sender<UiCommand>,
    job: Mutex<Option<CommandSender>>,
}

impl CommandRouter {
    /// A desk before this picture, and what is said at it while no job runs.
    pub(super) fn new(model: Arc<Mutex<ScreenModel>>) -> (Arc<Self>, Receiver<UiCommand>) {
        let (words, said) = channel();
        (Arc::new(Self { model, words, job: Mutex::new(None) }), said)
    }

    /// A job, or a move by hand, begins: its end of the words.
    pub(super) fn begins(&self) -> CommandReceiver {
        let (said, heard) = command_channel();
        *self.job() = Some(said);
        heard
    }

    /// It has ended.
    pub(super) fn ends(&self) {
        *self.job() = None;
    }

    /// Takes what was said at the screen.
    pub(super) fn say(&self, said: UiCommand) {
        match said {
            UiCommand::Deed(deed) => self.say_to_job(deed),
            UiCommand::Turn(counts) => {
                if let Some(job) = &*self.job() {
                    job.turn_wheel(counts);
                }
            }
            UiCommand::CutterOff if self.job().is_some() => self.say_to_job(OperatorCommand::CutterOff),
            UiCommand::OptionalStop(on) => {
                self.say_to_job(OperatorCommand::OptionalStop(on));
                drop(self.words.send(said));
            }
            // A key that is held down does not heap up moves.
            UiCommand::Task(_) if self.job().is_some() => {}
            // The machine hears everything until it is left.
            other => {
                if locked(&self.model).is_at_program_end() {
                    // Whatever comes next releases the job, whose program has come to its end.
                    self.say_to_job(OperatorCommand::Stop);
                }
                drop(self.words.send(other));
            }
        }
    }

    /// Says a word to whatever runs; where nothing does, there is nothing to hold and nothing to stop.
    pub(super) fn say_to_job(&self, deed: OperatorCommand) {
        let said = self.job().as_ref().map(|job| job.send(deed));
        if said == Some(Err(CommandQueueFull)) {
            let mut model = locked(&self.model);
            let (time_s, line) = (model.period as f64 * model.facts.period_s, model.line);
            model.say(time_s, line, "too many words wait: not taken, say it again");
        }
    }

    /// The operator is gone: what runs is stopped, and the machine left. To be said until it has come to that.
    pub(super) fn leave(&self) {
        self.say_to_job(OperatorCommand::Stop);
        // Nobody hears that any more where the machine has been left already.
        let _ = self.words.send(UiCommand::Quit);
    }

    fn job(&self) -> std::sync::MutexGuard<'_, Option<CommandSender>> {
        // Whoever panicked with it left it as it was.
        self.job.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
