//! The height of a cutter that senses the sheet: the moves of the layer in its instructions (CUT-13 … CUT-15).
//!
//! Invariant: no rapid move is made with the cutter off at the height of its cut, and no move of the tool axis while
//! the layer may not be 0.

use retrace_gcode::Axis;
use retrace_link::{LayerMove, OutputChange};

use super::{CanonError, CanonExecutor};
use crate::motion_sink::MotionSink;
use crate::plan_writer::SwitchInstruction;

/// Code of an instruction that only moves the layer, in messages.
pub(crate) const HEIGHT: &str = "height";

/// Where the layer is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum LayerState {
    /// It is 0.
    #[default]
    Zero,
    /// At the height of a cut.
    AtCut,
    /// At the safe height.
    Safe,
}

impl CanonExecutor<'_> {
    /// The moves of the layer that belong to this change of an output, if any: now, and at a restart.
    pub(super) fn layer_moves(&mut self, change: OutputChange) -> Result<Option<[LayerMove; 2]>, CanonError> {
        let Some(layer) = self.machine.tool_layer().filter(|layer| layer.fire == change.channel) else {
            return Ok(None);
        };
        let is_lit = self.cutters.is_lit(self.machine, change.channel);
        if (change.value != 0) == is_lit {
            return Ok(None);
        }
        let path_mm = self.actual_position()[self.axes[layer.index]];
        if self.machine.inhibits_outputs {
            return Ok(self.dry_lift(layer.first_lift(path_mm)).map(|lift| [lift; 2]));
        }
        if change.value == 0 {
            self.layer = LayerState::Safe;
            return Ok(Some([layer.lift(path_mm); 2]));
        }
        let heights = self.material.as_ref().map(|of| (of.pierce_height_mm, of.cut_height_mm));
        let Some((pierce_mm, cut_mm)) = heights.filter(|&(pierce_mm, cut_mm)| pierce_mm > 0.0 && cut_mm > 0.0) else {
            return Err(CanonError::NotSupported("a cut by a material without heights, whose sheet is sensed,"));
        };
        self.layer = LayerState::AtCut;
        let puddle_mm = self.puddle().map_or(cut_mm, |(puddle_mm, _)| puddle_mm);
        let may_skip = self.skips_sensing(path_mm, layer.sensing().skip_mm);
        // A restart senses, and what it finds counts for no later start.
        let [now, restart] = [(puddle_mm, may_skip), (cut_mm, true)];
        Ok(Some([now, restart].map(|(mm, may_skip)| layer.start(path_mm, [pierce_mm, mm], may_skip))))
    }

    /// Whether the place of this start is near the one at which the sheet was sensed last. Where it is not, the sheet
    /// is sensed here.
    fn skips_sensing(&mut self, path_mm: f64, skip_mm: f64) -> bool {
        let at = self.actual_position();
        let here = [at[Axis::X], at[Axis::Y], path_mm];
        let is_near = |[x, y, path]: [f64; 3]| path == path_mm && (x - here[0]).hypot(y - here[1]) < skip_mm;
        let skips = self.sensed_at.is_some_and(is_near);
        if !skips {
            self.sensed_at = Some(here);
        }
        skips
    }

    /// In a dry run the tool stays at the safe height over the expected sheet, or higher: the move there, once (CUT-8).
    fn dry_lift(&mut self, first_lift: Option<LayerMove>) -> Option<LayerMove> {
        let is_first = std::mem::replace(&mut self.layer, LayerState::Safe) == LayerState::Zero;
        first_lift.filter(|_| is_first)
    }

    /// Height in mm over the sheet behind the pierce, and the time in s there, where the material has them (CUT-13).
    fn puddle(&self) -> Option<(f64, f64)> {
        let of = self.material.as_ref()?;
        let differs = of.puddle_percent > 0.0 && of.puddle_percent != 100.0 && of.puddle_s > 0.0;
        differs.then_some((of.pierce_height_mm * of.puddle_percent / 100.0, of.puddle_s))
    }

    /// Behind a start: waits at the puddle height, and goes to that of the cut. A restart does without.
    pub(super) fn leave_puddle<const A: usize>(
        &self,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let (Some(layer), Some((_, puddle_s))) = (self.machine.tool_layer(), self.puddle()) else { return Ok(()) };
        let cut_mm = self.material.as_ref().map_or(0.0, |of| of.cut_height_mm);
        let moves = layer.over_sheet(self.actual_position()[self.axes[layer.index]], cut_mm);
        let periods = if self.machine.skips_waits() { 0 } else { self.periods(puddle_s) };
        let instruction =
            SwitchInstruction { line, code: HEIGHT, periods, layer: Some(moves), ..SwitchInstruction::default() };
        Ok(sink.exclusive(instruction)?)
    }

    /// Before a move to these coordinates.
    pub(super) fn layer_before_move<const A: usize>(
        &mut self,
        end_mm: &[f64; A],
        is_rapid: bool,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let Some(layer) = self.machine.tool_layer() else { return Ok(()) };
        let path_mm = self.actual_position()[self.axes[layer.index]];
        if end_mm[layer.index] != path_mm {
            return self.return_layer(line, sink);
        }
        let moves = match self.layer {
            _ if !is_rapid || self.cutters.is_lit(self.machine, layer.fire) => None,
            LayerState::AtCut => Some(layer.lift(path_mm)),
            // The program begins near the sheet, where a job was stopped for example.
            LayerState::Zero => layer.first_lift(path_mm),
            LayerState::Safe => None,
        };
        let Some(moves) = moves else { return Ok(()) };
        self.layer = LayerState::Safe;
        move_layer(moves, line, sink)
    }

    /// Records that the layer was moved before the first block that is executed.
    pub(crate) fn record_lift(&mut self) {
        if self.layer == LayerState::Zero {
            self.layer = LayerState::Safe;
        }
    }

    /// Moves the layer to 0, if it may be elsewhere.
    pub(super) fn return_layer<const A: usize>(
        &mut self,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        if self.layer == LayerState::Zero {
            return Ok(());
        }
        (self.layer, self.sensed_at) = (LayerState::Zero, None);
        move_layer(LayerMove::To { layer: 0 }, line, sink)
    }
}

fn move_layer<const A: usize>(moves: LayerMove, line: u32, sink: &mut impl MotionSink<A>) -> Result<(), CanonError> {
    let instruction = SwitchInstruction { line, code: HEIGHT, layer: Some(moves), ..SwitchInstruction::default() };
    Ok(sink.exclusive(instruction)?)
}
