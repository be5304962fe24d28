//! Materials: the figures with which a cutter cuts one kind of sheet, and the list of their keys (CUT-22).
//!
//! Invariant: a [`MaterialConfig`] of a table has all figures in their ranges; lengths are in mm whatever the units of
//! its file are.

/// First number of temporary materials: those that a program declares in a comment and no table has.
pub const FIRST_TEMPORARY_MATERIAL: u32 = 1_000_000;

/// A material, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct MaterialConfig {
    /// Number, as in M190 P; below [`FIRST_TEMPORARY_MATERIAL`].
    pub number: u32,
    /// Name, for the screen and for messages; may be empty.
    pub name: String,
    /// Thickness of the expected sheet, mm; 0 is unknown.
    pub thickness_mm: f64,
    /// Width of the kerf, mm.
    pub kerf_mm: f64,
    /// Height of the cutter over the sheet while it pierces, mm.
    pub pierce_height_mm: f64,
    /// Time from the proved arc to the first motion, s.
    pub pierce_delay_s: f64,
    /// Height over the sheet while it cuts, mm.
    pub cut_height_mm: f64,
    /// Feed rate of a cut, mm per minute.
    pub feed_mm_per_min: f64,
    /// Height behind the pierce, as a percentage of the pierce height; 0 is 100.
    pub puddle_percent: f64,
    /// Time at that height, s.
    pub puddle_s: f64,
    /// Cutting current, A.
    pub amps: f64,
    /// Arc voltage that height control aims at, V.
    pub volts: f64,
    /// Time at rest at the end of a contour with the cutter on, s.
    pub pause_at_end_s: f64,
    /// Gas pressure, bar.
    pub gas_bar: f64,
    /// Mode of the source: 1 normal, 2 constant pilot arc, 3 gouging; 0 is not given.
    pub cut_mode: u8,
    /// Whether height control is on.
    pub height_control: bool,
    /// Feed rate at the beginning of a contour, as a percentage; 0 is 100.
    pub creep_percent: f64,
    /// Length of that beginning, mm.
    pub creep_mm: f64,
    /// Length before the end of a contour from which the cutter is off, mm.
    pub off_before_mm: f64,
    /// Length by which a closed contour is followed beyond its end with the cutter off, mm.
    pub over_cut_mm: f64,
    /// Length of the beginning of a contour that is cut at the feed rate of the pierce, mm.
    pub pierce_mm: f64,
    /// That feed rate, and the one of a wiggle or circle, mm per minute; 0 is that of the contour.
    pub pierce_feed_mm_per_min: f64,
    /// Length to and fro along the beginning of a contour before it is cut, mm, and how often.
    pub wiggle_mm: f64,
    /// Number of wiggles.
    pub wiggles: f64,
    /// Radius of a circle about the place of the pierce before a contour is cut, mm.
    pub circle_mm: f64,
    /// Number of turns of that circle.
    pub circles: f64,
    /// Whether the feed begins as soon as the cutter is proven, and the pierce goes on in motion.
    pub pierces_in_motion: bool,
    /// Height over the sheet to which a pierce in motion falls, mm; 0: it does not.
    pub ramp_height_mm: f64,
    /// Share of the pierce delay behind which it falls, as a percentage.
    pub ramp_delay_percent: f64,
    /// Time from the end of the pierce delay to the fall to the cut height, s.
    pub ramp_hold_s: f64,
    /// Feed rate of the creep, mm per minute; 0: `creep_percent` counts.
    pub creep_feed_mm_per_min: f64,
    /// Whether a jet pierces at low pressure, and cuts at high pressure.
    pub low_pressure_pierce: bool,
    /// Flow of the abrasive of a jet, g per minute; 0 is not given.
    pub abrasive_g_per_min: f64,
}

impl MaterialConfig {
    /// Material of this number with no figures.
    pub(crate) fn empty(number: u32) -> Self {
        Self {
            number,
            name: String::new(),
            thickness_mm: 0.0,
            kerf_mm: 0.0,
            pierce_height_mm: 0.0,
            pierce_delay_s: 0.0,
            cut_height_mm: 0.0,
            feed_mm_per_min: 0.0,
            puddle_percent: 0.0,
            puddle_s: 0.0,
            amps: 0.0,
            volts: 0.0,
            pause_at_end_s: 0.0,
            gas_bar: 0.0,
            cut_mode: 0,
            height_control: true,
            creep_percent: 0.0,
            creep_mm: 0.0,
            off_before_mm: 0.0,
            over_cut_mm: 0.0,
            pierce_mm: 0.0,
            pierce_feed_mm_per_min: 0.0,
            wiggle_mm: 0.0,
            wiggles: 0.0,
            circle_mm: 0.0,
            circles: 0.0,
            pierces_in_motion: false,
            ramp_height_mm: 0.0,
            ramp_delay_percent: 0.0,
            ramp_hold_s: 0.0,
            creep_feed_mm_per_min: 0.0,
            low_pressure_pierce: false,
            abrasive_g_per_min: 0.0,
        }
    }
}

