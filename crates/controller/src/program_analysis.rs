//! Analysis of a program without a card: extents, motion time, tools, feeds and speeds, and retrace barriers.
//!
//! The motion time is that of the plan itself: the moves go through the same planner as in a run, and its records are
//! counted.
//!
//! Invariant: the records counted are those that a run at 100 % plays, so that the time is the run's motion time to the
//! period.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use retrace_config::{CutterConfig, EncoderConfig, MachineConfig};
use retrace_core::Flags;
use retrace_gcode::Probing;
use retrace_link::{LayerMove, OutputChange, SheetSource, channel};
use retrace_motion::{Arc, FeedRate, LimitError, PathMode, PlanFallbacks, Planner};

use crate::abrasive_flow::AbrasiveFlow;
use crate::block_decoder::BlockDecoder;
use crate::canon_executor::WorkOffset;
use crate::check_finding::CheckFinding;
use crate::job;
use crate::limit_check::{LimitCheck, has_unknown};
use crate::motion_sink::MotionSink;
use crate::plan_item::ExclusiveKind;
use crate::plan_writer::{Cancelled, PlanWriteError, SwitchInstruction};
use crate::planned_path::{CutState, PathRecorder, PlannedPath};
use crate::probe_move::ProbeOutcome;
use crate::question::InputQuestion;
use crate::tap_move::RigidTap;
use crate::thread_plan::{ThreadRuns, ThreadStretch};
use crate::thread_plans::ThreadPlans;
use crate::value_range::ValueRange;

/// Extents in the coordinates in which a program was written.
#[derive(Clone, Debug, PartialEq)]
pub struct WorkExtents<const A: usize> {
    /// Coordinate system and offsets in force.
    pub offset: WorkOffset,
    /// Least and greatest coordinate of each of the machine's axes, mm. None where the system is rotated.
    pub extents_mm: Option<[[f64; 2]; A]>,
}

/// An instruction that reverse run cannot pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct BarrierLine {
    /// Program line.
    pub line: u32,
    /// Code as written in the program.
    pub code: &'static str,
}

/// Result of the analysis of a program.
#[derive(Debug)]
pub struct ProgramAnalysis<'m, const A: usize> {
    /// Moves and extents in machine coordinates.
    pub scan: LimitCheck<'m, A>,
    /// The extents in work coordinates, one for each offset that was active over a move.
    pub work: Vec<WorkExtents<A>>,
    /// Control periods of motion.
    pub motion_periods: u64,
    /// Control periods of dwells.
    pub dwell_periods: u64,
    /// Control periods of switching. Of waiting for inputs, those of the start of a cutter as it usually is: its proof,
    /// and the pressure of a jet.
    pub switch_periods: u64,
    /// Layer of the tool axis, and that of the sheet once it was sensed.
    layer: (i32, Option<i32>),
    /// Control periods of starting the cutters and of their pierces; part of those of switching and of dwells.
    pub pierce_periods: u64,
    /// Number of starts that sense the sheet.
    pub sensings: u64,
    /// Abrasive that the program uses.
    pub abrasive: AbrasiveFlow,
    /// Numbers of the tools that are loaded into the spindle.
    pub tools: BTreeSet<u32>,
    /// Programmed feeds, mm/min (degrees/min where only rotary axes move).
    pub feed_mm_per_min: Option<ValueRange>,
    /// Spindle speeds, rpm.
    pub speed_rpm: Option<ValueRange>,
    /// Run-in and run-out of the threads.
    pub threads: ThreadRuns,
    /// What plans the threads.
    pub(crate) thread_plans: ThreadPlans<A>,
    /// Retrace barriers, by line, each once.
    pub barriers: BTreeSet<BarrierLine>,
    /// Lines with a program stop.
    pub stops: BTreeSet<u32>,
    /// Path length of feed moves over the linear axes, mm; with a cutter on, where the machine has one.
    pub cutting_mm: f64,
    /// Path length of rapids over the linear axes, mm.
    pub rapid_mm: f64,
    /// Number of times a cutter is switched on: an output of `cutting_outputs`, or the spindle where there are none.
    pub pierces: u64,
    /// Control periods of motion with each tool, 0 before the first one.
    pub tool_periods: BTreeMap<u32, u64>,
    /// The first line whose feed is above the machine's path velocity, and that feed, mm/min.
    pub feed_beyond: Option<(u32, f64)>,
    /// The tool in the spindle.
    tool: u32,
    /// Whether the spindle of a machine without a cutter is on.
    spindle_is_on: bool,
    /// Whether nothing has moved since a cutter was switched on: a dwell is its pierce.
    is_piercing: bool,
    /// Whether moves are left out of the times: those that depend on answers of the machine. The times are the least
    /// ones then.
    pub is_time_partial: bool,
    /// Whether the program makes the following moves whatever the machine answers.
    is_certain: bool,
    planner: Planner<A>,
    /// Recorder of the path, where the path is wanted.
    path: Option<PathRecorder>,
    /// Serial number of the last move, which its records have for a tag: a line may have several moves.
    serial: u32,
    /// Serial numbers of the moves whose records are not all counted, with their lines, where the path is wanted.
    lines: VecDeque<(u32, u32)>,
}

