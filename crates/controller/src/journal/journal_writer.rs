//! Writes the journal, in a thread of its own.
//!
//! Invariant: [`Durable`] is never beyond the last mark that a reader would find after a power cut (after the end of the process,
//! where the journal is only written); entries are kept in the order in which they were handed over. A disk that fails
//! loses nothing that was durable: what was not is kept back and written again, until it works or the job ends.

use std::collections::VecDeque;
use std::io;
use std::thread::{self, JoinHandle};

use super::entry::{
    EndEntry, JobHeader, JournalEntry, PlannedOverride, PlannedRest, ResumeEntry, SpooledBytes, ToolLengthChange,
};
use super::journal_line;
pub use super::journal_queue::Durability;
use super::journal_queue::{JournalQueue, QueueState};
use super::journal_reader::JournalTail;
use super::spool::SpoolProgress;
use super::store::JournalStore;
use crate::numbered_error::NumberedError;
use crate::place_index::{DurablePlace, IndexEntry, IndexWriter};
use crate::tool_length::LengthChange;

/// Writes the journal of a job. Dropped without [`Logbook::end`] it writes what it has, and the job counts as interrupted.
#[derive(Debug)]
pub struct JournalWriter {
    desk: JournalQueue,
    writer: Option<JoinHandle<()>>,
}

impl JournalWriter {
    /// Begins a journal: its first entry is kept before this returns. The spool is that of a program that arrives.
    ///
    /// # Errors
    /// `E2207`; nothing may move then.
    pub fn begin(
        store: impl JournalStore + 'static,
        care: Durability,
        job: JobHeader,
        spool: Option<SpoolProgress>,
    ) -> Result<Self, NumberedError> {
        let mut logbook = Self::waiting(care, DurablePlace::from(job.origin));
        logbook.start(store, JournalEntry::Job(Box::new(job)), JournalTail::default(), spool)?;
        Ok(logbook)
    }

    /// A logbook that takes notes and writes none before [`Logbook::take_up`]: for a job that may be taken up again, whose marks reach up to
    /// `durable`. Dropped before, it leaves the journal as it is.
    #[must_use]
    pub fn waiting(care: Durability, durable: DurablePlace) -> Self {
        Self { desk: JournalQueue::new(care, durable), writer: None }
    }

