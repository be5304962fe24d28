//! The card's end of the line: bytes in, words to the card's works; what these did, in reports.
//!
//! Words are taken in the order of their numbers, each once; a frame that begins beyond the next number tells of a gap, and is left.
//! A word that the works refuse counts as taken: what became of the window is in the report, so that the host sees it.
//! Reports carry entries under numbers of their own, and are sent again until the host has said that it has them.
//!
//! Invariant: `first ≤ sent ≤ first + count`: entries before `first` are known to the host, those before `sent` were sent.

use retrace_core::{RateTarget, Travel};

use crate::frame::{FrameDecoder, MAX_PAYLOAD, MAX_WIRE, encode_with_key};
use crate::frame_size::FrameSize;
use crate::wire::{ByteReader, ByteWriter, Greeting, Opening, ReportEntry, Run, kind, read_word};
use crate::{CardCore, CardStatus, HostCommand, OutputChange, Outputs, channel, next_epoch, session_key, state_crc};

/// What is left free at the end of a report, for the echo.
const ECHO: usize = 4;
/// Entries that are sent and not confirmed, at most. Those behind them can still grow, which keeps their number small while the line
/// is down.
const IN_FLIGHT: u16 = 96;

/// The card's end, for `A` axes, keeping up to `E` entries that the host has not confirmed.
#[derive(Clone, Debug)]
pub struct CardEndpoint<const A: usize, const E: usize> {
    decoder: FrameDecoder<MAX_PAYLOAD>,
    epoch: u16,
    last_epoch: u16,
    axes: u8,
    /// Number of the next word.
    next_word: u16,
    /// Number of the last rate taken.
    now_seen: u16,
    gap: bool,
    entries: [ReportEntry; E],
    /// Number of the oldest entry kept.
    first: u16,
    count: u16,
    sent: u16,
    /// Entries before this number were sent at least once: they never change again.
    fixed: u16,
    /// Entries were lost for want of room.
    lost: bool,
    shadow: ReportedState,
    greeting: Option<u32>,
    /// Nonce and key of the last opening.
    nonce: u32,
    key: u32,
    /// A frame of the open epoch has come.
    spoken: bool,
    report_periods: u8,
    since_report: u32,
    /// Periods without an entry confirmed while some are sent.
    unconfirmed: u32,
    patience: u32,
    urgent: bool,
    frames: FrameSize,
    stage: [u8; MAX_WIRE],
    staged: (usize, usize),
}

/// What the host knows from entries.
#[derive(Clone, Copy, Debug)]
struct ReportedState {
    outputs: Outputs,
    executed: u32,
    inputs: u16,
    alarm: Option<crate::Alarm>,
    repeated: u32,
    blocked: bool,
}

impl ReportedState {
    /// What the host knows when an epoch begins.
    const fn new(executed: u32) -> Self {
        Self { outputs: [0; channel::COUNT], executed, inputs: 0, alarm: None, repeated: 0, blocked: false }
    }
}

impl<const A: usize, const E: usize> Default for CardEndpoint<A, E> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const A: usize, const E: usize> CardEndpoint<A, E> {
    /// An end that nobody has opened.
    #[must_use]
    pub const fn new() -> Self {
        const { assert!(E >= 16 && E <= 16384 && E.is_power_of_two(), "room for entries, and numbers that tell them apart") }
        Self {
            decoder: FrameDecoder::new(),
            epoch: 0,
            last_epoch: 0,
            axes: A as u8,
            next_word: 0,
            now_seen: 0,
            gap: false,
            entries: [ReportEntry::Inputs(0); E],
            first: 0,
            count: 0,
            sent: 0,
            fixed: 0,
            lost: false,
            shadow: ReportedState::new(0),
            greeting: None,
            nonce: 0,
            key: 0,
            spoken: false,
            report_periods: 1,
            since_report: 0,
            unconfirmed: 0,
            patience: 50,
            urgent: false,
            frames: FrameSize::new(),
            stage: [0; MAX_WIRE],
            staged: (0, 0),
        }
    }

    /// The epoch that is open, or 0.
    #[must_use]
    pub const fn epoch(&self) -> u16 {
        self.epoch
    }

