//! A shop job: so many pieces of one program for one machine, or for any machine of a group.
//!
//! Invariant: a job does not change after its submission, and each of its texts is one line of bounded length.

use std::fmt;

use retrace_config::NumberedError;
use retrace_journal::Timestamp;
use serde::{Deserialize, Serialize};

use crate::content_hash::ContentHash;
use crate::job_id::ShopJobId;
use crate::machine_name::MachineName;

/// Maximum number of pieces of a job.
const MAX_QUANTITY: u32 = 100_000;
/// Maximum length of order number, note, material and submitter, in bytes.
const MAX_TEXT_BYTES: usize = 1000;

/// A job as it was submitted (SHP-8).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "ShopJobText", into = "ShopJobText")]
pub struct ShopJob {
    /// Identity, made by the submitter.
    pub id: ShopJobId,
    /// Hash of the bundle's JSON text.
    pub bundle: ContentHash,
    /// Machine or group that it is for.
    pub target: JobTarget,
    /// Number of pieces, at least 1.
    pub quantity: u32,
    /// Whether the operator may start several pieces at once, one after the other (SHP-15).
    pub may_repeat: bool,
    /// Number of the office's order, as text; may be empty.
    pub order_number: String,
    /// Text for the operator; may be empty.
    pub note: String,
    /// The material, as text; may be empty.
    pub material: String,
    /// Who sent it: a user's name, or the folder that was watched.
    pub submitter: String,
    /// The machine file that it was made for.
    pub machine_file: Option<MachineFileDemand>,
    /// Time of its submission in UTC, by the submitter's clock.
    pub submitted: Timestamp,
}

/// What a job is for.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JobTarget {
    /// One machine.
    Machine(MachineName),
    /// Any machine of this group.
    Group(MachineName),
}

impl fmt::Display for JobTarget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Machine(name) => write!(f, "machine {name}"),
            Self::Group(name) => write!(f, "group {name}"),
        }
    }
}

/// The JSON text of a job.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ShopJobText {
    id: ShopJobId,
    bundle: ContentHash,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    machine: Option<MachineName>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    group: Option<MachineName>,
    quantity: u32,
    #[serde(default, skip_serializing_if = "is_false")]
    may_repeat: bool,
    #[serde(default, skip_serializing_if = "String::is_empty")]
    order_number: String,
    #[serde(default, skip_serializing_if = "String::is_empty")]
    note: String,
    #[serde(default, skip_serializing_if = "String::is_empty")]
    material: String,
    #[serde(default, skip_serializing_if = "String::is_empty")]
    submitter: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    machine_file: Option<MachineFileDemand>,
    submitted: Timestamp,
}

fn is_false(value: &bool) -> bool {
    !value
}

impl TryFrom<ShopJobText> for ShopJob {
    type Error = &'static str;

    fn try_from(text: ShopJobText) -> Result<Self, Self::Error> {
        let target = match (text.machine, text.group) {
            (Some(name), None) => JobTarget::Machine(name),
            (None, Some(name)) => JobTarget::Group(name),
            _ => return Err("a job is for a machine or for a group"),
        };
        let ShopJobText { id, bundle, quantity, may_repeat, order_number, .. } = text;
        let ShopJobText { note, material, submitter, machine_file, submitted, .. } = text;
        Ok(Self {
            id,
            bundle,
            target,
            quantity,
            may_repeat,
            order_number,
            note,
            material,
            submitter,
            machine_file,
            submitted,
        })
    }
}

impl From<ShopJob> for ShopJobText {
    fn from(job: ShopJob) -> Self {
        let (machine, group) = match job.target {
            JobTarget::Machine(name) => (Some(name), None),
            JobTarget::Group(name) => (None, Some(name)),
        };
        let ShopJob { id, bundle, quantity, may_repeat, order_number, .. } = job;
        let ShopJob { note, material, submitter, machine_file, submitted, .. } = job;
        Self {
            id,
            bundle,
            machine,
            group,
            quantity,
            may_repeat,
            order_number,
            note,
            material,
            submitter,
            machine_file,
            submitted,
        }
    }
}

