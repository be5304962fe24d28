//! What a machine with a material table adds to the language: its cutters, and the modal state of cutting (CUT-24).
//!
//! Invariant: without a [`CuttingSetup`] nothing here has an effect, and every word has the meaning of LinuxCNC.

use crate::canon_modes::LengthUnit;
use crate::material::{Material, MaterialList};
use crate::pierce_figures::PierceFigures;
use crate::pose::Pose;
use std::sync::Arc;

/// What M3 and M4 start, as far as it decides which S words are plausible.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SpindleUse {
    /// Not known, or a beam, whose S is a power: every S word is plausible.
    #[default]
    Unknown,
    /// A spindle: S is its speed in turns per minute.
    Speed,
    /// A torch, a jet or a marker: S has no meaning.
    NoSpeed,
}

/// Greatest S word that is no plausible speed of a spindle in turns per minute: programs for torches have `S1`.
pub(crate) const GREATEST_PLAIN_SPEED: f64 = 10.0;

/// A cutter or marker that `$` addresses.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CuttingTool {
    /// Number behind `$`.
    pub spindle: u8,
    /// Whether it cuts: a torch, a jet or a beam.
    pub cuts: bool,
    /// Whether S is its speed or power. S of a torch, a jet or a marker has no meaning.
    pub uses_speed: bool,
    /// Digital output of the abrasive that is switched with the tool, if any.
    pub abrasive: Option<u8>,
    /// Length in mm before the end of a contour from which the abrasive is off.
    pub abrasive_lag_mm: f64,
    /// Length at the end of a contour, mm, on which the height stays where it is controlled.
    pub height_hold_mm: f64,
}

impl CuttingTool {
    /// Returns which S words are plausible for the tool.
    pub(crate) const fn spindle_use(self) -> SpindleUse {
        match (self.uses_speed, self.cuts) {
            (true, true) => SpindleUse::Unknown,
            (true, false) => SpindleUse::Speed,
            (false, _) => SpindleUse::NoSpeed,
        }
    }
}

/// Data of a machine that cuts by materials.
#[derive(Clone, Debug, PartialEq)]
pub struct CuttingSetup {
    /// Its material table.
    pub materials: Arc<MaterialList>,
    /// Its cutters and markers, in rising order of their numbers.
    pub tools: Vec<CuttingTool>,
    /// Travel of the float switch, mm.
    pub float_travel_mm: f64,
    /// Whether Z words of straight moves and arcs have no effect (CUT-16).
    pub ignores_z: bool,
}

impl CuttingSetup {
    /// The bits of the tools that cut, as in [`CuttingState`].
    pub(crate) fn cutting_bits(&self) -> u8 {
        let cutting = self.tools.iter().filter(|tool| tool.cuts);
        cutting.fold(0, |bits, tool| bits | 1_u8.checked_shl(tool.spindle.into()).unwrap_or_default())
    }

    /// Returns the tool of this number.
    #[must_use]
    pub fn tool(&self, spindle: i32) -> Option<CuttingTool> {
        self.tools.iter().copied().find(|tool| i32::from(tool.spindle) == spindle)
    }
}

/// A function of the cut cycle that a program allows or forbids with M62 to M65.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CuttingSwitch {
    /// The input that proves the cutter is ignored (M62 P1, M64 P1).
    IgnoreArcOk,
    /// Height control may act (M63 P2, M65 P2).
    HeightControl,
    /// The cutter may be on (M63 P3, M65 P3). Off in passing, it does not go on again before the next M3.
    Cutter,
}

/// Small holes: what `#<holes>` and its companions have set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct HoleSettings {
    /// 0 none, 1 slow holes, 2 and over cut, 3 slow holes and arcs, 4 all of them.
    pub(crate) mode: u8,
    /// Greatest diameter of a small hole, mm.
    pub(crate) diameter_mm: f64,
    /// Share of the feed rate, per cent.
    pub(crate) velocity_percent: f64,
    /// Length of the over cut, mm.
    pub(crate) over_cut_mm: f64,
}

impl Default for HoleSettings {
    fn default() -> HoleSettings {
        HoleSettings { mode: 0, diameter_mm: 32.0, velocity_percent: 60.0, over_cut_mm: 4.0 }
    }
}

