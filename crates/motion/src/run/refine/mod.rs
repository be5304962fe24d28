//! Refinement of the plan of a run before it is committed.
//!
//! The plan is cut at knots, 1 to 2.5 ms apart. Windows of the plan that overlap are replaced, one after the other, by
//! faster speed laws between the same two states. Each begins in the state that the one before has at the start of the
//! overlap. Near rest the plan remains: there the square of the speed is no quadratic. It also remains where the speed
//! is the highest allowed for a while.
//!
//! Invariant: blocks, piece numbers and places stay those of the path; only the speed between the knots changes. How
//! far the plan is refined depends on the path alone, and no window is slower than what it replaces.

mod adopt;
mod knots;

use super::{PlanMode, PlanRun};
use crate::emitter::Emitter;
use crate::profile::Profile;
use crate::speed_law::SpeedLawRefiner;
use crate::speed_law::law_path::LawPath;
use knots::Knot;

/// Length of a window, and how much of it the next window covers again, s of the plan.
const WINDOW: f64 = 0.6;
const OVERLAP: f64 = 0.2;
/// Shortest segment, mm, but between two knots that have to be there: over a shorter one the acceleration loses digits.
const SHORTEST: f64 = 1e-4;
/// Speed below which the plan remains, mm/s.
const SLOWEST: f64 = 2.0;
/// Fewest segments of a window.
const FEWEST: usize = 6;
/// How often a window for which no law is found is halved.
const HALVINGS: u8 = 3;
/// Shortest time at the highest speed allowed during which the plan remains, s.
const CRUISE: f64 = 0.02;

/// Refiner of runs; it retains its memory.
#[derive(Debug)]
pub(super) struct RunRefiner<const A: usize> {
    laws: SpeedLawRefiner,
    knots: Vec<Knot>,
    path: LawPath<A>,
    /// Speed and acceleration at each knot, and the duration of each segment.
    states: Vec<(f64, f64)>,
    durations: Vec<f64>,
    /// Share of the limits that each segment may use; 0 where that is not known yet.
    used: Vec<f64>,
    /// Laws of the segments that are refined.
    law: Vec<Option<Profile>>,
}

impl<const A: usize> Default for RunRefiner<A> {
    fn default() -> Self {
        Self {
            laws: SpeedLawRefiner::default(),
            knots: Vec::new(),
            path: LawPath::default(),
            states: Vec::new(),
            durations: Vec::new(),
            used: Vec::new(),
            law: Vec::new(),
        }
    }
}

impl<const A: usize> PlanRun<A> {
    /// Refines what is committed next, and as much beyond it as is settled.
    pub(super) fn refine_part(&mut self, emitter: &Emitter<A>) {
        if self.mode == PlanMode::Fast {
            return;
        }
        let s = self.joints();
        let target = if self.length > 2.0 * self.keep { self.length - self.keep } else { s[self.blocks.len() / 2] };
        // From there on the plan may be replaced.
        let settled = self.plan.get(self.settled()).map_or(0.0, |span| s[span.first]);
        self.refine(settled.min(self.place_after(&s, target, WINDOW)), target, emitter);
    }

    /// Place at which the plan is `seconds` later than at place `from`, or the end of the plan; `s` holds the places of
    /// the junctions.
    fn place_after(&self, s: &[f64], from: f64, seconds: f64) -> f64 {
        let mut left = seconds;
        for span in &self.plan[self.plan.partition_point(|span| s[span.last] <= from)..] {
            let (begin, duration) = (s[span.first], span.profile.duration());
            let since = if begin < from { span.profile.time_at(from - begin) } else { 0.0 };
            if since + left < duration {
                return begin + span.profile.at(since + left).s;
            }
            left -= duration - since;
        }
        f64::MAX
    }

    /// Refines the whole plan.
    pub(super) fn refine_all(&mut self, emitter: &Emitter<A>) {
        self.refine(f64::MAX, f64::MAX, emitter);
    }

