//! Threads: the records of a geared stretch, and the angle at which it begins (SPN-11 … SPN-13, SPN-17).
//!
//! A stretch is planned like any path, at its pitch times the plan speed, by a planner of its own. Its ramps are
//! records like all others, gone through alike at any speed. It begins early by as much as the ramp takes longer than
//! the thread, so that the straight part lies on the helix through the start point at the index and start angle.
//!
//! Invariant: the records depend on the stretch, the machine and the commanded speed alone.

use std::collections::BTreeMap;

use retrace_config::{EncoderConfig, MachineConfig};
use retrace_core::gear::GearLimits;
use retrace_core::{Distance, Flags, Rate, Record};
use retrace_link::{GearStart, SpindleControl};
use retrace_motion::{FeedRate, MachineLimits, PathMode, Planner};

/// Share of the plan's acceleration and jerk that a thread uses. The rest is for what the spindle does.
const ACCELERATION_SHARE: f64 = 0.75;
/// Maximum records of a stretch: 17 minutes at a control period of 1 ms.
const MAX_RECORDS: f64 = 1_048_576.0;
/// Largest relative difference of a record in the straight part from a whole one.
const STRAIGHT: f64 = 1e-6;

/// A straight piece of a thread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThreadPiece<const A: usize> {
    /// End, mm in machine coordinates.
    pub end_mm: [f64; A],
    /// Distance along the piece in a turn of the spindle, mm.
    pub pitch_mm: f64,
    /// How it meets the next piece.
    pub mode: PathMode,
    /// Program line.
    pub line: u32,
}

/// A geared stretch: pieces of a thread one behind the other, from rest to rest.
#[derive(Clone, Debug, PartialEq)]
pub struct ThreadStretch<const A: usize> {
    /// The pieces.
    pub pieces: Vec<ThreadPiece<A>>,
    /// Commanded speed, revolutions per minute.
    pub rpm: f64,
    /// Angle from the index at which it begins, degrees.
    pub start_degrees: f64,
}

/// Records of a geared stretch.
#[derive(Clone, Debug, PartialEq)]
pub struct ThreadPlan<const A: usize> {
    /// The records, each with its program line.
    pub records: Vec<Record<A>>,
    /// What the card receives.
    pub gear: GearStart,
    /// Distances at the beginning and at the end in which the path is not at its full pitch, mm.
    pub run_mm: [f64; 2],
    /// Distance along the longest piece before the first record, and behind each, mm.
    along_mm: Vec<f64>,
    /// Places between which the path is at its full pitch.
    straight: [usize; 2],
}

impl<const A: usize> ThreadPlan<A> {
    /// Makes it a tap of a single piece that turns at this distance, mm, and goes back at this part of its speed.
    ///
    /// # Errors
    /// [`ThreadError::TooShort`] if the path is not at its full pitch there.
    pub(crate) fn turning_at(mut self, depth_mm: f64, return_factor: f64) -> Result<Self, ThreadError> {
        let records = self.along_mm.partition_point(|&mm| mm < depth_mm);
        let [first, end] = self.straight;
        if !(first..=end).contains(&records) {
            let [run_in, run_out] = self.run_mm;
            return Err(ThreadError::TooShort { needs_mm: run_in.max(run_out) });
        }
        self.gear.control = SpindleControl::Tap(records as u32);
        self.gear.reverse_share = (256.0 * return_factor).round().clamp(1.0, f64::from(u16::MAX)) as u16;
        Ok(self)
    }
}

/// Distances in which the threads of a program are not at their full pitch.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ThreadRuns {
    by_line: BTreeMap<u32, [f64; 2]>,
}

impl ThreadRuns {
    /// Adds the run-in and run-out of a thread that begins in this line, mm.
    pub(crate) fn add(&mut self, line: u32, run_mm: [f64; 2]) {
        let longest = self.by_line.entry(line).or_default();
        *longest = [0, 1].map(|end| longest[end].max(run_mm[end]));
    }

