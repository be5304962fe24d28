//! The controller: executes an NC program on a motion card. Reading, decoding, planning, the motion path and the report
//! each run in their own thread ([`run_job`]).
//!
//! ```text
//!  program ─> decoding ─> canon_executor ─> plan_writer ─> ring ─> record_streamer ─> card
//!  (read_ahead) (decoding) (planning) (core::ring) (session)
//! ```
//!
//! The operator's commands ([`OperatorCommand`]) reach the motion path through a queue ([`command_channel`]); what
//! happens leaves it as [`Telemetry`]. A [`JournalRecorder`] records what is needed to resume an interrupted job
//! ([`resume_job`], [`ResumePlan`]). [`check_program`] checks a program without moving anything, and
//! [`perform_manual_task`] moves the machine without a program.
//!
//! The modules are private; every public item is found here, under one name.
//!
//! Invariant: a program from a file is checked whole before anything of it reaches the card; a streamed program is
//! checked block by block. In wall time the motion path never waits for the planner; it never allocates, locks, formats
//! or accesses a file from its first control period to its last.
#![forbid(unsafe_code)]

mod abrasive_flow;
mod any_card;
mod approach;
mod batch_channel;
mod block_decoder;
mod canon_error;
mod canon_executor;
mod check_finding;
mod command_channel;
mod command_queue;
mod contour_list;
mod contour_records;
mod contour_states;
mod cut_outline;
mod cutter_off_reason;
mod cutter_state;
mod cutter_track;
mod decoding;
mod differing_outputs;
mod dnc_events;
mod entered_threads;
mod event;
mod executed_path;
mod fingerprint;
mod job;
mod jog_mailbox;
mod jog_planner;
mod jog_speed;
mod journal_recorder;
mod kept_tap;
mod kerf_map;
mod lead_arc;
mod limit_check;
mod limit_monitor;
mod manual;
mod manual_move;
mod material_figures;
mod mdi;
mod motion_sink;
mod operator;
mod operator_words;
mod overrides;
mod path_profile;
mod plan_item;
mod plan_writer;
mod planned_path;
mod planning;
mod probe_move;
mod probe_stop;
mod program_analysis;
mod question;
mod read_ahead;
mod record_streamer;
mod report;
mod restart;
mod resume;
mod run_stats;
mod script;
mod sense_outcome;
mod session;
mod soft_limits;
mod spline;
mod start_line;
mod sync;
mod tap_move;
mod tape;
mod telemetry;
mod thread_plan;
mod thread_plans;
mod thread_run_in;
mod tool_length;
mod unchecked_analysis;
mod value_range;

pub use abrasive_flow::AbrasiveFlow;
pub use any_card::{AnyCard, AnyCardFailure};
pub use block_decoder::{BlockDecoder, DecodedBlock};
pub use canon_executor::WorkOffset;
pub use check_finding::{CheckFinding, FindingList, more_rounds_text};
pub use command_channel::{CommandQueueFull, CommandReceiver, CommandSender, command_channel};
pub use command_queue::CommandSources;
pub use contour_list::{ContourList, MaterialSummary, PlannedContour, RestoredContour};
pub use contour_states::{ContourRow, ContourState, ContourStates};
pub use cut_outline::CutOutline;
pub use cutter_off_reason::CutterOffReason;
pub use cutter_state::CutterState;
pub use differing_outputs::{DifferingOutput, DifferingOutputs};
pub use dnc_events::{AxisCounts, DncEvent, DncFlags, DncStep};
pub use event::{CardError, Event, EventKind};
pub use executed_path::ExecutedPath;
pub use fingerprint::planning_fingerprint;
pub use job::{JobEnd, JobOptions, JobStart, JobStartError, check_program, feed_program, resume_job, run_job};
pub use jog_planner::{Identify, JogPlanner, MANUAL_PLACE_OFFSET};
pub use jog_speed::JogSpeed;
pub use journal_recorder::JournalRecorder;
pub use kept_tap::KeptTap;
pub use lead_arc::LeadArcError;
pub use limit_check::LimitCheck;
pub use limit_monitor::{AxisExtremes, LimitMonitor, LimitReport, LimitViolation, MonitorLimits};
pub use manual::{
    CutFrame, FrameShape, ManualTask, ManualTaskDone, ManualTaskError, SheetEdge, SheetPlacement, perform_manual_task,
};
pub use material_figures::material_config;
pub use mdi::{MdiBlock, ModalContext, interpreter_setup};
pub use motion_sink::MotionSink;
pub use operator::{
    CommandError, CutStart, HeightCommand, LeadShape, OperatorCommand, ScriptInstruction, ScriptTime, Shift, StartSide,
    rate_percent,
};
pub use operator_words::{parse_operator_command, parse_script};
pub use overrides::{OverrideApplier, OverrideQueueFull, OverrideRequester};
pub use path_profile::PathProfile;
pub use plan_item::{ExclusiveInstruction, ExclusiveKind, PathItem, PlanEnd, PlanSummary};
pub use plan_writer::{Cancelled, PlanWriteError, PlanWriter, SwitchInstruction};
pub use planned_path::{PathKind, PathVertex, PlannedPath};
pub use probe_move::{ProbeMove, ProbeOutcome, ProbeResult};
pub use program_analysis::{
    Analysed, BarrierLine, ProgramAnalysis, TravelLeft, WorkExtents, analyse_path, analyse_program,
};
pub use question::{InputQuestion, MachineResult, Question, ReadInput};
pub use read_ahead::{ReadAhead, SourceStatus};
pub use record_streamer::{PassedItem, RecordStreamer, SendHorizon};
pub use report::Report;
pub use restart::RestartStep;
pub use resume::{ResumeError, ResumePlan, ResumePoint, ResumedCutEnd};
pub use run_stats::{PeriodClass, RunStats};
pub use script::ScriptPlayer;
pub use sense_outcome::SenseOutcome;
pub use session::{Outcome, RunMode, Session};
pub use soft_limits::LimitFinding;
pub use start_line::StartPoint;
pub use tape::{ReceivedByte, TapeError, TapeReader, UnsendableCharacter, tape_of};
pub use telemetry::{Observer, PeriodRecord, Telemetry, TelemetryReceiver, TelemetrySender, telemetry_channel};
pub use thread_plan::{ThreadError, ThreadPiece, ThreadPlan, ThreadPlanner, ThreadRuns, ThreadStretch};
pub use tool_length::{EnteredLength, ToolLengthError};
pub use unchecked_analysis::analyse_unchecked;
pub use value_range::ValueRange;
