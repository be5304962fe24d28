//! The words of commands of the operator, and of the scripted operator: one instruction per line with the time at which
//! it is due (interface, *The scripted operator*).
//!
//! Invariant: the instructions of a parsed script are executed in order; each one waits for the one before it and for
//! its own time. What cannot be understood is refused with the words that could have been meant.

use retrace_config::{AXIS_LETTERS, NumberedError, nearest};
use retrace_core::Rate;
use retrace_link::channel;

use crate::operator::{
    CutStart, DIRECTIONS, HeightCommand, LeadShape, OperatorCommand, ScriptInstruction, ScriptTime, Shift,
};
use crate::tool_length::EnteredLength;

/// Parses a script. `name` names the file in messages.
///
/// # Errors
/// `E2121` with the line and what was expected there.
pub fn parse_script(text: &str, name: &str) -> Result<Vec<ScriptInstruction>, NumberedError> {
    let mut script = Vec::new();
    for (n, line) in text.lines().enumerate() {
        let line_number = n as u32 + 1;
        let words: Vec<&str> = line.split('#').next().unwrap_or_default().split_whitespace().collect();
        if words.is_empty() {
            continue;
        }
        let instruction = parse_instruction(&words).map_err(|(what, remedy)| {
            NumberedError::new("E2121", format!("{name}, line {line_number}: {what}\n  | {}", line.trim()), remedy)
        })?;
        script.push(ScriptInstruction { line: line_number, ..instruction });
    }
    Ok(script)
}

/// Parses one command, in the words of a script without its time.
///
/// # Errors
/// `E2121` with what was expected.
pub fn parse_operator_command(text: &str) -> Result<OperatorCommand, NumberedError> {
    let words: Vec<&str> = text.split_whitespace().collect();
    parse_command(&words).map_err(|(cause, remedy)| NumberedError::new("E2121", cause, remedy))
}

/// Cause and remedy of an instruction that cannot be parsed.
type InstructionError = (String, String);

fn wrong<T>(what: impl Into<String>, remedy: impl Into<String>) -> Result<T, InstructionError> {
    Err((what.into(), remedy.into()))
}

fn parse_instruction(words: &[&str]) -> Result<ScriptInstruction, InstructionError> {
    let (when, rest) = match words {
        ["at", "line", line, rest @ ..] => match line.parse() {
            Ok(line) => (ScriptTime::Line(line), rest),
            Err(_) => return wrong(format!("`{line}` is not a line number"), "at line 40 …"),
        },
        ["at", time, rest @ ..] => (ScriptTime::Time(parse_seconds(time)?), rest),
        ["after", count, "periods", rest @ ..] => match count.parse() {
            Ok(count) => (ScriptTime::AfterPeriods(count), rest),
            Err(_) => return wrong(format!("`{count}` is not a number of periods"), "after 300 periods …"),
        },
        ["after", time, rest @ ..] => (ScriptTime::AfterSeconds(parse_seconds(time)?), rest),
        _ => {
            return wrong(
                "a line begins with `at` or `after`",
                "at 1.5s hold · at line 40 hold · after 300 periods hold",
            );
        }
    };
    Ok(ScriptInstruction { line: 0, when, command: parse_command(rest)? })
}

