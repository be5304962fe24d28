//! Execution of the drilling cycles G73, G74 and G81 to G89.
//!
//! Invariant: the calls are those of LinuxCNC 2.9, in its order. In any plane, a hole is two coordinates in it and
//! levels along its normal axis. After each hole the tool is above it: at the clearance with G99, and at the higher of
//! the clearance and the initial level with G98.

use super::interpreter_core::{Core, Emitter};
use super::polar::PolarWords;
use crate::block::Words;
use crate::canon::Canon;
use crate::canon_modes::{FeedMode, LengthUnit, PathControl};
use crate::diag::{BlockResult, fault};
use crate::drilling_cycle::{CycleWords, DrillingCycle, DrillingSeries};
use crate::error_codes::ErrorCode;
use crate::groups::GroupG;
use crate::modal::ModalState;
use crate::modal_groups::{DistanceMode, MotionMode};
use crate::pose::{Axis, Pose};
use crate::spindle::SpindleTurn;

/// Returns the distance between the tool and the depth reached before, for G73 and G83.
const fn chip_clearance(units: LengthUnit) -> f64 {
    match units {
        LengthUnit::Inch => 0.010,
        LengthUnit::Millimetre => 0.254,
    }
}

/// Maximum number of holes and pecks in one block; more indicates a mistake in the program.
const MAX_HOLES_AND_PECKS: f64 = 10_000.0;

/// Levels along the normal axis.
#[derive(Clone, Copy, Debug)]
struct Levels {
    clearance: f64,
    bottom: f64,
    /// Level after each hole.
    retract: f64,
}

/// State of one hole: tool position, and the axes of the plane.
struct Hole<'a, 'e> {
    emit: &'a mut Emitter<'e>,
    at: Pose,
    axes: [Axis; 3],
    levels: Levels,
    /// Whether taps are rigid.
    is_rigid: bool,
}

impl Hole<'_, '_> {
    fn traverse_to(&mut self, level: f64) {
        self.at[self.axes[2]] = level;
        self.emit.call(Canon::StraightTraverse(self.at));
    }

    fn feed_to(&mut self, level: f64) {
        self.at[self.axes[2]] = level;
        self.emit.call(Canon::StraightFeed(self.at));
    }

    /// Moves in the plane at rapid rate.
    fn traverse_over(&mut self, first: f64, second: f64) {
        (self.at[self.axes[0]], self.at[self.axes[1]]) = (first, second);
        self.emit.call(Canon::StraightTraverse(self.at));
    }

    /// Drills to the bottom in pecks. After each the tool retracts to the clearance, or just enough to break the chip.
    fn peck(&mut self, depth: f64, off: f64, clears: bool) {
        let Levels { clearance, bottom, .. } = self.levels;
        let mut level = clearance - depth;
        while level > bottom {
            self.feed_to(level);
            if clears {
                self.traverse_to(clearance);
            }
            self.traverse_to(level + off);
            level -= depth;
        }
        self.feed_to(bottom);
    }
}

impl Core {
    /// Executes a block of a cycle: one hole, or as many as L gives.
    pub(super) fn canned_cycle(
        &mut self,
        cycle: DrillingCycle,
        words: &Words,
        emit: &mut Emitter<'_>,
    ) -> BlockResult<()> {
        let retained = self.retained_words(cycle);
        let given = cycle_words(words, self.state.plane.axes()[2]).or(&retained);
        let initial_level = self.initial_level();
        let mut levels = self.levels(cycle, &given, initial_level, words)?;
        let repeats = repeats(cycle, &given, &levels, words)?;
        let normal = self.state.plane.axes()[2];
        if initial_level < levels.clearance {
            self.state.position[normal] = levels.clearance;
            emit.call(Canon::StraightTraverse(self.state.position));
        }
        levels.retract = if self.state.retract_to_r { levels.clearance } else { initial_level.max(levels.clearance) };
        let path = self.state.path_control;
        if path != PathControl::ExactPath {
            emit.call(Canon::SetMotionControlMode(PathControl::ExactPath));
        }
        check_cycle_words(cycle, &given, words)?;
        self.make_holes(cycle, levels, (&given, repeats), words, emit)?;
        if path != PathControl::ExactPath {
            emit.call(Canon::SetMotionControlMode(path));
            emit.call(Canon::SetNaivecamTolerance(self.state.naivecam_tolerance));
        }
        self.state.motion = Some(MotionMode::Cycle(cycle));
        self.state.series = Some(DrillingSeries { plane: self.state.plane, initial_level, words: given });
        Ok(())
    }

