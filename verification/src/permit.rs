//! The permit of the cutting outputs (CUT-3, CUT-4, CUT-6, CUT-8): no state and no sequence of commands has one on
//! without it.
//!
//! Invariant: the permit is defined here as in the requirements, and shares no decision with the card.

use crate::choice::Choice;
use crate::harness::{cover, harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row, Search, Size};
#[cfg(not(any(kani, verify_wasm)))]
use crate::region::Region;
#[cfg(not(any(kani, verify_wasm)))]
use retrace_card::permit::CutterPermit;
use retrace_card::permit::{PermitConditions, PermitTimer, ProofState, check_channel};
use retrace_core::{Place, RecordIndex};
#[cfg(not(any(kani, verify_wasm)))]
use retrace_link::MAX_CUTTING_CHANNELS;
use retrace_link::{CutterOffCause, CuttingChannel, CuttingSettings, ProofInput};

fn any_conditions(c: &mut impl Choice) -> PermitConditions {
    let denied = match c.below(5) {
        0 => Some(CutterOffCause::Collision),
        3 => Some(CutterOffCause::Alarm),
        1 => Some(CutterOffCause::HostSilent),
        2 => Some(CutterOffCause::EpochClosed),
        _ => None,
    };
    let (backward, moving, awaits_motion) = (c.flag(), c.flag(), c.flag());
    let (keeps_cutter, is_unwatched) = (c.flag(), c.flag());
    let inputs = c.below(64) as u16;
    let place = Place { record: RecordIndex::new(c.word()), fraction: 0 };
    PermitConditions { denied, backward, moving, awaits_motion, keeps_cutter, is_unwatched, inputs, place }
}

fn any_channel(c: &mut impl Choice, number: u8, most: u32) -> CuttingChannel {
    let standing_periods = c.upto(most) as u16;
    let proof = if c.flag() { Some(any_proof(c, most)) } else { None };
    CuttingChannel { channel: number, fires: c.flag(), standing_periods, lit_in_reverse: c.flag(), proof }
}

fn any_proof(c: &mut impl Choice, most: u32) -> ProofInput {
    let [proven_periods, lost_periods, out_periods] = [c.upto(most) as u16, c.upto(most) as u16, c.upto(most) as u16];
    ProofInput { input: 5, proven_periods, lost_periods, out_periods }
}

/// Any state of the proof that a history may lead to: its counters are below what ends them.
fn any_proof_state(c: &mut impl Choice, of: &CuttingChannel) -> ProofState {
    let Some(proof) = of.proof else { return ProofState::UNPROVEN };
    let below = |periods: u16| u32::from(periods.max(1)) - 1;
    if c.flag() {
        ProofState::Proven { inactive: c.upto(below(proof.lost_periods)) as u16 }
    } else {
        ProofState::Awaited { active: c.upto(below(proof.proven_periods)) as u16 }
    }
}

fn any_timer(c: &mut impl Choice, of: &CuttingChannel, settings: &CuttingSettings) -> PermitTimer {
    let handover = c.upto(u32::from(settings.handover_periods)) as u16;
    let standing = c.upto(u32::from(of.standing_periods)) as u16;
    PermitTimer { handover, standing, proof: any_proof_state(c, of) }
}

/// Whether the requirements permit that a channel that fires is on in this period, after a standstill of that length.
fn is_permitted(of: &CuttingChannel, settings: &CuttingSettings, timer: PermitTimer, now: &PermitConditions) -> bool {
    let stands = !now.moving && !now.keeps_cutter;
    let waits = now.awaits_motion && timer.handover < settings.handover_periods;
    let stood_too_long = stands && !waits && timer.standing >= of.standing_periods;
    let lost = is_lost(of, timer, now);
    now.denied.is_none() && !settings.inhibit && (of.lit_in_reverse || !now.backward) && !stood_too_long && !lost
}

/// Whether a cutter that was proven is lost in this period.
fn is_lost(of: &CuttingChannel, timer: PermitTimer, now: &PermitConditions) -> bool {
    let (Some(proof), ProofState::Proven { inactive }) = (of.proof, timer.proof) else { return false };
    !now.is_unwatched && now.inputs & 1 << proof.input == 0 && u32::from(inactive) + 1 >= u32::from(proof.lost_periods)
}

