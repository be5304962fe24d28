//! Writes the journal in its own thread.
//!
//! Invariant: [`DurablePlace`] is never beyond the last mark that a reader would find after a power cut (after the end
//! of the process, where the journal is only written). Entries are saved in the order in which they were pushed. A
//! failing disk loses nothing that was durable: the rest is retained and written again, until it succeeds or the job
//! ends.

use retrace_core::RecordIndex;
use std::collections::VecDeque;
use std::io;
use std::thread::{self, JoinHandle};

use retrace_config::NumberedError;

use crate::durable_place::DurablePlace;
use crate::entry::{EndEntry, JobHeader, JournalEntry, PlannedOverride, PlannedRest, ResumeEntry, SpooledBytes};
use crate::journal_line;
use crate::journal_queue::{BatchStore, Durability, JournalNotice, JournalQueue};
use crate::journal_reader::JournalTail;
use crate::journal_store::JournalStore;
use crate::place_index::{IndexEntry, IndexWriter};
use crate::spool::SpoolProgress;

/// Writes the journal of a job. Dropped without [`JournalWriter::end`], it writes what it has, and the job counts as
/// interrupted.
#[derive(Debug)]
pub struct JournalWriter {
    queue: JournalQueue,
    writer: Option<JoinHandle<()>>,
}

impl JournalWriter {
    /// Begins a journal: its first entry is saved before this returns. The spool is that of a streamed program.
    ///
    /// # Errors
    /// `E2207`; nothing may move then.
    pub fn begin(
        store: impl JournalStore + 'static,
        care: Durability,
        job: JobHeader,
        spool: Option<SpoolProgress>,
    ) -> Result<Self, NumberedError> {
        let mut journal = Self::queueing(care, DurablePlace::starting_at(job.origin));
        journal.start(store, JournalEntry::Job(Box::new(job)), JournalTail::default(), spool)?;
        Ok(journal)
    }

    /// Creates a writer that queues entries and writes none before [`JournalWriter::resume`]: for a job that may be
    /// resumed, whose marks reach up to `durable`. Dropped before, it leaves the journal unchanged.
    #[must_use]
    pub fn queueing(care: Durability, durable: DurablePlace) -> Self {
        Self { queue: JournalQueue::new(care, durable), writer: None }
    }

    /// Continues a journal that was read up to this tail, and whose marks reach up to `durable`. What was torn is cut
    /// off.
    ///
    /// # Errors
    /// `E2207`; nothing may move then.
    pub fn reopen(
        store: impl JournalStore + 'static,
        care: Durability,
        tail: JournalTail,
        durable: DurablePlace,
        resumed: ResumeEntry,
        spool: Option<SpoolProgress>,
    ) -> Result<Self, NumberedError> {
        let mut journal = Self::queueing(care, durable);
        journal.resume(store, tail, resumed, spool)?;
        Ok(journal)
    }

    /// Continues the journal that this writer waits for, as [`JournalWriter::reopen`].
    ///
    /// # Errors
    /// `E2207`; nothing may move then.
    pub fn resume(
        &mut self,
        mut store: impl JournalStore + 'static,
        tail: JournalTail,
        resumed: ResumeEntry,
        spool: Option<SpoolProgress>,
    ) -> Result<(), NumberedError> {
        store.truncate(tail.whole).map_err(journal_error)?;
        self.start(store, JournalEntry::Resumed(Box::new(resumed)), tail, spool)
    }

    fn start(
        &mut self,
        store: impl JournalStore + 'static,
        first: JournalEntry,
        tail: JournalTail,
        spool: Option<SpoolProgress>,
    ) -> Result<(), NumberedError> {
        let kept = JournalFile { length: tail.whole, dirty: false, store };
        let mut writer = WriterThread {
            file: kept,
            care: self.queue.durability(),
            next: tail.next,
            spool,
            spooled: SpooledBytes::default(),
        };
        let batch = writer.format(vec![first]);
        writer.save(&batch).map_err(journal_error)?;
        writer.advance(batch);
        let queue = self.queue.clone();
        let writer = thread::Builder::new()
            .name("journal".into())
            .spawn(move || {
                // A job that is resumed calls this from its motion thread.
                let _ = retrace_real_time::leave();
                queue.write_batches(&mut writer);
            })
            .map_err(journal_error)?;
        self.writer = Some(writer);
        Ok(())
    }

