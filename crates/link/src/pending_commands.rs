//! Commands of a received frame that are not processed yet, so that a card can look at its clock between them.
//!
//! Invariant: the commands of a frame are returned in their order, each once, with their numbers; after one that cannot
//! be read the rest of the frame is dropped.

use core::hash::{Hash, Hasher};

use crate::HostCommand;
use crate::frame::MAX_PAYLOAD;
use crate::wire::{ByteReader, RecordRun, read_command};

/// Commands of one frame, for `A` axes.
#[derive(Clone, Debug)]
pub(crate) struct PendingCommands<const A: usize> {
    payload: [u8; MAX_PAYLOAD],
    /// Bytes of the payload that are not read yet.
    unread: (usize, usize),
    /// Number of the next command.
    number: u16,
    run: RecordRun<A>,
}

impl<const A: usize> PendingCommands<A> {
    /// Creates one without commands.
    pub(crate) const fn new() -> Self {
        Self { payload: [0; MAX_PAYLOAD], unread: (0, 0), number: 0, run: RecordRun::new(0) }
    }

    /// Whether no command is pending.
    pub(crate) const fn is_empty(&self) -> bool {
        self.unread.0 == self.unread.1
    }

    /// Sets the commands of a frame, from its first number on, whose records have this number of axes.
    pub(crate) fn set(&mut self, number: u16, axes: u8, mut commands: ByteReader<'_>) {
        let length = commands.remaining().min(MAX_PAYLOAD);
        self.payload[..length].copy_from_slice(commands.slice(length).unwrap_or(&[0; MAX_PAYLOAD][..length]));
        (self.unread, self.number, self.run) = ((0, length), number, RecordRun::new(axes));
    }

    /// Reads the next command and its number; `None` if there is none.
    pub(crate) fn next(&mut self) -> Option<(u16, HostCommand<A>)> {
        if self.is_empty() {
            return None;
        }
        let (from, end) = self.unread;
        let mut reader = ByteReader::new(&self.payload[from..end]);
        let command = read_command(&mut reader, &mut self.run);
        // the rest of a payload after a parse error is ignored; its commands are retransmitted
        self.unread.0 = if command.is_some() { end - reader.remaining() } else { end };
        let number = self.number;
        self.number = number.wrapping_add(1);
        Some((number, command?))
    }

    /// Hashes what decides about later commands.
    pub(crate) fn hash_state(&self, state: &mut impl Hasher) {
        let (from, end) = self.unread;
        self.payload[from..end].hash(state);
        if !self.is_empty() {
            (self.number, self.run).hash(state);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::{ByteWriter, write_command};
    use retrace_core::{Record, RecordIndex};

    fn ahead(place: u32) -> HostCommand<2> {
        let record = Record { increments: [place as i16, -3], line: 7, ..Record::default() };
        HostCommand::Ahead { place: RecordIndex::new(place), record }
    }

    #[test]
    fn commands_come_in_their_order_and_nothing_after_one_that_cannot_be_read() {
        let mut bytes = [0; MAX_PAYLOAD];
        let mut writer = ByteWriter::new(&mut bytes);
        let mut run = RecordRun::new(2);
        for place in 5..9 {
            write_command(&mut writer, &mut run, &ahead(place)).expect("room");
        }
        let length = writer.len();
        let mut pending = PendingCommands::<2>::new();
        assert_eq!(pending.next(), None);
        pending.set(u16::MAX, 2, ByteReader::new(&bytes[..length]));
        let read = core::array::from_fn(|_| pending.next());
        assert_eq!(read, [(u16::MAX, ahead(5)), (0, ahead(6)), (1, ahead(7)), (2, ahead(8))].map(Some));
        assert!(pending.is_empty());
        // the last command is cut short
        pending.set(40, 2, ByteReader::new(&bytes[..length - 1]));
        assert_eq!(core::iter::from_fn(|| pending.next()).count(), 3);
        assert!(pending.is_empty() && pending.next().is_none());
    }
}
