//! Steps by state machines: four make the pulses of an axis each, a fifth begins every control period for all of them.
//!
//! Invariant: a period begins when the words of all axes are there, so a late main loop stretches time and loses no
//! pulse. The timing of steps changes only while every machine waits at the gate.

use super::ports;
use super::registers::{Pio, TIMER_NOW};
use crate::diagnostics::DIAGNOSTICS;
use retrace_firmware::AXES;
use retrace_firmware::rp2040::period_clock::PeriodClock;
use retrace_firmware::rp2040::pins::{FIRST_DIRECTION_PIN, FIRST_STEP_PIN, GATE_PIN};
use retrace_firmware::rp2040::pio_programs::{
    FRAME, FRAME_TICKS, SET_HIGH_LOOPS_AT, SET_OUTPUT, STEPS, set_high_loops,
};
use retrace_firmware::rp2040::step_words::{StepAxis, StepTicks, StepWords};
use retrace_firmware::step_batch::{StepBatch, StepShape};

/// The machine of [`Pio::Frame`] that begins the periods.
pub(super) const FRAME_MACHINE: usize = 0;
const ALL_AXES: u32 = (1 << AXES) - 1;
/// In the queues' state, by machine: its queue is empty. In their faults: it has waited for a word.
const QUEUE_EMPTY: u32 = 1 << 24;
const WAITED: u32 = 1 << 24;

/// The step generator.
pub(super) struct StepGenerator {
    axes: [StepAxis; AXES],
    shape: StepShape,
    ticks: StepTicks,
    /// A batch with another shape, which waits until all machines do.
    pending: Option<StepShape>,
    /// Whether the period before began with its words, so that a wait of the frame's machine is a late period.
    running: bool,
    /// Net pulses of each axis passed to the machines, wrapping around.
    counted: [i32; AXES],
    /// Batches whose pulses did not fit their period.
    refused: u32,
    /// Periods that began late because their words were not there.
    late: u32,
    /// Whether the last period began late.
    began_late: bool,
    clock: PeriodClock,
}

impl StepGenerator {
    /// Starts the state machines; nothing moves before there is a batch.
    pub(super) fn start() -> Self {
        load(Pio::Steps, &STEPS);
        load(Pio::Frame, &FRAME);
        let generator = Self {
            axes: [const { StepAxis::new() }; AXES],
            shape: StepShape::INITIAL,
            ticks: StepTicks::of(&StepShape::INITIAL),
            pending: None,
            running: false,
            counted: [0; AXES],
            refused: 0,
            late: 0,
            began_late: false,
            clock: PeriodClock::new(),
        };
        generator.set_ticks();
        for axis in 0..AXES {
            prepare(Pio::Steps, axis, FIRST_STEP_PIN + axis as u8, FIRST_DIRECTION_PIN + axis as u8, STEPS.len());
        }
        prepare(Pio::Frame, FRAME_MACHINE, GATE_PIN, GATE_PIN, FRAME.len());
        // the machines drive their pins low by now
        ports::connect_machines();
        Pio::Steps.control().write(ALL_AXES | ALL_AXES << 4 | ALL_AXES << 8);
        Pio::Frame.control().write(0x111);
        generator
    }

    /// Ends all steps at once; the pins are set low by the ports.
    pub(super) fn stop() {
        Pio::Steps.control().write(0);
        Pio::Frame.control().write(0);
    }

    /// Waits until the gate of a period that has just begun is low again: 6 ticks, 150 cycles at most.
    pub(super) fn wait_behind_gate() {
        let is_high = || matches!(Pio::Frame.address(FRAME_MACHINE).read(), 1 | 2);
        let _ = (0..150).find(|_| !is_high());
    }

    /// Returns the planned cycles of the period before the one that is being made, and whether that began later.
    pub(super) const fn last_period(&self) -> (u32, bool) {
        (self.ticks.period * self.ticks.divider, self.began_late)
    }

    /// Returns when the period has begun that is being made ([`PeriodClock::begun_us`]), and its length, in
    /// microseconds.
    pub(super) fn begun_us(&mut self) -> (u32, u32) {
        let period_us = self.shape.period_us;
        (self.clock.begun_us(TIMER_NOW.read(), period_us), period_us)
    }

