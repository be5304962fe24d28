//! What a machine reports: the newest messages of its socket, and its pieces.
//!
//! Invariant: a figure that was not reported is none, never 0.

use serde_json::Value;

/// An axis of the machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReportedAxis {
    /// Letter, lower case.
    pub letter: char,
    /// Whether its positions are mm; they are degrees otherwise.
    pub is_linear: bool,
}

/// The newest messages of a machine's socket.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MachineReport {
    state: Value,
    live: Value,
    block: Value,
    /// Name of the machine, while it reports.
    pub machine: Option<String>,
    /// Number of good pieces and of scrap since the ledger begins, where there is one.
    pub pieces: Option<[u64; 2]>,
    /// Job of the shop that is running, by the ledger.
    pub shop_job: Option<String>,
}

impl MachineReport {
    /// Takes a message; one of another kind is ignored.
    pub fn take(&mut self, message: Value) {
        match message["t"].as_str() {
            Some("machine") => self.machine = Some(message["name"].as_str().unwrap_or_default().to_owned()),
            Some("state") => self.state = message,
            Some("live") => self.live = message,
            Some("block") => self.block = message,
            _ => {}
        }
    }

    /// The machine reports no more: nothing but what the ledger has is known.
    pub fn forget(&mut self) {
        *self = Self { pieces: self.pieces, shop_job: self.shop_job.take(), ..Self::default() };
    }

    /// Whether the machine reports.
    #[must_use]
    pub fn is_available(&self) -> bool {
        !self.state.is_null()
    }

    /// Text of the state, such as `stage`.
    #[must_use]
    pub fn state(&self, key: &str) -> Option<&str> {
        self.state[key].as_str()
    }

    /// Figure of the state, such as `override`.
    #[must_use]
    pub fn state_number(&self, key: &str) -> Option<f64> {
        self.state[key].as_f64()
    }

    /// Name of the program; none where no program is loaded.
    #[must_use]
    pub fn program(&self) -> Option<&str> {
        self.state["program"]["name"].as_str().filter(|name| !name.is_empty())
    }

    /// Figure of the program, such as `planned_s`; none where no program is loaded.
    #[must_use]
    pub fn program_number(&self, key: &str) -> Option<f64> {
        self.program().and_then(|_| self.state["program"][key].as_f64())
    }

    /// Alarm: its number, and its cause. Orders that were refused are none.
    #[must_use]
    pub fn alarm(&self) -> Option<(&str, &str)> {
        let alarm = &self.state["alarm"];
        let number = alarm["number"].as_str().filter(|_| alarm["is_refusal"] != true)?;
        Some((number, alarm["cause"].as_str().unwrap_or_default()))
    }

    /// Whether a part of the state, such as `pause`, is there.
    #[must_use]
    pub fn has(&self, key: &str) -> bool {
        !self.state[key].is_null()
    }

    /// Live figure, such as `feed` in mm/min.
    #[must_use]
    pub fn live(&self, key: &str) -> Option<f64> {
        self.live[key].as_f64()
    }

    /// Whether the machine is at rest.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.live["at_rest"] == true
    }

    /// Position of an axis, by its index: of the machine (`mm`) or of the work (`work`).
    #[must_use]
    pub fn position(&self, of: &str, axis: usize) -> Option<f64> {
        self.live[of][axis].as_f64()
    }

    /// Program line under the tool, from 1.
    #[must_use]
    pub fn line(&self) -> Option<u64> {
        self.state["line"].as_u64().filter(|&line| line > 0)
    }

    /// Text of that line.
    #[must_use]
    pub fn block(&self) -> Option<&str> {
        self.block["text"].as_str()
    }

    /// Modal word of this letter, such as the F word `3000`.
    #[must_use]
    pub fn modal(&self, letter: char) -> Option<f64> {
        self.modal_words().find_map(|word| word.strip_prefix(letter))?.parse().ok()
    }

    /// Whether this modal code is in force.
    #[must_use]
    pub fn has_modal(&self, code: &str) -> bool {
        self.modal_words().any(|word| word == code)
    }

    /// What the machine does, in the words of MTConnect's `EXECUTION`.
    #[must_use]
    pub fn execution(&self) -> Option<&'static str> {
        if self.alarm().is_some() {
            return Some("STOPPED");
        }
        Some(match self.state("stage")? {
            "setup" => "READY",
            "ended" if self.state("why").is_some_and(|why| why.starts_with("completed")) => "PROGRAM_COMPLETED",
            "ended" => "STOPPED",
            "resuming" => "INTERRUPTED",
            _ if self.has("pause") || self.has("question") => "INTERRUPTED",
            _ => match (self.state("mode")?, self.state("hold_reason")?) {
                ("run", "hold") => "FEED_HOLD",
                ("run", "program stop") if self.state("program_stop") == Some("M1") => "OPTIONAL_STOP",
                ("run", "program stop") => "PROGRAM_STOPPED",
                ("run", "end of program") => "PROGRAM_COMPLETED",
                ("run", "none") if self.has("switching") || self.has("tool_change") => "WAIT",
                ("run", "none") => "ACTIVE",
                _ => "INTERRUPTED",
            },
        })
    }

    fn modal_words(&self) -> impl Iterator<Item = &str> {
        self.state["modal"].as_str().unwrap_or_default().split_whitespace()
    }
}
