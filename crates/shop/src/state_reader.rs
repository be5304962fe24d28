//! Reads the local sockets on which commands report the state of their machine (SHP-2).
//!
//! Invariant: it waits for nothing, and its memory is bounded.

use std::fs;
use std::io::{ErrorKind, Read};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::machine_report::{MachineReport, ReportedAxis};

/// Longest message; a longer one ends the connection.
const MAX_MESSAGE: usize = 1 << 20;
/// Interval at which a command is looked for.
const LOOK: Duration = Duration::from_millis(200);

/// Reader of the newest command's socket.
#[derive(Debug)]
pub struct StateReader {
    folder: PathBuf,
    stream: Option<UnixStream>,
    rest: Vec<u8>,
    looked: Option<Instant>,
    axes: Vec<ReportedAxis>,
}

impl StateReader {
    /// Reader of the sockets in this folder, `running` in the user's state folder.
    #[must_use]
    pub fn new(folder: PathBuf) -> Self {
        Self { folder, stream: None, rest: Vec::new(), looked: None, axes: Vec::new() }
    }

    /// Axes of the machine that was read last.
    #[must_use]
    pub fn axes(&self) -> &[ReportedAxis] {
        &self.axes
    }

    /// Takes what has come into the report.
    pub fn read(&mut self, report: &mut MachineReport) {
        if self.stream.is_none() {
            if self.looked.is_some_and(|looked| looked.elapsed() < LOOK) {
                return;
            }
            self.looked = Some(Instant::now());
            self.stream = self.connect();
        }
        let mut buffer = [0; 16_384];
        while let Some(stream) = &mut self.stream {
            match stream.read(&mut buffer) {
                Ok(0) => self.end(report),
                Ok(count) => {
                    self.rest.extend_from_slice(&buffer[..count]);
                    self.take_lines(report);
                    if self.rest.len() > MAX_MESSAGE {
                        self.end(report);
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => self.end(report),
            }
        }
    }

    fn end(&mut self, report: &mut MachineReport) {
        (self.stream, self.looked) = (None, None);
        self.rest.clear();
        report.forget();
    }

    /// The newest socket on which somebody answers.
    fn connect(&self) -> Option<UnixStream> {
        let mut sockets: Vec<_> = fs::read_dir(&self.folder)
            .ok()?
            .flatten()
            .filter(|entry| entry.path().extension().is_some_and(|end| end == "sock"))
            .filter_map(|entry| Some((entry.metadata().ok()?.modified().ok()?, entry.path())))
            .collect();
        sockets.sort_unstable();
        let stream = sockets.iter().rev().find_map(|(_, path)| UnixStream::connect(path).ok())?;
        stream.set_nonblocking(true).ok()?;
        Some(stream)
    }

    fn take_lines(&mut self, report: &mut MachineReport) {
        while let Some(end) = self.rest.iter().position(|&byte| byte == b'\n') {
            let line: Vec<u8> = self.rest.drain(..=end).collect();
            let Ok(message) = serde_json::from_slice::<Value>(&line) else { continue };
            if message["t"] == "machine" {
                self.axes = axes(&message);
            }
            report.take(message);
        }
    }
}

fn axes(message: &Value) -> Vec<ReportedAxis> {
    let axes = message["axes"].as_array().into_iter().flatten();
    let axis = |axis: &Value| {
        let letter = axis["letter"].as_str()?.chars().next().filter(char::is_ascii_lowercase)?;
        Some(ReportedAxis { letter, is_linear: axis["is_linear"] == true })
    };
    axes.filter_map(axis).collect()
}
