//! A model of one state machine that runs the program of an axis, for tests (RP2040 data sheet, 3.4).
//!
//! Invariant: it executes the words of the program, tick by tick, and knows nothing of what they are for.

use std::collections::VecDeque;

/// A state machine with autopull at 32 bits, shifting to the right, with one side-set pin and one pin for `out`.
pub(super) struct StateMachine {
    program: Vec<u16>,
    address: usize,
    x: u32,
    y: u32,
    isr: u32,
    osr: u32,
    /// Bits of `osr` that were shifted out.
    shifted: u32,
    delay: u32,
    pub(super) queue: VecDeque<u32>,
    /// Levels of the side-set pin and of the pin for `out`.
    pub(super) side: bool,
    pub(super) pin: bool,
}

impl StateMachine {
    pub(super) fn new(program: &[u16]) -> Self {
        Self {
            program: program.to_vec(),
            address: 0,
            x: 0,
            y: 0,
            isr: 0,
            osr: 0,
            shifted: 32,
            delay: 0,
            queue: VecDeque::new(),
            side: false,
            pin: false,
        }
    }

    /// Whether it waits for the gate and has no word left.
    pub(super) fn is_idle(&self) -> bool {
        self.address == 0 && self.queue.is_empty() && self.delay == 0
    }

    /// Runs one tick.
    pub(super) fn tick(&mut self, gate: bool) {
        if self.delay > 0 {
            self.delay -= 1;
            return;
        }
        let word = u32::from(self.program[self.address]);
        self.side = word >> 12 & 1 == 1;
        let (operation, argument, low) = (word >> 13, word >> 5 & 7, word & 31);
        let mut next = if self.address + 1 == self.program.len() { 0 } else { self.address + 1 };
        match operation {
            0 if self.is_met(argument) => next = low as usize,
            0 => {}
            // wait for gpio
            1 if argument == 0b100 => {
                if !gate {
                    return;
                }
            }
            3 => {
                let Some(bits) = self.shift(if low == 0 { 32 } else { low }) else { return };
                match argument {
                    0 => self.pin = bits & 1 == 1,
                    1 => self.x = bits,
                    2 => self.y = bits,
                    6 => self.isr = bits,
                    _ => panic!("out to {argument}"),
                }
            }
            5 if (argument, low) == (2, 6) => self.y = self.isr,
            7 if argument == 2 => self.y = low,
            _ => panic!("the model has no {word:#06x}"),
        }
        self.delay = word >> 8 & 15;
        self.address = next;
    }

    /// Shifts out bits; `None` while there is no word.
    fn shift(&mut self, count: u32) -> Option<u32> {
        if self.shifted >= 32 {
            self.osr = self.queue.pop_front()?;
            self.shifted = 0;
        }
        let bits = if count == 32 { self.osr } else { self.osr & ((1 << count) - 1) };
        self.osr = self.osr.checked_shr(count).unwrap_or(0);
        self.shifted += count;
        Some(bits)
    }

    fn is_met(&mut self, condition: u32) -> bool {
        match condition {
            0 => true,
            2 => {
                self.x = self.x.wrapping_sub(1);
                self.x != u32::MAX
            }
            3 => self.y == 0,
            4 => {
                self.y = self.y.wrapping_sub(1);
                self.y != u32::MAX
            }
            _ => panic!("jmp if {condition}"),
        }
    }
}
