//! Jobs from one computer of a shop to the machines of others, through a nats-server (SHP).

use std::fs;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, assert_contains};
use retrace_tests::not_run::not_run;
use retrace_tests::shop_broker::ShopBroker;
use retrace_tests::terminal::Terminal;
use serde_json::Value;

const PART: &str = "G21 G90 G94 F3000\nG1 X20\nX25 Y5\nX0 Y0\nM2\n";

/// A bench with a program.
fn bench() -> (Bench, String) {
    let bench = Bench::new();
    let part = bench.file("part.ngc", PART);
    (bench, part.to_str().expect("a name").to_owned())
}

/// Jobs of a machine: name and state.
fn jobs(broker: &ShopBroker, machine: &str) -> Vec<(String, String)> {
    let text = broker.done(machine, &["jobs", "--all", "--json"]);
    let jobs: Value = serde_json::from_str(&text).expect("one object");
    let text = |job: &Value, key: &str| job[key].as_str().expect("a text").to_owned();
    jobs["jobs"].as_array().expect("a list").iter().map(|job| (text(job, "id"), text(job, "state"))).collect()
}

fn submit(broker: &ShopBroker, part: &str, more: &[&str]) -> String {
    broker.done("office", &[&["submit", part], more].concat()).trim().to_owned()
}

fn ready(id: &str) -> (String, String) {
    (id.to_owned(), "ready".to_owned())
}

/// Waits until something is so.
#[track_caller]
fn wait_for(what: &str, limit_s: u64, mut is_so: impl FnMut() -> bool) {
    let until = Instant::now() + Duration::from_secs(limit_s);
    while !is_so() {
        assert!(Instant::now() < until, "{what}: not within {limit_s} s");
        sleep(Duration::from_millis(50));
    }
}

#[test]
fn a_job_of_the_office_is_taken_checked_and_run_at_its_machine() {
    let (bench, part) = bench();
    let test = "shop_broker::a_job_of_the_office_is_taken_checked_and_run_at_its_machine";
    let Some(broker) = ShopBroker::start(test, &bench, &["mill-1", "mill-2"], &[]) else { return };
    let id = submit(&broker, &part, &["--machine", "mill-1", "--note", "burr inside", "--order", "4711/2"]);
    assert!(broker.done("mill-2", &["agent", "--once"]).is_empty());
    let taken = broker.done("mill-1", &["agent", "--once"]);
    assert_contains(&taken, &["received from office", "taken", "ready, no errors"]);
    assert_eq!((jobs(&broker, "mill-1"), jobs(&broker, "mill-2")), (vec![ready(&id)], vec![]));
    assert_contains(&broker.done("mill-1", &["show", &id]), &["burr inside", "4711/2", "machine mill-1", "office"]);
    // again from the beginning of the stream: nothing is taken twice
    assert!(broker.done("mill-1", &["agent", "--once"]).is_empty());
    // the submitter forgets it when the machine has it
    let outbox = bench.path("state/retrace/shop/_outbox");
    assert!(outbox.join(&id).exists());
    assert_contains(&broker.done("office", &["host", "--once"]), &["machine mill-1 has taken it"]);
    assert!(!outbox.join(&id).exists());
    let run = bench.retrace(["run", "--job", &id, "--shop-file", &broker.shop_file("mill-1")]);
    assert_eq!(run.code, Some(0), "{}", run.err);
    assert_eq!(jobs(&broker, "mill-1")[0].1, "done");
    broker.done("office", &["audit"]);
    // the events follow
    broker.done("mill-1", &["agent", "--once"]);
    assert_contains(&broker.done("office", &["audit", "--broker"]), &["1 jobs, 0 faults"]);
}

