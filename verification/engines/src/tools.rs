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
/// Installation of Kani.
pub(crate) const GET_KANI: &str =
    "cargo install --locked kani-verifier && cargo kani setup (docs/verification.md, Engines)";

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

/// The version of Kani that is set up here. `cargo kani` itself is not called: where Kani is not set up, that starts a
/// download and leaves an empty folder that then looks set up.
pub(crate) fn kani() -> Option<String> {
    let bundles = variable("KANI_HOME").or_else(|| Some(home()?.join(".kani")))?;
    let cargo_bin = variable("CARGO_HOME").or_else(|| Some(home()?.join(".cargo"))).map(|home| home.join("bin"));
    let command = on_path("cargo-kani").or_else(|| Some(cargo_bin?.join("cargo-kani")).filter(|path| path.is_file()));
    command?;
    kani_in(&bundles)
}

fn kani_in(home: &Path) -> Option<String> {
    let set_up = std::fs::read_dir(home).ok()?.filter_map(Result::ok).filter_map(|entry| {
        let version = entry.file_name().to_str()?.strip_prefix("kani-")?.to_owned();
        entry.path().join("rust-toolchain-version").is_file().then_some(version)
    });
    set_up.max()
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
    fn kani_counts_as_set_up_only_with_its_toolchain() {
        let home = std::env::temp_dir().join(format!("retrace-xtask-kani-{}", std::process::id()));
        let bundle = home.join("kani-0.68.0");
        std::fs::create_dir_all(&bundle).unwrap();
        assert_eq!(kani_in(&home), None, "an empty folder looks set up");
        std::fs::write(bundle.join("rust-toolchain-version"), "nightly").unwrap();
        assert_eq!(kani_in(&home).as_deref(), Some("0.68.0"));
        std::fs::remove_dir_all(&home).unwrap();
        assert_eq!(kani_in(&home), None);
    }
}
