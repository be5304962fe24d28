//! The plan writer: receives moves, switching and stops, writes records into the ring and sends items to the motion
//! path.
//!
//! Invariant: an item's place is the number of the record before which it is executed, and it is sent before that
//! record.

mod marks;
mod planned_override;
mod probing;
mod threads;
mod tool_lengths;
mod waiting_actions;
mod write_error;

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::thread;
use std::time::Duration;

use retrace_config::MachineConfig;
use retrace_core::place::number_is_before;
use retrace_core::ring::Producer;
use retrace_core::{Flags, Record, RecordIndex};
use retrace_gcode::ActiveCodes;
use retrace_journal::{IndexEntry, IndexWriter, LengthChange, PlaceMark};
use retrace_link::{InputWait, LayerMove, MAX_CHANGES, OutputAction, OutputChange, Outputs, SpindleTask, channel};
use retrace_motion::{Arc, FeedRate, PathMode, Planner};

use crate::overrides::OverrideApplier;
use crate::plan_item::{ExclusiveInstruction, ExclusiveKind, HEIGHT, PathItem, PlanSummary};
use crate::question::Question;
use crate::soft_limits::{LimitFinding, extremes};
use crate::thread_plan::ThreadPlanner;
use crate::tool_length::LengthOffers;
use planned_override::PlannedOverride;
use probing::Answers;
use tool_lengths::{Lengths, Planned};
use waiting_actions::InnerActions;
pub use write_error::{Cancelled, PlanWriteError};

/// An exclusive instruction of the program, at the place where the motion is now.
#[derive(Clone, Copy, Debug, Default)]
pub struct SwitchInstruction<'c> {
    /// Program line.
    pub line: u32,
    /// Kind of instruction.
    pub kind: ExclusiveKind,
    /// Code as it is written in the program.
    pub code: &'static str,
    /// The outputs it switches, at most [`MAX_CHANGES`].
    pub changes: &'c [OutputChange],
    /// Minimum duration in control periods.
    pub periods: u32,
    /// Input that it waits for in addition.
    pub until: Option<InputWait>,
    /// Moves of the layer before and behind the switching.
    pub layer: Option<LayerMove>,
    /// Those of a restart, where they differ.
    pub restart_layer: Option<LayerMove>,
    /// Control periods by which the pierce of a restart is longer.
    pub restart_pierce: u32,
    /// Width in µm of the kerf that it begins.
    pub kerf_um: Option<u32>,
    /// Whether it is a retrace barrier.
    pub is_barrier: bool,
    /// Whether its outputs are set back where reverse run passes it and outputs are replayed.
    pub undone_in_reverse: bool,
    /// The question, of [`ExclusiveKind::OffPath`] and [`ExclusiveKind::Input`].
    pub question: Option<Question>,
    /// What it waits for at the spindle.
    pub spindle: Option<SpindleTask>,
}

/// An output change that waits for a move.
#[derive(Clone, Copy, Debug)]
struct WaitingChange {
    /// Serial number of the move.
    serial: u32,
    change: OutputChange,
    line: u32,
    /// Whether reverse run leaves it unchanged.
    unchanged_in_reverse: bool,
}

/// Maximum number of records between two marks. After a full ring, as many are written together, so that marks are no
/// more frequent while the ring stays full.
const MAX_RECORDS_PER_MARK: u32 = 64;

/// Number of records that are published together: those of two cache lines and more.
const RECORDS_PER_PUBLICATION: u32 = 8;

/// Pause between two attempts to write while there is no room: a small part of the least look-ahead.
const ROOM_PAUSE: Duration = Duration::from_millis(1);

/// The same in virtual time, where the motion makes room as fast as it can.
const ROOM_PAUSE_VIRTUAL: Duration = Duration::from_micros(50);

/// Time without room after which a proposed tool length is answered.
const PROPOSAL_DELAY: Duration = Duration::from_millis(15);

/// Origin of a move that may still come out of the planner.
#[derive(Clone, Copy, Debug)]
struct SerialOrigin {
    serial: u32,
    line: u32,
    block: u64,
    /// Least and greatest coordinate of the tool axis during the move, mm.
    reach_mm: [f64; 2],
    /// Whether its feed follows the measured speed of the spindle.
    is_per_turn: bool,
}

