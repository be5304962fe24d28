//! The override above 100 % that is planned, where the program permits it (M48 … M50).
//!
//! Invariant: what the operator requests is journaled at its place whether it applies there or not. So a resumed job
//! has the same requests, and from its program the same places at which they apply.

use retrace_core::Rate;
use retrace_journal::IndexEntry;

use super::{PlanWriter, SwitchInstruction};
use crate::plan_item::ExclusiveKind;

/// Override that is planned from here on.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlannedOverride {
    /// As the operator requests it: 1 or more.
    requested: Rate,
    /// Whether it applies.
    applies: bool,
}

impl Default for PlannedOverride {
    fn default() -> Self {
        Self { requested: Rate::ONE, applies: true }
    }
}

impl PlannedOverride {
    fn factor(self) -> f64 {
        if self.applies { f64::from(self.requested) } else { 1.0 }
    }
}

impl SwitchInstruction<'_> {
    /// The instruction from which on the operator's overrides apply, or do not.
    #[must_use]
    pub(crate) fn of_feed_override(applies: bool, line: u32) -> Self {
        let kind = ExclusiveKind::FeedOverride { applies };
        Self { line, kind, code: if applies { "M48" } else { "M49" }, ..Self::default() }
    }
}

impl<const A: usize> PlanWriter<'_, A> {
    /// Applies a requested override that is due at the next record.
    pub(super) fn apply_due_override(&mut self) {
        if let Some(planned) = self.overrides.due_at(self.ring.write()) {
            self.index.write(IndexEntry::Override { place: self.ring.write(), planned });
            self.planned_override.requested = planned;
            self.planner.set_feed_override(self.planned_override.factor());
        }
    }

    /// Sets whether overrides apply from here on, where the path rests.
    pub(super) fn switch_override(&mut self, applies: bool) {
        self.planned_override.applies = applies;
        self.planner.set_feed_override(self.planned_override.factor());
    }
}
