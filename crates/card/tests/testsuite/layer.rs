//! The layer: moves over the sheet in instructions, and the search for the sheet (CUT-13, CUT-15).
//!
//! Invariant: the sheet is where the axis has really moved to, counted from the pulses that the card emits.

use crate::common;

use common::{PLAIN, STOP, TestCard, identity, levels, settings};
use proptest::prelude::*;
use retrace_card::{LayerDrive, LayerProgress};
use retrace_core::limits::PulseLimits;
use retrace_core::{Flags, Place, Rate, Record, RecordIndex};
use retrace_link::{
    Alarm, CardCore, CardSettings, CardStatus, CommandRefusal, CutterOffCause, CuttingChannel, CuttingSettings,
    HeightControlSettings, HostCommand, InputSetting, Instruction, LayerMove, LayerSettings, MAX_CHANGES, MAX_LAYER,
    OhmicSensing, OutputChange, PathStart, RepeatedInstruction, SheetSource, channel,
};

pub(crate) const TORCH: u8 = channel::SPINDLE;
/// The input of the float switch.
pub(crate) const FLOAT: u16 = PLAIN;
/// The tool axis.
pub(crate) const Z: usize = 1;
const PULSE: u64 = 1 << 32;

/// The ohmic contact, where a test uses it.
const OHMIC: u16 = 1 << 2;

pub(crate) const SETTINGS: LayerSettings =
    LayerSettings { axis: Z as u8, contacts: FLOAT, probe_speed: 4 << 16, latch_speed: 1 << 14 };

pub(crate) fn layer_settings(epoch: u16) -> CardSettings<2> {
    let mut settings = settings(epoch, 0);
    let torch =
        CuttingChannel { channel: TORCH, fires: true, standing_periods: 50, lit_in_reverse: false, proof: None };
    settings.cutting = CuttingSettings { count: 1, handover_periods: 10, ..CuttingSettings::default() };
    settings.cutting.channels[0] = torch;
    settings.layer = Some(SETTINGS);
    settings
}

/// A card whose tool axis stands over a sheet.
pub(crate) struct Table {
    pub(crate) card: TestCard,
    /// Position of the tool axis where the float switch closes; `None` without a sheet.
    sheet: Option<i64>,
    /// Position where the ohmic contact closes, if it does.
    tip: Option<i64>,
    pub(crate) position: i64,
    pub(crate) levels: u16,
    pub(crate) is_silent: bool,
    /// Reading of analog input 1.
    pub(crate) reading: Option<u16>,
    /// Increments of the tool axis.
    pub(crate) increments: Vec<i64>,
    /// Positions at which the torch was on.
    lit_at: Vec<i64>,
}

impl Table {
    pub(crate) fn new(sheet: Option<i64>) -> Self {
        Self::with(sheet, &layer_settings(1))
    }

    pub(crate) fn with(sheet: Option<i64>, settings: &CardSettings<2>) -> Self {
        let mut card = TestCard::new(identity()).expect("a memory");
        card.open(settings).expect("fit");
        let (increments, lit_at) = (Vec::new(), Vec::new());
        let mut table = Self {
            card,
            sheet,
            tip: None,
            position: 0,
            levels: 0,
            is_silent: false,
            reading: None,
            increments,
            lit_at,
        };
        for place in 0..20 {
            let flags = if place % 20 == 19 { Flags::REST } else { Flags::NONE };
            let record = Record { increments: [5, 0], flags, ..Record::default() };
            table.send(HostCommand::Ahead { place: RecordIndex::new(place), record });
        }
        table
    }

    pub(crate) fn status(&self) -> CardStatus<2> {
        *self.card.status()
    }

    pub(crate) fn send(&mut self, command: HostCommand<2>) {
        self.card.accept(command).expect("it is accepted");
    }

