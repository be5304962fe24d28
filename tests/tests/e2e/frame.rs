//! The frame of a program, traced at the word of an operator on a page (CUT-59).
//!
//! Invariant: positions and outputs are those that the page shows.

use std::time::Duration;

use retrace_tests::command::Bench;
use retrace_tests::page_client::{Page, PageServer};
use serde_json::{Value, json};

/// A torch with a pointer that looks at X + 10 from it, on output 5.
const MACHINE: &str = "homed = true\nretract_mm = -5\n\
    [[axis]]\nname = \"x\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = 30\nmax_acceleration_mm_per_s2 = 1000\n\
    max_jerk_mm_per_s3 = 20000\ntravel_mm = [-20, 100]\n\
    [[axis]]\nname = \"y\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = 30\nmax_acceleration_mm_per_s2 = 1000\n\
    max_jerk_mm_per_s3 = 20000\ntravel_mm = [-20, 100]\n\
    [[axis]]\nname = \"z\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = 60\nmax_acceleration_mm_per_s2 = 1000\n\
    max_jerk_mm_per_s3 = 20000\ntravel_mm = [-60, 0]\n\
    [[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\n\
    [manual]\npointer_mm = { x = 10, y = 0 }\npointer_output = 5\n";

/// What is cut is from X 30 to X 60 and from Y 20 to Y 35; the feed moves beside it cut nothing.
const PROGRAM: &str = "G21 G90 G61 F900\nG0 X30 Y20\nM3\nG1 X60\nG1 Y35\nM5\nG1 X70 Y50\nG53 G0 X0 Y0\nM2\n";

fn in_control(bench: &Bench) -> (PageServer, Page) {
    let machine = bench.file("m.toml", MACHINE).display().to_string();
    let (server, mut page) = PageServer::in_control(bench, PROGRAM, &["--machine", &machine]);
    page.wait_until("live figures", |page| !page.last("live").is_null());
    (server, page)
}

/// Where the tool is before the frame, and at its corners in their order.
const CORNERS: [(f64, f64); 6] = [(0.0, 0.0), (20.0, 20.0), (50.0, 20.0), (50.0, 35.0), (20.0, 35.0), (20.0, 20.0)];

fn is_at(page: &Page, (x, y): (f64, f64)) -> bool {
    (page.machine_mm(0) - x).abs() < 0.01 && (page.machine_mm(1) - y).abs() < 0.01
}

/// Whether this point is on the line, within two pulses of 5 µm.
fn is_between(at: (f64, f64), from: (f64, f64), to: (f64, f64)) -> bool {
    const TWO_PULSES_MM: f64 = 0.01;
    let (along, off) = ((to.0 - from.0, to.1 - from.1), (at.0 - from.0, at.1 - from.1));
    let length = along.0.hypot(along.1);
    let beside = (along.0 * off.1 - along.1 * off.0) / length;
    let ahead = (along.0 * off.0 + along.1 * off.1) / length;
    beside.abs() < TWO_PULSES_MM && (-TWO_PULSES_MM..=length + TWO_PULSES_MM).contains(&ahead)
}

fn is_on(page: &Page, name: &str) -> bool {
    let outputs = page.last("state")["outputs"].as_array().cloned().unwrap_or_default();
    outputs.iter().any(|output| output.to_string().contains(name))
}

#[test]
fn a_frame_is_traced_at_the_word_of_a_page() {
    let bench = Bench::new();
    let (_server, mut page) = in_control(&bench);
    assert_eq!(page.order("frame")["t"], "done");
    let busy = page.order("jog x 1");
    assert_eq!(busy["number"], "E2421", "one order at a time: {busy}");
    // The pointer shows the corner where the tool is 10 mm before it. A page may miss positions, not see others.
    let mut sides_seen = vec![0];
    while sides_seen.len() < 2 || !(page.last("live")["at_rest"] == true && is_at(&page, CORNERS[5])) {
        let last = sides_seen[sides_seen.len() - 1];
        let at = (page.machine_mm(0), page.machine_mm(1));
        let side = (last..5).find(|side| is_between(at, CORNERS[*side], CORNERS[side + 1]));
        let side = side.unwrap_or_else(|| panic!("{at:?} is not on the frame from side {last} on"));
        if side != last {
            sides_seen.push(side);
        }
        assert!(!is_on(&page, "torch"), "{}", page.last("state"));
        page.listen(Duration::from_millis(1));
    }
    assert!(sides_seen.len() > 2, "{sides_seen:?}");
    page.wait_for_word("READY");
    // A program of this kind runs behind it.
    page.listen(Duration::from_millis(200));
    assert_eq!(page.order_when_free("cycle start")["t"], "done");
    page.wait_for_word("ENDED");
}

/// The work offset that is in force counts, and the side is told; nothing moves.
#[test]
fn a_frame_beyond_a_limit_is_refused_with_the_side() {
    let bench = Bench::new();
    let (_server, mut page) = in_control(&bench);
    assert_eq!(page.order("mdi G10 L2 P1 X55")["t"], "done");
    page.listen(Duration::from_millis(300));
    assert_eq!(page.order_when_free("frame")["t"], "done");
    page.wait_for_log("the program would cut at X 115.000 mm, 15.000 mm above the upper soft limit, 100.000 mm");
    assert_eq!(page.order_when_free("mdi G10 L2 P1 X-45")["t"], "done");
    page.listen(Duration::from_millis(300));
    assert_eq!(page.order_when_free("frame")["t"], "done");
    page.wait_for_log("to show the frame with the pointer the machine would move to X -25.000 mm, 5.000 mm below the");
    assert_eq!([page.machine_mm(0), page.machine_mm(1)], [0.0, 0.0]);
    assert_eq!(page.order_when_free("mdi G10 L2 P1 X0")["t"], "done");
    page.listen(Duration::from_millis(300));
    assert_eq!(page.order_when_free("cycle start")["t"], "done");
    page.wait_until("it cuts", |page| page.machine_mm(0) > 20.0);
    let refused: Value = page.order("frame");
    assert_eq!((&refused["t"], &refused["number"]), (&json!("refused"), &json!("E2408")), "{refused}");
}
