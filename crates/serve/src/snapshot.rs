//! What pages show: the machine's state, its live figures, and the messages, taken from the screen model.
//!
//! Invariant: a figure that is not known is `null`, never 0. The number of the state grows exactly where something has
//! changed that an operator must have seen before he starts motion.

use retrace_controller::{CutterState, SheetPlacement};
use retrace_core::RecordIndex;
use retrace_core::mode::Mode;
use retrace_journal::HoldReason;
use retrace_link::{GearState, channel};
use retrace_tui::{AxisHoming, HeightFigures, PanelStatus, ProgramCheck, ScreenModel, ScreenStage, ToolHeight};
use serde::Serialize;

/// Units of a record's fraction in a record.
const FRACTIONS: f64 = 4_294_967_296.0;

/// Maximum number of contours to be skipped that are shown.
const MAX_SKIPPED: usize = 1000;

/// Maximum number of findings of a check that are shown.
const MAX_FINDINGS: usize = 100;

/// The machine's state, whole.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct StateView {
    t: &'static str,
    /// Number of the state that matters for starting motion.
    pub(crate) n: u32,
    stage: &'static str,
    word: &'static str,
    why: String,
    level: &'static str,
    can: Vec<String>,
    suggested: Vec<String>,
    situation: &'static str,
    mode: &'static str,
    hold_reason: &'static str,
    homed: bool,
    homing: Vec<&'static str>,
    single: bool,
    optional_stop: bool,
    dry_run: bool,
    /// Numbers of the contours that are skipped once they are reached, at most 1000.
    skipped_contours: Vec<u32>,
    /// Points on the edge of the sheet, where any is taken.
    sheet: Option<SheetView>,
    /// Extents in X and in Y of what the program cuts, in machine coordinates, where they are known: what a frame goes
    /// round.
    cut_extents_mm: Option<[[f64; 2]; 2]>,
    /// Index of the axis that a frame raises before it goes round, and the machine's safe height, if it has one.
    frame_height: Option<(usize, Option<f64>)>,
    #[serde(rename = "override")]
    feed_override: f64,
    rapid_override: f64,
    speed_override: f64,
    /// Whether the program has switched both overrides off where the machine is.
    override_is_off: bool,
    override_max: f64,
    line: u32,
    program: ProgramView,
    modal: String,
    tool: Option<i32>,
    outputs: Vec<OutputView>,
    inputs: u16,
    cutter: Option<CutterView>,
    cut_end_line: Option<u32>,
    alarm: Option<AlarmView>,
    question: Option<QuestionView>,
    pause: Option<PauseView>,
    switching: Option<&'static str>,
    /// Code of the program stop that is waited at.
    program_stop: Option<&'static str>,
    tool_change: Option<i32>,
    differing_outputs: Vec<DifferingOutputView>,
    waiting: Option<String>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct ProgramView {
    name: String,
    lines: usize,
    check: &'static str,
    findings: Vec<String>,
    planned_s: Option<f64>,
    path: Option<u32>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct OutputView {
    channel: u8,
    value: i32,
    expected: i32,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct DifferingOutputView {
    channel: u8,
    value: i32,
    expected: i32,
    /// Code of the program that switched it so.
    #[serde(skip_serializing_if = "Option::is_none")]
    code: Option<&'static str>,
    /// Program line of the code.
    #[serde(skip_serializing_if = "Option::is_none")]
    line: Option<u32>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct CutterView {
    name: String,
    state: &'static str,
    contour: Option<u32>,
    contours: Option<u64>,
    off_reason: Option<&'static str>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct AlarmView {
    number: String,
    cause: String,
    remedy: String,
    is_refusal: bool,
}

/// Points on the edge of the sheet.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct SheetView {
    /// 1, or 2 that are an edge.
    points: usize,
    /// What they would set, or what comes next.
    text: String,
    /// How they would move the job; `null` while it is not known whether they move all of it, and where they do not.
    placement: Option<PlacementView>,
    /// Distances of the contours from the ends of the travel in X and in Y.
    travel_left_mm: Option<[[f64; 2]; 2]>,
    travel_text: Option<String>,
}

/// Turns the job around its zero, and moves that to another place.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct PlacementView {
    from_mm: [f64; 2],
    to_mm: [f64; 2],
    turn_deg: f64,
}

impl SheetView {
    fn of(model: &ScreenModel) -> Option<Self> {
        let placement = retrace_tui::sheet_placement_of_whole(model);
        (!model.sheet_points.is_empty()).then(|| Self {
            points: model.sheet_points.len(),
            text: retrace_tui::sheet_text(model),
            placement: placement.map(|SheetPlacement { from_mm, to_mm, turn_deg }| PlacementView {
                from_mm: from_mm.map(|mm| rounded(mm, 1e4)),
                to_mm: to_mm.map(|mm| rounded(mm, 1e4)),
                turn_deg: rounded(turn_deg, 1e6),
            }),
            travel_left_mm: retrace_tui::sheet_travel_left(model)
                .map(|left| left.map(|of| of.map(|mm| rounded(mm, 1e3)))),
            travel_text: retrace_tui::sheet_travel_text(model),
        })
    }
}

#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct QuestionView {
    title: String,
    lines: Vec<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct PauseView {
    stopped: bool,
    started: bool,
    online: bool,
}

/// The live figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct LiveView {
    t: &'static str,
    mm: Vec<f64>,
    work: Vec<f64>,
    to_go: Vec<Option<f64>>,
    feed: f64,
    rate: f64,
    line: u32,
    record: f64,
    oldest: i64,
    reached: i64,
    planned: i64,
    back_mm: f64,
    history_mm: f64,
    history_s: f64,
    at_rest: bool,
    left_s: Option<f64>,
    run_s: f64,
    /// Time of the job outside of the normal run: in reverse run, forward over retraced path, or by the handwheel, s.
    retraced_s: f64,
    /// Time of the job in a hold, at a program stop or in single block, s.
    held_s: f64,
    seconds_lit: Option<f64>,
    /// Measured speed of the spindle, turns a minute, positive clockwise.
    rpm: Option<f64>,
    /// What the motion does with its angle: `off`, `waiting`, `engaged`, or `by_hand` where the spindle is turned by
    /// hand.
    gear: &'static str,
    /// Path and layer of the tool axis, on a machine that senses the sheet.
    #[serde(skip_serializing_if = "Option::is_none")]
    layer: Option<LayerView>,
    /// Height control, on a machine that has it.
    #[serde(skip_serializing_if = "Option::is_none")]
    height: Option<HeightView>,
}

