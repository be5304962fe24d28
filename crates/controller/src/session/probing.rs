//! Probing moves and rigid taps of the program (PRB-2 to PRB-7, SPN-19).
//!
//! A probing move is a path of its own on the card, with the probe's latch armed. What the machine did of it goes to
//! the planner, which makes it part of the job's path; the path then continues behind it, where the machine is. A tap
//! is such a path with a gear, and ends where it began: of it, a barrier becomes part of the job's path.
//!
//! Invariant: nothing moves before the card has reported that the latch is armed. The job's path continues only where
//! the planner's records of the move sum to the machine's counts.

use std::sync::mpsc::SyncSender;

use retrace_config::{IN_FLIGHT_RECORDS, MachineConfig};
use retrace_core::{Flags, Place, Rate, RecordIndex};
use retrace_journal::{ProbeAnswer, ProgramAnswer, TapAnswer};
use retrace_link::{
    CardStatus, GearState, HostCommand, MotionCard, PathStart, ProbeArming, ProbeLatch, SpindleControl,
};

use super::{Outcome, Session};
use crate::dnc_events::AxisCounts;
use crate::event::{CardError, EventKind};
use crate::jog_planner::JogRequest;
use crate::kept_tap::KeptTap;
use crate::manual_move::{ManualMove, ManualMoveEnd};
use crate::plan_item::{ExclusiveKind, PlanEnd};
use crate::probe_move::ProbeMove;
use crate::resume::ResumePlan;
use crate::run_stats::PeriodClass;
use crate::tap_move::TapQuestion;
use probe_plug::{ProbePlug, ProbePlugState};

mod probe_plug;

/// Most runs of periods with the same distance in a probing move. Each hold takes about a hundred.
const MAX_RUNS: usize = 1 << 16;

/// What is to be done with a tap in whose hole the machine does not go on.
const REMEDY_OF_TAP: &str = "take the tap out of its holder, move the tool clear of the work, then begin before the \
    tap: `retrace resume JOB --from-line N`";

/// Probing of a program.
#[derive(Debug)]
pub(super) struct ProgramProbing<const A: usize> {
    /// To the planner; `None` where the program cannot probe.
    answers: Option<SyncSender<ProgramAnswer>>,
    /// The probe's input, and the filter of its level.
    input: Option<(u8, u16)>,
    plug: ProbePlug,
    /// Records ahead that are enough to run a probing move at full rate.
    look_ahead_records: u32,
    axes: usize,
    current: Option<CurrentProbing<A>>,
    /// Periods of the move in progress: runs of their number and the distance in each.
    runs: Vec<[u64; 2]>,
    /// Number of these periods.
    moved: u32,
    /// Records from the beginning of a tap to where it turned.
    turned: u32,
    /// Whether the job was resumed in the tap in progress: outputs are restored behind it.
    is_resumed_tap: bool,
}

/// What is executed off the job's path.
#[derive(Clone, Copy, Debug)]
pub(super) enum OffPathMove {
    Probe(ProbeMove),
    Tap(TapQuestion),
}

impl OffPathMove {
    const fn code(&self) -> &'static str {
        match self {
            Self::Probe(question) => question.code(),
            Self::Tap(_) => "rigid tap",
        }
    }
}

/// A probing move or tap in progress.
#[derive(Debug)]
struct CurrentProbing<const A: usize> {
    question: OffPathMove,
    /// Place of the job's path at which it begins.
    place: RecordIndex,
    line: u32,
    /// The card's counts there; behind the move, at the last record that was passed.
    counts: [i64; A],
    /// Place up to which the records of the move were passed.
    passed: RecordIndex,
    /// The move; `None` once it is over.
    trip: Option<ManualMove>,
    /// Place behind it once the planner has it.
    end: RecordIndex,
}

/// The probe is not plugged in, as its input tells.
fn not_plugged_in(input: u8) -> CardError {
    let cause = format!("the probe is not plugged in: input {input} is inactive");
    fault("E3038", &cause, "plug it in, then resume")
}

impl<const A: usize> CurrentProbing<A> {
    /// Whether it is a probing move, and not over.
    fn is_probing(&self) -> bool {
        self.trip.is_some() && matches!(self.question, OffPathMove::Probe(_))
    }
}

