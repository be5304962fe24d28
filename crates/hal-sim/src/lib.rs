//! The simulated machine: the card crate itself, with clocks, serial channels, pins and switches around it.
//!
//! ```text
//!  host ─ InProcess ─┬─ SerialChannel ─> SimLinkedCard ─> Pins, counters ─> Plant
//!                    └─ SerialChannel <─      (card)    <──── inputs ────────┘
//! ```
//!
//! [`SimCard`] is the card with a plant on its pins and without a serial line, for programs that run in this process.
//! [`CardSimulator`] is a card on a serial line that may fail, with a plant on its pins. [`InProcess`] makes a port of
//! it in virtual time; in wall time a pseudo-terminal can be connected to it.
//!
//! Invariant: the reported counts are counted pulse by pulse behind the fine interpolation, not copied from the player.
#![forbid(unsafe_code)]

mod arc_voltage;
mod card_simulator;
mod clock;
mod count_checker;
mod cut_sheet;
mod cutting_source;
mod fault_spec;
mod faults;
mod in_process;
mod linked_card;
mod pins;
mod plant;
mod probed_work;
mod pulses;
mod random;
mod serial_channel;
mod sim_card;
mod spindle_plant;
mod step_wire;
mod trace;
mod vcd;

pub use arc_voltage::{ArcVoltageSettings, WarpedSheet};
pub use card_simulator::{CardSimulator, CardSimulatorSettings, PeriodObserver, PeriodSample, SimulationFaults};
pub use clock::Clock;
pub use cutting_source::{SourceFaults, SourceSettings, source_faults};
pub use fault_spec::faults;
pub use faults::{FaultRates, LineCounters, LineFault};
pub use in_process::{InProcess, NoFault};
pub use linked_card::{SimLinkedCard, TICK_HZ, WINDOW, identity, max_pulses_a_period};
pub use pins::{PinEdge, Pins};
pub use plant::{InputEvent, Plant, PlantSettings, Process, Reply, Switch, wiring};
pub use probed_work::{Cylinder, ProbedBody, ProbedWork};
pub use pulses::PulseCounters;
pub use random::{Chance, Random};
pub use serial_channel::{InFlightPolicy, SerialChannel, SerialChannelSettings};
pub use sim_card::{SimCard, SimCardError};
pub use spindle_plant::{SpindlePlant, SpindleSimulation};
pub use step_wire::StepWire;
pub use trace::Trace;
pub use vcd::{Signal, Vcd};
