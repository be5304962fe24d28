//! `retrace shop sparkplug` over mosquitto, judged by a host application of others: srad, in `tests/sparkplug-host`
//! (SHP-28). `cargo xtask campaign sparkplug-host` builds it; without it these tests are NOT RUN.
//!
//! The number of cases is that of the sessions.

use std::collections::{BTreeSet, HashMap};
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, cases};
use retrace_tests::mqtt_client::Mosquitto;
use retrace_tests::not_run::not_run;
use retrace_tests::served::ServedCard;
use retrace_tests::sparkplug_node::SparkplugNode;

/// Names the host application.
const HOST: &str = "RETRACE_SPARKPLUG_HOST";
/// Longest wait for anything.
const LONG: Duration = Duration::from_secs(30);
/// Lines of the host that a failure shows.
const SHOWN: usize = 30;
/// Sessions from which on the first of them lasts until its sequence numbers begin again.
const SESSIONS_OF_A_LONG_RUN: u32 = 100;

/// What the host application has seen so far, each line of it checked.
struct Host {
    child: Child,
    lines: Receiver<String>,
    transcript: Vec<String>,
    /// Values by the state that srad keeps.
    values: HashMap<String, String>,
    /// Values that `state` has had.
    states: BTreeSet<String>,
    /// Whether srad holds its state for current.
    is_current: bool,
    /// Number of the session that lives, and its next sequence number.
    session: Option<(u64, u64)>,
    births: usize,
    data: usize,
    deaths: usize,
    /// Births that srad has requested by itself.
    requests: usize,
    is_online: bool,
}

impl Host {
    fn start(program: &str, port: u16) -> Self {
        let mut command = Command::new(program);
        command.args([&port.to_string(), "shop", "mill"]).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().expect("the host application runs");
        let (sender, lines) = channel();
        let output = BufReader::new(child.stdout.take().expect("a pipe"));
        std::thread::spawn(move || output.lines().map_while(Result::ok).try_for_each(|line| sender.send(line)));
        let mut host = Self {
            child,
            lines,
            transcript: Vec::new(),
            values: HashMap::new(),
            states: BTreeSet::new(),
            is_current: false,
            session: None,
            births: 0,
            data: 0,
            deaths: 0,
            requests: 0,
            is_online: false,
        };
        host.wait("the host is online", |host| host.is_online);
        host
    }

    /// Takes lines until this is so.
    #[track_caller]
    fn wait(&mut self, what: &str, is_so: impl Fn(&Self) -> bool) {
        let until = Instant::now() + LONG;
        while !is_so(self) {
            match self.lines.recv_timeout(until.saturating_duration_since(Instant::now())) {
                Ok(line) => self.take(line),
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => self.fail(what),
            }
        }
    }

    /// Takes the lines of so much time.
    fn take_for(&mut self, time: Duration) {
        let until = Instant::now() + time;
        while let Ok(line) = self.lines.recv_timeout(until.saturating_duration_since(Instant::now())) {
            self.take(line);
        }
    }

    #[track_caller]
    fn fail(&self, what: &str) -> ! {
        let shown = &self.transcript[self.transcript.len().saturating_sub(SHOWN)..];
        panic!("{what}: {:?}, srad has printed\n{}", self.session, shown.join("\n"));
    }

    fn take(&mut self, line: String) {
        let words: Vec<String> = line.splitn(3, ' ').map(str::to_owned).collect();
        self.transcript.push(line);
        let [kind, name, rest] = [0, 1, 2].map(|word| words.get(word).map_or("", String::as_str));
        match (kind, name) {
            ("online", _) => self.is_online = true,
            ("message", "birth") => self.take_birth(rest),
            ("message", "data") => self.take_data(rest),
            ("message", "death") => self.take_death(rest),
            ("state", "birth") => self.is_current = true,
            ("state", "data") if self.is_current => {}
            ("state", "stale") => self.is_current = false,
            ("value", _) if rest.ends_with(" historical") => {}
            ("value", _) => {
                if name == "state" {
                    self.states.insert(rest.into());
                }
                self.values.insert(name.into(), rest.into());
            }
            ("request", _) => self.requests += 1,
            _ => self.fail("it is not in order"),
        }
    }

    /// A birth is one on request, of the same session, or the first of the next one.
    fn take_birth(&mut self, numbers: &str) {
        let Some((bd_seq, "0")) = numbers.split_once(' ') else { self.fail("no birth of the specification") };
        let bd_seq: u64 = bd_seq.parse().expect("a number");
        if self.session.is_some_and(|(of, _)| of != bd_seq) {
            self.fail("a birth of another session before its death");
        }
        self.births += 1;
        self.session = Some((bd_seq, 1));
    }

    fn take_data(&mut self, number: &str) {
        match self.session {
            Some((bd_seq, next)) if number == next.to_string() => self.session = Some((bd_seq, (next + 1) % 256)),
            // It joined later than the node.
            None if self.births == 0 => {}
            _ => self.fail("data that is not the next"),
        }
        self.data += 1;
    }

    fn take_death(&mut self, bd_seq: &str) {
        if self.session.take().is_none_or(|(of, _)| of.to_string() != bd_seq) {
            self.fail("a death that is none of the session");
        }
        self.deaths += 1;
    }

    fn request_birth(&mut self) {
        writeln!(self.child.stdin.as_mut().expect("a pipe"), "rebirth").expect("it reads");
    }

    /// Waits for the death, and for srad to hold all values for old.
    fn wait_death(&mut self, deaths: usize) {
        self.wait("the death", |host| host.deaths == deaths && !host.is_current);
        assert_eq!(self.session, None);
    }

