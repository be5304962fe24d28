//! Cutter compensation combined with other features: outlines in rotated and shifted coordinates, with expressions as
//! ends. The details of compensation are in the writer of outlines.

use super::Writer;

impl Writer {
    /// Writes an entry, some compensated moves, and an exit.
    pub(super) fn compensated(&mut self) {
        let (plane, first, second, centre) = match self.random.below(3) {
            0 => ("G18", "Z", "X", ["K", "I"]),
            _ => ("G17", "X", "Y", ["I", "J"]),
        };
        self.line(vec![plane.to_owned(), "G90".to_owned(), "G0".to_owned(), format!("{first}0"), format!("{second}0")]);
        let side = self.random.pick(&["G41", "G42"]).to_owned();
        let tool = self.random.below(4);
        match self.random.below(3) {
            0 => self.line(vec![side, format!("D{tool}")]),
            1 => self.line(vec![side]),
            _ => {
                let diameter = self.random.below(9);
                self.line(vec![format!("{side}.1"), format!("D[{diameter}/4]")]);
            }
        }
        self.line(vec!["G1 F100".to_owned(), format!("{first}20"), format!("{second}[#1 MOD 3]")]);
        for _ in 0..self.random.below(4) {
            let (p, q) = (self.random.below(60) as f64 - 30.0, self.random.below(60) as f64 - 29.5);
            match self.random.below(6) {
                0 => {
                    let code = self.random.pick(&["G2", "G3"]).to_owned();
                    let centre = format!("{}{} {}{}", centre[0], p / 2.0, centre[1], q / 2.0);
                    self.line(vec![code, "G91".to_owned(), format!("{first}{p}"), format!("{second}{q}"), centre]);
                }
                1 => self.lines.push("(debug, #<_x> #5421 #<_abs_z> #<_abs_x> #<_ccomp>)M8".to_owned()),
                2 => self.assignment(),
                _ => {
                    let code = self.random.pick(&["G1", "G1", "G0"]).to_owned();
                    self.line(vec![code, "G90".to_owned(), format!("{first}{p}"), format!("{second}[{q}+#2 MOD 4]")]);
                }
            }
        }
        self.line(vec!["G40".to_owned()]);
        self.line(vec!["G0 G90 X0".to_owned()]);
    }
}
