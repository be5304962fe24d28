//! The branch table (PRE-5): every place where a program may go on elsewhere, and where that is.
//!
//! Invariant: numbers count from 1, file by file in the order of their lines; a target is a line of a file, or none where it is
//! calculated when the program runs or where there is none.

use crate::code::{Code, Jump};
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
    /// File and line where the program goes on when it branches.
    pub target: Option<(u16, u32)>,
}

/// The rows of all files.
pub(crate) fn table(codes: &[Arc<Code>], subs: &Subs) -> Vec<Branch> {
    let mut rows = Vec::new();
    for code in codes {
        for line in 0..code.len() {
            let Some((kind, to)) = code.jump(line).and_then(kind_of) else { continue };
            let (label, target) = match to {
                Target::Line(to) => (None, Some((code.file, behind(code, to)))),
                Target::Call(call) => {
                    let Some(call) = code.calls.get(call as usize) else { continue };
                    let sub = call.sub.and_then(|sub| subs.get(sub));
                    let target = sub.and_then(|sub| {
                        let code = codes.get(sub.code as usize)?;
                        Some((code.file, code.line_number(sub.entry)))
                    });
                    let label = match &call.label {
                        Label::Calculated => "calculated".to_owned(),
                        label => label.to_string(),
                    };
                    (Some(label), target)
                }
            };
            let number = rows.len() as u32 + 1;
            rows.push(Branch { number, file: code.file, line: code.line_number(line), kind, label, target });
        }
    }
    rows
}

enum Target {
    Line(u32),
    Call(u32),
}

/// The number of a compiled line in its file; behind the last, the line behind it.
fn behind(code: &Code, line: u32) -> u32 {
    match line.checked_sub(1) {
        Some(before) if line >= code.len() => code.line_number(before) + 1,
        Some(before) if code.line_number(line) < code.line_number(before) => code.line_number(before) + 1,
        // The next stretch may begin further on: what counts is the line behind this one.
        Some(before) => code.line_number(line).min(code.line_number(before) + 1),
        None => code.line_number(line),
    }
}

fn kind_of(jump: Jump) -> Option<(&'static str, Target)> {
    Some(match jump {
        Jump::None | Jump::Faulty | Jump::Pass | Jump::Return => return None,
        Jump::Over { to } => ("sub", Target::Line(to)),
        Jump::Call { call } => ("call", Target::Call(call)),
        Jump::If { otherwise } => ("if", Target::Line(otherwise)),
        Jump::ElseIf { otherwise, .. } => ("elseif", Target::Line(otherwise)),
        Jump::Else { end } => ("else", Target::Line(end)),
        Jump::While { end } => ("while", Target::Line(end)),
        Jump::WhileOfDo { begin } => ("do while", Target::Line(begin)),
        Jump::Repeat { end } => ("repeat", Target::Line(end)),
        Jump::EndRepeat { begin } => ("endrepeat", Target::Line(begin)),
        Jump::Leave { to, .. } => ("jump", Target::Line(to)),
    })
}
