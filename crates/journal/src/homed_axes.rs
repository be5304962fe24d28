//! The homed axes, recorded next to the folder of jobs for every command that opens the card.
//!
//! Invariant: an axis counts as homed only on the card where it was homed, since the start of that card, and while the
//! machine file has the same home for it. A record is written whole or not at all; one that cannot be read means that
//! nothing was homed.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use retrace_config::{MachineConfig, NumberedError};
use retrace_link::CardIdentity;
use serde::{Deserialize, Serialize};

use crate::job_store::JobStore;
use crate::state_file::{self, FileAccess};

const NOTES: &str = "homed.json";
const LOCK: &str = "homed.lock";
/// Number of cards that are remembered, the one homed last first.
const CARDS: usize = 64;

/// A card since it was switched on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CardBoot {
    name: String,
    serial: u32,
    boot: u32,
}

impl From<&CardIdentity> for CardBoot {
    fn from(identity: &CardIdentity) -> Self {
        let name = String::from_utf8_lossy(&identity.name).trim_end_matches('\0').to_owned();
        Self { name, serial: identity.serial, boot: identity.boot }
    }
}

/// An axis, and the home with which it was homed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct HomedAxis {
    axis: char,
    /// Position of the switch, its end, and the scale: with other values, counts mean something else.
    position_mm: f64,
    upper: bool,
    pulses_per_mm: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct HomedCard {
    #[serde(flatten)]
    card: CardBoot,
    axes: Vec<HomedAxis>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct HomedFile {
    cards: Vec<HomedCard>,
}

impl HomedFile {
    fn axes_of(&self, card: &CardBoot) -> &[HomedAxis] {
        self.cards.iter().find(|note| note.card == *card).map_or(&[], |note| &note.axes)
    }
}

/// The record of homed axes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HomedAxes {
    folder: PathBuf,
}

impl HomedAxes {
    /// The record of the user, independent of where a job's journal is: homing is a matter of the machine.
    ///
    /// # Errors
    /// `E2201` where the user has no folder for it.
    pub fn open_default() -> Result<Self, NumberedError> {
        let jobs = JobStore::open_or_default(None).map_err(|refusal| {
            let remedy = "set HOME or XDG_STATE_HOME: what was homed is noted there";
            NumberedError::new("E2201", refusal.cause, remedy)
        })?;
        let folder = jobs.folder();
        Ok(Self::open(folder.parent().unwrap_or(folder)))
    }

    /// The record in this folder, which need not exist yet.
    #[must_use]
    pub fn open(folder: &Path) -> Self {
        Self { folder: folder.to_owned() }
    }

    /// Letters of the axes of this machine that have to be homed before a program moves them and were not since this
    /// card was switched on, in the order of homing. Empty where the machine file lets programs move an unhomed
    /// machine.
    #[must_use]
    pub fn unhomed(&self, card: &CardBoot, machine: &MachineConfig) -> Vec<char> {
        let (notes, needed) = (self.read(), axes_to_home(machine));
        let homed = notes.axes_of(card);
        needed
            .iter()
            .copied()
            .filter(|&axis| axis_of(machine, axis).is_none_or(|axis| !homed.contains(&axis)))
            .collect()
    }

    /// Whether an axis was homed since this card was switched on. None where it has no home switch.
    #[must_use]
    pub fn is_homed(&self, card: &CardBoot, machine: &MachineConfig, letter: char) -> Option<bool> {
        let axis = axis_of(machine, letter)?;
        Some(self.read().axes_of(card).contains(&axis))
    }

    /// Records that these axes are about to be homed: until that is done they are not homed.
    ///
    /// # Errors
    /// `E2105`: it cannot be written.
    pub fn mark_unhomed(&self, card: &CardBoot, axes: &[char]) -> Result<(), NumberedError> {
        self.change(card, |homed| homed.retain(|axis| !axes.contains(&axis.axis)))
    }

    /// Records that these axes of this machine were homed.
    ///
    /// # Errors
    /// `E2105`: it cannot be written.
    pub fn mark_homed(&self, card: &CardBoot, machine: &MachineConfig, axes: &[char]) -> Result<(), NumberedError> {
        self.change(card, |homed| {
            homed.retain(|axis| !axes.contains(&axis.axis));
            homed.extend(axes.iter().filter_map(|&axis| axis_of(machine, axis)));
        })
    }

    fn read(&self) -> HomedFile {
        let text = fs::read(self.folder.join(NOTES)).unwrap_or_default();
        serde_json::from_slice(&text).unwrap_or_default()
    }

    /// Changes the record of a card, one process at a time.
    fn change(&self, card: &CardBoot, change: impl FnOnce(&mut Vec<HomedAxis>)) -> Result<(), NumberedError> {
        let change = || {
            state_file::create_private_folder(&self.folder)?;
            let lock = state_file::open_lock(&self.folder.join(LOCK))?;
            lock.lock()?;
            let mut notes = self.read();
            let mut note = HomedCard { card: card.clone(), axes: notes.axes_of(card).to_vec() };
            change(&mut note.axes);
            notes.cards.retain(|note| note.card != *card);
            notes.cards.insert(0, note);
            notes.cards.truncate(CARDS);
            self.write(&notes)
        };
        change().map_err(|error: io::Error| {
            let what = format!("{} cannot be written: {error}", self.folder.join(NOTES).display());
            NumberedError::new(
                "E2105",
                what,
                "check the folder's permissions and its disk: what was homed is noted there",
            )
        })
    }

    /// Writes the file whole or not at all.
    fn write(&self, notes: &HomedFile) -> io::Result<()> {
        let text = serde_json::to_vec_pretty(notes)?;
        state_file::replace(&self.folder.join(NOTES), &text, FileAccess::Private)
    }
}