    pub(crate) fn period(&mut self) -> CardStatus<2> {
        if !self.is_silent {
            self.card.keep_alive();
        }
        let touches = self.sheet.is_some_and(|sheet| self.position <= sheet);
        let tips = self.tip.is_some_and(|tip| self.position <= tip);
        let contacts = if touches { FLOAT } else { 0 } | if tips { OHMIC } else { 0 };
        let mut levels = levels(self.levels | contacts);
        levels.analog[1] = self.reading;
        let status = *self.card.run_period(levels);
        self.increments.push(i64::from(self.card.pulses()[Z]));
        self.position += i64::from(self.card.pulses()[Z]);
        // The machine is where the path and the layer are, in every period.
        assert_eq!(self.position, status.counts[Z] + i64::from(status.layer));
        if status.outputs[usize::from(TORCH)] != 0 {
            self.lit_at.push(self.position);
        }
        status
    }

    pub(crate) fn periods(&mut self, count: u32) -> CardStatus<2> {
        (0..count).for_each(|_| {
            self.period();
        });
        self.status()
    }

    /// Runs until the instruction of this number is complete.
    pub(crate) fn until_executed(&mut self, number: u32) {
        for _ in 0..20_000 {
            if self.period().executed == number {
                return;
            }
        }
        panic!("not executed: {:?}", self.status());
    }

    pub(crate) fn instruct(&mut self, number: u32, torch: Option<i32>, layer: LayerMove) {
        self.send(HostCommand::Instruction(instruction(number, torch, layer)));
    }

    /// Asserts that acceleration and jerk of the tool axis are within the limits of the settings.
    pub(crate) fn assert_limits(&self) {
        let slopes = |values: &[i64]| values.windows(2).map(|pair| pair[1] - pair[0]).collect::<Vec<i64>>();
        // Rounding of an increment to whole pulses: one pulse at either end.
        let accelerations = slopes(&self.increments);
        assert!(self.increments.iter().all(|&pulses| pulses.abs() <= 30));
        assert!(accelerations.iter().all(|&change| change.abs() <= 8 + 1), "{accelerations:?}");
        assert!(slopes(&accelerations).iter().all(|&change| change.abs() <= 1 + 3), "{accelerations:?}");
    }
}

fn switching(torch: Option<i32>) -> ([OutputChange; MAX_CHANGES], u8) {
    let mut changes = [OutputChange::default(); MAX_CHANGES];
    changes[0] = OutputChange { channel: TORCH, value: torch.unwrap_or(0) };
    (changes, u8::from(torch.is_some()))
}

pub(crate) fn instruction(number: u32, torch: Option<i32>, layer: LayerMove) -> Instruction {
    let (changes, count) = switching(torch);
    let periods = if torch == Some(1) { 30 } else { 0 };
    Instruction { number, changes, count, periods, keeps_cutter: true, layer: Some(layer), ..Instruction::default() }
}

const NO_OHMIC: OhmicSensing = OhmicSensing { inputs: 0, tries: 0, drop: 0 };
pub(crate) const START: LayerMove = LayerMove::Start {
    start: -300,
    lowest: -2000,
    pierce: 120,
    cut: 45,
    sheet: SheetSource::Sensed(NO_OHMIC),
    control: [HeightControlSettings::NONE],
};

/// The torch is lit at the pierce height over the sheet that was found, the feed begins at the height of the cut, and
/// the layer is 0 again at the end: to the pulse.
#[test]
fn a_cut_begins_over_the_sheet_and_ends_where_it_was() {
    for sheet in [-1999, -1234, -301] {
        let mut table = Table::new(Some(sheet));
        table.instruct(1, Some(1), START);
        table.send(HostCommand::rate(Rate::ONE));
        table.until_executed(1);
        let status = table.status();
        // The switch opens one pulse above the position where it closes.
        assert_eq!((table.position, status.counts[0]), (sheet + 1 + 45, 0), "nothing was fed before");
        assert!(table.lit_at.iter().all(|&at| at <= sheet + 1 + 120 && at >= sheet + 1 + 45));
        assert_eq!(table.lit_at[..30], [sheet + 1 + 120; 30], "the pierce");
        while table.period().place != Place::start_of(RecordIndex::new(20)) {}
        assert_eq!(table.position, sheet + 46, "the layer stays");
        let mut lift = instruction(2, Some(0), LayerMove::OverSheet { height: 500, highest: -100 });
        lift.place = RecordIndex::new(20);
        table.send(HostCommand::Instruction(lift));
        table.until_executed(2);
        assert_eq!(table.position, (sheet + 501).min(-100));
        let mut end = instruction(3, None, LayerMove::To { layer: 0 });
        end.place = RecordIndex::new(20);
        table.send(HostCommand::Instruction(end));
        table.until_executed(3);
        assert_eq!((table.position, table.status().layer, table.status().counts[Z]), (0, 0, 0));
        assert_eq!(table.increments.iter().sum::<i64>(), 0);
        table.assert_limits();
    }
}

