//! A port to an emulated Pico, in the time of its chip: it takes bytes before one control period after the other.
//!
//! Invariant: what the card was given before each period is recorded, and so is what its pins did.

use std::collections::VecDeque;
use std::fmt;
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use retrace_hal_sim::Random;
use retrace_link::{BytePort, CardFailure};
use serde_json::{Value, json};

/// Axes of the card.
pub(super) const AXES: usize = 4;
/// Bytes that the card takes before a period: as many as a line of 1 Mbaud carries in 1 ms.
const BYTES: usize = 100;
/// Period from which on the handwheel is turned: counts before the path of a job begins are not reported.
const HAND_FROM: usize = 300;
/// Levels of the card's inputs while every contact is open.
const OPEN_CONTACTS: u16 = 0x3f;

/// What the card is given before a period.
#[derive(Clone, Debug, Default)]
pub(super) struct Given {
    pub bytes: Vec<u8>,
    /// Levels of the inputs.
    pub inputs: u16,
    /// Counts by which the handwheel's encoder turns.
    pub steps: i16,
    /// Levels of the output pins after that period.
    pub outputs: u16,
    /// Last cycle of the output for S before them: clock cycles that it was high, and in all.
    pub pwm: [u64; 2],
}

/// What is done to the card besides the line.
#[derive(Clone, Debug, Default)]
pub(super) struct Surroundings {
    /// A switch at input 0, to ground: it is closed while the axis is below this count.
    pub switch: Option<(usize, i64)>,
    /// Period from which on input 1 is closed.
    pub trips_at: Option<usize>,
    /// Period from which on nothing of the host arrives.
    pub dies_at: Option<usize>,
}

/// A port to an emulated Pico.
pub(super) struct PicoPort {
    child: Child,
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
    now_us: u64,
    outgoing: VecDeque<u8>,
    incoming: VecDeque<u8>,
    around: Surroundings,
    /// Turns the handwheel's encoder.
    pub hand: Option<Random>,
    /// Counts by which the hand turns at present.
    turning: i16,
    /// Pulses counted at the pins.
    positions: [i64; AXES],
    pub given: Vec<Given>,
    /// Net pulses at the pins in every period that has ended.
    pub nets: Vec<[i64; AXES]>,
}

impl PicoPort {
    /// Starts the emulator: `RETRACE_PICO` has the script, the image, and the folder of rp2040js, between commas.
    pub(super) fn start(around: Surroundings) -> Self {
        let named = std::env::var("RETRACE_PICO").expect("cargo xtask firmware test, or campaign pico");
        let [script, image, rp2040js]: [&str; 3] = named.split(',').collect::<Vec<_>>().try_into().expect("three");
        let mut command = Command::new("node");
        command.args([script, image]).env("RETRACE_RP2040JS", rp2040js);
        let mut child =
            command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("node");
        let (input, output) = (child.stdin.take(), BufReader::new(child.stdout.take().expect("piped")));
        Self {
            child,
            input,
            output,
            now_us: 0,
            outgoing: VecDeque::new(),
            incoming: VecDeque::new(),
            around,
            hand: None,
            turning: 0,
            positions: [0; AXES],
            given: Vec::new(),
            nets: Vec::new(),
        }
    }

