//! The jog planner: manual moves are planned in their own thread, into a small ring of their own, when the motion path
//! requests one.
//!
//! Invariant: one move is planned at a time, from the machine's position. The motion path neither waits for the planner
//! nor wakes it while anything moves, and allocates nothing.

use std::thread::{self, Thread};
use std::time::Duration;

use retrace_config::MachineConfig;
use retrace_core::ring::{Cell, Consumer, Producer, Ring, RingError};
use retrace_core::size::ring_cells;
use retrace_core::{Flags, Record, RecordIndex};
use retrace_motion::{FeedRate, PathMode, Planner};

use crate::approach::approach;
pub(crate) use crate::jog_mailbox::JogStatus;
use crate::jog_mailbox::{JogPlannerGone, JogReply, JogRequester, JogResponder, jog_mailbox};
use crate::jog_speed::JogSpeed;
use crate::probe_move::ProbeMove;
use crate::tap_move::{MAX_TAP_RECORDS, TapMove};

/// Offset in records between the places of manual moves and those of the job that they interrupt.
pub const MANUAL_PLACE_OFFSET: u32 = 1 << 30;

/// Number of records of a move that are retained behind the cursor: manual moves are not reversed, but for taps.
const HISTORY_RECORDS: u32 = 64;

/// A request to the planning thread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum JogRequest<const A: usize> {
    /// A straight move between two positions, in counts, at the jog speed or a part of it.
    Straight { from: [i64; A], to: [i64; A], speed: JogSpeed },
    /// The moves of an approach: tool axis up, the others, tool axis down (DNC-6).
    Approach { from: [i64; A], to: [i64; A] },
    /// A probing move, at its feed.
    Probe(ProbeMove),
    /// A rigid tap: the way in, and what the spindle may turn further.
    Tap(TapMove),
    /// Determine which program would be read now.
    Identify,
}

/// Identifies the program that would be read now: the same number for the same content only.
pub type Identify = Box<dyn FnMut() -> u64 + Send>;

/// Creates a ring for manual moves, whose first place is `start`.
///
/// # Errors
/// The machine's look-ahead is larger than any ring.
pub(crate) fn ring<const A: usize>(
    machine: &MachineConfig,
    start: RecordIndex,
) -> Result<Ring<Box<[Cell<Record<A>>]>>, RingError> {
    let history = if machine.encoder.is_some() { MAX_TAP_RECORDS } else { HISTORY_RECORDS };
    let cells = ring_cells(history, machine.look_ahead_records).ok_or(RingError::TooSmall)?;
    let cells: Box<[Cell<Record<A>>]> = (0..cells).map(|_| Cell::default()).collect();
    Ring::new(cells, history, machine.look_ahead_records, start)
}

/// Creates the two ends of the jog planner over the two ends of a ring.
pub(crate) fn jog_channel<'r, const A: usize>(
    ends: (Producer<'r, Record<A>>, Consumer<'r, Record<A>>),
    mail: &'r JogStatus,
) -> (JogPlanner<'r, A>, JogWorker<'r, A>) {
    let (requester, responder) = jog_mailbox(mail);
    (JogPlanner { ring: ends.1, requests: requester }, JogWorker { ring: ends.0, requests: responder })
}

/// The motion path's end.
#[derive(Debug)]
pub struct JogPlanner<'r, const A: usize> {
    pub(crate) ring: Consumer<'r, Record<A>>,
    requests: JogRequester<'r, JogRequest<A>>,
}

impl<const A: usize> JogPlanner<'_, A> {
    /// Wakes `thread`, the planning thread, with every request.
    pub(crate) fn with_thread(mut self, thread: Thread) -> Self {
        self.requests.set_thread(thread);
        self
    }

    /// Sends a request. The one before it must be done.
    pub(crate) fn request(&mut self, request: JogRequest<A>) {
        self.requests.request(request);
    }

    /// Whether the request is done, so that nothing more follows.
    pub(crate) fn is_done(&self) -> bool {
        self.requests.is_done()
    }

    /// Whether the request could not be planned.
    pub(crate) fn has_failed(&self) -> bool {
        self.requests.has_failed()
    }

    /// Identity of the program that would be read now, once it is known.
    pub(crate) fn program(&self) -> u64 {
        self.requests.program()
    }

    /// Cancels the request.
    pub(crate) fn cancel(&self) {
        self.requests.cancel();
    }
}

/// The planning thread's end.
#[derive(Debug)]
pub(crate) struct JogWorker<'r, const A: usize> {
    ring: Producer<'r, Record<A>>,
    requests: JogResponder<'r, JogRequest<A>>,
}

