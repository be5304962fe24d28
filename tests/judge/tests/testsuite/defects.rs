//! Seeded defects of a controller, each of which the judge has to find by its own figure.
//!
//! Invariant: a defect changes a good trace in one respect, at a place that depends on the seed.

use crate::synthetic::{Period, Random, Trace, counts_at};
use crate::{cut_judge, figure, folder};
use std::fs;

/// Number of seeds of each defect.
const SEEDS: u64 = 20;

/// What a controller does wrong, the figure that finds it, and how the trace is changed.
type Defect = (&'static str, &'static str, fn(&mut Trace, &mut Random));

fn put_out(period: &mut Period) {
    (period.is_lit, period.is_proven) = (false, false);
}

fn light(period: &mut Period) {
    period.is_lit = true;
}

fn stand(period: &mut Period) {
    (period.rate, period.at_rest) = (0.0, true);
}

const ON_AT_REST: [Defect; 6] = [
    ("lit one period too long at the end of a contour", "standing", |trace, _| {
        trace.insert(trace.contour_end, 1, |_| {})
    }),
    ("lit at rest in a hold in the cut", "standing", |trace, chance| {
        let at = trace.join + 1 + chance.below(20);
        trace.insert(at, 2 + chance.below(500), stand);
    }),
    ("lit at rest behind a loss", "standing", |trace, _| {
        let (loss, back) = (trace.loss.clone(), trace.back.start);
        trace.change(loss.start..back, light);
    }),
    ("lit behind the pierce without a motion", "standing", |trace, chance| {
        let at = trace.first_start.end - 1;
        trace.insert(at, 114 + chance.below(50), |_| {});
    }),
    ("lit behind the last motion", "lit_after_motion", |trace, chance| {
        let begin = trace.end + chance.below(40);
        trace.change(begin..begin + 104, light);
    }),
    ("on at the end", "on_at_end", |trace, chance| {
        let last = trace.periods.len();
        trace.change(last - 1 - chance.below(100)..last, light);
    }),
];

const STARTS: [Defect; 5] = [
    ("feed one period before the pierce is over", "too_early", |trace, chance| {
        let start = if chance.below(2) == 0 { &trace.first_start } else { &trace.second_start };
        let _ = trace.periods.remove(start.end - 1 - chance.below(300));
    }),
    ("feed without an arc at the pierce", "too_early", |trace, chance| {
        let start = trace.second_start.clone();
        trace.change(start.start..start.end + 1 + chance.below(3), |period| period.is_proven = false);
    }),
    ("feed in the kerf one period before the pilot time is over", "too_early", |trace, chance| {
        let start = trace.restart.clone();
        let _ = trace.periods.remove(start.start + chance.below(start.len()));
    }),
    ("motion from the ignition on", "too_early", |trace, _| drop(trace.periods.drain(trace.second_start.clone()))),
    ("ignited at a wrong place", "ignited_elsewhere", |trace, chance| {
        let at = trace.rapid.start + 10 + chance.below(30);
        trace.insert(at, 1, stand);
        trace.insert(at, 5 + chance.below(100), |period| {
            stand(period);
            light(period);
        });
    }),
];

const NOT_CUT: [Defect; 7] = [
    ("loss placed two records late, so that a gap remains", "records_not_cut", |trace, _| trace.pierce_behind_loss(2)),
    ("cutter not lit after the restart", "not_cut", |trace, _| {
        trace.change(trace.restart.start..trace.contour_end, put_out)
    }),
    ("cutter lit after the restart without an arc", "not_cut", |trace, _| {
        trace.change(trace.restart.start..trace.contour_end, |period| period.is_proven = false)
    }),
    ("a loss in the cut that is not noticed", "not_cut", |trace, chance| {
        let begin = trace.slow.end + chance.below(15);
        trace.change(begin..begin + 10, |period| period.is_proven = false);
    }),
    ("a contour passed with the cutter off", "not_cut", |trace, _| {
        trace.change(trace.second_start.start..trace.second_end + 1, put_out)
    }),
    ("the job ends in a contour", "not_cut", |trace, chance| {
        let at = trace.second_end - 10 - chance.below(40);
        trace.periods.truncate(at);
        trace.change(at - 1..at, put_out);
    }),
    ("a recovery that goes on at the place of rest", "records_not_cut", |trace, _| {
        let rests = trace.periods[trace.back.start - 1].place;
        let skipped = trace.periods[trace.join..].iter().take_while(|period| period.place <= rests).count();
        trace.change(trace.join..trace.join + skipped, |period| period.is_proven = false);
    }),
];

