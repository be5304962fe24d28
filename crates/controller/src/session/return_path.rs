//! The return to a breakpoint before a job is resumed: tool axis up to the retract plane, other axes, tool axis down
//! (DNC-6).
//!
//! Invariant: the program's path is begun only after the return, at the counts of the breakpoint. An operator can stop
//! the axes at any time; the job is then stopped at its breakpoint.

use retrace_core::mode::Mode;
use retrace_journal::HoldReason;
use retrace_link::{MotionCard, PathStart};

use super::{Outcome, Session};
use crate::dnc_events::{DncEvent, DncFlags, DncStep};
use crate::event::{CardError, EventKind};
use crate::jog_planner::JogRequest;
use crate::manual_move::{ManualMove, ManualMoveEnd};
use crate::operator::{CommandError, OperatorCommand};
use crate::telemetry::{PeriodRecord, Telemetry};

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Moves the axes to the counts `to`; nothing moves where they are there already. `Some`: the job ends instead.
    pub(super) fn go_to_breakpoint(&mut self, to: [i64; A]) -> Result<Option<Outcome>, CardError> {
        if self.card.status().counts == to {
            return Ok(None);
        }
        let Some(mut hand) = self.dnc.take_jog_planner() else { return Err(not_planned()) };
        // A card that was only queried for its position is opened by this; the layer becomes part of the counts.
        let executed = self.card.status().executed;
        self.card.begin_path(PathStart { executed, ..PathStart::at(hand.ring.write()) })?;
        let from = self.card.status().counts;
        self.emit_return_step(DncStep::Approaching);
        let request = JogRequest::Approach { from, to };
        let mut trip = ManualMove::begin(
            &mut hand,
            request,
            executed,
            self.config.look_ahead_records,
            self.config.run_mode.wall_time,
        );
        let ended = loop {
            let turned = trip.advance(&mut hand, &mut self.card)?;
            if let Some(ended) = turned {
                break ended;
            }
            if self.stop_is_requested() {
                trip.stop();
            }
            if let Some(outcome) = self.run_return_period()? {
                return Ok(Some(outcome));
            }
        };
        self.dnc.return_jog_planner(hand);
        match ended {
            ManualMoveEnd::Completed if self.card.status().counts == to => {
                self.emit_return_step(DncStep::Arrived);
                Ok(None)
            }
            ManualMoveEnd::Completed | ManualMoveEnd::NotPlanned => Err(not_planned()),
            ManualMoveEnd::Stopped => Ok(Some(Outcome::Stopped)),
        }
    }

    /// Whether a live operator requests a stop. A script begins when the program does.
    fn stop_is_requested(&mut self) -> bool {
        let mut stops = false;
        while let Some(command) = self.commands.next_live_command() {
            self.emit(EventKind::Operator(command));
            match command {
                OperatorCommand::Stop | OperatorCommand::Hold | OperatorCommand::Pause => stops = true,
                OperatorCommand::OptionalStop(on) => self.optional_stop = on,
                _ => self.emit(EventKind::CommandRejected(CommandError::NotNow("the axes go back to the breakpoint"))),
            }
        }
        stops
    }

    /// Runs a control period that belongs to no program.
    fn run_return_period(&mut self) -> Result<Option<Outcome>, CardError> {
        let status = *self.card.run_period()?;
        self.stats.count_paused();
        self.telemetry.send_output_changes(&status.outputs);
        let period = PeriodRecord {
            mode: Mode::Run,
            hold_reason: HoldReason::Paused,
            off_path: true,
            ..PeriodRecord::from_status(&status)
        };
        self.telemetry.send(Telemetry::Period(period));
        Ok(self.alarm(&status))
    }

    fn emit_return_step(&mut self, step: DncStep) {
        self.emit(EventKind::Dnc(DncEvent { step, flags: DncFlags::default() }));
    }
}

fn not_planned() -> CardError {
    CardError::Fault {
        number: "E2217",
        cause: "the return to the breakpoint cannot be planned".into(),
        remedy: "move the machine nearer to the breakpoint manually, then resume again".into(),
    }
}