    /// Whether the batch of the next control period can be put. Changes the timing of steps once all machines wait.
    pub(super) fn can_put(&mut self) -> bool {
        match self.pending {
            None => Pio::Frame.queue_status().has(QUEUE_EMPTY << FRAME_MACHINE),
            Some(shape) if machines_wait() => {
                self.pending = None;
                self.shape = shape;
                self.ticks = StepTicks::of(&shape);
                self.set_ticks();
                self.running = false;
                self.put_words(&[0; AXES]);
                false
            }
            Some(_) => false,
        }
    }

    /// Puts the batch of the next control period. One with another shape has no pulses, and waits.
    pub(super) fn put(&mut self, batch: &StepBatch<AXES>) {
        if batch.shape == self.shape {
            self.put_words(&batch.increments);
        } else {
            self.pending = Some(batch.shape);
        }
    }

    fn put_words(&mut self, increments: &[i32; AXES]) {
        for (axis, &increment) in increments.iter().enumerate() {
            let words = self.words(axis, increment);
            for &word in words.as_slice() {
                Pio::Steps.queue(axis).write(word);
            }
        }
        self.began_late = Pio::Frame.queue_faults().has(WAITED << FRAME_MACHINE);
        if self.running && self.began_late {
            self.late = self.late.wrapping_add(1);
        }
        self.running = true;
        // last: with it the period may begin
        Pio::Frame.queue(FRAME_MACHINE).write(self.ticks.period - FRAME_TICKS);
        self.clock.put(TIMER_NOW.read(), self.began_late, self.shape.period_us);
        Pio::Frame.queue_faults().write(WAITED << FRAME_MACHINE);
        DIAGNOSTICS.publish(&self.counted, self.refused, self.late);
    }

    fn words(&mut self, axis: usize, increment: i32) -> StepWords {
        let inverted = self.shape.inverted >> axis & 1 == 1;
        match self.axes[axis].begin_period(&self.ticks, increment, inverted) {
            Ok(words) => {
                self.counted[axis] = self.counted[axis].wrapping_add(increment);
                words
            }
            Err(_) => {
                self.refused = self.refused.wrapping_add(1);
                self.axes[axis].rest(&self.ticks, inverted)
            }
        }
    }

    /// Sets the length of a step and the machines' clock.
    fn set_ticks(&self) {
        let instruction = set_high_loops(self.ticks.high_loops as u16);
        Pio::Steps.instruction(SET_HIGH_LOOPS_AT).write(u32::from(instruction));
        for axis in 0..AXES {
            Pio::Steps.divider(axis).write(self.ticks.divider << 16);
        }
        Pio::Frame.divider(FRAME_MACHINE).write(self.ticks.divider << 16);
    }
}

/// Whether no machine has a word, and each waits for one or for the gate.
fn machines_wait() -> bool {
    Pio::Steps.queue_status().has(ALL_AXES * QUEUE_EMPTY)
        && Pio::Frame.queue_status().has(QUEUE_EMPTY << FRAME_MACHINE)
        && (0..AXES).all(|axis| Pio::Steps.address(axis).read() == 0)
        && Pio::Frame.address(FRAME_MACHINE).read() == 0
}

fn load(pio: Pio, program: &[u16]) {
    for (at, &word) in program.iter().enumerate() {
        pio.instruction(at).write(u32::from(word));
    }
}

/// Prepares a machine: its side-set pin and its pin for `out` become outputs, low; it shifts to the right, fetches
/// words by itself if it is one of the axes, and has one queue of eight words.
fn prepare(pio: Pio, machine: usize, side: u8, out: u8, length: usize) {
    let (side, out) = (u32::from(side), u32::from(out));
    pio.execution(machine).write((length as u32 - 1) << 12);
    pio.shifting(machine).write(1 << 30 | 1 << 19 | 1 << 18 | u32::from(pio == Pio::Steps) << 17);
    for pin in [side, out] {
        pio.pins(machine).write(1 << 26 | pin << 5);
        pio.execute(machine).write(u32::from(SET_OUTPUT));
    }
    pio.pins(machine).write(1 << 29 | 1 << 20 | side << 10 | out);
    // jump to the begin of the program
    pio.execute(machine).write(0);
}
