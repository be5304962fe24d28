//! The tape: slides the card's window along the ring, both ways, as far as the gates and the mode allow (design, idea 3).
//!
//! Invariant: no record beyond the road's end is ever sent: not behind an exclusive marker whose instruction is not
//! acknowledged, not beyond `reached` while retracing, not before a place that cannot be passed backward.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, TryRecvError};

use retrace_core::gate::Gates;
use retrace_core::place::before;
use retrace_core::ring::Consumer;
use retrace_core::{Flags, Record};
use retrace_link::{Action, MotionCard, Outputs, Status, Word};

use crate::item::{Exclusive, Item, Summary};

/// How far ahead the road is open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Road {
    /// To the end of what is planned: normal run.
    LookAhead,
    /// To the furthest place ever executed: retracing.
    Reached,
}

/// So many instructions are held at a time.
const MOST_EXCLUSIVES: usize = 64;

/// The consumer's side of planning: ring, items, and what of them the card has.
#[derive(Debug)]
pub struct Supply<'r, const A: usize> {
    ring: Consumer<'r, Record<A>>,
    items: Receiver<Item>,
    start: u32,
    /// Instructions to come; the first is in hand of the gates, if any is.
    exclusives: VecDeque<Exclusive>,
    gates: Gates,
    next_number: u32,
    /// Output actions of the records that are kept, in path order.
    actions: VecDeque<(Action, u32)>,
    /// How many of `actions` lie behind `reached`.
    passed: usize,
    messages: VecDeque<(u32, u32, String)>,
    summary: Option<Summary>,
    /// Behind this place nothing can be gone back to, and the code that stands there.
    one_way: Option<(u32, &'static str)>,
    /// What the program expects of the outputs at `reached`.
    expected: Outputs,
    /// Single block: where the road ends.
    block: Option<Block>,
}

impl<'r, const A: usize> Supply<'r, A> {
    /// The supply from a ring that begins at `start`, the outputs being as given.
    #[must_use]
    pub fn new(ring: Consumer<'r, Record<A>>, items: Receiver<Item>, start: u32, outputs: Outputs) -> Self {
        Self {
            ring,
            items,
            start,
            exclusives: VecDeque::new(),
            gates: Gates::default(),
            next_number: 1,
            actions: VecDeque::new(),
            passed: 0,
            messages: VecDeque::new(),
            summary: None,
            one_way: None,
            expected: outputs,
            block: None,
        }
    }

    /// Looks up what has been planned by now. `write` before the items: an item is sent before the records behind it.
    ///
    /// Where many instructions wait, the items behind them are left where they are: they belong to places that the first one
    /// keeps shut.
    pub fn look(&mut self) {
        self.ring.write();
        while self.exclusives.len() < MOST_EXCLUSIVES {
            match self.items.try_recv() {
                Ok(Item::Exclusive(exclusive)) => self.exclusives.push_back(exclusive),
                Ok(Item::Action(action, line)) => self.actions.push_back((action, line)),
                Ok(Item::Message { place, line, text }) => self.messages.push_back((place, line, text)),
                Ok(Item::End(summary)) => self.summary = Some(summary),
                Err(TryRecvError::Empty | TryRecvError::Disconnected) => break,
            }
        }
        if self.gates.a_open()
            && let Some(next) = self.exclusives.front()
        {
            self.gates.take(self.next_number, next.place);
        }
    }

    /// Is enough planned that the rate does not depend on when the planner gets on? `enough`: records ahead.
    #[must_use]
    pub fn is_enough(&mut self, status: &Status<A>, enough: u32) -> bool {
        let planned = self.ring.write().wrapping_sub(status.place.record);
        planned >= enough || self.summary.is_some() || !self.exclusives.is_empty()
    }

    /// The end of the program, once it is known.
    #[must_use]
    pub fn summary(&self) -> Option<&Summary> {
        self.summary.as_ref()
    }

    /// Has everything been executed for the first time?
    pub fn all_executed(&mut self, status: &Status<A>) -> bool {
        self.summary.is_some() && self.exclusives.is_empty() && status.reached == self.ring.write()
    }

    /// The oldest place that can be gone back to.
    #[must_use]
    pub fn oldest(&self) -> u32 {
        match self.one_way {
            Some((place, _)) if before(self.ring.head(), place) => place,
            _ => self.ring.head(),
        }
    }

