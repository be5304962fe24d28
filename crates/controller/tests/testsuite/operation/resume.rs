//! A job that is cut off anywhere and resumed runs what it would have run: for any program, at any place, any number of
//! times.
//!
//! Invariant: the second part is compared with an uninterrupted run.

use std::sync::{Arc, Mutex};

use retrace_config::MachineConfig;
use retrace_controller::{
    EventKind, JobEnd, JobStart, JobStartError, Outcome, ResumeError, ResumePlan, ResumePoint, resume_job, run_job,
};
use retrace_core::{Rate, RecordIndex};
use retrace_hal_sim::{Random, SimCard};
use retrace_journal::{IndexEntry, IndexWriter, JournalConfig, PlaceMark};
use retrace_link::{MotionCard, Outputs, PathStart, channel};

use super::jobs::{AXES, Decoder, Log, card, complete, machine, options};
use crate::wired::{self, Path};

type Card = SimCard<AXES>;

/// Stores all index entries.
#[derive(Clone, Default)]
struct Kept(Arc<Mutex<Vec<IndexEntry>>>);

impl IndexWriter for Kept {
    fn write(&mut self, note: IndexEntry) {
        self.0.lock().expect("one at a time").push(note);
    }
}

impl Kept {
    fn marks(&self) -> Vec<PlaceMark> {
        let notes = self.0.lock().expect("done");
        notes.iter().filter_map(|note| if let IndexEntry::Mark(mark) = note { Some(*mark) } else { None }).collect()
    }

    fn overrides(&self) -> Vec<(RecordIndex, Rate)> {
        let notes = self.0.lock().expect("done");
        let changed = |note: &IndexEntry| {
            if let IndexEntry::Override { place, planned } = note { Some((*place, *planned)) } else { None }
        };
        notes.iter().filter_map(changed).collect()
    }

    fn resumption(&self, left: &Card) -> ResumePoint {
        let status = left.status();
        let start = PathStart {
            place: status.place,
            rests: false,
            reached: status.reached,
            executed: status.executed,
            keeps_state: false,
        };
        ResumePoint { overrides: self.overrides(), marks: self.marks(), ..ResumePoint::at(start, RecordIndex::new(0)) }
    }
}

/// A run, or a part of one.
fn part(machine: &MachineConfig, text: &str, script: &str, begin: JobStart, card: Card) -> (JobEnd<Card>, Log, Kept) {
    let (mut log, kept) = (Log::default(), Kept::default());
    let keeping = JournalConfig { index: Box::new(kept.clone()), durable: None };
    let options = options(machine, script, begin, keeping);
    let end = run_job(machine, Decoder::new(text), options, card, &mut log).expect("a job");
    (end, log, kept)
}

/// In every period a part is at the position of the path there, and new motion begins at `reached`.
fn is_on(path: &Path, log: &Log) -> Result<(), String> {
    for period in &log.periods {
        let counts = path.position(period.place);
        if period.counts != counts {
            return Err(format!("off the path {counts:?}: {period:?}"));
        }
    }
    Ok(())
}

#[test]
fn whatever_is_cut_off_anywhere_goes_on_as_if_it_had_not_been() {
    let number = |name: &str, usual| std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(usual);
    let (cases, first) = (number("RETRACE_CASES", 60), number("RETRACE_FIRST_SEED", 1));
    let machine = machine(600.0);
    let (mut inside, mut behind, mut cuts) = (0, 0, 0);
    for seed in first..first + cases {
        let mut random = Random::new(seed);
        let text = wired::program(&mut random, 12);
        let path = Path::of(&machine, &text);
        let (mut card, mut begin) = (card(&machine), JobStart::First);
        loop {
            let wait = f64::from(random.up_to(1500)) / 1000.0;
            let script = match random.up_to(3) {
                0 => String::new(),
                1 => format!("after {wait}s hold\nafter 1s stop\n"),
                2 => {
                    format!("after {wait}s reverse {}%\nafter 0.{}s stop\n", 20 + random.up_to(80), 1 + random.up_to(8))
                }
                _ => wired::script(&mut random) + &format!("after {wait}s stop\n"),
            };
            let (end, log, kept) = part(&machine, &text, &script, begin, card);
            is_on(&path, &log).unwrap_or_else(|why| panic!("seed {seed}: {why}\n{text}\n{script}"));
            card = end.card;
            if end.outcome == Outcome::Completed {
                break;
            }
            assert_eq!(end.outcome, Outcome::Stopped, "seed {seed}");
            let status = *card.status();
            cuts += 1;
            inside += u32::from(status.place.fraction != 0);
            behind += u32::from((status.place.record + 1).is_before(status.reached));
            begin = JobStart::At(Box::new(kept.resumption(&card)));
        }
        let status = card.status();
        assert_eq!(Some(&status.counts), path.counts.last(), "seed {seed}");
        assert_eq!(status.executed as usize, path.markers.len(), "seed {seed}: every instruction once");
    }
    assert!(cases < 60 || inside > 20 && behind > 5 && cuts > 40, "{inside} {behind} {cuts}");
}

