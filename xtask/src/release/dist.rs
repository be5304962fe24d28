//! `cargo xtask dist`: archives of the command for computers without a Rust toolchain.
//!
//! Invariant: every target that was not built is named with the reason; an archive holds nothing of the computer that
//! built it but the code.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use retrace_task_support::process::{self, cargo};
use serde_json::Value;

use crate::suite;

/// The targets of static binaries.
const STATIC_TARGETS: [&str; 2] = ["x86_64-unknown-linux-musl", "aarch64-unknown-linux-musl"];
/// Files of the checkout that are packed, and where.
const FILES: [(&str, &str); 7] = [
    ("README.md", ""),
    ("CHANGELOG.md", ""),
    ("LICENSE-APACHE", ""),
    ("LICENSE-MIT", ""),
    ("dist/INSTALL.md", ""),
    ("dist/99-retrace.rules", ""),
    ("dist/retrace-sim-card.service", ""),
];
/// Folders of the checkout that are packed.
const FOLDERS: [&str; 2] = ["docs", "examples"];
/// Completion scripts: the shell, and the name by which it finds the script.
const COMPLETIONS: [(&str, &str); 3] = [("bash", "retrace.bash"), ("zsh", "_retrace"), ("fish", "retrace.fish")];

/// Builds the archives and says whether there is at least one and none failed.
pub(crate) fn run(root: &Path) -> bool {
    super::reported("dist", build(root))
}

fn build(root: &Path) -> Result<(), String> {
    let host = rustc(&["-vV"])?.lines().find_map(|line| line.strip_prefix("host: ").map(str::to_owned));
    let host = host.ok_or("rustc does not name its host")?;
    let mut targets = Vec::new();
    for target in STATIC_TARGETS {
        if is_installed(target)? {
            targets.push(target.to_owned());
        } else {
            println!("dist: NOT BUILT {target}: it is not installed; `rustup target add {target}` installs it");
        }
    }
    if targets.is_empty() {
        println!("dist: no target of a static binary is installed: building for {host}, dynamically linked");
        targets.push(host);
    }
    let folder = root.join("target/dist");
    let _ = fs::remove_dir_all(&folder);
    let texts = folder.join("texts");
    write_texts(root, &texts)?;
    let (mut archives, mut failed) = (Vec::new(), Vec::new());
    for target in &targets {
        match binary(root, target).and_then(|binary| archive(root, &folder, &texts, target, &binary)) {
            Ok(archive) => archives.push(archive),
            Err(reason) => {
                println!("dist: NOT BUILT {target}: {reason}");
                failed.push(target.as_str());
            }
        }
    }
    let _ = fs::remove_dir_all(&texts);
    if !archives.is_empty() {
        let sums = output(Command::new("sha256sum").args(&archives).current_dir(&folder))?;
        fs::write(folder.join("SHA256SUMS"), &sums).map_err(|error| format!("SHA256SUMS: {error}"))?;
        print!("{sums}");
    }
    if failed.is_empty() { Ok(()) } else { Err(format!("failed for {}", failed.join(", "))) }
}

/// Is the standard library of a target installed?
fn is_installed(target: &str) -> Result<bool, String> {
    let folder = PathBuf::from(rustc(&["--print", "target-libdir", "--target", target])?.trim());
    Ok(fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some()))
}

/// Builds the command for a target.
fn binary(root: &Path, target: &str) -> Result<PathBuf, String> {
    println!("dist: building for {target}");
    let mut command = cargo(root, &["build", "--release", "--locked", "--package", "retrace-cli", "--target", target]);
    command.args(["--message-format", "json-render-diagnostics"]);
    command.env("CARGO_PROFILE_RELEASE_STRIP", "debuginfo").env("RUSTFLAGS", path_flags(root));
    // rustc's own linker links for the other processor, too
    let variable = format!("CARGO_TARGET_{}_LINKER", target.to_uppercase().replace('-', "_"));
    if target.ends_with("-musl") && !target.starts_with(std::env::consts::ARCH) && std::env::var_os(&variable).is_none()
    {
        command.env(variable, "rust-lld");
    }
    // ring has parts in C and assembler: the compiler of this computer, or clang for another processor.
    let compiler = format!("CC_{}", target.replace('-', "_"));
    if target.ends_with("-musl") && std::env::var_os(&compiler).is_none() {
        let is_own = target.starts_with(std::env::consts::ARCH);
        command.env(compiler, if is_own { "cc" } else { "clang" });
    }
    process::build(&mut command)
}

/// Flags that keep paths of this computer out of the binary.
fn path_flags(root: &Path) -> String {
    let home = std::env::var_os("HOME").map(PathBuf::from).unwrap_or_default();
    let cargo = std::env::var_os("CARGO_HOME").map_or_else(|| home.join(".cargo"), PathBuf::from);
    let mut flags = std::env::var("RUSTFLAGS").unwrap_or_default();
    for (path, name) in [(cargo.join("registry/src"), "registry"), (root.to_path_buf(), "retrace")] {
        let _ = write!(flags, " --remap-path-prefix={}={name}", path.display());
    }
    flags.trim_start().to_owned()
}

/// What all archives share: completions, manual pages, licences of others.
fn write_texts(root: &Path, texts: &Path) -> Result<(), String> {
    let command = suite::build_command(root)?;
    let completions = texts.join("completions");
    fs::create_dir_all(&completions).map_err(|error| format!("{}: {error}", completions.display()))?;
    for (shell, name) in COMPLETIONS {
        let script = output(Command::new(&command).args(["completions", shell]))?;
        fs::write(completions.join(name), script).map_err(|error| format!("{name}: {error}"))?;
    }
    output(Command::new(&command).arg("man").arg(texts.join("man")))?;
    let licences = third_party(root)?;
    fs::write(texts.join("THIRD-PARTY.txt"), licences).map_err(|error| format!("THIRD-PARTY.txt: {error}"))
}

