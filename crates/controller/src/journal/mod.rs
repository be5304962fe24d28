//! The journal of a job: what is needed to take it up again after the computer has failed (DNC, *Beyond the source*).
//!
//! Text that is only appended to, one JSON object a line behind a checksum and a number ([`mod@line`]); what it says is in [`entry`]. A
//! [`logbook::Logbook`] writes it in a thread of its own, a [`record::JobRecord`] is what it comes to when it is read.
//!
//! Invariant: what was said to be durable is read again, whole and in its order, or the journal is refused with the place of the flaw.

mod desk;
pub mod entry;
pub mod hash;
pub mod keeper;
pub mod line;
pub mod logbook;
pub mod reader;
pub mod record;
pub mod spool;
pub mod stamp;
pub mod store;
