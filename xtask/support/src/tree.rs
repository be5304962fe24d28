//! The files of the checkout for the checks of `tidy`, and functions on Rust text.
//!
//! Invariant: a tree holds every text file that git tracks or would track, under its path from the root with `/`.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

/// Text files by path.
#[derive(Default)]
pub struct Tree {
    files: BTreeMap<String, Option<String>>,
}

impl Tree {
    /// Reads the files that git tracks, and those that are new and not ignored.
    ///
    /// # Errors
    /// Where git cannot be run, or does not know this folder.
    pub fn read(root: &Path) -> Result<Self, String> {
        let mut tree = Self::default();
        for path in listed(root)? {
            let Ok(bytes) = std::fs::read(root.join(&path)) else { continue };
            tree.files.insert(path, String::from_utf8(bytes).ok());
        }
        Ok(tree)
    }

    /// A tree of these files, for tests of the checks.
    pub fn of(files: &[(&str, &str)]) -> Self {
        Self { files: files.iter().map(|(path, text)| ((*path).to_owned(), Some((*text).to_owned()))).collect() }
    }

    /// Every text file: path and text.
    pub fn texts(&self) -> impl Iterator<Item = (&str, &str)> {
        self.files.iter().filter_map(|(path, text)| Some((path.as_str(), text.as_deref()?)))
    }

    /// The path of every file, of any kind.
    pub fn paths(&self) -> impl Iterator<Item = &str> {
        self.files.keys().map(String::as_str)
    }

    /// Every Rust file: path and text.
    pub fn rust(&self) -> impl Iterator<Item = (&str, &str)> {
        self.texts().filter(|(path, _)| path.ends_with(".rs"))
    }

    /// The text of one file.
    pub fn text(&self, path: &str) -> Option<&str> {
        self.files.get(path)?.as_deref()
    }

    /// Whether such a file exists, of any kind.
    pub fn has_file(&self, path: &str) -> bool {
        self.files.contains_key(path)
    }

    /// Whether such a file (of any kind) exists, or a folder that contains one.
    pub fn has(&self, path: &str) -> bool {
        let folder = format!("{path}/");
        path.is_empty()
            || self.files.contains_key(path)
            || self.files.range(folder.clone()..).next().is_some_and(|(name, _)| name.starts_with(&folder))
    }
}

/// The paths of what git tracks, and of what is new and not ignored.
fn listed(root: &Path) -> Result<Vec<String>, String> {
    let listing = Command::new("git")
        .args(["ls-files", "-z", "--cached", "--others", "--exclude-standard"])
        .current_dir(root)
        .output()
        .map_err(|error| format!("git cannot be run: {error}"))?;
    if !listing.status.success() {
        return Err(format!("git ls-files: {}", String::from_utf8_lossy(&listing.stderr).trim()));
    }
    let paths = String::from_utf8_lossy(&listing.stdout);
    Ok(paths.split('\0').filter(|path| !path.is_empty()).map(str::to_owned).collect())
}

/// Makes `copy` contain the same files as the checkout. Files that are equal already are not written, so that builds in
/// the copy are incremental.
///
/// # Errors
/// Where git or the file system refuses.
pub fn mirror(root: &Path, copy: &Path) -> Result<(), String> {
    let paths = listed(root)?;
    remove_others(copy, "", &paths)?;
    for path in &paths {
        let Ok(bytes) = std::fs::read(root.join(path)) else { continue };
        let place = copy.join(path);
        if std::fs::read(&place).is_ok_and(|there| there == bytes) {
            continue;
        }
        let made = place.parent().map_or(Ok(()), std::fs::create_dir_all).and_then(|()| std::fs::write(&place, bytes));
        made.map_err(|error| format!("{}: {error}", place.display()))?;
    }
    Ok(())
}

/// Removes the files under `folder` that are not listed.
fn remove_others(copy: &Path, folder: &str, listed: &[String]) -> Result<(), String> {
    let Ok(entries) = std::fs::read_dir(copy.join(folder)) else { return Ok(()) };
    for entry in entries.filter_map(Result::ok) {
        let name = entry.file_name().to_string_lossy().into_owned();
        let path = if folder.is_empty() { name } else { format!("{folder}/{name}") };
        if entry.path().is_dir() {
            remove_others(copy, &path, listed)?;
        } else if !listed.contains(&path) && path != "Cargo.lock" {
            std::fs::remove_file(entry.path()).map_err(|error| format!("{path}: {error}"))?;
        }
    }
    Ok(())
}

/// The lines before the unit tests: up to `#[cfg(test)]` on a module.
pub fn lines_before_tests(text: &str) -> usize {
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    let opens_tests = |at: usize| {
        lines[at] == "#[cfg(test)]"
            && lines[at + 1..]
                .iter()
                .find(|line| !line.starts_with("#["))
                .is_some_and(|line| line.starts_with("mod ") || line.contains(" mod "))
    };
    (0..lines.len()).find(|&at| opens_tests(at)).unwrap_or(lines.len())
}

/// Whether this file contains only tests.
pub fn is_test_file(path: &str) -> bool {
    path.ends_with("/tests.rs") || path.starts_with("tests/tests/") || path.contains("/src/tests/") || {
        path.starts_with("crates/") && path.contains("/tests/")
    }
}

