//! A watched folder: whole files that arrive there are submitted as jobs (SHP-35).
//!
//! The folder is listed again and again: network shares give no change events that can be relied on.
//!
//! Invariant: a file is submitted once, whenever the process is killed, and only after its size and time have stood for
//! two seconds or its ready file lies beside it. Symbolic links and folders are not followed. A FIFO is a stream: what
//! each writer sends is one file (on Linux; elsewhere it is left alone).

use std::collections::BTreeMap;
use std::fs::{self, Metadata};
use std::path::Path;
use std::time::{Duration, Instant, SystemTime};

use retrace_config::NumberedError;
use retrace_journal::{Timestamp, state_file};

use crate::bundle::{BundleRole, SourceFile};
use crate::content_hash::ContentHash;
#[cfg(target_os = "linux")]
use crate::fifo_reader::{FifoOutcome, FifoReader};
use crate::inbox_limits::InboxLimits;
use crate::job::{JobTarget, ShopJob};
use crate::job_id::ShopJobId;
use crate::ledger::Ledger;
use crate::machine_folder::{MachineFolder, folder_names, sync_folder, unusable};
use crate::queue::JobQueue;
use crate::shop_file::WatchConfig;
use crate::watch_log::{FoundFile, WatchLog};

/// How long size and time of a file stand until it counts as whole.
const STANDING_TIME: Duration = Duration::from_secs(2);
/// End of the name of a file that marks another one as whole.
const READY: &str = ".ready";
/// Ends of names that programs use for files that they are writing.
const UNFINISHED: [&str; 4] = [".part", ".partial", ".tmp", ".crdownload"];

/// What became of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum WatchOutcome {
    /// It was submitted and moved.
    Submitted {
        /// Its name.
        name: String,
        /// Its job.
        id: ShopJobId,
    },
    /// It was not submitted, and moved to the folder of failed files; what came from a FIFO was deleted.
    Failed {
        /// Its name.
        name: String,
        /// Why.
        error: NumberedError,
    },
    /// It stays, and is tried again.
    Stays {
        /// Its name.
        name: String,
        /// Why.
        error: NumberedError,
    },
}

/// Size and time of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct FileStamp {
    bytes: u64,
    modified: Option<SystemTime>,
}

impl FileStamp {
    fn of(found: &Metadata) -> Self {
        Self { bytes: found.len(), modified: found.modified().ok() }
    }
}

/// A watched folder.
#[derive(Debug)]
pub struct FolderWatch {
    config: WatchConfig,
    machine: MachineFolder,
    limits: InboxLimits,
    /// Each file with its stamp, and since when it has that.
    standing: BTreeMap<String, (FileStamp, Instant)>,
    #[cfg(target_os = "linux")]
    fifos: FifoReader,
}

impl FolderWatch {
    /// Watches a folder for a machine; nothing is read yet.
    #[must_use]
    pub fn new(config: WatchConfig, machine: MachineFolder, limits: InboxLimits) -> Self {
        Self {
            config,
            machine,
            limits,
            standing: BTreeMap::new(),
            #[cfg(target_os = "linux")]
            fifos: FifoReader::default(),
        }
    }

    /// Whether files wait until they count as whole.
    #[must_use]
    pub fn has_standing_files(&self) -> bool {
        #[cfg(target_os = "linux")]
        if self.fifos.has_writers() {
            return true;
        }
        !self.standing.is_empty()
    }

    /// Reads the FIFOs of the folder for a turn each. What they have got is a file of the folder then.
    #[cfg(target_os = "linux")]
    fn read_fifos(&mut self) -> Result<Vec<WatchOutcome>, NumberedError> {
        use std::os::unix::fs::FileTypeExt;
        let ready = self.config.needs_ready_file.then_some(READY);
        let mut outcomes = Vec::new();
        for name in folder_names(&self.config.path)?.into_iter().filter(|name| is_candidate(name)) {
            let about = fs::symlink_metadata(self.config.path.join(&name));
            if !about.is_ok_and(|about| about.file_type().is_fifo()) {
                continue;
            }
            match self.fifos.read(&self.config.path, &name, ready, self.limits) {
                Ok(FifoOutcome::Nothing | FifoOutcome::File) => {}
                Ok(FifoOutcome::Failed(error)) => outcomes.push(WatchOutcome::Failed { name, error }),
                Err(error) => outcomes.push(WatchOutcome::Stays { name, error }),
            }
        }
        Ok(outcomes)
    }

    #[cfg(not(target_os = "linux"))]
    fn read_fifos(&mut self) -> Result<Vec<WatchOutcome>, NumberedError> {
        Ok(Vec::new())
    }

