//! FIFOs of a watched folder: what a writer sends becomes a file of the folder (SHP-35).
//!
//! A FIFO is opened without waiting for a writer, and read while data come: at most 2 s a turn. Before it is opened it
//! is exchanged for a spare one, so that whoever opens the name from then on waits for a turn of its own: what was sent
//! one behind the other is never read as one.
//!
//! Invariant: a file appears in the folder only when its writer has closed the FIFO, whole and synced; what a writer
//! has left unfinished is deleted. No call waits for a writer.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use retrace_config::NumberedError;
use rustix::fs::{CWD, FileType, Mode, OFlags, RenameFlags};

use crate::free_space::free_bytes;
use crate::inbox_limits::{InboxLimits, no_room};
use crate::machine_folder::{sync_folder, unusable};
use crate::tape_marks::TapeMarks;

/// Longest time that one turn reads.
const MAX_TURN: Duration = Duration::from_secs(2);
/// Longest pause of a writer within a turn.
const MAX_PAUSE: Duration = Duration::from_millis(100);
/// Time between two looks at a writer that pauses.
const LOOK_INTERVAL: Duration = Duration::from_millis(2);
/// Bytes that are read at a time: what a FIFO holds.
const CHUNK: usize = 64 << 10;
/// Bytes after which the free space of the disk is asked for again.
const SPACE_INTERVAL: u64 = 16 << 20;

/// What came of a FIFO in one turn.
#[derive(Debug)]
pub(crate) enum FifoOutcome {
    /// Nothing: no writer, or one that has not finished.
    Nothing,
    /// A file of the folder with what was sent.
    File,
    /// What was sent is no job.
    Failed(NumberedError),
}

/// The FIFOs of a folder that are being read.
#[derive(Debug, Default)]
pub(crate) struct FifoReader {
    writers: BTreeMap<String, Writer>,
}

/// A FIFO with a writer, and the file with what it has sent.
#[derive(Debug)]
struct Writer {
    fifo: File,
    spool: File,
    path: PathBuf,
    bytes: u64,
    marks: TapeMarks,
}

impl FifoReader {
    /// Whether a writer has not finished.
    pub(crate) fn has_writers(&self) -> bool {
        !self.writers.is_empty()
    }

    /// Reads a FIFO for one turn. With `ready` a file that was received gets a ready file beside it.
    ///
    /// # Errors
    /// `E5010` where FIFO or folder cannot be used.
    pub(crate) fn read(
        &mut self,
        folder: &Path,
        name: &str,
        ready: Option<&str>,
        limits: InboxLimits,
    ) -> Result<FifoOutcome, NumberedError> {
        let unusable_fifo = |error: io::Error| unusable(&folder.join(name), &error);
        let mut writer = match self.writers.remove(name) {
            Some(writer) => writer,
            None => match Writer::find(folder, name).map_err(unusable_fifo)? {
                Some(writer) => writer,
                None => return Ok(FifoOutcome::Nothing),
            },
        };
        let failed = match writer.receive(folder, limits) {
            Ok(false) => {
                self.writers.insert(name.to_owned(), writer);
                return Ok(FifoOutcome::Nothing);
            }
            Ok(true) => writer.marks.error(name),
            Err(error) => Some(error),
        };
        match failed {
            Some(error) => Ok(FifoOutcome::Failed(error)),
            None => writer.keep(folder, name, ready).map_err(unusable_fifo),
        }
    }
}

impl Writer {
    /// The writer of a FIFO, where there is one.
    fn find(folder: &Path, name: &str) -> io::Result<Option<Self>> {
        let path = folder.join(format!(".{name}.part"));
        // a process that was killed has left it
        let _ = fs::remove_file(&path);
        let spare = exchange(folder, name)?;
        let flags = OFlags::RDONLY | OFlags::NONBLOCK | OFlags::CLOEXEC | OFlags::NOFOLLOW;
        let mut fifo = File::from(rustix::fs::open(&spare, flags, Mode::empty())?);
        let mut first = vec![0; CHUNK];
        let first = match fifo.read(&mut first) {
            Ok(0) => return Ok(None),
            Ok(count) => &first[..count],
            Err(error) if error.kind() == ErrorKind::WouldBlock => &[],
            Err(error) => return Err(error),
        };
        fs::remove_file(&spare)?;
        let spool = File::create(&path)?;
        let mut writer = Self { fifo, spool, path, bytes: 0, marks: TapeMarks::default() };
        writer.store(first)?;
        Ok(Some(writer))
    }

