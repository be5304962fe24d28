//! The edge of the sheet on the page: the job is drawn as it would lie before the edge is set (CUT-58).

use std::time::{Duration, Instant};

use retrace_tests::command::Bench;
use retrace_tests::page_user::{PageUser, Screen};
use serde_json::{Value, json};

use super::{Machine, browser, in_control, serve};

const MACHINE: &str = "homed = true\n\
    [[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\n\
    [[axis]]\nname = \"x\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = 150\nmax_acceleration_mm_per_s2 = 1000\n\
    max_jerk_mm_per_s3 = 20000\ntravel_mm = [-20, 300]\n\
    [[axis]]\nname = \"y\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = 150\nmax_acceleration_mm_per_s2 = 1000\n\
    max_jerk_mm_per_s3 = 20000\ntravel_mm = [-20, 300]\n\
    [[axis]]\nname = \"z\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = 50\nmax_acceleration_mm_per_s2 = 1000\n\
    max_jerk_mm_per_s3 = 20000\ntravel_mm = [-60, 0]\n";

/// One contour: 90 mm along X, then 40 mm along Y.
const PROGRAM: &str = "G21 G90 G61 F900\nG0 X30 Y20\nM3\nG1 X120\nG1 Y60\nM5\nM2\n";

/// Colours in the dark theme of the job as it would lie, and of the planned path.
const PLACED: [u8; 3] = [0xff, 0x8f, 0xc7];
const PLANNED: [u8; 3] = [0x8d, 0x98, 0xa5];

/// Moves the machine there by MDI, and takes the first point where the zero is set, the second by its key; each is
/// taken when the question is answered.
fn take_point(user: &mut PageUser, machine: &Machine<'_>, [x, y]: [f64; 2], points: u64) {
    user.tap("#tab-mdi", "");
    user.tap(".mdi-text", "");
    user.type_text(&format!("G53 G0 X{x} Y{y}"));
    user.key("Enter");
    machine.wait("the place", |report| {
        let off =
            [(0, x), (1, y)].map(|(axis, mm)| (report["live"]["mm"][axis].as_f64().unwrap_or(f64::NAN) - mm).abs());
        report["live"]["at_rest"] == true && report["state"]["stage"] == "setup" && off.iter().all(|off| *off < 0.006)
    });
    user.wait("import('/page/app.js').then(({ pathView: { store } }) => store.allows('sheet-edge'))");
    if points == 1 {
        user.tap("[role=tab]", "Zero");
        user.tap("#panel-zero button", "Sheet edge");
        assert!(machine.report()["state"]["sheet"].is_null(), "no point is taken before the question is answered");
        user.tap(".dialog button", "Take the first point here");
    } else {
        user.evaluate("document.activeElement.blur()");
        user.key("E");
        user.tap(".dialog button", "Take the second point here");
    }
    machine.wait("the point", |report| report["state"]["sheet"]["points"].as_u64() == Some(points));
    user.tap("#tab-path", "");
}

/// Waits until something is drawn in this colour around a place of the machine, within 4 pixels, or until it is not.
fn wait_for_ink(user: &mut PageUser, [x, y]: [f64; 2], [red, green, blue]: [u8; 3], is_there: bool) {
    user.wait(&format!(
        "import('/page/app.js').then(({{ pathView }}) => {{
           const {{ canvas, camera, ratio }} = pathView, copy = document.createElement('canvas');
           [copy.width, copy.height] = [canvas.width, canvas.height];
           const context = copy.getContext('2d');
           context.drawImage(canvas, 0, 0);
           const pixels = camera.project(pathView.toPath([{x}, {y}, 0]));
           const [left, top] = pixels.map(pixel => Math.round(pixel * ratio) - 4);
           const {{ data }} = context.getImageData(left, top, 9, 9), wanted = [{red}, {green}, {blue}];
           let count = 0;
           for (let at = 0; at < data.length; at += 4)
             if (wanted.every((value, place) => Math.abs(data[at + place] - value) <= 8)) count++;
           return (count > 4) === {is_there};
         }})"
    ));
}

