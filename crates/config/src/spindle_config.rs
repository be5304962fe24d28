//! The spindle, `[spindle]` (SPN-1, SPN-6, SPN-8, SPN-12).
//!
//! Invariant: without a word about it, nothing follows a spindle that the card does not measure.

use retrace_link::SpindleSettings;
use schemars::JsonSchema;
use serde::Deserialize;

use crate::numbered_error::NumberedError;
use crate::value_range::within;

/// What the feed of G95 follows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FeedPerTurn {
    /// The measured speed, which needs an encoder; without one, G95 is refused.
    #[default]
    Measured,
    /// The commanded speed, S: the spindle is taken to turn at it.
    Commanded,
}

/// Direction in which the encoder counts up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum EncoderDirection {
    /// Clockwise (M3).
    #[default]
    Clockwise,
    /// Counter-clockwise (M4).
    CounterClockwise,
}

/// The spindle, `[spindle]`.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct SpindleSection {
    /// What the feed of G95 follows.
    pub(crate) feed_per_turn: FeedPerTurn,
    /// Counts of the encoder in a turn of the spindle, 4 … 131 072: four times its lines. Without it there is no
    /// encoder.
    pub(crate) counts_per_turn: Option<u32>,
    /// Direction in which the encoder counts up.
    direction: EncoderDirection,
    /// Whether the encoder has an index, which threads need.
    index: bool,
    /// Highest speed in turns per minute: with an encoder, and under G96, which needs a D word without it.
    #[schemars(range(min = 1.0, max = 1_000_000.0))]
    pub(crate) max_rpm: Option<f64>,
    /// Lowest speed in turns per minute under G96.
    #[schemars(range(min = 0.0, max = 1_000_000.0))]
    pub(crate) min_rpm: f64,
    /// Output by which M19 tells the drive to turn the spindle to its angle and to hold it there.
    #[schemars(range(max = 63))]
    pub(crate) orient_output: Option<u8>,
    /// Input by which the drive reports that the spindle is at its angle.
    #[schemars(range(max = 15))]
    pub(crate) orient_input: Option<u8>,
    /// Angle of the drive in degrees: the only R that M19 may have.
    #[schemars(range(min = 0.0, max = 360.0))]
    pub(crate) orient_angle_deg: f64,
    /// Largest difference from the commanded speed at which the spindle is at speed, percent, 0.1 … 50.
    at_speed_percent: f64,
    /// Time for which it has to be at speed, ms, 0 … 10 000.
    pub(crate) at_speed_ms: f64,
    /// Time after which a spindle that is not at speed is an alarm, s, 0.1 … 600.
    pub(crate) at_speed_timeout_s: f64,
    /// Input by which the drive of a spindle without an encoder reports that it is at speed.
    #[schemars(range(max = 15))]
    pub(crate) at_speed_input: Option<u8>,
    /// Time that a spindle without an encoder and without that input takes to its speed, s, 0 … 600.
    pub(crate) spin_up_s: f64,
    /// By how much the plan of a thread is faster than the commanded speed, percent, 0 … 200: as much faster may the
    /// spindle turn.
    thread_margin_percent: f64,
    /// Largest lag behind the spindle in a thread, mm along the path, 0.001 … 1.
    thread_tolerance_mm: f64,
    /// How G74 and G84 tap. G33.1 is always rigid.
    tapping: Tapping,
    /// Whether the drive can reverse the spindle, which rigid tapping needs.
    reversible: bool,
    /// Turns of the spindle in a tap from the command to reverse it until it stands, at `max_rpm`, 0 … 100. They
    /// grow with the square of the speed. With 0 it is reversed at the depth, and turns behind it.
    reversal_turns: f64,
    /// What a feed hold does in a thread (G33, G76).
    thread_hold: ThreadHold,
    /// Whether the speed override acts in a thread (G33, G76).
    thread_override: ThreadOverride,
    /// Whether a held tap can be turned back out of its hole by *reverse*.
    tap_retrace: bool,
    /// Speed of the spindle in turns per minute where a thread is reversed. Without it, the S of the thread; never
    /// faster than that.
    #[schemars(range(min = 0.1, max = 1_000_000.0))]
    reverse_rpm: Option<f64>,
}

/// What a feed hold does in a thread.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ThreadHold {
    /// The thread is finished, and the machine holds behind it.
    #[default]
    Finish,
    /// The spindle is switched off, and the tool rests in the thread.
    Spindle,
}

/// Whether the speed override acts in a thread.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ThreadOverride {
    /// A thread is cut at the programmed speed.
    #[default]
    Off,
    /// It acts, up to the speed that the thread is planned for.
    Limited,
}