    /// Returns the words that the block may omit: those of the previous block, if that was the same cycle in the same
    /// plane.
    fn retained_words(&self, cycle: DrillingCycle) -> CycleWords {
        match &self.state.series {
            Some(series) if series.plane == self.state.plane && self.state.motion == Some(MotionMode::Cycle(cycle)) => {
                series.words
            }
            _ => CycleWords::default(),
        }
    }

    /// Returns the position of the normal axis before the series that the block belongs to.
    fn initial_level(&self) -> f64 {
        match &self.state.series {
            Some(series) if series.plane == self.state.plane => series.initial_level,
            _ => self.state.position[self.state.plane.axes()[2]],
        }
    }

    /// Returns clearance and bottom, after the checks that need nothing else.
    fn levels(&self, cycle: DrillingCycle, given: &CycleWords, initial: f64, words: &Words) -> BlockResult<Levels> {
        let at = cycle_span(words);
        let name = cycle.name();
        match self.state.feed_mode {
            FeedMode::InverseTime => {
                return fault(ErrorCode::CycleInverseTime, at, ErrorCode::CycleInverseTime.title());
            }
            _ if self.state.feed_rate == 0.0 => {
                return fault(ErrorCode::ZeroFeed, at, format!("{name} needs a feed rate, and none is set"));
            }
            _ => {}
        }
        let normal = char::from(self.state.plane.axes()[2].letter());
        let Some(clearance) = given.clearance else {
            return fault(ErrorCode::WordMissing, at, format!("{name} needs an R word: the level of clearance"));
        };
        let Some(bottom) = given.bottom else {
            return fault(ErrorCode::WordMissing, at, format!("{name} needs a {normal} word: the bottom of the hole"));
        };
        let (clearance, bottom) = match self.state.distance {
            DistanceMode::Absolute => (clearance, bottom),
            DistanceMode::Incremental => (initial + clearance, initial + clearance + bottom),
        };
        if clearance < bottom {
            let message = format!("the clearance {clearance:.4} lies below the bottom {bottom:.4} of the hole");
            return fault(ErrorCode::CycleLevels, at, message);
        }
        Ok(Levels { clearance, bottom, retract: clearance })
    }

    /// Makes each hole of the block.
    fn make_holes(
        &mut self,
        cycle: DrillingCycle,
        levels: Levels,
        (given, repeats): (&CycleWords, u32),
        words: &Words,
        emit: &mut Emitter<'_>,
    ) -> BlockResult<()> {
        let (state, is_rigid) = (&self.state, self.rigid_tapping);
        let axes = state.plane.axes();
        let [first, second, normal] = axes;
        let word = |axis: Axis| words.get(axis.letter().to_ascii_lowercase());
        let here = (state.position[first], state.position[second]);
        let polar = PolarWords::of(words);
        let (mut place, step) = match (state.distance, &polar) {
            // A step of zero is added too: it turns −0 into 0, as in LinuxCNC.
            (DistanceMode::Absolute, Some(polar)) => (polar.absolute(here), (0.0, 0.0)),
            (DistanceMode::Absolute, None) => {
                ((word(first).unwrap_or(here.0), word(second).unwrap_or(here.1)), (0.0, 0.0))
            }
            (DistanceMode::Incremental, _) => (here, (word(first).unwrap_or(0.0), word(second).unwrap_or(0.0))),
        };
        let polar_step = polar.filter(|_| state.distance == DistanceMode::Incremental);
        let level = state.position[normal];
        let mut travel = if level > levels.clearance { level } else { levels.retract };
        let mut hole = Hole { emit, at: state.position, axes, levels, is_rigid };
        for _ in 0..repeats {
            place = (place.0 + step.0, place.1 + step.1);
            if let Some(polar) = &polar_step {
                place = polar.step_from(place)?;
            }
            hole.at[normal] = travel;
            hole.traverse_over(place.0, place.1);
            if travel != levels.clearance {
                hole.traverse_to(levels.clearance);
            }
            make_hole(cycle, &mut hole, given, state, words)?;
            travel = levels.retract;
        }
        hole.at[normal] = levels.retract;
        self.state.position = hole.at;
        Ok(())
    }
}

