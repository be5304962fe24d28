//! Speeds of the spindle under G96, its orientation by M19, and what shows that it is ready without an encoder: the
//! rest of `[spindle]`, checked (SPN-6, SPN-9, SPN-10).
//!
//! Invariant: a drive that orients the spindle has an output and an input of its own, and nothing waits for a cutter.

use retrace_link::{InputUse, InputWait, channel};

use crate::card_config::CardConfig;
use crate::cutter::{self, CutterConfig};
use crate::numbered_error::NumberedError;
use crate::spindle_config::SpindleSection;
use crate::value_range::within;

/// A drive that turns the spindle to its own angle and holds it there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpindleOrientation {
    /// Output that asks for it.
    pub output: u8,
    /// Input that is active while the spindle is at the angle.
    pub input: u8,
    /// The angle, degrees from 0 to below 360.
    pub angle_deg: f64,
}

/// Speeds and orientation of the spindle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpindleConfig {
    /// Lowest speed under G96, turns per minute.
    pub min_rpm: f64,
    /// Highest speed under G96, turns per minute; infinite where the machine file has none.
    pub max_rpm: f64,
    /// The drive that orients the spindle, if any.
    pub orientation: Option<SpindleOrientation>,
    /// What a feed move waits for where the spindle was started or changed, on a machine without an encoder.
    pub ready: Option<SpindleReady>,
}

/// What shows that a spindle without an encoder has its speed (SPN-6).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpindleReady {
    /// Control periods to wait first: the spin-up time, or what the drive may take to switch its input off.
    pub periods: u32,
    /// The input of the drive, if it has one.
    pub until: Option<InputWait>,
}

impl SpindleSection {
    /// Checks speeds and orientation.
    ///
    /// # Errors
    /// `E2112` for a value out of range, and for an output or input that cannot be that of the orientation.
    pub(crate) fn checked(
        &self,
        cutters: &[CutterConfig],
        card: &CardConfig,
        period_us: u32,
    ) -> Result<SpindleConfig, NumberedError> {
        let max_rpm = self.max_rpm.unwrap_or(f64::INFINITY);
        within("spindle.max_rpm", self.max_rpm.unwrap_or(1.0), 1.0, 1e6)?;
        within("spindle.min_rpm", self.min_rpm, 0.0, max_rpm.min(1e6))?;
        within("spindle.orient_angle_deg", self.orient_angle_deg, 0.0, 360.0)?;
        let (orientation, ready) = (self.orientation(cutters, card)?, self.ready(cutters, card, period_us)?);
        Ok(SpindleConfig { min_rpm: self.min_rpm, max_rpm, orientation, ready })
    }

    fn ready(
        &self,
        cutters: &[CutterConfig],
        card: &CardConfig,
        period_us: u32,
    ) -> Result<Option<SpindleReady>, NumberedError> {
        within("spindle.spin_up_s", self.spin_up_s, 0.0, 600.0)?;
        if self.at_speed_input.is_none() && self.spin_up_s == 0.0 {
            return Ok(None);
        }
        let refused = |cause: String, remedy: &str| Err(NumberedError::new("E2112", cause, remedy));
        if self.counts_per_turn.is_some() {
            let cause = "spindle.at_speed_input or spindle.spin_up_s, and an encoder (counts_per_turn)";
            return refused(cause.into(), "remove them: the encoder measures the speed");
        }
        if cutters.iter().any(|cutter| cutter.fire == channel::SPINDLE && cutter.kind.cuts_at_rest()) {
            let cause = "spindle.at_speed_input or spindle.spin_up_s, and M3 lights a cutter";
            return refused(cause.into(), "remove them: a cutter has its own input and its own delay");
        }
        let periods = |seconds: f64| (seconds * 1e6 / f64::from(period_us)).ceil() as u32;
        let Some(input) = self.at_speed_input else {
            return Ok(Some(SpindleReady { periods: periods(self.spin_up_s), until: None }));
        };
        if !card.declares_input(input) || card.input_use(input) != InputUse::Plain {
            let cause = format!("spindle.at_speed_input = {input}: no [[card.input]] declares it as a plain input");
            return refused(cause, "declare it: [[card.input]] with this number and use = \"plain\"");
        }
        let until = Some(InputWait::new(input, true, periods(self.at_speed_timeout_s)));
        Ok(Some(SpindleReady { periods: periods(self.at_speed_ms / 1000.0), until }))
    }

    fn orientation(
        &self,
        cutters: &[CutterConfig],
        card: &CardConfig,
    ) -> Result<Option<SpindleOrientation>, NumberedError> {
        let refused = |cause: String, remedy: &str| Err(NumberedError::new("E2112", cause, remedy));
        let (output, input) = match (self.orient_output, self.orient_input) {
            (None, None) => return Ok(None),
            (Some(output), Some(input)) => (output, input),
            _ => {
                let cause = "spindle.orient_output and spindle.orient_input belong together, and one is missing";
                return refused(cause.into(), "name both, or neither");
            }
        };
        if usize::from(output) >= channel::DIGITAL || cutter::inhibited(cutters).contains(&output) {
            let cause = format!("spindle.orient_output = {output}: not an output from 0 to 63, or a cutter's");
            return refused(cause, "give the orientation an output of its own");
        }
        if !card.declares_input(input) || card.input_use(input) != InputUse::Plain {
            let cause = format!("spindle.orient_input = {input}: no [[card.input]] declares it as a plain input");
            return refused(cause, "declare it: [[card.input]] with this number and use = \"plain\"");
        }
        Ok(Some(SpindleOrientation { output, input, angle_deg: self.orient_angle_deg % 360.0 }))
    }
}

