//! The host's end of the line: words in, frames out; reports in, control periods out. It knows no clock and no port.
//!
//! What a word will do to the card's window is foreseen with the card's own rule; where the card decided otherwise its report says so,
//! and what is foreseen is reckoned anew from there. So credit needs no messages of its own: it is the window that the card
//! reports, at both ends, and the words on their way to it.
//!
//! Invariant: the status that is given out is what the card reported, period by period, none left out; increments and counts are
//! those of the records between the places, and their echo from the card is compared.

mod fault;
mod period_reports;
mod rx;
mod tx;

pub use fault::LinkError;

use retrace_core::drive::Braking;
use retrace_core::limits::RateLimits;
use retrace_core::{ONE, Place, RateTarget, Travel};

use crate::frame::{FrameDecoder, MAX_PAYLOAD, MAX_WIRE};
use crate::frame_size::FrameSize;
use crate::predicted_window::PredictedWindow;
use crate::wire::{Greeting, ReportEntry};
use crate::{
    Alarm, CardSettings, CardStatus, CommandRefusal, HostCommand, PathStart, channel, next_epoch, session_key,
};

/// Words on their way, at most. So many records are in hand of the line and not of the card's window.
const WORDS: usize = 128;
/// Records that are kept of the path: twice the largest window that is made use of.
const CELLS: usize = 8192;
/// Entries that were reported and not given out yet.
const ENTRIES: usize = 1024;

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
enum StagedFrame {
    Other,
    /// Words from this offset in the queue on.
    Stream(u16),
}

/// An order to clear the alarm, on its way: until its outcome is known the alarm is not a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum AlarmClearing {
    /// The word has this number.
    Asked(u16),
    /// The card took it; what became of it stands before the next control period that is reported, of this number at the least.
    Taken(u16),
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
    pub retransmitted: u64,
}

/// The host's end, for up to `A` axes.
#[derive(Clone, Debug)]
pub struct HostEndpoint<const A: usize> {
    phase: Phase,
    nonce: u32,
    greeting: Option<Greeting<A>>,
    /// Boot number of the card whose epoch is open.
    boot: u32,
    /// Nonce and key of the last opening.
    opening: u32,
    key: u32,
    /// Number of the last question that was asked because the card was silent, and whether it is open.
    probe: u32,
    probing: bool,
    settings: Option<CardSettings<A>>,
    decoder: FrameDecoder<MAX_PAYLOAD>,
    queue: [HostCommand<A>; WORDS],
    /// Number of the oldest word that is not confirmed.
    base: u16,
    count: u16,
    /// How many of these are sent.
    sent: u16,
    mirror: PredictedWindow<A, CELLS>,
    /// The end of the window that the card reported.
    held: u32,
    target: RateTarget,
    /// The rate that was sent last.
    told: Travel,
    now_number: u16,
    now_seen: u16,
    entries: [ReportEntry; ENTRIES],
    taken: u16,
    waiting: u16,
    /// The last period noted was given out.
    given: bool,
    /// Number of the next entry.
    next_entry: u16,
    /// The place that the last entry leads to.
    newest: Place,
    status: CardStatus<A>,
    /// The card's check of place and counts after the last entry.
    echo: Option<u32>,
    /// A report came that does not follow the last one.
    missing: bool,
    /// The card moves by itself, off the path, until the next opening: homing.
    off_path: bool,
    /// Openings that were answered and not followed.
    refusals: u8,
    fault: Option<LinkError>,
    alarm: Option<Alarm>,
    clearing: Option<AlarmClearing>,
    times: HostTimes,
    counts: LineCounts,
    frames: FrameSize,
    stage: [u8; MAX_WIRE + 1],
    staged: (usize, usize),
    kind: StagedFrame,
}

/// When what happened last, in microseconds of the port's clock.
#[derive(Clone, Copy, Debug, Default)]
struct HostTimes {
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
    missed: u64,
}

