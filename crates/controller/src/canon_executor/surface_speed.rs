//! Constant surface speed, G96: the speed of the spindle is a function of X (SPN-9).
//!
//! The speed changes in steps of 1 %, whose borders are radii that depend on nothing but the surface speed. A move
//! that passes a border switches S there, in passing; under G95 it is divided there, since its feed changes too.
//!
//! Invariant: behind a move, S is that of the X where it ends; the path of a move does not depend on the borders.

use std::f64::consts::TAU;

use retrace_config::CutterKind;
use retrace_gcode::Axis;
use retrace_link::{OutputChange, channel};
use retrace_motion::{Arc as ArcMove, FeedRate, PathMode};

use super::CanonExecutor;
use crate::canon_error::CanonError;
use crate::motion_sink::MotionSink;

/// Ratio of two adjacent steps of the speed.
const STEP: f64 = 1.01;
/// Speeds from here on count as no limit, turns per minute: the interpreter gives 10³⁰ where there is no D word.
const NO_LIMIT_RPM: f64 = 1e9;
/// Step that no radius in mm reaches.
const LAST_STEP: i32 = 4000;
/// Halvings to find a border, as a share of a move.
const HALVINGS: u32 = 50;
/// Smallest part of an arc that is divided, radians. An arc without an angle would be a whole circle.
const MIN_PART_RAD: f64 = 1e-6;

/// The speed of the spindle as a function of the radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SurfaceSpeed {
    /// Speed of the work's surface, mm/min. Unknown (NaN) before the S word.
    surface_mm_min: f64,
    /// Lowest and highest speed, turns per minute.
    range_rpm: [f64; 2],
    /// Steps of the lowest and the highest radius; beyond them the speed is limited.
    steps: [i32; 2],
}

impl SurfaceSpeed {
    fn new(surface_mm_min: f64, range_rpm: [f64; 2]) -> Self {
        let [least, most] = range_rpm;
        let step_of = |rpm: f64| (surface_mm_min / (TAU * rpm)).ln() / STEP.ln();
        let steps = if surface_mm_min > 0.0 {
            let last = if least > 0.0 { step_of(least).ceil() as i32 } else { LAST_STEP };
            [step_of(most).floor() as i32, last]
        } else {
            [0; 2]
        };
        Self { surface_mm_min, range_rpm, steps }
    }

    /// Step of the speed at this X, mm.
    fn step(&self, x_mm: f64) -> i32 {
        let [first, last] = self.steps;
        // At the axis the logarithm is infinite: the first step.
        ((x_mm.abs().ln() / STEP.ln()).round() as i32).max(first).min(last)
    }

    /// Speed in turns per minute.
    fn rpm(&self, step: i32) -> f64 {
        if self.surface_mm_min <= 0.0 {
            return 0.0;
        }
        let [least, most] = self.range_rpm;
        (self.surface_mm_min / (TAU * STEP.powi(step))).max(least).min(most)
    }

    /// Calls `found` for each change of the step along a move, with the share of its length and the new step. `x`: X
    /// in mm at a share of the move. `turns`: shares at which X turns, ascending.
    fn for_each_change(
        &self,
        x: impl Fn(f64) -> f64,
        turns: impl Iterator<Item = f64>,
        mut found: impl FnMut(f64, i32),
    ) {
        let (mut from, mut step) = (0.0, self.step(x(0.0)));
        for turn in turns.chain([1.0]) {
            let passes_axis = x(from) * x(turn) < 0.0;
            let axis = if passes_axis { halved(from, turn, &x) } else { turn };
            for to in if passes_axis { [axis, turn] } else { [turn, turn] } {
                let last = self.step(x(to));
                while step != last {
                    let next = step + (last - step).signum();
                    let border_mm = STEP.powf(f64::from(step + next) / 2.0);
                    from = halved(from, to, |share| x(share).abs() - border_mm);
                    step = next;
                    found(from, step);
                }
                from = to;
            }
        }
    }
}

