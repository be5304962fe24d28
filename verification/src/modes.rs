//! The modes of operation: when look-ahead is in the record window, and how normal run is left and entered again (REV-8
//! … REV-11).
//!
//! Invariant: a claim about an output holds after any sequence of commands.

use crate::choice::{Choice, ONE};
use crate::harness::{cover, harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row, Search, Size};
#[cfg(not(any(kani, verify_wasm)))]
use crate::region::Region;
use retrace_core::mode::{Mode, ModeCommand, ModeController, ModeState, MotionFacts, OperatorNotice, Resuming};
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
    let (reached, oldest) = (RecordIndex::new(c.word()), RecordIndex::new(c.word()));
    let place = match c.below(4) {
        0 => Place::start_of(reached),
        1 => Place { record: reached - 1, fraction: c.word() },
        2 => Place::start_of(oldest),
        _ => Place { record: RecordIndex::new(c.word()), fraction: c.word() },
    };
    let wheel = Rate::from_units(c.between(-ONE, ONE));
    MotionFacts { place, at_rest: c.flag(), reached, oldest, outputs_agree: c.flag(), wheel }
}

/// Any state that is valid, whether or not commands lead to it.
fn any_state(c: &mut impl Choice) -> Option<ModeState> {
    let state = ModeState {
        mode: Mode::ALL[c.below(6) as usize],
        held: c.flag(),
        rested_since_run: c.flag(),
        confirmed: c.flag(),
        override_rate: Rate::from_units(c.between(0, ONE)),
        rapid_override: Rate::from_units(c.between(0, ONE)),
        retrace_rate: Rate::from_units(c.between(1, 8 * ONE)),
        notified: c.flag(),
        resuming: match c.below(3) {
            0 => Resuming::No,
            1 => Resuming::Ask,
            _ => Resuming::Confirmed,
        },
    };
    c.assume(is_valid(&state))?;
    Some(state)
}

/// The invariant of the states.
fn is_valid(state: &ModeState) -> bool {
    let ModeState { mode, held, rested_since_run, confirmed, notified, resuming, .. } = *state;
    let waits_for_outputs = mode == Mode::Rejoin || mode == Mode::AwaitOutputs;
    let rates = [state.override_rate, state.rapid_override];
    // normal run, and the wait at the furthest place, are entered at rest
    (rested_since_run || mode != Mode::Run && mode != Mode::AwaitOutputs)
        // motion is resumed in normal run, and a hold ends that
        && (resuming == Resuming::No || mode == Mode::Run && !held)
        && (!confirmed || waits_for_outputs)
        && (!notified || waits_for_outputs || mode == Mode::Reverse)
        && Rate::ZERO <= rates[0] && rates[0] <= Rate::ONE
        && Rate::ZERO <= rates[1] && rates[1] <= Rate::ONE
        && Rate::ZERO < state.retrace_rate && state.retrace_rate <= Rate::MAX
}

/// Whether outputs that differ may be restored in this state without asking.
fn may_restore(state: &ModeState) -> bool {
    state.confirmed || state.resuming == Resuming::Confirmed
}

