//! G76: a thread in many passes.
//!
//! Invariant: the passes are those of LinuxCNC 2.9: along Z in any plane, with decreasing depth increments when R is
//! given, the last ones at the full depth. The tool returns to the drive line, on which the cycle began.

use super::interpreter_core::{Core, Emitter};
use crate::block::Words;
use crate::canon::Canon;
use crate::diag::{BlockResult, fault};
use crate::error_codes::ErrorCode;
use crate::groups::GroupG;
use crate::modal_groups::MotionMode;
use crate::pose::{Axis, Pose};

/// Maximum number of passes; more indicates a mistake in the program.
const MAX_PASSES: f64 = 10_000.0;

/// A thread, as given by the words; lengths in program units.
#[derive(Clone, Copy, Debug)]
struct Thread {
    /// Distance along Z per turn of the spindle.
    pitch: f64,
    /// Drive line: X at the beginning.
    drive_line: f64,
    /// Distance from the drive line to the crests.
    crests: f64,
    /// +1 where the tool cuts towards greater X, as in a bore; otherwise −1.
    inward: f64,
    /// Depth of the first pass below the crests.
    first_depth: f64,
    full_depth: f64,
    degression: f64,
    /// Retreat along Z per unit of depth, from the angle of infeed.
    slope: f64,
    spring_passes: u32,
    /// Length of the tapers along Z, and their positions.
    taper: f64,
    tapered_entry: bool,
    tapered_exit: bool,
    /// +1 where the thread runs towards greater Z, otherwise −1.
    along: f64,
    from: f64,
    to: f64,
}

impl Core {
    pub(super) fn threading_cycle(&mut self, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        self.needs_turning_spindle("G76", words)?;
        if let Some(letter) = words.first_of(b"abcuvw") {
            return fault(ErrorCode::CycleAxis, words.span(letter), "G76 moves X, Y and Z only");
        }
        let (start, end) = (self.state.position, self.end_of(words));
        let thread = Thread::of(words, &start, &end, self.state.lathe_diameter)?;
        let mut at = start;
        let mut pass = 1_u32;
        let mut depth = thread.crests + thread.first_depth;
        while depth < thread.bottom() {
            thread.pass(depth, &mut at, self.state.feed_override, emit);
            pass += 1;
            depth = thread.crests + thread.first_depth * f64::from(pass).powf(1.0 / thread.degression);
        }
        for _ in 0..=thread.spring_passes {
            thread.pass(thread.bottom(), &mut at, self.state.feed_override, emit);
        }
        emit.call(Canon::StraightTraverse(end));
        self.state.position = end;
        self.state.motion = Some(MotionMode::ThreadingCycle);
        Ok(())
    }
}

impl Thread {
    fn of(words: &Words, start: &Pose, end: &Pose, is_diameter: bool) -> BlockResult<Thread> {
        let word = |letter| words.get(letter).unwrap_or_default();
        // Under G7, lengths across the axis are given as diameters.
        let scale = if is_diameter { 0.5 } else { 1.0 };
        let [offset, first_depth, full_depth] = [b'i', b'j', b'k'].map(|letter| word(letter) * scale);
        let wrong = |letter: u8, message: &str| fault(ErrorCode::BadThread, words.span(letter), message);
        if word(b'p') <= 0.0 {
            return wrong(b'p', "the pitch P of G76 must be greater than 0");
        }
        if offset == 0.0 {
            return wrong(b'i', "I of G76, from the drive line to the crests, must not be 0");
        }
        if first_depth <= 0.0 || first_depth >= full_depth {
            return wrong(b'j', "the first depth J of G76 must be greater than 0 and less than the full depth K");
        }
        if word(b'q').abs() >= 90.0 {
            return wrong(b'q', "the angle of infeed Q of G76 must be less than 90 degrees");
        }
        if word(b'l') > 3.0 {
            return wrong(b'l', "L of G76 is 0 (no taper), 1 (entry), 2 (exit) or 3 (both)");
        }
        let degression = words.get(b'r').unwrap_or(1.0).max(1.0);
        let passes = (full_depth / first_depth).powf(degression) + word(b'h');
        if passes.is_nan() || passes > MAX_PASSES {
            return wrong(b'j', "G76 would need more than 10 000 passes");
        }
        let taper = word(b'e');
        let along = if end[Axis::Z] > start[Axis::Z] { 1.0 } else { -1.0 };
        let ends = if taper > 0.0 { word(b'l') as u32 } else { 0 };
        Ok(Thread {
            pitch: word(b'p'),
            drive_line: start[Axis::X],
            crests: offset.abs(),
            inward: if offset > 0.0 { 1.0 } else { -1.0 },
            first_depth,
            full_depth,
            degression,
            slope: -along * word(b'q').to_radians().tan(),
            spring_passes: word(b'h') as u32,
            taper,
            tapered_entry: ends & 1 != 0,
            tapered_exit: ends & 2 != 0,
            along,
            from: start[Axis::Z],
            to: end[Axis::Z],
        })
    }

    /// Returns the full depth below the drive line.
    fn bottom(&self) -> f64 {
        self.crests + self.full_depth
    }

    /// Emits one pass at this depth below the drive line.
    fn pass(&self, depth: f64, at: &mut Pose, feed_override: bool, emit: &mut Emitter<'_>) {
        let mut go = |fast: bool, x: f64, z: f64, emit: &mut Emitter<'_>| {
            (at[Axis::X], at[Axis::Z]) = (x, z);
            emit.call(if fast { Canon::StraightTraverse(*at) } else { Canon::StraightFeed(*at) });
        };
        // The order of these sums is that of LinuxCNC, to the last digit.
        let cut = self.drive_line + self.inward * depth;
        let clear = cut - self.inward * self.bottom();
        let flank = cut - self.inward * self.full_depth;
        let back = (depth - self.crests) * self.slope;
        let from = self.from - back;
        let to = self.to + self.full_depth * self.slope - back;
        let taper_pitch = self.pitch * self.full_depth.hypot(self.taper) / self.taper;
        let synch = |pitch| Canon::StartSpeedFeedSynch { pitch, start_degrees: 0.0 };
        go(true, clear, from, emit);
        if self.tapered_entry {
            emit.call(Canon::DisableFeedOverride);
            emit.call(synch(taper_pitch));
            go(false, flank, from, emit);
            go(false, cut, from + self.along * self.taper, emit);
        } else {
            go(true, cut, from, emit);
            emit.call(Canon::DisableFeedOverride);
        }
        emit.call(synch(self.pitch));
        if self.tapered_exit {
            go(false, cut, to - self.along * self.taper, emit);
            emit.call(synch(taper_pitch));
            go(false, flank, to, emit);
        } else {
            go(false, cut, to, emit);
        }
        emit.call(Canon::StopSpeedFeedSynch);
        go(true, clear, to, emit);
        if feed_override {
            emit.call(Canon::EnableFeedOverride);
        }
    }
}

/// Checks the words without which G76 is refused before any of its block is executed.
pub(super) fn check_thread(words: &Words) -> BlockResult<()> {
    let missing = match b"ijkp".iter().copied().find(|letter| !words.has(*letter)) {
        None => return Ok(()),
        Some(b'i') => "an I word: from the drive line to the crests",
        Some(b'j') => "a J word: the first depth",
        Some(b'k') => "a K word: the full depth",
        Some(_) => "a P word: the pitch",
    };
    fault(ErrorCode::WordMissing, words.g_span(GroupG::Motion), format!("G76 needs {missing}"))
}
