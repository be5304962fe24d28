//! Machine thread: executes manual tasks, runs jobs, and keeps the card served in between.
//!
//! Invariant: control periods continue while no job runs, so that the card hears from its host. Before each job a new
//! path starts at the machine's position.

mod refusals;
mod setting_up;
#[cfg(feature = "shop")]
mod shop_piece;
#[cfg(not(feature = "shop"))]
#[path = "machine_thread/shop_piece_elsewhere.rs"]
mod shop_piece;

use retrace_core::RecordIndex;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, TryRecvError};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use retrace_config::MachineConfig;
use retrace_controller::{
    AnyCard, CardError, CommandSources, ContourStates, Event, EventKind, ManualTask, ManualTaskDone, ManualTaskError,
    ModalContext, Observer, Outcome, PeriodRecord, RunMode, ScriptInstruction, ScriptPlayer, Telemetry,
    perform_manual_task,
};
use retrace_link::{Alarm, MotionCard, OutputChange, PathStart};
use retrace_tui::{
    ModelObserver, ProgramCheck, Question, ScreenModel, ScreenStage, TableChange, UiCommand, diagnostic_lines,
    lock_model,
};

use self::shop_piece::begins_inside_piece;
use super::command_router::{CommandRouter, NOT_CANCELLABLE, is_start};
use super::manual_observer::ManualObserver;
use super::{ResumingJob, preview_thread, table_edits};
use crate::args::{self, Reading};
use crate::command_failure::CommandFailure;
use crate::homing_notes::Homing;
use crate::job_runner::{JobResult, TuiOptions};
use crate::job_script;
use crate::job_spec::{JobSpec, MachineAndCard};
use crate::journaled_job::JournaledJob;
use crate::machine_tables::TableKeeper;
use crate::program::Program;
use crate::program_stream::ProgramStream;
use crate::resume_summary::ResumeSummary;

/// Number of periods between two updates of the screen at rest.
const PUBLISH_PERIODS: u64 = 20;
/// Delay before a card that is at fault is polled again.
const RETRY_DELAY: Duration = Duration::from_millis(5);

/// State in which the machine was left.
#[derive(Debug)]
pub(super) struct ExitState {
    /// Whether any job ran.
    pub(super) ran: bool,
    /// Exit code of the last job.
    pub(super) code: u8,
    /// Report of the last job, for a person.
    pub(super) report: Option<String>,
    /// Why the job was not resumed.
    pub(super) failure: Option<CommandFailure>,
}

/// The machine, its card and its operator.
pub(super) struct MachineThread<'m, 'c, const A: usize> {
    /// Arguments, with the program that is loaded now.
    args: args::Run,
    /// Folder of cycles on the command line.
    own_cycles: Option<PathBuf>,
    machine: MachineConfig,
    homing: &'m Homing,
    program: Arc<Program>,
    script: Vec<ScriptInstruction>,
    machine_and_card: MachineAndCard,
    card: &'m mut AnyCard<'c, A>,
    /// Modal state for MDI blocks and for the next program.
    mdi_context: ModalContext,
    table_keeper: TableKeeper,
    commands: Receiver<UiCommand>,
    router: &'m Arc<CommandRouter>,
    observer: ModelObserver,
    /// Alarm that was reported.
    alarm: Option<Alarm>,
    /// Whether the card has failed for good.
    failed: bool,
    /// Whether M1 stops in later jobs.
    optional_stop: bool,
    /// Number of the start that is being executed.
    start: u64,
    /// Job to resume first.
    resumed: Option<ResumingJob<'m, A>>,
    /// Pieces of a job of the shop that follow the one that runs.
    pieces_behind: u32,
    /// Whether the last job came to the end of its program.
    has_completed: bool,
    exit: ExitState,
}

