//! The receiver of a program's moves and switching: the planner, or the check before the run.
//!
//! Invariant: both sinks receive the same calls for the same program, so that what was checked is what is run.

use retrace_config::EncoderConfig;
use retrace_gcode::Probing;
use retrace_link::OutputChange;
use retrace_motion::{Arc, FeedRate, PathMode};

use crate::plan_writer::{Cancelled, PlanWriteError, PlanWriter, SwitchInstruction};
use crate::probe_move::ProbeOutcome;
use crate::question::InputQuestion;
use crate::tap_move::RigidTap;
use crate::thread_plan::ThreadStretch;

/// Receives a program's moves and switching, in machine coordinates and mm.
pub trait MotionSink<const A: usize> {
    /// A straight move.
    ///
    /// # Errors
    /// The reason why it is rejected; nothing has changed then.
    fn straight(&mut self, end_mm: [f64; A], feed: FeedRate, mode: PathMode, line: u32) -> Result<(), PlanWriteError>;

    /// An arc or helix that begins where the last move ended.
    ///
    /// # Errors
    /// The reason why it is rejected; nothing has changed then.
    fn arc(&mut self, arc: &Arc<A>, feed: FeedRate, mode: PathMode, line: u32) -> Result<(), PlanWriteError>;

    /// A synchronous action, executed where the next move begins.
    fn action(&mut self, change: OutputChange, line: u32);

    /// A synchronous action within the next move, at this share of its length: 0 … 1, ascending.
    fn action_within(&mut self, _share: f64, change: OutputChange, line: u32) {
        self.action(change, line);
    }

    /// A synchronous action that reverse run leaves unchanged.
    fn lasting_action(&mut self, change: OutputChange, line: u32) {
        self.action(change, line);
    }

    /// A height over the sheet, in pulses, to which the tool goes beside the motion from a place on: `periods` records
    /// behind the exclusive instruction before. It counts in the cut that this has begun alone. Without an effect on
    /// moves and switching, so that most sinks ignore it.
    fn height(&mut self, _height: i32, _periods: u32, _line: u32) {}

    /// An exclusive instruction, executed here at rest.
    ///
    /// # Errors
    /// [`Cancelled`]
    fn exclusive(&mut self, switch: SwitchInstruction<'_>) -> Result<(), Cancelled>;

    /// A probing move, with rest before and behind it. `None`: this sink asks no machine, and takes the end of the move
    /// as its answer.
    ///
    /// # Errors
    /// The reason why it is rejected; nothing has changed then.
    fn probe(
        &mut self,
        end_mm: [f64; A],
        feed_mm_s: f64,
        probing: Probing,
        line: u32,
    ) -> Result<Option<ProbeOutcome<A>>, PlanWriteError> {
        let code = "G38";
        self.exclusive(SwitchInstruction { line, code, ..SwitchInstruction::default() })?;
        self.straight(end_mm, FeedRate::PerSecond(feed_mm_s), PathMode::ExactStop, line)?;
        self.exclusive(SwitchInstruction { line, code, ..SwitchInstruction::default() })?;
        let _ = probing;
        Ok(None)
    }

    /// A wait for an input, at rest. `None`: this sink asks no machine.
    ///
    /// # Errors
    /// The reason why it is rejected.
    fn read_input(&mut self, _: InputQuestion, line: u32) -> Result<Option<i32>, PlanWriteError> {
        self.exclusive(SwitchInstruction { line, code: "M66", ..SwitchInstruction::default() })?;
        Ok(None)
    }

    /// A geared stretch, with rest before and behind it (SPN-17). Without its plan it is a path at the commanded speed.
    ///
    /// # Errors
    /// The machine cannot follow the spindle there.
    fn thread(&mut self, stretch: &ThreadStretch<A>, _: &EncoderConfig) -> Result<(), PlanWriteError> {
        for piece in &stretch.pieces {
            let feed = FeedRate::PerSecond(piece.pitch_mm * stretch.rpm / 60.0);
            self.straight(piece.end_mm, feed, piece.mode, piece.line)?;
        }
        Ok(())
    }

    /// A rigid tap to a depth and back, with rest before and behind it (SPN-19).
    ///
    /// # Errors
    /// The machine cannot tap there.
    fn tap(&mut self, tap: &RigidTap<A>, _: &EncoderConfig) -> Result<(), PlanWriteError> {
        let feed = FeedRate::PerSecond(tap.pitch_mm * tap.rpm / 60.0);
        self.straight(tap.depth_mm, feed, PathMode::ExactStop, tap.line)?;
        self.straight(tap.from_mm, feed, PathMode::ExactStop, tap.line)
    }

    /// Whether the feed of the moves to come is per turn of the spindle and follows its measured speed (SPN-8).
    fn set_feed_per_turn(&mut self, _is_per_turn: bool) {}

    /// A motion of unknown way, in a check only (PRB-17). An unknown coordinate is a NaN.
    fn unknown_motion(&mut self, _end_mm: [f64; A], _line: u32) {}

    /// The position from here on, in a check only. An unknown coordinate is a NaN.
    fn set_position(&mut self, _at_mm: [f64; A]) {}

    /// Whether the program makes the following moves whatever the machine answers, in a check only (PRB-18).
    fn set_certain(&mut self, _is_certain: bool) {}

    /// A message for the operator.
    ///
    /// # Errors
    /// [`Cancelled`]
    fn message(&mut self, text: String, line: u32) -> Result<(), Cancelled>;
}

impl<const A: usize> MotionSink<A> for PlanWriter<'_, A> {
    fn straight(&mut self, end_mm: [f64; A], feed: FeedRate, mode: PathMode, line: u32) -> Result<(), PlanWriteError> {
        PlanWriter::straight(self, end_mm, feed, mode, line)
    }

