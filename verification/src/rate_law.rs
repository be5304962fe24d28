//! The rate law on planned paths: velocity, acceleration and jerk of the motion that the drive makes of them (REV,
//! *Rate law*).
//!
//! Invariant: motion is judged from the exact path at the places of the cursor. Nothing here asks the drive for a
//! slope, a cap or a bound.

use crate::choice::{Choice, ONE};
use crate::harness::harnesses;
use crate::ledger::{Mutant, Row, Search, Size};
use crate::native::Draw;
use retrace_core::drive::{Braking, Drive, RecordWindow};
use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Place, RapidCap, Rate, RecordIndex};

/// Largest average that is drawn.
const AVERAGE: usize = 64;
/// Records of a path.
const RECORDS: usize = 2400;

/// One axis of a path: position, velocity, acceleration and jerk at the beginning of each record; the jerk is constant
/// over a record.
#[derive(Clone, Default)]
struct Axis(Vec<[f64; 4]>);

impl Axis {
    /// A path at one velocity, in whole pulses.
    fn straight(velocity: f64) -> Self {
        Self((0..RECORDS).map(|n| [n as f64 * velocity.floor(), velocity.floor(), 0.0, 0.0]).collect())
    }

    /// A path of drawn changes of velocity, each as an S-curve within the limits.
    fn any(draw: &mut Draw, [velocity, acceleration, jerk]: [f64; 3]) -> Self {
        let (mut axis, mut state) = (Self::default(), [0.0; 4]);
        let share = |draw: &mut Draw| draw.between(0, 1000) as f64 / 1000.0;
        while axis.0.len() < RECORDS {
            let target = velocity * (2.0 * share(draw) - 1.0);
            let (mut bends, mut ramp) = (1 + draw.below(20), draw.below(40));
            let change = target - state[1];
            let peaks = |bends: u32, ramp: u32| {
                let jerk = change.abs() / (f64::from(bends) * f64::from(bends + ramp));
                [jerk * f64::from(bends), jerk]
            };
            while peaks(bends, ramp)[1] > jerk {
                bends += 1;
            }
            while peaks(bends, ramp)[0] > acceleration {
                ramp += 1;
            }
            let bend = peaks(bends, ramp)[1] * change.signum();
            for (count, jerk) in [(bends, bend), (ramp, 0.0), (bends, -bend)] {
                for _ in 0..count {
                    axis.0.push([state[0], state[1], state[2], jerk]);
                    state = Self::after([state[0], state[1], state[2], jerk], 1.0);
                }
            }
            // without the rounding of the sums
            state = [state[0], target, 0.0, 0.0];
            for _ in 0..draw.below(60) {
                axis.0.push(state);
                state[0] += target;
            }
        }
        axis
    }

    fn after([q, v, a, j]: [f64; 4], s: f64) -> [f64; 4] {
        [q + s * (v + s * (a / 2.0 + s * j / 6.0)), v + s * (a + s * j / 2.0), a + s * j, j]
    }

    fn position(&self, s: f64) -> f64 {
        let n = (s.floor().max(0.0) as usize).min(self.0.len() - 1);
        Self::after(self.0[n], s - n as f64)[0]
    }

    /// The rate at which record `n` reaches a limit.
    fn cap(&self, n: usize, [velocity, acceleration, jerk]: [f64; 3]) -> f64 {
        let (from, to) = (self.0[n], Self::after(self.0[n], 1.0));
        let by = |k: usize, limit: f64| limit / from[k].abs().max(to[k].abs()).max(1e-9);
        by(1, velocity).min(by(2, acceleration).sqrt()).min(by(3, jerk).cbrt())
    }
}

/// A path of two axes, and the part of it that is held.
struct Path {
    axes: [Axis; 2],
    increments: Vec<[i16; 2]>,
    caps: Vec<RapidCap>,
    low: u32,
    high: u32,
}

/// Number of the first record of a path.
const FIRST: u32 = u32::MAX - 700;

