//! `retrace shop mtconnect`: the adapter, by a checker that knows the protocol only (SHP-29).

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};
use retrace_shop::{MachineReport, ReportedAxis, ShdrAdapter, devices_xml};
use retrace_tests::command::{Bench, binary};
use retrace_tests::served::ServedCard;
use retrace_tests::shdr_checker::{DeviceItems, ShdrAgentState, device_items};
use serde_json::{Value, json};

/// The adapter, ended with the test.
struct Adapter {
    child: Child,
    address: String,
    items: DeviceItems,
}

impl Adapter {
    fn start(bench: &Bench) -> Self {
        let command = |arguments: &[&str]| {
            let mut command = Command::new(binary());
            command.args(["shop", "mtconnect"]).args(arguments).env("XDG_STATE_HOME", bench.path("state"));
            command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
            command
        };
        let devices = command(&["--devices"]).output().expect("it runs").stdout;
        let items = device_items(&String::from_utf8(devices).expect("text")).expect("a device file");
        let mut child = command(&["--listen", "127.0.0.1:0"]).spawn().expect("it runs");
        let mut line = String::new();
        BufReader::new(child.stdout.take().expect("a pipe")).read_line(&mut line).expect("a line");
        let address = line.split(' ').find(|word| word.starts_with("127.0.0.1:")).expect("an address").to_owned();
        Self { child, address, items }
    }

    fn connect(&self) -> Agent<'_> {
        let stream = TcpStream::connect(&self.address).expect("it listens");
        stream.set_read_timeout(Some(Duration::from_millis(20))).expect("a time");
        Agent { stream, rest: Vec::new(), items: &self.items, state: ShdrAgentState::default(), seen: Vec::new() }
    }
}

impl Drop for Adapter {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// An agent that checks every line.
struct Agent<'a> {
    stream: TcpStream,
    rest: Vec<u8>,
    items: &'a DeviceItems,
    state: ShdrAgentState,
    /// Values of `execution`, in their order.
    seen: Vec<String>,
}

impl Agent<'_> {
    fn read(&mut self) {
        let mut buffer = [0; 4096];
        if let Ok(count) = self.stream.read(&mut buffer) {
            self.rest.extend_from_slice(&buffer[..count]);
        }
        while let Some(end) = self.rest.iter().position(|&byte| byte == b'\n') {
            let line: Vec<u8> = self.rest.drain(..=end).collect();
            let line = String::from_utf8(line).expect("text");
            self.state.take(line.trim_end_matches('\n'), self.items).unwrap_or_else(|why| panic!("{why}"));
            if let Some(execution) = self.state.values.get("execution").filter(|&value| self.seen.last() != Some(value))
            {
                self.seen.push(execution.clone());
            }
        }
    }

    fn wait(&mut self, key: &str, value: &str, within: Duration) {
        let begun = Instant::now();
        while self.state.values.get(key).map(String::as_str) != Some(value) {
            assert!(begun.elapsed() < within, "{key} is not {value}: {:?}", self.state.values);
            self.read();
        }
    }
}

/// From no machine over a program with a stop and a reverse run to its end, every line is well-formed, and its values
/// are those of the machine.
#[test]
fn an_agent_sees_what_the_machine_does() {
    let bench = Bench::new();
    let program = "G21 G90 F1200\nN20 G0 X10\nG1 X40\nM1 (a | b)\nG1 X60\nM2\n";
    bench.file("part.ngc", program);
    bench.file("m.toml", "[card]\nwatchdog_ms = 2000\n");
    bench.file("s.op", "at line 5 reverse 50%\nafter 0.7s leave\nat line 4 cycle start\n");
    let adapter = Adapter::start(&bench);
    let mut agent = adapter.connect();
    agent.wait("avail", "UNAVAILABLE", Duration::from_secs(5));
    assert_eq!(agent.state.values.len(), adapter.items.len(), "every item has a value at once");
    agent.stream.write_all(b"* PING\nexecution|ACTIVE\n* stop\n\0\xff\n").expect("it listens");
    let card = ServedCard::with(&[]);
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--json"];
    let mut host = bench.start(&run, Stdio::piped(), "told.txt");
    agent.wait("avail", "AVAILABLE", Duration::from_secs(30));
    agent.wait("execution", "OPTIONAL_STOP", Duration::from_secs(30));
    agent.wait("xwork", "40", Duration::from_secs(5));
    let told = &agent.state.values;
    assert_eq!(
        (told["program"].as_str(), told["line"].as_str(), told["mode"].as_str()),
        ("part.ngc", "3", "AUTOMATIC")
    );
    assert_eq!(
        (told["feedcmd"].as_str(), told["feedovr"].as_str(), told["system"].as_str()),
        ("1200", "100", "NORMAL")
    );
    // A second agent has all of it within 100 ms of its connection, and its time to be scheduled.
    let mut second = adapter.connect();
    second.wait("execution", "OPTIONAL_STOP", Duration::from_secs(2));
    assert_eq!(second.state.values.len(), adapter.items.len());
    assert_eq!(second.state.version.as_deref(), Some("2.0"));
    host.stdin.as_mut().expect("a pipe").write_all(b"\n").expect("it listens");
    drop(host.stdin.take());
    let _ = host.kill();
    host.wait().expect("it ends");
    agent.wait("avail", "UNAVAILABLE", Duration::from_secs(10));
    agent.wait("xmachine", "UNAVAILABLE", Duration::from_secs(1));
    assert!(
        agent.seen.starts_with(&["UNAVAILABLE".to_owned()]) && agent.seen.contains(&"ACTIVE".into()),
        "{:?}",
        agent.seen
    );
    let _ = card.end();
}

