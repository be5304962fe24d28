//! MTConnect: an SHDR adapter from which an agent reads what a machine does (SHP-29).
//!
//! ```text
//!  socket of the state ─> StateReader ─> MachineReport ─> ShdrAdapter ─> agents
//! ```
//!
//! The protocol is described in the MTConnect standard, part 1 and 2, and in the documentation of its agent ("SHDR
//! protocol 2.0"). An item that is not known is `UNAVAILABLE`.
//!
//! Invariant: read-only on both sides. Nothing that an agent sends changes anything but its own connection.

mod data_item;
mod devices_xml;
mod shdr_adapter;
mod shdr_line;

pub use data_item::{DataItem, data_items};
pub use devices_xml::devices_xml;
pub use shdr_adapter::ShdrAdapter;
