//! The lead-in of a shifted restart: the records from a place on the path to the start beside it, and from there back
//! to the place (CUT-37, CUT-39, CUT-40).
//!
//! They have the place numbers before the place where the path is joined, so that they are played in the epoch of what
//! follows; the recorded path itself is unchanged. Each move has one velocity. The machine rests at both of its ends,
//! which the card's rate law provides: nothing beyond the end of a move is sent before. Only an arc may be followed by
//! the records of the path without a rest.
//!
//! Invariant: the increments of each move sum to the difference of its ends exactly.

use retrace_core::{Distance, FeedShare, Flags, Place, Record, RecordIndex};
use retrace_link::{HostCommand, MotionCard};

use super::RecordStreamer;

/// Largest increment of an axis in one record.
const MAX_INCREMENT: u64 = 30_000;

/// A straight move of a lead-in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LeadInMove<const A: usize> {
    /// Counts at its end.
    pub(crate) to: [i64; A],
    /// Maximum velocity of each axis in mm/s, or of the path.
    pub(crate) velocity_mm_s: f64,
    /// Whether it is rapid motion.
    pub(crate) is_rapid: bool,
}

/// A lead-in.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LeadIn<const A: usize> {
    records: Vec<Record<A>>,
    /// Where the machine rests, in the order of the path.
    stops: Vec<RecordIndex>,
    begin: RecordIndex,
    /// Where the cutter starts.
    start: RecordIndex,
}

/// The part of a lead-in on which the cutter is on.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum LeadInEnd<const A: usize> {
    /// A straight move, at whose end the machine rests.
    Line(LeadInMove<A>),
    /// A curve, by the counts at the ends of its records.
    Curve {
        /// The last ones are those of the join.
        counts: Vec<[i64; A]>,
        /// Whether the machine rests at the join.
        rests: bool,
    },
}

impl<const A: usize> LeadIn<A> {
    /// Plans the moves that begin at the counts `from`, and the end that leads in and joins the path at `join`.
    pub(crate) fn new(
        join: RecordIndex,
        from: [i64; A],
        (moves, end): (&[LeadInMove<A>], &LeadInEnd<A>),
        mm_per_pulse: &[f64; A],
        period_s: f64,
    ) -> Self {
        let (mut records, mut at, mut lengths) = (Vec::new(), from, Vec::new());
        let mut append = |records: &mut Vec<Record<A>>, at: [i64; A], part: &LeadInMove<A>| {
            let pulses = std::array::from_fn(|axis| part.to[axis] - at[axis]);
            append_move(records, pulses, part, mm_per_pulse, period_s);
            lengths.push(records.len() as u32);
        };
        for part in moves {
            append(&mut records, at, part);
            at = part.to;
        }
        let start = records.len() as u32;
        match end {
            LeadInEnd::Line(part) => append(&mut records, at, part),
            LeadInEnd::Curve { counts, rests } => {
                for to in counts {
                    let increments = std::array::from_fn(|axis| (to[axis] - at[axis]) as i16);
                    records.push(Record { increments, ..Record::default() });
                    at = *to;
                }
                lengths.extend(rests.then_some(records.len() as u32));
            }
        }
        let begin = join - records.len() as u32;
        let stops = lengths.into_iter().map(|length| begin + length).collect();
        Self { records, stops, begin, start: begin + start }
    }

    /// Gives the records from the start of the cutter on their share of the feed, by the share that a record of 1 mm
    /// has: the power of a beam follows it (CUT-20).
    pub(crate) fn with_feed_shares(mut self, units_per_mm: f64, mm_per_pulse: &[f64; A]) -> Self {
        let lit = self.start.since(self.begin) as usize;
        for record in self.records.iter_mut().skip(lit) {
            let mm =
                record.increments.iter().zip(mm_per_pulse).map(|(&n, mm)| (f64::from(n) * mm).powi(2)).sum::<f64>();
            let units = (mm.sqrt() * units_per_mm).round().clamp(0.0, f64::from(u16::MAX));
            record.feed_share = FeedShare::from_units(units as u16);
        }
        self
    }

