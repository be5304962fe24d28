//! Moves of the layer beside the path: heights that are passed with the cutter on (CUT-13, CUT-15).
//!
//! Invariant: the machine is where the path and the layer are, in every period; the table asserts it.

use crate::common::STOP;
use crate::layer::{START, TORCH, Table, Z, instruction, layer_settings};
use retrace_card::InputLevels;
use retrace_core::{Flags, Place, Rate, Record, RecordIndex};
use retrace_link::{
    Alarm, CardCore, CardSettings, CommandRefusal, HostCommand, Instruction, LayerMove, MAX_LAYER, OutputAction,
    OutputChange, RepeatedInstruction, channel,
};

const SHEET: i64 = -900;
/// Where the float switch opens.
const OPENS: i64 = SHEET + 1;
/// Behind the start.
const CUT: i64 = OPENS + 45;
/// Records of the path; the last one rests.
const RECORDS: u32 = 600;

fn height(place: u32, height: i32) -> HostCommand<2> {
    let place = RecordIndex::new(place);
    HostCommand::Action(OutputAction { place, channel: channel::HEIGHT, before: 0, after: height })
}

/// A table whose torch is lit at the beginning of a path, with these heights on it, and motion requested.
fn lit(heights: &[(u32, i32)]) -> Table {
    let mut table = Table::new(Some(SHEET));
    table.send(HostCommand::Trim { high: RecordIndex::new(1) });
    fill(&mut table, 60);
    heights.iter().for_each(|&(place, over)| table.send(height(place, over)));
    table.instruct(1, Some(1), START);
    table.send(HostCommand::rate(Rate::ONE));
    table.until_executed(1);
    assert_eq!(table.position, CUT);
    table.increments.clear();
    table
}

/// Sends records up to this one, as far as there is room.
fn fill(table: &mut Table, end: u32) {
    for place in table.status().high.number()..end.min(RECORDS) {
        let flags = if place + 1 == RECORDS { Flags::REST } else { Flags::NONE };
        let record = Record { increments: [5, 0], flags, ..Record::default() };
        if table.card.accept(HostCommand::Ahead { place: RecordIndex::new(place), record }).is_err() {
            return;
        }
    }
}

/// Runs until the cursor is at this place, with records sent ahead of it. Returns the position in each period.
fn run_to(table: &mut Table, place: u32) -> Vec<(Place, i64)> {
    let mut positions = Vec::new();
    while table.status().place.distance_to(Place::start_of(RecordIndex::new(place))) > retrace_core::Distance::ZERO {
        let high = table.status().place.record.number() + 30;
        fill(table, high);
        let status = table.period();
        positions.push((status.place, table.position));
        assert!(positions.len() < 5000, "{status:?}");
    }
    positions
}

/// The height follows the places at which it changes, the path never rests for it, and the layer ends at the last one,
/// to the pulse; behind the end of the cut it returns to 0, and its pulses sum to 0.
#[test]
fn heights_are_reached_beside_the_path() {
    for rate in [Rate::ONE, Rate::ONE / 3] {
        let mut table = lit(&[(20, 300), (180, -20)]);
        table.send(HostCommand::rate(rate));
        run_to(&mut table, 19);
        assert_eq!(table.position, CUT, "nothing moves before its place");
        let positions = run_to(&mut table, RECORDS - 20);
        assert!(positions.windows(2).all(|pair| pair[0].0 != pair[1].0), "the path moves on");
        assert!(positions.iter().any(|&(_, at)| at == OPENS + 300), "the first height is reached");
        assert_eq!(table.position, OPENS - 20);
        table.assert_limits();
        run_to(&mut table, RECORDS);
        let place = RecordIndex::new(RECORDS);
        table.send(HostCommand::rate(Rate::ONE));
        let off = instruction(2, Some(0), LayerMove::OverSheet { height: 500, highest: -100 });
        table.send(HostCommand::Instruction(Instruction { place, ..off }));
        table.until_executed(2);
        assert_eq!(table.position, OPENS + 500);
        table.send(HostCommand::Instruction(Instruction { place, ..instruction(3, None, LayerMove::To { layer: 0 }) }));
        table.until_executed(3);
        assert_eq!((table.position, table.status().layer, table.status().counts[Z]), (0, 0, 0));
    }
}

