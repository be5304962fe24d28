//! Turning cycles: calculated manually, and over random profiles compared call by call with LinuxCNC's `rs274 -g`.
//!
//! Invariant: a random profile is one that LinuxCNC turns correctly. RETRACE_TURNING is the number of profiles,
//! RETRACE_TURNING_FIRST the first seed. Cases in which LinuxCNC itself is wrong are left out:
//! - from a profile that ends no higher than it begins it feeds straight from the start to the first point, through the
//!   stock;
//! - where the first element is a wall and the allowance moves its foot before the start, it cuts through the wall;
//! - with an allowance it refuses neighbours in one line ("parallel lines"), and does not print numbers for slots that
//!   are too narrow;
//! - at the end of a profile it leaves no allowance at the shoulder, which release 2.9.9 does: profiles to be roughed
//!   end with the wall;
//! - where a level of roughing, or the finishing cut, touches the beginning of an arc along it, it loses the arc: with
//!   seed 5205 it feeds through the part, with seed 5397 it leaves a pocket uncut;
//! - it accepts an allowance and a retreat below 0, and P0, and makes moves of zero length or not depending on the last
//!   digit.

use retrace_gcode::{Canon, CanonText, Interpreter, Setup};
use std::path::Path;
use std::process::{Command, Stdio};

/// A small generator of random numbers, the same on every machine.
struct Random(u64);

impl Random {
    fn new(seed: u64) -> Random {
        Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    fn below(&mut self, bound: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 16) % bound
    }
}

/// A profile under construction, in a frame: `a` along it, `h` above it.
struct Sketch {
    facing: bool,
    along: f64,
    above: f64,
    a: f64,
    h: f64,
    lines: Vec<String>,
}

impl Sketch {
    fn name(&self, a: f64, h: f64) -> String {
        let (a, h) = (a * self.along, h * self.above);
        let (x, z) = if self.facing { (a, h) } else { (h, a) };
        format!("X{x:.4} Z{z:.4}")
    }

    fn line(&mut self, a: f64, h: f64) {
        (self.a, self.h) = (self.a + a, self.h + h);
        self.lines.push(format!("G1 {}", self.name(self.a, self.h)));
    }

    /// A quarter of a circle, with its centre in front of its beginning, or across from it.
    fn quarter(&mut self, size: f64, rise: f64, begins_level: bool) {
        let centre = if begins_level { (0.0, rise) } else { (size, 0.0) };
        let turns_left = begins_level == (rise > 0.0);
        let mirrored = (self.along * self.above < 0.0) != self.facing;
        let code = if turns_left == mirrored { "G2" } else { "G3" };
        let (a, h) = (centre.0 * self.along, centre.1 * self.above);
        let (i, k) = if self.facing { (a, h) } else { (h, a) };
        (self.a, self.h) = (self.a + size, self.h + rise);
        self.lines.push(format!("{code} {} I{i:.4} K{k:.4}", self.name(self.a, self.h)));
    }

    /// Adds one element of another kind than the last: LinuxCNC mishandles neighbours in one line.
    fn grow(&mut self, kind: u64, size: f64, begins_level: bool, after_level: bool) {
        match kind {
            0 => self.line(size, 0.0),
            1 => self.line(0.0, size),
            2 => self.line(size, size * 0.7),
            3 => self.line(2.0 * size, -size * 0.8),
            4 => self.quarter(size, size, begins_level),
            _ => {
                // Level before and after: a cusp has no path beside it.
                if !after_level {
                    self.line(0.8, 0.0);
                }
                self.quarter(size, -size, begins_level);
                self.line(0.8, 0.0);
            }
        }
    }
}

/// A subprogram that draws a profile, and the block that turns it.
struct Turning {
    profile: Vec<String>,
    block: String,
}

fn hundredths(random: &mut Random, below: u64) -> f64 {
    random.below(below) as f64 / 100.0
}

