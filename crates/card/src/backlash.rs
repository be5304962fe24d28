//! Backlash: where an axis reverses, its drive first crosses the lost motion between itself and what it moves (REV,
//! *Off the path*).
//!
//! Backlash has two sides, and the drive is at the one toward which it moved last. The first motion is assumed to find
//! it at that side. The pulses belong to no place of the path: they are emitted at the pins in addition to those of the
//! path, and are counted nowhere.
//!
//! Invariant: the additional pulses sum to 0 or the whole backlash, or to a value in between while it is being crossed;
//! during that time the machine does not count as at rest. No period exceeds the axis' velocity limit by more than one
//! pulse.

use retrace_core::limits::PulseLimits;

use crate::checked_settings::CheckedSettings;

/// Backlash state of one axis.
#[derive(Clone, Copy, Debug)]
struct AxisBacklash {
    /// Direction of the last motion: 1, −1, or 0 if it never moved.
    side: i8,
    /// Pulses still to be emitted, toward that side.
    remaining: u16,
    /// Number of them emitted in the last period.
    pace: u16,
}

impl AxisBacklash {
    const NEW: Self = Self { side: 0, remaining: 0, pace: 0 };

    /// Returns the additional pulses of one period with this increment of the path; `whole` is the backlash in pulses.
    fn pulses_for(&mut self, increment: i32, whole: u16, limits: &PulseLimits, most: u16) -> i32 {
        let direction = increment.signum() as i8;
        if direction != 0 && direction != self.side {
            // The pulses emitted before it reversed again must now be emitted in the other direction.
            let made = whole.saturating_sub(self.remaining);
            (self.remaining, self.pace) = (if self.side == 0 { 0 } else { made }, 0);
            self.side = direction;
        }
        if self.remaining == 0 {
            return 0;
        }
        let (remaining, last) = (u32::from(self.remaining), u32::from(self.pace));
        let along = increment.unsigned_abs();
        let fastest = (limits.velocity >> 32).min(u64::from(most)) as u32;
        let slope = (limits.acceleration >> 32).clamp(1, u64::from(u16::MAX)) as u32;
        // If it slows down each period by as much as it may accelerate, it ends within the remaining pulses.
        let ends = |pace: u32| u64::from(pace) * u64::from(pace + slope) <= 2 * u64::from(slope) * u64::from(remaining);
        let pace = match last + slope {
            faster if ends(faster) => faster,
            _ if ends(last) => last,
            _ => last.saturating_sub(slope),
        };
        let room = fastest.saturating_sub(along).max(1).min(u32::from(most).saturating_sub(along));
        // at most the remaining pulses, which are a u16
        self.pace = pace.max(1).min(room).min(remaining) as u16;
        self.remaining -= self.pace;
        i32::from(self.side) * i32::from(self.pace)
    }
}

/// Backlash of all axes. The side of each axis persists across epochs.
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
    /// Creates the state of axes that have never moved.
    #[must_use]
    pub const fn new() -> Self {
        Self { axes: [AxisBacklash::NEW; A] }
    }

    /// Whether backlash is being taken up.
    #[must_use]
    pub fn is_taking_up(&self) -> bool {
        self.axes.iter().any(|backlash| backlash.remaining != 0)
    }

    /// Returns the pulses to emit at the pins in a period with these increments of the path.
    #[must_use]
    pub fn add_compensation(&mut self, increments: &[i32; A], settings: &CheckedSettings<A>) -> [i32; A] {
        let values = settings.settings();
        let mut pulses = *increments;
        for (axis, (backlash, pulses)) in self.axes.iter_mut().zip(&mut pulses).enumerate() {
            *pulses += backlash.pulses_for(
                *pulses,
                values.backlash_pulses[axis],
                &values.limits.axes()[axis],
                settings.max_increment(),
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
        let mut backlash = AxisBacklash::NEW;
        assert_eq!(backlash.pulses_for(5, 40, &LIMITS, 100), 0);
        let mut made = vec![backlash.pulses_for(-1, 40, &LIMITS, 100)];
        while backlash.remaining != 0 {
            made.push(backlash.pulses_for(0, 40, &LIMITS, 100));
        }
        assert_eq!(made.iter().sum::<i32>(), -40);
        assert!(made.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= 3) && made[0] == -3, "{made:?}");
        assert!(made.len() < 12 && made[made.len() - 1] >= -4, "{made:?}");
        assert_eq!(backlash.pulses_for(-9, 40, &LIMITS, 100), 0);
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        /// Any increments: what came out added them lies between the sides and is a side where it rests. What is
        /// driven, which has that backlash, is then where the path says; but not where the axis turned again before it
        /// had come to the side, until it next has.
        #[test]
        fn what_is_driven_is_where_the_path_says(
            whole in 0u16..300,
            walk in prop::collection::vec((-30i64..=30, 0u32..40), 1..60),
        ) {
            let (mut backlash, mut motor, mut path, mut carried) = (AxisBacklash::NEW, 0i64, 0i64, 0i64);
            let whole_play = i64::from(whole);
            let (mut first, mut exact) = (0, true);
            for (increment, pause) in walk {
                for n in 0..=pause {
                    let increment = if n == 0 { increment } else { 0 };
                    if first == 0 { first = increment.signum(); }
                    let (side, left) = (backlash.side, backlash.remaining);
                    let added = backlash.pulses_for(increment as i32, whole, &LIMITS, 60);
                    if backlash.side != side && side != 0 {
                        exact = left == 0;
                    }
                    prop_assert!((increment + i64::from(added)).abs() <= 40.max(increment.abs() + 1));
                    motor += increment + i64::from(added);
                    path += increment;
                    // the driven part is pushed by one side of the gap or the other
                    let [low, high] = if first > 0 { [motor, motor + whole_play] } else { [motor - whole_play, motor] };
                    carried = carried.clamp(low, high);
                    let added = (motor - path) * -first;
                    prop_assert!((0..=whole_play).contains(&added), "{added} of {whole}");
                    if backlash.remaining == 0 {
                        prop_assert!(added == 0 || added == whole_play);
                        prop_assert!(!exact || carried == path, "{carried} {path}");
                    }
                }
            }
        }

        /// Nothing panics, and no period holds more than fits.
        #[test]
        fn any_numbers_are_borne(
            increments in prop::collection::vec(-500i32..=500, 1..40), whole in any::<u16>(),
                velocity in any::<u64>(), acceleration in any::<u64>(),
        ) {
            let mut backlash = AxisBacklash::NEW;
            let limits = PulseLimits { velocity, acceleration, jerk: 1 };
            for increment in increments {
                prop_assert!((increment + backlash.pulses_for(increment, whole, &limits, 500)).abs() <= 500);
            }
        }
    }
}
