//! Sections and symbols of an image (System V ABI, *Object files*; 32 bits, little-endian).
//!
//! Invariant: any bytes are read without a panic; what does not fit is an error.

/// A section that takes memory on the target.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Section {
    pub(super) name: String,
    pub(super) address: u32,
    pub(super) size: u32,
    /// Whether its bytes are in the image; otherwise it only reserves memory.
    pub(super) has_bytes: bool,
}

/// A symbol and where it is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Symbol {
    pub(super) name: String,
    pub(super) address: u32,
}

/// Sections and symbols.
#[derive(Clone, Debug)]
pub(super) struct Image {
    pub(super) sections: Vec<Section>,
    pub(super) symbols: Vec<Symbol>,
}

const ALLOCATED: u32 = 2;
const PROGRAM_BITS: u32 = 1;
const SYMBOL_TABLE: u32 = 2;
const NO_BITS: u32 = 8;
/// Bytes of a section's header, and of a symbol.
const HEADER: usize = 40;
const SYMBOL: usize = 16;

impl Image {
    /// Parses an ELF file.
    ///
    /// # Errors
    /// The reason why it is not one, or is truncated.
    pub(super) fn read(bytes: &[u8]) -> Result<Self, String> {
        if bytes.get(..6) != Some(b"\x7fELF\x01\x01") {
            return Err("this is not an ELF file of 32 bits, little-endian".into());
        }
        parse(bytes).ok_or_else(|| "the ELF file is cut short".to_owned())
    }

    /// Address of the only symbol whose name contains this part.
    pub(super) fn address_of(&self, part: &str) -> Option<u32> {
        self.symbols.iter().find(|symbol| symbol.name.contains(part)).map(|symbol| symbol.address)
    }
}

fn parse(bytes: &[u8]) -> Option<Image> {
    let table = word(bytes, 32)? as usize;
    let (count, names) = (half(bytes, 48)?, half(bytes, 50)?);
    let header = |index: u16| bytes.get(table + usize::from(index) * HEADER..)?.get(..HEADER);
    let range = |header: &[u8]| bytes.get(word(header, 16)? as usize..)?.get(..word(header, 20)? as usize);
    let section_names = range(header(names)?)?;
    let mut image = Image { sections: Vec::new(), symbols: Vec::new() };
    for index in 0..count {
        let header_of = header(index)?;
        let (kind, size) = (word(header_of, 4)?, word(header_of, 20)?);
        if word(header_of, 8)? & ALLOCATED != 0 && size > 0 && kind != 0 {
            let name = text(section_names, word(header_of, 0)?)?;
            let section = Section { name, address: word(header_of, 12)?, size, has_bytes: kind != NO_BITS };
            debug_assert!(kind == PROGRAM_BITS || kind == NO_BITS || section.has_bytes);
            image.sections.push(section);
        }
        if kind == SYMBOL_TABLE {
            let strings = range(header(word(header_of, 24)? as u16)?)?;
            for symbol in range(header_of)?.chunks_exact(SYMBOL) {
                image.symbols.push(Symbol { name: text(strings, word(symbol, 0)?)?, address: word(symbol, 4)? });
            }
        }
    }
    Some(image)
}

pub(super) fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..)?.get(..4)?.try_into().ok()?))
}

pub(super) fn half(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(bytes.get(at..)?.get(..2)?.try_into().ok()?))
}

fn text(strings: &[u8], at: u32) -> Option<String> {
    let from = strings.get(at as usize..)?;
    let end = from.iter().position(|&byte| byte == 0)?;
    Some(String::from_utf8_lossy(&from[..end]).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An image with one section of 12 bytes at 0x0800_0000 and a symbol in it.
    fn sample() -> Vec<u8> {
        let strings = b"\0.text\0.names\0.symbols\0_start_here\0";
        let mut bytes = b"\x7fELF\x01\x01".to_vec();
        bytes.resize(52, 0);
        let code_at = bytes.len() as u32;
        bytes.extend([7; 12]);
        let strings_at = bytes.len() as u32;
        bytes.extend(strings);
        let symbols_at = bytes.len() as u32;
        for word in [23, 0x0800_0004, 4, 0] {
            bytes.extend(u32::to_le_bytes(word));
        }
        let table = bytes.len() as u32;
        let headers = [
            [0; 10],
            [1, PROGRAM_BITS, ALLOCATED, 0x0800_0000, code_at, 12, 0, 0, 4, 0],
            [7, 3, 0, 0, strings_at, strings.len() as u32, 0, 0, 1, 0],
            [14, SYMBOL_TABLE, 0, 0, symbols_at, 16, 2, 0, 4, 16],
        ];
        for word in headers.iter().flatten() {
            bytes.extend(word.to_le_bytes());
        }
        bytes[32..36].copy_from_slice(&table.to_le_bytes());
        bytes[48..52].copy_from_slice(&[4, 0, 2, 0]);
        bytes
    }

    #[test]
    fn sections_and_symbols_are_found() {
        let image = Image::read(&sample()).expect("an image");
        let text = Section { name: ".text".into(), address: 0x0800_0000, size: 12, has_bytes: true };
        assert_eq!(image.sections, [text]);
        assert_eq!(image.address_of("start_h"), Some(0x0800_0004));
        assert_eq!(image.address_of("end"), None);
    }

    #[test]
    fn no_cut_and_no_change_makes_it_panic() {
        let bytes = sample();
        assert!((0..bytes.len()).all(|end| Image::read(&bytes[..end]).is_err()));
        for at in 0..bytes.len() {
            for value in [0, 1, 0x7f, 0xff] {
                let mut changed = bytes.clone();
                changed[at] = value;
                let _ = Image::read(&changed);
            }
        }
    }
}
