//! The record streamer: slides the card's window along the ring in both directions, as far as the gates and the mode
//! allow (design, idea 3).
//!
//! Invariant: no record beyond the end of the send horizon is ever sent: not behind an exclusive marker whose
//! instruction is not acknowledged, not beyond `reached` while retracing, not before a retrace barrier, not beyond the
//! durable place of the index. Nothing here allocates after the start: the number of items is bounded, and when it is
//! reached the rest remains in the channel.

mod action_room;
mod block_window;
mod dark_changes;
mod lead_in;
mod override_switches;
mod replay;
mod retrace_barrier;
mod returning;
mod setup;

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, TryRecvError};

use retrace_core::gate::Gates;
use retrace_core::ring::Consumer;
use retrace_core::{Distance, Flags, Place, Record, RecordIndex};
use retrace_gcode::ActiveCodes;
use retrace_journal::{DurablePlace, MarkDifference};
use retrace_link::{CardStatus, HostCommand, MAX_CHANGES, MotionCard, OutputAction, Outputs};

use crate::plan_item::{ExclusiveInstruction, ExclusiveKind, PathItem, PlanSummary};
use crate::restart::{OutputOrigins, RestartStep};
use block_window::BlockWindow;
pub(crate) use lead_in::{LeadIn, LeadInEnd, LeadInMove};
use override_switches::OverrideSwitches;
pub(crate) use override_switches::SpeedShare;
use retrace_barrier::RetraceBarriers;

/// How far ahead records may be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SendHorizon {
    /// To the end of what is planned: normal run.
    LookAhead,
    /// To this place, the furthest one that may be retraced to.
    Until(RecordIndex),
}

/// Capacity for exclusive instructions.
const MAX_EXCLUSIVES: usize = 64;
/// Capacity for output actions. When it is full, the oldest that were passed are discarded.
const MAX_ACTIONS: usize = 1 << 16;
/// Capacity for messages.
const MAX_MESSAGES: usize = 1024;
/// Capacity for modal states.
const MAX_MODES: usize = 1024;
/// Capacity for places where a cutting output was switched on.
const MAX_PIERCES: usize = 4096;
/// Capacity for instructions that were executed.
const MAX_DONE: usize = 4096;

/// The consumer's side of planning: the ring, the items, and the part of them that the card holds.
#[derive(Debug)]
pub struct RecordStreamer<'r, const A: usize> {
    ring: Consumer<'r, Record<A>>,
    items: Receiver<PathItem>,
    start: RecordIndex,
    /// Instructions to come. The first one is pending in the gates, if any is.
    exclusives: VecDeque<ExclusiveInstruction>,
    gates: Gates,
    next_number: u32,
    /// Output actions of the retained records, in path order, each with its program line.
    actions: VecDeque<(OutputAction, u32)>,
    /// Number of `actions` that are behind `reached`.
    passed: usize,
    messages: VecDeque<(RecordIndex, u32, String)>,
    /// Modal states, each with the place from which it is in force.
    modes: VecDeque<(RecordIndex, Box<ActiveCodes>)>,
    summary: Option<PlanSummary>,
    /// The planner has ended without an end of the program: a defect in the planning thread.
    planner_gone: bool,
    /// Place up to which all items are received.
    items_known_until: RecordIndex,
    /// Whether no more items can be received for now.
    item_queue_full: bool,
    durable_place: Option<DurablePlace>,
    /// Actions before this place are not retained any more.
    actions_retained_from: Option<RecordIndex>,
    /// Places where the program switched a cutting output on, in path order.
    pierces: VecDeque<RecordIndex>,
    /// Places where the program switched a cutting output on or off, in path order.
    cut_changes: VecDeque<RecordIndex>,
    /// Places where an instruction of a cutter was executed with the cutter off.
    dark_changes: Vec<RecordIndex>,
    override_switches: OverrideSwitches,
    fire_channels: Vec<u8>,
    /// With the abrasives that are switched with a jet.
    cutter_channels: Vec<u8>,
    /// Those whose contours are one step of single block.
    contour_channels: Vec<u8>,
    last_fired_channel: Option<u8>,
    /// Result of comparing the marks of an earlier run: all passed, or the first that differs.
    marks: Option<Result<(), Box<MarkDifference>>>,
    /// The retrace barriers: nothing before the last one can be reversed to.
    barriers: RetraceBarriers,
    /// Outputs that the program expects at `reached`.
    expected: Outputs,
    /// The instructions that have switched them.
    origins: OutputOrigins,
    /// Single block: the search for the end of the block.
    block_window: Option<BlockWindow>,
    /// Furthest place executed, as the card counts it: before the ring's after a return to an earlier place.
    reached: RecordIndex,
    /// Instructions that were executed, in path order, each with the expected values of its channels before it.
    done: VecDeque<(ExclusiveInstruction, [i32; MAX_CHANGES])>,
    /// No return to a place before this one: the instructions there are not retained any more.
    done_retained_from: Option<RecordIndex>,
    /// The lead-in, from its beginning until the card has forgotten its records.
    lead_in: Option<LeadIn<A>>,
}

