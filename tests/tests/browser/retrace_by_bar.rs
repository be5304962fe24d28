//! The bar under the path: dragged back and forward in time.

use std::time::{Duration, Instant};

use retrace_tests::command::Bench;
use retrace_tests::page_user::Screen;
use serde_json::Value;

use super::{Machine, browser, in_control, pause, serve, zigzag};

/// Greatest distance of a position from the path: a pulse of an axis and rounding.
const TOLERANCE_MM: f64 = 0.02;

/// Rows of the job: 122 mm each two. It has to run for long enough that a slow computer takes the bar before its end.
const ROWS: u32 = 24;

/// Distance of a place from the zigzag, mm: from the row that is nearest, or from the end of the row below.
fn off_path_mm(report: &Value) -> f64 {
    let mm = |axis: usize| report["live"]["mm"][axis].as_f64().unwrap_or(f64::NAN);
    let (x, y) = (mm(0), mm(1));
    let row = y.round().clamp(0.0, f64::from(ROWS));
    let from_row = (y - row).abs().max(-x).max(x - 60.0);
    let side = if y.floor() % 2.0 == 0.0 { 60.0 } else { 0.0 };
    from_row.min((x - side).abs()) + mm(2).abs()
}

/// Watches the machine while the finger rests on the bar, until this is so. Returns the last report.
fn watch(machine: &Machine<'_>, what: &str, is_so: impl Fn(&Value) -> bool) -> Value {
    machine.wait(what, |report| {
        assert!(off_path_mm(report) < TOLERANCE_MM, "off the path: {report:#}");
        is_so(report)
    })
}

/// The main thing: a job of 1464 mm, dragged back by more than 200 mm and forward again, by touch and by mouse.
#[test]
fn the_path_is_dragged_back_and_forward() {
    let Some(mut browser) = browser() else { return };
    for screen in [Screen::TABLET, Screen::DESK.light()] {
        let bench = Bench::new();
        let server = serve(&bench, &zigzag(ROWS), &[]);
        let machine = Machine::new(&server);
        let mut user = in_control(&mut browser, &server, screen);
        user.tap(".motion.start", "");
        watch(&machine, "300 mm", |report| report["live"]["history_mm"].as_f64() > Some(300.0));
        // The finger takes the bar while the machine runs, and pulls to the left end.
        let track = user.find(".track", "");
        let at = |share: f64| (track.corner.0 + track.size.0 * share, track.middle.1);
        user.press(at(0.8));
        user.drag(at(0.8), at(0.05));
        let dragged = Instant::now();
        watch(&machine, "200 mm back", |report| report["live"]["back_mm"].as_f64() > Some(200.0));
        println!("200 mm back in {:.1} s", dragged.elapsed().as_secs_f64());
        user.picture(&format!("dragged-{}", screen.width));
        let ghost = user.evaluate("document.querySelector('.track-ghost').hidden");
        assert_eq!(ghost, false, "the ghost is under the finger");
        user.release(at(0.05));
        let stood = machine.wait_for_rest();
        assert!(off_path_mm(&stood) < TOLERANCE_MM, "{stood:#}");
        let record = |report: &Value| report["live"]["record"].as_f64().unwrap_or(f64::NAN);
        let (back, reached) = (record(&stood), stood["live"]["reached"].as_f64());
        // Forward, and let go before the end.
        user.press(at(0.1));
        user.drag(at(0.1), at(0.6));
        let moved = watch(&machine, "motion forward", |report| record(report) > back + 500.0);
        user.release(at(0.6));
        let stood = machine.wait_for_rest();
        assert!(record(&stood) >= record(&moved) && stood["live"]["reached"].as_f64() == reached, "{stood:#}");
        // And on to the end of the program.
        user.tap(".track-key", "resume");
        watch(&machine, "the end", |report| report["state"]["word"] == "ENDED");
        let end = machine.wait_for_rest();
        assert_eq!((&end["live"]["mm"][0], &end["live"]["mm"][1]), (&0.0.into(), &f64::from(ROWS).into()), "{end:#}");
        assert_eq!(end["live"]["record"].as_f64(), end["live"]["reached"].as_f64());
    }
}

/// A hold ends a drag: the machine stands though the finger moves on, and follows once it has taken the bar again.
#[test]
fn a_hold_ends_the_drag() {
    let Some(mut browser) = browser() else { return };
    let bench = Bench::new();
    let server = serve(&bench, &zigzag(ROWS), &[]);
    let machine = Machine::new(&server);
    let mut user = in_control(&mut browser, &server, Screen::TABLET);
    user.tap(".motion.start", "");
    machine.wait("300 mm", |report| report["live"]["history_mm"].as_f64() > Some(300.0));
    let track = user.find(".track", "");
    let at = |share: f64| (track.corner.0 + track.size.0 * share, track.middle.1);
    user.press(at(0.8));
    user.drag(at(0.8), at(0.4));
    machine.wait("50 mm back", |report| report["live"]["back_mm"].as_f64() > Some(50.0));
    user.key(" ");
    machine.wait("the hold", |report| report["state"]["hold_reason"] == "hold");
    let stood = machine.wait_for_rest();
    user.wait("document.querySelector('.track-ghost').hidden");
    // The finger is still on the bar.
    user.drag(at(0.4), at(0.1));
    pause(Duration::from_millis(500));
    assert_eq!(machine.wait_for_rest()["live"]["record"], stood["live"]["record"]);
    user.release(at(0.1));
    user.press(at(0.4));
    user.drag(at(0.4), at(0.1));
    let back = stood["live"]["back_mm"].as_f64();
    machine.wait("motion backward", |report| report["live"]["back_mm"].as_f64() > back);
    user.release(at(0.1));
    machine.wait_for_rest();
}

/// As a new user would: from the demonstration to a first retrace, with no text but the page's own.
#[test]
fn the_demonstration_is_retraced_by_a_new_user() {
    let Some(mut browser) = browser() else { return };
    let server = retrace_tests::page_client::PageServer::start(&["--demo"]);
    let machine = Machine::new(&server);
    let begun = Instant::now();
    let mut user = in_control(&mut browser, &server, Screen::TABLET);
    user.tap(".motion", "CYCLE START");
    machine.wait("a cut", |report| report["live"]["history_mm"].as_f64() > Some(150.0));
    let track = user.find(".track", "");
    let at = |share: f64| (track.corner.0 + track.size.0 * share, track.middle.1);
    user.press(at(0.8));
    user.drag(at(0.8), at(0.3));
    machine.wait("30 mm back", |report| report["live"]["back_mm"].as_f64() > Some(30.0));
    println!("a new user retraces after {:.1} s", begun.elapsed().as_secs_f64());
    user.picture("demo-dragged");
    user.release(at(0.3));
    machine.wait_for_rest();
    std::thread::sleep(Duration::from_millis(200));
    user.picture("demo-let-go");
}
