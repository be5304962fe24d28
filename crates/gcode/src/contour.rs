//! Contours of cycles of the third kind (PRE-4, PRE-8): a subprogram, or the lines between two labels, read as lines
//! and arcs.
//!
//! Invariant: a contour is executed in a copy of the interpreter, so it moves and switches nothing. A code that it must
//! not contain is refused with the control's alarm (cycles, section 7.3). A path, once calculated, is cached with the
//! pre-scan.

use crate::canon::{ArcFeed, Canon, CanonStep};
use crate::canon_modes::Plane;
use crate::control::Label;
use crate::control::subprogram_label;
use crate::cycle_call::CycleCall;
use crate::diag::{BlockResult, Span, fault};
use crate::error_codes::ErrorCode;
use crate::flow_controller::{FlowController, LineOutcome};
use crate::interp::{Contours, Core, Interpreter, LineRead};
use crate::parse::LineReader;
use crate::path_cache::PlannedContour;
use crate::pose::{Axis, Pose};
use crate::prescan::Prescan;
use retrace_cycles::stock::{
    Axes, Corner, Element, Kind, MoveKind, Point, StockRemovalError, StockRemovalParams, ToolTip, Warning, plan,
};
use retrace_cycles::{StockCall, StockFeed, StockMove, StockPathError};
use std::sync::Arc;

/// Maximum number of lines of a contour.
const MAX_LINES: u32 = 10_000;
/// Maximum number of elements read before the path is calculated, which accepts far fewer; also of canonical functions
/// of a profile.
const MAX_ELEMENTS: usize = 50_000;
/// Reader of contours for a cycle of a program.
pub(crate) struct ContourReader<'a> {
    pub(crate) flow: &'a FlowController,
    pub(crate) prescan: Option<&'a Prescan>,
    pub(crate) reader: LineReader,
}

impl Contours for ContourReader<'_> {
    fn stock(&self, core: &Core, call: &StockCall<'_>) -> Result<PlannedContour, StockPathError> {
        let mut contour = Contour::new(core.state.plane);
        self.read(core, call.contour, &mut contour)?;
        let tool = core.tools.get(core.state.current_tool).unwrap_or_default();
        let job = StockRemovalParams {
            contour: contour.elements,
            vari: call.vari,
            mid: call.mid,
            fal_z: call.fal_z,
            fal_x: call.fal_x,
            fal: call.fal,
            dam: call.dam,
            vrt: call.vrt,
            nose_radius: core.to_program_unit(Axis::X, tool.diameter) / 2.0,
            tip: ToolTip::of_orientation(tool.orientation as i32),
            clearance_angle: tool.back_angle,
            rough_compensated: true,
            position: Some(point(&core.state.position, core.state.plane)),
        };
        match self.prescan {
            Some(prescan) => prescan.paths.get_or_plan(job, planned),
            None => planned(&job),
        }
    }
}

impl ContourReader<'_> {
    fn read(&self, core: &Core, name: &str, contour: &mut Contour) -> Result<(), StockPathError> {
        let mut scratch = Interpreter::scratch(core.clone(), self.reader.clone());
        if let Some((start, end)) = name.split_once(':') {
            let lines = self.prescan.and_then(|prescan| prescan.between(start, end));
            let lines = lines.ok_or_else(|| no_contour(name))?;
            return between(lines.0, &lines.1, &mut scratch, contour);
        }
        if let Some(sub) = self.flow.subs.find(0, &subprogram_label(name)) {
            return self.subprogram(self.flow.for_subprogram(sub), &mut scratch, contour);
        }
        let cycles = self.reader.cycles.as_deref();
        match cycles.and_then(|cycles| cycles.find(name)) {
            Some(id) => {
                let call = CycleCall { id, name: name.into(), arguments: Arc::new([]), at: Span::default() };
                let mut steps = Vec::new();
                scratch
                    .call_cycle(&call, &crate::interp::NoContours, &mut steps)
                    .map_err(|fault| wrong(&fault.message))?;
                contour.apply_steps(&steps, &scratch, false)
            }
            None => Err(no_contour(name)),
        }
    }

    fn subprogram(
        &self,
        flow: Option<FlowController>,
        scratch: &mut Interpreter,
        contour: &mut Contour,
    ) -> Result<(), StockPathError> {
        let Some(mut flow) = flow else { return Ok(()) };
        let mut steps = Vec::new();
        for _ in 0..MAX_LINES {
            steps.clear();
            match flow.step(scratch, &mut steps).map_err(|fault| wrong(&fault.message))? {
                LineOutcome::Block => {
                    scratch.execute_block(&mut steps).map_err(|fault| wrong(&fault.message))?;
                    contour.apply_steps(&steps, scratch, true)?;
                }
                LineOutcome::Jumped => {}
                LineOutcome::Faulty | LineOutcome::Ahead(..) | LineOutcome::PathEnd => {
                    return Err(wrong("one of its blocks is refused"));
                }
                LineOutcome::Cycle(_) => return Err(refused(&StockRemovalError::Interpolation(scratch.line_number()))),
                LineOutcome::Idle | LineOutcome::ProgramEnd => return Ok(()),
            }
        }
        Err(wrong("it has no end"))
    }
}

