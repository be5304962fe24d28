//! Blocks: words are collected, translated to RS274/NGC, and passed to the host.
//!
//! Invariant: axes of the plane are those of the plane in force in the block itself.

use super::{Frame, STEPS_OF_A_BLOCK, Step, VmRun, VmTrap, trap};
use crate::code::Op;
use crate::cycle::Cycle;
use crate::error_codes::ErrorCode;
use crate::host::{Query, is_known_m};

/// Returns the axes of a plane: first, second, and the drilling axis.
pub(crate) const fn axes_of_plane(plane: i64) -> [u8; 3] {
    match plane {
        18 => *b"ZXY",
        19 => *b"YZX",
        _ => *b"XYZ",
    }
}

/// Returns the word of an arc's centre along an axis.
const fn centre_of_axis(axis: u8) -> u8 {
    match axis {
        b'X' => b'I',
        b'Y' => b'J',
        _ => b'K',
    }
}

impl VmRun<'_> {
    /// Executes an instruction that reads the state, or builds a block.
    pub(super) fn block_op(&mut self, op: Op, frame: &Frame, cycle: &Cycle, line: u32) -> Step {
        match op {
            Op::Ask(system) => {
                let value = self.system(system);
                self.push(value);
            }
            Op::PositionAt => {
                let letter = self.axis()?;
                let value = self.host.ask(Query::Position(letter));
                self.push(value);
            }
            Op::PositionOf(letter) => {
                let value = self.host.ask(Query::Position(letter));
                self.push(value);
            }
            Op::Begin => self.vm.block.begin(frame.cycle, line),
            Op::CodeG(tenths) => self.vm.block.add_g(tenths),
            Op::CodeM => {
                let code = self.number().round();
                if !is_known_m(code) {
                    return trap(ErrorCode::CodeUnknown, format!("M{code} is not allowed in a cycle"));
                }
                self.vm.block.add_m(code as u16);
            }
            Op::Word(letter) => {
                let value = self.number();
                self.vm.block.add_word(letter, value);
            }
            Op::AxisWord | Op::CentreWord => {
                let value = self.number();
                let axis = self.axis()?;
                let letter = if op == Op::AxisWord { axis } else { centre_of_axis(axis) };
                self.vm.block.add_word(letter, value);
            }
            Op::DwellTurns => {
                let turns = self.number();
                let speed = self.host.ask(Query::SpindleSpeed).abs();
                if speed <= 0.0 {
                    return trap(
                        ErrorCode::NoSpeed,
                        format!("{}: no speed for a dwell of {turns} revolutions", cycle.name()),
                    );
                }
                self.vm.block.add_word(b'P', turns * 60.0 / speed);
            }
            Op::Orient => {
                let angle = self.number();
                self.vm.block.add_m(19);
                self.vm.block.add_word(b'R', angle);
            }
            Op::Emit => self.emit(cycle)?,
            _ => {}
        }
        Ok(())
    }

    fn emit(&mut self, cycle: &Cycle) -> Step {
        if self.vm.blocks >= self.vm.limits.blocks {
            return trap(ErrorCode::Endless, format!("{} has emitted too many blocks", cycle.name()));
        }
        self.vm.blocks += 1;
        self.vm.steps = self.vm.steps.saturating_sub(STEPS_OF_A_BLOCK);
        let axes = axes_of_plane(self.plane());
        let block = &mut self.vm.block;
        block.triggers = cycle.is_pattern() && block.words().iter().any(|word| axes.contains(&word.letter));
        let done = self.host.block(&self.vm.block).map_err(|_| Box::new(VmTrap::Stopped));
        // The plane that it selected must not apply to the next block.
        self.vm.block.begin(self.vm.block.cycle, self.vm.block.line);
        done
    }

    /// Returns the plane in force in the block that is being built.
    fn plane(&self) -> i64 {
        let own = self.vm.block.g().iter().rev().find(|code| (170..=190).contains(*code));
        own.map_or_else(|| self.host.ask(Query::Plane) as i64, |tenths| i64::from(tenths / 10))
    }

    /// Pops the number of an axis of the plane, and returns its letter.
    fn axis(&mut self) -> Step<u8> {
        let number = self.number().round();
        let axes = axes_of_plane(self.plane());
        let letter = if (1.0..=3.0).contains(&number) { axes.get(number as usize - 1) } else { None };
        match letter {
            Some(letter) => Ok(*letter),
            None => trap(ErrorCode::IndexRange, format!("AX[{number}]: a plane has the axes 1, 2 and 3")),
        }
    }
}
