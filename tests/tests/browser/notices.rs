//! What the page tells without being asked: a new program, and an order that the machine did not carry out.

use retrace_tests::command::Bench;
use retrace_tests::page_user::Screen;

use super::{Machine, browser, in_control, serve, zigzag};

/// A program that appears in the watched folder is offered, loaded by a tap, and started by nothing.
#[test]
fn a_new_program_is_offered_and_loaded_by_a_tap() {
    let Some(mut browser) = browser() else { return };
    for screen in [Screen::TABLET, Screen::PHONE.light()] {
        let bench = Bench::new();
        let watched = bench.path("watched");
        std::fs::create_dir(&watched).expect("a folder");
        let server = serve(&bench, &zigzag(4), &["--watch", &watched.display().to_string()]);
        let machine = Machine::new(&server);
        let mut user = in_control(&mut browser, &server, screen);
        user.wait_for_word("READY");
        std::thread::sleep(std::time::Duration::from_millis(1500));
        std::fs::write(watched.join("new.ngc"), "G21 G90 G94\nF600\nG1 X3\nM2\n").expect("a file");
        user.wait_for_text("#notices", "new.ngc is new in the watched folder");
        user.picture(&format!("offer-{}", screen.width));
        assert_eq!(machine.report()["state"]["program"]["name"], "program.ngc");
        user.tap(".notice button", "Load");
        machine.wait("the program", |report| report["state"]["program"]["name"] == "new.ngc");
        user.wait_for_word("READY");
        let report = machine.report();
        assert_eq!((&report["state"]["stage"], &report["live"]["mm"][0]), (&"setup".into(), &0.0.into()), "{report:#}");
        assert_eq!(user.count(".notice"), 0);
    }
}

/// A block that the machine refuses after the order was passed on is shown where it was given.
#[test]
fn an_order_that_is_not_carried_out_is_shown_with_its_cause() {
    let Some(mut browser) = browser() else { return };
    let bench = Bench::new();
    let server = serve(&bench, &zigzag(90), &[]);
    let mut user = in_control(&mut browser, &server, Screen::TABLET);
    user.wait_for_word("READY");
    user.tap("[role=tab]", "MDI");
    user.tap(".mdi-text", "");
    user.type_text("G1 X90000 F100");
    user.key("Enter");
    user.wait_for_text(".notice", "soft limit");
    user.picture("rejected");
    user.tap(".notice button", "Close");
    user.tap(".motion.start", "");
    user.wait_for_word("RUNNING");
    // Nothing of it is shown again.
    assert_eq!(user.count(".notice"), 0);
    user.tap(".motion.hold", "");
    user.wait_for_word("FEED HOLD");
}
