//! `retrace machine`: writes a commented machine file, checks one.
//!
//! Invariant: without a kind, the file describes the built-in machine; every key in it can be used.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, ErrorKind, Write as _};
use std::path::Path;

use retrace_config::{
    CodeClass, CodeSwitching, CutterConfig, CutterProof, CutterStart, InReverse, MachineCheck, MachineConfig,
    NumberedError, machine_file_schema,
};
use retrace_link::{CardIdentity, channel};
use serde_json::json;

use crate::command_failure::CommandFailure;
use crate::files::unwritable;
use crate::{args, escape, files, known_boards, linked_card};

/// The commented machine file of the built-in machine.
const COMMENTED: &str = include_str!("machine.toml");

/// Commented machine file of a kind of machine.
fn file(kind: Option<args::MachineKind>) -> &'static str {
    match kind {
        None => COMMENTED,
        Some(args::MachineKind::Waterjet) => include_str!("machine/waterjet.toml"),
        Some(args::MachineKind::Plasma) => include_str!("machine/plasma.toml"),
        Some(args::MachineKind::Laser) => include_str!("machine/laser.toml"),
        Some(args::MachineKind::Router) => include_str!("machine/router.toml"),
        Some(args::MachineKind::Lathe) => include_str!("machine/lathe.toml"),
    }
}

/// Runs the command.
///
/// # Errors
/// The file cannot be read or written, or the card does not answer.
pub fn run(args: &args::Machine) -> Result<u8, CommandFailure> {
    match args {
        args::Machine::New { kind, of_kind, board, output } => {
            let template = file(kind.or(*of_kind));
            let board = board.as_deref().and_then(|board| Some((board, known_boards::identity(board)?)));
            let text = board.map_or(template.into(), |(board, identity)| with_board(template, board, &identity));
            write_or_print(&text, output.as_deref())?;
            if let Some((board, identity)) = board {
                misfits_of_board(&text, board, &identity).into_iter().for_each(|it| print_finding("warning", it));
            }
            if let Some(path) = output {
                let of_board = board.map_or(String::new(), |(board, _)| format!(" --card {board}"));
                say!("check it with: retrace machine check {}{of_board}", path.display());
            }
        }
        args::Machine::Schema { output } => {
            let schema = serde_json::to_string_pretty(&machine_file_schema()).expect("a JSON value can be written");
            write_or_print(&schema, output.as_deref())?;
        }
        args::Machine::Check { file, card, json } => return check(file, card.as_deref(), *json),
    }
    Ok(0)
}

/// A template that begins with what a board has, and whose control period it supports.
fn with_board(template: &str, board: &str, identity: &CardIdentity) -> String {
    let [least_ms, most_ms] = [identity.min_period_us, identity.max_period_us].map(|us| f64::from(us) / 1000.0);
    let template = match template.split_once("control_period_ms = 1.0") {
        Some((before, behind)) if least_ms > 1.0 => format!("{before}control_period_ms = {least_ms:.1}{behind}"),
        _ => template.into(),
    };
    format!(
        "# Board: {board}. Its step outputs are the axes in the order of this file, at most {}, with up to {} pulses \
         a second\n# each, and control periods of {least_ms} to {most_ms} ms. It has the outputs 0 to {} and the \
         inputs 0 to {}.\n# Pins and wiring: docs/firmware.md\n{template}",
        identity.axes,
        identity.max_pulses_hz,
        identity.outputs.saturating_sub(1),
        identity.inputs.saturating_sub(1),
    )
}

/// What of a machine file a board does not support.
fn misfits_of_board(text: &str, board: &str, identity: &CardIdentity) -> Vec<NumberedError> {
    let misfits = |machine: MachineConfig| linked_card::misfits(identity, &machine);
    let all = MachineConfig::parse(text, board).map_or_else(|_| Vec::new(), misfits);
    let warning = |what| NumberedError::new("W2122", format!("{board}: {what}"), "change the file before it is used");
    all.into_iter().map(warning).collect()
}

