//! The scripted operator: what is to be done when, one instruction a line (interface, *The scripted operator*).
//!
//! Invariant: a script that was read is in order: instructions wait for each other, each for its own moment.

use std::fmt;

use retrace_core::interruption;
use retrace_core::mode::ModeError;
use retrace_core::{ONE, Travel};
use retrace_link::channel;

use crate::machine::AXIS_LETTERS;
use crate::numbered_error::{NumberedError, nearest};
use crate::tool_length::{EnteredLength, ToolLengthError};

/// When an instruction is due.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ScriptTime {
    /// At a machine time in seconds.
    Time(f64),
    /// When the program line is being executed.
    Line(u32),
    /// Seconds after the previous instruction.
    AfterSeconds(f64),
    /// Control periods after the previous instruction.
    AfterPeriods(u64),
}

/// What the operator does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OperatorCommand {
    /// Feed hold.
    Hold,
    /// Cycle start: after a hold, at a program stop, in single block.
    Resume,
    /// Reverse run at this rate.
    Reverse(Travel),
    /// Forward run at this rate.
    Forward(Travel),
    /// Feed override: rapid motion keeps its speed, but stands at 0 as all motion does.
    Override(Travel),
    /// Rapid override, 0 … 1.
    RapidOverride(Travel),
    /// Turns the handwheel at so many counts a second, for so many seconds.
    Wheel {
        /// Counts a second, signed.
        counts_per_s: f64,
        /// How long.
        seconds: f64,
    },
    /// Leaves reverse run, forward run or the handwheel.
    Leave {
        /// Stop at `reached` where outputs differ, until [`Deed::Agree`].
        ask: bool,
    },
    /// Agrees to the outputs that are to be restored.
    Confirm,
    /// Starts the cutter again where it went out, and goes on; agrees to the outputs that are to be restored.
    Recover,
    /// Switches every cutter off, at once.
    CutterOff,
    /// Switches the cutter on by hand.
    CutterOn,
    /// M1 stops, or does not.
    OptionalStop(bool),
    /// Switches an output by hand.
    Output {
        /// Its number, 0 … 63; 64 is the output of M3.
        number: u8,
        /// On or off.
        on: bool,
    },
    /// Single block on or off.
    Single,
    /// Stops the job.
    Stop,
    /// Reverse run at full rate over this length of path in mm, and then stands.
    BackBy(f64),
    /// Reverse run to where the block begins that the machine is in; at its beginning already, to that of the block before.
    BackToBlock,
    /// Reverse run to where a cutting output was switched on last.
    BackToPierce,
    /// *Pause*: interrupts the program at a breakpoint (DNC-1).
    Pause,
    /// The spindle is stopped by hand (DNC-3).
    SpindleStop,
    /// The spindle is started by hand, in the direction and at the speed that it had (DNC-4).
    SpindleStart,
    /// An axis is moved by hand, so many mm (degrees).
    Jog {
        /// Its letter, lower case.
        axis: char,
        /// How far, signed.
        mm: f64,
    },
    /// The length of a tool that was changed in a pause.
    ToolLength(EnteredLength),
    /// Back to on-line mode (DNC-5).
    Online,
    /// *Cycle start* (DNC-6); where nothing is paused, as [`Deed::Resume`].
    CycleStart,
}