/// How G74 and G84 tap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Tapping {
    /// In a floating holder: down and up at the programmed feed.
    #[default]
    Floating,
    /// In a rigid holder: the tap follows the spindle, as with G33.1.
    Rigid,
}

impl Default for SpindleSection {
    fn default() -> Self {
        Self {
            feed_per_turn: FeedPerTurn::Measured,
            counts_per_turn: None,
            direction: EncoderDirection::Clockwise,
            index: true,
            max_rpm: None,
            min_rpm: 0.0,
            orient_output: None,
            orient_input: None,
            orient_angle_deg: 0.0,
            at_speed_percent: 5.0,
            at_speed_ms: 100.0,
            at_speed_timeout_s: 10.0,
            at_speed_input: None,
            spin_up_s: 0.0,
            thread_margin_percent: 25.0,
            thread_tolerance_mm: 0.02,
            tapping: Tapping::Floating,
            reversible: true,
            reversal_turns: 0.0,
            thread_hold: ThreadHold::Finish,
            thread_override: ThreadOverride::Off,
            tap_retrace: false,
            reverse_rpm: None,
        }
    }
}

/// A spindle with an encoder, checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EncoderConfig {
    /// What the card receives.
    pub settings: SpindleSettings,
    /// Speed for which a thread is planned, as a multiple of the commanded one.
    pub thread_margin: f64,
    /// Largest lag in a thread, mm along the path.
    pub thread_tolerance_mm: f64,
    /// Whether the drive can reverse the spindle.
    pub is_reversible: bool,
    /// Turns from the command to reverse the spindle until it stands, at its highest speed.
    pub reversal_turns: f64,
    /// Whether G74 and G84 tap rigidly.
    pub is_tapping_rigid: bool,
    /// Whether a feed hold in a thread switches the spindle off; otherwise the thread is finished.
    pub holds_in_thread: bool,
    /// Whether the speed override acts in a thread, up to the speed that it is planned for.
    pub overrides_thread: bool,
    /// Whether a held tap can be reversed out of its hole.
    pub reverses_taps: bool,
    /// Speed in turns per minute where a thread is reversed; `None`: that of the thread.
    pub reverse_rpm: Option<f64>,
    /// Records that the card holds before it begins a thread (SPN-14, SPN-16): enough for a spindle that coasts after
    /// the watchdog has switched it off because the host was silent.
    pub records_ahead: u16,
}

/// Time at full speed in which a spindle that is switched off turns as often as until it stands, where the machine file
/// does not tell, s.
const COASTING_S: f64 = 0.25;
/// Largest number of records that the card holds before it begins a thread: of the smallest window, 1024, a quarter is
/// kept for records behind the cursor.
const MAX_RECORDS_AHEAD: f64 = 700.0;

impl SpindleSection {
    /// Checks the section. `None` without an encoder.
    pub(crate) fn checked_encoder(
        &self,
        period_us: u32,
        watchdog_periods: u16,
    ) -> Result<Option<EncoderConfig>, NumberedError> {
        within("spindle.at_speed_percent", self.at_speed_percent, 0.1, 50.0)?;
        within("spindle.at_speed_ms", self.at_speed_ms, 0.0, 10_000.0)?;
        within("spindle.at_speed_timeout_s", self.at_speed_timeout_s, 0.1, 600.0)?;
        within("spindle.thread_margin_percent", self.thread_margin_percent, 0.0, 200.0)?;
        within("spindle.thread_tolerance_mm", self.thread_tolerance_mm, 0.001, 1.0)?;
        within("spindle.reversal_turns", self.reversal_turns, 0.0, 100.0)?;
        if let Some(rpm) = self.reverse_rpm {
            within("spindle.reverse_rpm", rpm, 0.1, 1_000_000.0)?;
        }
        let Some(counts_per_turn) = self.counts_per_turn else { return Ok(None) };
        let most = f64::from(retrace_core::gear::MAX_COUNTS_PER_TURN);
        within("spindle.counts_per_turn", f64::from(counts_per_turn), 4.0, most)?;
        let Some(max_rpm) = self.max_rpm else {
            let cause = "[spindle] counts_per_turn without max_rpm";
            return Err(NumberedError::new("E2112", cause, "max_rpm: the highest speed of the spindle"));
        };
        let periods = |ms: f64| (ms * 1000.0 / f64::from(period_us)).ceil();
        let settings = SpindleSettings {
            counts_per_turn,
            is_inverted: self.direction == EncoderDirection::CounterClockwise,
            has_index: self.index,
            at_speed_permille: (self.at_speed_percent * 10.0).round() as u16,
            at_speed_periods: periods(self.at_speed_ms).min(f64::from(u16::MAX)) as u16,
            timeout_periods: periods(self.at_speed_timeout_s * 1000.0) as u32,
            highest_speed: (max_rpm * 1000.0) as u32,
        };
        let thread_margin = 1.0 + self.thread_margin_percent / 100.0;
        let coasting_ms = 1000.0 * COASTING_S.max(self.reversal_turns * 60.0 / (max_rpm * thread_margin));
        let records_ahead = (f64::from(watchdog_periods) + periods(coasting_ms)).min(MAX_RECORDS_AHEAD) as u16;
        Ok(Some(EncoderConfig {
            settings,
            thread_margin,
            records_ahead,
            thread_tolerance_mm: self.thread_tolerance_mm,
            is_reversible: self.reversible,
            reversal_turns: self.reversal_turns,
            is_tapping_rigid: self.tapping == Tapping::Rigid,
            holds_in_thread: self.thread_hold == ThreadHold::Spindle,
            overrides_thread: self.thread_override == ThreadOverride::Limited,
            reverses_taps: self.tap_retrace && self.reversible,
            reverse_rpm: self.reverse_rpm,
        }))
    }
}

