//! The content of a journal: everything that is needed to resume the job.
//!
//! Invariant: memory does not grow with the length of the job: marks are read again from the file as a stream.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use retrace_config::NumberedError;
use retrace_core::mode::Mode;
use retrace_core::{Place, RecordIndex};
use retrace_link::PathStart;
use serde_json::Value;

use crate::durable_place::DurablePlace;
use crate::entry::{EndEntry, JobHeader, JournalEntry, PlannedOverride, PositionEntry, ResumeEntry, SpooledBytes};
use crate::journal_line;
use crate::journal_reader::{JournalEntries, JournalError, JournalTail};
use crate::place_index::PlaceMark;
use crate::place_index::{LengthChange, ProgramAnswer, TapBegin};
use crate::record_ranges::RecordRanges;

/// Bytes at the end of a long journal in which its last entries are searched.
const SUMMARY_TAIL_BYTES: u64 = 64 << 10;

/// A journal that was read.
#[derive(Clone, Debug, PartialEq)]
pub struct JobRecord {
    /// Header of the job.
    pub job: JobHeader,
    /// The resumptions of the job, in order.
    pub resumed: Vec<ResumeEntry>,
    /// Position of the machine, as far as the journal records it.
    pub last_position: LastPosition,
    /// Last recorded position, with outputs and mode.
    pub at: Option<PositionEntry>,
    /// Length of a streamed program that was saved.
    pub spooled: SpooledBytes,
    /// End of the job. None where it was interrupted, or resumed since.
    pub end: Option<EndEntry>,
    /// Last alarm since the job was resumed last.
    pub alarm: Option<Value>,
    /// State of optional stop at the end of the journal. None where the operator never set it.
    pub optional_stop: Option<bool>,
    /// Numbers of the contours that the operator skips.
    pub skipped_contours: BTreeSet<u32>,
    /// Number of entries that were lost while the disk did not keep up.
    pub lost: u64,
    /// Number of valid marks.
    pub marks: u64,
    /// The last valid mark.
    pub last_mark: Option<PlaceMark>,
    /// End of the journal file.
    pub tail: JournalTail,
    path: PathBuf,
    /// Planned overrides, each with its line number.
    overrides: Vec<(u64, PlannedOverride)>,
    /// Blocks behind which the path rests because the program was cut off or rejected.
    rests: Vec<u64>,
    lengths: Vec<LengthChange>,
    answers: Vec<ProgramAnswer>,
    /// The last rigid tap, unless it is complete.
    tap: Option<TapBegin>,
    /// Where the last rigid tap that was due begins on the card's path of manual moves, and its place.
    tap_on_card: Option<[u32; 2]>,
    /// The interrupted cut that was not continued.
    interrupted_cut: Option<InterruptedCut>,
    /// What was cut.
    cut: RecordRanges,
    /// The start of a cutter whose completion is not recorded.
    begun_start: Option<BegunStart>,
}

/// An instruction that lights a cutter, from its begin until its completion is recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct BegunStart {
    record: RecordIndex,
    /// Channel that fires the cutter, once it is lit.
    channel: Option<u8>,
    /// Whether it is complete, which the next position has as well.
    is_complete: bool,
}

impl BegunStart {
    /// The start that is begun after this event, if there was this one before.
    fn after(before: Option<Self>, event: &Value) -> Option<Self> {
        let record = || event["record"].as_u64().and_then(|number| u32::try_from(number).ok()).map(RecordIndex::new);
        let is_lit = || ["igniting", "piercing", "cutting"].iter().any(|state| event["state"] == **state);
        match event["event"].as_str() {
            Some("switching") => Some(Self { record: record()?, channel: None, is_complete: false }),
            Some("switched") => before.map(|start| Self { is_complete: true, ..start }),
            Some("cutter_state") if is_lit() => {
                let channel = event["channel"].as_u64().and_then(|number| u8::try_from(number).ok());
                let is_here = |start: &Self| record() == Some(start.record) && start.channel.is_none();
                before.map(|start| if is_here(&start) { Self { channel, ..start } } else { start })
            }
            // tried in vain: nothing is pierced, or the kerf is longer
            Some("cutter_off") if event["reason"] == "not_started" => None,
            Some("restart_switched" | "cut_continued") => None,
            _ => before,
        }
    }
}

