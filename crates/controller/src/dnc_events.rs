//! The steps of pausing at a breakpoint and going on there, as they are told (DNC-1 … DNC-8).
//!
//! Invariant: every step is told with all three flags as they are after it.

use std::fmt;

use retrace_core::interruption::{Interruption, InterruptionError};
use serde_json::{Value, json};

use crate::machine::AXIS_LETTERS;

/// Counts of each axis of a machine, whatever card it has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AxisCounts {
    counts: [i64; AXIS_LETTERS.len()],
    axes: u8,
}

impl AxisCounts {
    /// The first of these, as many as the machine has axes.
    #[must_use]
    pub fn new(counts: &[i64], axes: usize) -> Self {
        let mut all = [0; AXIS_LETTERS.len()];
        for (slot, &count) in all.iter_mut().zip(counts) {
            *slot = count;
        }
        Self { counts: all, axes: axes.min(all.len()) as u8 }
    }

    /// In the order of the machine's axes, pulses.
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
    /// As they are.
    #[must_use]
    pub fn of<const A: usize>(order: &Interruption<A>) -> Self {
        Self { paused: order.is_paused(), mode_changed: order.mode_changed(), inhibited: order.is_inhibited() }
    }
}

/// What was done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DncStep {
    /// The program is interrupted, or interrupted again on the way back to the breakpoint; what is latched (DNC-2).
    Paused {
        /// Machine counts of the breakpoint.
        counts: AxisCounts,
        /// The spindle: 1 clockwise, −1 counterclockwise, 0 standing.
        spindle: i32,
        /// Its speed in thousandths of a revolution a minute.
        speed: u32,
    },
    /// The spindle was stopped by hand (DNC-3).
    SpindleStopped,
    /// The spindle was started by hand, in the latched direction at the latched speed (DNC-4).
    SpindleStarted {
        /// As in [`Step::Paused`].
        spindle: i32,
        /// As in [`Step::Paused`].
        speed: u32,
    },
    /// An axis was moved by hand (DNC-3).
    Jogged {
        /// Its letter.
        axis: char,
        /// How far it went, mm (degrees).
        mm: f64,
        /// It was to go farther: it came to its soft limit, or was stopped.
        cut_short: bool,
        /// How far the axes stand from the breakpoint by now, in counts: the sum of all moves by hand; of no axis where nothing is paused.
        off: AxisCounts,
    },
    /// A tool length was entered: the breakpoint, and the path behind it, are moved along the tool axis.
    ToolLength {
        /// Letter of the tool axis.
        axis: char,
        /// By how much, mm.
        by_mm: f64,
        /// The same in counts.
        by_counts: i64,
        /// The tool length offset as it is by now, mm; none where no offset is in force.
        length_mm: Option<f64>,
    },
    /// On-line mode is restored (DNC-5).
    Online,
    /// The axes begin their way to the latched counts (DNC-6).
    Approaching,
    /// The axes are there; the program is read on (DNC-7, DNC-8).
    Arrived,
}

/// A step and the flags after it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DncEvent {
    /// What was done.
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
                "event": "jogged", "axis": axis.to_string(), "mm": mm, "cut_short": cut_short, "off_breakpoint": off.get(),
            }),
            DncStep::ToolLength { axis, by_mm, by_counts, length_mm } => json!({
                "event": "tool_length", "axis": axis.to_string(), "by_mm": by_mm, "by_counts": by_counts, "length_mm": length_mm,
            }),
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
            DncStep::SpindleStarted { spindle, speed } => {
                write!(f, "the spindle turns again: {} rpm {}", revolutions(*speed), direction(*spindle))
            }
            DncStep::Jogged { axis, mm, cut_short, off } => {
                let short = if *cut_short { ", cut short" } else { "" };
                write!(f, "{} moved by {mm:.3} mm{short}", axis.to_ascii_uppercase())?;
                if off.get().is_empty() { Ok(()) } else { write!(f, "; off the breakpoint by {:?} counts", off.get()) }
            }
            DncStep::ToolLength { axis, by_mm, length_mm, .. } => {
                let axis = axis.to_ascii_uppercase();
                match length_mm {
                    Some(mm) => write!(f, "tool length {mm:.3} mm: ")?,
                    None => write!(f, "new tool length: ")?,
                }
                write!(f, "the way back and the path go {by_mm:+.3} mm along {axis}, until another tool comes")
            }
            DncStep::Online => write!(f, "on line again; cycle start brings the axes back"),
            DncStep::Approaching => write!(f, "on the way back to the breakpoint"),
            DncStep::Arrived => write!(f, "at the breakpoint: the program goes on"),
        }
    }
}

fn revolutions(thousandths: u32) -> f64 {
    f64::from(thousandths) / 1000.0
}

fn direction(spindle: i32) -> &'static str {
    if spindle < 0 { "counterclockwise" } else { "clockwise" }
}

/// Why a step is refused, and which one comes first.
///
/// # Errors
/// As the formatter's.
pub fn explain(refused: InterruptionError, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    f.write_str(match refused {
        InterruptionError::NotPaused => "the program is not paused: pause comes first",
        InterruptionError::AlreadyPaused => "the program is paused already",
        InterruptionError::SpindleRunning => "the spindle turns: spindle stop comes first",
        InterruptionError::SpindleNotRunning => "the spindle stands: spindle start comes first",
        InterruptionError::SpindleWasStopped => "the spindle stood when the program was paused, and is left standing",
        InterruptionError::WrongSpindleDirection => "the spindle turned in the other direction",
        InterruptionError::NotOnline => "on-line mode is not restored: online comes first",
        InterruptionError::AlreadyOnline => {
            "on-line mode is restored: cycle start comes next, or pause to leave it again"
        }
        InterruptionError::OtherProgram => {
            "another program is in the place of the one that was paused: put it back, or stop the job"
        }
        InterruptionError::NotApproaching => "the axes are not on the way to the breakpoint: cycle start comes first",
        InterruptionError::Approaching => "the axes are on the way to the breakpoint: pause stops them",
        InterruptionError::NotAtBreakpoint { axis } => return write!(f, "axis number {axis} is not at the breakpoint"),
    })
}
