//! Random programs, call by call against LinuxCNC's `rs274 -g`.
//!
//! The number of programs is 120, or what RETRACE_DIFFERENTIAL says; a run of many takes the environment variable
//! RETRACE_DIFFERENTIAL_FIRST as its first seed.

mod common;
mod writer;

use common::canon_text;
use std::path::Path;
use std::process::{Command, Stdio};
use writer::Writer;

/// What `rs274 -g` prints for a program, what it complains of, and whether it refused it; `None` where it is not installed.
fn rs274(folder: &Path, program: &str) -> Option<(String, String, bool)> {
    let file = folder.join("program.ngc");
    std::fs::write(&file, program).expect("a program file");
    // It keeps its tool data in the home folder, where another one running would find them.
    let output = Command::new("rs274")
        .arg("-g")
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

#[test]
fn random_programs_give_the_canonical_functions_of_rs274() {
    let folder = std::env::temp_dir().join(format!("retrace-differential-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    let first = number("RETRACE_DIFFERENTIAL_FIRST", 0);
    let (mut differing, mut refused) = (0, 0);
    let count = number("RETRACE_DIFFERENTIAL", 120);
    for seed in first..first + count {
        let program = Writer::program(seed);
        let Some((theirs, complaint, they_refuse)) = rs274(&folder, &program) else {
            println!("rs274 not installed: differential test not run");
            return;
        };
        let (ours, we_refuse) = canon_text(&program);
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
