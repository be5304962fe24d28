//! MDI (manual data input): blocks one after the other, each checked as a program is before anything moves.
//!
//! Invariant: what a block changes is in force for the next one, and for the program that follows, only when it has
//! been executed. A block that is rejected has changed nothing.

use std::sync::{Arc, Mutex, PoisonError};

use retrace_config::MachineConfig;
use retrace_gcode::{
    ActiveCodes, Answers, Axis, AxisSet, CanonStep, Diagnostic, Interpreter, ModalSnapshot, Parameters, Pose,
    ProbingFigures, Program, Progress, Setup, Severity, ToolChangeFigures, ToolTable, UserCodes,
};

use crate::block_decoder::{BlockDecoder, DecodedBlock};
use crate::check_finding::CheckFinding;
use crate::job;
use crate::material_figures::{cutting_setup, spindle_use};
use crate::question::MachineResult;
use crate::thread_run_in;

/// Interpreter setup of a machine in millimetres at its current position.
#[must_use]
pub fn interpreter_setup(machine: &MachineConfig) -> Setup {
    let axes: Vec<Axis> = machine.axes.iter().map(|a| Axis::ALL[a.index()]).collect();
    let user_codes = machine.switching.user_codes().fold(UserCodes::default(), UserCodes::with);
    Setup {
        axes: AxisSet::from_axes(&axes),
        user_codes,
        cutting: cutting_setup(machine),
        spindle_use: spindle_use(machine),
        position: position(machine),
        fixed_values: named_figures(machine),
        calls_tool_change: machine.manual_tool_change.is_subprogram(),
        threads: thread_run_in::source(machine),
        rigid_tapping: machine.encoder.is_some_and(|encoder| encoder.is_tapping_rigid),
        ..Setup::default()
    }
}

/// What the shipped subprograms know of the machine, as named parameters.
fn named_figures(machine: &MachineConfig) -> Vec<(String, f64)> {
    let (probe, change) = (&machine.probe, &machine.manual_tool_change);
    let change = ToolChangeFigures {
        position_mm: change.position_mm,
        measured_within_mm: change.measured_within_mm,
        touch_mm: change.touch_mm,
    };
    let probing = ProbingFigures {
        ball_diameter_mm: probe.ball_diameter_mm,
        feed_mm_per_min: probe.feed_mm_per_min,
        slow_feed_mm_per_min: probe.slow_feed_mm_per_min,
        back_off_mm: probe.back_off_mm,
        agree_mm: probe.agree_mm,
        tool_setter_mm: probe.setter_mm,
    };
    [probing.named_values(), change.named_values()].concat()
}

/// Position of the machine, mm and degrees, machine coordinates.
fn position(machine: &MachineConfig) -> Pose {
    let axes = machine.axes.iter().zip(&machine.stands_at_mm);
    axes.fold(Pose::ZERO, |at, (axis, &mm)| at.with(Axis::ALL[axis.index()], mm))
}

/// The modal state of the machine between two blocks or programs.
#[derive(Clone, Debug)]
pub struct ModalContext {
    setup: Setup,
    modal_snapshot: ModalSnapshot,
}

impl ModalContext {
    /// Creates the state in which nothing has been executed; `setup` has tools, parameters, cycles and folders of
    /// subprograms.
    #[must_use]
    pub fn new(setup: Setup) -> Self {
        let modal_snapshot = Interpreter::new(setup.clone()).modal_snapshot();
        Self { setup, modal_snapshot }
    }

    /// The modal state.
    #[must_use]
    pub fn active(&self) -> ActiveCodes {
        self.modal_snapshot.state().into()
    }

    /// Parameters, tools and modal state.
    #[must_use]
    pub fn modal_snapshot(&self) -> &ModalSnapshot {
        &self.modal_snapshot
    }

    /// Setup for reading a program now: offsets and tools are those in force, the modes those of a program's beginning.
    #[must_use]
    pub fn setup_of_program(&self, machine: &MachineConfig) -> Setup {
        Setup { position: position(machine), ..self.setup.clone() }.following(&self.modal_snapshot)
    }

