//! Threads (G33, G76): the feed moves between the beginning and the end of spindle synchronisation (SPN-17, SPN-18).
//!
//! Invariant: consecutive threads are one stretch; it is complete where anything else follows.

use retrace_gcode::{Axis, Canon, CanonStep, Pose};
use retrace_link::{SpindleTask, channel};
use retrace_motion::PathMode;

use super::CanonExecutor;
use crate::canon_error::CanonError;
use crate::motion_sink::MotionSink;
use crate::plan_writer::SwitchInstruction;
use crate::tap_move::RigidTap;
use crate::thread_plan::{ThreadPiece, ThreadStretch};

/// A thread that is being collected.
#[derive(Clone, Debug)]
pub(super) struct CollectedThread {
    /// Distance in a turn of the spindle for the moves to come, mm; `None` where the next function may end it.
    pitch_mm: Option<f64>,
    pieces: Vec<CollectedPiece>,
    /// Angle from the index at which it begins, degrees.
    start_degrees: f64,
}

/// A piece, in coordinates of the machine's own axes.
#[derive(Clone, Debug)]
struct CollectedPiece {
    end_mm: Vec<f64>,
    pitch_mm: f64,
    mode: PathMode,
    line: u32,
}

impl CanonExecutor<'_> {
    /// Executes a function that belongs to a thread. `None`: it does not.
    pub(super) fn thread<const A: usize>(
        &mut self,
        canon: &Canon,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Option<Result<(), CanonError>> {
        match (canon, &mut self.thread) {
            (&Canon::StartSpeedFeedSynch { pitch, start_degrees }, thread) => {
                let pitch_mm = Some(pitch.abs() * self.unit.millimetres());
                match thread {
                    Some(thread) => thread.pitch_mm = pitch_mm,
                    None => *thread = Some(CollectedThread { pitch_mm, pieces: Vec::new(), start_degrees }),
                }
                Some(self.check_thread())
            }
            (Canon::StopSpeedFeedSynch, Some(thread)) => {
                thread.pitch_mm = None;
                Some(Ok(()))
            }
            (Canon::StraightFeed(end), Some(CollectedThread { pitch_mm: Some(pitch_mm), .. })) => {
                let pitch_mm = *pitch_mm;
                Some(self.add_thread_piece::<A>(end, pitch_mm, line))
            }
            (Canon::RigidTap { end, return_factor }, Some(CollectedThread { pitch_mm: Some(pitch_mm), .. })) => {
                let pitch_mm = *pitch_mm;
                Some(self.end_thread(sink).and_then(|()| self.rigid_tap(end, (pitch_mm, *return_factor), line, sink)))
            }
            (Canon::Comment(_) | Canon::Note(_), Some(_)) => Some(Ok(())),
            (Canon::DisableFeedOverride | Canon::EnableFeedOverride, Some(_)) => {
                self.feed_override.program(*canon == Canon::EnableFeedOverride);
                Some(Ok(()))
            }
            (_, Some(_)) => self.end_thread(sink).err().map(Err),
            (_, None) => None,
        }
    }

    /// Whether a thread that is being collected may go on in the next block, which has these steps.
    pub(crate) fn continues_thread(&self, steps: &[CanonStep]) -> bool {
        let is_neutral = |step: &&CanonStep| !matches!(step.canon, Canon::Comment(_) | Canon::Note(_));
        let first = steps.iter().find(is_neutral);
        self.thread.is_none() || first.is_none_or(|step| matches!(step.canon, Canon::StartSpeedFeedSynch { .. }))
    }

    /// Line in which a thread that is being collected begins; 0 without one.
    pub(crate) fn thread_line(&self) -> u32 {
        self.thread.as_ref().and_then(|thread| thread.pieces.first()).map_or(0, |piece| piece.line)
    }

    /// What the machine and the program must have.
    fn check_thread(&self) -> Result<(), CanonError> {
        let Some(encoder) = self.machine.encoder else { return Err(CanonError::NoEncoder) };
        if !encoder.settings.has_index {
            return Err(CanonError::NoEncoder);
        }
        if self.rpm <= 0.0 { Err(CanonError::ThreadWithoutSpeed) } else { Ok(()) }
    }

    fn add_thread_piece<const A: usize>(
        &mut self,
        end: &retrace_gcode::Pose,
        pitch_mm: f64,
        line: u32,
    ) -> Result<(), CanonError> {
        let position = self.machine_position(end);
        let really = self.correction.map_or(position, |correction| correction.move_end(&self.at, &position, false));
        let own = self.machine_coordinates::<A>(&really)?;
        self.record_move_end(position, &really);
        let mode = self.path;
        if let Some(thread) = &mut self.thread {
            thread.pieces.push(CollectedPiece { end_mm: own.to_vec(), pitch_mm, mode, line });
        }
        Ok(())
    }

    /// A tap to X, Y and Z, and back.
    fn rigid_tap<const A: usize>(
        &mut self,
        end: &[f64; 3],
        (pitch_mm, return_factor): (f64, f64),
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        self.thread = None;
        let Some(encoder) = self.machine.encoder.filter(|_| self.check_thread().is_ok()) else { return Ok(()) };
        let axes = [Axis::X, Axis::Y, Axis::Z];
        let programmed = axes.into_iter().zip(end).fold(Pose::ZERO, |pose, (axis, &to)| pose.with(axis, to));
        let there = self.machine_position(&programmed);
        let position = axes.into_iter().fold(self.at, |pose, axis| pose.with(axis, there[axis]));
        let really = |position: Pose| {
            self.correction.map_or(position, |correction| correction.move_end(&self.at, &position, false))
        };
        let from_mm = self.machine_coordinates::<A>(&really(self.at))?;
        let depth_mm = self.machine_coordinates::<A>(&really(position))?;
        // The card turns the spindle back as it was, and the next feed waits for it.
        self.awaits_speed = true;
        let return_rpm = self.rpm * return_factor;
        sink.tap(&RigidTap { from_mm, depth_mm, pitch_mm, rpm: self.rpm, return_rpm, line }, &encoder)?;
        Ok(())
    }

    /// Gives the thread that was collected to the sink.
    ///
    /// # Errors
    /// The machine cannot follow the spindle there.
    pub(crate) fn end_thread<const A: usize>(&mut self, sink: &mut impl MotionSink<A>) -> Result<(), CanonError> {
        let Some(thread) = self.thread.take().filter(|thread| !thread.pieces.is_empty()) else { return Ok(()) };
        // What is missing was reported where the thread begins.
        let Some(encoder) = self.machine.encoder.filter(|_| self.check_thread().is_ok()) else { return Ok(()) };
        let piece = |of: CollectedPiece| {
            let mut end_mm = [0.0; A];
            end_mm.iter_mut().zip(of.end_mm).for_each(|(slot, mm)| *slot = mm);
            ThreadPiece { end_mm, pitch_mm: of.pitch_mm, mode: of.mode, line: of.line }
        };
        let start_degrees = thread.start_degrees;
        let pieces = thread.pieces.into_iter().map(piece).collect();
        let stretch = ThreadStretch { pieces, rpm: self.rpm, start_degrees };
        self.awaits_speed = false;
        sink.thread(&stretch, &encoder)?;
        Ok(())
    }

    /// Waits before a feed move until the spindle is at speed, where it was started, reversed, or changed by more than
    /// 5 % since (SPN-6).
    pub(super) fn await_speed<const A: usize>(
        &mut self,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let (encoder, ready) = (self.machine.encoder, self.machine.spindle.ready);
        let is_watched = encoder.is_some() || ready.is_some();
        if !is_watched || !std::mem::take(&mut self.awaits_speed) || self.spindle_turns != Some(true) {
            return Ok(());
        }
        self.rpm_reached = self.rpm;
        let spindle = encoder.map(|_| SpindleTask::AtSpeed);
        let (periods, until) = ready.map_or((0, None), |ready| (ready.periods, ready.until));
        let wait = SwitchInstruction { line, code: "S", spindle, periods, until, ..SwitchInstruction::default() };
        Ok(sink.exclusive(wait)?)
    }

    /// Notes a start of the spindle's own output, or a change of its speed.
    pub(super) fn note_spindle_change(&mut self, number: u8) {
        let is_change = (self.rpm - self.rpm_reached).abs() > 0.05 * self.rpm_reached.abs();
        self.awaits_speed |= number == channel::SPINDLE || is_change;
    }
}
