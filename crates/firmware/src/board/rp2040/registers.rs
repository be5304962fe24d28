//! The only unsafe code of this board: the peripherals' registers by name, the second stage of the boot, and the
//! interrupts.
//!
//! Invariant: a [`Register`] is made here alone, from the address of an aligned 32-bit register of this chip (RP2040
//! data sheet, the tables of registers); it is read and written volatile, and no write to one of them can break the
//! safety of memory. Those of the DMA, which writes to memory, belong to `sample_ring` alone, which makes it write to
//! its own ring of atomic words and nowhere else.
#![allow(unsafe_code)]

use core::arch::global_asm;
use core::ptr::{with_exposed_provenance, with_exposed_provenance_mut};

use super::chip::{self, CLOCKS, PWM, RESETS, TIMER, UART0, WATCHDOG, XOSC};
use crate::board::stopwatch;
use crate::diagnostics::DIAGNOSTICS;

/// The second stage of the boot: the boot ROM of an RP2040 checks these 256 bytes and runs them; they set up the flash
/// and jump to the vector table behind them.
#[cfg(feature = "rp2040")]
#[unsafe(link_section = ".boot2")]
#[used]
static BOOT_STAGE_2: [u8; 256] = rp2040_boot2::BOOT_LOADER_W25Q080;

/// The image's definition, for the boot ROM of an RP2350 (data sheet, 5.9.5.1): an executable image for the Arm
/// processors in their secure state, and no other block.
#[cfg(feature = "rp2350")]
#[unsafe(link_section = ".image_definition")]
#[used]
static IMAGE_DEFINITION: [u32; 5] = [0xffff_ded3, 0x1021_0142, 0x0000_01ff, 0, 0xab12_3579];

// Nothing to do before the memory is initialized. It stands in flash, as `Reset` does: the code is not in RAM yet.
global_asm!(".section .start, \"ax\"", ".global __pre_init", ".thumb_func", "__pre_init:", "bx lr");

/// A peripheral's register.
#[derive(Clone, Copy)]
pub(super) struct Register(usize);

impl Register {
    /// Reads the register.
    pub(super) fn read(self) -> u32 {
        // SAFETY: the module's invariant.
        unsafe { with_exposed_provenance::<u32>(self.0).read_volatile() }
    }

    /// Writes the register.
    pub(super) fn write(self, value: u32) {
        // SAFETY: the module's invariant.
        unsafe { with_exposed_provenance_mut::<u32>(self.0).write_volatile(value) }
    }

    /// Sets these bits by the alias for it (data sheet, 2.1.2), which the processor's own registers do not have.
    pub(super) fn set_bits(self, mask: u32) {
        Self(self.0 + 0x2000).write(mask);
    }

    /// Clears these bits by the alias for it.
    pub(super) fn clear_bits(self, mask: u32) {
        Self(self.0 + 0x3000).write(mask);
    }

    /// Whether all of these bits are set.
    pub(super) fn has(self, mask: u32) -> bool {
        self.read() & mask == mask
    }
}