impl<'m, 'c, const A: usize> MachineThread<'m, 'c, A> {
    /// Machine at rest, on an open card.
    pub(super) fn new(
        args: args::Run,
        (machine, homing): (&MachineConfig, &'m Homing),
        (program, script, machine_and_card): (Arc<Program>, Vec<ScriptInstruction>, MachineAndCard),
        card: &'m mut AnyCard<'c, A>,
        commands: Receiver<UiCommand>,
        router: &'m Arc<CommandRouter>,
    ) -> Self {
        let observer = ModelObserver::new(Arc::clone(&router.model));
        let exit = ExitState { ran: false, code: Outcome::Stopped.exit_code(), report: None, failure: None };
        let (mdi_context, machine) = (ModalContext::new(program.setup().clone()), machine.clone());
        let table_keeper = TableKeeper::new(&args.reading, program.setup());
        let optional_stop = args.operation.optional_stop.is_some_and(args::OnOff::is_on);
        {
            let mut model = lock_model(&router.model);
            (model.optional_stop, model.dry_run) = (optional_stop, machine.inhibits_outputs);
        }
        Self {
            own_cycles: args.reading.cycle_folders.cycles.clone(),
            args,
            machine,
            homing,
            program,
            script,
            machine_and_card,
            card,
            mdi_context,
            table_keeper,
            commands,
            router,
            observer,
            alarm: None,
            failed: false,
            optional_stop,
            start: NOT_CANCELLABLE,
            resumed: None,
            pieces_behind: 0,
            has_completed: false,
            exit,
        }
    }

    /// Adds the job to resume first.
    pub(super) fn resuming(self, resumed: Option<ResumingJob<'m, A>>) -> Self {
        Self { resumed, ..self }
    }

    /// Works until the operator quits.
    pub(super) fn work(mut self) -> ExitState {
        self.publish_outputs();
        self.publish_homing();
        self.show_tables();
        self.show_consumables();
        if let Some(notice) = self.args.page.session.take_notice() {
            self.add_message(notice);
        }
        let active = Box::new(self.mdi_context.active());
        Observer::<A>::on_telemetry(&mut self.observer, &Telemetry::Active(active));
        if let Some(resumed) = self.resumed.take()
            && let Err(failure) = self.resume(resumed)
        {
            return ExitState { failure: Some(failure), ..self.exit };
        }
        loop {
            let received = self.commands.try_recv();
            let starts = received.as_ref().is_ok_and(is_start);
            if starts {
                self.start = self.router.receive_start();
            }
            match received {
                Ok(UiCommand::Start) => self.run_job(self.args.clone()),
                Ok(UiCommand::StartContour(number)) => self.run_from_contour(number),
                Ok(UiCommand::StartLine(line)) => self.run_from_line(line),
                Ok(UiCommand::StartShopJob { id, pieces }) => self.start_shop_job(&id, pieces),
                Ok(UiCommand::SkipContour { number, on }) => self.skip_contour(number, on),
                Ok(UiCommand::ConsumablesChanged) => self.renew_consumables(),
                Ok(UiCommand::SetUp) => self.set_up(),
                Ok(UiCommand::Task(task)) => self.perform_task(&task),
                Ok(UiCommand::Frame(shape)) => self.trace_frame(shape),
                Ok(UiCommand::SheetPoint) => self.take_sheet_point(),
                Ok(UiCommand::AlignSheet) => self.align_sheet(),
                Ok(UiCommand::ForgetSheet) => self.forget_sheet(),
                Ok(UiCommand::Load(path)) => {
                    self.load_program(path, None);
                }
                Ok(UiCommand::CutterOff) => self.cutters_off(),
                Ok(UiCommand::OptionalStop(on)) => {
                    self.optional_stop = on;
                    lock_model(&self.router.model).optional_stop = on;
                }
                Ok(UiCommand::SetTables(change)) => self.set_tables(&change),
                Ok(UiCommand::CloseRefusal) => lock_model(&self.router.model).close_refusal(),
                Ok(UiCommand::DryRun(on)) => {
                    self.machine.inhibits_outputs = on;
                    lock_model(&self.router.model).dry_run = on;
                }
                // Commands to a job that has just ended, or an answer to its question; keys of a jog come as its task.
                Ok(
                    UiCommand::Job(_)
                    | UiCommand::Turn(_)
                    | UiCommand::Answer(_)
                    | UiCommand::EndSeries
                    | UiCommand::JogHeld { .. }
                    | UiCommand::JogReleased,
                ) => {}
                Ok(UiCommand::ResumeJob(job)) => {
                    self.args.page.session.request_resume(job);
                    return self.exit_state();
                }
                Ok(UiCommand::Quit) | Err(TryRecvError::Disconnected) => return self.exit_state(),
                Err(TryRecvError::Empty) => self.idle_period(),
            }
            if starts {
                self.router.finish_start();
            }
        }
    }

    /// Exit state: exit code 1 where no job ran because the program has errors.
    fn exit_state(self) -> ExitState {
        let is_refused = matches!(lock_model(&self.router.model).facts.check, ProgramCheck::Failed(_));
        let code = if is_refused && !self.exit.ran { 1 } else { self.exit.code };
        ExitState { code, ..self.exit }
    }

    /// Passes one control period at rest.
    fn idle_period(&mut self) {
        if let Err(fault) = self.card.run_period() {
            let error = CardError::from(fault);
            // A latched alarm is reported below, and can be cleared.
            if self.card.status().alarm.is_none() && !self.failed {
                self.failed = true;
                self.emit(EventKind::Alarm(error));
            }
            thread::sleep(RETRY_DELAY);
        }
        let status = *self.card.status();
        if status.alarm != self.alarm {
            self.alarm = status.alarm;
            match status.alarm {
                Some(alarm) => self.emit(EventKind::Alarm(CardError::Latched(alarm))),
                None => lock_model(&self.router.model).clear_alarm(),
            }
        }
        if status.period.is_multiple_of(PUBLISH_PERIODS) {
            let period = PeriodRecord { off_path: true, ..PeriodRecord::from_status(&status) };
            Observer::<A>::on_telemetry(&mut self.observer, &Telemetry::Period(period));
        }
    }

    fn emit(&mut self, kind: EventKind) {
        let status = self.card.status();
        let time_s = status.period as f64 * self.machine.period_s();
        let event = Event { period: status.period, time_s, place: status.place, line: status.line, kind };
        Observer::<A>::on_telemetry(&mut self.observer, &Telemetry::Event(event));
    }

    fn add_message(&mut self, text: impl Into<String>) {
        let time_s = self.card.status().period as f64 * self.machine.period_s();
        lock_model(&self.router.model).add_message(time_s, 0, text);
    }

    /// Reports every output.
    fn publish_outputs(&mut self) {
        let outputs = self.card.status().outputs;
        for (channel, &value) in (0u8..).zip(&outputs) {
            let change = OutputChange { channel, value };
            if lock_model(&self.router.model).output(change.channel) != change.value {
                Observer::<A>::on_telemetry(&mut self.observer, &Telemetry::Output(change));
            }
        }
    }

    /// Reports whether a program may move the machine.
    fn publish_homing(&mut self) {
        let (homed, homing) = (self.homing.check(&self.machine).is_ok(), self.homing.axes(&self.machine));
        let mut model = lock_model(&self.router.model);
        (model.homed, model.homing) = (homed, homing);
        model.changes += 1;
    }

    /// Whether a task is an MDI block that moves the machine.
    fn moves_machine(&self, task: &ManualTask, machine: &MachineConfig) -> bool {
        match task {
            ManualTask::Mdi(block) => self.mdi_context.block(machine, block).is_ok_and(|block| block.moves()),
            // It goes to a position.
            ManualTask::SenseTest => true,
            _ => false,
        }
    }

    /// Returns to setup after a job.
    fn set_up(&mut self) {
        let mut model = lock_model(&self.router.model);
        if model.stage != ScreenStage::Job {
            model.stage = ScreenStage::Setup;
            model.changes += 1;
        }
    }

    /// Executes a manual task.
    fn perform_task(&mut self, task: &ManualTask) {
        if matches!(task, ManualTask::Home(_)) {
            self.forget_sheet();
        }
        let machine = self.machine.clone().standing_at(&self.machine.position_counts(self.card.status()));
        let script = CommandSources::from_script(ScriptPlayer::new(Vec::new(), machine.period_us));
        let Some(commands) = self.router.begin_job(self.start) else { return self.add_message("held before it began") };
        self.show_task(task);
        let command_sources = script.with_operator(commands);
        let run_mode = RunMode { wall_time: true, operator: true, real_time: false };
        let mut shown = ManualObserver(self.observer.clone());
        let unhomed = self.moves_machine(task, &machine).then(|| self.homing.check(&machine).err()).flatten();
        let done = match unhomed {
            Some(refusal) => Err(refusal.into()),
            None => self.homing.perform_and_record(task, &machine, || {
                perform_manual_task(
                    task,
                    &machine,
                    &mut self.mdi_context,
                    self.card,
                    (command_sources, run_mode),
                    &mut shown,
                )
            }),
        };
        self.router.end_job();
        self.publish_homing();
        match done {
            Ok(ManualTaskDone::Completed { cut_short: false }) if *task == ManualTask::ClearAlarm => {
                self.add_message("alarm cleared")
            }
            Ok(ManualTaskDone::Completed { cut_short: true }) => self.add_message("stopped at the soft limit"),
            Ok(ManualTaskDone::Completed { .. }) => self.report_done(task),
            Ok(ManualTaskDone::Stopped) => self.report_stopped(),
            Err(ManualTaskError::Numbered(refusal)) => self.reject(refusal),
            Err(ManualTaskError::Block(lines)) => {
                let lines: Vec<String> = lines.iter().flat_map(|text| diagnostic_lines(text)).collect();
                let cause = lines.first().cloned().unwrap_or_default();
                lines.into_iter().for_each(|line| self.add_message(line));
                lock_model(&self.router.model).reject(None, cause, "");
            }
            Err(ManualTaskError::Card(_)) if *task == ManualTask::ClearAlarm => {
                self.reject_text("not cleared: its cause is still present")
            }
            // An alarm is reported at the next period at rest.
            Err(ManualTaskError::Card(CardError::Latched(_))) => {}
            Err(ManualTaskError::Card(error)) => self.emit(EventKind::Alarm(error)),
        }
        self.keep_tables();
        if self.card.status().alarm.is_none() {
            lock_model(&self.router.model).clear_alarm();
        }
        let active = Box::new(self.mdi_context.active());
        Observer::<A>::on_telemetry(&mut self.observer, &Telemetry::Active(active));
        self.publish_outputs();
        self.check_again();
    }

    /// Replaces offsets and tool data.
    fn set_tables(&mut self, change: &TableChange) {
        match table_edits::apply(&self.router.model, &self.machine, &mut self.mdi_context, change) {
            Ok(()) => self.add_message("offsets or tools were changed on a page"),
            Err(refusal) => return self.reject(refusal),
        }
        self.keep_tables();
        let active = Box::new(self.mdi_context.active());
        Observer::<A>::on_telemetry(&mut self.observer, &Telemetry::Active(active));
        self.check_again();
    }

    /// Writes changed offsets and tools to their files, and shows them.
    fn keep_tables(&mut self) {
        if let Err(refusal) = self.table_keeper.write_changes(self.mdi_context.modal_snapshot()) {
            self.reject(refusal);
        }
        self.show_tables();
    }

    /// Shows offsets and tools.
    fn show_tables(&self) {
        table_edits::show(&self.router.model, &self.machine, &self.mdi_context);
    }

    /// Checks the program again and redraws its path, for the current position and offsets.
    fn check_again(&self) {
        let machine = self.machine.clone().standing_at(&self.machine.position_counts(self.card.status()));
        let setup = self.mdi_context.setup_of_program(&machine);
        preview_thread::check_again::<A>(&self.router.model, machine, &self.program, setup);
        self.draw_on_sheet();
    }

    /// Loads another program, and returns whether it is loaded. Where its file cannot be read, the previous one stays.
    fn load_program(&mut self, path: PathBuf, cycles: Option<PathBuf>) -> bool {
        if lock_model(&self.router.model).stage == ScreenStage::Job {
            return false;
        }
        let machine = self.machine.clone().standing_at(&self.machine.position_counts(self.card.status()));
        let mut reading = Reading { program: path, ..self.args.reading.clone() };
        reading.cycle_folders.cycles = cycles.or_else(|| self.own_cycles.clone());
        let (program, setup) = (Arc::clone(&self.program), self.mdi_context.setup_of_program(&machine));
        let loaded = self.while_idle({
            let reading = reading.clone();
            move || program.load_other(&reading, setup)
        });
        match loaded {
            Ok(program) => {
                self.program = Arc::new(program);
                // A start line belonged to the previous program.
                self.args = args::Run { reading, start_line: None, contour: None, ..self.args.clone() };
                lock_model(&self.router.model).stage = ScreenStage::Setup;
                lock_model(&self.router.model).contours = ContourStates::default();
                preview_thread::show_program::<A>(&self.router.model, machine, &self.program);
                self.show_tables();
                true
            }
            Err(refusal) => {
                self.reject(refusal);
                false
            }
        }
    }

    /// Does work that may take long while control periods continue, so that the card hears from its host.
    fn while_idle<T: Send>(&mut self, work: impl FnOnce() -> T + Send) -> T {
        let done = thread::scope(|scope| {
            let working = scope.spawn(work);
            while !working.is_finished() {
                self.idle_period();
            }
            working.join()
        });
        done.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }

    /// Runs the program from a contour on.
    fn run_from_contour(&mut self, number: u32) {
        self.run_job(args::Run { start_line: None, contour: Some(number), ..self.args.clone() });
    }

    /// Runs the program from a line on.
    fn run_from_line(&mut self, line: u32) {
        let lines = lock_model(&self.router.model).facts.program.lines();
        if line == 0 || line as usize > lines {
            return self.reject_text(&format!("the program has no line {line}: it has {lines} lines"));
        }
        self.run_job(args::Run { start_line: Some(line), contour: None, ..self.args.clone() });
    }

    /// Runs the program from the current position; `args` has where it begins.
    fn run_job(&mut self, args: args::Run) {
        if lock_model(&self.router.model).stage == ScreenStage::Job {
            return;
        }
        if let Some(why) = self.cannot_begin() {
            return self.reject_text(why);
        }
        if let Err(refusal) = self.homing.check(&self.machine) {
            return self.reject(refusal);
        }
        let name = self.program.name().to_owned();
        if args.is_piece(&name) && args.start_point().is_some() {
            return self.refuse_start(begins_inside_piece());
        }
        let machine = self.machine.clone().standing_at(&self.machine.position_counts(self.card.status()));
        let program = match self.open_checked_program(&machine) {
            Ok(program) => program,
            Err(why) => return self.show_refusal(&why),
        };
        if let Err(refusal) = program.require_contour(&machine, args.contour) {
            return self.show_refusal(&refusal.to_string());
        }
        let Some(commands) = self.router.begin_job(self.start) else { return self.add_message("held before it began") };
        let begins_inside = args.start_line.is_some() || args.contour.is_some();
        if begins_inside {
            preview_thread::hide_path(&self.router.model);
        }
        if let Err(fault) = self.card.begin_path(PathStart::at(RecordIndex::new(0))) {
            self.router.end_job();
            return self.emit(EventKind::Alarm(CardError::from(fault)));
        }
        let mut result = JobResult::default();
        let waits_at_end = self.pieces_behind == 0;
        let at_screen = TuiOptions { commands, observer: self.observer.clone(), waits_at_end, result: &mut result };
        let machine_and_card = self.machine_and_card.clone();
        let job = JobSpec::of(&args, &machine, self.script_of_job(), program, &machine_and_card);
        let done = self.begin_journal(&job).and_then(|journal| job.run(self.card, journal, Some(at_screen)));
        if waits_at_end {
            self.router.end_job();
        } else {
            self.router.end_piece();
        }
        self.exit.ran = true;
        self.record_ended_pieces();
        match done {
            Ok(code) => {
                self.apply_result(code, result);
                self.show_consumables();
            }
            Err(failure) => {
                let why = failure.to_string();
                (self.exit.code, self.exit.report) = (2, None);
                lock_model(&self.router.model).end(why.lines().next().unwrap_or_default());
                match failure {
                    CommandFailure::Input(refusal) if args.is_piece(&name) => self.refuse_start(refusal),
                    _ => self.show_refusal(&why),
                }
            }
        }
        // The session reported the same alarm already.
        self.alarm = self.card.status().alarm;
        if begins_inside {
            self.check_again();
        }
    }

    /// Script of a job besides the keys: skipped contours, optional stop, and the script of the command line.
    fn script_of_job(&self) -> Vec<ScriptInstruction> {
        let contours = lock_model(&self.router.model).contours.clone();
        // These words always parse.
        job_script::at_screen(contours.skipped(), self.optional_stop, &self.script).unwrap_or_default()
    }

    /// Takes over the results of a job that ended with this exit code.
    fn apply_result(&mut self, code: u8, result: JobResult) {
        if let Some((parameters, tools)) = result.tables {
            self.mdi_context.set_tables(parameters, tools);
            self.table_keeper.mark_written(self.mdi_context.modal_snapshot());
            self.show_tables();
        }
        (self.exit.code, self.exit.report) = (code, Some(result.text));
        self.has_completed = code == 0;
        // A resumed job brings its own setting.
        self.optional_stop = lock_model(&self.router.model).optional_stop;
        self.show_end(&result.short);
    }

    /// Resumes an interrupted job at its breakpoint.
    fn resume(&mut self, resumed: ResumingJob<'m, A>) -> Result<(), CommandFailure> {
        let mut result = JobResult::default();
        // What is resumed waits for its own confirmation.
        let Some(commands) = self.router.begin_job(NOT_CANCELLABLE) else { return Ok(()) };
        let observer = self.observer.clone();
        let at_screen = TuiOptions { commands, observer, waits_at_end: true, result: &mut result };
        let (commands, model) = (&self.commands, &self.router.model);
        let mut ask = |summary: &ResumeSummary<'_, A>| {
            let prepared = summary.prepared;
            let outputs = (0..).zip(prepared.expected_outputs()).map(|(channel, &value)| (channel, value));
            lock_model(model).program_outputs = outputs.collect();
            lock_model(model).history_before = Some((prepared.oldest(), prepared.history_mm()));
            Ok(resumed.is_confirmed || ask(model, commands, "resume the job?", summary.lines()))
        };
        let done = (resumed.resume)(&mut *self.card, at_screen, &mut ask);
        self.router.end_job();
        let code = done?;
        self.exit.ran = true;
        self.apply_result(code, result);
        self.alarm = self.card.status().alarm;
        Ok(())
    }

