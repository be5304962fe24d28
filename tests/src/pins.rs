//! A card's trace, period by period: outputs, place, rate, rest, and the executed line.
//!
//! Invariant: a sample has the values of the trace at one moment, and nothing that was derived elsewhere.

use crate::command::Bench;
use crate::run::Run;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// Values of the trace from a moment on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sample {
    /// The moment, in microseconds of the card's time.
    pub at_us: u64,
    /// Program line.
    pub line: u64,
    /// Place on the path, in records.
    pub place: f64,
    /// Rate of the last control period.
    pub rate: f64,
    /// Whether the machine is at rest.
    pub at_rest: bool,
    /// Values of the outputs that are not 0, by name: `out3`, `spindle` …
    pub outputs: BTreeMap<String, u64>,
    /// Code of the latched alarm, 0 for none.
    pub alarm: u64,
    /// Active inputs, one bit each.
    pub inputs: u64,
    /// Counts of the first three axes.
    pub counts: [i64; 3],
    /// Layer of the tool axis, in pulses.
    pub layer: i64,
    /// Power of a beam, in thousandths of S.
    pub beam_power: f64,
}

impl Sample {
    /// Whether this output is on.
    #[must_use]
    pub fn is_on(&self, output: &str) -> bool {
        self.outputs.contains_key(output)
    }
}

/// Reads a trace: a sample for each moment at which something but the step wires changed.
///
/// # Panics
/// Where the file cannot be read.
#[must_use]
pub fn samples(path: &Path) -> Vec<Sample> {
    let text = fs::read_to_string(path).expect("the trace");
    let mut names = BTreeMap::new();
    let (mut samples, mut now, mut changed) = (Vec::new(), Sample::default(), false);
    let mut scope = String::new();
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["$scope", _, name, "$end"] => scope = name.to_owned(),
            ["$var", _, _, code, name, "$end"] if matches!(&*scope, "card" | "outputs") || name == "count" => {
                names.insert(code.to_owned(), (scope.clone(), name.to_owned()));
            }
            _ => {}
        }
        if let Some(at) = line.strip_prefix('#').and_then(|at| at.parse::<u64>().ok()) {
            if std::mem::take(&mut changed) {
                samples.push(now.clone());
            }
            now.at_us = at / 1000;
        } else if let Some((value, code)) = value_of(line)
            && let Some((scope, name)) = names.get(code)
        {
            changed = true;
            set(&mut now, scope, name, value);
        }
    }
    if changed {
        samples.push(now);
    }
    samples
}

/// Asserts of a trace with control periods of 1 ms that the step wires of this axis have made its count and the layer,
/// in every period. Returns the number of periods that were compared.
///
/// # Panics
/// At the first period in which they have not, or where the file cannot be read.
pub fn assert_steps_are_path_and_layer(path: &Path, axis: &str) -> usize {
    let text = fs::read_to_string(path).expect("the trace");
    let mut codes = BTreeMap::new();
    let (mut scope, mut compared) = (String::new(), 0);
    // Of the wires, and as the card reports it; whether the wire says backward.
    let (mut made, mut reported, mut is_backward) = (0_i64, [0_i64; 2], false);
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["$scope", _, name, "$end"] => scope = name.to_owned(),
            ["$var", _, _, code, name, "$end"] if scope == axis || name == "layer" => {
                codes.insert(code.to_owned(), name.to_owned());
            }
            _ => {}
        }
        if let Some(at) = line.strip_prefix('#').and_then(|at| at.parse::<u64>().ok()) {
            if at % 1_000_000 == 0 {
                assert_eq!(made, reported[0] + reported[1], "{axis} at {} ms", at / 1_000_000);
                compared += 1;
            }
            continue;
        }
        let Some((value, code)) = value_of(line) else { continue };
        match codes.get(code).map(String::as_str) {
            Some("step") if value != 0.0 => made += if is_backward { -1 } else { 1 },
            Some("backward") => is_backward = value != 0.0,
            Some("count") => reported[0] = value as i64,
            Some("layer") => reported[1] = value as i64,
            _ => {}
        }
    }
    compared
}

fn set(now: &mut Sample, scope: &str, name: &str, value: f64) {
    match (scope, name) {
        ("outputs", _) if value == 0.0 => {
            now.outputs.remove(name);
        }
        ("outputs", _) => {
            now.outputs.insert(name.to_owned(), value as u64);
        }
        ("x", _) => now.counts[0] = value as i64,
        ("y", _) => now.counts[1] = value as i64,
        ("z", _) => now.counts[2] = value as i64,
        (_, "inputs") => now.inputs = value as u64,
        (_, "place") => now.place = value,
        (_, "rate") => now.rate = value,
        (_, "beam_power") => now.beam_power = value,
        (_, "layer") => now.layer = value as i64,
        (_, "line") => now.line = value as u64,
        (_, "at_rest") => now.at_rest = value != 0.0,
        (_, "alarm") => now.alarm = value as u64,
        _ => {}
    }
}

/// A change of a value, and the code of its signal.
fn value_of(line: &str) -> Option<(f64, &str)> {
    let (kind, rest) = line.split_at_checked(1)?;
    match kind {
        "0" => Some((0.0, rest)),
        "1" => Some((1.0, rest)),
        "b" => {
            let (bits, code) = rest.split_once(' ')?;
            // a negative number is written with all of its 64 bits
            Some((u64::from_str_radix(bits, 2).ok()?.cast_signed() as f64, code))
        }
        "r" => {
            let (number, code) = rest.split_once(' ')?;
            Some((number.parse().ok()?, code))
        }
        _ => None,
    }
}

/// A run on the simulated card with this machine file, program, script of an operator and further arguments, and the
/// trace of its pins.
#[must_use]
pub fn run_with_pins(machine: &str, program: &str, script: &str, more: &[&str]) -> (Run, Vec<Sample>) {
    let bench = Bench::new();
    let program = bench.file("part.ngc", program);
    let (machine, vcd) = (bench.file("m.toml", machine).display().to_string(), bench.path("pins.vcd"));
    let (operator, trace) = (bench.file("s.op", script).display().to_string(), vcd.display().to_string());
    let mut arguments = vec!["--machine", &machine, "--vcd", &trace];
    if !script.is_empty() {
        arguments.extend(["--operator", &operator]);
    }
    arguments.extend(more);
    let run = Run::of(&bench, &program, &arguments);
    (run, samples(&vcd))
}