    /// The lines in which threads begin, each with the longest run-in and run-out at it, mm.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (u32, [f64; 2])> {
        self.by_line.iter().map(|(&line, &run_mm)| (line, run_mm))
    }
}

/// Reason why a stretch cannot be planned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ThreadError {
    /// An axis is too slow; at most this speed fits, revolutions per minute.
    TooFast {
        /// Highest speed.
        highest_rpm: f64,
    },
    /// The ramps at both ends leave no thread.
    TooShort {
        /// Distance that each ramp needs, about, mm.
        needs_mm: f64,
    },
    /// It has more turns than are planned as one.
    TooLong {
        /// Its turns.
        turns: f64,
    },
    /// The path stops inside: at a corner that is not blended.
    StopsInside,
    /// The spindle is commanded to turn at no speed.
    NoSpeed,
    /// A tap, and the spindle cannot be reversed.
    NotReversible,
    /// The planner rejects a piece.
    Move(retrace_motion::MoveError),
}

impl std::fmt::Display for ThreadError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::TooFast { highest_rpm } => {
                write!(f, "an axis cannot follow the spindle in this thread; at most S{:.0} fits", highest_rpm.floor())
            }
            Self::TooShort { needs_mm } => write!(
                f,
                "the thread is too short: the axes need about {needs_mm:.2} mm at either end to come to the pitch at \
                 this speed"
            ),
            Self::TooLong { turns } => {
                write!(f, "a thread of {turns:.0} turns takes longer at this speed than is planned as one")
            }
            Self::StopsInside => write!(f, "the path stops in a corner between two threads, and the spindle does not"),
            Self::NoSpeed => write!(f, "a thread (G33, G76) at a speed at which a turn takes too long"),
            Self::NotReversible => write!(f, "a rigid tap, and the spindle of the machine file cannot be reversed"),
            Self::Move(error) => write!(f, "{error}"),
        }
    }
}

impl std::error::Error for ThreadError {}

/// The longest piece, in turns.
struct MainPiece<const A: usize> {
    index: usize,
    from_mm: [f64; A],
    /// Unit vector along it.
    direction: [f64; A],
    length_mm: f64,
    /// Turns of the pieces before it, their length, and the length of all.
    turns_before: f64,
    before_mm: f64,
    total_mm: f64,
}

/// Planner of the stretches of a program. The passes of a thread leave the work in the same corner, which it searches
/// a glide for once.
#[derive(Debug, Default)]
pub struct ThreadPlanner<const A: usize> {
    /// Planner of the last stretch, for its glides.
    last: Option<Planner<A>>,
    /// Memory for the records of the next plan, and for its distances along the longest piece.
    records: Vec<Record<A>>,
    along_mm: Vec<f64>,
}

impl<const A: usize> ThreadPlanner<A> {
    /// Plans a stretch from a position at rest. The plan does not depend on the stretches before it.
    ///
    /// # Errors
    /// The reason why the machine cannot follow a spindle there.
    pub fn plan(
        &mut self,
        stretch: &ThreadStretch<A>,
        machine: &MachineConfig,
        encoder: &EncoderConfig,
        from_mm: [f64; A],
    ) -> Result<ThreadPlan<A>, ThreadError> {
        stretch.plan(machine, encoder, from_mm, self)
    }

    /// Run-in and run-out of a stretch from a position at rest, mm. The memory of its plan is retained.
    fn run_mm(
        &mut self,
        stretch: &ThreadStretch<A>,
        machine: &MachineConfig,
        encoder: &EncoderConfig,
        from_mm: [f64; A],
    ) -> Result<[f64; 2], ThreadError> {
        let plan = self.plan(stretch, machine, encoder, from_mm)?;
        (self.records, self.along_mm) = (plan.records, plan.along_mm);
        Ok(plan.run_mm)
    }
}

