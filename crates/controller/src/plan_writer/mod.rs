//! The planning side of a job: moves, switching and stops go in, records go into the ring and items to the motion path.
//!
//! Invariant: an item's place is the number of the record before which it stands, and it is sent before that record.

mod tool_lengths;

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::thread;
use std::time::Duration;

use retrace_core::ring::Producer;
use retrace_core::{Flags, ONE, Record};
use retrace_gcode::ActiveCodes;
use retrace_link::{InputWait, MAX_CHANGES, OutputAction, OutputChange, Outputs};
use retrace_motion::{Arc, FeedRate, MoveError, PathMode, Planner};

use crate::limit_check::{LimitFinding, extremes};
use crate::machine::MachineConfig;
use crate::overrides::OverrideApplier;
use crate::place_index::{IndexEntry, IndexWriter, MarkDifference, PlaceMark};
use crate::plan_item::{ExclusiveInstruction, ExclusiveKind, PathItem, PlanSummary};
use crate::tool_length::{LengthChange, LengthOffers};
use tool_lengths::{Lengths, Planned};

/// The motion path has gone: there is nobody to plan for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cancelled;

/// Why a move was not taken.
#[derive(Clone, Debug, PartialEq)]
pub enum PlanWriteError {
    /// The planner cannot run it.
    Move(MoveError),
    /// It would leave the soft limits.
    BeyondLimit(LimitFinding),
    /// Nobody to plan for.
    Cancelled,
}

impl From<Cancelled> for PlanWriteError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

impl From<MoveError> for PlanWriteError {
    fn from(error: MoveError) -> Self {
        Self::Move(error)
    }
}

/// An exclusive instruction as the program gives it; it stands where the motion is now.
#[derive(Clone, Copy, Debug, Default)]
pub struct SwitchInstruction<'c> {
    /// Its program line.
    pub line: u32,
    /// What it is.
    pub kind: ExclusiveKind,
    /// As it is written in the program.
    pub code: &'static str,
    /// The outputs it switches, at most [`MAX_CHANGES`].
    pub changes: &'c [OutputChange],
    /// Control periods that it takes at least.
    pub periods: u32,
    /// What it waits for besides.
    pub until: Option<InputWait>,
    /// It cannot be passed backward.
    pub one_way: bool,
    /// Its outputs are set back where reverse run passes it and outputs are replayed.
    pub undone: bool,
}

/// An action that waits for a move.
#[derive(Clone, Copy, Debug)]
struct WaitingChange {
    /// Serial number of the move.
    serial: u32,
    change: OutputChange,
    line: u32,
    /// Reverse run leaves it as it is.
    lasts: bool,
}

/// A mark is made after so many records at the latest. As many are written together where the ring was full, so that there are no more marks
/// than that while the ring stays full.
const RECORDS_A_MARK: u32 = 64;

/// Where a move that may still come out of the planner comes from.
#[derive(Clone, Copy, Debug)]
struct SerialOrigin {
    serial: u32,
    line: u32,
    block: u64,
    /// Least and greatest coordinate of the tool axis at its end and on its way, mm.
    reach_mm: [f64; 2],
}

/// Plans a program into a ring.
pub struct PlanWriter<'r, const A: usize> {
    planner: Planner<A>,
    ring: Producer<'r, Record<A>>,
    items: SyncSender<PathItem>,
    cancel: &'r AtomicBool,
    /// Overrides above 100 %.
    overrides: OverrideApplier,
    /// The machine, whose soft limits no move may leave; none where nobody looks.
    machine: Option<&'r MachineConfig>,
    lengths: Lengths,
    /// Channels that a dry run keeps off (CUT-8); none otherwise.
    inhibited: Vec<u8>,
    /// Serial number of the last move given to the planner; its tag.
    serial: u32,
    /// The block that the moves to come belong to.
    block: u64,
    /// Line and block of each move that may still come out of the planner, by serial number.
    origins: VecDeque<SerialOrigin>,
    /// Actions that wait for the first record of the move with their serial number.
    waiting: VecDeque<WaitingChange>,
    /// Modal states that wait for the first record of the move with that serial number.
    modes: VecDeque<(u32, Box<ActiveCodes>)>,
    /// The outputs as the program has set them, actions still waiting included.
    outputs: Outputs,
    index: Box<dyn IndexWriter>,
    /// Where the last mark was made.
    marked: u32,
    /// What a mark behind the last record would be.
    here: PlaceMark,
    /// Marks of a run before, that the plan is held against.
    was: VecDeque<PlaceMark>,
}

