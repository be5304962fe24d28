//! Requests from the motion path to the jog planning thread, and the answers.
//!
//! Invariant: one request is pending at a time. The motion path neither waits nor allocates; the planning thread sleeps
//! while there is no request, and no request is left behind while it sleeps. `verification/loom` compiles this file
//! again over the model checker's channel, atomics and threads.

use crate::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use crate::sync::thread::{self, Thread};
use crate::sync::{AtomicBool, AtomicU32, AtomicU64, Ordering};

/// The answers to requests.
#[derive(Debug, Default)]
pub(crate) struct JogStatus {
    /// Number of the last request that was answered.
    done: AtomicU32,
    /// Number of the last request that was cancelled.
    given_up: AtomicU32,
    /// Whether the last request could not be planned.
    failed: AtomicBool,
    /// Identity of the program that would be read now.
    program: AtomicU64,
}

/// Creates the two ends over what they share.
pub(crate) fn jog_mailbox<R>(status: &JogStatus) -> (JogRequester<'_, R>, JogResponder<'_, R>) {
    let (sender, requests) = sync_channel(1);
    (JogRequester { requests: Some(sender), thread: None, status, number: 0 }, JogResponder { requests, status })
}

/// The motion path's end; dropped, it ends the planning thread.
#[derive(Debug)]
pub(crate) struct JogRequester<'r, R> {
    requests: Option<SyncSender<(u32, R)>>,
    thread: Option<Thread>,
    status: &'r JogStatus,
    number: u32,
}

impl<R> JogRequester<'_, R> {
    /// Wakes `thread`, the planning thread, with every request.
    pub(crate) fn set_thread(&mut self, thread: Thread) {
        self.thread = Some(thread);
    }

    /// Sends a request. The one before it must be done.
    pub(crate) fn request(&mut self, request: R) {
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

impl<R> Drop for JogRequester<'_, R> {
    fn drop(&mut self) {
        // A request in progress may wait for space that nothing makes any more.
        self.cancel();
        self.requests = None;
        self.wake();
    }
}

/// The planning thread's end.
#[derive(Debug)]
pub(crate) struct JogResponder<'r, R> {
    requests: Receiver<(u32, R)>,
    status: &'r JogStatus,
}

/// A request could not be answered, or was cancelled.
pub(crate) struct JogPlannerGone;

impl<'r, R> JogResponder<'r, R> {
    /// Answers requests until the other end is gone. `answer` also receives where to publish the rest of an answer.
    pub(crate) fn serve(self, mut answer: impl FnMut(JogReply<'r>, R) -> Result<(), JogPlannerGone>) {
        loop {
            match self.requests.try_recv() {
                Ok((number, request)) => {
                    let answered = answer(JogReply { number, status: self.status }, request);
                    self.status.failed.store(answered.is_err(), Ordering::Relaxed);
                    self.status.done.store(number, Ordering::Release);
                }
                Err(TryRecvError::Empty) => thread::park(),
                Err(TryRecvError::Disconnected) => return,
            }
        }
    }
}

/// A request in progress.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JogReply<'r> {
    number: u32,
    status: &'r JogStatus,
}

impl JogReply<'_> {
    /// Whether the request is cancelled.
    pub(crate) fn is_cancelled(self) -> bool {
        self.status.given_up.load(Ordering::Acquire) == self.number
    }

    /// Sets the identity of the program that would be read now.
    pub(crate) fn set_program(self, program: u64) {
        self.status.program.store(program, Ordering::Relaxed);
    }
}
