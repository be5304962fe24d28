//! The journal of a job: what is needed to take it up again after the computer has failed (DNC, *Beyond the source*).
//!
//! Text that is only appended to, one JSON object a line behind a checksum and a number ([`mod@line`]); what it says is in [`entry`]. A
//! [`logbook::Logbook`] writes it in a thread of its own, a [`record::JobRecord`] is what it comes to when it is read.
//!
//! Invariant: what was said to be durable is read again, whole and in its order, or the journal is refused with the place of the flaw.

pub mod entry;
pub mod hash;
pub mod job_record;
pub mod journal_line;
mod journal_queue;
pub mod journal_reader;
pub mod journal_recorder;
pub mod journal_writer;
pub mod spool;
pub mod store;
pub mod timestamp;
