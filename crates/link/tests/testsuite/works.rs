//! Works behind a card's endpoint that only count, and numbers at which an epoch may begin.

use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Flags, Place, Rate, Record, RecordIndex};
use retrace_link::sequence::FirstNumbers;
use retrace_link::{
    CardCore, CardIdentity, CardSettings, CardStatus, CommandRefusal, CutterOff, CutterOffCause, HostCommand,
    Instruction, OutputChange, PROTOCOL, PathStart,
};

pub(crate) const WINDOW: u32 = 256;

/// Works without any motion law: the cursor goes by the rate that was asked for, as far as the window goes.
#[derive(Debug)]
pub(crate) struct Works {
    pub(crate) identity: CardIdentity,
    pub(crate) status: CardStatus<3>,
    pub(crate) records: Vec<Record<3>>,
    pub(crate) target: Rate,
    pub(crate) open: bool,
    pub(crate) log: Vec<CardStatus<3>>,
    pub(crate) by_hand: Vec<i32>,
    /// Rates accepted, in their order.
    pub(crate) rates: Vec<Rate>,
    /// Frames of the open epoch that the endpoint reported.
    pub(crate) host_frames: u32,
    /// Whether openings are rejected.
    pub(crate) refuses: bool,
}

impl Works {
    pub(crate) fn new() -> Self {
        let identity = CardIdentity {
            protocol: PROTOCOL,
            name: *b"works for a test",
            serial: 77,
            boot: 1,
            axes: 3,
            outputs: 8,
            inputs: 4,
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
        let records = vec![Record::default(); WINDOW as usize];
        let status = CardStatus { counts: [5, -6, 7], ..CardStatus::at_rest(PathStart::at(RecordIndex::new(0))) };
        Self {
            identity,
            status,
            records,
            target: Rate::ZERO,
            open: false,
            log: Vec::new(),
            by_hand: Vec::new(),
            rates: Vec::new(),
            host_frames: 0,
            refuses: false,
        }
    }

    pub(crate) fn period(&mut self) {
        let status = &mut self.status;
        let from = status.place;
        let (ahead, behind) =
            (from.distance_to(Place::start_of(status.high)), from.distance_to(Place::start_of(status.low)));
        let to = from.moved(self.target.over(1).clamp(behind, ahead));
        let records = &self.records;
        let increments = retrace_core::playback::emission(from, to, |n| records.get((n.number() % WINDOW) as usize))
            .expect("in the window");
        status.period += 1;
        (status.place, status.rate) = (to, from.distance_to(to).per_period());
        status.at_rest = status.rate == Rate::ZERO;
        for (count, increment) in status.counts.iter_mut().zip(increments) {
            *count += increment;
        }
        status.increments = increments.map(|pulses| pulses as i32);
        // what is said of one period only
        status.wheel = if status.period.is_multiple_of(37) { 2 } else { 0 };
        let off = CutterOff { channels: 1, cause: CutterOffCause::Standing, place: status.place };
        status.cutter_off = status.period.is_multiple_of(53).then_some(off);
        if self.open {
            self.log.push(*status);
        }
    }
}

impl CardCore<3> for Works {
    fn identity(&self) -> &CardIdentity {
        &self.identity
    }
    fn open(&mut self, settings: &CardSettings<3>) -> Result<(), CommandRefusal> {
        if self.refuses {
            return Err(CommandRefusal::Unsupported);
        }
        let counts = self.status.counts;
        self.status = CardStatus { counts, outputs: self.status.outputs, ..CardStatus::at_rest(settings.start) };
        (self.target, self.open) = (Rate::ZERO, true);
        self.log.clear();
        Ok(())
    }
    fn close(&mut self) -> Result<(), CommandRefusal> {
        if !self.status.at_rest {
            return Err(CommandRefusal::InMotion);
        }
        self.open = false;
        Ok(())
    }
    fn record_host_frame(&mut self) {
        self.host_frames += 1;
    }
    fn accept(&mut self, command: HostCommand<3>) -> Result<(), CommandRefusal> {
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
            HostCommand::Rate(target) => {
                self.target = target.feed;
                self.rates.push(target.feed);
            }
            HostCommand::Instruction(Instruction { number, .. }) => {
                if number != status.executed + 1 {
                    return Err(CommandRefusal::Busy);
                }
                status.executed = number;
            }
            HostCommand::Repeat(_) => return Err(CommandRefusal::Busy),
            HostCommand::ManualOutput(OutputChange { channel, value }) => {
                status.outputs[usize::from(channel)] = value;
                self.by_hand.push(value);
            }
            _ => {}
        }
        Ok(())
    }
    fn status(&self) -> &CardStatus<3> {
        &self.status
    }
}

/// The record of a number: made of it, so that any end can tell it.
pub(crate) fn record(place: u32) -> Record<3> {
    let x = place.wrapping_mul(2_654_435_761);
    let flags = if place.is_multiple_of(97) { Flags::REST } else { Flags::NONE };
    let slow = (place / 50 % 40) as i16;
    let wild = if place.is_multiple_of(31) { (x >> 16) as i16 } else { slow / 2 };
    Record { increments: [slow, -slow * 3, wild], line: place / 20, flags, ..Record::default() }
}

/// First numbers of an epoch, and the epoch before it: those of the protocol, and others that soon cross the wrap, or
/// half of it.
pub(crate) const STARTS: [(FirstNumbers, u16); 4] = [
    (FirstNumbers::protocol(), 0),
    (FirstNumbers { command: u16::MAX, entry: u16::MAX - 2, rate: u16::MAX }, u16::MAX),
    (FirstNumbers { command: u16::MAX - 40, entry: u16::MAX - 100, rate: u16::MAX - 3 }, u16::MAX - 1),
    (FirstNumbers { command: 0x7FFE, entry: 0x7FF0, rate: 0x7FFF }, 0x7FFF),
];

/// Limits of a machine that stops within some tens of periods.
pub(crate) fn limits<const A: usize>() -> RateLimits<A> {
    let axis = PulseLimits { velocity: 200 << 32, acceleration: 12 << 32, jerk: 1 << 32 };
    RateLimits::new(13, 1 << 15, [axis; A]).expect("valid")
}
