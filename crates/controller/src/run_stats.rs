//! Where the control periods went, and what there is to count.
//!
//! Invariant: every period is counted in exactly one of the times.

use retrace_core::mode::Mode;
use retrace_core::{Place, Travel};

/// Control periods by what they were spent on, and counts.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RunStats {
    /// All of them.
    pub periods: u64,
    /// Program motion, forward, first passage.
    pub motion: u64,
    /// Dwells.
    pub dwell: u64,
    /// Switching.
    pub switching: u64,
    /// Feed hold, program stop, waiting for the operator.
    pub held: u64,
    /// Paused at a breakpoint (DNC), moves by hand and the way back to it included.
    pub paused: u64,
    /// Reverse, forward and handwheel, and the way back.
    pub retracing: u64,
    /// Standing in normal run, for want of records.
    pub waiting: u64,
    /// How often the look-ahead ran dry.
    pub underruns: u64,
    /// How often the direction of motion along the path changed.
    pub reversals: u64,
    /// Exclusive instructions and synchronous actions executed.
    pub switch_events: u64,
    /// Fewest records that the card held ahead of the cursor, at rate 1 and with more to come; none where that never was.
    pub min_buffered_records: Option<u32>,
    /// Things that were not told for want of room in the stream.
    pub dropped_events: u64,
    furthest: Place,
    direction: Travel,
}

/// What a period was, as far as the tally asks.
#[derive(Clone, Copy, Debug)]
pub struct PeriodClass {
    /// The mode it was run in.
    pub mode: Mode,
    /// A hold, a program stop or single block was in force.
    pub held: bool,
    /// An exclusive instruction was being executed; true for a dwell.
    pub instruction: Option<bool>,
    /// Distance that the cursor moved.
    pub rate: Travel,
    /// Where it came to.
    pub place: Place,
}

impl RunStats {
    /// A tally of a run that begins at record `start`.
    #[must_use]
    pub fn new(start: u32) -> Self {
        Self { furthest: Place::start_of(start), ..Self::default() }
    }

    /// In a period at full rate so many records lay ahead of the cursor.
    pub fn buffered(&mut self, ahead: u32) {
        self.min_buffered_records = Some(self.min_buffered_records.map_or(ahead, |least| least.min(ahead)));
    }

    /// One period more, at a breakpoint or on the way back to it.
    pub fn pause(&mut self) {
        self.periods += 1;
        self.paused += 1;
    }

    /// One period more.
    pub fn count(&mut self, spent: PeriodClass) {
        self.periods += 1;
        let new_ground = self.furthest.distance_to(spent.place) > 0;
        let bucket = match spent.instruction {
            _ if new_ground => &mut self.motion,
            Some(true) => &mut self.dwell,
            Some(false) => &mut self.switching,
            None if spent.mode != Mode::Run => &mut self.retracing,
            None if spent.held => &mut self.held,
            None => &mut self.waiting,
        };
        *bucket += 1;
        if new_ground {
            self.furthest = spent.place;
        }
        let direction = spent.rate.signum();
        if direction != 0 {
            self.reversals += u64::from(self.direction == -direction);
            self.direction = direction;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use retrace_core::ONE;

    #[test]
    fn every_period_is_counted_once() {
        let mut tally = RunStats::new(5);
        let spent = |mode, held, instruction, rate, record| PeriodClass {
            mode,
            held,
            instruction,
            rate,
            place: Place::start_of(record),
        };
        tally.count(spent(Mode::Run, false, None, ONE, 6));
        tally.count(spent(Mode::Run, true, None, ONE, 7));
        tally.count(spent(Mode::Run, true, None, 0, 7));
        tally.count(spent(Mode::Reverse, false, None, -ONE, 6));
        tally.count(spent(Mode::Rejoin, false, None, ONE, 7));
        tally.count(spent(Mode::Run, false, Some(true), 0, 7));
        tally.count(spent(Mode::Run, false, Some(false), 0, 7));
        tally.count(spent(Mode::Run, false, None, 0, 7));
        assert_eq!(
            (tally.motion, tally.held, tally.retracing, tally.dwell, tally.switching, tally.waiting),
            (2, 1, 2, 1, 1, 1)
        );
        assert_eq!((tally.periods, tally.reversals), (8, 2));
    }
}