impl<'r, const A: usize> RecordStreamer<'r, A> {
    /// Creates a streamer for a ring that begins at `start`, with these outputs, and with `executed` as the last
    /// instruction before it.
    #[must_use]
    pub fn new(
        ring: Consumer<'r, Record<A>>,
        items: Receiver<PathItem>,
        start: RecordIndex,
        outputs: Outputs,
        executed: u32,
    ) -> Self {
        Self {
            ring,
            items,
            start,
            exclusives: VecDeque::with_capacity(MAX_EXCLUSIVES + MAX_DONE),
            gates: Gates::default(),
            next_number: executed.wrapping_add(1),
            actions: VecDeque::with_capacity(MAX_ACTIONS),
            passed: 0,
            messages: VecDeque::with_capacity(MAX_MESSAGES),
            modes: VecDeque::with_capacity(MAX_MODES),
            summary: None,
            planner_gone: false,
            items_known_until: start,
            item_queue_full: false,
            durable_place: None,
            actions_retained_from: None,
            pierces: VecDeque::with_capacity(MAX_PIERCES),
            cut_changes: VecDeque::with_capacity(MAX_PIERCES),
            dark_changes: Vec::new(),
            override_switches: OverrideSwitches::new(),
            fire_channels: Vec::new(),
            cutter_channels: Vec::new(),
            contour_channels: Vec::new(),
            last_fired_channel: None,
            marks: None,
            barriers: RetraceBarriers::default(),
            expected: outputs,
            origins: OutputOrigins::default(),
            block_window: None,
            reached: start,
            done: VecDeque::with_capacity(MAX_DONE),
            done_retained_from: None,
            lead_in: None,
        }
    }

    /// Receives what has been planned. `write` is read before the items: an item is sent before the records behind it.
    ///
    /// Where there is no space for more items, the rest remain in the channel, and so do the records behind the last
    /// item received.
    pub fn poll_planner(&mut self) {
        let write = self.ring.write();
        self.item_queue_full = false;
        let mut last = self.items_known_until;
        loop {
            self.discard_oldest_action();
            if self.is_full() {
                (self.item_queue_full, self.items_known_until) = (true, last);
                break;
            }
            match self.items.try_recv() {
                Ok(item) => last = self.receive_item(item).unwrap_or(last),
                Err(error) => {
                    self.items_known_until = write;
                    self.planner_gone = error == TryRecvError::Disconnected && self.summary.is_none();
                    break;
                }
            }
        }
        if self.gates.a_open()
            && let Some(next) = self.exclusives.front()
        {
            self.gates.accept(self.next_number, next.place);
        }
    }

    /// Stores an item. Returns its place.
    fn receive_item(&mut self, item: PathItem) -> Option<RecordIndex> {
        match item {
            PathItem::Exclusive(exclusive) => {
                let place = exclusive.place;
                self.exclusives.push_back(exclusive);
                Some(place)
            }
            PathItem::Action(action, line) => {
                self.actions.push_back((action, line));
                Some(action.place)
            }
            PathItem::Message { place, line, text } => {
                self.messages.push_back((place, line, text));
                Some(place)
            }
            PathItem::Active { place, active } => {
                self.modes.push_back((place, active));
                Some(place)
            }
            PathItem::Differs(difference) => {
                self.marks.get_or_insert(Err(difference));
                None
            }
            PathItem::MarksPassed => {
                self.marks.get_or_insert(Ok(()));
                None
            }
            PathItem::End(summary) => {
                self.summary = Some(summary);
                None
            }
        }
    }

    /// Discards the oldest action where there is no space for another: what is before it cannot be reversed to any
    /// more.
    fn discard_oldest_action(&mut self) {
        if self.actions.len() == MAX_ACTIONS && self.passed > 0 {
            self.actions_retained_from = self.actions.pop_front().map(|(action, _)| action.place + 1);
            self.passed -= 1;
        }
    }

    fn is_full(&self) -> bool {
        self.exclusives.len() >= MAX_EXCLUSIVES
            || self.actions.len() == MAX_ACTIONS
            || self.messages.len() == MAX_MESSAGES
            || self.modes.len() == MAX_MODES
    }