fn parse_command(words: &[&str]) -> Result<OperatorCommand, InstructionError> {
    Ok(match words {
        ["hold"] => OperatorCommand::Hold,
        ["resume"] => OperatorCommand::Resume,
        ["cycle", "start"] => OperatorCommand::CycleStart,
        ["reverse", rate] => OperatorCommand::Reverse(parse_rate(rate)?),
        ["forward", rate] => OperatorCommand::Forward(parse_rate(rate)?),
        ["override", rate] => OperatorCommand::Override(parse_rate(rate)?),
        ["rapid", "override", rate] => OperatorCommand::RapidOverride(parse_rate(rate)?),
        ["speed", "override", rate] => OperatorCommand::SpeedOverride(parse_rate(rate)?),
        ["wheel", counts, "for", time] => {
            let counts_per_s = parse_number(counts)?;
            if counts_per_s.abs() > 1e6 {
                return wrong(format!("{counts} counts a second"), "at most 1000000 counts a second");
            }
            OperatorCommand::Wheel { counts_per_s, seconds: parse_seconds(time)? }
        }
        ["leave"] => OperatorCommand::Leave { ask: false },
        ["leave", "ask"] => OperatorCommand::Leave { ask: true },
        ["agree"] => OperatorCommand::Confirm,
        ["recover"] => OperatorCommand::Recover,
        ["contours"] => OperatorCommand::Contours,
        ["consumables", "changed"] => OperatorCommand::ConsumablesChanged,
        ["skip", "contour"] => OperatorCommand::SkipContour,
        ["skip", "contour", number] => {
            OperatorCommand::SkipContourAhead { number: parse_contour(number, "skip contour 3")?, on: true }
        }
        ["skip", "contour", number, "off"] => {
            OperatorCommand::SkipContourAhead { number: parse_contour(number, "skip contour 3 off")?, on: false }
        }
        ["cut"] => OperatorCommand::CutFromHere(CutStart::Usual),
        ["cut", "all"] => OperatorCommand::CutAll,
        ["cut", "ask"] => OperatorCommand::CutAsk,
        ["cut", "pierce"] => OperatorCommand::CutFromHere(CutStart::Pierce),
        ["cut", "moving"] => OperatorCommand::CutFromHere(CutStart::Moving),
        ["shift", rest @ ..] => OperatorCommand::Shift(parse_shift(rest)?),
        ["lead", "line"] => OperatorCommand::Lead(LeadShape::Line),
        ["lead", "arc"] => OperatorCommand::Lead(LeadShape::Arc),
        ["cutter", "off"] => OperatorCommand::CutterOff,
        ["cutter", "on"] => OperatorCommand::CutterOn,
        ["test", "pulse"] => OperatorCommand::TestPulse,
        ["sense", "test"] => OperatorCommand::SenseTest,
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
        ["back", rest @ ..] => parse_back(rest)?,
        ["pause"] => OperatorCommand::Pause,
        ["park"] => OperatorCommand::Park,
        ["pointer"] => OperatorCommand::Pointer,
        ["change", "done"] => OperatorCommand::ChangeDone,
        ["online"] => OperatorCommand::Online,
        ["height", "up"] => OperatorCommand::Height(HeightCommand::Up),
        ["height", "down"] => OperatorCommand::Height(HeightCommand::Down),
        ["height", "reset"] => OperatorCommand::Height(HeightCommand::Reset),
        ["height", "control", state @ ("on" | "off")] => {
            OperatorCommand::Height(HeightCommand::Control(*state == "on"))
        }
        ["follow", "spindle"] => OperatorCommand::FollowSpindle(true),
        ["follow", "off"] => OperatorCommand::FollowSpindle(false),
        ["tool", "free"] => OperatorCommand::ToolFree,
        ["spindle", "stop"] => OperatorCommand::SpindleStop,
        ["spindle", "start"] => OperatorCommand::SpindleStart,
        ["tool", "length", "by", mm] => OperatorCommand::ToolLength(EnteredLength::By(parse_tool_length(mm)?)),
        ["tool", "length", mm] => OperatorCommand::ToolLength(EnteredLength::To(parse_tool_length(mm)?)),
        ["jog", axis, mm] => OperatorCommand::Jog { axis: parse_axis(axis)?, mm: parse_length(mm)? },
        [] => return wrong("nothing to do", "at 1.5s hold"),
        [first, ..] => {
            let known = [
                "hold",
                "resume",
                "reverse",
                "forward",
                "override",
                "wheel",
                "leave",
                "agree",
                "output",
                "single",
                "stop",
                "back",
                "pause",
                "spindle",
                "jog",
                "online",
                "cycle",
                "recover",
                "cutter",
                "optional",
                "rapid",
                "skip",
                "test",
                "tool",
                "follow",
                "cut",
                "shift",
                "lead",
                "contours",
                "park",
                "pointer",
                "change",
                "height",
                "sense",
                "consumables",
            ];
            let remedy = match nearest(first, known) {
                Some(word) if word != *first => format!("did you mean `{word}`?"),
                Some(word) => usage_example(word).into(),
                None => format!("one of {}", known.join(", ")),
            };
            return wrong(format!("`{}` is not understood", words.join(" ")), remedy);
        }
    })
}

