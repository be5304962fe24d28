//! The feed override: which part of it the rate does, which part the plan, and where.
//!
//! Up to 100 % the rate does it, within a period. More is planned: the motion path asks the planning thread for it, from the first
//! place on that cannot be written yet whatever the planner has done by now. So the override acts within the look-ahead of
//! the ring, and at a place that does not depend on how fast the planner is: a run can still be repeated to the pulse.
//! Until the cursor comes there the rate makes up for what is planned, as far as it can: it never is above 100 %.
//!
//! Invariant: rate times planned override is the override that was asked for, or less. Neither side waits for the other, and
//! nothing is allocated on the motion path after the start.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, TrySendError, sync_channel};

use retrace_core::place::is_before;
use retrace_core::{ONE, Travel};
use retrace_motion::MAX_OVERRIDE;

/// The most that can be asked for, 200 %.
pub const MOST: Travel = (MAX_OVERRIDE as Travel) * ONE;

/// So many changes may be on their way at a time.
const CHANGES: usize = 64;

/// From `place` on, the plan is to use another override.
#[derive(Clone, Copy, Debug)]
struct OverrideChange {
    place: u32,
    planned: Travel,
}

/// The two ends of the way from the motion path to the planning thread; `look_ahead` is that of the ring, in records.
#[must_use]
pub fn overrides(look_ahead: u32) -> (OverrideRequester, OverrideApplier) {
    let (changes, heard) = sync_channel(CHANGES);
    let pending = VecDeque::with_capacity(CHANGES + 1);
    let asking = OverrideRequester { changes: Some(changes), look_ahead, asked: ONE, sent: ONE, planned: ONE, pending };
    (asking, OverrideApplier { again: VecDeque::new(), heard: Some(heard), next: None })
}

/// More changes are on their way than there is room for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OverrideQueueFull;

/// The motion path's end.
#[derive(Debug)]
pub struct OverrideRequester {
    /// `None` where nobody plans: 100 % is the most then.
    changes: Option<SyncSender<OverrideChange>>,
    look_ahead: u32,
    /// What the operator asks for.
    asked: Travel,
    /// What was asked of the planner last.
    sent: Travel,
    /// What is planned where the cursor is furthest.
    planned: Travel,
    /// Changes that the cursor has yet to reach.
    pending: VecDeque<OverrideChange>,
}

impl Default for OverrideRequester {
    fn default() -> Self {
        let (asked, sent, planned) = (ONE, ONE, ONE);
        Self { changes: None, look_ahead: 0, asked, sent, planned, pending: VecDeque::new() }
    }
}

impl OverrideRequester {
    /// The same for a job that is taken up in its middle, `changed` being the changes that were heeded already, by their places. The
    /// operator asks for what is planned last.
    #[must_use]
    pub fn again(mut self, changed: &[(u32, Travel)], reached: u32) -> Self {
        for &(place, planned) in changed {
            (self.asked, self.sent) = (planned, planned);
            self.pending.push_back(OverrideChange { place, planned });
        }
        self.pass(reached);
        self
    }

    /// What the operator asks for.
    #[must_use]
    pub fn asked(&self) -> Travel {
        self.asked
    }

    /// The most that can be asked for.
    #[must_use]
    pub fn most(&self) -> Travel {
        if self.changes.is_some() { MOST } else { ONE }
    }

    /// The operator asks for `rate`, which counts as [`Asking::most`] where it is more; the cursor is at `reached` at the furthest.
    ///
    /// # Errors
    /// [`TooMany`]; nothing has changed then.
    pub fn request(&mut self, rate: Travel, reached: u32) -> Result<(), OverrideQueueFull> {
        let rate = rate.clamp(0, self.most());
        let planned = rate.max(ONE);
        if planned != self.sent
            && let Some(changes) = &self.changes
        {
            // The ring has room up to this place.
            let change = OverrideChange { place: reached.wrapping_add(self.look_ahead), planned };
            if self.pending.len() > CHANGES {
                return Err(OverrideQueueFull);
            }
            match changes.try_send(change) {
                Ok(()) => self.pending.push_back(change),
                Err(TrySendError::Full(_)) => return Err(OverrideQueueFull),
                // Everything is planned, and its end lies before that place.
                Err(TrySendError::Disconnected(_)) => {}
            }
            self.sent = planned;
        }
        self.asked = rate;
        Ok(())
    }

    /// The cursor has come to `reached`: what is planned there, if that has changed.
    pub fn pass(&mut self, reached: u32) -> Option<Travel> {
        let was = self.planned;
        while let Some(change) = self.pending.front()
            && !is_before(reached, change.place)
        {
            self.planned = change.planned;
            self.pending.pop_front();
        }
        (self.planned != was).then_some(self.planned)
    }

