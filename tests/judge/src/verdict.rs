//! Judges a trace: was the same cut made as in the job without an interruption, and was the cutter on only where it
//! may be?
//!
//! Invariant: a verdict depends on the two traces and the figures of the machine alone; what a trace leaves open, such
//! as the moment between two samples at which an arc goes out, is decided for the controller.

use crate::kerf::{CELL_MM, Kerf};
use crate::place_ranges::PlaceRanges;
use crate::vcd::{ReadError, Sample, TraceReader};
use std::collections::HashMap;
use std::io::BufRead;

/// Tolerance of a place, in records.
const PLACE_TOLERANCE: f64 = 1.0;
/// Longest time in ms from the end of the pierce to the first motion, and of a cutter that is on behind the last
/// motion, but for `HANDOVER_PERIODS`.
const HANDOVER_MS: f64 = 100.0;
/// Time in ms for which an input is active before the pierce begins.
const PROOF_MS: f64 = 10.0;
/// Periods that a message between host and card takes beside the handover.
const HANDOVER_PERIODS: f64 = 3.0;
/// Periods that the cutter may be on at rest once it has moved.
const MAX_REST_PERIODS: f64 = 1.0;
/// Periods that the cutter may be on with an alarm latched.
const MAX_ALARM_PERIODS: f64 = 2.0;

/// What the judge knows of the machine.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JudgedMachine {
    /// Pulses per mm of X and Y.
    pub(crate) pulses_per_mm: f64,
    /// Time in ms from the proof to the first motion.
    pub(crate) pierce_ms: f64,
    /// Shortest time in ms from the ignition to the first motion of a start in the kerf.
    pub(crate) pilot_ms: f64,
    /// Control period in ms.
    pub(crate) period_ms: f64,
    /// Time in ms that the cutter may be on at rest once it has moved, beyond `MAX_REST_PERIODS`.
    pub(crate) standing_ms: f64,
    /// Whether the job may have lead-ins: motion of no line of the program, whose places are not those of the path.
    pub(crate) has_lead_ins: bool,
}

/// What the judge found.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Verdict {
    /// Cells of the sheet that the uninterrupted job cut and the other did not.
    pub(crate) not_cut: usize,
    /// Cells that only the interrupted job cut.
    pub(crate) cut_besides: usize,
    /// Length in records of the gaps of more than one record that only the uninterrupted job cut.
    pub(crate) records_not_cut: f64,
    /// Samples at a place of the uninterrupted job with other counts.
    pub(crate) wrong_counts: usize,
    /// Ignitions at which motion began too early.
    pub(crate) too_early: usize,
    /// Times that the cutter was on at rest for too long.
    pub(crate) standing: usize,
    /// Samples with the cutter on and the path running backward.
    pub(crate) backward: usize,
    /// Samples with the cutter on in a rapid.
    pub(crate) lit_in_rapid: usize,
    /// Times that the cutter was on with an alarm latched for too long.
    pub(crate) lit_under_alarm: usize,
    /// Whether the cutter was on for too long behind the last motion.
    pub(crate) lit_after_motion: bool,
    /// Ignitions at a place at which the uninterrupted job never has the cutter on.
    pub(crate) ignited_elsewhere: usize,
    /// Whether the cutter is on at the end.
    pub(crate) on_at_end: bool,
    /// Number of ignitions.
    pub(crate) ignitions: usize,
    /// Length in mm that was cut, with what was cut twice.
    pub(crate) cut_mm: f64,
}

impl Verdict {
    /// Whether the part is whole and the cutter was never on where it must not be.
    pub(crate) fn is_good(&self) -> bool {
        let allowed = Self { ignitions: self.ignitions, cut_mm: self.cut_mm, ..Self::default() };
        *self == allowed
    }

