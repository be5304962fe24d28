//! Compares the screen with golden files, and follows a person at it.
//!
//! The files in `goldens/` were reviewed; `RETRACE_BLESS=1` rewrites them.

use std::sync::{Arc, Mutex};

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use retrace_config::MachineConfig;
use retrace_controller::{
    ContourList, CutterOffReason, CutterState, DifferingOutput, DifferingOutputs, Event, EventKind, Observer,
    OperatorCommand, Telemetry,
};
use retrace_core::mode::Mode;
use retrace_core::{Place, Rate, RecordIndex};
use retrace_journal::HoldReason;
use retrace_link::{CutterOffCause, GearState};

mod arbitrary;
mod jogging;
mod setting_up;
mod shop_jobs;

use crate::fake_machine::{self, FakeMachine, FakePath};
use crate::key_state::{KeyState, OpenDialog};
use crate::keys::{Key, TABLE};
use crate::model::{AlarmShown, AxisHoming, ScreenModel, ScreenStage};
use crate::model_observer::{ModelObserver, lock_model};
use crate::pending_question::PendingQuestion;
use crate::program_facts::{AxisFacts, ProgramFacts, Text};
use crate::trail::TrailPoint;
use crate::{UiCommand, view};

const PLAIN: view::Theme = view::Theme { colour: false };

/// A person at the screen of the fake machine.
struct ScreenFixture {
    machine: FakeMachine,
    model: Arc<Mutex<ScreenModel>>,
    key_state: KeyState,
    now_ms: u64,
}

impl ScreenFixture {
    fn new() -> Self {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/02-back-up.ngc");
        let text = std::fs::read_to_string(path).expect("a text");
        Self::of(&MachineConfig::built_in().expect("built in"), path, &text)
    }

    /// A program on this machine.
    fn of(machine: &MachineConfig, path: &str, text: &str) -> Self {
        let recorded = FakePath::of(machine, text);
        let facts = fake_machine::facts(machine, path, text, &recorded);
        let facts = ProgramFacts { program: Text::new("02-back-up.ngc", text), ..facts };
        let model = Arc::new(Mutex::new(ScreenModel::new(Arc::new(facts))));
        let machine = FakeMachine::new(recorded, Arc::clone(&model), 0.001);
        Self { machine, model, key_state: KeyState::new(), now_ms: 0 }
    }

    fn key(&mut self, key: Key) -> Option<UiCommand> {
        let picture = self.picture();
        let command = self.key_state.key(key, self.now_ms, &picture);
        if let Some(command) = &command {
            self.machine.handle_command(command);
        }
        command
    }

    fn keys(&mut self, keys: &str) {
        for c in keys.chars() {
            self.key(if c == '\n' { Key::Enter } else { Key::Char(c) });
        }
    }

    fn wait(&mut self, ms: u64) {
        for _ in 0..ms {
            self.machine.step();
        }
        self.now_ms += ms;
    }

    fn picture(&self) -> ScreenModel {
        lock_model(&self.model).clone()
    }

    fn screen(&self, width: u16, height: u16) -> Buffer {
        drawn(&self.picture(), &self.key_state, width, height, self.now_ms)
    }

    /// Compares the screen with its golden file.
    fn is_as(&self, name: &str, width: u16, height: u16) {
        let text = text(&self.screen(width, height));
        let path = format!("{}/src/goldens/{name}-{width}x{height}.txt", env!("CARGO_MANIFEST_DIR"));
        if std::env::var_os("RETRACE_BLESS").is_some() {
            std::fs::write(&path, &text).expect("a golden picture");
        }
        let golden = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(golden == text, "{name} at {width}x{height} has changed:\n{text}\nit was:\n{golden}");
    }
}

fn drawn(model: &ScreenModel, key_state: &KeyState, width: u16, height: u16, now_ms: u64) -> Buffer {
    let mut out = Buffer::empty(Rect::new(0, 0, width, height));
    view::draw(&mut out, model, key_state, PLAIN, now_ms);
    out
}

fn rows(out: &Buffer) -> Vec<String> {
    let row = |y| (0..out.area.width).filter_map(|x| out.cell((x, y)).map(|cell| cell.symbol())).collect::<String>();
    (0..out.area.height).map(row).collect()
}

