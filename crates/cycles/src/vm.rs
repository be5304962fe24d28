//! The virtual machine that runs compiled cycles over a host.
//!
//! Invariant: a run ends, whatever the code is: steps, blocks and depth are bounded. Once its buffers have grown, it
//! does not allocate.

mod block;
mod calculate;
mod messages;
mod state;

use crate::alarm::{Alarm, CycleRunError};
use crate::code::{Op, Passed, converted};
use crate::cycle::{ArgumentKind, Cycle, CycleId};
use crate::error_codes::ErrorCode;
use crate::host::{CycleBlock, Host};
use crate::library::CycleLibrary;
use crate::parameter::Type;

/// Argument of a call.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Argument<'a> {
    /// An empty argument: not programmed.
    Missing,
    /// A number.
    Number(f64),
    /// A text.
    Text(&'a str),
}

/// Limits of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VmLimits {
    /// Maximum number of instructions; every block refunds some of them.
    pub steps: u32,
    /// Maximum number of blocks.
    pub blocks: u32,
    /// Maximum depth of cycles that call each other.
    pub depth: usize,
}

/// Instructions that a block refunds. A cycle that continues to emit blocks has enough steps for them; one that idles
/// between them still ends.
const STEPS_OF_A_BLOCK: u32 = 200;

impl Default for VmLimits {
    /// Ten million steps, a million blocks, a depth of twelve.
    fn default() -> Self {
        Self { steps: 10_000_000, blocks: 1_000_000, depth: 12 }
    }
}

/// A value on the stack or in a slot.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Value {
    Number(f64),
    Text(TextPlace),
}

/// Storage of a text, so that values need no lifetime.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TextPlace {
    Empty,
    /// Among the arguments of the run.
    Argument(u16),
    /// Among the texts of a cycle.
    Constant(CycleId, u16),
}

/// A running cycle.
#[derive(Clone, Copy, Debug)]
struct Frame {
    cycle: CycleId,
    /// Next instruction.
    at: usize,
    /// First slot.
    base: usize,
    /// Parameters that the call passed, one bit each.
    programmed: u64,
}

/// Reason why a step ends the run: an alarm without its place, or the host.
enum VmTrap {
    Alarm(ErrorCode, Option<u32>, String),
    Stopped,
}

/// Result of a step.
type Step<T = ()> = Result<T, Box<VmTrap>>;

#[cold]
fn trap<T>(code: ErrorCode, text: impl Into<String>) -> Step<T> {
    Err(Box::new(VmTrap::Alarm(code, None, text.into())))
}

/// Virtual machine that runs cycles, one at a time; its buffers are reused from run to run.
#[derive(Debug)]
pub struct Vm {
    stack: Vec<Value>,
    slots: Vec<Value>,
    frames: Vec<Frame>,
    message: String,
    block: CycleBlock,
    limits: VmLimits,
    /// Steps that remain.
    steps: u32,
    blocks: u32,
}

impl Default for Vm {
    fn default() -> Self {
        Self::new(VmLimits::default())
    }
}

/// A run: the virtual machine with the data that it works on.
struct VmRun<'r> {
    vm: &'r mut Vm,
    library: &'r CycleLibrary,
    arguments: &'r [Argument<'r>],
    host: &'r mut dyn Host,
}

impl Vm {
    /// Creates a virtual machine with these limits.
    #[must_use]
    pub fn new(limits: VmLimits) -> Self {
        Self {
            stack: Vec::with_capacity(64),
            slots: Vec::with_capacity(256),
            frames: Vec::with_capacity(limits.depth.min(64)),
            message: String::with_capacity(256),
            block: CycleBlock::new(CycleId(0), 0),
            limits,
            steps: 0,
            blocks: 0,
        }
    }

    /// Returns a lower bound of the cost of the last run: its blocks, and the steps that they have not refunded.
    #[must_use]
    pub fn cost(&self) -> u64 {
        u64::from(self.steps) + u64::from(self.blocks)
    }