impl<'r, const A: usize> PlanWriter<'r, A> {
    /// A feeder that plans with `planner` into `ring`; outputs begin as given. `cancel` tells it to give up.
    #[must_use]
    pub fn new(
        planner: Planner<A>,
        ring: Producer<'r, Record<A>>,
        items: SyncSender<PathItem>,
        outputs: Outputs,
        cancel: &'r AtomicBool,
    ) -> Self {
        let marked = ring.write();
        Self {
            planner,
            ring,
            items,
            cancel,
            overrides: OverrideApplier::default(),
            machine: None,
            lengths: Lengths::default(),
            inhibited: Vec::new(),
            serial: 0,
            block: 0,
            origins: VecDeque::new(),
            waiting: VecDeque::new(),
            modes: VecDeque::new(),
            outputs,
            index: Box::new(()),
            marked,
            here: PlaceMark { place: marked, ..PlaceMark::default() },
            was: VecDeque::new(),
        }
    }

    /// The same, which notes in `index` what it plans; the machine's counts are `counts` where the ring begins.
    #[must_use]
    pub fn noting(mut self, index: Box<dyn IndexWriter>, counts: &[i64]) -> Self {
        for (slot, &count) in self.here.counts.iter_mut().zip(counts) {
            *slot = count;
        }
        Self { index, ..self }
    }

    /// The same, which holds its plan against the marks of a run before, in the order of their places.
    #[must_use]
    pub fn held_against(self, marks: &[PlaceMark]) -> Self {
        let begins = self.here.place;
        let behind = |mark: &&PlaceMark| retrace_core::place::is_before(begins, mark.place);
        Self { was: marks.iter().filter(behind).copied().collect(), ..self }
    }

    /// The same, which heeds overrides above 100 %.
    #[must_use]
    pub fn heeding(self, overrides: OverrideApplier) -> Self {
        Self { overrides, ..self }
    }

    /// The same, which never switches these channels: a dry run.
    #[must_use]
    pub fn inhibiting(self, inhibited: Vec<u8>) -> Self {
        Self { inhibited, ..self }
    }

    /// The same, which refuses every move that leaves the soft limits of this machine.
    #[must_use]
    pub fn within(self, machine: &'r MachineConfig) -> Self {
        Self { machine: Some(machine), ..self }
    }

    /// The same, to which tool lengths can be entered; `again` are those that were when the job ran before, in the order of the blocks.
    #[must_use]
    pub(crate) fn taking_lengths(mut self, offers: LengthOffers, again: &[LengthChange]) -> Self {
        self.lengths.offers = Some(offers);
        self.lengths.again = again.iter().copied().collect();
        self
    }

    /// Where the last move ends, mm.
    #[must_use]
    pub fn commanded_mm(&self) -> [f64; A] {
        self.planner.commanded_mm()
    }

    /// The outputs as the program has set them.
    #[must_use]
    pub fn outputs(&self) -> &Outputs {
        &self.outputs
    }

    /// The moves to come belong to the decoder's block of that number.
    pub fn block(&mut self, number: u64) {
        self.block = number;
        while let Some(&LengthChange { block, pulses }) = self.lengths.again.front()
            && block < number
        {
            self.lengths.again.pop_front();
            self.lengths.moved_by += pulses;
        }
    }

    /// From the next move on this modal state is in force.
    pub fn active(&mut self, active: Box<ActiveCodes>) {
        self.modes.push_back((self.serial.wrapping_add(1), active));
    }

    /// Nothing is there to be planned for now: what is planned is marked, so that it can be run.
    ///
    /// # Errors
    /// [`Cancelled`], where it is of no use to wait.
    pub fn idle(&mut self) -> Result<(), Cancelled> {
        self.mark();
        self.take_length()?;
        if self.cancel.load(Ordering::Relaxed) { Err(Cancelled) } else { Ok(()) }
    }