fn text(out: &Buffer) -> String {
    rows(out).iter().map(|row| format!("{}\n", row.trim_end())).collect()
}

#[test]
fn the_screens_are_as_they_were_looked_at() {
    let mut bench = ScreenFixture::new();
    bench.wait(5);
    bench.is_as("1-ready", 80, 24);
    bench.keys("c");
    bench.wait(4200);
    bench.is_as("2-running", 80, 24);
    bench.is_as("2-running", 200, 60);
    bench.keys(" ");
    bench.wait(500);
    bench.is_as("3-hold", 80, 24);
    bench.keys("r");
    bench.wait(1500);
    bench.is_as("4-reverse", 80, 24);
    bench.is_as("4-reverse", 200, 60);
    bench.is_as("4-reverse", 130, 30);
    bench.keys("o0");
    bench.is_as("5-output", 80, 24);
    bench.keys("\n");
    bench.keys("w");
    bench.wait(500);
    for _ in 0..5 {
        bench.key(Key::Left);
        bench.wait(30);
    }
    bench.is_as("6-wheel", 80, 24);
    bench.keys("L");
    bench.wait(6000);
    bench.is_as("7-outputs-differ", 80, 24);
    bench.keys("y");
    bench.wait(500);
    bench.machine.handle_command(&UiCommand::Job(retrace_controller::OperatorCommand::SpindleStart));
    bench.keys("p");
    bench.wait(500);
    bench.keys("S");
    bench.key(Key::PageUp);
    bench.wait(10);
    bench.is_as("8-paused", 80, 24);
    bench.keys("?");
    bench.is_as("9-keys", 80, 24);
    bench.keys("x");
    lock_model(&bench.model).alarm = Some(AlarmShown {
        number: "E3012".into(),
        cause: "the emergency-stop chain is open".into(),
        remedy: "make the machine safe, close the chain, clear the alarm, then home the machine".into(),
        is_refusal: false,
    });
    bench.is_as("10-alarm", 80, 24);
    bench.is_as("11-too-small", 60, 10);
}

fn with_messages(texts: &[&str]) -> ScreenModel {
    let letters = ['x', 'y', 'z'];
    let axes = letters
        .map(|letter| AxisFacts { letter, pulses_per_mm: 1000.0, travel_mm: [-1.0, 1.0], jog_mm_s: 1.0 })
        .to_vec();
    let mut model = ScreenModel::new(Arc::new(ProgramFacts { axes, ..ProgramFacts::default() }));
    texts.iter().for_each(|message| model.add_message(1.0, 0, *message));
    model
}

#[test]
fn a_message_shows_how_often_it_came() {
    let model = with_messages(&["one", "E1", "E2", "E1", "E2", "E1"]);
    assert!(text(&drawn(&model, &KeyState::new(), 80, 24, 0)).contains("E1  ×3"));
}

#[test]
fn all_messages_are_shown_whole_and_all_keys_on_pages() {
    let long = "word ".repeat(60) + "end of it";
    let model = with_messages(&[&long, "the last"]);
    let mut key_state = KeyState::new();
    let _ = key_state.key(Key::Char('g'), 0, &model);
    let shown = text(&drawn(&model, &key_state, 80, 24, 0));
    assert!(shown.contains("end of it") && shown.contains("the last") && !shown.contains("word…"), "{shown}");
    let _ = key_state.key(Key::Esc, 0, &model);
    let _ = key_state.key(Key::Char('?'), 0, &model);
    let mut pages = String::new();
    for _ in 0..6 {
        pages += &text(&drawn(&model, &key_state, 80, 24, 0));
        let _ = key_state.key(Key::Down, 0, &model);
    }
    for row in TABLE {
        // A long line may continue in the next one.
        let begins: String = row.long.chars().take(40).collect();
        assert!(pages.contains(&begins), "{} is on no page", row.long);
    }
}

