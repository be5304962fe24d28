//! A block: one compiled line of a program.
//!
//! Invariant: a block holds exactly the content of its line. Values that depend on parameters are stored as operations
//! and calculated when the block is executed. Clearing and refilling a block allocates nothing once its buffers have
//! grown.

use crate::block_number::BlockNumber;
use crate::comment::Comment;
use crate::control::Control;
use crate::cycle_call::CycleCall;
use crate::diag::{BlockResult, Span, fault};
use crate::error_codes::ErrorCode;
use crate::eval::{Environment, evaluate, to_whole_number};
use crate::expr::Op;
use crate::groups::{GroupG, GroupM, Tenths, group_of_g, group_of_m};
use crate::number_range::LARGEST;
use crate::params::NameId;

/// First byte, and byte after the last. A line is shorter than 256 bytes.
pub(crate) type ByteRange = (u8, u8);

pub(crate) fn place(span: Span) -> ByteRange {
    (span.start.min(255) as u8, span.end.min(255) as u8)
}

fn span(place: ByteRange) -> Span {
    Span::new(place.0.into(), place.1.into())
}

/// Maximum number of M codes in one block.
const MAX_M: u8 = 4;

/// The words of a block, with their values.
#[derive(Clone, Debug)]
pub(crate) struct Words {
    present: u32,
    value: [f64; LETTERS],
    at: [ByteRange; LETTERS],
    g_present: u16,
    g: [Tenths; 16],
    g_at: [ByteRange; 16],
    m_present: u16,
    m: [u8; 16],
    m_at: [ByteRange; 16],
    m_count: u8,
    /// Whether it has a G or M code whose number is unknown.
    pub(crate) has_unknown_code: bool,
}

impl Default for Words {
    fn default() -> Words {
        Words {
            present: 0,
            value: [0.0; LETTERS],
            at: [(0, 0); LETTERS],
            g_present: 0,
            g: [0; 16],
            g_at: [(0, 0); 16],
            m_present: 0,
            m: [0; 16],
            m_at: [(0, 0); 16],
            m_count: 0,
            has_unknown_code: false,
        }
    }
}

/// Number of word letters: a to z, `@` and `^` for polar coordinates, `$` for the spindle.
const LETTERS: usize = 29;

const fn index(letter: u8) -> usize {
    match letter {
        b'@' => 26,
        b'^' => 27,
        b'$' => 28,
        _ => (letter.wrapping_sub(b'a') % 26) as usize,
    }
}

/// Returns the set of these letters.
pub(crate) const fn letters(of: &[u8]) -> u32 {
    let (mut set, mut at) = (0, 0);
    while at < of.len() {
        set |= 1 << index(of[at]);
        at += 1;
    }
    set
}

impl Words {
    pub(crate) fn clear(&mut self) {
        (self.present, self.g_present, self.m_present, self.m_count) = (0, 0, 0, 0);
        self.has_unknown_code = false;
    }

    /// Whether the block has a word of this lower-case letter.
    #[inline]
    pub(crate) const fn has(&self, letter: u8) -> bool {
        self.present & 1 << index(letter) != 0
    }

    /// Returns the value of the word of this lower-case letter.
    #[inline]
    pub(crate) fn get(&self, letter: u8) -> Option<f64> {
        self.has(letter).then(|| self.value[index(letter)])
    }

    /// Whether the block has any word of a set. [`letters`] makes the set at compile time.
    #[inline]
    pub(crate) const fn has_any_of(&self, set: u32) -> bool {
        self.present & set != 0
    }

    /// Whether the block has any of these words.
    #[inline]
    pub(crate) fn has_any(&self, letters: &[u8]) -> bool {
        letters.iter().any(|letter| self.has(*letter))
    }

    /// Returns the span of the word of this letter, or the beginning of the line if the block does not have it.
    pub(crate) fn span(&self, letter: u8) -> Span {
        if self.has(letter) { span(self.at[index(letter)]) } else { Span::default() }
    }

    /// Returns the first of these words that the block has.
    pub(crate) fn first_of(&self, letters: &[u8]) -> Option<u8> {
        letters.iter().copied().find(|letter| self.has(*letter))
    }

    /// Returns the G code of a group, in tenths.
    #[inline]
    pub(crate) fn g(&self, group: GroupG) -> Option<Tenths> {
        (self.g_present & 1 << group as u8 != 0).then(|| self.g[group as usize])
    }

    /// Returns the span of the G code of a group, or the beginning of the line if there is none.
    pub(crate) fn g_span(&self, group: GroupG) -> Span {
        self.g(group).map_or_else(Span::default, |_| span(self.g_at[group as usize]))
    }

