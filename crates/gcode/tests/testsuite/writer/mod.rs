//! Random valid programs.

mod compensated;
mod cycles;
mod more;
mod routines;

/// A program and its input files.
#[derive(Clone, Debug, Default)]
#[allow(dead_code, reason = "fuzzing takes the program alone")]
pub(crate) struct Case {
    pub(crate) program: String,
    /// Subprograms in files of their own: name and text.
    pub(crate) files: Vec<(String, String)>,
    /// A tool table.
    pub(crate) tools: Option<&'static str>,
    /// A parameter file.
    pub(crate) parameters: Option<String>,
}

/// The tools of a program that has a table of its own. LinuxCNC's CHANGE_TOOL prints the position in the table, so each
/// has the number of its line.
const TOOLS: &str =
    "T1 P1 Z0.511 D0.125\nT2 P2 Z0.1 X.25 D0.0625\nT3 P3 Z1.273 Y-.5 A2 D0.201\nT4 P4 D-0.0625 I90 J45 Q3\n";

/// A small generator of random numbers, the same on every machine.
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Random {
        Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 16
    }

    pub(crate) fn below(&mut self, bound: u64) -> u64 {
        self.next() % bound
    }

    pub(crate) fn one_in(&mut self, n: u64) -> bool {
        self.below(n) == 0
    }

    pub(crate) fn pick<'a>(&mut self, of: &[&'a str]) -> &'a str {
        of[self.below(of.len() as u64) as usize]
    }
}

/// Writer of random programs over the supported language.
///
/// Cases in which `rs274` itself is wrong are left out: peer_faults.md, next to this folder, has each with its reason.
pub(crate) struct Writer {
    random: Random,
    lines: Vec<String>,
    has_tool_offset: bool,
    /// Whether there was an M6.
    has_tool: bool,
    has_g92: bool,
    /// Whether M49 or M51 P0 was last.
    speed_override_off: bool,
    names: Vec<String>,
    /// The O label used last; LinuxCNC accepts each once only.
    label: u32,
    /// Whether there was a break or a continue.
    has_leave: bool,
    routines: routines::Routines,
}

impl Writer {
    pub(crate) fn case(seed: u64) -> Case {
        let mut writer = Writer {
            random: Random::new(seed),
            lines: Vec::new(),
            has_tool_offset: false,
            has_tool: false,
            has_g92: false,
            speed_override_off: false,
            names: Vec::new(),
            label: 0,
            has_leave: false,
            routines: routines::Routines::default(),
        };
        let percent = writer.random.one_in(5);
        if percent {
            writer.lines.push("%".to_owned());
        }
        writer.lines.push("#<_kept>=1".to_owned());
        let feed = writer.random.below(900) + 1;
        writer.line(vec![format!("F{feed}"), "G1".to_owned()]);
        let has_parameters = writer.random.one_in(4);
        let parameters = has_parameters.then(|| writer.parameter_file());
        let tools = writer.random.one_in(4).then_some(TOOLS);
        if writer.random.one_in(2) {
            writer.routines();
        }
        for _ in 0..writer.random.below(40) + 5 {
            writer.block();
        }
        if writer.speed_override_off {
            writer.lines.push("M48".to_owned());
        }
        match writer.random.below(12) {
            0 if percent && writer.routines.behind.is_empty() => writer.lines.push("%".to_owned()),
            1 if writer.routines.behind.is_empty() => {}
            2..=4 => writer.lines.push("M30".to_owned()),
            _ => writer.lines.push("M2".to_owned()),
        }
        let behind = std::mem::take(&mut writer.routines.behind);
        writer.lines.extend(behind);
        // LinuxCNC refuses a line that is too long even where it is skipped.
        let fits = |line: &str| line.lines().all(|line| line.len() <= 250);
        writer.lines.retain(|line| fits(line));
        for (_, text) in &mut writer.routines.files {
            *text = text.lines().filter(|line| fits(line)).map(|line| format!("{line}\n")).collect();
        }
        Case { program: writer.lines.join("\n") + "\n", files: writer.routines.files, tools, parameters }
    }