#[test]
fn the_drawing_is_enlarged_moved_and_fitted_to_the_table() {
    let mut model = with_messages(&[]);
    let facts = Arc::make_mut(&mut model.facts);
    facts.axes.iter_mut().for_each(|axis| axis.travel_mm = [0.0, 400.0]);
    for (along, rapid, at) in [(0.0, false, [0.0; 3]), (10.0, false, [10.0, 0.0, 0.0]), (20.0, true, [10.0, 10.0, 0.0])]
    {
        facts.preview.path.push(TrailPoint { along_mm: along, at: at.map(|mm: f64| mm as f32), rapid });
    }
    let mut key_state = KeyState::new();
    let pane = |key_state: &KeyState| {
        let all = text(&drawn(&model, key_state, 80, 24, 0));
        all.lines().skip(10).take(11).map(|line| line.chars().take(40).collect::<String>() + "\n").collect::<String>()
    };
    let dots = |c: char| if ('\u{2800}'..'\u{2900}').contains(&c) { (c as u32 & 0xff).count_ones() } else { 0 };
    let count = |pane: &str| pane.chars().map(dots).sum::<u32>();
    // The legend has one, too.
    let shows_tool = |pane: &str| pane.matches('@').count() == 2;
    let fitted = pane(&key_state);
    assert!(fitted.contains("10 × 10 mm"), "{fitted}");
    let _ = key_state.key(Key::Char('>'), 0, &model);
    let enlarged = pane(&key_state);
    assert!(enlarged.contains("×2") && !shows_tool(&enlarged), "{enlarged}");
    for key in [Key::ShiftLeft, Key::ShiftDown] {
        (0..4).for_each(|_| drop(key_state.key(key, 0, &model)));
    }
    assert!(shows_tool(&pane(&key_state)), "panned to the tool\n{}", pane(&key_state));
    let _ = key_state.key(Key::Char('<'), 0, &model);
    assert_eq!(pane(&key_state), fitted);
    let _ = key_state.key(Key::Char('e'), 0, &model);
    let table = pane(&key_state);
    assert!(table.contains("10 × 10 mm") && table != fitted && count(&table) > 40, "the soft limits\n{table}");
    let _ = key_state.key(Key::Char('e'), 0, &model);
    assert_eq!(pane(&key_state), fitted);
}

#[test]
fn a_program_that_does_not_come_is_waited_for_by_name_and_time() {
    let mut model = with_messages(&[]);
    Arc::make_mut(&mut model.facts).period_s = 0.001;
    (model.stage, model.period, model.waiting) =
        (ScreenStage::Job, 14_000, Some(("tcp://cam-computer:7000".into(), 3_000)));
    let shown = text(&drawn(&model, &KeyState::new(), 80, 24, 0));
    assert!(shown.contains("WAITING") && shown.contains("waiting for tcp://cam-computer:7000, 12 s so far"), "{shown}");
}

#[test]
fn cutters_and_outputs_have_names_and_what_the_program_had_stands_beside_them() {
    let machine = MachineConfig::parse(
        "[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\n[[output]]\nnumber = 5\nname = \"clamp\"\n",
        "m.toml",
    );
    let mut model = ScreenModel::new(Arc::new(ProgramFacts::of(&machine.expect("valid"), "a.ngc", "")));
    let shown = |model: &ScreenModel, key_state: &KeyState| text(&drawn(model, key_state, 80, 24, 0));
    let off = shown(&model, &KeyState::new());
    assert!(off.contains("torch off") && off.contains("other outputs off") && !off.contains("all off"), "{off}");
    (model.stage, model.program_outputs) = (ScreenStage::Job, [(64, 1)].into());
    assert!(shown(&model, &KeyState::new()).contains("torch off · program here on"));
    assert!(off.contains("x cutter off  ? all keys"), "{off}");
    model.outputs = [(64, 1), (5, 1)].into();
    let on = shown(&model, &KeyState::new());
    assert!(on.contains("torch ON · program here on") && on.contains("outputs ON: clamp"), "{on}");
    assert!(!on.contains("spindle"), "{on}");
    model.cutter_states = [(64, (CutterState::Cutting, 3))].into();
    assert!(shown(&model, &KeyState::new()).contains("torch ON · program here on · cut"));
    (model.outputs, model.cutter_off_reasons) = ([(5, 1)].into(), [(64, "lost")].into());
    model.cutter_states = [(64, (CutterState::Lost, 3))].into();
    assert!(shown(&model, &KeyState::new()).contains("torch off · program here on · cut"));
    let mut key_state = KeyState::new();
    for open in [
        OpenDialog::Nothing,
        OpenDialog::Help(1),
        OpenDialog::Messages(0),
        OpenDialog::Prompt(PendingQuestion::Stop, String::new(), None),
    ] {
        key_state.open = open;
        assert_eq!(key_state.key(Key::Char('x'), 0, &model), Some(UiCommand::CutterOff), "whatever is open");
    }
    key_state.open = OpenDialog::Nothing;
    let command = "oclamp-\r".chars().map(|c| if c == '\r' { Key::Enter } else { Key::Char(c) });
    let command: Vec<_> = command.filter_map(|key| key_state.key(key, 0, &model)).collect();
    assert_eq!(command, [UiCommand::Job(retrace_controller::OperatorCommand::Output { number: 5, on: false })]);
    model.dry_run = true;
    assert!(shown(&model, &key_state).starts_with(" DRY RUNNING"), "{}", shown(&model, &key_state));
    (model.hold_reason, model.tool_change, model.at_rest) = (HoldReason::ProgramStop, Some(3), true);
    Arc::make_mut(&mut model.facts).tool_names = [(3, "6 mm end mill".to_owned())].into();
    let change = shown(&model, &KeyState::new());
    assert!(change.contains("TOOL CHANGE") && change.contains("insert tool T3: 6 mm end mill"), "{change}");
}

