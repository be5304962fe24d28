//! The linker: resolves the calls of every cycle, and determines the kinds of the cycles.
//!
//! Invariant: every call of a remaining cycle is resolved and has matching arguments.

use super::LibraryFinding;
use super::folders::Form;
use crate::code::{CallSite, Passed, Unit};
use crate::cycle::{ArgumentKind, Cycle, CycleId, Kind, argument_mismatch};
use crate::diag::Diagnostic;
use crate::error_codes::ErrorCode;

/// Links forms that are sorted by name.
pub(super) fn link(mut forms: Vec<Form>, findings: &mut Vec<LibraryFinding>) -> Vec<Cycle> {
    // Removing a cycle also removes those that call it, until no remaining cycle calls a removed one.
    loop {
        let wrong: Vec<Option<Diagnostic>> = forms.iter().map(|form| first_fault(&form.unit, &forms)).collect();
        if wrong.iter().all(Option::is_none) {
            break;
        }
        let mut wrong = wrong.into_iter();
        forms.retain(|form| match wrong.next().flatten() {
            None => true,
            Some(diagnostic) => {
                findings.push(LibraryFinding { source: form.path.clone(), diagnostic });
                false
            }
        });
    }
    let contours = contours(&forms);
    let callees: Vec<Vec<CycleId>> = forms
        .iter()
        .map(|form| {
            form.unit.calls.iter().filter_map(|call| place(call, &forms)).map(|at| CycleId(at as u16)).collect()
        })
        .collect();
    let joined = forms.into_iter().zip(callees).zip(contours);
    joined
        .map(|((form, callees), contour)| {
            let kind = match contour {
                Some(parameter) => Kind::Contour(usize::from(parameter)),
                None if form.unit.parameters.is_empty() => Kind::Plain,
                None => Kind::Parameters,
            };
            let Form { unit, origin, path, is_from_cache, .. } = form;
            Cycle { unit, callees, kind, origin, path, is_from_cache }
        })
        .collect()
}

fn place(call: &CallSite, forms: &[Form]) -> Option<usize> {
    forms.binary_search_by(|form| form.unit.name.as_str().cmp(&call.name)).ok()
}

/// Returns the first call of a unit that does not fit.
fn first_fault(unit: &Unit, forms: &[Form]) -> Option<Diagnostic> {
    unit.calls.iter().find_map(|call| {
        let (code, message) = match place(call, forms) {
            None => (ErrorCode::CycleUnknown, format!("the cycle {} does not exist or cannot be called", call.name)),
            Some(at) => {
                (ErrorCode::CallArguments, argument_mismatch(&forms[at].unit, call.arguments.iter().map(given))?)
            }
        };
        Some(Diagnostic { code, line: call.line, start: call.start, end: call.end, message })
    })
}

fn given(passed: &Passed) -> ArgumentKind {
    match passed {
        Passed::Nothing => ArgumentKind::Empty,
        Passed::Number => ArgumentKind::Number,
        Passed::Text | Passed::Parameter(_) => ArgumentKind::Text,
    }
}

/// Returns, for each form, the parameter that names a contour: for STOCKPATH, or for a cycle that it is passed on to.
fn contours(forms: &[Form]) -> Vec<Option<u16>> {
    let mut contours: Vec<Option<u16>> = forms.iter().map(|form| form.unit.contour).collect();
    loop {
        let mut changed = false;
        for (index, form) in forms.iter().enumerate() {
            let handed_on = form.unit.calls.iter().find_map(|call| {
                let wanted = contours[place(call, forms)?]?;
                match call.arguments.get(usize::from(wanted))? {
                    Passed::Parameter(own) => Some(*own),
                    _ => None,
                }
            });
            if contours[index].is_none() && handed_on.is_some() {
                contours[index] = handed_on;
                changed = true;
            }
        }
        if !changed {
            return contours;
        }
    }
}
