//! Styles of drawings: colours, pens and letter sizes.
//!
//! The colours are those of Okabe and Ito, which colour-blind readers tell apart; what matters differs in shape or dash
//! too, so that it survives a black and white printer.

use crate::picture::{Anchor, Colour, Pen, Point, Text};

pub(crate) const INK: Colour = Colour([0x22, 0x22, 0x22, 0xff]);
pub(crate) const PALE_INK: Colour = Colour([0x44, 0x44, 0x44, 0xff]);
pub(crate) const PAPER: Colour = Colour([0xff, 0xff, 0xff, 0xff]);
pub(crate) const START: Colour = Colour([0x00, 0x9e, 0x73, 0xff]);
pub(crate) const END: Colour = Colour([0xd5, 0x5e, 0x00, 0xff]);
pub(crate) const RETRACED_BAND: Colour = Colour([0xe6, 0x9f, 0x00, 0x40]);
pub(crate) const STANDING_BAND: Colour = Colour([0x88, 0x88, 0x88, 0x38]);

pub(crate) const FRAME: Pen = Pen { colour: INK, width: 1.0, dash: None };
pub(crate) const GRID: Pen = Pen { colour: Colour([0xe4, 0xe4, 0xe4, 0xff]), width: 1.0, dash: None };
pub(crate) const FEED: Pen = Pen { colour: Colour([0x00, 0x4f, 0x8c, 0xff]), width: 1.5, dash: None };
pub(crate) const RAPID: Pen = Pen { colour: Colour([0x8c, 0x8c, 0x8c, 0xff]), width: 1.0, dash: Some([5.0, 4.0]) };
pub(crate) const RETRACED: Pen = Pen { colour: Colour([0xe6, 0x9f, 0x00, 0x90]), width: 8.0, dash: None };
/// Retraced motion over time; heavier than normal run, so that print shows the difference.
pub(crate) const GONE_OVER: Pen = Pen { colour: Colour([0xb3, 0x5c, 0x00, 0xff]), width: 2.8, dash: Some([7.0, 3.5]) };
/// Furthest place ever executed.
pub(crate) const REACHED: Pen = Pen { colour: PALE_INK, width: 1.0, dash: Some([2.0, 3.0]) };
/// Line from a label to its place.
pub(crate) const LEADER: Pen = Pen { colour: Colour([0x77, 0x77, 0x77, 0xff]), width: 0.8, dash: None };
pub(crate) const LIMIT: Pen = Pen { colour: INK, width: 1.2, dash: Some([7.0, 4.0]) };
pub(crate) const PATH_SPEED: Pen = Pen { colour: INK, width: 1.8, dash: None };

/// Pens of the axes, in their order; after the last they repeat.
pub(crate) const AXES: [Pen; 4] = [
    Pen { colour: Colour([0x00, 0x72, 0xb2, 0xff]), width: 1.3, dash: None },
    Pen { colour: Colour([0xd5, 0x5e, 0x00, 0xff]), width: 1.3, dash: None },
    Pen { colour: Colour([0x00, 0x9e, 0x73, 0xff]), width: 1.3, dash: None },
    Pen { colour: Colour([0xcc, 0x79, 0xa7, 0xff]), width: 1.3, dash: None },
];

/// Letter sizes in pixels.
pub(crate) const TITLE_SIZE: f32 = 17.0;
pub(crate) const LABEL_SIZE: f32 = 13.0;
pub(crate) const TICK_SIZE: f32 = 12.1;

/// Ordinary text with its base line through `at`.
pub(crate) fn text(at: Point, words: impl Into<String>, size: f32, anchor: Anchor) -> Text {
    Text { at, words: words.into(), size, anchor, colour: INK, is_upward: false, is_bold: false }
}
