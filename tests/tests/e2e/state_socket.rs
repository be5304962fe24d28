//! The local socket on which a command reports the state of its machine (SHP-2).

use std::io::{BufRead, BufReader, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::process::Stdio;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, binary};
use retrace_tests::page_client::PageServer;
use retrace_tests::served::ServedCard;
use serde_json::{Value, json};

/// About 6 s of motion.
const PROGRAM: &str = "G21 G90 F1200\nG0 X10\nG1 X60\nG1 Y50\nG1 X10 Y0\nM2\n";
const PATIENT: &str = "name = \"table 1\"\n[card]\nwatchdog_ms = 2000\n";

fn sockets(bench: &Bench) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(bench.path("state/retrace/running")).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).collect()
}

/// Connects to the command that runs.
fn reader(bench: &Bench) -> UnixStream {
    let begun = Instant::now();
    loop {
        if let Some(stream) = sockets(bench).first().and_then(|path| UnixStream::connect(path).ok()) {
            stream.set_read_timeout(Some(Duration::from_secs(30))).expect("a time");
            return stream;
        }
        assert!(begun.elapsed() < Duration::from_secs(20), "no socket");
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn messages(stream: &UnixStream) -> impl Iterator<Item = Value> {
    let lines = BufReader::new(stream.try_clone().expect("a second handle")).lines();
    lines.map_while(Result::ok).map(|line| serde_json::from_str(&line).expect("a JSON object"))
}

/// A reader has the machine, then its state and figures until the end; what readers write is not read, and one that
/// reads nothing is not waited for and told how much it has missed.
#[test]
fn a_run_reports_its_state_and_takes_no_orders() {
    let bench = Bench::new();
    bench.file("part.ngc", PROGRAM);
    bench.file("m.toml", PATIENT);
    let card = ServedCard::with(&[]);
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--json"];
    let mut host = bench.start(&run, Stdio::null(), "told.txt");
    let (stream, mut writer, sleeper) = (reader(&bench), reader(&bench), reader(&bench));
    writer.set_nonblocking(true).expect("a socket");
    for _ in 0..2_000 {
        // Where the command has ended, or takes no more, that is as well.
        let _ =
            writer.write_all(b"stop\nhold\n{\"t\":\"hold\"}\n{\"t\":\"do\",\"id\":1,\"words\":\"reverse\"}\n\0\xff");
    }
    let _ = writer.shutdown(Shutdown::Write);
    let told: Vec<Value> = messages(&stream).collect();
    let code = host.wait().expect("it ends").code();
    let report = std::fs::read_to_string(bench.path("told.txt")).expect("its output");
    assert_eq!(code, Some(0), "{report}");
    let ordered: Vec<&str> = report.lines().filter(|line| line.contains("\"event\":\"operator\"")).collect();
    assert!(ordered.iter().all(|line| line.contains("\"optional stop on\"")), "nothing was ordered: {ordered:?}");
    assert_eq!(
        (&told[0]["t"], &told[0]["name"], &told[0]["axes"][1]["letter"]),
        (&json!("machine"), &json!("table 1"), &json!("y"))
    );
    let of = |kind: &str| told.iter().filter(|message| message["t"] == kind).cloned().collect::<Vec<_>>();
    assert!(of("state").iter().any(|state| state["word"] == "RUNNING" && state["program"]["name"] == "part.ngc"));
    assert_eq!(of("state").last().map(|state| &state["word"]), Some(&json!("ENDED")), "the last state is the end");
    let figures = of("live");
    assert!(figures.len() > 20, "{}", figures.len());
    assert!(figures.iter().any(|live| live["mm"][0].as_f64() > Some(55.0)));
    assert_eq!(figures.last().map(|live| &live["mm"]), Some(&json!([10.0, 0.0, 0.0])));
    assert!(of("block").iter().any(|block| block["line"] == 4));
    assert!(of("lost").is_empty());
    // It has not read: the first messages are those that the system has kept for it.
    let late: Vec<Value> = messages(&sleeper).collect();
    assert_eq!(late[0]["t"], "machine");
    assert!(sockets(&bench).is_empty(), "it is gone with the command");
    let _ = card.end();
}

/// A command that was killed leaves its socket; the next one removes it.
#[test]
fn an_abandoned_socket_is_removed() {
    let bench = Bench::new();
    bench.file("part.ngc", PROGRAM);
    bench.file("m.toml", PATIENT);
    let card = ServedCard::with(&[]);
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--json"];
    let mut host = bench.start(&run, Stdio::null(), "killed.txt");
    let first = reader(&bench);
    let abandoned = sockets(&bench);
    host.kill().expect("it is killed");
    host.wait().expect("it ends");
    assert_eq!(sockets(&bench), abandoned, "nobody was left to remove it");
    drop(first);
    let mut host = bench.start(&["resume", "--yes", "--json"], Stdio::null(), "resumed.txt");
    let begun = Instant::now();
    while sockets(&bench).is_empty() || sockets(&bench) == abandoned {
        assert!(begun.elapsed() < Duration::from_secs(20), "it stays");
        std::thread::sleep(Duration::from_millis(10));
    }
    assert!(!sockets(&bench).contains(&abandoned[0]));
    host.kill().expect("it is killed");
    host.wait().expect("it ends");
    let _ = card.end();
}

/// The page's command reports the same, with the text of the line, and before a program runs.
#[test]
fn a_served_machine_reports_its_state() {
    let bench = Bench::new();
    let program = bench.file("part.ngc", PROGRAM).display().to_string();
    let mut command = std::process::Command::new(binary());
    command.env("XDG_STATE_HOME", bench.path("state"));
    let server = PageServer::start_as(command, &[&program]);
    let mut page = server.page(&server.token);
    page.take_control();
    page.wait_for_word("READY");
    let stream = reader(&bench);
    let mut told = messages(&stream);
    let ready = told.find(|message| message["t"] == "state").expect("a state");
    assert_eq!((&ready["word"], &ready["stage"]), (&json!("READY"), &json!("setup")));
    page.order("cycle start");
    let block = told.find(|message| message["t"] == "block" && message["line"] == 3).expect("its third line");
    assert_eq!(block["text"], "G1 X60");
    page.order("stop");
    told.find(|message| message["word"] == "ENDED").expect("its end");
}