/// Maximum number of separate offsets; a program with more has the remaining ones in the last.
const MAX_OFFSETS: usize = 100;

impl<'m, const A: usize> ProgramAnalysis<'m, A> {
    /// Creates an analysis that begins at the machine's position.
    ///
    /// # Errors
    /// Limits that the planner does not accept; a checked machine has none of these.
    pub fn new(machine: &'m MachineConfig) -> Result<Self, LimitError> {
        let planner = Planner::new(machine.limits(), machine.start_mm())?
            .with_blending(machine.blending)
            .with_plan_mode(machine.plan_mode.into());
        Ok(Self {
            scan: LimitCheck::new(machine),
            work: Vec::new(),
            motion_periods: 0,
            dwell_periods: 0,
            switch_periods: 0,
            layer: (0, None),
            pierce_periods: 0,
            sensings: 0,
            abrasive: AbrasiveFlow::default(),
            tools: BTreeSet::new(),
            feed_mm_per_min: None,
            speed_rpm: None,
            threads: ThreadRuns::default(),
            thread_plans: ThreadPlans::default(),
            barriers: BTreeSet::new(),
            stops: BTreeSet::new(),
            cutting_mm: 0.0,
            rapid_mm: 0.0,
            pierces: 0,
            tool_periods: BTreeMap::new(),
            feed_beyond: None,
            tool: 0,
            spindle_is_on: false,
            is_piercing: false,
            is_time_partial: false,
            is_certain: true,
            planner,
            path: None,
            serial: 0,
            lines: VecDeque::new(),
        })
    }

    /// How often no plan was found and a slower one was made instead.
    pub fn plan_fallbacks(&self) -> PlanFallbacks {
        self.planner.fallbacks()
    }

    fn count(&mut self) {
        if self.path.is_none() && self.abrasive.is_off() {
            let periods = self.planner.count_records();
            self.add_motion(periods);
            return;
        }
        let mut periods = 0;
        while let Some(mut record) = self.planner.next_record() {
            periods += 1;
            self.abrasive.count_record(record.line);
            if self.path.is_some() {
                let serial = record.line;
                record.line = self.line_of(serial);
                if let Some(path) = &mut self.path {
                    path.add(&record, serial);
                }
            }
        }
        self.add_motion(periods);
    }

    /// Adds control periods of motion with the tool in the spindle.
    fn add_motion(&mut self, periods: u64) {
        if periods > 0 {
            self.motion_periods += periods;
            *self.tool_periods.entry(self.tool).or_default() += periods;
        }
    }

    fn rest(&mut self) {
        self.planner.stop(Flags::NONE);
        self.count();
        self.lines.clear();
    }

    /// The serial number of a new move of this line.
    fn next_serial(&mut self, line: u32) -> u32 {
        self.serial = self.serial.wrapping_add(1);
        if self.path.is_some() {
            self.lines.push_back((self.serial, line));
        }
        self.serial
    }

    /// The line of the move with this serial number, 0 for a record of no move. Earlier moves are forgotten.
    fn line_of(&mut self, serial: u32) -> u32 {
        while self.lines.front().is_some_and(|&(first, _)| (1..1 << 31).contains(&serial.wrapping_sub(first))) {
            self.lines.pop_front();
        }
        self.lines.front().filter(|&&(first, _)| first == serial).map_or(0, |&(_, line)| line)
    }