/// Planner of the threads of a check. It plans them over as many axes as the run does: where these are fewer than the
/// check has, the tolerance of a corner is larger.
#[derive(Debug, Default)]
pub(crate) struct ThreadCheck {
    of_four: ThreadPlanner<4>,
    of_nine: ThreadPlanner<9>,
}

impl ThreadCheck {
    /// Run-in and run-out of a stretch from a position at rest, mm.
    ///
    /// # Errors
    /// The reason why the machine cannot follow a spindle there.
    pub(crate) fn run_mm<const A: usize>(
        &mut self,
        stretch: &ThreadStretch<A>,
        machine: &MachineConfig,
        encoder: &EncoderConfig,
        from_mm: [f64; A],
    ) -> Result<[f64; 2], ThreadError> {
        if machine.axes.len() <= 4 {
            self.of_four.run_mm(&stretch.resized(), machine, encoder, resized(&from_mm))
        } else {
            self.of_nine.run_mm(&stretch.resized(), machine, encoder, resized(&from_mm))
        }
    }
}

/// A position with another number of axes; those that are missing are at 0.
fn resized<const A: usize, const B: usize>(position_mm: &[f64; A]) -> [f64; B] {
    std::array::from_fn(|axis| position_mm.get(axis).copied().unwrap_or(0.0))
}

impl<const A: usize> ThreadStretch<A> {
    fn resized<const B: usize>(&self) -> ThreadStretch<B> {
        let piece = |piece: &ThreadPiece<A>| ThreadPiece {
            end_mm: resized(&piece.end_mm),
            pitch_mm: piece.pitch_mm,
            mode: piece.mode,
            line: piece.line,
        };
        let pieces = self.pieces.iter().map(piece).collect();
        ThreadStretch { pieces, rpm: self.rpm, start_degrees: self.start_degrees }
    }

    fn plan(
        &self,
        machine: &MachineConfig,
        encoder: &EncoderConfig,
        from_mm: [f64; A],
        memory: &mut ThreadPlanner<A>,
    ) -> Result<ThreadPlan<A>, ThreadError> {
        let share = ACCELERATION_SHARE * (1.0 - machine.reserve);
        let limits = MachineLimits { reserve: 1.0 - share, ..machine.limits::<A>() };
        let records_per_turn = self.records_per_turn(encoder, limits.period_s)?;
        let per_s = 1.0 / (f64::from(records_per_turn) * limits.period_s);
        let fastest = self.highest_rate(&limits, per_s, from_mm);
        if fastest < 1.0 {
            return Err(ThreadError::TooFast { highest_rpm: self.rpm * fastest });
        }
        let main = self.main_piece(from_mm);
        let turns = self.turns(from_mm);
        if turns * f64::from(records_per_turn) > MAX_RECORDS {
            return Err(ThreadError::TooLong { turns });
        }
        // Distances along the main piece at each place: before the first record, and behind each.
        let (records, along_mm) = self.planned(limits, per_s, &main, from_mm, memory)?;
        let pitch_mm = self.pieces[main.index].pitch_mm;
        let step_mm = pitch_mm / f64::from(records_per_turn);
        let Some([first, end]) = straight_part(&along_mm, step_mm, main.length_mm) else {
            return Err(ThreadError::TooShort { needs_mm: run_in_mm(&along_mm, step_mm) });
        };
        // Turns on the helix to that place, less those of the records before it.
        let anchor = main.turns_before + along_mm[first] / pitch_mm - first as f64 / f64::from(records_per_turn);
        let near_end = if self.pieces.len() > 1 { records.len() } else { first.max(records.len() - end) };
        let gear = GearStart {
            length: u32::try_from(records.len()).unwrap_or(u32::MAX),
            records_per_turn,
            start_angle: ((anchor + self.start_degrees / 360.0).rem_euclid(1.0) * 4_294_967_296.0) as u32,
            ahead: encoder.records_ahead,
            limits: GearLimits {
                rate: Rate::from_units((fastest.min(share.sqrt().recip()).min(8.0) * 4_294_967_296.0) as i64),
                near_end: Distance::records(near_end as i64),
                tolerance: Distance::from_units((encoder.thread_tolerance_mm / step_mm * 4_294_967_296.0) as i64),
            },
            ramp_share: (share * 65_536.0).ceil().min(65_535.0) as u16,
            reverse_share: self.reverse_share(encoder),
            control: if encoder.holds_in_thread { SpindleControl::Held } else { SpindleControl::None },
        };
        let run_mm = [main.before_mm + along_mm[first], main.total_mm - main.before_mm - along_mm[end]];
        Ok(ThreadPlan { records, gear, run_mm, along_mm, straight: [first, end] })
    }

