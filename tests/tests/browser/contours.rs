//! Contours in the drawing: a tap or a number selects one, and it is skipped from there (CUT-61).

use retrace_tests::command::Bench;
use retrace_tests::page_client::PageServer;
use retrace_tests::page_user::{PageUser, Screen};
use serde_json::{Value, json};

use super::layout::no_fault;
use super::{Machine, browser, in_control, serve};

/// Two contours side by side, the second one with a corner, and one above them.
const PROGRAM: &str = "G21 G90 F3000\nG0 X10 Y10\nM3\nG1 X50\nM5\nG0 X70 Y10\nM3\nG1 X110\nG1 Y40\nM5\n\
    G0 X10 Y40\nM3\nG1 X50\nM5\nG0 X0 Y0\nM2\n";

const MACHINE: &str = "[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nok = { input = 5 }\n\
    start = { start_s = 1.0, retry_s = 0.5, pierce_s = 0.4 }\n\
    [[axis]]\nname = \"x\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = 100\nmax_acceleration_mm_per_s2 = 1000\n\
    max_jerk_mm_per_s3 = 20000\ntravel_mm = [-50, 500]\n\
    [[axis]]\nname = \"y\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = 100\nmax_acceleration_mm_per_s2 = 1000\n\
    max_jerk_mm_per_s3 = 20000\ntravel_mm = [-50, 500]\n";

/// Colours in the dark theme of the band on a selected contour, and of one that is skipped.
const SELECTED: [u8; 3] = [0x1f, 0x8a, 0x6b];
const SKIPPED: [u8; 3] = [0xcc, 0x9a, 0xd6];

fn serve_contours(bench: &Bench) -> PageServer {
    serve_program(bench, PROGRAM)
}

fn serve_program(bench: &Bench, program: &str) -> PageServer {
    let machine = bench.file("machine.toml", MACHINE).display().to_string();
    serve(bench, program, &["--machine", &machine])
}

/// Place on the screen of a machine position, once the drawing shows the contours.
fn spot(user: &mut PageUser, x_mm: f64, y_mm: f64) -> (f64, f64) {
    user.wait(
        "import('/page/app.js').then(({ pathView: { contours, shownPath, chosenChunks } }) =>
           contours.path === shownPath && contours.contours.length === 3 && chosenChunks?.length > 0)",
    );
    let at = user.evaluate(&format!(
        "import('/page/app.js').then(({{ pathView }}) => {{
           const box = pathView.canvas.getBoundingClientRect();
           const [x, y] = pathView.camera.project(pathView.toPath([{x_mm}, {y_mm}, 0]));
           return [box.left + x, box.top + y];
         }})"
    ));
    (at[0].as_f64().expect("a place"), at[1].as_f64().expect("a place"))
}

/// Number of the contour that is selected, or null.
fn selected(user: &mut PageUser) -> Value {
    user.evaluate("import('/page/app.js').then(({ pathView }) => pathView.contours.number)")
}

fn tap_at(user: &mut PageUser, at: (f64, f64)) {
    // Two taps at once would be a double tap.
    std::thread::sleep(std::time::Duration::from_millis(400));
    user.tap_at(at);
}

/// The list of the server.
fn listed(server: &PageServer, machine: &Machine<'_>) -> Vec<Value> {
    let list = server.request("GET", "/api/v1/program/contours", &[("Cookie", &machine.cookie)], b"").json();
    list["contours"].as_array().expect("contours").clone()
}

/// A tap beside a contour selects it in the list, and it is skipped there; a number selects one, too. Nothing moves
/// until the program is started.
#[test]
fn a_contour_is_selected_in_the_drawing_and_skipped() {
    let Some(mut browser) = browser() else { return };
    for screen in [Screen::TABLET, Screen::DESK, Screen::PHONE] {
        let bench = Bench::new();
        let server = serve_contours(&bench);
        let machine = Machine::new(&server);
        let mut user = in_control(&mut browser, &server, screen);
        user.wait_for_word("READY");
        let before = machine.wait_for_rest();
        let (x, y) = spot(&mut user, 90.0, 10.0);
        tap_at(&mut user, (x, y + 20.0));
        user.wait_for_text(".chosen-text", "contour 2 · line 8 chosen");
        assert!(user.wait_for_pixels(SELECTED, |pixels| pixels > 100) > 100, "the selected contour has a band");
        user.picture(&format!("contour-selected-{}", screen.width));
        if screen.width < 760 {
            user.tap(".contour-open", "Contour 2");
        }
        user.wait_for_text(".contours .chosen .contour-name", "2 · line 7");
        assert_eq!(user.canvas_pixels(SKIPPED), 0);
        user.tap(".list-head button", "Skip it");
        machine.wait("it is skipped", |report| report["state"]["skipped_contours"] == json!([2]));
        user.wait_for_text(".contours .chosen .contour-cut", "skipped");
        user.tap("#tab-path", "");
        assert!(user.wait_for_pixels(SKIPPED, |pixels| pixels > 30) > 30, "it is drawn as skipped");
        no_fault(&mut user, "a skipped contour");
        user.tap("#tab-contours", "");
        user.tap(".contour-number", "");
        user.key("3");
        user.wait_for_text(".contours .chosen .contour-name", "3 · line 12");
        assert_eq!(selected(&mut user), 3);
        user.key("9");
        user.wait("document.querySelector('.contours .chosen') === null");
        assert_eq!(selected(&mut user), Value::Null, "there is no contour 39");
        user.tap("#tab-path", "");
        user.picture(&format!("contour-skipped-{}", screen.width));
        let after = machine.wait_for_rest();
        for what in ["mm", "record"] {
            assert_eq!(before["live"][what], after["live"][what], "selecting and skipping move nothing");
        }
        assert_eq!(before["state"]["outputs"], after["state"]["outputs"], "and switch nothing");
        user.tap(".motion.start", "");
        machine.wait("the end", |report| report["state"]["situation"] == "program_end");
        let states: Vec<Value> = listed(&server, &machine).iter().map(|contour| contour["state"].clone()).collect();
        assert_eq!(states, ["cut", "not_cut", "cut"]);
        user.wait_for_pixels(SKIPPED, |pixels| pixels > 30);
        user.picture(&format!("contour-passed-{}", screen.width));
    }
}

