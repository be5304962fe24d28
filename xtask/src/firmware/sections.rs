//! Flash and RAM of the microcontroller that an image uses, and their budget.
//!
//! Invariant: the printed figures are those that are checked; above its budget an image does not pass.

use std::path::Path;

use super::build::Build;
use super::elf::Image;

/// Largest number of bytes of flash.
const FLASH: u32 = 64 * 1024;
/// Largest number of bytes of RAM, with the stack.
const RAM: u32 = 48 * 1024;
/// Bytes of RAM that are reserved for the stack; `firmware test` measures that it is enough.
pub(super) const STACK: u32 = 10 * 1024;
/// Begin of RAM.
pub(super) const RAM_BEGINS: u32 = 0x2000_0000;

/// Use of an image, in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Size {
    pub(super) flash: u32,
    /// Without the stack.
    pub(super) ram: u32,
}

impl Size {
    pub(super) fn of(image: &Image) -> Self {
        let in_ram = |address: u32| address >= RAM_BEGINS;
        let sum = |what: &dyn Fn(&super::elf::Section) -> bool| {
            image.sections.iter().filter(|section| what(section)).map(|section| section.size).sum()
        };
        // what begins in RAM with values has them in flash
        Self { flash: sum(&|section| section.has_bytes), ram: sum(&|section| in_ram(section.address)) }
    }

    fn fits(self) -> bool {
        self.flash <= FLASH && self.ram + STACK <= RAM
    }
}

/// Prints an image's sizes; false where one is above its budget.
///
/// # Errors
/// The image cannot be read.
pub(super) fn hold(build: &Build, path: &Path) -> Result<bool, String> {
    let bytes = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let size = Size::of(&Image::read(&bytes)?);
    let verdict = if size.fits() { "fits" } else { "TOO LARGE" };
    println!(
        "{:<6} flash {:>6} of {FLASH} bytes   RAM {:>6} and {STACK} of stack, of {RAM} bytes   {verdict}",
        build.board.name(),
        size.flash,
        size.ram
    );
    Ok(size.fits())
}

#[cfg(test)]
mod tests {
    use super::super::elf::Section;
    use super::*;

    #[test]
    fn values_count_twice_and_room_once() {
        let section = |address, size, has_bytes| Section { name: String::new(), address, size, has_bytes };
        let sections =
            vec![section(0x0800_0000, 1000, true), section(RAM_BEGINS, 30, true), section(RAM_BEGINS + 30, 200, false)];
        let size = Size::of(&Image { sections, symbols: Vec::new() });
        assert_eq!(size, Size { flash: 1030, ram: 230 });
        assert!(Size { flash: FLASH, ram: RAM - STACK }.fits());
        assert!(!Size { flash: FLASH + 1, ram: 0 }.fits() && !Size { flash: 0, ram: RAM - STACK + 1 }.fits());
    }
}
