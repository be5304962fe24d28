//! The screen, as a person uses it: keys in, cells out, through a pseudo-terminal, with a real job behind it.
//!
//! The card's own counts are read at the end: they are those of a run without a screen.

use std::time::{Duration, Instant};

use retrace_tests::command::Bench;
use retrace_tests::served::ServedCard;
use retrace_tests::terminal::Terminal;

const BRACKET: &str = "examples/02-back-up.ngc";
/// End position of the bracket.
const BRACKET_COUNTS: &str = "X -10000  Y 0  Z 0";
const LEFT: &str = "\x1b[D";
const RIGHT: &str = "\x1b[C";
const WHEEL_DOWN: &str = "\x1b[<65;10;10M";

/// Long lines with the jet on between two of them; line 4 switches it on, line 7 off.
const LINES: &str = "G21 G90 G17 G94 G61\nF3000\nG1 X60\nM62 P0\nG1 Y60\nG1 X0\nM63 P0\nG1 Y0\nM2\n";

/// A machine with a jet on output 0, and a clamp.
const JET: &str = "[[cutter]]\nname = \"jet\"\nkind = \"jet\"\nfire = 0\n[[output]]\nnumber = 5\nname = \"clamp\"\n";

fn at(columns: u16, rows: u16, program: &str, more: &[&str]) -> Terminal {
    let arguments = [&["run", program, "--tui"], more].concat();
    Terminal::running(&arguments, columns, rows)
}

/// A terminal on which a program of this text is ready.
fn ready(bench: &Bench, text: &str) -> Terminal {
    let program = bench.file("program.ngc", text);
    let terminal = at(80, 24, &program.display().to_string(), &[]);
    terminal.wait_for_text("READY");
    terminal
}

/// Number of mm before `mm back`.
fn back_mm(text: &str) -> f64 {
    let before = text.split(" mm back").next().unwrap_or_default();
    before.rsplit(|c: char| !c.is_ascii_digit() && c != '.').next().and_then(|w| w.parse().ok()).unwrap_or(0.0)
}

