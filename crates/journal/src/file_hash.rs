//! Hash of a file's content, which distinguishes its versions.
//!
//! Invariant: a hash depends on the bytes alone, not on how they are divided. It distinguishes files; it does not
//! protect against forgery.

use std::fmt;
use std::io::{self, Read};
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Fowler-Noll-Vo hash, variant 1a, of 128 bits; written as 32 hexadecimal digits.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct FileHash(u128);

impl FileHash {
    /// Hash of no bytes.
    const BASIS: u128 = 0x6c62_272e_07bb_0142_62b8_2175_6295_c58d;
    const PRIME: u128 = 0x0000_0000_0100_0000_0000_0000_0000_013b;

    /// Hash of these bytes.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        Self(Self::BASIS).extend(bytes)
    }

    /// The last 32 bits.
    #[must_use]
    pub fn low_32(self) -> u32 {
        self.0 as u32
    }

    /// Hash of everything that can be read from `from`.
    ///
    /// # Errors
    /// The error of the reader.
    pub fn of_reader(mut from: impl Read) -> io::Result<Self> {
        let (mut hash, mut buffer) = (Self(Self::BASIS), vec![0; 1 << 16]);
        loop {
            match from.read(&mut buffer)? {
                0 => return Ok(hash),
                n => hash = hash.extend(&buffer[..n]),
            }
        }
    }

    /// The lower 64 bits, where 128 do not fit.
    #[must_use]
    pub fn low_64(self) -> u64 {
        (self.0 ^ (self.0 >> 64)) as u64
    }

    /// Hash of the bytes hashed so far, followed by these bytes.
    #[must_use]
    pub fn extend(self, bytes: &[u8]) -> Self {
        Self(bytes.iter().fold(self.0, |hash, &byte| (hash ^ u128::from(byte)).wrapping_mul(Self::PRIME)))
    }
}

impl fmt::Display for FileHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:032x}", self.0)
    }
}

impl fmt::Debug for FileHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// The text is not a hash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParseHashError;

impl fmt::Display for ParseHashError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a hash has 32 hexadecimal digits")
    }
}

impl std::error::Error for ParseHashError {}

impl FromStr for FileHash {
    type Err = ParseHashError;

    fn from_str(text: &str) -> Result<Self, ParseHashError> {
        let is_one = text.len() == 32 && text.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
        u128::from_str_radix(text, 16).ok().filter(|_| is_one).map(Self).ok_or(ParseHashError)
    }
}

impl Serialize for FileHash {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for FileHash {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        String::deserialize(from)?.parse().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_published_one_however_the_bytes_come() {
        // The published test vectors of FNV-1a, 128 bits.
        assert_eq!(FileHash::of(b"").to_string(), "6c62272e07bb014262b821756295c58d");
        assert_eq!(FileHash::of(b"a").to_string(), "d228cb696f1a8caf78912b704e4a8964");
        let long: Vec<u8> = (0..200_000u32).map(|n| (n.wrapping_mul(n) >> 3) as u8).collect();
        assert_eq!(FileHash::of_reader(&long[..]).ok(), Some(FileHash::of(&long)));
        assert_ne!(FileHash::of(&long), FileHash::of(&long[1..]));
    }

    #[test]
    fn what_is_written_is_read_again_and_nothing_else() {
        let hash = FileHash::of(b"G1 X1");
        assert_eq!(hash.to_string().parse(), Ok(hash));
        for bad in ["", "00", "+2628272e07bb014262b821756295c58d", "6C62272e07bb014262b821756295c58d"] {
            assert_eq!(bad.parse::<FileHash>(), Err(ParseHashError), "{bad}");
        }
    }
}