#[test]
fn a_job_of_a_group_is_taken_by_one_machine_that_has_nothing_to_do() {
    let (bench, part) = bench();
    let test = "shop_broker::a_job_of_a_group_is_taken_by_one_machine_that_has_nothing_to_do";
    let group = ["--group", "mills=mill-1,mill-2"];
    let Some(broker) = ShopBroker::start(test, &bench, &["mill-1", "mill-2", "lathe"], &group) else { return };
    let first = submit(&broker, &part, &["--group", "mills"]);
    let second = submit(&broker, &part, &["--group", "mills"]);
    let third = submit(&broker, &part, &["--group", "mills"]);
    for machine in ["lathe", "mill-1", "mill-2", "mill-1", "mill-2"] {
        let _ = broker.done(machine, &["agent", "--once"]);
    }
    assert_eq!(jobs(&broker, "lathe"), vec![]);
    assert_eq!(jobs(&broker, "mill-1"), vec![ready(&first)]);
    assert_eq!(jobs(&broker, "mill-2"), vec![ready(&second)]);
    let run = bench.retrace(["run", "--job", &second, "--shop-file", &broker.shop_file("mill-2")]);
    assert_eq!(run.code, Some(0), "{}", run.err);
    let _ = broker.done("mill-2", &["agent", "--once"]);
    assert_eq!(jobs(&broker, "mill-2").last(), Some(&ready(&third)));
    broker.done("office", &["audit"]);
}

#[test]
fn a_recalled_job_is_given_back_unless_it_runs_and_a_text_is_shown_once() {
    let (bench, part) = bench();
    let test = "shop_broker::a_recalled_job_is_given_back_unless_it_runs_and_a_text_is_shown_once";
    let Some(broker) = ShopBroker::start(test, &bench, &["mill"], &[]) else { return };
    let to_mill = ["--machine", "mill"];
    // nobody has it yet
    let early = submit(&broker, &part, &to_mill);
    assert_contains(&broker.done("office", &["recall", &early]), &["no machine had it"]);
    let taken = submit(&broker, &part, &to_mill);
    let done = submit(&broker, &part, &to_mill);
    let _ = broker.done("mill", &["agent", "--once"]);
    assert_eq!(jobs(&broker, "mill"), vec![ready(&taken), ready(&done)]);
    let run = bench.retrace(["run", "--job", &done, "--shop-file", &broker.shop_file("mill")]);
    assert_eq!(run.code, Some(0), "{}", run.err);
    for id in [&taken, &done] {
        assert_contains(&broker.done("office", &["recall", id]), &["asked to give it back"]);
    }
    broker.done("office", &["say", "mill", "the material comes at two"]);
    let printed = broker.done("mill", &["agent", "--once"]);
    assert_contains(&printed, &["given back, recalled by office", "office: the material comes at two"]);
    let states: Vec<String> = jobs(&broker, "mill").into_iter().map(|(_, state)| state).collect();
    assert_eq!(states, ["returned", "done"]);
    assert!(broker.done("mill", &["agent", "--once"]).is_empty());
    assert_contains(&broker.done("mill", &["jobs"]), &["office: the material comes at two"]);
    let unknown = broker.retrace("office", &["recall", "01a2"]);
    assert!(unknown.code == Some(2) && unknown.err.contains("error[E5004]"), "{}", unknown.err);
}

/// The keys of one machine open nothing of another one (SHP-24).
#[test]
fn a_machine_cannot_take_the_jobs_of_another_one_or_write_its_state() {
    let (bench, part) = bench();
    let test = "shop_broker::a_machine_cannot_take_the_jobs_of_another_one_or_write_its_state";
    let Some(mut broker) = ShopBroker::start(test, &bench, &["mill-1", "mill-2"], &[]) else { return };
    let id = submit(&broker, &part, &["--machine", "mill-2"]);
    // mill-1's key in a shop file that says mill-2
    let file = fs::read_to_string(broker.shop_file("mill-2")).expect("a file");
    let thief = file.replace("mill-2.seed", "mill-1.seed") + "\n";
    fs::write(broker.shop_file("thief"), thief.replacen("name", "root = \"thief\"\nname", 1)).expect("written");
    let refused = broker.retrace("thief", &["agent", "--once"]);
    assert!(refused.code == Some(2) && refused.err.contains("error[E50"), "{}\n{}", refused.out, refused.err);
    assert_eq!(jobs(&broker, "thief"), vec![]);
    broker.start_agent("thief");
    sleep(Duration::from_secs(2));
    assert_contains(&broker.done("office", &["watch", "--once"]), &["no machine has reported yet"]);
    broker.kill_agent("thief");
    // a machine cannot submit either
    let sent = broker.retrace("mill-1", &["submit", &part, "--machine", "mill-2"]);
    assert!(sent.err.contains("E5038") && sent.err.contains("ermission"), "{}", sent.err);
    let _ = broker.done("mill-2", &["agent", "--once"]);
    assert_eq!(jobs(&broker, "mill-2"), vec![ready(&id)]);
}

