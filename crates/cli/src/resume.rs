//! `retrace resume`: resumes an interrupted job at its breakpoint (DNC, *Beyond the source*).
//!
//! Invariant: nothing moves and the journal stays unchanged before program, planner, card and counts have been compared
//! with the journal and the operator has confirmed.

use std::cell::Cell;
use std::path::{Path, PathBuf};

use retrace_config::{CutterConfig, MachineConfig, NumberedError};
use retrace_controller::{
    AnyCard, JobStart, MANUAL_PLACE_OFFSET, ResumePlan, ResumePoint, ResumedCutEnd, ScriptInstruction,
    planning_fingerprint,
};
use retrace_core::place::number_is_before;
use retrace_hal_sim::SourceFaults;
use retrace_journal::{
    Durability, FileRole, JobCard, JobEnding, JobFolder, JobHeader, JobLock, JobRecord, JobState, JobStore, ListedJob,
    ProgramSource, ReadFile, ResumeEntry, SpoolProgress, SpoolReplay, Timestamp, WiredCard, axes_to_home,
};
use retrace_link::{Greeting, Outputs, PathStart, channel};

use crate::args::{self, OnOff};
use crate::command_failure::CommandFailure;
use crate::greeted_card::GreetedCard;
use crate::homing_notes::Homing;
use crate::job_runner::{JobRunner, OutputOptions, TuiOptions, prepare_real_time};
use crate::job_script::of_resumed_job;
use crate::journaled_job::{self, JournaledJob};
use crate::linked_card;
use crate::machine_tables::{self, TableFiles};
use crate::operate::{self, ResumingJob};
use crate::probing_card::ProbingCard;
use crate::program::Program;
use crate::program_stream::{ProgramStream, StreamSource};
use crate::resume_from_line::{changed_machine, from_line, reading, run_args};
use crate::resume_summary::{self, ConfirmResume, ResumeSummary};
use crate::sim_wiring::simulated;
use crate::simulated_work::parsed_work;
use crate::{files, run};

/// Number of marks that are compared with the plan, besides all marks beyond the breakpoint.
const MAX_COMPARED_MARKS: u64 = 1 << 16;

/// Runs the command. Returns its exit code.
///
/// # Errors
/// Whatever prevents the job from being resumed.
pub fn run(args: &args::Resume) -> Result<u8, CommandFailure> {
    let by_card = Cell::new(false);
    match attempt(args, ResumeBreakpoint::OfCard, &by_card) {
        // The card was moved since, so that its place is not on the path of the job: use the journal's counts.
        Err(CommandFailure::Input(refusal)) if by_card.get() && matches!(refusal.number, "E2214" | "E2216") => {
            attempt(args, ResumeBreakpoint::OfJournal, &by_card)
        }
        done => done,
    }
}

/// Source of the breakpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ResumeBreakpoint {
    /// The place that the card reports, if it can be a place of the job.
    OfCard,
    /// The last place in the journal: up to one second of motion before the machine stopped, which could no longer be
    /// stored.
    OfJournal,
}

/// Resumes the job at a breakpoint; sets `by_card` where the place is the card's.
fn attempt(args: &args::Resume, breakpoint: ResumeBreakpoint, by_card: &Cell<bool>) -> Result<u8, CommandFailure> {
    by_card.set(false);
    if args.machine.is_some() {
        let what = "--machine: a job resumes with the machine file that it started with, which is in its journal";
        return Err(NumberedError::new("E2142", what, "omit --machine").into());
    }
    if args.operation.tui {
        operate::needs_terminal()?;
    }
    let jobs = JobStore::open_or_default(args.jobs.path())?;
    let folder = match &args.job {
        Some(id) => jobs.find(id)?,
        None => newest(&jobs)?,
    };
    let held = folder.lock()?;
    let record = folder.read()?;
    if let Some(line) = args.from_line {
        drop(held);
        return from_line(args, &record, line);
    }
    if record.end.as_ref().is_some_and(|end| end.outcome == JobEnding::Completed) {
        let what = format!("job {} is completed", folder.id());
        return Err(NumberedError::new("E2209", what, "`retrace run` runs the program again").into());
    }
    let machine = machine(&record.job)?;
    let axes = machine.axes.len();
    let taking = ResumeStep { args, breakpoint, by_card, jobs, folder, held, record, machine };
    match axes {
        0..=4 => taking.resume_on::<4>(),
        _ => taking.resume_on::<9>(),
    }
}

