//! What the motion path tells everybody who looks on: one stream for screen, JSON, journal and report.
//!
//! A queue of a fixed size leads from the motion path to a thread that reports. Neither end locks or wakes the other: one tries, the
//! other looks now and then.
//!
//! Invariant: a period is of a fixed size and holds nothing that is allocated; periods, outputs and events come in the order in which
//! they happened. What is told is dropped by who hears it.

use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, TrySendError, sync_channel};
use std::thread;
use std::time::Duration;

use retrace_core::mode::Mode;
use retrace_core::{Place, Travel};
use retrace_gcode::ActiveCodes;
use retrace_link::{CardStatus, OutputChange, Outputs, channel};

use crate::event::Event;

/// Seconds of machine time that the queue has room for in wall time, at one event in two periods.
const ROOM_S: f64 = 24.0;
/// Things told that it has room for in virtual time, where the motion path waits for room.
const ROOM_VIRTUAL: usize = 4096;
/// A reporter with nothing to report looks again after so long; in virtual time, where it has to keep pace, sooner at first.
const NAP: Duration = Duration::from_millis(1);
const NAP_VIRTUAL: Duration = Duration::from_micros(300);

/// Why the machine stands in normal run, if it does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HoldReason {
    /// For no reason of the operator's: it runs, or waits for records or for an instruction.
    #[default]
    None,
    /// Feed hold.
    Hold,
    /// A program stop (M0) waits for cycle start.
    ProgramStop,
    /// Single block waits for cycle start.
    SingleBlock,
    /// The program has come to its end, and the operator has not released it: reverse run is still possible.
    Ended,
    /// The program is paused at a breakpoint, until the axes are back there (DNC-1 … DNC-7); events tell the flags.
    Paused,
}

/// What one control period did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PeriodRecord<const A: usize> {
    /// Its number, from the start of the card.
    pub period: u64,
    /// Where the cursor stands.
    pub place: Place,
    /// The furthest place ever executed, as a record boundary.
    pub reached: u32,
    /// The oldest place that can be gone back to.
    pub oldest: u32,
    /// Place behind the last record that is planned.
    pub planned: u32,
    /// The window of the card: the first record held, and the place behind the last.
    pub window: [u32; 2],
    /// Distance that the cursor moved: the rate that was run.
    pub rate: Travel,
    /// Line of the record that the cursor was in.
    pub line: u32,
    /// Net pulses of each axis in the period.
    pub increments: [i32; A],
    /// Counts of each axis.
    pub counts: [i64; A],
    /// Number of the last exclusive instruction that is complete.
    pub executed: u32,
    /// Does the cursor stand?
    pub at_rest: bool,
    /// Was the rate held down for want of records?
    pub starved: bool,
    /// Which inputs are active, one bit each.
    pub inputs: u16,
    /// The mode of operation.
    pub mode: Mode,
    /// Why it stands.
    pub hold_reason: HoldReason,
    /// The feed override that the operator asks for.
    pub override_rate: Travel,
    /// The rapid override, 0 … 1.
    pub rapid_override: Travel,
    /// Is the machine off the path: jogging, homing, on the way to a breakpoint? The places are then those of that move.
    pub off_path: bool,
}

impl<const A: usize> PeriodRecord<A> {
    /// From the card's report; what the card does not know is as at the beginning of a job.
    #[must_use]
    pub fn of(status: &CardStatus<A>) -> Self {
        Self {
            period: status.period,
            place: status.place,
            reached: status.reached,
            oldest: status.low,
            planned: status.high,
            window: [status.low, status.high],
            rate: status.rate,
            line: status.line,
            increments: status.increments,
            counts: status.counts,
            executed: status.executed,
            at_rest: status.at_rest,
            starved: status.starved,
            inputs: status.inputs,
            mode: Mode::Run,
            hold_reason: HoldReason::None,
            override_rate: retrace_core::ONE,
            rapid_override: retrace_core::ONE,
            off_path: false,
        }
    }
}

/// One thing that is told.
#[derive(Clone, Debug, PartialEq)]
pub enum Telemetry<const A: usize> {
    /// A control period has passed.
    Period(PeriodRecord<A>),
    /// An output has taken a value, by the program or by hand. At the start every output that is not 0 is told.
    Output(OutputChange),
    /// From here on this modal state is in force.
    Active(Box<ActiveCodes>),
    /// Something happened.
    Event(Event),
}

/// Who looks on, in the thread that reports: records, screen, judge, journal.
pub trait Observer<const A: usize>: Send {
    /// Hears what happened. It may take its time, within the queue's room.
    fn on_telemetry(&mut self, told: &Telemetry<A>);

    /// There is nothing to hear now: called about once a millisecond until there is.
    fn idle(&mut self) {}
}

/// The two ends of the stream of a machine with a control period of `period_s` seconds. In wall time what finds no room is counted and not
/// told; in virtual time the motion path waits for room.
#[must_use]
pub fn telemetry_channel<const A: usize>(wall_time: bool, period_s: f64) -> (TelemetrySender<A>, TelemetryReceiver<A>) {
    let room = if wall_time { (ROOM_S / period_s).ceil() as usize } else { ROOM_VIRTUAL };
    let (queue, heard) = sync_channel(room);
    let teller =
        TelemetrySender { queue, waits: !wall_time, dropped_events: 0, deaf: false, outputs: [0; channel::COUNT] };
    (teller, TelemetryReceiver { queue: heard, is_virtual: !wall_time })
}

