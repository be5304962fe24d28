//! The branch table (PRE-5): every place where a program may go on elsewhere, and where that is.
//!
//! Invariant: numbers count from 1, file by file in the order of their lines; a target is a line of a file, or none where it is
//! calculated when the program runs or where there is none.

use crate::compiled_code::{BY_NUMBER, CompiledCode, Jump};
use crate::control::Label;
use crate::prescan::Subs;
use std::sync::Arc;

/// One row of the branch table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Branch {
    /// Its number, from 1.
    pub number: u32,
    /// The file that it stands in; 0 is the program itself.
    pub file: u16,
    /// Its line, from 1.
    pub line: u32,
    /// What kind of branch it is: `if`, `while`, `call` …
    pub kind: &'static str,
    /// The label of a call.
    pub label: Option<String>,
    /// Where the program goes on when it branches.
    pub target: BranchDestination,
}

/// Where a branch leads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BranchDestination {
    /// A line of a file.
    Line {
        /// The file; 0 is the program itself.
        file: u16,
        /// The line, from 1.
        line: u32,
    },
    /// The compiled form of a cycle.
    Cycle,
    /// It is calculated when the program runs.
    Calculated,
    /// There is none: an error that the pre-scan tells.
    Missing,
}

/// The rows of all files.
pub(crate) fn table(codes: &[Arc<CompiledCode>], subs: &Subs) -> Vec<Branch> {
    let mut rows = Vec::new();
    for code in codes {
        for line in 0..code.len() {
            let Some((kind, to)) = code.jump(line).and_then(kind_of) else { continue };
            let (label, target) = match to {
                BranchTarget::Exactly(to) => {
                    (None, BranchDestination::Line { file: code.file, line: code.line_number(to) })
                }
                BranchTarget::Calculated => (None, BranchDestination::Calculated),
                BranchTarget::Line(to) => (None, BranchDestination::Line { file: code.file, line: behind(code, to) }),
                BranchTarget::Call(call) => {
                    let Some(call) = code.calls.get(call as usize) else { continue };
                    let sub = call.sub.and_then(|sub| subs.get(sub));
                    let line = sub.and_then(|sub| {
                        let code = codes.get(sub.code as usize)?;
                        Some(BranchDestination::Line { file: code.file, line: code.line_number(sub.entry) })
                    });
                    match &call.label {
                        Label::Calculated => (None, BranchDestination::Calculated),
                        label => (Some(label.to_string()), line.unwrap_or(BranchDestination::Missing)),
                    }
                }
                BranchTarget::Cycle(call) => {
                    let name = code.cycles.get(call as usize).map(|(_, call)| call.name.to_string());
                    (name, BranchDestination::Cycle)
                }
            };
            let number = rows.len() as u32 + 1;
            rows.push(Branch { number, file: code.file, line: code.line_number(line), kind, label, target });
        }
    }
    rows
}

enum BranchTarget {
    Line(u32),
    /// That very line, wherever it stands.
    Exactly(u32),
    Calculated,
    Call(u32),
    Cycle(u32),
}

/// The number of a compiled line in its file; behind the last, the line behind it.
fn behind(code: &CompiledCode, line: u32) -> u32 {
    match line.checked_sub(1) {
        Some(before) if line >= code.len() => code.line_number(before) + 1,
        Some(before) if code.line_number(line) < code.line_number(before) => code.line_number(before) + 1,
        // The next stretch may begin further on: what counts is the line behind this one.
        Some(before) => code.line_number(line).min(code.line_number(before) + 1),
        None => code.line_number(line),
    }
}

fn kind_of(jump: Jump) -> Option<(&'static str, BranchTarget)> {
    Some(match jump {
        Jump::None | Jump::Faulty | Jump::Pass | Jump::Return | Jump::ModalEnd | Jump::IfThen => return None,
        Jump::GoTo { to: BY_NUMBER, .. } => ("goto", BranchTarget::Calculated),
        Jump::GoTo { to, .. } => ("goto", BranchTarget::Exactly(to)),
        Jump::Cycle { call } => ("cycle", BranchTarget::Cycle(call)),
        Jump::ModalCall { call } => ("MCALL", BranchTarget::Cycle(call)),
        Jump::Over { to } => ("sub", BranchTarget::Line(to)),
        Jump::Call { call } => ("call", BranchTarget::Call(call)),
        Jump::If { otherwise } => ("if", BranchTarget::Line(otherwise)),
        Jump::ElseIf { otherwise, .. } => ("elseif", BranchTarget::Line(otherwise)),
        Jump::Else { end } => ("else", BranchTarget::Line(end)),
        Jump::While { end } => ("while", BranchTarget::Line(end)),
        Jump::WhileOfDo { begin } => ("do while", BranchTarget::Line(begin)),
        Jump::Repeat { end } => ("repeat", BranchTarget::Line(end)),
        Jump::EndRepeat { begin } => ("endrepeat", BranchTarget::Line(begin)),
        Jump::Leave { to } => ("jump", BranchTarget::Line(to)),
    })
}
