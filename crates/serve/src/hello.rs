//! The message `hello`: what does not change while the server runs.
//!
//! Invariant: functions and keys are those of the table that the terminal screen has.

use retrace_controller::JogSpeed;
use retrace_tui::panel_actions;
use serde::Serialize;

use crate::control::Client;
use crate::server_state::Server;
use crate::session::Rights;

/// Steps of a jog, mm.
const JOG_STEPS_MM: [f64; 4] = [0.01, 0.1, 1.0, 10.0];

/// What does not change: versions, machine, actions and keys.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct HelloView {
    t: &'static str,
    api: u32,
    version: &'static str,
    machine: MachineView,
    actions: Vec<ActionView>,
    jog_steps_mm: [f64; 4],
    /// Speed of a slow jog, as a share of the jog speed.
    slow_jog_share: f64,
    is_demo: bool,
    #[serde(flatten)]
    page: Option<PageView>,
}

/// The page that the message is sent to; missing in the answer to a plain request.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct PageView {
    rights: &'static str,
    client: Client,
    name: String,
}

#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct MachineView {
    name: String,
    period_s: f64,
    axes: Vec<AxisView>,
    outputs: Vec<OutputNameView>,
    inputs: Vec<InputNameView>,
    cutters: Vec<CutterNameView>,
    has_spindle: bool,
    wheel: WheelView,
}

#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct AxisView {
    letter: char,
    travel_mm: [f64; 2],
    is_linear: bool,
    jog_mm_s: f64,
}

#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct OutputNameView {
    channel: u8,
    name: String,
    is_cutter: bool,
}

#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct InputNameView {
    /// Bit of `inputs` in the state.
    number: u8,
    name: String,
}

#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct CutterNameView {
    name: String,
    fire: u8,
}

#[derive(Clone, Copy, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct WheelView {
    seconds_per_count: f64,
    max_counts_per_s: f64,
}

#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct ActionView {
    id: String,
    keys: Vec<String>,
    label: &'static str,
    help: &'static str,
}

impl HelloView {
    /// What this server does not change.
    pub(crate) fn of(server: &Server) -> Self {
        let model = server.desk.model();
        let facts = &model.facts;
        let axes = facts.axes.iter().map(|axis| AxisView {
            letter: axis.letter,
            travel_mm: axis.travel_mm,
            is_linear: !axis.is_rotary(),
            jog_mm_s: axis.jog_mm_s,
        });
        let outputs = (0u8..)
            .zip(&facts.output_names)
            .filter(|(channel, name)| {
                // Outputs without a name of their own are switched by number.
                facts.output_named(&channel.to_string()).is_some() && **name != format!("output {channel}")
            })
            .map(|(channel, name)| OutputNameView {
                channel,
                name: name.clone(),
                is_cutter: facts.is_of_cutter(channel),
            });
        let inputs =
            facts.input_names.iter().map(|(number, name)| InputNameView { number: *number, name: name.clone() });
        let cutters =
            facts.cutters.iter().map(|cutter| CutterNameView { name: cutter.name.clone(), fire: cutter.fire });
        let actions = panel_actions().into_iter().map(|action| ActionView {
            id: action.id,
            keys: action.keys,
            label: action.label,
            help: action.help,
        });
        let seconds_per_count = server.options.seconds_per_count;
        Self {
            t: "hello",
            api: 1,
            version: env!("CARGO_PKG_VERSION"),
            machine: MachineView {
                name: facts.machine.clone(),
                period_s: facts.period_s,
                axes: axes.collect(),
                outputs: outputs.collect(),
                inputs: inputs.collect(),
                cutters: cutters.collect(),
                has_spindle: facts.cutters.is_empty(),
                wheel: WheelView { seconds_per_count, max_counts_per_s: 1.0 / seconds_per_count },
            },
            actions: actions.collect(),
            jog_steps_mm: JOG_STEPS_MM,
            slow_jog_share: JogSpeed::Slow.share(),
            is_demo: server.options.is_demo,
            page: None,
        }
    }

    /// The message to a page.
    pub(crate) fn for_page(self, rights: Rights, client: Client, name: String) -> Self {
        Self { page: Some(PageView { rights: rights.name(), client, name }), ..self }
    }
}
