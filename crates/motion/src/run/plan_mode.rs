//! How a run is planned, and how often the search for a plan failed.
//!
//! Invariant: neither changes the path, and the limits hold in every mode.

/// How the speed along the path is planned. The limits hold in any mode, and the path is the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PlanMode {
    /// The plan of the look-ahead.
    #[default]
    Fast,
    /// The plan of the look-ahead, and then the fastest speed law that the axes allow on curves.
    Best,
}

/// How often the search for a plan failed and a slower plan was made instead. The plan is legal all the same, but time
/// is lost that a better search would not lose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PlanFallbacks {
    /// Sections of path for which no plan was found from any state of the plan before them: the motion comes to rest
    /// first.
    pub no_plan: u64,
    /// Those of them that begin in motion, behind a glide, and stop on their first block.
    pub stops_in_first_block: u64,
    /// Those of them that end in a glide, which is approached at a lower feed than programmed, or else is not made.
    pub approaches: u64,
}
