//! Jobs of a shop at the machine's screen: listed, shown, started by a key after a question, and counted (SHP-12,
//! SHP-36).

use std::fs;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, assert_contains};
use retrace_tests::terminal::Terminal;
use serde_json::Value;

const PART: &str = "G21 G90 G94 F6000\nG1 X20\nX25 Y5\nX0 Y0\nM2\n";
/// A program that takes a minute, so that nothing of it ends while a test looks at it.
const LONG_PART: &str = "G21 G90 G94 F600\nG1 X200\nX0\nX200\nM2\n";

#[track_caller]
fn done(bench: &Bench, arguments: &[&str]) -> String {
    let result = bench.retrace(arguments);
    assert_eq!(result.code, Some(0), "{arguments:?}: {}\n{}", result.out, result.err);
    result.out
}

/// Submits a job. Returns its name.
fn submit(bench: &Bench, name: &str, text: &str, more: &[&str]) -> String {
    bench.file(name, text);
    done(bench, &[&["shop", "submit", name], more].concat()).trim().to_owned()
}

fn shown(bench: &Bench, id: &str) -> Value {
    serde_json::from_str(&done(bench, &["shop", "show", id, "--json"])).expect("one object")
}

/// State and good pieces of a job.
fn state(bench: &Bench, id: &str) -> (String, u64) {
    let job = shown(bench, id);
    (job["state"].as_str().expect("a state").to_owned(), job["good"].as_u64().expect("a number"))
}

fn is(state: &str, good: u64) -> (String, u64) {
    (state.to_owned(), good)
}

/// A screen without a program, with the state folder of the bench.
fn screen(bench: &Bench, more: &[&str]) -> Terminal {
    let state = bench.path("state").display().to_string();
    let terminal = Terminal::with(&[&["run", "--tui"], more].concat(), 120, 34, &[("XDG_STATE_HOME", &state)]);
    terminal.wait_for_text("NO PROGRAM");
    terminal
}

/// Opens the page of jobs and waits for these words on it.
fn open(terminal: &Terminal, words: &str) -> String {
    terminal.keys("Q");
    terminal.wait_for_text("jobs of local");
    terminal.wait_for_text(words)
}

/// Presses Esc until none of the boxes is open. Behind other keys it would be the beginning of another one.
fn close(terminal: &Terminal) {
    for box_text in ["y START", "any other key: back", "NOT STARTED", "jobs of local"] {
        if terminal.text().contains(box_text) {
            terminal.keys("\x1b");
            terminal.wait_until("the box is closed", |text| !text.contains(box_text));
        }
    }
}

fn quit(terminal: &mut Terminal) {
    close(terminal);
    terminal.keys("q");
    terminal.wait_for_end();
}

fn file_of_job(bench: &Bench, id: &str, name: &str) -> PathBuf {
    bench.path("state").join("retrace/shop/local/inbox").join(id).join("files").join(name)
}

