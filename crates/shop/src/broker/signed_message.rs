//! Messages of submitters, each signed with the submitter's key (SHP-26).
//!
//! What is signed is the exact text of the message, which says for whom it is. A machine takes a message only from a
//! key that its shop file names.
//!
//! Invariant: nothing of a message is used before its signature was verified.

use std::collections::BTreeMap;

use nkeys::KeyPair;
use retrace_config::NumberedError;
use serde::{Deserialize, Serialize};

use crate::job::{JobTarget, ShopJob};
use crate::job_id::ShopJobId;

/// Begins every text that is signed, so that a signature is valid for messages of a shop only.
const PURPOSE: &[u8] = b"retrace shop message 1\n";
/// Maximum length of a signed message in bytes.
pub(crate) const MAX_MESSAGE_BYTES: usize = 64 << 10;
/// Maximum length of a text to the operator in bytes.
const MAX_SAY_BYTES: usize = 1000;

/// What a submitter sends.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum ShopMessage {
    /// A job.
    Job {
        /// The job.
        job: Box<ShopJob>,
    },
    /// The machine is to give a job back, if it is neither running nor interrupted (SHP-14).
    Recall {
        /// Machine that has the job, or that is to have it.
        target: JobTarget,
        /// Identity of the message, so that it is obeyed once.
        id: ShopJobId,
        /// The job.
        job: ShopJobId,
        /// Machine or group that the job was for.
        job_target: JobTarget,
    },
    /// A text for the operator (SHP-13).
    Say {
        /// The machine, or the machines of a group.
        target: JobTarget,
        /// Identity of the text, so that it is shown once.
        id: ShopJobId,
        /// The text: one line.
        text: String,
    },
}

impl ShopMessage {
    /// For whom it is.
    #[must_use]
    pub fn target(&self) -> JobTarget {
        match self {
            Self::Job { job } => job.target.clone(),
            Self::Recall { target, .. } | Self::Say { target, .. } => target.clone(),
        }
    }

    /// Identity, by which the broker drops a message that is sent again within its time for duplicates.
    #[must_use]
    pub fn message_id(&self) -> String {
        match self {
            Self::Job { job } => format!("job {}", job.id),
            Self::Recall { id, .. } => format!("recall {id}"),
            Self::Say { id, .. } => format!("say {id}"),
        }
    }

    fn check(&self) -> Result<(), NumberedError> {
        match self {
            Self::Job { job } => job.check(),
            Self::Recall { .. } => Ok(()),
            Self::Say { text, .. } if text.len() <= MAX_SAY_BYTES && !text.chars().any(char::is_control) => Ok(()),
            Self::Say { .. } => {
                let what = format!("a text for the operator is one line of at most {MAX_SAY_BYTES} bytes");
                Err(NumberedError::new("E5006", what, "shorten it"))
            }
        }
    }
}

/// A message with the signature of its sender.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SignedText {
    /// JSON text of the message.
    message: String,
    /// Public key of the sender.
    key: String,
    /// Signature, 128 hexadecimal digits.
    signature: String,
}

/// Signs a message. Returns the JSON text that is sent.
///
/// # Errors
/// `E5006` for a message with wrong texts, `E5036` where the key cannot sign.
pub(crate) fn sign(message: &ShopMessage, key: &KeyPair) -> Result<String, NumberedError> {
    message.check()?;
    let unusable = |why: String| NumberedError::new("E5036", why, "make a new seed with `retrace shop key --new FILE`");
    let text = serde_json::to_string(message).map_err(|error| unusable(error.to_string()))?;
    let signature = key.sign(&signed_bytes(&text)).map_err(|error| unusable(error.to_string()))?;
    let signature = signature.iter().map(|byte| format!("{byte:02x}")).collect();
    let signed = SignedText { message: text, key: key.public_key(), signature };
    serde_json::to_string(&signed).map_err(|error| unusable(error.to_string()))
}