/// Prints an error or a warning.
fn print_finding(kind: &str, finding: NumberedError) {
    let NumberedError { number, cause: what, remedy } = finding;
    eprintln!("{}", escape::name(&format!("{kind}[{number}]: {what}; help: {remedy}")));
}

/// Writes a new file, or prints the text if no file is named.
///
/// # Errors
/// `E2105`: it cannot be written, or exists.
pub fn write_or_print(text: &str, output: Option<&Path>) -> Result<(), NumberedError> {
    let Some(path) = output else {
        crate::out::line(text.trim_end());
        return Ok(());
    };
    let text = format!("{}\n", text.trim_end());
    create(path, &text).map_err(|error| unwritable(&path.display().to_string(), &error))?;
    say!("{} written", path.display());
    Ok(())
}

/// Checks a machine file, by itself and against the card at a port. Prints one line per finding.
///
/// # Errors
/// The file cannot be read, or the card does not answer.
fn check(path: &Path, card: Option<&str>, json: bool) -> Result<u8, CommandFailure> {
    let name = path.display().to_string();
    let MachineCheck { mut errors, machine } = MachineConfig::check_machine(&files::written_machine_text(path)?, &name);
    let machine = machine.and_then(|machine| match files::with_materials(machine, path) {
        Ok(machine) => Some(machine),
        Err(refusal) => {
            errors.push(refusal);
            None
        }
    });
    let mut warnings = machine.as_ref().map_or_else(Vec::new, |machine| warnings(machine, &name));
    if let (Some(address), Some(machine)) = (card.filter(|&card| card != "sim"), &machine) {
        let identity = match known_boards::identity(address) {
            Some(identity) => Some(identity),
            None => linked_card::find::<{ linked_card::MAX_AXES }>(address)?.greeting().map(|of| of.identity),
        };
        let misfits = identity.map(|identity| linked_card::misfits(&identity, machine)).unwrap_or_default();
        let refusal =
            |what| NumberedError::new("E3008", format!("{name}, {address}: {what}"), linked_card::MISFIT_REMEDY);
        errors.extend(misfits.into_iter().map(refusal));
    }
    let code = if errors.is_empty() { 0 } else { 2 };
    if json {
        let each = |all: &[NumberedError]| -> Vec<_> {
            all.iter().map(|one| json!({ "number": one.number, "cause": one.cause, "remedy": one.remedy })).collect()
        };
        crate::out::line(json!({
            "event": "machine_check",
            "file": name,
            "errors": each(&errors),
            "warnings": each(&warnings),
        }));
        return Ok(code);
    }
    let found = [(errors.len(), "error"), (warnings.len(), "warning")];
    errors.drain(..).for_each(|error| print_finding("error", error));
    warnings.drain(..).for_each(|warning| print_finding("warning", warning));
    if let Some(machine) = &machine {
        crate::out::line(described(machine));
    }
    let counted = found.iter().filter(|(count, _)| *count > 0);
    let counted: Vec<String> =
        counted.map(|(count, what)| format!("{count} {what}{}", if *count == 1 { "" } else { "s" })).collect();
    if !counted.is_empty() {
        eprintln!("{}: {}", escape::name(&name), counted.join(", "));
    }
    Ok(code)
}

