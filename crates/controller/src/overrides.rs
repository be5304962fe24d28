//! The feed override: the part that is applied by the rate, the part that is planned, and from which place.
//!
//! Up to 100 % it is applied by the rate, within a period. More is planned: the motion path requests it from the
//! planning thread, for the first place that cannot have been written yet, whatever the planner has done by now. So the
//! override takes effect within the look-ahead of the ring, and at a place that does not depend on the planner's speed:
//! a run can still be repeated to the pulse. Until the cursor reaches that place, the rate compensates as far as it
//! can: it is never above 100 %.
//!
//! Invariant: rate times planned override is the requested override, or less. Neither side waits for the other, and
//! nothing is allocated on the motion path after the start.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, TrySendError, sync_channel};

use retrace_core::{Rate, RecordIndex};
use retrace_motion::MAX_OVERRIDE;

/// Maximum override, 200 %.
pub(crate) const MAX_RATE: Rate = Rate::from_units(Rate::ONE.units() * MAX_OVERRIDE as i64);

/// Maximum number of pending changes.
const MAX_CHANGES: usize = 64;

/// Another override is to be planned from `place` on.
#[derive(Clone, Copy, Debug)]
struct OverrideChange {
    place: RecordIndex,
    planned: Rate,
}

/// Creates the motion path's and the planning thread's end of the queue. `look_ahead` is that of the ring, in records.
#[must_use]
pub(crate) fn override_channel(look_ahead: u32) -> (OverrideRequester, OverrideApplier) {
    let (changes, heard) = sync_channel(MAX_CHANGES);
    let pending = VecDeque::with_capacity(MAX_CHANGES + 1);
    let requester = OverrideRequester {
        changes: Some(changes),
        look_ahead,
        requested: Rate::ONE,
        sent: Rate::ONE,
        planned: Rate::ONE,
        pending,
    };
    (requester, OverrideApplier { replayed: VecDeque::new(), heard: Some(heard), next: None })
}

/// The queue of override changes is full.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OverrideQueueFull;

impl std::fmt::Display for OverrideQueueFull {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("too many override changes are pending")
    }
}

impl std::error::Error for OverrideQueueFull {}

/// The motion path's end.
#[derive(Debug)]
pub struct OverrideRequester {
    /// `None` where overrides are not planned: the maximum is 100 % then.
    changes: Option<SyncSender<OverrideChange>>,
    look_ahead: u32,
    /// Override that the operator requests.
    requested: Rate,
    /// Override that was requested from the planner last.
    sent: Rate,
    /// Override that is planned at the furthest place of the cursor.
    planned: Rate,
    /// Changes that the cursor has not reached yet.
    pending: VecDeque<OverrideChange>,
}

impl Default for OverrideRequester {
    fn default() -> Self {
        let (asked, sent, planned) = (Rate::ONE, Rate::ONE, Rate::ONE);
        Self { changes: None, look_ahead: 0, requested: asked, sent, planned, pending: VecDeque::new() }
    }
}

impl OverrideRequester {
    /// Restores the state of a resumed job; `changed` are the changes that were applied already, by their places. The
    /// last planned override is the requested one.
    #[must_use]
    pub fn resumed(mut self, changed: &[(RecordIndex, Rate)], reached: RecordIndex) -> Self {
        for &(place, planned) in changed {
            (self.requested, self.sent) = (planned, planned);
            self.pending.push_back(OverrideChange { place, planned });
        }
        self.advance_to(reached);
        self
    }

    /// Override that the operator requests.
    #[must_use]
    pub fn requested(&self) -> Rate {
        self.requested
    }

    /// Maximum override.
    #[must_use]
    pub fn max_override(&self) -> Rate {
        if self.changes.is_some() { MAX_RATE } else { Rate::ONE }
    }

    /// Requests `rate`, limited to [`OverrideRequester::max_override`]; `reached` is the furthest place of the cursor.
    ///
    /// # Errors
    /// [`OverrideQueueFull`]; nothing has changed then.
    pub fn request(&mut self, rate: Rate, reached: RecordIndex) -> Result<(), OverrideQueueFull> {
        let rate = rate.clamp(Rate::ZERO, self.max_override());
        let planned = rate.max(Rate::ONE);
        if planned != self.sent
            && let Some(changes) = &self.changes
        {
            // The ring has space up to this place.
            let change = OverrideChange { place: (reached + self.look_ahead), planned };
            if self.pending.len() > MAX_CHANGES {
                return Err(OverrideQueueFull);
            }
            match changes.try_send(change) {
                Ok(()) => self.pending.push_back(change),
                Err(TrySendError::Full(_)) => return Err(OverrideQueueFull),
                // Everything is planned, and the end is before that place.
                Err(TrySendError::Disconnected(_)) => {}
            }
            self.sent = planned;
        }
        self.requested = rate;
        Ok(())
    }

    /// Advances to `reached`. Returns the override that is planned there, if it has changed.
    pub fn advance_to(&mut self, reached: RecordIndex) -> Option<Rate> {
        let was = self.planned;
        while let Some(change) = self.pending.front()
            && !reached.is_before(change.place)
        {
            self.planned = change.planned;
            self.pending.pop_front();
        }
        (self.planned != was).then_some(self.planned)
    }

    /// The rate that gives the requested override, or the nearest one that is possible, 0 … 1.
    #[must_use]
    pub fn rate(&self) -> Rate {
        if self.requested >= self.planned {
            return Rate::ONE;
        }
        let rate =
            i128::from(self.requested.units()) * i128::from(Rate::ONE.units()) / i128::from(self.planned.units());
        // Below 1, as the requested override is below the planned one.
        Rate::from_units(rate as i64)
    }
}

