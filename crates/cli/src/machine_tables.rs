//! Offsets and tool data of a machine: selects their files and writes them.
//!
//! Each machine file has its own parameter file and tool table in the state folder; `--params` and `--tools` replace
//! them.
//!
//! Invariant: only changed values are written, over the current content of the file, so that no change in between is
//! lost. The machine's own parameter file stores offsets, not the variables of programs.

use std::fmt::Write as _;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use retrace_config::NumberedError;
use retrace_gcode::{Axis, ModalSnapshot, Parameters, Pose, Setup, StartTables, Tool, ToolTable};
use retrace_journal::state_file::FileAccess;
use retrace_journal::{CommandArguments, FileHash, JobStore, LatchedTables, MachineTables, plain_name, state_file};

use crate::args::Reading;
use crate::files;
use crate::files::unwritable;
use crate::table_files::{table, tools_without_length};

/// First parameter of the origin of coordinate system 1; those of the next follow at a distance of 20.
const FIRST_ORIGIN: usize = 5221;

/// Tables of this machine in the state folder, for those that the command line does not name. `None` for the simulated
/// card in this process with the built-in machine, and where the user has no state folder.
#[must_use]
pub fn of_machine(
    card: &str,
    machine: Option<&Path>,
    params: Option<&Path>,
    tools: Option<&Path>,
) -> Option<MachineTables> {
    let file = |ending: &str| Some(files::absolute(&own_file(card, machine, ending)?));
    Some(MachineTables {
        parameters: if params.is_none() { Some(file("var")?) } else { None },
        tools: if tools.is_none() { Some(file("tbl")?) } else { None },
        consumables: Some(file("consumables.json")?),
    })
}

/// File with the wear of the consumables of this machine, as for [`of_machine`].
#[must_use]
pub fn consumables_path(card: &str, machine: Option<&Path>) -> Option<PathBuf> {
    own_file(card, machine, "consumables.json")
}

/// File of this machine in the state folder with this ending.
fn own_file(card: &str, machine: Option<&Path>, ending: &str) -> Option<PathBuf> {
    let is_simulated = card == "sim";
    if is_simulated && machine.is_none() {
        return None;
    }
    let mut name = machine.map_or_else(
        || "built-in".to_owned(),
        |path| {
            let whole = path.canonicalize().unwrap_or_else(|_| path.to_owned());
            let hash = FileHash::of(whole.as_os_str().as_encoded_bytes()).low_32();
            format!("{}-{hash:08x}", plain_name(&whole.display().to_string()))
        },
    );
    // The simulated machine has its own position: offsets measured there do not apply to the real one.
    if is_simulated {
        name += "-simulated";
    }
    Some(JobStore::state_folder()?.join("machines").join(format!("{name}.{ending}")))
}

/// Reads the parameters of a machine's own file; the initial ones where it does not exist yet.
///
/// # Errors
/// It cannot be read or parsed.
pub fn parameters(path: &Path) -> Result<Parameters, NumberedError> {
    if path.exists() { table(path, "parameter file", Parameters::read) } else { Ok(Parameters::default()) }
}

/// Reads the tools of a machine's own table over those without a length; `false` where the table does not exist yet.
///
/// # Errors
/// It cannot be read or parsed.
pub fn tools(path: &Path) -> Result<(ToolTable, bool), NumberedError> {
    let mut tools = tools_without_length();
    if !path.exists() {
        return Ok((tools, false));
    }
    for tool in table(path, "tool table", ToolTable::read)?.tools() {
        tools.insert(*tool);
    }
    Ok((tools, true))
}

/// Files that offsets and tool data are written to.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TableFiles {
    /// Parameter file, if any.
    pub parameters: Option<PathBuf>,
    /// Tool table, if any.
    pub tools: Option<PathBuf>,
    /// Wear of the consumables, if it is counted.
    pub consumables: Option<PathBuf>,
    /// Whether the parameter file is the machine's own.
    parameters_are_own: bool,
    /// Whether the tool table is the machine's own.
    tools_are_own: bool,
}

impl TableFiles {
    /// Files that a program is read with.
    #[must_use]
    pub fn of(reading: &Reading) -> Self {
        Self::choose(reading.params.as_deref(), reading.tools.as_deref(), reading.machine_tables.as_ref())
    }

    /// Files that a job was read with.
    #[must_use]
    pub fn of_job(arguments: &CommandArguments) -> Self {
        let path = |path: &Option<String>| path.as_ref().map(PathBuf::from);
        let (params, tools) = (path(&arguments.params), path(&arguments.tools));
        Self::choose(params.as_deref(), tools.as_deref(), arguments.machine_tables.as_ref())
    }

