//! Setup of a machine before a program runs: homing, jogging, and the safe approach.
//!
//! Invariant: where the machine has to be homed, every axis can be, and the order has each of them once.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Deserialize;

use crate::axis::{AxisConfig, HomeConfig, refuse};
use crate::card_config::CardConfig;
use crate::numbered_error::NumberedError;
use crate::value_range::within;

/// Largest offset of a pointer from the tool, mm.
const MAX_POINTER_MM: f64 = 1000.0;

/// Homing, `[homing]`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct HomingSection {
    /// Order in which the axes are homed.
    order: Option<Vec<char>>,
}

/// Manual operation, `[manual]`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct ManualSection {
    /// Whether a program may move a machine that has not been homed.
    pub(crate) allow_unhomed: bool,
    /// Position in mm, machine coordinates, to which *park* moves the axes for a change of consumables. Axes that are
    /// not named stay; the tool axis goes to `retract_mm`.
    pub(crate) park_mm: BTreeMap<char, f64>,
    /// Where the pointer, a cross laser or a camera, looks, in mm from the tool. *Pointer* moves it over the place
    /// where the tool would start.
    pub(crate) pointer_mm: BTreeMap<char, f64>,
    /// Number of the output that is on while the pointer stands there.
    pub(crate) pointer_output: Option<u8>,
}

/// Setup of a machine, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct ManualConfig {
    /// Homing of each axis, in the order of the axes.
    pub homes: Vec<Option<HomeConfig>>,
    /// Letters of the axes that are homed, in order.
    pub homing_order: Vec<char>,
    /// Whether the machine has its position at the start, so that it needs no homing.
    pub homed: bool,
    /// Whether a program may move a machine that has not been homed.
    pub allow_unhomed: bool,
    /// The axis that retracts the tool from the work, as an index of the axes.
    pub tool_axis: Option<usize>,
    /// Position of the tool axis at which the others may move safely, mm, machine coordinates.
    pub retract_mm: Option<f64>,
    /// Park position of each axis that has one, mm, machine coordinates.
    pub park_mm: Vec<Option<f64>>,
    /// Where the pointer looks, in mm from the tool: each axis by which it is offset, as an index of the axes.
    pub pointer_mm: Vec<(usize, f64)>,
    /// The output that is on while the pointer stands over a place.
    pub pointer_output: Option<u8>,
}

/// The parts of a machine file that define the setup.
pub(crate) struct Written {
    pub(crate) homing: HomingSection,
    pub(crate) manual: ManualSection,
    pub(crate) homed: Option<bool>,
    pub(crate) tool_axis: Option<char>,
    pub(crate) retract_mm: Option<f64>,
}

impl ManualConfig {
    pub(crate) fn checked(written: Written, axes: &[AxisConfig], card: &CardConfig) -> Result<Self, NumberedError> {
        let homes = axes.iter().map(AxisConfig::homing).collect::<Result<Vec<_>, _>>()?;
        for (index, (axis, home)) in axes.iter().zip(&homes).enumerate() {
            if home.is_some_and(|home| !card.can_home(index, home.upper)) {
                let what = format!("axis {}: there is a `home`, and no input is its switch", axis.name);
                let remedy = format!(
                    "[[card.input]] with use = \"home\" (or the limit switch of that end) and axis = \"{}\"",
                    axis.name
                );
                return Err(NumberedError::new("E2112", what, remedy));
            }
        }
        let tool_axis = tool_axis(written.tool_axis, axes)?;
        if let Some(retract) = written.retract_mm {
            let Some(axis) = tool_axis.and_then(|tool| axes.get(tool)) else {
                return Err(refuse("retract_mm: the machine has no tool axis".into()));
            };
            within("retract_mm", retract, axis.travel_mm[0], axis.travel_mm[1])?;
        }
        let homed = written.homed.unwrap_or(homes.iter().all(Option::is_none));
        if let (false, Some(without)) = (homed, homes.iter().position(Option::is_none)) {
            let what = format!("homed = false, and axis {} has no `home`", axes[without].name);
            return Err(NumberedError::new(
                "E2112",
                what,
                "give it one, or write homed = true: the machine needs no homing",
            ));
        }
        let homing_order = order(written.homing.order, axes, &homes, tool_axis)?;
        let (allow_unhomed, retract_mm) = (written.manual.allow_unhomed, written.retract_mm);
        let park_mm = park(&written.manual.park_mm, axes)?;
        let pointer_mm = pointer(&written.manual.pointer_mm, axes)?;
        let pointer_output = written.manual.pointer_output;
        if pointer_output.is_some() && pointer_mm.is_empty() {
            return Err(refuse("manual.pointer_output: there is no manual.pointer_mm".into()));
        }
        Ok(Self {
            homes,
            homing_order,
            homed,
            allow_unhomed,
            tool_axis,
            retract_mm,
            park_mm,
            pointer_mm,
            pointer_output,
        })
    }
}

