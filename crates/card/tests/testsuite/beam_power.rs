//! The power of a beam, as the card computes it in each control period (CUT-20).
//!
//! Invariant: the expected power is computed from the places of the cursor and the shares of the records alone.

use crate::common;

use common::{DOOR, TestCard, identity, levels, settings};
use proptest::prelude::*;
use retrace_card::spindle_pwm::PwmSignal;
use retrace_core::{FeedShare, Flags, Rate, Record, RecordIndex};
use retrace_link::{
    BeamPower, CardCore, CardIdentity, CardSettings, CardStatus, CommandRefusal, CuttingChannel, CuttingSettings,
    HostCommand, Instruction, LINEAR_POWER, MAX_POWER_EXPONENT, OutputChange, SpeedCurve, SpeedPoint, SpindlePwm,
    channel,
};

const BEAM: u8 = channel::SPINDLE;
const S: i32 = 1_000_000;
const PIERCE: u32 = 20;
const RECORDS: u32 = 60;

fn beam_settings(least: u16, lit_in_reverse: bool) -> CardSettings<2> {
    let mut settings = settings(1, 0);
    settings.safe_count = 0;
    settings.cutting = CuttingSettings { count: 1, handover_periods: 10, ..CuttingSettings::default() };
    settings.cutting.channels[0] =
        CuttingChannel { channel: BEAM, fires: true, standing_periods: 0, lit_in_reverse, proof: None };
    settings.cutting.beam_power =
        Some(BeamPower { channel: BEAM, least: FeedShare::from_units(least), exponent: LINEAR_POWER });
    settings
}

/// Share of the feed of a record: a ramp, the feed, a rapid move, and more than the feed.
fn share(place: u32) -> u16 {
    match place % 40 {
        0..10 => (place % 40) as u16 * 3000 + 500,
        10..25 => FeedShare::FEED.units(),
        25..30 => 0,
        _ => FeedShare::FEED.units() + 4000,
    }
}

struct Bench(TestCard);

impl Bench {
    /// A card with [`RECORDS`] records, and the beam lit by `value` with a pierce.
    fn lit(least: u16, lit_in_reverse: bool, value: i32) -> Self {
        Self::with(beam_settings(least, lit_in_reverse), value)
    }

    fn with(settings: CardSettings<2>, value: i32) -> Self {
        let mut card = TestCard::new(identity()).expect("a memory");
        card.open(&settings).expect("fit");
        for place in 0..RECORDS {
            let flags = if place == RECORDS - 1 { Flags::REST } else { Flags::NONE };
            let feed_share = FeedShare::from_units(share(place));
            let record = Record { increments: [5, 0], flags, feed_share, ..Record::default() };
            card.accept(HostCommand::Ahead { place: RecordIndex::new(place), record }).expect("room");
        }
        let mut bench = Self(card);
        let mut on = Instruction { number: 1, count: 2, periods: PIERCE, keeps_cutter: true, ..Instruction::default() };
        on.changes[0] = OutputChange { channel: channel::SPEED, value: S };
        on.changes[1] = OutputChange { channel: BEAM, value };
        bench.send(HostCommand::rate(Rate::ONE));
        bench.send(HostCommand::Instruction(on));
        bench
    }

    fn send(&mut self, command: HostCommand<2>) {
        self.0.accept(command).expect("it is taken");
    }

    fn period(&mut self, inputs: u16) -> CardStatus<2> {
        self.0.keep_alive();
        *self.0.run_period(levels(inputs))
    }
}

/// The law for a period between two statuses.
fn law(before: &CardStatus<2>, now: &CardStatus<2>, least: u16) -> f64 {
    let way = |status: &CardStatus<2>| f64::from(status.place.record.number()) + status.place.fraction_of_record();
    let [mut from, mut to] = [way(before), way(now)];
    if from > to {
        (from, to) = (to, from);
    }
    let mut speed = 0.0;
    for place in 0..RECORDS {
        let part = (to.min(f64::from(place) + 1.0) - from.max(f64::from(place))).max(0.0);
        speed += part * f64::from(share(place)) / 32_768.0;
    }
    match now.outputs[usize::from(BEAM)] {
        0 => 0.0,
        _ if speed == 0.0 => 0.0,
        1.. => f64::from(S),
        _ => f64::from(S) * speed.max(f64::from(least) / 32_768.0).min(1.0),
    }
}

