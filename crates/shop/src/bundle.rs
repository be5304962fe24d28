//! The files of a job: a program, its subprograms and cycles, each named by its hash (SHP, section 2).
//!
//! A bundle is a JSON text. Its own hash names it, so whoever has that hash can verify every byte of the job.
//!
//! Invariant: no file is written under a name with a path in it, and none is accepted whose content has another hash
//! or length than the bundle says.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use retrace_config::NumberedError;
use retrace_journal::state_file;
use serde::{Deserialize, Serialize};

use crate::content_hash::ContentHash;
use crate::machine_folder::unusable;

/// Maximum length of all files of a bundle, in bytes.
pub const MAX_BUNDLE_BYTES: u64 = 1 << 30;
/// Maximum number of files of a bundle.
pub const MAX_BUNDLE_FILES: usize = 1000;
/// Maximum length of a file name, in bytes.
const MAX_NAME_BYTES: usize = 120;
/// Maximum length of the JSON text, in bytes.
pub(crate) const MAX_JSON_BYTES: u64 = 1 << 20;
/// The format of the JSON text.
const FORMAT: u32 = 1;

/// What a file of a bundle is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BundleRole {
    /// The main program.
    Program,
    /// A subprogram: `O<part> call` finds `part.ngc`.
    Subprogram,
    /// Source of a cycle, `*.SPF`.
    Cycle,
}

impl BundleRole {
    /// What the file of this place on a command line is.
    fn of(place: usize, path: &Path) -> Self {
        match path.extension() {
            _ if place == 0 => Self::Program,
            Some(extension) if extension.eq_ignore_ascii_case("spf") => Self::Cycle,
            _ => Self::Subprogram,
        }
    }
}

/// A file of a bundle.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BundleFile {
    /// What it is.
    pub role: BundleRole,
    /// Its name, without a path.
    pub name: String,
    /// Hash of its content.
    pub sha256: ContentHash,
    /// Its length.
    pub bytes: u64,
}

/// The files of a job.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bundle {
    format: u32,
    files: Vec<BundleFile>,
}

/// A file that is submitted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceFile {
    /// What it is.
    pub role: BundleRole,
    /// Name that it gets.
    pub name: String,
    /// Where it is read.
    pub path: PathBuf,
}

impl SourceFile {
    /// The files of a command line: the program first, then its subprograms and the sources of its cycles.
    ///
    /// # Errors
    /// `E5005` where a path has no name that a bundle can have; `E5010` where there is no file.
    pub fn of_paths(paths: &[PathBuf]) -> Result<Vec<Self>, NumberedError> {
        let named = paths.iter().enumerate().map(|(number, path)| {
            let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
            check_name(name)?;
            let path = fs::canonicalize(path).map_err(|error| unusable(path, &error))?;
            Ok(Self { role: BundleRole::of(number, &path), name: name.into(), path })
        });
        named.collect()
    }
}

impl Bundle {
    /// Copies the files into a folder, each under its hash, durably, and returns their bundle.
    ///
    /// # Errors
    /// `E5005` for a name, `E5007` where they are too many or too long, `E5010` where one cannot be read or written.
    pub fn store(sources: &[SourceFile], folder: &Path) -> Result<Self, NumberedError> {
        if sources.len() > MAX_BUNDLE_FILES {
            return Err(too_large(&format!("{} files", sources.len())));
        }
        let mut bundle = Self { format: FORMAT, files: Vec::new() };
        let mut room = MAX_BUNDLE_BYTES;
        for SourceFile { role, name, path } in sources {
            let partial = folder.join("partial");
            let source = open_plain(path)?;
            let (sha256, bytes) = copy(source, &partial, room).map_err(|error| unusable(path, &error))?;
            room = room
                .checked_sub(bytes)
                .ok_or_else(|| too_large(&format!("{} and the files before", path.display())))?;
            let stored = folder.join(sha256.to_string());
            fs::rename(&partial, &stored).map_err(|error| unusable(&stored, &error))?;
            bundle.files.push(BundleFile { role: *role, name: name.clone(), sha256, bytes });
        }
        bundle.check()?;
        Ok(bundle)
    }

    /// Reads a bundle whose text has this hash.
    ///
    /// # Errors
    /// `E5006` where the text has another hash or is not a bundle, `E5005` for a name, `E5007` where it is too large,
    /// `E5010` where it cannot be read.
    pub fn read(path: &Path, hash: ContentHash) -> Result<Self, NumberedError> {
        let file = open_plain(path)?;
        let mut text = Vec::new();
        let (found, bytes) =
            ContentHash::of_copy(file, &mut text, MAX_JSON_BYTES).map_err(|error| unusable(path, &error))?;
        if bytes > MAX_JSON_BYTES {
            return Err(too_large(&path.display().to_string()));
        }
        if found != hash {
            return Err(forged(&format!("{} has the hash {found}, not {hash}", path.display())));
        }
        Self::parse(&text, hash)
    }

