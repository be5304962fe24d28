//! The socket of the state on systems without local sockets: there is none.

use std::sync::{Arc, Mutex};

use retrace_tui::ScreenModel;

/// Socket that is never made.
#[derive(Debug)]
pub enum StateSocket {}

impl StateSocket {
    /// Always none.
    pub fn serve(_: &Arc<Mutex<ScreenModel>>) -> Option<Self> {
        None
    }
}
