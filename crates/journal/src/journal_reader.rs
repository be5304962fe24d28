//! Reads a journal entry by entry.
//!
//! Invariant: the entries are read as they were written, from the first one on without a gap. The last batch may be
//! torn by a crash, and is then read up to the tear. Any other difference is an error.

use std::fmt;
use std::io::{self, BufRead, Read};
use std::path::Path;

use retrace_config::NumberedError;
use serde_json::Value;

use crate::entry::{FORMAT, JournalEntry};
use crate::journal_line::{self, MAX_LINE};

/// Reason why a journal cannot be used.
#[derive(Debug)]
pub enum JournalError {
    /// It has no valid first entry.
    NoBeginning,
    /// A line is damaged that was whole once.
    Damaged {
        /// Line number, from 1.
        line: u64,
        /// Offset of its first byte, from 0.
        byte: u64,
    },
    /// A line is valid but out of sequence: lines before it are lost or duplicated.
    Gap {
        /// Line number, from 1.
        line: u64,
        /// Its sequence number, from 0.
        number: u64,
    },
    /// An entry of a newer version.
    Unknown {
        /// Line number, from 1.
        line: u64,
        /// What is unknown.
        why: String,
    },
    /// A journal of another format than [`FORMAT`].
    Format(u64),
    /// It cannot be read.
    Unreadable(io::Error),
}

impl fmt::Display for JournalError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoBeginning => write!(f, "it has no whole first entry"),
            Self::Damaged { line, byte } => write!(f, "line {line}, at byte {byte}, is damaged"),
            Self::Gap { line, number } => {
                write!(f, "line {line} has number {number}: lines are missing or duplicated")
            }
            Self::Unknown { line, why } => write!(f, "line {line} is of a newer version: {why}"),
            Self::Format(format) => {
                let age = if *format < u64::from(FORMAT) { "an older" } else { "a newer" };
                write!(f, "{age} version of retrace wrote it, in format {format}; this version reads format {FORMAT}")
            }
            Self::Unreadable(error) => write!(f, "{error}"),
        }
    }
}

impl std::error::Error for JournalError {}

impl From<io::Error> for JournalError {
    fn from(error: io::Error) -> Self {
        Self::Unreadable(error)
    }
}

impl JournalError {
    /// The numbered error for the user.
    #[must_use]
    pub fn numbered_error(&self, journal: &Path) -> NumberedError {
        let again = "the job cannot be resumed; home the machine if in doubt, and begin at a line with `retrace run \
            --start-line`";
        let (number, remedy) = match self {
            Self::NoBeginning => ("E2204", "nothing has moved in this job: run the program"),
            Self::Damaged { .. } | Self::Gap { .. } => ("E2203", again),
            Self::Unknown { .. } | Self::Format(_) => ("E2205", "use the version of retrace that has written it"),
            Self::Unreadable(_) => ("E2104", "check the file and its disk"),
        };
        NumberedError::new(number, format!("the journal {}: {self}", journal.display()), remedy)
    }
}

/// End of a journal file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct JournalTail {
    /// Number of valid bytes. What is behind them is to be cut off before the journal is continued.
    pub whole: u64,
    /// Sequence number of the next line.
    pub next: u64,
    /// Number of bytes behind the valid ones, torn by a crash.
    pub torn: u64,
}

/// Iterator over the entries of a journal, each with its number. It ends after the first error.
#[derive(Debug)]
pub struct JournalEntries<R> {
    from: R,
    tail: JournalTail,
    buffer: Vec<u8>,
    is_over: bool,
}

impl<R: BufRead> JournalEntries<R> {
    /// Creates an iterator over the entries of this reader.
    pub fn new(from: R) -> Self {
        Self { from, tail: JournalTail::default(), buffer: Vec::new(), is_over: false }
    }

    /// State of the reader; the end of the journal, once all has been read.
    pub fn tail(&self) -> JournalTail {
        self.tail
    }

    /// Reads the next line, whole or not. At most [`MAX_LINE`] bytes are read at once, so that memory is bounded for
    /// any file.
    fn read_line(&mut self) -> io::Result<usize> {
        self.buffer.clear();
        (&mut self.from).take(MAX_LINE as u64).read_until(b'\n', &mut self.buffer)
    }

    fn advance(&mut self) -> Result<Option<(u64, JournalEntry)>, JournalError> {
        let length = self.read_line()?;
        if length == 0 {
            return if self.tail.next == 0 { Err(JournalError::NoBeginning) } else { Ok(None) };
        }
        let Some(line) = journal_line::parse(&self.buffer) else { return self.end_torn().map(|()| None) };
        let number = self.tail.next;
        if line.sequence != number {
            return Err(JournalError::Gap { line: number + 1, number: line.sequence });
        }
        let entry = parse_entry(line.json, number)?;
        self.tail.whole += length as u64;
        self.tail.next += 1;
        Ok(Some((number, entry)))
    }

