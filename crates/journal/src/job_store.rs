//! The job store: one folder per job, with its journal, the program that was streamed for it, and its report.
//!
//! Invariant: a job's folder is created by one process only and is durable before anything moves. One process at a time
//! locks a job. Only what can never be resumed is deleted.

use std::ffi::OsString;
use std::fs::{self, File, TryLockError};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use retrace_config::{NumberedError, nearest};

use crate::entry::JobEnding;
use crate::job_record::{JobRecord, JobSummary};
use crate::journal_store::FileStore;
use crate::state_file;
use crate::timestamp::Timestamp;

/// Maximum number of completed jobs that are retained.
const MAX_COMPLETED: usize = 100;
/// Maximum number of bytes of completed jobs that are retained.
const MAX_COMPLETED_BYTES: u64 = 1 << 30;
/// Age after which a folder in which no job has begun may be deleted.
const NEVER_BEGAN_AGE: Duration = Duration::from_secs(86_400);

const JOURNAL: &str = "journal";
const LOCK: &str = "lock";
const STREAM: &str = "stream.ngc";
const REPORT: &str = "report.json";

/// The folder of jobs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JobStore {
    folder: PathBuf,
}

/// The folder of one job.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JobFolder {
    path: PathBuf,
    id: String,
}

/// A lock on a job, until it is dropped or the process ends, however that ends.
#[derive(Debug)]
pub struct JobLock(#[expect(dead_code, reason = "the lock goes with the open file")] File);

/// State of a job.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum JobState {
    /// A process has it locked; its process number where that is known.
    Running(Option<u32>),
    /// The job began, and its end is not recorded: the computer or the process failed. It can be resumed.
    Interrupted,
    /// The operator stopped it, or a block was refused. It can be resumed.
    Stopped,
    /// An alarm stopped it. It can be resumed.
    Alarm,
    /// It was completed.
    Completed,
    /// Nothing has moved.
    NeverBegan,
    /// Its journal cannot be used.
    Unusable(NumberedError),
}

impl JobState {
    /// Whether it can be resumed.
    #[must_use]
    pub fn can_resume(&self) -> bool {
        matches!(self, Self::Interrupted | Self::Stopped | Self::Alarm)
    }

    /// The state as one word.
    #[must_use]
    pub fn word(&self) -> &'static str {
        match self {
            Self::Running(_) => "running",
            Self::Interrupted => "interrupted",
            Self::Stopped => "stopped",
            Self::Alarm => "alarm",
            Self::Completed => "completed",
            Self::NeverBegan => "never began",
            Self::Unusable(_) => "unusable",
        }
    }
}

/// A job in the list.
#[derive(Clone, Debug, PartialEq)]
pub struct ListedJob {
    /// Its folder.
    pub folder: JobFolder,
    /// Its state.
    pub state: JobState,
    /// Summary of its journal. None where the journal cannot be used.
    pub summary: Option<JobSummary>,
}

impl JobStore {
    /// The jobs of this folder, which need not exist yet.
    #[must_use]
    pub fn open(folder: &Path) -> Self {
        Self { folder: folder.to_owned() }
    }

    /// The jobs of the given folder, or of the user's own: below `XDG_STATE_HOME` or `~/.local/state`, or what is usual
    /// on other systems.
    ///
    /// # Errors
    /// `E2201` where no folder was given and the user has none.
    pub fn open_or_default(folder: Option<&Path>) -> Result<Self, NumberedError> {
        let usual = || default_state_folder(|name| std::env::var_os(name));
        folder.map(Path::to_owned).or_else(usual).map(|folder| Self { folder }).ok_or_else(|| {
            let what = "no folder for jobs: neither XDG_STATE_HOME nor HOME names one";
            NumberedError::new("E2201", what, "name one with --journal DIR")
        })
    }

    /// The user's state folder, found in the same manner as that of the jobs. None where the user has none.
    #[must_use]
    pub fn state_folder() -> Option<PathBuf> {
        default_state_folder(|name| std::env::var_os(name))?.parent().map(Path::to_owned)
    }