/// Opens the dialog of the edge, by its key.
fn open_dialog(user: &mut PageUser) {
    user.key("E");
    user.wait_for_text(".dialog h2", "The edge of the sheet");
}

/// The job is drawn where it would lie, with its angle and what it would leave of the travel. Forgotten, it lies as
/// before; set, it lies as it was drawn.
#[test]
fn the_job_is_drawn_as_it_would_lie_before_the_edge_is_set() {
    let Some(mut browser) = browser() else { return };
    for screen in [Screen::TABLET, Screen::PHONE] {
        let bench = Bench::new();
        let table = bench.file("machine.toml", MACHINE).display().to_string();
        let server = serve(&bench, PROGRAM, &["--machine", &table]);
        let machine = Machine::new(&server);
        let mut user = in_control(&mut browser, &server, screen);
        user.wait_for_word("READY");
        wait_for_ink(&mut user, [75.0, 20.0], PLANNED, true);
        assert_eq!(user.canvas_pixels(PLACED), 0);
        // At 36.87 degrees, and so far out that the end of the contour is beyond the travel.
        take_point(&mut user, &machine, [230.0, 10.0], 1);
        assert_eq!(user.canvas_pixels(PLACED), 0, "one point places nothing");
        take_point(&mut user, &machine, [290.0, 55.0], 2);
        wait_for_ink(&mut user, [278.0, 71.0], PLACED, true);
        open_dialog(&mut user);
        user.wait_for_text(".dialog", "turned by +36.870°");
        user.wait_for_text(".dialog .cause", "BEYOND THE TRAVEL: X+ by 14.0 mm");
        user.picture(&format!("sheet-beyond-{}", screen.width));
        user.tap(".dialog button", "Forget both points");
        machine.wait("no points", |report| report["state"]["sheet"].is_null());
        wait_for_ink(&mut user, [75.0, 20.0], PLANNED, true);
        assert_eq!(user.wait_for_pixels(PLACED, |pixels| pixels == 0), 0, "it lies as before");
        take_point(&mut user, &machine, [20.0, 10.0], 1);
        take_point(&mut user, &machine, [100.0, 70.0], 2);
        // The middle of the first line, and the end of the second one.
        for at in [[68.0, 71.0], [80.0, 130.0]] {
            wait_for_ink(&mut user, at, PLACED, true);
        }
        wait_for_ink(&mut user, [75.0, 20.0], PLANNED, false);
        open_dialog(&mut user);
        user.wait_for_text(
            ".dialog .cause",
            "Free between the contours and the soft limits: X- 52.0, X+ 196.0, Y- 64.0, Y+ 170.0 mm",
        );
        let left = machine.report()["state"]["sheet"]["travel_left_mm"].clone();
        assert_eq!(left, json!([[52.0, 196.0], [64.0, 170.0]]));
        user.picture(&format!("sheet-placed-{}", screen.width));
        let before = machine.wait_for_rest();
        user.tap(".dialog button", "Cancel");
        wait_for_ink(&mut user, [68.0, 71.0], PLACED, true);
        assert_eq!(machine.report()["state"]["sheet"]["points"], 2, "it is neither set nor forgotten");
        open_dialog(&mut user);
        user.tap(".dialog button", "Set zero and direction");
        machine.wait("no points", |report| report["state"]["sheet"].is_null());
        // The machine stands where the second point was taken: the path begins there.
        wait_for_ink(&mut user, [68.0, 71.0], PLANNED, true);
        assert_eq!(user.wait_for_pixels(PLACED, |pixels| pixels == 0), 0);
        user.picture(&format!("sheet-set-{}", screen.width));
        let after: Value = machine.wait_for_rest()["live"]["mm"].clone();
        assert_eq!(after, before["live"]["mm"], "setting the edge moves nothing");
    }
}

