//! The image of a Pico or Pico 2 as a UF2 file, which its boot ROM accepts by drag and drop (Microsoft's UF2
//! specification).
//!
//! Invariant: every block has 256 bytes of one page of the flash; pages are in order, and bytes without a value are 0.

use std::collections::BTreeMap;

use super::elf::{half, word};

const PAGE: usize = 256;
const MAGIC_FIRST: u32 = 0x0a32_4655;
const MAGIC_SECOND: u32 = 0x9e5d_5157;
const MAGIC_LAST: u32 = 0x0ab1_6f30;
/// The block names the family of its chip.
const HAS_FAMILY: u32 = 0x2000;
/// Families of the chips; of an RP2350, an image for its Arm processors in their secure state.
pub(super) const RP2040: u32 = 0xe48b_ff56;
pub(super) const RP2350: u32 = 0xe48b_ff59;
/// Begin and end of the flash.
const FLASH: std::ops::Range<u32> = 0x1000_0000..0x1100_0000;
/// Bytes of an entry of the program header table, and the kind that is loaded.
const PROGRAM_HEADER: usize = 32;
const LOADED: u32 = 1;

/// Converts an ELF file, for a chip of this family.
///
/// # Errors
/// The file is truncated, or has bytes that are not in flash.
pub(super) fn convert(elf: &[u8], family: u32) -> Result<Vec<u8>, String> {
    let pages = pages(elf).ok_or("the ELF file is cut short")?;
    if let Some(address) = pages.keys().find(|&address| !FLASH.contains(address)) {
        return Err(format!("the image has bytes at {address:#x}, which is not flash"));
    }
    let mut blocks = Vec::with_capacity(pages.len() * 512);
    for (number, (address, page)) in pages.iter().enumerate() {
        let count = pages.len() as u32;
        let head = [MAGIC_FIRST, MAGIC_SECOND, HAS_FAMILY, *address, PAGE as u32, number as u32, count, family];
        blocks.extend(head.iter().flat_map(|word| word.to_le_bytes()));
        blocks.extend(page);
        blocks.extend([0; 476 - PAGE]);
        blocks.extend(MAGIC_LAST.to_le_bytes());
    }
    Ok(blocks)
}

/// The pages of the flash that the file loads, by their addresses.
fn pages(elf: &[u8]) -> Option<BTreeMap<u32, [u8; PAGE]>> {
    let (table, count) = (word(elf, 28)? as usize, usize::from(half(elf, 44)?));
    let mut pages = BTreeMap::new();
    for header in 0..count {
        let at = table + header * PROGRAM_HEADER;
        let (kind, offset, address, size) =
            (word(elf, at)?, word(elf, at + 4)?, word(elf, at + 12)?, word(elf, at + 16)?);
        if kind != LOADED {
            continue;
        }
        let bytes = elf.get(offset as usize..)?.get(..size as usize)?;
        for (address, &byte) in (address..).zip(bytes) {
            let page: &mut [u8; PAGE] = pages.entry(address & !(PAGE as u32 - 1)).or_insert([0; PAGE]);
            page[address as usize % PAGE] = byte;
        }
    }
    Some(pages)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An ELF file with one loaded segment.
    fn sample(address: u32, bytes: &[u8]) -> Vec<u8> {
        let mut elf = vec![0; 52];
        elf[28] = 52;
        elf[44] = 1;
        for word in [LOADED, 84, 0x2000_0000, address, bytes.len() as u32, bytes.len() as u32, 0, 0] {
            elf.extend(u32::to_le_bytes(word));
        }
        elf.extend(bytes);
        elf
    }

    #[test]
    fn bytes_are_in_the_blocks_of_their_pages() {
        let file = convert(&sample(0x1000_00fe, &[1, 2, 3, 4]), RP2350).expect("an image");
        assert_eq!(file.len(), 2 * 512);
        let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap());
        assert_eq!((word(12), word(20), word(24), word(28)), (0x1000_0000, 0, 2, RP2350));
        assert_eq!((word(512 + 12), word(512 + 20), word(512 + 24)), (0x1000_0100, 1, 2));
        assert_eq!(file[32 + 254..32 + 256], [1, 2]);
        assert_eq!(file[512 + 32..512 + 35], [3, 4, 0]);
        assert_eq!((word(508), word(1020)), (MAGIC_LAST, MAGIC_LAST));
    }

    #[test]
    fn what_is_not_flash_or_cut_short_is_refused() {
        assert!(convert(&sample(0x2000_0000, &[1]), RP2040).is_err_and(|reason| reason.contains("0x20000000")));
        let elf = sample(0x1000_0000, &[1, 2, 3]);
        assert!((0..elf.len()).all(|end| convert(&elf[..end], RP2040).is_err()));
    }
}