/// The active block: the number behind `>`.
fn active(text: &str) -> u32 {
    let line = text.lines().find_map(|line| line.split("│>").nth(1).or_else(|| line.strip_prefix("│>")));
    line.and_then(|line| line.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}

fn until_block(terminal: &Terminal, line: u32) -> String {
    terminal.wait_until(&format!("block {line}"), |text| active(text) >= line)
}

/// Waits until the job has ended with this outcome, and quits; returns the text of the terminal's main screen.
fn ends(terminal: &mut Terminal, outcome: &str, code: i32) -> String {
    let end = terminal.wait_for_text("ENDED");
    assert!(end.contains(outcome), "{end}");
    terminal.keys("q");
    assert_eq!(terminal.wait_for_end(), Some(code));
    terminal.wait_until("the terminal as it was", |_| !terminal.is_full_screen());
    terminal.wait_for_text("limit violations 0")
}

/// Turns the wheel until the machine has gone back by this distance.
fn turn_back(terminal: &Terminal, key: &str, mm: f64) {
    let begun = Instant::now();
    while back_mm(&terminal.text()) < mm {
        assert!(begun.elapsed() < Duration::from_secs(60), "{}", terminal.text());
        terminal.keys(key);
        std::thread::sleep(Duration::from_millis(30));
    }
}

fn run_hold_back_up_and_finish(columns: u16, rows: u16, resized: Option<(u16, u16)>) {
    let mut terminal = at(columns, rows, BRACKET, &[]);
    let ready = terminal.wait_for_text("of motion");
    assert!(ready.contains("READY") && terminal.is_full_screen() && terminal.is_coloured(), "{ready}");
    terminal.keys("c");
    terminal.wait_for_text("RUNNING");
    until_block(&terminal, 10);
    terminal.keys(" ");
    let held = terminal.wait_for_text("FEED HOLD");
    assert!(held.contains("c cycle start · r reverse · w handwheel") && held.contains("left"), "{held}");
    if let Some((columns, rows)) = resized {
        terminal.resize(columns, rows);
        terminal.wait_until("a screen of that size", |text| {
            text.lines().nth(usize::from(rows) - 1).is_some_and(|line| line.contains("? all keys"))
        });
    }
    terminal.keys("w");
    terminal.wait_for_text("HANDWHEEL");
    turn_back(&terminal, LEFT, 20.0);
    terminal.keys(RIGHT);
    terminal.keys("l");
    terminal.wait_for_text("RUNNING");
    let end = ends(&mut terminal, "completed", 0);
    assert!(end.contains(BRACKET_COUNTS), "{end}");
}

#[test]
fn a_job_is_run_held_backed_up_by_the_wheel_and_finished_at_80_by_24() {
    run_hold_back_up_and_finish(80, 24, None);
}

#[test]
fn and_at_200_by_60() {
    run_hold_back_up_and_finish(200, 60, None);
}

#[test]
fn and_on_a_terminal_that_changes_its_size() {
    run_hold_back_up_and_finish(80, 24, Some((200, 60)));
}

#[test]
fn it_says_what_it_needs_where_it_has_no_room() {
    let terminal = at(80, 24, BRACKET, &[]);
    terminal.wait_for_text("READY");
    terminal.resize(60, 10);
    terminal.wait_for_text("needs 80 x 24");
    terminal.resize(80, 24);
    terminal.wait_for_text("? all keys");
}

#[test]
fn without_colour_nothing_is_coloured_and_everything_is_said() {
    for (variable, value) in [("NO_COLOR", "1"), ("TERM", "vt220")] {
        let terminal = Terminal::with(&["run", BRACKET, "--tui"], 80, 24, &[(variable, value)]);
        terminal.wait_for_text("READY");
        terminal.keys("c");
        terminal.wait_for_text("RUNNING");
        terminal.keys("r");
        terminal.wait_for_text("REVERSE");
        assert!(!terminal.is_coloured(), "{variable}={value}");
    }
}

#[test]
fn reverse_forward_override_and_the_mouse_wheel() {
    let mut terminal = at(80, 24, BRACKET, &[]);
    terminal.wait_for_text("READY");
    terminal.keys("c");
    until_block(&terminal, 8);
    terminal.keys("---");
    terminal.wait_for_text("override 70 %");
    terminal.keys("r");
    terminal.wait_for_text("REVERSE");
    terminal.wait_until("some mm back", |text| back_mm(text) > 5.0);
    terminal.keys("f");
    terminal.wait_for_text("FORWARD");
    // Behind the furthest place the program resumes (REV-7).
    terminal.wait_for_text("RUNNING");
    // Only in handwheel mode the mouse wheel moves the machine.
    terminal.keys(WHEEL_DOWN);
    terminal.keys("w");
    let stands = terminal.wait_for_text("HANDWHEEL");
    assert_eq!(back_mm(&stands), 0.0, "{stands}");
    turn_back(&terminal, WHEEL_DOWN, 20.0);
    terminal.keys("0l");
    terminal.wait_for_text("RUNNING");
    let end = ends(&mut terminal, "completed", 0);
    assert!(end.contains(BRACKET_COUNTS), "{end}");
}

#[test]
fn back_by_so_many_mm_to_the_block_and_to_the_jet() {
    let bench = Bench::new();
    let program = bench.file("program.ngc", LINES).display().to_string();
    let machine = bench.file("jet.toml", "cutting_outputs = [0]\n").display().to_string();
    let mut terminal = at(80, 24, &program, &["--machine", &machine]);
    terminal.wait_for_text("READY");
    terminal.keys("c");
    until_block(&terminal, 6);
    terminal.keys(" ");
    terminal.wait_for_text("FEED HOLD");
    terminal.keys("B");
    terminal.wait_until("the beginning of the block", |text| {
        text.contains("AT REST") && text.contains("Y      60.000") && text.contains("X      60.000")
    });
    terminal.keys("b7\r");
    terminal.wait_until("7 mm before it", |text| {
        text.contains("AT REST") && (text.contains("Y      53.0") || text.contains("Y      52.9"))
    });
    terminal.keys("j");
    terminal.wait_until("where the jet came on", |text| {
        text.contains("AT REST") && text.contains("Y       0.000") && text.contains("X      60.000")
    });
    terminal.keys("l");
    terminal.wait_for_text("RUNNING");
    let end = ends(&mut terminal, "completed", 0);
    assert!(end.contains("X 0  Y 0  Z 0"), "{end}");
}

#[test]
fn outputs_that_were_switched_by_hand_are_asked_about_and_restored() {
    let bench = Bench::new();
    let mut terminal = ready(&bench, LINES);
    terminal.keys("c");
    until_block(&terminal, 6);
    terminal.keys("r");
    terminal.wait_until("some mm back", |text| back_mm(text) > 10.0);
    terminal.keys("o0-\r");
    terminal.wait_for_text("outputs all off");
    terminal.keys("L");
    let differ = terminal.wait_for_text("OUTPUTS DIFFER");
    assert!(differ.contains("output 0"), "{differ}");
    terminal.keys("y");
    terminal.wait_for_text("outputs ON: 0");
    let end = ends(&mut terminal, "completed", 0);
    assert!(end.contains("X 0  Y 0  Z 0"), "{end}");
}

#[test]
fn a_program_stop_and_single_block_wait_for_cycle_start() {
    let bench = Bench::new();
    let mut terminal = ready(&bench, "G21 G90 G17 G94 G61\nF6000\nG1 X5\nM0\nG1 Y5\nG1 X0\nG1 Y0\nM2\n");
    terminal.keys("c");
    terminal.wait_for_text("PROGRAM STOP");
    terminal.keys("s");
    terminal.wait_for_text("single block ON");
    terminal.keys("c");
    let end_of_block = terminal.wait_for_text("SINGLE BLOCK");
    assert!(end_of_block.contains("Y       5.000") && end_of_block.contains("X       5.000"), "{end_of_block}");
    terminal.keys("c");
    terminal.wait_until("the end of the next block", |text| {
        text.contains("SINGLE BLOCK") && text.contains("X       0.000")
    });
    terminal.keys("s");
    terminal.keys("c");
    let end = ends(&mut terminal, "completed", 0);
    assert!(end.contains("X 0  Y 0  Z 0"), "{end}");
}

#[test]
fn a_job_is_stopped_and_begins_again_from_where_the_machine_stands() {
    let bench = Bench::new();
    let mut terminal = ready(&bench, "G21 G90 G17 G94\nF6000\nG1 X40\nG1 X0 Y3\nM2\n");
    terminal.keys("c");
    terminal.wait_until("some way", |text| text.contains("RUNNING") && active(text) == 3);
    terminal.keys("q");
    terminal.wait_for_text("stop the job?");
    terminal.keys("y");
    let stopped = terminal.wait_for_text("ENDED");
    assert!(stopped.contains("stopped by the operator"), "{stopped}");
    terminal.keys("u");
    terminal.wait_for_text("READY");
    terminal.keys("c");
    let end = ends(&mut terminal, "completed", 0);
    assert!(end.contains("X 0  Y 3000  Z 0"), "{end}");
}

/// The operator's terminal is closed: the machine stops on its path, and the command reports so.
#[test]
fn a_terminal_that_is_closed_stops_the_job() {
    let bench = Bench::new();
    let served = ServedCard::with(&[]);
    let machine = bench.file("patient.toml", "[card]\nwatchdog_ms = 2000\n").display().to_string();
    let program = bench.file("long.ngc", "G21 G90\nG1 X1000 F1200\nM2\n").display().to_string();
    let mut terminal = at(80, 24, &program, &["--card", &served.port, "--machine", &machine]);
    terminal.wait_for_text("READY");
    terminal.keys("c");
    terminal.wait_until("some way", |text| text.contains("RUNNING") && active(text) == 2);
    terminal.hang_up();
    assert_eq!(terminal.wait_for_end(), Some(4));
    let stands = served.identify(&bench);
    assert_eq!((&stands["at_rest"], &stands["alarm"]), (&true.into(), &serde_json::Value::Null));
    let told = served.end();
    assert_eq!((&told["counted"], &told["periods_apart"]), (&told["counts"], &0.into()));
}

/// An emergency stop on a served card: its cause and its remedy are shown, it is cleared, and the program is begun
/// again.
#[test]
fn an_alarm_is_shown_with_its_remedy_and_cleared() {
    let bench = Bench::new();
    let text = "[card]\nwatchdog_ms = 2000\n[[card.input]]\nnumber = 13\nuse = \"emergency-stop\"\n";
    let machine = bench.file("machine.toml", text).display().to_string();
    let mut served = ServedCard::with(&["--machine", &machine]);
    let program = bench.file("line.ngc", "G21 G90\nG1 X100 F6000\nG1 X0\nM2\n").display().to_string();
    let mut terminal = at(80, 24, &program, &["--card", &served.port, "--machine", &machine]);
    terminal.wait_for_text("READY");
    terminal.keys("c");
    terminal.wait_until("some way", |text| text.contains("RUNNING") && active(text) == 2);
    served.operate("press emergency-stop");
    let alarm = terminal.wait_for_text("E3012");
    assert!(alarm.contains("emergency"), "{alarm}");
    terminal.wait_until("the end of the job", |text| text.contains(" run ") && !text.contains("left"));
    terminal.keys("a");
    terminal.wait_for_text("its cause is still present");
    served.operate("release emergency-stop");
    terminal.keys("a");
    terminal.wait_for_text("alarm cleared");
    terminal.wait_for_text("ENDED");
    terminal.keys("c");
    terminal.wait_for_text("RUNNING");
    let end = ends(&mut terminal, "completed", 0);
    assert!(end.contains("X 0  Y 0  Z 0"), "{end}");
    let told = served.end();
    assert_eq!((&told["counted"], &told["counts"][0]), (&told["counts"], &0.into()));
}

#[test]
fn what_cannot_be_on_a_screen_is_refused() {
    let bench = Bench::new();
    let result = bench.retrace(["run", "--tui", "-"]);
    assert_eq!(result.code, Some(2));
    assert!(result.err.contains("E2142") && result.err.contains("not a terminal"), "{}", result.err);
    let result = bench.retrace(["run", "--tui", "--json", "-"]);
    assert!(result.code == Some(2) && result.err.contains("--json"), "{}", result.err);
}

/// A script operates together with the keys, and the executed records are written.
#[test]
fn a_scripted_operator_and_keys_side_by_side() {
    let bench = Bench::new();
    let script = bench.file("script.op", "at line 6 hold\n").display().to_string();
    let program = bench.file("lines.ngc", LINES).display().to_string();
    let records = bench.path("records.csv").display().to_string();
    let mut terminal = at(80, 24, &program, &["--operator", &script, "--records", &records]);
    terminal.wait_for_text("READY");
    terminal.keys("c");
    terminal.wait_for_text("FEED HOLD");
    terminal.keys("c");
    let end = ends(&mut terminal, "completed", 0);
    assert!(end.contains("X 0  Y 0  Z 0"), "{end}");
    let rows = std::fs::read_to_string(&records).expect("records");
    assert!(rows.lines().count() > 4000, "{}", rows.lines().count());
}

/// Set up manually: a jog, a block, the work zero; then a dry run, which starts there and switches nothing.
#[test]
fn a_machine_is_set_up_by_hand_and_the_program_goes_from_its_work_zero() {
    let bench = Bench::new();
    let text = "G21 G90 G17 G94 G61\nF6000\nM62 P0\nG1 X10\nM3 S100\nG1 X1\nM63 P0\nM2\n";
    let program = bench.file("program.ngc", text).display().to_string();
    let machine = bench.file("jet.toml", JET).display().to_string();
    let mut terminal = at(80, 24, &program, &["--machine", &machine]);
    terminal.wait_for_text("READY");
    terminal.keys(RIGHT);
    terminal.wait_for_state("READY", "X       1.000       1.000");
    terminal.keys("t");
    terminal.wait_for_text("jog step 10 mm");
    terminal.keys("\x1b[A");
    terminal.wait_for_state("READY", "Y      10.000      10.000");
    terminal.keys("mG0 X5 Y2\r");
    terminal.wait_for_state("READY", "Y       2.000       2.000");
    terminal.keys("mG0 X9999\r");
    terminal.wait_for_state("READY", "E4304");
    terminal.keys("z\r");
    terminal.wait_for_state("READY", "X       5.000       0.000");
    terminal.keys("d");
    terminal.wait_for_text("DRY RUN: the cutter stays off");
    terminal.keys("c");
    terminal.wait_until("the end, with the cutter off all the time", |text| {
        assert!(!text.contains("jet ON") && text.starts_with(" DRY "), "{text}");
        text.contains("ENDED")
    });
    let end = ends(&mut terminal, "completed", 0);
    assert!(end.contains("X 6000  Y 2000  Z 0"), "{end}");
}

/// A paused program: the steps are shown, each leads to the next, and the job resumes at the exact place.
#[test]
fn a_program_is_paused_the_tool_moved_away_and_the_job_goes_on() {
    let bench = Bench::new();
    let mut terminal = ready(&bench, "G21 G90 G17 G94 G61\nF3000\nM3 S1000\nG1 X60\nG1 X0\nM5\nM2\n");
    terminal.keys("c");
    until_block(&terminal, 4);
    terminal.keys("p");
    let paused = terminal.wait_for_text("PAUSED: steps to resume");
    assert!(paused.contains("stop the spindle"), "{paused}");
    terminal.keys("S");
    terminal.wait_for_text("spindle stopped");
    terminal.keys("\x1b[5~");
    terminal.wait_for_text("Z       1.000");
    terminal.keys("S");
    terminal.wait_for_text("spindle cw");
    terminal.keys("n");
    terminal.wait_for_text("step 5 of 5");
    terminal.keys("c");
    terminal.wait_for_text("RUNNING");
    let end = ends(&mut terminal, "completed", 0);
    assert!(end.contains("X 0  Y 0  Z 0"), "{end}");
}

/// The screen opens without a program; one is opened at its prompt, by a name that is completed.
#[test]
fn it_opens_without_a_program_and_loads_one() {
    let bench = Bench::new();
    let program = bench.file("only-one.ngc", "G21 G90 G17 G94\nF6000\nG1 X3\nM2\n").display().to_string();
    let mut terminal = Terminal::running(&["run", "--tui"], 80, 24);
    terminal.wait_for_text("NO PROGRAM");
    terminal.keys("c");
    terminal.wait_for_text("no program is loaded");
    terminal.keys("O/nowhere/part.ngc\r");
    terminal.wait_for_text("E2101");
    terminal.keys("O");
    terminal.keys(program.trim_end_matches("one.ngc"));
    terminal.keys("\t");
    terminal.wait_for_text("only-one.ngc_");
    terminal.keys("\r");
    terminal.wait_for_text("only-one.ngc is ready");
    terminal.keys("c");
    let end = ends(&mut terminal, "completed", 0);
    assert!(end.contains("X 3000  Y 0  Z 0"), "{end}");
    let result = bench.retrace(["run", "--realtime"]);
    assert!(result.code == Some(2) && result.err.contains("PROGRAM"), "{}", result.err);
}

/// A program that would leave the soft limits opens the screen, where the work zero is moved until it fits.
#[test]
fn a_program_beyond_the_limits_is_checked_again_when_the_work_zero_moves() {
    let bench = Bench::new();
    let program = bench.file("far.ngc", "G21 G90 G17 G94\nF6000\nG1 X1\nG1 X2001\nG1 X3\nM2\n");
    let program = program.display().to_string();
    let mut terminal = at(80, 24, &program, &[]);
    let refused = terminal.wait_for_text("NOT READY");
    assert!(refused.contains("E4304: axis X would go to 2001.000 mm"), "{refused}");
    terminal.keys("c");
    terminal.wait_for_text("PROGRAM REFUSED");
    terminal.keys("a");
    terminal.wait_for_text("NOT READY");
    terminal.keys("mG0 X-10\r");
    terminal.wait_for_state("NOT READY", "X     -10.000     -10.000");
    terminal.keys("z\r");
    terminal.wait_for_text("far.ngc is ready");
    // It was checked only: what it would do there takes too long.
    terminal.keys("q");
    assert_eq!(terminal.wait_for_end(), Some(4));
    let mut terminal = at(80, 24, &program, &[]);
    terminal.wait_for_text("NOT READY");
    terminal.keys("q");
    assert_eq!(terminal.wait_for_end(), Some(1));
}

/// At the end of the program the part is still clamped: the cut can be retraced until the job is released.
#[test]
fn reverse_run_is_possible_at_the_end_of_the_program_until_the_job_is_released() {
    let bench = Bench::new();
    let mut terminal = ready(&bench, "G21 G90 G17 G94\nF3000\nG1 X30\nM2\n");
    terminal.keys("c");
    let ended = terminal.wait_for_text("ENDED");
    let clock = |text: &str| text.lines().next().and_then(|line| line.rsplit("  ").next().map(str::to_owned));
    std::thread::sleep(Duration::from_millis(1200));
    assert_eq!(clock(&ended), clock(&terminal.text()), "the clock stops");
    terminal.keys("b12\r");
    terminal.wait_until("12 mm back", |text| text.contains("AT REST") && text.contains("12.0 mm back"));
    terminal.keys("l");
    terminal.wait_for_text("ENDED");
    // Released: the job is over, and the machine can be set up.
    terminal.keys("u");
    terminal.wait_for_text("READY");
    terminal.keys("r");
    terminal.wait_for_text("works while");
    terminal.keys(RIGHT);
    terminal.wait_for_state("READY", "X      31.000");
    terminal.keys("q");
    assert_eq!(terminal.wait_for_end(), Some(0));
}

/// Who quits while an axis still moves stops it, and the command ends.
#[test]
fn quitting_during_a_jog_stops_the_axis_and_ends_the_command() {
    let bench = Bench::new();
    let mut terminal = ready(&bench, "G21 G90 G17 G94\nF3000\nG1 X30\nM2\n");
    terminal.keys("r");
    terminal.wait_for_text("works while");
    terminal.keys(&format!("{RIGHT}q"));
    assert_eq!(terminal.wait_for_end(), Some(4));
}

/// A job that was stopped is resumed at the screen: the resume is shown and confirmed, and every key works from there
/// on.
#[test]
fn a_job_is_resumed_at_the_screen_with_all_its_keys() {
    let bench = Bench::new();
    let program = bench.file("program.ngc", "G21 G90 G17 G94 G61\nF2400\nG1 X60\nG1 X0 Y3\nM2\n").display().to_string();
    let journal = bench.path("jobs").display().to_string();
    let mut terminal = at(80, 24, &program, &["--journal", &journal]);
    terminal.wait_for_text("READY");
    terminal.keys("c");
    terminal.wait_until("some way", |text| text.contains("RUNNING") && active(text) == 3);
    std::thread::sleep(Duration::from_millis(500));
    terminal.keys("q");
    terminal.wait_for_text("stop the job?");
    terminal.keys("y");
    terminal.wait_for_text("ENDED");
    terminal.keys("q");
    assert_eq!(terminal.wait_for_end(), Some(4));
    let resumed = || Terminal::running(&["resume", "--tui", "--journal", &journal], 80, 24);
    let mut terminal = resumed();
    let asked = terminal.wait_for_text("y confirm");
    assert!(asked.contains("G1 X60") && asked.contains("mm into the block") && asked.contains("history"), "{asked}");
    terminal.keys("n");
    assert_eq!(terminal.wait_for_end(), Some(2));
    terminal.wait_for_text("E2215");
    let mut terminal = resumed();
    terminal.wait_for_text("y confirm");
    terminal.keys("y");
    terminal.wait_for_text("RUNNING");
    terminal.keys("r");
    // Back over the part that was cut before the interruption, to its beginning.
    terminal
        .wait_until("the beginning", |text| text.contains("REVERSE") && text.contains("at the start of the history"));
    terminal.wait_for_text("X       0.000");
    terminal.keys("l");
    let end = ends(&mut terminal, "completed", 0);
    assert!(end.contains("X 0  Y 3000  Z 0"), "{end}");
}

/// The planned path moves with the work zero, at once.
#[test]
fn the_planned_path_moves_with_the_work_zero() {
    let bench = Bench::new();
    let terminal = ready(&bench, "G21 G90 G17 G94\nF6000\nG1 X10\nG1 X0\nM2\n");
    terminal.wait_for_text("path X Y · 10 × 0 mm");
    terminal.keys("mG0 X50 Y20\r");
    terminal.wait_for_text("path X Y · 50 × 0 mm");
    terminal.keys("z\r");
    terminal.wait_for_text("path X Y · 10 × 0 mm");
}

/// Feed, modal line and tool are those of the block under the tool, also where the machine has gone back; a rapid move
/// has no feed to show.
#[test]
fn what_is_shown_is_that_of_the_block_under_the_tool() {
    let bench = Bench::new();
    let mut terminal = ready(&bench, "G21 G90 G17 G94 G61\nG1 F600 X30\nG0 X100\nG1 F900 G55 X110\nG1 X120\nM2\n");
    terminal.keys("c");
    terminal.wait_for_text("of F600");
    terminal.wait_until("a rapid move", |text| text.contains("mm/min rapid") && active(text) == 3);
    let ahead = terminal.wait_for_text("of F900");
    assert!(ahead.contains("G55"), "{ahead}");
    terminal.keys("r");
    let behind = terminal.wait_until("the first feed", |text| text.contains("of F600") && active(text) == 2);
    assert!(behind.contains("G54") && behind.contains("REVERSE"), "{behind}");
    terminal.keys("l");
    ends(&mut terminal, "completed", 0);
}

/// The cutter has a name, a state, and a key that switches it off at once; it starts again only after a confirmation.
#[test]
fn the_cutter_is_switched_off_by_a_key_and_started_again_when_that_is_agreed_to() {
    let bench = Bench::new();
    let program = bench.file("lines.ngc", LINES).display().to_string();
    let machine = bench.file("jet.toml", JET).display().to_string();
    let mut terminal = at(80, 24, &program, &["--machine", &machine]);
    terminal.wait_for_text("READY");
    terminal.wait_for_text("jet off");
    terminal.keys("oclamp+\r");
    terminal.wait_for_text("outputs ON: clamp");
    terminal.keys("c");
    terminal.wait_for_text("jet ON · program here on");
    until_block(&terminal, 6);
    terminal.keys("x");
    terminal.wait_for_text("jet off · program here on");
    // `k` would go back to the end of the kerf; `c` continues where the machine came to rest
    terminal.wait_for_text("CUT INTERRUPTED");
    terminal.keys("c");
    let differ = terminal.wait_for_text("OUTPUTS DIFFER");
    assert!(differ.contains("jet") && differ.contains("y: switch"), "{differ}");
    terminal.keys("y");
    terminal.wait_for_text("jet ON · program here on");
    terminal.wait_for_text("RUNNING");
    ends(&mut terminal, "completed", 0);
}

/// A manual tool change shows the tool; M1 stops where its switch is on.
#[test]
fn a_tool_change_and_an_optional_stop_wait_for_the_operator() {
    let bench = Bench::new();
    let program = bench.file("tool.ngc", "G21 G90 G17 G94\nF6000\nT3 M6\nG1 X5\nM1\nG1 X0\nM2\n").display().to_string();
    let machine = bench.file("hand.toml", "tool_change = \"manual\"\n").display().to_string();
    let tools = bench.file("tool.tbl", "T3 P3 Z0 D6 ;6 mm end mill\n").display().to_string();
    let mut terminal = at(80, 24, &program, &["--machine", &machine, "--tools", &tools]);
    terminal.wait_for_text("READY");
    terminal.keys("M");
    terminal.wait_for_text("M1 stops");
    terminal.keys("c");
    let change = terminal.wait_for_text("TOOL CHANGE");
    assert!(change.contains("insert tool T3: 6 mm end mill"), "{change}");
    terminal.keys("c");
    let stop = terminal.wait_for_text("PROGRAM STOP");
    assert!(stop.contains("X       5.000"), "{stop}");
    terminal.keys("c");
    ends(&mut terminal, "completed", 0);
}

/// A machine that was jogged away since the job ended returns by itself, at the screen as without it: the way back is
/// shown and confirmed. So it is where the job was stopped, and where its host was killed and the card reports a place
/// that no longer belongs to the job.
#[test]
fn a_job_is_resumed_at_the_screen_where_the_machine_was_jogged_away() {
    for is_killed in [false, true] {
        let (bench, card) = (Bench::new(), ServedCard::with(&[]));
        bench.file("program.ngc", "G21 G90 G17 G94 G61\nF2400\nG1 X60\nG1 X0 Y3\nM2\n");
        bench.file("mill.toml", "retract_mm = 10\n[card]\nwatchdog_ms = 2000\n");
        bench.file("stop.op", "at 1s stop\n");
        let machine = bench.path("mill.toml").display().to_string();
        let on_card = ["--card", &card.port, "--machine", &machine];
        let run = ["run", "program.ngc", "--journal", "jobs", "--json"];
        if is_killed {
            let mut host = bench.start(&[&run[..], &on_card].concat(), std::process::Stdio::null(), "killed.txt");
            std::thread::sleep(Duration::from_millis(2500));
            host.kill().expect("it is killed");
            host.wait().expect("it ends");
            let result = bench.retrace(["card", "clear", &card.port, "--machine", &machine]);
            assert_eq!(result.code, Some(0), "{}", result.err);
        } else {
            let stopped = [&run[..], &["--operator", "stop.op"], &on_card].concat();
            assert_eq!(bench.retrace(stopped).code, Some(4));
        }
        for jog in [["jog", "z", "5"], ["jog", "y", "-7"]] {
            let result = bench.retrace(jog.iter().chain(&on_card));
            assert_eq!(result.code, Some(0), "{}", result.err);
        }
        let journal = bench.path("jobs").display().to_string();
        let mut terminal = Terminal::running(&["resume", "--tui", "--journal", &journal], 100, 40);
        let asked = terminal.wait_for_text("y confirm");
        assert!(asked.contains("approach"), "{asked}");
        terminal.keys("y");
        terminal.wait_for_text("RUNNING");
        let end = ends(&mut terminal, "completed", 0);
        assert!(end.contains("X 0  Y 3000  Z 0"), "{end}");
    }
}