    /// Writes a line of these words, in any order, case and spacing.
    fn line(&mut self, mut words: Vec<String>) {
        for last in (1..words.len()).rev() {
            words.swap(last, self.random.below(last as u64 + 1) as usize);
        }
        let mut line = String::new();
        if self.random.one_in(6) {
            let number = self.random.below(100_000);
            line += &self.random.pick(&["N#", "n0#", "/N#", "N#.5"]).replace('#', &number.to_string());
        }
        for word in words {
            line += self.random.pick(&["", " ", " ", "\t"]);
            line += &if self.random.one_in(8) { word.to_lowercase() } else { word };
        }
        if self.random.one_in(9) {
            line += self.random.pick(&[
                "(comment)",
                " ; to the end (",
                "( MSG, hello #1 )",
                "(debug, #1 #<_x> #<none>)",
                "()",
            ]);
        }
        self.lines.push(line);
    }

    fn block(&mut self) {
        if self.random.one_in(7) {
            return self.machining();
        }
        match self.random.below(47) {
            0..=9 => self.straight(),
            10..=13 => self.arc(),
            14..=16 => self.assignment(),
            17 => self.inverse_time(),
            18 => self.machine_move(),
            19 | 20 => self.offset(),
            21 => self.coordinate_system(),
            22 => self.units(),
            23 => self.tool(),
            24 => self.tool_change(),
            25 => self.home(),
            26 => self.mode(),
            27..=29 => self.switch(),
            30 => self.dwell(),
            31 => self.path_control(),
            32 => self.anything(),
            33 | 34 => self.control(5),
            35 => match self.random.below(3) {
                0 => self.early_leaving(),
                _ => self.call(),
            },
            36 => self.compensated(),
            38.. => self.more(),
            _ => {
                let words = vec![self.axis_words(2).join(""), format!("F{}", self.random.below(99) + 1)];
                self.line(words);
            }
        }
    }

    /// Writes a branch, a loop or a subprogram, with blocks inside that may be such themselves. Of the five kinds the
    /// last, a subprogram, is written only outside of the others: LinuxCNC refuses to pass its definition twice.
    fn control(&mut self, kinds: u64) {
        self.label += 1;
        let label = format!("{}{}", self.random.pick(&["O", "o ", "N7 o"]), self.label);
        let own = 40 + self.label;
        let condition = format!("[{}]", self.expression(2));
        let kind = match self.random.below(kinds) {
            // After LinuxCNC has passed a break, its next do loop ends after one iteration.
            3 if self.has_leave => 2,
            kind => kind,
        };
        let count = self.random.below(4);
        // The assignments of a branch that is not executed would be missing later.
        let names = self.names.len();
        match kind {
            0 => self.lines.push(format!("{label} if {condition}")),
            1 => self.lines.push(format!("{label} repeat [{count}]")),
            2 => self.lines.push(format!("#{} = 0\n{label} while [#{} lt {count}]", own, own)),
            3 => self.lines.push(format!("#{} = 0\n{label} do", own)),
            _ => self.lines.push(format!("{label} sub")),
        }
        if kind == 4 {
            self.names.clear();
        }
        let counter = format!("#{} = [#{} + 1]", own, own);
        for _ in 0..self.random.below(3) + 1 {
            if self.random.one_in(2) {
                self.straight()
            } else {
                self.assignment()
            }
            self.names.truncate(names);
            if kind == 4 {
                self.names.clear();
            }
        }
        if matches!(kind, 0..=3) && self.label < 20 && self.random.one_in(3) {
            self.control(4);
        }
        match kind {
            0 if self.random.one_in(2) => {
                self.lines.push(format!("{label} else"));
                self.straight();
                self.lines.push(format!("{label} endif"));
            }
            0 => self.lines.push(format!("{label} endif")),
            1 => self.lines.push(format!("{label} endrepeat")),
            2 => self.lines.push(format!("{counter}\n{label} endwhile")),
            3 => self.lines.push(format!("{counter}\n{label} while [#{} LT {count}]", own)),
            _ => {
                let value = self.expression(1);
                self.lines.push(format!("{label} endsub [{value}]"));
                let arguments = format!("[{}] [{}]", self.expression(1), self.decimal());
                self.lines.push(format!("{label} call {arguments} (called)\n(debug,#<_value>)"));
            }
        }
        self.names.truncate(names);
    }

