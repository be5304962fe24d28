//! Result of a sense test (CUT-57).
//!
//! Invariant: a position is given only where a contact has found the sheet.

use retrace_link::CutterOffCause;

/// Result of a sense test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SenseOutcome {
    /// The sheet was found.
    Found {
        /// Position of its surface, mm in machine coordinates of the tool axis.
        mm: f64,
    },
    /// No contact has closed down to the lowest place.
    NoSheet,
    /// A contact was closed where no sheet is, or did not open again.
    Contact,
    /// The operator has ended the test.
    Cancelled,
}

impl SenseOutcome {
    /// The result where the card has ended the test for this cause.
    pub(crate) const fn without_sheet(cause: CutterOffCause) -> Self {
        match cause {
            CutterOffCause::NoSheet => Self::NoSheet,
            CutterOffCause::SheetContact => Self::Contact,
            _ => Self::Cancelled,
        }
    }

    /// Name of the result as an identifier.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Found { .. } => "sheet_found",
            Self::NoSheet => "no_sheet",
            Self::Contact => "sheet_contact",
            Self::Cancelled => "cancelled",
        }
    }

    /// Position of the sheet in mm, if it was found.
    #[must_use]
    pub const fn position_mm(self) -> Option<f64> {
        match self {
            Self::Found { mm } => Some(mm),
            _ => None,
        }
    }

    /// The result in words; `axis` is the letter of the tool axis.
    #[must_use]
    pub fn text(self, axis: char) -> String {
        match self {
            Self::Found { mm } => format!("the sheet is at machine {} {mm:.3} mm", axis.to_ascii_uppercase()),
            Self::NoSheet => "no sheet was found: check `sheet_mm` and `below_mm`, and the contacts".into(),
            Self::Contact => "a contact is closed without the sheet, or does not open: check its input".into(),
            Self::Cancelled => "ended by the operator".into(),
        }
    }
}
