//! The journal of a job: what is needed to resume it after the computer has failed (DNC, *Beyond the source*).
//!
//! Append-only text, one JSON object per line behind a checksum and a number ([`journal_line`]); its content is in
//! [`entry`]. A [`journal_writer::JournalWriter`] writes it in its own thread; a [`job_record::JobRecord`] is the
//! result of reading it.
//!
//! Invariant: what was reported durable is read again, whole and in order, or the journal is rejected with the place of
//! the error.

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
