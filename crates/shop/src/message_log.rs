//! The messages that a machine has obeyed or shown: recalls and texts for the operator.
//!
//! The broker keeps messages for 30 days and the agent reads them again after each connection; a recall that was
//! refused because the job was running must not be obeyed hours later.
//!
//! Invariant: a message is handled once.

use std::path::Path;

use retrace_config::NumberedError;
use retrace_journal::Timestamp;
use serde::{Deserialize, Serialize};

use crate::checked_log::{self, OpenLog};
use crate::job_id::ShopJobId;

/// A message that was handled.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HandledMessage {
    /// Identity of the message.
    pub id: ShopJobId,
    /// Time, by the machine's clock, in UTC.
    pub when: Timestamp,
    /// Name of its sender.
    pub from: String,
    /// What it was.
    #[serde(flatten)]
    pub content: HandledContent,
}

/// What a message was.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "message", rename_all = "snake_case")]
pub enum HandledContent {
    /// A text for the operator.
    Text {
        /// The text.
        text: String,
    },
    /// A recall.
    Recall {
        /// The job.
        job: ShopJobId,
        /// The state of the job that forbade it; `None` where it was given back.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        refused: Option<String>,
    },
}

/// Reads the messages that were handled, the oldest first.
///
/// # Errors
/// `E5009` where the log is damaged, `E5010` where it cannot be read.
pub fn read(path: &Path) -> Result<Vec<HandledMessage>, NumberedError> {
    Ok(checked_log::read(path)?.entries)
}

/// Appends a message durably.
///
/// # Errors
/// `E5009`, `E5010`
pub(crate) fn append(path: &Path, message: &HandledMessage) -> Result<(), NumberedError> {
    let (mut log, _) = OpenLog::open::<HandledMessage>(path)?;
    log.append(message)
}
