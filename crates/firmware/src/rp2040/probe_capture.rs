//! The moment at which the probe's level changed, from the count of a state machine ([`super::pio_programs`]).
//!
//! Invariant: a level that was captured is reported together with its moment; the processor, which reads the level a
//! little after the control period has begun, never reports it a period too early.

use retrace_card::{AwaitedProbe, ProbeReading};

/// Cycles from the edge to the count, besides two for each count: `mov`, and the loop is left in its second half or its
/// first.
const CYCLES_OF_CAPTURE: u32 = 2;

/// What is read of the probe at the beginning of a control period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CaptureReading {
    /// Counts from the first edge in the last period to the beginning of this one, if there was an edge.
    pub counts: Option<u32>,
    /// Cycles of the last period.
    pub period: u32,
    /// Whether the last period was longer than that: its end is not the beginning of this one.
    pub is_late: bool,
}

/// The probe whose edge is captured.
#[derive(Clone, Copy, Debug, Default)]
pub struct ProbeCapture {
    awaited: Option<AwaitedProbe>,
    /// Whether the level was seen without a count: it changed since this period has begun, and its count comes with the
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

    /// Returns the levels of the inputs, and what was read of the probe.
    pub fn read(&mut self, levels: u16, reading: CaptureReading) -> (u16, ProbeReading) {
        let mut probe = ProbeReading { first_change: None, is_period_behind: true };
        let Some(AwaitedProbe { input, is_high }) = self.awaited else { return (levels, probe) };
        let bit = 1 << (input & 15);
        if let Some(counts) = reading.counts {
            self.is_held_back = false;
            probe.first_change = part_of(counts, &reading);
            return (levels, probe);
        }
        let has_level = (levels & bit != 0) == is_high;
        let is_held_back = has_level && !self.is_held_back;
        self.is_held_back = has_level;
        (if is_held_back { levels ^ bit } else { levels }, probe)
    }
}

/// Returns the part of the last period in which the edge was, in units of 2⁻¹⁶. A period that was longer than planned
/// has an edge at its end.
fn part_of(counts: u32, reading: &CaptureReading) -> Option<u16> {
    let period = reading.period.max(1);
    let until_end = counts.saturating_mul(2).saturating_add(CYCLES_OF_CAPTURE).min(period);
    let part = (u64::from(period - until_end) << 16) / u64::from(period);
    (!reading.is_late).then(|| part.min(u64::from(u16::MAX)) as u16)
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

    fn reading(counts: Option<u32>) -> CaptureReading {
        CaptureReading { counts, period: 125_000, is_late: false }
    }

    #[test]
    fn an_edge_is_in_the_part_of_its_period() {
        for (counts, part) in [(0, 65_534), (31_249, 32_768), (62_499, 0), (u32::MAX, 0)] {
            let (levels, probe) = capture().read(TOUCHED, reading(Some(counts)));
            assert_eq!((levels, probe.first_change, probe.is_period_behind), (TOUCHED, Some(part), true), "{counts}");
        }
        let late = CaptureReading { is_late: true, ..reading(Some(5)) };
        assert_eq!(capture().read(TOUCHED, late).1.first_change, None, "at the end of a late period");
    }

    /// The level is read after the period has begun: an edge between them belongs to that period.
    #[test]
    fn a_level_without_its_count_waits_for_it() {
        let mut capture = capture();
        assert_eq!(capture.read(TOUCHED, reading(None)).0, OPEN);
        assert_eq!(
            capture.read(TOUCHED, reading(Some(62_000))),
            (TOUCHED, ProbeReading { first_change: Some(523), is_period_behind: true })
        );
    }

    /// One that was there when the capture began has no edge.
    #[test]
    fn a_level_that_was_there_before_is_reported_a_period_later() {
        let mut capture = capture();
        let levels = [0, 1, 2].map(|_| capture.read(TOUCHED, reading(None)).0);
        assert_eq!(levels, [OPEN, TOUCHED, TOUCHED]);
        assert_eq!(capture.read(OPEN, reading(None)).0, OPEN);
        assert_eq!(capture.read(TOUCHED, reading(None)).0, OPEN, "a new edge");
    }

    #[test]
    fn without_a_probe_the_levels_are_those_of_the_pins() {
        let mut capture = ProbeCapture::new();
        assert_eq!(capture.read(0x2a, reading(None)).0, 0x2a);
    }
}
