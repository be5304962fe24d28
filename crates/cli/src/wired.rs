//! A card at the end of a serial line: found, greeted, and told of the machine.
//!
//! Invariant: a card is opened only where it stands, and only by settings that it takes.

use std::time::{SystemTime, UNIX_EPOCH};

use retrace_controller::machine::Machine;
use retrace_controller::refusal::Refusal;
use retrace_hal_serial::{Address, SerialPort};
use retrace_link::{CardFault, Identity, Patience, Wired};

use crate::program::Failure;

/// A card behind a serial port or a pseudo-terminal.
pub type SerialCard<const A: usize> = Box<Wired<A, SerialPort>>;

/// Finds the card at `PATH[@BAUD]`.
///
/// # Errors
/// The port cannot be opened, or nobody answers.
pub fn find<const A: usize>(address: &str) -> Result<SerialCard<A>, Failure> {
    let address = Address::parse(address).map_err(refused)?;
    let port = SerialPort::open(&address).map_err(refused)?;
    let card = Wired::find(port, nonce(), Patience::default()).map_err(|fault| {
        let refusal = Refusal::new(fault.number(), format!("{address}: {fault}"), fault.remedy());
        Failure::Card(refusal)
    })?;
    Ok(Box::new(card))
}

/// Can this card do what the machine file asks for?
///
/// # Errors
/// `E3008` with what it cannot.
pub fn fits(address: &str, identity: &Identity, machine: &Machine) -> Result<(), Failure> {
    let refuse = |what: String| {
        let remedy = "change the machine file, or take another card; `retrace card who PORT` says what this one can";
        Err(Failure::Card(Refusal::new("E3008", format!("{address}: {what}"), remedy)))
    };
    if machine.axes.len() > usize::from(identity.axes) {
        return refuse(format!("the machine has {} axes, the card {}", machine.axes.len(), identity.axes));
    }
    let (least, most) = (identity.shortest_period_us, identity.longest_period_us);
    if !(least..=most).contains(&machine.period_us) {
        return refuse(format!("a control period of {} µs, and the card takes {least} to {most}", machine.period_us));
    }
    for axis in &machine.axes {
        let pulses = axis.pulses_per_mm * axis.max_velocity_mm_per_s;
        if pulses > f64::from(identity.most_pulses_hz) {
            let name = axis.name.to_ascii_uppercase();
            return refuse(format!(
                "axis {name} makes up to {pulses:.0} pulses a second, the card {}",
                identity.most_pulses_hz
            ));
        }
    }
    Ok(())
}

/// The card, or the line to it.
pub fn failed(address: &str, fault: &impl CardFault) -> Failure {
    Failure::Card(Refusal::new(fault.number(), format!("{address}: {fault}"), fault.remedy()))
}

fn refused(refused: retrace_hal_serial::Refused) -> Failure {
    Refusal::new(refused.number, refused.what, refused.remedy).into()
}

/// A number that the last question did not have.
pub fn nonce() -> u32 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(1, |since| since.subsec_nanos() ^ since.as_secs() as u32)
}