/// From the loss of an arc to the end of the job: what the second line says.
#[test]
fn a_lost_cut_is_explained_until_it_is_whole() {
    let machine =
        MachineConfig::parse("[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\n", "m.toml").expect("valid");
    let model = Arc::new(Mutex::new(ScreenModel::new(Arc::new(ProgramFacts::of(&machine, "a.ngc", "")))));
    let mut observer = ModelObserver::new(Arc::clone(&model));
    let mut event = |kind| {
        let event = Event { period: 1, time_s: 0.001, place: Place::default(), line: 13, kind };
        Observer::<3>::on_telemetry(&mut observer, &Telemetry::Event(event));
    };
    let set = |mode, hold_reason, at_rest| {
        let mut model = lock_model(&model);
        (model.mode, model.hold_reason, model.at_rest) = (mode, hold_reason, at_rest);
    };
    let says = |words: &str| {
        let shown = text(&drawn(&lock_model(&model), &KeyState::new(), 80, 24, 0));
        assert!(shown.contains(words), "no `{words}` in\n{shown}");
    };
    lock_model(&model).stage = ScreenStage::Job;
    lock_model(&model).program_outputs = [(64, 1)].into();
    event(EventKind::CutterOff { channel: 64, reason: CutterOffReason::Card(CutterOffCause::Lost) });
    event(EventKind::CutEnd {
        channel: 64,
        place: Place::default(),
        line: 13,
        may_be_longer: false,
        latest: RecordIndex::default(),
    });
    set(Mode::Run, HoldReason::Hold, true);
    says("CUT INTERRUPTED");
    says(" torch went out in line 13; k goes back to 1 mm before, FIRES and cuts on");
    event(EventKind::Operator(OperatorCommand::Recover));
    says("operator: recover the cut");
    set(Mode::Reverse, HoldReason::None, false);
    says("recovering the cut, 0.0 mm back from where it stood — Space feed hold");
    event(EventKind::CutFromHere { moving: true });
    event(EventKind::RunResumed);
    event(EventKind::RestartSwitching("M3"));
    assert_eq!(lock_model(&model).cutter_off_reasons.get(&64), Some(&"lost"));
    event(EventKind::CutterState { channel: 64, state: CutterState::Igniting, contour: 2 });
    assert_eq!(lock_model(&model).cutter_off_reasons.get(&64), None, "it is being lit again");
    lock_model(&model).cutter_states.clear();
    set(Mode::AwaitOutputs, HoldReason::None, true);
    says("waiting for M3 to complete");
    set(Mode::Run, HoldReason::None, true);
    says("waiting for M3 to complete");
    event(EventKind::RestartSwitched("M3"));
    says("at rest until more path is planned");
    // another interruption, by a hold
    event(EventKind::CutterOff { channel: 64, reason: CutterOffReason::Card(CutterOffCause::Standing) });
    event(EventKind::CutEnd {
        channel: 64,
        place: Place::default(),
        line: 14,
        may_be_longer: false,
        latest: RecordIndex::default(),
    });
    set(Mode::Run, HoldReason::Hold, true);
    says(" the cut ends in line 14; k goes back to 1 mm before, FIRES and cuts on");
    event(EventKind::Operator(OperatorCommand::Recover));
    event(EventKind::Operator(OperatorCommand::Reverse(Rate::ONE)));
    set(Mode::Reverse, HoldReason::None, false);
    says(" 0.0 mm back — Space");
    lock_model(&model).oldest = RecordIndex::new(0) - 9;
    set(Mode::Reverse, HoldReason::None, true);
    says(" 0.0 mm back; the cut ends in line 14, K FIRES and cuts on — K cut here");
    set(Mode::AwaitOutputs, HoldReason::None, true);
    event(EventKind::OutputsDiffer(DifferingOutputs::first(&mut [DifferingOutput::new(64, 0, 1)].into_iter())));
    says(" y starts the cutter here; k goes back, FIRES and cuts on");
    says("k: recover the interrupted cut: go back and cut on");
    lock_model(&model).lost_cutter = Some(64);
    says(" y leaves a gap in the cut; k goes back, FIRES and cuts on");
    event(EventKind::OutputsRestored);
    set(Mode::Run, HoldReason::Ended, true);
    says("program completed; c RUNS IT AGAIN");
    for (number, not_cut_mm, contours) in [
        (1, 0.0, "completed, 1 contour cut, 2 restarts; c RUNS IT AGAIN"),
        (2, 1.5, "completed, 1 of 2 contours NOT cut through, 2 restarts;"),
        (2, 0.0, "completed, 2 contours cut, 2 restarts;"),
    ] {
        event(EventKind::Contour { number, cut_mm: 60.0 - not_cut_mm, not_cut_mm });
        says(contours);
    }
    for (count, words) in
        [(3, "completed, 2 contours cut, 2 restarts;"), (2, "completed, all 2 contours cut, 2 restarts;")]
    {
        let mut list = ContourList::default();
        list.count = count;
        Arc::make_mut(&mut lock_model(&model).facts).contours = Some(Arc::new(list));
        says(words);
    }
    let reported = |model: &ScreenModel| crate::reported_contours_text(model, " · 2 contours cut");
    assert_eq!(reported(&lock_model(&model)), " · all 2 contours cut, 2 restarts");
    lock_model(&model).contours.skip(2, true);
    assert_eq!(reported(&lock_model(&model)), " · 2 contours cut, 2 restarts");
    // What releases the job is no stop.
    event(EventKind::Operator(OperatorCommand::Stop));
    says("operator: release the job");
}

