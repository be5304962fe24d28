//! Every cause that puts a cutter out, in every state of the cutter and at each of many phases of it, for three control
//! periods (CUT-4, CUT-6).
//!
//! Invariant: what is asserted of an output is what the card reports at the end of a period, which is what its pins
//! show in the next.

use crate::common;

use common::{DOOR, STOP, TestCard, UPPER_LIMIT, identity, levels, settings};
use retrace_core::{Flags, Rate, Record};
use retrace_link::{
    CardCore, CardStatus, CuttingChannel, CuttingSettings, HostCommand, InputWait, Instruction, MAX_CHANGES,
    OutputChange, RepeatedInstruction, channel,
};

const TORCH: u8 = channel::SPINDLE;
const JET: u8 = 3;
const WATCHDOG: u16 = 30;
const JET_GRACE: u16 = 50;
const HANDOVER: u16 = 10;
/// Phases of each state: periods since it began.
const PHASES: u32 = 1000;
/// Control periods in microseconds.
const PERIODS_US: [u32; 3] = [500, 1000, 2500];

/// What the cutter is doing.
#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    /// Its instruction waits for the proof.
    Igniting,
    Piercing,
    /// In motion.
    Cutting,
    /// A restart lights it again.
    Restarting,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Cause {
    Input(u16),
    HostIsSilent,
    Hold,
    Reverse,
    /// No record comes any more.
    RecordsEnd,
}

struct Bench {
    card: TestCard,
    levels: u16,
    is_silent: bool,
    is_fed: bool,
}

impl Bench {
    fn new(period_us: u32) -> Self {
        let mut card = TestCard::new(identity()).expect("a memory");
        let mut settings = settings(1, 0);
        (settings.period_us, settings.safe_count, settings.watchdog_periods) = (period_us, 0, WATCHDOG);
        let fires = |channel, standing_periods| CuttingChannel {
            channel,
            fires: true,
            standing_periods,
            lit_in_reverse: false,
            proof: None,
        };
        settings.cutting = CuttingSettings { count: 2, handover_periods: HANDOVER, ..CuttingSettings::default() };
        settings.cutting.channels[..2].copy_from_slice(&[fires(TORCH, 0), fires(JET, JET_GRACE)]);
        card.open(&settings).expect("fit");
        Self { card, levels: 0, is_silent: false, is_fed: true }
    }

    fn status(&self) -> CardStatus<2> {
        *self.card.status()
    }

    fn send(&mut self, command: HostCommand<2>) {
        self.card.accept(command).expect("it is taken");
    }

    fn period(&mut self) -> CardStatus<2> {
        if !self.is_silent {
            self.card.keep_alive();
        }
        while self.is_fed && self.status().high.since(self.status().place.record) < 20 {
            let record = Record { increments: [5, 0], flags: Flags::NONE, ..Record::default() };
            self.send(HostCommand::Ahead { place: self.status().high, record });
        }
        *self.card.run_period(levels(self.levels))
    }

    fn is_on(&self, channel: u8) -> bool {
        self.status().outputs[usize::from(channel)] != 0
    }

    fn change(channel: u8) -> [OutputChange; MAX_CHANGES] {
        let mut changes = [OutputChange::default(); MAX_CHANGES];
        changes[0] = OutputChange { channel, value: 1 };
        changes
    }

    /// Brings the cutter into this state, and stays in it for `phase` periods.
    fn enter(period_us: u32, channel: u8, state: State, phase: u32) -> Self {
        let mut bench = Self::new(period_us);
        bench.period();
        bench.send(HostCommand::rate(Rate::ONE / 4));
        let until = (state == State::Igniting).then(|| InputWait::new(5, true, 0));
        let periods = if state == State::Piercing { PHASES + 100 } else { 0 };
        let changes = Self::change(channel);
        let instruction = Instruction {
            number: 1,
            place: bench.status().place.record,
            periods,
            until,
            changes,
            count: 1,
            keeps_cutter: true,
            ..Instruction::default()
        };
        bench.send(HostCommand::Instruction(instruction));
        bench.period();
        if state == State::Restarting {
            bench.period();
            bench.send(HostCommand::rate(Rate::ZERO));
            while !bench.period().at_rest || bench.is_on(channel) {}
            bench.send(HostCommand::rate(Rate::ONE / 4));
            bench.send(HostCommand::Restart { last: 1 });
            let repeat = RepeatedInstruction { number: 1, changes, count: 1, ..RepeatedInstruction::default() };
            bench.send(HostCommand::Repeat(RepeatedInstruction { periods: PHASES + 100, ..repeat }));
            bench.period();
        }
        for _ in 0..phase {
            bench.period();
        }
        assert!(bench.is_on(channel), "{state:?} after {phase}");
        bench
    }

