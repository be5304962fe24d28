//! The messages between host and card.
//!
//! Invariant: every message has a fixed size; nothing in it is a float.

use retrace_core::{Place, RateTarget, Record, Travel};

use crate::{Alarm, CutterOff, PathStart, RepeatedInstruction};

/// Output channels of a card and what they carry.
pub mod channel {
    /// Channels 0 … 63 are digital outputs, value 0 or 1 (M62–M65 P number).
    pub const DIGITAL: usize = 64;
    /// Spindle: 1 clockwise (M3), −1 counterclockwise (M4), 0 stopped (M5).
    pub const SPINDLE: u8 = 64;
    /// Spindle speed in thousandths of a revolution a minute (S).
    pub const SPEED: u8 = 65;
    /// Mist coolant (M7), 0 or 1.
    pub const MIST: u8 = 66;
    /// Flood coolant (M8), 0 or 1.
    pub const FLOOD: u8 = 67;
    /// Number of the tool in the spindle (M6).
    pub const TOOL: u8 = 68;
    /// How many channels there are.
    pub const COUNT: usize = 69;
}

/// The values of all output channels.
pub type Outputs = [i32; channel::COUNT];

/// One output channel takes a value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OutputChange {
    /// The channel, below [`channel::COUNT`].
    pub channel: u8,
    /// Its new value.
    pub value: i32,
}

/// A synchronous switching action: executed in passing at the start of a record (GMC, *Two classes*; REV-14).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutputAction {
    /// The record at whose start it is executed.
    pub place: u32,
    /// The output channel.
    pub channel: u8,
    /// Its value before, which reverse run restores where actions are replayed.
    pub before: i32,
    /// Its value after.
    pub after: i32,
}

/// Most changes that one instruction can make.
pub const MAX_CHANGES: usize = 4;

/// What an instruction waits for before it is complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InputWait {
    /// Number of the input.
    pub input: u8,
    /// Is it to become active, or inactive?
    pub active: bool,
    /// After so many periods it has failed; 0: it may take for ever.
    pub timeout_periods: u32,
}

/// An exclusive switching instruction (GMC-3): executed while the motion stands.
///
/// The card keeps it until the cursor rests on its place and the rate asked for is above zero, so that a hold or a reverse run that
/// overtakes it defers it (GMC, *Two classes*).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Instruction {
    /// Its number; instructions are executed, and reported executed, in this order.
    pub number: u32,
    /// The place that it stands at: before this record.
    pub place: u32,
    /// What it switches, the first `count` of them.
    pub changes: [OutputChange; MAX_CHANGES],
    /// How many of `changes` hold.
    pub count: u8,
    /// Control periods that it takes at least: the dwell of G4, the time the spindle needs.
    pub periods: u32,
    /// What it waits for besides.
    pub until: Option<InputWait>,
    /// Standing with a cutting output on is not counted while it is executed: a pierce, a dwell, a pause at a contour's end.
    pub keeps_cutter: bool,
}

/// Brings an axis to its home switch, while the motion stands and nothing is on the window.
///
/// Fast toward the switch, to rest, slowly off it; where it opens the count is set. The path then begins anew there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HomingCommand {
    /// The axis, from 0.
    pub axis: u8,
    /// Is the switch at the upper end?
    pub upper: bool,
    /// Speed toward the switch, in pulses a period, in units of 2⁻³² pulses.
    pub search_speed: i64,
    /// Speed off it, likewise.
    pub latch_speed: i64,
    /// Change of speed a period, likewise.
    pub acceleration: i64,
    /// The farthest way to the switch, in pulses.
    pub max_travel: u32,
    /// The axis' count where the switch opens.
    pub count: i64,
}

impl Instruction {
    /// The changes that hold.
    #[must_use]
    pub fn changes(&self) -> &[OutputChange] {
        &self.changes[..usize::from(self.count).min(MAX_CHANGES)]
    }
}