#[test]
fn a_job_is_started_by_a_key_at_the_screen_after_a_question_and_counted() {
    let bench = Bench::new();
    let more = ["--quantity", "2", "--note", "for order 17", "--material", "steel 4 mm"];
    let id = submit(&bench, "part.ngc", PART, &more);
    let bad = submit(&bench, "bad.ngc", "G1 X1 Q\n", &[]);
    done(&bench, &["shop", "agent", "--once"]);
    let mut terminal = screen(&bench, &[]);
    let page = open(&terminal, "for order 17");
    assert_contains(&page, &["ready", "part.ngc", "0/2", "no errors", "steel 4 mm", "refused", "2 errors"]);
    terminal.keys("\x1b[B\r");
    assert_contains(&terminal.wait_for_text("E1101"), &[&bad, "line 1: Q is not followed by a value"]);
    terminal.keys("c");
    terminal.wait_for_text("not ready");
    close(&terminal);
    open(&terminal, "part.ngc");
    // a job that comes while the page is open is listed
    let late = submit(&bench, "late.ngc", PART, &[]);
    terminal.wait_for_text("queued");
    // cycle start asks, and any key but y starts nothing
    terminal.keys("c");
    let question = terminal.wait_for_text("start a piece of this job?");
    assert_contains(
        &question,
        &["part.ngc", "1 of 2", "steel 4 mm", "for order 17", "the built-in machine", "y START"],
    );
    assert!(!question.contains("WARNING"), "{question}");
    terminal.keys("n");
    terminal.wait_for_text("Enter show");
    assert_eq!(state(&bench, &id), is("ready", 0));
    terminal.keys("cy");
    // it is released by the next key, which may be the start of the next piece
    terminal.wait_for_text("ENDED");
    assert_eq!(state(&bench, &id), is("running", 0));
    terminal.keys("u");
    terminal.wait_for_text("READY");
    assert_eq!(state(&bench, &id), is("ready", 1));
    open(&terminal, "1/2");
    terminal.keys("cy");
    terminal.wait_for_text("ENDED");
    terminal.keys("u");
    terminal.wait_for_text("READY");
    assert_eq!(state(&bench, &id), is("done", 2));
    // no piece too many, neither by the page nor by cycle start of the program that is loaded
    open(&terminal, "2/2");
    close(&terminal);
    terminal.keys("c");
    terminal.wait_for_text("NOT STARTED: E5013");
    assert_eq!(shown(&bench, &id)["runs"].as_array().map(Vec::len), Some(2));
    quit(&mut terminal);
    assert_eq!(state(&bench, &late), is("queued", 0));
    assert_contains(&done(&bench, &["shop", "audit"]), &["3 jobs, 0 faults"]);
}

#[test]
fn a_job_that_another_process_runs_and_one_that_is_interrupted_is_not_started() {
    let bench = Bench::new();
    let id = submit(&bench, "long.ngc", LONG_PART, &["--quantity", "2"]);
    done(&bench, &["shop", "agent", "--once"]);
    let mut first = screen(&bench, &[]);
    let mut second = screen(&bench, &[]);
    open(&first, "0/2");
    // The question is open at two screens: one of them starts the piece.
    open(&second, "0/2");
    second.keys("c");
    second.wait_for_text("y START");
    first.keys("cy");
    first.wait_for_text("RUNNING");
    second.keys("y");
    let refused = second.wait_for_text("is running");
    assert!(!refused.contains("RUNNING"), "{refused}");
    close(&second);
    assert_eq!(shown(&bench, &id)["runs"].as_array().map(Vec::len), Some(1));
    // No other job while one runs.
    open(&first, "running");
    first.keys("c");
    first.wait_for_text("a program is running");
    // A terminal that is closed stops the job on its path, and it can be resumed.
    first.hang_up();
    assert_eq!(first.wait_for_end(), Some(4));
    assert_eq!(state(&bench, &id), is("interrupted", 0));
    let page = open(&second, "interrupted");
    assert!(!page.contains("0/2  ready"), "{page}");
    second.keys("c");
    second.wait_for_text("the job is interrupted");
    quit(&mut second);
    assert_contains(&done(&bench, &["shop", "audit"]), &["1 jobs, 0 faults"]);
}

