//! Plain requests: what pages ask for besides the live state, and the programs folder.
//!
//! Invariant: none of them moves the machine, or changes what its program does.

use std::sync::Arc;

use axum::Json;
use axum::extract::{ConnectInfo, Path, Query, Request, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use retrace_config::NumberedError;
use serde::Deserialize;
use serde_json::{Value, json};
use std::time::Instant;

use crate::connection::Peer;
use crate::failure::{failure, store_failure};
use crate::hello::HelloView;
use crate::server_state::{Server, Shared};
use crate::session::{LoginError, Rights};
use crate::snapshot::LogView;

/// Maximum number of lines in one answer.
const MAX_LINES: usize = 500;

/// Refuses a request without these rights.
pub(crate) async fn require(server: Arc<Server>, needed: Rights, request: Request, next: Next) -> Response {
    let rights = server.sessions().rights(request.headers(), Instant::now());
    match rights {
        Some(rights) if rights.include(needed) => next.run(request).await,
        Some(_) => {
            let error = NumberedError::new("E2403", "these rights do not suffice", "use the address with more rights");
            failure(StatusCode::FORBIDDEN, &error)
        }
        None => {
            let remedy = "open the address that `retrace serve` prints";
            failure(StatusCode::UNAUTHORIZED, &NumberedError::new("E2402", "no session", remedy))
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Login {
    token: String,
}

pub(crate) async fn begin_session(
    State(server): Shared,
    ConnectInfo(Peer(peer)): ConnectInfo<Peer>,
    Json(login): Json<Login>,
) -> Response {
    let begun = server.sessions().begin(&login.token, peer.ip(), Instant::now());
    match begun {
        Ok((rights, cookie)) => {
            ([(header::SET_COOKIE, cookie)], Json(json!({"rights": rights.name()}))).into_response()
        }
        Err(LoginError::WrongToken) => {
            let remedy = "open the address that `retrace serve` prints";
            failure(StatusCode::UNAUTHORIZED, &NumberedError::new("E2401", "the token is wrong", remedy))
        }
        Err(LoginError::TooMany) => failure(
            StatusCode::TOO_MANY_REQUESTS,
            &NumberedError::new("E2401", "too many wrong tokens came from this address", "wait a minute"),
        ),
        Err(LoginError::NoRandomNumbers) => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}

pub(crate) async fn end_session(State(server): Shared, headers: HeaderMap) -> Response {
    let cookie = server.sessions().end(&headers);
    ([(header::SET_COOKIE, cookie)], StatusCode::NO_CONTENT).into_response()
}

pub(crate) async fn get_hello(State(server): Shared) -> Json<HelloView> {
    Json(HelloView::of(&server))
}

pub(crate) async fn get_state(State(server): Shared) -> Response {
    let Some(snapshot) = server.desk.newest().0 else { return StatusCode::SERVICE_UNAVAILABLE.into_response() };
    let body = format!(r#"{{"state":{},"live":{}}}"#, snapshot.state, snapshot.live);
    ([(header::CONTENT_TYPE, "application/json")], body).into_response()
}

pub(crate) async fn get_log(State(server): Shared) -> Json<LogView> {
    Json(LogView::of(&server.desk.model()))
}

#[derive(Deserialize)]
pub(crate) struct LineRange {
    from: Option<usize>,
    count: Option<usize>,
}

pub(crate) async fn get_lines(State(server): Shared, Query(range): Query<LineRange>) -> Json<Value> {
    let facts = Arc::clone(&server.desk.model().facts);
    let (from, count) = (range.from.unwrap_or(1).max(1), range.count.unwrap_or(200).min(MAX_LINES));
    let lines: Vec<&str> = (from..from.saturating_add(count)).map_while(|line| facts.program.line(line)).collect();
    Json(json!({"name": facts.program.name, "lines_total": facts.program.lines(), "from": from, "lines": lines}))
}

pub(crate) async fn get_contours(State(server): Shared) -> Json<Value> {
    let model = server.desk.model().clone();
    let planned = model.facts.contours.as_deref();
    let numbers = model.contours.numbers(planned);
    let path = server.desk.newest().0.and_then(|snapshot| snapshot.path);
    let rows = numbers.into_iter().filter_map(|number| model.contours.row(number, planned));
    let contours: Vec<Value> = rows
        .map(|row| {
            json!({
                "number": row.number,
                "line": row.line,
                "cutter": row.planned.map(|planned| &planned.cutter),
                "subprogram": row.planned.and_then(|planned| planned.subprogram()),
                "length_mm": row.planned.map(|planned| planned.length_mm),
                "cut_mm": row.cut_mm,
                "not_cut_mm": row.not_cut_mm,
                "state": row.state.name(),
                "records": path.as_ref().and_then(|levels| levels.path.records_of_contour(row.number)),
            })
        })
        .collect();
    Json(json!({
        "contours": contours,
        "current": model.contours.current().map(|(number, _)| number),
        "path": path.map(|levels| levels.number),
    }))
}

pub(crate) async fn get_profile(State(server): Shared) -> Response {
    let facts = Arc::clone(&server.desk.model().facts);
    let Some(path) = &facts.planned_path else {
        let error = NumberedError::new("E2407", "no program has been checked", "load a program");
        return failure(StatusCode::NOT_FOUND, &error);
    };
    let profile = path.profile();
    let interval_s = f64::from(profile.interval_periods()) * facts.period_s;
    // Each value is in the middle of its interval, and rounded, so that the answer is short.
    let velocity: Vec<f64> = profile.lengths_mm().iter().map(|&mm| f64::from(mm) / interval_s).collect();
    let acceleration = slopes(&velocity, interval_s);
    let jerk = slopes(&acceleration, interval_s);
    let times: Vec<f64> = (0..velocity.len()).map(|n| (n as f64 + 0.5) * interval_s).collect();
    let short = |values: Vec<f64>| values.into_iter().map(|value| (value * 1e3).round() / 1e3).collect::<Vec<_>>();
    Json(json!({
        "t_s": short(times),
        "velocity_mm_s": short(velocity),
        "acceleration_mm_s2": short(acceleration),
        "jerk_mm_s3": short(jerk),
    }))
    .into_response()
}

/// Slope at each value, from the ones around it; 0 at the ends.
fn slopes(values: &[f64], interval_s: f64) -> Vec<f64> {
    let inner = values.windows(3).map(|three| (three[2] - three[0]) / (2.0 * interval_s));
    let mut slopes: Vec<f64> = std::iter::once(0.0).chain(inner).chain(std::iter::once(0.0)).collect();
    slopes.resize(values.len(), 0.0);
    slopes
}

pub(crate) async fn get_jobs(State(server): Shared) -> Response {
    let jobs = tokio::task::spawn_blocking(move || server.desk.host().jobs()).await;
    jobs.map_or_else(|_| StatusCode::INTERNAL_SERVER_ERROR.into_response(), |jobs| Json(jobs).into_response())
}

pub(crate) async fn get_job(State(server): Shared, Path(id): Path<String>) -> Response {
    let job = tokio::task::spawn_blocking(move || server.desk.host().job(&id)).await;
    match job {
        Ok(Ok(job)) => Json(job).into_response(),
        Ok(Err(error)) => failure(StatusCode::NOT_FOUND, &error),
        Err(_) => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}

pub(crate) async fn get_programs(State(server): Shared) -> Response {
    let has_folder = server.desk.folders().programs.is_some();
    let listed = tokio::task::spawn_blocking(move || server.desk.folders().list()).await;
    let Ok(programs) = listed else { return StatusCode::INTERNAL_SERVER_ERROR.into_response() };
    Json(json!({"programs": programs, "folder": has_folder})).into_response()
}

pub(crate) async fn delete_program(State(server): Shared, Path(name): Path<String>) -> Response {
    let of = name.clone();
    let deleted = tokio::task::spawn_blocking(move || server.desk.folders().delete(&of)).await;
    match deleted {
        Ok(Ok(())) => StatusCode::NO_CONTENT.into_response(),
        Ok(Err(error)) => store_failure(error, &name),
        Err(_) => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}
