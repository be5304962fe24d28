//! What an RP2350 has where (RP2350 data sheet, 2.2 and the tables of registers). Its state machines, its USB
//! controller and its UART0 are those of the RP2040.
//!
//! Invariant: every address is that of an aligned 32-bit register or the begin of a block of them; none is of the DMA.

use super::clock::{CRYSTAL_MHZ, Factors};
use super::sample_ring::DmaFields;

pub(super) const CLOCKS: usize = 0x4001_0000;
pub(super) const RESETS: usize = 0x4002_0000;
pub(super) const PINS: usize = 0x4002_8000;
pub(super) const PADS: usize = 0x4003_8000;
pub(super) const XOSC: usize = 0x4004_8000;
pub(super) const PLL_SYSTEM: usize = 0x4005_0000;
pub(super) const PLL_USB: usize = 0x4005_8000;
pub(super) const UART0: usize = 0x4007_0000;
pub(super) const PWM: usize = 0x400a_8000;
pub(super) const TIMER: usize = 0x400b_0000;
pub(super) const WATCHDOG: usize = 0x400d_8000;
const TICK_GENERATORS: usize = 0x4010_8000;
/// Control of the USB controller's clock.
pub(super) const CLOCK_USB_CONTROL: usize = CLOCKS + 0x60;
/// Parts of the chip that the watchdog resets, and all but the two oscillators.
pub(super) const POWER_WATCHDOG_SELECT: usize = 0x4001_8008;
pub(super) const WHOLE_CHIP: u32 = 0x01ff_fff3;
/// A random bit of the ring oscillator.
pub(super) const RANDOM_BIT: usize = 0x400e_8020;
/// The timer's interrupts, and which are enabled.
pub(super) const TIMER_INTERRUPT: usize = TIMER + 0x3c;
pub(super) const TIMER_INTERRUPT_ENABLE: usize = TIMER + 0x40;
/// Which of the processor's pins are outputs.
pub(super) const PINS_OUTPUT_ENABLE: usize = 0xd000_0030;
/// In the control of a pin: its level is low whatever its function.
pub(super) const FORCED_LOW: u32 = 2 << 12;
/// Resets of the DMA, the pins and their pads, both blocks of state machines, both PLLs, the PWM, the timer, UART0 and
/// the USB controller.
pub(super) const PERIPHERALS: u32 =
    1 << 2 | 1 << 6 | 1 << 9 | 1 << 11 | 1 << 12 | 1 << 14 | 1 << 15 | 1 << 16 | 1 << 23 | 1 << 26 | 1 << 28;
/// Where the control of a DMA channel has its fields (12.6.10).
pub(super) const DMA_FIELDS: DmaFields =
    DmaFields { increment_write: 6, ring_size: 8, ring_of_write: 12, chain_to: 13, request: 17, is_quiet: 23 };
/// What starts the ticks of a microsecond, of the timer and of the watchdog: register and value.
pub(super) const TICKS: [(usize, u32); 4] = [
    (TICK_GENERATORS + 0x1c, CRYSTAL_MHZ),
    (TICK_GENERATORS + 0x18, 1),
    (TICK_GENERATORS + 0x34, CRYSTAL_MHZ),
    (TICK_GENERATORS + 0x30, 1),
];
/// The watchdog counts down once a microsecond.
pub(super) const WATCHDOG_COUNTS_PER_US: u32 = 1;
/// Interrupt of UART0.
pub(super) const UART_INTERRUPT: u8 = 33;
/// 150 MHz from the crystal.
pub(super) const SYSTEM: Factors = Factors { multiplier: 125, dividers: [5, 2] };
