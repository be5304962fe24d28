//! A state of the model: the two real endpoints, a card that counts, a line that fails, and what has to hold.
//!
//! Invariant: every step ends with the checks of [`World::check`], so that a state that is reached has passed them.

mod invariants;

use std::collections::VecDeque;
use std::hash::Hash;
use std::rc::Rc;

use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Rate, RateTarget, Record, RecordIndex};
use retrace_link::sequence::FirstNumbers;
use retrace_link::{
    CardEndpoint, CardSettings, CardStatus, HostCommand, HostEndpoint, LinkError, OutputChange, PathStart,
};

use super::counting_card::{CountingCard, WINDOW};
use super::fingerprint::Fingerprint;
use invariants::{Period, Session};

/// The host's endpoint with small arrays: the records of twice the window and more, a few entries and commands.
type Host = HostEndpoint<1, 16, 32, 32>;
/// The card's endpoint, with the smallest queue of entries.
type Card = CardEndpoint<1, 16>;

/// Control period in microseconds: every interval of the endpoints ends after at most five.
const PERIOD_US: u64 = 20_000;
/// Longest frame with a report or commands that fits the shortest adaptive payload.
const SHORTEST_FRAME: usize = 40 + retrace_link::frame::OVERHEAD;
/// How often each event may still happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Budget {
    /// Frames lost, delayed or doubled.
    pub(super) faults: u8,
    /// Commands and rates, and which ones.
    pub(super) commands: u8,
    pub(super) requests: &'static [Request],
    /// Restarts of the card.
    pub(super) card_restarts: u8,
    /// Restarts of the host.
    pub(super) host_restarts: u8,
    /// New paths and closed epochs.
    pub(super) openings: u8,
}

/// Where a search begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Begin {
    /// Both ends are switched on.
    PowerOn,
    /// The epoch is open, and the window is empty.
    Open,
    /// The window is full, and the cursor is at rest in its middle.
    Filled,
}

/// One step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// The host sends its next frame.
    Host(Fate),
    /// The card sends its next frame.
    Card(Fate),
    /// A control period passes.
    Period,
    /// A delayed frame of the host arrives; it remains on the line if it is doubled.
    HostLate {
        doubled: bool,
    },
    /// A delayed frame of the card arrives.
    CardLate {
        doubled: bool,
    },
    /// The controller requests something.
    Request(Request),
    RestartCard,
    RestartHost,
    BeginPath,
    Close,
}

/// What happens to a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fate {
    Arrives,
    IsLost,
    /// It arrives later, after frames that are sent after it.
    IsDelayed,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Request {
    Ahead,
    Behind,
    Output,
    Forward,
    Backward,
    Stop,
}

/// The host as a controller uses it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Controller {
    /// Waits for a greeting at rest, then opens.
    Connects,
    Runs,
    Closes,
}

#[derive(Clone, Debug)]
pub(super) struct World {
    host: Host,
    card: Card,
    core: CountingCard,
    controller: Controller,
    numbers: FirstNumbers,
    now_us: u64,
    /// Delayed frames.
    host_late: Option<Rc<[u8]>>,
    card_late: Option<Rc<[u8]>>,
    budget: Budget,
    nonce: u32,
    /// Sessions of the host and of the card.
    sessions: Vec<Session>,
    /// The host's session; 0 before it opened one.
    host_session: u16,
    next_session: u16,
}

impl World {
    /// A card and a host that are switched on; numbers and epoch begin as given.
    pub(super) fn new(numbers: FirstNumbers, last_epoch: u16, budget: Budget) -> Self {
        Self {
            host: Host::starting_at(1, numbers),
            card: Card::starting_at(numbers, last_epoch),
            core: CountingCard::new(1),
            controller: Controller::Connects,
            numbers,
            now_us: 1_000_000,
            host_late: None,
            card_late: None,
            budget,
            nonce: 1,
            sessions: Vec::new(),
            host_session: 0,
            next_session: 1,
        }
    }

    /// The state in which a search begins.
    pub(super) fn begin(begin: Begin, numbers: FirstNumbers, last_epoch: u16, budget: Budget) -> Self {
        let mut world = Self::new(numbers, last_epoch, budget);
        if begin == Begin::PowerOn {
            return world;
        }
        let exchange = |world: &mut Self| (0..4).for_each(|_| world.exchange());
        exchange(&mut world);
        assert!(world.host.is_open(), "a line without faults opens");
        if begin == Begin::Filled {
            for _ in 0..WINDOW {
                world.request(Request::Ahead).expect("room");
            }
            exchange(&mut world);
            world.request(Request::Forward).expect("a rate");
            (0..2).for_each(|_| world.exchange());
            world.request(Request::Stop).expect("a rate");
            exchange(&mut world);
            assert!(world.is_settled() && world.core.status.place.record.since(world.core.status.low) == 2);
        }
        world
    }

