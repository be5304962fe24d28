//! The spool saves a streamed program, so that it can be read again (DNC, *Beyond the source*).
//!
//! Invariant: no byte is passed on that was not written to the spool before. What is read again is what was read the
//! first time, byte for byte, or an error.

use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Read, Seek, Take, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use retrace_config::NumberedError;
use retrace_gcode::ProgramEndDetector;

use crate::entry::SpooledBytes;
use crate::state_file;

/// Length of the spool, and its file, for the journal writer.
#[derive(Debug)]
pub struct SpoolProgress {
    file: File,
    marks: Arc<SpoolMarks>,
    /// Length that was synced.
    synced: SpooledBytes,
    /// Error of a failed sync: its data may be lost, and no later sync would report it.
    sync_error: Option<(io::ErrorKind, String)>,
}

#[derive(Debug, Default)]
struct SpoolMarks {
    bytes: AtomicU64,
    ended: AtomicBool,
}

impl SpoolProgress {
    /// Length that has been saved. Whatever was read before this call is included.
    pub(crate) fn spooled(&self) -> SpooledBytes {
        let ended = self.marks.ended.load(Ordering::Acquire);
        SpooledBytes { bytes: self.marks.bytes.load(Ordering::Acquire), ended }
    }

    /// Makes this length durable.
    pub(crate) fn sync(&mut self, spooled: SpooledBytes) -> io::Result<()> {
        if let Some((kind, why)) = &self.sync_error {
            return Err(io::Error::new(*kind, why.clone()));
        }
        if self.synced != spooled {
            let broken =
                |error: &io::Error| self.sync_error = Some((error.kind(), format!("the program's spool: {error}")));
            self.file.sync_data().inspect_err(broken)?;
            self.synced = spooled;
        }
        Ok(())
    }
}

/// Reads a streamed program and saves it.
#[derive(Debug)]
pub struct SpoolWriter<R> {
    from: R,
    file: File,
    marks: Arc<SpoolMarks>,
    /// Bytes of the buffer of `from` that are in the spool already.
    ahead: usize,
    /// Detects a program end in the spool.
    end: ProgramEndDetector,
    /// Maximum length of the spool in bytes.
    quota: u64,
}

impl<R: BufRead> SpoolWriter<R> {
    /// Creates a new spool file of this name.
    ///
    /// # Errors
    /// The error of the system.
    pub fn create(path: &Path, from: R) -> io::Result<(Self, SpoolProgress)> {
        let file = state_file::private().append(true).create_new(true).open(path)?;
        Self::append_to(file, from, SpooledBytes::default())
    }

    /// Continues a file that holds this much.
    fn append_to(file: File, from: R, spooled: SpooledBytes) -> io::Result<(Self, SpoolProgress)> {
        let marks =
            Arc::new(SpoolMarks { bytes: AtomicU64::new(spooled.bytes), ended: AtomicBool::new(spooled.ended) });
        let progress = SpoolProgress {
            file: file.try_clone()?,
            marks: Arc::clone(&marks),
            synced: SpooledBytes::default(),
            sync_error: None,
        };
        Ok((Self { from, file, marks, ahead: 0, end: ProgramEndDetector::default(), quota: u64::MAX }, progress))
    }
}

impl<R> SpoolWriter<R> {
    /// Limits the spool to `quota` bytes: a longer program cannot be read further (`E2313`).
    #[must_use]
    pub fn with_quota(self, quota: u64) -> Self {
        Self { quota, ..self }
    }
}

impl<R: BufRead> BufRead for SpoolWriter<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        let waiting = self.from.fill_buf()?;
        if let Some(new @ [_, ..]) = waiting.get(self.ahead..) {
            if self.marks.bytes.load(Ordering::Acquire) + new.len() as u64 > self.quota {
                let what = format!(
                    "E2313: the streamed program is longer than {} MiB, the limit for saving one (stream_quota_mib)",
                    self.quota >> 20
                );
                return Err(io::Error::new(io::ErrorKind::QuotaExceeded, what));
            }
            let with_context = |error: io::Error| {
                io::Error::new(error.kind(), format!("it cannot be saved in the job's folder: {error}"))
            };
            self.file.write_all(new).map_err(with_context)?;
            self.ahead = waiting.len();
            self.marks.bytes.fetch_add(new.len() as u64, Ordering::Release);
            self.end.push(new);
        }
        // A sender that was cut off has not sent the whole program.
        if waiting.is_empty() && self.end.is_reached() {
            self.marks.ended.store(true, Ordering::Release);
        }
        Ok(waiting)
    }

    fn consume(&mut self, count: usize) {
        self.ahead = self.ahead.saturating_sub(count);
        self.from.consume(count);
    }
}