const LAPS: &str = "G21 G64 P0.05 F2400\nM3\nG1 X20\nG1 Y20\nM62 P2\nG1 X0\nG1 Y0\nG1 X20\nG1 Y20\nG1 X0\nG1 Y0\nM2\n";

/// The plan of a resumed job before it continues; not confirmed.
fn prepared(
    machine: &MachineConfig,
    text: &str,
    at: ResumePoint,
    card: Card,
) -> (Option<ResumePlan<AXES>>, Result<JobEnd<Card>, JobStartError>) {
    let mut seen = None;
    let options = options(machine, "", JobStart::At(Box::new(at)), JournalConfig::default());
    let end = resume_job(machine, Decoder::new(text), options, card, &mut Log::default(), |prepared| {
        seen = Some(prepared.clone());
        false
    });
    (seen, end)
}

#[test]
fn overrides_that_were_planned_are_planned_again_at_their_places() {
    let machine = machine(600.0);
    let words = "at 0.4s override 150%\nafter 0.7s override 120%\n";
    let (_, plain) = complete(&machine, LAPS, words);
    let (end, _, kept) = part(&machine, LAPS, &format!("{words}after 1s stop\n"), JobStart::First, card(&machine));
    let at = kept.resumption(&end.card);
    assert_eq!(at.overrides.len(), 2);
    let (end, log, _) = part(&machine, LAPS, "", JobStart::At(Box::new(at)), end.card);
    assert_eq!(end.outcome, Outcome::Completed);
    let boundaries = |log: &Log| {
        log.periods.iter().filter(|p| p.place.fraction == 0).map(|p| (p.place.record, p.counts)).collect::<Vec<_>>()
    };
    let whole: std::collections::HashMap<_, _> = boundaries(&plain).into_iter().collect();
    let checked =
        boundaries(&log).into_iter().filter(|(n, counts)| whole.get(n).inspect(|c| assert_eq!(*c, counts)).is_some());
    assert!(checked.count() > 500);
    assert_eq!(
        log.periods.last().map(|p| (p.place, p.counts, p.override_rate)),
        plain.periods.last().map(|p| (p.place, p.counts, p.override_rate))
    );
}

/// The place is planned again with what the program has switched off before it.
#[test]
fn a_job_that_is_left_where_overrides_are_off_is_resumed_so() {
    let machine = machine(600.0);
    let text = "G21 G64 P0.05 F1200\nG1 X10\nM49\nG1 X20 Y5\nX10 Y10\nX0\nM48\nG1 X0 Y0\nM2\n";
    let first = "at 0s override 150%\nat line 5 override 40%\nafter 0.1s ";
    for leaves in ["stop\n", "reverse 100%\nafter 0.2s stop\n", "reverse 100%\nafter 0.9s stop\n"] {
        let script = format!("{first}{leaves}");
        let (end, log, kept) = part(&machine, text, &script, JobStart::First, card(&machine));
        assert_eq!(end.outcome, Outcome::Stopped);
        let left = *log.periods.last().expect("periods");
        let at = JobStart::At(Box::new(kept.resumption(&end.card)));
        let (end, log, _) = part(&machine, text, "at 0s override 40%\n", at, end.card);
        assert_eq!(end.outcome, Outcome::Completed);
        let is_off = |line: u32| (4..=6).contains(&line);
        let mut whole = 0;
        for period in log.periods.iter().filter(|period| period.rate != Rate::ZERO) {
            // Where it comes to a switch, the rate is still that before it.
            assert!(period.at_rest || period.override_is_off == is_off(period.line), "{leaves}: {period:?}");
            // It starts inside of a record, and comes to its rate.
            let from_rest = period.reached.since(left.reached) < 300 && left.reached != period.reached;
            let is_right = if is_off(period.line) {
                from_rest || period.reached == left.reached || period.rate == Rate::ONE
            } else {
                period.rate <= Rate::percent(40)
            };
            assert!(is_right, "{leaves}: {period:?}");
            whole += u32::from(is_off(period.line) && period.rate == Rate::ONE);
        }
        assert!(whole > 500, "{leaves}: {whole}");
    }
}

#[test]
fn what_will_be_done_is_told_before_anything_moves() {
    let machine = machine(600.0);
    let (end, log, kept) =
        part(&machine, LAPS, "at 1.2s reverse 100%\nafter 0.3s stop\n", JobStart::First, card(&machine));
    let (status, at) = (*end.card.status(), kept.resumption(&end.card));
    let (seen, again) = prepared(&machine, LAPS, at, end.card);
    let (seen, again) = (seen.expect("it was asked"), again.expect("a job"));
    assert_eq!(
        (seen.counts(), seen.oldest(), seen.planned_override()),
        (status.counts, RecordIndex::new(0), Rate::ONE)
    );
    // the stop has switched the spindle off
    let spindle = usize::from(channel::SPINDLE);
    let mut expected = status.outputs;
    assert_eq!(std::mem::replace(&mut expected[spindle], 1), 0);
    assert_eq!((seen.expected_outputs(), seen.matches_card()), (&expected, true));
    assert_eq!(seen.line(), log.periods.last().expect("periods").line);
    assert_eq!((again.outcome, again.stats.periods), (Outcome::Stopped, 0));
    assert_eq!(again.card.status().period, status.period, "nothing has moved");
}

