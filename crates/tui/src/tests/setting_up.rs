//! Questions before the machine moves in setup: what a frame goes round, and probing cycles in words.

use retrace_config::MachineConfig;
use retrace_controller::ManualTask;

use super::jogging::in_setup;
use super::{ScreenFixture, text};
use crate::key_state::OpenDialog;
use crate::keys::Key;
use crate::pending_question::PendingQuestion;
use crate::{ScreenStage, UiCommand, lock_model};

#[test]
fn a_frame_is_traced_by_a_key_in_setup_after_saying_what_it_goes_round() {
    use retrace_controller::FrameShape::{Outline, Rectangle};
    for (key, shape, what) in
        [('F', Rectangle, "the rectangle around what is cut"), ('U', Outline, "the tight outline of")]
    {
        let mut bench = ScreenFixture::new();
        assert_eq!(bench.key(Key::Char(key)), None);
        let shown = text(&bench.screen(80, 24));
        assert!(shown.contains(what) && shown.contains("cutters off"), "{shown}");
        assert_eq!(bench.key(Key::Char(key)), None, "the key that has asked does not answer");
        assert_eq!((bench.key(Key::Char(key)), bench.key(Key::Char('y'))), (None, Some(UiCommand::Frame(shape))));
    }
}

/// Over the sheet, the height counts: that of the tool, where no safe height is set.
#[test]
fn the_question_of_a_frame_says_at_which_height_it_is_traced() {
    let axes = ["x", "y", "z"].map(|name| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = 1000\nmax_velocity_mm_per_s = 100\n\
             max_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-10, 60]\n"
        )
    });
    for (keys, z, words) in [
        ("", 0, "Z STAYS at 0.000 of the machine: no safe height is set."),
        ("tool_axis = \"z\"\n", 4_000, "Z STAYS at 4.000 of the machine: no safe height is set."),
        ("tool_axis = \"z\"\nretract_mm = 50\n", 4_000, "First up to Z 50.000 of the machine (safe height)."),
        (
            "tool_axis = \"z\"\nretract_mm = 50\n",
            55_000,
            "Z stays at 55.000 of the machine: the safe height is 50.000.",
        ),
    ] {
        let machine = MachineConfig::parse(&format!("{keys}{}", axes.concat()), "m.toml").expect("valid");
        let mut bench = ScreenFixture::of(&machine, "a.ngc", "G1 X9 F900\nM2\n");
        lock_model(&bench.model).counts[2] = z;
        assert_eq!(bench.key(Key::Char('F')), None);
        let shown = text(&bench.screen(80, 24));
        assert!(shown.contains(words), "no `{words}` in\n{shown}");
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

/// The first start is said to fire, as a recovery is.
#[test]
fn a_start_that_lights_a_cutter_is_said_to_fire() {
    use retrace_controller::ContourList;
    let torch = "[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\n";
    let second = "[[cutter]]\nname = \"second\"\nkind = \"torch\"\nfire = 1\n";
    let list = |names: &[&str]| {
        let mut list = ContourList::default();
        list.starts = names.iter().map(|name| ((*name).to_owned(), 2)).collect();
        Some(std::sync::Arc::new(list))
    };
    for (contours, dry_run, words) in [
        (list(&["torch"]), false, "a.ngc is ready — c cycle start FIRES the torch · arrows jog"),
        (list(&["torch", "second"]), false, "a.ngc is ready — c cycle start FIRES · arrows jog"),
        (list(&[]), false, "a.ngc is ready — c cycle start · arrows jog"),
        (list(&["torch"]), true, "the cutter stays off — c cycle start · arrows jog"),
        (None, false, "a.ngc is ready — c cycle start, may FIRE · arrows jog"),
    ] {
        let machine = MachineConfig::parse(&format!("{torch}{second}"), "m.toml").expect("valid");
        let facts = crate::ProgramFacts {
            check: crate::ProgramCheck::Ready,
            contours,
            ..crate::ProgramFacts::of(&machine, "a.ngc", "M2\n")
        };
        let mut model = crate::ScreenModel::new(facts.into());
        model.dry_run = dry_run;
        let shown = |model: &_| text(&super::drawn(model, &crate::key_state::KeyState::new(), 80, 24, 0));
        assert!(shown(&model).contains(words), "no `{words}` in\n{}", shown(&model));
        if words.contains("FIRES the") {
            model.manual_result = "the frame was traced, and the tool is back".into();
            assert!(shown(&model).contains("a.ngc is ready — c FIRES"), "{}", shown(&model));
        }
    }
}

/// The first point is taken after a question; the second one is followed by one.
#[test]
fn no_point_on_the_edge_of_a_sheet_is_taken_by_a_slip() {
    let mut bench = ScreenFixture::new();
    let mut model = in_setup(&bench);
    lock_model(&bench.model).stage = crate::ScreenStage::Setup;
    assert_eq!(bench.key_state.key(Key::Char('E'), 0, &model), None);
    let shown = text(&bench.screen(80, 24));
    assert!(shown.contains("y take the 1st point here") && shown.contains("nothing is set yet"), "{shown}");
    assert_eq!(bench.key_state.key(Key::Char('E'), 0, &model), None, "the key that has asked does not answer");
    assert_eq!(bench.key_state.key(Key::Char('E'), 0, &model), None);
    assert_eq!(bench.key_state.key(Key::Char('y'), 0, &model), Some(UiCommand::SheetPoint));
    model.sheet_points = vec![[60.0, 40.0]];
    assert_eq!(bench.key_state.key(Key::Char('E'), 0, &model), Some(UiCommand::SheetPoint));
    model.sheet_points.push([260.0, 50.0]);
    bench.key_state.follow(&model);
    assert!(matches!(bench.key_state.open, OpenDialog::Prompt(PendingQuestion::AlignSheet, ..)));
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

/// At rest, a machine is ready only when the order before is done: the next one is refused until then.
#[test]
fn an_order_that_is_carried_out_at_rest_is_shown() {
    let bench = ScreenFixture::new();
    let state = |manual_task, at_rest| {
        {
            let mut model = lock_model(&bench.model);
            (model.stage, model.manual_task, model.at_rest) = (ScreenStage::Setup, manual_task, at_rest);
        }
        text(&bench.screen(80, 24)).lines().take(2).collect::<String>()
    };
    let shown = state(Some("MDI block"), true);
    assert!(shown.starts_with(" BUSY") && shown.contains("MDI block; Space stops it"), "{shown}");
    assert!(state(Some("MDI block"), false).starts_with(" MOVING"));
    assert!(state(None, true).starts_with(" READY"));
}