#[test]
fn every_axis_says_whether_it_is_homed() {
    let mut model = with_messages(&[]);
    model.homing = vec![AxisHoming::Homed, AxisHoming::NotHomed, AxisHoming::NotNeeded];
    let shown = text(&drawn(&model, &KeyState::new(), 80, 24, 0));
    assert!(shown.contains("X ✓") && shown.contains("Y ?") && shown.contains("Z   "), "{shown}");
}

/// The drawing begins with the view in which the program is seen; `v` goes on from there.
#[test]
fn a_lathe_is_drawn_in_its_plane_and_a_row_of_holes_from_the_front() {
    let axis = |name: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = 1000\nmax_velocity_mm_per_s = 100\n\
             max_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-200, 200]\n"
        )
    };
    let lathe = MachineConfig::parse(&format!("{}{}", axis("x"), axis("z")), "lathe").expect("valid");
    let mill = MachineConfig::built_in().expect("built in");
    for (machine, program, views) in [
        (&lathe, "G21 G90\nG0 X20 Z5\nG1 Z-60 F300\nM2\n", ["path Z X · 65 × 20 mm", "path X Y"]),
        (&mill, "G21 G90\nG0 X20 Z5\nG1 Z-10 F300\nM2\n", ["path X Z · 20 × 15 mm", "path Y Z"]),
        (&mill, "G21 G90\nG0 X20 Y5\nG1 Z-10 F300\nM2\n", ["path X Y · 20 × 5 mm", "path X Z"]),
    ] {
        let mut bench = ScreenFixture::of(machine, "part.ngc", program);
        for view in views {
            let screen = text(&bench.screen(100, 30));
            assert!(screen.contains(view), "no `{view}` in\n{screen}");
            bench.keys("v");
        }
    }
}

