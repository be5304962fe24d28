//! The broker between the computers of a shop: NATS JetStream (SHP, section 2).
//!
//! ```text
//!  Outbox ── signed messages, files ──> streams and buckets ──> JobReceiver ──> queue of the machine
//!  watch  <── states, events ──────────                     <── StateSender, EventSender
//! ```
//!
//! The network may be down at any time, for any time: what a machine has taken is run without it, and what was
//! submitted stays with its submitter until a machine has it.
//!
//! Invariant: nothing that arrives moves a machine or starts anything; the most that it does is to put a job into the
//! queue, to give one back that is not running, or to show a text.

mod broker_access;
mod broker_audit;
mod broker_connection;
pub(crate) mod broker_settings;
mod claim;
mod event_sender;
mod job_receiver;
mod outbox;
mod program_store;
mod signed_message;
mod state_sender;
mod stores;

pub use broker_access::{BrokerRole, BrokerUser, ServerSettings, server_config};
pub use broker_audit::audit_broker;
pub use broker_connection::BrokerConnection;
pub use broker_settings::{BrokerSettings, new_seed, public_key};
pub use claim::{Claim, ClaimState, Claiming};
pub use event_sender::{EventSender, ShopEvent};
pub use job_receiver::{BrokerNews, JobReceiver};
pub use outbox::{Delivery, Outbox, SubmittedJob, publish};
pub use signed_message::ShopMessage;
pub use state_sender::{MAX_STATE_AGE, MachineState, StateSender, machine_states};
pub use stores::{create_missing_stores, store_faults};