    /// Place where it begins.
    pub(crate) fn begin(&self) -> RecordIndex {
        self.begin
    }

    /// Place where the path is joined.
    pub(crate) fn join(&self) -> RecordIndex {
        self.begin + self.records.len() as u32
    }

    /// Place where the cutter starts.
    pub(crate) fn start(&self) -> RecordIndex {
        self.start
    }

    /// Returns its record at a place, if there is one.
    pub(crate) fn record(&self, place: RecordIndex) -> Option<Record<A>> {
        let is_inside = !place.is_before(self.begin) && place.is_before(self.join());
        is_inside.then(|| self.records.get(place.since(self.begin) as usize).copied())?
    }

    /// Place at which sending ends: the next stop, or the one after it once the machine rests there. `None` behind the
    /// last one.
    pub(crate) fn end_of_sending(&self, place: Place, at_rest: bool) -> Option<RecordIndex> {
        let is_done = |stop: RecordIndex| {
            let stop = Place::start_of(stop);
            stop.distance_to(place) > Distance::ZERO || place == stop && at_rest
        };
        self.stops.iter().copied().find(|&stop| !is_done(stop))
    }
}

impl<const A: usize> RecordStreamer<'_, A> {
    /// Begins a lead-in, whose records are sent in place of those of the path until it is joined.
    pub(crate) fn begin_lead_in(&mut self, lead_in: LeadIn<A>) {
        self.lead_in = Some(lead_in);
    }

    /// The lead-in, until the card has forgotten its records.
    pub(crate) fn lead_in(&self) -> Option<&LeadIn<A>> {
        self.lead_in.as_ref()
    }

    /// Ends the lead-in: the card holds the records of the path.
    pub(crate) fn end_lead_in(&mut self) {
        self.lead_in = None;
    }

    /// Sends the records of a lead-in from `place` on. Returns the place from which those of the path are to be sent;
    /// `None` where the machine has to come to rest first, or the card is full.
    pub(super) fn fill_lead_in<C: MotionCard<A>>(&self, card: &mut C, place: RecordIndex) -> Option<RecordIndex> {
        let Some(lead_in) = &self.lead_in else { return Some(place) };
        let (mut place, status) = (place, card.status());
        let stop = lead_in.end_of_sending(status.place, status.at_rest);
        let end = stop.unwrap_or(lead_in.join());
        while place.is_before(end) {
            let record = lead_in.record(place)?;
            card.send(HostCommand::Ahead { place, record }).ok()?;
            place += 1;
        }
        stop.is_none().then_some(place)
    }
}