/// From any valid state any command: it is refused exactly where it must be, and then nothing changes; else its effect
/// is the one that the modes define, and the state is valid.
fn commands_do_what_they_say(c: &mut impl Choice) -> Option<()> {
    let before = any_state(c)?;
    let command = any_order(c);
    let mut controller = ModeController::with_state(before);
    let answer = controller.apply(command);
    let after = controller.state();
    let in_run = before.mode == Mode::Run;
    let accepts = match command {
        ModeCommand::Resume => before.held,
        ModeCommand::Recover => before.held || before.mode == Mode::AwaitOutputs,
        ModeCommand::Confirm => before.mode == Mode::AwaitOutputs,
        ModeCommand::Leave { .. } => !in_run,
        ModeCommand::Reverse(rate) | ModeCommand::Forward(rate) => rate > Rate::ZERO,
        _ => true,
    };
    cover!(c, Accepted, accepts);
    cover!(c, Refused, !accepts);
    cover!(c, Held, before.held);
    cover!(c, NormalRun, in_run);
    cover!(c, Leaving, in_run && after.mode != Mode::Run);
    holds!(answer.is_ok() == accepts);
    if !accepts {
        holds!(after == before);
        return Some(());
    }
    holds!(is_valid(&after));
    // a mode is entered by its command alone, at the rate of the command, not held, and not confirmed without consent
    let entered = match command {
        ModeCommand::Reverse(rate) => Some((Mode::Reverse, rate, false)),
        ModeCommand::Forward(rate) => Some((Mode::Forward, rate, false)),
        ModeCommand::Wheel => Some((Mode::Wheel, Rate::ONE, false)),
        ModeCommand::Leave { ask } => Some((Mode::Rejoin, Rate::ONE, !ask)),
        _ => None,
    };
    let rates = [before.override_rate, before.rapid_override];
    let [mut feed, mut rapid] = rates;
    if let Some((mode, rate, confirmed)) = entered {
        let limited = if rate < Rate::MAX { rate } else { Rate::MAX };
        holds!(after.mode == mode && !after.held && after.retrace_rate == limited);
        holds!(after.confirmed == confirmed && !after.notified && after.resuming == Resuming::No);
        holds!(after.rested_since_run == (before.rested_since_run && !in_run));
    } else {
        holds!(after.mode == before.mode && after.retrace_rate == before.retrace_rate);
        holds!(after.rested_since_run == before.rested_since_run && after.notified == before.notified);
        let (mut held, mut confirmed, mut resuming) = (before.held, before.confirmed, before.resuming);
        match command {
            ModeCommand::Hold => (held, resuming) = (true, Resuming::No),
            ModeCommand::Confirm => confirmed = true,
            ModeCommand::Recover if before.mode == Mode::AwaitOutputs => (held, confirmed) = (false, true),
            ModeCommand::Resume => (held, resuming) = (false, if in_run { Resuming::Ask } else { Resuming::No }),
            ModeCommand::Recover => {
                (held, resuming) = (false, if in_run { Resuming::Confirmed } else { Resuming::No });
            }
            ModeCommand::Restart { confirmed: consent } => {
                let asked = if consent { Resuming::Confirmed } else { Resuming::Ask };
                (held, resuming) = (false, if in_run { asked } else { Resuming::No });
            }
            ModeCommand::Override(rate) => feed = unit(rate),
            ModeCommand::RapidOverride(rate) => rapid = unit(rate),
            _ => {}
        }
        holds!((after.held, after.confirmed, after.resuming) == (held, confirmed, resuming));
    }
    holds!(after.override_rate == feed && after.rapid_override == rapid);
    Some(())
}

/// A rate limited to 0 … 1.
fn unit(rate: Rate) -> Rate {
    if rate < Rate::ZERO {
        Rate::ZERO
    } else if rate > Rate::ONE {
        Rate::ONE
    } else {
        rate
    }
}