#[test]
fn files_machine_file_dry_run_and_journal_are_verified_before_a_start() {
    let bench = Bench::new();
    bench.file("mill.toml", "name = \"mill\"\n");
    let changed = submit(&bench, "changed.ngc", PART, &[]);
    let made_for = ["--made-for", "mill.toml"];
    let warned = submit(&bench, "warned.ngc", PART, &made_for);
    let only = submit(&bench, "only.ngc", PART, &[made_for[0], made_for[1], "--only-made-for"]);
    done(&bench, &["shop", "agent", "--once"]);
    let mut terminal = screen(&bench, &[]);
    open(&terminal, "only.ngc");
    let file = file_of_job(&bench, &changed, "changed.ngc");
    fs::write(&file, PART.replace("X25", "X95")).expect("written");
    terminal.keys("cy");
    assert_contains(&terminal.wait_for_text("NOT STARTED: E5006"), &["changed.ngc", "submit the job again"]);
    close(&terminal);
    assert_eq!(shown(&bench, &changed)["runs"].as_array().map(Vec::len), Some(0));
    fs::write(&file, PART).expect("written");
    // Another machine file is a warning, or no start.
    open(&terminal, "only.ngc");
    terminal.keys("\x1b[B\x1b[Bc");
    terminal.wait_for_text("made for another machine file than the built-in machine");
    assert!(!terminal.text().contains("y START"), "{}", terminal.text());
    terminal.keys("\x1b[Ac");
    assert_contains(&terminal.wait_for_text("y START"), &["WARNING", "warned.ngc", "another machine file"]);
    // A dry run makes no piece.
    close(&terminal);
    terminal.keys("d");
    terminal.wait_for_text("DRY");
    open(&terminal, "only.ngc");
    terminal.keys("c");
    terminal.wait_for_text("a dry run makes no piece");
    close(&terminal);
    terminal.keys("d");
    terminal.wait_until("no dry run", |text| !text.contains("DRY"));
    open(&terminal, "only.ngc");
    terminal.keys("\x1b[Bcy");
    terminal.wait_for_text("ENDED");
    terminal.keys("u");
    terminal.wait_for_text("READY");
    quit(&mut terminal);
    for (id, expected) in [(&changed, is("ready", 0)), (&warned, is("done", 1)), (&only, is("ready", 0))] {
        assert_eq!(state(&bench, id), expected);
    }
    let mut without = screen(&bench, &["--no-journal"]);
    open(&without, "changed.ngc");
    without.keys("cy");
    without.wait_for_text("NOT STARTED: E5030");
    quit(&mut without);
    assert_contains(&done(&bench, &["shop", "audit"]), &["3 jobs, 0 faults"]);
}

#[test]
fn a_piece_begins_at_its_first_block_and_with_the_files_that_were_submitted() {
    let bench = Bench::new();
    bench.file("cut.toml", "[[cutter]]\nname = \"jet\"\nkind = \"jet\"\nfire = 0\n");
    let text = "G21 G90 G94 F6000\nG0 X5\nM62 P0\nG1 X20\nM63 P0\nG0 X30\nM62 P0\nG1 X40\nM63 P0\nM2\n";
    bench.file("shop.toml", "machine_file = \"cut.toml\"\n");
    let file = bench.path("shop.toml").display().to_string();
    let shop = ["--shop-file", &file];
    let id = submit(&bench, "cut.ngc", text, &["--quantity", "2", shop[0], shop[1]]);
    done(&bench, &["shop", "agent", "--once", shop[0], shop[1]]);
    let machine = bench.path("cut.toml").display().to_string();
    let mut terminal = screen(&bench, &["--machine", &machine, shop[0], shop[1]]);
    open(&terminal, "cut.ngc");
    terminal.keys("cy");
    terminal.wait_for_text("ENDED");
    terminal.keys("u");
    terminal.wait_for_text("READY");
    // a contour of it is no piece
    terminal.keys("C");
    terminal.wait_for_text("Enter begin there");
    terminal.keys("2\r");
    terminal.wait_for_text("y begin");
    terminal.keys("y");
    terminal.wait_for_text("NOT STARTED: E5031");
    close(&terminal);
    // the files are verified at each start
    fs::write(file_of_job(&bench, &id, "cut.ngc"), text.replace("X40", "X41")).expect("written");
    terminal.keys("c");
    terminal.wait_for_text("NOT STARTED: E5006");
    assert_eq!(shown(&bench, &id)["runs"].as_array().map(Vec::len), Some(1));
    quit(&mut terminal);
}