    /// The rate that comes to what is asked for, or as near as it can, 0 … 1.
    #[must_use]
    pub fn rate(&self) -> Travel {
        if self.asked >= self.planned {
            return ONE;
        }
        let rate = i128::from(self.asked) * i128::from(ONE) / i128::from(self.planned);
        // Below 1, as the override asked for is below the planned one.
        rate as Travel
    }
}

/// The planning thread's end.
#[derive(Debug, Default)]
pub struct OverrideApplier {
    /// Changes that were heeded already when the job ran before, by their places.
    again: VecDeque<OverrideChange>,
    heard: Option<Receiver<OverrideChange>>,
    /// The next change, which is not due yet.
    next: Option<OverrideChange>,
}

impl OverrideApplier {
    /// The same for a job that is taken up in its middle: changes that were heeded already, place and override, in their order.
    #[must_use]
    pub fn again(self, changed: &[(u32, Travel)]) -> Self {
        Self { again: changed.iter().map(|&(place, planned)| OverrideChange { place, planned }).collect(), ..self }
    }

    /// The override by which feeds count from the record at `place` on, where it changes there. Records are asked about in their order,
    /// and only where the ring has room for them.
    pub fn due(&mut self, place: u32) -> Option<Travel> {
        let mut due = None;
        loop {
            if self.next.is_none() {
                self.next = self.again.pop_front();
            }
            if self.next.is_none() {
                self.next = match self.heard.as_ref()?.try_recv() {
                    Ok(change) => Some(change),
                    Err(TryRecvError::Empty | TryRecvError::Disconnected) => return due,
                };
            }
            let Some(next) = self.next.take_if(|next| !is_before(place, next.place)) else { return due };
            due = Some(next.planned);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERCENT: Travel = ONE / 100;

    #[test]
    fn what_is_more_than_planned_waits_for_its_place_and_what_is_less_does_not() {
        let (mut asking, mut heeding) = overrides(500);
        asking.request(60 * PERCENT, 7).expect("room");
        assert_eq!((asking.rate(), heeding.due(600)), (60 * PERCENT, None));
        asking.request(MOST + ONE, 10).expect("room");
        assert_eq!(
            (asking.rate(), heeding.due(509), heeding.due(510), heeding.due(511)),
            (ONE, None, Some(MOST), None)
        );
        assert_eq!((asking.pass(509), asking.pass(510), asking.pass(511)), (None, Some(MOST), None));
        // Half of what is planned for 200 %, until it is planned for 100 %.
        asking.request(ONE, 600).expect("room");
        assert_eq!((asking.rate(), heeding.due(1099), heeding.due(1100)), (ONE / 2, None, Some(ONE)));
        assert_eq!((asking.pass(1100), asking.rate()), (Some(ONE), ONE));
    }

    #[test]
    fn too_many_changes_are_refused_and_none_is_lost() {
        let (mut asking, mut heeding) = overrides(10);
        let asked = |k: Travel| ONE + (k + 1) * PERCENT;
        let taken = (0..).take_while(|k| asking.request(asked(*k), u32::MAX).is_ok()).count();
        assert_eq!(taken, CHANGES);
        let last = asked(CHANGES as Travel - 1);
        assert_eq!((heeding.due(8), heeding.due(9)), (None, Some(last)));
        assert_eq!(asking.pass(9), Some(last));
        asking.request(ONE, 20).expect("room again");
    }

    #[test]
    fn what_was_heeded_once_is_heeded_again_at_its_place_and_what_is_new_behind_it() {
        let (asking, heeding) = overrides(500);
        let changed = [(100, MOST), (300, ONE + PERCENT)];
        let (mut asking, mut heeding) = (asking.again(&changed, 200), heeding.again(&changed));
        assert_eq!((asking.asked(), asking.rate()), (ONE + PERCENT, (ONE + PERCENT) / 2));
        asking.request(ONE, 250).expect("room");
        assert_eq!(
            [99, 100, 299, 300, 749, 750].map(|place| heeding.due(place)),
            [None, Some(MOST), None, Some(ONE + PERCENT), None, Some(ONE)]
        );
        assert_eq!((asking.pass(300), asking.pass(750)), (Some(ONE + PERCENT), Some(ONE)));
    }

    #[test]
    fn where_nobody_plans_the_rate_is_all_there_is() {
        let mut asking = OverrideRequester::default();
        asking.request(MOST, 0).expect("nothing is sent");
        assert_eq!((asking.rate(), asking.pass(1000), asking.most()), (ONE, None, ONE));
        assert_eq!(OverrideApplier::default().due(0), None);
    }
}