/// From any valid state one period with any report of the card: the output is the one that the modes allow, and the
/// state is valid.
fn outputs_are_as_the_modes_allow(c: &mut impl Choice) -> Option<()> {
    let before = any_state(c)?;
    let facts = any_facts(c);
    let mut controller = ModeController::with_state(before);
    let output = controller.advance_period(&facts);
    let after = controller.state();
    holds!(is_valid(&after));
    // only commands change these
    holds!(after.held == before.held && after.retrace_rate == before.retrace_rate);
    holds!(after.override_rate == before.override_rate && after.rapid_override == before.rapid_override);
    holds!(!may_restore(&after) || may_restore(&before));
    let (runs, ran) = (after.mode == Mode::Run, before.mode == Mode::Run);
    cover!(c, NormalRun, runs && ran);
    cover!(c, Leaving, !after.rested_since_run);
    cover!(c, Rejoined, runs && !ran);
    cover!(c, Held, after.held);
    cover!(c, OutputsDiffer, output.notice == Some(OperatorNotice::OutputsDiffer));
    cover!(c, AtEnd, output.notice == Some(OperatorNotice::HistoryStart));
    cover!(c, Backward, output.target.feed < Rate::ZERO);
    cover!(c, Accepted, output.restore_outputs);
    // look-ahead is in the window in normal run, and while the cursor still runs out of it; then it only brakes
    holds!(after.rested_since_run == (before.rested_since_run || facts.at_rest));
    holds!(output.look_ahead == (runs || !after.rested_since_run));
    holds!(after.rested_since_run || output.target == RateTarget::ZERO && output.notice.is_none() && after == before);
    // after a stop normal run resumes only with outputs that agree, or that are restored with consent
    let resumes = before.resuming != Resuming::No;
    holds!(!resumes || output.target == RateTarget::ZERO || facts.outputs_agree || output.restore_outputs);
    // normal run is entered at the furthest place, at rest, with outputs that agree or are restored with consent
    let at_furthest = facts.at_rest && facts.place.boundary_ahead() == facts.reached;
    if output.notice == Some(OperatorNotice::RunResumed) {
        holds!(runs && at_furthest && !may_restore(&after));
        holds!(output.restore_outputs != facts.outputs_agree && (!output.restore_outputs || may_restore(&before)));
    } else {
        holds!(!output.restore_outputs && (!runs || ran));
    }
    // each notice once, at its end
    let start = facts.at_rest && facts.place == Place::start_of(facts.oldest);
    match output.notice {
        Some(OperatorNotice::HistoryStart) => {
            holds!(after.mode == Mode::Reverse && start && !before.notified && after.notified);
        }
        Some(OperatorNotice::OutputsDiffer) => {
            holds!(after.mode == Mode::AwaitOutputs && at_furthest && !facts.outputs_agree && after.notified);
            holds!(!before.notified || before.mode != Mode::AwaitOutputs);
        }
        _ => {}
    }
    // motion is that of the mode; in normal run and on the way back to it the overrides apply, and 0 stops all of it
    let stops = after.held || after.resuming != Resuming::No || !after.rested_since_run;
    let both = |rate| RateTarget { feed: rate, rapid: rate };
    let wanted = match after.mode {
        _ if stops => both(Rate::ZERO),
        Mode::Run | Mode::Rejoin if after.override_rate == Rate::ZERO => both(Rate::ZERO),
        Mode::Run | Mode::Rejoin => RateTarget { feed: after.override_rate, rapid: after.rapid_override },
        Mode::Reverse => both(-after.retrace_rate),
        Mode::Forward => both(after.retrace_rate),
        Mode::Wheel => both(facts.wheel),
        Mode::AwaitOutputs => both(Rate::ZERO),
    };
    holds!(output.target == wanted);
    // forward run and the way back end at the furthest place; whatever moved the cursor away from it, it goes back
    let at_reached = facts.at_rest && facts.place == Place::start_of(facts.reached);
    let goes_on = !(after.rested_since_run && at_reached);
    holds!(before.mode != Mode::Forward || (after.mode == Mode::Forward) == goes_on);
    holds!(before.mode != Mode::AwaitOutputs || at_furthest || after.mode == Mode::Rejoin);
    holds!(before.mode != Mode::Reverse && before.mode != Mode::Wheel || after.mode == before.mode);
    Some(())
}

/// Both states in which a job begins are valid, not held, and without consent to restore outputs.
fn beginnings_are_valid(c: &mut impl Choice) -> Option<()> {
    let resumed = c.flag();
    cover!(c, NormalRun, !resumed);
    cover!(c, Leaving, resumed);
    let controller = if resumed { ModeController::rejoining() } else { ModeController::default() };
    let state = controller.state();
    holds!(is_valid(&state) && !may_restore(&state) && !state.held && state.rested_since_run);
    holds!(state.mode == if resumed { Mode::Rejoin } else { Mode::Run });
    holds!(state.override_rate == Rate::ONE && state.rapid_override == Rate::ONE);
    Some(())
}

/// `ORDERS` times a command and an output, from the beginning: each output is as the modes allow, judged from the
/// commands alone.
#[cfg(not(any(kani, verify_wasm)))]
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
        cover!(c, NormalRun, operation.mode() == Mode::Run);
        cover!(c, Leaving, !turned);
        cover!(c, Rejoined, demand.notice == Some(OperatorNotice::RunResumed));
        cover!(c, Held, operation.is_held());
        cover!(c, OutputsDiffer, compares);
        cover!(c, Backward, demand.target.feed < Rate::ZERO);
        cover!(c, Forward, demand.target.feed > Rate::ZERO);
        k += 1;
    }
    Some(())
}

