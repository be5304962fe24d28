//! `docs/json-events.md` as a check: every object that a command prints must have the fields that the page lists, with
//! their types.
//!
//! Invariant: a field that the page does not list is an error, and so is a listed field that is missing.

use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// Heading of the fields that every event has.
const COMMON: &str = "Every event";
/// Heading of the events of a pause, which have common fields of their own.
const DNC_EVENTS: &str = "DNC events";

/// The fields of one object: path and type, such as `outputs[].channel` and `integer or null`.
type Fields = BTreeMap<String, String>;

/// The page, section by section.
#[derive(Debug)]
pub struct JsonPage {
    sections: BTreeMap<String, Fields>,
    events: BTreeMap<String, Fields>,
}

impl JsonPage {
    /// Parses the page.
    ///
    /// # Panics
    /// If a field is listed twice in a section.
    #[must_use]
    pub fn read() -> Self {
        Self::parse(include_str!("../../docs/json-events.md"))
    }

    fn parse(text: &str) -> Self {
        let mut page = Self { sections: BTreeMap::new(), events: BTreeMap::new() };
        let (mut section, mut event) = (String::new(), None::<String>);
        for line in text.lines() {
            if let Some(heading) = line.strip_prefix("## ") {
                (section, event) = (heading.replace('`', ""), None);
                page.sections.entry(section.clone()).or_default();
            } else if let Some(heading) = line.strip_prefix("### ") {
                let name = heading.replace('`', "");
                assert!(page.events.insert(name.clone(), Fields::new()).is_none(), "the event {name} is listed twice");
                event = Some(name);
            } else if let Some((paths, kind)) = row(line) {
                let fields = match &event {
                    Some(name) => page.events.get_mut(name),
                    None => page.sections.get_mut(&section),
                };
                let fields = fields.expect("a table stands behind a heading");
                for path in paths {
                    assert!(fields.insert(path.clone(), kind.clone()).is_none(), "{section}: {path} is listed twice");
                }
            }
        }
        page.share_dnc_fields(text);
        page
    }

    /// Adds the fields that all DNC events have to each of them.
    fn share_dnc_fields(&mut self, text: &str) {
        let (_, behind) = text.split_once(&format!("## {DNC_EVENTS}\n")).expect("the DNC events");
        let behind = behind.split("\n## ").next().unwrap_or_default();
        let shared = self.sections[DNC_EVENTS].clone();
        for name in behind.lines().filter_map(|line| line.strip_prefix("### ")) {
            let fields = self.events.get_mut(&name.replace('`', "")).expect("the page has the event");
            fields.extend(shared.clone());
        }
    }

    /// Names of all events.
    #[must_use]
    pub fn event_names(&self) -> BTreeSet<&str> {
        self.events.keys().map(String::as_str).collect()
    }

    /// Checks an event of a run.
    ///
    /// # Errors
    /// The difference from the page.
    pub fn check_event(&self, event: &Value) -> Result<(), String> {
        let name = event["event"].as_str().ok_or_else(|| format!("no event: {event}"))?;
        let own = self.events.get(name).ok_or_else(|| format!("the page has no event {name}: {event}"))?;
        let mut fields = self.sections[COMMON].clone();
        fields.extend(own.clone());
        check(&fields, event).map_err(|error| format!("event {name}: {error}"))
    }

    /// Checks an object against the section with this heading.
    ///
    /// # Errors
    /// The difference from the page.
    pub fn check_section(&self, heading: &str, object: &Value) -> Result<(), String> {
        let fields = self.sections.get(heading).ok_or_else(|| format!("the page has no section {heading}"))?;
        check(fields, object).map_err(|error| format!("{heading}: {error}"))
    }

    /// Checks an object that has only some of the section's fields.
    ///
    /// # Errors
    /// The difference from the page.
    pub fn check_part(&self, heading: &str, object: &Value, part: &[&str]) -> Result<(), String> {
        let fields = self.sections.get(heading).ok_or_else(|| format!("the page has no section {heading}"))?;
        let is_of_part = |path: &str| part.contains(&path.split(['.', '[']).next().unwrap_or_default());
        let fields = fields.iter().filter(|(path, _)| is_of_part(path));
        check(&fields.map(|(path, kind)| (path.clone(), kind.clone())).collect(), object)
            .map_err(|error| format!("{heading}: {error}"))
    }
}

/// The paths and the type of a row of a table; `None` for its head and for other lines.
fn row(line: &str) -> Option<(Vec<String>, String)> {
    let mut cells = line.strip_prefix("| `")?.split(" | ");
    let paths = cells.next()?.split(", ").map(|path| path.replace('`', "")).collect();
    Some((paths, cells.next()?.trim().to_owned()))
}

