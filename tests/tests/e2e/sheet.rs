//! The edge of the sheet by two points, on a page and at the screen (CUT-58).
//!
//! Invariant: positions are those that the page or the screen shows.

use retrace_tests::command::Bench;
use retrace_tests::page_client::{Page, PageServer};
use retrace_tests::terminal::Terminal;

/// A table with a pointer that looks at X + 10 and Y − 4 from the torch, on output 5.
const MACHINE: &str = "homed = true\n\
    [[axis]]\nname = \"x\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = 150\nmax_acceleration_mm_per_s2 = 1000\n\
    max_jerk_mm_per_s3 = 20000\ntravel_mm = [-20, 300]\n\
    [[axis]]\nname = \"y\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = 150\nmax_acceleration_mm_per_s2 = 1000\n\
    max_jerk_mm_per_s3 = 20000\ntravel_mm = [-20, 300]\n\
    [[axis]]\nname = \"z\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = 60\nmax_acceleration_mm_per_s2 = 1000\n\
    max_jerk_mm_per_s3 = 20000\ntravel_mm = [-60, 0]\n\
    [[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\n\
    [manual]\npointer_mm = { x = 10, y = -4 }\npointer_output = 5\n";
const PROGRAM: &str = "G21 G90 G61 F900\nG0 X30 Y20\nM3\nG1 X60\nM5\nM2\n";

fn in_control(bench: &Bench) -> (PageServer, Page) {
    let machine = bench.file("m.toml", MACHINE).display().to_string();
    let (server, mut page) = PageServer::in_control(bench, PROGRAM, &["--machine", &machine]);
    page.wait_until("live figures", |page| !page.last("live").is_null());
    (server, page)
}

/// Orders a block, or a jog, and waits until the machine is there.
fn move_to(page: &mut Page, order: &str, [x, y]: [f64; 2]) {
    let done = page.order_when_free(order);
    assert_eq!(done["t"], "done", "{order}: {done}");
    page.wait_until(&format!("{order}: X{x} Y{y}"), |page| {
        let off = [page.machine_mm(0) - x, page.machine_mm(1) - y];
        page.last("live")["at_rest"] == true && off.iter().all(|off| off.abs() < 0.006)
    });
}

fn points(page: &Page) -> i64 {
    page.last("state")["sheet"]["points"].as_i64().unwrap_or(0)
}

/// Two points along X, taken with the torch: the job's zero is the first point, and its X goes through the second one.
/// Points that are no edge are refused, and the first one stays.
#[test]
fn two_points_set_the_zero_and_the_direction() {
    let bench = Bench::new();
    let (_server, mut page) = in_control(&bench);
    move_to(&mut page, "mdi G53 G0 X20 Y10", [20.0, 10.0]);
    assert_eq!(page.order_when_free("sheet point")["t"], "done");
    page.wait_until("one point", |page| points(page) == 1);
    page.wait_for_word("SHEET EDGE");
    move_to(&mut page, "mdi G53 G0 X50 Y10", [50.0, 10.0]);
    page.order_when_free("sheet point");
    page.wait_until("the refusal", |page| page.last("log").to_string().contains("30.0 mm apart"));
    assert_eq!(points(&page), 1);
    move_to(&mut page, "mdi G53 G0 X100 Y70", [100.0, 70.0]);
    assert_eq!(page.order_when_free("sheet point")["t"], "done");
    page.wait_until("two points", |page| points(page) == 2);
    let text = page.last("state")["sheet"]["text"].to_string();
    // 80 and 60 mm: 100 mm at 36.87 degrees.
    assert!(text.contains("100.0 mm of the edge, which becomes X") && text.contains("turned by +36.870°"), "{text}");
    assert_eq!(page.order_when_free("sheet align")["t"], "done");
    page.wait_until("no points", |page| points(page) == 0);
    move_to(&mut page, "mdi G0 X0 Y0", [20.0, 10.0]);
    move_to(&mut page, "mdi G0 X150", [140.0, 100.0]);
    move_to(&mut page, "mdi G0 X0 Y50", [-10.0, 50.0]);
}

/// A program that also moves in coordinates of the machine is not turned as a whole: the page is not told to turn its
/// drawing, and what the job leaves of the travel is not given as if it were.
#[test]
fn a_program_with_machine_coordinates_is_not_shown_as_turned() {
    for (more, is_whole) in [("", true), ("G53 G0 X0 Y0\n", false), ("G55 G0 X0 Y0\n", false)] {
        let bench = Bench::new();
        let machine = bench.file("m.toml", MACHINE).display().to_string();
        let program = PROGRAM.replace("M2\n", &format!("{more}M2\n"));
        let (_server, mut page) = PageServer::in_control(&bench, &program, &["--machine", &machine]);
        page.wait_until("live figures", |page| !page.last("live").is_null());
        move_to(&mut page, "mdi G53 G0 X20 Y10", [20.0, 10.0]);
        assert_eq!(page.order_when_free("sheet point")["t"], "done");
        page.wait_until("one point", |page| points(page) == 1);
        move_to(&mut page, "mdi G53 G0 X100 Y70", [100.0, 70.0]);
        assert_eq!(page.order_when_free("sheet point")["t"], "done");
        page.wait_until("what it would leave", |page| !page.last("state")["sheet"]["travel_text"].is_null());
        let sheet = page.last("state")["sheet"].clone();
        assert_eq!(!sheet["placement"].is_null(), is_whole, "{more}: {sheet}");
        assert_eq!(!sheet["travel_left_mm"].is_null(), is_whole, "{more}: {sheet}");
        let text = sheet["travel_text"].to_string();
        assert_eq!(text.contains("Free between the contours and the soft limits"), is_whole, "{more}: {text}");
    }
}

