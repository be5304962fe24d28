//! Random drilling cycles, spindle modes and threads.
//!
//! Invariant: each part ends with a motion or G80, so that the next part begins a new series.

use super::Writer;

/// Words of a cycle in addition to the axes, R and L; the first ones are always written in its first block.
const CYCLES: [(&str, &str); 11] = [
    ("G81", ""),
    ("G82", "P"),
    ("G83", "Q"),
    ("G73", "Q"),
    ("G84", "P"),
    ("G74", "P"),
    ("G85", ""),
    ("G86", "P"),
    ("G87", "IJK"),
    ("G88", "P"),
    ("G89", "P"),
];

impl Writer {
    /// Writes a part of a program that drills, cuts a thread, or uses the spindle otherwise.
    pub(super) fn machining(&mut self) {
        match self.random.below(10) {
            0..=5 => self.drilling(),
            6 => self.feed_per_turn(),
            7 => self.spindle_mode(),
            8 => self.synchronised(),
            _ => self.thread(),
        }
        if self.random.one_in(3) {
            let names =
                "#<_motion_mode> #<_spindle_css_mode> #<_spindle_rpm_mode> #<_units_per_rev> #<_spindle_on> #<_z>";
            self.lines.push(format!("(debug,{names})"));
        }
    }

    fn end_of_part(&mut self) {
        let end = self.random.pick(&["G80", "G0 X1", "G1 Y2", "G0 Z7", "G80 G0 Z7", "G0 X2 Y1"]);
        self.line(end.split(' ').map(str::to_owned).collect());
    }

    /// A series of holes.
    fn drilling(&mut self) {
        let (code, takes) = CYCLES[self.random.below(CYCLES.len() as u64) as usize];
        if self.tolerance_is_stale() {
            self.plain(&["G64", "G64 P.2"]);
        }
        if matches!(code, "G74" | "G84") {
            self.plain(&["G17", "G17", "G17 G98"]);
        } else if self.random.one_in(3) {
            self.plain(&["G17", "G18", "G19", "G17 G98", "G18 G99 G91", "G19 G90"]);
        }
        let normal = self.normal_axis();
        let turn = if code == "G74" { "M4" } else { self.random.pick(&["M3", "M3", "M3", "M4"]) };
        let turn = if code == "G84" { "M3" } else { turn };
        self.line(vec![turn.to_owned(), "S120".to_owned()]);
        let mut words = vec![code.to_owned()];
        words.extend(self.hole_words(normal));
        self.levels(normal, &mut words);
        for letter in takes.chars() {
            words.push(self.cycle_word(letter));
        }
        let modes = ["G90", "G91", "G98", "G99", "G90 G98", "G91 G99", "F55", "M8", "", "", "L2", "L3 G91"];
        let modes = if code == "G74" { &modes[..10] } else { &modes[..] };
        words.push(self.random.pick(modes).to_owned());
        self.line(words);
        for _ in 0..self.random.below(6) {
            self.next_hole(code, normal, takes);
        }
        self.end_of_part();
    }

    /// Whether the units were changed after the last G64.
    fn tolerance_is_stale(&self) -> bool {
        let last = |codes: &[&str]| {
            let has = |line: &String| codes.iter().any(|code| line.to_lowercase().contains(code));
            self.lines.iter().rposition(has)
        };
        last(&["g20", "g21"]) > last(&["g64"])
    }

