//! The interface between a running cycle and the interpreter that called it, and the blocks that a cycle emits.
//!
//! Invariant: nothing here allocates; a block is a value of fixed size.

use crate::cycle::{Cycle, CycleId};
use std::fmt;

/// State that a cycle may read: left by its caller, or set by its own blocks.
///
/// Lengths are in the program's units, in the work coordinates in force. X is a diameter in diameter programming, as a
/// programmed word is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Query {
    /// Programmed position of this axis, by its letter in capitals: the end of the last block.
    Position(u8),
    /// Programmed feed F, in the units of the feed mode.
    Feed,
    /// Programmed spindle speed S, in revolutions per minute.
    SpindleSpeed,
    /// Spindle direction: 3 (M3), 4 (M4) or 5 (M5).
    SpindleDirection,
    /// Number of the tool offset in force, 0 for none.
    OffsetNumber,
    /// Radius of the tool, or of its nose.
    ToolRadius,
    /// Position of the tool's edge, 1 … 9 (DP2).
    EdgePosition,
    /// Clearance angle in degrees, 0 for no check (DP24).
    ClearanceAngle,
    /// Plane: 17, 18 or 19.
    Plane,
    /// Cutter compensation: 40, 41 or 42.
    Compensation,
    /// Distance mode: 90 or 91.
    Distance,
    /// Feed mode: 93, 94 or 95.
    FeedMode,
    /// Spindle mode: 96 or 97.
    SpindleMode,
    /// Motion in force: 0, 1, 2, 3 or 33.
    Motion,
    /// 1 in diameter programming, otherwise 0.
    Diameter,
    /// 1 in inch programming, otherwise 0.
    Inch,
    /// 1 while a modal cycle (MCALL) is in force, otherwise 0.
    ModalCycle,
}

/// One word of a block: its letter in capitals and its value.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CycleWord {
    /// `X Y Z A B C U V W`, `I J K` (centre from the start of the arc, or pitch), `R` (radius of an arc, or angle of
    /// M19), `F`, `S`, `P` (seconds of G4), `D`.
    pub letter: u8,
    /// Value of the word.
    pub value: f64,
}

/// Maximum number of G codes of a block.
pub(crate) const MAX_G: usize = 8;
/// Maximum number of M codes of a block.
pub(crate) const MAX_M: usize = 4;
/// Maximum number of other words of a block.
pub(crate) const MAX_WORDS: usize = 16;

/// A block of a cycle, in RS274/NGC. Different notations of the cycle language are translated.
///
/// `SPOS=a` is M19 R(a), `CR=r` is R, G4 F and G4 S are G4 P in seconds, DIAMON and DIAMOF are G7 and G8, `AX[n]` and
/// `IP[n]` are the letters of the plane in force, G60 is G61.
#[derive(Clone, Copy, Debug)]
pub struct CycleBlock {
    /// Cycle whose block it is.
    pub cycle: CycleId,
    /// Line of its source, from 1.
    pub line: u32,
    /// Whether it calls the modal cycle: its cycle is a pattern and the block has a word of an axis of the plane.
    pub triggers: bool,
    codes_g: [u16; MAX_G],
    codes_m: [u16; MAX_M],
    words: [CycleWord; MAX_WORDS],
    counts: [u8; 3],
}

impl CycleBlock {
    /// Creates an empty block.
    #[must_use]
    pub const fn new(cycle: CycleId, line: u32) -> Self {
        Self {
            cycle,
            line,
            triggers: false,
            codes_g: [0; MAX_G],
            codes_m: [0; MAX_M],
            words: [CycleWord { letter: 0, value: 0.0 }; MAX_WORDS],
            counts: [0; 3],
        }
    }

    /// Clears the block. The content is not overwritten, so that the cost depends on what the block holds.
    pub(crate) fn begin(&mut self, cycle: CycleId, line: u32) {
        (self.cycle, self.line, self.triggers, self.counts) = (cycle, line, false, [0; 3]);
    }

    /// Returns the G codes in tenths, in the order of the source: G33.1 is 331.
    #[must_use]
    pub fn g(&self) -> &[u16] {
        &self.codes_g[..usize::from(self.counts[0])]
    }

    /// Returns the M codes in the order of the source.
    #[must_use]
    pub fn m(&self) -> &[u16] {
        &self.codes_m[..usize::from(self.counts[1])]
    }

    /// Returns the other words, in the order of the source.
    #[must_use]
    pub fn words(&self) -> &[CycleWord] {
        &self.words[..usize::from(self.counts[2])]
    }

    /// Returns the value of the word with this letter.
    #[must_use]
    pub fn word(&self, letter: u8) -> Option<f64> {
        self.words().iter().find(|word| word.letter == letter).map(|word| word.value)
    }

    /// Adds a G code. A code beyond the maximum is dropped, which the compiler excludes.
    pub(crate) fn add_g(&mut self, tenths: u16) {
        push(&mut self.codes_g, &mut self.counts[0], tenths);
    }

    /// Adds an M code.
    pub(crate) fn add_m(&mut self, code: u16) {
        push(&mut self.codes_m, &mut self.counts[1], code);
    }

