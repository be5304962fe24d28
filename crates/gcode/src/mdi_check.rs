//! Check of an MDI block, before it is executed.
//!
//! Invariant: an accepted block needs no other line and leaves nothing open.

use crate::block::NcBlock;
use crate::control::Keyword;
use crate::diag::{BlockError, BlockResult, Diagnostic, Span, fault};
use crate::error_codes::ErrorCode;
use crate::groups::GroupG;
use crate::parse::LineReader;
use crate::setup::Setup;

/// Checks that this text can be executed as an MDI block: one line that needs no other line and leaves nothing open.
pub(crate) fn check_mdi(text: &str, setup: &Setup) -> Result<(), Vec<Diagnostic>> {
    let mut reader = LineReader::of(setup);
    let BlockError { code, span, message } = match check_mdi_block(text, &mut reader) {
        Ok(()) => return Ok(()),
        Err(fault) => *fault,
    };
    Err(vec![Diagnostic { code, file: 0, line: 1, span, message }])
}

fn check_mdi_block(text: &str, reader: &mut LineReader) -> BlockResult<()> {
    let whole = Span::new(0, text.len());
    if text.trim().is_empty() {
        return Err(Box::new(BlockError::plain(ErrorCode::EmptyProgram, whole)));
    }
    if text.contains(['\n', '\r']) {
        return fault(ErrorCode::NotMdi, whole, "an MDI block is one line");
    }
    if text.trim() == "%" {
        return fault(ErrorCode::NotMdi, whole, "a percent sign is allowed in a file only");
    }
    if !reader.read(text.as_bytes())? {
        return Ok(());
    }
    let block: &NcBlock = &reader.block;
    if let Some(control) = &block.control
        && !matches!(control.keyword, Keyword::Call | Keyword::M98 | Keyword::Cycle)
    {
        let message = format!("{} is allowed in a program only", control.keyword.name());
        return fault(ErrorCode::NotMdi, control.at, message);
    }
    if block.words.g(GroupG::CutterCompensation).is_some_and(|code| code != 400) {
        let at = block.words.g_span(GroupG::CutterCompensation);
        return fault(ErrorCode::NotMdi, at, "cutter compensation needs the next block, and none follows an MDI block");
    }
    Ok(())
}