/// In a job the selected contour is the one to which the machine goes back. The last contour is cut slowly, so that it
/// is held within it also by a browser under load.
#[test]
fn the_machine_goes_back_to_a_contour_that_is_selected_in_the_drawing() {
    let Some(mut browser) = browser() else { return };
    let bench = Bench::new();
    let server = serve_program(&bench, &PROGRAM.replace("Y40\nM3\n", "Y40\nM3\nF240\n"));
    let machine = Machine::new(&server);
    let mut user = in_control(&mut browser, &server, Screen::TABLET);
    user.wait_for_word("READY");
    user.tap(".motion.start", "");
    machine.wait("the third contour", |report| {
        report["state"]["cutter"]["contour"] == 3 && report["live"]["mm"][0].as_f64() > Some(12.0)
    });
    user.tap(".motion.hold", "");
    machine.wait_for_rest();
    // The torch goes off at rest, and buttons appear above the drawing.
    user.wait_for_word("CUT INTERRUPTED");
    let at = spot(&mut user, 30.0, 10.0);
    tap_at(&mut user, at);
    user.wait_for_text(".contours .chosen .contour-name", "1 · line 3");
    let held = machine.wait_for_rest();
    user.tap(".list-head button", "Back to it");
    machine.wait("it has gone back", |report| {
        let [x, y] = [0, 1].map(|axis| report["live"]["mm"][axis].as_f64().unwrap_or(f64::NAN));
        report["live"]["at_rest"] == true && x < 51.0 && y < 11.0
    });
    assert!(held["live"]["mm"][1].as_f64() > Some(39.0), "the tap alone has moved nothing");
}

/// A finger that pans or zooms the drawing, and a tap beside everything, select nothing.
#[test]
fn a_drag_or_a_tap_beside_all_contours_selects_nothing() {
    let Some(mut browser) = browser() else { return };
    for screen in [Screen::TABLET, Screen::DESK] {
        let bench = Bench::new();
        let server = serve_contours(&bench);
        let mut user = in_control(&mut browser, &server, screen);
        user.wait_for_word("READY");
        let at = spot(&mut user, 90.0, 10.0);
        // There and back, as fast as a tap.
        user.press(at);
        user.move_to((at.0 + 60.0, at.1 - 30.0));
        user.move_to(at);
        user.release(at);
        selects_nothing(&mut user);
        if screen.is_touch {
            pinch(&mut user, at);
            selects_nothing(&mut user);
        }
        let beside = spot(&mut user, 90.0, 26.0);
        tap_at(&mut user, beside);
        selects_nothing(&mut user);
        let at = spot(&mut user, 90.0, 10.0);
        tap_at(&mut user, at);
        user.wait_for_text(".contours .chosen .contour-name", "2 · line 7");
        tap_at(&mut user, beside);
        user.wait("document.querySelector('.contours .chosen') === null");
    }
}

/// Checks that nothing is selected, also in a moment.
fn selects_nothing(user: &mut PageUser) {
    std::thread::sleep(std::time::Duration::from_millis(700));
    assert_eq!(selected(user), Value::Null);
    assert_eq!(user.count(".contours .chosen"), 0);
    assert_eq!(user.text(".chosen-text"), "");
}

/// Two fingers apart and together again, the first of which came down on a contour.
fn pinch(user: &mut PageUser, (x, y): (f64, f64)) {
    let mut touch = |kind: &str, fingers: &[(f64, f64)]| {
        let points: Vec<Value> =
            fingers.iter().enumerate().map(|(id, (x, y))| json!({"x": x, "y": y, "id": id})).collect();
        user.page().call("Input.dispatchTouchEvent", json!({"type": kind, "touchPoints": points}));
    };
    touch("touchStart", &[(x, y)]);
    touch("touchStart", &[(x, y), (x + 40.0, y - 40.0)]);
    for apart in [60.0, 80.0, 60.0, 40.0] {
        touch("touchMove", &[(x, y), (x + apart, y - apart)]);
    }
    touch("touchEnd", &[(x, y)]);
    touch("touchEnd", &[]);
}
