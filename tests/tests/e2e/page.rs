//! The server of the page in a browser, over its wire: who may do what, and what the machine does then.
//!
//! Where the machine is, is read from what the server reports, and its end from the counts that are reported there.

use std::time::{Duration, Instant};

use retrace_tests::command::Bench;
use retrace_tests::page_client::{Page, PageServer};
use serde_json::{Value, json};

/// A long straight line at 50 mm/s, and back beside it: time enough for a page to see it, also where a computer stalls.
const LINES: &str = "G21 G90 G17 G94 G61\nF3000\nG1 X250\nG1 Y5\nG1 X0\nG1 Y0\nM2\n";

fn done(answer: &Value) {
    assert_eq!(answer["t"], "done", "{answer}");
}

fn refused(answer: &Value, number: &str) {
    assert_eq!((answer["t"].as_str(), answer["number"].as_str()), (Some("refused"), Some(number)), "{answer}");
    assert!(answer["cause"].is_string() && answer["remedy"].is_string(), "{answer}");
}

/// Start, hold, back, forward, and on to the end: the machine ends where the program ends.
#[test]
fn a_program_is_run_held_retraced_and_continued_from_a_page() {
    let bench = Bench::new();
    let (_server, mut page) = PageServer::in_control(&bench, LINES, &[]);
    done(&page.order("cycle start"));
    page.wait_until("30 mm", |page| page.machine_mm(0) > 30.0);
    page.send(&json!({"t": "hold"}));
    page.wait_until("rest", |page| page.last("state")["word"] == "FEED HOLD" && page.last("live")["at_rest"] == true);
    let held_mm = page.machine_mm(0);
    done(&page.order("reverse 100%"));
    page.wait_until("20 mm back", |page| page.live("back_mm") > 20.0);
    assert!(page.machine_mm(0) < held_mm - 15.0, "it went back from {held_mm} to {}", page.machine_mm(0));
    done(&page.order("forward 50%"));
    page.wait_until("forward", |page| page.live("back_mm") < 10.0);
    page.wait_until("the furthest place", |page| page.live("back_mm") == 0.0);
    done(&page.order("leave"));
    page.wait_for_word("ENDED");
    page.wait_until("the end", |page| [page.machine_mm(0), page.machine_mm(1)] == [0.0, 0.0]);
    page.listen(Duration::from_millis(100));
    assert_eq!(page.live("record"), page.live("reached"));
    done(&page.order("set up"));
    page.wait_for_word("READY");
}

/// The handwheel moves the machine along its path by the counts that were sent, and it stands when none come.
#[test]
fn the_handwheel_of_a_page_moves_along_the_path_and_stands_when_let_go() {
    let bench = Bench::new();
    let (_server, mut page) = PageServer::in_control(&bench, LINES, &[]);
    let seconds_per_count = page.last("hello")["machine"]["wheel"]["seconds_per_count"].as_f64().expect("a figure");
    done(&page.order("cycle start"));
    page.wait_until("40 mm", |page| page.machine_mm(0) > 40.0);
    done(&page.order("wheel"));
    page.wait_until("rest", |page| page.last("state")["mode"] == "wheel" && page.last("live")["at_rest"] == true);
    let (before, turn) = (page.live("record"), page.last("control")["turn"].clone());
    for _ in 0..20 {
        page.send(&json!({"t": "wheel", "turn": turn, "counts": -1}));
        page.listen(Duration::from_millis(30));
    }
    page.wait_until("motion back", |page| page.live("record") < before);
    page.listen(Duration::from_millis(1000));
    assert_eq!(page.last("live")["at_rest"], true, "no counts, no motion");
    let period_s = page.last("hello")["machine"]["period_s"].as_f64().expect("a figure");
    let (moved, wanted) = (before - page.live("record"), 20.0 * seconds_per_count / period_s);
    assert!((moved - wanted).abs() < 0.1 * wanted, "{moved} records of {wanted}");
    refused_wheel(&mut page);
    done(&page.order("leave"));
    page.wait_for_word("ENDED");
    page.wait_until("the end", |page| [page.machine_mm(0), page.machine_mm(1)] == [0.0, 0.0]);
}

/// Counts of an old turn are refused.
fn refused_wheel(page: &mut Page) {
    page.send(&json!({"t": "wheel", "turn": 0, "counts": -1}));
    refused(&page.answer(0), "E2405");
}

