//! A judge of recoveries: compares the trace of a job that was interrupted with that of a job that was not (CUT,
//! section 8).
//!
//! Invariant: it has the two traces and the pulses per mm; it uses nothing of retrace itself.

use crate::pins::Sample;
use std::collections::{BTreeMap, HashSet};

/// Width of a cell of the sheet in mm.
const CELL_MM: f64 = 0.05;
/// Longest time in ms that a cutter may be on at rest before its input says that it burns: the attempts are checked by
/// their own time.
const HANDOVER_MS: f64 = 103.0;

/// What the judge knows of the machine.
#[derive(Clone, Copy, Debug)]
pub struct JudgedMachine {
    /// Pulses per mm of X and Y.
    pub pulses_per_mm: f64,
    /// Name of the output that fires.
    pub fire: &'static str,
    /// Number of the input that proves the cutter.
    pub input: u32,
    /// Time in ms from the proof to the first motion.
    pub pierce_ms: f64,
    /// Shortest time in ms from the ignition to the first motion.
    pub pilot_ms: f64,
}

/// What the judge found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Verdict {
    /// Cells of the sheet that the uninterrupted job cut and the other did not.
    pub not_cut: usize,
    /// Cells that only the interrupted job cut.
    pub cut_besides: usize,
    /// Places on the path at which the counts differ.
    pub wrong_counts: usize,
    /// Ignitions at which motion began too early.
    pub too_early: usize,
    /// Ignitions after which the cutter was on at rest for too long.
    pub standing: usize,
    /// Samples with the cutter on and the path running backward.
    pub backward: usize,
    /// Whether the cutter is on at the end.
    pub on_at_end: bool,
    /// Number of ignitions.
    pub ignitions: usize,
    /// Length in mm that was cut, with what was cut twice.
    pub cut_mm: f64,
}

impl Verdict {
    /// Whether the part is whole and the cutter was never on where it must not be.
    #[must_use]
    pub fn is_good(&self) -> bool {
        let Self { not_cut, cut_besides, wrong_counts, too_early, standing, backward, on_at_end, .. } = *self;
        [not_cut, cut_besides, wrong_counts, too_early, standing, backward] == [0; 6] && !on_at_end
    }
}

/// Compares a trace with that of an uninterrupted job.
#[must_use]
pub fn judge(uninterrupted: &[Sample], trace: &[Sample], machine: &JudgedMachine) -> Verdict {
    let mut verdict = Verdict::default();
    let (whole, _) = sheet(uninterrupted, machine);
    let (cut, cut_mm) = sheet(trace, machine);
    verdict.cut_mm = cut_mm;
    verdict.not_cut = cells_without_neighbour(&whole, &cut);
    verdict.cut_besides = cells_without_neighbour(&cut, &whole);
    let counts = counts_by_place(uninterrupted);
    verdict.wrong_counts = trace
        .iter()
        .filter_map(|sample| Some((counts.get(&whole_place(sample)?)?, sample)))
        .filter(|(counts, sample)| **counts != sample.counts)
        .count();
    verdict.backward = trace.iter().filter(|sample| sample.is_on(machine.fire) && sample.rate < 0.0).count();
    verdict.on_at_end = trace.last().is_some_and(|sample| sample.is_on(machine.fire));
    judge_ignitions(trace, machine, &mut verdict);
    verdict
}

/// Number of cells of a sheet that have no cell of the other one at or beside them: where a job is slower, other cells
/// are touched at their corners.
fn cells_without_neighbour(cells: &HashSet<[i32; 2]>, others: &HashSet<[i32; 2]>) -> usize {
    let has_neighbour = |[x, y]: [i32; 2]| (-1..=1).any(|dx| (-1..=1).any(|dy| others.contains(&[x + dx, y + dy])));
    cells.iter().filter(|&&cell| !has_neighbour(cell)).count()
}

fn is_proven(sample: &Sample, machine: &JudgedMachine) -> bool {
    sample.inputs >> machine.input & 1 == 1
}

/// The cells that were cut, and the length in mm.
fn sheet(trace: &[Sample], machine: &JudgedMachine) -> (HashSet<[i32; 2]>, f64) {
    let (mut cells, mut length_mm) = (HashSet::new(), 0.0);
    for pair in trace.windows(2) {
        let [from, to] = pair else { continue };
        if !from.is_on(machine.fire) || !is_proven(from, machine) || !is_proven(to, machine) {
            continue;
        }
        let mm = |sample: &Sample, axis: usize| sample.counts[axis] as f64 / machine.pulses_per_mm;
        let (dx, dy) = (mm(to, 0) - mm(from, 0), mm(to, 1) - mm(from, 1));
        let length = dx.hypot(dy);
        length_mm += length;
        let steps = (length / CELL_MM * 4.0).ceil().max(1.0);
        for step in 0..=steps as u32 {
            let share = f64::from(step) / steps;
            let at = [mm(from, 0) + share * dx, mm(from, 1) + share * dy];
            cells.insert(at.map(|mm| (mm / CELL_MM).floor() as i32));
        }
    }
    (cells, length_mm)
}

fn whole_place(sample: &Sample) -> Option<u64> {
    (sample.place >= 0.0 && sample.place.fract() == 0.0).then_some(sample.place as u64)
}