    /// A straight move of program line `line`.
    ///
    /// # Errors
    /// What the planner refuses, with nothing changed.
    pub fn straight(
        &mut self,
        end_mm: [f64; A],
        feed: FeedRate,
        mode: PathMode,
        line: u32,
    ) -> Result<(), PlanWriteError> {
        let reach_mm = self.check_limits(&[end_mm], line)?;
        self.planner.line(end_mm, feed, mode, self.serial.wrapping_add(1))?;
        Ok(self.moved(line, reach_mm)?)
    }

    /// An arc or helix of program line `line`.
    ///
    /// # Errors
    /// What the planner refuses, with nothing changed.
    pub fn arc(&mut self, arc: &Arc<A>, feed: FeedRate, mode: PathMode, line: u32) -> Result<(), PlanWriteError> {
        let mut points = extremes(&self.planner.commanded_mm(), arc);
        points.push(arc.end_mm);
        let reach_mm = self.check_limits(&points, line)?;
        self.planner.arc(arc, feed, mode, self.serial.wrapping_add(1))?;
        Ok(self.moved(line, reach_mm)?)
    }

    fn moved(&mut self, line: u32, reach_mm: [f64; 2]) -> Result<(), Cancelled> {
        self.serial = self.serial.wrapping_add(1);
        self.origins.push_back(SerialOrigin { serial: self.serial, line, block: self.block, reach_mm });
        self.drain()
    }

    /// Refuses a move through these points that would leave the soft limits of an axis that it moves; how far along the tool axis it goes.
    fn check_limits(&self, points: &[[f64; A]], line: u32) -> Result<[f64; 2], PlanWriteError> {
        let Some(machine) = self.machine else { return Ok([0.0; 2]) };
        let tool = machine.tool_axis().filter(|&tool| tool < A);
        let from = self.planner.commanded_mm();
        let further = tool.map_or(0.0, |tool| self.lengths.moved_by as f64 / machine.axes[tool].pulses_per_mm);
        let mut reach_mm = tool.map_or([0.0; 2], |tool| [from[tool]; 2]);
        for point in points {
            if let Some(tool) = tool {
                reach_mm = [reach_mm[0].min(point[tool]), reach_mm[1].max(point[tool])];
            }
            let mut really = *point;
            if let Some(tool) = tool {
                really[tool] += further;
            }
            if let Some(beyond) = LimitFinding::of(machine, &really, |axis| axis < A && point[axis] != from[axis], line)
            {
                return Err(PlanWriteError::BeyondLimit(beyond));
            }
        }
        Ok(reach_mm)
    }

    /// A synchronous action: executed in passing, where the next move begins.
    pub fn action(&mut self, change: OutputChange, line: u32) {
        self.act(change, line, false);
    }

    /// The same, which reverse run leaves as it is.
    pub fn lasting_action(&mut self, change: OutputChange, line: u32) {
        self.act(change, line, true);
    }

    fn act(&mut self, change: OutputChange, line: u32, lasts: bool) {
        if !self.inhibited.contains(&change.channel) {
            self.waiting.push_back(WaitingChange { serial: self.serial.wrapping_add(1), change, line, lasts });
        }
    }

    /// An exclusive instruction: the motion comes to rest here, also under G64.
    ///
    /// # Errors
    /// [`Cancelled`]
    pub fn exclusive(&mut self, switch: SwitchInstruction<'_>) -> Result<(), Cancelled> {
        self.rest()?;
        let mut changes = [OutputChange::default(); MAX_CHANGES];
        let mut count = 0;
        let allowed = switch.changes.iter().filter(|change| !self.inhibited.contains(&change.channel));
        for (slot, change) in changes.iter_mut().zip(allowed) {
            *slot = *change;
            count += 1;
        }
        // What is kept off in a dry run takes no time, and reports nothing either.
        let switch =
            if count < switch.changes.len() { SwitchInstruction { periods: 0, until: None, ..switch } } else { switch };
        let before = self.outputs;
        for change in &changes[..count] {
            self.outputs[usize::from(change.channel)] = change.value;
        }
        let SwitchInstruction { line, kind, code, periods, until, one_way, undone, .. } = switch;
        let place = self.ring.write();
        let exclusive =
            ExclusiveInstruction { place, line, kind, code, changes, count: count as u8, periods, until, one_way };
        self.send(PathItem::Exclusive(exclusive))?;
        // As an action of the record behind it, it is undone and done again like any other.
        for change in changes[..count].iter().filter(|_| undone) {
            let OutputChange { channel, value } = *change;
            let action = OutputAction { place, channel, before: before[usize::from(channel)], after: value };
            self.send(PathItem::Action(action, 0))?;
        }
        Ok(())
    }

