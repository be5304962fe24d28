//! The CBMC lane: core, link and the harnesses as wasm32, wasm2c's C of it, and CBMC over each harness.
//!
//! Invariant: a harness is called proved only where CBMC verified it in this run *and* found the end of it reachable.

use super::Job;
use super::outcome::{Engine, Outcome, Verdict};
use super::rows::Harness;
use super::tools::CbmcTools;
use retrace_task_support::process::{self, Ended};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

/// Meaning of a proof of this lane, and its limits.
pub(crate) const MEANING: &str = "No panic, overflow or failed assertion in the LLVM-optimised wasm32 code, where \
    usize has 32 bits, for every \
     value the harness asks about. rustc, LLVM, wasm2c and verification/cbmc/environment.c are trusted; undefined \
     behaviour is not \
     looked for.";

/// Time limit of a harness, in a full run and in a quick one.
const LIMITS: [Duration; 2] = [Duration::from_secs(600), Duration::from_secs(60)];
/// Stack of the wasm module in bytes. It is first in memory, so that a stack that is too small causes an access out of
/// bounds, not a wrong answer. The cost of a proof follows the size of the modelled memory.
const STACK: &str = "stack-size=1024";
/// Loops with a constant trip count are unrolled, and all is inlined: values in locals need no modelled memory, and a
/// proof is up to fifteen times smaller.
const UNROLLED: [&str; 3] =
    ["llvm-args=-unroll-threshold=20000", "llvm-args=-unroll-full-max-count=64", "llvm-args=-inline-threshold=20000"];
/// wasm2c copies bytes for every load and store; as a typed access the formula is much smaller. Alignment does not
/// matter to CBMC.
const TYPED: [(&str, &str); 2] = [
    ("wasm_rt_memcpy(&result, &mem->data[addr], sizeof(t1));", "result = *(t1 *)(mem->data + addr);"),
    ("wasm_rt_memcpy(&mem->data[addr], &wrapped, sizeof(t1));", "*(t1 *)(mem->data + addr) = wrapped;"),
];

/// The harnesses, compiled.
pub(crate) struct Harnesses {
    folder: PathBuf,
    /// Every region, in the order of their bits.
    regions: Vec<String>,
}

/// One harness as C.
struct Module {
    folder: PathBuf,
    /// Bytes of linear memory to model.
    memory: u64,
    export: String,
    unwind: u64,
    /// Regions that a run must reach.
    covers: Vec<String>,
}

/// Compiles the harnesses of this checkout; `None` where that fails, which is told.
pub(crate) fn compile(job: &Job<'_>, tools: &CbmcTools) -> Option<Harnesses> {
    match build(job.root, &job.runner, tools, &job.folder.join("cbmc")) {
        Ok(compiled) => Some(compiled),
        Err(reason) => {
            job.log.broken(Engine::Cbmc, reason);
            None
        }
    }
}

/// Proves one harness, and tells the result.
pub(crate) fn run(job: &Job<'_>, tools: &CbmcTools, compiled: &Harnesses, harness: &Harness) {
    let limit = LIMITS[usize::from(job.quick)];
    let started = Instant::now();
    let (verdict, words) = match prove(tools, compiled, harness, limit) {
        Proof::Proved => (Verdict::Proved, "proved".to_owned()),
        Proof::Refuted(what) => (
            Verdict::Failed,
            format!("REFUTED: \"{what}\" fails; {}", replay_line(job, tools, compiled, harness, limit)),
        ),
        Proof::TimeUp if job.quick => (Verdict::Open, format!("TIME: not ended after {} s", limit.as_secs())),
        Proof::TimeUp => (Verdict::Failed, format!("TIME: not ended after {} s", limit.as_secs())),
        Proof::Unwound => {
            (Verdict::Failed, format!("UNWIND: the bound {} is too small; nothing is refuted", harness.unwind))
        }
        Proof::Vacuous(what) => (Verdict::Failed, format!("VACUOUS: no run reaches {what}")),
        Proof::Error(reason) => (Verdict::Failed, format!("ERROR: {reason}")),
    };
    let (check, seconds) = (harness.name.clone(), started.elapsed().as_secs_f64());
    job.log.tell(Outcome { engine: Engine::Cbmc, check, verdict, words, seconds });
}

