//! Probing, `[probe]` (PRB-1, PRB-3, PRB-9, PRB-10).
//!
//! Invariant: a machine has at most one probe, the first input that is declared as one.

use retrace_link::{InputUse, MAX_INPUTS};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::axis::{AxisConfig, refuse};
use crate::card_config::CardConfig;
use crate::numbered_error::NumberedError;
use crate::probing_limits::ProbingLimits;
use crate::value_range::within;

/// Whether the spindle may turn in a probing move.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum SpindleInProbing {
    /// A program that probes with the spindle on is refused.
    #[default]
    Off,
    /// It may turn.
    MayTurn,
}

/// Where the machine is at rest behind a probing move that was answered (PRB-5).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum AfterTouch {
    /// Where it came to rest, a little beyond the touch.
    #[default]
    Stay,
    /// On the touch: it goes back there at the feed of the move.
    Back,
}

/// Probing, `[probe]`.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct ProbeSection {
    /// Time in µs for which the level of the probe has to stay until the touch counts. What is kept is the first edge.
    filter_us: f64,
    /// Longest way in mm from the touch to where the machine comes to rest. A faster feed is refused.
    overtravel_mm: f64,
    /// Highest acceleration in mm/s² in a probing move. Default: that of each axis. An axis whose own is lower keeps
    /// it.
    acceleration_mm_per_s2: Option<f64>,
    /// Highest jerk in mm/s³ in a probing move, of all axes; it may be above theirs, for a shorter stop behind a touch.
    /// Default: that of each axis.
    jerk_mm_per_s3: Option<f64>,
    /// Whether a probe that trips in any other move is an alarm.
    guard: bool,
    /// Whether the spindle may turn in a probing move.
    spindle: SpindleInProbing,
    /// Input that is active while the probe is plugged in. Nothing probes without it.
    connected_input: Option<u8>,
    /// Where the machine is at rest behind a probing move that was answered.
    after: AfterTouch,
    /// Effective diameter of the ball of the probe in mm, 0 for a point: `retrace probe calibrate` measures it. Without
    /// it, the probing cycles measure along the tool axis only.
    ball_diameter_mm: Option<f64>,
    /// Feed in mm/min of the first, fast touch of a probing cycle.
    feed_mm_per_min: f64,
    /// Feed in mm/min of the second touch, which is the result. Default: a tenth of `feed_mm_per_min`.
    slow_feed_mm_per_min: Option<f64>,
    /// Distance in mm to which a probing cycle backs off between the touches, and at its end.
    back_off_mm: f64,
    /// Largest difference in mm of the two touches of a probing cycle.
    agree_mm: f64,
    /// Machine coordinates in mm of the tool setter: X and Y, and Z where a tool without length would touch it.
    setter_mm: Option<[f64; 3]>,
}

impl Default for ProbeSection {
    fn default() -> Self {
        Self {
            filter_us: 0.0,
            overtravel_mm: 5.0,
            acceleration_mm_per_s2: None,
            jerk_mm_per_s3: None,
            guard: true,
            spindle: SpindleInProbing::Off,
            connected_input: None,
            after: AfterTouch::Stay,
            ball_diameter_mm: None,
            feed_mm_per_min: 300.0,
            slow_feed_mm_per_min: None,
            back_off_mm: 1.0,
            agree_mm: 0.1,
            setter_mm: None,
        }
    }
}

/// Probing, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbeConfig {
    /// Input of the probe; `None` if the machine has none.
    pub input: Option<u8>,
    /// Input that is active while the probe is plugged in; `None` if it has none.
    pub connected_input: Option<u8>,
    /// Control periods for which the level has to stay.
    pub filter_periods: u16,
    /// Longest way from the touch to rest, mm.
    pub overtravel_mm: f64,
    /// Limits of a probing move, where they differ from those of the axes.
    pub limits: ProbingLimits,
    /// Whether the spindle may turn in a probing move.
    pub spindle_may_turn: bool,
    /// Where the machine is at rest behind a probing move that was answered.
    pub after: AfterTouch,
    /// Effective diameter of the ball of the probe, mm.
    pub ball_diameter_mm: Option<f64>,
    /// Feed of the first touch of a probing cycle, mm/min.
    pub feed_mm_per_min: f64,
    /// Feed of its second touch, mm/min.
    pub slow_feed_mm_per_min: f64,
    /// Distance to which it backs off, mm.
    pub back_off_mm: f64,
    /// Largest difference of its touches, mm.
    pub agree_mm: f64,
    /// Tool setter in machine coordinates, mm: X and Y, and Z where a tool without length would touch it.
    pub setter_mm: Option<[f64; 3]>,
}

