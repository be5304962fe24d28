//! The tool table and its file.
//!
//! Invariant: each tool number occurs once; lengths are in machine units.

use crate::canon_modes::LengthUnit;
use crate::diag::{Diagnostic, Span};
use crate::error_codes::ErrorCode;
use crate::number_range::LARGEST;
use crate::pose::{Axis, Pose};
use crate::unknown::{UNKNOWN, join};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::sync::Arc;

/// One tool.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tool {
    /// Number, as in T and H words.
    pub number: u32,
    /// Pocket in the changer.
    pub pocket: u32,
    /// Offset, in machine units and degrees.
    pub offset: Pose,
    /// Diameter, in machine units.
    pub diameter: f64,
    /// Front angle of a lathe tool, degrees.
    pub front_angle: f64,
    /// Back angle of a lathe tool, degrees.
    pub back_angle: f64,
    /// Orientation of a lathe tool, 0 … 9.
    pub orientation: f64,
}

/// All tools of the machine.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ToolTable {
    tools: Arc<Vec<Tool>>,
    /// Names of the tools from the comments of the table, by number.
    names: BTreeMap<u32, Box<str>>,
}

impl ToolTable {
    /// Returns the three tools that LinuxCNC's `rs274` has without a tool table: 1, 2 and 3, of 0.511, 0.1 and 1.273
    /// inches' length. They are used for a machine of these units, so that a program with G43 gives the same result
    /// with and without a table.
    #[must_use]
    pub fn samples(machine_units: LengthUnit) -> ToolTable {
        let inch = LengthUnit::Inch.millimetres() / machine_units.millimetres();
        let tool = |number: u32, length: f64, diameter: f64| Tool {
            number,
            pocket: number,
            offset: Pose::xyz(0.0, 0.0, length * inch),
            diameter: diameter * inch,
            ..Tool::default()
        };
        ToolTable {
            names: BTreeMap::new(),
            tools: Arc::new(vec![tool(1, 0.511, 0.125), tool(2, 0.1, 0.0625), tool(3, 1.273, 0.201)]),
        }
    }

    /// Returns the tool of this number. Number 0 means no tool, and always exists.
    #[must_use]
    pub fn get(&self, number: u32) -> Option<Tool> {
        if number == 0 {
            return Some(Tool::default());
        }
        self.tools.iter().find(|tool| tool.number == number).copied()
    }

    /// Adds a tool; one of the same number is replaced.
    pub fn insert(&mut self, tool: Tool) {
        let tools = Arc::make_mut(&mut self.tools);
        match tools.iter_mut().find(|old| old.number == tool.number) {
            Some(old) => *old = tool,
            None => tools.push(tool),
        }
    }

    /// Returns the data of the tools, to be restored or joined later.
    pub(crate) fn data(&self) -> Arc<Vec<Tool>> {
        Arc::clone(&self.tools)
    }

    /// Sets the data of the tools to those of another branch.
    pub(crate) fn restore(&mut self, data: Arc<Vec<Tool>>) {
        self.tools = data;
    }

    /// Joins the data of the tools with those of another branch. A program only changes tools of the table.
    pub(crate) fn join(&mut self, data: &Arc<Vec<Tool>>) {
        if Arc::ptr_eq(&self.tools, data) || self.tools == *data {
            return;
        }
        for (tool, other) in Arc::make_mut(&mut self.tools).iter_mut().zip(data.iter()) {
            tool.offset.0.iter_mut().zip(other.offset.0).for_each(|(value, other)| join(value, other));
            join(&mut tool.diameter, other.diameter);
            join(&mut tool.front_angle, other.front_angle);
            join(&mut tool.back_angle, other.back_angle);
            join(&mut tool.orientation, other.orientation);
        }
    }

    /// Makes the data of all tools unknown.
    pub(crate) fn forget(&mut self) {
        for tool in Arc::make_mut(&mut self.tools) {
            tool.offset = Pose([UNKNOWN; 9]);
            (tool.diameter, tool.front_angle, tool.back_angle, tool.orientation) = (UNKNOWN, UNKNOWN, UNKNOWN, UNKNOWN);
        }
    }