    /// Reads what comes. Returns whether the writer has closed the FIFO.
    fn receive(&mut self, folder: &Path, limits: InboxLimits) -> Result<bool, NumberedError> {
        let (begun, mut last) = (Instant::now(), Instant::now());
        let mut chunk = vec![0; CHUNK];
        let mut asked_at = None;
        while begun.elapsed() < MAX_TURN && last.elapsed() < MAX_PAUSE {
            if asked_at.is_none_or(|asked| self.bytes - asked >= SPACE_INTERVAL) {
                asked_at = Some(self.bytes);
                if free_bytes(folder).is_ok_and(|free| free < limits.disk_reserve_bytes.saturating_add(SPACE_INTERVAL))
                {
                    return Err(no_room(folder, self.bytes, "the disk is nearly full", limits));
                }
            }
            match self.fifo.read(&mut chunk) {
                Ok(0) => return Ok(true),
                Ok(count) => {
                    last = Instant::now();
                    self.store(&chunk[..count]).map_err(|error| unusable(&self.path, &error))?;
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => std::thread::sleep(LOOK_INTERVAL),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(unusable(&self.path, &error)),
            }
            if self.bytes > limits.max_bytes {
                return Err(no_room(folder, self.bytes, "the writer of a FIFO does not end", limits));
            }
        }
        Ok(false)
    }

    fn store(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.marks.take(bytes);
        self.bytes += bytes.len() as u64;
        self.spool.write_all(bytes)
    }

    /// Makes what was received a file of the folder. Of nothing no file is made.
    fn keep(self, folder: &Path, name: &str, ready: Option<&str>) -> Result<FifoOutcome, io::Error> {
        if self.bytes == 0 {
            return Ok(FifoOutcome::Nothing);
        }
        self.spool.sync_all()?;
        let name = name_of_file(folder, name);
        if let Some(ready) = ready {
            File::create(folder.join(format!("{name}{ready}")))?;
        }
        fs::rename(&self.path, folder.join(&name))?;
        sync_folder(folder).map_err(|error| io::Error::other(error.to_string()))?;
        Ok(FifoOutcome::File)
    }
}

impl Drop for Writer {
    /// Deletes what was not kept.
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

/// Exchanges a FIFO for a spare one, and returns the path of the one that had the name. No further writer finds that.
fn exchange(folder: &Path, name: &str) -> io::Result<PathBuf> {
    let (path, spare) = (folder.join(name), folder.join(format!(".{name}.next")));
    if !fs::symlink_metadata(&spare).is_ok_and(|about| about.file_type().is_fifo()) {
        let mode = fs::symlink_metadata(&path)?.mode() & 0o777;
        rustix::fs::mknodat(CWD, &spare, FileType::Fifo, Mode::from_raw_mode(0o600), 0)?;
        // the mask of this process does not count
        rustix::fs::chmod(&spare, Mode::from_raw_mode(mode))?;
    }
    rustix::fs::renameat_with(CWD, &path, CWD, &spare, RenameFlags::EXCHANGE)?;
    Ok(spare)
}

/// A name that no file of the folder has: that of the FIFO with the time, in milliseconds.
fn name_of_file(folder: &Path, name: &str) -> String {
    let (stem, extension) = match name.rsplit_once('.') {
        Some((stem, extension)) => (stem, format!(".{extension}")),
        None => (name, String::new()),
    };
    let ms = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_millis());
    let is_free = |name: &String| fs::symlink_metadata(folder.join(name)).is_err();
    (ms..).map(|ms| format!("{stem}-{ms}{extension}")).find(is_free).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::thread;

    const LIMITS: InboxLimits = InboxLimits { max_bytes: 1 << 20, disk_reserve_bytes: 0 };

    fn fifo(folder: &Path) -> PathBuf {
        let path = folder.join("cam.ngc");
        rustix::fs::mknodat(CWD, &path, FileType::Fifo, Mode::from_raw_mode(0o600), 0).expect("a FIFO");
        path
    }

