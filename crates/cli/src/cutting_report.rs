//! Sensings, consumable starts, abrasive and cost of a program in the report of `retrace check` (CUT-60).
//!
//! Invariant: a cost is reported where the machine file has a rate for it, and from the figures of the same report.

use std::fmt::Write as _;

use retrace_config::{CutterKind, MachineConfig, ProgramCost};
use retrace_controller::ProgramAnalysis;
use serde_json::{Map, Value, json};

/// Figures of a cutting program.
pub struct CuttingReport<'a> {
    machine: &'a MachineConfig,
    sensings: u64,
    /// Names of the torches that are started, each with the number of its starts.
    consumable_starts: Vec<(&'a str, u64)>,
    abrasive_s: f64,
    /// Mass of the abrasive whose flow is known.
    known_abrasive_kg: f64,
    /// Whether there is abrasive whose flow is not known.
    has_unknown_abrasive: bool,
    cost: Option<ProgramCost>,
    /// Whether the cost is a part of the whole cost.
    is_cost_partial: bool,
}

impl<'a> CuttingReport<'a> {
    /// Figures of a program that takes this time.
    pub fn new<const A: usize>(machine: &'a MachineConfig, analysis: &'a ProgramAnalysis<'_, A>, total_s: f64) -> Self {
        let contours = &analysis.scan.contours;
        // A jet and a beam have nothing that wears with the number of starts.
        let wears = |name: &str| machine.cutters.iter().any(|one| one.name == name && one.kind == CutterKind::Torch);
        let starts = contours.starts.iter().filter(|(name, _)| wears(name));
        let known_abrasive_kg = analysis.abrasive.known_kg(machine.period_s());
        let cost = machine
            .cost
            .as_ref()
            .map(|rates| rates.of_program(total_s, contours.count, contours.cut_mm(), known_abrasive_kg));
        let has_unknown_abrasive = analysis.abrasive.has_unknown();
        let lacks_abrasive = has_unknown_abrasive && cost.is_some_and(|cost| cost.abrasive.is_some());
        Self {
            machine,
            sensings: analysis.sensings,
            consumable_starts: starts.map(|(name, &starts)| (name.as_str(), starts)).collect(),
            abrasive_s: analysis.abrasive.periods() as f64 * machine.period_s(),
            known_abrasive_kg,
            has_unknown_abrasive,
            cost,
            is_cost_partial: analysis.is_time_partial || lacks_abrasive,
        }
    }

    /// Figures as text, a line each; empty where there are none.
    pub fn text(&self) -> String {
        let mut figures = Vec::new();
        if self.sensings > 0 {
            figures.push(format!("sensings {}", self.sensings));
        }
        for (name, starts) in &self.consumable_starts {
            figures.push(format!("consumable starts of {}: {starts}", crate::escape::name(name)));
        }
        if self.abrasive_s > 0.0 {
            figures.push(if self.has_unknown_abrasive {
                let which = "abrasive_g_per_min of the material or the cutter is missing";
                format!("abrasive of unknown flow ({which}) for {:.3} s", self.abrasive_s)
            } else {
                format!("abrasive {:.3} kg in {:.3} s", self.known_abrasive_kg, self.abrasive_s)
            });
        }
        let mut text = String::new();
        // Writing to a string cannot fail.
        if !figures.is_empty() {
            let _ = write!(text, "\n  {}", figures.join(" · "));
        }
        if let Some(cost) = self.cost {
            let currency = self.machine.cost.as_ref().map_or("", |rates| rates.currency.as_str());
            let space = if currency.is_empty() { "" } else { " " };
            let part = if self.is_cost_partial { "at least " } else { "" };
            let _ = write!(text, "\n  cost: {part}{:.2}{space}{}", cost.total(), crate::escape::name(currency));
            let items =
                [("time", cost.time), ("pierces", cost.pierces), ("cut", cost.cut), ("abrasive", cost.abrasive)];
            let items = items.iter().filter_map(|(what, amount)| Some(format!("{what} {:.2}", (*amount)?)));
            let items: Vec<String> = items.collect();
            if items.len() > 1 {
                let _ = write!(text, ": {}", items.join(" · "));
            }
        }
        text
    }

    /// Figures for a script, to be added to those of the whole report.
    pub fn json(&self) -> Map<String, Value> {
        let starts = self.consumable_starts.iter().map(|(name, starts)| json!({ "cutter": name, "starts": starts }));
        let cost = self.cost.map(|cost| {
            json!({
                "currency": self.machine.cost.as_ref().map(|rates| &rates.currency),
                "time": cost.time,
                "pierces": cost.pierces,
                "cut": cost.cut,
                "abrasive": cost.abrasive,
                "total": cost.total(),
                "is_partial": self.is_cost_partial,
            })
        });
        let fields = [
            ("sensings", json!(self.sensings)),
            ("consumable_starts", starts.collect()),
            ("abrasive_s", json!(self.abrasive_s)),
            ("abrasive_kg", json!((!self.has_unknown_abrasive).then_some(self.known_abrasive_kg))),
            ("cost", cost.into()),
        ];
        fields.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
    }
}
