//! The voltage of a simulated arc, over a sheet that may be warped.
//!
//! It is 100 V where the tip is at the sheet, and rises by 10 V for each mm of height; by up to 8 V where the torch is
//! slow, and by 20 V where the arc is about to cross what is cut already. The figures are those of no real source: they
//! only have the signs and the order of one.
//!
//! Invariant: it depends on the positions of the axes, on what is cut, and on the seed alone.

use crate::random::Random;

/// A sheet that rises along the first axis by `rise_um` within half a metre, and falls again, as a cosine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WarpedSheet {
    /// How far it rises, in µm.
    pub rise_um: i32,
    /// Length of a pulse of the first axis, in nanometres.
    pub nm_per_pulse: u32,
    /// Length of a pulse of the tool axis, in nanometres.
    pub tool_nm_per_pulse: u32,
    /// Inputs of the contacts that sense it, one bit each.
    pub contacts: u16,
}

impl WarpedSheet {
    /// How much higher than at 0 it is, in pulses of the tool axis, where the first axis is at this position.
    #[must_use]
    pub fn rise(&self, position: i64) -> f64 {
        let metres = position as f64 * f64::from(self.nm_per_pulse) / 1e9;
        let share = (1.0 - (std::f64::consts::TAU * metres).cos()) / 2.0;
        share * f64::from(self.rise_um) * 1000.0 / f64::from(self.tool_nm_per_pulse.max(1))
    }
}

/// How the voltage of an arc is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ArcVoltageSettings {
    /// The analog input.
    pub input: u8,
    /// Voltages at both ends of its range, in mV.
    pub range_mv: [i64; 2],
    /// The tool axis, from 0.
    pub axis: u8,
    /// Position of the tool axis at which the tip touches the sheet where that is not warped, in pulses.
    pub sheet: i64,
    /// The sheet.
    pub warped: WarpedSheet,
}

/// Volts at the sheet, and for a mm of height.
const AT_SHEET: f64 = 100.0;
const PER_MM: f64 = 10.0;
/// Volts at rest, and the speed in mm/s over which they fall by a factor of e.
const AT_REST: f64 = 8.0;
const SLOW: f64 = 10.0;
/// Volts over a kerf.
const OVER_KERF: f64 = 20.0;
/// Greatest noise in mV.
const NOISE_MV: u32 = 500;

impl ArcVoltageSettings {
    /// The reading of an arc in 2⁻¹⁶ of the range, with the axes at `positions`, at this speed in mm/s.
    pub(crate) fn reading(&self, positions: &[i64], mm_per_s: f64, is_over_kerf: bool, random: &mut Random) -> u16 {
        let tip = positions.get(usize::from(self.axis)).copied().unwrap_or_default();
        let x = positions.first().copied().unwrap_or_default();
        let pulses = (tip - self.sheet) as f64 - self.warped.rise(x);
        let height_mm = (pulses * f64::from(self.warped.tool_nm_per_pulse) / 1e6).max(0.0);
        let noise = f64::from(random.up_to(2 * NOISE_MV)) / 1000.0 - f64::from(NOISE_MV) / 1000.0;
        let kerf = if is_over_kerf { OVER_KERF } else { 0.0 };
        let volts = AT_SHEET + PER_MM * height_mm + AT_REST * (-mm_per_s / SLOW).exp() + kerf + noise;
        self.reading_of(volts)
    }

    /// The reading without an arc.
    pub(crate) fn dark_reading(&self) -> u16 {
        self.reading_of(0.0)
    }

    fn reading_of(&self, volts: f64) -> u16 {
        let [at_zero, at_full] = self.range_mv.map(|mv| mv as f64 / 1000.0);
        // out of the range it is cut off, as a converter does
        ((volts - at_zero) / (at_full - at_zero) * 65_536.0) as u16
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 200 and 400 pulses/mm.
    const WARPED: WarpedSheet =
        WarpedSheet { rise_um: 5000, nm_per_pulse: 5000, tool_nm_per_pulse: 2500, contacts: 1 << 7 };

    #[test]
    fn a_sheet_rises_in_half_a_metre_and_falls_again() {
        let rises = [0, 25_000, 50_000, 100_000, 150_000, 200_000].map(|x| WARPED.rise(x).round());
        // cos(45°) at an eighth of the wave
        assert_eq!(rises, [0.0, 293.0, 1000.0, 2000.0, 1000.0, 0.0]);
    }

    #[test]
    fn the_voltage_is_that_of_the_height() {
        let of = ArcVoltageSettings { input: 1, range_mv: [0, 256_000], axis: 2, sheet: -28_000, warped: WARPED };
        let mut random = Random::new(7);
        let mut volts = |x: i64, z: i64, speed: f64, kerf: bool| {
            (0..100).map(|_| f64::from(of.reading(&[x, 0, z], speed, kerf, &mut random)) / 256.0).sum::<f64>() / 100.0
        };
        for (got, wanted) in [
            (volts(0, -28_000, 1e9, false), 100.0),
            (volts(0, -28_000 + 600, 1e9, false), 115.0),
            (volts(100_000, -28_000 + 2600, 1e9, false), 115.0),
            (volts(0, -28_000, 0.0, false), 108.0),
            (volts(0, -28_000, 1e9, true), 120.0),
            (volts(0, -30_000, 1e9, false), 100.0),
        ] {
            assert!((got - wanted).abs() < 0.15, "{got} {wanted}");
        }
        assert_eq!(of.dark_reading(), 0);
    }
}
