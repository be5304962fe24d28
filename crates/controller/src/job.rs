//! A job: reading, decoding, planning, the motion path and the report, each in a thread of its own, with bounded queues between them.
//!
//! ```text
//! reading ─ buffers ─> decoding ─ batches of steps ─> planning ─ ring, items ─> motion path ─ stream ─> reporting
//! ```
//!
//! Invariant: the threads end before [`run`] returns, whatever ended the job; the motion path is the caller's own thread.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::thread;

use retrace_core::Record;
use retrace_core::ring::{Cell, Ring};
use retrace_core::size::ring_cells;
use retrace_gcode::{ActiveCodes, CanonStep};
use retrace_link::{CardStatus, MotionCard, Outputs};
use retrace_motion::Planner;

use crate::canon_executor::CanonExecutor;
use crate::command_queue::CommandSources;
use crate::decoding::{self, BatchChannel};
use crate::limit_check::LimitCheck;
use crate::machine::MachineConfig;
use crate::manual::jog_planner::{self, Identify};
use crate::motion_sink::MotionSink;
use crate::overrides::overrides;
use crate::place_index::JournalConfig;
use crate::plan_item::PlanSummary;
use crate::plan_writer::PlanWriter;
use crate::planning;
use crate::real_time;
use crate::record_streamer::RecordStreamer;
use crate::resume::{ResumeError, ResumePlan, ResumePoint};
use crate::run_stats::RunStats;
use crate::session::{Outcome, RunMode, Session};
use crate::telemetry::{self, Observer};
use crate::tool_length;

/// A program as a source of canonical functions.
pub trait BlockDecoder {
    /// Decodes the next block and puts its steps behind those in `steps`.
    fn next_block(&mut self, steps: &mut Vec<CanonStep>) -> DecodedBlock;

    /// The modal state behind the last block, where the source has one.
    fn active(&self) -> Option<ActiveCodes> {
        None
    }

    /// What is to be set when nobody wants the program any more, so that a source that waits for bytes stops waiting.
    fn cancel_token(&self) -> Option<Arc<AtomicBool>> {
        None
    }

    /// What tells which program would be read now, if it were read again: asked before a paused one goes on (DNC-6), in a thread of its
    /// own. Where it cannot be read a second time there is nothing to tell.
    fn identity(&self) -> Option<Identify> {
        None
    }
}

/// What became of a block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DecodedBlock {
    /// Decoded; more may follow.
    Block,
    /// The program is at its end.
    End,
    /// The block has errors: rendered, with place, source line and remedy.
    Refused(String),
}

/// Items that may wait between the threads.
const ITEMS: usize = 1024;

/// With so many findings a program is not looked at any further.
const MAX_FINDINGS: usize = 100;

/// What is left of a job.
#[derive(Debug)]
pub struct JobEnd<C> {
    /// How it ended.
    pub outcome: Outcome,
    /// Where the time went.
    pub tally: RunStats,
    /// What the program came to, where it came to its end.
    pub summary: Option<PlanSummary>,
    /// The card, at rest.
    pub card: C,
}

/// Where in the program a job begins.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum JobStart {
    /// At its first block.
    #[default]
    First,
    /// At this line, with the state that the blocks before it leave.
    Line(u32),
    /// Where it was left.
    At(Box<ResumePoint>),
}

/// How a job is run: from where, by whom, in what manner, and who keeps an index of it.
#[derive(Debug)]
pub struct JobOptions {
    /// Where it begins.
    pub begin: JobStart,
    /// Who operates the machine.
    pub operators: CommandSources,
    /// Time and company.
    pub manner: RunMode,
    /// The index.
    pub keeping: JournalConfig,
}

/// What keeps a job from being begun. Nothing has moved then.
#[derive(Clone, Debug, PartialEq)]
pub enum JobStartError {
    /// The machine's numbers do not go together; how.
    Machine(String),
    /// The place where it was left is not found in the program; why.
    Unfound(ResumeError),
}

impl fmt::Display for JobStartError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Machine(why) => f.write_str(why),
            Self::Unfound(why) => why.fmt(f),
        }
    }
}

/// Runs a program on a card that stands where the machine says. One that is taken up where it was left goes on if the card's counts are those
/// of that place, and is stopped at once otherwise.
///
/// # Errors
/// What keeps the job from being begun; nothing has moved then.
pub fn run<const A: usize, C: MotionCard<A>>(
    machine: &MachineConfig,
    program: impl BlockDecoder + Send,
    conduct: JobOptions,
    card: C,
    observer: &mut dyn Observer<A>,
) -> Result<JobEnd<C>, JobStartError> {
    resume(machine, program, conduct, card, observer, ResumePlan::matches_card)
}

