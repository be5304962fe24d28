//! Operation at a screen: connects the screens, manual operation, and the jobs that run.
//!
//! Up to four threads: the terminal screen, which may block with its terminal; the server of the page in a browser
//! ([`page`]); the machine ([`machine_thread`]), which executes manual tasks and jobs; and this one, which supervises
//! them.
//!
//! Invariant: the machine never runs without its operator. Where the terminal is gone, by a signal or an error or
//! because nothing can be drawn on it, the job is stopped on its path and can be resumed; where the server of the page
//! no longer responds, the machine is held.

mod command_router;
mod held_jog;
mod machine_thread;
mod manual_observer;
mod page;
mod preview_thread;
#[cfg(feature = "shop")]
mod shop_job_watch;
mod signals;
mod table_edits;

use retrace_core::RecordIndex;
use std::io::IsTerminal;
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use retrace_config::{MachineConfig, NumberedError};
use retrace_controller::{AnyCard, ManualTask, OperatorCommand, ScriptInstruction};
use retrace_tui::{Screen, ScreenModel, UiCommand, lock_model};

use crate::args;
use crate::command_failure::CommandFailure;
use crate::files::unwritable;
use crate::homing_notes::Homing;
use crate::job_runner::TuiOptions;
use crate::job_spec::MachineAndCard;
use crate::program::Program;
use crate::resume_summary::ConfirmResume;
use crate::state_socket::StateSocket;

use command_router::CommandRouter;
use held_jog::HeldJog;
use machine_thread::MachineThread;
use signals::Signals;

/// Interval of the supervision.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// A screen that draws nothing for this long cannot be operated: the machine is held.
const HELD_AFTER: Duration = Duration::from_secs(5);
/// After this long without a redraw the terminal counts as gone.
const GONE_AFTER: Duration = Duration::from_secs(60);
/// Time that the screen may take to restore the terminal.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(1);

/// Screens at which the machine is operated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Screens {
    /// The screen in the terminal.
    pub terminal: bool,
    /// The page in a browser.
    pub page: bool,
}

impl Screens {
    /// Screens that the command line requests.
    ///
    /// # Errors
    /// `E2142` where one is requested and impossible.
    pub fn of(args: &args::Run) -> Result<Self, NumberedError> {
        if args.page.serve && args.format.json {
            let what = "--serve and --json: the job is operated on the page";
            return Err(NumberedError::new("E2142", what, "omit one of them; --journal DIR saves the report of a job"));
        }
        Ok(Self { terminal: terminal_is_requested(args)?, page: args.page.serve })
    }

    /// Whether there is any.
    pub fn any(self) -> bool {
        self.terminal || self.page
    }
}

/// Whether the machine is to be operated at the screen in the terminal.
fn terminal_is_requested(args: &args::Run) -> Result<bool, NumberedError> {
    let is_terminal = std::io::stdout().is_terminal();
    if !args.operation.tui {
        let is_default = args.operation.realtime && !args.page.serve;
        return Ok(!args.no_tui && !args.format.json && is_default && is_terminal);
    }
    if args.format.json {
        let what = "--tui and --json both need standard output";
        return Err(NumberedError::new(
            "E2142",
            what,
            "omit one of them; --journal DIR saves the report of a job at the screen",
        ));
    }
    needs_terminal()?;
    Ok(true)
}

/// Checks that standard output is a terminal.
///
/// # Errors
/// `E2142` where it is not.
pub fn needs_terminal() -> Result<(), NumberedError> {
    if std::io::stdout().is_terminal() {
        return Ok(());
    }
    let what = "--tui: standard output is not a terminal";
    Err(NumberedError::new("E2142", what, "run the command in a terminal, or omit --tui"))
}

/// Runs a resumed job on a card at a screen, with a question before anything moves. Returns its exit code.
pub type Resume<'f, const A: usize> = Box<
    dyn FnOnce(&mut AnyCard<'_, A>, TuiOptions<'_>, &mut ConfirmResume<'_, A>) -> Result<u8, CommandFailure>
        + Send
        + 'f,
>;

/// Job to resume when the screen opens.
pub struct ResumingJob<'f, const A: usize> {
    /// Record at which its path starts.
    pub origin: RecordIndex,
    /// Whether the operator has confirmed already.
    pub is_confirmed: bool,
    /// Function that runs it.
    pub resume: Resume<'f, A>,
}

