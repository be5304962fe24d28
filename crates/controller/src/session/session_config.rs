//! What does not change during a session: its timing and attendance, and what it needs of the machine file.
//!
//! Invariant: nothing in here changes after the session was created.

use retrace_config::{CutterConfig, CutterKind, IN_FLIGHT_RECORDS, MachineConfig, RetraceOutputs, SingleBlockStep};

/// Timing and attendance of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RunMode {
    /// Whether the run is in wall time. In virtual time the motion path waits for the planner instead.
    pub wall_time: bool,
    /// Whether an operator is there to press cycle start at a program stop. Without one, the stop is passed.
    pub operator: bool,
    /// Whether the motion thread is scheduled under SCHED_FIFO, where that is permitted.
    pub real_time: bool,
}

/// Constants of a session.
pub(super) struct SessionConfig<const A: usize> {
    pub(super) run_mode: RunMode,
    pub(super) period_s: f64,
    pub(super) look_ahead_records: u32,
    /// Periods to wait at rest for records, in wall time.
    pub(super) max_wait_periods: u64,
    /// The fire channels of torches, jets and beams.
    pub(super) fire_channels: Vec<u8>,
    /// Length of a test pulse, in control periods, of each of these channels.
    pub(super) pulse_periods: Vec<u32>,
    /// Inputs that show that the tool has touched something, one bit each.
    pub(super) collision_inputs: u16,
    /// The channels of the cutters, in the order of the card's settings.
    pub(super) cutter_channels: Vec<u8>,
    /// Channels that the end of a job switches off.
    pub(super) off_at_end: Vec<u8>,
    /// Whether this is a dry run.
    pub(super) inhibits_outputs: bool,
    /// Why no contour can be skipped, if so: the program switches something within it that needs the cutter.
    pub(super) skip_refusal: Option<&'static str>,
    /// Whether a jet may cut while the path is retraced.
    pub(super) retrace_cuts: bool,
    /// Whether outputs are switched again where the path is retraced.
    pub(super) replays_outputs: bool,
    pub(super) mm_per_pulse: [f64; A],
}

impl<const A: usize> SessionConfig<A> {
    pub(super) fn new(machine: &MachineConfig, run_mode: RunMode) -> Self {
        let mut mm_per_pulse = [0.0; A];
        for (slot, axis) in mm_per_pulse.iter_mut().zip(&machine.axes) {
            *slot = axis.pulses_per_mm.recip();
        }
        Self {
            run_mode,
            period_s: machine.period_s(),
            look_ahead_records: machine.stopping.look_ahead_records + IN_FLIGHT_RECORDS,
            max_wait_periods: u64::from(machine.look_ahead_records),
            fire_channels: machine.cutting_outputs.clone(),
            pulse_periods: machine.cutting_outputs.iter().map(|&fire| machine.test_pulse_periods(fire)).collect(),
            collision_inputs: machine.cutters.iter().flat_map(|cutter| &cutter.collision).fold(0, |m, &n| m | 1 << n),
            cutter_channels: machine.cutting_channels(),
            off_at_end: machine.off_at_end(),
            inhibits_outputs: machine.inhibits_outputs,
            skip_refusal: skip_refusal(machine),
            retrace_cuts: machine.cutters.iter().any(|cutter| cutter.retrace_cut),
            replays_outputs: machine.retrace_outputs == RetraceOutputs::Replayed,
            mm_per_pulse,
        }
    }
}

fn skip_refusal(machine: &MachineConfig) -> Option<&'static str> {
    if machine.cutters.iter().any(|cutter| cutter.kind == CutterKind::Beam) {
        return Some("a beam is switched within its contour too, and would be lit there");
    }
    let has_abrasive = machine.cutters.iter().any(|cutter| cutter.abrasive.is_some());
    has_abrasive.then_some("the program may switch the abrasive within the contour, which would flow without water")
}

/// The fire channels whose contours are one step of single block. In a dry run nothing is lit, and no stop costs a
/// pierce.
pub(super) fn contour_channels(machine: &MachineConfig) -> Vec<u8> {
    let in_one_step = |cutter: &&CutterConfig| {
        cutter.kind.cuts_at_rest() && cutter.single_block == SingleBlockStep::Contour && !machine.inhibits_outputs
    };
    machine.cutters.iter().filter(in_one_step).map(|cutter| cutter.fire).collect()
}