proptest! {
    /// Whatever the operator does with the rate: in every period the power is that of the law.
    #[test]
    fn the_power_follows_the_law_in_every_period(
        m4: bool, least in prop_oneof![Just(0), 0u16..=1 << 15], in_reverse: bool,
        rates in prop::collection::vec((0i64..=8, 1u32..60), 1..8), turns: bool,
    ) {
        let mut bench = Bench::lit(least, in_reverse, if m4 { -1 } else { 1 });
        for _ in 1..PIERCE {
            let status = bench.period(0);
            prop_assert!(status.at_rest && status.beam_power == S, "it pierces at full power");
        }
        let mut before = *bench.0.status();
        let mut lit_periods = 0;
        for (number, &(eighths, periods)) in rates.iter().enumerate() {
            let sign = if turns && number % 2 == 1 { -1 } else { 1 };
            bench.send(HostCommand::rate(Rate::ONE * (sign * eighths) / 8));
            for _ in 0..periods {
                let now = bench.period(0);
                let expected = law(&before, &now, least);
                prop_assert!((f64::from(now.beam_power) - expected).abs() <= 1.0 + f64::from(S) / 32_768.0,
                    "{} {expected} {:?}", now.beam_power, now.place);
                prop_assert!(now.beam_power == 0 || now.rate != Rate::ZERO, "power at rest");
                prop_assert!(now.beam_power == 0 || now.rate > Rate::ZERO || in_reverse, "power backward");
                lit_periods += u32::from(now.beam_power != 0);
                before = now;
            }
        }
        prop_assert!(lit_periods > 0 || rates[0].0 == 0 || rates[0].1 < 20);
    }
}

#[test]
fn an_alarm_ends_the_power_in_its_period() {
    let mut bench = Bench::lit(0, false, -1);
    for _ in 0..PIERCE + 20 {
        bench.period(0);
    }
    assert!(bench.0.status().beam_power > 0);
    let status = bench.period(DOOR);
    assert_eq!((status.outputs[usize::from(BEAM)], status.beam_power), (0, 0));
}

/// The output for S has the power of the beam while it is on, and is low from the period of an alarm on.
#[test]
fn the_output_for_s_has_the_power_of_the_beam() {
    let mut settings = beam_settings(0, false);
    settings.spindle_pwm = Some(SpindlePwm { full_scale: 4 * S as u32, hz: 1000 });
    let mut bench = Bench::with(settings, -1);
    let mut lit = 0;
    for period in 0..PIERCE + 60 {
        let status = bench.period(if period == PIERCE + 45 { DOOR } else { 0 });
        let wanted = ((i64::from(status.beam_power) << 16) / (4 * i64::from(S))) as u32;
        assert_eq!(bench.0.spindle_pwm(), Some(PwmSignal { hz: 1000, duty: wanted }));
        lit += u32::from(wanted > 0);
    }
    assert!(lit > PIERCE + 20, "{lit}");
    assert_eq!(bench.0.spindle_pwm(), Some(PwmSignal { hz: 1000, duty: 0 }), "after an alarm");
}

#[test]
fn a_card_without_an_output_for_s_refuses_it() {
    let open = |identity, pwm| {
        let mut settings = settings(1, 0);
        settings.spindle_pwm = pwm;
        TestCard::new(identity).expect("a memory").open(&settings)
    };
    let pwm = SpindlePwm { full_scale: 1, hz: 100 };
    let without = CardIdentity { has_spindle_pwm: false, ..identity() };
    assert_eq!((open(without, None), open(without, Some(pwm))), (Ok(()), Err(CommandRefusal::Unsupported)));
    assert_eq!(open(identity(), Some(pwm)), Ok(()));
    for wrong in [
        SpindlePwm { full_scale: 0, ..pwm },
        SpindlePwm { full_scale: 1 << 31, ..pwm },
        SpindlePwm { full_scale: u32::MAX - 1, ..pwm },
        SpindlePwm { hz: 99, ..pwm },
        SpindlePwm { hz: 50_001, ..pwm },
    ] {
        assert_eq!(open(identity(), Some(wrong)), Err(CommandRefusal::Unsupported), "{wrong:?}");
    }
}

