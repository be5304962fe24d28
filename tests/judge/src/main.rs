//! The command `cut-judge`: reads its arguments, runs the judge over the files, prints a line for each trace.
//!
//! Invariant: it depends on the standard library alone, so that no defect of retrace can be a defect of its judge.
#![forbid(unsafe_code)]

mod heights;
mod kerf;
mod place_ranges;
mod vcd;
mod verdict;

use heights::{HeightMachine, HeightVerdict};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufReader, Write as _};
use std::process::ExitCode;
use vcd::{CutterSignals, ReadError, TraceReader};
use verdict::{JudgedMachine, ReferenceJob, Verdict, judge};

/// A trace is not as good as the uninterrupted job.
const NOT_GOOD: u8 = 1;
/// Wrong arguments, or a file that cannot be read.
const USAGE_ERROR: u8 = 2;

const HELP: &str = "\
Compares traces of an interrupted cut with the trace of the same job without an interruption.

Usage: cut-judge WHOLE.vcd TRACE.vcd... [OPTIONS]

WHOLE.vcd is the trace of the job without an interruption, each TRACE.vcd one of the same job with the same machine
that was held, lost its arc or was put out, and was recovered. `retrace run PROGRAM --vcd FILE` writes such files.

Options:
  --pulses-per-mm N   pulses per mm of X and Y [default: 200]
  --fire NAME         output that switches the cutter [default: spindle]
  --input N           input that proves the cutter, 0 to 63 [default: 5]
  --pierce-ms N       time from the proof to the first motion [default: 400]
  --pilot-ms N        shortest time from an ignition in the kerf to the first motion [default: 298]
  --period-ms N       control period [default: 1]
  --standing-ms N     time that the cutter may be on at rest, but for one period [default: 0]; a card behind a serial
                      line waits for the next instruction for up to its handover time, 100 ms
  --lead-ins          TRACE may have lead-ins of shifted starts: motion of no line of the program, whose places, kerf
                      and ignitions are not those of WHOLE
  --help              this text

For each trace it prints one JSON object in a line:
  trace               the file
  good                true where every figure below is 0 or false, but for ignitions and cut_mm
  not_cut             cells of 0.05 mm that only WHOLE cut
  cut_besides         cells of 0.05 mm that only TRACE cut
  records_not_cut     records of the path that only WHOLE cut, in gaps of more than one record; where the cutter was
                      ignited before it and on all along it, of more than one record and a cell
  wrong_counts        samples at a place of WHOLE with other counts on any axis
  too_early           ignitions at which motion began before the pierce, or before the pilot time in a kerf, was over
  standing            times that the cutter was on at rest for too long
  backward            samples with the cutter on and the path running backward
  lit_in_rapid        samples with the cutter on and moving where WHOLE moves with the cutter off
  lit_under_alarm     times that the cutter was on for more than two periods with an alarm latched
  lit_after_motion    the cutter was on behind the last motion for longer than the handover, 100 ms and 3 periods
  ignited_elsewhere   ignitions at a place where WHOLE never has the cutter on
  on_at_end           the cutter is on at the end
  ignitions           number of ignitions
  cut_mm              length that was cut, with what was cut twice

Exit codes: 0 all traces are good, 1 one is not, 2 wrong arguments or a file that cannot be read.

Example: cut-judge whole.vcd recovered.vcd --pulses-per-mm 160 --pierce-ms 200

`cut-judge heights` judges the height of a torch instead; `cut-judge heights --help` describes it.
";

const HEIGHTS_HELP: &str = "\
Judges the height of a torch over a sheet that is warped as with `--source-faults warp=MM`.

Usage: cut-judge heights TRACE.vcd... [OPTIONS]

Options:
  --pulses-per-mm N    pulses per mm of X and Y [default: 200]
  --z-pulses-per-mm N  pulses per mm of the tool axis, Z [default: 400]
  --sheet-mm N         height of the sheet at X0 in machine coordinates, a depth below 0 [default: 70]
  --rise-mm N          what the sheet rises from X0 to X500 [default: 5]
  --height-mm N        height of the cut over the sheet [default: 1.5]
  --feed N             feed rate of the cut, mm/min [default: 3000]
  --kerf-mm N          width of the kerf; 0: no kerf is known [default: 1.4]
  --fire NAME          output that switches the cutter [default: spindle]
  --input N            input that proves the cutter, 0 to 63 [default: 5]
  --help               this text

