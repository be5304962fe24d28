//! The jobs of the shop that this machine has, as a screen shows them (SHP-36).
//!
//! Invariant: texts only. Whoever fills the table has read the ledger; a start is decided there again, not by what is
//! shown here.

/// Jobs of the shop at this machine.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ShopJobTable {
    /// Name of the machine in the shop.
    pub machine: String,
    /// Machine file that this screen runs with.
    pub machine_file: String,
    /// The jobs, in the order in which they were submitted.
    pub rows: Vec<ShopJobRow>,
    /// Number of jobs that are not listed.
    pub hidden: usize,
    /// Why the jobs cannot be read; empty where they were.
    pub error: String,
}

/// A job of the shop.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ShopJobRow {
    /// Name of the job.
    pub id: String,
    /// State in a word.
    pub state: &'static str,
    /// Whether its next piece can be started.
    pub is_ready: bool,
    /// Name of the program.
    pub program: String,
    /// Number of good pieces.
    pub good: u32,
    /// Number of pieces that were ordered.
    pub quantity: u32,
    /// Most pieces that one start may run: 1 where the job permits no series.
    pub most_pieces: u32,
    /// Result of the check, in words.
    pub check: String,
    /// Who has submitted it.
    pub submitter: String,
    /// Number of the office's order; may be empty.
    pub order_number: String,
    /// Text for the operator.
    pub note: String,
    /// The material, as text.
    pub material: String,
    /// What the operator should know before a start, in sentences.
    pub warnings: Vec<String>,
    /// Details, as names and texts: diagnostics of the check, runs, the next step. A row without a name continues the
    /// one before.
    pub details: Vec<(String, String)>,
}

impl ShopJobRow {
    /// What the operator confirms before a piece is started, as names and texts; `machine_file` is that of the screen.
    #[must_use]
    pub fn start_facts(&self, machine_file: &str) -> Vec<(&'static str, String)> {
        let or_none = |text: &String| if text.is_empty() { "(none)".into() } else { text.clone() };
        let mut facts = vec![
            ("program", self.program.clone()),
            ("piece", format!("{} of {}", self.good.saturating_add(1), self.quantity)),
            ("material", or_none(&self.material)),
            ("note", or_none(&self.note)),
            ("machine file", machine_file.to_owned()),
        ];
        if !self.order_number.is_empty() {
            facts.insert(2, ("order", self.order_number.clone()));
        }
        facts.extend(self.warnings.iter().map(|warning| ("WARNING", warning.clone())));
        facts
    }
}
