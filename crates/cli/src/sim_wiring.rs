//! Wiring of a simulated card: switches and contacts as the machine file declares them.
//!
//! Invariant: every input that a machine file makes the card wait for becomes active, so that a correct program
//! completes on the simulated machine; homing finds each switch at the position in the file.

use retrace_core::RecordIndex;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use retrace_config::{
    CodeSwitching, CutterConfig, CutterKind, CutterProof, MachineConfig, NumberedError, SpindleOrientation,
};
use retrace_hal_sim::{
    ArcVoltageSettings, Clock, InputEvent, PlantSettings, ProbedWork, Reply, SimCard, SourceFaults, SourceSettings,
    SpindleSimulation, Switch, WarpedSheet, source_faults,
};
use retrace_link::{InputUse, InputWait, PathStart, channel};

use crate::files::unwritable;

/// Distance from a soft limit to its switch, in mm.
const OUTSIDE_MM: f64 = 1.0;
/// Distance from a home switch to the limit switch behind it, for braking, in mm.
const BEHIND_MM: f64 = 5.0;
/// Time until an awaited input becomes active, in microseconds; less where the machine file has a shorter timeout.
const TAKES_US: u32 = 50_000;

/// Time until the pressure of a jet is high, in microseconds.
const RAISES_US: u32 = 300_000;

/// Simulated card in this process, at rest, with the machine of the file.
///
/// # Errors
/// `E2113`
pub fn simulated<const A: usize>(
    machine: &MachineConfig,
    (faults, work): (&SourceFaults, Option<ProbedWork>),
    clock: Clock,
) -> Result<SimCard<A>, NumberedError> {
    let plant = PlantSettings { work, ..hung_on::<A>(machine, faults) };
    let settings = machine.card_settings(PathStart::at(RecordIndex::new(0)));
    let probing = machine.probing_rate_limits().unwrap_or(settings.limits);
    SimCard::with_machine(settings, &plant, clock)
        .map(|card| card.with_probing_limits(probing))
        .map_err(|_| NumberedError::new("E2113", "the rate law does not fit the card's memory", "see docs/errors.md"))
}

/// Adds a trace file to the card, if a path is given.
///
/// # Errors
/// `E2105` where the file cannot be created.
pub fn traced<const A: usize>(
    mut card: SimCard<A>,
    machine: &MachineConfig,
    path: Option<&Path>,
) -> Result<SimCard<A>, NumberedError> {
    if let Some(path) = path {
        let named = |error| unwritable(&path.display().to_string(), &error);
        let file = File::create(path).map_err(named)?;
        let names: Vec<String> = machine.axes.iter().map(|axis| axis.name.to_string()).collect();
        card.trace(Box::new(BufWriter::with_capacity(1 << 20, file)), &names).map_err(named)?;
    }
    Ok(card)
}

/// Wiring of a simulated card with its machine at 0: switches, and replies.
pub fn hung_on<const A: usize>(machine: &MachineConfig, faults: &SourceFaults) -> PlantSettings {
    let inputs = machine.card_settings::<A>(PathStart::at(RecordIndex::new(0))).inputs;
    let travel: Vec<[i64; 2]> = (0..machine.axes.len()).map(|axis| limits(machine, axis)).collect();
    let mut settings = PlantSettings::wired_as(&inputs, &travel, &[]);
    for switch in &mut settings.switches {
        let axis = usize::from(switch.axis);
        let Some(Some(home)) = machine.setting_up.homes.get(axis) else { continue };
        let used_for = |input: u8| inputs.get(usize::from(input)).map(|input| input.used_for);
        let of_its_own = inputs.iter().any(|input| input.used_for == InputUse::Home { axis: switch.axis });
        let is_limit = matches!(used_for(switch.input), Some(InputUse::Limit { .. }));
        if !is_limit || (!of_its_own && switch.upper == home.upper) {
            (switch.at, switch.upper) = (machine.counts_of(axis, home.position_mm), home.upper);
        }
    }
    if let (Some(layer), Some(sheet_um)) = (machine.tool_layer(), faults.sheet_um) {
        let sense = layer.sensing();
        let sheet_mm = sense.sheet_mm + f64::from(sheet_um) / 1000.0;
        let at = |mm: f64| machine.counts_of(layer.index, mm);
        let (float, tip) = (at(sheet_mm - sense.float_travel_mm), at(sheet_mm + sense.ohmic_offset_mm));
        let switch = |input: u8, at: i64| Switch { input, axis: layer.index as u8, at, upper: false };
        settings.switches.extend(sense.contacts.iter().map(|&input| switch(input, float)));
        let ohmic = sense.ohmic.iter().filter(|_| !faults.no_ohmic);
        settings.switches.extend(ohmic.map(|&input| switch(input, tip)));
        settings.warped = warped_sheet(machine, faults);
    }
    settings.replies = replies(machine);
    settings.spindle = machine.encoder.map(|encoder| SpindleSimulation {
        counts_per_turn: encoder.settings.counts_per_turn,
        is_inverted: encoder.settings.is_inverted,
        ..SpindleSimulation::default()
    });
    settings.sources = sources(machine, faults);
    let plugged_in = |input: u8| InputEvent { at_us: 0, input, active: true };
    settings.events.extend(machine.probe.connected_input.map(plugged_in));
    settings
}

/// Parses `--source-faults`.
///
/// # Errors
/// `E2154`
pub fn parsed_source_faults(text: Option<&str>) -> Result<SourceFaults, NumberedError> {
    source_faults(text.unwrap_or_default())
        .map_err(|why| NumberedError::new("E2154", format!("--source-faults: {why}"), "see docs/simulated-machine.md"))
}

