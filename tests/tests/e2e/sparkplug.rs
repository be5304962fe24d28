//! `retrace shop sparkplug` with the broker mosquitto, by a host that knows the specification only (SHP-27).

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::net::UnixListener;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;
use retrace_tests::command::{Bench, assert_contains, cases, root};
use retrace_tests::mqtt_client::{Mosquitto, MqttClient, free_port};
use retrace_tests::not_run::not_run;
use retrace_tests::served::ServedCard;
use retrace_tests::sparkplug_checker::{HostValue, SparkplugHost, command};
use retrace_tests::sparkplug_node::SparkplugNode;

const NO_BROKER: &str = "mosquitto is not installed";
const COMMAND: &str = "spBv1.0/shop/NCMD/mill";
const STATE: &str = "spBv1.0/STATE/scada";
const LONG: Duration = Duration::from_secs(30);

/// A host application that checks every message of the node.
struct Host {
    client: MqttClient,
    host: SparkplugHost,
    /// Values of `state`, in their order.
    states: Vec<String>,
}

impl Host {
    fn connect(port: u16, user: Option<(&str, &str)>) -> Self {
        let mut client = MqttClient::connect(port, "host", user);
        client.subscribe(&["spBv1.0/shop/NBIRTH/mill", "spBv1.0/shop/NDATA/mill", "spBv1.0/shop/NDEATH/mill"]);
        Self { client, host: SparkplugHost::default(), states: Vec::new() }
    }

    /// Takes messages for this time.
    fn take_for(&mut self, time: Duration) {
        let until = Instant::now() + time;
        while Instant::now() < until {
            self.take();
        }
    }

    fn take(&mut self) {
        self.take_within(Duration::from_millis(50));
    }

    /// Takes a message that has come, if there is one.
    fn take_present(&mut self) {
        self.take_within(Duration::ZERO);
    }

    fn take_within(&mut self, time: Duration) {
        let Some(message) = self.client.receive(time) else { return };
        let kind = message.topic.split('/').nth(2).expect("a kind");
        let taken = self.host.take(kind, message.qos, message.is_retained, &message.payload);
        taken.unwrap_or_else(|why| panic!("{}: {why}", message.topic));
        if let Some(state) = self.text("state").filter(|&state| self.states.last().is_none_or(|last| last != state)) {
            self.states.push(state.to_owned());
        }
    }

    fn text(&self, name: &str) -> Option<&str> {
        match self.host.value(name)? {
            HostValue::Text(text) => Some(text),
            _ => None,
        }
    }

    fn wait(&mut self, of: &str, is_so: impl Fn(&SparkplugHost) -> bool) {
        let begun = Instant::now();
        while !is_so(&self.host) {
            assert!(begun.elapsed() < LONG, "{of}: {:?}", self.host);
            self.take();
        }
    }

    fn wait_text(&mut self, name: &str, text: &str) {
        let is = Some(HostValue::Text(text.into()));
        self.wait(&format!("{name} is not {text}"), |host| host.value(name) == is.as_ref());
    }

    fn wait_birth(&mut self, births: usize, bd_seq: u64) {
        let what = format!("birth {births} with bdSeq {bd_seq}");
        self.wait(&what, |host| host.is_online && host.births == births && host.bd_seq == Some(bd_seq));
    }
}

fn mosquitto(bench: &Bench, test: &str, lines: &str) -> Option<(Mosquitto, String)> {
    let Some(broker) = Mosquitto::start(&bench.path(""), lines) else {
        not_run(&format!("sparkplug::{test}"), NO_BROKER);
        return None;
    };
    let address = format!("mqtt://{}:{}", "127.0.0.1", broker.port);
    Some((broker, address))
}