#[test]
fn a_server_that_has_lost_its_disk_gets_everything_again() {
    let (bench, part) = bench();
    let test = "shop_broker::a_server_that_has_lost_its_disk_gets_everything_again";
    let Some(mut broker) = ShopBroker::start(test, &bench, &["mill"], &[]) else { return };
    let taken = submit(&broker, &part, &["--machine", "mill"]);
    let _ = broker.done("mill", &["agent", "--once"]);
    let waits = submit(&broker, &part, &["--machine", "mill"]);
    broker.kill_server();
    // with the server away the job stays with its submitter
    let away = broker.retrace("office", &["submit", &part, "--machine", "mill"]);
    assert!(away.code == Some(0) && away.err.contains("stored on this computer"), "{}", away.err);
    assert!(away.err.contains("error[E5035]"), "{}", away.err);
    let away = away.out.trim().to_owned();
    broker.delete_store();
    broker.start_server();
    let _ = broker.done("host", &["host", "--once"]);
    let sent = broker.done("office", &["host", "--once"]);
    assert_contains(&sent, &[&format!("{waits}: sent"), &format!("{away}: sent")]);
    let _ = broker.done("mill", &["agent", "--once"]);
    assert_eq!(jobs(&broker, "mill"), vec![ready(&taken), ready(&waits), ready(&away)]);
    let settled = broker.done("office", &["host", "--once"]);
    assert_contains(&settled, &[&taken, &waits, &away, "has taken it"]);
    assert!(broker.done("mill", &["agent", "--once"]).is_empty());
    broker.done("office", &["audit"]);
}

/// Forged, unsigned, replayed and random messages on everything that an agent reads: nothing but jobs that were signed
/// reaches the inbox.
#[test]
fn what_is_not_signed_by_a_submitter_changes_nothing() {
    let (bench, part) = bench();
    let test = "shop_broker::what_is_not_signed_by_a_submitter_changes_nothing";
    let Some(mut broker) = ShopBroker::start_open(test, &bench, &["mill", "other"]) else { return };
    let id = submit(&broker, &part, &["--machine", "mill"]);
    // the computer `other` is a submitter for no machine
    let forged = broker.done("other", &["submit", &part, "--machine", "mill"]).trim().to_owned();
    let mut raw = broker.raw();
    let mut seed = 2026_u64;
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as usize
    };
    for number in 0..3000 {
        let text = match number % 5 {
            0 => (0..random() % 300).map(|_| random() as u8).collect(),
            1 => b"{\"message\":\"{}\",\"key\":\"UA\",\"signature\":\"00\"}".to_vec(),
            2 => format!("{{\"kind\":\"start\",\"id\":\"{id}\"}}").into_bytes(),
            3 => b"cycle start".to_vec(),
            _ => format!("{{\"job\":{{\"id\":\"{id}\",\"machine\":\"mill\"}}}}").into_bytes(),
        };
        raw.publish(["shop.job.machine.mill", "shop.job.machine.mill.start"][random() % 2], &text);
    }
    raw.flush();
    broker.start_agent("mill");
    wait_for("the job", 20, || jobs(&broker, "mill") == [ready(&id)]);
    // what the host would have sent is replayed, and sent to another machine
    let replayed = broker.done("office", &["submit", &part, "--machine", "other"]).trim().to_owned();
    let stored = broker.stored_last("JOBS", "shop.job.machine.other");
    assert!(String::from_utf8_lossy(&stored).contains(&replayed));
    raw.publish("shop.job.machine.mill", &stored);
    raw.flush();
    wait_for("the messages are read", 20, || broker.log("mill").contains("signed a message for machine other"));
    assert_eq!(jobs(&broker, "mill"), [ready(&id)]);
    let log = broker.log("mill");
    assert_contains(&log, &["E5037", "is not that of a submitter of this machine"]);
    assert!(!log.contains(&forged) && !log.contains(&format!("job {replayed}")), "{log}");
    // each refusal is printed once
    assert!(log.lines().count() < 60, "{} lines", log.lines().count());
}

