//! Any words, inputs and silences in any order: what holds of a card whatever is done to it.
//!
//! Invariant: the witness reckons positions, order and safety from the reports alone, with code of its own.

use crate::common;

use common::{DOOR, HOME, LOWER_LIMIT, PLAIN, PULSE, STOP, STOPS_WITHIN, TestCard, UPPER_LIMIT};
use common::{identity, moved, rates, record, rests_before, settings};
use proptest::prelude::*;
use retrace_card::{Edge, InputLevels, StepDirection};
use retrace_core::{Distance, Flags, Place, Rate, RateTarget, Record, RecordIndex};
use retrace_link::{
    Alarm, CardCore, CardSettings, CardStatus, CommandRefusal, CutterOffCause, CuttingChannel, CuttingSettings,
    HomingCommand, HostCommand, InputWait, Instruction, OutputAction, OutputChange, RepeatedInstruction, channel,
};

/// The cutting channels: a torch, a jet that may be on in reverse, and an auxiliary one.
const CUTTING: [CuttingChannel; 3] = [
    CuttingChannel { channel: 3, fires: true, standing_periods: 0, lit_in_reverse: false, proof: None },
    CuttingChannel { channel: 4, fires: true, standing_periods: 7, lit_in_reverse: true, proof: None },
    CuttingChannel { channel: 6, fires: false, standing_periods: 0, lit_in_reverse: false, proof: None },
];
const HANDOVER: u16 = 5;

/// Settings with these cutting channels; a dry run where the number of the epoch is a multiple of eight.
fn cutting_settings(epoch: u16, start: u32) -> CardSettings<2> {
    let mut cutting = CuttingSettings { count: 3, handover_periods: HANDOVER, ..CuttingSettings::default() };
    cutting.channels[..3].copy_from_slice(&CUTTING);
    cutting.inhibit = epoch.is_multiple_of(8);
    CardSettings { cutting, ..settings(epoch, start) }
}

/// What may be done between two periods.
#[derive(Debug, Clone)]
enum HostStep {
    Ahead(u32),
    Behind(u32),
    Rate(RateTarget),
    Instruct { after: u32, number: u32, periods: u32, at_most: Option<u32>, lights: Lights },
    Repeat { number: u32, channel: u8, value: i32, periods: u32, at_most: Option<u32> },
    Restart(u32),
    Close,
    Act { after: u32, channel: u8, after_value: i32 },
    ByHand(u8, i32),
    Replay(bool),
    Trim(u32),
    Forget(u32),
    Clear,
    Open(u32),
    Home { upper: bool, fast: i64, slow: i64 },
    TooFast(i16),
    Periods { count: u32, levels: u16, failed: bool, keep_alive: bool },
}

/// What an instruction does to a cutting channel besides, and whether it needs the cutter.
#[derive(Debug, Clone, Copy)]
struct Lights {
    channel: u8,
    value: i32,
    keeps: bool,
}

/// Any but the one that shows instructions.
fn any_channel() -> impl Strategy<Value = u8> {
    let others = any::<u8>().prop_filter("shows instructions", |&c| c != channel::SPEED);
    prop_oneof![Just(3u8), Just(4u8), others]
}