#[cfg(test)]
mod tests {
    use crate::MachineConfig;

    fn encoder(text: &str) -> Result<Option<super::EncoderConfig>, String> {
        let axis = "[[axis]]\nname = \"z\"\npulses_per_mm = 1000\nmax_velocity_mm_per_s = \
                    100\nmax_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-200, 200]\n";
        let machine = MachineConfig::parse(&format!("{axis}[spindle]\n{text}\n"), "m").map_err(|e| e.to_string())?;
        Ok(machine.encoder)
    }

    /// The card begins a thread with enough records for the watchdog's time and a spindle that coasts then, as long as
    /// the machine file tells; not with more than every card holds. The look-ahead is longer than that.
    #[test]
    fn the_records_for_a_silent_host_are_held_before_a_thread_begins() {
        let ahead = |watchdog_ms: f64, turns: f64| {
            let text = format!(
                "look_ahead_s = 0.05\n[card]\nwatchdog_ms = {watchdog_ms}\n[spindle]\ncounts_per_turn = 400\n\
                 max_rpm = 3000\nreversal_turns = {turns}\n"
            );
            let machine = crate::MachineConfig::parse(&text, "lathe").expect("valid");
            let ahead = machine.encoder.expect("an encoder").records_ahead;
            assert!(machine.look_ahead_records >= u32::from(ahead) + crate::IN_FLIGHT_RECORDS);
            ahead
        };
        assert_eq!([ahead(250.0, 0.0), ahead(400.0, 0.0)], [500, 650]);
        // at 3000 rpm and a margin of 25 % 25 turns take as many records as 0.4 s at full speed
        assert_eq!([ahead(250.0, 25.0), ahead(2000.0, 0.0)], [650, 700]);
    }

    #[test]
    fn an_encoder_needs_its_counts_and_a_highest_speed() {
        assert_eq!(encoder(""), Ok(None));
        let found = encoder("counts_per_turn = 400\nmax_rpm = 3000\ndirection = \"counter-clockwise\"").expect("valid");
        let found = found.expect("an encoder");
        assert_eq!((found.settings.counts_per_turn, found.settings.highest_speed), (400, 3_000_000));
        assert!(found.settings.is_inverted && found.settings.has_index && found.settings.is_valid());
        assert_eq!((found.settings.at_speed_permille, found.settings.at_speed_periods), (50, 100));
        assert!((found.thread_margin - 1.25).abs() < 1e-12);
        assert!(!found.holds_in_thread && !found.reverses_taps && found.reverse_rpm.is_none());
        let held =
            "counts_per_turn = 400\nmax_rpm = 3000\nthread_hold = \"spindle\"\ntap_retrace = true\nreverse_rpm = 60";
        let found = encoder(held).expect("valid").expect("an encoder");
        assert!(found.holds_in_thread && found.reverses_taps && found.reverse_rpm == Some(60.0));
        let one_way = encoder(&format!("{held}\nreversible = false")).expect("valid").expect("an encoder");
        assert!(!one_way.reverses_taps);
        assert!(encoder("counts_per_turn = 400").expect_err("no speed").contains("max_rpm"));
        for wrong in [
            "counts_per_turn = 3\nmax_rpm = 100",
            "at_speed_percent = 60",
            "reverse_rpm = 0",
            "thread_tolerance_mm = 0",
        ] {
            assert!(encoder(wrong).is_err(), "{wrong}");
        }
    }
}
