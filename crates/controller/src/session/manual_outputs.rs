//! Outputs that were switched manually and that the card has not reported yet.
//!
//! Invariant: a comparison of outputs includes a manual change from the moment at which it is sent, so that no report
//! in flight can hide it: the card may be many periods ahead of the last report.

use retrace_link::{CardStatus, HostCommand, MotionCard, OutputChange, Outputs, channel};

use super::Session;
use super::height_by_hand::without_height_control;

/// Changes that were sent and not reported yet, at most one per channel.
#[derive(Debug)]
pub(super) struct ManualOutputs(Vec<OutputChange>);

impl ManualOutputs {
    /// Creates an empty list.
    pub(super) fn new() -> Self {
        Self(Vec::with_capacity(channel::COUNT))
    }

    fn record_sent(&mut self, change: OutputChange) {
        self.0.retain(|other| other.channel != change.channel);
        self.0.push(change);
    }

    /// Whether a change was sent and is not reported yet.
    pub(super) fn has_unreported(&self) -> bool {
        !self.0.is_empty()
    }

    /// Removes the changes that are reported.
    fn remove_reported(&mut self, outputs: &Outputs) {
        self.0.retain(|change| outputs.get(usize::from(change.channel)) != Some(&change.value));
    }

    /// Removes the changes of a channel that was switched again since.
    pub(super) fn remove_channel(&mut self, channel: u8) {
        self.0.retain(|change| change.channel != channel);
    }

    /// The reported outputs, except where a change in flight makes one differ from `wants`: there, the value of the
    /// change.
    fn compared_with(&self, reported: &Outputs, wants: &Outputs) -> Outputs {
        let mut outputs = *reported;
        for &OutputChange { channel, value } in &self.0 {
            let at = usize::from(channel);
            if let (Some(is), Some(&want)) = (outputs.get_mut(at), wants.get(at))
                && *is == want
            {
                *is = value;
            }
        }
        outputs
    }
}

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Switches an output manually. Returns false where the card has no such output.
    pub(super) fn send_manual_output(&mut self, change: OutputChange) -> bool {
        let sent = self.card.send(HostCommand::ManualOutput(change)).is_ok();
        if sent {
            self.manual_outputs.record_sent(change);
        }
        sent
    }

    /// The outputs as they are to be compared with `wants`.
    pub(super) fn outputs_compared_with(&self, wants: &Outputs) -> Outputs {
        let outputs = self.manual_outputs.compared_with(&self.card.status().outputs, wants);
        let outputs = self.without_geared_spindle(outputs, wants);
        let outputs = self.without_speed_override(outputs, wants);
        without_height_control(outputs, wants, self.recovery.machine().height_control())
    }

    /// Removes the changes that this status reports.
    pub(super) fn update_manual_outputs(&mut self, status: &CardStatus<A>) {
        self.manual_outputs.remove_reported(&status.outputs);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_counts_until_it_is_reported_and_never_hides_a_difference() {
        let (mut changes, mut wants) = (ManualOutputs::new(), [0; channel::COUNT]);
        let change = |channel, value| OutputChange { channel, value };
        wants[3] = 1;
        let (on, off) = (wants, [0; channel::COUNT]);
        changes.record_sent(change(3, 0));
        assert_eq!(changes.compared_with(&on, &wants), off);
        changes.remove_reported(&on);
        assert_eq!(changes.compared_with(&on, &wants), off);
        changes.remove_reported(&off);
        assert_eq!(changes.compared_with(&on, &wants), on);
        // a change that the card may reject does not count as done
        changes.record_sent(change(3, 1));
        assert_eq!(changes.compared_with(&off, &wants), off);
        changes.record_sent(change(3, 0));
        changes.remove_channel(3);
        assert_eq!(changes.compared_with(&on, &wants), on);
    }
}
