//! Random cases for one axis.
//!
//! Invariant: a case depends on its number alone, and both its ends are legal.

use retrace_motion::profile::{KinematicState, PathLimits, fastest_any_way};

/// Two states, the distance between them, and the limits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Case {
    pub(crate) from: KinematicState,
    pub(crate) to: KinematicState,
    pub(crate) length: f64,
    pub(crate) limits: PathLimits,
}

/// SplitMix64 (Steele, Lea, Flood 2014).
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Evenly in [low, high).
    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Evenly in the logarithm.
    fn scale(&mut self, low: f64, high: f64) -> f64 {
        self.within(low.ln(), high.ln()).exp()
    }

    fn one_in(&mut self, n: u64) -> bool {
        self.next().is_multiple_of(n)
    }

    /// A speed and an acceleration that can be left and reached within the limits; often zero, or at a limit.
    fn state(&mut self, limits: PathLimits) -> KinematicState {
        let PathLimits { v: v_max, a: a_max, j } = limits;
        let v = match self.next() % 8 {
            0 => 0.0,
            1 => v_max,
            2 => -v_max,
            3 => v_max * self.scale(1e-6, 1.0),
            _ => self.within(-v_max, v_max),
        };
        let a = match self.next() % 8 {
            0 => 0.0,
            1 => a_max,
            2 => -a_max,
            3 => a_max * self.scale(1e-6, 1.0),
            _ => self.within(-a_max, a_max),
        };
        // Limit for taking the acceleration to zero, in the direction of either end.
        let room = (2.0 * j * (v_max - v.abs())).sqrt() * (1.0 - 1e-12);
        KinematicState { s: 0.0, v, a: a.clamp(-room, room) }
    }
}

/// Case `number`: half of them plain, the others near the borders of the families.
pub(crate) fn case(number: u64) -> Case {
    let mut dice = Dice(number.wrapping_mul(0xD134_2543_DE82_EF95));
    let limits = PathLimits { v: dice.scale(1.0, 1e3), a: dice.scale(50.0, 2e4), j: dice.scale(1e3, 1e6) };
    let (from, mut to) = (dice.state(limits), dice.state(limits));
    let sign = if dice.one_in(2) { 1.0 } else { -1.0 };
    let mut length = sign * dice.scale(1e-4, 1e3);
    match dice.next() % 16 {
        0 => to = from,
        1 => to = KinematicState { a: -from.a, ..from },
        2 => length *= 1e-6,
        3 => length = 0.0,
        4..=7 => length = border(&mut dice, from, to, length, limits),
        _ => {}
    }
    Case { from, to, length, limits }
}

/// A length where one kind of profile turns into another: where some phase of a neighbouring profile is just empty, or
/// the shortest one of the family.
fn border(dice: &mut Dice, from: KinematicState, to: KinematicState, length: f64, limits: PathLimits) -> f64 {
    let Ok(mut profile) = fastest_any_way(from, to, length, limits) else { return length };
    let emptied = (dice.next() % 7) as usize;
    profile.times[emptied] = 0.0;
    if dice.one_in(2) {
        profile.times[3] = 0.0;
    }
    let end = profile.end();
    // With a phase emptied, the profile misses the end; the fastest change from there on is near a border nevertheless.
    let there = KinematicState { s: 0.0, v: end.v.clamp(-limits.v, limits.v), a: 0.0 };
    let rest = fastest_any_way(there, to, 0.0, limits).map_or(0.0, |p| p.end().s);
    (end.s + rest).clamp(-1e3, 1e3) * if dice.one_in(2) { 1.0 } else { 1.0 + dice.within(-1e-9, 1e-9) }
}