/// A job of the shop whose run is held at M1; returns the run, and the name of the job.
fn start_job(bench: &Bench, card: &ServedCard) -> (Child, String) {
    bench.file("part.ngc", "G21 G90 F1200\nG0 X10\nG1 X40\nM1\nG1 X60\nM2\n");
    bench.file("m.toml", "[card]\nwatchdog_ms = 2000\n");
    let shop = |arguments: &[&str]| {
        let done = bench.retrace(["shop", "--shop-file", "shop.toml"].iter().chain(arguments));
        assert_eq!(done.code, Some(0), "{}", done.err);
        done.out.trim().to_owned()
    };
    let job = shop(&["submit", "part.ngc", "--quantity", "2"]);
    shop(&["agent", "--once"]);
    let run = ["run", "--job", &job, "--shop-file", "shop.toml", "--card", &card.port, "--machine", "m.toml", "--json"];
    (bench.start(&run, Stdio::piped(), "told.txt"), job)
}

/// From no machine over a run to its end: every message is one of the specification, and its values are those of the
/// machine. A birth on request has the same number, and the end in order is one death.
#[test]
fn a_host_sees_what_the_machine_does() {
    let bench = Bench::new();
    let Some((broker, address)) = mosquitto(&bench, "a_host_sees_what_the_machine_does", "") else { return };
    let mut host = Host::connect(broker.port, None);
    let mut node = SparkplugNode::start(&bench, &address, "");
    host.wait_birth(1, 0);
    let known = |host: &Host| {
        let all = host.host.values.iter().filter(|(_, value)| value.is_some());
        all.map(|(name, _)| name.clone()).collect::<Vec<_>>()
    };
    // No job was ever taken: no ledger has no pieces, and nothing else is known.
    assert_eq!(known(&host), ["Node Control/Rebirth", "bdSeq", "part_count", "version"]);
    let card = ServedCard::with(&[]);
    let (mut run, job) = start_job(&bench, &card);
    host.wait_text("state", "OPTIONAL_STOP");
    host.wait_text("job", &job);
    host.take_for(Duration::from_millis(1_500));
    for (name, value) in [
        ("program", HostValue::Text("part.ngc".into())),
        ("mode", HostValue::Text("run".into())),
        ("line", HostValue::Integer(3)),
        ("feed/override", HostValue::Number(100.0)),
        ("axis/x/work", HostValue::Number(40.0)),
        ("axis/x/machine", HostValue::Number(40.0)),
        ("reverse", HostValue::Flag(false)),
    ] {
        assert_eq!(host.host.value(name), Some(&value), "{name}");
    }
    assert_eq!(host.host.value("alarm/number"), None);
    // it has not gone back, and has been held since M1
    assert_eq!(host.host.value("retraced_s"), Some(&HostValue::Number(0.0)));
    host.wait("it is held", |host| matches!(host.value("held_s"), Some(HostValue::Number(held)) if *held > 1.0));
    assert_eq!(host.host.value("part_count"), Some(&HostValue::Integer(0)));
    host.client.publish(COMMAND, &command("Node Control/Rebirth", true), false);
    host.wait_birth(2, 0);
    assert_eq!(host.text("state"), Some("OPTIONAL_STOP"));
    run.stdin.as_mut().expect("a pipe").write_all(b"\n").expect("it listens");
    drop(run.stdin.take());
    let _ = run.kill();
    run.wait().expect("it ends");
    host.wait("state is null", |host| host.value("state").is_none() && host.value("axis/x/machine").is_none());
    host.wait("no job", |host| host.value("job").is_none());
    assert!(host.states.contains(&"ACTIVE".into()), "{:?}", host.states);
    assert!(node.end().success());
    host.wait("the death", |host| !host.is_online);
    host.take_for(Duration::from_millis(500));
    assert_eq!((host.host.births, host.host.deaths), (2, 1));
    assert!(host.host.data > 3, "{}", host.host.data);
    let printed = SparkplugNode::wait_for(&bench, "ended: 1 births on request, 0 messages ignored");
    assert_contains(&printed, &["Sparkplug edge node shop/mill", "(MQTT 5, bdSeq 0)"]);
    let _ = card.end();
}

