//! Epochs that take up a path where the machine stands: whatever interrupts a job, and wherever, it is gone on with as
//! if nothing had been.
//!
//! Invariant: what is expected is reckoned from the path alone, without the card.

use crate::common;

use common::{TestCard, levels, moved, opened, rates, record, rests_before, settings};
use proptest::prelude::*;
use retrace_core::{Distance, Place, Rate, RecordIndex};
use retrace_link::{
    Alarm, CardCore, CardSettings, CommandRefusal, HostCommand, Instruction, OutputAction, OutputChange, PathStart,
    channel,
};

/// Records of the job; exclusive instructions stand before every 32nd, output actions at every 9th.
const RECORDS: u32 = 256;
const EVERY: u32 = 32;
const ACTS: u32 = 9;
/// The output that the actions count on.
const COUNTER: u8 = 4;

/// A host that has the whole path, and does not know more of the card than its report and its greeting say.
struct Host {
    card: TestCard,
    first: u32,
    epoch: u16,
    base: [i64; 2],
    /// What the instructions switched, in the order in which they did.
    switched: Vec<i32>,
    acted: Vec<i32>,
    /// The values that were seen last of what they switch.
    shown: [i32; 2],
}

impl Host {
    fn new(first: u32, base: [i64; 2]) -> Self {
        let mut card = opened(first);
        // the counts are not 0 where a job begins
        card.accept(HostCommand::Ahead {
            place: RecordIndex::new(first),
            record: retrace_core::Record { increments: base.map(|b| b as i16), ..record(15) },
        })
        .expect("room");
        card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
        while Place::start_of(RecordIndex::new(first)).distance_to(card.status().place) < Distance::RECORD {
            card.keep_alive();
            card.run_period(levels(0));
        }
        card.open(&settings(2, first)).expect("at rest");
        Self { card, first, epoch: 2, base, switched: Vec::new(), acted: Vec::new(), shown: [0; 2] }
    }

    fn end(&self) -> u32 {
        self.first.wrapping_add(RECORDS)
    }

    fn place_of(&self, instruction: u32) -> u32 {
        self.first.wrapping_add((instruction - 1) * EVERY)
    }

    /// The record, with a planned stop where an instruction stands behind it.
    fn record(&self, place: u32) -> retrace_core::Record<2> {
        let number = place.wrapping_sub(self.first).wrapping_add(1);
        let mut record = record(place);
        if number.is_multiple_of(EVERY) {
            record.flags = retrace_core::Flags::REST;
        }
        record
    }

    fn rests_before(&self, place: u32) -> bool {
        place.wrapping_sub(self.first).is_multiple_of(EVERY) || rests_before(place, self.first)
    }

    /// Sends what the card has room for: instructions that are due, then records, as far as they may be.
    fn feed(&mut self) {
        let status = *self.card.status();
        let next = status.executed + 1;
        let gate = if next * EVERY > RECORDS { self.end() } else { self.place_of(next) };
        if RecordIndex::new(gate).is_before(RecordIndex::new(self.end())) {
            let mut instruction = Instruction {
                number: next,
                place: RecordIndex::new(gate),
                periods: next % 3,
                count: 1,
                ..Instruction::default()
            };
            instruction.changes[0] = OutputChange { channel: channel::SPEED, value: next as i32 };
            let _ = self.card.accept(HostCommand::Instruction(instruction));
        }
        for _ in 0..20 {
            let place = self.card.status().high;
            if place == RecordIndex::new(gate) {
                break;
            }
            let offset = place.since(RecordIndex::new(self.first));
            if offset.is_multiple_of(ACTS) {
                let (before, after) = ((offset / ACTS) as i32, (offset / ACTS) as i32 + 1);
                self.card
                    .accept(HostCommand::Action(OutputAction { place, channel: COUNTER, before, after }))
                    .expect("room");
            }
            if self.card.accept(HostCommand::Ahead { place, record: self.record(place.number()) }).is_err() {
                break;
            }
        }
        for _ in 0..10 {
            let place = self.card.status().low - 1;
            if place.is_before(RecordIndex::new(self.first)) {
                break;
            }
            let command = HostCommand::Behind {
                place,
                record: self.record(place.number()),
                rests: self.rests_before(place.number()),
            };
            if self.card.accept(command).is_err() {
                break;
            }
        }
    }

    fn period(&mut self, keep_alive: bool) {
        if keep_alive {
            self.card.keep_alive();
        }
        let was = *self.card.status();
        self.card.run_period(levels(0));
        let now = *self.card.status();
        let shown = [channel::SPEED, COUNTER].map(|output| now.outputs[usize::from(output)]);
        for ((now, was), log) in shown.into_iter().zip(&mut self.shown).zip([&mut self.switched, &mut self.acted]) {
            if now != *was {
                (*was, _) = (now, log.push(now));
            }
        }
        let walked = moved(self.first, now.place);
        assert_eq!(now.counts, [self.base[0] + walked[0], self.base[1] + walked[1]], "off the path at {:?}", now.place);
        assert!(!now.reached.is_before(was.reached) && !now.reached.is_before(now.place.boundary_ahead()));
        assert!((now.executed.wrapping_sub(was.executed) as i32) >= 0, "executed goes back");
    }

    /// Stands, however it came to: by the host's word, or by its silence.
    fn interrupt(&mut self, silent: bool) {
        if !silent {
            self.card.accept(HostCommand::rate(Rate::ZERO)).expect("a rate");
        }
        for _ in 0..120 {
            self.period(!silent);
        }
        assert!(self.card.status().at_rest && (self.card.status().alarm == Some(Alarm::HostSilent)) == silent);
    }