fn steps() -> impl Strategy<Value = Vec<HostStep>> {
    let rate = prop_oneof![
        Just(Rate::ONE),
        Just(-Rate::ONE),
        Just(Rate::ZERO),
        Just(Rate::ONE / 3),
        Just(Rate::ONE * 4),
        rates(-9, 9),
        any::<i64>().prop_map(Rate::from_units)
    ];
    // most of the time nothing is wrong
    let levels = prop_oneof![
        40 => Just(0u16), 6 => Just(PLAIN), 1 => Just(DOOR), 1 => Just(STOP), 1 => Just(UPPER_LIMIT),
        1 => Just(LOWER_LIMIT), 2 => Just(HOME), 1 => any::<u16>(),
    ];
    let failed = prop_oneof![40 => Just(false), 1 => Just(true)];
    let keep_alive = prop_oneof![30 => Just(true), 1 => Just(false)];
    let periods = (1u32..40, levels, failed, keep_alive)
        .prop_map(|(count, levels, failed, keep_alive)| HostStep::Periods { count, levels, failed, keep_alive });
    let at_most = prop_oneof![2 => Just(None), 1 => Just(Some(0u32)), 1 => (1u32..30).prop_map(Some)];
    let instruct = (
        prop_oneof![1 => Just(0u32), 1 => 0u32..40],
        prop_oneof![9 => Just(1u32), 1 => 0u32..4],
        prop_oneof![Just(0u32), 0u32..20],
        at_most.clone(),
        (3u8..5, 0i32..2, any::<bool>()).prop_map(|(channel, value, keeps)| Lights { channel, value, keeps }),
    )
        .prop_map(|(after, number, periods, at_most, lights)| HostStep::Instruct {
            after,
            number,
            periods,
            at_most,
            lights,
        });
    let number = prop_oneof![6 => Just(1u32), 1 => 0u32..4];
    let repeat = (number, prop_oneof![3 => 3u8..7, 1 => any_channel()], 0i32..2, 0u32..12, at_most).prop_map(
        |(number, channel, value, periods, at_most)| HostStep::Repeat { number, channel, value, periods, at_most },
    );
    let act = (0u32..30, any_channel(), 0i32..3).prop_map(|(after, channel, after_value)| HostStep::Act {
        after,
        channel,
        after_value,
    });
    let home = (any::<bool>(), 1..PULSE * 9, 1..PULSE * 2).prop_map(|(upper, fast, slow)| HostStep::Home {
        upper,
        fast,
        slow,
    });
    let step = prop_oneof![
        6 => (1u32..50).prop_map(HostStep::Ahead),
        2 => (1u32..50).prop_map(HostStep::Behind),
        3 => rate.clone().prop_map(RateTarget::both).prop_map(HostStep::Rate),
        1 => (rate.clone(), 0..=16i64)
            .prop_map(|(feed, part)| HostStep::Rate(RateTarget { feed, rapid: feed / 16 * part })),
        1 => (0..=16i64, rate.clone())
            .prop_map(|(part, rapid)| HostStep::Rate(RateTarget { feed: rapid / 16 * part, rapid })),
        1 => (rate.clone(), rate.clone()).prop_map(|(feed, rapid)| HostStep::Rate(RateTarget { feed, rapid })),
        4 => instruct,
        3 => repeat,
        3 => prop_oneof![7 => Just(0u32), 1 => 1u32..3].prop_map(HostStep::Restart),
        1 => Just(HostStep::Close),
        2 => act,
        2 => (any_channel(), 0i32..3).prop_map(|(c, v)| HostStep::ByHand(c, v)),
        1 => any::<bool>().prop_map(HostStep::Replay),
        1 => (0u32..50).prop_map(HostStep::Trim),
        1 => (0u32..50).prop_map(HostStep::Forget),
        3 => Just(HostStep::Clear),
        1 => any::<u32>().prop_map(HostStep::Open),
        1 => home,
        1 => (-280i16..280).prop_map(HostStep::TooFast),
        12 => periods,
    ];
    prop::collection::vec(step, 1..200)
}

/// What is known of a card from outside.
struct Witness {
    card: TestCard,
    epoch: u16,
    start: u32,
    /// The counts at the start of the epoch.
    base: [i64; 2],
    /// What was seen at the pins, without the jumps that homing makes.
    pulses: [i64; 2],
    outputs: [StepDirection; 2],
    /// Homing has begun since the epoch did.
    homed: bool,
    /// The instruction that was taken last and is not executed.
    instruction: Option<Instruction>,
    /// The place of the last instruction that is not executed, whatever became of it.
    barrier: Option<RecordIndex>,
    /// The period after which it began.
    begun: Option<u64>,
    /// The value that the next instruction is known by.
    mark: i32,
    /// Periods since the alarm that is latched.
    alarmed: u32,
    /// A rate was taken since the last alarm.
    rated: bool,
    cutting: CuttingWitness,
    /// Latched, executed and begun so often: the campaign must not be empty.
    seen: Seen,
}

