//! The tape: slides the card's window along the ring, both ways, as far as the gates and the mode allow (design, idea 3).
//!
//! Invariant: no record beyond the road's end is ever sent: not behind an exclusive marker whose instruction is not
//! acknowledged, not beyond `reached` while retracing, not before a place that cannot be passed backward, not beyond what the index says
//! durably. Nothing here allocates after the start: what is held of items is bounded, and where it is full the rest is left where it is.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, TryRecvError};

use retrace_core::gate::Gates;
use retrace_core::place::is_before;
use retrace_core::ring::Consumer;
use retrace_core::{Flags, Place, Record};
use retrace_gcode::ActiveCodes;
use retrace_link::{CardStatus, HostCommand, MotionCard, OutputAction, Outputs};

use crate::place_index::{DurablePlace, MarkDifference};
use crate::plan_item::{ExclusiveInstruction, ExclusiveKind, PathItem, PlanSummary};
use crate::restart::{OutputOrigins, RestartStep};

/// How far ahead the road is open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SendHorizon {
    /// To the end of what is planned: normal run.
    LookAhead,
    /// To the furthest place ever executed: retracing.
    Reached,
}

/// So many instructions are held at a time.
const MAX_EXCLUSIVES: usize = 64;
/// So many output actions; the oldest that were passed make room.
const MAX_ACTIONS: usize = 1 << 16;
/// So many messages.
const MAX_MESSAGES: usize = 1024;
/// So many modal states.
const MAX_MODES: usize = 1024;
/// So many places where a cutting output was switched on.
const MAX_JETS: usize = 4096;

/// The consumer's side of planning: ring, items, and what of them the card has.
#[derive(Debug)]
pub struct RecordStreamer<'r, const A: usize> {
    ring: Consumer<'r, Record<A>>,
    items: Receiver<PathItem>,
    start: u32,
    /// Instructions to come; the first is in hand of the gates, if any is.
    exclusives: VecDeque<ExclusiveInstruction>,
    gates: Gates,
    next_number: u32,
    /// Output actions of the records that are kept, in path order.
    actions: VecDeque<(OutputAction, u32)>,
    /// How many of `actions` lie behind `reached`.
    passed: usize,
    messages: VecDeque<(u32, u32, String)>,
    /// Modal states, each from its place on.
    modes: VecDeque<(u32, Box<ActiveCodes>)>,
    summary: Option<PlanSummary>,
    /// Nobody plans any more, and the program has not ended: a defect over there.
    cut_off: bool,
    /// Up to this place all items are known.
    known: u32,
    /// No more items are taken for now.
    full: bool,
    durable: Option<DurablePlace>,
    /// Actions before this place are not kept any more.
    kept_from: Option<u32>,
    /// Where a cutting output was switched on by the program, in path order.
    jets: VecDeque<u32>,
    /// Where a cutting output was switched on or off by the program, in path order.
    cut_changes: VecDeque<u32>,
    cutting: Vec<u8>,
    last_lit: Option<u8>,
    /// What became of the marks of a run before: all passed, or the first that differs.
    marks: Option<Result<(), Box<MarkDifference>>>,
    /// Behind this place nothing can be gone back to, and the code that stands there.
    one_way: Option<(u32, &'static str)>,
    /// What the program expects of the outputs at `reached`.
    expected: Outputs,
    /// Which instructions have switched them.
    origins: OutputOrigins,
    /// Single block: where the road ends.
    block: Option<BlockWindow>,
}

