//! The submitter's side of the broker: `retrace shop host`, `say`, and what `submit` and `recall` send (SHP-5).
//!
//! Invariant: a job leaves this computer only when a machine has it, has refused it, or it was recalled.

use std::collections::BTreeMap;
use std::thread;
use std::time::{Duration, Instant};

use retrace_config::NumberedError;
use retrace_shop::{
    BrokerConnection, BrokerSettings, Claim, ClaimState, Claiming, Delivery, JobTarget, MachineName, Outbox, ShopFile,
    ShopJobId, ShopMessage, SubmittedJob, create_missing_stores, publish,
};

/// Longest wait for the connection in a command that somebody waits for.
pub const CONNECT_LIMIT: Duration = Duration::from_secs(5);
/// Time between two looks at the outbox.
const INTERVAL: Duration = Duration::from_secs(2);
/// Longest wait of `submit --wait`.
const TAKEN_LIMIT: Duration = Duration::from_secs(600);

/// Settings of the broker.
///
/// # Errors
/// `E5040` where the shop file has none.
pub fn settings(file: &ShopFile) -> Result<&BrokerSettings, NumberedError> {
    file.broker.as_ref().ok_or_else(|| {
        let what = "the shop file has no [broker]";
        NumberedError::new("E5040", what, "name the servers of the shop there; docs/shop.md describes it")
    })
}

/// Connects, and waits until the connection is there.
///
/// # Errors
/// `E5040` to `E5036`
pub fn connect(file: &ShopFile) -> Result<BrokerConnection, NumberedError> {
    let connection = BrokerConnection::begin(settings(file)?, file.name.as_str())?;
    connection.wait(CONNECT_LIMIT)?;
    Ok(connection)
}

/// Runs `retrace shop host`.
///
/// # Errors
/// `E5040`, `E5036`; with `once` also those of the broker.
pub fn run(file: &ShopFile, once: bool) -> Result<(), NumberedError> {
    let outbox = Outbox::open(&file.root)?;
    let connection = BrokerConnection::begin(settings(file)?, file.name.as_str())?;
    if once {
        connection.wait(CONNECT_LIMIT)?;
    }
    let (mut printed, mut seen) = (String::new(), 0);
    loop {
        let passed = pass(&connection, &outbox, &mut seen);
        if once {
            return passed;
        }
        match passed {
            Ok(()) => printed.clear(),
            Err(error) if error.to_string() != printed => {
                printed = error.to_string();
                eprintln!("{}", crate::escape::lines(&printed));
            }
            Err(_) => {}
        }
        thread::sleep(INTERVAL);
    }
}

