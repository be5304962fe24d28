//! The words of an order of a page: those of the scripted operator, and those for a machine on which no job runs.
//!
//! Invariant: the same words mean the same everywhere; what cannot be understood is refused with the words that could
//! have been meant.

use retrace_config::NumberedError;
use retrace_controller::{FrameShape, ManualTask, OperatorCommand, parse_operator_command};
use retrace_tui::{ScreenModel, ScreenStage, UiCommand, tool_length_touching};

/// What an order does.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Order {
    /// A command of the operator.
    Command(UiCommand),
    /// Opens a program of the programs folder.
    Open(String),
    /// Resumes this job.
    Resume(String),
}

/// Parses the words of an order, for the stage that the model shows.
///
/// # Errors
/// `E2121` with what was expected.
pub(crate) fn parse(words: &str, model: &ScreenModel) -> Result<Order, NumberedError> {
    let is_job = model.stage == ScreenStage::Job;
    let words = words.trim();
    let (first, rest) = words.split_once(char::is_whitespace).unwrap_or((words, ""));
    let (rest, task) = (rest.trim(), |task| Ok(Order::Command(UiCommand::Task(task))));
    let command = |command| Ok(Order::Command(command));
    let number = |text: &str| {
        text.parse::<u32>().ok().filter(|&number| number > 0).ok_or_else(|| {
            NumberedError::new(
                "E2121",
                format!("`{text}` is not a number from 1 on"),
                "start contour 3 · start line 120",
            )
        })
    };
    match (first, rest) {
        ("cycle", "start") if !is_job || model.is_at_program_end() => command(UiCommand::Start),
        ("start", rest) if rest.starts_with("contour ") => command(UiCommand::StartContour(number(&rest[8..])?)),
        ("start", rest) if rest.starts_with("line ") => command(UiCommand::StartLine(number(&rest[5..])?)),
        ("start", rest) if rest.starts_with("job ") => {
            let (id, pieces) = match rest[4..].trim().split_once(' ') {
                Some((id, pieces)) => (id, number(pieces.trim())?),
                None => (rest[4..].trim(), 1),
            };
            command(UiCommand::StartShopJob { id: id.to_owned(), pieces })
        }
        ("set", "up") => command(UiCommand::SetUp),
        ("home", "") => task(ManualTask::Home(None)),
        ("home", letter) => task(ManualTask::Home(Some(axis(letter, model)?))),
        ("mdi", "") => Err(NumberedError::new("E2121", "no block to execute", "mdi G0 X10")),
        ("mdi", block) => task(ManualTask::Mdi(block.to_owned())),
        ("probe", call) => ManualTask::probing_cycle(call)
            .map_err(|why| NumberedError::new("E2121", why, "probe surface z- 20 g54"))
            .and_then(task),
        ("zero", "" | "all") => task(ManualTask::WorkZero(None)),
        ("zero", letter) => task(ManualTask::WorkZero(Some(axis(letter, model)?))),
        ("frame", "") => command(UiCommand::Frame(FrameShape::Rectangle)),
        ("frame", "outline") => command(UiCommand::Frame(FrameShape::Outline)),
        ("sheet", "point") => command(UiCommand::SheetPoint),
        ("sheet", "align") => command(UiCommand::AlignSheet),
        ("sheet", "forget") => command(UiCommand::ForgetSheet),
        ("dry", "run on") => command(UiCommand::DryRun(true)),
        ("dry", "run off") => command(UiCommand::DryRun(false)),
        ("reset", "") if model.alarm.as_ref().is_some_and(|alarm| alarm.is_refusal) => command(UiCommand::CloseRefusal),
        ("reset", "") => task(ManualTask::ClearAlarm),
        ("open", name) if !name.is_empty() => Ok(Order::Open(name.to_owned())),
        ("resume", job) if job.starts_with("job ") => Ok(Order::Resume(job[4..].trim().to_owned())),
        ("yes", "") => command(UiCommand::Answer(true)),
        ("no", "") => command(UiCommand::Answer(false)),
        ("tool", rest) if rest.starts_with("length at ") => {
            let touched = tool_length_touching(model, rest[10..].trim().parse().unwrap_or(f64::NAN));
            let length =
                touched.map_err(|why| NumberedError::new("E2121", why, "tool length at 0, at rest in a pause"))?;
            command(UiCommand::Job(OperatorCommand::ToolLength(length)))
        }
        ("wheel", "") => command(UiCommand::Job(OperatorCommand::Wheel { counts_per_s: 0.0, seconds: 0.0 })),
        _ => command(at_stage(parse_operator_command(words)?, is_job)),
    }
}

