//! Fine interpolation: spreads the increment of one period into evenly spaced pulses (glossary, *fine interpolation*).
//!
//! Invariant: a period of `slots` slots with an increment of p pulses yields exactly |p| pulses. The distances between
//! neighbouring pulses differ by at most one slot. The first pulse is not in slot 0, so that the direction signal is
//! set up before it.

/// Generator of the evenly spaced pulses of one axis in one control period, slot by slot.
///
/// # Examples
///
/// ```
/// use retrace_core::fine::PulseSlots;
///
/// let mut slots = PulseSlots::new(3, 9);
/// let pulses: Vec<bool> = (0..9).map(|_| slots.next_slot()).collect();
/// assert_eq!(pulses.iter().filter(|&&pulse| pulse).count(), 3);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct PulseSlots {
    pulses: u32,
    slots: u32,
    accumulator: u32,
}

impl PulseSlots {
    /// Creates the generator for `pulses` pulses (at most `slots`) in a period of `slots` slots (below 2³¹).
    #[must_use]
    pub const fn new(pulses: u16, slots: u32) -> Self {
        Self { pulses: pulses as u32, slots, accumulator: slots / 2 }
    }

    /// Advances by one slot. Returns whether a pulse falls into it.
    pub const fn next_slot(&mut self) -> bool {
        self.accumulator += self.pulses;
        if self.accumulator >= self.slots {
            self.accumulator -= self.slots;
            true
        } else {
            false
        }
    }
}

/// Returns the slot of each pulse, in order: the k-th of p pulses falls into the slot where `k·slots/p` is half passed.
///
/// The spacing equals that of [`PulseSlots`]; empty slots are skipped without iteration.
pub fn pulse_slots(pulses: u16, slots: u32) -> impl Iterator<Item = u32> {
    let p = u64::from(pulses);
    let half = u64::from(slots / 2);
    (1..=p).map(move |k| ((k * u64::from(slots) - half).div_ceil(p) - 1) as u32)
}

/// Returns how many of `pulses` pulses are emitted by the end of a part of the period, where `part` counts from 0 in
/// parts of 2⁻¹⁶. A pulse that falls into the part counts, as [`pulse_slots`] has it for 2¹⁶ slots (PRB-1).
#[must_use]
pub const fn emitted_pulses(pulses: u16, part: u16) -> u16 {
    let emitted = ((part as u32 + 1) * pulses as u32 + (1 << 15)) >> 16;
    if emitted < pulses as u32 { emitted as u16 } else { pulses }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Covers every count of pulses in every period up to 64 slots, and some long periods.
    #[test]
    fn exactly_p_pulses_evenly_spaced() {
        let cases = (1..=64u32).flat_map(|s| (0..=s as u16).map(move |p| (p, s)));
        for (p, s) in cases.chain([(100, 1000), (999, 1000), (333, 84_000), (32_767, 84_000)]) {
            let mut fine = PulseSlots::new(p, s);
            let (mut last, mut count, mut gaps) = (None, 0u32, (u32::MAX, 0));
            let mut slots = pulse_slots(p, s);
            for slot in 0..s {
                if fine.next_slot() {
                    assert_eq!(slots.next(), Some(slot), "{p} in {s}");
                    count += 1;
                    if let Some(l) = last {
                        gaps = (gaps.0.min(slot - l), gaps.1.max(slot - l));
                    }
                    last = Some(slot);
                }
            }
            assert_eq!(count, u32::from(p), "{p} pulses in {s} slots");
            assert_eq!(slots.next(), None);
            assert!(count < 2 || gaps.1 - gaps.0 <= 1, "{p} in {s}: {gaps:?}");
        }
    }

    #[test]
    fn pulses_are_emitted_by_the_part_of_the_period_that_they_fall_into() {
        for p in [0, 1, 2, 3, 7, 100, 249, 1000, 32_767] {
            let slots: Vec<u32> = pulse_slots(p, 1 << 16).collect();
            for part in (0..=u16::MAX).step_by(13).chain([u16::MAX]) {
                let emitted = slots.iter().filter(|&&slot| slot <= u32::from(part)).count();
                assert_eq!(usize::from(emitted_pulses(p, part)), emitted, "{p} pulses by part {part}");
            }
        }
    }

    #[test]
    fn the_direction_has_time_before_the_first_pulse() {
        for s in 4..=200u32 {
            for p in 1..=(s / 2) as u16 {
                assert!(pulse_slots(p, s).next().unwrap_or(0) >= 1 || u32::from(p) * 2 > s - 1, "{p} in {s}");
            }
        }
    }
}
