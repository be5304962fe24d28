//! The rows of the ledger as the native runner lists them.
//!
//! Invariant: every field of a row comes from the code of `verification/`; no property is named here.

use serde_json::Value;

/// One property.
#[derive(Clone, Debug)]
pub(crate) struct Row {
    pub(crate) name: String,
    /// The module of `verification/src` that defines it.
    pub(crate) module: String,
    pub(crate) harnesses: Vec<Harness>,
    pub(crate) searches: Vec<String>,
    pub(crate) models: Vec<Model>,
    pub(crate) mutants: Vec<Mutant>,
    /// Every field from the runner.
    pub(crate) fields: Value,
}

/// One harness.
#[derive(Clone, Debug)]
pub(crate) struct Harness {
    pub(crate) name: String,
    /// Its path up to the harness: `retrace_verification::ring`.
    pub(crate) module: String,
    /// One more than the turns of its longest loop.
    pub(crate) unwind: u64,
    /// Regions that a run must reach.
    pub(crate) covers: Vec<String>,
}

/// A test of the thread models.
#[derive(Clone, Debug)]
pub(crate) struct Model {
    pub(crate) engine: String,
    pub(crate) test: String,
}

/// A change to the code that a check must notice.
#[derive(Clone, Debug)]
pub(crate) struct Mutant {
    pub(crate) name: String,
    pub(crate) file: String,
    pub(crate) find: String,
    pub(crate) put: String,
    pub(crate) killer: String,
}

impl Row {
    /// Parses every row of the runner's list.
    ///
    /// # Errors
    /// Where a line is not a valid row.
    pub(crate) fn list(lines: &str) -> Result<Vec<Self>, String> {
        lines
            .lines()
            .map(|line| {
                let fields: Value =
                    serde_json::from_str(line).map_err(|error| format!("the runner's list: {error}"))?;
                Self::of(fields).ok_or_else(|| format!("the runner's list: not a row: {line}"))
            })
            .collect()
    }

    fn of(fields: Value) -> Option<Self> {
        let text = |value: &Value, key: &str| Some(value.get(key)?.as_str()?.to_owned());
        let names = |value: &Value| -> Option<Vec<String>> {
            value.as_array()?.iter().map(|name| Some(name.as_str()?.to_owned())).collect()
        };
        let list = |key: &str| fields.get(key)?.as_array().cloned();
        let harness = |value: &Value| {
            Some(Harness {
                name: text(value, "name")?,
                module: text(value, "module")?,
                unwind: value.get("unwind")?.as_u64()?,
                covers: names(value.get("covers")?)?,
            })
        };
        let model = |value: &Value| Some(Model { engine: text(value, "engine")?, test: text(value, "test")? });
        let mutant = |value: &Value| {
            Some(Mutant {
                name: text(value, "name")?,
                file: text(value, "file")?,
                find: text(value, "find")?,
                put: text(value, "put")?,
                killer: text(value, "killer")?,
            })
        };
        Some(Self {
            name: text(&fields, "name")?,
            module: text(&fields, "module")?,
            harnesses: list("harnesses")?.iter().map(harness).collect::<Option<_>>()?,
            searches: names(fields.get("searches")?)?,
            models: list("models")?.iter().map(model).collect::<Option<_>>()?,
            mutants: list("mutants")?.iter().map(mutant).collect::<Option<_>>()?,
            fields,
        })
    }

    /// Harnesses and searches: what the native runner checks.
    pub(crate) fn native_checks(&self) -> impl Iterator<Item = &str> {
        self.harnesses.iter().map(|harness| harness.name.as_str()).chain(self.searches.iter().map(String::as_str))
    }

    /// Position of a check or mutant in the row.
    pub(crate) fn place(&self, check: &str) -> Option<usize> {
        let models = self.models.iter().map(|model| model.test.as_str());
        let mutants = self.mutants.iter().map(|mutant| mutant.name.as_str());
        self.native_checks().chain(models).chain(mutants).position(|name| name == check)
    }

    /// Whether this check or mutant belongs to the row.
    pub(crate) fn owns(&self, check: &str) -> bool {
        self.place(check).is_some()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A row for tests of other modules.
    pub(crate) fn sample() -> Row {
        let line = r#"{"name":"a-row","module":"ring","says":"It holds","requirement":"REV-2","bound":"none",
            "assumes":"nothing","suffices":"induction","harnesses":[{"name":"h","module":"retrace_verification::ring","unwind":3,"covers":["Full"]}],
            "searches":["s"],"models":[{"engine":"loom","test":"m"}],
            "mutants":[{"name":"x","file":"f","find":"1","put":"2","killer":"h"}]}"#;
        Row::list(&line.replace('\n', " ")).unwrap().remove(0)
    }

    #[test]
    fn a_row_is_read_whole_or_not_at_all() {
        let row = sample();
        assert!(row.owns("h") && row.owns("s") && row.owns("m") && row.owns("x") && !row.owns("y"));
        assert_eq!(row.native_checks().collect::<Vec<_>>(), ["h", "s"]);
        assert!(Row::list("{\"name\":\"a\"}").is_err() && Row::list("x").is_err());
    }
}
