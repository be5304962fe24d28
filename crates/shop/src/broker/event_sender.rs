//! Sends what a machine's ledger says to the broker (SHP-3).
//!
//! The ledger is the outbox: an event is an entry with its number, and the number of the last event at the broker says
//! where to go on. Nothing is stored for it at the machine, and a broker that has lost its disk gets everything again.
//!
//! Invariant: the events of a machine are at the broker in the order of its ledger, each once.

use async_nats::header::HeaderMap;
use retrace_config::NumberedError;
use retrace_journal::Timestamp;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::broker_connection::{ANSWER_LIMIT, BrokerConnection};
use super::stores::{EVENTS, KEPT, event_subject};
use crate::checked_log;
use crate::ledger_entry::LedgerEntry;
use crate::machine_folder::MachineFolder;
use crate::machine_name::MachineName;

/// Most events that are sent in one pass.
const MAX_PER_PASS: usize = 1000;

/// An event of a machine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShopEvent {
    /// The machine.
    pub machine: MachineName,
    /// Number of the entry in its ledger, from 0.
    pub number: u64,
    /// The entry, without the paths of the machine.
    pub event: Value,
}

/// Sender of a machine's events.
#[derive(Debug)]
pub struct EventSender {
    machine: MachineFolder,
    connection: u64,
    /// Number of the next event; `None` where it has to be asked for.
    next: Option<u64>,
    /// Length of the ledger when everything of it was sent.
    sent_bytes: u64,
}

impl EventSender {
    /// Sender of this machine.
    #[must_use]
    pub fn new(machine: MachineFolder) -> Self {
        Self { machine, connection: 0, next: None, sent_bytes: 0 }
    }

    /// Sends what is new. Returns the number of events that were sent.
    ///
    /// # Errors
    /// `E5009`, `E5010` for the ledger; `E5035`, `E5038` for the broker, after which the next pass goes on.
    pub fn pass(&mut self, broker: &BrokerConnection) -> Result<usize, NumberedError> {
        if broker.connections() != self.connection {
            (self.connection, self.next, self.sent_bytes) = (broker.connections(), None, 0);
        }
        let bytes = std::fs::metadata(self.machine.ledger()).map_or(0, |found| found.len());
        if bytes == self.sent_bytes {
            return Ok(0);
        }
        let entries = checked_log::read::<LedgerEntry>(&self.machine.ledger())?.entries;
        let next = match self.next {
            Some(next) => next,
            None => self.ask_next(broker, &entries)?,
        };
        let begin = usize::try_from(next).unwrap_or(usize::MAX).min(entries.len());
        let mut sent = 0;
        for (number, entry) in entries.iter().enumerate().skip(begin).take(MAX_PER_PASS) {
            // not known until it is answered
            self.next = None;
            self.send(broker, number as u64, entry)?;
            self.next = Some(number as u64 + 1);
            sent += 1;
        }
        if begin + sent == entries.len() {
            self.sent_bytes = bytes;
        }
        Ok(sent)
    }

    /// Number of the first event that the broker does not have; older ones than it keeps are left out.
    fn ask_next(&self, broker: &BrokerConnection, entries: &[LedgerEntry]) -> Result<u64, NumberedError> {
        let stream = broker.stream(EVENTS)?;
        let last = stream.direct_get_last_for_subject(event_subject(self.machine.name()));
        match broker.run_found("the last event", last)? {
            Some(message) => {
                // an event that cannot be read was not written by this program; all are sent again then
                let event = serde_json::from_slice::<ShopEvent>(&message.payload);
                Ok(event.map_or(0, |event| event.number.saturating_add(1)))
            }
            None => {
                let oldest = Timestamp::now().ms().saturating_sub(KEPT.as_millis() as u64);
                Ok(entries.iter().position(|entry| entry.when().ms() >= oldest).unwrap_or(entries.len()) as u64)
            }
        }
    }

    fn send(&self, broker: &BrokerConnection, number: u64, entry: &LedgerEntry) -> Result<(), NumberedError> {
        let name = self.machine.name();
        let mut event = serde_json::to_value(entry).unwrap_or_default();
        if let Some(fields) = event.as_object_mut() {
            fields.remove("journal");
        }
        let event = ShopEvent { machine: name.clone(), number, event };
        let text = serde_json::to_vec(&event).unwrap_or_default();
        let mut headers = HeaderMap::new();
        headers.insert("Nats-Msg-Id", format!("{name} {number}").as_str());
        let published = async {
            let sent = broker.context().publish_with_headers(event_subject(name), headers, text.into()).await?;
            sent.await
        };
        broker.run(2 * ANSWER_LIMIT, "an event", published).map(|_| ())
    }
}