    /// Parses a text that has this hash.
    ///
    /// # Errors
    /// As [`Bundle::read`].
    pub(crate) fn parse(text: &[u8], hash: ContentHash) -> Result<Self, NumberedError> {
        let found = ContentHash::of(text);
        if found != hash {
            return Err(forged(&format!("its list of files has the hash {found}, not {hash}")));
        }
        let bundle: Self =
            serde_json::from_slice(text).map_err(|error| forged(&format!("its list of files: {error}")))?;
        bundle.check()?;
        Ok(bundle)
    }

    /// The diagnostic for a list of files that is too long.
    pub(crate) fn too_large() -> NumberedError {
        too_large("its list of files")
    }

    /// Checks names, roles, number and lengths.
    fn check(&self) -> Result<(), NumberedError> {
        if self.format != FORMAT {
            return Err(forged(&format!("its format is {}, and this version reads format {FORMAT}", self.format)));
        }
        if self.files.len() > MAX_BUNDLE_FILES {
            return Err(too_large(&format!("{} files", self.files.len())));
        }
        let mut names = BTreeSet::new();
        for file in &self.files {
            check_name(&file.name)?;
            // some systems do not distinguish capital letters
            if !names.insert(file.name.to_lowercase()) {
                let what = format!("two files of the job have the name {}", file.name);
                return Err(NumberedError::new("E5005", what, "give each file a name of its own"));
            }
        }
        let total = self.files.iter().try_fold(0_u64, |total, file| total.checked_add(file.bytes));
        if total.is_none_or(|total| total > MAX_BUNDLE_BYTES) {
            return Err(too_large("the job"));
        }
        match self.files.iter().filter(|file| file.role == BundleRole::Program).count() {
            1 => Ok(()),
            count => Err(forged(&format!("it names {count} main programs instead of one"))),
        }
    }

    /// The JSON text that names the bundle.
    #[must_use]
    pub fn json(&self) -> String {
        // neither the strings nor the numbers of a bundle can fail
        serde_json::to_string(self).unwrap_or_default()
    }

    /// Hash of the JSON text.
    #[must_use]
    pub fn hash(&self) -> ContentHash {
        ContentHash::of(self.json().as_bytes())
    }

    /// Its files.
    #[must_use]
    pub fn files(&self) -> &[BundleFile] {
        &self.files
    }

    /// Name of the main program.
    #[must_use]
    pub fn program(&self) -> &str {
        let program = self.files.iter().find(|file| file.role == BundleRole::Program);
        program.map_or("", |file| file.name.as_str())
    }

    /// Whether it has cycles of its own.
    #[must_use]
    pub fn has_cycles(&self) -> bool {
        self.files.iter().any(|file| file.role == BundleRole::Cycle)
    }

    /// Length of all files in bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.files.iter().map(|file| file.bytes).sum()
    }

    /// Copies every file from a folder of hashes to a folder of names, durably, and verifies each.
    ///
    /// # Errors
    /// `E5006` where a content has another hash or length, `E5010` where it cannot be read or written.
    pub fn unpack(&self, from: &Path, to: &Path) -> Result<(), NumberedError> {
        for file in &self.files {
            let (source, target) = (from.join(file.sha256.to_string()), to.join(&file.name));
            let opened = open_plain(&source)?;
            let found = copy(opened, &target, file.bytes).map_err(|error| unusable(&target, &error))?;
            verify(file, &source, found)?;
        }
        Ok(())
    }

    /// Verifies that a folder has every file under its name, unchanged.
    ///
    /// # Errors
    /// `E5006` where a file is missing or has another hash or length, `E5010` where it cannot be read.
    pub fn verify_folder(&self, folder: &Path) -> Result<(), NumberedError> {
        self.verify_paths(|file| folder.join(&file.name))
    }

    /// Verifies that a folder has every file under its hash, unchanged.
    ///
    /// # Errors
    /// As [`Bundle::verify_folder`].
    pub(crate) fn verify_hashes(&self, folder: &Path) -> Result<(), NumberedError> {
        self.verify_paths(|file| folder.join(file.sha256.to_string()))
    }

    fn verify_paths(&self, path: impl Fn(&BundleFile) -> PathBuf) -> Result<(), NumberedError> {
        for file in &self.files {
            let path = path(file);
            let opened = open_plain(&path)?;
            let found =
                ContentHash::of_copy(opened, io::sink(), file.bytes).map_err(|error| unusable(&path, &error))?;
            verify(file, &path, found)?;
        }
        Ok(())
    }
}

