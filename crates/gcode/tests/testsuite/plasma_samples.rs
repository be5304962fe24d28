//! The sample programs of QtPlasmaC, as this interpreter and as LinuxCNC's `rs274` execute them.
//!
//! Invariant: `rs274` knows neither the controller's values nor its materials, so they are taken out of the text for
//! it; the path does not depend on them.

use crate::cutting::setup;
use crate::not_run::not_run;
use retrace_gcode::{Canon, CanonStep, CanonText, CuttingSwitch, Program, Progress, ToolTable};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Where Debian's package installs them.
const SAMPLES: &str = "/usr/share/linuxcnc/ncfiles/plasmac";

/// Tools with offsets, so that a wrong tool moves the path.
const TOOLS: &str = "T0 P1 X0 Y0\nT1 P2 X12.5 Y-3.25\n";

/// Greatest distance between two coordinates that are equal: less than a count of any machine.
const EQUAL: f64 = 2e-4;

/// What `rs274` can read of a sample: without materials, values of the controller and numbers of cutters.
fn plain(text: &str) -> String {
    let lines = text.lines().filter(|line| !line.starts_with("M190") && !line.starts_with("M66"));
    let text = lines.collect::<Vec<_>>().join("\n") + "\n";
    let text = text.replace("#<_hal[plasmac.cut-feed-rate]>", "1000");
    ["$-1", "$0", "$1"].iter().fold(text, |text, word| text.replace(word, ""))
}

/// A move: its kind, and its end in X and Y. Moves of other axes alone are left out.
fn moves(functions: &str) -> Vec<(String, f64, f64)> {
    let mut moves: Vec<(String, f64, f64)> = Vec::new();
    for line in functions.lines() {
        let kinds = ["STRAIGHT_TRAVERSE(", "STRAIGHT_FEED(", "ARC_FEED("];
        let Some((kind, numbers)) = kinds.iter().find_map(|kind| Some((*kind, line.split_once(kind)?.1))) else {
            continue;
        };
        let mut numbers = numbers.split(',').map(|number| number.trim_end_matches(')').trim().parse::<f64>());
        let (Some(Ok(x)), Some(Ok(y))) = (numbers.next(), numbers.next()) else { continue };
        let stands = moves.last().is_some_and(|(_, last_x, last_y)| (*last_x, *last_y) == (x, y));
        if !stands || kind.starts_with("ARC") {
            moves.push((kind.to_owned(), x, y));
        }
    }
    moves
}

/// The path of a sample on a machine with materials, without its over cuts.
fn own_path(text: &str) -> Vec<(String, f64, f64)> {
    let setup = retrace_gcode::Setup {
        tools: ToolTable::read(TOOLS).expect("a tool table"),
        machine_units: retrace_gcode::LengthUnit::Inch,
        ..setup()
    };
    let mut program = Program::new(text.as_bytes(), setup);
    let (mut steps, mut shown): (Vec<CanonStep>, _) = (Vec::new(), CanonText::new(Vec::new()));
    while program.advance(&mut steps) != Progress::End {}
    let mut is_forbidden = false;
    for step in &steps {
        if let Canon::SetCutting(CuttingSwitch::Cutter, on) = step.canon {
            is_forbidden = !on;
        }
        if !is_forbidden {
            shown.write(step).expect("memory");
        }
    }
    moves(&String::from_utf8(shown.into_inner().expect("memory")).expect("text"))
}

fn peer_path(folder: &Path, text: &str) -> Option<Vec<(String, f64, f64)>> {
    std::fs::write(folder.join("program.ngc"), plain(text)).expect("a file for the peer");
    std::fs::write(folder.join("tools.tbl"), TOOLS).expect("a tool table for the peer");
    let mut command = Command::new("timeout");
    command.args(["20", "rs274", "-g", "-t", "tools.tbl", "program.ngc"]);
    command.env("HOME", folder).current_dir(folder).stdin(Stdio::null());
    let output = command.output().ok().filter(|output| output.status.code() != Some(127))?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
    Some(moves(&text))
}

#[test]
fn the_samples_of_qtplasmac_follow_the_path_of_rs274() {
    let listed = std::fs::read_dir(SAMPLES).into_iter().flatten();
    let mut samples: Vec<PathBuf> = listed.filter_map(|entry| Some(entry.ok()?.path())).collect();
    samples.sort();
    if samples.is_empty() {
        return not_run("the path of QtPlasmaC's samples", "Debian's linuxcnc-uspace is not installed");
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    for path in samples {
        let text = std::fs::read_to_string(&path).expect("a sample");
        let Some(theirs) = peer_path(folder.path(), &text) else {
            return not_run("the path of QtPlasmaC's samples", "rs274 is not installed");
        };
        let ours = own_path(&text);
        assert_eq!(ours.len(), theirs.len(), "{}", path.display());
        for (our, their) in ours.iter().zip(&theirs) {
            let near = |a: f64, b: f64| (a - b).abs() <= EQUAL;
            let same = our.0 == their.0 && near(our.1, their.1) && near(our.2, their.2);
            assert!(same, "{}: {our:?}, and {their:?} by rs274", path.display());
        }
        assert!(ours.len() >= 3, "{}", path.display());
    }
}
