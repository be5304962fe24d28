//! Resuming a job where it was left: the job is planned again from its beginning and replayed to that place without a
//! command to the card.
//!
//! The plan of a job is a function of its program, the machine, the machine's initial position, and the overrides above
//! 100 % with their places. So the whole history is in the ring again, as far as the ring holds it, and the place is
//! identical.
//!
//! Invariant: nothing is sent to the card before the place is found, its marks agree, and the caller has confirmed.

use std::fmt;
use std::thread;
use std::time::Duration;

use retrace_config::{MachineConfig, NumberedError};
use retrace_core::place::number_is_before;
use retrace_core::playback::partial_increment;
use retrace_core::{Place, Rate, RecordIndex};
use retrace_gcode::ActiveCodes;
use retrace_journal::{LengthChange, MarkDifference, PlaceMark, ProgramAnswer, RecordRanges, TapBegin};
use retrace_link::{CardStatus, GearState, OutputChange, Outputs, PathStart, SpindleTask, channel};

use crate::approach::approach;
use crate::entered_threads::EnteredThread;
use crate::kept_tap::KeptTap;
use crate::kerf_map::KerfReplay;
use crate::plan_item::ExclusiveKind;
use crate::question::Question;
use crate::record_streamer::{PassedItem, RecordStreamer};
use crate::start_line::StartPoint;

/// Place where a job was left, and the data to find it again.
#[derive(Clone, Debug, PartialEq)]
pub struct ResumePoint {
    /// The machine's position on the path, and what was executed of it. Whether the path rests there is determined from
    /// the records.
    pub start: PathStart,
    /// Place where the job's path began.
    pub origin: RecordIndex,
    /// Where in the program the job began, if not at its first block.
    pub began_within: Option<StartPoint>,
    /// Number of the last instruction that was executed before the job began.
    pub executed: u32,
    /// Outputs at that time.
    pub outputs: Outputs,
    /// Overrides that the planner has applied, with the places from which they count, in order.
    pub overrides: Vec<(RecordIndex, Rate)>,
    /// Marks of the index, in the order of the places: all of them, or at least the last one beyond `start.place`.
    pub marks: Vec<PlaceMark>,
    /// Numbers of the blocks behind which the path rests because the program was cut off or rejected there in an
    /// earlier run.
    pub rests: Vec<u64>,
    /// Tool lengths that were entered in pauses, in order. At the machine's position the path is moved by all of them.
    pub lengths: Vec<LengthChange>,
    /// Answers of the machine to the program, in order.
    pub answers: Vec<ProgramAnswer>,
    /// The last rigid tap, unless it is complete.
    pub tap: Option<TapBegin>,
    /// Where that tap begins on the card's path of manual moves, if it was due.
    pub tap_on_card: Option<RecordIndex>,
    /// Places up to which cutters have certainly cut.
    pub cut_ends: Vec<ResumedCutEnd>,
    /// What was cut of the path (CUT-26).
    pub cut: RecordRanges,
    /// The cutter on this channel was being lit at `start.reached` by its own instruction, and may have cut since: the
    /// instruction counts as executed, and the cutter pierces again before it starts in motion in a kerf.
    pub begun_start: Option<u8>,
}

/// Place up to which a cutter has certainly cut in the job that is resumed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResumedCutEnd {
    /// Channel that fires the cutter.
    pub channel: u8,
    /// The place.
    pub place: Place,
    /// Record up to which its kerf may reach, where the job was resumed before, has passed there and struck no arc.
    pub latest: RecordIndex,
    /// Whether the cut was interrupted there and not continued. It counts also where the program has switched the
    /// cutter off since; other places count where the program expects the cutter to be on at `reached`.
    pub is_interruption: bool,
    /// Whether the interruption was seen as it happened. Otherwise the cut may go on behind the place, up to `reached`.
    pub is_exact: bool,
}

impl ResumePoint {
    /// A job that began at `origin` with all outputs off, at 100 %, and with an empty index.
    #[must_use]
    pub fn at(start: PathStart, origin: RecordIndex) -> Self {
        let outputs = [0; channel::COUNT];
        Self {
            start,
            origin,
            began_within: None,
            executed: 0,
            outputs,
            overrides: Vec::new(),
            marks: Vec::new(),
            rests: Vec::new(),
            lengths: Vec::new(),
            answers: Vec::new(),
            tap: None,
            tap_on_card: None,
            cut_ends: Vec::new(),
            cut: RecordRanges::default(),
            begun_start: None,
        }
    }
}