fn verify(file: &BundleFile, path: &Path, found: (ContentHash, u64)) -> Result<(), NumberedError> {
    if found == (file.sha256, file.bytes) {
        return Ok(());
    }
    Err(forged(&format!("{} is not the file {} that was submitted", path.display(), file.name)))
}

/// Copies to a new file that only its user can read, up to `limit` bytes, durably.
fn copy(from: File, to: &Path, limit: u64) -> io::Result<(ContentHash, u64)> {
    let mut file = state_file::private().write(true).create(true).truncate(true).open(to)?;
    let found = ContentHash::of_copy(from, &mut file, limit)?;
    file.sync_all()?;
    Ok(found)
}

/// Opens a plain file; a symbolic link, a folder or a device in its place is refused.
pub(crate) fn open_plain(path: &Path) -> Result<File, NumberedError> {
    let not_plain = || forged(&format!("{} is not a plain file", path.display()));
    let found = match fs::symlink_metadata(path) {
        Ok(found) if found.is_file() => found,
        Ok(_) => return Err(not_plain()),
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            return Err(forged(&format!("{} does not exist", path.display())));
        }
        Err(error) => return Err(unusable(path, &error)),
    };
    let file = File::open(path).map_err(|error| unusable(path, &error))?;
    // Another file may have been put there between the two calls.
    let opened = file.metadata().map_err(|error| unusable(path, &error))?;
    if is_same_file(&found, &opened) { Ok(file) } else { Err(not_plain()) }
}

