//! A connection to the broker, used by calls that wait.
//!
//! The client connects again by itself, after 0.2 to 30 s with jitter (SHP-18). A request that the server refuses is
//! not answered: it times out, and only an event says why (SHP-25); the diagnostic then has the text of that event.
//!
//! Invariant: no call waits longer than its limit, whether the broker is there or not.

use std::future::Future;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use async_nats::jetstream::kv::Store;
use async_nats::jetstream::message::StreamMessage;
use async_nats::jetstream::object_store::ObjectStore;
use async_nats::jetstream::stream::{DirectGetError, DirectGetErrorKind, Stream};
use async_nats::jetstream::{self, Context};
use async_nats::{Client, ConnectOptions, Event};
use nkeys::KeyPair;
use retrace_config::NumberedError;
use tokio::runtime::Runtime;

use super::broker_settings::{BrokerSettings, read_seed};

/// Longest wait for an answer.
pub(crate) const ANSWER_LIMIT: Duration = Duration::from_secs(5);
/// Longest wait for the transfer of a file.
pub(crate) const TRANSFER_LIMIT: Duration = Duration::from_secs(600);
/// Longest wait for a message of a stream, which may be a part of a file over a slow line.
const MESSAGE_LIMIT: Duration = Duration::from_secs(60);
/// Shortest and longest time before another attempt to connect.
const RETRY: [Duration; 2] = [Duration::from_millis(200), Duration::from_secs(30)];

/// A connection, or the attempts to make one.
pub struct BrokerConnection {
    runtime: Runtime,
    client: Client,
    context: Context,
    key: KeyPair,
    seen: Arc<Seen>,
}

/// What the events of the client have said.
#[derive(Debug, Default)]
struct Seen {
    connections: AtomicU64,
    /// Text of the last error that the server has sent.
    refusal: Mutex<Option<String>>,
}

impl std::fmt::Debug for BrokerConnection {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("BrokerConnection").field("state", &self.client.connection_state()).finish_non_exhaustive()
    }
}

impl BrokerConnection {
    /// Begins to connect; `name` is the name of this machine, or of the program that connects.
    ///
    /// # Errors
    /// `E5036` for the seed; `E5035` where the address or the certificates cannot be used.
    pub fn begin(settings: &BrokerSettings, name: &str) -> Result<Self, NumberedError> {
        let key = read_seed(&settings.seed)?;
        let away = |error: String| away(&settings.servers, &error);
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build();
        let runtime = runtime.map_err(|error| away(error.to_string()))?;
        let seen = Arc::new(Seen::default());
        let events = Arc::clone(&seen);
        let mut options = ConnectOptions::new()
            .nkey(key.seed().map_err(|error| away(error.to_string()))?)
            .name(format!("retrace {name}"))
            .custom_inbox_prefix(format!("_INBOX_{name}"))
            .retry_on_initial_connect()
            .ignore_discovered_servers()
            .connection_timeout(ANSWER_LIMIT)
            .request_timeout(Some(ANSWER_LIMIT))
            .reconnect_delay_callback(|attempts| delay(attempts, random()))
            .event_callback(move |event| {
                events.take(event);
                std::future::ready(())
            });
        if settings.servers.iter().any(|server| server.starts_with("tls")) {
            options = options.require_tls(true);
        }
        if let Some(ca) = &settings.ca {
            options = options.add_root_certificates(ca.clone());
        }
        let servers = settings.servers.clone();
        let client = runtime.block_on(options.connect(servers)).map_err(|error| away(error.to_string()))?;
        let mut context = {
            let _entered = runtime.enter();
            jetstream::new(client.clone())
        };
        context.set_timeout(ANSWER_LIMIT);
        Ok(Self { runtime, client, context, key, seen })
    }

