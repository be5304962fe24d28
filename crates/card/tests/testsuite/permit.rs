//! The permit of the cutting outputs (CUT-3, CUT-4, CUT-6, CUT-8), as a card with a torch, a jet and its abrasive
//! applies it.
//!
//! Invariant: what is asserted of an output is what the card reports at the end of a period, which is what its pins
//! show in the next.

use crate::common;

use common::{DOOR, PLAIN, STOP, TestCard, identity, levels, settings};
use retrace_core::{Distance, Flags, Place, Rate, Record, RecordIndex};
use retrace_link::{
    CardCore, CardSettings, CardStatus, CommandRefusal, CutterOffCause, CuttingChannel, CuttingSettings, HostCommand,
    InputWait, Instruction, MAX_CHANGES, OutputAction, OutputChange, RepeatedInstruction, channel,
};

const TORCH: u8 = channel::SPINDLE;
const JET: u8 = 3;
const ABRASIVE: u8 = 4;
const JET_GRACE: u16 = 50;
const HANDOVER: u16 = 10;
/// Bits of the channels in the settings.
const TORCH_BIT: u8 = 1;
const JET_BIT: u8 = 2;

fn cutting_settings(epoch: u16, jet_lit_in_reverse: bool, inhibit: bool) -> CardSettings<2> {
    let mut settings = settings(epoch, 0);
    settings.safe_count = 0;
    let channels = [
        CuttingChannel { channel: TORCH, fires: true, standing_periods: 0, lit_in_reverse: false, proof: None },
        CuttingChannel {
            channel: JET,
            fires: true,
            standing_periods: JET_GRACE,
            lit_in_reverse: jet_lit_in_reverse,
            proof: None,
        },
        CuttingChannel { channel: ABRASIVE, ..CuttingChannel::default() },
    ];
    settings.cutting = CuttingSettings { count: 3, handover_periods: HANDOVER, inhibit, ..CuttingSettings::default() };
    settings.cutting.channels[..3].copy_from_slice(&channels);
    settings
}

struct Bench {
    card: TestCard,
    levels: u16,
    silent: bool,
}

impl Bench {
    /// An open card with 60 records of a straight path.
    fn new(jet_lit_in_reverse: bool, inhibit: bool) -> Self {
        let mut card = TestCard::new(identity()).expect("a memory");
        card.open(&cutting_settings(1, jet_lit_in_reverse, inhibit)).expect("fit");
        let mut bench = Self { card, levels: 0, silent: false };
        bench.fill(60);
        bench
    }

    fn fill(&mut self, to: u32) {
        for place in self.status().high.number()..to {
            let flags = if place % 60 == 59 { Flags::REST } else { Flags::NONE };
            let record = Record { increments: [5, 0], flags, ..Record::default() };
            self.send(HostCommand::Ahead { place: RecordIndex::new(place), record });
        }
    }

    fn status(&self) -> CardStatus<2> {
        *self.card.status()
    }

    fn send(&mut self, command: HostCommand<2>) {
        self.card.accept(command).expect("it is taken");
    }

    fn rate(&mut self, target: Rate) {
        self.send(HostCommand::rate(target));
    }

    fn period(&mut self) -> CardStatus<2> {
        if !self.silent {
            self.card.keep_alive();
        }
        *self.card.run_period(levels(self.levels))
    }

    fn periods(&mut self, count: u32) {
        for _ in 0..count {
            self.period();
        }
    }

    fn rest(&mut self) {
        while !self.period().at_rest {}
    }

    /// Lights a cutter in the path, by the next instruction, and lets it be executed.
    fn light(&mut self, channel: u8) {
        let mut instruction = Instruction { number: self.status().executed + 1, count: 1, ..Instruction::default() };
        instruction.place = self.status().place.record;
        instruction.changes[0] = OutputChange { channel, value: 1 };
        self.rate(Rate::ONE / 4);
        self.send(HostCommand::Instruction(instruction));
        assert_eq!(self.value(channel), 1);
    }

    /// Runs with a cutter on, at a quarter of the rate.
    fn cutting(jet_lit_in_reverse: bool, channel: u8) -> Self {
        let mut bench = Self::new(jet_lit_in_reverse, false);
        bench.light(channel);
        bench.periods(40);
        assert_eq!(bench.value(channel), 1);
        bench
    }

    fn value(&self, channel: u8) -> i32 {
        self.status().outputs[usize::from(channel)]
    }

    /// Periods until the channel is off, from now on, and the report of that one.
    fn until_off(&mut self, channel: u8) -> (u32, CardStatus<2>) {
        for n in 0..2000 {
            if self.value(channel) == 0 {
                return (n, self.status());
            }
            self.period();
        }
        panic!("it stays on");
    }
}