#[cfg(unix)]
fn is_same_file(a: &fs::Metadata, b: &fs::Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

#[cfg(not(unix))]
fn is_same_file(_: &fs::Metadata, opened: &fs::Metadata) -> bool {
    opened.is_file()
}

/// Checks a name that a file is written under.
fn check_name(name: &str) -> Result<(), NumberedError> {
    let is_wrong = |letter: char| letter.is_control() || "/\\:*?\"<>|".contains(letter);
    let is_good = !name.is_empty()
        && name.len() <= MAX_NAME_BYTES
        && !name.starts_with(['.', ' '])
        && !name.ends_with(['.', ' '])
        && !name.contains(is_wrong);
    if is_good {
        return Ok(());
    }
    let what = format!("`{}` cannot be the name of a file of a job", name.escape_default());
    let remedy =
        "use a plain name of at most 120 bytes, without a path, a leading dot and the characters : * ? \" < > |";
    Err(NumberedError::new("E5005", what, remedy))
}

fn forged(why: &str) -> NumberedError {
    let what = format!("the files of the job are not those that were submitted: {why}");
    NumberedError::new("E5006", what, "submit the job again; if it happens again, check disk and sender")
}

fn too_large(what: &str) -> NumberedError {
    let what = format!("{what}: a job has at most {MAX_BUNDLE_FILES} files and {} MiB", MAX_BUNDLE_BYTES >> 20);
    NumberedError::new("E5007", what, "submit fewer files, or run a longer program with `retrace run`")
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    /// A folder with a program and a subprogram, and an empty one.
    fn sources() -> (tempfile::TempDir, Vec<SourceFile>, PathBuf) {
        let folder = tempfile::tempdir().expect("a folder");
        let paths =
            [("part.ngc", "o<sub> call\nM2\n"), ("sub.ngc", "o<sub> sub\no<sub> endsub\n")].map(|(name, text)| {
                fs::write(folder.path().join(name), text).expect("a file");
                folder.path().join(name)
            });
        let sources = SourceFile::of_paths(&paths).expect("names");
        let to = folder.path().join("to");
        fs::create_dir(&to).expect("a folder");
        (folder, sources, to)
    }

    fn read(folder: &Path, value: &Value) -> Result<Bundle, NumberedError> {
        let text = value.to_string();
        fs::write(folder.join("bundle.json"), &text).expect("written");
        Bundle::read(&folder.join("bundle.json"), ContentHash::of(text.as_bytes()))
    }

    #[test]
    fn what_is_stored_is_unpacked_under_its_names() {
        let (folder, sources, to) = sources();
        let bundle = Bundle::store(&sources, &to).expect("stored");
        assert_eq!((bundle.program(), bundle.files().len(), bundle.bytes()), ("part.ngc", 2, 40));
        let path = folder.path().join("bundle.json");
        fs::write(&path, bundle.json()).expect("written");
        assert_eq!(Bundle::read(&path, bundle.hash()), Ok(bundle.clone()));
        let names = folder.path().join("names");
        fs::create_dir(&names).expect("a folder");
        bundle.unpack(&to, &names).expect("whole");
        bundle.verify_folder(&names).expect("whole");
        assert_eq!(fs::read(names.join("sub.ngc")).ok(), fs::read(folder.path().join("sub.ngc")).ok());
    }

    #[test]
    fn a_name_with_a_path_or_without_letters_is_refused() {
        let (folder, ..) = sources();
        let hash = ContentHash::of(b"");
        for name in [
            "",
            ".",
            "..",
            "../part.ngc",
            "/etc/passwd",
            "a/b.ngc",
            "a\\b.ngc",
            "c:part.ngc",
            ".hidden",
            "part.ngc ",
            "a\u{0}b",
            "a\nb",
            "a\u{1b}[2J",
            "part.",
            &"x".repeat(121),
        ] {
            let files = json!([{"role": "program", "name": name, "sha256": hash, "bytes": 0}]);
            let refusal = read(folder.path(), &json!({"format": 1, "files": files})).expect_err(name);
            assert_eq!(refusal.number, "E5005", "{name}");
        }
        let twice = ["part.ngc", "PART.ngc"].map(|name| {
            json!({"role": if name == "part.ngc" { "program" } else { "subprogram" }, "name": name, "sha256": hash,
                "bytes": 0})
        });
        assert_eq!(read(folder.path(), &json!({"format": 1, "files": twice})).expect_err("twice").number, "E5005");
        assert_eq!(SourceFile::of_paths(&[PathBuf::from("..")]).expect_err("no name").number, "E5005");
    }

    #[test]
    fn a_text_that_is_not_this_bundle_is_refused() {
        let (folder, ..) = sources();
        let empty = ContentHash::of(b"");
        let file = |role: &str| json!({"role": role, "name": format!("{role}.ngc"), "sha256": empty, "bytes": 0});
        let good = json!({"format": 1, "files": [file("program")]});
        read(folder.path(), &good).expect("good");
        let other = Bundle::read(&folder.path().join("bundle.json"), ContentHash::of(b"x"));
        assert_eq!(other.expect_err("another hash").number, "E5006");
        for bad in [
            json!({"format": 2, "files": [file("program")]}),
            json!({"format": 1, "files": []}),
            json!({"format": 1, "files": [file("subprogram")]}),
            json!({"format": 1, "files": [file("script")]}),
            json!({"format": 1, "files": [file("program")], "run": true}),
            json!([1, 2]),
        ] {
            assert_eq!(read(folder.path(), &bad).expect_err("bad").number, "E5006", "{bad}");
        }
        let mut large = file("program");
        large["bytes"] = json!(MAX_BUNDLE_BYTES + 1);
        let mut longest = file("subprogram");
        longest["bytes"] = json!(u64::MAX);
        let many: Vec<Value> = (0..=MAX_BUNDLE_FILES)
            .map(|n| json!({"role": "subprogram", "name": n.to_string(), "sha256": ContentHash::of(b""), "bytes": 0}))
            .collect();
        for files in [json!([large]), json!([large, longest]), json!(many)] {
            let refusal = read(folder.path(), &json!({"format": 1, "files": files})).expect_err("large");
            assert_eq!(refusal.number, "E5007");
        }
    }

    #[test]
    fn a_content_that_was_changed_is_refused() {
        let (folder, sources, to) = sources();
        let bundle = Bundle::store(&sources, &to).expect("stored");
        let stored = to.join(bundle.files()[1].sha256.to_string());
        let good = fs::read(&stored).expect("stored");
        let mut flipped = good.clone();
        flipped[1] ^= 1;
        let changed = [flipped, [&good[..], b"\n"].concat(), good[..good.len() - 1].to_vec(), Vec::new()];
        for content in changed {
            fs::write(&stored, content).expect("written");
            assert_eq!(bundle.unpack(&to, folder.path()).expect_err("changed").number, "E5006");
        }
        fs::remove_file(&stored).expect("deleted");
        assert_eq!(bundle.unpack(&to, folder.path()).expect_err("missing").number, "E5006");
        #[cfg(unix)]
        {
            let elsewhere = folder.path().join("elsewhere");
            fs::write(&elsewhere, &good).expect("written");
            std::os::unix::fs::symlink(&elsewhere, &stored).expect("a link");
            assert_eq!(bundle.unpack(&to, folder.path()).expect_err("a link").number, "E5006");
        }
    }
}
