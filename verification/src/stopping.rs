//! The stopping distance: what a card may drop, end or fence off ahead of a cursor in motion (REV, *Braking to a
//! place*).
//!
//! Invariant: a stop is judged from the places of the cursor and the records alone; nothing here asks the card how far
//! it needs to stop.

use crate::choice::{Choice, ONE};
use crate::harness::harnesses;
use crate::ledger::{Mutant, Row, Search, Size};
use crate::native::Draw;
use retrace_card::Player;
use retrace_core::drive::Braking;
use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Distance, Place, RapidCap, Rate, Record, RecordIndex};
use retrace_link::{HostCommand, Instruction};

/// Records of the card's window.
const WINDOW: u32 = 256;
/// Maximum velocity of the axis, in pulses per period.
const VELOCITY: u64 = 960;

type Card = Player<1, { WINDOW as usize }, 64>;

/// A card in motion over records that all have the same increment, the largest that their cap allows. So nothing but a
/// change of the rate accelerates the axis.
#[derive(Clone)]
struct Ride {
    card: Box<Card>,
    limits: RateLimits<1>,
    record: Record<1>,
}

impl Ride {
    /// Any machine whose plan uses one of the shares, and any motion of up to 300 periods on it, away from every
    /// planned stop.
    fn any(draw: &mut Draw, shares: &[u16]) -> Self {
        // the ramp from rate one takes 8 to 64 periods
        let acceleration = (VELOCITY << 32) / (8 + u64::from(draw.below(57)));
        let average = 2 * draw.below(13) as u16 + 1;
        let jerk = (acceleration.div_ceil(average.into())) * (1 + u64::from(draw.below(3)));
        let share = shares[draw.below(shares.len() as u32) as usize];
        let limits = RateLimits::new(average, share, [PulseLimits { velocity: VELOCITY << 32, acceleration, jerk }]);
        let limits = limits.expect("valid");
        let cap = [16, 17, 24, 32, 64, 128][draw.below(6) as usize];
        let increment = (VELOCITY * 16 / cap) as i16;
        let record = Record { increments: [increment], cap: RapidCap::sixteenths(cap as u8), ..Record::default() };
        let start = RecordIndex::new(draw.word());
        let mut ride = Self { card: Box::new(Card::new(start, limits).expect("fits")), limits, record };
        let behind = 1 + draw.below(WINDOW - 1);
        (0..behind).for_each(|_| assert!(ride.extend_behind(), "an empty window has room"));
        (0..WINDOW - behind).for_each(|_| assert!(ride.extend_ahead(), "a window that is not full has room"));
        let highest = if draw.flag() { (cap as i64) << 28 } else { ONE };
        for _ in 0..=draw.below(3) {
            let rate = [highest, -highest, draw.between(-highest, highest)][draw.below(3) as usize];
            ride.request(Rate::from_units(rate));
            for _ in 0..draw.below(100) {
                ride.card.run_period();
            }
        }
        ride
    }

    fn at(&self) -> Place {
        self.card.status().place
    }

    fn request(&mut self, rate: Rate) {
        self.card.accept(HostCommand::rate(rate)).expect("a rate is always accepted");
    }

    fn extend_ahead(&mut self) -> bool {
        let place = self.card.status().high;
        self.card.accept(HostCommand::Ahead { place, record: self.record }).is_ok()
    }

    fn extend_behind(&mut self) -> bool {
        let place = self.card.status().low - 1;
        self.card.accept(HostCommand::Behind { place, record: self.record, rests: false }).is_ok()
    }

    fn trim(&mut self, high: RecordIndex) -> bool {
        self.card.accept(HostCommand::Trim { high }).is_ok()
    }

    fn forget(&mut self, low: RecordIndex) -> bool {
        self.card.accept(HostCommand::Forget { low }).is_ok()
    }

    fn fence(&mut self, place: RecordIndex) -> bool {
        self.card.accept(HostCommand::Instruction(Instruction { number: 1, place, ..Instruction::default() })).is_ok()
    }

    /// Takes away as many records as the card allows, in a drawn manner. Returns whether it took away any.
    fn cut(&mut self, draw: &mut Draw) -> bool {
        let (low, high, at) = (self.card.status().low, self.card.status().high, self.at());
        let ahead = |n: u32| at.boundary_ahead() + n;
        match draw.below(5) {
            0 => (0..high.since(at.boundary_ahead())).any(|n| self.trim(ahead(n))),
            1 => (0..at.record.since(low)).any(|n| self.forget(at.record - n)),
            2 => (0..high.since(at.boundary_ahead())).any(|n| self.fence(ahead(n))),
            3 => (0..WINDOW).take_while(|_| self.extend_ahead()).count() > 0,
            _ => (0..WINDOW).take_while(|_| self.extend_behind()).count() > 0,
        }
    }