    /// Whether a move to `end_mm` can be planned: it is made for certain, its ends and its feed are known, and it does
    /// not leave the soft limits, where its path is not wanted: it may have any length then. The plan continues at rest
    /// behind moves that cannot.
    fn begin_move(&mut self, end_mm: &[f64; A], feed: FeedRate) -> bool {
        let is_feed_unknown = matches!(feed, FeedRate::PerSecond(rate) if rate.is_nan());
        let at = *self.scan.position_mm();
        let is_known = !is_feed_unknown && !has_unknown(end_mm) && !has_unknown(&at);
        if !self.is_certain || !is_known || self.path.is_none() && self.scan.is_beyond(end_mm) {
            self.rest();
            self.is_time_partial = true;
            return false;
        }
        let commanded = self.planner.commanded_mm();
        if commanded != at {
            self.rest();
            let mut pulses = [0; A];
            for (index, axis) in self.scan.machine().axes.iter().enumerate().take(A) {
                pulses[index] = axis.pulses_of(at[index]) - axis.pulses_of(commanded[index]);
            }
            self.planner.displace(pulses);
        }
        true
    }

    fn record_move(&mut self, feed: FeedRate, length_mm: f64, line: u32) {
        if let FeedRate::PerSecond(mm_s) = feed {
            ValueRange::extend(&mut self.feed_mm_per_min, mm_s * 60.0);
            if mm_s > self.scan.machine().path_velocity_mm_s * (1.0 + 1e-9) && length_mm > 0.0 {
                self.feed_beyond.get_or_insert((line, mm_s * 60.0));
            }
        }
        self.is_piercing = false;
        if let Some(path) = &mut self.path {
            let (contours, has_cutter) = (&self.scan.contours, !self.scan.machine().cutting_outputs.is_empty());
            let number = if contours.is_cutting() { u32::try_from(contours.count).unwrap_or(u32::MAX) } else { 0 };
            path.set_cut(CutState { is_cutting: number > 0 || !has_cutter, contour: number }, self.serial);
        }
        match feed {
            FeedRate::Rapid => self.rapid_mm += length_mm,
            FeedRate::PerSecond(_) | FeedRate::Duration(_) => {
                if self.scan.contours.is_cutting() || self.scan.machine().cutting_outputs.is_empty() {
                    self.cutting_mm += length_mm;
                }
            }
        }
        self.count();
    }

    /// Control periods of the moves of the layer, where the sheet is as expected.
    fn layer_periods(&mut self, switch: &SwitchInstruction<'_>) -> u64 {
        let machine = self.scan.machine();
        let (Some(moves), Some(layer)) = (switch.layer, machine.tool_layer()) else {
            return 0;
        };
        let (at, sheet) = self.layer;
        let takes_earlier_height =
            matches!(moves, LayerMove::Start { sheet: SheetSource::Kept(_), .. }) && sheet.is_some();
        self.sensings += u64::from(matches!(moves, LayerMove::Start { .. }) && !takes_earlier_height);
        let (seconds, at, sheet) = layer.usual_s(moves, at, sheet);
        self.layer = (at, sheet);
        (seconds / machine.period_s()).round() as u64
    }

    /// Control periods from the switching of a cutter until it is proven, as far as they are known, and of its pierce.
    fn start_periods(&self, switch: &SwitchInstruction<'_>) -> u64 {
        let Some(ignition) = switch.until.and_then(|until| until.ignition) else { return 0 };
        let machine = self.scan.machine();
        let cutter = switch.changes.iter().find_map(|change| machine.cutter_of(change.channel));
        let until_proof = cutter.map_or(0, |cutter| cutter.start.usual_periods(machine.period_us));
        u64::from(until_proof) + u64::from(ignition.stable_periods) + u64::from(ignition.delay_periods)
    }

    /// Control periods until the pressure of a jet is high, where an instruction raises it and waits for it.
    fn pressure_periods(&self, switch: &SwitchInstruction<'_>) -> u64 {
        let machine = self.scan.machine();
        let Some(until) = switch.until else { return 0 };
        let raised = switch.changes.iter().filter(|change| change.value != 0 && !self.scan.is_on(change.channel));
        let jets = raised.filter_map(|change| {
            let raises = |jet: &&CutterConfig| jet.pressure == Some(change.channel);
            machine.cutters.iter().find(raises)?.jet.filter(|jet| jet.pressure_input == Some(until.input))
        });
        jets.map(|jet| (jet.usual_pressure_s / machine.period_s()).round() as u64).max().unwrap_or(0)
    }