#[test]
fn states_come_from_the_agents_and_age_without_them() {
    let (bench, _part) = bench();
    let test = "shop_broker::states_come_from_the_agents_and_age_without_them";
    let Some(mut broker) = ShopBroker::start(test, &bench, &["mill-1", "mill-2"], &[]) else { return };
    broker.start_agent("mill-1");
    wait_for("the state", 10, || broker.done("office", &["watch", "--once"]).contains("mill-1"));
    let table = broker.done("office", &["watch", "--once"]);
    assert_contains(&table, &["machine", "mill-1", "not operated"]);
    assert!(!table.contains("mill-2"), "{table}");
    let states = broker.done("office", &["watch", "--once", "--json"]);
    let states: Value = serde_json::from_str(&states).expect("one object");
    assert!(states["machines"][0]["state"].is_null() && states["machines"][0]["machine"] == "mill-1", "{states}");
    broker.kill_agent("mill-1");
    wait_for("the state is old", 25, || broker.done("office", &["watch", "--once"]).contains("not known"));
    // a command does not say which of two machines of one computer it operates
    broker.start_agent("mill-1");
    broker.start_agent("mill-2");
    wait_for("two machines", 20, || {
        let states = broker.done("office", &["watch", "--once", "--json"]);
        states.matches("\"state\":\"not known\"").count() == 2
    });
}