impl Turning {
    fn of_seed(seed: u64) -> Turning {
        let mut random = Random::new(seed);
        let rough = random.below(3) != 0;
        let facing = rough && random.below(3) == 0;
        let along = if random.below(2) == 0 { -1.0 } else { 1.0 };
        let above = if random.below(3) == 0 { -1.0 } else { 1.0 };
        let (a, h) = (hundredths(&mut random, 300), 2.0 + hundredths(&mut random, 600));
        let mut sketch = Sketch { facing, along, above, a, h, lines: Vec::new() };
        sketch.lines.push(format!("G0 {}", sketch.name(a, h)));
        let (before, top) = (a - 0.4 - hundredths(&mut random, 200), 10.0 + hundredths(&mut random, 300));
        let start = sketch.name(before, top);
        let mut last = 9;
        for _ in 0..random.below(6) + 2 {
            let (kind, size) = (random.below(6), 1.0 + hundredths(&mut random, 200));
            let begins_level = random.below(2) == 0;
            let fits = match kind {
                1 | 2 | 4 => sketch.h + size < 9.5,
                3 | 5 => sketch.h > size + 0.5,
                _ => true,
            };
            if fits && kind != last {
                sketch.grow(kind, size, begins_level, last == 0);
                last = if kind == 5 { 0 } else { kind };
            }
        }
        // The end is above the beginning: from other profiles LinuxCNC feeds straight into the stock.
        let rise = (h + 0.5 - sketch.h).max(0.1);
        sketch.line(1.0, rise);
        sketch.line(0.7, 0.2);
        if rough {
            sketch.line(0.0, top - sketch.h);
        }
        let code = match (rough, facing) {
            (false, _) => "G70",
            (true, false) => ["G71", "G71.1", "G71.2"][random.below(3) as usize],
            (true, true) => ["G72", "G72.1", "G72.2"][random.below(3) as usize],
        };
        let mut block = format!("{code} Q100 {start}");
        let allowance = if random.below(2) == 0 { 0.0 } else { 0.06 + hundredths(&mut random, 25) };
        if allowance != 0.0 {
            block += &format!(" D{allowance:.2}");
        }
        if rough {
            block += &format!(" I{:.2} R.{}", 0.6 + hundredths(&mut random, 200), random.below(9) + 1);
        } else {
            block += ["", " P2", if allowance > 0.0 { " P3 E.05" } else { "" }][random.below(3) as usize];
        }
        Turning { profile: sketch.lines, block }
    }

    fn begin() -> [&'static str; 3] {
        ["G18 G90 F100", "G0 X12 Z12", "(profile)"]
    }

    fn program(&self) -> String {
        let (begin, profile) = (Turning::begin().join("\n"), self.profile.join("\n"));
        format!("{begin}\nO100 sub\n{profile}\nO100 endsub\n{}\nM2\n", self.block)
    }

    /// Returns the calls of this interpreter. The subprogram runs in a separate interpreter, as in the program's own
    /// runner.
    fn calls(&self) -> (Vec<String>, bool) {
        let mut interpreter = Interpreter::new(Setup::rs274());
        let (mut steps, mut drawn) = (Vec::new(), Vec::new());
        for line in Turning::begin() {
            let _ = interpreter.line(line.as_bytes(), &mut steps);
        }
        let mut inside = interpreter.clone();
        let drawn_all = self.profile.iter().all(|line| inside.line(line.as_bytes(), &mut drawn).is_ok());
        interpreter.set_profile(&drawn);
        let turned = interpreter.line(self.block.as_bytes(), &mut steps).is_ok();
        let mut text = CanonText::new(Vec::new());
        for step in &steps {
            text.write(step).expect("memory");
        }
        let text = String::from_utf8(text.into_inner().expect("memory")).expect("text");
        (moves(&text), !(turned && drawn_all))
    }
}

/// Returns the call of a line, if it moves; −0 counts as 0, which LinuxCNC's own mirroring results in.
fn moving(line: &str) -> Option<String> {
    let call = line.get(13..)?;
    let moves = ["STRAIGHT_", "ARC_FEED"].iter().any(|name| call.starts_with(name));
    moves.then(|| call.replace("-0.0000", "0.0000"))
}

/// Returns the moves of a text. A move to the tool position is left out: the last digit decides whether LinuxCNC makes
/// it.
fn moves(text: &str) -> Vec<String> {
    let mut moves: Vec<String> = text.lines().filter_map(moving).collect();
    moves.dedup_by(|next, before| !next.starts_with("ARC") && place(next) == place(before));
    moves
}

/// Returns X and Z of the end of a move.
fn place(call: &str) -> Option<(&str, &str)> {
    let mut words = call.split_once('(')?.1.split(", ");
    if call.starts_with("ARC") {
        let z = words.next()?;
        return Some((words.next()?, z));
    }
    Some((words.next()?, words.nth(1)?))
}

