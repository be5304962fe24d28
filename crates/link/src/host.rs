//! The host's end of the line: words in, frames out; reports in, control periods out. It knows no clock and no port.
//!
//! What a word will do to the card's window is foreseen with the card's own rule; where the card decided otherwise its report says so,
//! and what is foreseen is reckoned anew from there. So credit needs no messages of its own: it is the window that the card
//! reports, at both ends, and the words on their way to it.
//!
//! Invariant: the status that is given out is what the card reported, period by period, none left out; increments and counts are
//! those of the records between the places, and their echo from the card is compared.

use core::fmt;

use retrace_core::place::before;
use retrace_core::playback::emission;
use retrace_core::{Place, Travel};

use crate::frame::{Decoder, MOST_PAYLOAD, MOST_WIRE, encode};
use crate::frame_size::FrameSize;
use crate::mirror::Mirror;
use crate::wire::{Entry, Greeting, Opening, Reader, Run, Writer, kind, write_word};
use crate::{Alarm, CardFault, PROTOCOL, Refusal, Settings, Status, Word, channel, echo};

/// Words on their way, at most. So many records are in hand of the line and not of the card's window.
const WORDS: usize = 128;
/// Records that are kept of the path: twice the largest window that is made use of.
const CELLS: usize = 8192;
/// Entries that were reported and not given out yet.
const ENTRIES: usize = 1024;
/// Records are sent when there are so many, or when one has waited for [`GATHER_US`].
const GATHER: usize = 8;
const GATHER_US: u64 = 6_000;
/// A question or an opening is repeated after so long.
const ASK_US: u64 = 40_000;
/// A rate that is not confirmed is repeated after so long.
const REPEAT_US: u64 = 12_000;
/// Two rates are at least so far apart, but for one that stops or turns.
const RATES_US: u64 = 3_000;
/// The host is heard of at least so often.
const HEARTBEAT_US: u64 = 16_000;
/// Words that are not confirmed are sent again after so long.
const AGAIN_US: u64 = 60_000;
/// And after a gap that the card tells of, at most so often.
const GAP_US: u64 = 12_000;

/// What ends a run on a card for good.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HostFault {
    /// The card latched an alarm and stands.
    Alarm(Alarm),
    /// Nothing was heard from the card for too long.
    Silent,
    /// The card was restarted, or serves another host: this epoch is no longer open.
    Restarted,
    /// The card's echo of place and counts is not what the records between come to.
    Disagrees,
    /// The card had more to report than it could keep.
    ReportLost,
    /// The card refused an instruction.
    Refused(u32),
    /// The card speaks another version of the protocol.
    Protocol(u8),
    /// The card refused the settings.
    Unfit,
}

impl CardFault for HostFault {
    fn number(&self) -> &'static str {
        match self {
            Self::Alarm(alarm) => alarm.number(),
            Self::Silent => "E3002",
            Self::Restarted => "E3003",
            Self::Disagrees => "E3004",
            Self::ReportLost => "E3005",
            Self::Refused(_) => "E3006",
            Self::Protocol(_) => "E3007",
            Self::Unfit => "E3008",
        }
    }

    fn remedy(&self) -> &'static str {
        match self {
            Self::Alarm(alarm) => alarm.remedy(),
            Self::Silent => {
                "check cable and power; the card stops by itself, and says where it stands when asked again"
            }
            Self::Restarted | Self::Disagrees | Self::ReportLost => "home the machine before it is moved again",
            Self::Refused(_) => "see what the card's alarm says, and run the program again; please report this",
            Self::Protocol(_) => "put the card's firmware and this program on versions that belong together",
            Self::Unfit => "wait until the machine stands; compare the machine file with what `retrace card who` says",
        }
    }
}

impl fmt::Display for HostFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Alarm(alarm) => alarm.fmt(f),
            Self::Silent => write!(f, "nothing is heard from the card"),
            Self::Restarted => write!(f, "the card was restarted, or another host has taken it over"),
            Self::Disagrees => write!(f, "the card's counts are not those of the path that was sent"),
            Self::ReportLost => write!(f, "the card could not keep all that it had to report while the line was down"),
            Self::Refused(number) => write!(f, "the card refused switching instruction {number}"),
            Self::Protocol(version) => {
                write!(f, "the card speaks version {version} of the protocol, this program version {PROTOCOL}")
            }
            Self::Unfit => write!(f, "the card cannot work by these settings, or is in motion"),
        }
    }
}

