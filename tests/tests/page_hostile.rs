//! Hostile requests to the page's server: pages from elsewhere, rebound names, wrong and missing secrets, replayed and
//! outdated orders, names that lead out of their folder, bytes that are no request. None of them changes anything, the
//! memory of the server is bounded, and the page in control works all the while.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use retrace_tests::command::{Bench, cases};
use retrace_tests::page_client::{Page, PageServer};
use retrace_tests::sender::TestRandom;
use serde_json::{Value, json};

/// Requests that the suite sends.
const SUITE: u32 = 200;

/// Largest growth of the server's memory over all requests, KiB.
const MAX_GROWTH_KIB: u64 = 64 << 10;

/// Orders that would move the machine, switch something or load something.
const ORDERS: [&str; 10] = [
    "cycle start",
    "mdi G0 X50",
    "jog x 10",
    "output 3 on",
    "home",
    "zero",
    "dry run on",
    "optional stop on",
    "open other.ngc",
    "start line 3",
];

/// Names that lead out of the folder, or are none.
const NAMES: [&str; 8] =
    ["..%2F..%2Fx.ngc", "%2e%2e%2fx", ".hidden", "a%2Fb.ngc", "a%5Cb.ngc", "%00", "c%3Ax.ngc", "%20"];

fn first_seed() -> u64 {
    std::env::var("RETRACE_FIRST_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(1)
}

/// What must not change.
fn kept(server: &PageServer, cookie: &str) -> Value {
    let state = server.request("GET", "/api/v1/state", &[("Cookie", cookie)], b"").json();
    let programs = server.request("GET", "/api/v1/programs", &[("Cookie", cookie)], b"").json();
    let part = |name: &str| state["state"][name].clone();
    json!({
        "stage": part("stage"),
        "program": state["state"]["program"]["name"],
        "outputs": part("outputs"),
        "dry_run": part("dry_run"),
        "optional_stop": part("optional_stop"),
        "position": state["live"]["mm"],
        "work": state["live"]["work"],
        "programs": programs["programs"],
    })
}

/// Memory of a process, KiB.
fn resident_kib(process: u32) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.split_whitespace().next()?.parse().ok()
}

/// The attacker: he knows the address, and a page for watching.
struct Attacker<'s> {
    server: &'s PageServer,
    watch_cookie: String,
    random: TestRandom,
}

