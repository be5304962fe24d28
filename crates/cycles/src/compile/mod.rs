//! The compiler: converts a cycle source to its compiled form, in one pass.
//!
//! Invariant: every error of a source is found in one pass; reading continues at the next block. A source with errors
//! results in no unit.

mod block;
mod call;
mod expression;
mod flow;
mod head;
mod lex;
mod names;
mod system;

use crate::code::{Op, Unit};
use crate::diag::Diagnostic;
use crate::error_codes::ErrorCode;
use flow::{Jump, Open};
use lex::{CompileError, CompileResult, Kind, Sign, Span, Token, fault};
use names::Names;
use std::collections::HashMap;

/// Version of the compiled form, a part of its key: a form of another version is never run. Increase it with every
/// change of what sources compile to.
pub(crate) const VERSION: u32 = 2;

/// Maximum length of a source, and of a line, in bytes.
const MAX_SOURCE_LENGTH: usize = 1 << 20;
const MAX_LINE_LENGTH: usize = 10_000;
/// Maximum number of errors reported per source.
const MAX_ERRORS: usize = 50;

/// Result of compiling a source.
#[derive(Debug)]
pub(crate) struct Compiled {
    /// Compiled unit; `None` if there are errors.
    pub(crate) unit: Option<Unit>,
    /// Errors and warnings, in the order of the lines.
    pub(crate) diagnostics: Vec<Diagnostic>,
}

/// Compiles a source; `file_name` is the name of its file without the extension.
pub(crate) fn compile(source: &[u8], file_name: &str) -> Compiled {
    let mut compiler = Compiler::new(file_name);
    if source.len() > MAX_SOURCE_LENGTH {
        let message = format!("the source has {} bytes; the maximum is {MAX_SOURCE_LENGTH}", source.len());
        compiler.diagnostics.push(Diagnostic::of_file(ErrorCode::SourceTooLong, message));
    } else {
        for (index, line) in source.split(|byte| *byte == b'\n').enumerate() {
            compiler.line = index as u32 + 1;
            compiler.line_of_bytes(line.strip_suffix(b"\r").unwrap_or(line));
            if compiler.errors >= MAX_ERRORS {
                break;
            }
        }
        compiler.finish();
    }
    compiler.diagnostics.sort_by_key(|diagnostic| (diagnostic.line, diagnostic.start));
    if compiler.errors >= MAX_ERRORS {
        compiler.report(ErrorCode::TooManyErrors, Span::default(), "more errors are not shown".to_owned());
    }
    let is_whole = !compiler.diagnostics.iter().any(|d| d.severity() == crate::error_codes::Severity::Error);
    Compiled { unit: is_whole.then_some(compiler.unit), diagnostics: compiler.diagnostics }
}

struct Compiler<'s> {
    file_name: &'s str,
    text: &'s str,
    line: u32,
    tokens: Vec<Token>,
    /// Index of the next token.
    at: usize,
    unit: Unit,
    names: Names,
    /// Indices of the unit's texts.
    texts: HashMap<String, u16>,
    structures: Vec<Open>,
    /// Positions of each label: instruction and line. Block numbers may occur several times.
    labels: HashMap<String, Vec<(usize, u32)>>,
    jumps: Vec<Jump>,
    diagnostics: Vec<Diagnostic>,
    errors: usize,
    /// Depth of the current expression.
    depth: usize,
    /// Whether constants may be calculated at compile time.
    folds: bool,
    has_proc: bool,
    /// Whether a block with an effect has been read.
    has_begun: bool,
}

impl<'s> Compiler<'s> {
    fn new(file_name: &'s str) -> Self {
        Self {
            file_name,
            text: "",
            line: 0,
            tokens: Vec::new(),
            at: 0,
            unit: Unit { name: file_name.to_ascii_uppercase(), ..Unit::default() },
            names: Names::default(),
            texts: HashMap::new(),
            structures: Vec::new(),
            labels: HashMap::new(),
            jumps: Vec::new(),
            diagnostics: Vec::new(),
            errors: 0,
            depth: 0,
            folds: true,
            has_proc: false,
            has_begun: false,
        }
    }

    fn report(&mut self, code: ErrorCode, span: Span, message: String) {
        let (start, end) = (span.start as u32, span.end.max(span.start) as u32);
        let diagnostic = Diagnostic { code, line: self.line, start, end, message };
        self.errors += usize::from(diagnostic.severity() == crate::error_codes::Severity::Error);
        self.diagnostics.push(diagnostic);
    }