impl<const A: usize> ProgramProbing<A> {
    pub(super) fn new(machine: &MachineConfig) -> Self {
        let input = machine.probe.input.map(|input| (input, machine.probe.filter_periods));
        let runs = Vec::with_capacity(if input.is_some() { MAX_RUNS } else { 0 });
        let (plug, axes) = (ProbePlug::new(machine.probe.connected_input), machine.axes.len());
        let look_ahead_records = machine.probe.limits.stopping.look_ahead_records + IN_FLIGHT_RECORDS;
        Self {
            answers: None,
            input,
            plug,
            look_ahead_records,
            axes,
            current: None,
            runs,
            moved: 0,
            turned: 0,
            is_resumed_tap: false,
        }
    }

    /// Begins a probing move or a tap.
    fn begin(&mut self, current: CurrentProbing<A>) {
        self.runs.clear();
        self.plug.restart();
        (self.moved, self.turned, self.is_resumed_tap, self.current) = (0, 0, false, Some(current));
    }

    /// Whether a probing move is in progress.
    pub(super) fn is_active(&self) -> bool {
        self.current.is_some()
    }

    /// Whether what is in progress is a probing move.
    pub(super) fn is_probing_move(&self) -> bool {
        self.current.as_ref().is_some_and(|current| matches!(current.question, OffPathMove::Probe(_)))
    }

    /// Whether the tap in progress is, or was, on its way.
    fn has_begun(&self, status: &CardStatus<A>) -> bool {
        self.turned > 0 || status.spindle.gear == GearState::Engaged
    }

    /// Whether the tap in progress has turned at its depth.
    pub(super) fn has_tap_turned(&self) -> bool {
        let Some(CurrentProbing { question: OffPathMove::Tap(question), .. }) = self.current else { return true };
        matches!(question.gear.control, SpindleControl::Tap(turn) if self.turned >= turn)
    }

    /// Whether the job was resumed in the tap in progress.
    pub(super) const fn is_resumed_tap(&self) -> bool {
        self.is_resumed_tap
    }

    /// The tap in progress is out of its hole again, where it began.
    pub(super) const fn forget_tap_begun(&mut self) {
        self.turned = 0;
    }

    /// Program line of the move in progress.
    pub(super) fn line(&self) -> Option<u32> {
        self.current.as_ref().map(|current| current.line)
    }

    /// Gives the planner an answer.
    pub(super) fn send(&self, answer: ProgramAnswer) -> Result<(), CardError> {
        let is_sent = self.answers.as_ref().is_some_and(|answers| answers.try_send(answer).is_ok());
        let refused = || fault("E3031", "the planner takes no answer of the machine", "please report this");
        is_sent.then_some(()).ok_or_else(refused)
    }

    /// Records that the machine moved in a period.
    fn record(&mut self, distance: u64) -> Result<(), CardError> {
        self.moved += 1;
        if let Some([count, of]) = self.runs.last_mut()
            && *of == distance
        {
            *count += 1;
            return Ok(());
        }
        if self.runs.len() == MAX_RUNS {
            return Err(fault("E3031", "a probing move was held too often to be recorded", "start the job again"));
        }
        self.runs.push([1, distance]);
        Ok(())
    }
}

impl<'r, const A: usize, C: MotionCard<A>> Session<'r, A, C> {
    /// Enables questions of the program.
    #[must_use]
    pub(crate) fn with_answers(mut self, answers: SyncSender<ProgramAnswer>) -> Self {
        self.probing.answers = Some(answers);
        self
    }

    /// Begins a probing move or a tap. The machine is at rest on its place.
    pub(super) fn begin_off_path(
        &mut self,
        question: OffPathMove,
        place: RecordIndex,
        line: u32,
    ) -> Result<(), CardError> {
        let CardStatus { executed, counts, .. } = *self.card.status();
        let wall_time = self.config.run_mode.wall_time;
        let look_ahead = match question {
            OffPathMove::Probe(_) => self.probing.look_ahead_records,
            OffPathMove::Tap(_) => self.config.look_ahead_records,
        };
        let Some(hand) = &mut self.dnc.jog_planner else {
            return Err(fault("E3031", "there is no planner of manual moves", "please report this"));
        };
        let mut begin = |request| ManualMove::begin(hand, request, executed, look_ahead, wall_time);
        let trip = match (question, self.probing.input) {
            (OffPathMove::Tap(TapQuestion { tap, gear }), _) => begin(JogRequest::Tap(tap)).tapping(gear),
            (OffPathMove::Probe(probe), Some((input, filter_periods))) => {
                let arming = ProbeArming { input, active: !probe.probing.away, filter_periods };
                begin(JogRequest::Probe(probe)).probing(arming)
            }
            (OffPathMove::Probe(_), None) => {
                return Err(fault("E3031", "the machine has no probe", "declare its input in the machine file"));
            }
        };
        self.emit_at(line, EventKind::Switching(question.code()));
        if matches!(question, OffPathMove::Tap(_)) {
            let kind = EventKind::Tapping { card_place: trip.start(), is_resumed: false };
            self.emit_at_place(line, Place::start_of(place), kind);
        }
        let trip = Some(trip);
        self.probing.begin(CurrentProbing { question, place, line, counts, passed: place, trip, end: place });
        self.executing = Some(ExclusiveKind::OffPath);
        Ok(())
    }

