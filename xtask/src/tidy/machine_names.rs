//! No path or host of one machine is in the tree: a clone must mean the same everywhere.

use super::Finding;
use retrace_task_support::tree::{Tree, is_word};

/// Folders of a machine, in parts, so that this file does not offend.
const FOLDERS: &[&str] = &["work", "root", "tmp", "home", "Users"];
/// Endings of hosts that only one network knows, in parts for the same reason.
const PRIVATE_ENDINGS: &[&str] = &["internal", "local", "lan", "corp", "localhost"];
const LOCK: &str = "Cargo.lock";
const CRATES_IO: &str = "registry+https://github.com/rust-lang/crates.io-index";

pub(super) fn find(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (path, text) in tree.texts() {
        for (index, line) in text.lines().enumerate() {
            if let Some(folder) = FOLDERS.iter().find(|folder| names_folder(line, folder)) {
                findings.push(Finding::at(path, index + 1, format!("a path of one machine: /{folder}")));
            }
            if let Some(host) = private_host(line) {
                findings.push(Finding::at(path, index + 1, format!("a host of one machine or network: {host}")));
            }
            let is_source = path.ends_with(LOCK) && line.starts_with("source = ");
            if is_source && !line.contains(CRATES_IO) {
                findings.push(Finding::at(path, index + 1, "every crate comes from crates.io"));
            }
        }
    }
    findings
}

/// Does an absolute path into this folder stand in the line?
fn names_folder(line: &str, folder: &str) -> bool {
    let path = format!("/{folder}");
    line.match_indices(&path).any(|(at, _)| {
        let before = line[..at].bytes().next_back();
        let after = line[at + path.len()..].bytes().next();
        // A path that goes on from something is relative, or belongs to a URL.
        before.is_none_or(|byte| !is_word(byte) && !b"./-~*}>".contains(&byte))
            && after.is_none_or(|byte| !is_word(byte) && byte != b'-')
    })
}

/// The host of a URL in this line, where only one network can know it.
fn private_host(line: &str) -> Option<&str> {
    line.match_indices("://").find_map(|(at, mark)| {
        let authority = &line[at + mark.len()..];
        let end = authority.find(|letter: char| !letter.is_ascii_alphanumeric() && !".-_@:".contains(letter));
        let authority = &authority[..end.unwrap_or(authority.len())];
        let host = authority.rsplit('@').next()?.split(':').next()?;
        let is_address = !host.is_empty() && host.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.');
        let ending = host.rsplit('.').next()?;
        (is_address || PRIVATE_ENDINGS.contains(&ending)).then_some(host)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(path: &str, text: &str) -> Vec<usize> {
        find(&Tree::of(&[(path, text)])).iter().map(|finding| finding.line).collect()
    }

    #[test]
    fn absolute_paths_are_refused_and_relative_ones_are_not() {
        let slash = "/";
        let text = format!(
            "see {slash}work/x\nin `{slash}tmp`\n../work/y\nhttps://a.org{slash}home/b\n\
             {slash}workshop\nx{slash}root\n\"{slash}home/me\"\n"
        );
        assert_eq!(lines("README.md", &text), [1, 2, 7]);
    }

    #[test]
    fn private_hosts_are_refused_and_public_ones_are_not() {
        let mark = ":/";
        let text = format!(
            "http{mark}/10.0.0.1:80/x\nhttps{mark}/docs.rs/x\nhttp{mark}/me@mirror.internal\n\
             http{mark}/localhost:1\nx://\n"
        );
        assert_eq!(lines("a.toml", &text), [1, 3, 4]);
    }

    #[test]
    fn a_lock_file_from_another_registry_is_refused() {
        let text = format!("source = \"{CRATES_IO}\"\nsource = \"registry+https://crates.example.org/index\"\n");
        assert_eq!(lines(LOCK, &text), [2]);
    }
}
