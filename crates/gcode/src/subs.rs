//! The subprograms of a program: compiled regions, by file and label.
//!
//! Invariant: a label names at most one subprogram of a file.

use crate::compiled_code::SubId;
use crate::control::Label;
use crate::diag::{BlockError, Span};
use crate::error_codes::ErrorCode;
use std::collections::HashMap;

/// A compiled region of lines: a subprogram, a loop, a branch, a call.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Region {
    /// First line in the file, and first line after it.
    pub(crate) line: u32,
    pub(crate) end_line: u32,
    /// The same range in compiled lines.
    pub(crate) start: u32,
    pub(crate) end: u32,
}

/// A subprogram.
#[derive(Clone, Debug)]
pub(crate) struct Sub {
    /// Index of its compiled lines: that of its file; in a streamed program, that of the region.
    pub(crate) code: u32,
    /// First compiled line.
    pub(crate) entry: u32,
    pub(crate) for_m98: bool,
}

/// All subprograms of a program, by file and label.
#[derive(Clone, Debug, Default)]
pub(crate) struct Subs {
    pub(crate) list: Vec<Sub>,
    pub(crate) by_label: HashMap<(u16, Label), SubId>,
}

impl Subs {
    /// Adds a subprogram; false when the file has one of that label already.
    pub(crate) fn add(&mut self, file: u16, label: Label, sub: Sub) -> bool {
        let id = self.list.len() as SubId;
        let is_new = !self.by_label.contains_key(&(file, label.clone()));
        if is_new {
            self.by_label.insert((file, label), id);
            self.list.push(sub);
        }
        is_new
    }

    /// Removes all but the first `count`.
    pub(crate) fn truncate(&mut self, count: usize) {
        self.list.truncate(count);
        self.by_label.retain(|_, id| (*id as usize) < count);
    }

    /// Returns the subprogram of a call in this file: one of the file itself, or one of the program.
    pub(crate) fn find(&self, file: u16, label: &Label) -> Option<SubId> {
        let key = |file| (file, label.clone());
        self.by_label.get(&key(file)).or_else(|| self.by_label.get(&key(0))).copied()
    }

    pub(crate) fn get(&self, id: SubId) -> Option<&Sub> {
        self.list.get(id as usize)
    }

    /// Returns the label of a subprogram.
    pub(crate) fn label(&self, sub: &Sub) -> Option<&Label> {
        let is_it = |id: &SubId| self.get(*id).is_some_and(|one| (one.code, one.entry) == (sub.code, sub.entry));
        self.by_label.iter().find(|(_, id)| is_it(id)).map(|((_, label), _)| label)
    }
}

/// Returns the error for a subprogram of one kind that is called as the other.
pub(crate) fn wrong_call(label: &Label, is_m98: bool, at: Span) -> BlockError {
    let message = match is_m98 {
        true => format!("{label} is a sub: call it with O… call"),
        false => format!("{label} ends with M99: call it with M98"),
    };
    BlockError::new(ErrorCode::WrongCall, at, message)
}