    /// Path of the folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Creates a folder for a job of this program, which begins at `when`.
    ///
    /// # Errors
    /// `E2105`
    pub fn create(&self, program: &str, when: Timestamp) -> Result<JobFolder, NumberedError> {
        state_file::create_private_folder(&self.folder).map_err(|error| unwritable(&self.folder, &error))?;
        let first = format!("{}-{}", when.compact(), plain_name(program));
        let names = (2..=9999).map(|n| format!("{first}-{n}"));
        for id in std::iter::once(first.clone()).chain(names) {
            let path = self.folder.join(&id);
            match state_file::create_new_private_folder(&path) {
                Ok(()) => return Ok(JobFolder { path, id }),
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => return Err(unwritable(&path, &error)),
            }
        }
        Err(unwritable(&self.folder, &io::Error::from(ErrorKind::AlreadyExists)))
    }

    /// Finds the job of this name, or the only one whose name begins so.
    ///
    /// # Errors
    /// `E2202` with the job that may have been meant.
    pub fn find(&self, id: &str) -> Result<JobFolder, NumberedError> {
        let all = self.folders();
        if let Some(job) = all.iter().find(|job| job.id == id) {
            return Ok(job.clone());
        }
        let mut near = all.iter().filter(|job| !id.is_empty() && job.id.starts_with(id));
        if let (Some(job), None) = (near.next(), near.next()) {
            return Ok(job.clone());
        }
        let remedy = match nearest(id, all.iter().map(|job| job.id.as_str())) {
            Some(near) => format!("did you mean {near}? `retrace jobs` lists them"),
            None => "`retrace jobs --all` lists them; --journal names another folder".into(),
        };
        Err(NumberedError::new("E2202", format!("there is no job {id} in {}", self.folder.display()), remedy))
    }

    /// Lists all jobs, the newest first.
    #[must_use]
    pub fn list(&self) -> Vec<ListedJob> {
        let mut all: Vec<ListedJob> = self.folders().into_iter().map(JobFolder::into_listed).collect();
        all.sort_by_cached_key(|job| std::cmp::Reverse(job.age_key()));
        all
    }

    /// The newest job that can be resumed.
    #[must_use]
    pub fn newest_to_resume(&self) -> Option<ListedJob> {
        self.list().into_iter().find(|job| job.state.can_resume())
    }

    /// Deletes the oldest completed jobs beyond the number that is retained, and jobs that never began. Returns how
    /// many. What cannot be deleted stays.
    pub fn prune(&self) -> usize {
        let (mut completed, mut bytes, mut deleted) = (0, 0, 0);
        for job in self.list() {
            let is_kept = match job.state {
                JobState::Completed => {
                    completed += 1;
                    bytes += job.folder.bytes();
                    completed <= MAX_COMPLETED && bytes <= MAX_COMPLETED_BYTES
                }
                JobState::NeverBegan => !job.folder.is_older(NEVER_BEGAN_AGE),
                _ => true,
            };
            if !is_kept && job.folder.lock().is_ok() && fs::remove_dir_all(&job.folder.path).is_ok() {
                deleted += 1;
            }
        }
        deleted
    }

    /// The folders that may be those of jobs.
    fn folders(&self) -> Vec<JobFolder> {
        let Ok(entries) = fs::read_dir(&self.folder) else { return Vec::new() };
        let named = |entry: fs::DirEntry| {
            let id = entry.file_name().into_string().ok()?;
            (entry.path().is_dir() && is_id(&id)).then(|| JobFolder { path: entry.path(), id })
        };
        entries.filter_map(Result::ok).filter_map(named).collect()
    }
}

