//! The card's endpoint: bytes in, commands to the card's core; its results out, in reports.
//!
//! Commands are accepted in the order of their numbers, each once. A frame that begins beyond the next number shows a
//! gap, and is ignored. A command that the core rejects counts as received: the effect on the window is in the report,
//! so the host sees it. Reports carry numbered entries, which are retransmitted until the host has acknowledged them.
//!
//! Invariant: `first ≤ sent ≤ first + count`: entries before `first` are acknowledged by the host, those before `sent`
//! were sent.

use core::hash::{Hash, Hasher};

use retrace_core::{Rate, RateTarget};

use crate::frame::{FrameDecoder, MAX_PAYLOAD, MAX_WIRE, encode_with_key};
use crate::frame_size::FrameSize;
use crate::pending_commands::PendingCommands;
use crate::sequence::{FirstNumbers, acknowledged_items, is_after};
use crate::session::{is_next_opening, is_open_epoch};
use crate::wire::{ByteReader, ByteWriter, Greeting, Opening, ReportEntry, kind};
use crate::{
    ANALOG_INPUTS, AnalogInputs, CardCore, CardStatus, GearState, HEIGHT_CONTROLS, HeightState, HostCommand, Outputs,
    SpindleStatus, channel, session_key, state_crc,
};

mod changes;

/// Bytes reserved at the end of a report for the state check.
const STATE_CRC_BYTES: usize = 4;
/// Maximum number of sent entries that are not acknowledged. Later entries can still be merged, which keeps their
/// number small while the line is down.
const IN_FLIGHT: u16 = 96;

/// Storage for the entries of reports: an array, or a borrowed slice.
pub trait EntryStorage: AsRef<[ReportEntry]> + AsMut<[ReportEntry]> {}

impl<S: AsRef<[ReportEntry]> + AsMut<[ReportEntry]>> EntryStorage for S {}

/// The card's endpoint for `A` axes, with up to `E` entries that the host has not acknowledged, which are stored in
/// `S`: usually its own array. On a microcontroller the storage is provided separately, so that the card's initial
/// value in flash does not contain it.
#[derive(Clone, Debug)]
pub struct CardEndpoint<const A: usize, const E: usize, S = [ReportEntry; E]> {
    decoder: FrameDecoder<MAX_PAYLOAD>,
    pending: PendingCommands<A>,
    epoch: u16,
    last_epoch: u16,
    /// First numbers of every epoch.
    first_numbers: FirstNumbers,
    axes: u8,
    /// Axis of the layer in the last settings.
    layer_axis: u8,
    /// Number of the next command.
    next_command: u16,
    /// Number of the last accepted rate.
    rate_seq: u16,
    command_gap: bool,
    entries: S,
    /// Number of the oldest entry retained.
    first: u16,
    count: u16,
    sent: u16,
    /// Entries before this number were sent at least once: they never change again.
    sent_once: u16,
    /// Whether entries were lost because the buffer was full.
    entries_lost: bool,
    reported: ReportedState,
    greeting: Option<u32>,
    /// Nonce and key of the last opening.
    nonce: u32,
    key: u32,
    /// Whether a frame of the open epoch has arrived.
    frame_received: bool,
    report_periods: u8,
    since_report: u32,
    /// Periods without an acknowledgement while entries are outstanding.
    unconfirmed: u32,
    retransmit_periods: u32,
    urgent: bool,
    frames: FrameSize,
    stage: [u8; MAX_WIRE],
    staged: (usize, usize),
}

/// State that the entries have reported to the host.
#[derive(Clone, Copy, Debug, Hash)]
struct ReportedState {
    outputs: Outputs,
    executed: u32,
    inputs: u16,
    analog_inputs: AnalogInputs,
    alarm: Option<crate::Alarm>,
    repeated: u32,
    blocked: bool,
    layer: i32,
    height: [HeightState; HEIGHT_CONTROLS],
    probe: ReportedLatch,
    spindle: SpindleStatus,
    /// The layer of the last period.
    last_layer: i32,
}

