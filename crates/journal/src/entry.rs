//! The entries of a job's journal: one entry per line, in self-contained numbers and strings.
//!
//! Invariant: an entry is read as it was written or not at all: what a newer version has added is rejected, not
//! guessed.

use retrace_config::{PierceMode, PlanMode};
use retrace_core::mode::Mode;
use retrace_core::{Place, Rate, RecordIndex};
use retrace_link::PathStart;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::file_hash::FileHash;
use crate::hold_reason::HoldReason;
use crate::place_index::{self, LengthChange, ProgramAnswer, TapBegin};
use crate::timestamp::Timestamp;

/// Version of the format.
pub const FORMAT: u32 = 3;

/// An entry.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JournalEntry {
    /// Header of the job. The first entry, and only the first.
    Job(Box<JobHeader>),
    /// State of the plan at a place.
    Mark(#[serde(with = "mark")] place_index::PlaceMark),
    /// Another override is planned from a place on.
    Override(PlannedOverride),
    /// The program was cut off or rejected: the path rests behind this block.
    Rest(PlannedRest),
    /// A tool length was entered in a pause.
    ToolLength(LengthChange),
    /// The machine has answered the program.
    Answer(Box<ProgramAnswer>),
    /// A rigid tap is planned; it may have begun if the machine was at its place.
    Tap(TapBegin),
    /// Position of the machine.
    Position(Box<PositionEntry>),
    /// An event, as `--json` prints it.
    Event(Value),
    /// Length of a streamed program that has been saved.
    Spooled(SpooledBytes),
    /// The job was resumed.
    Resumed(Box<ResumeEntry>),
    /// Events that were not saved because the disk did not keep up.
    Lost(LostEntries),
    /// The job ended.
    End(Box<EndEntry>),
}

/// Header of a job: everything that is needed to decode and plan it again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JobHeader {
    /// Version of the format, [`FORMAT`].
    pub format: u32,
    /// Name of the job, which is that of its folder.
    pub id: String,
    /// Time at which it began.
    pub when: Timestamp,
    /// Version of retrace.
    pub retrace_version: String,
    /// Fingerprint of the planning of that version. A job is resumed only by a version with the same
    /// fingerprint.
    pub planner: u32,
    /// Name of the program, for people.
    pub program: String,
    /// Source of the program.
    pub source: ProgramSource,
    /// Number of lines of the program, where it is a file.
    pub lines: Option<u64>,
    /// Every file that decoding has read.
    pub files: Vec<ReadFile>,
    /// The machine file, as it was when the job began.
    pub machine: MachineFileCopy,
    /// Arguments of the command that affect decoding and planning.
    pub arguments: CommandArguments,
    /// Offsets and tool data as they were when the job began. None in the journal of an older version.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tables: Option<LatchedTables>,
    /// The card.
    pub card: JobCard,
    /// Control period in microseconds.
    pub period_us: u32,
    /// Place where the path begins.
    #[serde(with = "record_index")]
    pub origin: RecordIndex,
    /// Counts of the machine's axes there.
    pub counts: Vec<i64>,
    /// Outputs that were not 0 there, channel and value.
    pub outputs: Vec<(u8, i32)>,
    /// Number of the last exclusive instruction that was complete there.
    pub executed: u32,
}

/// Source of a program.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProgramSource {
    /// A file, by its absolute path.
    File(String),
    /// Standard input.
    StandardInput,
    /// A TCP socket, by its address.
    Socket(String),
    /// A serial line, as given on the command line, without `serial:`.
    Serial(String),
    /// A FIFO or a character device, by its absolute path.
    Device(String),
}

/// Role of a file in the job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FileRole {
    /// The program.
    Program,
    /// A subprogram in a file of its own.
    Subprogram,
    /// The source of a cycle that could be called. Without a path, all shipped cycles together.
    Cycles,
    /// The tool table.
    Tools,
    /// The parameter file, as it was before the job.
    Parameters,
    /// A LinuxCNC machine configuration.
    Ini,
    /// The material table that the machine file names.
    Materials,
}

impl FileRole {
    /// The role in words.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Program => "program",
            Self::Subprogram => "subprogram",
            Self::Cycles => "cycle",
            Self::Tools => "tool table",
            Self::Parameters => "parameter file",
            Self::Ini => "INI file",
            Self::Materials => "material table",
        }
    }
}

