//! The cursor on the road: it never leaves it, whatever rates are wished for (REV, *Braking to a place*).
//!
//! The end of the road is the only stop place: what is not held cannot be run. Hold, the oldest record, `reached`, an
//! exclusive marker and a starved buffer are all the same thing, an end at which the cursor comes to rest exactly. A
//! *planned stop* needs no braking, as the path itself is at rest there: the cursor runs into it at full rate and starts from it
//! at full rate, and it costs no period.
//!
//! Invariant: either the commanded place does not lie beyond the end of the road, or a planned stop lies between the cursor and
//! that end, and the cursor will not pass the last one before the first half of this sentence holds. So the cursor
//! never leaves the road.

use super::RecordWindow;
use super::directed_window::{DirectedWindow, along};
use crate::rate::RateFilter;
use crate::{Place, Travel};

/// Where one control period brought the cursor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CursorStep {
    /// The place after the period.
    pub to: Place,
    /// The end of the road, which was no planned stop, kept the rate below its target.
    pub short: bool,
}

/// The cursor and its commanded place: a rate law on a road.
#[derive(Clone, Debug)]
pub struct Cursor<const M: usize> {
    law: RateFilter<M>,
}

impl<const M: usize> Cursor<M> {
    /// In motion as far as `law` is.
    #[must_use]
    pub const fn with_law(law: RateFilter<M>) -> Self {
        Self { law }
    }

    /// The rate law's state.
    #[must_use]
    pub const fn law(&self) -> &RateFilter<M> {
        &self.law
    }

    /// One period at rest.
    pub fn stand(&mut self, at: Place) -> CursorStep {
        CursorStep { to: at.moved(self.law.step(0)), short: false }
    }

    /// From a planned stop, at rest, the rate may jump: to `asked` where another one lies ahead, else to `braked`, from which the road is
    /// long enough to brake again, and at most as far as it is long enough to stop at all. The rate comes back.
    pub fn launch<const A: usize>(
        &mut self,
        braked: Travel,
        asked: Travel,
        way: &DirectedWindow<'_, A, impl RecordWindow<A>>,
    ) -> Travel {
        let periods = Travel::from(self.law.smoothing().stopping_records()) + 1;
        let rate = if braked < asked && way.last_rest().is_some() { asked } else { braked };
        let rate = if rate * periods <= way.room() || way.last_rest().is_some() { rate } else { way.room() / periods };
        self.law.set_steady(along(way.sign, rate));
        rate
    }

    /// One period in which the commanded place goes on by `wished`, 0 … 8 records, or where nothing but the end of the road lies ahead by
    /// `braked`, and no further than to the end.
    pub fn advance<const A: usize>(
        &mut self,
        wished: Travel,
        braked: Travel,
        way: &DirectedWindow<'_, A, impl RecordWindow<A>>,
    ) -> CursorStep {
        let free = way.room() - self.law.lead().abs();
        let within = wished.min(braked).min(free.max(0));
        let last_rest = if within < wished || free < 0 { way.last_rest() } else { None };
        let allowed = if last_rest.is_some() { wished } else { within };
        let to = way.at.moved(self.law.step(along(way.sign, allowed)));
        if let Some(rest) = last_rest
            && along(way.sign, to.to(rest)) <= 0
        {
            self.law.set_steady(0);
            return CursorStep { to: rest, short: false };
        }
        CursorStep { to, short: allowed < wished }
    }
}
