//! The rule by which the host predicts the card's window, compared with the same rule in offsets that do not wrap.

use proptest::prelude::*;
use retrace_core::{Place, RecordIndex};
use retrace_link::CommandRefusal::{self, Full, InMotion, OutOfOrder};
use retrace_link::predicted_window::PredictedBounds;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    #[test]
    fn the_prediction_follows_the_rule(
        low in prop_oneof![Just(u32::MAX - 3), Just(0x7FFF_FFFE), any::<u32>()],
        window in 4u32..20,
        held in 0u32..20,
        cursor in 0u32..20,
        fraction in prop_oneof![Just(0u32), Just(1), Just(u32::MAX)],
        margin in 0u32..6,
        to in -2i64..22,
    ) {
        let (held, start) = (held.min(window), RecordIndex::new(low));
        let cursor = cursor.min(held);
        let fraction = if cursor == held { 0 } else { fraction };
        let bounds = PredictedBounds { low: start, high: start + held, window };
        let at = Place { record: start + cursor, fraction };
        let place = RecordIndex::new(low.wrapping_add(to as u32));
        let offsets = |after: Result<PredictedBounds, CommandRefusal>| {
            after.map(|after| {
                assert_eq!(after.window, window);
                (i64::from(after.low.since(start) as i32), i64::from(after.high.since(start) as i32))
            })
        };
        let (held, window, cursor, margin) =
            (i64::from(held), i64::from(window), i64::from(cursor), i64::from(margin));
        let ahead = cursor + i64::from(fraction != 0);
        let full = i64::from(held == window);
        let expected = match () {
            () if to != held => Err(OutOfOrder),
            () if held == window && cursor <= window / 4 => Err(Full),
            () => Ok((full, held + 1)),
        };
        prop_assert_eq!(offsets(bounds.after_ahead(place, at)), expected);
        let expected = match () {
            () if to != -1 => Err(OutOfOrder),
            () if held == window && held - ahead - margin <= window / 4 => Err(Full),
            () => Ok((-1, held - full)),
        };
        prop_assert_eq!(offsets(bounds.after_behind(place, at, margin as u32)), expected);
        let expected = match () {
            () if to < 0 || to > held => Err(OutOfOrder),
            () if to < ahead + margin => Err(InMotion),
            () => Ok((0, to)),
        };
        prop_assert_eq!(offsets(bounds.after_trim(place, at, margin as u32)), expected);
        let expected = match () {
            () if to < 0 || to > held => Err(OutOfOrder),
            () if cursor < to + margin => Err(InMotion),
            () => Ok((to, held)),
        };
        prop_assert_eq!(offsets(bounds.after_forget(place, at, margin as u32)), expected);
    }
}