    /// Returns the axis across the plane of the lines written so far; text in a comment or an expression is not a code.
    fn normal_axis(&self) -> &'static str {
        let plane = self.lines.iter().rev().flat_map(|line| line.lines().rev()).find_map(|line| {
            let line = line.to_lowercase();
            ["g17", "g18", "g19"].iter().position(|code| line.contains(code))
        });
        ["Z", "Y", "X"][plane.unwrap_or(0)]
    }

    fn plain(&mut self, of: &[&str]) {
        let words = self.random.pick(of);
        self.line(words.split(' ').map(str::to_owned).collect());
    }

    fn next_hole(&mut self, code: &str, normal: &str, takes: &str) {
        if self.random.one_in(6) {
            match self.random.below(5) {
                0 => self.assignment(),
                1 => self.dwell(),
                2 => self.path_control(),
                3 => self.switch(),
                _ => self.plain(&["G98", "G99", "G90", "G91"]),
            }
        }
        let mut words = self.hole_words(normal);
        if self.random.one_in(5) {
            words.push(code.to_owned());
        }
        match self.random.below(8) {
            0 => self.levels(normal, &mut words),
            1 => words.push(format!("R{}", self.random.below(9))),
            2 => {
                let more = ["G98", "G99", "G91", "G90", "F70", "L2", "L3"];
                let more = if code == "G74" { &more[..5] } else { &more[..] };
                words.push(self.random.pick(more).to_owned());
            }
            3 => words.extend(takes.chars().next().map(|letter| self.cycle_word(letter))),
            _ => {}
        }
        self.line(words);
    }

    /// Writes words of the plane's axes; sometimes of others, which are refused.
    fn hole_words(&mut self, normal: &str) -> Vec<String> {
        let mut words = Vec::new();
        for letter in ["X", "Y", "Z"] {
            if letter != normal && !self.random.one_in(3) {
                words.push(format!("{letter}{}", self.value()));
            }
        }
        if normal == "Z" && self.random.one_in(6) {
            return self.polar_words();
        }
        if words.is_empty() {
            let letter = if normal == "X" { "Z" } else { "X" };
            words.push(format!("{letter}{}", self.decimal()));
        }
        if self.random.one_in(300) {
            words.push("A5".to_owned());
        }
        words
    }

    /// Writes a hole in polar coordinates: its distance from the origin, its angle, or both.
    fn polar_words(&mut self) -> Vec<String> {
        let (distance, angle) = (format!("@{}", self.decimal()), format!("^{}", self.decimal()));
        match self.random.below(3) {
            0 => vec![distance],
            1 => vec![angle],
            _ => vec![distance, angle],
        }
    }

    /// Writes R, and the bottom below it.
    fn levels(&mut self, normal: &str, words: &mut Vec<String>) {
        let clearance = self.random.below(1200) as f64 / 100.0 - 3.0;
        let below = self.random.below(900) as f64 / 100.0;
        let bottom = if self.random.one_in(100) { clearance + 1.0 } else { clearance.min(0.0) - below };
        words.push(format!("R{clearance:.3}"));
        words.push(format!("{normal}{bottom:.3}"));
    }

    fn cycle_word(&mut self, letter: char) -> String {
        match letter {
            'P' => format!("P{}", self.positive()),
            'Q' => format!("Q{}.{}", self.random.below(3), self.random.below(800) + 150),
            _ => format!("{letter}{}", self.decimal()),
        }
    }

    fn feed_per_turn(&mut self) {
        let feed = self.positive();
        let speed = self.random.pick(&["S100", "S50 M3", "S7", "S20 M4", "S.5", "S1", "M3 S1", "S0"]).to_owned();
        self.line(vec!["G95".to_owned(), format!("F{feed}"), speed]);
        match self.random.below(3) {
            0 => self.drilling(),
            1 => self.line(vec!["G17 G2 I3 J1".to_owned()]),
            _ => self.straight(),
        }
        let feed = self.positive();
        self.line(vec!["G94".to_owned(), format!("F{feed}")]);
    }

    fn spindle_mode(&mut self) {
        if self.random.one_in(20) {
            return self.plain(&["M19 R400", "G96 D3", "M19 R2 P3", "M19 R2 Q0"]);
        }
        self.plain(&[
            "G96 S100",
            "G96 D1500 S80.5",
            "G96 D-300 S2 M3",
            "G97",
            "G97 S300",
            "G97 S30 M4",
            "M19 R45",
            "M19",
            "M19 P1",
            "M19 R12.5 P1",
            "M19 R360 Q2.5 P2",
            "M19 R0 P0 Q1",
            "M3 $0",
            "M4 S20 $0",
            "M5 $-1",
            "S70 $0",
            "G96 S20 $0",
            "M19 R1 $0",
        ]);
        if self.random.one_in(4) {
            self.straight();
        }
    }

    /// Writes G33 and G33.1.
    fn synchronised(&mut self) {
        if !self.random.one_in(20) {
            self.plain(&["M3 S100", "M4 S20", "M3"]);
        }
        for _ in 0..self.random.below(3) + 1 {
            let mut words = vec![format!("Z{}", self.value())];
            if self.random.one_in(2) {
                words.push(format!("X{}", self.value()));
            }
            if !self.random.one_in(60) {
                words.push(format!("K{}", self.positive()));
            }
            words.push(
                self.random.pick(&["G33", "G33.1", "G33", "G33.1 I2", "G33 $0", "G33 G91", "G33.1 G90"]).to_owned(),
            );
            self.line(words);
        }
        self.end_of_part();
    }

    /// Writes G76.
    fn thread(&mut self) {
        self.plain(&["M3 S100", "M4 S20", "M3"]);
        self.speed_override_off = false;
        self.lines.push("M48".to_owned());
        let pitch = self.positive();
        let mut words = vec!["G76".to_owned(), format!("P{pitch}"), format!("Z{}", self.decimal())];
        let first = self.random.below(30) as f64 / 100.0 + 0.05;
        let full = first + self.random.below(100) as f64 / 100.0 + 0.01;
        words.push(format!("I{}{}", self.random.pick(&["-", "-", ""]), self.positive()));
        words.push(format!("J{first:.3}"));
        words.push(format!("K{full:.3}"));
        let more =
            ["R1.5", "R2", "H2", "Q29.5", "Q-10", "L1 E.5", "L2 E.7", "L3 E.2", "L3", "R.5", "X3", "Y4", "F20", "$0"];
        let mut letters = String::new();
        for _ in 0..self.random.below(5) {
            let word = self.random.pick(&more);
            let letter = &word[..1];
            if !letters.contains(letter) {
                letters += letter;
                words.push(word.to_owned());
            }
        }
        self.line(words);
        self.end_of_part();
    }
}
