//! How a cutter starts, and the input that proves that it burns or flows (CUT-1, CUT-5, CUT-13, CUT-29).
//!
//! Invariant: every time is within the range that the card's counters hold at any control period.

use retrace_link::{Ignition, InputWait, MAX_INPUTS, ProofInput};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::numbered_error::NumberedError;
use crate::value_range::within;

/// Input that proves that the cutter burns or flows, `ok = { input = 5 }`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CutterProof {
    /// Number of the input; active while the cutter burns or flows.
    #[schemars(range(max = 15))]
    pub input: u8,
    /// Time in ms for which the input must be active before the cutter counts as started.
    #[serde(default = "ten_ms")]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub ok_ms: f64,
    /// Time in ms for which the input must be inactive before the cutter counts as lost.
    #[serde(default = "ten_ms")]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub lost_ms: f64,
    /// Time in ms for which the input may stay active after the cutter is off; 0: for any time.
    #[serde(default = "half_a_second_ms")]
    #[schemars(range(min = 0.0, max = 5000.0))]
    pub out_ms: f64,
}

const fn ten_ms() -> f64 {
    10.0
}

const fn half_a_second_ms() -> f64 {
    500.0
}

/// Start of a cutter, `start = { starts = 3 }`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CutterStart {
    /// Time in s within which the input of `ok` must become active.
    #[schemars(range(min = 0.01, max = 60.0))]
    pub start_s: f64,
    /// Number of attempts.
    #[schemars(range(min = 1, max = 10))]
    pub starts: u8,
    /// Time in s for which the cutter is off between two attempts.
    #[schemars(range(min = 0.0, max = 5.0))]
    pub retry_s: f64,
    /// Pierce delay in s, from `ok` or, without it, from the switching; where no material states one.
    #[schemars(range(min = 0.0, max = 600.0))]
    pub pierce_s: f64,
    /// Time in s after which the input of `ok` usually becomes active. `retrace check` counts it; it has no other
    /// effect.
    #[schemars(range(min = 0.0, max = 60.0))]
    pub usual_s: f64,
}

impl Default for CutterStart {
    fn default() -> Self {
        Self { start_s: 5.0, starts: 3, retry_s: 3.0, pierce_s: 0.0, usual_s: 0.05 }
    }
}

/// Restart of a cutter where the cut was interrupted, `restart = { run_in_mm = 5 }` (CUT-35, CUT-38, CUT-41).
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CutterRestart {
    /// Length in mm of the existing kerf over which a torch starts in motion, so that the arc meets metal at speed.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub run_in_mm: f64,
    /// Length in mm of the cut that a jet or a beam, which pierces there, cuts again.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub overlap_mm: f64,
    /// Time in ms for which a torch burns before it starts in motion.
    #[schemars(range(min = 0.0, max = 5000.0))]
    pub pilot_ms: f64,
    /// Length in mm beyond the end of the cut within which a torch that started in motion must be proven.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub latch_mm: f64,
    /// Maximum distance in mm at which a cutter starts beside the path.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub shift_max_mm: f64,
    /// Length in mm before the end of a contour within which a lost cut counts as done.
    #[schemars(range(min = 0.0, max = 20.0))]
    pub lost_at_end_mm: f64,
    /// Length in mm of a kerf inside a contour up to which a jet or a beam stays on to the next gap; a torch, whose arc
    /// burns over metal only, is off over every kerf.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub bridge_mm: f64,
}

impl Default for CutterRestart {
    fn default() -> Self {
        Self {
            run_in_mm: 5.0,
            overlap_mm: 1.0,
            pilot_ms: 300.0,
            latch_mm: 5.0,
            shift_max_mm: 10.0,
            lost_at_end_mm: 0.0,
            bridge_mm: 20.0,
        }
    }
}

impl CutterRestart {
    pub(crate) fn check(&self, cutter: &str) -> Result<(), NumberedError> {
        within(&format!("cutter {cutter}: restart.run_in_mm"), self.run_in_mm, 0.0, 100.0)?;
        within(&format!("cutter {cutter}: restart.overlap_mm"), self.overlap_mm, 0.0, 100.0)?;
        within(&format!("cutter {cutter}: restart.pilot_ms"), self.pilot_ms, 0.0, 5000.0)?;
        within(&format!("cutter {cutter}: restart.latch_mm"), self.latch_mm, 0.0, 100.0)?;
        within(&format!("cutter {cutter}: restart.lost_at_end_mm"), self.lost_at_end_mm, 0.0, 20.0)?;
        within(&format!("cutter {cutter}: restart.bridge_mm"), self.bridge_mm, 0.0, 1000.0)?;
        within(&format!("cutter {cutter}: restart.shift_max_mm"), self.shift_max_mm, 0.0, 100.0)
    }
}

/// Control periods of a time in ms, at most `u16::MAX`.
fn short_periods(ms: f64, period_us: u32) -> u16 {
    (ms * 1000.0 / f64::from(period_us)).round().clamp(0.0, f64::from(u16::MAX)) as u16
}