/// Unit of lengths in a material table or a QtPlasmaC file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MaterialUnits {
    /// Millimetres, and bar in a QtPlasmaC file.
    Millimetre,
    /// Inches, and psi in a QtPlasmaC file.
    Inch,
}

impl MaterialUnits {
    /// Name in a material table.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Millimetre => "mm",
            Self::Inch => "inch",
        }
    }

    /// Units of this name.
    #[must_use]
    pub fn of_name(name: &str) -> Option<Self> {
        [Self::Millimetre, Self::Inch].into_iter().find(|units| units.name() == name)
    }

    /// One length unit in mm.
    const fn millimetres(self) -> f64 {
        match self {
            Self::Millimetre => 1.0,
            Self::Inch => 25.4,
        }
    }
}

/// Kind of a figure, which decides its unit and its form.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FigureKind {
    /// A length.
    Length,
    /// A length per minute.
    Speed,
    /// Seconds.
    Seconds,
    /// Gas pressure: always bar in a table, psi in a QtPlasmaC file in inches.
    Pressure,
    /// A number whose unit is part of its key, or that has none.
    Plain,
    /// A whole number.
    Whole,
    /// On or off.
    Switch,
}

/// One psi in bar.
const BAR_OF_PSI: f64 = 0.068_947_572_931_683_6;

/// One figure of a material: its keys, its range and its field.
pub(crate) struct FigureKey {
    /// Key in a material table, without the unit of a length or a speed.
    stem: &'static str,
    pub(crate) kind: FigureKind,
    /// Key in a QtPlasmaC file, if it has one.
    pub(crate) qtplasmac: Option<&'static str>,
    /// Whether a material must have it.
    pub(crate) is_required: bool,
    /// Least and greatest value, in mm, mm per minute, s, bar.
    pub(crate) range: [f64; 2],
    get: fn(&MaterialConfig) -> f64,
    set: fn(&mut MaterialConfig, f64),
}

impl FigureKey {
    /// Key in a material table with these units.
    pub(crate) fn name(&self, units: MaterialUnits) -> String {
        match self.kind {
            FigureKind::Length => format!("{}_{}", self.stem, units.name()),
            FigureKind::Speed => format!("{}_{}_per_min", self.stem, units.name()),
            _ => self.stem.to_owned(),
        }
    }

    /// Factor from a material table's unit to that of the field.
    fn table_factor(&self, units: MaterialUnits) -> f64 {
        match self.kind {
            FigureKind::Length | FigureKind::Speed => units.millimetres(),
            _ => 1.0,
        }
    }

    /// Factor from a QtPlasmaC file's unit to that of the field.
    fn file_factor(&self, units: MaterialUnits) -> f64 {
        match (self.kind, units) {
            (FigureKind::Pressure, MaterialUnits::Inch) => BAR_OF_PSI,
            _ => self.table_factor(units),
        }
    }

    /// Value in the unit of a material table.
    pub(crate) fn table_value(&self, material: &MaterialConfig, units: MaterialUnits) -> f64 {
        in_unit((self.get)(material), self.table_factor(units))
    }

    /// Value in the unit of a QtPlasmaC file.
    pub(crate) fn file_value(&self, material: &MaterialConfig, units: MaterialUnits) -> f64 {
        in_unit((self.get)(material), self.file_factor(units))
    }

    /// Sets the field from a value of a material table.
    ///
    /// # Errors
    /// What a valid value is.
    pub(crate) fn set_table_value(
        &self,
        material: &mut MaterialConfig,
        value: f64,
        units: MaterialUnits,
    ) -> Result<(), String> {
        self.store(material, value, self.table_factor(units))
    }

    /// Sets the field from a value of a QtPlasmaC file.
    ///
    /// # Errors
    /// What a valid value is.
    pub(crate) fn set_file_value(
        &self,
        material: &mut MaterialConfig,
        value: f64,
        units: MaterialUnits,
    ) -> Result<(), String> {
        self.store(material, value, self.file_factor(units))
    }

    fn store(&self, material: &mut MaterialConfig, value: f64, factor: f64) -> Result<(), String> {
        let [least, greatest] = self.range;
        let is_whole = !matches!(self.kind, FigureKind::Whole | FigureKind::Switch) || value.fract() == 0.0;
        if !(least..=greatest).contains(&(value * factor)) || !is_whole {
            let number = if is_whole { "a number" } else { "a whole number" };
            let (least, greatest) = (rounded(least / factor), rounded(greatest / factor));
            return Err(format!("{number} from {least} to {greatest}"));
        }
        (self.set)(material, value * factor);
        Ok(())
    }
}

/// A field's value in a unit with this factor. A conversion is rounded, so that back and forth is the same number.
fn in_unit(value: f64, factor: f64) -> f64 {
    if factor == 1.0 { value } else { rounded(value / factor) }
}

