//! The settings that a card receives for a machine.
//!
//! Invariant: they depend on the checked machine and on the start of the path only.

use retrace_core::limits::RateLimits;
use retrace_link::{CardSettings, CardStatus, OutputChange, PathStart};

use crate::analog_output::AnalogOutput;
use crate::cutter;
use crate::machine_config::MachineConfig;

/// Time in ms for which the machine may be at rest with a rate requested before the cutter counts as on at rest: on a
/// serial line some 40 ms pass between the report of M3 and the first motion (CUT-6).
const HANDOVER_MS: f64 = 100.0;

impl MachineConfig {
    /// Counts of the axes as the machine is: those of the path, and the layer.
    #[must_use]
    pub fn position_counts<const A: usize>(&self, status: &CardStatus<A>) -> [i64; A] {
        let mut counts = status.counts;
        if let Some(count) = self.tool_layer().and_then(|layer| counts.get_mut(layer.index)) {
            *count += i64::from(status.layer);
        }
        counts
    }

    /// Settings that a card receives for this machine, with the start of the path.
    #[must_use]
    pub fn card_settings<const A: usize>(&self, start: PathStart) -> CardSettings<A> {
        let card = &self.card;
        // A checked machine has them.
        let limits = self.rate_limits().unwrap_or(RateLimits::unconfigured());
        let mut settings = CardSettings {
            axes: self.axes.len().min(A) as u8,
            report_periods: card.report_periods,
            watchdog_periods: card.watchdog_periods,
            pulse_ns: card.pulse_ns,
            direction_setup_ns: card.direction_setup_ns,
            direction_inverted: card.direction_inverted,
            inputs: card.inputs,
            // A checked machine has no more than the settings.
            safe_count: (card.off_at_fault.len() + card.analog_outputs.len()) as u8,
            cutting: cutter::settings(
                &self.cutters,
                HANDOVER_MS.min(f64::from(card.watchdog_periods) * self.period_s() * 1e3),
                self.period_us,
                self.inhibits_outputs,
            ),
            layer: self.tool_layer().map(|layer| layer.settings(self.period_s())),
            spindle_pwm: self.spindle_pwm(),
            speed_curve: self.card.speed_curve,
            spindle: self.encoder.map(|encoder| encoder.settings),
            ..CardSettings::new(0, start, self.period_us, limits)
        };
        let off = card.off_at_fault.iter().map(|&channel| OutputChange { channel, value: 0 });
        let safe = off.chain(card.analog_outputs.iter().map(AnalogOutput::safe_change));
        for (slot, change) in settings.safe.iter_mut().zip(safe) {
            *slot = change;
        }
        for (slot, axis) in settings.backlash_pulses.iter_mut().zip(&self.axes) {
            // At most 10 mm, and at most as many pulses as the settings can represent.
            *slot = (axis.backlash_mm * axis.pulses_per_mm).round() as u16;
        }
        settings
    }
}