/// The same; where the job is taken up where it was left, `agree` is asked before anything moves, and the job is stopped at once where it
/// says no. Where the card's counts are others than those of the place, the axes then go there in the order of DNC-6. The machine stood at `machine.stands_at_mm` where the job began, not where it is left.
///
/// # Errors
/// As [`run`].
pub fn resume<const A: usize, C: MotionCard<A>>(
    machine: &MachineConfig,
    mut program: impl BlockDecoder + Send,
    conduct: JobOptions,
    card: C,
    observer: &mut dyn Observer<A>,
    agree: impl FnOnce(&ResumePlan<A>) -> bool,
) -> Result<JobEnd<C>, JobStartError> {
    let JobOptions { begin, operators, manner, keeping } = conduct;
    let (keep, look_ahead) = (machine.history_records, machine.look_ahead_records);
    let cells = ring_cells(keep, look_ahead).ok_or_else(|| unfit("the history is larger than any ring"))?;
    let cells: Box<[Cell<Record<A>>]> = (0..cells).map(|_| Cell::default()).collect();
    let origin = JobOrigin::of(machine, &begin, card.status());
    let mut ring = Ring::new(cells, keep, look_ahead, origin.place).map_err(|e| unfit(format!("no ring: {e:?}")))?;
    let (producer, consumer) = ring.split();
    let begins = origin.place.wrapping_add(jog_planner::BEYOND);
    let mut by_hand = jog_planner::ring(machine, begins).map_err(|e| unfit(format!("no ring: {e:?}")))?;
    let mail = jog_planner::JogStatus::default();
    let (hand, requests) = jog_planner::hand(by_hand.split(), &mail);
    let mut identify = program.identity().unwrap_or_else(|| Box::new(|| 0));
    let program_is = identify();
    let (sender, receiver) = mpsc::sync_channel(ITEMS);
    let planner = Planner::new(machine.limits(), machine.start_mm()).map_err(|e| unfit(e.to_string()))?;
    let cancel = AtomicBool::new(false);
    let (mut asking, mut heeding) = overrides(look_ahead);
    let mut feeder =
        PlanWriter::new(planner.with_blending(machine.blending), producer, sender, origin.outputs, &cancel)
            .noting(keeping.index, &origin.counts)
            .inhibiting(machine.inhibited_channels())
            .within(machine);
    let (line, resumption) = match begin {
        JobStart::First => (None, None),
        JobStart::Line(line) => (Some(line), None),
        JobStart::At(at) => (None, Some(at)),
    };
    let (mut rests, mut lengths, mut begun_at) = (Vec::new(), Vec::new(), origin.counts);
    if let Some(at) = &resumption {
        at.could_be(look_ahead).map_err(JobStartError::Unfound)?;
        (asking, heeding) = (asking.again(&at.overrides, at.start.reached), heeding.again(&at.overrides));
        feeder = feeder.held_against(&at.marks);
        rests.clone_from(&at.rests);
        lengths.clone_from(&at.lengths);
        if let Some(tool) = machine.tool_axis().and_then(|tool| begun_at.get_mut(tool)) {
            *tool += lengths.iter().map(|change| change.pulses).sum::<i64>();
        }
    }
    let (length_entry, length_offers) = tool_length::entry();
    let feeder = feeder.heeding(heeding).taking_lengths(length_offers, &lengths);
    let supply =
        RecordStreamer::new(consumer, receiver, origin.place, origin.outputs, origin.executed).durable(keeping.durable);
    let (teller, hearing) = telemetry::telemetry_channel(manner.wall_time, machine.period_s());
    let (belt, batch) = BatchChannel::new();
    let given_up = program.cancel_token();
    thread::scope(|scope| {
        let belt = &belt;
        let decoder = named(scope, ("decoding", manner.real_time), move || decoding::decode(&mut program, belt));
        let planner = named(scope, ("planning", manner.real_time), move || {
            planning::plan(machine, belt, batch, (line, rests), feeder)
        });
        let reporter = named(scope, ("reporting", manner.real_time), move || hearing.report(observer));
        let moves = named(scope, ("manual moves", manner.real_time), move || requests.serve(machine, identify));
        let hand = hand.waking(moves.thread().clone());
        let interest = CancelOnDrop { cancel: &cancel, given_up };
        let session = Session::new(card, machine, supply, operators, manner, teller).asking(asking);
        let session = session.by_hand(hand, program_is).entering_lengths(length_entry);
        let is_real_time = manner.real_time && real_time::enter().is_ok();
        let ended = match resumption {
            None => Ok(session.run()),
            Some(at) => session.resume(&at, begun_at, agree).map_err(JobStartError::Unfound),
        };
        if is_real_time {
            // It was permitted, so this is.
            let _ = real_time::leave();
        }
        drop(interest);
        joined(decoder);
        let summary = joined(planner);
        joined(reporter);
        joined(moves);
        let (outcome, tally, card) = ended?;
        Ok(JobEnd { outcome, tally, summary, card })
    })
}

fn unfit(why: impl Into<String>) -> JobStartError {
    JobStartError::Machine(why.into())
}

