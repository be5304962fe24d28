//! The screen with arbitrary models and keys, and the time of its redraw.
//!
//! Invariant: nothing here depends on what the screen looks like but the frames of its panes.

use std::sync::{Arc, Mutex};

use proptest::prelude::*;
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use retrace_controller::{DifferingOutput, FrameShape};
use retrace_core::mode::Mode;
use retrace_core::{Place, RecordIndex};
use retrace_journal::HoldReason;

use super::{PLAIN, drawn, rows, text};
use crate::contour_page::ContourMark;
use crate::key_state::{KeyState, OpenDialog};
use crate::keys::{Key, TABLE};
use crate::model::{AlarmShown, Pause, ScreenModel, ScreenStage};
use crate::model_observer::lock_model;
use crate::pending_question::PendingQuestion;
use crate::program_facts::{AxisFacts, Planned, ProgramFacts, Text, ToolFacts};
use crate::shop_job_page::tests::{row, table};
use crate::shop_job_page::{ShopJobMark, ShopJobView};
use crate::trail::TrailPoint;
use crate::{ShopJobRow, UiCommand, layout, view};

fn place() -> impl Strategy<Value = Place> {
    (any::<u32>(), any::<u32>()).prop_map(|(record, fraction)| Place { record: RecordIndex::new(record), fraction })
}

fn mode() -> impl Strategy<Value = Mode> {
    prop::sample::select(vec![Mode::Run, Mode::Reverse, Mode::Forward, Mode::Wheel, Mode::Rejoin, Mode::AwaitOutputs])
}

prop_compose! {
    /// Arbitrary model.
    fn any_model()(
        (axes, lines, line) in (0..=9usize, 0..3000usize, 0..4000u32),
        (place, reached, oldest, planned) in (place(), any::<u32>(), any::<u32>(), any::<u32>()),
        counts in prop::collection::vec(any::<i64>(), 9),
        (mode, stage, standing) in (mode(), 0..3, 0..6),
        (rate, over) in (-8.0..8.0f64, 0.0..8.0f64),
        words in "\\PC{0,60}|[\\x00-\\x1f]{0,9}",
        outputs in prop::collection::btree_map(any::<u8>(), any::<i32>(), 0..80),
        (alarm, differ, paused) in (any::<bool>(), 0..40u8, prop::option::of((-1..2, any::<bool>(), any::<bool>()))),
        points in prop::collection::vec(prop::array::uniform3(any::<f32>()), 0..30),
        (planned_s, feed) in (prop::option::of(0.0..1e12f64), 0.0..1e9f64),
    ) -> ScreenModel {
        let letters = ['x', 'y', 'z', 'a', 'b', 'c', 'u', 'v', 'w'];
        let axis = |letter| AxisFacts { letter, pulses_per_mm: 1000.0, travel_mm: [-1.0, 1.0], jog_mm_s: 1.0 };
        let tool = ToolFacts { number: 3, diameter_mm: 1.0, length_mm: 2.0, name: words.clone() };
        let facts = ProgramFacts {
            axes: letters[..axes].iter().copied().map(axis).collect(),
            period_s: 0.001,
            program: Text::new(&words, &format!("{words} X1\n").repeat(lines)),
            planned: planned_s.map_or(Planned::Unknown, Planned::Known),
            tools: vec![tool; usize::from(differ)],
            ..ProgramFacts::default()
        };
        let mut model = ScreenModel::new(Arc::new(facts));
        model.place = place;
    [model.reached, model.oldest, model.planned] = [reached, oldest, planned].map(RecordIndex::new);
        model.counts = counts[..axes].to_vec();
        (model.mode, model.line, model.reached_line, model.rate) = (mode, line, line / 2, rate);
        (model.override_rate, model.feed_mm_min, model.outputs) = (over, feed, outputs);
        model.stage = [ScreenStage::Setup, ScreenStage::Job, ScreenStage::Ended(words.clone())][stage as usize].clone();
        model.hold_reason = [
            HoldReason::None, HoldReason::Hold, HoldReason::ProgramStop, HoldReason::SingleBlock, HoldReason::Paused,
                HoldReason::Ended,
        ][standing as usize];
        if alarm {
            let (number, cause, remedy) = ("E3012".into(), words.clone(), words.repeat(9));
            model.alarm = Some(AlarmShown { number, cause, remedy, is_refusal: differ > 20 });
        }
        model.differing_outputs = (0..differ).map(|n| DifferingOutput::new(n, 0, 1)).collect();
        model.pause = paused.map(|(spindle, stopped, online)| Pause { spindle, stopped, started: online, online });
        model.active.modal = words.repeat(3);
        for (n, at) in points.into_iter().enumerate() {
            model.trail.push(TrailPoint { along_mm: n as f64, at, rapid: n % 2 == 0 });
        }
        let rows = (0..standing as usize * 20).map(|number| ShopJobRow { note: words.clone(), ..row(number, "ready") });
        model.shop_jobs = (differ > 3).then(|| Arc::new(table(rows.collect())));
        for n in 0..9 {
            model.add_message(f64::from(n), line, words.clone());
        }
        model
    }
}

