//! The lines `%` of a program that arrives: two whole tapes one behind the other are two programs.
//!
//! Invariant: the memory does not depend on the length of the program.

use retrace_config::NumberedError;

/// What was seen of the lines `%` of a text.
#[derive(Debug, Default)]
pub(crate) struct TapeMarks {
    /// Lines that are `%` alone.
    marks: u32,
    /// Whether the line has a `%`, and whether it has anything else.
    line: (bool, bool),
    /// Whether something follows the second mark.
    has_text_behind: bool,
}

impl TapeMarks {
    /// Takes the next bytes.
    pub(crate) fn take(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            match byte {
                b'\n' => self.end_line(),
                b'%' if self.line == (false, false) => self.line.0 = true,
                0 | b' ' | b'\t' | b'\r' => {}
                _ => self.line.1 = true,
            }
        }
    }

    fn end_line(&mut self) {
        match std::mem::take(&mut self.line) {
            (true, false) => {
                self.has_text_behind |= self.marks >= 2;
                self.marks = self.marks.saturating_add(1);
            }
            (_, true) => self.has_text_behind |= self.marks >= 2,
            (false, false) => {}
        }
    }

    /// `E5044` where something follows the second mark.
    pub(crate) fn error(&mut self, name: &str) -> Option<NumberedError> {
        self.end_line();
        self.has_text_behind.then(|| {
            let what =
                format!("more than one program came from the FIFO {name}: there is text behind the second line %");
            let remedy = "send one program, and the next one when the first was submitted; nothing of them is a job";
            NumberedError::new("E5044", what, remedy)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_behind_a_whole_tape_is_another_program() {
        let is_two = |text: &str| {
            let mut marks = TapeMarks::default();
            text.as_bytes().chunks(3).for_each(|part| marks.take(part));
            marks.error("cam").is_some()
        };
        for text in ["", "M2\n", "%\nM2\n%", "%\n(50 %)\nM2\n%\n\n \0\0", "M2\n%\n", "G1 X1 %\nM2\n"] {
            assert!(!is_two(text), "{text:?}");
        }
        for text in ["%\nM2\n%\n%\nM2\n%\n", "%\nM2\n%\nM2", "%\r\nM2\r\n%\r\nG1 X1\r\n", "% \n%\n%"] {
            assert!(is_two(text), "{text:?}");
        }
    }
}
