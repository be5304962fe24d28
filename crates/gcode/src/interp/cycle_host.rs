//! Cycles: the interpreter as the host of a running cycle, MCALL, and the modes that a cycle restores.
//!
//! Invariant: a cycle's blocks are executed as the program's own blocks are. The modes that `SAVE` names are restored
//! at the cycle's end (cycles, section 1.3). After an alarm nothing has moved, unless a block of the cycle itself was
//! wrong.

use super::check;
use super::contours::{Contours, NoContours};
use super::interpreter_core::{Core, Emitter};
use crate::block::Words;
use crate::canon::{Canon, CanonStep};
use crate::canon_modes::{FeedMode, LengthUnit, PathControl, Plane};
use crate::compensation::Side;
use crate::cycle_call::{CycleArgument, CycleCall};
use crate::diag::{BlockError, BlockResult, Span, fault};
use crate::drilling_cycle::DrillingSeries;
use crate::error_codes::ErrorCode;
use crate::modal::ModalState;
use crate::modal_groups::{ArcCentres, DistanceMode, MotionMode, SpindleRotation};
use crate::path_cache::PlannedContour;
use crate::pose::Axis;
use retrace_cycles::{
    Argument, Cycle, CycleBlock, CycleLibrary, CycleRunError, CycleStoppedError, Host, Message, Query, StockCall,
    StockMove, StockPathError, Vm,
};
use std::sync::Arc;

/// Maximum number of parameters of a cycle.
const MAX_ARGUMENTS: usize = 64;

/// Maximum number of canonical functions of one call, so that one line cannot exhaust the memory.
const MAX_FUNCTIONS: usize = 500_000;
/// Maximum number of steps and blocks of the modal cycle over all holes of a pattern.
const MAX_MODAL_COST: u64 = 100_000_000;

/// A cycle that is executed after every block with motion (MCALL).
#[derive(Clone, Debug)]
pub(super) struct ModalCycle {
    call: CycleCall,
    /// Arguments, calculated once.
    values: Vec<f64>,
    /// Depth of calls at which it was given: it ends with that subprogram.
    level: u32,
}

/// State of cycles in addition to the modal state; boxed, because few programs call cycles.
#[derive(Debug, Default)]
pub(super) struct Cycles {
    machine: Vm,
    /// Virtual machine for the modal cycle at the blocks of another one.
    inner: Vm,
    modal: Option<ModalCycle>,
    values: Vec<f64>,
    saved: Vec<Option<SavedModes>>,
    words: Words,
}

impl Clone for Cycles {
    /// Copies the modal cycle in force, not a running one.
    fn clone(&self) -> Cycles {
        Cycles { modal: self.modal.clone(), ..Cycles::default() }
    }
}

/// Modes that `SAVE` restores.
#[derive(Clone, Copy, Debug)]
struct SavedModes {
    motion: Option<MotionMode>,
    plane: Plane,
    distance: DistanceMode,
    feed_mode: FeedMode,
    feed_rate: f64,
    spindle_speed: f64,
    constant_surface_speed: bool,
    max_spindle_speed: f64,
    path_control: PathControl,
    naivecam_tolerance: f64,
    lathe_diameter: bool,
    /// Retained words of a drilling cycle G81 … G89 that was in force.
    series: Option<DrillingSeries>,
    is_compensated: bool,
}

impl SavedModes {
    fn save(state: &ModalState) -> SavedModes {
        SavedModes {
            motion: state.motion,
            plane: state.plane,
            distance: state.distance,
            feed_mode: state.feed_mode,
            feed_rate: state.feed_rate,
            spindle_speed: state.spindle_speed,
            constant_surface_speed: state.constant_surface_speed,
            max_spindle_speed: state.max_spindle_speed,
            path_control: state.path_control,
            naivecam_tolerance: state.naivecam_tolerance,
            lathe_diameter: state.lathe_diameter,
            series: state.series,
            is_compensated: state.compensation.is_some(),
        }
    }

