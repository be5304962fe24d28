//! A shop of many machines around a nats-server; server, host, agents, runs and whole machines are killed at any
//! moment: every job is held by one machine and cut in its quantity, none twice, and none is lost (SHP-6, SHP-10,
//! SHP-17).
//!
//! The number of cases is that of the jobs; there are half as many machines, at most 50.

use std::collections::BTreeMap;
use std::process::{Child, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use retrace_tests::case_runner::first_seed;
use retrace_tests::command::{Bench, cases};
use retrace_tests::sender::TestRandom;
use retrace_tests::shop_broker::ShopBroker;
use serde_json::Value;

/// Most runs at a time.
const RUNS: usize = 2;

/// A job that a machine has.
#[derive(Clone, Debug)]
struct HeldJob {
    id: String,
    machine: String,
    state: String,
    good: u64,
}

struct Shop<'a> {
    bench: &'a Bench,
    broker: ShopBroker<'a>,
    machines: Vec<String>,
    chance: TestRandom,
    /// Jobs whose names were printed, with their pieces.
    promised: BTreeMap<String, u64>,
    programs: usize,
    /// What the machines had when it was looked at last.
    held: Vec<HeldJob>,
    runs: Vec<(String, Child)>,
    started: usize,
    kills: BTreeMap<&'static str, u32>,
}

impl Shop<'_> {
    fn submit(&mut self) {
        self.programs += 1;
        let name = format!("part{}.ngc", self.programs);
        let path = self.bench.file(&name, format!("G21 G90 F3000\nG1 X{}\nG1 X0 Y0\nM2\n", self.programs % 400));
        let path = path.to_str().expect("a name").to_owned();
        let target = match self.chance.below(4) {
            0 => ["--group".to_owned(), "all".to_owned()],
            _ => ["--machine".to_owned(), self.machines[self.chance.below(self.machines.len())].clone()],
        };
        let quantity = 1 + u64::from(self.chance.below(8) == 0);
        let pieces = quantity.to_string();
        let id = self.broker.done("host", &["submit", &path, &target[0], &target[1], "--quantity", &pieces]);
        self.promised.insert(id.trim().to_owned(), quantity);
    }

    fn kill_server(&mut self) {
        self.broker.kill_server();
        sleep(Duration::from_millis(self.chance.below(400) as u64));
        self.broker.start_server();
    }

    fn kill_agent(&mut self, computer: &str) {
        self.broker.kill_agent(computer);
        sleep(Duration::from_millis(self.chance.below(50) as u64));
        self.broker.start_agent(computer);
    }

    fn any_machine(&mut self) -> String {
        self.machines[self.chance.below(self.machines.len())].clone()
    }

    /// Kills the runs, those of one machine or all.
    fn kill_runs(&mut self, machine: Option<&str>) -> u32 {
        let mut killed = 0;
        for (_, child) in self.runs.iter_mut().filter(|(of, _)| machine.is_none_or(|machine| of == machine)) {
            killed += u32::from(child.try_wait().expect("a child").is_none());
            child.kill().expect("it is killed");
            child.wait().expect("it ends");
        }
        self.runs.retain_mut(|(_, child)| child.try_wait().expect("a child").is_none());
        killed
    }

    /// Starts a run of a job that a machine has, as its operator does.
    fn start_run(&mut self) {
        self.runs.retain_mut(|(_, child)| child.try_wait().expect("a child").is_none());
        if self.runs.len() >= RUNS {
            return;
        }
        let is_free = |job: &&HeldJob| !self.runs.iter().any(|(machine, _)| *machine == job.machine);
        let can_be = |job: &&HeldJob| matches!(job.state.as_str(), "ready" | "interrupted");
        let Some(job) = self.held.iter().filter(is_free).find(can_be).cloned() else { return };
        self.held.retain(|held| held.id != job.id);
        let file = self.broker.shop_file(&job.machine);
        let arguments = match job.state.as_str() {
            "ready" => {
                vec!["run".to_owned(), "--job".into(), job.id.clone(), "--shop-file".into(), file, "--json".into()]
            }
            _ => {
                let shown = self.broker.done(&job.machine, &["show", &job.id, "--json"]);
                let shown: Value = serde_json::from_str(&shown).expect("one object");
                let mut runs = shown["runs"].as_array().cloned().unwrap_or_default().into_iter();
                let Some(run) = runs.find(|run| run["state"] == "interrupted") else { return };
                vec!["resume".to_owned(), run["id"].as_str().expect("a name").into(), "--yes".into(), "--json".into()]
            }
        };
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        self.started += usize::from(arguments[0] == "run");
        self.runs.push((job.machine, self.bench.start(&arguments, Stdio::null(), "run.txt")));
    }

    /// Looks at what the machines have. Returns the faults of the audit.
    fn look(&mut self) -> Value {
        let result = self.broker.retrace("host", &["audit", "--json", "--root", &self.root()]);
        let audit: Value = serde_json::from_str(&result.out).unwrap_or_else(|error| panic!("{error}: {}", result.err));
        let text = |job: &Value, key: &str| job[key].as_str().expect("a text").to_owned();
        let job = |job: &Value| HeldJob {
            id: text(job, "id"),
            machine: text(job, "machine"),
            state: text(job, "state"),
            good: job["good"].as_u64().expect("a number"),
        };
        self.held = audit["jobs"].as_array().expect("a list").iter().map(job).collect();
        audit["faults"].clone()
    }

    fn root(&self) -> String {
        self.bench.path("state/retrace/shop").to_str().expect("a name").to_owned()
    }

    /// One thing that happens.
    fn moment(&mut self, jobs: usize) {
        match self.chance.below(12) {
            0..4 if self.programs < jobs => self.submit(),
            4 => {
                self.kill_server();
                *self.kills.entry("server").or_default() += 1;
            }
            5 => {
                let machine = self.any_machine();
                self.kill_agent(&machine);
                *self.kills.entry("agent").or_default() += 1;
            }
            6 => {
                self.kill_agent("host");
                *self.kills.entry("host").or_default() += 1;
            }
            7 => *self.kills.entry("run").or_default() += self.kill_runs(None),
            8 => {
                let machine = self.any_machine();
                self.kill_runs(Some(&machine));
                self.kill_agent(&machine);
                *self.kills.entry("machine").or_default() += 1;
            }
            9 => {
                self.look();
            }
            _ => self.start_run(),
        }
        sleep(Duration::from_millis(self.chance.below(60) as u64));
    }

    /// Waits until every job that was promised is done.
    fn finish(&mut self, limit: Duration) -> Result<(), String> {
        let until = Instant::now() + limit;
        loop {
            self.look();
            let missing = self.promised.len() - self.held.iter().filter(|job| job.state == "done").count();
            if missing == 0 && self.runs.is_empty() {
                return Ok(());
            }
            if Instant::now() > until {
                let held: Vec<&HeldJob> = self.held.iter().filter(|job| job.state != "done").collect();
                let unknown: Vec<&String> =
                    self.promised.keys().filter(|id| !self.held.iter().any(|job| &job.id == *id)).collect();
                return Err(format!("{missing} are not done: {held:?}; no machine has {unknown:?}"));
            }
            for _ in 0..20 {
                self.start_run();
                sleep(Duration::from_millis(20));
            }
        }
    }

    fn judge(&mut self) -> Result<(), String> {
        let faults = self.look();
        if faults != Value::Array(Vec::new()) {
            return Err(format!("faults: {faults}"));
        }
        let journals = self.bench.retrace(["jobs", "--json", "--all"]).out;
        let journals: Value = serde_json::from_str(&journals).map_err(|error| error.to_string())?;
        let journals = journals["jobs"].as_array().cloned().unwrap_or_default();
        // nothing was started from afar
        if journals.len() > self.started {
            return Err(format!("{} runs were started, and there are {} journals", self.started, journals.len()));
        }
        // a journal is deleted when a hundred newer jobs were completed: the ledger has counted it then
        for (id, quantity) in &self.promised {
            let of =
                journals.iter().filter(|run| run["program"].as_str().is_some_and(|path| path.contains(id.as_str())));
            let completed = of.filter(|run| run["state"] == "completed").count() as u64;
            let good: Vec<u64> = self.held.iter().filter(|job| &job.id == id).map(|job| job.good).collect();
            if good != [*quantity] || completed > *quantity {
                return Err(format!("{id}: good pieces at each machine {good:?}, {completed} of {quantity} journals"));
            }
        }
        match self.held.len() == self.promised.len() {
            true => Ok(()),
            false => Err(format!("{} jobs were submitted, and {} are held", self.promised.len(), self.held.len())),
        }
    }
}

