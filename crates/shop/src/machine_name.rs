//! Name of a machine in a shop.
//!
//! Invariant: a name is valid in file names, and in subjects and topics of brokers (SHP-7).

use std::fmt;
use std::str::FromStr;

use retrace_config::NumberedError;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Maximum length of a name in bytes.
const MAX_NAME_BYTES: usize = 32;

/// Name of a machine: `[a-z0-9-]{1,32}`.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct MachineName(String);

impl MachineName {
    /// The name of the only machine of a shop without a shop file: `local`.
    #[must_use]
    pub fn local() -> Self {
        Self("local".into())
    }

    /// Parses the name that a person has given.
    ///
    /// # Errors
    /// `E5002` where it is not a name of a machine.
    pub fn parse(text: &str) -> Result<Self, NumberedError> {
        text.parse().map_err(|ParseMachineNameError| {
            let what = format!("`{}` is not a name of a machine", text.escape_default());
            NumberedError::new("E5002", what, "use 1 to 32 of the characters a to z, 0 to 9 and `-`, as in `mill-3`")
        })
    }

    /// The name as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for MachineName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// The text is not a name of a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParseMachineNameError;

impl fmt::Display for ParseMachineNameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a machine name has 1 to 32 of the characters a to z, 0 to 9 and `-`")
    }
}

impl std::error::Error for ParseMachineNameError {}

impl FromStr for MachineName {
    type Err = ParseMachineNameError;

    fn from_str(text: &str) -> Result<Self, ParseMachineNameError> {
        let is_letter = |byte: u8| matches!(byte, b'a'..=b'z' | b'0'..=b'9' | b'-');
        let is_name = (1..=MAX_NAME_BYTES).contains(&text.len()) && text.bytes().all(is_letter);
        if is_name { Ok(Self(text.into())) } else { Err(ParseMachineNameError) }
    }
}

impl Serialize for MachineName {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(&self.0)
    }
}

impl<'de> Deserialize<'de> for MachineName {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        String::deserialize(from)?.parse().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_valid_in_file_names_and_subjects() {
        for good in ["a", "mill-3", "0", "-", &"x".repeat(32)] {
            assert!(MachineName::parse(good).is_ok(), "{good}");
        }
        for bad in ["", "Mill", "a.b", "..", "a/b", "a b", "ä", "a\n", &"x".repeat(33)] {
            assert_eq!(MachineName::parse(bad).expect_err(bad).number, "E5002");
        }
    }
}