    /// Records that the abrasive of a cutter is switched. The flow is that of the material or of the cutter.
    fn record_abrasive(&mut self, change: OutputChange) {
        let machine = self.scan.machine();
        let Some(cutter) = machine.cutters.iter().find(|cutter| cutter.abrasive == Some(change.channel)) else {
            return;
        };
        let of_material = self.scan.contours.material().map(|material| material.abrasive_g_per_min);
        let g_per_min = of_material.filter(|&flow| flow > 0.0).or(cutter.abrasive_g_per_min);
        self.abrasive.switch(change.channel, change.value != 0, g_per_min, self.serial.wrapping_add(1));
    }

    /// Gives an instruction or an action to the check of the moves, and counts the cutters that it lights.
    fn scan_switching<R>(&mut self, scan: impl FnOnce(&mut LimitCheck<'m, A>) -> R) -> R {
        let before = self.scan.contours.count;
        let done = scan(&mut self.scan);
        let lit = self.scan.contours.count - before;
        self.pierces += lit;
        self.is_piercing |= lit > 0;
        done
    }

    /// Records that the spindle of a machine without a cutter is switched.
    fn record_spindle(&mut self, change: OutputChange) {
        if self.scan.machine().cutting_outputs.is_empty() && change.channel == channel::SPINDLE {
            let is_on = change.value != 0;
            self.pierces += u64::from(is_on && !self.spindle_is_on);
            self.spindle_is_on = is_on;
        }
    }

    fn record_switching(&mut self, change: OutputChange) {
        self.record_spindle(change);
        self.record_abrasive(change);
        match change.channel {
            channel::SPEED => ValueRange::extend(&mut self.speed_rpm, f64::from(change.value) / 1000.0),
            channel::TOOL => {
                self.tool = change.value.unsigned_abs();
                self.tools.insert(self.tool);
            }
            _ => {}
        }
    }

    /// Assigns the moves since the last call to this offset.
    fn assign_offset(&mut self, offset: WorkOffset) {
        let Some(moved) = self.scan.take_last() else { return };
        // Extents in unknown coordinates are unknown.
        if offset.rotation_deg.is_nan() || offset.origin_mm.0.iter().any(|mm| mm.is_nan()) {
            return;
        }
        let known = self.work.iter().position(|work| work.offset == offset);
        let index = known.unwrap_or(self.work.len().min(MAX_OFFSETS - 1));
        if index == self.work.len() {
            self.work.push(WorkExtents { offset, extents_mm: None });
        }
        let work = &mut self.work[index];
        let Some(origin) = work.offset.translation::<A>(self.scan.machine()) else { return };
        let extents = work.extents_mm.get_or_insert([[f64::INFINITY, f64::NEG_INFINITY]; A]);
        for ((extent, range), origin) in
            extents.iter_mut().zip(moved).zip(origin).filter(|((_, moved), _)| !moved[0].is_nan())
        {
            *extent = [extent[0].min(range[0] - origin), extent[1].max(range[1] - origin)];
        }
    }
}

impl<const A: usize> MotionSink<A> for ProgramAnalysis<'_, A> {
    fn straight(&mut self, end_mm: [f64; A], feed: FeedRate, mode: PathMode, line: u32) -> Result<(), PlanWriteError> {
        if !self.begin_move(&end_mm, feed) {
            return self.scan.straight(end_mm, feed, mode, line);
        }
        let length_mm = self.scan.linear_squared(&self.planner.commanded_mm(), &end_mm, &[]).sqrt();
        let serial = self.next_serial(line);
        self.planner.line(end_mm, feed, mode, serial)?;
        self.scan.straight(end_mm, feed, mode, line)?;
        self.record_move(feed, length_mm, line);
        Ok(())
    }

    fn arc(&mut self, arc: &Arc<A>, feed: FeedRate, mode: PathMode, line: u32) -> Result<(), PlanWriteError> {
        let is_beyond = self.path.is_none() && self.scan.is_arc_beyond(arc);
        if has_unknown(&arc.centre_mm) || is_beyond || !self.begin_move(&arc.end_mm, feed) {
            self.rest();
            self.is_time_partial = true;
            return self.scan.arc(arc, feed, mode, line);
        }
        let serial = self.next_serial(line);
        self.planner.arc(arc, feed, mode, serial)?;
        let length_mm = self.scan.arc_mm(arc);
        self.scan.arc(arc, feed, mode, line)?;
        self.record_move(feed, length_mm, line);
        Ok(())
    }

    fn action(&mut self, change: OutputChange, line: u32) {
        self.scan_switching(|scan| scan.action(change, line));
        self.record_switching(change);
    }