/// Example of a complete command that begins with this word.
fn usage_example(word: &str) -> &'static str {
    match word {
        "change" => "change done",
        "back" => "back 50 mm · back to block · back to pierce · back to cut end · back to contour 3",
        "cut" => "cut · cut pierce · cut moving",
        "shift" => "shift 1.5 -0.8 · shift nw · shift 0",
        "lead" => "lead line · lead arc",
        "spindle" => "spindle stop · spindle start",
        "follow" => "follow spindle · follow off",
        "height" => "height up · height down · height reset · height control off · height control on",
        "jog" => "jog z 10",
        "tool" => "tool length 84.2 · tool length by -0.35",
        "cycle" => "cycle start",
        "cutter" => "cutter off · cutter on",
        "optional" => "optional stop on · optional stop off",
        "rapid" => "rapid override 50%",
        "speed" => "speed override 80%",
        "sense" => "sense test",
        "consumables" => "consumables changed",
        "skip" => "skip contour · skip contour 3 · skip contour 3 off",
        "test" => "test pulse",
        "recover" => "recover, without arguments",
        "contours" => "contours, without arguments",
        "pause" | "online" => "pause and online stand alone",
        _ => "reverse 100% · override 60% · wheel -120 for 2s · leave ask · output 3 on",
    }
}

fn parse_back(words: &[&str]) -> Result<OperatorCommand, InstructionError> {
    match words {
        ["to", "block"] => Ok(OperatorCommand::BackToBlock),
        ["to", "pierce"] => Ok(OperatorCommand::BackToPierce),
        ["to", "cut", "end"] => Ok(OperatorCommand::BackToCutEnd),
        ["to", "contour", number] => Ok(OperatorCommand::BackToContour(parse_contour(number, "back to contour 3")?)),
        [mm, "mm"] => match parse_length(mm)? {
            mm if mm > 0.0 => Ok(OperatorCommand::BackBy(mm)),
            _ => wrong(format!("`back {mm} mm` goes nowhere"), "a length above 0, as in back 50 mm"),
        },
        _ => wrong(format!("`back {}` is not understood", words.join(" ")), usage_example("back")),
    }
}

fn parse_contour(word: &str, example: &str) -> Result<u32, InstructionError> {
    match word.parse() {
        Ok(number @ 1..) => Ok(number),
        _ => wrong(format!("`{word}` is not the number of a contour"), example),
    }
}

impl std::str::FromStr for Shift {
    type Err = String;

    /// Parses what is entered for a shift: two lengths in mm with a comma or a space, a direction, or 0.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let words: Vec<&str> = text.split([',', ' ']).filter(|word| !word.is_empty()).collect();
        parse_shift(&words).map_err(|_| "enter X and Y in mm such as 1.5,-0.8, a direction such as nw, or 0".into())
    }
}

fn parse_shift(words: &[&str]) -> Result<Shift, InstructionError> {
    match words {
        ["0"] => Ok(Shift::To([0.0; 2])),
        [x, y] => Ok(Shift::To([parse_length(x)?, parse_length(y)?])),
        [direction] if DIRECTIONS.iter().any(|(name, _)| name == direction) => {
            let found = DIRECTIONS.iter().find(|(name, _)| name == direction);
            Ok(Shift::Steps(found.map_or([0; 2], |(_, steps)| *steps)))
        }
        _ => wrong(format!("`shift {}` is not understood", words.join(" ")), usage_example("shift")),
    }
}

/// Parses a length in mm (degrees), signed.
fn parse_length(word: &str) -> Result<f64, InstructionError> {
    match parse_number(word)? {
        mm if mm.abs() <= 1e6 => Ok(mm),
        _ => wrong(format!("`{word}` is farther than any machine goes"), "a length in mm, such as 10"),
    }
}

/// Parses a tool length, or a difference of two, in mm.
fn parse_tool_length(word: &str) -> Result<f64, InstructionError> {
    match parse_number(word)? {
        mm if mm.abs() <= 10_000.0 => Ok(mm),
        _ => wrong(format!("`{word}` is not a length of a tool"), "a length in mm, such as 84.2"),
    }
}

