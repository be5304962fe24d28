//! Properties of whole plans, checked on the emitted records.

use crate::cases::cases;
use crate::common;

use common::*;
use proptest::prelude::*;
use retrace_core::{Flags, RapidCap, Record};
use retrace_motion::{FeedRate, MachineLimits, PathMode, PlanMode, Planner};

#[test]
fn moves_that_cannot_be_are_refused_by_number() {
    let mut planner = Planner::new(MachineLimits::built_in(), [0.0; 3]).expect("the built-in machine");
    let mut number = |end: f64, feed| {
        planner.line([end, 0.0, 0.0], feed, PathMode::ExactStop, 1).expect_err("no such move").number()
    };
    assert_eq!(number(f64::NAN, FeedRate::Rapid), "E4001");
    assert_eq!(number(1e7, FeedRate::Rapid), "E4001");
    assert_eq!(number(1.0, FeedRate::PerSecond(0.0)), "E4002");
    assert_eq!(number(1.0, FeedRate::Duration(f64::INFINITY)), "E4002");
}

/// A glide over a corner that nearly reverses begins beyond the corner. Where the motion before it cannot be brought
/// into it, the machine comes to rest there and goes back to the corner: it does not jump there.
#[test]
fn a_glide_that_begins_beyond_its_corner_and_is_not_reached_is_a_stop() {
    // Kind, logarithm of the length, turn and bend.
    let steps: Vec<Step> = [
        (0, 0.0, -0.429_396_000_568_669_44, 0.0),
        (5, 0.0, 0.0, -2.838_312_285_263_04),
        (0, 0.0, 0.0, 0.0),
        (5, 0.0, 0.014_556_635_261_716_563, 0.720_163_420_851_996_7),
        (5, 0.0, 0.012_303_953_699_394_979, 0.734_100_317_010_307_2),
        (0, 0.0, 0.0, 0.0),
        (0, 0.0, -1.851_780_754_220_106_6, 0.0),
        (0, 0.0, -0.442_128_768_124_062, 0.0),
        (0, -0.996_298_116_134_134_3, std::f64::consts::FRAC_PI_2, 0.0),
        (0, -1.729_329_422_774_750_9, 0.0, 0.0),
        (3, 0.0, 3.075_422_616_350_019_6, 0.0),
    ]
    .into_iter()
    .map(|(kind, size, turn, bend)| Step { kind, size, turn, bend, rise: 0.0, feed: 0.0, stop: false })
    .collect();
    let tolerance_mm = 0.121_026_068_655_943_74;
    let moves = program(&steps, PathMode::blend(tolerance_mm));
    let power = |x: [f64; 3]| x.map(|x| 10f64.powf(x));
    let limits = MachineLimits {
        velocity_mm_s: power([0.5; 3]),
        acceleration_mm_s2: power([3.274_296_730_932_639, 1.733_645_970_069_209, 1.0]),
        jerk_mm_s3: power([4.258_323_912_879_976, 5.225_213_084_606_006, 2.0]),
        pulses_per_mm: power([2.257_462_014_307_688, 2.257_462_014_307_688, 1.957_462_014_307_688]),
        path_velocity_mm_s: 10f64.powf(1.151_271_802_181_120_8),
        reserve: 0.0,
        period_s: 0.0002,
        feed_shares: false,
    };
    let run = play_in(PlanMode::Fast, limits, &moves, usize::MAX);
    assert_eq!(check(&limits, &moves, &run, tolerance_mm, 40), Ok(()));
}