    fn exclusive(&mut self, switch: SwitchInstruction<'_>) -> Result<(), Cancelled> {
        self.rest();
        let pressure_periods = self.pressure_periods(&switch);
        self.scan_switching(|scan| scan.exclusive(switch))?;
        let start_periods = self.start_periods(&switch) + pressure_periods;
        let periods = u64::from(switch.periods) + start_periods + self.layer_periods(&switch);
        switch.changes.iter().for_each(|&change| self.record_switching(change));
        self.abrasive.count_rest(periods);
        match switch.kind {
            ExclusiveKind::Dwell => self.dwell_periods += periods,
            ExclusiveKind::Switch => self.switch_periods += periods,
            ExclusiveKind::ProgramStop | ExclusiveKind::ToolChange => drop(self.stops.insert(switch.line)),
            // The rate changes in a control period at rest.
            ExclusiveKind::FeedOverride { .. } => self.switch_periods += 1,
            ExclusiveKind::OptionalStop | ExclusiveKind::OffPath | ExclusiveKind::Input => {}
        }
        let lights = switch.changes.iter().any(|change| self.scan.contours.is_open(change.channel));
        if self.is_piercing && (lights || switch.kind == ExclusiveKind::Dwell && switch.code == "G4") {
            self.pierce_periods += periods;
        }
        if switch.is_barrier {
            self.barriers.insert(BarrierLine { line: switch.line, code: switch.code });
        }
        Ok(())
    }

    fn height(&mut self, height: i32, _: u32, _: u32) {
        let (at, sheet) = self.layer;
        self.layer.0 = sheet.map_or(at, |sheet| sheet + height);
    }

    /// The touch ends it at an unknown time.
    fn probe(
        &mut self,
        end_mm: [f64; A],
        feed_mm_s: f64,
        _: Probing,
        line: u32,
    ) -> Result<Option<ProbeOutcome<A>>, PlanWriteError> {
        self.rest();
        self.is_time_partial = true;
        self.scan.straight(end_mm, FeedRate::PerSecond(feed_mm_s), PathMode::ExactStop, line)?;
        Ok(None)
    }

    fn read_input(&mut self, question: InputQuestion, _: u32) -> Result<Option<i32>, PlanWriteError> {
        self.rest();
        self.is_time_partial |= question.timeout_periods > 0;
        Ok(None)
    }

    fn thread(&mut self, stretch: &ThreadStretch<A>, encoder: &EncoderConfig) -> Result<(), PlanWriteError> {
        self.rest();
        let from = *self.scan.position_mm();
        if !has_unknown(&from) && !stretch.rpm.is_nan() {
            let planned = self.thread_plans.run_mm(stretch, self.scan.machine(), encoder, from);
            if let Some(run_mm) = planned.map_err(|error| PlanWriteError::of_thread(error, stretch.line()))? {
                self.threads.add(stretch.line(), run_mm);
            }
        }
        for piece in &stretch.pieces {
            let feed = FeedRate::PerSecond(piece.pitch_mm * stretch.rpm / 60.0);
            self.straight(piece.end_mm, feed, piece.mode, piece.line)?;
        }
        self.rest();
        self.barriers.insert(BarrierLine { line: stretch.line(), code: "G33" });
        Ok(())
    }

    fn tap(&mut self, tap: &RigidTap<A>, encoder: &EncoderConfig) -> Result<(), PlanWriteError> {
        self.rest();
        let is_known = !has_unknown(&tap.from_mm) && !has_unknown(&tap.depth_mm) && !tap.rpm.is_nan();
        if !self.thread_plans.are_known() && is_known {
            let planned = tap.run_in_mm(self.scan.machine(), encoder);
            let run_in_mm = planned.map_err(|error| PlanWriteError::of_thread(error, tap.line))?;
            // What is behind the depth is for the reversal.
            self.threads.add(tap.line, [run_in_mm, 0.0]);
        }
        let feed = FeedRate::PerSecond(tap.pitch_mm * tap.rpm / 60.0);
        self.straight(tap.depth_mm, feed, PathMode::ExactStop, tap.line)?;
        self.straight(tap.from_mm, feed, PathMode::ExactStop, tap.line)?;
        self.rest();
        self.barriers.insert(BarrierLine { line: tap.line, code: "rigid tap" });
        Ok(())
    }

