//! Updates the screen model from telemetry, in the reporter's thread.
//!
//! Invariant: telemetry is applied in the order in which it arrives; the lock is held for one item at a time.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use retrace_config::AXIS_LETTERS;
use retrace_controller::{
    CutterOffReason, CutterState, DncEvent, DncStep, Event, EventKind, ExecutedPath, Observer, OperatorCommand,
    PathKind, PeriodRecord, Telemetry,
};
use retrace_core::mode::Mode;
use retrace_core::{Distance, Place, RecordIndex};
use retrace_gcode::{Axis, FeedMode, MotionMode, Pose};
use retrace_journal::HoldReason;
use retrace_link::{GearState, channel};

use crate::event_text;
use crate::height_text;
use crate::model::{Active, AlarmShown, MotionKind, Pause, ScreenModel, ScreenStage};
use crate::path_length::PathLengths;
use crate::program_outputs::ProgramOutputs;
use crate::trail::{Trail, TrailPoint};

/// Number of periods over which the displayed speed is averaged.
const FEED_PERIODS: f64 = 32.0;

/// Interval at which an executed path is shown, s, and what each of its vertices adds.
const SHOWN_AFTER_S: f64 = 0.5;
const SHOWN_AFTER_S_PER_VERTEX: f64 = 1e-5;

/// Locks the model. After a panic of another thread the model is out of date at worst.
pub fn lock_model(model: &Mutex<ScreenModel>) -> MutexGuard<'_, ScreenModel> {
    model.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Observer that updates the model.
#[derive(Clone, Debug)]
pub struct ModelObserver {
    model: Arc<Mutex<ScreenModel>>,
    /// Pause before the operator's last command, in case it is rejected.
    pause_before: Option<Pause>,
    modes: ModeHistory,
    program_outputs: ProgramOutputs,
    /// Path of the job that runs, while its planned path is not known, and the period in which it is shown next.
    executed: Option<(ExecutedPath, u64)>,
}

/// Maximum number of retained modal states.
const MAX_MODES: usize = 4096;

/// Modal states along the path of a job, so that the state under the tool is shown wherever the machine goes back to.
#[derive(Clone, Debug, Default)]
struct ModeHistory {
    /// Modal states with the record from which each applies, in the order of the path.
    states: VecDeque<(RecordIndex, ActiveAt)>,
    /// State that was reported since the last period.
    pending: Option<ActiveAt>,
    /// Record of the state that is shown.
    shown: Option<RecordIndex>,
    /// Tool offset and tool for which a length was entered, with the axis and distance by which the path is moved, mm.
    entered: Option<((Pose, u32), usize, f64)>,
    /// Tool offset and tool that were reported last.
    tool: (Pose, u32),
}

/// Modal state with its work zero.
#[derive(Clone, Debug, Default)]
struct ActiveAt {
    active: Active,
    work_zero_mm: Vec<f64>,
    work_rotation_deg: f64,
}

impl ModeHistory {
    /// History that starts with the state in the model, at this record.
    fn from(place: RecordIndex, model: &ScreenModel) -> Self {
        let now = ActiveAt {
            active: model.active.clone(),
            work_zero_mm: model.work_zero_mm.clone(),
            work_rotation_deg: model.work_rotation_deg,
        };
        Self { states: VecDeque::from([(place, now)]), ..Self::default() }
    }

    /// Moves the whole path along an axis: a tool length was entered.
    fn move_path(&mut self, axis: usize, by_mm: f64, model: &mut ScreenModel) {
        let before_mm = self.entered.filter(|(tool, ..)| *tool == self.tool).map_or(0.0, |(.., mm)| mm);
        self.entered = Some((self.tool, axis, before_mm + by_mm));
        let states = self.states.iter_mut().map(|(_, state)| state).chain(&mut self.pending);
        let zeros = states.map(|state| &mut state.work_zero_mm).chain([&mut model.work_zero_mm, &mut model.moved_mm]);
        zeros.filter_map(|zeros| zeros.get_mut(axis)).for_each(|zero| *zero += by_mm);
    }

    /// Converts a reported modal state. An entered length applies to the tool and the offset for which it was entered.
    fn apply_active(&mut self, active: &retrace_gcode::ActiveCodes, model: &mut ScreenModel) -> ActiveAt {
        self.tool = (active.tool_offset, active.current_tool);
        self.entered.take_if(|((_, tool), ..)| *tool != active.current_tool);
        model.moved_mm.fill(0.0);
        if let Some((tool, axis, mm)) = self.entered
            && tool == self.tool
            && let Some(moved) = model.moved_mm.get_mut(axis)
        {
            *moved = mm;
        }
        let mut telemetry = active_at(model, active);
        telemetry.work_zero_mm.iter_mut().zip(&model.moved_mm).for_each(|(zero, moved)| *zero += moved);
        telemetry
    }

