//! Address of a port: `PATH[@BAUD]`.
//!
//! Invariant: an address that was accepted can be written again with the same meaning.

use std::fmt;
use std::path::{Path, PathBuf};

use crate::PortError;

/// Bits per second where the address has none.
pub const BAUD: u32 = 1_000_000;
/// Lowest accepted rate, bits per second.
const MIN_BAUD: u32 = 9_600;
/// Highest accepted rate, bits per second: the limit of the fastest common USB adapters.
const MAX_BAUD: u32 = 12_000_000;

/// Address of a card: a device file, and the baud rate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// The device file, such as `/dev/ttyUSB0`, or a link to it.
    pub path: PathBuf,
    /// Bits per second, ten of them to a byte: 9 600 … 12 000 000.
    pub baud: u32,
}

impl Address {
    /// Parses `PATH[@BAUD]`. The text behind the last `@` is the baud rate if it is a number. Otherwise it belongs to
    /// the path, as in some names of the folder `/dev/serial/by-id`.
    ///
    /// # Errors
    /// `E2148`: no path, or a baud rate out of range.
    ///
    /// # Examples
    ///
    /// ```
    /// use retrace_hal_serial::Address;
    /// let address = Address::parse("/dev/ttyUSB0@460800")?;
    /// assert_eq!(address.baud, 460_800);
    /// assert!(Address::parse("/dev/ttyUSB0@1").is_err());
    /// # Ok::<(), retrace_hal_serial::PortError>(())
    /// ```
    pub fn parse(text: &str) -> Result<Self, PortError> {
        let (path, baud) = match text.rsplit_once('@') {
            Some((path, baud)) if !baud.is_empty() && baud.bytes().all(|b| b.is_ascii_digit()) => (path, Some(baud)),
            Some((path, _)) if !Path::new(text).exists() && !path.is_empty() => {
                return Err(PortError::address(text, "the text after @ is not a baud rate"));
            }
            _ => (text, None),
        };
        if path.is_empty() {
            return Err(PortError::address(text, "the path of the port is missing"));
        }
        let baud = match baud.map(str::parse::<u32>) {
            None => BAUD,
            Some(Ok(baud)) if (MIN_BAUD..=MAX_BAUD).contains(&baud) => baud,
            Some(_) => return Err(PortError::address(text, "a baud rate is a number from 9600 to 12000000")),
        };
        Ok(Self { path: path.into(), baud })
    }

    /// Time that a byte takes on the serial line, in nanoseconds: a start bit, eight bits and a stop bit.
    #[must_use]
    pub const fn byte_ns(&self) -> u64 {
        10_000_000_000 / self.baud as u64
    }

    /// It exists, but is not a serial port, or does not accept the settings.
    pub(crate) fn unfit(&self, why: &str) -> PortError {
        let what = format!("{} cannot be used as a serial port at {} baud: {why}", self.path.display(), self.baud);
        PortError::new("E2146", what, "name a serial port, or a baud rate that its driver has: 115200, 230400, 1000000")
    }

    /// It did not reappear.
    pub(crate) fn gone(&self, seconds: f64, why: &PortError) -> PortError {
        let what = format!("the line to {} was lost, and did not reappear within {seconds:.1} s", self.path.display());
        PortError::new("E2147", what, format!("{}: {}", why.what, why.remedy))
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}@{}", self.path.display(), self.baud)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_path_with_and_without_a_baud_rate() {
        let plain = Address::parse("/dev/ttyUSB0").expect("a path");
        assert_eq!((plain.path.as_path(), plain.baud), (Path::new("/dev/ttyUSB0"), BAUD));
        let slow = Address::parse("/dev/ttyUSB0@230400").expect("a path and a rate");
        assert_eq!((slow.path.as_path(), slow.baud, slow.byte_ns()), (Path::new("/dev/ttyUSB0"), 230_400, 43_402));
        for bad in ["", "@115200", "/dev/ttyUSB0@", "/dev/ttyUSB0@fast", "/dev/ttyUSB0@0", "/dev/ttyUSB0@99999999999"] {
            assert_eq!(Address::parse(bad).map_err(|r| r.number), Err("E2148"), "{bad}");
        }
    }

    #[test]
    fn a_file_whose_name_has_an_at_sign_is_a_path() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("usb-card@left");
        std::fs::write(&path, "").expect("a file");
        let text = path.display().to_string();
        assert_eq!(Address::parse(&text).expect("a path").path, path);
        assert_eq!(Address::parse(&format!("{text}@115200")).expect("a path and a rate").baud, 115_200);
    }

    proptest! {
        #[test]
        fn any_text_is_refused_or_survives_being_written_and_parsed_again(text in "[/a-z@0-9 ]{0,24}") {
            if let Ok(address) = Address::parse(&text) {
                prop_assert_eq!(Address::parse(&address.to_string()), Ok(address));
            }
        }
    }
}