    /// Place up to which records may be sent: all their items are received, and they are durable in the index.
    fn safe_to_send_until(&self) -> RecordIndex {
        match &self.durable_place {
            Some(durable) if durable.place().is_before(self.items_known_until) => durable.place(),
            _ => self.items_known_until,
        }
    }

    /// Whether everything up to `place` is planned, received and durable.
    pub(crate) fn is_sure_until(&self, place: RecordIndex) -> bool {
        !self.safe_to_send_until().is_before(place)
    }

    /// Whether the plan has ended, and nothing of it up to `place` is still to come: it does not reach that place, or
    /// everything up to there is received and durable.
    pub(crate) fn has_ended_at(&mut self, place: RecordIndex) -> bool {
        let has_ended = self.planner_gone || self.summary.is_some();
        has_ended && (self.ring.write().is_before(place) || self.is_sure_until(place))
    }

    /// Whether enough is planned that the rate does not depend on the planner's speed. `enough`: records ahead.
    #[must_use]
    pub fn has_lookahead(&mut self, status: &CardStatus<A>, enough: u32) -> bool {
        let sure = self.safe_to_send_until();
        sure.since(status.place.record) >= enough
            || self.exclusives.front().is_some_and(|next| !sure.is_before(next.place))
            || self.item_queue_full && sure == self.items_known_until
            || self.summary.is_some() && sure == self.ring.write()
            || self.planner_gone
    }

    /// Whether the planner has ended without an end of the program.
    #[must_use]
    pub fn planner_is_gone(&self) -> bool {
        self.planner_gone
    }

    /// Result of comparing the marks of an earlier run, once it is known: all passed, or the first that differs.
    #[must_use]
    pub fn marks(&self) -> Option<&Result<(), Box<MarkDifference>>> {
        self.marks.as_ref()
    }

    /// Place up to which everything that is planned is received.
    #[must_use]
    pub fn items_complete_until(&self) -> RecordIndex {
        self.items_known_until
    }

    /// Place of the next exclusive instruction, if one is known.
    #[must_use]
    pub fn next_exclusive(&self) -> Option<RecordIndex> {
        self.exclusives.front().map(|next| next.place)
    }

    /// The record at `place`, if it is retained or planned.
    #[must_use]
    pub fn record(&self, place: RecordIndex) -> Option<Record<A>> {
        self.ring.record(place)
    }

    /// Summary of the plan, once the end of the program is known.
    #[must_use]
    pub fn summary(&self) -> Option<&PlanSummary> {
        self.summary.as_ref()
    }

    /// Whether everything has been executed for the first time.
    pub fn all_executed(&mut self, status: &CardStatus<A>) -> bool {
        self.summary.is_some() && self.exclusives.is_empty() && status.reached == self.ring.write()
    }

    /// Oldest place that reverse run can reach.
    #[must_use]
    pub fn oldest(&self) -> RecordIndex {
        // Backward from the path, the recorded path is retraced, and not the lead-in.
        let join = self.lead_in.as_ref().map(LeadIn::join);
        join.into_iter().fold(self.oldest_recorded(), RecordIndex::later)
    }

    /// Oldest place of the recorded path that reverse run can reach.
    pub(crate) fn oldest_recorded(&self) -> RecordIndex {
        let one_way = self.barriers.last().map(|(place, _)| place);
        [one_way, self.actions_retained_from].into_iter().flatten().fold(self.ring.head(), RecordIndex::later)
    }

    /// The last place at or before `place` where the program switched a cutting output on, if that is retained.
    #[must_use]
    pub fn pierce_before(&self, place: Place) -> Option<RecordIndex> {
        let jet = self.pierces.iter().rev().find(|&&jet| Place::start_of(jet).distance_to(place) >= Distance::ZERO);
        jet.copied().filter(|&jet| !jet.is_before(self.oldest_recorded()))
    }

    /// Sets an output that the program expects, at `place`.
    fn expect(&mut self, place: RecordIndex, channel: u8, value: i32) {
        // A height over the sheet is no output.
        let Some(expected) = self.expected.get_mut(usize::from(channel)) else { return };
        if (*expected == 0) != (value == 0) && self.fire_channels.contains(&channel) {
            if self.cut_changes.len() == MAX_PIERCES {
                self.cut_changes.pop_front();
            }
            self.cut_changes.push_back(place);
        }
        if *expected == 0 && value != 0 && self.fire_channels.contains(&channel) {
            self.last_fired_channel = Some(channel);
            if self.pierces.len() == MAX_PIERCES {
                self.pierces.pop_front();
            }
            self.pierces.push_back(place);
        }
        *expected = value;
    }

