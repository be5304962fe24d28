//! Random programs under cutter compensation: outlines of straight moves and arcs, with other blocks between them.

use crate::writer::Random;
use std::f64::consts::{PI, TAU};

/// The tools of these programs: mills, lathe tools, one of diameter zero, one with a negative diameter. LinuxCNC's
/// CHANGE_TOOL prints the position in the table, so each has the number of its line.
pub(crate) const TOOLS: &str = "T1 P1 Z0.511 D0.125\nT2 P2 Z0.1 D0.0625\nT3 P3 Z1.273 D0.201\nT4 P4 D-0.0625\nT5 P5 \
    D0\n\
    T6 P6 D0.05 Q9\nT7 P7 D0.06 Q1\nT8 P8 D0.06 Q2\nT9 P9 D0.06 Q3\nT10 P10 D0.07 Q4\nT11 P11 D0.08 Q5\nT12 P12 D0.08 \
    Q6\n\
    T13 P13 D-0.08 Q7\nT14 P14 D0.08 Q8\n";

/// Writer of random outlines.
///
/// Cases in which `rs274` itself is wrong are left out:
/// - G92.1, G92.2 and G92.3 do nothing under compensation, without a message;
/// - after M0, M1 or M60 it cuts through the next concave corner, because the previous move has been emitted already
///   and cannot end earlier; the direction in which it does so depends on memory that is no longer in use;
/// - M61 takes the position from a model of the machine that does not include the waiting moves;
/// - a move that waits when the program ends at its closing percent sign is lost;
/// - an arc as the first move of a lathe tool is reached by a straight move, whose end it moves along with that of the
///   arc;
/// - when the units change, a waiting feed rate keeps its number, and the position of the path is converted once for
///   each waiting function.
pub(crate) struct Outline {
    random: Random,
    lines: Vec<String>,
    /// First and second axis of the plane, normal, centre words.
    letters: [&'static str; 5],
    at: (f64, f64),
    heading: f64,
    /// Whether directions and lengths are whole numbers.
    is_even: bool,
    /// Millimetres in a unit.
    unit: f64,
    incremental: bool,
    inverse_time: bool,
    left: bool,
    radius: f64,
    is_lathe: bool,
    /// Whether the first move under compensation was written.
    is_on_path: bool,
    /// Whether nothing but the last move waits.
    only_move_waits: bool,
}

impl Outline {
    pub(crate) fn program(seed: u64) -> String {
        let mut outline = Outline {
            random: Random::new(seed ^ 0x51ed_270b),
            lines: Vec::new(),
            letters: ["X", "Y", "Z", "I", "J"],
            at: (0.0, 0.0),
            heading: 0.0,
            is_even: false,
            unit: 1.0,
            incremental: false,
            inverse_time: false,
            left: true,
            radius: 1.0,
            is_lathe: false,
            is_on_path: false,
            only_move_waits: false,
        };
        outline.lines.push("F200".to_owned());
        for _ in 0..outline.random.below(3) + 1 {
            outline.outline();
        }
        let end = outline.random.pick(&["M2", "M30", "M2"]).to_owned();
        outline.lines.push(end);
        outline.lines.join("\n") + "\n"
    }

    fn outline(&mut self) {
        self.is_even = self.random.one_in(2);
        self.is_lathe = false;
        let (plane, letters) = match self.random.below(3) {
            0 => ("G18", ["Z", "X", "Y", "K", "I"]),
            _ => ("G17", ["X", "Y", "Z", "I", "J"]),
        };
        self.letters = letters;
        self.lines.push(plane.to_owned());
        self.set_unit();
        self.go_to_start();
        self.cutter(plane == "G18");
        self.heading = self.direction();
        let first_is_arc = !self.is_lathe && self.random.one_in(4);
        self.is_on_path = false;
        self.between();
        self.is_on_path = true;
        if first_is_arc {
            self.arc(0.0)
        } else {
            self.line(0.0)
        }
        for _ in 0..self.random.below(10) {
            self.piece();
        }
        let more = self.random.one_in(8);
        if !more {
            self.lines.push("G40".to_owned());
            let (code, first, second) = (self.random.pick(&["G0", "G1"]).to_owned(), self.length(), self.length());
            if self.inverse_time {
                self.lines.push("G94 F77".to_owned());
                self.inverse_time = false;
            }
            if self.incremental {
                self.lines.push("G90".to_owned());
                self.incremental = false;
            }
            let words = self.end_words((self.at.0 + first, self.at.1 - second));
            self.lines.push(format!("{code} {words}"));
        } else {
            // The program ends under compensation.
            self.lines.push("M2".to_owned());
        }
    }

