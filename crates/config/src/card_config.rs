//! The card in the machine file: inputs, monitoring, outputs and pulses.
//!
//! Invariant: settings that were checked here name only inputs, outputs and axes that can exist.

use retrace_link::{InputSetting, InputUse, MAX_INPUTS, MAX_SAFE, SpeedCurve, SpindlePwm, channel};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::analog_input::{self, AnalogInput, AnalogInputSection};
use crate::analog_output::{self, AnalogOutput, AnalogOutputSection};
use crate::axis::AxisConfig;
use crate::numbered_error::NumberedError;
use crate::spindle_pwm_config::SpindlePwmSection;
use crate::value_range::within;

/// Use of an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum InputMeaning {
    /// An input that programs wait for.
    Plain,
    /// Limit switch at the lower end of an axis.
    LowerLimit,
    /// Limit switch at the upper end of an axis.
    UpperLimit,
    /// Home switch of an axis.
    Home,
    /// Door switch.
    Door,
    /// Emergency stop.
    EmergencyStop,
    /// Probe.
    Probe,
}

/// An input of the card, `[[card.input]]`.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct InputSection {
    /// Number of the input.
    #[schemars(range(max = 15))]
    number: u8,
    /// Use of the input.
    #[serde(rename = "use")]
    used_for: InputMeaning,
    /// Axis of a limit or home switch.
    axis: Option<char>,
    /// Whether the input is active at low level.
    #[serde(default)]
    active_low: bool,
}

impl InputSection {
    /// The probe of the built-in machine: active at low level, so that an open pin is inactive.
    const PROBE: Self = Self { number: 0, used_for: InputMeaning::Probe, axis: None, active_low: true };
}

/// The motion card, `[card]`.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct CardSection {
    /// Time without a frame from the computer after which the card stops, in ms.
    watchdog_ms: f64,
    /// Interval of the card's reports in ms.
    report_every_ms: f64,
    /// Length of a step pulse in µs.
    step_pulse_us: f64,
    /// Time from a change of direction to the next step in µs.
    direction_setup_us: f64,
    /// Axes whose direction output is inverted.
    inverted_axes: Vec<char>,
    /// Outputs that a fault switches off; by default the cutters and the spindle.
    off_at_fault: Option<Vec<u8>>,
    /// Output for S. Without it the output stays low, unless a beam has `power`.
    spindle_pwm: Option<SpindlePwmSection>,
    /// Inputs.
    input: Vec<InputSection>,
    /// Analog inputs.
    analog_input: Vec<AnalogInputSection>,
    /// Analog outputs.
    analog_output: Vec<AnalogOutputSection>,
}

impl Default for CardSection {
    fn default() -> Self {
        Self {
            watchdog_ms: 250.0,
            report_every_ms: 8.0,
            step_pulse_us: 2.0,
            direction_setup_us: 5.0,
            inverted_axes: Vec::new(),
            off_at_fault: None,
            spindle_pwm: None,
            input: vec![InputSection::PROBE],
            analog_input: Vec::new(),
            analog_output: Vec::new(),
        }
    }
}

/// Settings of the card other than those of the axes.
#[derive(Clone, Debug, PartialEq)]
pub struct CardConfig {
    pub(crate) watchdog_periods: u16,
    pub(crate) report_periods: u8,
    pub(crate) pulse_ns: u16,
    pub(crate) direction_setup_ns: u16,
    pub(crate) direction_inverted: u16,
    pub(crate) inputs: [InputSetting; MAX_INPUTS],
    /// Inputs that the machine file declares, one bit each.
    declared_inputs: u16,
    /// Output channels that a fault switches off.
    pub off_at_fault: Vec<u8>,
    /// Output for S; `None` if the machine file has none.
    pub spindle_pwm: Option<SpindlePwm>,
    /// Curve of the output for S, if it has one.
    pub speed_curve: Option<SpeedCurve>,
    /// Analog inputs, in the order of their numbers.
    pub analog_inputs: Vec<AnalogInput>,
    /// Analog outputs, in the order of their numbers. A fault sets each to its safe value.
    pub analog_outputs: Vec<AnalogOutput>,
}