macro_rules! registers {
    ($($(#[$doc:meta])* $name:ident = $address:expr;)*) => {
        $($(#[$doc])* pub(super) const $name: Register = Register($address);)*
    };
}

const SIO: usize = 0xd000_0000;
const USB: usize = 0x5011_0000;

registers! {
    /// Clock of the watchdog and the crystal's side: control, and which source is selected (data sheet, 2.15.7).
    CLOCK_REF_CONTROL = CLOCKS + 0x30;
    CLOCK_REF_SELECTED = CLOCKS + 0x38;
    /// Clock of the processor: control, and which source is selected.
    CLOCK_SYS_CONTROL = CLOCKS + 0x3c;
    CLOCK_SYS_SELECTED = CLOCKS + 0x44;
    /// Clock of UART0: control.
    CLOCK_PERIPHERAL_CONTROL = CLOCKS + 0x48;
    /// Clock of the USB controller: control.
    CLOCK_USB_CONTROL = chip::CLOCK_USB_CONTROL;
    /// Peripherals that are held in reset, and those that have come out of it (data sheet, 2.14.3).
    RESET = RESETS;
    RESET_DONE = RESETS + 0x8;
    /// Parts of the chip that the watchdog resets (data sheet, 2.13.5).
    POWER_WATCHDOG_SELECT = chip::POWER_WATCHDOG_SELECT;
    /// Crystal oscillator (data sheet, 2.16.7).
    CRYSTAL_CONTROL = XOSC;
    CRYSTAL_STATUS = XOSC + 0x4;
    CRYSTAL_STARTUP = XOSC + 0xc;
    /// A random bit of the ring oscillator (data sheet, 2.17.8).
    RANDOM_BIT = chip::RANDOM_BIT;
    /// UART0 (data sheet, 4.2.8).
    UART_DATA = UART0;
    UART_FLAGS = UART0 + 0x18;
    UART_DIVISOR = UART0 + 0x24;
    UART_FRACTION = UART0 + 0x28;
    UART_LINE = UART0 + 0x2c;
    UART_CONTROL = UART0 + 0x30;
    UART_LEVELS = UART0 + 0x34;
    UART_INTERRUPT_MASK = UART0 + 0x38;
    UART_INTERRUPT_CLEAR = UART0 + 0x44;
    /// Timer of microseconds: its first alarm (data sheet, 4.6.5).
    TIMER_ALARM = TIMER + 0x10;
    TIMER_NOW = TIMER + 0x28;
    TIMER_INTERRUPT = chip::TIMER_INTERRUPT;
    TIMER_INTERRUPT_ENABLE = chip::TIMER_INTERRUPT_ENABLE;
    /// Slice 2 of the PWM, whose input B is at GPIO 21 (data sheet, 4.5.3).
    EDGE_COUNTER_CONTROL = PWM + 0x28;
    EDGE_COUNTER_DIVIDER = PWM + 0x2c;
    EDGE_COUNTER = PWM + 0x30;
    EDGE_COUNTER_TOP = PWM + 0x38;
    /// Slice 3 of the PWM, whose output A is at GPIO 22 (data sheet, 4.5.3).
    PWM_CONTROL = PWM + 0x3c;
    PWM_DIVIDER = PWM + 0x40;
    PWM_LEVELS = PWM + 0x48;
    PWM_TOP = PWM + 0x4c;
    /// Watchdog (data sheet, 4.7.6).
    WATCHDOG_CONTROL = WATCHDOG;
    WATCHDOG_LOAD = WATCHDOG + 0x4;
    WATCHDOG_SCRATCH = WATCHDOG + 0xc;
    /// The processor's own access to the pins (data sheet, 2.3.1.7).
    PINS_IN = SIO + 0x4;
    PINS_OUT = SIO + 0x10;
    PINS_OUTPUT_ENABLE = chip::PINS_OUTPUT_ENABLE;
    /// USB controller (data sheet, 4.1.4).
    USB_ADDRESS = USB;
    USB_CONTROL = USB + 0x40;
    USB_FRAME = USB + 0x48;
    USB_SIE_CONTROL = USB + 0x4c;
    USB_SIE_STATUS = USB + 0x50;
    USB_BUFFERS_DONE = USB + 0x58;
    USB_REFUSE = USB + 0x68;
    USB_LINES = USB + 0x74;
    USB_POWER = USB + 0x78;
}

/// Enables an interrupt of the processor (ARMv6-M, B3.4; ARMv8-M, D1.2).
pub(super) fn enable_interrupt(number: u8) {
    Register(0xe000_e100 + 4 * (number as usize / 32)).write(1 << (number % 32));
}

/// Starts the ticks of a microsecond.
pub(super) fn start_ticks() {
    for (register, value) in chip::TICKS {
        Register(register).write(value);
    }
}

/// Returns the register that selects a pin's function and overrides its level (data sheet, 2.19.6.1).
pub(super) const fn pin_control(pin: u8) -> Register {
    assert!(pin < 30);
    Register(chip::PINS + 4 + 8 * pin as usize)
}

/// Returns the register of a pin's pull-up, pull-down and drive (data sheet, 2.19.6.3).
pub(super) const fn pin_pad(pin: u8) -> Register {
    assert!(pin < 30);
    Register(chip::PADS + 4 + 4 * pin as usize)
}

/// Returns a register of a DMA channel (RP2040 data sheet, 2.5.7): for `sample_ring` alone, see the module's invariant.
pub(super) const fn dma_channel(channel: usize, offset: usize) -> Register {
    assert!(channel < 12 && offset < 0x40 && offset % 4 == 0);
    Register(0x5000_0000 + 0x40 * channel + offset)
}

/// Returns a word of the USB controller's memory, which has no aliases.
pub(super) const fn usb_memory(word: usize) -> Register {
    assert!(word < 1024);
    Register(0x5010_0000 + 4 * word)
}

/// One of the two PLLs (data sheet, 2.18.4).
#[derive(Clone, Copy)]
pub(super) enum Pll {
    /// Of the processor's clock.
    System,
    /// Of the USB controller's clock.
    Usb,
}

impl Pll {
    const fn register(self, offset: usize) -> Register {
        let base = match self {
            Self::System => chip::PLL_SYSTEM,
            Self::Usb => chip::PLL_USB,
        };
        Register(base + offset)
    }

    /// Whether it is locked; divider of its input.
    pub(super) const fn status(self) -> Register {
        self.register(0)
    }

    /// Parts that are without power.
    pub(super) const fn power(self) -> Register {
        self.register(0x4)
    }

    /// Multiplier.
    pub(super) const fn multiplier(self) -> Register {
        self.register(0x8)
    }

    /// Dividers of its output.
    pub(super) const fn dividers(self) -> Register {
        self.register(0xc)
    }
}

/// The line to the flash (RP2040 data sheet, 4.10.13), and the control of its select pin (2.19.6.2).
#[cfg(feature = "rp2040")]
mod flash_line {
    use super::Register;

    const SSI: usize = 0x1800_0000;
    pub(in super::super) const SSI_CONTROL: Register = Register(SSI);
    pub(in super::super) const SSI_ENABLE: Register = Register(SSI + 0x08);
    pub(in super::super) const SSI_CLOCK: Register = Register(SSI + 0x14);
    pub(in super::super) const SSI_STATUS: Register = Register(SSI + 0x28);
    pub(in super::super) const SSI_DATA: Register = Register(SSI + 0x60);
    pub(in super::super) const FLASH_SELECT_CONTROL: Register = Register(0x4001_800c);
}
#[cfg(feature = "rp2040")]
pub(super) use flash_line::*;

/// The chip's number, in two words (RP2350 data sheet, 13.5.2).
#[cfg(feature = "rp2350")]
pub(super) const CHIP_NUMBER: [Register; 2] = [Register(0x4013_0000), Register(0x4013_0004)];

/// One of the two blocks of four state machines (data sheet, 3.7).
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Pio {
    /// The steps of four axes.
    Steps,
    /// The frame.
    Frame,
}

impl Pio {
    const fn register(self, offset: usize) -> Register {
        let base = match self {
            Self::Steps => 0x5020_0000,
            Self::Frame => 0x5030_0000,
        };
        Register(base + offset)
    }

    /// Enables machines (bits 0 … 3), and restarts them (4 … 7) and their clocks (8 … 11).
    pub(super) const fn control(self) -> Register {
        self.register(0)
    }

    /// State of the queues.
    pub(super) const fn queue_status(self) -> Register {
        self.register(0x4)
    }

    /// What the queues did not have or take.
    pub(super) const fn queue_faults(self) -> Register {
        self.register(0x8)
    }

    /// Queue to a machine.
    pub(super) const fn queue(self, machine: usize) -> Register {
        assert!(machine < 4);
        self.register(0x10 + 4 * machine)
    }

    /// Queue from a machine.
    pub(super) const fn words(self, machine: usize) -> Register {
        assert!(machine < 4);
        self.register(0x20 + 4 * machine)
    }

    /// An instruction of the block's program.
    pub(super) const fn instruction(self, at: usize) -> Register {
        assert!(at < 32);
        self.register(0x48 + 4 * at)
    }

    /// Address of the queue from a machine, for the DMA.
    pub(super) const fn words_address(self, machine: usize) -> u32 {
        self.words(machine).0 as u32
    }

    const fn machine(self, machine: usize, offset: usize) -> Register {
        assert!(machine < 4);
        self.register(0xc8 + 0x18 * machine + offset)
    }

    /// Divider of a machine's clock.
    pub(super) const fn divider(self, machine: usize) -> Register {
        self.machine(machine, 0)
    }

    /// Limits of a machine's program.
    pub(super) const fn execution(self, machine: usize) -> Register {
        self.machine(machine, 0x4)
    }

    /// How a machine shifts.
    pub(super) const fn shifting(self, machine: usize) -> Register {
        self.machine(machine, 0x8)
    }

    /// Address of the instruction that a machine executes.
    pub(super) const fn address(self, machine: usize) -> Register {
        self.machine(machine, 0xc)
    }

    /// An instruction to execute at once.
    pub(super) const fn execute(self, machine: usize) -> Register {
        self.machine(machine, 0x10)
    }

    /// Pins of a machine.
    pub(super) const fn pins(self, machine: usize) -> Register {
        self.machine(machine, 0x14)
    }
}

/// Makes the processor take its interrupts from the vector table in RAM, which the start-up code has copied there.
pub(super) fn use_vector_table_in_ram() {
    unsafe extern "C" {
        static __vector_table: u32;
    }
    // the address of the vector table (ARMv6-M, B3.2.5); only the address of the symbol is used
    Register(0xe000_ed08).write((&raw const __vector_table).expose_provenance() as u32);
}

/// Handler of all interrupts, by their numbers (data sheet, 2.3.2). One that is not expected halts the firmware.
#[cortex_m_rt::exception]
unsafe fn DefaultHandler(interrupt: i16) {
    const UART: i16 = chip::UART_INTERRUPT as i16;
    let entered = stopwatch::now();
    match interrupt {
        0 => super::encoder::take_sample(),
        UART => super::serial::take_received(),
        _ => crate::halt(),
    }
    DIAGNOSTICS.record_interrupt(stopwatch::between(entered, stopwatch::now()));
}
