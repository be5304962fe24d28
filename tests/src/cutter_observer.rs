//! An observer of the card's pins that decides when the cutter may be on, from the trace and the program's text alone.
//!
//! Invariant: it has the lines that are cut, the duration of a pierce and the longest standstill; it uses nothing of
//! retrace itself.

use std::collections::{HashMap, VecDeque};
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::Command;
use std::thread::{self, JoinHandle};

/// Rules for the pins. Times in milliseconds of the card's clock.
#[derive(Clone, Debug)]
pub struct Rules {
    /// Name of the output that fires: `spindle` or `out3`.
    pub fire: String,
    /// Program lines that are to be cut, from 1.
    pub cut_lines: Vec<u64>,
    /// Shortest time from ignition to the first step, and longest duration of the instruction.
    pub ready_ms: [f64; 2],
    /// Longest time that it may be on while the place on the path does not change: grace and handover. `None`:
    /// unlimited, as for a spindle.
    pub standing_ms: Option<f64>,
}

/// The place is sampled once a control period, and the outputs follow it.
const PERIODS_MS: f64 = 3.0;
/// Longest time in which a machine that is cutting comes to rest; it may move by less than a pulse meanwhile.
const BRAKES_MS: f64 = 300.0;
/// Number of changes that are shown before a violation.
const CHANGES: usize = 80;

/// Result of the observation.
#[derive(Clone, Debug, Default)]
pub struct ObservedPins {
    /// Violations, with their times.
    pub violations: Vec<String>,
    /// Number of ignitions.
    pub ignitions: u64,
    /// Number of steps with the cutter on.
    pub steps_on: u64,
    /// Number of steps backward.
    pub steps_back: u64,
    /// Number of times at which a beam had power.
    pub powered: u64,
    /// Number of alarms of the card.
    pub alarms: u64,
    /// Whether the cutter is on at the end of the trace.
    pub on_at_end: bool,
    /// The last changes before the first violation, in order: time, signal, value.
    pub before: Vec<String>,
}

/// A trace being observed.
#[derive(Debug)]
pub struct Observation(JoinHandle<ObservedPins>);

impl Observation {
    /// Result; waits until the card has ended.
    ///
    /// # Panics
    /// Where the trace cannot be read.
    #[must_use]
    pub fn ended(self) -> ObservedPins {
        self.0.join().expect("the trace is read")
    }
}

/// Creates the pipe that a card writes its trace to, and observes it by these rules.
///
/// # Panics
/// Where the system creates no such pipe.
#[must_use]
pub fn observe(path: PathBuf, rules: Rules) -> Observation {
    let made = Command::new("mkfifo").arg(&path).status().expect("mkfifo runs");
    assert!(made.success(), "a pipe with a name");
    Observation(thread::spawn(move || {
        let mut trace = BufReader::with_capacity(1 << 16, File::open(&path).expect("the pipe"));
        let (mut observer, mut line) = (Observer::new(rules), String::new());
        while trace.read_line(&mut line).is_ok_and(|count| count > 0) {
            observer.parse_line(line.trim_end());
            line.clear();
        }
        observer.end()
    }))
}

/// Meaning of a signal.
#[derive(Clone, Copy, Debug)]
enum Signal {
    Fire,
    Step,
    Rate,
    Line,
    Place,
    Alarm,
    BeamPower,
}

/// The state of the pins at a time.
#[derive(Debug)]
pub struct Observer {
    rules: Rules,
    signals: HashMap<String, Signal>,
    now_ms: f64,
    on: bool,
    rate: f64,
    line: u64,
    place: f64,
    alarm: bool,
    /// Power of a beam.
    power: u64,
    /// Whether a step began at this time.
    stepped: bool,
    /// The place before this period.
    furthest: f64,
    /// Time at which the cutter came on, until the first step behind it.
    ignited_ms: Option<f64>,
    /// Time at which it last went off.
    off_ms: f64,
    /// Whether the machine has come to rest since then.
    rested: bool,
    /// Time of the last step or ignition.
    last_ms: f64,
    /// Time of the last change of the place, or ignition.
    moved_ms: f64,
    /// The last changes of cutter, alarm, line and rate.
    changes: VecDeque<String>,
    /// Whether the last of them was the rate.
    ramp: bool,
    seen: ObservedPins,
}

impl Observer {
    /// Observer at the beginning of a trace.
    #[must_use]
    pub fn new(rules: Rules) -> Self {
        Self {
            rules,
            signals: HashMap::new(),
            now_ms: 0.0,
            on: false,
            rate: 0.0,
            line: 0,
            place: 0.0,
            alarm: false,
            power: 0,
            stepped: false,
            furthest: 0.0,
            ignited_ms: None,
            off_ms: f64::NEG_INFINITY,
            rested: false,
            last_ms: 0.0,
            moved_ms: 0.0,
            changes: VecDeque::new(),
            ramp: false,
            seen: ObservedPins::default(),
        }
    }

