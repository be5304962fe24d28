//! The command's own table of boards, compared with the identities of this firmware.
//!
//! Invariant: `retrace machine check FILE --card BOARD` checks against what the board itself reports.

use crate::stm32f4::period::{MIN_PERIOD_F401_US, MIN_PERIOD_F405_US, MIN_PERIOD_F411_US};
use crate::{rp2040, stm32f4};

#[path = "../../cli/src/known_boards.rs"]
#[allow(unreachable_pub)]
mod known_boards;

#[test]
fn the_command_knows_the_boards_as_they_are() {
    let boards = [
        ("pico", rp2040::identity(rp2040::Chip::Rp2040)),
        ("pico2", rp2040::identity(rp2040::Chip::Rp2350)),
        ("f401", stm32f4::identity(MIN_PERIOD_F401_US)),
        ("f405", stm32f4::identity(MIN_PERIOD_F405_US)),
        ("f411", stm32f4::identity(MIN_PERIOD_F411_US)),
    ];
    assert_eq!(known_boards::NAMES, boards.map(|(name, _)| name));
    for (name, identity) in boards {
        assert_eq!(known_boards::identity(name), Some(identity), "{name}");
    }
    assert_eq!(known_boards::identity("f103"), None);
    for (name, identity) in boards {
        let expected = name.starts_with("pico").then_some(known_boards::EncoderInputs {
            count: rp2040::pins::SPINDLE_INPUTS,
            max_counts_hz: rp2040::spindle_decoder::MAX_COUNTS_HZ,
        });
        assert_eq!(known_boards::encoder_inputs(&identity), expected, "{name}");
    }
}