impl ResumePoint {
    /// Checks whether a ring with `look_ahead` records of look-ahead can have produced this place and these marks.
    pub(crate) fn validate(&self, look_ahead: u32) -> Result<(), ResumeError> {
        let PathStart { place, reached, .. } = self.start;
        let last = self.marks.last().map_or(reached, |mark| mark.place);
        let ahead = reached.is_before(last) && last.since(reached) > look_ahead;
        if !self.start.is_valid() || place.record.is_before(self.origin) || ahead {
            return Err(ResumeError::NoSuchPlace);
        }
        Ok(())
    }
}

/// Reason why the place was not found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ResumeError {
    /// `reached` is before `place`, or `place` is outside of the history.
    NoSuchPlace,
    /// The program ends before it.
    ProgramEnds {
        /// Place where it ends.
        at: RecordIndex,
    },
    /// Instructions and places are inconsistent: instruction `number` is at `place`, and `executed` contradicts that.
    Instruction {
        /// Its number.
        number: u32,
        /// Its place, if the program has an instruction of that number before its end.
        place: Option<RecordIndex>,
    },
    /// The program's plan differs at a mark.
    Differs(Box<MarkDifference>),
    /// The job was left inside a thread that begins in this line, and the card does not hold the tool in it any more.
    InThread {
        /// The line.
        line: u32,
    },
    /// Planning failed: a defect.
    PlanningFailed,
}

impl fmt::Display for ResumeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoSuchPlace => write!(f, "the place where the job was left is not a possible one"),
            Self::ProgramEnds { at } => {
                write!(f, "the program ends at record {at}, before the place where the job was left")
            }
            Self::Instruction { number, place: Some(place) } => {
                write!(f, "instruction {number} is at record {place}, which contradicts what was executed")
            }
            Self::Instruction { number, place: None } => write!(f, "the program has no instruction {number}"),
            Self::Differs(differs) => {
                let MarkDifference { was, is } = **differs;
                write!(
                    f,
                    "at record {} the program is at line {} with counts {:?}, and was at line {} with counts {:?}",
                    was.place, is.line, is.counts, was.line, was.counts
                )
            }
            Self::InThread { line } => write!(
                f,
                "the job was left inside the thread of line {line}, and the card does not follow the spindle there \
                 any more"
            ),
            Self::PlanningFailed => write!(f, "the program could not be planned again"),
        }
    }
}

impl std::error::Error for ResumeError {}

/// A job that is ready to resume where it was left.
#[derive(Clone, Debug)]
pub struct ResumePlan<const A: usize> {
    start: PathStart,
    counts: [i64; A],
    expected: Outputs,
    oldest: RecordIndex,
    line: u32,
    into_line_mm: f64,
    history_mm: f64,
    planned: Rate,
    card: CardStatus<A>,
    threads: Vec<EnteredThread>,
    thread: Option<EnteredThread>,
    tap: Option<KeptTap>,
}

impl<const A: usize> ResumePlan<A> {
    /// Place where it was left. Whether the path rests there follows from the records.
    #[must_use]
    pub fn start(&self) -> &PathStart {
        &self.start
    }

    /// Counts of that place, P(place).
    #[must_use]
    pub fn counts(&self) -> [i64; A] {
        self.counts
    }

    /// Outputs that the program expects at `reached`.
    #[must_use]
    pub fn expected_outputs(&self) -> &Outputs {
        &self.expected
    }

    /// Oldest place that reverse run can reach.
    #[must_use]
    pub fn oldest(&self) -> RecordIndex {
        self.oldest
    }

    /// Program line of the record at the place.
    #[must_use]
    pub fn line(&self) -> u32 {
        self.line
    }

    /// Distance of the place from the beginning of the line's move, mm of path.
    #[must_use]
    pub fn into_line_mm(&self) -> f64 {
        self.into_line_mm
    }

    /// Length of the history behind the place, mm of path.
    #[must_use]
    pub fn history_mm(&self) -> f64 {
        self.history_mm
    }