#[cfg(test)]
mod tests {
    use crate::{MachineConfig, NumberedError, SpindleOrientation, SpindleReady};
    use retrace_link::InputWait;

    const INPUTS: &str = "[[card.input]]\nnumber = 4\nuse = \"plain\"\n[[card.input]]\nnumber = 5\nuse = \"door\"\n";

    fn machine(spindle: &str) -> Result<MachineConfig, NumberedError> {
        let checked = MachineConfig::check_machine(&format!("{INPUTS}[spindle]\n{spindle}\n"), "m.toml");
        let parsed = MachineConfig::parse(&format!("{INPUTS}[spindle]\n{spindle}\n"), "m.toml");
        assert_eq!(checked.errors.first(), parsed.as_ref().err());
        parsed
    }

    #[test]
    fn speeds_are_unlimited_unless_the_file_limits_them() {
        let spindle = machine("").expect("valid").spindle;
        assert_eq!((spindle.min_rpm, spindle.max_rpm, spindle.orientation), (0.0, f64::INFINITY, None));
        let spindle = machine("min_rpm = 60\nmax_rpm = 3000").expect("valid").spindle;
        assert_eq!((spindle.min_rpm, spindle.max_rpm), (60.0, 3000.0));
        for wrong in ["max_rpm = 0.5", "max_rpm = 2e6", "max_rpm = 50\nmin_rpm = 60", "min_rpm = -1", "min_rpm = nan"] {
            let error = machine(wrong).expect_err(wrong);
            assert!(error.number == "E2112" && error.cause.contains("_rpm = "), "{wrong}: {error}");
        }
    }

    #[test]
    fn a_spindle_without_an_encoder_is_ready_by_its_input_or_after_its_time() {
        let ready = |text: &str| machine(text).expect("valid").spindle.ready;
        assert_eq!(ready("at_speed_ms = 50"), None);
        let period_us = f64::from(machine("").expect("valid").period_us);
        let periods = |seconds: f64| (seconds * 1e6 / period_us).ceil() as u32;
        assert_eq!(ready("spin_up_s = 2.5"), Some(SpindleReady { periods: periods(2.5), until: None }));
        let until = Some(InputWait::new(4, true, periods(3.0)));
        let by_input = "at_speed_input = 4\nspin_up_s = 2.5\nat_speed_timeout_s = 3";
        assert_eq!(ready(by_input), Some(SpindleReady { periods: periods(0.1), until }));
        for (wrong, cause) in [
            ("spin_up_s = 601", "spin_up_s = 601"),
            ("at_speed_input = 5", "at_speed_input = 5"),
            ("at_speed_input = 6", "at_speed_input = 6"),
            ("spin_up_s = 1\ncounts_per_turn = 400\nmax_rpm = 3000", "an encoder"),
            ("spin_up_s = 1\n[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64", "a cutter"),
        ] {
            let error = machine(wrong).expect_err(wrong);
            assert!(error.number == "E2112" && error.cause.contains(cause), "{wrong}: {error}");
        }
    }

    #[test]
    fn an_orientation_has_an_output_and_an_input_of_its_own() {
        let oriented = machine("orient_output = 7\norient_input = 4\norient_angle_deg = 360").expect("valid");
        let orientation = SpindleOrientation { output: 7, input: 4, angle_deg: 0.0 };
        assert_eq!(oriented.spindle.orientation, Some(orientation));
        // A fault switches it off with the spindle.
        assert!(oriented.card.off_at_fault.contains(&7), "{:?}", oriented.card.off_at_fault);
        for (wrong, cause) in [
            ("orient_output = 7", "one is missing"),
            ("orient_input = 4", "one is missing"),
            ("orient_output = 64\norient_input = 4", "orient_output = 64"),
            ("orient_output = 7\norient_input = 5", "orient_input = 5"),
            ("orient_output = 7\norient_input = 6", "orient_input = 6"),
            ("orient_output = 7\norient_input = 4\norient_angle_deg = 361", "orient_angle_deg = 361"),
        ] {
            let error = machine(wrong).expect_err(wrong);
            assert!(error.number == "E2112" && error.cause.contains(cause), "{wrong}: {error}");
        }
        let jet = "orient_output = 7\norient_input = 4\n[[cutter]]\nname = \"jet\"\nkind = \"jet\"\nfire = 7";
        assert!(machine(jet).expect_err("the output of the jet").cause.contains("orient_output = 7"));
    }
}
