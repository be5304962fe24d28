//! Identity of a shop job: a UUID of version 7 (RFC 9562), made by the submitter.
//!
//! Invariant: an identity has exactly one written form, which is a plain file name. Identities that are made later on
//! one computer sort behind, to the millisecond of its clock.

use std::fmt;
use std::str::FromStr;

use retrace_config::NumberedError;
use retrace_journal::Timestamp;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Lengths of the groups of digits, as written.
const GROUPS: [usize; 5] = [8, 4, 4, 4, 12];

/// Identity of a shop job: 48 bits of milliseconds since the beginning of 1970, UTC, then 74 random bits. Written as
/// `0192f0c1-2b3c-7def-8123-456789abcdef`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ShopJobId(u128);

impl ShopJobId {
    /// A new identity, from the clock and the random numbers of the operating system.
    ///
    /// # Errors
    /// `E5010` where the system has no random numbers.
    pub fn new_now() -> Result<Self, NumberedError> {
        let mut random = [0; 10];
        getrandom::fill(&mut random).map_err(|error| {
            let what = format!("the operating system has no random numbers: {error}");
            NumberedError::new("E5010", what, "repeat the command; see the messages of the operating system")
        })?;
        Ok(Self::from_parts(Timestamp::now().ms(), random))
    }

    /// The identity of this time in milliseconds and of these random bits, of which six are not used.
    #[must_use]
    pub fn from_parts(ms: u64, random: [u8; 10]) -> Self {
        let mut bytes = [0; 16];
        bytes[..6].copy_from_slice(&ms.to_be_bytes()[2..]);
        bytes[6..].copy_from_slice(&random);
        bytes[6] = 0x70 | bytes[6] & 0x0f;
        bytes[8] = 0x80 | bytes[8] & 0x3f;
        Self(u128::from_be_bytes(bytes))
    }
}

impl fmt::Display for ShopJobId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let digits = format!("{:032x}", self.0);
        let mut from = 0;
        for (number, length) in GROUPS.into_iter().enumerate() {
            let dash = if number == 0 { "" } else { "-" };
            write!(f, "{dash}{}", &digits[from..from + length])?;
            from += length;
        }
        Ok(())
    }
}

/// The text is not an identity of a shop job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParseShopJobIdError;

impl fmt::Display for ParseShopJobIdError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a shop job is named like 0192f0c1-2b3c-7def-8123-456789abcdef")
    }
}

impl std::error::Error for ParseShopJobIdError {}

impl FromStr for ShopJobId {
    type Err = ParseShopJobIdError;

    fn from_str(text: &str) -> Result<Self, ParseShopJobIdError> {
        let digits: String = text.chars().filter(|&letter| letter != '-').collect();
        let id = u128::from_str_radix(&digits, 16).map(Self).map_err(|_| ParseShopJobIdError)?;
        let is_version_7 = id.0 >> 76 & 0xf == 7 && id.0 >> 62 & 3 == 2;
        // any other spelling is written differently
        if is_version_7 && id.to_string() == text { Ok(id) } else { Err(ParseShopJobIdError) }
    }
}

impl Serialize for ShopJobId {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for ShopJobId {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        String::deserialize(from)?.parse().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_example_of_the_standard() {
        // RFC 9562, appendix A.6: unix_ts_ms 0x017F22E279B0, rand_a 0xCC3, rand_b 0x18C4DC0C0C07398F
        let random = [0x0c, 0xc3, 0x18, 0xc4, 0xdc, 0x0c, 0x0c, 0x07, 0x39, 0x8f];
        let id = ShopJobId::from_parts(0x017F_22E2_79B0, random);
        assert_eq!(id.to_string(), "017f22e2-79b0-7cc3-98c4-dc0c0c07398f");
        assert_ne!(ShopJobId::new_now().expect("random"), ShopJobId::new_now().expect("random"));
    }

    #[test]
    fn only_the_written_form_is_parsed() {
        for bad in [
            "",
            "017F22E2-79B0-7CC3-98C4-DC0C0C07398F",
            "017f22e279b07cc398c4dc0c0c07398f",
            "017f22e2-79b0-4cc3-98c4-dc0c0c07398f",
            "017f22e2-79b0-7cc3-18c4-dc0c0c07398f",
            "+17f22e2-79b0-7cc3-98c4-dc0c0c07398f",
            "../../etc/passwd",
        ] {
            assert_eq!(bad.parse::<ShopJobId>(), Err(ParseShopJobIdError), "{bad}");
        }
    }

    proptest! {
        #[test]
        fn every_identity_is_read_again_and_sorts_by_time(ms in 0..1_u64 << 47, random: [u8; 10], later: [u8; 10]) {
            let id = ShopJobId::from_parts(ms, random);
            prop_assert_eq!(id.to_string().parse(), Ok(id));
            prop_assert!(id.to_string() < ShopJobId::from_parts(ms + 1, later).to_string());
        }
    }
}