    /// Takes a byte off the line.
    pub fn receive(&mut self, byte: u8, deck: &mut impl CardCore<A>) {
        let Some(Ok(payload)) = self.decoder.take(byte) else { return };
        let mut copy = [0; MAX_PAYLOAD];
        let length = payload.len();
        copy[..length].copy_from_slice(payload);
        // A payload that cannot be read to its end is left where it stops making sense; its words have to come again.
        let has_key = self.decoder.has_key();
        let _ = self.payload(ByteReader::new(&copy[..length]), has_key, deck);
    }

    fn payload(&mut self, mut reader: ByteReader<'_>, has_key: bool, deck: &mut impl CardCore<A>) -> Option<()> {
        match (reader.u8()?, has_key) {
            (kind::HELLO, false) => self.greeting = Some(reader.u32()?),
            (kind::OPEN, false) => {
                let (boot, nonce) = (reader.u32()?, reader.u32()?);
                self.open(boot, nonce, &Opening::read(&mut reader)?, deck);
            }
            (kind::STREAM, true) if self.receive_session_frame(&mut reader, deck)? => {
                self.acknowledge(reader.u16()?);
                self.receive_commands(reader, deck)?;
            }
            (kind::RATE, true) if self.receive_session_frame(&mut reader, deck)? => {
                self.acknowledge(reader.u16()?);
                self.receive_rate(reader, deck)?;
            }
            (kind::NAK, true) if self.receive_session_frame(&mut reader, deck)? => {
                self.acknowledge(reader.u16()?);
                self.retransmit_reports();
                self.receive_rate(reader, deck)?;
            }
            (kind::CLOSE, true) => {
                if self.receive_session_frame(&mut reader, deck)? && deck.close().is_ok() {
                    self.epoch = 0;
                    (self.count, self.sent) = (0, self.first);
                }
                // Also where it is closed already: its host has not heard the answer yet.
                self.greeting = Some(reader.u32()?);
            }
            _ => {}
        }
        Some(())
    }

    /// Is this of the open epoch?
    fn receive_session_frame(&mut self, reader: &mut ByteReader<'_>, deck: &mut impl CardCore<A>) -> Option<bool> {
        let open = reader.u16()? == self.epoch && self.epoch != 0;
        if open {
            self.spoken = true;
            deck.host_is_alive();
        }
        Some(open)
    }

    /// An opening of this start of the card, under the next number, begins anew; one that is open already is only answered, and any other is
    /// a straggler or a recording.
    fn open(&mut self, boot: u32, nonce: u32, opening: &Opening<A>, deck: &mut impl CardCore<A>) {
        let settings = &opening.0;
        let is_next = boot == deck.identity().boot && settings.epoch == next_epoch(self.last_epoch);
        if is_next && deck.open(settings).is_ok() {
            let status = deck.status();
            (self.epoch, self.last_epoch, self.axes) = (settings.epoch, settings.epoch, settings.axes);
            (self.nonce, self.key, self.spoken) = (nonce, session_key(boot, nonce, settings.epoch), false);
            self.decoder.set_key(self.key);
            (self.next_word, self.now_seen, self.gap) = (0, 0, false);
            (self.first, self.count, self.sent, self.fixed, self.lost) = (0, 0, 0, 0, false);
            (self.since_report, self.unconfirmed) = (0, 0);
            self.report_periods = settings.report_periods.max(1);
            self.patience = (40_000 / settings.period_us.max(1)).max(2 + 2 * u32::from(self.report_periods));
            self.staged = (0, 0);
            self.shadow = ReportedState::new(status.executed);
            deck.host_is_alive();
        } else if self.epoch != 0 && (settings.epoch, nonce) == (self.epoch, self.nonce) && !self.spoken {
            // Its host has not heard the answer yet, and is there.
            deck.host_is_alive();
        }
        self.greeting = Some(nonce);
    }

    /// The host has every entry before this number.
    fn acknowledge(&mut self, number: u16) {
        let known = number.wrapping_sub(self.first);
        if known <= self.count && known > 0 {
            let sent = self.sent.wrapping_sub(self.first);
            self.first = number;
            self.count -= known;
            self.sent = self.first.wrapping_add(sent.saturating_sub(known));
            self.unconfirmed = 0;
            self.frames.arrived();
        }
    }