/// One channel, from any state: it is passed exactly where the requirements permit it, and its timer stays within its
/// bounds.
fn one_channel(c: &mut impl Choice) -> Option<()> {
    let of = any_channel(c, 3, u32::from(u16::MAX));
    let handover_periods = c.upto(u32::from(u16::MAX)) as u16;
    let settings = CuttingSettings { handover_periods, inhibit: c.flag(), ..CuttingSettings::default() };
    let timer = any_timer(c, &of, &settings);
    let now = any_conditions(c);
    let checked = check_channel(&of, &settings, timer, &now);
    cover!(c, Lit, of.fires && checked.is_ok());
    cover!(c, PutOut, of.fires && checked.is_err() && !settings.inhibit && now.denied.is_none() && !now.backward);
    cover!(c, Refused, of.fires && now.denied.is_some());
    cover!(c, Backward, of.fires && now.backward && checked.is_ok());
    cover!(c, AtRest, of.fires && !now.moving && checked.is_ok());
    cover!(c, Lost, of.fires && checked == Err(CutterOffCause::Lost));
    match checked {
        Ok(after) => {
            holds!(!of.fires && !settings.inhibit || of.fires && is_permitted(&of, &settings, timer, &now));
            holds!(after.standing <= of.standing_periods && after.handover <= settings.handover_periods);
            let counted = u32::from(after.standing) + u32::from(after.handover);
            let before = u32::from(timer.standing) + u32::from(timer.handover);
            let stands = of.fires && !now.moving && !now.keeps_cutter;
            holds!(!stands || counted == before + 1);
            if let (true, Some(proof)) = (of.fires, of.proof) {
                holds!(match after.proof {
                    ProofState::Awaited { active } => active < proof.proven_periods.max(1),
                    ProofState::Proven { inactive } => inactive < proof.lost_periods.max(1),
                });
                // a proven cutter stays proven as long as it is on
                let was_proven = matches!(timer.proof, ProofState::Proven { .. });
                holds!(!was_proven || matches!(after.proof, ProofState::Proven { .. }));
            }
        }
        Err(_) => holds!(settings.inhibit || of.fires && !is_permitted(&of, &settings, timer, &now)),
    }
    Some(())
}

/// Two channels, drawn outputs, any state: after a period each of them is 0 or permitted, no other output has changed,
/// and motion is blocked with every channel whose standstill was too long.
#[cfg(not(any(kani, verify_wasm)))]
fn outputs_of_a_period(c: &mut impl Choice) -> Option<()> {
    let mut settings = CuttingSettings { count: 2, handover_periods: c.upto(3) as u16, ..CuttingSettings::default() };
    settings.inhibit = c.flag();
    settings.channels[0] = any_channel(c, 0, 3);
    settings.channels[1] = any_channel(c, 2, 3);
    let mut timers = [PermitTimer::default(); MAX_CUTTING_CHANNELS];
    timers[0] = any_timer(c, &settings.channels[0], &settings);
    timers[1] = any_timer(c, &settings.channels[1], &settings);
    let lit = c.below(4) as u8;
    let mut permit = CutterPermit::with_state(settings, timers, lit);
    let now = any_conditions(c);
    let (asked, other) = ([c.word() as i32, c.word() as i32], c.word() as i32);
    let mut outputs = [asked[0], other, asked[1]];
    let outcome = permit.apply_period(&mut outputs, &now);
    holds!(outputs[1] == other);
    let after = [outputs[0], outputs[2]];
    let (mut off, mut blocks, mut k) = (0, false, 0);
    while k < 2 {
        let of = settings.channels[k];
        let was_lit = lit >> k & 1 == 1;
        let before = if was_lit { timers[k] } else { PermitTimer::default() };
        let permitted = if of.fires { is_permitted(&of, &settings, before, &now) } else { !settings.inhibit };
        holds!(after[k] == if permitted { asked[k] } else { 0 });
        if of.fires && asked[k] != 0 && !permitted {
            off |= u8::from(was_lit) << k;
            let allowed = now.denied.is_none() && !settings.inhibit && (of.lit_in_reverse || !now.backward);
            blocks |= allowed;
        }
        k += 1;
    }
    cover!(c, Lit, settings.channels[0].fires && after[0] != 0);
    cover!(c, PutOut, off != 0);
    cover!(c, Held, outcome.blocks);
    holds!(outcome.off.map_or(0, |off| off.channels) == off);
    holds!(outcome.blocks == blocks);
    Some(())
}

/// `PERIODS` of anything, from power-on, of one channel: with it on the machine is at rest for at most handover and
/// grace, and it is off wherever a condition is missing.
fn a_history<const PERIODS: usize>(c: &mut impl Choice) -> Option<()> {
    let of = CuttingChannel { fires: true, ..any_channel(c, 0, 2) };
    let handover_periods = c.upto(2) as u16;
    let settings = CuttingSettings { handover_periods, inhibit: c.flag(), ..CuttingSettings::default() };
    let most = u32::from(of.standing_periods) + u32::from(settings.handover_periods);
    let (mut lit, mut timer) = (false, PermitTimer::default());
    let (mut stood, mut k) = (0, 0);
    while k < PERIODS {
        let now = any_conditions(c);
        // the value that a command, an action, an instruction or a repeat sets; or it is unchanged
        if c.flag() {
            lit = c.flag();
        }
        let after = check_channel(&of, &settings, timer, &now);
        lit &= after.is_ok();
        timer = if let (true, Ok(after)) = (lit, after) { after } else { PermitTimer::default() };
        holds!(!lit || now.denied.is_none() && !settings.inhibit && (of.lit_in_reverse || !now.backward));
        stood = if lit && !now.moving && !now.keeps_cutter { stood + 1 } else { 0 };
        holds!(stood <= most);
        cover!(c, Lit, lit);
        cover!(c, PutOut, after.is_err());
        cover!(c, Limited, stood == most && most > 0);
        k += 1;
    }
    Some(())
}