    /// Handles a line that is not whole: the last batch was torn, unless a batch begins behind it. A torn first line is
    /// not a beginning.
    fn end_torn(&mut self) -> Result<(), JournalError> {
        loop {
            self.tail.torn += self.buffer.len() as u64;
            if journal_line::parse_end(&self.buffer)
                .is_some_and(|line| line.begins_batch && line.sequence > self.tail.next)
            {
                return Err(JournalError::Damaged { line: self.tail.next + 1, byte: self.tail.whole });
            }
            if self.read_line()? == 0 {
                return if self.tail.next == 0 { Err(JournalError::NoBeginning) } else { Ok(()) };
            }
        }
    }
}

/// Parses the content of the line with this number.
fn parse_entry(json: &[u8], number: u64) -> Result<JournalEntry, JournalError> {
    let unknown = |why: String| JournalError::Unknown { line: number + 1, why };
    if number == 0 {
        // A newer format may describe a job differently; that it is newer is the better reason.
        let value: Value = serde_json::from_slice(json).map_err(|_| JournalError::NoBeginning)?;
        match value["job"]["format"].as_u64() {
            Some(format) if format == u64::from(FORMAT) => {}
            Some(format) => return Err(JournalError::Format(format)),
            None => return Err(JournalError::NoBeginning),
        }
    }
    match serde_json::from_slice(json).map_err(|error| unknown(error.to_string()))? {
        JournalEntry::Job(_) if number != 0 => Err(unknown("a second job".into())),
        entry => Ok(entry),
    }
}

impl<R: BufRead> Iterator for JournalEntries<R> {
    type Item = Result<(u64, JournalEntry), JournalError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.is_over {
            return None;
        }
        let next = self.advance().transpose();
        self.is_over = !matches!(next, Some(Ok(_)));
        next
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::entry::tests::{entries, job};
    use crate::entry::{JobCard, LostEntries};
    use proptest::prelude::*;

    /// A journal of these batches behind the first entry, and the end of each of its lines.
    fn journal(batches: &[Vec<JournalEntry>]) -> (Vec<u8>, Vec<usize>, Vec<JournalEntry>) {
        let first = vec![JournalEntry::Job(Box::new(job("[machine]", JobCard::Sim)))];
        let (mut bytes, mut ends, mut all) = (Vec::new(), Vec::new(), Vec::new());
        for batch in std::iter::once(&first).chain(batches) {
            for (n, entry) in batch.iter().enumerate() {
                let json = serde_json::to_vec(entry).expect("it can be written");
                journal_line::append(&mut bytes, all.len() as u64, n == 0, &json);
                ends.push(bytes.len());
                all.push(entry.clone());
            }
        }
        (bytes, ends, all)
    }

    /// Reads everything up to the end or the first error, which is returned.
    fn read(bytes: &[u8]) -> (Vec<JournalEntry>, JournalTail, Option<JournalError>) {
        let mut reader = JournalEntries::new(bytes);
        let (mut all, mut flaw) = (Vec::new(), None);
        for entry in &mut reader {
            match entry {
                Ok((number, entry)) => {
                    assert_eq!(number, all.len() as u64);
                    all.push(entry);
                }
                Err(found) => flaw = Some(found),
            }
        }
        (all, reader.tail(), flaw)
    }

    fn lost(numbers: std::ops::Range<u64>) -> Vec<JournalEntry> {
        numbers.map(|entries| JournalEntry::Lost(LostEntries { entries })).collect()
    }

    #[test]
    fn cut_anywhere_it_is_read_up_to_the_cut() {
        let (bytes, ends, all) = journal(&[lost(0..3), lost(3..4), lost(4..7)]);
        for cut in 0..=bytes.len() {
            let whole = ends.iter().filter(|&&end| end <= cut).count();
            let (found, tail, flaw) = read(&bytes[..cut]);
            assert_eq!(found, all[..whole], "cut at {cut}");
            if whole == 0 {
                assert!(matches!(flaw, Some(JournalError::NoBeginning)), "cut at {cut}");
                continue;
            }
            let last = ends[whole - 1];
            assert!(flaw.is_none(), "cut at {cut}");
            assert_eq!(tail, JournalTail { whole: last as u64, next: whole as u64, torn: (cut - last) as u64 });
        }
    }

