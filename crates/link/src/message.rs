//! The messages between host and card.
//!
//! Invariant: every message has a fixed size; none contains a float.

use retrace_core::{Place, Rate, RateTarget, Record, RecordIndex};

use crate::outputs::{ANALOG_INPUTS, AnalogInputs, InputWait, MAX_CHANGES, OutputChange, Outputs, channel};
use crate::{
    Alarm, ArmedStretch, CutterOff, GearState, HEIGHT_CONTROLS, HeightState, LayerMove, PathStart, ProbeArming,
    ProbeEdge, ProbeLatch, RepeatedInstruction, SpeedCurve, SpindleStatus, SpindleTask,
};

/// Synchronous switching action: executed without a stop at the start of a record (GMC, *Two classes*; REV-14).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct OutputAction {
    /// Record at whose start it is executed.
    pub place: RecordIndex,
    /// The output channel.
    pub channel: u8,
    /// Value before the action, which reverse run restores if actions are replayed.
    pub before: i32,
    /// Value after the action.
    pub after: i32,
}

/// Exclusive switching instruction (GMC-3): executed while the motion is at rest.
///
/// The card stores it until the cursor is at rest on its place and the requested rate is above zero, so that a hold or
/// a reverse run before that defers it (GMC, *Two classes*).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Instruction {
    /// Number; instructions are executed, and reported as executed, in this order.
    pub number: u32,
    /// Place of the instruction: before this record.
    pub place: RecordIndex,
    /// Output changes; the first `count` are valid.
    pub changes: [OutputChange; MAX_CHANGES],
    /// Number of valid `changes`.
    pub count: u8,
    /// Minimum duration in control periods: the dwell of G4, the time the spindle needs.
    pub periods: u32,
    /// Input that is awaited in addition.
    pub until: Option<InputWait>,
    /// Whether time at rest with a cutting output on is not counted during the instruction: a pierce, a dwell, a pause
    /// at a contour's end.
    pub keeps_cutter: bool,
    /// Moves of the layer before and behind the switching.
    pub layer: Option<LayerMove>,
    /// What it waits for at the spindle in addition.
    pub spindle: Option<SpindleTask>,
}

/// Moves an axis to its home switch, while the machine is at rest and the window is empty.
///
/// The axis moves fast toward the switch, comes to rest, and moves slowly off it; the count is set where the switch
/// opens. A new path then begins there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct HomingCommand {
    /// The axis, from 0.
    pub axis: u8,
    /// Whether the switch is at the upper end.
    pub upper: bool,
    /// Speed toward the switch, in units of 2⁻³² pulses per period.
    pub search_speed: i64,
    /// Speed off the switch, in the same unit.
    pub latch_speed: i64,
    /// Change of speed per period, in units of 2⁻³² pulses per period².
    pub acceleration: i64,
    /// Maximum distance to the switch, in pulses.
    pub max_travel: u32,
    /// Count of the axis where the switch opens.
    pub count: i64,
}

impl Instruction {
    /// Returns the valid changes.
    #[must_use]
    pub fn changes(&self) -> &[OutputChange] {
        &self.changes[..usize::from(self.count).min(MAX_CHANGES)]
    }
}