    /// Parses a line of the trace.
    pub fn parse_line(&mut self, line: &str) {
        if let Some(declared) = line.strip_prefix("$var ") {
            let words: Vec<&str> = declared.split(' ').collect();
            if let [_, _, code, name, "$end"] = words[..] {
                let signal = match name {
                    "step" => Signal::Step,
                    "rate" => Signal::Rate,
                    "line" => Signal::Line,
                    "place" => Signal::Place,
                    "alarm" => Signal::Alarm,
                    "beam_power" => Signal::BeamPower,
                    name if name == self.rules.fire => Signal::Fire,
                    _ => return,
                };
                self.signals.insert(code.to_owned(), signal);
            }
        } else if let Some(time) = line.strip_prefix('#') {
            self.check_state();
            self.now_ms = time.parse::<f64>().unwrap_or(0.0) / 1e6;
        } else {
            let (value, code) = match line.split_once(' ') {
                Some((value, code)) => (value, code),
                None if line.len() > 1 && line.is_char_boundary(1) => line.split_at(1),
                None => return,
            };
            if let Some(&signal) = self.signals.get(code) {
                self.change(signal, value);
            }
        }
    }

    fn change(&mut self, signal: Signal, value: &str) {
        if self.seen.violations.is_empty() && !matches!(signal, Signal::Step | Signal::Place | Signal::BeamPower) {
            if self.changes.len() == CHANGES {
                self.changes.pop_front();
            }
            let change = format!("{:.1} {signal:?} {value}", self.now_ms);
            match self.changes.back_mut() {
                // of a ramp its beginning and its end
                Some(last) if self.ramp && matches!(signal, Signal::Rate) => *last = change,
                _ => self.changes.push_back(change),
            }
            self.ramp = matches!(signal, Signal::Rate);
        }
        let number = || u64::from_str_radix(value.trim_start_matches('b'), 2).unwrap_or(0);
        let real = || value.trim_start_matches('r').parse::<f64>().unwrap_or(0.0);
        match signal {
            Signal::Step => self.stepped |= number() == 1,
            Signal::Rate => {
                self.rate = real();
                self.rested |= self.rate == 0.0;
            }
            Signal::Line => self.line = number(),
            Signal::BeamPower => self.power = number(),
            Signal::Place => {
                if self.on {
                    self.check_standstill();
                }
                self.furthest = self.furthest.max(self.place);
                (self.place, self.moved_ms) = (real(), self.now_ms);
            }
            Signal::Alarm => {
                self.seen.alarms += u64::from(number() != 0 && !self.alarm);
                self.alarm = number() != 0;
            }
            Signal::Fire => {
                let on = number() != 0;
                if on && !self.on {
                    self.seen.ignitions += 1;
                    (self.ignited_ms, self.last_ms, self.moved_ms) = (Some(self.now_ms), self.now_ms, self.now_ms);
                } else if !on && self.on {
                    self.check_standstill();
                    (self.ignited_ms, self.off_ms, self.rested) = (None, self.now_ms, self.rate == 0.0);
                }
                self.on = on;
            }
        }
    }

    fn wrong(&mut self, what: String) {
        if self.seen.violations.is_empty() {
            self.seen.before = self.changes.drain(..).collect();
        }
        if self.seen.violations.len() < 8 {
            self.seen.violations.push(format!("{:.3} ms, line {}: {what}", self.now_ms, self.line));
        }
    }

    /// Checks that the cutter was not on for too long at the same place, or without a step, until now.
    fn check_standstill(&mut self) {
        let Some(most) = self.rules.standing_ms else { return };
        let most = most + PERIODS_MS + if self.ignited_ms.is_some() { self.rules.ready_ms[1] } else { 0.0 };
        let (at_place, without_step) = (self.now_ms - self.moved_ms, self.now_ms - self.last_ms);
        if at_place > most {
            self.wrong(format!("on and standing for {at_place:.1} ms"));
        } else if without_step > most + BRAKES_MS {
            self.wrong(format!("on and without a step for {without_step:.1} ms"));
        }
    }

    /// Checks that a beam has power only while it is on, and at rest only before the first step behind its ignition.
    fn check_power(&mut self) {
        if self.power == 0 {
            return;
        }
        self.seen.powered += 1;
        if !self.on {
            self.wrong("power without the beam".to_owned());
        } else if self.rate == 0.0 && self.ignited_ms.is_none() {
            self.wrong("power at rest".to_owned());
        }
    }

    /// Checks the state when all changes of a time are applied.
    fn check_state(&mut self) {
        self.check_power();
        if !std::mem::take(&mut self.stepped) {
            return;
        }
        let is_cut = self.rules.cut_lines.contains(&self.line);
        self.seen.steps_back += u64::from(self.rate < 0.0);
        if !self.on {
            // Retracing ends at the boundary of the record that was reached.
            let first_time = self.rate > 0.0 && self.place > self.furthest.max(0.0).ceil();
            // Where the operator switches it off in the cut, the machine brakes on the path.
            let brakes = self.now_ms - self.off_ms < BRAKES_MS && !self.rested;
            if is_cut && first_time && !self.alarm && !brakes {
                self.wrong("feed along a cut with the cutter off".to_owned());
            }
            return;
        }
        self.seen.steps_on += 1;
        self.check_standstill();
        if let Some(at) = self.ignited_ms.take()
            && self.now_ms - at < self.rules.ready_ms[0]
        {
            self.wrong(format!("feed {:.1} ms after ignition", self.now_ms - at));
        }
        if self.rules.standing_ms.is_some() {
            if self.rate < 0.0 {
                self.wrong("on in reverse".to_owned());
            } else if !is_cut {
                self.wrong("on outside of a cut".to_owned());
            }
            if self.alarm {
                self.wrong("on under an alarm".to_owned());
            }
        }
        self.last_ms = self.now_ms;
    }