    fn decimal(&mut self) -> String {
        let whole = self.random.below(40);
        let sign = self.random.pick(&["", "", "-", "+", "-"]);
        match self.random.below(4) {
            0 => format!("{sign}{whole}"),
            1 => format!("{sign}.{}", self.random.below(1000)),
            2 => format!("{sign}{whole}."),
            _ => format!("{sign}{whole}.{}", self.random.below(100_000)),
        }
    }

    fn positive(&mut self) -> String {
        format!("{}.{}", self.random.below(30) + 1, self.random.below(1000))
    }

    fn value(&mut self) -> String {
        match self.random.below(6) {
            0 => self.calculation(),
            1 => format!("#{}", self.random.below(12) + 1),
            _ => self.decimal(),
        }
    }

    /// Writes an expression, with an angle function outermost at most: inside, MOD and comparisons would magnify the
    /// last digit of a sine, which LinuxCNC calculates with 80 bits.
    fn calculation(&mut self) -> String {
        let inner = self.expression(2);
        match self.random.below(12) {
            0 => format!("SIN[{inner}]"),
            1 => format!("COS[{inner}]"),
            2 => format!("TAN[{inner} MOD 80]"),
            3 => format!("ATAN[{inner}]/[{}]", self.expression(2)),
            4 => format!("{}[[{inner} MOD 2]-1]", self.random.pick(&["ASIN", "ACOS"])),
            5 => format!("{}[[{inner} MOD 7]+.1]", self.random.pick(&["LN", "EXP"])),
            _ => self.expression(3),
        }
    }

    /// Writes an expression in brackets, or a function of one.
    fn expression(&mut self, depth: u64) -> String {
        if depth == 0 {
            return match self.random.below(5) {
                0 => format!("#{}", self.random.below(12) + 1),
                1 => self.random.pick(&["#<_x>", "#<_y>", "#5220", "#5420", "#5422", "#<_metric>"]).to_owned(),
                2 if !self.names.is_empty() => {
                    let index = self.random.below(self.names.len() as u64) as usize;
                    format!("#<{}>", self.names[index])
                }
                _ => self.decimal(),
            };
        }
        let inner = self.expression(depth - 1);
        let other = self.expression(depth - 1);
        match self.random.below(14) + 3 {
            // At the tolerance, LinuxCNC's installed version and the release agree; LE and GE agree away from it only.
            16 => {
                let (left, near) = (self.random.below(40), self.random.pick(&["", ".0000005", ".0002"]));
                let operator = self.random.pick(&["EQ", "NE", "LT", "GT", "LE", "GE"]);
                let near = if operator.ends_with('E') && operator != "NE" && near == ".0000005" { "" } else { near };
                let sides = [format!("{left}"), format!("{left}{near}")];
                let first = self.random.below(2) as usize;
                format!("[{} {operator} {}]", sides[first], sides[1 - first])
            }
            3 => format!("SQRT[ABS[{inner}]]"),
            4 => match self.random.pick(&["FIX", "FUP", "ROUND", "ABS"]) {
                "ROUND" => format!("ROUND[{inner} MOD 9999]"),
                function => format!("{function}[{inner}]"),
            },
            5 => format!("[{inner} MOD [ABS[{other}]+1]]"),
            6 => format!("[{inner}/[ABS[{other}]+.5]]"),
            7 => format!("EXISTS[#<{}>]", self.random.pick(&["none", "_kept"])),
            8 => format!("-[{inner}]"),
            9 => format!(
                "[{inner} {} {other}]",
                self.random.pick(&["AND", "OR", "XOR", "EQ", "NE", "LT", "GT", "LE", "GE"])
            ),
            10 => format!("[[{inner} MOD 9]**{}]", self.random.below(4)),
            _ => {
                let (first, second) = (self.random.pick(&["+", "-", "*"]), self.random.pick(&["+", "-", "*"]));
                let last = self.decimal();
                format!("[{inner}{first}{other}{second}{last}]")
            }
        }
    }

    fn axis_words(&mut self, most: u64) -> Vec<String> {
        let mut letters = vec!["X", "Y", "Z", "A", "B", "C"];
        let mut words = Vec::new();
        for _ in 0..self.random.below(most) + 1 {
            let bound = if self.random.one_in(6) { letters.len() } else { letters.len().min(3) };
            let letter = letters.remove(self.random.below(bound as u64) as usize);
            words.push(format!("{letter}{}", self.value()));
        }
        words
    }