/// Park position of each axis.
fn park(named: &BTreeMap<char, f64>, axes: &[AxisConfig]) -> Result<Vec<Option<f64>>, NumberedError> {
    let mut park_mm = vec![None; axes.len()];
    for (&letter, &mm) in named {
        let Some(index) = axes.iter().position(|axis| axis.name == letter.to_ascii_lowercase()) else {
            return Err(refuse(format!("manual.park_mm: the machine has no axis {letter}")));
        };
        within(&format!("manual.park_mm.{letter}"), mm, axes[index].travel_mm[0], axes[index].travel_mm[1])?;
        park_mm[index] = Some(mm);
    }
    Ok(park_mm)
}

/// Offset of the pointer on each axis that has one.
fn pointer(named: &BTreeMap<char, f64>, axes: &[AxisConfig]) -> Result<Vec<(usize, f64)>, NumberedError> {
    let offset = |(&letter, &mm): (&char, &f64)| {
        let found = axes.iter().position(|axis| axis.name == letter.to_ascii_lowercase());
        let index = found.ok_or_else(|| refuse(format!("manual.pointer_mm: the machine has no axis {letter}")))?;
        within(&format!("manual.pointer_mm.{letter}"), mm, -MAX_POINTER_MM, MAX_POINTER_MM)?;
        Ok((index, mm))
    };
    named.iter().map(offset).collect()
}

/// Index of the tool axis: z where none is given.
fn tool_axis(named: Option<char>, axes: &[AxisConfig]) -> Result<Option<usize>, NumberedError> {
    let letter = named.unwrap_or('z').to_ascii_lowercase();
    let found = axes.iter().position(|axis| axis.name == letter);
    match (named, found) {
        (Some(letter), None) => Err(refuse(format!("tool_axis = \"{letter}\": the machine has no such axis"))),
        _ => Ok(found),
    }
}