const WRONG_MOTION: [Defect; 8] = [
    ("X one pulse off from the join on", "wrong_counts", |trace, _| {
        let last = trace.periods.len();
        trace.change(trace.join..last, |period| period.counts[0] += 1);
    }),
    ("Z one pulse off in the cut after the join", "wrong_counts", |trace, chance| {
        trace.change(trace.join + chance.below(10)..trace.contour_end, |period| period.counts[2] -= 1)
    }),
    ("the fourth axis one pulse off", "wrong_counts", |trace, chance| {
        trace.change(trace.slow.end + chance.below(20)..trace.second_end, |period| period.counts[3] += 1)
    }),
    ("a pulse lost on the way back", "wrong_counts", |trace, chance| {
        trace.change(trace.back.start + 1 + chance.below(20)..trace.back.end, |period| period.counts[1] += 1)
    }),
    ("a sideways shift of 0.1 mm that is not taken back", "cut_besides", |trace, chance| {
        let shift = [-20, 20][chance.below(2)];
        trace.change(trace.second_start.start..trace.second_end, |period| period.counts[1] += shift);
    }),
    ("a way beside the path between two places", "cut_besides", |trace, chance| {
        let at = trace.slow.start + chance.below(15);
        trace.change(at..at + 20, |period| period.counts[1] += if period.place.fract() == 0.0 { 0 } else { 40 });
    }),
    ("increments of a record skipped", "wrong_counts", |trace, chance| {
        let (at, last) = (trace.join + chance.below(20), trace.periods.len());
        let record = record_counts(&trace.periods[at]);
        trace.change(at..last, |period| (0..4).for_each(|axis| period.counts[axis] -= record[axis]));
    }),
    ("increments of a record played twice", "wrong_counts", |trace, chance| {
        let (at, last) = (trace.join + chance.below(20), trace.periods.len());
        let record = record_counts(&trace.periods[at]);
        trace.change(at..last, |period| (0..4).for_each(|axis| period.counts[axis] += record[axis]));
    }),
];

const LIT_IN_MOTION: [Defect; 5] = [
    ("cutter lit while running backward", "backward", |trace, chance| {
        let end = trace.back.end;
        trace.change(end - 1 - chance.below(30)..end, light);
    }),
    ("cutter lit in a rapid", "lit_in_rapid", |trace, chance| {
        let begin = trace.rapid.start + 5 + chance.below(40);
        trace.change(begin..begin + 2 + chance.below(10), light);
    }),
    ("cutter put out in the rapid and not before it", "lit_in_rapid", |trace, chance| {
        let begin = trace.contour_end;
        trace.change(begin..trace.rapid.start + 2 + chance.below(20), light);
    }),
    ("cutter on for three periods under an alarm in the cut", "lit_under_alarm", |trace, chance| {
        let begin = trace.join + chance.below(25);
        trace.change(begin..begin + 3, |period| period.alarm = 17);
    }),
    ("cutter on in the pierce under an alarm", "lit_under_alarm", |trace, chance| {
        let begin = trace.second_start.start + chance.below(200);
        trace.change(begin..trace.second_start.end, |period| period.alarm = 3);
    }),
];

/// Increments of the record that ends at the place of a period.
fn record_counts(period: &Period) -> [i64; 4] {
    let (from, to) = (counts_at(period.place - 1.0), counts_at(period.place));
    std::array::from_fn(|axis| to[axis] - from[axis])
}

#[test]
fn a_loss_that_is_placed_one_record_late_is_within_the_tolerance() {
    let folder = folder("tolerance");
    let (whole, late) = (folder.join("whole.vcd"), folder.join("late.vcd"));
    fs::write(&whole, Trace::whole().vcd()).expect("a trace");
    for seed in 0..SEEDS {
        let mut trace = Trace::recovered(&mut Random::new(seed));
        trace.pierce_behind_loss(1);
        fs::write(&late, trace.vcd()).expect("a trace");
        let output = cut_judge(&[&whole, &late].map(|path| path.to_str().expect("a path")));
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stdout));
    }
}

