//! Prints a picture of the page as PNG: the demonstration, while it is dragged back. `cargo xtask figures` uses it.

use std::io::Write as _;
use std::process::ExitCode;
use std::time::Duration;

use retrace_tests::browser::Browser;
use retrace_tests::page_client::PageServer;
use retrace_tests::page_user::{PageUser, Screen};

/// Length of path that is cut before it is dragged back, mm.
const CUT_MM: f64 = 600.0;

/// Length of path that it is dragged back, mm.
const BACK_MM: f64 = 220.0;

fn main() -> ExitCode {
    let Some(mut browser) = Browser::start() else {
        eprintln!("no browser: neither RETRACE_BROWSER nor chromium on PATH");
        return ExitCode::FAILURE;
    };
    let server = PageServer::start(&["--demo"]);
    let mut user = PageUser::new(&mut browser, Screen::TABLET);
    user.sign_in(&server);
    user.wait_for_text("#control-button", "in control");
    let mut watcher = server.page(&server.watch_token);
    user.tap(".motion.start", "");
    // The arc of the demonstration is lost once: the machine holds, and is started again.
    watcher.wait_until("the cut", |page| page.live("history_mm") > CUT_MM || page.last("state")["mode"] == "confirm");
    let track = user.find(".track", "");
    let at = |share: f64| (track.corner.0 + track.size.0 * share, track.middle.1);
    user.press(at(0.8));
    user.drag(at(0.8), at(0.45));
    watcher.wait_until("a length back", |page| page.live("back_mm") > BACK_MM);
    std::thread::sleep(Duration::from_millis(300));
    let picture = user.png();
    user.release(at(0.45));
    drop(user);
    match std::io::stdout().write_all(&picture) {
        Ok(()) => ExitCode::SUCCESS,
        Err(_) => ExitCode::FAILURE,
    }
}