    /// Creates the journal of a job while control periods continue: the disk may take longer than the card's watchdog.
    fn begin_journal(
        &mut self,
        job: &JobSpec<'_>,
    ) -> Result<(Option<JournaledJob>, Option<ProgramStream>), CommandFailure> {
        let status = *self.card.status();
        self.while_idle(move || job.keep(&status))
    }

    /// Opens the program and checks it while control periods continue.
    fn open_checked_program(&mut self, machine: &MachineConfig) -> Result<Program, String> {
        let (program, setup) = (&self.program, self.mdi_context.setup_of_program(machine));
        let (program, model) = (Arc::clone(program), Arc::clone(&self.router.model));
        self.while_idle(move || {
            let program = program.reopened(setup).map_err(|refusal| refusal.to_string())?;
            program.check_silently(machine)?;
            preview_thread::update_facts::<A>(&model, machine, &program);
            Ok(program)
        })
    }
}

/// Asks the operator. Returns whether he confirms; quitting is a no.
fn ask(model: &Mutex<ScreenModel>, commands: &Receiver<UiCommand>, title: &str, lines: Vec<String>) -> bool {
    lock_model(model).ask(Some(Question { title: title.into(), lines }));
    let is_agreed = loop {
        match commands.recv() {
            Ok(UiCommand::Answer(is_agreed)) => break is_agreed,
            Ok(UiCommand::Quit) | Err(_) => break false,
            Ok(_) => {}
        }
    };
    lock_model(model).ask(None);
    is_agreed
}
