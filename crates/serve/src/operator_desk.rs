//! The operator's desk: checks the orders of pages and passes them on to the machine.
//!
//! Invariant: only the page in control moves the machine, with orders of the present turn that were given to the
//! present state; everybody may hold. An order that is refused changes nothing.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use retrace_config::{NumberedError, OnLostControl};
use retrace_controller::{JogSpeed, ManualTask, OperatorCommand};
use retrace_tui::{ScreenModel, ScreenStage, UiCommand, lock_model};

use crate::command_words::{self, Order};
use crate::control::{Client, Control, ControlError};
use crate::dead_man::DeadMan;
use crate::host::ServeHost;
use crate::messages::ControlAction;
use crate::programs::ProgramFolders;
use crate::publisher::{Publisher, Snapshot};
use crate::session::Rights;

/// Largest number of handwheel counts in one message.
const MAX_COUNTS: i32 = 200;

/// The desk, shared by all pages.
pub(crate) struct OperatorDesk {
    model: Arc<Mutex<ScreenModel>>,
    host: Arc<dyn ServeHost>,
    folders: ProgramFolders,
    lost_control: OnLostControl,
    begun: Instant,
    state: Mutex<DeskState>,
    /// Whether a page holds a jog; readable where the state is locked for ever.
    jog_is_held: AtomicBool,
}

struct DeskState {
    publisher: Publisher,
    snapshot: Option<Snapshot>,
    control: Control,
    dead_man: DeadMan,
}

/// What an order of a page belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct OrderContext {
    /// Page.
    pub(crate) client: Client,
    /// Its rights.
    pub(crate) rights: Rights,
    /// Turn of control that it names.
    pub(crate) turn: u32,
    /// State that it has seen.
    pub(crate) seen: u32,
}

impl OperatorDesk {
    /// Desk of a machine.
    pub(crate) fn new(
        model: Arc<Mutex<ScreenModel>>,
        host: Arc<dyn ServeHost>,
        folders: ProgramFolders,
        lost_control: OnLostControl,
    ) -> Self {
        let state = DeskState {
            publisher: Publisher::new(Arc::clone(&model)),
            snapshot: None,
            control: Control::default(),
            dead_man: DeadMan::default(),
        };
        Self {
            model,
            host,
            folders,
            lost_control,
            begun: Instant::now(),
            state: Mutex::new(state),
            jog_is_held: AtomicBool::new(false),
        }
    }