    /// Ends a period with the cursor at `place` and the furthest place at `reached`: shows the state at the cursor.
    fn show_state_at(&mut self, place: RecordIndex, reached: RecordIndex, model: &mut ScreenModel) {
        if let Some(new) = self.pending.take() {
            if self.states.back().is_some_and(|&(at, _)| at == reached) {
                self.states.pop_back();
                self.shown = None;
            }
            if self.states.len() >= MAX_MODES {
                self.states.pop_front();
            }
            self.states.push_back((reached, new));
        }
        let behind = self.states.partition_point(|&(at, _)| !place.is_before(at));
        let Some((at, state)) = self.states.get(behind.saturating_sub(1)) else { return };
        if self.shown != Some(*at) {
            self.shown = Some(*at);
            state.show(model);
        }
    }
}

impl ActiveAt {
    fn show(&self, model: &mut ScreenModel) {
        model.active = self.active.clone();
        model.work_zero_mm.clone_from(&self.work_zero_mm);
        model.work_rotation_deg = self.work_rotation_deg;
    }
}

impl ModelObserver {
    /// Observer of this model.
    #[must_use]
    pub fn new(model: Arc<Mutex<ScreenModel>>) -> Self {
        Self {
            model,
            pause_before: None,
            modes: ModeHistory::default(),
            program_outputs: ProgramOutputs::default(),
            executed: None,
        }
    }
}

impl<const A: usize> Observer<A> for ModelObserver {
    fn on_telemetry(&mut self, telemetry: &Telemetry<A>) {
        let mut model = lock_model(&self.model);
        model.changes += 1;
        model.contours.observe(telemetry);
        match telemetry {
            Telemetry::Period(period) => {
                apply_period(&mut model, period);
                if !period.off_path {
                    record_executed(&mut self.executed, period.place, &mut model);
                    self.modes.show_state_at(period.place.record, period.reached, &mut model);
                    let program_outputs = self.program_outputs.outputs_at(period.place.record);
                    if *program_outputs != model.program_outputs {
                        model.program_outputs.clone_from(program_outputs);
                    }
                }
            }
            Telemetry::Output(change) => {
                model.outputs.insert(change.channel, change.value);
                let period = model.period;
                if change.value == 0 {
                    model.on_since.remove(&change.channel);
                } else {
                    model.on_since.entry(change.channel).or_insert(period);
                }
                self.program_outputs.output_changed(model.place.record, change.channel, change.value);
                let turns = model.output(channel::SPINDLE);
                if let Some(pause) = &mut model.pause {
                    pause.stopped |= turns == 0;
                    pause.started = pause.stopped && turns == pause.spindle;
                    pause.online &= pause.started;
                }
            }
            Telemetry::Active(active) => {
                let news = self.modes.apply_active(active, &mut model);
                if model.stage != ScreenStage::Job {
                    news.show(&mut model);
                }
                self.modes.pending = Some(news);
            }
            Telemetry::Event(event) => {
                self.pause_before = apply_event(&mut model, event, self.pause_before);
                match event.kind {
                    EventKind::Switching(_) => self.program_outputs.begin_instruction(),
                    EventKind::Switched(_) => self.program_outputs.complete_instruction(),
                    EventKind::OutputChanged(channel, value) => {
                        self.program_outputs.push_change(event.place.record, channel, value);
                    }
                    EventKind::Started => {
                        self.program_outputs = ProgramOutputs::from(&model.program_outputs);
                    }
                    _ => {}
                }
                if event.kind == EventKind::Started {
                    model.executed_path = None;
                    self.executed = Some((ExecutedPath::default(), 0));
                    model.moved_mm.fill(0.0);
                    self.modes = ModeHistory { tool: self.modes.tool, ..ModeHistory::from(event.place.record, &model) };
                }
                if let (EventKind::SenseTest { axis, outcome }, ScreenStage::Setup) = (&event.kind, &model.stage) {
                    model.manual_result = outcome.text(*axis);
                }
                if let EventKind::Dnc(DncEvent { step: DncStep::ToolLength { axis, by_mm, .. }, .. }) = event.kind
                    && let Some(axis) = model.facts.axes.iter().position(|facts| facts.letter == axis)
                {
                    self.modes.move_path(axis, by_mm, &mut model);
                }
            }
        }
    }
}

