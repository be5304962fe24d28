//! Where a program arrives from, and how it is read from there.
//!
//! Invariant: whatever arrives is read ahead of whoever takes it, and nobody waits for it any more once it is given up.

use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use retrace_controller::machine::SerialSettings;
use retrace_controller::numbered_error::NumberedError;
use retrace_controller::read_ahead::{ReadAhead, SourceStatus};

use crate::files;
use crate::serial_source::{self, SerialSource};
use crate::socket::{self, Socket};

/// Where a program arrives from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StreamSource {
    /// Standard input.
    StandardInput,
    /// A TCP socket at this address.
    Socket(String),
    /// A serial line at this address, with its settings.
    Serial(String),
    /// A FIFO or a character device.
    Device(PathBuf),
    /// A file that is read as if it arrived.
    File(PathBuf),
}

impl StreamSource {
    /// What the command line names, if that arrives.
    #[must_use]
    pub fn named(program: &Path) -> Option<Self> {
        let Some(name) = program.to_str() else { return Self::device(program) };
        if name == "-" {
            return Some(Self::StandardInput);
        }
        socket::address(name)
            .map(|at| Self::Socket(at.into()))
            .or_else(|| serial_source::address(name).map(|at| Self::Serial(at.into())))
            .or_else(|| Self::device(program))
    }

    fn device(path: &Path) -> Option<Self> {
        files::is_stream(path).then(|| Self::Device(path.to_owned()))
    }

    /// Begins to read it, ahead of whoever takes it, until `given_up`.
    ///
    /// # Errors
    /// `E2107`, `E2101` …: there is nobody, or no such file.
    pub fn open(&self, opening: &StreamOpening) -> Result<ProgramStream, NumberedError> {
        Ok(match self {
            Self::StandardInput => ahead(std::io::stdin(), opening),
            Self::Socket(address) => ahead(Socket::open(address)?, opening),
            Self::Serial(address) => {
                let StreamOpening { serial, given_up, status } = opening;
                Box::new(SerialSource::open(address, *serial, given_up, status)?)
            }
            Self::Device(path) => ahead(files::OpenedFile::on_demand(path), opening),
            Self::File(path) => {
                // A file is whole also where its last line is not terminated.
                ahead(files::open(path, "program")?.chain(&b"\n"[..]), opening)
            }
        })
    }
}

/// A program as it arrives.
pub type ProgramStream = Box<dyn BufRead + Send>;

/// What a program that arrives is read with.
#[derive(Clone, Debug)]
pub struct StreamOpening {
    /// The machine file's settings of serial lines.
    pub serial: SerialSettings,
    /// Set when nobody waits for the program any more.
    pub given_up: Arc<AtomicBool>,
    /// Shows whether its sender is waited for.
    pub status: Arc<SourceStatus>,
}

fn ahead(input: impl Read + Send + 'static, opening: &StreamOpening) -> ProgramStream {
    match ReadAhead::of(input, Arc::clone(&opening.given_up)) {
        Ok(ahead) => Box::new(ahead.with_status(Arc::clone(&opening.status))),
        // No thread left to read ahead.
        Err(error) => Box::new(BufReader::new(StreamBroken(error.to_string()))),
    }
}

/// A reader that has only this to say.
pub struct StreamBroken(pub String);

impl Read for StreamBroken {
    fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
        Err(io::Error::other(self.0.clone()))
    }
}
