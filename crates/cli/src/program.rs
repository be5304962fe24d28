//! Program that the command line names: reads it, checks it, and decodes it.
//!
//! Invariant: a file is read once, so that what was checked is what runs. A stream cannot be read twice: it is checked
//! block by block as it runs.

use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use retrace_config::{MachineConfig, NumberedError, SerialSettings};
use retrace_controller::{BlockDecoder, ContourList, DecodedBlock, SourceStatus, interpreter_setup};
use retrace_gcode::cycles::CycleLibrary;
use retrace_gcode::{
    Answers, Ini, Material, Parameters, Prescan, Progress, Setup, Severity, StartTables, ToolTable, shipped_subprograms,
};
use retrace_journal::{FileHash, FileRole, ReadFile};

use crate::args::Reading;
use crate::check_progress::CheckProgress;
use crate::cycles;
use crate::decoder::{Decoder, Source};
use crate::files;
use crate::machine_tables;
use crate::program_stream::StreamBroken;
use crate::program_stream::{ProgramStream, StreamOpening, StreamSource};
use crate::run_outputs::{LastStatus, RunOutputs};
use crate::serial_source;
use crate::socket;
use crate::subprogram_folders::Folders;
use crate::table_files::{table, tools_without_length};

/// Maximum number of bytes of a program that are shown.
const MAX_SHOWN: usize = 32 << 20;

/// A program with everything that it is read with.
#[derive(Clone, Debug)]
pub struct Program {
    name: String,
    /// Pre-scan with the text; `None` for a stream.
    prescan: Option<Arc<Prescan>>,
    /// Source of a stream; `None` for a file.
    arrives: Option<StreamSource>,
    /// Files read besides the program and its subprograms.
    files: Vec<ReadFile>,
    /// Hash of a program whose text is not held in memory.
    hash: Option<FileHash>,
    folders: Arc<Folders>,
    setup: Setup,
    has_tool_table: bool,
    /// Whether the parameters are those of a file, or of programs before.
    has_parameters: bool,
    /// Whether a table has tool lengths.
    pub(crate) has_tool_lengths: bool,
    /// Settings for opening a stream.
    opening: StreamOpening,
    /// Maximum number of blocks in loops and calls that a check executes.
    max_loop_blocks: u64,
    /// Contours that the last check has found.
    contours: Arc<Mutex<Option<Arc<ContourList<9>>>>>,
}

impl Program {
    /// Opens the program on the command line, for a machine in millimetres.
    ///
    /// # Errors
    /// A file cannot be read or parsed.
    pub fn open(reading: &Reading, machine: &MachineConfig) -> Result<Self, NumberedError> {
        Self::open_from(reading, machine, StreamSource::named(&reading.program), None)
    }

    /// Opens a program that may arrive from a stream instead of the file on the command line. `latched` replaces the
    /// tables on the command line.
    ///
    /// # Errors
    /// A file cannot be read or parsed.
    pub fn open_from(
        reading: &Reading,
        machine: &MachineConfig,
        arrives: Option<StreamSource>,
        latched: Option<StartTables>,
    ) -> Result<Self, NumberedError> {
        let (mut program, notes) = Self::open_with_notes(reading, setup_for(machine), arrives, latched)?;
        notes.iter().for_each(|note| eprintln!("note: {note}"));
        program.opening.serial = machine.serial;
        program.files.extend(machine.materials.as_ref().map(|materials| ReadFile {
            role: FileRole::Materials,
            path: files::absolute(Path::new(&materials.path)),
            hash: FileHash::of(materials.text.as_bytes()),
        }));
        match &program.arrives {
            Some(StreamSource::Serial(address)) => _ = serial_source::parse(address, machine.serial)?,
            Some(StreamSource::Socket(address)) if socket::is_remote(address) => eprintln!(
                "warning: {} is on another computer: anyone who can send from there can move this machine",
                program.name
            ),
            _ => {}
        }
        Ok(program)
    }

    /// Opens the program on the command line for an interpreter with this setup. Tool table and parameters come from
    /// the command line where it names them.
    ///
    /// # Errors
    /// A file cannot be read or parsed.
    pub fn with_setup(reading: &Reading, setup: Setup) -> Result<Self, NumberedError> {
        let (program, notes) = Self::open_with_notes(reading, setup, StreamSource::named(&reading.program), None)?;
        notes.iter().for_each(|note| eprintln!("note: {note}"));
        Ok(program)
    }