/// The table names the job that runs. While the broker is away, at the beginning or later, it is one line more.
#[test]
fn the_table_of_machines_names_the_job_and_goes_on_without_the_broker() {
    let (bench, _part) = bench();
    let test = "shop_broker::the_table_of_machines_names_the_job_and_goes_on_without_the_broker";
    let Some(mut broker) = ShopBroker::start(test, &bench, &["mill"], &[]) else { return };
    let long = bench.file("long.ngc", "G21 G90 G94 F600\nG1 X200\nX0\nX200\nM2\n");
    broker.start_agent("mill");
    let id = submit(&broker, long.to_str().expect("a name"), &["--machine", "mill"]);
    wait_for("the check", 20, || jobs(&broker, "mill") == [ready(&id)]);
    let office = broker.shop_file("office");
    let state = bench.path("state").display().to_string();
    let watch = ["shop", "watch", "--shop-file", &office];
    let terminal = Terminal::with(&watch, 140, 10, &[("XDG_STATE_HOME", &state)]);
    terminal.wait_for_text("not operated");
    let file = broker.shop_file("mill");
    let run = ["run", "--job", &id, "--shop-file", &file, "--realtime", "--no-tui", "--json"];
    let mut run = bench.start(&run, Stdio::null(), "run.txt");
    let shown = terminal.wait_for_text(&id[..13]);
    assert!(!shown.contains(&id[..14]) && !shown.contains("E5035"), "{shown}");
    let states: Value =
        serde_json::from_str(&broker.done("office", &["watch", "--once", "--json"])).expect("one object");
    assert_eq!((&states["machines"][0]["job"], &states["away"]), (&Value::from(id.as_str()), &Value::Null), "{states}");
    let figures = ["line", "done_percent", "override_percent"].map(|key| states["machines"][0][key].as_f64());
    assert_eq!(figures, [Some(2.0), Some(20.0), Some(100.0)], "the first of 200 mm at 10 mm/s: {states}");
    assert!(shown.contains("long.ngc") && shown.contains(" 100 %"), "{shown}");
    broker.kill_server();
    let away = terminal.wait_for_text("E5035");
    assert!(away.contains(&id[..13]) && away.matches("E5035").count() == 1, "{away}");
    // one that begins now waits, too
    let mut late = bench.start(&[&watch[..], &["--json"]].concat(), Stdio::null(), "watch.txt");
    let last = || -> Value {
        let text = fs::read_to_string(bench.path("watch.txt")).unwrap_or_default();
        text.lines().last().and_then(|line| serde_json::from_str(line).ok()).unwrap_or_default()
    };
    wait_for("the broker is away", 20, || last()["away"]["number"] == "E5035");
    assert_eq!(last()["machines"], Value::Array(Vec::new()));
    broker.start_server();
    wait_for("the broker is back", 40, || last()["away"].is_null() && last()["machines"][0]["job"] == id.as_str());
    terminal.wait_until("the line is gone", |text| !text.contains("E5035") && text.contains(&id[..13]));
    for child in [&mut run, &mut late] {
        child.kill().expect("killed");
        child.wait().expect("ended");
    }
    terminal.wait_until("the job runs no more", |text| text.contains("mill") && !text.contains(&id[..13]));
    let screen = terminal.text();
    assert!(
        !screen.contains("\\u001b") && screen.matches("override").count() == 1,
        "drawn over the last one: {screen}"
    );
}

/// Runs OpenSSL in the folder of the bench. Returns whether it is installed and succeeded.
fn openssl(bench: &Bench, arguments: &[&str]) -> bool {
    let mut command = Command::new("openssl");
    command.args(arguments).current_dir(bench.path("")).stdin(Stdio::null()).stdout(Stdio::null());
    command.stderr(Stdio::null()).status().is_ok_and(|status| status.success())
}

/// Makes a root certificate of this name.
fn make_root(bench: &Bench, name: &str) -> bool {
    let (key, certificate) = (format!("{name}.key"), format!("{name}.pem"));
    let curve = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes"];
    let subject = ["-days", "2", "-subj", "/CN=shop", "-keyout", &key, "-out", &certificate];
    openssl(bench, &[&["req", "-x509"][..], &curve, &subject].concat())
}

/// With the commands of docs/shop.md.
#[test]
fn over_tls_a_server_without_the_certificate_of_the_shop_gets_nothing() {
    let (bench, part) = bench();
    let test = "shop_broker::over_tls_a_server_without_the_certificate_of_the_shop_gets_nothing";
    if !make_root(&bench, "ca") || !make_root(&bench, "other") {
        return not_run(test, "no openssl");
    }
    let request =
        "req -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -subj /CN=broker -keyout server.key -out server.csr";
    let sign = "x509 -req -in server.csr -CA ca.pem -CAkey ca.key -CAcreateserial -days 2 -extfile san -out server.pem";
    bench.file("san", "subjectAltName=DNS:localhost");
    for command in [request, sign] {
        assert!(openssl(&bench, &command.split(' ').collect::<Vec<&str>>()), "{command}");
    }
    let [ca, certificate, key] =
        ["ca.pem", "server.pem", "server.key"].map(|name| bench.path(name).display().to_string());
    let more = ["--tls-cert", &certificate, "--tls-key", &key, "--ca", &ca];
    let Some(broker) = ShopBroker::start_over_tls(test, &bench, &["mill"], &more) else { return };
    let id = submit(&broker, &part, &["--machine", "mill"]);
    broker.done("mill", &["agent", "--once"]);
    assert_eq!(jobs(&broker, "mill"), [ready(&id)]);
    let file = fs::read_to_string(broker.shop_file("office")).expect("a file");
    fs::write(broker.shop_file("changed"), file.replace("ca.pem", "other.pem")).expect("written");
    let refused = broker.retrace("changed", &["watch", "--once"]);
    assert!(refused.code == Some(2) && refused.err.contains("error[E5035]"), "{}", refused.err);
}

