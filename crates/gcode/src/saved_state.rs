//! The modes that M70 and M73 save.
//!
//! Invariant: lengths are in the units that were in force when the modes were saved.

use crate::canon_modes::{FeedMode, LengthUnit, PathControl, Plane};
use crate::compensation::Side;
use crate::modal_groups::{ArcCentres, DistanceMode, SpindleRotation};
use crate::pose::Pose;

/// Modes that M70 and M73 save. Lengths are in the units in force when they were saved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SavedState {
    pub(crate) units: LengthUnit,
    pub(crate) plane: Plane,
    pub(crate) distance: DistanceMode,
    pub(crate) arc_centres: ArcCentres,
    pub(crate) feed_mode: FeedMode,
    pub(crate) feed_rate: f64,
    pub(crate) coordinate_system: u8,
    pub(crate) tool_offset: Pose,
    pub(crate) path_control: PathControl,
    pub(crate) naivecam_tolerance: f64,
    pub(crate) retract_to_r: bool,
    pub(crate) lathe_diameter: bool,
    pub(crate) spindle: SpindleRotation,
    pub(crate) spindle_speed: f64,
    pub(crate) constant_surface_speed: bool,
    pub(crate) max_spindle_speed: f64,
    /// Side and radius of cutter compensation.
    pub(crate) compensation: Option<(Side, f64)>,
    pub(crate) mist: bool,
    pub(crate) flood: bool,
    pub(crate) feed_override: bool,
    pub(crate) speed_override: bool,
    pub(crate) adaptive_feed: bool,
    pub(crate) feed_hold: bool,
    /// Whether the state is restored when the subprogram ends (M73).
    pub(crate) on_return: bool,
}
