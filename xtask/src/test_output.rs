//! What test runners print: their closing lines are added up, and what a failed test has said is kept for the end.
//!
//! Invariant: every line is printed where it came; nothing is counted but closing lines of runners.

/// Lines that are kept of each failed test: a picture of a terminal and the message above it.
const KEPT_LINES: usize = 45;

/// Characters that are kept of a line.
const KEPT_CHARACTERS: usize = 400;

/// Sum of the closing lines, and what the failed tests have said.
#[derive(Default, Debug, PartialEq, Eq)]
pub(crate) struct TestOutput {
    /// Number of tests that passed.
    pub(crate) passes: u64,
    /// Number of tests that failed.
    pub(crate) failures: u64,
    /// Number of tests that were ignored.
    pub(crate) ignored: u64,
    /// What each failed test has said, at most [`KEPT_LINES`] lines each, its name first.
    pub(crate) said: Vec<Vec<String>>,
    /// Whether the lines are those of a failed test.
    is_of_failed: bool,
}

impl TestOutput {
    /// Takes the next line.
    pub(crate) fn add(&mut self, line: &str) {
        if let Some(name) = line.strip_prefix("---- ").and_then(|line| line.strip_suffix(" stdout ----")) {
            self.said.push(vec![name.to_owned()]);
            self.is_of_failed = true;
        } else if line == "failures:" {
            self.is_of_failed = false;
        } else if let Some(closing) = line.strip_prefix("test result: ") {
            self.is_of_failed = false;
            self.count(closing);
        } else if let Some(said) = self.said.last_mut().filter(|said| self.is_of_failed && said.len() < KEPT_LINES) {
            said.push(line.trim_end().chars().take(KEPT_CHARACTERS).collect());
        }
    }

    fn count(&mut self, closing: &str) {
        for part in closing.split([';', '.']) {
            let mut words = part.split_whitespace();
            let Some(number) = words.next().and_then(|word| word.parse::<u64>().ok()) else { continue };
            match words.next() {
                Some("passed") => self.passes += number,
                Some("failed") => self.failures += number,
                Some("ignored") => self.ignored += number,
                _ => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(output: &str) -> TestOutput {
        let mut read = TestOutput::default();
        output.lines().for_each(|line| read.add(line));
        read
    }

    #[test]
    fn closing_lines_add_up() {
        let count = read(
            "test result: ok. 12 passed; 0 failed; 1 ignored; 0 measured; 3 filtered out; finished in 0.52s
test tests::x ... ok
test result: FAILED. 1 passed; 2 failed; 0 ignored; 0 measured; 0 filtered out; finished in 1.00s",
        );
        assert_eq!((count.passes, count.failures, count.ignored), (13, 2, 1));
    }

    #[test]
    fn what_failed_tests_have_said_is_kept() {
        let output = "running 2 tests
test a::b ... FAILED

failures:

---- a::b stdout ----
thread 'a::b' panicked:
too late

---- c stdout ----
other

failures:
    a::b
    c

test result: FAILED. 0 passed; 2 failed; 0 ignored; 0 measured; 0 filtered out
not of a test";
        let said = read(output).said;
        assert_eq!(said, [vec!["a::b", "thread 'a::b' panicked:", "too late", ""], vec!["c", "other", ""]]);
        let long = format!("---- a stdout ----\n{}", "a line\n".repeat(1000));
        assert_eq!(read(&long).said[0].len(), KEPT_LINES);
    }
}