/// A file that decoding has read.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReadFile {
    /// Role of the file.
    pub role: FileRole,
    /// Absolute path; empty for the shipped cycles.
    pub path: String,
    /// Hash of its content.
    pub hash: FileHash,
}

/// A machine file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MachineFileCopy {
    /// Absolute path. None where the built-in machine was used.
    pub path: Option<String>,
    /// Hash of its text.
    pub hash: FileHash,
    /// Its text, so that the job can be resumed after the file has been changed.
    pub text: String,
}

/// Offsets and tool data as they were when a job began. The job is resumed with these, even if their files have
/// changed.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LatchedTables {
    /// Every numbered parameter that is not at its initial value, in the format of a parameter file.
    pub parameters: String,
    /// The tool table, in the format of its file.
    pub tools: String,
    /// Number of the tool in the spindle; 0 is none.
    pub current_tool: u32,
    /// Number of the tool of the last T word; 0 is none.
    pub selected_tool: u32,
}

/// The tables of a machine in the state folder; absolute paths. The files need not exist.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MachineTables {
    /// Parameter file. None where the command gave one.
    pub parameters: Option<String>,
    /// Tool table. None where the command gave one.
    pub tools: Option<String>,
    /// Wear of the consumables. None in the journal of an older version.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub consumables: Option<String>,
}

/// Arguments of the command; paths are absolute.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandArguments {
    /// Whether blocks that begin with `/` are skipped.
    pub block_delete: bool,
    /// Line at which the job began.
    pub start_line: Option<u32>,
    /// Contour at which the job began.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_contour: Option<u32>,
    /// Folders with subprograms.
    pub subs: Vec<String>,
    /// Folder with cycles.
    pub cycles: Option<String>,
    /// Tool table.
    pub tools: Option<String>,
    /// Parameter file.
    pub params: Option<String>,
    /// LinuxCNC machine configuration.
    pub ini: Option<String>,
    /// How the speed along the path is planned, where the command has chosen it and not the machine file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<PlanMode>,
    /// What is done with the pierces, where the command has chosen it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pierces: Option<PierceMode>,
    /// The machine's own tables, where the job used them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub machine_tables: Option<MachineTables>,
}

/// The card of a job.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JobCard {
    /// The simulated card in the command's own process; it ends with it.
    Sim,
    /// A card on a serial line or another link.
    Wired(WiredCard),
}

/// A card on a serial line or another link.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WiredCard {
    /// Address as given on the command line, `PATH[@BAUD]`.
    pub address: String,
    /// Name of the card.
    pub name: String,
    /// Serial number; 0 where it has none.
    pub serial: u32,
    /// Random number that the card draws at every start.
    pub boot: u32,
}

/// Another override that is planned from a place on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlannedOverride {
    /// First record planned with it.
    #[serde(with = "record_index")]
    pub place: RecordIndex,
    /// The override.
    #[serde(with = "rate")]
    pub planned: Rate,
}

/// Records that the program was cut off or rejected, and that the path was planned to rest there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlannedRest {
    /// Number of the last planned block, from 1.
    pub block: u64,
}

/// Position of the machine.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PositionEntry {
    /// Time, by the computer's clock.
    pub when: Timestamp,
    /// Control periods since the start of the card.
    pub period: u64,
    /// Place of the cursor: record, and fraction in units of 2⁻³².
    #[serde(with = "place")]
    pub place: Place,
    /// The furthest place ever executed, as a record boundary.
    #[serde(with = "record_index")]
    pub reached: RecordIndex,
    /// Number of the last exclusive instruction that was complete.
    pub executed: u32,
    /// Whether the cursor was at rest.
    pub at_rest: bool,
    /// Counts of the machine's axes, in pulses.
    pub counts: Vec<i64>,
    /// Pulses of the tool axis besides those of `counts`: the height of a cutter that senses the sheet (CUT-55).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub layer: i32,
    /// Outputs that were not 0, channel and value, including spindle, speed, coolant and tool.
    pub outputs: Vec<(u8, i32)>,
    /// Program line of the record under the cursor.
    pub line: u32,
    /// The mode of operation.
    #[serde(with = "mode")]
    pub mode: Mode,
    /// Reason why the machine was at rest in normal run.
    pub hold_reason: HoldReason,
    /// What was cut since the position before, each by its first record and the first behind it (CUT-26). A range that
    /// is not complete comes again, longer, from the same first record on.
    #[serde(default, skip_serializing_if = "Vec::is_empty", with = "record_ranges")]
    pub cut: Vec<[RecordIndex; 2]>,
}

