//! Reads the signals that a judge needs from a value change dump (IEEE 1364-2005, clause 18), moment by moment.
//!
//! Invariant: one line of the file is in memory at a time; a sample has the values of the file, and the number of the
//! pulses in it.

use std::collections::HashMap;
use std::fmt;
use std::io::{self, BufRead};

/// How a trace is written again.
const WRITE_AGAIN: &str = "write the trace again with `retrace run PROGRAM --vcd FILE`";

/// Values of the signals from a moment on.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sample {
    /// The moment, in nanoseconds.
    pub(crate) at_ns: u64,
    /// Place on the path, in records.
    pub(crate) place: f64,
    /// Rate of the control period that begins at the moment.
    pub(crate) rate: f64,
    /// Whether the machine is at rest.
    pub(crate) at_rest: bool,
    /// Whether the output that fires is on.
    pub(crate) is_lit: bool,
    /// Whether the input that proves the cutter is active.
    pub(crate) is_proven: bool,
    /// Whether an alarm is latched.
    pub(crate) has_alarm: bool,
    /// Whether the record under the cursor belongs to a line of the program: not that of a lead-in, nor at the end of
    /// what the card holds.
    pub(crate) has_line: bool,
    /// Count of each axis, in the order of the file.
    pub(crate) counts: Vec<i64>,
    /// Layer of the tool axis, in pulses; 0 where the trace has none.
    pub(crate) layer: i64,
    /// Pulses of each axis before the moment, those backward subtracted.
    pub(crate) pulses_before: Vec<i64>,
}

/// What a trace calls the cutter.
#[derive(Clone, Debug)]
pub(crate) struct CutterSignals {
    /// Name of the output that fires.
    pub(crate) fire: String,
    /// Number of the input that proves the cutter.
    pub(crate) input: u32,
}

/// Why a trace cannot be read.
#[derive(Debug)]
pub(crate) enum ReadError {
    /// The file cannot be read.
    File(io::Error),
    /// A line is not one of a value change dump; its number and what is wrong with it.
    Line(u64, String),
    /// The file as a whole has not what the judge needs.
    Content(String),
}

impl fmt::Display for ReadError {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(error) if error.kind() == io::ErrorKind::InvalidData => {
                write!(to, "it is not a text file; give a value change dump, or {WRITE_AGAIN}")
            }
            Self::File(error) => write!(to, "{error}; check its name and its permissions"),
            Self::Line(number, what) => write!(to, "line {number}: {what}; {WRITE_AGAIN}"),
            Self::Content(what) => write!(to, "{what}"),
        }
    }
}

impl std::error::Error for ReadError {}

#[derive(Clone, Copy, Debug)]
enum Signal {
    Place,
    Rate,
    AtRest,
    Alarm,
    Line,
    Inputs,
    Fire,
    Layer,
    Count(usize),
    Step(usize),
    Backward(usize),
}

impl Signal {
    /// Its name in the trace; a word of its own where the name depends on the machine.
    fn name(self) -> &'static str {
        match self {
            Self::Place => "card.place",
            Self::Rate => "card.rate",
            Self::AtRest => "card.at_rest",
            Self::Alarm => "card.alarm",
            Self::Line => "card.line",
            Self::Inputs => "card.inputs",
            Self::Fire => "fire",
            Self::Layer => "card.layer",
            Self::Count(_) => "count",
            Self::Step(_) => "step",
            Self::Backward(_) => "backward",
        }
    }
}

/// A trace that is read from its beginning to its end.
#[derive(Debug)]
pub(crate) struct TraceReader<R> {
    file: R,
    line: String,
    number: u64,
    /// Signals by their short names; `None` for those that the judge does not need.
    signals: HashMap<String, Option<Signal>>,
    axes: Vec<String>,
    outputs: Vec<String>,
    cutter: CutterSignals,
    /// Unit of time: this many femtoseconds.
    unit_fs: u128,
    now: Sample,
    /// Pulses of each axis up to now, and whether its direction is backward.
    pulses: Vec<i64>,
    backward: Vec<bool>,
    has_changed: bool,
}