/// The place between `from` and `to` where a monotone value changes its sign.
fn halved(from: f64, to: f64, value: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high, is_positive) = (from, to, value(from) > 0.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if (value(middle) > 0.0) == is_positive { low = middle } else { high = middle }
    }
    high
}

/// S in the unit of its output.
fn thousandths(rpm: f64) -> i32 {
    (rpm * 1000.0).clamp(0.0, f64::from(i32::MAX)).round() as i32
}

/// A part of a move under G96 that ends at a share of the move's length.
#[derive(Clone, Copy, Debug)]
struct MovePart {
    to: f64,
    /// Speed in this part, turns per minute.
    rpm: f64,
}

impl CanonExecutor<'_> {
    /// G96 with the highest speed of its D word, in turns per minute; G97 with 0.
    pub(super) fn set_spindle_mode(&mut self, highest_rpm: f64) -> Result<(), CanonError> {
        if highest_rpm == 0.0 {
            // Without an S word the spindle keeps the speed that it has.
            self.surface_speed = None;
            return Ok(());
        }
        let is_beam = self.machine.cutter_of(channel::SPINDLE).is_some_and(|cutter| cutter.kind == CutterKind::Beam);
        if is_beam || self.machine.powered_beam().is_some() {
            return Err(CanonError::NotSupported("constant surface speed (G96), where S is the power of a beam,"));
        }
        let spindle = &self.machine.spindle;
        let most = highest_rpm.min(spindle.max_rpm);
        if most >= NO_LIMIT_RPM {
            return Err(CanonError::SurfaceSpeed);
        }
        if !self.axes.contains(&Axis::X) {
            return Err(CanonError::NoSuchAxis('X'));
        }
        self.surface_speed = Some(SurfaceSpeed::new(f64::NAN, [spindle.min_rpm.min(most), most]));
        Ok(())
    }

    /// S under G96: the surface speed in metres or feet per minute. The spindle gets the speed of X here.
    pub(super) fn set_surface_speed<const A: usize>(
        &mut self,
        speed: f64,
        of: SurfaceSpeed,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let metres = if self.unit.millimetres() == 1.0 { speed } else { speed * 0.3048 };
        let of = SurfaceSpeed::new(metres * 1000.0, of.range_rpm);
        self.surface_speed = Some(of);
        let rpm = self.rpm_at(of, &self.position::<A>());
        let is_new = rpm.is_nan() || thousandths(rpm) != thousandths(self.rpm) || self.rpm.is_nan();
        self.set_rpm(rpm);
        if is_new && !rpm.is_nan() { self.set_speed("S", thousandths(rpm), line, sink) } else { Ok(()) }
    }

    /// The mode of a path of a check that continues elsewhere.
    pub(super) fn follow_surface_speed(&mut self, highest_rpm: f64, speed: f64) {
        self.surface_speed = None;
        self.rpm = if highest_rpm == 0.0 { speed } else { f64::NAN };
        // What is not supported has been reported where it was programmed.
        if highest_rpm > 0.0 && self.set_spindle_mode(highest_rpm).is_ok() {
            let metres = if self.unit.millimetres() == 1.0 { speed } else { speed * 0.3048 };
            self.surface_speed = self.surface_speed.map(|of| SurfaceSpeed::new(metres * 1000.0, of.range_rpm));
        }
    }

    /// Gives a straight move to the sink; under G96, with the changes of S along it.
    pub(super) fn give_line<const A: usize>(
        &mut self,
        (start, end): (&[f64; A], [f64; A]),
        feed: FeedRate,
        mode: PathMode,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let Some(speed) = self.surface_speed else { return Ok(sink.straight(end, feed, mode, line)?) };
        let [from, to] = [start, &end].map(|point| self.work_x_mm(point));
        let parts = self.parts(speed, |share| from + share * (to - from), [].into_iter(), 0.0, line, sink);
        if self.feed_mm_per_turn.is_none() || matches!(feed, FeedRate::Rapid) {
            self.mark_parts(&parts, line, sink);
            return Ok(sink.straight(end, feed, mode, line)?);
        }
        let at = |share: f64| std::array::from_fn(|axis| start[axis] + share * (end[axis] - start[axis]));
        self.for_each_part(&parts, mode, line, sink, |this, part, mode, sink| {
            let end = if part.to < 1.0 { at(part.to) } else { end };
            Ok(sink.straight(end, this.feed(), mode, line)?)
        })
    }

    /// Gives an arc to the sink; under G96, with the changes of S along it.
    pub(super) fn give_arc<const A: usize>(
        &mut self,
        arc: &ArcMove<A>,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let (start, mode) = (self.position::<A>(), self.path);
        let Some(speed) = self.surface_speed else { return Ok(sink.arc(arc, self.feed(), mode, line)?) };
        let (begins, sweep) = arc.sweep(&start);
        let at = |share: f64| arc_point(arc, &start, (begins, sweep), share);
        // X is a linear function of the coordinates.
        let start_x_mm = self.work_x_mm(&start);
        let slopes: [f64; A] = std::array::from_fn(|axis| {
            let mut moved = start;
            moved[axis] += 1.0;
            self.work_x_mm(&moved) - start_x_mm
        });
        let x = |share: f64| {
            let moved = at(share).into_iter().zip(start);
            start_x_mm + moved.zip(slopes).map(|((to, from), slope)| slope * (to - from)).sum::<f64>()
        };
        // It turns where the direction from the centre is along its slope.
        let [p, q] = arc.plane.map(|axis| slopes[axis]);
        let first = if (p, q) == (0.0, 0.0) { f64::INFINITY } else { first_turn(q.atan2(p), begins, sweep) };
        let interval = std::f64::consts::PI / sweep.abs();
        let turns = (0..).map(|k| first + f64::from(k) * interval).take_while(|&share| share < 1.0);
        let parts = self.parts(speed, x, turns, MIN_PART_RAD / sweep.abs(), line, sink);
        if self.feed_mm_per_turn.is_none() {
            self.mark_parts(&parts, line, sink);
            return Ok(sink.arc(arc, self.feed(), mode, line)?);
        }
        let mut from = 0.0;
        self.for_each_part(&parts, mode, line, sink, |this, part, mode, sink| {
            let whole_turns = ((part.to - from) * sweep.abs() / TAU).ceil().max(1.0) as i32;
            from = part.to;
            let end_mm = if part.to < 1.0 { at(part.to) } else { arc.end_mm };
            let part = ArcMove { rotation: arc.rotation.signum() * whole_turns, end_mm, ..*arc };
            Ok(sink.arc(&part, this.feed(), mode, line)?)
        })
    }

    /// The parts of a move with their speeds, the last one to its end. The speed of the first is in force behind this.
    /// Unknown where X or S is.
    fn parts<const A: usize>(
        &mut self,
        speed: SurfaceSpeed,
        x: impl Fn(f64) -> f64,
        turns: impl Iterator<Item = f64>,
        min_share: f64,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Vec<MovePart> {
        if speed.surface_mm_min.is_nan() || speed.range_rpm[1].is_nan() || x(0.0).is_nan() || x(1.0).is_nan() {
            self.set_rpm(f64::NAN);
            return vec![MovePart { to: 1.0, rpm: f64::NAN }];
        }
        let mut parts = vec![MovePart { to: 1.0, rpm: speed.rpm(speed.step(x(0.0))) }];
        let mut from = 0.0;
        speed.for_each_change(x, turns, |share, step| {
            let rpm = speed.rpm(step);
            let Some(last) = parts.last_mut().filter(|last| thousandths(last.rpm) != thousandths(rpm)) else { return };
            if share - from <= min_share {
                last.rpm = rpm;
            } else if 1.0 - share > min_share {
                last.to = share;
                from = share;
                parts.push(MovePart { to: 1.0, rpm });
            }
        });
        let value = thousandths(parts[0].rpm);
        if self.rpm.is_nan() || thousandths(self.rpm) != value {
            sink.action(OutputChange { channel: channel::SPEED, value }, line);
        }
        self.set_rpm(parts[0].rpm);
        parts
    }

    /// Switches S within the next move.
    fn mark_parts<const A: usize>(&mut self, parts: &[MovePart], line: u32, sink: &mut impl MotionSink<A>) {
        for pair in parts.windows(2) {
            let value = thousandths(pair[1].rpm);
            sink.action_within(pair[0].to, OutputChange { channel: channel::SPEED, value }, line);
            self.set_rpm(pair[1].rpm);
        }
    }

    /// Gives each part of a move to the sink as a move of its own, behind its change of S.
    fn for_each_part<const A: usize, S: MotionSink<A>>(
        &mut self,
        parts: &[MovePart],
        mode: PathMode,
        line: u32,
        sink: &mut S,
        mut give: impl FnMut(&Self, &MovePart, PathMode, &mut S) -> Result<(), CanonError>,
    ) -> Result<(), CanonError> {
        for (index, part) in parts.iter().enumerate() {
            if index > 0 {
                sink.action(OutputChange { channel: channel::SPEED, value: thousandths(part.rpm) }, line);
                self.set_rpm(part.rpm);
            }
            // Only the end of the whole move is a stop.
            let is_inside = index + 1 < parts.len() && mode == PathMode::ExactStop;
            give(self, part, if is_inside { PathMode::ExactPath } else { mode }, sink)?;
        }
        Ok(())
    }

    fn rpm_at<const A: usize>(&self, speed: SurfaceSpeed, at: &[f64; A]) -> f64 {
        let x_mm = self.work_x_mm(at);
        let is_known = !(speed.surface_mm_min.is_nan() || speed.range_rpm[1].is_nan() || x_mm.is_nan());
        if is_known { speed.rpm(speed.step(x_mm)) } else { f64::NAN }
    }

    /// X of the work system at a position of the machine's axes, mm: the distance from the axis of turning.
    fn work_x_mm<const A: usize>(&self, at: &[f64; A]) -> f64 {
        let mut pose = self.at;
        for (&axis, &mm) in self.axes.iter().zip(at) {
            pose[axis] = mm;
        }
        if let Some(correction) = &self.correction {
            pose[correction.axis()] -= correction.mm();
        }
        self.program_position(&pose)[Axis::X] * self.unit.millimetres()
    }
}

