//! A log of checked lines, each durable before the next is written: the format of the journal.
//!
//! Where the computer fails, the last line may be incomplete. It is ignored, and cut off before the next one is
//! appended. A line that was damaged later is an error, except where it is the last one: that one is not distinguished
//! from an incomplete line.
//!
//! Invariant: what was appended without an error is read again, whole and in order, or the log is rejected with the
//! line of the damage.

use std::fs::{self, File};
use std::io::{ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use retrace_config::NumberedError;
use retrace_journal::{journal_line, state_file};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::machine_folder::{sync_folder, unusable};

/// What a log contains.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LogContent<E> {
    /// The entries, in order.
    pub entries: Vec<E>,
    /// Length of the valid lines in bytes.
    valid_bytes: u64,
}

/// A log that is locked against other processes, to be appended to.
#[derive(Debug)]
pub(crate) struct OpenLog {
    path: PathBuf,
    file: File,
    sequence: u64,
    valid_bytes: u64,
    _lock: File,
}

/// Reads a log; one that does not exist is empty.
///
/// # Errors
/// `E5009` where it is damaged, `E5010` where it cannot be read.
pub(crate) fn read<E: DeserializeOwned>(path: &Path) -> Result<LogContent<E>, NumberedError> {
    match fs::read(path) {
        Ok(bytes) => parse(&bytes, path),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(LogContent { entries: Vec::new(), valid_bytes: 0 }),
        Err(error) => Err(unusable(path, &error)),
    }
}

fn parse<E: DeserializeOwned>(bytes: &[u8], path: &Path) -> Result<LogContent<E>, NumberedError> {
    let mut content = LogContent { entries: Vec::new(), valid_bytes: 0 };
    let mut rest = bytes;
    while let Some(end) = rest.iter().position(|&byte| byte == b'\n') {
        let (line, behind) = rest.split_at(end + 1);
        let number = content.entries.len() as u64;
        let json = journal_line::parse(line).filter(|line| line.sequence == number).map(|line| line.json);
        let Some(json) = json else {
            // where a line feed was damaged, a valid line follows the damaged one
            if behind.is_empty() && journal_line::parse_end(line).is_none() {
                break;
            }
            return Err(damaged(path, number, "its checksum or number is wrong"));
        };
        let entry = serde_json::from_slice(json).map_err(|error| damaged(path, number, &error.to_string()))?;
        content.entries.push(entry);
        content.valid_bytes += line.len() as u64;
        rest = behind;
    }
    Ok(content)
}

fn damaged(path: &Path, number: u64, why: &str) -> NumberedError {
    let what = format!("{} is damaged in line {}: {why}", path.display(), number + 1);
    let remedy = "no job is taken or started until it is repaired: keep a copy of the file, and see docs/shop.md, \
                  \"A damaged ledger\"";
    NumberedError::new("E5009", what, remedy)
}

impl OpenLog {
    /// Locks a log, reads it, and cuts an incomplete last line off. Waits for a process that appends.
    ///
    /// # Errors
    /// `E5009` where it is damaged, `E5010` where it cannot be written.
    pub(crate) fn open<E: DeserializeOwned>(path: &Path) -> Result<(Self, Vec<E>), NumberedError> {
        let lock_path = path.with_extension("lock");
        let lock = state_file::open_lock(&lock_path).map_err(|error| unusable(&lock_path, &error))?;
        lock.lock().map_err(|error| unusable(&lock_path, &error))?;
        let failed = |error| unusable(path, &error);
        let is_new = !path.exists();
        let mut file =
            state_file::private().read(true).write(true).create(true).truncate(false).open(path).map_err(failed)?;
        if is_new && let Some(folder) = path.parent() {
            sync_folder(folder)?;
        }
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(failed)?;
        let content = parse::<E>(&bytes, path)?;
        let valid_bytes = content.valid_bytes;
        if valid_bytes < bytes.len() as u64 {
            file.set_len(valid_bytes).and_then(|()| file.sync_all()).map_err(failed)?;
        }
        file.seek(SeekFrom::Start(valid_bytes)).map_err(failed)?;
        let log =
            Self { path: path.to_owned(), file, sequence: content.entries.len() as u64, valid_bytes, _lock: lock };
        Ok((log, content.entries))
    }

