//! The clock tree: 125 MHz from the crystal of 12 MHz, 150 MHz on an RP2350 (RP2040 data sheet, 2.15 … 2.18).
//!
//! Invariant: every wait is bounded; without the crystal or the PLL, whose rates steps and line need, the chip halts
//! here, with every pin still an input.

use super::chip::{PERIPHERALS, SYSTEM};
use super::registers::{
    CLOCK_PERIPHERAL_CONTROL, CLOCK_REF_CONTROL, CLOCK_REF_SELECTED, CLOCK_SYS_CONTROL, CLOCK_SYS_SELECTED,
    CLOCK_USB_CONTROL, CRYSTAL_CONTROL, CRYSTAL_STARTUP, CRYSTAL_STATUS, Pll, RESET, RESET_DONE,
};
use retrace_firmware::rp2040::CLOCK_HZ;

/// Frequency of the crystal, in MHz.
pub(super) const CRYSTAL_MHZ: u32 = 12;
/// A PLL multiplies the crystal's frequency, and divides twice.
pub(super) struct Factors {
    pub(super) multiplier: u32,
    pub(super) dividers: [u32; 2],
}
const USB: Factors = Factors { multiplier: 100, dividers: [5, 5] };
const fn mhz(factors: &Factors) -> u32 {
    CRYSTAL_MHZ * factors.multiplier / factors.dividers[0] / factors.dividers[1]
}
const _: () = assert!(mhz(&SYSTEM) * 1_000_000 == CLOCK_HZ && mhz(&USB) == 48);

const STABLE: u32 = 1 << 31;
/// Power-down bits of the PLL: itself, its dividers, its oscillator.
const PLL_OFF: u32 = 1;
const DIVIDERS_OFF: u32 = 1 << 3;
const OSCILLATOR_OFF: u32 = 1 << 5;
/// Maximum wait, in iterations of a loop: at 12 MHz above 100 ms, longer than the crystal's start-up delay.
const PATIENCE: u32 = 400_000;

fn wait_for(ready: impl Fn() -> bool) {
    if !(0..PATIENCE).any(|_| ready()) {
        crate::halt();
    }
}

/// Sets the chip's clock rate and brings the peripherals out of reset.
pub(super) fn start() {
    // from the crystal: 1 … 15 MHz, with a delay of some 64 ms, since some crystals start slowly
    CRYSTAL_STARTUP.write(64 * 47);
    CRYSTAL_CONTROL.write(0xfab << 12 | 0xaa0);
    wait_for(|| CRYSTAL_STATUS.has(STABLE));
    CLOCK_SYS_CONTROL.write(0);
    wait_for(|| CLOCK_SYS_SELECTED.has(1));
    CLOCK_REF_CONTROL.write(2);
    wait_for(|| CLOCK_REF_SELECTED.has(1 << 2));

    RESET.set_bits(PERIPHERALS);
    RESET.clear_bits(PERIPHERALS);
    wait_for(|| RESET_DONE.has(PERIPHERALS));

    start_pll(Pll::System, &SYSTEM);
    CLOCK_SYS_CONTROL.write(1);
    wait_for(|| CLOCK_SYS_SELECTED.has(1 << 1));
    CLOCK_PERIPHERAL_CONTROL.write(1 << 11);
    start_pll(Pll::Usb, &USB);
    CLOCK_USB_CONTROL.write(1 << 11);
}

fn start_pll(pll: Pll, factors: &Factors) {
    pll.status().write(1);
    pll.multiplier().write(factors.multiplier);
    pll.power().clear_bits(PLL_OFF | OSCILLATOR_OFF);
    wait_for(|| pll.status().has(STABLE));
    pll.dividers().write(factors.dividers[0] << 16 | factors.dividers[1] << 12);
    pll.power().clear_bits(DIVIDERS_OFF);
}
