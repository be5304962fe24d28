//! Subprograms of every kind with their calls, and loops with an early exit.
//!
//! Invariant: a subprogram calls only those written before it, so every program ends. A call is followed by the plane
//! and the distance mode that the lines after it depend on.

use super::Writer;

/// A subprogram that can be called.
#[derive(Clone, Debug)]
enum Callable {
    /// `O… sub`, in the program or in a file: its label.
    Sub(String),
    /// An O number whose end is M99.
    Fanuc(u32),
}

/// The subprograms of a program.
#[derive(Debug, Default)]
pub(super) struct Routines {
    known: Vec<Callable>,
    /// Lines after the end of the program.
    pub(super) behind: Vec<String>,
    /// Name and text of files.
    pub(super) files: Vec<(String, String)>,
}

impl Writer {
    /// Writes up to four subprograms, before the program, after its end or in files.
    pub(super) fn routines(&mut self) {
        let mut before = Vec::new();
        for index in 0..self.random.below(5) {
            let number = 700 + index as u32;
            match self.random.below(6) {
                0 | 1 => {
                    let body = self.body(|line| format!("O{number} {line}"), true);
                    self.routines.known.push(Callable::Sub(number.to_string()));
                    self.place(body, &mut before)
                }
                2 => {
                    let name = format!("<Part {index}>");
                    let body = self.body(|line| format!("o{name}{line}"), true);
                    self.routines.known.push(Callable::Sub(name));
                    self.place(body, &mut before)
                }
                3 => {
                    // A file calls nothing: LinuxCNC searches for a subprogram in the file of the call.
                    let known = std::mem::take(&mut self.routines.known);
                    let (name, label) = match self.random.below(2) {
                        0 => (format!("part{index}"), format!("<part{index}>")),
                        _ => (number.to_string(), number.to_string()),
                    };
                    let mut body = self.body(|line| format!("O{label} {line}"), true);
                    if self.random.one_in(2) {
                        body.insert(0, "(a file of its own)".to_owned());
                    }
                    self.routines.known = known;
                    self.routines.known.push(Callable::Sub(label));
                    self.routines.files.push((name, body.join("\n") + "\nM2\n"));
                }
                _ => {
                    let mut body = self.body(str::to_owned, false);
                    body.insert(0, format!("O{number} (called with M98)"));
                    body.push(self.random.pick(&["M99", " m99", "M99 (back)"]).to_owned());
                    self.put_behind(body);
                    self.routines.known.push(Callable::Fanuc(number));
                }
            }
        }
        self.lines.extend(before);
    }

    /// Writes a subprogram before or after the program.
    fn place(&mut self, mut body: Vec<String>, before: &mut Vec<String>) {
        if self.random.one_in(2) {
            return self.put_behind(body);
        }
        // LinuxCNC takes the value of a skipped endsub for a returned one.
        if let Some((end, value)) =
            body.pop().and_then(|end| Some((end.clone(), end.split_once("endsub")?.1.to_owned())))
        {
            let end = &end[..end.len() - value.len()];
            if !value.is_empty() {
                body.push(format!("{}{value}", end.replace("endsub", "return")));
            }
            body.push(end.to_owned());
        }
        before.append(&mut body);
    }

    /// Writes a subprogram after the program, before those that it calls: LinuxCNC searches for one from the call
    /// onwards.
    fn put_behind(&mut self, mut body: Vec<String>) {
        body.append(&mut self.routines.behind);
        self.routines.behind = body;
    }

    /// Returns the lines of a subprogram, with `sub` and `endsub` around them if they belong to it.
    fn body(&mut self, labelled: impl Fn(&str) -> String, is_sub: bool) -> Vec<String> {
        let outer = std::mem::take(&mut self.lines);
        let names = std::mem::take(&mut self.names);
        if is_sub {
            self.lines.push(labelled("sub"));
        }
        if self.random.one_in(3) {
            let (feed, speed) = (self.random.below(900) + 1, self.random.below(900));
            self.lines.push(format!("F{feed} S{speed} G64"));
            self.lines.push("M73".to_owned());
            for _ in 0..self.random.below(3) {
                let modes = ["G18", "G91", "G99", "G55", "M3", "M5", "F12", "S7", "G61", "G90.1", "G8", "G64 P.5"];
                let mode = self.random.pick(&modes).to_owned();
                self.lines.push(mode);
            }
            self.lines.push("G91.1".to_owned());
        }
        for _ in 0..self.random.below(4) + 1 {
            match self.random.below(9) {
                0..=3 => self.straight(),
                4 => self.assignment(),
                5 => self.arc(),
                6 => self.early_leaving(),
                7 => self.call(),
                _ => self.lines.push("(debug,#1 #2 #3 #30 #<_call_level>)".to_owned()),
            }
            if is_sub && self.random.one_in(6) {
                self.label += 1;
                let (condition, value) = (self.expression(1), self.expression(1));
                let end = if self.random.one_in(2) { format!("return [{value}]") } else { "return".into() };
                // A return may have any label.
                let end = match self.random.below(3) {
                    0 => format!("O{} {end}", 2000 + self.label),
                    1 => format!("o<away> {end}"),
                    _ => labelled(&end),
                };
                self.lines.push(format!("O{0} if [{condition}]\n{end}\nO{0} endif", self.label));
            }
        }
        if is_sub {
            let value = self.expression(1);
            let end = if self.random.one_in(2) { "endsub".to_owned() } else { format!("endsub [{value}]") };
            self.lines.push(labelled(&end));
        }
        self.names = names;
        std::mem::replace(&mut self.lines, outer)
    }

