//! Spindle modes beyond on and off: G96, G97, M19, and the synchronised moves G33 and G33.1.
//!
//! Invariant: the only spindle is number 0. A synchronised move is refused while the spindle is stopped.

use super::block_motion::BlockMotion;
use super::interpreter_core::{Core, Emitter};
use crate::block::Words;
use crate::canon::Canon;
use crate::diag::{BlockResult, fault};
use crate::error_codes::ErrorCode;
use crate::eval::to_whole_number;
use crate::groups::{GroupG, GroupM};
use crate::modal_groups::{MotionMode, SpindleRotation};
use crate::pose::Axis;

/// Maximum speed in turns per minute under G96 without a D word: LinuxCNC's value for no limit.
const NO_HIGHEST_SPEED: f64 = 1e30;

impl Core {
    /// Executes G96 and G97. From here S is a surface speed or a rotary speed.
    pub(super) fn set_spindle_mode(&mut self, code: u16, words: &Words, emit: &mut Emitter<'_>) {
        self.state.constant_surface_speed = code == 960;
        let highest = if code == 960 { words.get(b'd').map_or(NO_HIGHEST_SPEED, f64::abs) } else { 0.0 };
        self.state.max_spindle_speed = highest;
        emit.call(Canon::SetSpindleMode(highest));
    }

    /// Executes M19: the spindle turns to an angle and stops. Without R and P it only counts as stopped, as in
    /// LinuxCNC.
    pub(super) fn orient_spindle(&mut self, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        let mode = words.get(b'p').unwrap_or_default() as u8;
        self.state.spindle = SpindleRotation::Stopped;
        if words.has_any(b"rp") {
            let degrees = words.get(b'r').unwrap_or_default() + self.orient_offset_degrees;
            emit.call(Canon::OrientSpindle { degrees, mode, timeout_s: words.get(b'q') });
        }
        match words.get(b'q') {
            None => Ok(()),
            Some(seconds) if seconds > 0.0 => {
                emit.call(Canon::WaitSpindleOrientComplete(seconds));
                Ok(())
            }
            Some(_) => fault(ErrorCode::BadOrientation, words.span(b'q'), "M19 waits for longer than 0 s at most"),
        }
    }

    /// Executes G33, a straight move, and G33.1, a tap in and out, at K units per turn of the spindle.
    pub(super) fn synchronised_move(
        &mut self,
        motion: MotionMode,
        words: &Words,
        emit: &mut Emitter<'_>,
    ) -> BlockResult<()> {
        self.needs_turning_spindle(motion.name(), words)?;
        let pitch = words.get(b'k').unwrap_or_default();
        self.state.motion = Some(motion);
        let end = self.end_of(words);
        let start_degrees = words.get(b'q').unwrap_or_default().rem_euclid(360.0);
        emit.call(Canon::StartSpeedFeedSynch { pitch, start_degrees });
        if motion == MotionMode::RigidTap {
            let end = [end[Axis::X], end[Axis::Y], end[Axis::Z]];
            emit.call(Canon::RigidTap { end, return_factor: words.get(b'i').unwrap_or(1.0) });
        } else {
            emit.call(Canon::StraightFeed(end));
            self.state.position = end;
        }
        emit.call(Canon::StopSpeedFeedSynch);
        Ok(())
    }

    /// Refuses a synchronised motion while the spindle is stopped.
    pub(super) fn needs_turning_spindle(&self, name: &str, words: &Words) -> BlockResult<()> {
        match self.state.spindle {
            SpindleRotation::Stopped => fault(
                ErrorCode::SpindleNotTurning,
                words.g_span(GroupG::Motion),
                format!("{name} needs a turning spindle"),
            ),
            _ => Ok(()),
        }
    }
}

