//! Runs the `retrace` command and records its output.
//!
//! Invariant: a command that hangs is ended and reported; it never hangs the tests.

use crate::json_page::JsonPage;
use std::ffi::{OsStr, OsString};
use std::fs::{self, File};
use std::io::{self, BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::thread::sleep;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Longest duration of a command.
const COMMAND_TIMEOUT: Duration = Duration::from_secs(60);

/// The exit code of a Rust program that panicked.
const PANICKED: i32 = 101;

/// Result of a command.
#[derive(Clone, Debug)]
pub struct CommandOutput {
    /// Its exit code; `None` where a signal ended it.
    pub code: Option<i32>,
    /// Its standard output.
    pub out: String,
    /// Its standard error.
    pub err: String,
}

/// Number of cases of a random test: `usual`, unless a campaign sets another one (`RETRACE_CASES`).
#[must_use]
pub fn cases(usual: u32) -> u32 {
    std::env::var("RETRACE_CASES").ok().and_then(|text| text.parse().ok()).unwrap_or(usual)
}

/// The root of the checkout.
#[must_use]
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap_or(Path::new("."))
}

/// The `retrace` binary: the one in `RETRACE_BIN`, or one that cargo builds in the profile of the tests.
///
/// # Panics
/// Where no such binary exists: no test can run.
#[must_use]
pub fn binary() -> &'static Path {
    static BINARY: OnceLock<PathBuf> = OnceLock::new();
    BINARY.get_or_init(|| match std::env::var_os("RETRACE_BIN") {
        Some(path) => PathBuf::from(path),
        None => built("retrace-cli").expect("cargo builds the retrace command"),
    })
}

/// The `retrace` command with these arguments. A check, and a program in virtual time, run at a lower priority than a
/// card that is served and its host, whose time is the clock's: many tests run at once.
#[must_use]
pub fn retrace_command<I>(arguments: I) -> Command
where
    I: IntoIterator<Item: AsRef<OsStr>>,
{
    let arguments: Vec<OsString> = arguments.into_iter().map(|argument| argument.as_ref().to_owned()).collect();
    let is_program = arguments.first().is_some_and(|name| name == "check" || name == "run");
    let is_port = |argument: &OsString| argument.to_str().is_some_and(|text| text.starts_with("/dev/"));
    let is_virtual = is_program && !arguments.iter().any(is_port);
    let mut command = if is_virtual { at_lower_priority(binary()) } else { Command::new(binary()) };
    command.args(arguments);
    command
}

/// A program that yields the processor to what runs in the clock's time.
pub(crate) fn at_lower_priority(program: &Path) -> Command {
    let mut command = Command::new("nice");
    command.args(["-n", "10"]).arg(program);
    command
}

/// The executable of a package of the workspace, which cargo builds in the profile of the tests.
pub(crate) fn built(package: &str) -> Option<PathBuf> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    command.args(["build", "--package", package, "--message-format", "json-render-diagnostics"]);
    if !cfg!(debug_assertions) {
        command.arg("--release");
    }
    let output = command.current_dir(root()).stderr(Stdio::inherit()).output().ok()?;
    let messages = String::from_utf8(output.stdout).ok()?;
    messages.lines().rev().find_map(|line| {
        let message: serde_json::Value = serde_json::from_str(line).ok()?;
        Some(PathBuf::from(message["executable"].as_str()?))
    })
}

/// A folder for one test's files, with a journal of its own; removed when it is dropped.
#[derive(Debug)]
pub struct Bench {
    folder: TempDir,
}

impl Bench {
    /// Creates an empty folder.
    ///
    /// # Panics
    /// Where the system provides none.
    #[must_use]
    pub fn new() -> Self {
        Self { folder: TempDir::new().expect("a temporary folder") }
    }