fn rs274(folder: &Path, program: &str) -> Option<(Vec<String>, bool)> {
    let file = folder.join("program.ngc");
    std::fs::write(&file, program).expect("a program file");
    let mut command = Command::new("timeout");
    command.args(["20", "rs274", "-g"]).arg(&file).env("HOME", folder).current_dir(folder).stdin(Stdio::null());
    let output = command.output().ok().filter(|output| output.status.code() != Some(127))?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    Some((moves(&text), !output.status.success()))
}

/// Returns the moves of a block over a profile, as X and Z, T rapid, F at the feed, L and R for arcs to the left and
/// right; or the error.
fn turned(profile: &str, block: &str) -> String {
    let profile = profile.split('|').map(str::to_owned).collect();
    let mut interpreter = Interpreter::new(Setup::rs274());
    let (mut steps, mut drawn) = (Vec::new(), Vec::new());
    interpreter.line(b"G18 F100", &mut steps).expect("modes");
    let turning = Turning { profile, block: block.to_owned() };
    let mut inside = interpreter.clone();
    for line in &turning.profile {
        inside.line(line.as_bytes(), &mut drawn).expect("a profile");
    }
    interpreter.set_profile(&drawn);
    steps.clear();
    if interpreter.line(block.as_bytes(), &mut steps).is_err() {
        return interpreter.diagnostics().iter().map(|found| found.number()).collect();
    }
    let names = steps.iter().filter_map(|step| {
        let (kind, end) = match &step.canon {
            Canon::StraightTraverse(end) => ("T", end),
            Canon::StraightFeed(end) => ("F", end),
            Canon::ArcFeed(arc) => (if arc.turns > 0 { "L" } else { "R" }, &arc.end),
            _ => return None,
        };
        Some(format!("{kind}{} {}", end.0[0], end.0[2]))
    });
    names.collect::<Vec<_>>().join(", ")
}

const SHOULDER: &str = "G0 X4 Z0|G1 X4 Z-4|X8 Z-4";

#[test]
fn a_shoulder_is_roughed_in_levels_and_followed_at_last() {
    // From X8 Z2 with an infeed of 2: levels at 8 and 6, then along the profile.
    assert_eq!(
        turned(SHOULDER, "G71 Q1 X8 Z2 I2 R.5"),
        "T8 2, T8 2, T8 2, F8 -4, T8.5 -3.5, T8.5 1.5, T8 2, T6 1, F6 -4, T6.5 -3.5, T6.5 0.5, T6 1, T4 0, F4 -4, F8 -4"
    );
    // Along X: levels at Z2, 0 and -2, each as far as the shaft.
    assert_eq!(
        turned("G0 X8 Z-4|G1 X4 Z-4|X4 Z0", "G72 Q1 X8 Z0 I2 R.5"),
        "T8 0, T8 0, T8 0, F4 0, T4.5 0.5, T7.5 0.5, T8 0, T8 -2, F4 -2, T4.5 -1.5, T7.5 -1.5, T8 -2, T8 -4, F4 -4, \
            F4 0"
    );
}

#[test]
fn a_pocket_is_cut_skipped_or_cut_alone() {
    let pocket = "G0 X4 Z0|G1 Z-1|X2 Z-2|Z-3|X6 Z-5";
    let inside =
        "F4 -1, F4 -1, F4 -4, T4.5 -3.5, T4.5 -1.5, F4 -1, F3 -1.5, F3 -3.5, T3.5 -3, T3.5 -2, F3 -1.5, F2 -2, F2 -3";
    let over = "T6 2, T6 2, T6 2, F6 -5, T6.5 -4.5, T6.5 1.5, T6 2, T5 1, F5 -4.5, T5.5 -4, T5.5 0.5, T5 1, T4 0";
    assert_eq!(turned(pocket, "G71 Q1 X6 Z2"), format!("{over}, {inside}, F6 -5"));
    assert_eq!(turned(pocket, "G71.1 Q1 X6 Z2"), format!("{over}, F4 0, F4 -1, F4 -4, F6 -5"));
    assert_eq!(turned(pocket, "G71.2 Q1 X6 Z2"), format!("T6 2, T6 2, T4 0, {inside}, F6 -5"));
}

