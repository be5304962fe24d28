//! A job: reading, decoding, planning, the motion path and the report, each in its own thread, with bounded queues
//! between them.
//!
//! ```text
//! reading ─ buffers ─> decoding ─ batches of steps ─> planning ─ ring, items ─> motion path ─ telemetry ─> reporting
//! ```
//!
//! Invariant: the threads end before [`run_job`] returns, whatever ended the job; the motion path is the caller's own
//! thread.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc;
use std::thread;

use retrace_config::MachineConfig;
use retrace_core::RecordIndex;
use retrace_core::ring::Ring;
use retrace_core::ring_storage::unwritten_cells;
use retrace_core::size::ring_cells;
use retrace_journal::JournalConfig;
use retrace_link::{CardStatus, MotionCard, Outputs};
use retrace_motion::Planner;

use crate::batch_channel::{BatchReceiver, BatchSender};
use crate::block_decoder::{BlockDecoder, DecodedBlock};
use crate::canon_executor::CanonExecutor;
use crate::check_finding::{CheckFinding, FindingList};
use crate::command_queue::CommandSources;
use crate::decoding::{self, BlockBatch};
use crate::jog_planner;
use crate::limit_check::LimitCheck;
use crate::motion_sink::MotionSink;
use crate::overrides::override_channel;
use crate::plan_item::PlanSummary;
use crate::plan_writer::PlanWriter;
use crate::planning;
use crate::record_streamer::RecordStreamer;
use crate::resume::{ResumeError, ResumePlan, ResumePoint};
use crate::run_stats::RunStats;
use crate::session::{Outcome, RunMode, Session};
use crate::start_line::StartPoint;
use crate::telemetry::{self, Observer};
use crate::tool_length;

/// Capacity of the item queue between the threads.
const ITEM_QUEUE_CAPACITY: usize = 256;

/// Maximum number of contours that the check before a run lists for the run.
const MAX_RUN_CONTOURS: usize = 10_000;

/// Result of a job.
#[derive(Debug)]
pub struct JobEnd<C> {
    /// How the job ended.
    pub outcome: Outcome,
    /// Time breakdown.
    pub stats: RunStats,
    /// Summary of the plan, where the program came to its end.
    pub summary: Option<PlanSummary>,
    /// The card, at rest.
    pub card: C,
}

/// Place in the program where a job begins.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum JobStart {
    /// The first block.
    #[default]
    First,
    /// This place in the program, with the state that the blocks before it leave.
    Within(StartPoint),
    /// The place where the job was left.
    At(Box<ResumePoint>),
}

/// Options of a job: where it begins, who operates it, timing, and its index.
#[derive(Debug)]
pub struct JobOptions {
    /// Where the job begins.
    pub start: JobStart,
    /// Sources of commands.
    pub commands: CommandSources,
    /// Timing and attendance.
    pub run_mode: RunMode,
    /// The index.
    pub journal: JournalConfig,
}

/// Reason why a job cannot begin. Nothing has moved then.
#[derive(Clone, Debug, PartialEq)]
pub enum JobStartError {
    /// The machine's numbers are inconsistent; the reason.
    Machine(String),
    /// The place where the job was left is not found in the program; the reason.
    Resume(ResumeError),
}

impl fmt::Display for JobStartError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Machine(why) => f.write_str(why),
            Self::Resume(why) => why.fmt(f),
        }
    }
}

impl std::error::Error for JobStartError {}

impl From<ResumeError> for JobStartError {
    fn from(error: ResumeError) -> Self {
        Self::Resume(error)
    }
}

/// Runs a program on a card whose position is that of the machine. A job that is resumed continues if the card's counts
/// are those of its place, and is stopped immediately otherwise.
///
/// # Errors
/// The reason why the job cannot begin; nothing has moved then.
pub fn run_job<const A: usize, C: MotionCard<A>>(
    machine: &MachineConfig,
    program: impl BlockDecoder + Send,
    options: JobOptions,
    card: C,
    observer: &mut dyn Observer<A>,
) -> Result<JobEnd<C>, JobStartError> {
    resume_job(machine, program, options, card, observer, ResumePlan::matches_card)
}

