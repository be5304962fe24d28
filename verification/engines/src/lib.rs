//! `cargo xtask verify`: every property of `verification/` by every installed engine, and the ledger of the results.
//!
//! Invariant: nothing is called proved that CBMC or Kani did not prove in this run; a missing engine is named first and
//! last.
#![forbid(unsafe_code)]

mod cbmc;
mod kani;
mod ledger;
mod mutants;
mod native;
mod options;
mod outcome;
mod page;
mod rows;
mod sanitizers;
mod sources;
mod status;
mod stub;
mod table;
mod threads;
mod tools;

pub use options::Options;

use outcome::{Engine, Log, Verdict};
use retrace_task_support::process;
use rows::{Harness, Row};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Context of the engines.
struct Job<'a> {
    root: &'a Path,
    /// Folder of all intermediate files.
    folder: PathBuf,
    /// The native runner.
    runner: PathBuf,
    /// The requested rows.
    rows: Vec<Row>,
    quick: bool,
    /// Whether these are only some of the rows.
    is_slice: bool,
    log: Log,
}

/// An engine that does not run.
struct NotRun {
    engine: Engine,
    why: String,
    /// How to install it; empty where it is installed and was left out.
    how: String,
}

/// Result of a run.
pub struct Summary {
    /// Whether nothing failed and no required engine was absent.
    pub passed: bool,
    /// One line for the table of results.
    pub remark: String,
}

/// Runs what the options request.
///
/// # Errors
/// Where a word of the options names nothing.
pub fn run(root: &Path, options: &Options) -> Result<Summary, String> {
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), PathBuf::from);
    let folder = root.join(target).join("verify");
    let broken = |reason: String| {
        println!("verify: ERROR: {reason}");
        Ok(Summary { passed: false, remark: "the native runner does not work".to_owned() })
    };
    let runner = match native::build(root, &folder.join("build")) {
        Ok(runner) => runner,
        Err(reason) => return broken(reason),
    };
    if let Some((name, numbers)) = &options.replay {
        return replay(&runner, name, numbers);
    }
    let mut list = std::process::Command::new(&runner);
    let listed = process::done(list.arg("list"), Duration::from_secs(60), &folder.join("list"));
    let all = match listed.and_then(|lines| Row::list(&lines)) {
        Ok(rows) => rows,
        Err(reason) => return broken(reason),
    };
    if let Some(name) = options.rows.iter().find(|name| all.iter().all(|row| row.name != **name)) {
        return Err(format!("there is no row `{name}`; see `cargo xtask verify --list`"));
    }
    if options.list {
        table::list(&all);
        return Ok(Summary { passed: true, remark: String::new() });
    }
    let is_slice = !options.rows.is_empty();
    let rows = all.iter().filter(|row| !is_slice || options.rows.contains(&row.name)).cloned().collect();
    let job = Job { root, folder, runner, rows, quick: options.quick, is_slice, log: Log::default() };
    Ok(run_engines(&job, &all, options))
}

fn replay(runner: &Path, name: &str, numbers: &str) -> Result<Summary, String> {
    let status = std::process::Command::new(runner).args(["replay", name, numbers]).status();
    match status.map(|status| status.code()) {
        Ok(Some(2)) => Err("the replay was not understood".to_owned()),
        Ok(code) => Ok(Summary { passed: code == Some(0), remark: String::new() }),
        Err(error) => Err(format!("the runner cannot be run: {error}")),
    }
}

fn run_engines(job: &Job<'_>, all: &[Row], options: &Options) -> Summary {
    let started = Instant::now();
    let cbmc = tools::cbmc();
    let kani = tools::pinned_kani(job.root);
    let absent = absent(job.root, options, &cbmc, &kani);
    table::not_run(&absent);
    let stale = ledger::stale(job.root, all).len();
    if stale > 0 {
        println!("STALE    {stale} rows of the committed ledger are of other sources; see the end");
    }
    let runs = |engine| options.wants(engine) && absent.iter().all(|absent| absent.engine != engine);
    if runs(Engine::Native) {
        native::run(job);
    }
    if runs(Engine::Stub) {
        stub::run(job, all);
    }
    let models: Vec<Engine> = [Engine::Loom, Engine::Shuttle].into_iter().filter(|engine| runs(*engine)).collect();
    run_models_and_proofs(job, &models, cbmc.as_ref().ok().filter(|_| runs(Engine::Cbmc)));
    if runs(Engine::Kani) {
        kani::run(job);
    }
    if runs(Engine::Mutants) {
        mutants::run(job);
    }
    if let (true, Ok(tools)) = (runs(Engine::CbmcMutants), &cbmc) {
        mutants::run_cbmc(job, tools);
    }
    for engine in [Engine::Miri, Engine::Tsan] {
        if runs(engine) {
            sanitizers::run(job, engine);
        }
    }
    let mut versions = vec![("rustc".to_owned(), tools::rustc_version())];
    versions.extend(cbmc.iter().flat_map(|tools| tools.versions.clone()));
    versions.extend(kani.ok().filter(|_| runs(Engine::Kani)).map(|version| ("kani".to_owned(), version)));
    let outcomes = job.log.outcomes();
    let required = options.require.iter().filter(|engine| absent.iter().any(|absent| absent.engine == **engine));
    let lacks: Vec<&str> = required.map(|engine| engine.name()).collect();
    let book = ledger::of_run(job, &outcomes, &absent, &versions, started.elapsed().as_secs_f64());
    let agrees = ledger::keep(job, all, &book, options);
    table::result(&job.rows, &outcomes, &absent);
    let stale = ledger::stale(job.root, all);
    if !stale.is_empty() {
        let what = if options.require_current { "FAILED: required current and STALE" } else { "STALE" };
        println!(
            "verify: {what}: the ledger's results of {} rows are of other sources: {}",
            stale.len(),
            stale.join(", ")
        );
    }
    if !lacks.is_empty() {
        println!("verify: FAILED: required and NOT RUN: {}", lacks.join(", "));
    }
    let failed = outcomes.iter().filter(|outcome| outcome.verdict == Verdict::Failed).count();
    let proved = outcomes.iter().filter(|outcome| outcome.verdict == Verdict::Proved).count();
    let remark = format!(
        "{} rows, {} checks, {proved} proved in this run, {failed} failed, {} rows stale",
        job.rows.len(),
        outcomes.iter().filter(|outcome| !outcome.check.is_empty()).count(),
        stale.len()
    );
    println!("verify: {remark}, {:.0} s", started.elapsed().as_secs_f64());
    let is_current = !options.require_current || stale.is_empty();
    Summary { passed: failed == 0 && lacks.is_empty() && agrees && is_current, remark }
}

