//! The layer: the height of a cutter over the sheet, added to the recorded path of the tool axis (CUT-15).
//!
//! The machine is at the counts of the path plus the layer. Moves of the layer are no records: they are parts of the
//! instruction that starts or ends a cut, and change no place of the path.
//!
//! Invariant: a layer is within ± [`MAX_LAYER`] pulses.

use crate::height_control::{HeightControls, MAX_LAYER};

/// Settings of the layer: the axis, and how the sheet is sensed. Its limits are those of the axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct LayerSettings {
    /// The tool axis, from 0. Its counts rise away from the sheet.
    pub axis: u8,
    /// Inputs that close when the tool touches the sheet, one bit each.
    pub contacts: u16,
    /// Speed toward the sheet, in units of 2⁻¹⁶ pulses per period.
    pub probe_speed: u32,
    /// Speed off the sheet, in the same unit.
    pub latch_speed: u32,
}

/// Ohmic contacts, which close when the tip touches the sheet, before the other contacts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct OhmicSensing {
    /// Those of [`LayerSettings::contacts`] that are such, one bit each. 0: none.
    pub inputs: u16,
    /// Number of times that the sheet is sensed again where none of them closes before another contact. Behind them the
    /// sheet is where the latter opens.
    pub tries: u8,
    /// Distance from the layer at which one of them opens down to the one at which the other contacts would, in pulses.
    pub drop: i32,
}

/// Where a start has the height of the sheet from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SheetSource {
    /// It senses the sheet, with these ohmic contacts.
    Sensed(OhmicSensing),
    /// The sheet that an earlier start found counts, if nothing has happened since; otherwise this one senses it, and
    /// what it finds counts for no later one.
    Kept(OhmicSensing),
    /// The sheet is at this layer, where the tool was over it before: nothing is sensed (CUT-54).
    Known(i32),
}

/// Moves of the layer in an instruction, in pulses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LayerMove {
    /// Before anything is switched, the sheet is found and the tool brought over it. Behind the pierce it goes to the
    /// height of the cut (CUT-13).
    Start {
        /// Layer from which the sheet is sensed, and the highest one in the cut.
        start: i32,
        /// Layer at which a sheet that was not found is missing.
        lowest: i32,
        /// Height over the sheet while the cutter is started.
        pierce: i32,
        /// Height over the sheet with which the cut begins.
        cut: i32,
        /// How the sheet is found.
        sheet: SheetSource,
        /// Control of the height behind it.
        control: HeightControls,
    },
    /// Behind the switching the tool goes to this height over the sheet; where no sheet is known, to `highest`.
    OverSheet {
        /// Height over the sheet.
        height: i32,
        /// Highest layer.
        highest: i32,
    },
    /// Behind the switching the layer goes to this value.
    To {
        /// The layer.
        layer: i32,
    },
}

impl LayerMove {
    /// Whether every value is within ± [`MAX_LAYER`].
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let values = match *self {
            Self::Start { start, lowest, pierce, cut, sheet, .. } => {
                let (SheetSource::Sensed(OhmicSensing { drop: last, .. })
                | SheetSource::Kept(OhmicSensing { drop: last, .. })
                | SheetSource::Known(last)) = sheet;
                [start, lowest, pierce, cut, last]
            }
            Self::OverSheet { height, highest } => [height, highest, 0, 0, 0],
            Self::To { layer } => [layer, 0, 0, 0, 0],
        };
        values.iter().all(|value| value.unsigned_abs() <= MAX_LAYER)
    }
}
