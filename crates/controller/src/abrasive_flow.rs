//! Time and mass of the abrasive that a program uses, from its plan (CUT-60).
//!
//! Invariant: abrasive is counted in the control periods in which a run at 100 % has its output on. What is switched in
//! passing counts from the first record of the move behind it.

use std::collections::{BTreeMap, VecDeque};

/// Flow of all abrasives that are on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Flow {
    /// Number of outputs that are on.
    outputs: usize,
    /// Flow of those whose flow is known, g/min.
    g_per_min: f64,
    /// Whether the flow of one of them is not known.
    has_unknown: bool,
}

/// Abrasive of a program.
#[derive(Clone, Debug, Default)]
pub struct AbrasiveFlow {
    /// Outputs that are on behind the last move, each with its flow in g/min where it is known.
    open: BTreeMap<u8, Option<f64>>,
    /// Flows that begin with a move whose records are not counted yet, each with the serial number of the move.
    waiting: VecDeque<(u32, Flow)>,
    /// Flow in the record that was counted last.
    flow: Flow,
    /// Control periods with an abrasive on.
    periods: u64,
    /// Sum of the known flows over these periods, g/min.
    g_per_min_periods: f64,
    /// Whether a flow was not known.
    has_unknown: bool,
}

impl AbrasiveFlow {
    /// The program switches the abrasive of this output, with this flow in g/min, before the move with this serial
    /// number.
    pub(crate) fn switch(&mut self, channel: u8, is_on: bool, g_per_min: Option<f64>, serial: u32) {
        if is_on {
            self.open.insert(channel, g_per_min);
        } else {
            self.open.remove(&channel);
        }
        let flow = Flow {
            outputs: self.open.len(),
            g_per_min: self.open.values().flatten().sum(),
            has_unknown: self.open.values().any(Option::is_none),
        };
        self.waiting.push_back((serial, flow));
    }

    /// Whether nothing is on, nor will be with a move whose records are not counted: records need not be counted.
    pub(crate) fn is_off(&self) -> bool {
        self.flow.outputs == 0 && self.waiting.is_empty()
    }

    /// Counts a record of the move with this serial number.
    pub(crate) fn count_record(&mut self, serial: u32) {
        // A move may leave no record. Serial numbers wrap around.
        while let Some(&(from, flow)) = self.waiting.front()
            && serial.wrapping_sub(from) < 1 << 31
        {
            self.flow = flow;
            self.waiting.pop_front();
        }
        self.count(1);
    }

    /// Counts control periods at rest: every record so far is counted.
    pub(crate) fn count_rest(&mut self, periods: u64) {
        if let Some((_, flow)) = self.waiting.drain(..).next_back() {
            self.flow = flow;
        }
        self.count(periods);
    }

    fn count(&mut self, periods: u64) {
        if self.flow.outputs > 0 && periods > 0 {
            self.periods += periods;
            self.g_per_min_periods += self.flow.g_per_min * periods as f64;
            self.has_unknown |= self.flow.has_unknown;
        }
    }

    /// Control periods with an abrasive on.
    #[must_use]
    pub fn periods(&self) -> u64 {
        self.periods
    }

    /// Mass in kg of the abrasive whose flow is known, at this control period in s.
    #[must_use]
    pub fn known_kg(&self, period_s: f64) -> f64 {
        self.g_per_min_periods * period_s / 60.0 / 1000.0
    }

    /// Whether there is abrasive whose flow neither the material nor the cutter states.
    #[must_use]
    pub fn has_unknown(&self) -> bool {
        self.has_unknown
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn abrasive_counts_while_its_output_is_on() {
        let mut flow = AbrasiveFlow::default();
        flow.count_rest(7);
        flow.switch(4, true, Some(300.0), 1);
        flow.count_rest(500);
        (0..100).for_each(|_| flow.count_record(1));
        // Off in passing, behind a move whose records are counted later.
        flow.switch(4, false, None, 3);
        (0..400).for_each(|_| flow.count_record(2));
        (0..50).for_each(|_| flow.count_record(4));
        flow.count_rest(300);
        assert_eq!(flow.periods(), 1000);
        assert!((flow.known_kg(0.001) - 0.005).abs() < 1e-12 && !flow.has_unknown());
    }

    #[test]
    fn flows_of_two_outputs_add_up_and_an_unknown_one_is_not_zero() {
        let mut flow = AbrasiveFlow::default();
        flow.switch(4, true, Some(300.0), u32::MAX);
        flow.switch(5, true, Some(200.0), 0);
        flow.count_record(u32::MAX);
        assert!((flow.known_kg(60.0) - 0.3).abs() < 1e-12);
        flow.count_record(0);
        assert!((flow.known_kg(60.0) - 0.8).abs() < 1e-12);
        flow.switch(5, true, None, 1);
        assert!(!flow.has_unknown(), "nothing has flowed at an unknown rate yet");
        flow.count_rest(1);
        assert!(flow.has_unknown() && flow.periods() == 3);
        assert!((flow.known_kg(60.0) - 1.1).abs() < 1e-12);
    }
}
