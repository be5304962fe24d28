//! Events: one stream for the screen, the JSON output and the report.
//!
//! Invariant: every event carries the period and the place at which it happened.

use std::sync::Arc;

use retrace_config::ChannelNames;
use retrace_core::mode::Mode;
use retrace_core::{Place, RecordIndex};
use retrace_journal::Timestamp;
use retrace_link::{Alarm, CardFailure, channel};
use serde_json::{Value, json};

use crate::contour_list::RestoredContour;
use crate::cutter_off_reason::CutterOffReason;
use crate::cutter_state::CutterState;
use crate::differing_outputs::DifferingOutputs;
use crate::dnc_events::{AxisCounts, DncEvent};
use crate::operator::{CommandError, LeadShape, OperatorCommand, StartSide};
use crate::plan_item::HEIGHT;
use crate::sense_outcome::SenseOutcome;

/// A cause that stops the machine for the rest of the run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CardError {
    /// The card has latched this alarm, and brakes on the path.
    Latched(Alarm),
    /// A fault of the card, or of the link to it. Nothing of this run will move the machine again.
    Fault {
        /// Number in `docs/errors.md`.
        number: &'static str,
        /// What is wrong.
        cause: String,
        /// What to do.
        remedy: String,
    },
}

impl CardError {
    /// Number in `docs/errors.md`, cause, and remedy.
    #[must_use]
    pub fn parts(&self) -> (&'static str, String, String) {
        match self {
            Self::Latched(alarm) => (alarm.number(), alarm.to_string(), alarm.remedy().to_string()),
            Self::Fault { number, cause, remedy } => (number, cause.clone(), remedy.clone()),
        }
    }
}

impl std::fmt::Display for CardError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (number, cause, _) = self.parts();
        write!(f, "{number}: {cause}")
    }
}

impl std::error::Error for CardError {}

impl<F: CardFailure> From<F> for CardError {
    fn from(fault: F) -> Self {
        Self::Fault { number: fault.number(), cause: fault.to_string(), remedy: fault.remedy().to_string() }
    }
}