    /// Turns until something comes of the FIFO, and the longest of them.
    fn turns(reader: &mut FifoReader, folder: &Path) -> (FifoOutcome, Duration) {
        let mut longest = Duration::ZERO;
        for _ in 0..500 {
            let begun = Instant::now();
            let outcome = reader.read(folder, "cam.ngc", None, LIMITS).expect("a folder");
            longest = longest.max(begun.elapsed());
            if !matches!(outcome, FifoOutcome::Nothing) {
                return (outcome, longest);
            }
            thread::sleep(Duration::from_millis(10));
        }
        panic!("nothing comes of it");
    }

    fn texts(folder: &Path) -> Vec<String> {
        let files = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
        let files = files.filter(|path| path.is_file()).map(|path| fs::read_to_string(path).expect("text"));
        let mut texts: Vec<_> = files.collect();
        texts.sort();
        texts
    }

    #[test]
    fn writers_one_behind_the_other_are_a_file_each() {
        let folder = tempfile::tempdir().expect("a folder");
        let (path, mut reader) = (fifo(folder.path()), FifoReader::default());
        let sent: Vec<String> =
            (0..20).map(|number| format!("{}M2\n", format!("G1 X{number}\n").repeat(9_000))).collect();
        let writer = {
            let (path, sent) = (path.clone(), sent.clone());
            // each opens the FIFO as soon as the one before has closed it
            thread::spawn(move || sent.iter().try_for_each(|text| fs::write(&path, text)))
        };
        for _ in &sent {
            assert!(matches!(turns(&mut reader, folder.path()).0, FifoOutcome::File));
        }
        writer.join().expect("it ends").expect("all is taken");
        let mut sent = sent;
        sent.sort();
        assert!(texts(folder.path()) == sent);
        assert!(fs::metadata(&path).expect("it is there").file_type().is_fifo());
    }

    #[test]
    fn nothing_waits_for_a_writer_and_what_it_has_not_finished_is_no_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let (path, mut reader) = (fifo(folder.path()), FifoReader::default());
        let begun = Instant::now();
        assert!(matches!(reader.read(folder.path(), "cam.ngc", None, LIMITS), Ok(FifoOutcome::Nothing)));
        assert!(begun.elapsed() < MAX_PAUSE && !reader.has_writers());
        let (close, closed) = std::sync::mpsc::channel::<()>();
        let writer = thread::spawn(move || {
            let mut fifo = File::options().write(true).open(path).expect("a reader");
            fifo.write_all(b"G1 X1\n").expect("it is read");
            closed.recv().expect("told");
        });
        let begun = Instant::now();
        while !reader.has_writers() {
            assert!(matches!(reader.read(folder.path(), "cam.ngc", None, LIMITS), Ok(FifoOutcome::Nothing)));
        }
        // it is silent, and no turn is longer for that
        let turn = Instant::now();
        assert!(matches!(reader.read(folder.path(), "cam.ngc", None, LIMITS), Ok(FifoOutcome::Nothing)));
        assert!(turn.elapsed() < 4 * MAX_PAUSE && begun.elapsed() < Duration::from_secs(20));
        assert!(texts(folder.path()).iter().all(|text| text == "G1 X1\n"), "a hidden file alone");
        drop(reader);
        assert_eq!(texts(folder.path()), Vec::<String>::new(), "the agent ends: nothing is left");
        close.send(()).expect("it listens");
        writer.join().expect("it ends");
    }

    #[test]
    fn two_tapes_at_once_and_one_without_end_are_no_job() {
        let folder = tempfile::tempdir().expect("a folder");
        let (path, mut reader) = (fifo(folder.path()), FifoReader::default());
        for (sent, number) in [("%\nM2\n%\n%\nM2\n%\n".to_owned(), "E5044"), ("G1 X1\n".repeat(200_000), "E5008")] {
            let path = path.clone();
            let writer = thread::spawn(move || fs::write(path, sent));
            let FifoOutcome::Failed(error) = turns(&mut reader, folder.path()).0 else { panic!("it fails") };
            assert_eq!((error.number, texts(folder.path())), (number, vec![]));
            assert_eq!(
                writer.join().expect("it ends").is_err(),
                number == "E5008",
                "a writer that is not read to its end"
            );
        }
    }
}