/// The messages.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct LogView {
    t: &'static str,
    messages: Vec<MessageView>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct MessageView {
    time_s: f64,
    line: u32,
    text: String,
    times: u32,
}

/// What an operator must have seen before he starts motion.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SeenState {
    situation: &'static str,
    mode: &'static str,
    hold_reason: HoldReason,
    alarm: Option<String>,
    question: Option<String>,
    program: String,
    homed: bool,
    dry_run: bool,
    awaits_confirmation: bool,
}

impl SeenState {
    /// The state that this model shows.
    pub(crate) fn of(model: &ScreenModel, status: &PanelStatus) -> Self {
        Self {
            situation: status.situation,
            mode: model.mode.name(),
            hold_reason: model.hold_reason,
            alarm: model.alarm.as_ref().map(|alarm| alarm.number.clone()),
            question: model.question.as_ref().map(|question| question.title.clone()),
            program: model.facts.program.name.clone(),
            homed: model.homed,
            dry_run: model.dry_run,
            awaits_confirmation: !model.differing_outputs.is_empty(),
        }
    }

    /// What has changed since an earlier state, in words.
    pub(crate) fn changes_from(&self, before: &Self) -> String {
        let mut changes = Vec::new();
        let mut note = |is_new: bool, text: String| {
            if is_new {
                changes.push(text);
            }
        };
        let alarm = self.alarm.as_deref().map_or("the alarm is cleared".into(), |number| format!("alarm {number}"));
        note(self.alarm != before.alarm, alarm);
        note(self.situation != before.situation, format!("the situation is {}", self.situation.replace('_', " ")));
        note(self.mode != before.mode, format!("the mode is {}", self.mode.replace('_', " ")));
        note(self.hold_reason != before.hold_reason, format!("the hold is {}", hold_name(self.hold_reason)));
        note(self.program != before.program, format!("the program is {}", self.program));
        note(self.question != before.question, "a question was opened or answered".into());
        note(self.homed != before.homed, if self.homed { "it is homed" } else { "it is not homed" }.into());
        note(self.dry_run != before.dry_run, if self.dry_run { "dry run" } else { "no dry run" }.into());
        note(self.awaits_confirmation != before.awaits_confirmation, "the outputs differ or differ no more".into());
        changes.join(", ")
    }
}

