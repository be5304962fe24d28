//! Jobs of a shop on one machine whose submitter, agent and runs are killed at any moment: every job is cut in its
//! quantity, none twice, and none is lost (SHP-6, SHP-9, SHP-17, SHP-20).

use std::collections::BTreeMap;
use std::process::Stdio;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use std::time::Duration;

use retrace_tests::case_runner::run_cases;
use retrace_tests::command::Bench;
use retrace_tests::sender::TestRandom;
use serde_json::Value;

/// Number of jobs of a shop.
const JOBS: usize = 8;
/// Number of moments at which something happens before all is brought to its end.
const MOMENTS: usize = 40;
/// Longest time before a command is killed, in ms.
const LONGEST_MS: usize = 60;
/// Largest number of commands that bring everything to its end.
const MAX_STEPS: usize = 200;

static KILLS: AtomicU32 = AtomicU32::new(0);

struct Shop {
    bench: Bench,
    chance: TestRandom,
    /// Pieces of each job whose name was printed.
    promised: BTreeMap<String, u64>,
    /// Number of programs that were written.
    programs: usize,
}

impl Shop {
    fn new(seed: u64) -> Self {
        Self { bench: Bench::new(), chance: TestRandom::new(seed), promised: BTreeMap::new(), programs: 0 }
    }

    fn retrace(&self, arguments: &[&str]) -> Result<String, String> {
        let done = self.bench.retrace(arguments);
        if done.code == Some(0) {
            Ok(done.out)
        } else {
            Err(format!("{arguments:?}: {:?} {}{}", done.code, done.out, done.err))
        }
    }

    fn json(&self, arguments: &[&str]) -> Result<Value, String> {
        serde_json::from_str(&self.retrace(arguments)?).map_err(|error| format!("{arguments:?}: {error}"))
    }

    /// Starts a command and kills it after a moment, if it has not ended by then.
    fn killed(&mut self, arguments: &[&str]) {
        let mut child = self.bench.start(arguments, Stdio::null(), "killed.txt");
        thread::sleep(Duration::from_millis(self.chance.below(LONGEST_MS) as u64));
        let had_ended = child.try_wait().expect("a child").is_some();
        KILLS.fetch_add(u32::from(!had_ended), Ordering::Relaxed);
        child.kill().expect("it is killed");
        child.wait().expect("it ends");
    }

    /// Submits a job of one to three pieces; one in four submitters is killed, and has promised nothing then.
    fn submit(&mut self) -> Result<(), String> {
        self.programs += 1;
        let name = format!("part{}.ngc", self.programs);
        self.bench.file(&name, format!("G21 G90 F3000\nG1 X{}\nG1 X500 Y100\nG1 X0 Y0\nM2\n", self.programs));
        let quantity = 1 + self.chance.below(3) as u64;
        let pieces = quantity.to_string();
        let submit = ["shop", "submit", name.as_str(), "--quantity", pieces.as_str()];
        if self.chance.below(4) == 0 {
            self.killed(&submit);
        } else {
            self.promised.insert(self.retrace(&submit)?.trim().to_owned(), quantity);
        }
        Ok(())
    }

    /// Names of the jobs in this state.
    fn jobs_in(&self, state: &str) -> Result<Vec<String>, String> {
        let jobs = self.json(&["shop", "jobs", "--json", "--all"])?;
        let jobs = jobs["jobs"].as_array().cloned().unwrap_or_default();
        let named = jobs.iter().filter(|job| job["state"] == state);
        Ok(named.filter_map(|job| job["id"].as_str().map(str::to_owned)).collect())
    }

    /// Name of the run of this job that was interrupted.
    fn interrupted_run(&self, job: &str) -> Result<Option<String>, String> {
        let shown = self.json(&["shop", "show", job, "--json"])?;
        let mut runs = shown["runs"].as_array().cloned().unwrap_or_default().into_iter();
        Ok(runs.find(|run| run["state"] == "interrupted").and_then(|run| run["id"].as_str().map(str::to_owned)))
    }

    /// One thing that happens: a job is submitted, or the agent, a run or a resumed run is killed.
    fn moment(&mut self) -> Result<(), String> {
        match self.chance.below(4) {
            0 if self.programs < JOBS => self.submit(),
            1 => {
                self.killed(&["shop", "agent"]);
                Ok(())
            }
            2 => {
                if let Some(job) = self.jobs_in("ready")?.first() {
                    self.killed(&["run", "--job", job, "--json"]);
                }
                Ok(())
            }
            _ => {
                if let Some(job) = self.jobs_in("interrupted")?.first()
                    && let Some(run) = self.interrupted_run(job)?
                {
                    self.killed(&["resume", &run, "--yes", "--json"]);
                }
                Ok(())
            }
        }
    }

    /// Takes and runs everything that is left.
    fn finish(&mut self) -> Result<(), String> {
        while self.programs < JOBS {
            self.submit()?;
        }
        for _ in 0..MAX_STEPS {
            self.retrace(&["shop", "agent", "--once"])?;
            if let Some(job) = self.jobs_in("interrupted")?.first() {
                let run = self.interrupted_run(job)?.ok_or(format!("{job} has no run that was interrupted"))?;
                self.retrace(&["resume", &run, "--yes", "--json"])?;
            } else if let Some(job) = self.jobs_in("ready")?.first() {
                self.retrace(&["run", "--job", job, "--json"])?;
            } else {
                return Ok(());
            }
        }
        Err(format!("{MAX_STEPS} steps are not enough"))
    }

    /// Compares what the audit, the list and the journals say.
    fn judge(&self) -> Result<(), String> {
        let audit = self.json(&["shop", "audit", "--json"])?;
        if audit["faults"] != Value::Array(Vec::new()) {
            return Err(format!("faults: {}", audit["faults"]));
        }
        let journals = self.json(&["jobs", "--json", "--all"])?;
        let journals = journals["jobs"].as_array().cloned().unwrap_or_default();
        let pieces = |job: &str| {
            let of = journals.iter().filter(|run| run["program"].as_str().is_some_and(|path| path.contains(job)));
            of.filter(|run| run["state"] == "completed").count() as u64
        };
        let listed = self.json(&["shop", "jobs", "--json", "--all"])?;
        let mut found = BTreeMap::new();
        for job in listed["jobs"].as_array().into_iter().flatten() {
            let (id, quantity) = (job["id"].as_str().unwrap_or_default(), job["quantity"].as_u64().unwrap_or_default());
            if job["state"] != "done" || job["good"] != quantity || pieces(id) != quantity {
                return Err(format!("{} completed runs of {job}", pieces(id)));
            }
            found.insert(id.to_owned(), quantity);
        }
        match self.promised.iter().find(|(id, quantity)| found.get(*id) != Some(quantity)) {
            Some((lost, quantity)) => Err(format!("{lost} of {quantity} pieces is not there: {found:?}")),
            None => Ok(()),
        }
    }
}

fn case(seed: u64) -> Result<String, String> {
    let mut shop = Shop::new(seed);
    let played = (0..MOMENTS).try_for_each(|_| shop.moment());
    let judged = played.and_then(|()| shop.finish()).and_then(|()| shop.judge());
    judged.map(|()| "every piece once".into()).map_err(|why| format!("seed {seed}: {why}"))
}

#[test]
fn every_piece_of_every_job_is_cut_once_whatever_is_killed() {
    run_cases(2, 2, case, || format!("{} kills", KILLS.load(Ordering::Relaxed)));
    assert!(KILLS.load(Ordering::Relaxed) > 10, "something was killed");
}
