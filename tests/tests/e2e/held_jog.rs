//! Jogs by a key of the terminal that is held: they go on while it repeats itself, and no longer.
//!
//! Invariant: a busy computer may end a jog early here, and never late.

use std::thread::sleep;
use std::time::{Duration, Instant};

use retrace_tests::command::Bench;
use retrace_tests::terminal::Terminal;

/// An arrow key, as every terminal sends it.
const PRESS: &str = "\x1b[C";
/// Its repeat, and its release, as kitty's keyboard protocol reports them.
const REPEAT: &str = "\x1b[1;1:2C";
const RELEASE: &str = "\x1b[1;1:3C";
/// The end of the travel.
const END_MM: f64 = 500.0;

fn held(bench: &Bench) -> Terminal {
    let program = bench.file("program.ngc", "G21 G90 G94\nF3000\nG1 X30\nM2\n").display().to_string();
    let axis = |name: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = 1000\nmax_velocity_mm_per_s = 100\n\
             max_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [0, {END_MM}]\n"
        )
    };
    let machine = format!("homed = true\n{}{}", axis("x"), axis("y"));
    let machine = bench.file("m.toml", machine).display().to_string();
    let terminal = Terminal::running(&["run", &program, "--machine", &machine, "--realtime", "--tui"], 80, 24);
    terminal.wait_for_text("READY");
    terminal.keys("tt");
    terminal.wait_for_text("jog held: 3000 mm/min · a tap 1 mm");
    terminal
}

/// Machine position of X, mm.
fn x_mm(terminal: &Terminal) -> f64 {
    let text = terminal.text();
    let row = text.lines().find_map(|line| line.split_once("│ X").or_else(|| line.split_once("│>X")));
    row.and_then(|(_, row)| row.split_whitespace().next()?.parse().ok()).unwrap_or_else(|| panic!("no X in\n{text}"))
}

/// Position at which the axis comes to rest: the same for a second.
fn rests_at(terminal: &Terminal) -> f64 {
    let mut since = (x_mm(terminal), Instant::now());
    while since.1.elapsed() < Duration::from_secs(1) {
        sleep(Duration::from_millis(50));
        let x = x_mm(terminal);
        if x != since.0 {
            since = (x, Instant::now());
        }
    }
    since.0
}

/// Repeats a key until the axis has gone this far.
fn hold_until(terminal: &Terminal, key: &str, mm: f64) {
    let begun = Instant::now();
    while x_mm(terminal) < mm {
        assert!(begun.elapsed() < Duration::from_secs(60), "{}", terminal.text());
        terminal.keys(key);
        sleep(Duration::from_millis(40));
    }
}

#[test]
fn a_tap_is_a_step_and_a_held_key_moves_until_it_is_let_go() {
    let bench = Bench::new();
    let mut terminal = held(&bench);
    terminal.keys(PRESS);
    terminal.wait_until("a step", |_| x_mm(&terminal) == 1.0);
    assert_eq!(rests_at(&terminal), 1.0, "a tap goes on no longer");
    hold_until(&terminal, PRESS, 30.0);
    let stopped = rests_at(&terminal);
    assert!((30.0..END_MM / 2.0).contains(&stopped), "{stopped}");
    terminal.wait_for_text("READY");
    terminal.keys("q");
    assert_eq!(terminal.wait_for_end(), Some(4));
}

/// The release ends it, and what is still under way behind the release begins nothing.
#[test]
fn a_release_that_the_terminal_reports_ends_the_jog() {
    let bench = Bench::new();
    let mut terminal = held(&bench);
    assert!(terminal.transcript().contains("\x1b[>3u"), "it asks for releases");
    terminal.keys(PRESS);
    hold_until(&terminal, REPEAT, 30.0);
    terminal.keys(RELEASE);
    for _ in 0..50 {
        terminal.keys(REPEAT);
        sleep(Duration::from_millis(40));
    }
    let stopped = x_mm(&terminal);
    assert!((30.0..END_MM / 2.0).contains(&stopped), "{stopped}");
    assert_eq!(rests_at(&terminal), stopped);
    let shown = terminal.wait_for_text("mm while its key was held");
    assert!(!shown.contains("feed hold") && !shown.contains("stopped early"), "{shown}");
    terminal.keys("q");
    assert_eq!(terminal.wait_for_end(), Some(4));
    assert!(terminal.transcript().contains("\x1b[<1u"), "the terminal is as it was");
}

/// Space stops it, and the key that is still held does not begin it again. A terminal that is lost stops it, too.
#[test]
fn a_held_jog_is_stopped_by_space_and_with_its_terminal() {
    let bench = Bench::new();
    let mut terminal = held(&bench);
    terminal.keys(PRESS);
    hold_until(&terminal, REPEAT, 30.0);
    terminal.keys(" ");
    for _ in 0..50 {
        terminal.keys(REPEAT);
        sleep(Duration::from_millis(40));
    }
    let stopped = x_mm(&terminal);
    assert!((30.0..END_MM / 2.0).contains(&stopped), "{stopped}");
    assert_eq!(rests_at(&terminal), stopped);
    terminal.keys(RELEASE);
    terminal.keys(PRESS);
    hold_until(&terminal, REPEAT, stopped + 30.0);
    terminal.hang_up();
    assert_eq!(terminal.wait_for_end(), Some(4));
}