/// Verifies a signed message against the public keys of the submitters. Returns it with the name of its sender.
///
/// # Errors
/// `E5037` where it is not signed by one of them, or is not a message; `E5006` where its texts are wrong.
pub(crate) fn verify(
    bytes: &[u8],
    submitters: &BTreeMap<String, String>,
) -> Result<(ShopMessage, String), NumberedError> {
    let refuse = |why: &str| {
        let what = format!("a message of the broker is refused: {why}");
        let remedy = "if its sender may send jobs to this machine, name the sender's public key in [broker.submitters]";
        NumberedError::new("E5037", what, remedy)
    };
    if bytes.len() > MAX_MESSAGE_BYTES {
        return Err(refuse("it is too long"));
    }
    let signed: SignedText = serde_json::from_slice(bytes).map_err(|_| refuse("it is not signed"))?;
    let name = submitters.get(&signed.key).ok_or_else(|| {
        let key: String = signed.key.chars().filter(char::is_ascii_alphanumeric).take(56).collect();
        refuse(&format!("its key {key} is not that of a submitter of this machine"))
    })?;
    let key = KeyPair::from_public_key(&signed.key).map_err(|_| refuse("its key is not one"))?;
    let signature = bytes_of(&signed.signature).ok_or_else(|| refuse("its signature is not one"))?;
    key.verify(&signed_bytes(&signed.message), &signature)
        .map_err(|_| refuse(&format!("its signature is not that of {name}")))?;
    let message: ShopMessage = serde_json::from_str(&signed.message)
        .map_err(|error| refuse(&format!("{name} has sent what this version cannot read: {error}")))?;
    message.check()?;
    Ok((message, name.clone()))
}

fn signed_bytes(text: &str) -> Vec<u8> {
    [PURPOSE, text.as_bytes()].concat()
}

fn bytes_of(hexadecimal: &str) -> Option<Vec<u8>> {
    if hexadecimal.len() != 128 || !hexadecimal.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        return None;
    }
    (0..64).map(|number| u8::from_str_radix(&hexadecimal[2 * number..2 * number + 2], 16).ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::content_hash::ContentHash;
    use crate::job::tests::job;
    use crate::machine_name::MachineName;
    use proptest::prelude::*;

    fn submitters(key: &KeyPair) -> BTreeMap<String, String> {
        BTreeMap::from([(key.public_key(), "office".into())])
    }

    fn message(number: u64) -> ShopMessage {
        let job = ShopJob { order_number: "4711/2".into(), ..job(number, ContentHash::of(b"")) };
        ShopMessage::Job { job: Box::new(job) }
    }

    #[test]
    fn a_message_of_a_named_submitter_is_read_and_one_of_another_refused() {
        let (office, other) = (KeyPair::new_user(), KeyPair::new_user());
        for message in [
            message(1),
            ShopMessage::Recall {
                target: JobTarget::Group(MachineName::local()),
                id: job(1, ContentHash::of(b"")).id,
                job: job(2, ContentHash::of(b"")).id,
                job_target: JobTarget::Group(MachineName::local()),
            },
            ShopMessage::Say {
                target: JobTarget::Machine(MachineName::local()),
                id: job(1, ContentHash::of(b"")).id,
                text: "material is late".into(),
            },
        ] {
            let sent = sign(&message, &office).expect("signed");
            assert_eq!(verify(sent.as_bytes(), &submitters(&office)), Ok((message.clone(), "office".into())));
            assert_eq!(verify(sent.as_bytes(), &submitters(&other)).expect_err("another").number, "E5037");
            let forged = sent.replace(&office.public_key(), &other.public_key());
            assert_eq!(verify(forged.as_bytes(), &submitters(&other)).expect_err("forged").number, "E5037");
        }
        let long = ShopMessage::Say {
            target: JobTarget::Machine(MachineName::local()),
            id: job(1, ContentHash::of(b"")).id,
            text: "x".repeat(1001),
        };
        assert_eq!(sign(&long, &office).expect_err("long").number, "E5006");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]

        /// Whichever byte is changed, the message is refused.
        #[test]
        fn no_changed_byte_is_accepted(number in 0_u64..1 << 40, at in any::<prop::sample::Index>(), by in 1_u8..255) {
            let key = KeyPair::new_user();
            let mut sent = sign(&message(number), &key).expect("signed").into_bytes();
            let at = at.index(sent.len());
            sent[at] ^= by;
            match verify(&sent, &submitters(&key)) {
                Err(refusal) => prop_assert_eq!(refusal.number, "E5037"),
                // the case of a hexadecimal digit of the signature
                Ok((read, _)) => prop_assert!(by == 0x20 && read == message(number)),
            }
        }

        #[test]
        fn random_bytes_are_refused(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            prop_assert_eq!(verify(&bytes, &BTreeMap::new()).expect_err("random").number, "E5037");
        }
    }
}
