//! Diagnostics of the firmware, read out of its memory while it runs.
//!
//! Invariant: the layout is that of `crates/firmware/src/diagnostics.rs`, which its mark identifies.

use super::elf::Image;
use super::emulator::Emulator;
use super::sections::RAM_BEGINS;

/// Mark that identifies the block and its layout.
const MARK: u32 = 0x5254_0002;
/// Words of it.
const WORDS: usize = 13;
/// Cycles a second of the firmware's stopwatch in QEMU: one a nanosecond's instruction is 168 of 1000.
const STOPWATCH_MHZ: u64 = 168;

/// Counters and worst times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Diagnostics {
    /// Cycles of the stopwatch that the longest control period took, interrupts taken out.
    pub(super) max_period: u32,
    /// Cycles that the longest filling of a buffer with steps took.
    pub(super) max_interrupt: u32,
    /// Control periods computed.
    pub(super) periods: u32,
    /// Control periods that began late.
    pub(super) late_periods: u32,
    /// Bytes that arrived and were not accepted.
    pub(super) lost_bytes: u32,
    /// Step batches whose pulses did not fit their period.
    pub(super) refused: u32,
    /// Net pulses of each axis at the outputs.
    pub(super) counted: [i32; 4],
    /// Cycles of the stopwatch that a control period took on average, interrupts taken out.
    pub(super) mean_period: u32,
}

impl Diagnostics {
    /// Reads the diagnostics.
    ///
    /// # Errors
    /// They are not in the image, not initialised yet, or QEMU does not answer.
    pub(super) fn read(image: &Image, emulator: &mut Emulator) -> Result<Self, String> {
        let address = image.address_of("DIAGNOSTICS").ok_or("the image has no DIAGNOSTICS")?;
        let words = emulator.words(address, WORDS)?;
        if words[0] != MARK {
            return Err(format!("the firmware's diagnostics begin with {:#x}, not {MARK:#x}", words[0]));
        }
        Ok(Self {
            max_period: words[1],
            max_interrupt: words[2],
            periods: words[4],
            late_periods: words[5],
            lost_bytes: words[6],
            refused: words[7],
            counted: [8, 9, 10, 11].map(|at| words[at] as i32),
            // in units of 1024 cycles
            mean_period: (u64::from(words[12]) * 1024 / u64::from(words[4].max(1))) as u32,
        })
    }
}

/// Instructions in so many cycles of the stopwatch, where QEMU counts a nanosecond for each of them.
pub(super) fn instructions(cycles: u32) -> u64 {
    u64::from(cycles) * 1000 / STOPWATCH_MHZ
}

/// Greatest depth of the stack, in bytes: RAM that was never written is still zero in QEMU.
///
/// # Errors
/// The image has no symbol for the begin of its stack, or QEMU does not answer.
pub(super) fn stack_depth(image: &Image, emulator: &mut Emulator) -> Result<u32, String> {
    let top = image.address_of("_stack_start").ok_or("the image has no _stack_start")?;
    let in_ram = image.sections.iter().filter(|section| section.address >= RAM_BEGINS);
    let floor = in_ram.map(|section| section.address + section.size).max().unwrap_or(RAM_BEGINS).next_multiple_of(4);
    let words = emulator.words(floor, (top.saturating_sub(floor) / 4) as usize)?;
    let untouched = words.iter().take_while(|&&word| word == 0).count() as u32;
    Ok(top - floor - untouched * 4)
}