/// State of the probe's latch, as far as it is reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum ReportedLatch {
    Idle,
    Armed,
    Edge,
    Touched,
}

impl ReportedState {
    /// Returns the state that the host knows when an epoch begins.
    const fn new(executed: u32, layer: i32) -> Self {
        Self {
            outputs: [0; channel::COUNT],
            executed,
            inputs: 0,
            analog_inputs: [None; ANALOG_INPUTS],
            alarm: None,
            repeated: 0,
            blocked: false,
            layer,
            height: [HeightState::Off; HEIGHT_CONTROLS],
            probe: ReportedLatch::Idle,
            spindle: SpindleStatus { speed: None, gear: GearState::Off, largest_lag: 0, armed_again: 0 },
            last_layer: layer,
        }
    }
}

impl<const A: usize, const E: usize> Default for CardEndpoint<A, E> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const A: usize, const E: usize> CardEndpoint<A, E> {
    /// Creates an endpoint without an open epoch.
    #[must_use]
    pub const fn new() -> Self {
        Self::starting_at(FirstNumbers::protocol(), 0)
    }

    /// Creates an endpoint as [`CardEndpoint::new`] does, whose epochs begin with these numbers and follow
    /// `last_epoch`.
    #[doc(hidden)]
    #[must_use]
    pub const fn starting_at(first_numbers: FirstNumbers, last_epoch: u16) -> Self {
        Self::with_storage([ReportEntry::NOTHING; E], first_numbers, last_epoch)
    }
}

impl<const A: usize, const E: usize> CardEndpoint<A, E, &'static mut [ReportEntry]> {
    /// Creates an endpoint as [`CardEndpoint::new`] does, whose entries are provided by
    /// [`CardEndpoint::lend_entries`].
    #[must_use]
    pub const fn without_entries() -> Self {
        Self::with_storage(&mut [], FirstNumbers::protocol(), 0)
    }

    /// Sets the storage of the entries. To be called before the serial line is served.
    pub fn lend_entries(&mut self, entries: &'static mut [ReportEntry; E]) {
        self.entries = entries;
    }
}

impl<const A: usize, const E: usize, S> CardEndpoint<A, E, S> {
    const fn with_storage(entries: S, first_numbers: FirstNumbers, last_epoch: u16) -> Self {
        const {
            assert!(
                E >= 16 && E <= 16384 && E.is_power_of_two(),
                "the number of entries is a power of two from 16 to 16384"
            )
        }
        Self {
            decoder: FrameDecoder::new(),
            pending: PendingCommands::new(),
            epoch: 0,
            last_epoch,
            first_numbers,
            axes: A as u8,
            layer_axis: 0,
            next_command: 0,
            rate_seq: 0,
            command_gap: false,
            entries,
            first: 0,
            count: 0,
            sent: 0,
            sent_once: 0,
            entries_lost: false,
            reported: ReportedState::new(0, 0),
            greeting: None,
            nonce: 0,
            key: 0,
            frame_received: false,
            report_periods: 1,
            since_report: 0,
            unconfirmed: 0,
            retransmit_periods: 50,
            urgent: false,
            frames: FrameSize::new(),
            stage: [0; MAX_WIRE],
            staged: (0, 0),
        }
    }
}

impl<const A: usize, const E: usize, S: EntryStorage> CardEndpoint<A, E, S> {
    /// Returns the open epoch, or 0.
    #[must_use]
    pub const fn epoch(&self) -> u16 {
        self.epoch
    }

    /// Processes a byte from the line, and every command that it completes.
    pub fn receive(&mut self, byte: u8, card: &mut impl CardCore<A>) {
        self.receive_byte(byte, card);
        while self.process_command(card) {}
    }

    /// Processes a byte from the line without the commands that it completes, which
    /// [`CardEndpoint::process_command`] processes one at a time.
    pub fn receive_byte(&mut self, byte: u8, card: &mut impl CardCore<A>) {
        // those of the frame before, if they were not processed
        while self.process_command(card) {}
        let Some(Ok(payload)) = self.decoder.push(byte) else { return };
        let mut copy = [0; MAX_PAYLOAD];
        let length = payload.len();
        copy[..length].copy_from_slice(payload);
        // The rest of a payload after a parse error is ignored; its commands are retransmitted.
        let has_key = self.decoder.has_key();
        let _ = self.handle_payload(ByteReader::new(&copy[..length]), has_key, card);
    }