/// The motion path's end.
#[derive(Debug)]
pub struct TelemetrySender<const A: usize> {
    queue: SyncSender<Telemetry<A>>,
    waits: bool,
    dropped_events: u64,
    deaf: bool,
    /// As they were told last.
    outputs: Outputs,
}

impl<const A: usize> TelemetrySender<A> {
    /// Tells something.
    pub fn send(&mut self, told: Telemetry<A>) {
        let mut told = told;
        for tries in 0u32.. {
            told = match self.queue.try_send(told) {
                Ok(()) => return,
                Err(TrySendError::Full(back)) if self.waits => back,
                Err(TrySendError::Full(_)) => {
                    self.dropped_events += 1;
                    return;
                }
                Err(TrySendError::Disconnected(_)) => {
                    self.deaf = true;
                    return;
                }
            };
            if tries < 5 { thread::yield_now() } else { thread::sleep(Duration::from_micros(100)) }
        }
    }

    /// Tells which outputs have changed since this was called last; all were 0 at first.
    pub fn outputs(&mut self, now: &Outputs) {
        if self.outputs == *now {
            return;
        }
        for (channel, &value) in (0u8..).zip(now) {
            if std::mem::replace(&mut self.outputs[usize::from(channel)], value) != value {
                self.send(Telemetry::Output(OutputChange { channel, value }));
            }
        }
    }

    /// How much was not told for want of room.
    #[must_use]
    pub fn dropped_events(&self) -> u64 {
        self.dropped_events
    }

    /// Has whoever was told panicked?
    #[must_use]
    pub fn deaf(&self) -> bool {
        self.deaf
    }
}

/// The reporting thread's end.
#[derive(Debug)]
pub struct TelemetryReceiver<const A: usize> {
    queue: Receiver<Telemetry<A>>,
    is_virtual: bool,
}

impl<const A: usize> TelemetryReceiver<A> {
    /// Reports everything until the motion path is gone and nothing is left.
    pub fn report(self, observer: &mut dyn Observer<A>) {
        let mut idle = 0u32;
        loop {
            match self.queue.try_recv() {
                Ok(told) => {
                    idle = 0;
                    observer.on_telemetry(&told);
                }
                Err(TryRecvError::Empty) => {
                    idle += 1;
                    observer.idle();
                    thread::sleep(if self.is_virtual && idle < 20 { NAP_VIRTUAL } else { NAP });
                }
                Err(TryRecvError::Disconnected) => return,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::EventKind;

    struct RecordingObserver(Vec<Telemetry<1>>, Duration);

    impl Observer<1> for RecordingObserver {
        fn on_telemetry(&mut self, told: &Telemetry<1>) {
            self.0.push(told.clone());
            thread::sleep(self.1);
        }
    }

    fn event(period: u64) -> Telemetry<1> {
        let happening = EventKind::Message(period.to_string());
        Telemetry::Event(Event { period, time_s: 0.0, place: Place::default(), line: 0, kind: happening })
    }

    #[test]
    fn in_virtual_time_all_is_told_in_order_however_slow_the_reporter_is() {
        let (mut teller, hearing) = telemetry_channel::<1>(false, 1e-3);
        let mut heard = RecordingObserver(Vec::new(), Duration::from_micros(1));
        thread::scope(|scope| {
            scope.spawn(|| hearing.report(&mut heard));
            (0..3 * ROOM_VIRTUAL as u64).for_each(|n| teller.send(event(n)));
            drop(teller);
        });
        assert_eq!(heard.0, (0..3 * ROOM_VIRTUAL as u64).map(event).collect::<Vec<_>>());
    }

    #[test]
    fn in_wall_time_what_finds_no_room_is_counted_and_the_rest_is_told() {
        let (mut teller, hearing) = telemetry_channel::<1>(true, 0.02);
        let room = (ROOM_S / 0.02) as u64;
        (0..room + 7).for_each(|n| teller.send(event(n)));
        assert_eq!(teller.dropped_events(), 7);
        drop(teller);
        let mut heard = RecordingObserver(Vec::new(), Duration::ZERO);
        hearing.report(&mut heard);
        assert_eq!(heard.0, (0..room).map(event).collect::<Vec<_>>());
    }

    #[test]
    fn an_output_is_told_when_it_changes() {
        let (mut teller, hearing) = telemetry_channel::<1>(false, 1e-3);
        let mut outputs = [0; channel::COUNT];
        teller.outputs(&outputs);
        (outputs[3], outputs[68]) = (1, 7);
        teller.outputs(&outputs);
        teller.outputs(&outputs);
        outputs[3] = 0;
        teller.outputs(&outputs);
        drop(teller);
        let mut heard = RecordingObserver(Vec::new(), Duration::ZERO);
        hearing.report(&mut heard);
        let told = [(3, 1), (68, 7), (3, 0)].map(|(channel, value)| Telemetry::Output(OutputChange { channel, value }));
        assert_eq!(heard.0, told);
    }

    #[test]
    fn a_period_is_small() {
        assert!(
            size_of::<Telemetry<4>>() <= 192 && size_of::<Telemetry<9>>() <= 256,
            "{} {}",
            size_of::<Telemetry<4>>(),
            size_of::<Telemetry<9>>()
        );
    }
}
