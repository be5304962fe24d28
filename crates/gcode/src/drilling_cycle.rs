//! Drilling cycles, and the words that a series of them retains from hole to hole.
//!
//! Invariant: lengths are in the program's units in force. Words are retained for blocks of the same cycle in the same
//! plane only, the initial level for the whole series.

use crate::canon_modes::Plane;

/// The drilling cycles of RS274/NGC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DrillingCycle {
    /// G73: in pecks, with a short retreat that breaks the chip.
    ChipBreaking,
    /// G74: a left-hand thread with a floating tap holder.
    LeftTapping,
    /// G81.
    Drilling,
    /// G82: with a dwell at the bottom.
    DrillingWithDwell,
    /// G83: in pecks, with a full retreat after each.
    PeckDrilling,
    /// G84: a right-hand thread with a floating tap holder.
    RightTapping,
    /// G85: with a retreat at the feed.
    Boring,
    /// G86: with a retreat after the spindle has stopped.
    BoringSpindleStop,
    /// G87: from below, with the spindle oriented while passing through.
    BackBoring,
    /// G88: the operator retracts the tool.
    BoringManual,
    /// G89: with a dwell at the bottom and a retreat at the feed.
    BoringWithDwell,
}

impl DrillingCycle {
    /// Returns the cycle of a G code in tenths.
    pub(crate) const fn of_g(tenths: u16) -> Option<DrillingCycle> {
        Some(match tenths {
            730 => DrillingCycle::ChipBreaking,
            740 => DrillingCycle::LeftTapping,
            810 => DrillingCycle::Drilling,
            820 => DrillingCycle::DrillingWithDwell,
            830 => DrillingCycle::PeckDrilling,
            840 => DrillingCycle::RightTapping,
            850 => DrillingCycle::Boring,
            860 => DrillingCycle::BoringSpindleStop,
            870 => DrillingCycle::BackBoring,
            880 => DrillingCycle::BoringManual,
            890 => DrillingCycle::BoringWithDwell,
            _ => return None,
        })
    }

    /// Returns the G code in tenths.
    #[must_use]
    pub const fn tenths(self) -> u16 {
        match self {
            DrillingCycle::ChipBreaking => 730,
            DrillingCycle::LeftTapping => 740,
            DrillingCycle::Drilling => 810,
            DrillingCycle::DrillingWithDwell => 820,
            DrillingCycle::PeckDrilling => 830,
            DrillingCycle::RightTapping => 840,
            DrillingCycle::Boring => 850,
            DrillingCycle::BoringSpindleStop => 860,
            DrillingCycle::BackBoring => 870,
            DrillingCycle::BoringManual => 880,
            DrillingCycle::BoringWithDwell => 890,
        }
    }

    /// Returns the notation.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            DrillingCycle::ChipBreaking => "G73",
            DrillingCycle::LeftTapping => "G74",
            DrillingCycle::Drilling => "G81",
            DrillingCycle::DrillingWithDwell => "G82",
            DrillingCycle::PeckDrilling => "G83",
            DrillingCycle::RightTapping => "G84",
            DrillingCycle::Boring => "G85",
            DrillingCycle::BoringSpindleStop => "G86",
            DrillingCycle::BackBoring => "G87",
            DrillingCycle::BoringManual => "G88",
            DrillingCycle::BoringWithDwell => "G89",
        }
    }

    /// Whether the cycle needs a dwell (P).
    pub(crate) const fn needs_dwell(self) -> bool {
        matches!(
            self,
            DrillingCycle::DrillingWithDwell
                | DrillingCycle::BoringSpindleStop
                | DrillingCycle::BoringManual
                | DrillingCycle::BoringWithDwell
        )
    }

    /// Whether the cycle accepts a dwell (P).
    pub(crate) const fn takes_dwell(self) -> bool {
        self.needs_dwell() || matches!(self, DrillingCycle::LeftTapping | DrillingCycle::RightTapping)
    }

    /// Whether the cycle works in pecks (Q).
    pub(crate) const fn has_pecks(self) -> bool {
        matches!(self, DrillingCycle::ChipBreaking | DrillingCycle::PeckDrilling)
    }
}

/// Words of a cycle that later blocks may omit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CycleWords {
    /// R: level down to which the tool moves at rapid rate.
    pub clearance: Option<f64>,
    /// Word of the plane's normal axis: the bottom.
    pub bottom: Option<f64>,
    /// P: dwell at the bottom, in seconds.
    pub dwell: Option<f64>,
    /// Q: depth of one peck.
    pub peck: Option<f64>,
    /// I, J, K of G87.
    pub offsets: [Option<f64>; 3],
}

impl CycleWords {
    /// Returns these words, with those of `previous` where one is missing.
    #[must_use]
    pub(crate) fn or(self, previous: &CycleWords) -> CycleWords {
        let [i, j, k] = self.offsets;
        CycleWords {
            clearance: self.clearance.or(previous.clearance),
            bottom: self.bottom.or(previous.bottom),
            dwell: self.dwell.or(previous.dwell),
            peck: self.peck.or(previous.peck),
            offsets: [i.or(previous.offsets[0]), j.or(previous.offsets[1]), k.or(previous.offsets[2])],
        }
    }
}

/// A series of holes: cycles without another motion between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrillingSeries {
    /// Plane of the holes.
    pub plane: Plane,
    /// Position of the normal axis before the first hole. It is a program coordinate that does not change with an
    /// offset.
    pub initial_level: f64,
    /// Words of the last block.
    pub words: CycleWords,
}

impl DrillingSeries {
    /// Converts the lengths to another unit.
    pub(crate) fn scale_lengths(&mut self, factor: f64) {
        self.initial_level *= factor;
        let CycleWords { clearance, bottom, peck, offsets: [i, j, k], .. } = &mut self.words;
        for length in [clearance, bottom, peck, i, j, k].into_iter().flatten() {
            *length *= factor;
        }
    }
}
