//! Transmitted frames and their timing: the rate first, then commands in frames of adaptive length, and keep-alive
//! frames.
//!
//! Invariant: a frame is sent completely, or is ended early by a zero byte, so that the card never takes two frames for
//! one.

use super::{HostEndpoint, Phase, StagedFrame};
use crate::HostCommand;
use crate::frame::{MAX_PAYLOAD, MAX_WIRE, encode_with_key};
use crate::wire::{ByteWriter, Opening, RecordRun, kind, write_command};
use retrace_core::Rate;

/// Number of records that are sent at once; fewer are sent when one has waited for [`GATHER_US`].
const GATHER: usize = 8;
const GATHER_US: u64 = 12_000;
/// Interval at which a greeting request or an opening is repeated.
const ASK_US: u64 = 20_000;
/// Interval at which an unacknowledged rate is repeated.
const REPEAT_US: u64 = 12_000;
/// Minimum time between two rates, except for one that stops or reverses.
const RATES_US: u64 = 3_000;
/// Maximum time between two frames of the host.
const HEARTBEAT_US: u64 = 16_000;
/// Silence of the card after which a greeting is requested, to detect a restart.
const PROBE_US: u64 = 100_000;
/// Interval at which unacknowledged commands are retransmitted.
const AGAIN_US: u64 = 60_000;
/// Minimum time between two requests for a missing report.
const MISSED_US: u64 = 8_000;
/// Approximate bytes of a frame with a rate.
const RATE_FRAME: usize = 22;

