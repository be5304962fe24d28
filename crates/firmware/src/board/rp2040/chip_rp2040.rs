//! What an RP2040 has where (RP2040 data sheet, 2.2 and the tables of registers).
//!
//! Invariant: every address is that of an aligned 32-bit register or the begin of a block of them; none is of the DMA.

use super::clock::{CRYSTAL_MHZ, Factors};
use super::sample_ring::DmaFields;

pub(super) const CLOCKS: usize = 0x4000_8000;
pub(super) const RESETS: usize = 0x4000_c000;
pub(super) const PINS: usize = 0x4001_4000;
pub(super) const PADS: usize = 0x4001_c000;
pub(super) const XOSC: usize = 0x4002_4000;
pub(super) const PLL_SYSTEM: usize = 0x4002_8000;
pub(super) const PLL_USB: usize = 0x4002_c000;
pub(super) const UART0: usize = 0x4003_4000;
pub(super) const PWM: usize = 0x4005_0000;
pub(super) const TIMER: usize = 0x4005_4000;
pub(super) const WATCHDOG: usize = 0x4005_8000;
/// Control of the USB controller's clock (2.15.7).
pub(super) const CLOCK_USB_CONTROL: usize = CLOCKS + 0x54;
/// Parts of the chip that the watchdog resets (2.13.5), and all but the two oscillators.
pub(super) const POWER_WATCHDOG_SELECT: usize = 0x4001_0008;
pub(super) const WHOLE_CHIP: u32 = 0x1fffc;
/// A random bit of the ring oscillator (2.17.8).
pub(super) const RANDOM_BIT: usize = 0x4006_001c;
/// The timer's interrupts, and which are enabled (4.6.5).
pub(super) const TIMER_INTERRUPT: usize = TIMER + 0x34;
pub(super) const TIMER_INTERRUPT_ENABLE: usize = TIMER + 0x38;
/// Which of the processor's pins are outputs (2.3.1.7).
pub(super) const PINS_OUTPUT_ENABLE: usize = 0xd000_0020;
/// In the control of a pin: its level is low whatever its function (2.19.6.1).
pub(super) const FORCED_LOW: u32 = 2 << 8;
/// Resets of the DMA, the pins and their pads, both blocks of state machines, both PLLs, the PWM, the timer, UART0 and
/// the USB controller (2.14.3).
pub(super) const PERIPHERALS: u32 =
    1 << 2 | 1 << 5 | 1 << 8 | 1 << 10 | 1 << 11 | 1 << 12 | 1 << 13 | 1 << 14 | 1 << 21 | 1 << 22 | 1 << 24;
/// Where the control of a DMA channel has its fields (2.5.7).
pub(super) const DMA_FIELDS: DmaFields =
    DmaFields { increment_write: 5, ring_size: 6, ring_of_write: 10, chain_to: 11, request: 15, is_quiet: 21 };
/// What starts the ticks of a microsecond: register and value (4.7.6).
pub(super) const TICKS: [(usize, u32); 1] = [(WATCHDOG + 0x2c, 1 << 9 | CRYSTAL_MHZ)];
/// The watchdog counts down twice a microsecond (erratum RP2040-E1).
pub(super) const WATCHDOG_COUNTS_PER_US: u32 = 2;
/// Interrupt of UART0 (2.3.2).
pub(super) const UART_INTERRUPT: u8 = 20;
/// 125 MHz from the crystal.
pub(super) const SYSTEM: Factors = Factors { multiplier: 125, dividers: [6, 2] };