/// Without a sheet, and with a switch that is closed over it or does not open: nothing is lit, nothing is fed.
#[test]
fn a_sheet_that_is_not_found_starts_nothing() {
    for (sheet, cause) in [
        (None, CutterOffCause::NoSheet),
        (Some(-2100), CutterOffCause::NoSheet),
        (Some(-200), CutterOffCause::SheetContact),
    ] {
        let mut table = Table::new(sheet);
        table.instruct(1, Some(1), START);
        table.send(HostCommand::rate(Rate::ONE));
        let off = (0..20_000).find_map(|_| table.period().cutter_off).expect("it fails");
        assert_eq!((off.cause, off.channels), (cause, 0));
        let status = table.periods(300);
        assert!(status.blocked && status.at_rest && status.executed == 0 && table.lit_at.is_empty());
        assert_eq!(status.counts, [0, 0]);
        table.assert_limits();
        // The restart senses again, and the instruction is sent again.
        table.sheet = Some(-1000);
        let to_start = RepeatedInstruction { number: 1, layer: Some(LayerMove::To { layer: 0 }), ..Default::default() };
        table.send(HostCommand::Restart { last: 1 });
        table.send(HostCommand::Repeat(to_start));
        while table.period().repeated != 1 {}
        table.instruct(1, Some(1), START);
        table.until_executed(1);
        assert_eq!(table.position, -1000 + 1 + 45);
    }
}

/// A hold interrupts the moves of an instruction, and it goes on afterwards.
#[test]
fn a_hold_stops_the_layer_and_the_instruction_goes_on() {
    for after in (1..400).step_by(7) {
        let mut table = Table::new(Some(-900));
        table.instruct(1, Some(1), START);
        table.send(HostCommand::rate(Rate::ONE));
        table.periods(after);
        let was_lit = !table.lit_at.is_empty();
        table.send(HostCommand::rate(Rate::ZERO));
        table.periods(60);
        let held = table.position;
        let executed = table.periods(100).executed;
        assert!(held == table.position && (executed == 0 || after > 200), "{after}: it rests");
        assert!(was_lit || table.lit_at.is_empty(), "{after}: nothing is lit in a hold");
        table.send(HostCommand::rate(Rate::ONE));
        if executed == 0 {
            table.until_executed(1);
            assert_eq!(table.position, -900 + 1 + 45, "{after}");
        }
        table.assert_limits();
    }
}

/// An emergency stop, a host that falls silent, and a torch that is switched off by hand: the layer comes to rest,
/// nothing is lit.
#[test]
fn an_alarm_or_the_operator_ends_the_moves() {
    for after in (1..400).step_by(7) {
        for cause in [Some(Alarm::EmergencyStop), Some(Alarm::HostSilent), None] {
            let mut table = Table::new(Some(-900));
            table.instruct(1, Some(1), START);
            table.send(HostCommand::rate(Rate::ONE));
            if table.periods(after).executed == 1 {
                continue;
            }
            match cause {
                Some(Alarm::EmergencyStop) => table.levels = STOP,
                Some(_) => table.is_silent = true,
                None => table.send(HostCommand::ManualOutput(OutputChange { channel: TORCH, value: 0 })),
            }
            // The watchdog of the settings.
            if table.periods(if cause == Some(Alarm::HostSilent) { 30 } else { 0 }).executed == 1 {
                continue;
            }
            table.period();
            table.lit_at.clear();
            table.periods(60);
            let held = table.position;
            let status = table.periods(300);
            assert!(table.lit_at.is_empty() && status.executed == 0 && status.counts == [0, 0], "{after} {status:?}");
            assert!(held == table.position && status.at_rest, "{after}");
            assert_eq!(status.alarm, cause);
            table.assert_limits();
        }
    }
}