    /// Lists the folder and submits what is whole. `now` never goes back.
    ///
    /// # Errors
    /// `E5010` where the folder cannot be read.
    pub fn poll(&mut self, now: Instant) -> Result<Vec<WatchOutcome>, NumberedError> {
        // a folder that does not exist is as a share that is not there
        fs::metadata(&self.config.path).map_err(|error| unusable(&self.config.path, &error))?;
        let mut outcomes = self.read_fifos()?;
        let names = folder_names(&self.config.path)?;
        self.standing.retain(|name, _| names.contains(name));
        for name in names.iter().filter(|name| is_candidate(name)) {
            let path = self.config.path.join(name);
            let found = match fs::symlink_metadata(&path) {
                Ok(found) if found.is_file() => FileStamp::of(&found),
                _ => continue,
            };
            if self.is_whole(name, found, now, &names) {
                outcomes.extend(self.submit(name, found));
            }
        }
        Ok(outcomes)
    }

    fn is_whole(&mut self, name: &str, found: FileStamp, now: Instant, names: &[String]) -> bool {
        if self.config.needs_ready_file {
            return names.contains(&format!("{name}{READY}"));
        }
        let standing = self.standing.entry(name.to_owned()).or_insert((found, now));
        if standing.0 != found {
            *standing = (found, now);
        }
        now.duration_since(standing.1) >= STANDING_TIME
    }

    /// Submits a whole file. `None` where it was changed meanwhile.
    fn submit(&mut self, name: &str, stamp: FileStamp) -> Option<WatchOutcome> {
        match self.try_submit(name, stamp) {
            Ok(Some(id)) => {
                self.standing.remove(name);
                Some(WatchOutcome::Submitted { name: name.into(), id })
            }
            Ok(None) => {
                self.standing.remove(name);
                None
            }
            Err(error) if matches!(error.number, "E5008" | "E5009" | "E5010") => {
                Some(WatchOutcome::Stays { name: name.into(), error })
            }
            Err(error) => {
                self.standing.remove(name);
                let moved_name = free_name(&self.config.failed, &format!("{}-{name}", date()));
                match self.move_file(name, &self.config.failed, &moved_name) {
                    Ok(()) => Some(WatchOutcome::Failed { name: name.into(), error }),
                    Err(error) => Some(WatchOutcome::Stays { name: name.into(), error }),
                }
            }
        }
    }

    fn try_submit(&self, name: &str, stamp: FileStamp) -> Result<Option<ShopJobId>, NumberedError> {
        let (path, queue) = (self.config.path.join(name), JobQueue::of(&self.machine));
        let source = SourceFile { role: BundleRole::Program, name: name.into(), path: path.clone() };
        let staged = queue.stage(&[source], self.limits)?;
        let is_as_found = fs::symlink_metadata(&path).is_ok_and(|now| now.is_file() && FileStamp::of(&now) == stamp);
        if !is_as_found {
            return Ok(None);
        }
        let (bundle, sha256) = (staged.bundle().hash(), staged.bundle().files()[0].sha256);
        let mut log = WatchLog::open(&self.machine.watch_log(), &self.config.done)?;
        let found = self.found_file(&mut log, name, sha256)?;
        let job = ShopJob {
            id: found.id,
            bundle,
            target: JobTarget::Machine(self.config.machine.clone()),
            quantity: 1,
            may_repeat: false,
            order_number: String::new(),
            note: String::new(),
            material: String::new(),
            submitter: format!("folder {}", folder_text(&self.config.path)),
            machine_file: None,
            submitted: found.when,
        };
        // a process that was killed may have submitted it, and the agent taken it
        if Ledger::read(&self.machine.ledger())?.job(found.id).is_none() {
            staged.submit(&job)?;
        }
        self.move_file(name, &self.config.done, &found.moved_name)?;
        log.append_moved(found.id)?;
        Ok(Some(found.id))
    }

    /// The entry of a file in the log, which is durable.
    fn found_file(&self, log: &mut WatchLog, name: &str, sha256: ContentHash) -> Result<FoundFile, NumberedError> {
        if let Some(found) = log.pending_file(name, sha256) {
            return Ok(found);
        }
        if log.has(name, sha256) && !self.config.allow_repeats {
            let what = format!("{name} was submitted before with the same content");
            let remedy = "give the file another name, or set `allow_repeats = true` in [watch] of the shop file";
            return Err(NumberedError::new("E5017", what, remedy));
        }
        let moved_name = free_name(&self.config.done, &format!("{}-{}-{name}", date(), sha256.short()));
        let found =
            FoundFile { when: Timestamp::now(), name: name.into(), sha256, id: ShopJobId::new_now()?, moved_name };
        log.append_found(found.clone())?;
        Ok(found)
    }

