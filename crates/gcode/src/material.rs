//! Materials as programs see them: the figures of a cut, and the list that M190 selects from (CUT-22, CUT-24).
//!
//! Invariant: lengths are in mm and speeds in mm per minute, whatever the units of the program and of the table are.

use std::sync::Arc;

/// First number of temporary materials: those of `(o=0, …)` comments.
pub const FIRST_TEMPORARY_MATERIAL: u32 = 1_000_000;

/// A material: the figures with which the program's next contours are cut.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Material {
    /// Number, as in M190 P; from [`FIRST_TEMPORARY_MATERIAL`] for temporary ones.
    pub number: u32,
    /// Name, for people; may be empty.
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
    /// Feed rate of a cut, mm per minute; 0 is unknown.
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

/// The materials that a program can select, and the default one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MaterialList {
    /// In rising order of their numbers.
    materials: Vec<Arc<Material>>,
    default: u32,
}

impl MaterialList {
    /// Creates a list. Of several materials with one number, the last remains.
    #[must_use]
    pub fn new(materials: impl IntoIterator<Item = Material>, default: u32) -> MaterialList {
        let mut list = MaterialList { materials: Vec::new(), default };
        for material in materials {
            list.insert(material);
        }
        list
    }

    /// Returns the material of this number.
    #[must_use]
    pub fn get(&self, number: u32) -> Option<&Arc<Material>> {
        let place = self.materials.binary_search_by_key(&number, |material| material.number).ok()?;
        self.materials.get(place)
    }

    /// Returns the default material.
    #[must_use]
    pub fn default_material(&self) -> Option<&Arc<Material>> {
        self.get(self.default)
    }

    /// Returns the numbers of all materials, in rising order.
    pub fn numbers(&self) -> impl Iterator<Item = u32> {
        self.materials.iter().map(|material| material.number)
    }

    /// Adds a material, or replaces that of the same number.
    pub(crate) fn insert(&mut self, material: Material) {
        match self.materials.binary_search_by_key(&material.number, |other| other.number) {
            Ok(place) => self.materials[place] = Arc::new(material),
            Err(place) => self.materials.insert(place, Arc::new(material)),
        }
    }
}