    /// Speed of the spindle where the stretch is reversed, in units of 2⁻⁸ of the commanded speed: no faster than that,
    /// and 0 where it cannot be reversed.
    fn reverse_share(&self, encoder: &EncoderConfig) -> u16 {
        let share = encoder.reverse_rpm.map_or(1.0, |rpm| (rpm / self.rpm).min(1.0));
        if encoder.is_reversible { ((share * 256.0) as u16).max(1) } else { 0 }
    }

    /// Program line in which it begins.
    #[must_use]
    pub fn line(&self) -> u32 {
        self.pieces.first().map_or(0, |piece| piece.line)
    }

    /// Records in a turn: the plan speed is the least one above the commanded speed with its margin at which they are a
    /// whole number.
    fn records_per_turn(&self, encoder: &EncoderConfig, period_s: f64) -> Result<u16, ThreadError> {
        let records = 60.0 / (self.rpm * encoder.thread_margin * period_s);
        match records {
            ..2.0 => Err(ThreadError::TooFast { highest_rpm: 30.0 / (encoder.thread_margin * period_s) }),
            2.0..65_536.0 => Ok(records as u16),
            _ => Err(ThreadError::NoSpeed),
        }
    }

    /// Highest rate at which the axes and the path keep their velocity on every piece, where rate 1 is a turn in
    /// 1/`per_s`.
    fn highest_rate(&self, limits: &MachineLimits<A>, per_s: f64, from_mm: [f64; A]) -> f64 {
        let mut highest = f64::INFINITY;
        let mut from = from_mm;
        for piece in &self.pieces {
            let speed = piece.pitch_mm * per_s;
            let (direction, _) = direction_of(&from, &piece.end_mm);
            highest = highest.min(limits.path_velocity_mm_s / speed);
            for (velocity, share) in limits.velocity_mm_s.iter().zip(direction) {
                highest = highest.min(velocity / (share.abs() * speed));
            }
            from = piece.end_mm;
        }
        highest
    }

    /// Turns of the spindle in all pieces.
    fn turns(&self, from_mm: [f64; A]) -> f64 {
        let ends = self.pieces.iter().map(|piece| piece.end_mm);
        let from = std::iter::once(from_mm).chain(ends);
        from.zip(&self.pieces).map(|(from, piece)| direction_of(&from, &piece.end_mm).1 / piece.pitch_mm).sum()
    }

    fn main_piece(&self, from_mm: [f64; A]) -> MainPiece<A> {
        let (mut from, mut turns, mut before_mm) = (from_mm, 0.0, 0.0);
        let (mut main, mut most) = (None, -1.0);
        for (index, piece) in self.pieces.iter().enumerate() {
            let (direction, length_mm) = direction_of(&from, &piece.end_mm);
            let own = length_mm / piece.pitch_mm;
            if own > most {
                most = own;
                let (from_mm, turns_before) = (from, turns);
                main = Some(MainPiece { index, from_mm, direction, length_mm, turns_before, before_mm, total_mm: 0.0 });
            }
            (from, turns, before_mm) = (piece.end_mm, turns + own, before_mm + length_mm);
        }
        let none = MainPiece {
            index: 0,
            from_mm,
            direction: [0.0; A],
            length_mm: 0.0,
            turns_before: 0.0,
            before_mm: 0.0,
            total_mm: 0.0,
        };
        MainPiece { total_mm: before_mm, ..main.unwrap_or(none) }
    }