/// One page is in control, the others watch and may hold.
#[test]
fn only_the_page_in_control_gives_orders_and_everybody_may_hold() {
    let bench = Bench::new();
    let (server, mut first) = PageServer::in_control(&bench, LINES, &[]);
    let mut second = server.page(&server.token);
    let mut watcher = server.page(&server.watch_token);
    for page in [&mut second, &mut watcher] {
        page.wait_until("everything", |page| !page.last("state").is_null() && !page.last("control").is_null());
    }
    assert_eq!(watcher.last("hello")["rights"], "watch");
    refused(&second.order("cycle start"), "E2404");
    refused(&watcher.order("cycle start"), "E2403");
    let (turn, seen) = (first.last("control")["turn"].clone(), first.last("state")["n"].clone());
    refused(&first.order_as(&json!(0), &seen, "cycle start"), "E2405");
    refused(&first.order_as(&turn, &json!(0), "cycle start"), "E2406");
    done(&first.order("cycle start"));
    first.wait_until("20 mm", |page| page.machine_mm(0) > 20.0);
    // What it has seen before is not the present state.
    let answer = first.order_as(&turn, &seen, "reverse 100%");
    refused(&answer, "E2406");
    assert!(answer["cause"].as_str().expect("a text").contains("situation"), "{answer}");
    watcher.send(&json!({"t": "hold"}));
    first.wait_until("rest", |page| page.last("state")["word"] == "FEED HOLD" && page.last("live")["at_rest"] == true);
    // It is asked for, and given.
    second.send(&json!({"t": "control", "do": "take"}));
    first.wait_until("the question", |page| !page.last("control")["asks"].is_null());
    first.send(&json!({"t": "control", "do": "give"}));
    second.wait_until("control", |page| page.last("control")["is_you"] == true);
    refused(&first.order("resume"), "E2404");
    second.wait_until("the state", |page| page.last("state")["word"] == "FEED HOLD");
    done(&second.order("stop"));
    second.wait_for_word("ENDED");
}

/// A page that is gone while it holds control: reverse run is held, and who comes back watches and has sent nothing.
#[test]
fn a_page_that_loses_its_link_in_reverse_run_holds_the_machine_and_comes_back_as_a_watcher() {
    let bench = Bench::new();
    let (server, mut page) = PageServer::in_control(&bench, LINES, &[]);
    done(&page.order("cycle start"));
    page.wait_until("50 mm", |page| page.machine_mm(0) > 50.0);
    done(&page.order("reverse 10%"));
    page.wait_until("motion back", |page| page.live("rate") < 0.0);
    drop(page);
    let mut again = server.page(&server.token);
    again.wait_until("rest", |page| page.last("live")["at_rest"] == true && page.live("rate") == 0.0);
    let stood = again.live("record");
    again.listen(Duration::from_millis(500));
    assert_eq!(again.live("record"), stood);
    assert_eq!(again.last("control")["is_you"], false);
    again.take_control();
    done(&again.order("stop"));
    again.wait_for_word("ENDED");
}

/// A running program runs on without its page, or is held where the machine file says so.
#[test]
fn a_program_runs_on_without_its_page_unless_the_machine_file_says_otherwise() {
    for holds in [false, true] {
        let bench = Bench::new();
        let machine = bench.file("m.toml", if holds { "on_lost_control = \"hold\"\n" } else { "name = \"m\"\n" });
        let machine = machine.display().to_string();
        let (server, mut page) = PageServer::in_control(&bench, LINES, &["--machine", &machine]);
        done(&page.order("cycle start"));
        page.wait_until("10 mm", |page| page.machine_mm(0) > 10.0);
        drop(page);
        let mut again = server.page(&server.token);
        again.wait_for_word(if holds { "FEED HOLD" } else { "ENDED" });
    }
}

/// A jog goes on only with its beats: it ends when they end, when its link is gone, and on release.
#[test]
fn a_jog_is_held_to_run() {
    let bench = Bench::new();
    let (server, mut page) = PageServer::in_control(&bench, LINES, &[]);
    for (number, end) in (1..).zip(["no beats", "release", "hold", "link"]) {
        let (from, beat, another) = hold_jog(&mut page, 10 * number, number % 2 == 1);
        refused(&another, "E2409");
        let held_to = page.machine_mm(0);
        assert!((held_to - from).abs() > 2.0, "{end}");
        match end {
            "release" => page.send(&json!({"t": "jog_end"})),
            "hold" => page.send(&json!({"t": "hold"})),
            "link" => {
                drop(page);
                page = server.page(&server.token);
                page.wait_until("live figures", |page| !page.last("live").is_null());
            }
            _ => {}
        }
        // Where the jog was ended, beats do not keep it alive.
        let begun = Instant::now();
        while end != "no beats" && begun.elapsed() < Duration::from_millis(900) {
            page.send(&json!({"t": "beat", "beat": beat}));
            page.listen(Duration::from_millis(50));
        }
        page.wait_until("rest", |page| page.last("live")["at_rest"] == true);
        let at = page.machine_mm(0);
        page.listen(Duration::from_millis(300));
        assert_eq!((page.machine_mm(0), &page.last("live")["at_rest"]), (at, &json!(true)), "{end}");
        assert!(
            (at - held_to).abs() < 30.0,
            "{end}: it stops soon, and does not go on to the soft limit: {held_to} to {at}"
        );
    }
}