    #[test]
    fn no_bit_can_be_another_without_notice() {
        let (bytes, ends, all) = journal(&[lost(0..3), lost(3..5), lost(5..8)]);
        let last_batch = ends[5];
        for at in 0..bytes.len() {
            for bit in 0..8 {
                let mut changed = bytes.clone();
                changed[at] ^= 1 << bit;
                let (found, tail, flaw) = read(&changed);
                // The line that has the byte, and nothing behind it, is missing.
                let line = ends.iter().filter(|&&end| end <= at).count();
                assert_eq!(found, all[..line], "byte {at}, bit {bit}");
                match flaw {
                    // Batches behind a first line that is damaged show that the job has begun.
                    Some(JournalError::NoBeginning) => panic!("byte {at}, bit {bit}: the job has begun"),
                    Some(JournalError::Damaged { line: result, byte }) => {
                        assert!(at < last_batch);
                        let begins = line.checked_sub(1).map_or(0, |before| ends[before] as u64);
                        assert_eq!((result, byte), (line as u64 + 1, begins));
                    }
                    None => {
                        assert!(at >= last_batch, "byte {at}, bit {bit}: damage before the last batch is not a tear");
                        assert_eq!(tail.torn, (bytes.len() - ends[line - 1]) as u64);
                    }
                    other => panic!("byte {at}, bit {bit}: {other:?}"),
                }
            }
        }
    }

    #[test]
    fn a_line_that_is_missing_or_comes_twice_is_noticed() {
        let (bytes, ends, _) = journal(&[lost(0..3)]);
        let without = [&bytes[..ends[1]], &bytes[ends[2]..]].concat();
        assert!(matches!(read(&without).2, Some(JournalError::Gap { line: 3, number: 3 })));
        let twice = [&bytes[..ends[1]], &bytes[ends[0]..]].concat();
        assert!(matches!(read(&twice).2, Some(JournalError::Gap { line: 3, number: 1 })));
        assert!(matches!(read(&bytes[ends[0]..]).2, Some(JournalError::Gap { line: 1, number: 1 })));
    }

    #[test]
    fn what_a_newer_version_says_is_refused_by_line() {
        let entry =
            |number: u64, json: &str, bytes: &mut Vec<u8>| journal_line::append(bytes, number, true, json.as_bytes());
        let (mut bytes, ..) = journal(&[]);
        entry(1, r#"{"novelty":{}}"#, &mut bytes);
        assert!(matches!(read(&bytes).2, Some(JournalError::Unknown { line: 2, .. })));
        let mut newer = Vec::new();
        let job = format!("{{\"job\":{{\"format\":{},\"whatever\":1}}}}", FORMAT + 1);
        entry(0, &job, &mut newer);
        let flaw = read(&newer).2.expect("refused").to_string();
        assert!(flaw.contains("a newer version") && flaw.contains(&format!("format {}", FORMAT + 1)), "{flaw}");
        let mut none = Vec::new();
        entry(0, r#"{"lost":{"entries":1}}"#, &mut none);
        assert!(matches!(read(&none).2, Some(JournalError::NoBeginning)));
        let (mut twice, ..) = journal(&[]);
        let first = journal_line::parse(&journal(&[]).0).expect("whole").json.to_vec();
        entry(1, &String::from_utf8_lossy(&first), &mut twice);
        assert!(matches!(read(&twice).2, Some(JournalError::Unknown { line: 2, .. })));
    }

    proptest! {
        #[test]
        fn a_journal_of_anything_is_read_as_it_was_written(
            batches in prop::collection::vec(prop::collection::vec(entries(), 1..4), 0..4),
        ) {
            let (bytes, ends, all) = journal(&batches);
            let (found, tail, flaw) = read(&bytes);
            prop_assert!(flaw.is_none());
            prop_assert_eq!(found, all);
            prop_assert_eq!(tail, JournalTail { whole: bytes.len() as u64, next: ends.len() as u64, torn: 0 });
        }

        #[test]
        fn the_last_entry_is_there_whole_or_not_at_all(batch in prop::collection::vec(entries(), 1..4)) {
            let (bytes, ends, all) = journal(&[batch]);
            let before = ends[ends.len() - 2];
            for cut in before..=bytes.len() {
                let (found, _, flaw) = read(&bytes[..cut]);
                prop_assert!(flaw.is_none());
                let whole = if cut == bytes.len() { all.len() } else { all.len() - 1 };
                prop_assert_eq!(&found[..], &all[..whole]);
            }
        }

        #[test]
        fn bytes_of_any_kind_are_read_without_a_panic(mut bytes: Vec<u8>, at: prop::sample::Index, behind: bool) {
            let (whole, ..) = journal(&[lost(0..2)]);
            read(&bytes);
            // and behind, or in the midst of, what is whole
            let at = if behind { whole.len() } else { at.index(whole.len()) };
            let mut mixed = whole[..at].to_vec();
            mixed.append(&mut bytes);
            mixed.extend(&whole[at..]);
            let (found, tail, flaw) = read(&mixed);
            prop_assert!(flaw.is_some() || tail.whole + tail.torn == mixed.len() as u64);
            prop_assert!(found.len() <= 3);
        }
    }
}
