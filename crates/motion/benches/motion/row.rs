//! One row of the table: a figure and its goal.
//!
//! Invariant: whether a row meets its goal depends on the row alone.

use std::fmt;

/// Goal of a figure.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Goal {
    AtMost(f64),
    AtLeast(f64),
    /// No goal: reported for comparison.
    None,
}

impl Goal {
    fn is_met_by(self, figure: f64) -> bool {
        match self {
            Self::AtMost(most) => figure <= most,
            Self::AtLeast(least) => figure >= least,
            Self::None => true,
        }
    }
}

/// A figure and its goal.
#[derive(Clone, Debug)]
pub(crate) struct Row {
    pub(crate) name: &'static str,
    pub(crate) what: String,
    pub(crate) figure: f64,
    pub(crate) unit: &'static str,
    pub(crate) goal: Goal,
    /// Conditions and origin of the figure.
    pub(crate) note: String,
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let goal = match self.goal {
            Goal::AtMost(most) => format!("≤ {most}"),
            Goal::AtLeast(least) => format!("≥ {least}"),
            Goal::None => "-".to_owned(),
        };
        let verdict = match self.goal {
            Goal::None => "-",
            goal if goal.is_met_by(self.figure) => "met",
            _ => "missed",
        };
        let unit = if self.unit.is_empty() { String::new() } else { format!(" {}", self.unit) };
        let Self { name, what, figure, note, .. } = self;
        write!(f, "row\t{name}\t{what}\t{}{unit}\t{goal}\t{verdict}\t{note}", short(*figure))
    }
}

/// Five digits; more where the figure is near 1, since ratios are compared there.
fn short(figure: f64) -> String {
    match figure.abs() {
        size if size != 0.0 && size < 1e-3 => format!("{figure:.2e}"),
        size if size < 10.0 => format!("{figure:.4}"),
        size if size < 1000.0 => format!("{figure:.1}"),
        _ => format!("{figure:.0}"),
    }
}

/// The middle value, or the mean of the two in the middle; NaN for no values.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => f64::NAN,
        even if even % 2 == 0 => 0.5 * (values[middle - 1] + values[middle]),
        _ => values[middle],
    }
}
