//! `retrace shop mtconnect`: the adapter, by a checker that knows the protocol only (SHP-29).

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, assert_contains, binary};
use retrace_tests::served::ServedCard;
use retrace_tests::shdr_checker::{DeviceItems, ShdrAgentState, device_items};

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

#[test]
fn a_port_that_is_taken_is_refused() {
    let bench = Bench::new();
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = taken.local_addr().expect("its address").to_string();
    let refused = bench.retrace(["shop", "mtconnect", "--listen", &address]);
    assert_eq!(refused.code, Some(2));
    assert_contains(&refused.err, &["E5018", &address]);
}