    fn wait_born(&mut self, bd_seq: u64) {
        let number = bd_seq.to_string();
        self.wait(&format!("birth with bdSeq {bd_seq}"), |host| {
            let is_known = host.is_current && host.values.get("bdSeq") == Some(&number);
            is_known && host.session.is_some_and(|(of, _)| of == bd_seq)
        });
    }

    /// Waits for so many messages of data of a run that moves.
    fn wait_data(&mut self, more: usize, run: &mut SteadyRun<'_>) {
        let (wanted, mut last) = (self.data + more, Instant::now());
        while self.data < wanted {
            run.keep();
            let before = self.data;
            self.take_for(Duration::from_millis(100));
            if self.data > before {
                last = Instant::now();
            } else if last.elapsed() > LONG {
                self.fail(&format!("no data; the run says: {}", run.last_line()));
            }
        }
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The host application and the broker, where they are here.
fn peers(bench: &Bench, test: &str) -> Option<(String, Mosquitto, String)> {
    let test = format!("sparkplug_host::{test}");
    let Some(program) = std::env::var_os(HOST) else {
        not_run(&test, &format!("{HOST} names no host application"));
        return None;
    };
    let Some(broker) = Mosquitto::start(&bench.path(""), "") else {
        not_run(&test, "mosquitto is not installed");
        return None;
    };
    let address = format!("mqtt://{}:{}", "127.0.0.1", broker.port);
    Some((program.into_string().expect("a name"), broker, address))
}

/// A run that moves for as long as the test lasts. Where the computer keeps it from running for longer than the card's
/// watchdog allows, another one begins.
struct SteadyRun<'a> {
    bench: &'a Bench,
    card: ServedCard,
    run: Child,
}

impl<'a> SteadyRun<'a> {
    fn start(bench: &'a Bench) -> Self {
        bench.file("part.ngc", "G21 G90 F1200\nO1 repeat [100000]\nG1 X40\nG1 X0\nO1 endrepeat\nM2\n");
        bench.file("m.toml", "[card]\nwatchdog_ms = 2000\n");
        let card = ServedCard::with(&[]);
        let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--no-journal", "--json"];
        let run = bench.start(&run, Stdio::null(), "told.txt");
        Self { bench, card, run }
    }

    fn keep(&mut self) {
        if self.run.try_wait().expect("a child").is_some() {
            println!("another run begins: {}", self.last_line());
            *self = Self::start(self.bench);
        }
    }

    fn last_line(&self) -> String {
        let told = std::fs::read_to_string(self.bench.path("told.txt")).unwrap_or_default();
        told.lines().last().unwrap_or_default().chars().take(300).collect()
    }

    fn end(mut self) {
        let _ = self.run.kill();
        let _ = self.run.wait();
        let _ = self.card.end();
    }
}

/// Sessions over a run that moves, each ended with `kill -9`: the death comes by the will and has the number of the
/// birth, the next birth has the next one, all data is in sequence, also behind a birth on request, srad holds the
/// values for old from each death to the next birth, and has never to request a birth itself.
#[test]
fn srad_sees_every_session_in_order() {
    let bench = Bench::new();
    let Some((program, broker, address)) = peers(&bench, "srad_sees_every_session_in_order") else { return };
    let mut run = SteadyRun::start(&bench);
    let mut host = Host::start(&program, broker.port);
    let sessions = cases(3);
    for session in 0..sessions {
        let number = u64::from(session % 256);
        let mut node = SparkplugNode::start(&bench, &address, "primary_host = \"srad\"\n");
        host.wait_born(number);
        let is_long = session == 0 && sessions >= SESSIONS_OF_A_LONG_RUN;
        host.wait_data(if is_long { 300 } else { 1 }, &mut run);
        if session % 3 == 0 {
            let births = host.births + 1;
            host.request_birth();
            host.wait("the birth on request", |host| host.births == births);
            assert!(host.session.is_some_and(|(bd_seq, _)| bd_seq == number));
            host.wait_data(1, &mut run);
        }
        let deaths = host.deaths + 1;
        match session % 7 {
            6 => assert!(node.end().success()),
            _ => node.kill(),
        }
        host.wait_death(deaths);
    }
    host.take_for(Duration::from_millis(500));
    let requested = sessions.div_ceil(3) as usize;
    assert_eq!((host.deaths, host.births), (sessions as usize, sessions as usize + requested));
    assert_eq!(host.requests, 0, "srad has requested a birth");
    assert!(host.states.contains("ACTIVE"), "{:?}", host.states);
    println!("{sessions} sessions, {} births, {} messages of data", host.births, host.data);
    run.end();
}

/// A host that comes later than the node requests a birth by itself, and has all values then.
#[test]
fn srad_requests_a_birth_where_it_comes_later() {
    let bench = Bench::new();
    let Some((program, broker, address)) = peers(&bench, "srad_requests_a_birth_where_it_comes_later") else { return };
    let mut run = SteadyRun::start(&bench);
    let mut node = SparkplugNode::start(&bench, &address, "");
    SparkplugNode::wait_for(&bench, "bdSeq 0)");
    for late in 1..=3 {
        let mut host = Host::start(&program, broker.port);
        host.wait_born(0);
        assert!(host.requests > 0, "srad has requested it");
        host.wait_data(2, &mut run);
        assert_eq!((host.values["state"].as_str(), host.values["mode"].as_str()), ("ACTIVE", "run"), "host {late}");
    }
    assert!(node.end().success());
    run.end();
}
