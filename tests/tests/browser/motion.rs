//! Cycle start, hold, reverse and forward run, overrides, and the keys of the table.

use retrace_tests::command::Bench;
use retrace_tests::page_user::Screen;

use super::{Machine, browser, in_control, serve, zigzag};

/// HOLD acts where the finger comes down, on every screen and beside every dialog, and as Space.
#[test]
fn hold_acts_at_once_by_touch_and_by_key() {
    let Some(mut browser) = browser() else { return };
    for screen in [Screen::TABLET, Screen::PHONE, Screen::DESK] {
        let bench = Bench::new();
        let server = serve(&bench, &zigzag(90), &[]);
        let machine = Machine::new(&server);
        let mut user = in_control(&mut browser, &server, screen);
        user.wait_for_word("READY");
        user.tap(".motion.start", "");
        user.wait_for_word("RUNNING");
        // The finger is down, and not up yet.
        let spot = user.find(".motion.hold", "");
        user.press(spot.middle);
        user.wait_for_word("FEED HOLD");
        user.release(spot.middle);
        machine.wait_for_rest();
        user.tap(".motion.start", "");
        user.wait_for_word("RUNNING");
        user.key(" ");
        user.wait_for_word("FEED HOLD");
        user.tap(".motion.start", "");
        user.wait_for_word("RUNNING");
        // A dialog that leaves nothing else free.
        user.tap("#control-button", "");
        user.wait("document.querySelector('.dialog') !== null");
        user.tap(".motion.hold", "");
        user.wait_for_word("FEED HOLD");
        user.picture(&format!("hold-{}", screen.width));
        user.key("Escape");
        user.wait("document.querySelector('.dialog') === null");
        let before = machine.wait_for_rest();
        assert!(before["live"]["record"].as_f64() < before["live"]["planned"].as_f64(), "{before:#}");
    }
}

/// REVERSE goes back along the path and FORWARD forward, with what was gone back in its own colour.
#[test]
fn reverse_and_forward_run_are_seen_in_the_path() {
    let Some(mut browser) = browser() else { return };
    for (screen, colour) in [(Screen::TABLET, [230, 159, 0]), (Screen::DESK.light(), [213, 94, 0])] {
        let bench = Bench::new();
        let server = serve(&bench, &zigzag(90), &[]);
        let machine = Machine::new(&server);
        let mut user = in_control(&mut browser, &server, screen);
        user.tap(".motion.start", "");
        machine.wait("100 mm", |report| report["live"]["history_mm"].as_f64() > Some(100.0));
        user.tap(".motion.hold", "");
        machine.wait_for_rest();
        assert_eq!(user.canvas_pixels(colour), 0, "nothing is retraced yet");
        user.tap(".motion.reverse", "");
        user.wait_for_word("REVERSE");
        machine.wait("60 mm back", |report| report["live"]["back_mm"].as_f64() > Some(60.0));
        user.tap(".motion.hold", "");
        let back = machine.wait_for_rest()["live"]["back_mm"].as_f64();
        user.picture(&format!("retraced-{}", screen.width));
        let pixels = user.canvas_pixels(colour);
        assert!(pixels > 100, "{pixels} pixels of what was retraced");
        user.tap(".motion.forward", "");
        user.wait_for_word("FORWARD");
        machine.wait("the furthest place", |report| report["live"]["back_mm"] == 0.0);
        assert!(back > Some(60.0));
        let left = user.wait_for_pixels(colour, |pixels| pixels == 0);
        assert_eq!(left, 0, "it is cut again");
    }
}

/// The overrides act on the machine, up and down and back to 100 %.
#[test]
fn overrides_are_set_by_touch() {
    let Some(mut browser) = browser() else { return };
    let bench = Bench::new();
    let server = serve(&bench, &zigzag(90), &[]);
    let machine = Machine::new(&server);
    let mut user = in_control(&mut browser, &server, Screen::TABLET);
    user.tap(".motion.start", "");
    user.wait_for_word("RUNNING");
    user.tap("#feed button", "feed override down");
    user.tap("#feed button", "feed override down");
    machine.wait("80 %", |report| report["state"]["override"] == 0.8);
    user.wait_for_text("#feed .override .whole", "80");
    machine.wait("the rate", |report| report["live"]["rate"].as_f64().is_some_and(|rate| (rate - 0.8).abs() < 0.01));
    user.tap("#feed button", "feed override up");
    machine.wait("90 %", |report| report["state"]["override"] == 0.9);
    user.tap("#feed .whole", "feed");
    machine.wait("100 %", |report| report["state"]["override"] == 1.0);
    user.tap("#feed button", "rapid override down");
    machine.wait("50 %", |report| report["state"]["rapid_override"] == 0.5);
    user.tap("#feed .whole", "rapid");
    machine.wait("100 %", |report| report["state"]["rapid_override"] == 1.0);
    user.tap("#feed button", "speed override up");
    machine.wait("110 %", |report| report["state"]["speed_override"] == 1.1);
    user.tap("#feed button", "speed override down");
    user.tap("#feed button", "speed override down");
    machine.wait("90 %", |report| report["state"]["speed_override"] == 0.9);
    user.tap("#feed .whole", "speed");
    machine.wait("100 %", |report| report["state"]["speed_override"] == 1.0);
}

/// The keys of the table: motion, handwheel, overrides, tabs.
#[test]
fn everything_is_done_by_keys_too() {
    let Some(mut browser) = browser() else { return };
    let bench = Bench::new();
    let server = serve(&bench, &zigzag(90), &[]);
    let machine = Machine::new(&server);
    let mut user = in_control(&mut browser, &server, Screen::DESK);
    user.wait_for_word("READY");
    user.key("c");
    user.wait_for_word("RUNNING");
    user.key("-");
    machine.wait("90 %", |report| report["state"]["override"] == 0.9);
    user.key("0");
    machine.wait("100 %", |report| report["state"]["override"] == 1.0);
    machine.wait("40 mm", |report| report["live"]["history_mm"].as_f64() > Some(40.0));
    user.key(" ");
    user.wait_for_word("FEED HOLD");
    user.key("r");
    user.wait_for_word("REVERSE");
    machine.wait("10 mm back", |report| report["live"]["back_mm"].as_f64() > Some(10.0));
    user.key(" ");
    machine.wait_for_rest();
    // An order that was given to what the page showed before is refused.
    user.wait_for_word("FEED HOLD");
    user.key("f");
    user.wait_for_word("FORWARD");
    user.key(" ");
    let before = machine.wait_for_rest()["live"]["record"].as_f64();
    user.wait_for_word("FEED HOLD");
    user.key("w");
    user.wait_for_word("HANDWHEEL");
    (0..10).for_each(|_| user.key("ArrowLeft"));
    machine.wait("motion back", |report| report["live"]["record"].as_f64() < before);
    machine.wait_for_rest();
    for (key, tab) in [("g", "log"), ("?", "help"), ("T", "tools"), ("C", "contours")] {
        user.key(key);
        user.wait(&format!("document.getElementById('tab-{tab}').getAttribute('aria-selected') === 'true'"));
    }
    user.key("l");
    user.wait_for_word("RUNNING");
    user.key("h");
    user.wait_for_word("FEED HOLD");
}
