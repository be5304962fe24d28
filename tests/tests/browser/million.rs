//! A program of a million lines on the page: `cargo xtask campaign page`.
//!
//! The figures are printed. What is held against a limit is far above them, because computers differ.

use std::fmt::Write as _;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, cases};
use retrace_tests::page_client::PageServer;
use retrace_tests::page_user::{PageUser, Screen};
use serde_json::json;

use super::{Machine, browser};

/// Lines of the program, unless the campaign sets another number.
const LINES: u32 = 20_000;

/// Time over which pictures are counted.
const COUNTED: Duration = Duration::from_secs(10);

/// Pictures of the path and bytes of its buffers, counted where they are made.
const COUNTERS: &str = r"
window.drawn = { pictures: 0, bytes: 0, first: null };
const { clear, bufferData } = WebGL2RenderingContext.prototype;
WebGL2RenderingContext.prototype.clear = function (...rest) { drawn.pictures++; return clear.apply(this, rest); };
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
    let started = Instant::now();
    let server = PageServer::start(&[&program, "--journal", &bench.path("jobs").display().to_string()]);
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
    let mut delays = Vec::new();
    for _ in 0..15 {
        user.wait_for_word("RUNNING");
        std::thread::sleep(Duration::from_millis(500));
        user.evaluate(
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
        user.tap(".motion.hold", "");
        delays.push(user.evaluate("held").as_f64().unwrap_or(f64::NAN));
        user.wait_for_word("FEED HOLD");
        machine.wait_for_rest();
        user.tap(".motion.start", "");
    }
    delays.sort_by(f64::total_cmp);
    let (median, most) = (delays[delays.len() / 2], delays[delays.len() - 1]);
    println!("from the finger on HOLD to its picture: median {median:.0} ms, at most {most:.0} ms");
    assert!(
        pictures > 5.0 && megabytes(0) + megabytes(1) < 300.0 && median < 2000.0,
        "far from the figures of the docs"
    );
}
