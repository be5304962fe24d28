//! Starting in the middle of a program, at a line (`--start-line`) or at a contour (`--contour`).
//!
//! Invariant: what the skipped blocks switched is switched by their own instructions, with their durations: everything
//! but the cutters before the first move, the cutters where the skipped motion ended (CUT-17). The axes move there in
//! the order of DNC-6: tool axis up to the retract plane or higher, other axes, tool axis down. A cutter that senses
//! the sheet senses it there before it is lit.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use retrace_config::MachineConfig;
use retrace_core::RecordIndex;
use retrace_link::{OutputAction, OutputChange, Outputs};
use retrace_motion::{Arc as PathArc, FeedRate, PathMode};

use crate::motion_sink::MotionSink;
use crate::plan_item::{ExclusiveKind, HEIGHT};
use crate::plan_writer::{Cancelled, PlanWriteError, PlanWriter, SwitchInstruction};
use crate::restart::OutputOrigins;

/// Where in a program a job begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StartPoint {
    /// The first block of this line or a later one.
    Line(u32),
    /// The contour of this number, from 1 on: its cutter is lit where it begins (CUT-47).
    Contour(u32),
}

/// Receives the skipped blocks: switching is recorded, motion is not made.
#[derive(Debug)]
pub(crate) struct SkippedBlocks {
    outputs: Outputs,
    origins: OutputOrigins,
    /// The channels that belong to the start of a torch, a jet or a beam; first those that fire it.
    cutting: Vec<u8>,
    /// Number of those that fire.
    firing: usize,
    /// Number of skipped moves: what was switched between the same two belongs to one place.
    moves: u32,
    /// Number of contours that have begun.
    contours: u32,
    /// Whether the operator's overrides apply behind what was skipped.
    override_applies: bool,
    /// Where the number of contours that are skipped completely is stored for the motion path.
    skipped_contours: Arc<AtomicU32>,
}

impl SkippedBlocks {
    /// Creates the state with nothing skipped; the outputs are as given.
    #[must_use]
    pub(crate) fn new(outputs: Outputs, machine: &MachineConfig, skipped_contours: Arc<AtomicU32>) -> Self {
        let (cutting, firing) = (machine.cutter_channels(), machine.cutting_outputs.len());
        let origins = OutputOrigins::default();
        Self { outputs, origins, cutting, firing, moves: 0, contours: 0, override_applies: true, skipped_contours }
    }

    /// Whether the job begins with a step of this line.
    #[must_use]
    pub(crate) fn reaches(&self, start: StartPoint, line: u32) -> bool {
        match start {
            StartPoint::Line(first) => line >= first,
            StartPoint::Contour(number) => self.contours >= number,
        }
    }

    fn count_contour(&mut self, change: OutputChange) {
        let is_off = self.outputs[usize::from(change.channel)] == 0;
        let fires = self.cutting[..self.firing].contains(&change.channel);
        self.contours += u32::from(is_off && change.value != 0 && fires);
    }

    /// Brings a machine at rest to the state behind the skipped blocks: outputs first, then to `target_mm`, where the
    /// skipped motion ended, in the order of DNC-6 for this machine; a tool that is near the sheet is lifted by its
    /// layer. Returns whether it was.
    ///
    /// # Errors
    /// The reason why the planner rejects it.
    pub(crate) fn restore<const A: usize>(
        &self,
        plan_writer: &mut PlanWriter<'_, A>,
        target_mm: [f64; A],
        machine: &MachineConfig,
        line: u32,
    ) -> Result<bool, PlanWriteError> {
        // The contour in which the skipped blocks end is begun here.
        let is_within = self.cutting[..self.firing].iter().any(|&fire| self.outputs[usize::from(fire)] != 0);
        self.skipped_contours.store(self.contours - u32::from(is_within && self.contours > 0), Ordering::Release);
        self.switch(plan_writer, line, |channel| !self.cutting.contains(&channel))?;
        let at = plan_writer.commanded_mm();
        let layer = machine.tool_layer().filter(|layer| at[layer.index] == target_mm[layer.index]);
        let lift = layer.and_then(|layer| layer.first_lift(at[layer.index]));
        if lift.is_some() {
            plan_writer.exclusive(SwitchInstruction { line, code: HEIGHT, layer: lift, ..Default::default() })?;
        }
        let ends = if lift.is_some() { vec![target_mm] } else { ends_mm(machine, at, target_mm) };
        for end in ends {
            plan_writer.straight(end, FeedRate::Rapid, PathMode::ExactStop, line)?;
        }
        plan_writer.rest()?;
        if !self.override_applies {
            plan_writer.exclusive(SwitchInstruction::of_feed_override(false, line))?;
        }
        self.switch(plan_writer, line, |channel| self.cutting.contains(&channel))?;
        Ok(lift.is_some())
    }

