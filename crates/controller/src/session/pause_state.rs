//! The state of a pause: the order of its steps, what waits for the machine to be at rest, and the manual move in
//! progress (DNC-1 … DNC-8).
//!
//! Invariant: what was latched stays until the axes are back; at most one manual move is in progress.

use std::collections::VecDeque;

use retrace_config::MachineConfig;
use retrace_core::interruption::{Interruption, InterruptionError, InterruptionEvent as Said, SpindleDirection};
use retrace_core::{Place, RecordIndex};
use retrace_journal::HoldReason;
use retrace_link::PathStart;

use crate::jog_planner::JogPlanner;
use crate::manual_move::ManualMove;
use crate::operator::OperatorCommand;

/// Maximum number of commands that wait for a manual move to end.
pub(super) const MAX_PENDING_COMMANDS: usize = 64;

/// An axis, as far as manual moves need it.
#[derive(Clone, Copy, Debug)]
pub(super) struct PausedAxis {
    pub(super) letter: char,
    pub(super) pulses_per_mm: f64,
    /// Soft limits in counts.
    pub(super) soft_limits: [i64; 2],
}

/// Purpose of a manual move.
#[derive(Clone, Copy, Debug)]
pub(super) enum ManualMovePurpose<const A: usize> {
    Jog {
        axis: usize,
        from: i64,
        to: i64,
        /// The move was shortened to end at the soft limit.
        cut_short: bool,
    },
    /// To the park position.
    Park,
    /// To where the pointer shows the place of the tool.
    Pointer,
    /// Return to the breakpoint, with the state of the interruption before the return.
    Approach(Interruption<A>),
}

/// State of a pause.
#[derive(Debug)]
pub(super) struct DncPause<'r, const A: usize> {
    pub(super) jog_planner: Option<JogPlanner<'r, A>>,
    pub(super) axes: Vec<PausedAxis>,
    /// Identity of the program that is run.
    pub(super) program: u64,
    pub(super) interruption: Interruption<A>,
    /// Whether the machine is coming to rest to latch a breakpoint.
    pub(super) pausing: bool,
    /// Periods at rest while doing so.
    pub(super) rest_periods: u32,
    /// Commands that wait for the machine to be at rest.
    pub(super) pending_commands: VecDeque<OperatorCommand>,
    /// Whether the identity of the program that would be read now is being determined.
    pub(super) identifying: bool,
    pub(super) manual_move: Option<(ManualMove, ManualMovePurpose<A>)>,
    /// Position on the program's path while the card is in another epoch.
    pub(super) path_start: Option<PathStart>,
    /// *Spindle start* was given for a cutter: it is lit after the return to the path, not before.
    pub(super) cutter_is_armed: bool,
}

impl<'r, const A: usize> DncPause<'r, A> {
    pub(super) fn new(machine: &MachineConfig) -> Self {
        let axis = |(index, axis): (usize, &retrace_config::AxisConfig)| PausedAxis {
            letter: axis.name,
            pulses_per_mm: axis.pulses_per_mm,
            soft_limits: axis.travel_mm.map(|mm| machine.counts_of(index, mm)),
        };
        Self {
            jog_planner: None,
            axes: machine.axes.iter().enumerate().take(A).map(axis).collect(),
            program: 0,
            interruption: Interruption::reading(),
            pausing: false,
            rest_periods: 0,
            pending_commands: VecDeque::with_capacity(MAX_PENDING_COMMANDS),
            identifying: false,
            manual_move: None,
            path_start: None,
            cutter_is_armed: false,
        }
    }

    /// Adds a planner of manual moves; `program` is the identity of the program that is run.
    pub(super) fn with_jog_planner(self, hand: JogPlanner<'r, A>, program: u64) -> Self {
        Self { jog_planner: Some(hand), program, ..self }
    }

    /// Removes the jog planner; [`DncPause::return_jog_planner`] puts it back.
    pub(super) fn take_jog_planner(&mut self) -> Option<JogPlanner<'r, A>> {
        self.jog_planner.take()
    }

    /// Puts back the jog planner that [`DncPause::take_jog_planner`] removed.
    pub(super) fn return_jog_planner(&mut self, hand: JogPlanner<'r, A>) {
        self.jog_planner = Some(hand);
    }

    /// Whether the program is paused or coming to rest for a pause.
    pub(super) fn is_on(&self) -> bool {
        self.pausing || self.interruption.is_paused()
    }

    /// Whether manual moves can be planned.
    pub(super) fn has_jog_planner(&self) -> bool {
        self.jog_planner.is_some()
    }

    /// Whether the program is paused.
    pub(super) fn is_paused(&self) -> bool {
        self.interruption.is_paused()
    }

    /// Whether the machine is coming to rest for a pause.
    pub(super) fn is_pausing(&self) -> bool {
        self.pausing
    }

    /// Whether the card is in an epoch other than the program's.
    pub(super) fn is_off_path(&self) -> bool {
        self.path_start.is_some()
    }

    /// Whether an operation is in progress that commands have to wait for.
    pub(super) fn is_busy(&self) -> bool {
        self.pausing || self.identifying || self.is_moving()
    }

    /// Shifts the breakpoint by these pulses for a tool length, or reports why no length may be entered.
    pub(super) fn shift_breakpoint(&mut self, pulses: [i64; A]) -> Result<(), InterruptionError> {
        self.interruption.displace_breakpoint(pulses)
    }

    /// Counts of the breakpoint, and the place on the path where the program was left, while it is paused.
    pub(super) fn breakpoint(&self, here: Place) -> Option<([i64; A], Place)> {
        let latch = self.interruption.breakpoint()?;
        Some((latch.counts, self.path_start.map_or(here, |left| left.place)))
    }

    /// Whether the axes may be moved manually.
    ///
    /// # Errors
    /// The condition that is not met.
    pub(super) fn require_jog(&self) -> Result<(), InterruptionError> {
        let mut trial = self.interruption;
        trial.apply(Said::Jog).map(|_| ())
    }

    /// The event of a step of the pause.
    pub(super) fn event_of(&self, step: OperatorCommand) -> Said<A> {
        let latched = self.interruption.breakpoint();
        let turned = latched.and_then(|latch| latch.spindle);
        match step {
            OperatorCommand::SpindleStop => Said::StopSpindle,
            OperatorCommand::SpindleStart => {
                Said::StartSpindle(turned.map_or(SpindleDirection::Clockwise, |was| was.direction))
            }
            OperatorCommand::Online => Said::Online,
            _ => Said::CycleStart { program: latched.map_or(0, |latch| latch.program) },
        }
    }

    /// Whether these steps are permitted one after the other.
    pub(super) fn are_in_order(&self, steps: &[OperatorCommand]) -> bool {
        let mut trial = self.interruption;
        steps.iter().all(|&step| trial.apply(self.event_of(step)).is_ok())
    }

    /// Requests these steps, each once the one before is done.
    pub(super) fn queue_steps(&mut self, steps: &[OperatorCommand]) {
        self.pending_commands.extend(steps.iter().copied().take(MAX_PENDING_COMMANDS - self.pending_commands.len()));
    }

    pub(super) fn is_moving(&self) -> bool {
        self.manual_move.is_some()
    }

    pub(super) fn hold_reason(&self) -> Option<HoldReason> {
        self.interruption.is_paused().then_some(HoldReason::Paused)
    }

    /// The furthest place on the program's path when it was left.
    pub(super) fn reached(&self) -> Option<RecordIndex> {
        self.path_start.map(|left| left.reached)
    }
}
