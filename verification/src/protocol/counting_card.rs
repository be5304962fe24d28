//! The card's core in the model of the protocol: a window of four records, a cursor without a rate law, and a log.
//!
//! Invariant: what it accepts and how it moves is a function of the commands and of the periods alone.

use retrace_core::{Place, Rate, RateTarget, Record, RecordIndex};
use retrace_link::{
    CardCore, CardIdentity, CardSettings, CardStatus, CommandRefusal, HostCommand, OutputChange, PROTOCOL, PathStart,
};

/// Records that the card can hold.
pub(super) const WINDOW: u32 = 4;
/// First record of the path: two before the wrap.
const FIRST_RECORD: u32 = u32::MAX - 1;

/// What the core was asked to do since the log was last taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CoreEvent {
    /// An epoch was opened, by the session with this number.
    Opened(u16),
    Closed,
    Rate(RateTarget),
    /// A command was accepted or rejected; the window is that after it.
    Command(HostCommand<1>, RecordIndex, RecordIndex),
}

#[derive(Clone, Debug)]
pub(super) struct CountingCard {
    pub(super) identity: CardIdentity,
    pub(super) status: CardStatus<1>,
    pub(super) records: [Record<1>; WINDOW as usize],
    pub(super) target: RateTarget,
    /// Session whose epoch is open, or 0.
    pub(super) session: u16,
    pub(super) events: Vec<CoreEvent>,
}

impl CountingCard {
    pub(super) fn new(boot: u32) -> Self {
        let identity = CardIdentity {
            protocol: PROTOCOL,
            name: *b"card of a model ",
            serial: 1,
            boot,
            axes: 1,
            outputs: 8,
            inputs: 0,
            has_spindle_pwm: false,
            has_spindle_encoder: false,
            analog: retrace_link::AnalogCounts::NONE,
            window: WINDOW,
            memory: 64,
            tick_hz: 1_000_000,
            min_period_us: 100,
            max_period_us: 20_000,
            max_pulses_hz: 1_000_000,
        };
        Self {
            identity,
            status: CardStatus::at_rest(PathStart::at(RecordIndex::new(FIRST_RECORD))),
            records: [Record::default(); WINDOW as usize],
            target: RateTarget::ZERO,
            session: 0,
            events: Vec::new(),
        }
    }

    /// Returns the record of that number, if held.
    pub(super) fn record(&self, place: RecordIndex) -> Option<&Record<1>> {
        let held = place.since(self.status.low) < self.status.high.since(self.status.low);
        held.then(|| &self.records[(place.number() % WINDOW) as usize])
    }

    /// Runs a control period: the cursor goes by the requested rate, as far as the window goes.
    pub(super) fn run_period(&mut self) {
        let status = &mut self.status;
        let from = status.place;
        let ahead = from.distance_to(Place::start_of(status.high));
        let behind = from.distance_to(Place::start_of(status.low));
        let to = from.moved(self.target.feed.over(1).clamp(behind, ahead));
        let records = &self.records;
        let increments =
            retrace_core::playback::emission(from, to, |place| records.get((place.number() % WINDOW) as usize))
                .expect("the window has every record between its ends");
        status.period += 1;
        (status.place, status.rate) = (to, from.distance_to(to).per_period());
        status.at_rest = status.rate == Rate::ZERO;
        status.counts[0] += increments[0];
    }
}

impl CardCore<1> for CountingCard {
    fn identity(&self) -> &CardIdentity {
        &self.identity
    }

    fn open(&mut self, settings: &CardSettings<1>) -> Result<(), CommandRefusal> {
        if !self.status.at_rest {
            return Err(CommandRefusal::InMotion);
        }
        let CardStatus { counts, outputs, .. } = self.status;
        self.status = CardStatus { counts, outputs, ..CardStatus::at_rest(settings.start) };
        self.target = RateTarget::ZERO;
        self.session = settings.pulse_ns;
        self.events.push(CoreEvent::Opened(self.session));
        Ok(())
    }

    fn close(&mut self) -> Result<(), CommandRefusal> {
        if !self.status.at_rest {
            return Err(CommandRefusal::InMotion);
        }
        self.session = 0;
        self.events.push(CoreEvent::Closed);
        Ok(())
    }

    fn record_host_frame(&mut self) {}

    fn accept(&mut self, command: HostCommand<1>) -> Result<(), CommandRefusal> {
        if let HostCommand::Rate(target) = command {
            self.target = target;
            self.events.push(CoreEvent::Rate(target));
            return Ok(());
        }
        let accepted = self.apply(command);
        self.events.push(CoreEvent::Command(command, self.status.low, self.status.high));
        accepted
    }

    fn status(&self) -> &CardStatus<1> {
        &self.status
    }
}

impl CountingCard {
    fn apply(&mut self, command: HostCommand<1>) -> Result<(), CommandRefusal> {
        let status = &mut self.status;
        let full = status.high.since(status.low) == WINDOW;
        match command {
            HostCommand::Ahead { place, record } => {
                if place != status.high {
                    return Err(CommandRefusal::OutOfOrder);
                }
                if full && status.place.record.since(status.low) <= WINDOW / 4 {
                    return Err(CommandRefusal::Full);
                }
                status.low += u32::from(full);
                self.records[(place.number() % WINDOW) as usize] = record;
                status.high = place + 1;
            }
            HostCommand::Behind { place, record, .. } => {
                if place != status.low - 1 {
                    return Err(CommandRefusal::OutOfOrder);
                }
                if full && status.high.since(status.place.boundary_ahead()) <= WINDOW / 4 {
                    return Err(CommandRefusal::Full);
                }
                status.high -= u32::from(full);
                self.records[(place.number() % WINDOW) as usize] = record;
                status.low = place;
            }
            HostCommand::ManualOutput(OutputChange { channel, value }) => {
                status.outputs[usize::from(channel)] = value;
            }
            _ => return Err(CommandRefusal::Unsupported),
        }
        Ok(())
    }
}
