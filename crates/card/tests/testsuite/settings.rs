//! What a card makes of its settings.

use crate::common::{identity, settings};
use retrace_card::{CheckedSettings, LinkedCard};
use retrace_link::{CardCore, CardIdentity};

/// The largest increment is the most pulses that the card can make in a period, and no more than the timing allows.
#[test]
fn an_increment_is_limited_by_the_fastest_pulses_of_the_card() {
    let good = settings(1, 0);
    for max_pulses_hz in [2_000, 9_999, 10_000, 99_500, 250_000, 1 << 30] {
        let checked = CheckedSettings::validate(&good, &CardIdentity { max_pulses_hz, ..identity() }).expect("fit");
        let (most, timing) = (checked.max_increment(), checked.timing().max_increment());
        let pulses_per_s = |pulses: u16| u64::from(pulses) * 1_000_000 / u64::from(good.period_us);
        assert!(most <= timing && pulses_per_s(most) <= u64::from(max_pulses_hz), "{most} at {max_pulses_hz}");
        assert!(most == timing || pulses_per_s(most + 1) > u64::from(max_pulses_hz), "{most} at {max_pulses_hz}");
    }
    let slow = CardIdentity { max_pulses_hz: 1_999, ..identity() };
    assert!(CheckedSettings::validate(&good, &slow).is_err(), "a pulse is reserved for rounding");
}

#[test]
fn a_card_on_a_line_has_the_numbers_that_are_set_at_run_time() {
    let mut card = LinkedCard::<2, 64, 32, 64>::new(identity()).expect("a memory");
    card.set_identity(0x1234_5678, 9);
    let known = card.card().identity();
    assert_eq!((known.serial, known.boot, known.axes, known.window), (0x1234_5678, 9, 2, 64));
}