harnesses! {
    modes_commands, unwind 2, covers [Accepted, Refused, Held, NormalRun, Leaving] => |c| commands_do_what_they_say(c);
    modes_outputs, unwind 2, covers [
        NormalRun, Leaving, Rejoined, Held, OutputsDiffer, AtEnd, Backward, Accepted,
    ] => |c| outputs_are_as_the_modes_allow(c);
    modes_beginnings, unwind 2, covers [NormalRun, Leaving] => |c| beginnings_are_valid(c);
}

/// Long runs of drawn commands.
#[cfg(not(any(kani, verify_wasm)))]
fn long_runs(size: Size) -> String {
    let mut draw = crate::native::Draw::new(size.seed);
    let runs = if size.full { 200_000 } else { 20_000 };
    for _ in 0..runs {
        demands_are_in_order::<60>(&mut draw);
    }
    draw.assert_reached(&[Region::NormalRun, Region::Leaving, Region::Rejoined, Region::Held, Region::OutputsDiffer]);
    draw.assert_reached(&[Region::Forward, Region::Backward]);
    format!("{runs} runs of 60 drawn commands and reports")
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
    bound: "none: any command and any period with any report, from any valid state; long drawn runs from the \
        beginning, judged without the state",
    assumes: "nothing of the card's reports; of the state, the invariant, which both beginnings satisfy and every \
        command and period preserves",
    suffices: "one step from every valid state is an induction over sequences of any length",
    harnesses: &["modes_commands", "modes_outputs", "modes_beginnings"],
    searches: &[Search { name: "modes-long", run: long_runs }],
    models: &[],
    mutants: &[
        Mutant {
            name: "a feed override of zero lets rapid motion run",
            file: MODE,
            find: "Mode::Run | Mode::Rejoin if self.state.override_rate == Rate::ZERO => RateTarget::ZERO,",
            put: "",
            killer: "modes_outputs",
        },
        Mutant {
            name: "the road is cut under a moving cursor",
            file: MODE,
            find: "if !facts.at_rest {",
            put: "if !facts.at_rest && facts.wheel == Rate::ZERO {",
            killer: "modes_outputs",
        },
        Mutant {
            name: "normal run goes on anywhere at rest",
            file: MODE,
            find: "let at_furthest = facts.at_rest && facts.place.boundary_ahead() == facts.reached;",
            put: "let at_furthest = facts.at_rest;",
            killer: "modes_outputs",
        },
        Mutant {
            name: "normal run goes on after a hold without comparing",
            file: MODE,
            find: "ModeCommand::Resume if self.state.held => self.resume_motion(Resuming::Ask),",
            put: "ModeCommand::Resume if self.state.held => self.state.held = false,",
            killer: "modes_commands",
        },
        Mutant {
            name: "outputs are restored without asking",
            file: MODE,
            find: "if facts.outputs_agree || self.state.confirmed {",
            put: "if facts.outputs_agree || self.state.confirmed || self.state.notified {",
            killer: "modes-long",
        },
        Mutant {
            name: "a hold does not stand under the wheel",
            file: MODE,
            find: "_ if self.state.held || self.state.resuming != Resuming::No => RateTarget::ZERO,",
            put: "_ if self.state.held && self.state.mode != Mode::Wheel => RateTarget::ZERO,",
            killer: "modes_outputs",
        },
        Mutant {
            name: "a resumed job restores outputs without asking",
            file: MODE,
            find: "ModeState { mode: Mode::Rejoin, ..Self::default().state }",
            put: "ModeState { mode: Mode::Rejoin, confirmed: true, ..Self::default().state }",
            killer: "modes_beginnings",
        },
        Mutant {
            name: "a refused command ends the hold",
            file: MODE,
            find: "ModeCommand::Confirm => return Err(ModeError::NothingToConfirm),",
            put: "ModeCommand::Confirm => {\n                self.state.held = false;\n                return \
                  Err(ModeError::NothingToConfirm);\n            }",
            killer: "modes_commands",
        },
        Mutant {
            name: "the wait at the furthest place is not left when the cursor moves",
            file: MODE,
            find: "Mode::AwaitOutputs if !at_furthest => self.state.mode = Mode::Rejoin,",
            put: "",
            killer: "modes_outputs",
        },
    ],
}];
