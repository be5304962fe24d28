//! Errors as answers to requests.
//!
//! Invariant: an answer has number, cause and remedy, as every diagnostic has.

use axum::Json;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use retrace_config::NumberedError;
use serde_json::json;

use crate::programs::StoreError;

/// An error as an answer.
pub(crate) fn failure(status: StatusCode, error: &NumberedError) -> Response {
    let NumberedError { number, cause, remedy } = error;
    (status, Json(json!({"error": {"number": number, "cause": cause, "remedy": remedy}}))).into_response()
}

/// A store error as an answer.
pub(crate) fn store_failure(error: StoreError, name: &str) -> Response {
    let (status, number, cause, remedy) = match error {
        StoreError::NoFolder => {
            let remedy = "start `retrace serve` with --programs DIR";
            (StatusCode::CONFLICT, "E2410", "there is no folder for programs".to_owned(), remedy)
        }
        StoreError::BadName => {
            let cause = "a program's name has no folder part and no control characters".to_owned();
            (StatusCode::BAD_REQUEST, "E2411", cause, "give a plain file name of at most 200 bytes")
        }
        StoreError::Exists => {
            let cause = format!("there is a program {name} already");
            (StatusCode::PRECONDITION_FAILED, "E2412", cause, "give another name, or replace it")
        }
        StoreError::Missing => {
            let cause = format!("there is no program {name} in the programs folder");
            (StatusCode::NOT_FOUND, "E2407", cause, "choose one of the list")
        }
        StoreError::Io(error) => {
            let cause = format!("{name} cannot be stored: {error}");
            (StatusCode::INSUFFICIENT_STORAGE, "E2413", cause, "look at the disk of the computer")
        }
    };
    failure(status, &NumberedError::new(number, cause, remedy))
}
