//! What is known of a compiled cycle without running it: its name, its kind, its parameters, its attributes.
//!
//! Invariant: nothing here changes once a library is open.

use crate::code::Unit;
use std::fmt;
use std::path::{Path, PathBuf};

/// A cycle of a [`crate::Library`]; it is valid for that library only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CycleId(pub(crate) u16);

/// Types of the language.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Type {
    /// A number.
    Real,
    /// A whole number; what is assigned is rounded.
    Int,
    /// 0 or 1; what is assigned is 1 unless it is 0.
    Bool,
    /// A text of at most so many bytes.
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
    /// Its name, in capitals.
    pub name: String,
    /// Its type.
    pub of: Type,
    /// Value where the call gives none; a text is empty then.
    pub default: f64,
}

/// The three kinds of cycles (PRE-2, PRE-3, PRE-4).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// No parameters: compiled completely.
    Plain,
    /// Parameters, none of which is a contour: compiled with slots for the parameters and for the caller's state.
    Parameters,
    /// A contour subprogram among the parameters; which one, from 0. The pre-scan reads the contour.
    Contour(usize),
}

impl Kind {
    /// 1, 2 or 3, as the requirements number them.
    #[must_use]
    pub const fn number(self) -> u8 {
        match self {
            Self::Plain => 1,
            Self::Parameters => 2,
            Self::Contour(_) => 3,
        }
    }
}

/// Where a cycle comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// It came with retrace.
    Shipped,
    /// A source of the user's folder.
    User,
}

/// What a call gives for a parameter, before its value is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Given {
    /// An empty place.
    Nothing,
    /// A number.
    Number,
    /// A text.
    Text,
}

/// A compiled cycle.
#[derive(Clone, Debug)]
pub struct Cycle {
    pub(crate) unit: Unit,
    /// The cycles that its calls mean, in the order of the unit's calls.
    pub(crate) callees: Vec<CycleId>,
    pub(crate) kind: Kind,
    pub(crate) origin: Origin,
    pub(crate) path: PathBuf,
    pub(crate) was_fresh: bool,
}

impl Cycle {
    /// Its name, in capitals.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.unit.name
    }

    /// Its parameters, in the order of the call.
    #[must_use]
    pub fn parameters(&self) -> &[Parameter] {
        &self.unit.parameters
    }

    /// With or without parameters, or with a contour among them.
    #[must_use]
    pub const fn kind(&self) -> Kind {
        self.kind
    }

    /// Shipped, or the user's.
    #[must_use]
    pub const fn origin(&self) -> Origin {
        self.origin
    }

    /// How a call with these arguments does not fit, if it does not: for whoever checks a program before it runs.
    pub fn misfit(&self, given: impl IntoIterator<Item = Given>) -> Option<String> {
        misfit(&self.unit, given)
    }

    /// Its source: a path, or its name for a shipped one.
    #[must_use]
    pub fn source(&self) -> &Path {
        &self.path
    }

    /// Was its compiled form taken from the folder, and not compiled now?
    #[must_use]
    pub const fn was_fresh(&self) -> bool {
        self.was_fresh
    }

    /// `SAVE`: the modal state of the caller is restored at the end.
    #[must_use]
    pub const fn saves(&self) -> bool {
        self.unit.saves
    }

    /// `PATTERN`: its blocks with axis words call the caller's modal cycle (HOLES1, HOLES2).
    #[must_use]
    pub const fn is_pattern(&self) -> bool {
        self.unit.is_pattern
    }
}

impl fmt::Display for Cycle {
    /// The head of the cycle as its PROC line has it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())?;
        if self.parameters().is_empty() {
            return Ok(());
        }
        for (index, parameter) in self.parameters().iter().enumerate() {
            f.write_str(if index == 0 { "(" } else { ", " })?;
            write!(f, "{} {}", parameter.of, parameter.name)?;
        }
        f.write_str(")")
    }
}

/// How arguments do not fit a unit's parameters, if they do not.
pub(crate) fn misfit(callee: &Unit, given: impl IntoIterator<Item = Given>) -> Option<String> {
    let (name, most) = (&callee.name, callee.parameters.len());
    for (index, given) in given.into_iter().enumerate() {
        let Some(parameter) = callee.parameters.get(index) else {
            return Some(format!("{name} takes no more than {most} arguments"));
        };
        let fits = match given {
            Given::Nothing => true,
            Given::Number => !parameter.of.is_text(),
            Given::Text => parameter.of.is_text(),
        };
        if !fits {
            return Some(format!("{name}: {} needs {}", parameter.name, parameter.of));
        }
    }
    None
}