/// Records where the machine is on its path, and shows the path so far now and then: a longer one less often. Where the
/// planned path is known, that is shown.
fn record_executed(executed: &mut Option<(ExecutedPath, u64)>, place: Place, model: &mut ScreenModel) {
    if model.facts.planned_path.is_some() {
        (*executed, model.executed_path) = (None, None);
    }
    let Some((path, shown_next)) = executed else { return };
    let Ok(record) = u32::try_from(i64::from(RecordIndex::new(0).records_to(place.record))) else { return };
    let is_lit = model.facts.cutters.iter().any(|cutter| model.output(cutter.fire) != 0);
    let kind = match model.active.motion {
        MotionKind::Rapid => PathKind::Rapid,
        _ if is_lit || model.facts.cutters.is_empty() => PathKind::Cutting,
        _ => PathKind::Feed,
    };
    let contour = model.contours.current().map_or(0, |(number, _)| number);
    path.push(model.in_space().map(|mm| (mm * 1e3).round() as i32), record, kind, model.line, contour);
    if model.period < *shown_next {
        return;
    }
    let shown = Arc::new(path.path());
    if shown.vertices().len() > 1
        && model.executed_path.as_ref().is_none_or(|before| before.records() < shown.records())
    {
        model.executed_path = Some(shown);
    }
    let interval_s = SHOWN_AFTER_S + path.vertices() as f64 * SHOWN_AFTER_S_PER_VERTEX;
    *shown_next = model.period + (interval_s / model.facts.period_s.max(1e-6)) as u64;
}

fn apply_period<const A: usize>(model: &mut ScreenModel, period: &PeriodRecord<A>) {
    let step_mm = step_mm(model, &period.increments);
    model.count_periods(period.mode, period.hold_reason, period.period.saturating_sub(model.period));
    model.period = period.period;
    for (slot, &count) in model.counts.iter_mut().zip(&period.counts) {
        *slot = count;
    }
    if let Some(slot) = model.facts.layer_axis.and_then(|axis| model.counts.get_mut(axis)) {
        *slot += i64::from(period.layer);
    }
    model.layer = i64::from(period.layer);
    (model.height, model.analog_inputs) = (period.height, period.analog_inputs);
    model.spindle = period.spindle;
    model.follows_spindle &= period.spindle.gear == GearState::Engaged && period.hold_reason == HoldReason::Hold;
    let feed = step_mm / model.facts.period_s.max(1e-9) * 60.0;
    model.feed_mm_min += (feed - model.feed_mm_min) / FEED_PERIODS;
    if period.at_rest {
        model.feed_mm_min = 0.0;
    }
    (model.at_rest, model.starved, model.inputs, model.off_path) =
        (period.at_rest, period.starved, period.inputs, period.off_path);
    (model.mode, model.hold_reason) = (period.mode, period.hold_reason);
    model.rate = f64::from(period.rate);
    model.override_rate = f64::from(period.override_rate);
    model.rapid_override = f64::from(period.rapid_override);
    model.speed_override = f64::from(period.speed_override);
    model.override_is_off = period.override_is_off;
    model.at_cutter_boundary &= period.at_rest;
    model.tool_is_down &= period.at_rest || model.stage != ScreenStage::Setup;
    if period.hold_reason != HoldReason::ProgramStop {
        model.tool_change = None;
    }
    let paused = period.hold_reason == HoldReason::Paused;
    if paused && model.pause.is_none() {
        let spindle = model.output(channel::SPINDLE);
        // A spindle at rest needs no step of its own.
        model.pause = Some(Pause { spindle, stopped: spindle == 0, started: spindle == 0, online: false });
    } else if !paused && !period.off_path {
        model.pause = None;
    }
    if period.off_path {
        return;
    }
    (model.place, model.reached, model.oldest) = (period.place, period.reached, period.oldest);
    (model.planned, model.window, model.line) = (period.planned, period.window, period.line);
    if model.mode == Mode::Run {
        model.differing_outputs.clear();
    }
    if model.lengths.furthest().distance_to(period.place) > Distance::ZERO {
        model.lengths.extend(period.place, step_mm, period.oldest);
        model.reached_line = period.line;
        let corner = TrailPoint { along_mm: model.lengths.total_mm(), at: model.in_space(), rapid: model.is_rapid() };
        model.trail.push(corner);
    }
}