    fn handle_payload(&mut self, mut reader: ByteReader<'_>, has_key: bool, card: &mut impl CardCore<A>) -> Option<()> {
        match (reader.u8()?, has_key) {
            (kind::HELLO, false) => self.greeting = Some(reader.u32()?),
            (kind::OPEN, false) => {
                let (boot, nonce) = (reader.u32()?, reader.u32()?);
                self.open(boot, nonce, &Opening::read(&mut reader)?, card);
            }
            (kind::STREAM, true) if self.receive_session_frame(&mut reader, card)? => {
                self.acknowledge(reader.u16()?);
                self.receive_commands(reader)?;
            }
            (kind::RATE, true) if self.receive_session_frame(&mut reader, card)? => {
                self.acknowledge(reader.u16()?);
                self.receive_rate(reader, card)?;
            }
            (kind::NAK, true) if self.receive_session_frame(&mut reader, card)? => {
                self.acknowledge(reader.u16()?);
                self.retransmit_reports();
                self.receive_rate(reader, card)?;
            }
            (kind::CLOSE, true) => {
                if self.receive_session_frame(&mut reader, card)? && card.close().is_ok() {
                    self.epoch = 0;
                    (self.count, self.sent) = (0, self.first);
                }
                // Answered also if it is already closed: its host has not received the answer yet.
                self.greeting = Some(reader.u32()?);
            }
            _ => {}
        }
        Some(())
    }

    /// Returns whether the frame belongs to the open epoch, and resets the watchdog if so.
    fn receive_session_frame(&mut self, reader: &mut ByteReader<'_>, card: &mut impl CardCore<A>) -> Option<bool> {
        let open = is_open_epoch(reader.u16()?, self.epoch);
        if open {
            self.frame_received = true;
            card.record_host_frame();
        }
        Some(open)
    }

    /// Handles an opening. An opening for this start of the card with the next epoch number begins a new epoch. One
    /// that is already open is only answered, and any other is late or a recording.
    fn open(&mut self, boot: u32, nonce: u32, opening: &Opening<A>, card: &mut impl CardCore<A>) {
        let settings = &opening.0;
        let is_next = is_next_opening(boot, settings.epoch, card.identity().boot, self.last_epoch);
        if is_next && card.open(settings).is_ok() {
            let status = card.status();
            (self.epoch, self.last_epoch, self.axes) = (settings.epoch, settings.epoch, settings.axes);
            self.layer_axis = settings.layer.map_or(0, |layer| layer.axis);
            (self.nonce, self.key, self.frame_received) = (nonce, session_key(boot, nonce, settings.epoch), false);
            self.decoder.set_key(self.key);
            let FirstNumbers { command, entry, rate } = self.first_numbers;
            (self.next_command, self.rate_seq, self.command_gap) = (command, rate, false);
            (self.first, self.count, self.sent, self.sent_once) = (entry, 0, entry, entry);
            self.entries_lost = false;
            (self.since_report, self.unconfirmed) = (0, 0);
            self.report_periods = settings.report_periods.max(1);
            self.retransmit_periods = (40_000 / settings.period_us.max(1)).max(2 + 2 * u32::from(self.report_periods));
            self.staged = (0, 0);
            self.reported = ReportedState::new(status.executed, status.layer);
            card.record_host_frame();
        } else if self.epoch != 0 && (settings.epoch, nonce) == (self.epoch, self.nonce) && !self.frame_received {
            // The host has not received the answer yet, and is alive.
            card.record_host_frame();
        }
        self.greeting = Some(nonce);
    }