    /// Returns the M code of a group.
    #[inline]
    pub(crate) fn m(&self, group: GroupM) -> Option<u8> {
        (self.m_present & 1 << group as u8 != 0).then(|| self.m[group as usize])
    }

    /// Whether the block has any M code.
    #[inline]
    pub(crate) const fn has_m(&self) -> bool {
        self.m_present != 0
    }

    /// Returns the span of the M code of a group, or the beginning of the line if there is none.
    pub(crate) fn m_span(&self, group: GroupM) -> Span {
        self.m(group).map_or_else(Span::default, |_| span(self.m_at[group as usize]))
    }

    /// Marks the word of this letter as present.
    #[inline]
    pub(crate) fn claim(&mut self, letter: u8, at: Span) -> BlockResult<()> {
        if self.has(letter) {
            let name = char::from(letter.to_ascii_uppercase());
            return fault(ErrorCode::WordTwice, at, format!("{name} is given twice"));
        }
        self.present |= 1 << index(letter);
        self.at[index(letter)] = place(at);
        Ok(())
    }

    /// Sets the value of a claimed word.
    #[inline]
    pub(crate) fn fill(&mut self, letter: u8, value: f64, at: Span) -> BlockResult<()> {
        if value.abs() > LARGEST {
            return too_large(letter, value, at);
        }
        let value = match letter {
            b'f' | b's' if value < 0.0 => return negative(letter, value, at),
            _ if value.is_nan() => value,
            b'$' => f64::from(to_whole_number(value, at, "$")?),
            b'h' | b't' | b'l' => {
                let rounded = f64::from(to_whole_number(value, at, "the word")?);
                if rounded < 0.0 {
                    return negative(letter, value, at);
                }
                rounded
            }
            _ => value,
        };
        self.value[index(letter)] = value;
        Ok(())
    }

    /// Adds a word that is not in the line, or replaces the existing one.
    pub(crate) fn put(&mut self, letter: u8, value: f64) {
        self.present |= 1 << index(letter);
        (self.value[index(letter)], self.at[index(letter)]) = (value, (0, 0));
    }

    /// Removes the M code of a group.
    pub(crate) fn remove_m(&mut self, group: GroupM) {
        if self.m(group).is_some() {
            self.m_present &= !(1 << group as u8);
            self.m_count -= 1;
        }
    }

    /// Whether it has no word but T, F and S, no G code and no M code.
    pub(crate) fn has_only_tool(&self) -> bool {
        self.present & !letters(b"tfs") == 0 && self.g_present == 0 && self.m_present == 0
    }

    /// Whether any of these words is present with an unknown value.
    pub(crate) fn has_unknown(&self, letters: &[u8]) -> bool {
        letters.iter().any(|&letter| self.get(letter).is_some_and(f64::is_nan))
    }

    /// Whether a code, or the value of a word, is unknown.
    pub(crate) fn is_partly_unknown(&self) -> bool {
        let mut present = self.present;
        let mut is_unknown = self.has_unknown_code;
        while present != 0 {
            is_unknown |= self.value[present.trailing_zeros() as usize % LETTERS].is_nan();
            present &= present - 1;
        }
        is_unknown
    }

    /// Makes the values of these words unknown, where they are present.
    pub(crate) fn forget(&mut self, letters: &[u8]) {
        for &letter in letters {
            self.value[index(letter)] = f64::NAN;
        }
    }

    /// Removes a word.
    pub(crate) fn remove(&mut self, letter: u8) {
        self.present &= !(1 << index(letter));
    }

    /// Halves the X word, which is a diameter under G7.
    pub(crate) fn halve_x(&mut self) {
        self.value[index(b'x')] /= 2.0;
    }

    /// Adds a G code. Another motion code replaces G80.
    pub(crate) fn add_g(&mut self, value: f64, at: Span) -> BlockResult<()> {
        if value < 0.0 {
            return negative(b'g', value, at);
        }
        // Rounding is written out: a library call would cost more than the rest of the function.
        let tenths = (value * 10.0 + 0.5) as Tenths;
        if (value * 10.0 - f64::from(tenths)).abs() > 0.001 || tenths > 999 {
            return fault(ErrorCode::UnknownG, at, format!("there is no G{value}"));
        }
        let group = match group_of_g(tenths) {
            Some(group) => group,
            None => return fault(ErrorCode::UnknownG, at, format!("there is no {}", name_of_g(tenths))),
        };
        match self.g(group) {
            Some(_) if group == GroupG::Motion && tenths == 800 => return Ok(()),
            Some(800) | None => {}
            Some(other) => {
                let (other, name) = (name_of_g(other), name_of_g(tenths));
                return fault(ErrorCode::TwoGOfGroup, at, format!("{other} and {name} exclude each other"));
            }
        }
        self.g_present |= 1 << group as u8;
        self.g[group as usize] = tenths;
        self.g_at[group as usize] = place(at);
        Ok(())
    }