/// Compiles a checkout, or a copy of one, for wasm32. `runner` is its native runner, which lists the regions.
///
/// # Errors
/// Where the compiler does not succeed.
pub(crate) fn build(root: &Path, runner: &Path, tools: &CbmcTools, folder: &Path) -> Result<Harnesses, String> {
    if folder.is_dir() {
        fs::remove_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    }
    fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let rustc = |step: &str, source: &str, kind: &str, more: &[&str]| {
        let mut command = Command::new(&tools.rustc);
        command.current_dir(root).args(["--edition", "2024", "--target", "wasm32-unknown-unknown"]);
        command.args(["--cfg", "verify_wasm", "--cap-lints", "allow", "--crate-type", kind, "--crate-name", step]);
        for option in ["opt-level=3", "panic=abort", "overflow-checks=on", "debug-assertions=on", "codegen-units=1"] {
            command.args(["-C", option]);
        }
        if let Some(core) = &tools.wasm_core {
            command.arg("-L").arg(core);
        }
        command.arg("-L").arg(folder).arg("--out-dir").arg(folder).args(more).arg(source);
        process::done(&mut command, Duration::from_secs(600), &folder.join(step))
    };
    rustc("retrace_core", "crates/core/src/lib.rs", "rlib", &[])?;
    rustc("retrace_link", "crates/link/src/lib.rs", "rlib", &["--extern", "retrace_core"])?;
    let both = ["--extern", "retrace_core", "--extern", "retrace_link"];
    rustc("retrace_card", "crates/card/src/lib.rs", "rlib", &both)?;
    let mut last = both.to_vec();
    last.extend(["--extern", "retrace_card", "-C", "lto=fat"]);
    last.extend(UNROLLED.iter().flat_map(|option| ["-C", *option]));
    rustc("harnesses", "verification/src/lib.rs", "staticlib", &last)?;
    let environment = "verification/cbmc/environment.c";
    fs::copy(root.join(environment), folder.join("environment.c"))
        .map_err(|error| format!("{environment}: {error}"))?;
    let listed = process::done(Command::new(runner).arg("regions"), Duration::from_secs(60), &folder.join("regions"))?;
    Ok(Harnesses { folder: folder.to_owned(), regions: listed.lines().map(str::to_owned).collect() })
}

/// One harness as C. It is linked alone, so that the modelled memory holds nothing of the others.
fn module(tools: &CbmcTools, compiled: &Harnesses, harness: &Harness) -> Result<Module, String> {
    let Harness { name, unwind, covers, .. } = harness;
    let export = format!("h_{name}__u{unwind}");
    let folder = compiled.folder.join(name);
    fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut link = Command::new(&tools.linker);
    link.current_dir(&folder).args(["-flavor", "wasm", "--no-entry", "--gc-sections", "--stack-first", "-z", STACK]);
    link.args(["--export=__heap_base", &format!("--export={export}"), "../libharnesses.a", "-o", "h.wasm"]);
    process::done(&mut link, Duration::from_secs(120), &folder.join("link"))?;
    let mut wasm2c = Command::new(&tools.wasm2c);
    wasm2c.current_dir(&folder).args(["-n", "h", "h.wasm", "-o", "h.c"]);
    process::done(&mut wasm2c, Duration::from_secs(120), &folder.join("wasm2c"))?;
    let mut code = fs::read_to_string(folder.join("h.c")).map_err(|error| format!("h.c: {error}"))?;
    if !code.contains(&format!("Z_hZ_{export}")) {
        return Err("wasm2c's C does not export the harness as expected (known: wabt 1.0.32)".to_owned());
    }
    for (copied, typed) in TYPED {
        if !code.contains(copied) {
            return Err(format!("wasm2c's C is not as expected (known: wabt 1.0.32): no `{copied}`"));
        }
        code = code.replace(copied, typed);
    }
    let memory = heap_base(&code).ok_or("wasm2c's C names no __heap_base")?.next_multiple_of(16);
    fs::write(folder.join("h.c"), code).map_err(|error| format!("h.c: {error}"))?;
    fs::copy(compiled.folder.join("environment.c"), folder.join("environment.c")).map_err(|error| error.to_string())?;
    fs::write(folder.join("covers.h"), assertions(covers, &compiled.regions)?).map_err(|error| error.to_string())?;
    Ok(Module { folder, memory, export, unwind: *unwind, covers: covers.clone() })
}

/// An assertion in C for each region, which fails where a run reaches it.
fn assertions(covers: &[String], regions: &[String]) -> Result<String, String> {
    let assertion = |region: &String| {
        let bit = regions.iter().position(|known| known == region).ok_or(format!("there is no region {region}"))?;
        Ok(format!("__CPROVER_assert((covered >> {bit} & 1) == 0, \"the region {region} is reachable\");\n"))
    };
    covers.iter().map(assertion).collect()
}

