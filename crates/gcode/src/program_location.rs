//! Location in a program, for display and for a breakpoint: file and line, and the calls and loops around it (DNC,
//! *Beyond the source*).
//!
//! Invariant: two equal locations of one program are the same instance of the same block, unless a subprogram was
//! called twice from one line in an iteration that no loop counts.

use std::fmt;

/// Kind of a loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoopKind {
    /// while … endwhile.
    While,
    /// do … while.
    Do,
    /// repeat … endrepeat.
    Repeat,
}

/// A subprogram or loop around a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CallFrame {
    /// A subprogram.
    Sub {
        /// Label, as in `O100`.
        name: String,
        /// File and line of the call; the file's name is empty for a streamed program.
        from: (String, u32),
        /// Number of the repeat, from 1, of the `of` repeats that M98 L requests.
        repeat: u32,
        /// Number of repeats of this call.
        repeats: u32,
    },
    /// A loop.
    Loop {
        /// Kind of the loop.
        kind: LoopKind,
        /// Line that begins it, in the same file.
        line: u32,
        /// Number of the iteration, from 1.
        iteration: u64,
        /// Number of iterations, where it is known.
        iterations: Option<u64>,
    },
}

/// Location in a program.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ProgramLocation {
    /// Name of the file; empty for a streamed program.
    pub file: String,
    /// Current line, from 1; 0 before the first.
    pub line: u32,
    /// Calls and loops around the line, from inside to outside.
    pub frames: Vec<CallFrame>,
    /// Cycle in force or being run: G81 … G89, MCALL, or the call of a cycle.
    pub cycle: Option<String>,
}

impl ProgramLocation {
    /// Label of the innermost subprogram around the line, if there is one.
    #[must_use]
    pub fn subprogram(&self) -> Option<&str> {
        self.frames.iter().find_map(|frame| match frame {
            CallFrame::Sub { name, .. } => Some(name.as_str()),
            CallFrame::Loop { .. } => None,
        })
    }
}

/// An ordinal number: 1st, 2nd, 3rd …
struct Nth(u64);

impl fmt::Display for Nth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ending = match (self.0 % 10, self.0 % 100) {
            (_, 11..=13) => "th",
            (1, _) => "st",
            (2, _) => "nd",
            (3, _) => "rd",
            _ => "th",
        };
        write!(f, "{}{ending}", self.0)
    }
}

impl CallFrame {
    /// Writes the frame in words. `file` is the file of the text so far; it becomes that of the call.
    fn write<'w>(&'w self, file: &mut &'w str, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            CallFrame::Sub { name, from: (from, line), repeat: time, repeats: of } => {
                write!(f, ", in {name} called from ")?;
                if from != *file {
                    write!(f, "{from} ")?;
                }
                *file = from;
                write!(f, "line {line}")?;
                if *of > 1 {
                    write!(f, " for the {} of {of} times", Nth(u64::from(*time)))?;
                }
                Ok(())
            }
            CallFrame::Loop { kind, line, iteration, iterations: of } => {
                let kind = match kind {
                    LoopKind::While => "while",
                    LoopKind::Do => "do",
                    LoopKind::Repeat => "repeat",
                };
                write!(f, ", in the {kind} loop of line {line}, {} iteration", Nth(*iteration))?;
                of.map_or(Ok(()), |of| write!(f, " of {of}"))
            }
        }
    }
}

/// Example: `pocket.ngc line 14, in O100 called from line 3 for the 2nd of 4 times, in the while loop of line 2, 5th
/// iteration`.
impl fmt::Display for ProgramLocation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.file.is_empty() {
            write!(f, "{} ", self.file)?;
        }
        write!(f, "line {}", self.line)?;
        if let Some(cycle) = &self.cycle {
            write!(f, ", in {cycle}")?;
        }
        let mut file = self.file.as_str();
        self.frames.iter().try_for_each(|within| within.write(&mut file, f))
    }
}
