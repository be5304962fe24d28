//! What the records that the cursor may come to ask of the axes: a survey of their increments (REV, *Rate law*).
//!
//! Increments are whole pulses, so that neighbours differ by rounding alone. The survey looks at sums of eight, and at differences of such
//! sums over strides of 8, 16 and 32 records: the longer the stride, the finer the figure, and what a short one does not tell from rounding
//! moves no axis by more than that.
//!
//! Invariant: no figure is above what the plan may ask of the axis at the least cap of these records. What is not held, and does not lie
//! behind a planned stop, counts as if it asked for all that it may.

use super::slope::{highest_acceleration, highest_jerk};
use super::{DirectedWindow, RecordWindow};
use crate::Travel;
use crate::limits::{PulseLimits, RateLimits};

/// Records of a block.
const BLOCK: u32 = 8;
/// Blocks looked at on either side of what the cursor may come to.
const MARGIN: u32 = 2;
/// Blocks kept: the longest stride is four blocks, and a second difference takes two of them.
const KEPT: usize = 8;

/// The most that records ask of an axis at rate one, in units of 2⁻³² pulses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct AxisBounds {
    /// Largest increment |q′|, a period.
    pub(super) velocity: u64,
    /// Largest second difference |q″|, a period².
    pub(super) acceleration: u64,
    /// Largest third difference |q‴|, a period³.
    pub(super) jerk: u64,
}

/// What a stretch of records asks of all axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct IncrementBounds<const A: usize> {
    pub(super) demands: [AxisBounds; A],
    /// Least and greatest cap among the records, in sixteenths.
    pub(super) min_cap: u8,
    pub(super) max_cap: u8,
}

/// Largest differences of sums over 1, 2 and 4 blocks, in pulses.
#[derive(Clone, Copy, Default)]
struct IncrementDifferences {
    /// Sums over two blocks.
    first: u32,
    second: [u32; 3],
    third: [u32; 2],
}

impl<const A: usize> IncrementBounds<A> {
    /// Looks at the records from the cursor on, `reach` (in records) along the way and a few beyond.
    pub(super) fn of(limits: &RateLimits<A>, way: &DirectedWindow<'_, A, impl RecordWindow<A>>, reach: Travel) -> Self {
        let (first, count) = way.stretch(reach);
        let (mut min_cap, mut max_cap) = (u8::MAX, 16);
        for k in 0..count {
            let cap = way.road.cap(first.wrapping_add(k)).get();
            (min_cap, max_cap) = (min_cap.min(cap), max_cap.max(cap));
        }
        let min_cap = min_cap.clamp(16, max_cap);
        let start = (first & !(BLOCK - 1)).wrapping_sub(MARGIN * BLOCK);
        let blocks = (first.wrapping_add(count).wrapping_sub(start)).div_ceil(BLOCK) + MARGIN;
        let (differences, known) = look(way, start, blocks);
        let mut demands = [AxisBounds::default(); A];
        for ((demand, axis), found) in demands.iter_mut().zip(limits.axes()).zip(&differences) {
            let most = AxisBounds::most(limits, axis, min_cap);
            *demand = match known {
                KnownBounds::All => found.demand(most),
                KnownBounds::Most => found.demand(most).widened(most),
                KnownBounds::Little => most,
            };
        }
        Self { demands, min_cap, max_cap }
    }
}

/// How much of the stretch is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum KnownBounds {
    All,
    /// All but blocks at its ends.
    Most,
    Little,
}

/// The largest differences of `blocks` blocks from record `start` on.
fn look<const A: usize>(
    way: &DirectedWindow<'_, A, impl RecordWindow<A>>,
    start: u32,
    blocks: u32,
) -> ([IncrementDifferences; A], KnownBounds) {
    let mut differences = [IncrementDifferences::default(); A];
    let mut kept = [[0; A]; KEPT];
    let (mut held, mut missing) = (0, 0);
    for b in 0..blocks {
        let Some(sum) = way.block(start.wrapping_add(b * BLOCK), BLOCK) else {
            missing += 1;
            held = 0;
            continue;
        };
        kept[b as usize % KEPT] = sum;
        held += 1;
        for (axis, found) in differences.iter_mut().enumerate() {
            found.take(held, |back| kept[(b as usize + KEPT - back) % KEPT][axis]);
        }
    }
    let known = match missing {
        0 => KnownBounds::All,
        _ if blocks - missing >= 4 && missing <= 2 * (MARGIN + 1) => KnownBounds::Most,
        _ => KnownBounds::Little,
    };
    (differences, known)
}

impl IncrementDifferences {
    /// Takes in a block; `sum` gives the sums of it and of the `held` − 1 before it.
    fn take(&mut self, held: usize, sum: impl Fn(usize) -> i32) {
        let over = |from: usize, blocks: usize| (from..from + blocks).map(&sum).sum::<i32>();
        if held >= 2 {
            self.first = self.first.max(over(0, 2).unsigned_abs());
        }
        for (k, largest) in self.second.iter_mut().enumerate() {
            let stride = 1 << k;
            if held >= 2 * stride {
                *largest = (*largest).max((over(0, stride) - over(stride, stride)).unsigned_abs());
            }
        }
        for (k, largest) in self.third.iter_mut().enumerate() {
            let stride = 1 << k;
            if held >= 3 * stride {
                let third = over(0, stride) - 2 * over(stride, stride) + over(2 * stride, stride);
                *largest = (*largest).max(third.unsigned_abs());
            }
        }
    }

    /// What they ask, `most` at most.
    ///
    /// A second difference of rounded positions is off by 2 pulses, a third by 4. Over short strides that much is left out, as it moves the
    /// axis by no more than rounding does; over the longest nothing is. A peak lies up to half a block from the middle of a stride, and the
    /// stride's mean is below it: by the jerk times half a block.
    fn demand(&self, most: AxisBounds) -> AxisBounds {
        let part = |pulses: u32, slack: u32, bits: u32| (u64::from(pulses.saturating_sub(slack)) << 32) >> bits;
        let jerk = part(self.third[0], 4, 9).max(part(self.third[1], 4, 12)).min(most.jerk);
        let [short, middle, long] = self.second;
        let steady = part(short, 2, 6).max(part(middle, 1, 8)).max(part(long, 0, 10));
        let acceleration = (steady + 4 * jerk).min(most.acceleration);
        let velocity = (part(self.first + 1, 0, 4) + 19 * jerk).min(most.velocity);
        AxisBounds { velocity, acceleration, jerk }
    }
}

impl AxisBounds {
    /// All that the plan may ask of an axis in records that have caps from `cap` sixteenths on.
    fn most<const A: usize>(limits: &RateLimits<A>, axis: &PulseLimits, cap: u8) -> Self {
        let per_cap = |figure: u64, power: u8| {
            if cap == 16 { figure } else { (0..power).fold(figure, |f, _| (f * 16).div_ceil(u64::from(cap))) }
        };
        Self {
            velocity: per_cap(axis.velocity, 1),
            acceleration: per_cap(highest_acceleration(limits, axis), 2),
            jerk: per_cap(highest_jerk(limits, axis), 3),
        }
    }

    /// The same where up to two blocks at an end are not seen.
    fn widened(self, most: Self) -> Self {
        let unseen = u64::from(2 * BLOCK);
        let acceleration = (self.acceleration + unseen * most.jerk).min(most.acceleration);
        let velocity = (self.velocity + unseen * acceleration).min(most.velocity);
        Self { velocity, acceleration, jerk: most.jerk }
    }
}
