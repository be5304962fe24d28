//! Judges the height of a torch over a warped sheet: a trace alone, without another one to compare it with.
//!
//! Invariant: the height is that of the pulses at the pins; where the path and the layer say that the axis is
//! elsewhere, that is a defect of its own.

use crate::vcd::{ReadError, Sample, TraceReader};
use std::collections::HashSet;
use std::io::BufRead;

/// Width of a cell of the sheet in mm, in which a kerf is known.
const CELL_MM: f64 = 0.2;
/// Deviation from the height of the cut in mm: in most of the samples, and in all of them.
const USUAL_MM: f64 = 0.25;
const LARGEST_MM: f64 = 0.5;
/// Share of the samples that may be beyond the usual deviation.
const SHARE_BEYOND: f64 = 0.05;
/// Samples over which the speed is measured, and the share of the feed below which the height must not change.
const SPEED_SAMPLES: usize = 8;
const SLOW: f64 = 0.9;
/// Time in ns in which the layer comes to rest behind a cut that ends in motion, as with a loss.
const REST_NS: u64 = 200_000_000;
/// Length in mm of the latest part of a cut that is no kerf to cross.
const LATEST_MM: f64 = 20.0;

/// What the judge knows of the machine, the sheet and the cut.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HeightMachine {
    /// Pulses per mm of X and Y, and of the tool axis, which is named z.
    pub(crate) pulses_per_mm: [f64; 2],
    /// Height of the sheet in machine coordinates, mm, and what it rises from X0 to X500, as a cosine.
    pub(crate) sheet_mm: [f64; 2],
    /// Height of the cut over the sheet, mm.
    pub(crate) height_mm: f64,
    /// Feed rate of the cut, mm/s.
    pub(crate) feed_mm_per_s: f64,
    /// Width of the kerf, mm; 0: no kerf is known.
    pub(crate) kerf_mm: f64,
}

/// What the judge found in a trace.
#[derive(Clone, Debug, Default)]
pub(crate) struct HeightVerdict {
    /// Samples in which the torch cut.
    cut: u64,
    /// Those whose height deviates by more than the usual.
    beyond: u64,
    /// Largest deviation in mm.
    worst_mm: f64,
    /// Samples before which the axis had made other pulses than path and layer say.
    wrong_pulses: u64,
    /// Samples of a cut in which the layer changed below the share of the feed, at the planned rate, and over a known
    /// kerf.
    moved_in_corner: u64,
    moved_over_kerf: u64,
    /// Samples of a cut over a known kerf.
    over_kerf: u64,
    /// Samples in which the layer changed with the torch off and the path in motion, later than a lost cut allows.
    moved_in_rapid: u64,
    /// The layer at the end, in pulses.
    layer_at_end: i64,
}

impl HeightVerdict {
    /// Whether nothing is wrong. A trace without a cut shows nothing.
    pub(crate) fn is_good(&self) -> bool {
        let counted = [self.wrong_pulses, self.moved_in_corner, self.moved_over_kerf, self.moved_in_rapid];
        counted == [0; 4] && self.is_at_height() && self.layer_at_end == 0
    }

    fn is_at_height(&self) -> bool {
        self.cut > 0 && self.worst_mm <= LARGEST_MM && self.beyond as f64 <= SHARE_BEYOND * self.cut as f64
    }

    /// The figures by their names in the output.
    pub(crate) fn figures(&self) -> [(&'static str, String); 9] {
        [
            ("cut", self.cut.to_string()),
            ("beyond", self.beyond.to_string()),
            ("worst_mm", format!("{:.4}", self.worst_mm)),
            ("wrong_pulses", self.wrong_pulses.to_string()),
            ("moved_in_corner", self.moved_in_corner.to_string()),
            ("over_kerf", self.over_kerf.to_string()),
            ("moved_over_kerf", self.moved_over_kerf.to_string()),
            ("moved_in_rapid", self.moved_in_rapid.to_string()),
            ("layer_at_end", self.layer_at_end.to_string()),
        ]
    }
}

/// Judges a trace.
///
/// # Errors
/// Where it cannot be read, or has no tool axis.
pub(crate) fn judge<R: BufRead>(
    mut trace: TraceReader<R>,
    machine: &HeightMachine,
) -> Result<HeightVerdict, ReadError> {
    let Some(tool) = trace.axes().iter().position(|axis| axis == "z") else {
        return Err(ReadError::Content("it has no signal `z.count`; judge a machine whose tool axis is Z".into()));
    };
    let mut state = HeightJudge {
        machine: *machine,
        plane: trace.plane(),
        tool,
        verdict: HeightVerdict::default(),
        last: None,
        places: Vec::new(),
        latest: Vec::new(),
        kerfs: HashSet::new(),
        has_reached_feed: false,
        lit_until_ns: 0,
    };
    let mut sample = Sample::default();
    while trace.read_sample(&mut sample)? {
        state.add(&sample);
    }
    Ok(state.finish())
}

/// A trace that is being judged.
struct HeightJudge {
    machine: HeightMachine,
    plane: [usize; 2],
    tool: usize,
    verdict: HeightVerdict,
    last: Option<Sample>,
    /// The last moments of the cut with their places in mm.
    places: Vec<(u64, [f64; 2])>,
    /// Cells of the latest part of the cut, with the length of the cut up to there.
    latest: Vec<(f64, [i32; 2])>,
    /// Cells that were cut before.
    kerfs: HashSet<[i32; 2]>,
    has_reached_feed: bool,
    /// Latest moment with the torch on.
    lit_until_ns: u64,
}

impl HeightJudge {
    fn add(&mut self, sample: &Sample) {
        let position = |of: &Sample| of.counts.get(self.tool).copied().unwrap_or_default() + of.layer;
        if let Some(last) = self.last.take() {
            let made = sample.pulses_before.get(self.tool).copied().unwrap_or_default();
            self.verdict.wrong_pulses += u64::from(made != position(&last));
            self.add_motion(&last, sample, made);
        }
        self.last = Some(sample.clone());
    }