    /// The figures by their names in the output; numbers and truth values as JSON has them.
    pub(crate) fn figures(&self) -> [(&'static str, String); 14] {
        [
            ("not_cut", self.not_cut.to_string()),
            ("cut_besides", self.cut_besides.to_string()),
            ("records_not_cut", self.records_not_cut.to_string()),
            ("wrong_counts", self.wrong_counts.to_string()),
            ("too_early", self.too_early.to_string()),
            ("standing", self.standing.to_string()),
            ("backward", self.backward.to_string()),
            ("lit_in_rapid", self.lit_in_rapid.to_string()),
            ("lit_under_alarm", self.lit_under_alarm.to_string()),
            ("lit_after_motion", self.lit_after_motion.to_string()),
            ("ignited_elsewhere", self.ignited_elsewhere.to_string()),
            ("on_at_end", self.on_at_end.to_string()),
            ("ignitions", self.ignitions.to_string()),
            ("cut_mm", self.cut_mm.to_string()),
        ]
    }
}

fn whole_place(sample: &Sample) -> Option<u64> {
    (sample.place >= 0.0 && sample.place.fract() == 0.0).then_some(sample.place as u64)
}

fn is_in_motion(from: &Sample, to: &Sample) -> bool {
    to.rate != 0.0 || from.place != to.place
}

/// The job without an interruption.
#[derive(Debug, Default)]
pub(crate) struct ReferenceJob {
    axes: Vec<String>,
    /// Indices of X and Y.
    plane: [usize; 2],
    kerf: Kerf,
    counts: HashMap<u64, Vec<i64>>,
    /// Where the cutter is on.
    lit: PlaceRanges,
    /// Where the machine moves with the cutter off.
    rapids: PlaceRanges,
}

impl ReferenceJob {
    /// Reads the whole trace.
    ///
    /// # Errors
    /// Where the trace cannot be read, or nothing is cut in it: any trace would be as good.
    pub(crate) fn read<R: BufRead>(mut trace: TraceReader<R>, machine: &JudgedMachine) -> Result<Self, ReadError> {
        let plane = trace.plane();
        let mut job = Self { axes: trace.axes().to_vec(), plane, ..Self::default() };
        let (mut before, mut now) = (Sample::default(), Sample::default());
        let mut is_first = true;
        while trace.read_sample(&mut now)? {
            if let Some(place) = whole_place(&now) {
                job.counts.insert(place, now.counts.clone());
            }
            if now.is_lit {
                job.lit.insert(now.place, now.place);
            }
            if !is_first {
                job.kerf.add(&before, &now, plane, machine.pulses_per_mm);
                if before.is_lit && now.is_lit {
                    job.lit.insert(before.place, now.place);
                } else if !before.is_lit && !now.is_lit && is_in_motion(&before, &now) {
                    job.rapids.insert(before.place, now.place);
                }
            }
            is_first = false;
            std::mem::swap(&mut before, &mut now);
        }
        if job.kerf.places.is_empty() {
            let text = "nothing is cut in it: the output of --fire is never on while the input of --input is active; \
                        correct these two, or give the trace of the job that ran without an interruption";
            return Err(ReadError::Content(text.into()));
        }
        Ok(job)
    }

    /// Length in records of the gaps that the other kerf leaves, beyond the tolerance of a place. An arc that is
    /// ignited before the gap strikes behind the cell that was cut last, or not at all before the contour ends. Where
    /// the machine comes to rest, records with at most one pulse among them have no length.
    fn records_not_cut(&self, kerf: &Kerf, cell_pulses: f64) -> f64 {
        let is_gap = |[from, to]: &[f64; 2]| {
            let end = to - PLACE_TOLERANCE;
            let is_in_cell = || kerf.is_tried([*from, *to]) && self.pulses(*from, end) <= cell_pulses;
            end > *from && self.pulses(*from, *to) > 1.0 && !is_in_cell()
        };
        let gaps = self.kerf.places.missing_in(&kerf.possible_places);
        gaps.iter().filter(|gap| is_gap(gap)).fold(0.0, |length, [from, to]| length + (to - from))
    }

