//! Doubt about the kind of a cutter: its name, or the rest of its table, is that of another kind.
//!
//! Invariant: a doubt is told, and refuses nothing: names are free.

use crate::cutter::{CutterConfig, CutterKind};

/// Parts of names that a torch, a jet or a beam has.
const NAMES_OF_CUTTERS: [&str; 5] = ["torch", "plasma", "jet", "laser", "beam"];

/// Parts of names that a spindle has.
const NAMES_OF_SPINDLES: [&str; 2] = ["spindle", "router"];

/// Why the kind of a cutter does not fit the rest of its table, if so.
pub(crate) fn doubt_of_kind(cutter: &CutterConfig) -> Option<String> {
    let name = cutter.name.to_lowercase();
    let has_name_of = |words: &[&str]| words.iter().any(|word| name.contains(word));
    let (cuts, spins) = (has_name_of(&NAMES_OF_CUTTERS), has_name_of(&NAMES_OF_SPINDLES));
    let kind = format!("{:?}", cutter.kind).to_lowercase();
    if cutter.kind.cuts_at_rest() {
        return (spins && !cuts).then(|| format!("kind = \"{kind}\", and the name is that of a spindle"));
    }
    if cutter.materials.is_some() {
        return Some(format!("kind = \"{kind}\" has a material table, as a torch, a jet or a beam has"));
    }
    let is_spindle = cutter.kind == CutterKind::Spindle;
    if let Some((_, what)) = cutter.auxiliaries().next().filter(|_| is_spindle) {
        return Some(format!("kind = \"{kind}\" has `{what}`, as a torch, a jet or a beam has"));
    }
    (is_spindle && cuts && !spins).then(|| format!("kind = \"{kind}\", and the name is that of a cutter"))
}

#[cfg(test)]
mod tests {
    use crate::MachineConfig;

    #[test]
    fn a_kind_that_does_not_fit_the_rest_of_the_table_is_doubtful() {
        let doubt = |name: &str, kind: &str, more: &str| {
            let text = format!("[[cutter]]\nname = \"{name}\"\nkind = \"{kind}\"\nfire = 64\n{more}\n");
            let machine = MachineConfig::parse(&text, "m.toml").expect("valid");
            let doubts = machine.cutters_of_doubtful_kind();
            doubts.first().map(|(_, why)| why.clone()).unwrap_or_default()
        };
        for (name, kind, more, why) in [
            ("torch", "spindle", "", "the name is that of a cutter"),
            ("Plasma", "spindle", "", "the name is that of a cutter"),
            ("Router", "torch", "", "the name is that of a spindle"),
            ("tool", "spindle", "materials = \"m.toml\"", "has a material table"),
            ("scribe", "marker", "materials = \"m.toml\"", "has a material table"),
            ("tool", "spindle", "assist = 3", "`assist`"),
        ] {
            assert!(doubt(name, kind, more).contains(why), "{name} {kind} {more}: {}", doubt(name, kind, more));
        }
        for (name, kind, more) in [
            ("torch", "torch", "materials = \"m.toml\"\narm = 3"),
            ("router", "spindle", ""),
            ("laser spindle", "beam", ""),
            ("tool", "jet", "abrasive = 3"),
            ("scribe", "marker", "arm = 3"),
        ] {
            assert_eq!(doubt(name, kind, more), "");
        }
    }
}