fn counts_by_place(trace: &[Sample]) -> BTreeMap<u64, [i64; 3]> {
    trace.iter().filter_map(|sample| Some((whole_place(sample)?, sample.counts))).collect()
}

/// Checks the time from each ignition to the first motion, and how long the cutter is on at rest afterwards.
fn judge_ignitions(trace: &[Sample], machine: &JudgedMachine, verdict: &mut Verdict) {
    let ms = |from: u64, to: u64| (to - from) as f64 / 1000.0;
    let (mut lit_us, mut proven_us, mut moved, mut rests_us) = (None, None, false, None);
    for pair in trace.windows(2) {
        let [before, now] = pair else { continue };
        if !now.is_on(machine.fire) {
            (lit_us, proven_us, moved, rests_us) = (None, None, false, None);
            continue;
        }
        if !before.is_on(machine.fire) {
            verdict.ignitions += 1;
            lit_us = Some(now.at_us);
        }
        if is_proven(now, machine) {
            proven_us.get_or_insert(now.at_us);
        }
        let Some(lit) = lit_us else { continue };
        if now.rate != 0.0 && !moved {
            moved = true;
            let ready = match proven_us {
                Some(proven) => ms(proven, now.at_us) >= machine.pierce_ms || ms(lit, proven) > machine.pilot_ms,
                None => ms(lit, now.at_us) >= machine.pilot_ms,
            };
            verdict.too_early += usize::from(!ready);
        }
        // before the first motion: pierce and handover; afterwards, a torch goes out at once
        if now.rate == 0.0 && now.at_rest {
            let since = *rests_us.get_or_insert(now.at_us);
            let may_rest = if moved { 3.0 } else { f64::INFINITY };
            verdict.standing += usize::from(ms(since, now.at_us) > may_rest);
            let pierced = proven_us.is_some_and(|proven| ms(proven, now.at_us) > machine.pierce_ms + HANDOVER_MS);
            verdict.standing += usize::from(!moved && pierced);
        } else {
            rests_us = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MACHINE: JudgedMachine =
        JudgedMachine { pulses_per_mm: 100.0, fire: "spindle", input: 5, pierce_ms: 10.0, pilot_ms: 5.0 };

    /// A cut of 1 mm in 100 periods of 1 ms, after a start that takes 20 ms.
    fn cut() -> Vec<Sample> {
        let sample = |ms: u64| {
            let place = ms.saturating_sub(20).min(100);
            let mut sample = Sample {
                at_us: 1000 * ms,
                place: place as f64,
                rate: f64::from(u8::from((21..=120).contains(&ms))),
                at_rest: !(21..=120).contains(&ms),
                inputs: u64::from((5..=121).contains(&ms)) << 5,
                counts: [place as i64, 0, 0],
                ..Sample::default()
            };
            if (1..=121).contains(&ms) {
                sample.outputs.insert("spindle".into(), 1);
            }
            sample
        };
        (0..130).map(sample).collect()
    }

    fn judged(change: impl Fn(u64, &mut Sample)) -> Verdict {
        let mut trace = cut();
        trace.iter_mut().for_each(|sample| change(sample.at_us / 1000, sample));
        judge(&cut(), &trace, &MACHINE)
    }

    #[test]
    fn a_cut_is_as_good_as_itself() {
        let verdict = judged(|_, _| {});
        assert!(verdict.is_good() && verdict.ignitions == 1, "{verdict:?}");
        assert!((verdict.cut_mm - 1.0).abs() < 0.05);
    }

    #[test]
    fn each_defect_is_found_by_its_figure() {
        let off = |sample: &mut Sample| {
            sample.outputs.clear();
            sample.inputs = 0;
        };
        let off_in_the_cut = |ms, sample: &mut Sample| {
            if (60..80).contains(&ms) {
                off(sample);
            }
        };
        assert!(judged(off_in_the_cut).not_cut >= 1);
        let not_proven = |ms, sample: &mut Sample| {
            if (60..80).contains(&ms) {
                sample.inputs = 0;
            }
        };
        assert!(judged(not_proven).not_cut >= 1);
        let aside = judged(|ms, sample| {
            if ms > 60 {
                sample.counts[1] = 10
            }
        });
        assert!(aside.cut_besides > 5 && aside.wrong_counts > 50, "{aside:?}");
        let by_a_count = judged(|ms, sample| {
            if ms > 100 {
                sample.counts[2] += 1
            }
        });
        assert!(by_a_count.wrong_counts > 10, "{by_a_count:?}");
        assert_eq!(
            judged(|ms, sample| if (1..12).contains(&ms) {
                off(sample)
            })
            .too_early,
            1
        );
        assert!(
            judged(|ms, sample| if ms >= 119 {
                sample.outputs = cut()[100].outputs.clone()
            })
            .on_at_end
        );
        assert!(
            judged(|ms, sample| if ms == 80 {
                sample.rate = -1.0
            })
            .backward
                == 1
        );
        let stands = judged(|ms, sample| {
            if (70..80).contains(&ms) {
                (sample.rate, sample.at_rest) = (0.0, true)
            }
        });
        assert!(stands.standing > 3, "{stands:?}");
    }
}