/// Returns the number of holes of the block.
fn repeats(cycle: DrillingCycle, given: &CycleWords, levels: &Levels, words: &Words) -> BlockResult<u32> {
    let repeats = words.get(b'l').unwrap_or(1.0);
    let pecks = match given.peck {
        Some(depth) if cycle.has_pecks() && depth > 0.0 => (levels.clearance - levels.bottom) / depth,
        _ => 0.0,
    };
    if repeats == 0.0 || repeats * (pecks + 1.0) > MAX_HOLES_AND_PECKS {
        return fault(ErrorCode::CycleRepeats, words.span(b'l'), ErrorCode::CycleRepeats.title());
    }
    Ok(repeats as u32)
}

/// Makes one hole, from the clearance above it.
fn make_hole(
    cycle: DrillingCycle,
    hole: &mut Hole<'_, '_>,
    given: &CycleWords,
    state: &ModalState,
    words: &Words,
) -> BlockResult<()> {
    let Levels { clearance, bottom, retract } = hole.levels;
    let dwell = given.dwell.unwrap_or(0.0);
    match cycle {
        DrillingCycle::ChipBreaking | DrillingCycle::PeckDrilling => {
            let depth = given.peck.unwrap_or(0.0);
            if depth <= 0.0 {
                return fault(ErrorCode::CyclePeck, words.span(b'q'), ErrorCode::CyclePeck.title());
            }
            hole.peck(depth, chip_clearance(state.units), cycle == DrillingCycle::PeckDrilling);
            hole.traverse_to(retract);
        }
        DrillingCycle::Drilling | DrillingCycle::DrillingWithDwell => {
            hole.feed_to(bottom);
            if cycle == DrillingCycle::DrillingWithDwell {
                hole.emit.call(Canon::Dwell(dwell));
            }
            hole.traverse_to(retract);
        }
        DrillingCycle::LeftTapping => tap(cycle, hole, SpindleTurn::Counterclockwise, (dwell, state), words)?,
        DrillingCycle::RightTapping => tap(cycle, hole, SpindleTurn::Clockwise, (dwell, state), words)?,
        DrillingCycle::Boring => {
            hole.feed_to(bottom);
            hole.feed_to(clearance);
            hole.traverse_to(retract);
        }
        DrillingCycle::BoringWithDwell => {
            hole.feed_to(bottom);
            hole.emit.call(Canon::Dwell(dwell));
            hole.feed_to(retract);
        }
        DrillingCycle::BoringSpindleStop | DrillingCycle::BoringManual => {
            let turn = required_direction(cycle, state, words)?;
            hole.feed_to(bottom);
            hole.emit.call(Canon::Dwell(dwell));
            hole.emit.call(Canon::StopSpindleTurning(0));
            if cycle == DrillingCycle::BoringManual {
                hole.emit.call(Canon::ProgramStop);
            } else {
                hole.traverse_to(retract);
            }
            hole.emit.call(turn.start());
        }
        DrillingCycle::BackBoring => bore_back(hole, given, state, words)?,
    }
    Ok(())
}

/// Returns the direction of the spindle, which the cycle needs to turn.
fn required_direction(cycle: DrillingCycle, state: &ModalState, words: &Words) -> BlockResult<SpindleTurn> {
    match state.spindle.turn() {
        Some(turn) => Ok(turn),
        None => {
            let message = format!("{} needs a turning spindle", cycle.name());
            fault(ErrorCode::SpindleNotTurning, cycle_span(words), message)
        }
    }
}

/// Executes G74 and G84: down, reverse the spindle, and up again, all at the programmed feed, which must match the
/// pitch. Rigid: as G33.1, at the pitch that feed and speed give, without the dwell.
fn tap(
    cycle: DrillingCycle,
    hole: &mut Hole<'_, '_>,
    needed: SpindleTurn,
    (dwell, state): (f64, &ModalState),
    words: &Words,
) -> BlockResult<()> {
    let turn = required_direction(cycle, state, words)?;
    if turn != needed {
        let (name, needed) = (cycle.name(), needed.name());
        return fault(
            ErrorCode::SpindleTurnsWrongly,
            cycle_span(words),
            format!("{name} needs a spindle that turns {needed}"),
        );
    }
    let Levels { bottom, retract, .. } = hole.levels;
    if hole.is_rigid {
        let pitch = match state.feed_mode {
            FeedMode::UnitsPerRevolution => state.feed_rate,
            _ if state.spindle_speed > 0.0 => state.feed_rate / state.spindle_speed,
            // The machine refuses a tap at no speed.
            _ => 0.0,
        };
        let mut depth = hole.at;
        depth[hole.axes[2]] = bottom;
        hole.emit.call(Canon::StartSpeedFeedSynch { pitch, start_degrees: 0.0 });
        let end = [depth[Axis::X], depth[Axis::Y], depth[Axis::Z]];
        hole.emit.call(Canon::RigidTap { end, return_factor: 1.0 });
        hole.emit.call(Canon::StopSpeedFeedSynch);
        if hole.at[hole.axes[2]] != retract {
            hole.traverse_to(retract);
        }
        return Ok(());
    }
    hole.emit.call(Canon::DisableFeedOverride);
    hole.emit.call(Canon::DisableSpeedOverride);
    hole.feed_to(bottom);
    hole.emit.call(Canon::StopSpindleTurning(0));
    hole.emit.call(turn.opposite().start());
    hole.emit.call(Canon::Dwell(dwell));
    hole.feed_to(retract);
    hole.emit.call(Canon::StopSpindleTurning(0));
    hole.emit.call(turn.start());
    if state.feed_override {
        hole.emit.call(Canon::EnableFeedOverride);
    }
    if state.speed_override {
        hole.emit.call(Canon::EnableSpeedOverride);
    }
    Ok(())
}

