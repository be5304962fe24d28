//! The clock tree (RM0090 and RM0368, *Reset and clock control*).
//!
//! Invariant: every wait is bounded; if a clock does not become ready, the chip runs at the rates below or, without any
//! PLL, halts here.

/// Clock rates of the chip, in Hz.
pub(crate) struct Rates {
    /// The processor and the system timer.
    pub(crate) core: u32,
    /// USART1: the bus APB2.
    pub(crate) serial: u32,
    /// TIM1: twice the bus APB2, where that is divided (RM0090, 7.2). In QEMU, TIM5.
    pub(crate) slot_timer: u32,
    /// TIM5: twice the bus APB1. In QEMU, TIM2.
    pub(crate) microsecond_timer: u32,
}

/// 168 MHz; APB1 at a quarter, APB2 at half of it.
#[cfg(all(feature = "f405", not(feature = "qemu")))]
pub(crate) const RATES: Rates =
    Rates { core: 168_000_000, serial: 84_000_000, slot_timer: 168_000_000, microsecond_timer: 84_000_000 };
/// 84 MHz; APB1 at half of it, APB2 undivided.
#[cfg(feature = "f401")]
pub(crate) const RATES: Rates =
    Rates { core: 84_000_000, serial: 84_000_000, slot_timer: 84_000_000, microsecond_timer: 84_000_000 };
/// 96 MHz, the highest rate below its 100 MHz that leaves 48 MHz for USB; APB1 at half of it, APB2 undivided.
#[cfg(feature = "f411")]
pub(crate) const RATES: Rates =
    Rates { core: 96_000_000, serial: 96_000_000, slot_timer: 96_000_000, microsecond_timer: 96_000_000 };
/// QEMU's netduinoplus2 has no clock tree: the processor is assumed to run at 168 MHz, the timers at 1 GHz, and no baud
/// rate matters.
#[cfg(feature = "qemu")]
pub(crate) const RATES: Rates =
    Rates { core: 168_000_000, serial: 84_000_000, slot_timer: 1_000_000_000, microsecond_timer: 1_000_000_000 };

const _: () = {
    // the chosen rates divide without remainder, so that slots and baud rate are exact
    assert!(RATES.slot_timer % retrace_firmware::stm32f4::period::SLOT_HZ == 0);
    assert!(RATES.serial % super::serial::BAUD == 0 && RATES.serial / super::serial::BAUD >= 16);
    assert!(RATES.core >= 84_000_000);
};

/// Nothing to start, and no crystal.
#[cfg(feature = "qemu")]
pub(crate) fn start() -> bool {
    false
}

#[cfg(not(feature = "qemu"))]
pub(crate) use tree::start;

#[cfg(not(feature = "qemu"))]
mod tree {
    //! The real clock tree.
    //!
    //! Invariant: the flash's wait states and the core's voltage are raised before the rate is.

    use crate::board::stm32f4::registers::{flash, pwr, rcc, set_pll_factors};

    /// Megahertz of the crystal, if one is fitted.
    const CRYSTAL_MHZ: Option<u8> = match (cfg!(feature = "hse8"), cfg!(feature = "hse25")) {
        (true, false) => Some(8),
        (false, true) => Some(25),
        (false, false) => None,
        (true, true) => panic!("choose one crystal: hse8 or hse25"),
    };
    /// Megahertz of the internal oscillator.
    const INTERNAL_MHZ: u8 = 16;
    /// Maximum wait for a clock to become ready, in iterations of a loop: at 16 MHz about 100 ms, far longer than a
    /// crystal needs.
    const PATIENCE: u32 = 400_000;

    fn wait_for(ready: impl Fn() -> bool) -> bool {
        (0..PATIENCE).any(|_| ready())
    }

    /// Multiplier over 1 MHz, at most 432 MHz out of it.
    #[cfg(any(feature = "f405", feature = "f401"))]
    const PLL_MHZ: u16 = 336;
    #[cfg(feature = "f411")]
    const PLL_MHZ: u16 = 192;
    /// Divider to the 48 MHz of the USB controller.
    const USB_DIVIDER: u8 = (PLL_MHZ / 48) as u8;
    const _: () = assert!(USB_DIVIDER as u16 * 48 == PLL_MHZ);

    /// Sets the chip's clock rate, from the crystal or else from the internal oscillator. Returns whether it is that of
    /// a crystal. If not even the PLL locks, the serial line would have the wrong rate: the chip
    /// halts.
    pub(crate) fn start() -> bool {
        let crystal = CRYSTAL_MHZ.filter(|_| {
            rcc().cr().modify(|_, w| w.hseon().on());
            wait_for(|| rcc().cr().read().hserdy().is_ready())
        });
        prepare_core();
        // the PLL is fed with 1 MHz
        set_pll_factors(crystal.unwrap_or(INTERNAL_MHZ), PLL_MHZ, USB_DIVIDER);
        rcc().pllcfgr().modify(|_, w| {
            let w = if crystal.is_some() { w.pllsrc().hse() } else { w.pllsrc().hsi() };
            if cfg!(feature = "f401") { w.pllp().div4() } else { w.pllp().div2() }
        });
        rcc().cfgr().modify(|_, w| {
            if cfg!(feature = "f405") { w.ppre1().div4().ppre2().div2() } else { w.ppre1().div2().ppre2().div1() }
        });
        rcc().cr().modify(|_, w| w.pllon().on());
        if !wait_for(|| rcc().cr().read().pllrdy().is_ready()) {
            crate::halt();
        }
        rcc().cfgr().modify(|_, w| w.sw().pll());
        if !wait_for(|| rcc().cfgr().read().sws().is_pll()) {
            crate::halt();
        }
        crystal.is_some()
    }

    /// Wait states for 2.7 … 3.6 V (RM0090, table 10; RM0368, table 6; RM0383, table 5), with prefetch and caches.
    fn prepare_core() {
        rcc().apb1enr().modify(|_, w| w.pwren().enabled());
        // the F405 and the F401 start in the scale that they need
        #[cfg(feature = "f411")]
        pwr().cr().modify(|_, w| w.vos().scale1());
        #[cfg(not(feature = "f411"))]
        let _ = pwr;
        flash().acr().modify(|_, w| {
            let w = w.prften().enabled().icen().enabled().dcen().enabled().latency();
            if cfg!(feature = "f405") {
                w.ws5()
            } else if cfg!(feature = "f411") {
                w.ws3()
            } else {
                w.ws2()
            }
        });
    }
}