impl<const A: usize> JogWorker<'_, A> {
    /// Serves requests until the other end is gone.
    pub(crate) fn serve(self, machine: &MachineConfig, mut identify: Identify) {
        let Self { mut ring, requests } = self;
        requests.serve(|reply, request| match request {
            JogRequest::Straight { from, to, speed } => plan(&mut ring, (machine, speed), reply, from, &[to]),
            JogRequest::Approach { from, to } => {
                let ends = approach(machine, from, to).map_err(|_| JogPlannerGone)?;
                plan(&mut ring, (machine, JogSpeed::Full), reply, from, &ends)
            }
            JogRequest::Probe(question) => {
                let mut planner = question.plan::<A>(machine).map_err(|_| JogPlannerGone)?;
                while let Some(record) = planner.next_record() {
                    let flags = record.flags.with(Flags::PROBING);
                    push(&mut ring, reply, Record { flags, ..record })?;
                }
                Ok(())
            }
            JogRequest::Tap(tap) => {
                let encoder = machine.encoder.ok_or(JogPlannerGone)?;
                let plan = tap.plan::<A>(machine, &encoder).map_err(|_| JogPlannerGone)?;
                plan.records.into_iter().try_for_each(|record| push(&mut ring, reply, record))
            }
            JogRequest::Identify => {
                reply.set_program(identify());
                Ok(())
            }
        });
    }
}

/// Plans straight moves, with rest between them.
fn plan<const A: usize>(
    ring: &mut Producer<'_, Record<A>>,
    (machine, jog_speed): (&MachineConfig, JogSpeed),
    reply: JogReply<'_>,
    from: [i64; A],
    ends: &[[i64; A]],
) -> Result<(), JogPlannerGone> {
    let mut planner = Planner::new(machine.limits(), in_mm(machine, from)).map_err(|_| JogPlannerGone)?;
    let mut at = from;
    for &end in ends {
        let feed = FeedRate::PerSecond(jog_speed.share() * speed(machine, at, end));
        planner.line(in_mm(machine, end), feed, PathMode::ExactStop, 0).map_err(|_| JogPlannerGone)?;
        planner.stop(Flags::NONE);
        while let Some(record) = planner.next_record() {
            push(ring, reply, record)?;
        }
        at = end;
    }
    Ok(())
}

fn push<const A: usize>(
    ring: &mut Producer<'_, Record<A>>,
    reply: JogReply<'_>,
    record: Record<A>,
) -> Result<(), JogPlannerGone> {
    while ring.push(record).is_err() {
        if reply.is_cancelled() {
            return Err(JogPlannerGone);
        }
        thread::sleep(Duration::from_micros(200));
    }
    Ok(())
}

fn in_mm<const A: usize>(machine: &MachineConfig, counts: [i64; A]) -> [f64; A] {
    machine.clone().standing_at(&counts).start_mm()
}

/// Jog speed of a move: that of the slowest axis that moves, mm/s.
fn speed<const A: usize>(machine: &MachineConfig, from: [i64; A], to: [i64; A]) -> f64 {
    let moving = machine.axes.iter().zip(from.iter().zip(&to)).filter(|(_, (from, to))| from != to);
    moving.map(|(axis, _)| axis.jog_mm_s()).fold(machine.path_velocity_mm_s, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Uses a jog planner of this machine, whose planning thread ends with it.
    fn with_planner<T>(machine: &MachineConfig, uses: impl FnOnce(JogPlanner<'_, 3>) -> T) -> T {
        let mut ring = ring::<3>(machine, RecordIndex::new(0)).expect("fits");
        let status = JogStatus::default();
        let (planner, worker) = jog_channel(ring.split(), &status);
        thread::scope(|scope| {
            let serving = scope.spawn(|| worker.serve(machine, Box::new(|| 0)));
            let used = uses(planner.with_thread(serving.thread().clone()));
            serving.join().expect("it ends");
            used
        })
    }

    #[test]
    fn a_move_longer_than_the_ring_ends_with_the_motion_path() {
        let machine = MachineConfig::parse("", "test").expect("valid");
        // a card that fails ends the motion path without a word
        with_planner(&machine, |mut planner| {
            let to = [machine.counts_of(0, 200.0), 0, 0];
            planner.request(JogRequest::Straight { from: [0; 3], to, speed: JogSpeed::Full });
            while planner.ring.write().number() < machine.look_ahead_records {
                thread::yield_now();
            }
        });
    }

    /// Most pulses of X in a period of a jog of 2 mm, and all of them.
    fn most_and_sum(machine: &MachineConfig, speed: JogSpeed) -> (i16, i64) {
        with_planner(machine, |mut planner| {
            let to = [machine.counts_of(0, 2.0), 0, 0];
            planner.request(JogRequest::Straight { from: [0; 3], to, speed });
            let (mut most, mut sum) = (0, 0);
            while !planner.is_done() || planner.ring.read() != planner.ring.write() {
                if let Some(record) = planner.ring.advance() {
                    most = most.max(record.increments[0]);
                    sum += i64::from(record.increments[0]);
                }
            }
            (most, sum)
        })
    }

    #[test]
    fn a_slow_jog_has_a_tenth_of_the_speed_of_the_axis() {
        let machine = MachineConfig::parse("", "test").expect("valid");
        let pulses_per_period = machine.axes[0].jog_mm_s() * machine.axes[0].pulses_per_mm * machine.period_s();
        let (most, sum) = most_and_sum(&machine, JogSpeed::Slow);
        let expected = pulses_per_period / 10.0;
        assert!((f64::from(most) - expected).abs() <= 1.0, "{most}, not {expected}");
        let (most_at_full, sum_at_full) = most_and_sum(&machine, JogSpeed::Full);
        assert!(f64::from(most_at_full) > 2.0 * expected, "{most_at_full}");
        assert_eq!([sum, sum_at_full], [machine.counts_of(0, 2.0); 2]);
    }
}