/// The order of homing: the tool axis first where none is given.
fn order(
    written: Option<Vec<char>>,
    axes: &[AxisConfig],
    homes: &[Option<HomeConfig>],
    tool_axis: Option<usize>,
) -> Result<Vec<char>, NumberedError> {
    let can = |index: usize| homes.get(index).is_some_and(Option::is_some);
    let Some(written) = written else {
        let rest = (0..axes.len()).filter(|index| Some(*index) != tool_axis);
        return Ok(tool_axis
            .into_iter()
            .chain(rest)
            .filter(|&index| can(index))
            .map(|index| axes[index].name)
            .collect());
    };
    let order: Vec<char> = written.iter().map(char::to_ascii_lowercase).collect();
    for (at, &letter) in order.iter().enumerate() {
        let index = axes.iter().position(|axis| axis.name == letter);
        if !index.is_some_and(can) {
            return Err(refuse(format!("homing.order: axis `{letter}` has no `home`")));
        }
        if order[..at].contains(&letter) {
            return Err(refuse(format!("homing.order: axis `{letter}` is there twice")));
        }
    }
    let left_out = axes.iter().enumerate().find(|(index, axis)| can(*index) && !order.contains(&axis.name));
    match left_out {
        Some((_, axis)) => Err(refuse(format!("homing.order: axis `{}` has a `home` and is left out", axis.name))),
        None => Ok(order),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine_config::MachineConfig;

    const AXES: &str = "[[axis]]\nname = \"x\"\npulses_per_mm = 400\nmax_velocity_mm_per_s = \
        100\nmax_acceleration_mm_per_s2 = 1000\n\
        max_jerk_mm_per_s3 = 20000\ntravel_mm = [0, 300]\nhome = { switch = \"lower\", position_mm = -2.5, \
        search_mm_per_s = 30, latch_mm_per_s = 1.5 }\n\
        [[axis]]\nname = \"z\"\npulses_per_mm = 400\nmax_velocity_mm_per_s = 100\nmax_acceleration_mm_per_s2 = 1000\n\
        max_jerk_mm_per_s3 = 20000\ntravel_mm = [-100, 0]\nhome = { switch = \"upper\" }\n\
        [[card.input]]\nnumber = 1\nuse = \"home\"\naxis = \"x\"\n[[card.input]]\nnumber = 2\nuse = \
        \"upper-limit\"\naxis = \"z\"\n";

    fn machine(before: &str, after: &str) -> Result<MachineConfig, NumberedError> {
        MachineConfig::parse(&format!("{before}{AXES}{after}"), "m.toml")
    }

    #[test]
    fn an_axis_is_homed_in_pulses_and_periods() {
        let machine = machine("control_period_ms = 2\n", "").expect("valid");
        assert_eq!((machine.needs_homing(), machine.tool_axis()), (&['z', 'x'][..], Some(1)));
        let x = machine.homing(0).expect("it has a switch");
        assert_eq!((x.axis, x.upper, x.count, x.max_travel), (0, false, -1000, 132_000));
        // 30 mm/s are 12 000 pulses/s, 24 in 2 ms; 250 mm/s² are 100 000 pulses/s², 0.4 a period more each period
        assert_eq!((x.search_speed, x.latch_speed), (24 << 32, (1.2 * 4_294_967_296.0_f64).round() as i64));
        assert_eq!(x.acceleration, (0.4 * 4_294_967_296.0_f64).round() as i64);
        let z = machine.homing(1).expect("it has a switch");
        assert_eq!((z.axis, z.upper, z.count), (1, true, 0));
        assert!(machine.homing(2).is_none());
        assert_eq!((machine.axis_of('Z'), machine.axis_of('y'), machine.axis_of('q')), (Some(1), None, None));
    }

    #[test]
    fn a_machine_without_switches_needs_no_homing_and_one_with_them_may_say_so() {
        let built_in = MachineConfig::built_in().expect("valid");
        assert!(built_in.needs_homing().is_empty() && built_in.homing_order().is_empty() && built_in.setting_up.homed);
        let knows = machine("homed = true\n", "").expect("valid");
        assert_eq!((knows.needs_homing(), knows.homing_order()), (&[][..], &['z', 'x'][..]));
        let refused = MachineConfig::parse("homed = false\n", "m.toml").expect_err("nothing to home with");
        assert!(refused.cause.contains("axis x has no `home`"), "{}", refused.cause);
    }

    #[test]
    fn order_tool_axis_and_retract_plane_are_as_written() {
        let written = machine(
            "tool_axis = \"X\"\nretract_mm = 290\n",
            "[homing]\norder = [\"X\", \"z\"]\n[manual]\nallow_unhomed = true\n",
        );
        let machine = written.expect("valid");
        assert_eq!((machine.tool_axis(), machine.setting_up.retract_mm), (Some(0), Some(290.0)));
        assert_eq!((machine.homing_order(), machine.setting_up.allow_unhomed), (&['x', 'z'][..], true));
    }

    #[test]
    fn what_cannot_be_is_refused_by_its_key() {
        let what = |before: &str, after: &str| machine(before, after).expect_err("wrong").cause;
        assert!(what("tool_axis = \"y\"\n", "").contains("tool_axis"));
        assert!(what("retract_mm = 1\n", "").contains("retract_mm = 1"));
        assert!(what("", "[homing]\norder = [\"x\"]\n").contains("`z` has a `home` and is left out"));
        assert!(what("", "[homing]\norder = [\"x\", \"z\", \"x\"]\n").contains("`x` is there twice"));
        assert!(what("", "[homing]\norder = [\"x\", \"z\", \"y\"]\n").contains("`y` has no `home`"));
        let with = |from: &str, to: &str| MachineConfig::parse(&AXES.replace(from, to), "m.toml").expect_err("wrong");
        assert!(with("search_mm_per_s = 30", "search_mm_per_s = 101").cause.contains("home.search_mm_per_s"));
        assert!(with("latch_mm_per_s = 1.5", "latch_mm_per_s = 31").cause.contains("home.latch_mm_per_s"));
        assert!(with("use = \"upper-limit\"", "use = \"lower-limit\"").cause.contains("no input is its switch"));
        assert_eq!(with("search_mm_per_s", "search_mm_pers").remedy, "did you mean `search_mm_per_s`?");
        let jog = with("travel_mm = [0, 300]", "travel_mm = [0, 300]\njog_mm_per_s = 200");
        assert!(jog.cause.contains("axis x: jog_mm_per_s"), "{}", jog.cause);
    }
}
