//! `retrace shop sparkplug` as a process of a test.
//!
//! Invariant: it is ended with the test, however that ends.

use std::fs::File;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::command::{Bench, binary};

/// Longest wait for anything that the node prints or does.
const LONG: Duration = Duration::from_secs(30);

/// The command, ended with the test. Its shop file is `shop.toml` of the bench, its machine `mill` of the group `shop`.
#[derive(Debug)]
pub struct SparkplugNode {
    child: Child,
}

impl SparkplugNode {
    /// Starts it with this broker and these further keys of `[sparkplug]`.
    ///
    /// # Panics
    /// Where it cannot be run.
    #[must_use]
    pub fn start(bench: &Bench, broker: &str, keys: &str) -> Self {
        bench.file("shop.toml", format!("name = \"mill\"\n[sparkplug]\nbroker = \"{broker}\"\n{keys}"));
        let mut command = Command::new(binary());
        command.args(["shop", "sparkplug", "--shop-file"]).arg(bench.path("shop.toml"));
        command.env("XDG_STATE_HOME", bench.path("state")).stdin(Stdio::null());
        command.stdout(File::create(bench.path("node.txt")).expect("a file"));
        command.stderr(File::create(bench.path("errors.txt")).expect("a file"));
        Self { child: command.spawn().expect("it runs") }
    }

    /// Waits until it prints this, on either of its outputs.
    ///
    /// # Panics
    /// Where it does not.
    pub fn wait_for(bench: &Bench, text: &str) -> String {
        let begun = Instant::now();
        loop {
            let read = |name| std::fs::read_to_string(bench.path(name)).unwrap_or_default();
            let printed = read("node.txt") + &read("errors.txt");
            if printed.contains(text) {
                return printed;
            }
            assert!(begun.elapsed() < LONG, "{text} is not in\n{printed}");
            sleep(Duration::from_millis(20));
        }
    }

    /// Number of its process.
    #[must_use]
    pub fn process_id(&self) -> u32 {
        self.child.id()
    }

    /// Waits until it ends by itself.
    ///
    /// # Panics
    /// Where it cannot be waited for.
    pub fn wait(&mut self) -> ExitStatus {
        self.child.wait().expect("it ends")
    }

    /// Kills it with SIGKILL.
    ///
    /// # Panics
    /// Where it was ended before.
    pub fn kill(&mut self) {
        self.child.kill().expect("it is killed");
        self.child.wait().expect("it ends");
    }

    /// Ends it by SIGTERM.
    ///
    /// # Panics
    /// Where it does not end.
    pub fn end(&mut self) -> ExitStatus {
        let number = self.child.id().to_string();
        Command::new("kill").args(["-TERM", &number]).status().expect("it is sent");
        let begun = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().expect("a child") {
                return status;
            }
            assert!(begun.elapsed() < LONG, "it does not end");
            sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for SparkplugNode {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