impl<const A: usize> HostEndpoint<A> {
    /// An end that asks who is there; `nonce` tells its question from older ones.
    #[must_use]
    pub fn new(nonce: u32) -> Self {
        Self {
            phase: Phase::Asking,
            nonce: nonce.max(1),
            greeting: None,
            boot: 0,
            opening: 0,
            key: 0,
            probe: nonce.rotate_left(16),
            probing: false,
            settings: None,
            decoder: FrameDecoder::new(),
            queue: [HostCommand::ClearAlarm; WORDS],
            base: 0,
            count: 0,
            sent: 0,
            mirror: PredictedWindow::new(0, 4, 0),
            held: 0,
            target: RateTarget::ZERO,
            told: 0,
            now_number: 0,
            now_seen: 0,
            entries: [ReportEntry::Inputs(0); ENTRIES],
            taken: 0,
            waiting: 0,
            given: false,
            next_entry: 0,
            newest: Place::start_of(0),
            status: CardStatus::at_rest(PathStart::at(0)),
            echo: None,
            missing: false,
            off_path: false,
            refusals: 0,
            fault: None,
            alarm: None,
            clearing: None,
            times: HostTimes::default(),
            counts: LineCounts::default(),
            frames: FrameSize::new(),
            stage: [0; MAX_WIRE + 1],
            // who opens a line in use sends a zero first
            staged: (0, 1),
            kind: StagedFrame::Other,
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
        if self.phase == Phase::Closed {
            self.phase = Phase::Asking;
        }
    }

    /// Begins an epoch with these settings; its number is set here.
    pub fn open(&mut self, mut settings: CardSettings<A>) {
        let Some(greeting) = &self.greeting else { return };
        settings.epoch = next_epoch(greeting.last_epoch);
        // another number than that of the question, so that its answer is not taken for the opening's
        (self.boot, self.opening, self.probing) = (greeting.identity.boot, !self.nonce, false);
        self.key = session_key(self.boot, self.opening, settings.epoch);
        self.decoder.set_key(self.key);
        let window = greeting.identity.window.min(CELLS as u32 / 2);
        let (counts, start) = (greeting.counts, settings.start);
        self.mirror = PredictedWindow::new(start.place.record, window, stopping(&settings.limits));
        (self.base, self.count, self.sent) = (0, 0, 0);
        (self.target, self.told, self.now_number, self.now_seen, self.times.number) = (RateTarget::ZERO, 0, 0, 0, 0);
        (self.taken, self.waiting, self.next_entry) = (0, 0, 0);
        (self.newest, self.held) = (start.place, start.place.record);
        // Periods are counted on, whatever epoch they belong to.
        self.status = CardStatus { counts, period: self.status.period, ..CardStatus::at_rest(start) };
        (self.echo, self.off_path, self.refusals, self.fault, self.alarm) = (None, false, 0, None, None);
        self.clearing = None;
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

    /// Does the card's answer say that it stands where the last period given out left it? Homing leaves the path, so that it says nothing.
    #[must_use]
    pub fn is_where_reported(&self) -> bool {
        self.off_path || self.greeting.as_ref().is_none_or(|said| said.place == self.status.place)
    }

    /// Has the card confirmed that the epoch is over?
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.phase == Phase::Closed
    }

    /// Has the card taken every word and the rate?
    #[must_use]
    pub fn is_acknowledged(&self) -> bool {
        self.count == 0 && self.now_seen == self.now_number
    }

    /// What ended the run, once every period before it was given out. An alarm that is to be cleared is none before the card has
    /// said that it stays.
    #[must_use]
    pub fn fault(&self) -> Option<LinkError> {
        match (self.fault, self.alarm) {
            (Some(fault), _) => Some(fault),
            (None, Some(alarm)) if self.waiting == 0 && self.status.at_rest && self.clearing.is_none() => {
                Some(LinkError::Alarm(alarm))
            }
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
    pub fn status(&self) -> &CardStatus<A> {
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
    pub fn send(&mut self, word: HostCommand<A>) -> Result<(), CommandRefusal> {
        match word {
            HostCommand::Rate(target) => {
                // It also stops a homing axis, which no rate has set in motion: there it is sent again as often as it is asked for.
                let stops_homing = target == RateTarget::ZERO && self.off_path && self.now_seen == self.now_number;
                if target != self.target || stops_homing {
                    self.target = target;
                    self.now_number = self.now_number.wrapping_add(1);
                }
                return Ok(());
            }
            HostCommand::Action(action) if usize::from(action.channel) >= channel::COUNT => {
                return Err(CommandRefusal::NoSuchChannel);
            }
            HostCommand::ManualOutput(change) if usize::from(change.channel) >= channel::COUNT => {
                return Err(CommandRefusal::NoSuchChannel);
            }
            HostCommand::Repeat(repeated)
                if repeated.changes().iter().any(|change| usize::from(change.channel) >= channel::COUNT) =>
            {
                return Err(CommandRefusal::NoSuchChannel);
            }
            _ => {}
        }
        // A few places are kept for what is not a record, so that it never has to wait behind records.
        let room = if matches!(word, HostCommand::Ahead { .. } | HostCommand::Behind { .. } | HostCommand::Action(_)) {
            16
        } else {
            0
        };
        if usize::from(self.count) + room >= WORDS {
            return Err(CommandRefusal::Full);
        }
        self.mirror.predict(&word, self.newest, self.may_run())?;
        self.off_path |= matches!(word, HostCommand::Home(_));
        if self.count == self.sent {
            self.times.queued = self.times.now;
        }
        let number = self.base.wrapping_add(self.count);
        if matches!(word, HostCommand::ClearAlarm) {
            self.clearing = Some(AlarmClearing::Asked(number));
        }
        self.queue[usize::from(number) % WORDS] = word;
        self.count += 1;
        self.show_window();
        Ok(())
    }

    /// May the cursor be elsewhere than where it was last reported?
    fn may_run(&self) -> bool {
        self.target != RateTarget::ZERO || !self.status.at_rest || self.now_seen != self.now_number || self.waiting != 0
    }

    fn show_window(&mut self) {
        (self.status.low, self.status.high) = (self.mirror.low(), self.mirror.high());
    }
}

/// Records that the cursor runs at most from where it is told to stop, at rate one.
fn stopping<const A: usize>(limits: &RateLimits<A>) -> u32 {
    let ramp = Braking::<32>::new(limits).map_or(0, |braking| (braking.length(ONE) >> 32) as u32);
    ramp + u32::from(limits.average()) / 2 + 4
}
