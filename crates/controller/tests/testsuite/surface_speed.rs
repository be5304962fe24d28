//! Constant surface speed: S along every move is that of the radius, and the path is what it is under G97 (SPN-9).
//!
//! Invariant: the radius is calculated from the moves that reach the sink, by formulas of this file.

use std::f64::consts::TAU;

use proptest::prelude::*;
use retrace_config::MachineConfig;
use retrace_controller::{
    BlockDecoder, Cancelled, CheckFinding, DecodedBlock, MotionSink, PlanWriteError, SwitchInstruction, feed_program,
};
use retrace_gcode::{Axis, AxisSet, CanonStep, Program, Progress, Setup};
use retrace_link::{OutputChange, channel};
use retrace_motion::{Arc, FeedRate, PathMode};

/// A move with its parts of one speed: the share of its length where each begins, and S in turns per minute.
#[derive(Debug)]
struct Turned {
    start: [f64; 3],
    end: [f64; 3],
    arc: Option<Arc<3>>,
    feed: FeedRate,
    mode: PathMode,
    line: u32,
    parts: Vec<(f64, f64)>,
}

impl Turned {
    /// Machine coordinate of X at a share of the move.
    fn x(&self, share: f64) -> f64 {
        let Some(arc) = self.arc else { return self.start[0] + share * (self.end[0] - self.start[0]) };
        let (begins, sweep) = arc.sweep(&self.start);
        let (at, [p, q]) = (begins + share * sweep, arc.plane);
        let radius = (self.start[p] - arc.centre_mm[0]).hypot(self.start[q] - arc.centre_mm[1]);
        match (p, q) {
            (0, _) => arc.centre_mm[0] + radius * at.cos(),
            (_, 0) => arc.centre_mm[1] + radius * at.sin(),
            _ => self.start[0] + share * (self.end[0] - self.start[0]),
        }
    }

    /// Shares in each part, with its S.
    fn samples(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        let ends = self.parts.iter().skip(1).map(|part| part.0).chain([1.0]);
        let inside =
            |from: f64, to: f64| (0..=8).map(move |k| from + (to - from) * (0.001 + 0.998 * f64::from(k) / 8.0));
        self.parts.iter().zip(ends).flat_map(move |(&(from, rpm), to)| inside(from, to).map(move |share| (share, rpm)))
    }
}