fn parse_axis(word: &str) -> Result<char, InstructionError> {
    let mut letters = word.chars().map(|letter| letter.to_ascii_lowercase());
    match (letters.next(), letters.next()) {
        (Some(letter), None) if AXIS_LETTERS.contains(&letter) => Ok(letter),
        _ => wrong(format!("`{word}` is not an axis"), "x, y, z, a, b, c, u, v or w, as in jog z 10"),
    }
}

fn parse_number(word: &str) -> Result<f64, InstructionError> {
    match word.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => wrong(format!("`{word}` is not a number"), "a number such as 1.5"),
    }
}

fn parse_seconds(word: &str) -> Result<f64, InstructionError> {
    let value = parse_number(word.strip_suffix('s').unwrap_or(word))?;
    if (0.0..=1e9).contains(&value) {
        Ok(value)
    } else {
        wrong(format!("`{word}` is not a time"), "a time such as 1.5s")
    }
}

fn parse_rate(word: &str) -> Result<Rate, InstructionError> {
    let Some(digits) = word.strip_suffix('%') else {
        return wrong(format!("`{word}` is not a rate"), "a rate such as 60%");
    };
    let value = parse_number(digits)?;
    if !(0.0..=800.0).contains(&value) {
        return wrong(format!("a rate of {word}"), "a rate from 0% to 800%");
    }
    // Rounded to a hundredth of a per cent, so that 100 % is exactly 1 and no other input is.
    let steps = (value * 100.0).round() as i64;
    Ok((Rate::ONE * steps + Rate::from_units(5_000)) / 10_000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_every_instruction_of_the_interface() {
        let text = "at 1.5s   hold\nafter 1s  resume  # cycle start\n\nat 2.0s reverse 100%\nafter 300 periods \
            forward 50%\n\
            at line 40 override 60%\nafter 1s wheel -120 for 2s\nafter 1s leave\nafter 0s leave ask\nafter 0s agree\n\
            after 0s output 3 on\nafter 0s single\nat 9s stop\nafter 0s cycle start\n";
        let script = parse_script(text, "script").expect("all known");
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
                command: OperatorCommand::Forward(Rate::ONE / 2)
            }
        );
        assert_eq!(script[4].when, ScriptTime::Line(40));
        assert_eq!(script[5].command, OperatorCommand::Wheel { counts_per_s: -120.0, seconds: 2.0 });
        assert_eq!(script[9].command, OperatorCommand::Output { number: 3, on: true });
    }

    #[test]
    fn every_deed_reads_back_as_it_is_written() {
        let deeds = "hold|resume|reverse 100%|forward 50%|override 160%|wheel -120 for 2s|leave|leave \
            ask|agree|output 3 on|single|\
            stop|back 50 mm|back 0.25 mm|back to block|back to pierce|pause|spindle stop|spindle start|jog z 10|jog x \
            -0.5|online|cycle start|recover|cutter off|cutter on|optional stop on|optional stop off|output 64 \
            off|rapid override 25%|\
            speed override 80%|back to cut end|cut|cut pierce|cut moving|shift 1.5 -0.8|shift 0 0|shift nw|\
            contours|skip contour|skip contour 7|skip contour 7 off|back to contour 3|test pulse|\
            sense test|consumables changed";
        for written in deeds.split('|') {
            let script = parse_script(&format!("after 0s {written}"), "script").expect(written);
            assert_eq!(script[0].command.to_string(), written);
        }
        assert_eq!(parse_script("at 1s cycle start", "s").expect("known")[0].command, OperatorCommand::CycleStart);
        assert_eq!(parse_script("at 1s back 50 mm", "s").expect("known")[0].command, OperatorCommand::BackBy(50.0));
    }

    #[test]
    fn says_where_and_what_was_meant() {
        let refusal = |text: &str| parse_script(text, "script").expect_err("wrong");
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
            "at 1s shift 1",
            "at 1s shift nnw",
            "after 1s back to the block",
            "after 1s back inf mm",
            "after 1s skip contour 0",
            "after 1s skip contour 3 on",
            "after 1s jog q 10",
            "after 1s jog z far",
            "after 1s spindle",
            "at 1s",
        ] {
            assert_eq!(refusal(bad).number, "E2121", "{bad}");
        }
    }
}