/// A frame says what it goes round, and shows it in the drawing, before anything moves; cancelled, nothing does.
#[test]
fn a_frame_says_what_it_goes_round_before_anything_moves() {
    let Some(mut browser) = browser() else { return };
    for screen in [Screen::TABLET, Screen::PHONE] {
        let bench = Bench::new();
        let table = bench.file("machine.toml", MACHINE).display().to_string();
        let server = serve(&bench, PROGRAM, &["--machine", &table]);
        let machine = Machine::new(&server);
        let mut user = in_control(&mut browser, &server, screen);
        user.wait_for_word("READY");
        user.wait("import('/page/app.js').then(({ pathView: { store } }) => store.state.cut_extents_mm !== null)");
        let corners = |user: &mut PageUser| {
            let shown = user.evaluate(
                "getComputedStyle(document.querySelector('.frame-line')).display === 'none' ? 0 :
                 document.querySelector('.frame-line polygon').getAttribute('points').split(' ').length",
            );
            shown.as_u64().expect("a number")
        };
        let before = machine.wait_for_rest()["live"]["mm"].clone();
        user.evaluate("document.activeElement.blur()");
        user.key("F");
        user.wait_for_text(".dialog h2", "Frame: the rectangle");
        user.wait_for_text(".dialog .cause", "X 30.000 to 120.000, Y 20.000 to 60.000 mm of the machine");
        user.wait_for_text(".dialog .frame-height", "Stays at Z 0.000 mm of the machine: no safe height is set.");
        user.wait("getComputedStyle(document.querySelector('.frame-line')).display !== 'none'");
        assert_eq!(corners(&mut user), 4);
        user.picture(&format!("frame-{}", screen.width));
        user.tap(".dialog button", "Cancel");
        user.wait("getComputedStyle(document.querySelector('.frame-line')).display === 'none'");
        assert_eq!(machine.wait_for_rest()["live"]["mm"], before, "nothing has moved");

        user.evaluate("document.activeElement.blur()");
        user.key("F");
        user.tap(".dialog button", "Go round");
        machine.wait("motion", |report| report["live"]["mm"] != before);
        assert_eq!(corners(&mut user), 4, "it stays while the tool goes round");
        machine.wait("the corner where it began", |report| {
            let at = |axis: usize| report["live"]["mm"][axis].as_f64().unwrap_or(f64::NAN);
            report["live"]["at_rest"] == true && (at(0) - 30.0).abs() < 0.01 && (at(1) - 20.0).abs() < 0.01
        });
        user.wait("getComputedStyle(document.querySelector('.frame-line')).display === 'none'");

        // Beyond a soft limit the extents of before are not shown any more, and the frame is refused.
        user.wait("import('/page/app.js').then(({ pathView: { store } }) => store.allows('mdi'))");
        user.tap("#tab-mdi", "");
        // An order for a state that has changed meanwhile is refused, and given again.
        let is_unknown =
            "import('/page/app.js').then(({ pathView: { store } }) => store.state.cut_extents_mm === null)";
        for _ in 0..5 {
            user.tap(".mdi-text", "");
            user.type_text("G10 L2 P1 X250");
            user.key("Enter");
            let begun = Instant::now();
            while begun.elapsed() < Duration::from_secs(5) && user.evaluate(is_unknown) != true {
                std::thread::sleep(Duration::from_millis(100));
            }
            if user.evaluate(is_unknown) == true {
                break;
            }
        }
        user.wait(is_unknown);
        user.tap("#tab-path", "");
        user.evaluate("document.activeElement.blur()");
        user.key("F");
        user.wait_for_text(".dialog h2", "Frame: the rectangle");
        assert_eq!(user.count(".dialog .cause"), 0);
        user.tap(".dialog button", "Go round");
        user.wait("import('/page/app.js').then(({ pathView: { store } }) => store.rejected?.t === 'rejected')");
        user.wait("getComputedStyle(document.querySelector('.frame-line')).display === 'none'");
    }
}
