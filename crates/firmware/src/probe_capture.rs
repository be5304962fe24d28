//! The captured edge of the probe and the probe's level, as a board reports both to the card.
//!
//! Invariant: a level that was captured is reported together with its moment; the processor, which reads the level a
//! little after the control period has begun, never reports it a period too early.

use retrace_card::{AwaitedProbe, ProbeReading};

/// The probe whose edge is captured.
#[derive(Clone, Copy, Debug, Default)]
pub struct ProbeCapture {
    awaited: Option<AwaitedProbe>,
    /// Whether the level was seen without an edge: it changed since this period has begun, and its edge comes with the
    /// next one, or it was there before.
    is_held_back: bool,
}

impl ProbeCapture {
    /// Creates a capture of nothing.
    #[must_use]
    pub const fn new() -> Self {
        Self { awaited: None, is_held_back: false }
    }

    /// Returns the probe that is awaited.
    #[must_use]
    pub const fn awaited(&self) -> Option<AwaitedProbe> {
        self.awaited
    }

    /// Awaits this edge from now on.
    pub const fn begin(&mut self, awaited: Option<AwaitedProbe>) {
        *self = Self { awaited, is_held_back: false };
    }

    /// Returns the levels of the inputs, and what was read of the probe. `edge`: the part of the last period, in units
    /// of 2⁻¹⁶, in which the first edge was, if there was one.
    pub fn read(&mut self, levels: u16, edge: Option<u16>) -> (u16, ProbeReading) {
        let probe = ProbeReading { first_change: None, is_period_behind: true };
        let Some(AwaitedProbe { input, is_high }) = self.awaited else { return (levels, probe) };
        let bit = 1 << (input & 15);
        if edge.is_some() {
            self.is_held_back = false;
            return (levels, ProbeReading { first_change: edge, ..probe });
        }
        let has_level = (levels & bit != 0) == is_high;
        let is_held_back = has_level && !self.is_held_back;
        self.is_held_back = has_level;
        (if is_held_back { levels ^ bit } else { levels }, probe)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AWAITED: AwaitedProbe = AwaitedProbe { input: 3, is_high: false };
    const TOUCHED: u16 = 0;
    const OPEN: u16 = 1 << 3;

    fn capture() -> ProbeCapture {
        let mut capture = ProbeCapture::new();
        capture.begin(Some(AWAITED));
        capture
    }

    /// The level is read after the period has begun: an edge between them belongs to that period.
    #[test]
    fn a_level_without_its_edge_waits_for_it() {
        let mut capture = capture();
        assert_eq!(capture.read(TOUCHED, None).0, OPEN);
        let reading = ProbeReading { first_change: Some(523), is_period_behind: true };
        assert_eq!(capture.read(TOUCHED, Some(523)), (TOUCHED, reading));
    }

    /// One that was there when the capture began has no edge.
    #[test]
    fn a_level_that_was_there_before_is_reported_a_period_later() {
        let mut capture = capture();
        let levels = [0, 1, 2].map(|_| capture.read(TOUCHED, None).0);
        assert_eq!(levels, [OPEN, TOUCHED, TOUCHED]);
        assert_eq!(capture.read(OPEN, None).0, OPEN);
        assert_eq!(capture.read(TOUCHED, None).0, OPEN, "a new edge");
    }

    #[test]
    fn without_a_probe_the_levels_are_those_of_the_pins() {
        assert_eq!(ProbeCapture::new().read(0x2a, None).0, 0x2a);
    }
}