/// Begins a thread with a name, as [`thread::Scope::spawn`] does without one.
fn named<'scope, T: Send + 'scope>(
    scope: &'scope thread::Scope<'scope, '_>,
    (name, is_real_time): (&str, bool),
    work: impl FnOnce() -> T + Send + 'scope,
) -> thread::ScopedJoinHandle<'scope, T> {
    let work = move || {
        // It may have been begun by a thread that is scheduled in real time.
        if is_real_time {
            let _ = real_time::leave();
        }
        work()
    };
    let begun = thread::Builder::new().name(name.into()).spawn_scoped(scope, work);
    begun.unwrap_or_else(|error| panic!("the system has no thread left: {error}"))
}

/// A panic over there is a defect, never an input; it is passed on.
fn joined<T>(thread: thread::ScopedJoinHandle<'_, T>) -> T {
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

/// Where a job's ring begins: at its own beginning, wherever it is taken up.
struct JobOrigin<const A: usize> {
    place: u32,
    counts: [i64; A],
    outputs: Outputs,
    /// Number of the last instruction that was executed before.
    executed: u32,
}

impl<const A: usize> JobOrigin<A> {
    fn of(machine: &MachineConfig, begin: &JobStart, status: &CardStatus<A>) -> Self {
        let JobStart::At(at) = begin else {
            let CardStatus { place, counts, outputs, executed, .. } = *status;
            return Self { place: place.record, counts, outputs, executed };
        };
        let mut counts = [0; A];
        for ((slot, axis), mm) in counts.iter_mut().zip(&machine.axes).zip(&machine.stands_at_mm) {
            *slot = (mm * axis.pulses_per_mm).round() as i64;
        }
        Self { place: at.origin, counts, outputs: at.outputs, executed: at.executed }
    }
}

/// The motion path's interest in what is planned; it ends with the session, however that ends.
struct CancelOnDrop<'c> {
    cancel: &'c AtomicBool,
    given_up: Option<Arc<AtomicBool>>,
}

impl Drop for CancelOnDrop<'_> {
    fn drop(&mut self) {
        self.cancel.store(true, Ordering::Relaxed);
        if let Some(given_up) = &self.given_up {
            given_up.store(true, Ordering::Relaxed);
        }
    }
}

/// What a scan found: an error, which cannot be run, or a warning.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckFinding {
    /// Program line.
    pub line: u32,
    /// The word that it is about, where there is one: its letter.
    pub word: Option<char>,
    /// Number in `docs/errors.md`.
    pub number: &'static str,
    /// What is wrong.
    pub what: String,
    /// What to do.
    pub remedy: String,
}

impl CheckFinding {
    /// Does it keep the program from being run? Otherwise it is a warning.
    #[must_use]
    pub fn is_error(&self) -> bool {
        self.number.starts_with('E')
    }
}

/// Goes through a whole program without moving anything: how many blocks it has, what of them cannot be run, and what the moves
/// came to.
///
/// The decoder's own errors are its own to tell; the scan goes on behind them.
pub fn scan<'m, const A: usize>(
    machine: &'m MachineConfig,
    program: &mut impl BlockDecoder,
) -> (u64, Vec<CheckFinding>, LimitCheck<'m, A>) {
    let mut sink = LimitCheck::new(machine);
    let (blocks, mut findings) = feed_all(machine, program, &mut sink);
    findings.extend(sink.beyond.iter().map(crate::limit_check::LimitFinding::finding));
    findings.extend(sink.warnings());
    findings.sort_by_key(|f| f.line);
    (blocks, findings, sink)
}

/// Gives all moves and switching of a program to `sink`: how many blocks it has, and what of them cannot be run.
pub fn feed_all<const A: usize>(
    machine: &MachineConfig,
    program: &mut impl BlockDecoder,
    sink: &mut impl MotionSink<A>,
) -> (u64, Vec<CheckFinding>) {
    feed_each(machine, program, sink, |_, _| ())
}

/// The same, with a look at the state behind each step.
pub fn feed_each<const A: usize, S: MotionSink<A>>(
    machine: &MachineConfig,
    program: &mut impl BlockDecoder,
    sink: &mut S,
    mut look: impl FnMut(&CanonExecutor<'_>, &mut S),
) -> (u64, Vec<CheckFinding>) {
    let mut track = CanonExecutor::new(machine);
    let (mut steps, mut findings, mut blocks) = (Vec::new(), Vec::new(), 0);
    loop {
        steps.clear();
        let decoded = program.next_block(&mut steps);
        for step in &steps {
            if let Err(why) = track.run(&step.canon, step.line, sink) {
                findings.push(why.finding(step.line));
            }
            look(&track, sink);
        }
        if decoded == DecodedBlock::End || findings.len() >= MAX_FINDINGS {
            return (blocks, findings);
        }
        blocks += 1;
    }
}