    fn straight(&mut self) {
        let mut words = self.axis_words(4);
        words.push(self.random.pick(&["G0", "G1", "G01", "G0 G90", "G91 G1", "G90G1", "G1"]).to_owned());
        if self.random.one_in(5) {
            let feed = self.positive();
            words.push(format!("F{feed}"));
        }
        self.line(words);
    }

    fn arc(&mut self) {
        let (plane, first, second, third, centre) = match self.random.below(4) {
            0 => ("G18", "Z", "X", "Y", ["K", "I"]),
            1 => ("G19", "Y", "Z", "X", ["J", "K"]),
            _ => ("G17", "X", "Y", "Z", ["I", "J"]),
        };
        let code = self.random.pick(&["G2", "G3", "G02", "G3.0"]);
        let (p, q) = (self.random.below(2000) as f64 / 100.0 - 10.0, self.random.below(2000) as f64 / 100.0 - 9.99);
        let mut words = vec![plane.to_owned(), code.to_owned()];
        match self.random.below(4) {
            0 => words.extend([format!("{}{p}", centre[0]), format!("{}{q}", centre[1])]),
            1 => {
                words.push("G91".to_owned());
                words.extend([format!("{}{p}", centre[0]), format!("{}{q}", centre[1])]);
                words.extend([format!("{first}{}", 2.0 * p), format!("{second}{}", 2.0 * q)]);
            }
            2 => {
                let radius = p.hypot(q) * (0.5 + self.random.below(30) as f64 / 10.0) + 0.01;
                words.push("G91".to_owned());
                words.extend([format!("{first}{p}"), format!("{second}{q}")]);
                words.push(format!("R{}{radius:.3}", self.random.pick(&["", "-"])));
            }
            _ => {
                self.line(vec!["G90G0".to_owned(), format!("{first}{p}{second}{q}")]);
                let centre = [format!("{}{}", centre[0], p + 3.0), format!("{}{q}", centre[1])];
                words.extend([centre[0].clone(), centre[1].clone(), "G90.1".to_owned()]);
                self.line(words);
                self.line(vec!["G91.1".to_owned()]);
                return;
            }
        }
        if self.random.one_in(2) {
            words.push(format!("{third}{}", self.random.below(9)));
        }
        if self.random.one_in(4) {
            words.push(format!("P{}", self.random.below(4) + 1));
        }
        if self.random.one_in(6) {
            words.push("A12.5".to_owned());
        }
        self.line(words);
    }

    fn assignment(&mut self) {
        let name = self.random.pick(&["some", "_other", "Long Name"]).to_owned();
        let value = self.calculation();
        if self.random.one_in(3) {
            self.lines.push(format!("#<{name}> = {value}"));
            self.names.push(name);
        } else {
            let number = self.random.below(12) + 1;
            let second = self.decimal();
            let more = if self.random.one_in(3) { format!(" #{} = {second}", number + 1) } else { String::new() };
            self.lines.push(format!("#{number}={value}{more}"));
        }
    }

    fn inverse_time(&mut self) {
        let words = self.axis_words(3);
        let feed = self.positive();
        self.line(vec!["G93".to_owned(), "G1".to_owned(), words.join(" "), format!("F{feed}")]);
        if self.random.one_in(2) {
            let rise = self.random.below(5);
            self.line(vec!["G17 G2 I3 J1".to_owned(), format!("Z{rise}"), format!("F{feed}")]);
        }
        let feed = self.positive();
        self.line(vec!["G94".to_owned(), format!("F{feed}")]);
    }

    fn machine_move(&mut self) {
        let words = self.axis_words(3).join(" ");
        let code = self.random.pick(&["G0", "G1"]);
        self.line(vec!["G53".to_owned(), "G90".to_owned(), code.to_owned(), words]);
    }

    fn offset(&mut self) {
        let words = self.axis_words(3).join(" ");
        let code = self.random.pick(&["G92", "G52", "G92.1", "G92.2", "G92.3", "G80 G92"]);
        self.has_g92 = !matches!(code, "G92.1" | "G92.2");
        if code.contains('.') { self.line(vec![code.to_owned()]) } else { self.line(vec![code.to_owned(), words]) }
    }

