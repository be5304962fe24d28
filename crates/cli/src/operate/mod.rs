//! Full-screen operation: joins the screen, the machine by hand, and the jobs that run on it.
//!
//! Three threads: the screen, which may come to stand still with its terminal; the machine, which is set up, runs a job and stands again
//! ([`machinist`]); and this one, which looks after both.
//!
//! Invariant: the machine never runs on without its operator. Where the terminal is gone, by a signal, by an error or because nothing can be
//! shown on it any more, the job is stopped on its path and can be resumed.

mod command_router;
mod machine_thread;
mod preview_thread;
mod signals;

use std::io::IsTerminal;
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use retrace_controller::machine::MachineConfig;
use retrace_controller::numbered_error::NumberedError;
use retrace_controller::operator::{OperatorCommand, ScriptInstruction};
use retrace_link::MotionCard;

use crate::args;
use crate::console::unwritable;
use crate::homing_notes::Homing;
use crate::program::{CommandFailure, Program};
use crate::resume_summary::Asking;
use crate::run::{At, TuiOptions};
use crate::screen::Screen;
use crate::screen::model::ScreenModel;
use crate::screen::model_observer::locked;

use command_router::CommandRouter;
use machine_thread::MachineThread;
use signals::Signals;

/// How often it is looked after.
const LOOKS_EVERY: Duration = Duration::from_millis(20);
/// A screen that shows nothing for so long cannot be operated: the machine is held.
const HELD_AFTER: Duration = Duration::from_secs(5);
/// And after so long its terminal counts as gone.
const GONE_AFTER: Duration = Duration::from_secs(60);
/// So long the screen may take to put the terminal back.
const TO_LEAVE: Duration = Duration::from_secs(1);

/// Is the machine to be operated at a screen?
///
/// # Errors
/// `E2142` where one was asked for that there cannot be.
pub fn is_wanted(args: &args::Run) -> Result<bool, NumberedError> {
    let is_terminal = std::io::stdout().is_terminal();
    if !args.tui {
        return Ok(!args.no_tui && !args.format.json && args.realtime && is_terminal);
    }
    if args.format.json {
        let what = "--tui and --json both want standard output";
        return Err(NumberedError::new(
            "E2142",
            what,
            "leave one out; --journal DIR keeps the report of a job at the screen",
        ));
    }
    needs_terminal()?;
    Ok(true)
}

/// The screen needs a terminal.
///
/// # Errors
/// `E2142` where standard output is none.
pub fn needs_terminal() -> Result<(), NumberedError> {
    if std::io::stdout().is_terminal() {
        return Ok(());
    }
    let what = "--tui: standard output is not a terminal";
    Err(NumberedError::new("E2142", what, "run it in a terminal, or leave --tui out"))
}

/// Runs a job that is resumed, on a card, at a screen; asks before anything moves. Its exit code.
pub type Resume<'f, const A: usize, C> =
    Box<dyn FnOnce(&mut C, TuiOptions<'_>, &mut Asking<'_, A>) -> Result<u8, CommandFailure> + Send + 'f>;

/// A job that the screen begins with: it was interrupted, and is resumed.
pub struct ResumingJob<'f, const A: usize, C> {
    /// Place of its first record.
    pub origin: u32,
    /// The operator has agreed already to what will be done.
    pub is_agreed: bool,
    /// Runs it.
    pub resume: Resume<'f, A, C>,
}

/// Operates a machine that stands, on an open card, until the operator quits or the terminal is gone: the exit code of the last job; that of
/// a stopped one where none has run. `program` is checked here, and may have errors. It begins with a job that is `resumed`, if there is one, and is
/// left at once where that cannot be.
///
/// # Errors
/// The terminal cannot be taken.
pub fn operate<const A: usize, C: MotionCard<A> + Send>(
    args: &args::Run,
    machine: &MachineConfig,
    program: Program,
    (script, at): (Vec<ScriptInstruction>, At),
    card: &mut C,
    homing: &Homing,
    resumed: Option<ResumingJob<'_, A, C>>,
) -> Result<u8, CommandFailure> {
    let signals = Signals::listen().map_err(|error| unwritable("the list of signals", &error))?;
    let program = Arc::new(program);
    let model = Arc::new(Mutex::new(ScreenModel::new(Arc::new(preview_thread::facts(machine, &program)))));
    preview_thread::show_program::<A>(&model, machine.clone(), &program);
    if let Some(resumed) = &resumed {
        preview_thread::show_resuming(&model, resumed.origin);
    }
    let (desk, words) = CommandRouter::new(Arc::clone(&model));
    let mut screen = Watched::begin(&model, &desk);
    let machinist =
        MachineThread::<A, C>::new(args.clone(), (machine, homing), (program, script, at), card, words, &desk);
    let machinist = machinist.resuming(resumed);
    let done = thread::scope(|scope| {
        let machine = scope.spawn(|| machinist.work());
        while !machine.is_finished() {
            thread::sleep(LOOKS_EVERY);
            if signals.came() || screen.is_gone() {
                desk.leave();
            } else if screen.is_stuck() {
                desk.say_to_job(OperatorCommand::Hold);
            }
        }
        // A panic over there is a defect, never an input; it is passed on when the terminal is as it was.
        machine.join()
    });
    let shown = screen.end();
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

/// The screen in its thread.
struct Watched {
    thread: Option<JoinHandle<std::io::Result<()>>>,
    model: Arc<Mutex<ScreenModel>>,
    /// When a picture was last seen to be drawn, and how many there were then.
    drawn: (Instant, u64),
    held: bool,
}

impl Watched {
    fn begin(model: &Arc<Mutex<ScreenModel>>, desk: &Arc<CommandRouter>) -> Self {
        let (picture, desk) = (Arc::clone(model), Arc::clone(desk));
        let thread = thread::spawn(move || Screen::default().run(&picture, |said| desk.say(said)));
        Self { thread: Some(thread), model: Arc::clone(model), drawn: (Instant::now(), 0), held: false }
    }

    /// Has it been left, whatever the reason, or has its terminal gone?
    fn is_gone(&mut self) -> bool {
        let count = locked(&self.model).redraw.count;
        if count != self.drawn.1 {
            (self.drawn, self.held) = ((Instant::now(), count), false);
        }
        self.thread.as_ref().is_none_or(JoinHandle::is_finished) || self.drawn.0.elapsed() > GONE_AFTER
    }

    /// Has it stood still for long? Said once.
    fn is_stuck(&mut self) -> bool {
        self.drawn.0.elapsed() > HELD_AFTER && !std::mem::replace(&mut self.held, true)
    }

    /// Has it leave the terminal. One that stands still with its terminal is left to itself.
    fn end(mut self) -> std::io::Result<()> {
        locked(&self.model).over = true;
        let begun = Instant::now();
        while self.thread.as_ref().is_some_and(|thread| !thread.is_finished()) {
            if begun.elapsed() > TO_LEAVE {
                crate::screen::put_back();
                return Ok(());
            }
            thread::sleep(LOOKS_EVERY);
        }
        let thread = self.thread.take().map_or(Ok(Ok(())), JoinHandle::join);
        thread.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}
