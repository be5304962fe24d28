//! A job that is taken up where it was left: planned again from its beginning, followed to that place without a word to the card.
//!
//! What a job is planned to is a function of its program, the machine, where the machine stood, and the overrides above 100 % with their
//! places. So the whole history is in the ring again, as far as the ring keeps it, and the place is the very same.
//!
//! Invariant: nothing is sent to the card before the place is found, its marks are as they were, and whoever asked for it has agreed.

use std::fmt;
use std::thread;
use std::time::Duration;

use retrace_core::place::is_before;
use retrace_core::playback::partial_increment;
use retrace_core::{ONE, Travel};
use retrace_gcode::ActiveCodes;
use retrace_link::{CardStatus, Outputs, PathStart, channel};

use crate::approach::approach;
use crate::machine::MachineConfig;
use crate::numbered_error::NumberedError;
use crate::place_index::{MarkDifference, PlaceMark};
use crate::record_streamer::{PassedItem, RecordStreamer};
use crate::tool_length::LengthChange;

/// Where a job was left, and what it is to be found again by.
#[derive(Clone, Debug, PartialEq)]
pub struct ResumePoint {
    /// Where the machine stands on the path, and what was done of it. Whether the path rests there is found out.
    pub start: PathStart,
    /// The place where the job's path began.
    pub origin: u32,
    /// Number of the last instruction that was executed before the job began.
    pub executed: u32,
    /// The outputs as they were there.
    pub outputs: Outputs,
    /// The overrides that the planner has heeded, with the places from which they count, in their order.
    pub overrides: Vec<(u32, Travel)>,
    /// What the index says, in the order of the places; all of it, or the last mark at least that lies beyond `start.place`.
    pub marks: Vec<PlaceMark>,
    /// Numbers of the blocks behind which the path rests because the program was cut off or refused there in a run before.
    pub rests: Vec<u64>,
    /// Tool lengths that were entered in pauses, in their order: where the machine stands, the path is moved by all of them.
    pub lengths: Vec<LengthChange>,
}

impl ResumePoint {
    /// A job that began at `origin` with all outputs off, at 100 %, and whose index says nothing.
    #[must_use]
    pub fn at(start: PathStart, origin: u32) -> Self {
        let outputs = [0; channel::COUNT];
        Self {
            start,
            origin,
            executed: 0,
            outputs,
            overrides: Vec::new(),
            marks: Vec::new(),
            rests: Vec::new(),
            lengths: Vec::new(),
        }
    }
}

impl ResumePoint {
    /// Can a ring that plans `look_ahead` records ahead have left such a place, and made such marks?
    pub(crate) fn could_be(&self, look_ahead: u32) -> Result<(), ResumeError> {
        let PathStart { place, reached, .. } = self.start;
        let last = self.marks.last().map_or(reached, |mark| mark.place);
        let ahead = is_before(reached, last) && last.wrapping_sub(reached) > look_ahead;
        if !self.start.is_valid() || is_before(place.record, self.origin) || ahead {
            return Err(ResumeError::NoSuchPlace);
        }
        Ok(())
    }
}

/// Why the place is not found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ResumeError {
    /// `reached` lies before `place`, or `place` before what history can hold.
    NoSuchPlace,
    /// The program ends before it.
    Ends {
        /// Place where it ends.
        at: u32,
    },
    /// Instructions and places do not go together: instruction `number` stands at `place`, and `executed` says otherwise.
    Instruction {
        /// Its number.
        number: u32,
        /// Its place, if the program has one of that number before its end.
        place: Option<u32>,
    },
    /// The program comes to something else where a mark was made.
    Differs(Box<MarkDifference>),
    /// Planning failed; a defect.
    CutOff,
}

impl fmt::Display for ResumeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoSuchPlace => write!(f, "the place where the job was left is none that it can have had"),
            Self::Ends { at } => write!(f, "the program ends at record {at}, before the place where the job was left"),
            Self::Instruction { number, place: Some(place) } => {
                write!(f, "instruction {number} stands at record {place}, which does not go with what was executed")
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
            Self::CutOff => write!(f, "the program could not be planned again"),
        }
    }
}