impl<R: BufRead> Read for SpoolWriter<R> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        read_buffered(self, into)
    }
}

fn read_buffered(from: &mut impl BufRead, into: &mut [u8]) -> io::Result<usize> {
    let waiting = from.fill_buf()?;
    let count = waiting.len().min(into.len());
    into[..count].copy_from_slice(&waiting[..count]);
    from.consume(count);
    Ok(count)
}

/// Reads a program again: first what was saved of it; then, where that is not all, from a sender that sends it again
/// from its beginning.
#[derive(Debug)]
pub struct SpoolReplay<R> {
    kept: Take<BufReader<File>>,
    /// The saved part, for comparison with what is sent again. None after the comparison.
    compared: Option<Take<BufReader<File>>>,
    /// None where the whole program was saved.
    resent: Option<SpoolWriter<R>>,
}

impl<R: BufRead> SpoolReplay<R> {
    /// Reads the spool of a job, of which the journal records this length. What is behind it was never needed, and is
    /// cut off.
    ///
    /// # Errors
    /// `E2208` where it is not the whole program and no sender sends it again, or it is shorter than the journal
    /// records; `E2104` where it cannot be read.
    pub fn open(path: &Path, spooled: SpooledBytes, again: Option<R>) -> Result<(Self, SpoolProgress), NumberedError> {
        let unreadable = |error: io::Error| {
            let what = format!("the saved program {} cannot be read: {error}", path.display());
            NumberedError::new("E2104", what, "check the file and its disk")
        };
        let again = match again {
            None if !spooled.ended => {
                let what = format!("only the first {} bytes of the program had arrived and were saved", spooled.bytes);
                let remedy = "send the program again from its beginning: name its file with --program FILE";
                return Err(NumberedError::new("E2208", what, remedy));
            }
            again => again.filter(|_| !spooled.ended),
        };
        let mut file = OpenOptions::new().append(true).open(path).map_err(unreadable)?;
        let length = file.seek(io::SeekFrom::End(0)).map_err(unreadable)?;
        if length < spooled.bytes {
            let what = format!("{} has {length} bytes, but the journal records {}", path.display(), spooled.bytes);
            return Err(NumberedError::new("E2208", what, "start a new job, at a line with --start-line if necessary"));
        }
        file.set_len(spooled.bytes).map_err(unreadable)?;
        let open = || File::open(path).map(|file| BufReader::new(file).take(spooled.bytes)).map_err(unreadable);
        let (kept, compared) = (open()?, if again.is_some() { Some(open()?) } else { None });
        let (again, progress) = match again {
            Some(from) => {
                let (again, progress) = SpoolWriter::append_to(file, from, spooled).map_err(unreadable)?;
                (Some(again), progress)
            }
            None => (None, SpoolWriter::append_to(file, io::empty(), spooled).map_err(unreadable)?.1),
        };
        Ok((Self { kept, compared, resent: again }, progress))
    }
}

impl<R> SpoolReplay<R> {
    /// Limits the spool to `quota` bytes.
    #[must_use]
    pub fn limited_to(self, quota: u64) -> Self {
        Self { resent: self.resent.map(|again| again.with_quota(quota)), ..self }
    }
}

impl<R: BufRead> SpoolReplay<R> {
    /// Compares what is sent again with the spool, up to its end.
    ///
    /// # Errors
    /// Another program is sent, with its first line that differs; or it cannot be read.
    pub fn compare(&mut self) -> io::Result<()> {
        let (Some(kept), Some(again)) = (&mut self.compared, &mut self.resent) else { return Ok(()) };
        let mut line = 1;
        loop {
            let was = kept.fill_buf()?;
            if was.is_empty() {
                break;
            }
            // The bytes are in the spool, and are not written there a second time.
            let is = again.from.fill_buf()?;
            let common = was.iter().zip(is).take_while(|(was, is)| was == is).count();
            line += was[..common].iter().filter(|&&byte| byte == b'\n').count();
            if common < was.len().min(is.len()) || is.is_empty() {
                let what = if is.is_empty() { "ends before" } else { "differs in" };
                return Err(io::Error::other(SpoolMismatch { what, line }));
            }
            again.end.push(&was[..common]);
            kept.consume(common);
            again.from.consume(common);
        }
        self.compared = None;
        Ok(())
    }
}

