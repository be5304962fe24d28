//! Outputs that were switched by hand and that the card has not reported yet.
//!
//! Invariant: a comparison of outputs counts a change by hand from the moment at which it is sent, so that no report that is on its way can
//! hide it: the card may be many periods ahead of what is known of it.

use retrace_link::{CardStatus, HostCommand, MotionCard, OutputChange, Outputs, channel};

use super::Session;

/// Changes that were sent and not reported yet, at most one of each channel.
#[derive(Debug)]
pub(super) struct ManualOutputs(Vec<OutputChange>);

impl ManualOutputs {
    /// None.
    pub(super) fn new() -> Self {
        Self(Vec::with_capacity(channel::COUNT))
    }

    fn sent(&mut self, change: OutputChange) {
        self.0.retain(|other| other.channel != change.channel);
        self.0.push(change);
    }

    /// Drops those that are reported.
    fn reported(&mut self, outputs: &Outputs) {
        self.0.retain(|change| outputs.get(usize::from(change.channel)) != Some(&change.value));
    }

    /// Drops those of a channel that was switched again since.
    pub(super) fn superseded(&mut self, channel: u8) {
        self.0.retain(|change| change.channel != channel);
    }

    /// The outputs that are reported, but where a change on its way brings one off what is wanted: the value that it brings.
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
    /// Switches an output by hand; false where the card has no such output.
    pub(super) fn send_by_hand(&mut self, change: OutputChange) -> bool {
        let sent = self.card.send(HostCommand::ManualOutput(change)).is_ok();
        if sent {
            self.by_hand.sent(change);
        }
        sent
    }

    /// The outputs as they are to be compared with these.
    pub(super) fn outputs_compared_with(&self, wants: &Outputs) -> Outputs {
        self.by_hand.compared_with(&self.card.status().outputs, wants)
    }

    /// A control period was reported.
    pub(super) fn follow_by_hand(&mut self, status: &CardStatus<A>) {
        self.by_hand.reported(&status.outputs);
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
        changes.sent(change(3, 0));
        assert_eq!(changes.compared_with(&on, &wants), off);
        changes.reported(&on);
        assert_eq!(changes.compared_with(&on, &wants), off);
        changes.reported(&off);
        assert_eq!(changes.compared_with(&on, &wants), on);
        // what the card may refuse is not taken for done
        changes.sent(change(3, 1));
        assert_eq!(changes.compared_with(&off, &wants), off);
        changes.sent(change(3, 0));
        changes.superseded(3);
        assert_eq!(changes.compared_with(&on, &wants), on);
    }
}