/// Jogs the X axis and holds the button for 600 ms, and until the page shows that it moves. Returns where the axis was
/// before, the number of the beats, and the answer to another jog meanwhile. `number` and the four numbers behind it
/// are used for the messages.
///
/// If the computer gives neither this test nor the server a processor in time, the server ends the jog for lack of
/// beats, as it should, and the jog is repeated. If that happens each time, the jog itself is at fault.
fn hold_jog(page: &mut Page, number: u32, up: bool) -> (f64, u32, Value) {
    let late_beat = |page: &Page| {
        let messages = page.last("log")["messages"].as_array().cloned().unwrap_or_default();
        messages.into_iter().rfind(|message| message["text"].to_string().contains("the page sent no beat"))
    };
    for beat in number..number + 5 {
        page.wait_until("rest", |page| page.last("state")["word"] == "READY" && page.last("live")["at_rest"] == true);
        if page.last("control")["is_you"] != true {
            page.take_control();
        }
        let (turn, seen) = (page.last("control")["turn"].clone(), page.last("state")["n"].clone());
        let (from, late) = (page.machine_mm(0), late_beat(page));
        let jog = |id: u32, axis: &str, beat: u32| {
            let order = json!({"t": "jog", "id": id, "turn": turn, "seen": seen, "axis": axis, "up": up, "beat": beat});
            order.to_string()
        };
        page.send_text(&jog(1000 + beat, "x", beat));
        let answer = page.answer(1000 + beat);
        if answer["number"] == "E2421" {
            // The jog before has stopped, and its order is not over yet.
            page.listen(Duration::from_millis(100));
            continue;
        }
        done(&answer);
        page.send_text(&jog(2000 + beat, "y", 99));
        let another = page.answer(2000 + beat);
        let begun = Instant::now();
        let is_late = |page: &Page| late_beat(page).is_some_and(|message| late.as_ref() != Some(&message));
        let moved = |page: &Page| (page.machine_mm(0) - from).abs();
        // What the page has shown within 600 ms is not all that has happened by then: the server may be late with it.
        while begun.elapsed() < Duration::from_millis(600) || moved(page) <= 2.0 && !is_late(page) {
            let log = || page.last("log");
            assert!(begun.elapsed() < Duration::from_secs(30), "it does not jog while it is held: {:#?}", log());
            page.send(&json!({"t": "beat", "beat": beat}));
            page.listen(Duration::from_millis(50));
        }
        if is_late(page) {
            continue;
        }
        return (from, beat, another);
    }
    panic!("the jog ends although its beats come: {:#?}", page.last("log"));
}

/// A hold that comes before the machine has begun what it holds: nothing begins.
#[test]
fn a_hold_that_comes_at_once_cancels_a_start_and_a_jog() {
    let bench = Bench::new();
    let long = format!("G21 G90 G17 G94 G61\nF3000\n{}M2\n", "G1 X60\nG1 X0\n".repeat(30_000));
    let (_server, mut page) = PageServer::in_control(&bench, &long, &[]);
    page.wait_until("live figures", |page| !page.last("live").is_null());
    let (turn, seen) = (page.last("control")["turn"].clone(), page.last("state")["n"].clone());
    page.send(&json!({"t": "jog", "id": 900, "turn": turn, "seen": seen, "axis": "x", "up": true, "beat": 1}));
    page.send(&json!({"t": "jog_end"}));
    page.listen(Duration::from_millis(1500));
    let at = page.machine_mm(0);
    assert!(at < 10.0, "the jog was released at once, and went to {at}");
    page.wait_for_word("READY");
    done(&page.order("cycle start"));
    page.send(&json!({"t": "hold"}));
    page.listen(Duration::from_millis(6000));
    assert_eq!(page.machine_mm(0), at, "{:#?}", page.last("state")["word"]);
}

