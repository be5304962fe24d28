//! Boards for which this project has firmware: what each can do, so that a machine file can be checked before one is
//! there.
//!
//! Invariant: each entry is the identity that the firmware of that board reports; the firmware's tests compile this
//! file, too, and compare them.

use retrace_link::{CardIdentity, PROTOCOL};

/// Names of the boards.
pub const NAMES: [&str; 5] = ["pico", "pico2", "f401", "f405", "f411"];

/// How a board reads the encoder of a spindle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EncoderInputs {
    /// Number of inputs that the encoder takes, from input 0 on.
    pub count: u8,
    /// Highest rate of its counts, in counts per second.
    pub max_counts_hz: u32,
}

/// How the board with this identity reads the encoder of a spindle; `None` for a card that is none of the boards, whose
/// encoder takes no input, or that reads none.
pub fn encoder_inputs(identity: &CardIdentity) -> Option<EncoderInputs> {
    let is_pico = identity.name.starts_with(b"retrace-rp2") && identity.has_spindle_encoder;
    is_pico.then_some(EncoderInputs { count: 3, max_counts_hz: 250_000 })
}

/// What the card on a board reports of itself; `None` for an unknown board.
pub fn identity(name: &str) -> Option<CardIdentity> {
    let stm32f4 = |min_period_us| CardIdentity {
        protocol: PROTOCOL,
        name: *b"retrace-stm32f4\0",
        serial: 0,
        boot: 0,
        axes: 4,
        outputs: 4,
        inputs: 8,
        has_spindle_pwm: false,
        has_spindle_encoder: false,
        analog: retrace_link::AnalogCounts::NONE,
        window: 1024,
        memory: 256,
        tick_hz: 2_000_000,
        min_period_us,
        max_period_us: 20_000,
        max_pulses_hz: 250_000,
    };
    let pico = CardIdentity {
        name: *b"retrace-rp2040\0\0",
        inputs: 6,
        has_spindle_pwm: true,
        // at its first inputs
        has_spindle_encoder: true,
        // a frequency at its last input, and a voltage module at UART0
        analog: retrace_link::AnalogCounts::new(0, 2),
        tick_hz: 125_000_000,
        max_period_us: 4000,
        ..stm32f4(1000)
    };
    match name {
        "pico" => Some(pico),
        "pico2" => Some(CardIdentity {
            name: *b"retrace-rp2350\0\0",
            tick_hz: 150_000_000,
            max_period_us: 2500,
            max_pulses_hz: 400_000,
            ..pico
        }),
        "f405" => Some(stm32f4(500)),
        "f411" => Some(stm32f4(1000)),
        "f401" => Some(stm32f4(2000)),
        _ => None,
    }
}
