//! The check before the run: every move is checked before the first one is made (PRE-5, *Beyond the source*).
//!
//! Invariant: a program that passes the check is programmed within the soft limits of every axis. Blends may leave the
//! programmed path by their tolerance.

use std::collections::{BTreeMap, BTreeSet};

use retrace_config::{EncoderConfig, MachineConfig};
use retrace_link::{OutputChange, channel};
use retrace_motion::{Arc, FeedRate, PathMode};

use crate::check_finding::{CheckFinding, FindingList};
use crate::contour_list::ContourList;
use crate::motion_sink::MotionSink;
use crate::plan_writer::{Cancelled, PlanWriteError, SwitchInstruction};
use crate::soft_limits::{LimitFinding, extremes};
use crate::tap_move::RigidTap;
use crate::thread_plan::{ThreadCheck, ThreadRuns, ThreadStretch};

/// Checks every move of a program.
#[derive(Debug)]
pub struct LimitCheck<'m, const A: usize> {
    machine: &'m MachineConfig,
    at: [f64; A],
    /// Least and greatest coordinate of each axis so far, mm.
    pub extents_mm: Option<[[f64; 2]; A]>,
    /// Moves beyond the soft limits, once for a line and an axis.
    pub beyond: FindingList,
    /// Program lines with moves of unknown end or way: their limits are checked as they are planned (PRB-19).
    pub unknown_moves: BTreeSet<u32>,
    /// Number of moves.
    pub moves: u64,
    /// The same as `extents_mm`, since they were taken last.
    last_mm: Option<[[f64; 2]; A]>,
    /// Digital outputs that are on, each with the line that switched it on.
    on: BTreeMap<u8, u32>,
    /// Outputs that were on in a feed move and that the machine file does not declare, each with the line that switched
    /// it on.
    undeclared: BTreeMap<u8, u32>,
    /// Contours and materials, on a machine with a cutter.
    pub contours: ContourList<A>,
    /// Run-in and run-out of the threads.
    pub threads: ThreadRuns,
    thread_check: ThreadCheck,
}

impl<'m, const A: usize> LimitCheck<'m, A> {
    /// Creates a check that begins at the machine's position.
    #[must_use]
    pub fn new(machine: &'m MachineConfig) -> Self {
        Self {
            machine,
            at: machine.start_mm(),
            extents_mm: None,
            beyond: FindingList::default(),
            unknown_moves: BTreeSet::new(),
            moves: 0,
            last_mm: None,
            on: BTreeMap::new(),
            undeclared: BTreeMap::new(),
            contours: ContourList::default().on_machine(machine),
            threads: ThreadRuns::default(),
            thread_check: ThreadCheck::default(),
        }
    }

    /// Lists at most this number of contours.
    #[must_use]
    pub(crate) fn with_contours(mut self, max_contours: usize) -> Self {
        self.contours = ContourList::limited_to(max_contours).on_machine(self.machine);
        self
    }