harnesses! {
    permit_one_channel, unwind 3, covers [Lit, PutOut, Refused, Backward, AtRest, Lost] => |c| one_channel(c);
    permit_history_6, unwind 8, covers [Lit, PutOut, Limited] => |c| a_history::<6>(c);
}

/// Long runs of drawn commands on a whole card.
#[cfg(not(any(kani, verify_wasm)))]
mod card;

#[cfg(not(any(kani, verify_wasm)))]
fn drawn_outputs(size: Size) -> String {
    let mut draw = crate::native::Draw::new(size.seed);
    let runs = if size.full { 4_000_000 } else { 400_000 };
    for _ in 0..runs {
        outputs_of_a_period(&mut draw);
    }
    draw.assert_reached(&[Region::Lit, Region::PutOut, Region::Held]);
    format!("{runs} drawn periods of two channels")
}

#[cfg(not(any(kani, verify_wasm)))]
fn long_histories(size: Size) -> String {
    let mut draw = crate::native::Draw::new(size.seed);
    let runs = if size.full { 200_000 } else { 20_000 };
    for _ in 0..runs {
        a_history::<60>(&mut draw);
    }
    draw.assert_reached(&[Region::Lit, Region::PutOut, Region::Limited]);
    format!("{runs} runs of 60 drawn periods")
}

