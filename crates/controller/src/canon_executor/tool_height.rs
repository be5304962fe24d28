//! The height of a cutter that senses the sheet: the moves of the layer in its instructions (CUT-13 … CUT-15).
//!
//! Invariant: no rapid move is made with the cutter off at the height of its cut, and no move of the tool axis while
//! the layer may not be 0.

use std::sync::Arc;

use retrace_config::{PierceMode, ToolLayer};
use retrace_gcode::{Axis, Material};
use retrace_link::{LayerMove, OutputChange};

use super::cut_areas::CutAreas;
use super::{CanonError, CanonExecutor};
use crate::motion_sink::MotionSink;
use crate::plan_item::HEIGHT;
use crate::plan_writer::SwitchInstruction;

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
            return Ok(Some([self.lift_behind_contour(layer, path_mm); 2]));
        }
        let heights = self.material.as_ref().map(|of| (of.pierce_height_mm, of.cut_height_mm));
        let Some((pierce_mm, cut_mm)) = heights.filter(|&(pierce_mm, cut_mm)| pierce_mm > 0.0 && cut_mm > 0.0) else {
            return Err(CanonError::NotSupported("a cut by a material without heights, whose sheet is sensed,"));
        };
        self.layer = LayerState::AtCut;
        let at = self.actual_position();
        self.cut_areas.iter_mut().for_each(|areas| areas.begin([at[Axis::X], at[Axis::Y]]));
        // Where other heights follow beside the motion, that begins at the height of the pierce.
        let first_mm = if self.later_heights(pierce_mm).is_empty() { cut_mm } else { pierce_mm };
        let may_skip = self.skips_sensing(path_mm, layer.sensing().skip_mm);
        let height_control =
            self.machine.height_control().zip(self.material.as_ref()).filter(|(_, of)| of.height_control);
        let control =
            height_control.map(|(control, of)| control.settings(of.volts, self.machine.period_s())).unwrap_or_default();
        // A restart senses, and what it finds counts for no later start.
        let [now, restart] = [(first_mm, may_skip), (cut_mm, true)];
        Ok(Some([now, restart].map(|(mm, may_skip)| layer.start(path_mm, [pierce_mm, mm], may_skip, control))))
    }

    /// Width in µm of the kerf that is begun; 0 where its height is not controlled, or its width is not known.
    pub(super) fn kerf_um(&self) -> u32 {
        let controlled = self.machine.height_control().and(self.material.as_ref()).filter(|of| of.height_control);
        controlled.map_or(0, |of| (of.kerf_mm * 1000.0).round() as u32)
    }

    /// The move behind the end of a contour: to the safe height, or to the retract height in an area that is cut.
    fn lift_behind_contour(&mut self, layer: ToolLayer<'_>, path_mm: f64) -> LayerMove {
        self.layer = LayerState::Safe;
        let is_inside = self.cut_areas.as_mut().is_some_and(CutAreas::end);
        if is_inside { layer.over_sheet(path_mm, layer.sensing().retract_mm) } else { layer.lift(path_mm) }
    }

    /// Follows the contour that is being cut to the end of the last move.
    pub(super) fn follow_contour(&mut self) {
        let at = self.actual_position();
        self.cut_areas.iter_mut().for_each(|areas| areas.follow([at[Axis::X], at[Axis::Y]]));
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

    /// The material as this run uses it: without a pierce where the holes are there, and without motion in the pierce
    /// where nothing is cut (CUT-63).
    pub(super) fn pierced_material(&self, material: &Arc<Material>) -> Arc<Material> {
        let rests = Material { pierces_in_motion: false, puddle_percent: 0.0, ..Material::clone(material) };
        match self.machine.pierce_mode {
            PierceMode::Usual => Arc::clone(material),
            PierceMode::Only { .. } => Arc::new(rests),
            PierceMode::Done => {
                let pierce_height_mm = rests.cut_height_mm;
                Arc::new(Material { pierce_delay_s: 0.0, pierce_height_mm, ..rests })
            }
        }
    }

    /// Whether the material pierces in motion: the feed begins as soon as the cutter is proven (CUT-18).
    pub(super) fn pierces_in_motion(&self) -> bool {
        self.material.as_ref().is_some_and(|material| material.pierces_in_motion)
    }

    /// Heights in mm over the sheet to which the tool goes beside the motion, behind a pierce at `pierce_mm`, each with
    /// the time in s from the beginning of the motion at which it leaves the one before (CUT-13, CUT-18).
    fn later_heights(&self, pierce_mm: f64) -> Vec<(f64, f64)> {
        let (Some(of), Some(layer)) = (self.material.as_ref(), self.machine.tool_layer()) else { return Vec::new() };
        let (mut heights, mut pierced_s) = (Vec::new(), 0.0);
        if of.pierces_in_motion {
            pierced_s = of.pierce_delay_s + of.ramp_hold_s;
            if of.ramp_height_mm > 0.0 {
                heights.push((of.pierce_delay_s * of.ramp_delay_percent / 100.0, of.ramp_height_mm));
            }
        }
        let puddles = of.puddle_percent > 0.0 && of.puddle_percent != 100.0 && of.puddle_s > 0.0;
        if puddles {
            let puddle_mm = pierce_mm * of.puddle_percent / 100.0;
            heights.push((pierced_s, puddle_mm));
            let from_mm = if of.pierces_in_motion && of.ramp_height_mm > 0.0 { of.ramp_height_mm } else { pierce_mm };
            pierced_s += layer.move_time_s(from_mm, puddle_mm) + of.puddle_s;
        }
        if of.pierces_in_motion || puddles {
            heights.push((pierced_s, of.cut_height_mm));
        }
        heights
    }

    /// Behind a start: the heights that follow beside the motion. A restart does without.
    pub(super) fn add_heights<const A: usize>(&self, line: u32, sink: &mut impl MotionSink<A>) {
        let (Some(layer), Some(of)) = (self.machine.tool_layer(), self.material.as_ref()) else { return };
        if self.machine.inhibits_outputs {
            return;
        }
        for (seconds, mm) in self.later_heights(of.pierce_height_mm) {
            sink.height(layer.height(mm), self.periods(seconds), line);
        }
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
            LayerState::AtCut => Some(self.lift_behind_contour(layer, path_mm)),
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
