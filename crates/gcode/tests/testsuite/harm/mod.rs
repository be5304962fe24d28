//! Properties that hold for any input: one function for each entry point, shared by the tests and by the fuzz targets
//! of cargo-fuzz.
//!
//! Invariant: each function returns or panics with what is wrong. The work is bounded by [`MAX_LINES`] and
//! [`MAX_STEPS`], so a function that does not return has found a hang.

use retrace_gcode::cycles::CycleLibrary;
use retrace_gcode::{
    AxisSet, Canon, CanonStep, Diagnostic, Ini, Parameters, Prescan, Program, Progress, Setup, SubFile, SubFiles, Text,
    ToolTable,
};
use std::io::BufRead;
use std::sync::{Arc, OnceLock};

/// Maximum number of executed lines of a program.
const MAX_LINES: usize = 2_000;
/// Maximum number of checked canonical functions.
const MAX_STEPS: usize = 50_000;
/// Maximum number of canonical functions of one line: twice that of a cycle, because one may run at every hole of
/// another.
const MAX_OF_A_LINE: usize = 1_100_000;

/// Returns the cycles shipped with retrace.
fn shipped() -> Arc<CycleLibrary> {
    static LIBRARY: OnceLock<Arc<CycleLibrary>> = OnceLock::new();
    LIBRARY.get_or_init(|| Arc::new(CycleLibrary::shipped())).clone()
}

/// Tools for turning, nose up and nose down, and for milling; tool 9 has no radius.
const TOOLS: &str = "T1 P1 Z0.5 D4\nT2 P2 D0.8 Q2\nT3 P3 D1.6 Q3 I30 J20\nT4 P4 D-1\nT9 P9\n";

/// A folder in which every file whose name begins with F is the program itself, and one cannot be read.
#[derive(Debug)]
struct Mirrors(Text);

impl SubFiles for Mirrors {
    fn find(&self, name: &str) -> Option<SubFile> {
        match name.bytes().next() {
            Some(b'f') => Some(SubFile { name: format!("{name}.ngc"), text: Ok(self.0.clone()) }),
            Some(b'g') => Some(SubFile { name: format!("{name}.ngc"), text: Err("no permission".to_owned()) }),
            _ => None,
        }
    }
}

fn setup(text: &Text, library: Arc<CycleLibrary>) -> Setup {
    Setup {
        axes: AxisSet::ALL,
        tools: ToolTable::read(TOOLS).expect("a tool table"),
        cycles: Some(library),
        files: Some(Arc::new(Mirrors(text.clone()))),
        ..Setup::default()
    }
}

/// Runs a program from a file, and streamed.
pub(crate) fn program(bytes: &[u8]) {
    program_with(bytes, shipped());
}

fn program_with(bytes: &[u8], library: Arc<CycleLibrary>) {
    let text = Text::from(bytes);
    let setup = setup(&text, library);
    let prescan = Arc::new(Prescan::scan("program.ngc", text, &setup));
    let _ = (prescan.branches(), prescan.lines());
    let mut from_file = Program::<&[u8]>::prescanned(Arc::clone(&prescan), setup.clone());
    let is_through = run(&mut from_file);
    if is_through {
        from_file.check_after_end();
    }
    for diagnostic in from_file.interpreter().diagnostics() {
        fits(diagnostic, &prescan.line_text(diagnostic.file, diagnostic.line));
    }
    let mut arriving = Program::new(bytes, Setup { block_delete: true, ..setup });
    run(&mut arriving);
    let lines: Vec<&[u8]> = bytes.split(|byte| *byte == b'\n').collect();
    for diagnostic in arriving.interpreter().diagnostics() {
        let number = diagnostic.line as usize;
        fits(diagnostic, number.checked_sub(1).and_then(|index| lines.get(index)).copied().unwrap_or_default());
    }
}

