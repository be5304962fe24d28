//! Records, each encoded as the difference from the previous one on the path.
//!
//! ```text
//! 1 b s s l f c r    b: behind (else ahead)      s s: size of the differences of the increments: none, 4, 8, 16 bits
//! each
//! l: the line differs; signed  f: flags follow   c: the cap differs; it follows   r: rests before it (behind)
//! ```
//! then the increments' differences (of 4 bits: two per byte, the first axis low), line, flags, cap. Bit 7 of the
//! flags: the feed share differs; its signed difference is last. Constant speed costs one byte per record; acceleration
//! that of its differences, which at usual limits fit four bits.
//!
//! Invariant: a run begins in each payload with a record number of its own and differences from zero.

use retrace_core::{FeedShare, Flags, RapidCap, Record, RecordIndex};

use super::{ByteReader, ByteWriter};
use crate::HostCommand;

/// Flag in the first byte of a record, and of nothing else.
pub(super) const RECORD: u8 = 0x80;
const BEHIND: u8 = 0x40;
const LINE: u8 = 0x08;
const FLAGS: u8 = 0x04;
const CAP: u8 = 0x02;
const RESTS: u8 = 0x01;
/// Bit in the flags: the feed share differs.
const FEED_SHARE: u8 = 0x80;

/// State of a run of records in a payload.
#[derive(Clone, Copy, Debug, Hash)]
pub struct RecordRun<const A: usize> {
    /// Number of encoded axes; the others are zero.
    axes: usize,
    last: Option<PreviousRecord<A>>,
}

#[derive(Clone, Copy, Debug, Hash)]
struct PreviousRecord<const A: usize> {
    place: RecordIndex,
    record: Record<A>,
}

impl<const A: usize> RecordRun<A> {
    /// Creates the state at the beginning of a payload; `axes` is the number of encoded axes.
    #[must_use]
    pub const fn new(axes: u8) -> Self {
        let axes = axes as usize;
        Self { axes: if axes < A { axes } else { A }, last: None }
    }

    /// Whether a record at this place needs an explicit record number.
    #[must_use]
    pub fn needs_place(&self, place: RecordIndex, behind: bool) -> bool {
        self.next_place(behind) != Some(place)
    }

    /// Sets the record number at which the records continue.
    pub fn set_place(&mut self, place: RecordIndex, behind: bool) {
        let before = if behind { place + 1 } else { place - 1 };
        self.last = Some(PreviousRecord { place: before, record: Record::default() });
    }

    fn next_place(&self, behind: bool) -> Option<RecordIndex> {
        self.last.map(|last| if behind { last.place - 1 } else { last.place + 1 })
    }

    /// Writes a record that follows the last one. Returns `None` if there is no space.
    pub fn write(&mut self, writer: &mut ByteWriter<'_>, record: &Record<A>, behind: bool, rests: bool) -> Option<()> {
        let place = self.next_place(behind)?;
        let last = self.last?.record;
        let mut differences = [0i16; A];
        for (difference, (now, before)) in differences.iter_mut().zip(record.increments.iter().zip(last.increments)) {
            // wraps back when it is read
            *difference = now.wrapping_sub(before);
        }
        let differences = &differences[..self.axes];
        let size = size_of_differences(differences);
        let has = |flag: u8, so: bool| if so { flag } else { 0 };
        let line = i64::from(record.line) - i64::from(last.line);
        let feed_share = i64::from(record.feed_share.units()) - i64::from(last.feed_share.units());
        let flags = record.flags.bits() | if feed_share != 0 { FEED_SHARE } else { 0 };
        let has_flags = flags != last.flags.lasting().bits();
        let tag = RECORD
            | has(BEHIND, behind)
            | size << 4
            | has(LINE, line != 0)
            | has(FLAGS, has_flags)
            | has(CAP, record.cap != last.cap)
            | has(RESTS, rests);
        writer.u8(tag)?;
        write_differences(writer, differences, size)?;
        if line != 0 {
            writer.signed(line)?;
        }
        if has_flags {
            writer.u8(flags)?;
        }
        if record.cap != last.cap {
            writer.u8(record.cap.get())?;
        }
        if feed_share != 0 {
            writer.signed(feed_share)?;
        }
        self.last = Some(PreviousRecord { place, record: *record });
        Some(())
    }

    /// Reads the record whose first byte was `tag`.
    pub fn read(&mut self, reader: &mut ByteReader<'_>, tag: u8) -> Option<HostCommand<A>> {
        let behind = tag & BEHIND != 0;
        let place = self.next_place(behind)?;
        let last = self.last?.record;
        let mut flags = last.flags.lasting().bits();
        let mut record = Record { increments: [0; A], ..last };
        let mut differences = [0i16; A];
        read_differences(reader, &mut differences[..self.axes], tag >> 4 & 3)?;
        for (now, (before, difference)) in record.increments.iter_mut().zip(last.increments.iter().zip(differences)) {
            *now = before.wrapping_add(difference);
        }
        if tag & LINE != 0 {
            record.line = u32::try_from(i64::from(last.line).checked_add(reader.signed()?)?).ok()?;
        }
        if tag & FLAGS != 0 {
            flags = reader.u8()?;
        }
        record.flags = Flags::from_bits(flags);
        if tag & CAP != 0 {
            record.cap = RapidCap::sixteenths(reader.u8()?);
        }
        if flags & FEED_SHARE != 0 {
            let units = i64::from(last.feed_share.units()).checked_add(reader.signed()?)?;
            record.feed_share = FeedShare::from_units(u16::try_from(units).ok()?);
        }
        self.last = Some(PreviousRecord { place, record });
        let rests = tag & RESTS != 0;
        Some(if behind { HostCommand::Behind { place, record, rests } } else { HostCommand::Ahead { place, record } })
    }
}

/// Returns the size code of the differences. 0: all zero; 1: they fit 4 bits each; 2: 8; 3: 16.
fn size_of_differences(differences: &[i16]) -> u8 {
    let most = differences.iter().map(|&d| if d < 0 { !d } else { d }).max().unwrap_or(0);
    match most {
        0 if differences.iter().all(|&d| d == 0) => 0,
        0..8 => 1,
        8..128 => 2,
        _ => 3,
    }
}

fn write_differences(writer: &mut ByteWriter<'_>, differences: &[i16], size: u8) -> Option<()> {
    match size {
        0 => {}
        1 => {
            for pair in differences.chunks(2) {
                let high = pair.get(1).copied().unwrap_or(0);
                writer.u8(pair[0] as u8 & 0x0F | (high as u8) << 4)?;
            }
        }
        2 => differences.iter().try_for_each(|&d| writer.u8(d as u8))?,
        _ => differences.iter().try_for_each(|&d| writer.u16(d as u16))?,
    }
    Some(())
}

fn read_differences(reader: &mut ByteReader<'_>, differences: &mut [i16], size: u8) -> Option<()> {
    match size {
        0 => {}
        1 => {
            for pair in differences.chunks_mut(2) {
                let byte = reader.u8()?;
                pair[0] = i16::from((byte as i8) << 4 >> 4);
                if let Some(high) = pair.get_mut(1) {
                    *high = i16::from(byte as i8 >> 4);
                }
            }
        }
        2 => {
            for difference in differences {
                *difference = i16::from(reader.u8()? as i8);
            }
        }
        _ => {
            for difference in differences {
                *difference = reader.u16()? as i16;
            }
        }
    }
    Some(())
}
