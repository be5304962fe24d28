//! Statistics of a run: the control periods by their use, and counters.
//!
//! Invariant: every period is counted in exactly one of the times.

use retrace_core::mode::Mode;
use retrace_core::{Distance, Place, Rate, RecordIndex};

/// Control periods by their use, and counters.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RunStats {
    /// All periods.
    pub periods: u64,
    /// Program motion: forward, executed for the first time.
    pub motion: u64,
    /// Dwells.
    pub dwell: u64,
    /// Switching.
    pub switching: u64,
    /// Feed hold, program stop, waiting for the operator.
    pub held: u64,
    /// Paused at a breakpoint (DNC), including manual moves and the return.
    pub paused: u64,
    /// Reverse run, forward run and handwheel, and rejoining the program.
    pub retracing: u64,
    /// At rest in normal run, waiting for records.
    pub waiting: u64,
    /// Number of times the look-ahead ran dry.
    pub underruns: u64,
    /// Number of times the direction of motion along the path changed.
    pub reversals: u64,
    /// Number of cuts that were interrupted.
    pub cut_interruptions: u64,
    /// Number of times the input of a cutter that cut became inactive and active again, without a loss.
    pub cutter_flickers: u64,
    /// Control periods in which a torch, jet or beam was on.
    pub lit: u64,
    /// Number of contours that were begun.
    pub contours: u32,
    /// Number of those of which something is not cut.
    pub contours_not_cut: u32,
    /// Length of the contours that is not cut, µm.
    pub not_cut_um: u64,
    /// Length that was cut while the loss of the cutter was not watched, nm.
    pub not_watched_nm: u64,
    /// Exclusive instructions and synchronous actions executed.
    pub switch_events: u64,
    /// Fewest records that the card held ahead of the cursor, at rate 1 and with more to come. None where that never
    /// happened.
    pub min_buffered_records: Option<u32>,
    /// Telemetry messages that were dropped because the queue was full.
    pub dropped_events: u64,
    furthest: Place,
    direction: i64,
    /// Number of periods that the dwell that is being executed still takes.
    dwell_left: u64,
}

/// Properties of a period that determine how it is counted.
#[derive(Clone, Copy, Debug)]
pub struct PeriodClass {
    /// Mode of the period.
    pub mode: Mode,
    /// Whether a hold, a program stop or single block was in force.
    pub held: bool,
    /// Whether an exclusive instruction was being executed; `Some(true)` for a dwell.
    pub instruction: Option<bool>,
    /// Distance that the cursor moved.
    pub rate: Rate,
    /// Place at the end of the period.
    pub place: Place,
}

impl RunStats {
    /// Creates the statistics of a run that begins at record `start`.
    #[must_use]
    pub fn new(start: RecordIndex) -> Self {
        Self { furthest: Place::start_of(start), ..Self::default() }
    }

    /// Records how many records were ahead of the cursor in a period at full rate.
    pub fn record_buffered(&mut self, ahead: u32) {
        self.min_buffered_records = Some(self.min_buffered_records.map_or(ahead, |least| least.min(ahead)));
    }

    /// Counts a period at a breakpoint or on the return to it.
    pub fn count_paused(&mut self) {
        self.periods += 1;
        self.paused += 1;
    }

    /// Begins a dwell of so many periods. What its order and its end take over the line beside them is waiting.
    pub fn begin_dwell(&mut self, periods: u32) {
        self.dwell_left = u64::from(periods);
    }

    /// Counts a period.
    pub fn count_period(&mut self, spent: PeriodClass) {
        self.periods += 1;
        let new_ground = self.furthest.distance_to(spent.place) > Distance::ZERO;
        let bucket = match spent.instruction {
            _ if new_ground => &mut self.motion,
            Some(true) if self.dwell_left > 0 => {
                self.dwell_left -= 1;
                &mut self.dwell
            }
            Some(true) => &mut self.waiting,
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
    use retrace_core::Rate;

    #[test]
    fn every_period_is_counted_once() {
        let mut stats = RunStats::new(RecordIndex::new(5));
        let spent = |mode, held, instruction, rate, record| PeriodClass {
            mode,
            held,
            instruction,
            rate,
            place: Place::start_of(record),
        };
        stats.count_period(spent(Mode::Run, false, None, Rate::ONE, RecordIndex::new(6)));
        stats.count_period(spent(Mode::Run, true, None, Rate::ONE, RecordIndex::new(7)));
        stats.count_period(spent(Mode::Run, true, None, Rate::ZERO, RecordIndex::new(7)));
        stats.count_period(spent(Mode::Reverse, false, None, -Rate::ONE, RecordIndex::new(6)));
        stats.count_period(spent(Mode::Rejoin, false, None, Rate::ONE, RecordIndex::new(7)));
        stats.begin_dwell(1);
        stats.count_period(spent(Mode::Run, false, Some(true), Rate::ZERO, RecordIndex::new(7)));
        stats.count_period(spent(Mode::Run, false, Some(true), Rate::ZERO, RecordIndex::new(7)));
        stats.count_period(spent(Mode::Run, false, Some(false), Rate::ZERO, RecordIndex::new(7)));
        stats.count_period(spent(Mode::Run, false, None, Rate::ZERO, RecordIndex::new(7)));
        assert_eq!(
            (stats.motion, stats.held, stats.retracing, stats.dwell, stats.switching, stats.waiting),
            (2, 1, 2, 1, 1, 2)
        );
        assert_eq!((stats.periods, stats.reversals), (9, 2));
    }
}