    /// The planning thread's end, which receives the index entries. A resumed job passes `known`, the place of the last
    /// mark in the journal, and the overrides there: entries up to there are in the journal already.
    #[must_use]
    pub fn index_writer(&self, known: Option<RecordIndex>, overrides: &[PlannedOverride]) -> JournalIndexWriter {
        JournalIndexWriter {
            queue: self.queue.clone(),
            recorded_until: known,
            overrides: overrides.iter().copied().collect(),
        }
    }

    /// Durable place of the index, for the motion path. `None` where the motion path does not wait for it.
    #[must_use]
    pub fn durable_place(&self) -> Option<DurablePlace> {
        (self.queue.durability() == Durability::Synced).then(|| self.queue.durable().clone())
    }

    /// The reporting thread's end, which receives events and positions.
    #[must_use]
    pub fn event_writer(&self) -> JournalEventWriter {
        JournalEventWriter { queue: self.queue.clone() }
    }

    /// Waits until everything that was pushed is saved.
    ///
    /// # Errors
    /// `E2207`: it is not saved, because the disk fails.
    pub fn wait_until_saved(&self) -> Result<(), NumberedError> {
        self.queue.wait_until_saved().map_err(journal_error)
    }

    /// Writes the end of the job, and all that is still pending.
    ///
    /// # Errors
    /// `E2207`: that is not saved, and the job counts as interrupted.
    pub fn end(mut self, end: EndEntry) -> Result<(), NumberedError> {
        self.queue.state().queue.push_back(JournalEntry::End(Box::new(end)));
        self.close();
        let state = self.queue.state();
        state.write_error.as_ref().map_or(Ok(()), |why| Err(journal_error(why)))
    }

    fn close(&mut self) {
        self.queue.close();
        if let Some(writer) = self.writer.take() {
            // A panic in the writer is a defect, never an input; it is propagated, unless one is in progress already.
            if let Err(panic) = writer.join()
                && !thread::panicking()
            {
                std::panic::resume_unwind(panic);
            }
        }
    }
}

impl Drop for JournalWriter {
    fn drop(&mut self) {
        self.close();
    }
}

fn journal_error(why: impl std::fmt::Display) -> NumberedError {
    NumberedError::new(
        "E2207",
        format!("the journal cannot be written: {why}"),
        "make room on its disk, or name a folder elsewhere with --journal",
    )
}

/// The planning thread's end of the journal.
#[derive(Debug)]
pub struct JournalIndexWriter {
    queue: JournalQueue,
    /// Place of the last mark that is in the journal already.
    recorded_until: Option<RecordIndex>,
    overrides: VecDeque<PlannedOverride>,
}

impl IndexWriter for JournalIndexWriter {
    fn write(&mut self, note: IndexEntry) {
        match note {
            IndexEntry::Mark(mark) => {
                if self.recorded_until.is_none_or(|known| known.is_before(mark.place)) {
                    self.queue.push_index_entry(JournalEntry::Mark(mark));
                }
            }
            IndexEntry::Length(change) => self.queue.push_index_entry(JournalEntry::ToolLength(change)),
            IndexEntry::Tap(begin) => self.queue.push_index_entry(JournalEntry::Tap(begin)),
            IndexEntry::Answer(answer) => self.queue.push_index_entry(JournalEntry::Answer(answer)),
            IndexEntry::Rest { block } => self.queue.push_index_entry(JournalEntry::Rest(PlannedRest { block })),
            IndexEntry::Override { place, planned } => {
                let noted = PlannedOverride { place, planned };
                if self.overrides.front() == Some(&noted) {
                    self.overrides.pop_front();
                    return;
                }
                // From here on the plan differs, and so do its marks.
                (self.recorded_until, self.overrides) = (None, VecDeque::new());
                self.queue.push_index_entry(JournalEntry::Override(noted));
            }
        }
    }