impl fmt::Display for OperatorCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Hold => write!(f, "hold"),
            Self::Resume => write!(f, "resume"),
            Self::Reverse(rate) => write!(f, "reverse {:.0}%", percent(*rate)),
            Self::Forward(rate) => write!(f, "forward {:.0}%", percent(*rate)),
            Self::Override(rate) => write!(f, "override {:.0}%", percent(*rate)),
            Self::RapidOverride(rate) => write!(f, "rapid override {:.0}%", percent(*rate)),
            Self::Wheel { counts_per_s, seconds } => write!(f, "wheel {counts_per_s} for {seconds}s"),
            Self::Leave { ask: false } => write!(f, "leave"),
            Self::Leave { ask: true } => write!(f, "leave ask"),
            Self::Confirm => write!(f, "agree"),
            Self::Recover => write!(f, "recover"),
            Self::CutterOff => write!(f, "cutter off"),
            Self::CutterOn => write!(f, "cutter on"),
            Self::OptionalStop(on) => write!(f, "optional stop {}", if *on { "on" } else { "off" }),
            Self::Output { number, on } => write!(f, "output {number} {}", if *on { "on" } else { "off" }),
            Self::Single => write!(f, "single"),
            Self::Stop => write!(f, "stop"),
            Self::BackBy(mm) => write!(f, "back {mm} mm"),
            Self::BackToBlock => write!(f, "back to block"),
            Self::BackToPierce => write!(f, "back to pierce"),
            Self::Pause => write!(f, "pause"),
            Self::SpindleStop => write!(f, "spindle stop"),
            Self::SpindleStart => write!(f, "spindle start"),
            Self::Jog { axis, mm } => write!(f, "jog {axis} {mm}"),
            Self::ToolLength(length) => write!(f, "{length}"),
            Self::Online => write!(f, "online"),
            Self::CycleStart => write!(f, "cycle start"),
        }
    }
}

/// Why a word of the operator was not taken. Nothing has changed then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CommandError {
    /// The mode of operation is another.
    Mode(ModeError),
    /// The override asked for is above this, which is in force now.
    AboveMaxOverride(Travel),
    /// More changes of the override are on their way than there is room for.
    TooManyOverrides,
    /// The card has no such output.
    NoOutput(u8),
    /// No cutting output was switched on within the history that is kept.
    NoPierce,
    /// Nothing was executed yet that could be gone back over.
    NothingBehind,
    /// The step is not the next in the sequence that pausing and going on has (DNC-1 … DNC-8).
    Interrupted(interruption::InterruptionError),
    /// The axis stands at its soft limit already, or the place to go to lies beyond it.
    BeyondLimit(char),
    /// The machine has no such axis.
    NoAxis(char),
    /// The tool length cannot be entered.
    ToolLength(ToolLengthError),
    /// It does not apply now; why.
    NotNow(&'static str),
}

impl fmt::Display for CommandError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Mode(ModeError::NotRetracing) => "there is nothing to leave: the machine is in normal run",
            Self::Mode(ModeError::NothingToConfirm) => "there is nothing to agree to",
            Self::Mode(ModeError::NotHeld) => "no feed hold is in force",
            Self::Mode(ModeError::RateNotPositive) => "a rate above 0 % is needed",
            Self::TooManyOverrides => "too many changes of the override are on their way already",
            Self::NoPierce => "no cutting output was switched on within the history that is kept",
            Self::NothingBehind => "nothing was executed yet that could be gone back over",
            Self::Interrupted(refused) => return crate::dnc_events::explain(*refused, f),
            Self::ToolLength(why) => return write!(f, "{why}"),
            Self::NotNow(why) => why,
            Self::AboveMaxOverride(most) => return write!(f, "{:.0} % is the most", percent(*most)),
            Self::BeyondLimit(axis) => {
                return write!(f, "axis {} would go beyond its soft limit", axis.to_ascii_uppercase());
            }
            Self::NoAxis(axis) => return write!(f, "the machine has no axis {}", axis.to_ascii_uppercase()),
            Self::NoOutput(number) => return write!(f, "the card has no output {number}"),
        })
    }
}

impl From<ModeError> for CommandError {
    fn from(refused: ModeError) -> Self {
        Self::Mode(refused)
    }
}

impl From<interruption::InterruptionError> for CommandError {
    fn from(refused: interruption::InterruptionError) -> Self {
        Self::Interrupted(refused)
    }
}

/// One line of a script.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScriptInstruction {
    /// Line in the script.
    pub line: u32,
    /// When it is due.
    pub when: ScriptTime,
    /// What is to be done.
    pub command: OperatorCommand,
}

