//! The rows of the hand-overs between the threads of a job: real files of the journal and the controller under loom.
//!
//! Invariant: the models are in `verification/loom/src/models`; here are their names and mutants. Every mutant is in a
//! file that ships.

use crate::ledger::{Mutant, Row};
use crate::native::Harness;
use crate::threads::loom;

/// No harness: concurrent code is explored by loom, not unrolled.
pub const HARNESSES: &[Harness] = &[];

const QUEUE: &str = "crates/journal/src/journal_queue.rs";
const DURABLE: &str = "crates/journal/src/durable_place.rs";
const BATCHES: &str = "crates/controller/src/batch_channel.rs";
const MAILBOX: &str = "crates/controller/src/jog_mailbox.rs";
const COMMANDS: &str = "crates/controller/src/command_channel.rs";

const SAVED: &str = "what_is_pushed_is_saved_before_waiting_ends";
const SPACE: &str = "pushing_waits_for_space_and_is_woken";
const FAILS_ONCE: &str = "a_disk_that_fails_once_is_written_again";
const NEVER_WORKS: &str = "a_disk_that_never_works_ends_the_writer";
const PLANNED: &str = "every_block_is_planned_and_the_end_is_seen_behind_the_last";
const CANCELLED: &str = "a_decoder_that_nobody_listens_to_ends";
const ANSWERED: &str = "every_request_wakes_the_planning_thread_and_is_answered";
const NEXT: &str = "a_request_is_cancelled_and_the_next_one_is_answered";
const DROPPED: &str = "the_planning_thread_ends_with_the_motion_path";
const RECEIVED: &str = "a_command_is_received_once_or_refused_and_no_count_is_lost";

const ASSUMES: &str = "the primitives as the standard library specifies them; its bounded channel is modelled by a \
    queue under a mutex; time may pass at any moment, so a pause lets the others run and a limit may pass at once";

