//! Emission: the committed plan, sampled once per control period, becomes records of whole increments (REV-1).
//!
//! Invariant: after every record the sum of all increments is the position times pulses per mm, rounded half away from
//! zero: it is never further than half a pulse from the plan and nothing accumulates. A stop takes whole periods: its
//! last record ends exactly at the commanded position, at rest. Nothing is allocated here.

mod unplayed;

use std::collections::VecDeque;

use retrace_core::{FeedShare, Flags, RapidCap, Record};

use crate::blend::size;
use crate::curve::Derivatives;
use crate::glide::glide_segment::{GlideSample, GlideSegment};
use crate::glide::ramp_pair::CELLS;
use crate::limits::MachineLimits;
use crate::line_mark::LineMark;
use crate::piece::{PathPiece, RAPID};
use crate::profile::{Profile, SIGNS};
use crate::pulses::{counts_of, increment_of};
use crate::rapid_cap::{Shares, SpeedCap, cap, larger, larger_of, shares_of};
use crate::sampler::{CellSampler, PhaseSampler};

/// Part of the committed plan.
#[derive(Clone, Copy, Debug)]
pub(crate) enum PlanItem<const A: usize> {
    /// Profile over `length` mm from the end of the item before it; it ends in piece number `last`.
    Span { profile: Profile, duration: f64, length: f64, last: u64 },
    /// Glide at the front of the queue of glides; pieces before number `piece` are done.
    Glide { piece: u64 },
    /// Rest at `end`; pieces before number `piece` are done.
    Stop { piece: u64, end: [f64; A], flags: Flags, tag: u32 },
}

/// Unrounded set-point: the state of the plan at the end of a record.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SetPoint<const A: usize> {
    /// Position of each axis, mm or degrees.
    pub position_mm: [f64; A],
    /// Speed along the path, mm/s, not negative.
    pub velocity_mm_s: f64,
    /// Acceleration along the path, mm/s².
    pub acceleration_mm_s2: f64,
    /// Jerk along the path, mm/s³.
    pub jerk_mm_s3: f64,
}

/// Pieces and plan that wait to be emitted.
#[derive(Debug)]
pub(crate) struct Emitter<const A: usize> {
    limits: MachineLimits<A>,
    items: VecDeque<PlanItem<A>>,
    glides: VecDeque<GlideSegment<A>>,
    pieces: VecDeque<PathPiece<A>>,
    /// Program lines of the pieces other than the one at the start of each.
    marks: VecDeque<LineMark>,
    /// Number of the front piece.
    first_piece: u64,
    /// Start of the front piece, in mm from the start of the front span.
    piece_start: f64,
    /// Demand of the front piece on the axes, while a span is in front.
    demand: SpeedCap,
    /// Time of the last sample after the start of the front item, s; not above 0 while the item is not entered.
    time: f64,
    phase: PhaseSampler,
    cell: CellSampler<A>,
    /// Whole pulses so far.
    counts: [f64; A],
    /// Reciprocals of what the plan may use of each axis: velocity, acceleration, jerk.
    per_max: Derivatives<A>,
    point: SetPoint<A>,
    /// Rapid-retrace cap of the last record.
    cap: RapidCap,
    /// Demand of the current record up to the current state.
    period_demand: PeriodDemand,
    /// Requested speed of the motion at the end of the last record, mm/s.
    feed: f64,
    /// Position at the end of the last record.
    recorded: [f64; A],
}

/// Demand of one record on the limits.
#[derive(Clone, Copy, Debug)]
struct PeriodDemand {
    /// Shares of the axes themselves in glides.
    axes: Shares,
    /// Demand of all pieces that were passed; `None` where there is none.
    demand: Option<SpeedCap>,
    jerk: f64,
    rough: bool,
    kind: RecordKind,
}

/// Kind of motion in a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum RecordKind {
    /// No motion yet.
    None,
    Rapid,
    /// At least part of it is not a rapid move.
    Feed,
}

