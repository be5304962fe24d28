//! Offsets and tools: tables that a page reads, and replaces at rest.
//!
//! Invariant: a table is changed for the page in control only, while no job runs, and only where nobody else has
//! changed it since it was read. A change that is refused changes nothing.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::Json;
use axum::extract::State;
use axum::extract::rejection::JsonRejection;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use retrace_config::NumberedError;
use retrace_tui::{TableChange, ToolFacts, UiCommand, WorkTables};
use serde::{Deserialize, Serialize};

use crate::control::Client;
use crate::failure::failure;
use crate::operator_desk::OrderContext;
use crate::server_state::{Server, Shared};
use crate::session::Rights;

/// Largest length, mm, and largest angle, degrees.
const MAX_VALUE: f64 = 100_000.0;

/// Largest number of a tool.
const MAX_TOOL: u32 = 99_999;

/// Time that the machine may take to apply a change.
const APPLY_TIMEOUT: Duration = Duration::from_secs(5);

/// Interval at which that is looked for.
const APPLY_POLL: Duration = Duration::from_millis(5);

/// The offsets.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct OffsetTable {
    axes: Vec<char>,
    systems: Vec<SystemRow>,
    g92: G92Row,
}

/// A coordinate system: machine position of its origin, for each axis of the machine.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
struct SystemRow {
    name: String,
    mm: Vec<f64>,
    rotation_deg: f64,
}

/// The offset of G92.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
struct G92Row {
    mm: Vec<f64>,
    is_active: bool,
}

/// The tools.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct ToolRows {
    tools: Vec<ToolRow>,
    /// Tool whose length is in force.
    in_use: Option<u32>,
}

#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct ToolRow {
    number: u32,
    diameter_mm: f64,
    length_mm: f64,
    name: String,
}

/// New offsets: the systems that are named, and G92 where it is.
#[derive(Clone, Debug, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct OffsetOrder {
    client: Client,
    turn: u32,
    #[serde(default)]
    systems: Vec<SystemRow>,
    g92: Option<G92Row>,
}

/// New tool data: the tools that are named.
#[derive(Clone, Debug, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct ToolOrder {
    client: Client,
    turn: u32,
    tools: Vec<NewTool>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
struct NewTool {
    number: u32,
    diameter_mm: f64,
    length_mm: f64,
}

impl OffsetTable {
    fn of(server: &Server) -> (Self, Arc<WorkTables>) {
        let model = server.desk.model();
        let tables = Arc::clone(&model.tables);
        let system = |system: &retrace_tui::WorkSystem| SystemRow {
            name: system.name.clone(),
            mm: system.origin.clone(),
            rotation_deg: system.rotation_deg,
        };
        let table = Self {
            axes: model.facts.axes.iter().map(|axis| axis.letter).collect(),
            systems: tables.systems.iter().map(system).collect(),
            g92: G92Row { mm: tables.g92.clone(), is_active: tables.g92_is_active },
        };
        (table, tables)
    }
}

/// Version of the tables, which names their content.
fn version(tables: &WorkTables) -> String {
    let mut hasher = DefaultHasher::new();
    format!("{tables:?}").hash(&mut hasher);
    format!("\"{:016x}\"", hasher.finish())
}

pub(crate) async fn get_offsets(State(server): Shared) -> Response {
    let (table, tables) = OffsetTable::of(&server);
    ([(header::ETAG, version(&tables))], Json(table)).into_response()
}

pub(crate) async fn get_tools(State(server): Shared) -> Response {
    let tables = Arc::clone(&server.desk.model().tables);
    let row = |tool: &ToolFacts| ToolRow {
        number: tool.number,
        diameter_mm: tool.diameter_mm,
        length_mm: tool.length_mm,
        name: tool.name.clone(),
    };
    let rows = ToolRows { tools: tables.tools.iter().map(row).collect(), in_use: tables.tool_in_use };
    ([(header::ETAG, version(&tables))], Json(rows)).into_response()
}

pub(crate) async fn put_offsets(
    State(server): Shared,
    headers: HeaderMap,
    order: Result<Json<OffsetOrder>, JsonRejection>,
) -> Response {
    let Json(order) = match order {
        Ok(order) => order,
        Err(rejection) => return not_understood(&rejection),
    };
    let context = match context(&server, &headers, order.client, order.turn) {
        Ok(context) => context,
        Err(error) => return failure(StatusCode::CONFLICT, &error),
    };
    change(&server, &headers, context, |before| with_offsets(before, order)).await
}

