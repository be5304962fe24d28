//! The streams and buckets of a shop at the broker, and the subjects in them.
//!
//! ```text
//!  JOBS      shop.job.machine.<m>, shop.job.group.<g>   signed messages, 30 days
//!  EVENTS    shop.event.<m>                             what the ledgers say, 30 days, at most 1 GiB
//!  programs  objects named by their hashes              files and bundles, 60 days
//!  claims    machine.<m>.<job>, group.<g>.<job>         which machine holds a job
//!  machines  <m>.state                                  what each machine does
//! ```
//!
//! Nothing is acknowledged at the server: an agent reads its subjects from the beginning after each connection, and
//! takes nothing that its ledger has. A queue with acknowledgements was tried; with nats-server 2.9.10 jobs that were
//! confirmed came back after the server was killed, and a queue stopped delivering (SHP-6).
//!
//! Invariant: every subject and key is made here, from checked names.

use std::time::Duration;

use async_nats::jetstream::stream::{Config, DiscardPolicy};
use retrace_config::NumberedError;

use super::broker_connection::{ANSWER_LIMIT, BrokerConnection};
use crate::job::JobTarget;
use crate::job_id::ShopJobId;
use crate::machine_name::MachineName;

/// Stream of signed messages.
pub(crate) const JOBS: &str = "JOBS";
/// Stream of events.
pub(crate) const EVENTS: &str = "EVENTS";
/// Object store of files and bundles.
pub(crate) const PROGRAMS: &str = "programs";
/// Bucket of claims.
pub(crate) const CLAIMS: &str = "claims";
/// Bucket of states.
pub(crate) const MACHINES: &str = "machines";
/// How long messages and events are kept.
pub(crate) const KEPT: Duration = Duration::from_secs(30 * 86_400);
/// Most that the events take.
const MAX_EVENT_BYTES: i64 = 1 << 30;
/// Time within which the server drops a message with the identity of an earlier one.
const DUPLICATE_WINDOW: Duration = Duration::from_secs(3600);

/// Subject of the messages for a machine or group.
pub(crate) fn job_subject(target: &JobTarget) -> String {
    match target {
        JobTarget::Machine(name) => format!("shop.job.machine.{name}"),
        JobTarget::Group(name) => format!("shop.job.group.{name}"),
    }
}

/// Key of the claim of a job.
pub(crate) fn claim_key(target: &JobTarget, id: ShopJobId) -> String {
    match target {
        JobTarget::Machine(name) => format!("machine.{name}.{id}"),
        JobTarget::Group(name) => format!("group.{name}.{id}"),
    }
}

/// Subject of the events of a machine.
pub(crate) fn event_subject(machine: &MachineName) -> String {
    format!("shop.event.{machine}")
}

/// Key of the state of a machine.
pub(crate) fn state_key(machine: &MachineName) -> String {
    format!("{machine}.state")
}

/// Makes the streams and buckets that are missing (SHP-4). Returns the names of those that were made.
///
/// Buckets are made as streams: the client's own functions ask for account information in a form that server 2.9 does
/// not have.
///
/// # Errors
/// `E5035`, `E5038`
pub fn create_missing_stores(connection: &BrokerConnection) -> Result<Vec<String>, NumberedError> {
    let mut made = Vec::new();
    for config in configs() {
        let name = config.name.clone();
        let found = connection.try_run(ANSWER_LIMIT, connection.context().get_stream(&name));
        if matches!(found, Some(Ok(_))) {
            continue;
        }
        connection.run(ANSWER_LIMIT, &format!("stream {name}"), connection.context().create_stream(config))?;
        made.push(name);
    }
    Ok(made)
}

/// What is wrong with the streams and buckets at the broker; nothing where `retrace shop host` has made them.
///
/// # Errors
/// `E5035`, `E5038`
pub fn store_faults(connection: &BrokerConnection) -> Result<Vec<String>, NumberedError> {
    let mut faults = Vec::new();
    for config in configs() {
        let name = &config.name;
        let found = match connection.try_run(ANSWER_LIMIT, connection.context().get_stream(name)) {
            Some(Ok(stream)) => stream.cached_info().config.clone(),
            Some(Err(error)) if error.to_string().contains("not found") => {
                faults.push(format!("stream {name} is missing"));
                continue;
            }
            Some(Err(error)) => return connection.run(ANSWER_LIMIT, &format!("stream {name}"), async { Err(error) }),
            None => return connection.run(ANSWER_LIMIT, &format!("stream {name}"), async { Err("no answer") }),
        };
        let settings = |of: &Config| {
            (
                of.subjects.clone(),
                of.max_age,
                of.max_messages_per_subject,
                of.allow_direct,
                of.deny_delete,
                of.retention,
            )
        };
        if settings(&found) != settings(&config) {
            faults.push(format!("stream {name} has other settings than this program makes"));
        }
    }
    Ok(faults)
}

fn configs() -> [Config; 5] {
    let stream = |name: &str, subject: &str| Config {
        name: name.into(),
        subjects: vec![subject.into()],
        max_age: KEPT,
        max_messages: -1,
        max_bytes: -1,
        max_messages_per_subject: -1,
        max_consumers: -1,
        num_replicas: 1,
        duplicate_window: DUPLICATE_WINDOW,
        allow_direct: true,
        deny_delete: true,
        ..Config::default()
    };
    let bucket = |name: &str, history: i64| Config {
        max_age: Duration::ZERO,
        max_messages_per_subject: history,
        allow_rollup: true,
        discard: DiscardPolicy::New,
        duplicate_window: Duration::from_secs(120),
        ..stream(&format!("KV_{name}"), &format!("$KV.{name}.>"))
    };
    let programs = Config {
        subjects: vec![format!("$O.{PROGRAMS}.C.>"), format!("$O.{PROGRAMS}.M.>")],
        deny_delete: false,
        max_age: 2 * KEPT,
        ..bucket(PROGRAMS, -1)
    };
    [
        stream(JOBS, "shop.job.>"),
        Config { max_bytes: MAX_EVENT_BYTES, ..stream(EVENTS, "shop.event.*") },
        Config { name: format!("OBJ_{PROGRAMS}"), ..programs },
        bucket(CLAIMS, 5),
        bucket(MACHINES, 5),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::content_hash::ContentHash;
    use crate::job::tests::job;

    #[test]
    fn keys_of_machines_and_groups_are_never_the_same() {
        let id = job(1, ContentHash::of(b"")).id;
        let name = MachineName::parse("group").expect("a name");
        let (machine, group) = (JobTarget::Machine(name.clone()), JobTarget::Group(name));
        assert_ne!(claim_key(&machine, id), claim_key(&group, id));
        assert_eq!(job_subject(&machine), "shop.job.machine.group");
        assert_eq!(job_subject(&group), "shop.job.group.group");
    }
}