    /// Runs a control period of the card.
    pub(super) fn step(&mut self) {
        let steps = self.turn();
        let is_dead = self.around.dies_at.is_some_and(|at| self.given.len() >= at);
        let mut bytes: Vec<u8> = self.outgoing.drain(..self.outgoing.len().min(BYTES)).collect();
        if is_dead {
            bytes.clear();
        }
        let inputs = self.inputs();
        let input = self.input.as_mut().expect("it runs");
        writeln!(input, "{}", json!({"bytes": bytes, "inputs": inputs, "steps": steps})).expect("a request");
        let mut line = String::new();
        self.output.read_line(&mut line).expect("an answer");
        let answer: Value = serde_json::from_str(&line).unwrap_or_else(|_| panic!("{}", self.errors()));
        self.now_us = answer["us"].as_u64().expect("a time");
        for byte in answer["bytes"].as_array().into_iter().flatten().filter(|_| !is_dead) {
            self.incoming.push_back(byte.as_u64().expect("a byte") as u8);
        }
        for net in answer["nets"].as_array().into_iter().flatten() {
            let net = std::array::from_fn(|axis| net[axis].as_i64().expect("a count"));
            self.positions = std::array::from_fn(|axis| self.positions[axis] + net[axis]);
            self.nets.push(net);
        }
        if answer["computed"] == true {
            let outputs = answer["outputs"].as_u64().expect("levels") as u16;
            let pwm = [0, 1].map(|at| answer["pwm"][at].as_u64().expect("a cycle"));
            self.given.push(Given { bytes, inputs, steps, outputs, pwm });
        }
    }

    /// Pulses counted at the pins since the start.
    pub(super) fn positions(&self) -> [i64; AXES] {
        self.positions
    }

    fn inputs(&self) -> u16 {
        let mut levels = OPEN_CONTACTS;
        if self.around.switch.is_some_and(|(axis, at)| self.positions[axis] < at) {
            levels &= !1;
        }
        if self.around.trips_at.is_some_and(|at| self.given.len() >= at) {
            levels &= !2;
        }
        levels
    }

    /// Turns the encoder: in bursts, and to and fro.
    fn turn(&mut self) -> i16 {
        let Some(hand) = self.hand.as_mut().filter(|_| self.given.len() >= HAND_FROM) else { return 0 };
        if hand.up_to(40) == 0 {
            self.turning = hand.up_to(8) as i16 - 4;
        }
        if hand.up_to(2) == 0 { self.turning } else { 0 }
    }

    /// Ends the run, and returns what the emulator has seen.
    pub(super) fn finish(mut self) -> (Value, Vec<Given>, Vec<[i64; AXES]>) {
        self.input = None;
        let report = self.errors();
        let found = serde_json::from_str(report.lines().next_back().unwrap_or_default());
        let (given, nets) = (std::mem::take(&mut self.given), std::mem::take(&mut self.nets));
        (found.unwrap_or_else(|_| panic!("{report}")), given, nets)
    }

    fn errors(&mut self) -> String {
        let mut text = String::new();
        if let Some(errors) = &mut self.child.stderr {
            // what was read before a fault is all there is
            let _ = std::io::Read::read_to_string(errors, &mut text);
        }
        text
    }
}

impl Drop for PicoPort {
    fn drop(&mut self) {
        // it may have ended by itself
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Error of such a port, which never occurs: a fault of the emulator ends the test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NoFault {}

impl fmt::Display for NoFault {
    fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {}
    }
}

impl CardFailure for NoFault {
    fn number(&self) -> &'static str {
        match *self {}
    }

    fn remedy(&self) -> &'static str {
        match *self {}
    }
}

impl BytePort for PicoPort {
    type Fault = NoFault;

    fn now_us(&self) -> u64 {
        self.now_us
    }

    fn writable_bytes(&mut self) -> usize {
        (4 * BYTES).saturating_sub(self.outgoing.len())
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, NoFault> {
        let count = bytes.len().min(self.writable_bytes());
        self.outgoing.extend(&bytes[..count]);
        Ok(count)
    }

    fn read(&mut self, bytes: &mut [u8], wait_us: u32) -> Result<usize, NoFault> {
        let until = self.now_us + u64::from(wait_us);
        while self.incoming.is_empty() && self.now_us < until {
            self.step();
        }
        let count = bytes.len().min(self.incoming.len());
        for (to, byte) in bytes.iter_mut().zip(self.incoming.drain(..count)) {
            *to = byte;
        }
        Ok(count)
    }
}
