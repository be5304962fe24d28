//! The part in the model of the checker: a boundary with its heights, and random contours.
//!
//! Invariant: written from the requirement's definition (the boundary moved to its free side), without the cycle's own
//! geometry. Model coordinates: u along the cut, cutting towards -u; v towards the free side.

use retrace_cycles::stock::{Corner, Element, Kind, Move, MoveKind, Point, StockRemovalParams};

/// A small generator of numbers: the same seed gives the same contour.
pub(crate) struct Dice(pub(crate) u64);

impl Dice {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    pub(crate) fn below(&mut self, count: u64) -> u64 {
        self.next() % count
    }

    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Returns a size that is sometimes a round number, so that heights coincide with levels and with each other.
    pub(crate) fn size(&mut self, low: f64, high: f64) -> f64 {
        let value = self.between(low, high);
        match self.below(8) {
            0..4 => ((2.0 * value).round() / 2.0).max(0.5),
            4 => value / 100.0,
            _ => value,
        }
    }
}

/// One element of the boundary in model coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Edge {
    pub(crate) start: Point,
    pub(crate) end: Point,
    /// Centre, and whether it is counterclockwise.
    pub(crate) arc: Option<(Point, bool)>,
}

impl Edge {
    /// Returns the heights at a place: none, one, or both ends of an upright line.
    pub(crate) fn heights(&self, u: f64) -> [Option<f64>; 2] {
        let (low, high) = (self.start.u.min(self.end.u), self.start.u.max(self.end.u));
        let Some((centre, counterclockwise)) = self.arc else {
            return match u {
                _ if u < low || u > high => [None, None],
                _ if low == high => [Some(self.start.v), Some(self.end.v)],
                _ => {
                    let share = (u - self.start.u) / (self.end.u - self.start.u);
                    [Some(self.start.v + share * (self.end.v - self.start.v)), None]
                }
            };
        };
        let radius = (self.start.u - centre.u).hypot(self.start.v - centre.v);
        let square = radius * radius - (u - centre.u) * (u - centre.u);
        if square < 0.0 {
            return [None, None];
        }
        let on = |v: f64| {
            let turned = |point: Point| {
                let angle = (point.v - centre.v).atan2(point.u - centre.u)
                    - (self.start.v - centre.v).atan2(self.start.u - centre.u);
                (if counterclockwise { angle } else { -angle }).rem_euclid(std::f64::consts::TAU)
            };
            let (here, end) = (turned(Point::new(u, v)), turned(self.end));
            (here <= end + 1e-9 || here > std::f64::consts::TAU - 1e-9).then_some(v)
        };
        [on(centre.v + square.sqrt()), on(centre.v - square.sqrt())]
    }

    /// Returns its highest and its lowest point.
    pub(crate) fn span(&self) -> (f64, f64) {
        let mut heights = vec![self.start.v, self.end.v];
        if let Some((centre, _)) = self.arc {
            heights.extend(self.heights(centre.u).into_iter().flatten());
        }
        heights.iter().fold((f64::NEG_INFINITY, f64::INFINITY), |(high, low), v| (high.max(*v), low.min(*v)))
    }
}

/// The boundary of the part, with its allowances.
pub(crate) struct Part {
    pub(crate) edges: Vec<Edge>,
    /// Allowance along the cut and along the infeed.
    pub(crate) allowance: (f64, f64),
    pub(crate) start: Point,
    pub(crate) end: Point,
    pub(crate) top: f64,
}

impl Part {
    pub(crate) fn new(mut edges: Vec<Edge>, allowance: (f64, f64)) -> Self {
        let (start, end) = (edges[0].start, edges[edges.len() - 1].end);
        let top = edges.iter().map(|edge| edge.span().0).fold(f64::NEG_INFINITY, f64::max);
        edges.push(Edge { start: end, end: Point::new(end.u, top), arc: None });
        Self { edges, allowance, start, end, top }
    }

    /// Returns the height of the rough contour at a place: the highest point of the contour within the allowance to
    /// both sides, raised.
    pub(crate) fn rough(&self, u: f64) -> f64 {
        let (cut, infeed) = self.allowance;
        if u <= self.end.u {
            return self.top + infeed;
        }
        let (low, high) = (u - cut, u + cut);
        let mut height = f64::NEG_INFINITY;
        for edge in &self.edges {
            let inside = [edge.start, edge.end].into_iter().filter(|point| low <= point.u && point.u <= high);
            height = inside.map(|point| point.v).fold(height, f64::max);
            let turning = edge.arc.map(|(centre, _)| centre.u).filter(|u| low <= *u && *u <= high);
            for place in [Some(low), Some(high), turning].into_iter().flatten() {
                height = edge.heights(place).into_iter().flatten().fold(height, f64::max);
            }
        }
        height + infeed
    }