/// Reads a script; `name` is what to call the file in messages.
///
/// # Errors
/// `E2121` with the line and what was expected there.
pub fn parse(text: &str, name: &str) -> Result<Vec<ScriptInstruction>, NumberedError> {
    let mut script = Vec::new();
    for (n, line) in text.lines().enumerate() {
        let line_number = n as u32 + 1;
        let words: Vec<&str> = line.split('#').next().unwrap_or_default().split_whitespace().collect();
        if words.is_empty() {
            continue;
        }
        let instruction = instruction(&words).map_err(|(what, remedy)| {
            NumberedError::new("E2121", format!("{name}, line {line_number}: {what}\n  | {}", line.trim()), remedy)
        })?;
        script.push(ScriptInstruction { line: line_number, ..instruction });
    }
    Ok(script)
}

/// What is wrong, and what would be right.
type Wrong = (String, String);

fn wrong<T>(what: impl Into<String>, remedy: impl Into<String>) -> Result<T, Wrong> {
    Err((what.into(), remedy.into()))
}

fn instruction(words: &[&str]) -> Result<ScriptInstruction, Wrong> {
    let (when, rest) = match words {
        ["at", "line", line, rest @ ..] => match line.parse() {
            Ok(line) => (ScriptTime::Line(line), rest),
            Err(_) => return wrong(format!("`{line}` is not a line number"), "at line 40 …"),
        },
        ["at", time, rest @ ..] => (ScriptTime::Time(seconds(time)?), rest),
        ["after", count, "periods", rest @ ..] => match count.parse() {
            Ok(count) => (ScriptTime::AfterPeriods(count), rest),
            Err(_) => return wrong(format!("`{count}` is not a number of periods"), "after 300 periods …"),
        },
        ["after", time, rest @ ..] => (ScriptTime::AfterSeconds(seconds(time)?), rest),
        _ => {
            return wrong(
                "a line begins with `at` or `after`",
                "at 1.5s hold · at line 40 hold · after 300 periods hold",
            );
        }
    };
    Ok(ScriptInstruction { line: 0, when, command: command(rest)? })
}

fn command(words: &[&str]) -> Result<OperatorCommand, Wrong> {
    Ok(match words {
        ["hold"] => OperatorCommand::Hold,
        ["resume"] => OperatorCommand::Resume,
        ["cycle", "start"] => OperatorCommand::CycleStart,
        ["reverse", rate] => OperatorCommand::Reverse(rate_of(rate)?),
        ["forward", rate] => OperatorCommand::Forward(rate_of(rate)?),
        ["override", rate] => OperatorCommand::Override(rate_of(rate)?),
        ["rapid", "override", rate] => OperatorCommand::RapidOverride(rate_of(rate)?),
        ["wheel", counts, "for", time] => {
            let counts_per_s = number(counts)?;
            if counts_per_s.abs() > 1e6 {
                return wrong(format!("{counts} counts a second"), "at most 1000000 counts a second");
            }
            OperatorCommand::Wheel { counts_per_s, seconds: seconds(time)? }
        }
        ["leave"] => OperatorCommand::Leave { ask: false },
        ["leave", "ask"] => OperatorCommand::Leave { ask: true },
        ["agree"] => OperatorCommand::Confirm,
        ["recover"] => OperatorCommand::Recover,
        ["cutter", "off"] => OperatorCommand::CutterOff,
        ["cutter", "on"] => OperatorCommand::CutterOn,
        ["optional", "stop", state @ ("on" | "off")] => OperatorCommand::OptionalStop(*state == "on"),
        ["output", word, state @ ("on" | "off")] => match word.parse() {
            Ok(number @ 0..=channel::SPINDLE) => OperatorCommand::Output { number, on: *state == "on" },
            _ => {
                return wrong(
                    format!("`{word}` is not an output"),
                    "an output is a number from 0 to 63, or 64 for that of M3",
                );
            }
        },
        ["single"] => OperatorCommand::Single,
        ["stop"] => OperatorCommand::Stop,
        ["back", rest @ ..] => back(rest)?,
        ["pause"] => OperatorCommand::Pause,
        ["online"] => OperatorCommand::Online,
        ["spindle", "stop"] => OperatorCommand::SpindleStop,
        ["spindle", "start"] => OperatorCommand::SpindleStart,
        ["tool", "length", "by", mm] => OperatorCommand::ToolLength(EnteredLength::By(tool_length(mm)?)),
        ["tool", "length", mm] => OperatorCommand::ToolLength(EnteredLength::To(tool_length(mm)?)),
        ["jog", axis, mm] => OperatorCommand::Jog { axis: axis_of(axis)?, mm: length(mm)? },
        [] => return wrong("nothing to do", "at 1.5s hold"),
        [first, ..] => {
            let known = [
                "hold", "resume", "reverse", "forward", "override", "wheel", "leave", "agree", "output", "single",
                "stop", "back", "pause", "spindle", "jog", "online", "cycle", "recover", "cutter", "optional", "rapid",
                "tool",
            ];
            let remedy = match nearest(first, known) {
                Some(word) if word != *first => format!("did you mean `{word}`?"),
                Some(word) => example(word).into(),
                None => format!("one of {}", known.join(", ")),
            };
            return wrong(format!("`{}` is not understood", words.join(" ")), remedy);
        }
    })
}

