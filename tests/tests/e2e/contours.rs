//! The list of all contours while a job runs, and the progress of the cut (CUT-12, CUT-27).

use retrace_tests::command::Bench;
use retrace_tests::run::Run;
use retrace_tests::terminal::Terminal;
use serde_json::{Value, json};

/// Three contours of 60, 20 and 30 mm; the second one in a subprogram.
const PROGRAM: &str = "G21 G90 F1800\nO100 sub\nG0 X100 Y5\nM3\nG1 X120\nM5\nO100 endsub\nG0 X10\nM3\nG1 X70\nM5\n\
    O100 call\nG0 X10 Y20\nM3\nG1 Y50\nM5\nG0 X0 Y0\nM2\n";

fn machine() -> String {
    let axis = |name: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = 100\n\
             max_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-50, 500]\n"
        )
    };
    let torch = "[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nok = { input = 5 }\n\
                 start = { start_s = 1.0, retry_s = 0.5, pierce_s = 0.4 }\n";
    format!("{torch}{}{}", axis("x"), axis("y"))
}

fn bench(script: &str) -> Bench {
    let bench = Bench::new();
    for (name, text) in [("part.ngc", PROGRAM), ("m.toml", &machine()), ("s.op", script)] {
        bench.file(name, text);
    }
    bench
}

fn run(faults: &str, script: &str, more: &[&str]) -> Run {
    let bench = bench(script);
    let [machine, operator] = ["m.toml", "s.op"].map(|name| bench.path(name).display().to_string());
    let arguments = ["--machine", &machine, "--source-faults", faults, "--operator", &operator];
    Run::of(&bench, &bench.path("part.ngc"), &[&arguments, more].concat())
}

/// Number, state and cut length in whole mm of each contour of a list.
fn states(list: &Value) -> Vec<(u64, String, i64)> {
    let contours = list["contours"].as_array().unwrap_or_else(|| panic!("no list: {list}"));
    let row = |contour: &Value| {
        let state = contour["state"].as_str()?.to_owned();
        Some((contour["number"].as_u64()?, state, contour["cut_mm"].as_f64()?.round() as i64))
    };
    contours.iter().filter_map(row).collect()
}

fn lists(text: &str) -> Vec<Value> {
    let lines = text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    lines.filter(|object| object["event"] == "contours").collect()
}

fn row(number: u64, state: &str, cut_mm: i64) -> (u64, String, i64) {
    (number, state.to_owned(), cut_mm)
}

/// Before the first contour everything of the plan is known; in a cut, behind a loss that was skipped, and at the end
/// each contour has its state.
#[test]
fn the_contours_are_listed_with_their_states_as_the_run_goes() {
    let script = "at 0s contours\nat 3s contours\nafter 0.1s skip contour\nat line 15 override 100%\n\
                  after 0.5s contours\nat line 17 contours\n";
    let run = run("lose@20", script, &[]);
    assert_eq!(run.report["outcome"], "completed", "{}", run.output.err);
    let lists = lists(&run.output.out);
    let [first, lost, cutting, last] = &lists[..] else { panic!("{} lists", lists.len()) };
    let keys = ["number", "line", "subprogram", "cutter", "length_mm", "pierce_mm", "end_mm", "not_cut_mm"];
    let plan: Vec<Value> = first["contours"]
        .as_array()
        .expect("a list")
        .iter()
        .map(|contour| Value::Array(keys.map(|key| contour[key].clone()).into()))
        .collect();
    let place = |x: f64, y: f64| json!({"x": x, "y": y});
    assert_eq!(
        plan,
        [
            json!([1, 9, null, "torch", 60.0, place(10.0, 0.0), place(70.0, 0.0), null]),
            json!([2, 4, "O100", "torch", 20.0, place(100.0, 5.0), place(120.0, 5.0), null]),
            json!([3, 14, null, "torch", 30.0, place(10.0, 20.0), place(10.0, 50.0), null]),
        ]
    );
    assert_eq!(states(first), [row(1, "not_begun", 0), row(2, "not_begun", 0), row(3, "not_begun", 0)]);
    assert_eq!(
        (&first["contour"], &first["contour_count"], &first["job_length_mm"]),
        (&Value::Null, &3.into(), &110.0.into())
    );
    assert_eq!(states(lost), [row(1, "begun", 20), row(2, "not_begun", 0), row(3, "not_begun", 0)]);
    assert_eq!(lost["contour"], 1);
    let [one, two, (3, begun, cut_mm)] = &states(cutting)[..] else { panic!("{cutting}") };
    assert_eq!((one, two, begun.as_str()), (&row(1, "not_cut", 20), &row(2, "cut", 20), "begun"));
    assert!((5..29).contains(cut_mm), "{cutting}");
    assert_eq!(states(last), [row(1, "not_cut", 20), row(2, "cut", 20), row(3, "cut", 30)]);
    let not_cut = last["contours"][0]["not_cut_mm"].as_f64().expect("a length");
    assert!((not_cut - 40.0).abs() < 0.2 && (last["job_cut_mm"].as_f64().expect("a length") - 70.0).abs() < 0.3);
}

