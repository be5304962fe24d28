//! How the height of a torch is controlled while it cuts: `height` of a `[[cutter]]` (CUT-49 to CUT-52).
//!
//! Invariant: a checked height control has one source, which the machine file declares, and every figure fits the card.

use retrace_core::FeedShare;
use retrace_link::{HeightControlSettings, HeightControls, HeightSource};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::analog_input::AnalogInput;
use crate::axis::AxisConfig;
use crate::numbered_error::NumberedError;
use crate::value_range::within;

/// Height control, `height` of a `[[cutter]]`: by the arc voltage (`volts`), by the two outputs of a separate height
/// controller (`up` and `down`), or by another controller that moves the axis by itself (`enable`).
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct HeightControlConfig {
    /// Number of the analog input that reads the arc voltage, in V.
    #[schemars(range(max = 3))]
    pub volts: Option<u8>,
    /// Input of a separate height controller that is active while the torch is too low.
    #[schemars(range(max = 15))]
    pub up: Option<u8>,
    /// Input that is active while it is too high.
    #[schemars(range(max = 15))]
    pub down: Option<u8>,
    /// Output that lets another controller move the tool axis by itself. The height is not known meanwhile.
    #[schemars(range(max = 63))]
    pub enable: Option<u8>,
    /// Maximum speed of the correction, in mm/s.
    #[schemars(range(min = 0.01, max = 500.0))]
    pub max_mm_per_s: f64,
    /// Speed of the correction for a difference of 1 V, in mm/s.
    #[schemars(range(min = 0.001, max = 100.0))]
    pub mm_per_s_per_volt: f64,
    /// Cut-off frequency of the low-pass filter of the voltage, in Hz.
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub filter_hz: f64,
    /// Difference from the target voltage within which the height is held, in V.
    #[schemars(range(min = 0.0, max = 50.0))]
    pub band_volts: f64,
    /// Rise of the voltage that shows a void, in V/s; the height is held over a void. 0: voids are not detected.
    #[schemars(range(min = 0.0, max = 1e6))]
    pub slope_volts_per_s: f64,
    /// Longest void, in ms.
    #[schemars(range(min = 10.0, max = 20_000.0))]
    pub void_ms: f64,
    /// Time from the start of the cut to the control, in s.
    #[schemars(range(min = 0.0, max = 20.0))]
    pub delay_s: f64,
    /// Time at the feed rate of the contour before the control takes over, in ms. Where the material has no voltage, it
    /// is sampled in this time.
    #[schemars(range(min = 1.0, max = 5000.0))]
    pub sample_ms: f64,
    /// Percentage of the feed rate below which the height is held: in corners, and with a reduced override.
    #[schemars(range(min = 0.0, max = 98.0))]
    pub hold_percent: f64,
    /// Time before a slow part of the path from which on the height is held, in ms.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub look_ms: f64,
    /// Length at the end of a contour on which the height is held, in mm.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub end_mm: f64,
    /// Distance in mm that the torch may be above the height at which the control took over.
    #[schemars(range(min = 0.1, max = 200.0))]
    pub up_mm: f64,
    /// Distance in mm that it may be below it.
    #[schemars(range(min = 0.1, max = 200.0))]
    pub down_mm: f64,
    /// Distance in mm that it keeps from the soft limits of its axis.
    #[schemars(range(min = 0.0, max = 50.0))]
    pub margin_mm: f64,
    /// Time at an end of that range after which the cut is interrupted, in ms.
    #[schemars(range(min = 1.0, max = 10_000.0))]
    pub limit_ms: f64,
    /// Step of `height up` and `height down`, in V.
    #[schemars(range(min = 0.01, max = 20.0))]
    pub step_volts: f64,
}

impl Default for HeightControlConfig {
    fn default() -> Self {
        Self {
            volts: None,
            up: None,
            down: None,
            enable: None,
            max_mm_per_s: 10.0,
            mm_per_s_per_volt: 1.0,
            filter_hz: 20.0,
            band_volts: 0.5,
            slope_volts_per_s: 500.0,
            void_ms: 2000.0,
            delay_s: 0.5,
            sample_ms: 50.0,
            hold_percent: 90.0,
            look_ms: 100.0,
            end_mm: 0.0,
            up_mm: 5.0,
            down_mm: 5.0,
            margin_mm: 1.0,
            limit_ms: 500.0,
            step_volts: 1.0,
        }
    }
}

