//! Subprograms, loops and branches of a streamed program (DNC, standard input): compiled when their end has arrived.
//!
//! Invariant: the memory is bounded. Subprograms are retained; everything else is discarded after its execution.

use crate::compiled_code::{CompiledCode, Jump};
use crate::control::{Control, Keyword};
use crate::control_flow::ControlFlowBuilder;
use crate::diag::{BlockError, BlockResult, Span, fault};
use crate::error_codes::ErrorCode as Number;
use crate::flow_controller::FlowController;
use crate::interp::Interpreter;
use crate::line_numbers::SeenNumbers;
use crate::lines::Lines;
use crate::lines::unreadable;
use crate::subs::Sub;
use std::io::BufRead;
use std::sync::Arc;

/// Maximum total length of the text of subprograms and one loop, in bytes.
const MAX_STORED_BYTES: usize = 16 << 20;

/// Compiled regions of a streamed program.
#[derive(Debug, Default)]
pub(crate) struct StreamCompiler {
    control_flow: ControlFlowBuilder,
    code: Option<Arc<CompiledCode>>,
    /// Total length of the subprograms in bytes.
    stored_bytes: usize,
    seen: SeenNumbers,
}

impl StreamCompiler {
    /// Returns the region compiled last.
    pub(crate) fn code(&mut self) -> Option<Arc<CompiledCode>> {
        self.code.take()
    }

    /// Records that a line of the program with this number was passed.
    pub(crate) fn record_line(&mut self, number: Option<u64>) {
        if let Some(number) = number {
            self.seen.record(number);
        }
    }

    /// Whether a line with this number was passed.
    pub(crate) fn has_seen(&self, number: u64) -> bool {
        self.seen.has(number)
    }

    /// Compiles the region that begins with the current line, whose O word this is. Returns the range of its compiled
    /// lines.
    pub(crate) fn compile<R: BufRead>(
        &mut self,
        control: Control,
        lines: &mut Lines<R>,
        interpreter: &mut Interpreter,
        flow: &mut FlowController,
    ) -> BlockResult<(u32, u32)> {
        let is_sub = control.keyword == Keyword::Sub;
        if let Keyword::Call | Keyword::M98 = control.keyword
            && flow.subs.find(0, &control.label).is_none()
        {
            return Err(FlowController::not_arrived_error(&control.label, control.at));
        }
        let mut code = CompiledCode::new(0);
        // Labels of discarded regions may be used again.
        self.control_flow = ControlFlowBuilder::in_style(self.control_flow.style());
        let first = lines.number();
        interpreter.reader_mut().block.control = Some(control);
        self.control_flow.push(&mut code, first, lines.text(), &interpreter.reader_mut().block);
        self.report(interpreter);
        while !self.control_flow.is_closed() {
            let more = match lines.advance() {
                Ok(more) => more,
                Err(error) => {
                    interpreter.set_line(0, lines.number().saturating_add(1));
                    return Err(Box::new(unreadable(&error)));
                }
            };
            if let Some(cut_off) = lines.cut_off_fault() {
                interpreter.set_line(0, lines.number().saturating_add(1));
                return Err(cut_off);
            }
            if !more || self.stored_bytes + code.text_len() > MAX_STORED_BYTES {
                return Err(self.unfinished(more, interpreter));
            }
            interpreter.set_line(0, lines.number());
            let reader = interpreter.reader_mut();
            match reader.read(lines.text()) {
                Ok(_) => self.control_flow.push(&mut code, lines.number(), lines.text(), &reader.block),
                Err(fault) => {
                    code.push(lines.number(), lines.text(), &reader.block, Jump::Faulty);
                    interpreter.report(*fault);
                }
            }
            self.report(interpreter);
        }
        self.control_flow.find_lines(&mut code, false);
        self.report(interpreter);
        let end = code.len();
        for line in 0..end {
            self.record_line(code.block_number(line));
        }
        let code = Arc::new(code);
        if is_sub {
            self.stored_bytes += code.text_len();
        }
        for found in self.control_flow.found.drain(..) {
            let sub = Sub { code: flow.codes.len() as u32, entry: found.entry, for_m98: found.for_m98 };
            if !flow.subs.add(0, found.label.clone(), sub) {
                let message = format!("{} has been defined before", found.label);
                return fault(Number::SubTwice, Span::default(), message);
            }
            flow.codes.push(Arc::clone(&code));
        }
        self.code = Some(code);
        Ok((0, end))
    }

    /// Reports blocks that do not nest.
    fn report(&mut self, interpreter: &mut Interpreter) {
        for (line, fault) in self.control_flow.faults.drain(..) {
            interpreter.set_line(0, line);
            interpreter.report(*fault);
        }
    }

    fn unfinished(&mut self, more: bool, interpreter: &mut Interpreter) -> Box<BlockError> {
        match self.control_flow.abandon() {
            Some(open) if !more => {
                interpreter.set_line(0, open.line);
                open.missing_end_error()
            }
            _ => Box::new(BlockError::plain(Number::StorageFull, Span::default())),
        }
    }
}
