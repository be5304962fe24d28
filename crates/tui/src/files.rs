//! File names at a prompt: completion, and the home folder.
//!
//! Invariant: typed text is never shortened; folders are only read.

use std::path::{MAIN_SEPARATOR, Path, PathBuf};

/// Maximum number of names that are listed.
const MAX_LISTED: usize = 6;
/// Maximum number of folder entries that are read.
const MAX_ENTRIES: usize = 10_000;

/// Path of a text; `~` is the home folder.
#[must_use]
pub(crate) fn expanded(text: &str) -> PathBuf {
    let home = std::env::var_os("HOME").map(PathBuf::from);
    match (text.strip_prefix("~/"), home) {
        (Some(rest), Some(home)) => home.join(rest),
        _ => PathBuf::from(text),
    }
}

/// Completes a file name as far as it is unique. Where that adds nothing, returns the candidates, or that there are
/// none.
#[must_use]
pub(crate) fn complete(text: &mut String) -> Option<String> {
    let (folder, begun) = text.rsplit_once(MAIN_SEPARATOR).map_or(("", text.as_str()), |(folder, name)| (folder, name));
    let path = match folder {
        "" if text.starts_with(MAIN_SEPARATOR) => PathBuf::from("/"),
        "" => PathBuf::from("."),
        _ => expanded(&format!("{folder}{MAIN_SEPARATOR}")),
    };
    let names = names_in(&path, begun);
    let Some(first) = names.first() else { return Some("no file or folder has this prefix".into()) };
    let common = names.iter().fold(first.as_str(), |common, name| common_beginning(common, name));
    if common.len() > begun.len() {
        let added = common[begun.len()..].to_owned();
        text.push_str(&added);
        return None;
    }
    let mut listed: Vec<&str> = names.iter().take(MAX_LISTED).map(String::as_str).collect();
    if names.len() > MAX_LISTED {
        listed.push("…");
    }
    (names.len() > 1).then(|| listed.join("  "))
}

/// Names in a folder with a prefix, sorted; those of folders end with a separator. Hidden names only where the prefix
/// begins with a dot.
fn names_in(folder: &Path, begun: &str) -> Vec<String> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let name_of = |entry: std::fs::DirEntry| {
        let name = entry.file_name().into_string().ok()?;
        let is_wanted = name.starts_with(begun) && (!name.starts_with('.') || begun.starts_with('.'));
        if !is_wanted || name.chars().any(char::is_control) {
            return None;
        }
        Some(if entry.path().is_dir() { format!("{name}{MAIN_SEPARATOR}") } else { name })
    };
    let mut names: Vec<String> = entries.take(MAX_ENTRIES).filter_map(Result::ok).filter_map(name_of).collect();
    names.sort();
    names
}

/// Longest common prefix of two texts.
fn common_beginning<'t>(one: &'t str, other: &str) -> &'t str {
    let end = one.char_indices().zip(other.chars()).find(|((_, a), b)| a != b).map(|((at, _), _)| at);
    &one[..end.unwrap_or_else(|| one.len().min(other.len()))]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_completed_as_far_as_only_one_is_possible() {
        let folder = tempfile::tempdir().expect("a folder");
        for name in ["part-1.ngc", "part-2.ngc", "other.ngc", ".hidden"] {
            std::fs::write(folder.path().join(name), "").expect("a file");
        }
        std::fs::create_dir(folder.path().join("größe")).expect("a folder");
        let at = |name: &str| format!("{}/{name}", folder.path().display());
        let completed = |name: &str| {
            let mut text = at(name);
            let listed = complete(&mut text);
            (text.strip_prefix(&at("")).expect("never shortened").to_owned(), listed)
        };
        assert_eq!(completed("o"), ("other.ngc".into(), None));
        assert_eq!(completed("p"), ("part-".into(), None));
        assert_eq!(completed("part-"), ("part-".into(), Some("part-1.ngc  part-2.ngc".into())));
        assert_eq!(completed("g"), ("größe/".into(), None));
        assert_eq!(completed(".h"), (".hidden".into(), None));
        assert_eq!(completed("other.ngc"), ("other.ngc".into(), None));
        assert!(completed("x").1.is_some_and(|result| result.contains("no file")));
    }
}
