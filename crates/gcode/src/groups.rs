//! Modal groups: the known codes, and which of them exclude each other in one block.
//!
//! Invariant: every G and M code of LinuxCNC's RS274/NGC is listed here except M98 and M99, which are not words of a
//! block.

/// Modal groups of G codes, numbered as in RS274/NGC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum GroupG {
    NonModal = 0,
    Motion = 1,
    Plane = 2,
    Distance = 3,
    ArcCentres = 4,
    FeedMode = 5,
    Units = 6,
    CutterCompensation = 7,
    ToolOffset = 8,
    Retract = 10,
    CoordinateSystem = 12,
    PathControl = 13,
    SpindleMode = 14,
    LatheDiameter = 15,
}

/// Modal groups of M codes, numbered as in RS274/NGC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum GroupM {
    Stop = 4,
    Output = 5,
    Tool = 6,
    Spindle = 7,
    Coolant = 8,
    Override = 9,
    User = 10,
}

/// A G code in tenths: G61.1 is 611.
pub(crate) type Tenths = u16;

/// Returns the group of a G code.
pub(crate) const fn group_of_g(tenths: Tenths) -> Option<GroupG> {
    use GroupG as G;
    Some(match tenths {
        0 | 10 | 20 | 30 | 800 => G::Motion,
        700 | 710..=712 | 720..=722 => G::Motion,
        330 | 331 | 760 | 730 | 740 | 810 | 820 | 830 | 840 | 850 | 860 | 870 | 880 | 890 => G::Motion,
        50..=53 | 382..=385 => G::Motion,
        70 | 80 => G::LatheDiameter,
        40 | 100 | 280 | 281 | 300 | 301 | 520 | 530 | 920 | 921 | 922 | 923 => G::NonModal,
        170 | 180 | 190 | 171 | 181 | 191 => G::Plane,
        200 | 210 => G::Units,
        400 | 410 | 411 | 420 | 421 => G::CutterCompensation,
        430 | 431 | 432 | 490 => G::ToolOffset,
        540 | 550 | 560 | 570 | 580 | 590..=593 => G::CoordinateSystem,
        610 | 611 | 640 => G::PathControl,
        900 | 910 => G::Distance,
        901 | 911 => G::ArcCentres,
        930 | 940 | 950 => G::FeedMode,
        960 | 970 => G::SpindleMode,
        980 | 990 => G::Retract,
        _ => return None,
    })
}

/// Returns the group of an M code.
pub(crate) const fn group_of_m(code: u8) -> Option<GroupM> {
    use GroupM as M;
    Some(match code {
        0 | 1 | 2 | 30 | 60 => M::Stop,
        62..=68 => M::Output,
        6 | 61 => M::Tool,
        // M70 to M73 share a group with the spindle codes, as in LinuxCNC.
        3..=5 | 19 | 70..=73 => M::Spindle,
        7..=9 => M::Coolant,
        48..=53 => M::Override,
        100..=199 => M::User,
        _ => return None,
    })
}
