//! `retrace shop mtconnect`: an adapter for an MTConnect agent, and its device file.
//!
//! Invariant: it reads the local socket of the state and the ledger, and writes to agents; nothing comes back.

use std::net::TcpListener;
use std::thread;
use std::time::{Duration, Instant};

use retrace_config::{MachineConfig, NumberedError};
use retrace_journal::JobStore;
use retrace_shop::{MachineReport, ReportedAxis, ShdrAdapter, ShopFile, StateReader, devices_xml};

use super::ShopJobs;
use crate::args::MtConnect;
use crate::files;

/// Interval at which the machine is read.
const INTERVAL: Duration = Duration::from_millis(20);
/// Interval at which the ledger is read.
const PIECES_INTERVAL: Duration = Duration::from_secs(5);

/// Runs the command until it is interrupted, or prints the device file.
///
/// # Errors
/// `E5018` where the port cannot be had, `E5001` without a state folder; errors of the machine file.
pub fn run(file: &ShopFile, args: &MtConnect) -> Result<(), NumberedError> {
    let machine = files::machine(args.machine.as_deref().or(file.machine_file.as_deref()))?;
    if args.devices {
        crate::out::line(devices_xml(&file.name.to_string(), &axes(&machine)).trim_end());
        return Ok(());
    }
    let Some(state) = JobStore::state_folder() else {
        let what = "no state folder: neither XDG_STATE_HOME nor HOME names one";
        return Err(NumberedError::new("E5001", what, "set HOME or XDG_STATE_HOME"));
    };
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
    let (mut reader, mut report) = (StateReader::new(state.join("running")), MachineReport::default());
    let (axes, mut counted) = (axes(&machine), None::<Instant>);
    loop {
        reader.read(&mut report);
        if counted.is_none_or(|counted| counted.elapsed() >= PIECES_INTERVAL) {
            (report.pieces, counted) = (pieces(file), Some(Instant::now()));
        }
        // The machine that reports knows its axes; before that, those of the machine file are listed.
        let reported = reader.axes();
        adapter.serve(&report, if reported.is_empty() { &axes } else { reported });
        thread::sleep(INTERVAL);
    }
}

fn axes(machine: &MachineConfig) -> Vec<ReportedAxis> {
    let axis =
        |axis: &retrace_config::AxisConfig| ReportedAxis { letter: axis.name, is_linear: !"abc".contains(axis.name) };
    machine.axes.iter().map(axis).collect()
}

/// Good pieces, and scrap, by the ledger; none where there is no ledger that can be read.
fn pieces(file: &ShopFile) -> Option<[u64; 2]> {
    let jobs = ShopJobs::read(file).ok()?;
    let good = jobs.ledger.jobs().iter().map(|job| u64::from(job.good_pieces_now())).sum();
    let runs = jobs.ledger.jobs().iter().flat_map(|job| &job.runs);
    Some([good, runs.filter(|run| run.is_scrap).count() as u64])
}