    /// Goes on with a tap that the card has kept. It is held where its tool rests, until the operator decides.
    ///
    /// # Errors
    /// The card's fault; the card has not kept the tap; there is no planner of manual moves.
    pub(super) fn take_up_tap(&mut self, kept: &KeptTap, prepared: &ResumePlan<A>) -> Result<(), CardError> {
        let KeptTap { question, first, line } = *kept;
        let CardStatus { place, reached, executed, .. } = *self.card.status();
        self.card.begin_path(PathStart { place, rests: false, reached, executed, keeps_state: true })?;
        let status = *self.card.status();
        if status.spindle.gear != GearState::Engaged {
            return Err(fault("E2219", "the card does not hold the tap in its hole any more", REMEDY_OF_TAP));
        }
        let (look_ahead, wall_time) = (self.config.look_ahead_records, self.config.run_mode.wall_time);
        let Some(hand) = &mut self.dnc.jog_planner else {
            return Err(fault("E3031", "there is no planner of manual moves", "please report this"));
        };
        let trip = ManualMove::begin(hand, JogRequest::Tap(question.tap), status.executed, look_ahead, wall_time)
            .resumed_tap(question.gear, &status);
        let (place, counts, trip) = (prepared.start().place.record, prepared.counts(), Some(trip));
        let question = OffPathMove::Tap(question);
        self.probing.begin(CurrentProbing { question, place, line, counts, passed: place, trip, end: place });
        self.probing.turned = first.records_to(status.reached).max(0) as u32;
        self.probing.is_resumed_tap = true;
        self.executing = Some(ExclusiveKind::OffPath);
        self.emit_at_place(line, Place::start_of(place), EventKind::Tapping { card_place: first, is_resumed: true });
        Ok(())
    }

    /// Watches whether the probe is plugged in, while a probing move is under way.
    ///
    /// # Errors
    /// It is not, and the move has not begun.
    fn watch_plug(&mut self) -> Result<ProbePlugState, CardError> {
        let is_probing = self.probing.current.as_ref().is_some_and(CurrentProbing::is_probing);
        let inputs = self.card.status().inputs;
        match self.probing.plug.watch(inputs, self.config.period_s) {
            _ if !is_probing => Ok(ProbePlugState::PluggedIn),
            ProbePlugState::Unplugged(input) if !self.probing.plug.has_begun() => Err(not_plugged_in(input)),
            state => Ok(state),
        }
    }

    /// Runs a control period of a probing move.
    pub(super) fn run_probing_period(&mut self) -> Result<Option<Outcome>, CardError> {
        self.apply_commands();
        let is_held = self.mode_controller.is_held();
        let is_stopping = self.phase.is_stopping();
        let has_begun = self.probing.has_begun(self.card.status());
        let is_reversed = self.geared.reverses_tap();
        let plug = self.watch_plug()?;
        if let (Some(current), Some(hand)) = (&mut self.probing.current, &mut self.dnc.jog_planner)
            && let Some(trip) = &mut current.trip
        {
            if plug == ProbePlugState::Awaited {
                let status = *self.card.run_period()?;
                self.account_probing_period(&status);
                return Ok(self.alarm(&status).or_else(|| is_stopping.then_some(Outcome::Stopped)));
            }
            // A stop lets a tap come out first, as a thread is finished, once the tool is on its way, and unless it is
            // held: then it stays where it is.
            let is_tap = matches!(current.question, OffPathMove::Tap(_));
            let comes_out = is_tap && has_begun && !trip.is_held();
            if !(is_stopping && comes_out) {
                trip.hold(is_held);
                trip.reverse(is_reversed);
                if is_stopping || matches!(plug, ProbePlugState::Unplugged(_)) {
                    trip.stop();
                }
            }
            match trip.advance(hand, &mut self.card)? {
                None => {}
                Some(ManualMoveEnd::NotPlanned) => {
                    return Err(fault("E3031", "the move could not be planned", "please report this"));
                }
                // It stays in progress: the periods to the end of the job are none of the path.
                Some(ManualMoveEnd::Stopped) => {
                    if let ProbePlugState::Unplugged(input) = plug {
                        return Err(not_plugged_in(input));
                    }
                    self.tell_tap_not_begun();
                    return Ok(Some(Outcome::Stopped));
                }
                Some(ManualMoveEnd::Completed) => {
                    current.trip = None;
                    self.answer_off_path()?;
                }
            }
        } else {
            self.rejoin_behind_probing()?;
        }
        let status = *self.card.run_period()?;
        self.watch_gear();
        match self.probing.current.as_ref().filter(|current| current.trip.is_some()) {
            Some(CurrentProbing { question: OffPathMove::Tap(_), trip: Some(trip), .. }) => {
                let records = trip.start().records_to(status.place.record);
                self.probing.turned = self.probing.turned.max(records.max(0) as u32);
            }
            Some(_) if status.rate != Rate::ZERO => {
                self.probing.record(status.rate.over(1).units().unsigned_abs())?;
            }
            _ => {}
        }
        self.account_probing_period(&status);
        let outcome = self.alarm(&status);
        if outcome.is_some() {
            self.tell_tap_not_begun();
        }
        Ok(outcome.or_else(|| self.is_abandoned().then_some(Outcome::Stopped)))
    }