    fn coordinate_system(&mut self) {
        match self.random.below(3) {
            0 => {
                let code = self.random.pick(&["G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3"]);
                self.line(vec![code.to_owned()]);
            }
            _ => {
                let system = self.random.below(10);
                let l = self.random.pick(&["2", "20"]);
                let mut words = self.axis_words(4);
                if l == "2" && !self.has_g92 && self.random.one_in(4) {
                    words.push(format!("R{}", self.random.below(90)));
                }
                self.line(vec!["G10".to_owned(), format!("L{l}"), format!("P{system}"), words.join(" ")]);
            }
        }
    }

    fn units(&mut self) {
        let code = self.random.pick(&["G20", "G21"]);
        if !self.has_tool_offset {
            self.line(vec![code.to_owned()]);
        }
    }

    fn tool(&mut self) {
        let code = self.random.pick(&["G43 H1", "G43 H2", "G43 H3", "G49", "G43.1 Z1.5", "G43.2 H1", "G43", "G49"]);
        self.has_tool_offset = code != "G49";
        self.line(code.split(' ').map(str::to_owned).collect());
    }

    fn tool_change(&mut self) {
        self.has_tool = true;
        let tool = self.random.below(3) + 1;
        self.line(vec!["G90 G0 X1 Y2.5 Z3 A4 B5 C6".to_owned()]);
        self.line(vec![format!("T{tool}"), "M6".to_owned()]);
    }

    fn home(&mut self) {
        match self.random.below(3) {
            0 => self.lines.push(self.random.pick(&["G28.1", "G30.1"]).to_owned()),
            _ => {
                let code = self.random.pick(&["G28", "G30"]).to_owned();
                let words = if self.random.one_in(2) { self.axis_words(2).join(" ") } else { String::new() };
                self.line(vec![code, words]);
            }
        }
    }

    fn mode(&mut self) {
        let code =
            self.random.pick(&["G17", "G18", "G19", "G90", "G91", "G91.1", "G80", "G40", "G98", "G99", "G80 G0"]);
        self.line(code.split(' ').map(str::to_owned).collect());
    }

    fn switch(&mut self) {
        let codes = [
            "M3 S1000",
            "M4 S50.5",
            "M5",
            "M7",
            "M8",
            "M9",
            "M48",
            "M49",
            "M62 P1",
            "M63 P0",
            "M64 P3",
            "M65 P2",
            "M0",
            "M1",
            "M60",
            "S200",
            "T2",
            "M50 P0",
            "M51 P1",
            "M51 P0",
            "M52 P1",
            "M53 P0",
            "M3 M8 M48",
        ];
        let code = self.random.pick(&codes);
        if ["M48", "M49", "M51"].iter().any(|switch| code.contains(switch)) {
            self.speed_override_off = code.contains("M49") || code.contains("P0");
        }
        self.line(code.split(' ').map(str::to_owned).collect());
    }

    fn dwell(&mut self) {
        let seconds = self.positive();
        self.line(vec!["G4".to_owned(), format!("P{seconds}")]);
    }

    fn path_control(&mut self) {
        let code = self.random.pick(&["G61", "G61.1", "G64", "G64 P0.05", "G64 P.01 Q.02", "G64 Q1", "G64 P-1"]);
        self.line(code.split(' ').map(str::to_owned).collect());
    }

    /// Writes words that may not belong together.
    fn anything(&mut self) {
        if !self.random.one_in(12) {
            return;
        }
        let codes = [
            "G0", "G1", "G2", "X1", "Y2", "X3", "I1", "J1", "R2", "P1", "L2", "G4", "G53", "G92", "G28", "G80", "H1",
            "Q1", "M3", "M5", "S-1", "F0", "T1", "T9", "G94", "G10", "G54", "D1", "K1", "#1", "[1", "G91", "M2", "(a",
            "=", "G99.9",
        ];
        // M2 may be among them.
        if std::mem::take(&mut self.speed_override_off) {
            self.lines.push("M48".to_owned());
        }
        let words = (0..self.random.below(4) + 1).map(|_| self.random.pick(&codes).to_owned()).collect();
        self.line(words);
    }
}