/// Modal state of cutting between two blocks; initial on a machine without a material table.
#[derive(Clone, Debug, PartialEq)]
pub struct CuttingState {
    /// Material in force, with the figures of M159.
    pub material: Option<Arc<Material>>,
    /// That material without them.
    pub(crate) plain_material: Option<Arc<Material>>,
    pub(crate) pierce_figures: PierceFigures,
    /// Materials that M190 selects from, with those that comments have added; `None` before the first block.
    pub(crate) materials: Option<Arc<MaterialList>>,
    /// Numbers of the materials that comments have added or overwritten, in the order of the program.
    pub(crate) declared: Vec<u32>,
    /// Number of the last temporary material; 0 before the first.
    pub(crate) last_temporary: u32,
    /// Whether M190 has been executed: M66 P3 L3 then waits for the change, which is done.
    pub(crate) is_requested: bool,
    /// Share of the feed rate that M67 E3 or M68 E3 has set, per cent.
    pub(crate) velocity_percent: f64,
    /// Tools that are on, a bit for each number behind `$`.
    pub(crate) lit: u8,
    /// Whether M62 P3 or M64 P3 has forbidden the cutter.
    pub(crate) is_forbidden: bool,
    /// Whether the cutter was forbidden while it was on: M5 allows it again.
    pub(crate) is_off_in_passing: bool,
    /// Whether an over cut has left the machine beyond the end of the program's circle.
    pub(crate) is_displaced: bool,
    pub(crate) holes: HoleSettings,
    pub(crate) pierces_only: bool,
    /// Whether a cutter is on in the steps of a program that only pierces.
    pub(crate) is_piercing: bool,
    /// Whether the program cuts a tube, or keeps its Z motion: Z words are obeyed.
    pub(crate) cuts_tube: bool,
    pub(crate) keeps_z: bool,
    /// Whether the input that proves the cutter is ignored.
    pub(crate) is_arc_ignored: bool,
    /// Whether the program holds the height (M62 P2, M64 P2).
    pub(crate) is_height_held: bool,
    /// The arcs that may be parts of a hole.
    pub(crate) open_circle: Option<OpenCircle>,
    /// End of the path in program coordinates, where it is known, and the feed rate in force.
    pub(crate) path_end: Option<Pose>,
    pub(crate) rate: f64,
}

/// Arcs about one centre, each of which begins where the one before ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct OpenCircle {
    pub(crate) centre: (f64, f64),
    pub(crate) start: (f64, f64),
    /// End of the last arc.
    pub(crate) end: (f64, f64),
    /// Angle of the arcs together, positive counter-clockwise.
    pub(crate) sweep: f64,
}

impl CuttingState {
    /// Returns the materials that comments with o=1 and o=2 have added or overwritten.
    #[must_use]
    pub fn declared_materials(&self) -> Vec<Arc<Material>> {
        let Some(materials) = &self.materials else { return Vec::new() };
        self.declared.iter().filter_map(|&number| materials.get(number).cloned()).collect()
    }
}

impl Default for CuttingState {
    fn default() -> CuttingState {
        CuttingState {
            material: None,
            plain_material: None,
            pierce_figures: PierceFigures::default(),
            materials: None,
            declared: Vec::new(),
            last_temporary: 0,
            is_requested: false,
            velocity_percent: 100.0,
            lit: 0,
            is_forbidden: false,
            is_off_in_passing: false,
            is_displaced: false,
            holes: HoleSettings::default(),
            pierces_only: false,
            is_piercing: false,
            cuts_tube: false,
            keeps_z: false,
            is_arc_ignored: false,
            is_height_held: false,
            open_circle: None,
            path_end: None,
            rate: 0.0,
        }
    }
}

/// A parameter `#<name>` whose assignment changes the state of cutting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum CuttingSetting {
    Holes,
    HoleDiameter,
    HoleVelocity,
    OverCutLength,
    PierceOnly,
    TubeCut,
    KeepZ,
}

impl CuttingSetting {
    /// Returns the setting that this name of a parameter, in lower case, has.
    pub(crate) fn of_name(name: &str) -> Option<CuttingSetting> {
        Some(match name {
            "holes" => CuttingSetting::Holes,
            "h_diameter" => CuttingSetting::HoleDiameter,
            "h_velocity" => CuttingSetting::HoleVelocity,
            "oclength" => CuttingSetting::OverCutLength,
            "pierce-only" => CuttingSetting::PierceOnly,
            "tube-cut" | "tube_cut" => CuttingSetting::TubeCut,
            "keep-z-motion" => CuttingSetting::KeepZ,
            _ => return None,
        })
    }
}

/// A value of the plasma controller that a program reads as `#<_hal[plasmac.…]>`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum HalValue {
    CutFeedRate,
    CutHeight,
    PierceHeight,
    PierceDelay,
    KerfWidth,
    FloatSwitchTravel,
}

impl HalValue {
    /// The known names, in lower case, as between `#<_hal[` and `]>`.
    pub(crate) const NAMES: [(&'static str, HalValue); 6] = [
        ("plasmac.cut-feed-rate", HalValue::CutFeedRate),
        ("plasmac.cut-height", HalValue::CutHeight),
        ("plasmac.float-switch-travel", HalValue::FloatSwitchTravel),
        ("plasmac.kerf-width", HalValue::KerfWidth),
        ("plasmac.pierce-delay", HalValue::PierceDelay),
        ("plasmac.pierce-height", HalValue::PierceHeight),
    ];

    /// Returns the value in the units of the program.
    pub(crate) fn value(self, setup: &CuttingSetup, state: &CuttingState, units: LengthUnit) -> f64 {
        let of = |figure: fn(&Material) -> f64| state.material.as_deref().map_or(0.0, figure);
        let mm = match self {
            HalValue::CutFeedRate => of(|material| material.feed_mm_per_min),
            HalValue::CutHeight => of(|material| material.cut_height_mm),
            HalValue::PierceHeight => of(|material| material.pierce_height_mm),
            HalValue::PierceDelay => return of(|material| material.pierce_delay_s),
            HalValue::KerfWidth => of(|material| material.kerf_mm),
            HalValue::FloatSwitchTravel => setup.float_travel_mm,
        };
        mm / units.millimetres()
    }
}