    fn arc(&mut self, arc: &Arc<A>, feed: FeedRate, mode: PathMode, line: u32) -> Result<(), PlanWriteError> {
        PlanWriter::arc(self, arc, feed, mode, line)
    }

    fn action(&mut self, change: OutputChange, line: u32) {
        PlanWriter::action(self, change, line);
    }

    fn action_within(&mut self, share: f64, change: OutputChange, line: u32) {
        PlanWriter::action_within(self, share, change, line);
    }

    fn lasting_action(&mut self, change: OutputChange, line: u32) {
        PlanWriter::lasting_action(self, change, line);
    }

    fn height(&mut self, height: i32, periods: u32, line: u32) {
        PlanWriter::height(self, height, periods, line);
    }

    fn exclusive(&mut self, switch: SwitchInstruction<'_>) -> Result<(), Cancelled> {
        PlanWriter::exclusive(self, switch)
    }

    fn probe(
        &mut self,
        end_mm: [f64; A],
        feed_mm_s: f64,
        probing: Probing,
        line: u32,
    ) -> Result<Option<ProbeOutcome<A>>, PlanWriteError> {
        PlanWriter::probe(self, end_mm, feed_mm_s, probing, line).map(Some)
    }

    fn thread(&mut self, stretch: &ThreadStretch<A>, encoder: &EncoderConfig) -> Result<(), PlanWriteError> {
        PlanWriter::thread(self, stretch, encoder)
    }

    fn tap(&mut self, tap: &RigidTap<A>, encoder: &EncoderConfig) -> Result<(), PlanWriteError> {
        PlanWriter::tap(self, tap, encoder)
    }

    fn set_feed_per_turn(&mut self, is_per_turn: bool) {
        PlanWriter::set_feed_per_turn(self, is_per_turn);
    }

    fn read_input(&mut self, question: InputQuestion, line: u32) -> Result<Option<i32>, PlanWriteError> {
        PlanWriter::read_input(self, question, line).map(Some)
    }

    fn message(&mut self, text: String, line: u32) -> Result<(), Cancelled> {
        PlanWriter::message(self, text, line)
    }
}
