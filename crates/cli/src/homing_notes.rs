//! Homing state: no program motion before homing, unless the machine file permits it.
//!
//! Invariant: an axis counts as homed only when its homing completed, on this card, since the card was switched on. The
//! simulated card in this process exists for one command, and counts as homed.

use retrace_config::{MachineConfig, NumberedError};
use retrace_controller::{ManualTask, ManualTaskDone, ManualTaskError};
use retrace_journal::{CardBoot, HomedAxes, axes_to_home};
use retrace_link::CardIdentity;
use retrace_tui::AxisHoming as HomingNotes;

/// A card with the homing state of its axes.
#[derive(Clone, Debug)]
pub struct Homing {
    /// `None` for the simulated card in this process.
    card: Option<CardBoot>,
    /// How to home it.
    remedy: String,
}

impl Homing {
    /// Simulated card in this process.
    #[must_use]
    pub fn simulated() -> Self {
        Self { card: None, remedy: String::new() }
    }

    /// Card at this address with this identity.
    #[must_use]
    pub fn of(address: &str, identity: &CardIdentity) -> Self {
        let remedy = format!(
            "`retrace home --card {address}` with its machine file; see docs/machine-file.md for `allow_unhomed`"
        );
        Self { card: Some(identity.into()), remedy }
    }

    /// Adapts the remedy to the screen, where the machine can be homed.
    #[must_use]
    pub fn at_screen(self) -> Self {
        Self { remedy: "home it (H)".into(), ..self }
    }

    /// Checks that a program may move this machine.
    ///
    /// # Errors
    /// `E2162` with the axes that are not homed; `E2201` where the state cannot be stored.
    pub fn check(&self, machine: &MachineConfig) -> Result<(), NumberedError> {
        let Some(card) = self.card.as_ref().filter(|_| !axes_to_home(machine).is_empty()) else { return Ok(()) };
        let unhomed = HomedAxes::open_default()?.unhomed(card, machine);
        if unhomed.is_empty() {
            return Ok(());
        }
        let letters: Vec<String> = unhomed.iter().map(|axis| axis.to_ascii_uppercase().to_string()).collect();
        let (axes, were) = if letters.len() == 1 { ("axis", "was") } else { ("axes", "were") };
        let what = format!("{axes} {} {were} not homed since the card was switched on", letters.join(", "));
        Err(NumberedError::new("E2162", what, self.remedy.clone()))
    }

    /// Homing state of each axis.
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

    /// Performs a task; for homing, stores that it has started and that it is done.
    ///
    /// # Errors
    /// See `perform`; `E2105`, `E2201` where the homing state cannot be stored, unless nothing needs it.
    pub fn perform_and_record(
        &self,
        task: &ManualTask,
        machine: &MachineConfig,
        perform: impl FnOnce() -> Result<ManualTaskDone, ManualTaskError>,
    ) -> Result<ManualTaskDone, ManualTaskError> {
        let (ManualTask::Home(axis), Some(card)) = (task, &self.card) else { return perform() };
        let axes = axis.map_or_else(|| machine.homing_order().to_vec(), |axis| vec![axis.to_ascii_lowercase()]);
        let asked_for = !axes_to_home(machine).is_empty();
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
