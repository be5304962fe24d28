//! Emission: the committed plan, sampled once a control period, becomes records of whole increments (REV-1).
//!
//! Invariant: after every record the sum of all increments is the position times pulses per mm, rounded half away from zero:
//! it is never further than half a pulse from the plan and nothing accumulates. A stop takes whole periods: its last
//! record ends exactly at the commanded position, at rest. Nothing is allocated here.

mod unplayed;

use std::collections::VecDeque;

use retrace_core::{Flags, RapidCap, Record};

use crate::blend::size;
use crate::curve::Derivatives;
use crate::glide::passage::Passage;
use crate::limits::Limits;
use crate::merge::Mark;
use crate::piece::Piece;
use crate::profile::{Profile, SIGNS, State};

/// A part of the committed plan.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Item<const A: usize> {
    /// A profile over `length` mm from where the item before it ends; it ends in piece number `last`.
    Span { profile: Profile, duration: f64, length: f64, last: u64 },
    /// The glide in front of the queue of glides; pieces before number `piece` are done.
    Glide { piece: u64 },
    /// Rest at `end`; pieces before number `piece` are done.
    Stop { piece: u64, end: [f64; A], flags: Flags, tag: u32 },
}

/// An un-rounded set-point: where the plan is at the end of a record.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SetPoint<const A: usize> {
    /// Position of each axis, mm.
    pub position_mm: [f64; A],
    /// Speed along the path, mm/s.
    pub velocity_mm_s: f64,
    /// Acceleration along the path, mm/s².
    pub acceleration_mm_s2: f64,
    /// Jerk along the path, mm/s³.
    pub jerk_mm_s3: f64,
}

/// Pieces and plan that wait to be emitted.
#[derive(Debug)]
pub(crate) struct Emitter<const A: usize> {
    limits: Limits<A>,
    items: VecDeque<Item<A>>,
    glides: VecDeque<Passage<A>>,
    pieces: VecDeque<Piece<A>>,
    /// Program lines of the pieces beside the one at the start of each.
    marks: VecDeque<Mark>,
    /// Number of the piece in front.
    first_piece: u64,
    /// Where the front piece starts, in mm from the start of the front span.
    piece_start: f64,
    /// Time of the last sample after the start of the front item, s; not above 0 where the item is yet to be entered.
    time: f64,
    phase: usize,
    phase_start: State,
    phase_time: f64,
    counts: [i64; A],
    /// One by what the plan may ask of each axis: velocity, acceleration, jerk.
    per_most: Derivatives<A>,
    point: SetPoint<A>,
    /// What the record in the making has met: bounds of its pieces, largest jerk, rough joints.
    met: Met<A>,
}

#[derive(Clone, Copy, Debug)]
struct Met<const A: usize> {
    /// What the axes themselves did in a glide.
    axes: Derivatives<A>,
    bounds: Derivatives<A>,
    jerk: f64,
    rough: bool,
}

impl<const A: usize> Met<A> {
    const NOTHING: Self = Self { axes: Derivatives::NONE, bounds: Derivatives::NONE, jerk: 0.0, rough: false };

    fn piece(&mut self, bounds: &Derivatives<A>) {
        self.bounds.raise(bounds);
    }

    fn moment(&mut self, by_time: &Derivatives<A>) {
        self.axes.raise(by_time);
    }
}

/// A limit that holds what an axis does more often than this, 8³ and some, bounds no cap.
const PLENTY: f64 = 520.0;
/// Samples that come this much of a period before the end of an item are taken at its end.
const LATE: f64 = 1e-6;

