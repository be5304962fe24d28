//! How a cutter finds the sheet and at which heights it cuts: `sense` of a `[[cutter]]` (CUT-13, CUT-15).
//!
//! Invariant: where a checked cutter senses the sheet, the moves of the layer stay within the travel of the tool axis.

use retrace_link::{HeightControls, LayerMove, LayerSettings, OhmicSensing, SheetSource};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::axis::AxisConfig;
use crate::numbered_error::NumberedError;
use crate::value_range::within;

/// Height behind a contour that ends in an area that was cut before (CUT-14).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum TipUp {
    /// The safe height, as anywhere else.
    #[default]
    Safe,
    /// The retract height.
    Retract,
}

/// Sensing of the sheet, `sense` of a `[[cutter]]`.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SheetSensing {
    /// Inputs that close when the tool touches the sheet, such as that of a float switch. Without one the sheet is not
    /// sensed.
    pub contacts: Vec<u8>,
    /// Inputs of ohmic contacts, which close when the tip touches the sheet, before those of `contacts`.
    pub ohmic: Vec<u8>,
    /// Number of times that the sheet is sensed again where no ohmic contact closes. Then the other contacts count.
    #[schemars(range(max = 20))]
    pub ohmic_tries: u8,
    /// Height of the tip over the sheet at which an ohmic contact opens, in mm.
    #[schemars(range(min = -10.0, max = 10.0))]
    pub ohmic_offset_mm: f64,
    /// Distance in mm from the place at which the sheet was sensed last, within which a start takes the height found
    /// there. 0: every start senses.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub skip_mm: f64,
    /// Expected position of the sheet's surface, in mm in machine coordinates of the tool axis.
    pub sheet_mm: f64,
    /// Height in mm over the expected sheet from which it is sensed.
    #[schemars(range(min = 0.0, max = 500.0))]
    pub start_mm: f64,
    /// Depth in mm below the expected sheet at which it counts as missing.
    #[schemars(range(min = 0.0, max = 500.0))]
    pub below_mm: f64,
    /// Speed toward the sheet, in mm/s.
    #[schemars(range(min = 0.1, max = 100.0))]
    pub probe_mm_per_s: f64,
    /// Speed off the sheet, in mm/s.
    #[schemars(range(min = 0.05, max = 20.0))]
    pub latch_mm_per_s: f64,
    /// Height in mm over the sheet between two contours.
    #[schemars(range(min = 0.0, max = 500.0))]
    pub safe_mm: f64,
    /// Height of the rapids behind a contour that ends in an area cut before, where a part may have tipped up.
    pub tip_up: TipUp,
    /// That height in mm over the sheet, with `tip_up = "retract"`.
    #[schemars(range(min = 0.0, max = 500.0))]
    pub retract_mm: f64,
    /// Height in mm over the sheet to which the tool is lifted where a cut was interrupted, and at which the path is
    /// retraced. 0: it is not lifted.
    #[schemars(range(min = 0.0, max = 500.0))]
    pub lift_mm: f64,
    /// Travel of the float switch between the contact with the sheet and its opening, in mm.
    #[schemars(range(min = 0.0, max = 50.0))]
    pub float_travel_mm: f64,
}

impl Default for SheetSensing {
    fn default() -> Self {
        Self {
            contacts: Vec::new(),
            ohmic: Vec::new(),
            ohmic_tries: 3,
            ohmic_offset_mm: 0.0,
            skip_mm: 0.0,
            sheet_mm: 0.0,
            start_mm: 10.0,
            below_mm: 10.0,
            probe_mm_per_s: 8.0,
            latch_mm_per_s: 1.0,
            safe_mm: 15.0,
            tip_up: TipUp::Safe,
            retract_mm: 40.0,
            lift_mm: 10.0,
            float_travel_mm: 0.0,
        }
    }
}

impl SheetSensing {
    /// Whether the sheet is sensed.
    #[must_use]
    pub fn is_used(&self) -> bool {
        !self.contacts.is_empty()
    }

    /// The inputs of all contacts, with their keys.
    pub(crate) fn inputs(&self) -> impl Iterator<Item = (&'static str, u8)> {
        let contacts = self.contacts.iter().map(|&number| ("contacts", number));
        contacts.chain(self.ohmic.iter().map(|&number| ("ohmic", number)))
    }

