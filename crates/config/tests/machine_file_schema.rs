//! The JSON schema of the machine file: the one in `docs/` is that of the code, and the machine files of the project
//! match it.
//!
//! Invariant: only `RETRACE_BLESS=1` rewrites the schema.

use std::fs;
use std::path::Path;

use retrace_config::{MachineConfig, machine_file_schema};
use serde_json::Value;

const SCHEMA: &str = "../../docs/machine-file.schema.json";

#[test]
fn the_schema_in_the_docs_is_that_of_the_code() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(SCHEMA);
    let text = serde_json::to_string_pretty(&machine_file_schema()).expect("a schema can be written") + "\n";
    if std::env::var_os("RETRACE_BLESS").is_some() {
        fs::write(&path, &text).expect("the schema can be written");
    }
    let found = fs::read_to_string(&path).unwrap_or_default();
    assert!(
        found == text,
        "the code has another schema; to write it: {}",
        "RETRACE_BLESS=1 cargo test -p retrace-config --test machine_file_schema"
    );
}

/// Whether a value fits a schema: types, keys, required keys, values of enumerations and bounds. As much of JSON schema
/// as the file uses.
fn fits(root: &Value, schema: &Value, value: &Value, at: &str) -> Result<(), String> {
    if let Some(name) = schema["$ref"].as_str().and_then(|name| name.strip_prefix("#/$defs/")) {
        fits(root, &root["$defs"][name], value, at)?;
    }
    for key in ["anyOf", "oneOf"] {
        if let Some(some) = schema[key].as_array() {
            let any = some.iter().any(|one| fits(root, one, value, at).is_ok());
            if !any {
                return Err(format!("{at}: {value} fits no variant"));
            }
        }
    }
    let types: Vec<&str> = match &schema["type"] {
        Value::String(one) => vec![one],
        Value::Array(some) => some.iter().filter_map(Value::as_str).collect(),
        _ => Vec::new(),
    };
    let has_type = |name: &&str| match *name {
        "number" => value.is_number(),
        "integer" => value.is_i64() || value.is_u64(),
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        "null" => value.is_null(),
        _ => false,
    };
    if !types.is_empty() && !types.iter().any(has_type) {
        return Err(format!("{at}: {value} is not of the type {types:?}"));
    }
    if schema.get("const").is_some_and(|only| only != value) {
        return Err(format!("{at}: {value} is not {}", schema["const"]));
    }
    if schema["enum"].as_array().is_some_and(|some| !some.contains(value)) {
        return Err(format!("{at}: {value} is not one of {}", schema["enum"]));
    }
    let (minimum, maximum) = (&schema["minimum"], &schema["maximum"]);
    let is_outside = |number: f64| {
        minimum.as_f64().is_some_and(|least| number < least) || maximum.as_f64().is_some_and(|most| number > most)
    };
    if value.as_f64().is_some_and(is_outside) {
        return Err(format!("{at}: {value} is out of {minimum} … {maximum}"));
    }
    if let Some(elements) = value.as_array() {
        elements.iter().try_for_each(|element| fits(root, &schema["items"], element, &format!("{at}[]")))?;
    }
    if let (Some(members), true) = (value.as_object(), types.contains(&"object")) {
        for (key, member) in members {
            let of = match (&schema["properties"][key], &schema["additionalProperties"]) {
                (Value::Null, Value::Bool(false)) => return Err(format!("{at}.{key}: no such key")),
                (Value::Null, additional) => additional,
                (property, _) => property,
            };
            fits(root, of, member, &format!("{at}.{key}"))?;
        }
        let required = schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str);
        if let Some(missing) = required.into_iter().find(|key| !members.contains_key(*key)) {
            return Err(format!("{at}.{missing} is missing"));
        }
    }
    Ok(())
}

fn machine_files() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folders =
        ["../cli/src/machine", "../../examples"].map(|folder| fs::read_dir(root.join(folder)).expect("a folder"));
    let entries = folders.into_iter().flatten().map(|entry| entry.expect("an entry").path());
    let files = entries.filter(|path| path.extension().is_some_and(|extension| extension == "toml"));
    files.map(|path| (path.display().to_string(), fs::read_to_string(path).expect("a machine file"))).collect()
}

#[test]
fn the_machine_files_of_the_project_fit_the_schema() {
    let (schema, files) = (machine_file_schema(), machine_files());
    assert!(files.len() >= 8, "{files:?}");
    for (name, text) in files {
        let file: Value = toml::from_str(&text).unwrap_or_else(|error| panic!("{name}: {error}"));
        fits(&schema, &schema, &file, "file").unwrap_or_else(|error| panic!("{name}: {error}"));
    }
}

#[test]
fn the_schema_refuses_what_the_code_refuses() {
    let schema = machine_file_schema();
    for wrong in [
        "nam = \"x\"",
        "name = 1",
        "control_period_ms = 0.01",
        "look_ahead_s = 20.0",
        "retrace_outputs = \"auto\"",
        "[[cutter]]\nname = \"torch\"\nkind = \"torch\"",
        "[[cutter]]\nname = \"torch\"\nkind = \"lamp\"\nfire = 3",
        "[[card.input]]\nnumber = 1\nuse = \"limit\"",
        "[wheel]\nfull_rate_counts_per_s = 0.5",
        "[code.M3]\nclass = \"none\"",
        "[code.M3]\nin_reverse = \"as is\"",
    ] {
        let value: Value = toml::from_str(wrong).expect("TOML");
        assert!(fits(&schema, &schema, &value, "file").is_err(), "{wrong}");
        assert!(MachineConfig::parse(wrong, "file").is_err(), "{wrong}");
    }
    let right: Value = toml::from_str("name = \"x\"\n[code.M3]\nin_reverse = \"unchanged\"").expect("TOML");
    assert_eq!(fits(&schema, &schema, &right, "file"), Ok(()));
}
