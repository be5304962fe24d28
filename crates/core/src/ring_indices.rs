//! The four positions of the record ring and the operations on them (REV-2 … REV-7).
//!
//! Plain numbers without cells or threads: all decisions of the ring are made here. [`ProducerIndices`] is the
//! planner's view, [`ConsumerIndices`] the motion path's. Each holds the other's number as last observed, which is
//! always on the safe side, as both numbers only grow.
//!
//! Invariant: `head ≤ read ≤ reached ≤ write` by wrapping difference, `reached − head ≤ keep`, and `floor = reached −
//! keep` is never beyond `head`. The planner's write position is less than `limit` beyond the floor that it has
//! observed.

/// Whether a ring may have that many cells: a power of two, at most 2³⁰.
#[must_use]
pub const fn is_cell_count(cells: usize) -> bool {
    cells.is_power_of_two() && cells <= 1 << 30
}

/// Whether that many cells are enough to retain `keep` records and hold `look_ahead` planned ones, of which there is at
/// least one.
#[must_use]
pub const fn sizes_fit(cells: usize, keep: u32, look_ahead: u32) -> bool {
    look_ahead > 0 && keep as u64 + look_ahead as u64 <= cells as u64
}

/// Planner's view: the write position and the free space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProducerIndices {
    write: u32,
    floor: u32,
    limit: u32,
}

impl ProducerIndices {
    /// Creates a view that writes at `write` while that is less than `limit` beyond `floor`.
    #[must_use]
    pub const fn at(write: u32, floor: u32, limit: u32) -> Self {
        Self { write, floor, limit }
    }

    /// Returns the number that the next record will have.
    #[must_use]
    pub const fn write(&self) -> u32 {
        self.write
    }

    /// Whether no record can be written, as far as is known.
    #[inline]
    #[must_use]
    pub const fn is_full(&self) -> bool {
        self.write.wrapping_sub(self.floor) >= self.limit
    }

    /// Returns the number of records that can be written, as far as is known.
    #[inline]
    #[must_use]
    pub const fn slots(&self) -> u32 {
        self.limit.saturating_sub(self.write.wrapping_sub(self.floor))
    }

    /// Sets the floor as now observed.
    #[inline]
    pub const fn observe_floor(&mut self, floor: u32) {
        self.floor = floor;
    }

    /// Advances `write` after a record has been written there.
    #[inline]
    pub const fn advance(&mut self) {
        self.write = self.write.wrapping_add(1);
    }
}

/// Motion path's view: history, cursor, and the end of the plan as last observed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConsumerIndices {
    head: u32,
    read: u32,
    reached: u32,
    write: u32,
    keep: u32,
}

impl ConsumerIndices {
    /// Creates a view with these positions.
    ///
    /// Returns `None` if they are not `head ≤ read ≤ reached ≤ write`, retain more than `keep` records behind
    /// `reached`, or span more than 2³⁰ records.
    #[must_use]
    pub const fn at(head: u32, read: u32, reached: u32, write: u32, keep: u32) -> Option<Self> {
        let history = reached.wrapping_sub(head);
        let span = write.wrapping_sub(head);
        let valid = read.wrapping_sub(head) <= history
            && history <= keep
            && history <= span
            && span <= 1 << 30
            && keep <= 1 << 30;
        if valid { Some(Self { head, read, reached, write, keep }) } else { None }
    }

    /// Returns the number of the oldest record retained.
    #[must_use]
    pub const fn head(&self) -> u32 {
        self.head
    }

    /// Returns the cursor: the number of the record that would be read next in forward direction.
    #[must_use]
    pub const fn read(&self) -> u32 {
        self.read
    }

    /// Returns the furthest place ever executed; W in the source.
    #[must_use]
    pub const fn reached(&self) -> u32 {
        self.reached
    }

    /// Whether the cursor is at `reached`. Forward run ends there, whatever has been planned since (REV-7, REV-9).
    #[inline]
    #[must_use]
    pub const fn at_reached(&self) -> bool {
        self.read == self.reached
    }

    /// Returns the end of what is planned, as last observed.
    #[must_use]
    pub const fn write(&self) -> u32 {
        self.write
    }

    /// Returns `reached − keep`: the planner may write up to `limit` beyond it.
    #[inline]
    #[must_use]
    pub const fn floor(&self) -> u32 {
        self.reached.wrapping_sub(self.keep)
    }

    /// Sets the end of what is planned as now observed.
    #[inline]
    pub const fn observe_write(&mut self, write: u32) {
        self.write = write;
    }

    /// Whether record `place` is retained or planned, as far as is known.
    #[inline]
    #[must_use]
    pub const fn holds(&self, place: u32) -> bool {
        place.wrapping_sub(self.head) < self.write.wrapping_sub(self.head)
    }

    /// Moves the cursor forward over the record under it and returns that record's number; `None` at `write`. (REV-5,
    /// REV-7)
    #[inline]
    pub const fn advance_cursor(&mut self) -> Option<u32> {
        if self.read == self.write {
            return None;
        }
        let place = self.read;
        self.read = place.wrapping_add(1);
        // one record at a time: the cursor passes `reached` only from `reached`
        if place == self.reached {
            self.extend_reached(self.read);
        }
        Some(place)
    }

    /// Moves the cursor back over a record and returns that record's number; `None` at `head`. (REV-6)
    #[inline]
    pub const fn retreat(&mut self) -> Option<u32> {
        if self.read == self.head {
            return None;
        }
        self.read = self.read.wrapping_sub(1);
        Some(self.read)
    }

    /// Sets the cursor to `place`, as reported by the card.
    ///
    /// Returns false and changes nothing if `place` is not in `head … write`.
    #[inline]
    pub const fn seek(&mut self, place: u32) -> bool {
        let within = place.wrapping_sub(self.head) <= self.write.wrapping_sub(self.head);
        if within {
            self.move_cursor(place);
        }
        within
    }

    /// Moves the cursor to `read`, within `head … write`; `reached` follows it forward.
    #[inline]
    const fn move_cursor(&mut self, read: u32) {
        self.read = read;
        let passed = read.wrapping_sub(self.head);
        if passed > self.reached.wrapping_sub(self.head) {
            self.extend_reached(read);
        }
    }

    /// Moves `reached` forward to `place`; `head` follows the floor.
    #[inline]
    const fn extend_reached(&mut self, place: u32) {
        self.reached = place;
        let passed = place.wrapping_sub(self.head);
        if passed > self.keep {
            self.head = self.floor();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_out_of_order_are_none() {
        assert!(ConsumerIndices::at(5, 7, 9, 12, 4).is_some());
        assert!(ConsumerIndices::at(u32::MAX, 0, 1, 1, 2).is_some());
        for (head, read, reached, write, keep) in
            [(5, 4, 9, 12, 4), (5, 10, 9, 12, 4), (5, 7, 13, 12, 9), (5, 7, 9, 12, 3), (5, 7, 9, 4, 4)]
        {
            assert_eq!(ConsumerIndices::at(head, read, reached, write, keep), None);
        }
    }

    #[test]
    fn head_follows_reached_once_there_is_more_than_is_kept() {
        let mut indices = ConsumerIndices::at(9, 9, 9, 20, 3).expect("valid");
        for place in 9..14 {
            assert_eq!(indices.advance_cursor(), Some(place));
        }
        assert_eq!((indices.head(), indices.reached(), indices.floor()), (11, 14, 11));
        assert!(indices.seek(12) && indices.seek(20) && !indices.seek(21) && !indices.seek(16));
        assert_eq!((indices.head(), indices.read()), (17, 20));
    }
}
