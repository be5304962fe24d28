//! Speed laws compared with the optimum on the same path (Q10), over windows that are drawn by their share of the time.
//!
//! Invariant: windows and random paths follow from a seed, which is reported; by default it is the time, so that
//! each run draws afresh.

use std::time::{SystemTime, UNIX_EPOCH};

use retrace_motion::{MachineLimits, PlanMode, PlannedSection, Planner};

use crate::canon;
use crate::law_optimum::{Node, least_time};
use crate::legality;
use crate::row::{Goal, Row};
use crate::test_paths::Numbers;

/// Programs of which windows are taken, in the folder that `RETRACE_CANON` names, as `retrace canon` prints them.
const PROGRAMS: [&str; 5] = ["stellabee1", "3D_Chips", "LHchips4", "Cereal", "Pasta"];
/// Windows of each program, and random paths.
const WINDOWS: usize = 8;
const PATHS: usize = 20;
/// Longest and shortest window, s.
const LENGTH: (f64, f64) = (1.5, 0.05);
/// Spacing of the nodes, s, and the part of it below which a border of two pieces has no node.
const SPACING: (f64, f64) = (1e-3, 0.3);
/// Speed below which a window ends, mm/s: near rest the square of the speed has no grid.
const SLOWEST: f64 = 3.0;
/// Time between two states of the plan, s.
const STEP: f64 = 2.5e-4;

/// Part of a planned section, as states of the plan: time, place, speed and acceleration.
struct LawWindow<'s> {
    section: &'s PlannedSection<3>,
    states: Vec<[f64; 4]>,
}

/// States of the plan of a section, [`STEP`] apart or less.
fn states_of(section: &PlannedSection<3>) -> Vec<[f64; 4]> {
    let (mut all, mut time, mut place) = (Vec::new(), 0.0, 0.0);
    for (profile, length) in &section.profiles {
        let duration = profile.duration();
        let steps = (duration / STEP).ceil().max(1.0);
        for k in 0..steps as usize {
            let t = duration * k as f64 / steps;
            let state = profile.at(t);
            all.push([time + t, place + state.s, state.v, state.a]);
        }
        (time, place) = (time + duration, place + length);
    }
    let end = section.profiles.last().map(|(profile, _)| profile.end()).unwrap_or_default();
    all.push([time, place, end.v, end.a]);
    all
}

/// The parts of a section that are in motion and have a curve, at most as long as a window.
fn windows_of(section: &PlannedSection<3>, numbers: &mut Numbers) -> Vec<Vec<[f64; 4]>> {
    let states = states_of(section);
    let mut all = Vec::new();
    for moving in states.split(|state| state[2] < SLOWEST) {
        let Some((first, last)) = moving.first().zip(moving.last()) else { continue };
        let seconds = last[0] - first[0];
        let count = (seconds / LENGTH.0).floor();
        let begin = first[0] + numbers.share() * (seconds - count * LENGTH.0);
        if seconds < LENGTH.0 {
            all.push(moving.to_vec());
        }
        for k in 0..count as usize {
            let index = |time: f64| moving.partition_point(|state| state[0] < time);
            let from = index(begin + k as f64 * LENGTH.0);
            all.push(moving[from..=index(begin + (k + 1) as f64 * LENGTH.0).min(moving.len() - 1)].to_vec());
        }
    }
    all.retain(|states| states[states.len() - 1][0] - states[0][0] >= LENGTH.1 && is_curved(section, states));
    all
}

fn is_curved(section: &PlannedSection<3>, states: &[[f64; 4]]) -> bool {
    let (from, to) = (states[0][1], states[states.len() - 1][1]);
    let mut place = 0.0;
    section.pieces.iter().any(|piece| {
        let begin = place;
        place += piece.length_mm;
        begin < to && place > from && !piece.is_line()
    })
}

impl LawWindow<'_> {
    /// Time that the plan takes, s.
    fn seconds(&self) -> f64 {
        self.states[self.states.len() - 1][0] - self.states[0][0]
    }

    /// State of the plan at a place, its square interpolated.
    fn state_at(&self, place: f64) -> (f64, f64, f64) {
        let next = self.states.partition_point(|state| state[1] < place).clamp(1, self.states.len() - 1);
        let (from, to) = (self.states[next - 1], self.states[next]);
        let part = ((place - from[1]) / (to[1] - from[1]).max(1e-12)).clamp(0.0, 1.0);
        let between = |from: f64, to: f64| from + part * (to - from);
        (place, between(from[2] * from[2], to[2] * to[2]).sqrt(), between(from[3], to[3]))
    }

    /// Nodes about a spacing of the plan apart, at the borders of pieces where these are not too close.
    fn nodes(&self) -> Vec<Node> {
        let (from, to) = (self.states[0][1], self.states[self.states.len() - 1][1]);
        let mut nodes: Vec<Node> = Vec::new();
        let (mut begin, mut before) = (0.0, None);
        for piece in &self.section.pieces {
            let end: f64 = begin + piece.length_mm;
            let mut place = from.max(begin);
            while place < end.min(to) {
                let (_, v, a) = self.state_at(place);
                let spacing = SPACING.0 * v;
                let is_border = place <= begin;
                let is_close = nodes.last().is_some_and(|last| place - last.s < SPACING.1 * spacing);
                if !is_close {
                    nodes.push(Node::new((place, v, a), (piece, place - begin), before.filter(|_| is_border)));
                } else if let (true, Some(last)) = (is_border, nodes.last_mut()) {
                    last.cap = last.cap.min(piece.speed_mm_s);
                }
                let left = end.min(to) - place;
                place += left / (left / spacing).ceil().max(1.0);
                // Rounding must not leave a sliver before the border.
                place = if end.min(to) - place < 1e-9 { end.min(to) } else { place };
            }
            if begin < to && end >= to {
                let state = self.states[self.states.len() - 1];
                nodes.push(Node::new((to, state[2], state[3]), (piece, to - begin), None));
            }
            (begin, before) = (end, Some(piece));
        }
        nodes
    }
}