#[cfg(not(any(kani, verify_wasm)))]
const PERMIT: &str = "crates/card/src/permit.rs";
#[cfg(not(any(kani, verify_wasm)))]
const CUTTERS: &str = "crates/card/src/player/cutters.rs";
#[cfg(not(any(kani, verify_wasm)))]
const PLAYER: &str = "crates/card/src/player.rs";
#[cfg(not(any(kani, verify_wasm)))]
const CARD: &str = "crates/card/src/card.rs";
#[cfg(not(any(kani, verify_wasm)))]
const HEIGHT: &str = "crates/card/src/player/height.rs";

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[Row {
    name: "permit",
    says: "No state and no sequence of commands has a cutting output on without the permit: epoch open, no alarm, \
        host alive, no dry run, not backward, not at rest for longer than handover and grace, not lost; and where the \
        grace ran out, the cutter was lost, or no sheet was found nothing moves before a restart; path and layer are \
        what is emitted, and the path rests while the layer moves, except to heights that are passed with the cutter \
        on",
    requirement: "CUT-3, CUT-4, CUT-6, CUT-8, CUT-15, CUT-31",
    bound: "one period of any channel from any state, and any six periods from power-on; drawn states of two channels \
        and their outputs, drawn commands on a whole card",
    assumes: "a timer within its bounds, which every period preserves; that the card applies the rule to each \
        channel, last in every period, is tested with drawn commands and not proved",
    suffices: "one step from every state is an induction; the channels of a card do not depend on each other",
    harnesses: &["permit_one_channel", "permit_history_6"],
    searches: &[
        Search { name: "permit-outputs", run: drawn_outputs },
        Search { name: "permit-long", run: long_histories },
        Search { name: "permit-card", run: card::drawn_words },
    ],
    models: &[],
    mutants: &[
        Mutant {
            name: "an alarm does not put out",
            file: PERMIT,
            find: "if let Some(cause) = now.denied {",
            put: "if let (Some(cause), false) = (now.denied, now.keeps_cutter) {",
            killer: "permit_one_channel",
        },
        Mutant {
            name: "a dry run lets a lit channel burn",
            file: PERMIT,
            find: "    if settings.inhibit {\n        return Err",
            put: "    if settings.inhibit && !now.moving {\n        return Err",
            killer: "permit-outputs",
        },
        Mutant {
            name: "a torch is lit in reverse",
            file: PERMIT,
            find: "if now.backward && !of.lit_in_reverse {",
            put: "if now.backward && of.lit_in_reverse {",
            killer: "permit_one_channel",
        },
        Mutant {
            name: "one period more than the grace",
            file: PERMIT,
            find: "if timer.standing >= of.standing_periods {",
            put: "if timer.standing > of.standing_periods {",
            killer: "permit_history_6",
        },
        Mutant {
            name: "asking for motion gives the grace anew",
            file: PERMIT,
            find: "return Ok(PermitTimer { handover: timer.handover + 1, proof, ..timer });",
            put: "return Ok(PermitTimer { handover: timer.handover + 1, proof, standing: 0 });",
            killer: "permit_one_channel",
        },
        Mutant {
            name: "a lit channel begins its grace anew",
            file: PERMIT,
            find: "let before = if was_lit { *timer } else { PermitTimer::default() };",
            put: "let before = if was_lit && !conditions.awaits_motion { *timer } else { PermitTimer::default() };",
            killer: "permit-outputs",
        },
        Mutant {
            name: "the grace runs out and nothing is blocked",
            file: PERMIT,
            find: "outcome.blocks |= is_lost || cause == CutterOffCause::Standing;",
            put: "outcome.blocks |= is_lost || cause == CutterOffCause::Standing && !was_lit;",
            killer: "permit-outputs",
        },
        Mutant {
            name: "the path turns while the torch is lit",
            file: PLAYER,
            find: "if turns || wanted == Rate::ZERO {",
            put: "if wanted == Rate::ZERO {",
            killer: "permit-card",
        },
        Mutant {
            name: "records that come late start motion",
            file: CUTTERS,
            find: "if outcome.blocks {\n            self.block = MotionBlock::CutterOff;",
            put: "if outcome.blocks {\n            self.block = MotionBlock::None;",
            killer: "permit-card",
        },
        Mutant {
            name: "a replayed action lights the torch",
            file: PLAYER,
            find: "if change.value == 0 || !permit.is_forward_only(change.channel) {",
            put: "if change.value == 0 || !permit.is_forward_only(change.channel) || change.value > 0 {",
            killer: "permit-card",
        },
        Mutant {
            name: "the permit is applied before the alarms of the period",
            file: CARD,
            find: "self.player.apply_permit(self.permit_denial())",
            put: "self.player.apply_permit(None)",
            killer: "permit-card",
        },
        Mutant {
            name: "a cutter burns in a collision",
            file: CARD,
            find: "None if self.inputs.collisions() != 0 => Some(CutterOffCause::Collision),",
            put: "",
            killer: "permit-card",
        },
        Mutant {
            name: "a test pulse does not end",
            file: "crates/card/src/switching.rs",
            find: "if instruction.is_pulse {\n                    switch_off(",
            put: "if instruction.is_pulse && instruction.periods == 0 {\n                    switch_off(",
            killer: "permit-card",
        },
        Mutant {
            name: "the path moves with the layer",
            file: HEIGHT,
            find: "!self.layer.at_rest() && !self.layer.is_beside()",
            put: "false",
            killer: "permit-card",
        },
        Mutant {
            name: "the layer goes on with the cutter off",
            file: HEIGHT,
            find: "self.layer.is_beside() && is_lit)",
            put: "self.layer.is_beside())",
            killer: "permit-card",
        },
        Mutant {
            name: "a layer that is not kept is forgotten",
            file: HEIGHT,
            find: "*count += i64::from(layer);",
            put: "*count += 0;",
            killer: "permit-card",
        },
        Mutant {
            name: "the steps of the layer are not emitted",
            file: CARD,
            find: "*pulses += increment;",
            put: "*pulses += 0;",
            killer: "permit-card",
        },
        Mutant {
            name: "a sheet that is not found does not block motion",
            file: HEIGHT,
            find: "cause, place);\n        self.block = MotionBlock::CutterOff;",
            put: "cause, place);\n        self.block = MotionBlock::None;",
            killer: "permit-card",
        },
        Mutant {
            name: "a lost cutter stays on for one period more",
            file: PERMIT,
            find: "if inactive + 1 < proof.lost_periods =>",
            put: "if inactive < proof.lost_periods =>",
            killer: "permit_one_channel",
        },
        Mutant {
            name: "a cutter that was proven has to be proven again after a flicker",
            file: PERMIT,
            find: "Self::Proven { .. } if is_active => Self::Proven { inactive: 0 },",
            put: "Self::Proven { .. } if is_active => Self::UNPROVEN,",
            killer: "permit_one_channel",
        },
        Mutant {
            name: "a lost cutter does not block motion",
            file: PERMIT,
            find: "outcome.blocks |= is_lost ||",
            put: "outcome.blocks |= false ||",
            killer: "permit-outputs",
        },
        Mutant {
            name: "a closed epoch lets a channel burn",
            file: CARD,
            find: "None if !self.is_open || self.epoch_required => Some(CutterOffCause::EpochClosed),",
            put: "None if self.epoch_required => Some(CutterOffCause::EpochClosed),",
            killer: "permit-card",
        },
    ],
}];