    /// From the first entry that is not confirmed.
    fn retransmit_reports(&mut self) {
        (self.sent, self.unconfirmed) = (self.first, 0);
        self.frames.lost();
        self.urgent = true;
    }

    fn receive_commands(&mut self, mut reader: ByteReader<'_>, deck: &mut impl CardCore<A>) -> Option<()> {
        let mut number = reader.u16()?;
        if (number.wrapping_sub(self.next_word) as i16) > 0 {
            self.gap = true;
            self.urgent = true;
            return None;
        }
        let mut run = Run::new(self.axes);
        while !reader.is_empty() {
            let word = read_word(&mut reader, &mut run)?;
            if number == self.next_word {
                self.next_word = self.next_word.wrapping_add(1);
                self.gap = false;
                match (deck.accept(word), word) {
                    (Err(_), HostCommand::Instruction(instruction)) => {
                        self.push(ReportEntry::Refused(instruction.number))
                    }
                    (Err(_), HostCommand::Repeat(repeated)) => self.push(ReportEntry::RepeatRefused(repeated.number)),
                    _ => {}
                }
            }
            number = number.wrapping_add(1);
        }
        Some(())
    }

    fn receive_rate(&mut self, mut reader: ByteReader<'_>, deck: &mut impl CardCore<A>) -> Option<()> {
        let number = reader.u16()?;
        let (feed, rapid): (Travel, Travel) = (reader.signed()?, reader.signed()?);
        if (number.wrapping_sub(self.now_seen) as i16) > 0 {
            self.now_seen = number;
            // A latched alarm refuses it; the host is told of that by an entry.
            let _ = deck.accept(HostCommand::Rate(RateTarget { feed, rapid }));
        }
        Some(())
    }

    /// A control period has passed.
    pub fn period(&mut self, status: &CardStatus<A>) {
        self.since_report = self.since_report.saturating_add(1);
        if self.epoch == 0 {
            return;
        }
        if self.sent != self.first {
            self.unconfirmed += 1;
            if self.unconfirmed > self.patience {
                self.retransmit_reports();
            }
        }
        self.changes(status);
        let (travel, short, at_rest) = (status.rate, status.starved, status.at_rest);
        let newest = self.first.wrapping_add(self.count).wrapping_sub(1);
        let unsent = self.count > 0 && newest.wrapping_sub(self.fixed) < self.count;
        let last = &mut self.entries[usize::from(newest) % E];
        match last {
            ReportEntry::Ran { travel: t, count, short: s, at_rest: r }
                if unsent && (*t, *s, *r) == (travel, short, at_rest) && *count < u32::MAX =>
            {
                *count += 1;
            }
            _ => self.push(ReportEntry::Ran { travel, count: 1, short, at_rest }),
        }
    }

    /// Entries for what is not as the host knows it.
    fn changes(&mut self, status: &CardStatus<A>) {
        if status.alarm != self.shadow.alarm {
            self.shadow.alarm = status.alarm;
            self.push(ReportEntry::Alarm(status.alarm));
            self.urgent = true;
        }
        if status.outputs != self.shadow.outputs {
            for (number, &value) in status.outputs.iter().enumerate() {
                if value != self.shadow.outputs[number] {
                    self.push(ReportEntry::Output(OutputChange { channel: number as u8, value }));
                }
            }
            self.shadow.outputs = status.outputs;
        }
        self.cutting_changes(status);
        if status.inputs != self.shadow.inputs {
            self.shadow.inputs = status.inputs;
            self.push(ReportEntry::Inputs(status.inputs));
        }
        if status.wheel != 0 {
            self.push(ReportEntry::Wheel(status.wheel));
        }
        if status.executed != self.shadow.executed {
            self.shadow.executed = status.executed;
            self.push(ReportEntry::Executed(status.executed));
            self.urgent = true;
        }
    }

