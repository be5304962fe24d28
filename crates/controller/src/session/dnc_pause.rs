//! The DNC pause: the operator's steps away from a breakpoint and back to it (DNC-1 … DNC-8).
//!
//! Invariant: the permitted order of the steps is decided by `core::interruption` alone. The program's path is left, by
//! an epoch of its own, only after the breakpoint is latched, and is resumed only at the latched counts.

use std::thread;
use std::time::Duration;

use retrace_core::interruption::{
    Breakpoint, InterruptionAction, InterruptionError, InterruptionEvent as Said, SpindleDirection, SpindleState,
};
use retrace_core::mode::{Mode, ModeCommand, ModeOutput};
use retrace_core::{Flags as RecordFlags, Place, Rate, RateTarget};
use retrace_link::{CardStatus, HostCommand, MotionCard, OutputChange, PathStart, channel};

use super::pause_state::{MAX_PENDING_COMMANDS, ManualMovePurpose, PausedAxis};
use super::{Outcome, Session};
use crate::dnc_events::{AxisCounts, DncEvent, DncFlags, DncStep};
use crate::event::{CardError, EventKind};
use crate::jog_planner::{JogPlanner, JogRequest};
use crate::jog_speed::JogSpeed;
use crate::manual_move::{ManualMove, ManualMoveEnd, REPORT_LATENCY_PERIODS};
use crate::operator::{CommandError, OperatorCommand};
use crate::telemetry::{PeriodRecord, Telemetry};

impl<'r, const A: usize, C: MotionCard<A>> Session<'r, A, C> {
    /// Enables manual moves in a pause. `program` identifies the program that is run.
    #[must_use]
    pub fn with_manual_moves(self, hand: JogPlanner<'r, A>, program: u64) -> Self {
        Self { dnc: self.dnc.with_jog_planner(hand, program), ..self }
    }

    /// Applies a command while a program is paused or about to be. `None` for commands that a pause does not change.
    pub(super) fn apply_command_in_pause(&mut self, command: OperatorCommand) -> Option<Result<(), CommandError>> {
        let steps = matches!(
            command,
            OperatorCommand::Pause
                | OperatorCommand::SpindleStop
                | OperatorCommand::SpindleStart
                | OperatorCommand::Jog { .. }
                | OperatorCommand::Online
                | OperatorCommand::ToolLength(_)
                | OperatorCommand::Park
                | OperatorCommand::Pointer
                | OperatorCommand::ChangeDone
        );
        if steps || self.dnc.is_on() && matches!(command, OperatorCommand::CycleStart | OperatorCommand::Resume) {
            return Some(self.apply_pause_command(command));
        }
        if !self.dnc.is_on() {
            return None;
        }
        match command {
            OperatorCommand::Hold => {
                self.halt_manual_move();
                Some(Ok(()))
            }
            OperatorCommand::Stop => {
                self.halt_manual_move();
                None
            }
            OperatorCommand::Override(_)
            | OperatorCommand::RapidOverride(_)
            | OperatorCommand::SpeedOverride(_)
            | OperatorCommand::Output { .. }
            | OperatorCommand::CutterOff
            | OperatorCommand::TestPulse
            | OperatorCommand::OptionalStop(_) => None,
            _ => Some(Err(CommandError::NotNow("the program is paused: resume it first"))),
        }
    }

    /// Applies a step of the pause sequence. It waits where the machine is not at rest yet.
    fn apply_pause_command(&mut self, command: OperatorCommand) -> Result<(), CommandError> {
        if command == OperatorCommand::Pause {
            return self.pause();
        }
        if matches!(command, OperatorCommand::Park | OperatorCommand::Pointer) {
            if command == OperatorCommand::Park { self.require_park_position() } else { self.require_pointer() }?;
            if !self.dnc.is_on() {
                self.pause()?;
            }
        }
        if self.commands_wait() && !self.dnc.interruption.is_inhibited() {
            if self.dnc.pending_commands.len() == MAX_PENDING_COMMANDS {
                return Err(CommandError::NotNow("too many commands are waiting for the machine to come to rest"));
            }
            self.dnc.pending_commands.push_back(command);
            return Ok(());
        }
        self.perform_step(command)
    }