    /// A message, shown when the motion comes here.
    ///
    /// # Errors
    /// [`Cancelled`]
    pub fn message(&mut self, text: String, line: u32) -> Result<(), Cancelled> {
        let place = self.ring.write();
        self.send(PathItem::Message { place, line, text })
    }

    /// Brings the motion to rest here. Actions that found no motion to go with are executed at the stop.
    ///
    /// # Errors
    /// [`Cancelled`]
    pub fn rest(&mut self) -> Result<(), Cancelled> {
        self.planner.stop(Flags::NONE);
        self.drain()?;
        self.origins.clear();
        self.send_active(self.serial.wrapping_add(1))?;
        while let Some(WaitingChange { change, line, lasts, .. }) = self.waiting.pop_front() {
            let (code, changes) = ("M62–M65", [change]);
            self.exclusive(SwitchInstruction {
                line,
                code,
                changes: &changes,
                undone: !lasts,
                ..SwitchInstruction::default()
            })?;
        }
        Ok(())
    }

    /// Notes that the program ends early, behind that block: the path is to rest there also when it is planned again.
    pub fn rest_behind(&mut self, block: u64) {
        self.index.note(IndexEntry::Rest { block });
    }

    /// The end of the program.
    ///
    /// # Errors
    /// [`Cancelled`]
    pub fn end(&mut self, summary: PlanSummary) -> Result<(), Cancelled> {
        self.rest()?;
        self.mark();
        self.send(PathItem::End(summary))
    }

    /// Waits until there is something, with pauses, and gives up when told to.
    fn wait_for<T>(&mut self, mut is_there: impl FnMut(&mut Self) -> Option<T>) -> Result<T, Cancelled> {
        loop {
            if let Some(there) = is_there(self) {
                return Ok(there);
            }
            if self.cancel.load(Ordering::Relaxed) {
                return Err(Cancelled);
            }
            thread::sleep(Duration::from_micros(50));
        }
    }

    /// Takes what the planner has and puts it into the ring. A record comes out of the planner only when the ring has room for it:
    /// so an override can still be heeded at the first place that the ring has no room for.
    fn drain(&mut self) -> Result<(), Cancelled> {
        loop {
            if !self.ring.has_room() {
                self.mark();
                // Somebody may wait for the last of the marks, and let no record go before he has it.
                let wanted = if self.was.is_empty() { RECORDS_A_MARK } else { 1 };
                self.patiently(|feeder| (feeder.ring.slots() >= wanted).then_some(Ok(())))?;
            }
            if let Some(planned) = self.overrides.due(self.ring.write()) {
                self.index.note(IndexEntry::Override { place: self.ring.write(), planned });
                self.planner.set_feed_override(planned as f64 / ONE as f64);
            }
            let Some(record) = self.planner.next_record() else { return Ok(()) };
            let serial = record.line;
            self.send_active(serial)?;
            self.send_actions(serial)?;
            if let Some(Planned::Waiting { serial: end }) = self.lengths.last_end
                && retrace_core::place::is_before(end, serial)
            {
                self.lengths.last_end = Some(Planned::Until(self.ring.write()));
            }
            let origin = self.origin_of(serial);
            self.push(Record { line: origin.line, ..record }, origin.block)?;
        }
    }

