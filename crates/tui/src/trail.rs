//! Polyline with a bounded number of corners, however long it grows: the tool path as the screen draws it.
//!
//! Invariant: never more than [`MAX_CORNERS`] corners. The tolerance doubles whenever the corners run out, up to a
//! value that is invisible; where that is not enough, the oldest corners are dropped.

/// Maximum number of corners.
pub(crate) const MAX_CORNERS: usize = 4096;

/// Maximum number of points since the last corner that are checked against the line.
const WAITING: usize = 24;

/// Initial tolerance, mm.
const FINEST_MM: f32 = 0.005;

/// Maximum tolerance, as a fraction of the line's extent: less than a dot on the largest screen.
const COARSEST: f32 = 0.002;

/// Point of the line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrailPoint {
    /// Length of the line up to here, mm.
    pub along_mm: f64,
    /// Position: X, Y, Z of the machine, mm; 0 for a missing axis.
    pub at: [f32; 3],
    /// Whether a rapid move ends here.
    pub rapid: bool,
}

/// Polyline.
#[derive(Clone, Debug, Default)]
pub struct Trail {
    corners: Vec<TrailPoint>,
    waiting: Vec<TrailPoint>,
    tolerance_mm: f32,
    /// Minimum and maximum of each coordinate, once there is a point.
    extent: Option<[[f32; 3]; 2]>,
}

impl Trail {
    /// Extends the line to this point. A point that is not finite is skipped.
    pub fn push(&mut self, corner: TrailPoint) {
        if !corner.at.iter().all(|x| x.is_finite()) {
            return;
        }
        self.tolerance_mm = self.tolerance_mm.max(FINEST_MM);
        let [least, greatest] = self.extent.get_or_insert([corner.at; 2]);
        for i in 0..3 {
            least[i] = least[i].min(corner.at[i]);
            greatest[i] = greatest[i].max(corner.at[i]);
        }
        let Some(last) = self.waiting.last().or(self.corners.last()) else {
            self.corners.push(corner);
            return;
        };
        if last.rapid == corner.rapid && distance(last.at, corner.at) < self.tolerance_mm {
            return;
        }
        let turns = last.rapid != corner.rapid
            || self.waiting.len() >= WAITING
            || self.corners.last().is_some_and(|from| {
                self.waiting.iter().any(|w| distance_to_line(w.at, from.at, corner.at) > self.tolerance_mm)
            });
        if turns && let Some(corner) = self.waiting.pop() {
            self.waiting.clear();
            self.push_corner(corner);
        }
        self.waiting.push(corner);
    }

    fn push_corner(&mut self, corner: TrailPoint) {
        self.corners.push(corner);
        if self.corners.len() + 1 >= MAX_CORNERS {
            let (all, extent) = (std::mem::take(&mut self.corners), self.extent);
            let coarsest = extent.map_or(0.0, |[least, greatest]| distance(least, greatest) * COARSEST);
            let tolerance_mm = (2.0 * self.tolerance_mm).min(coarsest.max(self.tolerance_mm));
            let mut coarser = Self { tolerance_mm, ..Self::default() };
            for corner in all {
                coarser.push(corner);
            }
            coarser.corners.extend(coarser.waiting.pop());
            coarser.waiting.clear();
            if coarser.corners.len() > MAX_CORNERS / 4 * 3 {
                coarser.corners.drain(..MAX_CORNERS / 4);
            }
            *self = Self { extent, ..coarser };
        }
    }

    /// Corners, with the last point.
    pub fn corners(&self) -> impl Iterator<Item = &TrailPoint> {
        self.corners.iter().chain(self.waiting.last())
    }

    /// Minimum and maximum of X, Y and Z, mm.
    #[must_use]
    pub const fn extent(&self) -> Option<[[f32; 3]; 2]> {
        self.extent
    }
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f32>().sqrt()
}

/// Distance of a point from the segment between two others.
fn distance_to_line(point: [f32; 3], from: [f32; 3], to: [f32; 3]) -> f32 {
    let (mut dot, mut square) = (0.0, 0.0);
    for i in 0..3 {
        let along = to[i] - from[i];
        dot += (point[i] - from[i]) * along;
        square += along * along;
    }
    let share = if square > 0.0 { (dot / square).clamp(0.0, 1.0) } else { 0.0 };
    distance(point, std::array::from_fn(|i| from[i] + share * (to[i] - from[i])))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trail(points: impl IntoIterator<Item = [f32; 3]>) -> Trail {
        let mut trail = Trail::default();
        for (n, at) in points.into_iter().enumerate() {
            trail.push(TrailPoint { along_mm: n as f64, at, rapid: false });
        }
        trail
    }

    #[test]
    fn a_straight_line_needs_few_corners_and_a_right_angle_is_one() {
        let line = (0..1000).map(|n| [n as f32 * 0.1, 0.0, 0.0]);
        let corner = (1..1000).map(|n| [99.9, n as f32 * 0.1, 0.0]);
        let trail = trail(line.chain(corner));
        assert!(trail.corners().count() < 100, "{}", trail.corners().count());
        assert!(trail.corners().any(|k| distance(k.at, [99.9, 0.0, 0.0]) < 0.15));
        assert_eq!(trail.extent(), Some([[0.0; 3], [99.9, 99.9, 0.0]]));
    }

    #[test]
    fn a_million_points_at_random_are_bounded_and_near() {
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 65536.0
        };
        let trail = trail((0..1_000_000).map(|_| [random(), random(), random()]));
        assert!(trail.corners().count() <= MAX_CORNERS);
        assert!(trail.corners().count() > MAX_CORNERS / 8);
        let along: Vec<f64> = trail.corners().map(|k| k.along_mm).collect();
        assert!(along.is_sorted());
        assert!(along.last().is_some_and(|&last| last > 999_990.0), "the newest is always there");
    }
}
