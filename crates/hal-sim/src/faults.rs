//! Faults of bytes on a serial line.
//!
//! Invariant: the faults depend on the seed and on how many bytes were sent before, on nothing else.

use crate::random::{Chance, Random};

/// A fault of a byte, or from a byte on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineFault {
    /// One of its bits is read wrong.
    Flip {
        /// The bit, 0 … 7.
        bit: u8,
    },
    /// The byte is lost.
    Drop,
    /// The byte arrives twice.
    Duplicate,
    /// The byte and those after it are lost.
    Cut {
        /// Number of bytes; 0: until the line has been silent for a moment.
        bytes: u32,
    },
    /// From the byte on nothing passes for a while.
    Stall {
        /// Duration, in microseconds.
        us: u32,
        /// Whether bytes that would have arrived meanwhile are lost, or arrive together at the end.
        lost: bool,
    },
}

/// Probability of each fault, per byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultRates {
    /// [`LineFault::Flip`] of a random bit.
    pub flip: Chance,
    /// [`LineFault::Drop`].
    pub drop: Chance,
    /// [`LineFault::Duplicate`].
    pub duplicate: Chance,
    /// [`LineFault::Cut`] to the end of the burst, or of up to [`FaultRates::MAX_CUT`] bytes.
    pub cut: Chance,
    /// [`LineFault::Stall`] of up to `stall_us`, half of them with loss.
    pub stall: Chance,
    /// The longest stall, in microseconds.
    pub stall_us: u32,
}

impl Default for FaultRates {
    fn default() -> Self {
        Self::all(Chance::NEVER)
    }
}

impl FaultRates {
    /// The longest random cut, in bytes: longer than the longest frame.
    pub const MAX_CUT: u32 = 300;

    /// Every kind with probability `chance`; stalls up to 50 ms.
    #[must_use]
    pub const fn all(chance: Chance) -> Self {
        Self { flip: chance, drop: chance, duplicate: chance, cut: chance, stall: chance, stall_us: 50_000 }
    }

    /// Draws the fault of the next byte, if any. At most one occurs.
    #[must_use]
    pub fn draw(&self, random: &mut Random) -> Option<LineFault> {
        let kinds = [self.flip, self.drop, self.duplicate, self.cut, self.stall];
        let mut rest = random.next() & 0xFFFF_FFFF;
        let kind = kinds.iter().position(|kind| {
            let parts = u64::from(kind.parts());
            let hit = rest < parts;
            rest = rest.wrapping_sub(parts);
            hit
        })?;
        Some(match kind {
            0 => LineFault::Flip { bit: random.up_to(7) as u8 },
            1 => LineFault::Drop,
            2 => LineFault::Duplicate,
            3 => LineFault::Cut { bytes: if random.up_to(1) == 0 { 0 } else { 1 + random.up_to(Self::MAX_CUT - 1) } },
            _ => LineFault::Stall { us: 1 + random.up_to(self.stall_us.saturating_sub(1)), lost: random.up_to(1) == 0 },
        })
    }

    /// Whether no fault can occur.
    #[must_use]
    pub fn are_none(&self) -> bool {
        [self.flip, self.drop, self.duplicate, self.cut, self.stall].iter().all(|&chance| chance == Chance::NEVER)
    }
}

/// Counters of the bytes that were sent over a channel, and of its faults.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineCounters {
    /// Bytes that were sent.
    pub sent: u64,
    /// Bytes that were delivered.
    pub delivered: u64,
    /// Bytes of these with a wrong bit.
    pub flipped: u64,
    /// Bytes that were lost one by one.
    pub dropped: u64,
    /// Bytes that arrived twice.
    pub duplicated: u64,
    /// Number of cuts.
    pub cuts: u64,
    /// Bytes lost in cuts.
    pub cut: u64,
    /// Stalls.
    pub stalls: u64,
    /// Bytes lost in stalls.
    pub stalled: u64,
    /// Bytes in flight at a reconnection that were lost.
    pub lost_at_reconnect: u64,
    /// Bytes of an old connection that arrived after a new one had begun.
    pub late: u64,
}

impl LineCounters {
    /// Whether any fault occurred.
    #[must_use]
    pub const fn faults(&self) -> u64 {
        self.flipped + self.dropped + self.duplicated + self.cuts + self.stalls + self.lost_at_reconnect + self.late
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each kind occurs as often as it should, with all of its forms.
    #[test]
    fn every_kind_is_drawn_at_its_rate() {
        let chance = |p| Chance::new(p).expect("a probability");
        let rates = FaultRates {
            flip: chance(0.01),
            drop: chance(0.02),
            duplicate: chance(0.03),
            cut: chance(0.04),
            stall: chance(0.05),
            stall_us: 3,
        };
        let (mut random, mut seen) = (Random::new(1), [0u32; 5]);
        let (mut bits, mut waits, mut losses, mut ends, mut longest) = (0u8, [0u32; 3], [0u32; 2], 0u32, 0);
        for _ in 0..100_000 {
            match rates.draw(&mut random) {
                None => {}
                Some(LineFault::Flip { bit }) => (seen[0], bits) = (seen[0] + 1, bits | 1 << bit),
                Some(LineFault::Drop) => seen[1] += 1,
                Some(LineFault::Duplicate) => seen[2] += 1,
                Some(LineFault::Cut { bytes }) => {
                    (seen[3], ends, longest) = (seen[3] + 1, ends + u32::from(bytes == 0), bytes.max(longest));
                }
                Some(LineFault::Stall { us, lost }) => {
                    seen[4] += 1;
                    waits[us as usize - 1] += 1;
                    losses[usize::from(lost)] += 1;
                }
            }
        }
        for (k, &count) in seen.iter().enumerate() {
            assert!((i64::from(count) - 1000 * (k as i64 + 1)).abs() < 350, "kind {k}: {count}");
        }
        assert_eq!((bits, longest), (255, FaultRates::MAX_CUT));
        assert!(ends > 1700 && ends < 2300 && waits.iter().all(|&n| n > 1400) && losses.iter().all(|&n| n > 2200));
    }

    #[test]
    fn nothing_happens_at_no_rate() {
        let mut random = Random::new(9);
        assert!(
            FaultRates::default().are_none() && (0..1000).all(|_| FaultRates::default().draw(&mut random).is_none())
        );
    }
}