/// A cut that was interrupted and not continued.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InterruptedCut {
    /// Channel that fires the cutter.
    pub channel: u8,
    /// Where it ends.
    pub place: Place,
    /// Record up to which its kerf may reach, where a resumed job has passed there and struck no arc.
    pub latest: RecordIndex,
    /// Whether the interruption was seen as it happened, and the job not resumed since.
    pub is_exact: bool,
}

/// The cut whose end an event reports.
fn interrupted_cut(event: &Value) -> Option<InterruptedCut> {
    let number = |key: &str| event[key].as_u64();
    let is_cut_end = event["event"] == "cut_end";
    let record = RecordIndex::new(u32::try_from(number("cut_record").filter(|_| is_cut_end)?).ok()?);
    let fraction = u32::try_from(number("cut_fraction")?).ok()?;
    let channel = u8::try_from(number("channel")?).ok()?;
    let is_exact = event["may_be_longer"] != true;
    let latest = number("latest_record").and_then(|number| u32::try_from(number).ok());
    let latest = latest.map_or(record, RecordIndex::new);
    Some(InterruptedCut { channel, place: Place { record, fraction }, latest, is_exact })
}

/// Last known position of a machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LastPosition {
    /// Position on the path.
    pub start: PathStart,
    /// Counts of its axes, in pulses.
    pub counts: Vec<i64>,
}

impl JobRecord {
    /// Reads a journal to its end.
    ///
    /// # Errors
    /// `E2104`, `E2203`, `E2204`, `E2205`: it cannot be read, is damaged, has no beginning, is of a newer version.
    pub fn read(path: &Path) -> Result<Self, NumberedError> {
        Self::read_entries(path).map_err(|flaw| flaw.numbered_error(path))
    }

    fn read_entries(path: &Path) -> Result<Self, JournalError> {
        let mut entries = open(path)?;
        let Some((_, JournalEntry::Job(job))) = entries.next().transpose()? else {
            return Err(JournalError::NoBeginning);
        };
        let mut record = Self::new(*job, path);
        for entry in &mut entries {
            let (number, entry) = entry?;
            record.apply(number, entry);
        }
        record.tail = entries.tail();
        record.count_marks()?;
        Ok(record)
    }

    fn new(job: JobHeader, path: &Path) -> Self {
        let last_position = LastPosition { start: PathStart::at(job.origin), counts: job.counts.clone() };
        Self {
            job,
            resumed: Vec::new(),
            last_position,
            at: None,
            spooled: SpooledBytes::default(),
            end: None,
            alarm: None,
            optional_stop: None,
            skipped_contours: BTreeSet::new(),
            lost: 0,
            marks: 0,
            last_mark: None,
            tail: JournalTail::default(),
            path: path.to_owned(),
            overrides: Vec::new(),
            rests: Vec::new(),
            lengths: Vec::new(),
            answers: Vec::new(),
            tap: None,
            tap_on_card: None,
            interrupted_cut: None,
            cut: RecordRanges::default(),
            begun_start: None,
        }
    }

