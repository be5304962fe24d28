//! The direct return to a contour: up, across and down instead of along the path, where that is faster (CUT-36).
//!
//! It is the return of a pause whose breakpoint is the place of the contour, so a hold, a pause or a stop on the way
//! act as they do there.
//!
//! Invariant: it ends at the counts of the place, which are known before the path is left; nothing is measured but at
//! rest.

use retrace_core::interruption::{Breakpoint, InterruptionEvent};
use retrace_core::playback::partial_increment;
use retrace_core::{Flags, Place, RecordIndex};
use retrace_link::{MotionCard, PathStart, channel};

use super::Session;
use super::back_target::BackTarget;
use super::pause_state::ManualMovePurpose;
use super::restart::LeavingRun;
use crate::approach::approach;
use crate::dnc_events::DncStep;
use crate::event::CardError;
use crate::jog_planner::JogRequest;

/// Records up to which the path is always retraced: no direct return is faster.
const MIN_RECORDS: u32 = 3000;
/// Records that are added to the estimate in one control period.
const RECORDS_A_PERIOD: u32 = 4096;
/// Highest rate of reverse run.
const MAX_RATE: f64 = 8.0;

/// Estimate of the time that retracing to a place takes, as far as it is calculated.
#[derive(Clone, Copy, Debug)]
pub(super) struct RetraceEstimate<const A: usize> {
    target: RecordIndex,
    /// The place up to which it is calculated, the counts there, and the time in s. `None` until the machine is at
    /// rest.
    measured: Option<(RecordIndex, [i64; A], f64)>,
}

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Begins to estimate the time of a reverse run to this target, if the axes may go there directly.
    pub(super) fn begin_retrace_estimate(&mut self, target: RecordIndex) {
        let here = self.card.status().place.record;
        let is_far = target.is_before(here) && here.since(target) > MIN_RECORDS;
        let turns = self.card.status().outputs[usize::from(channel::SPINDLE)] != 0 && !self.spindle_is_a_cutter();
        let may_leave = is_far && !turns && self.dnc.has_jog_planner() && !self.dnc.is_on();
        self.retrace_estimate = may_leave.then_some(RetraceEstimate { target, measured: None });
    }

    /// Continues the estimate, and leaves the path where the direct return is faster. Called before every control
    /// period.
    pub(super) fn advance_retrace_estimate(&mut self) -> Result<(), CardError> {
        let Some(estimate) = self.retrace_estimate else { return Ok(()) };
        let is_target = self.back_target.as_ref().and_then(BackTarget::place) == Some(estimate.target);
        let stands = self.card.status().at_rest && self.leaving_run == LeavingRun::No;
        // A jet that is open in reverse run cuts along the path only. While the machine brakes, a cutter is still on.
        if !is_target || self.dnc.is_on() || self.mode_controller.is_held() || stands && self.is_any_cutter_on() {
            self.retrace_estimate = None;
            return Ok(());
        }
        if !stands || self.is_lifting() || self.due_lift().is_some() || self.restart.is_active() {
            return Ok(());
        }
        let Some((mut at, mut counts, mut retrace_s)) = estimate.measured.or_else(|| self.begin_measuring()) else {
            self.retrace_estimate = None;
            return Ok(());
        };
        for _ in 0..RECORDS_A_PERIOD {
            if at == estimate.target {
                self.retrace_estimate = None;
                return self.choose_return(estimate.target, counts, retrace_s);
            }
            at -= 1;
            let Some(record) = self.streamer.record(at) else {
                self.retrace_estimate = None;
                return Ok(());
            };
            counts.iter_mut().zip(&record.increments).for_each(|(count, &pulses)| *count -= i64::from(pulses));
            retrace_s += self.config.period_s * self.least_periods(&record.increments);
        }
        self.retrace_estimate = Some(RetraceEstimate { measured: Some((at, counts, retrace_s)), ..estimate });
        Ok(())
    }

    fn is_any_cutter_on(&self) -> bool {
        let outputs = &self.card.status().outputs;
        self.config.fire_channels.iter().any(|&at| outputs.get(usize::from(at)).is_some_and(|&value| value != 0))
    }

    /// The record that the machine is in, and its counts at the start of it.
    fn begin_measuring(&self) -> Option<(RecordIndex, [i64; A], f64)> {
        let (place, mut counts) = (self.card.status().place, self.card.status().counts);
        if place.fraction != 0 {
            let increments = self.streamer.record(place.record)?.increments;
            for (count, pulses) in counts.iter_mut().zip(increments) {
                *count -= i64::from(partial_increment(pulses, place.fraction));
            }
        }
        Some((place.record, counts, 0.0))
    }

    /// Control periods that a record takes at the highest rate at which no axis exceeds its velocity.
    fn least_periods<T: Copy + Into<i64>>(&self, increments: &[T; A]) -> f64 {
        let axes = self.recovery.machine().axes.iter().zip(increments);
        let shares = axes.map(|(axis, &pulses)| {
            let pulses: i64 = pulses.into();
            pulses.abs() as f64 / (axis.max_velocity_mm_per_s * axis.pulses_per_mm * self.config.period_s)
        });
        shares.fold(1.0 / MAX_RATE, f64::max)
    }

    /// Leaves the path, if the direct return is faster than `retrace_s`.
    fn choose_return(&mut self, target: RecordIndex, to: [i64; A], retrace_s: f64) -> Result<(), CardError> {
        let (status, machine) = (*self.card.status(), self.recovery.machine());
        let mut from = status.counts;
        if let Some(layer) = machine.tool_layer() {
            from[layer.index] += i64::from(status.layer);
        }
        let Ok(ends) = approach(machine, from, to) else { return Ok(()) };
        let mut at = from;
        let mut direct_s = 0.0;
        for end in ends {
            direct_s += self.move_s(&at, &end);
            at = end;
        }
        if direct_s < retrace_s { self.begin_direct_return(target, to) } else { Ok(()) }
    }

    /// Time in s of a straight rapid move from rest to rest, by its slowest axis.
    fn move_s(&self, from: &[i64; A], to: &[i64; A]) -> f64 {
        let axes = self.recovery.machine().axes.iter().zip(from.iter().zip(to));
        let times = axes.filter(|(_, (from, to))| from != to).map(|(axis, (from, to))| {
            let (velocity, acceleration) = (axis.max_velocity_mm_per_s, axis.max_acceleration_mm_per_s2);
            let mm = from.abs_diff(*to) as f64 / axis.pulses_per_mm;
            mm / velocity + velocity / acceleration + 2.0 * acceleration / axis.max_jerk_mm_per_s3
        });
        times.fold(0.0, f64::max)
    }

    /// Leaves the path, and returns to it at `target`, whose counts are `to`.
    fn begin_direct_return(&mut self, target: RecordIndex, to: [i64; A]) -> Result<(), CardError> {
        let status = *self.card.status();
        let before = self.streamer.record(target - 1);
        let start = PathStart {
            place: Place::start_of(target),
            rests: before.is_some_and(|record| record.flags.contains(Flags::REST)),
            reached: status.reached,
            executed: status.executed,
            keeps_state: true,
        };
        let latch = Breakpoint { program: self.dnc.program, counts: to, spindle: None };
        let mut order = self.dnc.interruption;
        let is_allowed =
            order.apply(InterruptionEvent::Pause(latch)).is_ok() && order.apply(InterruptionEvent::Online).is_ok();
        let on_line = order;
        let program = InterruptionEvent::CycleStart { program: self.dnc.program };
        let Some(hand) = self.dnc.jog_planner.as_mut().filter(|_| is_allowed && order.apply(program).is_ok()) else {
            return Ok(());
        };
        // The layer becomes part of the counts.
        let off_path = PathStart { executed: status.executed, ..PathStart::at(hand.ring.write()) };
        self.card.begin_path(off_path)?;
        (self.dnc.path_start, self.target) = (Some(start), None);
        self.dnc.interruption = order;
        let from = self.card.status().counts;
        // There is a planner of manual moves.
        let _ = self.begin_manual_move(JogRequest::Approach { from, to }, ManualMovePurpose::Approach(on_line));
        self.emit_dnc_step(DncStep::Approaching);
        Ok(())
    }
}
