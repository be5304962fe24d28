//! Room for actions on the card, which holds fewer of them than its window can have: under G96 a record in ten has one
//! (SPN-9).
//!
//! Invariant: an action is sent only where the card has room for it. What the card drops for it is sent again where the
//! cursor comes back.

use retrace_link::{HostCommand, MotionCard};

use super::RecordStreamer;

/// Number of actions in its window that every card can hold.
const CARD_ACTIONS: usize = 256;
/// Number of actions for which room is made at once.
const MADE_AT_ONCE: usize = 64;

impl<const A: usize> RecordStreamer<'_, A> {
    /// Sends an action of a record ahead, by its index. False where it has to wait.
    pub(super) fn send_action_ahead<C: MotionCard<A>>(&self, card: &mut C, action: usize) -> bool {
        let (next, _) = &self.actions[action];
        self.is_dark(next)
            || self.make_room_ahead(card, action) && card.send(HostCommand::Action(self.as_sent(next))).is_ok()
    }

    /// Sends an action of a record behind, by its index. False where it has to wait.
    pub(super) fn send_action_behind<C: MotionCard<A>>(&self, card: &mut C, action: usize) -> bool {
        let (next, _) = &self.actions[action];
        self.is_dark(next)
            || self.make_room_behind(card, action) && card.send(HostCommand::Action(self.as_sent(next))).is_ok()
    }

    /// Makes room for an action ahead, by its index: the card forgets records far behind the cursor. False where that
    /// has to wait for the cursor.
    fn make_room_ahead<C: MotionCard<A>>(&self, card: &mut C, action: usize) -> bool {
        let low = card.status().low;
        let first = self.actions.partition_point(|(action, _)| action.place.is_before(low));
        if action < first + CARD_ACTIONS {
            return true;
        }
        [MADE_AT_ONCE, 1].into_iter().any(|made| {
            let low = self.actions[action + made - CARD_ACTIONS - 1].0.place + 1;
            card.send(HostCommand::Forget { low }).is_ok()
        })
    }

    /// Makes room for an action behind, by its index: the card drops records far ahead of the cursor. False where that
    /// has to wait for the cursor.
    fn make_room_behind<C: MotionCard<A>>(&self, card: &mut C, action: usize) -> bool {
        let high = card.status().high;
        let end = self.actions.partition_point(|(action, _)| !high.is_before(action.place));
        if end <= action + CARD_ACTIONS {
            return true;
        }
        [MADE_AT_ONCE, 1].into_iter().any(|made| {
            // An action at the end of the window is in it.
            let high = self.actions[action + CARD_ACTIONS + 1 - made].0.place - 1;
            card.send(HostCommand::Trim { high }).is_ok()
        })
    }
}
