//! Every event is documented in `docs/json-events.md`, with each of its fields, and every documented event exists.
//!
//! Invariant: a new kind of event does not compile here until it has an example.

use crate::json_page;

use std::collections::BTreeSet;

use json_page::JsonPage;
use retrace_config::ChannelNames;
use retrace_controller::{
    AxisCounts, CardError, CommandError, CutterOffReason, CutterState, DifferingOutput, DifferingOutputs, DncEvent,
    DncFlags, DncStep, Event, EventKind, LeadShape, OperatorCommand, RestoredContour, SenseOutcome, StartSide,
};
use retrace_core::mode::Mode;
use retrace_core::{Place, RecordIndex};
use retrace_journal::Timestamp;

/// Events that the console of `run` and `resume` adds. The end-to-end tests compare each that is printed with the page.
const OF_THE_CONSOLE: [&str; 2] = ["contours", "cut_progress"];

/// An example of each kind of event. The match has no other purpose than to fail to compile for a kind without an
/// example.
fn examples() -> Vec<EventKind> {
    let counts = AxisCounts::new(&[1, -2, 3], 3);
    let dnc = |step| EventKind::Dnc(DncEvent { step, flags: DncFlags::default() });
    let fault = CardError::Fault { number: "E3002", cause: "cause".into(), remedy: "remedy".into() };
    let examples = vec![
        EventKind::Started,
        EventKind::Mode(Mode::Run),
        EventKind::Operator(OperatorCommand::Hold),
        EventKind::OverridePlanned(120.0),
        EventKind::FeedOverrideSwitched(false),
        EventKind::CommandRejected(CommandError::NothingBehind),
        EventKind::HistoryStartReached,
        EventKind::RetraceBarrier { code: "M3", is_passed_again: false },
        EventKind::CutterBoundary,
        EventKind::BackTargetReached,
        EventKind::HistoryEndReached,
        EventKind::OutputsDiffer(DifferingOutputs::first(
            &mut [
                DifferingOutput { code: "M64", line: 7, ..DifferingOutput::new(3, 0, 1) },
                DifferingOutput::new(64, 1, -1),
            ]
            .into_iter(),
        )),
        EventKind::OutputsRestored,
        EventKind::SenseTest { axis: 'z', outcome: SenseOutcome::Found { mm: -70.125 } },
        EventKind::SenseTest { axis: 'z', outcome: SenseOutcome::NoSheet },
        EventKind::Probed { touched: true, counts },
        EventKind::Tapped { reversal_turns: 1.25 },
        EventKind::Tapping { card_place: RecordIndex::new(7), is_resumed: false },
        EventKind::TapNotBegun,
        EventKind::ToolLifted,
        EventKind::RestartSwitching("M3"),
        EventKind::RestartSwitched("M3"),
        EventKind::CutterOff { channel: 3, reason: CutterOffReason::Operator },
        EventKind::CutterState { channel: 3, state: CutterState::Piercing, contour: 2 },
        EventKind::CutEnd {
            channel: 3,
            place: Place::default(),
            line: 4,
            may_be_longer: false,
            latest: RecordIndex::new(7),
        },
        EventKind::NotCut(1.25),
        EventKind::CutContinued,
        EventKind::ContoursRestored(
            [RestoredContour { number: 2, line: 7, cut_mm: 59.5, not_cut_mm: Some(0.5) }].into(),
        ),
        EventKind::Contour { number: 3, cut_mm: 59.5, not_cut_mm: 0.5 },
        EventKind::ContourSkip { number: 4, on: true },
        EventKind::Shift([1.5, -0.75], Some(StartSide { is_left: true, is_part: Some(false) })),
        EventKind::Shift([1.5, -0.75], None),
        EventKind::Lead(LeadShape::Arc),
        EventKind::StartInKerf,
        EventKind::Joined,
        EventKind::CutFromHere { moving: true },
        EventKind::CutterOn(3),
        EventKind::RetraceSwitched(3, 1),
        EventKind::RunResumed,
        EventKind::ProgramEnd,
        EventKind::Switching("M3"),
        EventKind::Switched("M3"),
        EventKind::OutputChanged(3, 1),
        EventKind::LossWatch { is_watched: false },
        EventKind::ProgramStop("M0"),
        EventKind::ToolChange(7),
        EventKind::SingleBlock,
        dnc(DncStep::Paused { counts, spindle: 1, speed: 1_500_000 }),
        dnc(DncStep::SpindleStopped),
        dnc(DncStep::SpindleStarted { spindle: -1, speed: 1 }),
        dnc(DncStep::Jogged { axis: 'z', mm: 1.5, cut_short: true, off: counts }),
        dnc(DncStep::ToolLength { axis: 'z', by_mm: 0.5, by_counts: 500, length_mm: Some(80.5) }),
        dnc(DncStep::ToolLength { axis: 'z', by_mm: 0.5, by_counts: 500, length_mm: None }),
        dnc(DncStep::Parked { stopped: false }),
        dnc(DncStep::PointerThere { stopped: false }),
        dnc(DncStep::Online),
        dnc(DncStep::Approaching),
        dnc(DncStep::Arrived),
        EventKind::Message("text".into()),
        EventKind::StreamStalled { source: "tcp://a:1".into(), since: Timestamp::from_ms(0) },
        EventKind::StreamResumed { source: "tcp://a:1".into(), waited_s: 1.5 },
        EventKind::Underrun,
        EventKind::Alarm(fault),
    ];
    for example in &examples {
        match example {
            EventKind::Started | EventKind::Mode(_) | EventKind::Operator(_) | EventKind::OverridePlanned(_) => {}
            EventKind::CommandRejected(_) | EventKind::HistoryStartReached | EventKind::RetraceBarrier { .. } => {}
            EventKind::FeedOverrideSwitched(_) => {}
            EventKind::CutterBoundary | EventKind::BackTargetReached | EventKind::HistoryEndReached => {}
            EventKind::OutputsDiffer(_) | EventKind::OutputsRestored | EventKind::RestartSwitching(_) => {}
            EventKind::CutEnd { .. } | EventKind::NotCut(_) | EventKind::CutFromHere { .. } => {}
            EventKind::CutContinued | EventKind::Contour { .. } | EventKind::Shift(..) | EventKind::Joined => {}
            EventKind::Tapping { .. } => {}
            EventKind::ToolLifted | EventKind::Probed { .. } | EventKind::Tapped { .. } | EventKind::TapNotBegun => {}
            EventKind::ContourSkip { .. } | EventKind::LossWatch { .. } | EventKind::SenseTest { .. } => {}
            EventKind::ContoursRestored(_) | EventKind::Lead(_) | EventKind::StartInKerf => {}
            EventKind::RestartSwitched(_)
            | EventKind::CutterOff { .. }
            | EventKind::CutterState { .. }
            | EventKind::CutterOn(_) => {}
            EventKind::RetraceSwitched(..) | EventKind::RunResumed | EventKind::ProgramEnd => {}
            EventKind::Switching(_) | EventKind::Switched(_) | EventKind::OutputChanged(..) => {}
            EventKind::ProgramStop(_) | EventKind::ToolChange(_) | EventKind::SingleBlock | EventKind::Message(_) => {}
            EventKind::StreamStalled { .. } | EventKind::StreamResumed { .. } | EventKind::Underrun => {}
            EventKind::Alarm(_) => {}
            EventKind::Dnc(event) => match event.step {
                DncStep::Paused { .. } | DncStep::SpindleStopped | DncStep::SpindleStarted { .. } => {}
                DncStep::Jogged { .. } | DncStep::ToolLength { .. } | DncStep::Online => {}
                DncStep::Parked { .. } | DncStep::PointerThere { .. } => {}
                DncStep::Approaching | DncStep::Arrived => {}
            },
        }
    }
    examples
}

#[test]
fn the_page_lists_every_event_and_no_other() {
    let (page, names) = (JsonPage::read(), ChannelNames::default());
    let mut seen = BTreeSet::new();
    for kind in examples() {
        let event = Event {
            period: 7,
            time_s: 0.007,
            place: Place { record: RecordIndex::new(5), fraction: 1 << 31 },
            line: 2,
            kind,
        };
        let json = event.to_json_naming(&names);
        page.check_event(&json).unwrap_or_else(|error| panic!("docs/json-events.md: {error}"));
        seen.insert(json["event"].as_str().expect("a name").to_owned());
    }
    let seen: BTreeSet<&str> = seen.iter().map(String::as_str).chain(OF_THE_CONSOLE).collect();
    assert_eq!(seen, page.event_names());
}