/// Each change that a machine reports arrives, without a gap in the numbers.
#[test]
fn every_change_arrives_without_a_gap() {
    let bench = Bench::new();
    let Some((broker, address)) = mosquitto(&bench, "every_change_arrives_without_a_gap", "") else { return };
    let mut host = Host::connect(broker.port, None);
    let running = bench.path("state/retrace/running");
    std::fs::create_dir_all(&running).expect("a folder");
    let listener = UnixListener::bind(running.join("1.sock")).expect("a socket");
    let _node = SparkplugNode::start(&bench, &address, "");
    let (mut machine, _) = listener.accept().expect("it reads");
    host.wait_birth(1, 0);
    let axes = ["x", "y", "z"].map(|letter| serde_json::json!({"letter": letter, "is_linear": true}));
    let mut report = |message: serde_json::Value| writeln!(machine, "{message}").expect("it reads");
    report(serde_json::json!({"t": "machine", "version": 1, "name": "table 1", "axes": axes}));
    let changes = u64::from(cases(12).min(300));
    for line in 1..=changes {
        report(serde_json::json!({"t": "state", "stage": "job", "mode": "run", "hold_reason": "none", "line": line}));
        host.wait("the line", |host| host.value("line") == Some(&HostValue::Integer(line)));
    }
    assert_eq!((host.host.births, host.host.bd_seq), (1, Some(0)));
    assert!(host.host.data as u64 >= changes, "{} of {changes}", host.host.data);
}

/// `kill -9`, again and again: each death comes by the will, and each birth has the next number.
#[test]
fn a_node_that_is_killed_is_dead_by_its_will() {
    let bench = Bench::new();
    let Some((broker, address)) = mosquitto(&bench, "a_node_that_is_killed_is_dead_by_its_will", "") else { return };
    let mut host = Host::connect(broker.port, None);
    // The number before the last one, kept from earlier connections.
    std::fs::create_dir_all(bench.path("state/retrace/shop/mill")).expect("a folder");
    bench.file("state/retrace/shop/mill/sparkplug", "bdSeq 252\n");
    for deaths in 0..cases(5).min(1_000) as usize {
        let number = (deaths as u64 + 253) % 256;
        let mut node = SparkplugNode::start(&bench, &address, "");
        host.wait_birth(deaths + 1, number);
        node.kill();
        host.wait("the death", |host| host.deaths == deaths + 1 && !host.is_online);
    }
}

/// The broker is killed and comes back: the node is born again, with the next number, within seconds.
#[test]
fn a_broker_that_comes_back_sees_the_next_birth() {
    let bench = Bench::new();
    let Some((mut broker, address)) = mosquitto(&bench, "a_broker_that_comes_back_sees_the_next_birth", "") else {
        return;
    };
    let _node = SparkplugNode::start(&bench, &address, "");
    let mut printed = String::new();
    for number in 0..3 {
        let mut host = Host::connect(broker.port, None);
        printed = SparkplugNode::wait_for(&bench, &format!("bdSeq {number})"));
        // It may have been born before the host came: a host asks then.
        host.client.publish(COMMAND, &command("Node Control/Rebirth", true), false);
        host.wait("a birth", |host| host.is_online && host.bd_seq == Some(number));
        broker.kill();
        // For some time there is nothing that listens: no connection is counted.
        sleep(Duration::from_millis(700));
        broker.restart();
    }
    assert_contains(&printed, &["E5027"]);
}