pub(crate) async fn put_tools(
    State(server): Shared,
    headers: HeaderMap,
    order: Result<Json<ToolOrder>, JsonRejection>,
) -> Response {
    let Json(order) = match order {
        Ok(order) => order,
        Err(rejection) => return not_understood(&rejection),
    };
    let context = match context(&server, &headers, order.client, order.turn) {
        Ok(context) => context,
        Err(error) => return failure(StatusCode::CONFLICT, &error),
    };
    change(&server, &headers, context, |before| with_tools(before, &order.tools)).await
}

fn not_understood(rejection: &JsonRejection) -> Response {
    let cause = format!("the table is not understood: {}", rejection.body_text());
    failure(rejection.status(), &NumberedError::new("E2418", cause, "see docs/serve-api.md"))
}

/// The request's session has the right to operate already. It speaks for its own pages only.
fn context(server: &Server, headers: &HeaderMap, client: Client, turn: u32) -> Result<OrderContext, NumberedError> {
    let credential = server.sessions().credential(headers, Instant::now()).map(|(_, credential)| credential.to_owned());
    if !server.is_page_of(client, credential.as_deref()) {
        let remedy = "name a page of the session that sends the request, and take control with it";
        return Err(NumberedError::new("E2404", "the page that is named is none of this session", remedy));
    }
    Ok(OrderContext { client, rights: Rights::Operate, turn, seen: 0 })
}

/// Changes the tables, and answers once the machine has them.
async fn change(
    server: &Server,
    headers: &HeaderMap,
    context: OrderContext,
    edit: impl FnOnce(&WorkTables) -> Result<WorkTables, NumberedError>,
) -> Response {
    let refuse = |error: &NumberedError| failure(StatusCode::CONFLICT, error);
    let before = Arc::clone(&server.desk.model().tables);
    let seen = headers.get(header::IF_MATCH).map(|value| value.to_str().unwrap_or("?"));
    if seen != Some(version(&before).as_str()) {
        let (status, cause) = match seen {
            None => (StatusCode::PRECONDITION_REQUIRED, "the request does not name the version that it changes"),
            Some(_) => (StatusCode::PRECONDITION_FAILED, "offsets or tools were changed in between"),
        };
        return failure(status, &NumberedError::new("E2422", cause, "read the table again, then change it"));
    }
    let after = match edit(&before) {
        Ok(after) => after,
        Err(error) => return failure(StatusCode::UNPROCESSABLE_ENTITY, &error),
    };
    if after != *before {
        let change = TableChange { before: before.as_ref().clone(), after: after.clone() };
        if let Err(error) = server.desk.order_tables(context, UiCommand::SetTables(Box::new(change))) {
            return refuse(&error);
        }
    }
    let begun = Instant::now();
    loop {
        let now = Arc::clone(&server.desk.model().tables);
        if *now == after {
            return ([(header::ETAG, version(&now))], StatusCode::NO_CONTENT).into_response();
        }
        if begun.elapsed() > APPLY_TIMEOUT {
            let cause = "the machine has not taken the table over";
            return refuse(&NumberedError::new("E2426", cause, "look at the log, and read the table again"));
        }
        tokio::time::sleep(APPLY_POLL).await;
    }
}

fn bad(cause: String, remedy: &str) -> NumberedError {
    NumberedError::new("E2425", cause, remedy)
}

fn check_value(value: f64, what: &str) -> Result<(), NumberedError> {
    if value.is_finite() && value.abs() <= MAX_VALUE {
        return Ok(());
    }
    Err(bad(format!("{what}: {value} is out of range"), "give a number between -100000 and 100000"))
}

fn with_offsets(before: &WorkTables, order: OffsetOrder) -> Result<WorkTables, NumberedError> {
    let mut after = before.clone();
    let axes = before.g92.len();
    let check = |name: &str, mm: &[f64]| {
        if mm.len() != axes {
            return Err(bad(format!("{name} has {} values", mm.len()), "give one value for each axis of the machine"));
        }
        mm.iter().try_for_each(|&value| check_value(value, name))
    };
    for row in order.systems {
        check(&row.name, &row.mm)?;
        check_value(row.rotation_deg, &row.name)?;
        let Some(system) = after.systems.iter_mut().find(|system| system.name == row.name) else {
            return Err(bad(format!("there is no coordinate system {}", row.name), "G54 … G59.3"));
        };
        (system.origin, system.rotation_deg) = (row.mm, row.rotation_deg);
    }
    if let Some(row) = order.g92 {
        check("G92", &row.mm)?;
        (after.g92, after.g92_is_active) = (row.mm, row.is_active);
    }
    Ok(after)
}

