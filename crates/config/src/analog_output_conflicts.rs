//! Conflicts of analog outputs with what else has a name, or a meaning behind E.
//!
//! Invariant: M67 E with a number means one thing.

use std::collections::BTreeMap;

use crate::analog_output::AnalogOutput;
use crate::cutter::CutterConfig;
use crate::numbered_error::NumberedError;

/// Number behind E that sets the share of the feed rate, on a machine with a material table.
const FEED_SHARE: u8 = 3;

/// Checks that no analog output has the name of another output, or a number with another meaning behind E.
pub(crate) fn check_analog_outputs(
    outputs: &[AnalogOutput],
    cutters: &[CutterConfig],
    output_names: &BTreeMap<u8, String>,
) -> Result<(), NumberedError> {
    for AnalogOutput { number, name, .. } in outputs {
        let refuse = |what: String, remedy: &str| {
            Err(NumberedError::new("E2112", format!("card.analog_output {number}: {what}"), remedy))
        };
        let mut others = cutters.iter().map(|cutter| &cutter.name).chain(output_names.values());
        if others.any(|other| other.eq_ignore_ascii_case(name)) {
            return refuse("the name is used twice".into(), "one name each");
        }
        let is_power = |cutter: &&CutterConfig| cutter.power.and_then(|power| power.analog) == Some(*number);
        if let Some(beam) = cutters.iter().find(is_power) {
            let what = format!("M67 E{number} is the power of {} (`power.analog`)", beam.name);
            return refuse(what, "another number for one of them");
        }
        if *number == FEED_SHARE && cutters.iter().any(|cutter| cutter.materials.is_some()) {
            let what = "M67 E3 is the share of the feed rate in programs with a material table".into();
            return refuse(what, "another number");
        }
    }
    Ok(())
}