/// The sheet under the tool axis.
fn warped_sheet(machine: &MachineConfig, faults: &SourceFaults) -> WarpedSheet {
    let nm = |axis: usize| machine.axes.get(axis).map_or(0, |axis| (1e6 / axis.pulses_per_mm) as u32);
    let tool_nm_per_pulse = machine.tool_layer().map_or(0, |layer| nm(layer.index));
    let contacts = machine.tool_layer().map_or(0, |layer| layer.contacts().fold(0, |bits, input| bits | 1 << input));
    WarpedSheet { rise_um: faults.warp_um, nm_per_pulse: nm(0), tool_nm_per_pulse, contacts }
}

/// How the voltage of the arc is read, where it controls the height.
fn arc_voltage(machine: &MachineConfig, faults: &SourceFaults) -> Option<ArcVoltageSettings> {
    let (layer, input) = machine.tool_layer().zip(machine.height_control()?.volts_input())?;
    let sheet_mm = layer.sensing().sheet_mm + f64::from(faults.sheet_um.unwrap_or_default()) / 1000.0;
    Some(ArcVoltageSettings {
        input: input.number,
        range_mv: [0, u16::MAX].map(|end| (input.amount(end) * 1000.0).round() as i64),
        axis: layer.index as u8,
        sheet: machine.counts_of(layer.index, sheet_mm),
        warped: warped_sheet(machine, faults),
    })
}

/// Sources of the cutters that have an input of their own.
fn sources(machine: &MachineConfig, faults: &SourceFaults) -> Vec<SourceSettings> {
    let nm_per_pulse = [0, 1].map(|axis| machine.axes.get(axis).map_or(0, |axis| (1e6 / axis.pulses_per_mm) as u32));
    let with_input = machine.cutters.iter().filter_map(|cutter| cutter.proof.map(|proof| (cutter, proof)));
    let voltage = arc_voltage(machine, faults);
    let source = |(cutter, proof): (&CutterConfig, CutterProof)| SourceSettings {
        voltage: voltage.filter(|_| cutter.height.is_some()),
        channel: cutter.fire,
        input: proof.input,
        nm_per_pulse,
        needs_metal: cutter.kind == CutterKind::Torch,
        faults: faults.clone(),
    };
    with_input.map(source).collect()
}

/// Positions of the limit switches of an axis, in pulses: outside the soft limits, and behind the home switch.
fn limits(machine: &MachineConfig, axis: usize) -> [i64; 2] {
    let [low, high] = machine.axes[axis].travel_mm;
    let [mut low, mut high] = [low - OUTSIDE_MM, high + OUTSIDE_MM];
    if let Some(home) = machine.setting_up.homes[axis] {
        if home.upper {
            high = high.max(home.position_mm + BEHIND_MM);
        } else {
            low = low.min(home.position_mm - BEHIND_MM);
        }
    }
    [machine.counts_of(axis, low), machine.counts_of(axis, high)]
}

/// Replies for every input that a code waits for.
fn replies(machine: &MachineConfig) -> Vec<Reply> {
    let mut replies: Vec<Reply> = Vec::new();
    for (code, CodeSwitching { until, .. }) in machine.switching.defined_codes() {
        let Some(InputWait { input, active, timeout_periods: at_most, .. }) = until else { continue };
        let waits_us = match at_most {
            0 => u32::MAX,
            periods => periods.saturating_mul(machine.period_us) / 2,
        };
        for (channel, states) in switched(machine, code) {
            let at = replies.iter().position(|reply| (reply.channel, reply.input) == (channel, input));
            let at = at.unwrap_or_else(|| {
                // A channel that no code waits for has the opposite level.
                replies.push(Reply { channel, input, active: [!active; 2], after_us: TAKES_US });
                replies.len() - 1
            });
            let reply = &mut replies[at];
            for state in [0, 1].into_iter().filter(|&state| states[state]) {
                reply.active[state] = active;
            }
            reply.after_us = reply.after_us.min(waits_us);
        }
    }
    for cutter in &machine.cutters {
        if let (Some(channel), Some(jet)) = (cutter.pressure, cutter.jet)
            && let Some(InputWait { input, timeout_periods, .. }) = jet.pressure_wait(machine.period_us)
        {
            let waits_us = timeout_periods.saturating_mul(machine.period_us) / 2;
            replies.push(Reply { channel, input, active: [false, true], after_us: RAISES_US.min(waits_us) });
        }
    }
    if let Some(SpindleOrientation { output, input, .. }) = machine.spindle.orientation {
        replies.push(Reply { channel: output, input, active: [false, true], after_us: TAKES_US });
    }
    replies
}

/// Channels that a code switches, with whether it sets them to 0 and to other values.
fn switched(machine: &MachineConfig, code: &str) -> Vec<(u8, [bool; 2])> {
    const OFF: [bool; 2] = [true, false];
    const ON: [bool; 2] = [false, true];
    match code {
        "M3" | "M4" => vec![(channel::SPINDLE, ON)],
        "M5" => vec![(channel::SPINDLE, OFF)],
        "M7" => vec![(channel::MIST, ON)],
        "M8" => vec![(channel::FLOOD, ON)],
        "M9" => vec![(channel::MIST, OFF), (channel::FLOOD, OFF)],
        "S" => vec![(channel::SPEED, [true; 2])],
        // T switches nothing: its input is active already.
        "M6" | "T" => vec![(channel::TOOL, [true; 2])],
        user => {
            let number = user.strip_prefix('M').and_then(|number| number.parse().ok());
            let code = number.and_then(|number| machine.switching.user_code(number));
            code.map(|code| (code.output, if code.value == 0 { OFF } else { ON })).into_iter().collect()
        }
    }
}