fn repeat(number: u32, channel: u8, value: i32, periods: u32) -> HostCommand<2> {
    let mut changes = [OutputChange::default(); MAX_CHANGES];
    changes[0] = OutputChange { channel, value };
    HostCommand::Repeat(RepeatedInstruction { number, changes, count: 1, periods, ..RepeatedInstruction::default() })
}

fn off(status: &CardStatus<2>) -> Option<(u8, CutterOffCause)> {
    status.cutter_off.map(|off| (off.channels, off.cause))
}

#[test]
fn a_hold_keeps_the_torch_lit_to_the_place_of_rest_and_no_longer() {
    let mut bench = Bench::cutting(false, TORCH);
    bench.rate(Rate::ZERO);
    bench.rest();
    assert_eq!(bench.value(TORCH), 1, "the kerf reaches the place of rest");
    let status = bench.period();
    assert_eq!((bench.value(TORCH), off(&status)), (0, Some((TORCH_BIT, CutterOffCause::Standing))));
    assert!(status.blocked);
    assert_eq!(bench.period().cutter_off, None, "reported once");
}

#[test]
fn a_jet_stays_on_for_its_grace_and_a_shorter_hold_changes_nothing() {
    let mut bench = Bench::cutting(false, JET);
    bench.rate(Rate::ZERO);
    bench.rest();
    bench.periods(u32::from(JET_GRACE));
    assert_eq!((bench.value(JET), bench.status().blocked), (1, false));
    bench.rate(Rate::ONE / 4);
    bench.periods(5);
    bench.rate(Rate::ZERO);
    bench.rest();
    assert_eq!(bench.until_off(JET).0, u32::from(JET_GRACE) + 1);
}

#[test]
fn motion_stays_blocked_in_both_directions_until_a_restart() {
    let mut bench = Bench::cutting(false, TORCH);
    bench.rate(Rate::ZERO);
    bench.rest();
    bench.periods(3);
    let place = bench.status().place;
    for target in [Rate::ONE, -Rate::ONE] {
        bench.rate(target);
        bench.periods(30);
        assert_eq!((bench.status().place, bench.status().blocked), (place, true));
    }
    bench.rate(Rate::ONE / 4);
    bench.send(HostCommand::Restart { last: 2 });
    bench.send(repeat(1, ABRASIVE, 1, 3));
    bench.periods(3);
    assert_eq!(bench.status().repeated, 1);
    bench.periods(4);
    bench.send(repeat(2, TORCH, 1, 20));
    bench.periods(19);
    assert_eq!((bench.status().place, bench.value(TORCH), bench.status().blocked), (place, 1, true));
    bench.period();
    assert!(!bench.status().blocked);
    bench.periods(5);
    assert!(place.distance_to(bench.status().place) > Distance::ZERO && bench.value(TORCH) == 1);
}

#[test]
fn a_restart_with_nothing_to_repeat_releases_the_block() {
    let mut bench = Bench::cutting(false, TORCH);
    bench.rate(Rate::ZERO);
    bench.rest();
    bench.periods(3);
    bench.send(HostCommand::Restart { last: 0 });
    bench.rate(-Rate::ONE);
    let place = bench.status().place;
    bench.periods(30);
    assert!(bench.status().place.distance_to(place) > Distance::ZERO && bench.value(TORCH) == 0);
}

#[test]
fn records_that_come_late_do_not_start_motion_with_the_cutter_out() {
    let mut bench = Bench::cutting(false, TORCH);
    while bench.status().high.since(bench.status().place.record) > 0 {
        bench.period();
    }
    bench.rest();
    bench.periods(u32::from(HANDOVER) - 1);
    assert_eq!(bench.value(TORCH), 1);
    let status = bench.period();
    assert_eq!((bench.value(TORCH), status.blocked), (0, true));
    bench.fill(90);
    bench.periods(30);
    assert_eq!(bench.status().place, Place::start_of(RecordIndex::new(60)));
}

#[test]
fn records_that_come_within_the_handover_go_on() {
    let mut bench = Bench::cutting(false, TORCH);
    while bench.status().high.since(bench.status().place.record) > 0 {
        bench.period();
    }
    bench.rest();
    bench.periods(u32::from(HANDOVER) - 1);
    assert_eq!(bench.value(TORCH), 1);
    bench.fill(90);
    bench.periods(30);
    assert!(bench.value(TORCH) == 1 && bench.status().place.record.number() > 60);
}