const fn is_zero(layer: &i32) -> bool {
    *layer == 0
}

impl PositionEntry {
    /// Start of a path that continues from this position.
    #[must_use]
    pub fn start(&self) -> PathStart {
        // Whether the path rests there follows from the records; a ramp is right in any case.
        PathStart { place: self.place, rests: false, reached: self.reached, executed: self.executed, keeps_state: true }
    }

    /// Whether the output of a cutter was on in normal run.
    #[must_use]
    pub fn is_cutting_with(&self, channel: u8) -> bool {
        self.mode == Mode::Run && self.outputs.iter().any(|&(of, value)| of == channel && value != 0)
    }
}

/// Length of a streamed program that has been saved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpooledBytes {
    /// Bytes from its beginning that are as durable as this entry.
    pub bytes: u64,
    /// Whether that is the whole program.
    pub ended: bool,
}

/// Records that the job was resumed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResumeEntry {
    /// Time.
    pub when: Timestamp,
    /// Version of retrace that resumed it.
    pub retrace: String,
    /// The card, as it was then.
    pub card: JobCard,
    /// Place of the cursor.
    #[serde(with = "place")]
    pub place: Place,
    /// The furthest place ever executed, as a record boundary.
    #[serde(with = "record_index")]
    pub reached: RecordIndex,
    /// Number of the last exclusive instruction that was complete.
    pub executed: u32,
    /// Counts of the machine's axes, in pulses.
    pub counts: Vec<i64>,
}

/// Number of entries that were not saved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LostEntries {
    /// Number of events and positions.
    pub entries: u64,
}

/// How a job ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JobEnding {
    /// The program was completed.
    Completed,
    /// The operator stopped it, or a block was rejected. It can be resumed.
    Stopped,
    /// An alarm stopped it. It can be resumed.
    Alarm,
}

/// End of a job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EndEntry {
    /// Time.
    pub when: Timestamp,
    /// Outcome.
    pub outcome: JobEnding,
    /// Exit code of the command.
    pub exit_code: u8,
    /// The report, as `--json` prints it.
    pub report: Value,
}

/// Serialization of a mark, with its counts up to the last one that is not 0.
mod mark {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use crate::place_index::PlaceMark;
    use retrace_core::RecordIndex;

    #[derive(Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Written {
        place: u32,
        block: u64,
        line: u32,
        counts: Vec<i64>,
    }

    pub(crate) fn serialize<S: Serializer>(mark: &PlaceMark, to: S) -> Result<S::Ok, S::Error> {
        let axes = mark.counts.iter().rposition(|&count| count != 0).map_or(0, |last| last + 1);
        let counts = mark.counts[..axes].to_vec();
        Written { place: mark.place.number(), block: mark.block, line: mark.line, counts }.serialize(to)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<PlaceMark, D::Error> {
        let Written { place, block, line, counts: written } = Written::deserialize(from)?;
        let mut counts = [0; 9];
        let there = counts.get_mut(..written.len()).ok_or_else(|| serde::de::Error::custom("more than nine axes"))?;
        there.copy_from_slice(&written);
        Ok(PlaceMark { place: RecordIndex::new(place), block, line, counts })
    }
}

/// A mode of operation by its name.
mod mode {
    use retrace_core::mode::Mode;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(crate) fn serialize<S: Serializer>(mode: &Mode, to: S) -> Result<S::Ok, S::Error> {
        mode.name().serialize(to)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Mode, D::Error> {
        let name = String::deserialize(from)?;
        let found = Mode::ALL.into_iter().find(|mode| mode.name() == name);
        found.ok_or_else(|| serde::de::Error::custom(format!("no mode `{name}`")))
    }
}

/// Serialization of the index of a record as its number.
mod record_index {
    use retrace_core::RecordIndex;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(crate) fn serialize<S: Serializer>(index: &RecordIndex, to: S) -> Result<S::Ok, S::Error> {
        index.number().serialize(to)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<RecordIndex, D::Error> {
        u32::deserialize(from).map(RecordIndex::new)
    }
}

/// Serialization of ranges of records by their numbers.
mod record_ranges {
    use retrace_core::RecordIndex;
    use serde::{Deserialize, Deserializer, Serializer};

