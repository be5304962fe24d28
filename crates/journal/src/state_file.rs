//! Files that outlive a command: private ones in the state folder, and tables of the user that are rewritten.
//!
//! Invariant: a file is replaced whole or stays as it was. A symbolic link stays one, and the file it refers to keeps
//! its mode. Files created in the state folder can be read by their user only.

use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

/// Maximum number of links that are followed before a path counts as circular.
const MAX_LINKS: u32 = 40;

/// Access to a file that is created here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileAccess {
    /// Its user only: mode 600.
    Private,
    /// The process's default for new files.
    Usual,
}

/// Creates a folder and the missing ones above it, each for its user only (mode 700). Folders that exist stay as they
/// are.
///
/// # Errors
/// The error of the system.
pub fn create_private_folder(folder: &Path) -> io::Result<()> {
    let mut builder = fs::DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(folder)
}

/// Creates one folder, which must not exist, for its user only (mode 700).
///
/// # Errors
/// The error of the system.
pub fn create_new_private_folder(folder: &Path) -> io::Result<()> {
    let mut builder = fs::DirBuilder::new();
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(folder)
}

/// Options of a file that is private (mode 600) if it is created.
#[must_use]
pub fn private() -> OpenOptions {
    let mut options = OpenOptions::new();
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options
}

/// Opens a lock file for reading and writing, and creates it where it does not exist. A symbolic link in its place is
/// not followed.
///
/// # Errors
/// `InvalidInput` where something other than a plain file is there; else the error of the system.
pub fn open_lock(path: &Path) -> io::Result<File> {
    match private().read(true).write(true).create_new(true).open(path) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
        opened => return opened,
    }
    let foreign =
        || io::Error::new(ErrorKind::InvalidInput, "it is a symbolic link or no plain file, which is not followed");
    let found = fs::symlink_metadata(path)?;
    if !found.is_file() {
        return Err(foreign());
    }
    let file = OpenOptions::new().read(true).write(true).open(path)?;
    // Another file may have been put there between the two calls.
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let opened = file.metadata()?;
        if (opened.dev(), opened.ino()) != (found.dev(), found.ino()) {
            return Err(foreign());
        }
    }
    Ok(file)
}

/// Replaces a file by these bytes, durably: they are written to a new file next to it, which is then renamed over it.
/// Where the path is a symbolic link, the file that it refers to is replaced. An existing file keeps its mode; a new
/// one gets that of `access`.
///
/// # Errors
/// The error of the system; the old file is still there then.
pub fn replace(path: &Path, bytes: &[u8], access: FileAccess) -> io::Result<()> {
    let target = link_target(path)?;
    let permissions = match fs::metadata(&target) {
        Ok(found) if found.is_file() => Some(found.permissions()),
        Ok(_) => return Err(io::Error::new(ErrorKind::InvalidInput, "it is not a plain file")),
        Err(error) if error.kind() == ErrorKind::NotFound => None,
        Err(error) => return Err(error),
    };
    // A file without write permission is not replaced either.
    if permissions.is_some() {
        OpenOptions::new().write(true).open(&target)?;
    }
    let mut name = target.file_name().unwrap_or_default().to_owned();
    name.push(format!(".{}.new", std::process::id()));
    let beside = target.with_file_name(name);
    let written = write_new(&beside, bytes, access).and_then(|file| {
        if let Some(permissions) = permissions {
            file.set_permissions(permissions)?;
        }
        fs::rename(&beside, &target)
    });
    if written.is_err() {
        let _ = fs::remove_file(&beside);
    }
    written
}

fn write_new(path: &Path, bytes: &[u8], access: FileAccess) -> io::Result<File> {
    // One that an earlier process with this number left.
    if fs::symlink_metadata(path).is_ok() {
        fs::remove_file(path)?;
    }
    let mut options = if access == FileAccess::Private { private() } else { OpenOptions::new() };
    let mut file = options.write(true).create_new(true).open(path)?;
    file.write_all(bytes)?;
    file.sync_all()?;
    Ok(file)
}

/// The file that a path refers to, which need not exist.
fn link_target(path: &Path) -> io::Result<PathBuf> {
    let mut target = path.to_owned();
    for _ in 0..MAX_LINKS {
        match fs::read_link(&target) {
            Ok(next) => target = target.parent().unwrap_or(Path::new("")).join(next),
            // It does not exist, or is not a link.
            Err(_) => return Ok(target),
        }
    }
    Err(io::Error::other("too many symbolic links"))
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};

    fn mode(path: &Path) -> u32 {
        fs::metadata(path).expect("a file").mode() & 0o777
    }

    #[test]
    fn a_file_is_replaced_through_its_link_and_keeps_its_mode() {
        let folder = tempfile::tempdir().expect("a folder");
        let (real, link, second) =
            (folder.path().join("real/mill.var"), folder.path().join("mill.var"), folder.path().join("second"));
        fs::create_dir(folder.path().join("real")).expect("a folder");
        symlink("real/mill.var", &link).expect("a link");
        symlink("mill.var", &second).expect("a link");
        // The file that a link refers to need not exist.
        replace(&second, b"1", FileAccess::Usual).expect("written");
        fs::set_permissions(&real, fs::Permissions::from_mode(0o664)).expect("changed");
        replace(&second, b"22", FileAccess::Private).expect("written");
        assert!(fs::symlink_metadata(&link).expect("there").is_symlink());
        assert_eq!((fs::read(&real).expect("there"), mode(&real)), (b"22".to_vec(), 0o664));
        assert_eq!(fs::read_dir(folder.path().join("real")).expect("a folder").count(), 1, "nothing is left beside it");
        symlink("round", folder.path().join("round")).expect("a link");
        assert!(replace(&folder.path().join("round"), b"", FileAccess::Usual).is_err());
    }

    #[test]
    fn what_is_made_is_private() {
        let folder = tempfile::tempdir().expect("a folder");
        let deep = folder.path().join("a/b");
        create_private_folder(&deep).expect("made");
        create_private_folder(&deep).expect("it is there");
        let file = deep.join("file");
        replace(&file, b"1", FileAccess::Private).expect("written");
        assert_eq!((mode(&deep), mode(&folder.path().join("a")), mode(&file)), (0o700, 0o700, 0o600));
        let lock = deep.join("lock");
        open_lock(&lock).expect("made");
        open_lock(&lock).expect("opened");
        assert_eq!(mode(&lock), 0o600);
    }

    #[test]
    fn a_lock_that_is_a_link_is_not_followed() {
        let folder = tempfile::tempdir().expect("a folder");
        let (target, lock) = (folder.path().join("precious"), folder.path().join("lock"));
        fs::write(&target, b"keep me").expect("a file");
        symlink(&target, &lock).expect("a link");
        assert_eq!(open_lock(&lock).expect_err("a link").kind(), ErrorKind::InvalidInput);
        assert_eq!(fs::read(&target).expect("there"), b"keep me");
    }
}
