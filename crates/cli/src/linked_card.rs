//! Card on a serial line: finds it, greets it, and opens it with the settings of the machine.
//!
//! Invariant: a card is opened only at its own place, and only with settings that it accepts.

use retrace_core::RecordIndex;
use std::time::{SystemTime, UNIX_EPOCH};

use retrace_config::{MachineConfig, NumberedError};
use retrace_hal_serial::{Address, SerialPort};
use retrace_link::{
    CardFailure, CardIdentity, CardSettings, CardStatus, InputSetting, InputUse, LinkTimeouts, LinkedCard, MotionCard,
    PathStart, channel,
};

use crate::command_failure::CommandFailure;
use crate::known_boards;

/// Card behind a serial port or a pseudo-terminal.
pub type SerialCard<const A: usize> = Box<LinkedCard<A, SerialPort>>;

/// Finds the card at `PATH[@BAUD]`.
///
/// # Errors
/// The port cannot be opened, or no card answers.
pub fn find<const A: usize>(address: &str) -> Result<SerialCard<A>, CommandFailure> {
    let address = Address::parse(address).map_err(port_error)?;
    let port = SerialPort::open(&address).map_err(port_error)?;
    let card = LinkedCard::connect(port, nonce(), LinkTimeouts::default()).map_err(|fault| {
        let refusal = NumberedError::new(fault.number(), format!("{address}: {fault}"), fault.remedy());
        CommandFailure::Card(refusal)
    })?;
    Ok(Box::new(card))
}

/// Checks that this card can do what the machine file requires.
///
/// # Errors
/// `E3008` with the first misfit.
pub fn check_fit(address: &str, identity: &CardIdentity, machine: &MachineConfig) -> Result<(), CommandFailure> {
    match misfits(identity, machine).into_iter().next() {
        Some(what) => {
            Err(CommandFailure::Card(NumberedError::new("E3008", format!("{address}: {what}"), MISFIT_REMEDY)))
        }
        None => Ok(()),
    }
}

/// Remedy for a card that does not fit the machine.
pub const MISFIT_REMEDY: &str =
    "change the machine file, or use another card; `retrace card identify PORT` prints what this one supports";

/// Everything that the machine file requires and this card cannot do.
#[must_use]
pub fn misfits(identity: &CardIdentity, machine: &MachineConfig) -> Vec<String> {
    let mut misfits = Vec::new();
    if machine.axes.len() > usize::from(identity.axes) {
        misfits.push(format!("the machine has {} axes, the card {}", machine.axes.len(), identity.axes));
    }
    let (least, most) = (identity.min_period_us, identity.max_period_us);
    if !(least..=most).contains(&machine.period_us) {
        misfits.push(format!("the control period is {} µs, the card supports {least} to {most}", machine.period_us));
    }
    let settings = CardSettings { epoch: 1, ..machine.card_settings::<MAX_AXES>(PathStart::at(RecordIndex::new(0))) };
    let max_pulses = retrace_hal_sim::max_pulses_a_period(identity, &settings);
    let max_hz = max_pulses.map_or(f64::INFINITY, |pulses| f64::from(pulses) / machine.period_s());
    for axis in &machine.axes {
        let pulses = axis.pulses_per_mm * axis.max_velocity_mm_per_s;
        let name = axis.name.to_ascii_uppercase();
        if pulses > f64::from(identity.max_pulses_hz) {
            let most = identity.max_pulses_hz;
            misfits.push(format!("axis {name} needs up to {pulses:.0} pulses per second, the card supports {most}"));
        } else if pulses > max_hz * (1.0 + 1e-9) {
            misfits.push(format!(
                "axis {name} needs up to {pulses:.0} pulses per second, the card supports {max_hz:.0} with this \
                    step_pulse_us and direction_setup_us"
            ));
        }
    }
    for (number, setting) in settings.inputs.iter().enumerate().skip(usize::from(identity.inputs)) {
        if setting.used_for != InputUse::Plain {
            misfits.push(format!("input {number} is declared; the card has {} inputs", identity.inputs));
        }
    }
    for channel in settings.safe().iter().map(|change| change.channel).chain(machine.cutting_outputs.iter().copied()) {
        let is_digital = usize::from(channel) < channel::DIGITAL;
        if is_digital && channel >= identity.outputs {
            let name = machine.channel_name(channel);
            misfits.push(format!("{name} is output {channel}; the card has {} outputs", identity.outputs));
        }
    }
    for output in machine.card.analog_outputs.iter().filter(|output| output.number >= identity.analog.outputs()) {
        let (name, number) = (&output.name, output.number);
        misfits.push(match identity.analog.outputs() {
            0 => format!("{name} is analog output {number}; the card has no analog outputs"),
            count => format!("{name} is analog output {number}; the card has {count} of them"),
        });
    }
    for input in machine.card.analog_inputs.iter().filter(|input| input.number >= identity.analog.inputs()) {
        let (name, number) = (&input.name, input.number);
        misfits.push(match identity.analog.inputs() {
            0 => format!("{name} is analog input {number}; the card has no analog inputs"),
            count => format!("{name} is analog input {number}; the card has {count} of them"),
        });
    }
    // The cards with analog channels are those that control a height.
    let has_height_control = identity.analog.inputs() > 0;
    if machine.height_control().is_some_and(|of| of.volts_input().is_none()) && !has_height_control {
        misfits.push("a `[[cutter]]` has `height`; the card has no height control".into());
    }
    if let Some(beam) = machine.powered_beam().filter(|_| !identity.has_spindle_pwm) {
        misfits.push(format!("{} has `power`; the card has no output for the power of a beam", beam.name));
    } else if machine.spindle_pwm().is_some() && !identity.has_spindle_pwm {
        misfits.push("card.spindle_pwm is set; the card has no output for S".into());
    }
    let filter = machine.probing_rate_limits::<MAX_AXES>().map_or(0, |limits| limits.average());
    if filter > settings.limits.average() && filter > identity.memory {
        let most = identity.memory;
        misfits.push(format!(
            "probe.jerk_mm_per_s3 makes {filter} control periods of building up acceleration, the card supports {most}"
        ));
    }
    if machine.encoder.is_some() && !identity.has_spindle_encoder {
        misfits.push("spindle.counts_per_turn is set; the card reads no encoder of a spindle".into());
    }
    misfits.extend(encoder_misfits(identity, machine, &settings.inputs));
    if let (true, Err(_)) = (misfits.is_empty(), max_pulses) {
        misfits
            .push("the card does not support this step_pulse_us and direction_setup_us at this control period".into());
    }
    misfits.dedup();
    misfits
}