/// Modal state for the screen, with its feed in mm/min where it has that unit, and its work zero.
fn active_at(model: &ScreenModel, active: &retrace_gcode::ActiveCodes) -> ActiveAt {
    let unit_mm = active.units.millimetres();
    let per_minute = active.feed_mode == FeedMode::UnitsPerMinute && active.feed_rate > 0.0;
    let motion = match active.motion {
        Some(MotionMode::Traverse) => MotionKind::Rapid,
        Some(MotionMode::Cycle(_)) => MotionKind::Cycle,
        _ => MotionKind::Feed,
    };
    let shown = Active {
        modal: active.to_string(),
        feed: per_minute.then_some(active.feed_rate * unit_mm),
        tool: i32::try_from(active.current_tool).ok(),
        motion,
    };
    let mut work_zero_mm = model.work_zero_mm.clone();
    // The offset of G92 is one in the turned coordinates.
    let (sin, cos) = active.rotation_degrees.to_radians().sin_cos();
    let mut g92 = active.g92_offset;
    let [x, y] = [g92[Axis::X], g92[Axis::Y]];
    (g92[Axis::X], g92[Axis::Y]) = (x * cos - y * sin, x * sin + y * cos);
    for (zero, axis) in work_zero_mm.iter_mut().zip(&model.facts.axes) {
        let Some(index) = AXIS_LETTERS.iter().position(|&letter| letter == axis.letter) else { continue };
        let offsets = [&active.origin, &g92, &active.tool_offset];
        let sum: f64 = offsets.iter().map(|offset| offset.0[index]).sum();
        *zero = if matches!(axis.letter, 'a'..='c') { sum } else { sum * unit_mm };
    }
    ActiveAt { active: shown, work_zero_mm, work_rotation_deg: active.rotation_degrees }
}

/// Distance in a period: along the linear axes, or along the others where no linear axis moves.
fn step_mm<const A: usize>(model: &ScreenModel, increments: &[i32; A]) -> f64 {
    let (mut linear, mut rotary) = (0.0, 0.0);
    for (axis, &pulses) in model.facts.axes.iter().zip(increments) {
        let square = (f64::from(pulses) / axis.pulses_per_mm).powi(2);
        if matches!(axis.letter, 'a'..='c') { rotary += square } else { linear += square }
    }
    if linear > 0.0 { linear.sqrt() } else { f64::sqrt(rotary) }
}