    /// Executes again what switched the channels selected by `concerned`.
    fn switch<const A: usize>(
        &self,
        plan_writer: &mut PlanWriter<'_, A>,
        line: u32,
        concerned: impl Fn(u8) -> bool,
    ) -> Result<(), Cancelled> {
        let mut steps = Vec::new();
        self.origins.plan_restart(plan_writer.outputs(), &self.outputs, &self.cutting, concerned, &mut steps);
        for step in &steps {
            let (periods, until, layer) = (step.periods, step.until, step.layer);
            let changes = step.changes();
            plan_writer.exclusive(SwitchInstruction {
                line,
                code: step.code,
                changes,
                periods,
                until,
                layer,
                ..SwitchInstruction::default()
            })?;
        }
        Ok(())
    }
}

/// Ends of the moves from one position to another, mm, as [`crate::approach`] orders them.
fn ends_mm<const A: usize>(machine: &MachineConfig, at: [f64; A], target: [f64; A]) -> Vec<[f64; A]> {
    let tool = machine.tool_axis().filter(|&tool| tool < A);
    let others_move = (0..A).any(|axis| Some(axis) != tool && at[axis] != target[axis]);
    let (Some(tool), true) = (tool, others_move) else { return vec![target] };
    let height = at[tool].max(target[tool]).max(machine.setting_up.retract_mm.unwrap_or(f64::NEG_INFINITY));
    let (mut up, mut across) = (at, target);
    (up[tool], across[tool]) = (height, height);
    vec![up, across, target]
}

impl<const A: usize> MotionSink<A> for SkippedBlocks {
    fn straight(&mut self, _: [f64; A], _: FeedRate, _: PathMode, _: u32) -> Result<(), PlanWriteError> {
        self.moves = self.moves.wrapping_add(1);
        Ok(())
    }

    fn arc(&mut self, _: &PathArc<A>, _: FeedRate, _: PathMode, _: u32) -> Result<(), PlanWriteError> {
        self.moves = self.moves.wrapping_add(1);
        Ok(())
    }

    fn action(&mut self, change: OutputChange, line: u32) {
        self.count_contour(change);
        let OutputChange { channel, value } = change;
        let before = std::mem::replace(&mut self.outputs[usize::from(channel)], value);
        self.origins
            .record_action(&OutputAction { place: RecordIndex::new(self.moves), channel, before, after: value }, line);
    }

    fn exclusive(&mut self, switch: SwitchInstruction<'_>) -> Result<(), Cancelled> {
        for &change in switch.changes {
            self.count_contour(change);
            self.outputs[usize::from(change.channel)] = change.value;
        }
        if let ExclusiveKind::FeedOverride { applies } = switch.kind {
            self.override_applies = applies;
        } else if switch.kind == ExclusiveKind::Dwell {
            self.origins.record_dwell(RecordIndex::new(self.moves), switch.periods, &self.outputs, &self.cutting);
        } else if !switch.changes.is_empty() {
            let of = (switch.code, switch.line, RecordIndex::new(self.moves));
            self.origins.record_switching(
                switch.changes,
                of,
                (switch.periods, switch.until, switch.restart_layer.or(switch.layer)),
            );
            if switch.restart_pierce > 0 {
                let place = RecordIndex::new(self.moves);
                self.origins.record_dwell(place, switch.restart_pierce, &self.outputs, &self.cutting);
            }
        }
        Ok(())
    }

    fn message(&mut self, _: String, _: u32) -> Result<(), Cancelled> {
        Ok(())
    }
}
