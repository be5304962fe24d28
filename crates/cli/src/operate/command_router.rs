//! Router of the operator's commands: to the job that runs, or to the machine thread.
//!
//! Invariant: nothing blocks here; a command that cannot be queued is reported on the screen. A hold reaches whatever
//! was started before it: the job that runs, and every start that the machine thread has not begun yet.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};

use retrace_controller::{CommandQueueFull, CommandReceiver, CommandSender, OperatorCommand, command_channel};
use retrace_tui::{ScreenModel, UiCommand, lock_model};

/// Routes commands from the screens.
#[derive(Debug)]
pub(super) struct CommandRouter {
    /// Model of the screen.
    pub(super) model: Arc<Mutex<ScreenModel>>,
    commands: Sender<UiCommand>,
    route: Mutex<Route>,
}

/// Where commands go, and the starts on their way to the machine thread. Starts are numbered from 1 on.
#[derive(Debug, Default)]
struct Route {
    /// The job or manual move that runs.
    job: Option<CommandSender>,
    /// Number of the last start that was sent.
    sent: u64,
    /// Number of the last start that the machine thread has received.
    received: u64,
    /// Number of the last start whose motion has ended.
    done: u64,
    /// Number of the last start that a hold has cancelled.
    cancelled: u64,
    /// Number of the last start of a program that was sent.
    program: u64,
    /// Number of the last start of a program whose series of pieces ends with the piece that runs.
    series_end: u64,
}

impl Route {
    /// Whether a program is about to run or runs, behind which this start of another one must not wait: nobody would
    /// expect it when the first one ends. At the end of a program the next one may be started once.
    fn has_program(&self, command: &UiCommand, is_at_end: bool) -> bool {
        if is_at_end && self.sent == self.received {
            return false;
        }
        let is_pending = self.program > self.done.max(self.cancelled);
        // A piece of the shop waits behind nothing that moves.
        is_pending || matches!(command, UiCommand::StartShopJob { .. }) && self.job.is_some()
    }
}

/// Number of a start that no hold cancels: it is no order of the operator.
pub(super) const NOT_CANCELLABLE: u64 = u64::MAX;

impl CommandRouter {
    /// Router for this model, and the receiver of commands while no job runs.
    pub(super) fn new(model: Arc<Mutex<ScreenModel>>) -> (Arc<Self>, Receiver<UiCommand>) {
        let (commands, receiver) = channel();
        (Arc::new(Self { model, commands, route: Mutex::new(Route::default()) }), receiver)
    }

    /// The machine thread has received a start. Returns its number.
    pub(super) fn receive_start(&self) -> u64 {
        let mut route = self.route();
        route.received += 1;
        route.received
    }

    /// The machine thread has executed the starts that it has received.
    pub(super) fn finish_start(&self) {
        let mut route = self.route();
        route.done = route.received;
    }

    /// Starts routing to a job or a manual move. Returns its receiver of commands; `None` where a hold has cancelled
    /// the start of this number.
    pub(super) fn begin_job(&self, start: u64) -> Option<CommandReceiver> {
        let mut route = self.route();
        if start <= route.cancelled {
            return None;
        }
        let (sender, receiver) = command_channel();
        route.job = Some(sender);
        Some(receiver)
    }

    /// Ends routing to the job. A task that is sent while its end is still being reported is the next one.
    pub(super) fn end_job(&self) {
        {
            let mut route = self.route();
            route.job = None;
            route.done = route.received;
        }
        // Only now: a machine that is shown as ready takes the next order.
        lock_model(&self.model).manual_task = None;
    }

    /// Ends routing to a piece of a series, whose start has not ended: no other program begins before the next piece.
    pub(super) fn end_piece(&self) {
        self.route().job = None;
    }

    /// Whether the series of the start of this number ends with the piece that runs.
    #[cfg_attr(not(feature = "shop"), expect(dead_code, reason = "there are no series without the shop"))]
    pub(super) fn has_series_ended(&self, start: u64) -> bool {
        let route = self.route();
        start <= route.cancelled.max(route.series_end)
    }

    /// Routes a command from a screen. Returns whether it was passed on.
    pub(super) fn route_command(&self, command: UiCommand) -> bool {
        match command {
            UiCommand::Job(command) => return self.send_to_job(command),
            UiCommand::Turn(counts) => {
                if let Some(job) = &self.route().job {
                    job.turn_wheel(counts);
                }
            }
            UiCommand::EndSeries => {
                let mut route = self.route();
                route.series_end = route.program;
            }
            UiCommand::CutterOff if self.route().job.is_some() => return self.send_to_job(OperatorCommand::CutterOff),
            UiCommand::OptionalStop(on) => {
                self.send_to_job(OperatorCommand::OptionalStop(on));
                drop(self.commands.send(command));
            }
            // The machine thread receives every command until it ends.
            command => {
                let is_at_end = lock_model(&self.model).is_at_program_end();
                if is_program_start(&command) && self.route().has_program(&command, is_at_end) {
                    return false;
                }
                if is_at_end {
                    // The next command releases a job whose program has ended.
                    self.send_to_job(OperatorCommand::Stop);
                }
                let mut route = self.route();
                // A key that is held down does not queue up moves.
                let is_busy = route.job.is_some() || route.sent != route.done;
                if matches!(
                    command,
                    UiCommand::Task(_) | UiCommand::Frame(_) | UiCommand::AlignSheet | UiCommand::SetTables(_)
                ) && is_busy
                {
                    return false;
                }
                // Another screen may have sent a start meanwhile.
                if is_program_start(&command) && route.has_program(&command, is_at_end) {
                    return false;
                }
                route.sent += u64::from(is_start(&command));
                if is_program_start(&command) {
                    route.program = route.sent;
                }
                drop(self.commands.send(command));
            }
        }
        true
    }