/// Rounded to nine decimals, so that a conversion of units and back leaves a figure as it was written.
fn rounded(value: f64) -> f64 {
    (value * 1e9).round() / 1e9
}

macro_rules! figure {
    ($stem:literal, $kind:ident, $qtplasmac:expr, $required:literal, $range:expr, $field:ident) => {
        FigureKey {
            stem: $stem,
            kind: FigureKind::$kind,
            qtplasmac: $qtplasmac,
            is_required: $required,
            range: $range,
            get: |material| material.$field,
            set: |material, value| material.$field = value,
        }
    };
}

/// Every figure of a material, in the order in which tables list them.
pub(crate) const FIGURES: [FigureKey; 31] = [
    figure!("thickness", Length, None, false, [0.0, 500.0], thickness_mm),
    figure!("kerf", Length, Some("KERF_WIDTH"), false, [0.0, 100.0], kerf_mm),
    figure!("pierce_height", Length, Some("PIERCE_HEIGHT"), true, [0.0, 200.0], pierce_height_mm),
    figure!("pierce_delay_s", Seconds, Some("PIERCE_DELAY"), true, [0.0, 60.0], pierce_delay_s),
    figure!("cut_height", Length, Some("CUT_HEIGHT"), true, [0.0, 200.0], cut_height_mm),
    figure!("feed", Speed, Some("CUT_SPEED"), true, [0.1, 1_000_000.0], feed_mm_per_min),
    figure!("puddle_percent", Plain, Some("PUDDLE_JUMP_HEIGHT"), false, [0.0, 200.0], puddle_percent),
    figure!("puddle_s", Seconds, Some("PUDDLE_JUMP_DELAY"), false, [0.0, 60.0], puddle_s),
    figure!("amps", Plain, Some("CUT_AMPS"), false, [0.0, 2000.0], amps),
    figure!("volts", Plain, Some("CUT_VOLTS"), false, [0.0, 500.0], volts),
    figure!("pause_at_end_s", Seconds, Some("PAUSE_AT_END"), false, [0.0, 60.0], pause_at_end_s),
    figure!("gas_bar", Pressure, Some("GAS_PRESSURE"), false, [0.0, 50.0], gas_bar),
    FigureKey {
        stem: "cut_mode",
        kind: FigureKind::Whole,
        qtplasmac: Some("CUT_MODE"),
        is_required: false,
        range: [0.0, 3.0],
        get: |material| f64::from(material.cut_mode),
        set: |material, value| material.cut_mode = value as u8,
    },
    FigureKey {
        stem: "height_control",
        kind: FigureKind::Switch,
        qtplasmac: Some("THC"),
        is_required: false,
        range: [0.0, 1.0],
        get: |material| f64::from(u8::from(material.height_control)),
        set: |material, value| material.height_control = value != 0.0,
    },
    figure!("creep_percent", Plain, None, false, [0.0, 100.0], creep_percent),
    figure!("creep", Length, None, false, [0.0, 1000.0], creep_mm),
    figure!("off_before", Length, None, false, [0.0, 100.0], off_before_mm),
    figure!("over_cut", Length, None, false, [0.0, 100.0], over_cut_mm),
    figure!("pierce", Length, None, false, [0.0, 100.0], pierce_mm),
    figure!("pierce_feed", Speed, None, false, [0.0, 1_000_000.0], pierce_feed_mm_per_min),
    figure!("wiggle", Length, None, false, [0.0, 50.0], wiggle_mm),
    figure!("wiggles", Whole, None, false, [0.0, 100.0], wiggles),
    figure!("circle", Length, None, false, [0.0, 50.0], circle_mm),
    figure!("circles", Whole, None, false, [0.0, 100.0], circles),
    FigureKey {
        stem: "pierces_in_motion",
        kind: FigureKind::Switch,
        qtplasmac: None,
        is_required: false,
        range: [0.0, 1.0],
        get: |material| f64::from(u8::from(material.pierces_in_motion)),
        set: |material, value| material.pierces_in_motion = value != 0.0,
    },
    figure!("ramp_height", Length, None, false, [0.0, 200.0], ramp_height_mm),
    figure!("ramp_delay_percent", Plain, None, false, [0.0, 100.0], ramp_delay_percent),
    figure!("ramp_hold_s", Seconds, None, false, [0.0, 60.0], ramp_hold_s),
    figure!("creep_feed", Speed, None, false, [0.0, 1_000_000.0], creep_feed_mm_per_min),
    FigureKey {
        stem: "low_pressure_pierce",
        kind: FigureKind::Switch,
        qtplasmac: None,
        is_required: false,
        range: [0.0, 1.0],
        get: |material| f64::from(u8::from(material.low_pressure_pierce)),
        set: |material, value| material.low_pressure_pierce = value != 0.0,
    },
    figure!("abrasive_g_per_min", Plain, None, false, [0.0, 10_000.0], abrasive_g_per_min),
];