/// What changes while the broker is away follows the next birth, flagged as old, in order and each once; what the host
/// holds for present is not changed by it.
#[test]
fn values_of_the_time_without_a_broker_follow_its_birth() {
    let bench = Bench::new();
    let test = "values_of_the_time_without_a_broker_follow_its_birth";
    let Some((mut broker, address)) = mosquitto(&bench, test, "") else { return };
    let running = bench.path("state/retrace/running");
    std::fs::create_dir_all(&running).expect("a folder");
    let listener = UnixListener::bind(running.join("1.sock")).expect("a socket");
    let mut host = Host::connect(broker.port, None);
    let _node = SparkplugNode::start(&bench, &address, "");
    let (mut machine, _) = listener.accept().expect("it reads");
    let mut report = |message: serde_json::Value| writeln!(machine, "{message}").expect("it reads");
    report(serde_json::json!({"t": "machine", "version": 1, "name": "table 1", "axes": []}));
    let state = |line: u64| {
        let (stage, mode, reason) = ("job", "run", "none");
        serde_json::json!({"t": "state", "stage": stage, "mode": mode, "hold_reason": reason, "line": line})
    };
    report(state(1));
    host.wait("the line", |host| host.value("line") == Some(&HostValue::Integer(1)));
    broker.kill();
    SparkplugNode::wait_for(&bench, "E5027");
    for line in 2..=5 {
        sleep(Duration::from_millis(1_100));
        report(state(line));
    }
    sleep(Duration::from_millis(1_100));
    broker.restart();
    let mut host = Host::connect(broker.port, None);
    SparkplugNode::wait_for(&bench, "bdSeq 1)");
    let lines = |host: &SparkplugHost| {
        let of_line = host.historical.iter().filter(|(name, ..)| name == "line");
        of_line.filter_map(|(.., value)| value.clone()).collect::<Vec<_>>()
    };
    let expected: Vec<HostValue> = (2..=5).map(HostValue::Integer).collect();
    host.wait("the old lines", |host| host.is_online && lines(host).len() >= expected.len());
    host.take_for(Duration::from_millis(1_500));
    assert_eq!((lines(&host.host), host.host.value("line")), (expected, Some(&HostValue::Integer(5))));
}

/// Where a primary host is named, nothing is born before it is online; where it goes offline, the node leaves.
#[test]
fn a_primary_host_is_awaited() {
    let bench = Bench::new();
    let Some((broker, address)) = mosquitto(&bench, "a_primary_host_is_awaited", "") else { return };
    let mut host = Host::connect(broker.port, None);
    let mut scada = MqttClient::connect(broker.port, "scada", None);
    let _node = SparkplugNode::start(&bench, &address, "primary_host = \"scada\"\n");
    SparkplugNode::wait_for(&bench, "waiting for the host application scada");
    scada.publish("spBv1.0/STATE/other", b"{\"online\":true,\"timestamp\":5}", true);
    scada.publish(STATE, b"{\"online\":false,\"timestamp\":5}", true);
    scada.publish(STATE, b"{\"online\":true,\"timestamp\":4}", true);
    scada.publish(STATE, b"{\"online\":1}", true);
    host.take_for(Duration::from_secs(1));
    assert_eq!(host.host.births, 0, "an older state, and one that is none, count for nothing");
    scada.publish(STATE, b"{\"online\":true,\"timestamp\":6}", true);
    host.wait_birth(1, 0);
    scada.publish(STATE, b"{\"online\":false,\"timestamp\":7}", true);
    host.wait("the death", |host| host.deaths == 1 && !host.is_online);
    host.take_for(Duration::from_secs(1));
    assert_eq!((host.host.births, host.host.deaths), (1, 1));
    scada.publish(STATE, b"{\"online\":true,\"timestamp\":8}", true);
    host.wait_birth(2, 1);
}

