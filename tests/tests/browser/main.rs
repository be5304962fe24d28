//! The page of `retrace serve` in a browser, used as a person uses it: `cargo xtask test --only browser`.
//!
//! What the machine does is read from the server beside the page. Times are waited for and never held against a limit
//! that a loaded computer could miss.

mod contours;
mod control;
mod layout;
mod million;
mod motion;
mod notices;
mod program_view;
mod retrace_by_bar;
mod setting_up;
mod sheet;
mod shop;
mod torch;

use retrace_tests::browser::Browser;
use retrace_tests::command::Bench;
use retrace_tests::not_run::not_run;
use retrace_tests::page_client::PageServer;
use retrace_tests::page_user::{PageUser, Screen};
use retrace_tests::pause::pause;
use serde_json::Value;

/// Markup with a script, where a page expects a text.
const HOSTILE: &str = "<img src=x onerror=alert`1`>";

/// A zigzag of so many rows of 60 mm, 1 mm apart, at 50 mm/s.
fn zigzag(rows: u32) -> String {
    zigzag_at(3000, rows)
}

/// The same at this feed, mm/min: a computer under load sees the machine seconds later.
fn zigzag_at(feed: u32, rows: u32) -> String {
    let row = |row: u32| format!("G1 X{}\nG1 Y{}\n", if row.is_multiple_of(2) { 60 } else { 0 }, row + 1);
    format!("G21 G90 G17 G94 G61\nF{feed}\n{}M2\n", (0..rows).map(row).collect::<String>())
}

/// A browser, or `None` and a report that this test did not run.
fn browser() -> Option<Browser> {
    let browser = Browser::start();
    if browser.is_none() {
        not_run(std::thread::current().name().unwrap_or("a test of the page"), "no browser");
    }
    browser
}

/// A server with this program, and its journal in the bench.
fn serve(bench: &Bench, program: &str, arguments: &[&str]) -> PageServer {
    let program = bench.file("program.ngc", program).display().to_string();
    let journal = bench.path("jobs").display().to_string();
    PageServer::start(&[&[&program, "--journal", &journal], arguments].concat())
}

/// A person that is in control of the machine of this server.
fn in_control(browser: &mut Browser, server: &PageServer, screen: Screen) -> PageUser {
    let mut user = PageUser::new(browser, screen);
    user.sign_in(server);
    user.wait_for_text("#control-button", "in control");
    user
}

/// What the server reports of the machine, beside every page.
struct Machine<'a> {
    server: &'a PageServer,
    cookie: String,
}

impl<'a> Machine<'a> {
    fn new(server: &'a PageServer) -> Self {
        let cookie = server.sign_in(&server.watch_token).expect("the token is right");
        Self { server, cookie }
    }

    /// State and live figures.
    fn report(&self) -> Value {
        self.server.request("GET", "/api/v1/state", &[("Cookie", &self.cookie)], b"").json()
    }

    fn live(&self, name: &str) -> f64 {
        self.report()["live"][name].as_f64().unwrap_or(f64::NAN)
    }

    /// Machine position of an axis, mm.
    fn mm(&self, axis: usize) -> f64 {
        self.report()["live"]["mm"][axis].as_f64().unwrap_or(f64::NAN)
    }

    fn word(&self) -> String {
        self.report()["state"]["word"].as_str().unwrap_or_default().to_owned()
    }

    /// Waits until this is so. Returns the report in which it is.
    fn wait(&self, what: &str, is_so: impl Fn(&Value) -> bool) -> Value {
        let begun = std::time::Instant::now();
        loop {
            let report = self.report();
            if is_so(&report) {
                return report;
            }
            assert!(begun.elapsed().as_secs() < 90, "`{what}` did not come: {report:#}");
            std::thread::sleep(std::time::Duration::from_millis(15));
        }
    }

    /// Waits until the machine stays at rest: one that follows a handwheel stands between its detents too. Returns the
    /// report in which it stood for a while.
    fn wait_for_rest(&self) -> Value {
        let is_at_rest = |report: &Value| report["live"]["at_rest"] == true && report["live"]["rate"] == 0.0;
        let begun = std::time::Instant::now();
        loop {
            let report = self.wait("rest", is_at_rest);
            pause(std::time::Duration::from_millis(300));
            let later = self.report();
            if is_at_rest(&later) && later["live"]["record"] == report["live"]["record"] {
                return later;
            }
            assert!(begun.elapsed().as_secs() < 90, "it does not stay at rest: {later:#}");
        }
    }
}
