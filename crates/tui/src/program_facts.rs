//! Facts that the screen shows and that do not change while a job runs: machine, program, plan.
//!
//! Invariant: nothing here depends on the number of axes that the code is compiled for.

use retrace_core::RecordIndex;
use std::collections::BTreeMap;
use std::sync::Arc;

use retrace_config::{AnalogInput, CutterConfig, EncoderConfig, MachineConfig, channel_name};
use retrace_controller::{ContourList, CutFrame, PlannedPath};
use retrace_link::channel;

use crate::placed_path::PlacedPath;
use crate::preview::Preview;

/// Axis as the screen shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisFacts {
    /// Letter, lower case.
    pub letter: char,
    /// Pulses per mm (degree).
    pub pulses_per_mm: f64,
    /// Soft limits, mm (degrees).
    pub travel_mm: [f64; 2],
    /// Jog speed, mm (degrees) per second.
    pub jog_mm_s: f64,
}

impl AxisFacts {
    /// Whether its positions are degrees.
    #[must_use]
    pub const fn is_rotary(&self) -> bool {
        matches!(self.letter, 'a' | 'b' | 'c')
    }
}

/// Tool of the tool table as the screen shows it.
#[derive(Clone, Debug, PartialEq)]
pub struct ToolFacts {
    /// Number.
    pub number: u32,
    /// Diameter, mm.
    pub diameter_mm: f64,
    /// Length, mm.
    pub length_mm: f64,
    /// Comment of the table.
    pub name: String,
}

/// Cutter as the screen shows it.
#[derive(Clone, Debug, PartialEq)]
pub struct CutterFacts {
    /// Name.
    pub name: String,
    /// Channel that fires, opens or starts it.
    pub fire: u8,
    /// All channels that belong to it.
    pub channels: Vec<u8>,
    /// Input that proves it, if it has one.
    pub ok_input: Option<u8>,
    /// Length before the end of an interrupted cut from which it is continued, mm.
    pub run_in_mm: f64,
}

/// Duration of all motion of a program, from the plan itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Planned {
    /// Calculation in progress.
    #[default]
    Calculating,
    /// Duration in seconds.
    Known(f64),
    /// Unknown: the program is a stream.
    Unknown,
}

impl Planned {
    /// Duration in seconds, where it is known.
    #[must_use]
    pub const fn seconds(self) -> Option<f64> {
        match self {
            Self::Known(seconds) => Some(seconds),
            _ => None,
        }
    }
}

/// Result of checking the program. A cycle start checks it again.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum ProgramCheck {
    /// Check in progress.
    #[default]
    Checking,
    /// No program: the screen was opened without one.
    NotLoaded,
    /// The program can run from the current position.
    Ready,
    /// The program cannot run; the findings, one per line, never empty.
    Failed(Vec<String>),
    /// The program is a stream, which is checked block by block as it runs.
    CheckedAsItRuns,
}

/// Height control of a machine.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeightFacts {
    /// The analog input that reads the arc voltage, if one does.
    pub volts: Option<AnalogInput>,
    /// Whether another controller moves the tool axis: the height is not known then.
    pub is_external: bool,
}

/// Facts about machine and program.
#[derive(Clone, Debug, Default)]
pub struct ProgramFacts {
    /// Name of the machine.
    pub machine: String,
    /// Axes.
    pub axes: Vec<AxisFacts>,
    /// Control period, s.
    pub period_s: f64,
    /// Program text.
    pub program: Text,
    /// Machine position before the program, mm (degrees).
    pub start_position_mm: Vec<f64>,
    /// Duration of all motion at an override of 100 %.
    pub planned: Planned,
    /// Contours of the program, where they are known.
    pub contours: Option<Arc<ContourList<9>>>,
    /// Record at which the job's path starts.
    pub first_place: RecordIndex,
    /// Path of the program, and the ends of its blocks.
    pub preview: Preview,
    /// Its path as it will lie once the edge of the sheet is set, where that was calculated.
    pub placed: Option<Arc<PlacedPath>>,
    /// The planned path with its record numbers, where a screen has asked for it and it is known.
    pub planned_path: Option<Arc<PlannedPath>>,
    /// Result of checking the program.
    pub check: ProgramCheck,
    /// Encoder of the spindle.
    pub encoder: Option<EncoderConfig>,
    /// Height control, if the machine has it.
    pub height: Option<HeightFacts>,
    /// Index of the axis whose layer is added to its path, on a machine that senses the sheet.
    pub layer_axis: Option<usize>,
    /// Index of the tool axis.
    pub tool_axis: Option<usize>,
    /// Machine position of the tool axis to which a frame goes up first, mm, where a safe height is set.
    pub frame_height_mm: Option<f64>,
    /// Tool table.
    pub tools: Vec<ToolFacts>,
    /// Comments of the tool table, by tool number.
    pub tool_names: BTreeMap<i32, String>,
    /// Cutters: torches, jets and beams.
    pub cutters: Vec<CutterFacts>,
    /// Names of the output channels, in the order of the channels.
    pub output_names: Vec<String>,
    /// Inputs that the machine uses, with what each of them is.
    pub input_names: Vec<(u8, String)>,
}

