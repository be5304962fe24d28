//! The mutants: one change at a time in a copy of the checkout, and the one check that must notice it.
//!
//! Invariant: a mutant counts as killed only where its check ran and failed; one that does not apply or does not
//! compile is an error.

use super::Job;
use super::cbmc::{self, Proof};
use super::native::{self, Built};
use super::outcome::{Engine, Outcome, Verdict};
use super::rows::Mutant;
use super::threads;
use super::tools::CbmcTools;
use retrace_task_support::process::{self, Ended};
use retrace_task_support::tree;
use std::collections::{BTreeSet, VecDeque};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Time limit of a check on a mutant, which may run for ever.
const LIMIT: Duration = Duration::from_secs(60);
/// Time limit of a thread model, of CBMC, and of a harness that is built quickly and runs slowly.
const LONG_LIMIT: Duration = Duration::from_secs(300);

/// A mutant, and which engine its killer belongs to.
struct Trial<'a> {
    mutant: &'a Mutant,
    killer: Killer,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Killer {
    /// A harness, over enumerated and drawn choices.
    Harness,
    /// A search of the native engine.
    Search,
    Model(Engine),
}

/// A copy of the checkout with build folders of its own.
struct Copy {
    root: PathBuf,
    target: PathBuf,
    folder: PathBuf,
}

/// Runs the mutants of the rows against their killers. A quick run takes the first of a row for each source file, and
/// of these each [`EACH`]th, some 10 s; none of the thread models, which a copy of the checkout takes minutes to build.
pub(crate) fn run(job: &Job<'_>) {
    let trials = trials(job);
    let is_model = |trial: &Trial<'_>| matches!(trial.killer, Killer::Model(_));
    let (models, natives) = trials.into_iter().partition::<VecDeque<_>, _>(is_model);
    let (models, natives) = (Mutex::new(models), Mutex::new(natives));
    let take = |queue: &Mutex<VecDeque<_>>| queue.lock().ok().and_then(|mut queue| queue.pop_front());
    // one copy builds the thread models, so that the other need not build what they depend on too
    let copies: Vec<usize> = (0..process::workers()).collect();
    process::each(&copies, copies.len(), |number| {
        let next = || if *number == 0 { take(&models).or_else(|| take(&natives)) } else { take(&natives) };
        let mut copy = None;
        while let Some(trial) = next() {
            let copy = match &copy {
                Some(copy) => copy,
                None => match Copy::make(job, *number) {
                    Ok(made) => copy.insert(made),
                    Err(reason) => return job.log.broken(Engine::Mutants, reason),
                },
            };
            let seen = |check: &str| {
                job.log.outcomes().iter().any(|outcome| outcome.check == check && outcome.verdict == Verdict::Passed)
            };
            let killer = &trial.mutant.killer;
            tell(job, Engine::Mutants, trial.mutant, || {
                // a check that fails anyway kills nothing
                if !seen(killer) {
                    copy.passes(job, &trial)?;
                }
                copy.with(trial.mutant, || copy.check(job, &trial))
            });
        }
    });
}

/// Runs the mutants whose killer is a harness under CBMC, which must refute that harness.
pub(crate) fn run_cbmc(job: &Job<'_>, tools: &CbmcTools) {
    let harness_of =
        |mutant: &Mutant| job.rows.iter().flat_map(|row| &row.harnesses).find(|harness| harness.name == mutant.killer);
    let mutants = job.rows.iter().flat_map(|row| &row.mutants);
    let queue: VecDeque<_> = mutants.filter_map(|mutant| Some((mutant, harness_of(mutant)?))).collect();
    let queue = Mutex::new(queue);
    let copies: Vec<usize> = (0..process::workers()).collect();
    process::each(&copies, copies.len(), |number| {
        let copy = match Copy::make(job, *number) {
            Ok(copy) => copy,
            Err(reason) => return job.log.broken(Engine::CbmcMutants, reason),
        };
        while let Some((mutant, harness)) = queue.lock().ok().and_then(|mut queue| queue.pop_front()) {
            tell(job, Engine::CbmcMutants, mutant, || {
                copy.with(mutant, || {
                    let compiled = cbmc::build(&copy.root, &job.runner, tools, &copy.folder.join("cbmc"))?;
                    Ok(of_proof(mutant, cbmc::prove(tools, &compiled, harness, LONG_LIMIT)))
                })
            });
        }
    });
}