    /// Handles the acknowledgement that the host has every entry before this number.
    fn acknowledge(&mut self, number: u16) {
        let known = acknowledged_items(number, self.first, self.count).unwrap_or(0);
        if known > 0 {
            let sent = self.sent.wrapping_sub(self.first);
            self.first = number;
            self.count -= known;
            self.sent = self.first.wrapping_add(sent.saturating_sub(known));
            self.unconfirmed = 0;
            self.frames.record_arrival();
        }
    }

    /// Retransmits from the first entry that is not acknowledged.
    fn retransmit_reports(&mut self) {
        (self.sent, self.unconfirmed) = (self.first, 0);
        self.frames.record_loss();
        self.urgent = true;
    }

    fn receive_commands(&mut self, mut reader: ByteReader<'_>) -> Option<()> {
        let number = reader.u16()?;
        if is_after(number, self.next_command) {
            self.command_gap = true;
            self.urgent = true;
            return None;
        }
        self.pending.set(number, self.axes, reader);
        Some(())
    }

    /// Processes the next command of the frame that was received last. Returns false if there is none left.
    pub fn process_command(&mut self, card: &mut impl CardCore<A>) -> bool {
        let Some((number, command)) = self.pending.next() else { return false };
        if number == self.next_command {
            self.next_command = self.next_command.wrapping_add(1);
            self.command_gap = false;
            match (card.accept(command), command) {
                (Err(_), HostCommand::Instruction(instruction)) => self.push(ReportEntry::Refused(instruction.number)),
                (Err(_), HostCommand::Repeat(repeated)) => self.push(ReportEntry::RepeatRefused(repeated.number)),
                _ => {}
            }
        }
        true
    }

    fn receive_rate(&mut self, mut reader: ByteReader<'_>, card: &mut impl CardCore<A>) -> Option<()> {
        let number = reader.u16()?;
        let (feed, rapid) = (Rate::from_units(reader.signed()?), Rate::from_units(reader.signed()?));
        if is_after(number, self.rate_seq) {
            self.rate_seq = number;
            // A latched alarm rejects it; an entry reports the alarm to the host.
            let _ = card.accept(HostCommand::Rate(RateTarget { feed, rapid }));
        }
        Some(())
    }

    /// Adds the entries of a control period.
    pub fn push_period(&mut self, status: &CardStatus<A>) {
        self.since_report = self.since_report.saturating_add(1);
        if self.epoch == 0 {
            return;
        }
        if self.sent != self.first {
            self.unconfirmed += 1;
            if self.unconfirmed > self.retransmit_periods {
                self.retransmit_reports();
            }
        }
        self.push_changes(status);
        let (distance, starved, at_rest) = (status.rate.over(1), status.starved, status.at_rest);
        let newest = self.first.wrapping_add(self.count).wrapping_sub(1);
        let unsent = self.count > 0 && newest.wrapping_sub(self.sent_once) < self.count;
        let last = &mut self.entries.as_mut()[usize::from(newest) % E];
        match last {
            ReportEntry::Ran { distance: t, count, starved: s, at_rest: r }
                if unsent && (*t, *s, *r) == (distance, starved, at_rest) && *count < u32::MAX =>
            {
                *count += 1;
            }
            _ => self.push(ReportEntry::Ran { distance, count: 1, starved, at_rest }),
        }
    }

    fn push(&mut self, entry: ReportEntry) {
        if usize::from(self.count) == E {
            self.entries_lost = true;
            return;
        }
        self.entries.as_mut()[usize::from(self.first.wrapping_add(self.count)) % E] = entry;
        self.count += 1;
    }