/// Executes a program within the limits. Returns whether it ended.
fn run<R: BufRead>(program: &mut Program<R>) -> bool {
    let mut steps: Vec<CanonStep> = Vec::new();
    let mut seen = 0;
    for _ in 0..MAX_LINES {
        let progress = program.advance(&mut steps);
        assert!(steps.len() <= MAX_OF_A_LINE, "{} functions of one line", steps.len());
        seen += steps.len();
        for step in &steps {
            assert!(is_finite(&step.canon), "{step:?}");
        }
        // Frees the memory of a long line, because a program has many.
        if steps.capacity() > 10_000 {
            steps = Vec::new();
        }
        steps.clear();
        match progress {
            Progress::End => return true,
            _ if seen > MAX_STEPS => return false,
            _ => {}
        }
    }
    false
}

fn is_finite(canon: &Canon) -> bool {
    match canon {
        Canon::StraightTraverse(end) | Canon::StraightFeed(end) => end.0.iter().all(|value| value.is_finite()),
        Canon::ArcFeed(arc) => {
            arc.end.0.iter().all(|value| value.is_finite()) && (arc.first_centre + arc.second_centre).is_finite()
        }
        Canon::Comment(_) | Canon::Note(_) | Canon::Message(_) | Canon::Print(_) | Canon::Log(_) => true,
        Canon::LogOpen { .. } => true,
        other => {
            let shown = format!("{other:?}");
            !shown.contains("NaN") && !shown.contains("inf")
        }
    }
}

/// Checks that a diagnostic is within its line and can be rendered.
fn fits(diagnostic: &Diagnostic, line: &[u8]) {
    let (start, end) = (diagnostic.span.start as usize, diagnostic.span.end as usize);
    assert!(start <= end && start <= line.len(), "{diagnostic:?} in {:?}", String::from_utf8_lossy(line));
    let shown = diagnostic.render("program.ngc", &String::from_utf8_lossy(line));
    assert!(shown.contains(diagnostic.number()), "{shown}");
}

/// Reads a tool table, a parameter file and an INI file.
pub(crate) fn tables(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let lines: Vec<&str> = text.lines().collect();
    let place = |found: Vec<Diagnostic>| {
        for diagnostic in found {
            let line = (diagnostic.line as usize).checked_sub(1).and_then(|index| lines.get(index));
            fits(&diagnostic, line.copied().unwrap_or_default().as_bytes());
        }
    };
    let mut setup = setup(&Text::from(&b""[..]), shipped());
    match ToolTable::read(&text) {
        Ok(tools) => setup.tools = tools,
        Err(found) => place(found),
    }
    match Parameters::read(&text) {
        Ok(parameters) => {
            let written = parameters.write();
            assert!(Parameters::read(&written).is_ok(), "what is written can be read:\n{written}");
            setup.parameters = parameters;
        }
        Err(found) => place(found),
    }
    match Ini::read(&text) {
        Ok(ini) => setup.fixed_values = ini.values,
        Err(found) => place(found),
    }
    let using = "T1 M6 G43\nG0 X1 Y1 Z1\nT2 M6 G43 H1\nG54 G0 X0\nG55 G0 X1\nG28\nG41 D2\nF9 G1 X90\nX99 Y9\nG40\nG1 \
        X0 Y0\n\
                 CYCLE81(10,0,2,-20)\nG10 L1 P1 R1\nM2\n";
    let mut program = Program::new(using.as_bytes(), setup);
    run(&mut program);
}

/// Compiles the source of a cycle, which a program then calls in every way.
pub(crate) fn cycle(bytes: &[u8]) {
    let source = String::from_utf8_lossy(bytes);
    let sources = [("FUZZ", &*source), ("CYCLE81", retrace_gcode::cycles::shipped_source("CYCLE81").unwrap_or(""))];
    let library = Arc::new(CycleLibrary::of_sources(&sources));
    for finding in library.findings() {
        assert!(!finding.diagnostic.to_string().is_empty());
    }
    let calls =
        b"T1 M6 G43\nS500 M3 F100\nFUZZ(1)\nFUZZ(1,-2.5,3)\nFUZZ(\"A\",2,1)\nFUZZ()\nMCALL CYCLE81(10,0,2,-20)\n\
                  FUZZ(5,6,7,8)\nMCALL FUZZ(1,2)\nG0 X1 Y1\nMCALL\nG18 G91 FUZZ(-1)\nM2\n";
    program_with(calls, library);
}