    fn line_of_bytes(&mut self, bytes: &'s [u8]) {
        let whole = Span { start: 0, end: bytes.len().min(MAX_LINE_LENGTH) };
        if bytes.len() > MAX_LINE_LENGTH {
            let message = format!("the line has {} bytes; the maximum is {MAX_LINE_LENGTH}", bytes.len());
            return self.report(ErrorCode::SourceTooLong, whole, message);
        }
        let is_control = |byte: &u8| *byte < b' ' && *byte != b'\t';
        match std::str::from_utf8(bytes) {
            Ok(text) if !bytes.iter().any(is_control) => self.text = text,
            _ => return self.report(ErrorCode::NotText, whole, "this line is not text".to_owned()),
        }
        // A source may begin with the header of a file transfer, as in `%_N_CYCLE81_SPF`.
        if self.text.starts_with('%') && !self.has_begun && !self.has_proc {
            return;
        }
        let mut tokens = std::mem::take(&mut self.tokens);
        let cut = lex::tokens(self.text, |name| self.names.has(name), &mut tokens);
        self.tokens = tokens;
        (self.at, self.depth) = (0, 0);
        if let Err(fault) = cut.and_then(|()| self.block()) {
            let CompileError { code, span, message } = *fault;
            self.report(code, span, message);
        }
    }

    /// Compiles one block: number, label, statement.
    fn block(&mut self) -> CompileResult {
        if let Some(Kind::Word { letter: b'N', value }) = self.peek() {
            self.labels.entry(format!("N{value}")).or_default().push((self.unit.ops.len(), self.line));
            self.skip();
        }
        let is_name = matches!(self.peek(), Some(Kind::Name | Kind::Word { .. }));
        if is_name && self.kind_at(1) == Some(Kind::Sign(Sign::Colon)) {
            let (name, span) = (self.word_here().to_ascii_uppercase(), self.here_span());
            self.skip();
            self.skip();
            self.has_begun = true;
            let places = self.labels.entry(name).or_default();
            places.push((self.unit.ops.len(), self.line));
            if let [(_, first), _, ..] = places[..] {
                let message = format!("this label is in line {first} too");
                self.report(ErrorCode::LabelTwice, span, message);
            }
        }
        if self.peek().is_none() { Ok(()) } else { self.statement() }
    }

    fn statement(&mut self) -> CompileResult {
        let span = self.here_span();
        let is_call = self.kind_at(1) == Some(Kind::Sign(Sign::Open));
        let word = if self.peek() == Some(Kind::Name) { self.word_here().to_ascii_uppercase() } else { String::new() };
        if self.names.has(&word) {
            self.has_begun = true;
            return self.items();
        }
        match word.as_str() {
            "PROC" => return self.proc(span),
            "DEF" => return self.def(span),
            // The parameters of a called cycle are known from its own PROC line.
            "EXTERN" => return Ok(()),
            _ => {}
        }
        self.has_begun = true;
        match word.as_str() {
            "IF" | "ELSE" | "ENDIF" | "WHILE" | "ENDWHILE" | "FOR" | "ENDFOR" | "LOOP" | "ENDLOOP" | "REPEAT"
            | "UNTIL" => {
                self.structure(&word, span)?;
            }
            "GOTO" | "GOTOF" | "GOTOB" => self.go_to(&word, None)?,
            "RET" => {
                self.skip();
                self.emit(Op::Return);
            }
            "MSG" | "SETAL" => self.message_call(&word)?,
            "MCALL" => {
                return fault(ErrorCode::NotUnderstood, span, "MCALL is allowed in a program only, not in a cycle");
            }
            "AX" | "IP" | "CR" | "SPOS" | "DIAMON" | "DIAMOF" | "R" => return self.items(),
            _ if is_call || word.len() > 1 && self.tokens.len() == self.at + 1 => self.call(&word, span)?,
            _ => return self.items(),
        }
        self.end_of_block()
    }

    fn end_of_block(&mut self) -> CompileResult {
        match self.peek() {
            None => Ok(()),
            Some(_) => fault(ErrorCode::NotUnderstood, self.here_span(), "nothing more is allowed in this block"),
        }
    }

    /// Performs the checks that need the whole source.
    fn finish(&mut self) {
        for open in std::mem::take(&mut self.structures) {
            self.line = open.line;
            self.report(ErrorCode::StructureOpen, open.span, format!("{} has no end", open.shape.name()));
        }
        self.resolve_jumps();
        self.emit(Op::Return);
        self.unit.slots = self.names.slots();
        if self.unit.ops.len() > 1 << 20 {
            self.line = 0;
            self.report(ErrorCode::TooLarge, Span::default(), "the source has too many blocks".to_owned());
        }
    }

    fn emit(&mut self, op: Op) {
        self.unit.ops.push(op);
        self.unit.lines.push(self.line);
    }

    fn kind_at(&self, ahead: usize) -> Option<Kind> {
        self.tokens.get(self.at + ahead).map(|token| token.kind)
    }

