//! The folder into which a CAM program writes: which of its files are offered on the pages.
//!
//! Invariant: what was there before is not offered, nor what is still being written; nothing is loaded or started here.

use std::collections::HashMap;

use serde::Serialize;

use crate::programs::StoredProgram;

/// Size and time of a file, which change while it is written.
type Stamp = (u64, u64);

/// A program that is offered.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct OfferView {
    t: &'static str,
    name: String,
    bytes: u64,
}

/// State of the folder.
#[derive(Debug, Default)]
pub(crate) struct WatchedFolder {
    /// Files as they were at the last poll, and whether they are known: there from the beginning, or offered.
    files: Option<HashMap<String, (Stamp, bool)>>,
}

impl WatchedFolder {
    /// Looks at what is in the folder now. Returns the newest program that is new and whole.
    pub(crate) fn poll(&mut self, listed: &[StoredProgram]) -> Option<OfferView> {
        let stamp = |program: &StoredProgram| (program.bytes, program.modified_s);
        let Some(before) = self.files.take() else {
            let known = listed.iter().map(|program| (program.name.clone(), (stamp(program), true)));
            self.files = Some(known.collect());
            return None;
        };
        let mut now = HashMap::with_capacity(listed.len());
        let mut offered: Option<&StoredProgram> = None;
        for program in listed {
            let stamp = stamp(program);
            let (stays, was_known) =
                before.get(&program.name).map_or((false, false), |&(old, is_known)| (old == stamp, is_known));
            // A file that has no more grown since the last poll is whole.
            let is_whole = stays && program.bytes > 0;
            if is_whole && !was_known && offered.is_none_or(|other| other.modified_s <= program.modified_s) {
                offered = Some(program);
            }
            now.insert(program.name.clone(), (stamp, is_whole || stays && was_known));
        }
        self.files = Some(now);
        offered.map(|program| OfferView { t: "offer", name: program.name.clone(), bytes: program.bytes })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn program(name: &str, bytes: u64, modified_s: u64) -> StoredProgram {
        StoredProgram { name: name.into(), bytes, modified_s, is_watched: true }
    }

    #[test]
    fn a_new_file_is_offered_once_when_it_is_whole() {
        let mut folder = WatchedFolder::default();
        let old = program("old.ngc", 10, 1);
        let name = |offer: Option<OfferView>| offer.map(|offer| offer.name);
        assert_eq!(folder.poll(std::slice::from_ref(&old)), None, "it was there before");
        assert_eq!(folder.poll(std::slice::from_ref(&old)), None);
        assert_eq!(folder.poll(&[old.clone(), program("new.ngc", 5, 7)]), None, "it may still grow");
        assert_eq!(folder.poll(&[old.clone(), program("new.ngc", 9, 7)]), None, "it has grown");
        assert_eq!(name(folder.poll(&[old.clone(), program("new.ngc", 9, 7)])), Some("new.ngc".into()));
        assert_eq!(folder.poll(&[old.clone(), program("new.ngc", 9, 7)]), None, "once");
        // Written again, it is offered again; an empty file never.
        let again = [program("old.ngc", 11, 9), program("new.ngc", 9, 7), program("empty.ngc", 0, 9)];
        assert_eq!(folder.poll(&again), None);
        assert_eq!(name(folder.poll(&again)), Some("old.ngc".into()));
        assert_eq!(folder.poll(&again), None);
    }
}