/// Whatever is sent to the topics that the node reads, while a run moves: nothing but births on request.
#[test]
fn ten_thousand_messages_move_nothing() {
    let bench = Bench::new();
    let Some((broker, address)) = mosquitto(&bench, "ten_thousand_messages_move_nothing", "") else { return };
    let mut host = Host::connect(broker.port, None);
    let mut node = SparkplugNode::start(&bench, &address, "primary_host = \"scada\"\n");
    let mut sender = MqttClient::connect(broker.port, "sender", None);
    sender.publish(STATE, b"{\"online\":true,\"timestamp\":1}", true);
    host.wait_birth(1, 0);
    // About 40 s of motion: the messages are sent within 15 s.
    bench.file("part.ngc", format!("G21 G90 F1200\n{}M2\n", "G1 X40\nG1 X0\n".repeat(10)));
    bench.file("m.toml", "[card]\nwatchdog_ms = 2000\n");
    let card = ServedCard::with(&[]);
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--json"];
    let mut run = bench.start(&run, Stdio::null(), "told.txt");
    host.wait_text("state", "ACTIVE");
    let messages = hostile_messages();
    for (topic, payload) in &messages {
        sender.publish(topic, payload, false);
        host.take_present();
        sleep(Duration::from_millis(1));
    }
    // What is sent last is answered last.
    let births = host.host.births;
    host.take_for(Duration::from_secs(1));
    sender.publish(COMMAND, &command("Node Control/Rebirth", true), false);
    host.wait("a birth", |host| host.births > births);
    assert!(run.try_wait().expect("a child").is_none(), "the run goes on meanwhile");
    for (name, value) in [
        ("state", HostValue::Text("ACTIVE".into())),
        ("mode", HostValue::Text("run".into())),
        ("feed/override", HostValue::Number(100.0)),
        ("reverse", HostValue::Flag(false)),
    ] {
        assert_eq!(host.host.value(name), Some(&value), "{name}");
    }
    let memory = memory_kib(node.process_id());
    let code = run.wait().expect("it ends").code();
    let told = std::fs::read_to_string(bench.path("told.txt")).expect("its output");
    assert_eq!(code, Some(0), "{told}");
    let ordered: Vec<&str> = told.lines().filter(|line| line.contains("\"event\":\"operator\"")).collect();
    assert!(ordered.iter().all(|line| line.contains("\"optional stop on\"")), "nothing was ordered: {ordered:?}");
    let odd = ["\"reversals\":0", "\"held_s\":0.0", "\"paused_s\":0.0", "\"underruns\":0"];
    assert_contains(told.lines().last().unwrap_or_default(), &odd);
    host.wait("state is null", |host| host.value("state").is_none());
    // The command ends sooner after its program than the next message is due.
    let is_undisturbed =
        ["ACTIVE", "PROGRAM_COMPLETED"].starts_with(&host.states.iter().map(String::as_str).collect::<Vec<_>>());
    assert!(is_undisturbed && !host.states.is_empty(), "{:?}", host.states);
    assert!(node.end().success());
    host.wait("the death", |host| !host.is_online);
    assert_eq!((host.host.deaths, host.host.bd_seq), (1, Some(0)), "one connection from beginning to end");
    // 64 MiB is what the agent of a shop may have.
    assert!(memory < 64 * 1024, "{memory} KiB");
    let printed = SparkplugNode::wait_for(&bench, "messages ignored");
    println!("{} births, {} with data, {memory} KiB, {printed}", host.host.births, host.host.data);
    let numbers: Vec<usize> =
        printed.rsplit("ended: ").next().unwrap_or_default().split(' ').flat_map(str::parse).collect();
    let [rebirths, ignored] = numbers[..] else { panic!("{printed}") };
    // One more was asked for at the end. Changed commands may still be one, where they have its name.
    let request = command("Node Control/Rebirth", true);
    let exact = messages.iter().filter(|(_, payload)| *payload == request).count();
    let named = messages.iter().filter(|(_, payload)| payload.windows(20).any(|name| name == b"Node Control/Rebirth"));
    assert!((exact + 1..=named.count() + 1).contains(&rebirths), "{exact}: {printed}");
    assert!(ignored > messages.len() / 2 && ignored + rebirths <= messages.len() + 1, "{printed}");
    let _ = card.end();
}