    /// Restores the modes and emits the canonical functions for them.
    fn restore(&self, state: &mut ModalState, emit: &mut Emitter<'_>) {
        (state.motion, state.series) = (self.motion, self.series);
        if state.plane != self.plane {
            state.plane = self.plane;
            emit.call(Canon::SelectPlane(self.plane));
        }
        state.distance = self.distance;
        state.lathe_diameter = self.lathe_diameter;
        if state.feed_mode != self.feed_mode {
            state.feed_mode = self.feed_mode;
            emit.call(Canon::SetFeedMode(self.feed_mode));
        }
        if state.feed_rate != self.feed_rate {
            state.feed_rate = self.feed_rate;
            emit.call(Canon::SetFeedRate(self.feed_rate));
        }
        let mode = (self.constant_surface_speed, self.max_spindle_speed);
        let differs = (state.constant_surface_speed, state.max_spindle_speed) != mode;
        if differs {
            (state.constant_surface_speed, state.max_spindle_speed) = mode;
            emit.call(Canon::SetSpindleMode(self.max_spindle_speed));
        }
        // In another mode the same number is another speed.
        if differs || state.spindle_speed != self.spindle_speed {
            state.spindle_speed = self.spindle_speed;
            emit.call(Canon::SetSpindleSpeed(self.spindle_speed));
        }
        if state.path_control != self.path_control {
            state.path_control = self.path_control;
            emit.call(Canon::SetMotionControlMode(self.path_control));
        }
        if state.naivecam_tolerance != self.naivecam_tolerance {
            state.naivecam_tolerance = self.naivecam_tolerance;
            emit.call(Canon::SetNaivecamTolerance(self.naivecam_tolerance));
        }
    }
}

impl super::Interpreter {
    /// Replaces the cycles that a program may call. Lines that have been compiled already call the new cycles at the
    /// same indices.
    pub fn set_cycles(&mut self, cycles: Option<Arc<CycleLibrary>>) {
        self.reader.cycles = cycles;
    }

    /// Runs the cycle of the line loaded last.
    pub(crate) fn call_cycle(
        &mut self,
        call: &CycleCall,
        contours: &dyn Contours,
        steps: &mut Vec<CanonStep>,
    ) -> BlockResult<()> {
        self.control_value()?;
        if self.is_cycle_unknown(self.arguments()) {
            self.move_unknown(steps);
            return Ok(());
        }
        let mut cycles = self.cycles.take().unwrap_or_default();
        let mut values = std::mem::take(&mut cycles.values);
        values.clear();
        values.extend(self.arguments());
        let outcome = self.run_cycle(&mut cycles, call, &values, contours, steps);
        cycles.values = values;
        self.cycles = Some(cycles);
        outcome
    }

    /// Executes MCALL with a cycle, which is then run after every block with motion.
    pub(crate) fn begin_modal(&mut self, call: &CycleCall) -> BlockResult<()> {
        self.control_value()?;
        let is_pattern = |library: &CycleLibrary| library.get(call.id).is_some_and(Cycle::is_pattern);
        if self.reader.cycles.as_deref().is_some_and(is_pattern) {
            return fault(ErrorCode::ModalInCycle, call.at, format!("{} calls the modal cycle itself", call.name));
        }
        let values = self.arguments().collect();
        let modal = ModalCycle { call: call.clone(), values, level: self.core.state.call_level };
        self.cycles.get_or_insert_default().modal = Some(modal);
        Ok(())
    }

    /// Executes MCALL alone.
    pub(crate) fn end_modal(&mut self) {
        if let Some(cycles) = &mut self.cycles {
            cycles.modal = None;
        }
    }