/// The planning thread's end.
#[derive(Debug, Default)]
pub struct OverrideApplier {
    /// Changes that were applied already when the job ran before, by their places.
    replayed: VecDeque<OverrideChange>,
    heard: Option<Receiver<OverrideChange>>,
    /// The next change, which is not due yet.
    next: Option<OverrideChange>,
}

impl OverrideApplier {
    /// Restores the state of a resumed job: changes that were applied already, place and override, in order.
    #[must_use]
    pub fn resumed(self, changed: &[(RecordIndex, Rate)]) -> Self {
        Self { replayed: changed.iter().map(|&(place, planned)| OverrideChange { place, planned }).collect(), ..self }
    }

    /// The override that counts from the record at `place` on, where it changes there. To be called for the records in
    /// order, and only where the ring has space for them.
    pub fn due_at(&mut self, place: RecordIndex) -> Option<Rate> {
        let mut due = None;
        loop {
            if self.next.is_none() {
                self.next = self.replayed.pop_front();
            }
            if self.next.is_none() {
                self.next = match self.heard.as_ref()?.try_recv() {
                    Ok(change) => Some(change),
                    Err(TryRecvError::Empty | TryRecvError::Disconnected) => return due,
                };
            }
            let Some(next) = self.next.take_if(|next| !place.is_before(next.place)) else { return due };
            due = Some(next.planned);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERCENT: Rate = Rate::from_units(Rate::ONE.units() / 100);

    #[test]
    fn what_is_more_than_planned_waits_for_its_place_and_what_is_less_does_not() {
        let (mut requester, mut heeding) = override_channel(500);
        requester.request(PERCENT * 60, RecordIndex::new(7)).expect("room");
        assert_eq!((requester.rate(), heeding.due_at(RecordIndex::new(600))), (PERCENT * 60, None));
        requester.request(MAX_RATE + Rate::ONE, RecordIndex::new(10)).expect("room");
        assert_eq!(
            (
                requester.rate(),
                heeding.due_at(RecordIndex::new(509)),
                heeding.due_at(RecordIndex::new(510)),
                heeding.due_at(RecordIndex::new(511))
            ),
            (Rate::ONE, None, Some(MAX_RATE), None)
        );
        assert_eq!(
            (
                requester.advance_to(RecordIndex::new(509)),
                requester.advance_to(RecordIndex::new(510)),
                requester.advance_to(RecordIndex::new(511))
            ),
            (None, Some(MAX_RATE), None)
        );
        // Half of what is planned for 200 %, until it is planned for 100 %.
        requester.request(Rate::ONE, RecordIndex::new(600)).expect("room");
        assert_eq!(
            (requester.rate(), heeding.due_at(RecordIndex::new(1099)), heeding.due_at(RecordIndex::new(1100))),
            (Rate::ONE / 2, None, Some(Rate::ONE))
        );
        assert_eq!((requester.advance_to(RecordIndex::new(1100)), requester.rate()), (Some(Rate::ONE), Rate::ONE));
    }

    #[test]
    fn too_many_changes_are_refused_and_none_is_lost() {
        let (mut requester, mut heeding) = override_channel(10);
        let asked = |k: i64| Rate::ONE + PERCENT * (k + 1);
        let taken = (0..).take_while(|k| requester.request(asked(*k), RecordIndex::new(u32::MAX)).is_ok()).count();
        assert_eq!(taken, MAX_CHANGES);
        let last = asked(MAX_CHANGES as i64 - 1);
        assert_eq!((heeding.due_at(RecordIndex::new(8)), heeding.due_at(RecordIndex::new(9))), (None, Some(last)));
        assert_eq!(requester.advance_to(RecordIndex::new(9)), Some(last));
        requester.request(Rate::ONE, RecordIndex::new(20)).expect("room again");
    }

    #[test]
    fn what_was_heeded_once_is_heeded_again_at_its_place_and_what_is_new_behind_it() {
        let (requester, heeding) = override_channel(500);
        let changed = [(RecordIndex::new(100), MAX_RATE), (RecordIndex::new(300), Rate::ONE + PERCENT)];
        let (mut requester, mut heeding) =
            (requester.resumed(&changed, RecordIndex::new(200)), heeding.resumed(&changed));
        assert_eq!((requester.requested(), requester.rate()), (Rate::ONE + PERCENT, (Rate::ONE + PERCENT) / 2));
        requester.request(Rate::ONE, RecordIndex::new(250)).expect("room");
        assert_eq!(
            [99, 100, 299, 300, 749, 750].map(|place| heeding.due_at(RecordIndex::new(place))),
            [None, Some(MAX_RATE), None, Some(Rate::ONE + PERCENT), None, Some(Rate::ONE)]
        );
        assert_eq!(
            (requester.advance_to(RecordIndex::new(300)), requester.advance_to(RecordIndex::new(750))),
            (Some(Rate::ONE + PERCENT), Some(Rate::ONE))
        );
    }

    #[test]
    fn where_nobody_plans_the_rate_is_all_there_is() {
        let mut requester = OverrideRequester::default();
        requester.request(MAX_RATE, RecordIndex::new(0)).expect("nothing is sent");
        assert_eq!(
            (requester.rate(), requester.advance_to(RecordIndex::new(1000)), requester.max_override()),
            (Rate::ONE, None, Rate::ONE)
        );
        assert_eq!(OverrideApplier::default().due_at(RecordIndex::new(0)), None);
    }
}
