//! The arc of a lead-in: the one circle through a start beside the path that meets the path in its direction (CUT-39).
//!
//! Places are relative to the join J, in mm; the path runs through J in the direction t, with its normal n to the left.
//! A circle of the signed curvature κ through J in that direction has its point at the length s before J at
//! 2 sin(κs/2)/κ · (sin(κs/2) n − cos(κs/2) t). It goes through d where κ = 2 (d·n)/|d|².
//!
//! Invariant: the curve begins at d and ends in J, to the pulse; its speed is highest at J.

/// Smallest radius of an arc, mm: a torch does not follow a smaller one, nor does the kerf fit into it.
const MIN_RADIUS_MM: f64 = 0.5;
/// Radius in mm of the arc from the nearest start that a refusal names, which is typed in rounded, and is rounded to
/// pulses.
const NAMED_RADIUS_MM: f64 = 1.05 * MIN_RADIUS_MM;
/// Sine of the angle by which an arc may be longer than a half circle: the direction of the path is measured in pulses.
const DIRECTION_TOLERANCE: f64 = 0.01;
/// Share of an axis' acceleration and jerk that an arc may use, as a planned path does.
const LIMIT_SHARE: f64 = 0.9;
/// Control periods in which the acceleration may change at the join, at twice the jerk: as where the rate changes.
const JOIN_PERIODS: f64 = 8.0;

/// How the path runs through a place: X and Y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PathMotion {
    /// mm/s
    pub(crate) velocity: [f64; 2],
    /// mm/s²
    pub(crate) acceleration: [f64; 2],
}

/// What an axis may do, the least of both axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PlaneLimits {
    /// mm/s²
    pub(crate) acceleration: f64,
    /// mm/s³
    pub(crate) jerk: f64,
}

/// Why there is no arc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeadArcError {
    /// Angle in degrees by which the arc would turn.
    pub degrees: f64,
    /// Radius that it would have, mm.
    pub radius_mm: f64,
    /// The nearest start of the same distance for which there is an arc, mm.
    pub nearest_mm: [f64; 2],
}

impl std::fmt::Display for LeadArcError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { degrees, radius_mm, nearest_mm } = self;
        // without a negative zero
        let [x, y] = nearest_mm.map(|mm| (mm * 1000.0).round() / 1000.0 + 0.0);
        write!(
            f,
            "the arc would turn by {degrees:.0}° with a radius of {radius_mm:.3} mm; it may turn by 180°, with at \
             least {MIN_RADIUS_MM} mm: the nearest is `shift {x:.3} {y:.3}`"
        )
    }
}

impl std::error::Error for LeadArcError {}

/// An arc that ends in J.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LeadArc {
    /// Direction of the path in J.
    tangent: [f64; 2],
    /// 1/mm, positive to the left.
    curvature: f64,
    length_mm: f64,
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

impl LeadArc {
    /// The arc from `start_mm` that meets the path in the direction `tangent`, which has the length 1.
    ///
    /// # Errors
    /// It would turn by more than 180°, or its radius would be too small.
    pub(crate) fn new(start_mm: [f64; 2], tangent: [f64; 2]) -> Result<Self, LeadArcError> {
        let normal = [-tangent[1], tangent[0]];
        let (along, across) = (dot(start_mm, tangent), dot(start_mm, normal));
        let distance_mm = along.hypot(across);
        // A start in J has no direction that the arc could turn from.
        let curvature = if distance_mm > 0.0 { 2.0 * across / distance_mm.powi(2) } else { 0.0 };
        let angle = 2.0 * across.abs().atan2(-along);
        let radius_mm = curvature.abs().recip();
        if along > DIRECTION_TOLERANCE * distance_mm || radius_mm < MIN_RADIUS_MM {
            let across_mm = distance_mm.min(distance_mm.powi(2) / (2.0 * NAMED_RADIUS_MM)).copysign(across);
            let across_mm = if along > 0.0 { across_mm } else { across_mm.abs().min(across.abs()).copysign(across) };
            let along_mm = -(distance_mm.powi(2) - across_mm.powi(2)).max(0.0).sqrt();
            let nearest_mm = [0, 1].map(|axis| along_mm * tangent[axis] + across_mm * normal[axis]);
            return Err(LeadArcError { degrees: angle.to_degrees(), radius_mm, nearest_mm });
        }
        let length_mm = if curvature == 0.0 { distance_mm } else { angle * radius_mm };
        Ok(Self { tangent, curvature, length_mm })
    }

