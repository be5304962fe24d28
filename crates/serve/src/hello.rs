//! The message `hello`: what does not change while the server runs.
//!
//! Invariant: functions and keys are those of the table that the terminal screen has.

use retrace_tui::panel_actions;
use serde_json::{Value, json};

use crate::server_state::Server;

/// What does not change: versions, machine, actions and keys.
pub(crate) fn hello(server: &Server) -> Value {
    let model = server.desk.model();
    let facts = &model.facts;
    let axes: Vec<Value> = facts
        .axes
        .iter()
        .map(|axis| json!({"letter": axis.letter, "travel_mm": axis.travel_mm, "is_linear": !axis.is_rotary()}))
        .collect();
    let outputs: Vec<Value> = (0u8..)
        .zip(&facts.output_names)
        .filter(|(channel, name)| {
            // Outputs without a name of their own are switched by number.
            facts.output_named(&channel.to_string()).is_some() && **name != format!("output {channel}")
        })
        .map(|(channel, name)| json!({"channel": channel, "name": name, "is_cutter": facts.is_of_cutter(channel)}))
        .collect();
    let cutters: Vec<Value> =
        facts.cutters.iter().map(|cutter| json!({"name": cutter.name, "fire": cutter.fire})).collect();
    let actions: Vec<Value> = panel_actions()
        .into_iter()
        .map(|it| json!({"id": it.id, "keys": it.keys, "label": it.label, "help": it.help}))
        .collect();
    json!({
        "t": "hello",
        "api": 1,
        "version": env!("CARGO_PKG_VERSION"),
        "machine": {
            "name": facts.machine,
            "period_s": facts.period_s,
            "axes": axes,
            "outputs": outputs,
            "cutters": cutters,
            "has_spindle": facts.cutters.is_empty(),
            "wheel": {
                "seconds_per_count": server.options.seconds_per_count,
                "max_counts_per_s": 1.0 / server.options.seconds_per_count,
            },
        },
        "actions": actions,
        "jog_steps_mm": [0.01, 0.1, 1, 10],
        "is_demo": server.options.is_demo,
    })
}