fn of_proof(mutant: &Mutant, proof: Proof) -> (Verdict, String) {
    match proof {
        Proof::Refuted(what) => (Verdict::Passed, format!("killed: CBMC refutes {} (\"{what}\" fails)", mutant.killer)),
        Proof::Vacuous(what) => (Verdict::Passed, format!("killed: {} no longer reaches {what}", mutant.killer)),
        Proof::Unwound => (Verdict::Open, "open: a loop turns beyond the bound; nothing is refuted".to_owned()),
        Proof::TimeUp => (Verdict::Open, format!("open: not ended after {} s", LONG_LIMIT.as_secs())),
        Proof::Proved => (Verdict::Failed, format!("SURVIVED: CBMC proves {} all the same", mutant.killer)),
        Proof::Error(reason) => (Verdict::Failed, format!("ERROR: {reason}")),
    }
}

/// A quick run tries one in so many of the mutants of different files.
const EACH: usize = 7;

fn trials<'a>(job: &'a Job<'_>) -> Vec<Trial<'a>> {
    let few = job.quick && !job.is_slice;
    let (mut trials, mut files) = (Vec::new(), BTreeSet::new());
    for row in &job.rows {
        for (number, mutant) in row.mutants.iter().enumerate() {
            let model = row.models.iter().find(|model| model.test == mutant.killer);
            let killer = match model.and_then(|model| Engine::named(&model.engine)) {
                Some(engine) => Killer::Model(engine),
                None if row.harnesses.iter().any(|harness| harness.name == mutant.killer) => Killer::Harness,
                None => Killer::Search,
            };
            let is_model = matches!(killer, Killer::Model(_));
            let is_tried = number == 0 && !is_model && files.insert(&mutant.file) && files.len() % EACH == 1;
            if !few || is_tried {
                trials.push(Trial { mutant, killer });
            } else if let Err(reason) = mutated(&job.root.join(&mutant.file), mutant) {
                // one that is not tried must apply nevertheless
                job.log.broken(Engine::Mutants, reason);
            }
        }
    }
    trials
}

fn tell(job: &Job<'_>, engine: Engine, mutant: &Mutant, trial: impl FnOnce() -> Result<(Verdict, String), String>) {
    let started = Instant::now();
    let (verdict, words) = trial().unwrap_or_else(|reason| (Verdict::Failed, format!("ERROR: {reason}")));
    let (check, seconds) = (mutant.name.clone(), started.elapsed().as_secs_f64());
    job.log.tell(Outcome { engine, check, verdict, words, seconds });
}

/// The file's text unchanged, and with the mutant in it.
fn mutated(path: &Path, mutant: &Mutant) -> Result<[String; 2], String> {
    let Mutant { name, file, find, put, .. } = mutant;
    let text = std::fs::read_to_string(path).map_err(|error| format!("{file}: {error}"))?;
    match text.matches(find.as_str()).count() {
        1 => {
            let with = text.replacen(find, put, 1);
            Ok([text, with])
        }
        many => Err(format!("mutant `{name}` does not apply: its text occurs {many} times in {file}, not once")),
    }
}

impl Copy {
    fn make(job: &Job<'_>, number: usize) -> Result<Self, String> {
        let folder = job.folder.with_file_name("mutants").join(number.to_string());
        let copy = Self { root: folder.join("tree"), target: folder.join("target"), folder };
        tree::mirror(job.root, &copy.root)?;
        Ok(copy)
    }

    /// Calls `work` while a mutant is in the copy.
    fn with<T>(&self, mutant: &Mutant, work: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
        let path = self.root.join(&mutant.file);
        let [without, with] = mutated(&path, mutant)?;
        let write = |text: &str| std::fs::write(&path, text).map_err(|error| format!("{}: {error}", mutant.file));
        write(&with)?;
        let done = work();
        write(&without)?;
        done
    }

    /// Checks that the copy passes without a mutant.
    fn passes(&self, job: &Job<'_>, trial: &Trial<'_>) -> Result<(), String> {
        match self.check(job, trial)? {
            (Verdict::Failed, _) => Ok(()),
            (_, words) => Err(format!("its check fails without the mutant too: {words}")),
        }
    }

    /// Runs the killer on the content of the copy: `Passed` where the killer fails, `Failed` where it passes.
    fn check(&self, job: &Job<'_>, trial: &Trial<'_>) -> Result<(Verdict, String), String> {
        let killer = &trial.mutant.killer;
        let (ended, result) = match trial.killer {
            Killer::Harness | Killer::Search => {
                let (built, limit) = match trial.killer {
                    Killer::Search => (Built::Usual, LIMIT),
                    _ => (Built::Quickly, LONG_LIMIT),
                };
                let runner = native::build_copy(&self.root, &self.target, &self.folder.join("build"), built)?;
                let mut ask = native::ask(&runner, &[killer], job.quick);
                let ended = process::run(&mut ask, limit, &self.folder.join("check"))?;
                let answer = native::answers(&ended.output).into_iter().find(|answer| answer.check == *killer);
                let result = answer.map(|answer| (answer.verdict == Verdict::Failed, answer.words));
                (ended, result)
            }
            Killer::Model(engine) => {
                let ended = self.model(engine, killer)?;
                let result = threads::one_result(&ended.output, engine);
                (ended, result)
            }
        };
        judge(killer, &ended, result)
    }