    /// Applies a cause; returns the periods until the cutter is off, from the cause on, or from the rest after it.
    fn periods_until_off(&mut self, channel: u8, cause: Cause) -> u32 {
        match cause {
            Cause::Input(level) => self.levels = level,
            Cause::HostIsSilent => self.is_silent = true,
            Cause::Hold => self.send(HostCommand::rate(Rate::ZERO)),
            Cause::Reverse => self.send(HostCommand::rate(-Rate::ONE)),
            Cause::RecordsEnd => self.is_fed = false,
        }
        let mut periods = 0;
        for _ in 0..500 {
            let status = self.period();
            let counts = !matches!(cause, Cause::Hold | Cause::RecordsEnd) || status.at_rest;
            periods += u32::from(counts);
            assert!(status.rate >= Rate::ZERO || !self.is_on(channel), "on with the path running backward");
            if !self.is_on(channel) {
                return periods;
            }
        }
        panic!("it stays on: {cause:?}");
    }
}

/// The longest number of periods; `None` where the cause does not put out in this state.
fn longest(channel: u8, state: State, cause: Cause) -> Option<u32> {
    let grace = if channel == JET { u32::from(JET_GRACE) } else { 0 };
    let is_in_hand = state != State::Cutting;
    match cause {
        // in the period that samples it
        Cause::Input(_) => Some(1),
        Cause::HostIsSilent => Some(u32::from(WATCHDOG) + 2),
        // an instruction that needs the cutter is in hand
        Cause::Hold | Cause::Reverse | Cause::RecordsEnd if is_in_hand => None,
        // the period of the rest, and one more
        Cause::Hold => Some(grace + 2),
        Cause::RecordsEnd => Some(grace + u32::from(HANDOVER) + 2),
        // before the rate is negative, which is asserted in every period
        Cause::Reverse => Some(500),
    }
}

#[test]
fn every_cause_puts_out_in_every_state_at_every_phase() {
    let causes = [
        Cause::Input(STOP),
        Cause::Input(DOOR),
        Cause::Input(UPPER_LIMIT),
        Cause::HostIsSilent,
        Cause::Hold,
        Cause::Reverse,
        Cause::RecordsEnd,
    ];
    let wanted: u32 = std::env::var("RETRACE_CASES").ok().and_then(|text| text.parse().ok()).unwrap_or(20);
    let (mut cases, mut worst) = (0, std::collections::BTreeMap::new());
    for period_us in PERIODS_US {
        for channel in [TORCH, JET] {
            for state in [State::Igniting, State::Piercing, State::Cutting, State::Restarting] {
                for cause in causes {
                    let Some(longest) = longest(channel, state, cause) else { continue };
                    for phase in (0..PHASES).step_by((PHASES / wanted.clamp(1, PHASES)) as usize) {
                        let mut bench = Bench::enter(period_us, channel, state, phase);
                        let periods = bench.periods_until_off(channel, cause);
                        assert!(
                            periods <= longest,
                            "{period_us} us, channel {channel}, {state:?}, {cause:?}, phase {phase}: {periods} periods"
                        );
                        (bench.levels, bench.is_silent, bench.is_fed) = (0, false, true);
                        for _ in 0..20 {
                            bench.period();
                            assert!(!bench.is_on(channel), "{state:?}, {cause:?}, {phase}: on again");
                        }
                        let entry: &mut u32 = worst.entry(format!("{cause:?} {channel}")).or_default();
                        (cases, *entry) = (cases + 1, periods.max(*entry));
                    }
                }
            }
        }
    }
    println!("{cases} cases; longest in periods {worst:?}");
}