/// Operates a machine at rest, on an open card, until the operator quits or the terminal is gone. Returns the exit code
/// of the last job; that of a stopped job where none ran. `program` is checked here, and may have errors. A job in
/// `resumed` is resumed first; where that fails, the screen closes at once.
///
/// # Errors
/// The terminal cannot be opened.
pub fn operate<const A: usize>(
    args: &args::Run,
    machine: &MachineConfig,
    program: Program,
    (script, at): (Vec<ScriptInstruction>, MachineAndCard),
    card: &mut AnyCard<'_, A>,
    homing: &Homing,
    resumed: Option<ResumingJob<'_, A>>,
) -> Result<u8, CommandFailure> {
    let signals = Signals::listen().map_err(|error| unwritable("the list of signals", &error))?;
    let program = Arc::new(program);
    let model = Arc::new(Mutex::new(ScreenModel::new(Arc::new(preview_thread::facts(machine, &program)))));
    let _reported = StateSocket::serve(&model);
    #[cfg(feature = "shop")]
    let _jobs = (!args.page.demo).then(|| shop_job_watch::ShopJobWatch::begin(args, &at.0, &model));
    preview_thread::show_program::<A>(&model, machine.clone(), &program);
    if let Some(resumed) = &resumed {
        preview_thread::show_resuming(&model, resumed.origin);
    }
    let (router, commands) = CommandRouter::new(Arc::clone(&model));
    let screens = Screens::of(args)?;
    let was_announced = args.page.session.is_announced();
    let mut page = if screens.page { Some(page::start(args, machine, &router)?) } else { None };
    // A job that is resumed is operated at the terminal.
    let has_terminal_screen = screens.terminal || !screens.page;
    if let Some(page) = page.as_ref().filter(|_| !was_announced) {
        let lines = page::announce(args, page, has_terminal_screen);
        if has_terminal_screen {
            lines.into_iter().for_each(|line| lock_model(&model).add_message(0.0, 0, line));
        } else {
            lines.iter().for_each(crate::out::line);
        }
    }
    let mut screen = has_terminal_screen.then(|| ScreenThread::begin(&model, &router));
    let machine_thread =
        MachineThread::<A>::new(args.clone(), (machine, homing), (program, script, at), card, commands, &router);
    let machine_thread = machine_thread.resuming(resumed);
    let done = thread::scope(|scope| {
        let machine = scope.spawn(|| machine_thread.work());
        while !machine.is_finished() {
            thread::sleep(POLL_INTERVAL);
            if let Some(screen) = &screen {
                screen.held_jog.end_if_overdue(Instant::now(), &router);
            }
            if signals.have_arrived() || screen.as_mut().is_some_and(ScreenThread::is_gone) {
                router.stop_and_quit();
            } else if screen.as_mut().is_some_and(ScreenThread::is_stuck)
                || page.as_mut().is_some_and(retrace_serve::ServeHandle::is_stuck)
            {
                router.send_to_job(OperatorCommand::Hold);
            }
        }
        // A panic of the machine thread is a defect, never an input; it is passed on once the terminal is restored.
        machine.join()
    });
    drop(page);
    let shown = screen.map_or(Ok(()), ScreenThread::end);
    let done = done.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    if let Some(failure) = done.failure {
        return Err(failure);
    }
    if let (Err(error), false) = (shown, done.ran) {
        return Err(unwritable("the screen", &error).into());
    }
    if let Some(report) = &done.report {
        crate::out::line(report);
    }
    Ok(done.code)
}

/// Screen thread under supervision.
struct ScreenThread {
    thread: Option<JoinHandle<std::io::Result<()>>>,
    model: Arc<Mutex<ScreenModel>>,
    /// Time of the last redraw that was seen, and the number of redraws then.
    drawn: (Instant, u64),
    held: bool,
    /// The jog that a key of the terminal holds.
    held_jog: Arc<HeldJog>,
}

impl ScreenThread {
    fn begin(model: &Arc<Mutex<ScreenModel>>, router: &Arc<CommandRouter>) -> Self {
        let (picture, router) = (Arc::clone(model), Arc::clone(router));
        let held_jog = Arc::new(HeldJog::default());
        let holder = Arc::clone(&held_jog);
        let thread = thread::spawn(move || {
            Screen::default().run(&picture, |command| {
                if let UiCommand::JogHeld { axis, up, speed } = command {
                    return holder.keep((axis, up, speed), Instant::now(), &router);
                }
                match command {
                    UiCommand::Job(OperatorCommand::Hold) => holder.forget(),
                    _ => holder.end(&router),
                }
                if command == UiCommand::JogReleased {
                    return;
                }
                // A jog key that is held down repeats itself.
                let is_repeated = matches!(command, UiCommand::Task(ManualTask::Jog { .. }));
                if !router.route_command(command) && !is_repeated {
                    let mut model = lock_model(&picture);
                    let (time_s, line) = (model.period as f64 * model.facts.period_s, model.line);
                    model.add_message(
                        time_s,
                        line,
                        "E2421: the machine is busy with the order before · wait for its end",
                    );
                }
            })
        });
        Self { thread: Some(thread), model: Arc::clone(model), drawn: (Instant::now(), 0), held: false, held_jog }
    }

    /// Whether the screen was closed, for any reason, or its terminal is gone.
    fn is_gone(&mut self) -> bool {
        let count = lock_model(&self.model).redraw.count;
        if count != self.drawn.1 {
            (self.drawn, self.held) = ((Instant::now(), count), false);
        }
        self.thread.as_ref().is_none_or(JoinHandle::is_finished) || self.drawn.0.elapsed() > GONE_AFTER
    }

    /// Whether the screen has been blocked for long; true once per blockage.
    fn is_stuck(&mut self) -> bool {
        self.drawn.0.elapsed() > HELD_AFTER && !std::mem::replace(&mut self.held, true)
    }

    /// Closes the screen. A screen that is blocked with its terminal is abandoned.
    fn end(mut self) -> std::io::Result<()> {
        lock_model(&self.model).is_closed = true;
        let begun = Instant::now();
        while self.thread.as_ref().is_some_and(|thread| !thread.is_finished()) {
            if begun.elapsed() > CLOSE_TIMEOUT {
                retrace_tui::restore_terminal();
                return Ok(());
            }
            thread::sleep(POLL_INTERVAL);
        }
        let thread = self.thread.take().map_or(Ok(Ok(())), JoinHandle::join);
        thread.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}
