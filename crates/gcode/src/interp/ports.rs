//! Outputs, inputs and user codes: M62 to M68, M100 to M199.
//!
//! Invariant: an output or input is a number of at least 0. Only user codes that the machine has declared are executed.

use super::cutting::{PIERCE_VALUE, SELECT_MATERIAL};
use super::interpreter_core::{Core, Emitter};
use crate::block::Words;
use crate::canon::{Canon, WaitFor, WaitForInput, WaitInput};
use crate::diag::{BlockResult, fault};
use crate::error_codes::ErrorCode;
use crate::eval::to_whole_number;
use crate::groups::GroupM;
use crate::params::INPUT;
use crate::unknown::UNKNOWN;

impl Core {
    /// Executes M62 … M68.
    pub(super) fn port(&mut self, code: u8, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        match code {
            62..=65 if self.cutting_switch(code, words, emit) => Ok(()),
            62..=65 => digital_output(code, words, emit),
            66 => self.wait(words, emit),
            _ if self.velocity_share(words, emit) => Ok(()),
            _ => analog_output(code, words, emit),
        }
    }

    /// Executes M66. Without a machine, the result is unknown, or 0 as in LinuxCNC's stand-alone interpreter.
    fn wait(&mut self, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        let at = words.m_span(GroupM::Output);
        let input = match (words.has(b'p'), words.has(b'e')) {
            (true, true) => return fault(ErrorCode::InputChoice, at, "M66 reads one input, not both P and E"),
            (true, false) => WaitInput::Digital(port_number(words, b'p', "input")?),
            (false, true) => WaitInput::Analog(port_number(words, b'e', "input")?),
            (false, false) => {
                return fault(ErrorCode::WordMissing, at, "M66 needs P, a digital input, or E, an analog one");
            }
        };
        let wait_for = match words.get(b'l').unwrap_or_default() as u32 {
            0 => WaitFor::Immediate,
            1 => WaitFor::Rise,
            2 => WaitFor::Fall,
            3 => WaitFor::High,
            4 => WaitFor::Low,
            other => return fault(ErrorCode::BadL, words.span(b'l'), format!("M66 accepts L0 to L4, not L{other}")),
        };
        let timeout = words.get(b'q').unwrap_or_default();
        if wait_for != WaitFor::Immediate {
            if timeout <= 0.0 {
                return fault(ErrorCode::WaitTimeout, at, ErrorCode::WaitTimeout.title());
            }
            if matches!(input, WaitInput::Analog(_)) {
                return fault(
                    ErrorCode::InputChoice,
                    words.span(b'l'),
                    "M66 cannot wait for an analog input: write L0",
                );
            }
        }
        if self.waits_for_material(input, wait_for) {
            self.parameters.set(INPUT, 1.0);
            return Ok(());
        }
        emit.call(Canon::Wait(WaitForInput { input, wait_for, timeout: timeout.max(0.0) }));
        self.parameters.set(INPUT, if self.follows_unknown { UNKNOWN } else { 0.0 });
        Ok(())
    }

    /// Replaces the assumed result of the last M66 by the machine's.
    pub(super) fn resolve_input(&mut self, value: f64) {
        self.parameters.set(INPUT, value);
    }

    /// Executes M100 … M199.
    pub(super) fn user_code(&mut self, code: u8, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        match code {
            SELECT_MATERIAL if self.cutting.is_some() => return self.select_material(words, emit),
            PIERCE_VALUE if self.cutting.is_some() => return self.pierce_value(words, emit),
            _ => {}
        }
        if !self.user_codes.has(code) {
            let message = format!("M{code} is not declared for this machine");
            return fault(ErrorCode::UserCodeUndeclared, words.m_span(GroupM::User), message);
        }
        emit.call(Canon::UserCode { number: code, p: words.get(b'p'), q: words.get(b'q') });
        Ok(())
    }
}

/// Executes M62 … M65 for the output that P names.
fn digital_output(code: u8, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
    if !words.has(b'p') {
        let at = words.m_span(GroupM::Output);
        return fault(ErrorCode::WordMissing, at, format!("M{code} needs a P word: the output"));
    }
    let bit = port_number(words, b'p', "output")?;
    emit.call(match code {
        62 => Canon::SetMotionOutputBit(bit),
        63 => Canon::ClearMotionOutputBit(bit),
        64 => Canon::SetAuxOutputBit(bit),
        _ => Canon::ClearAuxOutputBit(bit),
    });
    Ok(())
}

/// Executes M67 and M68: sets the output that E names to the value of Q.
fn analog_output(code: u8, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
    let at = words.m_span(GroupM::Output);
    let Some(value) = words.get(b'q') else {
        return fault(ErrorCode::WordMissing, at, format!("M{code} needs a Q word: the value"));
    };
    if !words.has(b'e') {
        return fault(ErrorCode::WordMissing, at, format!("M{code} needs an E word: the output"));
    }
    let output = port_number(words, b'e', "output")?;
    emit.call(match code {
        67 => Canon::SetMotionOutputValue { output, value },
        _ => Canon::SetAuxOutputValue { output, value },
    });
    Ok(())
}

fn port_number(words: &Words, letter: u8, kind: &str) -> BlockResult<i32> {
    let name = if letter == b'p' { "P" } else { "E" };
    let at = words.span(letter);
    match to_whole_number(words.get(letter).unwrap_or_default(), at, name)? {
        number @ 0.. => Ok(number),
        number => fault(ErrorCode::NegativeValue, at, format!("there is no {kind} {number}")),
    }
}
