//! Finding the optional engines on this machine.
//!
//! Invariant: the search for an engine starts nothing that could download one.

use retrace_task_support::tools::{home, linker, on_path, program, result, sysroot, toolbox, variable};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Everything the CBMC lane needs.
#[derive(Clone, Debug)]
pub(crate) struct CbmcTools {
    pub(crate) cbmc: PathBuf,
    pub(crate) wasm2c: PathBuf,
    /// A rustc that can compile for wasm32.
    pub(crate) rustc: PathBuf,
    /// Path of `core` for wasm32, if that rustc has none of its own.
    pub(crate) wasm_core: Option<PathBuf>,
    /// The folder of wasm-rt.h.
    pub(crate) include: PathBuf,
    /// rust-lld of the toolchain.
    pub(crate) linker: PathBuf,
    /// Names and versions, for the ledger.
    pub(crate) versions: Vec<(String, String)>,
    /// Major version of CBMC. Before 6 there is no option that leaves its C checks out, and none is on by itself.
    pub(crate) cbmc_major: u32,
}

const WASM: &str = "wasm32-unknown-unknown";

/// Installation of the tools of the CBMC lane.
pub(crate) const GET_CBMC: &str = "rustup target add wasm32-unknown-unknown; then cbmc (6.x) and wabt (1.0.32) from \
    your distribution, on PATH \
     (docs/verification.md, Engines)";
/// Installation of Kani, in the version that the project pins.
pub(crate) fn get_kani(version: &str) -> String {
    format!("cargo install --locked kani-verifier@{version} && cargo kani setup (docs/verification.md, Engines)")
}

/// The version of Kani that the workspace's Cargo.toml pins.
///
/// # Errors
/// Where it names none.
pub(crate) fn pinned_kani(root: &Path) -> Result<String, String> {
    let text = std::fs::read_to_string(root.join("Cargo.toml")).map_err(|error| format!("Cargo.toml: {error}"))?;
    let line = text.lines().find_map(|line| line.strip_prefix("kani = \""));
    let version = line.and_then(|rest| rest.strip_suffix('"'));
    version.map(str::to_owned).ok_or_else(|| "Cargo.toml pins no version of Kani".to_owned())
}

/// The tools of the CBMC lane.
///
/// # Errors
/// The names of those that are missing.
pub(crate) fn cbmc() -> Result<CbmcTools, String> {
    let mut missing = Vec::new();
    let mut need = |what: &str, found: Option<PathBuf>| {
        found.unwrap_or_else(|| {
            missing.push(what.to_owned());
            PathBuf::new()
        })
    };
    let cbmc = need("cbmc", program("cbmc"));
    let wasm2c = need("wasm2c (wabt)", program("wasm2c"));
    let include = need("wasm-rt.h (wabt)", wabt_include());
    let linker = need("rust-lld in the toolchain", linker());
    let (rustc, wasm_core) = match cross_rustc() {
        Some((rustc, core)) => (rustc, core),
        None => (need("a rustc with wasm32-unknown-unknown", None), None),
    };
    if !missing.is_empty() {
        return Err(missing.join(", "));
    }
    let version = |tool: &Path| result(Command::new(tool).arg("--version")).unwrap_or_else(|| "unknown".into());
    let versions = vec![
        ("cbmc".to_owned(), version(&cbmc)),
        ("wasm2c".to_owned(), version(&wasm2c)),
        ("rustc for wasm32".to_owned(), version(&rustc)),
    ];
    let cbmc_major = versions[0].1.split('.').next().and_then(|major| major.trim().parse().ok()).unwrap_or(6);
    Ok(CbmcTools { cbmc, wasm2c, rustc, wasm_core, include, linker, versions, cbmc_major })
}

/// Whether Kani is set up here in that version. `cargo kani` itself is not called: where Kani is not set up, that
/// starts a download and leaves an empty folder that then looks set up.
pub(crate) fn has_kani(version: &str) -> bool {
    let bundles = variable("KANI_HOME").or_else(|| Some(home()?.join(".kani")));
    let cargo_bin = variable("CARGO_HOME").or_else(|| Some(home()?.join(".cargo"))).map(|home| home.join("bin"));
    let command = on_path("cargo-kani").or_else(|| Some(cargo_bin?.join("cargo-kani")).filter(|path| path.is_file()));
    command.is_some() && bundles.is_some_and(|bundles| is_set_up(&bundles, version))
}

fn is_set_up(bundles: &Path, version: &str) -> bool {
    bundles.join(format!("kani-{version}")).join("rust-toolchain-version").is_file()
}

/// The version of the rustc on PATH.
pub(crate) fn rustc_version() -> String {
    result(Command::new("rustc").arg("--version")).unwrap_or_else(|| "unknown".into())
}

fn wabt_include() -> Option<PathBuf> {
    let own = variable("RETRACE_WABT_INCLUDE");
    let in_toolbox = toolbox().map(|folder| folder.join("wabt/usr/include"));
    let usual = ["/usr/include", "/usr/share/wabt", "/usr/local/include"].map(|path| Some(PathBuf::from(path)));
    [own, in_toolbox].into_iter().chain(usual).flatten().find(|folder| folder.join("wasm-rt.h").is_file())
}

/// A rustc for wasm32, and its `core` if that is elsewhere: the one named, that of the toolchain, or that of the
/// toolbox.
fn cross_rustc() -> Option<(PathBuf, Option<PathBuf>)> {
    let own_core = variable("RETRACE_WASM_CORE");
    if let Some(rustc) = variable("RETRACE_CROSS_RUSTC") {
        return Some((rustc, own_core.or_else(toolbox_core)));
    }
    if sysroot().is_some_and(|sysroot| sysroot.join("lib/rustlib").join(WASM).is_dir()) {
        return Some(("rustc".into(), None));
    }
    let rustc = toolbox()?.join("bin/rustc-web");
    rustc.is_file().then(|| (rustc, own_core.or_else(toolbox_core)))
}

fn toolbox_core() -> Option<PathBuf> {
    Some(toolbox()?.join("core").join(WASM)).filter(|folder| folder.is_dir())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kani_counts_as_set_up_only_with_its_toolchain_and_in_the_pinned_version() {
        let home = std::env::temp_dir().join(format!("retrace-xtask-kani-{}", std::process::id()));
        let bundle = home.join("kani-0.68.0");
        std::fs::create_dir_all(&bundle).unwrap();
        assert!(!is_set_up(&home, "0.68.0"), "an empty folder looks set up");
        std::fs::write(bundle.join("rust-toolchain-version"), "nightly").unwrap();
        assert!(is_set_up(&home, "0.68.0") && !is_set_up(&home, "0.67.0"));
        std::fs::remove_dir_all(&home).unwrap();
        assert!(!is_set_up(&home, "0.68.0"));
    }

    #[test]
    fn the_version_of_kani_is_written_in_one_place() {
        let here = std::env::current_dir().unwrap();
        let root = here.ancestors().nth(2).unwrap();
        let version = pinned_kani(root).unwrap();
        for path in ["docs/verification.md", ".github/workflows/verify.yml", "docs/release.md", "CONTRIBUTING.md"] {
            let text = std::fs::read_to_string(root.join(path)).unwrap();
            assert!(!text.contains(&version), "{path} repeats the version {version}");
        }
        assert!(get_kani(&version).contains(&format!("kani-verifier@{version} ")));
    }
}
