//! Questions before the machine moves in setup: what a frame goes round, and probing cycles in words.

use retrace_controller::{ManualTask, OperatorCommand};

use super::{ScreenFixture, text};
use crate::key_state::OpenDialog;
use crate::keys::Key;
use crate::pending_question::PendingQuestion;
use crate::{UiCommand, lock_model};

#[test]
fn a_frame_is_traced_by_a_key_in_setup_after_saying_what_it_goes_round() {
    use retrace_controller::FrameShape::{Outline, Rectangle};
    for (key, shape, what) in
        [('F', Rectangle, "the rectangle around what is cut"), ('U', Outline, "the tight hull of")]
    {
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
    assert_eq!(bench.key(Key::Enter), Some(UiCommand::Task(ManualTask::Mdi(block.into()))));
}

/// The second press of a continuous jog stops it, and one that the keyboard repeats changes nothing.
#[test]
fn a_continuous_jog_is_stopped_by_a_second_press() {
    let mut bench = ScreenFixture::new();
    bench.keys("tt");
    assert!(text(&bench.screen(80, 24)).contains("continuous: again stops it"));
    let begins = UiCommand::Task(ManualTask::JogOn { axis: 'x', up: true });
    bench.wait(1_000);
    assert_eq!(bench.key(Key::Right), Some(begins));
    for _ in 0..3 {
        bench.wait(40);
        assert_eq!(bench.key(Key::Right), None);
    }
    // In motion each press stops it, however fast they follow each other, and none begins it again.
    for (waits_ms, key) in [(40, Key::Right), (40, Key::Left), (500, Key::Right)] {
        bench.wait(waits_ms);
        lock_model(&bench.model).at_rest = false;
        assert_eq!(bench.key(key), Some(UiCommand::Job(OperatorCommand::Hold)), "{waits_ms}");
    }
    lock_model(&bench.model).at_rest = true;
    assert_eq!(bench.key(Key::Right), None);
}

/// What two points on the edge of a sheet would set is lost by no key but those that say so.
#[test]
fn points_on_the_edge_of_a_sheet_are_forgotten_by_esc_alone() {
    for (count, key) in [(1, Key::Esc), (1, Key::Char('q')), (2, Key::Esc), (2, Key::Char('n'))] {
        let mut bench = ScreenFixture::new();
        lock_model(&bench.model).sheet_points = vec![[60.0, 40.0], [260.0, 50.0]][..count].to_vec();
        if count == 2 {
            bench.keys("E");
            assert_eq!((bench.key(Key::Left), bench.key(Key::Char('c'))), (None, None));
        }
        assert_eq!(bench.key(key), Some(UiCommand::ForgetSheet), "{count} {key:?}");
    }
}

/// A turn of an earlier job is asked about once; one that was set here is not, and a released job ends the answer.
#[test]
fn a_turn_of_an_earlier_job_is_asked_about_before_the_start() {
    let mut bench = ScreenFixture::new();
    let turn = |bench: &ScreenFixture, degrees| lock_model(&bench.model).work_rotation_deg = degrees;
    turn(&bench, 2.862);
    assert_eq!(bench.key(Key::Char('c')), None);
    let shown = text(&bench.screen(80, 24));
    assert!(shown.contains("TURNED by +2.862°") && shown.contains("the same sheet?"), "{shown}");
    assert_eq!(bench.key(Key::Char('n')), None);
    bench.key_state.open = OpenDialog::Prompt(PendingQuestion::StartContour(2), String::new(), None);
    assert!(text(&bench.screen(80, 24)).contains("TURNED by +2.862°"), "wherever it begins");
    bench.key(Key::Esc);
    let end_of_turn = UiCommand::Task(ManualTask::Mdi("G10 L2 P0 R0".into()));
    bench.keys("zstraight");
    assert_eq!(bench.key(Key::Enter), Some(end_of_turn));
    bench.keys("c");
    assert_eq!(bench.key(Key::Char('y')), Some(UiCommand::Start));
    assert_eq!(bench.key_state.key(Key::Char('c'), 0, &in_setup(&bench)), Some(UiCommand::Start), "it was answered");
    // Set anew: no question.
    let mut model = in_setup(&bench);
    model.sheet_points = vec![[60.0, 40.0], [260.0, 50.0]];
    assert_eq!(bench.key_state.key(Key::Char('E'), 0, &model), None);
    assert_eq!(bench.key_state.key(Key::Char('y'), 0, &model), Some(UiCommand::AlignSheet));
    model.sheet_points.clear();
    model.work_rotation_deg = 1.0;
    assert_eq!(bench.key_state.key(Key::Char('c'), 0, &model), Some(UiCommand::Start));
    model.work_rotation_deg = 3.0;
    assert_eq!(bench.key_state.key(Key::Char('c'), 0, &model), None, "another one than was set");
}

/// What the fixture shows, with no job begun.
fn in_setup(bench: &ScreenFixture) -> crate::ScreenModel {
    crate::ScreenModel { stage: crate::ScreenStage::Setup, at_rest: true, ..bench.picture() }
}
