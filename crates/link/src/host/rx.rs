//! Received frames: greetings and reports.
//!
//! Invariant: an entry is processed once, in its order; a parse error leaves everything before it valid.

use super::{AlarmClearing, HostEndpoint, LinkError, Phase, StagedFrame};
use crate::frame::MAX_PAYLOAD;
use crate::sequence::{acknowledged_items, is_after};
use crate::wire::{ByteReader, Greeting, ReportEntry, kind};
use retrace_core::{Distance, RecordIndex};

/// Minimum time between two retransmissions of commands after a gap that the card reports.
const GAP_US: u64 = 12_000;

/// Number of answers without an open epoch after which the card counts as refusing.
const REFUSALS: u8 = 3;

impl<const A: usize, const CELLS: usize, const ENTRIES: usize, const COMMANDS: usize>
    HostEndpoint<A, CELLS, ENTRIES, COMMANDS>
{
    /// Processes bytes from the line.
    pub fn receive(&mut self, bytes: &[u8], now_us: u64) {
        self.times.now = now_us;
        self.counts.read += bytes.len() as u64;
        for &byte in bytes {
            let mut copy = [0; MAX_PAYLOAD];
            let length = match self.decoder.push(byte) {
                None => continue,
                Some(Err(_)) => {
                    self.counts.damaged += 1;
                    continue;
                }
                Some(Ok(payload)) => {
                    copy[..payload.len()].copy_from_slice(payload);
                    payload.len()
                }
            };
            // The rest of a payload after a parse error is ignored; it is retransmitted.
            let has_key = self.decoder.has_key();
            let _ = self.handle_payload(ByteReader::new(&copy[..length]), has_key);
        }
    }

    fn handle_payload(&mut self, mut reader: ByteReader<'_>, has_key: bool) -> Option<()> {
        match (reader.u8()?, has_key) {
            (kind::WELCOME, false) => match Greeting::read(&mut reader)? {
                Ok(greeting) => self.handle_greeting(&greeting),
                // Only from a card whose identity was requested: in an epoch its version is known.
                Err(version) if self.phase == Phase::Identifying => self.fault = Some(LinkError::Protocol(version)),
                Err(_) => {}
            },
            (kind::REPORT, true) => self.handle_report(reader)?,
            _ => {}
        }
        Some(())
    }

    /// Handles a greeting. It counts once, and only as the answer to the last request: any other is late or a
    /// recording.
    fn handle_greeting(&mut self, greeting: &Greeting<A>) {
        let answers = self.greeting.is_none() && greeting.nonce == self.nonce;
        let answers_probe = self.probing && greeting.nonce == self.probe;
        let answers_opening = self.settings.is_some() && greeting.nonce == self.opening;
        if answers {
            self.greeting = Some(*greeting);
        }
        self.probing &= !answers_probe;
        if answers || answers_probe || answers_opening && self.phase != Phase::Open {
            self.times.received = self.times.now;
        }
        let Some(settings) = &self.settings else { return };
        let same = greeting.identity.boot == self.boot;
        match self.phase {
            Phase::Opening if answers_opening && !same => self.fault = Some(LinkError::Restarted),
            Phase::Opening if answers_opening && greeting.epoch == settings.epoch => self.phase = Phase::Open,
            Phase::Opening if answers_opening && greeting.at_rest => {
                // Answered, at rest, and not opened.
                self.refusals += 1;
                if self.refusals >= REFUSALS {
                    self.fault = Some(LinkError::SettingsRejected);
                }
            }
            Phase::Open if (answers || answers_probe) && (!same || greeting.epoch != settings.epoch) => {
                self.fault = Some(LinkError::Restarted);
            }
            Phase::Closing if answers_opening && greeting.epoch != settings.epoch => self.phase = Phase::Closed,
            _ => {}
        }
    }

    fn handle_report(&mut self, mut reader: ByteReader<'_>) -> Option<()> {
        let (epoch, next_command, now_seen) = (reader.u16()?, reader.u16()?, reader.u16()?);
        if self.settings.as_ref().is_none_or(|settings| settings.epoch != epoch) {
            return None;
        }
        if self.phase == Phase::Opening {
            self.phase = Phase::Open;
        }
        let (flags, low, length) = (reader.u8()?, RecordIndex::new(reader.u32()?), reader.count32()?);
        let first = reader.u16()?;
        (self.times.received, self.probing) = (self.times.now, false);
        self.push_entries(&mut reader, first, flags & 2 != 0)?;
        if flags & 4 != 0 {
            self.fault.get_or_insert(LinkError::ReportLost);
        }
        self.update_clearing(next_command, flags & 2 != 0);
        self.acknowledge_commands(next_command, low, low + length);
        if is_after(now_seen, self.acked_rate_seq) {
            self.acked_rate_seq = now_seen;
        }
        if flags & 1 != 0 && self.sent > 0 && self.times.now - self.times.gap >= GAP_US {
            self.times.gap = self.times.now;
            self.retransmit();
        }
        Some(())
    }

    /// Adds the new entries. Entries beyond the next number follow a report that was lost.
    fn push_entries(&mut self, reader: &mut ByteReader<'_>, first: u16, all: bool) -> Option<()> {
        let mut number = first;
        if is_after(number, self.next_entry) {
            self.report_missing = true;
            return Some(());
        }
        let tail = if all { 4 } else { 0 };
        while reader.remaining() > tail {
            let entry = ReportEntry::read(reader)?;
            if number == self.next_entry {
                if usize::from(self.waiting) == ENTRIES {
                    return Some(());
                }
                if let ReportEntry::Ran { distance, count, .. } = entry {
                    let moved = Distance::from_units(distance.units().saturating_mul(i64::from(count)));
                    self.newest_place = self.newest_place.moved(moved);
                }
                self.entries[usize::from(self.first_waiting.wrapping_add(self.waiting)) % ENTRIES] = entry;
                self.waiting += 1;
                self.next_entry = self.next_entry.wrapping_add(1);
                self.entry_received = true;
            }
            number = number.wrapping_add(1);
        }
        if all && number == self.next_entry {
            self.reported_crc = Some(reader.u32()?);
        } else if number == self.next_entry {
            // more entries follow: the check received before does not belong to the newest state any more
            self.reported_crc = None;
        }
        Some(())
    }

    /// Updates the progress of an alarm-clearing command. `all` means that the report had every entry.
    fn update_clearing(&mut self, next_command: u16, all: bool) {
        match self.clearing {
            Some(AlarmClearing::Requested(number)) if all && is_after(next_command, number) => {
                self.clearing = Some(AlarmClearing::Accepted(self.next_entry));
            }
            // Every period reported since then came after the command.
            Some(AlarmClearing::Accepted(number)) if self.next_entry != number => self.clearing = None,
            _ => {}
        }
    }

    /// Handles the acknowledgement that the card received all commands before `next_command`; its window was
    /// `low … high` then.
    fn acknowledge_commands(&mut self, next_command: u16, low: RecordIndex, high: RecordIndex) {
        let Some(taken) = acknowledged_items(next_command, self.base, self.count) else { return };
        if taken > 0 {
            self.frames.record_arrival();
            self.times.progress = self.times.now;
            self.base = next_command;
            self.count -= taken;
            self.sent = self.sent.saturating_sub(taken);
            if let StagedFrame::Stream(offset) = self.staged_kind {
                self.staged_kind = StagedFrame::Stream(offset.saturating_sub(taken));
            }
        }
        self.predicted.set_reported(low, high);
        self.reported_high = high;
        for k in 0..self.count {
            let command = self.queue[usize::from(self.base.wrapping_add(k)) % COMMANDS];
            // Commands predicted as accepted still are; what the card rejects anyway shows in a later report.
            let _ = self.predicted.predict(&command, self.newest_place, false);
        }
        self.update_status_window();
    }

    pub(super) fn retransmit(&mut self) {
        if self.sent > 0 {
            self.counts.retransmitted += 1;
            self.sent = 0;
            self.frames.record_loss();
        }
        self.times.progress = self.times.now;
    }
}