    pub(super) fn fingerprint(&self) -> u128 {
        let mut state = Fingerprint::new();
        let Self { host, card, core, controller, numbers, now_us, host_late, card_late, budget, .. } = self;
        host.hash_state(*now_us, &mut state);
        card.hash_state(&mut state);
        let CountingCard { identity, status, records, target, session, events } = core;
        assert!(events.is_empty());
        (identity, CardStatus { period: 0, ..*status }, records, target, session).hash(&mut state);
        (controller, numbers, host_late, card_late, budget).hash(&mut state);
        (self.nonce, &self.sessions, self.host_session, self.next_session).hash(&mut state);
        state.finish_wide()
    }

    /// Every state after one step.
    pub(super) fn steps(&self) -> Vec<(Step, Self)> {
        let budget = self.budget;
        let mut steps = vec![Step::Host(Fate::Arrives), Step::Card(Fate::Arrives), Step::Period];
        if budget.faults > 0 {
            steps.extend([Step::Host(Fate::IsLost), Step::Card(Fate::IsLost)]);
            steps.extend(self.host_late.is_none().then_some(Step::Host(Fate::IsDelayed)));
            steps.extend(self.card_late.is_none().then_some(Step::Card(Fate::IsDelayed)));
        }
        for doubled in [false, true] {
            if !doubled || budget.faults > 0 {
                steps.extend(self.host_late.is_some().then_some(Step::HostLate { doubled }));
                steps.extend(self.card_late.is_some().then_some(Step::CardLate { doubled }));
            }
        }
        let runs = self.controller == Controller::Runs && self.host.is_open() && self.host.fault().is_none();
        if budget.commands > 0 && runs {
            steps.extend(budget.requests.iter().map(|&request| Step::Request(request)));
        }
        if budget.openings > 0 && runs {
            steps.extend(self.host.is_acknowledged().then_some(Step::BeginPath));
            steps.push(Step::Close);
        }
        steps.extend((budget.card_restarts > 0).then_some(Step::RestartCard));
        steps.extend((budget.host_restarts > 0).then_some(Step::RestartHost));
        steps.into_iter().filter_map(|step| Some((step, self.after(step)?))).collect()
    }

    /// The state after a step; `None` if it changes nothing.
    fn after(&self, step: Step) -> Option<Self> {
        let mut world = self.clone();
        world.take(step)?;
        Some(world)
    }

    pub(super) fn take(&mut self, step: Step) -> Option<()> {
        match step {
            Step::Host(fate) => {
                let frame = self.host_frame()?;
                self.pass(fate, frame, true);
            }
            Step::Card(fate) => {
                let frame = self.card_frame()?;
                self.pass(fate, frame, false);
            }
            Step::Period => self.run_period(),
            Step::HostLate { doubled } => {
                let frame = self.host_late.clone()?;
                self.leave(doubled, true);
                self.deliver_to_card(&frame);
            }
            Step::CardLate { doubled } => {
                let frame = self.card_late.clone()?;
                self.leave(doubled, false);
                self.deliver_to_host(&frame);
            }
            Step::Request(request) => {
                self.budget.commands -= 1;
                self.request(request)?;
            }
            Step::RestartCard => {
                self.budget.card_restarts -= 1;
                // it forgets everything, and draws another boot number
                self.core = CountingCard::new(self.core.identity.boot + 1);
                self.card = Card::starting_at(self.numbers, 0);
            }
            Step::RestartHost => {
                self.budget.host_restarts -= 1;
                self.nonce += 100;
                self.host = Host::starting_at(self.nonce, self.numbers);
                (self.controller, self.host_session) = (Controller::Connects, 0);
            }
            Step::BeginPath => {
                self.budget.openings -= 1;
                self.nonce += 1;
                self.host.request_greeting(self.nonce);
                self.controller = Controller::Connects;
            }
            Step::Close => {
                self.budget.openings -= 1;
                self.host.close();
                self.controller = Controller::Closes;
            }
        }
        self.check();
        Some(())
    }

    fn pass(&mut self, fate: Fate, frame: Rc<[u8]>, from_host: bool) {
        self.budget.faults -= u8::from(fate != Fate::Arrives);
        match fate {
            Fate::Arrives if from_host => self.deliver_to_card(&frame),
            Fate::Arrives => self.deliver_to_host(&frame),
            Fate::IsLost => {}
            Fate::IsDelayed if from_host => self.host_late = Some(frame),
            Fate::IsDelayed => self.card_late = Some(frame),
        }
    }

    fn leave(&mut self, doubled: bool, from_host: bool) {
        let late = if from_host { &mut self.host_late } else { &mut self.card_late };
        if doubled {
            self.budget.faults -= 1;
        } else {
            *late = None;
        }
    }

    /// The host's next frame, if one is due.
    fn host_frame(&mut self) -> Option<Rc<[u8]>> {
        let now = self.now_us;
        let host = &mut self.host;
        if matches!(host.fault(), Some(fault) if !matches!(fault, LinkError::Alarm(_))) {
            return None;
        }
        let frame = frame(|byte| host.transmit(now, byte))?;
        // the payload's kind is behind length and code byte
        assert!(frame.len() <= SHORTEST_FRAME || frame[2] < 3, "a frame is longer than the model allows");
        Some(frame)
    }