impl CardSection {
    /// Checks the settings. Without an explicit list, a fault switches off the cutters and the spindle.
    pub(crate) fn checked(
        self,
        axes: &[AxisConfig],
        cutting: &[u8],
        period_ms: f64,
    ) -> Result<CardConfig, NumberedError> {
        within(
            "card.watchdog_ms",
            self.watchdog_ms,
            (40.0_f64).max(10.0 * period_ms),
            2000.0_f64.max(20.0 * period_ms),
        )?;
        within("card.report_every_ms", self.report_every_ms, period_ms, 100.0_f64.max(period_ms))?;
        within("card.step_pulse_us", self.step_pulse_us, 0.1, 60.0)?;
        within("card.direction_setup_us", self.direction_setup_us, 0.0, 60.0)?;
        let refuse =
            |what: String| NumberedError::new("E2112", what, "see `retrace machine new` for a commented machine file");
        let axis_of = |letter: char| {
            let at = axes.iter().position(|axis| axis.name == letter.to_ascii_lowercase());
            at.map(|at| at as u8).ok_or_else(|| refuse(format!("card: the machine has no axis `{letter}`")))
        };
        let mut direction_inverted = 0;
        for &letter in &self.inverted_axes {
            direction_inverted |= 1 << axis_of(letter)?;
        }
        let mut inputs = [InputSetting::default(); MAX_INPUTS];
        let mut declared_inputs: u16 = 0;
        for input in &self.input {
            let slot = inputs
                .get_mut(usize::from(input.number))
                .ok_or_else(|| refuse(format!("card.input: there is no input {}", input.number)))?;
            if declared_inputs & (1 << input.number) != 0 {
                return Err(refuse(format!("card.input {}: declared twice", input.number)));
            }
            declared_inputs |= 1 << input.number;
            let axis = || match input.axis {
                Some(letter) => axis_of(letter),
                None => Err(refuse(format!("card.input {}: which axis does it belong to?", input.number))),
            };
            let used_for = match input.used_for {
                InputMeaning::Plain => InputUse::Plain,
                InputMeaning::LowerLimit => InputUse::Limit { axis: axis()?, upper: false },
                InputMeaning::UpperLimit => InputUse::Limit { axis: axis()?, upper: true },
                InputMeaning::Home => InputUse::Home { axis: axis()? },
                InputMeaning::Door => InputUse::Door,
                InputMeaning::EmergencyStop => InputUse::EmergencyStop,
                InputMeaning::Probe => InputUse::Probe,
            };
            *slot = InputSetting { used_for, active_low: input.active_low };
        }
        let off_at_fault = self.off_at_fault.unwrap_or_else(|| {
            let mut all = cutting.to_vec();
            if !all.contains(&channel::SPINDLE) {
                all.push(channel::SPINDLE);
            }
            all
        });
        let analog_outputs = analog_output::checked(&self.analog_output)?;
        if off_at_fault.len() + analog_outputs.len() > MAX_SAFE || off_at_fault.iter().any(|&c| c > channel::UNWATCHED)
        {
            return Err(refuse(format!(
                "card.off_at_fault: at most {MAX_SAFE} outputs together with the analog ones, each from 0 to {}",
                channel::UNWATCHED
            )));
        }
        let (spindle_pwm, speed_curve) = self
            .spindle_pwm
            .as_ref()
            .map(SpindlePwmSection::checked)
            .transpose()?
            .map_or((None, None), |(pwm, curve)| (Some(pwm), curve));
        let periods = |ms: f64| (ms / period_ms).round().max(1.0);
        Ok(CardConfig {
            watchdog_periods: periods(self.watchdog_ms) as u16,
            // A report takes some thirty bytes: at a low baud rate it may be sent a little later.
            report_periods: periods(self.report_every_ms).max((16.0 / period_ms).floor().min(8.0)).min(255.0) as u8,
            pulse_ns: (1000.0 * self.step_pulse_us) as u16,
            direction_setup_ns: (1000.0 * self.direction_setup_us) as u16,
            direction_inverted,
            inputs,
            declared_inputs,
            off_at_fault,
            spindle_pwm,
            speed_curve,
            analog_inputs: analog_input::checked(&self.analog_input)?,
            analog_outputs,
        })
    }

    /// Settings that each have one of these parts and defaults otherwise, and these last: for checking them one by one.
    pub(crate) fn parts(&self) -> Vec<Self> {
        let usual = || Self { input: Vec::new(), ..Self::default() };
        let mut parts = vec![
            Self { watchdog_ms: self.watchdog_ms, ..usual() },
            Self { report_every_ms: self.report_every_ms, ..usual() },
            Self { step_pulse_us: self.step_pulse_us, ..usual() },
            Self { direction_setup_us: self.direction_setup_us, ..usual() },
            Self { off_at_fault: self.off_at_fault.clone(), ..usual() },
            Self { spindle_pwm: self.spindle_pwm.clone(), ..usual() },
        ];
        parts.extend(self.inverted_axes.iter().map(|&axis| Self { inverted_axes: vec![axis], ..usual() }));
        parts.extend(self.analog_input.iter().map(|one| Self { analog_input: vec![one.clone()], ..usual() }));
        parts.extend(self.analog_output.iter().map(|one| Self { analog_output: vec![one.clone()], ..usual() }));
        parts.extend(self.input.iter().map(|input| Self { input: vec![input.clone()], ..usual() }));
        parts
    }
}