For each trace it prints one JSON object in a line:
  trace               the file
  good                true where the figures below allow it
  cut                 samples in motion with a proven arc; none is not good
  beyond              those whose height deviates by more than 0.25 mm, by the pulses at the pins: at most 5 %
  worst_mm            largest deviation: at most 0.5 mm
  wrong_pulses        samples at which the tool axis has made other pulses than path and layer say: 0
  moved_in_corner     samples in which the layer changed below 90 % of the feed, at the planned rate: 0
  over_kerf           samples closer than a kerf to a place that was cut before
  moved_over_kerf     those in which the layer changed: 0
  moved_in_rapid      samples in which the layer changed with the path in motion and the torch off for 0.2 s: 0
  layer_at_end        the layer at the end, in pulses: 0

Exit codes: 0 all traces are good, 1 one is not, 2 wrong arguments or a file that cannot be read.
";

/// What the command line asks for.
#[derive(Debug)]
struct Arguments {
    files: Vec<String>,
    cutter: CutterSignals,
    machine: JudgedMachine,
}

impl Arguments {
    fn read(words: &[String]) -> Result<Self, String> {
        let machine = JudgedMachine {
            pulses_per_mm: 200.0,
            pierce_ms: 400.0,
            pilot_ms: 298.0,
            period_ms: 1.0,
            standing_ms: 0.0,
            has_lead_ins: false,
        };
        let cutter = CutterSignals { fire: "spindle".into(), input: 5 };
        let mut arguments = Self { files: Vec::new(), cutter, machine };
        let mut rest = words.iter();
        while let Some(word) = rest.next() {
            if !word.starts_with("--") {
                arguments.files.push(word.clone());
                continue;
            }
            let machine = &mut arguments.machine;
            let mut value = || rest.next().ok_or(format!("{word} has no value; write it behind the option"));
            match word.as_str() {
                "--fire" => arguments.cutter.fire = value()?.clone(),
                "--input" => arguments.cutter.input = input(value()?)?,
                "--pulses-per-mm" => machine.pulses_per_mm = positive(word, value()?)?,
                "--period-ms" => machine.period_ms = positive(word, value()?)?,
                "--pierce-ms" => machine.pierce_ms = number(word, value()?)?,
                "--standing-ms" => machine.standing_ms = number(word, value()?)?,
                "--lead-ins" => machine.has_lead_ins = true,
                "--pilot-ms" => machine.pilot_ms = number(word, value()?)?,
                _ => return Err(format!("there is no option `{word}`; `cut-judge --help` lists them")),
            }
        }
        if arguments.files.len() < 2 {
            let text = "the judge compares two traces: cut-judge WHOLE.vcd TRACE.vcd; see `cut-judge --help`";
            return Err(text.into());
        }
        Ok(arguments)
    }
}

fn number(option: &str, text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number| (0.0..=1e9).contains(number));
    number.ok_or_else(|| format!("`{text}` of {option} is not a number from 0 to 1000000000; correct it"))
}

fn positive(option: &str, text: &str) -> Result<f64, String> {
    let number = number(option, text)?;
    if number > 0.0 { Ok(number) } else { Err(format!("{option} is 0; give a number greater than 0")) }
}

fn input(text: &str) -> Result<u32, String> {
    let number = text.parse().ok().filter(|number| *number < u64::BITS);
    number.ok_or_else(|| format!("`{text}` is not the number of an input; give --input a number from 0 to 63"))
}

/// Arguments of `cut-judge heights`: the files, the cutter and the machine.
fn read_heights(words: &[String]) -> Result<(Vec<String>, CutterSignals, HeightMachine), String> {
    let mut machine = HeightMachine {
        pulses_per_mm: [200.0, 400.0],
        sheet_mm: [-70.0, 5.0],
        height_mm: 1.5,
        feed_mm_per_s: 50.0,
        kerf_mm: 1.4,
    };
    let mut cutter = CutterSignals { fire: "spindle".into(), input: 5 };
    let mut files = Vec::new();
    let mut rest = words.iter();
    while let Some(word) = rest.next() {
        if !word.starts_with("--") {
            files.push(word.clone());
            continue;
        }
        let mut value = || rest.next().ok_or(format!("{word} has no value; write it behind the option"));
        match word.as_str() {
            "--fire" => cutter.fire = value()?.clone(),
            "--input" => cutter.input = input(value()?)?,
            "--pulses-per-mm" => machine.pulses_per_mm[0] = positive(word, value()?)?,
            "--z-pulses-per-mm" => machine.pulses_per_mm[1] = positive(word, value()?)?,
            "--sheet-mm" => machine.sheet_mm[0] = -number(word, value()?)?,
            "--rise-mm" => machine.sheet_mm[1] = number(word, value()?)?,
            "--height-mm" => machine.height_mm = positive(word, value()?)?,
            "--feed" => machine.feed_mm_per_s = positive(word, value()?)? / 60.0,
            "--kerf-mm" => machine.kerf_mm = number(word, value()?)?,
            _ => return Err(format!("there is no option `{word}`; `cut-judge heights --help` lists them")),
        }
    }
    if files.is_empty() {
        return Err("no trace is named: cut-judge heights TRACE.vcd; see `cut-judge heights --help`".into());
    }
    Ok((files, cutter, machine))
}

