//! The step clock: TIM5 interrupts once per slot (RM0090, 18; RM0368, 13).
//!
//! Invariant: the interrupt is the only context that writes the axes' pins, with one store per slot; it never waits. In
//! QEMU, where a host cannot keep a clock of 100 kHz, it comes once per control period and runs all slots of the period
//! at once: the same code, the same counts, and no pulse shape.

use retrace_firmware::AXES;
use retrace_firmware::stm32f4::period::SLOT_HZ;
use retrace_firmware::stm32f4::step_mailbox::StepMailbox;
use retrace_firmware::stm32f4::steps::Steps;

use super::chip::{self, interrupt};
use super::clock::RATES;
use super::registers::{rcc, set_port_a, set_priority, tim5, unmask};
use crate::board::stopwatch;
use crate::diagnostics::{DIAGNOSTICS, increment};

/// Timer ticks per second.
const TIMER_HZ: u32 = RATES.step_timer;
/// Whether all slots of a period are run at its beginning.
const AT_ONCE: bool = cfg!(feature = "qemu");

/// Step batch of the main loop for the next control period.
pub(crate) static ORDERS: StepMailbox<AXES> = StepMailbox::new();

/// Starts the slots; nothing moves before there is a batch.
pub(super) fn start() {
    rcc().apb1enr().modify(|_, w| w.tim5en().enabled());
    tim5().arr().write(|w| w.arr().set(TIMER_HZ / SLOT_HZ - 1));
    tim5().dier().write(|w| w.uie().enabled());
    tim5().cr1().write(|w| w.cen().enabled());
    set_priority(chip::Interrupt::TIM5, 0);
    unmask(chip::Interrupt::TIM5);
}

/// Handles the beginning of a slot.
#[chip::interrupt]
fn TIM5() {
    static mut STEPS: Steps = Steps::new(TIMER_HZ);
    static mut RUNNING: bool = false;
    let entered = stopwatch::now();
    tim5().sr().write(|w| w.uif().clear_bit());
    match STEPS.next_slot(&ORDERS) {
        Some(mut slot) => {
            if let Some(ticks) = slot.began {
                let mut slots = 1;
                while AT_ONCE && STEPS.in_period() {
                    slots += 1;
                    slot = STEPS.next_slot(&ORDERS).unwrap_or(slot);
                }
                // without preload: the count has only just restarted, so the new end is ahead of it
                tim5().arr().write(|w| w.arr().set((ticks * slots).saturating_sub(1)));
                DIAGNOSTICS.publish(STEPS.counted(), STEPS.refused());
                *RUNNING = true;
            }
            set_port_a(slot.word);
        }
        None => {
            // the main loop was not ready in time: this period begins a slot later
            if *RUNNING {
                *RUNNING = false;
                increment(&DIAGNOSTICS.late_periods);
            }
        }
    }
    DIAGNOSTICS.record_interrupt(stopwatch::between(entered, stopwatch::now()));
}
