//! The host's endpoint: commands in, frames out; reports in, control periods out. It has no clock and no port of its
//! own.
//!
//! The effect of a command on the card's window is predicted with the card's own rule. If the card decides otherwise,
//! its report shows that, and the prediction restarts from the reported window. Credit therefore needs no messages of
//! its own: it is the window that the card reports, known at both ends, and the commands in transit.
//!
//! Invariant: the published status is what the card reported, period by period, without omission. Increments and counts
//! are those of the records between the places, and are compared with the card's check.

mod fault;
mod period_reports;
mod rx;
mod state_hash;
mod tx;

pub use fault::LinkError;

use retrace_core::drive::Braking;
use retrace_core::limits::RateLimits;
use retrace_core::{Place, Rate, RateTarget, RecordIndex};

use crate::frame::{FrameDecoder, MAX_PAYLOAD, MAX_WIRE};
use crate::frame_size::FrameSize;
use crate::predicted_window::PredictedWindow;
use crate::sequence::FirstNumbers;
use crate::wire::{Greeting, ReportEntry};
use crate::{
    Alarm, CardSettings, CardStatus, CommandRefusal, HostCommand, PathStart, channel, next_epoch, session_key,
};

/// Maximum number of commands in transit. They occupy the line, not the card's window.
const MAX_COMMANDS: usize = 128;
/// Number of recent records retained: twice the largest window that is used.
const MAX_CELLS: usize = 8192;
/// Maximum number of reported entries that are not published yet.
const MAX_ENTRIES: usize = 1024;

/// State of the connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Phase {
    Identifying,
    Opening,
    Open,
    Closing,
    Closed,
}

/// Kind of the staged frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum StagedFrame {
    Other,
    /// Commands from this offset in the queue on.
    Stream(u16),
}

/// Progress of a command to clear the alarm: until its outcome is known, the alarm is not an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum AlarmClearing {
    /// Sent, with this command number.
    Requested(u16),
    /// The card received it; the outcome is reported before the next control period, which has at least this entry
    /// number.
    Accepted(u16),
}

/// Returns the counters of the serial line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineCounts {
    /// Bytes written.
    pub written: u64,
    /// Bytes read.
    pub read: u64,
    /// Damaged frames received.
    pub damaged: u64,
    /// Retransmissions of commands.
    pub retransmitted: u64,
}

/// The host's endpoint, for up to `A` axes. The other sizes are powers of two: of the records retained, of the entries
/// that are not published, of the commands in transit (at least 32). Only models change them.
///
/// # Examples
///
/// ```
/// use retrace_link::HostEndpoint;
///
/// let mut host = HostEndpoint::<3>::new(7);
/// let mut bytes = [0; 64];
/// let count = host.transmit(0, &mut bytes);
/// assert!(count > 0, "it asks the card for its greeting");
/// host.receive(b"not a frame", 1000);
/// assert!(host.greeting().is_none() && !host.is_open());
/// ```
#[derive(Clone, Debug)]
pub struct HostEndpoint<
    const A: usize,
    const CELLS: usize = MAX_CELLS,
    const ENTRIES: usize = MAX_ENTRIES,
    const COMMANDS: usize = MAX_COMMANDS,