impl<'r, const A: usize> RecordStreamer<'r, A> {
    /// The supply from a ring that begins at `start`, the outputs being as given, and instruction `executed` the last before it.
    #[must_use]
    pub fn new(
        ring: Consumer<'r, Record<A>>,
        items: Receiver<PathItem>,
        start: u32,
        outputs: Outputs,
        executed: u32,
    ) -> Self {
        Self {
            ring,
            items,
            start,
            exclusives: VecDeque::with_capacity(MAX_EXCLUSIVES),
            gates: Gates::default(),
            next_number: executed.wrapping_add(1),
            actions: VecDeque::with_capacity(MAX_ACTIONS),
            passed: 0,
            messages: VecDeque::with_capacity(MAX_MESSAGES),
            modes: VecDeque::with_capacity(MAX_MODES),
            summary: None,
            cut_off: false,
            known: start,
            full: false,
            durable: None,
            kept_from: None,
            jets: VecDeque::with_capacity(MAX_JETS),
            cut_changes: VecDeque::with_capacity(MAX_JETS),
            cutting: Vec::new(),
            last_lit: None,
            marks: None,
            one_way: None,
            expected: outputs,
            origins: OutputOrigins::default(),
            block: None,
        }
    }

    /// The same, which sends no record at or beyond what is durable of the index, if one is kept.
    #[must_use]
    pub fn durable(self, durable: Option<DurablePlace>) -> Self {
        Self { durable, ..self }
    }

    /// The same on a machine with these cutting outputs.
    #[must_use]
    pub fn cutting(self, outputs: &[u8]) -> Self {
        Self { cutting: outputs.to_vec(), ..self }
    }