    /// Checks a block, for a machine at the position of `machine`.
    ///
    /// # Errors
    /// Its errors, rendered: its diagnostics, and what this machine cannot execute (E43…). Nothing has changed then.
    pub fn block(&self, machine: &MachineConfig, text: &str) -> Result<MdiBlock, Vec<String>> {
        let begin = |answers| {
            let setup = Setup { position: position(machine), answers, ..self.setup.clone() };
            let setup = setup.continuing(&self.modal_snapshot);
            let program = Program::mdi(text, setup).map_err(|found| rendered(&found, text))?;
            Ok::<_, Vec<String>>(MdiBlock { program, left: None, moves: false })
        };
        let mut looked_at = begin(Answers::Unknown)?;
        let (_, findings, scan) = job::check_program::<9>(machine, &mut looked_at);
        let is_error = |found: &&Diagnostic| found.severity() == Severity::Error;
        let found = looked_at.program.interpreter().diagnostics().iter().filter(is_error);
        let mut wrong: Vec<String> = found.map(|found| looked_at.program.render(found, "MDI")).collect();
        wrong.extend(findings.iter().filter(|finding| finding.is_error()).map(|finding| {
            let CheckFinding { number, cause: what, remedy, .. } = finding;
            format!("error[{number}]: {what}\n  help: {remedy}")
        }));
        if wrong.is_empty() { Ok(MdiBlock { moves: scan.moves > 0, ..begin(Answers::Assumed)? }) } else { Err(wrong) }
    }

    /// Applies the state that an executed block has left.
    pub fn finish_block(&mut self, block: &MdiBlock) {
        self.modal_snapshot = block.program.interpreter().modal_snapshot();
    }

    /// Replaces parameters and tools by those that a program has left; the modes stay.
    pub fn set_tables(&mut self, parameters: Parameters, tools: ToolTable) {
        let carried = self.modal_snapshot.clone().with_tables(parameters, tools);
        self.modal_snapshot = Interpreter::new(self.setup.clone().continuing(&carried)).modal_snapshot();
    }

    /// Applies the state that an executed program has left.
    pub fn apply_modal_snapshot(&mut self, left: ModalSnapshot) {
        self.modal_snapshot = left;
    }
}

/// Errors with their source line.
fn rendered(found: &[Diagnostic], text: &str) -> Vec<String> {
    let errors = found.iter().filter(|found| found.severity() == Severity::Error);
    errors.map(|found| found.render("MDI", if found.file == 0 { text } else { "" })).collect()
}

/// An MDI block, checked and ready to run as a program.
#[derive(Debug)]
pub struct MdiBlock {
    program: Program<&'static [u8]>,
    left: Option<MdiResult>,
    moves: bool,
}

/// Where a block that was decoded to its end stores its resulting state.
pub(crate) type MdiResult = Arc<Mutex<Option<ModalSnapshot>>>;

impl MdiBlock {
    /// Whether it moves the machine.
    #[must_use]
    pub fn moves(&self) -> bool {
        self.moves
    }

    /// Also returns where the block stores its resulting state, for a caller that has it executed.
    pub(crate) fn with_result(self) -> (Self, MdiResult) {
        let left = MdiResult::default();
        (Self { left: Some(Arc::clone(&left)), ..self }, left)
    }
}

impl BlockDecoder for MdiBlock {
    fn active(&self) -> Option<ActiveCodes> {
        Some(self.program.interpreter().state().into())
    }

    fn resolve(&mut self, result: &MachineResult) {
        let interpreter = self.program.interpreter_mut();
        match result {
            MachineResult::Probe(probed) => interpreter.resolve_probe(&probed.touch, &probed.rest, probed.touched),
            MachineResult::Input(value) => interpreter.resolve_input(*value),
        }
    }

