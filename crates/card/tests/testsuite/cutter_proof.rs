//! The input that proves a cutter: attempts at starting it, the pierce, its loss, and contacts that lie (CUT-5, CUT-13,
//! CUT-30, CUT-31).
//!
//! Invariant: what is asserted is what the card reports at the end of a period.

use crate::common;

use common::{TestCard, identity, levels, settings};
use proptest::prelude::*;
use retrace_core::{Flags, Place, Rate, Record, RecordIndex};
use retrace_link::{
    Alarm, CardCore, CardSettings, CardStatus, CutterOffCause, CuttingChannel, CuttingSettings, HostCommand, Ignition,
    InputWait, Instruction, MAX_CHANGES, OutputAction, OutputChange, ProofInput, RepeatedInstruction, channel,
};

const TORCH: u8 = channel::SPINDLE;
/// Input of the arc.
const PROOF: u8 = 5;

#[derive(Clone, Copy, Debug)]
struct Source {
    proven_periods: u16,
    lost_periods: u16,
    out_periods: u16,
    /// Of the ignition.
    timeout_periods: u32,
    ignition: Ignition,
}

const SOURCE: Source = Source {
    proven_periods: 3,
    lost_periods: 4,
    out_periods: 0,
    timeout_periods: 20,
    ignition: Ignition { stable_periods: 3, attempts: 3, retry_periods: 7, delay_periods: 9 },
};

fn torch_settings(epoch: u16, of: Source) -> CardSettings<2> {
    let mut settings = settings(epoch, 0);
    settings.safe_count = 0;
    let Source { proven_periods, lost_periods, out_periods, .. } = of;
    let proof = Some(ProofInput { input: PROOF, proven_periods, lost_periods, out_periods });
    settings.cutting = CuttingSettings { count: 1, handover_periods: 10, ..CuttingSettings::default() };
    settings.cutting.channels[0] = CuttingChannel { channel: TORCH, fires: true, proof, ..CuttingChannel::default() };
    settings
}

/// A card with a torch whose arc the test makes and breaks.
struct Bench {
    card: TestCard,
    source: Source,
    arc: bool,
}

impl Bench {
    fn new(source: Source) -> Self {
        let mut card = TestCard::new(identity()).expect("a memory");
        card.open(&torch_settings(1, source)).expect("fit");
        let mut bench = Self { card, source, arc: false };
        for place in 0..60 {
            let flags = if place == 59 { Flags::REST } else { Flags::NONE };
            let record = Record { increments: [5, 0], flags, ..Record::default() };
            bench.send(HostCommand::Ahead { place: RecordIndex::new(place), record });
        }
        bench
    }

    fn status(&self) -> CardStatus<2> {
        *self.card.status()
    }

    fn send(&mut self, command: HostCommand<2>) {
        self.card.accept(command).expect("it is accepted");
    }

    fn period(&mut self) -> CardStatus<2> {
        self.card.keep_alive();
        *self.card.run_period(levels(u16::from(self.arc) << PROOF))
    }

    fn is_on(&self) -> bool {
        self.status().outputs[usize::from(TORCH)] != 0
    }

    fn wait(&self) -> InputWait {
        InputWait { ignition: Some(self.source.ignition), ..InputWait::new(PROOF, true, self.source.timeout_periods) }
    }

    fn changes() -> [OutputChange; MAX_CHANGES] {
        let mut changes = [OutputChange::default(); MAX_CHANGES];
        changes[0] = OutputChange { channel: TORCH, value: 1 };
        changes
    }

    /// Sends M3 for the place of the cursor, and asks for motion.
    fn start(&mut self) {
        let (number, place) = (self.status().executed + 1, self.status().place.record);
        let until = Some(self.wait());
        let instruction = Instruction {
            number,
            place,
            changes: Self::changes(),
            count: 1,
            until,
            keeps_cutter: true,
            ..Instruction::default()
        };
        self.send(HostCommand::Instruction(instruction));
        self.send(HostCommand::rate(Rate::ONE / 4));
    }

    /// Sends the repeated M3 of a restart.
    fn repeat(&mut self) {
        let number = self.status().repeated + 1;
        let until = Some(self.wait());
        self.send(HostCommand::Restart { last: number });
        let repeated =
            RepeatedInstruction { number, changes: Self::changes(), count: 1, until, ..RepeatedInstruction::default() };
        self.send(HostCommand::Repeat(repeated));
    }