impl ListedJob {
    /// What orders jobs by their beginning: its second, its millisecond, the name. Where a journal does not have its
    /// time of beginning, the name has it, to the second.
    fn age_key(&self) -> (String, Option<u64>, String) {
        let id = &self.folder.id;
        let when = self.summary.as_ref().map(|summary| summary.job.when);
        let second = when.map_or_else(|| id.get(..15).unwrap_or_default().to_owned(), Timestamp::compact);
        (second, when.map(Timestamp::ms), id.clone())
    }
}

impl JobFolder {
    /// Name of the job.
    #[must_use]
    pub fn id(&self) -> &str {
        &self.id
    }

    /// Path of its journal.
    #[must_use]
    pub fn journal(&self) -> PathBuf {
        self.path.join(JOURNAL)
    }

    /// Path of the program that was streamed for it.
    #[must_use]
    pub fn stream(&self) -> PathBuf {
        self.path.join(STREAM)
    }

    /// Path of its report.
    #[must_use]
    pub fn report(&self) -> PathBuf {
        self.path.join(REPORT)
    }

    /// Creates its journal, empty, and makes the file durable.
    ///
    /// # Errors
    /// `E2105`
    pub fn create_journal(&self) -> Result<FileStore, NumberedError> {
        let path = self.journal();
        let store = FileStore::create(&path).map_err(|error| unwritable(&path, &error))?;
        let above = self.path.parent().unwrap_or(&self.path);
        for folder in [&self.path, above] {
            sync_folder(folder).map_err(|error| unwritable(folder, &error))?;
        }
        Ok(store)
    }

    /// Opens its journal to append to it.
    ///
    /// # Errors
    /// `E2105`
    pub fn open_journal(&self) -> Result<FileStore, NumberedError> {
        let path = self.journal();
        FileStore::open(&path).map_err(|error| unwritable(&path, &error))
    }

    /// Reads its journal.
    ///
    /// # Errors
    /// As [`JobRecord::read`].
    pub fn read(&self) -> Result<JobRecord, NumberedError> {
        JobRecord::read(&self.journal())
    }

    /// Locks the job against every other process.
    ///
    /// # Errors
    /// `E2206` where another process has it; `E2105` where the folder does not support locks.
    pub fn lock(&self) -> Result<JobLock, NumberedError> {
        let path = self.path.join(LOCK);
        let failed = |error: &io::Error| unwritable(&path, error);
        let mut file = state_file::open_lock(&path).map_err(|error| failed(&error))?;
        // A process that lists the jobs has the lock for a moment.
        let mut patience = 10;
        loop {
            match file.try_lock() {
                Ok(()) => break,
                Err(TryLockError::Error(error)) => return Err(failed(&error)),
                Err(TryLockError::WouldBlock) if patience > 0 => {
                    patience -= 1;
                    std::thread::sleep(Duration::from_millis(5));
                }
                Err(TryLockError::WouldBlock) => {
                    let who = self.holder().map_or("another process".into(), |pid| format!("process {pid}"));
                    let remedy = "wait until it ends, or stop it there";
                    return Err(NumberedError::new("E2206", format!("job {} is running in {who}", self.id), remedy));
                }
            }
        }
        // The number is for people; failing to write it prevents nothing.
        let _ = file.set_len(0).and_then(|()| writeln!(file, "{}", std::process::id()));
        Ok(JobLock(file))
    }

    /// Whether a living process has it locked.
    fn is_locked(&self) -> bool {
        let path = self.path.join(LOCK);
        let is_plain = fs::symlink_metadata(&path).is_ok_and(|found| found.is_file());
        is_plain && File::open(path).is_ok_and(|lock| matches!(lock.try_lock_shared(), Err(TryLockError::WouldBlock)))
    }

    fn holder(&self) -> Option<u32> {
        fs::read_to_string(self.path.join(LOCK)).ok()?.trim().parse().ok()
    }

    /// State of the job.
    #[must_use]
    pub fn state(&self) -> JobState {
        self.clone().into_listed().state
    }