/// A job that is ready to go on from where it was left.
#[derive(Clone, Debug)]
pub struct ResumePlan<const A: usize> {
    start: PathStart,
    counts: [i64; A],
    expected: Outputs,
    oldest: u32,
    line: u32,
    into_line_mm: f64,
    history_mm: f64,
    planned: Travel,
    card: CardStatus<A>,
}

impl<const A: usize> ResumePlan<A> {
    /// Where it was left; whether the path rests there its records say.
    #[must_use]
    pub fn start(&self) -> &PathStart {
        &self.start
    }

    /// The counts of that place, P(place), in pulses.
    #[must_use]
    pub fn counts(&self) -> [i64; A] {
        self.counts
    }

    /// What the program expects of the outputs at `reached`.
    #[must_use]
    pub fn expected_outputs(&self) -> &Outputs {
        &self.expected
    }

    /// The oldest place that can be gone back to.
    #[must_use]
    pub fn oldest(&self) -> u32 {
        self.oldest
    }

    /// Program line of the record under the place.
    #[must_use]
    pub fn line(&self) -> u32 {
        self.line
    }

    /// How far into the line's move the place is, mm of path.
    #[must_use]
    pub fn into_line_mm(&self) -> f64 {
        self.into_line_mm
    }

    /// How far back history reaches from the place, mm of path.
    #[must_use]
    pub fn history_mm(&self) -> f64 {
        self.history_mm
    }

    /// The override that is planned at `reached`.
    #[must_use]
    pub fn planned_override(&self) -> Travel {
        self.planned
    }

    /// What the card says of itself.
    #[must_use]
    pub fn card(&self) -> &CardStatus<A> {
        &self.card
    }

    /// The moves that bring the machine to the place in the safe order, each by its end in counts; none where it stands there.
    ///
    /// # Errors
    /// `E4305` where an axis would go beyond its soft limits.
    pub fn return_path(&self, machine: &MachineConfig) -> Result<Vec<[i64; A]>, NumberedError> {
        approach(machine, self.card.counts, self.counts)
    }

    /// Does the machine stand at the counts of the place?
    #[must_use]
    pub fn matches_card(&self) -> bool {
        self.card.at_rest && self.card.counts == self.counts
    }
}

/// Follows what is planned from the job's origin to where it was left.
pub(crate) struct PlanReplay<'s, 'r, const A: usize> {
    supply: &'s mut RecordStreamer<'r, A>,
    at: &'s ResumePoint,
    /// Up to here everything is followed.
    place: u32,
    sum: [i64; A],
    /// The modal state that is in force there.
    active: Option<Box<ActiveCodes>>,
    /// At the place where it was left.
    counts: Option<[i64; A]>,
    line: u32,
    mm_per_pulse: [f64; A],
}

impl<'s, 'r, const A: usize> PlanReplay<'s, 'r, A> {
    /// Follows `supply`, whose ring begins with counts of `counts` at the job's origin.
    pub(crate) fn new(
        supply: &'s mut RecordStreamer<'r, A>,
        at: &'s ResumePoint,
        counts: [i64; A],
        mm_per_pulse: [f64; A],
    ) -> Self {
        Self { supply, at, place: at.origin, sum: counts, active: None, counts: None, line: 0, mm_per_pulse }
    }

    /// Path back from where it was left to `oldest`, as long as `run_resumed` with a record's line, mm.
    fn path_mm(&self, oldest: u32, goes_on: impl Fn(u32) -> bool) -> f64 {
        let (left, mut mm) = (self.at.start.place, 0.0);
        let length = |increments: &[i16; A], share: f64| {
            let each = increments.iter().zip(&self.mm_per_pulse);
            each.map(|(&n, scale)| (f64::from(n) * scale).powi(2)).sum::<f64>().sqrt() * share
        };
        if let Some(record) = self.supply.record(left.record).filter(|record| left.fraction > 0 && goes_on(record.line))
        {
            mm += length(&record.increments, f64::from(left.fraction) / ONE as f64);
        }
        let mut place = left.record;
        while is_before(oldest, place) {
            place = place.wrapping_sub(1);
            match self.supply.record(place) {
                Some(record) if goes_on(record.line) => mm += length(&record.increments, 1.0),
                _ => break,
            }
        }
        mm
    }