impl HeightControlConfig {
    pub(crate) fn check(&self, cutter: &str) -> Result<(), NumberedError> {
        let figures = [
            ("max_mm_per_s", self.max_mm_per_s, [0.01, 500.0]),
            ("mm_per_s_per_volt", self.mm_per_s_per_volt, [0.001, 100.0]),
            ("filter_hz", self.filter_hz, [0.1, 1000.0]),
            ("band_volts", self.band_volts, [0.0, 50.0]),
            ("slope_volts_per_s", self.slope_volts_per_s, [0.0, 1e6]),
            ("void_ms", self.void_ms, [10.0, 20_000.0]),
            ("delay_s", self.delay_s, [0.0, 20.0]),
            ("sample_ms", self.sample_ms, [1.0, 5000.0]),
            ("hold_percent", self.hold_percent, [0.0, 98.0]),
            ("look_ms", self.look_ms, [0.0, 1000.0]),
            ("end_mm", self.end_mm, [0.0, 100.0]),
            ("up_mm", self.up_mm, [0.1, 200.0]),
            ("down_mm", self.down_mm, [0.1, 200.0]),
            ("margin_mm", self.margin_mm, [0.0, 50.0]),
            ("limit_ms", self.limit_ms, [1.0, 10_000.0]),
            ("step_volts", self.step_volts, [0.01, 20.0]),
        ];
        figures.into_iter().try_for_each(|(key, value, [least, most])| {
            within(&format!("cutter {cutter}: height.{key}"), value, least, most)
        })
    }
}

/// The height control of a machine: the figures, with the axis and the analog input that they refer to.
#[derive(Clone, Copy, Debug)]
pub struct HeightControlOfCutter<'m> {
    config: &'m HeightControlConfig,
    axis: &'m AxisConfig,
    volts: Option<&'m AnalogInput>,
}

impl<'m> HeightControlOfCutter<'m> {
    pub(crate) fn new(config: &'m HeightControlConfig, axis: &'m AxisConfig, inputs: &'m [AnalogInput]) -> Self {
        let volts = config.volts.and_then(|number| inputs.iter().find(|input| input.number == number));
        Self { config, axis, volts }
    }

