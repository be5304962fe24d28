//! Errors of opening a port, each with a remedy.
//!
//! Invariant: every number used here is in `docs/errors.md`, and every message names the port and a next step.

use std::fmt;
use std::path::Path;

/// A port that was not opened: number in the table of errors, cause and remedy.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PortError {
    /// Number of the error, `E2…`.
    pub number: &'static str,
    /// What happened.
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
    pub(crate) fn new(number: &'static str, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { number, what: what.into(), remedy: remedy.into() }
    }

    /// The given text does not name a port.
    pub(crate) fn address(text: &str, why: &str) -> Self {
        Self::new(
            "E2148",
            format!("`{text}` is not the address of a port: {why}"),
            "write PATH or PATH@BAUD, as in /dev/ttyUSB0@230400",
        )
    }

    /// The device file does not exist; `there` are those that do.
    pub(crate) fn absent(path: &Path, there: &[String]) -> Self {
        let remedy = if there.is_empty() {
            "plug the card in; no serial port is connected (pseudo-terminals are never listed)".to_owned()
        } else {
            format!("check the cable and the name; connected ports: {}", there.join(", "))
        };
        Self::new("E2141", format!("the port {} does not exist", path.display()), remedy)
    }

    /// Another program has it open.
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
                "ask the administrator for access, or write a udev rule that gives the port to a group".to_owned()
            }
            Some(group) => format!("join its group with `sudo usermod -aG {group} $USER`, then log out and in again"),
        };
        Self::new("E2145", format!("the port {} cannot be opened: permission denied", path.display()), remedy)
    }
}

/// Group of a device file, by name, otherwise by number.
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

/// Name of a group in a table of groups: a line is `name:password:number:members`.
fn group_named(table: &str, id: u32) -> Option<String> {
    table.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)? == id.to_string()).then(|| name.to_owned())
    })
}

/// Program that has a file open, where the system shows it: it hides those of other users.
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