pub(crate) fn mode() -> impl Strategy<Value = PathMode> {
    prop_oneof![
        Just(PathMode::ExactStop),
        Just(PathMode::ExactPath),
        Just(PathMode::blend(0.05)),
        (0.002..0.3f64).prop_map(PathMode::blend),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(cases(40)))]

    #[test]
    fn limits_ends_and_paths_are_kept(
        steps in prop::collection::vec(step(), 1..40), mode in mode(), plan_mode in plan_mode(),
    ) {
        let limits = MachineLimits::built_in();
        let moves = program(&steps, mode);
        let run = play_in(plan_mode, limits, &moves, usize::MAX);
        let tolerance = if let PathMode::Blend { tolerance_mm, .. } = mode { tolerance_mm } else { 0.0 };
        if let Err(broken) = check(&limits, &moves, &run, tolerance, 40) {
            prop_assert!(false, "{}", broken);
        }
    }

    /// Played faster by its cap, every record is within velocity, acceleration and jerk, measured over the records of a
    /// window.
    #[test]
    fn rapid_retrace_caps_leave_the_limits_whole(
        steps in prop::collection::vec(step(), 1..20), mode in mode(), plan_mode in plan_mode(),
    ) {
        let limits = MachineLimits::built_in();
        let run = play_in(plan_mode, limits, &program(&steps, mode), usize::MAX);
        let cap = |records: &[Record<3>]| records.iter().map(|r| f64::from(r.cap.get()) / 16.0).fold(8.0, f64::min);
        for n in 3..run.points.len() {
            for i in 0..3 {
                let [p, q, r, s] = std::array::from_fn(|k| run.points[n - 3 + k][i]);
                let noise = 1e-13 * (1.0 + p.abs());
                let (one, two, three) = (s - r, s - 2.0 * r + q, s - 3.0 * r + 3.0 * q - p);
                let (a, b, c) = (cap(&run.records[n..=n]), cap(&run.records[n - 1..=n]), cap(&run.records[n - 2..=n]));
                prop_assert!(a * one.abs() <= 0.1 * (1.0 + 1e-7) + noise * a);
                prop_assert!(b * b * two.abs() <= 0.9e-3 * (1.0 + 1e-7) + noise * b * b);
                prop_assert!(c.powi(3) * three.abs() <= 18e-6 * (1.0 + 1e-7) + noise * c.powi(3));
            }
        }
    }

    #[test]
    fn records_do_not_depend_on_when_they_are_asked_for(
        steps in prop::collection::vec(step(), 1..60), mode in mode(), plan_mode in plan_mode(), most in 0usize..40,
    ) {
        let moves = program(&steps, mode);
        let limits = MachineLimits::built_in();
        prop_assert_eq!(play_in(plan_mode, limits, &moves, usize::MAX), play_in(plan_mode, limits, &moves, most));
    }
}

/// A long chain of short lines, some nearly straight, some rough.
pub(crate) fn wandering(seed: u32, size: f64, wander: f64, mode: PathMode) -> Vec<Move> {
    let mut state = u64::from(seed) << 1 | 1;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / (1u64 << 24) as f64
    };
    let (mut at, mut heading) = ([0.0f64; 3], 0.0f64);
    (0..4000)
        .map(|k| {
            heading += 10f64.powf(wander) * (random() - 0.5) + if k % 400 == 399 { 2.0 } else { 0.003 };
            let length = 10f64.powf(size) * (0.1 + 2.0 * random());
            at = [
                at[0] + length * heading.cos(),
                at[1] + length * heading.sin(),
                at[2] + 0.1 * length * (random() - 0.5),
            ];
            let feed = FeedRate::PerSecond(if k / 700 % 2 == 0 { 100.0 } else { 20.0 });
            Move { path: Path::Line(at), feed, mode, stop: false }
        })
        .collect()
}