fn with_tools(before: &WorkTables, new: &[NewTool]) -> Result<WorkTables, NumberedError> {
    let mut after = before.clone();
    for &NewTool { number, diameter_mm, length_mm } in new {
        let name = format!("tool {number}");
        if number == 0 || number > MAX_TOOL {
            return Err(bad(format!("{name}: there is no such number"), "give a number from 1 to 99999"));
        }
        check_value(length_mm, &name)?;
        check_value(diameter_mm, &name)?;
        if diameter_mm < 0.0 {
            return Err(bad(format!("{name}: the diameter is negative"), "give a diameter of at least 0"));
        }
        match after.tools.iter_mut().find(|tool| tool.number == number) {
            Some(tool) => (tool.diameter_mm, tool.length_mm) = (diameter_mm, length_mm),
            None => after.tools.push(ToolFacts { number, diameter_mm, length_mm, name: String::new() }),
        }
    }
    let length = |tables: &WorkTables, number| tables.tools.iter().find(|t| t.number == number).map(|t| t.length_mm);
    match before.tool_in_use {
        Some(number) if length(before, number) != length(&after, number) => {
            let cause = format!("the length of tool {number} is in force");
            Err(NumberedError::new("E2424", cause, "cancel it with G49 on the MDI page, then change it"))
        }
        _ => Ok(after),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tables() -> WorkTables {
        let tool = |number| ToolFacts { number, diameter_mm: 6.0, length_mm: 50.0, name: format!("mill {number}") };
        WorkTables {
            systems: ["G54", "G55"]
                .map(|name| retrace_tui::WorkSystem { name: name.into(), origin: vec![0.0; 3], rotation_deg: 0.0 })
                .into(),
            g92: vec![0.0; 3],
            g92_is_active: false,
            tools: vec![tool(1), tool(2)],
            tool_in_use: Some(2),
        }
    }

    #[test]
    fn a_table_is_replaced_by_what_is_named_and_every_wrong_value_is_refused() {
        let offsets = |text: &str| {
            let order = format!(r#"{{"client":1,"turn":1,{text}}}"#);
            with_offsets(&tables(), serde_json::from_str(&order).expect(text))
        };
        let after = offsets(r#""systems":[{"name":"G55","mm":[1,2,3],"rotation_deg":30}]"#).expect("valid");
        assert_eq!((after.systems[1].origin.as_slice(), after.systems[1].rotation_deg), (&[1.0, 2.0, 3.0][..], 30.0));
        assert_eq!(after.systems[0], tables().systems[0]);
        let after = offsets(r#""g92":{"mm":[1,0,0],"is_active":true}"#).expect("valid");
        assert_eq!((after.g92.as_slice(), after.g92_is_active), (&[1.0, 0.0, 0.0][..], true));
        for wrong in [
            r#""systems":[{"name":"G55","mm":[1,2],"rotation_deg":0}]"#,
            r#""systems":[{"name":"G60","mm":[1,2,3],"rotation_deg":0}]"#,
            r#""systems":[{"name":"G54","mm":[1e300,2,3],"rotation_deg":0}]"#,
            r#""g92":{"mm":[],"is_active":true}"#,
        ] {
            assert_eq!(offsets(wrong).expect_err(wrong).number, "E2425", "{wrong}");
        }
        let tool = |number, diameter_mm, length_mm| {
            with_tools(&tables(), &[NewTool { number, diameter_mm, length_mm }]).map_err(|error| error.number)
        };
        let after = tool(1, 8.0, 51.0).expect("valid");
        assert_eq!((after.tools[0].length_mm, after.tools[0].name.as_str()), (51.0, "mill 1"));
        assert_eq!(tool(7, 8.0, 51.0).expect("valid").tools.len(), 3);
        assert!(tool(2, 8.0, 50.0).is_ok(), "its length stays");
        assert_eq!(tool(2, 6.0, 51.0), Err("E2424"));
        for (number, diameter, length) in [(0, 1.0, 1.0), (1, -1.0, 1.0), (1, f64::NAN, 1.0), (1, 1.0, 1e6)] {
            assert_eq!(tool(number, diameter, length), Err("E2425"));
        }
    }

    #[test]
    fn the_version_is_that_of_the_content() {
        let mut other = tables();
        assert_eq!(version(&other), version(&tables()));
        other.systems[0].origin[2] = 1e-9;
        assert_ne!(version(&other), version(&tables()));
    }
}