fn heap_base(code: &str) -> Option<u64> {
    let (_, value) = code.split_once("w2c___heap_base = ")?;
    value.split('u').next()?.parse().ok()
}

/// Result of a proof.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Proof {
    Proved,
    /// An assertion fails, in its own words.
    Refuted(String),
    /// A loop turns more often than the bound allows; no other assertion fails.
    Unwound,
    TimeUp,
    /// Nothing reaches the end of the harness, or a region that it lists.
    Vacuous(String),
    Error(String),
}

/// Proves one harness.
pub(crate) fn prove(tools: &CbmcTools, compiled: &Harnesses, harness: &Harness, limit: Duration) -> Proof {
    let module = match module(tools, compiled, harness) {
        Ok(module) => module,
        Err(reason) => return Proof::Error(reason),
    };
    match cbmc(tools, &module, &["--slice-formula"], "proof", limit).map(|ended| read_proof(&ended)) {
        Ok(Proof::Proved) => {}
        Ok(other) => return other,
        Err(reason) => return Proof::Error(reason),
    }
    // the first assertion of `main` is about the memory; then come the end and the regions
    let reachable: Vec<String> = (0..=module.covers.len())
        .flat_map(|n| ["--property".to_owned(), format!("main.assertion.{}", n + 2)])
        .collect();
    let mut more = vec!["--slice-formula", "-DREACHABLE"];
    more.extend(reachable.iter().map(String::as_str));
    match cbmc(tools, &module, &more, "reachable", limit) {
        Ok(ended) if ended.status.is_none() => Proof::TimeUp,
        Ok(ended) => read_reached(&ended, &module.covers),
        Err(reason) => Proof::Error(reason),
    }
}

/// Decides whether the end and every region are reached: an assertion that *fails* is reached.
fn read_reached(ended: &Ended, covers: &[String]) -> Proof {
    let regions = covers.iter().map(|region| format!("the region {region}"));
    for what in std::iter::once("the end of the harness".to_owned()).chain(regions) {
        if ended.output.contains(&format!(" {what} is reachable: FAILURE")) {
            continue;
        }
        if ended.output.contains(&format!(" {what} is reachable: SUCCESS")) {
            return Proof::Vacuous(what);
        }
        return Proof::Error(format!("is {what} reachable? {}", ended.last_words()));
    }
    Proof::Proved
}

fn read_proof(ended: &Ended) -> Proof {
    if ended.status.is_none() {
        return Proof::TimeUp;
    }
    let failing: Vec<&str> = ended.output.lines().filter(|line| line.ends_with(": FAILURE")).collect();
    let is_unwinding = |line: &&&str| line.contains("unwinding assertion");
    if ended.passed() && ended.output.contains("VERIFICATION SUCCESSFUL") && failing.is_empty() {
        return Proof::Proved;
    }
    if !ended.output.contains("VERIFICATION FAILED") || failing.is_empty() {
        return Proof::Error(ended.last_words());
    }
    match failing.iter().find(|line| !is_unwinding(line)) {
        Some(line) if line.contains("modelled memory") => Proof::Error("the modelled memory is too small".into()),
        Some(line) => Proof::Refuted(assertion_of(line)),
        None => Proof::Unwound,
    }
}

/// Text of an assertion: `[name.1] line 24 the property holds: FAILURE`.
fn assertion_of(line: &str) -> String {
    let text = line.trim_end_matches(": FAILURE");
    let words = text.split_once("] line ").and_then(|(_, rest)| rest.split_once(' '));
    words.map_or(text, |(_, words)| words).to_owned()
}

fn cbmc(tools: &CbmcTools, module: &Module, more: &[&str], log: &str, limit: Duration) -> Result<Ended, String> {
    let mut command = Command::new(&tools.cbmc);
    command.current_dir(&module.folder).args(["environment.c", "-I"]).arg(&tools.include);
    command.args([format!("-DHARNESS={}", module.export), format!("-DMEMORY={}", module.memory)]);
    command.args(["--unwind", &module.unwind.to_string(), "--unwinding-assertions", "--object-bits", "14"]);
    if tools.cbmc_major >= 6 {
        command.arg("--no-standard-checks");
    }
    process::run(command.args(more), limit, &module.folder.join(log))
}