    /// The figures of the machine file.
    #[must_use]
    pub const fn config(&self) -> &'m HeightControlConfig {
        self.config
    }

    /// The analog input that reads the arc voltage, if it does.
    #[must_use]
    pub const fn volts_input(&self) -> Option<&'m AnalogInput> {
        self.volts
    }

    /// Whether another controller moves the tool axis: its height is not known then.
    #[must_use]
    pub const fn is_external(&self) -> bool {
        self.config.enable.is_some()
    }

    /// Longest time in s in which its motion comes to rest: from its maximum speed at the acceleration of the axis,
    /// whose jerk rounds both ends. Another controller has one of its own, which is not known.
    #[must_use]
    pub fn rest_s(&self) -> f64 {
        let (acceleration, jerk) = (self.axis.max_acceleration_mm_per_s2, self.axis.max_jerk_mm_per_s3);
        if self.is_external() { 0.0 } else { self.config.max_mm_per_s / acceleration + 2.0 * acceleration / jerk }
    }

    /// Difference of two readings for this difference in V; its sign is that of the input.
    #[must_use]
    pub fn readings(&self, volts: f64) -> f64 {
        self.volts.map_or(0.0, |input| volts / input.per_reading())
    }

    /// Settings for a cut by a material with this arc voltage; 0 V: it is sampled.
    #[must_use]
    pub fn settings(&self, volts: f64, period_s: f64) -> HeightControls {
        let of = self.config;
        let pulses = |mm: f64| (mm * self.axis.pulses_per_mm).round() as u32;
        let periods = |ms: f64| (ms / 1000.0 / period_s).round().clamp(0.0, f64::from(u16::MAX)) as u16;
        let per_period = |mm_per_s: f64| mm_per_s * self.axis.pulses_per_mm * period_s;
        let source = match (self.volts, of.up, of.down, of.enable) {
            (Some(input), ..) => HeightSource::Volts { input: input.number },
            (None, Some(up), Some(down), _) => HeightSource::UpDown { up, down },
            (None, _, _, Some(output)) => HeightSource::External { output },
            _ => HeightSource::None,
        };
        let reading = self.volts.map_or(0.0, AnalogInput::per_reading);
        // A gain of 0 would be none at all.
        let gain = (per_period(of.mm_per_s_per_volt) * reading * 4_294_967_296.0).round() as i32;
        let share = 1.0 - (-std::f64::consts::TAU * of.filter_hz * period_s).exp();
        let settings = HeightControlSettings {
            source,
            target: self.volts.filter(|_| volts > 0.0).map_or(0, |input| input.reading(volts).max(1)),
            speed: (per_period(of.max_mm_per_s) * 65_536.0).round().max(1.0) as u32,
            gain: if gain == 0 { reading.signum() as i32 } else { gain },
            filter: (share * 65_536.0).round().clamp(1.0, 65_535.0) as u16,
            band: self.readings(of.band_volts).abs().round() as u16,
            slope: (self.readings(of.slope_volts_per_s).abs() * period_s * 65_536.0).round() as u32,
            void_periods: periods(of.void_ms),
            up: pulses(of.up_mm),
            down: pulses(of.down_mm),
            delay_periods: periods(of.delay_s * 1000.0),
            samples: periods(of.sample_ms).max(1),
            hold_below: FeedShare::from_units((of.hold_percent / 100.0 * 32_768.0).round() as u16),
            look_periods: periods(of.look_ms),
            limit_periods: periods(of.limit_ms).max(1),
        };
        HeightControls::from([settings])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MachineConfig;
    use retrace_link::LayerMove;

    const TABLE: &str = "tool_axis = \"z\"\n[[card.analog_input]]\nnumber = 2\nname = \"arc\"\nunit = \"V\"\n\
        at_full = 256\n\
        [[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nmaterials = \"m.toml\"\n\
        sense = { contacts = [7], sheet_mm = -30 }\n";

    fn machine(height: &str) -> Result<MachineConfig, NumberedError> {
        MachineConfig::parse(&format!("{TABLE}{height}"), "m.toml")
    }

    #[test]
    fn figures_become_those_of_the_card() {
        let machine = machine("height = { volts = 2, band_volts = 1, mm_per_s_per_volt = 0.5 }\n").expect("valid");
        let control = machine.height_control().expect("it has one");
        let [settings] = control.settings(100.0, 0.001);
        assert_eq!(settings.source, HeightSource::Volts { input: 2 });
        assert_eq!((settings.target, settings.band), (25_600, 256));
        // 1000 pulses/mm: 0.5 pulses a period for 256 readings
        assert_eq!((settings.gain, settings.speed), (1 << 23, 10 << 16));
        assert_eq!((settings.up, settings.down, settings.delay_periods, settings.samples), (5000, 5000, 500, 50));
        assert_eq!((settings.slope, settings.void_periods), (128 << 16, 2000), "0.5 V a period");
        // 1 − e^(−2π · 20 Hz · 1 ms)
        assert_eq!((settings.filter, settings.hold_below.units()), (7_739, 29_491));
        assert!(settings.is_valid([16, 4, 16]));
        assert_eq!(control.settings(0.0, 0.001)[0].target, 0, "it is sampled");
        assert!(machine.limits::<3>().feed_shares, "the card has to know the speed as a share of the feed");
    }

    #[test]
    fn what_cannot_be_is_refused_by_name() {
        for (height, part) in [
            ("height = {}\n", "height: it has no source"),
            ("height = { volts = 2, enable = 3 }\n", "height: it has no source, or two"),
            ("height = { enable = 64 }\n", "height enable = 64: there is no such output"),
            ("arm = 3\nheight = { enable = 3 }\n", "height enable = 3: cutter torch uses it too"),
            ("height = { volts = 2, up = 1, down = 2 }\n", "height: it has no source, or two"),
            ("height = { volts = 1 }\n", "volts = 1: there is no such analog input"),
            ("height = { up = 7, down = 2 }\n", "up = 7: there is no such input, or it has another use"),
            ("height = { up = 2, down = 2 }\n", "no source"),
            ("height = { volts = 2, hold_percent = 99 }\n", "height.hold_percent = 99"),
            ("height = { volts = 2, band_volts = nan }\n", "height.band_volts"),
        ] {
            let error = machine(height).expect_err(height).cause;
            assert!(error.contains(part), "{error}");
        }
        let without = TABLE.replace("sense = { contacts = [7], sheet_mm = -30 }\n", "height = { volts = 2 }\n");
        let error = MachineConfig::parse(&without, "m.toml").expect_err("no sensing").cause;
        assert!(error.contains("height: the sheet is not sensed"), "{error}");
        assert!(machine("").expect("valid").height_control().is_none());
        let skips = TABLE.replace("sheet_mm = -30", "sheet_mm = -30, skip_mm = 5") + "height = { enable = 3 }\n";
        let error = MachineConfig::parse(&skips, "m.toml").expect_err("it skips the sensing").cause;
        assert!(error.contains("height: the height is not known behind a contour"), "{error}");
    }

    #[test]
    fn another_controller_is_enabled_by_an_output_of_the_cutter() {
        let machine = machine("height = { enable = 3 }\n").expect("valid");
        let control = machine.height_control().expect("it has one");
        let [settings] = control.settings(100.0, 0.001);
        assert_eq!((settings.source, settings.target), (HeightSource::External { output: 3 }, 0));
        assert!(control.is_external() && settings.is_valid([16, 4, 4]));
        assert_eq!(machine.channel_name(3), "torch height enable");
        assert!(machine.card.off_at_fault.contains(&3), "it is off at a fault");
    }

    /// The sheet is sensed, and the height controlled, within the soft limits less the margin.
    #[test]
    fn a_margin_is_kept_from_the_soft_limits() {
        let bounds = |height: &str| {
            let axis = "[[axis]]\nname = \"z\"\npulses_per_mm = 100\nmax_velocity_mm_per_s = 60\n\
                        max_acceleration_mm_per_s2 = 600\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-41, -20]\n";
            let text = format!("{}{height}[card]\n", TABLE.replace("[[card", &format!("{axis}[[card")));
            let machine = MachineConfig::parse(&text, "m.toml").expect("valid");
            match machine.tool_layer().expect("it senses").start(0.0, [4.0, 2.0], false, Default::default()) {
                LayerMove::Start { start, lowest, .. } => [lowest, start],
                _ => unreachable!(),
            }
        };
        assert_eq!(bounds(""), [-4000, -2000]);
        assert_eq!(bounds("height = { volts = 2 }\n"), [-4000, -2100]);
        assert_eq!(bounds("height = { volts = 2, margin_mm = 50 }\n"), [-3050, -3050], "no further than the middle");
    }

    #[test]
    fn every_figure_in_its_range_is_valid_on_the_card() {
        for input in ["at_full = 256", "at_full = -1000000", "at_full = 1e-3"] {
            for (low, period) in [(true, 0.0001), (false, 0.01)] {
                let height = if low {
                    "max_mm_per_s = 0.01, mm_per_s_per_volt = 0.001, hold_percent = 0, sample_ms = 1, limit_ms = 1"
                } else {
                    "max_mm_per_s = 500, mm_per_s_per_volt = 100, hold_percent = 98, up_mm = 200, band_volts = 50"
                };
                let text = format!("{TABLE}height = {{ volts = 2, {height} }}\n").replace("at_full = 256", input);
                let machine = MachineConfig::parse(&text, "m.toml").expect("valid");
                let [settings] = machine.height_control().expect("it has one").settings(120.0, period);
                assert!(settings.is_valid([16, 4, 16]), "{settings:?}");
            }
        }
    }
}