    /// Runs a cycle of the library to its end.
    ///
    /// # Errors
    /// The cycle raised an alarm, or the host stopped.
    pub fn run(
        &mut self,
        library: &CycleLibrary,
        cycle: CycleId,
        arguments: &[Argument<'_>],
        host: &mut dyn Host,
    ) -> Result<(), CycleRunError> {
        self.stack.clear();
        self.slots.clear();
        self.frames.clear();
        self.message.clear();
        (self.steps, self.blocks) = (0, 0);
        let mut run = VmRun { vm: self, library, arguments, host };
        let mut place = (cycle, 0);
        run.begin(cycle).and_then(|()| run.run_to_end(&mut place)).map_err(|trap| match *trap {
            VmTrap::Stopped => CycleRunError::Stopped,
            VmTrap::Alarm(code, number, text) => {
                let (cycle, line) = place;
                CycleRunError::Alarm(Box::new(Alarm { code, number, cycle, line, text }))
            }
        })
    }
}

impl<'r> VmRun<'r> {
    /// Enters the cycle that was called from outside.
    fn begin(&mut self, id: CycleId) -> Step {
        let Some(cycle) = self.library.get(id) else {
            return trap(ErrorCode::CycleUnknown, "the cycle is not in this library");
        };
        let parameters = cycle.parameters();
        let given = self.arguments.iter().map(|argument| match argument {
            Argument::Missing => ArgumentKind::Empty,
            Argument::Number(_) => ArgumentKind::Number,
            Argument::Text(_) => ArgumentKind::Text,
        });
        if let Some(text) = cycle.argument_mismatch(given) {
            return trap(ErrorCode::BadArgument, text);
        }
        let mut programmed = 0;
        for (index, parameter) in parameters.iter().enumerate() {
            let argument = self.arguments.get(index).copied().unwrap_or(Argument::Missing);
            let value = match (argument, parameter.value_type) {
                (Argument::Missing, Type::Text(_)) => Value::Text(TextPlace::Empty),
                (Argument::Missing, _) => Value::Number(parameter.default),
                (Argument::Text(text), Type::Text(length)) if text.len() <= usize::from(length) => {
                    Value::Text(TextPlace::Argument(index as u16))
                }
                (Argument::Number(number), Type::Real | Type::Int | Type::Bool) if number.is_finite() => {
                    Value::Number(converted(parameter.value_type, number))
                }
                _ => {
                    let text = format!("{}: {} is too long or not a finite number", cycle.name(), parameter.name);
                    return trap(ErrorCode::BadArgument, text);
                }
            };
            programmed |= u64::from(argument != Argument::Missing) << (index & 63);
            self.vm.slots.push(value);
        }
        self.enter(cycle, id, 0, programmed);
        Ok(())
    }

    /// Creates the frame of a cycle whose parameters are in the slots from `base`.
    fn enter(&mut self, cycle: &Cycle, id: CycleId, base: usize, programmed: u64) {
        self.vm.slots.resize(base + usize::from(cycle.unit.slots), Value::Number(0.0));
        self.vm.frames.push(Frame { cycle: id, at: 0, base, programmed });
        self.host.enter(cycle);
    }

    /// Executes instructions until the outermost cycle ends; `place` is the current line, for alarms.
    fn run_to_end(&mut self, place: &mut (CycleId, u32)) -> Step {
        while let Some(mut frame) = self.vm.frames.last().copied() {
            let Some(cycle) = self.library.get(frame.cycle) else {
                return trap(ErrorCode::CycleUnknown, "the cycle is not in this library");
            };
            let depth = self.vm.frames.len();
            // Stays in one frame until another is created.
            while self.vm.frames.len() == depth {
                let op = cycle.unit.ops.get(frame.at).copied().unwrap_or(Op::Return);
                *place = (frame.cycle, cycle.unit.lines.get(frame.at).copied().unwrap_or(place.1));
                frame.at += 1;
                self.step(op, &mut frame, cycle, place.1)?;
            }
        }
        Ok(())
    }

