//! `retrace card serve`: a simulated card on a pseudo-terminal, in wall time, with a machine whose inputs can be
//! operated.
//!
//! Invariant: the card's time follows the monotonic clock; a short delay of this process is caught up. A longer one is
//! skipped, as if the machine had been at rest with it: a real card is never delayed, and the host is not at fault for
//! it.

use retrace_core::RecordIndex;
use std::cell::Cell;
use std::io::{BufWriter, IsTerminal as _};
use std::path::Path;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};

use retrace_config::{MachineConfig, NumberedError};
use retrace_hal_serial::Pty;
use retrace_hal_sim::{CardSimulator, CardSimulatorSettings, LineCounters, PlantSettings, StepWire, faults};
use retrace_link::{Alarm, CardFailure, PathStart};
use serde_json::{Value, json};

use crate::files::unwritable;
use crate::manual_inputs::{DeclaredInputs, ManualInput};
use crate::sim_wiring::{hung_on, parsed_source_faults};
use crate::simulated_work::parsed_work;
use crate::{args, files, linked_card};

/// Longest delay that is caught up.
const MAX_CATCH_UP_US: u64 = 20_000;
/// Serial number of every simulated card: it is always the same card, restarted.
const SERIAL: u32 = 1;
/// Longest wait for a byte.
const WAIT_US: u64 = 1_000;
/// Interval at which a trace is flushed to its file.
const FLUSH: Duration = Duration::from_millis(200);

/// Runs the command until it is interrupted, or for the time on the command line.
///
/// # Errors
/// Whatever prevents the card from being served.
pub fn run(args: &args::Serve) -> Result<(), NumberedError> {
    if !(0.01..=100.0).contains(&args.speed) {
        return Err(serve_error(format!("--speed {}", args.speed), "give a number from 0.01 to 100"));
    }
    let machine = files::machine(args.machine_file.path())?;
    match machine.axes.len() {
        0..=4 => serve::<4>(args, &machine),
        _ => serve::<9>(args, &machine),
    }
}

fn serve_error(what: impl Into<String>, remedy: impl Into<String>) -> NumberedError {
    NumberedError::new("E2149", what, remedy)
}

fn serve<const A: usize>(args: &args::Serve, machine: &MachineConfig) -> Result<(), NumberedError> {
    let mut rig = build_simulator::<A>(args, machine)?;
    let digital = machine.card_settings::<A>(PathStart::at(RecordIndex::new(0))).inputs;
    let inputs = DeclaredInputs { digital: &digital, analog: &machine.card.analog_inputs };
    let pty = Pty::open()
        .map_err(|error| serve_error(format!("no pseudo-terminal is available: {error}"), "see `man pts`"))?;
    if let Some(link) = &args.link {
        create_link(pty.path(), link)?;
    }
    say!("{}", pty.path().display());
    let end = ServeEnd {
        is_powered: Cell::new(true),
        after: args.seconds.map(|s| Duration::try_from_secs_f64(s).unwrap_or(Duration::MAX)),
        at_eof: args.until_eof,
        is_plugged_in: Cell::new(true),
        lines: lines_of_input(args.until_eof || args.manual_inputs || !std::io::stdin().is_terminal()),
    };
    let mut served = ServeCounters { pty, started: Instant::now(), speed: args.speed, away_us: 0, alarm: None };
    served.run(&mut rig, &end, inputs)?;
    rig.flush();
    if let Some(link) = &args.link {
        let _ = std::fs::remove_file(link);
    }
    let told = counters_json(&rig, &served);
    if args.json {
        crate::out::line(told);
    } else {
        say!("{told:#}");
    }
    Ok(())
}