    /// Returns all tools, in the order of the table.
    pub fn tools(&self) -> impl Iterator<Item = &Tool> {
        self.tools.iter()
    }

    /// Returns the name of a tool from the table's comment.
    #[must_use]
    pub fn name(&self, number: u32) -> Option<&str> {
        self.names.get(&number).map(AsRef::as_ref)
    }

    /// Returns the position of a tool in the table, from 1; 0 when the table does not have it.
    pub(crate) fn index_of(&self, number: u32) -> u32 {
        if number == 0 {
            return 0;
        }
        self.tools.iter().position(|tool| tool.number == number).map_or(0, |index| index as u32 + 1)
    }

    /// Parses a tool table in LinuxCNC's format: lines such as `T1 P1 Z0.511 D0.125 ;comment`.
    ///
    /// # Errors
    /// E1702 for each invalid line.
    pub fn read(text: &str) -> Result<ToolTable, Vec<Diagnostic>> {
        let mut table = ToolTable::default();
        let mut diagnostics = Vec::new();
        for (index, line) in text.lines().enumerate() {
            let (content, comment) = line.split_once(';').unwrap_or((line, ""));
            if content.trim().is_empty() {
                continue;
            }
            match parse_tool(content) {
                // Of several lines of one number the first counts, as in LinuxCNC.
                Ok(tool) if table.tools.iter().any(|known| known.number == tool.number) => {}
                Ok(tool) => {
                    Arc::make_mut(&mut table.tools).push(tool);
                    if !comment.trim().is_empty() {
                        table.names.insert(tool.number, comment.trim().into());
                    }
                }
                Err((word, message)) => {
                    let start = line.find(word).unwrap_or(0);
                    diagnostics.push(Diagnostic {
                        code: ErrorCode::ToolTableLine,
                        file: 0,
                        line: index as u32 + 1,
                        span: Span::new(start, start + word.len()),
                        message,
                    });
                }
            }
        }
        if diagnostics.is_empty() { Ok(table) } else { Err(diagnostics) }
    }

    /// Returns the text of the table, in the format of [`ToolTable::read`].
    #[must_use]
    pub fn write(&self) -> String {
        let mut text = String::new();
        for tool in self.tools.iter() {
            text += &format_words(tool);
            // Writing to a string cannot fail.
            let _ = match self.name(tool.number) {
                Some(name) => writeln!(text, " ;{name}"),
                None => writeln!(text),
            };
        }
        text
    }

    /// Returns the text of a tool table updated with these tools: their lines are replaced, comments and every other
    /// line stay. A tool without a line gets one at the end.
    #[must_use]
    pub fn rewrite(text: &str, tools: &[Tool]) -> String {
        let mut left: Vec<&Tool> = tools.iter().collect();
        let mut rewritten = String::with_capacity(text.len());
        for line in text.split_inclusive('\n') {
            let (content, comment) = line.split_once(';').map_or((line, None), |(content, rest)| (content, Some(rest)));
            let number = parse_tool(content).ok().filter(|_| !content.trim().is_empty()).map(|tool| tool.number);
            match left.iter().position(|tool| Some(tool.number) == number) {
                None => rewritten += line,
                Some(index) => {
                    rewritten += &format_words(left.remove(index));
                    match comment {
                        Some(comment) => rewritten.extend([" ;", comment]),
                        None => rewritten.push('\n'),
                    }
                }
            }
        }
        for tool in left {
            if !rewritten.is_empty() && !rewritten.ends_with('\n') {
                rewritten.push('\n');
            }
            rewritten += &format_words(tool);
            rewritten.push('\n');
        }
        rewritten
    }
}

/// Returns a tool's line of the table, without its comment.
fn format_words(tool: &Tool) -> String {
    let mut text = format!("T{} P{}", tool.number, tool.pocket);
    let lengths = Axis::ALL.map(|axis| (char::from(axis.letter()), tool.offset[axis]));
    let rest = [('D', tool.diameter), ('I', tool.front_angle), ('J', tool.back_angle), ('Q', tool.orientation)];
    for (letter, value) in lengths.into_iter().chain(rest).filter(|(_, value)| *value != 0.0) {
        // Writing to a string cannot fail.
        let _ = write!(text, " {letter}{value}");
    }
    text
}