/// Settings of a machine that may be mistakes.
fn warnings(machine: &MachineConfig, name: &str) -> Vec<NumberedError> {
    let undeclared = machine.undeclared_inputs().into_iter().map(|(input, what)| {
        let what = format!("{name}: {what} waits for input {input}, which no [[card.input]] declares");
        NumberedError::new(
            "W2115",
            what,
            format!("declare it: [[card.input]] with number = {input} and use = \"plain\""),
        )
    });
    let most = machine.card.max_pulses_hz();
    let too_fast = machine.axes.iter().filter_map(|axis| {
        let pulses = axis.pulses_per_mm * axis.max_velocity_mm_per_s;
        (pulses > most).then(|| {
            let axis = axis.name;
            let what = format!(
                "{name}: axis {axis} needs up to {pulses:.0} pulses per second; step_pulse_us permits {most:.0}"
            );
            NumberedError::new(
                "W2116",
                what,
                "set a lower max_velocity_mm_per_s, fewer pulses_per_mm or a shorter card.step_pulse_us",
            )
        })
    });
    let doubtful = machine.cutters_of_doubtful_kind().into_iter().map(|(cutter, why)| {
        let what = format!("{name}: [[cutter]] {}: {why}", cutter.name);
        let remedy = "a spindle keeps turning in a hold and at a program stop, a torch, a jet and a beam go off: \
            correct the kind, or the name";
        NumberedError::new("W2119", what, remedy)
    });
    undeclared.chain(too_fast).chain(doubtful).collect()
}

/// Creates a file with this text, completely or not at all, and never over an existing one.
fn create(path: &Path, text: &str) -> io::Result<()> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let draft = path.with_file_name(format!(".{name}.{}", std::process::id()));
    let written = File::options().write(true).create_new(true).open(&draft).and_then(|mut file| {
        file.write_all(text.as_bytes())?;
        file.sync_all()
    });
    let placed = written.and_then(|()| match std::fs::hard_link(&draft, path) {
        // Not every file system has links.
        Err(error) if error.kind() != ErrorKind::AlreadyExists && !path.exists() => std::fs::rename(&draft, path),
        placed => placed,
    });
    // The file no longer exists where it was renamed.
    let _ = std::fs::remove_file(&draft);
    placed
}

/// Summary of a machine, in a few lines.
fn described(machine: &MachineConfig) -> String {
    let mut text = format!(
        "machine `{}`: T = {} ms, path velocity {} mm/s, stops within {:.3} s of a hold, within {:.3} s on a straight \
            run",
        machine.name,
        f64::from(machine.period_us) / 1000.0,
        machine.path_velocity_mm_s,
        f64::from(machine.stopping.periods) * machine.period_s(),
        f64::from(machine.stopping.straight_periods) * machine.period_s(),
    );
    for (axis, home) in machine.axes.iter().zip(&machine.setting_up.homes) {
        let [low, high] = axis.travel_mm;
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "\n  {}: {} pulses/mm, {} mm/s, {} mm/s², {} mm/s³, travel {low} … {high} mm, jog {} mm/s",
            axis.name.to_ascii_uppercase(),
            axis.pulses_per_mm,
            axis.max_velocity_mm_per_s,
            axis.max_acceleration_mm_per_s2,
            axis.max_jerk_mm_per_s3,
            axis.jog_mm_s(),
        );
        if axis.backlash_mm > 0.0 {
            let _ = write!(text, ", backlash {} mm", axis.backlash_mm);
        }
        if let Some(home) = home {
            let end = if home.upper { "upper" } else { "lower" };
            let _ = write!(
                text,
                "\n     home: {end} switch, opens at {} mm; search {} mm/s, latch {} mm/s",
                home.position_mm, home.search_mm_per_s, home.latch_mm_per_s
            );
        }
    }
    text += &described_setting_up(machine);
    for cutter in &machine.cutters {
        let _ = write!(text, "\n  {}: {}", cutter.name, described_cutter(cutter));
    }
    for (code, switching) in machine.switching.defined_codes() {
        let _ = write!(text, "\n  {code}: {}", described_code(switching, machine.period_s()));
    }
    text
}

