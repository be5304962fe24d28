//! Differences between two texts of a machine file, for people.
//!
//! Invariant: two texts with different values differ here; a text that cannot be parsed is a difference, never an
//! error.

use std::collections::BTreeMap;

use toml::{Table, Value};

/// Maximum number of lines.
const MAX_LINES: usize = 40;

/// Changes of a machine file, one line per key: `axis x, max_velocity_mm_per_s: 100 in the job, 80 now`. A change of
/// only comments and order gives one line that reports it.
#[must_use]
pub fn machine_changes(job: &str, now: &str) -> Vec<String> {
    let (Ok(was), Ok(is)) = (job.parse::<Table>(), now.parse::<Table>()) else {
        return vec!["it cannot be read any more: it is not a machine file".into()];
    };
    let (was, is) = (flat(&was), flat(&is));
    let mut lines = Vec::new();
    for (key, value) in &was {
        match is.get(key) {
            None => lines.push(format!("{key}: {value} in the job, not there now")),
            Some(new) if new != value => lines.push(format!("{key}: {value} in the job, {new} now")),
            Some(_) => {}
        }
    }
    for (key, value) in is.iter().filter(|(key, _)| !was.contains_key(*key)) {
        lines.push(format!("{key}: not there in the job, {value} now"));
    }
    if lines.len() > MAX_LINES {
        let more = lines.len() - MAX_LINES;
        lines.truncate(MAX_LINES);
        lines.push(format!("and {more} more"));
    }
    if lines.is_empty() {
        lines.push("comments and layout alone: every value is as it was".into());
    }
    lines
}

/// Every value by its path.
fn flat(table: &Table) -> BTreeMap<String, String> {
    let mut all = BTreeMap::new();
    gather("", table, &mut all);
    all
}

fn gather(path: &str, table: &Table, all: &mut BTreeMap<String, String>) {
    for (key, value) in table {
        let path = if path.is_empty() { key.clone() } else { format!("{path}, {key}") };
        match value {
            Value::Table(table) => gather(&path, table, all),
            Value::Array(items) if items.iter().any(Value::is_table) => {
                for (index, item) in items.iter().enumerate() {
                    // An axis is identified by its name, an input by its number.
                    let name = ["name", "number", "kind"].iter().find_map(|key| item.get(key));
                    let name = name.map_or_else(|| (index + 1).to_string(), text_of);
                    match item {
                        Value::Table(table) => gather(&format!("{path} {name}"), table, all),
                        other => drop(all.insert(format!("{path} {name}"), text_of(other))),
                    }
                }
            }
            other => drop(all.insert(path, text_of(other))),
        }
    }
}

fn text_of(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_changed_is_named_by_axis_and_key() {
        let job = "name = \"mill\"\n[card]\nwatchdog_ms = 20\n[[axis]]\nname = \"x\"\npulses_per_mm = \
            100\n[[axis]]\nname = \"y\"\ntravel_mm = [0, 5]\n";
        let now = job.replace("100", "200").replace("[0, 5]", "[0, 6]").replace("watchdog_ms", "window_ms");
        assert_eq!(
            machine_changes(job, &now),
            [
                "axis x, pulses_per_mm: 100 in the job, 200 now",
                "axis y, travel_mm: [0, 5] in the job, [0, 6] now",
                "card, watchdog_ms: 20 in the job, not there now",
                "card, window_ms: not there in the job, 20 now",
            ]
        );
        assert_eq!(
            machine_changes(job, &format!("# mine\n{job}")),
            ["comments and layout alone: every value is as it was"]
        );
        assert!(machine_changes(job, "[[[").first().is_some_and(|line| line.contains("cannot be read")));
    }
}
