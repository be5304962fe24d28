//! Checks of a block as a whole, before any of it is executed.
//!
//! Invariant: every word of an accepted block is used, and its axis words belong to one code.

use super::block_motion::{AXES, BlockMotion};
use super::spindle::check_spindle_words;
use super::thread::check_thread;
use crate::block::{Words, letters, name_of_g};
use crate::canon_modes::Probing;
use crate::diag::{BlockResult, Span, fault};
use crate::drilling_cycle::DrillingCycle;
use crate::error_codes::ErrorCode;
use crate::eval::to_whole_number;
use crate::groups::{GroupG, GroupM};
use crate::modal::ModalState;
use crate::modal_groups::{DistanceMode, MotionMode};

const fn motion_of(tenths: u16) -> BlockMotion {
    match tenths {
        0 => BlockMotion::Move(MotionMode::Traverse),
        10 => BlockMotion::Move(MotionMode::Feed),
        20 => BlockMotion::Move(MotionMode::ArcClockwise),
        30 => BlockMotion::Move(MotionMode::ArcCounterclockwise),
        330 => BlockMotion::Move(MotionMode::SpindleFeed),
        331 => BlockMotion::Move(MotionMode::RigidTap),
        760 => BlockMotion::Move(MotionMode::ThreadingCycle),
        50 => BlockMotion::Move(MotionMode::CubicSpline),
        51 => BlockMotion::Move(MotionMode::QuadraticSpline),
        52 => BlockMotion::Move(MotionMode::ControlPoint),
        53 => BlockMotion::Move(MotionMode::EndOfPoints),
        382..=385 => {
            BlockMotion::Move(MotionMode::Probe(Probing { away: tenths >= 384, must_trip: tenths.is_multiple_of(2) }))
        }
        700..730 => BlockMotion::Turn(tenths),
        _ => match DrillingCycle::of_g(tenths) {
            Some(cycle) => BlockMotion::Move(MotionMode::Cycle(cycle)),
            None => BlockMotion::Cancel,
        },
    }
}

/// Determines which code uses the axis words: the motion in the block, a code that takes them over, or the motion mode
/// in force.
pub(super) fn determine_motion(words: &Words, state: &ModalState) -> BlockResult<BlockMotion> {
    const ANY: u32 = letters(AXES);
    let axis = if words.has_any_of(ANY) { words.first_of(AXES) } else { None };
    let owner = words.g(GroupG::NonModal).filter(|code| matches!(code, 100 | 280 | 300 | 520 | 920));
    let to_be = match (words.g(GroupG::Motion), owner) {
        (Some(800), None) => match axis {
            Some(axis) => return fault(ErrorCode::AxisWithG80, words.span(axis), ErrorCode::AxisWithG80.title()),
            None => BlockMotion::Cancel,
        },
        (Some(800), Some(_)) => BlockMotion::Cancel,
        (Some(motion), Some(owner)) => {
            let at = words.g_span(GroupG::NonModal);
            let (motion, owner) = (name_of_g(motion), name_of_g(owner));
            return fault(ErrorCode::TwoUseAxes, at, format!("{motion} and {owner} would both use the axis words"));
        }
        (Some(50 | 51 | 382..=385), None) if axis.is_none() => {
            let at = words.g_span(GroupG::Motion);
            return fault(ErrorCode::AxesMissing, at, "this motion needs at least one axis word");
        }
        (Some(motion), None) => {
            let to_be = motion_of(motion);
            if axis.is_none() && to_be.needs_axes() {
                let name = name_of_g(motion);
                return fault(ErrorCode::AxesMissing, words.g_span(GroupG::Motion), format!("{name} needs axis words"));
            }
            to_be
        }
        (None, Some(_)) => BlockMotion::None,
        (None, None) => modal_motion(words, state, axis)?,
    };
    if axis.is_none() && matches!(owner, Some(520 | 920)) {
        let at = words.g_span(GroupG::NonModal);
        return fault(ErrorCode::AxesMissing, at, ErrorCode::AxesMissing.title());
    }
    super::polar::check(words, to_be, state)?;
    check_non_modal(words, to_be, state)?;
    Ok(to_be)
}

