//! Assignment to a parameter: `#number=value` or `#<name>=value`.
//!
//! Invariant: predefined parameters are read-only.

use crate::block::{NcBlock, Slot};
use crate::diag::{BlockResult, fault};
use crate::error_codes::ErrorCode;
use crate::expr::Compiler;
use crate::lex::Cursor;
use crate::params::{Names, Reference};

/// Compiles `#number=value` or `#<name>=value`.
pub(crate) fn assignment(cursor: &mut Cursor<'_>, names: &mut Names, block: &mut NcBlock) -> BlockResult<()> {
    let start = cursor.position();
    let first_op = block.ops.len();
    let mut compiler = Compiler::new(cursor, &mut block.ops, names);
    let is_text =
        compiler.cursor.peek_next().is_some_and(|next| next.is_ascii_alphabetic() || b"#!-=*".contains(&next));
    let reference = match compiler.reference() {
        Err(found) if is_text && matches!(found.code, ErrorCode::UnknownFunction | ErrorCode::NumberMissing) => {
            compiler.cursor.finish();
            return fault(ErrorCode::HashComment, compiler.cursor.span_from(start), ErrorCode::HashComment.title());
        }
        reference => reference?,
    };
    if !compiler.cursor.eat(b'=') {
        return fault(ErrorCode::EqualsMissing, compiler.cursor.next_span(), "an equals sign is missing here");
    }
    let slot = match reference {
        Reference::Numbered => Slot::Numbered,
        Reference::Named(name) => Slot::Named(name),
        Reference::System(_) => {
            let at = compiler.cursor.span_from(start);
            return fault(ErrorCode::ParameterReadOnly, at, "a predefined parameter is read-only");
        }
    };
    compiler.value()?;
    let at = cursor.span_from(start);
    block.add_deferred(slot, first_op, at);
    Ok(())
}