fn any_open() -> impl Strategy<Value = OpenDialog> {
    prop_oneof![
        Just(OpenDialog::Nothing),
        (0..90usize).prop_map(OpenDialog::Help),
        Just(OpenDialog::Tools),
        (prop::option::of(0..20u32), any::<u32>())
            .prop_map(|(chosen, typed)| OpenDialog::Contours(ContourMark { chosen, typed })),
        (any::<bool>(), 0..3u8, 0..99usize).prop_map(|(is_chosen, view, scrolled)| {
            let view = [ShopJobView::List, ShopJobView::Details(scrolled), ShopJobView::Start(scrolled as u32)]
                [usize::from(view)];
            OpenDialog::ShopJobs(ShopJobMark { chosen: is_chosen.then(|| row(2, "ready").id), view })
        }),
        Just(OpenDialog::Prompt(PendingQuestion::StartContour(7), String::new(), None)),
        Just(OpenDialog::Prompt(PendingQuestion::Frame(FrameShape::Rectangle), String::new(), None)),
        (0..300usize).prop_map(OpenDialog::Messages),
        "\\PC{0,300}".prop_map(|text| OpenDialog::Prompt(PendingQuestion::Mdi, text.clone(), Some(text))),
        Just(OpenDialog::Prompt(PendingQuestion::Stop, String::new(), None)),
    ]
}

fn any_key() -> impl Strategy<Value = Key> {
    let known: Vec<Key> = TABLE.iter().flat_map(|row| row.keys).copied().collect();
    let others = vec![Key::Enter, Key::Esc, Key::Backspace, Key::Char('n'), Key::Char('3')];
    prop_oneof![4 => prop::sample::select(known), 2 => prop::sample::select(others),
        1 => any::<char>().prop_map(Key::Char)]
}