#[derive(Debug, Default)]
struct Lathe {
    at: [f64; 3],
    rpm: f64,
    waiting: Vec<(f64, f64)>,
    moves: Vec<Turned>,
    /// Code and S of each exclusive instruction that switches S.
    switched: Vec<(&'static str, f64)>,
}

impl Lathe {
    fn add(&mut self, end: [f64; 3], arc: Option<Arc<3>>, feed: FeedRate, mode: PathMode, line: u32) {
        let mut parts = vec![(0.0, self.rpm)];
        parts.append(&mut self.waiting);
        self.rpm = parts[parts.len() - 1].1;
        let start = std::mem::replace(&mut self.at, end);
        self.moves.push(Turned { start, end, arc, feed, mode, line, parts });
    }
}

impl MotionSink<3> for Lathe {
    fn straight(&mut self, end: [f64; 3], feed: FeedRate, mode: PathMode, line: u32) -> Result<(), PlanWriteError> {
        self.add(end, None, feed, mode, line);
        Ok(())
    }
    fn arc(&mut self, arc: &Arc<3>, feed: FeedRate, mode: PathMode, line: u32) -> Result<(), PlanWriteError> {
        self.add(arc.end_mm, Some(*arc), feed, mode, line);
        Ok(())
    }
    fn action(&mut self, change: OutputChange, _: u32) {
        assert_eq!(change.channel, channel::SPEED);
        self.rpm = f64::from(change.value) / 1000.0;
    }
    fn action_within(&mut self, share: f64, change: OutputChange, _: u32) {
        assert!(
            change.channel == channel::SPEED && share > self.waiting.last().map_or(0.0, |last| last.0) && share < 1.0
        );
        self.waiting.push((share, f64::from(change.value) / 1000.0));
    }
    fn exclusive(&mut self, switch: SwitchInstruction<'_>) -> Result<(), Cancelled> {
        for change in switch.changes.iter().filter(|change| change.channel == channel::SPEED) {
            self.rpm = f64::from(change.value) / 1000.0;
            self.switched.push((switch.code, self.rpm));
        }
        Ok(())
    }
    fn message(&mut self, _: String, _: u32) -> Result<(), Cancelled> {
        Ok(())
    }
}

struct Text(Program<std::io::Cursor<Vec<u8>>>);

impl BlockDecoder for Text {
    fn next_block(&mut self, steps: &mut Vec<CanonStep>) -> DecodedBlock {
        match self.0.advance(steps) {
            Progress::End => DecodedBlock::End,
            Progress::Line => DecodedBlock::Block,
            Progress::BlockError => DecodedBlock::BlockError(format!("{:?}", self.0.interpreter().diagnostics())),
        }
    }
}

fn turn_on(spindle: &str, text: &str) -> (Lathe, Vec<CheckFinding>) {
    let machine = MachineConfig::parse(&format!("[spindle]\nfeed_per_turn = \"commanded\"\n{spindle}"), "m.toml");
    let axes = AxisSet::from_axes(&Axis::ALL[..3]);
    let program = Program::new(std::io::Cursor::new(text.as_bytes().to_vec()), Setup { axes, ..Setup::default() });
    let (mut lathe, mut text) = (Lathe::default(), Text(program));
    let (_, findings) = feed_program(&machine.expect("valid"), &mut text, &mut lathe);
    let found = text.0.interpreter().diagnostics();
    assert!(found.is_empty(), "{found:?}");
    (lathe, findings)
}

fn turn(spindle: &str, text: &str) -> Lathe {
    let (lathe, findings) = turn_on(spindle, text);
    assert_eq!(findings, []);
    lathe
}

/// Surface speed, m/min.
const SURFACE: f64 = 150.0;

/// S is within 1 % of the exact speed, or at the limit that this exceeds.
fn check_speed(lathe: &Lathe, origin_mm: f64, [least, most]: [f64; 2]) -> Result<(), String> {
    for turned in lathe.moves.iter().filter(|turned| turned.line > 4) {
        for (share, rpm) in turned.samples() {
            let radius = (turned.x(share) - origin_mm).abs();
            let exact = SURFACE * 1000.0 / (TAU * radius);
            let [low, high] = [0.99, 1.01].map(|part| (part * exact).clamp(least, most));
            if !(low - 0.001..=high + 0.001).contains(&rpm) {
                return Err(format!("S{rpm} and not {exact} at X{radius}, {share} of {turned:?}"));
            }
        }
        if let Some(pair) = turned.parts.windows(2).find(|pair| (pair[1].1 / pair[0].1).ln().abs() > 0.01) {
            return Err(format!("a step of more than 1 %: {pair:?}"));
        }
    }
    Ok(())
}

/// A block of a turning program: rapids and feeds in X and Z, arcs about a centre beside the tool.
fn block() -> impl Strategy<Value = String> {
    let mm = || -80.0..80.0f64;
    let straight =
        (prop::sample::select(vec!["G0", "G1"]), mm(), mm()).prop_map(|(g, x, z)| format!("{g} X{x:.4} Z{z:.4}"));
    let arc = (any::<bool>(), 1.0..30.0f64, 0.0..TAU, 0.1..6.0f64).prop_map(|(is_cw, radius, from, sweep)| {
        // Of a G91 arc every word is a difference: to the centre, and to the end.
        let (i, k) = (-radius * from.sin(), -radius * from.cos());
        let to = from + if is_cw { -sweep } else { sweep };
        let (x, z) = (radius * to.sin() + i, radius * to.cos() + k);
        format!("G91 {} X{x:.6} Z{z:.6} I{i:.6} K{k:.6}\nG90", if is_cw { "G2" } else { "G3" })
    });
    prop_oneof![3 => straight, 2 => arc]
}

fn program(head: &str, blocks: &[String], [offset, tool]: [f64; 2]) -> String {
    format!("G21 G18 G90 F200 G10 L2 P1 X{offset}\nG43.1 X{tool}\nG0 X40\n{head} M3\n{}\nM5\nM2\n", blocks.join("\n"))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// On any moves, with any offsets, at any limits: rpm × radius is the surface speed, and the moves are the same as
    /// under G97.
    #[test]
    fn the_surface_has_its_speed_wherever_it_is_not_limited(
        blocks in prop::collection::vec(block(), 1..12), offsets in [-20.0..20.0f64, -20.0..20.0f64],
        least in 0.0..300.0f64, most in 300.0..6000.0f64,
    ) {
        let spindle = format!("min_rpm = {least:?}\nmax_rpm = 9000\n");
        let lathe = turn(&spindle, &program(&format!("G96 S{SURFACE} D{most}"), &blocks, offsets));
        if let Err(wrong) = check_speed(&lathe, offsets[0] + offsets[1], [least, most]) {
            prop_assert!(false, "{}", wrong);
        }
        let plain = turn(&spindle, &program("G97 S500", &blocks, offsets));
        let path = |lathe: &Lathe| lathe.moves.iter().map(|m| (m.end, m.arc, m.feed, m.mode)).collect::<Vec<_>>();
        prop_assert_eq!(path(&lathe), path(&plain));
    }

    /// Under G95 a move is divided where S changes, and each part feeds by its S. The parts end where the move does.
    #[test]
    fn a_feed_per_turn_follows_the_speed(
        blocks in prop::collection::vec(block(), 1..12), offsets in [-20.0..20.0f64, -20.0..20.0f64],
        is_exact_stop in any::<bool>(),
    ) {
        let mode = if is_exact_stop { "G61.1" } else { "G64" };
        let blocks = [vec![mode.to_owned(), "G95 F0.2".to_owned()], blocks].concat();
        let lathe = turn("max_rpm = 2000\n", &program(&format!("G96 S{SURFACE}"), &blocks, offsets));
        if let Err(wrong) = check_speed(&lathe, offsets[0] + offsets[1], [0.0, 2000.0]) {
            prop_assert!(false, "{}", wrong);
        }
        let feeds = lathe.moves.iter().filter(|turned| turned.line > 6 && turned.feed != FeedRate::Rapid);
        for turned in feeds.clone() {
            let FeedRate::PerSecond(mm_s) = turned.feed else { continue };
            let mm_per_turn = mm_s * 60.0 / turned.parts[0].1;
            prop_assert!(turned.parts.len() == 1 && (mm_per_turn - 0.2).abs() < 1e-6, "{:?}", turned);
        }
        let plain = turn("", &program("G97 S500", &blocks, offsets));
        let mut moves = lathe.moves.iter();
        for whole in &plain.moves {
            // One move for each block: its last part ends where the block does, the others pass through.
            let number = lathe.moves.iter().filter(|part| part.line == whole.line).count();
            let parts: Vec<&Turned> = moves.by_ref().take(number).collect();
            let is_at_end = |last: &&Turned| last.end == whole.end && last.mode == whole.mode;
            prop_assert!(parts.last().is_some_and(is_at_end), "{:?}", parts);
            prop_assert!(parts.iter().rev().skip(1).all(|part| part.mode != PathMode::ExactStop));
            let angle = |turned: &Turned| turned.arc.map_or(0.0, |arc| arc.sweep(&turned.start).1);
            let sum: f64 = parts.iter().map(|part| angle(part)).sum();
            prop_assert!((sum - angle(whole)).abs() < 1e-6, "{} {:?}", sum, whole);
        }
    }
}

#[test]
fn g96_begins_at_the_x_of_the_tool_and_g97_ends_it() {
    let lathe = turn("", "G21 G18 G90 F100 G0 X50\nG96 D2500 S200 M3\nG1 X40\nG97\nG1 X10\nS800\nG1 X30\nM5\nM2\n");
    let [(code, begin), (_, end)] = lathe.switched[..] else { panic!("{:?}", lathe.switched) };
    assert!(code == "S" && (begin / (200_000.0 / (TAU * 50.0)) - 1.0).abs() < 0.0051 && end == 800.0, "{begin} {end}");
    // Behind G97 the speed of the last place stays until the next S.
    let speeds = |n: usize| lathe.moves[n].parts.iter().map(|part| part.1).collect::<Vec<_>>();
    let last = *speeds(1).last().expect("a part");
    assert!((last / (200_000.0 / (TAU * 40.0)) - 1.0).abs() < 0.0051 && speeds(1).len() > 20, "{last}");
    assert_eq!((speeds(2), speeds(3)), (vec![last], vec![800.0]));
    // In inches, S is in feet per minute.
    let inches = turn("", "G20 G18 G90 F10 G0 X2\nG96 D2500 S400 M3\nM5\nM2\n");
    assert!((inches.switched[0].1 / (400.0 * 12.0 / (TAU * 2.0)) - 1.0).abs() < 0.0051, "{:?}", inches.switched);
}

#[test]
fn at_the_axis_the_speed_is_limited_and_out_and_back_it_changes_at_the_same_places() {
    let lathe =
        turn("max_rpm = 3000\nmin_rpm = 900\n", "G21 G18 G90 F100 G0 X60\nG96 S300 M3\nG1 X-1\nG1 X60\nM5\nM2\n");
    let places = |turned: &Turned| {
        let inside = turned.parts.iter().skip(1).map(|part| (turned.x(part.0) * 1e6).round().abs());
        let mut places: Vec<f64> = inside.collect();
        places.sort_by(f64::total_cmp);
        places
    };
    let [out, back] = [1, 2].map(|n| places(&lathe.moves[n]));
    assert!(out == back && out.len() > 100, "{out:?} {back:?}");
    let parts = &lathe.moves[1].parts;
    assert_eq!((parts[0].1, parts[parts.len() - 1].1), (900.0, 3000.0));
    assert_eq!(lathe.moves[2].parts[0].1, 3000.0);
}

#[test]
fn without_a_highest_speed_g96_is_refused_and_a_beam_has_none() {
    let number =
        |spindle: &str, text: &str| turn_on(spindle, text).1.iter().map(|found| found.number).collect::<Vec<_>>();
    let program = "G21 G90 G0 X10\nG96 S100\nM2\n";
    assert_eq!(number("", program), ["E4317"]);
    assert_eq!(number("max_rpm = 2000\n", program), [""; 0]);
    let beam = "[[cutter]]\nname = \"laser\"\nkind = \"beam\"\nfire = 64\npower = {}\n";
    assert_eq!(number(beam, "G21 G90 G0 X10\nG96 D2000 S100\nM2\n"), ["E4302"]);
    assert_eq!(number("min_rpm = 0\n", "G21 G90 G0 X10\nG96 D2000 S0\nG1 F10 X0\nM2\n"), [""; 0]);
}
