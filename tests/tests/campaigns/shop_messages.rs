//! Everything that an agent reads from the broker, filled with random, recorded and changed messages: nothing starts,
//! nothing but the jobs that a submitter has signed reaches the inbox, and the agent's memory is bounded (SHP-12).

use std::fs;
use std::thread::sleep;
use std::time::{Duration, Instant};

use retrace_tests::case_runner::first_seed;
use retrace_tests::command::{Bench, cases};
use retrace_tests::sender::TestRandom;
use retrace_tests::shop_broker::ShopBroker;
use serde_json::{Value, json};

/// Most memory of an agent, in kB (SHP-2).
const MAX_KB: u64 = 64 << 10;

/// Resident memory of a process, in kB.
fn resident_kb(process: u32) -> u64 {
    let status = fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}

/// Words that somebody could hope to be orders.
const ORDERS: [&str; 12] = [
    "start",
    "cycle_start",
    "resume",
    "stop",
    "reset",
    "override",
    "clear_alarm",
    "job",
    "recall",
    "say",
    "jog",
    "mdi",
];

/// A message that no submitter has signed: bytes, JSON with the keys of orders, or a recorded one with a change.
fn message(chance: &mut TestRandom, recorded: &[Vec<u8>], id: &str) -> Vec<u8> {
    let word = ORDERS[chance.below(ORDERS.len())];
    match chance.below(8) {
        0 => (0..chance.below(400)).map(|_| chance.below(256) as u8).collect(),
        1 => word.into(),
        2 => json!({ word: id, "kind": word, "machine": "mill", "id": id }).to_string().into_bytes(),
        3 => {
            let inner = json!({"kind": word, "target": {"machine": "mill"}, "id": id, "job": id, "text": word});
            json!({"message": inner.to_string(), "key": "U", "signature": "00"}).to_string().into_bytes()
        }
        4 => "[".repeat(1 + chance.below(5000)).into_bytes(),
        5 if chance.below(200) == 0 => vec![b'{'; 900_000],
        _ => {
            let mut text = recorded[chance.below(recorded.len())].clone();
            for _ in 0..=chance.below(3) {
                let at = chance.below(text.len().max(1));
                match chance.below(3) {
                    // never to the other case of a letter, which a hexadecimal digit does not distinguish
                    0 if !text.is_empty() => text[at] = text[at].wrapping_add(1),
                    1 if !text.is_empty() => drop(text.remove(at)),
                    _ => text.truncate(at),
                }
            }
            text
        }
    }
}

#[test]
fn whatever_an_agent_reads_nothing_starts() {
    let (messages, seed, begun) = (cases(1500), first_seed(), Instant::now());
    let bench = Bench::new();
    let part = bench.file("part.ngc", "G21 G90 F3000\nG1 X10\nM2\n");
    let test = "shop_messages::whatever_an_agent_reads_nothing_starts";
    let Some(mut broker) = ShopBroker::start_open(test, &bench, &["mill"]) else { return };
    let submit = |broker: &ShopBroker| {
        let submitted = ["submit", part.to_str().expect("a name"), "--machine", "mill"];
        broker.done("office", &submitted).trim().to_owned()
    };
    let mut signed = vec![submit(&broker)];
    let recorded = [broker.stored_last("JOBS", "shop.job.machine.mill")];
    let mut chance = TestRandom::new(seed);
    let mut raw = broker.raw();
    broker.start_agent("mill");
    for number in 0..messages {
        let subject = match chance.below(10) {
            0 => "$KV.machines.mill.state".to_owned(),
            1 => format!("$KV.claims.machine.mill.{}", uuid(&mut chance)),
            2 => "shop.event.mill".to_owned(),
            3 => format!("$O.programs.{}.{}", ["M", "C"][chance.below(2)], uuid(&mut chance)),
            4 => "_INBOX_mill.x".to_owned(),
            _ => "shop.job.machine.mill".to_owned(),
        };
        raw.publish(&subject, &message(&mut chance, &recorded, &signed[0]));
        if number % 500 == 499 {
            raw.flush();
            signed.push(submit(&broker));
        }
    }
    raw.flush();
    signed.push(submit(&broker));
    let until = Instant::now() + Duration::from_secs(120 + u64::from(messages) / 200);
    let jobs = loop {
        let jobs: Value = serde_json::from_str(&broker.done("mill", &["jobs", "--all", "--json"])).expect("one object");
        let jobs = jobs["jobs"].as_array().expect("a list").clone();
        let is_ready = |id: &String| jobs.iter().any(|job| job["id"] == id.as_str() && job["state"] == "ready");
        if signed.iter().all(is_ready) {
            break jobs;
        }
        assert!(Instant::now() < until, "{} of {} jobs are ready\n{}", jobs.len(), signed.len(), broker.log("mill"));
        sleep(Duration::from_millis(200));
    };
    assert_eq!(jobs.len(), signed.len(), "only what was signed is there: {jobs:?}");
    let journals: Value = serde_json::from_str(&bench.retrace(["jobs", "--json", "--all"]).out).expect("one object");
    assert_eq!(journals["jobs"].as_array().map(Vec::len), Some(0), "nothing was started");
    let log = broker.log("mill");
    assert!(!log.contains("panicked"), "{log}");
    let agents = broker.agents();
    let kb = resident_kb(agents[0].1);
    println!(
        "{messages} messages, {} jobs, seed {seed}, agent {kb} kB, {:.0} s",
        signed.len(),
        begun.elapsed().as_secs_f64()
    );
    assert!(kb > 0 && kb < MAX_KB, "{kb} kB");
}

fn uuid(chance: &mut TestRandom) -> String {
    let digits: String = (0..32).map(|_| char::from_digit(chance.below(16) as u32, 16).expect("a digit")).collect();
    format!("{}-{}-{}-{}-{}", &digits[..8], &digits[8..12], &digits[12..16], &digits[16..20], &digits[20..])
}