impl RecordKind {
    const fn of(rapid: bool) -> Self {
        if rapid { Self::Rapid } else { Self::Feed }
    }

    /// This kind combined with motion of kind `other`.
    fn with(self, other: Self) -> Self {
        if self == Self::None || self == other { other } else { Self::Feed }
    }
}

impl PeriodDemand {
    const NOTHING: Self = Self { axes: [0.0; 3], demand: None, jerk: 0.0, rough: false, kind: RecordKind::None };
}

/// Part of a period: samples that fall this short before the end of an item are taken at its end.
const LATE: f64 = 1e-6;

impl<const A: usize> Emitter<A> {
    pub(crate) fn new(limits: MachineLimits<A>, start: [f64; A]) -> Self {
        let planned = limits.planned();
        let rest = SetPoint { position_mm: start, velocity_mm_s: 0.0, acceleration_mm_s2: 0.0, jerk_mm_s3: 0.0 };
        Self {
            limits,
            items: VecDeque::new(),
            glides: VecDeque::new(),
            pieces: VecDeque::new(),
            marks: VecDeque::new(),
            first_piece: 0,
            piece_start: 0.0,
            demand: SpeedCap::NONE,
            time: 0.0,
            phase: PhaseSampler::NONE,
            cell: CellSampler::NONE,
            counts: counts_of(&start, &limits.pulses_per_mm),
            per_max: Derivatives {
                first: planned.v.map(f64::recip),
                second: planned.a.map(f64::recip),
                third: planned.j.map(f64::recip),
            },
            point: rest,
            cap: RapidCap::PLANNED,
            period_demand: PeriodDemand::NOTHING,
            feed: RAPID,
            recorded: start,
        }
    }

    /// Appends a piece of path and returns its number.
    pub(crate) fn append(&mut self, piece: PathPiece<A>) -> u64 {
        self.pieces.push_back(piece);
        self.first_piece + self.pieces.len() as u64 - 1
    }

    /// Appends the marks of pieces that are appended later.
    pub(crate) fn mark(&mut self, marks: &[LineMark]) {
        self.marks.extend(marks);
    }

    /// Commits a part of the plan.
    pub(crate) fn commit(&mut self, item: PlanItem<A>) {
        self.items.push_back(item);
        if self.items.len() == 1 {
            self.enter();
        }
    }

    /// Commits a glide. Pieces before number `piece` are done when it begins.
    pub(crate) fn commit_glide(&mut self, glide: GlideSegment<A>, piece: u64) {
        self.glides.push_back(glide);
        self.commit(PlanItem::Glide { piece });
    }

    /// The last set-point.
    pub(crate) fn point(&self) -> &SetPoint<A> {
        &self.point
    }

    /// Moves the position by whole pulses without motion. Returns false, with nothing changed, while a part of the plan
    /// is waiting.
    pub(crate) fn displace(&mut self, pulses: [i64; A], pulses_per_mm: &[f64; A]) -> bool {
        if !self.items.is_empty() {
            return false;
        }
        for (axis, &pulses) in pulses.iter().enumerate() {
            self.counts[axis] += pulses as f64;
            self.point.position_mm[axis] += pulses as f64 / pulses_per_mm[axis];
        }
        self.recorded = self.point.position_mm;
        true
    }

    /// Record of the next control period; `None` where the committed plan ends before it.
    #[inline]
    pub(crate) fn next_record(&mut self) -> Option<Record<A>> {
        let time = self.time + self.limits.period_s;
        if time <= self.phase.until {
            self.time = time;
            return Some(self.sample());
        }
        if time <= self.cell.until {
            self.time = time;
            return Some(self.glide());
        }
        self.next_record_of_items()
    }

    /// Counts and skips the records within the current phase or cell. They are not sampled: what the next record has of
    /// its limits and increments is not that of a record behind them.
    pub(crate) fn skip_records(&mut self) -> u64 {
        let until = self.phase.until.max(self.cell.until);
        let mut skipped = 0;
        // The times are added up as in records, for the same rounding.
        while self.time + self.limits.period_s <= until {
            self.time += self.limits.period_s;
            skipped += 1;
        }
        skipped
    }