/// An output by a curve is low until the card has received one. A curve that does not rise is refused, and the one
/// before it stays; so does it in later epochs, and while an alarm is latched it is accepted.
#[test]
fn an_output_by_a_curve_is_low_until_the_curve_is_known() {
    let by_curve = Some(SpindlePwm { full_scale: SpindlePwm::BY_CURVE, hz: 100 });
    let mut card = TestCard::new(identity()).expect("a memory");
    let settings = CardSettings { spindle_pwm: by_curve, ..settings(1, 0) };
    card.open(&settings).expect("supported");
    for (channel, value) in [(channel::SPEED, 3000), (channel::SPINDLE, -1)] {
        card.accept(HostCommand::ManualOutput(OutputChange { channel, value })).expect("a channel");
    }
    let duty = |card: &mut TestCard| {
        card.run_period(levels(0));
        card.spindle_pwm().expect("used").duty
    };
    assert_eq!(duty(&mut card), 0);
    let curve = |points: &[(u32, u32)]| {
        let mut curve = SpeedCurve { count: points.len() as u8, ..SpeedCurve::default() };
        for (slot, &(speed, duty)) in curve.points.iter_mut().zip(points) {
            *slot = SpeedPoint { speed, duty };
        }
        HostCommand::SpeedCurve(curve)
    };
    card.accept(curve(&[(2000, 100), (4000, 500)])).expect("a curve");
    assert_eq!(duty(&mut card), 300);
    for wrong in [&[(1, 1)][..], &[(1, 1), (1, 2)], &[(2, 1), (1, 2)], &[(1, 1), (2, 65_537)], &[(1, 1), (1 << 31, 2)]]
    {
        card.accept(curve(wrong)).expect_err("no curve");
    }
    assert_eq!(duty(&mut card), 300);
    card.open(&CardSettings { epoch: 2, ..settings }).expect("at rest");
    assert_eq!(duty(&mut card), 300);
    let without = CardIdentity { has_spindle_pwm: false, ..identity() };
    let mut card = TestCard::new(without).expect("a memory");
    card.open(&CardSettings { spindle_pwm: None, ..settings }).expect("supported");
    card.accept(curve(&[(2000, 100), (4000, 500)])).expect_err("no output for S");
}

#[test]
fn a_card_without_a_power_output_refuses_it() {
    let without = CardIdentity { has_spindle_pwm: false, ..identity() };
    let mut card = TestCard::new(without).expect("a memory");
    assert_eq!(card.open(&beam_settings(0, false)), Err(CommandRefusal::Unsupported));
    let mut card = TestCard::new(identity()).expect("a memory");
    let mut other = beam_settings(0, false);
    let power = BeamPower { channel: BEAM, least: FeedShare::NONE, exponent: LINEAR_POWER };
    other.cutting.beam_power = Some(BeamPower { channel: 3, ..power });
    assert_eq!(card.open(&other), Err(CommandRefusal::Unsupported), "no channel that fires");
    other.cutting.beam_power = Some(BeamPower { least: FeedShare::from_units(40_000), ..power });
    assert_eq!(card.open(&other), Err(CommandRefusal::Unsupported), "more than the feed");
    for exponent in [0, MAX_POWER_EXPONENT + 1, u8::MAX] {
        other.cutting.beam_power = Some(BeamPower { exponent, ..power });
        assert_eq!(card.open(&other), Err(CommandRefusal::Unsupported), "{exponent}");
    }
    other.cutting.beam_power = Some(BeamPower { exponent: MAX_POWER_EXPONENT, ..power });
    assert_eq!(card.open(&other), Ok(()));
}