#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    alarms: u32,
    cleared: u32,
    executed: u32,
    homed: u32,
    moved: u32,
    stood_for_an_instruction: u32,
    lit: u32,
    lit_backward: u32,
    put_out: u32,
    blocked: u32,
    repeated: u32,
    starts_cancelled: u32,
}

/// What is known of the cutting channels from the words and the reports.
#[derive(Clone, Debug, Default)]
struct CuttingWitness {
    closed: bool,
    off_the_path: bool,
    inhibit: bool,
    replay: bool,
    /// Periods since the host was heard of.
    silent: u32,
    /// The rate that was taken last.
    target: Rate,
    /// A restart was taken, and the last of its repeats is not complete.
    restarting: bool,
    /// The repeat that was taken and is not complete.
    repeat: Option<RepeatedInstruction>,
    /// Actions of the epoch.
    actions: Vec<OutputAction>,
    /// A word or an instruction may have lit the channel since the last period.
    asked: [bool; 2],
    stood: [Stood; 2],
}

/// Periods that a channel was on, at rest, without an instruction that needs it.
#[derive(Clone, Copy, Debug, Default)]
struct Stood {
    at_rate_0: u32,
    waiting: u32,
}

impl Witness {
    fn new(start: u32) -> Self {
        let mut card = TestCard::new(identity()).expect("a memory");
        card.open(&cutting_settings(1, start)).expect("fit");
        let timing = card.settings().expect("opened").timing();
        let outputs = [StepDirection::new(timing), StepDirection::new(timing)];
        Self {
            card,
            epoch: 1,
            start,
            base: [0; 2],
            pulses: [0; 2],
            outputs,
            homed: false,
            instruction: None,
            barrier: None,
            begun: None,
            mark: 1000,
            alarmed: 0,
            rated: false,
            cutting: CuttingWitness::default(),
            seen: Seen::default(),
        }
    }

    fn status(&self) -> CardStatus<2> {
        *self.card.status()
    }

    /// Hands a word over; a refused one changes nothing but what it latches.
    fn send(&mut self, command: HostCommand<2>) -> bool {
        let before = self.status();
        let taken = self.card.accept(command);
        let mut after = self.status();
        if taken.is_err() {
            let too_fast = matches!(after.alarm, Some(Alarm::TooManyPulses { .. })) && before.alarm.is_none();
            if too_fast {
                assert_eq!(taken, Err(CommandRefusal::Unsupported));
                (after.alarm, after.outputs) = (before.alarm, before.outputs);
            }
            assert_eq!(before, after, "{command:?} was refused and changed the report");
        }
        self.follow_alarm();
        taken.is_ok()
    }