/// 10 000 messages: commands as they are, changed, cut, of chance, orders of the page, and states of hosts.
fn hostile_messages() -> Vec<(String, Vec<u8>)> {
    let names = ["Node Control/Rebirth", "Node Control/Reboot", "Node Control/Next Server", "state", "feed/override"];
    let recorded = (prop::sample::select(names.to_vec()), any::<bool>()).prop_map(|(name, value)| command(name, value));
    let changed = (recorded.clone(), any::<prop::sample::Index>(), any::<u8>()).prop_map(|(mut bytes, at, byte)| {
        let at = at.index(bytes.len());
        bytes[at] = byte;
        bytes
    });
    let cut = (recorded.clone(), any::<prop::sample::Index>()).prop_map(|(mut bytes, at)| {
        bytes.truncate(at.index(bytes.len()));
        bytes
    });
    let words = ["cycle start", "{\"t\":\"do\",\"id\":1,\"words\":\"reverse\"}", "{\"t\":\"hold\"}", "!", "\u{18}"];
    let order = prop::sample::select(words.to_vec()).prop_map(|words| words.as_bytes().to_vec());
    let chance = proptest::collection::vec(any::<u8>(), 0..300);
    let payload = prop_oneof![recorded, changed, cut, order, chance.clone()];
    // The host application stays online: its states are damaged ones, or older than the one that is known.
    let state = prop_oneof![Just(b"{\"online\":false,\"timestamp\":0}".to_vec()), chance];
    let message = prop_oneof![
        9 => payload.prop_map(|payload| (COMMAND.to_owned(), payload)),
        1 => state.prop_map(|payload| (STATE.to_owned(), payload)),
    ];
    let mut runner = TestRunner::deterministic();
    let mut one = || message.new_tree(&mut runner).expect("a message").current();
    (0..10_000).map(|_| one()).collect()
}

fn memory_kib(process: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or_default();
    line.trim().trim_end_matches(" kB").parse().unwrap_or_default()
}

/// With user, password and rights: what the broker refuses is named with its number.
#[test]
fn what_the_broker_refuses_is_named() {
    let bench = Bench::new();
    let hashes = bench.file("users", "m1:secret\nhost:h\n");
    let Ok(made) = Command::new("mosquitto_passwd").arg("-U").arg(&hashes).status() else {
        return not_run("sparkplug::what_the_broker_refuses_is_named", "mosquitto_passwd is not installed");
    };
    assert!(made.success());
    let rights =
        bench.file("rights", "user host\ntopic readwrite spBv1.0/#\n\nuser m1\ntopic write spBv1.0/shop/NBIRTH/mill\n");
    let lines = format!("allow_anonymous false\npassword_file {}\nacl_file {}\n", hashes.display(), rights.display());
    let Some((mut broker, address)) = mosquitto(&bench, "what_the_broker_refuses_is_named", &lines) else { return };
    bench.file("password", "wrong\n");
    let allow = |mode: &str| Command::new("chmod").arg(mode).arg(bench.path("password")).status().expect("changed");
    allow("600");
    let user = "user = \"m1\"\npassword_file = \"password\"\n";
    let node = SparkplugNode::start(&bench, &address, user);
    assert_contains(&SparkplugNode::wait_for(&bench, "E5024"), &["refuses the connection"]);
    drop(node);
    bench.file("password", "secret\n");
    let mut host = Host::connect(broker.port, Some(("host", "h")));
    let mut node = SparkplugNode::start(&bench, &address, user);
    // It may write births, and no deaths; mosquitto does not refuse a subscription, it delivers nothing.
    host.wait("a birth", |host| host.is_online);
    assert!(node.end().success());
    assert_contains(&SparkplugNode::wait_for(&bench, "E5028"), &["NotAuthorized"]);
    allow("644");
    let mut node = SparkplugNode::start(&bench, &address, user);
    assert_contains(&SparkplugNode::wait_for(&bench, "E5023"), &["everybody"]);
    assert_eq!(node.wait().code(), Some(2));
    broker.kill();
}