fn newest(jobs: &JobStore) -> Result<JobFolder, NumberedError> {
    let of_interest = |job: &ListedJob| job.state.can_resume() || matches!(job.state, JobState::Unusable(_));
    let Some(job) = jobs.list().into_iter().find(of_interest) else {
        let what = format!("no job in {} can be resumed", jobs.folder().display());
        return Err(NumberedError::new("E2209", what, "`retrace jobs` lists what ran; --journal names another folder"));
    };
    match job.state {
        // It may be the one that was meant: an older job is resumed only by its name.
        JobState::Unusable(NumberedError { number, cause: what, remedy }) => {
            let what = format!("job {} is the newest and cannot be resumed: {what}", job.folder.id());
            Err(NumberedError::new(number, what, format!("{remedy}; `retrace resume JOB` resumes an older job")))
        }
        _ => Ok(job.folder),
    }
}

/// Machine of a job, at its position when the job started.
fn machine(job: &JobHeader) -> Result<MachineConfig, NumberedError> {
    let machine = match &job.machine.path {
        None => MachineConfig::built_in()?,
        Some(path) => files::with_materials(MachineConfig::parse(&job.machine.text, path)?, Path::new(path))?,
    };
    let planning = args::Planning::of_job(&job.arguments);
    Ok(planning.apply_to(machine).standing_at(&job.counts))
}

/// Job that is being resumed.
struct ResumeStep<'a> {
    args: &'a args::Resume,
    breakpoint: ResumeBreakpoint,
    by_card: &'a Cell<bool>,
    jobs: JobStore,
    folder: JobFolder,
    held: JobLock,
    record: JobRecord,
    machine: MachineConfig,
}

