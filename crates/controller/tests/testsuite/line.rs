//! A serial line with every kind of fault: none of them loses a pulse, adds one, or leaves the machine running.

use crate::wired;
use retrace_core::Rate;

use retrace_config::MachineConfig;
use retrace_controller::Outcome;
use retrace_hal_sim::{
    CardSimulatorSettings, Chance, FaultRates, InFlightPolicy, LineFault, Random, SerialChannelSettings,
};
use wired::{Path, Trial, ended_well, good_line, on_the_path, pick, program, run, script};

/// Number of cases, and the seed of the first: `cargo xtask campaign line`.
fn asked(usual: u64) -> (u64, u64) {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse().ok());
    (number("RETRACE_CASES").unwrap_or(usual), number("RETRACE_FIRST_SEED").unwrap_or(1))
}

/// A serial line with a random fault rate per byte from 1e-6 to 1e-2, all kinds equally likely, some of the stalls
/// longer than the watchdog.
fn bad_line(random: &mut Random, baud: u32, exponent: f64) -> SerialChannelSettings {
    let chance = Chance::new(10f64.powf(exponent) / 5.0).expect("a probability");
    let stall_us = pick(random, &[2_000, 20_000, 100_000, 400_000]);
    let rates = FaultRates { stall_us, ..FaultRates::all(chance) };
    SerialChannelSettings {
        baud,
        latency_us: random.up_to(2000),
        jitter_us: random.up_to(3000),
        rates,
        script: Vec::new(),
        seed: random.next(),
    }
}

#[test]
fn whatever_the_line_does_a_job_ends_exactly_or_in_a_latched_alarm() {
    let (cases, first) = asked(12);
    let machine = MachineConfig::built_in().expect("valid");
    let (mut completed, mut alarms, mut not_opened, mut faults) = (0, 0, 0, 0);
    for seed in first..first + cases {
        let mut random = Random::new(seed);
        let program = program(&mut random, 12);
        let script = script(&mut random);
        let baud = pick(&mut random, &[230_400, 460_800, 1_000_000]);
        let exponent = -6.0 + f64::from(random.up_to(4000)) / 1000.0;
        let (up, down) = (bad_line(&mut random, baud, exponent), bad_line(&mut random, baud, exponent));
        let mut pulled = Vec::new();
        for _ in 0..random.up_to(6).saturating_sub(3) {
            let leftover = if random.up_to(1) == 0 {
                InFlightPolicy::Lost
            } else {
                InFlightPolicy::Late { us: random.up_to(30_000) }
            };
            pulled.push((u64::from(random.up_to(3_000_000)), leftover));
        }
        let path = Path::of(&machine, &program);
        let rig = CardSimulatorSettings { up, down, ..CardSimulatorSettings::default() };
        let trial = Trial { machine: &machine, program: &program, script: &script, rig, pulled, tapped: false };
        match run(trial) {
            Ok(done) => {
                if let Err(what) = ended_well(&path, &done) {
                    panic!("seed {seed}, 10^{exponent} a byte: {what}\n{program}\n{script}\n{:?}", done.events);
                }
                assert_eq!(done.violations, 0, "seed {seed}: {}", done.first_violation);
                let lines = done.cable.port.simulator().lines();
                faults += lines.iter().map(|line| line.counters().faults()).sum::<u64>();
                if done.completed() { completed += 1 } else { alarms += 1 }
            }
            Err(_) => not_opened += 1,
        }
    }
    println!(
        "{completed} completed exactly, {alarms} ended in an alarm, {not_opened} could not be opened; {faults} faults"
    );
    assert!(completed > cases / 4 && faults > 0);
}

const SHORT: &str = "G21 G90 G64 P0.05\nF3000\nG1 X1\nM3\nG1 Y1\nM62 P3\nX0\nM2\n";

/// Beginnings of the frames of a stream, and the end of the last one.
fn frames(bytes: &[u8]) -> Vec<u64> {
    let ends = bytes.iter().enumerate().filter(|(_, byte)| **byte == 0).map(|(at, _)| at as u64 + 1);
    std::iter::once(0).chain(ends).collect()
}