/// A repeated instruction without a torch senses the sheet and goes over it, also where the program is held. The torch
/// switched off by hand ends it anywhere: the tool comes to rest, and the next move is accepted.
#[test]
fn a_sense_test_lights_nothing_and_ends_by_hand() {
    let test = |number| RepeatedInstruction { number, layer: Some(START), ..RepeatedInstruction::default() };
    let whole = (1..20_000).find(|&periods| {
        let mut table = Table::new(Some(-900));
        table.send(HostCommand::Repeat(test(1)));
        table.periods(periods).repeated == 1
    });
    let whole = whole.expect("it is complete");
    for after in (1..whole + 3).step_by(7) {
        let mut table = Table::new(Some(-900));
        table.send(HostCommand::Repeat(test(1)));
        let done = table.periods(after).repeated == 1;
        table.send(HostCommand::ManualOutput(OutputChange { channel: TORCH, value: 0 }));
        let cancelled = (0..3).any(|_| table.period().cutter_off.is_some());
        assert_eq!(cancelled, !done, "after {after} of {whole}");
        table.periods(60);
        let rests_at = table.position;
        let status = table.periods(300);
        assert!(status.at_rest && table.lit_at.is_empty() && status.counts == [0, 0], "{after}");
        assert!(rests_at == table.position && (!done || rests_at == -900 + 1 + 45), "{after}");
        let back = RepeatedInstruction { layer: Some(LayerMove::To { layer: 0 }), ..test(1 + u32::from(done)) };
        table.send(HostCommand::Repeat(back));
        assert_eq!((table.periods(2000).repeated, table.position), (back.number, 0), "{after}");
        table.assert_limits();
    }
}

/// An emergency stop, and a host that falls silent, end a sense test anywhere: the tool comes to rest, nothing is lit.
#[test]
fn an_alarm_ends_a_sense_test() {
    for after in (1..380).step_by(7) {
        for cause in [Alarm::EmergencyStop, Alarm::HostSilent] {
            let mut table = Table::new(Some(-900));
            let test = RepeatedInstruction { number: 1, layer: Some(START), ..RepeatedInstruction::default() };
            table.send(HostCommand::Repeat(test));
            table.periods(after);
            if cause == Alarm::EmergencyStop {
                table.levels = STOP
            } else {
                table.is_silent = true
            }
            // The watchdog of the settings.
            if table.periods(if cause == Alarm::HostSilent { 30 } else { 1 }).repeated == 1 {
                continue;
            }
            table.periods(60);
            let rests_at = table.position;
            let status = table.periods(300);
            assert_eq!((status.alarm, status.repeated), (Some(cause), 0), "{after}");
            assert!(rests_at == table.position && status.at_rest && table.lit_at.is_empty(), "{after}");
            table.assert_limits();
        }
    }
}

/// A table whose cursor is at rest at the end of the path, with a rate that is asked for.
fn at_the_end(sheet: i64) -> Table {
    let mut table = Table::new(Some(sheet));
    table.send(HostCommand::rate(Rate::ONE / 4));
    while table.period().place != Place::start_of(RecordIndex::new(20)) {}
    table
}

/// Starts and ends a cut at the place of the cursor; returns the lowest position in the start, before the torch is lit.
fn cut(table: &mut Table, number: u32, may_skip: bool) -> i64 {
    let LayerMove::Start { start, lowest, pierce, cut, .. } = START else { unreachable!() };
    let begin = instruction(
        number,
        Some(1),
        LayerMove::Start {
            start,
            lowest,
            pierce,
            cut,
            sheet: if may_skip { SheetSource::Kept(NO_OHMIC) } else { SheetSource::Sensed(NO_OHMIC) },
            control: [HeightControlSettings::NONE],
        },
    );
    table.send(HostCommand::Instruction(Instruction { place: RecordIndex::new(20), ..begin }));
    table.lit_at.clear();
    let mut deepest = table.position;
    while table.status().executed != number {
        table.period();
        if table.lit_at.is_empty() {
            deepest = deepest.min(table.position);
        }
    }
    assert_eq!(table.position, table.sheet.expect("a sheet") + 1 + 45, "the height of the cut");
    let lift = instruction(number + 1, Some(0), LayerMove::OverSheet { height: 500, highest: -100 });
    table.send(HostCommand::Instruction(Instruction { place: RecordIndex::new(20), ..lift }));
    table.until_executed(number + 1);
    deepest
}