/// A job that begins at a contour has the numbers of the program.
#[test]
fn a_job_that_begins_at_a_contour_counts_from_there() {
    let run = run("", "at line 17 contours\n", &["--contour", "2"]);
    let numbers: Vec<u64> = run.of_kind("contour").filter_map(|event| event["number"].as_u64()).collect();
    assert_eq!((numbers, &run.report["contours"]), (vec![2, 3], &2.into()), "{}", run.output.out);
    let list = lists(&run.output.out).pop().expect("a list");
    assert_eq!(states(&list), [row(1, "not_begun", 0), row(2, "cut", 20), row(3, "cut", 30)]);
}

/// A contour that is cut again from its pierce has ended again.
#[test]
fn a_contour_that_is_cut_again_from_its_pierce_is_cut() {
    let run = run("lose@20", "at 3s back to pierce\nafter 3s cut\nat line 17 contours\n", &[]);
    assert_eq!(run.report["outcome"], "completed", "{}", run.output.err);
    let numbers: Vec<u64> = run.of_kind("contour").filter_map(|event| event["number"].as_u64()).collect();
    assert_eq!(numbers, [1, 2, 3]);
    let list = lists(&run.output.out).pop().expect("a list");
    assert_eq!(states(&list), [row(1, "cut", 60), row(2, "cut", 20), row(3, "cut", 30)]);
}

/// A job that is resumed knows what was cut before, and counts on.
#[test]
fn a_resumed_job_knows_the_contours_that_were_cut_before() {
    let bench = bench("at 3s skip contour\nat line 15 stop\n");
    let arguments =
        ["run", "part.ngc", "--machine", "m.toml", "--source-faults", "lose@20", "--operator", "s.op", "--json"];
    let stopped = bench.retrace(arguments);
    assert_eq!(stopped.code, Some(4), "{}", stopped.err);
    bench.file("again.op", "at 0s contours\nat line 17 contours\n");
    let resumed = bench.retrace(["resume", "--yes", "--json", "--operator", "again.op"]);
    assert_eq!(resumed.code, Some(0), "{}", resumed.err);
    let events = || resumed.out.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let restored = events().find(|event| event["event"] == "contours_restored").expect("they are restored");
    assert_eq!(restored["contours"][0]["line"], 9);
    let [first, last] = &lists(&resumed.out)[..] else { panic!("{}", resumed.out) };
    let [one, two, (3, begun, cut_mm)] = &states(first)[..] else { panic!("{first}") };
    assert_eq!((one, two, begun.as_str()), (&row(1, "not_cut", 20), &row(2, "cut", 20), "begun"));
    assert!((0..29).contains(cut_mm), "{first}");
    assert_eq!(states(last), [row(1, "not_cut", 20), row(2, "cut", 20), row(3, "cut", 30)]);
    let report = events().find(|event| event["event"] == "report").expect("a report");
    assert_eq!((&report["contours"], &report["contours_not_cut"]), (&3.into(), &1.into()), "{report}");
    let not_cut = report["not_cut_mm"].as_f64().expect("a length");
    assert!((not_cut - 40.0).abs() < 0.2, "{not_cut}");
}