#[test]
fn every_single_fault_at_every_frame_of_a_short_run() {
    let machine = MachineConfig::built_in().expect("valid");
    let path = Path::of(&machine, SHORT);
    let script = "at 0.1s reverse 100%\nafter 0.08s leave\n";
    let line = || good_line(460_800);
    let trial = |up: SerialChannelSettings, down: SerialChannelSettings, tapped: bool| {
        let rig = CardSimulatorSettings { up, down, ..CardSimulatorSettings::default() };
        run(Trial { machine: &machine, program: SHORT, script, rig, pulled: Vec::new(), tapped }).expect("opened")
    };
    let clean = trial(line(), line(), true);
    assert_eq!((&clean.outcome, clean.underruns), (&Outcome::Completed, 0));
    let taps = clean.cable.taps.as_ref().expect("tapped");
    let streams = [frames(&taps[0]), frames(&taps[1])];
    // The full campaign takes every frame; the suite takes every n-th. A random start would not be repeatable.
    let step = if std::env::var_os("RETRACE_CASES").is_some() { 1 } else { 29 };
    let (mut runs, mut alarms) = (0, 0);
    for (direction, frames) in streams.iter().enumerate() {
        for bounds in frames.windows(2).step_by(step) {
            let (begin, last) = (bounds[0], bounds[1] - 1);
            let middle = begin.midpoint(last);
            let faults = [
                (begin, LineFault::Flip { bit: 0 }),
                (middle, LineFault::Flip { bit: 7 }),
                (last, LineFault::Flip { bit: 3 }),
                (begin, LineFault::Drop),
                (last, LineFault::Drop),
                (middle, LineFault::Duplicate),
                (last, LineFault::Duplicate),
                (begin, LineFault::Cut { bytes: (last - begin + 1) as u32 }),
                (middle, LineFault::Cut { bytes: 40 }),
                (begin, LineFault::Stall { us: 30_000, lost: false }),
                (middle, LineFault::Stall { us: 30_000, lost: true }),
                (middle, LineFault::Stall { us: 400_000, lost: true }),
            ];
            for (at, fault) in faults {
                let mut lines = [line(), line()];
                lines[direction].script = vec![(at, fault)];
                let [up, down] = lines;
                let done = trial(up, down, false);
                runs += 1;
                alarms += u64::from(!done.completed());
                if let Err(what) = ended_well(&path, &done) {
                    panic!("direction {direction}, byte {at}, {fault:?}: {what}\n{:?}", done.events);
                }
                let long = matches!(fault, LineFault::Stall { us: 400_000, .. });
                assert!(long || done.completed(), "direction {direction}, byte {at}, {fault:?}: {:?}", done.outcome);
            }
        }
    }
    println!("{runs} runs with one fault each, {alarms} ended in an alarm");
}

#[test]
fn a_host_that_dies_leaves_the_machine_at_rest_on_the_path() {
    let machine = MachineConfig::parse("cutting_outputs = [3]\n", "m").expect("valid");
    let program = "G21 G90 G64 P0.05\nF6000\nM64 P3\nG1 X40\nY10\nX0\nM2\n";
    let path = Path::of(&machine, program);
    for at_us in [400_000u64, 700_000, 1_000_000] {
        // From then on no bytes of the host arrive.
        let byte_us = 10_000_000 / 1_000_000;
        let mut up = good_line(1_000_000);
        up.script = vec![((at_us / byte_us) / 25, LineFault::Stall { us: 60_000_000, lost: true })];
        let rig = CardSimulatorSettings { up, down: good_line(1_000_000), ..CardSimulatorSettings::default() };
        let script = "";
        let done =
            run(Trial { machine: &machine, program, script, rig, pulled: Vec::new(), tapped: false }).expect("opened");
        on_the_path(&path, &done).expect("on the path");
        let silent = done.log.iter().position(|period| period.alarm).expect("the card noticed");
        let (at, rest) = (&done.log[silent], done.log[silent..].iter().position(|period| period.at_rest));
        assert_ne!(at.rate, Rate::ZERO, "it was in motion");
        let rest = rest.expect("it came to rest");
        assert!(rest <= 300, "{rest} periods");
        assert_eq!((done.log[silent - 1].outputs[3], at.outputs[3]), (1, 0), "the jet is off");
        assert!(matches!(&done.outcome, Outcome::Alarm("E3011", ..)), "{:?}", done.outcome);
    }
}
