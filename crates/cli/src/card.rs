//! `retrace card`: lists serial ports, identifies a card, clears its alarm. Serving a simulated card is `card_serve`.
//!
//! Invariant: identifying moves nothing. A card that works for a host is only greeted; an idle one is opened briefly to
//! read its outputs, and its state is unchanged.

use retrace_config::{ChannelNames, MachineConfig, NumberedError};
use retrace_core::RecordIndex;
use retrace_hal_serial::{FoundPort, LatencyTimer};
use std::path::Path;

use retrace_link::{CardFailure, CardIdentity, Greeting, HostCommand, MotionCard, PathStart};
use serde_json::{Value, json};

use crate::command_failure::CommandFailure;
use crate::linked_card::{MAX_AXES, SerialCard};
use crate::{args, card_serve, files, linked_card};

/// Number of periods within which a card executes the command and reports that.
const CLEARED_WITHIN: u32 = 300;

/// Runs the command.
///
/// # Errors
/// The port or the machine file has errors, or no card answers.
pub fn run(args: &args::Card) -> Result<(), CommandFailure> {
    match args {
        args::Card::Serve(args) => card_serve::run(args)?,
        args::Card::Ports { format } => list(&retrace_hal_serial::ports(), format.json),
        args::Card::Identify { address, machine_file, format } => {
            identify(&address.port, machine_file.path(), format.json)?
        }
        args::Card::Clear { address, machine_file } => clear(&address.port, machine_file.path())?,
    }
    Ok(())
}

fn list(ports: &[FoundPort], json: bool) {
    if json {
        crate::out::line(json!({ "ports": ports.iter().map(port_json).collect::<Vec<_>>() }));
        return;
    }
    if ports.is_empty() {
        say!("no serial ports found (pseudo-terminals are not listed)");
    }
    for port in ports {
        match &port.usb {
            None => say!("{}", port.path),
            Some(usb) => say!(
                "{}  USB {:04x}:{:04x}  serial number {}  {}",
                port.path,
                usb.vendor,
                usb.product,
                usb.serial.as_deref().unwrap_or("none"),
                usb.name
            ),
        }
    }
}

fn port_json(port: &FoundPort) -> Value {
    let usb = port.usb.as_ref().map(|usb| {
        json!({
            "vendor": format!("{:04x}", usb.vendor),
            "product": format!("{:04x}", usb.product),
            "serial": usb.serial,
            "name": usb.name,
        })
    });
    json!({ "path": port.path, "usb": usb })
}

fn identify(address: &str, machine: Option<&Path>, json: bool) -> Result<(), CommandFailure> {
    let machine = files::machine(machine)?;
    let mut card = linked_card::find::<MAX_AXES>(address)?;
    // The card was found by its greeting.
    let Some(greeting) = card.greeting().copied() else { return Ok(()) };
    let outputs = outputs(&mut card, address, &greeting, &machine);
    let latency = card.port().latency();
    if json {
        crate::out::line(greeting_json(address, &greeting, &outputs, latency));
    } else {
        crate::out::line(greeting_text(address, &greeting, &outputs, &ChannelNames::of_machine(&machine), latency));
    }
    Ok(())
}

/// Outputs that are not 0, as channel and value, or why they are not known. A card that works for a host is not
/// disturbed.
type Outputs = Result<Vec<(u8, i32)>, String>;

fn outputs(
    card: &mut SerialCard<MAX_AXES>,
    address: &str,
    greeting: &Greeting<MAX_AXES>,
    machine: &MachineConfig,
) -> Outputs {
    if greeting.epoch != 0 || !greeting.at_rest {
        return Err("unknown: the card works for a host".into());
    }
    let Greeting { place, reached, executed, .. } = *greeting;
    // Opened without its spindle, the card would forget a thread or tap in which the tool rests.
    if greeting.identity.has_spindle_encoder && machine.encoder.is_none() && place.fraction != 0 {
        return Err("unknown: the tool may rest in a thread; --machine with its machine file tells them".into());
    }
    let settings = machine.card_settings(PathStart { place, rests: false, reached, executed, keeps_state: true });
    match linked_card::read_status(card, address, settings) {
        Ok(status) => {
            let each = status.outputs.iter().enumerate().filter(|(_, value)| **value != 0);
            Ok(each.map(|(number, &value)| (number as u8, value)).collect())
        }
        Err(CommandFailure::Card(refusal) | CommandFailure::Input(refusal)) => {
            Err(format!("unknown: {}", refusal.cause))
        }
        Err(CommandFailure::Program) => Err("unknown".into()),
    }
}

