//! The steps of a DNC pause as events (DNC-1 … DNC-8).
//!
//! Invariant: every step is reported with all three flags as they are after it.

use std::fmt;

use retrace_config::AXIS_LETTERS;
use retrace_core::interruption::{Interruption, InterruptionError};
use serde_json::{Value, json};

/// Counts of each axis of a machine, for any number of axes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AxisCounts {
    counts: [i64; AXIS_LETTERS.len()],
    axes: u8,
}

impl AxisCounts {
    /// Creates counts from the first `axes` values.
    #[must_use]
    pub fn new(counts: &[i64], axes: usize) -> Self {
        let mut all = [0; AXIS_LETTERS.len()];
        for (slot, &count) in all.iter_mut().zip(counts) {
            *slot = count;
        }
        Self { counts: all, axes: axes.min(all.len()) as u8 }
    }

    /// Counts in the order of the machine's axes.
    #[must_use]
    pub fn get(&self) -> &[i64] {
        &self.counts[..usize::from(self.axes)]
    }
}

/// The three flags.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DncFlags {
    /// *DNC-paused*: from *pause* until the axes are back (DNC-1, DNC-7).
    pub paused: bool,
    /// *Mode-changed*: from *pause* until on-line mode is restored (DNC-2, DNC-5).
    pub mode_changed: bool,
    /// Reading the program is *inhibited*: from *cycle start* until the axes are back (DNC-6, DNC-7).
    pub inhibited: bool,
}

impl DncFlags {
    /// Flags of an interruption.
    #[must_use]
    pub fn from_interruption<const A: usize>(order: &Interruption<A>) -> Self {
        Self { paused: order.is_paused(), mode_changed: order.mode_changed(), inhibited: order.is_inhibited() }
    }
}

/// A step of a pause.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DncStep {
    /// The program is interrupted, or interrupted again on the return to the breakpoint; with what is latched (DNC-2).
    Paused {
        /// Machine counts of the breakpoint.
        counts: AxisCounts,
        /// Spindle: 1 clockwise, −1 counterclockwise, 0 at rest.
        spindle: i32,
        /// Spindle speed in thousandths of a revolution per minute.
        speed: u32,
    },
    /// The spindle was stopped manually (DNC-3).
    SpindleStopped,
    /// The spindle was started manually, in the latched direction at the latched speed (DNC-4).
    SpindleStarted {
        /// See [`DncStep::Paused`].
        spindle: i32,
        /// See [`DncStep::Paused`].
        speed: u32,
    },
    /// An axis was moved manually (DNC-3).
    Jogged {
        /// Axis letter.
        axis: char,
        /// Distance, mm (degrees).
        mm: f64,
        /// Whether the move was shortened: by the soft limit, or by a stop.
        cut_short: bool,
        /// Distance of each axis from the breakpoint in counts: the sum of all manual moves. Empty where nothing is
        /// paused.
        off: AxisCounts,
    },
    /// The pointer shows the place of the tool, or of its shifted start (CUT-37).
    PointerThere {
        /// They were stopped on the way.
        stopped: bool,
    },
    /// The axes are at the park position (CUT-34).
    Parked {
        /// Whether the move was stopped before.
        stopped: bool,
    },
    /// A tool length was entered: the breakpoint, and the path behind it, are moved along the tool axis.
    ToolLength {
        /// Letter of the tool axis.
        axis: char,
        /// Distance, mm.
        by_mm: f64,
        /// Distance, counts.
        by_counts: i64,
        /// The resulting tool length offset, mm. None where no offset is in force.
        length_mm: Option<f64>,
    },
    /// On-line mode is restored (DNC-5).
    Online,
    /// The axes begin their return to the latched counts (DNC-6).
    Approaching,
    /// The axes are back; reading of the program continues (DNC-7, DNC-8).
    Arrived,
}

/// A step and the flags after it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DncEvent {
    /// The step.
    pub step: DncStep,
    /// The flags.
    pub flags: DncFlags,
}