    /// Follows to the end; waits for the planner.
    pub(crate) fn follow(mut self, card: &CardStatus<A>) -> Result<ResumePlan<A>, ResumeError> {
        let start = self.at.start;
        while !self.step()? {
            thread::sleep(Duration::from_micros(50));
        }
        let (line, counts) = match (self.supply.record(start.place.record), self.counts) {
            (record, Some(counts)) => (record.map_or(self.line, |record| record.line), counts),
            _ => return Err(ResumeError::NoSuchPlace),
        };
        if is_before(start.place.record, self.supply.oldest()) {
            return Err(ResumeError::NoSuchPlace);
        }
        self.supply.stand_at(start.place.record);
        let rests = start.place.fraction == 0 && self.supply.rests_before(start.place.record);
        let start = PathStart { rests, ..start };
        if let Some(active) = self.active.take() {
            self.supply.still_active(active);
        }
        let oldest = self.supply.oldest();
        let into_line_mm = self.path_mm(oldest, |of| of == line);
        let history_mm = self.path_mm(oldest, |_| true);
        let passed = self.at.overrides.iter().take_while(|(place, _)| !is_before(start.reached, *place));
        Ok(ResumePlan {
            start,
            counts,
            expected: *self.supply.expected(),
            oldest,
            line,
            into_line_mm,
            history_mm,
            planned: passed.last().map_or(ONE, |&(_, planned)| planned),
            card: *card,
        })
    }

    /// Follows what is planned by now; true at the end.
    fn step(&mut self) -> Result<bool, ResumeError> {
        let (reached, executed) = (self.at.start.reached, self.at.start.executed);
        self.supply.poll_planner();
        if let Some(Err(difference)) = self.supply.marks() {
            return Err(ResumeError::Differs(difference.clone()));
        }
        let known = self.supply.items_complete_until();
        let limit = if is_before(known, reached) { known } else { reached };
        while let Some(place) = self.supply.next_exclusive()
            && !is_before(limit, place)
        {
            let number = self.supply.number();
            self.go_to(place);
            if is_before(executed, number) {
                if place == reached {
                    break;
                }
                return Err(ResumeError::Instruction { number, place: Some(place) });
            }
            self.supply.done_before(number);
        }
        if self.supply.next_exclusive().is_none_or(|place| !is_before(place, limit)) {
            self.go_to(limit);
        }
        let next = self.supply.number();
        // Whatever stands up to `reached` came before the record there.
        if self.place == reached && is_before(reached, known) && !is_before(executed, next) {
            return Err(ResumeError::Instruction { number: next, place: self.supply.next_exclusive() });
        }
        let is_there = self.place == reached && next == executed.wrapping_add(1);
        let has_marks =
            self.supply.marks().is_some() || !self.at.marks.iter().any(|m| is_before(self.at.origin, m.place));
        if is_there && has_marks {
            return Ok(true);
        }
        if self.supply.planner_gone() {
            return Err(ResumeError::CutOff);
        }
        match self.supply.ends_at() {
            Some(at) if is_before(at, reached) => Err(ResumeError::Ends { at }),
            Some(_) if self.place == reached && !is_there => {
                Err(ResumeError::Instruction { number: next, place: None })
            }
            Some(at) if is_there => Err(ResumeError::Ends { at }),
            _ => Ok(false),
        }
    }

    /// Goes on to `place`: sums the records up to there, and passes what stands before it.
    fn go_to(&mut self, place: u32) {
        let left = self.at.start.place;
        while is_before(self.place, place) {
            let Some(record) = self.supply.record(self.place) else { return };
            if self.place == left.record {
                self.counts = Some(std::array::from_fn(|axis| {
                    self.sum[axis] + i64::from(partial_increment(record.increments[axis], left.fraction))
                }));
            }
            for (sum, &increment) in self.sum.iter_mut().zip(&record.increments) {
                *sum += i64::from(increment);
            }
            self.line = record.line;
            self.place = self.place.wrapping_add(1);
        }
        if self.place == left.record && left.fraction == 0 {
            self.counts = Some(self.sum);
        }
        self.supply.stand_at(place);
        let mut last = None;
        while let Some(news) = self.supply.next_passed_item() {
            if let PassedItem::Active(active) = news {
                last = Some(active);
            }
        }
        // Whoever goes on from here is told what is in force.
        self.active = last.or(self.active.take());
    }
}