    /// Plans the pieces at `per_s` turns per second. Returns the records, and the distance along the main piece before
    /// the first and behind each.
    fn planned(
        &self,
        limits: MachineLimits<A>,
        per_s: f64,
        main: &MainPiece<A>,
        from_mm: [f64; A],
        memory: &mut ThreadPlanner<A>,
    ) -> Result<(Vec<Record<A>>, Vec<f64>), ThreadError> {
        let along = |at: &[f64; A]| -> f64 {
            at.iter().zip(&main.from_mm).zip(&main.direction).map(|((at, from), share)| (at - from) * share).sum()
        };
        // A machine that was checked has limits, and only its reserve differs.
        let mut planner = Planner::new(limits, from_mm).map_err(|_| ThreadError::NoSpeed)?.with_exact_feed();
        if let Some(last) = memory.last.take() {
            planner = planner.with_glides_of(last);
        }
        let (mut records, mut along_mm) = (std::mem::take(&mut memory.records), std::mem::take(&mut memory.along_mm));
        records.clear();
        along_mm.clear();
        along_mm.push(along(&from_mm));
        let mut take = |planner: &mut Planner<A>| {
            while let Some(record) = planner.next_record() {
                let line = self.pieces.get(record.line as usize).map_or(0, |piece| piece.line);
                records.push(Record { line, flags: record.flags.with(Flags::GEARED), ..record });
                along_mm.push(along(&planner.set_point().position_mm));
            }
        };
        for (tag, piece) in (0u32..).zip(&self.pieces) {
            let feed = FeedRate::PerSecond(piece.pitch_mm * per_s);
            planner.line(piece.end_mm, feed, piece.mode, tag).map_err(ThreadError::Move)?;
            take(&mut planner);
        }
        planner.stop(Flags::NONE);
        take(&mut planner);
        memory.last = Some(planner);
        let stops = records.iter().filter(|record| record.flags.contains(Flags::REST)).count();
        if stops > 1 { Err(ThreadError::StopsInside) } else { Ok((records, along_mm)) }
    }
}

/// Direction from one position to another, and the distance, mm.
fn direction_of<const A: usize>(from: &[f64; A], to: &[f64; A]) -> ([f64; A], f64) {
    let mut direction = [0.0; A];
    for (slot, (from, to)) in direction.iter_mut().zip(from.iter().zip(to)) {
        *slot = to - from;
    }
    let length = direction.iter().map(|mm| mm * mm).sum::<f64>().sqrt();
    (direction.map(|mm| if length > 0.0 { mm / length } else { 0.0 }), length)
}

/// Whether a record from one place to the next is a whole one at constant speed.
fn is_whole(along_mm: &[f64], step_mm: f64) -> bool {
    ((along_mm[1] - along_mm[0]) / step_mm - 1.0).abs() < STRAIGHT
}

/// Returns the places between which the longest run of records at constant speed lies, inside the main piece.
fn straight_part(along_mm: &[f64], step_mm: f64, length_mm: f64) -> Option<[usize; 2]> {
    let (mut best, mut begin) = (None, None);
    for (place, pair) in along_mm.windows(2).enumerate() {
        let is_inside = pair[0] >= -step_mm && pair[1] <= length_mm + step_mm;
        if !is_inside || !is_whole(pair, step_mm) {
            begin = None;
            continue;
        }
        let first = *begin.get_or_insert(place);
        if best.is_none_or(|[from, to]: [usize; 2]| place + 1 - first > to - from) {
            best = Some([first, place + 1]);
        }
    }
    best
}

