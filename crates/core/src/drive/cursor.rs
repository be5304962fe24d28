//! The cursor in the window of records: it never leaves the window, whatever rates are requested (REV, *Braking to a
//! place*).
//!
//! The end of the window is the only stop place: records that are not held cannot be played. Hold, the oldest record,
//! `reached`, an exclusive marker and a starved buffer are all the same: an end at which the cursor comes to rest
//! exactly. A *planned stop* needs no braking, as the path itself is at rest there: the cursor arrives at full rate and
//! starts from it at full rate, and it costs no period.
//!
//! Invariant: either the commanded place is not beyond the end of the window, or a planned stop is between the cursor
//! and that end, and the cursor will not pass the last one before the first half of this sentence holds. So the cursor
//! never leaves the window.

use super::RecordWindow;
use super::directed_window::{DirectedWindow, signed};
use crate::rate::RateFilter;
use crate::{Distance, Place, Rate};

/// Result of one control period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CursorStep {
    /// Place after the period.
    pub to: Place,
    /// Whether the end of the window, which was not a planned stop, limited the rate to below its target.
    pub starved: bool,
}

/// The cursor and its commanded place: a rate filter applied to a window of records.
#[derive(Clone, Debug)]
pub struct Cursor<const M: usize> {
    filter: RateFilter<M>,
}

impl<const M: usize> Cursor<M> {
    /// Creates a cursor with the motion that is in `filter`.
    #[must_use]
    pub const fn with_filter(filter: RateFilter<M>) -> Self {
        Self { filter }
    }

    /// Returns the rate filter.
    #[must_use]
    pub const fn filter(&self) -> &RateFilter<M> {
        &self.filter
    }

    /// Advances by one period with a target of zero.
    pub fn dwell(&mut self, at: Place) -> CursorStep {
        CursorStep { to: at.moved(self.filter.step(Rate::ZERO)), starved: false }
    }

    /// Lets the rate jump from rest at a planned stop and returns the new rate.
    ///
    /// The rate is `requested` if another planned stop is ahead, else `braking_limited`, from which the window is long
    /// enough to brake again. It is at most as high as the window is long enough to stop at all.
    pub fn start_from_rest<const A: usize>(
        &mut self,
        braking_limited: Rate,
        requested: Rate,
        ahead: &DirectedWindow<'_, A, impl RecordWindow<A>>,
    ) -> Rate {
        let periods = i64::from(self.filter.lengths().stopping_records()) + 1;
        let rate = if braking_limited < requested && ahead.last_planned_stop().is_some() {
            requested
        } else {
            braking_limited
        };
        let rate = if rate.over(periods) <= ahead.distance_to_end() || ahead.last_planned_stop().is_some() {
            rate
        } else {
            (ahead.distance_to_end() / periods).per_period()
        };
        self.filter.set_steady(signed(ahead.sign, rate));
        rate
    }

    /// Advances the commanded place at `requested`, 0 … [`Rate::MAX`], for one period. If only the end of the window is
    /// ahead, it advances at `braking_limited` or less and not beyond the end.
    pub fn advance<const A: usize>(
        &mut self,
        requested: Rate,
        braking_limited: Rate,
        ahead: &DirectedWindow<'_, A, impl RecordWindow<A>>,
    ) -> CursorStep {
        let free = ahead.distance_to_end() - self.filter.lead().abs();
        let within = requested.min(braking_limited).min(free.max(Distance::ZERO).per_period());
        let last_rest = if within < requested || free < Distance::ZERO { ahead.last_planned_stop() } else { None };
        let allowed = if last_rest.is_some() { requested } else { within };
        let to = ahead.at.moved(self.filter.step(signed(ahead.sign, allowed)));
        if let Some(rest) = last_rest
            && signed(ahead.sign, to.distance_to(rest)) <= Distance::ZERO
        {
            self.filter.set_steady(Rate::ZERO);
            return CursorStep { to: rest, starved: false };
        }
        CursorStep { to, starved: allowed < requested }
    }
}