#[test]
fn finishing_goes_along_the_profile_at_a_falling_allowance() {
    assert_eq!(
        turned(SHOULDER, "G70 Q1 X8 Z2 D.5 P2"),
        "T8 2, T8 2, T4.25 0, F4.25 -3.75, F8 -3.75, T8 2, T4 0, F4 -4, F8 -4"
    );
    // Around an outer corner the allowance is an arc.
    assert_eq!(turned("G0 X4 Z0|G1 X6 Z0|Z-4", "G70 Q1 X8 Z2 D1 E.5"), "T8 2, T8 2, T4 0.5, F6 0.5, L6.5 0, F6.5 -4");
    // In a bore everything is mirrored.
    assert_eq!(turned("G0 X8 Z0|G1 X8 Z-4|X4", "G70 Q1 X2 Z2 D1 E.5"), "T2 2, T2 2, T7.5 0, F7.5 -3.5, F4 -3.5");
}

#[test]
fn what_the_allowance_leaves_nothing_of_is_absorbed() {
    let along = "T8 2, T8 2, T4.3 0, F4.3 -1.9, F8 -1.9";
    for profile in ["G0 X4 Z0|G1 Z-2|X3|Z-2.2|X8", "G0 X4 Z0|G1 Z-2|G2 X4.2 Z-2.2 I.2 K0|G1 X8", "G0 X4 Z0|G1 Z-2.2|X8"]
    {
        assert_eq!(rounded(&turned(profile, "G70 Q1 X8 Z2 D.3 E.3")), along, "{profile}");
    }
}

/// Numbers with four decimals at most.
fn rounded(moves: &str) -> String {
    let word =
        |word: &str| word.parse::<f64>().map_or_else(|_| word.to_owned(), |x| ((x * 1e4).round() / 1e4).to_string());
    let step = |step: &str| {
        let (kind, end) = step.split_at(1);
        format!("{kind}{}", end.split(' ').map(word).collect::<Vec<_>>().join(" "))
    };
    moves.split(", ").map(step).collect::<Vec<_>>().join(", ")
}

#[test]
fn the_allowance_is_left_at_the_shoulder_where_a_profile_ends() {
    let shaft = "G0 X4 Z0|G1 Z-4";
    let wanted = "T8 2, T8 2, T8 2, F8 -3.5, T8.5 -3, T8.5 1.5, T8 2, T6 0.8571, F6 -3.5, T6.5 -3, T6.5 0.3571, T6 \
        0.8571, T4.5 0, F4.5 -3.5, F8 -3.5";
    assert_eq!(rounded(&turned(shaft, "G71 Q1 X8 Z2 I2 R.5 D.5")), wanted);
    assert_eq!(rounded(&turned("G0 X4 Z0|G1 Z-4|X8", "G71 Q1 X8 Z2 I2 R.5 D.5")), wanted);
    // Along X too, and without an allowance as far as the profile extends.
    assert_eq!(
        turned("G0 X8 Z-4|G1 X4", "G72 Q1 X8 Z0 I4 R.5 D.5"),
        turned("G0 X8 Z-4|G1 X4|Z0", "G72 Q1 X8 Z0 I4 R.5 D.5")
    );
    assert_eq!(turned(shaft, "G71 Q1 X8 Z2 I2"), turned("G0 X4 Z0|G1 Z-4|X8", "G71 Q1 X8 Z2 I2"));
}

/// Returns the moves of a whole program over the subprogram O1, as X and Z; or its first error and the line that it
/// names.
fn run(profile: &str, block: &str) -> Result<String, String> {
    let text = format!("G18 F100\nO1 sub\n{}\nO1 endsub\n{block}\nM2\n", profile.replace('|', "\n"));
    let setup = Setup::rs274();
    let prescan = std::sync::Arc::new(retrace_gcode::Prescan::scan("p", text.into_bytes().into(), &setup));
    let mut program = retrace_gcode::Program::<&[u8]>::prescanned(prescan, setup);
    let mut steps = Vec::new();
    while program.advance(&mut steps) == retrace_gcode::Progress::Line {}
    if let Some(found) = program.interpreter().diagnostics().first() {
        return Err(format!("{} {}", found.number(), found.message));
    }
    let ends = steps.iter().filter_map(|step| match &step.canon {
        Canon::StraightTraverse(end) | Canon::StraightFeed(end) => Some(format!("{} {}", end.0[0], end.0[2])),
        _ => None,
    });
    Ok(ends.collect::<Vec<_>>().join(", "))
}