impl<R: BufRead> TraceReader<R> {
    /// Reads the declarations.
    ///
    /// # Errors
    /// Where the file cannot be read, is no value change dump, or lacks a signal.
    pub(crate) fn open(file: R, cutter: &CutterSignals) -> Result<Self, ReadError> {
        let mut reader = Self {
            file,
            line: String::new(),
            number: 0,
            signals: HashMap::new(),
            axes: Vec::new(),
            outputs: Vec::new(),
            cutter: cutter.clone(),
            unit_fs: 1_000_000,
            now: Sample::default(),
            pulses: Vec::new(),
            backward: Vec::new(),
            has_changed: false,
        };
        reader.read_declarations()?;
        reader.check_signals()?;
        let axes = reader.axes.len();
        (reader.now.counts, reader.now.pulses_before) = (vec![0; axes], vec![0; axes]);
        (reader.pulses, reader.backward) = (vec![0; axes], vec![false; axes]);
        Ok(reader)
    }

    /// Names of the axes, in the order of the counts.
    pub(crate) fn axes(&self) -> &[String] {
        &self.axes
    }

    /// Indices of X and Y among the axes.
    pub(crate) fn plane(&self) -> [usize; 2] {
        ["x", "y"].map(|name| self.axes.iter().position(|axis| axis == name).unwrap_or_default())
    }

    /// Reads the next sample: one for each moment at which a signal changed that the judge needs. Returns false at the
    /// end of the file.
    ///
    /// # Errors
    /// Where the file cannot be read, or a line is not a value change.
    pub(crate) fn read_sample(&mut self, sample: &mut Sample) -> Result<bool, ReadError> {
        while self.read_line()? {
            let line = self.line.trim();
            if let Some(time) = line.strip_prefix('#') {
                let at_ns = self.time_ns(time)?;
                let is_complete = std::mem::take(&mut self.has_changed);
                if is_complete {
                    sample.clone_from(&self.now);
                }
                self.now.at_ns = at_ns;
                self.now.pulses_before.clone_from(&self.pulses);
                if is_complete {
                    return Ok(true);
                }
            } else if !line.is_empty() && !line.starts_with('$') {
                self.apply_change()?;
            }
        }
        sample.clone_from(&self.now);
        Ok(std::mem::take(&mut self.has_changed))
    }

    fn read_line(&mut self) -> Result<bool, ReadError> {
        self.line.clear();
        self.number += 1;
        self.file.read_line(&mut self.line).map(|length| length > 0).map_err(ReadError::File)
    }

    fn wrong_line(&self, what: &str) -> ReadError {
        let begin: String = self.line.trim().chars().take(40).collect();
        ReadError::Line(self.number, format!("`{begin}` {what}"))
    }

    fn read_declarations(&mut self) -> Result<(), ReadError> {
        let (mut command, mut scopes) = (Vec::<String>::new(), Vec::<String>::new());
        while self.read_line()? {
            let words: Vec<String> = self.line.split_whitespace().map(str::to_owned).collect();
            for word in words {
                if command.is_empty() && !word.starts_with('$') {
                    return Err(self.wrong_line("is not a declaration of a value change dump"));
                }
                if word != "$end" {
                    command.push(word);
                    continue;
                }
                let words: Vec<&str> = command.iter().map(String::as_str).collect();
                match words[..] {
                    ["$enddefinitions"] => return Ok(()),
                    ["$scope", _, name] => scopes.push(name.to_owned()),
                    ["$upscope"] => drop(scopes.pop()),
                    ["$timescale", ..] => self.set_unit(&words[1..].concat())?,
                    // a vector may have its range behind its name
                    ["$var", _, _, code, name, ..] => self.declare(scopes.last().map_or("", |scope| scope), name, code),
                    _ => {}
                }
                command.clear();
            }
        }
        Err(ReadError::Content(format!("it has no `$enddefinitions`, so it is not a value change dump; {WRITE_AGAIN}")))
    }

    fn set_unit(&mut self, text: &str) -> Result<(), ReadError> {
        let digits = text.bytes().take_while(u8::is_ascii_digit).count();
        let (number, unit) = text.split_at(digits);
        let zeros = ["fs", "ps", "ns", "us", "ms", "s"].iter().position(|known| *known == unit);
        self.unit_fs = match (number, zeros) {
            ("1" | "10" | "100", Some(zeros)) => 10_u128.pow(3 * zeros as u32 + number.len() as u32 - 1),
            _ => return Err(self.wrong_line("is not a unit of time")),
        };
        Ok(())
    }