/// The arc goes out in the last records of a contour, which emit this many pulses, and another recovery may
/// try them again. Returns the judge's line.
fn judge_loss_at_the_end(pulses: i64, is_tried: bool) -> String {
    let folder = folder("no-length");
    let file = |name: &str, is_lost: bool, mut trace: Trace| {
        let end = trace.periods[trace.contour_end].place;
        if is_lost && is_tried {
            trace.try_the_end_again();
        }
        let from = counts_at(end - 7.0);
        for period in trace.periods.iter_mut().filter(|period| period.place > end - 7.0 && period.place <= end) {
            period.counts = from;
            period.counts[0] += if period.place > end - 4.0 { pulses } else { 0 };
            period.is_proven &= !is_lost;
        }
        let path = folder.join(format!("{name}-{pulses}-{is_tried}.vcd"));
        fs::write(&path, trace.vcd()).expect("a trace");
        path.display().to_string()
    };
    let whole = file("whole", false, Trace::whole());
    let lost = file("lost", true, Trace::recovered(&mut Random::new(1)));
    String::from_utf8_lossy(&cut_judge(&[&whole, &lost]).stdout).into_owned()
}

#[test]
fn records_without_a_length_are_no_gap() {
    for pulses in [0, 1] {
        assert_eq!(figure(&judge_loss_at_the_end(pulses, false), "records_not_cut"), "0", "{pulses}");
    }
    assert_ne!(figure(&judge_loss_at_the_end(2, false), "records_not_cut"), "0");
}

/// No arc strikes again within the cell that was cut last.
#[test]
fn the_end_of_a_contour_within_a_cell_that_was_tried_again_is_no_gap() {
    for pulses in [2, 10] {
        assert_eq!(figure(&judge_loss_at_the_end(pulses, true), "records_not_cut"), "0", "{pulses}");
    }
    assert_ne!(figure(&judge_loss_at_the_end(20, true), "records_not_cut"), "0");
}

#[test]
fn an_arc_that_goes_out_before_it_is_proven_is_a_start_that_failed() {
    let folder = folder("failed-start");
    let (whole, tried) = (folder.join("whole.vcd"), folder.join("tried.vcd"));
    fs::write(&whole, Trace::whole().vcd()).expect("a trace");
    let mut trace = Trace::recovered(&mut Random::new(1));
    let at = trace.first_start.start;
    trace.insert(at, 500, put_out);
    for (periods, is_proven) in [(900, false), (3, true), (50, false)] {
        trace.insert(at, periods, |period| (period.is_lit, period.is_proven) = (true, is_proven));
    }
    fs::write(&tried, trace.vcd()).expect("a trace");
    let output = cut_judge(&[&whole, &tried].map(|path| path.to_str().expect("a path")));
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stdout));
}

#[test]
fn every_seeded_defect_is_found_and_the_trace_without_it_is_good() {
    let folder = folder("defects");
    let file = |name: String, text: String| {
        let path = folder.join(name);
        fs::write(&path, text).expect("a trace");
        path.display().to_string()
    };
    let whole = file("whole.vcd".into(), Trace::whole().vcd());
    let good: Vec<String> = (0..SEEDS)
        .map(|seed| file(format!("good-{seed}.vcd"), Trace::recovered(&mut Random::new(seed)).vcd()))
        .collect();
    let defects = [&ON_AT_REST[..], &STARTS, &NOT_CUT, &WRONG_MOTION, &LIT_IN_MOTION].concat();
    let mut failures = Vec::new();
    for (name, found_by, seed_defect) in &defects {
        let mut arguments = vec![whole.clone()];
        for (seed, good) in (0..SEEDS).zip(&good) {
            let mut chance = Random::new(seed);
            let mut trace = Trace::recovered(&mut chance);
            seed_defect(&mut trace, &mut chance);
            arguments.extend([good.clone(), file(format!("bad-{seed}.vcd"), trace.vcd())]);
        }
        let output = cut_judge(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
        let text = String::from_utf8_lossy(&output.stdout);
        assert_eq!(output.status.code(), Some(1), "{name}: {}", String::from_utf8_lossy(&output.stderr));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len() as u64, 2 * SEEDS, "{name}");
        for (index, line) in lines.iter().enumerate() {
            let is_found = figure(line, "good") == "false" && !["0", "false"].contains(&figure(line, found_by));
            let is_right = if index % 2 == 0 { figure(line, "good") == "true" } else { is_found };
            if !is_right {
                failures.push(format!("{name} ({found_by}): {line}"));
            }
        }
    }
    println!("{} defects, {SEEDS} seeds each", defects.len());
    assert!(failures.is_empty(), "{} of them:\n{}", failures.len(), failures.join("\n"));
}