    /// Executes one instruction.
    fn step(&mut self, op: Op, frame: &mut Frame, cycle: &'r Cycle, line: u32) -> Step {
        self.vm.steps += 1;
        if self.vm.steps > self.vm.limits.steps {
            return trap(ErrorCode::Endless, format!("{} has no end", cycle.name()));
        }
        match op {
            Op::Number(number) => self.push(number),
            Op::Text(index) => self.vm.stack.push(Value::Text(TextPlace::Constant(frame.cycle, index))),
            Op::Load(slot) => {
                let value = self.vm.slots.get(frame.base + usize::from(slot)).copied();
                self.vm.stack.push(value.unwrap_or(Value::Number(0.0)));
            }
            Op::Store(slot, of) => {
                let value = self.pop();
                self.store(frame.base + usize::from(slot), of, value)?;
            }
            Op::Operate(operator) => self.operate(operator)?,
            Op::Jump(target) => frame.at = target as usize,
            Op::JumpIfNot(target) => {
                if self.number() == 0.0 {
                    frame.at = target as usize;
                }
            }
            Op::JumpIf(target) => {
                if self.number() != 0.0 {
                    frame.at = target as usize;
                }
            }
            Op::CallCycle(site) => self.call(usize::from(site), *frame, cycle)?,
            Op::Return => {
                self.vm.slots.truncate(frame.base);
                self.vm.frames.pop();
                return self.host.leave(cycle).map_err(|_| Box::new(VmTrap::Stopped));
            }
            Op::Call1(function) => self.function(function)?,
            Op::LoadAt(..) | Op::StoreAt(..) | Op::Element(..) => self.array(op, frame)?,
            Op::CompareTexts(unequal) => {
                let (b, a) = (self.pop(), self.pop());
                let equal = self.text(a) == self.text(b);
                self.push(f64::from(equal != unequal));
            }
            Op::Programmed => {
                let number = self.number();
                let bit = if (1.0..=64.0).contains(&number) { frame.programmed >> (number as u32 - 1) & 1 } else { 0 };
                self.push(bit as f64);
            }
            Op::Clear | Op::Join | Op::Show | Op::Raise => self.message_op(op, frame.cycle, line)?,
            Op::StockPath => self.stock_path()?,
            Op::StockRead => self.stock_read()?,
            _ => self.block_op(op, frame, cycle, line)?,
        }
        Ok(())
    }

    fn push(&mut self, number: f64) {
        self.vm.stack.push(Value::Number(number));
    }

    /// Pops a value; 0 from an empty stack, which compiled code excludes.
    fn pop(&mut self) -> Value {
        self.vm.stack.pop().unwrap_or(Value::Number(0.0))
    }

    /// Pops a number; a text is 0.
    fn number(&mut self) -> f64 {
        match self.pop() {
            Value::Number(number) => number,
            Value::Text(_) => 0.0,
        }
    }

    /// Returns the text of a value; a number has none.
    fn text(&self, value: Value) -> &'r str {
        match value {
            Value::Number(_) | Value::Text(TextPlace::Empty) => "",
            Value::Text(TextPlace::Argument(index)) => match self.arguments.get(usize::from(index)) {
                Some(Argument::Text(text)) => text,
                _ => "",
            },
            Value::Text(TextPlace::Constant(cycle, index)) => {
                let texts = self.library.get(cycle).map(|cycle| &cycle.unit.texts);
                texts.and_then(|texts| texts.get(usize::from(index))).map_or("", String::as_str)
            }
        }
    }

    fn store(&mut self, slot: usize, of: Type, value: Value) -> Step {
        let value = match (value, of) {
            (Value::Text(_), Type::Text(length)) => {
                if self.text(value).len() > usize::from(length) {
                    return trap(ErrorCode::BadArgument, format!("a text is longer than {length} bytes"));
                }
                value
            }
            (Value::Text(_), _) => Value::Number(0.0),
            (Value::Number(number), _) => Value::Number(converted(of, number)),
        };
        if let Some(place) = self.vm.slots.get_mut(slot) {
            *place = value;
        }
        Ok(())
    }

    /// Executes an instruction on an array.
    fn array(&mut self, op: Op, frame: &Frame) -> Step {
        match op {
            Op::LoadAt(base, length) => {
                let index = self.index(length)?;
                let value = self.vm.slots.get(frame.base + usize::from(base) + index).copied();
                self.vm.stack.push(value.unwrap_or(Value::Number(0.0)));
            }
            Op::StoreAt(base, length, of) => {
                let value = self.pop();
                let index = self.index(length)?;
                self.store(frame.base + usize::from(base) + index, of, value)?;
            }
            Op::Element(rows, columns) => {
                let column = self.index(columns)?;
                let row = self.index(rows)?;
                self.push((row * usize::from(columns) + column) as f64);
            }
            _ => {}
        }
        Ok(())
    }

