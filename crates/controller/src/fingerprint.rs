//! The fingerprint of planning: a hash of the records of a fixed program, so that a change of decoder, planner or
//! floating-point library is detected.
//!
//! A job is resumed by planning it again, which is correct only where that gives identical records.
//!
//! Invariant: the fingerprint depends only on the fixed program on the built-in machine. It is calculated each time and
//! stored nowhere.

use retrace_config::{MachineConfig, NumberedError, PlanMode};
use retrace_core::Flags;
use retrace_gcode::{CanonStep, Program, Progress};
use retrace_journal::FileHash;
use retrace_link::OutputChange;
use retrace_motion::{Arc, FeedRate, PathMode, Planner};

use crate::block_decoder::{BlockDecoder, DecodedBlock};
use crate::job;
use crate::mdi;
use crate::motion_sink::MotionSink;
use crate::plan_writer::{Cancelled, PlanWriteError, SwitchInstruction};

/// Lines, arcs, a helix, a spline, wide and narrow blends, exact stops, inverse time, a loop with functions.
const PROGRAM: &str = "G21 G17 G90 G94 F3000\nG64 P0.05\nG0 X3.7 Y-1.3 Z2\nG1 X11.3 Y4.1 Z-0.25\nX12.9 Y9.7\nX12.95 \
    Y9.8\nX13.1\n\
    G2 X19.3 Y3.6 I3.1 J-3.1 F5200\nG3 X16.2 Y0.5 Z-3.3 I-3.1 J0\nG5 X21.4 Y6.6 I2.2 J0.7 P-1.1 Q-2.9\nG64 P0.5\nG1 \
    X25.1 Y-2.2\nX17.3\n\
    #1 = 0\nO100 while [#1 LT 12]\nG1 X[17.3 + 2.9 * COS[#1 * 27.7]] Y[2.9 * SIN[#1 * 27.7]] Z[#1 / 7]\n#1 = [#1 + \
    1]\nO100 endwhile\n\
    G61.1\nX1 Y1\nG61\nX2.2 Y3.3 F900\nG93 X9 Y9 F20\nM49\nG94 G64 P0.02 F6000\nG0 X0 Y0 Z0\nM2\n";

/// Fingerprint of this version, of plans in this mode.
///
/// # Errors
/// None in practice: the built-in machine passes the checks of every other.
pub fn planning_fingerprint(mode: PlanMode) -> Result<u32, NumberedError> {
    let machine = MachineConfig::built_in()?;
    let planner = Planner::<4>::new(machine.limits(), machine.start_mm())
        .map_err(|why| NumberedError::new("E2112", why.to_string(), "please report this"))?
        .with_blending(machine.blending)
        .with_plan_mode(mode.into());
    let mut planned = Planned { planner, hash: FileHash::of(b"") };
    let mut program = Fixed(Program::new(PROGRAM.as_bytes(), mdi::interpreter_setup(&machine)));
    let (blocks, findings) = job::feed_program(&machine, &mut program, &mut planned);
    planned.rest();
    let outcome = format!("{blocks} {}", findings.len());
    Ok(planned.hash.extend(outcome.as_bytes()).low_32())
}

struct Fixed(Program<&'static [u8]>);

impl BlockDecoder for Fixed {
    fn next_block(&mut self, steps: &mut Vec<CanonStep>) -> DecodedBlock {
        match self.0.advance(steps) {
            Progress::Line => DecodedBlock::Block,
            Progress::BlockError => DecodedBlock::BlockError(String::new()),
            Progress::End => DecodedBlock::End,
        }
    }
}

/// Plans and hashes the records.
struct Planned {
    planner: Planner<4>,
    hash: FileHash,
}

impl Planned {
    fn hash_records(&mut self) {
        while let Some(record) = self.planner.next_record() {
            for increment in record.increments {
                self.hash = self.hash.extend(&increment.to_le_bytes());
            }
            self.hash = self.hash.extend(&record.line.to_le_bytes());
        }
    }

    fn rest(&mut self) {
        self.planner.stop(Flags::NONE);
        self.hash_records();
    }
}

impl MotionSink<4> for Planned {
    fn straight(&mut self, end_mm: [f64; 4], feed: FeedRate, mode: PathMode, line: u32) -> Result<(), PlanWriteError> {
        self.planner.line(end_mm, feed, mode, line)?;
        self.hash_records();
        Ok(())
    }

    fn arc(&mut self, arc: &Arc<4>, feed: FeedRate, mode: PathMode, line: u32) -> Result<(), PlanWriteError> {
        self.planner.arc(arc, feed, mode, line)?;
        self.hash_records();
        Ok(())
    }

    fn action(&mut self, _: OutputChange, _: u32) {}

    fn exclusive(&mut self, _: SwitchInstruction<'_>) -> Result<(), Cancelled> {
        self.rest();
        Ok(())
    }

    fn message(&mut self, _: String, _: u32) -> Result<(), Cancelled> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fixed_program_is_run_whole_and_comes_to_the_same_each_time() {
        let machine = MachineConfig::built_in().expect("valid");
        let planner = Planner::<4>::new(machine.limits(), machine.start_mm()).expect("valid");
        let mut planned = Planned { planner, hash: FileHash::of(b"") };
        let mut program = Fixed(Program::new(PROGRAM.as_bytes(), mdi::interpreter_setup(&machine)));
        let (blocks, findings) = job::feed_program(&machine, &mut program, &mut planned);
        planned.rest();
        assert!(findings.is_empty() && blocks > 50, "{blocks} {findings:?}");
        assert_eq!(program.0.interpreter().diagnostics().len(), 0, "{:?}", program.0.interpreter().diagnostics());
        let [fast, again, best] = [PlanMode::Fast, PlanMode::Fast, PlanMode::Best].map(planning_fingerprint);
        assert!(fast == again && fast != best, "{fast:?} {best:?}");
    }
}
