//! Questions to the machine: probing moves, G38.2 to G38.5, and inputs, M66 (PRB-7 to PRB-9, PRB-12).
//!
//! Invariant: behind a probing move that the machine has answered, the position is where it came to rest.

use retrace_config::AfterTouch;
use retrace_gcode::{Axis, Pose, Probing, WaitFor, WaitForInput, WaitInput};

use retrace_motion::{FeedRate, PathMode};

use super::CanonExecutor;
use crate::canon_error::CanonError;
use crate::motion_sink::MotionSink;
use crate::probe_move::{ProbeOutcome, ProbeResult};
use crate::probe_stop::ProbeStop;
use crate::question::{InputQuestion, MachineResult, ReadInput};

impl CanonExecutor<'_> {
    pub(super) fn probe<const A: usize>(
        &mut self,
        end: &Pose,
        probing: Probing,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let probe = &self.machine.probe;
        if probe.input.is_none() {
            return Err(CanonError::NoProbe);
        }
        if self.cutters.is_any_lit() || self.spindle_turns == Some(true) && !probe.spindle_may_turn {
            return Err(CanonError::SpindleInProbing);
        }
        let position = self.machine_position(end);
        let really = self.correction.map_or(position, |correction| correction.move_end(&self.at, &position, false));
        let own = self.machine_coordinates::<A>(&really)?;
        if self.feed_mm_per_turn.is_some() {
            return Err(CanonError::FeedPerTurnInProbing);
        }
        let feed_mm_s = self.feed_mm_min / 60.0;
        let stop = ProbeStop::new(self.machine, &self.position::<A>(), &own);
        let asked = Some((stop.counts(1.0), feed_mm_s));
        if self.fitting_probe != asked {
            if let Some(most_mm_min) = stop.highest_feed_instead_of(feed_mm_s) {
                return Err(CanonError::ProbeTooFast { overtravel_mm: probe.overtravel_mm, most_mm_min });
            }
            self.fitting_probe = asked;
        }
        let Some(outcome) = sink.probe(own, feed_mm_s, probing, line)? else {
            self.forget_probed(&position, sink);
            return Ok(());
        };
        let ProbeOutcome { touch_mm, mut rest_mm, touched } = outcome;
        if touched && probe.after == AfterTouch::Back {
            sink.straight(touch_mm, FeedRate::PerSecond(feed_mm_s), PathMode::ExactStop, line)?;
            rest_mm = touch_mm;
        }
        // What the program calls the position differs from the machine's where a tool length was entered.
        let (mut touch, mut rest, mut rest_really) = (position, position, really);
        for (index, &axis) in self.axes.iter().enumerate().take(A) {
            touch[axis] += touch_mm[index] - own[index];
            rest[axis] += rest_mm[index] - own[index];
            rest_really[axis] = rest_mm[index];
        }
        self.record_move_end(rest, &rest_really);
        let mut result =
            ProbeResult { touch: self.program_position(&touch), rest: self.program_position(&rest), touched };
        // Without a touch the program's own numbers stay what they are.
        for axis in Axis::ALL {
            if !touched || !self.axes.contains(&axis) {
                result.touch[axis] = end[axis];
            }
        }
        self.learned = Some(MachineResult::Probe(result));
        Ok(())
    }

    pub(super) fn read_input<const A: usize>(
        &mut self,
        wait: &WaitForInput,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let number = match wait.input {
            WaitInput::Digital(number) => number,
            WaitInput::Analog(number) => return self.read_analog_input(number, line, sink),
        };
        let input = u8::try_from(number).ok().filter(|&input| self.machine.card.declares_input(input));
        let input = input.ok_or(CanonError::NoInput(number))?;
        let longest = if wait.wait_for == WaitFor::Immediate { 0.0 } else { wait.timeout };
        if longest > 0.0 && self.cutters.is_any_lit() {
            return Err(CanonError::LitWait);
        }
        let timeout_periods = (longest * 1e6 / f64::from(self.machine.period_us)).ceil() as u64;
        let value = sink.read_input(
            InputQuestion { input: ReadInput::Digital(input), wait_for: wait.wait_for, timeout_periods },
            line,
        )?;
        self.learned = value.map(|value| MachineResult::Input(f64::from(value)));
        Ok(())
    }

    /// Takes what the program learns of the last question, if the machine was asked.
    pub(crate) fn take_learned(&mut self) -> Option<MachineResult> {
        self.learned.take()
    }
}