/// Plans a program into a ring.
pub struct PlanWriter<'r, const A: usize> {
    planner: Planner<A>,
    thread_planner: ThreadPlanner<A>,
    ring: Producer<'r, Record<A>>,
    items: SyncSender<PathItem>,
    cancel: &'r AtomicBool,
    /// Pause between two attempts to write where the motion has to make room first.
    room_pause: Duration,
    /// Overrides above 100 %.
    overrides: OverrideApplier,
    planned_override: PlannedOverride,
    /// The machine whose soft limits no move may leave. None where limits are not checked.
    machine: Option<&'r MachineConfig>,
    lengths: Lengths,
    answers: Answers,
    /// Channels that a dry run keeps off (CUT-8); none otherwise.
    inhibited: Vec<u8>,
    /// Whether what is inhibited takes its time all the same.
    dry_waits: bool,
    /// Serial number of the last move given to the planner, and its tag.
    serial: u32,
    /// Block of the moves to come.
    block: u64,
    /// Whether the feed of the moves to come follows the measured speed of the spindle.
    is_per_turn: bool,
    /// Line and block of each move that may still come out of the planner, by serial number.
    origins: VecDeque<SerialOrigin>,
    /// Output changes that wait for the first record of the move with their serial number.
    waiting_changes: VecDeque<WaitingChange>,
    /// Actions within the next move.
    inner_actions: InnerActions,
    /// Heights over the sheet that wait for their places, in the order of these, and their lines.
    heights: VecDeque<(RecordIndex, i32, u32)>,
    /// Modal states that wait for the first record of the move with that serial number.
    modes: VecDeque<(u32, Box<ActiveCodes>)>,
    /// Outputs as the program has set them, pending changes included.
    outputs: Outputs,
    index: Box<dyn IndexWriter>,
    /// Place of the last mark.
    marked_until: RecordIndex,
    /// The mark that would be made behind the last record.
    next_mark: PlaceMark,
    /// Marks of an earlier run, with which the plan is compared.
    expected_marks: VecDeque<PlaceMark>,
}

impl<'r, const A: usize> PlanWriter<'r, A> {
    /// Creates a plan writer that plans with `planner` into `ring`; outputs begin as given. `cancel` makes it stop.
    #[must_use]
    pub fn new(
        planner: Planner<A>,
        ring: Producer<'r, Record<A>>,
        items: SyncSender<PathItem>,
        outputs: Outputs,
        cancel: &'r AtomicBool,
    ) -> Self {
        let marked_until = ring.write();
        Self {
            planner,
            thread_planner: ThreadPlanner::default(),
            ring,
            items,
            cancel,
            room_pause: ROOM_PAUSE_VIRTUAL,
            overrides: OverrideApplier::default(),
            planned_override: PlannedOverride::default(),
            machine: None,
            lengths: Lengths::default(),
            answers: Answers::default(),
            inhibited: Vec::new(),
            dry_waits: false,
            serial: 0,
            block: 0,
            is_per_turn: false,
            origins: VecDeque::new(),
            waiting_changes: VecDeque::new(),
            inner_actions: InnerActions::default(),
            heights: VecDeque::new(),
            modes: VecDeque::new(),
            outputs,
            index: Box::new(()),
            marked_until,
            next_mark: PlaceMark { place: marked_until, ..PlaceMark::default() },
            expected_marks: VecDeque::new(),
        }
    }

    /// Writes an index of the plan to `index`. `counts` are the machine's counts where the ring begins.
    #[must_use]
    pub fn with_index(mut self, index: Box<dyn IndexWriter>, counts: &[i64]) -> Self {
        for (slot, &count) in self.next_mark.counts.iter_mut().zip(counts) {
            *slot = count;
        }
        Self { index, ..self }
    }

    /// Compares the plan with the marks of an earlier run, in the order of their places.
    #[must_use]
    pub fn with_expected_marks(self, marks: &[PlaceMark]) -> Self {
        let begins = self.next_mark.place;
        let behind = |mark: &&PlaceMark| begins.is_before(mark.place);
        Self { expected_marks: marks.iter().filter(behind).copied().collect(), ..self }
    }

    /// Sets whether the motion takes as long as a clock: the planner is then far ahead of it, and attempts to write are
    /// a millisecond apart, so that a full look-ahead costs next to no processor time.
    #[must_use]
    pub fn with_wall_time(self, is_wall_time: bool) -> Self {
        Self { room_pause: if is_wall_time { ROOM_PAUSE } else { ROOM_PAUSE_VIRTUAL }, ..self }
    }

    /// Enables planned overrides above 100 %.
    #[must_use]
    pub fn with_overrides(self, overrides: OverrideApplier) -> Self {
        Self { overrides, ..self }
    }

    /// Never switches these channels: a dry run.
    #[must_use]
    pub fn with_inhibited(self, inhibited: Vec<u8>, dry_waits: bool) -> Self {
        Self { inhibited, dry_waits, ..self }
    }

