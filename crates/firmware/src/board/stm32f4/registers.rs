//! The only unsafe code of this board: access to the peripherals' registers from the main loop and from interrupts.
//!
//! Invariant: it returns shared references to register blocks, whose own methods read and write them volatile and check
//! the width of every field; registers without such a method are accessed by a single store or load here.
#![allow(unsafe_code)]

use cortex_m::peripheral::NVIC;

use super::chip;

/// A shared reference to each peripheral's registers, by name.
macro_rules! blocks {
    ($($(#[$doc:meta])* $name:ident: $peripheral:ident, $block:ty;)*) => {$(
        $(#[$doc])*
        pub(crate) fn $name() -> &'static $block {
            // SAFETY: the address is that of the peripheral on this microcontroller, aligned, and permanently valid;
            // the block is only ever shared, and its cells are volatile. That two contexts do not change one register
            // is the board's invariant.
            unsafe { &*chip::$peripheral::ptr() }
        }
    )*};
}

blocks! {
    /// Reset and clock control.
    rcc: RCC, chip::rcc::RegisterBlock;
    /// Flash interface.
    #[cfg(not(feature = "qemu"))]
    flash: FLASH, chip::flash::RegisterBlock;
    /// Power control.
    pwr: PWR, chip::pwr::RegisterBlock;
    /// Real-time clock and backup registers.
    rtc: RTC, chip::rtc::RegisterBlock;
    /// Port A.
    port_a: GPIOA, chip::gpioa::RegisterBlock;
    /// Port B.
    port_b: GPIOB, chip::gpiob::RegisterBlock;
    /// Port C.
    port_c: GPIOC, chip::gpioc::RegisterBlock;
    /// The serial line.
    usart1: USART1, chip::usart1::RegisterBlock;
    /// The encoder's timer.
    tim4: TIM4, chip::tim4::RegisterBlock;
    /// The step timer.
    tim5: TIM5, chip::tim5::RegisterBlock;
}

/// Switches pins of port A by its bit set/reset register.
pub(crate) fn set_port_a(word: u32) {
    // SAFETY: every value of this register is valid (RM0090, 8.4.7); a store to it changes nothing but the levels named
    // in it.
    port_a().bsrr().write(|w| unsafe { w.bits(word) });
}

/// Switches pins of port B by its bit set/reset register.
pub(crate) fn set_port_b(word: u32) {
    // SAFETY: as for port A.
    port_b().bsrr().write(|w| unsafe { w.bits(word) });
}

/// Sets the main PLL's divider `m` (2 … 63) and multiplier `n` (50 … 432), while it is off.
#[cfg(not(feature = "qemu"))]
pub(crate) fn set_pll_factors(m: u8, n: u16) {
    // SAFETY: the fields take 6 and 9 bits, which these fill; the clock's table keeps to the ranges of RM0090, 7.3.2.
    rcc().pllcfgr().modify(|_, w| unsafe { w.pllm().bits(m).plln().bits(n) });
}

/// Unmasks an interrupt.
pub(crate) fn unmask(interrupt: chip::Interrupt) {
    // SAFETY: no critical section depends on this interrupt being masked: the data it shares is atomic.
    unsafe { NVIC::unmask(interrupt) };
}

/// Sets the priority of an interrupt, 0 the most urgent, in the upper bits that the chip implements.
pub(crate) fn set_priority(interrupt: chip::Interrupt, level: u8) {
    // SAFETY: as for `unmask`; called before the interrupt is unmasked.
    unsafe { (*NVIC::PTR).ipr[interrupt as usize].write(level << (8 - chip::NVIC_PRIO_BITS)) };
}

/// Returns the chip's unique number, 96 bits (RM0090, 39.1; RM0368, 24.1). QEMU has none.
pub(crate) fn unique_number() -> [u32; 3] {
    #[cfg(feature = "qemu")]
    return [0; 3];
    #[cfg(not(feature = "qemu"))]
    // SAFETY: three aligned words of read-only system memory on each of these chips.
    unsafe {
        core::ptr::with_exposed_provenance::<[u32; 3]>(0x1fff_7a10).read_volatile()
    }
}

/// Handler of unexpected interrupts.
#[cortex_m_rt::exception]
unsafe fn DefaultHandler(_interrupt: i16) {
    crate::halt()
}
