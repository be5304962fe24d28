//! Telemetry: one stream of periods, outputs and events from the motion path to screen, JSON, journal and report.
//!
//! A queue of a fixed size leads from the motion path to the reporting thread. Neither end locks or wakes the other:
//! the sender tries, the receiver polls.
//!
//! Invariant: a period record has a fixed size and owns no allocation; periods, outputs and events arrive in the order
//! in which they happened. Messages are dropped by the receiver.

use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, TrySendError, sync_channel};
use std::thread;
use std::time::Duration;

use retrace_core::mode::Mode;
use retrace_core::{Place, Rate, RecordIndex};
use retrace_gcode::ActiveCodes;
use retrace_journal::HoldReason;
use retrace_link::{AnalogInputs, CardStatus, HeightState, OutputChange, Outputs, SpindleStatus, channel};

use crate::event::Event;

/// Machine time in seconds that the queue can hold in wall time, at one event in two periods.
const CAPACITY_S: f64 = 24.0;
/// Capacity of the queue in virtual time, in messages: what passes while the receiver sleeps. The motion path waits
/// when the queue is full.
const CAPACITY_VIRTUAL: usize = 8192;
/// Interval at which an idle receiver polls the queue. In virtual time, where the receiver has to keep pace, the first
/// polls are more frequent.
const POLL_INTERVAL: Duration = Duration::from_millis(1);
const POLL_INTERVAL_VIRTUAL: Duration = Duration::from_micros(300);

/// State and motion of one control period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PeriodRecord<const A: usize> {
    /// Number of the period, from the start of the card.
    pub period: u64,
    /// Cursor at the end of the period.
    pub place: Place,
    /// The furthest place ever executed, as a record boundary.
    pub reached: RecordIndex,
    /// Oldest place that reverse run can reach.
    pub oldest: RecordIndex,
    /// Place behind the last planned record.
    pub planned: RecordIndex,
    /// The card's window: the first record it holds, and the place behind the last.
    pub window: [RecordIndex; 2],
    /// Distance that the cursor moved: the actual rate.
    pub rate: Rate,
    /// Program line of the record under the cursor.
    pub line: u32,
    /// Net pulses of each axis in the period.
    pub increments: [i32; A],
    /// Position of each axis on the path in counts, without the layer.
    pub counts: [i64; A],
    /// Layer of the tool axis, added to its counts.
    pub layer: i32,
    /// Number of the last exclusive instruction that is complete.
    pub executed: u32,
    /// Whether the cursor is at rest.
    pub at_rest: bool,
    /// Whether the rate was limited because records were missing.
    pub starved: bool,
    /// Active inputs, one bit each.
    pub inputs: u16,
    /// Mode of operation.
    pub mode: Mode,
    /// Reason why the machine is at rest.
    pub hold_reason: HoldReason,
    /// Feed override that the operator requests.
    pub override_rate: Rate,
    /// Rapid override, 0 … 1.
    pub rapid_override: Rate,
    /// Speed override of the spindle, 0.1 … 2.
    pub speed_override: Rate,
    /// Whether the program has switched both off here (M49).
    pub override_is_off: bool,
    /// Whether the machine is off the path: jogging, homing, or returning to a breakpoint. The places are then those of
    /// that move.
    pub off_path: bool,
    /// Number of the contour that is being cut; 0 between two.
    pub contour: u32,
    /// Length of it that is cut, µm.
    pub cut_um: u32,
    /// Where the stretch begins that was cut up to `place` without a break; `None` where the cutter did not burn along
    /// the path in this period.
    pub cut_from: Option<Place>,
    /// The spindle as the card measures it.
    pub spindle: SpindleStatus,
    /// State of height control.
    pub height: HeightState,
    /// Readings of the analog inputs.
    pub analog_inputs: AnalogInputs,
    /// Whether the motion has the acceleration and jerk of a probing move: it is one, or one that is retraced.
    pub is_probing: bool,
}

impl<const A: usize> PeriodRecord<A> {
    /// Creates a record from the card's status. What the card does not report has its value at the beginning of a job.
    #[must_use]
    pub fn from_status(status: &CardStatus<A>) -> Self {
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
            layer: status.layer,
            executed: status.executed,
            at_rest: status.at_rest,
            starved: status.starved,
            inputs: status.inputs,
            mode: Mode::Run,
            hold_reason: HoldReason::None,
            override_rate: Rate::ONE,
            rapid_override: Rate::ONE,
            speed_override: Rate::ONE,
            override_is_off: false,
            off_path: false,
            contour: 0,
            cut_um: 0,
            cut_from: None,
            spindle: status.spindle,
            height: status.height_state(),
            analog_inputs: status.analog_inputs,
            is_probing: false,
        }
    }
}

/// A message of the telemetry stream.
#[derive(Clone, Debug, PartialEq)]
pub enum Telemetry<const A: usize> {
    /// A control period has passed.
    Period(PeriodRecord<A>),
    /// An output changed, by the program or manually. At the start, every output that is not 0 is sent.
    Output(OutputChange),
    /// This modal state is in force from here on.
    Active(Box<ActiveCodes>),
    /// An event.
    Event(Event),
}

/// A consumer of telemetry in the reporting thread: recorder, screen, limit monitor, journal.
pub trait Observer<const A: usize>: Send {
    /// Receives a message. May take as long as the queue's capacity allows.
    fn on_telemetry(&mut self, message: &Telemetry<A>);

    /// Called about once a millisecond while there are no messages.
    fn idle(&mut self) {}
}

