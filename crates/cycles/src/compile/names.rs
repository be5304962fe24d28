//! The variables of a cycle: parameters, definitions of DEF, and R parameters.
//!
//! Invariant: every variable has slots of its own within the frame.

use crate::code::{Function, Operator};
use crate::parameter::Type;
use std::collections::HashMap;

/// Number of R parameters.
pub(super) const R_PARAMETERS: u16 = 100;
/// Maximum number of slots of a frame.
const MAX_SLOTS: usize = 8000;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shape {
    Simple,
    /// Number of elements.
    Row(u16),
    /// Number of rows and columns.
    Table(u16, u16),
}

impl Shape {
    pub(super) const fn slots(self) -> usize {
        match self {
            Self::Simple => 1,
            Self::Row(length) => length as usize,
            Self::Table(rows, columns) => rows as usize * columns as usize,
        }
    }

    pub(super) const fn indices(self) -> usize {
        match self {
            Self::Simple => 0,
            Self::Row(_) => 1,
            Self::Table(..) => 2,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Variable {
    pub(super) slot: u16,
    pub(super) value_type: Type,
    pub(super) shape: Shape,
}

#[derive(Debug, Default)]
pub(super) struct Names {
    /// Variables by name, in capitals.
    variables: HashMap<String, Variable>,
    slots: u16,
    first_r: Option<u16>,
}

/// Words of the language that cannot be names of variables.
const KEYWORDS: &[&str] = &[
    "PROC",
    "DEF",
    "EXTERN",
    "IF",
    "ELSE",
    "ENDIF",
    "WHILE",
    "ENDWHILE",
    "FOR",
    "TO",
    "ENDFOR",
    "LOOP",
    "ENDLOOP",
    "REPEAT",
    "UNTIL",
    "GOTO",
    "GOTOF",
    "GOTOB",
    "RET",
    "MSG",
    "SETAL",
    "REAL",
    "INT",
    "BOOL",
    "STRING",
    "TRUE",
    "FALSE",
    "AX",
    "IP",
    "CR",
    "SPOS",
    "DIAMON",
    "DIAMOF",
    "STOCKPATH",
    "SET",
    "R",
    "SAVE",
    "MCALL",
];

impl Names {
    pub(super) fn slots(&self) -> u16 {
        self.slots
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.get(name).is_some()
    }

    pub(super) fn get(&self, name: &str) -> Option<Variable> {
        // Names are short; most are in capitals already.
        self.variables.get(name).or_else(|| self.variables.get(&name.to_ascii_uppercase())).copied()
    }

    /// Whether this is a word of the language, which cannot be the name of a variable.
    pub(super) fn is_word_of_the_language(name: &str) -> bool {
        KEYWORDS.contains(&name)
            || name.starts_with('$')
            || Function::named(name).is_some()
            || Operator::named(name).is_some()
    }

    /// Defines a variable; `None` where the frame is full.
    pub(super) fn define(&mut self, name: &str, value_type: Type, shape: Shape) -> Option<Variable> {
        let slot = self.reserve(shape.slots())?;
        let variable = Variable { slot, value_type, shape };
        self.variables.insert(name.to_ascii_uppercase(), variable);
        Some(variable)
    }

    /// Reserves slots without a name.
    pub(super) fn reserve(&mut self, count: usize) -> Option<u16> {
        let slot = self.slots;
        if usize::from(slot) + count > MAX_SLOTS {
            return None;
        }
        self.slots += count as u16;
        Some(slot)
    }

    /// Returns the first slot of the R parameters, which are reserved at their first use.
    pub(super) fn r_parameters(&mut self) -> Option<u16> {
        if self.first_r.is_none() {
            self.first_r = self.reserve(usize::from(R_PARAMETERS));
        }
        self.first_r
    }
}