/// Applies an event. Returns the pause before the operator's last command.
fn apply_event(model: &mut ScreenModel, event: &Event, before: Option<Pause>) -> Option<Pause> {
    let mut keep = before;
    if let EventKind::CommandRejected(why) = &event.kind {
        (model.is_stopping, model.follows_spindle) = (false, false);
        model.reject(None, why.to_string(), "");
    }
    match &event.kind {
        EventKind::Started => begin(model, event),
        EventKind::Operator(command) => {
            keep = model.pause;
            if *command == OperatorCommand::Single {
                model.single = !model.single;
            }
            match command {
                OperatorCommand::Stop => model.is_stopping = true,
                OperatorCommand::FollowSpindle(on) => model.follows_spindle = *on,
                OperatorCommand::Recover => model.recovering = model.cut_end_line.is_some(),
                // these take the machine elsewhere
                OperatorCommand::Reverse(_)
                | OperatorCommand::Forward(_)
                | OperatorCommand::Wheel { .. }
                | OperatorCommand::Leave { .. }
                | OperatorCommand::BackBy(_)
                | OperatorCommand::BackToBlock
                | OperatorCommand::BackToPierce
                | OperatorCommand::BackToContour(_)
                | OperatorCommand::BackToCutEnd => model.recovering = false,
                _ => {}
            }
            if let OperatorCommand::OptionalStop(on) = command {
                model.optional_stop = *on;
            }
            if let Some(pause) = &mut model.pause
                && *command == OperatorCommand::Online
            {
                pause.online = true;
            }
        }
        EventKind::CommandRejected(_) if model.pause.is_some() && before.is_some() => model.pause = before,
        EventKind::CutterBoundary => model.at_cutter_boundary = true,
        EventKind::ToolChange(tool) => model.tool_change = Some(*tool),
        EventKind::CommandRejected(_) if model.mode == Mode::Run => model.recovering = false,
        EventKind::CutterState { channel, state, contour } => {
            let before = model.cutter_states.insert(*channel, (*state, *contour)).unwrap_or_default();
            height_text::follow_sheet(model, before.0, *state);
            // Why it was off before says nothing once it is on again.
            if matches!(state, CutterState::Igniting | CutterState::Piercing | CutterState::Cutting) {
                model.cutter_off_reasons.remove(channel);
            }
        }
        EventKind::CutEnd { line, .. } => model.cut_end_line = Some(*line),
        EventKind::CutFromHere { .. } => model.recovering = false,
        EventKind::CutterOff { channel, reason } => {
            model.cutter_off_reasons.insert(*channel, reason.name());
            let holds =
                matches!(reason, CutterOffReason::Card(_) | CutterOffReason::Operator | CutterOffReason::NotLatched);
            if holds {
                (model.restarting, model.recovering) = (None, false);
                model.lost_cutter =
                    matches!(reason, CutterOffReason::Card(cause) if cause.ends_cut()).then_some(*channel);
            }
            model.cutter_is_off |= holds && model.mode == Mode::Run && model.program_output(*channel) != 0;
        }
        EventKind::OverridePlanned(percent) => model.override_planned = percent / 100.0,
        EventKind::OutputsDiffer(some) => {
            // A long list arrives in parts.
            let list = some.list();
            model.differing_outputs.retain(|old| list.iter().all(|new| new.channel != old.channel));
            model.differing_outputs.extend(list);
        }
        EventKind::OutputsRestored | EventKind::RunResumed => {
            model.restarts += u32::from(model.cut_end_line.is_some());
            model.differing_outputs.clear();
            (model.cutter_is_off, model.cut_end_line, model.lost_cutter) = (false, None, None);
            (model.recovering, model.restarting) = (false, None);
        }
        EventKind::RestartSwitching(code) => model.restarting = Some(code),
        EventKind::RestartSwitched(_) => model.restarting = None,
        EventKind::Mode(mode) => {
            model.restarting = None;
            // Whoever goes elsewhere has not confirmed them; they are compared again where he restarts.
            if *mode != Mode::AwaitOutputs {
                model.differing_outputs.clear();
            }
        }
        EventKind::Switching(code) => model.switching = Some(code),
        EventKind::Switched(_) => model.switching = None,
        EventKind::ProgramStop(code) => model.program_stop = Some(code),
        EventKind::StreamStalled { source, .. } => model.waiting = Some((source.clone(), event.period)),
        EventKind::StreamResumed { .. } => model.waiting = None,
        EventKind::ProgramEnd => {
            model.ended.get_or_insert(event.period);
        }
        EventKind::Contour { .. } | EventKind::ToolLifted => model.tool_is_down = false,
        EventKind::Dnc(DncEvent { step: DncStep::Paused { .. }, .. }) => model.sheet_mm = None,
        EventKind::Underrun => model.underruns += 1,
        EventKind::Alarm(error) => {
            let (number, cause, remedy) = error.parts();
            model.alarm = Some(AlarmShown { number: number.into(), cause, remedy, is_refusal: false });
            model.sheet_mm = None;
        }
        _ => {}
    }
    for text in event_text::lines(model, event) {
        model.add_message(event.time_s, event.line, text);
    }
    keep
}

/// Starts a job: clears what an earlier job left, except its messages.
fn begin(model: &mut ScreenModel, event: &Event) {
    (model.stage, model.began, model.alarm) = (ScreenStage::Job, event.period, None);
    (model.retraced_periods, model.held_periods) = (0, 0);
    (model.is_jog_released, model.manual_result) = (false, String::new());
    (model.ended, model.hold_reason, model.waiting) = (None, HoldReason::None, None);
    (model.optional_stop, model.tool_change, model.cutter_is_off) = (false, None, false);
    (model.cut_end_line, model.lost_cutter, model.is_stopping) = (None, None, false);
    (model.recovering, model.restarting, model.restarts) = (false, None, 0);
    (model.sheet_mm, model.tool_is_down) = (None, false);
    if model.history_before.is_none() {
        model.program_outputs = model.outputs.clone();
    }
    (model.single, model.underruns, model.override_planned) = (false, 0, 1.0);
    let lengths = PathLengths::from(event.place);
    let lengths = model.history_before.take().map_or(lengths.clone(), |(oldest, mm)| lengths.with_history(oldest, mm));
    (model.trail, model.lengths) = (Trail::default(), lengths);
    let at = model.in_space();
    model.trail.push(TrailPoint { along_mm: 0.0, at, rapid: false });
}
