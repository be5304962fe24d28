//! What goes to the card, and when: the rate before everything, words in frames of some length, a sign of life at least.
//!
//! Invariant: a frame is on the line whole, or ended by a zero byte before its end, so that the card never takes two for one.

use super::{HostEndpoint, Phase, StagedFrame, WORDS};
use crate::HostCommand;
use crate::frame::{MAX_PAYLOAD, MAX_WIRE, encode_with_key};
use crate::wire::{ByteWriter, Opening, Run, kind, write_word};

/// Records are sent when there are so many, or when one has waited for [`GATHER_US`].
const GATHER: usize = 8;
const GATHER_US: u64 = 12_000;
/// A question or an opening is repeated after so long.
const ASK_US: u64 = 20_000;
/// A rate that is not confirmed is repeated after so long.
const REPEAT_US: u64 = 12_000;
/// Two rates are at least so far apart, but for one that stops or turns.
const RATES_US: u64 = 3_000;
/// The host is heard of at least so often.
const HEARTBEAT_US: u64 = 16_000;
/// A card that was silent for so long is asked whether it was restarted.
const PROBE_US: u64 = 100_000;
/// Words that are not confirmed are sent again after so long.
const AGAIN_US: u64 = 60_000;
/// A report that is missing is asked for at most so often.
const MISSED_US: u64 = 8_000;
/// Bytes of a frame that carries a rate, about.
const RATE_FRAME: usize = 22;

impl<const A: usize> HostEndpoint<A> {
    /// Bytes for the line, as many as are due and fit.
    pub fn transmit(&mut self, now_us: u64, out: &mut [u8]) -> usize {
        self.times.now = now_us;
        self.overtake();
        let mut given = 0;
        while given < out.len() {
            if self.staged.0 == self.staged.1 && !self.compose() {
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

    /// A rate that stops or turns cuts short a long frame that is on its way: a zero byte, and the rate. The frame comes again.
    fn overtake(&mut self) {
        let (at, end) = self.staged;
        let StagedFrame::Stream(offset) = self.kind else { return };
        if self.phase == Phase::Open && at < end && self.rate_due() && (at == 0 || end - at > 2 * RATE_FRAME) {
            self.sent = self.sent.min(offset);
            self.kind = StagedFrame::Other;
            self.compose_now(kind::RATE);
            if at > 0 {
                self.stage.copy_within(..self.staged.1, 1);
                self.stage[0] = 0;
                self.staged.1 += 1;
            }
        }
    }

    /// Is there a rate that the card has not confirmed, and is it time to send it?
    fn rate_due(&self) -> bool {
        if self.now_seen == self.now_number {
            return false;
        }
        let again = self.times.number == self.now_number;
        let target = self.target.faster();
        let stops = target == 0 || target.signum() != self.told.signum();
        let apart = match (again, stops) {
            (true, _) => REPEAT_US,
            (false, true) => 0,
            (false, false) => RATES_US,
        };
        self.times.now.saturating_sub(self.times.rate) >= apart
    }

    /// Stages the next frame that is due. False where none is.
    fn compose(&mut self) -> bool {
        self.staged = (0, 0);
        self.kind = StagedFrame::Other;
        let now = self.times.now;
        let asks = now.saturating_sub(self.times.asked) >= ASK_US || self.times.asked == 0;
        match self.phase {
            Phase::Asking | Phase::Opening | Phase::Closing if asks => {
                self.times.asked = now.max(1);
                self.compose_other()
            }
            Phase::Open => self.compose_open(),
            _ => false,
        }
    }

    fn compose_open(&mut self) -> bool {
        let now = self.times.now;
        if self.sent > 0 && now.saturating_sub(self.times.progress) >= AGAIN_US {
            self.again();
        }
        if now.saturating_sub(self.times.heard) >= PROBE_US && now.saturating_sub(self.times.asked) >= ASK_US {
            if !self.probing {
                (self.probe, self.probing) = (self.probe.wrapping_add(1), true);
            }
            self.times.asked = now.max(1);
            return self.compose_question(self.probe);
        }
        let asked = self.greeting.is_none() && now.saturating_sub(self.times.asked) >= ASK_US;
        if asked {
            self.times.asked = now.max(1);
            return self.compose_other();
        }
        if self.missing && now.saturating_sub(self.times.missed) >= MISSED_US {
            (self.missing, self.times.missed) = (false, now);
            return self.compose_now(kind::NAK);
        }
        if self.rate_due() {
            return self.compose_now(kind::RATE);
        }
        let unsent = usize::from(self.count - self.sent);
        let waited = now.saturating_sub(self.times.queued) >= GATHER_US;
        if unsent > 0 && (unsent >= GATHER || waited || self.has_order()) {
            return self.compose_stream();
        }
        now.saturating_sub(self.times.frame) >= HEARTBEAT_US && self.compose_now(kind::RATE)
    }

    /// Is there a word to be sent that is not a record?
    fn has_order(&self) -> bool {
        let word = |k: u16| &self.queue[usize::from(self.base.wrapping_add(k)) % WORDS];
        (self.sent..self.count).any(|k| !matches!(word(k), HostCommand::Ahead { .. } | HostCommand::Behind { .. }))
    }

    fn compose_now(&mut self, kind: u8) -> bool {
        let mut payload = [0; 32];
        let mut writer = ByteWriter::new(&mut payload);
        let Some(settings) = &self.settings else { return false };
        let written = (|| {
            writer.u8(kind)?;
            writer.u16(settings.epoch)?;
            writer.u16(self.next_entry)?;
            writer.u16(self.now_number)?;
            writer.signed(self.target.feed)?;
            writer.signed(self.target.rapid)
        })();
        let length = writer.len();
        self.times.rate = self.times.now;
        self.times.number = self.now_number;
        self.told = self.target.faster();
        written.is_some() && self.stage(&payload[..length], self.key)
    }

    fn compose_stream(&mut self) -> bool {
        let mut payload = [0; MAX_PAYLOAD];
        let mut writer = ByteWriter::new(&mut payload);
        let Some(settings) = &self.settings else { return false };
        let offset = self.sent;
        let mut run = Run::new(settings.axes);
        let head = (|| {
            writer.u8(kind::STREAM)?;
            writer.u16(settings.epoch)?;
            writer.u16(self.next_entry)?;
            writer.u16(self.base.wrapping_add(offset))
        })();
        while head.is_some() && self.sent < self.count {
            let word = &self.queue[usize::from(self.base.wrapping_add(self.sent)) % WORDS];
            if write_word(&mut writer, &mut run, word).is_none() {
                break;
            }
            self.sent += 1;
            if writer.len() >= self.frames.most() {
                break;
            }
        }
        let length = writer.len();
        if offset == 0 {
            self.times.progress = self.times.now;
        }
        self.times.queued = self.times.now;
        let staged = self.sent > offset && self.stage(&payload[..length], self.key);
        self.kind = StagedFrame::Stream(offset);
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
            None => self.compose_question(self.nonce),
        }
    }

    /// Who is there?
    fn compose_question(&mut self, nonce: u32) -> bool {
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