    /// Length in pulses of X and Y between two places; infinite where the trace does not have it.
    fn pulses(&self, from: f64, to: f64) -> f64 {
        let mut pulses = 0.0;
        for record in from as u64..to.ceil() as u64 {
            let Some((begin, end)) = self.counts.get(&record).zip(self.counts.get(&(record + 1))) else {
                return f64::INFINITY;
            };
            let [dx, dy] = self.plane.map(|axis| (end[axis] - begin[axis]) as f64);
            let share = to.min((record + 1) as f64) - from.max(record as f64);
            pulses += share * dx.hypot(dy);
        }
        pulses
    }
}

/// Compares a trace with the job without an interruption.
///
/// # Errors
/// Where the trace cannot be read, or has other axes.
pub(crate) fn judge<R: BufRead>(
    job: &ReferenceJob,
    mut trace: TraceReader<R>,
    machine: &JudgedMachine,
) -> Result<Verdict, ReadError> {
    if trace.axes() != job.axes {
        let (axes, others) = (trace.axes().join(", "), job.axes.join(", "));
        let text = format!("it has the axes {axes}, the uninterrupted job {others}; give traces of the same machine");
        return Err(ReadError::Content(text));
    }
    let mut judge = Judge::new(job, machine);
    let (mut before, mut now) = (Sample::default(), Sample::default());
    let mut is_first = true;
    while trace.read_sample(&mut now)? {
        if is_first {
            before.clone_from(&now);
            before.is_lit = false;
            is_first = false;
        }
        judge.judge_sample(&before, &now);
        let is_lead_in = machine.has_lead_ins && !(before.has_line && now.has_line);
        if is_lead_in {
            judge.kerf.add_lead_in(&before, &now, job.plane, machine.pulses_per_mm);
        } else {
            judge.kerf.add(&before, &now, job.plane, machine.pulses_per_mm);
        }
        std::mem::swap(&mut before, &mut now);
    }
    Ok(judge.finish(&before))
}

/// A cutter that is on.
#[derive(Debug)]
struct Ignition {
    at_ns: u64,
    place: f64,
    proven_ns: Option<u64>,
    /// Since when the input has been inactive.
    unproven_ns: Option<u64>,
    has_moved: bool,
    /// Since when the machine rests, and whether that was counted as too long.
    rest: Option<(u64, bool)>,
    /// Since when an alarm is latched, and whether that was counted as too long.
    alarm: Option<(u64, bool)>,
}

/// What is known of a trace up to a sample.
#[derive(Debug)]
struct Judge<'j> {
    job: &'j ReferenceJob,
    pierce_ns: u64,
    pilot_ns: u64,
    handover_ns: u64,
    /// Longest time from the proof to the first motion.
    max_pierce_ns: u64,
    /// Longest time without the input that is a flicker.
    max_flicker_ns: u64,
    max_rest_ns: u64,
    max_alarm_ns: u64,
    /// Diagonal of a cell.
    cell_pulses: f64,
    has_lead_ins: bool,
    verdict: Verdict,
    kerf: Kerf,
    ignition: Option<Ignition>,
    lit_since_motion_ns: u64,
}

impl<'j> Judge<'j> {
    fn new(job: &'j ReferenceJob, machine: &JudgedMachine) -> Self {
        let ns = |ms: f64| (ms * 1e6).round() as u64;
        let handover_ms = HANDOVER_MS + HANDOVER_PERIODS * machine.period_ms;
        Self {
            job,
            pierce_ns: ns(machine.pierce_ms),
            pilot_ns: ns(machine.pilot_ms),
            handover_ns: ns(handover_ms),
            max_pierce_ns: ns(machine.pierce_ms + PROOF_MS + handover_ms),
            max_flicker_ns: ns(PROOF_MS + HANDOVER_PERIODS * machine.period_ms),
            max_rest_ns: ns(machine.standing_ms + MAX_REST_PERIODS * machine.period_ms),
            max_alarm_ns: ns(MAX_ALARM_PERIODS * machine.period_ms),
            cell_pulses: CELL_MM * std::f64::consts::SQRT_2 * machine.pulses_per_mm,
            has_lead_ins: machine.has_lead_ins,
            verdict: Verdict::default(),
            kerf: Kerf::default(),
            ignition: None,
            lit_since_motion_ns: 0,
        }
    }