    fn pause(&mut self) -> Result<(), CommandError> {
        if self.dnc.pausing {
            return Err(InterruptionError::AlreadyPaused.into());
        }
        let Some(&latch) = self.dnc.interruption.breakpoint() else {
            (self.dnc.pausing, self.dnc.rest_periods) = (true, 0);
            return Ok(());
        };
        self.dnc.interruption.apply(Said::Pause(latch))?;
        self.dnc.identifying = false;
        if let Some((trip, _)) = &mut self.dnc.manual_move {
            trip.stop();
        }
        self.emit_paused(&latch);
        Ok(())
    }

    /// Brings the axes to rest, whatever moves them.
    fn halt_manual_move(&mut self) {
        if self.dnc.interruption.is_inhibited() {
            // The return ends as by *pause*, which is never rejected during it.
            let _ = self.pause();
        } else if let Some((trip, _)) = &mut self.dnc.manual_move {
            trip.stop();
        }
    }

    /// Executes a step.
    pub(super) fn perform_step(&mut self, command: OperatorCommand) -> Result<(), CommandError> {
        match command {
            OperatorCommand::Jog { axis, mm } => return self.jog(axis, mm),
            OperatorCommand::ToolLength(length) => return self.propose_tool_length(length),
            OperatorCommand::Park => return self.move_to_park(),
            OperatorCommand::Pointer => return self.move_pointer(),
            OperatorCommand::ChangeDone => return self.finish_change(),
            OperatorCommand::Online if self.spindle_is_a_cutter() => self.arm_cutter(),
            _ => {}
        }
        let (before, event) = (self.dnc.interruption, self.dnc.event_of(command));
        match self.dnc.interruption.apply(event)? {
            InterruptionAction::StopSpindle => {
                self.dnc.cutter_is_armed = false;
                self.switch_manually(channel::SPINDLE, 0);
                self.emit_dnc_step(DncStep::SpindleStopped);
            }
            InterruptionAction::StartSpindle(turning) => {
                let spindle = sign(turning.direction);
                let step = DncStep::SpindleStarted { spindle, speed: turning.speed };
                if self.spindle_is_a_cutter() {
                    // A cutter is never lit away from the kerf (DNC-9).
                    self.dnc.cutter_is_armed = true;
                    self.emit_dnc_step(step);
                } else {
                    self.emit_dnc_step(step);
                    self.start_spindle(spindle, turning.speed);
                }
            }
            InterruptionAction::Online => self.emit_dnc_step(DncStep::Online),
            InterruptionAction::Approach(_) => {
                // Not before it is known which program would be read.
                self.dnc.interruption = before;
                let hand = self.dnc.jog_planner.as_mut().ok_or(NO_HAND)?;
                hand.request(JogRequest::Identify);
                self.dnc.identifying = true;
            }
            InterruptionAction::Halt | InterruptionAction::Jog | InterruptionAction::ResumeReading => {}
        }
        Ok(())
    }

    /// Starts the spindle as it ran before, by the instructions that started it and with their delays.
    fn start_spindle(&mut self, spindle: i32, speed: u32) {
        let mut wants = self.card.status().outputs;
        wants[usize::from(channel::SPEED)] = i32::try_from(speed).unwrap_or(i32::MAX);
        wants[usize::from(channel::SPINDLE)] = spindle;
        self.begin_restart_to(&wants, |channel| matches!(channel, channel::SPEED | channel::SPINDLE));
    }

    /// Whether M3 lights a torch, a jet or a beam on this machine.
    pub(super) fn spindle_is_a_cutter(&self) -> bool {
        self.config.fire_channels.contains(&channel::SPINDLE)
    }

    fn switch_manually(&mut self, channel: u8, value: i32) {
        // A card accepts every channel that the protocol can name.
        self.send_manual_output(OutputChange { channel, value });
    }

    fn jog(&mut self, letter: char, mm: f64) -> Result<(), CommandError> {
        let found = self.dnc.axes.iter().position(|axis| axis.letter == letter);
        let mut trial = self.dnc.interruption;
        trial.apply(Said::Jog)?;
        let index = found.ok_or(CommandError::NoAxis(letter))?;
        let PausedAxis { pulses_per_mm, soft_limits: [low, high], .. } = self.dnc.axes[index];
        let counts = self.card.status().counts;
        let from = counts[index];
        // From beyond a limit, a move back is permitted.
        let wanted = from.saturating_add((mm * pulses_per_mm).round() as i64);
        let to = wanted.clamp(low.min(from), high.max(from));
        if to == from && wanted != from {
            return Err(CommandError::BeyondLimit(letter));
        }
        let mut end = counts;
        end[index] = to;
        let aim = ManualMovePurpose::Jog { axis: index, from, to, cut_short: to != wanted };
        self.begin_manual_move(JogRequest::Straight { from: counts, to: end, speed: JogSpeed::Full }, aim)
    }