/// The command as it is at this stage: a manual task where no job runs.
fn at_stage(command: OperatorCommand, is_job: bool) -> UiCommand {
    match command {
        OperatorCommand::CutterOff => UiCommand::CutterOff,
        OperatorCommand::OptionalStop(on) => UiCommand::OptionalStop(on),
        OperatorCommand::Output { number, on } if !is_job => UiCommand::Task(ManualTask::Output(number, i32::from(on))),
        OperatorCommand::Jog { axis, mm } if !is_job => UiCommand::Task(ManualTask::Jog { axis, mm }),
        OperatorCommand::TestPulse if !is_job => UiCommand::Task(ManualTask::TestPulse),
        OperatorCommand::SkipContourAhead { number, on } if !is_job => UiCommand::SkipContour { number, on },
        OperatorCommand::ConsumablesChanged if !is_job => UiCommand::ConsumablesChanged,
        OperatorCommand::SenseTest if !is_job => UiCommand::Task(ManualTask::SenseTest),
        command => UiCommand::Job(command),
    }
}

/// Letter of an axis of the machine, in lower case.
pub(crate) fn axis(text: &str, model: &ScreenModel) -> Result<char, NumberedError> {
    let lower = text.to_ascii_lowercase();
    let found = model.facts.axes.iter().find(|axis| lower == axis.letter.to_string());
    found.map(|axis| axis.letter).ok_or_else(|| {
        let letters: Vec<String> = model.facts.axes.iter().map(|axis| axis.letter.to_string()).collect();
        NumberedError::new("E2161", format!("the machine has no axis {text}"), format!("one of {}", letters.join(", ")))
    })
}