/// Command from host to card.
///
/// # Examples
///
/// ```
/// use retrace_core::{Rate, Record, RecordIndex};
/// use retrace_link::HostCommand;
///
/// let record = Record { increments: [12, -3], ..Record::default() };
/// let ahead = HostCommand::Ahead { place: RecordIndex::new(0), record };
/// let reverse = HostCommand::<2>::rate(-Rate::ONE / 2);
/// assert_ne!(ahead, reverse);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum HostCommand<const A: usize> {
    /// Adds the next record ahead of the window.
    Ahead {
        /// Record number: where the window ends now.
        place: RecordIndex,
        /// The record.
        record: Record<A>,
    },
    /// Adds the next record behind the window.
    Behind {
        /// Record number: one before where the window begins now.
        place: RecordIndex,
        /// The record.
        record: Record<A>,
        /// Whether the path is at rest before it.
        rests: bool,
    },
    /// Drops the records from this place on; only records that the cursor cannot reach any more.
    Trim {
        /// New end of the window.
        high: RecordIndex,
    },
    /// Drops the records before this place; only records behind the cursor. History ends here.
    Forget {
        /// New beginning of the window.
        low: RecordIndex,
    },
    /// Adds an output action on the path of the window. It must arrive before its record.
    Action(OutputAction),
    /// Sets the target rates of the cursor, along feed motion and along rapid motion: a real-time command.
    Rate(RateTarget),
    /// Sets whether retracing replays the output actions it passes (REV-14).
    Replay {
        /// Whether to replay them.
        on: bool,
    },
    /// Adds an exclusive instruction.
    Instruction(Instruction),
    /// Switches an output manually, at once.
    ManualOutput(OutputChange),
    /// Clears the latched alarm, if its cause is gone.
    ClearAlarm,
    /// Homes an axis.
    Home(HomingCommand),
    /// Blocks motion: the requested rate counts as 0 and no instruction begins until the repeated instruction of this
    /// number is complete. If it is already complete, the block is released at once.
    Restart {
        /// Number of the last repeated instruction of the restart.
        last: u32,
    },
    /// Executes completed switching again. Only at rest, and not while an alarm is latched.
    Repeat(RepeatedInstruction),
    /// Arms the latch of the probe. Only at rest, and once in an epoch.
    ArmProbe(ProbeArming),
    /// Sets whether motion follows a spindle that was switched off in a geared stretch, and is turned by hand (SPN-23).
    /// Only at rest, and near the angle at which it came to rest. It ends where the stretch does.
    FollowSpindle {
        /// Whether to follow it.
        on: bool,
    },
    /// Takes the gear off a stretch in which a rate acts on the spindle: the operator says that the tool is free
    /// (SPN-22). Only at rest, in the stretch or at its end, with the spindle switched off and at rest.
    FreeTool,
    /// Arms a stretch again that an instruction has armed before: one that the path comes back to (SPN-22). Only where
    /// none is engaged, in front of it, or at rest at its end. It replaces the one that is armed.
    ArmStretch(ArmedStretch),
    /// Sets the curve of the output for S (SPN-5). The card keeps it until it is switched off.
    SpeedCurve(SpeedCurve),
}

impl<const A: usize> HostCommand<A> {
    /// Returns a command for the same rate along all motion, in records per period: +1 as recorded, 0 at rest, −1
    /// backward.
    #[must_use]
    pub const fn rate(target: Rate) -> Self {
        Self::Rate(RateTarget::both(target))
    }
}

/// Reason why a card rejected a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CommandRefusal {
    /// No space now: retry after some periods.
    Full,
    /// The record number is not the next one at that end of the window.
    OutOfOrder,
    /// The machine is in motion, or the cursor could not stop in time.
    InMotion,
    /// Another instruction is still being executed, or the number is not the next one.
    Busy,
    /// The card has no such channel.
    NoSuchChannel,
    /// An alarm is latched, or its cause is still present.
    Alarm,
    /// The settings or the command are not supported by this card.
    Unsupported,
}

impl core::fmt::Display for CommandRefusal {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Full => "the card has no space for the command now",
            Self::OutOfOrder => "the record number is not the next one of the window",
            Self::InMotion => "the machine is in motion",
            Self::Busy => "the card still executes another instruction",
            Self::NoSuchChannel => "the card has no such output channel",
            Self::Alarm => "an alarm is latched",
            Self::Unsupported => "the card does not support the settings or the command",
        })
    }
}

impl core::error::Error for CommandRefusal {}

