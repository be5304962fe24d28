//! Properties of a compiled cycle: name, kind, parameters, attributes.
//!
//! Invariant: nothing here changes once a library is open.

use crate::code::Unit;
use crate::parameter::Parameter;
use std::fmt;
use std::path::{Path, PathBuf};

/// Identifier of a cycle in a [`crate::CycleLibrary`]; valid for that library only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CycleId(pub(crate) u16);

/// Kind of a cycle (PRE-2, PRE-3, PRE-4).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// No parameters: compiled completely.
    Plain,
    /// Parameters, none of which is a contour: compiled with slots for the parameters and for the caller's state.
    Parameters,
    /// A contour subprogram among the parameters, with its index from 0. The pre-scan reads the contour.
    Contour(usize),
}

impl Kind {
    /// Returns 1, 2 or 3, as the requirements number the kinds.
    #[must_use]
    pub const fn number(self) -> u8 {
        match self {
            Self::Plain => 1,
            Self::Parameters => 2,
            Self::Contour(_) => 3,
        }
    }
}

/// Origin of a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// Shipped with retrace.
    Shipped,
    /// A source of the user's folder.
    User,
}

/// Argument of a call, before its value is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArgumentKind {
    /// An empty argument.
    Empty,
    /// A number.
    Number,
    /// A text.
    Text,
}

/// A compiled cycle.
#[derive(Clone, Debug)]
pub struct Cycle {
    pub(crate) unit: Unit,
    /// The cycles that its calls name, in the order of the unit's calls.
    pub(crate) callees: Vec<CycleId>,
    pub(crate) kind: Kind,
    pub(crate) origin: Origin,
    pub(crate) path: PathBuf,
    pub(crate) is_from_cache: bool,
}

impl Cycle {
    /// Returns the name, in capitals.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.unit.name
    }

    /// Returns the parameters, in the order of the call.
    #[must_use]
    pub fn parameters(&self) -> &[Parameter] {
        &self.unit.parameters
    }

    /// Returns the kind: with or without parameters, or with a contour among them.
    #[must_use]
    pub const fn kind(&self) -> Kind {
        self.kind
    }

    /// Returns whether the cycle is shipped or the user's.
    #[must_use]
    pub const fn origin(&self) -> Origin {
        self.origin
    }

    /// Returns why a call with these arguments is wrong, or `None` if it is right. It serves the check of a program
    /// before it runs.
    pub fn argument_mismatch(&self, given: impl IntoIterator<Item = ArgumentKind>) -> Option<String> {
        argument_mismatch(&self.unit, given)
    }

    /// Returns the source: a path, or the name of a shipped cycle.
    #[must_use]
    pub fn source(&self) -> &Path {
        &self.path
    }

    /// Whether the compiled form was loaded from the folder rather than compiled now.
    #[must_use]
    pub const fn is_from_cache(&self) -> bool {
        self.is_from_cache
    }

    /// Whether the modal state of the caller is restored at the end (`SAVE`).
    #[must_use]
    pub const fn saves(&self) -> bool {
        self.unit.saves
    }

    /// Whether its blocks with axis words call the caller's modal cycle (`PATTERN`; HOLES1, HOLES2).
    #[must_use]
    pub const fn is_pattern(&self) -> bool {
        self.unit.is_pattern
    }
}

impl fmt::Display for Cycle {
    /// Writes the head of the cycle, as in its PROC line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())?;
        if self.parameters().is_empty() {
            return Ok(());
        }
        for (index, parameter) in self.parameters().iter().enumerate() {
            f.write_str(if index == 0 { "(" } else { ", " })?;
            write!(f, "{} {}", parameter.value_type, parameter.name)?;
        }
        f.write_str(")")
    }
}

/// Returns why arguments do not fit a unit's parameters, or `None` if they do.
pub(crate) fn argument_mismatch(callee: &Unit, given: impl IntoIterator<Item = ArgumentKind>) -> Option<String> {
    let (name, most) = (&callee.name, callee.parameters.len());
    for (index, given) in given.into_iter().enumerate() {
        let Some(parameter) = callee.parameters.get(index) else {
            return Some(format!("{name} accepts at most {most} arguments"));
        };
        let fits = match given {
            ArgumentKind::Empty => true,
            ArgumentKind::Number => !parameter.value_type.is_text(),
            ArgumentKind::Text => parameter.value_type.is_text(),
        };
        if !fits {
            return Some(format!("{name}: {} needs {}", parameter.name, parameter.value_type));
        }
    }
    None
}
