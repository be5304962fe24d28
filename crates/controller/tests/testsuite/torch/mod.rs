//! Jobs of a torch with an arc-ok input on a simulated machine: loss and recovery of the cut, contours, shifted starts;
//! and of a jet.
//!
//! Invariant: what was cut is taken from the periods in which the torch was on and proven, and is compared with a job
//! that was not interrupted.

mod contours;
mod jets;
mod late_instructions;
mod lead_ins;
mod losses;

use retrace_config::MachineConfig;
use retrace_controller::{
    CommandSources, CutterState, Event, EventKind, JobEnd, JobOptions, JobStart, Observer, PeriodRecord, RunMode,
    ScriptPlayer, Telemetry, interpreter_setup, parse_script, run_job,
};
use retrace_core::{Place, RecordIndex};
use retrace_hal_sim::{Clock, PlantSettings, SimCard, SourceSettings, source_faults};
use retrace_journal::JournalConfig;
use retrace_link::{MotionCard, PathStart, channel};
use std::collections::{HashMap, HashSet};

use crate::wired::Decoder;

/// The output that fires the torch; a jet has another one.
const FIRE: u8 = channel::SPINDLE;
/// The input that proves it.
const PROOF: u8 = 5;
const PULSES_PER_MM: f64 = 200.0;

/// Line 4 is a cut of 60 mm in 2 s.
const PROGRAM: &str = "G21 G90 F1800\nG0 X10\nM3 S1\nG1 X70\nM5\nG0 X100\nM3\nG1 X160\nM5\nG0 X0\nM2\n";

/// A machine whose torch pierces for 0.4 s.
fn machine_text() -> String {
    let axis = |name: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = \
             100\nmax_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-50, 500]\n"
        )
    };
    let torch = "[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nok = { input = 5 }\n\
                 start = { start_s = 1.0, retry_s = 0.5, pierce_s = 0.4 }\n";
    format!("{torch}{}{}{}", axis("x"), axis("y"), axis("z"))
}

fn machine() -> MachineConfig {
    parsed(&machine_text())
}

fn parsed(text: &str) -> MachineConfig {
    MachineConfig::parse(text, "cutter").expect("valid")
}

/// A job, with all its telemetry.
struct Run<C = SimCard<4>> {
    end: JobEnd<C>,
    periods: Vec<PeriodRecord<4>>,
    /// Whether the torch was on in each period.
    lit: Vec<bool>,
    events: Vec<Event>,
}

struct Log {
    fire: u8,
    is_lit: bool,
    periods: Vec<PeriodRecord<4>>,
    lit: Vec<bool>,
    events: Vec<Event>,
}

impl Observer<4> for Log {
    fn on_telemetry(&mut self, told: &Telemetry<4>) {
        match told {
            Telemetry::Period(period) => {
                self.periods.push(*period);
                self.lit.push(self.is_lit);
            }
            Telemetry::Output(change) if change.channel == self.fire => self.is_lit = change.value != 0,
            Telemetry::Event(event) => self.events.push(event.clone()),
            Telemetry::Output(_) | Telemetry::Active(_) => {}
        }
        assert!(
            self.periods.len() < 1_000_000,
            "it hangs: {:#?}",
            self.events.iter().map(Event::text).collect::<Vec<_>>()
        );
    }
}

/// Runs a program on a machine whose source has these faults, with a scripted operator.
fn run(machine: &MachineConfig, program: &str, faults: &str, script: &str) -> Run {
    run_part(machine, program, script, JobStart::First, card(machine, faults))
}

/// A card at rest, whose source has these faults.
fn card(machine: &MachineConfig, faults: &str) -> SimCard<4> {
    let source = SourceSettings {
        channel: machine.cutting_outputs[0],
        input: PROOF,
        nm_per_pulse: [(1e6 / PULSES_PER_MM) as u32; 2],
        voltage: None,
        needs_metal: true,
        faults: source_faults(faults).expect("valid"),
    };
    let plant = PlantSettings { sources: vec![source], ..PlantSettings::default() };
    let settings = machine.card_settings::<4>(PathStart::at(RecordIndex::new(0)));
    SimCard::with_machine(settings, &plant, Clock::Virtual).expect("it opens")
}