/// Plans lines that turn by these angles, to the left or not, with these lengths, and checks every set-point.
fn check_zigzag(plan_mode: PlanMode, turns: &[(f64, bool, f64)], tolerance_mm: f64) -> Result<(), String> {
    let (mut at, mut heading) = ([0.0f64; 3], 0.0f64);
    let turned = turns.iter().map(|&(turn, left, length)| {
        heading += if left { turn } else { -turn };
        at = [at[0] + length * heading.cos(), at[1] + length * heading.sin(), 0.0];
        Move { path: Path::Line(at), feed: FeedRate::Rapid, mode: PathMode::blend(tolerance_mm), stop: false }
    });
    let moves: Vec<Move> = turned.collect();
    let limits = MachineLimits::built_in();
    // Set-points leave half of the pulse diagonal for the rounding to whole pulses.
    let rounding = 0.5e-3 * 3f64.sqrt();
    let left = if tolerance_mm - rounding > 0.1 * tolerance_mm { tolerance_mm - rounding } else { 0.0 };
    check(&limits, &moves, &play_in(plan_mode, limits, &moves, usize::MAX), left, 3)
}

/// Found by the random test below: the glide of a corner of 144° was furthest from both lines between two of the places
/// at which its distance is checked.
#[test]
fn a_glide_stays_within_the_tolerance_between_the_places_that_are_checked() {
    let corner = [
        (0.580_638_410_141_346_2, true, 1.0),
        (2.519_758_709_851_751_5, true, 1.0),
        (0.384_032_214_815_010_8, true, 15.269_046_796_149_453),
        (2.707_587_146_275_54, true, 9.195_800_471_805_313),
    ];
    let turns = [&corner[..], &[(0.3, false, 1.0); 4]].concat();
    check_zigzag(PlanMode::Fast, &turns, 0.007_311_482_849_613_235).expect("within the tolerance");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(cases(16)))]

    /// Long chains of short lines, some nearly straight, some rough: re-planned and cut many times.
    #[test]
    fn dense_chains_keep_everything_too(
        seed in any::<u32>(), size in -2.5..-0.3f64, wander in -3.0..0.3f64, tolerance_mm in 0.005..0.1f64,
            most in 0usize..9,
    ) {
        let moves = wandering(seed, size, wander, PathMode::blend(tolerance_mm));
        let limits = MachineLimits::built_in();
        let run = play(limits, &moves, most);
        if let Err(broken) = check(&limits, &moves, &run, tolerance_mm, 4000) {
            prop_assert!(false, "{}", broken);
        }
        prop_assert_eq!(play(limits, &moves, usize::MAX), run);
    }

    /// Merging as the program requests it (G64 Q): within P whatever Q is.
    #[test]
    fn dense_chains_stay_within_the_tolerance_however_much_is_merged(
        plan_mode in plan_mode(), seed in any::<u32>(), size in -2.5..-0.3f64, wander in -3.0..0.3f64,
        tolerance_mm in 0.005..0.1f64,
            merge in 0.0..0.1f64,
    ) {
        let moves = wandering(seed, size, wander, PathMode::Blend { tolerance_mm, merge_mm: Some(merge) });
        let limits = MachineLimits::built_in();
        let run = play_in(plan_mode, limits, &moves, usize::MAX);
        if let Err(broken) = check(&limits, &moves, &run, tolerance_mm, 4000) {
            prop_assert!(false, "{}", broken);
        }
    }

    /// Corners between lines, sharp ones too: glides swing to both sides of their tracks, and beyond the ends of sharp
    /// ones.
    #[test]
    fn zigzags_stay_within_the_tolerance(
        plan_mode in plan_mode(), turns in prop::collection::vec((0.3..2.8f64, any::<bool>(), 1.0..20.0f64), 8),
        tolerance_mm in 0.005..0.1f64,
    ) {
        if let Err(broken) = check_zigzag(plan_mode, &turns, tolerance_mm) {
            prop_assert!(false, "{}", broken);
        }
    }

    /// Other machines: slow and fast, with different axes, long and short periods, coarse and fine pulses.
    #[test]
    fn any_machine_keeps_its_limits(
        steps in prop::collection::vec(step(), 1..30), mode in mode(), plan_mode in plan_mode(),
        v in [0.5..2.5f64, 0.5..2.5f64, 0.5..2.5f64], a in [1.0..4.0f64, 1.0..4.0f64, 1.0..4.0f64],
        j in [2.0..6.0f64, 2.0..6.0f64, 2.0..6.0f64], ppm in 1.0..3.3f64, path in 0.7..3.0f64,
            period_s in 2e-4..4e-3f64,
        reserve in 0.0..0.5f64,
    ) {
        let power = |x: [f64; 3]| x.map(|x| 10f64.powf(x));
        let limits = MachineLimits {
            velocity_mm_s: power(v),
            acceleration_mm_s2: power(a),
            jerk_mm_s3: power(j),
            pulses_per_mm: power([ppm, ppm, ppm - 0.3]),
            path_velocity_mm_s: 10f64.powf(path),
            reserve,
            period_s,
            feed_shares: false,
        };
        prop_assume!(limits.validate().is_ok());
        let moves = program(&steps, mode);
        let run = play_in(plan_mode, limits, &moves, usize::MAX);
        let tolerance = if let PathMode::Blend { tolerance_mm, .. } = mode { tolerance_mm } else { 0.0 };
        if let Err(broken) = check(&limits, &moves, &run, tolerance, 40) {
            prop_assert!(false, "{}", broken);
        }
    }

    /// Exact and blended moves in turn: the exact ones are exact.
    #[test]
    fn exact_moves_stay_exact_among_blended_ones(
        plan_mode in plan_mode(), steps in prop::collection::vec(step(), 2..60),
    ) {
        let limits = MachineLimits::built_in();
        let mut moves = program(&steps, PathMode::blend(0.05));
        for k in (0..moves.len()).filter(|k| k % 7 > 3) {
            moves[k].mode = if k % 7 == 6 { PathMode::ExactStop } else { PathMode::ExactPath };
        }
        let run = play_in(plan_mode, limits, &moves, usize::MAX);
        if let Err(broken) = check(&limits, &moves, &run, 0.05, 60) {
            prop_assert!(false, "{}", broken);
        }
        let (records, points) = run
            .records
            .iter()
            .zip(&run.points)
            .filter(|(record, _)| record.line > 0 && moves[record.line as usize - 1].mode != PathMode::blend(0.05))
            .unzip();
        let wrong = find_astray(&moves, &Run { records, points }, 60, 2e-5);
        prop_assert!(wrong.is_none(), "{:?}", wrong);
    }
}