impl Attacker<'_> {
    fn below(&mut self, bound: usize) -> usize {
        self.random.below(bound)
    }

    fn choice<'c>(&mut self, of: &[&'c str]) -> &'c str {
        of[self.below(of.len())]
    }

    fn text(&mut self, length: usize) -> String {
        (0..length).map(|_| char::from(b' ' + self.random.below(95) as u8)).collect()
    }

    /// A header that is not the page's own.
    fn foreign(&mut self) -> (&'static str, String) {
        match self.below(5) {
            0 => ("Host", format!("attacker{}.example", self.below(1000))),
            1 => ("Host", format!("127.0.0.1.attacker.example:{}", self.port())),
            2 => ("Origin", format!("https://attacker{}.example", self.below(1000))),
            3 => ("Sec-Fetch-Site", "cross-site".into()),
            _ => {
                let secret = self.below(usize::MAX);
                ("Cookie", format!("retrace-{}={secret:032x}", self.port()))
            }
        }
    }

    fn port(&self) -> &str {
        self.server.host.rsplit(':').next().unwrap_or_default()
    }

    /// One plain request: foreign, with the rights of a watcher, or both.
    fn plain(&mut self) {
        let path = match self.below(4) {
            0 => "/api/v1/session".to_owned(),
            1 => format!("/api/v1/programs/{}", self.choice(&NAMES)),
            2 => self
                .choice(&["/api/files/local", "/api/v1/ws", "/api/v1/jobs/..%2F..%2Fx", "/page/..%2fCargo.toml"])
                .into(),
            _ => format!("/api/v1/{}", self.text(10).replace([' ', '#', '?', '"'], "x")),
        };
        let method = self.choice(&["GET", "PUT", "POST", "DELETE", "PATCH", "OPTIONS"]);
        let (name, value) = self.foreign();
        let is_watcher = self.below(2) == 0 && name != "Cookie";
        let mut headers = vec![(name, value)];
        if is_watcher {
            headers.push(("Cookie", self.watch_cookie.clone()));
        }
        let body = self.text(200);
        let headers: Vec<(&str, &str)> = headers.iter().map(|(name, value)| (*name, value.as_str())).collect();
        let status = self.server.request(method, &path, &headers, body.as_bytes()).status;
        assert!(!(200..300).contains(&status), "{method} {path} {headers:?}: {status}");
    }

    /// Bytes that are no request, or a part of one.
    fn bytes(&mut self) {
        let Ok(mut stream) = TcpStream::connect(&self.server.host) else { return };
        let _ = stream.set_read_timeout(Some(Duration::from_millis(20)));
        let length = self.below(5_000);
        let text = match self.below(3) {
            0 => self.text(length),
            1 => format!("GET /{} HTTP/1.1\r\nHost: {}\r\nX: {}", self.text(30), self.server.host, self.text(length)),
            _ => format!(
                "POST /api/v1/session HTTP/1.1\r\nHost: {}\r\nContent-Length: 99999999999\r\n\r\n",
                self.server.host
            ),
        };
        let _ = stream.write_all(text.as_bytes());
        let _ = stream.read(&mut [0; 256]);
    }

    /// Messages of a page that may watch only, with turns and states that were seen elsewhere.
    fn messages(&mut self, page: &mut Page, turn: &Value, seen: &Value) {
        let (words, number) = (self.choice(&ORDERS), self.below(5) as u32);
        let message = match self.below(8) {
            0 => json!({"t": "do", "id": 1, "turn": turn, "seen": seen, "words": words}),
            1 => json!({"t": "do", "id": 1, "turn": number, "seen": number, "words": words}),
            2 => json!({"t": "jog", "id": 1, "turn": turn, "seen": seen, "axis": "x", "up": true, "beat": number}),
            3 => json!({"t": "wheel", "turn": turn, "counts": -5}),
            4 => json!({"t": "control", "do": self.choice(&["take", "give", "keep", "release"])}),
            5 => json!({"t": "want", "path": number, "level": number, "firsts": vec![number; 1_000]}),
            6 => json!({"t": "where", "id": 1, "path": number, "record": u32::MAX, "line": null}),
            _ => json!({"t": "name", "name": "<img src=x onerror=alert(1)>"}),
        };
        let length = self.below(70_000);
        match self.below(10) {
            0 => page.send_text(&self.text(length)),
            1 => page.send_text(&message.to_string().replace('}', ",\"more\":1}")),
            _ => page.send(&message),
        }
        let _ = page.receive();
    }
}

#[test]
fn hostile_requests_change_nothing() {
    let bench = Bench::new();
    let programs = bench.path("programs");
    std::fs::create_dir(&programs).expect("a folder");
    std::fs::write(programs.join("other.ngc"), "G21 G90 G94\nF600\nG1 X3\nM2\n").expect("a file");
    let program = bench.file("program.ngc", "G21 G90 G94 G61\nF600\nG1 X60\nM2\n").display().to_string();
    let server = PageServer::start(&[&program, "--programs", &programs.display().to_string(), "--upload-key"]);
    let cookie = server.sign_in(&server.token).expect("the token is right");
    let watch_cookie = server.sign_in(&server.watch_token).expect("the token is right");
    let mut operator = server.page(&server.token);
    operator.take_control();
    operator.wait_for_word("READY");
    let (turn, seen) = (operator.last("control")["turn"].clone(), operator.last("state")["n"].clone());
    let before = kept(&server, &cookie);
    let memory = resident_kib(server.process());
    let mut attacker = Attacker { server: &server, watch_cookie, random: TestRandom::new(first_seed()) };
    let mut watcher = server.page(&server.watch_token);
    for number in 0..cases(SUITE) {
        match attacker.below(3) {
            0 => attacker.plain(),
            1 => attacker.bytes(),
            _ => attacker.messages(&mut watcher, &turn, &seen),
        }
        // A message that is too long ends its link.
        if watcher.receive().is_err() {
            watcher = server.page_with(&[("Cookie", &attacker.watch_cookie)]).expect("it may watch");
        }
        if number % 50 == 0 {
            operator.listen(Duration::from_millis(5));
        }
    }
    assert_eq!(kept(&server, &cookie), before);
    if let (Some(before), Some(after)) = (memory, resident_kib(server.process())) {
        println!("memory of the command: {before} KiB before, {after} KiB after {} requests", cases(SUITE));
        assert!(after < before + MAX_GROWTH_KIB, "{before} KiB, then {after} KiB");
    }
    operator.listen(Duration::from_millis(300));
    assert_eq!(operator.order("jog x 1")["t"], "done", "the page in control works");
    operator.wait_until("1 mm", |page| page.machine_mm(0) == 1.0);
}