/// A start that may skip the sensing does so where nothing has happened since; behind anything else it senses, and the
/// next one senses, too (CUT-13).
#[test]
fn a_start_takes_the_height_that_was_found_unless_something_has_happened() {
    let sheet = -900;
    let begin = || {
        let mut table = at_the_end(sheet);
        assert!(cut(&mut table, 1, true) <= sheet, "nothing is known yet");
        assert!(cut(&mut table, 3, true) <= sheet, "what a start found that may skip counts for no other");
        assert!(cut(&mut table, 5, false) <= sheet, "it must sense");
        table
    };
    let mut table = begin();
    for number in [7, 9] {
        assert_eq!(cut(&mut table, number, true), sheet + 1 + 120, "straight to the height of the pierce");
    }
    table.assert_limits();
    type Happening = fn(&mut Table);
    let happenings: [(&str, Happening); 6] = [
        ("a hold", |table| {
            table.send(HostCommand::rate(Rate::ZERO));
            table.periods(30);
            table.send(HostCommand::rate(Rate::ONE / 4));
        }),
        ("cutter off by hand", |table| {
            table.send(HostCommand::ManualOutput(OutputChange { channel: TORCH, value: 0 }));
        }),
        ("a contact", |table| {
            table.levels = FLOAT;
            table.period();
            table.levels = 0;
        }),
        ("an emergency stop", |table| {
            table.levels = STOP;
            table.periods(5);
            table.levels = 0;
            table.periods(5);
            table.send(HostCommand::ClearAlarm);
            table.send(HostCommand::rate(Rate::ONE / 4));
        }),
        ("a repeated instruction", |table| {
            let number = table.status().repeated + 1;
            table.send(HostCommand::Restart { last: number });
            table.send(HostCommand::Repeat(RepeatedInstruction { number, ..Default::default() }));
            table.periods(5);
        }),
        ("a move to the path", |table| {
            let back = instruction(7, None, LayerMove::To { layer: 0 });
            table.send(HostCommand::Instruction(Instruction { place: RecordIndex::new(20), ..back }));
            table.until_executed(7);
        }),
    ];
    for (name, happens) in happenings {
        let mut table = begin();
        happens(&mut table);
        let number = table.status().executed + 1;
        assert!(cut(&mut table, number, true) <= sheet, "{name}");
        assert!(cut(&mut table, number + 2, true) <= sheet, "{name}: the next one, too");
        assert!(cut(&mut table, number + 4, false) <= sheet, "{name}");
        assert_eq!(cut(&mut table, number + 6, true), sheet + 1 + 120, "{name}: known again");
    }
}

/// A sheet that lies higher than it was found ends the start before the torch is lit.
#[test]
fn a_contact_on_the_way_to_a_known_sheet_lights_nothing() {
    let mut table = at_the_end(-900);
    cut(&mut table, 1, false);
    table.sheet = Some(-700);
    table.lit_at.clear();
    let LayerMove::Start { start, lowest, pierce, cut, .. } = START else { unreachable!() };
    let start = instruction(
        3,
        Some(1),
        LayerMove::Start {
            start,
            lowest,
            pierce,
            cut,
            sheet: SheetSource::Kept(NO_OHMIC),
            control: [HeightControlSettings::NONE],
        },
    );
    table.send(HostCommand::Instruction(Instruction { place: RecordIndex::new(20), ..start }));
    let off = (0..20_000).find_map(|_| table.period().cutter_off).expect("it fails");
    assert_eq!((off.cause, off.channels), (CutterOffCause::SheetContact, 0));
    let status = table.periods(300);
    assert!(status.blocked && status.executed == 2 && table.lit_at.is_empty());
    table.assert_limits();
}

