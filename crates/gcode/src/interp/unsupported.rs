//! Codes that a block must not have while cutter radius compensation is on.
//!
//! Invariant: a code is accepted only if it neither changes the coordinates of a waiting move nor must happen at a
//! certain place of the path.

use crate::block::{Words, name_of_g};
use crate::canon_modes::Plane;
use crate::diag::{BlockResult, Span, fault};
use crate::error_codes::ErrorCode;
use crate::groups::{GroupG, GroupM};
use crate::modal::ModalState;
use crate::modal_groups::MotionMode;

/// Refuses the M codes, and another plane: these come before G40 in a block.
///
/// # Errors
/// E1656 for each of them.
pub(super) fn switches(words: &Words, state: &ModalState) -> BlockResult<()> {
    for group in [GroupM::Output, GroupM::Tool, GroupM::Override] {
        match words.m(group) {
            // M61 changes the number of the tool, not its position.
            None | Some(61) => {}
            Some(code) => return refused(&format!("M{code}"), words.m_span(group)),
        }
    }
    let plane = match words.g(GroupG::Plane) {
        None => return Ok(()),
        Some(170) => Plane::Xy,
        Some(180) => Plane::Zx,
        Some(_) => Plane::Yz,
    };
    if plane == state.plane { Ok(()) } else { refused("another plane", words.g_span(GroupG::Plane)) }
}

/// Refuses the G codes that come after G40 or G41 in a block.
///
/// # Errors
/// E1656 for each of them.
pub(super) fn settings(words: &Words, state: &ModalState) -> BlockResult<()> {
    for group in [GroupG::ToolOffset, GroupG::CoordinateSystem, GroupG::PathControl, GroupG::Retract] {
        if let Some(code) = words.g(group) {
            return refused(&name_of_g(code), words.g_span(group));
        }
    }
    let Some(code) = words.g(GroupG::NonModal) else { return Ok(()) };
    let passes = match code {
        40 => true,
        100 => {
            let system = words.get(b'p').unwrap_or_default().round();
            let sets_system = matches!(words.get(b'l'), Some(2.0 | 20.0));
            !sets_system || (system != 0.0 && system != f64::from(state.coordinate_system))
        }
        530 => state.compensation.is_none_or(|compensation| compensation.radius == 0.0),
        _ => false,
    };
    if passes { Ok(()) } else { refused(&name_of_g(code), words.g_span(GroupG::NonModal)) }
}

/// Refuses the turning cycles.
///
/// # Errors
/// E1656 for each of them.
pub(super) fn turning(words: &Words) -> BlockResult<()> {
    let code = words.g(GroupG::Motion).unwrap_or_default();
    refused(&name_of_g(code), words.g_span(GroupG::Motion))
}

/// Refuses every motion except straight moves and arcs, because no other has a compensated path.
///
/// # Errors
/// E1656 for each of them.
pub(super) fn motion(motion: MotionMode, words: &Words) -> BlockResult<()> {
    if motion == MotionMode::Traverse || motion == MotionMode::Feed || motion.is_arc() {
        return Ok(());
    }
    refused(motion.name(), words.g_span(GroupG::Motion))
}

fn refused<T>(what: &str, at: Span) -> BlockResult<T> {
    fault(ErrorCode::CompensationRefuses, at, format!("{what} is not possible while cutter compensation is on"))
}