/// Text of a cutter.
fn described_cutter(cutter: &CutterConfig) -> String {
    let kind = format!("{:?}", cutter.kind).to_lowercase();
    let fire = match cutter.fire {
        channel::SPINDLE => "M3's output".to_owned(),
        fire => format!("output {fire}"),
    };
    let retrace = if cutter.retrace_cut { "; may be on while the path is retraced" } else { "" };
    if !cutter.kind.cuts_at_rest() {
        return format!("{kind} on {fire}");
    }
    let power = match cutter.power {
        Some(power) => format!("; its power is S, with M4 by the speed, at least {} %", power.least_percent),
        None => String::new(),
    };
    let CutterStart { start_s, starts, pierce_s, .. } = cutter.start;
    let started = match cutter.proof {
        Some(CutterProof { input, lost_ms, .. }) => {
            format!("; {starts} starts of {start_s} s, until input {input} is active; lost {lost_ms} ms without it")
        }
        None => "; its loss is not watched".to_owned(),
    };
    let standing = format!("off {} ms after the machine comes to rest{retrace}", cutter.standing_ms);
    format!("{kind} on {fire}, {standing}{started}; pierce {pierce_s} s{power}")
}

/// Text about homing and the safe direction.
fn described_setting_up(machine: &MachineConfig) -> String {
    let order: Vec<String> = machine.homing_order().iter().map(|axis| axis.to_ascii_uppercase().to_string()).collect();
    let mut text = match (machine.needs_homing().is_empty(), order.is_empty()) {
        (true, true) => "\n  homing not required".into(),
        (true, false) => format!("\n  homing not required; homing order {}", order.join(", ")),
        (false, _) if machine.setting_up.allow_unhomed => {
            format!("\n  homing order {}; a program may move it unhomed", order.join(", "))
        }
        (false, _) => format!("\n  homing order {}; no program moves it before homing", order.join(", ")),
    };
    if let Some(axis) = machine.tool_axis().and_then(|tool| machine.axes.get(tool)) {
        let _ = write!(text, "\n  tool axis {}", axis.name.to_ascii_uppercase());
        if let Some(retract) = machine.setting_up.retract_mm {
            let _ = write!(text, ", retracted at {retract} mm");
        }
    }
    text
}

