//! A set of records of the path, as ranges: what was cut of it.
//!
//! Invariant: the ranges are not empty, disjoint, do not touch, and are in the order of the path.

use retrace_core::RecordIndex;

/// Ranges of records, each by its first record and the first behind it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RecordRanges {
    ranges: Vec<[RecordIndex; 2]>,
    /// Number of ranges beyond which the oldest is forgotten; `None` where none is.
    most: Option<usize>,
}

impl RecordRanges {
    /// Creates an empty set of at most this number of ranges, which does not allocate later.
    #[must_use]
    pub fn with_room_for(most: usize) -> Self {
        Self { ranges: Vec::with_capacity(most), most: Some(most) }
    }

    /// Adds the records from `begin` to `end`; `end` itself is not among them.
    pub fn insert(&mut self, begin: RecordIndex, end: RecordIndex) {
        if !begin.is_before(end) {
            return;
        }
        // what touches the new range becomes part of it
        let first = self.ranges.partition_point(|[_, other_end]| other_end.is_before(begin));
        let behind = self.ranges.partition_point(|[other_begin, _]| !end.is_before(*other_begin)).max(first);
        let merged = self.ranges[first..behind].iter().fold([begin, end], |[begin, end], &[from, to]| {
            [if from.is_before(begin) { from } else { begin }, RecordIndex::later(end, to)]
        });
        if first < behind {
            self.ranges[first] = merged;
            self.ranges.drain(first + 1..behind);
        } else if self.most.is_none_or(|most| self.ranges.len() < most) {
            self.ranges.insert(first, merged);
        } else if let Some(later) = first.checked_sub(1) {
            self.ranges.remove(0);
            self.ranges.insert(later, merged);
        }
    }

    /// Removes the records from `begin` on.
    pub fn truncate(&mut self, begin: RecordIndex) {
        self.ranges.retain(|[from, _]| from.is_before(begin));
        if let Some([_, end]) = self.ranges.last_mut()
            && begin.is_before(*end)
        {
            *end = begin;
        }
    }

    /// Replaces the ranges by the last ones of another set, as many as there is room for.
    pub fn restore(&mut self, from: &Self) {
        let count = self.most.map_or(from.ranges.len(), |most| most.min(from.ranges.len()));
        self.ranges.clear();
        self.ranges.extend_from_slice(&from.ranges[from.ranges.len() - count..]);
    }

    /// Whether this record is in the set.
    #[must_use]
    pub fn contains(&self, record: RecordIndex) -> bool {
        self.reaching_beyond(record).next().is_some_and(|[begin, _]| !record.is_before(begin))
    }

    /// The ranges with a record at or behind this one.
    pub fn reaching_beyond(&self, record: RecordIndex) -> impl Iterator<Item = [RecordIndex; 2]> + '_ {
        let first = self.ranges.partition_point(|[_, end]| !record.is_before(*end));
        self.ranges[first..].iter().copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    /// The path passes the end of the counter.
    fn at(number: u32) -> RecordIndex {
        RecordIndex::new(4_294_967_200u32.wrapping_add(number))
    }

    fn records(ranges: &RecordRanges) -> BTreeSet<u32> {
        (0..400).filter(|&number| ranges.contains(at(number))).collect()
    }

    proptest! {
        /// A record is in the set exactly where a range has it, up to where the set was truncated since.
        #[test]
        fn records_are_in_the_set_that_were_added(
            changes in prop::collection::vec((0u32..300, 0u32..40, prop::bool::weighted(0.1)), 1..40),
        ) {
            let (mut ranges, mut expected) = (RecordRanges::default(), BTreeSet::new());
            for (begin, length, truncates) in changes {
                if truncates {
                    ranges.truncate(at(begin));
                    expected.retain(|&number| number < begin);
                } else {
                    ranges.insert(at(begin), at(begin + length));
                    expected.extend(begin..begin + length);
                }
                prop_assert_eq!(&records(&ranges), &expected);
            }
            for pair in ranges.ranges.windows(2) {
                prop_assert!(pair[0][1].is_before(pair[1][0]) && pair[0][0].is_before(pair[0][1]));
            }
            let mut few = RecordRanges::with_room_for(2);
            few.restore(&ranges);
            prop_assert_eq!(&few.ranges[..], &ranges.ranges[ranges.ranges.len().saturating_sub(2)..]);
        }
    }

    #[test]
    fn where_there_is_no_room_the_oldest_range_is_forgotten() {
        let mut ranges = RecordRanges::with_room_for(2);
        [0, 20, 10, 40, 30].into_iter().for_each(|begin| ranges.insert(at(begin), at(begin + 5)));
        assert_eq!(ranges.ranges, [[at(30), at(35)], [at(40), at(45)]]);
        ranges.insert(at(0), at(5));
        assert_eq!(ranges.ranges.len(), 2, "one that is older than all is not added");
        assert_eq!(ranges.ranges[0][0], at(30));
    }
}