    /// The code that keeps reverse run from going back further, if it is one.
    #[must_use]
    pub fn barrier(&self) -> Option<&'static str> {
        self.one_way.filter(|(place, _)| *place == self.oldest()).map(|(_, code)| code)
    }

    /// What the program expects of the outputs at `reached`.
    #[must_use]
    pub fn expected(&self) -> &Outputs {
        &self.expected
    }

    /// The instruction in hand, if the card rests on its place and may have it now (gate C).
    #[must_use]
    pub fn due(&self, status: &Status<A>) -> Option<&Exclusive> {
        self.exclusives.front().filter(|_| self.gates.c_open(status.place, status.at_rest))
    }

    /// The number that the instruction in hand goes by.
    #[must_use]
    pub fn number(&self) -> u32 {
        self.next_number
    }

    /// The card has taken the instruction in hand.
    pub fn sent(&mut self) {
        self.gates.sent();
    }

    /// If the card has completed the instruction in hand: gives it back, and the road behind it is open.
    pub fn acknowledge(&mut self, executed: u32) -> Option<Exclusive> {
        self.gates.acknowledge(executed)?;
        self.next_number = self.next_number.wrapping_add(1);
        let done = self.exclusives.pop_front()?;
        for change in &done.changes[..usize::from(done.count)] {
            self.expected[usize::from(change.channel)] = change.value;
        }
        if done.one_way {
            self.one_way = Some((done.place, done.code));
        }
        if let Some(next) = self.exclusives.front() {
            self.gates.take(self.next_number, next.place);
        }
        Some(done)
    }

    /// Follows the card's cursor: history, outputs and messages come up to date. Gives the actions and messages that the
    /// cursor has passed for the first time to `news`.
    pub fn follow(&mut self, status: &Status<A>, mut news: impl FnMut(News<'_>)) {
        // `reached` counts a record that was only begun; it is never beyond `write`, so the ring takes it.
        self.ring.follow(status.reached);
        self.ring.follow(status.place.record);
        while let Some((action, line)) = self.actions.get(self.passed)
            && before(action.place, status.reached)
        {
            self.expected[usize::from(action.channel)] = action.after;
            if *line > 0 {
                news(News::Action(action, *line));
            }
            self.passed += 1;
        }
        while let Some((place, line, text)) = self.messages.front()
            && !before(status.reached, *place)
        {
            news(News::Message(*line, text));
            self.messages.pop_front();
        }
        while self.passed > 0 && self.actions.front().is_some_and(|(a, _)| before(a.place, self.ring.head())) {
            self.actions.pop_front();
            self.passed -= 1;
        }
    }

    /// Sends records ahead until the card is full or the road ends.
    pub fn fill_ahead<C: MotionCard<A>>(&mut self, card: &mut C, road: Road) {
        let (mut place, reached) = (card.status().high, card.status().reached);
        let end = self.road_end(road, reached);
        let mut action = self.actions.partition_point(|(a, _)| before(a.place, place));
        while before(place, end) && self.gates.b_open(place) {
            let Some(record) = self.ring.record(place) else { break };
            while let Some((next, _)) = self.actions.get(action)
                && next.place == place
            {
                if card.send(Word::Action(*next)).is_err() {
                    return;
                }
                action += 1;
            }
            if card.send(Word::Ahead { place, record }).is_err() {
                return;
            }
            place = place.wrapping_add(1);
        }
    }

    /// Sends records behind until the card is full or history ends.
    pub fn fill_behind<C: MotionCard<A>>(&mut self, card: &mut C) {
        let (mut place, oldest) = (card.status().low, self.oldest());
        let mut action = self.actions.partition_point(|(a, _)| before(a.place, place));
        while before(oldest, place) {
            let n = place.wrapping_sub(1);
            let Some(record) = self.ring.record(n) else { break };
            let rests =
                n == self.start || self.ring.record(n.wrapping_sub(1)).is_some_and(|r| r.flags.has(Flags::REST));
            while action > 0 && self.actions[action - 1].0.place == n {
                if card.send(Word::Action(self.actions[action - 1].0)).is_err() {
                    return;
                }
                action -= 1;
            }
            if card.send(Word::Behind { place: n, record, rests }).is_err() {
                return;
            }
            place = n;
        }
    }

    /// Where the road ends ahead, gates aside.
    fn road_end(&mut self, road: Road, reached: u32) -> u32 {
        if road == Road::Reached {
            return reached;
        }
        let write = self.ring.write();
        while let Some(Block { looked, ends: false }) = self.block
            && before(looked, write)
        {
            let place = looked.wrapping_add(1);
            self.block = Some(Block { looked: place, ends: self.block_ends(place) });
            if place == write {
                // what follows is not planned yet: look at this place again
                self.block = Some(Block { looked, ends: false });
                break;
            }
        }
        match self.block {
            Some(Block { looked, ends: true }) if before(looked, write) => looked,
            _ => write,
        }
    }

    /// Single block: has the road end at the first block boundary after `after` that the card can still stop at.
    pub fn end_block<C: MotionCard<A>>(&mut self, card: &mut C, after: u32) {
        let mut place = after;
        while before(place, card.status().high) {
            place = place.wrapping_add(1);
            if self.block_ends(place) && card.send(Word::Trim { high: place }).is_ok() {
                self.block = Some(Block { looked: place, ends: true });
                return;
            }
        }
        self.block = Some(Block { looked: place, ends: false });
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
struct Block {
    looked: u32,
    /// The block ends at `looked`.
    ends: bool,
}

/// What the cursor passed for the first time.
#[derive(Clone, Copy, Debug)]
pub enum News<'a> {
    /// An action and its line.
    Action(&'a Action, u32),
    /// A message's line and text.
    Message(u32, &'a str),
}
