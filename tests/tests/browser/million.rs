//! A program of a million lines on the page: `cargo xtask campaign page`.
//!
//! The figures are printed. What is held against a limit is far above them, because computers differ.

use std::fmt::Write as _;
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, cases};
use retrace_tests::page_client::{Page, PageServer};
use retrace_tests::page_user::{PageUser, Screen};
use serde_json::json;

use super::{Machine, browser};

/// Lines of the program, unless the campaign sets another number.
const LINES: u32 = 20_000;

/// Time over which pictures are counted.
const COUNTED: Duration = Duration::from_secs(10);

/// Number of holds that are measured.
const HOLDS: u32 = 15;

/// Bytes of an upload.
const UPLOADED: usize = 100_000_000;

/// Speed of an upload.
const BYTES_PER_S: f64 = 125e6;

/// Pictures of the path and bytes of its buffers, counted where they are made.
pub(crate) const COUNTERS: &str = r"
window.picturesPass = true;
window.drawn = { pictures: 0, bytes: 0, first: null };
const { viewport, bufferData } = WebGL2RenderingContext.prototype;
WebGL2RenderingContext.prototype.viewport = function (...rest) { drawn.pictures++; return viewport.apply(this, rest); };
const drawArrays = WebGL2RenderingContext.prototype.drawArrays;
WebGL2RenderingContext.prototype.drawArrays = function (...rest) {
  drawn.first ??= performance.now();
  return drawArrays.apply(this, rest);
};
WebGL2RenderingContext.prototype.bufferData = function (target, data, ...rest) {
  drawn.bytes += typeof data === 'number' ? data : (data?.byteLength ?? 0);
  return bufferData.call(this, target, data, ...rest);
};";

/// A spiral of so many short lines.
fn spiral(lines: u32) -> String {
    let mut program = "G21 G90 G17 G94 G64 P0.01\nF3000\n".to_owned();
    for line in 0..lines {
        let turn = f64::from(line) * 0.005;
        let radius = 150.0 * (f64::from(line) / f64::from(lines)).sqrt() + 2.0 * (turn * 7.0).sin();
        let (x, y) = (170.0 + radius * turn.cos(), 170.0 + radius * turn.sin());
        writeln!(program, "G1 X{x:.3} Y{y:.3}").expect("a string");
    }
    program + "M2\n"
}

/// First picture, pictures a second while the machine runs, memory, and from the finger on HOLD to the state line.
#[test]
#[ignore = "a measurement: cargo xtask campaign page"]
fn a_long_program_is_shown_while_it_runs() {
    let Some(mut browser) = browser() else { return };
    let lines = cases(LINES);
    let bench = Bench::new();
    let program = bench.file("long.ngc", spiral(lines)).display().to_string();
    let folder = bench.path("programs");
    std::fs::create_dir(&folder).expect("a folder");
    let [jobs, folder] = [bench.path("jobs"), folder].map(|path| path.display().to_string());
    let arguments = [program, "--journal".into(), jobs, "--programs".into(), folder];
    let started = Instant::now();
    let server = PageServer::start(&arguments.each_ref().map(String::as_str));
    let machine = Machine::new(&server);
    while machine.report()["state"]["program"]["check"] != "ready" {
        assert!(started.elapsed() < Duration::from_secs(600), "{:#}", machine.report());
        std::thread::sleep(Duration::from_millis(100));
    }
    println!("{lines} lines, checked after {:.1} s", started.elapsed().as_secs_f64());
    let mut user = PageUser::new(&mut browser, Screen::TABLET);
    user.page().call("Page.addScriptToEvaluateOnNewDocument", json!({"source": COUNTERS}));
    user.sign_in(&server);
    user.wait("window.drawn?.first > 0");
    let first = user.evaluate("drawn.first").as_f64().unwrap_or(f64::NAN);
    println!("first picture of the path {first:.0} ms after the page was opened");
    user.tap(".motion.start", "");
    user.wait_for_word("RUNNING");
    std::thread::sleep(Duration::from_secs(2));
    let before = user.evaluate("[performance.now(), drawn.pictures]");
    std::thread::sleep(COUNTED);
    let after = user.evaluate("[performance.now(), drawn.pictures]");
    let difference = |place: usize| after[place].as_f64().unwrap_or(0.0) - before[place].as_f64().unwrap_or(0.0);
    let pictures = difference(1) / difference(0) * 1000.0;
    println!("{pictures:.1} pictures a second while it runs");
    user.page().call("HeapProfiler.collectGarbage", json!({}));
    let memory = user.evaluate("[performance.memory.usedJSHeapSize, drawn.bytes]");
    let megabytes = |place: usize| memory[place].as_f64().unwrap_or(f64::NAN) / 1e6;
    println!("script heap {:.1} MB, buffers written {:.1} MB", megabytes(0), megabytes(1));
    let mut holds = Holds { user: &mut user, machine: &machine, socket: server.page(&server.token) };
    let quiet = holds.measure("");
    let uploads = Uploads::begin(&server);
    let loaded = holds.measure(" while 100 MB are uploaded");
    println!("{} uploads of 100 MB in that time", uploads.end());
    let median = quiet.max(loaded);
    assert!(
        pictures > 5.0 && megabytes(0) + megabytes(1) < 300.0 && median < 2000.0,
        "far from the figures of the docs"
    );
}