    /// Returns the limit of the height of the rough contour from one side of a place: at a wall the sides differ.
    fn rough_from(&self, u: f64, right: bool) -> f64 {
        let (cut, infeed) = self.allowance;
        if u < self.end.u - cut || (u <= self.end.u - cut && !right) {
            return self.top + infeed;
        }
        let (low, high) = (u - cut, u + cut);
        let mut height = f64::NEG_INFINITY;
        for edge in &self.edges {
            let (first, last) = (edge.start.u.min(edge.end.u), edge.start.u.max(edge.end.u));
            // A part that only touches the window from the other side does not extend into it.
            let outside = if right {
                last <= low + 1e-9 || first > high + 1e-9
            } else {
                first >= high - 1e-9 || last < low - 1e-9
            };
            if !outside {
                let (from, to) = (low.clamp(first, last), high.clamp(first, last));
                let turning = edge.arc.map_or(from, |(centre, _)| centre.u.clamp(from, to));
                for place in [from, to, turning] {
                    height = edge.heights(place).into_iter().flatten().fold(height, f64::max);
                }
            }
        }
        height + infeed
    }

    /// Returns the rough contour next to a place, on its lower and on its higher side.
    pub(crate) fn rough_around(&self, u: f64) -> (f64, f64) {
        // The path may be a millionth of a micrometre away from the foot of an upright flank.
        let sides = [-1e-9, 0.0, 1e-9].map(|by| self.rough_from(u + by, false).min(self.rough_from(u + by, true)));
        let beside = [-1e-6, 0.0, 1e-6].map(|by| self.rough(u + by));
        let all = sides.iter().chain(&beside);
        all.fold((f64::INFINITY, f64::NEG_INFINITY), |all, one| (all.0.min(*one), all.1.max(*one)))
    }
}

/// Mapping of model coordinates to the plane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lie {
    pub(crate) face: bool,
    pub(crate) infeed: f64,
    pub(crate) cut: f64,
}

impl Lie {
    pub(crate) fn plane(self, at: Point) -> Point {
        let (cut, infeed) = (at.u * self.cut, at.v * self.infeed);
        if self.face { Point::new(infeed, cut) } else { Point::new(cut, infeed) }
    }

    pub(crate) fn judge(self, at: Point) -> Point {
        let (cut, infeed) = if self.face { (at.v, at.u) } else { (at.u, at.v) };
        Point::new(cut * self.cut, infeed * self.infeed)
    }

    /// Whether the direction of arcs changes between the two.
    pub(crate) fn turns_over(self) -> bool {
        let signs = self.cut * self.infeed < 0.0;
        if self.face { !signs } else { signs }
    }

    pub(crate) fn elements(self, edges: &[Edge], backwards: bool) -> Vec<Element> {
        let element = |(number, edge): (usize, &Edge)| {
            let (start, end) = if backwards { (edge.end, edge.start) } else { (edge.start, edge.end) };
            let (kind, centre) = match edge.arc {
                None => (Kind::Line, start),
                Some((centre, counterclockwise)) if (counterclockwise != backwards) != self.turns_over() => {
                    (Kind::Counterclockwise, centre)
                }
                Some((centre, _)) => (Kind::Clockwise, centre),
            };
            let (start, end, centre) = (self.plane(start), self.plane(end), self.plane(centre));
            Element { kind, start, end, centre, corner: Corner::None, line: number as u32 + 1 }
        };
        let mut elements: Vec<Element> = edges.iter().enumerate().map(element).collect();
        if backwards {
            elements.reverse();
        }
        elements
    }
}

