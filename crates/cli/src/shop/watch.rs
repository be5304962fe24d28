//! `retrace shop watch`: a table of what the machines of the shop do (SHP-36).
//!
//! Invariant: while the broker is away the last states stay, and age; one line says that it is away.

use std::io::IsTerminal;
use std::thread;
use std::time::Duration;

use retrace_config::NumberedError;
use retrace_journal::Timestamp;
use retrace_shop::{BrokerConnection, MachineName, MachineState, ShopFile, machine_states, machine_table};
use serde_json::{Value, json};

use super::host::{CONNECT_LIMIT, settings};
use crate::escape;

/// Time between two tables.
const INTERVAL: Duration = Duration::from_secs(1);

/// Runs the command.
///
/// # Errors
/// `E5040` and `E5036`; with `once` also those of a broker that is away.
pub fn run(file: &ShopFile, once: bool, is_json: bool) -> Result<(), NumberedError> {
    let connection = BrokerConnection::begin(settings(file)?, file.name.as_str())?;
    let is_drawn = !once && !is_json && std::io::stdout().is_terminal();
    let mut states = Vec::new();
    let mut limit = CONNECT_LIMIT;
    loop {
        let away = match connection.wait(limit).and_then(|()| machine_states(&connection)) {
            Ok(found) => {
                states = found;
                None
            }
            Err(error) if once => return Err(error),
            Err(error) => Some(error),
        };
        limit = INTERVAL;
        if is_json {
            crate::out::line(states_json(&states, away.as_ref()));
        } else if is_drawn {
            crate::out::redraw(&text(&states, away.as_ref(), Timestamp::now()));
        } else {
            crate::out::line(text(&states, away.as_ref(), Timestamp::now()).trim_end());
        }
        if once {
            return Ok(());
        }
        thread::sleep(INTERVAL);
    }
}

/// What is shown: one line where the broker does not answer, and what the machines have reported last.
fn text(states: &[(MachineName, MachineState)], away: Option<&NumberedError>, now: Timestamp) -> String {
    let away = away.map(|error| format!("{}: {}\n", error.number, escape::name(&error.cause)));
    let table = match (states, &away) {
        ([], Some(_)) => String::new(),
        ([], None) => "no machine has reported yet\n".into(),
        _ => machine_table(states, now),
    };
    away.unwrap_or_default() + &table
}

fn states_json(states: &[(MachineName, MachineState)], away: Option<&NumberedError>) -> Value {
    let one = |(name, state): &(MachineName, MachineState)| {
        let mut value = json!(state);
        value["machine"] = json!(name);
        value
    };
    let away = away.map(|error| json!({"number": error.number, "cause": error.cause}));
    json!({ "machines": states.iter().map(one).collect::<Vec<Value>>(), "away": away })
}