    /// Runs with the torch proven and lit, inside the path.
    fn cutting(source: Source) -> Self {
        let mut bench = Self::new(source);
        bench.start();
        bench.period();
        bench.arc = true;
        while bench.status().executed == 0 {
            bench.period();
        }
        for _ in 0..20 {
            bench.period();
        }
        assert!(bench.is_on() && bench.status().rate > Rate::ZERO);
        bench
    }
}

/// What a start did: the periods in which the torch was on, one letter each, up to its end.
fn start_with_arc(source: Source, arc_in_attempt: u8, after: u32) -> (String, CardStatus<2>) {
    let mut bench = Bench::new(source);
    bench.start();
    let (mut trace, mut attempt, mut lit) = (String::new(), 0, 0);
    for _ in 0..2000 {
        if bench.is_on() {
            attempt += u8::from(lit == 0);
            lit += 1;
        } else {
            lit = 0;
        }
        bench.arc = attempt == arc_in_attempt && lit > after;
        let status = bench.period();
        trace.push(if bench.is_on() { '#' } else { '.' });
        if status.executed == 1 || status.blocked {
            return (trace, status);
        }
        assert!(status.at_rest, "feed before the cutter is ready");
    }
    panic!("neither started nor given up: {trace}");
}

#[test]
fn a_start_without_an_arc_is_tried_as_often_as_it_may_be() {
    let (trace, status) = start_with_arc(SOURCE, 9, 0);
    let attempt = "#".repeat(19);
    let between = format!(".{}", ".".repeat(6));
    assert_eq!(trace, format!("{attempt}{between}#{attempt}{between}#{attempt}."));
    let off = status.cutter_off.expect("reported");
    assert_eq!((off.channels, off.cause), (1, CutterOffCause::NotStarted));
    assert_eq!((status.alarm, status.blocked, status.executed), (None, true, 0), "no alarm");
}

proptest! {
    /// In whatever attempt the arc comes: the instruction is complete after proof and pierce, and not before.
    #[test]
    fn a_start_is_complete_after_the_proof_and_the_pierce(attempt in 1u8..=3, after in 0u32..17, delay in 0u32..30) {
        let ignition = Ignition { delay_periods: delay, ..SOURCE.ignition };
        let (trace, status) = start_with_arc(Source { ignition, ..SOURCE }, attempt, after);
        prop_assert_eq!((status.executed, status.blocked, status.cutter_off), (1, false, None));
        let lit = trace.len() - trace.rfind('.').map_or(0, |at| at + 1);
        // the arc comes after the period in which the torch is switched on
        prop_assert_eq!(lit as u32, 1 + after + 3 + delay, "{}", trace);
        prop_assert_eq!(trace.split('.').filter(|part| !part.is_empty()).count(), usize::from(attempt));
    }

    /// The input may be inactive for one period less than counts as a loss, as often as it likes; the card then knows
    /// the place where it began.
    #[test]
    fn a_flicker_is_no_loss_and_a_loss_is_placed(flickers in 0u32..5, length in 1u16..4, lost in 1u16..8) {
        let source = Source { lost_periods: lost, ..SOURCE };
        let mut bench = Bench::cutting(source);
        for _ in 0..flickers {
            bench.arc = false;
            for _ in 0..length.min(lost - 1) {
                prop_assert!(bench.period().cutter_off.is_none());
            }
            bench.arc = true;
            prop_assert!(bench.period().cutter_off.is_none());
        }
        let place = bench.status().place;
        bench.arc = false;
        for _ in 1..lost {
            prop_assert!(bench.period().cutter_off.is_none() && bench.is_on());
        }
        let status = bench.period();
        let off = status.cutter_off.expect("lost");
        prop_assert_eq!((off.channels, off.cause, off.place), (1, CutterOffCause::Lost, place));
        prop_assert!(!bench.is_on() && status.blocked && status.alarm.is_none());
        // the machine comes to rest, and stays there whatever is requested
        for _ in 0..200 {
            bench.period();
            prop_assert!(!bench.is_on());
        }
        let rests = bench.status();
        prop_assert!(rests.at_rest);
        bench.send(HostCommand::rate(Rate::ONE));
        for _ in 0..50 {
            prop_assert_eq!(bench.period().place, rests.place);
        }
    }
}