    fn apply(&mut self, number: u64, entry: JournalEntry) {
        match entry {
            // Marks are counted after the overrides, which may invalidate some.
            JournalEntry::Job(_) => {}
            JournalEntry::Mark(mark) => {
                self.marks += 1;
                self.last_mark = Some(mark);
            }
            JournalEntry::Override(new) => {
                // Overrides beyond this place belong to a plan that was discarded.
                self.overrides.retain(|(_, old)| old.place.is_before(new.place));
                self.cut.truncate(new.place);
                self.overrides.push((number, new));
            }
            JournalEntry::ToolLength(change) => self.lengths.push(change),
            JournalEntry::Tap(begin) => self.tap = Some(begin),
            JournalEntry::Answer(answer) => {
                self.tap = self.tap.filter(|_| !matches!(*answer, ProgramAnswer::Tap(_)));
                self.answers.push(*answer);
            }
            JournalEntry::Rest(rest) => {
                if self.rests.last() != Some(&rest.block) {
                    self.rests.push(rest.block);
                }
            }
            JournalEntry::Position(at) => {
                self.last_position = LastPosition { start: at.start(), counts: at.counts.clone() };
                at.cut.iter().for_each(|&[begin, end]| self.cut.insert(begin, end));
                self.begun_start = self.begun_start.filter(|start| !start.is_complete && at.reached == start.record);
                self.at = Some(*at);
            }
            JournalEntry::Event(event) => {
                self.begun_start = BegunStart::after(self.begun_start, &event);
                if event["event"] == "alarm" {
                    self.alarm = Some(event);
                } else if let Some(cut) = interrupted_cut(&event) {
                    self.interrupted_cut = Some(cut);
                } else if event["event"] == "cut_continued" {
                    self.interrupted_cut = None;
                } else if let Some(tap) = tap_on_card(&event) {
                    self.tap_on_card = Some(tap);
                } else if event["event"] == "tap_not_begun" {
                    self.tap = None;
                } else if let Some((number, is_skipped)) = skipped_contour(&event) {
                    if is_skipped {
                        self.skipped_contours.insert(number);
                    } else {
                        self.skipped_contours.remove(&number);
                    }
                } else if let Some(is_on) = optional_stop(&event) {
                    self.optional_stop = Some(is_on);
                }
            }
            JournalEntry::Spooled(spooled) => self.spooled = spooled,
            JournalEntry::Resumed(resumed) => {
                let start = PathStart {
                    place: resumed.place,
                    rests: false,
                    reached: resumed.reached,
                    executed: resumed.executed,
                    keeps_state: true,
                };
                self.last_position = LastPosition { start, counts: resumed.counts.clone() };
                (self.end, self.alarm) = (None, None);
                self.resumed.push(*resumed);
            }
            JournalEntry::Lost(lost) => self.lost += lost.entries,
            JournalEntry::End(end) => self.end = Some(*end),
        }
    }

    /// A place up to which the cutter on this channel has certainly cut, where the program expects it to be on at the
    /// end of the journal: where its cut was interrupted, or the last position at which it is recorded to be on. A cut
    /// that goes on after the last entry is up to one second longer (CUT-46).
    #[must_use]
    pub fn certain_cut_end(&self, channel: u8) -> Option<Place> {
        let interrupted = self.interrupted_cut.filter(|cut| cut.channel == channel).map(|cut| cut.place);
        let at = self.at.as_ref();
        if interrupted.is_none() && self.begun_start() == Some(channel) {
            return Some(Place::start_of(self.last_position.start.reached));
        }
        interrupted.or_else(|| at.filter(|at| at.is_cutting_with(channel)).map(|at| at.place)).or_else(|| {
            // Outside of normal run, and in a hold, it ended where normal run came to rest.
            let at = at.filter(|at| at.mode != Mode::Run || at.at_rest)?;
            (at.reached != self.job.origin).then(|| Place::start_of(at.reached - 1))
        })
    }

    /// Channel of the cutter whose own instruction was begun at the furthest place and lit it, if the journal ends
    /// before its completion: whether the sheet is pierced, or a kerf begins there, is not known.
    #[must_use]
    pub fn begun_start(&self) -> Option<u8> {
        self.begun_start.filter(|start| start.record == self.last_position.start.reached)?.channel
    }

    /// What was cut of the path. A cut that goes on after the last position is up to one second longer.
    #[must_use]
    pub fn cut_ranges(&self) -> &RecordRanges {
        &self.cut
    }

    /// The cut that was interrupted and not continued, if there is one.
    #[must_use]
    pub fn interrupted_cut(&self) -> Option<InterruptedCut> {
        self.interrupted_cut
    }

    /// Counts the valid marks. An override invalidates marks that were made before it for places beyond it; without
    /// overrides, every mark is valid.
    fn count_marks(&mut self) -> Result<(), JournalError> {
        if self.overrides.is_empty() {
            return Ok(());
        }
        (self.marks, self.last_mark) = (0, None);
        for mark in self.marks_of(open(&self.path)?) {
            self.last_mark = Some(mark?);
            self.marks += 1;
        }
        Ok(())
    }

