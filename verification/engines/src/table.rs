//! Text printed at the beginning and at the end of a run.
//!
//! Invariant: an engine that did not run has `NOT RUN` in its column, never a pass.

use super::NotRun;
use super::outcome::{Engine, Outcome, Verdict};
use super::rows::Row;

/// The engines with a column of their own.
const COLUMNS: [Engine; 7] =
    [Engine::Native, Engine::Cbmc, Engine::Kani, Engine::Loom, Engine::Shuttle, Engine::Mutants, Engine::CbmcMutants];

/// Names the engines that do not run, and how to get them.
pub(crate) fn not_run(absent: &[NotRun]) {
    for NotRun { engine, why, how } in absent {
        let how = if how.is_empty() { String::new() } else { format!("; to get it: {how}") };
        println!("NOT RUN  {}: {why}{how}", engine.name());
    }
}

/// The engines, the rows and their checks.
pub(crate) fn list(rows: &[Row]) {
    for engine in Engine::ALL {
        println!("engine {:<12} {}", engine.name(), engine.purpose());
    }
    for row in rows {
        println!("{}: {}", row.name, row.fields["says"].as_str().unwrap_or_default());
        for harness in &row.harnesses {
            println!("  harness {} (unwind {}, reaches {})", harness.name, harness.unwind, harness.covers.join(", "));
        }
        row.searches.iter().for_each(|search| println!("  search  {search}"));
        row.models.iter().for_each(|model| println!("  {:<7} {}", model.engine, model.test));
        row.mutants.iter().for_each(|mutant| println!("  mutant  {} (killed by {})", mutant.name, mutant.killer));
    }
}

/// The table at the end, the failures, and again what did not run.
pub(crate) fn result(rows: &[Row], outcomes: &[Outcome], absent: &[NotRun]) {
    let heads = COLUMNS.map(Engine::name);
    println!(
        "\n{:<20} {:>8} {:>9} {:>8} {:>8} {:>8} {:>8} {:>13} {:>8}",
        "row", heads[0], heads[1], heads[2], heads[3], heads[4], heads[5], heads[6], "seconds"
    );
    for row in rows {
        let own: Vec<&Outcome> = outcomes.iter().filter(|outcome| row.owns(&outcome.check)).collect();
        let cells = COLUMNS.map(|engine| cell(row, engine, &own, absent));
        let seconds = own.iter().fold(0.0, |sum, outcome| sum + outcome.seconds);
        println!(
            "{:<20} {:>8} {:>9} {:>8} {:>8} {:>8} {:>8} {:>13} {seconds:>8.1}",
            row.name, cells[0], cells[1], cells[2], cells[3], cells[4], cells[5], cells[6]
        );
    }
    println!("cbmc, kani: proved of harnesses; the others: passed of checks; mutants: killed of tried\n");
    for Outcome { engine, check, words, .. } in outcomes.iter().filter(|outcome| outcome.verdict == Verdict::Failed) {
        println!("{} {check}: {words}", engine.name());
    }
    not_run(absent);
}

/// Number of checks of a row for an engine.
pub(crate) fn size(row: &Row, engine: Engine) -> usize {
    match engine {
        Engine::Native => row.native_checks().count(),
        Engine::Cbmc | Engine::Kani => row.harnesses.len(),
        Engine::Loom | Engine::Shuttle => row.models.iter().filter(|model| model.engine == engine.name()).count(),
        Engine::Mutants => row.mutants.len(),
        Engine::CbmcMutants => {
            let by_harness = |killer: &str| row.harnesses.iter().any(|harness| harness.name == killer);
            row.mutants.iter().filter(|mutant| by_harness(&mutant.killer)).count()
        }
        Engine::Stub | Engine::Miri | Engine::Tsan => 0,
    }
}

fn cell(row: &Row, engine: Engine, own: &[&Outcome], absent: &[NotRun]) -> String {
    let of = size(row, engine);
    if of == 0 {
        return "-".to_owned();
    }
    if absent.iter().any(|absent| absent.engine == engine) {
        return "NOT RUN".to_owned();
    }
    let run: Vec<&&Outcome> = own.iter().filter(|outcome| outcome.engine == engine).collect();
    let good = run.iter().filter(|outcome| matches!(outcome.verdict, Verdict::Proved | Verdict::Passed)).count();
    let failed = run.iter().any(|outcome| outcome.verdict == Verdict::Failed);
    // a quick run tries some of the mutants
    let of = if matches!(engine, Engine::Mutants | Engine::CbmcMutants) { run.len() } else { of };
    format!("{good}/{of}{}", if failed { " FAIL" } else { "" })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rows::tests::sample;

    #[test]
    fn a_cell_counts_what_ran_and_says_what_did_not() {
        let row = sample();
        let outcome = |engine, check: &str, verdict| Outcome {
            engine,
            check: check.into(),
            verdict,
            words: String::new(),
            seconds: 1.0,
        };
        let seen = [
            outcome(Engine::Native, "h", Verdict::Passed),
            outcome(Engine::Native, "s", Verdict::Failed),
            outcome(Engine::Cbmc, "h", Verdict::Proved),
        ];
        let seen: Vec<&Outcome> = seen.iter().collect();
        let absent = [NotRun { engine: Engine::Kani, why: "x".into(), how: String::new() }];
        let told = COLUMNS.map(|engine| cell(&row, engine, &seen, &absent));
        assert_eq!(told, ["1/2 FAIL", "1/1", "NOT RUN", "0/1", "-", "0/0", "0/0"]);
    }
}
