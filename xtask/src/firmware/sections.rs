//! Flash and RAM of the microcontroller that an image uses, and their budgets.
//!
//! Invariant: the printed figures are those that are checked; above its budget an image does not pass.

use std::path::Path;

use super::build::{Board, Build};
use super::elf::Image;

/// Largest number of bytes of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Budget {
    flash: u32,
    /// With the stack.
    ram: u32,
    /// Bytes of RAM that are reserved for the stack; `firmware test` measures that it is enough.
    pub(super) stack: u32,
}

impl Budget {
    /// For every STM32F4: half of the flash of the smallest of them, an F401 with 128 KiB, and its 64 KiB of RAM. The
    /// deepest place of the stack is where the card is created, before the main loop.
    const STM32F4: Self = Self { flash: 64 * 1024, ram: 64 * 1024, stack: 21 * 1024 };
    /// The code of a Pico is in its 264 KiB of RAM, too; so is that of a Pico 2, which has more of it.
    const PICO: Self = Self { flash: 256 * 1024, ram: 224 * 1024, stack: 24 * 1024 };

    pub(super) const fn of(board: Board) -> Self {
        if matches!(board, Board::Pico | Board::Pico2) { Self::PICO } else { Self::STM32F4 }
    }
}

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

    fn fits(self, budget: Budget) -> bool {
        self.flash <= budget.flash && self.ram + budget.stack <= budget.ram
    }
}

/// Prints an image's sizes; false where one is above its budget.
///
/// # Errors
/// The image cannot be read.
pub(super) fn hold(build: &Build, path: &Path) -> Result<bool, String> {
    let bytes = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let size = Size::of(&Image::read(&bytes)?);
    let budget = Budget::of(build.board);
    let verdict = if size.fits(budget) { "fits" } else { "TOO LARGE" };
    println!(
        "{:<6} flash {:>6} of {:>6} bytes   RAM {:>6} and {} of stack, of {:>6} bytes   {verdict}",
        build.board.name(),
        size.flash,
        budget.flash,
        size.ram,
        budget.stack,
        budget.ram
    );
    Ok(size.fits(budget))
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
        let budget = Budget::of(Board::F401);
        let (flash, ram) = (budget.flash, budget.ram - budget.stack);
        assert!(Size { flash, ram }.fits(budget));
        assert!(!Size { flash: flash + 1, ram: 0 }.fits(budget) && !Size { flash: 0, ram: ram + 1 }.fits(budget));
    }
}