/// A contour that is skipped ahead is passed with the cutter off, at any place of the program; the others are cut. One
/// that was begun is not skipped so. A resumed job skips what the operator had skipped.
#[test]
fn contours_ahead_are_skipped() {
    let script = "at 0s skip contour 2\nat 0s skip contour 3\nat 0s skip contour 3 off\nat 0s contours\n\
                  at line 10 override 100%\nafter 0.5s skip contour 1\nat line 17 contours\n";
    let run = run("", script, &[]);
    run.assert_exact_and_legal();
    assert_eq!((&run.report["outcome"], &run.report["contours_not_cut"]), (&"completed".into(), &1.into()));
    let [first, last] = &lists(&run.output.out)[..] else { panic!("{}", run.output.out) };
    assert_eq!(states(first), [row(1, "not_begun", 0), row(2, "skipped", 0), row(3, "not_begun", 0)]);
    assert_eq!(states(last), [row(1, "cut", 60), row(2, "not_cut", 0), row(3, "cut", 30)]);
    let refused: Vec<&str> = run.of_kind("command_rejected").filter_map(|event| event["reason"].as_str()).collect();
    assert!(refused.len() == 1 && refused[0].contains("has been begun"), "{refused:?}");
    // Its start is under way already.
    let starting = self::run("", "at 0.7s skip contour 1\n", &[]);
    assert!(starting.of_kind("command_rejected").count() == 1 && starting.report["contours_not_cut"] == 0);
    let bench = bench("at 0s skip contour 2\nat 0s skip contour 3\nat line 10 stop\n");
    let arguments = ["run", "part.ngc", "--machine", "m.toml", "--operator", "s.op", "--json"];
    assert_eq!(bench.retrace(arguments).code, Some(4));
    bench.file("again.op", "at 0s skip contour 3 off\nat line 17 contours\n");
    let resumed = bench.retrace(["resume", "--yes", "--json", "--operator", "again.op"]);
    assert_eq!(resumed.code, Some(0), "{}", resumed.err);
    let last = lists(&resumed.out).pop().expect("a list");
    assert_eq!(states(&last), [row(1, "cut", 60), row(2, "not_cut", 0), row(3, "cut", 30)]);
}

/// What is cut again counts once: a torch without an input pierces a little before the end of its cut, and burns in the
/// kerf.
#[test]
fn the_length_of_a_contour_that_is_cut_again_is_its_length() {
    let bench = bench("at 2s cutter off\nafter 1s recover\nat line 17 contours\n");
    let plain = machine().replace("ok = { input = 5 }\n", "restart = { overlap_mm = 8 }\n");
    let machine = bench.file("m.toml", plain).display().to_string();
    let operator = bench.path("s.op").display().to_string();
    let run = Run::of(&bench, &bench.path("part.ngc"), &["--machine", &machine, "--operator", &operator]);
    assert_eq!((run.of_kind("cut_from_here").count(), &run.report["outcome"]), (1, &"completed".into()));
    let list = lists(&run.output.out).pop().expect("a list");
    assert_eq!(states(&list), [row(1, "cut", 60), row(2, "cut", 20), row(3, "cut", 30)]);
}

/// Once a second while a contour is cut: how much of how much, and whether the arc is proven.
#[test]
fn the_progress_of_the_cut_is_told_once_a_second() {
    let run = run("lose@20", "at 3s recover\n", &[]);
    let told: Vec<&Value> = run.of_kind("cut_progress").collect();
    assert!(told.len() >= 6, "{}", run.output.out);
    let of_first: Vec<&&Value> = told.iter().filter(|progress| progress["contour"] == 1).collect();
    let cut: Vec<f64> = of_first.iter().filter_map(|progress| progress["cut_mm"].as_f64()).collect();
    assert!(cut.is_sorted() && cut.last().is_some_and(|&mm| mm > 20.0 && mm < 60.0), "{cut:?}");
    assert!(of_first.iter().all(|progress| progress["length_mm"] == 60.0 && progress["contour_count"] == 3));
    let lost = of_first.iter().find(|progress| progress["state"] == "lost").expect("it is lost");
    assert_eq!((&lost["ok"], &lost["lit_s"]), (&false.into(), &0.0.into()), "{lost}");
    let cutting = of_first.iter().find(|progress| progress["state"] == "cutting").expect("it cuts");
    assert!(cutting["ok"] == true && cutting["lit_s"].as_f64().is_some_and(|s| s > 0.0), "{cutting}");
    let last = told.last().expect("some");
    assert_eq!((&last["job_length_mm"], &last["contour"]), (&110.0.into(), &3.into()));
    assert!(last["job_cut_mm"].as_f64().is_some_and(|mm| mm > 79.0 && mm < 111.0), "{last}");
}