    /// Writes bytes for the line to `out`, as many as are available and fit, and returns their number.
    pub fn transmit(&mut self, card: &impl CardCore<A>, out: &mut [u8]) -> usize {
        let mut given = 0;
        while given < out.len() {
            if self.staged.0 == self.staged.1 {
                self.stage_next_frame(card);
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
    fn stage_next_frame(&mut self, card: &impl CardCore<A>) {
        self.staged = (0, 0);
        let mut payload = [0; MAX_PAYLOAD];
        let mut writer = ByteWriter::new(&mut payload);
        let mut key = 0;
        let written = if let Some(nonce) = self.greeting.take() {
            self.write_greeting(&mut writer, nonce, card)
        } else if self.epoch != 0 && (self.urgent || self.since_report >= u32::from(self.report_periods)) {
            (self.urgent, self.since_report) = (false, 0);
            key = self.key;
            self.write_report(&mut writer, card.status())
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

    fn write_greeting(&self, writer: &mut ByteWriter<'_>, nonce: u32, card: &impl CardCore<A>) -> Option<()> {
        let status = card.status();
        let mut counts = status.counts;
        if let Some(count) = counts.get_mut(usize::from(self.layer_axis)) {
            *count += i64::from(status.layer);
        }
        let greeting = Greeting {
            nonce,
            identity: *card.identity(),
            epoch: self.epoch,
            last_epoch: self.last_epoch,
            place: status.place,
            at_rest: status.at_rest,
            reached: status.reached,
            executed: status.executed,
            counts,
            layer: (self.layer_axis, status.layer),
            alarm: status.alarm,
        };
        writer.u8(kind::WELCOME)?;
        greeting.write(writer)
    }

    /// Writes the header, as many entries from `sent` on as fit, and, if these are all, the check of place and counts.
    fn write_report(&mut self, writer: &mut ByteWriter<'_>, status: &CardStatus<A>) -> Option<()> {
        writer.u8(kind::REPORT)?;
        writer.u16(self.epoch)?;
        writer.u16(self.next_command)?;
        writer.u16(self.rate_seq)?;
        let flags_at = writer.len();
        writer.u8(0)?;
        writer.u32(status.low.number())?;
        writer.count(u64::from(status.high.since(status.low)))?;
        writer.u16(self.sent)?;
        let end = self.first.wrapping_add(self.count);
        let most = self.frames.max_payload() - STATE_CRC_BYTES;
        while self.sent != end && self.sent.wrapping_sub(self.first) < IN_FLIGHT {
            let entry = self.entries.as_ref()[usize::from(self.sent) % E];
            let length = writer.len();
            if entry.write(writer).is_none() || writer.len() > most {
                writer.truncate(length);
                break;
            }
            self.sent = self.sent.wrapping_add(1);
        }
        if is_after(self.sent, self.sent_once) {
            self.sent_once = self.sent;
        }
        let all = self.sent == end;
        writer.overwrite(flags_at, u8::from(self.command_gap) | u8::from(all) << 1 | u8::from(self.entries_lost) << 2);
        if all {
            writer.u32(state_crc(status.place, &status.counts, self.axes))?;
        } else if self.sent.wrapping_sub(self.first) < IN_FLIGHT {
            // the remaining entries follow at once
            self.urgent = true;
        }
        Some(())
    }

    /// Hashes what decides about the endpoint's later behaviour: entries that are outstanding and bytes that are
    /// staged, not what those arrays held before.
    ///
    /// The adaptive size of reports is left out: it makes no difference while every report fits the shortest one. A
    /// model that uses this has to check that.
    #[doc(hidden)]
    pub fn hash_state(&self, state: &mut impl Hasher) {
        #[rustfmt::skip] // no `..`: a new field has to be decided about here
        let Self {
            decoder, pending, epoch, last_epoch, first_numbers, axes, layer_axis, next_command, rate_seq, command_gap,
            entries, first, count, sent, sent_once, entries_lost, reported, greeting, nonce, key, frame_received,
            report_periods, since_report, unconfirmed, retransmit_periods, urgent, frames: _, stage, staged,
        } = self;
        decoder.hash_state(state);
        pending.hash_state(state);
        (epoch, last_epoch, first_numbers, axes, layer_axis, next_command, rate_seq, command_gap).hash(state);
        (0..*count).for_each(|k| entries.as_ref()[usize::from(first.wrapping_add(k)) % E].hash(state));
        (first, count, sent, sent_once, entries_lost, reported).hash(state);
        (greeting, nonce, key, frame_received, report_periods).hash(state);
        (*since_report).min(u32::from(*report_periods)).hash(state);
        (unconfirmed, retransmit_periods, urgent, &stage[staged.0..staged.1]).hash(state);
    }
}
