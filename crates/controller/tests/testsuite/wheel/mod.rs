//! The handwheel, for any signal: motion follows the filter of REV-12 within the rate law, between the ends of the
//! history.
//!
//! The rate that the card is to be sent is calculated here again from the wheel's counts alone; limits are checked by
//! the controller's monitor and by the tests' own.

use crate::{limits, records, wired};

mod hand;

use std::collections::{HashMap, VecDeque};

use hand::{Moment, Setting, moments};
use retrace_config::MachineConfig;
use retrace_controller::{
    CommandSender, CommandSources, EventKind, JobOptions, JobStart, Observer, OperatorCommand, Outcome, PeriodRecord,
    RunMode, ScriptPlayer, Telemetry, command_channel, run_job,
};
use retrace_core::mode::Mode;
use retrace_core::{Distance, Place, Rate, RateTarget, RecordIndex};
use retrace_hal_sim::{Clock, Random, SimCard, SimCardError};
use retrace_journal::{HoldReason, JournalConfig};
use retrace_link::{CardStatus, CommandRefusal, HostCommand, MotionCard, PathStart};
use wired::{AXES, Decoder, Path, pick};

/// From full rate the machine is at rest within this many periods of the command, wherever it is (docs/rate-law.md).
const REST: usize = 300;
/// Maximum number of periods from full rate to full rate in the other direction.
const ROUND: usize = 2 * REST;
/// Maximum number of records in which the machine comes to rest from full rate.
const NEAR: u32 = 400;
/// Records beside a place that a control period may touch.
const BESIDE: usize = 2;

/// A card whose operator turns the wheel: the actions of a turn are performed while the period before it passes.
struct Turned {
    card: SimCard<AXES>,
    orders: CommandSender,
    moments: VecDeque<Moment>,
    /// The rate that was requested from the card last.
    asked: RateTarget,
    /// The requested rate in each period, from the first on.
    log: Vec<RateTarget>,
    /// Counts that the card has reported.
    told: i64,
}

impl Turned {
    fn say(&self, moment: Moment) {
        if let Some(word) = moment.word {
            self.orders.send(word).expect("room");
        }
        self.orders.turn_wheel(i32::from(moment.screen));
    }
}

impl MotionCard<AXES> for Turned {
    type Fault = SimCardError;

    fn window(&self) -> u32 {
        self.card.window()
    }

    fn send(&mut self, word: HostCommand<AXES>) -> Result<(), CommandRefusal> {
        let rate = if let HostCommand::Rate(target) = word { target } else { self.asked };
        self.card.send(word)?;
        self.asked = rate;
        Ok(())
    }

    fn run_period(&mut self) -> Result<&CardStatus<AXES>, SimCardError> {
        self.log.push(self.asked);
        let moment = self.moments.pop_front().unwrap_or_default();
        self.card.machine().turn_wheel(moment.encoder);
        self.say(moment);
        self.told += i64::from(self.card.run_period()?.wheel);
        Ok(self.card.status())
    }

    fn begin_path(&mut self, start: PathStart) -> Result<(), SimCardError> {
        self.card.begin_path(start)
    }

    fn status(&self) -> &CardStatus<AXES> {
        self.card.status()
    }
}

#[derive(Default)]
struct Log {
    periods: Vec<PeriodRecord<AXES>>,
    reached: usize,
}

impl Observer<AXES> for Log {
    fn on_telemetry(&mut self, told: &Telemetry<AXES>) {
        match told {
            Telemetry::Period(period) => self.periods.push(*period),
            Telemetry::Event(event) => self.reached += usize::from(event.kind == EventKind::HistoryEndReached),
            _ => {}
        }
        assert!(self.periods.len() < 200_000, "it hangs");
    }
}

/// A case, with its run.
struct Case {
    machine: MachineConfig,
    setting: Setting,
    path: Path,
    moments: Vec<Moment>,
    log: Log,
    asked: Vec<RateTarget>,
}

/// Maxima over the cases.
#[derive(Default, Debug)]
struct Came {
    periods: usize,
    at_the_wheel: usize,
    saturated: usize,
    at_oldest: usize,
    at_reached: usize,
    /// Maximum number of periods from the first with a mean of zero to rest.
    max_stop: usize,
}