    /// Returns the cycle in force: of MCALL at this depth of calls, or a drilling cycle.
    pub(crate) fn cycle(&self) -> Option<&str> {
        let level = self.core.state.call_level;
        let modal = self.cycles.as_ref().and_then(|cycles| cycles.modal.as_ref());
        match (modal.filter(|modal| modal.level == level), self.core.state.motion) {
            (Some(modal), _) => Some(&modal.call.name),
            (None, Some(MotionMode::Cycle(cycle))) => Some(cycle.name()),
            _ => None,
        }
    }

    /// Whether a modal cycle is in force at this depth of calls. The modal cycle of a subprogram that has ended is
    /// removed.
    #[inline]
    pub(super) fn has_modal(&mut self) -> bool {
        let Some(cycles) = &mut self.cycles else { return false };
        let level = self.core.state.call_level;
        if cycles.modal.as_ref().is_some_and(|modal| modal.level > level) {
            cycles.modal = None;
        }
        cycles.modal.as_ref().is_some_and(|modal| modal.level == level)
    }

    /// Runs the modal cycle after a block with motion.
    pub(super) fn modal_cycle(&mut self, steps: &mut Vec<CanonStep>) -> BlockResult<()> {
        let Some(mut cycles) = self.cycles.take() else { return Ok(()) };
        let modal = cycles.modal.take();
        let outcome = match &modal {
            Some(modal) => self.run_cycle(&mut cycles, &modal.call, &modal.values, &NoContours, steps),
            None => Ok(()),
        };
        cycles.modal = modal;
        self.cycles = Some(cycles);
        outcome
    }

    fn run_cycle(
        &mut self,
        cycles: &mut Cycles,
        call: &CycleCall,
        values: &[f64],
        contours: &dyn Contours,
        steps: &mut Vec<CanonStep>,
    ) -> BlockResult<()> {
        let Some(library) = self.reader.cycles.clone() else { return Ok(()) };
        let Cycles { machine, inner, modal, saved, words, .. } = cycles;
        saved.clear();
        let level = self.core.state.call_level;
        let modal = modal.as_ref().filter(|modal| modal.level == level);
        let mut waiting = std::mem::take(&mut self.core.state.waiting);
        let centres = self.core.state.arc_centres;
        let mut caller = Caller {
            core: &mut self.core,
            library: &library,
            contours,
            modal: modal.map(|modal| (modal, inner)),
            saved,
            words,
            path: None,
            centres,
            max_steps: steps.len().saturating_add(MAX_FUNCTIONS),
            modal_cost: 0,
            emit: Emitter { line: self.step_line, number: None, steps, waiting: &mut waiting, warning: None },
            at: call.at,
            fault: None,
            warnings: Vec::new(),
        };
        let outcome = caller.run(machine, call, values);
        let warnings = std::mem::take(&mut caller.warnings);
        self.core.state.waiting = waiting;
        for message in warnings {
            self.report(BlockError::new(ErrorCode::CycleWarning, call.at, message));
        }
        outcome
    }
}

/// Converts the arguments of a call to those of the virtual machine.
fn arguments<'a>(call: &'a CycleCall, values: &[f64]) -> [Argument<'a>; MAX_ARGUMENTS] {
    let mut arguments = [Argument::Missing; MAX_ARGUMENTS];
    let mut values = values.iter();
    for (place, given) in arguments.iter_mut().zip(call.arguments.iter()) {
        *place = match given {
            CycleArgument::Missing => Argument::Missing,
            CycleArgument::Text(text) => Argument::Text(text),
            CycleArgument::Number => Argument::Number(values.next().copied().unwrap_or_default()),
        };
    }
    arguments
}

/// The interpreter while a cycle runs.
struct Caller<'a> {
    core: &'a mut Core,
    library: &'a CycleLibrary,
    contours: &'a dyn Contours,
    modal: Option<(&'a ModalCycle, &'a mut Vm)>,
    saved: &'a mut Vec<Option<SavedModes>>,
    words: &'a mut Words,
    path: Option<Arc<[StockMove]>>,
    /// Meaning of centre words in the program, and so in its contours.
    centres: ArcCentres,
    /// Maximum length of the list of canonical functions.
    max_steps: usize,
    /// Steps and blocks that the modal cycle has used so far.
    modal_cost: u64,
    emit: Emitter<'a>,
    at: Span,
    fault: Option<Box<BlockError>>,
    warnings: Vec<String>,
}