/// A series of pieces is started by one question that shows their number. They follow each other without a key, and the
/// last one waits for its release. A piece that is stopped ends the series.
#[test]
fn a_series_of_pieces_is_started_by_one_question_and_ends_with_a_bad_one() {
    let bench = Bench::new();
    let id = submit(&bench, "part.ngc", PART, &["--quantity", "4", "--may-repeat"]);
    let single = submit(&bench, "single.ngc", PART, &["--quantity", "4"]);
    let long = submit(&bench, "long.ngc", LONG_PART, &["--quantity", "2", "--may-repeat"]);
    done(&bench, &["shop", "agent", "--once"]);
    let mut terminal = screen(&bench, &[]);
    open(&terminal, "0/4");
    terminal.keys("c");
    assert_contains(&terminal.wait_for_text("start a piece of this job?"), &["1 of at most 4 pieces"]);
    terminal.keys("\x1b[A");
    terminal.wait_for_text("y START 2 pieces");
    terminal.keys("\x1b[A\x1b[A\x1b[A\x1b[A\x1b[B");
    let question = terminal.wait_for_text("y START 3 pieces, one after the other");
    assert_contains(&question, &["start a series of this job?", "3 of at most 4 pieces"]);
    terminal.keys("y");
    // two were released by the next one, the third waits
    let begun = Instant::now();
    while state(&bench, &id) != is("running", 2) && begun.elapsed() < Duration::from_secs(30) {
        std::thread::sleep(Duration::from_millis(50));
    }
    terminal.wait_for_text("c RUNS IT AGAIN");
    assert_eq!((state(&bench, &id), shown(&bench, &id)["runs"].as_array().map(Vec::len)), (is("running", 2), Some(3)));
    terminal.keys("u");
    terminal.wait_for_text("READY");
    assert_eq!(state(&bench, &id), is("ready", 3));
    // a job that permits no series has no such choice
    open(&terminal, "3/4");
    terminal.keys("\x1b[Bc");
    assert!(!terminal.wait_for_text("y START").contains("series"), "{}", terminal.text());
    close(&terminal);
    // stopped in the first piece, the second one does not begin
    open(&terminal, "long.ngc");
    terminal.keys("\x1b[B\x1b[Bc");
    terminal.wait_for_text("1 of at most 2 pieces");
    terminal.keys("\x1b[Ay");
    terminal.wait_for_text("RUNNING");
    terminal.hang_up();
    assert_eq!(terminal.wait_for_end(), Some(4));
    assert_eq!(state(&bench, &long), is("interrupted", 0));
    assert_eq!(shown(&bench, &long)["runs"].as_array().map(Vec::len), Some(1));
    assert_eq!(state(&bench, &single), is("ready", 0));
    assert_contains(&done(&bench, &["shop", "audit"]), &["3 jobs, 0 faults"]);
}

/// A piece is run with the cycles of its job, and the program that is opened behind it without them.
#[test]
fn a_piece_at_the_screen_has_the_cycles_of_its_job() {
    let bench = Bench::new();
    bench.file("MARK.SPF", "PROC MARK(REAL LENGTH)\nG1 G90 AX[1]=LENGTH\nM17\n");
    let id = submit(&bench, "row.ngc", "G21 G90 G94 F6000\nMARK(12)\nM2\n", &["MARK.SPF"]);
    done(&bench, &["shop", "agent", "--once"]);
    let mut terminal = screen(&bench, &[]);
    open(&terminal, "row.ngc");
    terminal.keys("cy");
    terminal.wait_for_text("ENDED");
    terminal.wait_for_text("12.000");
    close(&terminal);
    terminal.keys("u");
    terminal.wait_for_text("READY");
    assert_eq!(state(&bench, &id), is("done", 1));
    terminal.keys(&format!("O{}\r", bench.path("row.ngc").display()));
    terminal.wait_for_text("E1");
    terminal.wait_for_text("NOT READY");
    quit(&mut terminal);
}
