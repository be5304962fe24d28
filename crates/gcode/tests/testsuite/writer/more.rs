//! Blocks of the extended language: splines, polar coordinates, probing, lathe diameters, tool data, inputs, saved
//! modes, comments.

use super::Writer;

impl Writer {
    pub(super) fn more(&mut self) {
        match self.random.below(12) {
            0 | 1 => self.spline(),
            2 => self.control_points(),
            3 | 4 => self.polar(),
            5 => self.probe(),
            6 => self.lathe(),
            7 => self.tool_data(),
            8 => self.port(),
            9 | 10 => self.remark(),
            _ => self.saved(),
        }
    }

    fn point(&mut self) -> String {
        match self.random.below(3) {
            0 => format!("X{}", self.value()),
            1 => format!("Y{}", self.value()),
            _ => format!("X{} Y{}", self.value(), self.value()),
        }
    }

    fn spline(&mut self) {
        let feed = self.random.below(900) + 1;
        let mut words = vec!["G17".to_owned(), self.point(), format!("F{feed}")];
        if self.random.one_in(2) {
            words.push("G5.1".to_owned());
            words.extend([format!("I{}", self.decimal()), format!("J{}", self.decimal())]);
        } else {
            words.push("G5".to_owned());
            words.extend([format!("P{}", self.decimal()), format!("Q{}", self.decimal())]);
            if self.random.one_in(2) {
                words.extend([format!("I{}", self.decimal()), format!("J{}", self.decimal())]);
            }
        }
        self.line(words);
        if self.random.one_in(2) {
            self.lines.push("(debug,#5420 #5421 #<_motion_mode>)".to_owned());
        }
    }

    fn control_points(&mut self) {
        let order = self.random.below(4) + 2;
        let first = vec!["G5.2".to_owned(), format!("P{}", self.positive()), format!("L{order}"), "F200".to_owned()];
        self.line(first);
        for _ in 0..order + self.random.below(3) - self.random.below(8) / 7 {
            let words = vec![
                format!("X{}", self.value()),
                format!("Y{}", self.decimal()),
                format!("P{}.{}", self.random.below(3), self.random.below(9) + 1),
            ];
            self.line(words);
        }
        if self.random.one_in(4) {
            self.lines.push("(debug,#<_motion_mode>)".to_owned());
        }
        self.line(vec!["G5.3".to_owned()]);
        self.straight();
    }

    fn polar(&mut self) {
        if !self.random.one_in(12) {
            self.line(vec!["G17".to_owned(), "G90".to_owned(), "G0 X1".to_owned()]);
        }
        let mut words = vec![self.random.pick(&["G0", "G1", "G90 G1", "G91 G0", "G90 G0"]).to_owned()];
        match self.random.below(5) {
            0 => words.push(format!("@{}", self.decimal())),
            1 => words.push(format!("^{}", self.decimal())),
            _ => words.push(format!("@{} ^{}", self.value(), self.decimal())),
        }
        if self.random.one_in(3) {
            words.push(format!("Z{}", self.decimal()));
        }
        self.line(words);
    }

    fn probe(&mut self) {
        // LinuxCNC's model of the machine needs the program position.
        self.lines.push("G90 G0 X1 Y2 Z3 A4 B5 C6".to_owned());
        let code = self.random.pick(&["G38.2", "G38.3", "G38.4", "G38.5"]).to_owned();
        let (words, feed) = (self.axis_words(2), self.random.below(90) + 1);
        // Rounding decides whether a distance of zero counts as one.
        let mut words: Vec<String> = words.into_iter().filter(|word| !word.starts_with('Z')).collect();
        words.extend([code, format!("Z-{}.5", self.random.below(40)), format!("F{feed}")]);
        self.line(words);
        let shown = self.random.pick(&["(debug,#5061 #5062 #5063 #5070)", "(debug,#5064 #5065 #<_motion_mode>)"]);
        self.lines.push(shown.to_owned());
        if self.random.one_in(3) {
            let mut words = self.axis_words(2);
            words.retain(|word| !word.starts_with('Z'));
            words.extend(["G90".to_owned(), format!("Z-{}.25", self.random.below(40))]);
            self.line(words);
        }
        self.straight();
    }

    fn lathe(&mut self) {
        let code = self.random.pick(&["G7", "G8", "G7 G90", "G7 G18", "G8"]);
        let mut words: Vec<String> = code.split(' ').map(str::to_owned).collect();
        if self.random.one_in(2) {
            words.extend(["G0".to_owned(), format!("X{}", self.value())]);
        }
        self.line(words);
        self.lines.push("(debug,#<_lathe_diameter_mode> #<_lathe_radius_mode> #5420 #<_abs_x>)".to_owned());
    }

