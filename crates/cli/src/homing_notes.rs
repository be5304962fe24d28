//! No program motion before homing, unless the machine file allows it: what was homed is noted, and asked for.
//!
//! Invariant: an axis counts as homed only when its homing came to its end, on this card, since it was switched on. The simulated card in this
//! process is there for one command, and counts as homed.

use retrace_controller::homed_axes::{CardBoot, HomedAxes, required};
use retrace_controller::machine::MachineConfig;
use retrace_controller::manual::{ManualTask, ManualTaskDone, ManualTaskError};
use retrace_controller::numbered_error::NumberedError;
use retrace_link::CardIdentity;

use crate::screen::model::AxisHoming as HomingNotes;

/// A card, and what was homed over it.
#[derive(Clone, Debug)]
pub struct Homing {
    /// None: the simulated card in this process.
    card: Option<CardBoot>,
    /// How it is homed.
    remedy: String,
}

impl Homing {
    /// The simulated card in this process.
    #[must_use]
    pub fn simulated() -> Self {
        Self { card: None, remedy: String::new() }
    }

    /// A card at this address that says who it is.
    #[must_use]
    pub fn of(address: &str, identity: &CardIdentity) -> Self {
        let remedy = format!(
            "`retrace home --card {address}` with its machine file; see docs/machine-file.md for `allow_unhomed`"
        );
        Self { card: Some(identity.into()), remedy }
    }

    /// A screen is there, at which it can be homed.
    #[must_use]
    pub fn at_screen(self) -> Self {
        Self { remedy: "home it (H)".into(), ..self }
    }

    /// May a program move this machine?
    ///
    /// # Errors
    /// `E2162` with the axes that were not homed; `E2201` where nothing can have been noted.
    pub fn check(&self, machine: &MachineConfig) -> Result<(), NumberedError> {
        let Some(card) = self.card.as_ref().filter(|_| !required(machine).is_empty()) else { return Ok(()) };
        let unhomed = HomedAxes::open_default()?.unhomed(card, machine);
        if unhomed.is_empty() {
            return Ok(());
        }
        let letters: Vec<String> = unhomed.iter().map(|axis| axis.to_ascii_uppercase().to_string()).collect();
        let (axes, were) = if letters.len() == 1 { ("axis", "was") } else { ("axes", "were") };
        let what = format!("{axes} {} {were} not homed since the card was switched on", letters.join(", "));
        Err(NumberedError::new("E2162", what, self.remedy.clone()))
    }

    /// Which axes are homed, in the order of the axes.
    #[must_use]
    pub fn axes(&self, machine: &MachineConfig) -> Vec<HomingNotes> {
        let notes = self.card.as_ref().and_then(|card| Some((card, HomedAxes::open_default().ok()?)));
        let homing = |letter| match notes.as_ref().and_then(|(card, homed)| homed.is_homed(card, machine, letter)) {
            None => HomingNotes::NotNeeded,
            Some(true) => HomingNotes::Homed,
            Some(false) => HomingNotes::NotHomed,
        };
        machine.axes.iter().map(|axis| homing(axis.name)).collect()
    }

    /// Carries a task out; of homing, notes that it has begun and that it is done.
    ///
    /// # Errors
    /// As `perform`; `E2105`, `E2201` where homing cannot be noted, unless nobody asks for it.
    pub fn noting(
        &self,
        task: &ManualTask,
        machine: &MachineConfig,
        perform: impl FnOnce() -> Result<ManualTaskDone, ManualTaskError>,
    ) -> Result<ManualTaskDone, ManualTaskError> {
        let (ManualTask::Home(axis), Some(card)) = (task, &self.card) else { return perform() };
        let axes = axis.map_or_else(|| machine.homing_order().to_vec(), |axis| vec![axis.to_ascii_lowercase()]);
        let asked_for = !required(machine).is_empty();
        let noted = HomedAxes::open_default().and_then(|homed| homed.mark_unhomed(card, &axes).map(|()| homed));
        let homed = match noted {
            Ok(homed) => homed,
            Err(refusal) if asked_for => return Err(refusal.into()),
            Err(_) => return perform(),
        };
        let done = perform()?;
        if let ManualTaskDone::Completed { .. } = done {
            let noted = homed.mark_homed(card, machine, &axes);
            noted.or_else(|refusal| if asked_for { Err(refusal) } else { Ok(()) })?;
        }
        Ok(done)
    }
}