    pub(super) fn begin_manual_move(
        &mut self,
        request: JogRequest<A>,
        aim: ManualMovePurpose<A>,
    ) -> Result<(), CommandError> {
        let executed = self.dnc.path_start.map_or(self.card.status().executed, |left| left.executed);
        let hand = self.dnc.jog_planner.as_mut().ok_or(NO_HAND)?;
        let trip =
            ManualMove::begin(hand, request, executed, self.config.look_ahead_records, self.config.run_mode.wall_time);
        self.dnc.manual_move = Some((trip, aim));
        self.switch_pointer(false);
        Ok(())
    }

    /// Advances an operation of the pause. Called before every control period.
    pub(super) fn watch_pause(&mut self) -> Result<(), CardError> {
        if self.dnc.pausing {
            self.watch_pausing()?;
        }
        if self.dnc.identifying {
            self.watch_identifying();
        }
        self.watch_tool_length();
        self.watch_manual_move()?;
        while !self.commands_wait()
            && let Some(command) = self.dnc.pending_commands.pop_front()
        {
            if let Err(why) = self.perform_step(command) {
                self.emit(EventKind::CommandRejected(why));
            }
        }
        Ok(())
    }

    /// Whether an operation is in progress that the operator's commands have to wait for.
    fn commands_wait(&self) -> bool {
        self.dnc.is_busy() || self.restart.is_active() || self.tool_length.is_open()
    }

    /// Latches the breakpoint once the machine is at rest with no instruction pending (DNC-1, DNC-2).
    fn watch_pausing(&mut self) -> Result<(), CardError> {
        let status = *self.card.status();
        // Nor in a thread that was entered before the card has reported it: no axis leaves one.
        let is_on_path = !self.is_lifting() && self.due_lift().is_none() && !self.is_engaged();
        let stands = status.at_rest && self.executing.is_none() && is_on_path;
        self.dnc.rest_periods = if stands { self.dnc.rest_periods + 1 } else { 0 };
        if self.dnc.rest_periods <= if self.config.run_mode.wall_time { REPORT_LATENCY_PERIODS } else { 1 } {
            return Ok(());
        }
        // A cutter went out when the machine came to rest: the outputs to return to are those the program expects.
        let outputs = if self.spindle_is_a_cutter() { self.streamer.expected() } else { &status.outputs };
        let (way, speed) = (outputs[usize::from(channel::SPINDLE)], outputs[usize::from(channel::SPEED)]);
        let direction = if way < 0 { SpindleDirection::Counterclockwise } else { SpindleDirection::Clockwise };
        let spindle = (way != 0).then_some(SpindleState { direction, speed: speed.unsigned_abs() });
        let latch = Breakpoint { program: self.dnc.program, counts: status.counts, spindle };
        self.dnc.pausing = false;
        // Nothing is paused yet: this is not rejected.
        if self.dnc.interruption.apply(Said::Pause(latch)).is_ok() {
            self.emit_paused(&latch);
            let here = self.path_start();
            if let Some(hand) = self.dnc.jog_planner.as_mut().filter(|_| status.layer != 0) {
                // The layer becomes part of the counts. The tool returns to its path before the program goes on, and
                // senses the sheet again.
                let off_path = PathStart { executed: status.executed, ..PathStart::at(hand.ring.write()) };
                self.card.begin_path(off_path)?;
                self.dnc.path_start.get_or_insert(here);
                self.target = None;
            }
        }
        Ok(())
    }

    /// Begins the return once it is known which program would be read (DNC-6).
    fn watch_identifying(&mut self) {
        let Some(hand) = &self.dnc.jog_planner else { return };
        // In virtual time the result must not depend on how long that takes.
        while !self.config.run_mode.wall_time && !hand.is_done() {
            thread::sleep(Duration::from_micros(20));
        }
        if !hand.is_done() {
            return;
        }
        let program = hand.program();
        self.dnc.identifying = false;
        if let Err(why) = self.approach(program) {
            self.emit(EventKind::CommandRejected(why));
        }
    }

