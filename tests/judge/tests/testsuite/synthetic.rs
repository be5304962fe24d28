//! A synthetic machine: the trace of a job of two contours, without an interruption, and with an arc that is lost and a
//! cut that is recovered.
//!
//! Invariant: a trace without a defect uses every time that the judge allows to its end, so that one period more or
//! less is a defect.

use std::fmt::Write;
use std::ops::Range;

/// Periods from the proof to the first motion, with `--pierce-ms 400`.
const PIERCE: usize = 400;
/// Periods from an ignition in the kerf to the first motion, with `--pilot-ms 298`.
const PILOT: usize = 298;

/// Places of the path with their counts: contours from 40 to 240 and from 300 to 360, at 200 pulses per mm.
const PATH: [(f64, [f64; 4]); 8] = [
    (0.0, [0.0, 0.0, 2000.0, 0.0]),
    (40.0, [800.0, 0.0, 400.0, 40.0]),
    (140.0, [1400.0, 0.0, 400.0, 140.0]),
    (240.0, [1400.0, 600.0, 400.0, 240.0]),
    (270.0, [2000.0, 600.0, 1000.0, 270.0]),
    (300.0, [2000.0, 1200.0, 400.0, 300.0]),
    (360.0, [2360.0, 1200.0, 400.0, 360.0]),
    (400.0, [0.0, 0.0, 2000.0, 400.0]),
];
const AXES: [&str; 4] = ["x", "y", "z", "a"];

/// Numbers of a seed (SplitMix64).
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// A number from 0 to `limit` - 1.
    pub(crate) fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut bits = self.0;
        bits = (bits ^ bits >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ bits >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        (bits ^ bits >> 31) as usize % limit
    }
}

/// A control period of 1 ms.
#[derive(Clone, Debug)]
pub(crate) struct Period {
    pub(crate) place: f64,
    pub(crate) rate: f64,
    pub(crate) at_rest: bool,
    pub(crate) is_lit: bool,
    pub(crate) is_proven: bool,
    pub(crate) alarm: u8,
    pub(crate) counts: [i64; 4],
}

/// A trace, and the periods in which the parts of the job begin.
#[derive(Clone, Debug, Default)]
pub(crate) struct Trace {
    pub(crate) periods: Vec<Period>,
    /// First ignition, and the first motion behind it.
    pub(crate) first_start: Range<usize>,
    /// From the loss until the machine rests.
    pub(crate) loss: Range<usize>,
    /// The way back.
    pub(crate) back: Range<usize>,
    /// Ignition in the kerf, and the first motion behind it.
    pub(crate) restart: Range<usize>,
    /// First period in which the arc is proven again.
    pub(crate) join: usize,
    /// End of the first contour: the first period at rest.
    pub(crate) contour_end: usize,
    /// Rapid between the contours.
    pub(crate) rapid: Range<usize>,
    /// Second ignition, and the first motion behind it.
    pub(crate) second_start: Range<usize>,
    /// The stretch of the second contour that runs at half the rate.
    pub(crate) slow: Range<usize>,
    /// End of the second contour.
    pub(crate) second_end: usize,
    /// First period behind the last motion.
    pub(crate) end: usize,
}

/// Counts at a place.
pub(crate) fn counts_at(place: f64) -> [i64; 4] {
    let next = PATH.iter().position(|(knot, _)| *knot >= place).unwrap_or(PATH.len() - 1).max(1);
    let ((from, counts), (to, next_counts)) = (PATH[next - 1], PATH[next]);
    let share = (place - from) / (to - from);
    std::array::from_fn(|axis| (counts[axis] + share * (next_counts[axis] - counts[axis])).round() as i64)
}

impl Trace {
    /// The job without an interruption.
    pub(crate) fn whole() -> Self {
        let mut trace = Self::begin();
        trace.end_contour();
        trace.cut_second_contour(false);
        trace
    }