/// Parses the tool of a line. Returns the invalid word and the reason otherwise.
fn parse_tool(line: &str) -> Result<Tool, (&str, String)> {
    let mut tool = Tool::default();
    let mut named = false;
    for word in line.split_whitespace() {
        let (letter, text) = word.split_at(word.chars().next().map_or(0, char::len_utf8));
        let bad = |what: &str| (word, format!("{word}: {what}"));
        let value: f64 = text
            .parse()
            .ok()
            .filter(|value: &f64| value.abs() <= LARGEST)
            .ok_or_else(|| bad("not a number below 1e15"))?;
        let whole = || text.parse::<u32>().map_err(|_| bad("not a whole number of at least 0"));
        match letter.to_ascii_uppercase().as_str() {
            "T" => {
                tool.number = whole()?;
                named = true;
            }
            "P" => tool.pocket = whole()?,
            "D" => tool.diameter = value,
            "I" => tool.front_angle = value,
            "J" => tool.back_angle = value,
            "Q" => tool.orientation = value,
            axis => match axis.bytes().next().and_then(Axis::of_letter) {
                Some(axis) => tool.offset[axis] = value,
                None => return Err(bad("unknown word")),
            },
        }
    }
    if named { Ok(tool) } else { Err((line.trim(), "a tool needs a T word".to_owned())) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_changed_tool_is_rewritten_and_every_other_line_stays() {
        let text = "; my tools\nT1 P1 Z5 ;end mill\nT2 P2 Z7";
        let tool = |number, z| Tool { number, pocket: number, offset: Pose::xyz(0.0, 0.0, z), ..Tool::default() };
        assert_eq!(
            ToolTable::rewrite(text, &[tool(1, 5.5), tool(9, -2.0)]),
            "; my tools\nT1 P1 Z5.5 ;end mill\nT2 P2 Z7\nT9 P9 Z-2\n"
        );
        assert_eq!(ToolTable::rewrite("", &[tool(3, 1.0)]), "T3 P3 Z1\n");
        assert_eq!(ToolTable::rewrite(text, &[]), text);
    }

    #[test]
    fn a_table_is_read_by_words_in_any_order() {
        let table =
            ToolTable::read("T1 P1 Z0.511 D0.125 ;1/8 end mill\n\n  D3 T20 P2 X-1 Q9 ; lathe\n").expect("a table");
        let tool = table.get(20).expect("tool 20");
        assert_eq!(
            (tool.pocket, tool.diameter, tool.offset, tool.orientation),
            (2, 3.0, Pose::xyz(-1.0, 0.0, 0.0), 9.0)
        );
        assert_eq!(table.get(1).map(|tool| tool.offset[Axis::Z]), Some(0.511));
        assert_eq!((table.get(0), table.get(2)), (Some(Tool::default()), None));
    }

    #[test]
    fn what_is_written_is_read_again() {
        let text =
            "T1 P1 Z0.511 D0.125 ;1/8 end mill\nT20 P2 X-1.1234567890123456 C30 D3 I90 J-5 Q9 ; lathe; inside \nT7\n";
        let table = ToolTable::read(text).expect("a table");
        assert_eq!(ToolTable::read(&table.write()), Ok(table.clone()));
        assert_eq!((table.name(1), table.name(20), table.name(7)), (Some("1/8 end mill"), Some("lathe; inside"), None));
        assert_eq!(table.tools().count(), 3);
    }

    #[test]
    fn each_bad_line_is_named_with_its_word() {
        let found = ToolTable::read("T1 Zx\nP1\nT2\nT3 #5\nT-1\nT4 Z1e999\nTé\n").expect_err("six bad lines");
        let places: Vec<_> = found.iter().map(|diagnostic| (diagnostic.line, diagnostic.column())).collect();
        assert_eq!(places, [(1, 4), (2, 1), (4, 4), (5, 1), (6, 4), (7, 1)]);
    }
}
