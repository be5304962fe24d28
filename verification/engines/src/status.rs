//! The status of a row in the ledger, from its results.
//!
//! Invariant: a row is called proved only where every one of its harnesses was, by the same engine.

use super::outcome::Engine;
use serde_json::Value;

/// Results of a row by one engine.
fn by(row: &Value, engine: Engine) -> impl Iterator<Item = &Value> {
    let results = row["results"].as_array().map_or(&[][..], Vec::as_slice);
    results.iter().filter(move |result| result["engine"] == engine.name())
}

/// Status of a row: what proved it, what else passed, or that something failed.
pub(crate) fn of_row(row: &Value) -> String {
    let results = row["results"].as_array().map_or(&[][..], Vec::as_slice);
    if results.iter().any(|result| result["verdict"] == "FAILED") {
        return "FAILED".to_owned();
    }
    let harnesses = row["harnesses"].as_array().map_or(0, Vec::len);
    let proved = |engine| by(row, engine).filter(|result| result["verdict"] == "proved").count();
    let whole: Vec<&str> = [(Engine::Cbmc, "CBMC"), (Engine::Kani, "Kani")]
        .into_iter()
        .filter(|(engine, _)| harnesses > 0 && proved(*engine) == harnesses)
        .map(|(_, name)| name)
        .collect();
    let has_searches = row["searches"].as_array().is_some_and(|searches| !searches.is_empty());
    let others: Vec<&str> = [(Engine::Native, "native"), (Engine::Loom, "loom"), (Engine::Shuttle, "shuttle")]
        .into_iter()
        .filter(|(engine, _)| by(row, *engine).next().is_some())
        .filter(|(engine, _)| whole.is_empty() || *engine != Engine::Native || has_searches)
        .map(|(_, name)| name)
        .collect();
    let some = proved(Engine::Cbmc).max(proved(Engine::Kani));
    let mut parts = Vec::new();
    if !whole.is_empty() {
        parts.push(format!("proved ({})", whole.join(", ")));
    } else if some > 0 {
        parts.push(format!("{some} of {harnesses} harnesses proved"));
    }
    if !others.is_empty() {
        parts.push(format!("passed ({})", others.join(", ")));
    }
    if parts.is_empty() { "NOT RUN".to_owned() } else { parts.join(", ") }
}

/// The mutants of a row that were killed, of those that were tried: natively, by a thread model, by CBMC.
pub(crate) fn kills(row: &Value) -> [(&'static str, usize, usize); 4] {
    let mutants = row["mutants"].as_array().map_or(&[][..], Vec::as_slice);
    let models = row["models"].as_array().map_or(&[][..], Vec::as_slice);
    let killer_of = |result: &Value| {
        let mutant = mutants.iter().find(|mutant| mutant["name"] == result["check"]);
        let model = mutant.and_then(|mutant| models.iter().find(|model| model["test"] == mutant["killer"]));
        model.and_then(|model| model["engine"].as_str()).unwrap_or("native").to_owned()
    };
    let count = |name: &'static str, results: Vec<&Value>| {
        (name, results.iter().filter(|result| result["verdict"] == "passed").count(), results.len())
    };
    let killed_by = |name| count(name, by(row, Engine::Mutants).filter(|result| killer_of(result) == name).collect());
    [
        killed_by("native"),
        killed_by("loom"),
        killed_by("shuttle"),
        count("CBMC", by(row, Engine::CbmcMutants).collect()),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rows::tests::sample;
    use serde_json::json;

    fn row(results: &[(Engine, &str, &str)]) -> Value {
        let mut row = sample().fields;
        let result = |(engine, check, verdict): &(Engine, &str, &str)| {
            let engine = engine.name();
            json!({"engine": engine, "check": check, "verdict": verdict, "words": "w", "seconds": 1.2})
        };
        row["results"] = results.iter().map(result).collect();
        row
    }

    #[test]
    fn a_row_is_called_proved_only_where_every_harness_was() {
        let (native, cbmc) = ((Engine::Native, "h", "passed"), (Engine::Cbmc, "h", "proved"));
        assert_eq!(of_row(&row(&[])), "NOT RUN");
        assert_eq!(of_row(&row(&[native])), "passed (native)");
        assert_eq!(of_row(&row(&[native, cbmc])), "proved (CBMC), passed (native)");
        assert_eq!(of_row(&row(&[native, (Engine::Cbmc, "h", "open")])), "passed (native)");
        assert_eq!(of_row(&row(&[cbmc, native, (Engine::Mutants, "x", "FAILED")])), "FAILED");
    }

    #[test]
    fn kills_are_counted_for_the_engine_that_killed() {
        let mut row = row(&[
            (Engine::Mutants, "x", "passed"),
            (Engine::Mutants, "y", "passed"),
            (Engine::Mutants, "z", "FAILED"),
            (Engine::CbmcMutants, "x", "passed"),
        ]);
        let mutant = |name: &str, killer: &str| json!({"name": name, "killer": killer});
        row["mutants"] = json!([mutant("x", "h"), mutant("y", "m"), mutant("z", "s")]);
        assert_eq!(kills(&row), [("native", 1, 2), ("loom", 1, 1), ("shuttle", 0, 0), ("CBMC", 1, 1)]);
    }
}