    fn tool_data(&mut self) {
        if !self.has_tool {
            self.tool_change();
        }
        let tool = self.random.below(3) + 1;
        let l = self.random.pick(&["1", "10", "11"]);
        let mut words = vec!["G10".to_owned(), format!("L{l}"), format!("P{tool}"), self.axis_words(4).join(" ")];
        for letter in ["R", "I", "J"] {
            if self.random.one_in(4) {
                words.push(format!("{letter}{}", self.decimal()));
            }
        }
        if self.random.one_in(4) {
            let orientation = self.random.below(10) + self.random.below(12) / 11;
            words.push(format!("Q{orientation}"));
        }
        self.line(words);
        self.lines.push("(debug,#5400 #5410 #5411 #5413)".to_owned());
    }

    fn port(&mut self) {
        let codes = [
            "M66 P0 L0",
            "M66 P3 L1 Q2",
            "M66 E1",
            "M66 E1 L0 Q3",
            "M66 P1 L3",
            "M67 E2 Q1.5",
            "M68 E0 Q-3.25",
            "M67 E1 Q0 M3 S5",
            "M66 P1 L4 Q.5 M8",
            "G17.1",
            "G18.1",
            "G19.1 G0",
            "$0 S100",
            "S30 M4 $-1",
        ];
        let code = self.random.pick(&codes);
        self.line(code.split(' ').map(str::to_owned).collect());
        if code.contains(".1") {
            self.lines.push("(debug,#<_plane>)\nG17".to_owned());
        }
    }

    fn remark(&mut self) {
        let remark = self.random.pick(&[
            "(debug,%d#1 %f#2 %.3f#3 %lf #4 %5.2f#5 #6)",
            "(debug,100% #1 %%d #2 #<_x> %.1f#<_y>)",
            "(debug,##1 #[1] #<_kept> #3)",
            "(log,#1 #2 to nowhere)",
            "(LOGOPEN,file.txt)(LOGCLOSE)",
            "(logappend,file.txt)",
            "(logclose)",
            "(probeopen file.txt)",
            "(probeclose)",
            "(msg,one)(two)",
            "(one)(msg, #1 two)",
            "(comment);(msg,no)",
            ";msg,no",
            "( log,a)",
            "(debug,#<_vmajor> #<_vminor> #<_feed_hold> #<_call_level>)",
            "(msg)",
            "(debug)",
        ]);
        let remark = remark.to_owned();
        match self.random.below(3) {
            0 => self.lines.push(remark),
            1 => self.lines.push(format!("G0 {remark} Y1")),
            _ => self.lines.push(format!("N5 {remark}")),
        }
    }

    fn saved(&mut self) {
        // The values that M72 restores must be given with the digits that LinuxCNC stores.
        let (feed, speed) = (self.random.below(900) + 1, self.random.below(900));
        // It does not convert the tolerance of G64 Q with the units either.
        let tolerance = self.random.pick(&["G64", "G64 P.25 Q.5", "G64 P.5", "G64 P.125"]);
        self.lines.push(format!("{} F{feed} S{speed} {tolerance}", self.random.pick(&["", "N12"])));
        self.lines.push("M70".to_owned());
        for _ in 0..self.random.below(4) {
            let code = self.random.pick(&[
                "G17",
                "G18",
                "G19",
                "G90",
                "G91",
                "G90.1",
                "G91.1",
                "G98",
                "G99",
                "G7",
                "G8",
                "G54",
                "G56",
                "G59.2",
                "G61",
                "G64 P.5",
                "G64",
                "G64 P.1 Q.2",
                "G61.1",
                "M3",
                "M4",
                "M5",
                "M9",
                "F12",
                "S7",
                "F3.5",
                "G0 X1",
                "G1 Y2",
                "G53 G90 G0 X3",
            ]);
            let words = code.split(' ').map(str::to_owned).collect();
            self.line(words);
        }
        if !self.has_tool_offset && self.random.one_in(3) {
            self.lines.push(self.random.pick(&["G20", "G21"]).to_owned());
        }
        match self.random.below(12) {
            0 => self.lines.push("M71\nM72".to_owned()),
            1 => self.lines.push("M71".to_owned()),
            2 => self.lines.push("N3 M72\nM72".to_owned()),
            _ => self.lines.push("M72".to_owned()),
        }
        self.lines.push("(debug,#<_rpm> #<_metric> #<_coord_system> #<_spindle_on>)".to_owned());
    }
}
