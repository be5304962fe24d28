//! The programs of the state machines (RP2040 data sheet, 3.4), as words.
//!
//! Invariant: the words are those of the listings beside them; `pio_model` runs those of the steps in tests.

/// Places a side-set of one bit and a delay into an instruction.
const fn with(instruction: u16, side: u16, delay: u16) -> u16 {
    assert!(side <= 1 && delay <= 15);
    instruction | side << 12 | delay << 8
}

const X: u16 = 1;
const Y: u16 = 2;
const ISR: u16 = 6;

const fn jump(condition: u16, target: u16) -> u16 {
    condition << 5 | target
}
const NOT_Y: u16 = 3;
const X_DECREMENT: u16 = 2;
const Y_DECREMENT: u16 = 4;

const fn out(destination: u16, bits: u16) -> u16 {
    0x6000 | destination << 5 | bits & 31
}
const fn move_from(destination: u16, source: u16) -> u16 {
    0xa000 | destination << 5 | source
}
/// `set y, loops`, with step high: the length of a pulse is [`high_ticks`] of its operand.
#[must_use]
pub const fn set_high_loops(loops: u16) -> u16 {
    assert!(loops <= 31);
    with(0xe000 | Y << 5 | loops, 1, 0)
}
/// Returns `jmp target`.
#[must_use]
pub const fn jump_to(target: u16) -> u16 {
    jump(0, target)
}
/// Returns the ticks that a step is high.
#[must_use]
pub const fn high_ticks(loops: u32) -> u32 {
    1 + 16 * (loops + 1)
}
/// Returns the instruction `set pindirs, 1`, by which a state machine makes its pin an output.
pub const SET_OUTPUT: u16 = 0xe081;

/// Steps and direction of one axis: four state machines run it, each with its own pins.
///
/// One word is one run: `n` pulses of the same interval (`n` = 0: a pause), shifted out bit 0 first. Bit 0 is the level
/// of the direction, bits 1 … 10 are `n`, bits 11 … 30 the delay `d`, and bit 31 marks the last word of a control
/// period. With `h` ticks of step high, `n` pulses take `n (d + 3 + h)` ticks, and 6 ticks more for the word, all of
/// them low, before the first pulse; a pause takes `d + 9` ticks. After the last word the machine waits for the gate.
///
/// ```text
///  0        wait 1 gpio 25   side 0
///  1 run:   out pins, 1      side 0
///  2        out x, 10        side 0
///  3        out isr, 20      side 0
///  4        jmp x-- pulse    side 0
///  5        mov y, isr       side 0
///  6 pause: jmp y-- pause    side 0
///  7        jmp done         side 0
///  8 pulse: mov y, isr       side 0
///  9 low:   jmp y-- low      side 0
/// 10        set y, loops     side 1
/// 11 high:  jmp y-- high     side 1 [15]
/// 12        jmp x-- pulse    side 0
/// 13 done:  out y, 1         side 0
/// 14        jmp !y run       side 0
/// ```
pub const STEPS: [u16; 15] = [
    0x2000 | 1 << 7 | super::pins::GATE_PIN as u16,
    out(0, 1),
    out(X, 10),
    out(ISR, 20),
    jump(X_DECREMENT, 8),
    move_from(Y, ISR),
    jump(Y_DECREMENT, 6),
    jump(0, 13),
    move_from(Y, ISR),
    jump(Y_DECREMENT, 9),
    set_high_loops(19),
    with(jump(Y_DECREMENT, 11), 1, 15),
    jump(X_DECREMENT, 8),
    out(Y, 1),
    jump(NOT_Y, 1),
];
/// Address of `set y, loops` in [`STEPS`].
pub const SET_HIGH_LOOPS_AT: usize = 10;

/// The beginning of every control period, for all axes at once; its side-set pin is the gate.
///
/// One word is one control period: its ticks less [`FRAME_TICKS`]. It is put after the words of the axes, so a period
/// begins when all of them are there.
///
/// ```text
///  0        pull block       side 0
///  1        out y, 32        side 1 [3]
///  2        mov x, x         side 0
///  3 wait:  jmp y-- wait     side 0
/// ```
pub const FRAME: [u16; 4] = [0x80a0, with(out(Y, 32), 1, 3), move_from(X, X), jump(Y_DECREMENT, 3)];
/// Ticks of a control period beyond the word of [`FRAME`].
pub const FRAME_TICKS: u32 = 7;
/// Ticks that the gate is high.
pub const GATE_TICKS: u32 = 4;

/// From an edge of the probe to the beginning of the next control period: counts of two cycles, one word a period at
/// most. Its first input pin is the probe, the pin of its jumps the gate.
///
/// ```text
///  0        wait 0 pin 0
///  1        wait 1 pin 0
///  2        mov x, !null
///  3 count: jmp pin seen
///  4        jmp x-- count
///  5 seen:  mov isr, !x
///  6        push noblock
/// ```
///
/// At [`CAPTURE_RISING_AT`] for a rising edge. The falling one, at [`CAPTURE_FALLING_AT`], waits the other way round.
pub const CAPTURE_RISING: [u16; 7] = capture(CAPTURE_RISING_AT as u16, true);
/// See [`CAPTURE_RISING`].
pub const CAPTURE_FALLING: [u16; 7] = capture(CAPTURE_FALLING_AT as u16, false);
/// Address of [`CAPTURE_RISING`], behind [`FRAME`].
pub const CAPTURE_RISING_AT: usize = FRAME.len();
/// Address of [`CAPTURE_FALLING`].
pub const CAPTURE_FALLING_AT: usize = CAPTURE_RISING_AT + 7;

/// A sample of the spindle's encoder: `in pins, 4`, which is a program of its own. Its first input pin is A.
pub const SAMPLE: u16 = 0x4000 | super::spindle_decoder::BITS_PER_SAMPLE as u16;
/// Address of [`SAMPLE`], behind [`CAPTURE_FALLING`].
pub const SAMPLE_AT: usize = CAPTURE_FALLING_AT + CAPTURE_FALLING.len();
const _: () = assert!(SAMPLE_AT < 32);

const fn capture(at: u16, is_rising: bool) -> [u16; 7] {
    const WAIT_FOR_PIN: u16 = 0x2020;
    const PIN: u16 = 6;
    const NULL: u16 = 3;
    const INVERTED: u16 = 1 << 3;
    const PUSH_WITHOUT_BLOCK: u16 = 0x8000;
    let level = (is_rising as u16) << 7;
    [
        WAIT_FOR_PIN | level ^ 1 << 7,
        WAIT_FOR_PIN | level,
        move_from(X, INVERTED | NULL),
        jump(PIN, at + 5),
        jump(X_DECREMENT, at + 3),
        move_from(ISR, INVERTED | X),
        PUSH_WITHOUT_BLOCK,
    ]
}