/// Text about the execution of a code.
fn described_code(switching: CodeSwitching, period_s: f64) -> String {
    let mut text = match switching.class {
        CodeClass::Synchronous => "synchronous, without a stop".to_owned(),
        CodeClass::Exclusive => format!("at rest, {} s", f64::from(switching.periods) * period_s),
    };
    if let Some(until) = switching.until {
        let state = if until.active { "active" } else { "inactive" };
        let _ = write!(text, ", until input {} is {state}", until.input);
        if until.timeout_periods > 0 {
            let _ = write!(text, ", at most {} s", f64::from(until.timeout_periods) * period_s);
        }
    }
    text + match switching.in_reverse {
        InReverse::Unchanged => "; unchanged in reverse",
        InReverse::Undone => "; undone in reverse where outputs are replayed",
        InReverse::Barrier => "; retrace barrier",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::MachineKind;

    #[test]
    fn the_commented_file_is_the_built_in_machine() {
        let written = MachineConfig::parse(COMMENTED, "commented").expect("valid");
        let built_in = MachineConfig::built_in().expect("valid");
        assert_eq!(format!("{written:?}"), format!("{built_in:?}"));
        let text = described(&built_in);
        assert!(
            text.contains("stops within 0.39")
                && text.contains("within 0.151 s on a straight")
                && text.contains("X: 1000 pulses/mm"),
            "{text}"
        );
    }

    const KINDS: [MachineKind; 5] =
        [MachineKind::Waterjet, MachineKind::Plasma, MachineKind::Laser, MachineKind::Router, MachineKind::Lathe];

    /// Every key in a comment can be used.
    #[test]
    fn what_is_commented_out_can_be_put_in() {
        for kind in KINDS.map(Some).into_iter().chain([None]) {
            let mut all = String::new();
            for line in file(kind).lines() {
                let key = line.strip_prefix("# ").filter(|key| key.starts_with('[') || key.contains(" = "));
                all += key.unwrap_or(line);
                all.push('\n');
            }
            if kind.is_none() {
                // The axis with a `home` requires the others to have one, or `homed = true`, as here.
                all += "[[card.input]]\nnumber = 9\nuse = \"home\"\naxis = \"x\"\n";
            }
            MachineConfig::parse(&all, "all").expect("valid");
        }
    }

    /// A template fits a Pico as it is; for a board that has less, a warning names each misfit with its figures.
    #[test]
    fn a_template_for_a_board_names_what_the_board_lacks() {
        let pico = known_boards::identity("pico").expect("known");
        let small = CardIdentity { outputs: 2, max_pulses_hz: 20_000, ..pico };
        for kind in KINDS.map(Some).into_iter().chain([None]) {
            let text = with_board(file(kind), "pico", &pico);
            assert!(text.starts_with("# Board: pico. ") && text.contains("inputs 0 to 5"), "{text}");
            assert_eq!(misfits_of_board(&text, "pico", &pico), [], "{kind:?}");
            let misfits = misfits_of_board(&text, "small", &small);
            assert!(misfits.iter().any(|it| it.cause.contains("the card supports 20000")), "{kind:?}: {misfits:?}");
        }
        let waterjet = misfits_of_board(file(Some(MachineKind::Waterjet)), "small", &small);
        assert!(
            waterjet.iter().any(|it| it.number == "W2122" && it.cause.contains("the card has 2 outputs")),
            "{waterjet:?}"
        );
    }

    /// A spindle's encoder takes the first inputs of a Pico, up to a rate of its counts.
    #[test]
    fn an_encoder_fits_a_pico_whose_inputs_are_free() {
        let pico = known_boards::identity("pico").expect("known");
        let misfits_of = |input: u8, used_for: &str, counts: u32| {
            let text = format!(
                "[[card.input]]\nnumber = {input}\nuse = \"{used_for}\"\n\
                 [spindle]\ncounts_per_turn = {counts}\nmax_rpm = 3000.0\n"
            );
            misfits_of_board(&text, "pico", &pico).into_iter().map(|it| it.cause).collect::<Vec<_>>()
        };
        let misfits = |input: u8, counts: u32| misfits_of(input, "emergency-stop", counts);
        assert_eq!(misfits(3, 5000), [""; 0]);
        assert_eq!(misfits_of(3, "plain", 5000), [""; 0]);
        let plain = misfits_of(0, "plain", 4000);
        assert!(plain.len() == 1 && plain[0].contains("input 0 is declared"), "{plain:?}");
        let taken = misfits(2, 4000);
        assert!(taken.len() == 1 && taken[0].contains("inputs 0 to 2 of the card are"), "{taken:?}");
        let fast = misfits(3, 5001);
        assert!(fast.len() == 1 && fast[0].contains("up to 250050 counts per second"), "{fast:?}");
        let f405 = known_boards::identity("f405").expect("known");
        let lathe = "[spindle]\ncounts_per_turn = 400\nmax_rpm = 3000.0\n";
        let without = misfits_of_board(lathe, "f405", &f405);
        assert!(without.iter().any(|it| it.cause.contains("reads no encoder")), "{without:?}");
    }

    #[test]
    fn every_kind_says_what_it_is_and_what_it_needs() {
        for kind in KINDS {
            let machine = MachineConfig::parse(file(Some(kind)), "kind").expect("valid");
            let text = described(&machine);
            let order = machine.needs_homing();
            assert!(order.len() == machine.axes.len() && text.contains("no program moves it before homing"), "{text}");
            let tool = machine.tool_axis().expect("it has one");
            assert_eq!(order[0], machine.axes[tool].name, "the tool first");
            assert!(text.contains("retracted at") && text.contains("home: upper switch"), "{text}");
            assert!((0..machine.axes.len()).all(|axis| machine.homing(axis).is_some()));
        }
        let plasma = described(&MachineConfig::parse(file(Some(MachineKind::Plasma)), "kind").expect("valid"));
        assert!(
            plasma.contains("3 starts of 5 s, until input 5 is active; lost 10 ms without it; pierce 0.4 s"),
            "{plasma}"
        );
    }
}