impl RecordWindow<2> for Path {
    fn low(&self) -> RecordIndex {
        RecordIndex::new(FIRST) + self.low
    }
    fn high(&self) -> RecordIndex {
        RecordIndex::new(FIRST) + self.high
    }
    fn rests_at(&self, _: RecordIndex) -> bool {
        false
    }
    fn cap(&self, place: RecordIndex) -> RapidCap {
        self.caps[place.since(RecordIndex::new(FIRST)) as usize]
    }
    fn increments(&self, place: RecordIndex) -> [i16; 2] {
        self.increments[place.since(RecordIndex::new(FIRST)) as usize]
    }
    fn is_rapid(&self, _: RecordIndex) -> bool {
        false
    }
}

/// Periods over which the jerk is judged, as the limits of a run are: a shorter phase of jerk moves no axis by more
/// than the rounding of its pulses does.
const STRIDE: usize = 8;

/// The largest part of each limit that some periods use, of any axis: of velocity, of acceleration, of twice the jerk
/// over
/// [`STRIDE`] periods, and of twice the jerk in a single period.
type Used = [f64; 4];

/// A machine, and a path that uses its limits as a plan may.
struct Scene {
    limits: RateLimits<2>,
    /// Share of the limits that the plan may use, in 65 536ths.
    share: u16,
    path: Path,
}

impl Scene {
    fn any(draw: &mut Draw, straight: bool) -> Self {
        let average = 2 * draw.below(20) as u16 + 5;
        let share = [20_000, 45_000, 58_982][draw.below(3) as usize];
        let axis = |draw: &mut Draw| {
            let velocity = (2000 + u64::from(draw.below(20_000))) << 32;
            let acceleration = velocity / (30 + u64::from(draw.below(150)));
            // the shortest average that the axis allows, or a longer one
            let jerk = acceleration.div_ceil(average.into()) * if straight { 1 } else { 1 + u64::from(draw.below(2)) };
            PulseLimits { velocity, acceleration, jerk }
        };
        let limits = RateLimits::new(average, share, [axis(draw), axis(draw)]).expect("valid");
        let alpha = f64::from(share) / 65_536.0;
        let plan = limits.axes().map(|axis| {
            let pulses = |units: u64| units as f64 / ONE as f64;
            [pulses(axis.velocity), alpha * pulses(axis.acceleration), alpha * pulses(axis.jerk)]
        });
        // a slow path may be retraced at a higher rate
        let scale = [1.0, 1.0, 0.3, 0.125][draw.below(4) as usize];
        let scaled = |[v, a, j]: [f64; 3]| [v * scale, a * scale * scale, j * scale * scale * scale];
        let axes = plan.map(|plan| {
            let plan = scaled(plan);
            if straight { Axis::straight(plan[0]) } else { Axis::any(draw, plan) }
        });
        let rounded = |n: usize| axes.each_ref().map(|axis| axis.position(n as f64).round());
        let increments = (0..RECORDS).map(|n| {
            let (from, to) = (rounded(n), rounded(n + 1));
            [(to[0] - from[0]) as i16, (to[1] - from[1]) as i16]
        });
        let caps = (0..RECORDS).map(|n| {
            let cap = axes[0].cap(n, plan[0]).min(axes[1].cap(n, plan[1]));
            RapidCap::sixteenths((cap * 16.0).clamp(16.0, 128.0) as u8)
        });
        let (increments, caps) = (increments.collect(), caps.collect());
        Self { limits, share, path: Path { axes, increments, caps, low: 0, high: RECORDS as u32 } }
    }

    /// Begins a run in the middle of the path, with `held` records on either side.
    fn begin(&mut self, held: u32) -> Run {
        let middle = (RECORDS / 2) as u32;
        (self.path.low, self.path.high) = (middle.saturating_sub(held), (middle + held).min(RECORDS as u32));
        let at = Place::start_of(RecordIndex::new(FIRST) + middle);
        Run { drive: Drive::new(self.limits).expect("fits"), at, places: [f64::from(middle); 3 * STRIDE + 1], held }
    }

