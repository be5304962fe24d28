//! Motion that takes a whole number of control periods (SMO-9).
//!
//! Invariant: what was within its limits stays within them, every place is still passed, and the chain still starts and
//! ends at rest.
//!
//! A chain of profiles that is run slower by the factor 1 + e, e ≥ 0, has its speeds divided by it, its accelerations
//! by its square and its jerk by its cube. So all of them only decrease, and the profiles stay continuous where they
//! meet. Only a chain between two stops can be slowed in this way: elsewhere the speed at its ends is fixed. There a
//! profile that rises above both of its ends takes longer if it rises less. The cost is less than one period per stop.

use super::{KinematicState, PathLimits, Profile, fastest};

/// Relative rounding up to which a chain counts as whole: no period is added for it.
const ROUNDING: f64 = 1e-12;

/// Slows the chain of `profiles` down until it takes a whole number of periods of `period` seconds, and returns that
/// number. The sum of the durations of the phases is then the number times the period, to a part in 10¹².
///
/// Returns `None`, with nothing changed, where the chain does not start and end at rest, is empty or takes no time, or
/// where `period` is not a positive, finite number.
pub fn whole_periods(profiles: &mut [Profile], period: f64) -> Option<u64> {
    let (first, last) = (profiles.first()?, profiles.last()?);
    if !(is_rest(first.start()) && is_rest(last.end())) {
        return None;
    }
    let duration: f64 = profiles.iter().map(Profile::duration).sum();
    let periods = (duration / period * (1.0 - ROUNDING)).ceil();
    if !(period > 0.0 && period.is_finite() && duration > 0.0 && periods >= 1.0 && periods < 2f64.powi(53)) {
        return None;
    }
    let factor = (periods * period / duration).max(1.0);
    for profile in profiles {
        *profile = slowed(profile, factor);
    }
    Some(periods as u64)
}

/// Profile to state `to` that takes `more` seconds longer because its highest speed is lower; it is nowhere faster than
/// before. `None` where it does not rise far enough above both of its ends, or where `more` is not above 0.
pub(crate) fn lengthened(profile: &Profile, to: KinematicState, more: f64) -> Option<Profile> {
    let (from, length) = (profile.start(), profile.end().s);
    let steepest = profile.ends().fold(from.a.abs(), |most, state| most.max(state.a.abs()));
    let (mut low, mut high) = (from.v.max(to.v), profile.crest().0);
    if profile.growth != 0.0 || profile.jerk <= 0.0 || low >= high || more <= 0.0 {
        return None;
    }
    let (wanted, mut best) = (profile.duration() + more, None);
    // Lower the speed until it takes too long or has no solution.
    for _ in 0..80 {
        let v = 0.5 * (low + high);
        let slower = fastest(from, to, length, PathLimits { v, a: steepest, j: profile.jerk });
        match slower {
            Ok(slower) if slower.jerk > 0.0 && slower.duration() <= wanted => (high, best) = (v, Some(slower)),
            _ => low = v,
        }
    }
    best.filter(|best| wanted - best.duration() <= 1e-13 + 1e-10 * more)
}

/// Profile over the same places in `factor` times the time.
pub(crate) fn slowed(profile: &Profile, factor: f64) -> Profile {
    let square = factor * factor;
    Profile {
        v0: profile.v0 / factor,
        a0: profile.a0 / square,
        jerk: profile.jerk / (square * factor),
        times: profile.times.map(|t| t * factor),
        growth: profile.growth / square,
    }
}

/// Whether the state is at rest, to the accuracy of the solver.
fn is_rest(state: KinematicState) -> bool {
    state.v.abs() <= 1e-9 && state.a.abs() <= 1e-6
}

#[cfg(test)]
mod tests {
    use super::super::{PathLimits, fastest};
    use super::*;
    use proptest::prelude::*;

    const LIMITS: PathLimits = PathLimits { v: 100.0, a: 900.0, j: 18_000.0 };