    fn peek(&self) -> Option<Kind> {
        self.kind_at(0)
    }

    fn skip(&mut self) {
        self.at += 1;
    }

    /// Returns the position of the next token.
    fn here(&self) -> usize {
        self.here_span().start
    }

    /// Returns the span of the next token, or the end of the line.
    fn here_span(&self) -> Span {
        let behind = self.tokens.last().map_or(0, |token| token.span.end);
        self.tokens.get(self.at).map_or(Span { start: behind, end: behind }, |token| token.span)
    }

    /// Returns the span from there to the last consumed token.
    fn since(&self, start: usize) -> Span {
        let end = self.at.checked_sub(1).and_then(|last| self.tokens.get(last)).map_or(start, |token| token.span.end);
        Span { start, end: end.max(start) }
    }

    fn text_at(&self, ahead: usize) -> &'s str {
        self.tokens.get(self.at + ahead).map_or("", |token| &self.text[token.span.start..token.span.end])
    }

    /// Returns the next token as written.
    fn word_here(&self) -> &'s str {
        self.text_at(0)
    }

    /// Returns the text of the next token, without its quotation marks.
    fn text_here(&self) -> &'s str {
        self.word_here().trim_matches('"')
    }

    /// Consumes the sign if it is next.
    fn eat(&mut self, sign: Sign) -> bool {
        let found = self.peek() == Some(Kind::Sign(sign));
        self.at += usize::from(found);
        found
    }

    fn expect(&mut self, sign: Sign, behind: &str) -> CompileResult {
        if self.eat(sign) {
            return Ok(());
        }
        fault(ErrorCode::NotUnderstood, self.here_span(), format!("`{}` is missing after {behind}", sign.spelling()))
    }

    /// Consumes the closing sign for what was opened there.
    fn close(&mut self, sign: Sign, open: Span) -> CompileResult {
        if self.eat(sign) {
            return Ok(());
        }
        match self.peek() {
            None => fault(ErrorCode::NotClosed, open, format!("`{}` is missing", sign.spelling())),
            Some(_) => {
                fault(ErrorCode::NotUnderstood, self.here_span(), format!("`{}` is needed here", sign.spelling()))
            }
        }
    }

    /// Returns the index of a text among the unit's.
    fn constant_text(&mut self, text: &str, span: Span) -> CompileResult<u16> {
        if let Some(index) = self.texts.get(text) {
            return Ok(*index);
        }
        let Ok(index) = u16::try_from(self.unit.texts.len()) else { return self.too_large(span, "texts") };
        self.unit.texts.push(text.to_owned());
        self.texts.insert(text.to_owned(), index);
        Ok(index)
    }

    #[cold]
    fn too_large<T>(&self, span: Span, of: &str) -> CompileResult<T> {
        fault(ErrorCode::TooLarge, span, format!("a cycle has too many {of}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn any_bytes_are_answered(source in prop::collection::vec(any::<u8>(), 0..300)) {
            compile(&source, "ANY");
        }

        /// Most byte sequences are not text; these are, and use the characters of the language.
        #[test]
        fn any_characters_are_answered(source in "[A-Za-z0-9 .;:,=<>()\\[\\]+*/$_%\"\n\t\u{e4}-]{0,300}") {
            let compiled = compile(source.as_bytes(), "ANY");
            if let Some(unit) = compiled.unit {
                let length = unit.ops.len() as u32;
                prop_assert_eq!(unit.lines.len(), unit.ops.len());
                let leaves = |op: &Op| {
                    matches!(op, Op::Jump(to) | Op::JumpIf(to) | Op::JumpIfNot(to) if *to >= length)
                };
                prop_assert!(!unit.ops.iter().any(leaves));
            }
        }
    }

    #[test]
    fn the_longest_source_is_answered_in_time() {
        let begin = std::time::Instant::now();
        for part in ["R1=R1+1\n", "IF R1\n", "LA:\n", "(", "N10 GOTOF N10\n", "\"", "X"] {
            compile(part.repeat(MAX_SOURCE_LENGTH / part.len()).as_bytes(), "LONG");
        }
        let texts: String = (0..60_000).map(|number| format!("MSG(\"{number}\")\n")).collect();
        assert!(compile(texts.as_bytes(), "LONG").unit.is_some());
        // One second is enough on an idle machine.
        assert!(begin.elapsed().as_secs() < 20, "{:?}", begin.elapsed());
        let too_long = compile(&vec![b' '; MAX_SOURCE_LENGTH + 1], "LONG");
        assert_eq!(too_long.diagnostics.first().map(|d| d.code), Some(ErrorCode::SourceTooLong));
    }
}
