//! The branch table (PRE-5): every jump of a program, with its destination.
//!
//! Invariant: numbers start at 1, file by file in the order of the lines. A target is a line of a file; there is none
//! where it is calculated at run time or does not exist.

use crate::compiled_code::{BY_NUMBER, CompiledCode, Jump};
use crate::control::Label;
use crate::subs::Subs;
use std::sync::Arc;

/// One row of the branch table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Branch {
    /// Number of the row, from 1.
    pub number: u32,
    /// File of the branch; 0 is the program itself.
    pub file: u16,
    /// Line of the branch, from 1.
    pub line: u32,
    /// Kind of branch: `if`, `while`, `call` …
    pub kind: &'static str,
    /// Label of a call.
    pub label: Option<String>,
    /// Destination of the branch.
    pub target: BranchDestination,
}

/// Destination of a branch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BranchDestination {
    /// A line of a file.
    Line {
        /// Number of the file; 0 is the program itself.
        file: u16,
        /// Number of the line, from 1.
        line: u32,
    },
    /// Compiled form of a cycle.
    Cycle,
    /// Calculated when the program runs.
    Calculated,
    /// Does not exist, which the pre-scan reports as an error.
    Missing,
}

/// Returns the rows of all files.
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
                BranchTarget::Line(to) => {
                    (None, BranchDestination::Line { file: code.file, line: file_line(code, to) })
                }
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
    /// Exactly this line, wherever it is.
    Exactly(u32),
    Calculated,
    Call(u32),
    Cycle(u32),
}

/// Returns the file line number of a compiled line; for the position after the last one, the next line number.
fn file_line(code: &CompiledCode, line: u32) -> u32 {
    match line.checked_sub(1) {
        Some(before) if line >= code.len() => code.line_number(before) + 1,
        Some(before) if code.line_number(line) < code.line_number(before) => code.line_number(before) + 1,
        // The next region may begin further down, so the line after this one counts.
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
