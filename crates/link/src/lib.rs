//! The messages between host and card (GMC-2), and the trait [`MotionCard`] that every card implements.
//!
//! A card in the same process receives the messages as they are. A card on a serial line receives them as bytes
//! ([`wire`]) in frames with a checksum ([`frame`]), between two endpoints that retransmit what was lost
//! ([`HostEndpoint`], [`CardEndpoint`]).
//!
//! ```text
//!  controller                                                            card
//!  MotionCard ── LinkedCard ── HostEndpoint ══ BytePort ══ CardEndpoint ── CardCore
//!             HostCommand ──►               frames                ──► accept
//!             CardStatus  ◄──               frames                ◄── status
//! ```
//!
//! Invariant: the wire carries records in path order, each with its record number, never negated and never scaled. The
//! rate is a real-time command of its own.
#![no_std]
#![forbid(unsafe_code)]

mod alarm;
mod card_endpoint;
mod card_failure;
pub mod crc;
mod cutting;
pub mod frame;
mod frame_size;
mod height_control;
mod host;
mod layer;
mod message;
mod outputs;
mod pending_commands;
mod ports;
#[doc(hidden)]
pub mod predicted_window;
mod probe;
#[doc(hidden)]
pub mod sequence;
mod serial_card;
#[doc(hidden)]
pub mod session;
mod settings;
mod spindle;
pub mod wire;

pub use alarm::Alarm;
pub use card_endpoint::{CardEndpoint, EntryStorage};
pub use card_failure::CardFailure;
pub use cutting::{
    BeamPower, CutterOff, CutterOffCause, CuttingChannel, CuttingSettings, LINEAR_POWER, MAX_CUTTING_CHANNELS,
    MAX_POWER_EXPONENT, MAX_PROOFS, MAX_PULSE_US, ProofInput, RepeatedInstruction,
};
pub use height_control::{
    HEIGHT_CONTROLS, HeightControlSettings, HeightControls, HeightSource, HeightState, MAX_LAYER, RESUME_SHARE,
};
pub use host::{HostEndpoint, LineCounts, LinkError};
pub use layer::{LayerMove, LayerSettings, OhmicSensing, SheetSource};
pub use message::{CardStatus, CommandRefusal, HomingCommand, HostCommand, Instruction, OutputAction};
pub use outputs::{ANALOG_INPUTS, AnalogInputs, Ignition, InputWait, MAX_CHANGES, OutputChange, Outputs, channel};
pub use ports::{BytePort, CardCore, state_crc};
pub use probe::{ProbeArming, ProbeEdge, ProbeLatch, counts_at_edge};
pub use serial_card::{LinkTimeouts, LinkedCard, LinkedCardError};
pub use session::{next_epoch, session_key};
pub use settings::{
    AnalogCounts, CardIdentity, CardSettings, InputSetting, InputUse, MAX_CURVE_POINTS, MAX_INPUTS, MAX_SAFE, PROTOCOL,
    PWM_HZ, PathStart, SpeedCurve, SpeedPoint, SpindlePwm,
};
pub use spindle::{ArmedStretch, GearStart, GearState, SpindleControl, SpindleSettings, SpindleStatus, SpindleTask};
pub use wire::Greeting;

/// Interface of the controller to a card, simulated or real.
pub trait MotionCard<const A: usize> {
    /// Error that ends the run on the card.
    type Fault: CardFailure;

    /// Returns the number of records that the card can hold.
    fn window(&self) -> u32;

    /// Sends one command.
    ///
    /// # Errors
    /// Returns the reason why the card rejected it; nothing has changed then.
    fn send(&mut self, command: HostCommand<A>) -> Result<(), CommandRefusal>;

    /// Runs one control period and returns its status. A card in virtual time computes it, a card in wall time waits
    /// for it.
    ///
    /// # Errors
    /// An error is final: the card is at rest, and no command of this run will move it again. Only an alarm can be
    /// cleared: after [`HostCommand::ClearAlarm`] periods continue until it is known that the alarm remains.
    fn run_period(&mut self) -> Result<&CardStatus<A>, Self::Fault>;

    /// Begins a new path at the current position: an epoch. The card drops the records of the old path; counts, outputs
    /// and a latched alarm remain. The machine must be at rest.
    ///
    /// A pending instruction is cancelled. If the card completes one before the message of the epoch arrives, its
    /// number also counts as executed: the status has the number of the last one.
    ///
    /// # Errors
    /// An error is final, as in [`MotionCard::run_period`].
    fn begin_path(&mut self, start: PathStart) -> Result<(), Self::Fault>;

    /// Returns the status of the last period.
    fn status(&self) -> &CardStatus<A>;

    /// Returns the place after the last record that the card is known to hold. For a card on a serial line, the window
    /// in the status is larger: it includes the records that are in transit.
    fn acknowledged_high(&self) -> retrace_core::RecordIndex {
        self.status().high
    }
}

impl<const A: usize, C: MotionCard<A>> MotionCard<A> for &mut C {
    type Fault = C::Fault;

    fn window(&self) -> u32 {
        C::window(self)
    }

    fn send(&mut self, command: HostCommand<A>) -> Result<(), CommandRefusal> {
        C::send(self, command)
    }

    fn run_period(&mut self) -> Result<&CardStatus<A>, Self::Fault> {
        C::run_period(self)
    }

    fn begin_path(&mut self, start: PathStart) -> Result<(), Self::Fault> {
        C::begin_path(self, start)
    }

    fn status(&self) -> &CardStatus<A> {
        C::status(self)
    }

    fn acknowledged_high(&self) -> retrace_core::RecordIndex {
        C::acknowledged_high(self)
    }
}