    /// Its point at this length before J.
    fn point(&self, before_mm: f64) -> [f64; 2] {
        let half = 0.5 * self.curvature * before_mm;
        let chord_mm = before_mm * if half.abs() < 1e-6 { 1.0 } else { half.sin() / half };
        let ([x, y], (sin, cos)) = (self.tangent, half.sin_cos());
        [chord_mm * (-cos * x - sin * y), chord_mm * (-cos * y + sin * x)]
    }

    /// Highest speed in mm/s up to `most` at which it is within the limits.
    pub(crate) fn speed_within(&self, limits: PlaneLimits, most: f64) -> f64 {
        let radius_mm = self.curvature.abs().recip();
        let by_acceleration = (LIMIT_SHARE * limits.acceleration * radius_mm).sqrt();
        let by_jerk = (LIMIT_SHARE * limits.jerk * radius_mm * radius_mm).cbrt();
        most.min(by_acceleration).min(by_jerk)
    }

    /// Share of the path's speed at which J can be passed: by what the acceleration changes there, by the limits on the
    /// arc, and by the length in which the machine comes to that speed.
    pub(crate) fn join_rate(&self, path: PathMotion, limits: PlaneLimits, period_s: f64) -> f64 {
        let speed = path.velocity[0].hypot(path.velocity[1]);
        let [x, y] = self.tangent;
        let inward = speed * speed * self.curvature;
        let change = [path.acceleration[0] + inward * y, path.acceleration[1] - inward * x];
        let change = change[0].abs().max(change[1].abs());
        let most = 2.0 * limits.jerk * JOIN_PERIODS * period_s;
        let by_change = (most / change).sqrt();
        let by_limits = self.speed_within(limits, speed) / speed;
        let by_length = speed_within_length(self.length_mm, limits, JOIN_PERIODS * period_s) / speed;
        by_change.min(by_limits).min(by_length).min(1.0)
    }

    /// The points at the ends of its records, from the one behind the start to J, at this speed in J, mm/s.
    pub(crate) fn points(&self, speed: f64, period_s: f64) -> impl Iterator<Item = [f64; 2]> {
        let stride_mm = speed * period_s;
        let records = (self.length_mm / stride_mm).ceil().max(1.0);
        // It begins a little slower, so that it has a whole number of records.
        let slower_mm = 2.0 * (stride_mm - self.length_mm / records) / records;
        let arc = *self;
        (0..records as u32).rev().map(move |left| {
            let left = f64::from(left);
            arc.point(left * (stride_mm - 0.5 * slower_mm * left))
        })
    }
}

impl LeadArc {
    /// The counts of X and Y at the ends of its records, as [`LeadArc::points`] has them, from those of the join.
    ///
    /// # Errors
    /// The index of the axis that would leave its travel, which is in counts.
    pub(crate) fn counts(
        &self,
        speed: f64,
        period_s: f64,
        join: [i64; 2],
        mm_per_pulse: [f64; 2],
        travel: [[i64; 2]; 2],
    ) -> Result<Vec<[i64; 2]>, usize> {
        let at = |mm: [f64; 2]| [0, 1].map(|axis| join[axis] + (mm[axis] / mm_per_pulse[axis]).round() as i64);
        let counts: Vec<[i64; 2]> = self.points(speed, period_s).map(at).collect();
        let is_beyond = |axis: &usize| {
            let [low, high] = travel[*axis];
            counts.iter().chain(&[at(self.point(self.length_mm))]).any(|at| !(low..=high).contains(&at[*axis]))
        };
        let beyond = (0..2).find(is_beyond);
        beyond.map_or(Ok(counts), Err)
    }
}