    /// Judges what was from `before` until `now`, and what is from `now` on.
    fn judge_sample(&mut self, before: &Sample, now: &Sample) {
        let moves = is_in_motion(before, now);
        if before.is_lit {
            self.lit_since_motion_ns += now.at_ns - before.at_ns;
        }
        if moves {
            self.lit_since_motion_ns = 0;
        }
        let is_on_path = now.has_line || !self.has_lead_ins;
        if whole_place(now)
            .filter(|_| is_on_path)
            .and_then(|place| self.job.counts.get(&place))
            .is_some_and(|counts| *counts != now.counts)
        {
            self.verdict.wrong_counts += 1;
        }
        self.verdict.backward += usize::from(now.is_lit && now.rate < 0.0);
        let is_in_rapid =
            is_on_path && self.job.rapids.contains(now.place) && self.job.lit.distance(now.place) > PLACE_TOLERANCE;
        self.verdict.lit_in_rapid += usize::from(before.is_lit && now.is_lit && moves && is_in_rapid);
        self.judge_durations(now.at_ns);
        if now.is_lit {
            self.judge_lit(now);
        } else {
            self.ignition = None;
        }
    }

    /// Counts what has lasted for too long at this moment.
    fn judge_durations(&mut self, at_ns: u64) {
        let Some(ignition) = &mut self.ignition else { return };
        // An arc that goes out before the end of the pierce is a start that failed; a flicker is not.
        let is_out = ignition.unproven_ns.is_some_and(|since_ns| at_ns - since_ns > self.max_flicker_ns);
        if is_out && !ignition.has_moved {
            ignition.proven_ns = None;
        }
        if let Some((since_ns, is_counted @ false)) = &mut ignition.rest {
            *is_counted = if ignition.has_moved {
                at_ns - *since_ns > self.max_rest_ns
            } else {
                ignition.proven_ns.is_some_and(|proven_ns| at_ns - proven_ns > self.max_pierce_ns)
            };
            self.verdict.standing += usize::from(*is_counted);
        }
        if let Some((since_ns, is_counted @ false)) = &mut ignition.alarm {
            *is_counted = at_ns - *since_ns > self.max_alarm_ns;
            self.verdict.lit_under_alarm += usize::from(*is_counted);
        }
    }

    /// Judges a sample with the cutter on.
    fn judge_lit(&mut self, now: &Sample) {
        let (verdict, kerf, job) = (&mut self.verdict, &self.kerf, self.job);
        let is_on_path = now.has_line || !self.has_lead_ins;
        let ignition = self.ignition.get_or_insert_with(|| {
            verdict.ignitions += 1;
            verdict.ignited_elsewhere += usize::from(is_on_path && job.lit.distance(now.place) > PLACE_TOLERANCE);
            let (at_ns, place) = (now.at_ns, now.place);
            Ignition { at_ns, place, proven_ns: None, unproven_ns: None, has_moved: false, rest: None, alarm: None }
        });
        if now.is_proven {
            ignition.proven_ns.get_or_insert(now.at_ns);
            ignition.unproven_ns = None;
        } else {
            ignition.unproven_ns.get_or_insert(now.at_ns);
        }
        if now.rate != 0.0 && !ignition.has_moved {
            ignition.has_moved = true;
            let is_pierced = ignition.proven_ns.is_some_and(|proven_ns| now.at_ns - proven_ns >= self.pierce_ns);
            // In a kerf of this job an arc may be lit in motion. At rest, the record may not be known.
            let is_in_kerf = is_on_path && kerf.places.distance(ignition.place) <= PLACE_TOLERANCE;
            let is_ready = is_pierced || is_in_kerf && now.at_ns - ignition.at_ns >= self.pilot_ns;
            verdict.too_early += usize::from(!is_ready);
        }
        if now.rate == 0.0 && now.at_rest {
            ignition.rest.get_or_insert((now.at_ns, false));
        } else {
            ignition.rest = None;
        }
        if now.has_alarm {
            ignition.alarm.get_or_insert((now.at_ns, false));
        } else {
            ignition.alarm = None;
        }
    }

    /// The verdict, behind the last sample.
    fn finish(self, last: &Sample) -> Verdict {
        let (job, kerf) = (&self.job.kerf, &self.kerf);
        Verdict {
            not_cut: job.cells_beside(kerf),
            cut_besides: kerf.cells_beside(job),
            records_not_cut: self.job.records_not_cut(kerf, self.cell_pulses),
            lit_after_motion: self.lit_since_motion_ns > self.handover_ns,
            on_at_end: last.is_lit,
            cut_mm: kerf.length_mm,
            ..self.verdict
        }
    }
}
