//! Rigid taps: what both threads plan of one (SPN-19).
//!
//! A tap is a geared stretch that the card executes off the job's path: in, until it reverses the spindle, and back
//! along the same records to where it began. So nothing of it is part of the path, and the machine stands where it was.
//!
//! Invariant: the records depend on the move, the machine and the commanded speed alone.

use retrace_config::{EncoderConfig, MachineConfig};
use retrace_link::GearStart;
use retrace_motion::PathMode;

use crate::thread_plan::{ThreadError, ThreadPiece, ThreadPlan, ThreadPlanner, ThreadStretch};

/// Turns behind the depth for which a tap has records: for what the spindle turns while it is reversed.
const SPARE_TURNS: f64 = 10.0;
/// Most records of a tap: the card goes back along all of them.
pub(crate) const MAX_TAP_RECORDS: u32 = 1 << 16;

/// A rigid tap, in counts of the job's path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TapMove {
    /// Counts of the axes where it begins, and ends; 0 for missing axes.
    pub from: [i64; 9],
    /// Counts at its depth.
    pub to: [i64; 9],
    /// Distance in a turn of the spindle, nm.
    pub pitch_nm: u64,
    /// Commanded speed on the way in, thousandths of a turn per minute.
    pub speed: u32,
    /// Speed on the way back, in the same unit.
    pub return_speed: u32,
}

/// A rigid tap in the program, in mm of the machine's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidTap<const A: usize> {
    /// Where it begins and ends.
    pub from_mm: [f64; A],
    /// Its depth.
    pub depth_mm: [f64; A],
    /// Distance in a turn of the spindle, mm.
    pub pitch_mm: f64,
    /// Commanded speed on the way in, turns per minute.
    pub rpm: f64,
    /// Speed on the way back, turns per minute.
    pub return_rpm: f64,
    /// Line of the program.
    pub line: u32,
}

impl<const A: usize> RigidTap<A> {
    /// The tap in whole counts and numbers. `None` where it has no depth.
    pub(crate) fn counted(&self, machine: &MachineConfig, from: [i64; 9]) -> Option<TapMove> {
        let mut to = from;
        for (index, axis) in machine.axes.iter().enumerate().take(A) {
            if self.depth_mm[index] != self.from_mm[index] {
                to[index] = axis.pulses_of(self.depth_mm[index]);
            }
        }
        let whole = |of: f64, scale: f64| (of * scale).round().max(0.0);
        let pitch_nm = whole(self.pitch_mm, 1e6) as u64;
        let [speed, return_speed] = [self.rpm, self.return_rpm].map(|rpm| whole(rpm, 1e3) as u32);
        (to != from).then_some(TapMove { from, to, pitch_nm, speed, return_speed })
    }

    /// Plans it from where it begins, as a run does, and returns its run-in, mm.
    ///
    /// # Errors
    /// The reason why the machine cannot tap there.
    pub(crate) fn run_in_mm(&self, machine: &MachineConfig, encoder: &EncoderConfig) -> Result<f64, ThreadError> {
        let mut from = [0; 9];
        for (index, axis) in machine.axes.iter().enumerate().take(A) {
            from[index] = axis.pulses_of(self.from_mm[index]);
        }
        let tap = self.counted(machine, from).ok_or(ThreadError::TooShort { needs_mm: self.pitch_mm })?;
        let [run_in, _] = if machine.axes.len() <= 4 {
            tap.plan::<4>(machine, encoder)?.run_mm
        } else {
            tap.plan::<9>(machine, encoder)?.run_mm
        };
        Ok(run_in)
    }
}

/// A tap with what the card receives of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TapQuestion {
    /// The tap.
    pub tap: TapMove,
    /// What the card receives.
    pub gear: GearStart,
}

impl TapMove {
    /// Plans the stretch: to the depth, and behind it for what the spindle turns further, within the soft limits.
    ///
    /// # Errors
    /// The reason why the machine cannot tap there.
    pub(crate) fn plan<const A: usize>(
        &self,
        machine: &MachineConfig,
        encoder: &EncoderConfig,
    ) -> Result<ThreadPlan<A>, ThreadError> {
        if !encoder.is_reversible {
            return Err(ThreadError::NotReversible);
        }
        let mm = |counts: &[i64; 9]| machine.clone().standing_at(&counts[..A.min(9)]).start_mm::<A>();
        let (from, to) = (mm(&self.from), mm(&self.to));
        let depth_mm = from.iter().zip(&to).map(|(from, to)| (to - from).powi(2)).sum::<f64>().sqrt();
        let (pitch_mm, rpm) = (self.pitch_nm as f64 * 1e-6, f64::from(self.speed) / 1000.0);
        let return_rpm = f64::from(self.return_speed) / 1000.0;
        let return_factor = return_rpm / rpm.max(f64::MIN_POSITIVE);
        let max_rpm = f64::from(encoder.settings.highest_speed) / 1000.0;
        if return_rpm > max_rpm.max(rpm) {
            return Err(ThreadError::TooFast { highest_rpm: max_rpm / return_factor });
        }
        // Behind the depth, in parts of it.
        let mut spare = SPARE_TURNS * pitch_mm / depth_mm.max(f64::MIN_POSITIVE);
        for (axis, (from, to)) in machine.axes.iter().zip(from.iter().zip(&to)) {
            let way = to - from;
            if way != 0.0 {
                let [low, high] = axis.travel_mm;
                let limit = if way > 0.0 { high } else { low };
                spare = spare.min(((limit - to) / way).max(0.0));
            }
        }
        let mut end_mm = to;
        end_mm.iter_mut().zip(&from).for_each(|(end, from)| *end += spare * (*end - from));
        let pieces = vec![ThreadPiece { end_mm, pitch_mm, mode: PathMode::ExactStop, line: 0 }];
        // Both ways are along the same records, so that these are planned for the faster one.
        let stretch = ThreadStretch { pieces, rpm: rpm.max(return_rpm), start_degrees: 0.0 };
        let plan = ThreadPlanner::default().plan(&stretch, machine, encoder, from).map_err(|error| match error {
            ThreadError::TooFast { highest_rpm } => {
                ThreadError::TooFast { highest_rpm: highest_rpm / return_factor.max(1.0) }
            }
            error => error,
        })?;
        if plan.gear.length > MAX_TAP_RECORDS {
            return Err(ThreadError::TooLong { turns: depth_mm / pitch_mm });
        }
        let share = f64::from(self.speed) / f64::from(encoder.settings.highest_speed);
        let early_mm = encoder.reversal_turns * share.powi(2) * pitch_mm;
        plan.turning_at(depth_mm - early_mm, return_factor)
    }
}
