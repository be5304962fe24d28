//! The Kani harnesses against a stub of the `kani` crate, so that they stay compilable where Kani is not installed.
//!
//! Invariant: it passes only where exactly the harnesses of Kani's list are proofs, and each of them compiles and runs.

use super::Job;
use super::outcome::{Engine, Outcome, Verdict};
use super::rows::{Harness, Row};
use retrace_task_support::process;
use retrace_task_support::tree::{Tree, code_only, words};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

const LIMIT: Duration = Duration::from_secs(300);
/// Drawn inputs of each proof.
const TIMES: &str = "200";
/// Code that Kani is known to fail on, or to take far too long over.
const CHOKES: &[&str] =
    &["format", "Vec", "vec", "String", "f32", "f64", "assert_eq", "assert_ne", "println", "HashMap", "HashSet"];

/// Compiles and runs the proofs.
pub(crate) fn run(job: &Job<'_>, all: &[Row]) {
    let started = Instant::now();
    let tell = |verdict, words: String| {
        let (check, seconds) = ("kani-stub".to_owned(), started.elapsed().as_secs_f64());
        job.log.tell(Outcome { engine: Engine::Stub, check, verdict, words, seconds });
    };
    let listed: Vec<&Harness> = all.iter().flat_map(|row| &row.harnesses).collect();
    match compile(job, &listed).and_then(|driver| try_all(&driver, job, &listed)) {
        Ok(met) => tell(
            Verdict::Passed,
            format!(
                "passed ({} Kani harnesses compile; {met} ran within their assumptions on drawn inputs)",
                listed.len()
            ),
        ),
        Err(reason) => tell(Verdict::Failed, format!("FAILED: {reason}")),
    }
}

/// Compiles the stub, core, link and the proofs, and a program that calls each of them.
fn compile(job: &Job<'_>, listed: &[&Harness]) -> Result<PathBuf, String> {
    let found = Tree::read(job.root).map(|tree| chokes(&tree))?;
    if !found.is_empty() {
        return Err(format!("Kani would choke on: {}", found.join(", ")));
    }
    let folder = job.folder.join("stub");
    if folder.is_dir() {
        std::fs::remove_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    }
    std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let notes = folder.join("proofs.txt");
    let rustc = |name: &str, source: &Path, options: &[&str]| {
        let mut command = Command::new(std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into()));
        command.args(["--edition", "2024", "--cap-lints", "allow", "--crate-name", name, "-C", "debug-assertions=on"]);
        command.args(options).arg("-L").arg(&folder).arg("--out-dir").arg(&folder).arg(source);
        command.current_dir(job.root).env("RETRACE_STUB_PROOFS", &notes);
        process::done(&mut command, LIMIT, &folder.join(name))
    };
    let library = ["--crate-type", "rlib"];
    let uses = |names: &[&'static str]| names.iter().flat_map(|name| ["--extern", *name]).collect::<Vec<_>>();
    rustc("kani_macros", Path::new("verification/kani-stub/macros.rs"), &["--crate-type", "proc-macro"])?;
    rustc("kani", Path::new("verification/kani-stub/lib.rs"), &[&library[..], &uses(&["kani_macros"])].concat())?;
    rustc("retrace_core", Path::new("crates/core/src/lib.rs"), &library)?;
    rustc("retrace_link", Path::new("crates/link/src/lib.rs"), &[&library[..], &uses(&["retrace_core"])].concat())?;
    let both = uses(&["retrace_core", "retrace_link"]);
    rustc("retrace_card", Path::new("crates/card/src/lib.rs"), &[&library[..], &both].concat())?;
    let used = uses(&["kani", "retrace_core", "retrace_link", "retrace_card"]);
    let proofs = [&library[..], &["--cfg", "kani"], &used].concat();
    rustc("retrace_verification", Path::new("verification/src/lib.rs"), &proofs)?;
    same_list(&std::fs::read_to_string(&notes).unwrap_or_default(), listed)?;
    let driver = folder.join("driver.rs");
    std::fs::write(&driver, calls(listed)).map_err(|error| format!("{}: {error}", driver.display()))?;
    rustc("driver", &driver, &uses(&["kani", "retrace_verification"]))?;
    Ok(folder.join(format!("driver{}", std::env::consts::EXE_SUFFIX)))
}

/// The proofs that were compiled must be those of the list.
fn same_list(notes: &str, listed: &[&Harness]) -> Result<(), String> {
    let compiled: BTreeSet<&str> = notes.lines().collect();
    let listed: BTreeSet<&str> = listed.iter().map(|harness| harness.name.as_str()).collect();
    let differing: Vec<&str> = compiled.symmetric_difference(&listed).copied().collect();
    if differing.is_empty() && !compiled.is_empty() {
        return Ok(());
    }
    Err(format!(
        "{} proofs are compiled, {} listed; they differ in: {}",
        compiled.len(),
        listed.len(),
        differing.join(", ")
    ))
}