    /// The machine whose moves these are.
    #[must_use]
    pub fn machine(&self) -> &'m MachineConfig {
        self.machine
    }

    /// Position of the machine, mm.
    pub(crate) fn position_mm(&self) -> &[f64; A] {
        &self.at
    }

    /// Whether the program has switched this output on.
    pub(crate) fn is_on(&self, channel: u8) -> bool {
        self.on.contains_key(&channel)
    }

    /// Least and greatest coordinates of the ends of moves since the last call, mm.
    pub fn take_last(&mut self) -> Option<[[f64; 2]; A]> {
        self.last_mm.take()
    }

    /// Warnings about the program's use of outputs. None of them prevents the run.
    #[must_use]
    pub fn warnings(&self) -> Vec<CheckFinding> {
        let name = |channel: u8| self.machine.channel_name(channel);
        let left_on = self.on.iter().filter(|(channel, _)| self.machine.cutting_outputs.contains(channel));
        let left_on = left_on.map(|(&channel, &line)| CheckFinding {
            line,
            word: None,
            number: "W4101",
            cause: format!("{} is still on when the program ends; the end of the job switches it off", name(channel)),
            remedy: "switch it off where its cut ends".into(),
            more_rounds: 0,
        });
        let undeclared = self.undeclared.iter().map(|(&channel, &line)| CheckFinding {
            line,
            word: None,
            number: "W4102",
            cause: format!(
                "{} is on in feed moves, and the machine file declares no cutter: a stop leaves it on",
                name(channel)
            ),
            remedy: "declare it with [[cutter]] if it cuts, or name it with [[output]]".into(),
            more_rounds: 0,
        });
        let mut all: Vec<CheckFinding> = left_on.chain(undeclared).collect();
        all.sort_by_key(|finding| finding.line);
        all
    }

    /// Squared distance over the linear axes, without those in `besides`.
    pub(crate) fn linear_squared(&self, from: &[f64; A], to: &[f64; A], besides: &[usize]) -> f64 {
        let axes = self.machine.axes.iter().enumerate().take(A);
        let linear = axes.filter(|(index, axis)| !axis.is_rotary() && !besides.contains(index));
        linear.map(|(index, _)| (to[index] - from[index]).powi(2)).sum()
    }

    /// Path length of an arc from the last position, over the linear axes.
    pub(crate) fn arc_mm(&self, arc: &Arc<A>) -> f64 {
        let (from, [p, q]) = (self.at, arc.plane);
        let radius = (from[p] - arc.centre_mm[0]).hypot(from[q] - arc.centre_mm[1]);
        let in_plane = radius * arc.sweep(&from).1;
        (in_plane.powi(2) + self.linear_squared(&from, &arc.end_mm, &arc.plane)).sqrt()
    }

    /// Records a move of this length to `end_mm` in the contours.
    fn record_length(&mut self, feed: FeedRate, length_mm: f64, end_mm: [f64; A]) {
        match feed {
            // An unknown length is none of the sums; what it reaches is not known.
            _ if length_mm.is_nan() => self.contours.reach(&end_mm),
            FeedRate::Rapid => self.contours.rapid(length_mm),
            FeedRate::PerSecond(_) | FeedRate::Duration(_) => self.contours.cut(length_mm, end_mm),
        }
    }

    /// Records that a cutting output is switched.
    fn record_cutter(&mut self, change: OutputChange, line: u32) {
        let (channel, machine) = (change.channel, self.machine);
        if !machine.cutting_outputs.contains(&channel) {
            return;
        }
        if change.value == 0 {
            self.contours.end(channel, self.at);
        } else if !self.contours.is_open(channel) {
            let name = machine.cutter_of(channel).map_or("", |cutter| cutter.name.as_str());
            self.contours.begin(channel, name, line, self.at);
        }
    }

    /// Records that an output is switched.
    fn record_switching(&mut self, change: OutputChange, line: u32) {
        self.record_cutter(change, line);
        if change.value == 0 {
            self.on.remove(&change.channel);
        } else {
            self.on.entry(change.channel).or_insert(line);
        }
    }

    /// Records a feed move with the outputs as they are.
    fn record_feed_move(&mut self) {
        if self.machine.cutters.is_empty() && !self.on.is_empty() {
            let digital = self.on.iter().filter(|(channel, _)| usize::from(**channel) < channel::DIGITAL);
            let unnamed = digital.filter(|(channel, _)| !self.machine.output_names.contains_key(channel));
            self.undeclared.extend(unnamed.map(|(&channel, &line)| (channel, line)));
        }
    }

    /// Whether a position is beyond the soft limits.
    pub(crate) fn is_beyond(&self, position_mm: &[f64; A]) -> bool {
        LimitFinding::find(self.machine, position_mm, |_| true, 0).is_some()
    }

    /// Whether an arc from the last position leaves the soft limits on its way.
    pub(crate) fn is_arc_beyond(&self, arc: &Arc<A>) -> bool {
        extremes(&self.at, arc).iter().any(|point| self.is_beyond(point))
    }

    fn visit(&mut self, point: &[f64; A], line: u32) {
        for extents in [&mut self.extents_mm, &mut self.last_mm] {
            for (range, &x) in extents.get_or_insert_with(|| point.map(|x| [x, x])).iter_mut().zip(point) {
                *range = [range[0].min(x), range[1].max(x)];
            }
        }
        if let Some(beyond) = LimitFinding::find(self.machine, point, |_| true, line) {
            self.beyond.push(beyond.finding());
        }
        if has_unknown(point) {
            self.unknown_moves.insert(line);
        }
    }
}

/// Whether a position has an unknown coordinate.
pub(crate) fn has_unknown<const A: usize>(position_mm: &[f64; A]) -> bool {
    position_mm.iter().any(|mm| mm.is_nan())
}