    fn card_frame(&mut self) -> Option<Rc<[u8]>> {
        let Self { card, core, .. } = self;
        let frame = frame(|byte| card.transmit(core, byte))?;
        assert!(frame.len() <= SHORTEST_FRAME || frame[2] == 0x81, "a frame is longer than the model allows");
        Some(frame)
    }

    fn deliver_to_card(&mut self, frame: &[u8]) {
        for &byte in frame {
            self.card.receive(byte, &mut self.core);
        }
        for event in std::mem::take(&mut self.core.events) {
            self.record(event);
        }
    }

    fn deliver_to_host(&mut self, frame: &[u8]) {
        self.host.receive(frame, self.now_us);
        while self.host.next_period() {
            let status = self.host.status();
            let published = Period {
                place: status.place,
                rate: status.rate,
                at_rest: status.at_rest,
                count: status.counts[0],
                output: status.outputs[3],
            };
            let id = self.host_session;
            let was = self.session(id).periods.pop_front();
            assert_eq!(was, Some(published), "the host publishes what the card did, period by period");
        }
        self.control();
    }

    /// What the controller does when something arrived.
    fn control(&mut self) {
        let Some(greeting) = self.host.greeting().copied() else { return };
        if self.controller != Controller::Connects || self.host.fault().is_some() {
            return;
        }
        if !greeting.at_rest {
            self.nonce += 1;
            self.host.request_greeting(self.nonce);
            return;
        }
        let place = greeting.place;
        let id = self.next_session;
        self.next_session += 1;
        let axis = PulseLimits { velocity: 200 << 32, acceleration: 12 << 32, jerk: 1 << 32 };
        let limits = RateLimits::new(13, 1 << 15, [axis]).expect("valid limits");
        let settings = CardSettings {
            report_periods: 1,
            pulse_ns: id,
            ..CardSettings::new(0, PathStart::at(place.record), PERIOD_US as u32, limits)
        };
        self.host.open(settings);
        (self.controller, self.host_session) = (Controller::Runs, id);
        self.sessions.push(Session {
            id,
            opened: false,
            pending: VecDeque::new(),
            rates: VecDeque::new(),
            target: RateTarget::ZERO,
            periods: VecDeque::new(),
            sent: 0,
            received: 0,
            windows: VecDeque::from([(place.record, place.record)]),
            first_window: 0,
        });
    }

    /// The content of a record: a function of its session and its number.
    fn record_of(session: u16, place: RecordIndex) -> Record<1> {
        let increment = (session * 16) as i16 + (place.number() % 16) as i16;
        Record { increments: [increment], ..Record::default() }
    }

    fn request(&mut self, request: Request) -> Option<()> {
        let (low, high) = (self.host.status().low, self.host.status().high);
        let id = self.host_session;
        let command = match request {
            Request::Ahead => HostCommand::Ahead { place: high, record: Self::record_of(id, high) },
            Request::Behind => {
                let place = low - 1;
                HostCommand::Behind { place, record: Self::record_of(id, place), rests: false }
            }
            Request::Output => {
                let value = i32::from(id * 100 + self.session(id).sent + 1);
                HostCommand::ManualOutput(OutputChange { channel: 3, value })
            }
            Request::Forward => HostCommand::rate(Rate::ONE),
            Request::Backward => HostCommand::rate(-Rate::ONE),
            Request::Stop => HostCommand::rate(Rate::ZERO),
        };
        self.host.send(command).ok()?;
        let session = self.session(id);
        match command {
            HostCommand::Rate(target) if target == session.target => return None,
            HostCommand::Rate(target) => {
                session.target = target;
                session.rates.push_back(target);
            }
            _ => {
                session.pending.push_back(command);
                session.sent += 1;
            }
        }
        Some(())
    }

    fn run_period(&mut self) {
        self.now_us += PERIOD_US;
        self.core.run_period();
        self.card.push_period(&self.core.status);
        let status = self.core.status;
        let period = Period {
            place: status.place,
            rate: status.rate,
            at_rest: status.at_rest,
            count: status.counts[0],
            output: status.outputs[3],
        };
        let id = self.core.session;
        // a host that is gone publishes nothing
        if id != 0 && id == self.host_session {
            self.session(id).periods.push_back(period);
        }
    }
}

/// The next frame of an endpoint, with its zero byte.
fn frame(mut transmit: impl FnMut(&mut [u8]) -> usize) -> Option<Rc<[u8]>> {
    let (mut bytes, mut byte) = (Vec::new(), [0]);
    loop {
        if transmit(&mut byte) == 0 {
            assert!(bytes.is_empty(), "a frame is sent completely");
            return None;
        }
        bytes.push(byte[0]);
        match bytes.as_slice() {
            [0] => bytes.clear(),
            [.., 0] => return Some(bytes.into()),
            _ => {}
        }
    }
}
