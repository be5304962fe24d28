//! The two folders (PRE-1): what is loaded from each, and what is never run.
//!
//! Invariant: every test has folders of its own, which are removed when it ends.

use crate::common;

use common::{Recorder, run};
use retrace_cycles::{CycleLibrary, ErrorCode, Folders, Origin, shipped_source};
use std::path::{Path, PathBuf};

/// Two folders that exist only as long as the value.
struct Place(PathBuf);

impl Place {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("retrace-cycles-{}-{name}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(path.join("sources")).expect("a folder");
        Self(path)
    }

    fn write(&self, name: &str, text: &str) {
        std::fs::write(self.0.join("sources").join(name), text).expect("a file");
    }

    fn compiled(&self, name: &str) -> PathBuf {
        self.0.join("compiled").join(name)
    }

    fn open(&self) -> CycleLibrary {
        let (sources, compiled) = (self.0.join("sources"), self.0.join("compiled"));
        CycleLibrary::open(Folders { sources: Some(&sources), compiled: Some(&compiled) })
    }

    fn codes(&self) -> Vec<ErrorCode> {
        self.open().findings().iter().map(|finding| finding.diagnostic.code).collect()
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn says(library: &CycleLibrary, call: &str) -> Vec<String> {
    let mut host = Recorder::default();
    assert_eq!(run(library, call, &mut host), Ok(()), "{call}");
    host.messages
}

fn was_fresh(library: &CycleLibrary, name: &str) -> bool {
    library.find(name).and_then(|id| library.get(id)).expect(name).is_from_cache()
}

#[test]
fn shipped_cycles_have_no_fault_and_can_be_shown() {
    let library = CycleLibrary::shipped();
    assert_eq!(library.findings(), []);
    let names: Vec<&str> = library.iter().map(|(_, cycle)| cycle.name()).collect();
    let expected = [
        "CYCLE81", "CYCLE82", "CYCLE83", "CYCLE84", "CYCLE85", "CYCLE86", "CYCLE87", "CYCLE88", "CYCLE89", "CYCLE95",
        "HOLES1", "HOLES2",
    ];
    assert_eq!(names, expected);
    for (id, cycle) in library.iter() {
        assert!(cycle.saves() && cycle.origin() == Origin::Shipped && shipped_source(cycle.name()).is_some());
        assert_eq!(library.find(&cycle.name().to_lowercase()), Some(id));
        assert_eq!(cycle.is_pattern(), cycle.name().starts_with("HOLES"));
    }
    assert_eq!((library.find("CYCLE8"), library.find(""), library.find("CYCLE811")), (None, None, None));
    let head = library.find("CYCLE81").and_then(|id| library.get(id)).map(ToString::to_string);
    assert_eq!(head.as_deref(), Some("CYCLE81(REAL RTP, REAL RFP, REAL SDIS, REAL DP, REAL DPR)"));
}

#[test]
fn missing_folders_are_no_error() {
    let nowhere = Path::new("nowhere/at/all");
    let library = CycleLibrary::open(Folders { sources: Some(nowhere), compiled: None });
    assert_eq!((library.findings(), library.iter().count()), (&[][..], 12));
}

#[test]
fn a_form_is_compiled_once_and_taken_while_its_source_is_the_same() {
    let place = Place::new("once");
    place.write("mine.spf", "MSG(\"first\")");
    let first = place.open();
    assert!(!was_fresh(&first, "MINE") && !was_fresh(&first, "CYCLE81") && place.compiled("MINE.CYC").exists());
    let second = place.open();
    assert!(was_fresh(&second, "MINE") && was_fresh(&second, "CYCLE95"));
    assert_eq!((says(&second, "MINE"), first.identity() == second.identity()), (vec!["first".to_owned()], true));
    // A change is detected, even one that keeps length and time.
    place.write("mine.spf", "MSG(\"secon\")");
    let third = place.open();
    assert!(!was_fresh(&third, "MINE") && was_fresh(&third, "CYCLE81") && third.findings().is_empty());
    assert_eq!((says(&third, "MINE"), third.identity() == first.identity()), (vec!["secon".to_owned()], false));
}

#[test]
fn a_form_that_is_torn_or_of_another_source_is_never_run() {
    let place = Place::new("torn");
    place.write("AA.SPF", "MSG(\"a\")");
    place.write("BB.SPF", "MSG(\"b\")");
    place.open();
    // Of another source: complete, but with another key.
    std::fs::copy(place.compiled("BB.CYC"), place.compiled("AA.CYC")).expect("copied");
    let library = place.open();
    assert_eq!((says(&library, "AA"), was_fresh(&library, "AA")), (vec!["a".to_owned()], false));
    // Torn in the middle, empty, and a byte changed.
    let whole = std::fs::read(place.compiled("AA.CYC")).expect("read");
    for spoil in [0, 1, 2] {
        let mut bytes = whole.clone();
        match spoil {
            0 => bytes.truncate(whole.len() / 2),
            1 => bytes.clear(),
            _ => bytes[whole.len() / 2] ^= 1,
        }
        std::fs::write(place.compiled("AA.CYC"), bytes).expect("written");
        let library = place.open();
        assert_eq!(says(&library, "AA"), ["a"], "{spoil}");
        assert_eq!(library.findings()[0].diagnostic.code, ErrorCode::StoredTorn, "{spoil}");
        assert_eq!(place.codes(), [], "repaired");
    }
}

#[test]
fn a_users_cycle_takes_the_place_of_a_shipped_one() {
    let place = Place::new("replaced");
    place.write("CYCLE81.SPF", "PROC CYCLE81(REAL AA)\nMSG(\"mine\" << AA)");
    let library = place.open();
    assert_eq!(
        (says(&library, "CYCLE81(7)"), place.codes()),
        (vec!["mine7".to_owned()], vec![ErrorCode::ShippedReplaced])
    );
    assert_eq!(library.iter().count(), 12);
    // One with an error is not called, and the shipped one does not replace it.
    place.write("CYCLE81.SPF", "PROC CYCLE81(REAL AA)\nMSG(");
    let library = place.open();
    assert_eq!((library.find("CYCLE81"), library.iter().count()), (None, 11));
}

#[test]
fn warnings_come_again_with_a_fresh_form() {
    let place = Place::new("warnings");
    place.write("FILE.SPF", "PROC OTHER(REAL X)\nMSG(X)");
    let expected = [ErrorCode::NameDiffers, ErrorCode::NameIsAddress];
    assert_eq!((place.codes(), place.codes()), (expected.to_vec(), expected.to_vec()));
    assert!(was_fresh(&place.open(), "OTHER"));
}

#[test]
fn names_that_clash_and_calls_that_lead_nowhere_are_refused() {
    let place = Place::new("clash");
    place.write("AA.SPF", "PROC SAME\nMSG(\"a\")");
    place.write("SAME.SPF", "MSG(\"b\")");
    place.write("CALLER.SPF", "CALLED");
    place.write("CALLED.SPF", "MISSING(1)");
    let library = place.open();
    let found: Vec<_> = library
        .findings()
        .iter()
        .map(|finding| {
            (finding.source.file_name().and_then(|name| name.to_str()).unwrap_or_default(), finding.diagnostic.code)
        })
        .collect();
    let expected = [
        ("AA.SPF", ErrorCode::NameDiffers),
        ("CALLED.SPF", ErrorCode::CycleUnknown),
        ("CALLER.SPF", ErrorCode::CycleUnknown),
        ("SAME.SPF", ErrorCode::CycleTwice),
    ];
    assert_eq!(found, expected);
    assert_eq!((says(&library, "SAME"), library.find("CALLER")), (vec!["a".to_owned()], None));
}

#[test]
fn a_folder_that_cannot_be_written_is_told_and_nothing_is_lost() {
    let place = Place::new("unwritable");
    place.write("AA.SPF", "MSG(\"a\")");
    // A file exists in place of the folder.
    std::fs::write(place.0.join("compiled"), "").expect("a file");
    let library = place.open();
    assert!(library.findings().iter().all(|finding| finding.diagnostic.code == ErrorCode::NotStored));
    assert_eq!((library.findings().len(), says(&library, "AA")), (13, vec!["a".to_owned()]));
}

#[test]
fn a_cycle_that_no_program_can_call_is_an_error() {
    for name in ["M7", "X1Y2", "N1AB", "MCALLS", "END1"] {
        let source = format!("PROC {name}\nG0 X1\nRET\n");
        let library = retrace_cycles::CycleLibrary::of_sources(&[("A.SPF", &source)]);
        let found: Vec<_> = library.findings().iter().map(|finding| finding.diagnostic.number()).collect();
        assert!(library.find(name).is_none() && found.contains(&"E1947"), "{name}: {found:?}");
    }
}
