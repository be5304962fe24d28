//! Types of the language, and the parameters of a cycle.
//!
//! Invariant: a text has a bounded length.

use std::fmt;

/// Types of the language.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Type {
    /// A number.
    Real,
    /// A whole number; an assigned value is rounded.
    Int,
    /// 0 or 1; an assigned value becomes 1 unless it is 0.
    Bool,
    /// A text of at most this many bytes.
    Text(u16),
}

impl Type {
    pub(crate) const fn is_text(self) -> bool {
        matches!(self, Self::Text(_))
    }
}

impl fmt::Display for Type {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Real => f.write_str("REAL"),
            Self::Int => f.write_str("INT"),
            Self::Bool => f.write_str("BOOL"),
            Self::Text(length) => write!(f, "STRING[{length}]"),
        }
    }
}

/// A parameter of the PROC line.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Name, in capitals.
    pub name: String,
    /// Type of the parameter.
    pub value_type: Type,
    /// Value if the call passes none; a text is empty then.
    pub default: f64,
}