impl<const A: usize, const CELLS: usize, const ENTRIES: usize, const COMMANDS: usize>
    HostEndpoint<A, CELLS, ENTRIES, COMMANDS>
{
    /// Writes bytes for the line to `out`, as many as are due and fit, and returns their number.
    pub fn transmit(&mut self, now_us: u64, out: &mut [u8]) -> usize {
        self.times.now = now_us;
        self.preempt_frame();
        let mut given = 0;
        while given < out.len() {
            if self.staged.0 == self.staged.1 && !self.stage_next_frame() {
                break;
            }
            let (at, end) = self.staged;
            let count = (end - at).min(out.len() - given);
            out[given..given + count].copy_from_slice(&self.stage[at..at + count]);
            given += count;
            self.staged.0 += count;
        }
        self.counts.written += given as u64;
        given
    }

    /// Cuts short a long frame that is being sent, in favour of a rate that stops or reverses: a zero byte, then the
    /// rate. The frame is sent again later.
    fn preempt_frame(&mut self) {
        let (at, end) = self.staged;
        let StagedFrame::Stream(offset) = self.staged_kind else { return };
        if self.phase == Phase::Open && at < end && self.rate_due() && (at == 0 || end - at > 2 * RATE_FRAME) {
            self.sent = self.sent.min(offset);
            self.staged_kind = StagedFrame::Other;
            self.compose_rate(kind::RATE);
            if at > 0 {
                self.stage.copy_within(..self.staged.1, 1);
                self.stage[0] = 0;
                self.staged.1 += 1;
            }
        }
    }

    /// Whether the card has not acknowledged the rate and it is time to send it.
    fn rate_due(&self) -> bool {
        if self.acked_rate_seq == self.rate_seq {
            return false;
        }
        let again = self.times.number == self.rate_seq;
        let target = self.target.faster();
        let stops = target == Rate::ZERO || target.signum() != self.sent_rate.signum();
        let apart = match (again, stops) {
            (true, _) => REPEAT_US,
            (false, true) => 0,
            (false, false) => RATES_US,
        };
        self.times.now.saturating_sub(self.times.rate) >= apart
    }

    /// Stages the next frame that is due. Returns false if none is.
    fn stage_next_frame(&mut self) -> bool {
        self.staged = (0, 0);
        self.staged_kind = StagedFrame::Other;
        let now = self.times.now;
        let asks = now.saturating_sub(self.times.hello) >= ASK_US || self.times.hello == 0;
        match self.phase {
            Phase::Identifying | Phase::Opening | Phase::Closing if asks => {
                self.times.hello = now.max(1);
                self.compose_other()
            }
            Phase::Open => self.compose_open(),
            _ => false,
        }
    }

    fn compose_open(&mut self) -> bool {
        let now = self.times.now;
        if self.sent > 0 && now.saturating_sub(self.times.progress) >= AGAIN_US {
            self.retransmit();
        }
        if now.saturating_sub(self.times.received) >= PROBE_US && now.saturating_sub(self.times.hello) >= ASK_US {
            if !self.probing {
                (self.probe, self.probing) = (self.probe.wrapping_add(1), true);
            }
            self.times.hello = now.max(1);
            return self.compose_hello(self.probe);
        }
        let asked = self.greeting.is_none() && now.saturating_sub(self.times.hello) >= ASK_US;
        if asked {
            self.times.hello = now.max(1);
            return self.compose_other();
        }
        if self.report_missing && now.saturating_sub(self.times.nak) >= MISSED_US {
            (self.report_missing, self.times.nak) = (false, now);
            return self.compose_rate(kind::NAK);
        }
        if self.rate_due() {
            return self.compose_rate(kind::RATE);
        }
        let unsent = usize::from(self.count - self.sent);
        let waited = now.saturating_sub(self.times.queued) >= GATHER_US;
        if unsent > 0 && (unsent >= GATHER || waited || self.has_unsent_command()) {
            return self.compose_stream();
        }
        now.saturating_sub(self.times.frame) >= HEARTBEAT_US && self.compose_rate(kind::RATE)
    }

    /// Whether there is an unsent command that is not a record.
    fn has_unsent_command(&self) -> bool {
        let command = |k: u16| &self.queue[usize::from(self.base.wrapping_add(k)) % COMMANDS];
        (self.sent..self.count).any(|k| !matches!(command(k), HostCommand::Ahead { .. } | HostCommand::Behind { .. }))
    }

    fn compose_rate(&mut self, kind: u8) -> bool {
        let mut payload = [0; 32];
        let mut writer = ByteWriter::new(&mut payload);
        let Some(settings) = &self.settings else { return false };
        let written = (|| {
            writer.u8(kind)?;
            writer.u16(settings.epoch)?;
            writer.u16(self.next_entry)?;
            writer.u16(self.rate_seq)?;
            writer.signed(self.target.feed.units())?;
            writer.signed(self.target.rapid.units())
        })();
        let length = writer.len();
        self.times.rate = self.times.now;
        self.times.number = self.rate_seq;
        self.sent_rate = self.target.faster();
        written.is_some() && self.stage(&payload[..length], self.key)
    }

    fn compose_stream(&mut self) -> bool {
        let mut payload = [0; MAX_PAYLOAD];
        let mut writer = ByteWriter::new(&mut payload);
        let Some(settings) = &self.settings else { return false };
        let offset = self.sent;
        let mut run = RecordRun::new(settings.axes);
        let head = (|| {
            writer.u8(kind::STREAM)?;
            writer.u16(settings.epoch)?;
            writer.u16(self.next_entry)?;
            writer.u16(self.base.wrapping_add(offset))
        })();
        while head.is_some() && self.sent < self.count {
            let command = &self.queue[usize::from(self.base.wrapping_add(self.sent)) % COMMANDS];
            if write_command(&mut writer, &mut run, command).is_none() {
                break;
            }
            self.sent += 1;
            if writer.len() >= self.frames.max_payload() {
                break;
            }
        }
        let length = writer.len();
        if offset == 0 {
            self.times.progress = self.times.now;
        }
        self.times.queued = self.times.now;
        let staged = self.sent > offset && self.stage(&payload[..length], self.key);
        self.staged_kind = StagedFrame::Stream(offset);
        staged
    }

    fn compose_other(&mut self) -> bool {
        let mut payload = [0; MAX_PAYLOAD];
        let mut writer = ByteWriter::new(&mut payload);
        let written = (|| match (self.phase, &self.settings) {
            (Phase::Opening, Some(settings)) => {
                writer.u8(kind::OPEN)?;
                writer.u32(self.boot)?;
                writer.u32(self.opening)?;
                Opening(*settings).write(&mut writer)
            }
            (Phase::Closing, Some(settings)) => {
                writer.u8(kind::CLOSE)?;
                writer.u16(settings.epoch)?;
                writer.u32(self.opening)
            }
            _ => None,
        })();
        let length = writer.len();
        let key = if self.phase == Phase::Closing { self.key } else { 0 };
        match written {
            Some(()) => self.stage(&payload[..length], key),
            None => self.compose_hello(self.nonce),
        }
    }

    /// Stages a greeting request.
    fn compose_hello(&mut self, nonce: u32) -> bool {
        let mut payload = [0; 5];
        payload[0] = kind::HELLO;
        payload[1..].copy_from_slice(&nonce.to_le_bytes());
        self.stage(&payload, 0)
    }

    fn stage(&mut self, payload: &[u8], key: u32) -> bool {
        let mut wire = [0; MAX_WIRE];
        let Some(frame) = encode_with_key(payload, &mut wire, key) else { return false };
        self.stage[..frame.len()].copy_from_slice(frame);
        self.staged = (0, frame.len());
        self.times.frame = self.times.now;
        true
    }
}
