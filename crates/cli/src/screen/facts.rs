//! What the screen shows that does not change while a job runs: machine, program, plan.
//!
//! Invariant: nothing here depends on how many axes the code was compiled for.

use retrace_controller::event::channel_name;
use retrace_controller::machine::Machine;

use super::preview::Preview;

/// An axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisFacts {
    /// Its letter, lower case.
    pub letter: char,
    /// Pulses to the mm (degree).
    pub pulses_per_mm: f64,
    /// Its soft limits, mm (degrees).
    pub travel_mm: [f64; 2],
}

/// How long all motion of a program is, from the plan itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Planned {
    /// It is being reckoned.
    #[default]
    Reckoning,
    /// So many seconds.
    Known(f64),
    /// Nobody can know: the program comes as a stream.
    Unknown,
}

impl Planned {
    /// In seconds, where it is known.
    #[must_use]
    pub const fn seconds(self) -> Option<f64> {
        match self {
            Self::Known(seconds) => Some(seconds),
            _ => None,
        }
    }
}

/// What checking the program has come to. A cycle start checks it again.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum ProgramCheck {
    /// It is being checked.
    #[default]
    Checking,
    /// There is none: the screen was opened without one.
    NotLoaded,
    /// It can be run from where the machine stands.
    Ready,
    /// It cannot; why, a line for each finding, never empty.
    Refused(Vec<String>),
    /// It comes as a stream, and is checked block by block as it runs.
    CheckedAsItRuns,
}

/// What does not change while a job runs.
#[derive(Clone, Debug, Default)]
pub struct Facts {
    /// The machine's name.
    pub machine: String,
    /// Its axes.
    pub axes: Vec<AxisFacts>,
    /// Control period, s.
    pub period_s: f64,
    /// The program.
    pub program: Text,
    /// Where the machine stands before the program, mm (degrees).
    pub stands_at_mm: Vec<f64>,
    /// All motion of the program at an override of 100 %.
    pub planned: Planned,
    /// The place at which the job's first record stands.
    pub first_place: u32,
    /// Where the program goes, and where its blocks end.
    pub preview: Preview,
    /// What checking the program has come to.
    pub check: ProgramCheck,
    /// The tool table, a tool a line.
    pub tools: Vec<String>,
}

impl Facts {
    /// The machine's share, for a program of this name and text; a stream has no text.
    #[must_use]
    pub fn of(machine: &Machine, name: &str, text: &str) -> Self {
        let axes = machine.axes.iter().map(|axis| AxisFacts {
            letter: axis.name,
            pulses_per_mm: axis.pulses_per_mm,
            travel_mm: axis.travel_mm,
        });
        Self {
            machine: machine.name.clone(),
            axes: axes.collect(),
            period_s: machine.period_s(),
            program: Text::new(name, text),
            stands_at_mm: machine.stands_at_mm.clone(),
            ..Self::default()
        }
    }

    /// What an output channel is called.
    #[must_use]
    pub fn output_name(&self, channel: u8) -> String {
        channel_name(channel)
    }

    /// Which axes are X, Y and Z.
    #[must_use]
    pub fn space(&self) -> [Option<usize>; 3] {
        ['x', 'y', 'z'].map(|letter| self.axes.iter().position(|axis| axis.letter == letter))
    }
}

/// A program's text, line by line.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Text {
    /// What the program is called.
    pub name: String,
    text: String,
    /// Where each line begins.
    begins: Vec<usize>,
}

impl Text {
    /// Of a program of this name.
    #[must_use]
    pub fn new(name: &str, text: &str) -> Self {
        let begins = text.split_inclusive('\n').scan(0, |at, line| {
            let begin = *at;
            *at += line.len();
            Some(begin)
        });
        Self { name: name.into(), begins: begins.collect(), text: text.into() }
    }

    /// How many lines there are.
    #[must_use]
    pub fn lines(&self) -> usize {
        self.begins.len()
    }

    /// A line, from 1, without its end.
    #[must_use]
    pub fn line(&self, number: usize) -> Option<&str> {
        let begin = *self.begins.get(number.checked_sub(1)?)?;
        let end = self.begins.get(number).copied().unwrap_or(self.text.len());
        self.text.get(begin..end).map(|line| line.trim_end_matches(['\n', '\r']))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_those_of_the_text() {
        let text = Text::new("a", "G0\r\nG1 X1\n\nM2");
        assert_eq!(text.lines(), 4);
        let lines: Vec<_> = (0..6).map(|n| text.line(n)).collect();
        assert_eq!(lines, [None, Some("G0"), Some("G1 X1"), Some(""), Some("M2"), None]);
        assert_eq!(Text::default().lines(), 0);
    }
}