impl<const A: usize> Emitter<A> {
    pub(crate) fn new(limits: Limits<A>, start: [f64; A]) -> Self {
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
            time: 0.0,
            phase: 0,
            phase_start: State::default(),
            phase_time: 0.0,
            counts: counts_of(&start, &limits.pulses_per_mm),
            per_most: Derivatives {
                first: planned.v.map(f64::recip),
                second: planned.a.map(f64::recip),
                third: planned.j.map(f64::recip),
            },
            point: rest,
            met: Met::NOTHING,
        }
    }

    /// Appends a piece of path; gives its number.
    pub(crate) fn append(&mut self, piece: Piece<A>) -> u64 {
        self.pieces.push_back(piece);
        self.first_piece + self.pieces.len() as u64 - 1
    }

    /// Appends the marks of pieces that are yet to be appended.
    pub(crate) fn mark(&mut self, marks: &[Mark]) {
        self.marks.extend(marks);
    }

    /// Commits a part of the plan.
    pub(crate) fn commit(&mut self, item: Item<A>) {
        self.items.push_back(item);
        if self.items.len() == 1 {
            self.enter();
        }
    }

    /// Commits a glide; pieces before number `piece` are done when it begins.
    pub(crate) fn commit_glide(&mut self, glide: Passage<A>, piece: u64) {
        self.glides.push_back(glide);
        self.commit(Item::Glide { piece });
    }

    /// The last set-point.
    pub(crate) fn point(&self) -> &SetPoint<A> {
        &self.point
    }

    /// One control period; `None` where the committed plan ends before it.
    pub(crate) fn next_record(&mut self) -> Option<Record<A>> {
        let period = self.limits.period_s;
        loop {
            match *self.items.front()? {
                Item::Stop { end, flags, tag, .. } => {
                    let record = self.arrive(end, flags, tag);
                    self.time = 0.0;
                    self.next_item();
                    return Some(record);
                }
                Item::Span { duration, length, .. } if self.time + period > duration - LATE * period => {
                    self.pass_phases(f64::MAX);
                    self.time -= duration;
                    self.piece_start -= length;
                    self.next_item();
                }
                Item::Glide { .. } => {
                    if let Some(record) = self.glide(period) {
                        return Some(record);
                    }
                }
                Item::Span { profile, last, .. } => {
                    self.time += period;
                    return Some(self.sample(&profile, last));
                }
            }
        }
    }

    fn next_item(&mut self) {
        self.items.pop_front();
        self.enter();
    }

    /// Goes to the start of the item in front.
    fn enter(&mut self) {
        match self.items.front() {
            Some(Item::Span { profile, .. }) => {
                (self.phase, self.phase_start, self.phase_time) = (0, profile.start(), 0.0);
            }
            Some(&(Item::Stop { piece, .. } | Item::Glide { piece })) => {
                while self.first_piece < piece {
                    self.next_piece();
                }
                (self.piece_start, self.phase) = (0.0, 0);
            }
            None => {}
        }
    }

    fn next_piece(&mut self) {
        if let Some(done) = self.pieces.pop_front() {
            self.met.piece(&done.bounds);
            self.piece_start += done.length;
            self.marks.drain(..done.marks as usize);
        }
        self.first_piece += 1;
        self.met.rough |= self.pieces.front().is_some_and(|piece| piece.rough_entry);
    }

    /// Goes to the phase of the front span that holds time `t` after its start, and notes every jerk on the way.
    fn pass_phases(&mut self, t: f64) {
        let Some(Item::Span { profile, .. }) = self.items.front() else { return };
        loop {
            let (jerk, duration) = (SIGNS[self.phase] * profile.jerk, profile.times[self.phase]);
            if duration > 0.0 {
                self.met.jerk = self.met.jerk.max(jerk.abs());
            }
            if self.phase == 6 || t <= self.phase_time + duration {
                return;
            }
            self.phase_start = self.phase_start.after(jerk, duration);
            self.phase_time += duration;
            self.phase += 1;
        }
    }

    fn sample(&mut self, profile: &Profile, last: u64) -> Record<A> {
        self.pass_phases(self.time);
        let jerk = SIGNS[self.phase] * profile.jerk;
        let state = self.phase_start.after(jerk, self.time - self.phase_time);
        while let Some(piece) = self.pieces.front() {
            if state.s <= self.piece_start + piece.length || self.first_piece >= last {
                break;
            }
            self.next_piece();
        }
        let Some(piece) = self.pieces.front_mut() else {
            return self.arrive(self.point.position_mm, Flags::NONE, 0); // a span has pieces; not reached
        };
        let s = (state.s - self.piece_start).clamp(0.0, piece.length);
        while piece.marks > 0
            && let Some(&mark) = self.marks.front()
            && mark.place < s
        {
            self.marks.pop_front();
            (piece.tag, piece.marks) = (mark.tag, piece.marks - 1);
        }
        let (position_mm, tag) = (piece.curve.at(s), piece.tag);
        self.met.piece(&piece.bounds);
        let before = self.point;
        self.point = SetPoint { position_mm, velocity_mm_s: state.v, acceleration_mm_s2: state.a, jerk_mm_s3: jerk };
        self.record(&before, Flags::NONE, tag)
    }

    /// One period of the glide in front; `None` where it ends before, and the next item is in front.
    fn glide(&mut self, period: f64) -> Option<Record<A>> {
        let glide = self.glides.front()?;
        let (duration, before) = (glide.duration(), self.phase);
        let ends = self.time + period > duration - LATE * period;
        let time = if ends { duration } else { self.time + period };
        let cell = glide.cell(time);
        for k in before..=cell {
            self.met.moment(&glide.at(k, (k as f64 * glide.ramps.cell).max(self.time)).by_time);
            self.met.moment(&glide.at(k, ((k + 1) as f64 * glide.ramps.cell).min(time)).by_time);
        }
        let (moment, tag) = (glide.at(cell, time), glide.tag(time));
        if ends {
            self.glides.pop_front();
            self.time -= duration;
            self.next_item();
            return None;
        }
        (self.time, self.phase) = (time, cell);
        let before = self.point;
        let Derivatives { first, second, third } = moment.by_time;
        let speed = size(&first);
        let along = first.iter().zip(second).map(|(v, a)| v * a).sum::<f64>() / speed.max(1e-9);
        self.point = SetPoint {
            position_mm: moment.position,
            velocity_mm_s: speed,
            acceleration_mm_s2: along,
            jerk_mm_s3: size(&third),
        };
        Some(self.record(&before, Flags::NONE, tag))
    }

    /// The last record of a stop.
    fn arrive(&mut self, end: [f64; A], flags: Flags, tag: u32) -> Record<A> {
        let before = self.point;
        self.point = SetPoint { position_mm: end, velocity_mm_s: 0.0, acceleration_mm_s2: 0.0, jerk_mm_s3: 0.0 };
        self.record(&before, flags, tag)
    }

    /// The record from the last counts to those of the present point.
    fn record(&mut self, before: &SetPoint<A>, flags: Flags, line: u32) -> Record<A> {
        let wanted = counts_of(&self.point.position_mm, &self.limits.pulses_per_mm);
        let mut increments = [0i16; A];
        for i in 0..A {
            let increment = (wanted[i] - self.counts[i]).clamp(i64::from(i16::MIN), i64::from(i16::MAX));
            self.counts[i] += increment;
            increments[i] = increment as i16;
        }
        let cap = self.cap(before);
        self.met = Met::NOTHING;
        Record { increments, line, flags, cap, spare: 0 }
    }

    /// How much faster than planned the record may be retraced: r·|v|, r²·|a| and r³·|j| stay within every axis' limits.
    fn cap(&self, before: &SetPoint<A>) -> RapidCap {
        if self.met.rough {
            return RapidCap::PLANNED;
        }
        let larger = |of: fn(&SetPoint<A>) -> f64| of(before).abs().max(of(&self.point).abs());
        let (v, a, j) = (larger(|p| p.velocity_mm_s), larger(|p| p.acceleration_mm_s2), self.met.jerk);
        let bounds = &self.met.bounds;
        let Derivatives { first: per_v, second: per_a, third: per_j } = &self.per_most;
        // What share of its limits an axis uses: velocity, acceleration and jerk.
        let mut used = [0.0f64; 3];
        for i in 0..A {
            let (one, two, three) = (bounds.first[i], bounds.second[i], bounds.third[i]);
            let (own_v, own_a, own_j) = (self.met.axes.first[i], self.met.axes.second[i], self.met.axes.third[i]);
            let axis_v = (one * v).max(own_v);
            let axis_a = (one * a + two * v * v).max(own_a);
            let axis_j = (one * j + 3.0 * two * v * a + three * v * v * v).max(own_j);
            used = [used[0].max(axis_v * per_v[i]), used[1].max(axis_a * per_a[i]), used[2].max(axis_j * per_j[i])];
        }
        let spare = used.map(|share| if share * PLENTY > 1.0 { share.recip() } else { PLENTY });
        let least = RapidCap::PLANNED.get() + 1;
        let rate = f64::from(least) / f64::from(RapidCap::PLANNED.get());
        if spare[0] < rate || spare[1] < rate * rate || spare[2] < rate * rate * rate {
            return RapidCap::PLANNED;
        }
        // A little less, for the rounding of the roots.
        let rate = spare[0].min(spare[1].sqrt());
        let rate = (1.0 - 1e-9) * if rate * rate * rate > spare[2] { spare[2].cbrt() } else { rate };
        RapidCap::sixteenths((rate * 16.0).min(128.0) as u8)
    }
}

/// Positions in whole pulses, rounded half away from zero.
pub(crate) fn counts_of<const A: usize>(position_mm: &[f64; A], pulses_per_mm: &[f64; A]) -> [i64; A] {
    std::array::from_fn(|i| {
        let pulses = position_mm[i] * pulses_per_mm[i];
        let whole = pulses as i64;
        // Exact, as the rest of a truncation is; and quicker than a call of `round`.
        let rest = pulses - whole as f64;
        whole + i64::from(rest >= 0.5) - i64::from(rest <= -0.5)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn counts_are_rounded_half_away_from_zero(x in -1e7..1e7f64, halves in -100_000i64..100_000) {
            prop_assert_eq!(counts_of(&[x], &[1000.0])[0], (x * 1000.0).round() as i64);
            let half = halves as f64 + 0.5;
            for x in [half, half.next_up(), half.next_down()] {
                prop_assert_eq!(counts_of(&[x], &[1.0])[0], x.round() as i64);
            }
        }
    }
}