impl DncEvent {
    /// The event as one JSON object.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let mut value = match &self.step {
            DncStep::Paused { counts, spindle, speed } => {
                json!({"event": "paused", "counts": counts.get(), "spindle": spindle, "speed_rpm": revolutions(*speed)})
            }
            DncStep::SpindleStopped => json!({"event": "spindle_stopped"}),
            DncStep::SpindleStarted { spindle, speed } => {
                json!({"event": "spindle_started", "spindle": spindle, "speed_rpm": revolutions(*speed)})
            }
            DncStep::Jogged { axis, mm, cut_short, off } => json!({
                "event": "jogged", "axis": axis.to_string(), "mm": mm, "cut_short": cut_short,
                    "off_breakpoint": off.get(),
            }),
            DncStep::ToolLength { axis, by_mm, by_counts, length_mm } => json!({
                "event": "tool_length", "axis": axis.to_string(), "by_mm": by_mm, "by_counts": by_counts,
                    "length_mm": length_mm,
            }),
            DncStep::PointerThere { stopped } => json!({"event": "pointer_there", "stopped": stopped}),
            DncStep::Parked { stopped } => json!({"event": "parked", "stopped": stopped}),
            DncStep::Online => json!({"event": "online"}),
            DncStep::Approaching => json!({"event": "approaching"}),
            DncStep::Arrived => json!({"event": "arrived"}),
        };
        if let Value::Object(fields) = &mut value {
            fields.insert("dnc_paused".into(), self.flags.paused.into());
            fields.insert("mode_changed".into(), self.flags.mode_changed.into());
            fields.insert("inhibited".into(), self.flags.inhibited.into());
        }
        value
    }
}

impl fmt::Display for DncEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.step {
            DncStep::Paused { counts, spindle: 0, .. } => write!(f, "paused at counts {:?}", counts.get()),
            DncStep::Paused { counts, spindle, speed } => {
                let (way, speed) = (direction(*spindle), revolutions(*speed));
                write!(f, "paused at counts {:?}, the spindle at {speed} rpm {way}", counts.get())
            }
            DncStep::SpindleStopped => write!(f, "the spindle is stopped"),
            DncStep::SpindleStarted { speed: 0, .. } => write!(f, "the cutter is armed; it is started with the motion"),
            DncStep::SpindleStarted { spindle, speed } => {
                write!(f, "the spindle runs again: {} rpm {}", revolutions(*speed), direction(*spindle))
            }
            DncStep::Jogged { axis, mm, cut_short, off } => {
                let short = if *cut_short { ", stopped early" } else { "" };
                write!(f, "{} moved by {mm:.3} mm{short}", axis.to_ascii_uppercase())?;
                if off.get().is_empty() { Ok(()) } else { write!(f, "; off the breakpoint by {:?} counts", off.get()) }
            }
            DncStep::ToolLength { axis, by_mm, length_mm, .. } => {
                let axis = axis.to_ascii_uppercase();
                match length_mm {
                    Some(mm) => write!(f, "tool length {mm:.3} mm: ")?,
                    None => write!(f, "new tool length: ")?,
                }
                write!(f, "the return and the path are moved by {by_mm:+.3} mm along {axis}, until the next tool")
            }
            DncStep::PointerThere { stopped: false } => {
                write!(f, "the pointer shows the place; change done brings the axes back")
            }
            DncStep::PointerThere { stopped: true } => write!(f, "stopped on the way to the place of the pointer"),
            DncStep::Parked { stopped: false } => write!(f, "parked; change done brings the axes back"),
            DncStep::Parked { stopped: true } => write!(f, "stopped on the way to the park position"),
            DncStep::Online => write!(f, "on line again; cycle start brings the axes back"),
            DncStep::Approaching => write!(f, "returning to the breakpoint"),
            DncStep::Arrived => write!(f, "at the breakpoint"),
        }
    }
}

fn revolutions(thousandths: u32) -> f64 {
    f64::from(thousandths) / 1000.0
}

fn direction(spindle: i32) -> &'static str {
    if spindle < 0 { "counterclockwise" } else { "clockwise" }
}

/// Formats why a step is rejected, and which one comes first.
///
/// # Errors
/// Those of the formatter.
pub(crate) fn explain(refused: InterruptionError, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    f.write_str(match refused {
        InterruptionError::NotPaused => "the program is not paused: pause comes first",
        InterruptionError::AlreadyPaused => "the program is paused already",
        InterruptionError::SpindleRunning => "the spindle turns: spindle stop comes first",
        InterruptionError::SpindleNotRunning => "the spindle is stopped: spindle start comes first",
        InterruptionError::SpindleWasStopped => {
            "the spindle was stopped when the program was paused, and stays stopped"
        }
        InterruptionError::WrongSpindleDirection => "the spindle turned in the other direction",
        InterruptionError::NotOnline => "on-line mode is not restored: online comes first",
        InterruptionError::AlreadyOnline => {
            "on-line mode is restored: cycle start comes next, or pause to leave it again"
        }
        InterruptionError::OtherProgram => {
            "another program is in the place of the one that was paused: put it back, or stop the job"
        }
        InterruptionError::NotApproaching => "the axes are not returning to the breakpoint: cycle start comes first",
        InterruptionError::Approaching => "the axes are returning to the breakpoint: pause stops them",
        InterruptionError::NotAtBreakpoint { axis } => return write!(f, "axis number {axis} is not at the breakpoint"),
    })
}
