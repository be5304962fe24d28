//! A set of stretches of the path.
//!
//! Invariant: the ranges are in order and do not touch each other.

/// Ranges of places, both ends included; a range may be a single place.
#[derive(Clone, Debug, Default)]
pub(crate) struct PlaceRanges {
    ranges: Vec<[f64; 2]>,
}

impl PlaceRanges {
    /// Adds the stretch between two places, in either order.
    pub(crate) fn insert(&mut self, from: f64, to: f64) {
        let mut range = [from.min(to), from.max(to)];
        let first = self.ranges.partition_point(|[_, end]| *end < range[0]);
        let behind = first + self.ranges[first..].partition_point(|[begin, _]| *begin <= range[1]);
        if first < behind {
            range = [range[0].min(self.ranges[first][0]), range[1].max(self.ranges[behind - 1][1])];
        }
        self.ranges.splice(first..behind, [range]);
    }

    /// Distance of a place from the nearest range, in records; infinite where there is none.
    pub(crate) fn distance(&self, place: f64) -> f64 {
        let next = self.ranges.partition_point(|[_, end]| *end < place);
        let before = next.checked_sub(1).map_or(f64::INFINITY, |index| place - self.ranges[index][1]);
        let after = self.ranges.get(next).map_or(f64::INFINITY, |[begin, _]| (begin - place).max(0.0));
        before.min(after)
    }

    /// Whether a place is in a range.
    pub(crate) fn contains(&self, place: f64) -> bool {
        self.distance(place) == 0.0
    }

    /// Whether there is no range.
    pub(crate) fn is_empty(&self) -> bool {
        self.ranges.is_empty()
    }

    /// The stretches that the other set leaves out.
    pub(crate) fn missing_in(&self, other: &Self) -> Vec<[f64; 2]> {
        let mut missing = Vec::new();
        for [begin, end] in &self.ranges {
            let mut at = *begin;
            let first = other.ranges.partition_point(|[_, other_end]| other_end < begin);
            for [other_begin, other_end] in other.ranges[first..].iter().take_while(|[from, _]| from <= end) {
                missing.push([at, *other_begin]);
                at = at.max(*other_end);
            }
            missing.push([at, *end]);
        }
        missing.retain(|[from, to]| from < to);
        missing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ranges(list: &[[f64; 2]]) -> PlaceRanges {
        let mut ranges = PlaceRanges::default();
        list.iter().for_each(|[from, to]| ranges.insert(*from, *to));
        ranges
    }

    #[test]
    fn stretches_that_touch_become_one() {
        let set = ranges(&[[5.0, 6.0], [1.0, 2.0], [9.0, 9.0], [3.0, 2.0], [5.5, 5.6], [20.0, 30.0]]);
        assert_eq!(set.ranges, [[1.0, 3.0], [5.0, 6.0], [9.0, 9.0], [20.0, 30.0]]);
        assert_eq!(ranges(&[[5.0, 6.0], [1.0, 2.0], [9.0, 9.0], [0.0, 9.0]]).ranges, [[0.0, 9.0]]);
    }

    #[test]
    fn distances_are_to_the_nearest_range() {
        let set = ranges(&[[1.0, 3.0], [9.0, 9.0]]);
        let places = [0.0, 1.0, 2.5, 3.0, 4.0, 7.0, 9.0, 10.5];
        assert_eq!(places.map(|place| set.distance(place)), [1.0, 0.0, 0.0, 0.0, 1.0, 2.0, 0.0, 1.5]);
        assert!(set.contains(2.0) && !set.contains(8.0) && !set.is_empty());
        assert!(PlaceRanges::default().distance(0.0).is_infinite() && PlaceRanges::default().is_empty());
    }

    #[test]
    fn what_the_other_set_leaves_out_is_measured() {
        let set = ranges(&[[0.0, 10.0], [20.0, 30.0]]);
        let missing = |list: &[[f64; 2]]| set.missing_in(&ranges(list));
        assert!(missing(&[[0.0, 30.0]]).is_empty() && missing(&[[-5.0, 10.0], [20.0, 30.0], [40.0, 50.0]]).is_empty());
        assert_eq!(missing(&[[1.0, 10.0], [20.0, 24.0], [25.0, 29.0]]), [[0.0, 1.0], [24.0, 25.0], [29.0, 30.0]]);
        assert_eq!(missing(&[[0.0, 4.0], [6.0, 15.0], [19.0, 28.5]]), [[4.0, 6.0], [28.5, 30.0]]);
        assert_eq!(missing(&[]), [[0.0, 10.0], [20.0, 30.0]]);
        assert_eq!(missing(&[[5.0, 25.0]]), [[0.0, 5.0], [25.0, 30.0]]);
    }
}
