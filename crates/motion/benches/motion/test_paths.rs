//! Paths to plan, made from formulas and fixed seeds, as CAM systems write them.
//!
//! Invariant: the same call gives the same moves on any machine; coordinates are whole micrometres, as in programs.

use std::f64::consts::{FRAC_PI_2, TAU};

use retrace_core::Flags;
use retrace_motion::{Arc, FeedRate, MachineLimits, PathMode, Planner};

/// One programmed move, absolute, mm.
#[derive(Clone, Copy, Debug)]
pub(crate) enum TestMove {
    Line([f64; 3]),
    Arc(Arc<3>),
}

impl TestMove {
    /// End of the move, mm.
    pub(crate) fn end(&self) -> [f64; 3] {
        match self {
            Self::Line(end) => *end,
            Self::Arc(arc) => arc.end_mm,
        }
    }
}

/// A program: moves from the origin at one feed in one mode.
#[derive(Clone, Debug)]
pub(crate) struct TestPath {
    pub(crate) name: &'static str,
    pub(crate) moves: Vec<TestMove>,
    /// Feed, mm/s.
    pub(crate) feed: f64,
    pub(crate) mode: PathMode,
}

/// Tolerance of every generated path, mm; LinuxCNC uses it for G64 without P in the reference times.
pub(crate) const TOLERANCE: f64 = 0.05;

impl TestPath {
    fn of(name: &'static str, feed: f64, moves: Vec<TestMove>) -> Self {
        Self { name, moves, feed, mode: PathMode::blend(TOLERANCE) }
    }

    /// Planner at rest at the origin of the built-in machine.
    pub(crate) fn planner() -> Planner<3> {
        Planner::new(MachineLimits::built_in(), [0.0; 3]).expect("the built-in machine is valid")
    }

    /// Gives move `k` to the planner under the tag `k + 1`.
    pub(crate) fn push(&self, planner: &mut Planner<3>, k: usize) {
        let (feed, tag) = (FeedRate::PerSecond(self.feed), k as u32 + 1);
        match &self.moves[k] {
            TestMove::Line(end) => planner.line(*end, feed, self.mode, tag).expect("a valid line"),
            TestMove::Arc(arc) => planner.arc(arc, feed, self.mode, tag).expect("a valid arc"),
        }
    }

    /// Plans the path from rest to rest; `each` gets the planner after every record.
    pub(crate) fn play(&self, mut each: impl FnMut(&retrace_core::Record<3>, &Planner<3>)) {
        let mut planner = Self::planner();
        for k in 0..=self.moves.len() {
            if k < self.moves.len() {
                self.push(&mut planner, k);
            } else {
                planner.stop(Flags::NONE);
            }
            while let Some(record) = planner.next_record() {
                each(&record, &planner);
            }
        }
    }
}

/// Generator of numbers from a seed (SplitMix64).
#[derive(Clone, Debug)]
pub(crate) struct Numbers(pub(crate) u64);

