//! The simulated machine: the card crate itself, with clocks, lines, pins and switches around it.
//!
//! [`SimCard`] is the card with a machine on its pins and without a line, for programs that run in this process. [`Rig`] is a card on a line that may fail, with a
//! machine on its pins; [`InProcess`] makes a port of it in virtual time, and a pseudo-terminal can be put before it in wall time.
//!
//! Invariant: the counts it reports are counted pulse by pulse behind the fine interpolation, not copied from the player.
#![forbid(unsafe_code)]

mod clock;
mod compared;
mod faults;
mod in_process;
mod line;
mod machine;
mod on_line;
mod pins;
mod pulses;
mod random;
mod rig;
mod sim;
mod spec;
mod trace;
mod vcd;

pub use clock::Clock;
pub use faults::{Fault, Rates, Tally};
pub use in_process::{InProcess, NoFault};
pub use line::{Leftover, Line, LineSettings};
pub use machine::{Event, Machine, MachineSettings, Process, Reply, Switch, wiring};
pub use on_line::{SimOnLine, TICK_HZ, identity, max_pulses_a_period};
pub use pins::{PinEdge, Pins};
pub use pulses::PulseCounters;
pub use random::{Chance, Random};
pub use rig::{Faults, Moment, Rig, RigSettings, Watcher};
pub use sim::{SimCard, SimFault, WINDOW};
pub use spec::faults;
pub use trace::Trace;
pub use vcd::{Signal, Vcd};