    fn is_durable(&mut self) -> bool {
        let state = self.queue.state();
        self.queue.durability() == Durability::Written
            || state.queue.is_empty() && state.unsaved == 0 && state.write_error.is_none()
    }
}

/// The reporting thread's end of the journal.
#[derive(Debug)]
pub struct JournalEventWriter {
    queue: JournalQueue,
}

impl JournalEventWriter {
    /// Writes an entry that the job can be resumed without: an event or a position.
    pub fn write(&self, entry: JournalEntry) {
        self.queue.push_event(entry);
    }

    /// Next notice to the operator about the journal itself: an alarm where it cannot be written, a message when it can
    /// again.
    #[must_use]
    pub fn next_notice(&self) -> Option<JournalNotice> {
        self.queue.next_notice()
    }
}

/// Entries as lines.
struct EntryBatch {
    bytes: Vec<u8>,
    /// Sequence number of the line behind them.
    next: u64,
    /// Place of the last mark.
    place: Option<RecordIndex>,
}

struct WriterThread<S> {
    file: JournalFile<S>,
    care: Durability,
    next: u64,
    spool: Option<SpoolProgress>,
    /// Length of the spool that the journal records.
    spooled: SpooledBytes,
}

impl<S: JournalStore> BatchStore for WriterThread<S> {
    type Batch = EntryBatch;

    /// Formats entries as lines. The state of the spool precedes them, as they may depend on it.
    fn format(&mut self, entries: Vec<JournalEntry>) -> EntryBatch {
        let mut batch = EntryBatch { bytes: Vec::new(), next: self.next, place: None };
        let spooled = self.spool.as_ref().map(SpoolProgress::spooled).filter(|now| *now != self.spooled);
        if let Some(now) = spooled {
            self.spooled = now;
        }
        // The very first line is the job's.
        let (before, behind) = if self.next == 0 { (None, spooled) } else { (spooled, None) };
        let spooled = |spooled: Option<SpooledBytes>| spooled.map(JournalEntry::Spooled);
        for entry in spooled(before).into_iter().chain(entries).chain(spooled(behind)) {
            if let JournalEntry::Mark(mark) = &entry {
                batch.place = Some(mark.place);
            }
            // An entry consists of numbers and strings, and its maps have string keys: it can always be serialized.
            let json = serde_json::to_vec(&entry).unwrap_or_default();
            journal_line::append(&mut batch.bytes, batch.next, batch.next == self.next, &json);
            batch.next += 1;
        }
        batch
    }

    fn save(&mut self, batch: &EntryBatch) -> io::Result<()> {
        if let (Durability::Synced, Some(spool)) = (self.care, &mut self.spool) {
            spool.sync(self.spooled)?;
        }
        self.file.append(&batch.bytes, self.care)
    }

    fn advance(&mut self, batch: EntryBatch) -> Option<RecordIndex> {
        self.next = batch.next;
        batch.place
    }
}

/// A store, and the length of its valid part.
struct JournalFile<S> {
    store: S,
    length: u64,
    /// Other bytes may follow that part.
    dirty: bool,
}