/// Whether a command may start motion, so that the operator must have seen the present state.
pub(crate) fn starts_motion(order: &Order) -> bool {
    let Order::Command(command) = order else { return true };
    if let UiCommand::Job(OperatorCommand::Wheel { counts_per_s, .. }) = command {
        // Taking the handwheel stops the motion, and nothing moves until it is turned.
        return *counts_per_s != 0.0;
    }
    !matches!(
        command,
        UiCommand::CutterOff
            | UiCommand::SheetPoint
            | UiCommand::ForgetSheet
            | UiCommand::SkipContour { .. }
            | UiCommand::ConsumablesChanged
            | UiCommand::Turn(_)
            | UiCommand::OptionalStop(_)
            | UiCommand::Answer(false)
            | UiCommand::CloseRefusal
            | UiCommand::Job(
                OperatorCommand::Hold
                    | OperatorCommand::Stop
                    | OperatorCommand::Pause
                    | OperatorCommand::Override(_)
                    | OperatorCommand::RapidOverride(_)
                    | OperatorCommand::SpeedOverride(_)
                    | OperatorCommand::CutterOff
                    | OperatorCommand::SkipContourAhead { .. }
                    | OperatorCommand::ConsumablesChanged
                    | OperatorCommand::SpindleStop
                    | OperatorCommand::Single
            )
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use retrace_config::MachineConfig;
    use retrace_controller::EnteredLength;
    use retrace_core::Rate;
    use retrace_tui::ProgramFacts;
    use std::sync::Arc;

    fn model(stage: ScreenStage) -> ScreenModel {
        let machine = MachineConfig::built_in().expect("valid");
        let mut model = ScreenModel::new(Arc::new(ProgramFacts::of(&machine, "part.ngc", "M2\n")));
        model.stage = stage;
        model
    }

    #[test]
    fn words_are_commands_of_the_stage() {
        let (setup, job) = (model(ScreenStage::Setup), model(ScreenStage::Job));
        let parsed = |words: &str, model: &ScreenModel| parse(words, model).expect(words);
        let command = Order::Command;
        assert_eq!(parsed("cycle start", &setup), command(UiCommand::Start));
        assert_eq!(parsed("cycle start", &job), command(UiCommand::Job(OperatorCommand::CycleStart)));
        let (out, jog) =
            (OperatorCommand::Output { number: 3, on: true }, OperatorCommand::Jog { axis: 'x', mm: -2.5 });
        assert_eq!(parsed("output 3 on", &job), command(UiCommand::Job(out)));
        assert_eq!(parsed("output 3 on", &setup), command(UiCommand::Task(ManualTask::Output(3, 1))));
        assert_eq!(parsed("jog x -2.5", &job), command(UiCommand::Job(jog)));
        assert_eq!(parsed("jog X -2.5", &setup), command(UiCommand::Task(ManualTask::Jog { axis: 'x', mm: -2.5 })));
        assert_eq!(parsed("reverse 50%", &job), command(UiCommand::Job(OperatorCommand::Reverse(Rate::percent(50)))));
        assert_eq!(parsed("mdi G0 X1 Y2", &setup), command(UiCommand::Task(ManualTask::Mdi("G0 X1 Y2".into()))));
        let block = "o<probe_surface> call [-3] [20 / [1 + 24.4 * #<_imperial>]] [1]";
        let probe = parsed("probe surface z- 20 G54", &setup);
        assert_eq!(probe, command(UiCommand::Task(ManualTask::Mdi(block.into()))));
        assert_eq!(parsed("zero", &setup), command(UiCommand::Task(ManualTask::WorkZero(None))));
        assert_eq!(parsed("home Z", &setup), command(UiCommand::Task(ManualTask::Home(Some('z')))));
        assert_eq!(parsed("frame", &setup), command(UiCommand::Frame(FrameShape::Rectangle)));
        assert_eq!(parsed("sheet point", &setup), command(UiCommand::SheetPoint));
        assert_eq!(parsed("sheet align", &setup), command(UiCommand::AlignSheet));
        let mut paused = model(ScreenStage::Job);
        (paused.at_rest, paused.counts[2], paused.work_zero_mm[2]) = (true, 12_350, -20.0);
        for (words, by) in [("tool length at 0", 32.35), ("tool length at -1.5", 33.85)] {
            let length = OperatorCommand::ToolLength(EnteredLength::By(by));
            assert_eq!(parsed(words, &paused), command(UiCommand::Job(length)));
        }
        assert_eq!(parse("tool length at x", &paused).expect_err("no number").number, "E2121");
        paused.at_rest = false;
        assert!(parse("tool length at 0", &paused).expect_err("in motion").cause.contains("stands"));
        assert_eq!(parsed("start line 120", &setup), command(UiCommand::StartLine(120)));
        for (words, pieces) in [("start job 0192-1", 1), ("start job 0192-1 3", 3)] {
            assert_eq!(parsed(words, &setup), command(UiCommand::StartShopJob { id: "0192-1".into(), pieces }));
        }
        assert_eq!(parsed("open part 2.ngc", &setup), Order::Open("part 2.ngc".into()));
        assert_eq!(parsed("resume job 2026-1", &setup), Order::Resume("2026-1".into()));
    }

    /// The cycles of the page are those that the words call, with as many arguments.
    #[test]
    fn the_page_has_the_probing_cycles() {
        let page = include_str!("../page/probe_panel.js");
        let forms = ManualTask::probing_forms();
        assert_eq!(page.matches("word: '").count(), forms.len());
        for form in forms {
            let (word, arguments) = form.split_once(' ').unwrap_or((form, ""));
            let entry = page.split(&format!("word: '{word}'")).nth(1).unwrap_or_default();
            let fields = entry.split("sets:").next().unwrap_or_default();
            let count = fields.matches("direction(").count() + fields.matches("length(").count();
            assert_eq!(count, arguments.split(' ').count(), "{form}");
        }
    }

    #[test]
    fn what_is_not_understood_is_refused_by_number() {
        let setup = model(ScreenStage::Setup);
        for (words, number) in [
            ("", "E2121"),
            ("revers 50%", "E2121"),
            ("start line 0", "E2121"),
            ("start contour x", "E2121"),
            ("home q", "E2161"),
            ("mdi", "E2121"),
            ("probe surface", "E2121"),
            ("start", "E2121"),
        ] {
            assert_eq!(parse(words, &setup).expect_err(words).number, number, "{words}");
        }
    }

    #[test]
    fn what_only_stops_needs_no_seen_state() {
        let job = model(ScreenStage::Job);
        for (words, starts) in [
            ("hold", false),
            ("stop", false),
            ("cutter off", false),
            ("override 50%", false),
            ("wheel", false),
            ("wheel 0 for 0s", false),
            ("wheel -120 for 2s", true),
            ("cycle start", true),
            ("reverse 100%", true),
            ("recover", true),
            ("output 0 on", true),
            ("cutter on", true),
            ("mdi G0 X1", true),
            ("probe bore 20 5", true),
            ("open a", true),
            ("start job 0192", true),
        ] {
            assert_eq!(starts_motion(&parse(words, &job).expect(words)), starts, "{words}");
        }
    }
}