    /// Sends a command to the job that runs. Without one there is nothing to hold or stop but what is about to start.
    /// Returns whether the queue had space for it.
    pub(super) fn send_to_job(&self, command: OperatorCommand) -> bool {
        let sent = {
            let mut route = self.route();
            if matches!(command, OperatorCommand::Hold | OperatorCommand::Stop | OperatorCommand::Pause) {
                route.cancelled = route.sent;
            }
            route.job.as_ref().map(|job| job.send(command))
        };
        if sent == Some(Err(CommandQueueFull)) {
            let mut model = lock_model(&self.model);
            let (time_s, line) = (model.period as f64 * model.facts.period_s, model.line);
            model.add_message(time_s, line, "command queue full: the key was ignored, press it again");
        }
        sent != Some(Err(CommandQueueFull))
    }

    /// Stops what runs and ends the machine thread: the operator is gone. It is called until the thread has ended.
    pub(super) fn stop_and_quit(&self) {
        self.send_to_job(OperatorCommand::Stop);
        // The receiver is gone where the machine thread has ended already.
        let _ = self.commands.send(UiCommand::Quit);
    }

    fn route(&self) -> std::sync::MutexGuard<'_, Route> {
        // The value is valid after a panic of another thread.
        self.route.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Whether a command may start motion, or changes what a motion does that is started next.
pub(super) const fn is_start(command: &UiCommand) -> bool {
    matches!(
        command,
        UiCommand::Start
            | UiCommand::StartContour(_)
            | UiCommand::StartLine(_)
            | UiCommand::StartShopJob { .. }
            | UiCommand::ResumeJob(_)
            | UiCommand::Task(_)
            | UiCommand::Frame(_)
            | UiCommand::AlignSheet
            | UiCommand::SetTables(_)
    )
}

/// Whether a command starts a program.
const fn is_program_start(command: &UiCommand) -> bool {
    matches!(
        command,
        UiCommand::Start
            | UiCommand::StartContour(_)
            | UiCommand::StartLine(_)
            | UiCommand::StartShopJob { .. }
            | UiCommand::ResumeJob(_)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use retrace_config::MachineConfig;
    use retrace_controller::{JogSpeed, ManualTask};
    use retrace_tui::ProgramFacts;

    fn router() -> (Arc<CommandRouter>, Receiver<UiCommand>) {
        let machine = MachineConfig::built_in().expect("valid");
        let facts = Arc::new(ProgramFacts::of(&machine, "part.ngc", "M2\n"));
        CommandRouter::new(Arc::new(Mutex::new(ScreenModel::new(facts))))
    }

    #[test]
    fn a_hold_cancels_the_starts_before_it_and_none_behind_it() {
        let (router, commands) = router();
        let jog = || UiCommand::Task(ManualTask::JogOn { axis: 'x', up: true, speed: JogSpeed::Full });
        assert!(router.route_command(jog()) && router.route_command(UiCommand::Start));
        assert!(router.route_command(UiCommand::Job(OperatorCommand::Hold)));
        assert!(router.route_command(UiCommand::Start));
        assert_eq!(commands.try_iter().filter(is_start).count(), 3, "every command arrives");
        let begun = [(); 3].map(|()| router.begin_job(router.receive_start()).is_some());
        assert_eq!(begun, [false, false, true]);
        router.end_job();
        assert!(router.route_command(jog()), "the machine is at rest");
        assert!(!router.route_command(jog()), "one task at a time");
        assert!(router.begin_job(router.receive_start()).is_some());
        router.end_job();
        router.finish_start();
        assert!(router.route_command(jog()));
        // The third one runs: it has the next hold.
        assert!(!router.route_command(jog()), "no task while it runs");
        let mut receiver = router.begin_job(NOT_CANCELLABLE).expect("never cancelled");
        router.send_to_job(OperatorCommand::Hold);
        assert_eq!(receiver.next_command(), Some(OperatorCommand::Hold));
    }

    #[test]
    fn no_start_of_a_program_waits_behind_another_one() {
        let (router, commands) = router();
        let piece = || UiCommand::StartShopJob { id: "a job".into(), pieces: 1 };
        assert!(router.route_command(piece()));
        for start in [piece(), UiCommand::Start, UiCommand::StartLine(3)] {
            assert!(!router.route_command(start), "the first one is on its way");
        }
        let started = router.begin_job(router.receive_start());
        assert!(started.is_some() && !router.route_command(piece()) && !router.route_command(UiCommand::Start));
        {
            let mut model = lock_model(&router.model);
            (model.stage, model.hold_reason) = (retrace_tui::ScreenStage::Job, retrace_journal::HoldReason::Ended);
        }
        assert!(router.route_command(piece()), "the first one has come to its end");
        assert!(!router.route_command(piece()) && !router.route_command(UiCommand::Start), "one only");
        router.end_job();
        assert_eq!(commands.try_iter().filter(is_start).count(), 2);
        // A hold cancels what is on its way; the next start is one of its own.
        assert!(router.route_command(UiCommand::Job(OperatorCommand::Hold)));
        assert!(router.route_command(UiCommand::Start));
    }
}
