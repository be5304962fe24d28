//! Why a port cannot be opened, with what to do.
//!
//! Invariant: every number used here stands in `docs/errors.md`, and every message names the port and a next step.

use std::fmt;
use std::path::Path;

use crate::Address;

/// A port that was not opened: its number in the table of errors, what is wrong, and what to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PortError {
    /// Its number, `E2…`.
    pub number: &'static str,
    /// What is wrong.
    pub what: String,
    /// What to do about it.
    pub remedy: String,
}

impl fmt::Display for PortError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "error[{}]: {}\n  help: {}", self.number, self.what, self.remedy)
    }
}

impl std::error::Error for PortError {}

impl PortError {
    fn new(number: &'static str, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { number, what: what.into(), remedy: remedy.into() }
    }

    /// What was given names no port.
    pub(crate) fn address(text: &str, why: &str) -> Self {
        Self::new("E2148", format!("`{text}` names no port: {why}"), "PATH or PATH@BAUD, as in /dev/ttyUSB0@230400")
    }

    /// There is no such device file; `back_target_reached` are those that are.
    pub(crate) fn absent(path: &Path, there: &[String]) -> Self {
        let remedy = if there.is_empty() {
            "plug the card in; no serial port is there now (a pseudo-terminal is never in the list)".to_owned()
        } else {
            format!("check the cable and the name; there are: {}", there.join(", "))
        };
        Self::new("E2141", format!("there is no port {}", path.display()), remedy)
    }

    /// Somebody else has it open.
    pub(crate) fn busy(path: &Path, holder: Option<String>) -> Self {
        let what = match &holder {
            Some(holder) => format!("the port {} is in use, by {holder}", path.display()),
            None => format!("the port {} is in use by another program", path.display()),
        };
        let remedy = match holder {
            Some(_) => "close that program, then try again".to_owned(),
            None => format!("close it; `fuser {}` names it (ModemManager is a common one)", path.display()),
        };
        Self::new("E2144", what, remedy)
    }

    /// Its permissions forbid it; `group` is the group of the device file.
    pub(crate) fn forbidden(path: &Path, group: Option<&str>) -> Self {
        let remedy = match group {
            Some("root") | None => {
                "ask for permission to it, or write an udev rule that gives it to a group".to_owned()
            }
            Some(group) => format!("join its group with `sudo usermod -aG {group} $USER`, then log out and in again"),
        };
        Self::new("E2145", format!("the port {} may not be opened", path.display()), remedy)
    }

    /// It is there, and is not a serial port, or does not take the settings.
    pub(crate) fn unfit(address: &Address, why: &str) -> Self {
        let what =
            format!("{} cannot be used as a serial port at {} baud: {why}", address.path.display(), address.baud);
        Self::new("E2146", what, "name a serial port, or a baud rate that its driver has: 115200, 230400, 1000000")
    }

    /// It did not come back.
    pub(crate) fn gone(address: &Address, seconds: f64, why: &PortError) -> Self {
        let what =
            format!("the line to {} was lost, and did not come back within {seconds:.1} s", address.path.display());
        Self::new("E2147", what, format!("{}: {}", why.what, why.remedy))
    }
}

/// The group of a device file, by name, else by number.
#[cfg(unix)]
pub(crate) fn group_of(path: &Path) -> Option<String> {
    use std::os::unix::fs::MetadataExt;
    let id = std::fs::metadata(path).ok()?.gid();
    let groups = std::fs::read_to_string("/etc/group").unwrap_or_default();
    Some(group_named(&groups, id).unwrap_or_else(|| id.to_string()))
}

/// A device file has no group here.
#[cfg(not(unix))]
pub(crate) fn group_of(_: &Path) -> Option<String> {
    None
}

/// The name of a group in a table of groups: a line is `name:password:number:members`.
fn group_named(table: &str, id: u32) -> Option<String> {
    table.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)? == id.to_string()).then(|| name.to_owned())
    })
}

/// Who has a file open, where the system tells us: another user's programs it does not.
pub(crate) fn holder_of(path: &Path) -> Option<String> {
    let path = path.canonicalize().ok()?;
    let own = std::process::id().to_string();
    std::fs::read_dir("/proc").ok()?.flatten().find_map(|process| {
        let number = process.file_name().into_string().ok().filter(|n| n.bytes().all(|b| b.is_ascii_digit()))?;
        let open = std::fs::read_dir(process.path().join("fd")).ok()?;
        let holds = open.flatten().any(|file| std::fs::read_link(file.path()).is_ok_and(|target| target == path));
        if !holds {
            return None;
        }
        if number == own {
            return Some("this program itself".to_owned());
        }
        let name = std::fs::read_to_string(process.path().join("comm")).unwrap_or_default();
        Some(format!("`{}` (process {number})", name.trim()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_group_to_join_is_named() {
        let table = "root:x:0:\ndialout:x:20:ann,bob\nbroken\nuucp:x:14:";
        assert_eq!(group_named(table, 20).as_deref(), Some("dialout"));
        assert_eq!(group_named(table, 15), None);
        let refused = PortError::forbidden(Path::new("/dev/ttyUSB0"), Some("dialout"));
        assert!(refused.to_string().contains("sudo usermod -aG dialout $USER"), "{refused}");
        let refused = PortError::forbidden(Path::new("/dev/ttyS0"), Some("root"));
        assert!(!refused.to_string().contains("usermod"), "nobody is to join the group root: {refused}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn whoever_has_a_file_open_is_named() {
        let file = tempfile::NamedTempFile::new().expect("a file");
        assert_eq!(holder_of(file.path()).as_deref(), Some("this program itself"));
        let path = file.path().to_owned();
        drop(file);
        assert_eq!(holder_of(&path), None);
    }
}