/// Setting up from a page: axes, work zero, MDI, outputs, a program of the folder, and what does not apply.
#[test]
fn the_machine_is_set_up_from_a_page() {
    let bench = Bench::new();
    let programs = bench.path("programs");
    std::fs::create_dir(&programs).expect("a folder");
    std::fs::write(programs.join("other.ngc"), "G21 G90 G94\nF600\nG1 X3\nM2\n").expect("a file");
    let (server, mut page) = PageServer::in_control(&bench, LINES, &["--programs", &programs.display().to_string()]);
    done(&page.order("jog x 1.5"));
    page.wait_until("1.5 mm", |page| page.machine_mm(0) == 1.5 && page.last("live")["at_rest"] == true);
    done(&page.order_when_free("zero x"));
    page.wait_until("the work zero", |page| page.last("live")["work"][0] == 0.0);
    done(&page.order_when_free("mdi G0 X2"));
    refused(&page.order("jog y 1"), "E2421");
    page.wait_until("the block", |page| page.machine_mm(0) == 3.5 && page.last("live")["at_rest"] == true);
    page.wait_until("the end of the block", |page| page.last("state")["word"] == "READY");
    done(&page.order_when_free("output 3 on"));
    page.wait_until("the output", |page| page.last("state")["outputs"].to_string().contains(r#""channel":3"#));
    refused(&page.order("reverse 100%"), "E2408");
    refused(&page.order("yes"), "E2408");
    refused(&page.order("revrse 100%"), "E2121");
    refused(&page.order("open missing.ngc"), "E2407");
    page.send_text("{\"t\":\"reboot\"}");
    refused(&page.answer(0), "E2418");
    done(&page.order("open other.ngc"));
    page.wait_until("the program", |page| page.last("state")["program"]["name"] == "other.ngc");
    page.wait_for_word("READY");
    let lines = server.get("/api/v1/program/lines?from=2&count=2").json();
    assert_eq!(lines, json!({"name": "other.ngc", "lines_total": 4, "from": 2, "lines": ["F600", "G1 X3"]}));
    done(&page.order("cycle start"));
    page.wait_for_word("ENDED");
    page.wait_until("3 mm from the work zero", |page| page.machine_mm(0) == 4.5);
    let jobs = server.get("/api/v1/jobs").json();
    let id = jobs["jobs"][0]["id"].as_str().expect("a job").to_owned();
    assert!(server.get(&format!("/api/v1/jobs/{id}")).body.contains("other.ngc"));
    assert_eq!(server.get("/api/v1/jobs/none").status, 404);
}

/// A job that was stopped is resumed from a page: the card is opened anew, the page signs in by its cookie as before,
/// and sees the whole summary before it says yes. A job that cannot be resumed is refused, and the machine is there.
#[test]
fn a_stopped_job_is_resumed_from_a_page() {
    let bench = Bench::new();
    // 2.4 s are left of the line at 30 mm: on a busy computer the order comes late
    let (server, mut page) = PageServer::in_control(&bench, LINES, &[]);
    let cookie = server.sign_in(&server.token).expect("the token is right");
    done(&page.order("cycle start"));
    page.wait_until("30 mm", |page| page.machine_mm(0) > 30.0);
    done(&page.order("stop"));
    page.wait_for_word("ENDED");
    let jobs = server.get("/api/v1/jobs").json();
    let (id, can) = (jobs["jobs"][0]["id"].clone(), jobs["jobs"][0]["resumable"].clone());
    assert_eq!(can, true, "{jobs}");
    let again = |name: &str, old: &mut Page| {
        done(&old.order(&format!("resume job {name}")));
        let begun = Instant::now();
        while old.receive().is_ok() {
            assert!(begun.elapsed() < Duration::from_secs(20), "the link ends with the card");
        }
        let begun = Instant::now();
        loop {
            if let Some(page) = server.try_page(&[("Cookie", &cookie)]) {
                break page;
            }
            assert!(begun.elapsed() < Duration::from_secs(20), "the server comes back");
        }
    };
    let mut page = again("20000101-000000-none", &mut page);
    page.wait_for_log("job 20000101-000000-none is not resumed");
    page.take_control();
    page.wait_for_word("READY");
    let mut page = again(id.as_str().expect("a name"), &mut page);
    page.take_control();
    page.wait_until("the question", |page| !page.last("state")["question"].is_null());
    assert!(page.last("state")["question"].to_string().contains("G1 X250"), "{:#?}", page.last("state")["question"]);
    page.listen(Duration::from_millis(300));
    assert_eq!(page.last("live")["at_rest"], true, "nothing moves before the answer");
    done(&page.order("yes"));
    page.wait_for_word("ENDED");
    page.wait_until("the end", |page| [page.machine_mm(0), page.machine_mm(1)] == [0.0, 0.0]);
}

/// A stop in a dwell ends the job at once, with the jet off; the machine is jogged, and the next job begins.
#[test]
fn a_job_is_stopped_in_a_dwell_and_the_next_one_begins() {
    let bench = Bench::new();
    let machine = bench.file("jet.toml", "[[cutter]]\nname = \"jet\"\nkind = \"jet\"\nfire = 3\n");
    let program = "G21 G90 F6000\nG1 X10\nM64 P3\nG4 P20\nG1 X20\nM65 P3\nM2\n";
    let (_server, mut page) = PageServer::in_control(&bench, program, &["--machine", &machine.display().to_string()]);
    for _ in 0..2 {
        done(&page.order("cycle start"));
        page.wait_until("the jet", |page| {
            page.last("live").to_string().contains("cutting") || page.machine_mm(0) == 10.0
        });
        page.listen(Duration::from_millis(500));
        let begun = Instant::now();
        done(&page.order("stop"));
        page.wait_for_word("ENDED");
        assert!(begun.elapsed() < Duration::from_secs(5), "it waits for the dwell");
        done(&page.order("set up"));
        page.wait_for_word("READY");
        done(&page.order("mdi G1 X5 F6000"));
        page.wait_until("5 mm back", |page| page.machine_mm(0) == 5.0);
    }
}

/// The path arrives in chunks, and lines and records are found from each other.
#[test]
fn the_planned_path_arrives_with_its_records_and_lines() {
    let bench = Bench::new();
    let (server, mut page) = PageServer::in_control(&bench, LINES, &[]);
    page.wait_until("the path", |page| !page.last("path").is_null());
    let path = page.last("path").clone();
    assert_eq!(path["bounds_mm"], json!([[0.0, 0.0, 0.0], [250.0, 5.0, 0.0]]));
    let last = path["levels"].as_array().and_then(|levels| levels.last()).expect("a level").clone();
    assert_eq!(last["vertices"], 5, "four straight lines");
    page.send(&json!({"t": "want", "path": path["path"], "level": last["level"], "firsts": [0]}));
    page.wait_until("a chunk", |page| page.chunks.0 == 1);
    page.send(&json!({"t": "where", "id": 1, "path": path["path"], "line": 4}));
    page.wait_until("the records", |page| page.last("where")["id"] == 1);
    let records = page.last("where")["records"].clone();
    let (from, to) = (records[0].as_u64().expect("a record"), records[1].as_u64().expect("a record"));
    assert!(from > 0 && to > from, "{records}");
    page.send(&json!({"t": "where", "id": 2, "path": path["path"], "record": (from + to) / 2}));
    page.wait_until("the line", |page| page.last("where")["id"] == 2);
    assert_eq!(page.last("where")["line"], 4);
    let profile = server.get("/api/v1/profile").json();
    let figures = |name: &str| -> Vec<f64> {
        profile[name].as_array().expect("a list").iter().map(|figure| figure.as_f64().expect("a figure")).collect()
    };
    let speeds = figures("velocity_mm_s");
    let fastest = speeds.iter().copied().fold(0.0, f64::max);
    assert!((49.0..=50.5).contains(&fastest), "F3000 is 50 mm/s: {fastest}");
    let length_mm: f64 = speeds.iter().sum::<f64>() * 0.016;
    assert!((length_mm - 510.0).abs() < 0.5, "{length_mm}");
    assert!(figures("acceleration_mm_s2").iter().all(|value| value.abs() <= 1_050.0));
    // The records of the plan are those of the run.
    done(&page.order("cycle start"));
    page.wait_for_word("ENDED");
    page.listen(Duration::from_millis(200));
    assert_eq!(page.live("reached"), path["records"].as_f64().expect("a number"));
}

/// Programs arrive from pages and from CAM programs; none of them starts the machine.
#[test]
fn uploads_store_programs_and_never_start_the_machine() {
    let bench = Bench::new();
    let programs = bench.path("programs");
    std::fs::create_dir(&programs).expect("a folder");
    let server = PageServer::start(&["--upload-key", "--programs", &programs.display().to_string()]);
    let mut page = server.page(&server.token);
    page.take_control();
    let key = server.upload_key.clone().expect("a key");
    let with_key = [("X-Api-Key", key.as_str())];
    let put =
        |path: &str, headers: &[(&str, &str)]| server.request("PUT", path, headers, b"G21 G94 G90\nF600\nG1 X9\nM2\n");
    assert_eq!(put("/api/v1/programs/a%20part.ngc", &with_key).status, 201);
    let exists = put("/api/v1/programs/a%20part.ngc", &[with_key[0], ("If-None-Match", "*")]);
    assert_eq!((exists.status, exists.error_number()), (412, "E2412".into()));
    for bad in ["/api/v1/programs/..%2Fx.ngc", "/api/v1/programs/.x", "/api/v1/programs/a%00b"] {
        let answer = put(bad, &with_key);
        assert_eq!((answer.status, answer.error_number()), (400, "E2411".into()), "{bad}");
    }
    let long = server.request("PUT", "/api/v1/programs/big.ngc", &[with_key[0], ("Content-Length", "300000000")], b"");
    assert_eq!((long.status, long.error_number()), (413, "E2414".into()));
    assert_eq!(server.get("/api/v1/programs").json()["programs"][0]["name"], "a part.ngc");
    // The key does nothing else.
    assert_eq!(server.request("GET", "/api/v1/state", &with_key, b"").status, 403);
    assert!(server.page_with(&[("X-Api-Key", &key)]).is_err());
    // OctoPrint's form, as slicers send it.
    let version = server.request("GET", "/api/version", &with_key, b"").json();
    assert!(version["text"].as_str().expect("a text").starts_with("OctoPrint"), "{version}");
    let form = |parts: &[(&str, &str, &str)]| {
        let part = |(name, file, text): &(&str, &str, &str)| {
            format!("--BOUND\r\nContent-Disposition: form-data; name=\"{name}\"{file}\r\n\r\n{text}\r\n")
        };
        let body = parts.iter().map(part).collect::<String>() + "--BOUND--\r\n";
        let headers = [with_key[0], ("Content-Type", "multipart/form-data; boundary=BOUND")];
        server.request("POST", "/api/files/local", &headers, body.as_bytes())
    };
    let file = "; filename=\"sent.ngc\"";
    let program = "G21 G94 G90\nF600\nG1 X9\nM2\n";
    let sent = form(&[("print", "", "true"), ("file", file, program)]);
    assert_eq!((sent.status, &sent.json()["print"]), (201, &json!(false)), "{sent:?}");
    page.wait_until("the program", |page| page.last("state")["program"]["name"] == "sent.ngc");
    page.wait_for_word("READY");
    page.wait_for_log("sent.ngc was sent to this machine");
    page.listen(Duration::from_millis(300));
    assert_eq!((page.machine_mm(0), page.last("state")["stage"].as_str()), (0.0, Some("setup")), "nothing moves");
    assert_eq!(form(&[("file", file, program)]).json()["files"]["local"]["name"], "sent-2.ngc");
    let none = form(&[("print", "", "true")]);
    assert_eq!((none.status, none.error_number()), (400, "E2416".into()));
    // While the machine runs, a program that arrives changes nothing.
    done(&page.order("cycle start"));
    page.wait_for_word("RUNNING");
    assert_eq!(form(&[("print", "", "true"), ("file", file, program)]).json()["loaded"], false);
    assert_eq!(page.last("state")["program"]["name"], "sent.ngc");
    let cookie = server.sign_in(&server.token).expect("the token is right");
    let delete =
        |name: &str| server.request("DELETE", &format!("/api/v1/programs/{name}"), &[("Cookie", cookie.as_str())], b"");
    assert_eq!(delete("sent-2.ngc").status, 204);
    assert_eq!(delete("sent-2.ngc").error_number(), "E2407");
    std::fs::remove_dir_all(&programs).expect("a folder");
    assert_eq!(put("/api/v1/programs/late.ngc", &with_key).error_number(), "E2413");
}

/// A program that appears in the watched folder is offered once it is whole, and nothing is loaded or started.
#[test]
fn a_new_program_of_the_watched_folder_is_offered_and_never_loaded() {
    let bench = Bench::new();
    let watched = bench.path("watched");
    std::fs::create_dir(&watched).expect("a folder");
    std::fs::write(watched.join("old.ngc"), "G0 X1\nM2\n").expect("a file");
    let (_server, mut page) = PageServer::in_control(&bench, LINES, &["--watch", &watched.display().to_string()]);
    page.listen(Duration::from_millis(1500));
    assert_eq!(page.last("offer"), &Value::Null, "what was there is not new");
    std::fs::write(watched.join("new.ngc"), "G21 G90 G94\nF600\nG1 X3\nM2\n").expect("a file");
    page.wait_until("the offer", |page| page.last("offer")["name"] == "new.ngc");
    page.listen(Duration::from_millis(1500));
    assert_eq!((page.machine_mm(0), &page.last("state")["program"]["name"]), (0.0, &json!("program.ngc")));
    done(&page.order("open new.ngc"));
    page.wait_until("the program", |page| page.last("state")["program"]["name"] == "new.ngc");
}

/// What the machine does not carry out, after the order was passed on, is told to the page in control.
#[test]
fn an_order_that_is_rejected_later_is_told_to_the_page_that_gave_it() {
    let bench = Bench::new();
    let (server, mut page) = PageServer::in_control(&bench, LINES, &[]);
    let mut watcher = server.page(&server.watch_token);
    done(&page.order("mdi G1 F100 X90000"));
    page.wait_until("the rejection", |page| page.last("rejected")["cause"].to_string().contains("soft limit"));
    page.wait_for_word("READY");
    page.listen(Duration::from_millis(300));
    done(&page.order("cycle start"));
    page.wait_until("10 mm", |page| page.machine_mm(0) > 10.0);
    done(&page.order("pause"));
    page.wait_for_word("PAUSED");
    done(&page.order("park"));
    page.wait_until("the rejection", |page| page.last("rejected")["cause"].to_string().contains("park"));
    watcher.listen(Duration::from_millis(300));
    assert_eq!(watcher.last("rejected"), &Value::Null, "it is not told to others");
    assert_eq!(server.page(&server.token).last("rejected"), &Value::Null);
    done(&page.order("stop"));
    page.wait_for_word("ENDED");
}

/// One upload is received at a time.
#[test]
fn a_second_upload_waits_for_the_first() {
    use std::io::Write as _;
    let bench = Bench::new();
    let programs = bench.path("programs");
    std::fs::create_dir(&programs).expect("a folder");
    let server = PageServer::start(&["--upload-key", "--programs", &programs.display().to_string()]);
    let key = server.upload_key.clone().expect("a key");
    let mut first = std::net::TcpStream::connect(&server.host).expect("it listens");
    let head = format!(
        "PUT /api/v1/programs/slow.ngc HTTP/1.1\r\nHost: {}\r\nX-Api-Key: {key}\r\nContent-Length: 100\r\n\r\nG0 X1\n",
        server.host
    );
    first.write_all(head.as_bytes()).expect("sent");
    let begun = Instant::now();
    loop {
        let second = server.request("PUT", "/api/v1/programs/b.ngc", &[("X-Api-Key", &key)], b"M2\n");
        if second.status == 429 {
            assert_eq!(second.error_number(), "E2415");
            break;
        }
        assert!(begun.elapsed() < Duration::from_secs(20), "{second:?}");
    }
    drop(first);
    let begun = Instant::now();
    while server.request("PUT", "/api/v1/programs/b.ngc", &[("X-Api-Key", &key)], b"M2\n").status != 201 {
        assert!(begun.elapsed() < Duration::from_secs(20), "the first one is gone");
    }
    let left: Vec<_> =
        std::fs::read_dir(&programs).expect("a folder").flatten().map(|entry| entry.file_name()).collect();
    assert_eq!(left, ["b.ngc"], "nothing is left of the first one");
}

/// Sessions, and requests that are not the page's own.
#[test]
fn only_the_page_itself_with_a_session_is_answered() {
    let server = PageServer::start(&[]);
    for path in ["/api/v1/state", "/api/v1/hello", "/api/v1/programs", "/api/v1/ws", "/api/v1/jobs"] {
        let answer = server.request("GET", path, &[], b"");
        assert_eq!((answer.status, answer.error_number()), (401, "E2402".into()), "{path}");
    }
    let cookie = server.sign_in(&server.token).expect("the token is right");
    let cookie = ("Cookie", cookie.as_str());
    let foreign = [
        ("Host", "attacker.example:80"),
        ("Host", "127.0.0.1.attacker.example"),
        ("Origin", "https://attacker.example"),
        ("Origin", "null"),
        ("Sec-Fetch-Site", "cross-site"),
    ];
    for header in foreign {
        for path in ["/", "/api/v1/state", "/api/v1/ws"] {
            assert_eq!(server.request("GET", path, &[cookie, header], b"").status, 403, "{header:?} {path}");
        }
        if header.0 != "Host" {
            assert!(server.page_with(&[cookie, header]).is_err(), "{header:?}");
        }
    }
    let page = server.request("GET", "/", &[], b"");
    assert!(page.status == 200 && page.headers.contains("content-security-policy: default-src 'none'"), "{page:?}");
    assert!(!page.body.contains(&server.token));
    assert_eq!(server.request("GET", "/page/../../Cargo.toml", &[], b"").status, 404);
    // A form, which a page from elsewhere could send without being asked, is not understood.
    let form = [("Content-Type", "text/plain")];
    let body = json!({"token": server.token}).to_string();
    assert_eq!(server.request("POST", "/api/v1/session", &form, body.as_bytes()).status, 415);
    assert_eq!(server.request("GET", "/api/v1/state", &[cookie], b"").status, 200);
    assert_eq!(server.request("DELETE", "/api/v1/session", &[cookie], b"").status, 204);
    assert_eq!(server.request("GET", "/api/v1/state", &[cookie], b"").status, 401, "it has ended");
    for n in 0..6 {
        let answer = server.sign_in("0123456789abcdef0123456789abcdef").expect_err("wrong");
        assert_eq!((answer.status, answer.error_number()), (if n < 5 { 401 } else { 429 }, "E2401".into()));
    }
    assert_eq!(server.sign_in(&server.token).expect_err("it must wait").status, 429);
}

/// Connections that send a byte now and then, and more of them than there is room for: pages that are open hold the
/// machine all the same, and the connections end by themselves.
#[test]
fn slow_connections_end_by_themselves_and_disturb_no_page() {
    use std::io::{Read as _, Write as _};
    let bench = Bench::new();
    let (server, mut page) = PageServer::in_control(&bench, LINES, &[]);
    let open = |_| {
        let mut stream = std::net::TcpStream::connect(&server.host).expect("the system accepts it");
        stream.write_all(b"GET / HTTP/1.1\r\nX-Slow: ").expect("sent");
        stream
    };
    let mut slow: Vec<_> = (0..200).map(open).collect();
    done(&page.order("cycle start"));
    page.wait_until("20 mm", |page| page.machine_mm(0) > 20.0);
    page.send(&json!({"t": "hold"}));
    page.wait_until("rest", |page| page.last("state")["word"] == "FEED HOLD");
    // Those that have no room yet have theirs when the first ones have ended.
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(25) {
        slow.iter_mut().for_each(|stream| drop(stream.write_all(b"x")));
        page.listen(Duration::from_millis(500));
    }
    assert_eq!(server.request("GET", "/", &[], b"").status, 200, "there is room again");
    let has_ended = |stream: &mut std::net::TcpStream| {
        let _ = stream.set_read_timeout(Some(Duration::from_millis(1)));
        matches!(stream.read(&mut [0; 4096]), Ok(0)) || stream.write_all(b"x").is_err()
    };
    assert_eq!(slow.iter_mut().map(has_ended).filter(|&ended| ended).count(), 200);
    done(&page.order("stop"));
    page.wait_for_word("ENDED");
}

/// What prevents the command from serving, and more pages than there is room for.
#[test]
fn the_command_says_why_it_cannot_serve() {
    let server = PageServer::start(&[]);
    let run = |arguments: &[&str]| {
        let output = std::process::Command::new(retrace_tests::command::binary()).args(arguments).output();
        let output = output.expect("the command runs");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, text) = run(&["serve", "--listen", &server.host]);
    assert!(code == Some(2) && text.contains("E2419"), "{code:?} {text}");
    let (code, text) = run(&["serve", "--listen", "127.0.0.1:0", "--programs", "no-such-folder"]);
    assert!(code == Some(2) && text.contains("E2420"), "{code:?} {text}");
    let (code, text) = run(&["serve", "--json"]);
    assert!(code == Some(2) && text.contains("E2142"), "{code:?} {text}");
    let pages: Vec<_> = (0..16).map(|_| server.page(&server.token)).collect();
    let cookie = server.sign_in(&server.token).expect("the token is right");
    let seventeenth = server.page_with(&[("Cookie", &cookie)]).expect_err("there is room for 16");
    assert!(seventeenth.starts_with("503") && seventeenth.contains("E2417"), "{seventeenth}");
    drop(pages);
    // Without a folder nothing is stored.
    let put = server.request("PUT", "/api/v1/programs/a.ngc", &[("Cookie", &cookie)], b"M2\n");
    assert_eq!((put.status, put.error_number()), (409, "E2410".into()));
}