/// Runs a program as [`run_job`] does. Where the job is resumed, `confirm` is called before anything moves, and the job
/// is
/// stopped immediately where it returns false. Where the card's counts differ from those of the place, the axes then
/// move there in the order of DNC-6. `machine.stands_at_mm` is the position where the job began, not where it was left.
///
/// # Errors
/// As [`run_job`].
pub fn resume_job<const A: usize, C: MotionCard<A>>(
    machine: &MachineConfig,
    mut program: impl BlockDecoder + Send,
    options: JobOptions,
    card: C,
    observer: &mut dyn Observer<A>,
    agree: impl FnOnce(&ResumePlan<A>) -> bool,
) -> Result<JobEnd<C>, JobStartError> {
    run_threads(machine, &mut program, options, card, observer, Box::new(agree))
}

/// Runs a program as [`resume_job`] does. It is compiled once for each type of card, and not for each decoder and
/// confirmation.
fn run_threads<const A: usize, C: MotionCard<A>>(
    machine: &MachineConfig,
    program: &mut (dyn BlockDecoder + Send),
    options: JobOptions,
    card: C,
    observer: &mut dyn Observer<A>,
    agree: Box<dyn FnOnce(&ResumePlan<A>) -> bool + '_>,
) -> Result<JobEnd<C>, JobStartError> {
    let JobOptions { start: begin, commands: operators, run_mode, journal: keeping } = options;
    let (keep, look_ahead) = (machine.history_records, machine.look_ahead_records);
    let cells = ring_cells(keep, look_ahead).ok_or_else(|| machine_error("the history is larger than any ring"))?;
    let cells = unwritten_cells::<A>(cells as usize);
    let origin = JobOrigin::new(machine, &begin, card.status());
    let mut ring =
        Ring::new(cells, keep, look_ahead, origin.place).map_err(|e| machine_error(format!("no ring: {e:?}")))?;
    let (producer, consumer) = ring.split();
    let kept_tap = if let JobStart::At(at) = &begin { at.tap_on_card } else { None };
    let begins = kept_tap.unwrap_or(origin.place + jog_planner::MANUAL_PLACE_OFFSET);
    let mut by_hand = jog_planner::ring(machine, begins).map_err(|e| machine_error(format!("no ring: {e:?}")))?;
    let mail = jog_planner::JogStatus::default();
    let (hand, requests) = jog_planner::jog_channel(by_hand.split(), &mail);
    let mut identify = program.identity().unwrap_or_else(|| Box::new(|| 0));
    let program_is = identify();
    let (sender, receiver) = mpsc::sync_channel(ITEM_QUEUE_CAPACITY);
    let planner = Planner::new(machine.limits(), machine.start_mm()).map_err(|e| machine_error(e.to_string()))?;
    let planner = planner.with_blending(machine.blending).with_plan_mode(machine.plan_mode.into());
    let cancel = AtomicBool::new(false);
    let (mut requester, mut heeding) = override_channel(look_ahead);
    let mut feeder = PlanWriter::new(planner, producer, sender, origin.outputs, &cancel)
        .with_index(keeping.index, &origin.counts)
        .with_inhibited(machine.inhibited_channels(), machine.dry_waits)
        .with_wall_time(run_mode.wall_time)
        .with_limits(machine);
    let (within, resumption) = match begin {
        JobStart::First => (None, None),
        JobStart::Within(start) => (Some(start), None),
        JobStart::At(at) => (at.began_within, Some(at)),
    };
    let (mut rests, mut lengths, mut begun_at) = (Vec::new(), Vec::new(), origin.counts);
    let mut answers = Vec::new();
    if let Some(at) = &resumption {
        at.validate(look_ahead)?;
        (requester, heeding) = (requester.resumed(&at.overrides, at.start.reached), heeding.resumed(&at.overrides));
        feeder = feeder.with_expected_marks(&at.marks);
        rests.clone_from(&at.rests);
        lengths.clone_from(&at.lengths);
        answers.clone_from(&at.answers);
        if let Some(tool) = machine.tool_axis().and_then(|tool| begun_at.get_mut(tool)) {
            *tool += lengths.iter().map(|change| change.pulses).sum::<i64>();
        }
    }
    let (length_entry, length_offers) = tool_length::length_channel();
    let (answer_sender, machine_answers) = mpsc::sync_channel(1);
    let (result_sender, results) = mpsc::channel();
    let feeder = feeder.with_overrides(heeding).with_tool_lengths(length_offers, &lengths);
    let feeder = feeder.with_answers(machine_answers, &answers);
    let streamer = RecordStreamer::new(consumer, receiver, origin.place, origin.outputs, origin.executed)
        .with_durable_place(keeping.durable);
    let skipped = Arc::<AtomicU32>::default();
    let within = within.map(|start| (start, Arc::clone(&skipped)));
    let (telemetry, receiver) = telemetry::telemetry_channel(run_mode.wall_time, machine.period_s());
    let (belt, batch) = BlockBatch::channel();
    let given_up = program.cancel_token();
    thread::scope(|scope| {
        let (sender, batches) = (BatchSender::new(&belt), BatchReceiver::new(&belt));
        let decoder =
            spawn_named(scope, ("decoding", run_mode.real_time), move || decoding::decode(program, &sender, &results));
        let planner = spawn_named(scope, ("planning", run_mode.real_time), move || {
            planning::plan(machine, batches, batch, (within, rests), feeder, result_sender)
        });
        let reporter = spawn_named(scope, ("reporting", run_mode.real_time), move || receiver.run(observer));
        let moves = spawn_named(scope, ("manual moves", run_mode.real_time), move || requests.serve(machine, identify));
        let hand = hand.with_thread(moves.thread().clone());
        let interest = CancelOnDrop { cancel: &cancel, source_cancel: given_up };
        let session = Session::new(card, machine, streamer, operators, run_mode, telemetry).with_overrides(requester);
        let session = session.with_manual_moves(hand, program_is).with_length_entry(length_entry);
        let session = session.with_skipped_contours(skipped).with_answers(answer_sender);
        let is_real_time = run_mode.real_time && retrace_real_time::enter().is_ok();
        let ended = match resumption {
            None => Ok(session.run()),
            Some(at) => session.resume(&at, begun_at, agree).map_err(JobStartError::Resume),
        };
        if is_real_time {
            // Entering was permitted, so leaving is.
            let _ = retrace_real_time::leave();
        }
        drop(interest);
        join_thread(decoder);
        let summary = join_thread(planner);
        join_thread(reporter);
        join_thread(moves);
        let (outcome, stats, card) = ended?;
        Ok(JobEnd { outcome, stats, summary, card })
    })
}