/// Status from card to host: the effect of the last control period, and the current state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct CardStatus<const A: usize> {
    /// Control periods since the card was started: the number of this one.
    pub period: u64,
    /// Place of the cursor.
    pub place: Place,
    /// Furthest place ever executed, as a record boundary.
    pub reached: RecordIndex,
    /// First record held.
    pub low: RecordIndex,
    /// Place after the last record held.
    pub high: RecordIndex,
    /// Distance that the cursor moved in the period: the actual rate.
    pub rate: Rate,
    /// Whether the cursor is at rest, with no distance remaining.
    pub at_rest: bool,
    /// Whether the rate was limited by the end of the window, which was not a planned stop.
    pub starved: bool,
    /// Program line of the record in which the cursor was.
    pub line: u32,
    /// Net pulses of each axis in the period.
    pub increments: [i32; A],
    /// Net pulses of each axis since the card was started, counted at the pulse output, without the layer.
    pub counts: [i64; A],
    /// Layer of the tool axis in pulses, added to the counts of its axis. Over the line, it is reported where it rests,
    /// and where the height is controlled once in an interval of the reports.
    pub layer: i32,
    /// State of the control of the height, if the card has one; see [`CardStatus::height_state`].
    pub height: [HeightState; HEIGHT_CONTROLS],
    /// Number of the last completed exclusive instruction; when an epoch begins, the number in its start.
    pub executed: u32,
    /// Current output values.
    pub outputs: Outputs,
    /// Power of a beam in the period, in the unit of [`channel::SPEED`] (CUT-20). Not reported over the line.
    pub beam_power: i32,
    /// Active inputs, one bit each.
    pub inputs: u16,
    /// Readings of the analog inputs. Over the line, one that has changed is reported once in an interval of the
    /// reports.
    pub analog_inputs: AnalogInputs,
    /// Counts by which a handwheel on the card turned in the period.
    pub wheel: i16,
    /// Latched alarm.
    pub alarm: Option<Alarm>,
    /// Whether motion is blocked until [`HostCommand::Restart`] releases it: a restart is in progress, or the grace
    /// time ended with a cutting output on.
    pub blocked: bool,
    /// Number of the last completed repeated instruction; 0 when an epoch begins.
    pub repeated: u32,
    /// Cutting outputs that the card switched off in the period.
    pub cutter_off: Option<CutterOff>,
    /// Latch of the probe.
    pub probe: ProbeLatch<A>,
    /// The probe's edge that the latch has kept since this period, as seen from the end of the period before. Not in
    /// the status of the host.
    pub probe_edge: Option<ProbeEdge>,
    /// Measured state of the spindle. Over the line, the speed is reported where it changes.
    pub spindle: SpindleStatus,
}

impl<const A: usize> CardStatus<A> {
    /// Returns the state of the control of the height.
    #[must_use]
    pub const fn height_state(&self) -> HeightState {
        if let [state, ..] = self.height.as_slice() { *state } else { HeightState::Off }
    }

    /// Returns the status of a card at rest at the start of an epoch, with all counts and outputs zero.
    #[must_use]
    pub const fn at_rest(start: PathStart) -> Self {
        let record = start.place.record;
        Self {
            period: 0,
            place: start.place,
            reached: start.reached,
            low: record,
            high: record,
            rate: Rate::ZERO,
            at_rest: true,
            starved: false,
            line: 0,
            increments: [0; A],
            counts: [0; A],
            layer: 0,
            height: [HeightState::Off; HEIGHT_CONTROLS],
            executed: start.executed,
            outputs: [0; channel::COUNT],
            beam_power: 0,
            inputs: 0,
            analog_inputs: [None; ANALOG_INPUTS],
            wheel: 0,
            alarm: None,
            blocked: false,
            repeated: 0,
            cutter_off: None,
            probe: ProbeLatch::Idle,
            probe_edge: None,
            spindle: SpindleStatus { speed: None, gear: GearState::Off, largest_lag: 0, armed_again: 0 },
        }
    }
}