/// The ohmic contact finds the sheet; where it does not close it is tried again, and then the float switch counts.
#[test]
fn the_ohmic_contact_counts_and_the_float_switch_behind_its_attempts() {
    let (sheet, travel, tries) = (-900, 60, 3);
    let mut settings = layer_settings(1);
    settings.inputs[2] = InputSetting::default();
    settings.layer = Some(LayerSettings { contacts: FLOAT | OHMIC, ..SETTINGS });
    let ohmic = OhmicSensing { inputs: OHMIC, tries, drop: travel as i32 };
    let LayerMove::Start { start, lowest, pierce, cut, .. } = START else { unreachable!() };
    let ohmic_start = LayerMove::Start {
        start,
        lowest,
        pierce,
        cut,
        sheet: SheetSource::Sensed(ohmic),
        control: [HeightControlSettings::NONE],
    };
    // Closes at once, in the second attempt and in the last, and never.
    for closes_from in [0, 1, tries, tries + 1, u8::MAX] {
        let mut table = Table::with(Some(sheet - travel), &settings);
        table.send(HostCommand::rate(Rate::ONE / 4));
        table.instruct(1, Some(1), ohmic_start);
        let (mut downs, mut was_pressed) = (0, false);
        while table.status().executed == 0 {
            table.tip = (downs >= closes_from).then_some(sheet);
            table.period();
            let is_pressed = table.position <= sheet - travel;
            downs += u8::from(is_pressed && !was_pressed);
            was_pressed = is_pressed;
            assert!(table.lit_at.is_empty() || table.position > sheet - travel, "{closes_from} {downs}");
        }
        // The heights are those over the place where the float switch opens.
        assert_eq!(table.position, sheet - travel + 1 + 45, "{closes_from}");
        assert!(downs <= tries + 1, "{closes_from}: {downs}");
        assert_eq!(downs > tries, closes_from > tries, "{closes_from}: {downs}");
        table.assert_limits();
    }
    // A contact that is closed before, such as one with a bridge, starts nothing.
    let mut table = Table::with(Some(sheet - travel), &settings);
    table.tip = Some(100);
    table.send(HostCommand::rate(Rate::ONE / 4));
    table.instruct(1, Some(1), ohmic_start);
    let off = (0..20_000).find_map(|_| table.period().cutter_off).expect("it fails");
    assert_eq!(off.cause, CutterOffCause::SheetContact);
    assert!(table.lit_at.is_empty());
}

/// A layer that is not kept becomes part of the counts; nothing moves.
#[test]
fn an_epoch_keeps_the_layer_or_adds_it_to_the_counts() {
    for keeps_state in [true, false] {
        let mut table = Table::new(None);
        table.instruct(1, None, LayerMove::To { layer: -321 });
        table.send(HostCommand::rate(Rate::ONE));
        table.until_executed(1);
        while !table.period().at_rest {}
        let start = PathStart { keeps_state, ..PathStart::at(RecordIndex::new(7)) };
        let counts = table.status().counts;
        table.card.open(&CardSettings { start, ..layer_settings(2) }).expect("at rest");
        let status = table.period();
        let expected = if keeps_state { (counts[Z], -321) } else { (counts[Z] - 321, 0) };
        assert_eq!((status.counts[Z], status.layer), expected);
        assert_eq!(table.position, -321);
    }
}

#[test]
fn moves_that_the_card_cannot_make_are_refused() {
    let mut table = Table::new(None);
    let too_far = instruction(1, None, LayerMove::To { layer: -(MAX_LAYER as i32) - 1 });
    assert_eq!(table.card.accept(HostCommand::Instruction(too_far)), Err(CommandRefusal::Unsupported));
    let mut card = TestCard::new(identity()).expect("a memory");
    card.open(&settings(1, 0)).expect("fit");
    let without = instruction(1, None, LayerMove::To { layer: 1 });
    assert_eq!(card.accept(HostCommand::Instruction(without)), Err(CommandRefusal::Unsupported));
    let refused = [
        LayerSettings { axis: 2, ..SETTINGS },
        LayerSettings { contacts: 0, ..SETTINGS },
        LayerSettings { contacts: 1 << 6, ..SETTINGS },
        LayerSettings { probe_speed: 0, ..SETTINGS },
        LayerSettings { latch_speed: 0, ..SETTINGS },
    ];
    for layer in refused {
        let settings = CardSettings { layer: Some(layer), ..layer_settings(2) };
        assert_eq!(card.open(&settings), Err(CommandRefusal::Unsupported), "{layer:?}");
    }
}

