//! Synchronous actions that wait for their place, before a move or within it (SPN-9).
//!
//! Invariant: they change neither the path of a move nor its plan. An action within a move has a serial number of its
//! own behind that of the move, by which the record is found before which it is executed.

use retrace_core::place::number_is_before;
use retrace_link::{OutputAction, OutputChange, channel};
use retrace_motion::MoveMark;

use super::tool_lengths::Planned;
use super::{Cancelled, PlanWriter, SerialOrigin, WaitingChange};
use crate::plan_item::PathItem;

/// Actions within the next move: the share of its length, the change and the program line, in order.
#[derive(Debug, Default)]
pub(super) struct InnerActions(Vec<(f64, OutputChange, u32)>);

impl InnerActions {
    /// Marks for the planner, in a move with this serial number.
    pub(super) fn marks(&self, serial: u32) -> Vec<MoveMark> {
        let tags = (1..).map(|number| serial.wrapping_add(number));
        self.0.iter().zip(tags).map(|(&(share, ..), tag)| MoveMark { share, tag }).collect()
    }
}

impl<const A: usize> PlanWriter<'_, A> {
    /// Adds a synchronous action: executed without a stop, where the next move begins.
    pub fn action(&mut self, change: OutputChange, line: u32) {
        self.add_change(change, line, false);
    }

    /// Adds a synchronous action that reverse run leaves unchanged.
    pub fn lasting_action(&mut self, change: OutputChange, line: u32) {
        self.add_change(change, line, true);
    }

    fn add_change(&mut self, change: OutputChange, line: u32, lasts: bool) {
        if !self.inhibited.contains(&change.channel) {
            self.waiting_changes.push_back(WaitingChange {
                serial: self.serial.wrapping_add(1),
                change,
                line,
                unchanged_in_reverse: lasts,
            });
        }
    }

    /// Adds a synchronous action within the next move, at this share of its length: 0 … 1, ascending.
    pub fn action_within(&mut self, share: f64, change: OutputChange, line: u32) {
        if !self.inhibited.contains(&change.channel) {
            self.inner_actions.0.push((share, change, line));
        }
    }

    /// Gives the actions within the last move their serial numbers. That of the last one is then the number of the
    /// last move.
    pub(super) fn record_inner_actions(&mut self, inner: &InnerActions) {
        let (serial, origin) = (self.serial, self.origins.back().copied());
        for &(_, change, line) in &inner.0 {
            self.serial = self.serial.wrapping_add(1);
            let action = WaitingChange { serial: self.serial, change, line, unchanged_in_reverse: false };
            self.waiting_changes.push_back(action);
            self.origins.extend(origin.map(|origin| SerialOrigin { serial: self.serial, ..origin }));
        }
        // What waits for the end of the move waits for its last part.
        if let Some(Planned::Waiting { serial: end }) = &mut self.lengths.last_end
            && *end == serial
        {
            *end = self.serial;
        }
    }

    /// Sends the actions before the move with that serial number, or before one that left no record.
    pub(super) fn send_actions(&mut self, serial: u32) -> Result<(), Cancelled> {
        while let Some(WaitingChange { serial: of, change, line, unchanged_in_reverse: lasts }) =
            self.waiting_changes.front().copied()
            && !number_is_before(serial, of)
        {
            self.waiting_changes.pop_front();
            if change.channel == channel::SPEED && self.is_replaced(serial, change.channel) {
                continue;
            }
            let value = &mut self.outputs[usize::from(change.channel)];
            let (place, channel) = (self.ring.write(), change.channel);
            let before = if lasts { change.value } else { *value };
            let action = OutputAction { place, channel, before, after: change.value };
            *value = change.value;
            self.send(PathItem::Action(action, line))?;
        }
        Ok(())
    }

    /// Whether another change of this channel waits for the same place as the one before it: the record with this
    /// serial number.
    fn is_replaced(&self, serial: u32, channel: u8) -> bool {
        self.waiting_changes
            .front()
            .is_some_and(|next| next.change.channel == channel && !number_is_before(serial, next.serial))
    }
}
