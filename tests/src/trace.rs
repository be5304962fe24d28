//! Instructions in the trace of a served card: how many were executed, and what they switched in which order.
//!
//! Invariant: the trace is read while it is written, through a named pipe; nothing of it is stored on the disk.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread::{self, JoinHandle};

/// Actions of the card other than its motion.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Switched {
    /// Number of the last instruction executed, each time that it changed.
    pub executed: Vec<u64>,
    /// Every change of a digital output: its name, and whether it came on.
    pub outputs: Vec<(String, bool)>,
}

/// A trace being read.
#[derive(Debug)]
pub struct Reading(JoinHandle<Switched>);

/// Creates the pipe that a card writes its trace to, and reads it; the reading ends with the card.
///
/// # Panics
/// Where the system creates no such pipe.
#[must_use]
pub fn piped(path: PathBuf) -> Reading {
    let made = Command::new("mkfifo").arg(&path).status().expect("mkfifo runs");
    assert!(made.success(), "a pipe with a name");
    Reading(thread::spawn(move || read(&path)))
}

impl Reading {
    /// Actions of the card; waits until it has ended.
    ///
    /// # Panics
    /// Where the trace cannot be read.
    #[must_use]
    pub fn ended(self) -> Switched {
        self.0.join().expect("the trace is read")
    }
}

fn read(path: &Path) -> Switched {
    let mut trace = BufReader::with_capacity(1 << 16, File::open(path).expect("the pipe"));
    let (mut names, mut switched, mut line) = (HashMap::new(), Switched::default(), Vec::new());
    while trace.read_until(b'\n', &mut line).is_ok_and(|count| count > 0) {
        parse_line(line.trim_ascii_end(), &mut names, &mut switched);
        line.clear();
    }
    switched
}

/// Parses a line: a declaration, or a change of a value.
fn parse_line(line: &[u8], names: &mut HashMap<Vec<u8>, String>, switched: &mut Switched) {
    match line {
        [b'$', ..] => {
            let words: Vec<&str> = std::str::from_utf8(line).unwrap_or_default().split(' ').collect();
            if let ["$var", _, _, code, name, "$end"] = words[..]
                && (name == "executed" || name.starts_with("out"))
            {
                names.insert(code.into(), name.into());
            }
        }
        [value @ (b'0' | b'1'), code @ ..] => {
            let is_on = *value == b'1';
            // all are off at first
            if let Some(name) = names.get(code)
                && (is_on || switched.outputs.iter().any(|(known, _)| known == name))
            {
                switched.outputs.push((name.clone(), is_on));
            }
        }
        [b'b', rest @ ..] => {
            let Some((number, code)) = std::str::from_utf8(rest).ok().and_then(|rest| rest.split_once(' ')) else {
                return;
            };
            if names.contains_key(code.as_bytes()) {
                switched.executed.extend(u64::from_str_radix(number, 2));
            }
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instructions_and_outputs_are_told_from_the_rest() {
        let (mut names, mut switched) = (HashMap::new(), Switched::default());
        let text = "$scope module x $end\n$var wire 1 ! step $end\n$var integer 32 \" executed $end\n$var wire 1 # \
            out7 $end\n\
            $var integer 32 $ line $end\n#0\n0!\n0#\nb0 \"\n#5\n1!\nb11 $\nb10 \"\n1#\n0#\n";
        text.lines().for_each(|line| parse_line(line.as_bytes(), &mut names, &mut switched));
        let outputs = [("out7", true), ("out7", false)].map(|(name, on)| (name.to_owned(), on)).to_vec();
        assert_eq!(switched, Switched { executed: vec![0, 2], outputs });
    }
}
