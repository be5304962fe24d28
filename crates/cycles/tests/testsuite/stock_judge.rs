//! Random contours, checked by a model that uses only the part, the blank and the moves.
//!
//! Invariant: the model stores the stock as heights at many places, each computed exactly, so its tolerances are those
//! of the arithmetic: a thousandth of a micrometre in height or in place, never the distance between the places.

use crate::stock;

use proptest::prelude::*;
use retrace_cycles::stock::{Axes, Feed, MAX_MOVES, Move, MoveKind, Path, Point, StockRemovalParams, ToolTip, plan};
use stock::part::{self, Dice, Edge, Lie, Part, Step};

/// Tolerance of the arithmetic, mm.
const CLOSE: f64 = 1e-6;

/// Material that may remain above the rough contour: relief cuts and humps of less than a thousandth of a micrometre,
/// one in another.
const LEFT: f64 = 3e-6;

struct Case {
    part: Part,
    lie: Lie,
    job: StockRemovalParams,
    backwards: bool,
}

fn case(seed: u64, falls: bool, kind: i32) -> Case {
    let mut dice = Dice(seed);
    let edges = part::edges(&mut dice, falls);
    let infeed = if dice.below(2) == 0 { 1.0 } else { -1.0 };
    let cut = if dice.below(2) == 0 { 1.0 } else { -1.0 };
    let lie = Lie { face: dice.below(2) == 0, infeed, cut };
    let backwards = dice.below(2) == 0;
    let (job, allowance) = part::job(&mut dice, &edges, lie, backwards, kind);
    Case { part: Part::new(edges, allowance), lie, job, backwards }
}

/// The stock as heights at places.
struct Stock {
    heights: Vec<(f64, f64)>,
}

impl Stock {
    /// The blank at random places, and beside the ends of all elements.
    fn blank(part: &Part, dice: &mut Dice) -> Self {
        let (low, high) = (part.end.u, part.start.u + part.allowance.0);
        let mut places: Vec<f64> = (0..1500).map(|_| dice.between(low - 1.0, high)).collect();
        for edge in &part.edges {
            for place in [edge.start.u, edge.end.u] {
                for beside in [-1e-3, -1e-5, 1e-5, 1e-3] {
                    places.extend([-1.0, 0.0, 1.0].map(|side| place + side * part.allowance.0 + beside));
                }
            }
        }
        places.retain(|u| *u <= high);
        places.sort_by(f64::total_cmp);
        let top = part.top + part.allowance.1;
        Self { heights: places.into_iter().map(|u| (u, top)).collect() }
    }

    /// Returns the places that a step passes, and the height at which it passes them.
    fn passed(&mut self, step: &Step) -> impl Iterator<Item = (f64, &mut f64, f64)> {
        let edge = step.edge;
        let (low, high) = (edge.start.u.min(edge.end.u), edge.start.u.max(edge.end.u));
        let first = self.heights.partition_point(|(u, _)| *u < low);
        let behind = self.heights.partition_point(|(u, _)| *u <= high);
        self.heights[first..behind.max(first)].iter_mut().filter_map(move |(u, height)| {
            let at = edge.heights(*u).into_iter().flatten().fold(f64::INFINITY, f64::min);
            at.is_finite().then_some((*u, height, at))
        })
    }

    /// Returns the stock next to a place, on its lower side.
    fn beside(&self, u: f64) -> f64 {
        let next = self.heights.partition_point(|(place, _)| *place < u);
        let before = next.checked_sub(1).map_or(f64::INFINITY, |before| self.heights[before].1);
        // In front of the blank there is no stock.
        before.min(self.heights.get(next).map_or(f64::NEG_INFINITY, |after| after.1))
    }
}

fn points(step: &Step) -> Vec<Point> {
    let Step { from, edge, .. } = *step;
    let chord = |share: f64| Point::new(from.u + share * (edge.end.u - from.u), from.v + share * (edge.end.v - from.v));
    let on = |share: f64| match edge.arc {
        None => chord(share),
        Some((centre, _)) => {
            let radius = (from.u - centre.u).hypot(from.v - centre.v);
            let (du, dv) = (chord(share).u - centre.u, chord(share).v - centre.v);
            let factor = radius / du.hypot(dv);
            Point::new(centre.u + du * factor, centre.v + dv * factor)
        }
    };
    (0..=40).map(|share| on(f64::from(share) / 40.0)).collect()
}