    /// Continues a run with a target for a number of periods, and returns what these use.
    fn run(&mut self, run: &mut Run, target: Rate, periods: u32) -> Used {
        let start = Place::start_of(RecordIndex::new(FIRST));
        let mut used = Used::default();
        for _ in 0..periods {
            let n = run.at.record.since(start.record);
            self.path.low = self.path.low.min(n.saturating_sub(run.held));
            self.path.high = self.path.high.max((n + run.held).min(RECORDS as u32));
            run.at = run.drive.step(run.at, target, &self.path).to;
            run.places.rotate_left(1);
            run.places[3 * STRIDE] = start.distance_to(run.at).units() as f64 / ONE as f64;
            for (axis, limits) in self.path.axes.iter().zip(self.limits.axes()) {
                let q = |periods: usize| axis.position(run.places[3 * STRIDE - periods]);
                let third = |n: usize| (q(0) - 3.0 * q(n) + 3.0 * q(2 * n) - q(3 * n)) / (n * n * n) as f64;
                let differences = [q(0) - q(1), q(0) - 2.0 * q(1) + q(2), third(STRIDE), third(1)];
                let limits = [limits.velocity, limits.acceleration, 2 * limits.jerk, 2 * limits.jerk];
                for (used, (difference, limit)) in used.iter_mut().zip(differences.into_iter().zip(limits)) {
                    *used = used.max(difference.abs() * ONE as f64 / limit as f64);
                }
            }
        }
        used
    }
}

/// A drive on its way, with the places of the last periods.
struct Run {
    drive: Drive<2, AVERAGE>,
    at: Place,
    /// Places of the last periods, the newest last.
    places: [f64; 3 * STRIDE + 1],
    /// Records that arrive in time on either side of the cursor.
    held: u32,
}

/// For any requests at any time, over drawn paths that use the limits as a plan may: velocity and acceleration are kept
/// on every axis in every period, and twice the jerk over every [`STRIDE`] periods. A phase of jerk that is shorter
/// than a block of the survey is not seen whole, so in a single period all of the plan's jerk may be added.
fn limits_are_kept(size: Size) -> String {
    let mut draw = Draw::new(size.seed);
    let (runs, mut largest) = (if size.full { 8000 } else { 300 }, Used::default());
    for _ in 0..runs {
        let mut scene = Scene::any(&mut draw, false);
        let held = if draw.flag() { RECORDS as u32 } else { 30 + draw.below(600) };
        let mut run = scene.begin(held);
        for _ in 0..8 {
            let any = draw.between(-8 * ONE, 8 * ONE);
            let rate = [ONE, 0, ONE / 2, 8 * ONE, -ONE, -8 * ONE, any][draw.below(7) as usize];
            let periods = 1 + draw.below(200);
            let used = scene.run(&mut run, Rate::from_units(rate), periods);
            let unseen = f64::from(scene.share) / 65_536.0 / 2.0;
            assert!(
                used[0].max(used[1]).max(used[2]) <= 1.0 + 1e-4 && used[3] <= 1.0 + unseen,
                "{used:?} at {:?}: {:?}",
                run.at,
                scene.limits
            );
            for (largest, used) in largest.iter_mut().zip(used) {
                *largest = largest.max(used);
            }
        }
    }
    format!(
        "{runs} drawn runs; at most {:.4} of the velocity, {:.4} of the acceleration, {:.4} of twice the jerk over \
         {STRIDE} periods, {:.4} in one",
        largest[0], largest[1], largest[2], largest[3]
    )
}

