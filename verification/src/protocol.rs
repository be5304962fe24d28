//! The protocol between card and host: every state that the two real endpoints reach on a line that loses, delays and
//! doubles frames, while either end is restarted.
//!
//! Invariant: the states are the endpoints themselves, hashed; the search leaves nothing out within its depth.

#[cfg(not(any(kani, verify_wasm)))]
mod counting_card;
#[cfg(not(any(kani, verify_wasm)))]
mod fingerprint;
#[cfg(not(any(kani, verify_wasm)))]
mod search;
#[cfg(not(any(kani, verify_wasm)))]
mod world;

#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row, Search, Size};
#[cfg(not(any(kani, verify_wasm)))]
use search::Plan;
#[cfg(not(any(kani, verify_wasm)))]
use world::{Begin, Budget};

/// Numbers at which an epoch begins, and the epoch before: each crosses the wrap, or half of it.
#[cfg(not(any(kani, verify_wasm)))]
const STARTS: [(retrace_link::sequence::FirstNumbers, u16); 3] = {
    use retrace_link::sequence::FirstNumbers;
    [
        (FirstNumbers { command: u16::MAX, entry: u16::MAX, rate: u16::MAX }, u16::MAX),
        (FirstNumbers { command: 0x7FFF, entry: 0x7FFE, rate: 0x7FFF }, 0x7FFF),
        (FirstNumbers::protocol(), 0),
    ]
};

/// No event but frames that arrive, and periods.
#[cfg(not(any(kani, verify_wasm)))]
const NOTHING: Budget =
    Budget { faults: 0, commands: 0, requests: &[], card_restarts: 0, host_restarts: 0, openings: 0 };

/// Every state within the depth of each plan.
#[cfg(not(any(kani, verify_wasm)))]
pub fn search_all(size: Size) -> String {
    use world::Request::{Ahead, Backward, Behind, Forward, Output, Stop};
    let deeper = |quick: &'static [u32], full: &'static [u32]| if size.full { full } else { quick };
    let plans = [
        Plan {
            name: "commands",
            begin: Begin::Open,
            budget: Budget { faults: 2, commands: 2, requests: &[Ahead, Output], ..NOTHING },
            depths: deeper(&[6], &[8, 6, 6]),
        },
        Plan {
            name: "rates",
            begin: Begin::Open,
            budget: Budget { faults: 2, commands: 2, requests: &[Forward, Stop], ..NOTHING },
            depths: deeper(&[6], &[9, 7, 7]),
        },
        Plan {
            name: "motion",
            begin: Begin::Filled,
            budget: Budget {
                faults: 1,
                commands: 4,
                requests: if size.full { &[Ahead, Behind, Forward, Backward] } else { &[Ahead, Backward] },
                ..NOTHING
            },
            depths: deeper(&[7], &[7, 6, 6]),
        },
        Plan {
            name: "openings",
            begin: Begin::Open,
            budget: Budget { faults: 2, commands: 1, requests: &[Output], openings: 1, ..NOTHING },
            depths: deeper(&[6], &[8, 6, 6]),
        },
        Plan {
            name: "restarts",
            begin: Begin::Open,
            budget: Budget {
                faults: 1,
                commands: 1,
                requests: &[Output],
                card_restarts: 1,
                host_restarts: 1,
                ..NOTHING
            },
            depths: deeper(&[6], &[9, 8, 8]),
        },
        Plan {
            name: "power-on",
            begin: Begin::PowerOn,
            budget: Budget { faults: 2, card_restarts: 1, host_restarts: 1, ..NOTHING },
            depths: deeper(&[8], &[12, 10, 10]),
        },
    ];
    search::run(&plans)
}

/// No harness: everything here is a search.
#[cfg(not(any(kani, verify_wasm)))]
pub const HARNESSES: &[crate::native::Harness] = &[];

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[Row {
    name: "protocol",
    says: "Over a line that loses, delays and doubles frames, with restarts of either end: a record number has one \
           content; commands and rates of the open epoch are applied once and in order, and none of another epoch; \
           the host's predicted window is the card's; the host publishes what the card did; on a line without further \
           faults everything outstanding is done within 40 periods",
    requirement: "GMC-2, over a line that can damage bytes",
    bound: "every state within the printed depth, of the real endpoints with 16 entries, 32 commands and a window of 4 \
            records; at most 2 faults, 4 commands, one restart of each end, one new epoch; states are distinguished by \
            fingerprints of 128 bits",
    assumes: "frames arrive whole or not at all (rows on frames); the card's core counts and has no rate law; all \
              periods have 20 ms",
    suffices: "each defect of the protocol that was seeded shows within few steps; the decisions hold for all numbers \
               (protocol-decisions)",
    harnesses: &[],
    searches: &[Search { name: "protocol_states", run: search_all }],
    models: &[],
    mutants: &[
        Mutant {
            name: "a command that comes again is applied again",
            file: "crates/link/src/card_endpoint.rs",
            find: "        if number == self.next_command {",
            put: "        if !is_after(number, self.next_command) {",
            killer: "protocol_states",
        },
        Mutant {
            name: "a late rate is applied",
            file: "crates/link/src/card_endpoint.rs",
            find: "        if is_after(number, self.rate_seq) {",
            put: "        if number != self.rate_seq {",
            killer: "protocol_states",
        },
        Mutant {
            name: "an opening that comes again opens again",
            file: "crates/link/src/session.rs",
            find: "    boot == own_boot && epoch == next_epoch(last_epoch)",
            put: "    boot == own_boot && (epoch == next_epoch(last_epoch) || epoch == last_epoch)",
            killer: "protocol_states",
        },
        Mutant {
            name: "the prediction keeps what the card has rejected",
            file: "crates/link/src/host/rx.rs",
            find: "        self.predicted.set_reported(low, high);",
            put: "        self.predicted.set_reported(self.predicted.low(), self.predicted.high());",
            killer: "protocol_states",
        },
        Mutant {
            name: "commands in transit are acknowledged by any report",
            file: "crates/link/src/host/rx.rs",
            find: "        let Some(taken) = acknowledged_items(next_command, self.base, self.count) else { return };",
            put: "        let taken = acknowledged_items(next_command, self.base, self.count).unwrap_or(self.count);",
            killer: "protocol_states",
        },
        Mutant {
            name: "the content of a record is that of another one",
            file: "crates/link/src/host/tx.rs",
            find: "            let command = &self.queue[usize::from(self.base.wrapping_add(self.sent)) % COMMANDS];",
            put: "            let command = &self.queue[usize::from(self.base.wrapping_add(offset)) % COMMANDS];",
            killer: "protocol_states",
        },
        Mutant {
            name: "entries that come again are published again",
            file: "crates/link/src/host/rx.rs",
            find: "            if number == self.next_entry {",
            put: "            if !is_after(number, self.next_entry) {",
            killer: "protocol_states",
        },
        Mutant {
            name: "lost commands are not sent again",
            file: "crates/link/src/host/tx.rs",
            find: "const AGAIN_US: u64 = 60_000;",
            put: "const AGAIN_US: u64 = u64::MAX;",
            killer: "protocol_states",
        },
    ],
}];