    pub(crate) fn check(&self, cutter: &str) -> Result<(), NumberedError> {
        let named = |what: &str| format!("cutter {cutter}: sense.{what}");
        within(&named("sheet_mm"), self.sheet_mm, -10_000.0, 10_000.0)?;
        within(&named("start_mm"), self.start_mm, 0.0, 500.0)?;
        within(&named("below_mm"), self.below_mm, 0.0, 500.0)?;
        within(&named("probe_mm_per_s"), self.probe_mm_per_s, 0.1, 100.0)?;
        within(&named("latch_mm_per_s"), self.latch_mm_per_s, 0.05, 20.0)?;
        within(&named("safe_mm"), self.safe_mm, 0.0, 500.0)?;
        within(&named("retract_mm"), self.retract_mm, 0.0, 500.0)?;
        within(&named("lift_mm"), self.lift_mm, 0.0, 500.0)?;
        within(&named("ohmic_tries"), f64::from(self.ohmic_tries), 0.0, 20.0)?;
        within(&named("ohmic_offset_mm"), self.ohmic_offset_mm, -10.0, 10.0)?;
        within(&named("skip_mm"), self.skip_mm, 0.0, 1000.0)?;
        within(&named("float_travel_mm"), self.float_travel_mm, 0.0, 50.0)
    }
}

/// The layer of a machine: the tool axis of the cutter that senses the sheet.
#[derive(Clone, Copy, Debug)]
pub struct ToolLayer<'m> {
    sensing: &'m SheetSensing,
    axis: &'m AxisConfig,
    /// Index of the tool axis.
    pub index: usize,
    /// Channel that fires the cutter.
    pub fire: u8,
    /// Distance in mm that it keeps from the soft limits of the axis while the sheet is sensed and the height is
    /// controlled.
    margin_mm: f64,
}