fn well_formed(moves: &[Move]) {
    assert!(moves.len() <= MAX_MOVES);
    for pair in moves.windows(2) {
        let (from, step) = (pair[0].end, &pair[1]);
        for value in [step.end.u, step.end.v, step.centre.u, step.centre.v] {
            assert!(value.is_finite(), "{step:?}");
        }
        match step.axes {
            Axes::Both => {}
            Axes::First => assert!((from.v - step.end.v).abs() <= CLOSE, "{step:?}"),
            Axes::Second => assert!((from.u - step.end.u).abs() <= CLOSE, "{step:?}"),
        }
        assert_eq!(step.kind == MoveKind::Rapid, step.feed == Feed::Rapid);
        let distance = |point: Point| (point.u - step.centre.u).hypot(point.v - step.centre.v);
        if !matches!(step.kind, MoveKind::Rapid | MoveKind::Line) {
            assert!((distance(from) - distance(step.end)).abs() < CLOSE, "{from:?} {step:?}");
        }
    }
}

/// Returns the lowest height at which one of these steps has cut at a place.
fn lowest_cut(steps: &[Step], u: f64) -> f64 {
    let at = |step: &Step| {
        let (low, high) = (step.edge.start.u.min(step.edge.end.u), step.edge.start.u.max(step.edge.end.u));
        let is_passed = !step.rapid && low - CLOSE <= u && u <= high + CLOSE;
        is_passed.then(|| step.edge.heights(u.clamp(low, high)))
    };
    steps.iter().filter_map(at).flatten().flatten().fold(f64::INFINITY, f64::min)
}

/// No move below the rough contour, no rapid through stock, no cut deeper than the infeed, nothing left.
fn judge_roughing(case: &Case, path: &Path, seed: u64) {
    well_formed(&path.moves);
    let Case { part, lie, job, .. } = case;
    let mut stock = Stock::blank(part, &mut Dice(seed ^ 1));
    let steps = part::steps(*lie, &path.moves);
    for (number, step) in steps.iter().enumerate() {
        for at in points(step) {
            let (low, _) = part.rough_around(at.u);
            assert!(at.v >= low - CLOSE, "below the rough contour {low} at {at:?}: {step:?}");
        }
        if step.rapid && (step.from.u - step.edge.end.u).abs() < CLOSE {
            let lowest = step.from.v.min(step.edge.end.v);
            // Where a tool retracts from the bottom of an arc, the stock at the places on both sides is higher.
            let height = stock.beside(step.from.u).min(lowest_cut(&steps[..number], step.from.u));
            assert!(lowest >= height - CLOSE, "rapid through stock of {height}: {step:?}");
        }
        for (u, height, at) in stock.passed(step) {
            if step.rapid {
                assert!(at >= *height - CLOSE, "rapid at {u} {at} through stock of {height}: {step:?}");
            } else {
                assert!(*height - at <= job.mid + CLOSE, "cut {} deep at {u}: {step:?}", *height - at);
                *height = height.min(at);
            }
        }
    }
    for (u, height) in &stock.heights {
        let (_, high) = part.rough_around(*u);
        assert!(*height <= high + LEFT, "at {u} stands {height}, the rough contour {high}");
    }
}

/// The infeeds of the first section: equal, and never more than MID.
fn judge_levels(case: &Case, path: &Path) {
    let start = case.lie.judge(path.start);
    let steps = part::steps(case.lie, &path.moves);
    let infeeds: Vec<f64> = steps
        .iter()
        .filter(|step| step.rapid && (step.from.u - start.u).abs() < CLOSE && (step.edge.end.u - start.u).abs() < CLOSE)
        .map(|step| step.edge.end.v)
        .take_while(|v| (v - start.v).abs() > CLOSE)
        .collect();
    let mut before = case.part.top + case.part.allowance.1;
    let depth = before - (case.part.start.v + case.part.allowance.1);
    let count = (depth / case.job.mid - 1e-9).ceil();
    if depth > LEFT {
        assert_eq!(infeeds.len() as f64, count, "{infeeds:?}");
    }
    for level in infeeds {
        assert!((before - level - depth / count).abs() < CLOSE && before - level <= case.job.mid + CLOSE);
        before = level;
    }
}

fn rough_path(case: &Case) -> Path {
    plan(&case.job).unwrap_or_else(|fault| panic!("{} {fault}: {:?}", fault.number(), case.job))
}