proptest! {
    /// Any targets in a row, some replaced while the layer moves: it ends at the last one, within the limits.
    #[test]
    fn any_moves_end_at_their_target_within_the_limits(
        targets in prop::collection::vec((-5000..5000i32, 0..200u32), 1..8),
        (velocity, acceleration, jerk) in (1u64..60 << 32, 1u64 << 16..9 << 32, 1u64 << 16..3 << 32),
    ) {
        let velocity = velocity.max(1 << 28);
        let mut drive = LayerDrive::new();
        let limits = PulseLimits { velocity, acceleration: acceleration.min(jerk * 200), jerk };
        drive.configure(Some(SETTINGS), &limits, 100, false);
        let (mut position, mut increments) = (0i64, vec![0i64]);
        let mut run = |drive: &mut LayerDrive, periods: &mut u32| {
            drive.run_period(0, false);
            position += i64::from(drive.increment());
            increments.push(i64::from(drive.increment()));
            *periods += 1;
            assert_eq!(position, i64::from(drive.layer()));
        };
        let last = targets[targets.len() - 1].0;
        for (target, periods) in targets {
            drive.begin_behind(Some(LayerMove::To { layer: target }));
            let mut passed = 0;
            while passed < periods {
                run(&mut drive, &mut passed);
            }
        }
        let mut passed = 0;
        while drive.progress() == LayerProgress::Moving && passed < 2_000_000 {
            run(&mut drive, &mut passed);
        }
        prop_assert_eq!((drive.layer(), drive.at_rest()), (last, true));
        let most = |figure: u64| figure.div_ceil(PULSE) as i64;
        let slope: Vec<i64> = increments.windows(2).map(|pair| pair[1] - pair[0]).collect();
        prop_assert!(increments.iter().all(|pulses| pulses.abs() <= most(velocity)));
        prop_assert!(slope.iter().all(|change| change.abs() <= most(limits.acceleration) + 1));
        prop_assert!(slope.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= most(jerk) + 3));
    }
}

/// A start over a known sheet senses nothing, and what it was told counts for no later start (CUT-54); a contact that
/// closes on the way lights nothing.
#[test]
fn a_start_over_a_known_sheet_goes_straight_there() {
    let LayerMove::Start { start, lowest, pierce, cut: height, .. } = START else { unreachable!() };
    let control = [HeightControlSettings::NONE];
    let known =
        |layer| LayerMove::Start { start, lowest, pierce, cut: height, sheet: SheetSource::Known(layer), control };
    let begin = |table: &mut Table, number, layer| {
        let begin = instruction(number, Some(1), known(layer));
        table.send(HostCommand::Instruction(Instruction { place: RecordIndex::new(20), ..begin }));
    };
    let mut table = at_the_end(-900);
    begin(&mut table, 1, -899);
    let mut deepest = table.position;
    while table.status().executed != 1 {
        table.period();
        if table.lit_at.is_empty() {
            deepest = deepest.min(table.position);
        }
    }
    assert_eq!((deepest, table.position), (-899 + 120, -899 + 45));
    let lift = instruction(2, Some(0), LayerMove::OverSheet { height: 500, highest: -100 });
    table.send(HostCommand::Instruction(Instruction { place: RecordIndex::new(20), ..lift }));
    table.until_executed(2);
    assert_eq!(table.position, -899 + 500, "over the same sheet");
    assert!(cut(&mut table, 3, true) <= -900, "it counts for no later start");
    let mut table = at_the_end(-900);
    begin(&mut table, 1, -1100);
    let off = (0..20_000).find_map(|_| table.period().cutter_off).expect("it fails");
    assert_eq!((off.cause, off.channels, table.lit_at.is_empty()), (CutterOffCause::SheetContact, 0, true));
    table.assert_limits();
}
