//! Subprograms, loops and branches of a program that arrives (DNC, standard input): compiled when their end has arrived.
//!
//! Invariant: what is kept is bounded: subprograms stay, anything else goes when it has been carried out.

use crate::compiled_code::{CompiledCode, Jump};
use crate::control::{Control, Keyword};
use crate::control_flow::ControlFlowBuilder;
use crate::diag::{BlockError, BlockResult, Span, fault};
use crate::error_codes::ErrorCode as Number;
use crate::flow_controller::FlowController;
use crate::interp::Interpreter;
use crate::line_numbers::SeenNumbers;
use crate::lines::Lines;
use crate::prescan::Sub;
use crate::program::unreadable;
use std::io::BufRead;
use std::sync::Arc;

/// Bytes of text that subprograms and one loop may have together.
const MAX_KEPT: usize = 16 << 20;

/// What has been kept.
#[derive(Debug, Default)]
pub(crate) struct StreamCompiler {
    nest: ControlFlowBuilder,
    code: Option<Arc<CompiledCode>>,
    /// Bytes of the subprograms.
    kept: usize,
    seen: SeenNumbers,
}

impl StreamCompiler {
    /// The stretch compiled last.
    pub(crate) fn code(&mut self) -> Option<Arc<CompiledCode>> {
        self.code.take()
    }

    /// A line of the program with this number has gone by.
    pub(crate) fn see(&mut self, number: Option<u64>) {
        if let Some(number) = number {
            self.seen.see(number);
        }
    }

    /// Whether a line with this number has gone by.
    pub(crate) fn has_seen(&self, number: u64) -> bool {
        self.seen.has(number)
    }

    /// Compiles the stretch that begins with the line taken last, whose O word this is; it ends at the compiled lines returned.
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
            return Err(FlowController::not_yet(&control.label, control.at));
        }
        let mut code = CompiledCode::new(0);
        // Labels of what has gone may come again.
        self.nest = ControlFlowBuilder::in_style(self.nest.style());
        let first = lines.number();
        interpreter.reader_mut().block.control = Some(control);
        self.nest.take(&mut code, first, lines.text(), &interpreter.reader_mut().block);
        self.report(interpreter);
        while !self.nest.is_closed() {
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
            if !more || self.kept + code.text_len() > MAX_KEPT {
                return Err(self.unfinished(more, interpreter));
            }
            interpreter.set_line(0, lines.number());
            let reader = interpreter.reader_mut();
            match reader.read(lines.text()) {
                Ok(_) => self.nest.take(&mut code, lines.number(), lines.text(), &reader.block),
                Err(fault) => {
                    code.push(lines.number(), lines.text(), &reader.block, Jump::Faulty);
                    interpreter.report(*fault);
                }
            }
            self.report(interpreter);
        }
        self.nest.find_lines(&mut code, false);
        self.report(interpreter);
        let end = code.len();
        for line in 0..end {
            self.see(code.block_number(line));
        }
        let code = Arc::new(code);
        if is_sub {
            self.kept += code.text_len();
        }
        for found in self.nest.found.drain(..) {
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

    /// Tells what does not nest.
    fn report(&mut self, interpreter: &mut Interpreter) {
        for (line, fault) in self.nest.faults.drain(..) {
            interpreter.set_line(0, line);
            interpreter.report(*fault);
        }
    }

    fn unfinished(&mut self, more: bool, interpreter: &mut Interpreter) -> Box<BlockError> {
        match self.nest.abandon() {
            Some(open) if !more => {
                interpreter.set_line(0, open.line);
                open.without_end()
            }
            _ => Box::new(BlockError::plain(Number::TooMuchToKeep, Span::default())),
        }
    }
}
