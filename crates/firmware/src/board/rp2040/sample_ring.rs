//! The ring of the spindle encoder's samples in RAM, which the DMA fills (RP2040 data sheet, 2.5).
//!
//! Invariant: the DMA writes to this ring alone. Two channels fill one half each, whose address wraps in hardware, and
//! start each other without end; no other code writes their registers, or the ring.

use core::sync::atomic::{AtomicU32, Ordering::Acquire, Ordering::Relaxed, fence};

use super::chip::DMA_FIELDS;
use super::registers::{Pio, dma_channel};
use retrace_firmware::rp2040::spindle_decoder::RING_WORDS;

/// Where the control of a DMA channel has its fields: numbers of their lowest bits.
pub(super) struct DmaFields {
    pub(super) increment_write: u32,
    pub(super) ring_size: u32,
    pub(super) ring_of_write: u32,
    pub(super) chain_to: u32,
    pub(super) request: u32,
    pub(super) is_quiet: u32,
}

/// Registers of a channel: where it reads and writes, how many words, how; and its control by which it starts.
const READ_ADDRESS: usize = 0x0;
const WRITE_ADDRESS: usize = 0x4;
const COUNT: usize = 0x8;
const CONTROL_AND_START: usize = 0xc;
const CONTROL: usize = 0x10;
/// Words that a channel fills, and the power of two of its bytes.
const HALF: usize = RING_WORDS / 2;
const HALF_BYTES_BITS: u32 = (HALF * 4).ilog2();
/// Enabled, before other channels, words of 32 bits.
const ENABLED: u32 = 1 | 1 << 1 | 2 << 2;
/// Request of the queue from a machine of the second block, by machine.
const FIRST_REQUEST: u32 = 12;
/// Reads of both channels until one of them runs: where one starts the other, neither does for some cycles.
const ATTEMPTS: usize = 8;

/// A half of the ring begins at a multiple of its size.
#[repr(C, align(4096))]
struct Ring([AtomicU32; RING_WORDS]);
const _: () = assert!(HALF * 4 == 4096 && HALF.is_power_of_two());

static RING: Ring = Ring([const { AtomicU32::new(0) }; RING_WORDS]);

/// Starts to fill the ring with the words from this machine. It never ends: call it once.
pub(super) fn start(machine: usize) {
    for channel in [1, 0] {
        let register = |offset| dma_channel(channel, offset);
        register(READ_ADDRESS).write(Pio::Frame.words_address(machine));
        register(WRITE_ADDRESS).write((&raw const RING.0[channel * HALF]).expose_provenance() as u32);
        register(COUNT).write(HALF as u32);
        let fields = DMA_FIELDS;
        let control = ENABLED
            | 1 << fields.increment_write
            | HALF_BYTES_BITS << fields.ring_size
            | 1 << fields.ring_of_write
            | (1 - channel as u32) << fields.chain_to
            | (FIRST_REQUEST + machine as u32) << fields.request
            | 1 << fields.is_quiet;
        register(if channel == 0 { CONTROL_AND_START } else { CONTROL }).write(control);
    }
}

/// Returns the word that is written next; `None` if no channel runs. The words before it are there to be read.
pub(super) fn next_word() -> Option<u32> {
    let position = (0..ATTEMPTS).find_map(|_| {
        (0..2).find_map(|channel| {
            // not the address: the chip reports a wrong one for words on their way (erratum RP2040-E12)
            let left = dma_channel(channel, COUNT).read() as usize;
            (1..=HALF).contains(&left).then(|| ((channel + 1) * HALF - left) as u32)
        })
    });
    fence(Acquire);
    position
}

/// Returns a word of the ring by its number, which wraps around.
pub(super) fn word(number: u32) -> u32 {
    RING.0[number as usize % RING_WORDS].load(Relaxed)
}