fn run(seed: u64) -> Case {
    let mut random = Random::new(seed);
    let setting = Setting::any(&mut random);
    let history_s = pick(&mut random, &[0.8, 2.0, 5.0, 60.0]);
    let Setting { counts_per_s, mean_ms } = setting;
    let text = format!(
        "history_hours = {}\n[wheel]\nfull_rate_counts_per_s = {counts_per_s}.0\nfilter_ms = {mean_ms}.0\n",
        history_s / 3600.0
    );
    let machine = MachineConfig::parse(&text, "test").expect("valid");
    let program = wired::program(&mut random, 24);
    let path = Path::of(&machine, &program);
    let moments = moments(&mut random, setting);
    let mut card =
        SimCard::new(RecordIndex::new(0), machine.rate_limits().expect("checked"), Clock::Virtual).expect("fits");
    // at any value of the free-running counter, near its wrap more often than not
    card.machine().turn_wheel(pick(&mut random, &[0, -1, -6, 300, 32_760, -32_760]));
    let (orders, heard) = command_channel();
    let mut waits = VecDeque::from(moments.clone());
    let first = waits.pop_front().unwrap_or_default();
    let card = Turned { card, orders, moments: waits, asked: RateTarget::ZERO, log: Vec::new(), told: 0 };
    card.say(first);
    let operators = CommandSources::from_script(ScriptPlayer::new(Vec::new(), machine.period_us)).with_operator(heard);
    let run_mode = RunMode { wall_time: false, operator: true, real_time: false };
    let options =
        JobOptions { start: JobStart::First, commands: operators, run_mode, journal: JournalConfig::default() };
    let mut log = Log::default();
    let end = run_job(&machine, Decoder::new(&program), options, card, &mut log).expect("a job");
    assert_eq!(end.outcome, Outcome::Completed);
    assert_eq!(end.stats.underruns, 0);
    assert_eq!(Some(&end.card.status().counts), path.counts.last(), "where it ends without an operator");
    let turned: i64 = moments.iter().take(log.periods.len() + 1).map(|m| i64::from(m.encoder)).sum();
    assert_eq!(end.card.told, turned, "no count of the encoder is lost where it wraps");
    Case { machine, setting, path, moments, log, asked: end.card.log }
}

impl Case {
    /// The mean of REV-12 in the turn, as a rate, from the wheel's counts since turn `since`.
    fn mean(&self, turn: usize, since: usize) -> Rate {
        let Setting { counts_per_s, mean_ms } = self.setting;
        let first = since.max((turn + 1).saturating_sub(mean_ms as usize));
        let counts = |m: &Moment| i64::from(m.screen.saturating_add(m.encoder));
        let sum: i64 = self.moments.iter().take(turn + 1).skip(first).map(counts).sum();
        let at_one = (i64::from(counts_per_s * mean_ms) + 500) / 1000;
        let at_one = at_one.max(1);
        Rate::ONE * sum.clamp(-at_one, at_one) / at_one
    }

    /// Checks commanded rate, ends and rest, period by period.
    fn follows(&self, came: &mut Came) {
        let periods = &self.log.periods;
        let (mut since, mut stood, mut last_mode, mut was_at_rest) = (0, true, Mode::Run, true);
        let mut asked_for_rest = 0;
        let mut reached_at_wheel = None;
        for (turn, period) in periods.iter().enumerate() {
            assert_eq!(period.period, turn as u64 + 1);
            let is_entered =
                matches!(self.moments.get(turn), Some(Moment { word: Some(OperatorCommand::Wheel { .. }), .. }));
            if is_entered && last_mode != Mode::Wheel {
                since = turn;
            }
            stood = last_mode != Mode::Run && stood || was_at_rest;
            asked_for_rest = if self.asked[turn] == RateTarget::ZERO { asked_for_rest + 1 } else { 0 };
            if period.mode == Mode::Wheel {
                let is_free = stood && period.hold_reason != HoldReason::Hold;
                let mean = if is_free { self.mean(turn, since) } else { Rate::ZERO };
                assert_eq!(
                    self.asked[turn],
                    RateTarget::both(mean),
                    "in turn {turn}, at the wheel since {since}: {period:?}"
                );
                came.at_the_wheel += 1;
                came.saturated += usize::from(mean.abs() == Rate::ONE);
                if stood {
                    self.is_between_the_ends(period);
                    let reached = *reached_at_wheel.get_or_insert(period.reached);
                    assert_eq!(reached, period.reached, "the wheel executes nothing for the first time");
                }
            } else {
                reached_at_wheel = None;
            }
            assert!(
                asked_for_rest <= REST || period.at_rest,
                "no rest {asked_for_rest} periods after the word: {period:?}"
            );
            if asked_for_rest > 0 && period.at_rest && !was_at_rest {
                came.max_stop = came.max_stop.max(asked_for_rest);
            }
            self.is_within_what_was_asked(turn);
            (last_mode, was_at_rest) = (period.mode, period.at_rest);
        }
        came.periods += periods.len();
        came.at_reached += usize::from(self.log.reached > 0);
        came.at_oldest +=
            usize::from(periods.iter().any(|p| p.mode == Mode::Wheel && p.place == Place::start_of(p.oldest)));
    }

    fn is_between_the_ends(&self, period: &PeriodRecord<AXES>) {
        let (reached, oldest) = (Place::start_of(period.reached), Place::start_of(period.oldest));
        assert!(
            oldest.distance_to(period.place) >= Distance::ZERO && period.place.distance_to(reached) >= Distance::ZERO,
            "{period:?}"
        );
        // as far back as the machine file requires, and at most one record beyond
        let depth = period.reached.since(period.oldest);
        let promised = self.machine.history_records.min(period.reached.number());
        assert!((promised..=promised + 1).contains(&depth), "{depth} records of {promised}: {period:?}");
    }