const fn hold_name(reason: HoldReason) -> &'static str {
    match reason {
        HoldReason::None => "none",
        HoldReason::Hold => "hold",
        HoldReason::ProgramStop => "program stop",
        HoldReason::SingleBlock => "single block",
        HoldReason::Ended => "end of program",
        HoldReason::Paused => "paused",
    }
}

const fn stage_name(stage: &ScreenStage) -> &'static str {
    match stage {
        ScreenStage::Setup => "setup",
        ScreenStage::Resuming => "resuming",
        ScreenStage::Job => "job",
        ScreenStage::Ended(_) => "ended",
    }
}

const fn homing_name(homing: AxisHoming) -> &'static str {
    match homing {
        AxisHoming::NotNeeded => "not_needed",
        AxisHoming::Homed => "homed",
        AxisHoming::NotHomed => "not_homed",
    }
}

/// The messages `state` and `live` of what this model shows, as a page has them but for the numbers of state and path.
#[must_use]
pub fn machine_messages(model: &ScreenModel) -> [String; 2] {
    let state = StateView::of(model, retrace_tui::panel_status(model));
    // Both are made of numbers, words and lists of them, which can be written as JSON.
    [serde_json::to_string(&state), serde_json::to_string(&LiveView::of(model))].map(Result::unwrap_or_default)
}

impl StateView {
    /// State that this model shows, without numbers.
    pub(crate) fn of(model: &ScreenModel, status: PanelStatus) -> Self {
        let differing = model.differing_outputs.iter();
        Self {
            t: "state",
            n: 0,
            stage: stage_name(&model.stage),
            word: status.word,
            why: status.reason,
            level: status.level,
            can: status.possible,
            suggested: status.suggested,
            situation: status.situation,
            mode: model.mode.name(),
            hold_reason: hold_name(model.hold_reason),
            homed: model.homed,
            homing: model.homing.iter().map(|&homing| homing_name(homing)).collect(),
            single: model.single,
            optional_stop: model.optional_stop,
            skipped_contours: model.contours.skipped().take(MAX_SKIPPED).collect(),
            sheet: SheetView::of(model),
            cut_extents_mm: retrace_tui::cut_extents_mm(model).map(|of| of.map(|of| of.map(|mm| rounded(mm, 1e3)))),
            frame_height: retrace_tui::frame_height(model),
            dry_run: model.dry_run,
            feed_override: rounded(model.override_rate, 1e4),
            rapid_override: rounded(model.rapid_override, 1e4),
            speed_override: rounded(model.speed_override, 1e4),
            override_is_off: model.override_is_off,
            override_max: rounded(model.override_planned, 1e4),
            line: model.line,
            program: ProgramView::of(model),
            modal: model.active.modal.clone(),
            tool: model.active.tool,
            outputs: outputs(model),
            inputs: model.inputs,
            cutter: cutter(model),
            cut_end_line: model.cut_end_line,
            alarm: model.alarm.as_ref().map(|alarm| AlarmView {
                number: alarm.number.clone(),
                cause: alarm.cause.clone(),
                remedy: alarm.remedy.clone(),
                is_refusal: alarm.is_refusal,
            }),
            question: model
                .question
                .as_ref()
                .map(|question| QuestionView { title: question.title.clone(), lines: question.lines.clone() }),
            pause: model.pause.map(|pause| PauseView {
                stopped: pause.stopped,
                started: pause.started,
                online: pause.online,
            }),
            switching: model.switching,
            program_stop: model.program_stop.filter(|_| model.hold_reason == HoldReason::ProgramStop),
            tool_change: model.tool_change,
            differing_outputs: differing
                .map(|of| DifferingOutputView {
                    channel: of.channel,
                    value: of.actual,
                    expected: of.expected,
                    code: Some(of.code).filter(|code| !code.is_empty()),
                    line: Some(of.line).filter(|&line| line != 0),
                })
                .collect(),
            waiting: model.stalled_source().map(|(source, seconds)| format!("{source}, for {seconds:.0} s")),
        }
    }
}