    fn declare(&mut self, scope: &str, name: &str, code: &str) {
        let signal = match (scope, name) {
            ("card", "place") => Some(Signal::Place),
            ("card", "rate") => Some(Signal::Rate),
            ("card", "at_rest") => Some(Signal::AtRest),
            ("card", "alarm") => Some(Signal::Alarm),
            ("card", "line") => Some(Signal::Line),
            ("card", "inputs") => Some(Signal::Inputs),
            ("card", "layer") => Some(Signal::Layer),
            ("outputs", _) => {
                self.outputs.push(name.to_owned());
                (name == self.cutter.fire).then_some(Signal::Fire)
            }
            (axis, "count" | "step" | "backward") => {
                let known = self.axes.iter().position(|other| other == axis);
                let index = known.unwrap_or(self.axes.len());
                if known.is_none() {
                    self.axes.push(axis.to_owned());
                }
                Some(match name {
                    "count" => Signal::Count(index),
                    "step" => Signal::Step(index),
                    _ => Signal::Backward(index),
                })
            }
            _ => None,
        };
        self.signals.insert(code.to_owned(), signal);
    }

    fn check_signals(&self) -> Result<(), ReadError> {
        let has = |name: &str| self.signals.values().flatten().any(|signal| signal.name() == name);
        let needed = [Signal::Place, Signal::Rate, Signal::AtRest, Signal::Alarm, Signal::Inputs].map(Signal::name);
        if let Some(name) = needed.iter().find(|name| !has(name)) {
            return Err(ReadError::Content(format!("it has no signal `{name}`; {WRITE_AGAIN}")));
        }
        let has_count = |name: &str| {
            let index = self.axes.iter().position(|axis| axis == name);
            self.signals.values().flatten().any(|of| matches!(of, Signal::Count(at) if Some(*at) == index))
        };
        if let Some(axis) = ["x", "y"].iter().find(|name| !has_count(name)) {
            return Err(ReadError::Content(format!("it has no signal `{axis}.count`; {WRITE_AGAIN}")));
        }
        if !has(Signal::Fire.name()) {
            let (fire, outputs) = (&self.cutter.fire, self.outputs.join(", "));
            let text = format!("it has no output `{fire}`; give one of its outputs with --fire: {outputs}");
            return Err(ReadError::Content(text));
        }
        Ok(())
    }

    fn time_ns(&self, text: &str) -> Result<u64, ReadError> {
        let time = text.parse::<u64>().ok().map(|time| u128::from(time) * self.unit_fs / 1_000_000);
        match time.and_then(|time_ns| u64::try_from(time_ns).ok()) {
            Some(time_ns) if time_ns >= self.now.at_ns => Ok(time_ns),
            Some(_) => Err(self.wrong_line("is before the time above it")),
            None => Err(self.wrong_line("is not a time")),
        }
    }