    /// Files on the command line, otherwise the machine's own.
    #[must_use]
    pub fn choose(params: Option<&Path>, tools: Option<&Path>, own: Option<&MachineTables>) -> Self {
        let own_file =
            |of: fn(&MachineTables) -> &Option<String>| own.and_then(|own| of(own).as_ref()).map(PathBuf::from);
        Self {
            parameters: params.map(Path::to_owned).or_else(|| own_file(|own| &own.parameters)),
            tools: tools.map(Path::to_owned).or_else(|| own_file(|own| &own.tools)),
            consumables: own_file(|own| &own.consumables),
            parameters_are_own: params.is_none(),
            tools_are_own: tools.is_none(),
        }
    }

    /// Whether the tool table is the machine's own, so that a program's changes are written to it.
    #[must_use]
    pub fn has_own_tools(&self) -> bool {
        self.tools_are_own
    }

    /// Reads the current content of the files.
    ///
    /// # Errors
    /// One cannot be read or parsed.
    pub fn read(&self) -> Result<StartTables, NumberedError> {
        let parameters = self.parameters.as_deref().map_or_else(|| Ok(Parameters::default()), parameters)?;
        let tools = match &self.tools {
            Some(path) if self.tools_are_own => tools(path)?.0,
            Some(path) => table(path, "tool table", ToolTable::read)?,
            None => tools_without_length(),
        };
        Ok(StartTables { parameters, tools, current_tool: 0, selected_tool: 0 })
    }

    /// Writes the parameters that differ between `began` and `ended`. A file on the command line is written in any
    /// case.
    ///
    /// # Errors
    /// It cannot be read, parsed or written; it is unchanged then.
    pub fn write_parameters(&self, began: &Parameters, ended: &Parameters) -> Result<(), NumberedError> {
        let Some(path) = &self.parameters else { return Ok(()) };
        let is_kept = |number: &usize| !self.parameters_are_own || Parameters::is_machine_offset(*number);
        let changed: Vec<usize> = Parameters::persistent_numbers()
            .filter(is_kept)
            .filter(|&number| began.get(number).to_bits() != ended.get(number).to_bits())
            .collect();
        if changed.is_empty() && self.parameters_are_own {
            return Ok(());
        }
        let mut now = parameters(path)?;
        for number in changed {
            now.set(number, ended.get(number));
        }
        write(path, now.write().as_bytes(), self.parameters_are_own)
    }

    /// Writes the tools that differ between `began` and `ended`; the other lines of the table stay unchanged.
    ///
    /// # Errors
    /// The table cannot be read or written; it is unchanged then.
    pub fn write_tools(&self, began: &ToolTable, ended: &ToolTable) -> Result<(), NumberedError> {
        let Some(path) = &self.tools else { return Ok(()) };
        let changed: Vec<Tool> = ended.tools().filter(|tool| began.get(tool.number) != Some(**tool)).copied().collect();
        if changed.is_empty() {
            return Ok(());
        }
        let text = match std::fs::read_to_string(path) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => String::new(),
            Err(error) => return Err(unwritable(&path.display().to_string(), &error)),
        };
        write(path, ToolTable::rewrite(&text, &changed).as_bytes(), self.tools_are_own)
    }
}

/// Writes manual settings at a screen to their files, whenever they change.
#[derive(Debug)]
pub struct TableKeeper {
    files: TableFiles,
    parameters: Parameters,
    tools: ToolTable,
}

impl TableKeeper {
    /// Keeper for a screen that starts with this setup.
    #[must_use]
    pub fn new(reading: &Reading, setup: &Setup) -> Self {
        let StartTables { parameters, tools, .. } = setup.start_tables();
        Self { files: TableFiles::of(reading), parameters, tools }
    }

    /// Writes what has changed since the last call.
    ///
    /// # Errors
    /// A file cannot be read or written; the next change tries again.
    pub fn write_changes(&mut self, carried: &ModalSnapshot) -> Result<(), NumberedError> {
        if self.parameters.persistent() != carried.parameters().persistent() {
            self.files.write_parameters(&self.parameters, carried.parameters())?;
            self.parameters = carried.parameters().clone();
        }
        if self.tools != *carried.tools() {
            self.files.write_tools(&self.tools, carried.tools())?;
            self.tools = carried.tools().clone();
        }
        Ok(())
    }

    /// Marks this state as written: a program left it, and writes it itself.
    pub fn mark_written(&mut self, carried: &ModalSnapshot) {
        (self.parameters, self.tools) = (carried.parameters().clone(), carried.tools().clone());
    }
}

/// Writes a table; one of the machine's own is private.
fn write(path: &Path, bytes: &[u8], is_own: bool) -> Result<(), NumberedError> {
    let folder = path.parent().filter(|_| is_own).map_or(Ok(()), state_file::create_private_folder);
    let access = if is_own { FileAccess::Private } else { FileAccess::Usual };
    folder
        .and_then(|()| state_file::replace(path, bytes, access))
        .map_err(|error| unwritable(&path.display().to_string(), &error))
}

/// Tables that a job starts with, for its journal.
#[must_use]
pub fn latched(tables: &StartTables) -> LatchedTables {
    LatchedTables {
        parameters: tables.parameters.write_all(),
        tools: tables.tools.write(),
        current_tool: tables.current_tool,
        selected_tool: tables.selected_tool,
    }
}