    fn approach(&mut self, program: u64) -> Result<(), CommandError> {
        let before = self.dnc.interruption;
        let mut after = before;
        let InterruptionAction::Approach(to) = after.apply(Said::CycleStart { program })? else { return Ok(()) };
        let from = self.card.status().counts;
        let beyond = self.dnc.axes.iter().zip(from.iter().zip(&to)).find(|(axis, (from, to))| {
            let [low, high] = axis.soft_limits;
            from != to && !(low..=high).contains(*to)
        });
        if let Some((axis, _)) = beyond {
            return Err(CommandError::BeyondLimit(axis.letter));
        }
        self.begin_manual_move(JogRequest::Approach { from, to }, ManualMovePurpose::Approach(before))?;
        self.dnc.interruption = after;
        self.emit_dnc_step(DncStep::Approaching);
        Ok(())
    }

    fn watch_manual_move(&mut self) -> Result<(), CardError> {
        let here = self.path_start();
        let Some((trip, aim)) = &mut self.dnc.manual_move else { return Ok(()) };
        let Some(hand) = &mut self.dnc.jog_planner else { return Ok(()) };
        let ended = trip.advance(hand, &mut self.card)?;
        if trip.is_off_path() {
            self.dnc.path_start.get_or_insert(here);
            self.target = None;
        }
        let Some(ended) = ended else { return Ok(()) };
        let aim = *aim;
        self.dnc.manual_move = None;
        match aim {
            ManualMovePurpose::Jog { .. } | ManualMovePurpose::Park | ManualMovePurpose::Pointer
                if ended == ManualMoveEnd::NotPlanned =>
            {
                self.emit(EventKind::CommandRejected(NOT_PLANNED))
            }
            ManualMovePurpose::Jog { axis, from, to, cut_short } => self.emit_jogged(axis, from, to, cut_short),
            ManualMovePurpose::Park => {
                self.emit_dnc_step(DncStep::Parked { stopped: ended == ManualMoveEnd::Stopped });
            }
            ManualMovePurpose::Pointer => self.pointer_arrives(ended == ManualMoveEnd::Stopped),
            ManualMovePurpose::Approach(before) if ended == ManualMoveEnd::NotPlanned => {
                self.dnc.interruption = before;
                self.emit(EventKind::CommandRejected(NOT_PLANNED));
            }
            // *Pause* has reported that already.
            ManualMovePurpose::Approach(_) if ended == ManualMoveEnd::Stopped => {}
            ManualMovePurpose::Approach(_) => self.rejoin_path()?,
        }
        Ok(())
    }

    /// The axes are back: the program's path is resumed where it was left (DNC-7, DNC-8).
    fn rejoin_path(&mut self) -> Result<(), CardError> {
        let counts = self.card.status().counts;
        if let Err(why) = self.dnc.interruption.apply(Said::Arrived(counts)) {
            self.emit(EventKind::CommandRejected(why.into()));
            let _ = self.pause();
            return Ok(());
        }
        let line = self.dnc_line();
        if let Some(start) = self.dnc.path_start.take() {
            self.begin_program_path(start)?;
            let _ = self.card.send(HostCommand::Replay { on: self.config.replays_outputs });
        }
        self.target = None;
        let flags = DncFlags::from_interruption(&self.dnc.interruption);
        self.emit_at(line, EventKind::Dnc(DncEvent { step: DncStep::Arrived, flags }));
        // Cycle start confirms the resumption; of outputs that differ, a cutter that was armed is confirmed as well.
        let agreed = std::mem::take(&mut self.dnc.cutter_is_armed) && self.only_cutters_differ();
        let _ = self.mode_controller.apply(if self.is_cut_to_be_recovered() {
            // Where the cut ended, and not here, it is to be continued: that takes a word of its own.
            ModeCommand::Hold
        } else {
            ModeCommand::Restart { confirmed: agreed }
        });
        Ok(())
    }

    /// Whether all outputs except the cutters are as the program expects them.
    fn only_cutters_differ(&self) -> bool {
        let want = self.streamer.expected();
        let are = self.outputs_compared_with(want);
        (0..channel::COUNT).all(|at| are[at] == want[at] || self.config.fire_channels.contains(&(at as u8)))
    }

    /// Position on the program's path, from which it is resumed. The machine is at rest.
    pub(super) fn path_start(&self) -> PathStart {
        let CardStatus { place, reached, executed, .. } = *self.card.status();
        let before = self.streamer.record(place.record - 1);
        let rests = place.fraction == 0 && before.is_some_and(|record| record.flags.contains(RecordFlags::REST));
        PathStart { place, rests, reached, executed, keeps_state: true }
    }