impl CardConfig {
    /// Maximum pulses per second of drives with this length of the step pulse: each pulse is high and low for at least
    /// that time.
    #[must_use]
    pub fn max_pulses_hz(&self) -> f64 {
        1e9 / (2.0 * f64::from(self.pulse_ns.max(1)))
    }

    /// The analog output of this number, if the machine file declares it.
    #[must_use]
    pub fn analog_output(&self, number: i32) -> Option<&AnalogOutput> {
        self.analog_outputs.iter().find(|output| i32::from(output.number) == number)
    }

    /// The analog input of this number, if the machine file declares it.
    #[must_use]
    pub fn analog_input(&self, number: i32) -> Option<&AnalogInput> {
        self.analog_inputs.iter().find(|input| i32::from(input.number) == number)
    }

    /// Maximum number of control periods from a reading of an analog input to the next one that the card reports.
    #[must_use]
    pub fn report_periods(&self) -> u64 {
        u64::from(self.report_periods)
    }

    /// Whether the machine file declares this input with a `[[card.input]]`.
    #[must_use]
    pub fn declares_input(&self, number: u8) -> bool {
        u32::from(number) < u16::BITS && self.declared_inputs & (1 << number) != 0
    }

    /// Meaning of an input.
    pub(crate) fn input_use(&self, number: u8) -> InputUse {
        self.inputs.get(usize::from(number)).map_or(InputUse::Plain, |input| input.used_for)
    }

    /// Whether an axis has a switch for homing at this end: its home switch, or the limit switch there.
    pub(crate) fn can_home(&self, axis: usize, upper: bool) -> bool {
        self.inputs.iter().any(|input| match input.used_for {
            InputUse::Home { axis: of } => usize::from(of) == axis,
            InputUse::Limit { axis: of, upper: end } => usize::from(of) == axis && end == upper,
            _ => false,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine_config::MachineConfig;
    use retrace_core::RecordIndex;
    use retrace_link::{OutputChange, PathStart};

    fn machine(text: &str) -> Result<MachineConfig, NumberedError> {
        MachineConfig::parse(text, "m.toml")
    }

    #[test]
    fn what_is_written_is_what_the_card_is_told() {
        let text = "control_period_ms = 2.0\ncutting_outputs = [4]\n[card]\nwatchdog_ms = 300\nstep_pulse_us = 3.5\n\
            inverted_axes = [\"Y\"]\n[[card.input]]\nnumber = 2\nuse = \"upper-limit\"\naxis = \"z\"\nactive_low = \
            true\n\
            [[card.input]]\nnumber = 13\nuse = \"emergency-stop\"\n";
        let settings = machine(text).expect("valid").card_settings::<4>(PathStart::at(RecordIndex::new(7)));
        assert_eq!((settings.start, settings.axes, settings.period_us), (PathStart::at(RecordIndex::new(7)), 3, 2000));
        assert_eq!((settings.watchdog_periods, settings.report_periods), (150, 8));
        assert_eq!((settings.pulse_ns, settings.direction_inverted), (3500, 2));
        let limit = InputSetting { used_for: InputUse::Limit { axis: 2, upper: true }, active_low: true };
        assert_eq!((settings.inputs[2], settings.inputs[13].used_for), (limit, InputUse::EmergencyStop));
        let off = [4, channel::SPINDLE].map(|channel| OutputChange { channel, value: 0 });
        assert_eq!(settings.safe(), off);
    }

    #[test]
    fn backlash_is_told_in_pulses() {
        let axis = |name: &str, mm: f64| {
            format!(
                "[[axis]]\nname = \"{name}\"\npulses_per_mm = 800\nmax_velocity_mm_per_s = \
                    100\nmax_acceleration_mm_per_s2 = 1000\n\
                max_jerk_mm_per_s3 = 20000\ntravel_mm = [0, 100]\nbacklash_mm = {mm:?}\n"
            )
        };
        let settings = machine(&(axis("x", 0.0) + &axis("z", 0.015)))
            .expect("valid")
            .card_settings::<4>(PathStart::at(RecordIndex::new(0)));
        assert_eq!(settings.backlash_pulses, [0, 12, 0, 0]);
    }

    #[test]
    fn what_cannot_be_is_refused_by_name() {
        let what = |text: &str| machine(text).expect_err("wrong").cause;
        assert!(what("[card]\nwatchdog_ms = 1\n").contains("card.watchdog_ms"));
        assert!(what("[card]\ninverted_axes = [\"a\"]\n").contains("no axis `a`"));
        assert!(what("[[card.input]]\nnumber = 16\nuse = \"door\"\n").contains("no input 16"));
        assert!(what("[[card.input]]\nnumber = 1\nuse = \"home\"\n").contains("which axis"));
        assert!(what("[card]\noff_at_fault = [200]\n").contains("off_at_fault"));
    }
}