/// The licences of everything that is linked into the command, with their texts.
fn third_party(root: &Path) -> Result<String, String> {
    let mut tree =
        cargo(root, &["tree", "--locked", "--package", "retrace-cli", "--edges", "normal", "--prefix", "none"]);
    let linked = output(tree.args(["--target", STATIC_TARGETS[0], "--format", "{p}"]))?;
    // `name v1.2.3 (proc-macro)`
    let linked: BTreeSet<(&str, &str)> = linked.lines().filter_map(|line| line.split_once(" v")).collect();
    let linked: BTreeSet<_> =
        linked.into_iter().map(|(name, version)| (name, version.split(' ').next().unwrap_or_default())).collect();
    let metadata = output(&mut cargo(root, &["metadata", "--format-version", "1", "--locked"]))?;
    let metadata: Value = serde_json::from_str(&metadata).map_err(|error| format!("cargo metadata: {error}"))?;
    let mut text = String::from(
        "Libraries in the binary `retrace`, and the macros that generated parts of it, with their licences. Each one \
            is used unchanged; its source is at https://crates.io/crates/NAME/VERSION.\n",
    );
    for package in metadata["packages"].as_array().into_iter().flatten().filter(|package| package["source"].is_string())
    {
        let field = |name: &str| package[name].as_str().unwrap_or_default();
        if linked.contains(&(field("name"), field("version"))) {
            let _ = write!(text, "\n=== {} {}: {}\n", field("name"), field("version"), field("license"));
            licence_texts(Path::new(field("manifest_path")).parent().unwrap_or(root), &mut text);
        }
    }
    Ok(text)
}

/// The licence files of a package.
fn licence_texts(folder: &Path, into: &mut String) {
    let mut files: Vec<PathBuf> = fs::read_dir(folder)
        .into_iter()
        .flatten()
        .filter_map(Result::ok)
        .map(|entry| entry.path())
        .filter(|path| path.is_file() && path.file_name().is_some_and(|name| is_licence(&name.to_string_lossy())))
        .collect();
    files.sort();
    for file in files {
        if let Ok(text) = fs::read_to_string(&file) {
            let name = file.file_name().unwrap_or_default().to_string_lossy();
            let _ = write!(into, "\n--- {name}\n\n{}\n", text.trim());
        }
    }
}

/// Is a file of this name a licence?
fn is_licence(name: &str) -> bool {
    let name = name.to_ascii_uppercase();
    ["LICENSE", "LICENCE", "COPYING", "NOTICE", "UNLICENSE", "COPYRIGHT"].iter().any(|word| name.starts_with(word))
}

/// Packs one archive and returns its name.
fn archive(root: &Path, folder: &Path, texts: &Path, target: &str, binary: &Path) -> Result<String, String> {
    let name = format!("retrace-{}-{target}", env!("CARGO_PKG_VERSION"));
    let content = folder.join(&name);
    copy_folder(texts, &content)?;
    for (path, place) in FILES {
        let file = Path::new(path).file_name().unwrap_or_default();
        copy(&root.join(path), &content.join(place).join(file))?;
    }
    for path in FOLDERS {
        copy_folder(&root.join(path), &content.join(path))?;
    }
    copy(binary, &content.join("retrace"))?;
    let archive = format!("{name}.tar.gz");
    let mut tar = Command::new("tar");
    tar.args(["--sort=name", "--owner=0", "--group=0", "--numeric-owner", "--mtime=@0", "-czf"]);
    output(tar.arg(&archive).arg(&name).env("GZIP", "-n").current_dir(folder))?;
    Ok(archive)
}

fn copy_folder(from: &Path, to: &Path) -> Result<(), String> {
    let entries = fs::read_dir(from).map_err(|error| format!("{}: {error}", from.display()))?;
    for path in entries.filter_map(Result::ok).map(|entry| entry.path()) {
        let place = to.join(path.file_name().unwrap_or_default());
        if path.is_dir() { copy_folder(&path, &place)? } else { copy(&path, &place)? }
    }
    Ok(())
}

fn copy(from: &Path, to: &Path) -> Result<(), String> {
    let made = to.parent().map_or(Ok(()), fs::create_dir_all).and_then(|()| fs::copy(from, to));
    made.map(|_| ()).map_err(|error| format!("{}: {error}", from.display()))
}

fn rustc(arguments: &[&str]) -> Result<String, String> {
    output(Command::new(std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into())).args(arguments))
}

/// What a command prints; its failure is an error.
fn output(command: &mut Command) -> Result<String, String> {
    let name = command.get_program().to_string_lossy().into_owned();
    let output = command.output().map_err(|error| format!("{name} cannot be run: {error}"))?;
    if !output.status.success() {
        return Err(format!("{name}: {}", String::from_utf8_lossy(&output.stderr).trim()));
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_licences_are_known_by_their_names() {
        assert!(["LICENSE", "LICENSE-MIT", "license-apache.txt", "COPYING.md"].iter().all(|name| is_licence(name)));
        assert!(!is_licence("README.md"));
    }

    #[test]
    fn a_target_that_there_is_none_of_is_an_error() {
        assert!(is_installed("no-such-target").is_err());
    }
}