/// Letters of the axes that have to be homed before a program moves the machine, in the order of homing.
#[must_use]
pub fn axes_to_home(machine: &MachineConfig) -> &[char] {
    if machine.setting_up.allow_unhomed { &[] } else { machine.needs_homing() }
}

/// An axis as this machine homes it. None where it does not.
fn axis_of(machine: &MachineConfig, letter: char) -> Option<HomedAxis> {
    let index = machine.axis_of(letter)?;
    let home = (*machine.setting_up.homes.get(index)?)?;
    let axis = machine.axes.get(index)?;
    Some(HomedAxis {
        axis: axis.name,
        position_mm: home.position_mm,
        upper: home.upper,
        pulses_per_mm: axis.pulses_per_mm,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const AXIS: &str = "pulses_per_mm = 400\nmax_velocity_mm_per_s = 100\nmax_acceleration_mm_per_s2 = 1000\n\
        max_jerk_mm_per_s3 = 20000\ntravel_mm = [0, 300]\nhome = { switch = \"lower\", position_mm = -2.5 }\n";

    fn machine(more: &str) -> MachineConfig {
        let text = format!(
            "[[axis]]\nname = \"x\"\n{AXIS}[[axis]]\nname = \"z\"\n{AXIS}[[card.input]]\nnumber = 1\nuse = \
                \"home\"\naxis = \"x\"\n\
             [[card.input]]\nnumber = 2\nuse = \"home\"\naxis = \"z\"\n{more}"
        );
        MachineConfig::parse(&text, "m.toml").expect("valid")
    }

    fn card(boot: u32) -> CardBoot {
        CardBoot { name: "card".into(), serial: 7, boot }
    }

    #[test]
    fn an_axis_is_homed_on_its_card_and_for_one_start_of_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let (homed, machine) = (HomedAxes::open(&folder.path().join("state")), machine(""));
        assert_eq!(homed.unhomed(&card(1), &machine), ['z', 'x']);
        homed.mark_homed(&card(1), &machine, &['x']).expect("noted");
        assert_eq!((homed.unhomed(&card(1), &machine), homed.unhomed(&card(2), &machine)), (vec!['z'], vec!['z', 'x']));
        homed.mark_homed(&card(1), &machine, &['z']).expect("noted");
        homed.mark_homed(&card(2), &machine, &['z']).expect("noted");
        assert_eq!((homed.unhomed(&card(1), &machine), homed.unhomed(&card(2), &machine)), (vec![], vec!['x']));
        for other in [CardBoot { serial: 8, ..card(1) }, CardBoot { name: "other".into(), ..card(1) }] {
            assert_eq!(homed.unhomed(&other, &machine), ['z', 'x'], "{other:?}");
        }
        let is_homed = |letter| homed.is_homed(&card(1), &machine, letter);
        assert_eq!(['x', 'z', 'y'].map(is_homed), [Some(true), Some(true), None]);
        homed.mark_unhomed(&card(1), &['z']).expect("noted");
        assert_eq!(['x', 'z', 'y'].map(is_homed), [Some(true), Some(false), None]);
        assert_eq!(homed.unhomed(&card(1), &machine), ['z'], "homing that has begun has not been done");
    }

    #[test]
    fn a_home_that_was_changed_is_not_the_one_that_was_found() {
        let folder = tempfile::tempdir().expect("a folder");
        let (homed, machine) = (HomedAxes::open(folder.path()), machine(""));
        homed.mark_homed(&card(1), &machine, &['x', 'z']).expect("noted");
        let mut moved = machine.clone();
        moved.setting_up.homes[0].as_mut().expect("a home").position_mm = -3.0;
        assert_eq!(homed.unhomed(&card(1), &moved), ['x']);
        let mut scaled = machine;
        scaled.axes[1].pulses_per_mm = 500.0;
        assert_eq!(homed.unhomed(&card(1), &scaled), ['z']);
    }

    #[test]
    fn the_machine_file_may_ask_for_less() {
        let homed = HomedAxes::open(Path::new("/nowhere"));
        assert_eq!(homed.unhomed(&card(1), &machine("[manual]\nallow_unhomed = true\n")), []);
        assert_eq!(homed.unhomed(&card(1), &MachineConfig::built_in().expect("valid")), []);
    }

    #[test]
    fn a_note_that_is_damaged_says_nothing_and_is_written_anew() {
        let folder = tempfile::tempdir().expect("a folder");
        let (homed, machine) = (HomedAxes::open(folder.path()), machine(""));
        homed.mark_homed(&card(1), &machine, &['x', 'z']).expect("noted");
        let path = folder.path().join(NOTES);
        let whole = fs::read(&path).expect("written");
        for end in 0..whole.len() {
            fs::write(&path, &whole[..end]).expect("cut");
            assert_eq!(homed.unhomed(&card(1), &machine), ['z', 'x'], "cut at {end}");
        }
        homed.mark_homed(&card(1), &machine, &['x', 'z']).expect("noted");
        assert_eq!(homed.unhomed(&card(1), &machine), []);
    }

    #[test]
    fn the_cards_homed_last_are_remembered() {
        let folder = tempfile::tempdir().expect("a folder");
        let (homed, machine) = (HomedAxes::open(folder.path()), machine(""));
        for boot in 0..=CARDS as u32 {
            homed.mark_homed(&card(boot), &machine, &['x', 'z']).expect("noted");
        }
        assert_eq!(homed.unhomed(&card(0), &machine), ['z', 'x']);
        assert_eq!(homed.unhomed(&card(1), &machine), []);
    }
}
