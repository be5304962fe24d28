//! Jogs at the screen: which press of a key is a step, which one goes on, and what is said of them.

use std::sync::{Arc, Mutex};

use retrace_controller::{
    AxisCounts, DncEvent, DncFlags, DncStep, Event, EventKind, JogSpeed, ManualTask, Observer, OperatorCommand,
    Telemetry,
};
use retrace_core::Place;

use super::{ScreenFixture, text, with_messages};
use crate::keys::Key;
use crate::{ModelObserver, ScreenModel, UiCommand, lock_model};

/// Presses a key at these times, ms, with the machine in setup. Returns what it does each time: `S`tep, `h`eld, or `.`
/// nothing.
fn jog(bench: &mut ScreenFixture, key: Key, times_ms: &[u64]) -> String {
    let model = in_setup(bench);
    let mut done = String::new();
    for &ms in times_ms {
        done.push(letter(bench.key_state.key(key, ms, &model)));
    }
    done
}

/// What a jog key does, as a letter.
fn letter(command: Option<UiCommand>) -> char {
    match command {
        Some(UiCommand::Task(ManualTask::Jog { axis: 'x', mm: 1.0 })) => 'S',
        Some(UiCommand::JogHeld { axis: 'x', up: true, speed: JogSpeed::Full }) => 'h',
        Some(UiCommand::JogHeld { axis: 'x', up: true, speed: JogSpeed::Slow }) => 'l',
        Some(UiCommand::Task(ManualTask::Jog { axis: 'x', mm: 0.1 })) => 's',
        None => '.',
        other => panic!("{other:?}"),
    }
}

/// A tap is a step, however fast taps follow each other; a jog goes on only while the key repeats itself.
#[test]
fn a_continuous_jog_is_held_and_a_tap_is_a_step() {
    let mut bench = ScreenFixture::new();
    let model = in_setup(&bench);
    for _ in 0..2 {
        assert_eq!(bench.key_state.key(Key::Char('t'), 0, &model), None);
    }
    lock_model(&bench.model).stage = crate::ScreenStage::Setup;
    assert!(text(&bench.screen(80, 24)).contains(" mm/min · a tap 1 mm"));
    assert_eq!(jog(&mut bench, Key::Right, &[1_000, 1_130, 1_260, 1_500]), "SSSS", "taps");
    // Held: the keyboard begins to repeat after half a second, then every 40 ms. A gap ends it.
    assert_eq!(jog(&mut bench, Key::Right, &[3_000, 3_500, 3_540, 3_580, 3_620, 3_770, 3_940]), "SSShhhS");
    // What comes at once was delayed on its way, and is one press.
    assert_eq!(jog(&mut bench, Key::Right, &[6_000, 6_001, 6_002, 6_003, 6_004]), "S....");
    // Behind another key, a key that is still held begins nothing.
    assert_eq!(jog(&mut bench, Key::Right, &[8_000, 8_040, 8_080]), "SSh");
    assert_eq!(bench.key_state.key(Key::Char('g'), 8_090, &model), Some(UiCommand::JogReleased), "at once");
    assert_eq!(bench.key_state.key(Key::Esc, 8_095, &model), None);
    assert_eq!(jog(&mut bench, Key::Right, &[8_120, 8_160, 8_200, 8_400]), "...S");
}

/// Where the terminal reports repeats and releases, the first repeat begins the jog and the release ends it.
#[test]
fn a_terminal_that_reports_the_release_of_a_key_ends_its_jog() {
    let mut bench = ScreenFixture::new();
    let model = in_setup(&bench);
    bench.key_state.step = 4;
    assert_eq!(bench.key_state.repeat(Key::Right, 900, &model), None, "its press was not seen");
    assert_eq!(jog(&mut bench, Key::Right, &[1_000]), "S");
    let repeat = |bench: &mut ScreenFixture, ms| letter(bench.key_state.repeat(Key::Right, ms, &model));
    assert_eq!((repeat(&mut bench, 1_400), repeat(&mut bench, 1_440)), ('h', 'h'));
    assert_eq!(bench.key_state.release(Key::Left), None);
    assert_eq!(bench.key_state.release(Key::Right), Some(UiCommand::JogReleased));
    // Taps that follow each other fast are steps: each of them ends.
    for ms in [1_480, 1_560, 1_640, 1_720] {
        assert_eq!(jog(&mut bench, Key::Right, &[ms]), "S");
        let _ = bench.key_state.release(Key::Right);
    }
    assert_eq!((jog(&mut bench, Key::Right, &[1_800]), repeat(&mut bench, 2_200)), ("S".into(), 'h'));
    // Space holds the machine: nothing begins before the key was released and pressed again.
    assert!(bench.key_state.key(Key::Char(' '), 2_210, &model).is_some());
    assert_eq!((repeat(&mut bench, 2_240), repeat(&mut bench, 2_700)), ('.', '.'));
    let _ = bench.key_state.release(Key::Right);
    assert_eq!(jog(&mut bench, Key::Right, &[2_800]), "S");
}