    /// Opens a program and returns the notes to print about it.
    fn open_with_notes(
        reading: &Reading,
        mut setup: Setup,
        arrives: Option<StreamSource>,
        latched: Option<StartTables>,
    ) -> Result<(Self, Vec<String>), NumberedError> {
        let mut notes = Vec::new();
        let name = match &arrives {
            Some(StreamSource::StandardInput) => "standard input".into(),
            _ => reading.program.display().to_string(),
        };
        let mut files = Vec::new();
        let has_tool_table = reading.tools.is_some();
        let own_parameters = reading.machine_tables.as_ref().is_some_and(|tables| tables.parameters.is_some());
        let has_parameters = reading.params.is_some() || own_parameters || latched.is_some();
        let has_tool_lengths = match latched {
            Some(tables) => {
                setup = setup.with_start_tables(tables);
                true
            }
            None => read_tables(reading, &mut setup, &mut files)?,
        };
        let mut subs = reading.subs.clone();
        if let Some(path) = &reading.ini {
            let ini = table(path, "INI file", Ini::read)?;
            files.push(read(FileRole::Ini, path)?);
            if !ini.ignored.is_empty() {
                notes.push(format!("ignored in {}: {}", path.display(), ini.ignored.join(", ")));
                notes.push("a tool table and a parameter file are named with --tools and --params".to_owned());
            }
            if !ini.without_effect.is_empty() {
                let entries = ini.without_effect.join(", ");
                notes.push(format!("without effect in [RS274NGC] of {}: {entries}", path.display()));
            }
            setup.orient_offset_degrees = ini.orient_offset_degrees;
            setup.disable_fanuc_subs = ini.disable_fanuc_subs;
            if ini.disable_g92_persistence {
                setup.parameters.clear_g92();
            }
            setup.fixed_values.extend(ini.values);
            let beside = path.parent().unwrap_or(Path::new(""));
            subs.extend(ini.subroutine_path.iter().map(|folder| beside.join(folder)));
        }
        setup.block_delete = reading.block_delete;
        let cycles = cycles::library(&reading.cycle_folders)?;
        if cycles
            .findings()
            .iter()
            .any(|finding| finding.diagnostic.severity() == retrace_gcode::cycles::Severity::Error)
        {
            notes.push("cycle sources have errors and cannot be called; `retrace cycles check` shows them".to_owned());
        }
        files.extend(cycle_source_files(&cycles));
        setup.cycles = Some(Arc::new(cycles));
        let folders = Arc::new(Folders::of(&reading.program, &subs));
        setup.files = Some(Arc::clone(&folders) as _);
        let mut hash = None;
        let prescan = if arrives.is_some() {
            None
        } else if name.is_empty() {
            // The screen opens without a program.
            Some(Arc::new(Prescan::scan(&name, Vec::new().into(), &setup)))
        } else {
            let (text, of_program) = files::program(&reading.program)?;
            hash = of_program;
            Some(Arc::new(Prescan::scan(&name, text, &setup)))
        };
        let opening = StreamOpening {
            serial: SerialSettings::default(),
            is_cancelled: Arc::default(),
            status: Arc::new(SourceStatus::new(&name)),
        };
        let max_loop_blocks = reading.max_loop_blocks;
        let program = Self {
            name,
            prescan,
            arrives,
            files,
            hash,
            folders,
            setup,
            has_tool_table,
            has_parameters,
            has_tool_lengths,
            opening,
            max_loop_blocks,
            contours: Arc::default(),
        };
        Ok((program, notes))
    }