    fn unknown_motion(&mut self, end_mm: [f64; A], line: u32) {
        self.rest();
        self.is_time_partial = true;
        self.scan.unknown_motion(end_mm, line);
    }

    fn set_position(&mut self, at_mm: [f64; A]) {
        self.rest();
        self.scan.set_position(at_mm);
    }

    fn set_certain(&mut self, is_certain: bool) {
        self.is_certain = is_certain;
    }

    fn message(&mut self, _: String, _: u32) -> Result<(), Cancelled> {
        Ok(())
    }
}

/// Distance between an axis and its soft limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TravelLeft {
    /// Axis letter.
    pub axis: char,
    /// Least and greatest machine coordinate, mm.
    pub extents_mm: [f64; 2],
    /// Remaining distance to the lower and to the upper limit, mm; negative where it would be passed.
    pub travel_left_mm: [f64; 2],
}

impl<const A: usize> ProgramAnalysis<'_, A> {
    /// Each axis with its distance to the soft limits. Empty where nothing moves.
    #[must_use]
    pub fn travel_left(&self) -> Vec<TravelLeft> {
        let Some(extents) = self.scan.extents_mm else { return Vec::new() };
        let axes = self.scan.machine().axes.iter().zip(extents).filter(|(_, extents)| !extents[0].is_nan());
        axes.map(|(axis, extents_mm)| TravelLeft {
            axis: axis.name,
            extents_mm,
            travel_left_mm: [extents_mm[0] - axis.travel_mm[0], axis.travel_mm[1] - extents_mm[1]],
        })
        .collect()
    }

    /// Offsets that were active over a move, without the one that is none at all.
    pub fn offsets(&self) -> impl Iterator<Item = &WorkExtents<A>> {
        self.work.iter().filter(|work| !work.offset.is_none())
    }
}

/// Analyses a whole program. Returns the number of blocks, the findings, and the analysis. `threads` are those of a
/// check of the same program, which are not planned again then.
///
/// # Errors
/// Limits that the planner does not accept.
pub fn analyse_program<'m, const A: usize>(
    machine: &'m MachineConfig,
    program: &mut impl BlockDecoder,
    threads: Option<ThreadRuns>,
) -> Result<Analysed<'m, A>, LimitError> {
    let mut analysis = ProgramAnalysis::new(machine)?;
    if let Some(threads) = threads {
        (analysis.threads, analysis.thread_plans) = (threads, ThreadPlans::Known);
    }
    analyse(machine, program, analysis, &mut drop)
}

/// Analyses a whole program and records its path. Returns the analysis and the path. `show_part` is given the path as
/// far as it is planned, now and then, where the analysis takes long.
///
/// # Errors
/// Limits that the planner does not accept.
pub fn analyse_path<'m, const A: usize>(
    machine: &'m MachineConfig,
    program: &mut impl BlockDecoder,
    mut show_part: impl FnMut(PlannedPath),
) -> Result<(ProgramAnalysis<'m, A>, PlannedPath), LimitError> {
    let analysis = ProgramAnalysis { path: Some(PathRecorder::new(machine)), ..ProgramAnalysis::new(machine)? };
    let (_, _, mut analysis) = analyse(machine, program, analysis, &mut show_part)?;
    let path = analysis.path.take().map(PathRecorder::finish).unwrap_or_default();
    Ok((analysis, path))
}

/// Analysis of a program: number of blocks, findings, and the analysis itself.
pub type Analysed<'m, const A: usize> = (u64, Vec<CheckFinding>, ProgramAnalysis<'m, A>);

pub(crate) fn analyse<'m, const A: usize>(
    machine: &'m MachineConfig,
    program: &mut impl BlockDecoder,
    mut survey: ProgramAnalysis<'m, A>,
    show_part: &mut dyn FnMut(PlannedPath),
) -> Result<Analysed<'m, A>, LimitError> {
    let (blocks, mut findings) = job::feed_each(machine, program, &mut survey, |track, program, survey| {
        survey.assign_offset(track.work_offset());
        survey.scan.contours.set_material(track.material());
        survey.scan.contours.locate(|| program.location());
        if let Some(part) = survey.path.as_mut().and_then(PathRecorder::part_to_show) {
            show_part(part);
        }
    });
    survey.rest();
    findings.extend_from_slice(survey.scan.beyond.findings());
    findings.extend(survey.scan.warnings());
    findings.sort_by_key(|finding| finding.line);
    Ok((blocks, findings, survey))
}
