//! Source of contours for cycles of the third kind (PRE-4, PRE-8).
//!
//! Invariant: reading a contour moves and switches nothing.

use super::interpreter_core::Core;
use crate::path_cache::PlannedContour;
use retrace_cycles::{StockCall, StockPathError};

/// Source of contours.
pub(crate) trait Contours {
    /// Returns the path of CYCLE95 along a contour.
    ///
    /// # Errors
    /// The control's alarm.
    fn stock(&self, core: &Core, call: &StockCall<'_>) -> Result<PlannedContour, StockPathError>;
}

/// A source without contours: a modal cycle has none.
pub(crate) struct NoContours;

impl Contours for NoContours {
    fn stock(&self, _: &Core, _: &StockCall<'_>) -> Result<PlannedContour, StockPathError> {
        Err(StockPathError { alarm: 61606, text: "a modal cycle cannot read a contour".to_owned() })
    }
}