/// With TLS the broker has to show a certificate of the file `ca`.
#[test]
fn a_broker_with_tls_is_trusted_by_its_certificate() {
    let bench = Bench::new();
    let file = |name: &str| root().join("tests/data/tls").join(name).display().to_string();
    let lines = format!("certfile {}\nkeyfile {}\n", file("certificate.pem"), file("key.pem"));
    let test = "a_broker_with_tls_is_trusted_by_its_certificate";
    let Some((broker, _)) = mosquitto(&bench, test, &lines) else { return };
    let address = format!("mqtts://{}:{}", "localhost", broker.port);
    let node = SparkplugNode::start(&bench, &address, &format!("ca = \"{}\"\n", file("authority.pem")));
    assert_contains(&SparkplugNode::wait_for(&bench, "born"), &["mqtts:", "bdSeq 0)"]);
    drop(node);
    // The certificate of another authority: nothing is sent, and no connection is counted.
    let _node = SparkplugNode::start(&bench, &address, &format!("ca = \"{}\"\n", file("certificate.pem")));
    assert_contains(&SparkplugNode::wait_for(&bench, "E5027"), &["TLS"]);
}

/// A broker that asks for the certificate of the machine: without one the node is refused, with one it is born. A key
/// that everybody can read is not used.
#[test]
fn a_broker_that_asks_for_a_certificate_gets_that_of_the_machine() {
    let bench = Bench::new();
    let test = "a_broker_that_asks_for_a_certificate_gets_that_of_the_machine";
    let (key, own) = (bench.path("mill.key"), bench.path("mill.pem"));
    let mut openssl = Command::new("openssl");
    openssl.args(["req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "2"]);
    openssl.args(["-subj", "/CN=mill", "-keyout"]).arg(&key).arg("-out").arg(&own).stderr(Stdio::null());
    if !openssl.status().is_ok_and(|made| made.success()) {
        return not_run(&format!("sparkplug::{test}"), "openssl is not installed");
    }
    let file = |name: &str| root().join("tests/data/tls").join(name).display().to_string();
    let lines = format!(
        "certfile {}\nkeyfile {}\ncafile {}\nrequire_certificate true\n",
        file("certificate.pem"),
        file("key.pem"),
        own.display()
    );
    let Some((broker, _)) = mosquitto(&bench, test, &lines) else { return };
    let address = format!("mqtts://{}:{}", "localhost", broker.port);
    let ca = format!("ca = \"{}\"\n", file("authority.pem"));
    let node = SparkplugNode::start(&bench, &address, &ca);
    SparkplugNode::wait_for(&bench, "E5027");
    drop(node);
    let with_own = format!("{ca}certificate = \"mill.pem\"\nkey = \"mill.key\"\n");
    let allow = |mode: &str| Command::new("chmod").arg(mode).arg(&key).status().expect("changed");
    allow("644");
    let mut node = SparkplugNode::start(&bench, &address, &with_own);
    assert_contains(&SparkplugNode::wait_for(&bench, "E5023"), &["mill.key", "everybody"]);
    assert_eq!(node.wait().code(), Some(2));
    allow("600");
    let _node = SparkplugNode::start(&bench, &address, &with_own);
    SparkplugNode::wait_for(&bench, "born");
}

/// A connection to a broker of the test: the stream, and the protocol level of the first packet.
fn accept(listener: &TcpListener) -> (TcpStream, u8) {
    let (mut stream, _) = listener.accept().expect("it connects");
    stream.set_read_timeout(Some(LONG)).expect("a time");
    let packet = read_packet(&mut stream);
    // first byte, length of one byte or two, "MQTT", level
    let name = packet.windows(4).position(|bytes| bytes == b"MQTT").expect("a name");
    (stream, packet[name + 4])
}

fn read_packet(stream: &mut TcpStream) -> Vec<u8> {
    let mut buffer = [0; 4096];
    let count = stream.read(&mut buffer).expect("a packet");
    buffer[..count].to_vec()
}

/// A broker that knows version 3.1.1 only is spoken to in that version.
#[test]
fn a_broker_of_the_older_version_is_spoken_to() {
    let bench = Bench::new();
    let listener = TcpListener::bind("[::1]:0").or_else(|_| TcpListener::bind("127.0.0.1:0")).expect("a port");
    let address = format!("mqtt://{}", listener.local_addr().expect("its address"));
    let _node = SparkplugNode::start(&bench, &address, "");
    let (mut stream, level) = accept(&listener);
    assert_eq!(level, 5);
    // as the standard of 3.1.1 says: 1, unacceptable protocol version
    stream.write_all(&[0x20, 2, 0, 1]).expect("refused");
    let (mut stream, level) = accept(&listener);
    assert_eq!(level, 4);
    stream.write_all(&[0x20, 2, 0, 0]).expect("accepted");
    let packet = read_packet(&mut stream);
    assert_eq!(packet[0], 0x82, "it subscribes");
    stream.write_all(&[0x90, 3, packet[2], packet[3], 1]).expect("accepted");
    SparkplugNode::wait_for(&bench, "(MQTT 3.1.1, bdSeq 1)");
}

/// A broker that refuses the topic of the commands is named and left, in order: without commands it is no node.
#[test]
fn a_broker_that_refuses_a_subscription_is_left() {
    let bench = Bench::new();
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = format!("mqtt://{}", listener.local_addr().expect("its address"));
    let _node = SparkplugNode::start(&bench, &address, "");
    let (mut stream, _) = accept(&listener);
    stream.write_all(&[0x20, 3, 0, 0, 0]).expect("accepted");
    let packet = read_packet(&mut stream);
    // 135, not authorized
    stream.write_all(&[0x90, 4, packet[2], packet[3], 0, 135]).expect("refused");
    let death = read_packet(&mut stream);
    assert_eq!(death[0], 0x32, "a message of quality 1: {death:?}");
    assert_contains(&String::from_utf8_lossy(&death), &["spBv1.0/shop/NDEATH/mill"]);
    assert_contains(&SparkplugNode::wait_for(&bench, "E5025"), &["spBv1.0/shop/NCMD/mill", "NotAuthorized"]);
    assert_eq!(accept(&listener).1, 5, "it tries again");
}

#[test]
fn what_cannot_be_used_is_refused_with_its_number() {
    let bench = Bench::new();
    let refused = |text: &str| {
        let path = bench.file("shop.toml", text);
        let result = bench.retrace(["shop".as_ref(), "sparkplug".as_ref(), "--shop-file".as_ref(), path.as_os_str()]);
        assert_eq!(result.code, Some(2), "{}", result.err);
        result.err
    };
    assert_contains(&refused(""), &["E5021", "broker = "]);
    assert_contains(&refused("[sparkplug]\nbroker = \"mill\"\n"), &["E5021"]);
    assert_contains(&refused("[sparkplug]\nbroker = \"mqtt://mill.example\"\n"), &["E5022", "insecure"]);
    assert_contains(&refused("[sparkplug]\nbroker = \"mqtt://[::1]\"\nprimary = 1\n"), &["E5001", "line 3"]);
    assert_contains(
        &refused("[sparkplug]\nbroker = \"mqtts://mill.example\"\nca = \"no.pem\"\n"),
        &["E5023", "no.pem"],
    );
    // Nobody listens there: it goes on, and a second one of this machine is refused.
    let address = format!("mqtt://{}:{}", "127.0.0.1", free_port());
    let mut node = SparkplugNode::start(&bench, &address, "");
    SparkplugNode::wait_for(&bench, "E5027");
    assert_contains(&refused(&std::fs::read_to_string(bench.path("shop.toml")).expect("there")), &["E5026"]);
    assert!(node.end().success());
}