    pub(crate) fn serialize<S: Serializer>(ranges: &[[RecordIndex; 2]], to: S) -> Result<S::Ok, S::Error> {
        to.collect_seq(ranges.iter().map(|range| range.map(RecordIndex::number)))
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<[RecordIndex; 2]>, D::Error> {
        let numbers = Vec::<[u32; 2]>::deserialize(from)?;
        Ok(numbers.into_iter().map(|range| range.map(RecordIndex::new)).collect())
    }
}

/// Serialization of a rate in units of 2⁻³².
mod rate {
    use retrace_core::Rate;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(crate) fn serialize<S: Serializer>(rate: &Rate, to: S) -> Result<S::Ok, S::Error> {
        rate.units().serialize(to)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Rate, D::Error> {
        i64::deserialize(from).map(Rate::from_units)
    }
}

/// Serialization of a place as record and fraction.
mod place {
    use retrace_core::{Place, RecordIndex};
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(crate) fn serialize<S: Serializer>(place: &Place, to: S) -> Result<S::Ok, S::Error> {
        (place.record.number(), place.fraction).serialize(to)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Place, D::Error> {
        let (record, fraction) = Deserialize::deserialize(from)?;
        Ok(Place { record: RecordIndex::new(record), fraction })
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde_json::json;

    fn stamp() -> impl Strategy<Value = Timestamp> {
        (0..4_102_444_800_000_u64).prop_map(Timestamp::from_ms)
    }

    fn a_place() -> impl Strategy<Value = Place> {
        (any::<u32>(), any::<u32>()).prop_map(|(record, fraction)| Place { record: RecordIndex::new(record), fraction })
    }

    fn counts() -> impl Strategy<Value = Vec<i64>> {
        prop::collection::vec(any::<i64>(), 0..=9)
    }

    pub(crate) fn marks() -> impl Strategy<Value = place_index::PlaceMark> {
        (any::<u32>(), any::<u64>(), any::<u32>(), counts()).prop_map(|(place, block, line, some)| {
            let mut counts = [0; 9];
            counts[..some.len()].copy_from_slice(&some);
            place_index::PlaceMark { place: RecordIndex::new(place), block, line, counts }
        })
    }

    fn cards() -> impl Strategy<Value = JobCard> {
        let wired = (".{0,9}", ".{0,9}", any::<u32>(), any::<u32>())
            .prop_map(|(address, name, serial, boot)| JobCard::Wired(WiredCard { address, name, serial, boot }));
        prop_oneof![Just(JobCard::Sim), wired]
    }

    /// A job with this machine file, hash and card.
    pub(crate) fn job(text: &str, card: JobCard) -> JobHeader {
        JobHeader {
            format: FORMAT,
            id: "20261122-004627-part".into(),
            when: Timestamp::from_ms(1_795_308_387_000),
            retrace_version: "0.1.0".into(),
            planner: 1,
            program: "part.ngc".into(),
            source: ProgramSource::File("part.ngc".into()),
            lines: Some(40),
            files: vec![ReadFile {
                role: FileRole::Program,
                path: "part.ngc".into(),
                hash: FileHash::of(text.as_bytes()),
            }],
            machine: MachineFileCopy { path: None, hash: FileHash::of(b""), text: text.into() },
            arguments: CommandArguments {
                start_line: Some(7),
                start_contour: Some(3),
                subs: vec!["subs".into()],
                ..CommandArguments::default()
            },
            tables: Some(LatchedTables {
                parameters: "5221\t1.5\n".into(),
                current_tool: 3,
                ..LatchedTables::default()
            }),
            card,
            period_us: 1000,
            origin: RecordIndex::new(5),
            counts: vec![1, -2, 3],
            outputs: vec![(64, 1)],
            executed: 0,
        }
    }

    fn ats() -> impl Strategy<Value = PositionEntry> {
        let mode = prop::sample::select(Mode::ALL.to_vec());
        let standing = prop::sample::select(vec![
            HoldReason::None,
            HoldReason::Hold,
            HoldReason::ProgramStop,
            HoldReason::SingleBlock,
            HoldReason::Paused,
        ]);
        let numbers = (any::<u64>(), any::<u32>(), any::<u32>(), any::<bool>(), any::<u32>());
        let outputs = prop::collection::vec(any::<(u8, i32)>(), 0..5);
        (stamp(), numbers, a_place(), counts(), outputs, mode, standing).prop_map(
            |(when, (period, reached, executed, at_rest, line), place, counts, outputs, mode, standing)| {
                PositionEntry {
                    when,
                    period,
                    place,
                    reached: RecordIndex::new(reached),
                    executed,
                    at_rest,
                    counts,
                    layer: if at_rest { -4 * executed.cast_signed().rem_euclid(9) } else { 0 },
                    outputs,
                    line,
                    mode,
                    hold_reason: standing,
                    cut: if at_rest { vec![[place.record, place.record + 7]] } else { Vec::new() },
                }
            },
        )
    }

    /// Entries that may follow the first.
    pub(crate) fn entries() -> impl Strategy<Value = JournalEntry> {
        let value =
            (any::<f64>(), ".{0,20}", any::<i64>()).prop_map(|(x, text, n)| json!({"x": x, "text": text, "n": [n]}));
        let report = (any::<f64>(), ".{0,20}").prop_map(|(x, text)| json!({"mm": {"x": x}, "text": text}));
        let ending = prop::sample::select(vec![JobEnding::Completed, JobEnding::Stopped, JobEnding::Alarm]);
        let resumed = (stamp(), cards(), a_place(), any::<(u32, u32)>(), counts()).prop_map(
            |(when, card, place, (reached, executed), counts)| ResumeEntry {
                when,
                retrace: "0.1.0".into(),
                card,
                place,
                reached: RecordIndex::new(reached),
                executed,
                counts,
            },
        );
        prop_oneof![
            4 => marks().prop_map(JournalEntry::Mark),
            1 => any::<(u32, i64)>().prop_map(|(place, planned)| {
                let planned = Rate::from_units(planned);
                JournalEntry::Override(PlannedOverride { place: RecordIndex::new(place), planned })
            }),
            1 => any::<u64>().prop_map(|block| JournalEntry::Rest(PlannedRest { block })),
            2 => ats().prop_map(|at| JournalEntry::Position(Box::new(at))),
            1 => value.prop_map(JournalEntry::Event),
            1 => any::<(u64, bool)>().prop_map(|(bytes, ended)| JournalEntry::Spooled(SpooledBytes { bytes, ended })),
            1 => any::<u64>().prop_map(|entries| JournalEntry::Lost(LostEntries { entries })),
            1 => resumed.prop_map(|resumed| JournalEntry::Resumed(Box::new(resumed))),
            1 => (stamp(), ending, any::<u8>(), report)
                .prop_map(|(when, outcome, exit_code,
                    report)| JournalEntry::End(Box::new(EndEntry { when, outcome, exit_code, report }))),
        ]
    }

    proptest! {
        #[test]
        fn every_entry_is_read_as_it_was_written(entry in entries()) {
            let text = serde_json::to_string(&entry).expect("it can be written");
            prop_assert!(!text.contains('\n'));
            prop_assert_eq!(serde_json::from_str::<JournalEntry>(&text).expect("it can be read"), entry);
        }

        #[test]
        fn every_job_is_read_as_it_was_written(text in ".{0,80}", card in cards()) {
            let entry = JournalEntry::Job(Box::new(job(&text, card)));
            let written = serde_json::to_string(&entry).expect("it can be written");
            prop_assert!(!written.contains('\n'));
            prop_assert_eq!(serde_json::from_str::<JournalEntry>(&written).expect("it can be read"), entry);
        }
    }

    #[test]
    fn what_is_not_known_is_not_guessed() {
        let mark = r#"{"mark":{"place":1,"block":2,"line":3,"counts":[4]}}"#;
        assert!(serde_json::from_str::<JournalEntry>(mark).is_ok());
        for newer in [
            mark.replace("}}", ",\"more\":1}}"),
            mark.replace("mark", "marc"),
            mark.replace("[4]", "[1,2,3,4,5,6,7,8,9,10]"),
            mark.replace(",\"line\":3", ""),
            r#"{"lost":{"entries":-1}}"#.into(),
        ] {
            assert!(serde_json::from_str::<JournalEntry>(&newer).is_err(), "{newer}");
        }
    }
}
