//! The capture of the probe's edge: TIM2 keeps the count of the slots at the edge, and DMA1 fetches the first one of
//! them (RM0090, 10 and 18.3.5; RM0368, 9 and 13.3.5). No interrupt is between the edge and its slot.
//!
//! Invariant: only the main loop accesses the capture. Its pin is an input of the timer only while an edge is awaited,
//! and can be read as before. A count that was fetched stays until it was reported.

use retrace_card::{AwaitedProbe, ProbeReading};
use retrace_firmware::probe_capture::ProbeCapture;
use retrace_firmware::step_batch::StepShape;
use retrace_firmware::stm32f4::pins::{CaptureInput, capture_input};
use retrace_firmware::stm32f4::probed_periods::{MIN_CAPTURE_PERIOD_US, ProbedPeriods, has_begun};

use super::registers::{fetched_edge, start_edge_stream, stop_edge_stream, tim2};
use super::{ports, slot_counter};

/// The input of the probe.
pub(super) struct ProbeInput {
    capture: ProbeCapture,
    periods: ProbedPeriods,
    period_us: u32,
    /// What the main loop awaits, whether it can be captured or not.
    awaited: Option<AwaitedProbe>,
}

impl ProbeInput {
    /// Creates one that captures nothing.
    pub(super) const fn new() -> Self {
        let period_us = StepShape::INITIAL.period_us;
        Self { capture: ProbeCapture::new(), periods: ProbedPeriods::new(), period_us, awaited: None }
    }

    /// Whether the next period may be computed. `begins`: slot at which the one before it begins.
    pub(super) fn may_compute(&self, begins: u32) -> bool {
        self.capture.awaited().is_none() || has_begun(begins, slot_counter::count())
    }

    /// Records that a batch is put behind the period that begins at slot `begins`.
    pub(super) fn put(&mut self, begins: u32, shape: &StepShape) {
        self.periods.put(begins, shape);
        self.period_us = shape.period_us;
    }

    /// Awaits this edge. The same one as before is awaited further. Where the input has no timer or the period is too
    /// short, none is captured.
    pub(super) fn await_edge(&mut self, awaited: Option<AwaitedProbe>) {
        if awaited == self.awaited {
            return;
        }
        self.awaited = awaited;
        tim2().ccer().reset();
        stop_edge_stream();
        if let Some(AwaitedProbe { input, .. }) = self.capture.awaited() {
            ports::disconnect_capture(input);
        }
        let found = awaited.and_then(|probe| Some((probe, capture_input(probe.input)?)));
        // a timer that does not count would leave the main loop waiting
        let found = found.filter(|_| self.period_us >= MIN_CAPTURE_PERIOD_US && slot_counter::count() != 0);
        self.capture.begin(found.map(|(probe, _)| probe));
        let Some((AwaitedProbe { input, is_high }, timer_input)) = found else { return };
        ports::connect_capture(input);
        tim2().ccmr1_input().write(|w| match timer_input {
            CaptureInput::First => w.cc1s().ti1(),
            CaptureInput::Second => w.cc1s().ti2(),
        });
        start_edge_stream();
        tim2().ccer().write(|w| w.cc1p().bit(!is_high).cc1e().set_bit());
    }

    /// Reads the probe. `levels`: those of the inputs, which are returned with that of the probe as far as it counts;
    /// `begins`: slot at which the period begins that was taken last.
    pub(super) fn read(&mut self, levels: u16, begins: u32) -> (u16, ProbeReading) {
        let fetched = self.capture.awaited().and_then(|_| fetched_edge());
        let edge = fetched.and_then(|count| self.periods.edge_part(count, begins));
        if edge.is_some() {
            // the next one, if this one was none that counts
            stop_edge_stream();
            start_edge_stream();
        }
        self.capture.read(levels, edge)
    }
}
