//! `retrace consumables`: the wear of the consumables of each cutter, and that they are new (CUT-62).
//!
//! Invariant: what was not counted is not shown as 0.

use retrace_config::NumberedError;
use retrace_journal::{ConsumableFile, ConsumableSet, ConsumableWear};
use serde_json::{Value, json};

use crate::args;
use crate::command_failure::CommandFailure;
use crate::escape;
use crate::files;
use crate::machine_tables;

/// A set as a JSON object.
#[must_use]
pub fn set_json((name, set): (&String, &ConsumableSet)) -> Value {
    let ConsumableWear { starts, failed_starts, lit_s, cut_m } = set.wear;
    json!({
        "cutter": name, "since": set.since.to_string(), "starts": starts, "failed_starts": failed_starts,
        "lit_s": lit_s, "cut_m": cut_m,
    })
}

/// A set in one line.
#[must_use]
pub fn set_text((name, set): (&String, &ConsumableSet)) -> String {
    let ConsumableWear { starts, failed_starts, lit_s, cut_m } = set.wear;
    let since = set.since.to_string();
    let (day, time) = (since.get(..10).unwrap_or_default(), since.get(11..16).unwrap_or_default());
    format!(
        "consumables of {} since {day} {time} UTC: {starts} starts, {failed_starts} failed, {:.1} min lit, {cut_m:.2} \
         m cut",
        escape::name(name),
        lit_s / 60.0
    )
}

/// `retrace consumables`.
///
/// # Errors
/// The machine has no cutter or no file; the file cannot be written.
pub fn run(args: &args::Consumables) -> Result<(), CommandFailure> {
    let machine = files::machine(args.machine_file.path())?;
    let names: Vec<String> = machine.cutters.iter().map(|cutter| cutter.name.clone()).collect();
    let refuse = |what: String, remedy: &str| NumberedError::new("E2161", what, remedy.to_owned());
    let path = machine_tables::consumables_path(&args.port.card, args.machine_file.path());
    let Some(path) = path.filter(|_| !names.is_empty()) else {
        return Err(refuse("the machine has no cutter".into(), "give the machine file of a machine with one").into());
    };
    let file = ConsumableFile::at(&path);
    let sets = match &args.changed {
        None => file.read(),
        Some(None) => file.begin(&names)?,
        Some(Some(name)) if names.contains(name) => file.begin(std::slice::from_ref(name))?,
        Some(Some(name)) => {
            return Err(
                refuse(format!("the machine has no cutter {name}"), &format!("one of {}", names.join(", "))).into()
            );
        }
    };
    if args.format.json {
        crate::out::line(json!({"consumables": sets.iter().map(set_json).collect::<Vec<_>>()}));
    } else if sets.is_empty() {
        crate::out::line("nothing was counted yet");
    } else {
        sets.iter().for_each(|set| crate::out::line(set_text(set)));
    }
    Ok(())
}