/// On straight paths the axis that decides uses its acceleration, in every start and every hold that last longer than
/// the average, and twice its jerk where one is turned into the other: either axis, in either direction, at the planned
/// rate, half of it, and up to three times that.
fn limits_are_used(size: Size) -> String {
    let mut draw = Draw::new(size.seed);
    let (runs, mut least, mut judged) = (if size.full { 4000 } else { 400 }, [1.0f64; 2], [[0u32; 2]; 2]);
    for _ in 0..runs {
        let mut scene = Scene::any(&mut draw, true);
        let average = u32::from(scene.limits.average());
        let mut run = scene.begin(RECORDS as u32);
        let top = scene.path.caps[RECORDS / 2].rate().min(Rate::ONE * 3);
        let rate = [Rate::ONE, Rate::ONE / 2, top][draw.below(3) as usize];
        let forward = draw.flag();
        let rate = if forward { rate } else { -rate };
        // the change of the rate in a period that each axis allows
        let speeds = scene.path.axes.each_ref().map(|axis| axis.0[RECORDS / 2][1].abs());
        let [x, y] = [0, 1].map(|n| scene.limits.axes()[n].acceleration as f64 / speeds[n]);
        if (rate.units().abs() as f64) < x.min(y) * f64::from(4 * average) {
            continue;
        }
        let start = scene.run(&mut run, rate, average + 2);
        let hold = scene.run(&mut run, Rate::ZERO, average + 1);
        let resume = scene.run(&mut run, rate, average + 2);
        for [_, acceleration, _, jerk] in [start, hold, resume] {
            least[0] = least[0].min(acceleration);
            least[1] = least[1].min(if start[3] == jerk { 1.0 } else { jerk });
        }
        assert!(
            least.iter().all(|&least| least >= 0.98),
            "{start:?}, {hold:?}, {resume:?}, {rate:?}: {:?}",
            scene.limits
        );
        judged[usize::from(x > y)][usize::from(forward)] += 1;
    }
    assert!(judged.as_flattened().iter().all(|&runs| runs > 10), "{judged:?}");
    format!(
        "{judged:?} runs by axis and direction; at least {:.4} and {:.4} of acceleration and jerk",
        least[0], least[1]
    )
}

/// From a planned stop the cursor starts at exactly the rate that the caps ahead allow: one slow record counts where it
/// begins within the distance that the rate covers before it has fallen and left the average, and a record more.
fn caps_count_as_far_as_they_must(_: Size) -> String {
    let (mut starts, axis) = (0u32, PulseLimits { velocity: 100 << 32, acceleration: 6 << 32, jerk: 2 << 32 });
    for average in [3, 5, 13] {
        let limits = RateLimits::new(average, 20_000, [axis; 2]).expect("valid");
        let memory = i64::from(Braking::<32>::new(&limits).expect("fits").periods()) + i64::from(average) + 3;
        for target in (17..=128).map(|sixteenths| RapidCap::sixteenths(sixteenths).rate()) {
            for sign in [1, -1] {
                // the farthest record that counts, and the next
                let farthest = (target.over(memory).units() >> 32) as u32 + 1;
                for (slow, expected) in [(farthest, Rate::ONE), (farthest + 1, target), (0, Rate::ONE)] {
                    let window =
                        OneSlow { records: farthest + 40, slow: if sign > 0 { slow } else { farthest + 39 - slow } };
                    let mut drive = Drive::<2, AVERAGE>::new(limits).expect("fits");
                    let at = Place::start_of(if sign > 0 { window.low() } else { window.high() });
                    let to = drive.step(at, target * sign, &window).to;
                    assert_eq!(at.distance_to(to), (expected * sign).over(1), "{slow} of {farthest}, {target:?}");
                    starts += 1;
                }
            }
        }
    }
    format!("{starts} starts")
}

/// Records between two planned stops, all of which but one may be retraced at any rate.
struct OneSlow {
    records: u32,
    slow: u32,
}

impl RecordWindow<2> for OneSlow {
    fn low(&self) -> RecordIndex {
        RecordIndex::new(FIRST)
    }
    fn high(&self) -> RecordIndex {
        self.low() + self.records
    }
    fn rests_at(&self, place: RecordIndex) -> bool {
        place == self.low() || place == self.high()
    }
    fn cap(&self, place: RecordIndex) -> RapidCap {
        if place == self.low() + self.slow { RapidCap::PLANNED } else { RapidCap::MAX }
    }
    fn increments(&self, _: RecordIndex) -> [i16; 2] {
        [1, 1]
    }
    fn is_rapid(&self, _: RecordIndex) -> bool {
        false
    }
}

harnesses! {}

const MOD: &str = "crates/core/src/drive/mod.rs";
const SLOPE: &str = "crates/core/src/drive/slope.rs";