/// Another key ends what a jog key holds, and its repeats move nothing more until it was let go.
#[test]
fn another_key_ends_a_held_jog_until_its_key_was_let_go() {
    let mut bench = ScreenFixture::new();
    bench.key_state.step = 4;
    let model = in_setup(&bench);
    let press = |bench: &mut ScreenFixture, key, ms| bench.key_state.key(key, ms, &model);
    assert_eq!(jog(&mut bench, Key::Right, &[1_000, 1_040, 1_080]), "SSh");
    // Another axis: its press ends the first jog, whose repeats neither go on nor end the second one.
    assert!(matches!(press(&mut bench, Key::Up, 1_090), Some(UiCommand::Task(_))));
    assert_eq!(jog(&mut bench, Key::Right, &[1_120]), ".");
    assert!(matches!(press(&mut bench, Key::Up, 1_130), Some(UiCommand::Task(_))));
    assert_eq!(jog(&mut bench, Key::Right, &[1_160]), ".");
    for ms in [1_170, 1_210, 1_250] {
        assert_eq!(
            press(&mut bench, Key::Up, ms),
            Some(UiCommand::JogHeld { axis: 'y', up: true, speed: JogSpeed::Full })
        );
        assert_eq!(jog(&mut bench, Key::Right, &[ms + 20]), ".");
    }
    assert_eq!(bench.key_state.release(Key::Right), None, "the jog of the other key goes on");
    assert_eq!(bench.key_state.release(Key::Up), Some(UiCommand::JogReleased));
    // Another step: the arrow that is still held does not creep by it.
    assert_eq!(jog(&mut bench, Key::Right, &[3_000, 3_040, 3_080]), "SSh");
    for ms in [3_090, 3_100, 3_110, 3_115] {
        let _ = press(&mut bench, Key::Char('t'), ms);
    }
    assert_eq!(bench.key_state.step, 2);
    assert_eq!(jog(&mut bench, Key::Right, &[3_120, 3_160, 3_200, 3_240, 3_400, 3_440]), "....SS");
    assert_eq!(press(&mut bench, Key::Char('v'), 3_450), None, "no jog was held");
    let reported = bench.key_state.repeat(Key::Right, 3_950, &model);
    assert_eq!(reported, None, "a terminal that reports repeats");
}

/// Behind the held jog comes one at a tenth of its speed, whose tap is a tenth of a step.
#[test]
fn a_held_jog_can_be_slow() {
    let mut bench = ScreenFixture::new();
    bench.key_state.step = 4;
    let model = in_setup(&bench);
    assert_eq!(bench.key_state.key(Key::Char('t'), 0, &model), None);
    assert_eq!(jog(&mut bench, Key::Right, &[1_000, 1_500, 1_540, 1_580, 1_620]), "sssll");
    let shown = text(&bench.screen(100, 30));
    assert!(shown.contains("jog held: slow 300 mm/min · a tap 0.1 mm"), "{shown}");
    assert_eq!(bench.key_state.key(Key::Char('t'), 5_000, &model), None);
    let shown = text(&bench.screen(100, 30));
    assert!(shown.contains("jog step 0.01 mm"), "{shown}");
}

/// The held jog says how fast it goes; an axis of another speed is named.
#[test]
fn a_held_jog_says_its_speed() {
    let mut bench = ScreenFixture::new();
    bench.key_state.step = 4;
    let mut facts = (*lock_model(&bench.model).facts).clone();
    for (axis, mm_s) in facts.axes.iter_mut().zip([100.0, 100.0, 25.0]) {
        axis.jog_mm_s = mm_s;
    }
    lock_model(&bench.model).facts = facts.clone().into();
    let shown = text(&bench.screen(100, 30));
    assert!(shown.contains("jog held: 6000, Z 1500 mm/min · a tap 1 mm"), "{shown}");
    facts.axes[2].jog_mm_s = 100.0;
    lock_model(&bench.model).facts = facts.into();
    let shown = text(&bench.screen(80, 24));
    assert!(shown.contains("jog held: 6000 mm/min · a tap 1 mm"), "{shown}");
}

/// In a pause a jog is a step, which is recorded.
#[test]
fn a_jog_in_a_pause_is_a_step() {
    let mut bench = ScreenFixture::new();
    bench.key_state.step = 4;
    let mut model = bench.picture();
    (model.stage, model.pause) = (crate::ScreenStage::Job, Some(crate::Pause::default()));
    let step = Some(UiCommand::Job(OperatorCommand::Jog { axis: 'x', mm: 1.0 }));
    for ms in [0, 40, 80, 120] {
        assert_eq!(bench.key_state.key(Key::Right, ms, &model), step);
    }
}

/// A jog that its key has held ends with the key: no hold, and nothing early.
#[test]
fn a_jog_that_ends_with_its_key_is_no_feed_hold() {
    for (is_jog_released, expected) in [
        (true, vec!["X moved by 12.500 mm while its key was held"]),
        (false, vec!["operator: feed hold", "X moved by 12.500 mm, stopped early"]),
    ] {
        let model = ScreenModel { is_jog_released, ..with_messages(&[]) };
        let model = Arc::new(Mutex::new(model));
        let mut observer = ModelObserver::new(Arc::clone(&model));
        let step = DncStep::Jogged { axis: 'x', mm: 12.5, cut_short: true, off: AxisCounts::default() };
        for kind in
            [EventKind::Operator(OperatorCommand::Hold), EventKind::Dnc(DncEvent { step, flags: DncFlags::default() })]
        {
            let event = Event { period: 1, time_s: 0.001, place: Place::default(), line: 0, kind };
            Observer::<3>::on_telemetry(&mut observer, &Telemetry::Event(event));
        }
        let texts: Vec<String> = lock_model(&model).messages.iter().map(|message| message.text.clone()).collect();
        assert_eq!(texts, expected);
    }
}

/// What the fixture shows, with no job begun.
pub(super) fn in_setup(bench: &ScreenFixture) -> ScreenModel {
    ScreenModel { stage: crate::ScreenStage::Setup, at_rest: true, ..bench.picture() }
}
