//! A card at the end of a serial line: found, greeted, and told of the machine.
//!
//! Invariant: a card is opened only where it stands, and only by settings that it takes.

use std::time::{SystemTime, UNIX_EPOCH};

use retrace_controller::machine::Machine;
use retrace_controller::refusal::Refusal;
use retrace_hal_serial::{Address, SerialPort};
use retrace_link::{CardFault, Patience, Wired};

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

/// Finds the card, and opens it for a machine.
///
/// # Errors
/// As [`find`]; the card does not take the machine's settings.
pub fn open<const A: usize>(address: &str, machine: &Machine) -> Result<SerialCard<A>, Failure> {
    let mut card = find::<A>(address)?;
    card.open(machine.card_settings(0)).map_err(|fault| failed(address, &fault))?;
    Ok(card)
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
