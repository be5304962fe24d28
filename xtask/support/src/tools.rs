//! Finding programs of the toolchain, and optional ones, on this machine.
//!
//! Invariant: the search for a program starts nothing that could download one.

use std::path::{Path, PathBuf};
use std::process::Command;

/// The folder of optional tools, if there is one.
pub fn toolbox() -> Option<PathBuf> {
    let cache = || variable("XDG_CACHE_HOME").or_else(|| Some(home()?.join(".cache")));
    let folder = variable("RETRACE_TOOLBOX").or_else(|| Some(cache()?.join("retrace-toolbox")))?;
    folder.is_dir().then_some(folder)
}

/// A program by its name, on PATH or in the toolbox.
pub fn program(name: &str) -> Option<PathBuf> {
    on_path(name).or_else(|| Some(toolbox()?.join("bin").join(name)).filter(|path| path.is_file()))
}

/// A program by its name, on PATH alone.
pub fn on_path(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path).map(|folder| folder.join(name)).find(|file| file.is_file())
}

/// A server by its name, on PATH or where Debian installs servers, which is not on the PATH of every user.
pub fn server(name: &str) -> Option<PathBuf> {
    on_path(name).or_else(|| Some(Path::new("/usr/sbin").join(name)).filter(|path| path.is_file()))
}

/// rust-lld of the toolchain.
pub fn linker() -> Option<PathBuf> {
    let verbose = result(Command::new("rustc").arg("-vV"))?;
    let host = verbose.lines().find_map(|line| line.strip_prefix("host: "))?;
    let linker = sysroot()?.join("lib/rustlib").join(host).join("bin/rust-lld");
    linker.is_file().then_some(linker)
}

/// The folder of the toolchain.
pub fn sysroot() -> Option<PathBuf> {
    result(Command::new("rustc").args(["--print", "sysroot"])).map(PathBuf::from)
}

/// The output of a command that must succeed.
pub fn result(command: &mut Command) -> Option<String> {
    let output = command.output().ok().filter(|output| output.status.success())?;
    Some(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// A variable of the environment that names a path, if it is set.
pub fn variable(name: &str) -> Option<PathBuf> {
    std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from)
}

/// The home folder.
pub fn home() -> Option<PathBuf> {
    variable("HOME")
}

/// Names of the browsers that can be driven, the most usual first.
const BROWSERS: [&str; 6] = [
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome-headless-shell",
    "microsoft-edge",
];

/// A browser of the Chromium family: `RETRACE_BROWSER`, or the first of the usual names on PATH.
pub fn browser() -> Option<PathBuf> {
    variable("RETRACE_BROWSER").or_else(|| BROWSERS.into_iter().find_map(on_path))
}