impl ProgramFacts {
    /// Facts of the machine, with a program of this name and text; the text of a stream is empty.
    #[must_use]
    pub fn of(machine: &MachineConfig, name: &str, text: &str) -> Self {
        let axes = machine.axes.iter().map(|axis| AxisFacts {
            letter: axis.name,
            pulses_per_mm: axis.pulses_per_mm,
            travel_mm: axis.travel_mm,
            jog_mm_s: axis.jog_mm_s().min(machine.path_velocity_mm_s),
        });
        Self {
            machine: machine.name.clone(),
            axes: axes.collect(),
            encoder: machine.encoder,
            height: machine
                .height_control()
                .map(|of| HeightFacts { volts: of.volts_input().cloned(), is_external: of.is_external() }),
            period_s: machine.period_s(),
            tool_axis: machine.tool_axis(),
            frame_height_mm: CutFrame::safe_height_mm(machine),
            program: Text::new(name, text),
            start_position_mm: machine.stands_at_mm.clone(),
            cutters: machine.cutters.iter().filter(|cutter| cutter.kind.cuts_at_rest()).map(cutter_facts).collect(),
            input_names: machine.input_names(),
            output_names: (0..channel::COUNT as u8).map(|number| machine.channel_name(number)).collect(),
            ..Self::default()
        }
    }

    /// Name of an output channel.
    #[must_use]
    pub fn output_name(&self, channel: u8) -> String {
        self.output_names.get(usize::from(channel)).cloned().unwrap_or_else(|| channel_name(channel))
    }

    /// What S is called on a machine where it is the power of a beam.
    #[must_use]
    pub fn power_name(&self) -> Option<&str> {
        let name = self.output_names.get(usize::from(channel::SPEED))?;
        (*name != channel_name(channel::SPEED)).then_some(name)
    }

    /// Output with this name or number; case is ignored.
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

    /// Whether the channel belongs to a cutter.
    #[must_use]
    pub fn is_of_cutter(&self, channel: u8) -> bool {
        self.cutters.iter().any(|cutter| cutter.channels.contains(&channel))
    }

    /// Axes that are X, Y and Z.
    #[must_use]
    pub fn space(&self) -> [Option<usize>; 3] {
        ['x', 'y', 'z'].map(|letter| self.axes.iter().position(|axis| axis.letter == letter))
    }
}

fn cutter_facts(cutter: &CutterConfig) -> CutterFacts {
    let auxiliaries = [cutter.arm, cutter.assist, cutter.abrasive].into_iter().flatten();
    let channels = std::iter::once(cutter.fire).chain(auxiliaries).collect();
    CutterFacts {
        name: cutter.name.clone(),
        fire: cutter.fire,
        channels,
        ok_input: cutter.proof.map(|proof| proof.input),
        run_in_mm: cutter.run_in_mm(),
    }
}

/// Text of a program, by line.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Text {
    /// Name of the program.
    pub name: String,
    text: String,
    /// Start of each line.
    begins: Vec<usize>,
    /// Number of lines of a text that was not read.
    unread_lines: usize,
}

impl Text {
    /// Text of a program of this name.
    #[must_use]
    pub fn new(name: &str, text: &str) -> Self {
        let begins = text.split_inclusive('\n').scan(0, |at, line| {
            let begin = *at;
            *at += line.len();
            Some(begin)
        });
        Self { name: name.into(), begins: begins.collect(), text: text.into(), unread_lines: 0 }
    }

    /// A program of which name and number of lines are known only.
    #[must_use]
    pub fn unread(name: &str, lines: usize) -> Self {
        Self { name: name.into(), unread_lines: lines, ..Self::default() }
    }

    /// Number of lines.
    #[must_use]
    pub fn lines(&self) -> usize {
        self.begins.len() + self.unread_lines
    }

    /// Line, counted from 1, without its line end.
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
        let unread = Text::unread("a", 3);
        assert_eq!((unread.lines(), unread.line(1), unread.name.as_str()), (3, None, "a"));
    }
}