/// Judges the heights of every trace, prints its line, and returns whether all are good.
fn judge_heights(words: &[String]) -> Result<bool, String> {
    let (files, cutter, machine) = read_heights(words)?;
    let mut all_good = true;
    for path in &files {
        let file = File::open(path).map_err(|error| format!("{path}: {}", ReadError::File(error)))?;
        let trace = TraceReader::open(BufReader::with_capacity(1 << 16, file), &cutter);
        let verdict: HeightVerdict =
            trace.and_then(|trace| heights::judge(trace, &machine)).map_err(|error| format!("{path}: {error}"))?;
        let line = object(path, verdict.is_good(), &verdict.figures());
        writeln!(io::stdout(), "{line}").map_err(cannot_write)?;
        all_good &= verdict.is_good();
    }
    Ok(all_good)
}

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
    let heights = words.split_first().filter(|(first, _)| *first == "heights").map(|(_, rest)| rest);
    if words.iter().any(|word| word == "--help" || word == "-h") {
        // a reader that has seen enough of it is no error
        let _ = io::stdout().write_all(if heights.is_some() { HEIGHTS_HELP } else { HELP }.as_bytes());
        return ExitCode::SUCCESS;
    }
    let judged = match heights {
        Some(rest) => judge_heights(rest),
        None => Arguments::read(&words).and_then(|arguments| judge_files(&arguments)),
    };
    match judged {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(NOT_GOOD),
        Err(reason) => {
            eprintln!("cut-judge: {reason}");
            ExitCode::from(USAGE_ERROR)
        }
    }
}

/// Judges every trace, prints its line, and returns whether all are good.
fn judge_files(arguments: &Arguments) -> Result<bool, String> {
    let Arguments { files, cutter, machine } = arguments;
    let open = |path: &String| {
        let file = File::open(path).map_err(ReadError::File)?;
        TraceReader::open(BufReader::with_capacity(1 << 16, file), cutter)
    };
    let in_file = |path: &String| {
        let path = path.clone();
        move |error: ReadError| format!("{path}: {error}")
    };
    let whole = &files[0];
    let job = open(whole).and_then(|trace| ReferenceJob::read(trace, machine)).map_err(in_file(whole))?;
    let mut all_good = true;
    for path in &files[1..] {
        let verdict = open(path).and_then(|trace| judge(&job, trace, machine)).map_err(in_file(path))?;
        writeln!(io::stdout(), "{}", json_line(path, &verdict)).map_err(cannot_write)?;
        all_good &= verdict.is_good();
    }
    Ok(all_good)
}

fn cannot_write(error: io::Error) -> String {
    format!("the verdict cannot be written: {error}; check where standard output goes")
}

fn json_line(path: &str, verdict: &Verdict) -> String {
    object(path, verdict.is_good(), &verdict.figures())
}

fn object(path: &str, is_good: bool, figures: &[(&'static str, String)]) -> String {
    let mut line = format!("{{\"trace\":{},\"good\":{is_good}", json_text(path));
    for (name, value) in figures {
        let _ = write!(line, ",\"{name}\":{value}");
    }
    line + "}"
}

fn json_text(text: &str) -> String {
    let mut quoted = String::from("\"");
    for letter in text.chars() {
        match letter {
            '"' | '\\' => quoted.extend(['\\', letter]),
            control if control < ' ' => {
                let _ = write!(quoted, "\\u{:04x}", u32::from(control));
            }
            other => quoted.push(other),
        }
    }
    quoted + "\""
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_quoted_as_json_has_it() {
        assert_eq!(json_text("a\"b\\c\nd é"), "\"a\\\"b\\\\c\\u000ad é\"");
    }
}