    /// Where the move with that serial number comes from. Moves before it will not come out of the planner again.
    fn origin_of(&mut self, serial: u32) -> SerialOrigin {
        while self.origins.len() > 1
            && self.origins.front().is_some_and(|o| retrace_core::place::is_before(o.serial, serial))
        {
            self.origins.pop_front();
        }
        let unknown = SerialOrigin { serial, line: 0, block: 0, reach_mm: [0.0; 2] };
        self.origins.front().copied().unwrap_or(unknown)
    }

    /// Marks what is planned, if it is not marked yet.
    fn mark(&mut self) {
        if self.here.place != self.marked {
            self.marked = self.here.place;
            self.index.note(IndexEntry::Mark(self.here));
        }
    }

    /// A record was pushed: what a mark behind it would be. It is made where it is due, and held against that of a run before.
    fn count(&mut self, record: &Record<A>, block: u64) -> Result<(), Cancelled> {
        self.here.place = self.ring.write();
        (self.here.line, self.here.block) = (record.line, block);
        for (count, &increment) in self.here.counts.iter_mut().zip(&record.increments) {
            *count += i64::from(increment);
        }
        if self.here.place.wrapping_sub(self.marked) >= RECORDS_A_MARK {
            self.mark();
        }
        while let Some(&was) = self.was.front()
            && !retrace_core::place::is_before(self.here.place, was.place)
        {
            self.was.pop_front();
            if was != self.here {
                self.send(PathItem::Differs(Box::new(MarkDifference { was, is: self.here })))?;
            } else if self.was.is_empty() {
                self.send(PathItem::MarksPassed)?;
            }
        }
        Ok(())
    }

    /// Sends the modal state that is in force from the move with that serial number on, if it is another one than before.
    fn send_active(&mut self, serial: u32) -> Result<(), Cancelled> {
        let mut last = None;
        while let Some((of, _)) = self.modes.front()
            && !retrace_core::place::is_before(serial, *of)
        {
            last = self.modes.pop_front();
        }
        let place = self.ring.write();
        last.map_or(Ok(()), |(_, active)| self.send(PathItem::Active { place, active }))
    }

    /// Sends the actions that stand before the move with that serial number, or before one that left no record.
    fn send_actions(&mut self, serial: u32) -> Result<(), Cancelled> {
        while let Some(WaitingChange { serial: of, change, line, lasts }) = self.waiting.front().copied()
            && !retrace_core::place::is_before(serial, of)
        {
            self.waiting.pop_front();
            let value = &mut self.outputs[usize::from(change.channel)];
            let (place, channel) = (self.ring.write(), change.channel);
            let before = if lasts { change.value } else { *value };
            let action = OutputAction { place, channel, before, after: change.value };
            *value = change.value;
            self.send(PathItem::Action(action, line))?;
        }
        Ok(())
    }

    /// Sends an item. Where it has to wait, what is planned is marked: the motion path comes to where it takes items only over that.
    fn send(&mut self, item: PathItem) -> Result<(), Cancelled> {
        let mut waits = Some(item);
        self.patiently(|feeder| match feeder.items.try_send(waits.take()?) {
            Ok(()) => Some(Ok(())),
            Err(TrySendError::Full(back)) => {
                feeder.mark();
                waits = Some(back);
                None
            }
            Err(TrySendError::Disconnected(_)) => Some(Err(Cancelled)),
        })
    }

    fn push(&mut self, record: Record<A>, block: u64) -> Result<(), Cancelled> {
        self.patiently(|feeder| feeder.ring.push(record).is_ok().then_some(Ok(())))?;
        self.count(&record, block)
    }

    /// Tries until it succeeds: first at once, then with longer and longer pauses, and gives up when told to.
    fn patiently(
        &mut self,
        mut attempt: impl FnMut(&mut Self) -> Option<Result<(), Cancelled>>,
    ) -> Result<(), Cancelled> {
        for tries in 0u32.. {
            if let Some(result) = attempt(self) {
                return result;
            }
            match tries {
                0..50 => std::hint::spin_loop(),
                50..100 => thread::yield_now(),
                _ if self.cancel.load(Ordering::Relaxed) => break,
                100..400 => thread::sleep(Duration::from_micros(50)),
                _ => {
                    self.take_length()?;
                    thread::sleep(Duration::from_micros(500));
                }
            }
        }
        Err(Cancelled)
    }
}