    fn set_unit(&mut self) {
        let (code, unit) = if self.random.one_in(3) { ("G20", 25.4) } else { ("G21", 1.0) };
        self.unit = unit;
        self.lines.push(code.to_owned());
    }

    fn go_to_start(&mut self) {
        self.at = (self.random.below(40) as f64 - 20.0, self.random.below(40) as f64 - 20.0);
        let words = self.end_words(self.at);
        self.lines.push(format!("G90 G0 {words}"));
    }

    /// Switches compensation on.
    fn cutter(&mut self, is_lathe_plane: bool) {
        let given = self.random.one_in(2);
        let side = self.random.below(2);
        self.left = side == 0;
        if given {
            let sign = if self.random.one_in(8) { -1.0 } else { 1.0 };
            self.radius = [0.5, 1.0, 0.3, 2.0, 1.234][self.random.below(5) as usize];
            let mut block = format!("G4{}.1 D{}", side + 1, self.number(sign * 2.0 * self.radius));
            self.left = self.left == (sign > 0.0);
            if is_lathe_plane && self.random.one_in(2) {
                let orientation = self.random.below(10);
                self.is_lathe = !matches!(orientation, 0 | 9);
                block += &format!(" L{orientation}");
            }
            self.lines.push(block);
            return;
        }
        let tools = [(1, 0.0625), (2, 0.031_25), (3, 0.1005), (4, -0.031_25), (5, 0.0), (6, 0.025)];
        let lathe = [(7, 0.03), (8, 0.03), (9, 0.03), (10, 0.035), (11, 0.04), (12, 0.04), (13, -0.04), (14, 0.04)];
        let (tool, radius) = match is_lathe_plane && self.random.one_in(2) {
            true => lathe[self.random.below(8) as usize],
            false => tools[self.random.below(6) as usize],
        };
        self.is_lathe = tool > 6;
        self.radius = f64::abs(radius * 25.4);
        self.left = self.left == (radius >= 0.0);
        let side = side + 1;
        match self.random.below(3) {
            0 => self.lines.push(format!("T{tool} M6\nG4{side}")),
            1 => self.lines.push(format!("T{tool} M6\nG4{side} D0")),
            _ => self.lines.push(format!("G4{side} D{tool}")),
        }
    }

    fn direction(&mut self) -> f64 {
        if self.is_even {
            self.random.below(8) as f64 * PI / 4.0
        } else {
            self.random.below(1000) as f64 * TAU / 1000.0
        }
    }

    fn length(&mut self) -> f64 {
        let most = if self.random.one_in(20) { 3 } else { 30 };
        let whole = (self.random.below(most) + most / 5 + 1) as f64;
        if self.is_even { whole } else { whole + self.random.below(1000) as f64 / 1000.0 }
    }

    fn number(&self, value: f64) -> String {
        let value = value / self.unit;
        let digits = if self.unit == 1.0 { 4 } else { 6 };
        format!("{value:.digits$}")
    }

    fn end_words(&mut self, end: (f64, f64)) -> String {
        let (mut first, mut second) = end;
        if self.incremental {
            first -= self.at.0;
            second -= self.at.1;
        }
        let (first, second) = (self.number(first), self.number(second));
        let words = format!("{}{first} {}{second}", self.letters[0], self.letters[1]);
        self.at = end;
        words
    }

    /// A move to the next corner, with other blocks before it.
    fn piece(&mut self) {
        let turn = match self.is_even {
            // Also reverses direction, as at the top of an h or the middle of an m.
            true => (self.random.below(9) as f64 - 4.0) * PI / 4.0,
            false => self.random.below(5000) as f64 / 1000.0 - 2.5,
        };
        self.between();
        let is_outer = if self.left { turn < -0.1 } else { turn > 0.1 };
        if is_outer && turn.abs() < 2.4 && self.random.one_in(8) {
            let stop = self.random.pick(&["M0", "M1", "M60"]).to_owned();
            self.lines.push(stop);
        }
        match self.random.below(3) {
            0 => self.arc(turn),
            _ => self.line(turn),
        }
    }

    fn feed_word(&mut self) -> String {
        let feed = self.random.below(90) + 1;
        if self.inverse_time || self.random.one_in(8) { format!(" F{feed}") } else { String::new() }
    }

    /// Adds words along the normal axis and the rotary ones.
    fn more_words(&mut self) -> String {
        let mut words = String::new();
        if self.random.one_in(8) {
            words += &format!(" {}{}", self.letters[2], self.random.below(9));
        }
        if self.random.one_in(12) {
            words += &format!(" A{}", self.random.below(90));
        }
        words
    }

