//! Who may do what at the broker, and the server configuration that says so (SHP-24).
//!
//! A machine may read the messages and programs of the shop, write its own events, state and claims, and those of its
//! groups. It can make no consumer: whoever may make one can have the server send what is stored to any subject. A
//! submitter may send jobs; the host may also make the streams.
//!
//! Invariant: what is not listed here is not allowed.

use std::fmt::Write;

use super::stores::{CLAIMS, EVENTS, JOBS, MACHINES, PROGRAMS};
use crate::machine_name::MachineName;

/// A computer of a shop.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BrokerUser {
    /// Its name.
    pub name: MachineName,
    /// Its public key.
    pub key: String,
    /// What it is.
    pub role: BrokerRole,
}

/// What a computer of a shop is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BrokerRole {
    /// A machine, with its groups.
    Machine(Vec<MachineName>),
    /// It submits jobs.
    Submitter,
    /// It also makes the streams.
    Host,
}

/// Settings of the server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServerSettings {
    /// Address and port to listen on.
    pub listen: String,
    /// Folder of the streams.
    pub store: String,
    /// Files of certificate and private key; `None` is unencrypted.
    pub tls: Option<[String; 2]>,
    /// Whether each message is made durable before it is acknowledged, which a server can from version 2.10 on (SHP-5).
    pub is_always_synced: bool,
}

/// The configuration of a nats-server for these computers.
#[must_use]
pub fn server_config(settings: &ServerSettings, users: &[BrokerUser]) -> String {
    let mut text = format!(
        "# Written by `retrace shop init`.\nlisten: {:?}\njetstream {{\n  store_dir: {:?}\n",
        settings.listen, settings.store
    );
    if settings.is_always_synced {
        text += "  sync_interval: always\n";
    }
    text += "}\n";
    if let Some([certificate, key]) = &settings.tls {
        let _ = write!(text, "tls {{\n  cert_file: {certificate:?}\n  key_file: {key:?}\n}}\n");
    }
    text += "authorization {\n  users = [\n";
    for BrokerUser { name, key, role } in users {
        let list = |subjects: &[String]| {
            subjects.iter().map(|subject| format!("{subject:?}")).collect::<Vec<String>>().join(", ")
        };
        let publish = list(&published(name, role));
        let _ = write!(
            text,
            "    # {name}\n    {{ nkey: {key}, permissions: {{\n      publish: {{ allow: [{publish}] }}\n      \
             subscribe: {{ allow: [\"_INBOX_{name}.>\"] }} }} }}\n"
        );
    }
    text += "  ]\n}\n";
    text
}

/// Subjects that a computer may publish to; requests are among them.
fn published(name: &MachineName, role: &BrokerRole) -> Vec<String> {
    let info = |stream: &str| format!("$JS.API.STREAM.INFO.{stream}");
    let last = |stream: &str, subject: &str| format!("$JS.API.DIRECT.GET.{stream}.{subject}");
    let (claims, programs, machines) = (format!("KV_{CLAIMS}"), format!("OBJ_{PROGRAMS}"), format!("KV_{MACHINES}"));
    let mut subjects = vec![
        info(JOBS),
        info(EVENTS),
        info(&claims),
        info(&programs),
        info(&machines),
        format!("$JS.API.DIRECT.GET.{JOBS}"),
        format!("$JS.API.DIRECT.GET.{programs}"),
        last(&programs, ">"),
        last(&claims, ">"),
    ];
    match role {
        BrokerRole::Machine(groups) => {
            subjects.extend([
                last(EVENTS, &format!("shop.event.{name}")),
                format!("shop.event.{name}"),
                format!("$KV.{MACHINES}.{name}.>"),
                format!("$KV.{CLAIMS}.machine.{name}.>"),
            ]);
            subjects.extend(groups.iter().map(|group| format!("$KV.{CLAIMS}.group.{group}.>")));
        }
        BrokerRole::Submitter | BrokerRole::Host => {
            subjects.extend([
                last(EVENTS, ">"),
                format!("$JS.API.DIRECT.GET.{EVENTS}"),
                last(&machines, ">"),
                "shop.job.>".into(),
                format!("$O.{PROGRAMS}.>"),
                format!("$JS.API.STREAM.MSG.GET.{programs}"),
                format!("$JS.API.STREAM.PURGE.{programs}"),
                format!("$KV.{CLAIMS}.>"),
            ]);
        }
    }
    if *role == BrokerRole::Host {
        subjects
            .extend([JOBS, EVENTS, &claims, &programs, &machines].map(|name| format!("$JS.API.STREAM.CREATE.{name}")));
    }
    subjects
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(text: &str) -> MachineName {
        MachineName::parse(text).expect("a name")
    }

    /// No machine may publish what belongs to another machine, and none may make a consumer or a stream.
    #[test]
    fn a_machine_writes_only_what_is_its_own() {
        let role = BrokerRole::Machine(vec![name("mills")]);
        let written: Vec<String> = published(&name("m1"), &role)
            .into_iter()
            .filter(|subject| !subject.starts_with("$JS.API.STREAM.INFO.") && !subject.contains("DIRECT.GET"))
            .collect();
        let expected = ["shop.event.m1", "$KV.machines.m1.>", "$KV.claims.machine.m1.>", "$KV.claims.group.mills.>"];
        assert_eq!(written, expected);
        for role in [role, BrokerRole::Submitter, BrokerRole::Host] {
            assert!(!published(&name("m1"), &role).iter().any(|subject| subject.contains("CONSUMER")));
        }
    }
}
