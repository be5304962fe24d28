//! The records of each contour on a path, by which a drawing shows the contour (CUT-61).
//!
//! Invariant: contours are in the order of their numbers and of their records, and their number is bounded.

/// Maximum number of contours; further ones have no records.
const MAX_CONTOURS: usize = 100_000;

/// Records of the contours of a path.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct ContourRecords {
    /// Number of each contour, its first record, and the one after its last.
    contours: Vec<(u32, [u32; 2])>,
}

impl ContourRecords {
    /// Adds records to a contour: the first one, and the one after the last. Number 0 is that of no contour.
    pub(crate) fn add(&mut self, number: u32, [first, end]: [u32; 2]) {
        let last = self.contours.last().map_or(0, |&(last, _)| last);
        if number > last && self.contours.len() < MAX_CONTOURS {
            self.contours.push((number, [first, end]));
        } else if number == last
            && let Some((_, records)) = self.contours.last_mut()
        {
            records[1] = end;
        }
    }

    /// Records of a contour: the first one, and the one after the last.
    pub(crate) fn records_of(&self, number: u32) -> Option<[u32; 2]> {
        let index = self.contours.binary_search_by_key(&number, |&(number, _)| number).ok()?;
        self.contours.get(index).map(|&(_, records)| records)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_belong_to_the_contour_in_which_they_were_added() {
        let mut contours = ContourRecords::default();
        for (number, records) in
            [(0, [0, 10]), (2, [10, 20]), (2, [20, 30]), (3, [30, 40]), (0, [40, 50]), (2, [50, 60])]
        {
            contours.add(number, records);
        }
        let found = [0, 1, 2, 3, 4].map(|number| contours.records_of(number));
        assert_eq!(found, [None, None, Some([10, 30]), Some([30, 40]), None]);
    }
}