/// Reads the lines of a text; `first` is the number of the first one.
fn between(first: u32, text: &[u8], scratch: &mut Interpreter, contour: &mut Contour) -> Result<(), StockPathError> {
    let mut steps = Vec::new();
    for (index, line) in crate::line_split::SplitLines::new(text).enumerate() {
        steps.clear();
        let number = first.saturating_add(index as u32);
        match scratch.read(number, line).map_err(|fault| wrong(&fault.message))? {
            LineRead::Block => {
                scratch.execute_block(&mut steps).map_err(|fault| wrong(&fault.message))?;
                contour.apply_steps(&steps, scratch, true)?;
            }
            LineRead::Deleted => {}
            LineRead::Control(_) => return Err(refused(&StockRemovalError::ChangeInside(number))),
        }
    }
    Ok(())
}

/// Returns the canonical functions of the subprogram with this number: the profile of a turning cycle.
///
/// # Errors
/// No subprogram has this number, or one of its blocks is wrong. The error is reported at the Q word, with the line of
/// the block.
pub(crate) fn profile_steps(
    flow: &FlowController,
    number: f64,
    scratch: &mut Interpreter,
) -> BlockResult<Vec<CanonStep>> {
    let at = scratch.last_words().span(b'q');
    let label = Label::Number(number.round().clamp(0.0, 1e15) as u64);
    let Some(flow) = flow.subs.find(0, &label).and_then(|sub| flow.for_subprogram(sub)) else {
        return fault(ErrorCode::NoContour, at, format!("there is no subprogram {label}"));
    };
    match subprogram_steps(flow, scratch) {
        Ok(Some(steps)) => Ok(steps),
        Ok(None) => fault(ErrorCode::TurningProfile, at, format!("{label} is not a profile")),
        Err(wrong) => fault(wrong.code, at, format!("profile, line {}: {}", scratch.line_number(), wrong.message)),
    }
}

/// Returns the canonical functions of a subprogram, or `None` if it is not a profile.
fn subprogram_steps(mut flow: FlowController, scratch: &mut Interpreter) -> BlockResult<Option<Vec<CanonStep>>> {
    let mut steps = Vec::new();
    for _ in 0..MAX_LINES {
        if steps.len() > MAX_ELEMENTS {
            break;
        }
        match flow.step(scratch, &mut steps)? {
            LineOutcome::Block => {
                scratch.execute_block(&mut steps)?;
            }
            LineOutcome::Jumped => {}
            LineOutcome::Faulty | LineOutcome::Cycle(_) | LineOutcome::Ahead(..) | LineOutcome::PathEnd => break,
            LineOutcome::Idle | LineOutcome::ProgramEnd => return Ok(Some(steps)),
        }
    }
    Ok(None)
}

fn no_contour(name: &str) -> StockPathError {
    StockPathError { alarm: 61605, text: format!("there is no contour {name}") }
}

fn wrong(message: &str) -> StockPathError {
    StockPathError { alarm: 61606, text: format!("contour: {message}") }
}

fn refused(fault: &StockRemovalError) -> StockPathError {
    let text = match fault.line() {
        Some(line) => format!("contour, line {line}: {fault}"),
        None => fault.to_string(),
    };
    StockPathError { alarm: fault.number(), text }
}

/// A contour being read.
struct Contour {
    plane: Plane,
    /// Current point; `None` before the first one.
    at: Option<Point>,
    elements: Vec<Element>,
}

impl Contour {
    fn new(plane: Plane) -> Contour {
        Contour { plane, at: None, elements: Vec::new() }
    }

    /// Applies the steps of a block. Of a block of the program, the first step is checked for its words.
    fn apply_steps(
        &mut self,
        steps: &[CanonStep],
        scratch: &Interpreter,
        is_block: bool,
    ) -> Result<(), StockPathError> {
        let line = scratch.line_number();
        if scratch.state().compensation.is_some() {
            return Err(refused(&StockRemovalError::CompensationInside(line)));
        }
        for step in steps {
            if self.elements.len() > MAX_ELEMENTS {
                return Err(refused(&StockRemovalError::TooManyElements));
            }
            match &step.canon {
                Canon::StraightTraverse(end) | Canon::StraightFeed(end) => {
                    if self.at.is_none() && is_block {
                        self.check_first(scratch, line)?;
                    }
                    let is_rapid = matches!(step.canon, Canon::StraightTraverse(_));
                    let kind = if is_rapid { Kind::Rapid } else { Kind::Line };
                    self.add(kind, point(end, self.plane), Point::default(), line);
                }
                Canon::ArcFeed(arc) => self.arc(arc, line)?,
                Canon::SelectPlane(_)
                | Canon::SelectTool(_)
                | Canon::ChangeTool { .. }
                | Canon::UseToolLengthOffset(_)
                | Canon::UseLengthUnits(_)
                | Canon::SetG5xOffset { .. }
                | Canon::SetG92Offset(_)
                | Canon::SetXyRotation(_) => return Err(refused(&StockRemovalError::ChangeInside(line))),
                Canon::StartSpeedFeedSynch { .. }
                | Canon::RigidTap { .. }
                | Canon::NurbsFeed(_)
                | Canon::UnknownMotion(_)
                | Canon::StraightProbe(..) => return Err(refused(&StockRemovalError::Interpolation(line))),
                // M, S and F are ignored.
                _ => {}
            }
        }
        Ok(())
    }

