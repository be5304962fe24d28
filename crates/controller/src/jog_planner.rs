//! The jog planner: manual moves are planned in their own thread, into a small ring of their own, when the motion path
//! requests one.
//!
//! Invariant: one move is planned at a time, from the machine's position. The motion path neither waits for the planner
//! nor wakes it while anything moves, and allocates nothing.

use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread::{self, Thread};
use std::time::Duration;

use retrace_config::MachineConfig;
use retrace_core::ring::{Cell, Consumer, Producer, Ring, RingError};
use retrace_core::size::ring_cells;
use retrace_core::{Flags, Record, RecordIndex};
use retrace_motion::{FeedRate, PathMode, Planner};

use crate::approach::approach;

/// Offset in records between the places of manual moves and those of the job that they interrupt.
pub const MANUAL_PLACE_OFFSET: u32 = 1 << 30;

/// Number of records of a move that are retained behind the cursor: manual moves are not reversed.
const HISTORY_RECORDS: u32 = 64;

/// A request to the planning thread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum JogRequest<const A: usize> {
    /// A straight move between two positions, in counts, at the jog speed.
    Straight { from: [i64; A], to: [i64; A] },
    /// The moves of an approach: tool axis up, the others, tool axis down (DNC-6).
    Approach { from: [i64; A], to: [i64; A] },
    /// Determine which program would be read now.
    Identify,
}

/// What the two ends share in addition to the records.
#[derive(Debug, Default)]
pub(crate) struct JogStatus {
    /// Number of the last request that was answered.
    done: AtomicU32,
    /// Number of the last request that was cancelled.
    given_up: AtomicU32,
    /// Whether the last request could not be planned.
    failed: AtomicBool,
    /// The answer to [`JogRequest::Identify`].
    program: AtomicU64,
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
    let cells = ring_cells(HISTORY_RECORDS, machine.look_ahead_records).ok_or(RingError::TooSmall)?;
    let cells: Box<[Cell<Record<A>>]> = (0..cells).map(|_| Cell::default()).collect();
    Ring::new(cells, HISTORY_RECORDS, machine.look_ahead_records, start)
}

/// Creates the two ends of the jog planner over the two ends of a ring.
pub(crate) fn jog_channel<'r, const A: usize>(
    ends: (Producer<'r, Record<A>>, Consumer<'r, Record<A>>),
    mail: &'r JogStatus,
) -> (JogPlanner<'r, A>, JogWorker<'r, A>) {
    let (sender, requests) = sync_channel(1);
    let jog_planner = JogPlanner { ring: ends.1, requests: Some(sender), thread: None, status: mail, number: 0 };
    (jog_planner, JogWorker { ring: ends.0, requests, status: mail })
}

/// The motion path's end.
#[derive(Debug)]
pub struct JogPlanner<'r, const A: usize> {
    pub(crate) ring: Consumer<'r, Record<A>>,
    requests: Option<SyncSender<(u32, JogRequest<A>)>>,
    thread: Option<Thread>,
    status: &'r JogStatus,
    number: u32,
}

impl<const A: usize> JogPlanner<'_, A> {
    /// Wakes `thread`, the planning thread, with every request.
    pub(crate) fn with_thread(mut self, thread: Thread) -> Self {
        self.thread = Some(thread);
        self
    }

    /// Sends a request. The one before it must be done.
    pub(crate) fn request(&mut self, request: JogRequest<A>) {
        self.number = self.number.wrapping_add(1);
        if let Some(requests) = &self.requests {
            // There is space: one request is pending at a time.
            let _ = requests.try_send((self.number, request));
        }
        self.wake();
    }

    fn wake(&self) {
        if let Some(thread) = &self.thread {
            thread.unpark();
        }
    }

    /// Whether the request is done, so that nothing more follows.
    pub(crate) fn is_done(&self) -> bool {
        self.status.done.load(Ordering::Acquire) == self.number
    }

    /// Whether the request could not be planned.
    pub(crate) fn has_failed(&self) -> bool {
        self.status.failed.load(Ordering::Relaxed)
    }

    /// Identity of the program that would be read now, once it is known.
    pub(crate) fn program(&self) -> u64 {
        self.status.program.load(Ordering::Relaxed)
    }

    /// Cancels the request.
    pub(crate) fn cancel(&self) {
        self.status.given_up.store(self.number, Ordering::Release);
    }
}

impl<const A: usize> Drop for JogPlanner<'_, A> {
    fn drop(&mut self) {
        self.requests = None;
        self.wake();
    }
}

/// The planning thread's end.
#[derive(Debug)]
pub(crate) struct JogWorker<'r, const A: usize> {
    ring: Producer<'r, Record<A>>,
    requests: Receiver<(u32, JogRequest<A>)>,
    status: &'r JogStatus,
}

/// A move could not be planned, or was cancelled.
struct JogPlannerGone;

impl<const A: usize> JogWorker<'_, A> {
    /// Serves requests until the other end is gone.
    pub(crate) fn serve(mut self, machine: &MachineConfig, mut identify: Identify) {
        loop {
            match self.requests.try_recv() {
                Ok((number, request)) => {
                    let planned = match request {
                        JogRequest::Straight { from, to } => self.plan(machine, number, from, &[to]),
                        JogRequest::Approach { from, to } => match approach(machine, from, to) {
                            Ok(ends) => self.plan(machine, number, from, &ends),
                            Err(_) => Err(JogPlannerGone),
                        },
                        JogRequest::Identify => {
                            self.status.program.store(identify(), Ordering::Relaxed);
                            Ok(())
                        }
                    };
                    self.status.failed.store(planned.is_err(), Ordering::Relaxed);
                    self.status.done.store(number, Ordering::Release);
                }
                Err(TryRecvError::Empty) => thread::park(),
                Err(TryRecvError::Disconnected) => return,
            }
        }
    }

    /// Plans straight moves, with rest between them.
    fn plan(
        &mut self,
        machine: &MachineConfig,
        number: u32,
        from: [i64; A],
        ends: &[[i64; A]],
    ) -> Result<(), JogPlannerGone> {
        let mut planner = Planner::new(machine.limits(), in_mm(machine, from)).map_err(|_| JogPlannerGone)?;
        let mut at = from;
        for &end in ends {
            let feed = FeedRate::PerSecond(speed(machine, at, end));
            planner.line(in_mm(machine, end), feed, PathMode::ExactStop, 0).map_err(|_| JogPlannerGone)?;
            planner.stop(Flags::NONE);
            while let Some(record) = planner.next_record() {
                self.push(number, record)?;
            }
            at = end;
        }
        Ok(())
    }

    fn push(&mut self, number: u32, record: Record<A>) -> Result<(), JogPlannerGone> {
        while self.ring.push(record).is_err() {
            if self.status.given_up.load(Ordering::Acquire) == number {
                return Err(JogPlannerGone);
            }
            thread::sleep(Duration::from_micros(200));
        }
        Ok(())
    }
}

fn in_mm<const A: usize>(machine: &MachineConfig, counts: [i64; A]) -> [f64; A] {
    machine.clone().standing_at(&counts).start_mm()
}

/// Jog speed of a move: that of the slowest axis that moves, mm/s.
fn speed<const A: usize>(machine: &MachineConfig, from: [i64; A], to: [i64; A]) -> f64 {
    let moving = machine.axes.iter().zip(from.iter().zip(&to)).filter(|(_, (from, to))| from != to);
    moving.map(|(axis, _)| axis.jog_mm_s()).fold(machine.path_velocity_mm_s, f64::min)
}