impl Caller<'_> {
    fn run(&mut self, machine: &mut Vm, call: &CycleCall, values: &[f64]) -> BlockResult<()> {
        let arguments = arguments(call, values);
        let given = arguments.get(..call.arguments.len()).unwrap_or_default();
        let library = self.library;
        // The centres in a cycle are relative to the start of their arc, whatever the program has selected.
        let centres = std::mem::replace(&mut self.core.state.arc_centres, ArcCentres::Incremental);
        let outcome = machine.run(library, call.id, given, self);
        self.core.state.arc_centres = centres;
        match outcome {
            Ok(()) => self.check_size(),
            Err(CycleRunError::Alarm(alarm)) => {
                fault(ErrorCode::CycleAlarm, self.at, format!("{alarm}; {}", alarm.help()))
            }
            Err(CycleRunError::Stopped) => match self.fault.take() {
                Some(fault) => Err(fault),
                None => fault(ErrorCode::CycleAlarm, self.at, ErrorCode::CycleAlarm.title()),
            },
        }
    }

    fn execute_block(&mut self, block: &CycleBlock) -> BlockResult<()> {
        let words = &mut *self.words;
        words.clear();
        for tenths in block.g() {
            words.add_g(f64::from(*tenths) / 10.0, self.at)?;
        }
        for code in block.m() {
            words.add_m(f64::from(*code), self.at)?;
        }
        for word in block.words() {
            let letter = word.letter.to_ascii_lowercase();
            words.claim(letter, self.at)?;
            words.fill(letter, word.value, self.at)?;
        }
        if words.has(b'x') && self.core.uses_diameters(words) {
            words.halve_x();
        }
        let motion = check::determine_motion(words, &self.core.state)?;
        check::words_have_uses(words, motion)?;
        self.core.check_spindle(words)?;
        self.core.execute(words, motion, &mut self.emit)?;
        if block.triggers
            && let Some((modal, machine)) = self.modal.take()
        {
            let outcome = self.run(machine, &modal.call, &modal.values);
            self.modal_cost += machine.cost();
            self.modal = Some((modal, machine));
            outcome?;
        }
        self.check_size()
    }

    /// A cycle has left compensation on: executes G40 to restore the state before it.
    fn end_compensation(&mut self) -> Result<(), CycleStoppedError> {
        self.core.set_compensation(400, &Words::default(), &mut self.emit).map_err(|fault| {
            self.fault = Some(fault);
            CycleStoppedError
        })
    }

    fn check_size(&self) -> BlockResult<()> {
        if self.emit.steps.len() > self.max_steps || self.modal_cost > MAX_MODAL_COST {
            let message = format!("one call emits more than {MAX_FUNCTIONS} functions, or its holes have no end");
            return fault(ErrorCode::CycleAlarm, self.at, message);
        }
        Ok(())
    }
}

