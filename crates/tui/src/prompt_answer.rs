//! Answers to the questions of prompts, as commands.
//!
//! Invariant: what is no answer is told with what would be one.

use retrace_controller::{EnteredLength, LeadShape, ManualTask, OperatorCommand};

use crate::files;
use crate::model::{ScreenModel, ScreenStage};
use crate::pending_question::PendingQuestion;
use crate::tool_touch;
use crate::ui_command::UiCommand;

/// Command of a prompt's answer, or the error in it.
pub(crate) fn answer(ask: PendingQuestion, text: &str, model: &ScreenModel) -> Result<UiCommand, String> {
    match ask {
        PendingQuestion::BackBy if text.starts_with('c') => match text[1..].trim().parse::<u32>() {
            Ok(number @ 1..) => Ok(UiCommand::Job(OperatorCommand::BackToContour(number))),
            _ => Err("enter the number of a contour, such as c3".into()),
        },
        PendingQuestion::BackBy => match text.parse::<f64>() {
            Ok(mm) if mm.is_finite() && mm > 0.0 => Ok(UiCommand::Job(OperatorCommand::BackBy(mm))),
            _ => Err("enter a distance above 0 mm, such as 20, or a contour, such as c3".into()),
        },
        PendingQuestion::Shift if text == "arc" => Ok(UiCommand::Job(OperatorCommand::Lead(LeadShape::Arc))),
        PendingQuestion::Shift if text == "line" => Ok(UiCommand::Job(OperatorCommand::Lead(LeadShape::Line))),
        PendingQuestion::Shift => text.parse().map(|shift| UiCommand::Job(OperatorCommand::Shift(shift))),
        PendingQuestion::Output => output(text, model),
        PendingQuestion::Mdi if text.is_empty() => Err("enter a block such as G0 X10".into()),
        PendingQuestion::Mdi => Ok(UiCommand::Task(ManualTask::Mdi(text.into()))),
        PendingQuestion::Probe => ManualTask::probing_cycle(text).map(UiCommand::Task),
        PendingQuestion::WorkZero => {
            let lower = text.to_ascii_lowercase();
            let axis = model.facts.axes.iter().find(|axis| lower == axis.letter.to_string());
            match (lower.as_str(), axis) {
                ("all", _) => Ok(UiCommand::Task(ManualTask::WorkZero(None))),
                // The turn of the system in force, which a zero does not end.
                ("straight", _) => Ok(UiCommand::Task(ManualTask::Mdi("G10 L2 P0 R0".into()))),
                (_, Some(axis)) => Ok(UiCommand::Task(ManualTask::WorkZero(Some(axis.letter)))),
                _ => Err("enter all, an axis letter or straight".into()),
            }
        }
        PendingQuestion::ToolLength if text.starts_with("at ") => {
            let at_mm = text[3..].trim().parse().unwrap_or(f64::NAN);
            tool_touch::length_touching(model, at_mm).map(tool_length)
        }
        // With a sign it is the difference to the old tool.
        PendingQuestion::ToolLength => match text.parse::<f64>() {
            Ok(mm) if mm.abs() <= 10_000.0 && text.starts_with(['+', '-']) => Ok(tool_length(EnteredLength::By(mm))),
            Ok(mm) if (0.0..=10_000.0).contains(&mm) => Ok(tool_length(EnteredLength::To(mm))),
            _ => Err("enter a length in mm such as 84.2, a difference such as +0.35, or at 0".into()),
        },
        PendingQuestion::Stop => Ok(UiCommand::Job(OperatorCommand::Stop)),
        PendingQuestion::TestPulse if model.stage == ScreenStage::Job => Ok(UiCommand::Job(OperatorCommand::TestPulse)),
        PendingQuestion::SenseTest if model.stage == ScreenStage::Job => Ok(UiCommand::Job(OperatorCommand::SenseTest)),
        PendingQuestion::TestPulse | PendingQuestion::SenseTest if !model.homed => Err("home the machine first".into()),
        PendingQuestion::ConsumablesChanged if model.stage == ScreenStage::Job => {
            Ok(UiCommand::Job(OperatorCommand::ConsumablesChanged))
        }
        PendingQuestion::ConsumablesChanged => Ok(UiCommand::ConsumablesChanged),
        PendingQuestion::SenseTest => Ok(UiCommand::Task(ManualTask::SenseTest)),
        PendingQuestion::TestPulse => Ok(UiCommand::Task(ManualTask::TestPulse)),
        PendingQuestion::StartTurned => Ok(UiCommand::Start),
        PendingQuestion::StartContour(number) => Ok(UiCommand::StartContour(number)),
        PendingQuestion::SheetPoint => Ok(UiCommand::SheetPoint),
        PendingQuestion::AlignSheet => Ok(UiCommand::AlignSheet),
        PendingQuestion::Frame(shape) => Ok(UiCommand::Frame(shape)),
        PendingQuestion::Program if text.is_empty() => Err("enter the path of a program file".into()),
        PendingQuestion::Program => Ok(UiCommand::Load(files::expanded(text))),
    }
}

fn tool_length(length: EnteredLength) -> UiCommand {
    UiCommand::Job(OperatorCommand::ToolLength(length))
}

/// Parses an output command: `3+` switches output 3 on, `3-` off; a name may replace the number. Without a sign the
/// output is toggled, unless it fires a cutter.
fn output(text: &str, model: &ScreenModel) -> Result<UiCommand, String> {
    let name = text.trim_end_matches(['+', '-']);
    let Some(number) = model.facts.output_named(name) else {
        return Err("enter a number from 0 to 63 or a name, then + or -: 3+, 3-".into());
    };
    let on = match &text[name.len()..] {
        "" if model.facts.is_of_cutter(number) => return Err("add + for on or - for off".into()),
        "" => model.output(number) == 0,
        "+" => true,
        "-" => false,
        _ => return Err("add + for on or - for off".into()),
    };
    Ok(match model.stage {
        ScreenStage::Job => UiCommand::Job(OperatorCommand::Output { number, on }),
        _ => UiCommand::Task(ManualTask::Output(number, i32::from(on))),
    })
}