    /// Appends an entry and makes it durable. After an error the log is as before.
    ///
    /// # Errors
    /// `E5010`
    pub(crate) fn append<E: Serialize>(&mut self, entry: &E) -> Result<(), NumberedError> {
        let failed = |error| unusable(&self.path, &error);
        let json = serde_json::to_vec(entry).map_err(|error| failed(error.into()))?;
        let mut line = Vec::with_capacity(json.len() + 32);
        journal_line::append(&mut line, self.sequence, true, &json);
        let written = self.file.write_all(&line).and_then(|()| self.file.sync_data());
        if let Err(error) = written {
            let _ = self.file.set_len(self.valid_bytes);
            let _ = self.file.seek(SeekFrom::Start(self.valid_bytes));
            return Err(failed(error));
        }
        self.sequence += 1;
        self.valid_bytes += line.len() as u64;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ENTRIES: [&str; 3] = ["first", "second \n line", "third"];

    fn written() -> (tempfile::TempDir, PathBuf, Vec<u8>) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("log");
        let (mut log, found) = OpenLog::open::<String>(&path).expect("a log");
        assert_eq!(found, Vec::<String>::new());
        ENTRIES.iter().for_each(|entry| log.append(entry).expect("appended"));
        let bytes = fs::read(&path).expect("a log");
        (folder, path, bytes)
    }

    #[test]
    fn a_log_that_ends_at_any_byte_is_read_up_to_there_and_continued() {
        let (_folder, path, bytes) = written();
        let ends: Vec<usize> = (1..=bytes.len()).filter(|&end| bytes[end - 1] == b'\n').collect();
        for length in 0..=bytes.len() {
            fs::write(&path, &bytes[..length]).expect("written");
            let whole = ends.iter().filter(|&&end| end <= length).count();
            let content = read::<String>(&path).expect("not damaged");
            assert_eq!(content.entries, ENTRIES[..whole], "{length} bytes");
            let (mut log, found) = OpenLog::open::<String>(&path).expect("not damaged");
            assert_eq!(found, ENTRIES[..whole]);
            log.append(&"again").expect("appended");
            drop(log);
            let content = read::<String>(&path).expect("whole");
            assert_eq!(content.entries.len(), whole + 1);
            assert_eq!(content.entries[whole], "again");
        }
    }

    #[test]
    fn damage_before_the_last_line_is_named_with_its_line() {
        let (_folder, path, bytes) = written();
        let last = bytes[..bytes.len() - 1].iter().rposition(|&byte| byte == b'\n').expect("lines") + 1;
        for at in 0..last {
            for bit in 0..8 {
                let mut damaged = bytes.clone();
                damaged[at] ^= 1 << bit;
                fs::write(&path, &damaged).expect("written");
                let line = bytes[..at].iter().filter(|&&byte| byte == b'\n').count() + 1;
                let refusal = read::<String>(&path).expect_err("damaged");
                assert_eq!(refusal.number, "E5009");
                assert!(refusal.cause.contains(&format!("line {line}:")), "{at}: {}", refusal.cause);
            }
        }
        fs::write(&path, [&bytes[..last], &bytes[..last]].concat()).expect("written");
        assert_eq!(read::<String>(&path).expect_err("lines of another place").number, "E5009");
        assert_eq!(read::<u64>(&path).expect_err("entries of another kind").number, "E5009");
    }

    #[test]
    fn a_log_that_cannot_be_opened_is_an_error() {
        let folder = tempfile::tempdir().expect("a folder");
        assert_eq!(read::<String>(folder.path()).expect_err("a folder").number, "E5010");
        assert_eq!(OpenLog::open::<String>(&folder.path().join("no/log")).expect_err("no folder").number, "E5010");
    }
}
