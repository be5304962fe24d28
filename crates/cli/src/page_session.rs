//! What stays the same of a page while cards are closed and opened again: who is signed in, and what was asked for.
//!
//! Invariant: a job is resumed through the same steps as `retrace resume` takes, with the card opened anew.

use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use retrace_config::NumberedError;
use retrace_serve::ServeIdentity;

/// Session of a page over several openings of the card.
#[derive(Debug, Default)]
pub struct PageSession {
    identity: OnceLock<Arc<ServeIdentity>>,
    resume: Mutex<Option<String>>,
    notice: Mutex<Option<String>>,
}

impl PageSession {
    /// Keys and sessions, which are made once.
    ///
    /// # Errors
    /// `E2419` where the system has no random numbers.
    pub fn identity(&self, permits_uploads: bool) -> Result<Arc<ServeIdentity>, NumberedError> {
        if let Some(identity) = self.identity.get() {
            return Ok(Arc::clone(identity));
        }
        let identity = Arc::new(ServeIdentity::new(permits_uploads)?);
        Ok(Arc::clone(self.identity.get_or_init(|| identity)))
    }

    /// Whether the addresses were printed.
    pub fn is_announced(&self) -> bool {
        self.identity.get().is_some()
    }

    /// Requests that this job is resumed once the card is closed.
    pub fn request_resume(&self, job: String) {
        *lock(&self.resume) = Some(job);
    }

    /// The job that is to be resumed, once.
    pub fn take_resume(&self) -> Option<String> {
        lock(&self.resume).take()
    }

    /// Sets a text that is shown when the machine is opened again.
    pub fn set_notice(&self, text: String) {
        *lock(&self.notice) = Some(text);
    }

    /// The text that is to be shown, once.
    pub fn take_notice(&self) -> Option<String> {
        lock(&self.notice).take()
    }
}

fn lock<T>(value: &Mutex<T>) -> MutexGuard<'_, T> {
    value.lock().unwrap_or_else(PoisonError::into_inner)
}
