//! Unsafe code stands in the record ring and where the firmware reaches a register, and the compiler is told so in
//! every other crate.

use super::Finding;
use retrace_task_support::tree::{Tree, code_only, words};

/// The files that may hold unsafe code: the ring, whose cells two threads share, their memory, and the modules of the
/// firmware that turn addresses into registers, which no safe code can do; everything above it is safe.
const ALLOWED: &[&str] = &[
    "crates/core/src/ring.rs",
    "crates/core/src/ring_storage.rs",
    "crates/firmware/src/board/processor.rs",
    "crates/firmware/src/board/rp2040/registers.rs",
    "crates/firmware/src/board/stm32f4/registers.rs",
];
/// The files that may hold the keyword in declarations: the imports and exports of a wasm module, compiled for a proof
/// alone.
const DECLARE: &[&str] = &["verification/src/choice.rs", "verification/src/harness.rs"];
/// The crates' roots that may not forbid it, because they compile one of them.
const HOLDERS: &[&str] =
    &["crates/core/", "verification/loom/", "verification/shuttle/", "crates/firmware/src/main.rs"];
const KEYWORD: &str = "unsafe";
const FORBID: &str = "#![forbid(unsafe_code)]";
/// The same for the crate with those declarations.
const FORBID_NATIVELY: &str = "#![cfg_attr(not(verify_wasm), forbid(unsafe_code))]";
const DECLARER: &str = "verification/src/lib.rs";

pub(super) fn find(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (path, text) in tree.rust().filter(|(path, _)| !ALLOWED.contains(path)) {
        for (index, line) in code_only(text).lines().enumerate() {
            let declares = DECLARE.contains(&path)
                && (line.contains("unsafe extern")
                    || line.contains("#[unsafe(export_name")
                    || line.contains("#[unsafe(no_mangle)]"));
            if words(line, KEYWORD).next().is_some() && !declares {
                findings.push(Finding::at(path, index + 1, "unsafe code is kept to the record ring and the registers"));
            }
        }
        let is_root = path.ends_with("src/lib.rs") || path.ends_with("src/main.rs") || path.contains("/src/bin/");
        let forbid = if path == DECLARER { FORBID_NATIVELY } else { FORBID };
        if is_root
            && !HOLDERS.iter().any(|holder| path.starts_with(holder))
            && !text.lines().any(|line| line.trim() == forbid)
        {
            findings.push(Finding::of_file(path, format!("a crate's root carries `{forbid}`")));
        }
    }
    findings
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_keyword_is_refused_outside_the_ring_and_allowed_in_words_and_comments() {
        let sample = "//! x\n// unsafe\nfn f() { unsafe { g() } }\n#![deny(unsafe_code)]\n";
        let tree = Tree::of(&[("crates/link/src/a.rs", sample), ("crates/core/src/ring.rs", sample)]);
        assert_eq!(
            find(&tree),
            [Finding::at("crates/link/src/a.rs", 3, "unsafe code is kept to the record ring and the registers")]
        );
    }

    #[test]
    fn declarations_for_a_proof_are_no_unsafe_code_and_a_block_beside_them_is() {
        let sample = "unsafe extern \"C\" {}\n$(#[unsafe(export_name = 1)] fn f() {})*\nunsafe { g() }\n";
        let tree = Tree::of(&[("verification/src/harness.rs", sample), ("verification/src/ring.rs", sample)]);
        let lines: Vec<_> = find(&tree).iter().map(|finding| finding.line).collect();
        assert_eq!(lines, [3, 1, 2, 3]);
        let tree =
            Tree::of(&[("verification/src/lib.rs", FORBID_NATIVELY), ("crates/link/src/lib.rs", FORBID_NATIVELY)]);
        assert_eq!(find(&tree).len(), 1);
    }

    #[test]
    fn a_crate_root_that_does_not_forbid_it_is_refused() {
        let tree = Tree::of(&[
            ("crates/link/src/lib.rs", "//! x\n"),
            ("crates/core/src/lib.rs", "//! x\n"),
            ("verification/loom/src/lib.rs", "//! x\n"),
            ("crates/card/src/lib.rs", "//! x\n#![forbid(unsafe_code)]\n"),
        ]);
        let paths: Vec<_> = find(&tree).into_iter().map(|finding| finding.path).collect();
        assert_eq!(paths, ["crates/link/src/lib.rs"]);
    }
}