    /// Adds an M code.
    pub(crate) fn add_m(&mut self, value: f64, at: Span) -> BlockResult<()> {
        let code = to_whole_number(value, at, "M")?;
        if code < 0 {
            return negative(b'm', value, at);
        }
        let group = match u8::try_from(code).ok().and_then(group_of_m) {
            Some(group) => group,
            None if matches!(code, 98 | 99) => {
                return fault(ErrorCode::NotAlone, at, format!("M{code} must be alone in its block, at the beginning"));
            }
            None => return fault(ErrorCode::UnknownM, at, format!("there is no M{code}")),
        };
        if let Some(other) = self.m(group) {
            return fault(ErrorCode::TwoMOfGroup, at, format!("M{other} and M{code} exclude each other"));
        }
        self.m_count += 1;
        if self.m_count > MAX_M {
            return fault(ErrorCode::TooManyM, at, ErrorCode::TooManyM.title());
        }
        self.m_present |= 1 << group as u8;
        self.m[group as usize] = code as u8;
        self.m_at[group as usize] = place(at);
        Ok(())
    }
}

#[cold]
fn too_large(letter: u8, value: f64, at: Span) -> BlockResult<()> {
    let letter = char::from(letter.to_ascii_uppercase());
    fault(ErrorCode::NumberTooLarge, at, format!("{letter} accepts values below {LARGEST:e}, not {value:e}"))
}

#[cold]
fn negative(letter: u8, value: f64, at: Span) -> BlockResult<()> {
    fault(
        ErrorCode::NegativeValue,
        at,
        format!("{} must not be negative, but is {value}", char::from(letter.to_ascii_uppercase())),
    )
}

/// Returns the notation of a G code.
pub(crate) fn name_of_g(tenths: Tenths) -> String {
    match tenths % 10 {
        0 => format!("G{}", tenths / 10),
        tenth => format!("G{}.{tenth}", tenths / 10),
    }
}

/// One packed word of a block.
#[derive(Clone, Copy, Debug)]
pub(crate) enum PackedWord {
    /// Number of the letter, its value and its place.
    Word(u8, f64, ByteRange),
    /// Number of the group, the code and its place.
    G(u8, Tenths, ByteRange),
    M(u8, u8, ByteRange),
}

impl Words {
    /// Appends the words to a list.
    pub(crate) fn pack(&self, items: &mut Vec<PackedWord>) {
        let bits = |mask: u32| (0..LETTERS as u8).filter(move |bit| mask & 1 << bit != 0);
        items.extend(bits(self.g_present.into()).map(|group| {
            let index = usize::from(group);
            PackedWord::G(group, self.g[index], self.g_at[index])
        }));
        items.extend(bits(self.m_present.into()).map(|group| {
            let index = usize::from(group);
            PackedWord::M(group, self.m[index], self.m_at[index])
        }));
        items.extend(bits(self.present).map(|letter| {
            let index = usize::from(letter);
            PackedWord::Word(letter, self.value[index], self.at[index])
        }));
    }

    /// Replaces the content with packed words.
    #[inline]
    pub(crate) fn unpack(&mut self, items: &[PackedWord]) {
        self.clear();
        for item in items {
            match *item {
                PackedWord::Word(letter, value, at) => {
                    let index = usize::from(letter) % LETTERS;
                    self.present |= 1 << index;
                    (self.value[index], self.at[index]) = (value, at);
                }
                PackedWord::G(group, code, at) => {
                    let index = usize::from(group % 16);
                    self.g_present |= 1 << index;
                    (self.g[index], self.g_at[index]) = (code, at);
                }
                PackedWord::M(group, code, at) => {
                    let index = usize::from(group % 16);
                    self.m_present |= 1 << index;
                    self.m_count += 1;
                    (self.m[index], self.m_at[index]) = (code, at);
                }
            }
        }
    }
}

/// Destination of a calculated value.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Slot {
    Word(u8),
    G,
    M,
    /// Assignment to the numbered parameter whose number the operations leave below the value on the stack.
    Numbered,
    Named(NameId),
    /// Value in brackets of an O word.
    Argument,
}

/// A value that is calculated when the block is executed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DeferredValue {
    slot: Slot,
    first_op: u16,
    end_op: u16,
    at: ByteRange,
}

/// An assignment with its value, not yet applied.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Assignment {
    Numbered(usize, f64),
    /// To a numbered parameter whose number is unknown.
    AnyNumbered(Span),
    Named(NameId, f64),
    /// Value of the next argument of an O word.
    Argument(f64),
}