    fn step(&mut self, step: &HostStep) {
        let status = self.status();
        match *step {
            HostStep::Ahead(count) => {
                for n in 0..count {
                    let place = status.high + n;
                    self.send(HostCommand::Ahead { place, record: record(place.number()) });
                }
            }
            HostStep::Behind(count) => {
                for n in 1..=count {
                    let place = status.low - n;
                    if place == RecordIndex::new(self.start.wrapping_sub(1)) {
                        break;
                    }
                    let rests = rests_before(place.number(), self.start);
                    self.send(HostCommand::Behind { place, record: record(place.number()), rests });
                }
            }
            HostStep::Rate(target) => {
                let taken = self.send(HostCommand::Rate(target));
                self.rated |= taken && target != RateTarget::ZERO;
                if taken {
                    self.cutting.target = target.faster();
                }
            }
            HostStep::Instruct { after, number, periods, at_most, lights } => {
                self.instruct(after, number, periods, at_most, lights);
            }
            HostStep::Repeat { number, channel, value, periods, at_most } => {
                self.repeat(number, OutputChange { channel, value }, periods, at_most);
            }
            HostStep::Restart(last) => {
                let last = status.repeated.wrapping_add(last);
                if self.send(HostCommand::Restart { last }) {
                    assert_eq!(self.status().blocked, last != status.repeated);
                    self.cutting.restarting = self.status().blocked;
                }
            }
            HostStep::Close => {
                if self.card.close().is_ok() {
                    self.cutting.closed = true;
                    assert_eq!((self.value(0), self.value(1)), (0, 0), "lit behind a closing");
                }
            }
            HostStep::Act { after, channel, after_value } => {
                let place = status.place.record + after;
                let action = OutputAction { place, channel, before: i32::from(after_value == 0), after: after_value };
                if self.send(HostCommand::Action(action)) {
                    self.cutting.actions.push(action);
                }
            }
            HostStep::ByHand(channel, value) => {
                if self.send(HostCommand::ManualOutput(OutputChange { channel, value })) {
                    self.asks(OutputChange { channel, value });
                    if value == 0 && CUTTING.iter().any(|of| of.channel == channel && of.fires) {
                        self.cancel_start(channel);
                    }
                }
            }
            HostStep::Replay(on) => {
                if self.send(HostCommand::Replay { on }) {
                    self.cutting.replay = on;
                }
            }
            HostStep::Trim(n) => {
                self.send(HostCommand::Trim { high: (status.high - n) });
            }
            HostStep::Forget(n) => {
                self.send(HostCommand::Forget { low: (status.low + n) });
            }
            HostStep::Clear => self.clear(),
            HostStep::Open(start) => self.open(start),
            HostStep::Home { upper, fast, slow } => {
                let order = HomingCommand {
                    axis: 0,
                    upper,
                    search_speed: fast,
                    latch_speed: slow,
                    acceleration: PULSE / 5,
                    max_travel: 60,
                    count: 77,
                };
                let taken = self.send(HostCommand::Home(order));
                assert!(!taken || status.at_rest && status.low == status.high && status.alarm.is_none());
                self.homed |= taken;
                self.cutting.off_the_path |= taken;
                self.seen.homed += u32::from(taken);
            }
            HostStep::TooFast(increment) => {
                let record = Record { increments: [increment, 1], ..Record::default() };
                if increment.unsigned_abs() > 246 {
                    assert!(!self.send(HostCommand::Ahead { place: status.high, record }));
                }
            }
            HostStep::Periods { count, levels, failed, keep_alive } => {
                for _ in 0..count {
                    if keep_alive {
                        self.keep_alive();
                    }
                    self.period(levels, failed);
                }
            }
        }
    }

    fn keep_alive(&mut self) {
        self.card.keep_alive();
        self.cutting.silent = 0;
    }

    fn value(&self, index: usize) -> i32 {
        self.status().outputs[usize::from(CUTTING[index].channel)]
    }

    /// This change was taken.
    fn asks(&mut self, change: OutputChange) {
        for (of, asked) in CUTTING.iter().zip(&mut self.cutting.asked) {
            *asked |= change.channel == of.channel && change.value != 0;
        }
    }

    fn repeat(&mut self, number: u32, change: OutputChange, periods: u32, at_most: Option<u32>) {
        let status = self.status();
        let number = status.repeated.wrapping_add(number);
        let until = at_most.map(|at_most| InputWait::new(5, true, at_most));
        let mut repeated = RepeatedInstruction { number, periods, until, count: 1, ..RepeatedInstruction::default() };
        repeated.changes[0] = change;
        if self.send(HostCommand::Repeat(repeated)) {
            assert!(status.at_rest && status.alarm.is_none() && number == status.repeated.wrapping_add(1));
            self.asks(change);
            self.cutting.repeat = (self.status().repeated != number).then_some(repeated);
            self.seen.repeated += 1;
        }
    }