/// Creates an edge from a point onwards, always towards -u.
fn edge(dice: &mut Dice, at: Point, falls: bool) -> Edge {
    let line = |du: f64, dv: f64| Edge { start: at, end: Point::new(at.u - du, at.v + dv), arc: None };
    let sign = if falls && dice.below(5) < 2 { -1.0 } else { 1.0 };
    match dice.below(6) {
        0 => line(dice.size(0.3, 8.0), 0.0),
        1 => line(0.0, sign * dice.size(0.3, 6.0)),
        2 | 3 => line(dice.size(0.2, 6.0), sign * dice.size(0.2, 6.0)),
        // A quarter circle: over or under, rising or falling.
        4 => {
            let radius = dice.size(0.3, 4.0);
            let over = dice.below(2) == 0;
            let end = Point::new(at.u - radius, at.v + sign * radius);
            let centre = if over == (sign > 0.0) { Point::new(end.u, at.v) } else { Point::new(at.u, end.v) };
            Edge { start: at, end, arc: Some((centre, over)) }
        }
        // Part of a circle, up to a half.
        _ => {
            let radius = dice.size(0.5, 8.0);
            let over = dice.below(2) == 0;
            let (mut a, mut b) = (dice.between(0.0, 1.0), dice.between(0.0, 1.0));
            if a > b {
                (a, b) = (b, a);
            }
            if !falls {
                // The quarter that rises.
                (a, b) = if over { (a / 2.0, b / 2.0) } else { (0.5 + a / 2.0, 0.5 + b / 2.0) };
            }
            let angle = |share: f64| if over { share } else { -share } * std::f64::consts::PI;
            let centre = Point::new(at.u - radius * angle(a).cos(), at.v - radius * angle(a).sin());
            let end = Point::new(centre.u + radius * angle(b).cos(), centre.v + radius * angle(b).sin());
            Edge { start: at, end, arc: Some((centre, over)) }
        }
    }
}

/// Creates a random chain of edges, from the deep end.
pub(crate) fn edges(dice: &mut Dice, falls: bool) -> Vec<Edge> {
    let mut edges: Vec<Edge> = Vec::new();
    let mut at = Point::new(dice.between(-5.0, 5.0), 30.0);
    for _ in 0..2 + dice.below(12) {
        let next = edge(dice, at, falls);
        // A wall must not run back over another.
        let upright = |edge: &Edge| edge.start.u == edge.end.u;
        let back = edges.last().is_some_and(|last| upright(last) && upright(&next));
        if !back && (next.end.u - at.u).hypot(next.end.v - at.v) > 1e-3 {
            at = next.end;
            edges.push(next);
        }
    }
    // Enough extent along the cut, and the end at least as high as the start.
    let start = Point::new(at.u - dice.size(1.0, 3.0), at.v);
    edges.push(Edge { start: at, end: start, arc: None });
    edges.push(Edge { start, end: Point::new(start.u, start.v.max(30.0) + dice.size(0.5, 4.0)), arc: None });
    edges
}

/// A move in model coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Step {
    pub(crate) from: Point,
    pub(crate) edge: Edge,
    pub(crate) rapid: bool,
}

/// Returns the moves after the first, each with its start.
pub(crate) fn steps(lie: Lie, moves: &[Move]) -> Vec<Step> {
    let pair = |pair: &[Move]| {
        let (from, to) = (lie.judge(pair[0].end), lie.judge(pair[1].end));
        let arc = match pair[1].kind {
            MoveKind::Rapid | MoveKind::Line => None,
            kind => Some((lie.judge(pair[1].centre), (kind == MoveKind::Counterclockwise) != lie.turns_over())),
        };
        Step { from, edge: Edge { start: from, end: to, arc }, rapid: pair[1].kind == MoveKind::Rapid }
    };
    moves.windows(2).map(pair).collect()
}

/// Returns the parameters for these edges.
pub(crate) fn job(
    dice: &mut Dice,
    edges: &[Edge],
    lie: Lie,
    backwards: bool,
    kind: i32,
) -> (StockRemovalParams, (f64, f64)) {
    let number = 4 * kind + 1 + i32::from(lie.face) + if lie.infeed < 0.0 { 2 } else { 0 };
    let mut allowance = || if dice.below(3) == 0 { 0.0 } else { dice.size(0.05, 1.5) };
    let (fal_z, fal_x, fal) = (allowance(), allowance(), allowance() / 4.0);
    let mut job = super::job(lie.elements(edges, backwards), number, dice.size(0.4, 4.0).max(0.3));
    (job.fal_z, job.fal_x, job.fal, job.vrt) = (fal_z, fal_x, fal, dice.size(0.3, 2.0));
    if dice.below(3) == 0 {
        job.dam = dice.size(0.5, 10.0).max(0.2);
    }
    let (cut, infeed) = if lie.face { (fal_x, fal_z) } else { (fal_z, fal_x) };
    (job, (cut + fal, infeed + fal))
}
