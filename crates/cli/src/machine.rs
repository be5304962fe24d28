//! `retrace machine`: writes a commented machine file, checks one.
//!
//! Invariant: the file that is written describes the machine that is built in.

use retrace_controller::machine::Machine;
use retrace_controller::refusal::Refusal;

use crate::args;
use crate::console::unwritable;
use crate::files;

/// The commented machine file.
const COMMENTED: &str = include_str!("machine.toml");

/// Runs the command.
///
/// # Errors
/// What is wrong with the file.
pub fn run(args: &args::Machine) -> Result<(), Refusal> {
    match args {
        args::Machine::New { output: None } => crate::out::line(COMMENTED.trim_end()),
        args::Machine::New { output: Some(path) } => {
            let named = |error| unwritable(&path.display().to_string(), &error);
            // never over a file that somebody has made his own
            let mut file = std::fs::File::options().write(true).create_new(true).open(path).map_err(named)?;
            std::io::Write::write_all(&mut file, COMMENTED.as_bytes()).map_err(named)?;
            say!("{} written", path.display());
        }
        args::Machine::Check { file } => crate::out::line(described(&files::machine(Some(file))?)),
    }
    Ok(())
}

/// A machine in a few lines.
fn described(machine: &Machine) -> String {
    let mut text = format!(
        "machine `{}`: T = {} ms, path velocity {} mm/s, at rest within {:.3} s of a hold, within {:.3} s on a straight run",
        machine.name,
        f64::from(machine.period_us) / 1000.0,
        machine.path_velocity_mm_s,
        f64::from(machine.stopping.periods) * machine.period_s(),
        f64::from(machine.stopping.straight_periods) * machine.period_s(),
    );
    for axis in &machine.axes {
        let [low, high] = axis.travel_mm;
        text += &format!(
            "\n  {}: {} pulses/mm, {} mm/s, {} mm/s², {} mm/s³, travel {low} … {high} mm",
            axis.name.to_ascii_uppercase(),
            axis.pulses_per_mm,
            axis.max_velocity_mm_per_s,
            axis.max_acceleration_mm_per_s2,
            axis.max_jerk_mm_per_s3,
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_commented_file_is_the_built_in_machine() {
        let written = Machine::parse(COMMENTED, "commented").expect("valid");
        let built_in = Machine::built_in().expect("valid");
        assert_eq!(format!("{written:?}"), format!("{built_in:?}"));
        let text = described(&built_in);
        assert!(
            text.contains("at rest within 0.39")
                && text.contains("within 0.151 s on a straight")
                && text.contains("X: 1000 pulses/mm"),
            "{text}"
        );
    }

    /// Each key that is shown in a comment is one that can be used.
    #[test]
    fn what_is_commented_out_can_be_put_in() {
        let lines = COMMENTED.lines().map(|line| match line.strip_prefix("# ") {
            Some(key) if key.starts_with('[') || key.contains(" = ") => key,
            _ => line,
        });
        let all: Vec<&str> = lines.collect();
        Machine::parse(&all.join("\n"), "all").expect("valid");
    }
}