    /// Pops an index below `length`.
    fn index(&mut self, length: u16) -> Step<usize> {
        let index = self.number().round();
        if index < 0.0 || index >= f64::from(length) {
            return trap(ErrorCode::IndexRange, format!("index {index} is not from 0 to {}", i32::from(length) - 1));
        }
        Ok(index as usize)
    }

    /// Calls another cycle; `frame` is the caller's, which continues after the call.
    fn call(&mut self, site: usize, frame: Frame, caller: &Cycle) -> Step {
        let (Some(call), Some(&id)) = (caller.unit.calls.get(site), caller.callees.get(site)) else {
            return trap(ErrorCode::CycleUnknown, "a call has no cycle");
        };
        let Some(callee) = self.library.get(id) else {
            return trap(ErrorCode::CycleUnknown, format!("{} is not in this library", call.name));
        };
        if self.vm.frames.len() >= self.vm.limits.depth {
            return trap(
                ErrorCode::CallsTooDeep,
                format!("{} is called at a depth of {}", call.name, self.vm.frames.len()),
            );
        }
        if let Some(last) = self.vm.frames.last_mut() {
            last.at = frame.at;
        }
        let base = self.vm.slots.len();
        let given = call.arguments.iter().filter(|passed| **passed != Passed::Nothing).count();
        let mut from = self.vm.stack.len().saturating_sub(given);
        let first = from;
        let mut programmed = 0;
        for (index, parameter) in callee.parameters().iter().enumerate() {
            self.vm.slots.push(if parameter.value_type.is_text() {
                Value::Text(TextPlace::Empty)
            } else {
                Value::Number(parameter.default)
            });
            if !matches!(call.arguments.get(index), None | Some(Passed::Nothing)) {
                let value = self.vm.stack.get(from).copied().unwrap_or(Value::Number(0.0));
                from += 1;
                programmed |= 1 << (index & 63);
                self.store(base + index, parameter.value_type, value)?;
            }
        }
        self.vm.stack.truncate(first);
        self.enter(callee, id, base, programmed);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::code::{Input, Operand};
    use crate::cycle::{Kind, Origin};
    use crate::host::CycleStoppedError;
    use crate::parameter::Parameter;
    use proptest::prelude::*;
    use std::path::PathBuf;

    /// A host that returns 1 for every query and accepts everything.
    struct PermissiveHost;

    impl Host for PermissiveHost {
        fn ask(&self, _: crate::host::Query) -> f64 {
            1.0
        }

        fn block(&mut self, _: &CycleBlock) -> Result<(), CycleStoppedError> {
            Ok(())
        }

        fn message(&mut self, _: &crate::host::Message<'_>) {}
    }

    /// Parses bytes as instructions, as far as they are valid.
    fn instructions(bytes: &[u8]) -> Vec<Op> {
        let mut input = Input(bytes);
        std::iter::from_fn(|| {
            while !input.0.is_empty() {
                if let Some(op) = Op::take(&mut input) {
                    return Some(op);
                }
            }
            None
        })
        .collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, ..ProptestConfig::default() })]

        /// Code that no compiler has generated does no harm: it ends, and does not panic.
        #[test]
        fn any_code_is_safe_to_run(
            bytes in prop::collection::vec(prop_oneof![3 => 0..36_u8, 1 => any::<u8>()], 0..400),
            slots in 0..20_u16,
        ) {
            let ops = instructions(&bytes);
            let name = "ANY".to_owned();
            let parameters = vec![Parameter { name: "P".to_owned(), value_type: Type::Real, default: 1.0 }];
            let call = crate::code::CallSite { name: name.clone(), line: 1, start: 0, end: 0,
                arguments: vec![Passed::Number] };
            let unit = crate::code::Unit { name, parameters, slots, lines: vec![1; ops.len()], ops, calls: vec![call],
                ..Default::default() };
            let (path, kind, origin) = (PathBuf::new(), Kind::Parameters, Origin::User);
            let cycle = Cycle { unit, callees: vec![CycleId(0)], kind, origin, path, is_from_cache: false };
            let limits = VmLimits { steps: 2000, blocks: 200, depth: 5 };
            let _ = Vm::new(limits).run(&CycleLibrary::of_cycles(vec![cycle]), CycleId(0), &[Argument::Number(2.0)],
                &mut PermissiveHost);
        }
    }
}