fn outputs_text(outputs: &Outputs, names: &ChannelNames) -> String {
    match outputs {
        Err(why) => why.clone(),
        Ok(outputs) if outputs.is_empty() => "all off".into(),
        Ok(outputs) => {
            let each = outputs
                .iter()
                .map(|(number, value)| format!("{} {}", names.name(*number), names.value_text(*number, *value)));
            each.collect::<Vec<_>>().join(", ")
        }
    }
}

/// Clears the latched alarm: opens an epoch with the machine's switches, and closes it again.
fn clear(address: &str, machine: Option<&Path>) -> Result<(), CommandFailure> {
    let machine = files::machine(machine)?;
    let mut card = linked_card::find::<MAX_AXES>(address)?;
    card.wait_at_rest(linked_card::nonce()).map_err(|fault| linked_card::card_error(address, &fault))?;
    // The place on the path is kept: an interrupted job may be resumed there.
    let start = card.greeting().map_or(PathStart::at(RecordIndex::new(0)), |result| PathStart {
        place: result.place,
        rests: false,
        reached: result.reached,
        executed: result.executed,
        keeps_state: true,
    });
    card.open(machine.card_settings(start)).map_err(|fault| linked_card::card_error(address, &fault))?;
    let Some(alarm) = card.status().alarm else {
        say!("{address}: no alarm is latched");
        return card.close().map_err(|fault| linked_card::card_error(address, &fault));
    };
    // A rejected command shows below.
    let _ = card.send(HostCommand::ClearAlarm);
    for _ in 0..CLEARED_WITHIN {
        if card.run_period().is_ok_and(|status| status.alarm.is_none()) {
            say!("{address}: cleared: {alarm}");
            return card.close().map_err(|fault| linked_card::card_error(address, &fault));
        }
    }
    let what = format!("{address}: not cleared, its cause is still present: {alarm}");
    Err(CommandFailure::Card(NumberedError::new(alarm.number(), what, alarm.remedy())))
}

/// Name of the card, as far as it is text.
fn card_name(identity: &CardIdentity) -> String {
    String::from_utf8_lossy(&identity.name).trim_end_matches('\0').to_owned()
}

fn counts(greeting: &Greeting<MAX_AXES>) -> &[i64] {
    &greeting.counts[..usize::from(greeting.identity.axes).min(MAX_AXES)]
}

/// Text of a greeting, in a few lines.
fn greeting_text(
    address: &str,
    greeting: &Greeting<MAX_AXES>,
    outputs: &Outputs,
    names: &ChannelNames,
    latency: &LatencyTimer,
) -> String {
    let of = &greeting.identity;
    let mut text = format!(
        "{address}: `{}`, serial number {}, protocol {}\n  \
         {} axes, {} outputs, {} inputs{}{}, a window of {} records, a rate law of up to {} periods\n  \
         periods of {} to {} µs, up to {} pulses a second, a clock of {} Hz\n  \
         {} at place {}, counts {:?}",
        card_name(of),
        of.serial,
        of.protocol,
        of.axes,
        of.outputs,
        of.inputs,
        match (of.has_spindle_pwm, of.has_spindle_encoder) {
            (true, true) => ", an output for S (PWM), a spindle encoder",
            (true, false) => ", an output for S (PWM)",
            (false, true) => ", a spindle encoder",
            (false, false) => "",
        },
        [(of.analog.outputs(), "outputs"), (of.analog.inputs(), "inputs")]
            .iter()
            .filter(|(count, _)| *count > 0)
            .map(|(count, what)| format!(", {count} analog {what}"))
            .collect::<String>(),
        of.window,
        of.memory,
        of.min_period_us,
        of.max_period_us,
        of.max_pulses_hz,
        of.tick_hz,
        if greeting.at_rest { "at rest" } else { "in motion" },
        greeting.place.record,
        counts(greeting),
    );
    text += &format!("\n  outputs {}", outputs_text(outputs, names));
    match greeting.alarm {
        Some(alarm) => text += &format!("\n  alarm[{}]: {alarm}\n  help: {}", alarm.number(), alarm.remedy()),
        None => text += "\n  no alarm",
    }
    if let LatencyTimer::ReadOnly { ms, remedy } = latency {
        text += &format!("\n  the USB adapter delays bytes by {ms} ms; to shorten that: {remedy}");
    }
    text
}

