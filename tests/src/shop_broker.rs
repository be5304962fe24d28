//! A nats-server for a test of a shop, and the computers of that shop.
//!
//! Invariant: server and agents end with the value, and everything that they write lies in the folder of the bench.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use retrace_task_support::tools;

use crate::command::{Bench, CommandOutput, binary};
use crate::mqtt_client::free_port;
use crate::not_run::not_run;

/// A server with the computers of a shop.
pub struct ShopBroker<'a> {
    bench: &'a Bench,
    program: PathBuf,
    port: u16,
    config: PathBuf,
    server: Option<Child>,
    agents: Vec<(String, Child)>,
}

/// The nats-server that is installed; where none is, the test is reported as not run.
#[must_use]
pub fn nats_server(test: &str) -> Option<PathBuf> {
    let found = tools::server("nats-server");
    if found.is_none() {
        not_run(test, "nats-server is not installed");
    }
    found
}

impl<'a> ShopBroker<'a> {
    /// Writes the files of a shop with these machines by `retrace shop init`, starts the server with the permissions
    /// that it writes, and makes the streams. `None`, reported, where there is no nats-server.
    ///
    /// # Panics
    /// Where a command fails.
    pub fn start(test: &str, bench: &'a Bench, machines: &[&str], more: &[&str]) -> Option<Self> {
        let broker = Self::prepare(test, bench, machines, more)?;
        Some(broker.run())
    }

    /// As [`start`](Self::start), with `tls://` in the shop files.
    ///
    /// # Panics
    /// Where a command fails.
    pub fn start_over_tls(test: &str, bench: &'a Bench, machines: &[&str], more: &[&str]) -> Option<Self> {
        let broker = Self::prepare(test, bench, machines, more)?;
        let unencrypted = format!("nats://{}:{}", "127.0.0.1", broker.port);
        for computer in machines.iter().chain(&["host", "office"]) {
            let file = broker.shop_file(computer);
            let text = fs::read_to_string(&file).expect("a shop file");
            let text = text.replace(&unencrypted, &format!("tls://{}:{}", "localhost", broker.port));
            fs::write(&file, text).expect("written");
        }
        Some(broker.run())
    }

    /// As [`start`](Self::start), with a server that asks nobody for a key, so that a test can send anything.
    ///
    /// # Panics
    /// Where a command fails.
    pub fn start_open(test: &str, bench: &'a Bench, machines: &[&str]) -> Option<Self> {
        let broker = Self::prepare(test, bench, machines, &[])?;
        let store = bench.path("shop/jetstream");
        let text = format!("listen: \"127.0.0.1:{}\"\njetstream {{ store_dir: {store:?} }}\n", broker.port);
        fs::write(&broker.config, text).expect("written");
        Some(broker.run())
    }

    fn prepare(test: &str, bench: &'a Bench, machines: &[&str], more: &[&str]) -> Option<Self> {
        let program = nats_server(test)?;
        let port = free_port();
        let listen = format!("127.0.0.1:{port}");
        let folder = bench.path("shop");
        let folder = folder.to_str().expect("a name");
        let mut arguments = vec!["shop", "init", folder, "--listen", &listen, "--submitter", "office"];
        machines.iter().for_each(|machine| arguments.extend(["--machine", machine]));
        arguments.extend(more);
        let made = bench.retrace(&arguments);
        assert_eq!(made.code, Some(0), "{}", made.err);
        // the host is another computer than the office
        let host = bench.path("shop/host.toml");
        let text = fs::read_to_string(&host).expect("a shop file");
        fs::write(&host, format!("root = \"host-root\"\n{text}")).expect("written");
        let config = bench.path("shop/nats-server.conf");
        Some(Self { bench, program, port, config, server: None, agents: Vec::new() })
    }

    fn run(mut self) -> Self {
        self.start_server();
        let host = self.retrace("host", &["host", "--once"]);
        assert_eq!(host.code, Some(0), "{}\n{}", host.out, host.err);
        self
    }