    /// Override that is planned at `reached`.
    #[must_use]
    pub fn planned_override(&self) -> Rate {
        self.planned
    }

    /// The threads that were entered, as far as their records are retained.
    #[must_use]
    pub fn threads(&self) -> &[EnteredThread] {
        &self.threads
    }

    /// Thread in which the card still holds the tool at its place.
    #[must_use]
    pub const fn thread(&self) -> Option<EnteredThread> {
        self.thread
    }

    /// Tap in which the card still holds the tool.
    #[must_use]
    pub const fn tap(&self) -> Option<KeptTap> {
        self.tap
    }

    /// Status of the card.
    #[must_use]
    pub fn card(&self) -> &CardStatus<A> {
        &self.card
    }

    /// Moves that bring the machine to the place in the safe order, each by its end in counts. Empty where the machine
    /// is there already.
    ///
    /// # Errors
    /// `E4305` where an axis would go beyond its soft limits.
    pub fn return_path(&self, machine: &MachineConfig) -> Result<Vec<[i64; A]>, NumberedError> {
        if self.tap.is_some() {
            return Ok(Vec::new());
        }
        approach(machine, self.card.counts, self.counts)
    }

    /// Whether the card's counts are those of the place, or of the tap that begins there.
    #[must_use]
    pub fn matches_card(&self) -> bool {
        self.card.at_rest && (self.tap.is_some() || self.card.counts == self.counts)
    }
}

/// Receives what the program has switched before the place where the job was left: streamer, place, line and changes.
pub(crate) type ReplayedSwitching<'s, 'r, const A: usize> =
    &'s mut dyn FnMut(&RecordStreamer<'r, A>, RecordIndex, u32, &[OutputChange]);

/// Replays the plan from the job's origin to the place where it was left.
pub(crate) struct PlanReplay<'s, 'r, const A: usize> {
    streamer: &'s mut RecordStreamer<'r, A>,
    at: &'s ResumePoint,
    /// Place up to which everything is replayed.
    place: RecordIndex,
    /// Number of the last instruction that counts as executed.
    executed: u32,
    sum: [i64; A],
    /// Modal state that is in force there.
    active: Option<Box<ActiveCodes>>,
    /// Counts at the place where the job was left, once it is replayed.
    counts: Option<[i64; A]>,
    line: u32,
    machine: &'s MachineConfig,
    mm_per_pulse: [f64; A],
    switched: ReplayedSwitching<'s, 'r, A>,
    kerfs: KerfReplay<'s>,
    threads: Vec<EnteredThread>,
}

