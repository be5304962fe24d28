//! Findings of the check of a program.
//!
//! Invariant: each has a number in `docs/errors.md`, a cause and a remedy.

/// A finding of a check: an error, which prevents the run, or a warning.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckFinding {
    /// Program line.
    pub line: u32,
    /// Letter of the word that it is about, if any.
    pub word: Option<char>,
    /// Number in `docs/errors.md`.
    pub number: &'static str,
    /// Cause.
    pub cause: String,
    /// Remedy.
    pub remedy: String,
    /// Number of times that it was found again at the same place.
    pub more_rounds: u32,
}

/// Maximum number of findings.
const MAX_FINDINGS: usize = 100;

/// Findings, each number once for a place: loops and branches execute a line repeatedly (PRB-19).
#[derive(Clone, Debug, Default)]
pub struct FindingList(Vec<CheckFinding>);

impl FindingList {
    /// Adds a finding, or counts it where its number is known at its place.
    pub fn push(&mut self, finding: CheckFinding) {
        let place = |finding: &CheckFinding| (finding.line, finding.number, finding.word);
        let is_full = self.is_full();
        match self.0.iter_mut().find(|known| place(known) == place(&finding)) {
            Some(known) => known.more_rounds = known.more_rounds.saturating_add(1),
            None if is_full => {}
            None => self.0.push(finding),
        }
    }

    /// Whether no further findings are listed.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.0.len() >= MAX_FINDINGS
    }

    /// The findings.
    #[must_use]
    pub fn findings(&self) -> &[CheckFinding] {
        &self.0
    }

    /// Takes out the findings.
    #[must_use]
    pub fn into_findings(self) -> Vec<CheckFinding> {
        self.0
    }
}

/// Text behind a message that was repeated so many times: "and in 3 more rounds"; empty for 0.
#[must_use]
pub fn more_rounds_text(more_rounds: u32) -> String {
    match more_rounds {
        0 => String::new(),
        1 => ", and in 1 more round".to_owned(),
        more => format!(", and in {more} more rounds"),
    }
}

impl CheckFinding {
    /// Whether it prevents the program from being run. Otherwise it is a warning.
    #[must_use]
    pub fn is_error(&self) -> bool {
        self.number.starts_with('E')
    }
}
