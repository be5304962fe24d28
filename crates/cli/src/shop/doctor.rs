//! `retrace shop doctor`: what is wrong with the shop at this computer (SHP-37).
//!
//! Invariant: nothing is changed.

use std::time::{Duration, Instant};

use retrace_config::NumberedError;
use retrace_shop::{BrokerConnection, BrokerSettings, Ledger, Outbox, ShopFile, public_key, store_faults};

/// Longest wait for the connection.
const CONNECT_LIMIT: Duration = Duration::from_secs(5);

/// Prints what was found.
///
/// # Errors
/// The first of what is wrong; all of it was printed.
pub fn run(file: &ShopFile) -> Result<(), NumberedError> {
    say!("this computer is {}, its folder {}", file.name, file.machine_folder().path().display());
    let mut found = Vec::new();
    let ledger = Ledger::read(&file.machine_folder().ledger()).map(|ledger| {
        let held = ledger.jobs().iter().filter(|job| job.is_held()).count();
        format!("ledger: {} jobs, {held} of them held", ledger.jobs().len())
    });
    found.push(ledger);
    match &file.broker {
        None => say!("no [broker]: jobs of this computer alone"),
        Some(settings) => broker(file, settings, &mut found),
    }
    let mut first = Ok(());
    for one in found {
        match one {
            Ok(text) => say!("{text}"),
            Err(error) if first.is_ok() => first = Err(error),
            Err(error) => eprintln!("{}", crate::escape::lines(&error.to_string())),
        }
    }
    first
}

fn broker(file: &ShopFile, settings: &BrokerSettings, found: &mut Vec<Result<String, NumberedError>>) {
    found.push(public_key(&settings.seed).map(|key| format!("key: {key}")));
    found.push(Ok(format!("submitters that this machine accepts: {}", settings.submitters.len())));
    found.push(outbox(file));
    let began = Instant::now();
    let connection = BrokerConnection::begin(settings, file.name.as_str());
    let connection = connection.and_then(|connection| connection.wait(CONNECT_LIMIT).map(|()| connection));
    let connection = match connection {
        Ok(connection) => connection,
        Err(error) => return found.push(Err(error)),
    };
    let version = connection.server_version();
    found.push(Ok(format!("broker: nats-server {version}, connected in {} ms", began.elapsed().as_millis())));
    if !is_synced_version(&version) {
        let text = "note: this server cannot make messages durable before it acknowledges them; after a power failure \
                    of its computer `retrace shop host` sends again what it has lost";
        found.push(Ok(text.into()));
    }
    match store_faults(&connection) {
        Ok(faults) if faults.is_empty() => found.push(Ok("streams: complete".into())),
        Ok(faults) => found.extend(faults.into_iter().map(|fault| {
            Err(NumberedError::new("E5035", fault, "run `retrace shop host --once` with the shop file of the host"))
        })),
        Err(error) => found.push(Err(error)),
    }
}

fn outbox(file: &ShopFile) -> Result<String, NumberedError> {
    let waiting = Outbox::open(&file.root)?.ids()?.len();
    Ok(format!("jobs submitted here that no machine has taken yet: {waiting}"))
}

/// Whether the server knows `sync_interval: always`: from version 2.10 on.
fn is_synced_version(version: &str) -> bool {
    let mut parts = version.split('.').map(|part| part.parse::<u32>().unwrap_or(0));
    (parts.next().unwrap_or(0), parts.next().unwrap_or(0)) >= (2, 10)
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_version_decides_by_its_numbers() {
        for (version, is_synced) in
            [("2.9.10", false), ("2.10.0", true), ("2.12.1", true), ("3.0.0", true), ("", false)]
        {
            assert_eq!(super::is_synced_version(version), is_synced, "{version}");
        }
    }
}
