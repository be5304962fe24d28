//! Backlash: where an axis turns, its drive takes up the play between itself and what it moves (REV, *Off the path*).
//!
//! Play has two sides, and the drive is at the one toward which it went last. The first motion ever finds it at that side. These
//! pulses belong to no place of the path: they come out of the pins beside those of the path, and are counted nowhere.
//!
//! Invariant: what came out beside the path is 0 or the whole play, or on the way from one to the other; while it is on its way the machine
//! does not count as standing. No period is fuller than the axis' velocity allows, by more than one pulse at most.

use retrace_core::limits::PulseLimits;

use crate::CheckedSettings;

/// Does this build take up play? The feature `backlash`, which is on where nothing else is said. A card without it refuses settings that
/// have any.
pub(crate) const IS_COMPENSATED: bool = cfg!(feature = "backlash");

/// The play of one axis.
#[derive(Clone, Copy, Debug)]
struct AxisBacklash {
    /// The way that it went last: 1, −1, or 0 where it never went.
    side: i8,
    /// Pulses still to be made, toward that side.
    left: u16,
    /// How many of them were made in the last period.
    pace: u16,
}

impl AxisBacklash {
    const NEW: Self = Self { side: 0, left: 0, pace: 0 };

    /// One period with this increment of the path: pulses to be made beside it, of `whole` pulses of play.
    fn period(&mut self, increment: i32, whole: u16, limits: &PulseLimits, most: u16) -> i32 {
        let way = increment.signum() as i8;
        if way != 0 && way != self.side {
            // What was made before it turned again is what is to be made now.
            let made = whole.saturating_sub(self.left);
            (self.left, self.pace) = (if self.side == 0 { 0 } else { made }, 0);
            self.side = way;
        }
        if self.left == 0 {
            return 0;
        }
        let (left, last) = (u32::from(self.left), u32::from(self.pace));
        let along = increment.unsigned_abs();
        let fastest = (limits.velocity >> 32).min(u64::from(most)) as u32;
        let slope = (limits.acceleration >> 32).clamp(1, u64::from(u16::MAX)) as u32;
        // As much slower every period as it may become faster, it comes to its end within these.
        let ends = |pace: u32| u64::from(pace) * u64::from(pace + slope) <= 2 * u64::from(slope) * u64::from(left);
        let pace = match last + slope {
            faster if ends(faster) => faster,
            _ if ends(last) => last,
            _ => last.saturating_sub(slope),
        };
        let room = fastest.saturating_sub(along).max(1).min(u32::from(most).saturating_sub(along));
        // at most what is left, which is a u16
        self.pace = pace.max(1).min(room).min(left) as u16;
        self.left -= self.pace;
        i32::from(self.side) * i32::from(self.pace)
    }
}

/// The play of all axes. Which side each is at outlasts every epoch.
#[derive(Clone, Debug)]
pub struct BacklashCompensation<const A: usize> {
    axes: [AxisBacklash; A],
}

impl<const A: usize> Default for BacklashCompensation<A> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const A: usize> BacklashCompensation<A> {
    /// Axes that have never moved.
    #[must_use]
    pub const fn new() -> Self {
        Self { axes: [AxisBacklash::NEW; A] }
    }

    /// Is play being taken up?
    #[must_use]
    pub fn is_taking_up(&self) -> bool {
        IS_COMPENSATED && self.axes.iter().any(|play| play.left != 0)
    }

    /// A period with these increments of the path: the pulses that are to come out of the pins.
    #[must_use]
    pub fn period(&mut self, increments: &[i32; A], terms: &CheckedSettings<A>) -> [i32; A] {
        let settings = terms.settings();
        let mut pulses = *increments;
        for (axis, (play, pulses)) in self.axes.iter_mut().zip(&mut pulses).enumerate() {
            *pulses += play.period(
                *pulses,
                settings.backlash_pulses[axis],
                &settings.limits.axes()[axis],
                terms.max_increment(),
            );
        }
        pulses
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: PulseLimits = PulseLimits { velocity: 40 << 32, acceleration: 3 << 32, jerk: 1 << 32 };

    #[test]
    fn play_is_taken_up_with_ramps_and_the_first_way_is_taken_as_it_is() {
        let mut play = AxisBacklash::NEW;
        assert_eq!(play.period(5, 40, &LIMITS, 100), 0);
        let mut made = vec![play.period(-1, 40, &LIMITS, 100)];
        while play.left != 0 {
            made.push(play.period(0, 40, &LIMITS, 100));
        }
        assert_eq!(made.iter().sum::<i32>(), -40);
        assert!(made.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= 3) && made[0] == -3, "{made:?}");
        assert!(made.len() < 12 && made[made.len() - 1] >= -4, "{made:?}");
        assert_eq!(play.period(-9, 40, &LIMITS, 100), 0);
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        /// Any increments: what came out beside them lies between the sides and is a side where it rests. What is driven, which has that
        /// play, is then where the path says; but not where the axis turned again before it had come to the side, until it next has.
        #[test]
        fn what_is_driven_is_where_the_path_says(
            whole in 0u16..300,
            walk in prop::collection::vec((-30i64..=30, 0u32..40), 1..60),
        ) {
            let (mut play, mut motor, mut path, mut carried) = (AxisBacklash::NEW, 0i64, 0i64, 0i64);
            let whole_play = i64::from(whole);
            let (mut first, mut exact) = (0, true);
            for (increment, pause) in walk {
                for n in 0..=pause {
                    let increment = if n == 0 { increment } else { 0 };
                    if first == 0 { first = increment.signum(); }
                    let (side, left) = (play.side, play.left);
                    let beside = play.period(increment as i32, whole, &LIMITS, 60);
                    if play.side != side && side != 0 {
                        exact = left == 0;
                    }
                    prop_assert!((increment + i64::from(beside)).abs() <= 40.max(increment.abs() + 1));
                    motor += increment + i64::from(beside);
                    path += increment;
                    // the driven part is pushed by one side of the gap or the other
                    let [low, high] = if first > 0 { [motor, motor + whole_play] } else { [motor - whole_play, motor] };
                    carried = carried.clamp(low, high);
                    let beside = (motor - path) * -first;
                    prop_assert!((0..=whole_play).contains(&beside), "{beside} of {whole}");
                    if play.left == 0 {
                        prop_assert!(beside == 0 || beside == whole_play);
                        prop_assert!(!exact || carried == path, "{carried} {path}");
                    }
                }
            }
        }

        /// Nothing panics, and no period holds more than fits.
        #[test]
        fn any_numbers_are_borne(
            increments in prop::collection::vec(-500i32..=500, 1..40), whole in any::<u16>(), velocity in any::<u64>(), acceleration in any::<u64>(),
        ) {
            let mut play = AxisBacklash::NEW;
            let limits = PulseLimits { velocity, acceleration, jerk: 1 };
            for increment in increments {
                prop_assert!((increment + play.period(increment, whole, &limits, 500)).abs() <= 500);
            }
        }
    }
}