/// Another program was sent.
#[derive(Debug)]
struct SpoolMismatch {
    what: &'static str,
    line: usize,
}

impl std::fmt::Display for SpoolMismatch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { what, line } = self;
        write!(f, "E2208: what is sent again {what} line {line} of what was sent the first time; send the same program")
    }
}

impl std::error::Error for SpoolMismatch {}

impl<R: BufRead> BufRead for SpoolReplay<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.kept.limit() > 0 && self.kept.fill_buf()?.is_empty() {
            return Err(io::Error::new(io::ErrorKind::UnexpectedEof, "the saved program has become shorter"));
        }
        if self.kept.limit() > 0 {
            return self.kept.fill_buf();
        }
        self.compare()?;
        self.resent.as_mut().map_or(Ok(&[]), SpoolWriter::fill_buf)
    }

    fn consume(&mut self, count: usize) {
        if self.kept.limit() > 0 {
            self.kept.consume(count);
        } else if let Some(again) = &mut self.resent {
            again.consume(count);
        }
    }
}

impl<R: BufRead> Read for SpoolReplay<R> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        read_buffered(self, into)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PROGRAM: &[u8] = b"G0 X0\nG1 X1 F600\nX2\nX3\nM2\n";

    /// A temporary folder of a test.
    struct Folder(tempfile::TempDir);

    impl Folder {
        fn new() -> Self {
            Self(tempfile::tempdir().expect("a folder"))
        }

        fn file(&self) -> std::path::PathBuf {
            self.0.path().join("stream.ngc")
        }
    }

    /// Reads this number of bytes of the program through pieces of this size into the spool.
    fn spooled(path: &Path, bytes: usize, piece: usize) -> SpoolProgress {
        let (mut spooling, progress) =
            SpoolWriter::create(path, BufReader::with_capacity(piece, PROGRAM)).expect("a spool");
        let mut read = vec![0; bytes];
        spooling.read_exact(&mut read).expect("so many are there");
        assert_eq!(read, PROGRAM[..bytes]);
        progress
    }

    fn all(mut from: impl Read) -> io::Result<Vec<u8>> {
        let mut read = Vec::new();
        from.read_to_end(&mut read).map(|_| read)
    }

    #[test]
    fn everything_that_was_read_is_kept_before() {
        let folder = Folder::new();
        for piece in [1, 4, 100] {
            for bytes in [0, 1, 7, PROGRAM.len()] {
                let _ = std::fs::remove_file(folder.file());
                let progress = spooled(&folder.file(), bytes, piece);
                let kept = std::fs::read(folder.file()).expect("a spool");
                assert!(kept.len() >= bytes && PROGRAM.starts_with(&kept));
                assert_eq!(progress.spooled(), SpooledBytes { bytes: kept.len() as u64, ended: false });
            }
        }
        let _ = std::fs::remove_file(folder.file());
        let (mut spooling, progress) = SpoolWriter::create(&folder.file(), PROGRAM).expect("a spool");
        assert_eq!(all(&mut spooling).ok().as_deref(), Some(PROGRAM));
        assert_eq!(progress.spooled(), SpooledBytes { bytes: PROGRAM.len() as u64, ended: true });
        assert_eq!(std::fs::read(folder.file()).ok().as_deref(), Some(PROGRAM));
    }

    #[test]
    fn a_sender_that_was_cut_off_has_not_ended_the_program() {
        let folder = Folder::new();
        for (sent, ended) in [("G0 X1\nM2\n", true), ("G0 X1\nM2", true), ("G0 X1\nM3", false), ("G0 X1\n", false)] {
            let _ = std::fs::remove_file(folder.file());
            let (spooling, progress) = SpoolWriter::create(&folder.file(), sent.as_bytes()).expect("a spool");
            all(spooling).expect("readable");
            assert_eq!(progress.spooled(), SpooledBytes { bytes: sent.len() as u64, ended }, "{sent:?}");
        }
        // the end of the program is on both sides of the end of the spool
        for kept in 0..PROGRAM.len() as u64 {
            std::fs::write(folder.file(), PROGRAM).expect("written");
            let spooled = SpooledBytes { bytes: kept, ended: false };
            let (again, progress) = SpoolReplay::open(&folder.file(), spooled, Some(PROGRAM)).expect("a part");
            all(again).expect("readable");
            assert_eq!(progress.spooled(), SpooledBytes { bytes: PROGRAM.len() as u64, ended: true }, "{kept}");
        }
    }

    #[test]
    fn a_spool_has_a_quota() {
        let folder = Folder::new();
        let (spooling, progress) =
            SpoolWriter::create(&folder.file(), BufReader::with_capacity(4, PROGRAM)).expect("a spool");
        let why = all(spooling.with_quota(10)).expect_err("it is full").to_string();
        assert!(why.contains("E2313"), "{why}");
        assert_eq!(progress.spooled(), SpooledBytes { bytes: 8, ended: false });
        assert_eq!(std::fs::read(folder.file()).ok().as_deref(), Some(&PROGRAM[..8]));
    }

    #[test]
    fn a_whole_spool_needs_nobody_to_send_again() {
        let folder = Folder::new();
        drop(spooled(&folder.file(), PROGRAM.len(), 3));
        let whole = SpooledBytes { bytes: PROGRAM.len() as u64, ended: true };
        let (again, _) = SpoolReplay::open(&folder.file(), whole, None::<&[u8]>).expect("it is whole");
        assert_eq!(all(again).ok().as_deref(), Some(PROGRAM));
        let part = SpooledBytes { bytes: 9, ended: false };
        assert_eq!(SpoolReplay::open(&folder.file(), part, None::<&[u8]>).expect_err("a part").number, "E2208");
        let more = SpooledBytes { bytes: 99, ended: true };
        assert_eq!(SpoolReplay::open(&folder.file(), more, None::<&[u8]>).expect_err("too short").number, "E2208");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn a_part_goes_on_with_the_same_program_and_with_no_other(
            bytes in 0..PROGRAM.len(), piece in 1..40_usize, trusted in 0..=PROGRAM.len(), at in 0..PROGRAM.len(),
                short in 0..PROGRAM.len(),
        ) {
            let folder = Folder::new();
            let path = folder.file();
            drop(spooled(&path, bytes, piece));
            // The journal may record less than the file has.
            let length = std::fs::metadata(&path).expect("a spool").len();
            let said = SpooledBytes { bytes: length.min(trusted as u64), ended: false };
            let open = |again: Vec<u8>| SpoolReplay::open(&path, said,
                Some(BufReader::with_capacity(piece, io::Cursor::new(again))));

            let mut other = PROGRAM.to_vec();
            other[at] = b'#';
            let result = all(open(other.clone()).expect("it is a part").0);
            if (at as u64) < said.bytes {
                let line = 1 + PROGRAM[..at].iter().filter(|&&b| b == b'\n').count();
                let why = result.expect_err("another program").to_string();
                prop_assert!(why.contains("E2208") && why.contains(&format!("line {line} ")), "{}", why);
            } else {
                prop_assert_eq!(result.expect("not seen before"), other);
            }
            drop(open(PROGRAM.to_vec()));

            if (short as u64) < said.bytes {
                let why = all(open(PROGRAM[..short].to_vec()).expect("it is a part").0).expect_err("too \
                    short").to_string();
                prop_assert!(why.contains("ends before"), "{}", why);
            }

            let (mut again, progress) = open(PROGRAM.to_vec()).expect("it is a part");
            prop_assert_eq!(progress.spooled(), said);
            prop_assert_eq!(all(&mut again).expect("the same program"), PROGRAM);
            prop_assert_eq!(progress.spooled(), SpooledBytes { bytes: PROGRAM.len() as u64, ended: true });
            prop_assert_eq!(std::fs::read(&path).expect("a spool"), PROGRAM);
        }
    }
}
