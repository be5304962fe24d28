//! Real-time scheduling, where the system permits it, and the measurements of `retrace doctor`.

use std::fs;
use std::process::Stdio;
use std::time::{Duration, Instant};

use retrace_tests::command::Bench;
use retrace_tests::served::ServedCard;
use serde_json::Value;

fn doctor(bench: &Bench, more: &[&str]) -> Value {
    let result = bench.retrace([&["doctor", "--seconds", "0.5", "--json"], more].concat());
    assert_eq!(result.code, Some(0), "{}", result.err);
    serde_json::from_str(&result.out).unwrap_or_else(|error| panic!("{error}: {}", result.out))
}

#[test]
fn the_doctor_measures_the_computer_and_the_line() {
    let (bench, card) = (Bench::new(), ServedCard::with(&[]));
    let alone = doctor(&bench, &[]);
    let wake_ups = &alone["wake_ups"];
    assert!(wake_ups["count"].as_u64().is_some_and(|count| (1..=500).contains(&count)), "{alone}");
    let classes = wake_ups["classes"].as_array().expect("classes");
    let sum: u64 = classes.iter().filter_map(|class| class["count"].as_u64()).sum();
    assert_eq!(Some(sum), wake_ups["count"].as_u64(), "{alone}");
    assert!(alone["round_trip_us"].is_null() && alone["fits"].is_boolean(), "{alone}");
    let with_card = doctor(&bench, &[&card.port]);
    let trip = &with_card["round_trip_us"];
    assert!(trip["typical"].as_u64() > Some(0) && trip["typical"].as_u64() <= trip["worst"].as_u64(), "{with_card}");
    assert!(with_card["watchdog_ms"].as_u64() >= Some(50), "{with_card}");
    let result = bench.retrace(["doctor", "--seconds", "0.2"]);
    assert!(result.out.contains("wake-up latency") && result.out.contains("watchdog_ms ="), "{}", result.out);
    assert_eq!(bench.retrace(["doctor", "/dev/no-such-port", "--seconds", "0.1"]).code, Some(2));
}

/// Name, scheduling policy (0: as usual, 1: SCHED_FIFO) and priority of each thread of a process.
fn threads(process: u32) -> Vec<(String, u32, u32)> {
    let Ok(tasks) = fs::read_dir(format!("/proc/{process}/task")) else { return Vec::new() };
    let of = |task: fs::DirEntry| -> Option<(String, u32, u32)> {
        let stat = fs::read_to_string(task.path().join("stat")).ok()?;
        let (name, rest) = stat.split_once('(')?.1.rsplit_once(')')?;
        let fields: Vec<&str> = rest.split_whitespace().collect();
        // fields 40 and 41 of the line, of which the third is the first behind the name
        Some((name.to_owned(), fields.get(38)?.parse().ok()?, fields.get(37)?.parse().ok()?))
    };
    tasks.filter_map(|task| of(task.ok()?)).collect()
}

/// Threads that are scheduled as usual while a job runs.
const NAMED: [&str; 3] = ["reporting", "manual moves", "journal"];

#[test]
fn the_motion_thread_alone_is_scheduled_in_real_time() {
    let (bench, card) = (Bench::new(), ServedCard::with(&[]));
    let is_permitted = doctor(&bench, &[])["real_time"] == true;
    bench.file("long.ngc", "G21 G90 F600\nG1 X30\nM2\n");
    let mut child = bench.start(&["run", "long.ngc", "--card", &card.port, "--json"], Stdio::null(), "out.txt");
    // A thread inherits the scheduling and the name of the one that starts it, until it has set its own.
    let fifo_count = |seen: &[(String, u32, u32)]| seen.iter().filter(|(_, policy, _)| *policy == 1).count();
    let settled = |seen: &[(String, u32, u32)]| {
        fifo_count(seen) == usize::from(is_permitted)
            && NAMED.iter().all(|name| seen.iter().any(|(thread, ..)| thread == name))
    };
    let begun = Instant::now();
    let seen = loop {
        let seen = threads(child.id());
        let is_moving = fs::read_to_string(bench.path("out.txt")).is_ok_and(|text| text.contains("started"));
        if is_moving && settled(&seen) || begun.elapsed() > Duration::from_secs(20) {
            break seen;
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    let status = fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
    child.kill().expect("it is killed");
    child.wait().expect("it ends");
    let fifo: Vec<_> = seen.iter().filter(|(_, policy, _)| *policy == 1).collect();
    if is_permitted {
        assert!(matches!(fifo[..], [(name, _, 40)] if name.starts_with("retrace")), "{seen:?}");
        let locked = status.lines().find_map(|line| line.strip_prefix("VmLck:")).unwrap_or("0 kB").trim().to_owned();
        assert_ne!(locked, "0 kB", "{status}");
    } else {
        assert!(fifo.is_empty(), "{seen:?}");
    }
    for name in NAMED {
        assert!(seen.iter().any(|(thread, ..)| thread == name), "{name}: {seen:?}");
    }
}
