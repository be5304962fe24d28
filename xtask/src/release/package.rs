//! `cargo xtask package`: every crate that could be published packages, together with those that it needs.
//!
//! Cargo resolves unpublished crates against each other only if they may be published. The check therefore runs in a
//! copy of the checkout in which `publish` is true.
//!
//! Invariant: nothing is published, and the checkout is left as it is.

use std::path::Path;

use serde_json::Value;

use retrace_task_support::{process::cargo, tree};

/// Packages that are never published.
const INTERNAL: [&str; 9] = [
    "xtask",
    "retrace-task-support",
    "retrace-bench",
    "retrace-tests",
    "cut-judge",
    "retrace-verification",
    "retrace-verify",
    "retrace-loom",
    "retrace-shuttle",
];

/// Packages everything and says whether that went well.
pub(crate) fn run(root: &Path) -> bool {
    super::reported("package", package(root))
}

fn package(root: &Path) -> Result<(), String> {
    let mut metadata = cargo(root, &["metadata", "--format-version", "1", "--locked", "--no-deps"]);
    let metadata = metadata.output().map_err(|error| format!("cargo cannot be run: {error}"))?;
    let metadata: Value =
        serde_json::from_slice(&metadata.stdout).map_err(|error| format!("cargo metadata: {error}"))?;
    let missing: Vec<String> = metadata["packages"].as_array().into_iter().flatten().flat_map(missing).collect();
    if !missing.is_empty() {
        missing.iter().for_each(|what| println!("package: {what}"));
        return Err("a registry shows a crate by its description, keywords, categories and README.md".to_owned());
    }
    let copy = root.join("target/package-check");
    tree::mirror(root, &copy)?;
    let manifest = copy.join("Cargo.toml");
    let text = std::fs::read_to_string(&manifest).map_err(|error| format!("Cargo.toml: {error}"))?;
    let open = text.replacen("\npublish = false\n", "\npublish = true\n", 1);
    std::fs::write(&manifest, open).map_err(|error| format!("{}: {error}", manifest.display()))?;
    let mut command = cargo(&copy, &["package", "--workspace", "--no-verify", "--allow-dirty", "--locked"]);
    command.args(INTERNAL.iter().flat_map(|name| ["--exclude", name]));
    // beside the copy: a copy holds nothing but the files of the checkout
    let target = root.join("target/packages");
    command.env("CARGO_TARGET_DIR", &target);
    if !super::succeeds(&mut command) {
        return Err("cargo package failed".to_owned());
    }
    println!("package: the archives are in {}", target.join("package").display());
    Ok(())
}

/// What a package's manifest lacks for a registry.
fn missing(package: &Value) -> Vec<String> {
    let name = package["name"].as_str().unwrap_or_default();
    if INTERNAL.contains(&name) {
        return Vec::new();
    }
    let list = |key: &str| package[key].as_array().map_or(0, Vec::len);
    let has_text = |key: &str| package[key].as_str().is_some_and(|text| !text.is_empty());
    let checks = [
        (has_text("description"), "a description"),
        (has_text("readme"), "a readme"),
        (has_text("license"), "a licence"),
        ((1..=5).contains(&list("keywords")), "one to five keywords"),
        ((1..=5).contains(&list("categories")), "one to five categories"),
    ];
    checks.iter().filter(|(is_there, _)| !is_there).map(|(_, what)| format!("{name} has to have {what}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_package_without_a_description_is_named_and_an_internal_one_is_not() {
        let package = |name: &str| {
            json!({"name": name, "description": null, "readme": "README.md", "license": "MIT",
                   "keywords": ["cnc"], "categories": []})
        };
        let found = missing(&package("retrace-new"));
        assert_eq!(found, ["retrace-new has to have a description", "retrace-new has to have one to five categories"]);
        assert!(missing(&package("xtask")).is_empty());
    }
}