    /// Emits the record where the sample is outside the current phase or cell.
    fn next_record_of_items(&mut self) -> Option<Record<A>> {
        let period = self.limits.period_s;
        loop {
            let time = self.time + period;
            match self.items.front()? {
                &PlanItem::Stop { end, flags, tag, .. } => {
                    let record = self.arrive(end, flags, tag);
                    self.time = 0.0;
                    self.next_item();
                    return Some(record);
                }
                &PlanItem::Span { duration, length, .. } => {
                    let ends = time > duration - LATE * period;
                    self.pass_phases(if ends { f64::MAX } else { time });
                    if !ends {
                        self.time = time;
                        return Some(self.sample());
                    }
                    self.time -= duration;
                    self.piece_start -= length;
                    self.next_item();
                }
                PlanItem::Glide { .. } => {
                    let duration = self.glides.front()?.duration();
                    let ends = time > duration - LATE * period;
                    self.pass_cells(if ends { f64::MAX } else { time });
                    if !ends {
                        self.time = time;
                        return Some(self.glide());
                    }
                    self.time -= duration;
                    let glide = self.glides.pop_front();
                    self.feed = glide.map_or(self.feed, |glide| glide.feed(f64::MAX));
                    self.period_demand.kind =
                        self.period_demand.kind.with(RecordKind::of(glide.is_some_and(|glide| glide.is_rapid())));
                    self.next_item();
                }
            }
        }
    }

    fn next_item(&mut self) {
        self.items.pop_front();
        self.enter();
    }

    /// Enters the front item at its start.
    fn enter(&mut self) {
        (self.phase, self.cell.until) = (PhaseSampler::NONE, f64::MIN);
        match self.items.front() {
            Some(PlanItem::Span { .. }) => {
                self.feed = self.pieces.front().map_or(self.feed, |piece| piece.feed);
                self.demand =
                    self.pieces.front().map_or(SpeedCap::NONE, |piece| SpeedCap::of(&piece.bounds, &self.per_max));
                self.enter_phase(0);
            }
            Some(&PlanItem::Stop { piece, .. }) => self.pass_pieces(piece),
            Some(&PlanItem::Glide { piece }) => {
                self.pass_pieces(piece);
                self.enter_cell(0);
                self.period_demand.axes =
                    larger_of(self.period_demand.axes, shares_of(&self.cell.start.by_time, &self.per_max));
            }
            None => {}
        }
    }

    /// Passes all pieces before number `piece`; the motion is then at its start.
    fn pass_pieces(&mut self, piece: u64) {
        while self.first_piece < piece {
            self.next_piece();
        }
        self.piece_start = 0.0;
    }

    fn next_piece(&mut self) {
        self.period_demand.demand.get_or_insert(SpeedCap::NONE).raise(&self.demand);
        if let Some(piece) = self.pieces.front() {
            self.piece_start += piece.length;
            self.period_demand.kind = self.period_demand.kind.with(RecordKind::of(piece.is_rapid()));
            if piece.marks > 0 {
                self.marks.drain(..piece.marks as usize);
            }
        }
        self.pieces.pop_front();
        self.first_piece += 1;
        let Some(piece) = self.pieces.front() else { return };
        self.period_demand.rough |= piece.rough_entry;
        self.demand = SpeedCap::of(&piece.bounds, &self.per_max);
    }

    /// Enters phase `number` of the front span, in the end state of the phase before it.
    fn enter_phase(&mut self, number: usize) {
        let Some(PlanItem::Span { profile, duration, last, .. }) = self.items.front() else { return };
        let before = self.phase;
        let (since, state) = if number == 0 {
            (0.0, profile.start())
        } else {
            let time = profile.times[number - 1];
            let state = if profile.growth != 0.0 {
                before.start.after_growth(profile.growth, time)
            } else {
                before.start.after(before.jerk, time)
            };
            (before.since + time, state)
        };
        let end = if number == 6 { f64::MAX } else { since + profile.times[number] };
        self.phase = PhaseSampler {
            number,
            until: end.min(duration - LATE * self.limits.period_s),
            since,
            start: profile.entering(number, state),
            jerk: SIGNS[number] * profile.jerk,
            sixth: SIGNS[number] * profile.jerk / 6.0,
            growth: profile.growth,
            last: *last,
        };
    }