    /// The job with a loss at a place of the first contour, and its recovery.
    pub(crate) fn recovered(chance: &mut Random) -> Self {
        let lost = 80 + chance.below(131);
        let mut trace = Self::begin_until(lost as f64);
        // the debounce, the way to rest, and a while until the operator comes
        let begin = trace.periods.len();
        (0..9).for_each(|_| trace.add(1.0, true, false));
        (1..31).for_each(|step| trace.add(1.0 - f64::from(step) / 31.0, false, false));
        trace.loss = begin..trace.periods.len();
        trace.rest(300 + chance.below(50), false, false);
        let begin = trace.periods.len();
        let beyond = trace.place().fract();
        trace.add(-beyond, false, false);
        let target = (lost as f64 - 60.0).max(40.0);
        trace.run_to(target, -1.0, false, false);
        trace.back = begin..trace.periods.len();
        trace.rest(5, false, false);
        let begin = trace.periods.len();
        trace.rest(PILOT, true, false);
        trace.restart = begin..trace.periods.len();
        // an arc that was lost behind the last proven place strikes in this or one of the next records
        trace.run_to((lost + 2 - chance.below(20)) as f64, 1.0, true, false);
        trace.join = trace.periods.len();
        trace.end_contour();
        trace.cut_second_contour(true);
        trace
    }

    fn begin() -> Self {
        Self::begin_until(200.0)
    }

    fn begin_until(place: f64) -> Self {
        let mut trace = Self::default();
        trace.run_to(40.0, 1.0, false, false);
        trace.first_start = trace.pierce();
        trace.run_to(place, 1.0, true, true);
        trace
    }

    fn end_contour(&mut self) {
        self.run_to(240.0, 1.0, true, true);
        self.contour_end = self.periods.len();
        // one period, which is the tolerance
        self.rest(1, true, true);
        self.rest(2, false, false);
    }

    fn cut_second_contour(&mut self, slow: bool) {
        let begin = self.periods.len();
        self.run_to(300.0, 1.0, false, false);
        self.rapid = begin..self.periods.len();
        self.second_start = self.pierce();
        self.run_to(310.0, 1.0, true, true);
        let begin = self.periods.len();
        self.run_to(330.0, if slow { 0.5 } else { 1.0 }, true, true);
        self.slow = begin..self.periods.len();
        self.run_to(360.0, 1.0, true, true);
        self.second_end = self.periods.len();
        self.rest(1, true, true);
        self.rest(2, false, false);
        self.run_to(400.0, 1.0, false, false);
        self.end = self.periods.len();
        self.rest(150, false, false);
    }

    fn pierce(&mut self) -> Range<usize> {
        let begin = self.periods.len();
        self.rest(50, true, false);
        self.rest(PIERCE, true, true);
        begin..self.periods.len()
    }

    fn place(&self) -> f64 {
        self.periods.last().map_or(0.0, |period| period.place)
    }

    fn add(&mut self, rate: f64, is_lit: bool, is_proven: bool) {
        let place = self.place() + rate;
        let place = if (place - place.round()).abs() < 1e-9 { place.round() } else { place };
        let counts = counts_at(place);
        self.periods.push(Period { place, rate, at_rest: rate == 0.0, is_lit, is_proven, alarm: 0, counts });
    }

    fn rest(&mut self, periods: usize, is_lit: bool, is_proven: bool) {
        // as a card reports it: the last period of a motion ends at rest
        if let Some(last) = self.periods.last_mut() {
            last.at_rest = true;
        }
        (0..periods).for_each(|_| self.add(0.0, is_lit, is_proven));
    }

    fn run_to(&mut self, place: f64, rate: f64, is_lit: bool, is_proven: bool) {
        while (place - self.place()) * rate > 0.0 {
            self.add(rate, is_lit, is_proven);
        }
    }

    /// Changes the periods of a range.
    pub(crate) fn change(&mut self, range: Range<usize>, change: impl Fn(&mut Period)) {
        self.periods[range].iter_mut().for_each(change);
    }