/// Of a stream nothing is known before it runs: what is not known is null, and a contour is listed once it is begun.
#[test]
fn the_contours_of_a_stream_are_listed_as_they_are_begun() {
    let bench = bench("at 0s contours\nat line 17 contours\n");
    let arguments = ["run", "-", "--machine", "m.toml", "--operator", "s.op", "--json"];
    let run = bench.retrace_reading(arguments, PROGRAM.as_bytes());
    assert_eq!(run.code, Some(0), "{}", run.err);
    let lists = lists(&run.out);
    assert_eq!((states(&lists[0]), &lists[0]["contour_count"]), (vec![], &Value::Null));
    assert_eq!(states(&lists[1]), [row(1, "cut", 60), row(2, "cut", 20), row(3, "cut", 30)]);
    assert_eq!((&lists[1]["contours"][1]["line"], &lists[1]["contours"][1]["length_mm"]), (&4.into(), &Value::Null));
}

#[test]
fn a_person_reads_a_line_for_each_contour() {
    let bench = bench("at 2s contours\n");
    let run = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--operator", "s.op"]);
    for line in [
        "contours: 3",
        "contour 1: line 9, torch, 60.000 mm, from X 10.000 Y 0.000 to X 70.000 Y 0.000: ",
        "mm cut so far",
        "contour 2: line 4 in O100, torch, 20.000 mm, from X 100.000 Y 5.000 to X 120.000 Y 5.000: not cut yet",
    ] {
        assert!(run.out.contains(line), "no `{line}` in {}", run.out);
    }
}

const DOWN: &str = "\x1b[B";

fn at_the_screen(bench: &Bench, faults: &str) -> Terminal {
    let [program, machine] = ["part.ngc", "m.toml"].map(|name| bench.path(name).display().to_string());
    let arguments = ["run", &program, "--tui", "--machine", &machine, "--source-faults", faults];
    let terminal = Terminal::running(&arguments, 80, 24);
    terminal.wait_for_text("of motion");
    terminal
}

/// The line of the page for a contour, without the frame.
fn page_line(text: &str, number: u32) -> String {
    let is_row = |line: &&str| {
        let words: Vec<&str> = line.split(['│', '>', ' ']).filter(|word| !word.is_empty()).collect();
        words.first() == Some(&number.to_string().as_str()) && (line.contains("cut") || line.contains("CUT"))
    };
    text.lines().find(is_row).unwrap_or_else(|| panic!("no contour {number} in {text}")).to_owned()
}

/// Ready, a contour of the list is where the job begins, after a question; those before it stay uncut.
#[test]
fn at_the_screen_a_job_begins_at_a_contour_of_the_list() {
    let bench = bench("");
    let mut terminal = at_the_screen(&bench, "");
    terminal.keys("C");
    let page = terminal.wait_for_text("3 contours");
    assert!(page.contains("begin there") && page_line(&page, 2).contains("O100"), "{page}");
    assert!((1..=3).all(|number| page_line(&page, number).contains("not cut yet")), "{page}");
    terminal.keys(&format!("{DOWN}\r"));
    terminal.wait_for_text("begins at contour 2");
    terminal.keys("n");
    terminal.wait_until("the page closed", |text| !text.contains("begins at contour"));
    assert!(terminal.text().contains("READY"), "{}", terminal.text());
    terminal.keys(&format!("C{DOWN}\ry"));
    let end = terminal.wait_for_text("ENDED");
    assert!(end.contains("completed, 2 contours cut"), "{end}");
    terminal.keys("C");
    let page = terminal.wait_for_text("back to it");
    assert!(page_line(&page, 1).contains("not cut yet") && !page_line(&page, 3).contains("not"), "{page}");
    terminal.keys("\x1b");
    terminal.wait_until("the page closed", |text| !text.contains("back to it"));
    terminal.keys("q");
    assert_eq!(terminal.wait_for_end(), Some(0));
}

