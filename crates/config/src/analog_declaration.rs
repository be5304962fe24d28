//! What the tables of the analog outputs and inputs have in common: a number, a name and a unit.
//!
//! Invariant: numbers and names of a kind differ, and no name or unit is empty.

use crate::numbered_error::NumberedError;

/// Number, name and unit of an analog output or input.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AnalogDeclaration<'a> {
    /// Number, that behind E.
    pub number: u8,
    /// Name.
    pub name: &'a str,
    /// Unit of the values.
    pub unit: &'a str,
}

impl AnalogDeclaration<'_> {
    /// Checks the declaration of a `kind`, `output` or `input`, of which cards have at most `count`, against those
    /// before it.
    ///
    /// # Errors
    /// `E2112`: there is no such number, or number, name or unit cannot be used.
    pub(crate) fn check<'b>(
        self,
        kind: &str,
        count: usize,
        mut before: impl Iterator<Item = (u8, &'b str)> + Clone,
    ) -> Result<(), NumberedError> {
        let refuse = |what: &str, remedy: &str| {
            let cause = format!("card.analog_{kind} {}: {what}", self.number);
            Err(NumberedError::new("E2112", cause, remedy))
        };
        if usize::from(self.number) >= count {
            return refuse(
                &format!("there is no such {kind}"),
                &format!("a number from 0 to {}", count.saturating_sub(1)),
            );
        }
        if before.clone().any(|(number, _)| number == self.number) {
            return refuse("declared twice", &format!("one table for each {kind}"));
        }
        for (what, text) in [("name", self.name), ("unit", self.unit)] {
            if text.trim().is_empty() || text.chars().any(char::is_control) {
                return refuse(&format!("{what} is empty or has control characters"), "a text of its own");
            }
        }
        if before.any(|(_, name)| name.eq_ignore_ascii_case(self.name)) {
            return refuse("the name is used twice", "one name each");
        }
        Ok(())
    }
}
