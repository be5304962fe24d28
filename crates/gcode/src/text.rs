//! The text of a file: held in memory where it is small, read again from the file where it is large (PRE-7).
//!
//! Invariant: reading again returns the same bytes as the first time, or an error: every block of a stored file is
//! compared with its checksum. The memory for a stored file is 8 bytes per 64 KiB and 8 bytes per 4096 lines.

use crate::bytes::line_feed;
use crate::line_split::{MAX_HELD_LINE, split};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::sync::{Arc, Mutex, PoisonError};

/// Length of a block in bytes; each has its own checksum.
const BLOCK: usize = 1 << 16;
/// The index has the position of every line whose number is a multiple of this, counted from 0.
const LINES_AN_ENTRY: u64 = 4096;

/// The text of a file, shared.
#[derive(Clone, Debug)]
pub struct Text(TextKind);

#[derive(Clone, Debug)]
enum TextKind {
    Held(Arc<Vec<u8>>),
    Stored(Arc<StoredText>),
}

impl Default for Text {
    fn default() -> Text {
        Text(TextKind::Held(Arc::default()))
    }
}

impl From<Vec<u8>> for Text {
    fn from(bytes: Vec<u8>) -> Text {
        Text(TextKind::Held(Arc::new(bytes)))
    }
}

impl From<&[u8]> for Text {
    fn from(bytes: &[u8]) -> Text {
        Text::from(bytes.to_vec())
    }
}

impl From<&str> for Text {
    fn from(text: &str) -> Text {
        Text::from(text.as_bytes())
    }
}

/// A file that is read again.
#[derive(Debug)]
struct StoredText {
    file: Mutex<File>,
    length: u64,
    lines: u64,
    /// Checksum of each block.
    checksums: Vec<u64>,
    /// Positions of every 4096th line.
    index: Vec<u64>,
}

impl Text {
    /// Maximum length in bytes of a file that is held whole.
    pub const MAX_HELD: u64 = 16 << 20;

    /// Returns the bytes, where the text is held whole.
    #[must_use]
    pub fn held(&self) -> Option<&[u8]> {
        match &self.0 {
            TextKind::Held(bytes) => Some(bytes),
            TextKind::Stored(_) => None,
        }
    }

    /// Reads a file once, from its beginning. `observe` receives its bytes in order.
    ///
    /// # Errors
    /// Errors of the system; the file has grown while it was read.
    pub fn read(file: File, observe: impl FnMut(&[u8])) -> io::Result<Text> {
        Text::read_holding(file, Text::MAX_HELD, observe)
    }

    fn read_holding(mut file: File, most: u64, mut observe: impl FnMut(&[u8])) -> io::Result<Text> {
        let length = file.metadata()?.len();
        if length <= most {
            let mut bytes = Vec::new();
            file.take(most + 1).read_to_end(&mut bytes)?;
            if bytes.len() as u64 > most {
                return Err(changed());
            }
            observe(&bytes);
            return Ok(Text::from(bytes));
        }
        let (mut checksums, mut index, mut lines, mut at) = (Vec::new(), vec![0], 0, 0);
        let mut block = Vec::with_capacity(BLOCK);
        while at < length {
            block.clear();
            (&mut file).take((length - at).min(BLOCK as u64)).read_to_end(&mut block)?;
            if block.is_empty() {
                return Err(changed());
            }
            observe(&block);
            checksums.push(checksum(&block));
            let mut from = 0;
            while let Some(feed) = block.get(from..).and_then(line_feed) {
                from += feed + 1;
                lines += 1;
                if lines % LINES_AN_ENTRY == 0 {
                    index.push(at + from as u64);
                }
            }
            at += block.len() as u64;
        }
        lines += u64::from(block.last() != Some(&b'\n'));
        Ok(Text(TextKind::Stored(Arc::new(StoredText { file: Mutex::new(file), length, lines, checksums, index }))))
    }

    /// Returns the length in bytes.
    pub(crate) fn len(&self) -> u64 {
        match &self.0 {
            TextKind::Held(bytes) => bytes.len() as u64,
            TextKind::Stored(stored) => stored.length,
        }
    }

    /// Returns the number of lines.
    pub(crate) fn lines(&self) -> u64 {
        match &self.0 {
            TextKind::Held(bytes) => crate::line_split::SplitLines::new(bytes).count() as u64,
            TextKind::Stored(stored) => stored.lines,
        }
    }