    fn into_listed(self) -> ListedJob {
        let glance = JobSummary::read(&self.journal());
        let state = match &glance {
            _ if self.is_locked() => JobState::Running(self.holder()),
            Ok(glance) => match &glance.end {
                None => JobState::Interrupted,
                Some(end) => match end.outcome {
                    JobEnding::Completed => JobState::Completed,
                    JobEnding::Stopped => JobState::Stopped,
                    JobEnding::Alarm => JobState::Alarm,
                },
            },
            Err(refusal) if refusal.number == "E2204" || !self.journal().exists() => JobState::NeverBegan,
            Err(refusal) => JobState::Unusable(refusal.clone()),
        };
        ListedJob { folder: self, state, summary: glance.ok() }
    }

    fn bytes(&self) -> u64 {
        let sizes = fs::read_dir(&self.path).into_iter().flatten().filter_map(|entry| entry.ok()?.metadata().ok());
        sizes.map(|of| of.len()).sum()
    }

    fn is_older(&self, than: Duration) -> bool {
        let age = fs::metadata(&self.path).and_then(|of| of.modified()).ok().and_then(|then| then.elapsed().ok());
        age.is_some_and(|age| age > than)
    }
}

/// A folder's entries are durable when the folder is synced; where it cannot be opened as a file, the system takes care
/// of that.
fn sync_folder(folder: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(folder)?.sync_all() } else { Ok(()) }
}

fn unwritable(path: &Path, error: &io::Error) -> NumberedError {
    let what = format!("{} cannot be written: {error}", path.display());
    NumberedError::new(
        "E2105",
        what,
        "check the folder's permissions and its disk, or name another one with --journal DIR",
    )
}