    /// Advances to the phase of the front span that contains time `t` after its start, and records every jerk on the
    /// way there.
    fn pass_phases(&mut self, t: f64) {
        let Some(&PlanItem::Span { profile, .. }) = self.items.front() else { return };
        loop {
            let PhaseSampler { number, since, jerk, .. } = self.phase;
            if profile.times[number] > 0.0 {
                self.period_demand.jerk = larger(self.period_demand.jerk, jerk.abs());
            }
            if number == 6 || t <= since + profile.times[number] {
                return;
            }
            self.enter_phase(number + 1);
        }
    }

    /// Enters cell `number` of the front glide.
    fn enter_cell(&mut self, number: usize) {
        let Some(glide) = self.glides.front() else { return };
        let since = number as f64 * glide.ramps.cell;
        let end = if number == CELLS - 1 { f64::MAX } else { since + glide.ramps.cell };
        self.cell = CellSampler {
            number,
            until: end.min(glide.duration() - LATE * self.limits.period_s),
            since,
            start: glide.at(number, since),
            tag: glide.tag(since + 0.5 * glide.ramps.cell),
        };
        self.feed = glide.feed(since + 0.5 * glide.ramps.cell);
    }

    /// Advances to the cell of the front glide that contains time `t` after its start, and records the demand of the
    /// axes on the way there.
    fn pass_cells(&mut self, t: f64) {
        while let Some(glide) = self.glides.front() {
            let CellSampler { number, since, .. } = self.cell;
            let end = since + glide.ramps.cell;
            if number + 1 < CELLS && t <= end {
                return;
            }
            if number + 1 == CELLS && t < f64::MAX {
                return;
            }
            let at_end = self.cell.at(end).by_time;
            self.period_demand.axes = larger_of(self.period_demand.axes, shares_of(&at_end, &self.per_max));
            if number + 1 == CELLS {
                return;
            }
            self.enter_cell(number + 1);
        }
    }

    /// Record that ends in the current phase.
    #[inline]
    fn sample(&mut self) -> Record<A> {
        let PhaseSampler { jerk, .. } = self.phase;
        let state = self.phase.at(self.time);
        let (position_mm, tag) = self.place(state.s);
        let before = (self.point.velocity_mm_s, self.point.acceleration_mm_s2);
        let jerk_mm_s3 = if self.phase.growth != 0.0 { self.phase.growth * state.v } else { jerk };
        self.point = SetPoint { position_mm, velocity_mm_s: state.v, acceleration_mm_s2: state.a, jerk_mm_s3 };
        let shares = self.shares(before, true, jerk);
        let rapid = self.pieces.front().is_some_and(PathPiece::is_rapid);
        self.period_demand.kind = self.period_demand.kind.with(RecordKind::of(rapid));
        self.record(shares, Flags::NONE, tag)
    }

    /// Advances to place `s` after the start of the front span and returns the position and the program line there.
    #[inline]
    fn place(&mut self, s: f64) -> ([f64; A], u32) {
        while let Some(piece) = self.pieces.front()
            && s > self.piece_start + piece.length
            && self.first_piece < self.phase.last
        {
            self.next_piece();
        }
        let Some(piece) = self.pieces.front_mut() else {
            return (self.point.position_mm, 0); // a span has pieces; not reached
        };
        self.feed = piece.feed;
        let s = (s - self.piece_start).clamp(0.0, piece.length);
        while piece.marks > 0
            && let Some(&mark) = self.marks.front()
            && mark.place < s
        {
            self.marks.pop_front();
            (piece.tag, piece.marks) = (mark.tag, piece.marks - 1);
        }
        (piece.curve.at(s), piece.tag)
    }

