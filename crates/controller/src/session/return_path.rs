//! The way back to a breakpoint before a job is resumed: tool axis up to the retract plane, other axes, tool axis down (DNC-6).
//!
//! Invariant: the program's path is begun only behind it, at the counts of the breakpoint; whoever is there can stop the axes at any time, and
//! the job is then stopped at its breakpoint.

use retrace_core::mode::Mode;
use retrace_link::{CardStatus, MotionCard, PathStart};

use super::{Outcome, Session};
use crate::dnc_events::{DncEvent, DncFlags, DncStep};
use crate::event::{CardError, EventKind};
use crate::manual::jog_planner::JogRequest;
use crate::manual::manual_move::{ManualMove, ManualMoveEnd};
use crate::operator::{CommandError, OperatorCommand};
use crate::telemetry::{HoldReason, PeriodRecord, Telemetry};

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Moves the axes from where they stand to the counts `to`; nothing moves where they are there. `Some`: the job ends instead.
    pub(super) fn go_to_breakpoint(&mut self, to: [i64; A]) -> Result<Option<Outcome>, CardError> {
        let CardStatus { counts: from, executed, .. } = *self.card.status();
        if from == to {
            return Ok(None);
        }
        let Some(mut hand) = self.dnc.take_hand() else { return Err(not_planned()) };
        // A card that was only asked where it stands is opened by that.
        let begins = PathStart { executed, ..PathStart::at(hand.ring.write()) };
        self.card.begin_path(begins).map_err(|fault| CardError::of(&fault))?;
        self.tell_way_back(DncStep::Approaching);
        let request = JogRequest::Approach { from, to };
        let mut trip = ManualMove::begin(&mut hand, request, executed, self.enough, self.manner.wall_time);
        let ended = loop {
            let turned = trip.turn(&mut hand, &mut self.card).map_err(|fault| CardError::of(&fault))?;
            if let Some(ended) = turned {
                break ended;
            }
            if self.is_told_to_stop() {
                trip.stop();
            }
            if let Some(outcome) = self.period_off_path()? {
                return Ok(Some(outcome));
            }
        };
        self.dnc.put_hand(hand);
        match ended {
            ManualMoveEnd::There if self.card.status().counts == to => {
                self.tell_way_back(DncStep::Arrived);
                Ok(None)
            }
            ManualMoveEnd::There | ManualMoveEnd::NotPlanned => Err(not_planned()),
            ManualMoveEnd::Stopped => Ok(Some(Outcome::Stopped)),
        }
    }

    /// Takes the words of whoever is there; a script begins when the program does.
    fn is_told_to_stop(&mut self) -> bool {
        let mut stops = false;
        while let Some(deed) = self.operators.next_live_command() {
            self.tell(EventKind::Operator(deed));
            match deed {
                OperatorCommand::Stop | OperatorCommand::Hold | OperatorCommand::Pause => stops = true,
                OperatorCommand::OptionalStop(on) => self.optional_stop = on,
                _ => self.tell(EventKind::CommandRejected(CommandError::NotNow("the axes go back to the breakpoint"))),
            }
        }
        stops
    }

    /// A control period that belongs to no program.
    fn period_off_path(&mut self) -> Result<Option<Outcome>, CardError> {
        let status = *self.card.run_period().map_err(|fault| CardError::of(&fault))?;
        self.tally.pause();
        self.teller.outputs(&status.outputs);
        let period = PeriodRecord {
            mode: Mode::Run,
            hold_reason: HoldReason::Paused,
            off_path: true,
            ..PeriodRecord::of(&status)
        };
        self.teller.send(Telemetry::Period(period));
        Ok(self.alarm(&status))
    }

    fn tell_way_back(&mut self, step: DncStep) {
        self.tell(EventKind::Dnc(DncEvent { step, flags: DncFlags::default() }));
    }
}

fn not_planned() -> CardError {
    CardError::Fault {
        number: "E2217",
        cause: "the way back to the breakpoint cannot be planned".into(),
        remedy: "bring the machine nearer to the breakpoint by hand, then resume again".into(),
    }
}