#[test]
fn a_cutter_that_is_lost_in_its_pierce_is_started_anew() {
    let mut bench = Bench::new(SOURCE);
    bench.start();
    bench.period();
    bench.arc = true;
    for _ in 0..6 {
        bench.period();
    }
    assert!(bench.is_on() && bench.status().executed == 0, "it pierces");
    bench.arc = false;
    let off = (0..4).find_map(|_| bench.period().cutter_off).expect("lost");
    assert_eq!((off.cause, off.place), (CutterOffCause::Lost, Place::start_of(RecordIndex::new(0))));
    for _ in 0..50 {
        bench.period();
        assert!(!bench.is_on() && bench.status().executed == 0);
    }
    // the block is released, and the instruction is sent again: it begins from its beginning
    bench.send(HostCommand::Restart { last: bench.status().repeated });
    bench.period();
    assert!(!bench.is_on());
    bench.start();
    bench.period();
    assert!(bench.is_on());
    bench.arc = true;
    let periods = (1..100).find(|_| bench.period().executed == 1).expect("complete");
    assert_eq!(periods, 3 + 9);
}

#[test]
fn an_action_does_not_light_a_cutter_that_was_lost() {
    let mut bench = Bench::cutting(SOURCE);
    let place = bench.status().place.record + 3;
    bench.send(HostCommand::Action(OutputAction { place, channel: TORCH, before: 1, after: 1 }));
    bench.send(HostCommand::rate(Rate::ONE));
    while bench.status().place.record.is_before(place - 2) {
        bench.period();
    }
    bench.arc = false;
    while !bench.period().blocked {}
    for _ in 0..200 {
        bench.period();
        assert!(!bench.is_on());
    }
    assert!(!bench.status().place.record.is_before(place), "the action was passed");
}

#[test]
fn a_restart_repeats_the_attempts_and_may_fail() {
    let mut bench = Bench::cutting(SOURCE);
    bench.arc = false;
    while !bench.period().at_rest {}
    let place = bench.status().place;
    bench.repeat();
    let off = (0..200).find_map(|_| bench.period().cutter_off).expect("not started");
    assert_eq!((off.cause, off.channels), (CutterOffCause::NotStarted, 1));
    assert_eq!((bench.status().repeated, bench.status().blocked, bench.status().place), (0, true, place));
    bench.repeat();
    bench.period();
    bench.arc = true;
    let periods = (2..100).find(|_| !bench.period().blocked).expect("released");
    assert_eq!((periods, bench.status().repeated), (1 + 3 + 9, 1));
    assert!((0..100).any(|_| bench.period().rate > Rate::ZERO));
}

#[test]
fn a_contact_that_is_active_before_the_start_is_an_alarm() {
    let mut bench = Bench::new(SOURCE);
    bench.arc = true;
    bench.period();
    bench.start();
    for _ in 0..20 {
        bench.period();
        assert!(!bench.is_on());
    }
    assert_eq!(bench.status().alarm, Some(Alarm::ProvenBeforeStart { input: PROOF }));
    // and where a restart would light it
    let mut bench = Bench::cutting(SOURCE);
    bench.arc = false;
    while !bench.period().at_rest {}
    bench.arc = true;
    bench.period();
    let number = bench.status().repeated + 1;
    let until = Some(bench.wait());
    let repeated =
        RepeatedInstruction { number, changes: Bench::changes(), count: 1, until, ..RepeatedInstruction::default() };
    bench.send(HostCommand::Repeat(repeated));
    bench.period();
    assert!(!bench.is_on() && bench.status().repeated != number, "reported as an alarm, not as a refusal");
    assert_eq!(bench.status().alarm, Some(Alarm::ProvenBeforeStart { input: PROOF }));
}

#[test]
fn a_source_that_does_not_go_out_is_an_alarm() {
    for (out_periods, alarm) in [(0, None), (30, Some(Alarm::CutterStaysOn { input: PROOF }))] {
        let mut bench = Bench::cutting(Source { out_periods, ..SOURCE });
        bench.send(HostCommand::rate(Rate::ZERO));
        while bench.is_on() {
            bench.period();
        }
        for _ in 1..30 {
            bench.period();
            assert_eq!(bench.status().alarm, None);
        }
        bench.period();
        assert_eq!(bench.status().alarm, alarm);
    }
}