/// Rust text with comments, strings and characters blanked; line breaks and columns stay.
pub fn code_only(text: &str) -> String {
    let bytes = text.as_bytes();
    let mut code = bytes.to_vec();
    let mut at = 0;
    while at < bytes.len() {
        let end = at + token_length(&bytes[at..], at > 0 && is_word(bytes[at - 1]));
        if end > at {
            code[at..end].iter_mut().filter(|byte| **byte != b'\n').for_each(|byte| *byte = b' ');
            at = end;
        } else {
            at += 1;
        }
    }
    String::from_utf8_lossy(&code).into_owned()
}

/// The length of the comment, string or character that opens `rest`; 0 where none does.
fn token_length(rest: &[u8], inside_word: bool) -> usize {
    let up_to = |end: &[u8], from: usize| {
        (from..rest.len()).find(|&at| rest[at..].starts_with(end)).map_or(rest.len(), |at| at + end.len())
    };
    match rest {
        [b'/', b'/', ..] => rest.iter().position(|&byte| byte == b'\n').unwrap_or(rest.len()),
        [b'/', b'*', ..] => block_comment_length(rest),
        [b'"', ..] => quoted_length(rest, b'"'),
        [b'r', b'"', ..] if !inside_word => up_to(b"\"", 2),
        [b'r', b'#', ..] if !inside_word => {
            let hashes = rest[1..].iter().take_while(|&&byte| byte == b'#').count();
            if rest.get(1 + hashes) != Some(&b'"') {
                return 0;
            }
            let mut end = vec![b'"'];
            end.resize(1 + hashes, b'#');
            up_to(&end, 2 + hashes)
        }
        // A lifetime is a quote that no quote closes after one character.
        [b'\'', b'\\', ..] => quoted_length(rest, b'\''),
        [b'\'', ..] => {
            let width = std::str::from_utf8(&rest[1..rest.len().min(5)])
                .or_else(|error| std::str::from_utf8(&rest[1..1 + error.valid_up_to()]))
                .ok()
                .and_then(|text| text.chars().next())
                .map_or(1, char::len_utf8);
            if rest.get(1 + width) == Some(&b'\'') { width + 2 } else { 0 }
        }
        _ => 0,
    }
}

fn quoted_length(rest: &[u8], quote: u8) -> usize {
    let mut at = 1;
    while at < rest.len() {
        match rest[at] {
            b'\\' => at += 2,
            byte if byte == quote => return at + 1,
            _ => at += 1,
        }
    }
    rest.len()
}

fn block_comment_length(rest: &[u8]) -> usize {
    let (mut depth, mut at) = (0_usize, 0);
    while at < rest.len() {
        if rest[at..].starts_with(b"/*") {
            depth += 1;
            at += 2;
        } else if rest[at..].starts_with(b"*/") {
            depth -= 1;
            at += 2;
            if depth == 0 {
                return at;
            }
        } else {
            at += 1;
        }
    }
    rest.len()
}

/// Whether this byte may be part of a Rust word.
pub fn is_word(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || byte == b'_' || byte >= 0x80
}

/// The places at which `word` stands alone in `line`, not as a part of a longer word.
pub fn words<'a>(line: &'a str, word: &'a str) -> impl Iterator<Item = usize> + 'a {
    line.match_indices(word).map(|(at, _)| at).filter(move |&at| {
        let bytes = line.as_bytes();
        (at == 0 || !is_word(bytes[at - 1])) && bytes.get(at + word.len()).is_none_or(|&byte| !is_word(byte))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_strings_and_characters_are_blanked_and_code_stays() {
        let text =
            "a // b\nc /* d /* e */ f */ g \"h\\\"i\" j r#\"k\"l\"# m 'n' '\\'' o<'p> q r\"s\\\" t 'ä' u 'static v\nw";
        let code: String = code_only(text).split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(code, "a c g j m o<'p> q t u 'static v w");
        assert_eq!(code_only(text).lines().count(), 3);
        assert_eq!(code_only(text).len(), text.len());
    }

    #[test]
    fn unit_tests_are_not_counted_but_a_test_only_import_is_no_test_module() {
        assert_eq!(lines_before_tests("a\n#[cfg(test)]\nuse b;\nc\n#[cfg(test)]\nmod tests {\n}\n"), 4);
        assert_eq!(lines_before_tests("a\nb\n"), 2);
    }

    #[test]
    fn a_mirror_holds_the_same_files_and_no_others() {
        let here = std::env::current_dir().unwrap();
        let root = here.ancestors().nth(2).unwrap();
        let copy = std::env::temp_dir().join(format!("retrace-xtask-mirror-{}", std::process::id()));
        std::fs::create_dir_all(copy.join("xtask")).unwrap();
        std::fs::write(copy.join("xtask/left-over.rs"), "x").unwrap();
        mirror(root, &copy).unwrap();
        let read = |root: &Path| std::fs::read_to_string(root.join("xtask/src/main.rs")).unwrap();
        assert_eq!(read(root), read(&copy));
        assert!(!copy.join("xtask/left-over.rs").exists());
        std::fs::remove_dir_all(&copy).unwrap();
    }

    #[test]
    fn a_folder_is_there_when_a_file_is_in_it() {
        let tree = Tree::of(&[("a/b/c.rs", ""), ("a-d", "")]);
        assert!(tree.has("a/b") && tree.has("a") && tree.has("a-d") && tree.has("a/b/c.rs"));
        assert!(!tree.has("a/c") && !tree.has("b"));
    }
}
