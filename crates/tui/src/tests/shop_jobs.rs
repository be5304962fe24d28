//! The page of the shop's jobs: golden files, keys, and the time of its redraw.

use std::sync::Arc;
use std::time::Instant;

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use retrace_controller::OperatorCommand;

use super::{PLAIN, ScreenFixture, text};
use crate::keys::Key;
use crate::model::ScreenStage;
use crate::model_observer::lock_model;
use crate::shop_job_page::tests::{row, table};
use crate::{ShopJobRow, ShopJobTable, UiCommand, view};

fn jobs() -> Vec<ShopJobRow> {
    let mut rows = vec![row(1, "done"), row(2, "refused"), row(3, "interrupted"), row(4, "ready"), row(5, "ready")];
    rows.push(ShopJobRow { check: String::new(), program: String::new(), good: 0, ..row(6, "queued") });
    rows[4].most_pieces = 2;
    let ready = &mut rows[3];
    ready.order_number = "A-4711/2 (rush)".into();
    ready.note = "for order 17; the burr goes to the inside, and the first piece to the measuring room".into();
    ready.program = "hydraulic-manifold-upper-half-rev-c.ngc".into();
    ready.warnings = vec!["the job was made for another machine file than mill.toml".into()];
    let rows_of = [
        ("pieces", "1 of 3"),
        ("check", "1 warning, 312 s"),
        ("", "warning[W1204]: line 12: the feed is above the maximum of the axis, and is reduced"),
        ("run", "20261122-004627-part: completed, started 2026-11-22T00:46:27.123Z"),
        ("next step", "cycle start (c) here, or retrace run --job 01a22509-1fde-7f8d-b56a-000000000004"),
    ];
    ready.details.extend(rows_of.map(|(name, text)| (name.to_owned(), text.to_owned())));
    rows
}

fn fixture(shown: ShopJobTable) -> ScreenFixture {
    let mut bench = ScreenFixture::new();
    bench.wait(5);
    lock_model(&bench.model).shop_jobs = Some(Arc::new(shown));
    bench
}

#[test]
fn the_pages_of_the_jobs_are_as_they_were_looked_at() {
    let mut bench = fixture(table(jobs()));
    bench.keys("Q");
    bench.is_as("12-jobs", 80, 24);
    bench.is_as("12-jobs", 130, 30);
    bench.keys("\n");
    bench.is_as("13-job-details", 80, 24);
    bench.key(Key::Esc);
    bench.keys("c");
    bench.is_as("14-job-start", 80, 24);
    bench.key(Key::Esc);
    bench.key(Key::Down);
    bench.keys("c");
    bench.key(Key::Up);
    bench.is_as("16-job-series", 80, 24);
    let mut empty = fixture(ShopJobTable { error: "E5009: the ledger is damaged".into(), ..table(Vec::new()) });
    empty.keys("Q");
    bench.key(Key::Esc);
    empty.is_as("15-jobs-error", 80, 24);
}

#[test]
fn a_start_is_two_keys_and_closes_when_another_job_runs() {
    let mut bench = fixture(table(jobs()));
    let start = UiCommand::StartShopJob { id: row(4, "ready").id, pieces: 1 };
    bench.keys("Qc");
    assert_eq!(bench.key(Key::Char('y')), Some(start.clone()));
    assert_eq!(bench.key(Key::Char('y')), None, "the page is closed");
    bench.keys("Qc");
    assert_eq!(bench.key(Key::Char(' ')), Some(UiCommand::Job(OperatorCommand::Hold)));
    bench.keys("Qc");
    lock_model(&bench.model).stage = ScreenStage::Job;
    assert_ne!(bench.key(Key::Char('y')), Some(start));
    bench.keys("Qc");
    assert!(text(&bench.screen(80, 24)).contains("a program is running"));
}

/// Prints the mean time to draw fifty jobs. It asserts nothing: the computer may be busy.
#[test]
fn fifty_jobs_are_drawn() {
    let mut bench = fixture(table((1..=50).map(|number| row(number, "ready")).collect()));
    bench.keys("Q");
    let picture = bench.picture();
    let mut out = Buffer::empty(Rect::new(0, 0, 200, 70));
    let begun = Instant::now();
    for _ in 0..100 {
        view::draw(&mut out, &picture, &bench.key_state, PLAIN, 0);
    }
    println!("50 jobs at 200 x 70: {:.2} ms", begun.elapsed().as_secs_f64() * 10.0);
    assert!(text(&out).contains("bracket-50.ngc"), "every job is on the page");
}