/// Speed in mm/s to which the rate rises from rest within a length, at half of the acceleration, and runs for
/// `settling_s` then.
fn speed_within_length(length_mm: f64, limits: PlaneLimits, settling_s: f64) -> f64 {
    let acceleration = 0.5 * limits.acceleration;
    // v (v/A + A/J) / 2 + v t = length
    let b = 0.5 * acceleration / limits.jerk + settling_s;
    acceleration * (-b + (b * b + 2.0 * length_mm / acceleration).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PERIOD_S: f64 = 0.001;
    const LIMITS: PlaneLimits = PlaneLimits { acceleration: 2_500.0, jerk: 40_000.0 };

    /// A straight path in this direction, at this speed.
    fn straight(tangent: [f64; 2], speed: f64) -> PathMotion {
        PathMotion { velocity: tangent.map(|part| part * speed), acceleration: [0.0; 2] }
    }

    fn length(mm: [f64; 2]) -> f64 {
        mm[0].hypot(mm[1])
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(10_000))]

        /// Any start and direction: the arc begins at the start, ends exactly in J and in its direction, keeps the
        /// limits at the rate of the join, and is refused exactly where one of its points is outside the travel.
        #[test]
        fn an_arc_is_exact_and_within_the_limits(
            turn in 0.0..std::f64::consts::TAU, angle in 0.0..std::f64::consts::TAU, distance_mm in 0.2..10.0_f64,
            pulses_per_mm in 100.0..2_000.0_f64, speed in 5.0..100.0_f64, margin_mm in 0.0..6.0_f64, side in 0..4_usize,
        ) {
            let tangent = [turn.cos(), turn.sin()];
            let start = [distance_mm * angle.cos(), distance_mm * angle.sin()];
            let arc = match LeadArc::new(start, tangent) {
                Ok(arc) => arc,
                Err(why) => {
                    let along = dot(start, tangent);
                    prop_assert!(along > 0.0 || why.radius_mm < MIN_RADIUS_MM);
                    prop_assert!((length(why.nearest_mm) - distance_mm).abs() < 1e-9);
                    // typed in as it is shown
                    let typed = why.nearest_mm.map(|mm| (mm * 1000.0).round() / 1000.0 * (1.0 + 1e-9));
                    let near = LeadArc::new(typed, tangent);
                    prop_assert!(near.is_ok() || distance_mm < 0.5, "{near:?}");
                    return Ok(());
                }
            };
            let rate = arc.join_rate(straight(tangent, speed), LIMITS, PERIOD_S);
            let begins = arc.point(arc.length_mm);
            prop_assert!(length([begins[0] - start[0], begins[1] - start[1]]) < 1e-9);
            let mut points = vec![start];
            points.extend(arc.points(speed, PERIOD_S));
            prop_assert_eq!(points[points.len() - 1], [0.0; 2]);
            let strokes: Vec<[f64; 2]> =
                points.windows(2).map(|pair| [0, 1].map(|axis| pair[1][axis] - pair[0][axis])).collect();
            for stroke in &strokes {
                prop_assert!(length(*stroke) <= speed * PERIOD_S * (1.0 + 1e-9));
            }
            for pair in strokes.windows(2) {
                let change = [0, 1].map(|axis| (pair[1][axis] - pair[0][axis]) * rate * rate / PERIOD_S / PERIOD_S);
                prop_assert!(change.iter().all(|a| a.abs() <= LIMITS.acceleration), "{change:?}");
            }
            // into the path: a record of it follows
            if let Some(last) = strokes.last().filter(|_| strokes.len() > 20) {
                let change = [0, 1].map(|axis| (tangent[axis] * speed * PERIOD_S - last[axis]) / PERIOD_S / PERIOD_S);
                let most = 2.0 * LIMITS.jerk * JOIN_PERIODS * PERIOD_S;
                prop_assert!(change.iter().all(|a| (a * rate * rate).abs() <= most), "{change:?}");
                let turned = dot(*last, tangent) / length(*last);
                prop_assert!(turned > 0.97 || arc.curvature.abs() * speed * PERIOD_S > 0.2, "{turned}");
            }
            // a limit on one side of J
            let mm_per_pulse = [pulses_per_mm.recip(); 2];
            let join = [1_000, -2_000];
            let far = 1_000_000;
            let mut travel = [[-far, far], [-far, far]];
            let (axis, is_high) = (side / 2, side % 2);
            let sign = if is_high == 1 { 1.0 } else { -1.0 };
            travel[axis][is_high] = join[axis] + (sign * margin_mm * pulses_per_mm).round() as i64;
            let centre = [-tangent[1] / arc.curvature, tangent[0] / arc.curvature];
            let turned = arc.length_mm * arc.curvature;
            // an own way along the circle: J turned back about the centre
            let on_circle = |part: u32| {
                let (sin, cos) = (-turned * f64::from(part) / 5_000.0).sin_cos();
                [-centre[0] * cos + centre[1] * sin + centre[0], -centre[0] * sin - centre[1] * cos + centre[1]]
            };
            let extreme_mm = (0..=5_000).map(|part| sign * on_circle(part)[axis]).fold(f64::NEG_INFINITY, f64::max);
            let beyond_pulses = (extreme_mm - margin_mm) * pulses_per_mm;
            // between the ends of two records, and in the rounding
            let bulge_pulses = (speed * PERIOD_S).powi(2) * arc.curvature.abs() * pulses_per_mm / 2.0 + 1.5;
            let counts = arc.counts(speed, PERIOD_S, join, mm_per_pulse, travel);
            match &counts {
                Ok(counts) => {
                    prop_assert!(beyond_pulses <= bulge_pulses, "{beyond_pulses} pulses beyond");
                    prop_assert_eq!(counts.last(), Some(&join));
                    prop_assert!(counts.iter().all(|at| at[axis] as f64 * sign <= travel[axis][is_high] as f64 * sign));
                }
                Err(beyond) => prop_assert!(*beyond == axis && beyond_pulses >= -bulge_pulses, "{beyond_pulses}"),
            }
        }

        /// At 3 m/min, 2.5 m/s² and 40 m/s³ a straight path is joined at half of its speed or more from 2 mm on.
        #[test]
        fn the_path_is_joined_at_half_of_its_speed(
            turn in 0.0..std::f64::consts::TAU, back in 0.0..std::f64::consts::PI, distance_mm in 2.0..10.0_f64,
        ) {
            let (tangent, start) = ([turn.cos(), turn.sin()], turn + std::f64::consts::FRAC_PI_2 + back);
            let arc = LeadArc::new([distance_mm * start.cos(), distance_mm * start.sin()], tangent).expect("an arc");
            let rate = arc.join_rate(straight(tangent, 50.0), LIMITS, PERIOD_S);
            prop_assert!((0.5..=1.0).contains(&rate), "{rate}");
        }
    }

    #[test]
    fn what_is_no_arc_names_the_nearest_start() {
        let refused = |start: [f64; 2]| LeadArc::new(start, [1.0, 0.0]).expect_err("no arc");
        let ahead = refused([3.0, 4.0]);
        assert!((ahead.degrees - 253.74).abs() < 0.01 && (ahead.radius_mm - 3.125).abs() < 1e-9, "{ahead:?}");
        assert_eq!(ahead.nearest_mm, [0.0, 5.0]);
        let small = refused([-0.1, -0.6]);
        assert!(small.radius_mm < MIN_RADIUS_MM && (small.nearest_mm[1] + 0.37 / 1.05).abs() < 1e-9, "{small:?}");
        assert!(
            ahead.to_string().contains("by 254° with a radius of 3.125 mm") && ahead.to_string().contains("`shift")
        );
        // straight ahead of the path is no circle at all
        assert_eq!(refused([2.0, 0.0]).nearest_mm, [0.0, 2.0]);
        let straight = LeadArc::new([-2.0, 0.0], [1.0, 0.0]).expect("a line");
        assert_eq!((straight.curvature, straight.length_mm), (0.0, 2.0));
    }
}