    fn next_block(&mut self, steps: &mut Vec<CanonStep>) -> DecodedBlock {
        match self.program.advance(steps) {
            Progress::Line => DecodedBlock::Block,
            Progress::End => {
                if let Some(left) = &self.left {
                    let carried = self.program.interpreter().modal_snapshot();
                    *left.lock().unwrap_or_else(PoisonError::into_inner) = Some(carried);
                }
                DecodedBlock::End
            }
            Progress::BlockError => {
                let found = self.program.interpreter().diagnostics().iter().rev();
                let error = found.clone().find(|found| found.severity() == Severity::Error);
                DecodedBlock::BlockError(error.map_or_else(String::new, |error| self.program.render(error, "MDI")))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use retrace_gcode::Canon;

    /// Executes a block, and returns the machine at its new position, mm.
    fn done(context: &mut ModalContext, machine: &MachineConfig, text: &str) -> MachineConfig {
        let mut block = context.block(machine, text).expect(text);
        let mut scan = crate::limit_check::LimitCheck::<9>::new(machine);
        assert_eq!(job::feed_program(machine, &mut block, &mut scan).1, [], "{text}");
        context.finish_block(&block);
        let counts = machine.axes.iter().zip(context.modal_snapshot.state().machine_position().0);
        let counts: Vec<i64> = counts.map(|(axis, mm)| axis.pulses_of(mm)).collect();
        machine.clone().standing_at(&counts)
    }

    #[test]
    fn single_blocks_build_on_each_other_and_the_program_on_them() {
        let mut machine = MachineConfig::built_in().expect("valid").standing_at(&[30_000, 20_000, -5_000]);
        let mut context = ModalContext::new(interpreter_setup(&machine));
        for text in ["G10 L20 P1 X0 Y0", "G92 Z3", "T1 M6", "G91", "G0 X10", "X-4"] {
            machine = done(&mut context, &machine, text);
        }
        assert_eq!(machine.stands_at_mm, [36.0, 20.0, -5.0]);
        assert!(context.active().to_string().starts_with("G0 G17 G21 G40 G49 G54 G64 G80 G91"), "{}", context.active());
        let setup = context.setup_of_program(&machine);
        let program = Interpreter::new(setup);
        let state = program.state();
        assert_eq!(state.position, Pose::xyz(6.0, 0.0, 3.0));
        assert_eq!((state.current_tool, state.distance), (1, retrace_gcode::DistanceMode::Absolute));
    }

    /// A spindle that an earlier block has started is not forgotten by the next one.
    #[test]
    fn a_spindle_that_turns_is_known_to_the_next_block() {
        let probe = "[[card.input]]\nnumber = 0\nuse = \"probe\"\n[spindle]\nfeed_per_turn = \"commanded\"\n";
        let machine = MachineConfig::parse(probe, "m").expect("valid");
        let mut context = ModalContext::new(interpreter_setup(&machine));
        let machine = done(&mut context, &machine, "G95 F1 S60 M3");
        context.block(&machine, "G1 X1").expect("the spindle turns");
        let machine = done(&mut context, &machine, "G94 F60");
        let refused = context.block(&machine, "G38.2 Z-1").expect_err("the spindle turns");
        assert!(refused.iter().any(|text| text.contains("E4312")), "{refused:?}");
        let machine = done(&mut context, &machine, "M5");
        context.block(&machine, "G38.2 Z-1").expect("the spindle is off");
        let machine = done(&mut context, &machine, "G95 F1");
        let refused = context.block(&machine, "G1 X1").expect_err("the spindle is off");
        assert!(refused.iter().any(|text| text.contains("E4315")), "{refused:?}");
    }

    /// G96 of an earlier block is in force, and its S is repeated for the executor, which begins anew.
    #[test]
    fn a_surface_speed_is_known_to_the_next_block() {
        let machine = MachineConfig::parse("[spindle]\nmax_rpm = 2000\n", "m").expect("valid");
        let mut context = ModalContext::new(interpreter_setup(&machine));
        let spindle = |context: &ModalContext, machine: &MachineConfig| {
            let (mut block, mut steps) = (context.block(machine, "G1 F100 X20").expect("a move"), Vec::new());
            while block.next_block(&mut steps) == DecodedBlock::Block {}
            let canons = steps.into_iter().map(|step| step.canon);
            canons.filter(|canon| matches!(canon, Canon::SetSpindleMode(_) | Canon::SetSpindleSpeed(_))).collect()
        };
        let before: Vec<Canon> = spindle(&context, &machine);
        let machine = done(&mut context, &machine, "G96 D1500 S100 M3");
        let under: Vec<Canon> = spindle(&context, &machine);
        let machine = done(&mut context, &machine, "G97 S300");
        let behind: Vec<Canon> = spindle(&context, &machine);
        let repeated = vec![Canon::SetSpindleMode(1500.0), Canon::SetSpindleSpeed(100.0)];
        assert_eq!((before, under, behind), (vec![], repeated, vec![]));
    }

    #[test]
    fn what_the_machine_cannot_do_is_refused_before_and_nothing_has_changed() {
        let machine = MachineConfig::built_in().expect("valid");
        let context = ModalContext::new(interpreter_setup(&machine));
        let refused = |text: &str| context.block(&machine, text).expect_err(text).join("\n");
        assert!(refused("G0 X2001").contains("E4304"), "{}", refused("G0 X2001"));
        assert!(refused("G1 X1").contains("E1508") && refused("O1 while [1]").contains("E1012"));
        assert!(refused("M19 R0").contains("E4302") && refused("M66 E1").contains("E4332"));
        assert_eq!(context.active(), ModalContext::new(interpreter_setup(&machine)).active());
    }
}
