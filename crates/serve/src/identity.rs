//! Identity of a server: its keys, its sessions and its address, which outlive one opening of the card.
//!
//! Invariant: whoever was signed in stays signed in while the server is started again in the same process.

use std::net::SocketAddr;
use std::sync::{Mutex, MutexGuard, PoisonError};

use retrace_config::NumberedError;

use crate::session::{Keys, Sessions};

/// Keys, sessions and address of a server.
#[derive(Debug)]
pub struct ServeIdentity {
    keys: Keys,
    sessions: Mutex<Sessions>,
    address: Mutex<Option<SocketAddr>>,
}

impl ServeIdentity {
    /// New keys, and nobody signed in.
    ///
    /// # Errors
    /// `E2419` where the system has no random numbers.
    pub fn new(permits_uploads: bool) -> Result<Self, NumberedError> {
        let keys = Keys::new(permits_uploads).map_err(|error| {
            let what = format!("the page cannot be served: the system has no random numbers: {error}");
            NumberedError::new("E2419", what, "look at the system's source of random numbers")
        })?;
        Ok(Self { sessions: Mutex::new(Sessions::new(keys.clone())), keys, address: Mutex::new(None) })
    }

    /// The keys.
    pub(crate) fn keys(&self) -> &Keys {
        &self.keys
    }

    /// The sessions.
    pub(crate) fn sessions(&self) -> MutexGuard<'_, Sessions> {
        self.sessions.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Address at which the server has listened before.
    pub(crate) fn address(&self) -> Option<SocketAddr> {
        *self.address.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The server listens at this address.
    pub(crate) fn set_address(&self, address: SocketAddr, is_secure: bool) {
        *self.address.lock().unwrap_or_else(PoisonError::into_inner) = Some(address);
        self.sessions().set_port(address.port(), is_secure);
    }
}
