//! Work that the probe of a simulated machine touches, `--work`.
//!
//! Invariant: lengths are in mm, machine coordinates; every item that is not one of those listed is refused.

use std::ops::RangeInclusive;

use retrace_config::{MachineConfig, NumberedError};
use retrace_hal_sim::{Cylinder, ProbedBody, ProbedWork};

const ITEMS: &str = "z<-10 (all below), box=X1:X2,Y1:Y2,Z1:Z2, boss=X,Y,DIAMETER,Z1:Z2, bore=X,Y,DIAMETER,Z1:Z2, \
                     ball=DIAMETER, bounce-ms=N";

/// Parses the bodies of a machine with a probe. `None` without a text.
///
/// # Errors
/// `E2154` for an item that is none, or a machine without a probe.
pub fn parsed_work(text: Option<&str>, machine: &MachineConfig) -> Result<Option<ProbedWork>, NumberedError> {
    let Some(text) = text else { return Ok(None) };
    let refused =
        |what: String| NumberedError::new("E2154", format!("--work: {what}"), "see docs/simulated-machine.md");
    let input = machine.probe.input.ok_or_else(|| refused("the machine file has no probe".into()))?;
    let axes = ['x', 'y', 'z'].map(|letter| machine.axis_of(letter).map(|index| index as u8));
    let pm =
        |axis: Option<u8>| axis.map_or(0, |axis| (1e9 / machine.axes[usize::from(axis)].pulses_per_mm).round() as i64);
    let mut work =
        ProbedWork { input, axes, pm_per_pulse: [pm(axes[0]), pm(axes[1])], bodies: Vec::new(), bounce_us: 0 };
    let mut ball_mm = 0.0;
    for item in text.split(';').map(str::trim).filter(|item| !item.is_empty()) {
        if let Some(mm) = item.strip_prefix("ball=").and_then(|text| text.trim().parse::<f64>().ok()) {
            ball_mm = mm.clamp(0.0, 100.0);
            continue;
        }
        add(item, machine, &mut work).ok_or_else(|| refused(format!("`{item}` is no body; valid are {ITEMS}")))?;
    }
    let radius_pm = (ball_mm * 5e8_f64).round() as i64;
    work.bodies.iter_mut().for_each(|body| swell(body, radius_pm, work.pm_per_pulse));
    Ok(Some(work))
}

/// Makes a body larger by the radius of the ball of the probe, whose centre is what the axes move. The corners of a box
/// stay sharp; along Z the ball is a part of the tool's length.
fn swell(body: &mut ProbedBody, radius_pm: i64, pm_per_pulse: [i64; 2]) {
    match body {
        ProbedBody::Box(low, high) => {
            for (axis, pm) in pm_per_pulse.into_iter().enumerate().filter(|(_, pm)| *pm > 0) {
                low[axis] = low[axis].saturating_sub(radius_pm / pm);
                high[axis] = high[axis].saturating_add(radius_pm / pm);
            }
        }
        ProbedBody::Boss(cylinder) => cylinder.radius_pm += radius_pm,
        ProbedBody::Bore(cylinder) => cylinder.radius_pm = (cylinder.radius_pm - radius_pm).max(0),
    }
}

fn add(item: &str, machine: &MachineConfig, work: &mut ProbedWork) -> Option<()> {
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|mm| mm.abs() <= 1e6);
    let axes = work.axes;
    let counts = |axis: usize, mm: f64| axes[axis].map_or(0, |index| machine.counts_of(usize::from(index), mm));
    let range = |axis: usize, text: &str| -> Option<RangeInclusive<i64>> {
        let (low, high) = text.split_once(':')?;
        Some(counts(axis, number(low)?)..=counts(axis, number(high)?))
    };
    let cylinder = |text: &str| -> Option<Cylinder> {
        let [x, y, diameter, z] = text.split(',').collect::<Vec<_>>().try_into().ok()?;
        let ends = range(2, z)?;
        Some(Cylinder {
            centre: [counts(0, number(x)?), counts(1, number(y)?)],
            radius_pm: (number(diameter)?.abs() * 5e8).round() as i64,
            ends: [*ends.start(), *ends.end()],
        })
    };
    if let Some(mm) = item.strip_prefix("z<") {
        work.bodies.push(ProbedBody::Box([i64::MIN; 3], [i64::MAX, i64::MAX, counts(2, number(mm)?)]));
        return Some(());
    }
    match item.split_once('=')? {
        ("box", text) => {
            let [x, y, z] = text.split(',').collect::<Vec<_>>().try_into().ok()?;
            let ranges = [range(0, x)?, range(1, y)?, range(2, z)?];
            let [low, high] = [ranges.each_ref().map(|r| *r.start()), ranges.each_ref().map(|r| *r.end())];
            work.bodies.push(ProbedBody::Box(low, high));
        }
        ("boss", text) => work.bodies.push(ProbedBody::Boss(cylinder(text)?)),
        ("bore", text) => work.bodies.push(ProbedBody::Bore(cylinder(text)?)),
        ("bounce-ms", text) => work.bounce_us = (number(text)?.clamp(0.0, 20.0) * 1000.0) as u32,
        _ => return None,
    }
    Some(())
}
