//! Outcome of one check by one engine, and the list of engines.
//!
//! Invariant: only CBMC and Kani can report `Proved`.

use std::sync::Mutex;

/// An engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Engine {
    Native,
    Stub,
    Loom,
    Shuttle,
    Cbmc,
    Kani,
    Mutants,
    CbmcMutants,
    Miri,
    Tsan,
}

impl Engine {
    /// All of them, in the order in which they are run.
    pub(crate) const ALL: [Self; 10] = [
        Self::Native,
        Self::Stub,
        Self::Loom,
        Self::Shuttle,
        Self::Cbmc,
        Self::Kani,
        Self::Mutants,
        Self::CbmcMutants,
        Self::Miri,
        Self::Tsan,
    ];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Native => "native",
            Self::Stub => "stub",
            Self::Loom => "loom",
            Self::Shuttle => "shuttle",
            Self::Cbmc => "cbmc",
            Self::Kani => "kani",
            Self::Mutants => "mutants",
            Self::CbmcMutants => "cbmc-mutants",
            Self::Miri => "miri",
            Self::Tsan => "tsan",
        }
    }

    pub(crate) fn purpose(self) -> &'static str {
        match self {
            Self::Native => "every harness over enumerated or drawn choices, every search",
            Self::Stub => "the Kani harnesses compile against a stub of the kani crate, and run on drawn values",
            Self::Loom => "thread models under loom: every execution of weak memory up to a preemption bound",
            Self::Shuttle => "thread models under shuttle: drawn schedules",
            Self::Cbmc => "every harness proved by CBMC over wasm32",
            Self::Kani => "the harnesses in Kani's list proved by Kani",
            Self::Mutants => "every mutant is noticed by the check it names",
            Self::CbmcMutants => "mutants whose killer is a harness are refuted by CBMC too",
            Self::Miri => "the ring's tests under miri: undefined behaviour, by name only",
            Self::Tsan => "the ring's tests under the thread sanitizer: data races, by name only",
        }
    }

    pub(crate) fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|engine| engine.name() == name)
    }
}

/// Result of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// CBMC or Kani proved it in this run.
    Proved,
    /// It ran and found nothing; a mutant was killed.
    Passed,
    /// It did not end in the time limit; in a quick run that is not a failure.
    Open,
    /// It found something, or could not be run at all.
    Failed,
}

impl Verdict {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Proved => "proved",
            Self::Passed => "passed",
            Self::Open => "open",
            Self::Failed => "FAILED",
        }
    }
}

/// One check by one engine.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Outcome {
    pub(crate) engine: Engine,
    /// The harness, search, model test or mutant; empty where the engine as a whole is meant.
    pub(crate) check: String,
    pub(crate) verdict: Verdict,
    pub(crate) words: String,
    pub(crate) seconds: f64,
}

/// One line of a terminal, about. A failure is shown whole at the end, everything in the ledger.
fn shortened(words: &str) -> String {
    const ENOUGH: usize = 160;
    let line = words.lines().next().unwrap_or_default();
    let is_whole = line.len() == words.len() && line.chars().count() <= ENOUGH;
    if is_whole { line.to_owned() } else { line.chars().take(ENOUGH).collect::<String>() + " …" }
}

/// Outcomes so far, printed as they arrive.
#[derive(Default)]
pub(crate) struct Log(Mutex<Vec<Outcome>>);

impl Log {
    /// Prints an outcome and stores it.
    pub(crate) fn tell(&self, outcome: Outcome) {
        let Outcome { engine, check, words, seconds, .. } = &outcome;
        println!("{:<12} {check:<28} {}  ({seconds:.1} s)", engine.name(), shortened(words));
        if let Ok(mut outcomes) = self.0.lock() {
            outcomes.push(outcome);
        }
    }

    /// Reports an engine that could not run.
    pub(crate) fn broken(&self, engine: Engine, reason: impl Into<String>) {
        let words = format!("ERROR: {}", reason.into());
        self.tell(Outcome { engine, check: String::new(), verdict: Verdict::Failed, words, seconds: 0.0 });
    }

    /// All outcomes so far.
    pub(crate) fn outcomes(&self) -> Vec<Outcome> {
        self.0.lock().map(|outcomes| outcomes.clone()).unwrap_or_default()
    }
}
