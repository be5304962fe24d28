//! A run on a served card while the broker of its shop is away: nothing of it is late, and everything follows when the
//! broker is back (SHP-18).
//!
//! The number of cases is that of the seconds for which the broker is away.

use std::process::Stdio;
use std::thread::sleep;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, cases};
use retrace_tests::served::ServedCard;
use retrace_tests::shop_broker::ShopBroker;
use serde_json::Value;

/// Waits until something is so. Returns how long that took.
#[track_caller]
fn wait_for(what: &str, limit_s: u64, mut is_so: impl FnMut() -> bool) -> f64 {
    let begun = Instant::now();
    while !is_so() {
        assert!(begun.elapsed() < Duration::from_secs(limit_s), "{what}: not within {limit_s} s");
        sleep(Duration::from_millis(50));
    }
    begun.elapsed().as_secs_f64()
}

fn states(broker: &ShopBroker) -> Value {
    let text = broker.done("office", &["watch", "--once", "--json"]);
    serde_json::from_str(&text).expect("one object")
}

#[test]
fn a_broker_that_is_away_disturbs_no_run_and_gets_everything_afterwards() {
    let away_s = u64::from(cases(3));
    let bench = Bench::new();
    // there and back on a line, 2 s each way, until the broker has been back for a while
    let passes = away_s / 4 + 3;
    let part =
        bench.file("part.ngc", format!("G21 G90 F3000\nO1 repeat [{passes}]\nG1 X100\nG1 X0\nO1 endrepeat\nM2\n"));
    let test = "shop_away::a_broker_that_is_away_disturbs_no_run_and_gets_everything_afterwards";
    let Some(mut broker) = ShopBroker::start(test, &bench, &["mill"], &[]) else { return };
    broker.start_agent("mill");
    let part = part.to_str().expect("a name");
    let id = broker.done("office", &["submit", part, "--machine", "mill", "--wait"]);
    let id = id.lines().next().expect("a name").to_owned();
    wait_for("the check", 20, || broker.done("mill", &["jobs"]).contains("ready"));
    let card = ServedCard::with(&[]);
    let file = broker.shop_file("mill");
    let run = ["run", "--job", &id, "--shop-file", &file, "--card", &card.port, "--json"];
    let mut host = bench.start(&run, Stdio::null(), "told.txt");
    wait_for("the run is seen", 10, || states(&broker)["machines"][0]["state"] == "RUNNING");
    broker.kill_server();
    sleep(Duration::from_secs(away_s));
    assert!(host.try_wait().expect("a child").is_none(), "it runs on");
    broker.start_server();
    let seen = wait_for("the state is there again", 35, || {
        let text = broker.retrace("office", &["watch", "--once", "--json"]).out;
        text.contains("\"state\":\"RUNNING\"") || host.try_wait().expect("a child").is_some()
    });
    assert_eq!(host.wait().expect("it ends").code(), Some(0));
    let told = std::fs::read_to_string(bench.path("told.txt")).expect("a file");
    let report: Value = serde_json::from_str(told.lines().last().unwrap_or_default()).expect("a report");
    assert_eq!((&report["underruns"], &report["limit_violations"]), (&0.into(), &0.into()), "{report}");
    assert_eq!(told.matches("\"event\":\"underrun\"").count(), 0);
    // taken, checked, started and ended, in their order
    let followed = wait_for("the events follow", 35, || {
        broker.retrace("office", &["audit", "--broker"]).out.contains("1 jobs, 0 faults")
            && broker.done("mill", &["jobs", "--all"]).contains("done")
    });
    let card = card.end();
    println!("{away_s} s away: state again after {seen:.1} s, events after {followed:.1} s, card {card}");
}