/// Where the conversation has come to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Asking,
    Opening,
    Open,
    Closing,
    Closed,
}

/// What is being put on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Staged {
    Other,
    /// Words from this offset in the queue on.
    Stream(u16),
}

/// Counters of the line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineCounts {
    /// Bytes written.
    pub written: u64,
    /// Bytes read.
    pub read: u64,
    /// Frames that were damaged on their way here.
    pub damaged: u64,
    /// Times that words were sent again.
    pub again: u64,
}

/// The host's end, for up to `A` axes.
#[derive(Clone, Debug)]
pub struct Host<const A: usize> {
    phase: Phase,
    nonce: u32,
    greeting: Option<Greeting<A>>,
    settings: Option<Settings<A>>,
    decoder: Decoder<MOST_PAYLOAD>,
    queue: [Word<A>; WORDS],
    /// Number of the oldest word that is not confirmed.
    base: u16,
    count: u16,
    /// How many of these are sent.
    sent: u16,
    mirror: Mirror<A, CELLS>,
    /// The end of the window that the card reported.
    held: u32,
    target: Travel,
    /// The rate that was sent last.
    told: Travel,
    now_number: u16,
    now_seen: u16,
    entries: [Entry; ENTRIES],
    taken: u16,
    waiting: u16,
    /// Number of the next entry.
    next_entry: u16,
    /// The place that the last entry leads to.
    newest: Place,
    status: Status<A>,
    /// The card's check of place and counts after the last entry.
    echo: Option<u32>,
    /// The card moves by itself, off the path, until the next opening: homing.
    off_path: bool,
    fault: Option<HostFault>,
    alarm: Option<Alarm>,
    times: Times,
    counts: LineCounts,
    frames: FrameSize,
    stage: [u8; MOST_WIRE + 1],
    staged: (usize, usize),
    kind: Staged,
}

/// When what happened last, in microseconds of the port's clock.
#[derive(Clone, Copy, Debug, Default)]
struct Times {
    now: u64,
    asked: u64,
    rate: u64,
    /// Number of the rate that was sent last.
    number: u16,
    frame: u64,
    heard: u64,
    progress: u64,
    queued: u64,
    gap: u64,
}

impl<const A: usize> Host<A> {
    /// An end that asks who is there; `nonce` tells its question from older ones.
    #[must_use]
    pub fn new(nonce: u32) -> Self {
        Self {
            phase: Phase::Asking,
            nonce: nonce.max(1),
            greeting: None,
            settings: None,
            decoder: Decoder::new(),
            queue: [Word::ClearAlarm; WORDS],
            base: 0,
            count: 0,
            sent: 0,
            mirror: Mirror::new(0, 4, 0),
            held: 0,
            target: 0,
            told: 0,
            now_number: 0,
            now_seen: 0,
            entries: [Entry::Inputs(0); ENTRIES],
            taken: 0,
            waiting: 0,
            next_entry: 0,
            newest: Place::start_of(0),
            status: Status::standing(0),
            echo: None,
            off_path: false,
            fault: None,
            alarm: None,
            times: Times::default(),
            counts: LineCounts::default(),
            frames: FrameSize::new(),
            stage: [0; MOST_WIRE + 1],
            // who opens a line in use sends a zero first
            staged: (0, 1),
            kind: Staged::Other,
        }
    }

    /// Who answered, and where the machine stood then.
    #[must_use]
    pub fn greeting(&self) -> Option<&Greeting<A>> {
        self.greeting.as_ref()
    }

    /// Asks anew who is there and where the machine stands.
    pub fn ask(&mut self, nonce: u32) {
        (self.nonce, self.greeting) = (nonce.max(1), None);
        self.times.asked = 0;
    }

    /// Begins an epoch with these settings; its number is set here.
    pub fn open(&mut self, mut settings: Settings<A>) {
        let Some(greeting) = &self.greeting else { return };
        settings.epoch = match greeting.last_epoch.wrapping_add(1) {
            0 => 1,
            next => next,
        };
        let window = greeting.identity.window.min(CELLS as u32 / 2);
        let (counts, start) = (greeting.counts, settings.start);
        self.mirror = Mirror::new(start, window, u32::from(settings.smoothing.periods()));
        (self.base, self.count, self.sent) = (0, 0, 0);
        (self.target, self.told, self.now_number, self.now_seen, self.times.number) = (0, 0, 0, 0, 0);
        (self.taken, self.waiting, self.next_entry) = (0, 0, 0);
        (self.newest, self.held) = (Place::start_of(start), start);
        self.status = Status { counts, ..Status::standing(start) };
        (self.echo, self.off_path, self.fault, self.alarm) = (None, false, None, None);
        self.times.asked = 0;
        self.times.heard = self.times.now;
        self.settings = Some(settings);
        self.phase = Phase::Opening;
    }

