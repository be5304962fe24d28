//! The modes of operation: when look-ahead is in the record window, and how normal run is left and entered again (REV-8
//! … REV-11).
//!
//! Invariant: a claim about an output holds after any sequence of commands.

use crate::choice::{Choice, ONE};
use crate::harness::{harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row, Search, Size};
use retrace_core::mode::{Mode, ModeCommand, ModeController, MotionFacts, OperatorNotice};
use retrace_core::{Place, Rate, RateTarget, RecordIndex};

fn any_order(c: &mut impl Choice) -> ModeCommand {
    match c.below(11) {
        0 => ModeCommand::Hold,
        1 => ModeCommand::Resume,
        2 => ModeCommand::Override(Rate::from_units(c.between(-ONE, 9 * ONE))),
        9 => ModeCommand::RapidOverride(Rate::from_units(c.between(-ONE, 9 * ONE))),
        3 => ModeCommand::Reverse(Rate::from_units(c.between(-1, 9 * ONE))),
        4 => ModeCommand::Forward(Rate::from_units(c.between(-1, 9 * ONE))),
        5 => ModeCommand::Wheel,
        6 => ModeCommand::Leave { ask: c.flag() },
        7 => ModeCommand::Recover,
        8 => ModeCommand::Restart { confirmed: c.flag() },
        _ => ModeCommand::Confirm,
    }
}

fn any_facts(c: &mut impl Choice) -> MotionFacts {
    let reached = RecordIndex::new(c.word());
    let place = match c.below(3) {
        0 => Place::start_of(reached),
        1 => Place { record: reached - 1, fraction: c.word() },
        _ => Place { record: RecordIndex::new(c.word()), fraction: c.word() },
    };
    let wheel = Rate::from_units(c.between(-ONE, ONE));
    MotionFacts {
        place,
        at_rest: c.flag(),
        reached,
        oldest: RecordIndex::new(c.word()),
        outputs_agree: c.flag(),
        wheel,
    }
}

/// `ORDERS` times a command or none, and an output: each output is as the modes allow.
fn demands_are_in_order<const ORDERS: usize>(c: &mut impl Choice) -> Option<()> {
    let mut operation = ModeController::default();
    // has the cursor been at rest since normal run was left? may outputs be restored without another confirmation? was
    // a stop ended by a command, so that outputs are compared before motion resumes?
    let (mut turned, mut agreed, mut compares, mut k) = (true, false, false, 0);
    while k < ORDERS {
        let (was, order, facts) = (operation.mode(), any_order(c), any_facts(c));
        let before = operation;
        match (operation.apply(order), order) {
            (Err(_), _) => holds!(operation == before),
            (Ok(()), ModeCommand::Leave { ask: false } | ModeCommand::Confirm | ModeCommand::Recover) => agreed = true,
            (Ok(()), ModeCommand::Restart { confirmed: word }) if was == Mode::Run => agreed = word,
            (Ok(()), ModeCommand::Resume) if was == Mode::Run => agreed = false,
            (
                Ok(()),
                ModeCommand::Leave { .. } | ModeCommand::Reverse(_) | ModeCommand::Forward(_) | ModeCommand::Wheel,
            ) => agreed = false,
            (Ok(()), _) => {}
        }
        match (order, was) {
            (ModeCommand::Resume | ModeCommand::Recover, Mode::Run) => compares |= before.is_held(),
            (ModeCommand::Restart { .. }, Mode::Run) => compares = true,
            (ModeCommand::Hold, _) => compares = false,
            _ => compares &= operation.mode() == Mode::Run,
        }
        if was == Mode::Run && operation.mode() != Mode::Run {
            turned = false;
        }
        let mode = operation.mode();
        let demand = operation.advance_period(&facts);
        turned |= facts.at_rest;
        // look-ahead is in the window in normal run, and while the cursor still runs out of it
        holds!(demand.look_ahead == (operation.mode() == Mode::Run || !turned));
        // nothing but braking before the cursor has been at rest
        holds!(turned || demand.target == RateTarget::ZERO && demand.notice.is_none());
        // after a stop normal run resumes only with outputs that agree
        holds!(!compares || demand.target == RateTarget::ZERO || facts.outputs_agree || demand.restore_outputs);
        compares &= !facts.outputs_agree && operation.mode() == Mode::Run && !demand.restore_outputs;
        // normal run is entered at the furthest place, at rest, with outputs that agree or are restored by command
        if demand.notice == Some(OperatorNotice::RunResumed) {
            holds!(operation.mode() == Mode::Run);
            holds!(facts.at_rest && facts.place.boundary_ahead() == facts.reached);
            holds!(demand.restore_outputs != facts.outputs_agree);
        } else {
            holds!(mode == Mode::Run || operation.mode() != Mode::Run);
            holds!(!demand.restore_outputs && demand.notice != Some(OperatorNotice::RunResumed));
        }
        holds!(!demand.restore_outputs || agreed);
        // a confirmation in normal run holds until motion resumes
        agreed &= operation.mode() != Mode::Run || compares;
        // a hold persists in every mode; backward only where reverse or the wheel requests it
        holds!(!operation.is_held() || demand.target == RateTarget::ZERO);
        let backward = matches!(operation.mode(), Mode::Reverse | Mode::Wheel);
        let RateTarget { feed, rapid } = demand.target;
        holds!(feed >= Rate::ZERO && rapid >= Rate::ZERO || backward);
        holds!(-Rate::MAX <= feed && feed <= Rate::MAX);
        // the overrides apply to program motion alone, and a feed override of zero stops all of it
        let overridden = matches!(operation.mode(), Mode::Run | Mode::Rejoin);
        holds!(!overridden || feed <= operation.override_rate() && rapid <= operation.rapid_override());
        holds!(!overridden || operation.override_rate() != Rate::ZERO || rapid == Rate::ZERO);
        holds!(overridden || feed == rapid);
        holds!(operation.override_rate() <= Rate::ONE && operation.rapid_override() <= Rate::ONE);
        k += 1;
    }
    Some(())
}

