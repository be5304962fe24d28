//! What an operator sets up by the sheet on the table: its edge, and the frame of the program (CUT-58, CUT-59).
//!
//! Invariant: nothing here moves a machine that is not homed. The model has at most two points on the edge, and two
//! only where they are an edge.

use std::sync::{Arc, Mutex};

use retrace_config::{MachineConfig, NumberedError};
use retrace_controller::{BlockDecoder, DecodedBlock, FrameShape, ManualTask, SheetEdge};
use retrace_journal::ConsumableFile;
use retrace_link::{MotionCard, Outputs};
use retrace_tui::{ScreenModel, lock_model, reported_contours_text, sheet_text};

use super::super::preview_thread::place_on_sheet;
use super::MachineThread;
use crate::consumables::set_text;
use crate::machine_tables::TableFiles;

impl<const A: usize> MachineThread<'_, '_, A> {
    /// Takes the place of the tool, or of the pointer while it is on, as a point on the edge of the sheet.
    pub(super) fn take_sheet_point(&mut self) {
        let status = self.card.status();
        let counts = self.machine.position_counts(status);
        let take = || take_point(&self.router.model, &self.machine, &counts, &status.outputs);
        match self.homing.check(&self.machine).and_then(|()| take()) {
            Ok(text) => {
                self.add_message(text);
                self.draw_on_sheet();
            }
            Err(refusal) => self.reject(refusal),
        }
    }

    /// Draws the job as it will lie once the edge is set, where both points are taken.
    pub(super) fn draw_on_sheet(&self) {
        let [first, second] = lock_model(&self.router.model).sheet_points[..] else { return };
        let Ok(edge) = SheetEdge::through(first, second) else { return };
        let machine = self.machine.clone().standing_at(&self.machine.position_counts(self.card.status()));
        let mut set = self.mdi_context.clone();
        let Ok(mut block) = set.block(&machine, &edge.block(&set.active())) else { return };
        while block.next_block(&mut Vec::new()) == DecodedBlock::Block {}
        set.finish_block(&block);
        let setups = (self.mdi_context.setup_of_program(&machine), set.setup_of_program(&machine));
        place_on_sheet::<A>(&self.router.model, machine, &self.program, setups, [first, second]);
    }

    /// Sets origin and direction of the work coordinates by the edge of the sheet.
    pub(super) fn align_sheet(&mut self) {
        match taken_edge(&self.router.model) {
            Ok(edge) => {
                let zero = sheet_text(&lock_model(&self.router.model)).replace("NOT SET YET: ", "");
                self.add_message(format!("set: {zero}"));
                self.forget_sheet();
                self.perform_task(&ManualTask::Mdi(edge.block(&self.mdi_context.active())));
            }
            Err(refusal) => self.reject(refusal),
        }
    }

    /// Traces a frame around what the program cuts at this position, with these offsets.
    pub(super) fn trace_frame(&mut self, shape: FrameShape) {
        if let Some(why) = self.cannot_begin() {
            return self.reject_text(why);
        }
        if let Err(refusal) = self.homing.check(&self.machine) {
            return self.reject(refusal);
        }
        let machine = self.machine.clone().standing_at(&self.machine.position_counts(self.card.status()));
        let (program, setup) = (Arc::clone(&self.program), self.mdi_context.setup_of_program(&machine));
        match self.while_idle(|| program.reopened(setup)?.frame(&machine, shape)) {
            Ok(frame) => self.perform_task(&ManualTask::Frame(frame)),
            Err(refusal) => self.reject(refusal),
        }
    }

    /// Skips a contour of the next job, or cuts it after all (CUT-61).
    pub(super) fn skip_contour(&mut self, number: u32, on: bool) {
        {
            let mut model = lock_model(&self.router.model);
            model.contours.skip(number, on);
            model.changes += 1;
        }
        self.add_message(format!("contour {number} will be {}", if on { "skipped" } else { "cut" }));
    }

    /// The consumables of all cutters are new (CUT-62).
    pub(super) fn renew_consumables(&mut self) {
        let names: Vec<String> = self.machine.cutters.iter().map(|cutter| cutter.name.clone()).collect();
        let Some(path) = TableFiles::of(&self.args.reading).consumables.filter(|_| !names.is_empty()) else {
            return self.reject_text("the wear of consumables is not counted on this machine");
        };
        let file = ConsumableFile::at(&path);
        match self.while_idle(move || file.begin(&names)) {
            Ok(_) => {
                self.show_consumables();
                self.add_message("the consumables are new: their wear is counted from here on");
            }
            Err(refusal) => self.reject(refusal),
        }
    }