/// One compiled line.
#[derive(Clone, Debug, Default)]
pub(crate) struct NcBlock {
    pub(crate) number: Option<BlockNumber>,
    pub(crate) words: Words,
    pub(crate) comment: Option<Comment>,
    pub(crate) control: Option<Control>,
    /// Cycle that the line calls.
    pub(crate) cycle: Option<CycleCall>,
    pub(crate) ops: Vec<Op>,
    pub(crate) deferred: Vec<DeferredValue>,
}

impl NcBlock {
    /// Takes M6 out of the block: it becomes the call of a subprogram. Returns whether it has one.
    ///
    /// # Errors
    /// The block has more than T, F and S beside it.
    pub(crate) fn take_tool_change(&mut self) -> BlockResult<bool> {
        if self.words.m(GroupM::Tool) != Some(6) {
            return Ok(false);
        }
        let at = self.words.m_span(GroupM::Tool);
        self.words.remove_m(GroupM::Tool);
        let is_code = |deferred: &DeferredValue| matches!(deferred.slot, Slot::G | Slot::M);
        if !self.words.has_only_tool() || self.deferred.iter().any(is_code) {
            return fault(ErrorCode::ToolChangeNotAlone, at, ErrorCode::ToolChangeNotAlone.title());
        }
        Ok(true)
    }

    pub(crate) fn clear(&mut self) {
        self.number = None;
        self.words.clear();
        self.comment = None;
        self.control = None;
        self.cycle = None;
        self.ops.clear();
        self.deferred.clear();
    }

    /// Adds a value that the operations from `first_op` calculate.
    pub(crate) fn add_deferred(&mut self, slot: Slot, first_op: usize, at: Span) {
        let (first_op, end_op) = (first_op as u16, self.ops.len() as u16);
        self.deferred.push(DeferredValue { slot, first_op, end_op, at: place(at) });
    }

    /// Adds a value that the operations from `first_op` to `end_op` calculate.
    pub(crate) fn add_deferred_range(&mut self, slot: Slot, first_op: usize, end_op: usize, at: Span) {
        let (first_op, end_op) = (first_op as u16, end_op as u16);
        self.deferred.push(DeferredValue { slot, first_op, end_op, at: place(at) });
    }

    /// Whether all words have their values without a calculation.
    #[inline]
    pub(crate) fn is_constant(&self) -> bool {
        self.deferred.is_empty()
    }

    /// Returns the first calculated value, or 0 if there is none.
    pub(crate) fn first_value(&self, environment: &impl Environment) -> BlockResult<f64> {
        let Some(deferred) = self.deferred.first() else { return Ok(0.0) };
        let ops = &self.ops[usize::from(deferred.first_op)..usize::from(deferred.end_op)];
        evaluate(ops, environment).map(|(_, value)| value)
    }

    /// Returns the span of the last calculated value.
    pub(crate) fn last_span(&self) -> Span {
        self.deferred.last().map_or_else(Span::default, |deferred| span(deferred.at))
    }

    /// Calculates the deferred values in the order of the line: word values into `words`, assignments into
    /// `assignments`.
    pub(crate) fn calculate(
        &self,
        environment: &impl Environment,
        words: &mut Words,
        assignments: &mut Vec<Assignment>,
    ) -> BlockResult<()> {
        words.clone_from(&self.words);
        assignments.clear();
        for deferred in &self.deferred {
            let ops = &self.ops[usize::from(deferred.first_op)..usize::from(deferred.end_op)];
            let (below, value) = evaluate(ops, environment)?;
            let at = span(deferred.at);
            match deferred.slot {
                Slot::Word(letter) => words.fill(letter, value, at)?,
                Slot::G | Slot::M if value.is_nan() => words.has_unknown_code = true,
                Slot::G => words.add_g(value, at)?,
                Slot::M => words.add_m(value, at)?,
                Slot::Numbered if below.is_nan() => assignments.push(Assignment::AnyNumbered(at)),
                Slot::Numbered => assignments.push(Assignment::Numbered(assignable(below, at)?, value)),
                Slot::Named(name) => assignments.push(Assignment::Named(name, value)),
                Slot::Argument => assignments.push(Assignment::Argument(value)),
            }
        }
        Ok(())
    }
}

/// Returns the number of a parameter if it may be assigned to.
fn assignable(number: f64, at: Span) -> BlockResult<usize> {
    use crate::params::Parameters;
    let number = to_whole_number(number, at, "#")?;
    match usize::try_from(number) {
        Ok(number) if Parameters::is_read_only(number) => {
            fault(ErrorCode::ParameterReadOnly, at, format!("#{number} is read-only"))
        }
        Ok(number) if Parameters::has(number) => Ok(number),
        _ => fault(ErrorCode::ParameterRange, at, format!("there is no parameter #{number}")),
    }
}