    /// The screen model.
    pub(crate) fn model(&self) -> MutexGuard<'_, ScreenModel> {
        lock_model(&self.model)
    }

    /// What the command line's side of the machine can do.
    pub(crate) fn host(&self) -> &dyn ServeHost {
        &*self.host
    }

    /// Folders of programs.
    pub(crate) fn folders(&self) -> &ProgramFolders {
        &self.folders
    }

    fn state(&self) -> MutexGuard<'_, DeskState> {
        // The state is valid after a panic of another thread.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether a page holds a jog. It waits for no lock.
    pub(crate) fn holds_jog(&self) -> bool {
        self.jog_is_held.load(Ordering::Relaxed)
    }

    /// Time until a held jog ends, unless a beat comes.
    pub(crate) fn jog_left(&self) -> Option<Duration> {
        self.state().dead_man.left(self.now())
    }

    /// Changes the dead man's switch.
    fn switch<T>(&self, state: &mut DeskState, change: impl FnOnce(&mut DeadMan) -> T) -> T {
        let changed = change(&mut state.dead_man);
        self.jog_is_held.store(state.dead_man.is_held(), Ordering::Relaxed);
        changed
    }

    fn now(&self) -> Duration {
        self.begun.elapsed()
    }

    /// Lets time pass. Returns the new snapshot, if something has changed, and the state of control.
    pub(crate) fn advance(&self) -> (Option<Snapshot>, Control) {
        let now = self.now();
        let mut state = self.state();
        if self.switch(&mut state, |switch| switch.is_overdue(now)) {
            self.stop_jog("the jog ended: the page sent no beat");
        }
        let snapshot = state.publisher.poll();
        if snapshot.is_some() {
            state.snapshot.clone_from(&snapshot);
        }
        let at_rest = state.snapshot.as_ref().is_none_or(|snapshot| snapshot.at_rest);
        state.control.advance(at_rest, now);
        (snapshot, state.control.clone())
    }

    /// The newest snapshot, and the state of control.
    pub(crate) fn newest(&self) -> (Option<Snapshot>, Control) {
        let state = self.state();
        (state.snapshot.clone(), state.control.clone())
    }

    /// Page that asks for control, and the seconds that are left for an answer.
    pub(crate) fn control_request(&self, control: &Control) -> Option<(Client, u64)> {
        control.request(self.now())
    }

    fn stop_jog(&self, why: &str) {
        self.host.send(UiCommand::Job(OperatorCommand::Hold));
        let mut model = self.model();
        let time_s = model.period as f64 * model.facts.period_s;
        model.add_message(time_s, 0, why);
    }

    /// Feed hold, and the end of a jog, whoever asks for it.
    pub(crate) fn hold(&self, client: Client) {
        self.switch(&mut self.state(), |switch| switch.release(client));
        self.host.send(UiCommand::Job(OperatorCommand::Hold));
    }

    fn check(&self, state: &DeskState, context: OrderContext, starts_motion: bool) -> Result<(), NumberedError> {
        if context.rights != Rights::Operate {
            let what = "this page may watch and hold only";
            return Err(NumberedError::new("E2403", what, "open the page with the address that the command prints"));
        }
        state.control.check(context.client, context.turn).map_err(|why| match why {
            ControlError::NotHolder => NumberedError::new("E2404", "this page is not in control", "take control first"),
            ControlError::OldTurn => {
                NumberedError::new("E2405", "control was taken over in between", "look at the machine and order again")
            }
        })?;
        let n = state.snapshot.as_ref().map_or(0, |snapshot| snapshot.n);
        if starts_motion && context.seen != n {
            let what = format!("the machine has changed: {}", state.publisher.changes_since(context.seen));
            return Err(NumberedError::new("E2406", what, "look at the machine and order again"));
        }
        Ok(())
    }

    /// Executes an order in words.
    ///
    /// # Errors
    /// Why it is refused.
    pub(crate) fn order(&self, context: OrderContext, words: &str) -> Result<(), NumberedError> {
        if words.trim() == "hold" {
            self.hold(context.client);
            return Ok(());
        }
        let order = command_words::parse(words, &self.model())?;
        {
            let mut state = self.state();
            self.check(&state, context, command_words::starts_motion(&order))?;
            self.switch(&mut state, |switch| switch.release(context.client));
        }
        let command = match order {
            Order::Command(command) => command,
            Order::Open(name) => UiCommand::Load(self.program_file(&name)?),
            Order::Resume(job) => UiCommand::ResumeJob(job),
        };
        self.check_stage(&command)?;
        self.pass_on(command)
    }

    /// Passes on new offsets or tools: for the page in control, at rest, while no job runs.
    ///
    /// # Errors
    /// Why it is refused.
    pub(crate) fn order_tables(&self, context: OrderContext, command: UiCommand) -> Result<(), NumberedError> {
        let state = self.state();
        self.check(&state, context, false)?;
        self.check_stage(&command)?;
        let is_free = {
            let model = self.model();
            model.at_rest && model.question.is_none() && model.stage != ScreenStage::Resuming
        };
        if !is_free || state.dead_man.is_held() {
            let cause = "the machine moves, or a question is open";
            return Err(NumberedError::new("E2423", cause, "wait until it is at rest, and answer the question"));
        }
        self.pass_on(command)
    }

    fn pass_on(&self, command: UiCommand) -> Result<(), NumberedError> {
        if self.host.send(command) {
            return Ok(());
        }
        Err(NumberedError::new("E2421", "the machine is busy with the order before", "wait until it is done, or hold"))
    }

    fn program_file(&self, name: &str) -> Result<PathBuf, NumberedError> {
        self.folders.find(name).ok_or_else(|| {
            let what = format!("there is no program {name} in the programs folder");
            NumberedError::new("E2407", what, "upload it, or choose one of the list")
        })
    }

    /// Checks that a command applies at this stage: those to a job need one, and tasks need none.
    fn check_stage(&self, command: &UiCommand) -> Result<(), NumberedError> {
        let model = self.model();
        let is_job = model.stage == ScreenStage::Job;
        let refuse = |what: &str, remedy: &str| Err(NumberedError::new("E2408", what, remedy.to_owned()));
        match command {
            UiCommand::Job(_) | UiCommand::Turn(_) if !is_job => {
                refuse("no program is running", "start one, or set the machine up")
            }
            UiCommand::Task(ManualTask::ClearAlarm) if model.alarm.is_none() => {
                refuse("no alarm is active", "nothing needs to be done")
            }
            UiCommand::Task(_)
            | UiCommand::Frame(_)
            | UiCommand::SheetPoint
            | UiCommand::AlignSheet
            | UiCommand::ForgetSheet
            | UiCommand::DryRun(_)
            | UiCommand::SetTables(_)
            | UiCommand::StartContour(_)
            | UiCommand::StartLine(_)
                if is_job && *command != UiCommand::Task(ManualTask::ClearAlarm) =>
            {
                refuse("a program is running", "stop it first, or wait until it has ended")
            }
            UiCommand::Load(_) | UiCommand::SetUp | UiCommand::ResumeJob(_) | UiCommand::StartShopJob { .. }
                if is_job && !model.is_at_program_end() =>
            {
                refuse("a program is running", "stop it first, or wait until it has ended")
            }
            UiCommand::Answer(_) if model.question.is_none() => {
                refuse("no question is open", "nothing needs to be done")
            }
            _ => Ok(()),
        }
    }

    /// Turns the handwheel.
    ///
    /// # Errors
    /// Why it is refused.
    pub(crate) fn turn_wheel(&self, context: OrderContext, counts: i32) -> Result<(), NumberedError> {
        self.check(&self.state(), context, false)?;
        self.host.send(UiCommand::Turn(counts.clamp(-MAX_COUNTS, MAX_COUNTS)));
        Ok(())
    }

    /// Begins a jog that is held to run, along an axis, upward or not, at a speed.
    ///
    /// # Errors
    /// Why it is refused.
    pub(crate) fn jog(
        &self,
        context: OrderContext,
        (axis, up, speed): (&str, bool, JogSpeed),
        beat: u32,
    ) -> Result<(), NumberedError> {
        let axis = command_words::axis(axis, &self.model())?;
        let command = UiCommand::Task(ManualTask::JogOn { axis, up, speed });
        self.check_stage(&command)?;
        let mut state = self.state();
        self.check(&state, context, true)?;
        if state.dead_man.is_held() {
            return Err(NumberedError::new("E2409", "another jog is held", "release it first"));
        }
        let now = self.now();
        self.pass_on(command)?;
        self.switch(&mut state, |switch| switch.press(context.client, beat, now));
        Ok(())
    }

    /// A beat of a jog.
    pub(crate) fn beat(&self, client: Client, beat: u32) {
        let now = self.now();
        if self.switch(&mut self.state(), |switch| switch.beat(client, beat, now)) {
            self.stop_jog("the jog ended: a beat of another one came");
        }
    }

    /// Ends a jog.
    pub(crate) fn end_jog(&self, client: Client) {
        if self.switch(&mut self.state(), |switch| switch.release(client)) {
            self.host.send(UiCommand::Job(OperatorCommand::Hold));
        }
    }

    /// Takes or passes control. A jog or the handwheel of the page that had it ends.
    pub(crate) fn change_control(&self, client: Client, rights: Rights, action: ControlAction) {
        if rights != Rights::Operate {
            return;
        }
        let now = self.now();
        let mut state = self.state();
        let before = state.control.holder();
        let at_rest = state.snapshot.as_ref().is_none_or(|snapshot| snapshot.at_rest);
        match action {
            ControlAction::Take => state.control.take(client, at_rest, now),
            ControlAction::Give => state.control.give(client),
            ControlAction::Keep => state.control.keep(client),
            ControlAction::Release => state.control.release(client),
        }
        let has_passed = before.is_some() && before != state.control.holder();
        let ends_jog =
            has_passed && before.is_some_and(|before| self.switch(&mut state, |switch| switch.release(before)));
        let retraces = state.snapshot.as_ref().is_some_and(|snapshot| snapshot.is_retracing);
        if ends_jog || has_passed && retraces {
            self.host.send(UiCommand::Job(OperatorCommand::Hold));
        }
    }

    /// A page's link is lost: what it held ends; a program runs on or is held, as the machine file says.
    pub(crate) fn disconnect(&self, client: Client) {
        let now = self.now();
        let mut state = self.state();
        let ends_jog = self.switch(&mut state, |switch| switch.release(client));
        let was_holder = state.control.disconnect(client, now);
        if was_holder {
            // nobody is there to see the next piece begin
            self.host.send(UiCommand::EndSeries);
        }
        let Some(snapshot) = &state.snapshot else { return };
        let holds = snapshot.is_retracing || snapshot.runs_program && self.lost_control == OnLostControl::Hold;
        if ends_jog || was_holder && holds {
            self.stop_jog("held: the page in control has lost its link");
        }
    }
}
