//! Range check of a number in the machine file.
//!
//! Invariant: NaN is out of every range.

use crate::numbered_error::NumberedError;

/// Checks that a value is from `least` to `greatest`. `key` names it in the message.
///
/// # Errors
/// `E2112`
pub(crate) fn within(key: &str, value: f64, least: f64, greatest: f64) -> Result<(), NumberedError> {
    if (least..=greatest).contains(&value) {
        return Ok(());
    }
    Err(NumberedError::new("E2112", format!("{key} = {value}"), format!("a number from {least} to {greatest}")))
}
