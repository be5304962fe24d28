//! Local socket on which a command that operates a machine reports its state (SHP-2).
//!
//! `running/PID.sock` in the user's state folder. Each line is a JSON object with its kind in `t`: first `machine`,
//! then `state` and `live` as on the socket of a page (docs/serve-api.md), and `block`, the text of the program line;
//! each at a change, and once a second in any case.
//!
//! Invariant: it is written to and never read, so that nothing can be ordered over it, and a reader is never waited
//! for: what a slow one does not take is left out and counted in `lost`. The motion path does not know it.

use std::io::{ErrorKind, Write};
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use retrace_journal::{JobStore, state_file};
use retrace_tui::{ScreenModel, lock_model};
use serde_json::json;

/// Version of the messages.
const VERSION: u32 = 1;
/// Interval at which the model is looked at.
const INTERVAL: Duration = Duration::from_millis(50);
/// Interval at which all is sent though nothing has changed.
const REPEAT: Duration = Duration::from_secs(1);
/// Largest number of readers at a time.
const MAX_READERS: usize = 16;

/// Socket that is served until it is dropped.
#[derive(Debug)]
pub struct StateSocket {
    path: PathBuf,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl StateSocket {
    /// Serves the state that this model shows. None where the user has no state folder, or no socket can be made in it:
    /// the machine is operated without.
    pub fn serve(model: &Arc<Mutex<ScreenModel>>) -> Option<Self> {
        let folder = JobStore::state_folder()?.join("running");
        Self::serve_in(&folder, model)
            .inspect_err(|error| eprintln!("note: the state is not reported in {}: {error}", folder.display()))
            .ok()
    }

    fn serve_in(folder: &Path, model: &Arc<Mutex<ScreenModel>>) -> std::io::Result<Self> {
        state_file::create_private_folder(folder)?;
        remove_abandoned(folder);
        let path = folder.join(format!("{}.sock", std::process::id()));
        let listener = UnixListener::bind(&path)?;
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600))?;
        listener.set_nonblocking(true)?;
        let (model, is_over) = (Arc::clone(model), Arc::<AtomicBool>::default());
        let ends = Arc::clone(&is_over);
        let thread = thread::Builder::new().name("state socket".into()).spawn(move || {
            let _ = retrace_real_time::leave();
            Reporter { model, listener, readers: Vec::new(), sent: <[String; 3]>::default() }.run(&ends);
        })?;
        Ok(Self { path, is_over, thread: Some(thread) })
    }
}

impl Drop for StateSocket {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Removes the sockets of commands that were killed: nobody answers there.
fn remove_abandoned(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.extension().is_some_and(|end| end == "sock")
            && UnixStream::connect(&path).is_err_and(|error| error.kind() == ErrorKind::ConnectionRefused)
        {
            let _ = std::fs::remove_file(path);
        }
    }
}

/// Thread that looks at the model and writes to the readers.
struct Reporter {
    model: Arc<Mutex<ScreenModel>>,
    listener: UnixListener,
    readers: Vec<Reader>,
    /// The messages `state`, `live` and `block` as they were sent last.
    sent: [String; 3],
}

impl Reporter {
    fn run(mut self, is_over: &AtomicBool) {
        let mut repeated = Instant::now();
        while !is_over.load(Ordering::Relaxed) {
            self.accept();
            if !self.readers.is_empty() {
                let is_repetition = repeated.elapsed() >= REPEAT;
                if is_repetition {
                    repeated = Instant::now();
                }
                self.report(is_repetition);
            }
            thread::sleep(INTERVAL);
        }
        self.report(true);
    }

    fn accept(&mut self) {
        while let Ok((stream, _)) = self.listener.accept() {
            if self.readers.len() < MAX_READERS && stream.set_nonblocking(true).is_ok() {
                let mut reader = Reader { stream, rest: Vec::new(), lost: 0 };
                let model = lock_model(&self.model);
                let hello = machine_message(&model);
                drop(model);
                if reader.send(&hello) {
                    self.readers.push(reader);
                    // The new reader has nothing of what the others have.
                    self.sent = Default::default();
                }
            }
        }
    }