fn check(fields: &Fields, object: &Value) -> Result<(), String> {
    let mut seen = BTreeSet::new();
    check_fields(fields, "", object, &mut seen)?;
    // A field of an array's element, of a map, or of a nullable object need not occur.
    let is_owed = |path: &str| {
        let mut parents = path.match_indices(['.', '[']).map(|(at, _)| &path[..at]);
        parents.all(|parent| fields.get(parent).is_some_and(|kind| kind == "object"))
    };
    match fields.keys().find(|path| !path.contains('<') && is_owed(path) && !seen.contains(path.as_str())) {
        Some(missing) => Err(format!("`{missing}` is missing in {object}")),
        None => Ok(()),
    }
}

fn check_fields<'f>(fields: &'f Fields, at: &str, object: &Value, seen: &mut BTreeSet<&'f str>) -> Result<(), String> {
    let Value::Object(members) = object else { return Err(format!("`{at}` is not an object: {object}")) };
    for (key, value) in members {
        let below = |key: &str| if at.is_empty() { key.to_owned() } else { format!("{at}.{key}") };
        let named = match key.as_str() {
            axis if axis.len() == 1 && fields.contains_key(&below("<axis>")) => below("<axis>"),
            number if number.parse::<u64>().is_ok() => below("<number>"),
            other => below(other),
        };
        let Some((path, kind)) = fields.get_key_value(&named) else {
            return Err(format!("the page has no field `{named}` in {object}"));
        };
        seen.insert(path);
        check_value(fields, path, kind, value, seen)?;
    }
    Ok(())
}

fn check_value<'f>(
    fields: &'f Fields,
    path: &str,
    kind: &str,
    value: &Value,
    seen: &mut BTreeSet<&'f str>,
) -> Result<(), String> {
    if kind == "any" || kind.ends_with(" or null") && value.is_null() {
        return Ok(());
    }
    let kind = kind.strip_suffix(" or null").unwrap_or(kind);
    if let Some(element) = kind.strip_prefix("array of ") {
        let Value::Array(elements) = value else { return Err(format!("`{path}` is not an array: {value}")) };
        let path = format!("{path}[]");
        return elements.iter().try_for_each(|value| check_value(fields, &path, element, value, seen));
    }
    let fits = match kind {
        "integer" => value.is_i64() || value.is_u64(),
        "number" => value.is_number(),
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "object" => return check_fields(fields, path, value, seen),
        unknown => return Err(format!("`{path}`: the page has the type {unknown}, which is none")),
    };
    if fits { Ok(()) } else { Err(format!("`{path}` is not of the type {kind}: {value}")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    const PAGE: &str = "## Every event\n\n| field | type |\n|---|---|\n| `event` | string | | |\n\n## Events\n\n### \
        `one`\n\n\
        | `list` | array of object | | |\n| `list[].n` | integer | | |\n\n### `two`\n\n| `x` | number or null | mm | \
        |\n\n\
        ## DNC events\n\n| `flag` | boolean | | |\n\n### `three`\n\n## Report\n\n| `by` | object | | |\n| `by.<axis>` \
        | number | | |\n";

    #[test]
    fn objects_are_held_against_the_page() {
        let page = JsonPage::parse(PAGE);
        for good in [
            json!({"event": "one", "list": [{"n": 1}, {"n": -2}]}),
            json!({"event": "one", "list": []}),
            json!({"event": "two", "x": null}),
            json!({"event": "two", "x": 1.5}),
            json!({"event": "three", "flag": true}),
        ] {
            assert_eq!(page.check_event(&good), Ok(()));
        }
        for bad in [
            json!({"event": "four"}),
            json!({"event": "one"}),
            json!({"event": "one", "list": [{"n": 1.5}]}),
            json!({"event": "one", "list": [{"m": 1}]}),
            json!({"event": "two", "x": "1"}),
            json!({"event": "two", "x": 1, "y": 2}),
            json!({"event": "three"}),
        ] {
            assert!(page.check_event(&bad).is_err(), "{bad}");
        }
        assert_eq!(page.check_section("Report", &json!({"by": {"x": 1, "z": 2.5}})), Ok(()));
        assert!(page.check_section("Report", &json!({"by": {"x": "1"}})).is_err());
        assert!(page.check_section("Report", &json!({})).is_err());
    }

    #[test]
    fn the_page_can_be_read() {
        assert!(JsonPage::read().event_names().contains("retrace_barrier"));
    }
}
