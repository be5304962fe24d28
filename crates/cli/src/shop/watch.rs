//! `retrace shop watch`: a table of what the machines of the shop do (SHP-36).
//!
//! Invariant: a state that is too old is shown as not known, with its age.

use std::io::IsTerminal;
use std::thread;
use std::time::Duration;

use retrace_config::NumberedError;
use retrace_journal::Timestamp;
use retrace_shop::{MAX_STATE_AGE, MachineName, MachineState, ShopFile, machine_states};
use serde_json::{Value, json};

use super::host::connect;
use crate::escape;
use crate::jobs::table;

/// Longest text of a machine in a cell, in characters.
const MAX_CELL: usize = 40;
/// Time between two tables.
const INTERVAL: Duration = Duration::from_secs(1);

/// Runs the command.
///
/// # Errors
/// `E5040` to `E5036`; with `once` also those of a broker that is away.
pub fn run(file: &ShopFile, once: bool, is_json: bool) -> Result<(), NumberedError> {
    let connection = connect(file)?;
    loop {
        match machine_states(&connection) {
            Ok(states) if is_json => crate::out::line(states_json(&states)),
            Ok(states) => show(once, &rows(&states, Timestamp::now())),
            Err(error) if once => return Err(error),
            // one line, and the table again when it is back
            Err(error) => show(once, &format!("the broker is away: {}\n", escape::lines(&error.cause))),
        }
        if once {
            return Ok(());
        }
        thread::sleep(INTERVAL);
    }
}

fn show(once: bool, text: &str) {
    let clear = if !once && std::io::stdout().is_terminal() { "\u{1b}[H\u{1b}[2J" } else { "" };
    crate::out::line(format!("{clear}{}", text.trim_end()));
}

const HEADINGS: [&str; 9] = ["machine", "state", "program", "line", "done", "rate", "override", "alarm", "since"];

fn rows(states: &[(MachineName, MachineState)], now: Timestamp) -> String {
    if states.is_empty() {
        return "no machine has reported yet".into();
    }
    let rows: Vec<[String; 9]> = states.iter().map(|(name, state)| row(name, state, now)).collect();
    table(HEADINGS, &rows)
}

fn row(name: &MachineName, state: &MachineState, now: Timestamp) -> [String; 9] {
    let age = Duration::from_millis(now.ms().saturating_sub(state.when.ms()));
    let text = |value: Option<String>| value.unwrap_or_default();
    // what a machine has sent is its own word: one line of bounded length, without the codes of a terminal
    let sent = |value: &str| escape::name(value).chars().take(MAX_CELL).collect::<String>();
    if age > MAX_STATE_AGE {
        let unknown = [name.to_string(), "not known".into(), duration_text(age)];
        let mut cells: [String; 9] = Default::default();
        [cells[0], cells[1], cells[8]] = unknown;
        return cells;
    }
    let rate = state.rate.map(|rate| {
        let percent = format!("{:.0} %", rate.abs() * 100.0);
        if rate < 0.0 { format!("\u{2190} {percent}") } else { percent }
    });
    [
        name.to_string(),
        state.state.as_deref().map_or_else(|| "not operated".into(), sent),
        text(state.program.as_deref().map(sent)),
        text(state.line.map(|line| line.to_string())),
        text(state.done_percent.map(|done| format!("{done:.0} %"))),
        text(rate),
        text(state.override_percent.map(|percent| format!("{percent:.0} %"))),
        text(state.alarm.as_ref().map(|(number, _)| sent(number)).or(state.trouble.as_deref().map(sent))),
        duration_text(Duration::from_millis(now.ms().saturating_sub(state.since.ms()))),
    ]
}

fn duration_text(age: Duration) -> String {
    match age.as_secs() {
        seconds @ 0..60 => format!("{seconds} s"),
        seconds @ 60..3600 => format!("{} min", seconds / 60),
        seconds @ 3600..172_800 => format!("{} h", seconds / 3600),
        seconds => format!("{} d", seconds / 86_400),
    }
}

fn states_json(states: &[(MachineName, MachineState)]) -> Value {
    let one = |(name, state): &(MachineName, MachineState)| {
        let mut value = json!(state);
        value["machine"] = json!(name);
        value
    };
    json!({ "machines": states.iter().map(one).collect::<Vec<Value>>() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(value: Value) -> MachineState {
        serde_json::from_value(value).expect("a state")
    }

    #[test]
    fn what_a_machine_sends_cannot_write_to_the_terminal_and_an_old_state_is_not_known() {
        let now = Timestamp::now();
        let name = MachineName::parse("mill").expect("a name");
        let hostile = "\u{1b}[2J\nrunning".repeat(100);
        let sent = state(json!({"when": now, "since": now, "state": hostile, "program": hostile, "line": 7,
            "done_percent": 12.4, "rate": -0.5, "override_percent": 100.0, "feed": 10.0, "alarm": [hostile, "x"],
            "pieces": null, "jobs": [0, 0], "trouble": null}));
        let table = rows(&[(name.clone(), sent.clone())], now);
        assert_eq!(table.lines().count(), 2, "{table}");
        assert!(table.chars().all(|letter| letter == '\n' || !letter.is_control()), "{table:?}");
        assert!(table.lines().all(|line| line.chars().count() < 220), "{table}");
        assert!(table.contains("\u{2190} 50 %") && table.contains("12 %"), "{table}");
        let later = Timestamp::from_ms(now.ms() + 16_000);
        let old = rows(&[(name, sent)], later);
        assert!(old.contains("not known") && old.contains("16 s") && !old.contains("running"), "{old}");
    }
}