/// The rows of this module.
pub const ROWS: &[Row] = &[
    Row {
        name: "law-limits",
        says: "What the drive makes of a planned path keeps velocity and acceleration in every period, and twice the \
            jerk over every eight periods, on every axis, for any requests at any time; and on straight paths every \
            start and every hold uses 98 % of the acceleration, and a change of its sign 98 % of twice the jerk",
        requirement: "REV, Beyond the source, *Rate law*",
        bound: "8 000 drawn runs of up to 1 600 periods over drawn S-curves of two axes, rates to 8 in both \
            directions, averages of 5 to 43 periods, the whole path held or 30 to 630 records of it; 4 000 drawn \
            starts, holds and turns on straight paths",
        assumes: "the plan stays within its share of acceleration and jerk at the cap of each record, and an increment \
            is the rounded path",
        suffices: "a sample, judged without rounding: differences of the exact path at the places of the cursor. Row \
            drive-acceleration adds the rounding. The law has no other inputs; on a straight path the slope is the \
            least over the axes, so that each of them decides in some run",
        harnesses: &[],
        searches: &[
            Search { name: "law-limits-kept", run: limits_are_kept },
            Search { name: "law-limits-used", run: limits_are_used },
        ],
        models: &[],
        mutants: &[
            Mutant {
                name: "the acceleration of the records does not count",
                file: SLOPE,
                find: "axis.acceleration.saturating_sub(scaled(required.acceleration, rate, 2))",
                put: "axis.acceleration.saturating_sub(scaled(0, rate, 2))",
                killer: "law-limits-kept",
            },
            Mutant {
                name: "peaks of acceleration are taken from the jerk that is seen",
                file: "crates/core/src/drive/bounds.rs",
                find: "let unseen = if is_straight { 0 } else { maximum.jerk };",
                put: "let unseen = jerk;",
                killer: "law-limits-kept",
            },
            Mutant {
                name: "half the acceleration is used",
                file: SLOPE,
                find: "axis.acceleration.saturating_sub(scaled(required.acceleration, rate, 2))",
                put: "(axis.acceleration / 2).saturating_sub(scaled(required.acceleration, rate, 2))",
                killer: "law-limits-used",
            },
            Mutant {
                name: "the bend of the rate counts twice",
                file: SLOPE,
                find: "let bend = 2 * required.velocity / u64::from(limits.average()) + 1;",
                put: "let bend = 4 * required.velocity / u64::from(limits.average()) + 1;",
                killer: "law-limits-used",
            },
            Mutant {
                name: "half as much jerk again is used",
                file: SLOPE,
                find: "let remaining = (2 * axis.jerk).saturating_sub(scaled(required.jerk, highest, 3));",
                put: "let remaining = (3 * axis.jerk).saturating_sub(scaled(required.jerk, highest, 3));",
                killer: "law-limits-kept",
            },
        ],
    },
    Row {
        name: "law-caps",
        says: "Rapid retrace is as fast as the caps ahead allow, and no faster: a record counts exactly as far ahead \
            as the rate needs to fall and to leave the average",
        requirement: "REV, Beyond the source, *Rate law*",
        bound: "one slow record, the farthest that counts, the next one, or the first; every rate above 1 in \
            sixteenths, both directions, three averages",
        assumes: "the start is a planned stop, from which the rate jumps; so the first period shows what is requested",
        suffices: "the rate is lowered by each cap alone, and the distance depends on the rate alone",
        harnesses: &[],
        searches: &[Search { name: "caps-count", run: caps_count_as_far_as_they_must }],
        models: &[],
        mutants: &[
            Mutant {
                name: "the caps end a record early",
                file: MOD,
                find: "if Distance::records(i64::from(k) - 1) > lead + rate.over(memory) {",
                put: "if Distance::records(i64::from(k)) > lead + rate.over(memory) {",
                killer: "caps-count",
            },
            Mutant {
                name: "the caps end a record late",
                file: MOD,
                find: "if Distance::records(i64::from(k) - 1) > lead + rate.over(memory) {",
                put: "if Distance::records(i64::from(k) - 2) > lead + rate.over(memory) {",
                killer: "caps-count",
            },
            Mutant {
                name: "the cap of the record under the cursor does not count",
                file: "crates/core/src/drive/directed_window.rs",
                find: "let n = if self.sign > 0 { self.at.record + k }",
                put: "let n = if self.sign > 0 { self.at.record + (k + 1) }",
                killer: "caps-count",
            },
        ],
    },
];