/// The usual folder on this system. A relative path is ignored, as the XDG base directory specification requires.
fn default_state_folder(variable: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    let named = |name| variable(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let base = named("XDG_STATE_HOME").or_else(|| {
        if cfg!(windows) {
            named("LOCALAPPDATA")
        } else if cfg!(target_os = "macos") {
            named("HOME").map(|home| home.join("Library").join("Application Support"))
        } else {
            named("HOME").map(|home| home.join(".local").join("state"))
        }
    })?;
    Some(base.join("retrace").join("jobs"))
}

/// The name of a file, without folders and extension, as part of a file name that every system accepts.
#[must_use]
pub fn plain_name(program: &str) -> String {
    let stem = Path::new(program).file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
    let letter = |c: char| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' };
    let name: String = stem.chars().map(letter).take(40).collect();
    let name = name.trim_matches('-');
    if name.is_empty() { "program".into() } else { name.into() }
}

/// Whether a name has the form that [`JobStore::create`] gives: date, time, program.
fn is_id(name: &str) -> bool {
    let digits = |from: usize, to: usize| name.get(from..to).is_some_and(|s| s.bytes().all(|b| b.is_ascii_digit()));
    let rest = name.get(16..).unwrap_or_default();
    digits(0, 8) && name.get(8..9) == Some("-") && digits(9, 15) && name.get(15..16) == Some("-") && !rest.is_empty()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::entry::tests::job;
    use crate::entry::{EndEntry, JobCard};
    use crate::journal_queue::Durability;
    use crate::journal_writer::JournalWriter;
    use serde_json::Value;

    fn folder() -> (tempfile::TempDir, JobStore) {
        let folder = tempfile::tempdir().expect("a folder");
        let jobs = JobStore::open(&folder.path().join("jobs"));
        (folder, jobs)
    }

    /// Creates a job that began in this second and ended so.
    fn ran(jobs: &JobStore, second: u64, ended: Option<JobEnding>) -> JobFolder {
        let when = Timestamp::from_ms(second * 1000);
        let folder = jobs.create("part.ngc", when).expect("a folder");
        let job = crate::entry::JobHeader { id: folder.id().into(), when, ..job("[machine]", JobCard::Sim) };
        let store = folder.create_journal().expect("a file");
        let logbook = JournalWriter::begin(store, Durability::Written, job, None).expect("it works");
        match ended {
            None => drop(logbook),
            Some(outcome) => {
                logbook.end(EndEntry { when, outcome, exit_code: 0, report: Value::Null }).expect("it works");
            }
        }
        folder
    }

    #[test]
    fn a_job_has_a_folder_of_its_own() {
        let (_folder, jobs) = folder();
        let when = Timestamp::from_ms(1_700_000_000_123);
        let names: Vec<String> =
            (0..3).map(|_| jobs.create("some/where/my part.ngc", when).expect("a folder").id().into()).collect();
        assert_eq!(names, ["20231114-221320-my-part", "20231114-221320-my-part-2", "20231114-221320-my-part-3"]);
        for (name, is) in
            [("-", "program"), ("ä.ngc", "program"), ("", "program"), ("a.b.nc", "a-b"), ("../..", "program")]
        {
            assert_eq!(plain_name(name), is, "{name}");
        }
        assert!(names.iter().all(|name| is_id(name)));
        assert!(!["", "20231114-221320-", "2023111-4221320-x", "report-1.json", "ä"].iter().any(|name| is_id(name)));
    }

    /// Jobs that begin within one second, of which some have no time, are in one order: `sort_by` panics otherwise.
    #[test]
    fn jobs_without_a_time_have_a_place_in_the_order_of_the_others() {
        let (_folder, jobs) = folder();
        // by their names in the other order than by their times
        for number in 0..60_u64 {
            let (when, name) = (Timestamp::from_ms(1_000_000 + number), format!("p{:02}.ngc", 99 - number));
            let folder = jobs.create(&name, when).expect("a folder");
            if number % 3 != 0 {
                let job = crate::entry::JobHeader { id: folder.id().into(), when, ..job("[machine]", JobCard::Sim) };
                let store = folder.create_journal().expect("a file");
                drop(JournalWriter::begin(store, Durability::Written, job, None).expect("it works"));
            }
        }
        let times: Vec<Option<u64>> =
            jobs.list().iter().map(|job| job.summary.as_ref().map(|summary| summary.job.when.ms())).collect();
        let known: Vec<u64> = times.iter().flatten().copied().collect();
        assert_eq!((times.len(), known.len()), (60, 40));
        assert!(known.is_sorted_by(|a, b| a > b), "{known:?}");
    }

    #[test]
    fn the_list_says_what_became_of_each_the_newest_first() {
        let (_folder, jobs) = folder();
        assert_eq!(jobs.list(), []);
        assert!(jobs.newest_to_resume().is_none());
        ran(&jobs, 100, Some(JobEnding::Stopped));
        ran(&jobs, 200, None);
        ran(&jobs, 300, Some(JobEnding::Alarm));
        ran(&jobs, 400, Some(JobEnding::Completed));
        let running = ran(&jobs, 500, None);
        let held = running.lock().expect("nobody has it");
        let empty = jobs.create("x", Timestamp::from_ms(600_000)).expect("a folder");
        let damaged = ran(&jobs, 700, None);
        let mut bytes = fs::read(damaged.journal()).expect("a file");
        let list = |jobs: &JobStore| jobs.list().iter().map(|job| job.state.word()).collect::<Vec<_>>();
        assert_eq!(
            list(&jobs),
            ["interrupted", "never began", "running", "completed", "alarm", "interrupted", "stopped"]
        );
        assert_eq!(running.state(), JobState::Running(Some(std::process::id())));
        assert_eq!(jobs.newest_to_resume().map(|job| job.folder), Some(damaged.clone()));
        drop(held);
        assert_eq!(running.state(), JobState::Interrupted);
        // of a newer version
        bytes.truncate(bytes.iter().position(|&b| b == b'\n').expect("a line") + 1);
        crate::journal_line::append(&mut bytes, 1, true, b"{\"novelty\":1}");
        fs::write(damaged.journal(), bytes).expect("a file");
        assert!(matches!(damaged.state(), JobState::Unusable(refusal) if refusal.number == "E2205"));
        // of an older one, with the crc of its first line
        let mut older = Vec::new();
        crate::journal_line::append(&mut older, 0, true, b"{\"job\":{\"format\":1,\"id\":\"x\"}}");
        fs::write(damaged.journal(), older).expect("a file");
        let JobState::Unusable(refusal) = damaged.state() else { panic!("{:?}", damaged.state()) };
        assert!(refusal.number == "E2205" && refusal.cause.contains("an older version"), "{refusal:?}");
        assert_eq!(empty.state(), JobState::NeverBegan);
    }

    #[test]
    fn a_job_is_held_once() {
        let (_folder, jobs) = folder();
        let job = ran(&jobs, 100, None);
        let held = job.lock().expect("nobody has it");
        let refusal = job.lock().expect_err("somebody has it");
        assert_eq!(refusal.number, "E2206");
        assert!(refusal.cause.contains(&std::process::id().to_string()));
        drop(held);
        assert!(job.lock().is_ok());
    }

    #[test]
    fn a_job_is_found_by_its_name_or_its_beginning() {
        let (_folder, jobs) = folder();
        let first = ran(&jobs, 100, None);
        let second = ran(&jobs, 86_500, None);
        assert_eq!(jobs.find(first.id()), Ok(first.clone()));
        assert_eq!(jobs.find("19700102"), Ok(second));
        for (id, hint) in [("1970", "lists"), ("19700101-000140-parr", first.id()), ("..", "lists"), ("", "lists")] {
            let refusal = jobs.find(id).expect_err("not one");
            assert!(refusal.number == "E2202" && refusal.remedy.contains(hint), "{id}: {refusal}");
        }
    }

    #[test]
    fn only_the_oldest_that_came_to_their_end_are_deleted() {
        let (_folder, jobs) = folder();
        let stopped = ran(&jobs, 1, Some(JobEnding::Stopped));
        let interrupted = ran(&jobs, 2, None);
        let empty = jobs.create("x", Timestamp::from_ms(3000)).expect("a folder");
        let completed: Vec<JobFolder> =
            (0..MAX_COMPLETED as u64 + 2).map(|n| ran(&jobs, 10 + n, Some(JobEnding::Completed))).collect();
        let held = completed[0].lock().expect("nobody has it");
        assert_eq!(jobs.prune(), 1);
        drop(held);
        assert_eq!(jobs.prune(), 1);
        assert_eq!(jobs.prune(), 0);
        let is_there = |job: &JobFolder| job.path.is_dir();
        assert!(is_there(&stopped) && is_there(&interrupted) && is_there(&empty));
        assert_eq!(completed.iter().map(is_there).take(3).collect::<Vec<_>>(), [false, false, true]);
    }

    #[test]
    fn the_usual_folder() {
        let with = |set: &[(&str, &str)]| {
            default_state_folder(|name| {
                set.iter().find(|(known, _)| *known == name).map(|(_, value)| OsString::from(value))
            })
        };
        let root = if cfg!(windows) { "C:\\" } else { "/" };
        let path = |name: &str| format!("{root}{name}");
        let jobs = |name: &str| Some(PathBuf::from(path(name)).join("retrace").join("jobs"));
        assert_eq!(with(&[("XDG_STATE_HOME", &path("state")), ("HOME", &path("me"))]), jobs("state"));
        assert_eq!(with(&[]), None);
        if cfg!(target_os = "linux") {
            assert_eq!(with(&[("XDG_STATE_HOME", "relative"), ("HOME", &path("me"))]), jobs("me/.local/state"));
        }
    }

    #[test]
    fn a_folder_that_cannot_be_made_is_refused() {
        let (folder, _) = folder();
        let file = folder.path().join("file");
        fs::write(&file, b"").expect("a file");
        assert_eq!(JobStore::open(&file).create("x", Timestamp::from_ms(0)).expect_err("a file").number, "E2105");
        assert_eq!(JobStore::open(&file).list(), []);
    }
}
