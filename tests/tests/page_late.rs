//! Pages do not make the motion late: `cargo xtask campaign page-late`.
//!
//! Runs without a page but the one that starts the program alternate with runs with five more, of which one never
//! reads what it is sent. The control periods are 1 ms in wall time, the motion thread is under SCHED_FIFO, and every
//! core is busy with something else. The command itself counts the periods that are late by more than a period.

use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, binary, cases};
use retrace_tests::not_run::not_run;
use retrace_tests::page_client::PageServer;
use serde_json::json;

/// Pairs of runs, unless the campaign sets another number.
const PAIRS: u32 = 1;
/// Time for which each run is watched, in a campaign and in the suite.
const WATCHED: Duration = Duration::from_secs(20);
const WATCHED_IN_THE_SUITE: Duration = Duration::from_secs(2);
/// Pages besides the one that starts the program.
const PAGES: u32 = 5;

/// Runs a program with so many more pages. Returns the number of late periods.
fn late_periods(pages: u32, watched: Duration) -> u64 {
    let bench = Bench::new();
    let zigzag = |n: u32| format!("G1 X{} Y{}\n", n % 100, n % 7);
    let program = bench.file("part.ngc", format!("G21 G90 F6000\n{}M2\n", (0..20_000).map(zigzag).collect::<String>()));
    let stderr = bench.path("stderr.txt");
    let mut command = Command::new("chrt");
    command.args(["-f", "40"]).arg(binary()).stderr(std::fs::File::create(&stderr).expect("a file"));
    let server = PageServer::start_as(command, &[&program.display().to_string()]);
    let mut first = server.page(&server.token);
    first.take_control();
    let is_over = AtomicBool::new(false);
    thread::scope(|scope| {
        let (is_over, server) = (&is_over, &server);
        for n in 0..pages {
            scope.spawn(move || {
                let mut page = server.page(&server.watch_token);
                while !is_over.load(Ordering::Relaxed) {
                    if n == 0 {
                        thread::sleep(Duration::from_millis(20));
                    } else {
                        page.listen(Duration::from_millis(50));
                    }
                }
            });
        }
        for _ in 0..thread::available_parallelism().map_or(2, usize::from) {
            scope.spawn(|| {
                while !is_over.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        assert_eq!(first.order("cycle start")["t"], "done");
        let begun = Instant::now();
        while begun.elapsed() < watched {
            first.listen(Duration::from_millis(50));
        }
        first.send(&json!({"t": "hold"}));
        first.wait_for_word("FEED HOLD");
        let planned_s = first.live("reached") / 1000.0;
        assert!(planned_s > 0.9 * watched.as_secs_f64(), "it moved for {planned_s} s only");
        is_over.store(true, Ordering::Relaxed);
    });
    drop(first);
    drop(server);
    let told = std::fs::read_to_string(&stderr).expect("what it told");
    // Where it was never late it prints nothing.
    let line = told.lines().find(|line| line.contains("the computer was late"));
    line.and_then(|line| line.split(' ').find_map(|word| word.parse().ok())).unwrap_or(0)
}

fn median(mut of: Vec<u64>) -> u64 {
    of.sort_unstable();
    of[of.len() / 2]
}

#[test]
fn pages_do_not_make_the_motion_late() {
    let may = Command::new("chrt").args(["-f", "40", "true"]).output();
    if !may.is_ok_and(|output| output.status.success()) {
        not_run("page-late", "SCHED_FIFO is not permitted, or there is no chrt");
        return;
    }
    let pairs = cases(PAIRS);
    let watched = if pairs > 2 { WATCHED } else { WATCHED_IN_THE_SUITE };
    let mut counted = [vec![], vec![]];
    for pair in 0..pairs {
        for (of, pages) in counted.iter_mut().zip([0, PAGES]) {
            let late = late_periods(pages, watched);
            println!("pair {pair}, {pages} more pages: {late} control periods late");
            of.push(late);
        }
    }
    let [without, with] = counted.map(median);
    println!("median of {pairs}: {without} late periods without, {with} with {PAGES} more pages");
    // In the suite other tests run beside it, of which some are in real time, too.
    assert!(pairs <= 2 || with <= without, "{with} late periods with pages, {without} without");
}