/// In a thread and in a tap the keys are offered that have an effect there.
#[test]
fn no_key_is_offered_in_a_thread_that_is_refused_there() {
    let bench = ScreenFixture::new();
    let mut model = bench.picture();
    (model.stage, model.mode, model.at_rest) = (ScreenStage::Job, Mode::Run, false);
    model.spindle.gear = GearState::Engaged;
    for (switching, hold_reason, at_rest, words) in [
        (None, HoldReason::None, false, "in a thread: follows the spindle"),
        (Some("rigid tap"), HoldReason::None, false, "tapping: follows the spindle"),
        (None, HoldReason::Hold, false, "feed hold: finishing the thread"),
        (Some("rigid tap"), HoldReason::Hold, false, "feed hold: the spindle stops, the tap rests in the hole"),
        (Some("rigid tap"), HoldReason::Hold, true, "the tap rests in the hole; cycle start goes on"),
    ] {
        (model.switching, model.hold_reason, model.at_rest) = (switching, hold_reason, at_rest);
        let screen = text(&drawn(&model, &bench.key_state, 100, 30, 0));
        assert!(screen.contains(words) && !screen.contains("r reverse"), "no `{words}` in\n{screen}");
    }
}

/// What the operator asks for is shown also where the program has switched it off.
#[test]
fn an_override_that_the_program_has_switched_off_is_shown_with_that() {
    let bench = ScreenFixture::new();
    let mut model = bench.picture();
    (model.stage, model.override_rate) = (ScreenStage::Job, 0.6);
    for rapid_override in [1.0, 0.25] {
        for is_off in [false, true] {
            (model.rapid_override, model.override_is_off) = (rapid_override, is_off);
            for (width, height) in [(80, 24), (100, 30), (160, 50)] {
                let screen = text(&drawn(&model, &bench.key_state, width, height, 0));
                assert!(screen.contains("override 60 %"), "{screen}");
                assert_eq!(screen.contains("off (M49)"), is_off, "{screen}");
            }
        }
    }
}

/// Where the machine holds in the thread, the screen says so, and offers to reverse it and to turn the spindle by hand.
#[test]
fn a_thread_that_can_be_held_offers_reverse_and_the_spindle_by_hand() {
    let spindle = "\n[spindle]\ncounts_per_turn = 400\nmax_rpm = 3000\nthread_hold = \"spindle\"\ntap_retrace = true\n";
    let machine = MachineConfig::parse(spindle, "m").expect("valid");
    let bench = ScreenFixture::of(&machine, "part.ngc", "M2\n");
    let mut model = bench.picture();
    (model.stage, model.switching) = (ScreenStage::Job, None);
    model.spindle.gear = GearState::Engaged;
    let held = HoldReason::Hold;
    for (mode, hold_reason, at_rest, by_hand, words, keys) in [
        (Mode::Run, HoldReason::None, false, false, "in a thread: follows the spindle", "r reverse"),
        (Mode::Run, held, false, false, "the spindle stops, the tool rests in the thread", "r reverse"),
        (Mode::Run, held, true, false, "the tool rests in the thread; cycle start goes on", "G by hand"),
        (Mode::Run, held, true, true, "turn the spindle by hand: the axes follow it", "BY HAND"),
        (Mode::Reverse, HoldReason::None, false, false, "the spindle turns back, and the tool with it", "f forward"),
    ] {
        (model.mode, model.hold_reason, model.at_rest, model.follows_spindle) = (mode, hold_reason, at_rest, by_hand);
        let screen = text(&drawn(&model, &bench.key_state, 100, 30, 0));
        assert!(screen.contains(words) && screen.contains(keys), "no `{words}`, `{keys}` in\n{screen}");
    }
}

