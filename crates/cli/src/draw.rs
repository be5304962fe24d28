//! `retrace plot`: draws the tool path, velocity, acceleration and jerk over time, or the history of a job, as SVG or
//! PNG.
//!
//! Invariant: the path is the program's own, with the sections that the card retraced; the profile comes from the
//! pulses that the card emitted.

use std::path::Path;

use retrace_config::{MachineConfig, NumberedError};
use retrace_controller::{
    Cancelled, CommandSources, JobOptions, JobStart, MotionSink, Observer, PlanWriteError, RunMode, ScriptPlayer,
    SwitchInstruction, Telemetry, feed_program, run_job,
};
use retrace_core::mode::Mode;
use retrace_hal_sim::{Clock, SourceFaults};
use retrace_journal::JournalConfig;
use retrace_link::OutputChange;
use retrace_motion::{Arc, FeedRate, PathMode};
use retrace_plot::{
    AxisTrack, Derivatives, DisplayList, Profile, Size, Stroke, StrokeKind, ToolPath, View, draw_history, draw_path,
    draw_profile,
};

use crate::args;
use crate::command_failure::CommandFailure;
use crate::draw_job;
use crate::files::unwritable;
use crate::program::Program;
use crate::sim_wiring::simulated;

/// Number of periods over which differences are taken, because positions are whole pulses.
const STRIDE: usize = 16;

/// Runs the command.
///
/// # Errors
/// The program, the files or the drawing options have errors.
pub fn run(args: &args::Plot) -> Result<(), CommandFailure> {
    let size = size(&args.size)?;
    let ending = args.output.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    if !matches!(ending.as_deref(), Some("svg" | "png")) {
        return Err(draw_error(
            format!("{} is neither .svg nor .png", args.output.display()),
            "use -o path.svg or -o path.png",
        )
        .into());
    }
    let view = args.view.as_deref().map(view).transpose()?;
    if let Some([from, to]) = lines_shown(args).filter(|[from, to]| from > to) {
        return Err(draw_error(
            format!("--from {from} --to {to}: the first line is after the last"),
            "--from N --to M",
        )
        .into());
    }
    let picture = match &args.job {
        Some(id) => {
            let history = draw_job::history(id.as_deref(), args.jobs.path())?;
            draw_history(&history, view.unwrap_or_else(|| View::fitting(&history.path)), size)
        }
        None => program_drawing(args, view, size)?,
    };
    write(&picture, &args.output)?;
    say!("{} written", args.output.display());
    Ok(())
}

/// Drawing of a program: its path, or its profile.
fn program_drawing(args: &args::Plot, view: Option<View>, size: Size) -> Result<DisplayList, CommandFailure> {
    let machine = args.planning.apply_to(crate::files::machine(args.machine_file.path())?);
    let script = crate::files::script(args.operator.as_deref())?;
    let program = Program::open(&args.reading, &machine)?;
    program.check(&machine)?;
    let mut trace = PathTrace::new(&machine, args.profile, lines_shown(args));
    if args.profile || !script.is_empty() {
        let mut card = simulated::<9>(&machine, (&SourceFaults::default(), None), Clock::Virtual)?;
        let operators = CommandSources::from_script(ScriptPlayer::new(script, machine.period_us));
        let run_mode = RunMode { wall_time: false, operator: args.operator.is_some(), real_time: false };
        let job_options =
            JobOptions { start: JobStart::First, commands: operators, run_mode, journal: JournalConfig::default() };
        run_job::<9, _>(&machine, program.decoder(), job_options, &mut card, &mut trace)
            .map_err(|why| draw_error(why.to_string(), "set a shorter history_hours in the machine file"))?;
    }
    if args.profile {
        let Some([from, to]) = trace.lines else { return Ok(draw_profile(&trace.profile(program.name()), size)) };
        let lines = if to == u32::MAX { format!("from line {from} on") } else { format!("lines {from} to {to}") };
        if trace.shown_periods.is_none() {
            let what = format!("{}, {lines}: nothing moves there", program.name());
            return Err(draw_error(what, "give a range with a line that moves an axis").into());
        }
        return Ok(draw_profile(&trace.profile(&format!("{}, {lines}", program.name())), size));
    }
    let mut path = ToolPath { title: program.name().into(), strokes: trace.retraced };
    path.strokes.extend(programmed(&machine, &program));
    let view = view.unwrap_or_else(|| View::fitting(&path));
    Ok(draw_path(&path, view, size))
}

