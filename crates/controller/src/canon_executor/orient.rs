//! Orienting the spindle, M19: a drive turns it to its own angle and holds it there (SPN-10).
//!
//! Invariant: the output that orients the spindle is never on while the program turns it.

use retrace_config::{CodeSwitching, SpindleOrientation};
use retrace_link::{InputWait, OutputChange, channel};

use super::CanonExecutor;
use super::switching::CutStart;
use crate::canon_error::CanonError;
use crate::motion_sink::MotionSink;

/// Longest wait for the angle without a Q word, s.
const TIMEOUT_S: f64 = 10.0;
/// Largest difference between two angles that counts as none, degrees.
const SAME_DEG: f64 = 0.01;

impl CanonExecutor<'_> {
    /// M19: switches the spindle off and the orientation on, and waits for the input of the drive, at most `timeout_s`.
    pub(super) fn orient_spindle<const A: usize>(
        &mut self,
        degrees: f64,
        timeout_s: Option<f64>,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let cuts = self.machine.cutter_of(channel::SPINDLE).is_some_and(|cutter| cutter.kind.cuts_at_rest());
        let Some(SpindleOrientation { output, input, angle_deg }) = self.machine.spindle.orientation.filter(|_| !cuts)
        else {
            let what = "orienting the spindle (M19, G87) of a machine without orient_output in [spindle]";
            return Err(CanonError::NotSupported(what));
        };
        // An unknown angle is checked as it is executed.
        let apart = (degrees - angle_deg + 180.0).rem_euclid(360.0) - 180.0;
        if apart.abs() > SAME_DEG {
            return Err(CanonError::OrientAngle(degrees, angle_deg));
        }
        let longest_s = timeout_s.filter(|seconds| !seconds.is_nan()).unwrap_or(TIMEOUT_S);
        // 0 would wait for ever.
        let until = Some(InputWait::new(input, true, self.periods(longest_s).max(1)));
        let changes =
            [OutputChange { channel: channel::SPINDLE, value: 0 }, OutputChange { channel: output, value: 1 }];
        self.cutters.record_switching(self.machine, &changes);
        (self.spindle_turns, self.is_oriented) = (Some(false), true);
        let switching = CodeSwitching { until, ..CodeSwitching::AT_REST };
        self.exclusive(("M19", line), &changes, switching, CutStart::default(), sink)
    }

    /// Before M3, M4 and M5: the drive no longer holds the spindle.
    pub(super) fn release_spindle<const A: usize>(
        &mut self,
        of: (&'static str, u32),
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let Some(orientation) = self.machine.spindle.orientation else { return Ok(()) };
        if !std::mem::take(&mut self.is_oriented) {
            return Ok(());
        }
        let change = OutputChange { channel: orientation.output, value: 0 };
        self.exclusive(of, &[change], CodeSwitching::AT_REST, CutStart::default(), sink)
    }
}