#[test]
fn a_pierce_does_not_count_as_standing_and_the_waiting_behind_it_does() {
    let mut bench = Bench::new(false, false);
    bench.rate(Rate::ONE);
    let until = Some(InputWait::new(5, true, 0));
    let mut pierce = Instruction { number: 1, periods: 100, until, count: 1, ..Instruction::default() };
    (pierce.changes[0], pierce.keeps_cutter) = (OutputChange { channel: TORCH, value: 1 }, true);
    bench.send(HostCommand::Instruction(pierce));
    bench.periods(40);
    bench.rate(Rate::ZERO);
    bench.periods(200);
    assert_eq!((bench.value(TORCH), bench.status().executed), (1, 0));
    bench.levels = PLAIN;
    assert_eq!((bench.period().executed, bench.value(TORCH)), (1, 1));
    assert_eq!(bench.until_off(TORCH).0, 1, "nothing is asked for");
}

#[test]
fn an_instruction_that_does_not_need_the_cutter_counts_as_standing() {
    let mut bench = Bench::cutting(false, TORCH);
    let place = bench.status().place.record + 20;
    bench.send(HostCommand::Instruction(Instruction { number: 2, place, periods: 500, ..Instruction::default() }));
    while bench.status().place != Place::start_of(place) {
        bench.period();
    }
    bench.rest();
    assert_eq!(bench.until_off(TORCH).0, u32::from(HANDOVER) + 1);
    bench.periods(600);
    assert_eq!((bench.status().executed, bench.status().place), (2, Place::start_of(place)), "blocked behind it");
}

#[test]
fn the_torch_is_out_before_the_path_runs_backward() {
    let mut bench = Bench::cutting(false, TORCH);
    bench.rate(-Rate::ONE);
    loop {
        let was = bench.value(TORCH);
        let status = bench.period();
        assert!(status.rate >= Rate::ZERO || was == 0, "lit in the period before");
        if status.rate < Rate::ZERO {
            break;
        }
        if bench.value(TORCH) == 0 && was == 1 {
            assert_eq!(off(&status), Some((TORCH_BIT, CutterOffCause::Reverse)));
        }
    }
    assert!(!bench.status().blocked);
    assert_eq!(
        bench.card.accept(HostCommand::ManualOutput(OutputChange { channel: TORCH, value: 1 })),
        Err(CommandRefusal::Unsupported)
    );
    bench.rate(Rate::ONE);
    bench.periods(60);
    assert_eq!(bench.value(TORCH), 0, "never given back");
}

#[test]
fn a_jet_that_may_be_on_in_reverse_stays_on() {
    let mut bench = Bench::cutting(true, JET);
    bench.rate(-Rate::ONE);
    bench.periods(30);
    assert!(bench.status().rate < Rate::ZERO && bench.value(JET) == 1);
    bench.rate(Rate::ZERO);
    bench.rest();
    assert_eq!(bench.until_off(JET).0, u32::from(JET_GRACE) + 1);
}

/// Output 3 is switched on at record 5 and off at 20, output 64 likewise; both are replayed.
fn replayed(jet_lit_in_reverse: bool) -> Bench {
    let mut bench = Bench::new(jet_lit_in_reverse, false);
    for (place, channel, before) in [(5, JET, 0), (5, TORCH, 0), (20, JET, 1), (20, TORCH, 1), (30, ABRASIVE, 0)] {
        bench.send(HostCommand::Action(OutputAction {
            place: RecordIndex::new(place),
            channel,
            before,
            after: 1 - before,
        }));
    }
    bench.send(HostCommand::Replay { on: true });
    bench.rate(Rate::ONE);
    bench.periods(10);
    assert_eq!((bench.value(JET), bench.value(TORCH)), (1, 1));
    bench.periods(30);
    assert_eq!((bench.value(JET), bench.value(TORCH), bench.value(ABRASIVE)), (0, 0, 1));
    bench
}

#[test]
fn a_replayed_action_lights_no_cutter_in_either_direction() {
    let mut bench = replayed(false);
    for target in [-Rate::ONE, Rate::ONE] {
        bench.rate(target);
        for _ in 0..70 {
            bench.period();
            assert_eq!((bench.value(JET), bench.value(TORCH)), (0, 0));
        }
        assert_eq!(bench.value(ABRASIVE), i32::from(target > Rate::ZERO), "others are replayed");
    }
}