    /// Looks up what has been planned by now. `write` before the items: an item is sent before the records behind it.
    ///
    /// Where there is no room for more items, those behind are left where they are, and so are the records behind the last that was taken.
    pub fn poll_planner(&mut self) {
        let write = self.ring.write();
        self.full = false;
        let mut last = self.known;
        loop {
            self.make_room();
            if self.is_full() {
                (self.full, self.known) = (true, last);
                break;
            }
            match self.items.try_recv() {
                Ok(item) => last = self.receive_item(item).unwrap_or(last),
                Err(error) => {
                    self.known = write;
                    self.cut_off = error == TryRecvError::Disconnected && self.summary.is_none();
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

    /// Takes an item; its place.
    fn receive_item(&mut self, item: PathItem) -> Option<u32> {
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

    /// Lets the oldest action go where there is no room for another: what lies before it cannot be gone back to any more.
    fn make_room(&mut self) {
        if self.actions.len() == MAX_ACTIONS && self.passed > 0 {
            self.kept_from = self.actions.pop_front().map(|(action, _)| action.place.wrapping_add(1));
            self.passed -= 1;
        }
    }

    fn is_full(&self) -> bool {
        self.exclusives.len() == MAX_EXCLUSIVES
            || self.actions.len() == MAX_ACTIONS
            || self.messages.len() == MAX_MESSAGES
            || self.modes.len() == MAX_MODES
    }

    /// The place up to which everything is known, and may be sent as far as the index goes.
    fn safe_to_send_until(&self) -> u32 {
        match &self.durable {
            Some(durable) if is_before(durable.place(), self.known) => durable.place(),
            _ => self.known,
        }
    }

    /// Is enough planned that the rate does not depend on when the planner gets on? `enough`: records ahead.
    #[must_use]
    pub fn has_lookahead(&mut self, status: &CardStatus<A>, enough: u32) -> bool {
        let sure = self.safe_to_send_until();
        sure.wrapping_sub(status.place.record) >= enough
            || self.exclusives.front().is_some_and(|next| !is_before(sure, next.place))
            || self.full && sure == self.known
            || self.summary.is_some() && sure == self.ring.write()
            || self.cut_off
    }

    /// Has whoever plans gone without an end of the program?
    #[must_use]
    pub fn planner_gone(&self) -> bool {
        self.cut_off
    }

    /// What became of the marks of a run before, once that is known: all passed, or the first that differs.
    #[must_use]
    pub fn marks(&self) -> Option<&Result<(), Box<MarkDifference>>> {
        self.marks.as_ref()
    }

    /// Up to where everything that is planned is known.
    #[must_use]
    pub fn items_complete_until(&self) -> u32 {
        self.known
    }

    /// Where the next instruction stands, if one is known.
    #[must_use]
    pub fn next_exclusive(&self) -> Option<u32> {
        self.exclusives.front().map(|next| next.place)
    }

    /// The record at `place`, if it is kept or planned.
    #[must_use]
    pub fn record(&self, place: u32) -> Option<Record<A>> {
        self.ring.record(place)
    }

    /// The end of the program, once it is known.
    #[must_use]
    pub fn summary(&self) -> Option<&PlanSummary> {
        self.summary.as_ref()
    }

    /// Has everything been executed for the first time?
    pub fn all_executed(&mut self, status: &CardStatus<A>) -> bool {
        self.summary.is_some() && self.exclusives.is_empty() && status.reached == self.ring.write()
    }

    /// The oldest place that can be gone back to.
    #[must_use]
    pub fn oldest(&self) -> u32 {
        let one_way = self.one_way.map(|(place, _)| place);
        let later = |oldest, other: Option<u32>| other.filter(|&place| is_before(oldest, place)).unwrap_or(oldest);
        later(later(self.ring.head(), one_way), self.kept_from)
    }

    /// The code that keeps reverse run from going back further, if it is one.
    #[must_use]
    pub fn barrier(&self) -> Option<&'static str> {
        self.one_way.filter(|(place, _)| *place == self.oldest()).map(|(_, code)| code)
    }

    /// Nothing before `place` can be gone back to from now on, because of `what`.
    pub fn barrier_before(&mut self, place: u32, what: &'static str) {
        if is_before(self.oldest(), place) {
            self.one_way = Some((place, what));
        }
    }

    /// The last place at or before `place` where the program switched a cutting output on, if that is kept.
    #[must_use]
    pub fn pierce_before(&self, place: Place) -> Option<u32> {
        let jet = self.jets.iter().rev().find(|&&jet| Place::start_of(jet).distance_to(place) >= 0);
        jet.copied().filter(|&jet| !is_before(jet, self.oldest()))
    }

    /// An output takes a value by the program, at `place`.
    fn expect(&mut self, place: u32, channel: u8, value: i32) {
        let expected = &mut self.expected[usize::from(channel)];
        if (*expected == 0) != (value == 0) && self.cutting.contains(&channel) {
            if self.cut_changes.len() == MAX_JETS {
                self.cut_changes.pop_front();
            }
            self.cut_changes.push_back(place);
        }
        if *expected == 0 && value != 0 && self.cutting.contains(&channel) {
            self.last_lit = Some(channel);
            if self.jets.len() == MAX_JETS {
                self.jets.pop_front();
            }
            self.jets.push_back(place);
        }
        *expected = value;
    }

    /// What the program expects of the outputs at `reached`.
    #[must_use]
    pub fn expected(&self) -> &Outputs {
        &self.expected
    }

    /// Puts into `steps` the instructions that bring the outputs `are` to what is wanted of the channels that `concerned` names, in the order
    /// in which they are to be carried out.
    pub fn restart_steps(
        &self,
        are: &Outputs,
        wants: &Outputs,
        concerned: impl Fn(u8) -> bool,
        steps: &mut Vec<RestartStep>,
    ) {
        self.origins.steps(are, wants, &self.cutting, concerned, steps);
    }

    /// The last place at or before `place`, but for `passed`, where the program switched a cutting output, if that is kept.
    #[must_use]
    pub fn cut_change_before(&self, place: Place, passed: Option<u32>) -> Option<u32> {
        let behind = |&&change: &&u32| Place::start_of(change).distance_to(place) >= 0 && Some(change) != passed;
        self.cut_changes.iter().rev().find(behind).copied()
    }

    /// The cutting channel that the program has lit last; none where it has lit none.
    #[must_use]
    pub fn last_lit(&self) -> Option<u8> {
        self.last_lit
    }

    /// The instruction in hand, if the card rests on its place and may have it now (gate C).
    #[must_use]
    pub fn due(&self, status: &CardStatus<A>) -> Option<&ExclusiveInstruction> {
        self.exclusives.front().filter(|_| self.gates.c_open(status.place, status.at_rest))
    }

    /// The number that the instruction in hand goes by.
    #[must_use]
    pub fn number(&self) -> u32 {
        self.next_number
    }

    /// The card has taken the instruction in hand.
    pub fn sent(&mut self) {
        self.gates.mark_sent();
    }

    /// If the card has completed the instruction in hand: gives it back, and the road behind it is open.
    pub fn acknowledge(&mut self, executed: u32) -> Option<ExclusiveInstruction> {
        self.gates.acknowledge(executed)?;
        self.next_number = self.next_number.wrapping_add(1);
        let done = self.exclusives.pop_front()?;
        let changes = &done.changes[..usize::from(done.count)];
        for change in changes {
            self.expect(done.place, change.channel, change.value);
        }
        if done.kind == ExclusiveKind::Dwell {
            self.origins.dwelt(done.place, done.periods, &self.expected, &self.cutting);
        } else if !changes.is_empty() {
            self.origins.switched(changes, (done.code, done.line, done.place), done.periods, done.until);
        }
        if done.one_way {
            self.one_way = Some((done.place, done.code));
        }
        if let Some(next) = self.exclusives.front() {
            self.gates.accept(self.next_number, next.place);
        }
        Some(done)
    }

    /// Is there neither an instruction nor the end of the program in sight?
    #[must_use]
    pub fn goes_on(&self) -> bool {
        self.summary.is_none() && self.exclusives.is_empty() && self.block.is_none()
    }

    /// The place where the program ends, once everything is planned.
    #[must_use]
    pub fn ends_at(&mut self) -> Option<u32> {
        (self.summary.is_some() && self.known == self.ring.write()).then_some(self.known)
    }

    /// Puts the cursor on a place, without the card.
    pub fn stand_at(&mut self, place: u32) {
        self.ring.seek(place);
        self.forget_actions();
    }

    /// Follows the card's cursor: history and outputs come up to date. [`Supply::news`] has what the cursor has passed for the first time.
    pub fn seek(&mut self, status: &CardStatus<A>) {
        // `reached` counts a record that was only begun; it is never beyond `write`, so the ring takes it.
        self.ring.seek(status.reached);
        self.ring.seek(status.place.record);
        self.forget_actions();
    }

    /// Forgets the actions that lie before what is kept.
    fn forget_actions(&mut self) {
        while self.passed > 0 && self.actions.front().is_some_and(|(a, _)| is_before(a.place, self.ring.head())) {
            self.actions.pop_front();
            self.passed -= 1;
        }
    }

    /// The next that the cursor has passed for the first time. What undoes an exclusive instruction in reverse (line 0) is not news of its own.
    pub fn next_passed_item(&mut self) -> Option<PassedItem> {
        let reached = self.ring.reached();
        while let Some(&(action, line)) = self.actions.get(self.passed)
            && is_before(action.place, reached)
        {
            self.expect(action.place, action.channel, action.after);
            self.passed += 1;
            if line > 0 {
                self.origins.passed(&action, line);
                return Some(PassedItem::Action(action, line));
            }
        }
        if self.modes.front().is_some_and(|(place, _)| !is_before(reached, *place)) {
            return self.modes.pop_front().map(|(_, active)| PassedItem::Active(active));
        }
        self.messages.front().filter(|(place, ..)| !is_before(reached, *place))?;
        self.messages.pop_front().map(|(_, line, text)| PassedItem::Message(line, text))
    }

    /// This modal state is in force where the cursor stands: it is news yet.
    pub fn still_active(&mut self, active: Box<ActiveCodes>) {
        self.modes.push_front((self.ring.reached(), active));
    }

    /// The card was left when it had executed instruction `number`, which is in hand: it is done, as far as the program goes.
    pub fn done_before(&mut self, number: u32) {
        self.gates.mark_sent();
        self.acknowledge(number);
    }

    /// Sends records ahead until the card is full or the road ends.
    pub fn fill_ahead<C: MotionCard<A>>(&mut self, card: &mut C, road: SendHorizon) {
        let (mut place, reached) = (card.status().high, card.status().reached);
        let end = self.road_end(road, reached);
        let mut action = self.actions.partition_point(|(a, _)| is_before(a.place, place));
        let sure = self.safe_to_send_until();
        while is_before(place, end) && is_before(place, sure) && self.gates.b_open(place) {
            let Some(record) = self.ring.record(place) else { break };
            while let Some((next, _)) = self.actions.get(action)
                && next.place == place
            {
                if card.send(HostCommand::Action(*next)).is_err() {
                    return;
                }
                action += 1;
            }
            if card.send(HostCommand::Ahead { place, record }).is_err() {
                return;
            }
            place = place.wrapping_add(1);
        }
    }

    /// Sends records behind until the card is full or `oldest` is there.
    pub fn fill_behind<C: MotionCard<A>>(&mut self, card: &mut C, oldest: u32) {
        let mut place = card.status().low;
        let mut action = self.actions.partition_point(|(a, _)| is_before(a.place, place));
        while is_before(oldest, place) {
            let n = place.wrapping_sub(1);
            let Some(record) = self.ring.record(n) else { break };
            let rests = self.rests_before(n);
            while action > 0 && self.actions[action - 1].0.place == n {
                if card.send(HostCommand::Action(self.actions[action - 1].0)).is_err() {
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

    /// Is the path at rest before record `place`, as far as its records are kept?
    #[must_use]
    pub fn rests_before(&self, place: u32) -> bool {
        place == self.start || self.ring.record(place.wrapping_sub(1)).is_some_and(|r| r.flags.contains(Flags::REST))
    }

    /// Where the road ends ahead, gates aside.
    fn road_end(&mut self, road: SendHorizon, reached: u32) -> u32 {
        if road == SendHorizon::Reached {
            return reached;
        }
        // What is planned behind that may have items in front of it that were not seen.
        let write = self.known;
        while let Some(BlockWindow { looked, ends: false }) = self.block
            && is_before(looked, write)
        {
            let place = looked.wrapping_add(1);
            self.block = Some(BlockWindow { looked: place, ends: self.block_ends(place) });
            if place == write {
                // what follows is not planned yet: look at this place again
                self.block = Some(BlockWindow { looked, ends: false });
                break;
            }
        }
        match self.block {
            Some(BlockWindow { looked, ends: true }) if is_before(looked, write) => looked,
            _ => write,
        }
    }

    /// Single block: has the road end at the first block boundary after `after` that the card can still stop at.
    pub fn end_block<C: MotionCard<A>>(&mut self, card: &mut C, after: u32) {
        let mut place = after;
        while is_before(place, card.status().high) {
            place = place.wrapping_add(1);
            if self.block_ends(place) && card.send(HostCommand::Trim { high: place }).is_ok() {
                self.block = Some(BlockWindow { looked: place, ends: true });
                return;
            }
        }
        self.block = Some(BlockWindow { looked: place, ends: false });
    }

    fn block_ends(&self, place: u32) -> bool {
        match (self.ring.record(place.wrapping_sub(1)), self.ring.record(place)) {
            (Some(last), Some(next)) => last.line != next.line,
            _ => false,
        }
    }

    /// Where single block ends the road, once that is known.
    #[must_use]
    pub fn block_end(&self) -> Option<u32> {
        self.block.filter(|b| b.ends).map(|b| b.looked)
    }

    /// Single block is off.
    pub fn open_block(&mut self) {
        self.block = None;
    }
}

/// Single block: how far the records have been looked at for the end of the block.
#[derive(Clone, Copy, Debug)]
struct BlockWindow {
    looked: u32,
    /// The block ends at `looked`.
    ends: bool,
}

/// What the cursor passed for the first time.
#[derive(Clone, Debug)]
pub enum PassedItem {
    /// An action and its line.
    Action(OutputAction, u32),
    /// A message's line and text.
    Message(u32, String),
    /// The modal state that is in force from there on.
    Active(Box<ActiveCodes>),
}