    /// Opens another program with the same tables, subprograms and cycles, for this setup; `reading` names it. Nothing
    /// is printed.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn load_other(&self, reading: &Reading, setup: Setup) -> Result<Self, NumberedError> {
        // Tools and parameters come from the setup.
        let without_tables = Reading { tools: None, params: None, machine_tables: None, ..reading.clone() };
        let (mut other, _) =
            Self::open_with_notes(&without_tables, setup, StreamSource::named(&reading.program), None)?;
        let tables = self
            .files
            .iter()
            .filter(|file| matches!(file.role, FileRole::Tools | FileRole::Parameters | FileRole::Materials));
        other.files.extend(tables.cloned());
        let Self { has_tool_table, has_parameters, has_tool_lengths, .. } = *self;
        other.opening.serial = self.opening.serial;
        Ok(Self { has_tool_table, has_parameters, has_tool_lengths, ..other })
    }

    /// Contours that the last check has found; `None` for a stream, and before a check.
    #[must_use]
    pub fn planned_contours(&self) -> Option<Arc<ContourList<9>>> {
        self.contours.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Retains the contours that a check has found.
    pub(crate) fn set_planned_contours(&self, contours: ContourList<9>) {
        *self.contours.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::new(contours));
    }

    /// Whether a program is loaded. The screen opens without one.
    #[must_use]
    pub fn is_loaded(&self) -> bool {
        !self.name.is_empty()
    }

    /// Reads the program again from its file, for this setup. Nothing is printed.
    ///
    /// # Errors
    /// The file can no longer be read.
    pub fn reopened(&self, setup: Setup) -> Result<Self, NumberedError> {
        // Subprograms are searched beside this program, and cycles are its own, not those of the one that the setup
        // belongs to.
        let setup = Setup { files: self.setup.files.clone(), cycles: self.setup.cycles.clone(), ..setup };
        let mut again = Self { setup, contours: Arc::default(), ..self.clone() };
        again.folders.forget();
        if self.prescan.is_some() && self.is_loaded() {
            let (text, hash) = files::program(Path::new(&self.name))?;
            again.hash = hash;
            again.prescan = Some(Arc::new(Prescan::scan(&self.name, text, &again.setup)));
        }
        Ok(again)
    }

    /// Setup of the interpreter.
    #[must_use]
    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// Every file that has been read so far.
    #[must_use]
    pub fn files_read(&self) -> Vec<ReadFile> {
        self.program_read().into_iter().chain(self.files.iter().cloned()).chain(self.folders.read()).collect()
    }

    /// File of the program itself, if it has one.
    fn program_read(&self) -> Option<ReadFile> {
        let prescan = self.prescan.as_ref().filter(|_| self.is_loaded())?;
        let hash = self.hash.or_else(|| prescan.held_text().map(FileHash::of))?;
        Some(ReadFile { role: FileRole::Program, path: files::absolute(Path::new(&self.name)), hash })
    }

    /// Source of a stream; `None` for a file.
    #[must_use]
    pub fn stream_source(&self) -> Option<&StreamSource> {
        self.arrives.as_ref()
    }

    /// Opens the stream; `None` for a file.
    ///
    /// # Errors
    /// See [`StreamSource::open`].
    pub fn open_stream(&self) -> Result<Option<ProgramStream>, NumberedError> {
        self.arrives.as_ref().map(|from| from.open(&self.opening)).transpose()
    }

    /// Status of the stream; `None` for a file.
    #[must_use]
    pub fn source_status(&self) -> Option<Arc<SourceStatus>> {
        self.arrives.as_ref().map(|_| Arc::clone(&self.opening.status))
    }

    /// Name of the program.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Text of the program, up to 32 MiB; empty for a stream.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = String::new();
        for line in self.prescan().into_iter().flat_map(Prescan::texts) {
            if text.len() > MAX_SHOWN {
                text += "; the rest of the program is not shown\n";
                break;
            }
            text += String::from_utf8_lossy(&line).trim_end_matches(['\n', '\r']);
            text.push('\n');
        }
        text
    }

    /// Tool table, if one was given.
    #[must_use]
    pub fn tool_table(&self) -> Option<&ToolTable> {
        self.has_tool_table.then_some(&self.setup.tools)
    }

    /// Number of lines, if it is a file.
    #[must_use]
    pub fn lines(&self) -> Option<u64> {
        self.prescan().map(Prescan::lines)
    }

    /// Decoder for a check from the beginning, limited to `max_loop_blocks` in loops and calls.
    #[must_use]
    pub fn decoder(&self) -> Decoder {
        self.decoder_of(self.checked_source(self.setup.clone()))
    }

    /// Decoder for a check by itself. Where no parameter file was given, the position of G30 is unknown.
    pub(crate) fn report_decoder(&self) -> Decoder {
        let mut setup = self.setup.clone();
        if !self.has_parameters {
            setup.parameters.forget_reference_point();
        }
        let progress = self.prescan.as_ref().and_then(|prescan| CheckProgress::of(prescan.lines()));
        Decoder { progress, ..self.decoder_of(self.checked_source(setup)) }
    }

    /// Interpreter for a check of the program from the beginning: the answers of the machine are unknown.
    fn checked_source(&self, setup: Setup) -> Source {
        match &self.prescan {
            Some(prescan) => Source::prescanned(Arc::clone(prescan), Setup { answers: Answers::Unknown, ..setup }),
            None => self.source(),
        }
    }

    fn decoder_of(&self, program: Source) -> Decoder {
        let given_up = self.prescan.is_none().then(|| Arc::clone(&self.opening.is_cancelled));
        let file = self.prescan.is_some().then(|| PathBuf::from(&self.name));
        Decoder {
            name: self.name.clone(),
            program,
            given_up,
            file,
            length_offset: false,
            end_is_reported: false,
            outputs: None,
            max_loop_blocks: Some(self.max_loop_blocks),
            is_at_end: false,
            progress: None,
        }
    }

    /// Materials that comments of the program add to the table or overwrite in it; `None` for a stream.
    pub(crate) fn declared_materials(&self) -> Option<Vec<Arc<Material>>> {
        self.prescan.as_ref()?;
        let (mut decoder, mut steps) = (self.decoder(), Vec::new());
        while decoder.next_block(&mut steps) != DecodedBlock::End {
            steps.clear();
        }
        Some(decoder.program.interpreter().state().cutting.declared_materials())
    }

    /// Decoder for a check at a terminal, with a progress bar.
    pub(crate) fn shown_decoder(&self) -> Decoder {
        let progress = self.prescan.as_ref().and_then(|prescan| CheckProgress::of(prescan.lines()));
        Decoder { progress, ..self.decoder() }
    }

    /// Decoder for a run from the beginning; it logs, and leaves its parameters. A stream is read from `input`.
    #[must_use]
    pub fn running(&self, input: Option<ProgramStream>) -> (Decoder, LastStatus) {
        let left = RunOutputs::default();
        let last = left.last_status();
        let program = input.map_or_else(|| self.source(), |input| Source::new(input, self.setup.clone()));
        (Decoder { outputs: Some(left), max_loop_blocks: None, ..self.decoder_of(program) }, last)
    }

    /// Whether the first `bytes` of this file reach the end of the program without an error. For a stream.
    #[must_use]
    pub fn reaches_end(&self, kept: &Path, bytes: u64) -> bool {
        let Ok(file) = std::fs::File::open(kept) else { return false };
        let mut source = self.interpret_stream(Box::new(BufReader::new(file).take(bytes)));
        let mut steps = Vec::new();
        loop {
            steps.clear();
            match source.advance(&mut steps) {
                Progress::Line => {}
                Progress::BlockError => return false,
                Progress::End => break,
            }
        }
        source.interpreter().diagnostics().iter().all(|found| found.severity() != Severity::Error)
    }

    /// Interpreter for the stored part of a stream, from the beginning.
    #[must_use]
    pub fn interpret_stream(&self, kept: ProgramStream) -> Source {
        match &self.prescan {
            Some(prescan) => Source::prescanned(Arc::clone(prescan), self.setup.clone()),
            None => Source::new(kept, self.setup.clone()),
        }
    }

    /// Interpreter for the program from the beginning, for its canonical functions.
    #[must_use]
    pub fn source(&self) -> Source {
        match &self.prescan {
            Some(prescan) => Source::prescanned(Arc::clone(prescan), self.setup.clone()),
            None => {
                let broken =
                    |why: NumberedError| -> ProgramStream { Box::new(BufReader::new(StreamBroken(why.cause))) };
                let input =
                    self.open_stream().map_or_else(broken, |input| input.unwrap_or_else(|| Box::new(io::empty())));
                Source::new(input, self.setup.clone())
            }
        }
    }

    /// Pre-scan; `None` for a stream.
    #[must_use]
    pub fn prescan(&self) -> Option<&Prescan> {
        self.prescan.as_deref()
    }
}

