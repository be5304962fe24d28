//! Random programs, call by call against LinuxCNC's `rs274 -g`.
//!
//! The number of programs is 120, or what RETRACE_DIFFERENTIAL says; a run of many takes the environment variable
//! RETRACE_DIFFERENTIAL_FIRST as its first seed.

mod common;
mod outline;
mod writer;

use common::{canon_text, canon_text_with};
use outline::{Outline, TOOLS};
use retrace_gcode::{Setup, ToolTable};
use std::path::Path;
use std::process::{Command, Stdio};
use writer::Writer;

/// What `rs274 -g` prints for a program, what it complains of, and whether it refused it; `None` where it is not installed. It takes
/// the tool table of the folder, if there is one.
fn rs274(folder: &Path, program: &str) -> Option<(String, String, bool)> {
    let file = folder.join("program.ngc");
    std::fs::write(&file, program).expect("a program file");
    // It keeps its tool data in the home folder, where another one running would find them.
    let tools = folder.join("tools.tbl");
    let output = Command::new("rs274")
        .arg("-g")
        .args(tools.exists().then_some("-t"))
        .args(tools.exists().then_some(&tools))
        .arg(&file)
        .env("HOME", folder)
        .current_dir(folder)
        .stdin(Stdio::null())
        .output()
        .ok()?;
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    Some((text(&output.stdout), text(&output.stderr), !output.status.success()))
}

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// The lines of rs274's standard output that are canonical functions: its error messages go to the same place.
fn functions(text: &str) -> Vec<&str> {
    text.lines().filter(|line| line.len() > 13 && line.as_bytes()[6] == b'N' && line.ends_with(')')).collect()
}

/// Compares what both make of the programs of as many seeds as the environment asks for.
fn compare(
    name: &str,
    tools: Option<&str>,
    program_of: impl Fn(u64) -> String,
    ours_of: impl Fn(&str) -> (String, bool),
) {
    let folder = std::env::temp_dir().join(format!("retrace-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    if let Some(tools) = tools {
        std::fs::write(folder.join("tools.tbl"), tools).expect("a tool table");
    }
    let first = number("RETRACE_DIFFERENTIAL_FIRST", 0);
    let (mut differing, mut refused) = (0, 0);
    let count = number("RETRACE_DIFFERENTIAL", 120);
    for seed in first..first + count {
        let program = program_of(seed);
        let Some((theirs, complaint, they_refuse)) = rs274(&folder, &program) else {
            println!("rs274 not installed: differential test not run");
            return;
        };
        let (ours, we_refuse) = ours_of(&program);
        refused += u64::from(we_refuse);
        let (theirs, ours) = (functions(&theirs), functions(&ours));
        if theirs != ours || they_refuse != we_refuse {
            differing += 1;
            let at = theirs.iter().zip(&ours).take_while(|(theirs, ours)| theirs == ours).count();
            println!("seed {seed}, function {at}, refused by them {they_refuse}, by us {we_refuse}");
            println!("theirs: {:?}\nours:   {:?}\nthey say: {complaint:?}", theirs.get(at), ours.get(at));
            if differing == 1 {
                println!("{program}");
            }
        }
    }
    let _ = std::fs::remove_dir_all(&folder);
    println!("{count} programs, {refused} of them refused, {differing} differ");
    assert_eq!(differing, 0, "of {count} programs");
}

#[test]
fn random_programs_give_the_canonical_functions_of_rs274() {
    compare("differential", None, Writer::program, canon_text);
}

#[test]
fn random_outlines_are_compensated_as_by_rs274() {
    let tools = ToolTable::read(TOOLS).expect("a tool table");
    let setup = || Setup { tools: tools.clone(), ..Setup::rs274() };
    compare("outlines", Some(TOOLS), Outline::program, |program| canon_text_with(program, setup()));
}