    /// Goes on with a journal that was read up to this tail, and whose marks reach up to `durable`. What was torn is cut off.
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
        let mut logbook = Self::waiting(care, durable);
        logbook.resume(store, tail, resumed, spool)?;
        Ok(logbook)
    }

    /// Goes on with the journal that this logbook waits for, as [`Logbook::go_on`].
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
        store.truncate(tail.whole).map_err(|error| refused(&error.to_string()))?;
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
        let mut writer =
            WriterThread { kept, desk: self.desk.clone(), next: tail.next, spool, spooled: SpooledBytes::default() };
        let batch = writer.batch(vec![first]);
        writer.attempt(&batch).map_err(|error| refused(&error.to_string()))?;
        writer.next = batch.next;
        let writer = thread::Builder::new()
            .name("journal".into())
            .spawn(move || {
                // A job that is resumed begins it from its motion thread.
                let _ = crate::real_time::leave();
                writer.run();
            })
            .map_err(|error| refused(&error.to_string()))?;
        self.writer = Some(writer);
        Ok(())
    }

    /// The end for the planning thread: takes the notes of the index. A job that was resumed hands over `known`, the place of the last
    /// mark in the journal, and the overrides there: what is noted again up to there is in the journal already.
    #[must_use]
    pub fn index_writer(&self, known: Option<u32>, overrides: &[PlannedOverride]) -> JournalIndexWriter {
        JournalIndexWriter { desk: self.desk.clone(), known, overrides: overrides.iter().copied().collect() }
    }

    /// How far the index is durable, for the motion path; `None` where it is to be kept back by nothing.
    #[must_use]
    pub fn durable(&self) -> Option<DurablePlace> {
        (self.desk.care() == Durability::Synced).then(|| self.desk.durable().clone())
    }

    /// The desk, for the reporter's keeper.
    pub(super) fn desk(&self) -> JournalQueue {
        self.desk.clone()
    }

    /// Waits until everything that was handed over is kept.
    ///
    /// # Errors
    /// `E2207`: it is not, the disk fails.
    pub fn settle(&self) -> Result<(), NumberedError> {
        let waits = |state: &mut QueueState| {
            (!state.queue.is_empty() || state.in_hand > 0) && state.trouble.is_none() && !state.over
        };
        let state = self.desk.wait_while(waits);
        state.trouble.as_ref().map_or(Ok(()), |why| Err(refused(why)))
    }

    /// Writes how the job ended, and all that still waits.
    ///
    /// # Errors
    /// `E2207`: that is not kept, and the job counts as interrupted.
    pub fn end(mut self, end: EndEntry) -> Result<(), NumberedError> {
        self.desk.state().queue.push_back(JournalEntry::End(Box::new(end)));
        self.close();
        let state = self.desk.state();
        state.trouble.as_ref().map_or(Ok(()), |why| Err(refused(why)))
    }

    fn close(&mut self) {
        self.desk.state().closed = true;
        self.desk.changed();
        if let Some(writer) = self.writer.take() {
            // A panic over there is a defect, never an input; it is passed on, unless one is under way already.
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

fn refused(why: &str) -> NumberedError {
    NumberedError::new(
        "E2207",
        format!("the journal cannot be written: {why}"),
        "make room on its disk, or name a folder elsewhere with --journal",
    )
}

/// The planning thread's end of the logbook.
#[derive(Debug)]
pub struct JournalIndexWriter {
    desk: JournalQueue,
    /// Place of the last mark that the journal has already.
    known: Option<u32>,
    overrides: VecDeque<PlannedOverride>,
}

impl IndexWriter for JournalIndexWriter {
    fn note(&mut self, note: IndexEntry) {
        match note {
            IndexEntry::Mark(mark) => {
                if self.known.is_none_or(|known| retrace_core::place::is_before(known, mark.place)) {
                    self.desk.note(JournalEntry::Mark(mark));
                }
            }
            IndexEntry::Length(LengthChange { block, pulses }) => {
                self.desk.note(JournalEntry::ToolLength(ToolLengthChange { block, pulses }))
            }
            IndexEntry::Rest { block } => self.desk.note(JournalEntry::Rest(PlannedRest { block })),
            IndexEntry::Override { place, planned } => {
                let noted = PlannedOverride { place, planned };
                if self.overrides.front() == Some(&noted) {
                    self.overrides.pop_front();
                    return;
                }
                // From here on the plan is another one, and so are its marks.
                (self.known, self.overrides) = (None, VecDeque::new());
                self.desk.note(JournalEntry::Override(noted));
            }
        }
    }

    fn is_durable(&mut self) -> bool {
        let state = self.desk.state();
        self.desk.care() == Durability::Written
            || state.queue.is_empty() && state.in_hand == 0 && state.trouble.is_none()
    }
}

/// Entries as lines.
struct EntryBatch {
    bytes: Vec<u8>,
    /// Number of the line behind them.
    next: u64,
    /// Place of the last mark.
    place: Option<u32>,
}

struct WriterThread<S> {
    kept: JournalFile<S>,
    desk: JournalQueue,
    next: u64,
    spool: Option<SpoolProgress>,
    /// What the journal says of the spool.
    spooled: SpooledBytes,
}

impl<S: JournalStore> WriterThread<S> {
    fn run(mut self) {
        while let Some(entries) = self.desk.take() {
            let batch = self.batch(entries);
            loop {
                match self.attempt(&batch) {
                    Ok(()) => break,
                    Err(error) if self.desk.failed(error.to_string()) => {}
                    Err(_) => return self.over(),
                }
            }
            self.next = batch.next;
            self.desk.kept(batch.place);
        }
        self.over();
    }

    fn over(&self) {
        self.desk.state().over = true;
        self.desk.changed();
    }

    /// Puts entries into lines; what the spool has come to stands before them, as they may depend on it.
    fn batch(&mut self, entries: Vec<JournalEntry>) -> EntryBatch {
        let mut batch = EntryBatch { bytes: Vec::new(), next: self.next, place: None };
        let spooled = self.spool.as_ref().map(SpoolProgress::spooled).filter(|now| *now != self.spooled);
        if let Some(now) = spooled {
            self.spooled = now;
        }
        // The first line of all is the job's.
        let (before, behind) = if self.next == 0 { (None, spooled) } else { (spooled, None) };
        let spooled = |spooled: Option<SpooledBytes>| spooled.map(JournalEntry::Spooled);
        for entry in spooled(before).into_iter().chain(entries).chain(spooled(behind)) {
            if let JournalEntry::Mark(mark) = &entry {
                batch.place = Some(mark.place);
            }
            // An entry is made of numbers and strings, and its maps have strings for keys: it can always be written.
            let json = serde_json::to_vec(&entry).unwrap_or_default();
            journal_line::append(&mut batch.bytes, batch.next, batch.next == self.next, &json);
            batch.next += 1;
        }
        batch
    }

    /// Tries to keep the batch.
    fn attempt(&mut self, batch: &EntryBatch) -> io::Result<()> {
        let care = self.desk.care();
        if let (Durability::Synced, Some(spool)) = (care, &mut self.spool) {
            spool.sync(self.spooled)?;
        }
        self.kept.append(&batch.bytes, care)
    }
}

/// A store, and how much of it is as it should be.
struct JournalFile<S> {
    store: S,
    length: u64,
    /// Something else may be behind that.
    dirty: bool,
}

impl<S: JournalStore> JournalFile<S> {
    /// Appends the bytes, or leaves the store to be cut off the next time. After a sync that failed they are written anew: the system
    /// may have forgotten that they never arrived.
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
    use super::super::entry::tests::job;
    use super::super::entry::{JobCard, JobEnding};
    use super::super::journal_queue::WAITING;
    use super::super::journal_reader::JournalEntries;
    use super::super::timestamp::Timestamp;
    use super::*;
    use crate::event::{CardError, EventKind};
    use crate::place_index::PlaceMark;
    use retrace_core::Place;
    use serde_json::{Value, json};
    use std::sync::{Arc, Mutex, MutexGuard};
    use std::time::Duration;

    /// A disk of a test: what was written, and how much of it survives a power cut.
    #[derive(Clone, Debug, Default)]
    struct FakeDiskState(Arc<Mutex<FakeDisk>>);

    #[derive(Debug, Default)]
    struct FakeDisk {
        bytes: Vec<u8>,
        synced: usize,
        /// So many bytes can be written before it fails for good.
        room: Option<usize>,
        /// Calls so far, and those that fail.
        calls: usize,
        failing: Vec<usize>,
        /// Nothing else works.
        dead: bool,
    }

    impl FakeDiskState {
        fn platter(&self) -> MutexGuard<'_, FakeDisk> {
            self.0.lock().expect("no panic")
        }

        fn call(&self) -> io::Result<MutexGuard<'_, FakeDisk>> {
            let mut platter = self.platter();
            platter.calls += 1;
            let fails = platter.dead || platter.failing.contains(&(platter.calls - 1));
            if fails { Err(io::Error::other("out of order")) } else { Ok(platter) }
        }
    }

    impl JournalStore for FakeDiskState {
        fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
            let fails = self.call().is_err();
            let mut platter = self.platter();
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
                // As Linux does it: what could not be written is forgotten, and the next sync says that all is well.
                let mut platter = self.platter();
                let from = platter.synced;
                platter.bytes[from..].fill(0);
                return Err(error);
            }
            let mut platter = self.platter();
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
            place,
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

    /// What a reader finds, or the flaw.
    fn found(bytes: &[u8]) -> Result<Vec<JournalEntry>, String> {
        JournalEntries::new(bytes).map(|entry| entry.map(|(_, entry)| entry).map_err(|flaw| flaw.to_string())).collect()
    }

    fn last_place(entries: &[JournalEntry]) -> Option<u32> {
        let place = |entry: &JournalEntry| if let JournalEntry::Mark(mark) = entry { Some(mark.place) } else { None };
        entries.iter().rev().find_map(place)
    }

    /// Hands over a synthetic job, settled now and then, and looks after each time that what counts as durable is there.
    fn keep_a_job(disk: &FakeDiskState) -> (Vec<JournalEntry>, Result<(), NumberedError>) {
        let mut handed = vec![JournalEntry::Job(Box::new(job("[machine]", JobCard::Sim)))];
        let logbook = match begin(disk, Durability::Synced) {
            Ok(logbook) => logbook,
            Err(refusal) => return (handed, Err(refusal)),
        };
        let durable = logbook.durable().expect("it is synced");
        let mut notes = logbook.index_writer(None, &[]);
        for n in 0..6_u32 {
            for place in [100 * n + 40, 100 * n + 90] {
                notes.note(IndexEntry::Mark(mark(place)));
                handed.push(JournalEntry::Mark(mark(place)));
            }
            if n == 3 {
                notes.note(IndexEntry::Override { place: 390, planned: 3 << 32 });
                handed.push(JournalEntry::Override(PlannedOverride { place: 390, planned: 3 << 32 }));
            }
            logbook.desk().tell(event(n));
            handed.push(event(n));
            if n % 2 == 1 {
                let _ = logbook.settle();
            }
            let (place, platter) = (durable.place(), disk.platter());
            let after_a_power_cut = found(&platter.bytes[..platter.synced]).expect("what is synced is whole");
            assert!(place <= last_place(&after_a_power_cut).unwrap_or(5), "{place} is not durable");
        }
        handed.push(JournalEntry::End(Box::new(end())));
        (handed, logbook.end(end()))
    }

    #[test]
    fn what_is_handed_over_is_kept_in_its_order() {
        let disk = FakeDiskState::default();
        let (handed, ended) = keep_a_job(&disk);
        assert_eq!(ended, Ok(()));
        let platter = disk.platter();
        assert_eq!(platter.synced, platter.bytes.len());
        assert_eq!(found(&platter.bytes), Ok(handed));
    }

    #[test]
    fn what_was_synced_before_the_last_batch_is_never_taken_for_torn() {
        let disk = FakeDiskState::default();
        let logbook = begin(&disk, Durability::Synced).expect("it works");
        let mut notes = logbook.index_writer(None, &[]);
        let mut lengths = Vec::new();
        for place in 6..9 {
            lengths.push(disk.platter().bytes.len());
            notes.note(IndexEntry::Mark(mark(place)));
            logbook.settle().expect("it works");
        }
        drop((notes, logbook));
        let bytes = disk.platter().bytes.clone();
        for at in lengths[0]..bytes.len() {
            let mut changed = bytes.clone();
            changed[at] ^= 4;
            assert_eq!(found(&changed).is_err(), at < lengths[2], "byte {at}");
        }
    }

    #[test]
    fn stopped_at_any_byte_it_is_a_beginning_of_what_was_handed_over() {
        let whole = FakeDiskState::default();
        keep_a_job(&whole).1.expect("it works");
        let length = whole.platter().bytes.len();
        for room in 0..length {
            let disk = FakeDiskState::default();
            disk.platter().room = Some(room);
            let (handed, ended) = keep_a_job(&disk);
            let platter = disk.platter();
            match ended {
                // In fewer batches it is some bytes shorter.
                Ok(()) => assert!(room + 20 > length && found(&platter.bytes).is_ok_and(|kept| kept == handed)),
                Err(refusal) => assert_eq!(refusal.number, "E2207"),
            }
            let Ok(kept) = found(&platter.bytes) else {
                assert_eq!(platter.synced, 0, "room for {room} bytes");
                continue;
            };
            assert_eq!(kept[..], handed[..kept.len()], "room for {room} bytes");
            // A power cut may leave anything of what was not synced, as long as the file is.
            let durable = found(&platter.bytes[..platter.synced]).expect("what is synced is whole");
            for damage in [0_u8, b'x', b'\n'] {
                let mut cut = platter.bytes.clone();
                let unsynced = &mut cut[platter.synced..];
                let half = unsynced.len() / 2;
                unsynced[..half].fill(damage);
                let after = found(&cut).expect("no batch begins behind it");
                assert!(after.starts_with(&durable) && handed.starts_with(&after), "room for {room} bytes");
            }
        }
    }

    #[test]
    fn a_disk_that_fails_for_a_while_loses_nothing_and_is_told_once() {
        let calls = {
            let disk = FakeDiskState::default();
            keep_a_job(&disk).1.expect("it works");
            disk.platter().calls
        };
        for first in 2..calls + 2 {
            for others in [&[][..], &[1], &[1, 2], &[2], &[1, 3]] {
                let disk = FakeDiskState::default();
                disk.platter().failing = others.iter().map(|n| first + n).chain([first]).collect();
                let logbook = begin(&disk, Durability::Synced).expect("the first two calls work");
                let mut handed = vec![JournalEntry::Job(Box::new(job("[machine]", JobCard::Sim)))];
                let mut notes = logbook.index_writer(None, &[]);
                let durable = logbook.durable().expect("it is synced");
                for place in 6..13 {
                    notes.note(IndexEntry::Mark(mark(place)));
                    handed.push(JournalEntry::Mark(mark(place)));
                    while logbook.settle().is_err() {
                        let platter = disk.platter();
                        let safe = found(&platter.bytes[..platter.synced]).expect("whole");
                        assert!(durable.place() <= last_place(&safe).unwrap_or(5));
                        drop(platter);
                        thread::sleep(Duration::from_millis(1));
                    }
                }
                assert_eq!(durable.place(), 12);
                let news: Vec<_> = std::iter::from_fn(|| logbook.desk().news()).collect();
                let told =
                    |number: &EventKind| matches!(number, EventKind::Alarm(CardError::Fault { number: "E3020", .. }));
                let failed = disk.platter().calls > first;
                assert_eq!(news.iter().filter(|h| told(h)).count() > 0, failed);
                assert_eq!(news.len() % 2, 0, "every alarm is followed by the message that all is well: {news:?}");
                drop(logbook);
                assert_eq!(found(&disk.platter().bytes), Ok(handed));
            }
        }
    }

    #[test]
    fn a_journal_goes_on_behind_what_was_torn() {
        let disk = FakeDiskState::default();
        keep_a_job(&disk).1.expect("it works");
        let whole = disk.platter().bytes.clone();
        let lines = found(&whole).expect("whole");
        for cut in whole.len() - 200..=whole.len() {
            let disk = FakeDiskState::default();
            disk.platter().bytes = whole[..cut].to_vec();
            let mut entries = JournalEntries::new(&whole[..cut]);
            let kept = entries.by_ref().count();
            let start = Place { record: 9, fraction: 7 };
            let resumed = ResumeEntry {
                when: Timestamp::from_ms(9),
                retrace: "0.1.0".into(),
                card: JobCard::Sim,
                place: start,
                reached: 11,
                executed: 2,
                counts: vec![1],
            };
            let tail = entries.tail();
            let durable = DurablePlace::from(5);
            let logbook = JournalWriter::reopen(disk.clone(), Durability::Synced, tail, durable, resumed.clone(), None)
                .expect("it works");
            logbook.index_writer(Some(300), &[]).note(IndexEntry::Mark(mark(301)));
            drop(logbook);
            let mut expected = lines[..kept].to_vec();
            expected.extend([JournalEntry::Resumed(Box::new(resumed)), JournalEntry::Mark(mark(301))]);
            assert_eq!(found(&disk.platter().bytes), Ok(expected), "cut at {cut}");
        }
    }

    #[test]
    fn what_is_noted_again_is_not_written_again() {
        let disk = FakeDiskState::default();
        let logbook = begin(&disk, Durability::Synced).expect("it works");
        let known = [PlannedOverride { place: 20, planned: 7 }];
        let mut notes = logbook.index_writer(Some(30), &known);
        notes.note(IndexEntry::Mark(mark(10)));
        notes.note(IndexEntry::Override { place: 20, planned: 7 });
        notes.note(IndexEntry::Mark(mark(30)));
        notes.note(IndexEntry::Mark(mark(31)));
        notes.note(IndexEntry::Override { place: 40, planned: 8 });
        drop((notes, logbook));
        let kept = found(&disk.platter().bytes).expect("whole");
        assert_eq!(
            kept[1..],
            [JournalEntry::Mark(mark(31)), JournalEntry::Override(PlannedOverride { place: 40, planned: 8 })]
        );
    }

    #[test]
    fn where_nothing_outlives_the_process_nothing_is_synced_and_nobody_is_kept_back() {
        let disk = FakeDiskState::default();
        let logbook = begin(&disk, Durability::Written).expect("it works");
        assert!(logbook.durable().is_none());
        let mut notes = logbook.index_writer(None, &[]);
        let count = 3 * WAITING as u32;
        (0..count).for_each(|place| notes.note(IndexEntry::Mark(mark(place))));
        drop((notes, logbook));
        let platter = disk.platter();
        assert_eq!((platter.synced, found(&platter.bytes).expect("whole").len()), (0, count as usize + 1));
    }

    #[test]
    fn a_disk_that_never_works_again_ends_neither_memory_nor_the_job() {
        for care in [Durability::Synced, Durability::Written] {
            let disk = FakeDiskState::default();
            let logbook = begin(&disk, care).expect("it works");
            disk.platter().dead = true;
            let mut notes = logbook.index_writer(None, &[]);
            notes.note(IndexEntry::Mark(mark(0)));
            while logbook.settle().is_ok() {}
            for n in 0..2 * WAITING as u32 {
                logbook.desk().tell(event(n));
            }
            assert_eq!(logbook.desk.state().queue.len(), WAITING, "what can be lost is lost");
            assert!(logbook.desk.state().lost > 0);
            disk.platter().dead = false;
            while logbook.settle().is_err() {}
            drop(notes);
            assert_eq!(logbook.end(end()), Ok(()));
            let kept = found(&disk.platter().bytes).expect("whole");
            assert!(
                kept.iter().any(|entry| matches!(entry, JournalEntry::Lost(lost) if lost.entries as usize >= WAITING))
            );
            assert!(matches!(kept.last(), Some(JournalEntry::End(_))));
        }
    }

    #[test]
    fn the_report_is_kept_to_the_last_digit() {
        let disk = FakeDiskState::default();
        let report: Value = serde_json::from_str(r#"{"mm": 0.30000000000000004}"#).expect("a report");
        let logbook = begin(&disk, Durability::Written).expect("it works");
        logbook.end(EndEntry { report: report.clone(), ..end() }).expect("it works");
        let kept = found(&disk.platter().bytes).expect("whole");
        assert!(matches!(kept.last(), Some(JournalEntry::End(end)) if end.report == report));
    }
}