#[test]
fn a_line_takes_as_long_as_the_closed_form_says() {
    let limits = MachineLimits::built_in();
    let (v, a, j) = (100.0f64, 900.0f64, 18_000.0f64);
    for length in [0.01, 0.1, 1.0, 4.5, 10.0, 16.0, 20.0, 100.0, 1500.0] {
        // seven segments; without the constant velocity; without the constant acceleration
        let seconds = if length >= v * (v / a + a / j) {
            length / v + v / a + a / j
        } else if length >= 2.0 * a * a * a / (j * j) {
            let half = a / (2.0 * j);
            2.0 * (half + (half * half + length / a).sqrt())
        } else {
            4.0 * (length / (2.0 * j)).cbrt()
        };
        let m =
            Move { path: Path::Line([length, 0.0, 0.0]), feed: FeedRate::Rapid, mode: PathMode::ExactStop, stop: true };
        let run = play(limits, &[m], 0);
        assert_eq!(run.records.len(), (seconds / limits.period_s - 1e-6).ceil() as usize, "{length} mm");
    }
}

#[test]
fn a_line_in_many_pieces_takes_as_long_as_in_one() {
    let limits = MachineLimits::built_in();
    let line = |n: usize, end: [f64; 3]| {
        let moves: Vec<Move> = (1..=n)
            .map(|k| Move {
                path: Path::Line(end.map(|x| x * k as f64 / n as f64)),
                feed: FeedRate::Rapid,
                mode: PathMode::ExactPath,
                stop: false,
            })
            .collect();
        play(limits, &moves, usize::MAX).records.len() as f64
    };
    for end in [[100.0, 0.0, 0.0], [80.0, 60.0, 0.0], [30.0, -70.0, 64.8]] {
        let whole = line(1, end);
        for n in [3, 10, 100, 1000, 10_000] {
            let cut = line(n, end);
            assert!(cut <= 1.001 * whole, "{n} pieces to {end:?}: {cut} periods, {whole} in one piece");
        }
    }
}

