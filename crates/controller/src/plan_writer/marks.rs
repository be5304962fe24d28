//! Marks of the plan in the index of the journal, and their comparison with those of an earlier run.
//!
//! Invariant: a mark is made at most every [`MAX_RECORDS_PER_MARK`] records, and never twice at one place.

use retrace_core::Record;
use retrace_journal::{IndexEntry, MarkDifference};

use super::{Cancelled, MAX_RECORDS_PER_MARK, PlanWriter};
use crate::plan_item::PathItem;

impl<const A: usize> PlanWriter<'_, A> {
    /// Marks what is planned, if it is not marked yet.
    pub(super) fn write_mark(&mut self) {
        if self.next_mark.place != self.marked_until {
            self.marked_until = self.next_mark.place;
            self.index.write(IndexEntry::Mark(self.next_mark));
        }
    }

    /// Updates the mark with a record that was pushed. The mark is made where it is due, and compared with that of an
    /// earlier run.
    pub(super) fn update_mark(&mut self, record: &Record<A>, block: u64) -> Result<(), Cancelled> {
        self.next_mark.place = self.ring.write();
        (self.next_mark.line, self.next_mark.block) = (record.line, block);
        for (count, &increment) in self.next_mark.counts.iter_mut().zip(&record.increments) {
            *count += i64::from(increment);
        }
        if self.next_mark.place.since(self.marked_until) >= MAX_RECORDS_PER_MARK {
            self.write_mark();
        }
        while let Some(&was) = self.expected_marks.front()
            && !self.next_mark.place.is_before(was.place)
        {
            self.expected_marks.pop_front();
            if was != self.next_mark {
                self.send(PathItem::Differs(Box::new(MarkDifference { was, is: self.next_mark })))?;
            } else if self.expected_marks.is_empty() {
                self.send(PathItem::MarksPassed)?;
            }
        }
        Ok(())
    }
}
