//! The main loop, and the halt after a defect of the firmware itself.
//!
//! Invariant: a step batch is computed only when there is space for it, so that none is ever lost; a delay stretches
//! time, not the path. A step generator that takes no more batches ends in the halt, with every output low.

use core::mem::MaybeUninit;

use retrace_card::{InputLevels, LentCard};
use retrace_core::Record;
use retrace_firmware::step_batch::{StepBatch, StepShape};
use retrace_firmware::{AXES, ENTRIES, MEMORY, WINDOW, boot};
use retrace_link::CardIdentity;
use retrace_link::wire::ReportEntry;

use crate::board::{Board, ThisBoard, stopwatch};
use crate::diagnostics::DIAGNOSTICS;

/// Number of bytes fetched from the card at a time.
const CHUNK: usize = 64;
/// Cycles without space for a step batch after which the step generator has failed: 70 ms at 168 MHz, 140 ms at 84 MHz,
/// longer than the two longest control periods. The card's own time is that of the periods, so without them no
/// watchdog of the card would switch a cutter off.
const STEP_GENERATOR_TIMEOUT: u32 = 12_000_000;

type Card = LentCard<AXES, WINDOW, MEMORY, ENTRIES>;

#[cortex_m_rt::entry]
fn main() -> ! {
    static mut CARD: MaybeUninit<Card> = MaybeUninit::uninit();
    static mut RECORDS: [Record<AXES>; WINDOW] = [Record::ZERO; WINDOW];
    static mut REPORT_ENTRIES: [ReportEntry; ENTRIES] = [ReportEntry::NOTHING; ENTRIES];
    let mut board = ThisBoard::start();
    let starts = board.count_start();
    DIAGNOSTICS.mark_valid();
    // Nothing is to be done before the first byte from the host; its arrival time makes the number of this start.
    while board.line_is_silent() {
        board.feed_watchdog();
    }
    let boot = boot::boot_number(starts, board.cycles());
    let serial = boot::serial_number(board.unique_number());
    let card = create_card(CARD, CardIdentity { serial, boot, ..ThisBoard::IDENTITY });
    card.lend_memory(RECORDS, REPORT_ENTRIES);
    run(card, board)
}

/// Creates the card in its place. As a constant it would be 13 KB of flash, most of them zeros; its large arrays are
/// stored separately. It passes over the stack, of which this is the deepest place.
#[inline(never)]
fn create_card(place: &'static mut MaybeUninit<Card>, identity: CardIdentity) -> &'static mut Card {
    match Card::without_memory(identity) {
        Some(card) => place.write(card),
        None => halt(),
    }
}

/// The main loop.
#[inline(never)]
fn run(card: &mut Card, mut board: ThisBoard) -> ! {
    let mut steps = Steps { shape: StepShape::INITIAL, rest: 0 };
    let mut sender = Sender { bytes: [0; CHUNK], at: 0, end: 0 };
    let mut last_period = board.cycles();
    loop {
        board.feed_watchdog();
        // between commands, so that a frame of many does not make a period late
        if board.can_put_steps() {
            run_period(card, &mut board, &mut steps);
            last_period = board.cycles();
        } else if stopwatch::between(last_period, board.cycles()) > STEP_GENERATOR_TIMEOUT {
            halt();
        }
        if !card.process_command()
            && let Some(byte) = board.receive()
        {
            card.receive_byte(byte);
        }
        sender.send(card, &mut board);
    }
}

/// State of the control periods.
struct Steps {
    /// Step timing of the last batch.
    shape: StepShape,
    /// Cycles of computation that are not counted yet.
    rest: u32,
}

/// Computes a control period and puts its step batch. If an opening has changed the step timing, a period without
/// pulses precedes it, so that the directions are stable.
fn run_period(card: &mut Card, board: &mut ThisBoard, steps: &mut Steps) {
    if let Some(wanted) = card.settings().map(|settings| StepShape::of(settings.settings()))
        && wanted != steps.shape
    {
        steps.shape = wanted;
        board.put_steps(&StepBatch { increments: [0; AXES], shape: wanted });
        return;
    }
    let (began, interrupts) = (board.cycles(), DIAGNOSTICS.interrupt_cycles());
    let levels = board.input_levels();
    let (levels, probe) = board.read_probe(levels);
    let (encoder, analog) = (board.encoder(), board.analog_inputs());
    let spindle = board.read_spindle(card.settings().is_some_and(|settings| settings.settings().spindle.is_some()));
    let inputs = InputLevels { levels, encoder, spindle, analog, probe, ..InputLevels::default() };
    let status = card.run_period(inputs);
    board.set_outputs(&status.outputs);
    board.set_spindle_pwm(card.card().spindle_pwm());
    board.put_steps(&StepBatch { increments: *card.card().pulses(), shape: steps.shape });
    board.await_probe(card.card().awaited_probe());
    let interrupted = DIAGNOSTICS.interrupt_cycles().wrapping_sub(interrupts);
    let cycles = stopwatch::between(began, board.cycles());
    DIAGNOSTICS.record_period(cycles.saturating_sub(interrupted), &mut steps.rest);
}

/// Bytes of the card that wait for the transmitter.
struct Sender {
    bytes: [u8; CHUNK],
    at: usize,
    end: usize,
}

impl Sender {
    /// Sends one byte, if one is available and the transmitter is ready.
    fn send(&mut self, card: &mut Card, board: &mut ThisBoard) {
        if self.at == self.end {
            (self.at, self.end) = (0, card.transmit(&mut self.bytes).min(CHUNK));
        }
        if self.at < self.end && board.can_send() {
            board.send(self.bytes[self.at]);
            self.at += 1;
        }
    }
}

/// Halts the firmware: no interrupt, no step, every output low. Only a reset ends this state; the host then finds a
/// restarted card.
pub(crate) fn halt() -> ! {
    cortex_m::interrupt::disable();
    ThisBoard::set_all_low();
    loop {
        cortex_m::asm::nop();
    }
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    halt()
}
