//! Runs other programs with a time limit and stores their output; several at a time.
//!
//! Invariant: a program that is terminated has ended when its run is over; none is left running.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// A run that is over.
#[derive(Debug)]
pub struct Ended {
    /// `None`: it exceeded its time limit.
    pub status: Option<ExitStatus>,
    /// Its standard output.
    pub output: String,
    /// Its standard error.
    pub errors: String,
    /// From start to end.
    pub seconds: f64,
}

impl Ended {
    /// Whether it ended by itself with exit code 0.
    pub fn passed(&self) -> bool {
        self.status.is_some_and(|status| status.success())
    }

    /// Whether it ended by itself with this exit code.
    pub fn exited_with(&self, code: i32) -> bool {
        self.status.and_then(|status| status.code()) == Some(code)
    }

    /// The last lines of its output, for a message.
    pub fn last_words(&self) -> String {
        let result = if self.errors.trim().is_empty() { &self.output } else { &self.errors };
        let lines: Vec<&str> = result.lines().filter(|line| !line.trim().is_empty()).collect();
        lines[lines.len().saturating_sub(12)..].join("\n")
    }
}

/// Runs a command to its end, or for `limit` at most; its output goes to files named after `log`.
///
/// # Errors
/// Where it cannot be started, or its output cannot be stored.
pub fn run(command: &mut Command, limit: Duration, log: &Path) -> Result<Ended, String> {
    let name = command_name(command);
    let paths = [log.with_extension("out"), log.with_extension("err")];
    let [out, err] = [&paths[0], &paths[1]].map(|path| create(path));
    let started = Instant::now();
    let child = command.stdin(Stdio::null()).stdout(out?).stderr(err?).spawn();
    let mut child = child.map_err(|error| format!("{name} cannot be run: {error}"))?;
    let status = loop {
        match child.try_wait().map_err(|error| error.to_string())? {
            Some(status) => break Some(status),
            None if started.elapsed() < limit => std::thread::sleep(Duration::from_millis(20)),
            None => {
                // it may have ended by itself in between; either way it is waited for
                let _ = child.kill();
                child.wait().map_err(|error| error.to_string())?;
                break None;
            }
        }
    };
    let seconds = started.elapsed().as_secs_f64();
    let [output, errors] = paths.map(|path| text(&path));
    Ok(Ended { status, output, errors, seconds })
}

/// Runs a command that must succeed, and returns its output.
///
/// # Errors
/// The last lines of its output, where it does not.
pub fn done(command: &mut Command, limit: Duration, log: &Path) -> Result<String, String> {
    let ended = run(command, limit, log)?;
    match ended.status {
        Some(status) if status.success() => Ok(ended.output),
        Some(_) => Err(format!("{} failed:\n{}", command_name(command), ended.last_words())),
        None => Err(format!("{} took longer than {} s", command_name(command), limit.as_secs())),
    }
}

fn command_name(command: &Command) -> String {
    let arguments = command.get_args().next().map(|argument| argument.to_string_lossy().into_owned());
    format!("`{} {} …`", command.get_program().to_string_lossy(), arguments.unwrap_or_default())
}

fn create(path: &Path) -> Result<File, String> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    }
    File::create(path).map_err(|error| format!("{}: {error}", path.display()))
}

fn text(path: &Path) -> String {
    std::fs::read(path).map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).unwrap_or_default()
}

/// Calls `work` with every item, `workers` at a time.
pub fn each<T: Sync>(items: &[T], workers: usize, work: impl Fn(&T) + Sync) {
    let next = Mutex::new(items.iter());
    std::thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| {
                loop {
                    let item = next.lock().ok().and_then(|mut items| items.next());
                    match item {
                        Some(item) => work(item),
                        None => break,
                    }
                }
            });
        }
    });
}

/// How many programs are run at a time: two, or one on a machine with one core. The figures in the ledger are those of
/// two.
pub fn workers() -> usize {
    std::thread::available_parallelism().map_or(1, |cores| cores.get().min(2))
}

/// Cargo, the one that started this task, in a folder of this checkout or of a copy.
pub fn cargo(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(arguments).current_dir(folder);
    command
}

/// Runs a build whose messages are JSON, and returns where cargo put the last executable.
///
/// # Errors
/// Where cargo cannot be run, or the build fails or names no executable.
pub fn build(command: &mut Command) -> Result<PathBuf, String> {
    executable_of(command, |_| true)
}

/// Runs a build whose messages are JSON, and returns where cargo put the executable of this file name.
///
/// # Errors
/// Where cargo cannot be run, or the build fails or names no such executable.
pub fn build_named(command: &mut Command, name: &str) -> Result<PathBuf, String> {
    executable_of(command, |path| path.file_stem().is_some_and(|stem| stem == name))
}

fn executable_of(command: &mut Command, is_wanted: impl FnMut(&PathBuf) -> bool) -> Result<PathBuf, String> {
    let output = command.stderr(Stdio::inherit()).output().map_err(|error| format!("cargo cannot be run: {error}"))?;
    if !output.status.success() {
        return Err("it does not build".to_owned());
    }
    let wanted = executables(&String::from_utf8_lossy(&output.stdout)).into_iter().rfind(is_wanted);
    wanted.ok_or_else(|| "cargo did not say where it put the executable".to_owned())
}

/// The executables that cargo's JSON messages name, each once.
pub fn executables(messages: &str) -> Vec<PathBuf> {
    let named = messages.lines().filter_map(|line| {
        let message: serde_json::Value = serde_json::from_str(line).ok()?;
        Some(PathBuf::from(message.get("executable")?.as_str()?))
    });
    named.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn log(name: &str) -> PathBuf {
        std::env::temp_dir().join(format!("retrace-xtask-{}-{name}", std::process::id()))
    }

    #[test]
    fn a_run_keeps_what_was_said_and_is_cut_off_after_its_time() {
        let cargo_version = run(Command::new("cargo").arg("--version"), Duration::from_secs(60), &log("a"));
        assert!(cargo_version.is_ok_and(|ended| ended.passed() && ended.output.starts_with("cargo")));
        let cut = run(Command::new("sleep").arg("60"), Duration::from_millis(100), &log("b"));
        assert!(cut.is_ok_and(|ended| ended.status.is_none() && ended.seconds < 30.0));
        assert!(run(&mut Command::new("no-such-program-of-ours"), Duration::from_secs(1), &log("c")).is_err());
        assert!(done(Command::new("cargo").arg("no-such-task"), Duration::from_secs(60), &log("d")).is_err());
    }

    #[test]
    fn the_command_is_where_cargo_says() {
        let messages =
            "{\"executable\":null}\n{\"executable\":\"x/target/debug/retrace\",\"fresh\":true}\n{\"success\":true}\n";
        assert_eq!(executables(messages), [PathBuf::from("x/target/debug/retrace")]);
        assert!(executables("{\"executable\":null}").is_empty());
    }

    #[test]
    fn each_does_all_the_work_once() {
        let done = Mutex::new(Vec::new());
        each(&[1, 2, 3, 4, 5], 2, |item| done.lock().unwrap().push(*item));
        let mut done = done.into_inner().unwrap();
        done.sort_unstable();
        assert_eq!(done, [1, 2, 3, 4, 5]);
    }
}