    /// Path of a file in the folder.
    #[must_use]
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a file and returns its path.
    ///
    /// # Panics
    /// Where it cannot be written.
    pub fn file(&self, name: &str, text: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, text).expect("a file of the test");
        path
    }

    /// Starts `retrace` with these arguments in this folder, to be killed; its output goes to a file of this name.
    ///
    /// # Panics
    /// Where it cannot be run.
    #[must_use]
    pub fn start(&self, arguments: &[&str], input: Stdio, result: &str) -> Child {
        let mut command = retrace_command(arguments);
        command.current_dir(self.folder.path()).env("XDG_STATE_HOME", self.path("state"));
        command.env("XDG_CONFIG_HOME", self.path("config")).env("XDG_CACHE_HOME", self.path("cache"));
        let out = File::create(self.path(result)).expect("a file of the test");
        command.stdin(input).stdout(out).stderr(Stdio::null()).spawn().expect("the retrace command runs")
    }

    /// Runs `retrace` with these arguments in this folder.
    ///
    /// # Panics
    /// Where it cannot be run, or takes longer than a minute.
    #[must_use]
    pub fn retrace<I>(&self, arguments: I) -> CommandOutput
    where
        I: IntoIterator<Item: AsRef<OsStr>>,
    {
        self.retrace_reading(arguments, b"")
    }

    /// Runs `retrace` with these arguments in this folder, and `input` as its standard input.
    ///
    /// # Panics
    /// Where it cannot be run, or takes longer than a minute.
    #[must_use]
    pub fn retrace_reading<I>(&self, arguments: I, input: &[u8]) -> CommandOutput
    where
        I: IntoIterator<Item: AsRef<OsStr>>,
    {
        let (input_path, out, err) = (self.file("stdin.txt", input), self.path("stdout.txt"), self.path("stderr.txt"));
        let arguments: Vec<OsString> = arguments.into_iter().map(|argument| argument.as_ref().to_owned()).collect();
        let mut command = retrace_command(&arguments);
        command.current_dir(self.folder.path()).env("XDG_STATE_HOME", self.path("state"));
        command.env("XDG_CONFIG_HOME", self.path("config")).env("XDG_CACHE_HOME", self.path("cache"));
        let code = finished(&mut command, &input_path, &out, &err).unwrap_or_else(|error| panic!("{error}"));
        let text = |path: &Path| String::from_utf8_lossy(&fs::read(path).unwrap_or_default()).into_owned();
        let result = CommandOutput { code, out: text(&out), err: text(&err) };
        // A diagnostic may show a line of the program with these words; it does not begin with them.
        let has_panicked = result.err.lines().any(|line| line.starts_with("thread '") && line.contains("panicked at"));
        assert!(!has_panicked && result.code != Some(PANICKED), "the command panicked:\n{}", result.err);
        assert_documented(&arguments, &result.out);
        result
    }
}

/// Checks every line of a command with `--json` against `docs/json-events.md`.
fn assert_documented(arguments: &[OsString], out: &str) {
    static PAGE: OnceLock<JsonPage> = OnceLock::new();
    let arguments: Vec<&str> = arguments.iter().filter_map(|argument| argument.to_str()).collect();
    if !arguments.contains(&"--json") || arguments.contains(&"--help") {
        return;
    }
    let page = PAGE.get_or_init(JsonPage::read);
    for line in out.lines() {
        let object: serde_json::Value = serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"));
        let checked = match (arguments[0], object["event"].as_str()) {
            ("run" | "resume", Some("report")) => page.check_section("Report of run and resume", &object),
            ("home" | "jog" | "mdi", Some("report")) => page.check_section("Report of home, jog and mdi", &object),
            ("check", _) if object["machine"].is_null() => {
                page.check_part("check", &object, &["event", "program", "diagnostics"])
            }
            ("resume", Some("resume")) => page.check_section("resume", &object),
            (command @ ("machine" | "card"), _) => page.check_section(&format!("{command} {}", arguments[1]), &object),
            ("shop", _) => page.check_section(&format!("shop {}", arguments[1]), &object),
            ("jobs", _) if arguments.contains(&"show") => page.check_section("jobs show", &object),
            ("doctor", _) if arguments.contains(&"--step-test") => page.check_section("doctor --step-test", &object),
            (command @ ("check" | "jobs" | "doctor" | "consumables"), _) => page.check_section(command, &object),
            _ => page.check_event(&object),
        };
        checked.unwrap_or_else(|error| panic!("docs/json-events.md, {arguments:?}: {error}"));
    }
}

/// Standard error and exit code of `retrace` when nobody reads more than the first line of its output.
///
/// # Panics
/// Where it cannot be run.
#[must_use]
pub fn read_one_line_of(arguments: &[&str]) -> CommandOutput {
    let mut command = Command::new(binary());
    command.args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("the retrace command runs");
    let mut out = String::new();
    if let Some(pipe) = child.stdout.take() {
        // The pipe is closed when the reader is dropped.
        let _ = BufReader::new(pipe).read_line(&mut out);
    }
    let output = child.wait_with_output().expect("the retrace command ends");
    CommandOutput { code: output.status.code(), out, err: String::from_utf8_lossy(&output.stderr).into_owned() }
}

impl Default for Bench {
    fn default() -> Self {
        Self::new()
    }
}

/// Runs a command to its end, between files: a pipe that nobody reads would block it.
fn finished(command: &mut Command, input: &Path, out: &Path, err: &Path) -> io::Result<Option<i32>> {
    let mut child = command.stdin(File::open(input)?).stdout(File::create(out)?).stderr(File::create(err)?).spawn()?;
    let started = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status.code());
        }
        if started.elapsed() > COMMAND_TIMEOUT {
            child.kill()?;
            child.wait()?;
            let text = |path| String::from_utf8_lossy(&fs::read(path).unwrap_or_default()).into_owned();
            return Err(io::Error::other(format!("did not end in time:\n{}{}", text(out), text(err))));
        }
        sleep(Duration::from_millis(2));
    }
}

/// Asserts that a text contains all of these parts.
///
/// # Panics
/// Where one of them is missing.
pub fn assert_contains(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "{part} is not in\n{text}");
    }
}