/// From hold to reverse run, handwheel and back: what a person reads and presses, and that the machine returns to the
/// pulse.
#[test]
fn a_person_backs_up_and_goes_on() {
    let mut bench = ScreenFixture::new();
    let says = |bench: &ScreenFixture, words: &str| {
        let screen = text(&bench.screen(80, 24));
        assert!(screen.contains(words), "no `{words}` in\n{screen}");
    };
    says(&bench, "c cycle start");
    bench.keys("c");
    bench.wait(3000);
    says(&bench, "RUNNING");
    says(&bench, "Space feed hold");
    bench.keys(" ");
    bench.wait(400);
    says(&bench, "FEED HOLD");
    says(&bench, "c cycle start · r reverse · w handwheel");
    assert_eq!(bench.key_state.mouse_wheel(true, &bench.picture()), None, "no handwheel yet");
    let held = bench.picture();
    bench.keys("r");
    bench.wait(1000);
    assert!(bench.picture().back_mm() > 20.0);
    says(&bench, "mm back");
    bench.keys("w");
    bench.wait(500);
    says(&bench, "HANDWHEEL");
    let at_rest = bench.picture();
    for _ in 0..10 {
        bench.key(Key::Left);
        bench.wait(40);
    }
    assert!(bench.picture().place.record.is_before(at_rest.place.record), "the arrows turn the wheel");
    bench.key_state.mouse_wheel(true, &bench.picture()).expect("the mouse wheel is one, too");
    bench.keys("l");
    while bench.picture().mode != Mode::Run {
        bench.wait(1);
    }
    let back = bench.picture();
    assert_eq!((back.place.record, back.counts), (held.reached, held.counts));
    bench.wait(500);
    says(&bench, "RUNNING");
    bench.keys("q");
    says(&bench, "y stop");
    bench.keys("n");
    says(&bench, "RUNNING");
    bench.keys("qy");
    bench.wait(10);
    says(&bench, "ENDED");
}

#[test]
fn space_holds_whatever_is_open_while_a_job_runs() {
    let mut bench = ScreenFixture::new();
    bench.keys("c");
    bench.wait(1000);
    let hold = Some(UiCommand::Job(retrace_controller::OperatorCommand::Hold));
    for open in ["?", "T", "g", "b", "o", "q", "w", "r"] {
        bench.keys(open);
        bench.wait(300);
        assert_eq!(bench.key(Key::Char(' ')), hold, "{open}");
        bench.wait(300);
        assert!(text(&bench.screen(80, 24)).contains("FEED HOLD"), "{}", text(&bench.screen(80, 24)));
        bench.keys("c");
    }
}

#[test]
fn a_key_that_does_nothing_here_says_when_it_does() {
    let mut bench = ScreenFixture::new();
    bench.keys("r");
    assert_eq!(bench.key_state.notice(0), Some("r (reverse) works while the program runs or is held"));
    bench.keys("b");
    assert!(matches!(bench.key_state.open, OpenDialog::Nothing));
    bench.keys("m");
    bench.keys("G0 X10");
    assert_eq!(bench.key_state.open, OpenDialog::Prompt(PendingQuestion::Mdi, "G0 X10".into(), None));
    bench.key(Key::Esc);
    bench.keys("o77\n");
    assert!(matches!(&bench.key_state.open, OpenDialog::Prompt(PendingQuestion::Output, _, Some(_))));
}

/// From the order to stop until the end of the job is recorded, the state is neither the one before nor the end.
#[test]
fn a_job_that_is_being_stopped_says_so_until_it_has_ended() {
    let machine = MachineConfig::built_in().expect("valid");
    let model = Arc::new(Mutex::new(ScreenModel::new(Arc::new(ProgramFacts::of(&machine, "a.ngc", "")))));
    let mut observer = ModelObserver::new(Arc::clone(&model));
    let mut event = |kind| {
        let event = Event { period: 1, time_s: 0.001, place: Place::default(), line: 13, kind };
        Observer::<3>::on_telemetry(&mut observer, &Telemetry::Event(event));
        crate::status_line::of(&lock_model(&model)).status
    };
    event(EventKind::Started);
    lock_model(&model).pause = Some(crate::model::Pause::default());
    let before = crate::status_line::of(&lock_model(&model)).status;
    assert_ne!(before, "STOPPING");
    assert_eq!(event(EventKind::Operator(OperatorCommand::Stop)), "STOPPING");
    let why = retrace_controller::CommandError::NothingBehind;
    assert_eq!(event(EventKind::CommandRejected(why)), before, "it was not stopped");
    assert_eq!(lock_model(&model).rejection.count, 1);
    assert_eq!(event(EventKind::Operator(OperatorCommand::Stop)), "STOPPING");
    lock_model(&model).end("stopped by the operator");
    assert_eq!(crate::status_line::of(&lock_model(&model)).status, "ENDED");
    lock_model(&model).stage = ScreenStage::Setup;
    assert_ne!(event(EventKind::Started), "STOPPING", "the next job runs");
}