    /// No cutting output is on without the permit, and none is lit by anything but what may light it.
    fn check_cutting(&mut self, before: &CardStatus<2>, now: &CardStatus<2>, kept: bool) {
        self.cutting.silent += 1;
        self.seen.blocked += u32::from(now.blocked);
        self.seen.put_out += u32::from(now.cutter_off.is_some());
        for (index, of) in CUTTING[..2].iter().enumerate() {
            let channel = usize::from(of.channel);
            let (was, is) = (before.outputs[channel] != 0, now.outputs[channel] != 0);
            let witness = &mut self.cutting;
            let asked = std::mem::take(&mut witness.asked[index]);
            if let Some(off) = now.cutter_off
                && off.channels >> index & 1 == 1
            {
                // an opening may be followed at once by what lights again
                let opened = matches!(off.cause, CutterOffCause::EpochOpened | CutterOffCause::EpochClosed);
                assert!(!is || opened, "reported off");
            }
            if !is {
                witness.stood[index] = Stood::default();
                continue;
            }
            self.seen.lit += 1;
            self.seen.lit_backward += u32::from(now.rate < Rate::ZERO);
            assert!(
                !witness.closed && !witness.off_the_path && !witness.inhibit,
                "lit without an epoch, or in a dry run"
            );
            assert!(now.alarm.is_none() && witness.silent < 30, "lit under an alarm or without a host");
            assert!(of.lit_in_reverse || now.rate >= Rate::ZERO, "lit in reverse");
            if !was && !asked {
                let passed = witness.actions.iter().any(|action| {
                    let at = Place::start_of(action.place);
                    let lights = action.channel == of.channel && action.after != 0;
                    let forward =
                        before.place.distance_to(at) >= Distance::ZERO && at.distance_to(now.place) > Distance::ZERO;
                    let first = lights && forward && before.reached.since(action.place) as i32 <= 0;
                    let backward =
                        now.place.distance_to(at) >= Distance::ZERO && at.distance_to(before.place) > Distance::ZERO;
                    let again = lights && forward || action.channel == of.channel && action.before != 0 && backward;
                    first || again && witness.replay && of.lit_in_reverse
                });
                assert!(passed, "nothing lit channel {channel}");
            }
            let waits = witness.target != Rate::ZERO && !(before.blocked && now.blocked) || witness.restarting;
            let stood = &mut witness.stood[index];
            if !before.at_rest || now.rate != Rate::ZERO || kept || (asked && !was) {
                *stood = Stood::default();
            } else if waits {
                stood.waiting += 1;
            } else {
                stood.at_rate_0 += 1;
            }
            let grace = u32::from(of.standing_periods);
            assert!(stood.at_rate_0 <= grace, "channel {channel} stood: {stood:?}");
            assert!(
                stood.at_rate_0 + stood.waiting <= grace + u32::from(HANDOVER),
                "channel {channel} stood: {stood:?}"
            );
        }
        if now.rate < Rate::ZERO {
            assert_eq!(before.outputs[usize::from(CUTTING[0].channel)], 0, "lit in the period before");
        }
        assert!(!self.cutting.inhibit || now.outputs[6] == 0, "an auxiliary channel in a dry run");
        if before.blocked && now.blocked && before.at_rest {
            assert_eq!(now.rate, Rate::ZERO, "motion while blocked");
        }
        if now.repeated != before.repeated || now.alarm.is_some() {
            self.cutting.repeat = None;
        }
        self.cutting.restarting &= now.blocked;
    }

