//! A card for the tests, its settings, and the path that it is given.
//!
//! Invariant: the path is a function of the place number alone, so that its sums can be reckoned without the card.

use proptest::prelude::*;
use retrace_card::{Card, InputLevels};
use retrace_core::drive::Braking;
use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Distance, Flags, Place, RapidCap, Rate, Record, RecordIndex};
use retrace_link::{
    CardCore, CardIdentity, CardSettings, InputSetting, InputUse, MAX_INPUTS, OutputChange, PROTOCOL, PathStart,
    channel,
};

/// Two axes, a small window.
pub(crate) type TestCard = Card<2, 64, 32>;

pub(crate) const UPPER_LIMIT: u16 = 1;
pub(crate) const LOWER_LIMIT: u16 = 2;
pub(crate) const HOME: u16 = 4;
pub(crate) const DOOR: u16 = 8;
pub(crate) const STOP: u16 = 16;
pub(crate) const PLAIN: u16 = 32;

/// A card that makes 250 pulses a millisecond at most.
pub(crate) fn identity() -> CardIdentity {
    CardIdentity {
        protocol: PROTOCOL,
        name: *b"test card\0\0\0\0\0\0\0",
        serial: 7,
        boot: 1,
        axes: 2,
        outputs: 8,
        inputs: 6,
        has_spindle_pwm: true,
        has_spindle_encoder: true,
        analog: retrace_link::AnalogCounts::new(6, 2),
        window: 0,
        memory: 0,
        tick_hz: 1_000_000,
        min_period_us: 100,
        max_period_us: 10_000,
        max_pulses_hz: 250_000,
    }
}

/// One pulse per period, in the units of a homing speed.
pub(crate) const PULSE: i64 = 1 << 32;

/// Any rate from `low` up to `high`, in whole records per period.
pub(crate) fn rates(low: i64, high: i64) -> impl Strategy<Value = Rate> + Clone {
    (low << 32..high << 32).prop_map(Rate::from_units)
}

/// Stops within [`STOPS_WITHIN`] periods; a fault switches output 3 and the spindle off.
pub(crate) fn settings(epoch: u16, start: u32) -> CardSettings<2> {
    let axis = PulseLimits { velocity: 30 << 32, acceleration: 8 << 32, jerk: 1 << 32 };
    let limits = RateLimits::new(13, 1 << 15, [axis; 2]).expect("valid");
    let braking = Braking::<32>::new(&limits).expect("brakes");
    assert_eq!(braking.periods() + 13, STOPS_WITHIN, "what the law says of these limits");
    let mut settings = CardSettings::new(epoch, PathStart::at(RecordIndex::new(start)), 1000, limits);
    let uses = [
        InputUse::Limit { axis: 0, upper: true },
        InputUse::Limit { axis: 0, upper: false },
        InputUse::Home { axis: 0 },
        InputUse::Door,
        InputUse::EmergencyStop,
        InputUse::Plain,
    ];
    settings.inputs = [InputSetting::default(); MAX_INPUTS];
    for (setting, used_for) in settings.inputs.iter_mut().zip(uses) {
        setting.used_for = used_for;
    }
    settings.watchdog_periods = 30;
    settings.safe[0] = OutputChange { channel: 3, value: 0 };
    settings.safe[1] = OutputChange { channel: channel::SPINDLE, value: 0 };
    settings.safe_count = 2;
    settings
}

/// Periods within which the cursor stands after its target has become zero.
pub(crate) const STOPS_WITHIN: u32 = 45;

/// A card that was opened at record `start`.
pub(crate) fn opened(start: u32) -> TestCard {
    let mut card = TestCard::new(identity()).expect("a memory");
    card.open(&settings(1, start)).expect("fit");
    card
}

/// The record of a place: some motion on both axes, a planned stop at every 16th boundary.
pub(crate) fn record(place: u32) -> Record<2> {
    let scramble = place.wrapping_mul(0x9E37_79B9) >> 16;
    let kind = if place & 8 != 0 { Flags::RAPID } else { Flags::NONE };
    let flags = if place % 16 == 15 { kind.with(Flags::REST) } else { kind };
    let increments = [(scramble % 61) as i16 - 30, (scramble / 61 % 61) as i16 - 30];
    let cap = if place.is_multiple_of(7) { RapidCap::sixteenths(40) } else { RapidCap::PLANNED };
    Record { increments, line: place, flags, cap, ..Record::default() }
}

/// Is the path at rest before this record?
pub(crate) fn rests_before(place: u32, start: u32) -> bool {
    place == start || place.is_multiple_of(16)
}

/// What the axes have moved from the start of record `start` to `to`, reckoned record by record.
pub(crate) fn moved(start: u32, to: Place) -> [i64; 2] {
    let mut sum = [0i64; 2];
    let mut place = start;
    let forward = Place::start_of(RecordIndex::new(start)).distance_to(to) >= Distance::ZERO;
    while place != to.record.number() {
        let n = if forward { place } else { place.wrapping_sub(1) };
        for (axis, sum) in sum.iter_mut().enumerate() {
            let increment = i64::from(record(n).increments[axis]);
            *sum += if forward { increment } else { -increment };
        }
        place = if forward { place.wrapping_add(1) } else { n };
    }
    for (axis, sum) in sum.iter_mut().enumerate() {
        // half away from zero, in 128 bits
        let increment = i128::from(record(to.record.number()).increments[axis]);
        let doubled = 2 * increment.abs() * i128::from(to.fraction) + (1 << 32);
        let part = (doubled / (2 * (1 << 32))) as i64;
        *sum += if increment < 0 { -part } else { part };
    }
    sum
}

/// These inputs, nothing turned, nothing failed.
pub(crate) fn levels(levels: u16) -> InputLevels {
    InputLevels { levels, ..InputLevels::default() }
}