impl StateView {
    /// The state with its number and that of its path.
    pub(crate) fn with_numbers(mut self, n: u32, path: Option<u32>) -> Self {
        (self.n, self.program.path) = (n, path);
        self
    }
}

impl ProgramView {
    fn of(model: &ScreenModel) -> Self {
        let facts = &model.facts;
        let (check, findings) = match &facts.check {
            ProgramCheck::Checking => ("checking", &[][..]),
            ProgramCheck::NotLoaded => ("not_loaded", &[][..]),
            ProgramCheck::Ready => ("ready", &[][..]),
            ProgramCheck::Failed(findings) => ("failed", findings.as_slice()),
            ProgramCheck::CheckedAsItRuns => ("stream", &[][..]),
        };
        Self {
            name: facts.program.name.clone(),
            lines: facts.program.lines(),
            check,
            findings: findings.iter().take(MAX_FINDINGS).cloned().collect(),
            planned_s: facts.planned.seconds(),
            path: None,
        }
    }
}

/// Height of the tool: its work position is the sum of path and layer.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct LayerView {
    /// Index of the tool axis.
    axis: usize,
    /// Work position on the path, once it is known.
    path_mm: Option<f64>,
    /// What sensing and height control add to it, once it is known.
    layer_mm: Option<f64>,
    /// Height over the sheet where it was sensed last, in a job and where it is known.
    over_sheet_mm: Option<f64>,
}

/// Height control: what it does, the arc voltage with its target, and what the operator adds to the target.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct HeightView {
    state: &'static str,
    is_on: bool,
    /// Whether another controller moves the axis while it is active.
    is_external: bool,
    volts: Option<f64>,
    /// The voltage that it aims at, where it is known.
    target_volts: Option<f64>,
    offset_volts: f64,
}

/// Every output that is or should be on, and every other one that was ever reported.
fn outputs(model: &ScreenModel) -> Vec<OutputView> {
    let mut channels: Vec<u8> = model.outputs.keys().chain(model.program_outputs.keys()).copied().collect();
    // Those of height control are figures of their own.
    channels.retain(|number| !matches!(*number, channel::HEIGHT_HOLD | channel::HEIGHT_OFFSET));
    channels.sort_unstable();
    channels.dedup();
    let view = |channel| OutputView { channel, value: model.output(channel), expected: model.program_output(channel) };
    channels.into_iter().map(view).collect()
}

/// The cutter that is shown: one that is not off, or the first one.
fn cutter(model: &ScreenModel) -> Option<CutterView> {
    let state = |fire: u8| model.cutter_states.get(&fire).copied();
    let is_active = |fire: u8| state(fire).is_some_and(|(state, _)| state.name() != "off");
    let cutters = &model.facts.cutters;
    let shown = cutters.iter().find(|cutter| is_active(cutter.fire)).or(cutters.first())?;
    let state_name = state(shown.fire).map_or("off", |(state, _)| state.name());
    // The reason of the last time says nothing while it is on.
    let is_off = !matches!(state_name, "igniting" | "piercing" | "cutting" | "ending" | "test");
    let is_starting = |state| matches!(state, CutterState::Sensing | CutterState::Igniting | CutterState::Piercing);
    let started = state(shown.fire).filter(|&(state, number)| is_starting(state) && number > 0);
    let contour = model.contours.current().map(|(number, _)| number).or(started.map(|(_, number)| number));
    Some(CutterView {
        name: shown.name.clone(),
        state: state_name,
        contour: contour.or(model.contours.last()),
        contours: model.facts.contours.as_ref().map(|list| list.count),
        off_reason: model.cutter_off_reasons.get(&shown.fire).copied().filter(|_| is_off),
    })
}

