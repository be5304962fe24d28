//! Commands of the native runner.
//!
//! Invariant: a check that panics is reported as a line like any other; no panic ends the runner.

use retrace_verification::ledger::{self, Row, Search, Size};
use retrace_verification::native::{Failure, Harness};
use retrace_verification::region::Region;
use std::any::Any;
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::sync::Mutex;
use std::time::Instant;

const HELP: &str = "\
Runs the checks of the proof ledger natively; `cargo xtask verify` calls it.

  list                                         every row, as a line of JSON each
  regions                                      the regions that properties reach, in the order of their bits
  check NAME … [--most N] [--seed N] [--full]  harnesses and searches, as a line of JSON each
  replay NAME 1,2,3                            a harness over the numbers of a counterexample
";

/// Number of runs of a harness, enumerated and once more drawn, without `--most`.
const DEFAULT_RUNS: u64 = 100_000;

/// Message and place of the last panic.
static LAST_PANIC: Mutex<String> = Mutex::new(String::new());

/// Executes one command line.
pub(crate) fn run(words: &[&str]) -> ExitCode {
    match words {
        ["list"] => {
            ledger::rows_by_module().for_each(|(module, row)| println!("{}", row_json(module, &row)));
            ExitCode::SUCCESS
        }
        ["regions"] => {
            Region::ALL.iter().for_each(|region| println!("{}", region.name()));
            ExitCode::SUCCESS
        }
        ["check", rest @ ..] => check(rest),
        ["replay", name, numbers] => replay(name, numbers),
        _ => refuse(HELP),
    }
}

fn refuse(reason: &str) -> ExitCode {
    eprintln!("{}", reason.trim_end());
    ExitCode::from(2)
}