/// How a deed that begins with a known word is written whole.
fn example(word: &str) -> &'static str {
    match word {
        "back" => "back 50 mm · back to block · back to pierce",
        "spindle" => "spindle stop · spindle start",
        "jog" => "jog z 10",
        "tool" => "tool length 84.2 · tool length by -0.35",
        "cycle" => "cycle start",
        "cutter" => "cutter off · cutter on",
        "optional" => "optional stop on · optional stop off",
        "rapid" => "rapid override 50%",
        "recover" => "recover stands alone",
        "pause" | "online" => "pause and online stand alone",
        _ => "reverse 100% · override 60% · wheel -120 for 2s · leave ask · output 3 on",
    }
}

fn back(words: &[&str]) -> Result<OperatorCommand, Wrong> {
    match words {
        ["to", "block"] => Ok(OperatorCommand::BackToBlock),
        ["to", "jet"] => Ok(OperatorCommand::BackToPierce),
        [mm, "mm"] => match length(mm)? {
            mm if mm > 0.0 => Ok(OperatorCommand::BackBy(mm)),
            _ => wrong(format!("`back {mm} mm` goes nowhere"), "a length above 0, as in back 50 mm"),
        },
        _ => wrong(format!("`back {}` is not understood", words.join(" ")), example("back")),
    }
}

/// A length in mm (degrees), signed.
fn length(word: &str) -> Result<f64, Wrong> {
    match number(word)? {
        mm if mm.abs() <= 1e6 => Ok(mm),
        _ => wrong(format!("`{word}` is farther than any machine goes"), "a length in mm, such as 10"),
    }
}

/// A tool length or a difference of two, mm.
fn tool_length(word: &str) -> Result<f64, Wrong> {
    match number(word)? {
        mm if mm.abs() <= 10_000.0 => Ok(mm),
        _ => wrong(format!("`{word}` is not a length of a tool"), "a length in mm, such as 84.2"),
    }
}

fn axis_of(word: &str) -> Result<char, Wrong> {
    let mut letters = word.chars().map(|letter| letter.to_ascii_lowercase());
    match (letters.next(), letters.next()) {
        (Some(letter), None) if AXIS_LETTERS.contains(&letter) => Ok(letter),
        _ => wrong(format!("`{word}` is not an axis"), "x, y, z, a, b, c, u, v or w, as in jog z 10"),
    }
}

fn number(word: &str) -> Result<f64, Wrong> {
    match word.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => wrong(format!("`{word}` is not a number"), "a number such as 1.5"),
    }
}

fn seconds(word: &str) -> Result<f64, Wrong> {
    let value = number(word.strip_suffix('s').unwrap_or(word))?;
    if (0.0..=1e9).contains(&value) {
        Ok(value)
    } else {
        wrong(format!("`{word}` is not a time"), "a time such as 1.5s")
    }
}

/// A rate in percent.
#[must_use]
pub fn percent(rate: Travel) -> f64 {
    rate as f64 / ONE as f64 * 100.0
}

