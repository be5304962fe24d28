//! A calendar time in UTC, as it is written in the journal and in the names of jobs.
//!
//! Invariant: a time has exactly one written form, and only that form is parsed.

use std::fmt;
use std::str::FromStr;
use std::time::{SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Deserializer, Serialize, Serializer};

const DAY_MS: u64 = 86_400_000;
/// The last millisecond of the year 9999.
const LAST_MS: u64 = 253_402_300_799_999;

/// Milliseconds since the beginning of 1970, UTC, limited to the end of the year 9999. Written as in
/// `2026-11-22T00:46:27.123Z`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Timestamp(u64);

/// Parts of a time.
struct TimestampParts {
    year: u64,
    month: u64,
    day: u64,
    /// Milliseconds of the day.
    ms: u64,
}

impl Timestamp {
    /// Creates a time from milliseconds since the beginning of 1970, UTC. Times beyond the year 9999 become its end.
    #[must_use]
    pub fn from_ms(ms: u64) -> Self {
        Self(ms.min(LAST_MS))
    }

    /// Current time, by the computer's clock.
    #[must_use]
    pub fn now() -> Self {
        Self::from_ms(SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_millis() as u64))
    }

    /// Milliseconds since the beginning of 1970, UTC.
    #[must_use]
    pub fn ms(self) -> u64 {
        self.0
    }

    /// Form that begins the name of a job: `20261122-004627`.
    #[must_use]
    pub fn compact(self) -> String {
        let TimestampParts { year, month, day, ms } = self.parts();
        let s = ms / 1000;
        format!("{year:04}{month:02}{day:02}-{:02}{:02}{:02}", s / 3600, s / 60 % 60, s % 60)
    }

    /// Day, month and year from the number of days, counted from 1 March of the year 0 so that a leap day ends its
    /// year. An era of 400 years has 146 097 days.
    fn parts(self) -> TimestampParts {
        let days = self.0 / DAY_MS + 719_468;
        let (era, of_era) = (days / 146_097, days % 146_097);
        let year_of_era = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
        let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
        let shifted = (5 * of_year + 2) / 153;
        let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
        let year = era * 400 + year_of_era + u64::from(month <= 2);
        TimestampParts { year, month, day: of_year - (153 * shifted + 2) / 5 + 1, ms: self.0 % DAY_MS }
    }

    fn from_parts(parts: &TimestampParts) -> Self {
        let year = parts.year - u64::from(parts.month <= 2);
        let shifted = (parts.month + 9) % 12;
        let of_year = (153 * shifted + 2) / 5 + parts.day - 1;
        let (era, year_of_era) = (year / 400, year % 400);
        let days = era * 146_097 + year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + of_year;
        Self(days.saturating_sub(719_468) * DAY_MS + parts.ms)
    }
}

impl fmt::Display for Timestamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let TimestampParts { year, month, day, ms } = self.parts();
        let s = ms / 1000;
        let (hour, minute, second) = (s / 3600, s / 60 % 60, s % 60);
        write!(f, "{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}.{:03}Z", ms % 1000)
    }
}

/// The text is not a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParseTimestampError;

impl fmt::Display for ParseTimestampError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a moment is written as 2026-11-22T00:46:27.123Z")
    }
}

impl std::error::Error for ParseTimestampError {}

impl FromStr for Timestamp {
    type Err = ParseTimestampError;

    fn from_str(text: &str) -> Result<Self, ParseTimestampError> {
        let number = |from: usize, to: usize| -> Option<u64> {
            let digits = text.get(from..to)?;
            digits.bytes().all(|b| b.is_ascii_digit()).then(|| digits.parse().ok()).flatten()
        };
        let read = || {
            let s = number(11, 13)? * 3600 + number(14, 16)? * 60 + number(17, 19)?;
            let parts = TimestampParts {
                year: number(0, 4)?,
                month: number(5, 7)?,
                day: number(8, 10)?,
                ms: s * 1000 + number(20, 23)?,
            };
            (parts.year >= 1970 && (1..=12).contains(&parts.month) && parts.day >= 1).then(|| Self::from_parts(&parts))
        };
        // An invalid date, such as 31 February, is formatted differently from its input.
        read().filter(|stamp| stamp.to_string() == text).ok_or(ParseTimestampError)
    }
}

impl Serialize for Timestamp {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Timestamp {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        String::deserialize(from)?.parse().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn known_moments() {
        for (ms, text) in [
            (0, "1970-01-01T00:00:00.000Z"),
            (951_782_399_999, "2000-02-28T23:59:59.999Z"),
            (951_782_400_000, "2000-02-29T00:00:00.000Z"),
            (1_700_000_000_123, "2023-11-14T22:13:20.123Z"),
            (LAST_MS, "9999-12-31T23:59:59.999Z"),
        ] {
            assert_eq!(Timestamp::from_ms(ms).to_string(), text);
        }
        assert_eq!(Timestamp::from_ms(1_700_000_000_123).compact(), "20231114-221320");
        assert_eq!(Timestamp::from_ms(u64::MAX).ms(), LAST_MS);
    }

    #[test]
    fn what_is_no_moment_is_refused() {
        for bad in [
            "",
            "2023-02-31T00:00:00.000Z",
            "2023-13-01T00:00:00.000Z",
            "2023-11-14T22:13:20Z",
            "1969-11-14T22:13:20.123Z",
            "2023-11-14T24:00:00.000Z",
            "2023-11-14 22:13:20.123Z",
            "2023-11-14T22:13:20.+23Z",
            "ä023-11-14T22:13:20.123Z",
        ] {
            assert_eq!(bad.parse::<Timestamp>(), Err(ParseTimestampError), "{bad}");
        }
    }

    proptest! {
        #[test]
        fn every_moment_is_read_again(ms in 0..=LAST_MS) {
            let stamp = Timestamp::from_ms(ms);
            prop_assert_eq!(stamp.to_string().parse(), Ok(stamp));
        }
    }
}
