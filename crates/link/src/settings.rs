//! What host and card tell each other before anything moves: who the card is, and how it is to work.
//!
//! Invariant: settings take effect only while the machine stands; each opening has an epoch of its own, and what belongs to another
//! epoch counts for nothing.

use retrace_core::Place;
use retrace_core::limits::RateLimits;
use retrace_core::place::is_before;

use crate::{CuttingSettings, OutputChange};

/// Most inputs that a card reads.
pub const MAX_INPUTS: usize = 16;
/// Most outputs that a fault switches.
pub const MAX_SAFE: usize = 16;
/// Version of the protocol that this crate speaks.
pub const PROTOCOL: u8 = 4;

/// Who a card is, and what it can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CardIdentity {
    /// Version of the protocol.
    pub protocol: u8,
    /// Its name, ASCII, padded with zeros.
    pub name: [u8; 16],
    /// Its serial number; 0 where it has none.
    pub serial: u32,
    /// Drawn anew at every start, so that a card that was restarted is not taken for the one it was.
    pub boot: u32,
    /// Axes.
    pub axes: u8,
    /// Digital outputs, from number 0 on.
    pub outputs: u8,
    /// Inputs, at most [`MAX_INPUTS`].
    pub inputs: u8,
    /// Records that it holds.
    pub window: u32,
    /// Longest average of its rate law, in periods.
    pub memory: u16,
    /// Ticks a second of its clock.
    pub tick_hz: u32,
    /// Shortest control period in microseconds.
    pub min_period_us: u32,
    /// Longest control period in microseconds.
    pub max_period_us: u32,
    /// Most pulses that an axis can make in a second.
    pub max_pulses_hz: u32,
}

/// What an input means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum InputUse {
    /// Nothing; it is only reported.
    #[default]
    Plain,
    /// Limit switch of an axis, at the upper end of its travel or the lower.
    Limit {
        /// The axis, from 0.
        axis: u8,
        /// At the upper end?
        upper: bool,
    },
    /// Home switch of an axis.
    Home {
        /// The axis, from 0.
        axis: u8,
    },
    /// A door that must be shut while there is motion.
    Door,
    /// The emergency-stop chain, which is wired to cut power by itself; the card is only told.
    EmergencyStop,
    /// A probe.
    Probe,
}

/// How an input is read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InputSetting {
    /// What it means.
    pub used_for: InputUse,
    /// Is it active while its level is low (a normally closed contact to ground that opens: no; a closing contact: yes)?
    pub active_low: bool,
}

/// Where an epoch begins: the place that the machine stands at on the path that is to be played, and what was done of that path before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PathStart {
    /// Where the cursor stands; the counts stay as they are. Inside of a record the cursor stands until that record is there.
    pub place: Place,
    /// Is the path at rest there, as at a planned stop? Then it is left at full rate, else with a ramp. Never inside of a record.
    pub rests: bool,
    /// The furthest place ever executed, as a record boundary; not before `place`.
    pub reached: u32,
    /// Number of the last exclusive instruction that is complete; the next one has the number behind it.
    pub executed: u32,
}

impl PathStart {
    /// A path that begins with this record, nothing done of it.
    #[must_use]
    pub const fn at(record: u32) -> Self {
        Self { place: Place::start_of(record), rests: true, reached: record, executed: 0 }
    }

    /// Does it fit together: is `reached` not behind the place, and the path in motion inside of a record?
    #[must_use]
    pub const fn is_valid(&self) -> bool {
        !is_before(self.reached, self.place.boundary_ahead()) && (self.place.fraction == 0 || !self.rests)
    }
}

/// How a card is to work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CardSettings<const A: usize> {
    /// Number of this opening, not 0.
    pub epoch: u16,
    /// Where the path is taken up; the counts stay as they are.
    pub start: PathStart,
    /// How many of the axes are used, 1 … `A`.
    pub axes: u8,
    /// Control period in microseconds.
    pub period_us: u32,
    /// What the rate law is told of the machine.
    pub limits: RateLimits<A>,
    /// A report after so many periods at the latest, at least 1.
    pub report_periods: u8,
    /// Periods without a whole frame of the host after which the card stops by itself.
    pub watchdog_periods: u16,
    /// Least length of a step pulse, in nanoseconds.
    pub pulse_ns: u16,
    /// Time that the direction must stand before the first step, in nanoseconds.
    pub direction_setup_ns: u16,
    /// Axes whose direction output is the other way round, one bit each.
    pub direction_inverted: u16,
    /// Play of each axis between its drive and what that moves, in pulses, taken up beside the counts wherever the axis turns.
    pub backlash_pulses: [u16; A],
    /// What the inputs mean.
    pub inputs: [InputSetting; MAX_INPUTS],
    /// What a fault switches, the first `safe_count` of them.
    pub safe: [OutputChange; MAX_SAFE],
    /// How many of `safe` hold.
    pub safe_count: u8,
    /// The cutting outputs.
    pub cutting: CuttingSettings,
}

impl<const A: usize> CardSettings<A> {
    /// All axes, T in microseconds, the path from `start` on, reports every eighth period, a watchdog of 250 ms, no play, no inputs, all
    /// outputs left as they are at a fault, and no cutting outputs.
    #[must_use]
    pub fn new(epoch: u16, start: PathStart, period_us: u32, limits: RateLimits<A>) -> Self {
        Self {
            epoch,
            start,
            axes: A as u8,
            period_us,
            limits,
            report_periods: 8,
            watchdog_periods: (250_000 / period_us.max(1)).clamp(20, 2000) as u16,
            pulse_ns: 2000,
            direction_setup_ns: 5000,
            direction_inverted: 0,
            backlash_pulses: [0; A],
            inputs: [InputSetting::default(); MAX_INPUTS],
            safe: [OutputChange::default(); MAX_SAFE],
            safe_count: 0,
            cutting: CuttingSettings::default(),
        }
    }

    /// The changes that a fault makes.
    #[must_use]
    pub fn safe(&self) -> &[OutputChange] {
        &self.safe[..usize::from(self.safe_count).min(MAX_SAFE)]
    }
}
