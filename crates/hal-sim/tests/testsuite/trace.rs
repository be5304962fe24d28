//! The trace of a run, read back like a wave viewer does: its edges are the pulses, and they observe their times.

use std::collections::HashMap;
use std::io::{self, Write};
use std::sync::{Arc, Mutex};

use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Flags, Rate, Record, RecordIndex};
use retrace_hal_sim::{CardSimulator, CardSimulatorSettings, InProcess};
use retrace_link::{
    CardSettings, CuttingChannel, CuttingSettings, HostCommand, Instruction, LinkTimeouts, LinkedCard, MotionCard,
    OutputChange, PathStart, channel,
};

/// A file in memory.
#[derive(Clone, Default)]
struct Shared(Arc<Mutex<Vec<u8>>>);

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().expect("whole").extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// All changes of each signal, by its full name: time in nanoseconds, and value as written.
fn read(text: &str) -> HashMap<String, Vec<(u64, String)>> {
    let (mut scopes, mut names, mut changes) = (Vec::new(), HashMap::new(), HashMap::new());
    let (head, body) = text.split_once("$enddefinitions $end").expect("declarations");
    for line in head.lines() {
        match *line.split_whitespace().collect::<Vec<_>>() {
            ["$scope", "module", name, "$end"] => scopes.push(name),
            ["$upscope", "$end"] => drop(scopes.pop().expect("open")),
            ["$var", _, _, code, name, "$end"] => {
                let path = format!("{}.{name}", scopes.join("."));
                assert!(names.insert(code, path).is_none(), "{code} is declared twice");
            }
            _ => assert!(line.is_empty() || line.starts_with("$version") || line == "$timescale 1 ns $end", "{line}"),
        }
    }
    let mut now = None;
    for line in body.lines().filter(|line| !line.is_empty()) {
        if let Some(time) = line.strip_prefix('#') {
            let time: u64 = time.parse().expect("a time");
            assert!(now.is_none_or(|now| now < time), "time goes on");
            now = Some(time);
            continue;
        }
        let (value, code) = match line.split_once(' ') {
            Some(vector) => vector,
            None => line.split_at(1),
        };
        let name = names.get(code).expect("declared").clone();
        changes.entry(name).or_insert_with(Vec::new).push((now.expect("a time first"), value.to_owned()));
    }
    changes
}

/// 60 periods forward, 60 back at full rate, and the spindle on in the middle of it.
fn traced() -> (String, [u64; 2]) {
    let file = Shared::default();
    let mut rig = CardSimulator::<2>::new(&CardSimulatorSettings::default()).expect("a card");
    rig.trace(Box::new(file.clone()), &["x".to_owned(), "y".to_owned()]).expect("memory");
    let mut host = LinkedCard::connect(InProcess::new(rig), 7, LinkTimeouts::default()).expect("a card answers");
    host.open(CardSettings::new(0, PathStart::at(RecordIndex::new(0)), 1000, limits())).expect("it takes the settings");
    for place in 0..60u32 {
        let flags = if place == 59 { Flags::REST } else { Flags::NONE };
        let record = Record { increments: [5, -((place % 9) as i16)], flags, line: place, ..Record::default() };
        host.send(HostCommand::Ahead { place: RecordIndex::new(place), record }).expect("room");
    }
    for (target, end) in [(Rate::ONE, 60), (-Rate::ONE, 0)] {
        host.send(HostCommand::rate(target)).expect("a rate");
        while host.run_period().is_ok_and(|status| status.place.record != RecordIndex::new(end) || !status.at_rest) {}
        host.send(HostCommand::ManualOutput(OutputChange { channel: channel::SPINDLE, value: -1 })).expect("a channel");
    }
    let rig = host.port().simulator();
    assert_eq!((rig.status().counts, rig.pins().positions()), ([0, 0], &[0, 0]));
    let pulses = *rig.pins().pulses();
    let text = String::from_utf8(file.0.lock().expect("whole").clone()).expect("text");
    (text, pulses)
}

#[test]
fn the_edges_of_the_trace_are_the_pulses() {
    let (text, pulses) = traced();
    let changes = read(&text);
    let of = |name: &str| &changes[name];
    assert_eq!(pulses, [600, 2 * (0..60u64).map(|n| n % 9).sum::<u64>()]);
    for (axis, pulses) in ["x", "y"].into_iter().zip(pulses) {
        let step = of(&format!("{axis}.step"));
        let (mut rises, mut high) = (Vec::new(), None);
        for (at, value) in step {
            match (value.as_str(), high) {
                ("1", None) => {
                    rises.push(*at);
                    high = Some(*at);
                }
                ("0", Some(rose)) => {
                    assert_eq!(at - rose, 2000, "a pulse of 2 µs");
                    high = None;
                }
                ("0", None) if *at == 0 => {}
                other => panic!("{other:?} at {at}"),
            }
        }
        assert_eq!((rises.len() as u64, high), (pulses, None));
        // each rising edge counts up or down with the direction wire, which has been stable for 5 µs
        let turns = of(&format!("{axis}.backward"));
        let net: i64 = rises
            .iter()
            .map(|&rise| {
                let (turned, value) = turns.iter().rev().find(|(at, _)| *at <= rise).expect("from the start on");
                assert!(*turned == 0 || rise - turned >= 5000, "{rise} after {turned}");
                if value == "1" { -1 } else { 1 }
            })
            .sum();
        assert_eq!(net, 0);
    }
    let x = of("x.step");
    let gaps: Vec<u64> = x.windows(3).filter(|w| w[0].1 == "1" && w[2].1 == "1").map(|w| w[2].0 - w[0].0).collect();
    assert!(gaps.iter().filter(|&&gap| gap == 200_000).count() > 500, "five pulses in a millisecond are 200 µs apart");
    let values = |name: &str| of(name).iter().map(|(_, value)| value.clone()).collect::<Vec<_>>();
    assert_eq!(values("outputs.spindle"), ["b0", "b11111111111111111111111111111111"]);
    assert_eq!(values("card.rate"), ["r0", "r1", "r0", "r-1", "r0"]);
    assert_eq!(values("card.alarm"), ["b0"]);
}