impl ResumeStep<'_> {
    fn resume_on<const A: usize>(self) -> Result<u8, CommandFailure> {
        let program = self.program()?;
        if !self.args.is_at_screen() {
            program.find_contours(&self.machine);
        }
        if planning_fingerprint(self.machine.plan_mode)? != self.record.job.planner {
            let what = format!(
                "retrace {} plans motion differently from retrace {}, which started the job",
                env!("CARGO_PKG_VERSION"),
                self.record.job.retrace_version
            );
            return Err(
                NumberedError::new("E2211", what, "use that version, or `retrace resume JOB --from-line N`").into()
            );
        }
        let script = files::script(self.args.operation.operator.as_deref())?;
        match self.record.resumed.last().map_or(&self.record.job.card, |last| &last.card) {
            JobCard::Sim => self.on_simulated::<A>(&program, script),
            JobCard::Wired(card) => {
                let card = card.clone();
                self.on_wired::<A>(&program, script, &card)
            }
        }
    }

    /// Program of the job with the files that it was read with, which must be unchanged.
    fn program(&self) -> Result<Program, CommandFailure> {
        let job = &self.record.job;
        let arrives = match (&job.source, &self.args.program) {
            (ProgramSource::File(_), _) => None,
            (ProgramSource::Socket(address), None) => Some(StreamSource::Socket(address.clone())),
            (ProgramSource::StandardInput, None) => Some(StreamSource::StandardInput),
            (ProgramSource::Serial(address), None) => Some(StreamSource::Serial(address.clone())),
            (ProgramSource::Device(path), None) => Some(StreamSource::Device(path.into())),
            (_, Some(named)) => Some(StreamSource::named(named).unwrap_or_else(|| StreamSource::File(named.clone()))),
        };
        let reading = reading(job, self.args.program.as_deref());
        let is_latched =
            |file: &&ReadFile| matches!(file.role, FileRole::Tools | FileRole::Parameters) && job.tables.is_some();
        let is_checked_here = |file: &&ReadFile| !is_latched(file) && file.role != FileRole::Cycles;
        for file in job.files.iter().filter(is_checked_here) {
            let path = if file.role == FileRole::Program { reading.program.clone() } else { PathBuf::from(&file.path) };
            let read = files::hash(&path, file.role.name())?;
            if read != file.hash {
                let what = format!("the {} {} has changed since the job started", file.role.name(), path.display());
                return Err(self.file_changed(what).into());
            }
        }
        let latched = job.tables.as_ref().map(machine_tables::unlatched).transpose()?;
        let program = Program::open_from(&reading, &self.machine, arrives, latched)?;
        self.require_same_files(&program.files_read())?;
        Ok(program)
    }

    /// Refuses cycles that have changed, and subprograms and cycles that were not read when the job started.
    fn require_same_files(&self, read: &[ReadFile]) -> Result<(), NumberedError> {
        let was = &self.record.job.files;
        // The journal of an older version does not name cycles.
        let roles: &[FileRole] = if was.iter().any(|file| file.role == FileRole::Cycles) {
            &[FileRole::Subprogram, FileRole::Cycles]
        } else {
            &[FileRole::Subprogram]
        };
        let same = |a: &ReadFile, b: &ReadFile| (a.role, &a.path) == (b.role, &b.path);
        for file in was.iter().filter(|file| file.role == FileRole::Cycles) {
            let Some(now) = read.iter().find(|now| same(now, file)) else {
                return Err(self.file_changed(format!("the cycle {} no longer exists", file.path)));
            };
            if now.hash != file.hash {
                return Err(match file.path.as_str() {
                    "" => self.file_changed(
                        "the built-in cycles and subprograms of this version of retrace differ from those of the job"
                            .into(),
                    ),
                    path => self.file_changed(format!("the cycle {path} has changed since the job started")),
                });
            }
        }
        let new = read.iter().find(|now| roles.contains(&now.role) && !was.iter().any(|file| same(now, file)));
        new.map_or(Ok(()), |file| {
            let (role, path) = (file.role.name(), &file.path);
            Err(self.file_changed(format!("the {role} {path} would be read now; it was not when the job started")))
        })
    }

    /// Error for a file that has changed.
    fn file_changed(&self, what: String) -> NumberedError {
        let id = self.folder.id();
        let remedy = format!("restore the files, or start at a line with `retrace resume {id} --from-line N`");
        NumberedError::new("E2210", what, remedy)
    }

    /// Stored part of a streamed program, followed by what the sender sends again, if that is needed.
    fn input(&self, program: &Program) -> Result<Option<(ProgramStream, SpoolProgress)>, NumberedError> {
        if program.stream_source().is_none() {
            return Ok(None);
        }
        let mut kept = self.record.spooled;
        // A program that ends before its text is not read to the end of the text.
        kept.ended |= program.reaches_end(&self.folder.stream(), kept.bytes);
        let named = self.args.program.is_some() || matches!(self.record.job.source, ProgramSource::Socket(_));
        let again = if kept.ended || !named { None } else { program.open_stream()? };
        let (mut input, progress) = SpoolReplay::open(&self.folder.stream(), kept, again)?;
        input.compare().map_err(|error| {
            let what = error.to_string();
            let what = what.strip_prefix("E2208: ").unwrap_or(&what).to_owned();
            NumberedError::new("E2208", what, "send the same program again from its beginning")
        })?;
        Ok(Some((Box::new(input.limited_to(self.machine.stream_quota_bytes)), progress)))
    }

    fn on_simulated<const A: usize>(
        self,
        program: &Program,
        script: Vec<ScriptInstruction>,
    ) -> Result<u8, CommandFailure> {
        if self.args.card.as_ref().is_some_and(|card| card != "sim") {
            return Err(other_card("the job ran on the simulated card, which is in this process").into());
        }
        let outputs = outputs(self.record.at.as_ref().map_or(&self.record.job.outputs, |at| &at.outputs));
        let wall_time = self.args.operation.realtime || self.args.is_at_screen();
        let work = parsed_work(self.args.work.work.as_deref(), &self.machine)?;
        let mut card =
            simulated::<A>(&self.machine, (&SourceFaults::default(), work), run::clock(&self.machine, wall_time))?
                .with_position(counts(&self.record.last_position.counts), &outputs);
        let card = &mut AnyCard::new(&mut card);
        let start = self.record.last_position.start;
        self.run_job(program, script, (card, Homing::simulated()), start, JobCard::Sim, wall_time)
    }

    fn on_wired<const A: usize>(
        self,
        program: &Program,
        script: Vec<ScriptInstruction>,
        was: &WiredCard,
    ) -> Result<u8, CommandFailure> {
        let address = self.args.card.clone().unwrap_or_else(|| was.address.clone());
        let mut card = linked_card::find::<A>(&address)?;
        card.wait_at_rest(linked_card::nonce()).map_err(|fault| linked_card::card_error(&address, &fault))?;
        let Some(greeting) = card.greeting().copied() else { return Ok(3) };
        linked_card::check_fit(&address, &greeting.identity, &self.machine)?;
        let start = self.start_place(&address, &greeting, was)?;
        let stands = PathStart {
            place: greeting.place,
            rests: false,
            reached: greeting.reached,
            executed: greeting.executed,
            keeps_state: true,
        };
        let settings = self.machine.card_settings(stands);
        let status = linked_card::read_status(&mut card, &address, settings)?;
        let named = journaled_job::linked_card(&address, &greeting.identity);
        if !self.args.is_at_screen() {
            prepare_real_time();
        }
        let card = ProbingCard::new(card, settings, &self.machine);
        let mut card = GreetedCard::new(card, status, greeting.identity.boot);
        let homing = Homing::of(&address, &greeting.identity).at_screen();
        let code = self.run_job(program, script, (&mut AnyCard::new(&mut card), homing), start, named, true)?;
        card.close();
        Ok(code)
    }

    /// Place at which the path is resumed on a card with this greeting.
    fn start_place<const A: usize>(
        &self,
        address: &str,
        greeting: &Greeting<A>,
        was: &WiredCard,
    ) -> Result<PathStart, NumberedError> {
        let (is, stood) = (&greeting.identity, &self.record.last_position);
        if is.serial != was.serial {
            let what = format!("{address}: serial number {}; the job's card has {}", is.serial, was.serial);
            return Err(other_card(&what));
        }
        if is.boot != was.boot {
            self.require_known_position(address, greeting)?;
            return Ok(stood.start);
        }
        if self.args.assume_position {
            Homing::of(address, is).check(&self.machine)?;
            return Ok(stood.start);
        }
        let result = PathStart {
            place: greeting.place,
            rests: false,
            reached: greeting.reached,
            executed: greeting.executed,
            keeps_state: true,
        };
        let is_behind =
            result.reached.is_before(stood.start.reached) || number_is_before(result.executed, stood.start.executed);
        let is_off_path = result.place.record.since(self.record.job.origin) >= MANUAL_PLACE_OFFSET;
        let was_stopped = self.record.end.as_ref().is_some_and(|end| end.outcome == JobEnding::Stopped);
        // The card's place is on another path, or does not matter: use the journal's place, where the card came to
        // rest.
        if is_behind || is_off_path || was_stopped || self.breakpoint == ResumeBreakpoint::OfJournal {
            return Ok(stood.start);
        }
        self.by_card.set(true);
        Ok(result)
    }

    /// The card was restarted: its counts are the machine position only where every axis was homed since, or the
    /// operator confirms it.
    fn require_known_position<const A: usize>(
        &self,
        address: &str,
        greeting: &Greeting<A>,
    ) -> Result<(), NumberedError> {
        let homing = Homing::of(address, &greeting.identity);
        let id = self.folder.id();
        let refuse = |what: String, remedy: String| Err(NumberedError::new("E2213", what, remedy));
        if let Err(unhomed) = homing.check(&self.machine) {
            if self.args.assume_position {
                return Err(unhomed);
            }
            let what = format!("{address}: the card was restarted, and {}", unhomed.cause);
            let remedy = format!(
                "{}, then `retrace resume {id}`; the axes return to the breakpoint automatically",
                unhomed.remedy
            );
            return refuse(what, remedy);
        }
        let homed = axes_to_home(&self.machine);
        let is_homed = self.machine.axes.iter().all(|axis| homed.contains(&axis.name));
        let stands = resume_summary::position(&self.machine, &greeting.counts);
        if is_homed || self.args.assume_position || resume_summary::position_is_confirmed(&stands) {
            return Ok(());
        }
        refuse(
            format!(
                "{address}: the card was restarted and reports the position {stands}, which no home switch confirms"
            ),
            format!("check that position, then confirm it with `retrace resume {id} --assume-position`"),
        )
    }

    /// Point of resumption from the journal.
    fn resume_point(&self, start: PathStart) -> Result<ResumePoint, NumberedError> {
        let job = &self.record.job;
        // The journal stores the place once a second: later marks come again with the plan, and are too far ahead to
        // wait for.
        let is_old = start == self.record.last_position.start;
        let farthest = start.reached + self.machine.look_ahead_records;
        let mut marks = Vec::new();
        let every = self.record.marks / MAX_COMPARED_MARKS + 1;
        for (number, mark) in (0_u64..).zip(self.record.marks()?) {
            let mark = mark?;
            if is_old && farthest.is_before(mark.place) {
                break;
            }
            if number.is_multiple_of(every) || start.place.record.is_before(mark.place) {
                marks.push(mark);
            }
        }
        let overrides = self.record.overrides().iter().map(|of| (of.place, of.planned)).collect();
        let outputs = outputs(&job.outputs);
        let rests = self.record.rests().to_vec();
        let lengths = self.record.lengths().to_vec();
        let (answers, tap) = (self.record.answers().to_vec(), self.record.tap());
        let tap_on_card = self.record.tap_on_card().map(retrace_core::RecordIndex::new);
        let cut_ends = self.cut_ends();
        let (origin, executed) = (job.origin, job.executed);
        let began_within = journaled_job::start_point(&job.arguments);
        let cut = self.record.cut_ranges().clone();
        // a card that is still there executes the instruction itself
        let begun_start = self.record.begun_start().filter(|_| !self.by_card.get());
        Ok(ResumePoint {
            start,
            origin,
            began_within,
            executed,
            outputs,
            overrides,
            marks,
            rests,
            lengths,
            answers,
            tap,
            tap_on_card,
            cut_ends,
            cut,
            begun_start,
        })
    }

    /// Where each cutter has certainly cut to, if it was cutting.
    fn cut_ends(&self) -> Vec<ResumedCutEnd> {
        let interrupted = self.record.interrupted_cut();
        let cutters = self.machine.cutters.iter().filter(|cutter| cutter.kind.cuts_at_rest());
        let end = |cutter: &CutterConfig| {
            let channel = cutter.fire;
            let cut = interrupted.filter(|cut| cut.channel == channel);
            let (is_interruption, is_exact) = (cut.is_some(), cut.is_some_and(|cut| cut.is_exact));
            let place = self.record.certain_cut_end(channel)?;
            let latest = cut.map_or(place.record, |cut| cut.latest);
            Some(ResumedCutEnd { channel, place, latest, is_interruption, is_exact })
        };
        cutters.filter_map(end).collect()
    }

    /// Locates the breakpoint, asks for confirmation, and runs the job.
    fn run_job<const A: usize>(
        self,
        program: &Program,
        script: Vec<ScriptInstruction>,
        (card, homing): (&mut AnyCard<'_, A>, Homing),
        start: PathStart,
        named: JobCard,
        wall_time: bool,
    ) -> Result<u8, CommandFailure> {
        let resumption = self.resume_point(start)?;
        let (input, progress) = self.input(program)?.unzip();
        let kept_text = self.folder.stream();
        let Self { args, by_card, jobs, folder, held, record, machine, .. } = self;
        let is_cards_place = by_card.get();
        let is_older_place = !is_cards_place && named != JobCard::Sim && record.end.is_none();
        let care = if named == JobCard::Sim { Durability::Written } else { Durability::Synced };
        let disagree = ResumeMismatch { id: folder.id().to_owned(), machine: &machine };
        let kept = JournaledJob::awaiting_resume(jobs, folder, held, care, &record);
        let manners = OutputOptions {
            json: args.format.json,
            records: args.operation.records.as_deref(),
            script: of_resumed_job(&script, &record, !resumption.cut_ends.is_empty())?,
            operator: args.operation.operator.is_some(),
            wall_time,
            optional_stop: args.operation.optional_stop.map(OnOff::is_on).or(record.optional_stop),
            real_time: !matches!(named, JobCard::Sim),
            tables: TableFiles::of_job(&record.job.arguments),
        };
        let (of_job, of_job_entry, on, card_named) = (&record, &record.job, &machine, named.clone());
        let resume =
            move |card: &mut AnyCard<'_, A>, at_screen: Option<TuiOptions<'_>>, ask: &mut ConfirmResume<'_, A>| {
                let agree = |prepared: &ResumePlan<A>, kept: Option<&mut JournaledJob>| -> Result<(), CommandFailure> {
                    // The machine moves, or the card's place is not on this path.
                    if !prepared.card().at_rest || (is_cards_place && !prepared.matches_card()) {
                        return Err(disagree.refusal(prepared).into());
                    }
                    let taken = ResumeSummary {
                        program,
                        record: of_job,
                        machine: on,
                        spool: &kept_text,
                        prepared,
                        differences: table_differences(program, of_job_entry),
                        machine_changes: changed_machine(of_job_entry),
                        approach: prepared.return_path(on)?,
                        is_older_place: is_older_place && prepared.tap().is_none(),
                    };
                    if !ask(&taken)? {
                        return Err(
                            NumberedError::new("E2215", "not confirmed; nothing has moved", "--yes confirms").into()
                        );
                    }
                    let resumed = resume_entry(prepared, card_named, on);
                    kept.map_or(Ok(()), |kept| kept.resume_journal(of_job, resumed, progress))?;
                    Ok(())
                };
                let begin = JobStart::At(Box::new(resumption));
                let machining = JobRunner {
                    options: manners,
                    machine: on,
                    program,
                    input,
                    start: begin,
                    journal: Some(kept),
                    at_screen,
                };
                machining.run(card, Box::new(agree))
            };
        if args.is_at_screen() {
            let resume = ResumingJob {
                origin: record.job.origin,
                is_confirmed: args.yes,
                resume: Box::new(|card, at_screen, ask| resume(card, Some(at_screen), ask)),
            };
            let (run, at) = (run_args(args, &record.job), (record.job.machine.text.clone(), named));
            operate::operate(&run, &machine, program.clone(), (script, at), card, &homing, Some(resume))
        } else {
            resume(card, None, &mut |taken| {
                taken.show(args.format.json);
                Ok(args.yes || resume_summary::confirm_at_terminal()?)
            })
        }
    }
}