    fn check_first(&self, scratch: &Interpreter, line: u32) -> Result<(), StockPathError> {
        let words = scratch.last_words();
        if words.g(crate::groups::GroupG::Motion).is_none() {
            return Err(refused(&StockRemovalError::MissingMotion(line)));
        }
        let [first, second, _] = self.plane.axes().map(|axis| axis.letter().to_ascii_lowercase());
        if words.has(first) && words.has(second) { Ok(()) } else { Err(refused(&StockRemovalError::MissingAxis(line))) }
    }

    fn arc(&mut self, arc: &ArcFeed, line: u32) -> Result<(), StockPathError> {
        if arc.plane != self.plane {
            return Err(refused(&StockRemovalError::ChangeInside(line)));
        }
        if arc.turns.abs() != 1 {
            return Err(refused(&StockRemovalError::LongArc(line)));
        }
        let kind = if arc.turns < 0 { Kind::Clockwise } else { Kind::Counterclockwise };
        let centre = Point::new(arc.first_centre, arc.second_centre);
        self.add(kind, point(&arc.end, self.plane), centre, line);
        Ok(())
    }

    fn add(&mut self, kind: Kind, end: Point, centre: Point, line: u32) {
        if let Some(start) = self.at
            && (start != end || matches!(kind, Kind::Clockwise | Kind::Counterclockwise))
        {
            self.elements.push(Element { kind, start, end, centre, corner: Corner::None, line });
        }
        self.at = Some(end);
    }
}

fn point(pose: &Pose, plane: Plane) -> Point {
    let [first, second, _] = plane.axes();
    Point::new(pose[first], pose[second])
}

/// Calculates a path.
fn planned(job: &StockRemovalParams) -> Result<PlannedContour, StockPathError> {
    let path = plan(job).map_err(|fault| refused(&fault))?;
    let mut at = job.position.unwrap_or_default();
    let moves = path.moves.iter().map(|step| {
        let (motion, centre) = match step.kind {
            MoveKind::Rapid => (0, [0.0; 2]),
            MoveKind::Line => (1, [0.0; 2]),
            MoveKind::Clockwise => (2, [step.centre.u - at.u, step.centre.v - at.v]),
            MoveKind::Counterclockwise => (3, [step.centre.u - at.u, step.centre.v - at.v]),
        };
        // Each axis is set separately: an axis without a value keeps its position.
        at = match step.axes {
            Axes::First => Point::new(step.end.u, at.v),
            Axes::Second => Point::new(at.u, step.end.v),
            Axes::Both => step.end,
        };
        StockMove {
            motion,
            end: [at.u, at.v],
            centre,
            feed: feed(step.feed),
            compensation: compensation(step.compensation),
            dwell: step.dwell_after,
        }
    });
    let moves = moves.collect();
    let warnings = path.warnings.iter().filter_map(|warning| match warning {
        // The cycle itself has reported it.
        Warning::SignDropped(_) => None,
        Warning::ReliefLeftToFinishing(count) => {
            Some(format!("{count} relief cuts close up under the allowances and are left for finishing"))
        }
        Warning::NoseLeavesStock(line) => {
            Some(format!("contour, line {line}: the nose leaves stock for the finishing pass"))
        }
    });
    Ok(PlannedContour { moves, warnings: warnings.collect() })
}

const fn feed(feed: retrace_cycles::stock::Feed) -> StockFeed {
    use retrace_cycles::stock::Feed;
    match feed {
        Feed::Rapid => StockFeed::Rapid,
        Feed::Rough => StockFeed::Rough,
        Feed::Plunge => StockFeed::Plunge,
        Feed::Finish => StockFeed::Finish,
    }
}

const fn compensation(change: retrace_cycles::stock::Compensation) -> u8 {
    use retrace_cycles::stock::Compensation;
    match change {
        Compensation::Unchanged => 0,
        Compensation::Off => 40,
        Compensation::Left => 41,
        Compensation::Right => 42,
    }
}
