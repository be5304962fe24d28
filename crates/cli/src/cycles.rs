//! `retrace cycles`: lists, checks and compiles the cycles that programs can call.
//!
//! Invariant: `check` and `show` write nothing; only the folder of compiled forms is ever written.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use retrace_config::{NumberedError, nearest};
use retrace_cycles::{Cycle, CycleLibrary, Folders, LibraryFinding, Origin, Severity, shipped_source};
use retrace_gcode::probing_cycles;

use crate::args::{self, CycleFolders, CyclesAction};
use crate::command_failure::CommandFailure;
use crate::files;

/// Runs the command.
///
/// # Errors
/// A folder or a cycle that does not exist, or sources with errors, which have been printed.
pub fn run(args: &args::Cycles) -> Result<(), CommandFailure> {
    let folders = NamedSource::of(&args.folders)?;
    match &args.action {
        None | Some(CyclesAction::List) => {
            let library = folders.library();
            say!("{}", table(&library).trim_end());
            show_findings(&library);
            Ok(())
        }
        Some(CyclesAction::Check) => {
            let library = CycleLibrary::open(Folders { compiled: None, ..folders.folders() });
            show_findings(&library);
            finish(&library, &format!("{} cycles, no errors", library.iter().count()))
        }
        Some(CyclesAction::Compile) => {
            let library = folders.library();
            show_findings(&library);
            let fresh = library.iter().filter(|(_, cycle)| cycle.is_from_cache()).count();
            let count = library.iter().count();
            let place = folders.compiled.as_deref().map_or("nowhere".into(), |path| path.display().to_string());
            finish(
                &library,
                &format!("{count} cycles: {} compiled now, {fresh} up to date, stored in {place}", count - fresh),
            )
        }
        Some(CyclesAction::Show { name }) => show(&folders, name),
    }
}

/// Cycles that a command can call: the built-in ones, and those of the folders on the command line or of the default
/// folders.
///
/// # Errors
/// A folder on the command line is not a folder.
pub fn library(folders: &CycleFolders) -> Result<CycleLibrary, NumberedError> {
    Ok(NamedSource::of(folders)?.library())
}

/// Folders of sources and of compiled forms.
struct NamedSource {
    sources: Option<PathBuf>,
    compiled: Option<PathBuf>,
}

impl NamedSource {
    /// Folders on the command line, otherwise the user's own; a missing one is an error only where it is on the command
    /// line.
    fn of(named: &CycleFolders) -> Result<Self, NumberedError> {
        if let Some(path) = &named.cycles
            && !path.is_dir()
        {
            let message = format!("the folder {} does not exist", path.display());
            return Err(NumberedError::new("E2101", message, "check the path of the folder with the cycles"));
        }
        let usual =
            |variable: &str, in_home: &str| usual(std::env::var_os(variable), std::env::var_os("HOME"), in_home);
        Ok(Self {
            sources: named.cycles.clone().or_else(|| usual("XDG_CONFIG_HOME", ".config")),
            compiled: named.compiled.clone().or_else(|| usual("XDG_CACHE_HOME", ".cache")),
        })
    }

    fn folders(&self) -> Folders<'_> {
        Folders { sources: self.sources.as_deref(), compiled: self.compiled.as_deref() }
    }

    fn library(&self) -> CycleLibrary {
        CycleLibrary::open(self.folders())
    }
}

/// Default folder for cycles: below the folder in the variable, otherwise below this folder in the home folder. A
/// relative path in the variable is ignored, as the XDG base directory specification requires.
fn usual(base: Option<OsString>, home: Option<OsString>, in_home: &str) -> Option<PathBuf> {
    let base = base.map(PathBuf::from).filter(|path| path.is_absolute());
    let home = home.map(PathBuf::from).filter(|path| path.is_absolute());
    Some(base.or_else(|| Some(home?.join(in_home)))?.join("retrace").join("cycles"))
}

fn show(folders: &NamedSource, name: &str) -> Result<(), CommandFailure> {
    let library = CycleLibrary::open(Folders { compiled: None, ..folders.folders() });
    if let Some((_, text)) = probing_cycles().iter().find(|(known, _)| known.eq_ignore_ascii_case(name)) {
        say!("{}", text.trim_end());
        return Ok(());
    }
    let Some(cycle) = library.find(name).and_then(|id| library.get(id)) else {
        let known: Vec<&str> = library.iter().map(|(_, cycle)| cycle.name()).collect();
        let remedy = match nearest(&name.to_ascii_uppercase(), known.iter().copied()) {
            Some(near) => format!("did you mean {near}? `retrace cycles` lists all cycles"),
            None => {
                "`retrace cycles` lists all cycles; `retrace cycles check` prints the errors of the others".to_owned()
            }
        };
        return Err(NumberedError::new("E1931", format!("no callable cycle has the name {name}"), remedy).into());
    };
    let text = match cycle.origin() {
        Origin::Shipped => shipped_source(cycle.name()).unwrap_or_default().to_owned(),
        Origin::User => files::text(cycle.source(), "cycle source")?,
    };
    say!("{}", text.trim_end());
    Ok(())
}