/// Checks the spindle words before a block is executed.
pub(super) fn check_spindle_words(words: &Words, to_be: BlockMotion) -> BlockResult<()> {
    if words.g(GroupG::SpindleMode) == Some(960) && !words.has(b's') {
        let at = words.g_span(GroupG::SpindleMode);
        return fault(ErrorCode::WordMissing, at, "G96 needs an S word: the speed at the surface");
    }
    if words.m(GroupM::Spindle) == Some(19) {
        check_orientation(words)?;
    }
    if words.has(b'$') {
        check_spindle_number(words, to_be)?;
    }
    match to_be {
        BlockMotion::Move(motion @ (MotionMode::SpindleFeed | MotionMode::RigidTap)) => {
            check_synchronised(motion, words)
        }
        _ => Ok(()),
    }
}

fn check_orientation(words: &Words) -> BlockResult<()> {
    match words.get(b'r') {
        None | Some(0.0..=360.0) => {}
        Some(degrees) => {
            let message = format!("M19 turns to an angle of 0 to 360 degrees, not {degrees}");
            return fault(ErrorCode::BadOrientation, words.span(b'r'), message);
        }
    }
    match words.get(b'p') {
        None | Some(0.0 | 1.0 | 2.0) => Ok(()),
        Some(_) => {
            let message = "of M19, P is 0 (the shortest way), 1 (clockwise) or 2 (counter-clockwise)";
            fault(ErrorCode::BadOrientation, words.span(b'p'), message)
        }
    }
}

fn check_spindle_number(words: &Words, to_be: BlockMotion) -> BlockResult<()> {
    let at = words.span(b'$');
    let switch = matches!(words.m(GroupM::Spindle), Some(3..=5));
    let turns = switch || words.m(GroupM::Spindle) == Some(19);
    let moves =
        matches!(to_be, BlockMotion::Move(MotionMode::SpindleFeed | MotionMode::RigidTap | MotionMode::ThreadingCycle));
    let per_turn = words.g(GroupG::FeedMode) == Some(950);
    let mode = per_turn || words.g(GroupG::SpindleMode).is_some();
    let one = moves || words.m(GroupM::Spindle) == Some(19) || mode;
    if !(turns || moves || words.has(b's') || mode) {
        return fault(ErrorCode::WordUnused, at, "$ belongs to S, M3, M4, M5, M19, G33, G33.1, G76, G95, G96 or G97");
    }
    match to_whole_number(words.get(b'$').unwrap_or_default(), at, "$")? {
        0 => Ok(()),
        -1 if !one => Ok(()),
        // Whether the machine has it is checked with the machine's cutters.
        1..=7 if switch || words.has(b's') => Ok(()),
        number => fault(ErrorCode::NoSuchSpindle, at, format!("there is no spindle {number}")),
    }
}

fn check_synchronised(motion: MotionMode, words: &Words) -> BlockResult<()> {
    let name = motion.name();
    if words.has(b'f') {
        let message = format!("the feed of {name} is K times the turns of the spindle, so it takes no F word");
        return fault(ErrorCode::WordUnused, words.span(b'f'), message);
    }
    match words.get(b'k') {
        None => {
            let message = format!("{name} needs a K word: the distance per turn of the spindle");
            return fault(ErrorCode::WordMissing, words.g_span(GroupG::Motion), message);
        }
        Some(0.0) => return fault(ErrorCode::ZeroPitch, words.span(b'k'), ErrorCode::ZeroPitch.title()),
        Some(_) => {}
    }
    if words.get(b'i').is_some_and(|factor| factor <= 0.0) {
        let message = "I of G33.1, the speed of the way back in parts of that of the way in, is above 0";
        return fault(ErrorCode::NegativeValue, words.span(b'i'), message);
    }
    match words.first_of(b"abcuvw") {
        Some(letter) if motion == MotionMode::RigidTap => {
            fault(ErrorCode::CycleAxis, words.span(letter), "G33.1 moves X, Y and Z only")
        }
        _ => Ok(()),
    }
}