/// First and last program line of the profile; `None` for all.
fn lines_shown(args: &args::Plot) -> Option<[u32; 2]> {
    (args.from.is_some() || args.to.is_some()).then(|| [args.from.unwrap_or(1), args.to.unwrap_or(u32::MAX)])
}

fn write(picture: &DisplayList, output: &Path) -> Result<(), NumberedError> {
    let is_png = output.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"));
    let bytes = if is_png {
        picture.to_png().map_err(|error| draw_error(error.to_string(), "use a smaller --size"))?
    } else {
        picture.to_svg().into_bytes()
    };
    std::fs::write(output, bytes).map_err(|error| unwritable(&output.display().to_string(), &error))
}

fn draw_error(what: impl Into<String>, remedy: &str) -> NumberedError {
    NumberedError::new("E2143", what, remedy)
}

fn size(text: &str) -> Result<Size, NumberedError> {
    let (width, height) = text
        .split_once('x')
        .and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)))
        .ok_or_else(|| draw_error(format!("--size {text} is not a size"), "use --size 1200x900"))?;
    Size::pixels(width, height).map_err(|error| draw_error(error.to_string(), "--size 1200x900"))
}

fn view(name: &str) -> Result<View, NumberedError> {
    match name {
        "xy" => Ok(View::Xy),
        "xz" => Ok(View::Xz),
        "yz" => Ok(View::Yz),
        "iso" => Ok(View::Iso),
        _ => Err(draw_error(format!("--view {name} is not a view"), "use xy, xz, yz or iso")),
    }
}

/// Strokes of the program itself.
fn programmed(machine: &MachineConfig, program: &Program) -> Vec<Stroke> {
    let mut drawing = Drawing { place: Place::of(machine), at: [0.0; 9], strokes: Vec::new() };
    feed_program(machine, &mut program.decoder(), &mut drawing);
    drawing.strokes
}

/// Axes of the machine that are X, Y and Z of a drawing.
#[derive(Clone, Copy)]
struct Place([Option<usize>; 3]);

impl Place {
    fn of(machine: &MachineConfig) -> Self {
        Self(['x', 'y', 'z'].map(|name| machine.axes.iter().position(|a| a.name == name)))
    }

    fn point(self, axes: &[f64; 9]) -> [f64; 3] {
        self.0.map(|axis| axis.map_or(0.0, |i| axes[i]))
    }
}

/// Collects the moves of a program as strokes.
struct Drawing {
    place: Place,
    at: [f64; 9],
    strokes: Vec<Stroke>,
}

impl Drawing {
    fn move_to(&mut self, to: [f64; 9], kind: StrokeKind) {
        let (from, point) = (self.place.point(&self.at), self.place.point(&to));
        match self.strokes.last_mut() {
            Some(stroke) if stroke.kind == kind => stroke.points.push(point),
            _ => self.strokes.push(Stroke { kind, points: vec![from, point] }),
        }
        self.at = to;
    }
}

impl MotionSink<9> for Drawing {
    fn straight(&mut self, end_mm: [f64; 9], feed: FeedRate, _: PathMode, _: u32) -> Result<(), PlanWriteError> {
        self.move_to(end_mm, if feed == FeedRate::Rapid { StrokeKind::Rapid } else { StrokeKind::Feed });
        Ok(())
    }

    fn arc(&mut self, arc: &Arc<9>, _: FeedRate, _: PathMode, _: u32) -> Result<(), PlanWriteError> {
        let ([p, q], [cp, cq], start) = (arc.plane, arc.centre_mm, self.at);
        let radius = (start[p] - cp).hypot(start[q] - cq);
        let (from, sweep) = arc.sweep(&start);
        // enough chords to look like an arc
        let chords = (sweep.abs() / 0.05).ceil().clamp(2.0, 100_000.0);
        for k in 1..=chords as u32 {
            let share = f64::from(k) / chords;
            let angle = from + sweep * share;
            let mut point: [f64; 9] = std::array::from_fn(|i| start[i] + (arc.end_mm[i] - start[i]) * share);
            point[p] = cp + radius * angle.cos();
            point[q] = cq + radius * angle.sin();
            self.move_to(point, StrokeKind::Feed);
        }
        self.move_to(arc.end_mm, StrokeKind::Feed);
        Ok(())
    }

