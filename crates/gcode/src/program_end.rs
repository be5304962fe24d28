//! Detection of the end of a program in its streamed text.
//!
//! Invariant: one line is stored. A program is at its end only where nothing of that line can be missing (DNC-10).

use crate::lines::is_program_end;

/// Bytes of a line that are stored; no line of a program is longer.
const MAX_LINE: usize = 512;

/// Detects whether the last line that is not blank ends the program.
#[derive(Clone, Debug, Default)]
pub struct ProgramEndDetector {
    line: Vec<u8>,
    /// The line is terminated; the next byte that is not blank begins another.
    is_terminated: bool,
    /// There was another line before it.
    is_later: bool,
}

impl ProgramEndDetector {
    /// Processes the next bytes of the program.
    pub fn push(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            match byte {
                b'\n' | b'\r' => self.is_terminated = true,
                b' ' | b'\t' if self.is_terminated || self.line.is_empty() => {}
                _ => {
                    if std::mem::take(&mut self.is_terminated) && !self.line.is_empty() {
                        self.line.clear();
                        self.is_later = true;
                    }
                    if self.line.len() < MAX_LINE {
                        self.line.push(byte.to_ascii_uppercase());
                    }
                }
            }
        }
    }

    /// Whether the program may end here: its last line has M2 or M30, or is a percent sign that is not the first line.
    /// A line that is not terminated counts only where it is exactly that.
    #[must_use]
    pub fn is_reached(&self) -> bool {
        if !self.is_terminated && !is_program_end(&self.line) {
            return false;
        }
        self.is_later && code_of(&self.line) == b"%" || program_end_of(&self.line).is_some()
    }
}

/// Number of the M word in a line that ends the program: 2 or 30. None where there is none outside of comments.
#[must_use]
pub fn program_end_of(line: &[u8]) -> Option<u32> {
    let code = code_of(line);
    let number = |at: usize| -> Option<u32> {
        let digits: Vec<u8> = code[at + 1..].iter().copied().take_while(u8::is_ascii_digit).collect();
        match digits.as_slice() {
            b"2" | b"02" => Some(2),
            b"30" => Some(30),
            _ => None,
        }
    };
    (0..code.len()).filter(|&at| code[at].eq_ignore_ascii_case(&b'M')).find_map(number)
}

/// A line without its comments and blanks.
fn code_of(line: &[u8]) -> Vec<u8> {
    let (mut code, mut in_comment) = (Vec::new(), false);
    for &byte in line {
        match byte {
            b'(' => in_comment = true,
            b')' => in_comment = false,
            b';' if !in_comment => break,
            b' ' | b'\t' => {}
            _ if !in_comment => code.push(byte),
            _ => {}
        }
    }
    code
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ends(text: &str) -> bool {
        let mut end = ProgramEndDetector::default();
        end.push(text.as_bytes());
        end.is_reached()
    }

    #[test]
    fn the_end_of_a_program_is_detected() {
        let with_end = [
            "G0 X1\nM2\n\n",
            "n10 m 30\n",
            "%\nG0 X1\n%\n",
            "G1 X1\n%",
            "G0 M02 (M5)\r",
            "G1 X1\nM2",
            "G1\nm30",
            "M2\n  ",
        ];
        for text in with_end {
            assert!(ends(text), "{text:?}");
        }
        let without_end = [
            "",
            "%\n",
            "\n %",
            "%\nG1 X1\n",
            "G1 X1\n",
            "M3\n",
            "M2\nG1\n",
            "(M2)\n",
            ";M2\n",
            "M20\n",
            "M300\n",
            "G1 X2",
        ];
        for text in without_end {
            assert!(!ends(text), "{text:?}");
        }
    }

    #[test]
    fn a_line_that_is_not_terminated_ends_the_program_only_where_nothing_can_be_missing() {
        for text in ["G1 X1\nn10 m30", "G1 X1\nG0 M02", "G1 X1\nM2 (the en", "G1 X1\nM 2"] {
            assert!(!ends(text), "{text:?}");
        }
    }
}