    fn instruct(&mut self, after: u32, number: u32, periods: u32, at_most: Option<u32>, lights: Lights) {
        let status = self.status();
        let place = status.place.boundary_ahead() + after;
        let number = status.executed.wrapping_add(number);
        let until = at_most.map(|at_most| InputWait::new(5, true, at_most));
        let keeps_cutter = lights.keeps;
        let mut instruction =
            Instruction { number, place, periods, until, count: 2, keeps_cutter, ..Instruction::default() };
        instruction.changes[1] = OutputChange { channel: lights.channel, value: lights.value };
        // so that its beginning is seen at the outputs; the speed is not among the safe ones
        instruction.changes[0] = OutputChange { channel: channel::SPEED, value: self.mark };
        self.mark += 1;
        let taken = self.send(HostCommand::Instruction(instruction));
        assert!(!taken || self.instruction.is_none() && number == status.executed.wrapping_add(1));
        if taken {
            (self.instruction, self.begun, self.barrier) = (Some(instruction), None, Some(place));
            self.watch_instruction(status.period, status.place);
            if self.begun.is_some() || self.instruction.is_none() {
                self.asks(instruction.changes[1]);
            }
        }
    }

    /// A cutter that is switched off by hand is not lit by what was to light it; the place stays barred.
    fn cancel_start(&mut self, channel: u8) {
        let is_on = |changes: &[OutputChange]| changes.iter().any(|c| c.channel == channel && c.value != 0);
        let instruction = self.instruction.is_some_and(|instruction| is_on(instruction.changes()));
        if instruction || self.cutting.repeat.is_some_and(|repeat| is_on(repeat.changes())) {
            (self.instruction, self.begun, self.cutting.repeat) = (None, None, None);
            self.seen.starts_cancelled += 1;
        }
    }

    fn clear(&mut self) {
        let before = self.status();
        if self.send(HostCommand::ClearAlarm) && before.alarm.is_some() {
            assert!(before.at_rest && self.status().alarm.is_none());
            assert_eq!(before.inputs & STOP, 0, "cleared beside an open chain");
            (self.rated, self.alarmed) = (false, 0);
            self.seen.cleared += 1;
        }
    }

    fn open(&mut self, start: u32) {
        let before = self.status();
        let epoch = self.epoch.wrapping_add(1).max(1);
        if self.card.open(&cutting_settings(epoch, start)).is_ok() {
            assert_eq!((self.value(0), self.value(1)), (0, 0), "lit behind an opening");
            let inhibit = epoch.is_multiple_of(8);
            self.cutting = CuttingWitness { inhibit, ..CuttingWitness::default() };
            let status = self.status();
            assert!(before.at_rest && before.counts == status.counts && before.alarm == status.alarm);
            (self.epoch, self.start, self.base, self.homed) = (epoch, start, status.counts, false);
            (self.instruction, self.begun, self.barrier, self.rated) = (None, None, None, false);
        } else {
            assert_eq!(before, self.status());
        }
        self.follow_alarm();
    }

    fn follow_alarm(&mut self) {
        let alarm = self.status().alarm;
        if alarm.is_some() && self.alarmed == 0 {
            (self.alarmed, self.instruction, self.begun, self.rated) = (1, None, None, false);
            (self.cutting.target, self.cutting.repeat) = (Rate::ZERO, None);
            self.seen.alarms += 1;
        }
    }

    fn period(&mut self, levels: u16, failed: bool) {
        let before = self.status();
        let kept = self.cutting.repeat.is_some()
            || self.begun.is_some() && self.instruction.is_some_and(|instruction| instruction.keeps_cutter);
        let lights = self.instruction;
        let begun = self.begun.is_some();
        self.card.run_period(InputLevels { levels, encoder: 0, failed, ..InputLevels::default() });
        let now = self.status();
        assert_eq!(now.period, before.period + 1);
        self.check_pulses(&before, &now);
        self.check_path(&before, &now);
        self.check_instruction(&before, &now);
        let begins = !begun && (self.begun.is_some() || lights.is_some_and(|of| of.number == now.executed));
        assert!(!(begins && before.blocked && now.blocked), "begun while blocked");
        if let Some(of) = lights.filter(|_| begins) {
            self.asks(of.changes[1]);
        }
        self.check_cutting(&before, &now, kept || begins && lights.is_some_and(|of| of.keeps_cutter));
        assert!(
            self.barrier.is_none_or(
                |place| now.place.distance_to(Place::start_of(RecordIndex::new(place.number()))) >= Distance::ZERO
            ),
            "passed"
        );
        self.check_alarm(&before, &now, levels);
        let moves = now.increments != [0; 2];
        self.seen.moved += u32::from(moves);
    }

