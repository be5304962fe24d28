//! Sources of a streamed program.
//!
//! Invariant: a stream is read ahead of its consumer, and reading ends once it is cancelled.

use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use retrace_config::{NumberedError, SerialSettings};
use retrace_controller::{ReadAhead, SourceStatus};

use crate::files;
use crate::serial_source::{self, SerialSource};
use crate::socket::{self, Socket};

/// Source of a streamed program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StreamSource {
    /// Standard input.
    StandardInput,
    /// TCP socket at this address.
    Socket(String),
    /// Serial line at this address, with its settings.
    Serial(String),
    /// FIFO or character device.
    Device(PathBuf),
    /// File that is read as if it were streamed.
    File(PathBuf),
}

impl StreamSource {
    /// Source that the command line names; `None` for a file.
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

    /// Starts to read the stream, ahead of its consumer, until `given_up`.
    ///
    /// # Errors
    /// `E2107`, `E2101` …: no sender, or no such file.
    pub fn open(&self, opening: &StreamOpening) -> Result<ProgramStream, NumberedError> {
        Ok(match self {
            Self::StandardInput => read_ahead(std::io::stdin(), opening),
            Self::Socket(address) => read_ahead(Socket::open(address)?, opening),
            Self::Serial(address) => {
                let StreamOpening { serial, is_cancelled: given_up, status } = opening;
                Box::new(SerialSource::open(address, *serial, given_up, status)?)
            }
            Self::Device(path) => read_ahead(files::OpenedFile::on_demand(path), opening),
            Self::File(path) => {
                // A file is complete even if its last line is not terminated.
                read_ahead(files::open(path, "program")?.chain(&b"\n"[..]), opening)
            }
        })
    }
}

/// Reader of a streamed program.
pub type ProgramStream = Box<dyn BufRead + Send>;

/// Settings for opening a stream.
#[derive(Clone, Debug)]
pub struct StreamOpening {
    /// Serial settings of the machine file.
    pub serial: SerialSettings,
    /// Set when the program is no longer needed.
    pub is_cancelled: Arc<AtomicBool>,
    /// Status of the stream: whether it waits for its sender.
    pub status: Arc<SourceStatus>,
}

fn read_ahead(input: impl Read + Send + 'static, opening: &StreamOpening) -> ProgramStream {
    match ReadAhead::spawn(input, Arc::clone(&opening.is_cancelled)) {
        Ok(ahead) => Box::new(ahead.with_status(Arc::clone(&opening.status))),
        // No thread is available to read ahead.
        Err(error) => Box::new(BufReader::new(StreamBroken(error.to_string()))),
    }
}

/// Reader that returns only this error.
pub struct StreamBroken(pub String);

impl Read for StreamBroken {
    fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
        Err(io::Error::other(self.0.clone()))
    }
}
