//! What the motion path tells everybody who looks on: one stream for screen, JSON, journal and report.
//!
//! Invariant: a period is of a fixed size and holds nothing that is allocated; periods, outputs and events come in the order in which
//! they happened.

use retrace_core::mode::Mode;
use retrace_core::{Place, Travel};
use retrace_link::{Change, Status};

use crate::event::Event;

/// Why the machine stands in normal run, if it does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Standing {
    /// For no reason of the operator's: it runs, or waits for records or for an instruction.
    #[default]
    None,
    /// Feed hold.
    Hold,
    /// A program stop (M0) waits for cycle start.
    ProgramStop,
    /// Single block waits for cycle start.
    SingleBlock,
    /// The program is paused at a breakpoint (DNC-1).
    Paused,
}

/// What one control period did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Period<const A: usize> {
    /// Its number, from the start of the card.
    pub period: u64,
    /// Where the cursor stands.
    pub place: Place,
    /// The furthest place ever executed, as a record boundary.
    pub reached: u32,
    /// The oldest place that can be gone back to.
    pub oldest: u32,
    /// Place behind the last record that is planned.
    pub planned: u32,
    /// The window of the card: the first record held, and the place behind the last.
    pub window: [u32; 2],
    /// Distance that the cursor moved: the rate that was run.
    pub rate: Travel,
    /// Line of the record that the cursor was in.
    pub line: u32,
    /// Net pulses of each axis in the period.
    pub increments: [i32; A],
    /// Counts of each axis.
    pub counts: [i64; A],
    /// Number of the last exclusive instruction that is complete.
    pub executed: u32,
    /// Does the cursor stand?
    pub at_rest: bool,
    /// Was the rate held down for want of records?
    pub short: bool,
    /// Which inputs are active, one bit each.
    pub inputs: u16,
    /// The mode of operation.
    pub mode: Mode,
    /// Why it stands.
    pub standing: Standing,
    /// The feed override that the operator asks for.
    pub override_rate: Travel,
    /// Is the machine off the path: jogging, homing, on the way to a breakpoint? The places are then those of that move.
    pub off_path: bool,
}

impl<const A: usize> Period<A> {
    /// From the card's report; what the card does not know is as at the beginning of a job.
    #[must_use]
    pub fn of(status: &Status<A>) -> Self {
        Self {
            period: status.period,
            place: status.place,
            reached: status.reached,
            oldest: status.low,
            planned: status.high,
            window: [status.low, status.high],
            rate: status.rate,
            line: status.line,
            increments: status.increments,
            counts: status.counts,
            executed: status.executed,
            at_rest: status.at_rest,
            short: status.short,
            inputs: status.inputs,
            mode: Mode::Run,
            standing: Standing::None,
            override_rate: retrace_core::ONE,
            off_path: false,
        }
    }
}

/// One thing that is told.
#[derive(Clone, Debug, PartialEq)]
pub enum Told<const A: usize> {
    /// A control period has passed.
    Period(Period<A>),
    /// An output has taken a value, by the program or by hand. At the start every output that is not 0 is told.
    Output(Change),
    /// Something happened.
    Event(Event),
}