    /// Outputs that the program expects at `reached`.
    #[must_use]
    pub fn expected(&self) -> &Outputs {
        &self.expected
    }

    /// Code and line of the program that switched this output to such a value last.
    pub(crate) fn origin_of(&self, channel: u8, value: i32) -> (&'static str, u32) {
        self.origins.origin_of(channel, value)
    }

    /// Appends to `steps` the instructions that bring the outputs from `are` to `wants`, for the channels selected by
    /// `concerned`, in the order of their execution.
    pub fn restart_steps(
        &self,
        are: &Outputs,
        wants: &Outputs,
        concerned: impl Fn(u8) -> bool,
        steps: &mut Vec<RestartStep>,
    ) {
        self.origins.plan_restart(are, wants, &self.cutter_channels, concerned, steps);
    }

    /// The last place at or before `place`, other than `passed`, where the program switched a cutting output, if that
    /// is retained.
    #[must_use]
    pub fn cut_change_before(&self, place: Place, passed: Option<RecordIndex>) -> Option<RecordIndex> {
        let behind = |&&change: &&RecordIndex| {
            Place::start_of(change).distance_to(place) >= Distance::ZERO && Some(change) != passed
        };
        self.cut_changes.iter().rev().find(behind).copied()
    }

    /// The cutting channel that the program has lit last, if any.
    #[must_use]
    pub fn last_fired_channel(&self) -> Option<u8> {
        self.last_fired_channel
    }

    /// The pending instruction, if the card is at rest on its place and may receive it now (gate C).
    #[must_use]
    pub fn due_instruction(&self, status: &CardStatus<A>) -> Option<&ExclusiveInstruction> {
        self.exclusives.front().filter(|_| self.gates.c_open(status.place, status.at_rest))
    }

    /// Place where the program switches this cutter off next, as far as that is planned; `None` too where it switches
    /// it on before.
    #[must_use]
    pub fn end_of_cut(&self, channel: u8) -> Option<RecordIndex> {
        let switches = |change: &retrace_link::OutputChange| change.channel == channel;
        let next = self.exclusives.iter().find(|e| e.changes[..usize::from(e.count)].iter().any(switches))?;
        (!next.switches_on(channel)).then_some(next.place)
    }

    /// Returns the instruction that was sent last, while the card executes it.
    #[must_use]
    pub fn sent_instruction(&self) -> Option<&ExclusiveInstruction> {
        self.exclusives.front()
    }

    /// Number of the pending instruction.
    #[must_use]
    pub fn instruction_number(&self) -> u32 {
        self.next_number
    }

    /// Marks the pending instruction as accepted by the card.
    pub fn mark_sent(&mut self) {
        self.gates.mark_sent();
    }

    /// Records that the card has cancelled the pending instruction: it is sent again.
    pub fn mark_cancelled(&mut self) {
        self.gates.mark_cancelled();
    }

    /// Returns the pending instruction if the card has completed it, and opens the gate for the records behind it.
    pub fn acknowledge(&mut self, executed: u32) -> Option<ExclusiveInstruction> {
        self.gates.acknowledge(executed)?;
        self.next_number = self.next_number.wrapping_add(1);
        let done = self.exclusives.pop_front()?;
        let changes = &done.changes[..usize::from(done.count)];
        let before = done.changes.map(|change| self.expected.get(usize::from(change.channel)).copied().unwrap_or(0));
        if self.done.len() == MAX_DONE {
            self.done_retained_from = self.done.pop_front().map(|(oldest, _)| oldest.place + 1);
        }
        self.done.push_back((done.clone(), before));
        for change in changes {
            self.expect(done.place, change.channel, change.value);
        }
        if let ExclusiveKind::FeedOverride { applies } = done.kind {
            self.override_switches.push(done.place, applies);
        } else if done.kind == ExclusiveKind::Dwell {
            self.origins.record_dwell(done.place, done.periods, &self.expected, &self.cutter_channels);
        } else if !changes.is_empty() {
            let takes = (done.periods, done.until, done.restart_layer.or(done.layer));
            self.origins.record_switching(changes, (done.code, done.line, done.place), takes);
            if done.restart_pierce > 0 {
                self.origins.record_dwell(done.place, done.restart_pierce, &self.expected, &self.cutter_channels);
            }
        }
        if done.is_barrier {
            self.set_barrier((done.place, done.code));
        }
        if let Some(next) = self.exclusives.front() {
            self.gates.accept(self.next_number, next.place);
        }
        Some(done)
    }