    fn action(&mut self, _: OutputChange, _: u32) {}

    fn exclusive(&mut self, _: SwitchInstruction<'_>) -> Result<(), Cancelled> {
        Ok(())
    }

    fn message(&mut self, _: String, _: u32) -> Result<(), Cancelled> {
        Ok(())
    }
}

/// Trace of the card: its positions over time, and where it retraced.
struct PathTrace<'m> {
    machine: &'m MachineConfig,
    place: Place,
    keep: bool,
    /// Positions in mm, axis by axis, at the end of every period.
    positions: Vec<Vec<f64>>,
    retraced: Vec<Stroke>,
    retraced_s: Vec<[f64; 2]>,
    is_retracing: bool,
    /// First and last program line to show.
    lines: Option<[u32; 2]>,
    /// First and last period with motion of these lines, as indices of `positions`.
    shown_periods: Option<[usize; 2]>,
}

impl<'m> PathTrace<'m> {
    fn new(machine: &'m MachineConfig, keep: bool, lines: Option<[u32; 2]>) -> Self {
        let positions = vec![vec![0.0]; machine.axes.len()];
        let place = Place::of(machine);
        let (retraced, retraced_s) = (Vec::new(), Vec::new());
        Self { machine, place, keep, positions, retraced, retraced_s, is_retracing: false, lines, shown_periods: None }
    }

    fn profile(&self, title: &str) -> Profile {
        let axes = self.machine.axes.iter().zip(&self.positions).map(|(axis, positions)| AxisTrack {
            name: axis.name.to_ascii_uppercase().to_string(),
            positions_mm: positions.clone(),
            limits: Derivatives {
                velocity: axis.max_velocity_mm_per_s,
                acceleration: axis.max_acceleration_mm_per_s2,
                jerk: axis.max_jerk_mm_per_s3,
            },
        });
        Profile {
            title: title.into(),
            period_s: self.machine.period_s(),
            stride_periods: STRIDE,
            axes: axes.collect(),
            retraced_s: self.retraced_s.clone(),
            shown_s: self.shown_periods.map(|[first, last]| {
                let at = |index: usize| index as f64 * self.machine.period_s();
                [at(first.saturating_sub(1)), at(last)]
            }),
        }
    }
}

impl Observer<9> for PathTrace<'_> {
    fn on_telemetry(&mut self, telemetry: &Telemetry<9>) {
        let Telemetry::Period(period) = telemetry else { return };
        let mut mm = [0.0; 9];
        for ((slot, axis), &count) in mm.iter_mut().zip(&self.machine.axes).zip(&period.counts) {
            *slot = axis.mm_of(count);
        }
        if self.keep {
            for (positions, &x) in self.positions.iter_mut().zip(&mm) {
                positions.push(x);
            }
            let moves = period.increments.iter().any(|&pulses| pulses != 0);
            if moves && self.lines.is_some_and(|[from, to]| (from..=to).contains(&period.line)) {
                let last = self.positions.first().map_or(0, |positions| positions.len() - 1);
                self.shown_periods.get_or_insert([last, last])[1] = last;
            }
        }
        let is_retracing = period.mode != Mode::Run;
        let (point, now) = (self.place.point(&mm), period.period as f64 * self.machine.period_s());
        match (is_retracing, self.is_retracing) {
            (true, false) => {
                self.retraced.push(Stroke { kind: StrokeKind::Retraced, points: vec![point] });
                self.retraced_s.push([now, now]);
            }
            (true, true) => {
                if let (Some(stroke), Some(time)) = (self.retraced.last_mut(), self.retraced_s.last_mut()) {
                    stroke.points.push(point);
                    time[1] = now;
                }
            }
            (false, _) => {}
        }
        self.is_retracing = is_retracing;
    }
}
