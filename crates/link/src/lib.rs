//! What host and card say to each other, as typed messages (GMC-2), and the trait behind which every card stands.
//!
//! A card in the same process receives the messages as they are. A card on a serial line receives them as bytes ([`wire`]) in frames
//! with a checksum ([`frame`]), between two ends that repeat what was lost ([`Host`], [`CardEnd`]).
//!
//! Invariant: the wire carries records in path order, each under its place number, never negated and never scaled. The
//! rate is a real-time word of its own.
#![no_std]
#![forbid(unsafe_code)]

mod alarm;
mod card_endpoint;
pub mod crc;
mod cutting;
pub mod frame;
mod frame_size;
mod host;
mod message;
mod ports;
mod predicted_window;
mod serial_card;
mod session;
mod settings;
pub mod wire;

pub use alarm::Alarm;
pub use card_endpoint::CardEndpoint;
pub use cutting::{
    CutterOff, CutterOffCause, CuttingChannel, CuttingSettings, MAX_CUTTING_CHANNELS, RepeatedInstruction,
};
pub use host::{HostEndpoint, LineCounts, LinkError};
pub use message::{
    CardStatus, CommandRefusal, HomingCommand, HostCommand, InputWait, Instruction, MAX_CHANGES, OutputAction,
    OutputChange, Outputs, channel,
};
pub use ports::{BytePort, CardCore, CardFailure, state_crc};
pub use serial_card::{LinkTimeouts, LinkedCard, LinkedCardError};
pub use session::{next_epoch, session_key};
pub use settings::{CardIdentity, CardSettings, InputSetting, InputUse, MAX_INPUTS, MAX_SAFE, PROTOCOL, PathStart};
pub use wire::Greeting;

/// What the controller sees of a card, simulated or real.
pub trait MotionCard<const A: usize> {
    /// What holds the line or the machine up for good.
    type Fault: CardFailure;

    /// How many records the card can hold.
    fn window(&self) -> u32;

    /// Hands one word over.
    ///
    /// # Errors
    /// [`Refusal`] says why the card did not take it; nothing has changed then.
    fn send(&mut self, word: HostCommand<A>) -> Result<(), CommandRefusal>;

    /// Lets one control period pass and reports it. A card in virtual time computes it, one in wall time waits for it.
    ///
    /// # Errors
    /// A fault is final: the card stands, and no word of this run will move it again. Only an alarm can be cleared: after
    /// [`Word::ClearAlarm`] periods pass as ever, until it is known that the alarm stays.
    fn period(&mut self) -> Result<&CardStatus<A>, Self::Fault>;

    /// Begins a path anew where the machine stands: an epoch. What the card holds of the old path is forgotten, counts and outputs stay,
    /// and so does an alarm. The machine has to stand.
    ///
    /// An instruction in hand is given up. Where the card completes one before it hears of the epoch, its number counts as executed too:
    /// the status says which one is the last.
    ///
    /// # Errors
    /// A fault is final, as in [`MotionCard::period`].
    fn begin(&mut self, start: PathStart) -> Result<(), Self::Fault>;

    /// The report of the last period again.
    fn status(&self) -> &CardStatus<A>;

    /// The place behind the last record that the card is known to hold. A card at the end of a line has been told of more than that by
    /// its status, whose window is the one that is on its way.
    fn arrived(&self) -> u32 {
        self.status().high
    }
}

impl<const A: usize, C: MotionCard<A>> MotionCard<A> for &mut C {
    type Fault = C::Fault;

    fn window(&self) -> u32 {
        C::window(self)
    }

    fn send(&mut self, word: HostCommand<A>) -> Result<(), CommandRefusal> {
        C::send(self, word)
    }

    fn period(&mut self) -> Result<&CardStatus<A>, Self::Fault> {
        C::period(self)
    }

    fn begin(&mut self, start: PathStart) -> Result<(), Self::Fault> {
        C::begin(self, start)
    }

    fn status(&self) -> &CardStatus<A> {
        C::status(self)
    }

    fn arrived(&self) -> u32 {
        C::arrived(self)
    }
}