    /// Tells that the tap that is due has not begun, where the job ends. Nothing begins it any more: the card requests
    /// no motion.
    fn tell_tap_not_begun(&mut self) {
        let has_begun = self.probing.has_begun(self.card.status());
        if let Some(CurrentProbing { question: OffPathMove::Tap(_), line, place, trip: Some(_), .. }) =
            self.probing.current
            && !has_begun
        {
            self.emit_at_place(line, Place::start_of(place), EventKind::TapNotBegun);
        }
    }

    /// Counts and reports a period of a probing move.
    fn account_probing_period(&mut self, status: &CardStatus<A>) {
        let held = self.mode_controller.is_held();
        let mode = self.mode_controller.mode();
        // Where the path will be: each period in which the machine moves becomes a record of it.
        let place = self
            .probing
            .current
            .as_ref()
            .map_or(status.place, |current| Place::start_of(current.place + self.probing.moved));
        self.stats.count_period(PeriodClass { mode, held, instruction: Some(false), rate: status.rate, place });
        self.report_off_path_period(status);
        self.still_periods = if status.rate == Rate::ZERO && held { self.still_periods + 1 } else { 0 };
    }

    /// Gives the planner what the machine did in the move that is over.
    fn answer_off_path(&mut self) -> Result<(), CardError> {
        match self.probing.current.as_ref().map(|current| (current.question, current.place)) {
            Some((OffPathMove::Probe(question), _)) => self.answer_probing(question),
            Some((OffPathMove::Tap(question), place)) => self.answer_tap(&question, place),
            None => Ok(()),
        }
    }

    fn answer_tap(&mut self, question: &TapQuestion, place: RecordIndex) -> Result<(), CardError> {
        let (turned, gear) = (self.probing.turned, question.gear);
        let answer = TapAnswer { block: 0, place: place.number(), turned };
        self.probing.send(ProgramAnswer::Tap(answer))?;
        if let SpindleControl::Tap(reversed) = gear.control {
            let records = f64::from(turned) - f64::from(reversed);
            let reversal_turns = records.max(0.0) / f64::from(gear.records_per_turn.max(1));
            let line = self.probing.line().unwrap_or_default();
            self.emit_at_place(line, Place::start_of(place), EventKind::Tapped { reversal_turns });
        }
        Ok(())
    }