    /// Starts the server, and waits until it answers.
    ///
    /// # Panics
    /// Where it does not within 10 s.
    pub fn start_server(&mut self) {
        let log = fs::File::create(self.bench.path("nats.log")).expect("a log");
        let mut command = Command::new(&self.program);
        command.arg("-c").arg(&self.config).stdin(Stdio::null()).stdout(log.try_clone().expect("a log")).stderr(log);
        self.server = Some(command.spawn().expect("it runs"));
        let until = Instant::now() + Duration::from_secs(10);
        while TcpStream::connect(("127.0.0.1", self.port)).is_err() {
            assert!(Instant::now() < until, "{}", fs::read_to_string(self.bench.path("nats.log")).unwrap_or_default());
            sleep(Duration::from_millis(10));
        }
    }

    /// Kills the server at once.
    pub fn kill_server(&mut self) {
        if let Some(mut server) = self.server.take() {
            let _ = server.kill();
            let _ = server.wait();
        }
    }

    /// Port of the server.
    #[must_use]
    pub fn port(&self) -> u16 {
        self.port
    }

    /// Deletes everything that the killed server has stored.
    ///
    /// # Panics
    /// Where it cannot be deleted.
    pub fn delete_store(&self) {
        fs::remove_dir_all(self.bench.path("shop/jetstream")).expect("deleted");
    }

    /// Runs `retrace shop` at a computer of the shop.
    #[must_use]
    pub fn retrace(&self, computer: &str, arguments: &[&str]) -> CommandOutput {
        let file = self.shop_file(computer);
        self.bench.retrace([&["shop"], arguments, &["--shop-file", &file]].concat())
    }

    /// Standard output of a command that succeeds.
    ///
    /// # Panics
    /// Where it does not.
    #[track_caller]
    pub fn done(&self, computer: &str, arguments: &[&str]) -> String {
        let result = self.retrace(computer, arguments);
        assert_eq!(result.code, Some(0), "{computer} {arguments:?}: {}\n{}", result.out, result.err);
        result.out
    }

    /// Path of a computer's shop file.
    ///
    /// # Panics
    /// Where it is no text.
    #[must_use]
    pub fn shop_file(&self, computer: &str) -> String {
        self.bench.path(&format!("shop/{computer}.toml")).to_str().expect("a name").to_owned()
    }

    /// Starts the agent of a machine, or the host; its output goes to `NAME.log`.
    ///
    /// # Panics
    /// Where it cannot be started.
    pub fn start_agent(&mut self, computer: &str) {
        let action = if computer == "host" { "host" } else { "agent" };
        let log = self.bench.path(&format!("{computer}.log"));
        let log = fs::OpenOptions::new().create(true).append(true).open(log).expect("a log");
        let mut command = Command::new(binary());
        command.args(["shop", "--shop-file", &self.shop_file(computer), action]);
        command.env("XDG_STATE_HOME", self.bench.path("state"));
        command.stdin(Stdio::null()).stdout(log.try_clone().expect("a log")).stderr(log);
        self.agents.push((computer.to_owned(), command.spawn().expect("it runs")));
    }

    /// Kills the agent of a machine, or the host.
    pub fn kill_agent(&mut self, computer: &str) {
        for (name, child) in &mut self.agents {
            if name == computer {
                let _ = child.kill();
                let _ = child.wait();
            }
        }
        self.agents.retain(|(name, _)| name != computer);
    }

    /// Process numbers of the agents that run.
    #[must_use]
    pub fn agents(&self) -> Vec<(String, u32)> {
        self.agents.iter().map(|(name, child)| (name.clone(), child.id())).collect()
    }

    /// What the agent of a machine has printed.
    #[must_use]
    pub fn log(&self, computer: &str) -> String {
        fs::read_to_string(self.bench.path(&format!("{computer}.log"))).unwrap_or_default()
    }

