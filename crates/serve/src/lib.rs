//! The graphical screen of retrace: a web server with the page, the live state and the operator's commands.
//!
//! ```text
//!  telemetry ─> ModelObserver ─> ScreenModel ─> publisher ─> snapshot ─> sockets ─> pages
//!                                                                           │
//!                  ServeHost::send <─ UiCommand <─ command words, dead man <─┘
//! ```
//!
//! The server is one more screen beside the terminal's: it reads the same model, sends the same commands, and has the
//! same table of what is possible. It runs in a thread of its own; the motion path does not know it, and a page that
//! cannot keep up is sent the newest state, never waited for.
//!
//! Invariant: no plain request moves the machine; an order over a WebSocket moves it only for the page that holds
//! control and has seen the present state. Holding is permitted to everybody.
#![forbid(unsafe_code)]

mod answers;
mod assets;
mod command_words;
mod connection;
mod control;
mod dead_man;
mod failure;
mod guard;
mod hello;
mod host;
mod identity;
mod messages;
mod operator_desk;
mod path_levels;
mod programs;
mod publisher;
mod requests;
#[cfg(test)]
mod schemas;
mod server;
mod server_state;
mod session;
mod shop_job_list;
mod snapshot;
mod socket;
mod table_requests;
mod tls;
mod uploads;
mod watched_folder;

pub use host::{ServeHost, ServeOptions};
pub use identity::ServeIdentity;
pub use programs::ProgramFolders;
pub use server::{ServeHandle, qr_code, start};
pub use snapshot::machine_messages;
pub use tls::TlsFiles;
