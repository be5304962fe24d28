//! `cargo xtask package`: every crate that could be published packages, together with those that it needs.
//!
//! Cargo resolves unpublished crates against each other only if they may be published. The check therefore runs in a copy of the
//! checkout in which `publish` is true.
//!
//! Invariant: nothing is published, and the checkout is left as it is.

use std::path::Path;

use crate::tree;

/// Packages that are never published.
const INTERNAL: [&str; 5] = ["xtask", "retrace-tests", "retrace-verification", "retrace-loom", "retrace-shuttle"];

/// Packages everything and says whether that went well.
pub(crate) fn run(root: &Path) -> bool {
    super::reported("package", package(root))
}

fn package(root: &Path) -> Result<(), String> {
    let copy = root.join("target/package-check");
    tree::mirror(root, &copy)?;
    let manifest = copy.join("Cargo.toml");
    let text = std::fs::read_to_string(&manifest).map_err(|error| format!("Cargo.toml: {error}"))?;
    let open = text.replacen("\npublish = false\n", "\npublish = true\n", 1);
    std::fs::write(&manifest, open).map_err(|error| format!("{}: {error}", manifest.display()))?;
    let mut command = super::cargo(&copy);
    command.args(["package", "--workspace", "--no-verify", "--allow-dirty", "--locked"]);
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
