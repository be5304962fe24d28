//! What comes from the card: greetings and reports.
//!
//! Invariant: an entry is taken once, in its order; what cannot be read to its end leaves what was read before it.

use super::{AlarmClearing, ENTRIES, HostEndpoint, LinkError, Phase, StagedFrame, WORDS};
use crate::frame::MAX_PAYLOAD;
use crate::wire::{ByteReader, Greeting, ReportEntry, kind};

/// After a gap that the card tells of words are sent again, at most so often.
const GAP_US: u64 = 12_000;

/// A card that has answered so many openings without opening will not.
const REFUSALS: u8 = 3;

impl<const A: usize> HostEndpoint<A> {
    /// Takes bytes off the line.
    pub fn receive(&mut self, bytes: &[u8], now_us: u64) {
        self.times.now = now_us;
        self.counts.read += bytes.len() as u64;
        for &byte in bytes {
            let mut copy = [0; MAX_PAYLOAD];
            let length = match self.decoder.take(byte) {
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
            // What cannot be read to its end is left; it comes again.
            let has_key = self.decoder.has_key();
            let _ = self.payload(ByteReader::new(&copy[..length]), has_key);
        }
    }

    fn payload(&mut self, mut reader: ByteReader<'_>, has_key: bool) -> Option<()> {
        match (reader.u8()?, has_key) {
            (kind::WELCOME, false) => match Greeting::read(&mut reader)? {
                Ok(greeting) => self.greeted(&greeting),
                // Of a card that was asked who it is: in an epoch it has said so already.
                Err(version) if self.phase == Phase::Asking => self.fault = Some(LinkError::Protocol(version)),
                Err(_) => {}
            },
            (kind::REPORT, true) => self.reported(reader)?,
            _ => {}
        }
        Some(())
    }

    /// A greeting counts where it answers what was asked last, and once: any other is late or a recording.
    fn greeted(&mut self, greeting: &Greeting<A>) {
        let answers = self.greeting.is_none() && greeting.nonce == self.nonce;
        let answers_probe = self.probing && greeting.nonce == self.probe;
        let answers_opening = self.settings.is_some() && greeting.nonce == self.opening;
        if answers {
            self.greeting = Some(*greeting);
        }
        self.probing &= !answers_probe;
        if answers || answers_probe || answers_opening && self.phase != Phase::Open {
            self.times.heard = self.times.now;
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
                    self.fault = Some(LinkError::Unfit);
                }
            }
            Phase::Open if (answers || answers_probe) && (!same || greeting.epoch != settings.epoch) => {
                self.fault = Some(LinkError::Restarted);
            }
            Phase::Closing if answers_opening && greeting.epoch != settings.epoch => self.phase = Phase::Closed,
            _ => {}
        }
    }

    fn reported(&mut self, mut reader: ByteReader<'_>) -> Option<()> {
        let (epoch, next_word, now_seen) = (reader.u16()?, reader.u16()?, reader.u16()?);
        if self.settings.as_ref().is_none_or(|settings| settings.epoch != epoch) {
            return None;
        }
        if self.phase == Phase::Opening {
            self.phase = Phase::Open;
        }
        let (flags, low, length) = (reader.u8()?, reader.u32()?, reader.count32()?);
        let first = reader.u16()?;
        (self.times.heard, self.probing) = (self.times.now, false);
        self.entries_of(&mut reader, first, flags & 2 != 0)?;
        if flags & 4 != 0 {
            self.fault.get_or_insert(LinkError::ReportLost);
        }
        self.follow_clearing(next_word, flags & 2 != 0);
        self.confirm(next_word, low, low.wrapping_add(length));
        if now_seen.wrapping_sub(self.now_seen) as i16 > 0 {
            self.now_seen = now_seen;
        }
        if flags & 1 != 0 && self.sent > 0 && self.times.now - self.times.gap >= GAP_US {
            self.times.gap = self.times.now;
            self.again();
        }
        Some(())
    }

    /// Takes the entries that are new. Those of a number that is not due yet were preceded by a report that was lost.
    fn entries_of(&mut self, reader: &mut ByteReader<'_>, first: u16, all: bool) -> Option<()> {
        let mut number = first;
        if (number.wrapping_sub(self.next_entry) as i16) > 0 {
            self.missing = true;
            return Some(());
        }
        let tail = if all { 4 } else { 0 };
        while reader.remaining() > tail {
            let entry = ReportEntry::read(reader)?;
            if number == self.next_entry {
                if usize::from(self.waiting) == ENTRIES {
                    return Some(());
                }
                if let ReportEntry::Ran { travel, count, .. } = entry {
                    self.newest = self.newest.moved(travel.saturating_mul(i64::from(count)));
                }
                self.entries[usize::from(self.taken.wrapping_add(self.waiting)) % ENTRIES] = entry;
                self.waiting += 1;
                self.next_entry = self.next_entry.wrapping_add(1);
            }
            number = number.wrapping_add(1);
        }
        if all && number == self.next_entry {
            self.echo = Some(reader.u32()?);
        } else if number == self.next_entry {
            // more is to come: what was told before is not the newest any more
            self.echo = None;
        }
        Some(())
    }

    /// Has the card taken an order to clear the alarm, and told what came of it? `all`: the report had every entry.
    fn follow_clearing(&mut self, next_word: u16, all: bool) {
        match self.clearing {
            Some(AlarmClearing::Asked(number)) if all && (next_word.wrapping_sub(number) as i16) > 0 => {
                self.clearing = Some(AlarmClearing::Taken(self.next_entry));
            }
            // Every period that was told of since is one that came after the word.
            Some(AlarmClearing::Taken(number)) if self.next_entry != number => self.clearing = None,
            _ => {}
        }
    }

    /// The card took all words before `next_word`; its window was `low … high` then.
    fn confirm(&mut self, next_word: u16, low: u32, high: u32) {
        let taken = next_word.wrapping_sub(self.base);
        if taken > self.count {
            return;
        }
        if taken > 0 {
            self.frames.arrived();
            self.times.progress = self.times.now;
            self.base = next_word;
            self.count -= taken;
            self.sent = self.sent.saturating_sub(taken);
            if let StagedFrame::Stream(offset) = self.kind {
                self.kind = StagedFrame::Stream(offset.saturating_sub(taken));
            }
        }
        self.mirror.set(low, high);
        self.held = high;
        for k in 0..self.count {
            let word = self.queue[usize::from(self.base.wrapping_add(k)) % WORDS];
            // What was foreseen to be taken is so still; what the card refuses all the same shows in a later report.
            let _ = self.mirror.predict(&word, self.newest, false);
        }
        self.show_window();
    }

    pub(super) fn again(&mut self) {
        if self.sent > 0 {
            self.counts.retransmitted += 1;
            self.sent = 0;
            self.frames.lost();
        }
        self.times.progress = self.times.now;
    }
}
