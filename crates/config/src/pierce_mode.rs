//! What a run does with the pierces of its program: `--pierces only`, and `--pierces done` (CUT-63).
//!
//! Invariant: a mode is read back as it is written.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Maximum offset of the pierces, in mm.
const MAX_OFFSET_MM: f64 = 100.0;

/// What a run does with the pierces of its program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum PierceMode {
    /// It pierces and cuts.
    #[default]
    Usual,
    /// It pierces each contour, and cuts nothing.
    Only {
        /// Offset of the holes from the starts of the contours in X and Y of the work coordinates, in µm.
        offset_um: [i32; 2],
    },
    /// The holes are there: each contour is cut from its start without the time and height of a pierce.
    Done,
}

impl PierceMode {
    /// Whether nothing is cut.
    #[must_use]
    pub const fn cuts_nothing(self) -> bool {
        matches!(self, Self::Only { .. })
    }

    /// Offset of the program in X and Y of the work coordinates, in mm.
    #[must_use]
    pub fn offset_mm(self) -> [f64; 2] {
        match self {
            Self::Only { offset_um } => offset_um.map(|um| f64::from(um) / 1000.0),
            _ => [0.0; 2],
        }
    }
}

impl fmt::Display for PierceMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Usual => f.write_str("usual"),
            Self::Only { offset_um: [0, 0] } => f.write_str("only"),
            Self::Only { .. } => {
                let [x, y] = self.offset_mm();
                write!(f, "only:{x},{y}")
            }
            Self::Done => f.write_str("done"),
        }
    }
}

impl FromStr for PierceMode {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let um =
            |mm: &str| mm.parse::<f64>().ok().filter(|mm| mm.abs() <= MAX_OFFSET_MM).map(|mm| (mm * 1000.0).round());
        match text.split_once(':') {
            None if text == "usual" => Ok(Self::Usual),
            None if text == "only" => Ok(Self::Only { offset_um: [0; 2] }),
            None if text == "done" => Ok(Self::Done),
            Some(("only", offset)) => {
                let offset = offset.split_once(',').and_then(|(x, y)| Some([um(x)? as i32, um(y)? as i32]));
                offset.map(|offset_um| Self::Only { offset_um }).ok_or_else(|| {
                    format!("`{text}`: an offset is X,Y in mm, at most {MAX_OFFSET_MM}, as in only:1.5,-1.5")
                })
            }
            _ => Err(format!("`{text}` is none of `usual`, `only`, `only:X,Y` and `done`")),
        }
    }
}

impl TryFrom<String> for PierceMode {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<PierceMode> for String {
    fn from(mode: PierceMode) -> Self {
        mode.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mode_is_read_back_as_it_is_written() {
        for text in ["usual", "only", "only:1.5,-0.25", "done"] {
            assert_eq!(text.parse::<PierceMode>().expect(text).to_string(), text);
        }
        assert_eq!("only:1.5,-0.25".parse(), Ok(PierceMode::Only { offset_um: [1500, -250] }));
        for wrong in ["", "on", "only:", "only:1", "only:1,2,3", "only:nan,0", "only:101,0", "done:1,1"] {
            assert!(wrong.parse::<PierceMode>().is_err(), "{wrong}");
        }
    }
}
