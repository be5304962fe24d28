//! Questions before the machine moves in setup: what a frame goes round, and probing cycles in words.

use super::{ScreenFixture, text};
use crate::UiCommand;
use crate::keys::Key;

#[test]
fn a_frame_is_traced_by_a_key_in_setup_after_saying_what_it_goes_round() {
    use retrace_controller::FrameShape::{Outline, Rectangle};
    for (key, shape, what) in [('F', Rectangle, "the rectangle around what is cut"), ('U', Outline, "the outline of")] {
        let mut bench = ScreenFixture::new();
        assert_eq!(bench.key(Key::Char(key)), None);
        let shown = text(&bench.screen(80, 24));
        assert!(shown.contains(what) && shown.contains("cutters off"), "{shown}");
        assert_eq!(bench.key(Key::Char(key)), None, "the key that has asked does not answer");
        assert_eq!((bench.key(Key::Char(key)), bench.key(Key::Char('y'))), (None, Some(UiCommand::Frame(shape))));
    }
}

#[test]
fn a_probing_cycle_is_entered_in_words_and_called_as_an_mdi_block() {
    let mut bench = ScreenFixture::new();
    bench.keys("P");
    bench.keys("bore 20");
    bench.key(Key::Enter);
    let shown = text(&bench.screen(80, 24));
    assert!(shown.contains("! enter bore DIAMETER DEPTH") && shown.contains("the probe MOVES"), "{shown}");
    assert!(shown.contains("outside-corner x+ y+ OUT DEPTH") && shown.contains("calibrate DIAMETER DEPTH"), "{shown}");
    bench.keys(" 5 g55");
    let block = "o<probe_bore> call [20 / [1 + 24.4 * #<_imperial>]] [5 / [1 + 24.4 * #<_imperial>]] [2]";
    assert_eq!(bench.key(Key::Enter), Some(UiCommand::Task(retrace_controller::ManualTask::Mdi(block.into()))));
}