impl ProbeSection {
    /// Checks the section. Without a guard the card sees a plain input.
    pub(crate) fn checked(
        self,
        card: &mut CardConfig,
        axes: &[AxisConfig],
        reserve: f64,
        period_us: u32,
    ) -> Result<ProbeConfig, NumberedError> {
        let machine = (axes, reserve, f64::from(period_us) * 1e-6);
        let limits = ProbingLimits::checked(self.acceleration_mm_per_s2, self.jerk_mm_per_s3, machine)?;
        within("probe.filter_us", self.filter_us, 0.0, 20_000.0)?;
        within("probe.overtravel_mm", self.overtravel_mm, 0.001, 1000.0)?;
        within("probe.ball_diameter_mm", self.ball_diameter_mm.unwrap_or_default(), 0.0, 100.0)?;
        within("probe.feed_mm_per_min", self.feed_mm_per_min, 0.1, 100_000.0)?;
        let slow_feed_mm_per_min = self.slow_feed_mm_per_min.unwrap_or(self.feed_mm_per_min / 10.0);
        within("probe.slow_feed_mm_per_min", slow_feed_mm_per_min, 0.01, self.feed_mm_per_min)?;
        within("probe.back_off_mm", self.back_off_mm, 0.01, 100.0)?;
        within("probe.agree_mm", self.agree_mm, 0.0001, 100.0)?;
        for mm in self.setter_mm.unwrap_or_default() {
            within("probe.setter_mm", mm, -1e6, 1e6)?;
        }
        if let Some(input) = self.connected_input
            && (!card.declares_input(input) || card.input_use(input) != InputUse::Plain)
        {
            let cause = format!("probe.connected_input = {input}: no [[card.input]] declares it as a plain input");
            return Err(refuse(cause));
        }
        let is_probe = |&input: &u8| card.inputs[usize::from(input)].used_for == InputUse::Probe;
        let input = (0..MAX_INPUTS as u8).find(is_probe);
        if let Some(input) = input.filter(|_| !self.guard) {
            card.inputs[usize::from(input)].used_for = InputUse::Plain;
        }
        Ok(ProbeConfig {
            input,
            connected_input: self.connected_input,
            filter_periods: (self.filter_us / f64::from(period_us)).ceil() as u16,
            overtravel_mm: self.overtravel_mm,
            limits,
            spindle_may_turn: self.spindle == SpindleInProbing::MayTurn,
            after: self.after,
            ball_diameter_mm: self.ball_diameter_mm,
            feed_mm_per_min: self.feed_mm_per_min,
            slow_feed_mm_per_min,
            back_off_mm: self.back_off_mm,
            agree_mm: self.agree_mm,
            setter_mm: self.setter_mm,
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::MachineConfig;

    #[test]
    fn the_input_of_a_plugged_in_probe_is_a_plain_one_that_is_declared() {
        let inputs = "[[card.input]]\nnumber = 0\nuse = \"probe\"\n[[card.input]]\nnumber = 5\nuse = \"plain\"\n";
        let connected = |input: u32| {
            let text = format!("{inputs}[probe]\nconnected_input = {input}\n");
            MachineConfig::parse(&text, "m.toml").map(|machine| machine.probe.connected_input)
        };
        assert_eq!(connected(5).expect("a plain input"), Some(5));
        for other in [0, 6, 16, 255] {
            assert!(connected(other).is_err_and(|error| error.to_string().contains("connected_input")), "{other}");
        }
    }
}