    /// The last message on a subject of a stream, of a server without keys.
    ///
    /// # Panics
    /// Where there is none, or the server does not answer.
    #[must_use]
    pub fn stored_last(&self, stream: &str, subject: &str) -> Vec<u8> {
        let request = format!("{{\"last_by_subj\":\"{subject}\"}}");
        let answer = self.raw().request(&format!("$JS.API.STREAM.MSG.GET.{stream}"), request.as_bytes());
        let answer: serde_json::Value = serde_json::from_slice(&answer).expect("JSON");
        decoded(answer["message"]["data"].as_str().expect("a message"))
    }

    /// A connection without a key that speaks the protocol by hand.
    ///
    /// # Panics
    /// Where the server does not answer.
    #[must_use]
    pub fn raw(&self) -> RawClient {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).expect("it listens");
        stream.write_all(b"CONNECT {\"verbose\":false,\"pedantic\":false}\r\nPING\r\n").expect("sent");
        let mut client = RawClient { stream, requests: 0 };
        client.wait_pong();
        client
    }
}

impl Drop for ShopBroker<'_> {
    fn drop(&mut self) {
        for (_, child) in &mut self.agents {
            let _ = child.kill();
            let _ = child.wait();
        }
        self.kill_server();
    }
}

/// The bytes of a text in base64.
fn decoded(text: &str) -> Vec<u8> {
    const LETTERS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let (mut bytes, mut bits, mut count) = (Vec::new(), 0_u32, 0);
    for value in text.bytes().filter_map(|letter| LETTERS.iter().position(|&known| known == letter)) {
        bits = bits << 6 | value as u32;
        count += 6;
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count) as u8);
        }
    }
    bytes
}

/// A client of the server that sends what it is told.
pub struct RawClient {
    stream: TcpStream,
    requests: u32,
}

impl RawClient {
    /// Publishes a message.
    ///
    /// # Panics
    /// Where the server has closed the connection.
    pub fn publish(&mut self, subject: &str, payload: &[u8]) {
        let head = format!("PUB {subject} {}\r\n", payload.len());
        let message = [head.as_bytes(), payload, b"\r\n"].concat();
        self.stream.write_all(&message).expect("sent");
    }

    /// Waits until the server has taken everything.
    ///
    /// # Panics
    /// Where it does not within 30 s.
    pub fn flush(&mut self) {
        self.stream.write_all(b"PING\r\n").expect("sent");
        self.wait_pong();
    }

    /// Asks for an answer on an own subject, and returns its payload.
    ///
    /// # Panics
    /// Where none comes within 30 s.
    #[must_use]
    pub fn request(&mut self, subject: &str, payload: &[u8]) -> Vec<u8> {
        self.requests += 1;
        let (number, inbox) = (self.requests, format!("_INBOX_raw.{}", self.requests));
        let head = format!("SUB {inbox} {number}\r\nUNSUB {number} 1\r\nPUB {subject} {inbox} {}\r\n", payload.len());
        self.stream.write_all(&[head.as_bytes(), payload, b"\r\n"].concat()).expect("sent");
        let mut reader = BufReader::new(self.stream.try_clone().expect("a stream"));
        loop {
            let mut line = String::new();
            reader.read_line(&mut line).expect("an answer");
            let Some(head) = line.trim_end().strip_prefix("MSG ") else { continue };
            let bytes = head.rsplit(' ').next().and_then(|bytes| bytes.parse().ok()).expect("a length");
            let mut payload = vec![0; bytes];
            reader.read_exact(&mut payload).expect("a payload");
            return payload;
        }
    }

    fn wait_pong(&mut self) {
        self.stream.set_read_timeout(Some(Duration::from_secs(30))).expect("a time");
        let (mut text, mut buffer) = (Vec::new(), [0; 4096]);
        while !text.windows(6).any(|part| part == b"PONG\r\n") {
            let read = self.stream.read(&mut buffer).expect("an answer");
            assert!(read > 0, "closed: {}", String::from_utf8_lossy(&text));
            text.extend_from_slice(&buffer[..read]);
        }
    }
}
