//! `retrace shop mtconnect`: an adapter for an MTConnect agent, and its device file.
//!
//! Invariant: it reads the local socket of the state and the ledger, and writes to agents; nothing comes back.

use std::net::TcpListener;
use std::thread;
use std::time::Duration;

use retrace_config::NumberedError;
use retrace_shop::{ShdrAdapter, ShopFile, devices_xml};

use super::machine_observer::{self, MachineObserver};
use crate::args::MtConnect;

/// Interval at which the machine is read.
const INTERVAL: Duration = Duration::from_millis(20);

/// Runs the command until it is interrupted, or prints the device file.
///
/// # Errors
/// `E5018` where the port cannot be had, `E5001` without a state folder; errors of the machine file.
pub fn run(file: &ShopFile, args: &MtConnect) -> Result<(), NumberedError> {
    if args.devices {
        let axes = machine_observer::axes(file, args.machine.as_deref())?;
        crate::out::line(devices_xml(&file.name.to_string(), &axes).trim_end());
        return Ok(());
    }
    let mut machine = MachineObserver::new(file, args.machine.as_deref())?;
    let refused = |error: std::io::Error| {
        let what = format!("{} cannot be listened on: {error}", args.listen);
        NumberedError::new("E5018", what, "name another address and port with --listen")
    };
    let listener = TcpListener::bind(&args.listen).map_err(refused)?;
    let address = listener.local_addr().map_err(refused)?;
    if !address.ip().is_loopback() {
        eprintln!("note: everyone on the network of {address} can read the state of this machine, without encryption");
    }
    let mut adapter = ShdrAdapter::new(listener).map_err(refused)?;
    crate::out::line(format!("MTConnect adapter of {}: {address} (SHDR 2.0)", file.name));
    loop {
        machine.read();
        adapter.serve(machine.report(), machine.axes());
        thread::sleep(INTERVAL);
    }
}