#[test]
fn a_plan_beyond_the_limits_is_caught_by_both_judges() {
    let limits = MachineLimits::built_in();
    let m = Move { path: Path::Line([40.0, 3.0, 0.0]), feed: FeedRate::Rapid, mode: PathMode::ExactStop, stop: true };
    let run = play(limits, &[m], 0);
    assert_eq!(check(&limits, &[m], &run, 0.0, 2), Ok(()));
    let lower: [fn(&mut MachineLimits<3>); 3] =
        [|l| l.velocity_mm_s[0] *= 0.85, |l| l.acceleration_mm_s2[0] *= 0.85, |l| l.jerk_mm_s3[0] *= 0.85];
    for lower in lower {
        let mut tighter = limits;
        lower(&mut tighter);
        assert!(check_points(&tighter, &run.points, [0.0; 3]).is_err());
        assert!(check_records(&tighter, &run.records).is_err());
    }
}

#[test]
fn a_blended_corner_is_never_slower_than_a_stop() {
    let limits = MachineLimits::built_in();
    for degrees in [1.0f64, 5.0, 15.0, 30.0, 45.0, 60.0, 90.0, 120.0, 135.0, 170.0, 180.0] {
        for leg in [2.0, 20.0] {
            for feed in [5.0, 30.0, 100.0] {
                let (sin, cos) = degrees.to_radians().sin_cos();
                let corner = |mode| {
                    let line = |end| Move { path: Path::Line(end), feed: FeedRate::PerSecond(feed), mode, stop: false };
                    let moves = [line([leg, 0.0, 0.0]), line([leg + leg * cos, leg * sin, 0.0])];
                    play(limits, &moves, usize::MAX).records.len()
                };
                let stop = corner(PathMode::ExactStop);
                for tolerance_mm in [0.005, 0.01, 0.05] {
                    let blend = corner(PathMode::blend(tolerance_mm));
                    assert!(
                        blend <= stop,
                        "{degrees}° {leg} mm at {feed} mm/s within {tolerance_mm}: {blend} periods, {stop} stopping"
                    );
                }
            }
        }
    }
}

/// A rotary axis that reverses is not cut short by more than the tolerance, and tiny pieces behind a long one take no
/// time.
#[test]
fn rotary_reversals_are_kept_and_tiny_pieces_are_cheap() {
    let mode = PathMode::blend(0.05);
    let mut planner = Planner::<4>::new(MachineLimits::built_in(), [0.0; 4]).expect("valid limits");
    for (tag, end) in [[0.0, 0.0, 0.0, 30.0], [0.0, 0.0, 0.0, 10.0], [5.0, 0.0, 0.0, 20.0]].into_iter().enumerate() {
        planner.line(end, FeedRate::PerSecond(20.0), mode, tag as u32 + 1).expect("a valid line");
    }
    planner.stop(Flags::NONE);
    let mut farthest = 0.0f64;
    while planner.next_record().is_some() {
        farthest = farthest.max(planner.set_point().position_mm[3]);
    }
    assert!(farthest > 29.95 && planner.set_point().position_mm == [5.0, 0.0, 0.0, 20.0]);

    planner.line([1500.0, 0.0, 0.0, 20.0], FeedRate::Rapid, mode, 9).expect("a valid line");
    for k in 0..40_000 {
        let x = 1500.0 + f64::from(k % 3) * 1e-5;
        planner.line([x, f64::from(k) * 1e-4, 0.0, 20.0], FeedRate::Rapid, mode, 10).expect("a valid line");
        while planner.next_record().is_some() {}
    }
    planner.stop(Flags::NONE);
    while planner.next_record().is_some() {}
    assert_eq!(planner.set_point().position_mm, planner.commanded_mm());
}