/// What puts the cutter out also ends the move: the layer comes to rest, the path as ever, and a lift goes on from
/// there. The height is not passed again.
#[test]
fn a_cut_that_ends_in_a_move_rests_and_is_lifted() {
    type Happening = fn(&mut Table);
    let happenings: [(&str, Happening); 5] = [
        ("hold", |table| table.send(HostCommand::rate(Rate::ZERO))),
        ("reverse", |table| table.send(HostCommand::rate(-Rate::ONE))),
        ("cutter off by hand", |table| {
            table.send(HostCommand::ManualOutput(OutputChange { channel: TORCH, value: 0 }));
        }),
        ("emergency stop", |table| table.levels = STOP),
        ("host silent", |table| table.is_silent = true),
    ];
    for (name, happens) in happenings {
        for after in (21..130).step_by(3) {
            let mut table = lit(&[(20, 1000)]);
            run_to(&mut table, after);
            happens(&mut table);
            for _ in 0..300 {
                let status = table.period();
                assert!(status.rate >= Rate::ZERO || status.outputs[usize::from(TORCH)] == 0, "{name} {after}");
            }
            table.assert_limits();
            let (rests_at, status) = (table.position, table.periods(100));
            let goes_off_at_once = matches!(name, "cutter off by hand" | "emergency stop");
            assert!(!goes_off_at_once || after > 45 || rests_at < OPENS + 900, "{name} {after}: it ends in the move");
            assert_eq!(table.position, rests_at, "{name} {after}: it rests");
            assert!(status.outputs[usize::from(TORCH)] == 0 && rests_at <= OPENS + 1000, "{name} {after}");
            if name == "host silent" {
                assert_eq!(status.alarm, Some(Alarm::HostSilent));
                table.is_silent = false;
            }
            table.levels = 0;
            table.periods(5);
            table.send(HostCommand::ClearAlarm);
            table.send(HostCommand::rate(Rate::ZERO));
            table.periods(100);
            let lift = LayerMove::OverSheet { height: 700, highest: -100 };
            let number = table.status().repeated + 1;
            table.send(HostCommand::Repeat(RepeatedInstruction { number, layer: Some(lift), ..Default::default() }));
            while table.period().repeated != number {}
            assert_eq!(table.position, OPENS + 700, "{name} {after}");
            // Passed again, in either direction, nothing moves: the cutter is off, and the place was passed.
            table.send(HostCommand::Replay { on: true });
            table.send(HostCommand::Restart { last: number });
            table.send(HostCommand::rate(-Rate::ONE));
            table.periods(400);
            table.send(HostCommand::rate(Rate::ONE));
            table.periods(200);
            assert_eq!(table.position, OPENS + 700, "{name} {after}: {:?}", table.status());
        }
    }
}

/// A height that is passed with the cutter off, such as behind its loss or in a dry run, moves nothing; not even where
/// the cutter is on behind it.
#[test]
fn a_height_that_is_passed_without_the_cutter_moves_nothing() {
    for is_lit_again in [false, true] {
        let mut table = lit(&[(200, 300)]);
        run_to(&mut table, 50);
        table.send(HostCommand::ManualOutput(OutputChange { channel: TORCH, value: 0 }));
        run_to(&mut table, 201);
        table.send(HostCommand::ManualOutput(OutputChange { channel: TORCH, value: i32::from(is_lit_again) }));
        run_to(&mut table, 300);
        assert_eq!(table.status().outputs[usize::from(TORCH)] != 0, is_lit_again);
        assert_eq!(table.position, CUT);
    }
}