    /// Rejects every move that leaves the soft limits of this machine.
    #[must_use]
    pub fn with_limits(self, machine: &'r MachineConfig) -> Self {
        Self { machine: Some(machine), ..self }
    }

    /// Enables the entry of tool lengths. `again` are those that were entered when the job ran before, in the order of
    /// the blocks.
    #[must_use]
    pub(crate) fn with_tool_lengths(mut self, offers: LengthOffers, again: &[LengthChange]) -> Self {
        self.lengths.offers = Some(offers);
        self.lengths.replayed_changes = again.iter().copied().collect();
        self
    }

    /// End of the last move, mm.
    #[must_use]
    pub fn commanded_mm(&self) -> [f64; A] {
        self.planner.commanded_mm()
    }

    /// Outputs as the program has set them.
    #[must_use]
    pub fn outputs(&self) -> &Outputs {
        &self.outputs
    }

    /// Sets the decoder's block number of the moves to come.
    pub fn begin_block(&mut self, number: u64) {
        self.block = number;
        while let Some(&LengthChange { block, pulses }) = self.lengths.replayed_changes.front()
            && block < number
        {
            self.lengths.replayed_changes.pop_front();
            self.lengths.moved_by += pulses;
        }
    }

    /// Sets the modal state that is in force from the next move on.
    pub fn set_active_codes(&mut self, active: Box<ActiveCodes>) {
        self.modes.push_back((self.serial.wrapping_add(1), active));
    }

    /// Marks what is planned so that it can be executed, when nothing is to be planned for now.
    ///
    /// # Errors
    /// [`Cancelled`] where waiting is of no use.
    pub fn mark_planned(&mut self) -> Result<(), Cancelled> {
        self.write_mark();
        self.answer_proposal()?;
        if self.cancel.load(Ordering::Relaxed) { Err(Cancelled) } else { Ok(()) }
    }

    /// Plans a straight move of program line `line`.
    ///
    /// # Errors
    /// The reason why it is rejected; nothing has changed then.
    pub fn straight(
        &mut self,
        end_mm: [f64; A],
        feed: FeedRate,
        mode: PathMode,
        line: u32,
    ) -> Result<(), PlanWriteError> {
        let inner = std::mem::take(&mut self.inner_actions);
        let reach_mm = self.check_limits(&[end_mm], line)?;
        let serial = self.serial.wrapping_add(1);
        self.planner.marked_line(end_mm, feed, mode, serial, &inner.marks(serial))?;
        let is_per_turn = self.is_per_turn && !matches!(feed, FeedRate::Rapid);
        Ok(self.record_move(line, reach_mm, is_per_turn, &inner)?)
    }

    /// Plans an arc or helix of program line `line`.
    ///
    /// # Errors
    /// The reason why it is rejected; nothing has changed then.
    pub fn arc(&mut self, arc: &Arc<A>, feed: FeedRate, mode: PathMode, line: u32) -> Result<(), PlanWriteError> {
        let inner = std::mem::take(&mut self.inner_actions);
        let mut points = extremes(&self.planner.commanded_mm(), arc);
        points.push(arc.end_mm);
        let reach_mm = self.check_limits(&points, line)?;
        let serial = self.serial.wrapping_add(1);
        self.planner.marked_arc(arc, feed, mode, serial, &inner.marks(serial))?;
        Ok(self.record_move(line, reach_mm, self.is_per_turn, &inner)?)
    }

    fn record_move(
        &mut self,
        line: u32,
        reach_mm: [f64; 2],
        is_per_turn: bool,
        inner: &InnerActions,
    ) -> Result<(), Cancelled> {
        self.serial = self.serial.wrapping_add(1);
        self.origins.push_back(SerialOrigin { serial: self.serial, line, block: self.block, reach_mm, is_per_turn });
        self.record_inner_actions(inner);
        self.drain()
    }

    /// Rejects a move through these points that would leave the soft limits of an axis that it moves. Returns the
    /// move's range along the tool axis.
    fn check_limits(&self, points: &[[f64; A]], line: u32) -> Result<[f64; 2], PlanWriteError> {
        let Some(machine) = self.machine else { return Ok([0.0; 2]) };
        let tool = machine.tool_axis().filter(|&tool| tool < A);
        let from = self.planner.commanded_mm();
        let further = tool.map_or(0.0, |tool| machine.axes[tool].mm_of(self.lengths.moved_by));
        let mut reach_mm = tool.map_or([0.0; 2], |tool| [from[tool]; 2]);
        for point in points {
            if let Some(tool) = tool {
                reach_mm = [reach_mm[0].min(point[tool]), reach_mm[1].max(point[tool])];
            }
            let mut really = *point;
            if let Some(tool) = tool {
                really[tool] += further;
            }
            if let Some(beyond) =
                LimitFinding::find(machine, &really, |axis| axis < A && point[axis] != from[axis], line)
            {
                return Err(PlanWriteError::BeyondLimit(beyond));
            }
        }
        Ok(reach_mm)
    }

