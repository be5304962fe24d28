//! Bytes that were recorded on the serial line and replayed: they move nothing and end nothing.
//!
//! Invariant: the recording is of the bytes themselves, as an eavesdropper would have them.

use std::sync::{Arc, Mutex};

use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Flags, Place, Rate, Record, RecordIndex};
use retrace_hal_sim::{CardSimulator, CardSimulatorSettings, InProcess, NoFault};
use retrace_link::{
    BytePort, CardSettings, HostCommand, LinkTimeouts, LinkedCard, MotionCard, OutputChange, PathStart,
};

/// Bytes that were sent over the line, and those that were received.
#[derive(Clone, Debug, Default)]
struct Recording {
    sent: Vec<u8>,
    keep_alive: Vec<u8>,
    injected: Vec<u8>,
}

/// A port that records.
#[derive(Debug)]
struct Recorder {
    inner: InProcess<3>,
    tape: Arc<Mutex<Recording>>,
}

impl BytePort for Recorder {
    type Fault = NoFault;

    fn now_us(&self) -> u64 {
        self.inner.now_us()
    }

    fn writable_bytes(&mut self) -> usize {
        self.inner.writable_bytes()
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, NoFault> {
        let count = self.inner.write(bytes)?;
        self.tape.lock().expect("whole").sent.extend_from_slice(&bytes[..count]);
        Ok(count)
    }

    fn read(&mut self, bytes: &mut [u8], wait_us: u32) -> Result<usize, NoFault> {
        let mut tape = self.tape.lock().expect("whole");
        if !tape.injected.is_empty() {
            let count = tape.injected.len().min(bytes.len());
            bytes[..count].copy_from_slice(&tape.injected[..count]);
            tape.injected.drain(..count);
            return Ok(count);
        }
        let count = self.inner.read(bytes, wait_us)?;
        tape.keep_alive.extend_from_slice(&bytes[..count]);
        Ok(count)
    }
}

type Host = LinkedCard<3, Recorder>;

fn rig(boot: u32) -> CardSimulator<3> {
    CardSimulator::new(&CardSimulatorSettings { boot, ..CardSimulatorSettings::default() }).expect("a card")
}

fn find(rig: CardSimulator<3>, nonce: u32) -> (Host, Arc<Mutex<Recording>>) {
    let tape = Arc::new(Mutex::new(Recording::default()));
    let port = Recorder { inner: InProcess::new(rig), tape: Arc::clone(&tape) };
    (Host::connect(port, nonce, LinkTimeouts::default()).expect("a card answers"), tape)
}

fn open(host: &mut Host) {
    let axis = PulseLimits { velocity: 200 << 32, acceleration: 12 << 32, jerk: 1 << 32 };
    let limits = RateLimits::new(13, 1 << 15, [axis; 3]).expect("valid");
    host.open(CardSettings::new(0, PathStart::at(RecordIndex::new(0)), 1000, limits)).expect("it takes the settings");
}

/// Output 3 on, and 300 records forward.
fn run(host: &mut Host) {
    host.send(HostCommand::ManualOutput(OutputChange { channel: 3, value: 1 })).expect("room");
    host.send(HostCommand::rate(Rate::ONE)).expect("a rate");
    while host.status().place != Place::start_of(RecordIndex::new(300)) {
        while host.status().high.number() < 300 {
            let place = host.status().high;
            let flags = if place == RecordIndex::new(299) { Flags::REST } else { Flags::NONE };
            let record = Record { increments: [7, -3, 1], flags, line: place.number(), ..Record::default() };
            if host.send(HostCommand::Ahead { place, record }).is_err() {
                break;
            }
        }
        host.run_period().expect("no fault");
    }
}

const END: [i64; 3] = [2100, -900, 300];

/// A whole session, and its recording. The output is off at its end.
fn session(boot: u32) -> (CardSimulator<3>, Recording) {
    let (mut host, tape) = find(rig(boot), 7);
    open(&mut host);
    run(&mut host);
    host.send(HostCommand::ManualOutput(OutputChange { channel: 3, value: 0 })).expect("room");
    while host.run_period().expect("no fault").outputs[3] != 0 {}
    host.close().expect("it stands");
    let rig = host.into_port().inner.into_simulator();
    assert_eq!((rig.pins().positions(), rig.status().outputs[3]), (&END, 0));
    let tape = tape.lock().expect("whole").clone();
    (rig, tape)
}

/// Sends these bytes to a card, as fast as its line permits; returns whether any output was on meanwhile.
fn say(rig: &mut CardSimulator<3>, bytes: &[u8]) -> bool {
    let mut lit = false;
    for chunk in bytes.chunks(20) {
        rig.send(chunk);
        rig.run(rig.now_us() + 1000);
        lit |= rig.status().outputs[3] != 0;
    }
    rig.run(rig.now_us() + 1_000_000);
    lit
}

#[test]
fn a_recorded_session_moves_nothing_after_a_restart_of_the_card() {
    let (_, tape) = session(1);
    // the same start: the recording does move a machine
    let mut same = rig(1);
    assert!(say(&mut same, &tape.sent));
    assert_ne!(same.pins().pulses(), &[0; 3]);
    let mut restarted = rig(2);
    assert!(!say(&mut restarted, &tape.sent));
    assert_eq!((restarted.pins().pulses(), restarted.status().counts), (&[0; 3], [0; 3]));
}

#[test]
fn a_recorded_session_moves_nothing_within_the_same_start() {
    let (mut rig, tape) = session(1);
    let pulses = *rig.pins().pulses();
    assert!(!say(&mut rig, &tape.sent));
    assert_eq!((rig.pins().pulses(), rig.pins().positions()), (&pulses, &END));
    // and in another epoch
    let (mut host, _) = find(rig, 8);
    open(&mut host);
    let mut rig = host.into_port().inner.into_simulator();
    assert!(!say(&mut rig, &tape.sent));
    assert_eq!((rig.pins().pulses(), rig.pins().positions()), (&pulses, &END));
}

#[test]
fn a_replayed_opening_is_no_sign_of_life() {
    let (mut host, tape) = find(rig(1), 7);
    open(&mut host);
    host.send(HostCommand::rate(Rate::ONE)).expect("a rate");
    for _ in 0..50 {
        host.run_period().expect("no fault");
    }
    let sent = tape.lock().expect("whole").sent.clone();
    let opening = sent.split_inclusive(|&byte| byte == 0).find(|frame| frame.len() > 60).expect("an opening");
    let mut rig = host.into_port().inner.into_simulator();
    for _ in 0..40 {
        rig.send(opening);
        rig.run(rig.now_us() + 10_000);
    }
    assert!(rig.status().alarm.is_some(), "the host is silent");
}

#[test]
fn replayed_greetings_and_reports_change_nothing_of_a_running_job() {
    let (rig_of_session, old) = session(1);
    let (mut host, tape) = find(rig_of_session, 9);
    let greetings = tape.lock().expect("whole").keep_alive.clone();
    open(&mut host);
    let base = host.status().counts;
    host.send(HostCommand::rate(Rate::ONE)).expect("a rate");
    for round in 0..20 {
        tape.lock().expect("whole").injected.extend([&[0], &greetings[..], &old.keep_alive, &[0]].concat());
        for _ in 0..10 {
            let place = host.status().high;
            let record = Record { increments: [round, -3, 1], line: place.number(), ..Record::default() };
            let _ = host.send(HostCommand::Ahead { place, record });
            host.run_period().expect("a recording ends nothing");
        }
    }
    run(&mut host);
    let counts = host.status().counts;
    let rig = host.into_port().inner.into_simulator();
    assert_eq!(*rig.pins().positions(), counts);
    assert_ne!(counts, base);
}