fn rate_of(word: &str) -> Result<Travel, Wrong> {
    let Some(digits) = word.strip_suffix('%') else {
        return wrong(format!("`{word}` is not a rate"), "a rate such as 60%");
    };
    let value = number(digits)?;
    if !(0.0..=800.0).contains(&value) {
        return wrong(format!("a rate of {word}"), "a rate from 0% to 800%");
    }
    // in steps of a hundredth of a percent, so that 100 % is exactly one and nothing else reads like it
    let steps = (value * 100.0).round() as Travel;
    Ok((steps * ONE + 5_000) / 10_000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_every_instruction_of_the_interface() {
        let text = "at 1.5s   hold\nafter 1s  resume  # cycle start\n\nat 2.0s reverse 100%\nafter 300 periods forward 50%\n\
            at line 40 override 60%\nafter 1s wheel -120 for 2s\nafter 1s leave\nafter 0s leave ask\nafter 0s agree\n\
            after 0s output 3 on\nafter 0s single\nat 9s stop\nafter 0s cycle start\n";
        let script = parse(text, "script").expect("all known");
        assert_eq!(script.len(), 13);
        assert_eq!(
            script[0],
            ScriptInstruction { line: 1, when: ScriptTime::Time(1.5), command: OperatorCommand::Hold }
        );
        assert_eq!(
            script[3],
            ScriptInstruction {
                line: 5,
                when: ScriptTime::AfterPeriods(300),
                command: OperatorCommand::Forward(ONE / 2)
            }
        );
        assert_eq!(script[4].when, ScriptTime::Line(40));
        assert_eq!(script[5].command, OperatorCommand::Wheel { counts_per_s: -120.0, seconds: 2.0 });
        assert_eq!(script[9].command, OperatorCommand::Output { number: 3, on: true });
    }

    #[test]
    fn every_deed_reads_back_as_it_is_written() {
        let deeds = "hold|resume|reverse 100%|forward 50%|override 160%|wheel -120 for 2s|leave|leave ask|agree|output 3 on|single|\
            stop|back 50 mm|back 0.25 mm|back to block|back to pierce|pause|spindle stop|spindle start|jog z 10|jog x -0.5|online|cycle start|recover|cutter off|cutter on|optional stop on|optional stop off|output 64 off|rapid override 25%";
        for written in deeds.split('|') {
            let script = parse(&format!("after 0s {written}"), "script").expect(written);
            assert_eq!(script[0].command.to_string(), written);
        }
        assert_eq!(parse("at 1s cycle start", "s").expect("known")[0].command, OperatorCommand::CycleStart);
        assert_eq!(parse("at 1s back 50 mm", "s").expect("known")[0].command, OperatorCommand::BackBy(50.0));
    }

    #[test]
    fn says_where_and_what_was_meant() {
        let refusal = |text: &str| parse(text, "script").expect_err("wrong");
        assert_eq!(refusal("at 1s hold\nat 2s revers 100%").remedy, "did you mean `reverse`?");
        assert_eq!(refusal("at 1s puase").remedy, "did you mean `pause`?");
        assert_eq!(refusal("at 1s spindle on").remedy, "spindle stop · spindle start");
        assert!(refusal("at 1s hold\nat 2s revers 100%").cause.contains("script, line 2"));
        for bad in [
            "hold",
            "at",
            "at xs hold",
            "after 1s reverse 900%",
            "at 1s reverse",
            "at 1s output 65 on",
            "at 1s cutter",
            "at 1s cutter maybe",
            "at 1s optional stop",
            "at nan hold",
            "after -1 periods hold",
            "at 1s wheel inf for 1s",
            "at line x hold",
            "after 1s pause now",
            "after 1s back -3 mm",
            "after 1s back to the block",
            "after 1s back inf mm",
            "after 1s jog q 10",
            "after 1s jog z far",
            "after 1s spindle",
            "at 1s",
        ] {
            assert_eq!(refusal(bad).number, "E2121", "{bad}");
        }
    }
}
