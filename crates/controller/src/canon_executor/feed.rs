//! The feed rate: per minute, or per turn of the spindle (SPN-8).
//!
//! Invariant: under G95 the feed is planned for the commanded speed, and no move feeds with the spindle off.

use retrace_config::FeedPerTurn;
use retrace_gcode::{ActiveCodes, FeedMode, SpindleRotation};
use retrace_link::{Outputs, channel};

use super::CanonExecutor;
use crate::canon_error::CanonError;
use crate::motion_sink::MotionSink;

impl CanonExecutor<'_> {
    /// Begins with what the card has switched on: an earlier MDI block may have started the spindle.
    #[must_use]
    pub(crate) fn with_outputs(self, outputs: &Outputs) -> Self {
        let [spindle, speed] = [channel::SPINDLE, channel::SPEED].map(|channel| outputs[usize::from(channel)]);
        let orientation = self.machine.spindle.orientation;
        let is_oriented = orientation.is_some_and(|orientation| outputs[usize::from(orientation.output)] != 0);
        Self { spindle_turns: Some(spindle != 0), rpm: f64::from(speed) / 1000.0, is_oriented, ..self }
    }

    /// Begins with the modes of the program before its first block.
    #[must_use]
    pub(crate) fn with_codes(self, codes: &ActiveCodes) -> Self {
        let rpm = if codes.constant_surface_speed { f64::NAN } else { codes.spindle_speed };
        Self { spindle_turns: Some(codes.spindle != SpindleRotation::Stopped), rpm, ..self }
    }

    pub(super) fn set_feed_mode(&mut self, mode: FeedMode) -> Result<(), CanonError> {
        let per_turn = mode == FeedMode::UnitsPerRevolution;
        if per_turn && self.machine.feed_per_turn != FeedPerTurn::Commanded && self.machine.encoder.is_none() {
            return Err(CanonError::FeedPerTurn("G95 follows an encoder, and the machine file has none"));
        }
        self.feed_mm_per_turn = per_turn.then_some(0.0);
        Ok(())
    }

    /// Sets the feed, in mm per minute or per turn.
    pub(super) fn set_feed(&mut self, mm: f64) {
        match &mut self.feed_mm_per_turn {
            Some(per_turn) => {
                *per_turn = mm;
                self.feed_mm_min = mm * self.rpm;
            }
            None => self.feed_mm_min = mm,
        }
    }

    pub(super) fn set_rpm(&mut self, rpm: f64) {
        self.rpm = rpm;
        if let Some(per_turn) = self.feed_mm_per_turn {
            self.feed_mm_min = per_turn * rpm;
        }
    }

    /// What precedes a feed move: the spindle turns where the feed is per turn, and the cutters are prepared.
    pub(super) fn before_feed<const A: usize>(
        &mut self,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        if self.feed_mm_per_turn.is_some() && self.spindle_turns == Some(false) {
            return Err(CanonError::FeedPerTurn("a feed move at a feed per turn (G95) while the spindle is off"));
        }
        sink.set_feed_per_turn(self.feed_mm_per_turn.is_some() && self.machine.feed_per_turn == FeedPerTurn::Measured);
        self.await_speed(line, sink)?;
        self.cutters.before_feed(self.machine, self.feed_mm_min, line, sink)
    }
}
