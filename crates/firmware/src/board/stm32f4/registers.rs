//! The only unsafe code of this board: access to the peripherals' registers from the main loop and from interrupts.
//!
//! Invariant: it returns shared references to register blocks, whose own methods read and write them volatile and check
//! the width of every field; registers without such a method are accessed by a single store or load here.
#![allow(unsafe_code)]

#[cfg(not(feature = "qemu"))]
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::NVIC;

use super::chip;
use retrace_firmware::stm32f4::usb_otg::registers::OtgRegisters;
#[cfg(not(feature = "qemu"))]
use retrace_firmware::stm32f4::{period::BUFFER_SLOTS, step_filler::SlotBuffer};

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
    /// The timer of the slots.
    #[cfg(not(feature = "qemu"))]
    tim1: TIM1, chip::tim1::RegisterBlock;
    /// The timer that counts the slots and captures the edge of the probe; in QEMU the clock of microseconds.
    tim2: TIM2, chip::tim2::RegisterBlock;
    /// The DMA of the captured edge.
    #[cfg(not(feature = "qemu"))]
    dma1: DMA1, chip::dma1::RegisterBlock;
    /// The DMA of the steps.
    #[cfg(not(feature = "qemu"))]
    dma2: DMA2, chip::dma2::RegisterBlock;
    /// The clock of microseconds; in QEMU the timer that takes the DMA's place.
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

/// Stream of DMA2 with the requests of TIM1's update (RM0090 and RM0368, table of the requests of DMA2), and the bits
/// of its end of a buffer, all flags of it, and its channel.
#[cfg(not(feature = "qemu"))]
mod step_stream {
    pub(super) const NUMBER: usize = 5;
    pub(super) const BUFFER_ENDED: u32 = 1 << 11;
    pub(super) const FLAGS: u32 = 0b11_1101 << 6;
    pub(super) const CHANNEL: u32 = 6 << 25;
    /// The buffer that is played.
    pub(super) const CURRENT: u32 = 1 << 19;
    pub(super) const ENABLED: u32 = 1;
    /// Two buffers in turn, the highest priority, 32 bits at both ends, the memory's address counts, circular, from
    /// memory, and an interrupt at the end of a buffer.
    pub(super) const CONTROL: u32 =
        CHANNEL | 1 << 18 | 0b11 << 16 | 0b10 << 13 | 0b10 << 11 | 1 << 10 | 1 << 8 | 0b01 << 6 | 1 << 4;
    /// With its queue, so that a word is there before its request.
    pub(super) const QUEUE: u32 = 1 << 2 | 0b11;
}

/// Starts the stream of the steps from these buffers to the bit set/reset register of port A.
#[cfg(not(feature = "qemu"))]
pub(crate) fn start_step_stream(buffers: &'static [SlotBuffer; 2]) {
    rcc().ahb1enr().modify(|_, w| w.dma2en().enabled());
    // a clock is there some cycles after it was enabled (erratum of these chips): a read takes that long
    let _ = rcc().ahb1enr().read();
    let stream = dma2().st(step_stream::NUMBER);
    let [first, second] = buffers.each_ref().map(|buffer| buffer.as_ptr().expose_provenance() as u32);
    let port = port_a().bsrr().as_ptr().expose_provenance() as u32;
    // SAFETY: the stream only reads the buffers, which are atomic and never end, and only writes the register of the
    // port, of which every value is valid; the fields are those of RM0090, 10.5.
    unsafe {
        stream.par().write(|w| w.bits(port));
        stream.m0ar().write(|w| w.bits(first));
        stream.m1ar().write(|w| w.bits(second));
        stream.ndtr().write(|w| w.bits(BUFFER_SLOTS as u32));
        stream.fcr().write(|w| w.bits(step_stream::QUEUE));
        dma2().hifcr().write(|w| w.bits(step_stream::FLAGS));
        stream.cr().write(|w| w.bits(step_stream::CONTROL));
        stream.cr().write(|w| w.bits(step_stream::CONTROL | step_stream::ENABLED));
    }
}

/// Ends the stream of the steps; a word that is under way is written before this returns.
#[cfg(not(feature = "qemu"))]
pub(crate) fn stop_step_stream() {
    let stream = dma2().st(step_stream::NUMBER);
    // SAFETY: as for the start.
    stream.cr().write(|w| unsafe { w.bits(step_stream::CONTROL) });
    // it ends within a transfer
    let _ = (0..100).any(|_| stream.cr().read().bits() & step_stream::ENABLED == 0);
}

