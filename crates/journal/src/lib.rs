//! The journal of a job, and the other files of retrace that outlive a command (DNC, *Beyond the source*).
//!
//! ```text
//!  planning thread ──> JournalIndexWriter ──┐                                      ┌─> JobRecord, JobSummary
//!  reporting thread ─> JournalEventWriter ──┼─> queue ─> JournalWriter ─> journal ─┴─> JournalEntries
//!  program stream ───> SpoolWriter ─────────┘                 └─> DurablePlace ─> motion path
//! ```
//!
//! A journal is append-only text, one JSON object per line behind a checksum and a number; a line is a
//! [`JournalEntry`]. It begins with a [`JobHeader`], which names everything that planning depends on. Marks
//! ([`PlaceMark`]) tie places on the path to blocks of the program, and are durable before the card may reach them. A
//! [`JobRecord`] is the result of reading a journal. The [`JobStore`] has one folder per job. [`HomedAxes`] records
//! what was homed.
//!
//! The crate knows no card and no planner; what is written comes from the crates above. `docs/journal.md` describes
//! the format.
//!
//! Invariant: what was reported durable is read again, whole and in order, or the journal is rejected with the place of
//! the error.
//!
//! # Examples
//!
//! ```
//! use retrace_journal::{FileHash, Timestamp};
//! let hash = FileHash::of(b"G0 X1");
//! assert_eq!(hash.to_string().parse(), Ok(hash));
//! let when = Timestamp::now();
//! assert_eq!(when.to_string().parse(), Ok(when));
//! ```
#![forbid(unsafe_code)]

mod consumables;
mod durable_place;
mod entry;
mod file_hash;
mod hold_reason;
mod homed_axes;
mod job_record;
mod job_store;
/// Lines of a checked log; a namespace, because other logs than the journal are written in them.
pub mod journal_line;
mod journal_queue;
mod journal_reader;
mod journal_store;
mod journal_writer;
mod place_index;
mod record_ranges;
mod spool;
/// Operations on files that are replaced whole; a namespace, because its functions are named for any file.
pub mod state_file;
mod sync;
mod timestamp;

pub use consumables::{ConsumableFile, ConsumableSet, ConsumableSets, ConsumableWear};
pub use durable_place::DurablePlace;
pub use entry::{
    CommandArguments, EndEntry, FORMAT, FileRole, JobCard, JobEnding, JobHeader, JournalEntry, LatchedTables,
    LostEntries, MachineFileCopy, MachineTables, PlannedOverride, PlannedRest, PositionEntry, ProgramSource, ReadFile,
    ResumeEntry, SpooledBytes, WiredCard,
};
pub use file_hash::{FileHash, ParseHashError};
pub use hold_reason::HoldReason;
pub use homed_axes::{CardBoot, HomedAxes, axes_to_home};
pub use job_record::{InterruptedCut, JobRecord, JobSummary, LastPosition};
pub use job_store::{JobFolder, JobLock, JobState, JobStore, ListedJob, plain_name};
pub use journal_queue::{Durability, JournalNotice};
pub use journal_reader::{JournalEntries, JournalError, JournalTail};
pub use journal_store::{FileStore, JournalStore};
pub use journal_writer::{JournalEventWriter, JournalIndexWriter, JournalWriter};
pub use place_index::{
    IndexEntry, IndexWriter, InputAnswer, JournalConfig, LengthChange, MarkDifference, PlaceMark, ProbeAnswer,
    ProgramAnswer, TapAnswer, TapBegin,
};
pub use record_ranges::RecordRanges;
pub use spool::{SpoolProgress, SpoolReplay, SpoolWriter};
pub use timestamp::{ParseTimestampError, Timestamp};