    /// Moves a file, and deletes its ready file.
    fn move_file(&self, name: &str, folder: &Path, moved_name: &str) -> Result<(), NumberedError> {
        state_file::create_private_folder(folder).map_err(|error| unusable(folder, &error))?;
        let target = folder.join(moved_name);
        fs::rename(self.config.path.join(name), &target).map_err(|error| unusable(&target, &error))?;
        sync_folder(folder)?;
        let ready = self.config.path.join(format!("{name}{READY}"));
        if self.config.needs_ready_file {
            fs::remove_file(&ready).map_err(|error| unusable(&ready, &error))?;
        }
        Ok(())
    }
}

fn is_candidate(name: &str) -> bool {
    !name.starts_with('.') && !name.ends_with(READY) && !UNFINISHED.iter().any(|end| name.ends_with(end))
}

/// The day, as in `20261122`.
fn date() -> String {
    Timestamp::now().compact().chars().take(8).collect()
}

/// A name that no file of the folder has.
fn free_name(folder: &Path, name: &str) -> String {
    let numbered = (2..).map(|number| format!("{number}-{name}"));
    let is_free = |name: &String| fs::symlink_metadata(folder.join(name)).is_err();
    std::iter::once(name.to_owned()).chain(numbered).find(is_free).unwrap_or_default()
}