harnesses! {
    modes_3, unwind 4 => |c| demands_are_in_order::<3>(c);
}

/// Long runs of drawn commands.
#[cfg(not(any(kani, verify_wasm)))]
fn long_runs(size: Size) -> String {
    let mut draw = crate::native::Draw::new(size.seed);
    let runs = if size.full { 200_000 } else { 20_000 };
    for _ in 0..runs {
        demands_are_in_order::<60>(&mut draw);
    }
    format!("{runs} runs of 60 drawn orders and reports")
}

#[cfg(not(any(kani, verify_wasm)))]
const MODE: &str = "crates/core/src/mode.rs";

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[Row {
    name: "modes",
    says: "Look-ahead is in the record window in normal run only; normal run is left through rest and entered again, \
        and resumes after a stop, only at the furthest place, at rest, with outputs that agree or are restored by \
        command; a hold persists in every mode; a refused command changes nothing",
    requirement: "REV-8, REV-9, REV-10, REV-11, REV-13",
    bound: "any three commands and reports from the beginning; long drawn runs",
    assumes: "nothing of the card's reports",
    suffices: "three commands lead to every combination of mode, hold, turned, confirmed and reported; the rest is \
        two rates, which are passed on",
    harnesses: &["modes_3"],
    searches: &[Search { name: "modes-long", run: long_runs }],
    models: &[],
    mutants: &[
        Mutant {
            name: "a feed override of zero lets rapid motion run",
            file: MODE,
            find: "Mode::Run | Mode::Rejoin if self.override_rate == Rate::ZERO => RateTarget::ZERO,",
            put: "",
            killer: "modes_3",
        },
        Mutant {
            name: "the road is cut under a moving cursor",
            file: MODE,
            find: "if !facts.at_rest {",
            put: "if !facts.at_rest && facts.wheel == Rate::ZERO {",
            killer: "modes_3",
        },
        Mutant {
            name: "normal run goes on anywhere at rest",
            file: MODE,
            find: "let at_furthest = facts.at_rest && facts.place.boundary_ahead() == facts.reached;",
            put: "let at_furthest = facts.at_rest;",
            killer: "modes_3",
        },
        Mutant {
            name: "normal run goes on after a hold without comparing",
            file: MODE,
            find: "ModeCommand::Resume if self.held => self.resume_motion(Resuming::Ask),",
            put: "ModeCommand::Resume if self.held => self.held = false,",
            killer: "modes_3",
        },
        Mutant {
            name: "outputs are restored without asking",
            file: MODE,
            find: "if facts.outputs_agree || self.confirmed {",
            put: "if facts.outputs_agree || self.confirmed || self.notified {",
            killer: "modes-long",
        },
        Mutant {
            name: "a hold does not stand under the wheel",
            file: MODE,
            find: "_ if self.held || self.resuming != Resuming::No => RateTarget::ZERO,",
            put: "_ if self.held && self.mode != Mode::Wheel || self.resuming != Resuming::No => RateTarget::ZERO,",
            killer: "modes_3",
        },
    ],
}];
