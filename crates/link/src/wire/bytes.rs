//! Numbers in a payload, low byte first; long ones in as many groups of seven bits as they need.
//!
//! Invariant: a writer without space, and a reader at the end, return `None` and change nothing.

/// Writer into a payload.
#[derive(Debug)]
pub struct ByteWriter<'b> {
    bytes: &'b mut [u8],
    at: usize,
}

impl<'b> ByteWriter<'b> {
    /// At the beginning of `bytes`.
    #[must_use]
    pub fn new(bytes: &'b mut [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    /// Returns the number of bytes written.
    #[must_use]
    pub fn len(&self) -> usize {
        self.at
    }

    /// Whether nothing is written yet.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.at == 0
    }

    /// Truncates the written bytes to an earlier length.
    pub fn truncate(&mut self, length: usize) {
        self.at = self.at.min(length);
    }

    /// Overwrites a byte that is already written.
    pub fn overwrite(&mut self, at: usize, byte: u8) {
        if at < self.at {
            self.bytes[at] = byte;
        }
    }

    /// Writes bytes. Returns `None` if there is no space.
    pub fn slice(&mut self, bytes: &[u8]) -> Option<()> {
        self.bytes.get_mut(self.at..self.at + bytes.len())?.copy_from_slice(bytes);
        self.at += bytes.len();
        Some(())
    }

    /// One byte.
    pub fn u8(&mut self, value: u8) -> Option<()> {
        self.slice(&[value])
    }

    /// Two bytes.
    pub fn u16(&mut self, value: u16) -> Option<()> {
        self.slice(&value.to_le_bytes())
    }

    /// Four bytes.
    pub fn u32(&mut self, value: u32) -> Option<()> {
        self.slice(&value.to_le_bytes())
    }

    /// Writes an unsigned number, one byte for every seven bits.
    pub fn count(&mut self, mut value: u64) -> Option<()> {
        let mut group = [0; 10];
        let mut length = 0;
        loop {
            group[length] = value as u8 & 0x7F | if value > 0x7F { 0x80 } else { 0 };
            length += 1;
            value >>= 7;
            if value == 0 {
                return self.slice(&group[..length]);
            }
        }
    }

    /// Writes a signed number with its sign in the lowest bit, so that small ones stay short.
    pub fn signed(&mut self, value: i64) -> Option<()> {
        self.count((value << 1 ^ value >> 63) as u64)
    }
}

/// Reader of a payload.
#[derive(Clone, Copy, Debug)]
pub struct ByteReader<'b> {
    bytes: &'b [u8],
}

impl<'b> ByteReader<'b> {
    /// At the beginning of `bytes`.
    #[must_use]
    pub const fn new(bytes: &'b [u8]) -> Self {
        Self { bytes }
    }

    /// Whether everything is read.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// Returns the number of remaining bytes.
    #[must_use]
    pub const fn remaining(&self) -> usize {
        self.bytes.len()
    }

    /// Reads `length` bytes. Returns `None` if there are fewer.
    pub fn slice(&mut self, length: usize) -> Option<&'b [u8]> {
        let (first, rest) = self.bytes.split_at_checked(length)?;
        self.bytes = rest;
        Some(first)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.slice(N)?.try_into().ok()
    }

    /// One byte.
    pub fn u8(&mut self) -> Option<u8> {
        Some(self.array::<1>()?[0])
    }

    /// Two bytes.
    pub fn u16(&mut self) -> Option<u16> {
        Some(u16::from_le_bytes(self.array()?))
    }

    /// Four bytes.
    pub fn u32(&mut self) -> Option<u32> {
        Some(u32::from_le_bytes(self.array()?))
    }

    /// Reads a number written by [`ByteWriter::count`]; `None` also for one of more than 64 bits.
    pub fn count(&mut self) -> Option<u64> {
        let mut value = 0;
        for group in 0..10 {
            let byte = self.u8()?;
            let bits = u64::from(byte & 0x7F);
            if group == 9 && bits > 1 {
                return None;
            }
            value |= bits << (7 * group);
            if byte & 0x80 == 0 {
                return Some(value);
            }
        }
        None
    }

    /// Reads a count that fits 32 bits.
    pub fn count32(&mut self) -> Option<u32> {
        u32::try_from(self.count()?).ok()
    }

    /// Reads a number written by [`ByteWriter::count`] that fits 16 bits.
    pub fn count16(&mut self) -> Option<u16> {
        u16::try_from(self.count()?).ok()
    }

    /// Reads a number written by [`ByteWriter::signed`].
    pub fn signed(&mut self) -> Option<i64> {
        let value = self.count()?;
        Some((value >> 1) as i64 ^ -((value & 1) as i64))
    }

    /// Reads a signed number that fits 32 bits.
    pub fn signed32(&mut self) -> Option<i32> {
        i32::try_from(self.signed()?).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn numbers_are_read_back(value in any::<u64>(), shift in 0u32..64, byte in any::<u8>()) {
            let mut bytes = [0; 32];
            let (count, signed) = (value >> shift, (value as i64) >> shift);
            let mut writer = ByteWriter::new(&mut bytes);
            writer.count(count).expect("room");
            writer.signed(signed).expect("room");
            writer.u8(byte).expect("room");
            let length = writer.len();
            let mut reader = ByteReader::new(&bytes[..length]);
            prop_assert_eq!((reader.count(), reader.signed(), reader.u8()), (Some(count), Some(signed), Some(byte)));
            prop_assert!(reader.is_empty() && reader.u8().is_none());
        }

        #[test]
        fn any_bytes_are_a_number_or_none(bytes in prop::collection::vec(any::<u8>(), 0..14)) {
            let mut reader = ByteReader::new(&bytes);
            while reader.count().is_some() {}
            let mut reader = ByteReader::new(&bytes);
            while reader.signed32().is_some() {}
        }
    }

    #[test]
    fn a_writer_without_room_writes_nothing() {
        let mut bytes = [7; 3];
        let mut writer = ByteWriter::new(&mut bytes);
        writer.u16(0x0201).expect("room");
        assert_eq!((writer.u16(5), writer.count(300), writer.len()), (None, None, 2));
        writer.u8(3).expect("room");
        assert_eq!(bytes, [1, 2, 3]);
    }
}