/// Runs a job, or the rest of it, on a card.
fn run_part<C: MotionCard<4>>(
    machine: &MachineConfig,
    program: &str,
    script: &str,
    start: JobStart,
    card: C,
) -> Run<C> {
    let script = ScriptPlayer::new(parse_script(script, "script").expect("a script"), machine.period_us);
    let options = JobOptions {
        start,
        commands: CommandSources::from_script(script),
        run_mode: RunMode { wall_time: false, operator: true, real_time: false },
        journal: JournalConfig::default(),
    };
    let fire = machine.cutting_outputs[0];
    let mut log = Log { fire, is_lit: false, periods: Vec::new(), lit: Vec::new(), events: Vec::new() };
    let decoder = Decoder::with_setup(program, interpreter_setup(machine));
    let end = run_job(machine, decoder, options, card, &mut log).expect("a job");
    Run { end, periods: log.periods, lit: log.lit, events: log.events }
}

impl<C: MotionCard<4>> Run<C> {
    fn counts(&self) -> [i64; 4] {
        self.end.card.status().counts
    }

    /// Position of X and Y in mm at the end of each period, and whether the torch cut in it.
    fn strokes(&self) -> impl Iterator<Item = ([f64; 2], bool)> {
        self.periods.iter().zip(&self.lit).map(|(period, &lit)| {
            let at = [0, 1].map(|axis| period.counts[axis] as f64 / PULSES_PER_MM);
            (at, lit && period.inputs >> PROOF & 1 == 1)
        })
    }

    /// What was cut, in squares of 0.1 mm.
    fn cut_squares(&self) -> HashSet<[i64; 2]> {
        let strokes: Vec<([f64; 2], bool)> = self.strokes().collect();
        let mut cut = HashSet::new();
        for pair in strokes.windows(2).filter(|pair| pair[0].1 && pair[1].1) {
            for part in 0..8 {
                let at =
                    [0, 1].map(|axis| pair[0].0[axis] + (pair[1].0[axis] - pair[0].0[axis]) * f64::from(part) / 8.0);
                cut.insert(at.map(|mm| (mm * 10.0).round() as i64));
            }
        }
        cut
    }

    /// Where the torch was lit, in mm.
    fn ignitions(&self) -> Vec<[f64; 2]> {
        let lit = self.lit.windows(2).enumerate().filter(|(_, pair)| !pair[0] && pair[1]);
        lit.map(|(at, _)| [0, 1].map(|axis| self.periods[at + 1].counts[axis] as f64 / PULSES_PER_MM)).collect()
    }

    /// Counts at each record boundary of the path.
    fn positions(&self) -> HashMap<Place, [i64; 4]> {
        let on_path = self.periods.iter().filter(|period| !period.off_path && period.place.fraction == 0);
        on_path.map(|period| (period.place, period.counts)).collect()
    }

    /// The events that `pick` returns something for.
    fn picked<T>(&self, pick: impl FnMut(&EventKind) -> Option<T>) -> Vec<T> {
        self.events.iter().map(|event| &event.kind).filter_map(pick).collect()
    }

    /// The states of the torch, each with the number of its contour.
    fn states(&self) -> Vec<(CutterState, u32)> {
        self.picked(|kind| match *kind {
            EventKind::CutterState { state, contour, .. } => Some((state, contour)),
            _ => None,
        })
    }

    /// The ends of contours: number, and length in mm that is not cut.
    fn contours(&self) -> Vec<(u32, f64)> {
        self.picked(|kind| match *kind {
            EventKind::Contour { number, not_cut_mm, .. } => Some((number, not_cut_mm)),
            _ => None,
        })
    }

    fn rejections(&self) -> Vec<String> {
        self.picked(|kind| match kind {
            EventKind::CommandRejected(why) => Some(why.to_string()),
            _ => None,
        })
    }

    fn count(&self, what: &EventKind) -> usize {
        self.events.iter().filter(|event| event.kind == *what).count()
    }

    /// Asserts that the part is that of an uninterrupted job: its counts at every place, and all that it cut.
    fn assert_part_of(&self, whole: &Run) {
        let texts = || self.events.iter().map(Event::text).collect::<Vec<_>>();
        assert_eq!((&self.end.outcome, self.counts()), (&whole.end.outcome, whole.counts()), "{:#?}", texts());
        let positions = whole.positions();
        for (place, counts) in self.positions() {
            assert_eq!(Some(&counts), positions.get(&place), "{place:?} {:#?}", texts());
        }
        let cut = self.cut_squares();
        let missing: Vec<_> = whole.cut_squares().into_iter().filter(|square| !cut.contains(square)).collect();
        assert!(missing.is_empty(), "{missing:?} {:#?}", texts());
    }

    /// Asserts that the torch was never on while the path ran backward, and rests with it on only to start and to end.
    fn assert_safe(&self) {
        let backward = self.periods.iter().zip(&self.lit).filter(|(period, lit)| **lit && period.rate.signum() < 0);
        assert_eq!(backward.count(), 0);
        assert!(!self.lit[self.lit.len() - 1]);
    }
}
