//! Hash of a content that may come from somebody else.
//!
//! Invariant: nobody can make two contents with one hash (SHA-256); the hash depends on the bytes alone.

use std::fmt;
use std::io::{self, Read, Write};
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use sha2::{Digest, Sha256};

/// SHA-256 of a content, written as 64 hexadecimal digits.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ContentHash([u8; 32]);

impl ContentHash {
    /// Hash of these bytes.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        Self(Sha256::digest(bytes).into())
    }

    /// Copies everything from a reader to a writer, up to `limit` bytes. Returns hash and number of the bytes copied;
    /// a number greater than `limit` where the reader has more.
    ///
    /// # Errors
    /// The error of reader or writer.
    pub fn of_copy(mut from: impl Read, mut to: impl Write, limit: u64) -> io::Result<(Self, u64)> {
        let (mut hash, mut buffer, mut bytes) = (Sha256::new(), vec![0; 1 << 16], 0_u64);
        loop {
            let read = match from.read(&mut buffer) {
                Ok(read) => read,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(error),
            };
            bytes += read as u64;
            if read == 0 || bytes > limit {
                return Ok((Self(hash.finalize().into()), bytes));
            }
            hash.update(&buffer[..read]);
            to.write_all(&buffer[..read])?;
        }
    }

    /// The first eight digits, for names that a person reads.
    #[must_use]
    pub fn short(&self) -> String {
        self.to_string().chars().take(8).collect()
    }
}

impl fmt::Display for ContentHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for ContentHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// The text is not a hash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParseContentHashError;

impl fmt::Display for ParseContentHashError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a hash has 64 hexadecimal digits in lower case")
    }
}

impl std::error::Error for ParseContentHashError {}

impl FromStr for ContentHash {
    type Err = ParseContentHashError;

    fn from_str(text: &str) -> Result<Self, ParseContentHashError> {
        let mut bytes = [0; 32];
        let is_digit = |byte: u8| matches!(byte, b'0'..=b'9' | b'a'..=b'f');
        if text.len() != 64 || !text.bytes().all(is_digit) {
            return Err(ParseContentHashError);
        }
        for (number, byte) in bytes.iter_mut().enumerate() {
            let digits = &text[2 * number..2 * number + 2];
            *byte = u8::from_str_radix(digits, 16).map_err(|_| ParseContentHashError)?;
        }
        Ok(Self(bytes))
    }
}

impl Serialize for ContentHash {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for ContentHash {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        String::deserialize(from)?.parse().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_values_and_one_written_form() {
        // FIPS 180-4, examples
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(ContentHash::of(b"abc").to_string(), abc);
        assert_eq!(abc.parse(), Ok(ContentHash::of(b"abc")));
        for bad in ["", &abc[1..], &abc.to_uppercase(), &abc.replace('b', "g"), &format!("+{}", &abc[1..])] {
            assert_eq!(bad.parse::<ContentHash>(), Err(ParseContentHashError), "{bad}");
        }
        let long = vec![7; 200_000];
        let mut copy = Vec::new();
        assert_eq!(ContentHash::of_copy(&long[..], &mut copy, 200_000).ok(), Some((ContentHash::of(&long), 200_000)));
        assert_eq!(copy, long);
        let (_, bytes) = ContentHash::of_copy(&long[..], io::sink(), 199_999).expect("read");
        assert!(bytes > 199_999);
    }
}
