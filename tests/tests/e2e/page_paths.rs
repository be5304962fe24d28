//! The path of a job whose plan is not known as a whole: it is shown as it is executed.

use retrace_tests::command::Bench;
use retrace_tests::page_client::{Page, PageServer};
use serde_json::json;

/// Two long lines at 50 mm/s, and back.
const LINES: &str = "G21 G90 G17 G94 G61\nF3000\nG1 X60\nG1 Y50\nG1 X0\nG1 Y0\nM2\n";

fn bounds(page: &Page) -> [f64; 2] {
    let bounds = &page.last("path")["bounds_mm"][1];
    [0, 1].map(|axis| bounds[axis].as_f64().unwrap_or(f64::NAN))
}

/// A job that begins at a line: its records are its own, and so is its path, which grows; then the program's is back.
#[test]
fn a_job_that_begins_inside_its_program_shows_its_own_path() {
    let bench = Bench::new();
    let program = bench.file("program.ngc", LINES).display().to_string();
    let journal = bench.path("jobs").display().to_string();
    let server = PageServer::start(&[&program, "--journal", &journal]);
    let mut page = server.page(&server.token);
    page.take_control();
    page.wait_until("the path of the program", |page| bounds(page) == [60.0, 50.0]);
    page.wait_for_word("READY");
    let whole = page.last("path")["path"].clone();
    assert_eq!(page.order("start line 5")["t"], "done");
    page.wait_until("another path", |page| {
        page.last("path")["path"] != whole && page.last("state")["program"]["path"] == page.last("path")["path"]
    });
    let first = page.last("path")["records"].as_u64().expect("a number");
    page.wait_until("a longer one", |page| page.last("path")["records"].as_u64() > Some(first));
    assert_eq!(page.last("state")["stage"], "job");
    // Its records are those that were executed, and have their lines.
    let path = page.last("path").clone();
    let records = path["records"].as_u64().expect("a number");
    assert!(records as f64 <= page.live("planned"), "{records} {}", page.live("planned"));
    page.send(&json!({"t": "where", "id": 1, "path": path["path"], "record": records - 1}));
    page.wait_until("the line", |page| page.last("where")["id"] == 1);
    assert!((5..=6).contains(&page.last("where")["line"].as_u64().unwrap_or(0)), "{}", page.last("where"));
    page.wait_for_word("ENDED");
    page.wait_until("the path of the program", |page| bounds(page) == [60.0, 50.0]);
}