#[test]
fn every_job_of_a_shop_is_cut_once_whatever_is_killed() {
    let (jobs, seed, begun) = (cases(4) as usize, first_seed(), Instant::now());
    let machines: Vec<String> = (1..=(jobs / 2).clamp(2, 50)).map(|number| format!("m{number}")).collect();
    let names: Vec<&str> = machines.iter().map(String::as_str).collect();
    let bench = Bench::new();
    let group = format!("all={}", names.join(","));
    let test = "shop_broker::every_job_of_a_shop_is_cut_once_whatever_is_killed";
    let Some(mut broker) = ShopBroker::start(test, &bench, &names, &["--group", &group]) else { return };
    for computer in names.iter().chain(&["host"]) {
        broker.start_agent(computer);
    }
    let mut shop = Shop {
        bench: &bench,
        broker,
        machines,
        chance: TestRandom::new(seed),
        promised: BTreeMap::new(),
        programs: 0,
        held: Vec::new(),
        runs: Vec::new(),
        started: 0,
        kills: BTreeMap::new(),
    };
    let moments = if jobs < 100 { jobs * 5 } else { 2400.max(2 * jobs) };
    for _ in 0..moments {
        shop.moment(jobs);
    }
    while shop.programs < jobs {
        shop.submit();
    }
    let limit = Duration::from_secs(60 + jobs as u64);
    let judged = shop.finish(limit).and_then(|()| shop.judge());
    let (kills, took) = (&shop.kills, begun.elapsed().as_secs_f64());
    println!("{jobs} jobs of {} machines, seed {seed}, killed {kills:?}, {took:.0} s", shop.machines.len());
    if let Err(why) = judged {
        let logs: Vec<String> = shop.machines.iter().map(|name| format!("{name}: {}", shop.broker.log(name))).collect();
        panic!("seed {seed}: {why}\nhost: {}\n{}", shop.broker.log("host"), logs.join("\n"));
    }
}
