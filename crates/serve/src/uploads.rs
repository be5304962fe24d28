//! Uploads: from pages, and in the form of OctoPrint, which CAM programs and slicers send.
//!
//! Invariant: an upload never starts a machine; `print=true` loads the program, and the operator starts it. Its bytes
//! go to the disk as they arrive.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use axum::Json;
use axum::body::{Body, BodyDataStream, Bytes};
use axum::extract::{Multipart, Path, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt;
use retrace_config::NumberedError;
use retrace_tui::{ScreenStage, UiCommand};
use serde_json::json;

use crate::failure::{failure, store_failure};
use crate::programs::{PartialProgram, StoreError};
use crate::server_state::{Server, Shared};

/// Largest program that can be uploaded, bytes.
pub(crate) const MAX_UPLOAD: usize = 256 << 20;

/// Answer to an upload that is refused.
pub(crate) type Refusal = Box<Response>;

/// Maximum number of bytes of a refused upload that are received all the same.
const MAX_DISCARDED: usize = 1 << 20;

/// Time for receiving them.
const DISCARD_TIMEOUT: Duration = Duration::from_secs(2);

fn too_large() -> Refusal {
    let error = NumberedError::new("E2414", "the program is larger than 256 MiB", "copy it into the programs folder");
    Refusal::new(failure(StatusCode::PAYLOAD_TOO_LARGE, &error))
}

/// A program that is being received.
struct Upload {
    part: Option<PartialProgram>,
    bytes: usize,
}

impl Upload {
    fn begin(server: &Server, name: &str) -> Result<Self, Refusal> {
        let part = server.desk.folders().begin(name).map_err(|error| Refusal::new(store_failure(error, name)))?;
        Ok(Self { part: Some(part), bytes: 0 })
    }

    /// Adds what has arrived, in a thread where the disk may be waited for.
    async fn add(&mut self, bytes: Bytes, name: &str) -> Result<(), Refusal> {
        self.bytes += bytes.len();
        if self.bytes > MAX_UPLOAD {
            return Err(too_large());
        }
        let Some(mut part) = self.part.take() else {
            return Err(Refusal::new(StatusCode::INTERNAL_SERVER_ERROR.into_response()));
        };
        let written = tokio::task::spawn_blocking(move || part.write(&bytes).map(|()| part)).await;
        match written {
            Ok(Ok(part)) => self.part = Some(part),
            Ok(Err(error)) => return Err(Refusal::new(store_failure(StoreError::Io(error), name))),
            Err(_) => return Err(Refusal::new(StatusCode::INTERNAL_SERVER_ERROR.into_response())),
        }
        Ok(())
    }

    async fn finish(mut self, name: &str, replaces: bool) -> Result<(), Refusal> {
        let Some(part) = self.part.take() else {
            return Err(Refusal::new(StatusCode::INTERNAL_SERVER_ERROR.into_response()));
        };
        match tokio::task::spawn_blocking(move || part.finish(replaces)).await {
            Ok(finished) => finished.map_err(|error| Refusal::new(store_failure(error, name))),
            Err(_) => Err(Refusal::new(StatusCode::INTERNAL_SERVER_ERROR.into_response())),
        }
    }
}

/// Stores a program that a page sends.
pub(crate) async fn put_program(
    State(server): Shared,
    Path(name): Path<String>,
    headers: HeaderMap,
    body: Body,
) -> Response {
    let replaces = headers.get(header::IF_NONE_MATCH).is_none_or(|value| value != "*");
    let announced = headers.get(header::CONTENT_LENGTH).and_then(|value| value.to_str().ok()?.parse::<usize>().ok());
    if announced.is_some_and(|bytes| bytes > MAX_UPLOAD) {
        return *too_large();
    }
    match store_body(&server, &name, body, replaces).await {
        Ok(()) => (StatusCode::CREATED, Json(json!({"name": name}))).into_response(),
        Err(refusal) => *refusal,
    }
}

/// Receives what is left of a refused upload, up to a bound: where it is not read, the sender would see a broken
/// connection and not the answer.
async fn discard(frames: &mut BodyDataStream) {
    let mut bytes = 0;
    let rest = async {
        while let Some(Ok(frame)) = frames.next().await {
            bytes += frame.len();
            if bytes > MAX_DISCARDED {
                break;
            }
        }
    };
    let _ = tokio::time::timeout(DISCARD_TIMEOUT, rest).await;
}

/// Stores the body of a request as a program.
async fn store_body(server: &Server, name: &str, body: Body, replaces: bool) -> Result<(), Refusal> {
    let mut frames = body.into_data_stream();
    let stored = store_frames(server, name, &mut frames, replaces).await;
    if stored.is_err() {
        discard(&mut frames).await;
    }
    stored
}

async fn store_frames(server: &Server, name: &str, frames: &mut BodyDataStream, replaces: bool) -> Result<(), Refusal> {
    let Some(_alone) = OneAtATime::begin(server) else { return Err(busy()) };
    let mut upload = Upload::begin(server, name)?;
    while let Some(bytes) = frames.next().await {
        let bytes = bytes.map_err(|_| Refusal::new(StatusCode::BAD_REQUEST.into_response()))?;
        upload.add(bytes, name).await?;
    }
    upload.finish(name, replaces).await
}

/// What CAM programs and slicers ask first.
pub(crate) async fn octoprint_version() -> Json<serde_json::Value> {
    let version = env!("CARGO_PKG_VERSION");
    Json(json!({"api": "0.1", "server": version, "text": format!("OctoPrint (retrace {version})")}))
}

/// What they send: one part named `file`; `print` says that the program is to be loaded, which `select` does as well.
pub(crate) async fn octoprint_upload(State(server): Shared, mut parts: Multipart) -> Response {
    match receive_parts(&server, &mut parts).await {
        Ok((name, loads)) => {
            let is_loaded = loads && load(&server, &name);
            let file = json!({"name": name, "origin": "local", "path": name});
            let body = json!({"done": true, "files": {"local": file}, "print": false, "loaded": is_loaded});
            (StatusCode::CREATED, Json(body)).into_response()
        }
        Err(refusal) => {
            let rest = async { while let Ok(Some(_)) = parts.next_field().await {} };
            let _ = tokio::time::timeout(DISCARD_TIMEOUT, rest).await;
            *refusal
        }
    }
}

async fn receive_parts(server: &Server, parts: &mut Multipart) -> Result<(String, bool), Refusal> {
    let Some(_alone) = OneAtATime::begin(server) else { return Err(busy()) };
    let bad = |error: axum::extract::multipart::MultipartError| {
        Refusal::new((StatusCode::BAD_REQUEST, error.to_string()).into_response())
    };
    let (mut stored, mut loads) = (None, false);
    while let Some(mut part) = parts.next_field().await.map_err(bad)? {
        match part.name() {
            Some("file") => {
                let wanted = part.file_name().unwrap_or_default().to_owned();
                let name = server.desk.folders().unused_name(&wanted);
                let mut upload = Upload::begin(server, &name)?;
                while let Some(bytes) = part.chunk().await.map_err(bad)? {
                    upload.add(bytes, &name).await?;
                }
                upload.finish(&name, false).await?;
                stored = Some(name);
            }
            Some("print" | "select") => {
                let text = part.text().await.map_err(bad)?;
                loads |= text == "true";
            }
            _ => {}
        }
    }
    let missing = || {
        let error = NumberedError::new("E2416", "the upload has no part named `file`", "send the program as `file`");
        Refusal::new(failure(StatusCode::BAD_REQUEST, &error))
    };
    stored.map(|name| (name, loads)).ok_or_else(missing)
}

/// Loads a program that was sent, where no job runs. It is never started here.
fn load(server: &Server, name: &str) -> bool {
    let Some(path) = server.desk.folders().find(name) else { return false };
    let mut model = server.desk.model();
    let time_s = model.period as f64 * model.facts.period_s;
    let is_free = model.stage != ScreenStage::Job && model.question.is_none() && model.at_rest;
    if is_free {
        model.add_message(time_s, 0, format!("{name} was sent to this machine and is loaded; cycle start runs it"));
        drop(model);
        server.desk.host().send(UiCommand::Load(path));
    } else {
        model.add_message(time_s, 0, format!("{name} was sent to this machine; it is in the programs folder"));
    }
    is_free
}

/// Permission for the one upload that is received at a time.
struct OneAtATime<'s>(&'s Mutex<bool>);

impl<'s> OneAtATime<'s> {
    fn begin(server: &'s Server) -> Option<Self> {
        let is_received = {
            let mut receives = server.receives_upload.lock().unwrap_or_else(PoisonError::into_inner);
            std::mem::replace(&mut *receives, true)
        };
        // The value must exist only where it was permitted: its end permits the next upload.
        if is_received { None } else { Some(Self(&server.receives_upload)) }
    }
}

impl Drop for OneAtATime<'_> {
    fn drop(&mut self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = false;
    }
}

fn busy() -> Refusal {
    let error = NumberedError::new("E2415", "another upload is being received", "try again when it has ended");
    Refusal::new(failure(StatusCode::TOO_MANY_REQUESTS, &error))
}