    /// Spans from stop to stop through gates with speed and acceleration.
    fn chain() -> impl Strategy<Value = Vec<Profile>> {
        let gate = (0.2..0.8f64, -1.0..1.0f64).prop_map(|(v, a)| KinematicState::moving(100.0 * v, 300.0 * a));
        (prop::collection::vec(gate, 0..6), 25.0..60.0f64).prop_map(|(gates, length)| {
            let mut states = vec![KinematicState::default()];
            states.extend(gates);
            states.push(KinematicState::default());
            states.windows(2).filter_map(|ends| fastest(ends[0], ends[1], length, LIMITS).ok()).collect()
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(1000))]

        #[test]
        fn a_chain_takes_whole_periods_and_stays_what_it_was(before in chain(), period in 1e-4..5e-3f64) {
            let mut after = before.clone();
            let periods = whole_periods(&mut after, period).expect("it is at rest at both ends");
            let sum = |chain: &[Profile]| chain.iter().map(Profile::duration).sum::<f64>();
            let whole = periods as f64 * period;
            prop_assert!((sum(&after) - whole).abs() <= 1e-12 * whole);
            prop_assert!(sum(&after) >= sum(&before) && sum(&after) <= sum(&before) + period * (1.0 + 1e-9));
            let mut state = KinematicState::default();
            for (old, new) in before.iter().zip(&after) {
                // It begins where the one before it ended, and ends at the same place.
                prop_assert!((new.v0 - state.v).abs() < 1e-8 && (new.a0 - state.a).abs() < 1e-6);
                state = new.end();
                prop_assert!((state.s - old.end().s).abs() <= 1e-11 * (1.0 + state.s));
                prop_assert!(new.jerk.abs() <= LIMITS.j);
                for k in 0..=50 {
                    let share = f64::from(k) / 50.0;
                    let (was, is) = (old.at(share * old.duration()), new.at(share * new.duration()));
                    prop_assert!(is.v <= was.v + 1e-9 && is.a.abs() <= was.a.abs() + 1e-7);
                    prop_assert!((is.s - was.s).abs() <= 1e-9);
                }
            }
            prop_assert!(is_rest(state));
        }

        /// A chain that is whole already is unchanged: no period is added, nothing gets slower twice.
        #[test]
        fn fitting_twice_is_fitting_once(chain in chain(), period in 1e-4..5e-3f64) {
            let (mut once, mut twice) = (chain.clone(), chain);
            let periods = whole_periods(&mut once, period);
            whole_periods(&mut twice, period);
            prop_assert_eq!(whole_periods(&mut twice, period), periods);
            for (a, b) in once.iter().zip(&twice) {
                prop_assert!((a.duration() - b.duration()).abs() <= 1e-12 * a.duration());
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        /// The profile takes longer by the requested time, between the same states, and is nowhere faster or steeper.
        #[test]
        fn what_is_lengthened_is_nowhere_faster(
            from in (0.0..0.9f64, -1.0..1.0f64), to in prop_oneof![Just((0.0, 0.0)), (0.0..0.9f64, -1.0..1.0f64)],
            length in 0.01..60.0f64, more in 1e-6..1e-3f64,
        ) {
            let state = |(v, a): (f64, f64)| KinematicState::moving(100.0 * v, a * (300.0 * v).min(300.0 * (1.0 - v)));
            let (from, to) = (state(from), state(to));
            let Ok(before) = fastest(from, to, length, LIMITS) else { return Ok(()) };
            let Some(after) = lengthened(&before, to, more) else {
                // With space above both ends, and a crest of constant speed, there is a solution.
                prop_assert!(before.crest().0 < from.v.max(to.v) + 5.0 || before.times[3] <= 0.01 || before.jerk < 0.0);
                return Ok(());
            };
            prop_assert!((after.duration() - before.duration() - more).abs() <= 1e-12);
            let end = after.end();
            prop_assert!((end.s - length).abs() <= 1e-11 && (end.v - to.v).abs() <= 1e-9
                && (end.a - to.a).abs() <= 1e-6);
            prop_assert!(after.jerk <= LIMITS.j);
            for k in 0..=100 {
                let is = after.at(after.duration() * f64::from(k) / 100.0);
                let was = before.at(before.time_at(is.s));
                prop_assert!(is.v <= was.v + 1e-6 && is.a.abs() <= LIMITS.a * (1.0 + 1e-9), "{:?} {:?}", is, was);
            }
        }
    }

    #[test]
    fn a_chain_in_motion_is_left_alone() {
        let (rest, moving) = (KinematicState::default(), KinematicState::moving(20.0, 0.0));
        let from_rest = fastest(rest, moving, 10.0, LIMITS).expect("there is room");
        let to_rest = fastest(moving, rest, 10.0, LIMITS).expect("there is room");
        for chain in [vec![], vec![from_rest], vec![to_rest], vec![to_rest, from_rest], vec![Profile::default()]] {
            let mut fitted = chain.clone();
            assert_eq!(whole_periods(&mut fitted, 1e-3), None);
            assert_eq!(fitted, chain);
        }
        for period in [0.0, -1e-3, f64::NAN, f64::INFINITY, 1e-300] {
            let chain = [from_rest, to_rest];
            let mut fitted = chain;
            assert_eq!(whole_periods(&mut fitted, period), None);
            assert_eq!(fitted, chain);
        }
    }
}
