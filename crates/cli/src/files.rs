//! Reading the files that the command line names.
//!
//! Invariant: a file that cannot be read is refused with its name, the reason and what to do; nothing has moved then.

use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::{Path, PathBuf};

use retrace_controller::journal::hash::FileHash;
use retrace_controller::machine::MachineConfig;
use retrace_controller::numbered_error::NumberedError;
use retrace_controller::operator::{self, ScriptInstruction};
use retrace_gcode::Text;

/// Whether a path leads to a FIFO or a character device, which is read as a stream.
#[cfg(unix)]
#[must_use]
pub fn is_stream(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt;
    std::fs::metadata(path).is_ok_and(|file| file.file_type().is_fifo() || file.file_type().is_char_device())
}

/// Elsewhere a stream is named otherwise.
#[cfg(not(unix))]
#[must_use]
pub fn is_stream(_: &Path) -> bool {
    false
}

/// A file that is opened when it is read for the first time: a FIFO is there only when somebody writes to it.
#[derive(Debug)]
pub struct OpenedFile {
    path: PathBuf,
    file: Option<File>,
}

impl OpenedFile {
    /// Opens nothing yet.
    #[must_use]
    pub fn on_demand(path: &Path) -> Self {
        Self { path: path.to_owned(), file: None }
    }
}

impl Read for OpenedFile {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let file = match &mut self.file {
            Some(file) => file,
            None => self.file.insert(File::open(&self.path)?),
        };
        file.read(into)
    }
}

/// The longest file that is read whole: a table, a machine file, a script.
const MAX_WHOLE: u64 = 64 << 20;

/// Opens a file; `what` says what it is meant to be.
///
/// # Errors
/// `E2101` … `E2104`: absent, a folder, not allowed, not readable. `E2312`: a device.
pub fn open(path: &Path, what: &str) -> Result<File, NumberedError> {
    if path.is_dir() {
        return Err(NumberedError::new(
            "E2102",
            format!("{} is a folder, not a {what}", path.display()),
            "name a file in it",
        ));
    }
    if is_device(path) {
        return Err(NumberedError::new(
            "E2312",
            format!("{} is a device, not a {what}", path.display()),
            "name a file",
        ));
    }
    File::open(path).map_err(|error| unreadable(path, what, &error))
}

/// Reads a program: its text, and its hash where the text is not held. Of a text that is held the hash can be had from it, and most commands ask
/// for none.
///
/// # Errors
/// As [`open`].
pub fn program(path: &Path) -> Result<(Text, Option<FileHash>), NumberedError> {
    let file = open(path, "program")?;
    let is_small = file.metadata().is_ok_and(|about| about.len() <= Text::MAX_HELD);
    let mut hash = FileHash::of(b"");
    let text = Text::read(file, |part| {
        if !is_small {
            hash = hash.extend(part);
        }
    });
    let text = text.map_err(|error| unreadable(path, "program", &error))?;
    let hash = match text.held() {
        Some(_) => None,
        None if is_small => Some(self::hash(path, "program")?),
        None => Some(hash),
    };
    Ok((text, hash))
}

/// The hash of a file, which is not held.
///
/// # Errors
/// As [`open`].
pub fn hash(path: &Path, what: &str) -> Result<FileHash, NumberedError> {
    FileHash::of_reader(open(path, what)?).map_err(|error| unreadable(path, what, &error))
}

/// Reads a file whole; `what` says what it is meant to be.
///
/// # Errors
/// As [`open`]; `E2312` for one of more than 64 MiB.
pub fn bytes(path: &Path, what: &str) -> Result<Vec<u8>, NumberedError> {
    let mut bytes = Vec::new();
    let file = open(path, what)?;
    let length = file.metadata().map_or(0, |file| file.len());
    let read = if length > MAX_WHOLE { Ok(0) } else { file.take(MAX_WHOLE + 1).read_to_end(&mut bytes) };
    read.map_err(|error| unreadable(path, what, &error))?;
    if length.max(bytes.len() as u64) > MAX_WHOLE {
        let what = format!("{} has more than {} MiB: it is not a {what}", path.display(), MAX_WHOLE >> 20);
        return Err(NumberedError::new("E2312", what, "name the right file"));
    }
    Ok(bytes)
}

/// Whether a path leads to a character or block device.
#[cfg(unix)]
fn is_device(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt;
    std::fs::metadata(path).is_ok_and(|file| file.file_type().is_char_device() || file.file_type().is_block_device())
}

/// Elsewhere devices have no files.
#[cfg(not(unix))]
fn is_device(_: &Path) -> bool {
    false
}

/// Why a file cannot be read.
fn unreadable(path: &Path, what: &str, error: &io::Error) -> NumberedError {
    let shown = path.display();
    match error.kind() {
        ErrorKind::NotFound => NumberedError::new(
            "E2101",
            format!("there is no {what} {shown}"),
            "check the name and the folder you are in",
        ),
        ErrorKind::PermissionDenied => {
            NumberedError::new("E2103", format!("the {what} {shown} may not be read"), "check its permissions")
        }
        _ => NumberedError::new(
            "E2104",
            format!("the {what} {shown} cannot be read: {error}"),
            "check the file and its disk",
        ),
    }
}

/// Reads a text file whole.
///
/// # Errors
/// As [`bytes`]; `E2104` for what is no text.
pub fn text(path: &Path, what: &str) -> Result<String, NumberedError> {
    String::from_utf8(bytes(path, what)?).map_err(|_| {
        NumberedError::new("E2104", format!("the {what} {} is not UTF-8 text", path.display()), "give the right file")
    })
}

/// The absolute path of a file, as text.
#[must_use]
pub fn absolute(path: &Path) -> String {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).display().to_string()
}

/// The text of a machine file; empty for the machine that is built in.
///
/// # Errors
/// The file cannot be read.
pub fn machine_text(path: Option<&Path>) -> Result<String, NumberedError> {
    path.map_or(Ok(String::new()), |path| text(path, "machine file"))
}

/// The machine of a machine file, or the one that is built in.
///
/// # Errors
/// What is wrong with the file.
pub fn machine(path: Option<&Path>) -> Result<MachineConfig, NumberedError> {
    match path {
        None => MachineConfig::built_in(),
        Some(path) => MachineConfig::parse(&written_machine_text(path)?, &path.display().to_string()),
    }
}

/// The text of a machine file in which something is written.
///
/// # Errors
/// The file cannot be read; `E2114` for an empty one.
pub fn written_machine_text(path: &Path) -> Result<String, NumberedError> {
    let text = text(path, "machine file")?;
    if text.trim().is_empty() {
        let what = format!("the machine file {} is empty", path.display());
        return Err(NumberedError::new("E2114", what, "`retrace machine new -o FILE` writes a commented one"));
    }
    Ok(text)
}

/// An operator's script; an empty one where none is named.
///
/// # Errors
/// What is wrong with the file.
pub fn script(path: Option<&Path>) -> Result<Vec<ScriptInstruction>, NumberedError> {
    match path {
        None => Ok(Vec::new()),
        Some(path) => operator::parse(&text(path, "operator's script")?, &path.display().to_string()),
    }
}