proptest! {
    #[test]
    fn something_is_drawn_at_every_size_whatever_the_picture(
        model in any_model(), open in any_open(), width in 1..300u16, height in 1..100u16,
    ) {
        let mut key_state = KeyState::new();
        key_state.open = open;
        drawn(&model, &key_state, width, height, 0);
    }

    #[test]
    fn the_active_block_is_in_view_and_no_pane_is_written_over(
        model in any_model(), width in 80..300u16, height in 24..100u16,
    ) {
        let model = ScreenModel { alarm: None, differing_outputs: Vec::new(), pause: None, ..model };
        let out = drawn(&model, &KeyState::new(), width, height, 0);
        let panes = layout::panes(width, height, model.facts.axes.len()).expect("large enough");
        for pane in [panes.program, panes.path, panes.position, panes.motion, panes.state] {
            let (right, bottom) = (pane.right() - 1, pane.bottom() - 1);
            let at = |x, y| out.cell((x, y)).map_or("", |cell| cell.symbol());
            prop_assert_eq!([at(pane.x, pane.y), at(right, pane.y), at(pane.x, bottom), at(right, bottom)],
                ["┌", "┐", "└", "┘"]);
            for y in pane.y + 1..bottom {
                prop_assert_eq!([at(pane.x, y), at(right, y)], ["│", "│"]);
            }
        }
        let (line, lines) = (model.line as usize, model.facts.program.lines());
        if model.stage != ScreenStage::Setup && (1..=lines).contains(&line) {
            let digits = lines.to_string().len().max(3);
            let marked = format!("│>{line:digits$} ");
            prop_assert!(rows(&out).iter().any(|row| row.contains(&marked)), "no {} in\n{}", marked, text(&out));
        }
    }

    #[test]
    fn any_keys_leave_the_screen_whole_and_space_always_holds_a_job(
        keys in prop::collection::vec((any_key(), 0..400u64), 0..60), model in any_model(),
    ) {
        let mut key_state = KeyState::new();
        let mut now_ms = 0;
        for (key, ms) in keys {
            now_ms += ms;
            let command = key_state.key(key, now_ms, &model);
            if key == Key::Char(' ') && model.stage == ScreenStage::Job && !model.is_at_program_end() {
                prop_assert_eq!(command, Some(UiCommand::Job(retrace_controller::OperatorCommand::Hold)));
            }
            drawn(&model, &key_state, 80, 24, now_ms);
        }
    }
}

/// Measures a redraw at 200 × 60 with a program of 100 000 lines and a full trail: `cargo test … -- --ignored
/// --nocapture`.
#[test]
#[ignore = "a measurement without assertions"]
fn measure_the_redraw() {
    let lines: String = (0..100_000).map(|n| format!("N{n} G1 X{}.{n:03} Y{}.5 F2400\n", n % 97, n % 89)).collect();
    let letters = ['x', 'y', 'z'];
    let facts = ProgramFacts {
        axes: letters
            .map(|letter| AxisFacts { letter, pulses_per_mm: 1000.0, travel_mm: [-1.0, 1.0], jog_mm_s: 1.0 })
            .to_vec(),
        period_s: 0.001,
        program: Text::new("long.ngc", &lines),
        planned: Planned::Known(1000.0),
        ..ProgramFacts::default()
    };
    let mut model = ScreenModel::new(Arc::new(facts));
    model.stage = ScreenStage::Job;
    for n in 0..200_000u32 {
        let turn = f64::from(n) * 0.07;
        let at = [turn.cos() * 50.0, (turn * 1.37).sin() * 40.0, 0.0].map(|mm| mm as f32);
        model.trail.push(TrailPoint { along_mm: f64::from(n), at, rapid: false });
        model.lengths.extend(Place::start_of(RecordIndex::new(n + 1)), 1.0, RecordIndex::new(0));
    }
    let shared = Mutex::new(model);
    let mut terminal = Terminal::new(TestBackend::new(200, 60)).expect("a terminal in memory");
    let (mut sum, mut most) = (0.0, 0.0f64);
    for n in 0..200u32 {
        {
            let mut model = lock_model(&shared);
            (model.line, model.reached_line) = (n * 499, n * 499);
            (model.place, model.reached) = (Place::start_of(RecordIndex::new(100_000)), RecordIndex::new(200_000));
            model.mode = Mode::Reverse;
        }
        let started = std::time::Instant::now();
        let picture = lock_model(&shared).clone();
        terminal.draw(|frame| view::draw(frame.buffer_mut(), &picture, &KeyState::new(), PLAIN, 0)).expect("in memory");
        let ms = started.elapsed().as_secs_f64() * 1e3;
        sum += ms;
        most = most.max(ms);
    }
    let knots = lock_model(&shared).trail.corners().count();
    println!("200 pictures of 200 x 60, {knots} corners: mean {:.2} ms, most {most:.2} ms", sum / 200.0);
}