    /// Adds a height over the sheet for the cut that an exclusive instruction here has begun: the tool goes there
    /// beside the motion, `periods` records behind this place.
    pub fn height(&mut self, height: i32, periods: u32, line: u32) {
        self.heights.push_back((self.ring.write() + periods, height, line));
    }

    /// Adds an exclusive instruction: the motion comes to rest here, also under G64.
    ///
    /// # Errors
    /// [`Cancelled`]
    pub fn exclusive(&mut self, switch: SwitchInstruction<'_>) -> Result<(), Cancelled> {
        self.rest()?;
        let (mut changes, mut count) = ([OutputChange::default(); MAX_CHANGES], 0);
        let allowed = switch.changes.iter().filter(|change| !self.inhibited.contains(&change.channel));
        for (slot, change) in changes.iter_mut().zip(allowed) {
            *slot = *change;
            count += 1;
        }
        // What is inhibited in a dry run reports nothing, and takes no time unless that is wanted.
        let is_inhibited = count < switch.changes.len();
        let periods = if is_inhibited && !self.dry_waits { 0 } else { switch.periods };
        let until = switch.until.filter(|_| !is_inhibited);
        let before = self.outputs;
        changes[..count].iter().for_each(|change| self.outputs[usize::from(change.channel)] = change.value);
        let SwitchInstruction { line, kind, code, is_barrier, undone_in_reverse: undone, layer, .. } = switch;
        if let ExclusiveKind::FeedOverride { applies } = kind {
            self.switch_override(applies);
        }
        if layer.is_some() {
            self.heights.clear();
        }
        let place = self.ring.write();
        let exclusive = ExclusiveInstruction {
            place,
            line,
            kind,
            code,
            changes,
            count: count as u8,
            periods,
            until,
            layer,
            restart_layer: switch.restart_layer,
            restart_pierce: switch.restart_pierce,
            kerf_um: switch.kerf_um,
            is_barrier,
            question: switch.question.map(Box::new),
            spindle: switch.spindle,
        };
        self.send(PathItem::Exclusive(exclusive))?;
        // As an action of the record behind it, it is undone and redone like any other.
        for &OutputChange { channel, value } in changes[..count].iter().filter(|_| undone) {
            let action = OutputAction { place, channel, before: before[usize::from(channel)], after: value };
            self.send(PathItem::Action(action, 0))?;
        }
        Ok(())
    }

    /// Adds a message, shown when the motion reaches this place.
    ///
    /// # Errors
    /// [`Cancelled`]
    pub fn message(&mut self, text: String, line: u32) -> Result<(), Cancelled> {
        let place = self.ring.write();
        self.send(PathItem::Message { place, line, text })
    }

    /// Brings the motion to rest here. Actions without a move to go with are executed at the stop.
    ///
    /// # Errors
    /// [`Cancelled`]
    pub fn rest(&mut self) -> Result<(), Cancelled> {
        self.planner.stop(Flags::NONE);
        self.drain()?;
        self.origins.clear();
        self.send_active(self.serial.wrapping_add(1))?;
        while let Some(WaitingChange { change, line, unchanged_in_reverse: lasts, .. }) =
            self.waiting_changes.pop_front()
        {
            let code = if change.channel == channel::HEIGHT_HOLD { HEIGHT } else { "M62–M65" };
            let changes = [change];
            self.exclusive(SwitchInstruction {
                line,
                code,
                changes: &changes,
                undone_in_reverse: !lasts,
                ..SwitchInstruction::default()
            })?;
        }
        Ok(())
    }

    /// Records that the program ends early behind that block: the path must rest there also when it is planned again.
    pub fn record_early_end(&mut self, block: u64) {
        self.index.write(IndexEntry::Rest { block });
    }

    /// Ends the program.
    ///
    /// # Errors
    /// [`Cancelled`]
    pub fn end(&mut self, summary: PlanSummary) -> Result<(), Cancelled> {
        self.rest()?;
        self.write_mark();
        self.send(PathItem::End(summary))
    }

    /// Waits with pauses until there is a value. Stops when cancelled.
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