    /// Builds an engine's models, and runs those with this name. In the checkout's own build folder cargo would take a
    /// changed file of another package, which a model includes by its path, for the checkout's, which has not changed.
    fn model(&self, engine: Engine, test: &str) -> Result<Ended, String> {
        let package = threads::package(engine).1;
        let build = ["test", "--package", &package, "--tests", "--no-run", "--jobs", "1", "--message-format"];
        let mut command = process::cargo(&self.root, &build);
        command.arg("json-render-diagnostics").env("CARGO_TARGET_DIR", &self.target);
        let messages = process::done(&mut command, Duration::from_secs(1800), &self.folder.join("build"))?;
        for runner in process::executables(&messages) {
            let listed = process::done(Command::new(&runner).arg("--list"), LIMIT, &self.folder.join("list"))?;
            let names = listed.lines().filter_map(|line| line.strip_suffix(": test"));
            let meant: Vec<&str> = names.filter(|name| threads::is_meant(name, test)).collect();
            if !meant.is_empty() {
                let mut command = Command::new(&runner);
                command.args(["--exact", "--show-output"]).args(meant);
                return process::run(&mut command, LONG_LIMIT, &self.folder.join("check"));
            }
        }
        Err(format!("there is no test `{test}` in {package}"))
    }
}

/// Decides whether the mutant was noticed. `result` is whether the check failed, and its message.
fn judge(killer: &str, ended: &Ended, result: Option<(bool, String)>) -> Result<(Verdict, String), String> {
    // the numbers that replay it are of no use without the mutant
    let short = |words: &str| {
        let reason = words.split("; cargo xtask").next().unwrap_or_default();
        reason.split_whitespace().collect::<Vec<_>>().join(" ").chars().take(160).collect::<String>()
    };
    match (ended.status, result) {
        (None, _) => Ok((Verdict::Passed, format!("killed by {killer}: no end after {:.0} s", ended.seconds))),
        (Some(_), Some((true, words))) => Ok((Verdict::Passed, format!("killed by {killer}: {}", short(&words)))),
        (Some(_), Some((false, words))) => Ok((Verdict::Failed, format!("SURVIVED: {killer} {}", short(&words)))),
        // a panic in a panic, or a stack that is full, ends the whole runner
        (Some(status), None) if status.code().is_none() => {
            Ok((Verdict::Passed, format!("killed by {killer}: it crashes ({status})")))
        }
        (Some(_), None) => Err(format!("{killer} gave no answer: {}", ended.last_words())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::process::ExitStatusExt;
    use std::process::ExitStatus;

    fn mutant(find: &str) -> Mutant {
        let text = str::to_owned;
        Mutant { name: text("m"), file: text("f"), find: text(find), put: text("c"), killer: text("k") }
    }

    #[test]
    fn a_mutant_applies_where_its_text_stands_once() {
        let path = std::env::temp_dir().join(format!("retrace-xtask-mutant-{}", std::process::id()));
        std::fs::write(&path, "a b b").unwrap();
        assert_eq!(mutated(&path, &mutant("a")), Ok(["a b b".to_owned(), "c b b".to_owned()]));
        assert!(mutated(&path, &mutant("b")).is_err() && mutated(&path, &mutant("x")).is_err());
        std::fs::remove_file(&path).unwrap();
        assert!(mutated(&path, &mutant("a")).is_err());
    }

    #[test]
    fn only_a_check_that_failed_kills() {
        let ended = |status| Ended { status, output: String::new(), errors: String::new(), seconds: 60.0 };
        let exit = |code: i32| ended(Some(ExitStatus::from_raw(code << 8)));
        let verdict = |ended: &Ended, result: Option<bool>| {
            judge("k", ended, result.map(|failed| (failed, "w".to_owned()))).map(|(verdict, _)| verdict)
        };
        assert_eq!(verdict(&exit(1), Some(true)), Ok(Verdict::Passed));
        assert_eq!(verdict(&exit(0), Some(false)), Ok(Verdict::Failed));
        assert_eq!(verdict(&ended(None), None), Ok(Verdict::Passed));
        assert_eq!(verdict(&ended(Some(ExitStatus::from_raw(6))), None), Ok(Verdict::Passed));
        assert!(verdict(&exit(2), None).is_err() && verdict(&exit(101), None).is_err());
    }
}