#[test]
fn a_cutter_that_is_switched_off_in_its_start_is_not_lit_again() {
    // also in the very period in which it arrives, and between two attempts
    for periods in [0, 1, 10, 22, 40] {
        let mut bench = Bench::new(SOURCE);
        bench.start();
        for _ in 0..periods {
            bench.period();
        }
        bench.send(HostCommand::ManualOutput(OutputChange { channel: TORCH, value: 0 }));
        let told = (0..200).filter(|_| {
            let status = bench.period();
            assert!(!bench.is_on() && status.at_rest, "after {periods} periods");
            status.cutter_off.is_some_and(|off| off.cause == CutterOffCause::NotStarted)
        });
        assert_eq!(told.count(), 1);
        assert!(bench.status().blocked && bench.status().executed == 0);
    }
}

/// A jet without an input only takes its time. The same holds for it, and for a restart.
#[test]
fn the_start_of_a_jet_that_is_switched_off_is_cancelled() {
    let off = HostCommand::ManualOutput(OutputChange { channel: TORCH, value: 0 });
    let mut bench = Bench::new(SOURCE);
    let (number, place, changes) = (1, bench.status().place.record, Bench::changes());
    bench.send(HostCommand::Instruction(Instruction {
        number,
        place,
        changes,
        count: 1,
        periods: 20,
        until: None,
        keeps_cutter: true,
        layer: None,
        spindle: None,
    }));
    bench.send(HostCommand::rate(Rate::ONE));
    for _ in 0..5 {
        bench.period();
    }
    assert!(bench.is_on());
    bench.send(off);
    let cancelled = bench.period().cutter_off.expect("told");
    assert_eq!((cancelled.channels, cancelled.cause), (0, CutterOffCause::NotStarted));
    for _ in 0..100 {
        let status = bench.period();
        assert!(!bench.is_on() && status.place == Place::start_of(place) && status.executed == 0);
    }
    bench.send(HostCommand::Restart { last: number });
    bench.send(HostCommand::Repeat(RepeatedInstruction {
        number,
        changes,
        count: 1,
        periods: 20,
        ..RepeatedInstruction::default()
    }));
    bench.period();
    assert!(bench.is_on());
    bench.send(off);
    for _ in 0..100 {
        let status = bench.period();
        assert!(!bench.is_on() && status.place == Place::start_of(place) && status.repeated == 0);
    }
}

proptest! {
    /// While the program ignores the input, nothing is lost, whatever the input does; watched again, the torch is lost
    /// where the input is inactive for the time of a loss (CUT-33).
    #[test]
    fn an_ignored_input_loses_nothing_and_is_watched_again(arcs in prop::collection::vec(any::<bool>(), 1..60)) {
        let mut bench = Bench::cutting(SOURCE);
        bench.send(HostCommand::ManualOutput(OutputChange { channel: channel::UNWATCHED, value: 1 }));
        for arc in arcs {
            bench.arc = arc;
            bench.period();
            prop_assert!(bench.is_on());
        }
        bench.send(HostCommand::ManualOutput(OutputChange { channel: channel::UNWATCHED, value: 0 }));
        bench.arc = false;
        for _ in 1..SOURCE.lost_periods {
            bench.period();
            prop_assert!(bench.is_on());
        }
        let status = bench.period();
        prop_assert!(!bench.is_on());
        prop_assert_eq!(status.cutter_off.map(|off| off.cause), Some(CutterOffCause::Lost));
    }
}

/// The beginning and the end of an epoch, and a fault: the loss is watched again before a cutter can be on (CUT-33).
#[test]
fn an_epoch_begins_with_the_loss_watched() {
    let mut bench = Bench::cutting(SOURCE);
    bench.send(HostCommand::ManualOutput(OutputChange { channel: channel::UNWATCHED, value: 1 }));
    bench.period();
    bench.send(HostCommand::rate(Rate::ZERO));
    while !bench.status().at_rest || bench.is_on() {
        bench.period();
    }
    assert_eq!(bench.status().outputs[usize::from(channel::UNWATCHED)], 1, "a hold changes nothing");
    bench.card.open(&torch_settings(2, SOURCE)).expect("fits");
    bench.period();
    assert_eq!(bench.status().outputs[usize::from(channel::UNWATCHED)], 0);
}