impl<'s, 'r, const A: usize> PlanReplay<'s, 'r, A> {
    /// Creates a replay of `streamer`, whose ring begins with counts of `counts` at the job's origin.
    pub(crate) fn new(
        streamer: &'s mut RecordStreamer<'r, A>,
        at: &'s ResumePoint,
        counts: [i64; A],
        machine: &'s MachineConfig,
        (switched, kerfs): (ReplayedSwitching<'s, 'r, A>, KerfReplay<'s>),
    ) -> Self {
        let (place, executed) = (at.origin, at.start.executed);
        Self {
            streamer,
            at,
            place,
            executed,
            sum: counts,
            active: None,
            counts: None,
            line: 0,
            machine,
            mm_per_pulse: std::array::from_fn(|axis| {
                machine.axes.get(axis).map_or(0.0, |axis| axis.pulses_per_mm.recip())
            }),
            switched,
            kerfs,
            threads: Vec::new(),
        }
    }

    /// Length of the path back from where it was left to `oldest`, mm. It ends at the first record whose line
    /// `is_included` excludes.
    fn path_back_mm(&self, oldest: RecordIndex, goes_on: impl Fn(u32) -> bool) -> f64 {
        let (left, mut mm) = (self.at.start.place, 0.0);
        let length = |increments: &[i16; A], share: f64| {
            let each = increments.iter().zip(&self.mm_per_pulse);
            each.map(|(&n, scale)| (f64::from(n) * scale).powi(2)).sum::<f64>().sqrt() * share
        };
        if let Some(record) =
            self.streamer.record(left.record).filter(|record| left.fraction > 0 && goes_on(record.line))
        {
            mm += length(&record.increments, left.fraction_of_record());
        }
        let mut place = left.record;
        while oldest.is_before(place) {
            place -= 1;
            match self.streamer.record(place) {
                Some(record) if goes_on(record.line) => mm += length(&record.increments, 1.0),
                _ => break,
            }
        }
        mm
    }

    /// Replays to the end; waits for the planner.
    pub(crate) fn run(mut self, card: &CardStatus<A>) -> Result<ResumePlan<A>, ResumeError> {
        let start = self.at.start;
        while !self.replay_planned()? {
            thread::sleep(Duration::from_micros(50));
        }
        let tap = self.tap_at_place(card)?;
        let thread = self.thread_at_place(card)?;
        let (line, counts) = match (self.streamer.record(start.place.record), self.counts) {
            (record, Some(counts)) => (record.map_or(self.line, |record| record.line), counts),
            _ => return Err(ResumeError::NoSuchPlace),
        };
        // The ends of the threads that were reversed through are passed forward again.
        let ends = self.threads.iter().map(EnteredThread::end);
        self.streamer.open_barriers_behind(start.place.record, &ends.collect::<Vec<_>>());
        if start.place.record.is_before(self.streamer.oldest()) {
            return Err(ResumeError::NoSuchPlace);
        }
        self.streamer.seek_place(start.place.record);
        let rests = start.place.fraction == 0 && self.streamer.is_at_rest_before(start.place.record);
        let start = PathStart { rests, executed: self.executed, ..start };
        if let Some(active) = self.active.take() {
            self.streamer.requeue_active_codes(active);
        }
        let oldest = self.streamer.oldest();
        let into_line_mm = self.path_back_mm(oldest, |of| of == line);
        let history_mm = self.path_back_mm(oldest, |_| true);
        let passed = self.at.overrides.iter().take_while(|(place, _)| !start.reached.is_before(*place));
        Ok(ResumePlan {
            start,
            counts,
            expected: *self.streamer.expected(),
            oldest,
            line,
            into_line_mm,
            history_mm,
            planned: passed.last().map_or(Rate::ONE, |&(_, planned)| planned),
            card: *card,
            threads: self.threads,
            thread,
            tap,
        })
    }

    /// The tap in which the job was left: it goes on where the card has kept it, and the tool is where its records say.
    fn tap_at_place(&mut self, card: &CardStatus<A>) -> Result<Option<KeptTap>, ResumeError> {
        let Some(begun) = self.at.tap.filter(|tap| tap.place == self.at.start.place.record.number()) else {
            return Ok(None);
        };
        // The planner asks for it next.
        while self.streamer.sent_instruction().is_none() && !self.streamer.planner_is_gone() {
            thread::sleep(Duration::from_micros(50));
            self.streamer.poll_planner();
        }
        let question = self.streamer.sent_instruction().and_then(|next| next.question.as_deref());
        let kept = match (question, self.at.tap_on_card, self.counts) {
            (Some(&Question::Tap(question)), Some(first), Some(counts)) => {
                KeptTap::of_card(question, (first, counts), self.machine, card, begun.line)
            }
            _ => None,
        };
        kept.map(Some).ok_or(ResumeError::InThread { line: begun.line })
    }

    /// The thread in which the job was left: it goes on where the card has kept it, since the last instruction armed
    /// it, at the very place.
    fn thread_at_place(&self, card: &CardStatus<A>) -> Result<Option<EnteredThread>, ResumeError> {
        let left = self.at.start.place;
        let Some(thread) = self.threads.iter().find(|thread| thread.is_around(left)) else { return Ok(None) };
        let is_there = card.place == left && Some(card.counts) == self.counts && card.executed == self.executed;
        let is_kept = card.spindle.gear == GearState::Engaged && is_there;
        if is_kept { Ok(Some(*thread)) } else { Err(ResumeError::InThread { line: thread.line }) }
    }

    /// Replays what is planned by now. Returns true at the end.
    fn replay_planned(&mut self) -> Result<bool, ResumeError> {
        let reached = self.at.start.reached;
        self.streamer.poll_planner();
        if let Some(Err(difference)) = self.streamer.marks() {
            return Err(ResumeError::Differs(difference.clone()));
        }
        let known = self.streamer.items_complete_until();
        let limit = if known.is_before(reached) { known } else { reached };
        while let Some(place) = self.streamer.next_exclusive()
            && !limit.is_before(place)
        {
            let number = self.streamer.instruction_number();
            self.advance_to(place);
            if place == reached && self.is_begun_start(number) {
                self.executed = number;
            }
            if place == reached && number == self.executed && self.is_unanswered_wait() {
                self.executed = number.wrapping_sub(1);
            }
            if number_is_before(self.executed, number) {
                if place == reached {
                    break;
                }
                return Err(ResumeError::Instruction { number, place: Some(place) });
            }
            if let Some(done) = self.streamer.mark_executed(number) {
                if let Some(SpindleTask::Gear(start)) = done.spindle {
                    self.threads.push(EnteredThread::new(done.place, start, done.line, self.streamer.expected()));
                }
                if let Some(kerf_um) = done.kerf_um {
                    self.kerfs.begin_contour(kerf_um);
                }
                (self.switched)(self.streamer, done.place, done.line, &done.changes[..usize::from(done.count)]);
            }
        }
        if self.streamer.next_exclusive().is_none_or(|place| !place.is_before(limit)) {
            self.advance_to(limit);
        }
        let (next, executed) = (self.streamer.instruction_number(), self.executed);
        // Instructions up to `reached` were executed before the record there.
        if self.place == reached && reached.is_before(known) && !number_is_before(executed, next) {
            return Err(ResumeError::Instruction { number: next, place: self.streamer.next_exclusive() });
        }
        let is_there = self.place == reached && next == executed.wrapping_add(1);
        let has_marks =
            self.streamer.marks().is_some() || !self.at.marks.iter().any(|m| self.at.origin.is_before(m.place));
        if is_there && has_marks {
            return Ok(true);
        }
        if self.streamer.planner_is_gone() {
            return Err(ResumeError::PlanningFailed);
        }
        match self.streamer.program_end() {
            Some(at) if at.is_before(reached) => Err(ResumeError::ProgramEnds { at }),
            Some(_) if self.place == reached && !is_there => {
                Err(ResumeError::Instruction { number: next, place: None })
            }
            Some(at) if is_there => Err(ResumeError::ProgramEnds { at }),
            _ => Ok(false),
        }
    }

    /// Whether the pending instruction is a wait for an input whose answer is not in the journal: the host was killed
    /// after the card had executed it. Nothing behind it was planned, and the input is read again.
    fn is_unanswered_wait(&self) -> bool {
        self.streamer.sent_instruction().is_some_and(|next| next.kind == ExclusiveKind::Input)
    }

    /// Whether the pending instruction, the first that is not executed, had begun to light a cutter.
    fn is_begun_start(&self, number: u32) -> bool {
        let channel = self.at.begun_start.filter(|_| number == self.at.start.executed.wrapping_add(1));
        let next = self.streamer.sent_instruction();
        channel.is_some_and(|channel| next.is_some_and(|next| next.switches_on(channel)))
    }

    /// Advances to `place`: sums the records up to there, and passes the items before it.
    fn advance_to(&mut self, place: RecordIndex) {
        let left = self.at.start.place;
        while self.place.is_before(place) {
            let Some(record) = self.streamer.record(self.place) else { return };
            if self.place == left.record {
                self.counts = Some(std::array::from_fn(|axis| {
                    self.sum[axis] + i64::from(partial_increment(record.increments[axis], left.fraction))
                }));
            }
            for (sum, &increment) in self.sum.iter_mut().zip(&record.increments) {
                *sum += i64::from(increment);
            }
            self.kerfs.pass(self.place, &self.sum);
            self.line = record.line;
            self.place += 1;
        }
        if self.place == left.record && left.fraction == 0 {
            self.counts = Some(self.sum);
        }
        self.streamer.seek_place(place);
        let mut last = None;
        while let Some(news) = self.streamer.next_passed_item() {
            match news {
                PassedItem::Active(active) => last = Some(active),
                PassedItem::Action(action, line) => {
                    let change = OutputChange { channel: action.channel, value: action.after };
                    (self.switched)(self.streamer, action.place, line, &[change]);
                }
                PassedItem::Message(..) => {}
            }
        }
        // The resumed job begins with the modal state that is in force.
        self.active = last.or(self.active.take());
    }
}