/// Reads the tables that a program starts with. Returns whether one of them has tool lengths.
fn read_tables(reading: &Reading, setup: &mut Setup, files: &mut Vec<ReadFile>) -> Result<bool, NumberedError> {
    let own = reading.machine_tables.clone().unwrap_or_default();
    let mut has_tool_lengths = true;
    if let Some(path) = &reading.tools {
        setup.tools = table(path, "tool table", ToolTable::read)?;
        files.push(read(FileRole::Tools, path)?);
    } else if let Some(path) = &own.tools {
        (setup.tools, has_tool_lengths) = machine_tables::tools(Path::new(path))?;
    } else {
        has_tool_lengths = false;
    }
    if let Some(path) = &reading.params {
        setup.parameters = table(path, "parameter file", Parameters::read)?;
        files.push(read(FileRole::Parameters, path)?);
    } else if let Some(path) = &own.parameters {
        setup.parameters = machine_tables::parameters(Path::new(path))?;
    }
    Ok(has_tool_lengths)
}

/// Sources of the cycles that can be called: each of the user's, and the built-in ones with the shipped subprograms.
fn cycle_source_files(library: &CycleLibrary) -> Vec<ReadFile> {
    let file = |path: String, number: u128| ReadFile {
        role: FileRole::Cycles,
        path,
        hash: FileHash::of(&number.to_le_bytes()),
    };
    let users = library.source_files().iter().map(|(path, number)| file(files::absolute(path), *number));
    let mut shipped = file(String::new(), CycleLibrary::shipped_identity());
    for text in shipped_subprograms() {
        shipped.hash = shipped.hash.extend(text.as_bytes());
    }
    std::iter::once(shipped).chain(users).collect()
}

/// A file that was read, with its hash.
fn read(role: FileRole, path: &Path) -> Result<ReadFile, NumberedError> {
    Ok(ReadFile { role, path: files::absolute(path), hash: files::hash(path, "file")? })
}

/// Setup of the interpreter for a machine in millimetres, at its position.
fn setup_for(machine: &MachineConfig) -> Setup {
    Setup { tools: tools_without_length(), ..interpreter_setup(machine) }
}