/// Returns the motion mode in force, if the block has words for it.
fn modal_motion(words: &Words, state: &ModalState, axis: Option<u8>) -> BlockResult<BlockMotion> {
    let offset = words.g(GroupG::ToolOffset);
    match (axis, state.motion) {
        (Some(_), _) if offset == Some(431) => Ok(BlockMotion::None),
        (Some(_), _) if offset == Some(432) && !words.has(b'h') => Ok(BlockMotion::None),
        (Some(_), Some(motion)) => Ok(BlockMotion::Move(motion)),
        (Some(axis), None) => fault(ErrorCode::NoMotionMode, words.span(axis), ErrorCode::NoMotionMode.title()),
        (None, Some(motion)) if motion.is_arc() && words.has_any(b"ijk") => Ok(BlockMotion::Move(motion)),
        (None, _) => Ok(BlockMotion::None),
    }
}

fn check_non_modal(words: &Words, to_be: BlockMotion, state: &ModalState) -> BlockResult<()> {
    let Some(code) = words.g(GroupG::NonModal) else { return Ok(()) };
    let at = words.g_span(GroupG::NonModal);
    match code {
        40 => check_dwell(words, to_be, at),
        100 => check_g10(words, at),
        530 => {
            if !matches!(to_be, BlockMotion::Move(MotionMode::Traverse | MotionMode::Feed)) {
                return fault(ErrorCode::G53Motion, at, ErrorCode::G53Motion.title());
            }
            let incremental = match words.g(GroupG::Distance) {
                Some(code) => code == 910,
                None => state.distance == DistanceMode::Incremental,
            };
            if incremental { fault(ErrorCode::G53Incremental, at, ErrorCode::G53Incremental.title()) } else { Ok(()) }
        }
        _ => Ok(()),
    }
}

fn check_dwell(words: &Words, to_be: BlockMotion, at: Span) -> BlockResult<()> {
    // An arc whose code comes from an earlier block makes as many turns as the dwell has seconds, as in LinuxCNC.
    if to_be.is_arc() && words.g(GroupG::Motion).is_some() {
        return fault(ErrorCode::TwoUseAxes, at, "G4 and an arc would both use the P word");
    }
    match words.get(b'p') {
        None => fault(ErrorCode::WordMissing, at, "G4 needs a P word: the time in seconds"),
        Some(seconds) if seconds < 0.0 => {
            fault(ErrorCode::NegativeValue, words.span(b'p'), "a dwell cannot have a negative time")
        }
        Some(_) => Ok(()),
    }
}

fn check_g10(words: &Words, at: Span) -> BlockResult<()> {
    match words.get(b'l') {
        Some(2.0 | 20.0) => {}
        Some(0.0) => return Ok(()),
        Some(1.0 | 10.0 | 11.0) => return super::tool_data::check(words, at),
        Some(_) => return fault(ErrorCode::BadL, words.span(b'l'), ErrorCode::BadL.title()),
        None => return fault(ErrorCode::WordMissing, at, "G10 needs an L word"),
    }
    let Some(system) = words.get(b'p') else {
        return fault(ErrorCode::WordMissing, at, "G10 needs a P word: the coordinate system");
    };
    let system = to_whole_number(system, words.span(b'p'), "P")?;
    if !(0..=9).contains(&system) {
        return fault(ErrorCode::BadP, words.span(b'p'), format!("there is no coordinate system {system}"));
    }
    if words.has(b'r') && words.get(b'l') == Some(20.0) {
        return fault(ErrorCode::WordUnused, words.span(b'r'), "G10 L20 does not accept an R word");
    }
    match words.first_of(b"ijkq") {
        Some(letter) => unused(words, letter, "G10 L2 and L20"),
        None => Ok(()),
    }
}

fn unused(words: &Words, letter: u8, code: &str) -> BlockResult<()> {
    let name = char::from(letter.to_ascii_uppercase());
    fault(ErrorCode::WordUnused, words.span(letter), format!("{code} does not accept the {name} word"))
}

/// Refuses a word that no code of the block uses.
#[inline]
pub(super) fn words_have_uses(words: &Words, to_be: BlockMotion) -> BlockResult<()> {
    // Axis words, F, S and T are used in any block.
    const SPECIAL: u32 = letters(b"dehijklpqr$");
    if words.has_any_of(SPECIAL) {
        special_words_have_uses(words, to_be)?;
    }
    if let (Some(cycle), Some(letter)) = (to_be.cycle(), words.first_of(b"abcuvw")) {
        let name = cycle.name();
        return fault(ErrorCode::CycleAxis, words.span(letter), format!("{name} moves X, Y and Z only"));
    }
    if to_be == BlockMotion::Move(MotionMode::ThreadingCycle) {
        check_thread(words)?;
    }
    check_spindle_words(words, to_be)
}

/// G5 and G5.1.
const SPLINES: [BlockMotion; 2] =
    [BlockMotion::Move(MotionMode::CubicSpline), BlockMotion::Move(MotionMode::QuadraticSpline)];

