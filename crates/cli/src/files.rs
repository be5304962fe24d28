//! Reads the files on the command line.
//!
//! Invariant: a file that cannot be read is rejected with its name, the reason and the remedy, before anything moves.

use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::{Path, PathBuf};

use retrace_config::{MachineConfig, NumberedError};
use retrace_controller::{ScriptInstruction, parse_script};
use retrace_gcode::Text;
use retrace_journal::FileHash;

/// Whether a path is a FIFO or a character device, which is read as a stream.
#[cfg(unix)]
#[must_use]
pub fn is_stream(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt;
    std::fs::metadata(path).is_ok_and(|file| file.file_type().is_fifo() || file.file_type().is_char_device())
}

/// Whether a path is a stream: never on a system without FIFOs.
#[cfg(not(unix))]
#[must_use]
pub fn is_stream(_: &Path) -> bool {
    false
}

/// File that is opened at its first read: opening a FIFO blocks until it has a writer.
#[derive(Debug)]
pub struct OpenedFile {
    path: PathBuf,
    file: Option<File>,
}

impl OpenedFile {
    /// File that is not open yet.
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

/// Maximum size of a file that is read completely: a table, a machine file, a script.
const MAX_WHOLE: u64 = 64 << 20;

/// Opens a file; `what` is its role, for the error text.
///
/// # Errors
/// `E2101` … `E2104`: missing, a folder, no permission, not readable. `E2312`: a device.
pub fn open(path: &Path, what: &str) -> Result<File, NumberedError> {
    if path.is_dir() {
        return Err(NumberedError::new(
            "E2102",
            format!("{} is a folder, not a {what}", path.display()),
            "name a file in that folder",
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

/// Reads a program. Returns its text, and its hash where the text is not held in memory: of a text in memory the hash
/// can be calculated, and most commands need none.
///
/// # Errors
/// See [`open`].
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

/// Hash of a file, which is not held in memory.
///
/// # Errors
/// See [`open`].
pub fn hash(path: &Path, what: &str) -> Result<FileHash, NumberedError> {
    FileHash::of_reader(open(path, what)?).map_err(|error| unreadable(path, what, &error))
}

/// Reads a whole file; `what` is its role, for the error text.
///
/// # Errors
/// See [`open`]; `E2312` for a file of more than 64 MiB.
pub fn bytes(path: &Path, what: &str) -> Result<Vec<u8>, NumberedError> {
    let mut bytes = Vec::new();
    let file = open(path, what)?;
    let length = file.metadata().map_or(0, |file| file.len());
    let read = if length > MAX_WHOLE { Ok(0) } else { file.take(MAX_WHOLE + 1).read_to_end(&mut bytes) };
    read.map_err(|error| unreadable(path, what, &error))?;
    if length.max(bytes.len() as u64) > MAX_WHOLE {
        let what = format!("{} has more than {} MiB: it is not a {what}", path.display(), MAX_WHOLE >> 20);
        return Err(NumberedError::new("E2312", what, "check the file name"));
    }
    Ok(bytes)
}

/// Whether a path is a character or block device.
#[cfg(unix)]
fn is_device(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt;
    std::fs::metadata(path).is_ok_and(|file| file.file_type().is_char_device() || file.file_type().is_block_device())
}

/// Whether a path is a device: never on a system without device files.
#[cfg(not(unix))]
fn is_device(_: &Path) -> bool {
    false
}

/// Error for a file that cannot be read.
fn unreadable(path: &Path, what: &str, error: &io::Error) -> NumberedError {
    let shown = path.display();
    match error.kind() {
        ErrorKind::NotFound => NumberedError::new(
            "E2101",
            format!("the {what} {shown} does not exist"),
            "check the name and the current folder",
        ),
        ErrorKind::PermissionDenied => {
            NumberedError::new("E2103", format!("no permission to read the {what} {shown}"), "check its permissions")
        }
        _ => NumberedError::new(
            "E2104",
            format!("the {what} {shown} cannot be read: {error}"),
            "check the file and its disk",
        ),
    }
}

/// Reads a whole text file.
///
/// # Errors
/// See [`bytes`]; `E2104` where it is not text.
pub fn text(path: &Path, what: &str) -> Result<String, NumberedError> {
    String::from_utf8(bytes(path, what)?).map_err(|_| {
        NumberedError::new("E2104", format!("the {what} {} is not UTF-8 text", path.display()), "check the file name")
    })
}

/// Absolute path of a file, as text.
#[must_use]
pub fn absolute(path: &Path) -> String {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).display().to_string()
}

/// Text of a machine file; empty for the built-in machine.
///
/// # Errors
/// The file cannot be read.
pub fn machine_text(path: Option<&Path>) -> Result<String, NumberedError> {
    path.map_or(Ok(String::new()), |path| text(path, "machine file"))
}

/// Machine of a machine file, or the built-in one.
///
/// # Errors
/// The file has errors.
pub fn machine(path: Option<&Path>) -> Result<MachineConfig, NumberedError> {
    match path {
        None => MachineConfig::built_in(),
        Some(path) => {
            with_materials(MachineConfig::parse(&written_machine_text(path)?, &path.display().to_string())?, path)
        }
    }
}

/// The machine with the material table that one of its cutters names, beside the machine file at `path`.
///
/// # Errors
/// The table cannot be read or has errors.
pub fn with_materials(machine: MachineConfig, path: &Path) -> Result<MachineConfig, NumberedError> {
    let Some(file) = machine.material_file() else { return Ok(machine) };
    let file = path.parent().unwrap_or(Path::new("")).join(file);
    machine.with_materials(text(&file, "material table")?, file.display().to_string())
}

/// Text of a machine file that is not empty.
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

/// Operator's script; empty where the command line has none.
///
/// # Errors
/// The file has errors.
pub fn script(path: Option<&Path>) -> Result<Vec<ScriptInstruction>, NumberedError> {
    match path {
        None => Ok(Vec::new()),
        Some(path) => parse_script(&text(path, "operator's script")?, &path.display().to_string()),
    }
}

/// `E2105`: a file could not be written.
pub fn unwritable(what: &str, error: &std::io::Error) -> NumberedError {
    NumberedError::new(
        "E2105",
        format!("{what} cannot be written: {error}"),
        "check the folder, its permissions and the free disk space",
    )
}

/// File name in a path, which is what fits on a screen.
pub fn last_name(name: &str) -> String {
    Path::new(name).file_name().map_or_else(|| name.to_owned(), |last| last.to_string_lossy().into_owned())
}