/// Distance that the ramp has gone where it ends: at the largest speed.
fn run_in_mm(along_mm: &[f64], step_mm: f64) -> f64 {
    let fastest = along_mm.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
    // The ramp's distance grows about with the square of its speed.
    let half = along_mm.last().zip(along_mm.first()).map_or(0.0, |(last, first)| (last - first) / 2.0);
    if fastest > 0.0 { half * (step_mm / fastest).powi(2) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lathe() -> MachineConfig {
        let axis = |name: &str| {
            format!(
                "[[axis]]\nname = \"{name}\"\npulses_per_mm = 1000\nmax_velocity_mm_per_s = \
                 100\nmax_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-200, 200]\n"
            )
        };
        let text = format!("{}{}[spindle]\ncounts_per_turn = 400\nmax_rpm = 3000\n", axis("x"), axis("z"));
        MachineConfig::parse(&text, "lathe").expect("valid")
    }

    fn planned(pieces: &[ThreadPiece<2>], rpm: f64) -> Result<ThreadPlan<2>, ThreadError> {
        let machine = lathe();
        let encoder = machine.encoder.expect("an encoder");
        let stretch = ThreadStretch { pieces: pieces.to_vec(), rpm, start_degrees: 0.0 };
        ThreadPlanner::default().plan(&stretch, &machine, &encoder, [0.0; 2])
    }

    fn along_z(end: f64, pitch_mm: f64) -> ThreadPiece<2> {
        ThreadPiece { end_mm: [0.0, end], pitch_mm, mode: PathMode::ExactStop, line: 7 }
    }

    #[test]
    fn the_straight_part_lies_on_the_helix_through_the_start_point() {
        let plan = planned(&[along_z(-20.0, 1.5)], 1000.0).expect("it fits");
        assert_eq!((plan.gear.records_per_turn, plan.gear.length as usize), (48, plan.records.len()));
        let start = f64::from(plan.gear.start_angle) / 4_294_967_296.0;
        let mut z = 0i64;
        let mut straight = 0;
        for (place, record) in plan.records.iter().enumerate() {
            let before = z;
            z += i64::from(record.increments[1]);
            assert_eq!((record.line, record.flags.contains(Flags::GEARED)), (7, true));
            let is_straight =
                -before as f64 >= plan.run_mm[0] * 1000.0 && -z as f64 <= 20_000.0 - plan.run_mm[1] * 1000.0;
            if is_straight {
                straight += 1;
                // turns since the index, and turns on the helix
                let turns = start + (place + 1) as f64 / 48.0;
                let off = turns - z as f64 / -1500.0;
                assert!((off - off.round()).abs() * 1500.0 <= 0.6, "{place} {off}");
            }
        }
        assert!(straight > 500 && z == -20_000);
        assert!(plan.records.last().expect("some").flags.contains(Flags::REST));
        let [run_in, run_out] = plan.run_mm;
        // 31.25 mm/s at 675 mm/s² and 13 500 mm/s³
        assert!((1.3..2.0).contains(&run_in) && (run_in - run_out).abs() < 0.1, "{:?}", plan.run_mm);
    }

    #[test]
    fn what_does_not_fit_is_refused_with_what_would() {
        let Err(ThreadError::TooFast { highest_rpm }) = planned(&[along_z(-20.0, 6.0)], 1000.0) else {
            panic!("150 mm/s do not fit")
        };
        assert!(planned(&[along_z(-40.0, 6.0)], highest_rpm * 0.95).is_ok(), "{highest_rpm}");
        let Err(ThreadError::TooShort { needs_mm }) = planned(&[along_z(-2.0, 1.5)], 1000.0) else {
            panic!("2 mm are shorter than both ramps")
        };
        assert!((1.0..2.5).contains(&needs_mm), "{needs_mm}");
        assert_eq!(planned(&[along_z(-2.0, 1.5)], 0.0), Err(ThreadError::NoSpeed));
        assert_eq!(planned(&[along_z(-50.0, 0.001)], 1000.0), Err(ThreadError::TooLong { turns: 50_000.0 }));
        assert!(matches!(planned(&[along_z(-2.0, 1.5)], 100_000.0), Err(ThreadError::TooFast { .. })));
        let corner = |mode| ThreadPiece { end_mm: [5.0, -25.0], mode, ..along_z(0.0, 1.5) };
        let exact = ThreadPiece { mode: PathMode::ExactPath, ..along_z(-20.0, 1.5) };
        assert_eq!(planned(&[exact, corner(exact.mode)], 300.0), Err(ThreadError::StopsInside));
        let blended = ThreadPiece { mode: PathMode::blend(0.05), ..exact };
        assert_eq!(planned(&[blended, corner(blended.mode)], 300.0).map(|_| ()), Ok(()));
    }

    /// A run of up to four axes plans for four, and a check for nine.
    #[test]
    fn a_check_plans_the_threads_as_a_run_does() {
        let machine = lathe();
        let encoder = machine.encoder.expect("an encoder");
        let pieces = vec![
            ThreadPiece { mode: PathMode::blend(0.002), ..along_z(-20.0, 1.5) },
            ThreadPiece { end_mm: [5.0, -25.0], mode: PathMode::blend(0.002), ..along_z(0.0, 1.5) },
        ];
        let stretch = ThreadStretch { pieces, rpm: 300.0, start_degrees: 0.0 };
        let mut planner = ThreadPlanner::<4>::default();
        let run = planner.plan(&stretch.resized(), &machine, &encoder, [0.0; 4]).expect("it fits").run_mm;
        let check = |of: &mut ThreadCheck| of.run_mm(&stretch.resized::<9>(), &machine, &encoder, [0.0; 9]);
        assert_eq!(check(&mut ThreadCheck::default()), Ok(run));
    }

    proptest! {
        /// A plan with a glide that an earlier one has found is the plan without it.
        #[test]
        fn a_plan_does_not_depend_on_the_stretches_before_it(
            passes in prop::collection::vec((10.0f64..12.0, 1.0f64..1.2, 4.0f64..6.0), 1..4), rpm in 200.0f64..300.0,
        ) {
            let machine = lathe();
            let encoder = machine.encoder.expect("an encoder");
            let mut planner = ThreadPlanner::default();
            for (length, pitch, leave) in passes {
                let mode = PathMode::blend(0.02);
                let pieces = vec![
                    ThreadPiece { mode, ..along_z(-length, pitch) },
                    ThreadPiece { end_mm: [leave, -length - leave], mode, ..along_z(0.0, pitch) },
                ];
                let stretch = ThreadStretch { pieces: pieces.clone(), rpm, start_degrees: 0.0 };
                prop_assert_eq!(planner.plan(&stretch, &machine, &encoder, [0.0; 2]), planned(&pieces, rpm));
            }
        }

        /// The helix does not depend on the ramp: any pitch, speed and direction that fit begin at the same angle of
        /// the straight part.
        #[test]
        fn every_thread_lies_on_its_helix(
            pitch in 0.3f64..3.0, rpm in 60.0f64..1200.0, length in 15.0f64..60.0, up: bool,
        ) {
            let end = if up { length } else { -length };
            let plan = match planned(&[along_z(end, pitch)], rpm) {
                Ok(plan) => plan,
                Err(error) => {
                    prop_assert!(matches!(error, ThreadError::TooFast { .. }), "{error:?}");
                    return Ok(());
                }
            };
            let per_turn = f64::from(plan.gear.records_per_turn);
            let middle = plan.records.len() / 2;
            let z: i64 = plan.records[..middle].iter().map(|record| i64::from(record.increments[1])).sum();
            let turns = f64::from(plan.gear.start_angle) / 4_294_967_296.0 + middle as f64 / per_turn;
            let off = turns - (z as f64 / 1000.0).abs() / pitch;
            prop_assert!((off - off.round()).abs() * pitch * 1000.0 <= 0.6, "{off}");
        }
    }
}