#[test]
fn outputs_are_brought_back_by_their_instructions_before_anything_moves() {
    let machine = machine(600.0);
    let (end, _, kept) = part(
        &machine,
        LAPS,
        "at 1.9s output 2 off\nafter 0s reverse 50%\nafter 0.5s stop\n",
        JobStart::First,
        card(&machine),
    );
    let at = kept.resumption(&end.card);
    let left = at.start.place;
    let (end, log, _) = part(&machine, LAPS, "", JobStart::At(Box::new(at)), end.card);
    assert_eq!(end.outcome, Outcome::Completed);
    assert_eq!(log.event(|h| *h == EventKind::RestartSwitched("M3")).place, left);
    let restored = log.event(|h| *h == EventKind::OutputsRestored);
    assert_eq!(restored.place, left);
    assert!(log.periods.iter().all(|period| period.place == left || period.period > restored.period));
}

#[test]
fn what_is_not_the_same_is_refused_with_the_reason() {
    let machine = machine(600.0);
    let (end, _, kept) = part(&machine, LAPS, "at 1.2s stop\n", JobStart::First, card(&machine));
    let at = kept.resumption(&end.card);
    let outputs: Outputs = end.card.status().outputs;
    let unfound = |text: &str, at: &ResumePoint| {
        let standing = card(&machine).with_position([0; AXES], &outputs);
        match prepared(&machine, text, at.clone(), standing) {
            (None, Err(JobStartError::Resume(why))) => why,
            other => panic!("{:?}", other.0),
        }
    };
    let slower = LAPS.replace("F2400", "F2300");
    assert!(matches!(unfound(&slower, &at), ResumeError::Differs(_)));
    let blocks = LAPS.replace("M3\n", "M3\n\n");
    assert!(matches!(unfound(&blocks, &at), ResumeError::Differs(_)), "lines and blocks count, too");
    let unmarked = ResumePoint { marks: Vec::new(), ..at.clone() };
    assert!(matches!(unfound("G21 F2400\nM3\nG1 X1\n", &unmarked), ResumeError::ProgramEnds { .. }));
    let wrong = |executed| ResumePoint { start: PathStart { executed, ..at.start }, ..unmarked.clone() };
    assert!(matches!(unfound(LAPS, &wrong(0)), ResumeError::Instruction { number: 1, .. }));
    assert!(
        matches!(unfound(LAPS, &wrong(2)), ResumeError::Instruction { number: 2, .. }),
        "{:?}",
        unfound(LAPS, &wrong(2))
    );
    let mut far = at.clone();
    far.marks.push(PlaceMark { place: at.start.reached + 501, ..PlaceMark::default() });
    assert_eq!(unfound(LAPS, &far), ResumeError::NoSuchPlace, "farther than anything was planned");
    let nowhere = PathStart { reached: (at.start.place.record - 1), ..at.start };
    assert_eq!(unfound(LAPS, &ResumePoint { start: nowhere, ..unmarked.clone() }), ResumeError::NoSuchPlace);
    // The counts differ: this is detected, and the job does not continue by itself.
    let elsewhere = card(&machine).with_position([1, 0, 0, 0], &outputs);
    let (end, log, _) = part(&machine, LAPS, "", JobStart::At(Box::new(at)), elsewhere);
    assert_eq!((end.outcome, log.periods.len()), (Outcome::Stopped, 0));
}

/// Where the axes are elsewhere and the operator agrees, they go to the place first, and then on from it.
#[test]
fn axes_that_are_elsewhere_return_to_the_place_first() {
    let machine = machine(600.0);
    let (end, _, kept) = part(&machine, LAPS, "at 1.2s stop\n", JobStart::First, card(&machine));
    let (at, left, outputs) = (kept.resumption(&end.card), *end.card.status(), end.card.status().outputs);
    let (plain, _) = complete(&machine, LAPS, "");
    let mut counts = left.counts;
    (0..3).for_each(|axis| counts[axis] += [3000, -1000, 2000][axis]);
    let elsewhere = card(&machine).with_position(counts, &outputs);
    let mut log = Log::default();
    let options = options(&machine, "", JobStart::At(Box::new(at)), JournalConfig::default());
    let end = resume_job(&machine, Decoder::new(LAPS), options, elsewhere, &mut log, |plan| {
        assert!(!plan.matches_card());
        let moves = plan.return_path(&machine).expect("within the limits");
        assert_eq!((moves.last(), plan.counts()), (Some(&left.counts), left.counts));
        true
    });
    let end = end.expect("a job");
    assert_eq!((end.outcome, end.card.status().counts), (Outcome::Completed, plain.card.status().counts));
    let path = Path::of(&machine, LAPS);
    let on_path: Vec<_> = log.periods.iter().skip_while(|period| period.off_path).collect();
    assert!(on_path.len() > 1000 && on_path.len() + 100 < log.periods.len());
    for period in on_path {
        assert_eq!(period.counts, path.position(period.place), "{period:?}");
    }
}
