//! The screen, as a person has it: keys in, cells out, through a pseudo-terminal.

use retrace_tests::terminal::Terminal;

const PROGRAM: &[&str] = &["screen-demo", "examples/02-back-up.ngc"];
const LEFT: &str = "\x1b[D";

/// The mm that stand before `mm back`.
fn back_mm(text: &str) -> f64 {
    let before = text.split(" mm back").next().unwrap_or_default();
    before.rsplit(|c: char| !c.is_ascii_digit() && c != '.').next().and_then(|w| w.parse().ok()).unwrap_or(0.0)
}

fn run_hold_back_up_and_finish(columns: u16, rows: u16) {
    let mut terminal = Terminal::running(PROGRAM, columns, rows);
    terminal.until("READY");
    assert!(terminal.is_full_screen() && terminal.is_coloured());
    terminal.keys("c");
    terminal.until("RUNNING");
    terminal.until_that("the second hole", |text| text.contains("> 10") || text.contains("> 13"));
    terminal.keys(" ");
    let held = terminal.until("FEED HOLD");
    assert!(held.contains("c cycle start · r back up · w handwheel"), "{held}");
    terminal.keys("w");
    terminal.until("HANDWHEEL");
    let turned = std::time::Instant::now();
    while back_mm(&terminal.text()) < 20.0 && turned.elapsed().as_secs() < 60 {
        terminal.keys(LEFT);
        std::thread::sleep(std::time::Duration::from_millis(30));
    }
    assert!(back_mm(&terminal.text()) >= 20.0, "{}", terminal.text());
    terminal.keys("l");
    terminal.until("RUNNING");
    let end = terminal.until("ENDED");
    assert!(end.contains("completed"), "{end}");
    terminal.keys("q");
    assert_eq!(terminal.ended(), Some(0));
    assert!(!terminal.is_full_screen(), "the terminal is as it was");
}

#[test]
fn a_job_is_run_held_backed_up_and_finished_at_80_by_24() {
    run_hold_back_up_and_finish(80, 24);
}

#[test]
fn and_at_200_by_60() {
    run_hold_back_up_and_finish(200, 60);
}

#[test]
fn it_follows_the_size_of_the_terminal() {
    let terminal = Terminal::running(PROGRAM, 80, 24);
    terminal.until("READY");
    terminal.resize(60, 10);
    terminal.until("80 x 24 is the least");
    terminal.resize(200, 60);
    let large = terminal.until("M2");
    assert!(large.lines().any(|line| line.chars().count() > 190), "{large}");
    terminal.resize(80, 24);
    terminal.until_that("the last line at the foot", |text| {
        text.lines().nth(23).is_some_and(|line| line.contains("? all keys"))
    });
}

#[test]
fn without_colour_nothing_is_coloured_and_everything_is_said() {
    for (variable, value) in [("NO_COLOR", "1"), ("TERM", "vt220")] {
        let terminal = Terminal::with(PROGRAM, 80, 24, &[(variable, value)]);
        terminal.until("READY");
        terminal.keys("c");
        terminal.until("RUNNING");
        terminal.keys("r");
        terminal.until("REVERSE");
        assert!(!terminal.is_coloured(), "{variable}={value}");
    }
}

#[test]
fn the_mouse_wheel_is_the_handwheel_in_its_mode_only() {
    let terminal = Terminal::running(PROGRAM, 80, 24);
    terminal.until("READY");
    terminal.keys("c");
    terminal.until_that("some way", |text| text.contains(">  7") || text.contains(">  8"));
    terminal.keys(" ");
    let held = terminal.until("FEED HOLD");
    let scroll_down = "\x1b[<65;10;10M";
    terminal.keys(scroll_down);
    terminal.keys("w");
    terminal.until("HANDWHEEL");
    assert!(!terminal.text().contains("operator: reverse"), "{held}");
    for _ in 0..20 {
        terminal.keys(scroll_down);
    }
    terminal.until_that("some mm back", |text| back_mm(text) > 0.5);
}
