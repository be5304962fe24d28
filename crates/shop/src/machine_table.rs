//! The table of all machines of a shop (SHP-36).
//!
//! Invariant: what a machine has sent cannot steer a terminal: each machine is one line of bounded length without
//! control characters. A state that is too old is shown as not known, with its age.

use std::fmt::Write as _;
use std::time::Duration;

use retrace_journal::Timestamp;

use crate::broker::{MAX_STATE_AGE, MachineState};
use crate::machine_name::MachineName;

/// Longest text of a machine in a cell, in characters.
const MAX_CELL: usize = 40;
/// Number of characters that are shown of the name of a job: its time in milliseconds, which is enough to find it.
const JOB_CHARACTERS: usize = 13;
/// Number of columns.
const COLUMNS: usize = 10;
const HEADINGS: [&str; COLUMNS] =
    ["machine", "state", "job", "program", "line", "done", "rate", "override", "alarm", "since"];

/// Lines of the table, the heading first; `now` is the time by this computer's clock.
#[must_use]
pub fn machine_table(states: &[(MachineName, MachineState)], now: Timestamp) -> String {
    let rows: Vec<[String; COLUMNS]> = states.iter().map(|(name, state)| row(name, state, now)).collect();
    let mut widths = HEADINGS.map(str::len);
    for (column, width) in widths.iter_mut().enumerate() {
        let longest = rows.iter().map(|row| row[column].chars().count()).max();
        *width = longest.unwrap_or_default().max(*width);
    }
    let mut text = String::new();
    push_line(&mut text, HEADINGS, widths);
    for row in &rows {
        push_line(&mut text, row.each_ref().map(String::as_str), widths);
    }
    text
}

fn push_line(text: &mut String, cells: [&str; COLUMNS], widths: [usize; COLUMNS]) {
    for (cell, width) in cells.into_iter().zip(widths) {
        // writing to a string cannot fail
        let _ = write!(text, "{cell:width$}  ");
    }
    text.truncate(text.trim_end_matches(' ').len());
    text.push('\n');
}

fn row(name: &MachineName, state: &MachineState, now: Timestamp) -> [String; COLUMNS] {
    let age_of = |then: Timestamp| duration_text(Duration::from_millis(now.ms().saturating_sub(then.ms())));
    if now.ms().saturating_sub(state.when.ms()) > MAX_STATE_AGE.as_millis() as u64 {
        let mut cells: [String; COLUMNS] = Default::default();
        cells[0] = name.to_string();
        cells[1] = "not known".into();
        cells[COLUMNS - 1] = age_of(state.when);
        return cells;
    }
    let sent = |value: Option<&str>| value.map(|value| cell(value, MAX_CELL)).unwrap_or_default();
    let percent = |value: Option<f64>| value.map(|value| format!("{value:.0} %")).unwrap_or_default();
    let rate = state.rate.map(|rate| {
        let percent = format!("{:.0} %", rate.abs() * 100.0);
        if rate < 0.0 { format!("\u{2190} {percent}") } else { percent }
    });
    [
        name.to_string(),
        sent(state.state.as_deref().or(Some("not operated"))),
        state.job.as_deref().map(|job| cell(job, JOB_CHARACTERS)).unwrap_or_default(),
        sent(state.program.as_deref()),
        state.line.map(|line| line.to_string()).unwrap_or_default(),
        percent(state.done_percent),
        rate.unwrap_or_default(),
        percent(state.override_percent),
        sent(state.alarm.as_ref().map(|(number, _)| number.as_str()).or(state.trouble.as_deref())),
        age_of(state.since),
    ]
}

/// The beginning of a text; a control character is shown as one that has no effect.
fn cell(text: &str, characters: usize) -> String {
    let harmless = |letter: char| if letter.is_control() { char::REPLACEMENT_CHARACTER } else { letter };
    text.chars().take(characters).map(harmless).collect()
}

fn duration_text(age: Duration) -> String {
    match age.as_secs() {
        seconds @ 0..60 => format!("{seconds} s"),
        seconds @ 60..3600 => format!("{} min", seconds / 60),
        seconds @ 3600..172_800 => format!("{} h", seconds / 3600),
        seconds => format!("{} d", seconds / 86_400),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    fn now() -> Timestamp {
        Timestamp::from_ms(1_800_000_000_000)
    }

    /// A machine of this name with these fields of a state, beside those that say nothing.
    fn machine(name: &str, fields: Value) -> (MachineName, MachineState) {
        let mut state = json!({"when": now(), "since": now(), "state": null, "program": null, "line": null,
            "done_percent": null, "rate": null, "override_percent": null, "feed": null, "alarm": null, "pieces": null,
            "jobs": [0, 0], "trouble": null});
        let Value::Object(fields) = fields else { panic!("fields") };
        state.as_object_mut().expect("an object").extend(fields);
        (MachineName::parse(name).expect("a name"), serde_json::from_value(state).expect("a state"))
    }

    #[test]
    fn every_column_shows_what_its_heading_names() {
        let since = Timestamp::from_ms(now().ms() - 125_000);
        let running = json!({"state": "RUNNING", "job": "01a22509-1fde-7f8d-b56a-286eff1a59e6", "since": since,
            "program": "part.ngc", "line": 120, "done_percent": 41.6, "rate": 1.0, "override_percent": 110.0});
        let reversing = json!({"state": "REVERSE", "program": "flange.ngc", "line": 7, "rate": -0.5,
            "override_percent": 100.0, "alarm": ["E2201", "a cause"], "trouble": "E5009"});
        let old = json!({"state": "RUNNING", "job": "01a2", "when": Timestamp::from_ms(now().ms() - 16_000)});
        let states = [
            machine("lathe", json!({"trouble": "E5008"})),
            machine("mill-1", running),
            machine("mill-2", reversing),
            machine("mill-3", old),
        ];
        let shown = machine_table(&states, now());
        let expected = "\
machine  state         job            program     line  done  rate    override  alarm  since
lathe    not operated                                                           E5008  0 s
mill-1   RUNNING       01a22509-1fde  part.ngc    120   42 %  100 %   110 %            2 min
mill-2   REVERSE                      flange.ngc  7           ← 50 %  100 %     E2201  0 s
mill-3   not known                                                                     16 s
";
        assert_eq!(shown, expected, "\n{shown}");
    }

    #[test]
    fn what_a_machine_sends_cannot_steer_the_terminal() {
        let hostile = "\u{1b}[2J\nrunning".repeat(100);
        let sent = json!({"state": hostile, "job": hostile, "program": hostile, "alarm": [hostile, "x"]});
        let table = machine_table(&[machine("mill", sent)], now());
        assert_eq!(table.lines().count(), 2, "{table}");
        assert!(table.chars().all(|letter| letter == '\n' || !letter.is_control()), "{table:?}");
        assert!(table.lines().all(|line| line.chars().count() < 220), "{table}");
    }
}