/// Reports of any kind, on one connection and on many: each line is well-formed, and a new connection has the state.
#[test]
fn any_report_makes_well_formed_lines() {
    let axes = [('x', true), ('z', true), ('a', false)].map(|(letter, is_linear)| ReportedAxis { letter, is_linear });
    let items = device_items(&devices_xml("mill \"1\" <&>", &axes)).expect("a device file");
    let mut runner = TestRunner::new(Config { cases: 1_500, ..Config::default() });
    let words = prop_oneof![
        Just("job"),
        Just("setup"),
        Just("ended"),
        Just("run"),
        Just("reverse"),
        Just("hold"),
        Just("none"),
        Just("program stop"),
        Just("M3"),
        Just("G1 G21 G94 F300"),
        Just("G20 G94 Fnan")
    ];
    let text = prop_oneof![words.prop_map(str::to_owned), "\\PC{0,40}", Just("a|b\r\n\"c\\|".to_owned())];
    let figure =
        prop_oneof![Just(Value::Null), any::<f64>().prop_map(Value::from), Just(json!(3)), Just(json!([1.5, null]))];
    let texts = proptest::collection::vec(text, 9);
    let figures = proptest::collection::vec(figure, 8);
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("its address");
    let adapter = std::cell::RefCell::new(ShdrAdapter::new(listener).expect("an adapter"));
    let lines = std::cell::Cell::new(0);
    runner
        .run(&(texts, figures, any::<[bool; 4]>()), |(text, figure, has)| {
            let alarm = has[0].then(|| json!({"number": "E3012", "cause": text[7], "is_refusal": has[1]}));
            let mut report = MachineReport::default();
            report.take(json!({
                "t": "state", "stage": text[0], "mode": text[1], "hold_reason": text[2], "why": text[3], "modal": text[4],
                "program": {"name": text[5]}, "line": figure[0], "override": figure[1], "tool": figure[2], "alarm": alarm,
                "pause": has[2].then_some(1), "switching": has[3].then_some("M3"),
            }));
            report.take(json!({
                "t": "live", "mm": figure[3], "work": figure[4], "feed": figure[5], "rate": figure[6], "rpm": figure[7],
                "back_mm": figure[5], "at_rest": has[1],
            }));
            report.take(json!({"t": "block", "text": text[6], "line": 1}));
            let stream = TcpStream::connect(address).expect("it listens");
            let mut adapter = adapter.borrow_mut();
            let begun = Instant::now();
            while adapter.agents() == 0 && begun.elapsed() < Duration::from_secs(5) {
                adapter.serve(&report, &axes);
            }
            report.forget();
            adapter.serve(&report, &axes);
            stream.shutdown(std::net::Shutdown::Write).expect("it is open");
            while adapter.agents() > 0 && begun.elapsed() < Duration::from_secs(5) {
                adapter.serve(&report, &axes);
            }
            let mut agent = ShdrAgentState::default();
            for line in BufReader::new(stream).lines() {
                agent.take(&line.expect("text"), &items).map_err(TestCaseError::fail)?;
            }
            prop_assert_eq!(agent.values.len(), items.len());
            prop_assert_eq!(&agent.values["avail"], "UNAVAILABLE");
            lines.set(lines.get() + agent.lines);
            Ok(())
        })
        .unwrap_or_else(|why| panic!("{why}"));
    assert!(lines.get() > 10_000, "{} lines", lines.get());
}

/// An agent that reads nothing is disconnected, and the others have everything.
#[test]
fn an_agent_that_reads_nothing_is_disconnected() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("its address");
    let mut adapter = ShdrAdapter::new(listener).expect("an adapter");
    let (sleeper, reader) = (TcpStream::connect(address).expect("one"), TcpStream::connect(address).expect("two"));
    let mut report = MachineReport::default();
    while adapter.agents() < 2 {
        adapter.serve(&report, &[]);
    }
    reader.set_nonblocking(true).expect("a socket");
    let (mut sent, mut read, mut buffer) = (0_u64, 0_u64, vec![0; 1 << 16]);
    while adapter.agents() == 2 {
        report
            .take(json!({"t": "state", "stage": "job", "program": {"name": format!("{sent} {}", "x".repeat(2_000))}}));
        adapter.serve(&report, &[]);
        sent += 1;
        while let Ok(count) = (&reader).read(&mut buffer) {
            read += count as u64;
        }
        assert!(sent < 100_000, "it takes no memory without end");
    }
    assert!(read > 2_000 * (sent - 1), "{read} bytes of {sent} values");
    drop(sleeper);
}
