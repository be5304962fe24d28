//! What the page has for a torch: height control while it cuts, the edge of the sheet before.

use retrace_tests::command::{Bench, root};
use retrace_tests::page_client::PageServer;
use retrace_tests::page_user::Screen;

use super::{Machine, browser, in_control};

/// A server with the example of height control, and its journal in the bench.
fn serve_torch(bench: &Bench) -> PageServer {
    let example = |name: &str| root().join("examples/height-control").join(name).display().to_string();
    let (program, machine) = (example("strips.ngc"), example("table.toml"));
    let journal = bench.path("jobs").display().to_string();
    PageServer::start(&[&program, "--machine", &machine, "--journal", &journal, "--source-faults", "warp=5"])
}

/// The torch one volt higher and back, the control off and on, by taps on the row of height control.
#[test]
fn height_control_has_a_row_of_its_own() {
    let Some(mut browser) = browser() else { return };
    for screen in [Screen::TABLET, Screen::DESK] {
        let bench = Bench::new();
        let server = serve_torch(&bench);
        let machine = Machine::new(&server);
        let mut user = in_control(&mut browser, &server, screen);
        user.wait_for_word("READY");
        user.tap(".motion", "CYCLE START");
        machine.wait("height control", |report| report["live"]["height"]["state"] == "active");
        user.wait_for_text(".height-text", "active");
        user.tap(".height-line button", "+");
        let higher = machine.wait("a volt more", |report| report["live"]["height"]["offset_volts"] == 1.0);
        assert!(higher["live"]["height"]["volts"].as_f64() > Some(105.0), "{higher:#}");
        user.wait_for_text(".height-text", "+1 V");
        user.picture(&format!("height-{}", screen.width));
        user.tap(".height-line button", "0");
        machine.wait("the voltage of the material", |report| report["live"]["height"]["offset_volts"] == 0.0);
        user.tap(".height-line button", "THC");
        machine.wait("off", |report| report["live"]["height"]["is_on"] == false);
        user.wait_for_text(".height-text", "OFF");
        user.tap(".height-line button", "THC");
        machine.wait("on", |report| report["live"]["height"]["is_on"] == true);
    }
}