    /// Refines the plan up to place `until`, mm from the start of the run, in windows that begin before `target`.
    fn refine(&mut self, until: f64, target: f64, emitter: &Emitter<A>) {
        if self.mode == PlanMode::Fast || self.plan.is_empty() {
            return;
        }
        let mut refiner = std::mem::take(&mut self.refiner);
        let s = self.joints();
        let first = self.refined;
        if self.lay_knots(&mut refiner.knots, (first, until), &s, emitter)
            && refiner.knots.len() > FEWEST
            && self.lay_path(&refiner.knots, &mut refiner.path, emitter)
        {
            let border = refiner.refine_windows(target);
            let place = refiner.knots[border].s;
            if refiner.law.iter().any(Option::is_some) {
                self.adopt_laws(&mut refiner, first, &s, emitter);
            }
            self.refined = self.blocks_up_to(place);
        }
        self.refiner = refiner;
    }

    /// Number of blocks that end at `place` or before.
    fn blocks_up_to(&self, place: f64) -> usize {
        self.joints()[1..].partition_point(|end| *end <= place + knots::SLIVER)
    }
}

impl<const A: usize> RunRefiner<A> {
    /// Refines all windows that begin before `target`. Returns the knot up to which nothing changes any more.
    fn refine_windows(&mut self, target: f64) -> usize {
        let knots = &self.knots;
        let n = knots.len() - 1;
        self.states.clear();
        self.states.extend(knots.iter().map(|knot| (knot.v, knot.a)));
        self.durations.clear();
        self.durations.extend(knots.windows(2).map(|pair| pair[1].clock - pair[0].clock));
        self.used.clear();
        self.used.resize(n, 0.0);
        self.law.clear();
        self.law.resize(n, None);
        let mut first = 0;
        while first < n {
            let begin = self.knots[first];
            if begin.v < SLOWEST {
                first += 1;
                continue;
            }
            if let Some(end) = self.cruise_from(first) {
                first = end;
                continue;
            }
            let (last, is_whole) = self.window_from(first);
            if begin.s > target {
                break;
            }
            self.refine_window(first, last, 0);
            let kept = begin.clock + WINDOW - OVERLAP;
            let next = first + self.knots[first..last].partition_point(|knot| knot.clock < kept);
            // A window that ends where the plan ends for now goes on when there is more of it.
            let goes_on = is_whole || last == n && target < f64::MAX;
            first = if goes_on { next } else { last }.max(first + 1);
        }
        first
    }

    /// Last knot of the window from knot `first` on, and whether it has its whole length.
    fn window_from(&self, first: usize) -> (usize, bool) {
        let n = self.knots.len() - 1;
        let end = self.knots[first].clock + WINDOW;
        let mut last = first;
        while last < n && self.knots[last + 1].v >= SLOWEST {
            last += 1;
            if self.knots[last].clock >= end {
                return (last, last < n);
            }
            if self.cruise_from(last).is_some() {
                break;
            }
        }
        (last, false)
    }

    /// Knot at the end of the cruise that begins at knot `first`: where the plan has the highest speed allowed for a
    /// while.
    fn cruise_from(&self, first: usize) -> Option<usize> {
        let at_cap = |k: usize| {
            let (knot, most) = (&self.knots[k], self.path.segments[k].v * (1.0 - 1e-6));
            knot.v >= most && self.knots[k + 1].v >= most && knot.a.abs() < 1e-3
        };
        let n = self.knots.len() - 1;
        let end = (first..n).find(|&k| !at_cap(k)).unwrap_or(n);
        (self.knots[end].clock - self.knots[first].clock >= CRUISE).then_some(end)
    }

    /// Refines the window between two knots; where that fails, each half of it.
    fn refine_window(&mut self, first: usize, last: usize, depth: u8) {
        let is_line = |first: usize, last: usize| self.path.segments[first..last].iter().all(|segment| segment.is_line);
        if last < first + FEWEST || is_line(first, last) {
            return;
        }
        let seconds: f64 = self.durations[first..last].iter().sum();
        let law = self.laws.refine(
            self.path.window(first, last),
            &self.states[first..=last],
            &mut self.used[first..last],
            seconds,
        );
        if let Some(law) = law {
            for (k, profile) in (first..).zip(law) {
                self.law[k] = Some(profile);
                self.durations[k] = profile.duration();
                if k > first {
                    self.states[k] = (profile.v0, profile.a0);
                }
            }
        } else if depth < HALVINGS {
            let middle = first.midpoint(last);
            self.refine_window(first, middle, depth + 1);
            self.refine_window(middle, last, depth + 1);
        }
    }
}
