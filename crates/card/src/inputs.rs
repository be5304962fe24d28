//! The inputs of a card: the meaning of their levels, and the handwheel's encoder.
//!
//! Invariant: a level is converted to *active* in one place; inputs that the card does not have are never active.

use retrace_link::{AnalogInputs, InputSetting, InputUse, MAX_INPUTS};

use crate::{EncoderReading, ProbeReading};

/// Input values that a card reads once per control period.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InputLevels {
    /// Levels of the inputs, one bit each, as they are at the pins.
    pub levels: u16,
    /// The handwheel's quadrature count; it runs freely and wraps.
    pub encoder: u16,
    /// Whether the machine reports that the instruction being executed has failed.
    pub failed: bool,
    /// What is read of the probe.
    pub probe: ProbeReading,
    /// The spindle's encoder.
    pub spindle: EncoderReading,
    /// Readings of the analog inputs.
    pub analog: AnalogInputs,
}

/// Time for which the contact of a probe that is left may bounce, µs.
const PROBE_SETTLE_US: u32 = 20_000;

/// Inputs as configured by the settings.
#[derive(Clone, Debug, Default)]
pub struct Inputs {
    uses: [InputUse; MAX_INPUTS],
    present: u16,
    active_low: u16,
    active: u16,
    /// Inputs that have become active in the last period, one bit each.
    risen: u16,
    /// Probes, one bit each.
    probes: u16,
    /// Control periods since a probe opened; while it is closed, as many as before.
    probe_open: u32,
    /// Control periods for which a probe has to be open until its closing is a trip.
    probe_settle: u32,
    encoder: Option<u16>,
}

impl Inputs {
    /// Whether this input is active while its level is low.
    pub(crate) const fn is_active_low(&self, input: u8) -> bool {
        self.active_low >> (input & 15) & 1 == 1
    }