    /// Record that ends in the current cell.
    #[inline]
    fn glide(&mut self) -> Record<A> {
        let GlideSample { position, by_time } = self.cell.at(self.time);
        let Derivatives { first, second, third } = &by_time;
        let speed = size(first);
        let along = first.iter().zip(second).map(|(v, a)| v * a).sum::<f64>() / larger(speed, 1e-9);
        let before = (self.point.velocity_mm_s, self.point.acceleration_mm_s2);
        self.point = SetPoint {
            position_mm: position,
            velocity_mm_s: speed,
            acceleration_mm_s2: along,
            jerk_mm_s3: size(third),
        };
        let own = shares_of(&by_time, &self.per_max);
        let shares = larger_of(self.shares(before, false, 0.0), own);
        let rapid = self.glides.front().is_some_and(GlideSegment::is_rapid);
        self.period_demand.kind = self.period_demand.kind.with(RecordKind::of(rapid));
        let record = self.record(shares, Flags::NONE, self.cell.tag);
        // The next record begins in this state.
        self.period_demand.axes = own;
        record
    }

    /// Last record of a stop.
    fn arrive(&mut self, end: [f64; A], flags: Flags, tag: u32) -> Record<A> {
        let before = (self.point.velocity_mm_s, self.point.acceleration_mm_s2);
        self.point = SetPoint { position_mm: end, velocity_mm_s: 0.0, acceleration_mm_s2: 0.0, jerk_mm_s3: 0.0 };
        let shares = self.shares(before, false, 0.0);
        self.record(shares, flags, tag)
    }

    /// Demand of the record that begins at this speed and acceleration and ends at the current point. It is on the
    /// front piece where it is on its `path`.
    #[inline]
    fn shares(&self, (v, a): (f64, f64), path: bool, jerk: f64) -> Shares {
        let v = larger(v, self.point.velocity_mm_s);
        let a = larger(a.abs(), self.point.acceleration_mm_s2.abs());
        let j = larger(self.period_demand.jerk, jerk.abs());
        let met = self
            .period_demand
            .demand
            .as_ref()
            .map_or(self.period_demand.axes, |met| larger_of(met.shares(v, a, j), self.period_demand.axes));
        if path { larger_of(self.demand.shares(v, a, j), met) } else { met }
    }

    /// Record from the last counts to those of the current point.
    #[inline]
    fn record(&mut self, shares: Shares, flags: Flags, line: u32) -> Record<A> {
        let wanted = counts_of(&self.point.position_mm, &self.limits.pulses_per_mm);
        let mut increments = [0i16; A];
        for i in 0..A {
            let (pulses, increment) = increment_of(wanted[i] - self.counts[i]);
            self.counts[i] += pulses;
            increments[i] = increment;
        }
        self.cap = if self.period_demand.rough { RapidCap::PLANNED } else { cap(shares, self.cap) };
        let flags = if self.period_demand.kind == RecordKind::Rapid { flags.with(Flags::RAPID) } else { flags };
        self.period_demand = PeriodDemand::NOTHING;
        let feed_share = if self.limits.feed_shares { self.feed_share() } else { FeedShare::NONE };
        Record { increments, line, flags, cap: self.cap, feed_share }
    }

    /// Distance from the last record to the current point, as a share of that at the programmed feed; not zero in feed
    /// motion.
    fn feed_share(&mut self) -> FeedShare {
        let from = std::mem::replace(&mut self.recorded, self.point.position_mm);
        let to = &self.point.position_mm;
        let distance = size(&std::array::from_fn::<f64, A, _>(|axis| to[axis] - from[axis]));
        if self.feed == RAPID || distance == 0.0 {
            return FeedShare::NONE;
        }
        let units = distance / (self.feed * self.limits.period_s) * f64::from(FeedShare::FEED.units());
        FeedShare::from_units(units.round().clamp(1.0, f64::from(u16::MAX)) as u16)
    }
}