/// Reports that the counts do not match.
struct ResumeMismatch<'a> {
    id: String,
    machine: &'a MachineConfig,
}

impl ResumeMismatch<'_> {
    fn refusal<const A: usize>(&self, prepared: &ResumePlan<A>) -> NumberedError {
        let axes = self.machine.axes.len().min(A);
        let (card, place) = (prepared.card().counts, prepared.counts());
        let (card, place) = (&card[..axes], &place[..axes]);
        let what = format!(
            "the card's counts are {card:?}, those of the breakpoint {place:?}: the machine is moving or was moved"
        );
        let remedy =
            format!("wait until the machine is at rest, then `retrace resume {}`; home it first if in doubt", self.id);
        NumberedError::new("E2214", what, remedy)
    }
}

/// Differences between the job's tables and their files, one per line. A file that cannot be read any more is a
/// difference, too.
fn table_differences(program: &Program, job: &JobHeader) -> Vec<String> {
    if job.tables.is_none() {
        return Vec::new();
    }
    match TableFiles::of_job(&job.arguments).read() {
        Ok(now) => machine_tables::differences(&program.setup().start_tables(), &now),
        Err(refusal) => vec![refusal.cause],
    }
}

fn resume_entry<const A: usize>(prepared: &ResumePlan<A>, card: JobCard, machine: &MachineConfig) -> ResumeEntry {
    let PathStart { place, reached, executed, .. } = *prepared.start();
    let counts = prepared.counts()[..machine.axes.len().min(A)].to_vec();
    ResumeEntry {
        when: Timestamp::now(),
        retrace: env!("CARGO_PKG_VERSION").into(),
        card,
        place,
        reached,
        executed,
        counts,
    }
}

fn other_card(what: &str) -> NumberedError {
    let remedy = "connect the card that the job ran on, or start at a line with `retrace resume JOB --from-line N`";
    NumberedError::new("E2212", what, remedy)
}

fn counts<const A: usize>(of: &[i64]) -> [i64; A] {
    let mut counts = [0; A];
    counts.iter_mut().zip(of).for_each(|(slot, &count)| *slot = count);
    counts
}

fn outputs(written: &[(u8, i32)]) -> Outputs {
    let mut outputs = [0; channel::COUNT];
    for &(number, value) in written {
        if let Some(slot) = outputs.get_mut(usize::from(number)) {
            *slot = value;
        }
    }
    outputs
}