impl Host for Caller<'_> {
    fn ask(&self, what: Query) -> f64 {
        let state = &self.core.state;
        let tool = || self.core.tools.get(state.current_tool).unwrap_or_default();
        let truth = |condition: bool| f64::from(u8::from(condition));
        match what {
            Query::Position(letter) => match Axis::of_letter(letter.to_ascii_lowercase()) {
                Some(Axis::X) if state.lathe_diameter => 2.0 * state.position[Axis::X],
                Some(axis) => state.position[axis],
                None => 0.0,
            },
            Query::Feed => state.feed_rate,
            Query::SpindleSpeed => state.spindle_speed,
            Query::SpindleDirection => match state.spindle {
                SpindleRotation::Clockwise => 3.0,
                SpindleRotation::Counterclockwise => 4.0,
                SpindleRotation::Stopped => 5.0,
            },
            // RS274/NGC has no D number: the offset of a tool is its own line of the tool table, and G43 is not
            // required for a radius. A program that selects no tool works with the tool that is clamped, so none is
            // refused. By this project's decision, 61000 is never raised, because retrace drills whatever a program
            // drills.
            Query::OffsetNumber => state.current_tool.max(1).into(),
            Query::ToolRadius => self.core.to_program_unit(Axis::X, tool().diameter) / 2.0,
            Query::EdgePosition => tool().orientation,
            Query::ClearanceAngle => tool().back_angle,
            Query::Plane => state.plane.g_code(),
            Query::Compensation => match state.compensation.map(|compensation| compensation.side) {
                None => 40.0,
                Some(Side::Left) => 41.0,
                Some(Side::Right) => 42.0,
            },
            Query::Distance => match state.distance {
                DistanceMode::Absolute => 90.0,
                DistanceMode::Incremental => 91.0,
            },
            Query::FeedMode => match state.feed_mode {
                FeedMode::InverseTime => 93.0,
                FeedMode::UnitsPerMinute => 94.0,
                FeedMode::UnitsPerRevolution => 95.0,
            },
            Query::SpindleMode if state.constant_surface_speed => 96.0,
            Query::SpindleMode => 97.0,
            Query::Motion => match state.motion {
                Some(MotionMode::Feed) => 1.0,
                Some(MotionMode::ArcClockwise) => 2.0,
                Some(MotionMode::ArcCounterclockwise) => 3.0,
                Some(MotionMode::SpindleFeed) => 33.0,
                _ => 0.0,
            },
            Query::Diameter => truth(state.lathe_diameter),
            Query::Inch => truth(state.units == LengthUnit::Inch),
            Query::ModalCycle => truth(self.modal.is_some()),
        }
    }

    fn block(&mut self, block: &CycleBlock) -> Result<(), CycleStoppedError> {
        self.execute_block(block).map_err(|mut fault| {
            let name = self.library.get(block.cycle).map_or("", Cycle::name);
            if fault.code != ErrorCode::CycleAlarm {
                fault.message = format!("{name}, line {}: {}", block.line, fault.message);
            }
            fault.span = self.at;
            self.fault = Some(fault);
            CycleStoppedError
        })
    }

    fn message(&mut self, message: &Message<'_>) {
        match message.warning {
            Some(_) if self.warnings.len() >= super::MAX_ERRORS => {}
            Some(number) => self.warnings.push(format!("{number}: {}", message.text)),
            // A loop of messages alone ends with the step limit of the virtual machine.
            None if self.emit.steps.len() > self.max_steps => {}
            None => self.emit.call(Canon::Message(message.text.into())),
        }
    }

    fn enter(&mut self, cycle: &Cycle) {
        self.saved.push(cycle.saves().then(|| SavedModes::save(&self.core.state)));
    }

    fn leave(&mut self, _: &Cycle) -> Result<(), CycleStoppedError> {
        if let Some(Some(saved)) = self.saved.pop() {
            if self.core.state.compensation.is_some() && !saved.is_compensated {
                self.end_compensation()?;
            }
            saved.restore(&mut self.core.state, &mut self.emit);
        }
        Ok(())
    }

    fn stock(&mut self, call: &StockCall<'_>) -> Result<u32, StockPathError> {
        let centres = std::mem::replace(&mut self.core.state.arc_centres, self.centres);
        let planned = self.contours.stock(self.core, call);
        self.core.state.arc_centres = centres;
        let PlannedContour { moves: path, warnings } = planned?;
        self.warnings.extend(warnings.iter().cloned());
        let moves = path.len() as u32;
        self.path = Some(path);
        Ok(moves)
    }

    fn stock_move(&self, index: u32) -> Option<StockMove> {
        self.path.as_ref()?.get(index as usize).copied()
    }
}