/// A machine has left a group: what it may not claim any more, whether it has the job or not, holds up nothing.
#[test]
fn a_recall_of_what_a_machine_may_not_claim_holds_up_nothing() {
    let (bench, part) = bench();
    let test = "shop_broker::a_recall_of_what_a_machine_may_not_claim_holds_up_nothing";
    let group = ["--group", "mills=mill-1,mill-2"];
    let Some(mut broker) = ShopBroker::start(test, &bench, &["mill-1", "mill-2"], &group) else { return };
    let id = submit(&broker, &part, &["--group", "mills"]);
    broker.done("mill-1", &["agent", "--once"]);
    assert_eq!(jobs(&broker, "mill-1"), [ready(&id)]);
    assert_contains(&broker.done("office", &["recall", &id]), &["asked to give it back"]);
    // meanwhile the machine has left the group
    let file = fs::read_to_string(broker.shop_file("mill-1")).expect("a file");
    let left: String =
        file.lines().filter(|line| !line.starts_with("groups")).map(|line| format!("{line}\n")).collect();
    fs::write(broker.shop_file("mill-1"), left).expect("written");
    broker.kill_server();
    let (folder, listen) = (bench.path("shop"), format!("127.0.0.1:{}", broker.port()));
    let folder = folder.to_str().expect("a name");
    let machines = ["--machine", "mill-1", "--machine", "mill-2", "--group", "mills=mill-2", "--submitter", "office"];
    let made = bench.retrace([&["shop", "init", folder, "--listen", &listen], &machines[..]].concat());
    assert_eq!(made.code, Some(0), "{}", made.err);
    broker.start_server();
    let next = submit(&broker, &part, &["--machine", "mill-1"]);
    let agent = broker.retrace("mill-1", &["agent", "--once"]);
    assert!(agent.code == Some(0) && agent.err.contains("error[E5038]"), "its claim stays: {}", agent.err);
    assert_eq!(jobs(&broker, "mill-1"), [(id, "returned".to_owned()), ready(&next)]);
    // and with its ledger it has lost the job
    fs::remove_dir_all(bench.path("state/retrace/shop/mill-1")).expect("lost");
    let last = submit(&broker, &part, &["--machine", "mill-1"]);
    broker.done("mill-1", &["agent", "--once"]);
    assert_eq!(jobs(&broker, "mill-1"), [ready(&last)]);
}

/// What the inbox has no room for stays at the broker, but for a few jobs.
#[test]
fn a_full_inbox_leaves_jobs_at_the_broker() {
    let (bench, part) = bench();
    let test = "shop_broker::a_full_inbox_leaves_jobs_at_the_broker";
    let Some(broker) = ShopBroker::start(test, &bench, &["mill"], &[]) else { return };
    let sent: Vec<String> = (0..23).map(|_| submit(&broker, &part, &["--machine", "mill"])).collect();
    let file = fs::read_to_string(broker.shop_file("mill")).expect("a file");
    fs::write(broker.shop_file("mill"), format!("inbox_gib = 0.00000001\n{file}")).expect("written");
    let full = broker.retrace("mill", &["agent", "--once"]);
    assert!(full.code == Some(0) && full.err.contains("error[E5008]"), "{}", full.err);
    assert_eq!(jobs(&broker, "mill").len(), 20, "in the queue");
    fs::write(broker.shop_file("mill"), file).expect("written");
    broker.done("mill", &["agent", "--once"]);
    assert_eq!(jobs(&broker, "mill"), sent.iter().map(|id| ready(id)).collect::<Vec<_>>());
}