/// The command that replays a counterexample natively, and whether it does.
fn replay_line(job: &Job<'_>, tools: &CbmcTools, compiled: &Harnesses, harness: &Harness, limit: Duration) -> String {
    let name = &harness.name;
    let traced = module(tools, compiled, harness).and_then(|module| {
        let ended = cbmc(tools, &module, &["--trace", "--stop-on-fail"], "trace", limit)?;
        Ok((numbers(&ended.output).join(","), module.folder.join("replay")))
    });
    let (numbers, log) = match traced {
        Ok(traced) => traced,
        Err(reason) => return reason,
    };
    let mut replay = Command::new(&job.runner);
    let agrees = match process::run(replay.args(["replay", name, &numbers]), limit, &log) {
        Ok(ended) if ended.exited_with(1) => "natively it fails too",
        Ok(_) => "natively it does NOT fail: 32-bit usize, or the lane itself",
        Err(_) => "it was not replayed",
    };
    format!("cargo xtask verify --replay {name}={numbers} ({agrees})")
}

/// Numbers given to the harness in a trace, in order.
fn numbers(trace: &str) -> Vec<String> {
    let given = trace.lines().filter_map(|line| line.trim().strip_prefix("return_value_nondet_uint32="));
    given.map(|rest| rest.chars().take_while(char::is_ascii_digit).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ended(code: i32, output: &str) -> Ended {
        use std::os::unix::process::ExitStatusExt;
        let status = Some(std::process::ExitStatus::from_raw(code << 8));
        Ended { status, output: output.into(), errors: String::new(), seconds: 0.0 }
    }

    #[test]
    fn only_a_verified_harness_is_proved() {
        let good = "[main.assertion.1] line 56 the modelled memory covers: SUCCESS\nVERIFICATION SUCCESSFUL\n";
        assert_eq!(read_proof(&ended(0, good)), Proof::Proved);
        assert!(matches!(read_proof(&ended(6, good)), Proof::Error(_)));
        assert!(matches!(read_proof(&ended(0, "")), Proof::Error(_)));
        assert_eq!(read_proof(&Ended { status: None, ..ended(0, good) }), Proof::TimeUp);
        let unwound = "[Z_x.unwind.0] line 9 unwinding assertion loop 0: FAILURE\n";
        let failed = "[Z_vZ_fail.assertion.1] line 24 the property holds: FAILURE\n";
        let end = "VERIFICATION FAILED\n";
        assert_eq!(read_proof(&ended(10, &[unwound, end].concat())), Proof::Unwound);
        let refuted = read_proof(&ended(10, &[unwound, failed, end].concat()));
        assert_eq!(refuted, Proof::Refuted("the property holds".into()));
    }

    #[test]
    fn a_harness_is_proved_where_its_end_and_every_region_are_reached() {
        let covers = ["Empty", "Full"].map(str::to_owned);
        let line = |what: &str, result: &str| format!("[main.assertion.2] line 9 {what} is reachable: {result}\n");
        let output = |end: &str, empty: &str, full: &str| {
            [line("the end of the harness", end), line("the region Empty", empty), line("the region Full", full)]
                .concat()
        };
        let read = |output: String| read_reached(&ended(10, &output), &covers);
        assert_eq!(read(output("FAILURE", "FAILURE", "FAILURE")), Proof::Proved);
        assert_eq!(read(output("FAILURE", "FAILURE", "SUCCESS")), Proof::Vacuous("the region Full".into()));
        assert_eq!(read(output("SUCCESS", "FAILURE", "FAILURE")), Proof::Vacuous("the end of the harness".into()));
        assert!(matches!(read(line("the end of the harness", "FAILURE")), Proof::Error(_)));
        let regions = ["Full", "Other", "Empty"].map(str::to_owned);
        let lines = assertions(&covers, &regions).unwrap();
        assert!(lines.starts_with("__CPROVER_assert((covered >> 2 & 1) == 0, \"the region Empty is reachable\");\n"));
        assert!(assertions(&covers, &regions[..2]).is_err());
    }

    #[test]
    fn what_the_c_says_of_itself_is_read() {
        assert_eq!(heap_base("x\n  instance->w2c___heap_base = 1849u;\n"), Some(1849));
        let trace = "  return_value_nondet_uint32=4294967295u (11111111)\n  x=1\n  return_value_nondet_uint32=0u (0)\n";
        assert_eq!(numbers(trace), ["4294967295", "0"]);
    }
}