    /// Moves what the planner has into the ring. A record leaves the planner only when the ring has space for it, so
    /// that an override can still be applied at the first place that the ring has no space for.
    fn drain(&mut self) -> Result<(), Cancelled> {
        loop {
            if !self.ring.has_room() {
                self.write_mark();
                // A consumer may wait for the last of the marks, and release no record before it has it.
                let wanted = if self.expected_marks.is_empty() { MAX_RECORDS_PER_MARK } else { 1 };
                self.retry(|feeder| (feeder.ring.slots() >= wanted).then_some(Ok(())))?;
            }
            self.apply_due_override();
            let Some(record) = self.planner.next_record() else {
                self.ring.publish();
                return Ok(());
            };
            let serial = record.line;
            self.send_active(serial)?;
            self.send_actions(serial)?;
            self.send_heights()?;
            if let Some(Planned::Waiting { serial: end }) = self.lengths.last_end
                && number_is_before(end, serial)
            {
                self.lengths.last_end = Some(Planned::Until(self.ring.write()));
            }
            let origin = self.origin_of(serial);
            let flags = if origin.is_per_turn { record.flags.with(Flags::PER_TURN) } else { record.flags };
            self.push(Record { line: origin.line, flags, ..record }, origin.block)?;
        }
    }

    /// Origin of the move with that serial number. Moves before it will not come out of the planner again.
    fn origin_of(&mut self, serial: u32) -> SerialOrigin {
        while self.origins.len() > 1 && self.origins.front().is_some_and(|o| number_is_before(o.serial, serial)) {
            self.origins.pop_front();
        }
        let unknown = SerialOrigin { serial, line: 0, block: 0, reach_mm: [0.0; 2], is_per_turn: false };
        self.origins.front().copied().unwrap_or(unknown)
    }

    /// Sends the modal state that is in force from the move with that serial number on, if it differs from the one
    /// before.
    fn send_active(&mut self, serial: u32) -> Result<(), Cancelled> {
        let mut last = None;
        while let Some((of, _)) = self.modes.front()
            && !number_is_before(serial, *of)
        {
            last = self.modes.pop_front();
        }
        let place = self.ring.write();
        last.map_or(Ok(()), |(_, active)| self.send(PathItem::Active { place, active }))
    }

    /// Sends the heights whose place is that of the next record.
    fn send_heights(&mut self) -> Result<(), Cancelled> {
        let place = self.ring.write();
        while let Some(&(at, after, line)) = self.heights.front()
            && !place.is_before(at)
        {
            self.heights.pop_front();
            let action = OutputAction { place, channel: channel::HEIGHT, before: after, after };
            self.send(PathItem::Action(action, line))?;
        }
        Ok(())
    }

    /// Sends an item. Where it has to wait, what is planned is marked first: only then does the motion path reach the
    /// place where it receives items.
    fn send(&mut self, item: PathItem) -> Result<(), Cancelled> {
        let mut waits = Some(item);
        self.retry(|feeder| match feeder.items.try_send(waits.take()?) {
            Ok(()) => Some(Ok(())),
            Err(TrySendError::Full(back)) => {
                feeder.write_mark();
                waits = Some(back);
                None
            }
            Err(TrySendError::Disconnected(_)) => Some(Err(Cancelled)),
        })
    }

    fn push(&mut self, record: Record<A>, block: u64) -> Result<(), Cancelled> {
        self.retry(|feeder| feeder.ring.stage(record).is_ok().then_some(Ok(())))?;
        if self.ring.write().number().is_multiple_of(RECORDS_PER_PUBLICATION) {
            self.ring.publish();
        }
        self.update_mark(&record, block)
    }

    /// Retries until it succeeds: first immediately, then with longer and longer pauses. Stops when cancelled. What was
    /// staged is published before the first of them: the motion path may need it to go on.
    fn retry(&mut self, mut attempt: impl FnMut(&mut Self) -> Option<Result<(), Cancelled>>) -> Result<(), Cancelled> {
        let mut paused = Duration::ZERO;
        // Up to the place where a resumed job was left, the motion path takes records as fast as they are planned.
        let pause = if self.expected_marks.is_empty() { self.room_pause } else { ROOM_PAUSE_VIRTUAL };
        for tries in 0u32.. {
            if let Some(result) = attempt(self) {
                return result;
            }
            match tries {
                0 => self.ring.publish(),
                1..50 => std::hint::spin_loop(),
                50..100 => thread::yield_now(),
                _ if self.cancel.load(Ordering::Relaxed) => break,
                _ if paused < PROPOSAL_DELAY => {
                    paused += pause;
                    thread::sleep(pause);
                }
                _ => {
                    self.answer_proposal()?;
                    thread::sleep(pause.max(Duration::from_micros(500)));
                }
            }
        }
        Err(Cancelled)
    }
}