    /// Reason why no job can start now.
    pub(super) fn cannot_begin(&self) -> Option<&'static str> {
        if self.failed {
            Some("the card no longer responds: quit and start again")
        } else if self.card.status().alarm.is_some() {
            Some("clear the alarm first (a)")
        } else if self.exit.ran && self.args.reading.program.as_os_str() == "-" {
            Some("the program came from standard input and cannot run again")
        } else if !lock_model(&self.router.model).sheet_points.is_empty() {
            Some(
                "points on the edge of the sheet are taken and not set: go on with E, or forget them (Esc at the \
                screen)",
            )
        } else if !self.program.is_loaded() {
            Some("no program is loaded: O opens one")
        } else {
            None
        }
    }

    /// Switches every cutter off while no job runs.
    pub(super) fn cutters_off(&mut self) {
        let outputs = self.card.status().outputs;
        let channels = self.machine.cutters.iter().map(|cutter| cutter.fire);
        let lit: Vec<u8> =
            channels.filter(|&channel| outputs.get(usize::from(channel)).is_some_and(|&on| on != 0)).collect();
        self.start = super::NOT_CANCELLABLE;
        for channel in lit {
            self.perform_task(&ManualTask::Output(channel, 0));
        }
    }

    /// Names what a task does, for the operator.
    pub(super) fn show_task(&self, task: &ManualTask) {
        let mut model = lock_model(&self.router.model);
        model.manual_task = Some(match task {
            ManualTask::Frame(frame) if frame.shape == FrameShape::Outline => "tracing the outline, cutters off",
            ManualTask::Frame(_) => "tracing the frame, cutters off",
            ManualTask::SenseTest => "sensing the sheet, cutter off",
            ManualTask::Home(_) => "homing",
            ManualTask::TestPulse => "test pulse: the cutter is ON",
            ManualTask::Mdi(_) => "MDI block",
            ManualTask::Jog { .. } | ManualTask::JogOn { .. } => "jog",
            _ => "manual operation",
        });
        model.manual_result.clear();
        model.is_jog_released = false;
    }

    /// Reports that a task is complete, where nothing else shows it.
    pub(super) fn report_done(&mut self, task: &ManualTask) {
        if let ManualTask::Frame(frame) = task {
            let what = if frame.shape == FrameShape::Outline { "outline" } else { "frame" };
            lock_model(&self.router.model).manual_result = format!("the {what} was traced");
            self.add_message(format!("the {what} was traced"));
        }
    }

    /// Shows how a job has ended, in the parts of its line.
    pub(super) fn show_end(&self, [how, contours, times]: &[String; 3]) {
        let mut model = lock_model(&self.router.model);
        let contours = reported_contours_text(&model, contours);
        model.end(&format!("{how}{contours}{times}"));
    }

    /// Reports that a task was stopped. Of a jog whose key was let go, its distance was reported.
    pub(super) fn report_stopped(&mut self) {
        if !std::mem::take(&mut lock_model(&self.router.model).is_jog_released) {
            self.add_message("stopped");
        }
    }

    /// Shows the wear of the consumables.
    pub(super) fn show_consumables(&self) {
        let Some(path) = TableFiles::of(&self.args.reading).consumables else { return };
        let lines = ConsumableFile::at(&path).read().iter().map(set_text).collect();
        lock_model(&self.router.model).consumables = lines;
    }

    /// Forgets the points on the edge of the sheet.
    pub(super) fn forget_sheet(&self) {
        let mut model = lock_model(&self.router.model);
        model.sheet_points.clear();
        model.changes += 1;
    }
}

/// Position of the tool in X and Y, mm of the machine.
fn tool_mm(machine: &MachineConfig, counts: &[i64]) -> Result<[f64; 2], NumberedError> {
    let at = |letter| machine.axis_of(letter).map(|axis| machine.axes[axis].mm_of(counts[axis]));
    match [at('x'), at('y')] {
        [Some(x), Some(y)] => Ok([x, y]),
        _ => Err(NumberedError::new("E2161", "the machine has no X and Y", "set the zeros of its axes instead")),
    }
}

/// Takes the place of the tool as a point, or that of the pointer while its output is on. Returns what is known of the
/// edge then.
fn take_point(
    model: &Mutex<ScreenModel>,
    machine: &MachineConfig,
    counts: &[i64],
    outputs: &Outputs,
) -> Result<String, NumberedError> {
    let mut point = tool_mm(machine, counts)?;
    let setting_up = &machine.setting_up;
    if setting_up.pointer_output.is_some_and(|output| outputs[usize::from(output)] != 0) {
        for &(axis, mm) in &setting_up.pointer_mm {
            for (place, letter) in point.iter_mut().zip(['x', 'y']) {
                *place += if machine.axis_of(letter) == Some(axis) { mm } else { 0.0 };
            }
        }
    }
    let mut model = lock_model(model);
    model.changes += 1;
    match model.sheet_points[..] {
        [first] => {
            SheetEdge::through(first, point)?;
        }
        _ => model.sheet_points.clear(),
    }
    model.sheet_points.push(point);
    Ok(sheet_text(&model))
}

/// The edge through the points that were taken.
fn taken_edge(model: &Mutex<ScreenModel>) -> Result<SheetEdge, NumberedError> {
    let [first, second] = lock_model(model).sheet_points[..] else {
        let (cause, remedy) = ("the edge of the sheet needs two points", "take both, then align");
        return Err(NumberedError::new("E2163", cause, remedy));
    };
    SheetEdge::through(first, second)
}