    /// Creates a state without inputs.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            uses: [InputUse::Plain; MAX_INPUTS],
            present: 0,
            active_low: 0,
            active: 0,
            risen: 0,
            probes: 0,
            probe_open: u32::MAX,
            probe_settle: 0,
            encoder: None,
        }
    }

    /// Configures the first `count` inputs for control periods of `period_us`. The encoder count is retained, so that a
    /// turn of the wheel is not lost.
    pub fn configure(&mut self, settings: &[InputSetting; MAX_INPUTS], count: u8, period_us: u32) {
        let count = u32::from(count).min(MAX_INPUTS as u32);
        self.present = ((1u32 << count) - 1) as u16;
        self.active_low = 0;
        for (number, setting) in settings.iter().enumerate() {
            self.uses[number] = setting.used_for;
            self.active_low |= u16::from(setting.active_low) << number;
        }
        self.active &= self.present;
        self.probes = self.mask_of(InputUse::Probe);
        self.probe_settle = PROBE_SETTLE_US.div_ceil(period_us.max(1));
    }

    /// Reads the inputs of a control period and returns how far the wheel has turned since the last one.
    pub const fn read(&mut self, inputs: &InputLevels) -> i16 {
        let active = (inputs.levels ^ self.active_low) & self.present;
        if active & self.probes == 0 {
            let has_opened = self.active & self.probes != 0;
            self.probe_open = if has_opened { 1 } else { self.probe_open.saturating_add(1) };
        }
        (self.risen, self.active) = (active & !self.active, active);
        let before = match self.encoder {
            Some(before) => before,
            None => inputs.encoder,
        };
        self.encoder = Some(inputs.encoder);
        inputs.encoder.wrapping_sub(before) as i16
    }

    /// Returns the active inputs, one bit each.
    #[must_use]
    pub const fn active(&self) -> u16 {
        self.active
    }

    /// Whether an input with this use is active.
    #[must_use]
    pub fn is_active(&self, used_for: InputUse) -> bool {
        self.active & self.mask_of(used_for) != 0
    }

    /// Returns the first probe that has become active in the last period, unless it has just opened: a contact that
    /// is left bounces.
    #[must_use]
    pub const fn tripped_probe(&self) -> Option<u8> {
        let tripped = self.probes & self.risen;
        if tripped == 0 || self.probe_open < self.probe_settle { None } else { Some(tripped.trailing_zeros() as u8) }
    }

    /// Returns the tripped limit switches: bit, axis, and whether it is the upper end.
    pub fn tripped(&self) -> impl Iterator<Item = (u16, u8, bool)> {
        self.uses.iter().enumerate().filter_map(|(number, used_for)| match *used_for {
            InputUse::Limit { axis, upper } if self.active >> number & 1 == 1 => Some((1 << number, axis, upper)),
            _ => None,
        })
    }

    /// Returns the active collision inputs, one bit each.
    #[must_use]
    pub fn collisions(&self) -> u16 {
        let inputs =
            self.uses.iter().enumerate().filter(|(_, used_for)| matches!(used_for, InputUse::Collision { .. }));
        inputs.fold(0, |bits, (number, _)| bits | 1 << number) & self.active
    }

    /// Returns the first active collision input whose bit is not in `except`: of those that count in all motion, and,
    /// if the cutter is `lit`, of the others, too.
    #[must_use]
    pub fn collision(&self, lit: bool, except: u16) -> Option<u8> {
        let of_use = |used_for: &InputUse| match *used_for {
            InputUse::Collision { only_lit } => lit || !only_lit,
            _ => false,
        };
        let active = self.active & !except;
        (0u8..).zip(&self.uses).find(|(number, used_for)| active >> number & 1 == 1 && of_use(used_for)).map(|(n, _)| n)
    }

    /// Returns the switch by which an axis is homed at an end: its home switch, else the limit switch there, as a set
    /// of bits; 0 for none.
    #[must_use]
    pub fn home_switch(&self, axis: u8, upper: bool) -> u16 {
        match self.mask_of(InputUse::Home { axis }) {
            0 => self.mask_of(InputUse::Limit { axis, upper }),
            home => home,
        }
    }

    fn mask_of(&self, wanted: InputUse) -> u16 {
        let used = self.uses.iter().enumerate().filter(|(_, used_for)| **used_for == wanted);
        used.fold(0, |bits, (number, _)| bits | 1 << number) & self.present
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_probe_that_closes_again_just_behind_its_opening_has_not_tripped() {
        let mut settings = [InputSetting::default(); MAX_INPUTS];
        settings[2].used_for = InputUse::Probe;
        let mut panel = Inputs::new();
        panel.configure(&settings, 16, 2000);
        let mut read = |closed: bool| {
            panel.read(&InputLevels { levels: u16::from(closed) << 2, ..InputLevels::default() });
            panel.tripped_probe()
        };
        assert_eq!([read(false), read(true), read(true)], [None, Some(2), None]);
        // It bounces where it is left, and is at rest 20 ms later.
        for open in [1, 3, 9, 10, 11] {
            let last = (0..open).map(|_| read(false)).last().flatten();
            assert_eq!((last, read(true)), (None, (open >= 10).then_some(2)), "{open}");
        }
    }

    #[test]
    fn levels_become_active_inputs_and_absent_ones_never_do() {
        let mut settings = [InputSetting::default(); MAX_INPUTS];
        settings[0] = InputSetting { used_for: InputUse::EmergencyStop, active_low: true };
        settings[1] = InputSetting { used_for: InputUse::Limit { axis: 1, upper: true }, active_low: false };
        settings[15] = InputSetting { used_for: InputUse::Door, active_low: true };
        let mut panel = Inputs::default();
        panel.configure(&settings, 4, 1000);
        panel.read(&InputLevels { levels: 0b0011, ..InputLevels::default() });
        assert_eq!((panel.active(), panel.tripped().next()), (0b0010, Some((0b10, 1, true))));
        assert!(!panel.is_active(InputUse::EmergencyStop) && !panel.is_active(InputUse::Door));
        panel.read(&InputLevels::default());
        assert!(panel.is_active(InputUse::EmergencyStop) && panel.tripped().next().is_none());
        assert_eq!((panel.home_switch(1, true), panel.home_switch(1, false), panel.home_switch(0, true)), (2, 0, 0));
        settings[2].used_for = InputUse::Home { axis: 1 };
        panel.configure(&settings, 255, 1000);
        assert_eq!((panel.home_switch(1, true), panel.home_switch(1, false)), (4, 4));
        panel.read(&InputLevels { levels: 0x7FFF, ..InputLevels::default() });
        assert!(panel.is_active(InputUse::Door));
    }

    #[test]
    fn the_wheel_turns_by_wrapping_differences_and_not_at_all_at_first() {
        let mut panel = Inputs::default();
        let mut turned = |encoder| panel.read(&InputLevels { encoder, ..InputLevels::default() });
        assert_eq!([65_530, 3, 65_535, 65_535].map(&mut turned), [0, 9, -4, 0]);
    }
}
