//! The check of a program before the machine moves.
//!
//! Invariant: a program with an error never starts.

use retrace_config::{CutterKind, MachineConfig, NumberedError};
use retrace_controller::{
    CheckFinding, CutFrame, FrameShape, LimitCheck, ProgramAnalysis, ThreadRuns, analyse_program, analyse_unchecked,
    check_program,
};
use retrace_motion::LimitError;
use serde_json::Value;

use crate::command_failure::CommandFailure;
use crate::decoder::Decoder;
use crate::diagnostic_json::{self, DiagnosticPrinter};
use crate::escape;
use crate::program::Program;

/// Maximum number of lines of a program that is checked and planned at once: an error is found after its planning.
const MAX_LINES_AT_ONCE: u64 = 10_000;

/// Result of the check of a program that may run.
#[derive(Debug)]
pub struct Checked<S> {
    /// Number of blocks.
    pub blocks: u64,
    /// Result of the scan.
    pub found: S,
}

impl Program {
    /// Checks the whole program and prints its diagnostics on standard error. Returns `None` for a stream, which is
    /// checked as it runs.
    ///
    /// # Errors
    /// [`CommandFailure::Program`] where it has errors.
    pub fn check<'m>(&self, machine: &'m MachineConfig) -> Result<Option<Checked<LimitCheck<'m, 9>>>, CommandFailure> {
        self.check_by(Self::shown_decoder, &mut Vec::new(), |decoder| {
            let (blocks, findings, mut found) = check_program::<9>(machine, decoder);
            self.set_planned_contours(std::mem::take(&mut found.contours));
            Ok((blocks, findings, found))
        })
    }

    /// Finds the contours of a program that is not checked because it was checked before. A stream has none before it
    /// runs.
    pub fn find_contours(&self, machine: &MachineConfig) {
        if self.prescan().is_some() && !machine.cutting_outputs.is_empty() {
            let (_, _, found) = check_program::<9>(machine, &mut self.decoder());
            self.set_planned_contours(found.contours);
        }
    }

    /// Checks the whole program; see [`Self::check`]. Adds the diagnostics to `diagnostics` for a script, also where it
    /// has errors.
    ///
    /// # Errors
    /// [`CommandFailure::Program`] where it has errors.
    pub fn check_for_script(
        &self,
        machine: &MachineConfig,
        diagnostics: &mut Vec<Value>,
    ) -> Result<(), CommandFailure> {
        let check = |decoder: &mut Decoder| Ok(check_program::<9>(machine, decoder));
        self.check_by(Self::report_decoder, diagnostics, check).map(|_| ())
    }

    /// Checks and plans a short program at once, for its times and extents: its blocks are decoded one time instead of
    /// two. Adds the diagnostics to `diagnostics` for a script. Returns `None`, and prints nothing, where it is long or
    /// has errors: [`Self::check_silently_with_progress`] finds them without planning, and [`Self::analyse`] the rest.
    pub fn analyse_at_once<'m, const A: usize>(
        &self,
        machine: &'m MachineConfig,
        diagnostics: &mut Vec<Value>,
    ) -> Option<Checked<ProgramAnalysis<'m, A>>> {
        self.prescan().filter(|prescan| prescan.lines() <= MAX_LINES_AT_ONCE && prescan.diagnostics().is_empty())?;
        let mut decoder = self.report_decoder();
        let (blocks, findings, found) = analyse_unchecked(machine, &mut decoder)?;
        let all = self.diagnostics_of(&mut decoder, &findings);
        if all.iter().any(|one| one.is_error) {
            return None;
        }
        self.print_diagnostics(&decoder, all, diagnostics).ok()?;
        Some(Checked { blocks, found })
    }

    /// Checks and plans the whole program, for its times and extents. `threads` are those of its check. Adds the
    /// diagnostics to `diagnostics` for a script, also where it has errors.
    ///
    /// # Errors
    /// [`CommandFailure::Program`] where it has errors.
    pub fn analyse<'m, const A: usize>(
        &self,
        machine: &'m MachineConfig,
        threads: ThreadRuns,
        diagnostics: &mut Vec<Value>,
    ) -> Result<Option<Checked<ProgramAnalysis<'m, A>>>, CommandFailure> {
        let why = |error: LimitError| NumberedError::new("E2112", error.to_string(), "correct the machine file");
        let analyse = |decoder: &mut Decoder| Ok(analyse_program(machine, decoder, Some(threads)).map_err(why)?);
        self.check_by(Self::report_decoder, diagnostics, analyse)
    }

    /// Checks the whole program before a run and prints nothing.
    ///
    /// # Errors
    /// The program has errors; the text has its diagnostics.
    pub fn check_silently(&self, machine: &MachineConfig) -> Result<(), String> {
        self.check_silently_by(machine, Self::decoder).map(drop)
    }

    /// Checks the whole program by itself, at a terminal with a progress bar, and prints nothing. Returns its threads.
    ///
    /// # Errors
    /// The program has errors; the text has its diagnostics.
    pub fn check_silently_with_progress(&self, machine: &MachineConfig) -> Result<ThreadRuns, String> {
        self.check_silently_by(machine, Self::report_decoder)
    }

    /// Checks that a job of this program can begin at this contour. Where the contours are not known yet, only the
    /// machine is checked.
    ///
    /// # Errors
    /// `E2151` where it cannot.
    pub fn require_contour(&self, machine: &MachineConfig, contour: Option<u32>) -> Result<(), NumberedError> {
        let Some(number) = contour else { return Ok(()) };
        if let Some(beam) = machine.cutters.iter().find(|cutter| cutter.kind == CutterKind::Beam) {
            let what = format!("--contour {number}: {} is lit in passing, with the first move of a contour", beam.name);
            return Err(NumberedError::new("E2151", what, "`--start-line` with the line of that move"));
        }
        match self.planned_contours() {
            Some(list) if u64::from(number) > list.count => {
                let what = format!("--contour {number}: {} has {} contours", self.name(), list.count);
                Err(NumberedError::new("E2151", what, "`retrace check` lists the contours of a program"))
            }
            _ => Ok(()),
        }
    }

    /// Rectangle around what the program cuts on this machine, at its position.
    ///
    /// # Errors
    /// `E2161` where it has none, or leaves the soft limits, and where the program has errors.
    pub fn frame(&self, machine: &MachineConfig, shape: FrameShape) -> Result<CutFrame, NumberedError> {
        let refuse = |what: String, remedy: &str| NumberedError::new("E2161", what, remedy.to_owned());
        if self.prescan().is_none() {
            let what = "what standard input cuts is not known before it runs: it has no frame".to_owned();
            return Err(refuse(what, "a program in a file"));
        }
        let mut decoder = self.decoder();
        let (_, findings, found) = check_program::<9>(machine, &mut decoder);
        // The side at which it is too large comes before the lines that are.
        let frame = CutFrame::of_contours(machine, &found.contours, shape)?;
        let findings = diagnostic_json::all(self, &mut decoder, &findings);
        match findings.iter().find(|one| one.is_error) {
            Some(error) => Err(refuse(format!("the program has errors: {}", error.text), "correct the program")),
            None => Ok(frame),
        }
    }

    fn check_silently_by(&self, machine: &MachineConfig, decoder: fn(&Self) -> Decoder) -> Result<ThreadRuns, String> {
        if self.prescan().is_none() {
            return Ok(ThreadRuns::default());
        }
        let mut decoder = decoder(self);
        let (_, findings, mut checked) = check_program::<9>(machine, &mut decoder);
        self.set_planned_contours(std::mem::take(&mut checked.contours));
        let found = diagnostic_json::all(self, &mut decoder, &findings);
        let shown: Vec<String> = found.iter().map(|one| one.text.clone()).collect();
        if found.iter().any(|one| one.is_error) { Err(shown.join("\n")) } else { Ok(checked.threads) }
    }

    fn check_by<S>(
        &self,
        decoder: fn(&Self) -> Decoder,
        diagnostics: &mut Vec<Value>,
        scan: impl FnOnce(&mut Decoder) -> Result<(u64, Vec<CheckFinding>, S), CommandFailure>,
    ) -> Result<Option<Checked<S>>, CommandFailure> {
        if self.prescan().is_none() {
            return Ok(None);
        }
        // A stream must not be opened for a check.
        let mut decoder = decoder(self);
        let (blocks, findings, found) = scan(&mut decoder)?;
        let all = self.diagnostics_of(&mut decoder, &findings);
        self.print_diagnostics(&decoder, all, diagnostics)?;
        Ok(Some(Checked { blocks, found }))
    }

    /// The diagnostics of a program that was checked; its progress bar is removed.
    fn diagnostics_of(&self, decoder: &mut Decoder, findings: &[CheckFinding]) -> Vec<DiagnosticPrinter> {
        decoder.progress = None;
        diagnostic_json::all(self, decoder, findings)
    }

    /// Prints the diagnostics, and adds them to `diagnostics`.
    fn print_diagnostics(
        &self,
        decoder: &Decoder,
        all: Vec<DiagnosticPrinter>,
        diagnostics: &mut Vec<Value>,
    ) -> Result<(), CommandFailure> {
        for one in &all {
            eprintln!("{}", escape::lines(&one.text));
        }
        let is_refused = all.iter().any(|one| one.is_error);
        diagnostics.extend(all.into_iter().map(|one| one.json));
        if is_refused {
            return Err(CommandFailure::Program);
        }
        if decoder.length_offset && !self.has_tool_lengths {
            eprintln!("note: no tool table (--tools): every tool has length 0");
        }
        Ok(())
    }
}