fn machine_error(why: impl Into<String>) -> JobStartError {
    JobStartError::Machine(why.into())
}

/// Spawns a thread with a name, as [`thread::Scope::spawn`] does without one.
fn spawn_named<'scope, T: Send + 'scope>(
    scope: &'scope thread::Scope<'scope, '_>,
    (name, is_real_time): (&str, bool),
    work: impl FnOnce() -> T + Send + 'scope,
) -> thread::ScopedJoinHandle<'scope, T> {
    let work = move || {
        // The calling thread may be scheduled in real time.
        if is_real_time {
            let _ = retrace_real_time::leave();
        }
        work()
    };
    let begun = thread::Builder::new().name(name.into()).spawn_scoped(scope, work);
    begun.unwrap_or_else(|error| panic!("the system cannot create another thread: {error}"))
}

/// A panic in the thread is a defect, never an input; it is propagated.
fn join_thread<T>(thread: thread::ScopedJoinHandle<'_, T>) -> T {
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

/// Where a job's ring begins: at the job's own beginning, wherever it is resumed.
struct JobOrigin<const A: usize> {
    place: RecordIndex,
    counts: [i64; A],
    outputs: Outputs,
    /// Number of the last instruction that was executed before.
    executed: u32,
}

impl<const A: usize> JobOrigin<A> {
    fn new(machine: &MachineConfig, begin: &JobStart, status: &CardStatus<A>) -> Self {
        let JobStart::At(at) = begin else {
            let CardStatus { place, counts, outputs, executed, .. } = *status;
            return Self { place: place.record, counts, outputs, executed };
        };
        let mut counts = [0; A];
        for ((slot, axis), mm) in counts.iter_mut().zip(&machine.axes).zip(&machine.stands_at_mm) {
            *slot = axis.pulses_of(*mm);
        }
        Self { place: at.origin, counts, outputs: at.outputs, executed: at.executed }
    }
}

/// Cancels planning and decoding when the session ends, however it ends.
struct CancelOnDrop<'c> {
    cancel: &'c AtomicBool,
    source_cancel: Option<Arc<AtomicBool>>,
}