    /// Ends the trace.
    #[must_use]
    pub fn end(mut self) -> ObservedPins {
        self.check_state();
        if self.on {
            self.check_standstill();
        }
        self.seen.on_at_end = self.on;
        self.seen
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Line 2 is a cut; the torch is ready after 10 ms and may be at rest for 5.
    fn seen(changes: &[(u64, &str)]) -> ObservedPins {
        let rules =
            Rules { fire: "spindle".into(), cut_lines: vec![2], ready_ms: [10.0, 30.0], standing_ms: Some(5.0) };
        let mut observer = Observer::new(rules);
        let declared = "$var wire 1 s step $end\n$var real 64 r rate $end\n$var integer 32 l line $end\n\
            $var real 64 p place $end\n$var integer 8 a alarm $end\n$var integer 32 f spindle $end\n\
            $var integer 32 w beam_power $end";
        declared.lines().for_each(|line| observer.parse_line(line));
        for (ms, change) in changes {
            observer.parse_line(&format!("#{}", ms * 1_000_000));
            change.split(';').for_each(|change| observer.parse_line(change));
        }
        observer.end()
    }

    #[test]
    fn a_cut_behind_its_pierce_is_let_pass() {
        let fine = [
            (0, "b1 l"),
            (5, "b1 f;b1 w"),
            (20, "b10 l;r1 r;r1 p;1s"),
            (21, "r2 p;0s"),
            (22, "r3 p;1s"),
            (24, "b0 f;b0 w"),
        ];
        let seen = seen(&fine);
        assert!(
            seen.violations.is_empty() && seen.ignitions == 1 && seen.steps_on == 2 && seen.powered > 0,
            "{seen:?}"
        );
    }

    #[test]
    fn each_offence_is_named() {
        let cases: [(&[(u64, &str)], &str); 9] = [
            (&[(5, "b1 f;b1 w"), (20, "b10 l;r1 r;r1 p;1s"), (21, "b0 f")], "power without the beam"),
            (&[(5, "b1 f;b1 w"), (20, "b10 l;r1 r;r1 p;1s"), (21, "r0 r")], "power at rest"),
            (&[(5, "b1 f"), (10, "b10 l;r1 r;r1 p;1s")], "after ignition"),
            (&[(5, "b1 f"), (20, "b10 l;r1 r;r1 p;1s"), (30, "b0 f")], "standing for 10.0"),
            (&[(5, "b1 f"), (45, "b0 f")], "standing for 40.0"),
            (&[(5, "b1 f"), (20, "b1 l;r1 r;r1 p;1s")], "outside of a cut"),
            (&[(5, "b1 f"), (20, "b10 l;r-1 r;r1 p;1s")], "in reverse"),
            (&[(5, "b10 l;r1 r;r1 p;1s")], "cutter off"),
            (&[(5, "b1 f"), (20, "b10 l;r1 r;r1 p;1s;b1 a")], "under an alarm"),
        ];
        for (changes, what) in cases {
            let seen = seen(changes);
            assert!(seen.violations.iter().any(|violation| violation.contains(what)), "{what}: {seen:?}");
        }
    }

    #[test]
    fn braking_without_the_cutter_is_forgiven_and_starting_is_not() {
        let cut = [(0, "b10 l"), (5, "b1 f"), (20, "r1 r;r1 p;1s"), (21, "r2 p;0s")];
        let and = |more: &[(u64, &'static str)]| seen(&[&cut[..], more].concat());
        let brakes = and(&[(22, "b0 f"), (23, "r5e-1 r;r3 p;1s"), (24, "r0 r;0s")]);
        assert!(brakes.violations.is_empty(), "{brakes:?}");
        let starts = and(&[(22, "r0 r"), (23, "b0 f"), (24, "r1 r;r3 p;1s")]);
        assert!(starts.violations[0].contains("cutter off"), "{starts:?}");
    }

    #[test]
    fn a_crawl_is_no_motion_for_ever() {
        let mut changes = vec![(0, "b10 l".to_owned()), (5, "b1 f".into()), (20, "r1 r;r1 p;1s".into())];
        changes.extend((1..100).map(|k| (20 + 4 * k, format!("r1.{k:03} p;0s"))));
        changes.push((420, "b0 f".into()));
        let changes: Vec<(u64, &str)> = changes.iter().map(|(ms, change)| (*ms, change.as_str())).collect();
        assert!(seen(&changes).violations[0].contains("without a step"), "{:?}", seen(&changes));
    }
}