    /// The planned overrides and their places, in the order of the places.
    #[must_use]
    pub fn overrides(&self) -> Vec<PlannedOverride> {
        self.overrides.iter().map(|(_, planned)| *planned).collect()
    }

    /// Blocks behind which the path was planned to rest because the program was cut off or rejected there, in the order
    /// of the runs.
    #[must_use]
    pub fn rests(&self) -> &[u64] {
        &self.rests
    }

    /// Tool lengths that were entered in pauses, in order.
    #[must_use]
    pub fn lengths(&self) -> &[LengthChange] {
        &self.lengths
    }

    /// Answers of the machine to the program, in order.
    #[must_use]
    pub fn answers(&self) -> &[ProgramAnswer] {
        &self.answers
    }

    /// The last rigid tap, unless it is complete.
    #[must_use]
    pub const fn tap(&self) -> Option<TapBegin> {
        self.tap
    }

    /// Where that tap begins on the card's path of manual moves, if it was due.
    #[must_use]
    pub fn tap_on_card(&self) -> Option<u32> {
        let [on_card, place] = self.tap_on_card?;
        self.tap.filter(|tap| tap.place == place).map(|_| on_card)
    }

    /// Reads the valid marks again, in the order of their places.
    ///
    /// # Errors
    /// As [`JobRecord::read`]; no new errors are expected the second time.
    pub fn marks(&self) -> Result<impl Iterator<Item = Result<PlaceMark, NumberedError>> + use<>, NumberedError> {
        let path = self.path.clone();
        let entries = open(&path).map_err(|flaw| flaw.numbered_error(&path))?;
        Ok(self.marks_of(entries).map(move |mark| mark.map_err(|flaw| flaw.numbered_error(&path))))
    }

    fn marks_of<R: BufRead>(
        &self,
        entries: JournalEntries<R>,
    ) -> impl Iterator<Item = Result<PlaceMark, JournalError>> + use<R> {
        let overrides = self.overrides.clone();
        entries.filter_map(move |entry| match entry {
            Err(flaw) => Some(Err(flaw)),
            Ok((number, JournalEntry::Mark(mark))) => {
                // Of the overrides behind the mark, the first one has the first place.
                let next = overrides.get(overrides.partition_point(|(line, _)| *line < number));
                let is_undone = next.is_some_and(|(_, planned)| planned.place.is_before(mark.place));
                (!is_undone).then_some(Ok(mark))
            }
            Ok(_) => None,
        })
    }

    /// Durable place of the index, with which a journal writer of the resumed job begins.
    #[must_use]
    pub fn durable_place(&self) -> DurablePlace {
        DurablePlace::starting_at(self.last_mark.map_or(self.job.origin, |mark| mark.place))
    }
}

/// State of optional stop after this event. None where the event does not set it.
fn optional_stop(event: &Value) -> Option<bool> {
    match event["command"].as_str()? {
        "optional stop on" => Some(true),
        "optional stop off" => Some(false),
        _ => None,
    }
}

/// Where a rigid tap that is due begins on the card's path of manual moves, and its place.
fn tap_on_card(event: &Value) -> Option<[u32; 2]> {
    (event["event"] == "tapping").then_some(())?;
    let number = |name: &str| event[name].as_u64().and_then(|number| u32::try_from(number).ok());
    Some([number("card_place")?, number("record")?])
}

/// Number of the contour that this event skips, or does not skip any more.
fn skipped_contour(event: &Value) -> Option<(u32, bool)> {
    (event["event"] == "contour_skip").then_some(())?;
    Some((u32::try_from(event["number"].as_u64()?).ok()?, event["skipped"].as_bool()?))
}

fn open(path: &Path) -> Result<JournalEntries<BufReader<File>>, JournalError> {
    let file = File::open(path)?;
    Ok(JournalEntries::new(BufReader::with_capacity(1 << 16, file)))
}

/// The first and last entries of a journal, for a list of jobs. The middle of a long journal is neither read nor
/// checked.
#[derive(Clone, Debug, PartialEq)]
pub struct JobSummary {
    /// Header of the job.
    pub job: JobHeader,
    /// Last recorded position.
    pub at: Option<PositionEntry>,
    /// End of the job. None where it was interrupted, or resumed since.
    pub end: Option<EndEntry>,
}