fn calls(listed: &[&Harness]) -> String {
    let call = |harness: &&Harness| {
        let Harness { name, module, .. } = harness;
        format!("    kani::run(\"{name}\", {module}::on_kani::{name}, {TIMES});\n")
    };
    let calls: String = listed.iter().map(call).collect();
    format!("fn main() {{\n    std::panic::set_hook(Box::new(|_| {{}}));\n{calls}}}\n")
}

/// Runs the proofs, and returns how many of them met their assumptions.
fn try_all(driver: &Path, job: &Job<'_>, listed: &[&Harness]) -> Result<usize, String> {
    let result = process::done(&mut Command::new(driver), LIMIT, &job.folder.join("stub/run"))?;
    let told: Vec<Vec<&str>> = result.lines().map(|line| line.split('\t').collect()).collect();
    let mut met = 0;
    for harness in listed {
        match told.iter().find(|parts| parts[0] == harness.name).map(Vec::as_slice) {
            Some([_, "ran", kept]) => met += usize::from(*kept != "0"),
            Some(parts) => return Err(parts.join(" ")),
            None => return Err(format!("{} did not run", harness.name)),
        }
    }
    Ok(met)
}

/// Code in the harnesses' files that Kani fails on. Code that is only compiled natively does not count.
fn chokes(tree: &Tree) -> Vec<String> {
    let mut found = Vec::new();
    for (path, text) in
        tree.rust().filter(|(path, text)| path.starts_with("verification/src/") && text.contains("\nharnesses! {\n"))
    {
        for (index, line) in for_proofs(&code_only(text)).lines().enumerate() {
            let choking = CHOKES.iter().find(|word| words(line, word).next().is_some());
            found.extend(choking.map(|word| format!("{path}:{}: {word}", index + 1)));
        }
    }
    found
}

/// The code without the items that no proof sees.
fn for_proofs(code: &str) -> String {
    const NATIVE: [&str; 2] = ["#[cfg(not(any(kani, verify_wasm)))]", "#[cfg(test)]"];
    let mut bytes = code.as_bytes().to_vec();
    for mark in NATIVE {
        for (at, _) in code.match_indices(mark) {
            let end = at + mark.len() + item_length(&code[at + mark.len()..]);
            bytes[at..end].iter_mut().filter(|byte| **byte != b'\n').for_each(|byte| *byte = b' ');
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// The length of the item that begins here: up to a semicolon, or to the brace that closes it.
fn item_length(code: &str) -> usize {
    let mut depth = 0_i32;
    for (at, byte) in code.bytes().enumerate() {
        match byte {
            b'{' | b'(' | b'[' => depth += 1,
            b')' | b']' => depth -= 1,
            b'}' => {
                depth -= 1;
                if depth == 0 {
                    return at + 1;
                }
            }
            b';' if depth == 0 => return at + 1,
            _ => {}
        }
    }
    code.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_kani_chokes_on_is_found_where_a_proof_sees_it() {
        let native = "#[cfg(not(any(kani, verify_wasm)))]";
        let text = format!(
            "fn a() {{ assert_eq!(1, 1); }}\n{native}\nmod search {{\n fn b() -> Vec<u8> {{ vec![] }}\n}}\n// Vec\n\
             {native}\npub const ROWS: &[Row] = &[Row {{ x: vec }}];\nfn c() -> f64 {{ 0.0 }}\nharnesses! {{\n\
             }}\n#[cfg(test)]\nmod t {{ fn d() {{ format!(1); }} }}\n"
        );
        let tree = Tree::of(&[
            ("verification/src/a.rs", &text),
            ("verification/src/b.rs", "fn a() { vec![] }"),
            // searches alone, which no proof sees
            ("verification/src/c.rs", "fn a() { vec![] }\nharnesses! {}\n"),
            ("crates/a.rs", &text),
        ]);
        assert_eq!(chokes(&tree), ["verification/src/a.rs:1: assert_eq", "verification/src/a.rs:9: f64"]);
    }

    #[test]
    fn a_proof_that_is_in_one_list_only_is_told() {
        let harness = |name: &str| Harness {
            name: name.into(),
            module: "retrace_verification::m".into(),
            unwind: 1,
            covers: Vec::new(),
        };
        let [a, b] = ["a", "b"].map(harness);
        assert!(same_list("a\nb\n", &[&b, &a]).is_ok());
        assert!(
            same_list("a\n", &[&a, &b]).is_err() && same_list("a\nb\n", &[&a]).is_err() && same_list("", &[]).is_err()
        );
        assert!(calls(&[&a]).contains("kani::run(\"a\", retrace_verification::m::on_kani::a, 200);"));
    }
}
