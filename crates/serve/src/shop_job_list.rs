//! The jobs of the shop, as a page shows them (SHP-36).
//!
//! Invariant: what is sent is the table of the screen model; a job is started by an order over the WebSocket alone.

use axum::Json;
use axum::extract::State;
use retrace_tui::{ShopJobRow, ShopJobTable};
use serde::Serialize;

use crate::server_state::Shared;

/// The jobs of the shop at this machine.
#[derive(Clone, Debug, Default, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct ShopJobList {
    /// Name of the machine in the shop; empty where there is no shop.
    machine: String,
    /// Machine file that jobs are run with.
    machine_file: String,
    jobs: Vec<ShopJobView>,
    /// Number of jobs that are not listed.
    hidden: usize,
    /// Why the jobs cannot be read; empty where they were.
    error: String,
}

#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct ShopJobView {
    /// Place in the list, from 1.
    order: usize,
    id: String,
    state: &'static str,
    /// Whether its next piece can be started, at rest.
    is_ready: bool,
    program: String,
    good: u32,
    quantity: u32,
    /// Most pieces that one start may run, one after the other.
    most_pieces: u32,
    check: String,
    submitter: String,
    /// Number of the office's order; may be empty.
    order_number: String,
    note: String,
    material: String,
    /// What the operator should know before a start.
    warnings: Vec<String>,
    /// Names and texts; one without a name continues the one before.
    details: Vec<[String; 2]>,
    /// What the operator confirms before a start, as names and texts.
    start: Vec<[String; 2]>,
}

impl ShopJobList {
    fn of(table: &ShopJobTable) -> Self {
        let job = |(number, row): (usize, &ShopJobRow)| ShopJobView {
            order: number + 1,
            id: row.id.clone(),
            state: row.state,
            is_ready: row.is_ready,
            program: row.program.clone(),
            good: row.good,
            quantity: row.quantity,
            most_pieces: row.most_pieces,
            check: row.check.clone(),
            submitter: row.submitter.clone(),
            order_number: row.order_number.clone(),
            note: row.note.clone(),
            material: row.material.clone(),
            warnings: row.warnings.clone(),
            details: row.details.iter().map(|(name, text)| [name.clone(), text.clone()]).collect(),
            start: row.start_facts(&table.machine_file).into_iter().map(|(name, text)| [name.into(), text]).collect(),
        };
        Self {
            machine: table.machine.clone(),
            machine_file: table.machine_file.clone(),
            jobs: table.rows.iter().enumerate().map(job).collect(),
            hidden: table.hidden,
            error: table.error.clone(),
        }
    }
}

/// `GET /api/v1/shop/jobs`
pub(crate) async fn get_shop_jobs(State(server): Shared) -> Json<ShopJobList> {
    let table = server.desk.model().shop_jobs.clone();
    Json(table.as_deref().map(ShopJobList::of).unwrap_or_default())
}