    /// Runs until the card is at rest for want of records or of a rate, and checks that no period accelerates the axis
    /// by more than its limit, and that no record is missing.
    fn stops_within_the_limits(&mut self, what: &str) {
        let most = i128::from(self.limits.axes()[0].acceleration);
        let increment = i128::from(self.record.increments[0]);
        let (mut rate, mut resting) = (self.card.status().rate, 0);
        for _ in 0..4000 {
            let status = self.card.run_period();
            assert!(status.alarm.is_none(), "{what}: a record is missing at {:?}", status.place);
            let change = increment * i128::from((status.rate - rate).units().abs() - 2);
            assert!(change <= most + most / 1000, "{what}: {change} of {most} at {rate:?}");
            rate = status.rate;
            resting = if status.at_rest { resting + 1 } else { 0 };
            if resting > 2 {
                return;
            }
        }
    }
}

/// Whatever the card lets a host take away, the cursor then stops within the limits of the axis: with the rate
/// unchanged, zero, reversed or any other.
fn cuts_leave_room_to_stop(size: Size) -> String {
    let mut draw = Draw::new(size.seed);
    let (runs, mut cuts) = (if size.full { 20_000 } else { 4_000 }, 0u64);
    for _ in 0..runs {
        let mut ride = Ride::any(&mut draw, &[64, 20_000, 45_000, 59_000]);
        let before = (ride.card.status().rate, ride.at(), ride.card.status().low, ride.card.status().high);
        if ride.card.status().at_rest || !ride.cut(&mut draw) {
            continue;
        }
        cuts += 1;
        match draw.below(4) {
            0 => {}
            1 => ride.request(Rate::ZERO),
            2 => ride.request(-Rate::MAX),
            _ => ride.request(Rate::MAX),
        }
        let after = (ride.card.status().low, ride.card.status().high);
        ride.stops_within_the_limits(&format!("{before:?} {after:?} {:?} {:?}", ride.limits, ride.record.cap));
    }
    format!("{cuts} changes of the window in {runs} drawn runs")
}

/// The card does not refuse what is plainly possible: on a machine that brakes at one slope, an end at four thirds of
/// the length of a hold and three records more is accepted.
fn cuts_beyond_a_hold_are_accepted(size: Size) -> String {
    let mut draw = Draw::new(size.seed);
    let (runs, mut cuts) = (if size.full { 20_000 } else { 4_000 }, 0u64);
    for _ in 0..runs {
        let mut ride = Ride::any(&mut draw, &[64]);
        // a run far below the cap, and a machine that stops within 32 periods, brake faster than an end may rely on
        let (cap, rate, axis) = (ride.record.cap, ride.card.status().rate.abs(), ride.limits.axes()[0]);
        if cap != RapidCap::PLANNED && rate < cap.rate() * 49 / 50 || axis.acceleration > axis.velocity / 32 {
            continue;
        }
        let (at, mut held) = (ride.at(), ride.clone());
        held.request(Rate::ZERO);
        while !held.card.run_period().at_rest {}
        let needed = at.distance_to(held.at());
        let reach = needed * 4 / 3 + Distance::records(3) * needed.signum();
        let end = at.moved(reach);
        let (accepted, held) = match needed.signum() {
            1 => (ride.trim(end.boundary_ahead()), !ride.card.status().high.is_before(end.boundary_ahead())),
            -1 => (ride.forget(end.record), !end.record.is_before(ride.card.status().low)),
            _ => continue,
        };
        if held {
            let settings = (rate, ride.limits, cap);
            assert!(accepted, "an end {reach:?} ahead is refused, a hold needs {needed:?}: {settings:?}");
            cuts += 1;
        }
    }
    format!("{cuts} ends in {runs} drawn runs")
}

/// A rate above one falls to one, and from one to rest, within the stop length of that rate and by no more than the
/// slopes: for every rate in steps, any requested rate, and drawn machines.
fn stop_length_covers_the_fall(size: Size) -> String {
    let mut draw = Draw::new(size.seed);
    let (machines, step, mut stops) = (if size.full { 150 } else { 20 }, ONE >> 7, 0u64);
    for _ in 0..machines {
        let acceleration = (VELOCITY << 32) / (1 + u64::from(draw.upto(400)));
        let jerk = acceleration.div_ceil(1 + u64::from(draw.below(33)));
        let axis = PulseLimits { velocity: VELOCITY << 32, acceleration, jerk };
        let limits = RateLimits::new(33, 1 + draw.upto(60_000) as u16, [axis]).expect("valid");
        let Some(braking) = Braking::<32>::new(&limits) else { continue };
        for units in (ONE + 1..=8 * ONE).step_by(step as usize) {
            let cap = ((units - 1) >> 28) as u8 + 1;
            for requested in [Rate::ZERO, Rate::ONE] {
                let mut rate = Rate::from_units(units);
                let mut free = braking.stop_length(rate);
                while rate > Rate::ZERO {
                    let least = rate - braking.slope(rate, if rate > Rate::ONE { cap } else { 16 });
                    let now = braking.max_rate_within(least.max(requested).min(rate), free);
                    assert!(now >= least.max(Rate::ZERO), "{now:?} after {rate:?}, {free:?} left: {limits:?}");
                    (rate, free) = (now, free - now.over(1));
                    assert!(free >= Distance::ZERO, "beyond the end: {limits:?}");
                }
                stops += 1;
            }
        }
    }
    format!("{stops} stops from rates of 1 to 8")
}

