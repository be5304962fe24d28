//! The four positions of the record ring, and what every operation makes of them (REV-2 … REV-7).
//!
//! Plain numbers, no cells and no threads: what the ring decides, it decides here. [`Planned`] is the planner's view, [`Played`] the
//! motion path's; each holds the other's word as it was last seen, which is always on the safe side, as both words only grow.
//!
//! Invariant: `head ≤ read ≤ reached ≤ write` by wrapping difference, `reached − head ≤ keep`, and `floor = reached − keep`
//! never lies beyond `head`. The planner's place to write is less than `room` beyond the floor that it has seen.

/// The planner's view: where it writes, and how far that is free.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProducerIndices {
    write: u32,
    floor: u32,
    room: u32,
}

impl ProducerIndices {
    /// Writes at `write` while that is less than `room` beyond `floor`.
    #[must_use]
    pub const fn at(write: u32, floor: u32, room: u32) -> Self {
        Self { write, floor, room }
    }

    /// The place number that the next record will have.
    #[must_use]
    pub const fn write(&self) -> u32 {
        self.write
    }

    /// Is there no room, as far as is known?
    #[inline]
    #[must_use]
    pub const fn is_full(&self) -> bool {
        self.write.wrapping_sub(self.floor) >= self.room
    }

    /// How many records there is room for, as far as is known.
    #[inline]
    #[must_use]
    pub const fn slots(&self) -> u32 {
        self.room.saturating_sub(self.write.wrapping_sub(self.floor))
    }

    /// The floor is now known to be there.
    #[inline]
    pub const fn observe_floor(&mut self, floor: u32) {
        self.floor = floor;
    }

    /// A record has been written at `write`.
    #[inline]
    pub const fn advance(&mut self) {
        self.write = self.write.wrapping_add(1);
    }
}

/// The motion path's view: history, cursor, and how much is planned as far as it has seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConsumerIndices {
    head: u32,
    read: u32,
    reached: u32,
    write: u32,
    keep: u32,
}

impl ConsumerIndices {
    /// At these positions. `None` where they are not `head ≤ read ≤ reached ≤ write`, keep more than `keep` records behind
    /// `reached`, or span more than 2³⁰ records.
    #[must_use]
    pub const fn at(head: u32, read: u32, reached: u32, write: u32, keep: u32) -> Option<Self> {
        let kept = reached.wrapping_sub(head);
        let span = write.wrapping_sub(head);
        let valid =
            read.wrapping_sub(head) <= kept && kept <= keep && kept <= span && span <= 1 << 30 && keep <= 1 << 30;
        if valid { Some(Self { head, read, reached, write, keep }) } else { None }
    }

    /// Oldest record kept.
    #[must_use]
    pub const fn head(&self) -> u32 {
        self.head
    }

    /// The cursor: the record that would be read next going forward.
    #[must_use]
    pub const fn read(&self) -> u32 {
        self.read
    }

    /// The furthest place ever executed; the source's W.
    #[must_use]
    pub const fn reached(&self) -> u32 {
        self.reached
    }

    /// Does the cursor stand at `reached`? There forward run ends, whatever has been planned since (REV-7, REV-9).
    #[inline]
    #[must_use]
    pub const fn at_reached(&self) -> bool {
        self.read == self.reached
    }

    /// The end of what is planned, as last seen.
    #[must_use]
    pub const fn write(&self) -> u32 {
        self.write
    }

    /// What the planner may write up to `room` beyond: `reached − keep`.
    #[inline]
    #[must_use]
    pub const fn floor(&self) -> u32 {
        self.reached.wrapping_sub(self.keep)
    }

    /// The end of what is planned is now known to be there.
    #[inline]
    pub const fn observe_write(&mut self, write: u32) {
        self.write = write;
    }

    /// Is the record `place` kept or planned, as far as is known?
    #[inline]
    #[must_use]
    pub const fn holds(&self, place: u32) -> bool {
        place.wrapping_sub(self.head) < self.write.wrapping_sub(self.head)
    }

    /// Moves the cursor over the record under it, which is the place that comes back; `None` at `write`. (REV-5, REV-7)
    #[inline]
    pub const fn advance_cursor(&mut self) -> Option<u32> {
        if self.read == self.write {
            return None;
        }
        let place = self.read;
        self.read = place.wrapping_add(1);
        // one record at a time: only from `reached` does the cursor get beyond it
        if place == self.reached {
            self.reach(self.read);
        }
        Some(place)
    }

    /// Moves the cursor back over a record, which is the place that comes back; `None` at `head`. (REV-6)
    #[inline]
    pub const fn retreat(&mut self) -> Option<u32> {
        if self.read == self.head {
            return None;
        }
        self.read = self.read.wrapping_sub(1);
        Some(self.read)
    }

    /// Puts the cursor on `place`, as the card reports it; false, and nothing changed, where that is not in `head … write`.
    #[inline]
    pub const fn seek(&mut self, place: u32) -> bool {
        let within = place.wrapping_sub(self.head) <= self.write.wrapping_sub(self.head);
        if within {
            self.settle(place);
        }
        within
    }

    /// The cursor stands at `read`, within `head … write`: `reached` follows it forward.
    #[inline]
    const fn settle(&mut self, read: u32) {
        self.read = read;
        let passed = read.wrapping_sub(self.head);
        if passed > self.reached.wrapping_sub(self.head) {
            self.reach(read);
        }
    }

    /// `reached` goes on to `place`, and `head` follows the floor.
    #[inline]
    const fn reach(&mut self, place: u32) {
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
        let mut played = ConsumerIndices::at(9, 9, 9, 20, 3).expect("valid");
        for place in 9..14 {
            assert_eq!(played.advance_cursor(), Some(place));
        }
        assert_eq!((played.head(), played.reached(), played.floor()), (11, 14, 11));
        assert!(played.seek(12) && played.seek(20) && !played.seek(21) && !played.seek(16));
        assert_eq!((played.head(), played.read()), (17, 20));
    }
}