/// Prints the summary, or fails where sources have errors.
fn finish(library: &CycleLibrary, well: &str) -> Result<(), CommandFailure> {
    if library.findings().iter().any(|finding| finding.diagnostic.severity() == Severity::Error) {
        return Err(CommandFailure::Program);
    }
    say!("{well}");
    Ok(())
}

/// Table with one cycle per row.
fn table(library: &CycleLibrary) -> String {
    let from = |cycle: &Cycle| match cycle.origin() {
        Origin::Shipped => "shipped".to_owned(),
        Origin::User => cycle.source().display().to_string(),
    };
    let widest = |widths: &mut dyn Iterator<Item = usize>| widths.max().unwrap_or(0);
    let name_width = widest(&mut library.iter().map(|(_, cycle)| cycle.name().len())).max(4);
    let from_width = widest(&mut library.iter().map(|(_, cycle)| from(cycle).chars().count())).max(4);
    let mut text = format!("{:name_width$}  kind  {:from_width$}  form          parameters\n", "name", "from");
    for (_, cycle) in library.iter() {
        let form = if cycle.is_from_cache() { "up to date" } else { "compiled now" };
        let parameters: Vec<String> =
            cycle.parameters().iter().map(|p| format!("{} {}", p.value_type, p.name)).collect();
        let (name, kind, parameters) = (cycle.name(), cycle.kind().number(), parameters.join(", "));
        let row = format!("{name:name_width$}  {kind:<4}  {:from_width$}  {form:<12}  {parameters}", from(cycle));
        text += row.trim_end();
        text.push('\n');
    }
    let probing: Vec<&str> = probing_cycles().iter().map(|(name, _)| *name).collect();
    text + "kinds: 1 no parameters · 2 parameters · 3 a contour among them\nprobing cycles, called as O<NAME> call: "
        + &probing.join(", ")
}

/// Prints every finding with its source line and a mark, on standard error.
fn show_findings(library: &CycleLibrary) {
    for finding in library.findings() {
        eprintln!("{}", rendered(finding, source_line(&finding.source, finding.diagnostic.line).as_deref()));
    }
}

fn source_line(path: &Path, line: u32) -> Option<String> {
    let text = std::fs::read(path).ok()?;
    let bytes = text.split(|byte| *byte == b'\n').nth((line as usize).checked_sub(1)?)?;
    Some(String::from_utf8_lossy(bytes).trim_end_matches('\r').to_owned())
}

/// Formats a finding as program errors are formatted: number, message, location, line, mark, help.
fn rendered(finding: &LibraryFinding, line: Option<&str>) -> String {
    let LibraryFinding { source, diagnostic } = finding;
    let level = if diagnostic.severity() == Severity::Error { "error" } else { "warning" };
    let mut text = format!("{level}[{}]: {}\n --> {}", diagnostic.number(), diagnostic.message, source.display());
    let margin = " ".repeat(diagnostic.line.to_string().len());
    if diagnostic.line > 0 {
        text += &format!(":{}:{}", diagnostic.line, diagnostic.column());
    }
    if let Some(line) = line.filter(|line| line.is_char_boundary(diagnostic.start as usize)) {
        // Columns count bytes; the mark is placed by characters.
        let before: String =
            line[..diagnostic.start as usize].chars().map(|c| if c == '\t' { c } else { ' ' }).collect();
        let marked =
            line.get(diagnostic.start as usize..diagnostic.end as usize).map_or(0, |part| part.chars().count());
        let mark = "^".repeat(marked.max(1));
        text += &format!("\n{margin} |\n{} | {line}\n{margin} | {before}{mark}", diagnostic.line);
    }
    text + &format!("\n{margin} = help: {}", diagnostic.help())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_finding_shows_its_line_and_a_mark_below_what_is_meant() {
        let library = CycleLibrary::of_sources(&[("TEST", "R1=1\n\tR2=R1+WRONG")]);
        let shown = rendered(&library.findings()[0], Some("\tR2=R1+WRONG"));
        let expected = "error[E1906]: WRONG is neither a variable nor a function\n --> TEST:2:8\n  |\n2 | \
            \tR2=R1+WRONG\n  | \t      ^^^^^\n  = help: ";
        assert!(shown.starts_with(expected), "{shown}");
    }

    #[test]
    fn the_usual_folders_are_those_of_the_desktop() {
        let os = |text: &str| Some(OsString::from(text));
        let at = |base, home| usual(base, home, ".config").map(|path| path.display().to_string());
        assert_eq!(at(os("/x"), os("/h")).as_deref(), Some("/x/retrace/cycles"));
        assert_eq!(at(os("x"), os("/h")).as_deref(), Some("/h/.config/retrace/cycles"));
        assert_eq!(at(os(""), os("/h")).as_deref(), Some("/h/.config/retrace/cycles"));
        assert_eq!(at(None, None), None);
    }

    #[test]
    fn the_table_has_a_row_for_each_cycle() {
        let text = table(&CycleLibrary::shipped());
        assert!(text.contains("CYCLE81  2     shipped  compiled now  REAL RTP, REAL RFP, REAL SDIS"), "{text}");
        assert!(text.contains("CYCLE95  3     shipped") && text.lines().count() == 15, "{text}");
        assert!(text.lines().last().is_some_and(|line| line.contains("probe_bore, probe_boss")), "{text}");
    }
}