/// The machine file that a job was made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MachineFileDemand {
    /// Hash of its text.
    pub hash: ContentHash,
    /// Whether the job may run with this file only; otherwise another one is a warning.
    pub is_required: bool,
}

impl ShopJob {
    /// Checks quantity and texts.
    ///
    /// # Errors
    /// `E5006` for a quantity out of range, or a text that is too long or has control characters.
    pub fn check(&self) -> Result<(), NumberedError> {
        let refuse = |what: String| Err(NumberedError::new("E5006", what, "correct it and submit the job again"));
        if !(1..=MAX_QUANTITY).contains(&self.quantity) {
            return refuse(format!("a job has 1 to {MAX_QUANTITY} pieces, not {}", self.quantity));
        }
        let texts = [
            ("order number", &self.order_number),
            ("note", &self.note),
            ("material", &self.material),
            ("submitter", &self.submitter),
        ];
        for (name, text) in texts {
            if text.len() > MAX_TEXT_BYTES || text.chars().any(char::is_control) {
                return refuse(format!(
                    "the {name} of a job is one line of at most {MAX_TEXT_BYTES} bytes without control characters"
                ));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A job of this number and bundle, for the machine `local`.
    pub(crate) fn job(number: u64, bundle: ContentHash) -> ShopJob {
        ShopJob {
            id: ShopJobId::from_parts(number, [7; 10]),
            bundle,
            target: JobTarget::Machine(MachineName::local()),
            quantity: 1,
            may_repeat: false,
            order_number: String::new(),
            note: String::new(),
            material: String::new(),
            submitter: "ann".into(),
            machine_file: None,
            submitted: Timestamp::from_ms(number),
        }
    }

    #[test]
    fn quantity_and_texts_are_bounded() {
        let good = job(1, ContentHash::of(b""));
        good.check().expect("good");
        let json = serde_json::to_string(&good).expect("json");
        assert_eq!(serde_json::from_str::<ShopJob>(&json).expect("a job"), good);
        let group = ShopJob { target: JobTarget::Group(MachineName::local()), ..good.clone() };
        let json = serde_json::to_string(&group).expect("json");
        assert_eq!(serde_json::from_str::<ShopJob>(&json).expect("a job"), group);
        let both = json.replace("\"group\"", "\"machine\":\"mill\",\"group\"");
        assert!(both != json && serde_json::from_str::<ShopJob>(&both).is_err());
        assert!(serde_json::from_str::<ShopJob>(&json.replace("\"group\":\"local\",", "")).is_err());
        assert!(serde_json::from_str::<ShopJob>(&json.replace("\"group\"", "\"grp\"")).is_err());
        for bad in [
            ShopJob { quantity: 0, ..good.clone() },
            ShopJob { quantity: MAX_QUANTITY + 1, ..good.clone() },
            ShopJob { order_number: "4711\r".into(), ..good.clone() },
            ShopJob { note: "x".repeat(1001), ..good.clone() },
            ShopJob { material: "a\u{1b}[2J".into(), ..good.clone() },
            ShopJob { submitter: "a\nb".into(), ..good.clone() },
        ] {
            assert_eq!(bad.check().expect_err("bad").number, "E5006");
        }
    }

    #[test]
    fn a_job_of_before_the_order_number_is_read_and_written_as_it_was() {
        let old = r#"{"id":"00000000-0001-7707-8707-070707070707","bundle":"HASH","machine":"local","quantity":2,"#;
        let old = format!("{old}\"note\":\"n\",\"submitted\":\"1970-01-01T00:00:00.001Z\"}}");
        let old = old.replace("HASH", &ContentHash::of(b"").to_string());
        let read: ShopJob = serde_json::from_str(&old).expect("a job");
        assert_eq!((read.order_number.as_str(), read.note.as_str(), read.quantity), ("", "n", 2));
        assert_eq!(serde_json::to_string(&read).expect("json"), old);
        let ordered = ShopJob { order_number: "4711/2".into(), ..read };
        let json = serde_json::to_string(&ordered).expect("json");
        assert!(json.contains(r#""order_number":"4711/2""#), "{json}");
        assert_eq!(serde_json::from_str::<ShopJob>(&json).expect("a job"), ordered);
    }
}
