//! A shifted restart: the cutter starts beside the path, and leads in to it along a straight line or an arc (CUT-37,
//! CUT-39, CUT-40).
//!
//! The way to the start is that of every approach: the tool axis up to the retract plane, the other axes across, the
//! tool axis down. The cutter is off on it. The lead-in runs at the feed of the contour. A line rests where it joins
//! the path. An arc has the path's speed there, and joins it at a rate at which the acceleration may change so much; it
//! rests where the path itself is slow.
//!
//! Invariant: every place of the lead-in is within the soft limits before anything moves; from the join on, the records
//! are those of the path.

use retrace_core::mode::{Mode, ModeOutput};
use retrace_core::playback::partial_increment;
use retrace_core::{Distance, Place, Rate, RateTarget, RecordIndex};
use retrace_gcode::Side;
use retrace_link::{HostCommand, MotionCard};

use super::Session;
use crate::approach::approach;
use crate::event::EventKind;
use crate::lead_arc::{LeadArc, PathMotion, PlaneLimits};
use crate::operator::{CommandError, LeadShape, Shift, StartSide};
use crate::record_streamer::{LeadIn, LeadInEnd, LeadInMove};

/// Share of an axis' maximum velocity at which it moves to the start: a record may be a pulse faster.
const RAPID_SHARE: f64 = 0.9;
/// Records behind the join in which the feed of the contour is looked for.
const FEED_RECORDS: u32 = 2_000;
/// Records on both sides of the join by which the motion there is measured.
const MOTION_RECORDS: u32 = 8;
/// Records behind the join for which the rate of the join is in force: longer than the change of the acceleration.
const JOIN_RECORDS: u32 = 2 * MOTION_RECORDS;
/// Least length of path in mm by which its direction is measured where it is slow.
const DIRECTION_MM: f64 = 0.1;
/// Least distance in mm from the path at which a start is on a side of it.
const MIN_SIDE_MM: f64 = 0.05;
/// Share of the feed from which on the path is joined in motion.
const MOVING_SHARE: f64 = 0.5;
/// Kerf in mm where no material states one.
pub(super) const USUAL_KERF_MM: f64 = 1.5;

const IN_LEAD_IN: CommandError =
    CommandError::NotNow("the machine is on its lead-in: `hold`, `resume`, `recover`, `shift`, `cut` or `stop`");
const NO_PLANE: CommandError = CommandError::NotNow("a shift needs the axes X and Y");
const TOO_FAR: CommandError = CommandError::NotNow("farther than `shift_max_mm` of the cutter's restart");
pub(super) const NOT_IN_CUT: CommandError = CommandError::NotNow(
    "no cut is interrupted here that could start beside the path: go back into it, then `cut`; `shift 0` starts on it",
);
const TOWARD_PART: CommandError =
    CommandError::NotNow("this is on the side of the part, by G41 or G42: the same shift again confirms it");
const MOVES: CommandError = CommandError::NotNow("the machine has to be at rest, held or retracing");

/// The start of a cutter beside the path.
#[derive(Debug, Default)]
pub(super) struct Lead {
    /// Where the next start lies in X and Y, from its place on the path.
    pub(super) shift_mm: [f64; 2],
    shape: LeadShape,
    /// The last shift toward the part that was asked for: the same again, or any while it is in force, is confirmed.
    toward_part: Option<[f64; 2]>,
    /// Both, as they were when the lead-in was planned.
    planned: ([f64; 2], LeadShape),
    /// Counts where the lead-in joins the path.
    join_counts: Option<Vec<i64>>,
    /// Maximum rate from the start up to this place, which is a little behind the join.
    rate: Option<(RecordIndex, Rate)>,
}

impl Lead {
    pub(super) fn is_shifted(&self) -> bool {
        self.shift_mm != [0.0; 2]
    }