    /// A host that knows nothing but the job and what the card says of itself goes on.
    fn begin(&mut self) {
        let result = *self.card.status();
        self.epoch += 1;
        let rests = result.place.fraction == 0 && self.rests_before(result.place.record.number());
        let start = PathStart {
            place: result.place,
            rests,
            reached: result.reached,
            executed: result.executed,
            keeps_state: false,
        };
        self.card.open(&CardSettings { start, ..settings(self.epoch, 0) }).expect("it stands");
        let now = *self.card.status();
        assert_eq!((now.place, now.reached, now.executed), (result.place, result.reached, result.executed));
        assert_eq!((now.counts, now.outputs), (result.counts, result.outputs));
        assert_eq!((now.low, now.high), (result.place.record, result.place.record));
        self.card.accept(HostCommand::ClearAlarm).expect("nothing is wrong any more");
        assert_eq!(self.card.status().alarm, None);
        // Neither way is there anything to run on yet.
        for target in [Rate::ONE, -Rate::ONE] {
            self.card.accept(HostCommand::rate(target)).expect("a rate");
            for _ in 0..3 {
                self.period(true);
                assert_eq!((self.card.status().place, self.card.status().at_rest), (result.place, true));
                assert!(self.card.status().starved || result.place.fraction == 0);
            }
        }
        self.card.accept(HostCommand::rate(Rate::ZERO)).expect("a rate");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Interrupted anywhere, between two records and in one, on the way forward and backward, by a word and by silence:
    /// at every place the counts are those of the path, every instruction and every action is carried out once, in its
    /// order.
    #[test]
    fn what_is_interrupted_goes_on_as_if_nothing_had_been(
        first in any::<u32>(),
        base in prop::array::uniform2(-200i64..200),
        legs in prop::collection::vec(
            (prop_oneof![3 => Just(Rate::ONE), 2 => Just(-Rate::ONE), 1 => Just(Rate::ONE / 2), 2 => rates(-1, 2)],
                1u32..120, any::<bool>(), prop::bool::weighted(0.6)),
            1..14,
        ),
    ) {
        let mut host = Host::new(first, base);
        for (target, periods, silent, interrupted) in legs {
            host.card.accept(HostCommand::rate(target)).expect("a rate");
            for _ in 0..periods {
                host.feed();
                host.period(true);
            }
            if interrupted {
                host.interrupt(silent);
                host.begin();
            }
        }
        host.card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
        for _ in 0..1500 {
            host.feed();
            host.period(true);
        }
        let status = *host.card.status();
        prop_assert_eq!(status.place, Place::start_of(RecordIndex::new(host.end())));
        prop_assert_eq!(status.executed, RECORDS / EVERY);
        prop_assert_eq!(&host.switched, &(1..=status.executed as i32).collect::<Vec<_>>());
        prop_assert_eq!(&host.acted, &(1..=(RECORDS.div_ceil(ACTS)) as i32).collect::<Vec<_>>());
    }
}

/// What an epoch cannot begin with is refused, and nothing has changed then.
#[test]
fn a_start_that_contradicts_itself_is_refused() {
    let mut card = opened(7);
    let before = *card.status();
    let inside = Place { record: RecordIndex::new(7), fraction: 1 };
    let good = PathStart { place: inside, rests: false, reached: RecordIndex::new(8), executed: 5, keeps_state: false };
    let bad = [
        PathStart { reached: RecordIndex::new(7), ..good },
        PathStart { reached: RecordIndex::new(8u32.wrapping_sub(1 << 31)), ..good },
        PathStart { rests: true, ..good },
        PathStart { place: Place::start_of(RecordIndex::new(9)), ..good },
    ];
    for start in bad {
        assert_eq!(card.open(&CardSettings { start, ..settings(2, 0) }), Err(CommandRefusal::Unsupported), "{start:?}");
        assert_eq!(*card.status(), before);
    }
    card.open(&CardSettings { start: good, ..settings(2, 0) }).expect("good");
    let at = |number, place| HostCommand::Instruction(Instruction { number, place, ..Instruction::default() });
    assert_eq!(card.accept(at(6, RecordIndex::new(7))), Err(CommandRefusal::OutOfOrder), "where it has been");
    assert_eq!(
        (card.accept(at(5, RecordIndex::new(8))), card.accept(at(7, RecordIndex::new(8)))),
        (Err(CommandRefusal::Busy), Err(CommandRefusal::Busy))
    );
    card.accept(at(6, RecordIndex::new(8))).expect("the next, at the furthest place");
}

/// In the middle of a motion the path is left with a ramp, at a planned stop at full rate: also where an epoch begins
/// there.
#[test]
fn a_path_in_motion_is_not_left_at_full_rate() {
    let rate_after = |rests: bool| -> Rate {
        let mut card = opened(0);
        let start = PathStart { rests, ..PathStart::at(RecordIndex::new(20)) };
        card.open(&CardSettings { start, ..settings(2, 0) }).expect("good");
        for place in 20..84 {
            let record = retrace_core::Record { increments: [20, 0], ..record(0) };
            card.accept(HostCommand::Ahead { place: RecordIndex::new(place), record }).expect("room");
        }
        card.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
        card.keep_alive();
        card.run_period(levels(0)).rate
    };
    assert_eq!(rate_after(true), Rate::ONE);
    assert!(rate_after(false) < Rate::ONE / 10);
}
