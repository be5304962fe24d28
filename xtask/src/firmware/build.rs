//! Building the firmware: compiler and board.
//!
//! Invariant: rustup's own target is used where it is installed; a separate compiler, with `core` compiled from its
//! source, only where it is not.

use std::path::{Path, PathBuf};
use std::process::Command;

use retrace_task_support::{process, tools};

const TARGET: &str = "thumbv7em-none-eabihf";
/// Installation of a compiler for the target.
pub(super) const GET_COMPILER: &str = "rustup target add thumbv7em-none-eabihf (docs/firmware.md)";

/// A microcontroller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Board {
    /// STM32F405, 168 MHz.
    F405,
    /// STM32F401, 84 MHz.
    F401,
    /// STM32F411, 100 MHz.
    F411,
}

impl Board {
    pub(super) const ALL: [Self; 3] = [Self::F405, Self::F401, Self::F411];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::F405 => "f405",
            Self::F401 => "f401",
            Self::F411 => "f411",
        }
    }

    /// The board of this name.
    ///
    /// # Errors
    /// The valid names.
    pub(super) fn named(name: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|board| board.name() == name)
            .ok_or_else(|| format!("there is no board `{name}`: f405, f401, f411"))
    }
}

/// One image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Build {
    pub(super) board: Board,
    /// Megahertz of the crystal; `None`: the internal oscillator.
    pub(super) crystal: Option<u8>,
    /// Whether it is for QEMU.
    pub(super) emulated: bool,
}

impl Build {
    /// What QEMU runs.
    pub(super) const EMULATED: Self = Self { board: Board::F405, crystal: None, emulated: true };

    fn features(self) -> String {
        let mut features = self.board.name().to_owned();
        if let Some(crystal) = self.crystal {
            features.push_str(&format!(",hse{crystal}"));
        }
        if self.emulated {
            features.push_str(",qemu");
        }
        features
    }

    /// Builds the image, and returns the path of its ELF file.
    ///
    /// # Errors
    /// No compiler for it is installed, or it does not build.
    pub(super) fn run(self, root: &Path) -> Result<PathBuf, String> {
        let compiler = Compiler::find()?;
        let features = self.features();
        // one folder per image, so that they are not confused
        let folder = target_folder(root).join("firmware");
        let arguments = ["build", "--locked", "--release", "--target", TARGET, "--features", &features];
        let mut command = process::cargo(&root.join("crates/firmware"), &arguments);
        command.args(["--message-format", "json-render-diagnostics"]).env("CARGO_TARGET_DIR", &folder);
        compiler.prepare(&mut command);
        let built = process::build(&mut command).map_err(|reason| format!("firmware for {features}: {reason}"))?;
        let image = folder.join(format!("retrace-{}.elf", features.replace(',', "-")));
        std::fs::copy(&built, &image).map_err(|error| format!("{}: {error}", image.display()))?;
        Ok(image)
    }
}

/// Target folder of cargo for this checkout.
pub(super) fn target_folder(root: &Path) -> PathBuf {
    let named = std::env::var_os("CARGO_TARGET_DIR").filter(|folder| !folder.is_empty());
    named.map_or_else(|| root.join("target"), |folder| root.join(folder))
}

/// A way to compile for the target.
enum Compiler {
    /// The toolchain's own.
    Own,
    /// Another rustc, which brings the source of `core`, and a linker.
    Other { rustc: PathBuf, linker: PathBuf },
}

impl Compiler {
    fn find() -> Result<Self, String> {
        if tools::sysroot().is_some_and(|sysroot| sysroot.join("lib/rustlib").join(TARGET).is_dir()) {
            return Ok(Self::Own);
        }
        let named = tools::variable("RETRACE_CROSS_RUSTC");
        let rustc = named.or_else(|| Some(tools::toolbox()?.join("bin/rustc-web")).filter(|path| path.is_file()));
        let missing = || format!("no rustc for {TARGET}: {GET_COMPILER}");
        let linker = tools::linker().ok_or_else(|| "no rust-lld in the toolchain".to_owned())?;
        Ok(Self::Other { rustc: rustc.ok_or_else(missing)?, linker })
    }

    fn prepare(&self, command: &mut Command) {
        if let Self::Other { rustc, linker } = self {
            command.arg("-Zbuild-std=core").env("RUSTC", rustc).env("RUSTC_BOOTSTRAP", "1");
            command.env("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER", linker);
        }
    }
}

/// Checks that a compiler is installed.
///
/// # Errors
/// The missing tool, and how to install it.
pub(super) fn can_build() -> Result<(), String> {
    Compiler::find().map(|_| ())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn features_name_board_crystal_and_emulation() {
        assert_eq!(Build::EMULATED.features(), "f405,qemu");
        assert_eq!(Build { board: Board::F411, crystal: Some(25), emulated: false }.features(), "f411,hse25");
    }
}
