//! What the code that opens a jet switches besides the water: its pressure and its abrasive (CUT-18, CUT-19).
//!
//! Invariant: the abrasive is on with the water alone, and a stated lead before it; feed begins with high pressure,
//! where the jet has an output for it.

use retrace_config::{CodeSwitching, CutterConfig, JetFlow};
use retrace_link::OutputChange;

use super::switching::CutStart;
use super::{CanonError, CanonExecutor};
use crate::motion_sink::MotionSink;

impl<'m> CanonExecutor<'m> {
    /// The jet that this channel opens, where the same code switches its pressure and its abrasive.
    fn jet_of(&self, fire: u8) -> Option<(&'m CutterConfig, JetFlow)> {
        let cutter = self.machine.cutter_of(fire)?;
        Some((cutter, cutter.jet?))
    }

    /// Whether this channel opens a jet whose abrasive is switched behind the water.
    pub(super) fn abrasive_follows(&self, fire: u8) -> bool {
        self.machine.cutter_of(fire).is_some_and(|cutter| cutter.follows_water().is_some())
    }

    /// Whether the material is pierced at low pressure.
    fn pierces_at_low_pressure(&self) -> bool {
        self.material.as_ref().is_some_and(|material| material.low_pressure_pierce)
    }

    /// Before the water of a jet: high pressure, unless it pierces at low pressure, and an abrasive that leads.
    pub(super) fn prepare_jet<const A: usize>(
        &self,
        of: (&'static str, u32),
        fire: u8,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let Some((cutter, jet)) = self.jet_of(fire) else { return Ok(()) };
        if !self.pierces_at_low_pressure() {
            self.raise_pressure(of, (cutter, jet), sink)?;
        }
        match cutter.abrasive.filter(|_| jet.abrasive_lead_s > 0.0) {
            Some(channel) => self.switch_auxiliary(of, OutputChange { channel, value: 1 }, jet.abrasive_lead_s, sink),
            None => Ok(()),
        }
    }

    /// Behind the water of a jet: an abrasive that follows it, with the pierce; behind a pierce at low pressure the
    /// high one.
    pub(super) fn start_flow<const A: usize>(
        &self,
        of: (&'static str, u32),
        fire: u8,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let Some((cutter, jet)) = self.jet_of(fire) else { return Ok(()) };
        if let Some(channel) = cutter.abrasive.filter(|_| self.abrasive_follows(fire)) {
            let whole_s = self.material.as_ref().map_or(cutter.start.pierce_s, |material| material.pierce_delay_s);
            let [pierce_s, restart_s] = if self.pierces_in_motion() { [0.0, whole_s] } else { [whole_s, 0.0] };
            let periods = |seconds: f64| if self.machine.skips_waits() { 0 } else { self.periods(seconds) };
            let switching = CodeSwitching { periods: periods(pierce_s), ..self.machine.switching.code("M64") };
            let start = CutStart { layer: None, restart_pierce: periods(restart_s), ..CutStart::default() };
            self.exclusive(of, &[OutputChange { channel, value: 1 }], switching, start, sink)?;
        }
        if self.pierces_at_low_pressure() { self.raise_pressure(of, (cutter, jet), sink) } else { Ok(()) }
    }

    fn raise_pressure<const A: usize>(
        &self,
        of: (&'static str, u32),
        (cutter, jet): (&CutterConfig, JetFlow),
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let Some(channel) = cutter.pressure else { return Ok(()) };
        let until = jet.pressure_wait(self.machine.period_us);
        let switching = CodeSwitching { until, ..self.machine.switching.code("M64") };
        self.exclusive(of, &[OutputChange { channel, value: 1 }], switching, CutStart::default(), sink)
    }

    /// Behind the end of a contour that was pierced at low pressure: the next one may begin with it.
    pub(super) fn lower_pressure<const A: usize>(
        &self,
        of: (&'static str, u32),
        fire: u8,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let pressure = self.jet_of(fire).and_then(|(cutter, _)| cutter.pressure);
        match pressure.filter(|_| self.pierces_at_low_pressure()) {
            Some(channel) => self.switch_auxiliary(of, OutputChange { channel, value: 0 }, 0.0, sink),
            None => Ok(()),
        }
    }

    /// Before a jet is closed: its abrasive off, and water alone.
    pub(super) fn purge<const A: usize>(
        &self,
        of: (&'static str, u32),
        fire: u8,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let Some((cutter, jet)) = self.jet_of(fire) else { return Ok(()) };
        match cutter.abrasive {
            Some(channel) => self.switch_auxiliary(of, OutputChange { channel, value: 0 }, jet.purge_s, sink),
            None => Ok(()),
        }
    }
}
