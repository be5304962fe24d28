//! The steps: TIM1 asks the DMA once a slot to write the next word of a buffer to the port of the axes (RM0090, 10 and
//! 17; RM0368, 9 and 12).
//!
//! Invariant: while one buffer is played, the interrupt at the end of the other one fills that. The DMA goes round and
//! round: an interrupt that is late by a whole buffer would let it make old steps again, so the firmware halts then. No
//! other stream of DMA2 is used (erratum of these chips: streams to AHB and APB at the same time).
//!
//! QEMU has neither this DMA nor the port. There a timer interrupts once a buffer, and the processor plays the buffer
//! to a counter: the same buffers, the same counts, without their times.

use retrace_firmware::AXES;
use retrace_firmware::stm32f4::step_filler::{SlotBuffer, StepFiller, empty_buffer};
use retrace_firmware::stm32f4::step_mailbox::StepMailbox;

use super::chip::{self, interrupt};
use super::registers::{set_priority, unmask};
use crate::board::stopwatch;
use crate::diagnostics::DIAGNOSTICS;

/// Step batch of the main loop for the next control period.
pub(crate) static ORDERS: StepMailbox<AXES> = StepMailbox::new();

/// The buffers that the DMA plays.
static BUFFERS: [SlotBuffer; 2] = [const { empty_buffer() }; 2];

/// Less urgent than the received bytes: the line has room for one, the DMA for a buffer.
const PRIORITY: u8 = 1;

#[cfg(not(feature = "qemu"))]
mod stream {
    //! The DMA.
    //!
    //! Invariant: the buffers hold no steps when it starts.

    use super::*;
    use crate::board::stm32f4::clock::RATES;
    use crate::board::stm32f4::registers::{self, tim1};
    use crate::board::stm32f4::slot_counter;
    use retrace_firmware::stm32f4::period::SLOT_HZ;

    /// Starts the slots; nothing moves before there is a batch.
    pub(crate) fn start() {
        registers::start_step_stream(&BUFFERS);
        set_priority(chip::Interrupt::DMA2_STREAM5, PRIORITY);
        unmask(chip::Interrupt::DMA2_STREAM5);
        registers::rcc().apb2enr().modify(|_, w| w.tim1en().enabled());
        // as for the DMA
        let _ = registers::rcc().apb2enr().read();
        tim1().arr().write(|w| w.arr().set((RATES.slot_timer / SLOT_HZ - 1) as u16));
        slot_counter::start(RATES.slot_timer / SLOT_HZ);
        tim1().dier().write(|w| w.ude().enabled());
        tim1().cr1().write(|w| w.cen().enabled());
    }

    /// Ends the slots at once: no word is written to the port any more.
    pub(crate) fn stop() {
        tim1().cr1().write(|w| w.cen().disabled());
        tim1().dier().write(|w| w.ude().disabled());
        registers::stop_step_stream();
    }

    /// Handles the end of a buffer.
    #[interrupt]
    fn DMA2_STREAM5() {
        static mut FILLER: StepFiller = StepFiller::new();
        // the buffer that is to be filled
        static mut NEXT: usize = 0;
        let entered = stopwatch::now();
        let played = registers::end_of_step_buffer();
        if played == *NEXT {
            // the other one has ended, too
            crate::halt();
        }
        FILLER.fill(&BUFFERS[*NEXT], &ORDERS);
        *NEXT = 1 - *NEXT;
        DIAGNOSTICS.publish(FILLER.counted(), FILLER.refused(), FILLER.late());
        DIAGNOSTICS.record_interrupt(stopwatch::between(entered, stopwatch::now()));
    }
}

#[cfg(feature = "qemu")]
mod stream {
    //! A timer in the place of the DMA.
    //!
    //! Invariant: each buffer is played once, after it was filled.

    use super::*;
    use crate::board::stm32f4::clock::RATES;
    use crate::board::stm32f4::registers::{rcc, tim5};
    use crate::board::stm32f4::serial;
    use retrace_firmware::stm32f4::period::{BUFFER_SLOTS, SLOT_HZ};
    use retrace_firmware::stm32f4::port_counter::PortCounter;

    /// Starts the slots; nothing moves before there is a batch.
    pub(crate) fn start() {
        rcc().apb1enr().modify(|_, w| w.tim5en().enabled());
        tim5().arr().write(|w| w.arr().set(RATES.slot_timer / SLOT_HZ * BUFFER_SLOTS as u32 - 1));
        tim5().dier().write(|w| w.uie().enabled());
        tim5().cr1().write(|w| w.cen().enabled());
        set_priority(chip::Interrupt::TIM5, PRIORITY);
        unmask(chip::Interrupt::TIM5);
    }

    /// Nothing to end: only this interrupt writes the port.
    pub(crate) fn stop() {}

    /// Handles the beginning of a buffer.
    #[interrupt]
    fn TIM5() {
        static mut FILLER: StepFiller = StepFiller::new();
        static mut COUNTER: PortCounter = PortCounter::new();
        tim5().sr().write(|w| w.uif().clear_bit());
        serial::bit_rate::buffer_played();
        let entered = stopwatch::now();
        FILLER.fill(&BUFFERS[0], &ORDERS);
        DIAGNOSTICS.record_interrupt(stopwatch::between(entered, stopwatch::now()));
        COUNTER.play(&BUFFERS[0], FILLER.inverted());
        // what a drive counts, not what the filler does
        DIAGNOSTICS.publish(COUNTER.counts(), FILLER.refused(), FILLER.late());
    }
}

pub(super) use stream::{start, stop};