/// What a worker does next: all models of these engines, or one proof.
enum Task<'a> {
    Models(&'a [Engine]),
    Proof(&'a Harness),
}

/// Runs the thread models on one core, and the proofs on the other and then on both, so that neither core waits for the
/// other's longest check. Without proofs, the models have both.
fn run_models_and_proofs(job: &Job<'_>, models: &[Engine], cbmc: Option<&tools::CbmcTools>) {
    let cheap = if job.quick && !job.is_slice { ledger::cheap(job.root) } else { None };
    let wanted = |name: &str| cheap.as_ref().is_none_or(|cheap| cheap.contains(name));
    let compiled = cbmc.and_then(|tools| Some((tools, cbmc::compile(job, tools)?)));
    let harnesses = job.rows.iter().flat_map(|row| &row.harnesses);
    let mut proofs: Vec<&Harness> = harnesses.filter(|of| compiled.is_some() && wanted(&of.name)).collect();
    let times = ledger::proof_times(job.root);
    let time_of = |of: &Harness| times.get(&of.name).copied().unwrap_or(f64::INFINITY);
    // the longest first, so that the last ones are short
    proofs.sort_by(|a, b| time_of(b).total_cmp(&time_of(a)));
    let jobs = if proofs.is_empty() { process::workers() } else { 1 };
    let tasks: Vec<Task<'_>> =
        std::iter::once(Task::Models(models)).chain(proofs.into_iter().map(Task::Proof)).collect();
    process::each(&tasks, process::workers(), |task| match (task, &compiled) {
        (Task::Models(engines), _) => engines.iter().for_each(|engine| threads::run(job, *engine, jobs)),
        (Task::Proof(harness), Some((tools, compiled))) => cbmc::run(job, tools, compiled, harness),
        (Task::Proof(_), None) => {}
    });
}

/// Engines that are requested and not installed, and those that are installed and not requested. `kani` is the version
/// that is pinned.
fn absent(
    root: &Path,
    options: &Options,
    cbmc: &Result<tools::CbmcTools, String>,
    kani: &Result<String, String>,
) -> Vec<NotRun> {
    let reason = |engine| {
        let (why, how) = match (engine, cbmc, kani) {
            (Engine::Cbmc | Engine::CbmcMutants, Err(missing), _) => {
                (format!("missing: {missing}"), tools::GET_CBMC.to_owned())
            }
            (Engine::Kani, _, Err(missing)) => (missing.clone(), String::new()),
            (Engine::Kani, _, Ok(version)) if !tools::has_kani(version) => {
                (format!("Kani {version} is not set up here"), tools::get_kani(version))
            }
            (Engine::Loom | Engine::Shuttle, ..) if !threads::is_there(root, engine) => (
                "there are no models for it in this checkout".to_owned(),
                "see docs/verification.md, Engines".to_owned(),
            ),
            (Engine::CbmcMutants, ..) if !options.wants(engine) => {
                ("runs by name only: cargo xtask campaign mutants".to_owned(), String::new())
            }
            (Engine::Miri | Engine::Tsan, ..) if !options.wants(engine) => {
                (format!("runs by name only: --engine {}", engine.name()), String::new())
            }
            (Engine::Miri | Engine::Tsan, ..) if sanitizers::lacks(engine).is_some() => {
                (sanitizers::lacks(engine).unwrap_or_default(), sanitizers::how_to_get(engine).to_owned())
            }
            _ if !options.wants(engine) && options.engines.is_empty() => {
                ("left out by --quick".to_owned(), String::new())
            }
            _ if !options.wants(engine) => ("left out by --engine".to_owned(), String::new()),
            _ => return None,
        };
        Some(NotRun { engine, why, how })
    };
    Engine::ALL.into_iter().filter_map(reason).collect()
}