impl Numbers {
    pub(crate) fn whole(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// A number from 0 up to 1, without 1.
    pub(crate) fn share(&mut self) -> f64 {
        (self.whole() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A number between two.
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.share()
    }
}

fn micrometres(point: [f64; 3]) -> [f64; 3] {
    point.map(|x| (x * 1000.0).round() / 1000.0)
}

/// The four paths of Q7, Q8, S2, S4, of `blocks` moves each.
pub(crate) fn all(blocks: usize) -> Vec<TestPath> {
    vec![surface(blocks), pocket(blocks), collinear(blocks), smooth(blocks)]
}

/// A dense 3-D surface, row by row to and fro, in pieces of about 0.1 mm.
pub(crate) fn surface(blocks: usize) -> TestPath {
    let row = 500;
    let at = |k: usize| {
        let (along, across) = (k % row, k / row);
        let forward = if across % 2 == 0 { along } else { row - 1 - along };
        let (x, y) = (forward as f64 * 0.1, across as f64 * 0.2);
        micrometres([x, y, 2.0 * (x * 0.3).sin() * (y * 0.2).cos()])
    };
    TestPath::of("3-D surface", 50.0, (1..=blocks).map(|k| TestMove::Line(at(k))).collect())
}

/// Pockets: each is cleared by a zig-zag and finished by contours with rounded corners from the inside out; lines of
/// 0.5 to 20 mm, arcs of 0.5 to 5 mm radius.
pub(crate) fn pocket(blocks: usize) -> TestPath {
    let mut numbers = Numbers(7);
    let mut ways = Vec::with_capacity(blocks + 200);
    let mut centre = [0.0, 0.0];
    while ways.len() < blocks {
        let half = [numbers.between(6.0, 14.0), numbers.between(5.0, 10.0)];
        let depth = -numbers.between(0.5, 2.0);
        zig_zag(&mut ways, centre, half, depth, &mut numbers);
        contours(&mut ways, centre, half, depth);
        centre[0] = (centre[0] + 30.0) % 300.0;
        centre[1] = if centre[0] < 30.0 { (centre[1] + 25.0) % 250.0 } else { centre[1] };
    }
    ways.truncate(blocks);
    TestPath::of("pocket", 60.0, ways)
}

/// Clears a rectangle: rows 1 mm apart, each in a few lines of up to 20 mm.
fn zig_zag(ways: &mut Vec<TestMove>, centre: [f64; 2], half: [f64; 2], depth: f64, numbers: &mut Numbers) {
    let mut line = |x: f64, y: f64| ways.push(TestMove::Line(micrometres([centre[0] + x, centre[1] + y, depth])));
    let (mut y, mut side) = (-half[1], -1.0);
    line(side * half[0], y);
    while y < half[1] {
        let middle = numbers.between(-0.8, 0.8) * half[0];
        line(middle, y);
        line(-side * half[0], y);
        side = -side;
        y += 1.0;
        line(side * half[0], y.min(half[1]));
    }
}

/// Contours 0.5 to 5 mm round at their corners, growing outwards by 0.5 mm.
fn contours(ways: &mut Vec<TestMove>, centre: [f64; 2], half: [f64; 2], depth: f64) {
    let mut inset = half[1] - 1.0;
    while inset >= 0.0 {
        let (hx, hy) = (half[0] - inset, half[1] - inset);
        let radius = (0.6 * hy).clamp(0.5, 5.0).min(hy);
        contour(ways, centre, [hx - radius, hy - radius], radius, depth);
        inset -= 0.5;
    }
}

/// A rectangle with rounded corners, counterclockwise from the right of its lower edge; `straight` are half its edges.
fn contour(ways: &mut Vec<TestMove>, centre: [f64; 2], straight: [f64; 2], radius: f64, depth: f64) {
    let signs = [[1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]];
    for (k, sign) in signs.into_iter().enumerate() {
        let corner = [centre[0] + sign[0] * straight[0], centre[1] + sign[1] * straight[1]];
        let on = |quarter: usize| {
            let (sin, cos) = ((quarter as f64 - 1.0) * FRAC_PI_2).sin_cos();
            micrometres([corner[0] + radius * cos, corner[1] + radius * sin, depth])
        };
        let (from, to) = (on(k), on(k + 1));
        ways.push(TestMove::Line(from));
        let [cx, cy, _] = micrometres([corner[0], corner[1], 0.0]);
        ways.push(TestMove::Arc(Arc { plane: [0, 1], centre_mm: [cx, cy], rotation: 1, end_mm: to }));
    }
}

/// Straight lines of 50 mm to and fro and across, in pieces of 0.1 mm.
pub(crate) fn collinear(blocks: usize) -> TestPath {
    let (directions, mut at) = ([[0.08, 0.06], [0.0, 0.1], [-0.08, -0.06], [0.0, 0.1]], [0.0, 0.0]);
    let ways = (0..blocks).map(|k| {
        let [dx, dy] = directions[k / 500 % 4];
        at = [at[0] + dx, at[1] + dy];
        TestMove::Line(micrometres([at[0], at[1], 0.0]))
    });
    TestPath::of("collinear", 100.0, ways.collect())
}

/// A spiral out and in again, its radius from 5 to 25 mm, in chords of 0.05 to 0.3 mm.
pub(crate) fn smooth(blocks: usize) -> TestPath {
    let mut numbers = Numbers(11);
    let (mut angle, mut outward, mut radius) = (0.0f64, 1.0, 5.0f64);
    let ways = (0..blocks).map(|_| {
        let turn = numbers.between(0.05, 0.3) / radius;
        angle += turn;
        radius += outward * turn / TAU;
        if radius > 25.0 {
            outward = -1.0;
        } else if radius < 5.0 {
            outward = 1.0;
        }
        let (sin, cos) = angle.sin_cos();
        TestMove::Line(micrometres([radius * cos, radius * sin, 0.0]))
    });
    TestPath::of("smooth", 80.0, ways.collect())
}