    fn line(&mut self, turn: f64) {
        self.heading += turn;
        let length = self.length();
        let end = (self.at.0 + length * self.heading.cos(), self.at.1 + length * self.heading.sin());
        let end = if self.is_even { (end.0.round(), end.1.round()) } else { end };
        let code = if self.random.one_in(9) { "G0" } else { "G1" };
        let words = self.end_words(end) + &self.more_words();
        let feed = if code == "G1" { self.feed_word() } else { String::new() };
        self.lines.push(format!("{code} {words}{feed}"));
        self.only_move_waits = true;
    }

    fn arc(&mut self, turn: f64) {
        self.heading += turn;
        let counterclockwise = self.random.one_in(2);
        let sign = if counterclockwise { 1.0 } else { -1.0 };
        let radius = self.length() / 2.0;
        let radius = if self.is_even { radius.ceil() } else { radius };
        let sweep = if self.is_even {
            (self.random.below(8) + 1) as f64 * PI / 4.0
        } else {
            self.random.below(6000) as f64 / 1000.0 + 0.1
        };
        let to_centre = self.heading + sign * PI / 2.0;
        let centre = (self.at.0 + radius * to_centre.cos(), self.at.1 + radius * to_centre.sin());
        let from_centre = to_centre + PI + sign * sweep;
        let end = (centre.0 + radius * from_centre.cos(), centre.1 + radius * from_centre.sin());
        let offset = (self.number(centre.0 - self.at.0), self.number(centre.1 - self.at.1));
        let code = if counterclockwise { "G3" } else { "G2" };
        let words = self.end_words(end);
        let shape = if self.random.one_in(3) && (0.2..3.0).contains(&sweep) {
            format!("R{}", self.number(radius))
        } else {
            format!("{}{} {}{}", self.letters[3], offset.0, self.letters[4], offset.1)
        };
        let turns = if self.random.one_in(10) { format!(" P{}", self.random.below(3) + 1) } else { String::new() };
        let (more, feed) = (self.more_words(), self.feed_word());
        self.lines.push(format!("{code} {words} {shape}{turns}{more}{feed}"));
        self.heading += sign * sweep;
        self.only_move_waits = true;
    }

    /// Writes blocks that are allowed between two moves.
    fn between(&mut self) {
        for _ in 0..self.random.below(3) {
            let waits = ["M3 S500", "M5", "M8", "M7", "M9", "F120", "S70", "G4 P0.5", "(corner)", "N7 (x)", "M4 (so)"];
            let passes = [
                "T2",
                "(MSG, here)",
                "(debug,#<_x> #5421 #5422 #<_y> #<_z>)",
                "(debug,#<_ccomp> #<_abs_x>)",
                "(print,#5420)",
            ];
            match self.random.below(10) {
                0..=3 => {
                    self.lines.push(self.random.pick(&waits).to_owned());
                    self.only_move_waits = false;
                }
                4 | 5 => self.lines.push(self.random.pick(&passes).to_owned()),
                // Before the first move in the plane this would be one that is too short.
                6 if !self.inverse_time && (self.is_on_path || self.random.one_in(50)) => {
                    let depth = self.random.below(5);
                    let code = self.random.pick(&["G0", "G1"]);
                    let word = self.random.pick(&[self.letters[2], "A", "B"]);
                    self.lines.push(format!("{code} {word}{depth}"));
                    self.only_move_waits = false;
                }
                7 => {
                    self.incremental = !self.incremental;
                    self.lines.push(if self.incremental { "G91" } else { "G90" }.to_owned());
                    self.only_move_waits = false;
                }
                8 if self.random.one_in(3) => {
                    self.inverse_time = !self.inverse_time;
                    self.lines.push(if self.inverse_time { "G93" } else { "G94 F90" }.to_owned());
                    self.only_move_waits = false;
                }
                9 if self.only_move_waits && self.random.one_in(2) => self.set_unit(),
                9 if self.random.one_in(20) => self.refused(),
                _ => {}
            }
        }
    }

    /// Writes a block that is refused under compensation.
    fn refused(&mut self) {
        let blocks = [
            "T2 M6",
            "M48",
            "M50 P0",
            "M62 P1",
            "M64 P1",
            "G19",
            "G43 H1",
            "G49",
            "G54",
            "G55",
            "G61",
            "G64 P1",
            "G98",
            "G28",
            "G30",
            "G28.1",
            "G30.1",
            "G52 X1",
            "G92 X1",
            "G10 L2 P1 X1",
            "G10 L20 P0 X1",
            "G42",
            "G41 D1",
            "G41.1 D1",
            "D1",
        ];
        self.lines.push(self.random.pick(&blocks).to_owned());
    }
}