    fn apply_change(&mut self) -> Result<(), ReadError> {
        let Some((value, code)) = change(self.line.trim()) else {
            return Err(self.wrong_line("is not a value change"));
        };
        let Some(signal) = self.signals.get(code) else {
            return Err(self.wrong_line("changes a signal that is not declared"));
        };
        let Some(signal) = *signal else { return Ok(()) };
        let is_set = value != Value::Bits(0) && value != Value::Real(0.0);
        let now = &mut self.now;
        match (signal, value) {
            (Signal::Place, Value::Real(place)) => now.place = place,
            (Signal::Rate, Value::Real(rate)) => now.rate = rate,
            (Signal::AtRest, _) => now.at_rest = is_set,
            (Signal::Alarm, _) => now.has_alarm = is_set,
            (Signal::Line, _) => now.has_line = is_set,
            (Signal::Fire, _) => now.is_lit = is_set,
            (Signal::Inputs, Value::Bits(bits)) => now.is_proven = bits >> self.cutter.input & 1 == 1,
            // a negative number is written with all of its 64 bits
            (Signal::Layer, Value::Real(layer)) => now.layer = layer as i64,
            (Signal::Count(axis), Value::Bits(bits)) => now.counts[axis] = bits.cast_signed(),
            // pulses make no moment of their own
            (Signal::Backward(axis), _) => {
                self.backward[axis] = is_set;
                return Ok(());
            }
            (Signal::Step(axis), _) => {
                self.pulses[axis] += i64::from(is_set) * if self.backward[axis] { -1 } else { 1 };
                return Ok(());
            }
            _ => return Err(self.wrong_line("is not a value of this signal")),
        }
        self.has_changed = true;
        Ok(())
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Value {
    Bits(u64),
    Real(f64),
}

/// The value of a change and the short name of its signal.
fn change(line: &str) -> Option<(Value, &str)> {
    let (kind, rest) = line.split_at_checked(1)?;
    match kind {
        "0" => Some((Value::Bits(0), rest)),
        "1" => Some((Value::Bits(1), rest)),
        "b" | "B" => {
            let (bits, code) = rest.split_once(' ')?;
            Some((Value::Bits(u64::from_str_radix(bits, 2).ok()?), code.trim()))
        }
        "r" | "R" => {
            let (number, code) = rest.split_once(' ')?;
            let number: f64 = number.parse().ok()?;
            number.is_finite().then_some((Value::Real(number), code.trim()))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "$version x $end\n$timescale\n 10 us\n$end\n$scope module x $end\n$var wire 1 ! step $end\n\
        $var integer 64 \" count $end\n$upscope $end\n$scope module y $end\n$var integer 64 # count $end\n$upscope \
        $end\n$scope module card $end\n$var real 64 $ place $end\n$var real 64 % rate $end\n$var wire 1 & at_rest \
        $end\n$var integer 8 ' alarm $end\n$var integer 16 ( inputs $end\n$upscope $end\n$scope module outputs $end\n\
        $var integer 32 ) spindle [31:0] $end\n$upscope $end\n$enddefinitions $end\n";

    fn read(text: &str) -> Result<Vec<Sample>, ReadError> {
        let cutter = CutterSignals { fire: "spindle".into(), input: 5 };
        let mut reader = TraceReader::open(text.as_bytes(), &cutter)?;
        let (mut samples, mut sample) = (Vec::new(), Sample::default());
        while reader.read_sample(&mut sample)? {
            samples.push(sample.clone());
        }
        Ok(samples)
    }

    #[test]
    fn each_moment_of_a_change_is_a_sample() {
        let body = "$dumpvars\n#0\nr1.5 $\nr-1 %\n1&\nb100001 (\nb1 )\n$end\n#3\n1!\n#100\nb11 '\n#100\n0!\n#200\n\
                    b1111111111111111111111111111111111111111111111111111111111111110 \"\nb0 )\nb11111 (\n";
        let samples = read(&format!("{HEAD}{body}")).expect("a trace");
        assert_eq!(samples.iter().map(|sample| sample.at_ns).collect::<Vec<_>>(), [0, 1_000_000, 2_000_000]);
        let [first, second, third] = &samples[..] else { panic!("{samples:?}") };
        assert_eq!((first.place, first.rate, first.at_rest, first.is_lit), (1.5, -1.0, true, true));
        assert!(first.is_proven && !first.has_alarm && second.has_alarm && second.is_lit);
        assert_eq!((&third.counts[..], third.is_lit, third.is_proven), (&[-2, 0][..], false, false));
    }

    #[test]
    fn what_is_not_a_trace_is_refused_with_its_line() {
        let lines = HEAD.lines().count();
        for (body, what) in [
            ("#0\nnoise\n", format!("line {}: `noise` is not a value change", lines + 2)),
            ("#0\nxA\n", format!("line {}: `xA` is not", lines + 2)),
            ("#0\n1A\n", format!("line {}: `1A` changes a signal that is not declared", lines + 2)),
            ("#x\n", format!("line {}: `#x` is not a time", lines + 1)),
            ("#5\n1&\n#4\n", format!("line {}: `#4` is before", lines + 3)),
            ("#0\nrNaN $\n", format!("line {}: `rNaN $` is not", lines + 2)),
            ("#0\nb1 $\n", format!("line {}: `b1 $` is not a value of this signal", lines + 2)),
        ] {
            let error = read(&format!("{HEAD}{body}")).expect_err(body).to_string();
            assert!(error.starts_with(&what) && error.contains("write the trace again"), "{error}");
        }
        for (from, to, what) in [
            ("place", "plaice", "no signal `card.place`"),
            ("module y", "module yy", "no signal `y.count`"),
            ("spindle", "out3", "with --fire: out3"),
            ("$enddefinitions", "$comment", "no `$enddefinitions`"),
            ("10 us", "10 days", "not a unit of time"),
            ("$version", "version", "line 1: `version x $end` is not a declaration"),
        ] {
            let error = read(&HEAD.replace(from, to)).expect_err(to).to_string();
            assert!(error.contains(what), "{error}");
        }
    }
}
