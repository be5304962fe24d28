//! A card at the end of a serial line: found, greeted, and told of the machine.
//!
//! Invariant: a card is opened only where it stands, and only by settings that it takes.

use std::time::{SystemTime, UNIX_EPOCH};

use retrace_controller::machine::Machine;
use retrace_controller::refusal::Refusal;
use retrace_hal_serial::{Address, SerialPort};
use retrace_link::{
    CardFault, HostFault, Identity, MotionCard, Patience, Settings, Start, Status, Wired, WiredFault, Word,
};

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

/// Looks at a card that stands, by opening it there for a moment: its outputs, its alarm. It is as it was then, and needs no host.
///
/// # Errors
/// As [`Wired::open`].
pub fn look<const A: usize>(
    card: &mut SerialCard<A>,
    address: &str,
    settings: Settings<A>,
) -> Result<Status<A>, Failure> {
    let told = |fault| failed(address, &fault);
    card.open(settings).map_err(told)?;
    let status = *card.status();
    card.close().map_err(told)?;
    card.ask(nonce()).map_err(told)?;
    Ok(status)
}

/// Control periods in which a card tells whether it has cleared an alarm.
const CLEARED_WITHIN: u32 = 500;

/// A card that was asked where it stands and is opened when its path is begun: until then it needs no host, however long the operator
/// thinks.
#[derive(Debug)]
pub struct Greeted<const A: usize> {
    card: SerialCard<A>,
    settings: Settings<A>,
    /// As it was when it was asked.
    status: Status<A>,
    boot: u32,
    is_open: bool,
}

impl<const A: usize> Greeted<A> {
    /// A card that was looked at.
    #[must_use]
    pub fn new(card: SerialCard<A>, settings: Settings<A>, status: Status<A>, boot: u32) -> Self {
        Self { card, settings, status, boot, is_open: false }
    }

    /// Ends the epoch, if there is one.
    pub fn close(mut self) {
        if self.is_open {
            // The card stands, or has an alarm that says more than this would.
            let _ = self.card.close();
        }
    }

    fn open(&mut self, start: Start) -> Result<(), Fault<A>> {
        self.card.settle(nonce())?;
        let same = |greeting: &retrace_link::Greeting<A>| {
            greeting.identity.boot == self.boot && greeting.counts == self.status.counts
        };
        if !self.card.greeting().is_some_and(same) {
            return Err(WiredFault::Host(HostFault::Restarted));
        }
        self.card.open(Settings { start, ..self.settings })?;
        self.is_open = true;
        if self.card.status().alarm.is_some() {
            // What the card refuses shows in what it reports.
            let _ = self.card.send(Word::ClearAlarm);
            for _ in 0..CLEARED_WITHIN {
                if self.card.period()?.alarm.is_none() {
                    break;
                }
            }
        }
        Ok(())
    }
}

type Fault<const A: usize> = <Wired<A, SerialPort> as MotionCard<A>>::Fault;

impl<const A: usize> MotionCard<A> for Greeted<A> {
    type Fault = Fault<A>;

    fn window(&self) -> u32 {
        self.card.window()
    }

    fn send(&mut self, word: Word<A>) -> Result<(), retrace_link::Refusal> {
        if self.is_open { self.card.send(word) } else { Err(retrace_link::Refusal::Unfit) }
    }

    fn period(&mut self) -> Result<&Status<A>, Fault<A>> {
        self.card.period()
    }

    fn begin(&mut self, start: Start) -> Result<(), Fault<A>> {
        if self.is_open { self.card.begin(start) } else { self.open(start) }
    }

    fn status(&self) -> &Status<A> {
        if self.is_open { self.card.status() } else { &self.status }
    }

    fn arrived(&self) -> u32 {
        if self.is_open { self.card.arrived() } else { self.status.high }
    }
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
