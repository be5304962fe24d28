//! `retrace shop sparkplug`: the machine as a Sparkplug edge node of an MQTT broker.
//!
//! Invariant: it reads the local socket of the state and the ledger; what comes from the broker ends in the edge node.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use retrace_config::NumberedError;
use retrace_shop::{MqttVersion, ShopFile, SparkplugConfig, SparkplugNotice, SparkplugSession};

use super::machine_observer::MachineObserver;
use crate::stop_signals;

/// Interval at which the machine is read.
const INTERVAL: Duration = Duration::from_millis(20);

/// Runs the command until it is interrupted.
///
/// # Errors
/// `E5021` without the section `[sparkplug]`, `E5026` where another one runs, `E5023` for its files, `E5001` without a
/// state folder, `E5010`; errors of the machine file.
pub fn run(file: &ShopFile, machine_file: Option<&Path>) -> Result<(), NumberedError> {
    let Some(config) = &file.sparkplug else {
        let what = "the shop file names no MQTT broker";
        let remedy = "write `[sparkplug]` and `broker = \"mqtt://HOST:1883\"` to it; docs/shop.md has the keys";
        return Err(NumberedError::new("E5021", what, remedy));
    };
    let mut machine = MachineObserver::new(file, machine_file)?;
    let folder = file.machine_folder();
    folder.create()?;
    let _lock = folder.lock_sparkplug()?;
    let mut session = SparkplugSession::new(config.clone(), &folder)?;
    let is_over = Arc::new(AtomicBool::new(false));
    stop_signals::set_at_signal(&is_over);
    if config.is_readable_by_others() {
        eprintln!("note: {} is not encrypted: others can read the state of this machine", config.address());
    }
    crate::out::line(format!("Sparkplug edge node {}/{}: {}", config.group, file.name, config.address()));
    while !is_over.load(Ordering::Relaxed) {
        machine.read();
        let notices = session.serve(machine.report(), machine.axes())?;
        notices.iter().for_each(|notice| print(config, notice));
        thread::sleep(INTERVAL);
    }
    session.end().iter().for_each(|notice| print(config, notice));
    let received = session.received();
    crate::out::line(format!("ended: {} births on request, {} messages ignored", received.rebirths, received.ignored));
    Ok(())
}

fn print(config: &SparkplugConfig, notice: &SparkplugNotice) {
    let (group, address) = (&config.group, config.address());
    match notice {
        SparkplugNotice::Born(version, number) => {
            let version = if *version == MqttVersion::V5 { "5" } else { "3.1.1" };
            crate::out::line(format!("born in {group} at {address} (MQTT {version}, bdSeq {number})"));
        }
        SparkplugNotice::AwaitsHost(host) => crate::out::line(format!("waiting for the host application {host}")),
        SparkplugNotice::HostOffline(host) => {
            crate::out::line(format!("the host application {host} is offline; the node has left the broker"));
        }
        SparkplugNotice::Error(error) => eprintln!("{}", crate::escape::lines(&error.to_string())),
    }
}