/// Executes G87: through the hole off its axis with the spindle oriented, up to the middle at the feed, and back on the
/// same path.
fn bore_back(hole: &mut Hole<'_, '_>, given: &CycleWords, state: &ModalState, words: &Words) -> BlockResult<()> {
    let turn = required_direction(DrillingCycle::BackBoring, state, words)?;
    let [first, second, normal] = hole.axes;
    let offset = |axis: Axis| given.offsets[axis as usize].unwrap_or(0.0);
    let Levels { clearance, bottom, retract } = hole.levels;
    let middle = match state.distance {
        DistanceMode::Absolute => offset(normal),
        DistanceMode::Incremental => bottom + offset(normal),
    };
    let on_axis = (hole.at[first], hole.at[second]);
    let off_axis = (on_axis.0 + offset(first), on_axis.1 + offset(second));
    let mode = if turn == SpindleTurn::Clockwise { 2 } else { 3 };
    let orient = Canon::OrientSpindle { degrees: 0.0, mode, timeout_s: None };
    hole.at[normal] = clearance;
    hole.traverse_over(off_axis.0, off_axis.1);
    hole.emit.call(Canon::StopSpindleTurning(0));
    hole.emit.call(orient.clone());
    hole.traverse_to(bottom);
    hole.traverse_over(on_axis.0, on_axis.1);
    hole.emit.call(turn.start());
    hole.feed_to(middle);
    hole.feed_to(bottom);
    hole.emit.call(Canon::StopSpindleTurning(0));
    hole.emit.call(orient);
    hole.traverse_over(off_axis.0, off_axis.1);
    hole.traverse_to(retract);
    hole.traverse_over(on_axis.0, on_axis.1);
    hole.emit.call(turn.start());
    Ok(())
}

/// Returns the words of a block that cycles retain.
fn cycle_words(words: &Words, normal: Axis) -> CycleWords {
    CycleWords {
        clearance: words.get(b'r'),
        bottom: words.get(normal.letter().to_ascii_lowercase()),
        dwell: words.get(b'p'),
        peck: words.get(b'q'),
        offsets: [words.get(b'i'), words.get(b'j'), words.get(b'k')],
    }
}

/// Checks the words that the cycle needs in addition to R and the bottom.
fn check_cycle_words(cycle: DrillingCycle, given: &CycleWords, words: &Words) -> BlockResult<()> {
    let missing = match cycle {
        _ if cycle.needs_dwell() && given.dwell.is_none() => "P word: the dwell at the bottom, in seconds",
        _ if cycle.has_pecks() && given.peck.is_none() => "Q word: the depth of a peck",
        DrillingCycle::BackBoring if given.offsets.contains(&None) => "I, a J and a K word",
        _ => {
            return match given.dwell {
                Some(dwell) if dwell < 0.0 => {
                    fault(ErrorCode::NegativeValue, words.span(b'p'), "a dwell cannot have a negative time")
                }
                _ => Ok(()),
            };
        }
    };
    fault(ErrorCode::WordMissing, cycle_span(words), format!("{} needs a {missing}", cycle.name()))
}

/// Returns the span for diagnostics: the G code, or the first word that requests another hole.
fn cycle_span(words: &Words) -> crate::diag::Span {
    match words.first_of(b"xyz@^rpq") {
        Some(letter) if words.g(GroupG::Motion).is_none() => words.span(letter),
        _ => words.g_span(GroupG::Motion),
    }
}