    /// Returns the bytes between two positions.
    ///
    /// # Errors
    /// The bytes cannot be read, or have changed since the first time.
    pub(crate) fn bytes(&self, from: u64, to: u64) -> io::Result<Vec<u8>> {
        let stored = match &self.0 {
            TextKind::Held(bytes) => return Ok(bytes.get(from as usize..to as usize).unwrap_or_default().to_vec()),
            TextKind::Stored(stored) => stored,
        };
        let mut bytes = Vec::new();
        let mut at = from;
        while at < to {
            let block = stored.block(at / BLOCK as u64)?;
            let begin = (at % BLOCK as u64) as usize;
            let part = block.get(begin..block.len().min(begin + (to - at) as usize)).unwrap_or_default();
            if part.is_empty() {
                break;
            }
            bytes.extend_from_slice(part);
            at += part.len() as u64;
        }
        Ok(bytes)
    }
}

fn changed() -> io::Error {
    io::Error::new(
        io::ErrorKind::InvalidData,
        "E2310: the file was changed while it was in use; check it and begin again",
    )
}

/// Returns the checksum of a block.
fn checksum(block: &[u8]) -> u64 {
    let mix = |sum: u64, word: u64| (sum ^ word).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(29);
    let (words, rest) = block.as_chunks::<8>();
    let mixed = words.iter().fold(0xCBF2_9CE4_8422_2325, |sum, word| mix(sum, u64::from_le_bytes(*word)));
    let mut last = [0; 8];
    last[..rest.len()].copy_from_slice(rest);
    mix(mixed, u64::from_le_bytes(last)) ^ block.len() as u64
}

impl StoredText {
    /// Reads a block again.
    fn block(&self, number: u64) -> io::Result<Vec<u8>> {
        let at = number * BLOCK as u64;
        let mut block = Vec::with_capacity(BLOCK);
        // A thread that panicked while it read has left no state: the position is set each time.
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(at))?;
        (&mut *file).take(self.length.saturating_sub(at).min(BLOCK as u64)).read_to_end(&mut block)?;
        drop(file);
        match self.checksums.get(number as usize) {
            Some(was) if *was == checksum(&block) => Ok(block),
            _ => Err(changed()),
        }
    }
}

/// The lines of a text, one after another. One line is held, and the blocks that contain it.
#[derive(Debug)]
pub(crate) struct TextLines {
    text: Text,
    /// Position of the next line.
    next: u64,
    /// Position of the current line, and its length without its end.
    line: (u64, usize),
    /// Bytes of a stored file, and their position.
    window: Vec<u8>,
    window_at: u64,
}

impl TextLines {
    /// Creates the lines, before the first one.
    pub(crate) fn new(text: Text) -> TextLines {
        TextLines { text, next: 0, line: (0, 0), window: Vec::new(), window_at: 0 }
    }

    /// Creates the lines at the line of this number, from 1, or at the last indexed position before it. Returns the
    /// number of the next line as well.
    pub(crate) fn near(text: Text, line: u64) -> (TextLines, u64) {
        let (next, number) = match &text.0 {
            TextKind::Held(_) => (0, 1),
            TextKind::Stored(stored) => {
                let entry = (line.saturating_sub(1) / LINES_AN_ENTRY).min(stored.index.len() as u64 - 1);
                (stored.index.get(entry as usize).copied().unwrap_or(0), entry * LINES_AN_ENTRY + 1)
            }
        };
        (TextLines { next, ..TextLines::new(text) }, number)
    }

    /// Returns the position of the next line, for [`TextLines::seek`].
    pub(crate) fn position(&self) -> u64 {
        self.next
    }

    /// Makes the line at this position the next one.
    pub(crate) fn seek(&mut self, position: u64) {
        self.next = position;
    }

    /// Reads the next line; false when there is none.
    ///
    /// # Errors
    /// The file cannot be read, or was changed.
    #[inline]
    pub(crate) fn advance(&mut self) -> io::Result<bool> {
        match &self.text.0 {
            TextKind::Held(bytes) => match split(bytes.get(self.next as usize..).unwrap_or_default()) {
                Some((line, taken)) => {
                    self.line = (self.next, line);
                    self.next += taken as u64;
                    Ok(true)
                }
                None => Ok(false),
            },
            TextKind::Stored(stored) => {
                let stored = Arc::clone(stored);
                self.advance_stored(&stored)
            }
        }
    }

    /// Returns the current line, without its end; truncated when it is too long.
    #[inline]
    pub(crate) fn line(&self) -> &[u8] {
        let (from, length) = self.line;
        match &self.text.0 {
            TextKind::Held(bytes) => bytes.get(from as usize..from as usize + length).unwrap_or_default(),
            TextKind::Stored(_) => {
                let from = from.saturating_sub(self.window_at) as usize;
                self.window.get(from..from + length).unwrap_or_default()
            }
        }
    }