    /// What comes out of the pins is what is reported.
    fn check_pulses(&mut self, before: &CardStatus<2>, now: &CardStatus<2>) {
        for axis in 0..2 {
            let increment = now.increments[axis];
            self.outputs[axis].begin_period(increment).expect("a card never asks for more than a period holds");
            let rises = self.outputs[axis].edges().filter(|(_, edge)| *edge == Edge::Rise).count();
            assert_eq!(rises, increment.unsigned_abs() as usize);
            self.pulses[axis] += i64::from(increment);
        }
        let ended = self.homed && !before.at_rest && now.at_rest;
        let added: [i64; 2] = std::array::from_fn(|axis| before.counts[axis] + i64::from(now.increments[axis]));
        assert!(now.counts == added || ended && now.counts[1] == added[1], "counts without pulses");
    }

    /// Counts are P(place), and the cursor stays on what is held.
    fn check_path(&self, before: &CardStatus<2>, now: &CardStatus<2>) {
        assert!(
            Place::start_of(now.low).distance_to(now.place) >= Distance::ZERO
                && now.place.distance_to(Place::start_of(now.high)) >= Distance::ZERO
        );
        assert_eq!(before.place.distance_to(now.place), now.rate.over(1));
        if self.homed {
            assert_eq!((now.rate, now.place), (Rate::ZERO, before.place));
            assert!(now.increments[1] == 0 && now.increments[0].abs() <= 9);
            return;
        }
        let walked = moved(self.start, now.place);
        assert_eq!(now.counts, [self.base[0] + walked[0], self.base[1] + walked[1]], "off the path");
        assert!(!now.at_rest || now.rate == Rate::ZERO || now.place.fraction == 0 || before.rate != Rate::ZERO);
    }

    /// Has the instruction begun, after period `after`, or come to its end?
    fn watch_instruction(&mut self, after: u64, place: Place) {
        let status = self.status();
        let Some(instruction) = self.instruction else { return };
        let shows = status.outputs[usize::from(channel::SPEED)] == instruction.changes[0].value;
        if shows && self.begun.is_none() {
            assert_eq!(place, Place::start_of(instruction.place), "begun somewhere else");
            self.begun = Some(after);
        }
        if status.executed == instruction.number {
            let begun = self.begun.expect("executed without a beginning");
            let least = u64::from(instruction.periods).max(u64::from(instruction.until.is_some()));
            let passed = status.period - begun;
            // one without any time begins and ends before the period's motion
            let in_time = passed == least || instruction.until.is_some() || (least == 0 && passed == 1);
            assert!(passed >= least && in_time, "not its time: {passed}");
            (self.instruction, self.begun, self.barrier) = (None, None, None);
            self.seen.executed += 1;
        }
    }

    /// Nothing passes an instruction, and nothing moves while one is executed.
    fn check_instruction(&mut self, before: &CardStatus<2>, now: &CardStatus<2>) {
        let Some(instruction) = self.instruction else { return };
        let stood = self.begun.is_some();
        self.watch_instruction(before.period, before.place);
        if stood || self.begun.is_some() {
            assert_eq!((now.increments, now.rate), ([0; 2], Rate::ZERO), "motion beside an instruction");
            self.seen.stood_for_an_instruction += 1;
        }
        if now.executed != instruction.number {
            assert_eq!(now.executed, before.executed);
        }
    }