/// A folder as one line of text, for the operator.
fn folder_text(path: &Path) -> String {
    let text: String = path.display().to_string().chars().filter(|letter| !letter.is_control()).collect();
    text.chars().rev().take(200).collect::<Vec<char>>().into_iter().rev().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine_name::MachineName;

    struct Watched {
        root: tempfile::TempDir,
        watch: FolderWatch,
        now: Instant,
    }

    impl Watched {
        fn new(change: impl FnOnce(&mut WatchConfig)) -> Self {
            let root = tempfile::tempdir().expect("a folder");
            let path = root.path().join("in");
            fs::create_dir(&path).expect("a folder");
            let (done, failed) = (path.join("done"), path.join("failed"));
            let machine = MachineName::local();
            let mut config = WatchConfig { path, machine, done, failed, allow_repeats: false, needs_ready_file: false };
            change(&mut config);
            let folder = MachineFolder::of(&root.path().join("shop"), &config.machine);
            folder.create().expect("created");
            let watch = FolderWatch::new(config, folder, InboxLimits { max_bytes: 1 << 20, disk_reserve_bytes: 0 });
            Self { root, watch, now: Instant::now() }
        }

        fn write(&self, name: &str, text: &str) {
            fs::write(self.root.path().join("in").join(name), text).expect("a file");
        }

        /// Names of the files that are submitted after this time, with `!` and the number of those that are not.
        fn after(&mut self, ms: u64) -> Vec<String> {
            self.now += Duration::from_millis(ms);
            let outcomes = self.watch.poll(self.now).expect("a folder");
            let text = |outcome: WatchOutcome| match outcome {
                WatchOutcome::Submitted { name, .. } => name,
                WatchOutcome::Failed { name, error } | WatchOutcome::Stays { name, error } => {
                    format!("!{} {name}", error.number)
                }
            };
            outcomes.into_iter().map(text).collect()
        }

        fn queued(&self) -> usize {
            JobQueue::of(&self.watch.machine).ids().expect("a queue").len()
        }

        fn names(&self, folder: &str) -> Vec<String> {
            folder_names(&self.root.path().join("in").join(folder)).expect("a folder")
        }
    }

    #[test]
    fn a_file_that_arrives_slowly_is_submitted_once_when_it_stands() {
        let mut watched = Watched::new(|_| {});
        for text in ["G0", "G0 X1", "G0 X1\nM2\n"] {
            watched.write("part.ngc", text);
            assert_eq!(watched.after(1500), Vec::<String>::new(), "{text}");
        }
        assert!(watched.watch.has_standing_files());
        assert_eq!(watched.after(1999), Vec::<String>::new());
        assert_eq!(watched.after(1), ["part.ngc"]);
        assert_eq!((watched.after(5000).len(), watched.queued()), (0, 1));
        let hash = ContentHash::of(b"G0 X1\nM2\n").short();
        assert_eq!(watched.names("done"), [format!("{}-{hash}-part.ngc", date())]);
        assert!(!watched.watch.has_standing_files());
    }

    #[test]
    fn renamed_files_are_jobs_and_repeated_ones_are_not() {
        let mut watched = Watched::new(|_| {});
        watched.write("part.ngc.part", "M2\n");
        assert_eq!((watched.after(0).len(), watched.after(3000).len()), (0, 0));
        let folder = watched.root.path().join("in");
        fs::rename(folder.join("part.ngc.part"), folder.join("part.ngc")).expect("renamed");
        assert_eq!((watched.after(1000).len(), watched.after(2000)), (0, vec!["part.ngc".to_owned()]));
        for (name, expected) in [("part.ngc", "!E5017 part.ngc"), ("other.ngc", "other.ngc")] {
            watched.write(name, "M2\n");
            assert_eq!((watched.after(0).len(), watched.after(2000)), (0, vec![expected.to_owned()]));
        }
        watched.write("part.ngc", "M30\n");
        assert_eq!((watched.after(0).len(), watched.after(2000)), (0, vec!["part.ngc".to_owned()]));
        assert_eq!((watched.queued(), watched.names("done").len(), watched.names("failed").len()), (3, 3, 1));

        let mut repeating = Watched::new(|config| config.allow_repeats = true);
        for _ in 0..2 {
            repeating.write("part.ngc", "M2\n");
            assert_eq!((repeating.after(0).len(), repeating.after(2000)), (0, vec!["part.ngc".to_owned()]));
        }
        assert_eq!((repeating.queued(), repeating.names("done").len()), (2, 2));
    }

    #[test]
    fn a_file_with_a_ready_file_is_whole_at_once_and_others_are_not() {
        let mut watched = Watched::new(|config| config.needs_ready_file = true);
        watched.write("part.ngc", "M2\n");
        assert_eq!((watched.after(0).len(), watched.after(9000).len()), (0, 0));
        watched.write("part.ngc.ready", "");
        assert_eq!(watched.after(1), ["part.ngc"]);
        assert_eq!(watched.names(""), ["done"]);
    }

    #[test]
    fn names_that_no_job_can_have_fail() {
        let mut watched = Watched::new(|_| {});
        watched.write("a\u{7}b.ngc", "M2\n");
        assert_eq!((watched.after(0).len(), watched.after(2000)), (0, vec!["!E5005 a\u{7}b.ngc".to_owned()]));
        assert_eq!((watched.queued(), watched.names("failed").len()), (0, 1));
    }

    #[cfg(unix)]
    #[test]
    fn links_and_folders_are_not_followed() {
        let mut watched = Watched::new(|_| {});
        let secret = watched.root.path().join("secret");
        fs::write(&secret, "M2\n").expect("a file");
        std::os::unix::fs::symlink(&secret, watched.root.path().join("in/link.ngc")).expect("a link");
        fs::create_dir(watched.root.path().join("in/folder.ngc")).expect("a folder");
        assert_eq!((watched.after(0).len(), watched.after(9000).len(), watched.queued()), (0, 0, 0));
        fs::remove_dir_all(watched.root.path().join("in")).expect("deleted");
        assert_eq!(watched.watch.poll(watched.now).expect_err("gone").number, "E5010");
    }

    #[test]
    fn a_process_that_was_killed_at_any_step_submits_the_same_job() {
        // found, and killed before the job was submitted; before the file was moved; before that was logged
        for steps in 0..3 {
            let mut watched = Watched::new(|config| config.allow_repeats = true);
            watched.write("part.ngc", "M2\n");
            let log = || WatchLog::open(&watched.watch.machine.watch_log(), &watched.watch.config.done).expect("a log");
            let sha256 = ContentHash::of(b"M2\n");
            let found = watched.watch.found_file(&mut log(), "part.ngc", sha256).expect("logged");
            if steps >= 1 {
                let path = watched.root.path().join("in/part.ngc");
                let source = SourceFile { role: BundleRole::Program, name: "part.ngc".into(), path };
                let staged =
                    JobQueue::of(&watched.watch.machine).stage(&[source], watched.watch.limits).expect("staged");
                let job = ShopJob { id: found.id, ..crate::job::tests::job(1, staged.bundle().hash()) };
                staged.submit(&job).expect("submitted");
            }
            if steps >= 2 {
                let done = watched.watch.config.done.clone();
                watched.watch.move_file("part.ngc", &done, &found.moved_name).expect("moved");
            }
            let expected = if steps >= 2 { vec![] } else { vec!["part.ngc".to_owned()] };
            assert_eq!((watched.after(0).len(), watched.after(2000)), (0, expected));
            assert_eq!(JobQueue::of(&watched.watch.machine).ids(), Ok(vec![found.id]), "{steps} steps");
            // and the same file is another job when it comes again
            watched.write("part.ngc", "M2\n");
            assert_eq!((watched.after(0).len(), watched.after(2000)), (0, vec!["part.ngc".to_owned()]));
            assert_eq!(watched.queued(), 2, "{steps} steps");
        }
    }
}