    /// Whether the records next to this place, or the nearest ones that move, are rapid motion: in these programs that
    /// of Z alone. A move from rest begins with records that have no pulses yet.
    fn is_rapid_at(&self, place: Place) -> bool {
        let counts = &self.path.counts;
        let moves = |at: usize| counts[at] != counts[at + 1];
        let records = counts.len() - 1;
        let near = (place.record.number() as usize).min(records - 1);
        let first = (0..=near).rfind(|&at| moves(at)).unwrap_or(0).saturating_sub(BESIDE);
        let behind = (near..records).find(|&at| moves(at)).map_or(records, |at| (at + 1 + BESIDE).min(records));
        (first..behind).any(|at| counts[at][2] != counts[at + 1][2])
    }

    /// Checks that the rate is never beyond what was requested in the time that a change takes, for feed motion, or for
    /// rapid motion where there is some, and not below it far from the ends.
    fn is_within_what_was_asked(&self, turn: usize) {
        let period = &self.log.periods[turn];
        let asked = &self.asked[(turn + 1).saturating_sub(ROUND)..=turn];
        // before the first turn nothing was requested
        let is_rapid = self.is_rapid_at(period.place);
        let rates = || asked.iter().flat_map(|target| [target.feed, if is_rapid { target.rapid } else { target.feed }]);
        let low = rates().chain((turn < ROUND).then_some(Rate::ZERO)).min().unwrap_or(Rate::ZERO);
        let high = rates().max().unwrap_or(Rate::ZERO);
        let rate = period.rate;
        assert!(
            (low.min(Rate::ZERO) - Rate::from_units(2)..=high.max(Rate::ZERO) + Rate::from_units(2)).contains(&rate),
            "{rate:?} of {low:?}…{high:?}: {period:?}"
        );
        let record = period.place.record;
        let is_near = period.reached.since(record) < NEAR || record.since(period.oldest) < NEAR;
        if period.mode == Mode::Wheel && !is_near {
            assert!(
                (low - Rate::from_units(2)..=high + Rate::from_units(2)).contains(&rate),
                "{rate:?} of {low:?}…{high:?}: {period:?}"
            );
        }
    }

    /// Checks that every place has one position, and that it is the program's own.
    fn returns(&self) {
        let mut positions: HashMap<Place, [i64; AXES]> = HashMap::new();
        for period in &self.log.periods {
            let first = *positions.entry(period.place).or_insert(period.counts);
            assert_eq!(first, period.counts, "two positions of one place: {period:?}");
            assert_eq!(self.path.position(period.place), period.counts, "off the path: {period:?}");
        }
    }

    /// Checks the limits by both monitors.
    fn is_legal(&self) {
        let mut judge = wired::judge(&self.machine);
        self.log.periods.iter().for_each(|period| judge.push(&period.increments, period.rate));
        let verdict = judge.finish();
        assert_eq!(verdict.violations, 0, "{:?}", verdict.first);
        let axes: Vec<limits::Axis> = self.machine.axes.iter().map(axis).collect();
        let audit = limits::audit(&self.rows(), &axes, self.machine.period_s());
        assert_eq!(audit.violations, [0; 3], "{:?}", audit.first);
    }

    fn rows(&self) -> records::Records {
        let row = |period: &PeriodRecord<AXES>| records::Row {
            period: period.period,
            line: u64::from(period.line),
            rate_nano: ((i128::from(period.rate.units()) * 1_000_000_000) >> 32) as i64,
            record: u64::from(period.place.record.number()),
            fraction: u64::from(period.place.fraction),
            increments: period.increments.iter().take(self.machine.axes.len()).map(|&i| i64::from(i)).collect(),
            layer: 0,
            retrace_switched: String::new(),
        };
        let axes = self.machine.axes.iter().map(|axis| axis.name.to_string()).collect();
        records::Records { axes, rows: self.log.periods.iter().map(row).collect(), is_dry: false }
    }
}

fn axis(axis: &retrace_config::AxisConfig) -> limits::Axis {
    limits::Axis {
        pulses_per_mm: axis.pulses_per_mm,
        limits: [axis.max_velocity_mm_per_s, axis.max_acceleration_mm_per_s2, axis.max_jerk_mm_per_s3],
    }
}

/// Number of cases, and the seed of the first: `cargo xtask campaign wheel`.
fn asked(usual: u64) -> (u64, u64) {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse().ok());
    (number("RETRACE_CASES").unwrap_or(usual), number("RETRACE_FIRST_SEED").unwrap_or(1))
}

#[test]
fn motion_follows_the_mean_of_the_wheel_whatever_it_is_turned_like() {
    let (cases, first) = asked(16);
    let mut came = Came::default();
    for seed in first..first + cases {
        let judged = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            let case = run(seed);
            case.follows(&mut came);
            case.returns();
            case.is_legal();
        }));
        assert!(judged.is_ok(), "that was seed {seed}: RETRACE_CASES=1 RETRACE_FIRST_SEED={seed} runs it alone");
    }
    println!("{cases} cases: {came:?}");
    let some = [came.at_the_wheel, came.saturated, came.max_stop];
    assert!(some.iter().all(|&n| n > 0), "{came:?}");
    assert!(cases < 16 || came.at_oldest > 0 && came.at_reached > 0, "both ends are come to: {came:?}");
}