    /// Repeats a period, and changes the repetitions.
    pub(crate) fn insert(&mut self, at: usize, count: usize, change: impl Fn(&mut Period)) {
        let mut period = self.periods[at].clone();
        change(&mut period);
        self.periods.splice(at..at, std::iter::repeat_n(period, count));
    }

    /// Has the first contour end with another recovery, whose arc does not strike before the end.
    pub(crate) fn try_the_end_again(&mut self) {
        let behind = self.periods.split_off(self.contour_end);
        let end = self.place();
        self.rest(5, false, false);
        self.run_to(end - 30.0, -1.0, false, false);
        self.rest(PILOT, true, false);
        self.run_to(end, 1.0, true, false);
        self.periods.extend(behind);
    }

    /// Has the recovery run on in the kerf with the cutter off and pierce this many records behind the loss, of which
    /// the first not proven place is the latest one possible.
    pub(crate) fn pierce_behind_loss(&mut self, records: usize) {
        let place = self.periods[self.loss.start].place + records as f64;
        self.periods.drain(self.restart.clone());
        let begin = self.restart.start;
        let length = self.periods[begin..].iter().take_while(|period| period.place <= place).count();
        self.change(begin..begin + length, |period| (period.is_lit, period.is_proven) = (false, false));
        let mut pierce = self.periods[begin + length - 1].clone();
        (pierce.rate, pierce.at_rest, pierce.is_lit) = (0.0, true, true);
        let ignition = std::iter::repeat_n(pierce.clone(), 50);
        pierce.is_proven = true;
        let periods: Vec<Period> = ignition.chain(std::iter::repeat_n(pierce, PIERCE)).collect();
        self.periods.splice(begin + length..begin + length, periods);
        // where the arc of the restart would have struck later
        let at = begin + length + 50 + PIERCE;
        let rest = self.periods[at..].iter().take_while(|period| !period.at_rest).count();
        self.change(at..at + rest, |period| period.is_proven = true);
    }

    /// The trace as a value change dump, with the names and in the form of `retrace run --vcd`.
    pub(crate) fn vcd(&self) -> String {
        let mut text = String::from("$version synthetic $end\n$timescale 1 ns $end\n");
        for (axis, name) in AXES.iter().enumerate() {
            let _ = writeln!(text, "$scope module {name} $end\n$var wire 1 s{axis} step $end");
            let _ = writeln!(text, "$var integer 64 c{axis} count $end\n$upscope $end");
        }
        text += "$scope module card $end\n$var real 64 p place $end\n$var real 64 r rate $end\n\
                 $var integer 32 l line $end\n$var wire 1 0 at_rest $end\n$var integer 8 a alarm $end\n\
                 $var integer 16 i inputs $end\n$upscope $end\n$scope module outputs $end\n$var wire 1 o out0 $end\n\
                 $var integer 32 f spindle $end\n$upscope $end\n$enddefinitions $end\n";
        let mut values = vec![String::new(); 10];
        for (number, period) in self.periods.iter().enumerate() {
            let at_ns = number * 1_000_000;
            let mut changes = vec![
                format!("r{} p", period.place),
                format!("r{} r", period.rate),
                format!("{}0", u8::from(period.at_rest)),
                format!("b{:b} a", period.alarm),
                format!("b{:b} i", u8::from(period.is_proven) << 5 | 1),
                format!("b{:b} f", u8::from(period.is_lit)),
            ];
            changes.extend(period.counts.iter().enumerate().map(|(axis, count)| format!("b{count:b} c{axis}")));
            let moves = values[6] != changes[6];
            let changed: Vec<&String> =
                changes.iter().zip(&values).filter(|(now, before)| now != before).map(|(now, _)| now).collect();
            if !changed.is_empty() {
                let _ = writeln!(text, "#{at_ns}");
                changed.iter().for_each(|change| text.extend([change, "\n"]));
            }
            if moves {
                let _ = writeln!(text, "#{}\n1s0\n#{}\n0s0", at_ns + 1000, at_ns + 3000);
            }
            values = changes;
        }
        text
    }
}
