//! Jobs of a shop over the wire of the page: listed for everybody, started by the page in control alone (SHP-12,
//! SHP-36).

use std::process::Command;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, assert_contains, binary};
use retrace_tests::page_client::{Page, PageServer};
use serde_json::{Value, json};

const PART: &str = "G21 G90 G94 F6000\nG1 X20\nX25 Y5\nX0 Y0\nM2\n";
/// A program that takes a minute, so that nothing of it ends while a test looks at it.
const LONG_PART: &str = "G21 G90 G94 F600\nG1 X200\nX0\nX200\nM2\n";

#[track_caller]
fn done(bench: &Bench, arguments: &[&str]) -> String {
    let result = bench.retrace(arguments);
    assert_eq!(result.code, Some(0), "{arguments:?}: {}\n{}", result.out, result.err);
    result.out
}

fn submit(bench: &Bench, name: &str, text: &str, more: &[&str]) -> String {
    bench.file(name, text);
    let id = done(bench, &[&["shop", "submit", name], more].concat()).trim().to_owned();
    done(bench, &["shop", "agent", "--once"]);
    id
}

fn state(bench: &Bench, id: &str) -> Value {
    let job: Value = serde_json::from_str(&done(bench, &["shop", "show", id, "--json"])).expect("one object");
    json!([job["state"], job["good"], job["runs"].as_array().map(Vec::len)])
}

/// A server with the state folder of the bench, and its arguments.
fn serve(bench: &Bench, arguments: &[&str]) -> PageServer {
    let mut command = Command::new(binary());
    command.env("XDG_STATE_HOME", bench.path("state"));
    PageServer::start_as(command, arguments)
}