/// Control periods of a time in s.
fn long_periods(s: f64, period_us: u32) -> u32 {
    (s * 1e6 / f64::from(period_us)).round().clamp(0.0, f64::from(u32::MAX)) as u32
}

impl CutterProof {
    pub(crate) fn check(&self, cutter: &str) -> Result<(), NumberedError> {
        if usize::from(self.input) >= MAX_INPUTS {
            let what = format!("[[cutter]] {cutter}: ok.input = {}: there is no such input", self.input);
            return Err(NumberedError::new("E2112", what, "an input is a number from 0 to 15"));
        }
        within(&format!("cutter {cutter}: ok.ok_ms"), self.ok_ms, 0.0, 1000.0)?;
        within(&format!("cutter {cutter}: ok.lost_ms"), self.lost_ms, 0.0, 1000.0)?;
        within(&format!("cutter {cutter}: ok.out_ms"), self.out_ms, 0.0, 5000.0)
    }

    /// Settings of the input for the card.
    #[must_use]
    pub fn settings(&self, period_us: u32) -> ProofInput {
        let at_least_one = |ms: f64| short_periods(ms, period_us).max(1);
        ProofInput {
            input: self.input,
            proven_periods: at_least_one(self.ok_ms),
            lost_periods: at_least_one(self.lost_ms),
            out_periods: if self.out_ms > 0.0 { at_least_one(self.out_ms) } else { 0 },
        }
    }

    /// What switching the cutter off waits for: the input is inactive. Where it stays active for too long the card
    /// itself raises an alarm.
    pub(crate) fn stop_wait(&self, period_us: u32) -> Option<InputWait> {
        let out = long_periods(self.out_ms / 1000.0, period_us);
        (self.out_ms > 0.0).then(|| InputWait::new(self.input, false, 2 * out.max(1)))
    }

    /// What switching the cutter on waits for: the proof, then the pierce.
    pub(crate) fn start_wait(&self, start: &CutterStart, pierce_s: f64, period_us: u32) -> InputWait {
        let ignition = Ignition {
            stable_periods: self.settings(period_us).proven_periods,
            attempts: start.starts,
            retry_periods: short_periods(1000.0 * start.retry_s, period_us),
            delay_periods: long_periods(pierce_s, period_us),
        };
        let timeout_periods = long_periods(start.start_s, period_us).max(1);
        InputWait { ignition: Some(ignition), ..InputWait::new(self.input, true, timeout_periods) }
    }
}

impl CutterStart {
    pub(crate) fn check(&self, cutter: &str) -> Result<(), NumberedError> {
        within(&format!("cutter {cutter}: start.start_s"), self.start_s, 0.01, 60.0)?;
        within(&format!("cutter {cutter}: start.starts"), f64::from(self.starts), 1.0, 10.0)?;
        within(&format!("cutter {cutter}: start.retry_s"), self.retry_s, 0.0, 5.0)?;
        within(&format!("cutter {cutter}: start.usual_s"), self.usual_s, 0.0, 60.0)?;
        within(&format!("cutter {cutter}: start.pierce_s"), self.pierce_s, 0.0, 600.0)
    }

    /// Control periods after which the input of `ok` usually becomes active.
    #[must_use]
    pub fn usual_periods(&self, period_us: u32) -> u32 {
        long_periods(self.usual_s, period_us)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROOF: CutterProof = CutterProof { input: 5, ok_ms: 10.0, lost_ms: 0.0, out_ms: 500.0 };

    #[test]
    fn times_become_control_periods() {
        let start = CutterStart { pierce_s: 0.4, ..CutterStart::default() };
        let wait = PROOF.start_wait(&start, start.pierce_s, 2000);
        let ignition = Ignition { stable_periods: 5, attempts: 3, retry_periods: 1500, delay_periods: 200 };
        assert_eq!(wait, InputWait { ignition: Some(ignition), ..InputWait::new(5, true, 2500) });
        assert_eq!(PROOF.stop_wait(2000), Some(InputWait::new(5, false, 500)));
        let settings = ProofInput { input: 5, proven_periods: 5, lost_periods: 1, out_periods: 250 };
        assert_eq!(PROOF.settings(2000), settings, "a loss is seen in one period at least");
        let unwatched = CutterProof { out_ms: 0.0, ..PROOF };
        assert_eq!((unwatched.stop_wait(2000), unwatched.settings(2000).out_periods), (None, 0));
    }

    #[test]
    fn every_time_fits_the_counters_of_the_card() {
        let longest = CutterStart { start_s: 60.0, starts: 10, retry_s: 5.0, pierce_s: 600.0, usual_s: 0.0 };
        assert!(longest.check("torch").is_ok() && CutterStart { retry_s: 5.1, ..longest }.check("torch").is_err());
        let wait = PROOF.start_wait(&longest, longest.pierce_s, 100);
        let ignition = wait.ignition.expect("an ignition");
        assert_eq!((ignition.retry_periods, ignition.delay_periods), (50_000, 6_000_000));
        assert!(CutterProof { input: 16, ..PROOF }.check("torch").is_err());
        assert!(CutterProof { lost_ms: 1001.0, ..PROOF }.check("torch").is_err());
    }
}