/// Contours of the list are skipped before the job begins, and while it runs; N again takes it back.
#[test]
fn at_the_screen_contours_of_the_list_are_skipped() {
    let bench = bench("");
    let mut terminal = at_the_screen(&bench, "");
    terminal.keys(&format!("CN{DOWN}N"));
    let page = terminal.wait_until("both skipped", |text| text.matches("to be skipped").count() == 2);
    assert!(page.contains("N skip or cut it"), "{page}");
    terminal.keys("\x1b[AN");
    let page = terminal.wait_until("one is cut after all", |text| text.matches("to be skipped").count() == 1);
    assert!(page_line(&page, 1).contains("not cut yet"), "{page}");
    terminal.keys("\x1b");
    terminal.wait_until("the page closed", |text| !text.contains("to be skipped"));
    terminal.keys("c");
    terminal.wait_for_text("contour 1 of");
    terminal.keys(&format!("C{DOWN}N{DOWN}N"));
    let page = terminal.wait_until("the third one is skipped", |text| text.matches("to be skipped").count() == 1);
    assert!(page.contains("3 ") && !page_line(&page, 2).contains("skipped"), "{page}");
    terminal.keys("\x1b");
    let end = terminal.wait_for_text("ENDED");
    assert!(end.contains("1 of 3 contours NOT cut"), "{end}");
    terminal.keys("q");
    assert_eq!(terminal.wait_for_end(), Some(0));
}

/// At the end, a contour that is not whole is gone back to from the list, and cut.
#[test]
fn at_the_screen_a_contour_of_the_list_is_cut_after_the_end() {
    let bench = bench("");
    let mut terminal = at_the_screen(&bench, "lose@20");
    terminal.keys("c");
    let lost = terminal.wait_for_text("CUT INTERRUPTED");
    assert!(lost.contains("20.0 of 60.0 mm"), "{lost}");
    terminal.keys("N");
    let end = terminal.wait_for_text("ENDED");
    assert!(end.contains("1 of 3 contours NOT cut"), "{end}");
    terminal.keys("C");
    let page = terminal.wait_for_text("mm NOT CUT");
    assert!(page_line(&page, 1).contains("40.0 mm NOT CUT"), "{page}");
    terminal.keys("\x1b[A\x1b[A\r");
    terminal.wait_until("the machine at rest behind", |text| text.contains("K cut"));
    terminal.keys("K");
    terminal.wait_for_text("contour 1 of");
    let end = terminal.wait_for_text("completed, all 3 contours cut");
    assert!(end.contains("ENDED"), "{end}");
    terminal.keys("q");
    assert_eq!(terminal.wait_for_end(), Some(0));
}

/// The handwheel is taken in a cut, held, taken again and turned: the cutter goes off once the machine rests, and stays
/// off whatever the handwheel does.
#[test]
fn a_handwheel_that_is_taken_again_leaves_the_cutter_off() {
    let machine = "[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\n";
    let script = "at 1.5s wheel 0 for 0s\nafter 0.6s hold\nafter 0.4s wheel -30 for 0.5s\nafter 1s stop\n";
    let program = "G21 G90\nG0 X5\nM3\nG1 X60 F1200\nM5\nG0 X0\nM2\n";
    let (_, samples) = retrace_tests::pins::run_with_pins(machine, program, script, &[]);
    let lit: Vec<bool> = samples.iter().map(|sample| sample.is_on("spindle")).collect();
    let off = lit.iter().rposition(|&is_lit| is_lit).expect("it was lit");
    assert_eq!(lit.windows(2).filter(|pair| pair[0] != pair[1]).count(), 2, "on once, off once");
    // Taken again, it moves backward with the cutter off.
    let furthest = samples[off].counts[0];
    assert!(samples[off..].iter().any(|sample| sample.counts[0] < furthest - 1_000), "{furthest}");
}
