//! State of a cutter (CUT-2).
//!
//! Invariant: it tells what the cutter does, from the card's outputs and inputs; the program may expect something else.

/// State of a torch, jet or beam.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CutterState {
    /// Off.
    #[default]
    Off,
    /// Off: the sheet is sensed, and the tool brought to the height of the pierce.
    Sensing,
    /// It is being lit, and its input has not proved it yet; also between two attempts, and in a kerf until the arc
    /// meets metal.
    Igniting,
    /// It burns or flows, and the pierce is not over.
    Piercing,
    /// It cuts.
    Cutting,
    /// On at rest at the end of a contour.
    Ending,
    /// Off where it was to cut: its cut is interrupted.
    Lost,
    /// A dry run keeps it off.
    Dry,
    /// On for a test pulse.
    Test,
}

impl CutterState {
    /// Name of the state as an identifier.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Sensing => "sensing",
            Self::Igniting => "igniting",
            Self::Piercing => "piercing",
            Self::Cutting => "cutting",
            Self::Ending => "ending",
            Self::Lost => "lost",
            Self::Dry => "dry",
            Self::Test => "test",
        }
    }
}
