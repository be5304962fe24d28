//! The motion path that requests manual moves, and the thread that plans them and sleeps in between.
//!
//! Runs `crates/controller/src/jog_mailbox.rs`: requesting, waking, answering, cancelling and ending. A request is a
//! number, its answer the program's identity.
//!
//! Invariant: the planning thread ends with the motion path, whatever it is doing.

use crate::jog_mailbox::{JogPlannerGone, JogReply, JogRequester, JogStatus, jog_mailbox};
use crate::sync::{Arc, AtomicU32, Ordering, thread};

/// What the motion path does after its requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JogEnd {
    /// It ends when the last one is done.
    Done,
    /// It cancels one that waits for space, and requests another.
    Cancelled,
    /// It ends while one waits for space.
    Dropped,
}

/// Shape of a model.
#[derive(Clone, Copy, Debug)]
pub struct Jog {
    /// Number of requests that are answered.
    pub requests: u32,
    /// What follows.
    pub end: JogEnd,
}

/// A request that waits for space until it is cancelled.
const ENDLESS: u32 = u32::MAX;

fn answer(reply: JogReply<'_>, request: u32) -> Result<(), JogPlannerGone> {
    if request == ENDLESS {
        while !reply.is_cancelled() {
            thread::yield_now();
        }
        return Err(JogPlannerGone);
    }
    reply.set_program(u64::from(request));
    Ok(())
}

fn wait(requester: &JogRequester<'_, u32>) {
    while !requester.is_done() {
        thread::yield_now();
    }
}

fn request(requester: &mut JogRequester<'_, u32>, number: u32) {
    requester.request(number);
    wait(requester);
    assert!(!requester.has_failed(), "the failure is that of another request");
    assert_eq!(requester.program(), u64::from(number), "the answer is that of another request");
}

impl Jog {
    /// Runs both threads. Returns the number of requests that were answered.
    ///
    /// # Panics
    /// Where an answer is not that of its request.
    #[must_use]
    pub fn run(self) -> u32 {
        // The ends borrow the status and a thread borrows for ever, so each execution leaks a few bytes.
        let status: &'static JogStatus = Box::leak(Box::default());
        let (mut requester, responder) = jog_mailbox(status);
        let answered = Arc::new(AtomicU32::new(0));
        let worker = thread::spawn({
            let answered = Arc::clone(&answered);
            move || {
                responder.serve(|reply, number| {
                    answered.fetch_add(1, Ordering::Relaxed);
                    answer(reply, number)
                });
            }
        });
        requester.set_thread(worker.thread().clone());
        (1..=self.requests).for_each(|number| request(&mut requester, number));
        match self.end {
            JogEnd::Done => {}
            JogEnd::Cancelled => {
                requester.request(ENDLESS);
                requester.cancel();
                wait(&requester);
                assert!(requester.has_failed(), "a cancelled request fails");
                request(&mut requester, self.requests + 1);
            }
            JogEnd::Dropped => requester.request(ENDLESS),
        }
        drop(requester);
        worker.join().expect("the planning thread does not panic");
        answered.load(Ordering::Relaxed)
    }
}