impl<S: JournalStore> JournalFile<S> {
    /// Appends the bytes, or leaves the store to be truncated the next time. After a failed sync they are written
    /// again: the system may have discarded them without notice.
    fn append(&mut self, bytes: &[u8], care: Durability) -> io::Result<()> {
        if self.dirty {
            self.store.truncate(self.length)?;
        }
        self.dirty = true;
        self.store.write(bytes)?;
        if care == Durability::Synced {
            self.store.sync()?;
        }
        (self.dirty, self.length) = (false, self.length + bytes.len() as u64);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::entry::tests::job;
    use crate::entry::{JobCard, JobEnding};
    use crate::journal_queue::CAPACITY;
    use crate::journal_reader::JournalEntries;
    use crate::place_index::PlaceMark;
    use crate::timestamp::Timestamp;
    use retrace_core::{Place, Rate, RecordIndex};
    use serde_json::{Value, json};
    use std::sync::{Arc, Mutex, MutexGuard};
    use std::time::Duration;

    /// A disk for tests: what was written, and the part of it that survives a power cut.
    #[derive(Clone, Debug, Default)]
    struct FakeDiskState(Arc<Mutex<FakeDisk>>);

    #[derive(Debug, Default)]
    struct FakeDisk {
        bytes: Vec<u8>,
        synced: usize,
        /// Bytes that can be written before it fails for good.
        room: Option<usize>,
        /// Number of calls so far, and the calls that fail.
        calls: usize,
        failing: Vec<usize>,
        /// Every later call fails.
        dead: bool,
    }

    impl FakeDiskState {
        fn disk(&self) -> MutexGuard<'_, FakeDisk> {
            self.0.lock().expect("no panic")
        }

        fn call(&self) -> io::Result<MutexGuard<'_, FakeDisk>> {
            let mut platter = self.disk();
            platter.calls += 1;
            let fails = platter.dead || platter.failing.contains(&(platter.calls - 1));
            if fails { Err(io::Error::other("out of order")) } else { Ok(platter) }
        }
    }

    impl JournalStore for FakeDiskState {
        fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
            let fails = self.call().is_err();
            let mut platter = self.disk();
            // A call that fails has done half of its work.
            let most = if platter.dead {
                0
            } else if fails {
                bytes.len() / 2
            } else {
                bytes.len()
            };
            let count = most.min(platter.room.unwrap_or(usize::MAX));
            platter.bytes.extend_from_slice(&bytes[..count]);
            platter.room = platter.room.map(|room| room - count);
            platter.dead |= platter.room == Some(0) && count < bytes.len();
            if count < bytes.len() { Err(io::Error::other("no space left")) } else { Ok(()) }
        }

        fn sync(&mut self) -> io::Result<()> {
            if let Err(error) = self.call() {
                // Like Linux: what could not be written is forgotten, and the next sync succeeds.
                let mut platter = self.disk();
                let from = platter.synced;
                platter.bytes[from..].fill(0);
                return Err(error);
            }
            let mut platter = self.disk();
            platter.synced = platter.bytes.len();
            Ok(())
        }

        fn truncate(&mut self, length: u64) -> io::Result<()> {
            let mut platter = self.call()?;
            assert!(length as usize >= platter.synced || platter.synced == 0, "what is durable is never cut off");
            platter.bytes.truncate(length as usize);
            Ok(())
        }
    }

    fn mark(place: u32) -> PlaceMark {
        PlaceMark {
            place: RecordIndex::new(place),
            block: u64::from(place) * 2,
            line: place + 1,
            counts: [i64::from(place), -7, 0, 0, 0, 0, 0, 0, 0],
        }
    }

    fn event(n: u32) -> JournalEntry {
        JournalEntry::Event(json!({"event": "operator", "n": n}))
    }

    fn end() -> EndEntry {
        EndEntry { when: Timestamp::from_ms(5), outcome: JobEnding::Stopped, exit_code: 4, report: json!({"x": 0.1}) }
    }

    fn begin(disk: &FakeDiskState, care: Durability) -> Result<JournalWriter, NumberedError> {
        JournalWriter::begin(disk.clone(), care, job("[machine]", JobCard::Sim), None)
    }

    /// The entries that a reader finds, or the error.
    fn entries_of(bytes: &[u8]) -> Result<Vec<JournalEntry>, String> {
        JournalEntries::new(bytes).map(|entry| entry.map(|(_, entry)| entry).map_err(|flaw| flaw.to_string())).collect()
    }

    fn last_place(entries: &[JournalEntry]) -> Option<u32> {
        let place =
            |entry: &JournalEntry| if let JournalEntry::Mark(mark) = entry { Some(mark.place.number()) } else { None };
        entries.iter().rev().find_map(place)
    }

    /// Pushes a synthetic job, waits for it to be saved now and then, and checks each time that what counts as durable
    /// is on the disk.
    fn journal_a_job(disk: &FakeDiskState) -> (Vec<JournalEntry>, Result<(), NumberedError>) {
        let mut handed = vec![JournalEntry::Job(Box::new(job("[machine]", JobCard::Sim)))];
        let journal = match begin(disk, Durability::Synced) {
            Ok(journal) => journal,
            Err(refusal) => return (handed, Err(refusal)),
        };
        let durable = journal.durable_place().expect("it is synced");
        let mut notes = journal.index_writer(None, &[]);
        for n in 0..6_u32 {
            for place in [100 * n + 40, 100 * n + 90] {
                notes.write(IndexEntry::Mark(mark(place)));
                handed.push(JournalEntry::Mark(mark(place)));
            }
            if n == 3 {
                notes.write(IndexEntry::Override { place: RecordIndex::new(390), planned: Rate::ONE * 3 });
                handed.push(JournalEntry::Override(PlannedOverride {
                    place: RecordIndex::new(390),
                    planned: Rate::ONE * 3,
                }));
            }
            journal.event_writer().write(event(n));
            handed.push(event(n));
            if n % 2 == 1 {
                let _ = journal.wait_until_saved();
            }
            let (place, platter) = (durable.place().number(), disk.disk());
            let after_a_power_cut = entries_of(&platter.bytes[..platter.synced]).expect("what is synced is whole");
            assert!(place <= last_place(&after_a_power_cut).unwrap_or(5), "{place} is not durable");
        }
        handed.push(JournalEntry::End(Box::new(end())));
        (handed, journal.end(end()))
    }

    #[test]
    fn what_is_handed_over_is_kept_in_its_order() {
        let disk = FakeDiskState::default();
        let (handed, ended) = journal_a_job(&disk);
        assert_eq!(ended, Ok(()));
        let platter = disk.disk();
        assert_eq!(platter.synced, platter.bytes.len());
        assert_eq!(entries_of(&platter.bytes), Ok(handed));
    }

    #[test]
    fn what_was_synced_before_the_last_batch_is_never_taken_for_torn() {
        let disk = FakeDiskState::default();
        let journal = begin(&disk, Durability::Synced).expect("it works");
        let mut notes = journal.index_writer(None, &[]);
        let mut lengths = Vec::new();
        for place in 6..9 {
            lengths.push(disk.disk().bytes.len());
            notes.write(IndexEntry::Mark(mark(place)));
            journal.wait_until_saved().expect("it works");
        }
        drop((notes, journal));
        let bytes = disk.disk().bytes.clone();
        for at in lengths[0]..bytes.len() {
            let mut changed = bytes.clone();
            changed[at] ^= 4;
            assert_eq!(entries_of(&changed).is_err(), at < lengths[2], "byte {at}");
        }
    }

    #[test]
    fn stopped_at_any_byte_it_is_a_beginning_of_what_was_handed_over() {
        let whole = FakeDiskState::default();
        journal_a_job(&whole).1.expect("it works");
        let length = whole.disk().bytes.len();
        for room in 0..length {
            let disk = FakeDiskState::default();
            disk.disk().room = Some(room);
            let (handed, ended) = journal_a_job(&disk);
            let platter = disk.disk();
            match ended {
                // In fewer batches it is some bytes shorter.
                Ok(()) => assert!(room + 20 > length && entries_of(&platter.bytes).is_ok_and(|kept| kept == handed)),
                Err(refusal) => assert_eq!(refusal.number, "E2207"),
            }
            let Ok(kept) = entries_of(&platter.bytes) else {
                assert_eq!(platter.synced, 0, "room for {room} bytes");
                continue;
            };
            assert_eq!(kept[..], handed[..kept.len()], "room for {room} bytes");
            // A power cut may leave anything of what was not synced, as long as the file exists.
            let durable = entries_of(&platter.bytes[..platter.synced]).expect("what is synced is whole");
            for damage in [0_u8, b'x', b'\n'] {
                let mut cut = platter.bytes.clone();
                let unsynced = &mut cut[platter.synced..];
                let half = unsynced.len() / 2;
                unsynced[..half].fill(damage);
                let after = entries_of(&cut).expect("no batch begins behind it");
                assert!(after.starts_with(&durable) && handed.starts_with(&after), "room for {room} bytes");
            }
        }
    }

    #[test]
    fn a_disk_that_fails_for_a_while_loses_nothing_and_is_told_once() {
        let calls = {
            let disk = FakeDiskState::default();
            journal_a_job(&disk).1.expect("it works");
            disk.disk().calls
        };
        for first in 2..calls + 2 {
            for others in [&[][..], &[1], &[1, 2], &[2], &[1, 3]] {
                let disk = FakeDiskState::default();
                disk.disk().failing = others.iter().map(|n| first + n).chain([first]).collect();
                let journal = begin(&disk, Durability::Synced).expect("the first two calls work");
                let mut handed = vec![JournalEntry::Job(Box::new(job("[machine]", JobCard::Sim)))];
                let mut notes = journal.index_writer(None, &[]);
                let durable = journal.durable_place().expect("it is synced");
                for place in 6..13 {
                    notes.write(IndexEntry::Mark(mark(place)));
                    handed.push(JournalEntry::Mark(mark(place)));
                    while journal.wait_until_saved().is_err() {
                        let platter = disk.disk();
                        let safe = entries_of(&platter.bytes[..platter.synced]).expect("whole");
                        assert!(durable.place().number() <= last_place(&safe).unwrap_or(5));
                        drop(platter);
                        thread::sleep(Duration::from_millis(1));
                    }
                }
                assert_eq!(durable.place(), RecordIndex::new(12));
                let news: Vec<_> = std::iter::from_fn(|| journal.event_writer().next_notice()).collect();
                let told = |notice: &JournalNotice| {
                    matches!(notice,
                    JournalNotice::Unwritable(error) if error.number == "E3020")
                };
                let failed = disk.disk().calls > first;
                assert_eq!(news.iter().filter(|h| told(h)).count() > 0, failed);
                assert_eq!(news.len() % 2, 0, "every alarm is followed by the message that all is well: {news:?}");
                drop(journal);
                assert_eq!(entries_of(&disk.disk().bytes), Ok(handed));
            }
        }
    }

    #[test]
    fn a_journal_goes_on_behind_what_was_torn() {
        let disk = FakeDiskState::default();
        journal_a_job(&disk).1.expect("it works");
        let whole = disk.disk().bytes.clone();
        let lines = entries_of(&whole).expect("whole");
        for cut in whole.len() - 200..=whole.len() {
            let disk = FakeDiskState::default();
            disk.disk().bytes = whole[..cut].to_vec();
            let mut entries = JournalEntries::new(&whole[..cut]);
            let kept = entries.by_ref().count();
            let start = Place { record: RecordIndex::new(9), fraction: 7 };
            let resumed = ResumeEntry {
                when: Timestamp::from_ms(9),
                retrace: "0.1.0".into(),
                card: JobCard::Sim,
                place: start,
                reached: RecordIndex::new(11),
                executed: 2,
                counts: vec![1],
            };
            let tail = entries.tail();
            let durable = DurablePlace::starting_at(RecordIndex::new(5));
            let journal = JournalWriter::reopen(disk.clone(), Durability::Synced, tail, durable, resumed.clone(), None)
                .expect("it works");
            journal.index_writer(Some(RecordIndex::new(300)), &[]).write(IndexEntry::Mark(mark(301)));
            drop(journal);
            let mut expected = lines[..kept].to_vec();
            expected.extend([JournalEntry::Resumed(Box::new(resumed)), JournalEntry::Mark(mark(301))]);
            assert_eq!(entries_of(&disk.disk().bytes), Ok(expected), "cut at {cut}");
        }
    }

    #[test]
    fn what_is_noted_again_is_not_written_again() {
        let disk = FakeDiskState::default();
        let journal = begin(&disk, Durability::Synced).expect("it works");
        let known = [PlannedOverride { place: RecordIndex::new(20), planned: Rate::from_units(7) }];
        let mut notes = journal.index_writer(Some(RecordIndex::new(30)), &known);
        notes.write(IndexEntry::Mark(mark(10)));
        notes.write(IndexEntry::Override { place: RecordIndex::new(20), planned: Rate::from_units(7) });
        notes.write(IndexEntry::Mark(mark(30)));
        notes.write(IndexEntry::Mark(mark(31)));
        notes.write(IndexEntry::Override { place: RecordIndex::new(40), planned: Rate::from_units(8) });
        drop((notes, journal));
        let kept = entries_of(&disk.disk().bytes).expect("whole");
        assert_eq!(
            kept[1..],
            [
                JournalEntry::Mark(mark(31)),
                JournalEntry::Override(PlannedOverride { place: RecordIndex::new(40), planned: Rate::from_units(8) })
            ]
        );
    }

    #[test]
    fn where_nothing_outlives_the_process_nothing_is_synced_and_nobody_is_kept_back() {
        let disk = FakeDiskState::default();
        let journal = begin(&disk, Durability::Written).expect("it works");
        assert!(journal.durable_place().is_none());
        let mut notes = journal.index_writer(None, &[]);
        let count = 3 * CAPACITY as u32;
        (0..count).for_each(|place| notes.write(IndexEntry::Mark(mark(place))));
        drop((notes, journal));
        let platter = disk.disk();
        assert_eq!((platter.synced, entries_of(&platter.bytes).expect("whole").len()), (0, count as usize + 1));
    }

    #[test]
    fn a_disk_that_never_works_again_ends_neither_memory_nor_the_job() {
        for care in [Durability::Synced, Durability::Written] {
            let disk = FakeDiskState::default();
            let journal = begin(&disk, care).expect("it works");
            disk.disk().dead = true;
            let mut notes = journal.index_writer(None, &[]);
            notes.write(IndexEntry::Mark(mark(0)));
            while journal.wait_until_saved().is_ok() {}
            for n in 0..2 * CAPACITY as u32 {
                journal.event_writer().write(event(n));
            }
            assert_eq!(journal.queue.state().queue.len(), CAPACITY, "what can be lost is lost");
            assert!(journal.queue.state().lost > 0);
            disk.disk().dead = false;
            while journal.wait_until_saved().is_err() {}
            drop(notes);
            assert_eq!(journal.end(end()), Ok(()));
            let kept = entries_of(&disk.disk().bytes).expect("whole");
            assert!(
                kept.iter().any(|entry| matches!(entry, JournalEntry::Lost(lost) if lost.entries as usize >= CAPACITY))
            );
            assert!(matches!(kept.last(), Some(JournalEntry::End(_))));
        }
    }

    #[test]
    fn the_report_is_kept_to_the_last_digit() {
        let disk = FakeDiskState::default();
        let report: Value = serde_json::from_str(r#"{"mm": 0.30000000000000004}"#).expect("a report");
        let journal = begin(&disk, Durability::Written).expect("it works");
        journal.end(EndEntry { report: report.clone(), ..end() }).expect("it works");
        let kept = entries_of(&disk.disk().bytes).expect("whole");
        assert!(matches!(kept.last(), Some(JournalEntry::End(end)) if end.report == report));
    }
}