    /// Adds a word; a second one with the same letter replaces the first.
    pub(crate) fn add_word(&mut self, letter: u8, value: f64) {
        let count = usize::from(self.counts[2]);
        match self.words[..count].iter_mut().find(|word| word.letter == letter) {
            Some(word) => word.value = value,
            None => push(&mut self.words, &mut self.counts[2], CycleWord { letter, value }),
        }
    }
}

fn push<T>(list: &mut [T], count: &mut u8, item: T) {
    if let Some(place) = list.get_mut(usize::from(*count)) {
        *place = item;
        *count += 1;
    }
}

/// A message for the operator: `MSG`, or `SETAL` with a number from 62000 to 62999.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Message<'a> {
    /// Number of a warning, such as 62100; `None` for `MSG`. Warnings are diagnostics with the number `W1003`.
    pub warning: Option<u32>,
    /// Text of the message; an empty text clears the last one.
    pub text: &'a str,
    /// Cycle that sends it.
    pub cycle: CycleId,
    /// Line of its source.
    pub line: u32,
}

/// The host has stopped at a block, and has the reason; the run ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CycleStoppedError;

impl fmt::Display for CycleStoppedError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the host has stopped the cycle at a block")
    }
}

impl std::error::Error for CycleStoppedError {}

/// Arguments of the built-in `STOCKPATH` of CYCLE95; the host adds the contour's elements and the tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StockCall<'a> {
    /// Name of the contour subprogram, or `START:END` labels of the calling program.
    pub contour: &'a str,
    /// Maximum infeed, radius.
    pub mid: f64,
    /// Finishing allowance along the longitudinal axis.
    pub fal_z: f64,
    /// Finishing allowance along the transverse axis, radius.
    pub fal_x: f64,
    /// Finishing allowance along the contour.
    pub fal: f64,
    /// Machining type, 1 … 12 or 201 … 212.
    pub vari: i32,
    /// Distance after which a roughing cut is interrupted; 0 for never.
    pub dam: f64,
    /// Lift-off.
    pub vrt: f64,
}

/// Reason why a contour has no path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StockPathError {
    /// Alarm number of the control, such as 61605.
    pub alarm: u32,
    /// Description.
    pub text: String,
}

impl fmt::Display for StockPathError {
    /// Writes `alarm 61605: …`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "alarm {}: {}", self.alarm, self.text)
    }
}

impl std::error::Error for StockPathError {}

/// Feed of a move of stock removal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StockFeed {
    /// Rapid.
    Rapid,
    /// FF1, roughing.
    Rough,
    /// FF2, plunging into relief cuts.
    Plunge,
    /// FF3, finishing.
    Finish,
}

/// A move of stock removal, in the two axes of the plane; transverse values are radii.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StockMove {
    /// 0, 1, 2 or 3, as the G code.
    pub motion: u8,
    /// End, first and second axis of the plane.
    pub end: [f64; 2],
    /// Centre of an arc from its start; zero for a line.
    pub centre: [f64; 2],
    /// Feed of the move.
    pub feed: StockFeed,
    /// Compensation that begins (41, 42) or ends (40) with this move; 0 for no change.
    pub compensation: u8,
    /// Whether a dwell follows, to break the chip.
    pub dwell: bool,
}

/// The interpreter that called a cycle.
pub trait Host {
    /// Returns a value of the state; unknown values are 0.
    fn ask(&self, what: Query) -> f64;

    /// Executes a block. Its modal codes stay in force; its coordinates are read under the modal state in force.
    ///
    /// # Errors
    /// The run ends; the host has the reason.
    fn block(&mut self, block: &CycleBlock) -> Result<(), CycleStoppedError>;

    /// Displays a message or a warning.
    fn message(&mut self, message: &Message<'_>);

    /// A cycle begins: the one that was called, and every one that it calls. For a cycle with [`Cycle::saves`], the
    /// host saves the modal state here.
    fn enter(&mut self, _cycle: &Cycle) {}

    /// The cycle entered last has ended normally. The host restores the modal state here. It is not called after an
    /// alarm.
    ///
    /// # Errors
    /// The run ends; the host has the reason.
    fn leave(&mut self, _cycle: &Cycle) -> Result<(), CycleStoppedError> {
        Ok(())
    }

    /// Reads the contour, calculates the path and stores it. Returns the number of its moves.
    ///
    /// # Errors
    /// The alarm of the control that applies.
    fn stock(&mut self, _call: &StockCall<'_>) -> Result<u32, StockPathError> {
        Err(StockPathError { alarm: 61606, text: "contours cannot be read here".to_owned() })
    }

    /// Returns a move of the path that [`Host::stock`] has calculated, by its number from 0.
    fn stock_move(&self, _index: u32) -> Option<StockMove> {
        None
    }
}

/// M codes that a cycle may use; it cannot end the program.
const KNOWN_M: &[i64] = &[0, 1, 3, 4, 5, 6, 7, 8, 9, 19];

/// Whether a cycle may use this M code.
pub(crate) fn is_known_m(code: f64) -> bool {
    code.fract() == 0.0 && KNOWN_M.contains(&(code as i64))
}