    fn report(&mut self, is_repetition: bool) {
        let model = lock_model(&self.model);
        let [state, live] = retrace_serve::machine_messages(&model);
        let text = model.facts.program.line(model.line as usize).map(str::trim);
        let block = json!({"t": "block", "line": model.line, "text": text}).to_string();
        drop(model);
        for (sent, message) in self.sent.iter_mut().zip([state, live, block]) {
            if is_repetition || *sent != message {
                self.readers.retain_mut(|reader| reader.send(&message));
                *sent = message;
            }
        }
    }
}

/// What does not change.
fn machine_message(model: &ScreenModel) -> String {
    let axes = model.facts.axes.iter().map(|axis| {
        let is_linear = !"abc".contains(axis.letter);
        json!({"letter": axis.letter.to_string(), "travel_mm": axis.travel_mm, "is_linear": is_linear})
    });
    json!({
        "t": "machine",
        "version": VERSION,
        "program_version": env!("CARGO_PKG_VERSION"),
        "name": model.facts.machine,
        "process": std::process::id(),
        "axes": axes.collect::<Vec<_>>(),
    })
    .to_string()
}

/// A reader, with the rest of the message that it has not taken whole.
struct Reader {
    stream: UnixStream,
    rest: Vec<u8>,
    /// Number of messages that were left out since.
    lost: u64,
}

impl Reader {
    /// Sends a message, or leaves it out where the one before is not taken. False where the reader is gone.
    fn send(&mut self, message: &str) -> bool {
        if !self.flush() {
            return false;
        }
        if !self.rest.is_empty() {
            self.lost += 1;
            return true;
        }
        let lost = std::mem::take(&mut self.lost);
        if lost > 0 {
            self.rest.extend_from_slice(json!({"t": "lost", "messages": lost}).to_string().as_bytes());
            self.rest.push(b'\n');
        }
        self.rest.extend_from_slice(message.as_bytes());
        self.rest.push(b'\n');
        self.flush()
    }

    /// Writes what the reader takes of the rest. False where it is gone.
    fn flush(&mut self) -> bool {
        while !self.rest.is_empty() {
            match self.stream.write(&self.rest) {
                Ok(0) => return false,
                Ok(written) => drop(self.rest.drain(..written)),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return error.kind() == ErrorKind::WouldBlock,
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use std::io::{BufRead as _, BufReader};

    use super::*;

    /// Every line that comes is whole, and what is missing is counted.
    #[test]
    fn a_slow_reader_has_whole_messages_and_the_number_of_those_left_out() {
        let (stream, other) = UnixStream::pair().expect("a pair");
        stream.set_nonblocking(true).expect("a socket");
        let mut reader = Reader { stream, rest: Vec::new(), lost: 0 };
        let message = |number: u32| json!({"t": "live", "number": number, "text": "x".repeat(5_000)}).to_string();
        let sent = 200;
        assert!((0..sent).all(|number| reader.send(&message(number))), "it is there");
        assert!(reader.lost > 0 && !reader.rest.is_empty(), "it takes no more");
        let mut lines = BufReader::new(other).lines().map(|line| line.expect("a line"));
        let mut next = 0;
        let lost = loop {
            let line: serde_json::Value = serde_json::from_str(&lines.next().expect("a line")).expect("whole");
            assert_eq!(line["number"], next, "nothing is left out before");
            next += 1;
            if next == sent - u32::try_from(reader.lost).expect("few") - 1 {
                // The last one that it has taken in part; there is room for its rest now.
                assert!(reader.send(&message(sent)));
                lines.next().expect("its rest");
                break serde_json::from_str::<serde_json::Value>(&lines.next().expect("a line")).expect("whole");
            }
        };
        assert_eq!((lost["t"].as_str(), lost["messages"].as_u64()), (Some("lost"), Some(u64::from(sent - next - 1))));
        let last: serde_json::Value = serde_json::from_str(&lines.next().expect("a line")).expect("whole");
        assert_eq!(last["number"], sent);
        drop(lines);
        assert!(!reader.send("{}"), "it is gone");
    }
}