    /// Whether the operator has left the start where it was planned.
    pub(super) fn is_as_planned(&self) -> bool {
        self.planned == (self.shift_mm, self.shape)
    }
}

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// *Lead*: how shifted starts lead in from now on.
    pub(super) fn set_lead(&mut self, shape: LeadShape) {
        self.recovery.lead.shape = shape;
        self.emit(EventKind::Lead(shape));
    }

    /// Whether the machine is on a lead-in.
    pub(super) fn is_on_lead_in(&self) -> bool {
        let place = self.card.status().place;
        self.streamer.lead_in().is_some_and(|lead_in| lead_in.record(place.record).is_some())
    }

    /// Refuses commands that retrace while the machine is on a lead-in.
    pub(super) fn require_path(&self) -> Result<(), CommandError> {
        if self.probing.is_active() {
            return Err(CommandError::NotNow("the machine probes or taps: hold or stop it"));
        }
        if self.is_on_lead_in() { Err(IN_LEAD_IN) } else { Ok(()) }
    }

    /// *Shift*: where the next start of the cutter lies, from its place on the path.
    pub(super) fn shift(&mut self, by: Shift) -> Result<(), CommandError> {
        let (place, is_held) = (self.card.status(), self.mode_controller.is_held());
        if !place.at_rest || self.mode_controller.mode() == Mode::Run && !is_held {
            return Err(MOVES);
        }
        let kerf_mm = self.recovery.kerf_mm().unwrap_or(USUAL_KERF_MM);
        let [x, y] = self.recovery.lead.shift_mm;
        let shift_mm = match by {
            Shift::To(mm) => mm,
            Shift::Steps([dx, dy]) => [x + kerf_mm * f64::from(dx), y + kerf_mm * f64::from(dy)],
        };
        self.recovery.plane_axes().ok_or(NO_PLANE)?;
        if shift_mm[0].hypot(shift_mm[1]) > self.recovery.shift_max_mm() {
            return Err(TOO_FAR);
        }
        let side = self.side_of_start(shift_mm);
        let is_toward_part = side.is_some_and(|side| side.is_part == Some(true));
        let lead = &mut self.recovery.lead;
        let is_confirmed = [shift_mm, lead.shift_mm].into_iter().any(|mm| lead.toward_part == Some(mm));
        if is_toward_part && !is_confirmed {
            lead.toward_part = Some(shift_mm);
            return Err(TOWARD_PART);
        }
        lead.toward_part = Some(shift_mm).filter(|_| is_toward_part);
        lead.shift_mm = shift_mm;
        self.emit(EventKind::Shift(shift_mm, side));
        Ok(())
    }

    /// On which side of the path a start with this shift lies: of the end of the interrupted cut, or of where the
    /// machine has gone back to.
    fn side_of_start(&self, shift_mm: [f64; 2]) -> Option<StartSide> {
        let axes = self.recovery.plane_axes()?;
        let (here, end) = (self.card.status().place, self.recovery.cut_end());
        let place = end.filter(|end| end.distance_to(here) >= Distance::ZERO).unwrap_or(here).record;
        let [along_x, along_y] = self.path_direction(place, axes)?;
        let left_mm = along_x * shift_mm[1] - along_y * shift_mm[0];
        if left_mm.abs() < MIN_SIDE_MM {
            return None;
        }
        let is_left = left_mm > 0.0;
        let pierce = self.streamer.pierce_before(Place::start_of(place));
        let contour = self.cut_map.contours().iter().rfind(|contour| Some(contour.pierce) == pierce);
        // The tool is on the side of the scrap.
        let scrap = contour.and_then(|contour| contour.compensation);
        Some(StartSide { is_left, is_part: scrap.map(|scrap| (scrap == Side::Left) != is_left) })
    }

    /// The place where the path is joined by a lead-in from where the machine is, and its counts: the next record
    /// boundary, or where the lead-in that it is on ends.
    pub(super) fn join(&self) -> (RecordIndex, [i64; A]) {
        let status = self.card.status();
        if let (Some(lead_in), Some(counts)) = (self.streamer.lead_in(), &self.recovery.lead.join_counts) {
            let mut join_counts = status.counts;
            join_counts.iter_mut().zip(counts).for_each(|(slot, &count)| *slot = count);
            return (lead_in.join(), join_counts);
        }
        let (place, mut counts) = (status.place, status.counts);
        if let Some(record) = self.streamer.record(place.record).filter(|_| place.fraction != 0) {
            for (count, &pulses) in counts.iter_mut().zip(&record.increments) {
                *count += i64::from(pulses) - i64::from(partial_increment(pulses, place.fraction));
            }
        }
        (place.boundary_ahead(), counts)
    }

    /// Plans the lead-in of a shifted restart from where the machine is. `None` where there is no shift.
    ///
    /// # Errors
    /// An axis would leave its soft limits, or there is no arc.
    pub(super) fn plan_lead_in(&mut self) -> Result<Option<LeadIn<A>>, CommandError> {
        let [dx, dy] = self.recovery.lead.shift_mm;
        let is_on_lead_in = self.is_on_lead_in();
        if [dx, dy] == [0.0; 2] && !is_on_lead_in {
            return Ok(None);
        }
        let axes = self.recovery.plane_axes().ok_or(NO_PLANE)?;
        let (join, join_counts) = self.join();
        let at = Place::start_of(join);
        let pierce = self.streamer.pierce_before(at);
        let is_in_cut = pierce.is_some() && self.streamer.cut_change_before(at, None) == pierce;
        if !is_on_lead_in && !is_in_cut {
            return Err(NOT_IN_CUT);
        }
        let mut start = join_counts;
        for (axis, mm) in axes.into_iter().zip([dx, dy]) {
            start[axis] += (mm / self.config.mm_per_pulse[axis]).round() as i64;
        }
        let from = self.card.status().counts;
        let machine = self.recovery.machine();
        let ends = approach(machine, from, start).map_err(|_| CommandError::BeyondLimit(self.axis_beyond(&start)))?;
        let rapid_mm_s = machine.axes.iter().map(|axis| axis.max_velocity_mm_per_s).fold(f64::INFINITY, f64::min);
        let velocity_mm_s = RAPID_SHARE * rapid_mm_s.min(machine.path_velocity_mm_s);
        let moves: Vec<LeadInMove<A>> =
            ends.into_iter().map(|to| LeadInMove { to, velocity_mm_s, is_rapid: true }).collect();
        let feed_mm_s = self.feed_mm_s(join).min(velocity_mm_s);
        let axes_count = machine.axes.len().min(A);
        let (end, rate) = match self.recovery.lead.shape {
            LeadShape::Arc if dx.hypot(dy) > DIRECTION_MM => {
                self.plan_arc((join, join_counts), start, axes, feed_mm_s)?
            }
            // No arc has room there.
            LeadShape::Arc | LeadShape::Line => {
                let line = LeadInMove { to: join_counts, velocity_mm_s: feed_mm_s, is_rapid: false };
                (LeadInEnd::Line(line), Rate::MAX)
            }
        };
        self.recovery.lead.planned = (self.recovery.lead.shift_mm, self.recovery.lead.shape);
        self.recovery.lead.join_counts = Some(join_counts[..axes_count].to_vec());
        self.recovery.lead.rate = (rate < Rate::ONE).then_some((join + JOIN_RECORDS, rate));
        let mm_per_pulse = &self.config.mm_per_pulse;
        let lead_in = LeadIn::new(join, from, (&moves, &end), mm_per_pulse, self.config.period_s);
        Ok(Some(lead_in.with_feed_shares(self.feed_share_units_per_mm(join), mm_per_pulse)))
    }

    /// Plans the arc from a shifted start to the join, and the rate at which it is run.
    fn plan_arc(
        &self,
        (join, join_counts): (RecordIndex, [i64; A]),
        start: [i64; A],
        axes: [usize; 2],
        feed_mm_s: f64,
    ) -> Result<(LeadInEnd<A>, Rate), CommandError> {
        let (machine, period_s) = (self.recovery.machine(), self.config.period_s);
        let motion = self.path_motion(join, axes);
        let speed = motion.map_or(0.0, |motion| motion.velocity[0].hypot(motion.velocity[1]));
        let moving = motion.filter(|_| speed >= MOVING_SHARE * feed_mm_s);
        let tangent = match moving {
            Some(PathMotion { velocity, .. }) => velocity.map(|mm_s| mm_s / speed),
            None => self.direction_behind(join, axes),
        };
        let start_mm = axes.map(|axis| (start[axis] - join_counts[axis]) as f64 * self.config.mm_per_pulse[axis]);
        let arc = LeadArc::new(start_mm, tangent).map_err(CommandError::NoLeadArc)?;
        let least = |of: fn(&retrace_config::AxisConfig) -> f64| {
            axes.into_iter().map(|axis| of(&machine.axes[axis])).fold(f64::INFINITY, f64::min)
        };
        let limits = PlaneLimits {
            acceleration: least(|axis| axis.max_acceleration_mm_per_s2),
            jerk: least(|axis| axis.max_jerk_mm_per_s3),
        };
        let (speed, rate) = match moving {
            Some(motion) => (speed, arc.join_rate(motion, limits, period_s)),
            None => (arc.speed_within(limits, feed_mm_s), 1.0),
        };
        let join_xy = axes.map(|axis| join_counts[axis]);
        let travel = axes.map(|axis| machine.axes[axis].travel_mm.map(|mm| machine.counts_of(axis, mm)));
        let mm_per_pulse = axes.map(|axis| self.config.mm_per_pulse[axis]);
        let counts = arc
            .counts(speed, period_s, join_xy, mm_per_pulse, travel)
            .map_err(|beyond| CommandError::BeyondLimit(machine.axes[axes[beyond]].name))?;
        let with_others = |xy: [i64; 2]| {
            let mut at = join_counts;
            axes.into_iter().zip(xy).for_each(|(axis, count)| at[axis] = count);
            at
        };
        let counts = counts.into_iter().map(with_others).collect();
        let rate = Rate::from_units((rate * Rate::ONE.units() as f64) as i64);
        Ok((LeadInEnd::Curve { counts, rests: moving.is_none() }, rate))
    }

    /// How the path runs through a place at rate 1; `None` where it rests there, or another axis moves.
    fn path_motion(&self, place: RecordIndex, axes: [usize; 2]) -> Option<PathMotion> {
        let sums = |from: RecordIndex| {
            let mut sums = [0i64; A];
            for n in 0..MOTION_RECORDS {
                let increments = self.streamer.record(from + n)?.increments;
                sums.iter_mut().zip(increments).for_each(|(sum, pulses)| *sum += i64::from(pulses));
            }
            Some(sums)
        };
        let (before, behind) = (sums(place - MOTION_RECORDS)?, sums(place)?);
        let others_move = (0..A).any(|axis| !axes.contains(&axis) && (before[axis] != 0 || behind[axis] != 0));
        if others_move || self.streamer.is_at_rest_before(place) {
            return None;
        }
        let window_s = f64::from(MOTION_RECORDS) * self.config.period_s;
        let mm = |pulses: i64, axis: usize| pulses as f64 * self.config.mm_per_pulse[axis];
        let velocity = axes.map(|axis| mm(before[axis] + behind[axis], axis) / (2.0 * window_s));
        let acceleration = axes.map(|axis| mm(behind[axis] - before[axis], axis) / (window_s * window_s));
        Some(PathMotion { velocity, acceleration })
    }

    /// Direction of the path behind a place where it is slow; to the right where it does not move.
    fn direction_behind(&self, place: RecordIndex, axes: [usize; 2]) -> [f64; 2] {
        self.path_direction(place, axes).unwrap_or([1.0, 0.0])
    }

    /// Direction of the path behind a place; `None` where it does not move.
    fn path_direction(&self, place: RecordIndex, axes: [usize; 2]) -> Option<[f64; 2]> {
        let mut mm = [0.0; 2];
        let mut length_mm = 0.0;
        for record in (0..FEED_RECORDS).map_while(|n| self.streamer.record(place + n)) {
            for (sum, axis) in mm.iter_mut().zip(axes) {
                *sum += f64::from(record.increments[axis]) * self.config.mm_per_pulse[axis];
            }
            length_mm = mm[0].hypot(mm[1]);
            if length_mm >= DIRECTION_MM {
                break;
            }
        }
        (length_mm > 0.0).then(|| mm.map(|mm| mm / length_mm))
    }

    /// Maximum rate on a lead-in and at its join.
    pub(super) fn lead_in_rate(&mut self) -> Rate {
        let Some((until, rate)) = self.recovery.lead.rate else { return Rate::MAX };
        let place = self.card.status().place;
        if Place::start_of(until).distance_to(place) >= Distance::ZERO {
            self.recovery.lead.rate = None;
        }
        let is_on_the_way = self.streamer.lead_in().is_some_and(|lead_in| place.record.is_before(lead_in.start()));
        if is_on_the_way { Rate::MAX } else { rate }
    }

    /// Letter of the first axis that is beyond its soft limits at these counts.
    fn axis_beyond(&self, counts: &[i64; A]) -> char {
        let machine = self.recovery.machine();
        let beyond = machine.axes.iter().enumerate().take(A).find(|&(index, axis)| {
            let [low, high] = axis.travel_mm.map(|mm| machine.counts_of(index, mm));
            !(low..=high).contains(&counts[index])
        });
        beyond.map_or('x', |(_, axis)| axis.name)
    }

    /// Feed of the contour behind a place, in mm/s: that of its fastest record before the next instruction.
    fn feed_mm_s(&self, place: RecordIndex) -> f64 {
        let end = place + FEED_RECORDS;
        let end = self.streamer.next_exclusive().filter(|next| next.is_before(end)).unwrap_or(end);
        let records = (0..end.since(place)).map_while(|n| self.record_length_mm(place + n));
        let longest_mm = records.fold(0.0, f64::max);
        // A path that hardly moves is joined slowly, and not never.
        (longest_mm / self.config.period_s).max(1.0)
    }

    /// Share of the feed of a record of 1 mm on the path from a place on, in units of [`retrace_core::FeedShare`];
    /// 0 where no power follows it.
    fn feed_share_units_per_mm(&self, place: RecordIndex) -> f64 {
        let records = (0..FEED_RECORDS).map(|n| place + n).map_while(|place| {
            Some((self.record_length_mm(place)?, f64::from(self.streamer.record(place)?.feed_share.units())))
        });
        // the longest, whose pulses say best how long it is
        let longest = records.filter(|&(mm, units)| mm > 0.0 && units > 0.0).max_by(|a, b| a.0.total_cmp(&b.0));
        longest.map_or(0.0, |(mm, units)| units / mm)
    }

    /// Mode output on the way to a shifted start, where no program is executed; `None` anywhere else.
    pub(super) fn lead_in_output(&self) -> Option<ModeOutput> {
        let lead_in = self.streamer.lead_in()?;
        let status = self.card.status();
        let is_at_start = status.at_rest && status.place == Place::start_of(lead_in.start());
        let is_before_start = Place::start_of(lead_in.start()).distance_to(status.place) < Distance::ZERO;
        if is_at_start || !is_before_start {
            return None;
        }
        let rate = self.mode_controller.rapid_override();
        let target = if self.mode_controller.is_held() { RateTarget::ZERO } else { RateTarget::both(rate) };
        Some(ModeOutput { target, look_ahead: true, restore_outputs: false, notice: None })
    }

    /// Ends a lead-in once the path is joined: the card forgets its records, so that the recorded path is retraced.
    pub(super) fn advance_lead_in(&mut self) {
        let Some(join) = self.streamer.lead_in().map(LeadIn::join) else { return };
        let status = *self.card.status();
        let beyond = Place::start_of(join).distance_to(status.place);
        if beyond < Distance::ZERO || beyond == Distance::ZERO && !status.at_rest {
            return;
        }
        if status.low.is_before(join) {
            // Where the card cannot do that yet, it is sent again in the next period.
            let _ = self.card.send(HostCommand::Forget { low: join });
            return;
        }
        self.streamer.end_lead_in();
        (self.recovery.lead.shift_mm, self.recovery.lead.toward_part) = ([0.0; 2], None);
        self.emit(EventKind::Joined);
    }
}