/// The list, once it has this job in this state.
fn listed(server: &PageServer, id: &str, state: &str) -> Value {
    let begun = Instant::now();
    loop {
        let list = server.get("/api/v1/shop/jobs").json();
        let job = list["jobs"].as_array().and_then(|jobs| jobs.iter().find(|job| job["id"] == id).cloned());
        match job {
            Some(job) if job["state"] == state => return job,
            _ => assert!(begun.elapsed() < Duration::from_secs(30), "{id} is not {state}: {list:#}"),
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[track_caller]
fn refused(answer: &Value, number: &str) {
    assert_eq!((answer["t"].as_str(), answer["number"].as_str()), (Some("refused"), Some(number)), "{answer}");
}

/// Waits for the box that says why a start was refused, and closes it.
fn not_started(page: &mut Page, number: &str) {
    page.wait_until(number, |page| page.last("state")["alarm"]["number"] == number);
    assert_eq!(page.order("reset")["t"], "done");
    page.wait_until("no box", |page| page.last("state")["alarm"].is_null());
}

#[test]
fn a_piece_is_started_by_the_page_in_control_only_and_counts() {
    let bench = Bench::new();
    let more = ["--quantity", "2", "--note", "burr inside", "--material", "steel"];
    let id = submit(&bench, "part.ngc", PART, &[&more[..], &["--order", "4711/2"]].concat());
    let server = serve(&bench, &[]);
    let job = listed(&server, &id, "ready");
    let [good, quantity] = ["good", "quantity"].map(|key| job[key].as_u64());
    assert_eq!(
        (good, quantity, &job["is_ready"], &job["check"]),
        (Some(0), Some(2), &json!(true), &json!("no errors"))
    );
    let start = json!([
        ["program", "part.ngc"],
        ["piece", "1 of 2"],
        ["order", "4711/2"],
        ["material", "steel"],
        ["note", "burr inside"],
        ["machine file", "the built-in machine"]
    ]);
    assert_eq!((&job["start"], &job["order_number"]), (&start, &json!("4711/2")));
    let words = format!("start job {id}");
    // Nobody but the page in control, which has seen the present state, with the whole name.
    let mut watcher = server.page(&server.watch_token);
    watcher.wait_until("a state", |page| page.last("state") != &Value::Null);
    refused(&watcher.order_as(&json!(1), &json!(0), &words), "E2403");
    let mut page = server.page(&server.token);
    page.wait_until("a state", |page| page.last("state") != &Value::Null);
    let (turn, seen) = (page.last("control")["turn"].clone(), page.last("state")["n"].clone());
    refused(&page.order_as(&turn, &seen, &words), "E2404");
    page.take_control();
    let turn = page.last("control")["turn"].clone();
    refused(&page.order_as(&turn, &json!(9999), &words), "E2406");
    assert_eq!(page.order(&format!("start job {}", &id[..30]))["t"], "done");
    not_started(&mut page, "E5004");
    assert_eq!(page.order("start job 00000000-0000-7000-8000-000000000000")["t"], "done");
    not_started(&mut page, "E5012");
    for path in ["/api/v1/shop/jobs", "/api/v1/shop/start"] {
        let cookie = server.sign_in(&server.token).expect("the token is right");
        let answer = server.request("POST", path, &[("Cookie", &cookie)], words.as_bytes());
        assert!([404, 405, 415].contains(&answer.status), "no plain request starts anything: {}", answer.status);
    }
    assert_eq!(state(&bench, &id), json!(["ready", 0, 0]));
    for (good, expected) in [(1, "ready"), (2, "done")] {
        assert_eq!(page.order_when_free(&words)["t"], "done");
        page.wait_until("the end", |page| page.last("state")["situation"] == "program_end");
        assert_eq!(page.order("set up")["t"], "done");
        page.wait_until("set up", |page| page.last("state")["stage"] == "setup");
        let job = listed(&server, &id, expected);
        assert_eq!(job["good"], good, "{job}");
        page.listen(Duration::from_millis(300));
    }
    assert_eq!(page.order_when_free(&words)["t"], "done");
    not_started(&mut page, "E5013");
    assert_eq!(state(&bench, &id), json!(["done", 2, 2]));
    assert_contains(&done(&bench, &["shop", "audit"]), &["1 jobs, 0 faults"]);
}

#[test]
fn a_page_starts_no_piece_that_the_terminal_would_refuse() {
    let bench = Bench::new();
    bench.file("mill.toml", "name = \"mill\"\n");
    let only = submit(&bench, "only.ngc", PART, &["--made-for", "mill.toml", "--only-made-for"]);
    let long = submit(&bench, "long.ngc", LONG_PART, &[]);
    let part = submit(&bench, "part.ngc", PART, &[]);
    let server = serve(&bench, &[]);
    let mut page = server.page(&server.token);
    page.take_control();
    let job = listed(&server, &only, "ready");
    assert_eq!(job["is_ready"], false, "{job}");
    assert_eq!(page.order(&format!("start job {only}"))["t"], "done");
    not_started(&mut page, "E5014");
    // A dry run makes no piece.
    assert_eq!(page.order("dry run on")["t"], "done");
    page.wait_until("dry", |page| page.last("state")["dry_run"] == true);
    assert_eq!(page.order_when_free(&format!("start job {part}"))["t"], "done");
    not_started(&mut page, "E5030");
    assert_eq!(page.order("dry run off")["t"], "done");
    page.wait_until("not dry", |page| page.last("state")["dry_run"] == false);
    // While one runs no other one is started; a hold holds it; stopped, it is interrupted.
    assert_eq!(page.order_when_free(&format!("start job {long}"))["t"], "done");
    page.wait_for_word("RUNNING");
    listed(&server, &long, "running");
    refused(&page.order(&format!("start job {part}")), "E2408");
    page.send(&json!({"t": "hold"}));
    page.wait_until("held", |page| page.last("state")["hold_reason"] == "hold");
    assert_eq!(page.order("stop")["t"], "done");
    page.wait_for_word("ENDED");
    page.wait_until("no hold", |page| page.last("state")["hold_reason"] != "hold");
    listed(&server, &long, "interrupted");
    let again = page.order_when_free(&format!("start job {long}"));
    assert_eq!(again["t"], "done", "{again}");
    not_started(&mut page, "E5012");
    assert_eq!(state(&bench, &long), json!(["interrupted", 0, 1]));
    assert_eq!(state(&bench, &part), json!(["ready", 0, 0]));
    assert_eq!(state(&bench, &only), json!(["ready", 0, 0]));
    assert_contains(&done(&bench, &["shop", "audit"]), &["3 jobs, 0 faults"]);
}

#[test]
fn a_piece_whose_process_is_killed_is_interrupted_and_the_demonstration_starts_none() {
    let bench = Bench::new();
    let long = submit(&bench, "long.ngc", LONG_PART, &["--quantity", "2"]);
    let part = submit(&bench, "part.ngc", PART, &[]);
    let server = serve(&bench, &[]);
    let mut page = server.page(&server.token);
    page.take_control();
    listed(&server, &long, "ready");
    assert_eq!(page.order(&format!("start job {long}"))["t"], "done");
    page.wait_until("motion", |page| page.machine_mm(0) > 1.0);
    let killed = Command::new("kill").args(["-KILL", &server.process().to_string()]).status();
    assert!(killed.is_ok_and(|status| status.success()));
    // What another process sees, and what the next screen lists.
    let begun = Instant::now();
    while state(&bench, &long) != json!(["interrupted", 0, 1]) {
        assert!(begun.elapsed() < Duration::from_secs(20), "{}", state(&bench, &long));
    }
    let server = serve(&bench, &[]);
    assert_eq!(listed(&server, &long, "interrupted")["is_ready"], false);
    let mut page = server.page(&server.token);
    page.take_control();
    assert_eq!(page.order(&format!("start job {long}"))["t"], "done");
    not_started(&mut page, "E5012");
    let demo = serve(&bench, &["--demo"]);
    let mut page = demo.page(&demo.token);
    page.take_control();
    page.wait_for_word("READY");
    assert_eq!(demo.get("/api/v1/shop/jobs").json()["jobs"], json!([]));
    assert_eq!(page.order(&format!("start job {part}"))["t"], "done");
    not_started(&mut page, "E5030");
    assert_eq!(state(&bench, &part), json!(["ready", 0, 0]));
    assert_contains(&done(&bench, &["shop", "audit"]), &["2 jobs, 0 faults"]);
}

/// A series that the page in control has confirmed. While it runs no other program is started; where the page is gone
/// no further piece begins; a number that is not permitted is refused.
#[test]
fn a_series_of_a_page_ends_when_the_page_is_gone() {
    let bench = Bench::new();
    let more = ["--quantity", "5", "--may-repeat"];
    let id = submit(&bench, "part.ngc", PART, &more);
    let slow = "G21 G90 G94 F600\nG1 X20\nX0\nM2\n";
    let late = submit(&bench, "slow.ngc", slow, &more);
    let single = submit(&bench, "single.ngc", PART, &["--quantity", "2"]);
    let server = serve(&bench, &[]);
    let mut page = server.page(&server.token);
    page.take_control();
    assert_eq!([&id, &single].map(|id| listed(&server, id, "ready")["most_pieces"].as_u64()), [Some(5), Some(1)]);
    for words in [format!("start job {id} 6"), format!("start job {single} 2")] {
        assert_eq!(page.order_when_free(&words)["t"], "done");
        not_started(&mut page, "E5043");
    }
    refused(&page.order(&format!("start job {id} 0")), "E2121");
    assert_eq!(page.order_when_free(&format!("start job {id} 3"))["t"], "done");
    page.wait_until("the end", |page| page.last("state")["situation"] == "program_end");
    assert_eq!(state(&bench, &id), json!(["running", 2, 3]));
    assert_eq!(page.order("set up")["t"], "done");
    page.wait_until("set up", |page| page.last("state")["stage"] == "setup");
    assert_eq!(listed(&server, &id, "ready")["good"], 3);
    page.listen(Duration::from_millis(300));
    // the page is gone in the first piece: it goes on, and no other one begins
    assert_eq!(page.order_when_free(&format!("start job {late} 3"))["t"], "done");
    listed(&server, &late, "running");
    drop(page);
    let job = listed(&server, &late, "ready");
    assert_eq!((&job["good"], state(&bench, &late)), (&json!(1), json!(["ready", 1, 1])));
    std::thread::sleep(Duration::from_secs(2));
    assert_eq!(state(&bench, &late), json!(["ready", 1, 1]));
    assert_contains(&done(&bench, &["shop", "audit"]), &["3 jobs, 0 faults"]);
}