fn check(words: &[&str]) -> ExitCode {
    let (mut names, mut most, mut size) = (Vec::new(), DEFAULT_RUNS, Size { full: false, seed: 1 });
    let mut words = words.iter();
    while let Some(&word) = words.next() {
        match word {
            "--full" => size.full = true,
            "--most" | "--seed" => match (word, words.next().and_then(|number| number.parse().ok())) {
                ("--most", Some(number)) => most = number,
                (_, Some(number)) => size.seed = number,
                (_, None) => return refuse(&format!("{word} needs a whole number")),
            },
            name => names.push(name),
        }
    }
    std::panic::set_hook(Box::new(|info| {
        let place = info.location().map(|place| format!(" ({}:{})", place.file(), place.line())).unwrap_or_default();
        if let Ok(mut said) = LAST_PANIC.lock() {
            *said = format!("{}{place}", message(info.payload()));
        }
    }));
    let mut passed = true;
    for name in names {
        let started = Instant::now();
        let answer = match find(name) {
            Some(Check::Harness(harness)) => harness_answer(&harness, most, size.seed),
            Some(Check::Search(search)) => search_answer(&search, size),
            None => return refuse(&format!("there is no harness or search `{name}`")),
        };
        passed &= answer.passed;
        let Answer { result, words, numbers, .. } = answer;
        println!(
            "{{\"check\":{},\"result\":{},\"words\":{},\"numbers\":{:?},\"seconds\":{:.3}}}",
            quoted(name),
            quoted(result),
            quoted(&words),
            numbers,
            started.elapsed().as_secs_f64()
        );
        // readers of the output must not wait for the last check
        let _ = std::io::stdout().flush();
    }
    if passed { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

enum Check {
    Harness(Harness),
    Search(Search),
}

fn find(name: &str) -> Option<Check> {
    let harness = ledger::harnesses().into_iter().find(|harness| harness.name == name).map(Check::Harness);
    let search = || ledger::rows().iter().flat_map(|row| row.searches).find(|search| search.name == name).copied();
    harness.or_else(|| search().map(Check::Search))
}

struct Answer {
    passed: bool,
    /// `every`, `drawn`, `search`, `refuted`, `vacuous` or `failed`.
    result: &'static str,
    words: String,
    /// Numbers that replay a counterexample.
    numbers: Vec<u32>,
}

fn harness_answer(harness: &Harness, most: u64, seed: u64) -> Answer {
    let answer = |passed, result, words, numbers| Answer { passed, result, words, numbers };
    match harness.check(most, seed) {
        Ok(seen) if seen.complete => answer(true, "every", seen.runs.to_string(), Vec::new()),
        Ok(seen) => answer(true, "drawn", seen.runs.to_string(), Vec::new()),
        Err(Failure::Vacuous) => answer(false, "vacuous", "no run is within the assumptions".into(), Vec::new()),
        Err(Failure::Unreached(region)) => {
            answer(false, "vacuous", format!("no run reaches the region {}", region.name()), Vec::new())
        }
        Err(Failure::Unlisted(region)) => {
            answer(false, "failed", format!("reaches {}, which it does not list", region.name()), Vec::new())
        }
        Err(Failure::Refuted(numbers)) => answer(false, "refuted", said(), numbers),
    }
}

fn search_answer(search: &Search, size: Size) -> Answer {
    match catch_unwind(AssertUnwindSafe(|| (search.run)(size))) {
        Ok(words) => Answer { passed: true, result: "search", words, numbers: Vec::new() },
        Err(_) => Answer { passed: false, result: "failed", words: said(), numbers: Vec::new() },
    }
}

fn replay(name: &str, numbers: &str) -> ExitCode {
    let Some(Check::Harness(harness)) = find(name) else {
        return refuse(&format!("there is no harness `{name}`"));
    };
    let Ok(numbers) = numbers.split(',').map(|number| number.trim().parse()).collect::<Result<Vec<u32>, _>>() else {
        return refuse(&format!("`{numbers}` is not a list of numbers: 1,2,3"));
    };
    println!("{name} with {numbers:?}");
    match catch_unwind(AssertUnwindSafe(|| harness.replay(numbers))) {
        Ok(Some(())) => {
            println!("the property holds for these numbers");
            ExitCode::SUCCESS
        }
        Ok(None) => {
            println!("an assumption does not hold for these numbers: the property is not asked about them");
            ExitCode::SUCCESS
        }
        Err(_) => {
            println!("the property does NOT hold for these numbers");
            ExitCode::FAILURE
        }
    }
}

fn message(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| payload.downcast_ref::<String>().cloned()).unwrap_or_else(|| "a panic without words".into())
}

fn said() -> String {
    LAST_PANIC.lock().map(|said| said.clone()).unwrap_or_default()
}

fn row_json(module: &str, row: &Row) -> String {
    let texts = [
        ("name", row.name),
        ("module", module),
        ("says", row.says),
        ("requirement", row.requirement),
        ("bound", row.bound),
        ("assumes", row.assumes),
        ("suffices", row.suffices),
    ];
    let texts: Vec<String> = texts.iter().map(|(key, text)| format!("{}:{}", quoted(key), quoted(text))).collect();
    let all = ledger::harnesses();
    let harnesses = all.iter().filter(|harness| row.harnesses.contains(&harness.name)).map(|harness| {
        let Harness { name, module, unwind, covers, .. } = harness;
        let covers = list(covers.iter().map(|region| quoted(region.name())));
        let (name, module) = (quoted(name), quoted(module));
        format!("{{\"name\":{name},\"module\":{module},\"unwind\":{unwind},\"covers\":{covers}}}")
    });
    let models = row.models.iter().map(|model| object(&[("engine", model.engine), ("test", model.test)]));
    let mutants = row.mutants.iter().map(|mutant| {
        object(&[
            ("name", mutant.name),
            ("file", mutant.file),
            ("find", mutant.find),
            ("put", mutant.put),
            ("killer", mutant.killer),
        ])
    });
    format!(
        "{{{},\"harnesses\":{},\"searches\":{},\"models\":{},\"mutants\":{}}}",
        texts.join(","),
        list(harnesses),
        list(row.searches.iter().map(|search| quoted(search.name))),
        list(models),
        list(mutants)
    )
}

fn object(fields: &[(&str, &str)]) -> String {
    let fields: Vec<String> = fields.iter().map(|(key, text)| format!("{}:{}", quoted(key), quoted(text))).collect();
    format!("{{{}}}", fields.join(","))
}

fn list(parts: impl Iterator<Item = String>) -> String {
    format!("[{}]", parts.collect::<Vec<_>>().join(","))
}

/// A JSON string.
fn quoted(text: &str) -> String {
    let mut json = String::from("\"");
    for letter in text.chars() {
        match letter {
            '"' => json.push_str("\\\""),
            '\\' => json.push_str("\\\\"),
            '\n' => json.push_str("\\n"),
            control if control < ' ' => json.push_str(&format!("\\u{:04x}", u32::from(control))),
            other => json.push(other),
        }
    }
    json + "\""
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_quoted_as_json_asks() {
        assert_eq!(quoted("a\"b\\c\nd\u{1}ä"), "\"a\\\"b\\\\c\\nd\\u0001ä\"");
    }

    #[test]
    fn every_row_and_every_check_is_found_by_name() {
        for (module, row) in ledger::rows_by_module() {
            assert!(row_json(module, &row).contains(&quoted(row.name)));
            let checks = row.harnesses.iter().copied().chain(row.searches.iter().map(|search| search.name));
            assert!(checks.into_iter().all(|name| find(name).is_some()));
        }
        assert!(find("no-such-check").is_none());
    }
}