/// A torch without a grace time, lit by the first instruction, and a path that runs for a second. Returns the signals
/// of the pins from when `stops` has had the host to half a second later.
fn torch(stops: impl Fn(&mut LinkedCard<2, InProcess<2>>)) -> HashMap<String, Vec<(u64, String)>> {
    let file = Shared::default();
    let mut rig = CardSimulator::<2>::new(&CardSimulatorSettings::default()).expect("a card");
    rig.trace(Box::new(file.clone()), &["x".to_owned(), "y".to_owned()]).expect("memory");
    let mut host = LinkedCard::connect(InProcess::new(rig), 7, LinkTimeouts::default()).expect("a card answers");
    let mut settings = CardSettings::new(0, PathStart::at(RecordIndex::new(0)), 1000, limits());
    settings.watchdog_periods = 100;
    let torch = CuttingChannel { channel: channel::SPINDLE, fires: true, ..CuttingChannel::default() };
    settings.cutting = CuttingSettings { count: 1, handover_periods: 100, ..CuttingSettings::default() };
    settings.cutting.channels[0] = torch;
    host.open(settings).expect("it takes the settings");
    let mut instruction =
        Instruction { number: 1, count: 1, periods: 20, keeps_cutter: true, ..Instruction::default() };
    instruction.changes[0] = OutputChange { channel: channel::SPINDLE, value: 1 };
    host.send(HostCommand::rate(Rate::ONE)).expect("a rate");
    host.send(HostCommand::Instruction(instruction)).expect("room");
    while host.run_period().is_ok_and(|status| status.place.record.number() < 200) {
        while host.status().executed == 1 && host.status().high.number() < 1000 {
            let place = host.status().high;
            let record = Record { increments: [5, 0], line: place.number(), ..Record::default() };
            if host.send(HostCommand::Ahead { place, record }).is_err() {
                break;
            }
        }
    }
    stops(&mut host);
    let mut rig = host.into_port().into_simulator();
    rig.run(rig.now_us() + 500_000);
    rig.flush();
    let text = String::from_utf8(file.0.lock().expect("whole").clone()).expect("text");
    read(&text)
}

/// Times at which the torch was lit and went out, and of the last rising edge of X.
fn lit(changes: &HashMap<String, Vec<(u64, String)>>) -> (u64, u64, u64) {
    let spindle = &changes["outputs.spindle"];
    assert_eq!(spindle.iter().map(|(_, value)| value.as_str()).collect::<Vec<_>>(), ["b0", "b1", "b0"]);
    let last = changes["x.step"].iter().rev().find(|(_, value)| value == "1").expect("it moved").0;
    (spindle[1].0, spindle[2].0, last)
}

#[test]
fn a_hold_puts_the_torch_out_at_the_pins_as_soon_as_the_machine_rests() {
    let changes = torch(|host| {
        host.send(HostCommand::rate(Rate::ZERO)).expect("a rate");
        while host.run_period().is_ok_and(|status| !status.at_rest) {}
        for _ in 0..20 {
            host.run_period().expect("no fault");
        }
    });
    let (on, off, last_step) = lit(&changes);
    assert!(on + 20_000_000 < last_step && off > last_step, "lit while braking");
    let at_rest = changes["card.at_rest"].iter().find(|(at, value)| *at > on + 200_000_000 && value == "1");
    assert!(off - at_rest.expect("it rests").0 <= 1_000_000, "within a period");
}

#[test]
fn a_host_that_vanishes_leaves_the_torch_lit_for_the_watchdog_and_no_longer() {
    let mut gone_at = std::sync::atomic::AtomicU64::new(0);
    let changes = torch(|host| gone_at.store(host.port().simulator().now_us(), std::sync::atomic::Ordering::Relaxed));
    let (_, off, last_step) = lit(&changes);
    let gone_ns = *gone_at.get_mut() * 1000;
    assert!(off > gone_ns && off - gone_ns <= 102_000_000, "{} ns", off - gone_ns);
    assert!(last_step > off, "it brakes on the path");
}

/// Limits of a machine that stops within some tens of periods.
fn limits<const A: usize>() -> RateLimits<A> {
    let axis = PulseLimits { velocity: 200 << 32, acceleration: 12 << 32, jerk: 1 << 32 };
    RateLimits::new(13, 1 << 15, [axis; A]).expect("valid")
}
