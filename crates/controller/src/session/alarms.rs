//! What ends a job with an error: alarms of the card, and what the session itself refuses.
//!
//! Invariant: an alarm is reported once, and ends the job with the machine at rest.

use retrace_link::{Alarm, CardStatus, MotionCard};

use super::{Outcome, Session};
use crate::event::{CardError, EventKind};

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Ends the job with an error, which is reported unless an alarm was.
    pub(super) fn end_with_error(&mut self, error: CardError) -> Outcome {
        let (number, cause, remedy) = error.parts();
        if !self.alarm_reported {
            let line = self.probing.line().unwrap_or_else(|| self.line_at_cursor(self.card.status()));
            self.emit_at(line, EventKind::Alarm(error));
        }
        Outcome::Alarm(number, cause, remedy)
    }

    /// Refuses motion with a collision input that is still active although its alarm was cleared. The card lets the
    /// operator jog off it.
    pub(super) fn check_collision(&self) -> Result<(), CardError> {
        let active = self.card.status().inputs & self.config.collision_inputs;
        let alarm = Alarm::Collision { input: active.trailing_zeros() as u8 };
        if active == 0 { Ok(()) } else { Err(CardError::Latched(alarm)) }
    }

    /// Handles a latched alarm: reported immediately; it ends the job when the machine is at rest.
    pub(super) fn alarm(&mut self, status: &CardStatus<A>) -> Option<Outcome> {
        let alarm = status.alarm?;
        if !self.alarm_reported {
            self.emit(EventKind::Alarm(CardError::Latched(alarm)));
            self.alarm_reported = true;
        }
        status.at_rest.then(|| self.end_with_error(CardError::Latched(alarm)))
    }
}
