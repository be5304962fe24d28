//! Blocks of G70, G71 and G72: their words, and their moves as canonical functions.
//!
//! Invariant: the profile is drawn by the subprogram Q. The caller that runs subprograms sets it before the block is
//! executed, and it is used once.

use super::interpreter_core::{Core, Emitter};
use crate::block::Words;
use crate::canon::{ArcFeed, Canon};
use crate::canon_modes::{FeedMode, Plane};
use crate::diag::{BlockResult, fault};
use crate::error_codes::ErrorCode;
use crate::groups::{GroupG, Tenths};
use crate::modal_groups::{DistanceMode, MotionMode};
use crate::pose::{Axis, Pose};
use crate::turning::{Pockets, TurningJob, TurningMove, XzPoint, turn};

/// Retreat of G71 and G72 without an R word, in program units.
const RETREAT: f64 = 0.5;

impl Core {
    /// Replaces the U and W words of a profile's block by X and Z: they are increments, U of a diameter under G7.
    pub(super) fn add_increments(&self, words: &mut Words) -> BlockResult<()> {
        let half = if self.uses_diameters(words) { 0.5 } else { 1.0 };
        let is_incremental = match words.g(GroupG::Distance) {
            Some(code) => code == 910,
            None => self.state.distance == DistanceMode::Incremental,
        };
        for (letter, axis, factor) in [(b'u', Axis::X, half), (b'w', Axis::Z, 1.0)] {
            let Some(increment) = words.get(letter) else { continue };
            let at = words.span(letter);
            let own = axis.letter().to_ascii_lowercase();
            let name = char::from(letter.to_ascii_uppercase());
            if is_incremental {
                return fault(
                    ErrorCode::TurningWord,
                    at,
                    format!("{name} is an increment already and cannot be used with G91"),
                );
            }
            if words.has(own) {
                let message = format!("{name} and {} both define the end", char::from(axis.letter()));
                return fault(ErrorCode::TurningWord, at, message);
            }
            words.remove(letter);
            words.put(own, self.state.position[axis] + factor * increment);
        }
        Ok(())
    }

    /// Executes a turning cycle over the profile that was set.
    pub(super) fn turning_cycle(&mut self, code: Tenths, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        let at = words.g_span(GroupG::Motion);
        let job = job_of(code, words)?;
        if self.state.plane != Plane::Zx {
            return fault(ErrorCode::TurningPlane, at, ErrorCode::TurningPlane.title());
        }
        if self.state.feed_mode == FeedMode::InverseTime {
            return fault(ErrorCode::CycleInverseTime, at, ErrorCode::CycleInverseTime.title());
        }
        self.check_feed(words)?;
        let Some(profile) = self.profile.take() else {
            return fault(ErrorCode::TurningProfile, words.span(b'q'), "the subprogram Q has drawn no profile");
        };
        let begin = self.end_of(words);
        let (mut pose, mut motion) = (begin, MotionMode::Feed);
        let start = XzPoint { x: begin[Axis::X], z: begin[Axis::Z] };
        emit.call(Canon::StraightTraverse(begin));
        let turned = turn(&profile, start, &job, &mut |step| {
            let canon = call_of(step, &mut pose);
            motion = match &canon {
                Canon::ArcFeed(arc) if arc.turns < 0 => MotionMode::ArcClockwise,
                Canon::ArcFeed(_) => MotionMode::ArcCounterclockwise,
                _ => MotionMode::Feed,
            };
            emit.call(canon);
        });
        self.state.position = pose;
        (self.state.motion, self.state.series) = (Some(motion), None);
        match turned {
            Ok(()) => Ok(()),
            Err(error) => {
                let line = error.element().and_then(|element| profile.line_of(element));
                let place = line.map_or_else(String::new, |line| format!("profile, line {line}: "));
                fault(ErrorCode::TurningProfile, words.span(b'q'), format!("{place}{error}"))
            }
        }
    }
}

/// Returns the job that the words define.
fn job_of(code: Tenths, words: &Words) -> BlockResult<TurningJob> {
    let word = |letter: u8, default: f64| words.get(letter).unwrap_or(default);
    let wrong = |letter: u8, message: &str| fault(ErrorCode::TurningWord, words.span(letter), message);
    if !words.has(b'q') {
        return fault(ErrorCode::WordMissing, words.g_span(GroupG::Motion), "G70 to G72 need a Q word: the subprogram");
    }
    let allowance = word(b'd', 0.0);
    if allowance < 0.0 || word(b'e', 0.0) < 0.0 {
        let letter = if allowance < 0.0 { b'd' } else { b'e' };
        return wrong(letter, "an allowance must be at least 0");
    }
    if code == 700 {
        let passes = word(b'p', 1.0);
        if !(1.0..=1000.0).contains(&passes) {
            return wrong(b'p', "G70 makes 1 to 1000 passes");
        }
        return Ok(TurningJob::Finish { first: allowance, last: word(b'e', 0.0), passes: passes as u32 });
    }
    let (infeed, retreat) = (word(b'i', 1.0), word(b'r', RETREAT));
    if infeed <= 0.0 {
        return wrong(b'i', "the infeed I must be greater than 0");
    }
    if retreat < 0.0 {
        return wrong(b'r', "the retreat R must be at least 0");
    }
    let pockets = match code % 10 {
        0 => Pockets::Included,
        1 => Pockets::Skipped,
        _ => Pockets::Only,
    };
    Ok(TurningJob::Rough { facing: code / 10 == 72, pockets, allowance, infeed, retreat })
}

/// Returns the canonical function of a move. Axes that do not move keep their position in `pose`.
fn call_of(step: TurningMove, pose: &mut Pose) -> Canon {
    let (TurningMove::Rapid(end) | TurningMove::Feed(end) | TurningMove::Arc { end, .. }) = step;
    (pose[Axis::X], pose[Axis::Z]) = (end.x, end.z);
    match step {
        TurningMove::Rapid(_) => Canon::StraightTraverse(*pose),
        TurningMove::Feed(_) => Canon::StraightFeed(*pose),
        TurningMove::Arc { centre, counterclockwise, .. } => Canon::ArcFeed(ArcFeed {
            plane: Plane::Zx,
            end: *pose,
            first_centre: centre.z,
            second_centre: centre.x,
            turns: if counterclockwise { 1 } else { -1 },
        }),
    }
}