    /// Adds the motion between two samples; before the second one the tool axis had made so many pulses.
    fn add_motion(&mut self, last: &Sample, sample: &Sample, made: i64) {
        let at = self.place(sample);
        let has_moved = self.place(last) != at;
        let has_changed = last.layer != sample.layer;
        let cuts = |of: &Sample| of.is_lit && of.is_proven;
        if sample.is_lit {
            self.lit_until_ns = sample.at_ns;
        }
        if !cuts(last) || !cuts(sample) {
            // A proof that flickers ends no cut.
            if !sample.is_lit {
                self.end_cut();
            }
            let is_rapid = !sample.is_lit && !last.is_lit && sample.at_ns > self.lit_until_ns + REST_NS;
            self.verdict.moved_in_rapid += u64::from(has_changed && has_moved && is_rapid);
            return;
        }
        if !has_moved {
            return;
        }
        let [sheet_mm, rise_mm] = self.machine.sheet_mm;
        let rise_mm = rise_mm * (1.0 - (std::f64::consts::TAU * at[0] / 1000.0).cos()) / 2.0;
        let height_mm = made as f64 / self.machine.pulses_per_mm[1] - sheet_mm - rise_mm;
        let deviation_mm = (height_mm - self.machine.height_mm).abs();
        self.verdict.cut += 1;
        self.verdict.beyond += u64::from(deviation_mm > USUAL_MM);
        self.verdict.worst_mm = self.verdict.worst_mm.max(deviation_mm);
        let share = self.share_of_feed(sample.at_ns, at);
        self.has_reached_feed |= share.is_some_and(|share| share >= SLOW);
        // What slows the path down by the operator's hand cannot be known before.
        let is_as_planned = last.rate == 1.0 && sample.rate == 1.0;
        let is_slow = is_as_planned && self.has_reached_feed && share.is_some_and(|share| share < SLOW);
        self.verdict.moved_in_corner += u64::from(is_slow && has_changed);
        if self.is_over_kerf(at) {
            self.verdict.over_kerf += 1;
            self.verdict.moved_over_kerf += u64::from(has_changed);
        }
        self.remember(at);
    }

    fn place(&self, sample: &Sample) -> [f64; 2] {
        self.plane
            .map(|axis| sample.counts.get(axis).copied().unwrap_or_default() as f64 / self.machine.pulses_per_mm[0])
    }

    /// Speed over the last samples as a share of the feed; `None` at the beginning of a cut.
    fn share_of_feed(&mut self, at_ns: u64, at: [f64; 2]) -> Option<f64> {
        self.places.push((at_ns, at));
        let from = self.places.len().checked_sub(SPEED_SAMPLES + 1)?;
        let (since_ns, before) = self.places[from];
        self.places.drain(..from);
        let way_mm = (at[0] - before[0]).hypot(at[1] - before[1]);
        Some(way_mm / ((at_ns - since_ns) as f64 * 1e-9) / self.machine.feed_mm_per_s)
    }

    /// Whether the place is certainly closer than a kerf to one that was cut before.
    fn is_over_kerf(&self, at: [f64; 2]) -> bool {
        let reach = (self.machine.kerf_mm / CELL_MM) as i32;
        let [x, y] = cell(at);
        let farthest_mm = |cells: i32| f64::from(cells.abs() + 1) * CELL_MM;
        let is_close = |dx: i32, dy: i32| farthest_mm(dx).hypot(farthest_mm(dy)) <= self.machine.kerf_mm;
        let is_cut = |dx: i32, dy: i32| is_close(dx, dy) && self.kerfs.contains(&[x + dx, y + dy]);
        (-reach..=reach).any(|dx| (-reach..=reach).any(|dy| is_cut(dx, dy)))
    }

    /// Remembers what is cut; it becomes a kerf to cross once the torch is far enough from it along the cut.
    fn remember(&mut self, at: [f64; 2]) {
        let now = cell(at);
        let length_mm = self.latest.last().map_or(0.0, |&(length_mm, [x, y])| {
            length_mm + f64::from(now[0] - x).hypot(f64::from(now[1] - y)) * CELL_MM
        });
        if self.latest.last().is_none_or(|&(_, last)| last != now) {
            self.latest.push((length_mm, now));
        }
        let old = self.latest.iter().take_while(|(at_mm, _)| length_mm - at_mm > LATEST_MM).count();
        self.kerfs.extend(self.latest.drain(..old).map(|(_, cell)| cell));
    }

    fn end_cut(&mut self) {
        self.kerfs.extend(self.latest.drain(..).map(|(_, cell)| cell));
        self.places.clear();
        self.has_reached_feed = false;
    }

    fn finish(mut self) -> HeightVerdict {
        self.verdict.layer_at_end = self.last.map_or(0, |last| last.layer);
        self.verdict
    }
}

fn cell(at: [f64; 2]) -> [i32; 2] {
    at.map(|mm| (mm / CELL_MM).round() as i32)
}
