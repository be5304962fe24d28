//! More look-ahead and a looser tolerance never cost time, as far as the search for gates achieves it.

use crate::common;
use crate::plan::wandering;

use common::*;
use retrace_motion::{FeedRate, MachineLimits, PathMode, PlanMode, Planner};

/// Numbers from a seed, 0 up to 1 (SplitMix64).
pub(crate) struct Numbers(pub(crate) u64);

impl Numbers {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        low + (high - low) * ((mixed ^ (mixed >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// A spiral out and in again in chords of 0.05 to 0.3 mm, rounded to micrometres.
pub(crate) fn spiral(numbers: &mut Numbers) -> Vec<Move> {
    let least = numbers.between(2.0, 6.0);
    let (most, feed) = (least + numbers.between(5.0, 25.0), numbers.between(40.0, 100.0));
    let growth = numbers.between(0.3, 3.3) / std::f64::consts::TAU;
    let (mut angle, mut radius, mut outward) = (0.0f64, least, 1.0);
    let mut chord = || {
        let turn = numbers.between(0.05, 0.3) / radius;
        angle += turn;
        radius += outward * growth * turn;
        outward = if radius > most {
            -1.0
        } else if radius < least {
            1.0
        } else {
            outward
        };
        let at = |x: f64| (radius * x * 1000.0).round() / 1000.0;
        let path = Path::Line([at(angle.cos()), at(angle.sin()), 0.0]);
        Move { path, feed: FeedRate::PerSecond(feed), mode: PathMode::blend(0.05), stop: false }
    };
    (0..1500).map(|_| chord()).collect()
}

/// Control periods of a program with a look-ahead of `blocks` blocks.
fn periods(plan_mode: PlanMode, moves: &[Move], blocks: usize) -> f64 {
    let planner = Planner::with_look_ahead(MachineLimits::built_in(), [0.0; 3], blocks).expect("valid limits");
    play_on(planner.with_plan_mode(plan_mode), moves, usize::MAX).records.len() as f64
}

/// A plan over the whole path is no slower than one over a window: one slow block does not hold down everything behind
/// it. Nor does it matter for the refined plan where its windows begin.
#[test]
fn unlimited_look_ahead_is_no_slower_than_a_window() {
    for plan_mode in [PlanMode::Fast, PlanMode::Best] {
        let mut numbers = Numbers(21);
        let mut worst = 0.0f64;
        for _ in 0..16 {
            let moves = spiral(&mut numbers);
            worst = worst.max(periods(plan_mode, &moves, usize::MAX) / periods(plan_mode, &moves, 400));
        }
        println!("{plan_mode:?}: a path takes {worst} times as long as with a window at worst");
        assert!(worst <= 1.002, "{plan_mode:?}: a path takes {worst} times as long as with a window");
    }
}

/// The same on chains of short lines in which the direction wanders.
#[test]
fn unlimited_look_ahead_is_no_slower_on_wandering_roads() {
    let mut worst = [0.0f64; 2];
    for (seed, size, wander) in [(1, -0.5, -0.5), (2, -0.7, -1.0), (3, -1.0, -0.3), (4, -0.4, 0.0), (5, -1.5, -1.5)] {
        let moves = wandering(seed, size, wander, PathMode::blend(0.03));
        for (plan_mode, worst) in [PlanMode::Fast, PlanMode::Best].into_iter().zip(&mut worst) {
            let [whole, window] = [usize::MAX, 400].map(|blocks| periods(plan_mode, &moves, blocks));
            println!("{plan_mode:?}, road {seed}: {whole} periods as a whole, {window} with a window");
            *worst = worst.max(whole / window);
        }
    }
    println!("roads take {worst:?} times as long as with a window at worst");
    assert!(worst[1] <= 1.002, "roads take {worst:?} times as long as with a window");
}

/// Long and short edges in turn: sharp corners, which are glided, and slight ones, which are rounded.
fn bezel([sharp, slight]: [f64; 2], [long, short]: [f64; 2], tolerance_mm: f64) -> Vec<Move> {
    let (mut at, mut heading) = ([0.0f64; 3], 0.0f64);
    let edge = |k: usize| {
        let (length, turn) = match k % 4 {
            0 => (long, sharp),
            2 => (long, -sharp),
            _ => (short, slight),
        };
        at = [at[0] + length * heading.cos(), at[1] + length * heading.sin(), 0.0];
        heading += turn;
        let feed = FeedRate::PerSecond(60.0);
        Move { path: Path::Line(at), feed, mode: PathMode::blend(tolerance_mm), stop: false }
    };
    (0..12).map(edge).collect()
}

/// Where glides and roundings alternate, a plan is found for every section, and a looser tolerance costs no time.
#[test]
fn a_looser_tolerance_is_no_slower_among_glides_and_roundings() {
    let (mut stops, mut programs) = (0, 0);
    let mut times = [0usize; 3];
    for sharp in [0.8, 1.2, 1.57] {
        for slight in [0.2, 0.3, 0.4, 0.5] {
            for short in [1.5, 2.0, 2.5] {
                for long in [4.0, 6.0] {
                    for (tolerance_mm, time) in [0.1, 0.2, 0.4].into_iter().zip(&mut times) {
                        let moves = bezel([sharp, slight], [long, short], tolerance_mm);
                        let planner = Planner::new(MachineLimits::built_in(), [0.0; 3]).expect("valid limits");
                        let mut seen = 0;
                        let run = play_through(planner, &moves, usize::MAX, |planner, _| {
                            seen = planner.fallbacks().no_plan;
                        });
                        (*time, stops, programs) = (*time + run.records.len(), stops + seen, programs + 1);
                    }
                }
            }
        }
    }
    let [tight, middle, loose] = times.map(|time| time as f64);
    assert!(middle <= 1.01 * tight && loose <= 1.01 * middle, "{times:?} periods");
    assert!(stops == 0, "{stops} sections without a plan in {programs} programs");
}