    /// Ends the epoch.
    pub fn close(&mut self) {
        if matches!(self.phase, Phase::Open | Phase::Opening) {
            self.phase = Phase::Closing;
            self.times.asked = 0;
        }
    }

    /// Is the epoch open, and the first report there?
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.phase == Phase::Open && self.next_entry != 0
    }

    /// Has the card confirmed that the epoch is over?
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.phase == Phase::Closed
    }

    /// What ended the run, once every period before it was given out.
    #[must_use]
    pub fn fault(&self) -> Option<HostFault> {
        match (self.fault, self.alarm) {
            (Some(fault), _) => Some(fault),
            (None, Some(alarm)) if self.waiting == 0 && self.status.at_rest => Some(HostFault::Alarm(alarm)),
            _ => None,
        }
    }

    /// Counters of the line.
    #[must_use]
    pub fn line(&self) -> LineCounts {
        self.counts
    }

    /// The status of the last period given out; its window is the one that is foreseen.
    #[must_use]
    pub fn status(&self) -> &Status<A> {
        &self.status
    }

    /// The place behind the last record that the card reported to hold.
    #[must_use]
    pub fn arrived(&self) -> u32 {
        self.held
    }

    /// Records that the card can hold.
    #[must_use]
    pub fn window(&self) -> u32 {
        self.mirror.window()
    }

    /// Microseconds since the card was heard of, at the time of the last call.
    #[must_use]
    pub fn silent_us(&self) -> u64 {
        self.times.now.saturating_sub(self.times.heard)
    }

    /// Takes a word for the card.
    ///
    /// # Errors
    /// [`Refusal`] as the card would say, by what is known of it; [`Refusal::Full`] also while the line has enough in hand.
    pub fn send(&mut self, word: Word<A>) -> Result<(), Refusal> {
        match word {
            Word::Rate { target } => {
                if target != self.target {
                    self.target = target;
                    self.now_number = self.now_number.wrapping_add(1);
                }
                return Ok(());
            }
            Word::Action(action) if usize::from(action.channel) >= channel::COUNT => {
                return Err(Refusal::NoSuchChannel);
            }
            Word::ByHand(change) if usize::from(change.channel) >= channel::COUNT => {
                return Err(Refusal::NoSuchChannel);
            }
            _ => {}
        }
        // A few places are kept for what is no record, so that it never has to wait behind records.
        let room = if matches!(word, Word::Ahead { .. } | Word::Behind { .. } | Word::Action(_)) { 16 } else { 0 };
        if usize::from(self.count) + room >= WORDS {
            return Err(Refusal::Full);
        }
        self.mirror.foresee(&word, self.newest, self.may_run())?;
        self.off_path |= matches!(word, Word::Home(_));
        if self.count == self.sent {
            self.times.queued = self.times.now;
        }
        self.queue[usize::from(self.base.wrapping_add(self.count)) % WORDS] = word;
        self.count += 1;
        self.show_window();
        Ok(())
    }

    /// May the cursor be elsewhere than where it was last reported?
    fn may_run(&self) -> bool {
        self.target != 0 || !self.status.at_rest || self.now_seen != self.now_number || self.waiting != 0
    }

    fn show_window(&mut self) {
        (self.status.low, self.status.high) = (self.mirror.low(), self.mirror.high());
    }

    /// Gives out the next control period that the card reported: [`Host::status`] is that of its end. False where there is none yet.
    pub fn next_period(&mut self) -> bool {
        if self.waiting > 0 {
            self.status.wheel = 0;
        }
        while self.waiting > 0 && self.fault.is_none() {
            let at = usize::from(self.taken) % ENTRIES;
            let entry = self.entries[at];
            if let Entry::Ran { travel, count, short, at_rest } = entry {
                if count > 1 {
                    self.entries[at] = Entry::Ran { travel, count: count - 1, short, at_rest };
                } else {
                    self.drop_entry();
                }
                self.run_period(travel, short, at_rest);
                return true;
            }
            self.drop_entry();
            self.note(entry);
        }
        false
    }

    fn drop_entry(&mut self) {
        self.taken = self.taken.wrapping_add(1);
        self.waiting -= 1;
    }

    fn note(&mut self, entry: Entry) {
        match entry {
            Entry::Output(change) => {
                if let Some(output) = self.status.outputs.get_mut(usize::from(change.channel)) {
                    *output = change.value;
                }
            }
            Entry::Executed(number) => self.status.executed = number,
            Entry::Alarm(alarm) => {
                self.alarm = alarm;
                self.status.alarm = alarm;
            }
            Entry::Inputs(inputs) => self.status.inputs = inputs,
            Entry::Wheel(counts) => self.status.wheel = self.status.wheel.saturating_add(counts),
            Entry::Refused(number) => {
                // While an alarm is latched that is what is to be told.
                if self.alarm.is_none() {
                    self.fault = Some(HostFault::Refused(number));
                }
            }
            Entry::Ran { .. } => {}
        }
    }

    fn run_period(&mut self, travel: Travel, short: bool, at_rest: bool) {
        let from = self.status.place;
        let to = from.moved(travel);
        let Some(increments) = emission(from, to, |place| self.mirror.record(place)) else {
            self.fault = Some(HostFault::Disagrees);
            return;
        };
        let status = &mut self.status;
        status.period += 1;
        (status.place, status.rate, status.short, status.at_rest) = (to, travel, short, at_rest);
        // at most nine records a period
        status.increments = increments.map(|pulses| pulses as i32);
        for (count, increment) in status.counts.iter_mut().zip(increments) {
            *count += increment;
        }
        let under = if travel < 0 { to.record } else { to.boundary_ahead().wrapping_sub(1) };
        if let Some(record) = self.mirror.record(under) {
            status.line = record.line;
        }
        if before(status.reached, to.boundary_ahead()) {
            status.reached = to.boundary_ahead();
        }
        if self.waiting == 0
            && let (Some(told), Some(settings)) = (self.echo.take(), &self.settings)
            && !self.off_path
            && told != echo(status.place, &status.counts, settings.axes)
        {
            self.fault = Some(HostFault::Disagrees);
        }
    }

    /// Takes bytes off the line.
    pub fn receive(&mut self, bytes: &[u8], now_us: u64) {
        self.times.now = now_us;
        self.counts.read += bytes.len() as u64;
        for &byte in bytes {
            let mut copy = [0; MOST_PAYLOAD];
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
            let _ = self.payload(Reader::new(&copy[..length]));
        }
    }

    fn payload(&mut self, mut reader: Reader<'_>) -> Option<()> {
        match reader.u8()? {
            kind::WELCOME => match Greeting::read(&mut reader)? {
                Ok(greeting) => self.greeted(&greeting),
                Err(version) => self.fault = Some(HostFault::Protocol(version)),
            },
            kind::REPORT => self.reported(reader)?,
            _ => {}
        }
        Some(())
    }

    fn greeted(&mut self, greeting: &Greeting<A>) {
        self.times.heard = self.times.now;
        if greeting.nonce == self.nonce {
            self.greeting = Some(*greeting);
        }
        let Some(settings) = &self.settings else { return };
        match self.phase {
            Phase::Opening if greeting.epoch == settings.epoch => self.phase = Phase::Open,
            Phase::Opening if greeting.last_epoch != settings.epoch && greeting.nonce == 0 => {
                // Answered, and not opened: in motion still, or by such settings it cannot work.
                if greeting.at_rest {
                    self.fault = Some(HostFault::Unfit);
                }
            }
            Phase::Open if greeting.epoch != settings.epoch => self.fault = Some(HostFault::Restarted),
            Phase::Closing if greeting.epoch != settings.epoch => self.phase = Phase::Closed,
            _ => {}
        }
    }

    fn reported(&mut self, mut reader: Reader<'_>) -> Option<()> {
        let (epoch, next_word, now_seen) = (reader.u16()?, reader.u16()?, reader.u16()?);
        if self.settings.as_ref().is_none_or(|settings| settings.epoch != epoch) {
            return None;
        }
        if self.phase == Phase::Opening {
            self.phase = Phase::Open;
        }
        let (flags, low, length) = (reader.u8()?, reader.u32()?, reader.count32()?);
        let first = reader.u16()?;
        self.times.heard = self.times.now;
        self.entries_of(&mut reader, first, flags & 2 != 0)?;
        if flags & 4 != 0 {
            self.fault.get_or_insert(HostFault::ReportLost);
        }
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
    fn entries_of(&mut self, reader: &mut Reader<'_>, first: u16, all: bool) -> Option<()> {
        let mut number = first;
        if (number.wrapping_sub(self.next_entry) as i16) > 0 {
            return Some(());
        }
        let tail = if all { 4 } else { 0 };
        while reader.left() > tail {
            let entry = Entry::read(reader)?;
            if number == self.next_entry {
                if usize::from(self.waiting) == ENTRIES {
                    return Some(());
                }
                if let Entry::Ran { travel, count, .. } = entry {
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
            if let Staged::Stream(offset) = self.kind {
                self.kind = Staged::Stream(offset.saturating_sub(taken));
            }
        }
        self.mirror.set(low, high);
        self.held = high;
        for k in 0..self.count {
            let word = self.queue[usize::from(self.base.wrapping_add(k)) % WORDS];
            // What was foreseen to be taken is so still; what the card refuses all the same shows in a later report.
            let _ = self.mirror.foresee(&word, self.newest, false);
        }
        self.show_window();
    }

    fn again(&mut self) {
        if self.sent > 0 {
            self.counts.again += 1;
            self.sent = 0;
            self.frames.lost();
        }
        self.times.progress = self.times.now;
    }

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
        let Staged::Stream(offset) = self.kind else { return };
        if self.phase == Phase::Open && at < end && self.rate_due() && (at == 0 || end - at > 2 * RATE_FRAME) {
            self.sent = self.sent.min(offset);
            self.kind = Staged::Other;
            self.compose_now();
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
        let stops = self.target == 0 || self.target.signum() != self.told.signum();
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
        self.kind = Staged::Other;
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
        let asked = self.greeting.is_none() && now.saturating_sub(self.times.asked) >= ASK_US;
        if asked {
            self.times.asked = now.max(1);
            return self.compose_other();
        }
        if self.rate_due() {
            return self.compose_now();
        }
        let unsent = usize::from(self.count - self.sent);
        let waited = now.saturating_sub(self.times.queued) >= GATHER_US;
        if unsent > 0 && (unsent >= GATHER || waited || self.has_order()) {
            return self.compose_stream();
        }
        now.saturating_sub(self.times.frame) >= HEARTBEAT_US && self.compose_now()
    }

    /// Is there a word to be sent that is no record?
    fn has_order(&self) -> bool {
        let word = |k: u16| &self.queue[usize::from(self.base.wrapping_add(k)) % WORDS];
        (self.sent..self.count).any(|k| !matches!(word(k), Word::Ahead { .. } | Word::Behind { .. }))
    }

    fn compose_now(&mut self) -> bool {
        let mut payload = [0; 24];
        let mut writer = Writer::new(&mut payload);
        let Some(settings) = &self.settings else { return false };
        let written = (|| {
            writer.u8(kind::NOW)?;
            writer.u16(settings.epoch)?;
            writer.u16(self.next_entry)?;
            writer.u16(self.now_number)?;
            writer.signed(self.target)
        })();
        let length = writer.len();
        self.times.rate = self.times.now;
        self.times.number = self.now_number;
        self.told = self.target;
        written.is_some() && self.stage(&payload[..length])
    }

    fn compose_stream(&mut self) -> bool {
        let mut payload = [0; MOST_PAYLOAD];
        let mut writer = Writer::new(&mut payload);
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
        let staged = self.sent > offset && self.stage(&payload[..length]);
        self.kind = Staged::Stream(offset);
        staged
    }

    fn compose_other(&mut self) -> bool {
        let mut payload = [0; MOST_PAYLOAD];
        let mut writer = Writer::new(&mut payload);
        let written = (|| match (self.phase, &self.settings) {
            (Phase::Opening, Some(settings)) => {
                writer.u8(kind::OPEN)?;
                Opening(*settings).write(&mut writer)
            }
            (Phase::Closing, Some(settings)) => {
                writer.u8(kind::CLOSE)?;
                writer.u16(settings.epoch)
            }
            _ => {
                writer.u8(kind::HELLO)?;
                writer.u32(self.nonce)
            }
        })();
        let length = writer.len();
        written.is_some() && self.stage(&payload[..length])
    }

    fn stage(&mut self, payload: &[u8]) -> bool {
        let mut wire = [0; MOST_WIRE];
        let Some(frame) = encode(payload, &mut wire) else { return false };
        self.stage[..frame.len()].copy_from_slice(frame);
        self.staged = (0, frame.len());
        self.times.frame = self.times.now;
        true
    }
}

/// Bytes of a frame that carries a rate, about.
const RATE_FRAME: usize = 22;
