//! What the screen shows that does not change while a job runs: machine, program, plan.
//!
//! Invariant: nothing here depends on how many axes the code was compiled for.

use std::collections::BTreeMap;

use retrace_controller::event::channel_name;
use retrace_controller::machine::{CutterConfig, MachineConfig};
use retrace_link::channel;

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

/// A cutter, as far as the screen shows it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CutterFacts {
    /// Its name.
    pub name: String,
    /// The channel that lights, opens or starts it.
    pub fire: u8,
    /// Every channel that belongs to it.
    pub channels: Vec<u8>,
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
pub struct ProgramFacts {
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
    /// Remarks of the tool table, by the number of the tool.
    pub tool_names: BTreeMap<i32, String>,
    /// The cutters: torches, jets and beams.
    pub cutters: Vec<CutterFacts>,
    /// What the output channels are called, in the order of the channels.
    pub output_names: Vec<String>,
}

impl ProgramFacts {
    /// The machine's share, for a program of this name and text; a stream has no text.
    #[must_use]
    pub fn of(machine: &MachineConfig, name: &str, text: &str) -> Self {
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
            cutters: machine.cutters.iter().filter(|cutter| cutter.kind.cuts_at_rest()).map(cutter_facts).collect(),
            output_names: (0..channel::COUNT as u8).map(|number| machine.channel_name(number)).collect(),
            ..Self::default()
        }
    }

    /// What an output channel is called.
    #[must_use]
    pub fn output_name(&self, channel: u8) -> String {
        self.output_names.get(usize::from(channel)).cloned().unwrap_or_else(|| channel_name(channel))
    }

    /// The output of a name, or of a number; case is ignored.
    #[must_use]
    pub fn output_named(&self, text: &str) -> Option<u8> {
        let text = text.trim();
        let is_switched = |number: u8| usize::from(number) < channel::DIGITAL || number == channel::SPINDLE;
        if let Ok(number) = text.parse::<u8>() {
            return Some(number).filter(|&number| is_switched(number));
        }
        (0..=u8::MAX)
            .filter(|&number| is_switched(number))
            .find(|&number| self.output_name(number).eq_ignore_ascii_case(text))
    }

    /// Does the channel belong to a cutter?
    #[must_use]
    pub fn is_of_cutter(&self, channel: u8) -> bool {
        self.cutters.iter().any(|cutter| cutter.channels.contains(&channel))
    }

    /// Which axes are X, Y and Z.
    #[must_use]
    pub fn space(&self) -> [Option<usize>; 3] {
        ['x', 'y', 'z'].map(|letter| self.axes.iter().position(|axis| axis.letter == letter))
    }
}

fn cutter_facts(cutter: &CutterConfig) -> CutterFacts {
    let auxiliaries = [cutter.arm, cutter.assist, cutter.abrasive].into_iter().flatten();
    let channels = std::iter::once(cutter.fire).chain(auxiliaries).collect();
    CutterFacts { name: cutter.name.clone(), fire: cutter.fire, channels }
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