/// Creates a connected sender and receiver for a machine with a control period of `period_s` seconds. When the queue is
/// full, messages are dropped and counted in wall time; in virtual time the motion path waits.
#[must_use]
pub fn telemetry_channel<const A: usize>(wall_time: bool, period_s: f64) -> (TelemetrySender<A>, TelemetryReceiver<A>) {
    let room = if wall_time { (CAPACITY_S / period_s).ceil() as usize } else { CAPACITY_VIRTUAL };
    let (queue, observer) = sync_channel(room);
    let telemetry = TelemetrySender {
        queue,
        blocks_when_full: !wall_time,
        dropped_events: 0,
        receiver_gone: false,
        outputs: [0; channel::COUNT],
    };
    (telemetry, TelemetryReceiver { queue: observer, is_virtual: !wall_time })
}

/// The motion path's end of the stream.
#[derive(Debug)]
pub struct TelemetrySender<const A: usize> {
    queue: SyncSender<Telemetry<A>>,
    blocks_when_full: bool,
    dropped_events: u64,
    receiver_gone: bool,
    /// Outputs as they were sent last.
    outputs: Outputs,
}

impl<const A: usize> TelemetrySender<A> {
    /// Sends a message.
    pub fn send(&mut self, message: Telemetry<A>) {
        let mut message = message;
        for tries in 0u32.. {
            message = match self.queue.try_send(message) {
                Ok(()) => return,
                Err(TrySendError::Full(back)) if self.blocks_when_full => back,
                Err(TrySendError::Full(_)) => {
                    self.dropped_events += 1;
                    return;
                }
                Err(TrySendError::Disconnected(_)) => {
                    self.receiver_gone = true;
                    return;
                }
            };
            if tries < 5 { thread::yield_now() } else { thread::sleep(Duration::from_micros(100)) }
        }
    }

    /// Sends the outputs that have changed since the last call. All were 0 before the first call.
    pub fn send_output_changes(&mut self, now: &Outputs) {
        if self.outputs == *now {
            return;
        }
        for (channel, &value) in (0u8..).zip(now) {
            if std::mem::replace(&mut self.outputs[usize::from(channel)], value) != value {
                self.send(Telemetry::Output(OutputChange { channel, value }));
            }
        }
    }

    /// Number of messages that were dropped because the queue was full.
    #[must_use]
    pub fn dropped_events(&self) -> u64 {
        self.dropped_events
    }

    /// Whether the reporting thread has ended, that is, panicked.
    #[must_use]
    pub fn receiver_is_gone(&self) -> bool {
        self.receiver_gone
    }
}

/// The reporting thread's end of the stream.
#[derive(Debug)]
pub struct TelemetryReceiver<const A: usize> {
    queue: Receiver<Telemetry<A>>,
    is_virtual: bool,
}

impl<const A: usize> TelemetryReceiver<A> {
    /// Passes all messages to `observer` until the motion path has ended and the queue is empty.
    pub fn run(self, observer: &mut dyn Observer<A>) {
        let mut idle = 0u32;
        loop {
            match self.queue.try_recv() {
                Ok(message) => {
                    idle = 0;
                    observer.on_telemetry(&message);
                }
                Err(TryRecvError::Empty) => {
                    idle += 1;
                    observer.idle();
                    thread::sleep(if self.is_virtual && idle < 20 { POLL_INTERVAL_VIRTUAL } else { POLL_INTERVAL });
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
        fn on_telemetry(&mut self, message: &Telemetry<1>) {
            self.0.push(message.clone());
            thread::sleep(self.1);
        }
    }

    fn event(period: u64) -> Telemetry<1> {
        let kind = EventKind::Message(period.to_string());
        Telemetry::Event(Event { period, time_s: 0.0, place: Place::default(), line: 0, kind })
    }

    #[test]
    fn in_virtual_time_all_is_told_in_order_however_slow_the_reporter_is() {
        let (mut telemetry, receiver) = telemetry_channel::<1>(false, 1e-3);
        let mut observer = RecordingObserver(Vec::new(), Duration::from_micros(1));
        thread::scope(|scope| {
            scope.spawn(|| receiver.run(&mut observer));
            (0..3 * CAPACITY_VIRTUAL as u64).for_each(|n| telemetry.send(event(n)));
            drop(telemetry);
        });
        assert_eq!(observer.0, (0..3 * CAPACITY_VIRTUAL as u64).map(event).collect::<Vec<_>>());
    }

    #[test]
    fn in_wall_time_what_finds_no_room_is_counted_and_the_rest_is_told() {
        let (mut telemetry, receiver) = telemetry_channel::<1>(true, 0.02);
        let room = (CAPACITY_S / 0.02) as u64;
        (0..room + 7).for_each(|n| telemetry.send(event(n)));
        assert_eq!(telemetry.dropped_events(), 7);
        drop(telemetry);
        let mut observer = RecordingObserver(Vec::new(), Duration::ZERO);
        receiver.run(&mut observer);
        assert_eq!(observer.0, (0..room).map(event).collect::<Vec<_>>());
    }

    #[test]
    fn an_output_is_told_when_it_changes() {
        let (mut telemetry, receiver) = telemetry_channel::<1>(false, 1e-3);
        let mut outputs = [0; channel::COUNT];
        telemetry.send_output_changes(&outputs);
        (outputs[3], outputs[68]) = (1, 7);
        telemetry.send_output_changes(&outputs);
        telemetry.send_output_changes(&outputs);
        outputs[3] = 0;
        telemetry.send_output_changes(&outputs);
        drop(telemetry);
        let mut observer = RecordingObserver(Vec::new(), Duration::ZERO);
        receiver.run(&mut observer);
        let sent = [(3, 1), (68, 7), (3, 0)].map(|(channel, value)| Telemetry::Output(OutputChange { channel, value }));
        assert_eq!(observer.0, sent);
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