/// Simulated machine of a machine file.
fn build_simulator<const A: usize>(
    args: &args::Serve,
    machine: &MachineConfig,
) -> Result<CardSimulator<A>, NumberedError> {
    let spec = args.faults.as_deref().unwrap_or_default();
    let [up, down] = faults(spec).map_err(|why| serve_error(format!("--faults {spec}: {why}"), "use one of these"))?;
    let plant = PlantSettings {
        work: parsed_work(args.work.work.as_deref(), machine)?,
        step_wire: args.step_wire.map(|letter| step_wire(machine, letter)).transpose()?,
        ..hung_on::<A>(machine, &parsed_source_faults(args.source.source_faults.as_deref())?)
    };
    let settings = CardSimulatorSettings { up, down, machine: plant, serial: SERIAL, boot: linked_card::nonce() };
    let mut rig = CardSimulator::new(&settings)
        .ok_or_else(|| serve_error("the simulated card cannot be created", "please report this"))?;
    if let Some(path) = &args.vcd {
        let named = |error| unwritable(&path.display().to_string(), &error);
        let file = std::fs::File::create(path).map_err(named)?;
        let names: Vec<String> = machine.axes.iter().map(|axis| axis.name.to_string()).collect();
        rig.trace(Box::new(BufWriter::with_capacity(1 << 20, file)), &names).map_err(named)?;
    }
    Ok(rig)
}

/// A wire from the step output of an axis to the first analog input.
fn step_wire(machine: &MachineConfig, letter: char) -> Result<StepWire, NumberedError> {
    let axis = machine.axis_of(letter).and_then(|axis| u8::try_from(axis).ok());
    let axis =
        axis.ok_or_else(|| serve_error(format!("--step-wire {letter}: no such axis"), "an axis of the machine"))?;
    Ok(StepWire { axis, input: 0 })
}

/// Creates the symbolic link to the pseudo-terminal. Only a link is replaced.
fn create_link(pty: &Path, link: &Path) -> Result<(), NumberedError> {
    if link.is_symlink() {
        let _ = std::fs::remove_file(link);
    }
    std::os::unix::fs::symlink(pty, link)
        .map_err(|error| serve_error(format!("--link {}: {error}", link.display()), "give a name that does not exist"))
}

/// Conditions that end serving, and the input lines.
struct ServeEnd {
    after: Option<Duration>,
    at_eof: bool,
    lines: Receiver<String>,
    /// Whether the cable of the line is plugged in.
    is_plugged_in: Cell<bool>,
    /// Whether the card is switched on.
    is_powered: Cell<bool>,
}

impl ServeEnd {
    /// Whether bytes pass between host and card.
    const fn is_connected(&self) -> bool {
        self.is_plugged_in.get() && self.is_powered.get()
    }

    /// Switches the card off, which loses its state, or on: it starts as another boot, and without a position.
    fn set_power<const A: usize>(&self, rig: &mut CardSimulator<A>, is_on: bool) {
        if self.is_powered.replace(is_on) != is_on && !rig.restart(linked_card::nonce()) {
            eprintln!("the simulated card cannot be started again");
        }
    }

    /// Executes the lines from standard input. Returns whether serving ends.
    fn poll_end<const A: usize>(
        &self,
        started: Instant,
        rig: &mut CardSimulator<A>,
        inputs: DeclaredInputs<'_>,
    ) -> bool {
        let ended = loop {
            match self.lines.try_recv() {
                Ok(line) => match ManualInput::read(&line, inputs) {
                    Ok(Some(ManualInput::Cable { is_in })) => self.is_plugged_in.set(is_in),
                    Ok(Some(ManualInput::Power { is_on })) => self.set_power(rig, is_on),
                    Ok(deed) => deed.into_iter().for_each(|deed| deed.apply(rig)),
                    Err(why) => eprintln!("{why}"),
                },
                Err(TryRecvError::Empty) => break false,
                Err(TryRecvError::Disconnected) => break self.at_eof,
            }
        };
        ended || self.after.is_some_and(|after| started.elapsed() >= after)
    }
}

/// Lines of standard input until it ends; none unless `read`. A card in the background would be stopped for reading
/// from its terminal.
fn lines_of_input(read: bool) -> Receiver<String> {
    let (tell, lines) = channel();
    if !read {
        return lines;
    }
    let _ = std::thread::Builder::new().name("standard input".into()).spawn(move || {
        // Lines after the end of serving, and those that are not text, are dropped.
        for line in std::io::stdin().lines().map_while(Result::ok) {
            if tell.send(line).is_err() {
                return;
            }
        }
    });
    lines
}

