//! Messages to one page: the answers to its orders and questions, and who is in control.
//!
//! Invariant: each order has one answer; a refusal has number, cause and remedy.

use retrace_config::NumberedError;
use retrace_tui::Rejection;
use serde::Serialize;

use crate::control::Client;

/// A message, as the text that is sent.
pub(crate) fn message(view: &impl Serialize) -> String {
    // The views have no keys that are not texts, so that writing them cannot fail.
    serde_json::to_string(view).unwrap_or_default()
}

/// The order was passed to the machine.
#[derive(Clone, Copy, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct DoneView {
    t: &'static str,
    id: u32,
}

/// The order was refused.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct RefusedView {
    t: &'static str,
    id: u32,
    number: &'static str,
    cause: String,
    remedy: String,
}

/// An order that was passed to the machine was not carried out there.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct RejectedView {
    t: &'static str,
    number: Option<&'static str>,
    cause: String,
    remedy: String,
}

/// Line and records of a place.
#[derive(Clone, Copy, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct WhereView {
    t: &'static str,
    id: u32,
    line: Option<u32>,
    records: Option<[u32; 2]>,
}

/// Who is in control.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct ControlView {
    t: &'static str,
    holder: Option<ClientView>,
    is_you: bool,
    turn: u32,
    asks: Option<AskingView>,
}

#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct ClientView {
    client: Client,
    name: String,
}

#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct AskingView {
    client: Client,
    name: String,
    left_s: u64,
}

/// The answer to an order.
pub(crate) fn answer(id: u32, done: Result<(), NumberedError>) -> String {
    match done {
        Ok(()) => message(&DoneView { t: "done", id }),
        Err(NumberedError { number, cause, remedy }) => {
            message(&RefusedView { t: "refused", id, number, cause, remedy })
        }
    }
}

/// What became of an order that was passed to the machine.
pub(crate) fn rejected(rejection: &Rejection) -> String {
    let Rejection { number, cause, remedy, .. } = rejection.clone();
    message(&RejectedView { t: "rejected", number, cause, remedy })
}

/// The answer to a question about a place.
pub(crate) fn place(id: u32, line: Option<u32>, records: Option<[u32; 2]>) -> String {
    message(&WhereView { t: "where", id, line, records })
}

impl ClientView {
    /// A page.
    pub(crate) fn new(client: Client, name: String) -> Self {
        Self { client, name }
    }
}

impl ControlView {
    /// Who is in control, and the page that asks for it with the seconds that are left for an answer.
    pub(crate) fn new(holder: Option<ClientView>, is_you: bool, turn: u32, asks: Option<(ClientView, u64)>) -> Self {
        let asks = asks.map(|(ClientView { client, name }, left_s)| AskingView { client, name, left_s });
        Self { t: "control", holder, is_you, turn, asks }
    }
}