/// Number of contours on which each property is tested: RETRACE_STOCK, or few enough for every test run.
fn cases() -> u32 {
    std::env::var("RETRACE_STOCK").ok().and_then(|count| count.parse().ok()).unwrap_or(100)
}

/// Beside the upright start of an arc, the envelope fell into a dip that is not there.
#[test]
fn roughing_takes_nothing_of_the_part_beside_the_upright_start_of_an_arc() {
    let seed = 15_760_046_238_273_249_670;
    let case = case(seed, true, 0);
    judge_roughing(&case, &rough_path(&case), seed);
}

/// A tool retracts from the lowest place of an arc.
#[test]
fn a_retract_from_the_bottom_of_an_arc_is_no_rapid_through_stock() {
    let seed = 5_948_604_037_927_215_557;
    let case = case(seed, true, 0);
    judge_roughing(&case, &rough_path(&case), seed);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: cases(), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn roughing_takes_all_of_the_stock_and_nothing_of_the_part(seed: u64, falls: bool) {
        let case = case(seed, falls, 0);
        let path = rough_path(&case);
        judge_roughing(&case, &path, seed);
        judge_levels(&case, &path);
        let sections = case.part.edges.len() as f64 + 1.0;
        let (high, low) = case.part.edges.iter().map(Edge::span).fold((f64::MIN, f64::MAX), |all, one| {
            (all.0.max(one.0), all.1.min(one.1))
        });
        let levels = (high - low) / case.job.mid + 1.0;
        let dwells = path.moves.iter().filter(|step| step.dwell_after).count() as f64;
        let most = sections * levels * (4.0 * sections + 8.0) + 4.0 + dwells;
        prop_assert!((path.moves.len() as f64) < most);
    }

    #[test]
    fn complete_machining_is_roughing_and_then_the_contour_itself(seed: u64, falls: bool) {
        let roughing = rough_path(&case(seed, falls, 0));
        let complete = case(seed, falls, 2);
        let path = rough_path(&complete);
        let (first, last) = path.moves.split_at(roughing.moves.len());
        prop_assert_eq!(first, &roughing.moves[..]);
        well_formed(&path.moves);
        let contour = complete.lie.elements(&complete.part.edges[..complete.part.edges.len() - 1], false);
        prop_assert_eq!(last[0].end, contour[0].start);
        let pass: Vec<&Move> = last.iter().filter(|step| step.feed == Feed::Finish).collect();
        prop_assert_eq!(pass.len(), contour.len());
        for (step, element) in pass.iter().zip(&contour) {
            prop_assert!((step.end.u - element.end.u).hypot(step.end.v - element.end.v) < CLOSE);
        }
        prop_assert_eq!(path.moves.last().map(|step| step.end), Some(path.start));
    }

    #[test]
    fn the_nose_stays_out_of_the_rough_part(seed: u64, falls: bool, orientation in 1..=9) {
        let mut case = case(seed, falls, 0);
        let radius = Dice(seed ^ 7).size(0.1, 1.6);
        case.job.nose_radius = radius;
        case.job.tip = ToolTip::of_orientation(orientation);
        let path = rough_path(&case);
        well_formed(&path.moves);
        let tip = case.lie.judge(Point::new(case.job.tip.u, case.job.tip.v));
        for step in part::steps(case.lie, &path.moves) {
            for at in points(&step).into_iter().step_by(5) {
                let centre = Point::new(at.u - tip.u * radius, at.v - tip.v * radius);
                for share in -20..=20 {
                    let across = radius * f64::from(share) / 20.0;
                    let below = centre.v - (radius * radius - across * across).max(0.0).sqrt();
                    let (low, _) = case.part.rough_around(centre.u + across);
                    prop_assert!(below >= low - 10.0 * CLOSE, "nose of {radius} at {centre:?} is at {below} in {low}: \
                        {step:?} {tip:?} {:?} {:?}", case.part.allowance, case.part.edges);
                }
            }
        }
    }

    #[test]
    fn the_programmed_direction_does_not_matter_to_roughing(seed: u64, falls: bool) {
        let mut case = case(seed, falls, 0);
        let one = rough_path(&case);
        let edges = &case.part.edges[..case.part.edges.len() - 1];
        case.job.contour = case.lie.elements(edges, !case.backwards);
        prop_assert_eq!(stock::blocks(&one), stock::blocks(&rough_path(&case)));
    }
}