/// Counters of a card that is served.
struct ServeCounters {
    pty: Pty,
    started: Instant,
    speed: f64,
    /// Time that was skipped, in microseconds of the card.
    away_us: u64,
    alarm: Option<Alarm>,
}

impl ServeCounters {
    fn run<const A: usize>(
        &mut self,
        rig: &mut CardSimulator<A>,
        end: &ServeEnd,
        inputs: DeclaredInputs<'_>,
    ) -> Result<(), NumberedError> {
        // Real-time scheduling makes this thread as prompt as a card, where it is permitted. Threads started earlier
        // keep their scheduling.
        let _ = retrace_real_time::lock_memory();
        let _ = retrace_real_time::enter();
        let mut bytes = [0; 4096];
        let mut flushed = Instant::now();
        while !end.poll_end(self.started, rig, inputs) {
            let due = rig.next_us().saturating_sub(self.now_us(rig)).min(WAIT_US);
            let wait = Duration::from_secs_f64(due as f64 / 1e6 / self.speed);
            let lost = |error| serve_error(format!("the pseudo-terminal failed: {error}"), "start the command again");
            let count = self.pty.read(&mut bytes, wait).map_err(lost)?;
            // The bytes arrived since the last poll; the card receives them from there on.
            if end.is_connected() {
                rig.send(&bytes[..count]);
            }
            rig.run(self.now_us(rig));
            loop {
                match rig.receive(&mut bytes) {
                    0 => break,
                    count if end.is_connected() => self.pty.write(&bytes[..count]).map_err(lost)?,
                    _ => {}
                }
            }
            self.print_alarm(rig);
            if flushed.elapsed() >= FLUSH {
                rig.flush();
                flushed = Instant::now();
            }
        }
        Ok(())
    }

    /// Current time of the card.
    fn now_us<const A: usize>(&mut self, rig: &CardSimulator<A>) -> u64 {
        let passed = (self.started.elapsed().as_secs_f64() * self.speed * 1e6) as u64;
        let late = passed.saturating_sub(self.away_us).saturating_sub(rig.now_us());
        let most = (MAX_CATCH_UP_US as f64 * self.speed.max(1.0)) as u64;
        self.away_us += late.saturating_sub(most);
        passed.saturating_sub(self.away_us)
    }

    /// Prints a new alarm.
    fn print_alarm<const A: usize>(&mut self, rig: &CardSimulator<A>) {
        let alarm = rig.status().alarm;
        if alarm != self.alarm {
            self.alarm = alarm;
            match alarm {
                Some(alarm) => eprintln!("alarm[{}]: {alarm}", alarm.number()),
                None => eprintln!("alarm cleared"),
            }
        }
    }
}

/// Counters as JSON.
fn counters_json<const A: usize>(rig: &CardSimulator<A>, served: &ServeCounters) -> Value {
    let [up, down] = rig.lines().map(|line| line_counters_json(line.counters()));
    let (pins, status, faults) = (rig.pins(), rig.status(), rig.faults());
    json!({
        "periods": status.period,
        "away_s": served.away_us as f64 / 1e6,
        "place": status.place.record.number(),
        "at_rest": status.at_rest,
        "counts": status.counts.as_slice(),
        "counted": pins.positions().as_slice(),
        "pulses": pins.pulses().as_slice(),
        "periods_apart": faults.count_mismatches,
        "periods_too_fast": faults.overfull_periods,
        "alarm": status.alarm.map(|alarm| alarm.number()),
        "unread_bytes": served.pty.dropped(),
        "up": up,
        "down": down,
    })
}

fn line_counters_json(of: &LineCounters) -> Value {
    json!({
        "sent": of.sent,
        "delivered": of.delivered,
        "flipped": of.flipped,
        "dropped": of.dropped,
        "duplicated": of.duplicated,
        "cuts": of.cuts,
        "cut": of.cut,
        "stalls": of.stalls,
        "lost_in_stalls": of.stalled,
    })
}