fn greeting_json(address: &str, greeting: &Greeting<MAX_AXES>, outputs: &Outputs, latency: &LatencyTimer) -> Value {
    let of = &greeting.identity;
    let latency_ms = match latency {
        LatencyTimer::None => None,
        LatencyTimer::Set { ms } | LatencyTimer::ReadOnly { ms, .. } => Some(ms),
    };
    json!({
        "port": address,
        "name": card_name(of),
        "serial": of.serial,
        "boot": of.boot,
        "protocol": of.protocol,
        "axes": of.axes,
        "outputs": of.outputs,
        "inputs": of.inputs,
        "analog_outputs": of.analog.outputs(),
        "analog_inputs": of.analog.inputs(),
        "spindle_pwm": of.has_spindle_pwm,
        "spindle_encoder": of.has_spindle_encoder,
        "window": of.window,
        "memory": of.memory,
        "tick_hz": of.tick_hz,
        "min_period_us": of.min_period_us,
        "max_period_us": of.max_period_us,
        "max_pulses_hz": of.max_pulses_hz,
        "epoch": greeting.epoch,
        "last_epoch": greeting.last_epoch,
        "place": greeting.place.record.number(),
        "fraction": greeting.place.fraction,
        "at_rest": greeting.at_rest,
        "counts": counts(greeting),
        "outputs_on": outputs.as_ref().ok().map(|all| {
            all.iter().map(|(channel, value)| json!({"channel": channel, "value": value})).collect::<Vec<_>>()
        }),
        "alarm": greeting.alarm.map(|alarm| json!({ "number": alarm.number(), "cause": alarm.to_string() })),
        "adapter_latency_ms": latency_ms,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use retrace_core::Place;
    use retrace_hal_serial::UsbDevice;
    use retrace_link::Alarm;

    fn greeting() -> Greeting<MAX_AXES> {
        let mut counts = [0; MAX_AXES];
        counts[..3].copy_from_slice(&[1, -2, 3]);
        Greeting {
            nonce: 1,
            identity: CardIdentity { axes: 4, ..retrace_hal_sim::identity::<4>(77, 5) },
            epoch: 0,
            last_epoch: 3,
            place: Place::start_of(RecordIndex::new(12)),
            at_rest: true,
            reached: RecordIndex::new(12),
            executed: 0,
            counts,
            layer: (0, 0),
            alarm: Some(Alarm::HostSilent),
        }
    }

    #[test]
    fn a_greeting_says_who_where_and_what_is_wrong() {
        let kept = LatencyTimer::ReadOnly { ms: 16, remedy: "do this".into() };
        let outputs = Ok(vec![(64, 1), (3, 1)]);
        let text = greeting_text("port", &greeting(), &outputs, &ChannelNames::default(), &kept);
        assert!(
            greeting_text("port", &greeting(), &Err("not known: x".into()), &ChannelNames::default(), &kept)
                .contains("outputs not known: x")
        );
        for part in [
            "outputs spindle 1, output 3 1",
            "`retrace-sim`",
            "serial number 77",
            "[1, -2, 3, 0]",
            "place 12",
            "E3011",
            "16 ms",
            "do this",
        ] {
            assert!(text.contains(part), "{part} is not in {text}");
        }
        let value = greeting_json("port", &greeting(), &outputs, &kept);
        assert_eq!(value["outputs_on"][0], json!({"channel": 64, "value": 1}));
        assert_eq!((&value["counts"], &value["alarm"]["number"]), (&json!([1, -2, 3, 0]), &json!("E3011")));
    }

    #[test]
    fn a_port_is_told_as_json() {
        let usb = UsbDevice { vendor: 0x0403, product: 0x6001, serial: None, name: "adapter".into() };
        let value = port_json(&FoundPort { path: "p".into(), usb: Some(usb) });
        let expected = json!({ "vendor": "0403", "product": "6001", "serial": null, "name": "adapter" });
        assert_eq!((&value["path"], &value["usb"]), (&json!("p"), &expected));
    }
}