> {
    /// First numbers of every epoch.
    first_numbers: FirstNumbers,
    phase: Phase,
    nonce: u32,
    greeting: Option<Greeting<A>>,
    /// Boot number of the card whose epoch is open.
    boot: u32,
    /// Nonce and key of the last opening.
    opening: u32,
    key: u32,
    /// Nonce of the last greeting request made because the card was silent, and whether its answer is outstanding.
    probe: u32,
    probing: bool,
    settings: Option<CardSettings<A>>,
    decoder: FrameDecoder<MAX_PAYLOAD>,
    queue: [HostCommand<A>; COMMANDS],
    /// Number of the oldest command that is not acknowledged.
    base: u16,
    count: u16,
    /// Number of these that are sent.
    sent: u16,
    predicted: PredictedWindow<A, CELLS>,
    /// End of the window that the card reported.
    reported_high: RecordIndex,
    target: RateTarget,
    /// Rate that was sent last.
    sent_rate: Rate,
    rate_seq: u16,
    acked_rate_seq: u16,
    entries: [ReportEntry; ENTRIES],
    first_waiting: u16,
    waiting: u16,
    /// Whether the last applied period was published.
    period_emitted: bool,
    /// Number of the next expected entry.
    next_entry: u16,
    /// Whether an entry of this epoch has arrived.
    entry_received: bool,
    /// Place after the last entry.
    newest_place: Place,
    status: CardStatus<A>,
    /// Increments of the control period before the last one.
    earlier: [i32; A],
    /// The card's check of place and counts after the last entry.
    reported_crc: Option<u32>,
    /// Whether a report arrived that does not follow the last one.
    report_missing: bool,
    /// Whether the card moves by itself, off the path, until the next opening: homing.
    off_path: bool,
    /// Number of openings that were answered without an open epoch.
    refusals: u8,
    fault: Option<LinkError>,
    alarm: Option<Alarm>,
    clearing: Option<AlarmClearing>,
    times: HostTimes,
    counts: LineCounts,
    frames: FrameSize,
    stage: [u8; MAX_WIRE + 1],
    staged: (usize, usize),
    staged_kind: StagedFrame,
}

/// Times of the last events, in microseconds of the port's clock.
#[derive(Clone, Copy, Debug, Default)]
struct HostTimes {
    now: u64,
    hello: u64,
    rate: u64,
    /// Number of the rate that was sent last.
    number: u16,
    frame: u64,
    received: u64,
    progress: u64,
    queued: u64,
    gap: u64,
    nak: u64,
}

