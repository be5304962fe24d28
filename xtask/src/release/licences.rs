//! `cargo xtask licences`: every dependency of the workspaces here has a licence that `deny.toml` allows.
//!
//! Invariant: what the lock files name is what is checked; an expression that is not understood is refused.

use std::path::Path;

use retrace_task_support::process::cargo;
use serde_json::Value;

/// Checks the licences and says whether all are allowed.
pub(crate) fn run(root: &Path) -> bool {
    super::reported("licences", check(root))
}

fn check(root: &Path) -> Result<(), String> {
    let deny = std::fs::read_to_string(root.join("deny.toml")).map_err(|error| format!("deny.toml: {error}"))?;
    let allowed = allowed(&deny);
    let mut refused = 0;
    for manifest in ["Cargo.toml", "crates/firmware/Cargo.toml", "tests/sparkplug-host/Cargo.toml"] {
        let packages = packages(root, manifest)?;
        for (name, licence) in &packages {
            if !satisfies(licence, &allowed) {
                println!("licences: {name}: `{licence}` is not allowed by deny.toml");
                refused += 1;
            }
        }
        println!("licences: {} packages of {manifest}", packages.len());
    }
    if refused == 0 { Ok(()) } else { Err(format!("{refused} packages refused")) }
}

/// The packages that a manifest's lock file names, each with its licence expression.
fn packages(root: &Path, manifest: &str) -> Result<Vec<(String, String)>, String> {
    let mut command = cargo(root, &["metadata", "--format-version", "1", "--locked", "--manifest-path", manifest]);
    let output = command.output().map_err(|error| format!("cargo cannot be run: {error}"))?;
    if !output.status.success() {
        return Err(format!("cargo metadata: {}", String::from_utf8_lossy(&output.stderr).trim()));
    }
    let metadata: Value = serde_json::from_slice(&output.stdout).map_err(|error| format!("cargo metadata: {error}"))?;
    let packages = metadata["packages"].as_array().ok_or("cargo metadata names no packages")?;
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    Ok(packages.iter().map(|package| (text(&package["name"]), text(&package["license"]))).collect())
}

/// The list `allow` of the table `[licenses]`.
fn allowed(deny: &str) -> Vec<&str> {
    let table = deny.split("[licenses]").nth(1).unwrap_or_default();
    let list = table.split_once("allow = [").and_then(|(_, rest)| rest.split_once(']')).map_or("", |(list, _)| list);
    list.lines().filter_map(|line| line.trim().strip_prefix('"')?.split('"').next()).collect()
}

/// Does an SPDX expression of names, AND, OR and one level of brackets hold with these licences? A slash is an old OR.
fn satisfies(expression: &str, allowed: &[&str]) -> bool {
    let one = |name: &str| allowed.contains(&name.trim());
    let either = |part: &str| part.replace('/', " OR ").split(" OR ").any(one);
    // AND binds closer than OR; where it stands beside brackets, every part of it has to hold
    if expression.contains('(') {
        expression.split(" AND ").all(|part| either(part.trim().trim_start_matches('(').trim_end_matches(')')))
    } else {
        expression.replace('/', " OR ").split(" OR ").any(|part| part.split(" AND ").all(one))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_expression_holds_only_with_what_is_allowed() {
        let allowed =
            allowed("[graph]\n[licenses]\nallow = [\n  \"MIT\",\n  \"Zlib\", # why\n]\nother = [\"GPL-3.0-only\"]\n");
        assert_eq!(allowed, ["MIT", "Zlib"]);
        for good in [
            "MIT",
            "MIT OR GPL-3.0-only",
            "Apache-2.0/MIT",
            "(Apache-2.0 OR MIT) AND Zlib",
            "GPL-3.0-only OR MIT AND Zlib",
        ] {
            assert!(satisfies(good, &allowed), "{good}");
        }
        for bad in
            ["", "GPL-3.0-only", "MIT AND GPL-3.0-only", "(Apache-2.0 OR MIT) AND BSD-3-Clause", "Zlib-acknowledgement"]
        {
            assert!(!satisfies(bad, &allowed), "{bad}");
        }
    }
}