/// Taken with the pointer, the points are where it looks; along Y, the job's Y goes through the second one. What is
/// forgotten sets nothing.
#[test]
fn the_pointer_takes_points_along_y() {
    let bench = Bench::new();
    let (_server, mut page) = in_control(&bench);
    move_to(&mut page, "mdi G53 G0 X30 Y20", [30.0, 20.0]);
    assert_eq!(page.order_when_free("sheet point")["t"], "done");
    page.wait_until("one point", |page| points(page) == 1);
    // Here again it is no second point, and the first one stays until it is forgotten.
    page.order_when_free("sheet point");
    page.wait_until("the refusal", |page| page.last("log").to_string().contains("0.0 mm apart"));
    assert_eq!(points(&page), 1);
    assert_eq!(page.order_when_free("sheet forget")["t"], "done");
    page.wait_until("no points", |page| points(page) == 0);
    let refused = page.order_when_free("sheet align");
    page.wait_until("the refusal", |page| page.last("log").to_string().contains("needs two points"));
    assert!(refused["t"] == "done" || refused["number"] == "E2163", "{refused}");
    assert_eq!(page.order_when_free("output 5 on")["t"], "done");
    assert_eq!(page.order_when_free("sheet point")["t"], "done");
    page.wait_until("one point", |page| points(page) == 1);
    move_to(&mut page, "jog y 200", [30.0, 220.0]);
    assert_eq!(page.order_when_free("sheet point")["t"], "done");
    page.wait_until("two points", |page| points(page) == 2);
    let text = page.last("state")["sheet"]["text"].to_string();
    let is_so = text.contains("work zero to X40.000 Y16.000") && text.contains("of the edge, which becomes Y");
    assert!(is_so, "{text}");
    assert_eq!(page.order_when_free("sheet align")["t"], "done");
    page.wait_until("no points", |page| points(page) == 0);
    move_to(&mut page, "mdi G0 X0 Y0", [40.0, 16.0]);
    move_to(&mut page, "mdi G0 Y100", [40.0, 116.0]);
}

/// The same at the screen, by its own words: E, y, jog, E, y. Nothing is started or traced in between.
#[test]
fn the_screen_leads_through_it() {
    let bench = Bench::new();
    let [program, machine] = [("program.ngc", PROGRAM), ("m.toml", MACHINE)]
        .map(|(name, text)| bench.file(name, text).display().to_string());
    let state = bench.path("state").display().to_string();
    let arguments = ["run", &program, "--machine", &machine, "--realtime", "--tui"];
    let terminal = Terminal::with(&arguments, 120, 30, &[("XDG_STATE_HOME", &state)]);
    terminal.wait_for_text("READY");
    terminal.keys("E");
    terminal.wait_for_text("y take the 1st point here");
    terminal.keys("y");
    let text = terminal.wait_for_text("1st point X0.0 Y0.0: jog 50 mm or more along the edge, E; Esc forgets it");
    assert!(text.contains("SHEET EDGE") && text.contains("E sheet"), "{text}");
    // Pressed again before the tool has moved, the key takes no second point, and the first one stays.
    terminal.keys("E");
    terminal.wait_for_text("E2163: the points of the edge are 0.0 mm apart");
    terminal.wait_for_state("SHEET EDGE", "1st point X0.0 Y0.0");
    for key in ["c", "F"] {
        terminal.keys(key);
        terminal.wait_for_text("points on the edge of the sheet are taken and not set");
        assert!(terminal.text().contains("SHEET EDGE"), "{}", terminal.text());
        std::thread::sleep(std::time::Duration::from_millis(4500));
    }
    terminal.keys("mG53 G0 X80 Y-2\r");
    terminal.wait_for_state("SHEET EDGE", "X      80.000");
    terminal.keys("E");
    terminal.wait_for_text("NOT SET YET: work zero to X0.000 Y0.000 of the machine, turned by -1.432°, measured over");
    terminal.wait_for_text("· as it will lie");
    terminal.wait_for_text("Free between the contours and the soft limits: X- 5");
    terminal.wait_for_text("y set zero and direction");
    terminal.keys("y");
    terminal.wait_for_text("READY");
    terminal.wait_for_text("TURNED by -1.432°");
    // The tool is 80 mm along X of the turned work coordinates.
    terminal.wait_for_text("80.025");
    terminal.keys("q");
}