    /// Writes a call of one of the known subprograms.
    pub(super) fn call(&mut self) {
        if self.routines.known.is_empty() {
            return self.straight();
        }
        let which = self.random.below(self.routines.known.len() as u64) as usize;
        match self.routines.known[which].clone() {
            Callable::Sub(label) => {
                let arguments: Vec<String> =
                    (0..self.random.below(4)).map(|_| format!("[{}]", self.expression(1))).collect();
                // The target of a calculated call is not known when the program is opened, so it reaches no file.
                let is_number =
                    label.parse::<u32>().is_ok() && !self.routines.files.iter().any(|(name, _)| *name == label);
                let label = match self.random.below(3) {
                    0 if is_number => {
                        self.lines.push(format!("#29={label}"));
                        "#29".to_owned()
                    }
                    1 if is_number => {
                        let half = label.parse::<u32>().unwrap_or_default() - 350;
                        format!("[350+{half}]")
                    }
                    _ => label,
                };
                let word = self.random.pick(&["call", "CALL", " Call "]);
                self.lines.push(format!("O{label} {word} {}", arguments.join(" ")));
                self.lines.push("(debug,#<_value> #<_value_returned> #1 #<_call_level>)".to_owned());
            }
            Callable::Fanuc(number) => {
                let count = self.random.pick(&["", "", " L1", " L2", " L3"]);
                self.lines.push(format!("M98 P{number}{count}"));
            }
        }
        self.lines.push("G17 G90 G91.1".to_owned());
    }

    /// Writes a while loop with a `break` or a `continue`, and an `if` with all its branches. Early exits of do and
    /// repeat loops are tested in control.rs, where LinuxCNC is wrong.
    pub(super) fn early_leaving(&mut self) {
        self.label += 2;
        let (outer, inner) = (self.label - 1, self.label);
        let counter = format!("#{}", 40 + self.label % 100);
        let rounds = self.random.below(4) + 1;
        let names = self.names.len();
        self.lines.push(format!("{counter}=0"));
        self.has_leave = true;
        self.lines.push(format!("o{outer} while [{counter} LT {rounds}]"));
        self.lines.push(format!("{counter}=[{counter}+1]"));
        let (first, second) = (self.random.below(4), self.random.below(4));
        // One such word per loop: of two, LinuxCNC uses the wrong one.
        let leave = self.random.pick(&["break", "continue", "BREAK", "Continue"]).to_owned();
        self.lines.push(format!("O{inner} if [{counter} EQ {first}]"));
        if self.random.one_in(2) {
            self.straight();
        }
        self.lines.push(format!("O{outer} {}", leave));
        self.lines.push(format!("o{inner} elseif [{counter} EQ {second}]"));
        self.straight();
        if self.random.one_in(2) {
            self.lines.push(format!("O {inner} else"));
            self.straight();
        }
        self.lines.push(format!("O{inner} endif"));
        self.straight();
        self.names.truncate(names);
        self.lines.push(format!("O{outer} endwhile"));
    }

    /// Writes a parameter file: origins, rotations, positions of G28 and G30, an offset of G92, the coordinate system
    /// in force.
    pub(super) fn parameter_file(&mut self) -> String {
        let mut lines = Vec::new();
        let mut add = |number: u32, value: String| lines.push(format!("{number}\t{value}"));
        for first in [5161, 5181] {
            for number in first..first + 9 {
                let value = if self.random.one_in(3) { self.random.below(2000) as f64 / 100.0 - 10.0 } else { 0.0 };
                add(number, format!("{value:.6}"));
            }
        }
        let in_force = self.random.below(2);
        add(5210, in_force.to_string());
        self.has_g92 |= in_force == 1;
        for number in 5211..5220 {
            add(number, format!("{}.25", self.random.below(4)));
        }
        let selected = self.random.below(9) as u32 + 1;
        add(5220, selected.to_string());
        for system in 0..9_u32 {
            for axis in 1..=9 {
                let value = if self.random.one_in(3) { self.random.below(900) as f64 / 100.0 - 4.0 } else { 0.0 };
                add(5220 + 20 * system + axis, format!("{value:.6}"));
            }
            let rotation = if system + 1 != selected && self.random.one_in(6) { self.random.below(90) } else { 0 };
            add(5230 + 20 * system, rotation.to_string());
        }
        lines.join("\n") + "\n"
    }
}
