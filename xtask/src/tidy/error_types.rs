//! Every type whose name ends in `Error` implements `Error`, so that it has a text and can be a source.
//!
//! The check looks for `Error for NAME` in the type's file, or for `Error` in the list of its `derive`.

use super::Finding;
use retrace_task_support::tree::{Tree, code_only, is_test_file, is_word};

pub(super) fn find(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (path, text) in tree.rust().filter(|(path, _)| path.starts_with("crates/") && !is_test_file(path)) {
        let code = code_only(text);
        let lines: Vec<&str> = code.lines().collect();
        for (index, line) in lines.iter().enumerate() {
            let Some(name) = error_type(line) else { continue };
            let derives = lines[..index].iter().rev().take_while(|line| line.trim_start().starts_with("#["));
            let is_derived = derives.into_iter().any(|line| line.contains("derive(") && line.contains("Error"));
            if !is_derived && !has_impl(&code, name) {
                findings.push(Finding::at(path, index + 1, format!("`{name}` does not implement `Error`")));
            }
        }
    }
    findings
}

/// The name of the error type that this line defines.
fn error_type(line: &str) -> Option<&str> {
    let (before, rest) = ["enum ", "struct "].iter().find_map(|keyword| line.split_once(keyword))?;
    let is_definition = before.trim().is_empty() || before.trim_start().starts_with("pub");
    let name = &rest[..rest.bytes().position(|byte| !is_word(byte)).unwrap_or(rest.len())];
    (is_definition && name.ends_with("Error")).then_some(name)
}

fn has_impl(code: &str, name: &str) -> bool {
    code.match_indices(&format!("Error for {name}"))
        .any(|(at, found)| code.as_bytes().get(at + found.len()).is_none_or(|&byte| !is_word(byte)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_type_without_the_trait_is_found() {
        let tree = Tree::of(&[(
            "crates/a/src/b.rs",
            "pub enum ReadError { A }\nimpl std::error::Error for ReadError {}\n\
             #[derive(Debug, Error)]\npub(crate) struct SizeError;\n\
             #[derive(Debug)]\nstruct PlanError(u8);\nimpl Error for PlanErrors {}\n\
             impl<F> core::error::Error for LinkError<F> {}\nenum LinkError<F> { A(F) }\n// enum TextError\n",
        )]);
        let messages: Vec<_> = find(&tree).into_iter().map(|finding| (finding.line, finding.message)).collect();
        assert_eq!(messages, [(6, "`PlanError` does not implement `Error`".to_owned())]);
    }
}