/// What of the spindle's encoder a board cannot do: a Pico reads it at inputs, which are nothing else then.
fn encoder_misfits(identity: &CardIdentity, machine: &MachineConfig, inputs: &[InputSetting]) -> Vec<String> {
    let (Some(encoder), Some(board)) = (&machine.encoder, known_boards::encoder_inputs(identity)) else {
        return Vec::new();
    };
    let used = (0..board.count).zip(inputs);
    let mut misfits: Vec<String> = used
        .filter(|&(number, setting)| setting.used_for != InputUse::Plain || machine.card.declares_input(number))
        .map(|(number, _)| {
            let last = board.count - 1;
            format!("input {number} is declared; inputs 0 to {last} of the card are the spindle's encoder")
        })
        .collect();
    let (counts, speed) = (encoder.settings.counts_per_turn, encoder.settings.highest_speed);
    let counts_hz = u64::from(counts) * u64::from(speed) / 60_000;
    if counts_hz > u64::from(board.max_counts_hz) {
        let most = board.max_counts_hz;
        misfits.push(format!(
            "the spindle's encoder has up to {counts_hz} counts per second (spindle.counts_per_turn, spindle.max_rpm), \
                the card reads {most}"
        ));
    }
    misfits
}

/// Maximum number of axes of a card.
pub const MAX_AXES: usize = 9;

/// Opens a card at rest for a moment to read its outputs and its alarm. Its state is unchanged afterwards, and it needs
/// no host.
///
/// # Errors
/// The card cannot be opened with these settings.
pub fn read_status<const A: usize>(
    card: &mut SerialCard<A>,
    address: &str,
    settings: CardSettings<A>,
) -> Result<CardStatus<A>, CommandFailure> {
    let told = |fault| card_error(address, &fault);
    card.open(settings).map_err(told)?;
    let status = *card.status();
    card.close().map_err(told)?;
    card.request_greeting(nonce()).map_err(told)?;
    Ok(status)
}

/// Failure of the card or of its line.
pub fn card_error(address: &str, fault: &impl CardFailure) -> CommandFailure {
    CommandFailure::Card(NumberedError::new(fault.number(), format!("{address}: {fault}"), fault.remedy()))
}

fn port_error(refused: retrace_hal_serial::PortError) -> CommandFailure {
    NumberedError::new(refused.number, refused.what, refused.remedy).into()
}

/// Number that differs from that of the last request.
pub fn nonce() -> u32 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(1, |since| since.subsec_nanos() ^ since.as_secs() as u32)
}