fn pass(connection: &BrokerConnection, outbox: &Outbox, seen: &mut u64) -> Result<(), NumberedError> {
    connection.wait(CONNECT_LIMIT)?;
    // a broker that was started with an empty disk has none
    if *seen != connection.connections() {
        let made = create_missing_stores(connection)?;
        *seen = connection.connections();
        if !made.is_empty() {
            say!("made at the broker: {}", made.join(", "));
        }
    }
    for id in outbox.ids()? {
        match outbox.deliver(connection, id) {
            Ok(Some(delivery)) => print_delivery(id, &delivery),
            Ok(None) => {}
            // a job that is damaged does not hold up the others
            Err(error) if matches!(error.number, "E5006" | "E5010") => {
                eprintln!("{}", crate::escape::lines(&error.to_string()));
            }
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

fn print_delivery(id: ShopJobId, delivery: &Delivery) {
    match delivery {
        Delivery::Sent => say!("job {id}: sent"),
        Delivery::Waits => {}
        Delivery::Settled(claim) => say!("job {id}: {}", claim_text(claim)),
    }
}

fn claim_text(claim: &Claim) -> String {
    let machine = claim.machine.as_ref().map_or_else(|| "its submitter".to_owned(), |name| format!("machine {name}"));
    match claim.state {
        ClaimState::Claimed => format!("{machine} loads it"),
        ClaimState::Taken => format!("{machine} has taken it"),
        ClaimState::Returned if claim.machine.is_none() => "recalled".into(),
        ClaimState::Returned => format!("{machine} has given it back"),
        ClaimState::Refused => format!("{machine} has refused it"),
    }
}

/// Sends a job that was just submitted. Where the broker is away, the job waits in the outbox.
///
/// # Errors
/// `E5036`; with `wait` those of the broker, and `E5015` where the job was not taken.
pub fn send_submitted(
    file: &ShopFile,
    settings: &BrokerSettings,
    outbox: &Outbox,
    id: ShopJobId,
    wait: bool,
) -> Result<(), NumberedError> {
    let connection = BrokerConnection::begin(settings, file.name.as_str())?;
    let began = Instant::now();
    loop {
        let delivered = connection.wait(CONNECT_LIMIT).and_then(|()| outbox.deliver(&connection, id));
        match delivered {
            Err(error) if !wait => {
                eprintln!("{}", crate::escape::lines(&error.to_string()));
                eprintln!("note: the job is stored on this computer; `retrace shop host` sends it");
                return Ok(());
            }
            Err(error) if began.elapsed() > TAKEN_LIMIT => return Err(error),
            Err(_) => {}
            Ok(_) if !wait => return Ok(()),
            Ok(Some(Delivery::Settled(claim))) => {
                say!("{}", claim_text(&claim));
                return match claim.state {
                    ClaimState::Taken => Ok(()),
                    _ => Err(not_taken(id, &claim_text(&claim))),
                };
            }
            Ok(_) if began.elapsed() > TAKEN_LIMIT => return Err(not_taken(id, "no machine has taken it yet")),
            Ok(_) => {}
        }
        thread::sleep(Duration::from_millis(200));
    }
}

fn not_taken(id: ShopJobId, why: &str) -> NumberedError {
    let remedy = "`retrace shop watch` shows the machines; at the machine, `retrace shop show` has the reason";
    NumberedError::new("E5015", format!("job {id}: {why}"), remedy)
}

/// Recalls a job that was submitted here.
///
/// # Errors
/// `unknown` where no job of this name was submitted here; those of the broker.
pub fn recall(file: &ShopFile, name: &str, unknown: NumberedError) -> Result<(), NumberedError> {
    if file.broker.is_none() {
        return Err(unknown);
    }
    let outbox = Outbox::open(&file.root)?;
    let submitted = outbox.submitted()?;
    let found: BTreeMap<ShopJobId, &SubmittedJob> = submitted
        .iter()
        .filter(|job| !name.is_empty() && job.id.to_string().starts_with(name))
        .map(|job| (job.id, job))
        .collect();
    let (Some((&id, job)), 1) = (found.first_key_value(), found.len()) else { return Err(unknown) };
    let connection = connect(file)?;
    match outbox.recall(&connection, &job.target, id)? {
        Claiming::Ours(_) => say!("job {id} is recalled: no machine had it"),
        Claiming::Others(claim) if matches!(claim.state, ClaimState::Claimed | ClaimState::Taken) => {
            say!("job {id}: {}; it was asked to give it back, and does so unless it runs", claim_text(&claim));
        }
        Claiming::Others(claim) => say!("job {id}: {}", claim_text(&claim)),
    }
    Ok(())
}

/// Runs `retrace shop say`.
///
/// # Errors
/// `E5002` for the name, `E5006` for the text; those of the broker.
pub fn say(file: &ShopFile, machine: &str, text: &str) -> Result<(), NumberedError> {
    let target = JobTarget::Machine(MachineName::parse(machine)?);
    let message = ShopMessage::Say { target, id: ShopJobId::new_now()?, text: text.into() };
    publish(&connect(file)?, &message)?;
    say!("sent; the operator sees it with the jobs of the machine");
    Ok(())
}
