//! The examples of an interrupted cut and its recovery, followed as their pages say.

use retrace_tests::command::{Bench, root};
use retrace_tests::run::Run;
use std::fs;

/// The pages, in `examples/`.
const PAGES: [&str; 3] = ["18-lost-arc.md", "19-lost-pressure.md", "20-lost-beam.md"];

/// A page with its command for the shell.
struct ExamplePage {
    text: String,
    arguments: Vec<String>,
}

impl ExamplePage {
    fn read(name: &str) -> Self {
        let text = fs::read_to_string(root().join("examples").join(name)).expect("a page");
        let command = text.lines().find(|line| line.starts_with("    retrace run") && line.contains("--operator"));
        let words = command.unwrap_or_else(|| panic!("{name} has a command")).split_whitespace().skip(1);
        let absolute = |word: &str| match word.starts_with("examples/") {
            true => root().join(word).display().to_string(),
            false => word.to_owned(),
        };
        let arguments = words.map(absolute).collect();
        Self { text, arguments }
    }

    fn program(&self) -> &str {
        &self.arguments[1]
    }

    /// Value of an option.
    fn option(&self, name: &str) -> &str {
        let at = self.arguments.iter().position(|word| word == name).unwrap_or_else(|| panic!("{name}"));
        &self.arguments[at + 1]
    }

    /// What the page says that the command prints, in its order: the code of the first column of its table.
    fn printed(&self) -> Vec<&str> {
        let rows = self.text.lines().filter(|line| line.starts_with("| `"));
        let cells = rows.filter_map(|row| row.split('|').nth(1));
        let printed = cells.flat_map(|cell| cell.split('`').skip(1).step_by(2));
        printed.map(|words| words.trim_end_matches(" …")).collect()
    }

    /// Runs it for a script, without its loss and its operator, or with them.
    fn run(&self, is_lost: bool) -> Run {
        let mut more = vec!["--machine", self.option("--machine")];
        if is_lost {
            more.extend(["--source-faults", "--operator"].iter().flat_map(|name| [*name, self.option(name)]));
        }
        Run::of(&Bench::new(), self.program().as_ref(), &more)
    }

    /// Runs it for a person, with this operator, and returns what it prints.
    fn text_with(&self, operator: &str) -> String {
        let arguments =
            self.arguments.iter().map(|word| if word == self.option("--operator") { operator } else { word });
        with_single_spaces(&Bench::new().retrace(arguments).out)
    }
}

fn with_single_spaces(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[test]
fn an_interrupted_cut_is_recovered_as_its_page_says() {
    for name in PAGES {
        let page = ExamplePage::read(name);
        let out = page.text_with(page.option("--operator"));
        let mut rest = out.as_str();
        let printed = page.printed();
        assert!(printed.len() >= 10, "{name}: {printed:?}");
        for words in printed {
            let words = with_single_spaces(words);
            let at = rest.find(&words).unwrap_or_else(|| panic!("{name}: `{words}` is not in\n{rest}"));
            rest = &rest[at + words.len()..];
        }
    }
}

#[test]
fn a_recovered_example_is_as_whole_as_without_a_loss() {
    for name in PAGES {
        let page = ExamplePage::read(name);
        let (whole, lost) = (page.run(false), page.run(true));
        for (run, interruptions) in [(&whole, 0.0), (&lost, 1.0)] {
            run.assert_exact_and_legal();
            assert_eq!(run.number("cut_interruptions"), interruptions, "{name}: {}", run.report);
            assert_eq!(
                (run.number("contours_not_cut"), run.number("not_cut_mm")),
                (0.0, 0.0),
                "{name}: {}",
                run.report
            );
        }
        assert!(whole.number("contours") >= 4.0, "{name}: {}", whole.report);
        assert_eq!(whole.number("contours"), lost.number("contours"), "{name}");
        assert_eq!(whole.counts(), lost.counts(), "{name}");
        // every event has the line at which the machine is
        let moved = lost.events.iter().skip_while(|event| event["line"] == 0);
        let nowhere: Vec<_> = moved.filter(|event| event["line"] == 0).collect();
        assert_eq!(nowhere, [&serde_json::Value::Null; 0], "{name}");
    }
}

/// Without a recovery, the cutter starts where the machine came to rest: the report says what is missing.
#[test]
fn an_example_that_is_not_recovered_hangs_on_a_bridge() {
    let bench = Bench::new();
    let operator = bench.file("agree.op", "at 20s resume\nafter 1s agree\n").display().to_string();
    let page = ExamplePage::read("19-lost-pressure.md");
    let missing = page.text.split('`').find(|words| words.contains("not whole 1")).expect("the figures of the page");
    let out = page.text_with(&operator);
    assert!(out.contains(missing), "`{missing}` is not in\n{out}");
}

/// S is the power of a laser, and no speed of a spindle.
#[test]
fn a_laser_has_no_spindle_speed() {
    let page = ExamplePage::read("20-lost-beam.md");
    let check = Bench::new().retrace(["check", page.program(), "--machine", page.option("--machine")]);
    assert!(check.out.contains("feed 2400.0 mm/min · S 1500.0\n"), "{}", check.out);
}

/// The first two lines of each screen, and its messages, as far as they do not depend on the time.
#[cfg(unix)]
#[test]
fn a_recovery_at_the_screen_is_as_its_page_shows() {
    use retrace_tests::terminal::Terminal;

    let page = fs::read_to_string(root().join("docs/recovering-a-cut.md")).expect("the page");
    let command = page.lines().find(|line| line.starts_with("    retrace run")).expect("a command");
    let arguments: Vec<&str> = command.split_whitespace().skip(1).collect();
    let screens: Vec<&str> =
        page.split("```text\n").skip(1).map(|block| block.split("\n```").next().unwrap_or_default()).collect();
    let [lost, returning, cutting, end] = screens.as_slice() else { panic!("{} screens", screens.len()) };
    let second_line = |screen: &str| screen.lines().nth(1).unwrap_or_default().trim_end().to_owned();
    let message = |screen: &str, words: &str| {
        let line = screen.lines().find(|line| line.contains(words)).unwrap_or_else(|| panic!("`{words}`\n{screen}"));
        line.split_once(" s ").expect("a time").1.to_owned()
    };
    let (columns, rows) = (100, lost.lines().count() as u16);
    let mut terminal = Terminal::running(&arguments, columns, rows);
    terminal.wait_for_text("READY");
    terminal.keys("c");
    terminal.wait_for_text("CUT INTERRUPTED");
    let shown = terminal.wait_for_text(&message(lost, "torch: the cut ends"));
    assert_eq!((second_line(&shown), rows), (second_line(lost), 30), "{shown}");
    terminal.keys("k");
    // these may be on the screen for a moment only
    for (screen, words) in [(returning, "operator:"), (cutting, "the cut goes on")] {
        terminal.wait_for_text(&message(screen, words));
    }
    let shown = terminal.wait_for_text("ENDED");
    assert_eq!(second_line(&shown), second_line(end), "{shown}");
    terminal.keys("q");
    assert_eq!(terminal.wait_for_end(), Some(0));
    let report = page.split('`').find(|words| words.starts_with("contours")).expect("the figures of the page");
    terminal.wait_for_text(report);
}
