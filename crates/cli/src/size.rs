//! `retrace size`: calculates the size of the ring (REV-4).
//!
//! Invariant: the formula's value is printed as REV-4 gives it; the size for the machine file is what the ring really
//! needs.

use retrace_config::{MachineConfig, NumberedError};
use retrace_core::{Record, size};

use crate::args;

/// Runs the command.
///
/// # Errors
/// `E2131` where the numbers give no size.
pub fn run(args: &args::Size) -> Result<(), NumberedError> {
    let positive = |x: f64| x.is_finite() && x > 0.0 && x < 1e9;
    if !positive(args.hours) || !positive(args.period_ms) || args.axes == 0 || args.bytes == 0 {
        return Err(NumberedError::new("E2131", "these numbers give no ring size", "use numbers above zero"));
    }
    let history_ms = (args.hours * 3_600_000.0).round() as u64;
    let period_us = (args.period_ms * 1000.0).round() as u64;
    let bytes = size::history_bytes(args.bytes, args.axes, history_ms, period_us).ok_or_else(|| {
        NumberedError::new("E2131", "a ring of this size exceeds any memory", "use fewer hours or a longer period")
    })?;
    say!(
        "L = n·a·(h·3600·1000)/T = {}·{}·({}·3600·1000)/{} = {} bytes ({:.2} MiB)",
        args.bytes,
        args.axes,
        args.hours,
        args.period_ms,
        grouped(bytes),
        bytes as f64 / 1_048_576.0
    );
    let machine = crate::files::machine(args.machine_file.path())?;
    crate::out::line(of_machine(&machine));
    Ok(())
}

/// Text about the ring of a machine.
fn of_machine(machine: &MachineConfig) -> String {
    let record = match machine.axes.len() {
        0..=4 => size_of::<Record<4>>(),
        5..=6 => size_of::<Record<6>>(),
        _ => size_of::<Record<9>>(),
    } as u64;
    let kept = u64::from(machine.history_records);
    let cells = size::ring_cells(machine.history_records, machine.look_ahead_records).map_or(0, u64::from);
    format!(
        "machine `{}`: {} axes, T = {} ms: {} records of {record} bytes kept ({:.3} h, {:.1} MiB) and {} of \
            look-ahead;\n\
         the ring has {} cells, {:.1} MiB",
        machine.name,
        machine.axes.len(),
        f64::from(machine.period_us) / 1000.0,
        grouped(kept),
        kept as f64 * machine.period_s() / 3600.0,
        (kept * record) as f64 / 1_048_576.0,
        grouped(u64::from(machine.look_ahead_records)),
        grouped(cells),
        (cells * record) as f64 / 1_048_576.0,
    )
}

/// Formats a number with separated thousands.
fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (k, digit) in digits.chars().enumerate() {
        if k > 0 && (digits.len() - k).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thousands_are_apart() {
        assert_eq!((grouped(0), grouped(999), grouped(4_320_000)), ("0".into(), "999".into(), "4 320 000".into()));
    }

    #[test]
    fn the_built_in_machine_takes_27_and_a_half_mib() {
        let text = of_machine(&MachineConfig::built_in().expect("valid"));
        assert!(text.contains("1 800 000 records of 16 bytes") && text.contains("27.5 MiB"), "{text}");
    }
}