const fn mutant(
    name: &'static str,
    file: &'static str,
    [find, put]: [&'static str; 2],
    killer: &'static str,
) -> Mutant {
    Mutant { name, file, find, put, killer }
}

/// The rows.
pub const ROWS: &[Row] = &[
    Row {
        name: "journal-threads",
        says: "Every entry that is pushed is saved once and in order, or counted where it may be lost; nothing counts \
            as saved or durable before it is; no thread sleeps for ever, also where the disk fails",
        requirement: "Beyond the source, *Interrupted jobs*",
        bound: "journal_queue.rs and durable_place.rs with one planning, one reporting and the writer thread; 1 or 2 \
            marks, 1 event, space for one; a disk that works, fails once, or never works; preemption bound 3 (full: 4)",
        assumes: ASSUMES,
        suffices: "all waiting is on one condition variable, with one mutex; every wait and every notice is passed \
            with the queue empty and full",
        harnesses: &[],
        searches: &[],
        models: &[loom(SAVED), loom(SPACE), loom(FAILS_ONCE), loom(NEVER_WORKS)],
        mutants: &[
            mutant(
                "the writer is not woken by the first entry",
                QUEUE,
                [
                    "let wakes = state.queue.len() == 1 || state.queue.len() == self.0.capacity;",
                    "let wakes = state.queue.len() > 1;",
                ],
                SAVED,
            ),
            mutant(
                "the writer is woken before the entry is there",
                QUEUE,
                [
                    "        state.queue.push_back(entry);\n        let wakes = state.queue.len() == 1 || \
                        state.queue.len() == self.0.capacity;\n        drop(state);\n        if wakes {\n            \
                        self.0.changed.notify_all();\n        }",
                    "        drop(state);\n        self.0.changed.notify_all();\n        \
                        self.state().queue.push_back(entry);",
                ],
                SAVED,
            ),
            mutant(
                "the writer looks once instead of until",
                QUEUE,
                [
                    "let mut state = self.0.changed.wait_while(self.state(), waits)\
                        .unwrap_or_else(PoisonError::into_inner);",
                    "let (mut state, mut waits) = (self.state(), waits);\n        if waits(&mut state) {\n            \
                        state = self.0.changed.wait(state).unwrap_or_else(PoisonError::into_inner);\n        }",
                ],
                SAVED,
            ),
            mutant(
                "nobody is woken when a batch is saved",
                QUEUE,
                [
                    "        self.0.changed.notify_all();\n    }\n\n    /// Records that the batch could not",
                    "    }\n\n    /// Records that the batch could not",
                ],
                SPACE,
            ),
            mutant(
                "a batch in the writer's hands counts as saved",
                QUEUE,
                ["state.unsaved = batch.len();", "state.unsaved = 0;"],
                SAVED,
            ),
            mutant(
                "a place is durable before its batch is saved",
                QUEUE,
                [
                    "            let batch = store.format(entries);\n",
                    "            if let Some(JournalEntry::Mark(mark)) = entries.last() {\n                \
                        self.0.durable.advance(mark.place);\n            }\n            let batch = \
                        store.format(entries);\n",
                ],
                SAVED,
            ),
            mutant(
                "nobody is woken when the queue is closed",
                QUEUE,
                ["self.state().closed = true;\n        self.0.changed.notify_all();", "self.state().closed = true;"],
                SAVED,
            ),
            mutant(
                "the queue is closed behind the notice",
                QUEUE,
                [
                    "self.state().closed = true;\n        self.0.changed.notify_all();",
                    "self.0.changed.notify_all();\n        self.state().closed = true;",
                ],
                SAVED,
            ),
            mutant(
                "the writer ends before the queue is empty",
                QUEUE,
                [
                    "        let mut state = self.0.changed.wait_while(self.state(), waits)",
                    "        if self.state().closed {\n            return None;\n        }\n        let mut state = \
                        self.0.changed.wait_while(self.state(), waits)",
                ],
                SAVED,
            ),
            mutant(
                "a failed batch is given up",
                QUEUE,
                [
                    "Err(error) if self.batch_failed(error.to_string()) => {}",
                    "Err(error) if self.batch_failed(error.to_string()) => break,",
                ],
                FAILS_ONCE,
            ),
            mutant(
                "whoever waits is not woken by a failure",
                QUEUE,
                [
                    "state.write_error = Some(why);\n        self.0.changed.notify_all();",
                    "state.write_error = Some(why);",
                ],
                NEVER_WORKS,
            ),
            mutant(
                "a writer whose disk fails never ends",
                QUEUE,
                ["        if state.closed {\n            return false;\n        }\n", ""],
                NEVER_WORKS,
            ),
            mutant(
                "the durable place goes back",
                DURABLE,
                ["if self.place().is_before(place) {", "if place != self.place() && place.is_before(self.place()) {"],
                SAVED,
            ),
        ],
    },
    Row {
        name: "batch-threads",
        says: "Every block that is decoded is planned once and in order, the end is seen behind the last, a batch is \
            never too long, and either thread ends when the other does",
        requirement: "GMC-1",
        bound: "batch_channel.rs with a decoder and a planner; up to 3 blocks, batches of 1 and 2; cancelled at the \
            beginning and after a batch; no bound on preemptions",
        assumes: ASSUMES,
        suffices: "the threads share one batch under one mutex and two flags that are set once",
        harnesses: &[],
        searches: &[],
        models: &[loom(PLANNED), loom(CANCELLED)],
        mutants: &[
            mutant(
                "the end is looked up behind the batch",
                BATCHES,
                [
                    "            let ended = self.0.ended.load(Ordering::Acquire);\n            if \
                        self.try_receive(batch) {\n                break;\n            }\n",
                    "            if self.try_receive(batch) {\n                break;\n            }\n            let \
                        ended = self.0.ended.load(Ordering::Acquire);\n",
                ],
                PLANNED,
            ),
            mutant(
                "the decoder ends without a word",
                BATCHES,
                ["        self.0.ended.store(true, Ordering::Release);\n", ""],
                PLANNED,
            ),
            mutant("a batch is planned twice", BATCHES, ["        batch.clear();\n", ""], PLANNED),
            mutant(
                "a batch grows without a bound",
                BATCHES,
                ["if pending.has_space() {", "if pending.has_space() || !pending.is_empty() {"],
                PLANNED,
            ),
            mutant(
                "a block without space is left out",
                BATCHES,
                ["            drop(pending);\n", "            return true;\n"],
                PLANNED,
            ),
            mutant(
                "a decoder without space does not see that it is cancelled",
                BATCHES,
                ["while !self.0.cancelled.load(Ordering::Relaxed) {", "loop {"],
                CANCELLED,
            ),
            mutant(
                "a planner ends without a word",
                BATCHES,
                [
                    "    fn drop(&mut self) {\n        self.0.cancelled.store(true, Ordering::Relaxed);\n",
                    "    fn drop(&mut self) {\n",
                ],
                CANCELLED,
            ),
        ],
    },
    Row {
        name: "jog-threads",
        says: "Every request for a manual move wakes the planning thread and is answered with its own answer; the \
            thread ends with the motion path, also in the middle of a move",
        requirement: "DNC-6; Beyond the source, *Manual moves*",
        bound: "jog_mailbox.rs with the motion path and the planning thread; 2 requests; one that is cancelled and one \
            that is dropped while it waits for space; no bound on preemptions",
        assumes: ASSUMES,
        suffices: "one request is pending at a time, and a third only repeats the second",
        harnesses: &[],
        searches: &[],
        models: &[loom(ANSWERED), loom(NEXT), loom(DROPPED)],
        mutants: &[
            mutant(
                "the thread is woken before the request is there",
                MAILBOX,
                [
                    "        self.number = self.number.wrapping_add(1);\n",
                    "        self.number = self.number.wrapping_add(1);\n        self.wake();\n        let wake = |_: \
                        &Self| ();\n        if let Some(requests) = &self.requests {\n            let _ = \
                        requests.try_send((self.number, request));\n        }\n        return wake(self);\n        \
                        #[allow(unreachable_code)]\n",
                ],
                ANSWERED,
            ),
            mutant(
                "the thread is not woken by a request",
                MAILBOX,
                ["        }\n        self.wake();\n    }\n\n    fn wake", "        }\n    }\n\n    fn wake"],
                ANSWERED,
            ),
            mutant(
                "the thread is not woken by the end",
                MAILBOX,
                ["        self.requests = None;\n        self.wake();", "        self.requests = None;"],
                ANSWERED,
            ),
            mutant(
                "the thread is woken before the end",
                MAILBOX,
                [
                    "        self.requests = None;\n        self.wake();",
                    "        self.wake();\n        self.requests = None;",
                ],
                ANSWERED,
            ),
            mutant(
                "a move in progress does not end with the motion path",
                MAILBOX,
                ["        self.cancel();\n        self.requests = None;", "        self.requests = None;"],
                DROPPED,
            ),
            mutant(
                "an answer is published relaxed",
                MAILBOX,
                [
                    "self.status.done.store(number, Ordering::Release);",
                    "self.status.done.store(number, Ordering::Relaxed);",
                ],
                ANSWERED,
            ),
            mutant(
                "an answer is looked up relaxed",
                MAILBOX,
                ["self.status.done.load(Ordering::Acquire)", "self.status.done.load(Ordering::Relaxed)"],
                ANSWERED,
            ),
            mutant(
                "a request is done before its result is known",
                MAILBOX,
                [
                    "self.status.failed.store(answered.is_err(), Ordering::Relaxed);\n                    \
                        self.status.done.store(number, Ordering::Release);",
                    "self.status.done.store(number, Ordering::Release);\n                    \
                        self.status.failed.store(answered.is_err(), Ordering::Relaxed);",
                ],
                NEXT,
            ),
            mutant(
                "the request before is cancelled",
                MAILBOX,
                [
                    "self.status.given_up.store(self.number, Ordering::Release);",
                    "self.status.given_up.store(self.number.wrapping_sub(1), Ordering::Release);",
                ],
                NEXT,
            ),
        ],
    },
    Row {
        name: "command-threads",
        says: "A command of the operator is received once and in its sender's order, or is refused; no handwheel count \
            is lost",
        requirement: "Beyond the source, *Operation*",
        bound: "command_channel.rs with two senders and the motion path; 2 commands each, space for one, handwheel \
            counts beyond an i16; preemption bound 3 (full: 4)",
        assumes: ASSUMES,
        suffices: "nobody waits; the counts are one number, and each side changes it by one operation",
        harnesses: &[],
        searches: &[],
        models: &[loom(RECEIVED)],
        mutants: &[
            mutant(
                "counts that arrive in between are lost",
                COMMANDS,
                [
                    "self.wheel.fetch_sub(counts, Ordering::Relaxed);",
                    "self.wheel.store(turned - counts, Ordering::Relaxed);",
                ],
                RECEIVED,
            ),
            mutant(
                "counts that do not fit are lost",
                COMMANDS,
                [
                    "self.wheel.fetch_sub(counts, Ordering::Relaxed);",
                    "self.wheel.fetch_sub(turned, Ordering::Relaxed);",
                ],
                RECEIVED,
            ),
            mutant(
                "a command without space counts as sent",
                COMMANDS,
                ["Err(TrySendError::Full(_)) => Err(CommandQueueFull),", "Err(TrySendError::Full(_)) => Ok(()),"],
                RECEIVED,
            ),
        ],
    },
];