    fn advance_stored(&mut self, stored: &StoredText) -> io::Result<bool> {
        if self.next >= stored.length {
            return Ok(false);
        }
        loop {
            let end = self.window_at + self.window.len() as u64;
            if !(self.window_at..end).contains(&self.next) {
                self.window = stored.block(self.next / BLOCK as u64)?;
                self.window_at = self.next / BLOCK as u64 * BLOCK as u64;
                continue;
            }
            let rest = self.window.get((self.next - self.window_at) as usize..).unwrap_or_default();
            if line_feed(rest).is_some() || end >= stored.length {
                let Some((line, taken)) = split(rest) else { return Ok(false) };
                self.line = (self.next, line);
                self.next += taken as u64;
                return Ok(true);
            }
            if rest.len() > MAX_HELD_LINE {
                self.line = (self.next, MAX_HELD_LINE);
                self.next = after_line_feed(stored, end)?;
                return Ok(true);
            }
            let block = stored.block(end / BLOCK as u64)?;
            self.window.drain(..(self.next - self.window_at) as usize);
            self.window_at = self.next;
            self.window.extend_from_slice(&block);
        }
    }
}

/// Returns the position after the next line feed.
fn after_line_feed(stored: &StoredText, from: u64) -> io::Result<u64> {
    let mut at = from;
    while at < stored.length {
        let block = stored.block(at / BLOCK as u64)?;
        if let Some(feed) = line_feed(&block) {
            return Ok(at + feed as u64 + 1);
        }
        at += block.len() as u64;
    }
    Ok(stored.length)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn stored(bytes: &[u8]) -> (tempfile::NamedTempFile, Text) {
        let mut file = tempfile::NamedTempFile::new().expect("a file");
        file.write_all(bytes).expect("written");
        let mut seen = Vec::new();
        let text = Text::read_holding(file.reopen().expect("there"), 10, |part| seen.extend_from_slice(part));
        assert!(seen == bytes);
        (file, text.expect("readable"))
    }

    fn all(mut lines: TextLines) -> Vec<Vec<u8>> {
        let mut all = Vec::new();
        while lines.advance().expect("readable") {
            all.push(lines.line().to_vec());
        }
        all
    }

    /// Lines of all lengths, some of them longer than a block, the last one without an end.
    fn sample() -> Vec<u8> {
        let mut bytes = Vec::new();
        for n in 0..40_000_usize {
            bytes.extend(std::iter::repeat_n(b'a' + (n % 26) as u8, n % 37));
            bytes.extend_from_slice(if n % 5 == 0 { b"\r\n" } else { b"\n" });
            if n % 9_000 == 4_000 {
                bytes.extend(std::iter::repeat_n(b'x', 70_000 * (n / 9_000)));
            }
        }
        bytes.extend_from_slice(b"the last one");
        bytes
    }

    #[test]
    fn a_stored_text_has_the_lines_of_one_that_is_held() {
        let bytes = sample();
        let (_file, text) = stored(&bytes);
        let held = Text::from(bytes.as_slice());
        assert_eq!((text.len(), text.lines()), (held.len(), held.lines()));
        let lines = all(TextLines::new(held.clone()));
        assert!(all(TextLines::new(text.clone())) == lines && lines.len() as u64 == text.lines());
        for number in [1, 2, 4096, 4097, 4098, 8193, 39_999, 40_001] {
            let (mut near, mut at) = TextLines::near(text.clone(), number);
            assert!(number - at < LINES_AN_ENTRY);
            while near.advance().expect("readable") && at < number {
                at += 1;
            }
            assert_eq!(near.line(), lines[number as usize - 1], "{number}");
        }
        for (from, to) in [(0, 10), (65_530, 65_540), (1, 200_000), (text.len() - 5, text.len())] {
            assert!(text.bytes(from, to).expect("readable") == bytes[from as usize..to as usize]);
        }
    }

    #[test]
    fn a_place_can_be_come_back_to() {
        let (_file, text) = stored(&sample());
        let mut lines = TextLines::new(text);
        let (mut place, mut was) = (0, Vec::new());
        for n in 0..20_000 {
            if n == 7_000 {
                place = lines.position();
            }
            assert!(lines.advance().expect("readable"));
            if n == 7_000 {
                was = lines.line().to_vec();
            }
        }
        lines.seek(place);
        assert!(lines.advance().expect("readable") && lines.line() == was);
    }

    #[test]
    fn a_file_that_was_changed_or_cut_off_is_noticed() {
        let bytes = sample();
        let (file, text) = stored(&bytes);
        let mut other = bytes.clone();
        other[300_000] ^= 1;
        std::fs::write(file.path(), &other).expect("written");
        let mut lines = TextLines::new(text);
        let error = loop {
            match lines.advance() {
                Ok(more) => assert!(more, "the change is noticed"),
                Err(error) => break error,
            }
        };
        assert!(lines.position() < 300_000 && error.to_string().contains("E2310"), "{error}");
        let (file, text) = stored(&bytes);
        file.as_file().set_len(200_000).expect("cut off");
        let mut lines = TextLines::new(text);
        while let Ok(more) = lines.advance() {
            assert!(more, "it is noticed");
        }
        assert!(lines.position() < 200_000);
    }
}