impl JobSummary {
    /// Reads a summary of a journal.
    ///
    /// # Errors
    /// As [`JobRecord::read`], for the parts that are read.
    pub fn read(path: &Path) -> Result<Self, NumberedError> {
        Self::read_summary(path).map_err(|flaw| flaw.numbered_error(path))
    }

    fn read_summary(path: &Path) -> Result<Self, JournalError> {
        let length = std::fs::metadata(path)?.len();
        if length > 4 * SUMMARY_TAIL_BYTES {
            let mut entries = open(path)?;
            let Some((_, JournalEntry::Job(job))) = entries.next().transpose()? else {
                return Err(JournalError::NoBeginning);
            };
            let mut record = JobRecord::new(*job, path);
            for entry in last_entries(path, length)? {
                record.apply(0, entry);
            }
            if record.at.is_some() {
                return Ok(record.into());
            }
        }
        JobRecord::read_entries(path).map(Self::from)
    }
}

impl From<JobRecord> for JobSummary {
    fn from(record: JobRecord) -> Self {
        Self { job: record.job, at: record.at, end: record.end }
    }
}

/// Positions, resumptions and ends of the job among the last bytes.
fn last_entries(path: &Path, length: u64) -> Result<Vec<JournalEntry>, JournalError> {
    let mut file = File::open(path)?;
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(length.saturating_sub(SUMMARY_TAIL_BYTES)))?;
    // The file may be growing.
    file.take(2 * SUMMARY_TAIL_BYTES).read_to_end(&mut bytes)?;
    let words = [&b"{\"at\":"[..], b"{\"end\":", b"{\"resumed\":"];
    let lines = bytes.split_inclusive(|&byte| byte == b'\n').filter_map(journal_line::parse);
    let selected = lines.filter(|line| words.iter().any(|word| line.json.starts_with(word)));
    Ok(selected.filter_map(|line| serde_json::from_slice(line.json).ok()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::entry::tests::job;
    use crate::entry::{JobCard, JobEnding, LostEntries};
    use crate::journal_queue::Durability;
    use crate::journal_store::FileStore;
    use crate::journal_writer::JournalWriter;
    use crate::place_index::{IndexEntry, IndexWriter};
    use crate::spool::SpoolWriter;
    use crate::timestamp::Timestamp;
    use retrace_core::Rate;
    use serde_json::json;

    fn mark(place: u32) -> PlaceMark {
        PlaceMark { place: RecordIndex::new(place), line: place, ..PlaceMark::default() }
    }

    fn at(record: u32) -> JournalEntry {
        JournalEntry::Position(Box::new(PositionEntry {
            when: Timestamp::from_ms(1),
            period: 9,
            place: Place { record: RecordIndex::new(record), fraction: 3 },
            reached: RecordIndex::new(record + 1),
            executed: 2,
            at_rest: true,
            counts: vec![i64::from(record), 2, 3],
            layer: 0,
            outputs: vec![(3, 1)],
            line: record,
            mode: retrace_core::mode::Mode::Run,
            hold_reason: crate::hold_reason::HoldReason::Hold,
            cut: Vec::new(),
        }))
    }

    fn resumed(record: u32) -> JournalEntry {
        JournalEntry::Resumed(Box::new(ResumeEntry {
            when: Timestamp::from_ms(2),
            retrace: "0.1.0".into(),
            card: JobCard::Sim,
            place: Place::start_of(RecordIndex::new(record)),
            reached: RecordIndex::new(record),
            executed: 4,
            counts: vec![7, 8, 9],
        }))
    }

    fn end() -> JournalEntry {
        let end =
            EndEntry { when: Timestamp::from_ms(3), outcome: JobEnding::Stopped, exit_code: 4, report: Value::Null };
        JournalEntry::End(Box::new(end))
    }

    fn alarm(number: &str) -> JournalEntry {
        JournalEntry::Event(json!({"event": "alarm", "number": number}))
    }

    fn planned(place: u32) -> JournalEntry {
        JournalEntry::Override(PlannedOverride { place: RecordIndex::new(place), planned: Rate::from_units(5) })
    }

    /// Writes a journal of these entries to a file.
    fn written(entries: Vec<JournalEntry>) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("journal");
        let mut bytes = Vec::new();
        let first = JournalEntry::Job(Box::new(job("[machine]", JobCard::Sim)));
        for (number, entry) in std::iter::once(first).chain(entries).enumerate() {
            journal_line::append(
                &mut bytes,
                number as u64,
                true,
                &serde_json::to_vec(&entry).expect("it can be written"),
            );
        }
        std::fs::write(&path, bytes).expect("a file");
        (folder, path)
    }

    fn read(entries: Vec<JournalEntry>) -> JobRecord {
        let (_folder, path) = written(entries);
        JobRecord::read(&path).expect("whole")
    }

    /// A position in normal run, with the cutter on channel 3 on or off.
    fn runs(record: u32, is_on: bool, at_rest: bool) -> JournalEntry {
        let JournalEntry::Position(at) = at(record) else { unreachable!("a position") };
        let outputs = if is_on { vec![(3, 1)] } else { Vec::new() };
        JournalEntry::Position(Box::new(PositionEntry { at_rest, outputs, ..*at }))
    }

    fn retraces(record: u32, reached: u32) -> JournalEntry {
        let JournalEntry::Position(at) = runs(record, false, false) else { unreachable!("a position") };
        JournalEntry::Position(Box::new(PositionEntry {
            mode: Mode::Reverse,
            reached: RecordIndex::new(reached),
            ..*at
        }))
    }

    #[test]
    fn what_was_cut_is_known_unless_it_is_planned_anew() {
        let cuts = |ranges: &[[u32; 2]]| {
            let JournalEntry::Position(at) = at(9) else { unreachable!("a position") };
            let cut = ranges.iter().map(|range| range.map(RecordIndex::new)).collect();
            JournalEntry::Position(Box::new(PositionEntry { cut, ..*at }))
        };
        let anew = JournalEntry::Override(PlannedOverride { place: RecordIndex::new(60), planned: Rate::ONE });
        let record = read(vec![cuts(&[[20, 30]]), cuts(&[[20, 40], [50, 70]]), at(80), anew, cuts(&[[62, 64]])]);
        let ranges: Vec<_> = record
            .cut_ranges()
            .reaching_beyond(RecordIndex::new(0))
            .map(|range| range.map(RecordIndex::number))
            .collect();
        assert_eq!(ranges, [[20, 40], [50, 60], [62, 64]]);
    }

    #[test]
    fn a_start_is_begun_until_its_completion_is_recorded() {
        let event = |event: &str, record: u32, more: &str| {
            let more_key = if event == "cutter_off" { "reason" } else { "state" };
            JournalEntry::Event(json!({"event": event, "record": record, "channel": 3, more_key: more}))
        };
        let begun =
            |entries: &[&JournalEntry]| read(entries.iter().map(|&entry| entry.clone()).collect()).begun_start();
        let (here, switching, lit) = (&at(20), &event("switching", 21, ""), &event("cutter_state", 21, "igniting"));
        let switched = &event("switched", 21, "");
        assert_eq!(begun(&[here, switching]), None, "nothing is lit");
        assert_eq!(begun(&[here, switching, lit]), Some(3));
        assert_eq!(begun(&[switching, here, lit, here]), Some(3), "positions of the instruction before it");
        assert_eq!(begun(&[here, switching, lit, switched]), Some(3), "the position of its completion is missing");
        assert_eq!(begun(&[here, switching, lit, switched, here]), None);
        assert_eq!(begun(&[here, switching, lit, &at(30)]), None, "it has moved on");
        assert_eq!(begun(&[here, switching, lit, &resumed(20)]), None, "another place");
        let failed = &event("cutter_off", 21, "not_started");
        assert_eq!(begun(&[here, switching, lit, failed]), None);
        assert_eq!(begun(&[here, &event("restart_switching", 21, ""), lit]), None, "its instruction was complete");
    }

    #[test]
    fn a_cut_ends_where_it_was_interrupted_or_last_seen() {
        let end = |entries| read(entries).certain_cut_end(3).map(|place| (place.record.number(), place.fraction));
        let lost = json!({"event": "cut_end", "channel": 3, "cut_record": 40, "cut_fraction": 7});
        let lost = JournalEntry::Event(lost);
        assert_eq!(end(vec![runs(20, true, false), runs(30, true, false)]), Some((30, 3)), "it cuts");
        assert_eq!(end(vec![runs(30, true, false), lost.clone()]), Some((40, 7)));
        assert_eq!(end(vec![lost.clone(), runs(55, false, true)]), Some((40, 7)), "it rests beyond");
        assert_eq!(end(vec![lost.clone(), retraces(10, 56)]), Some((40, 7)));
        assert_eq!(end(vec![lost.clone(), runs(38, true, false)]), Some((40, 7)), "it is cut again, up to here");
        assert_eq!(end(vec![lost.clone(), runs(45, true, false)]), Some((40, 7)), "it is not proven yet");
        let continued = JournalEntry::Event(json!({"event": "cut_continued"}));
        assert_eq!(end(vec![lost.clone(), continued, runs(45, true, false)]), Some((45, 3)));
        assert_eq!(end(vec![runs(30, true, false), runs(33, false, true)]), Some((33, 0)), "a hold");
        assert_eq!(end(vec![runs(30, true, false), retraces(10, 36)]), Some((35, 0)));
        assert_eq!(end(vec![runs(30, false, false)]), None, "a rapid");
        assert_eq!(read(vec![lost.clone()]).certain_cut_end(4), None, "another cutter");
        let passed = json!({
            "event": "cut_end", "channel": 3, "cut_record": 40, "cut_fraction": 7, "may_be_longer": true,
            "latest_record": 66,
        });
        let latest = |entries| read(entries).interrupted_cut().map(|cut| (cut.latest.number(), cut.is_exact));
        assert_eq!(latest(vec![lost.clone()]), Some((40, true)));
        assert_eq!(latest(vec![lost, JournalEntry::Event(passed)]), Some((66, false)));
    }

    #[test]
    fn where_it_stood_is_what_was_said_last() {
        let stood = |entries| {
            let LastPosition { start, counts } = read(entries).last_position;
            (start.place.record, start.executed, counts)
        };
        assert_eq!(stood(vec![]), (RecordIndex::new(5), 0, vec![1, -2, 3]));
        assert_eq!(stood(vec![at(8), at(9)]), (RecordIndex::new(9), 2, vec![9, 2, 3]));
        assert_eq!(stood(vec![at(8), resumed(7)]), (RecordIndex::new(7), 4, vec![7, 8, 9]));
        assert_eq!(stood(vec![at(8), resumed(7), at(6)]), (RecordIndex::new(6), 2, vec![6, 2, 3]));
    }

    #[test]
    fn an_end_holds_until_the_job_is_taken_up_again() {
        let record = read(vec![alarm("E3013"), end()]);
        assert!(record.end.is_some() && record.alarm.is_some_and(|alarm| alarm["number"] == "E3013"));
        let record = read(vec![alarm("E3013"), end(), resumed(7), JournalEntry::Lost(LostEntries { entries: 3 })]);
        assert!(record.end.is_none() && record.alarm.is_none());
        assert_eq!((record.resumed.len(), record.lost), (1, 3));
    }

    #[test]
    fn an_override_undoes_what_was_planned_beyond_it() {
        let marks = |places: &[u32]| places.iter().map(|&place| JournalEntry::Mark(mark(place))).collect::<Vec<_>>();
        let counts = |entries: Vec<JournalEntry>| {
            let (_folder, path) = written(entries);
            let record = JobRecord::read(&path).expect("whole");
            let marks: Vec<u32> =
                record.marks().expect("whole").map(|mark| mark.expect("whole").place.number()).collect();
            assert_eq!(
                (record.marks, record.last_mark.map(|m| m.place.number())),
                (marks.len() as u64, marks.last().copied())
            );
            assert_eq!(record.durable_place().place(), RecordIndex::new(marks.last().copied().unwrap_or(5)));
            (marks, record.overrides().iter().map(|o| o.place.number()).collect::<Vec<_>>())
        };
        assert_eq!(counts(vec![]), (vec![], vec![]));
        assert_eq!(counts(marks(&[10, 20, 30])), (vec![10, 20, 30], vec![]));
        // as it is in one run: nothing is planned yet where an override begins
        let run = [marks(&[10, 20]), vec![planned(25)], marks(&[25, 30])].concat();
        assert_eq!(counts(run), (vec![10, 20, 25, 30], vec![25]));
        // the run ended, and was continued differently
        let twice = [marks(&[10, 20, 30]), vec![planned(35), resumed(5), planned(20)], marks(&[22])].concat();
        assert_eq!(counts(twice), (vec![10, 20, 22], vec![20]));
        let thrice = [vec![planned(15)], marks(&[18, 30]), vec![planned(20)], marks(&[21]), vec![planned(17)]].concat();
        assert_eq!(counts(thrice), (vec![], vec![15, 17]));
    }

    #[test]
    fn a_glance_sees_what_reading_all_of_it_sees() {
        for count in [0, 10, 8000] {
            for last in [vec![], vec![end()], vec![end(), resumed(7)]] {
                let marks = (0..count).map(|place| JournalEntry::Mark(mark(place)));
                let entries = std::iter::once(at(1)).chain(marks).chain([at(2)]).chain(last).collect();
                let (_folder, path) = written(entries);
                let read = JobRecord::read(&path).expect("whole");
                assert_eq!(JobSummary::read(&path), Ok(JobSummary::from(read)), "{count} marks");
            }
        }
        // where the last entries have no position, all of it is read
        let marks = (0..8000).map(|place| JournalEntry::Mark(mark(place)));
        let (_folder, path) = written(std::iter::once(at(1)).chain(marks).collect());
        assert!(JobSummary::read(&path).is_ok_and(|glance| glance.at.is_some()));
    }

    #[test]
    fn what_cannot_be_read_is_refused_by_its_number() {
        let (folder, path) = written(vec![at(1), at(2)]);
        let number = |path: &Path| JobRecord::read(path).expect_err("not to be read").number;
        assert_eq!(number(&folder.path().join("none")), "E2104");
        let mut bytes = std::fs::read(&path).expect("a file");
        let first = bytes.iter().position(|&byte| byte == b'\n').expect("a line");
        // Batches behind the first line show that the job has begun.
        for (at, result) in [(20, "E2203"), (first + 20, "E2203")] {
            bytes[at] ^= 1;
            std::fs::write(&path, &bytes).expect("a file");
            assert_eq!(number(&path), result);
            bytes[at] ^= 1;
        }
        for beginning in [&b""[..], &bytes[..first / 2]] {
            std::fs::write(&path, beginning).expect("a file");
            assert_eq!(number(&path), "E2204");
        }
    }

    #[test]
    fn a_mark_stands_behind_what_was_kept_of_the_program_it_is_of() {
        const PROGRAM: &[u8] = b"G1 X1\nM2   \n";
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("journal");
        let store = FileStore::create(&path).expect("a file");
        let (mut spooling, progress) =
            SpoolWriter::create(&folder.path().join("stream.ngc"), BufReader::with_capacity(6, PROGRAM))
                .expect("a spool");
        let journal = JournalWriter::begin(store, Durability::Synced, job("[machine]", JobCard::Sim), Some(progress))
            .expect("it works");
        let mut notes = journal.index_writer(None, &[]);
        let mut line = String::new();
        for place in [6, 7] {
            spooling.read_line(&mut line).expect("a line");
            notes.write(IndexEntry::Mark(mark(place)));
            journal.wait_until_saved().expect("it works");
        }
        let kept = |bytes, ended| JournalEntry::Spooled(SpooledBytes { bytes, ended });
        let entries = || open(&path).expect("a file").map(|entry| entry.expect("whole").1);
        let expected = [kept(6, false), JournalEntry::Mark(mark(6)), kept(12, false), JournalEntry::Mark(mark(7))];
        assert_eq!(entries().skip(1).collect::<Vec<_>>(), expected);
        assert_eq!(spooling.read_line(&mut line).expect("the end"), 0);
        notes.write(IndexEntry::Mark(mark(8)));
        drop(journal);
        assert_eq!(JobRecord::read(&path).expect("whole").spooled, SpooledBytes { bytes: 12, ended: true });
    }
}
