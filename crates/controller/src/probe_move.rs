//! Probing moves: what both threads plan of one, and the records of what the machine has executed of it (PRB-6).
//!
//! A probing move is executed off the job's path, since nobody knows where it ends. Both threads plan it from the same
//! whole numbers. Behind it, each control period in which the machine moved becomes a record of the path: so the path
//! is what was run, with the stop behind the touch as it was, and is retraced like any other.
//!
//! Invariant: the records are a function of the move and of the runs of its answer alone; their sum is the way from
//! where the move began to where the machine came to rest.

use retrace_config::MachineConfig;
use retrace_core::playback::executed_increments;
use retrace_core::{Distance, Flags, Place, Record, RecordIndex};
use retrace_gcode::Probing;
use retrace_motion::{FeedRate, LimitError, PathMode, Planner};

/// A probing move, in counts of the job's path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProbeMove {
    /// Counts of the axes where it begins; 0 for missing axes.
    pub from: [i64; 9],
    /// Counts where it ends without an answer.
    pub to: [i64; 9],
    /// Feed, nm/s.
    pub feed_nm_per_s: u64,
    /// What ends it.
    pub probing: Probing,
}

impl ProbeMove {
    /// Its code in the program.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self.probing {
            Probing { away: false, must_trip: true } => "G38.2",
            Probing { away: false, must_trip: false } => "G38.3",
            Probing { away: true, must_trip: true } => "G38.4",
            Probing { away: true, must_trip: false } => "G38.5",
        }
    }

    /// Plans the whole move, within the limits that the machine has while it probes.
    ///
    /// # Errors
    /// The machine's limits are not valid.
    pub(crate) fn plan<const A: usize>(&self, machine: &MachineConfig) -> Result<Planner<A>, LimitError> {
        let mm = |counts: &[i64; 9]| machine.clone().standing_at(&counts[..A.min(9)]).start_mm();
        let mut planner = Planner::new(machine.probing_limits(), mm(&self.from))?;
        let feed = FeedRate::PerSecond(self.feed_nm_per_s as f64 * 1e-6);
        // Both ends are within the soft limits, so that the planner takes them.
        let _ = planner.line(mm(&self.to), feed, PathMode::ExactStop, 0);
        planner.stop(Flags::NONE);
        Ok(planner)
    }

    /// Records of these runs of control periods, each a number of periods and the distance in each; `None` where the
    /// runs leave the move.
    pub(crate) fn executed_records<const A: usize>(
        &self,
        machine: &MachineConfig,
        runs: &[[u64; 2]],
    ) -> Option<Vec<Record<A>>> {
        let mut planner = self.plan::<A>(machine).ok()?;
        let (mut planned, mut executed): (Vec<Record<A>>, Vec<Record<A>>) = (Vec::new(), Vec::new());
        let mut place = Place::start_of(RecordIndex::new(0));
        for &[count, units] in runs {
            let distance = Distance::from_units(i64::try_from(units).ok()?);
            for _ in 0..count {
                let to = place.moved(distance);
                while planned.len() <= to.record.number() as usize
                    && let Some(record) = planner.next_record()
                {
                    planned.push(record);
                }
                let increments = executed_increments(place, to, |n| planned.get(n.number() as usize))?;
                executed.push(Record { increments, flags: Flags::PROBING, ..Record::default() });
                place = to;
            }
        }
        if let Some(last) = executed.last_mut() {
            last.flags = last.flags.with(Flags::REST);
        }
        Some(executed)
    }
}

/// What a probing move has found, as the program sees it: positions in program coordinates and units.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbeResult {
    /// The touch; without one, the end of the move as programmed.
    pub touch: retrace_gcode::Pose,
    /// Where the machine came to rest.
    pub rest: retrace_gcode::Pose,
    /// Whether the probe has responded.
    pub touched: bool,
}

/// What a probing move has found, in mm of the machine's axes.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbeOutcome<const A: usize> {
    /// Position at the touch; without one, the end of the move as programmed.
    pub touch_mm: [f64; A],
    /// Position at rest.
    pub rest_mm: [f64; A],
    /// Whether the probe has responded.
    pub touched: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use retrace_core::playback::emission;

    fn down() -> (MachineConfig, ProbeMove) {
        let machine = MachineConfig::built_in().expect("valid");
        let (mut from, mut to) = ([0; 9], [0; 9]);
        (from[0], to[0], to[2]) = (123, 4123, -9_000);
        let probing = Probing { away: false, must_trip: true };
        (machine, ProbeMove { from, to, feed_nm_per_s: 5_000_000, probing })
    }

    #[test]
    fn a_move_that_is_run_to_its_end_leaves_its_own_records() {
        let (machine, way) = down();
        let mut planner = way.plan::<3>(&machine).expect("valid");
        let whole: Vec<[i16; 3]> = std::iter::from_fn(|| planner.next_record()).map(|r| r.increments).collect();
        let runs = [[whole.len() as u64, 1 << 32]];
        let executed = way.executed_records::<3>(&machine, &runs).expect("within the move");
        assert_eq!(executed.iter().map(|r| r.increments).collect::<Vec<_>>(), whole);
        assert_eq!(executed.last().map(|r| r.flags), Some(Flags::PROBING.with(Flags::REST)));
        assert_eq!(whole.iter().map(|r| i64::from(r[2])).sum::<i64>(), -9_000);
        assert_eq!(way.executed_records::<3>(&machine, &[[whole.len() as u64 + 1, 1 << 32]]), None);
        assert_eq!(way.executed_records::<3>(&machine, &[]), Some(Vec::new()));
    }

    #[test]
    fn parts_of_records_sum_to_where_they_end() {
        let (machine, way) = down();
        let runs = [[300, 1 << 32], [1, 0xC000_0000], [1, 0x8000_0000], [2, 0x4000_0000]];
        let executed = way.executed_records::<3>(&machine, &runs).expect("within the move");
        let mut planner = way.plan::<3>(&machine).expect("valid");
        let planned: Vec<Record<3>> = std::iter::from_fn(|| planner.next_record()).collect();
        let end = Place { record: RecordIndex::new(301), fraction: 0xC000_0000 };
        let sum = emission(Place::start_of(RecordIndex::new(0)), end, |n| planned.get(n.number() as usize));
        let all = (0..3).map(|axis| executed.iter().map(|r| i64::from(r.increments[axis])).sum::<i64>());
        assert_eq!(sum.map(Vec::from), Some(all.collect()));
        assert_eq!(executed.len(), 304);
    }
}