#[test]
fn the_doctor_names_what_is_missing() {
    let (bench, part) = bench();
    let test = "shop_broker::the_doctor_names_what_is_missing";
    let Some(mut broker) = ShopBroker::start(test, &bench, &["mill"], &[]) else { return };
    let _ = submit(&broker, &part, &["--machine", "mill"]);
    let well = broker.done("mill", &["doctor"]);
    assert_contains(&well, &["this computer is mill", "key: U", "broker: nats-server", "streams: complete"]);
    assert_contains(&broker.done("office", &["doctor"]), &["no machine has taken yet: 1"]);
    broker.kill_server();
    let away = broker.retrace("mill", &["doctor"]);
    assert!(away.code == Some(2) && away.err.contains("error[E5035]"), "{}", away.err);
    broker.delete_store();
    broker.start_server();
    let empty = broker.retrace("mill", &["doctor"]);
    assert!(empty.code == Some(2) && empty.err.contains("stream JOBS is missing"), "{}", empty.err);
}

/// An agent that is killed behind its claim has nothing yet: the submitter keeps the job until the ledger has it.
#[test]
fn a_claim_alone_lets_the_submitter_forget_nothing() {
    let (bench, part) = bench();
    let test = "shop_broker::a_claim_alone_lets_the_submitter_forget_nothing";
    let Some(broker) = ShopBroker::start_open(test, &bench, &["mill"]) else { return };
    let id = submit(&broker, &part, &["--machine", "mill"]);
    let mut raw = broker.raw();
    let claim = format!("$KV.claims.machine.mill.{id}");
    raw.publish(&claim, b"{\"machine\":\"mill\",\"state\":\"claimed\"}");
    raw.flush();
    let outbox = bench.path("state/retrace/shop/_outbox");
    assert_eq!(broker.done("office", &["host", "--once"]), "");
    assert!(outbox.join(&id).exists());
    broker.done("mill", &["agent", "--once"]);
    assert_eq!(jobs(&broker, "mill"), [ready(&id)]);
    assert_contains(&broker.done("office", &["host", "--once"]), &["machine mill has taken it"]);
    assert!(!outbox.join(&id).exists());
    // and a claim of another machine is not touched
    let other = submit(&broker, &part, &["--machine", "mill"]);
    raw.publish(&format!("$KV.claims.machine.mill.{other}"), b"{\"machine\":\"lathe\",\"state\":\"claimed\"}");
    raw.flush();
    broker.done("mill", &["agent", "--once"]);
    assert_eq!(jobs(&broker, "mill"), [ready(&id)]);
}

/// The claim says that the machine had the job, and nobody but a person can know whether it was cut.
#[test]
fn a_ledger_that_was_lost_takes_no_job_again() {
    let (bench, part) = bench();
    let test = "shop_broker::a_ledger_that_was_lost_takes_no_job_again";
    let Some(broker) = ShopBroker::start(test, &bench, &["mill"], &[]) else { return };
    let id = submit(&broker, &part, &["--machine", "mill"]);
    broker.done("mill", &["agent", "--once"]);
    assert_eq!(jobs(&broker, "mill"), [ready(&id)]);
    fs::remove_dir_all(bench.path("state/retrace/shop/mill")).expect("moved away");
    let again = broker.retrace("mill", &["agent", "--once"]);
    assert!(again.code == Some(0) && again.err.contains("error[E5039]"), "{}\n{}", again.out, again.err);
    assert_eq!(jobs(&broker, "mill"), []);
}

#[test]
fn without_a_broker_in_the_shop_file_its_commands_are_refused() {
    let (bench, part) = bench();
    for arguments in [
        &["shop", "host", "--once"][..],
        &["shop", "watch", "--once"],
        &["shop", "say", "mill", "text"],
        &["shop", "submit", &part, "--group", "mills"],
    ] {
        let refused = bench.retrace(arguments);
        assert!(refused.code == Some(2) && refused.err.contains("error[E5040]"), "{arguments:?}: {}", refused.err);
    }
}
