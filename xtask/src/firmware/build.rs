//! Building the firmware: compiler and board.
//!
//! Invariant: rustup's own target is used where it is installed; a separate compiler, with `core` compiled from its
//! source, only where it is not.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::uf2;
use retrace_task_support::{process, tools};

/// A board, by its microcontroller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Board {
    /// STM32F405, 168 MHz.
    F405,
    /// STM32F401, 84 MHz.
    F401,
    /// STM32F411, 100 MHz.
    F411,
    /// Raspberry Pi Pico: RP2040, 125 MHz.
    Pico,
    /// Raspberry Pi Pico 2: RP2350, 150 MHz.
    Pico2,
}

impl Board {
    pub(super) const ALL: [Self; 5] = [Self::F405, Self::F401, Self::F411, Self::Pico, Self::Pico2];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::F405 => "f405",
            Self::F401 => "f401",
            Self::F411 => "f411",
            Self::Pico => "pico",
            Self::Pico2 => "pico2",
        }
    }

    /// Whether it is a Pico or a Pico 2: its code is in RAM, and it is flashed by drag and drop.
    pub(super) fn is_pico(self) -> bool {
        matches!(self, Self::Pico | Self::Pico2)
    }

    /// The feature of the firmware.
    fn feature(self) -> &'static str {
        match self {
            Self::Pico => "rp2040",
            Self::Pico2 => "rp2350",
            _ => self.name(),
        }
    }

    /// The target that its code is compiled for.
    fn target(self) -> &'static str {
        match self {
            Self::Pico => "thumbv6m-none-eabi",
            Self::Pico2 => "thumbv8m.main-none-eabihf",
            _ => "thumbv7em-none-eabihf",
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
            .ok_or_else(|| format!("there is no board `{name}`: f405, f401, f411, pico, pico2"))
    }
}

/// One image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Build {
    pub(super) board: Board,
    /// Megahertz of the crystal of an STM32F4; `None`: the internal oscillator.
    pub(super) crystal: Option<u8>,
    /// Whether it is for QEMU.
    pub(super) emulated: bool,
}

impl Build {
    /// What QEMU runs.
    pub(super) const EMULATED: Self = Self { board: Board::F405, crystal: None, emulated: true };

    fn features(self) -> String {
        let mut features = self.board.feature().to_owned();
        if let Some(crystal) = self.crystal.filter(|_| !self.board.is_pico()) {
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
        let target = self.board.target();
        let compiler = Compiler::find(target)?;
        let features = self.features();
        // one folder per image, so that they are not confused
        let folder = target_folder(root).join("firmware");
        let arguments = ["build", "--locked", "--release", "--target", target, "--features", &features];
        let mut command = process::cargo(&root.join("crates/firmware"), &arguments);
        command.args(["--message-format", "json-render-diagnostics"]).env("CARGO_TARGET_DIR", &folder);
        if self.board.is_pico() {
            // it has room for speed, and its processor needs it
            command.env("CARGO_PROFILE_RELEASE_OPT_LEVEL", "3");
        }
        compiler.prepare(&mut command, target);
        let built = process::build(&mut command).map_err(|reason| format!("firmware for {features}: {reason}"))?;
        let image = folder.join(format!("retrace-{}.elf", features.replace(',', "-")));
        std::fs::copy(&built, &image).map_err(|error| format!("{}: {error}", image.display()))?;
        Ok(image)
    }

    /// Writes the image that the boot ROM of a Pico or Pico 2 accepts by drag and drop, beside the ELF file; returns
    /// its path.
    ///
    /// # Errors
    /// The ELF file cannot be read, or the other one not written.
    pub(super) fn write_uf2(self, image: &Path) -> Result<Option<PathBuf>, String> {
        let family = match self.board {
            Board::Pico => uf2::RP2040,
            Board::Pico2 => uf2::RP2350,
            _ => return Ok(None),
        };
        let bytes = std::fs::read(image).map_err(|error| format!("{}: {error}", image.display()))?;
        let path = image.with_extension("uf2");
        std::fs::write(&path, uf2::convert(&bytes, family)?).map_err(|error| format!("{}: {error}", path.display()))?;
        Ok(Some(path))
    }
}

/// Target folder of cargo for this checkout.
pub(crate) fn target_folder(root: &Path) -> PathBuf {
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
    fn find(target: &str) -> Result<Self, String> {
        if tools::sysroot().is_some_and(|sysroot| sysroot.join("lib/rustlib").join(target).is_dir()) {
            return Ok(Self::Own);
        }
        let named = tools::variable("RETRACE_CROSS_RUSTC");
        let rustc = named.or_else(|| Some(tools::toolbox()?.join("bin/rustc-web")).filter(|path| path.is_file()));
        let missing = || format!("no rustc for {target}: rustup target add {target} (docs/firmware.md)");
        let linker = tools::linker().ok_or_else(|| "no rust-lld in the toolchain".to_owned())?;
        Ok(Self::Other { rustc: rustc.ok_or_else(missing)?, linker })
    }

    fn prepare(&self, command: &mut Command, target: &str) {
        if let Self::Other { rustc, linker } = self {
            command.arg("-Zbuild-std=core").env("RUSTC", rustc).env("RUSTC_BOOTSTRAP", "1");
            let variable = target.to_uppercase().replace(['-', '.'], "_");
            command.env(format!("CARGO_TARGET_{variable}_LINKER"), linker);
        }
    }
}

/// Checks that the compilers of these boards are installed.
///
/// # Errors
/// The missing tool, and how to install it.
pub(super) fn can_build(boards: &[Board]) -> Result<(), String> {
    boards.iter().try_for_each(|board| Compiler::find(board.target()).map(|_| ()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn features_name_board_crystal_and_emulation() {
        assert_eq!(Build::EMULATED.features(), "f405,qemu");
        assert_eq!(Build { board: Board::F411, crystal: Some(25), emulated: false }.features(), "f411,hse25");
        assert_eq!(Build { board: Board::Pico, crystal: Some(25), emulated: false }.features(), "rp2040");
        assert_eq!(Build { board: Board::Pico2, crystal: Some(25), emulated: false }.features(), "rp2350");
    }
}