/// Host to card.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HostCommand<const A: usize> {
    /// The next record ahead of the window.
    Ahead {
        /// Its place number: where the window ends now.
        place: u32,
        /// The record.
        record: Record<A>,
    },
    /// The next record behind the window.
    Behind {
        /// Its place number: one before where the window begins now.
        place: u32,
        /// The record.
        record: Record<A>,
        /// Is the path at rest before it?
        rests: bool,
    },
    /// Forget the records from this place on; only what the cursor cannot come to any more.
    Trim {
        /// The new end of the window.
        high: u32,
    },
    /// Forget the records before this place; only what lies behind the cursor. History ends here.
    Forget {
        /// The new beginning of the window.
        low: u32,
    },
    /// An output action on the window's way. It must be there before its record is.
    Action(OutputAction),
    /// The rates the cursor is to run at, along feed motion and along rapid motion: a real-time word.
    Rate(RateTarget),
    /// Whether retracing replays the output actions it passes (REV-14).
    Replay {
        /// Replay them.
        on: bool,
    },
    /// An exclusive instruction.
    Instruction(Instruction),
    /// Switch an output by hand, at once.
    ManualOutput(OutputChange),
    /// Clears what is latched, if its cause is gone.
    ClearAlarm,
    /// Bring an axis to its home switch.
    Home(HomingCommand),
    /// Blocks motion: the rate asked for counts as 0 and no instruction begins, until the repeated instruction of this number is complete.
    /// Where it is complete already, the block is released at once.
    Restart {
        /// Number of the last repeated instruction of the restart.
        last: u32,
    },
    /// Executes switching again that was complete before. Only at rest, and not while an alarm is latched.
    Repeat(RepeatedInstruction),
}

impl<const A: usize> HostCommand<A> {
    /// The rate that the cursor is to run at along all motion, in records a period: +1 as recorded, 0 standing, −1 backward; as [`Travel`].
    #[must_use]
    pub const fn rate(target: Travel) -> Self {
        Self::Rate(RateTarget::both(target))
    }
}

/// Why a card did not take a word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommandRefusal {
    /// No room now: again after some periods.
    Full,
    /// The place number is not the next one at that end of the window.
    OutOfOrder,
    /// The motion does not stand, or the cursor could not stop any more.
    InMotion,
    /// Another instruction is still being executed, or the number is not the next.
    Busy,
    /// The card has no such channel.
    NoSuchChannel,
    /// An alarm is latched, or its cause is still there.
    Alarm,
    /// The settings or the order are not such that this card can work by them.
    Unfit,
}

/// Card to host: what the last control period did, and where everything stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CardStatus<const A: usize> {
    /// Control periods since the card was started; this one's number.
    pub period: u64,
    /// Where the cursor stands.
    pub place: Place,
    /// The furthest place ever executed, as a record boundary.
    pub reached: u32,
    /// First record held.
    pub low: u32,
    /// Place behind the last record held.
    pub high: u32,
    /// Distance that the cursor moved in the period: the rate that was run.
    pub rate: Travel,
    /// Does the cursor stand, with nothing left to run?
    pub at_rest: bool,
    /// Was the rate held down by the end of the window, which was no planned stop?
    pub starved: bool,
    /// Line of the record that the cursor was in.
    pub line: u32,
    /// Net pulses of each axis in the period.
    pub increments: [i32; A],
    /// Net pulses of each axis since the card was started: counted at the pulse output.
    pub counts: [i64; A],
    /// Number of the last exclusive instruction that is complete; where an epoch begins, as its start says.
    pub executed: u32,
    /// The outputs as they are.
    pub outputs: Outputs,
    /// Which inputs are active, one bit each.
    pub inputs: u16,
    /// Counts that a handwheel on the card turned by in the period.
    pub wheel: i16,
    /// What is latched.
    pub alarm: Option<Alarm>,
    /// Motion is blocked until [`Word::Restart`] releases it: a restart is under way, or the grace ran out with a cutting output on.
    pub blocked: bool,
    /// Number of the last repeated instruction that is complete; 0 where an epoch begins.
    pub repeated: u32,
    /// Cutting outputs that the card switched off in the period.
    pub cutter_off: Option<CutterOff>,
}

impl<const A: usize> CardStatus<A> {
    /// A card at rest where an epoch begins, all counts and outputs zero.
    #[must_use]
    pub const fn at_rest(start: PathStart) -> Self {
        let record = start.place.record;
        Self {
            period: 0,
            place: start.place,
            reached: start.reached,
            low: record,
            high: record,
            rate: 0,
            at_rest: true,
            starved: false,
            line: 0,
            increments: [0; A],
            counts: [0; A],
            executed: start.executed,
            outputs: [0; channel::COUNT],
            inputs: 0,
            wheel: 0,
            alarm: None,
            blocked: false,
            repeated: 0,
            cutter_off: None,
        }
    }
}
