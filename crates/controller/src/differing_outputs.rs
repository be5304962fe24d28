//! Outputs that differ from what the program expects where motion is to continue.
//!
//! Invariant: a list has a bounded number of entries and is copied without allocation.

/// Maximum number of outputs in one event.
const LISTED: usize = 4;

/// An output that differs from what the program expects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DifferingOutput {
    /// Number of the output.
    pub channel: u8,
    /// Its value.
    pub actual: i32,
    /// The value that the program expects.
    pub expected: i32,
    /// Code of the program that switched it so: `M3`, `M64` …; empty where none did.
    pub code: &'static str,
    /// Program line of the code, 0 where there is none.
    pub line: u32,
}

impl DifferingOutput {
    /// Creates the entry of an output that no code of the program switched.
    #[must_use]
    pub const fn new(channel: u8, actual: i32, expected: i32) -> Self {
        Self { channel, actual, expected, code: "", line: 0 }
    }

    /// What switched it, as text: ` (M3 in line 7)`, or nothing.
    #[must_use]
    pub fn origin(&self) -> String {
        if self.code.is_empty() { String::new() } else { format!(" ({} in line {})", self.code, self.line) }
    }
}

/// Outputs that differ. Further outputs are in further events.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DifferingOutputs {
    list: [DifferingOutput; LISTED],
    count: u8,
}

impl DifferingOutputs {
    /// Takes the first outputs of a list; the rest remains in it.
    pub fn first(list: &mut impl Iterator<Item = DifferingOutput>) -> Self {
        let mut some = Self::default();
        for (slot, output) in some.list.iter_mut().zip(list) {
            *slot = output;
            some.count += 1;
        }
        some
    }

    /// The list.
    #[must_use]
    pub fn list(&self) -> &[DifferingOutput] {
        &self.list[..usize::from(self.count)]
    }
}