#[test]
fn a_replayed_action_lights_a_jet_that_may_be_on_in_reverse_and_puts_others_out() {
    let mut bench = replayed(true);
    bench.rate(-Rate::ONE);
    let mut seen = 0;
    for _ in 0..80 {
        bench.period();
        seen |= bench.value(JET);
        assert_eq!(bench.value(TORCH), 0);
    }
    assert_eq!((seen, bench.status().place, bench.value(JET)), (1, Place::start_of(RecordIndex::new(0)), 0));
    // forward again, the torch lit manually on the way: the action at 20 puts it out
    bench.rate(Rate::ONE);
    bench.periods(10);
    bench.send(HostCommand::ManualOutput(OutputChange { channel: TORCH, value: 1 }));
    bench.periods(2);
    assert_eq!(bench.value(TORCH), 1);
    bench.periods(25);
    assert_eq!(bench.value(TORCH), 0);
}

#[test]
fn an_alarm_puts_out_in_the_period_that_sampled_it() {
    for level in [STOP, DOOR] {
        let mut bench = Bench::cutting(false, TORCH);
        bench.levels = level;
        let status = bench.period();
        assert_eq!((bench.value(TORCH), off(&status)), (0, Some((TORCH_BIT, CutterOffCause::Alarm))));
        bench.rest();
        bench.levels = 0;
        bench.period();
        bench.send(HostCommand::ClearAlarm);
        bench.rate(Rate::ONE);
        bench.periods(30);
        assert_eq!(bench.value(TORCH), 0, "never given back");
    }
}

#[test]
fn a_door_that_opens_while_a_jet_is_on_at_rest_puts_it_out() {
    let mut bench = Bench::cutting(false, JET);
    bench.rate(Rate::ZERO);
    bench.rest();
    bench.levels = DOOR;
    assert_eq!(off(&bench.period()), Some((JET_BIT, CutterOffCause::Alarm)));
}

#[test]
fn a_silent_host_puts_out_after_the_watchdog() {
    let mut bench = Bench::cutting(false, TORCH);
    bench.silent = true;
    let (periods, status) = bench.until_off(TORCH);
    assert_eq!((periods, off(&status)), (29, Some((TORCH_BIT, CutterOffCause::HostSilent))));
}

#[test]
fn opening_and_closing_an_epoch_put_out() {
    let mut bench = Bench::cutting(false, JET);
    bench.rate(Rate::ZERO);
    bench.rest();
    bench.card.open(&cutting_settings(2, false, false)).expect("it stands");
    assert_eq!(bench.value(JET), 0);
    assert_eq!(off(&bench.period()), Some((JET_BIT, CutterOffCause::EpochOpened)));
    bench.light(JET);
    bench.card.close().expect("it stands");
    assert_eq!(bench.value(JET), 0);
    assert_eq!(
        bench.card.accept(HostCommand::ManualOutput(OutputChange { channel: JET, value: 1 })),
        Err(CommandRefusal::Unsupported)
    );
}

#[test]
fn an_opening_that_takes_a_channel_off_the_list_puts_it_out_too() {
    let mut bench = Bench::cutting(false, JET);
    bench.rate(Rate::ZERO);
    bench.rest();
    bench.card.open(&settings(2, 0)).expect("it stands");
    assert_eq!(bench.value(JET), 0);
}

#[test]
fn a_dry_run_keeps_fire_and_auxiliary_channels_off_and_blocks_nothing() {
    let mut bench = Bench::new(false, true);
    bench.rate(Rate::ONE);
    let mut instruction = Instruction { number: 1, periods: 5, count: 4, ..Instruction::default() };
    for (slot, channel) in instruction.changes.iter_mut().zip([TORCH, JET, ABRASIVE, 5]) {
        *slot = OutputChange { channel, value: 1 };
    }
    bench.send(HostCommand::Instruction(instruction));
    for _ in 0..50 {
        let status = bench.period();
        let values = [TORCH, JET, ABRASIVE, 5].map(|channel| bench.value(channel));
        assert_eq!((values, status.cutter_off, status.blocked), ([0, 0, 0, 1], None, false));
    }
    assert!(bench.status().place.record.number() > 30);
    assert_eq!(
        bench.card.accept(HostCommand::ManualOutput(OutputChange { channel: ABRASIVE, value: 1 })),
        Err(CommandRefusal::Unsupported)
    );
}

#[test]
fn a_torch_is_not_lit_by_hand_at_rest() {
    let mut bench = Bench::new(false, false);
    assert_eq!(
        bench.card.accept(HostCommand::ManualOutput(OutputChange { channel: TORCH, value: 1 })),
        Err(CommandRefusal::Unsupported)
    );
    bench.send(HostCommand::ManualOutput(OutputChange { channel: JET, value: 1 }));
    assert_eq!(bench.until_off(JET).0, u32::from(JET_GRACE) + 1);
}