/// Holds by the finger on the page, and by a message of another page.
struct Holds<'a> {
    user: &'a mut PageUser,
    machine: &'a Machine<'a>,
    socket: Page,
}

impl Holds<'_> {
    /// Measures both, and prints them. Returns the median by the finger, ms.
    fn measure(&mut self, when: &str) -> f64 {
        let mut by_finger: Vec<f64> = (0..HOLDS).map(|_| self.by_finger()).collect();
        let mut by_socket: Vec<f64> = (0..HOLDS).map(|_| self.by_socket()).collect();
        let shown = |what: &str, times: &mut Vec<f64>| {
            times.sort_by(f64::total_cmp);
            let (median, most) = (times[times.len() / 2], times[times.len() - 1]);
            println!("{what}{when}: median {median:.0} ms, at most {most:.0} ms");
            median
        };
        shown("from a hold on the socket to a lower rate in its answer", &mut by_socket);
        shown("from the finger on HOLD to its picture", &mut by_finger)
    }

    fn run(&mut self) {
        self.machine.wait_for_rest();
        self.user.tap(".motion.start", "");
        self.user.wait_for_word("RUNNING");
        self.machine.wait("motion", |report| report["live"]["rate"] == 1.0);
    }

    fn by_finger(&mut self) -> f64 {
        self.user.evaluate(
            "window.held = new Promise(resolve => {
               let down = null;
               const press = event => { down = event.timeStamp; };
               document.addEventListener('pointerdown', press, { capture: true, once: true });
               new MutationObserver((_, observer) => {
                 const word = document.getElementById('state-word').textContent;
                 if (down === null || !['STOPPING', 'FEED HOLD'].includes(word)) return;
                 observer.disconnect();
                 requestAnimationFrame(() => setTimeout(() => resolve(performance.now() - down)));
               }).observe(document.getElementById('state-word'),
                 { subtree: true, childList: true, characterData: true });
             }); 0",
        );
        self.user.tap(".motion.hold", "");
        let held = self.user.evaluate("held").as_f64().unwrap_or(f64::NAN);
        self.user.wait_for_word("FEED HOLD");
        self.run();
        held
    }

    /// The answer is sent at a tick of the server, so that this is more than the machine takes.
    fn by_socket(&mut self) -> f64 {
        self.socket.listen(Duration::from_millis(300));
        self.socket.wait_until("motion", |page| page.live("rate") == 1.0);
        let sent = Instant::now();
        self.socket.send(&json!({"t": "hold"}));
        self.socket.wait_until("a lower rate", |page| page.live("rate") < 1.0);
        let held = sent.elapsed().as_secs_f64() * 1e3;
        self.user.wait_for_word("FEED HOLD");
        self.run();
        held
    }
}

/// Uploads of 100 MB, one after the other, as fast as a network of 1 Gbit/s, in a thread of its own.
struct Uploads {
    ends: Arc<AtomicBool>,
    thread: JoinHandle<u32>,
}

impl Uploads {
    fn begin(server: &PageServer) -> Self {
        let ends = Arc::new(AtomicBool::new(false));
        let (host, told) = (server.host.clone(), Arc::clone(&ends));
        let cookie = server.sign_in(&server.token).expect("the token is right");
        let thread = std::thread::spawn(move || {
            let block = vec![b'\n'; 1 << 16];
            let mut count = 0;
            while !told.load(Ordering::Relaxed) {
                let head = format!(
                    "PUT /api/v1/programs/large.ngc HTTP/1.1\r\nHost: {host}\r\nCookie: {cookie}\r\n\
                     Content-Length: {UPLOADED}\r\nConnection: close\r\n\r\n"
                );
                let mut stream = TcpStream::connect(&host).expect("it listens");
                stream.write_all(head.as_bytes()).expect("sent");
                let (begun, mut left) = (Instant::now(), UPLOADED);
                while left > 0 && !told.load(Ordering::Relaxed) {
                    let part = left.min(block.len());
                    stream.write_all(&block[..part]).expect("it is received");
                    left -= part;
                    let due = Duration::from_secs_f64((UPLOADED - left) as f64 / BYTES_PER_S);
                    std::thread::sleep(due.saturating_sub(begun.elapsed()));
                }
                if left == 0 {
                    let mut answer = String::new();
                    stream.read_to_string(&mut answer).expect("an answer");
                    assert!(answer.starts_with("HTTP/1.1 201"), "{answer}");
                    count += 1;
                }
            }
            count
        });
        Self { ends, thread }
    }

    /// Ends them. Returns how many were stored whole.
    fn end(self) -> u32 {
        self.ends.store(true, Ordering::Relaxed);
        self.thread.join().expect("the uploads")
    }
}