/// Acknowledges the end of a buffer, and returns the number of the one that is played now.
#[cfg(not(feature = "qemu"))]
pub(crate) fn end_of_step_buffer() -> usize {
    // SAFETY: it clears the flag of this stream alone.
    dma2().hifcr().write(|w| unsafe { w.bits(step_stream::BUFFER_ENDED) });
    usize::from(dma2().st(step_stream::NUMBER).cr().read().bits() & step_stream::CURRENT != 0)
}

/// Stream of DMA1 with the requests of TIM2's channel 1 (RM0090 and RM0368, table of the requests of DMA1), all its
/// flags, and its control: channel 3, 32 bits at both ends, to memory, once.
#[cfg(not(feature = "qemu"))]
mod edge_stream {
    pub(super) const NUMBER: usize = 5;
    pub(super) const FLAGS: u32 = 0b11_1101 << 6;
    pub(super) const CONTROL: u32 = 3 << 25 | 0b10 << 16 | 0b10 << 13 | 0b10 << 11;
    pub(super) const ENABLED: u32 = 1;
}

/// Count of the slots at the first edge. The DMA writes it.
#[cfg(not(feature = "qemu"))]
static EDGE: AtomicU32 = AtomicU32::new(0);

/// Lets the DMA fetch the count of the next edge.
#[cfg(not(feature = "qemu"))]
pub(crate) fn start_edge_stream() {
    rcc().ahb1enr().modify(|_, w| w.dma1en().enabled());
    // as for the DMA of the steps
    let _ = rcc().ahb1enr().read();
    let stream = dma1().st(edge_stream::NUMBER);
    let count = tim2().ccr1().as_ptr().expose_provenance() as u32;
    // SAFETY: the stream reads a register of the timer and writes one word, which is atomic and never ends.
    unsafe {
        stream.par().write(|w| w.bits(count));
        stream.m0ar().write(|w| w.bits(EDGE.as_ptr().expose_provenance() as u32));
        stream.ndtr().write(|w| w.bits(1));
        dma1().hifcr().write(|w| w.bits(edge_stream::FLAGS));
        stream.cr().write(|w| w.bits(edge_stream::CONTROL | edge_stream::ENABLED));
    }
    tim2().dier().write(|w| w.cc1de().enabled());
}

/// Lets the DMA fetch no count; an edge that was captured meanwhile is dropped.
#[cfg(not(feature = "qemu"))]
pub(crate) fn stop_edge_stream() {
    let stream = dma1().st(edge_stream::NUMBER);
    // SAFETY: as for the start.
    stream.cr().write(|w| unsafe { w.bits(edge_stream::CONTROL) });
    let _ = (0..100).any(|_| stream.cr().read().bits() & edge_stream::ENABLED == 0);
    tim2().dier().reset();
    tim2().sr().reset();
}

/// Returns the count of the slots at the first edge, if there was one: the stream has ended.
#[cfg(not(feature = "qemu"))]
pub(crate) fn fetched_edge() -> Option<u32> {
    let ended = dma1().st(edge_stream::NUMBER).cr().read().bits() & edge_stream::ENABLED == 0;
    ended.then(|| EDGE.load(Ordering::Acquire))
}

/// Sets the main PLL's dividers `m` (2 … 63) and `q` (2 … 15), and its multiplier `n` (50 … 432), while it is off.
#[cfg(not(feature = "qemu"))]
pub(crate) fn set_pll_factors(m: u8, n: u16, q: u8) {
    // SAFETY: the fields take 6, 9 and 4 bits, which these fill; the clock's table keeps to the ranges of
    // RM0090, 7.3.2.
    rcc().pllcfgr().modify(|_, w| unsafe { w.pllm().bits(m).plln().bits(n).pllq().bits(q) });
}

/// The registers of the USB controller.
pub(crate) struct OtgFs(());

/// Where they begin (RM0090 and RM0368, *Memory map*).
const OTG_FS_BEGINS: usize = 0x5000_0000;

impl OtgFs {
    /// Starts the controller's clock.
    pub(crate) fn start() -> Self {
        rcc().ahb2enr().modify(|_, w| w.otgfsen().enabled());
        let _ = rcc().ahb2enr().read();
        Self(())
    }
}

impl OtgRegisters for OtgFs {
    fn read(&self, offset: u32) -> u32 {
        let address = OTG_FS_BEGINS + offset as usize;
        // SAFETY: an offset is that of a register or a queue of the controller, aligned; the main loop alone uses it.
        unsafe { core::ptr::with_exposed_provenance::<u32>(address).read_volatile() }
    }

    fn write(&self, offset: u32, value: u32) {
        let address = OTG_FS_BEGINS + offset as usize;
        // SAFETY: as for a read; the controller accesses no memory but its own.
        unsafe { core::ptr::with_exposed_provenance_mut::<u32>(address).write_volatile(value) }
    }
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