#[test]
fn u_and_w_are_increments_in_a_profile_and_it_may_open_with_axis_words_alone() {
    let block = "G70 Q1 X8 Z2";
    let plain = run("G0 X4 Z0|G1 X4 Z-4|X8 Z-4", block).expect("a profile");
    for profile in ["X4 Z0|G1 Z-4|X8", "U-4 W-2|G1 W-4|U4", "G0 X4 W-2|G1 W-4|U4 Z-4"] {
        assert_eq!(run(profile, block), Ok(plain.clone()), "{profile}");
    }
    // U of a diameter.
    assert_eq!(run("G7 U-8 W-2|G1 W-4|U8|G8", block), Ok(plain));
    for (profile, message) in [
        ("G0 X4 U1 Z0|G1 Z-4|X8", "E1635 profile, line 3: U and X both define the end"),
        ("G0 X4 Z0|G91 G1 W-4|X8", "E1635 profile, line 4: W is an increment already and cannot be used with G91"),
    ] {
        assert_eq!(run(profile, block), Err(message.to_owned()));
    }
    // Elsewhere they are axes, which this machine does not have.
    assert_eq!(run(SHOULDER, "G0 U1"), Err("E1409 the machine has no axis U".to_owned()));
}

#[test]
fn the_line_of_a_profile_that_cannot_be_turned_is_named() {
    let found = run("G0 X4 Z0|G1 Z-4|X5 Z-3|Z-8", "G71 Q1 X8 Z2");
    assert_eq!(found, Err("E1634 profile, line 5: the profile turns back along its own direction".to_owned()));
}

#[test]
fn what_cannot_be_turned_is_refused() {
    for (profile, block, number) in [
        (SHOULDER, "G71 X8 Z2", "E1505"),
        (SHOULDER, "G17 G71 Q1 X8 Z2", "E1633"),
        (SHOULDER, "G93 G71 Q1 X8 Z2 F1", "E1625"),
        (SHOULDER, "G71 Q1 X8 Z2 F0", "E1508"),
        (SHOULDER, "G71 Q1 X8 Z2 I0", "E1635"),
        (SHOULDER, "G71 Q1 X8 Z2 R-1", "E1635"),
        (SHOULDER, "G71 Q1 X8 Z2 D-1", "E1635"),
        (SHOULDER, "G70 Q1 X8 Z2 P0", "E1635"),
        (SHOULDER, "G70 Q1 X8 Z2 I1", "E1408"),
        (SHOULDER, "G71 Q1 X8 Z2 P1", "E1408"),
        (SHOULDER, "G71 Q1 X8 Z2 I.0001", "E1634"),
        (SHOULDER, "G53 G71 Q1 X8 Z2", "E1506"),
        ("G0 X4 Z0", "G71 Q1 X8 Z2", "E1634"),
        ("G0 X4 Z0|G1 Z-4|X5 Z-3|Z-8", "G71 Q1 X8 Z2", "E1634"),
    ] {
        assert_eq!(turned(profile, block), number, "{profile} {block}");
    }
}

/// Profiles that LinuxCNC turns incorrectly, for the reasons above.
const PEER_AT_FAULT: [u64; 2] = [5205, 5397];

#[test]
fn random_profiles_are_turned_as_rs274_turns_them() {
    let number =
        |name: &str, default: u64| std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default);
    let folder = std::env::temp_dir().join(format!("retrace-turning-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    let (first, count) = (number("RETRACE_TURNING_FIRST", 0), number("RETRACE_TURNING", 60));
    let (mut differing, mut refused) = (0, 0);
    for seed in (first..first + count).filter(|seed| !PEER_AT_FAULT.contains(seed)) {
        let turning = Turning::of_seed(seed);
        let Some((theirs, they_refuse)) = rs274(&folder, &turning.program()) else {
            return crate::not_run::not_run("random_profiles_are_turned_as_rs274_turns_them", "rs274 is not installed");
        };
        let (ours, we_refuse) = turning.calls();
        refused += u64::from(we_refuse);
        // Both refuse the same profiles, wherever they began.
        if they_refuse != we_refuse || (!we_refuse && theirs != ours) {
            differing += 1;
            let at = theirs.iter().zip(&ours).take_while(|(theirs, ours)| theirs == ours).count();
            println!("seed {seed}, move {at}, refused by them {they_refuse}, by us {we_refuse}");
            println!("theirs: {:?}\nours:   {:?}", theirs.get(at), ours.get(at));
            if differing <= number("RETRACE_TURNING_SHOWN", 1) {
                println!("{}\n{theirs:#?}\n{ours:#?}", turning.program());
            }
        }
    }
    let _ = std::fs::remove_dir_all(&folder);
    println!("{count} profiles, {refused} of them refused, {differing} differ");
    assert_eq!(differing, 0, "of {count} profiles");
}