    fn check_alarm(&mut self, before: &CardStatus<2>, now: &CardStatus<2>, levels: u16) {
        if levels & STOP != 0 {
            assert!(now.alarm.is_some(), "the chain is open");
        }
        if levels & DOOR != 0 && now.alarm.is_none() {
            assert_eq!(now.increments, [0; 2], "motion beside an open door");
        }
        if now.alarm.is_some() {
            assert_eq!(before.alarm.or(now.alarm), now.alarm, "the first cause is kept");
            assert_eq!((now.outputs[3], now.outputs[usize::from(channel::SPINDLE)]), (0, 0), "not safe");
            if before.at_rest && before.alarm.is_some() {
                assert_eq!((now.increments, now.at_rest), ([0; 2], true), "motion under an alarm");
            }
            self.follow_alarm();
            // a search has a ramp of its own: 9 pulses a period, changed by a fifth of a pulse
            let within = if self.homed { 46 } else { STOPS_WITHIN };
            assert!(self.alarmed <= within + 1 || now.at_rest, "not at rest in time");
            self.alarmed += 1;
        } else {
            assert!(before.alarm.is_none(), "an alarm went by itself");
            if before.at_rest && !self.rated && !self.homed {
                assert_eq!(now.increments, [0; 2], "motion without a word");
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Counts, path, order and safety, whatever is done.
    #[test]
    fn holds_whatever_is_done(start in any::<u32>(), steps in steps()) {
        let mut witness = Witness::new(start);
        for step in &steps {
            witness.step(step);
        }
        // whatever was done: once nothing is wrong it can be opened and run again
        for _ in 0..700 {
            witness.keep_alive();
            witness.period(0, false);
            witness.step(&HostStep::Rate(RateTarget::ZERO));
        }
        witness.clear();
        prop_assert_eq!(witness.status().alarm, None);
        witness.open(start);
        prop_assert!(witness.status().low == RecordIndex::new(start) && witness.status().executed == 0);
        witness.step(&HostStep::Ahead(16));
        witness.step(&HostStep::Rate(RateTarget::both(Rate::ONE)));
        let end = (start | 15).wrapping_add(1).wrapping_sub(start).min(16);
        for _ in 0..60 {
            witness.keep_alive();
            witness.period(0, false);
        }
        let executed = Place::start_of(RecordIndex::new(start)).distance_to(witness.status().place);
        prop_assert!(executed >= Distance::records(end.into()));
    }
}

/// The campaign meets what it is about.
#[test]
fn the_deeds_are_not_empty() {
    use proptest::strategy::ValueTree;
    use proptest::test_runner::TestRunner;
    let (mut runner, mut all) = (TestRunner::deterministic(), Seen::default());
    // a closed epoch asks for no rate any more, so that some of what is drawn moves less
    for _ in 0..360 {
        let steps = steps().new_tree(&mut runner).expect("drawn").current();
        let mut witness = Witness::new(5);
        for step in &steps {
            witness.step(step);
        }
        let seen = witness.seen;
        all.alarms += seen.alarms;
        all.cleared += seen.cleared;
        all.executed += seen.executed;
        all.homed += seen.homed;
        all.lit += seen.lit;
        all.lit_backward += seen.lit_backward;
        all.put_out += seen.put_out;
        all.blocked += seen.blocked;
        all.repeated += seen.repeated;
        all.starts_cancelled += seen.starts_cancelled;
        all.moved += seen.moved;
        all.stood_for_an_instruction += seen.stood_for_an_instruction;
    }
    println!("{all:?}");
    assert!(all.alarms > 300 && all.cleared > 200 && all.executed > 100 && all.homed > 30, "{all:?}");
    assert!(all.moved > 20_000 && all.stood_for_an_instruction > 2000, "{all:?}");
    assert!(all.lit > 5000 && all.lit_backward > 50 && all.put_out > 150, "{all:?}");
    assert!(all.blocked > 5000 && all.repeated > 300 && all.starts_cancelled > 20, "{all:?}");
    assert!(record(15).flags.contains(Flags::REST));
}