    fn answer_probing(&mut self, question: ProbeMove) -> Result<(), CardError> {
        let status = *self.card.status();
        let Some(current) = &self.probing.current else { return Ok(()) };
        let ProbeMove { from, probing, .. } = question;
        let touch = match status.probe {
            ProbeLatch::Touched(counts) => Some(counts),
            _ => None,
        };
        let (code, what) = (current.question.code(), if probing.away { "lose contact" } else { "make contact" });
        match touch {
            None if probing.must_trip => {
                let cause = format!("{code}: the probe did not {what} up to the end of the move");
                return Err(fault("E3029", &cause, "check the probe and the end of the move, then resume"));
            }
            Some(_) if probing.must_trip && self.probing.runs.is_empty() => {
                let state = if probing.away { "is not in contact" } else { "is in contact" };
                let cause = format!("{code}: the probe {state} before the move");
                return Err(fault("E3030", &cause, "move the probe to where the move is to begin, then resume"));
            }
            _ => {}
        }
        // The path of the job may be moved by a tool length that was entered.
        let on_path = |counts: &[i64; A]| -> Vec<i64> {
            let axes = counts.iter().zip(&current.counts).zip(&from).take(self.probing.axes);
            axes.map(|((count, begin), from)| count - begin + from).collect()
        };
        let rest = on_path(&status.counts);
        let touch_counts = touch.as_ref().map_or_else(|| rest.clone(), on_path);
        let runs = self.probing.runs.clone();
        let (place, line) = (current.place, current.line);
        let answer =
            ProbeAnswer { block: 0, place: place.number(), touched: touch.is_some(), touch: touch_counts, rest, runs };
        self.probing.send(ProgramAnswer::Probe(answer))?;
        if let Some(current) = &mut self.probing.current {
            current.end = place + self.probing.moved;
        }
        let counts = AxisCounts::new(&touch.unwrap_or(status.counts), self.probing.axes);
        let kind = EventKind::Probed { touched: touch.is_some(), counts };
        self.emit_at_place(line, Place::start_of(place), kind);
        Ok(())
    }

    /// Whether the cursor is, or was in this period, in a probing move that has become part of the path.
    pub(super) fn retraces_probing(&self, status: &CardStatus<A>) -> bool {
        let here = status.place.record;
        let is_probing =
            |place| self.streamer.record(place).is_some_and(|record| record.flags.contains(Flags::PROBING));
        self.probing.input.is_some() && status.rate != Rate::ZERO && (is_probing(here) || is_probing(here - 1))
    }

    fn reason_of_end(&self) -> String {
        let why = match self.streamer.summary().map(|summary| &summary.ending) {
            Some(PlanEnd::BlockError(text)) => text.as_str(),
            _ => "the planner has ended",
        };
        format!("the path does not go on behind the move: {why}")
    }

    /// Passes the records of the move that the planner has written, so that there is space for more. Returns whether
    /// these are all, and the counts behind them.
    fn pass_probing_records(&mut self) -> Option<(bool, [i64; A])> {
        self.streamer.poll_planner();
        let current = self.probing.current.as_mut()?;
        while current.passed.is_before(current.end) && self.streamer.is_sure_until(current.passed + 1) {
            let record = self.streamer.record(current.passed)?;
            current.counts.iter_mut().zip(&record.increments).for_each(|(sum, &n)| *sum += i64::from(n));
            current.passed += 1;
            self.streamer.seek_place(current.passed);
        }
        let is_passed = current.passed == current.end && self.streamer.is_sure_until(current.end);
        // Behind a tap the planner writes a barrier: the answer is in the journal then.
        let is_answered =
            !matches!(current.question, OffPathMove::Tap(_)) || self.streamer.next_exclusive() == Some(current.end);
        Some((is_passed && is_answered, current.counts))
    }

    /// Continues the job's path behind the move, once the planner has made the move part of it.
    fn rejoin_behind_probing(&mut self) -> Result<(), CardError> {
        let sum = loop {
            // What was complete before is passed here; what becomes so meanwhile is passed the next time.
            let end = self.probing.current.as_ref().map(|current| current.end);
            let has_ended = end.is_some_and(|end| self.streamer.has_ended_at(end));
            match self.pass_probing_records() {
                Some((true, sum)) => break sum,
                _ if has_ended => {
                    return Err(fault("E3031", &self.reason_of_end(), "please report this"));
                }
                _ if self.config.run_mode.wall_time => return Ok(()),
                _ => std::thread::sleep(std::time::Duration::from_micros(50)),
            }
        };
        let Some(CurrentProbing { end, .. }) = self.probing.current else { return Ok(()) };
        if sum != self.card.status().counts {
            return Err(fault("E3031", "the path behind the move is not where the machine is", "please report this"));
        }
        let number = self.streamer.instruction_number();
        let start =
            PathStart { place: Place::start_of(end), rests: true, reached: end, executed: number, keeps_state: true };
        self.begin_program_path(start)?;
        let _ = self.card.send(HostCommand::Replay { on: self.config.replays_outputs });
        self.probing.current = None;
        self.target = None;
        self.streamer.mark_sent();
        self.acknowledge_instruction();
        if std::mem::take(&mut self.probing.is_resumed_tap) {
            self.restart_without_cutters();
        }
        Ok(())
    }
}

pub(super) fn fault(number: &'static str, cause: &str, remedy: &str) -> CardError {
    CardError::Fault { number, cause: cause.into(), remedy: remedy.into() }
}