    /// Waits until the connection is there.
    ///
    /// # Errors
    /// `E5035` where it is not within the limit.
    pub fn wait(&self, limit: Duration) -> Result<(), NumberedError> {
        let until = std::time::Instant::now() + limit;
        while !self.is_connected() {
            if std::time::Instant::now() >= until {
                let why = self.seen.refusal().unwrap_or_else(|| "it does not answer".into());
                return Err(away(&[], &why));
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        Ok(())
    }

    /// Whether the connection is there.
    #[must_use]
    pub fn is_connected(&self) -> bool {
        self.client.connection_state() == async_nats::connection::State::Connected
    }

    /// How many times a connection was made; what was read over an earlier one may not be there any more.
    #[must_use]
    pub fn connections(&self) -> u64 {
        self.seen.connections.load(Ordering::SeqCst)
    }

    /// Key of this computer.
    #[must_use]
    pub(crate) fn key(&self) -> &KeyPair {
        &self.key
    }

    /// Version of the server, such as `2.9.10`.
    #[must_use]
    pub fn server_version(&self) -> String {
        self.client.try_server_info().map(|info| info.version).unwrap_or_default()
    }

    pub(crate) fn context(&self) -> &Context {
        &self.context
    }

    pub(crate) fn stream(&self, name: &str) -> Result<Stream, NumberedError> {
        self.run(ANSWER_LIMIT, "a stream", self.context.get_stream(name))
    }

    pub(crate) fn bucket(&self, name: &str) -> Result<Store, NumberedError> {
        self.run(ANSWER_LIMIT, "a bucket", self.context.get_key_value(name))
    }

    pub(crate) fn objects(&self, name: &str) -> Result<ObjectStore, NumberedError> {
        self.run(ANSWER_LIMIT, "an object store", self.context.get_object_store(name))
    }

    /// Waits for a request, up to the limit.
    ///
    /// # Errors
    /// `E5035` where it failed or the limit has passed; with the text of the server where it was refused.
    pub(crate) fn run<T, E: std::fmt::Display>(
        &self,
        limit: Duration,
        what: &str,
        request: impl Future<Output = Result<T, E>>,
    ) -> Result<T, NumberedError> {
        let found = self.runtime.block_on(async { tokio::time::timeout(limit, request).await });
        let error = match found {
            Ok(Ok(found)) => return Ok(found),
            Ok(Err(error)) => error.to_string(),
            Err(_) => "no answer".to_owned(),
        };
        Err(match self.seen.refusal() {
            Some(refusal) => NumberedError::new(
                "E5038",
                format!("the broker refuses {what}: {refusal}"),
                "check the permissions of this computer's key; `retrace shop init` writes those that are needed",
            ),
            None => NumberedError::new(
                "E5035",
                format!("the broker has not answered ({what}): {error}"),
                "it is tried again; check the network, and that `retrace shop host` has run with this broker",
            ),
        })
    }

    /// Waits for a message of a stream; `None` where it is not there.
    ///
    /// # Errors
    /// As [`run`](Self::run).
    pub(crate) fn run_found(
        &self,
        what: &str,
        request: impl Future<Output = Result<StreamMessage, DirectGetError>>,
    ) -> Result<Option<StreamMessage>, NumberedError> {
        match self.try_run(MESSAGE_LIMIT, request) {
            Some(Ok(message)) => Ok(Some(message)),
            Some(Err(error)) if error.kind() == DirectGetErrorKind::NotFound => Ok(None),
            Some(Err(error)) => self.run(ANSWER_LIMIT, what, async { Err(error) }),
            None => self.run(ANSWER_LIMIT, what, async { Err("no answer") }),
        }
    }

    /// As [`run`](Self::run), for a request whose error the caller handles.
    pub(crate) fn try_run<T>(&self, limit: Duration, request: impl Future<Output = T>) -> Option<T> {
        self.runtime.block_on(async { tokio::time::timeout(limit, request).await.ok() })
    }
}

impl Seen {
    fn take(&self, event: Event) {
        match event {
            Event::Connected => {
                self.connections.fetch_add(1, Ordering::SeqCst);
                *self.refusal.lock().unwrap_or_else(PoisonError::into_inner) = None;
            }
            Event::ServerError(error) => {
                let text: String = error.to_string().chars().filter(|letter| !letter.is_control()).take(300).collect();
                *self.refusal.lock().unwrap_or_else(PoisonError::into_inner) = Some(text);
            }
            _ => {}
        }
    }

    /// The last refusal, which is told once.
    fn refusal(&self) -> Option<String> {
        self.refusal.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

fn away(servers: &[String], why: &str) -> NumberedError {
    let named = if servers.is_empty() { String::new() } else { format!(" {}", servers.join(", ")) };
    let remedy = "what was taken can be run; check the network, the server, and `servers`, `seed` and `ca` in [broker]";
    NumberedError::new("E5035", format!("the broker{named} cannot be reached: {why}"), remedy)
}

/// Time before the next attempt: twice as long each time, less up to a half by a random share of 0 to 1.
fn delay(attempts: usize, share: f64) -> Duration {
    let [first, longest] = RETRY;
    let full = first.saturating_mul(1 << attempts.saturating_sub(1).min(10)).min(longest);
    full.mul_f64(0.5 + 0.5 * share).max(first)
}

fn random() -> f64 {
    let mut bytes = [0; 4];
    // without it the attempts are not spread
    let _ = getrandom::fill(&mut bytes);
    f64::from(u32::from_le_bytes(bytes)) / f64::from(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attempts_are_spread_and_never_further_apart_than_30_s() {
        for attempts in 0..100 {
            for share in [0.0, 0.5, 1.0] {
                let found = delay(attempts, share);
                assert!(found >= RETRY[0] && found <= RETRY[1], "{attempts} {share}: {found:?}");
            }
        }
        assert_eq!(delay(1, 1.0), RETRY[0]);
        assert_eq!(delay(20, 1.0), RETRY[1]);
        assert!(delay(20, 0.0) < delay(20, 1.0));
        assert!((0..100).map(|_| random()).any(|share| share > 0.5));
    }
}
