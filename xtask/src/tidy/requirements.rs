//! Every requirement number cited in code or documents exists.

use super::Finding;
use crate::tree::{Tree, is_word};

/// Each family of requirements and its last number; all begin at 1.
const FAMILIES: &[(&str, u32)] = &[("REV", 14), ("GMC", 7), ("DNC", 12), ("SMO", 10), ("PRE", 9)];

pub(super) fn find(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (path, text) in tree.texts() {
        for (index, line) in text.lines().enumerate() {
            for (family, number) in citations(line) {
                let last = FAMILIES.iter().find(|(name, _)| *name == family).map_or(0, |(_, last)| *last);
                if number == 0 || number > last {
                    let message = format!("{family}-{number} does not exist; the last of its kind is {family}-{last}");
                    findings.push(Finding::at(path, index + 1, message));
                }
            }
        }
    }
    findings
}

/// Every `REV-6` and the like in a line.
fn citations(line: &str) -> Vec<(&'static str, u32)> {
    let mut found = Vec::new();
    for (family, _) in FAMILIES {
        for (at, _) in line.match_indices(family) {
            let stands_alone = at == 0 || !is_word(line.as_bytes()[at - 1]);
            let Some(rest) = line[at + family.len()..].strip_prefix('-') else { continue };
            let digits = &rest[..rest.bytes().take_while(u8::is_ascii_digit).count()];
            if let (true, Ok(number)) = (stands_alone, digits.parse()) {
                found.push((*family, number));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_out_of_range_is_refused() {
        let dash = "-";
        let text =
            format!("REV{dash}14, REV{dash}15\nSMO{dash}0 and (GMC{dash}7)\nXREV{dash}99 REV{dash}x PRE{dash}10\n");
        let found: Vec<_> = find(&Tree::of(&[("a.rs", &text)])).iter().map(|finding| finding.line).collect();
        assert_eq!(found, [1, 2, 3]);
    }
}