    /// Whether neither an instruction nor the end of the program is known ahead.
    #[must_use]
    pub fn continues_without_stop(&self) -> bool {
        self.summary.is_none() && self.exclusives.is_empty() && self.block_window.is_none()
    }

    /// Place where the program ends, once everything is planned.
    #[must_use]
    pub fn program_end(&mut self) -> Option<RecordIndex> {
        (self.summary.is_some() && self.items_known_until == self.ring.write()).then_some(self.items_known_until)
    }

    /// Follows the card's cursor and updates history and outputs. [`RecordStreamer::next_passed_item`] returns what the
    /// cursor has passed for the first time.
    pub fn seek(&mut self, status: &CardStatus<A>) {
        // `reached` includes a record that was only begun; it is never beyond `write`, so the ring accepts it.
        self.ring.seek(status.reached);
        self.ring.seek(status.place.record);
        self.reached = status.reached;
        self.discard_old_actions();
    }

    /// Discards the actions before the retained history.
    fn discard_old_actions(&mut self) {
        while self.passed > 0 && self.actions.front().is_some_and(|(a, _)| a.place.is_before(self.ring.head())) {
            self.actions.pop_front();
            self.passed -= 1;
        }
        self.dark_changes.retain(|place| !place.is_before(self.ring.head()));
    }

    /// Next item that the cursor has passed for the first time. An action that undoes an exclusive instruction in
    /// reverse (line 0) is not returned.
    pub fn next_passed_item(&mut self) -> Option<PassedItem> {
        let reached = self.reached;
        while let Some(&(action, line)) = self.actions.get(self.passed)
            && action.place.is_before(reached)
        {
            self.expect(action.place, action.channel, action.after);
            self.passed += 1;
            if line > 0 {
                self.origins.record_action(&action, line);
                return Some(PassedItem::Action(action, line));
            }
        }
        if self.modes.front().is_some_and(|(place, _)| !reached.is_before(*place)) {
            return self.modes.pop_front().map(|(_, active)| PassedItem::Active(active));
        }
        self.messages.front().filter(|(place, ..)| !reached.is_before(*place))?;
        self.messages.pop_front().map(|(_, line, text)| PassedItem::Message(line, text))
    }

    /// Queues a modal state that is in force at the cursor, to be returned as a passed item.
    pub fn requeue_active_codes(&mut self, active: Box<ActiveCodes>) {
        self.modes.push_front((self.ring.reached(), active));
    }

    /// Sends records ahead until the card is full or the horizon is reached.
    pub fn fill_ahead<C: MotionCard<A>>(&mut self, card: &mut C, horizon: SendHorizon) {
        let end = self.send_end(horizon);
        let Some(mut place) = self.fill_lead_in(card, card.status().high) else { return };
        let mut action = self.actions.partition_point(|(a, _)| a.place.is_before(place));
        let sure = self.safe_to_send_until();
        while place.is_before(end) && place.is_before(sure) && self.gates.b_open(place) {
            let Some(record) = self.ring.record(place) else { break };
            while self.actions.get(action).is_some_and(|(next, _)| next.place == place) {
                if !self.send_action_ahead(card, action) {
                    return;
                }
                action += 1;
            }
            if card.send(HostCommand::Ahead { place, record }).is_err() {
                return;
            }
            place += 1;
        }
    }

    /// Sends records behind until the card is full or `oldest` is sent.
    pub fn fill_behind<C: MotionCard<A>>(&mut self, card: &mut C, oldest: RecordIndex) {
        let mut place = card.status().low;
        let mut action = self.actions.partition_point(|(a, _)| a.place.is_before(place));
        while oldest.is_before(place) {
            let n = place - 1;
            let Some(record) = self.ring.record(n) else { break };
            let rests = self.is_at_rest_before(n);
            while action > 0 && self.actions[action - 1].0.place == n {
                if !self.send_action_behind(card, action - 1) {
                    return;
                }
                action -= 1;
            }
            if card.send(HostCommand::Behind { place: n, record, rests }).is_err() {
                return;
            }
            place = n;
        }
    }

    /// Whether the path is at rest before record `place`, as far as its records are retained.
    #[must_use]
    pub fn is_at_rest_before(&self, place: RecordIndex) -> bool {
        place == self.start || self.ring.record(place - 1).is_some_and(|r| r.flags.contains(Flags::REST))
    }
}

/// An item that the cursor passed for the first time.
#[derive(Clone, Debug)]
pub enum PassedItem {
    /// An output action and its line.
    Action(OutputAction, u32),
    /// A message: its line and text.
    Message(u32, String),
    /// The modal state that is in force from there on.
    Active(Box<ActiveCodes>),
}