    /// Entries for what is new of the cutting outputs, of repeated instructions and of the block.
    fn cutting_changes(&mut self, status: &CardStatus<A>) {
        if let Some(off) = status.cutter_off {
            self.push(ReportEntry::CutterOff(off));
            self.urgent = true;
        }
        if status.repeated != self.shadow.repeated {
            self.shadow.repeated = status.repeated;
            self.push(ReportEntry::Repeated(status.repeated));
            self.urgent = true;
        }
        if status.blocked != self.shadow.blocked {
            self.shadow.blocked = status.blocked;
            self.push(ReportEntry::Blocked(status.blocked));
            self.urgent = true;
        }
    }

    fn push(&mut self, entry: ReportEntry) {
        if usize::from(self.count) == E {
            self.lost = true;
            return;
        }
        self.entries[usize::from(self.first.wrapping_add(self.count)) % E] = entry;
        self.count += 1;
    }

    /// Bytes for the line, as many as there are and fit.
    pub fn transmit(&mut self, deck: &impl CardCore<A>, out: &mut [u8]) -> usize {
        let mut given = 0;
        while given < out.len() {
            if self.staged.0 == self.staged.1 {
                self.compose(deck);
                if self.staged.1 == 0 {
                    break;
                }
            }
            let (at, end) = self.staged;
            let count = (end - at).min(out.len() - given);
            out[given..given + count].copy_from_slice(&self.stage[at..at + count]);
            given += count;
            self.staged.0 += count;
        }
        given
    }

    /// Stages the next frame, if one is due.
    fn compose(&mut self, deck: &impl CardCore<A>) {
        self.staged = (0, 0);
        let mut payload = [0; MAX_PAYLOAD];
        let mut writer = ByteWriter::new(&mut payload);
        let mut key = 0;
        let written = if let Some(nonce) = self.greeting.take() {
            self.greet(&mut writer, nonce, deck)
        } else if self.epoch != 0 && (self.urgent || self.since_report >= u32::from(self.report_periods)) {
            (self.urgent, self.since_report) = (false, 0);
            key = self.key;
            self.report(&mut writer, deck.status())
        } else {
            None
        };
        let length = writer.len();
        if written.is_some()
            && let Some(frame) = encode_with_key(&payload[..length], &mut self.stage, key)
        {
            self.staged = (0, frame.len());
        }
    }

    fn greet(&self, writer: &mut ByteWriter<'_>, nonce: u32, deck: &impl CardCore<A>) -> Option<()> {
        let status = deck.status();
        let greeting = Greeting {
            nonce,
            identity: *deck.identity(),
            epoch: self.epoch,
            last_epoch: self.last_epoch,
            place: status.place,
            at_rest: status.at_rest,
            reached: status.reached,
            executed: status.executed,
            counts: status.counts,
            alarm: status.alarm,
        };
        writer.u8(kind::WELCOME)?;
        greeting.write(writer)
    }

    /// The head, entries from `sent` on as many as fit, and, if these are all, the echo of place and counts.
    fn report(&mut self, writer: &mut ByteWriter<'_>, status: &CardStatus<A>) -> Option<()> {
        writer.u8(kind::REPORT)?;
        writer.u16(self.epoch)?;
        writer.u16(self.next_word)?;
        writer.u16(self.now_seen)?;
        let flags_at = writer.len();
        writer.u8(0)?;
        writer.u32(status.low)?;
        writer.count(u64::from(status.high.wrapping_sub(status.low)))?;
        writer.u16(self.sent)?;
        let end = self.first.wrapping_add(self.count);
        let most = self.frames.most() - ECHO;
        while self.sent != end && self.sent.wrapping_sub(self.first) < IN_FLIGHT {
            let entry = self.entries[usize::from(self.sent) % E];
            let length = writer.len();
            if entry.write(writer).is_none() || writer.len() > most {
                writer.back_to(length);
                break;
            }
            self.sent = self.sent.wrapping_add(1);
        }
        if (self.sent.wrapping_sub(self.fixed) as i16) > 0 {
            self.fixed = self.sent;
        }
        let all = self.sent == end;
        writer.put_at(flags_at, u8::from(self.gap) | u8::from(all) << 1 | u8::from(self.lost) << 2);
        if all {
            writer.u32(state_crc(status.place, &status.counts, self.axes))?;
        } else if self.sent.wrapping_sub(self.first) < IN_FLIGHT {
            // the rest at once
            self.urgent = true;
        }
        Some(())
    }
}