fn special_words_have_uses(words: &Words, to_be: BlockMotion) -> BlockResult<()> {
    let arc = to_be.is_arc();
    let g10 = words.g(GroupG::NonModal) == Some(100);
    let dwell = words.g(GroupG::NonModal) == Some(40);
    let blend = words.g(GroupG::PathControl) == Some(640);
    let offset = matches!(words.g(GroupG::ToolOffset), Some(430 | 432));
    let output = matches!(words.m(GroupM::Output), Some(62..=66));
    let port = matches!(words.m(GroupM::Output), Some(66..=68));
    let input = words.m(GroupM::Output) == Some(66);
    let user = words.m(GroupM::User).is_some();
    let (cubic, quadratic) = (to_be == SPLINES[0], to_be == SPLINES[1]);
    let point = to_be == BlockMotion::Move(MotionMode::ControlPoint);
    let compensation = words.g(GroupG::CutterCompensation).is_some_and(|code| code != 400);
    let switch = matches!(words.m(GroupM::Override), Some(50..=53));
    let number = words.m(GroupM::Tool) == Some(61);
    let cycle = to_be.cycle();
    let thread = to_be == BlockMotion::Move(MotionMode::ThreadingCycle);
    let tap = to_be == BlockMotion::Move(MotionMode::RigidTap);
    let synchronised = tap || to_be == BlockMotion::Move(MotionMode::SpindleFeed);
    let finish = to_be == BlockMotion::Turn(700);
    let turn = matches!(to_be, BlockMotion::Turn(_));
    let rough = turn && !finish;
    let surface_speed = words.g(GroupG::SpindleMode) == Some(960);
    let orient = words.m(GroupM::Spindle) == Some(19);
    let offsets = cycle == Some(DrillingCycle::BackBoring) || thread;
    let pause = cycle.is_some_and(DrillingCycle::takes_dwell) || thread || orient;
    let peck = cycle.is_some_and(DrillingCycle::has_pecks) || thread || orient;
    let spline = cubic || quadratic;
    let uses: [(&[u8], bool, &str); 9] = [
        (b"d", surface_speed || compensation || turn, "G41, G41.1, G42, G42.1, G70 to G72 or G96"),
        (b"e", thread || port || finish, "G70, G76 or M66 to M68"),
        (b"h", offset || thread, "G43, G43.2 or G76"),
        (b"i", arc || g10 || offsets || tap || spline || rough, "G2, G3, G5, G5.1, G10, G33.1, G71, G72, G76 or G87"),
        (b"j", arc || g10 || offsets || spline, "G2, G3, G5, G5.1, G10, G76 or G87"),
        (b"k", arc || g10 || offsets || synchronised, "G2, G3, G10, G33, G33.1, G76 or G87"),
        (
            b"l",
            g10 || cycle.is_some() || thread || compensation || input || point,
            "G5.2, G10, G41.1, G42.1, G76, M66 or a drilling cycle",
        ),
        (
            b"p",
            arc || g10 || dwell || blend || output || switch || pause || cubic || point || user || finish,
            "G2 to G5.2, G10, G64, G70, G76, a cycle with a dwell, M19, M50 to M53, M62 to M66 or M100 to M199",
        ),
        (
            b"q",
            blend || number || g10 || peck || cubic || port || user || turn || synchronised && !tap,
            "G5, G10, G33, G64, G70 to G73, G76, G83, M19, M61, M66 to M68 or M100 to M199",
        ),
    ];
    for (letters, used, users) in uses {
        if let (false, Some(letter)) = (used, words.first_of(letters)) {
            let name = char::from(letter.to_ascii_uppercase());
            return fault(ErrorCode::WordUnused, words.span(letter), format!("{name} belongs to {users}"));
        }
    }
    if words.has(b'r') && !(arc || g10 || cycle.is_some() || thread || orient || rough) {
        let message = "R belongs to G2, G3, G10 L2, G71, G72, G76, M19 or a drilling cycle";
        return fault(ErrorCode::WordUnused, words.span(b'r'), message);
    }
    match words.get(b'p') {
        Some(turns) if arc => turns_of(turns, words).map(|_| ()),
        _ => Ok(()),
    }
}

/// Returns the number of turns that the P word of an arc gives.
pub(super) fn turns_of(value: f64, words: &Words) -> BlockResult<i32> {
    let at = words.span(b'p');
    match to_whole_number(value, at, "P")? {
        turns @ 1.. => Ok(turns),
        turns => fault(ErrorCode::BadP, at, format!("an arc makes at least one turn, not {turns}")),
    }
}