#[test]
fn a_gap_between_two_repeats_is_bounded_and_the_block_then_stays() {
    let mut bench = Bench::cutting(false, TORCH);
    bench.rate(Rate::ZERO);
    bench.rest();
    bench.periods(3);
    bench.rate(Rate::ONE);
    bench.send(HostCommand::Restart { last: 2 });
    bench.send(repeat(1, TORCH, 1, 5));
    bench.periods(5 + u32::from(HANDOVER));
    assert_eq!((bench.value(TORCH), bench.status().repeated), (1, 1));
    bench.period();
    assert_eq!(bench.value(TORCH), 0);
    bench.send(repeat(2, ABRASIVE, 1, 0));
    bench.periods(30);
    assert!(bench.status().blocked && bench.status().at_rest, "what was begun before it went out does not release it");
}

#[test]
fn a_repeat_is_refused_under_an_alarm_and_in_motion() {
    let mut bench = Bench::cutting(false, TORCH);
    assert_eq!(bench.card.accept(repeat(1, TORCH, 1, 5)), Err(CommandRefusal::InMotion));
    bench.levels = STOP;
    bench.rest();
    assert_eq!(bench.card.accept(repeat(1, TORCH, 1, 5)), Err(CommandRefusal::Alarm));
}

/// A cutter that must not be on in reverse is not lit by hand either while reverse run is requested, although the
/// machine stands at the oldest record.
#[test]
fn nothing_is_lit_by_hand_where_reverse_run_is_requested() {
    let lit = OutputChange { channel: JET, value: 1 };
    for (target, accepted) in [(-Rate::ONE, false), (Rate::ZERO, true), (Rate::ONE, true)] {
        let mut bench = Bench::new(false, false);
        bench.rate(-Rate::ONE);
        assert!(bench.period().at_rest);
        bench.rate(target);
        assert_eq!(bench.card.accept(HostCommand::ManualOutput(lit)).is_ok(), accepted, "{target:?}");
        assert_eq!(bench.value(JET), i32::from(accepted));
    }
    let mut bench = Bench::new(true, false);
    bench.rate(-Rate::ONE);
    bench.card.accept(HostCommand::ManualOutput(lit)).expect("it may be on in reverse");
}

fn pulse(number: u32, channel: u8, periods: u32) -> HostCommand<2> {
    match repeat(number, channel, 1, periods) {
        HostCommand::Repeat(repeated) => HostCommand::Repeat(RepeatedInstruction { is_pulse: true, ..repeated }),
        other => other,
    }
}

#[test]
fn a_test_pulse_is_as_long_as_stated_and_nothing_moves_in_it() {
    for channel in [TORCH, JET] {
        let mut bench = Bench::new(false, false);
        bench.send(pulse(1, channel, 25));
        bench.rate(Rate::ONE);
        for n in 1..25 {
            let status = bench.period();
            assert_eq!((bench.value(channel), status.rate, status.repeated), (1, Rate::ZERO, 0), "{n}");
        }
        let status = bench.period();
        assert_eq!((bench.value(channel), status.repeated, status.blocked), (0, 1, false));
        assert!(bench.period().rate > Rate::ZERO, "what is requested begins behind it");
        bench.rest();
    }
}

#[test]
fn a_test_pulse_ends_by_hand_and_is_refused_where_it_is_too_long_or_the_machine_moves() {
    let mut bench = Bench::new(false, false);
    bench.send(pulse(1, TORCH, 1000));
    bench.periods(10);
    assert_eq!(bench.value(TORCH), 1);
    bench.send(HostCommand::ManualOutput(OutputChange { channel: TORCH, value: 0 }));
    assert_eq!(bench.value(TORCH), 0);
    let status = bench.period();
    assert_eq!((status.repeated, status.blocked, status.cutter_off), (1, false, None));
    // a period is 1 ms
    assert_eq!(bench.card.accept(pulse(2, TORCH, 3001)), Err(CommandRefusal::Unsupported));
    assert_eq!(bench.card.accept(pulse(2, TORCH, 0)), Ok(()));
    assert_eq!((bench.value(TORCH), bench.status().repeated), (0, 2));
    let mut bench = Bench::cutting(false, JET);
    assert_eq!(bench.card.accept(pulse(1, TORCH, 10)), Err(CommandRefusal::InMotion));
    let mut dry = Bench::new(false, true);
    dry.send(pulse(1, TORCH, 10));
    dry.period();
    assert_eq!(dry.value(TORCH), 0, "a dry run");
}