impl LiveView {
    /// Live figures that this model shows.
    pub(crate) fn of(model: &ScreenModel) -> Self {
        let axes = 0..model.facts.axes.len();
        let records = |index: RecordIndex| records_from_start(index);
        let (history_s, history_mm) = model.history();
        let lit = model.facts.cutters.iter().map(|cutter| model.on_s(cutter.fire)).fold(0.0, f64::max);
        Self {
            t: "live",
            mm: axes.clone().map(|axis| rounded(model.machine_mm(axis), 1e4)).collect(),
            work: axes.clone().map(|axis| rounded(model.work_mm(axis), 1e4)).collect(),
            to_go: axes.map(|axis| model.to_go_mm(axis).map(|mm| rounded(mm, 1e4))).collect(),
            feed: rounded(model.feed_mm_min, 10.0),
            rate: rounded(model.rate, 1e4),
            line: model.line,
            record: records(model.place.record) as f64 + rounded(f64::from(model.place.fraction) / FRACTIONS, 1e3),
            oldest: records(model.oldest),
            reached: records(model.reached),
            planned: records(model.planned),
            back_mm: rounded(model.back_mm(), 1e3),
            history_mm: rounded(history_mm, 1e3),
            history_s: rounded(history_s, 1e3),
            at_rest: model.at_rest,
            left_s: model.time_remaining().map(|left| rounded(left.seconds, 10.0)),
            run_s: rounded(model.run_s(), 10.0),
            retraced_s: rounded(model.retraced_periods as f64 * model.facts.period_s, 10.0),
            held_s: rounded(model.held_periods as f64 * model.facts.period_s, 10.0),
            seconds_lit: (lit > 0.0).then(|| rounded(lit, 10.0)),
            rpm: model.spindle.speed.map(|speed| rounded(f64::from(speed) / 1000.0, 1.0)),
            gear: match model.spindle.gear {
                GearState::Off => "off",
                GearState::Waiting => "waiting",
                GearState::Engaged if model.follows_spindle => "by_hand",
                GearState::Engaged => "engaged",
                GearState::Freed => "freed",
            },
            layer: ToolHeight::of(model).map(|of| LayerView {
                axis: of.axis,
                path_mm: of.path_mm.map(|mm| rounded(mm, 1e4)),
                layer_mm: of.layer_mm.map(|mm| rounded(mm, 1e4)),
                over_sheet_mm: retrace_tui::over_sheet_mm(model).map(|mm| rounded(mm, 1e4)),
            }),
            height: HeightFigures::of(model).map(|of| HeightView {
                state: of.state,
                is_on: of.is_on,
                is_external: of.is_external,
                volts: of.volts.map(|volts| rounded(volts, 10.0)),
                target_volts: of.target_volts.map(|volts| rounded(volts, 100.0)),
                offset_volts: rounded(of.offset_volts, 100.0),
            }),
        }
    }
}

impl LogView {
    /// The messages in this model, and the number of the first one.
    pub(crate) fn of(model: &ScreenModel) -> Self {
        let view = |message: &retrace_tui::Message| MessageView {
            time_s: rounded(message.time_s, 1e3),
            line: message.line,
            text: message.text.clone(),
            times: message.times,
        };
        Self { t: "log", messages: model.messages.iter().map(view).collect() }
    }
}

/// Number of records from the start of the program's path, negative before it.
fn records_from_start(index: RecordIndex) -> i64 {
    i64::from(RecordIndex::new(0).records_to(index))
}

/// A figure with a bounded number of decimals, so that noise does not make messages.
fn rounded(value: f64, per_unit: f64) -> f64 {
    let rounded = (value * per_unit).round() / per_unit;
    if rounded == 0.0 { 0.0 } else { rounded }
}

/// Whether the path is being retraced, by keys that were pressed or by the handwheel.
pub(crate) fn is_retracing(model: &ScreenModel) -> bool {
    model.stage == ScreenStage::Job && !matches!(model.mode, Mode::Run | Mode::AwaitOutputs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use retrace_config::MachineConfig;
    use retrace_tui::ProgramFacts;
    use std::sync::Arc;

    #[test]
    fn a_cutter_that_is_being_started_is_at_its_next_contour() {
        let machine = "[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\n";
        let machine = MachineConfig::parse(machine, "test").expect("valid");
        let mut model = ScreenModel::new(Arc::new(ProgramFacts::of(&machine, "part.ngc", "M2\n")));
        let mut contour_while = |state| {
            model.cutter_states.insert(64, (state, 3));
            cutter(&model).expect("a cutter").contour
        };
        for state in [CutterState::Sensing, CutterState::Igniting, CutterState::Piercing] {
            assert_eq!(contour_while(state), Some(3), "{state:?}");
        }
        assert_eq!(contour_while(CutterState::Off), None, "it is at none, and was at none");
    }
}