harnesses! {}

const BRAKING: &str = "crates/core/src/drive/braking.rs";
const PLAYER: &str = "crates/card/src/player.rs";

/// The rows of this module.
pub const ROWS: &[Row] = &[Row {
    name: "stopping-room",
    says: "The card accepts no change of its window (trim, forget, an instruction ahead, a record that replaces the \
        farthest one) after which the cursor cannot stop within the limits; and it refuses none that leaves four \
        thirds of the length of a hold and three records",
    requirement: "REV, Beyond the source, *Braking to a place*; REV-12",
    bound: "drawn runs on drawn machines: windows of 256 records, averages of 1 to 25 periods, rates to 8 in both \
        directions, every kind of change cut as close as the card allows, then the rate unchanged, zero, or the \
        highest in either direction; for the length of a stop from 1 to 8, every rate in steps of a 128th",
    assumes: "records have the largest increments that their cap allows; one axis; what is refused is compared on \
        machines that brake at one slope in 32 periods or more, at the planned rate or at the cap",
    suffices: "a sample. Where all records use the limits, a change of the rate has the least room; of several axes, \
        one decides the slope. A stop from a rate up to one is row drive-braking, and that the cursor stays in the \
        window is row drive-road",
    harnesses: &[],
    searches: &[
        Search { name: "stop-length", run: stop_length_covers_the_fall },
        Search { name: "cuts-leave-room", run: cuts_leave_room_to_stop },
        Search { name: "cuts-are-accepted", run: cuts_beyond_a_hold_are_accepted },
    ],
    models: &[],
    mutants: &[
        Mutant {
            name: "half the ramp counts as stopping distance",
            file: "crates/core/src/drive/mod.rs",
            find: "signed(rate.signum(), self.braking.stop_length(rate.abs()))",
            put: "signed(rate.signum(), self.braking.stop_length(rate.abs()) / 2)",
            killer: "cuts-leave-room",
        },
        Mutant {
            name: "twice the ramp counts as stopping distance",
            file: "crates/core/src/drive/mod.rs",
            find: "signed(rate.signum(), self.braking.stop_length(rate.abs()))",
            put: "signed(rate.signum(), self.braking.stop_length(rate.abs()) * 2)",
            killer: "cuts-are-accepted",
        },
        Mutant {
            name: "the lead does not count as stopping distance",
            file: "crates/core/src/drive/mod.rs",
            find: "self.lead() + signed(rate.signum(), self.braking.stop_length(rate.abs()))",
            put: "signed(rate.signum(), self.braking.stop_length(rate.abs()))",
            killer: "cuts-leave-room",
        },
        Mutant {
            name: "a stop from above one is half a record short",
            file: BRAKING,
            find: "* scale / 1024 + ramp",
            put: "* scale / 1024 + ramp - Distance::RECORD / 2",
            killer: "stop-length",
        },
        Mutant {
            name: "a stop from above one is the ramp from one, scaled",
            file: BRAKING,
            find: "(ramp - self.length(one_by_rate)) * scale / 1024 + ramp",
            put: "ramp * scale / 1024 + Distance::RECORD + one_by_rate.over(0)",
            killer: "cuts-leave-room",
        },
        Mutant {
            name: "a record ahead replaces one that is needed behind",
            file: PLAYER,
            find: "self.window.push_ahead(n, record, self.stopping_place_behind())",
            put: "self.window.push_ahead(n, record, self.status.place)",
            killer: "cuts-leave-room",
        },
        Mutant {
            name: "a record behind replaces one that is needed ahead",
            file: PLAYER,
            find: "self.window.push_behind(n, record, rests, self.stopping_place())",
            put: "self.window.push_behind(n, record, rests, self.status.place)",
            killer: "cuts-leave-room",
        },
        Mutant {
            name: "a trim is compared with the cursor",
            file: PLAYER,
            find: "self.window.trim(high, self.stopping_place())",
            put: "self.window.trim(high, self.status.place)",
            killer: "cuts-leave-room",
        },
        Mutant {
            name: "the way forward is what a run backward may not forget",
            file: PLAYER,
            find: "self.window.forget(low, self.stopping_place_behind())",
            put: "self.window.forget(low, self.stopping_place())",
            killer: "cuts-leave-room",
        },
        Mutant {
            name: "an instruction is compared with the cursor",
            file: PLAYER,
            find: "self.stopping_place().distance_to(at) >= Distance::ZERO",
            put: "self.status.place.distance_to(at) >= Distance::ZERO",
            killer: "cuts-leave-room",
        },
    ],
}];