impl<const A: usize, const CELLS: usize, const ENTRIES: usize, const COMMANDS: usize>
    HostEndpoint<A, CELLS, ENTRIES, COMMANDS>
{
    const CHECKED: () = assert!(
        ENTRIES.is_power_of_two() && ENTRIES <= 1 << 15 && COMMANDS.is_power_of_two() && COMMANDS >= 32,
        "numbers of 16 bits index these arrays over the wrap"
    );

    /// Creates an endpoint that requests a greeting; `nonce` distinguishes its request from older ones.
    #[must_use]
    pub fn new(nonce: u32) -> Self {
        Self::starting_at(nonce, FirstNumbers::protocol())
    }

    /// Creates an endpoint as [`HostEndpoint::new`] does, whose epochs begin with these numbers.
    #[doc(hidden)]
    #[must_use]
    pub fn starting_at(nonce: u32, first_numbers: FirstNumbers) -> Self {
        let () = Self::CHECKED;
        Self {
            first_numbers,
            phase: Phase::Identifying,
            nonce: nonce.max(1),
            greeting: None,
            boot: 0,
            opening: 0,
            key: 0,
            probe: nonce.rotate_left(16),
            probing: false,
            settings: None,
            decoder: FrameDecoder::new(),
            queue: [HostCommand::ClearAlarm; COMMANDS],
            base: 0,
            count: 0,
            sent: 0,
            predicted: PredictedWindow::new(RecordIndex::new(0), 4, 0),
            reported_high: RecordIndex::new(0),
            target: RateTarget::ZERO,
            sent_rate: Rate::ZERO,
            rate_seq: 0,
            acked_rate_seq: 0,
            entries: [ReportEntry::Inputs(0); ENTRIES],
            first_waiting: 0,
            waiting: 0,
            period_emitted: false,
            next_entry: 0,
            entry_received: false,
            newest_place: Place::start_of(RecordIndex::new(0)),
            status: CardStatus::at_rest(PathStart::at(RecordIndex::new(0))),
            earlier: [0; A],
            reported_crc: None,
            report_missing: false,
            off_path: false,
            refusals: 0,
            fault: None,
            alarm: None,
            clearing: None,
            times: HostTimes::default(),
            counts: LineCounts::default(),
            frames: FrameSize::new(),
            stage: [0; MAX_WIRE + 1],
            // a sender on a line in use sends a zero first
            staged: (0, 1),
            staged_kind: StagedFrame::Other,
        }
    }

    /// Returns the greeting: the identity of the card, and the machine's position at that time.
    #[must_use]
    pub fn greeting(&self) -> Option<&Greeting<A>> {
        self.greeting.as_ref()
    }

    /// Requests a new greeting, with the current position of the machine.
    pub fn request_greeting(&mut self, nonce: u32) {
        (self.nonce, self.greeting) = (nonce.max(1), None);
        self.times.hello = 0;
        if self.phase == Phase::Closed {
            self.phase = Phase::Identifying;
        }
    }

    /// Begins an epoch with these settings; its number is set here.
    pub fn open(&mut self, mut settings: CardSettings<A>) {
        let Some(greeting) = &self.greeting else { return };
        settings.epoch = next_epoch(greeting.last_epoch);
        // another nonce than that of the request, so that its answer is not taken for the opening's
        (self.boot, self.opening, self.probing) = (greeting.identity.boot, !self.nonce, false);
        self.key = session_key(self.boot, self.opening, settings.epoch);
        self.decoder.set_key(self.key);
        let window = greeting.identity.window.min(CELLS as u32 / 2);
        let (mut counts, (axis, mut layer), start) = (greeting.counts, greeting.layer, settings.start);
        if start.keeps_state && settings.layer.is_some_and(|settings| settings.axis == axis) {
            if let Some(count) = counts.get_mut(usize::from(axis)) {
                *count -= i64::from(layer);
            }
        } else {
            layer = 0;
        }
        self.predicted = PredictedWindow::new(start.place.record, window, stopping_records(&settings.limits));
        let FirstNumbers { command, entry, rate } = self.first_numbers;
        (self.base, self.count, self.sent) = (command, 0, 0);
        (self.target, self.sent_rate, self.rate_seq, self.acked_rate_seq, self.times.number) =
            (RateTarget::ZERO, Rate::ZERO, rate, rate, rate);
        (self.first_waiting, self.waiting, self.next_entry, self.entry_received) = (entry, 0, entry, false);
        (self.newest_place, self.reported_high) = (start.place, start.place.record);
        // The period number continues across epochs.
        self.status = CardStatus { counts, layer, period: self.status.period, ..CardStatus::at_rest(start) };
        (self.earlier, self.reported_crc, self.off_path) = ([0; A], None, false);
        (self.refusals, self.fault, self.alarm) = (0, None, None);
        self.clearing = None;
        self.times.hello = 0;
        self.times.received = self.times.now;
        self.settings = Some(settings);
        self.phase = Phase::Opening;
    }

    /// Ends the epoch.
    pub fn close(&mut self) {
        if matches!(self.phase, Phase::Open | Phase::Opening) {
            self.phase = Phase::Closing;
            self.times.hello = 0;
        }
    }

    /// Whether the epoch is open and the first report has arrived.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.phase == Phase::Open && self.entry_received
    }

    /// Whether the card's greeting has the position of the last published period. Homing leaves the path, so it is not
    /// compared then.
    #[must_use]
    pub fn is_where_reported(&self) -> bool {
        self.off_path || self.greeting.as_ref().is_none_or(|result| result.place == self.status.place)
    }

    /// Whether the card has confirmed the end of the epoch.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.phase == Phase::Closed
    }

    /// Whether the card has acknowledged every command and the rate.
    #[must_use]
    pub fn is_acknowledged(&self) -> bool {
        self.count == 0 && self.acked_rate_seq == self.rate_seq
    }

    /// Returns the error that ended the run, once every period before it was published. An alarm that is being cleared
    /// is not an error until the card has reported that it remains.
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

    /// Returns the counters of the serial line.
    #[must_use]
    pub fn line_counts(&self) -> LineCounts {
        self.counts
    }

    /// Returns the status of the last published period; its window is the predicted one.
    #[must_use]
    pub fn status(&self) -> &CardStatus<A> {
        &self.status
    }

    /// Returns the place after the last record that the card reported to hold.
    #[must_use]
    pub fn acknowledged_high(&self) -> RecordIndex {
        self.reported_high
    }

    /// Returns the number of records that the card can hold.
    #[must_use]
    pub fn window(&self) -> u32 {
        self.predicted.window()
    }

    /// Returns the microseconds since the last frame from the card, at the time of the last call.
    #[must_use]
    pub fn silent_us(&self) -> u64 {
        self.times.now.saturating_sub(self.times.received)
    }

    /// Queues a command for the card.
    ///
    /// # Errors
    /// Returns the predicted rejection of the card; also [`CommandRefusal::Full`] while enough commands are in transit.
    pub fn send(&mut self, command: HostCommand<A>) -> Result<(), CommandRefusal> {
        match command {
            HostCommand::Rate(target) => {
                // A rate of zero also stops a homing axis, which no rate has started: it is therefore sent each time it
                // is requested.
                let stops_homing = target == RateTarget::ZERO && self.off_path && self.acked_rate_seq == self.rate_seq;
                if target != self.target || stops_homing {
                    self.target = target;
                    self.rate_seq = self.rate_seq.wrapping_add(1);
                }
                return Ok(());
            }
            HostCommand::Action(action) if action.channel != channel::HEIGHT && !channel::is_output(action.channel) => {
                return Err(CommandRefusal::NoSuchChannel);
            }
            HostCommand::ManualOutput(change) if !channel::is_output(change.channel) => {
                return Err(CommandRefusal::NoSuchChannel);
            }
            HostCommand::Repeat(repeated)
                if repeated.changes().iter().any(|change| !channel::is_output(change.channel)) =>
            {
                return Err(CommandRefusal::NoSuchChannel);
            }
            _ => {}
        }
        // A few queue slots are reserved for other commands, so that they never wait behind records.
        let room = if matches!(command, HostCommand::Ahead { .. } | HostCommand::Behind { .. } | HostCommand::Action(_))
        {
            16
        } else {
            0
        };
        if usize::from(self.count) + room >= COMMANDS {
            return Err(CommandRefusal::Full);
        }
        self.predicted.predict(&command, self.newest_place, self.may_have_moved())?;
        self.off_path |= matches!(command, HostCommand::Home(_));
        if self.count == self.sent {
            self.times.queued = self.times.now;
        }
        let number = self.base.wrapping_add(self.count);
        if matches!(command, HostCommand::ClearAlarm) {
            self.clearing = Some(AlarmClearing::Requested(number));
        }
        self.queue[usize::from(number) % COMMANDS] = command;
        self.count += 1;
        self.update_status_window();
        Ok(())
    }

    /// Whether the cursor may have moved since its last reported place.
    fn may_have_moved(&self) -> bool {
        self.target != RateTarget::ZERO
            || !self.status.at_rest
            || self.acked_rate_seq != self.rate_seq
            || self.waiting != 0
    }

    fn update_status_window(&mut self) {
        (self.status.low, self.status.high) = (self.predicted.low(), self.predicted.high());
    }
}

/// Returns the maximum number of records that the cursor passes after a stop command, at rate one.
fn stopping_records<const A: usize>(limits: &RateLimits<A>) -> u32 {
    let ramp = Braking::<32>::new(limits).map_or(0, |braking| (braking.length(Rate::ONE).units() >> 32) as u32);
    ramp + u32::from(limits.average()) / 2 + 4
}