impl<'m> ToolLayer<'m> {
    pub(crate) fn new(sensing: &'m SheetSensing, fire: u8, (index, axis): (usize, &'m AxisConfig)) -> Self {
        Self { sensing, axis, index, fire, margin_mm: 0.0 }
    }

    /// Keeps this distance in mm from the soft limits, or the middle of the travel.
    pub(crate) fn with_margin(self, margin_mm: f64) -> Self {
        let [lowest_mm, highest_mm] = self.axis.travel_mm;
        Self { margin_mm: margin_mm.min((highest_mm - lowest_mm) / 2.0), ..self }
    }

    fn pulses(&self, mm: f64) -> i32 {
        (mm * self.axis.pulses_per_mm).round() as i32
    }

    /// Settings for the card.
    #[must_use]
    pub fn settings(&self, period_s: f64) -> LayerSettings {
        let speed = |mm_per_s: f64| (mm_per_s * self.axis.pulses_per_mm * period_s * 65_536.0).round().max(1.0) as u32;
        LayerSettings {
            axis: self.index as u8,
            contacts: self.contacts().fold(0, |bits, number| bits | 1 << number),
            probe_speed: speed(self.sensing.probe_mm_per_s),
            latch_speed: speed(self.sensing.latch_mm_per_s),
        }
    }

    /// Moves of a start with these heights in mm over the sheet; the path of the tool axis is at `path_mm`. `may_skip`:
    /// the sheet that an earlier start found counts. `control`: how the height is controlled behind it.
    #[must_use]
    pub fn start(
        &self,
        path_mm: f64,
        [pierce_mm, cut_mm]: [f64; 2],
        may_skip: bool,
        control: HeightControls,
    ) -> LayerMove {
        let SheetSensing { sheet_mm, start_mm, below_mm, float_travel_mm, .. } = *self.sensing;
        let [lowest_mm, highest_mm] = self.axis.travel_mm;
        let (lowest_mm, highest_mm) = (lowest_mm + self.margin_mm, highest_mm - self.margin_mm);
        let layer = |mm: f64| self.pulses(mm.max(lowest_mm).min(highest_mm) - path_mm);
        let has_ohmic = !self.sensing.ohmic.is_empty();
        let ohmic = OhmicSensing {
            inputs: self.sensing.ohmic.iter().fold(0, |bits, &number| bits | 1 << number),
            tries: self.sensing.ohmic_tries,
            drop: if has_ohmic { self.pulses(float_travel_mm + self.sensing.ohmic_offset_mm) } else { 0 },
        };
        LayerMove::Start {
            start: layer(sheet_mm + start_mm),
            lowest: layer(sheet_mm - below_mm - float_travel_mm),
            pierce: self.pulses(pierce_mm + float_travel_mm),
            cut: self.pulses(cut_mm + float_travel_mm),
            sheet: if may_skip { SheetSource::Kept(ohmic) } else { SheetSource::Sensed(ohmic) },
            control,
        }
    }

    /// Moves to the safe height; the path of the tool axis is at `path_mm`.
    #[must_use]
    pub fn lift(&self, path_mm: f64) -> LayerMove {
        self.over_sheet(path_mm, self.sensing.safe_mm)
    }

    /// Moves off a cut that was interrupted, if the tool is lifted there; the path of the tool axis is at `path_mm`.
    #[must_use]
    pub fn retract(&self, path_mm: f64) -> Option<LayerMove> {
        (self.sensing.lift_mm > 0.0).then(|| self.over_sheet(path_mm, self.sensing.lift_mm))
    }

    /// Moves to this height in mm over the sheet that was found; the path of the tool axis is at `path_mm`.
    #[must_use]
    pub fn over_sheet(&self, path_mm: f64, mm: f64) -> LayerMove {
        LayerMove::OverSheet { height: self.height(mm), highest: self.pulses(self.axis.travel_mm[1] - path_mm) }
    }

    /// This height in mm over the sheet, in pulses over the place where its contact opens.
    #[must_use]
    pub fn height(&self, mm: f64) -> i32 {
        self.pulses(mm + self.sensing.float_travel_mm)
    }

    /// Time in s that the tool takes from one height over the sheet to another.
    #[must_use]
    pub fn move_time_s(&self, from_mm: f64, to_mm: f64) -> f64 {
        self.move_s(self.height(from_mm), self.height(to_mm), self.axis.max_velocity_mm_per_s)
    }

    /// Moves to the safe height over the expected sheet, if the path of the tool axis, at `path_mm`, is below it.
    #[must_use]
    pub fn first_lift(&self, path_mm: f64) -> Option<LayerMove> {
        let safe_mm = (self.sensing.sheet_mm + self.sensing.safe_mm).min(self.axis.travel_mm[1]);
        (path_mm < safe_mm).then(|| LayerMove::To { layer: self.pulses(safe_mm - path_mm) })
    }

    /// Whether the tool is retracted behind a contour that ends in an area cut before.
    #[must_use]
    pub fn retracts(&self) -> bool {
        self.sensing.tip_up == TipUp::Retract
    }

    /// How the sheet is sensed.
    #[must_use]
    pub fn sensing(&self) -> &'m SheetSensing {
        self.sensing
    }

    /// Inputs of all contacts.
    pub fn contacts(&self) -> impl Iterator<Item = u8> + use<'m> {
        self.sensing.contacts.iter().chain(&self.sensing.ohmic).copied()
    }

    /// Time in s that these moves take from the layer `from` where the sheet is as expected, and the layer behind them.
    #[must_use]
    pub fn usual_s(&self, moves: LayerMove, from: i32, sheet: Option<i32>) -> (f64, i32, Option<i32>) {
        let SheetSensing { below_mm, probe_mm_per_s, latch_mm_per_s, .. } = *self.sensing;
        let rapid = self.axis.max_velocity_mm_per_s;
        match (moves, sheet) {
            (LayerMove::Start { pierce, cut, sheet: SheetSource::Kept(_), .. }, Some(sheet)) => {
                let seconds = self.move_s(from, sheet + pierce, rapid) + self.move_s(pierce, cut, rapid);
                (seconds, sheet + cut, Some(sheet))
            }
            (LayerMove::Start { start, lowest, pierce, cut, .. }, _) => {
                let sheet = lowest + self.pulses(below_mm);
                // What it runs on after the contact has closed.
                let over = self.pulses(probe_mm_per_s * self.ramp_s(probe_mm_per_s) / 2.0);
                let down_s = self.move_s(from, start, rapid) + self.move_s(start, sheet, probe_mm_per_s);
                let up_s = self.move_s(0, over, latch_mm_per_s) + self.move_s(0, pierce, rapid);
                (down_s + up_s + self.move_s(pierce, cut, rapid), sheet + cut, Some(sheet))
            }
            (LayerMove::OverSheet { height, highest }, _) => {
                let to = sheet.map_or(highest, |sheet| (sheet + height).min(highest));
                (self.move_s(from, to, rapid), to, sheet)
            }
            (LayerMove::To { layer }, _) => (self.move_s(from, layer, rapid), layer, sheet),
        }
    }

    /// Time to reach a speed: the ramp, and its average, which bounds the jerk.
    fn ramp_s(&self, mm_per_s: f64) -> f64 {
        mm_per_s / self.axis.max_acceleration_mm_per_s2 + self.average_s()
    }

    fn average_s(&self) -> f64 {
        2.0 * self.axis.max_acceleration_mm_per_s2 / self.axis.max_jerk_mm_per_s3
    }

    fn move_s(&self, from: i32, to: i32, mm_per_s: f64) -> f64 {
        let (mm, acceleration) =
            (f64::from(from.abs_diff(to)) / self.axis.pulses_per_mm, self.axis.max_acceleration_mm_per_s2);
        if mm == 0.0 {
            0.0
        } else if mm < mm_per_s * mm_per_s / acceleration {
            2.0 * (mm / acceleration).sqrt() + self.average_s()
        } else {
            mm / mm_per_s + self.ramp_s(mm_per_s)
        }
    }
}