#[test]
fn a_slow_cut_may_be_retraced_fast() {
    let limits = MachineLimits::built_in();
    let m = Move {
        path: Path::Line([40.0, 0.0, 0.0]),
        feed: FeedRate::PerSecond(5.0),
        mode: PathMode::ExactStop,
        stop: true,
    };
    let run = play(limits, &[m], 0);
    let fast = run.records.iter().filter(|record| record.cap == RapidCap::MAX).count();
    assert!(fast > run.records.len() - 100, "{fast} of {}", run.records.len());
}

/// Merged lines retain their program lines: each record has that of the line it ends in, or of an adjacent one where
/// the tolerance moves the path across their junction.
#[test]
fn records_of_merged_lines_carry_the_line_that_they_end_in() {
    let limits = MachineLimits::built_in();
    for (radius, chord) in [(f64::INFINITY, 0.03), (f64::INFINITY, 3.0), (30.0, 0.07), (3.0, 0.2)] {
        let at = |k: usize| {
            let way = k as f64 * chord;
            let (sin, cos) = (way / radius).sin_cos();
            if radius.is_finite() { [radius * sin, radius * (1.0 - cos), 0.0] } else { [0.8 * way, 0.6 * way, 0.0] }
        };
        let moves: Vec<Move> = (1..=300)
            .map(|k| {
                let mode = PathMode::blend(0.05);
                Move { path: Path::Line(at(k)), feed: FeedRate::PerSecond(50.0), mode, stop: k == 300 }
            })
            .collect();
        let run = play(limits, &moves, usize::MAX);
        let distance = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
        let mut last = 1;
        for (record, point) in run.records.iter().zip(&run.points) {
            let line = record.line as usize;
            assert!(line >= last, "line {line} after line {last}");
            let aside = distance(point, &at(line - 1)).max(distance(point, &at(line))) - chord;
            let most = if radius.is_finite() { 0.05 } else { 1e-6 };
            assert!(aside < most, "{aside} mm from line {line} of {chord} mm around {radius} mm");
            last = line;
        }
        assert_eq!(last, 300);
    }
}

proptest! {
    /// A machine that was displaced is planned from there: the sum of all pulses is the distance between the two
    /// positions.
    #[test]
    fn what_follows_a_displacement_begins_where_the_machine_stands(
        ends in prop::array::uniform3(prop::array::uniform3(-50.0..50.0f64)),
            pulses in prop::array::uniform3(-9_000i64..9_000),
    ) {
        let limits = MachineLimits::built_in();
        let mut planner = Planner::new(limits, [0.0; 3]).expect("limits");
        let mut sum = [0i64; 3];
        let mut take = |planner: &mut Planner<3>| {
            while let Some(record) = planner.next_record() {
                sum.iter_mut().zip(record.increments).for_each(|(sum, n)| *sum += i64::from(n));
            }
            sum
        };
        let counts = |at: [f64; 3]| [0, 1, 2].map(|i| (at[i] * limits.pulses_per_mm[i]).round() as i64);
        planner.line(ends[0], FeedRate::Rapid, PathMode::ExactStop, 1).expect("a move");
        prop_assert!(!planner.displace(pulses), "it moves");
        planner.stop(Flags::NONE);
        prop_assert!(!planner.displace(pulses), "records wait");
        prop_assert_eq!(take(&mut planner), counts(ends[0]));
        prop_assert!(planner.displace(pulses));
        for (end, mode) in [(ends[1], PathMode::blend(0.1)), (ends[2], PathMode::ExactPath)] {
            planner.line(end, FeedRate::PerSecond(30.0), mode, 2).expect("a move");
        }
        planner.stop(Flags::NONE);
        let end = counts(ends[2]);
        let moved = take(&mut planner);
        prop_assert_eq!([0, 1, 2].map(|i| moved[i] + pulses[i]), end);
    }
}