/// Appends the records of a straight move by these pulses.
fn append_move<const A: usize>(
    records: &mut Vec<Record<A>>,
    pulses: [i64; A],
    part: &LeadInMove<A>,
    mm_per_pulse: &[f64; A],
    period_s: f64,
) {
    let length_mm = pulses.iter().zip(mm_per_pulse).map(|(&n, mm)| (n as f64 * mm).powi(2)).sum::<f64>().sqrt();
    let by_velocity = (length_mm / (part.velocity_mm_s * period_s)).ceil().clamp(0.0, f64::from(u32::MAX)) as u64;
    let by_increment = pulses.iter().map(|n| n.unsigned_abs().div_ceil(MAX_INCREMENT)).max().unwrap_or(0);
    let count = by_velocity.max(by_increment) as i64;
    let flags = if part.is_rapid { Flags::RAPID } else { Flags::NONE };
    let after = |n: i64, record: i64| (i128::from(n) * i128::from(record)).div_euclid(i128::from(count.max(1))) as i64;
    for record in 0..count {
        let increments = pulses.map(|n| (after(n, record + 1) - after(n, record)) as i16);
        records.push(Record { increments, flags, ..Record::default() });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Any moves from any place: each ends at its counts, no record is faster than its velocity by more than a
        /// pulse an axis, and the places end at the join.
        #[test]
        fn the_moves_end_where_they_are_to_end(
            join: u32,
            from in prop::array::uniform2(-1_000_000i64..1_000_000),
            ends in prop::collection::vec((prop::array::uniform2(-20_000i64..20_000), 1.0f64..300.0), 1..5),
        ) {
            let mut at = from;
            let moves: Vec<LeadInMove<2>> = ends.iter().map(|&(by, velocity_mm_s)| {
                at = [at[0] + by[0], at[1] + by[1]];
                LeadInMove { to: at, velocity_mm_s, is_rapid: false }
            }).collect();
            let join = RecordIndex::new(join);
            let (end, before) = moves.split_last().expect("at least one");
            let lead_in = LeadIn::new(join, from, (before, &LeadInEnd::Line(*end)), &[0.01, 0.005], 0.001);
            prop_assert_eq!(lead_in.join(), join);
            let (mut at, mut place) = (from, lead_in.begin());
            for (part, &stop) in moves.iter().zip(&lead_in.stops) {
                while place != stop {
                    let record = lead_in.record(place).expect("inside");
                    for (axis, mm) in [0.01, 0.005].into_iter().enumerate() {
                        at[axis] += i64::from(record.increments[axis]);
                        let pulses = f64::from(record.increments[axis].unsigned_abs()) - 1.0;
                        prop_assert!(pulses * mm <= part.velocity_mm_s * 0.001 + 1e-9);
                    }
                    place += 1;
                }
                prop_assert_eq!(at, part.to);
            }
            prop_assert!(lead_in.record(join).is_none() && lead_in.record(lead_in.begin() - 1).is_none());
        }
    }

    #[test]
    fn nothing_is_sent_beyond_a_stop_before_the_machine_rests_there() {
        let moves = [[100, 0], [100, 50], [0, 0]].map(|to| LeadInMove { to, velocity_mm_s: 10.0, is_rapid: false });
        let end = LeadInEnd::Line(moves[2]);
        let lead_in = LeadIn::new(RecordIndex::new(7), [0, 0], (&moves[..2], &end), &[0.01, 0.01], 0.001);
        let stops = lead_in.stops.clone();
        let end = |place, at_rest| lead_in.end_of_sending(place, at_rest);
        assert_eq!(end(Place::start_of(lead_in.begin()), true), Some(stops[0]));
        assert_eq!(end(Place::start_of(stops[0]), false), Some(stops[0]));
        assert_eq!(end(Place::start_of(stops[0]), true), Some(stops[1]));
        assert_eq!((lead_in.start(), lead_in.join()), (stops[1], stops[2]));
        assert_eq!(end(Place::start_of(stops[2]), false), Some(stops[2]));
        assert_eq!(end(Place::start_of(stops[2]), true), None);
        assert_eq!(end(Place { fraction: 1, ..Place::start_of(stops[2]) }, false), None);
    }

    #[test]
    fn the_end_of_a_curve_is_a_stop_only_where_it_is_said() {
        let moves = [LeadInMove { to: [100, 50], velocity_mm_s: 10.0, is_rapid: true }];
        for rests in [false, true] {
            let end = LeadInEnd::Curve { counts: vec![[90, 52], [40, 30], [0, 0]], rests };
            let lead_in = LeadIn::new(RecordIndex::new(7), [0, 0], (&moves, &end), &[0.01, 0.01], 0.001);
            assert_eq!((lead_in.start(), lead_in.join()), (RecordIndex::new(4), RecordIndex::new(7)));
            let sum = |sum: [i64; 2], n: u32| {
                let record = lead_in.record(lead_in.begin() + n).expect("inside");
                [0, 1].map(|axis| sum[axis] + i64::from(record.increments[axis]))
            };
            assert_eq!((0..lead_in.join().since(lead_in.begin())).fold([0, 0], sum), [0, 0]);
            let stop = lead_in.end_of_sending(Place::start_of(lead_in.start()), true);
            assert_eq!(stop, rests.then_some(lead_in.join()));
        }
    }
}