    /// Mode output at a breakpoint: no motion and no restoring of outputs.
    pub(super) fn paused_output(&self) -> ModeOutput {
        let look_ahead = self.mode_controller.mode() == Mode::Run;
        ModeOutput { target: RateTarget::ZERO, look_ahead, restore_outputs: false, notice: None }
    }

    /// Runs a control period off the program's path.
    pub(super) fn run_paused_period(&mut self) -> Result<Option<Outcome>, CardError> {
        self.apply_commands();
        self.advance_restart();
        // The operator may change the consumables, or lay the sheet anew.
        self.recorded_layers.forget();
        let status = *self.card.run_period()?;
        if let Some(off) = status.cutter_off {
            self.cutter_went_off(off);
        }
        self.account_off_path_period(&status);
        self.still_periods =
            if status.rate == Rate::ZERO && !self.dnc.is_moving() { self.still_periods + 1 } else { 0 };
        if let Some(outcome) = self.alarm(&status) {
            return Ok(Some(outcome));
        }
        let is_over = self.phase.is_stopping() || self.is_abandoned();
        Ok((is_over && status.at_rest && !self.dnc.is_moving()).then_some(Outcome::Stopped))
    }

    /// Counts and reports a control period off the program's path.
    pub(super) fn account_off_path_period(&mut self, status: &CardStatus<A>) {
        self.stats.count_paused();
        self.report_off_path_period(status);
    }

    /// Reports a control period off the program's path.
    pub(super) fn report_off_path_period(&mut self, status: &CardStatus<A>) {
        self.watch_cutter_states(status);
        self.watch_test_pulse(status);
        self.update_manual_outputs(status);
        self.telemetry.send_output_changes(&status.outputs);
        let period = PeriodRecord {
            mode: self.mode_controller.mode(),
            hold_reason: self.hold_reason(),
            override_rate: self.overrides.requested(),
            rapid_override: self.mode_controller.rapid_override(),
            off_path: true,
            is_probing: self.probing.is_probing_move(),
            ..PeriodRecord::from_status(status)
        };
        self.telemetry.send(Telemetry::Period(period));
    }

    pub(super) fn emit_dnc_step(&mut self, step: DncStep) {
        let flags = DncFlags::from_interruption(&self.dnc.interruption);
        let line = self.dnc_line();
        self.emit_at(line, EventKind::Dnc(DncEvent { step, flags }));
    }

    /// Program line of the breakpoint. Off the path, the card reports none.
    fn dnc_line(&self) -> u32 {
        let status = self.card.status();
        let left = self.dnc.path_start.map(|left| left.place);
        let record = left.and_then(|Place { record, .. }| self.streamer.record(record));
        record.map_or(status.line, |record| record.line)
    }

    fn emit_paused(&mut self, latch: &Breakpoint<A>) {
        let (spindle, speed) = latch.spindle.map_or((0, 0), |turning| (sign(turning.direction), turning.speed));
        let counts = AxisCounts::new(&latch.counts, self.dnc.axes.len());
        self.emit_dnc_step(DncStep::Paused { counts, spindle, speed });
    }

    fn emit_jogged(&mut self, index: usize, from: i64, to: i64, cut_short: bool) {
        let PausedAxis { letter, pulses_per_mm, .. } = self.dnc.axes[index];
        let counts = self.card.status().counts;
        let mut off = counts;
        if let Some(latch) = self.dnc.interruption.breakpoint() {
            off.iter_mut().zip(&latch.counts).for_each(|(off, &latched)| *off -= latched);
        }
        let step = DncStep::Jogged {
            axis: letter,
            mm: (counts[index] - from) as f64 / pulses_per_mm,
            cut_short: cut_short || counts[index] != to,
            off: AxisCounts::new(&off, self.dnc.axes.len()),
        };
        self.emit_dnc_step(step);
    }
}

const NO_HAND: CommandError = CommandError::NotNow("manual moves are not available here");
const NOT_PLANNED: CommandError = CommandError::NotNow("the manual move cannot be planned");

fn sign(direction: SpindleDirection) -> i32 {
    match direction {
        SpindleDirection::Clockwise => 1,
        SpindleDirection::Counterclockwise => -1,
    }
}