/// Position on an arc at a share of its angle, as the planner passes it.
fn arc_point<const A: usize>(arc: &ArcMove<A>, start: &[f64; A], (begins, sweep): (f64, f64), share: f64) -> [f64; A] {
    let ([p, q], [centre_p, centre_q]) = (arc.plane, arc.centre_mm);
    let radius = (start[p] - centre_p).hypot(start[q] - centre_q);
    let on_circle = |share: f64| {
        let (sin, cos) = (begins + share * sweep).sin_cos();
        [centre_p + radius * cos, centre_q + radius * sin]
    };
    let mut at = std::array::from_fn(|axis| start[axis] + share * (arc.end_mm[axis] - start[axis]));
    // Where the end is a little off the circle, the path drifts there evenly.
    let (here, end) = (on_circle(share), on_circle(1.0));
    at[p] = here[0] + share * (arc.end_mm[p] - end[0]);
    at[q] = here[1] + share * (arc.end_mm[q] - end[1]);
    at
}

/// The first share of an arc, above 0, at which its direction is along `slope` or against it, all in radians.
fn first_turn(slope: f64, begins: f64, sweep: f64) -> f64 {
    let half = std::f64::consts::PI;
    let angle = ((slope - begins) * sweep.signum()).rem_euclid(half);
    (if angle > 0.0 { angle } else { half }) / sweep.abs()
}
