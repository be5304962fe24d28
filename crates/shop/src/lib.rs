//! Jobs of a shop of machines (SHP): from their submission to the ledger of the machine that has cut them.
//!
//! ```text
//!  submit ────────┐                             ┌─> Inbox: the files of each job
//!  FolderWatch ───┴─> JobQueue ─> take_waiting ─┴─> Ledger: one entry per event
//!                                                     └─> ShopJobState, audit (with the journals of the runs)
//! ```
//!
//! A [`ShopJob`] is so many pieces of one program for one machine. Its files are a [`Bundle`]: each is named by its
//! SHA-256. The machine's agent moves a job from the [`JobQueue`] to the [`Inbox`] and writes `taken` to the
//! [`Ledger`]; from then on the job is the machine's. A run of it is a job of `retrace-journal`, started by the
//! operator at the machine; what became of it is read from its journal.
//!
//! The crate cannot move a machine: it knows neither the controller nor a card. `docs/shop.md` describes its use.
//!
//! Invariant: a job that was submitted is in exactly one of queue and ledger, whenever the processes are killed.
//!
//! # Examples
//!
//! ```
//! use retrace_shop::{MachineName, ShopJobId};
//! let id = ShopJobId::new_now()?;
//! assert_eq!(id.to_string().parse(), Ok(id));
//! assert!("mill-3".parse::<MachineName>().is_ok());
//! assert!("../mill".parse::<MachineName>().is_err());
//! # Ok::<(), retrace_config::NumberedError>(())
//! ```
#![forbid(unsafe_code)]

mod audit;
mod broker;
mod bundle;
mod checked_log;
mod content_hash;
#[cfg(target_os = "linux")]
mod fifo_reader;
mod folder_watch;
mod free_space;
mod inbox;
mod inbox_limits;
mod job;
mod job_id;
mod job_state;
mod job_taking;
mod ledger;
mod ledger_entry;
mod machine_folder;
mod machine_name;
mod machine_report;
mod machine_table;
mod message_log;
#[cfg(unix)]
mod mtconnect;
mod queue;
mod recall;
mod run_recorder;
mod run_state;
mod shop_file;
#[cfg(unix)]
mod sparkplug;
mod sparkplug_config;
#[cfg(unix)]
mod state_reader;
#[cfg(target_os = "linux")]
mod tape_marks;
mod watch_log;

pub use audit::{AuditFault, AuditReport, HeldJob, audit_roots};
pub use broker::{
    BrokerConnection, BrokerNews, BrokerRole, BrokerSettings, BrokerUser, Claim, ClaimState, Claiming, Delivery,
    EventSender, JobReceiver, MAX_STATE_AGE, MachineState, Outbox, ServerSettings, ShopEvent, ShopMessage, StateSender,
    SubmittedJob, audit_broker, create_missing_stores, machine_states, new_seed, public_key, publish, server_config,
    store_faults,
};
pub use bundle::{Bundle, BundleFile, BundleRole, MAX_BUNDLE_BYTES, MAX_BUNDLE_FILES, SourceFile};
pub use content_hash::{ContentHash, ParseContentHashError};
pub use folder_watch::{FolderWatch, WatchOutcome};
pub use inbox::Inbox;
pub use inbox_limits::InboxLimits;
pub use job::{JobTarget, MachineFileDemand, ShopJob};
pub use job_id::{ParseShopJobIdError, ShopJobId};
pub use job_state::ShopJobState;
pub use job_taking::{Taking, take_waiting};
pub use ledger::{Ledger, LedgerJob, LedgerRun, OpenLedger};
pub use ledger_entry::{CheckSummary, LedgerEntry, RunOutcome};
pub use machine_folder::MachineFolder;
pub use machine_name::{MachineName, ParseMachineNameError};
pub use machine_report::{MachineReport, ReportedAxis};
pub use machine_table::machine_table;
pub use message_log::{HandledContent, HandledMessage, read as read_messages};
#[cfg(unix)]
pub use mtconnect::{DataItem, ShdrAdapter, data_items, devices_xml};
pub use queue::{JobQueue, QueuedJob};
pub use recall::give_back;
pub use run_recorder::RunRecorder;
pub use run_state::{RunState, run_state};
pub use shop_file::{ShopFile, WatchConfig};
#[cfg(unix)]
pub use sparkplug::{
    EdgeNode, MqttVersion, NodeMetric, NodeName, NodeStep, Publication, ReceivedCounts, SparkplugNotice,
    SparkplugSession, node_metrics,
};
pub use sparkplug_config::SparkplugConfig;
#[cfg(unix)]
pub use state_reader::StateReader;