/// Tables from a journal.
///
/// # Errors
/// `E2205`: this version cannot parse them.
pub fn unlatched(latched: &LatchedTables) -> Result<StartTables, NumberedError> {
    let unknown = |what: &str| {
        let what = format!("the {what} in the journal cannot be parsed");
        NumberedError::new("E2205", what, "use the version of retrace that wrote the journal")
    };
    Ok(StartTables {
        parameters: Parameters::read(&latched.parameters).map_err(|_| unknown("parameters"))?,
        tools: ToolTable::read(&latched.tools).map_err(|_| unknown("tool data"))?,
        current_tool: latched.current_tool,
        selected_tool: latched.selected_tool,
    })
}

/// Differences between tables, one per line: `G54 Z: 3.000 in the job, 2.500 now`. Variables of programs are left out.
#[must_use]
pub fn differences(job: &StartTables, now: &StartTables) -> Vec<String> {
    let mut lines = Vec::new();
    for number in Parameters::persistent_numbers().filter(|&number| Parameters::is_machine_offset(number)) {
        let (was, is) = (job.parameters.get(number), now.parameters.get(number));
        if was.to_bits() != is.to_bits() {
            lines.push(format!("{}: {was:.4} in the job, {is:.4} now", parameter_name(number)));
        }
    }
    let numbers: std::collections::BTreeSet<u32> =
        job.tools.tools().chain(now.tools.tools()).map(|tool| tool.number).collect();
    for number in numbers {
        let (was, is) = (job.tools.get(number), now.tools.get(number));
        if was != is {
            lines.push(format!("tool {number}: {} in the job, {} now", tool_text(was), tool_text(is)));
        }
    }
    lines
}

/// Name of a parameter on the machine: `G54 X`, `G92 Z`, otherwise its number.
fn parameter_name(number: usize) -> String {
    let of = |name: &str, index: usize| match Axis::ALL.get(index) {
        Some(axis) => format!("{name} {}", char::from(axis.letter())),
        None => format!("{name} rotation"),
    };
    match number {
        5161..=5169 => of("G28", number - 5161),
        5181..=5189 => of("G30", number - 5181),
        5210 => "G92 in force".into(),
        5211..=5219 => of("G92", number - 5211),
        5220 => "coordinate system".into(),
        FIRST_ORIGIN.. => {
            let (system, index) = ((number - FIRST_ORIGIN) / 20, (number - FIRST_ORIGIN) % 20);
            let name = ["G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3"].get(system);
            name.filter(|_| index <= 9).map_or_else(|| format!("#{number}"), |name| of(name, index))
        }
        _ => format!("#{number}"),
    }
}

/// Text of a tool: `Z 12.500 D 6.000`.
fn tool_text(tool: Option<Tool>) -> String {
    let Some(tool) = tool else { return "not in the table".into() };
    let mut text = String::new();
    for axis in Axis::ALL.into_iter().filter(|&axis| tool.offset[axis] != Pose::ZERO[axis]) {
        // Writing to a string cannot fail.
        let _ = write!(text, "{} {:.4} ", char::from(axis.letter()), tool.offset[axis]);
    }
    if tool.diameter != 0.0 {
        let _ = write!(text, "D {:.4} ", tool.diameter);
    }
    if text.is_empty() { "no length".into() } else { text.trim_end().to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn latched_tables_come_back_to_the_bit() {
        let mut tables = StartTables {
            parameters: Parameters::default(),
            tools: tools_without_length(),
            current_tool: 2,
            selected_tool: 7,
        };
        for (number, value) in [(1, 0.1), (5070, 1.0), (5220, 2.0), (5221, 1.0 / 3.0), (5599, 0.0)] {
            tables.parameters.set(number, value);
        }
        tables.tools.insert(Tool { number: 2, pocket: 2, offset: Pose::xyz(0.0, 0.0, 0.1 + 0.2), ..Tool::default() });
        assert_eq!(unlatched(&latched(&tables)), Ok(tables));
    }

    #[test]
    fn differences_are_named_as_the_operator_knows_them() {
        let job = StartTables {
            parameters: Parameters::default(),
            tools: ToolTable::default(),
            current_tool: 0,
            selected_tool: 0,
        };
        let mut now = job.clone();
        for number in [5161, 5211, 5223, 5230, 5241, 100] {
            now.parameters.set(number, 2.5);
        }
        now.tools.insert(Tool { number: 4, offset: Pose::xyz(0.0, 0.0, 7.0), ..Tool::default() });
        let all = differences(&job, &now);
        assert_eq!(all.len(), 6, "{all:?}");
        let starts =
            ["G28 X: 0.0000 in the job, 2.5000 now", "G92 X", "G54 Z", "G54 rotation", "G55 X", "tool 4: not in"];
        for (line, start) in all.iter().zip(starts) {
            assert!(line.starts_with(start), "{line}");
        }
    }
}