/// A height that was passed moves nothing where it is passed again with the cutter on.
#[test]
fn a_height_counts_where_it_is_passed_for_the_first_time() {
    let mut table = lit(&[(20, 300)]);
    run_to(&mut table, 150);
    table.send(HostCommand::rate(Rate::ZERO));
    table.periods(100);
    table.send(HostCommand::Restart { last: 0 });
    table.send(HostCommand::rate(-Rate::ONE));
    while table.status().place.record.number() > 140 {
        table.period();
    }
    table.send(HostCommand::rate(Rate::ZERO));
    table.periods(100);
    // Of a place that is still held, such as one that was passed in reverse.
    table.send(height(table.status().reached.number() - 1, 500));
    table.send(HostCommand::Replay { on: true });
    table.send(HostCommand::Restart { last: 1 });
    let layer = Some(LayerMove::OverSheet { height: 45, highest: 0 });
    let Instruction { changes, count, periods, .. } = instruction(1, Some(1), START);
    table.send(HostCommand::Repeat(RepeatedInstruction {
        number: 1,
        changes,
        count,
        periods,
        layer,
        ..Default::default()
    }));
    table.send(HostCommand::rate(Rate::ONE));
    run_to(&mut table, 300);
    assert_eq!((table.position, table.status().outputs[usize::from(TORCH)]), (CUT, 1));
}

/// A hold that is over before the grace time ends nothing: the layer completes its move meanwhile.
#[test]
fn a_short_hold_lets_the_layer_go_on() {
    let mut table = lit(&[(20, 1000)]);
    run_to(&mut table, 60);
    table.send(HostCommand::rate(Rate::ZERO));
    table.periods(40);
    table.send(HostCommand::rate(Rate::ONE));
    run_to(&mut table, 500);
    assert_eq!((table.position, table.status().outputs[usize::from(TORCH)]), (OPENS + 1000, 1));
    table.assert_limits();
}

/// Where the path moves the axis of the layer itself, the layer comes to rest.
#[test]
fn the_layer_yields_to_a_path_along_its_axis() {
    let mut table = Table::new(Some(SHEET));
    table.send(HostCommand::Trim { high: RecordIndex::new(1) });
    for place in 1..60 {
        let flags = if place == 59 { Flags::REST } else { Flags::NONE };
        let record = Record { increments: [5, i16::from((30..55).contains(&place))], flags, ..Record::default() };
        table.send(HostCommand::Ahead { place: RecordIndex::new(place), record });
    }
    table.send(height(20, 1000));
    table.instruct(1, Some(1), START);
    table.send(HostCommand::rate(Rate::ONE));
    table.until_executed(1);
    let mut layers = Vec::new();
    while table.status().place != Place::start_of(RecordIndex::new(59)) {
        let status = table.period();
        layers.push((status.place.record.number(), status.layer));
    }
    let at = |place: u32| layers.iter().find(|(record, _)| *record == place).map(|(_, layer)| *layer);
    assert!(at(20) < at(30) && at(53) == at(54), "{layers:?}");
}

#[test]
fn a_height_needs_a_layer_and_is_bounded() {
    let mut table = Table::new(None);
    for over in [MAX_LAYER as i32 + 1, -(MAX_LAYER as i32) - 1] {
        assert_eq!(table.card.accept(height(5, over)), Err(CommandRefusal::NoSuchChannel));
    }
    table.send(height(5, MAX_LAYER as i32));
    table.card.open(&CardSettings { layer: None, ..layer_settings(2) }).expect("at rest");
    table.card.run_period(InputLevels::default());
    assert_eq!(table.card.accept(height(5, 1)), Err(CommandRefusal::NoSuchChannel));
    let by_hand = HostCommand::ManualOutput(OutputChange { channel: channel::HEIGHT, value: 1 });
    assert_eq!(table.card.accept(by_hand), Err(CommandRefusal::NoSuchChannel));
}