impl Drop for CancelOnDrop<'_> {
    fn drop(&mut self) {
        self.cancel.store(true, Ordering::Relaxed);
        if let Some(given_up) = &self.source_cancel {
            given_up.store(true, Ordering::Relaxed);
        }
    }
}

/// Checks a whole program without moving anything. Returns the number of blocks, the findings, and the result of the
/// moves.
///
/// The decoder reports its own errors; the check continues behind them.
pub fn check_program<'m, const A: usize>(
    machine: &'m MachineConfig,
    program: &mut impl BlockDecoder,
) -> (u64, Vec<CheckFinding>, LimitCheck<'m, A>) {
    let mut sink = LimitCheck::new(machine).with_contours(MAX_RUN_CONTOURS);
    let (blocks, mut findings) = feed_each(machine, program, &mut sink, |track, program, sink| {
        sink.contours.set_material(track.material());
        sink.contours.locate(|| program.location());
    });
    findings.extend_from_slice(sink.beyond.findings());
    findings.extend(sink.warnings());
    findings.sort_by_key(|f| f.line);
    (blocks, findings, sink)
}

/// Gives all moves and switching of a program to `sink`. Returns the number of blocks and the findings.
pub fn feed_program<const A: usize>(
    machine: &MachineConfig,
    program: &mut impl BlockDecoder,
    sink: &mut impl MotionSink<A>,
) -> (u64, Vec<CheckFinding>) {
    feed_each(machine, program, sink, |_, _, _| ())
}

/// Gives all moves and switching of a program to `sink`, and calls `each` with the state behind each step.
pub(crate) fn feed_each<const A: usize, S: MotionSink<A>, D: BlockDecoder>(
    machine: &MachineConfig,
    program: &mut D,
    sink: &mut S,
    mut look: impl FnMut(&CanonExecutor<'_>, &D, &mut S),
) -> (u64, Vec<CheckFinding>) {
    let mut track = CanonExecutor::new(machine);
    if let Some(codes) = program.active() {
        track = track.with_codes(&codes);
    }
    let (mut steps, mut findings, mut blocks) = (Vec::new(), FindingList::default(), 0);
    loop {
        steps.clear();
        let decoded = program.next_block(&mut steps);
        for step in &steps {
            if let Err(why) = track.execute(&step.canon, step.line, sink) {
                findings.push(why.finding(step.line));
            }
            look(&track, program, sink);
        }
        if decoded == DecodedBlock::End
            && let Err(why) = track.end_thread(sink)
        {
            findings.push(why.finding(steps.last().map_or(0, |step| step.line)));
        }
        if decoded == DecodedBlock::End || findings.is_full() {
            return (blocks, findings.into_findings());
        }
        blocks += 1;
    }
}