/// Result of one window: ours and the optimum, s.
struct Compared {
    ours: f64,
    optimum: f64,
}

/// Compares windows of `sections`, at most `most` of them, drawn by their share of the time.
fn compare(sections: &[PlannedSection<3>], most: usize, numbers: &mut Numbers) -> Vec<Compared> {
    let mut windows: Vec<LawWindow<'_>> = Vec::new();
    for section in sections {
        windows.extend(windows_of(section, numbers).into_iter().map(|states| LawWindow { section, states }));
    }
    let mut all = Vec::new();
    while all.len() < most && !windows.is_empty() {
        let total: f64 = windows.iter().map(LawWindow::seconds).sum();
        let mut left = numbers.share() * total;
        let drawn = windows.iter().position(|window| {
            left -= window.seconds();
            left <= 0.0
        });
        let window = windows.swap_remove(drawn.unwrap_or(0));
        let nodes = window.nodes();
        let Some(optimum) = least_time(&nodes) else {
            eprintln!("no optimum of a window of {:.3} s", window.seconds());
            continue;
        };
        all.push(Compared { ours: window.seconds(), optimum });
    }
    all
}

/// Sections of a plan, and how often no plan was found for a section.
fn planned(mode: PlanMode, play: impl FnOnce(&mut Planner<3>)) -> (Vec<PlannedSection<3>>, u64) {
    let planner = Planner::new(MachineLimits::built_in(), [0.0; 3]).expect("the built-in machine is valid");
    let mut planner = planner.with_plan_mode(mode);
    play(&mut planner);
    (planner.planned_sections(), planner.fallbacks().no_plan)
}

/// Windows of a program, or of all random paths.
struct WindowGroup {
    name: String,
    windows: Vec<Compared>,
    /// How often no plan was found.
    fallbacks: u64,
}

/// Windows of each program, and of random paths.
fn groups(mode: PlanMode, seed: u64) -> Vec<WindowGroup> {
    let mut all = Vec::new();
    let folder = std::env::var_os("RETRACE_CANON").map(std::path::PathBuf::from);
    for (program, offset) in PROGRAMS.into_iter().zip(1..) {
        let file = folder.as_ref().map(|folder| folder.join(format!("{program}.canon")));
        let Some(text) = file.and_then(|file| std::fs::read_to_string(file).ok()) else { continue };
        let (sections, fallbacks) = planned(mode, |planner| canon::play(&text, planner));
        let windows = compare(&sections, WINDOWS, &mut Numbers(seed + offset));
        all.push(WindowGroup { name: program.to_owned(), windows, fallbacks });
    }
    let mut random = WindowGroup { name: "random paths".to_owned(), windows: Vec::new(), fallbacks: 0 };
    for k in 0.. {
        let path = legality::random(seed.wrapping_mul(1000) + k);
        let (sections, fallbacks) = planned(mode, |planner| {
            (0..path.moves.len()).for_each(|k| path.push(planner, k));
            planner.stop(retrace_core::Flags::NONE);
        });
        random.windows.extend(compare(&sections, 1, &mut Numbers(seed + k)));
        random.fallbacks += fallbacks;
        if random.windows.len() >= PATHS {
            break;
        }
    }
    all.push(random);
    all
}

/// Rows of Q10.
pub(crate) fn rows(_full: bool) -> Vec<Row> {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let seed = std::env::var("RETRACE_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(now);
    [(PlanMode::Best, "best"), (PlanMode::Fast, "fast")].into_iter().flat_map(|mode| of_mode(mode, seed)).collect()
}

fn of_mode((mode, name): (PlanMode, &str), seed: u64) -> Vec<Row> {
    let groups = groups(mode, seed);
    let mut note = format!("seed {seed}; ");
    let (mut sum, mut count, mut worst) = (0.0, 0usize, (0.0f64, ""));
    for WindowGroup { name, windows, .. } in &groups {
        let ratios: Vec<f64> = windows.iter().map(|window| window.ours / window.optimum).collect();
        let seconds: f64 = windows.iter().map(|window| window.ours).sum();
        note += &format!("{name}, {} windows of {seconds:.2} s:", ratios.len());
        for ratio in ratios {
            note += &format!(" {ratio:.3}");
            (sum, count) = (sum + ratio, count + 1);
            worst = if ratio > worst.0 { (ratio, name) } else { worst };
        }
        note += "; ";
    }
    let goals = if mode == PlanMode::Best { [Goal::AtMost(1.05), Goal::AtMost(1.1)] } else { [Goal::None; 2] };
    let what = |of: &str| format!("`{name}`, time over the optimum on the same path, {count} windows, {of}");
    let row = |what, figure, goal, note| Row { name: "Q10", what, figure, unit: "", goal, note };
    let fallbacks: u64 = groups.iter().map(|group| group.fallbacks).sum();
    let of_groups = groups.iter().map(|group| format!("{} {}", group.name, group.fallbacks));
    let mean = sum / count.max(1) as f64;
    vec![
        row(what("mean"), mean, goals[0], note),
        row(what(&format!("worst: {}", worst.1)), worst.0, goals[1], String::new()),
        row(
            format!("`{name}`, sections of these programs and paths for which no plan was found"),
            fallbacks as f64,
            Goal::AtMost(0.0),
            of_groups.collect::<Vec<_>>().join(", "),
        ),
    ]
}