impl<const A: usize> MotionSink<A> for LimitCheck<'_, A> {
    fn straight(&mut self, end_mm: [f64; A], feed: FeedRate, _: PathMode, line: u32) -> Result<(), PlanWriteError> {
        if !matches!(feed, FeedRate::Rapid) {
            self.record_feed_move();
        }
        self.moves += 1;
        let length_mm = self.linear_squared(&self.at, &end_mm, &[]).sqrt();
        self.record_length(feed, length_mm, end_mm);
        self.at = end_mm;
        self.visit(&end_mm, line);
        Ok(())
    }

    fn arc(&mut self, arc: &Arc<A>, feed: FeedRate, _: PathMode, line: u32) -> Result<(), PlanWriteError> {
        self.record_feed_move();
        self.moves += 1;
        self.record_length(feed, self.arc_mm(arc), arc.end_mm);
        self.contours.reach_arc(&self.at, arc);
        for point in extremes(&self.at, arc) {
            self.visit(&point, line);
            self.contours.reach(&point);
        }
        self.at = arc.end_mm;
        self.visit(&arc.end_mm, line);
        Ok(())
    }

    fn thread(&mut self, stretch: &ThreadStretch<A>, encoder: &EncoderConfig) -> Result<(), PlanWriteError> {
        if !has_unknown(&self.at) && !stretch.rpm.is_nan() {
            let planned = self.thread_check.run_mm(stretch, self.machine, encoder, self.at);
            let run_mm = planned.map_err(|error| PlanWriteError::of_thread(error, stretch.line()))?;
            self.threads.add(stretch.line(), run_mm);
        }
        stretch.pieces.iter().try_for_each(|piece| {
            let feed = FeedRate::PerSecond(piece.pitch_mm * stretch.rpm / 60.0);
            self.straight(piece.end_mm, feed, piece.mode, piece.line)
        })
    }

    fn tap(&mut self, tap: &RigidTap<A>, encoder: &EncoderConfig) -> Result<(), PlanWriteError> {
        let feed = FeedRate::PerSecond(tap.pitch_mm * tap.rpm / 60.0);
        self.straight(tap.depth_mm, feed, PathMode::ExactStop, tap.line)?;
        self.straight(tap.from_mm, feed, PathMode::ExactStop, tap.line)?;
        if !has_unknown(&tap.from_mm) && !has_unknown(&tap.depth_mm) && !tap.rpm.is_nan() {
            let planned = tap.run_in_mm(self.machine, encoder);
            let run_in_mm = planned.map_err(|error| PlanWriteError::of_thread(error, tap.line))?;
            // What is behind the depth is for the reversal.
            self.threads.add(tap.line, [run_in_mm, 0.0]);
        }
        Ok(())
    }

    fn unknown_motion(&mut self, end_mm: [f64; A], line: u32) {
        self.moves += 1;
        self.at = end_mm;
        self.visit(&end_mm, line);
        self.contours.reach(&end_mm);
        self.unknown_moves.insert(line);
    }

    fn set_position(&mut self, at_mm: [f64; A]) {
        self.at = at_mm;
    }

    fn action(&mut self, change: OutputChange, line: u32) {
        self.record_switching(change, line);
    }

    fn exclusive(&mut self, switch: SwitchInstruction<'_>) -> Result<(), Cancelled> {
        for &change in switch.changes {
            self.record_switching(change, switch.line);
        }
        Ok(())
    }

    fn message(&mut self, _: String, _: u32) -> Result<(), Cancelled> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_arc_is_looked_at_where_it_goes_furthest() {
        let machine = MachineConfig::parse(
            "[[axis]]\nname = \"x\"\npulses_per_mm = 1000\nmax_velocity_mm_per_s = \
            100\nmax_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-5, 12]\n[[axis]]\nname \
            = \"y\"\npulses_per_mm = 1000\nmax_velocity_mm_per_s = 100\nmax_acceleration_mm_per_s2 = \
            1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-12, 12]\n",
            "m",
        )
        .expect("valid");
        let mut scan = LimitCheck::<2>::new(&machine);
        let mode = PathMode::ExactPath;
        scan.straight([10.0, 0.0], FeedRate::Rapid, mode, 1).expect("looks only");
        let half = |rotation| Arc { plane: [0, 1], centre_mm: [0.0, 0.0], rotation, end_mm: [0.0, 10.0] };
        scan.arc(&half(1), FeedRate::PerSecond(1.0), mode, 2).expect("looks only");
        assert_eq!(scan.beyond.findings().len(), 0);
        scan.straight([10.0, 0.0], FeedRate::Rapid, mode, 3).expect("looks only");
        scan.arc(&half(-1), FeedRate::PerSecond(1.0), mode, 4).expect("looks only");
        let beyond = LimitFinding { axis: 'x', position_mm: -10.0, limit_mm: -5.0, line: 4 };
        assert_eq!(scan.beyond.findings(), [beyond.finding()]);
        assert_eq!(scan.extents_mm, Some([[-10.0, 10.0], [-10.0, 10.0]]));
    }
}