/// Kind of an event, with its data.
#[derive(Clone, Debug, PartialEq)]
pub enum EventKind {
    /// The job began.
    Started,
    /// The mode of operation changed; with its name.
    Mode(Mode),
    /// The operator gave a command.
    Operator(OperatorCommand),
    /// Another feed override is planned from here on: 100 % or more.
    OverridePlanned(f64),
    /// From here on the operator's overrides apply, or the program has switched them off.
    FeedOverrideSwitched(bool),
    /// A command was rejected; with the reason.
    CommandRejected(CommandError),
    /// Reverse run rests at the history start (REV-8).
    HistoryStartReached,
    /// Reverse run rests at a retrace barrier.
    RetraceBarrier {
        /// Its code.
        code: &'static str,
        /// Whether another `reverse` passes it: it is the end of a thread.
        is_passed_again: bool,
    },
    /// Reverse run rests where the program switched the cutter, with the cutter on manually.
    CutterBoundary,
    /// Reverse run rests at its target.
    BackTargetReached,
    /// The handwheel has returned to the furthest place ever executed, where it ends.
    HistoryEndReached,
    /// The machine rests at `reached`, and outputs differ.
    OutputsDiffer(DifferingOutputs),
    /// A probing move is over: whether the probe has responded, and the counts of the card's axes at the touch, or
    /// where the machine came to rest.
    Probed {
        /// Whether the probe has responded.
        touched: bool,
        /// Counts of the axes.
        counts: AxisCounts,
    },
    /// A rigid tap is complete: the turns of the spindle from the command to reverse it until it stood.
    Tapped {
        /// The turns.
        reversal_turns: f64,
    },
    /// A rigid tap is due.
    Tapping {
        /// Where it begins on the card's path of manual moves.
        card_place: RecordIndex,
        /// Whether the tool is in its hole already, where the job was left in the tap.
        is_resumed: bool,
    },
    /// The job ended before a rigid tap that was due had begun.
    TapNotBegun,
    /// A sense test has ended: letter of the tool axis, and its result.
    SenseTest {
        /// Letter of the tool axis, lower case.
        axis: char,
        /// Result.
        outcome: SenseOutcome,
    },
    /// Outputs were restored to what the program expects.
    OutputsRestored,
    /// The tool was lifted off the sheet where a cut was interrupted (CUT-31).
    ToolLifted,
    /// A restart executes an instruction again; with its code.
    RestartSwitching(&'static str),
    /// The instruction of a restart is complete.
    RestartSwitched(&'static str),
    /// A cutting output, or the spindle at the end of a job, was switched off.
    CutterOff {
        /// Channel.
        channel: u8,
        /// Reason.
        reason: CutterOffReason,
    },
    /// The state of a cutter has changed (CUT-2).
    CutterState {
        /// Channel that fires it.
        channel: u8,
        /// New state.
        state: CutterState,
        /// Number of the contour that is being cut, or was cut last; 0 before the first.
        contour: u32,
    },
    /// The end of the cut (CUT-30): the cutter went out there, and what the program cuts behind it is not cut.
    CutEnd {
        /// Channel.
        channel: u8,
        /// Place where the cut ends.
        place: Place,
        /// Program line there.
        line: u32,
        /// Whether the cut may go on behind it: the place is that of a journal.
        may_be_longer: bool,
        /// Record up to which it may go on, as far as that is known: an arc struck nowhere before.
        latest: RecordIndex,
    },
    /// A cut was continued beyond the place where it had ended; the length in mm that is not cut.
    NotCut(f64),
    /// An interrupted cut is continued: its end is passed, or is cut anew.
    CutContinued,
    /// A job is resumed: the contours that were begun before it was left, in the order of the path.
    ContoursRestored(Arc<[RestoredContour]>),
    /// The loss of the cutter is watched from here on, or not watched: the program says so.
    LossWatch {
        /// Whether it is watched.
        is_watched: bool,
    },
    /// A contour has ended.
    Contour {
        /// Its number in the program, from 1.
        number: u32,
        /// Length that is cut, mm.
        cut_mm: f64,
        /// Length that is not cut, mm.
        not_cut_mm: f64,
    },
    /// The operator skips a contour ahead, or cuts it after all.
    ContourSkip {
        /// Its number.
        number: u32,
        /// Whether it is skipped.
        on: bool,
    },
    /// The next start of the cutter lies at this distance from its place on the path, X and Y in mm.
    Shift([f64; 2], Option<StartSide>),
    /// How shifted starts lead in.
    Lead(LeadShape),
    /// The torch is to pierce in a kerf, over which no arc strikes.
    StartInKerf,
    /// The lead-in has joined the path.
    Joined,
    /// The program is executed again from here, where it was executed before.
    CutFromHere {
        /// Whether the cutter starts in motion.
        moving: bool,
    },
    /// The operator has switched a cutter on; with its channel.
    CutterOn(u8),
    /// An output was switched because the path is retraced: channel and new value.
    RetraceSwitched(u8, i32),
    /// Normal run was resumed.
    RunResumed,
    /// The program has ended, and the job waits for its release: reverse run is still possible.
    ProgramEnd,
    /// An exclusive instruction begins.
    Switching(&'static str),
    /// An exclusive instruction is complete.
    Switched(&'static str),
    /// A synchronous action was executed: channel and new value.
    OutputChanged(u8, i32),
    /// A program stop waits for cycle start.
    ProgramStop(&'static str),
    /// A manual tool change waits for cycle start: the number of the tool, 0 for none.
    ToolChange(i32),
    /// Single block: the machine rests at the end of a block.
    SingleBlock,
    /// A step of a DNC pause (DNC-1 … DNC-8).
    Dnc(DncEvent),
    /// A message of the program.
    Message(String),
    /// The stream of the program has stalled.
    StreamStalled {
        /// Name of the sender.
        source: String,
        /// Time since which it has stalled.
        since: Timestamp,
    },
    /// A stalled stream has continued or ended.
    StreamResumed {
        /// Name of the sender.
        source: String,
        /// Duration of the wait, s.
        waited_s: f64,
    },
    /// The look-ahead ran dry.
    Underrun,
    /// An alarm.
    Alarm(CardError),
}

/// An event.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// Control periods since the start.
    pub period: u64,
    /// Machine time in seconds.
    pub time_s: f64,
    /// Place of the cursor.
    pub place: Place,
    /// Program line that was being executed.
    pub line: u32,
    /// What happened.
    pub kind: EventKind,
}

impl Event {
    /// Whether a log for people leaves it out: the codes and the losses, or the readouts, show it already. S changes
    /// all along the path under G96; the moves of the height are no codes of the program.
    #[must_use]
    pub fn is_detail(&self) -> bool {
        matches!(
            self.kind,
            EventKind::CutterState { .. }
                | EventKind::Switching(HEIGHT)
                | EventKind::Switched(HEIGHT)
                | EventKind::OutputChanged(channel::SPEED, _)
                | EventKind::RetraceSwitched(channel::SPEED, _)
        )
    }

    /// Converts the event to one JSON object.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let mut value = match &self.kind {
            EventKind::Started => json!({"event": "started"}),
            EventKind::Mode(mode) => json!({"event": "mode", "mode": mode.name()}),
            EventKind::Operator(command) => json!({"event": "operator", "command": command.to_string()}),
            EventKind::OverridePlanned(percent) => json!({"event": "override_planned", "percent": percent}),
            EventKind::FeedOverrideSwitched(on) => json!({"event": "feed_override_switched", "on": on}),
            EventKind::CommandRejected(reason) => json!({"event": "command_rejected", "reason": reason.to_string()}),
            EventKind::HistoryStartReached => json!({"event": "history_start_reached"}),
            EventKind::RetraceBarrier { code, .. } => json!({"event": "retrace_barrier", "code": code}),
            EventKind::CutterBoundary => json!({"event": "cutter_boundary"}),
            EventKind::BackTargetReached => json!({"event": "back_target_reached"}),
            EventKind::HistoryEndReached => json!({"event": "history_end_reached"}),
            EventKind::OutputsDiffer(some) => {
                let list: Vec<Value> = some
                    .list()
                    .iter()
                    .map(|of| {
                        json!({
                            "channel": of.channel,
                            "actual": of.actual,
                            "expected": of.expected,
                            "code": Some(of.code).filter(|code| !code.is_empty()),
                            "line": Some(of.line).filter(|&line| line != 0),
                        })
                    })
                    .collect();
                json!({"event": "outputs_differ", "outputs": list})
            }
            EventKind::Probed { touched, counts } => {
                json!({"event": "probed", "touched": touched, "counts": counts.get()})
            }
            EventKind::Tapped { reversal_turns } => json!({"event": "tapped", "reversal_turns": reversal_turns}),
            EventKind::Tapping { card_place, is_resumed } => {
                json!({"event": "tapping", "card_place": card_place.number(), "resumed": is_resumed})
            }
            EventKind::TapNotBegun => json!({"event": "tap_not_begun"}),
            EventKind::ToolLifted => json!({"event": "tool_lifted"}),
            EventKind::SenseTest { axis, outcome } => json!({
                "event": "sense_test", "axis": axis, "result": outcome.name(), "position_mm": outcome.position_mm(),
            }),
            EventKind::OutputsRestored => json!({"event": "outputs_restored"}),
            EventKind::RestartSwitching(code) => json!({"event": "restart_switching", "code": code}),
            EventKind::RestartSwitched(code) => json!({"event": "restart_switched", "code": code}),
            EventKind::CutterOff { channel, reason } => {
                json!({"event": "cutter_off", "channel": channel, "reason": reason.name()})
            }
            EventKind::CutterState { channel, state, contour } => {
                json!({"event": "cutter_state", "channel": channel, "state": state.name(), "contour": contour})
            }
            EventKind::CutEnd { channel, place, line, may_be_longer, latest } => json!({
                "event": "cut_end", "channel": channel, "cut_record": place.record.number(),
                "cut_fraction": place.fraction, "cut_line": line, "may_be_longer": may_be_longer,
                "latest_record": latest.number(),
            }),
            EventKind::NotCut(mm) => json!({"event": "not_cut", "mm": mm}),
            EventKind::LossWatch { is_watched } => json!({"event": "loss_watch", "watched": is_watched}),
            EventKind::CutContinued => json!({"event": "cut_continued"}),
            EventKind::ContoursRestored(contours) => {
                let each = contours.iter().map(|&RestoredContour { number, line, cut_mm, not_cut_mm }| {
                    json!({"number": number, "line": line, "cut_mm": cut_mm, "not_cut_mm": not_cut_mm})
                });
                json!({"event": "contours_restored", "contours": each.collect::<Vec<_>>()})
            }
            EventKind::Contour { number, cut_mm, not_cut_mm } => {
                json!({"event": "contour", "number": number, "cut_mm": cut_mm, "not_cut_mm": not_cut_mm})
            }
            EventKind::ContourSkip { number, on } => json!({"event": "contour_skip", "number": number, "skipped": on}),
            EventKind::Shift([x, y], side) => json!({
                "event": "shift", "x_mm": x, "y_mm": y, "side": side.map(StartSide::name),
                "toward": side.and_then(StartSide::material_name),
            }),
            EventKind::Lead(shape) => json!({"event": "lead", "shape": shape.name()}),
            EventKind::StartInKerf => json!({"event": "start_in_kerf"}),
            EventKind::Joined => json!({"event": "joined"}),
            EventKind::CutFromHere { moving } => {
                json!({"event": "cut_from_here", "start": if *moving { "moving" } else { "pierce" }})
            }
            EventKind::CutterOn(channel) => json!({"event": "cutter_on", "channel": channel}),
            EventKind::RetraceSwitched(channel, value) => {
                json!({"event": "retrace_switched", "channel": channel, "value": value})
            }
            EventKind::RunResumed => json!({"event": "run_resumed"}),
            EventKind::ProgramEnd => json!({"event": "program_end"}),
            EventKind::Switching(code) => json!({"event": "switching", "code": code}),
            EventKind::Switched(code) => json!({"event": "switched", "code": code}),
            EventKind::OutputChanged(channel, value) => {
                json!({"event": "output_changed", "channel": channel, "value": value, "synchronous": true})
            }
            EventKind::ProgramStop(code) => json!({"event": "program_stop", "code": code}),
            EventKind::ToolChange(tool) => json!({"event": "tool_change", "tool": tool}),
            EventKind::SingleBlock => json!({"event": "single_block"}),
            EventKind::Dnc(dnc) => dnc.to_json(),
            EventKind::Message(text) => json!({"event": "message", "text": text}),
            EventKind::StreamStalled { source, since } => {
                json!({"event": "stream_stalled", "source": source, "since": since})
            }
            EventKind::StreamResumed { source, waited_s } => {
                json!({"event": "stream_resumed", "source": source, "waited_s": waited_s})
            }
            EventKind::Underrun => json!({"event": "underrun"}),
            EventKind::Alarm(error) => {
                let (number, cause, remedy) = error.parts();
                json!({"event": "alarm", "number": number, "cause": cause, "remedy": remedy})
            }
        };
        if let Value::Object(fields) = &mut value {
            fields.insert("period".into(), self.period.into());
            fields.insert("time_s".into(), json!(self.time_s));
            fields.insert("record".into(), self.place.record.number().into());
            fields.insert("fraction".into(), self.place.fraction.into());
            fields.insert("line".into(), self.line.into());
        }
        value
    }

    /// Converts the event to one JSON object, with the names of the channels, and the units of their values.
    #[must_use]
    pub fn to_json_naming(&self, names: &ChannelNames) -> Value {
        let mut value = self.to_json();
        let add_name = |output: &mut Value| {
            let channel = output["channel"].as_u64().and_then(|channel| u8::try_from(channel).ok());
            if let (Some(channel), Value::Object(fields)) = (channel, output) {
                fields.insert("name".into(), names.name(channel).into());
                if fields.contains_key("value") || fields.contains_key("actual") {
                    fields.insert("unit".into(), names.unit(channel).into());
                }
            }
        };
        value.get_mut("outputs").and_then(Value::as_array_mut).into_iter().flatten().for_each(add_name);
        add_name(&mut value);
        value
    }

    /// Formats the event as one line of plain text.
    #[must_use]
    pub fn to_line(&self, names: &ChannelNames) -> String {
        format!("{:10.3} s  line {:>6}  {}", self.time_s, self.line, self.text_naming(names))
    }

    /// Describes the event, with channels by their usual names.
    #[must_use]
    pub fn text(&self) -> String {
        self.text_naming(&ChannelNames::default())
    }

    /// Describes the event.
    #[must_use]
    pub fn text_naming(&self, names: &ChannelNames) -> String {
        let channel_name = |channel: u8| names.name(channel);
        match &self.kind {
            EventKind::Started => "started".into(),
            EventKind::Mode(mode) => mode_text(*mode).into(),
            EventKind::Operator(command) => format!("operator: {command}"),
            EventKind::Probed { touched: true, counts } => format!("the probe responded at counts {:?}", counts.get()),
            EventKind::Probed { touched: false, .. } => "the probe did not respond up to the end of the move".into(),
            EventKind::Tapped { reversal_turns } => {
                format!("tapped; the spindle took {reversal_turns:.2} turns to reverse")
            }
            EventKind::Tapping { is_resumed: false, .. } => "tapping".into(),
            EventKind::Tapping { is_resumed: true, .. } => {
                "held, with the tap in its hole: `cycle start` goes on, `follow spindle` lets it be turned out by hand"
                    .into()
            }
            EventKind::TapNotBegun => "the tap was not begun".into(),
            EventKind::OverridePlanned(percent) => format!("planned for an override of {percent} % from here on"),
            EventKind::FeedOverrideSwitched(true) => "overrides switched on again by the program".into(),
            EventKind::FeedOverrideSwitched(false) => "overrides switched off by the program: 100 %".into(),
            EventKind::CommandRejected(why) => format!("not done: {why}"),
            EventKind::HistoryStartReached => "at the history start: no further reverse run".into(),
            EventKind::RetraceBarrier { code, is_passed_again: false } => {
                format!("at rest behind {code}, which cannot be passed backward")
            }
            EventKind::RetraceBarrier { code, is_passed_again: true } => {
                format!("at rest behind {code}: `reverse` again turns its spindle backward, and passes it")
            }
            EventKind::CutterBoundary => {
                "at rest where the program switched the cutter, and it is on: `cutter off`, or `reverse` again to cut \
                    on"
                .into()
            }
            EventKind::BackTargetReached => "at the target of the reverse run".into(),
            EventKind::HistoryEndReached => "at the furthest place executed".into(),
            EventKind::OutputsDiffer(some) => {
                let list: Vec<String> = some
                    .list()
                    .iter()
                    .map(|of| {
                        let (name, origin) = (channel_name(of.channel), of.origin());
                        let [actual, expected] = [of.actual, of.expected].map(|n| names.value_text(of.channel, n));
                        format!("{name} is {actual}, program wants {expected}{origin}")
                    })
                    .collect();
                format!("outputs differ: {}; waiting for agree or recover", list.join("; "))
            }
            EventKind::ToolLifted => "the tool is lifted off the sheet".into(),
            EventKind::SenseTest { axis, outcome } => format!("sense test: {}", outcome.text(*axis)),
            EventKind::OutputsRestored => "outputs restored".into(),
            EventKind::RestartSwitching(code) => format!("restart: {code} begins"),
            EventKind::RestartSwitched(code) => format!("restart: {code} done"),
            EventKind::CutterOff { channel, reason } => format!("{} off: {}", channel_name(*channel), reason.text()),
            EventKind::CutterState { channel, state, .. } => format!("{}: {}", channel_name(*channel), state.name()),
            EventKind::CutEnd { channel, line, .. } => {
                format!("{}: the cut ends in line {line}", channel_name(*channel))
            }
            EventKind::LossWatch { is_watched: true } => "the loss of the cutter is watched again".into(),
            EventKind::LossWatch { is_watched: false } => "the loss of the cutter is NOT watched (M62 P1)".into(),
            EventKind::ContourSkip { number, on: true } => format!("contour {number} will be skipped"),
            EventKind::ContourSkip { number, on: false } => format!("contour {number} will be cut"),
            EventKind::NotCut(mm) => {
                format!(
                    "{mm:.2} mm behind the end of the cut are not cut; `back to pierce`, `cut` cuts the contour again"
                )
            }
            EventKind::CutContinued => "the cut goes on".into(),
            EventKind::ContoursRestored(contours) => restored_text(contours),
            EventKind::Contour { number, not_cut_mm: 0.0, .. } => format!("contour {number} is cut"),
            EventKind::Contour { number, not_cut_mm, .. } => {
                format!("contour {number}: {not_cut_mm:.2} mm are not cut")
            }
            EventKind::Shift([x, y], _) if [*x, *y] == [0.0; 2] => "the cutter starts on the path".into(),
            EventKind::Shift([x, y], side) => {
                let material =
                    side.and_then(StartSide::material_name).map_or(String::new(), |what| format!(", {what}"));
                let side = side.map_or(String::new(), |side| format!(": {}{material}", side.name()));
                // on a screen of 80 columns
                format!("start X{x:+.3} Y{y:+.3} mm beside the path{side}")
            }
            EventKind::Lead(LeadShape::Line) => "shifted starts lead in along a straight line".into(),
            EventKind::Lead(LeadShape::Arc) => "shifted starts lead in along an arc".into(),
            EventKind::StartInKerf => {
                "the torch is to pierce in a kerf: no arc strikes over a kerf; hold, and shift the start".into()
            }
            EventKind::Joined => "the lead-in has joined the path".into(),
            EventKind::CutFromHere { moving: true } => "cutting from here: the cutter starts in motion".into(),
            EventKind::CutFromHere { moving: false } => "cutting from here".into(),
            EventKind::CutterOn(channel) => format!("{} on by the operator", channel_name(*channel)),
            EventKind::RetraceSwitched(channel, value) => {
                format!("retrace: {} := {}", channel_name(*channel), names.value_text(*channel, *value))
            }
            EventKind::RunResumed => "normal run resumed".into(),
            EventKind::ProgramEnd => "end of the program; reverse run is possible until the job is released".into(),
            EventKind::Switching(code) => format!("{code} begins"),
            EventKind::Switched(code) => format!("{code} done"),
            EventKind::OutputChanged(channel, value) => {
                format!("{} := {}", channel_name(*channel), names.value_text(*channel, *value))
            }
            EventKind::ProgramStop(code) => format!("program stop {code}: cycle start to continue"),
            EventKind::ToolChange(tool) => format!("tool change: tool {tool}; cycle start to continue"),
            EventKind::SingleBlock => "single block: cycle start to continue".into(),
            EventKind::Dnc(dnc) => dnc.to_string(),
            EventKind::Message(text) => format!("message: {text}"),
            EventKind::StreamStalled { source, since } => {
                format!("waiting for the program from {source} since {since}")
            }
            EventKind::StreamResumed { source, waited_s } => {
                format!("the program from {source} arrives again, after {waited_s:.1} s")
            }
            EventKind::Underrun => "the look-ahead ran dry: slowed down on the path".into(),
            EventKind::Alarm(error) => {
                let (number, cause, remedy) = error.parts();
                format!("ALARM {number}: {cause}. {remedy}")
            }
        }
    }
}

/// A mode of operation in an operator's words.
const fn mode_text(mode: Mode) -> &'static str {
    match mode {
        Mode::Run => "normal run",
        Mode::Reverse => "reverse run",
        Mode::Forward => "forward run",
        Mode::Wheel => "handwheel",
        Mode::Rejoin => "forward to the end of the history",
        Mode::AwaitOutputs => "waiting until the outputs are confirmed",
    }
}
/// The contours that had ended when the job was left: how many are cut, and those of which something is not.
fn restored_text(contours: &[RestoredContour]) -> String {
    const MOST_NAMED: usize = 5;
    let ended = || contours.iter().filter_map(|contour| Some((contour.number, contour.not_cut_mm?)));
    let open: Vec<String> = ended()
        .filter(|(_, mm)| *mm > 0.0)
        .map(|(number, mm)| format!("contour {number}: {mm:.2} mm are not cut"))
        .collect();
    let whole = match ended().count() - open.len() {
        1 => "1 contour was cut before".to_owned(),
        count => format!("{count} contours were cut before"),
    };
    match open.len() {
        0 => whole,
        1..=MOST_NAMED => format!("{whole}; {}", open.join(", ")),
        count => format!("{whole}; {}, and {} more", open[..MOST_NAMED].join(", "), count - MOST_NAMED),
    }
}
