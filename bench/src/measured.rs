//! Runs a program and measures its processor time and its greatest memory.
//!
//! Invariant: the figures are the child's own, from the kernel's account of it; a child that fails is not a
//! measurement.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Result of one run.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Taken {
    /// Processor time, seconds.
    pub(crate) cpu_s: f64,
    /// From start to end, seconds.
    pub(crate) wall_s: f64,
    /// Greatest resident memory that was seen, MiB.
    pub(crate) rss_mib: f64,
}

/// A command that is measured, and the folder that it runs in and that is its home.
pub(crate) struct Measured {
    pub(crate) program: PathBuf,
    pub(crate) arguments: Vec<String>,
    pub(crate) folder: PathBuf,
}

impl Measured {
    fn spawn(&self, input: Stdio) -> Result<Child, String> {
        let mut command = Command::new(&self.program);
        command.args(&self.arguments).current_dir(&self.folder).env("HOME", &self.folder);
        command.stdin(input).stdout(Stdio::null()).stderr(Stdio::null());
        command.spawn().map_err(|error| format!("{} cannot be run: {error}", self.program.display()))
    }

    /// Runs the command once.
    pub(crate) fn run(&self) -> Result<Taken, String> {
        self.watch(self.spawn(Stdio::null())?, Instant::now())
    }

    /// Runs the command once with the output of `feed` as its input.
    pub(crate) fn run_fed(&self, feed: impl FnOnce(&mut dyn Write) + Send) -> Result<Taken, String> {
        let started = Instant::now();
        let mut child = self.spawn(Stdio::piped())?;
        let input = child.stdin.take();
        std::thread::scope(|scope| {
            scope.spawn(move || {
                if let Some(mut input) = input {
                    feed(&mut input);
                }
            });
            self.watch(child, started)
        })
    }

    /// Waits for the end, reading the kernel's account at intervals. The account of an ended child remains until its
    /// exit status is read.
    fn watch(&self, mut child: Child, started: Instant) -> Result<Taken, String> {
        let account = PathBuf::from(format!("/proc/{}", child.id()));
        let mut taken = Taken::default();
        let mut pause = Duration::from_micros(200);
        loop {
            let status = read(&account.join("status"));
            let field = |name: &str| status.lines().find_map(|line| line.strip_prefix(name)).unwrap_or("").trim();
            if let Some(kib) = field("VmHWM:").strip_suffix(" kB").and_then(|kib| kib.parse::<f64>().ok()) {
                taken.rss_mib = taken.rss_mib.max(kib / 1024.0);
            }
            if field("State:").starts_with('Z') || status.is_empty() {
                break;
            }
            std::thread::sleep(pause);
            // Reading costs processor time, of which there may be little.
            pause = (pause * 2).min(Duration::from_millis(4));
        }
        taken.wall_s = started.elapsed().as_secs_f64();
        let schedule = read(&account.join("schedstat"));
        let nanoseconds = schedule.split_whitespace().next().and_then(|number| number.parse::<f64>().ok());
        let ended = child.wait().map_err(|error| error.to_string())?;
        if !ended.success() {
            return Err(format!("{} {}: {ended}", self.program.display(), self.arguments.join(" ")));
        }
        let nanoseconds = nanoseconds.ok_or("the kernel does not tell what a process takes (/proc/…/schedstat)")?;
        taken.cpu_s = nanoseconds / 1e9;
        Ok(taken)
    }
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_default()
}

/// The middle one, or the mean of the two in the middle.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => f64::NAN,
        even if even % 2 == 0 => (values[middle - 1] + values[middle]) / 2.0,
        _ => values[middle],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_the_one_in_the_middle() {
        assert!((median(vec![9.0, 1.0, 2.0]) - 2.0).abs() < 1e-12);
        assert!((median(vec![9.0, 1.0, 2.0, 4.0]) - 3.0).abs() < 1e-12);
        assert!(median(Vec::new()).is_nan());
    }

    #[test]
    fn a_run_is_measured_and_one_that_fails_is_told() {
        let shell = |text: &str| Measured {
            program: "sh".into(),
            arguments: vec!["-c".into(), text.into()],
            folder: std::env::temp_dir(),
        };
        let taken = shell("i=0; while [ $i -lt 20000 ]; do i=$((i+1)); done").run().expect("it ends well");
        assert!(taken.cpu_s > 0.0 && taken.cpu_s <= taken.wall_s * 1.5 && taken.rss_mib > 0.1, "{taken:?}");
        assert!(shell("exit 3").run().is_err());
        let counted = shell("[ $(wc -c) -eq 5 ]").run_fed(|input| {
            let _ = input.write_all(b"12345");
        });
        assert!(counted.is_ok(), "{counted:?}");
    }
}
