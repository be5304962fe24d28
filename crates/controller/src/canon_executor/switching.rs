//! Canonical functions that switch, wait or stop.
//!
//! Invariant: an unsupported function is rejected by name; the compiler demands a rule here for a new canonical
//! function.

use retrace_config::{CodeClass, CodeSwitching, InReverse, ToolChange};
use retrace_gcode::{Canon, CuttingSwitch};
use retrace_link::{LayerMove, OutputChange, channel};

use super::{CanonError, CanonExecutor};
use crate::motion_sink::MotionSink;
use crate::plan_item::ExclusiveKind;
use crate::plan_writer::SwitchInstruction;

/// What the start of a cutter has besides its switching.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct CutStart {
    /// Moves of the layer: now, and at a restart.
    pub(super) layer: Option<[LayerMove; 2]>,
    /// Control periods by which the pierce of a restart is longer.
    pub(super) restart_pierce: u32,
    /// Width in µm of the kerf that it begins; 0 where the height is not controlled in it.
    pub(super) kerf_um: Option<u32>,
}

impl<'m> CanonExecutor<'m> {
    pub(super) fn switching<const A: usize>(
        &mut self,
        canon: &Canon,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        match canon {
            Canon::StartSpindleClockwise(spindle) => self.spindle("M3", *spindle, 1, line, sink),
            Canon::StartSpindleCounterclockwise(spindle) => self.spindle("M4", *spindle, -1, line, sink),
            Canon::StopSpindleTurning(spindle) => self.spindle("M5", *spindle, 0, line, sink),
            Canon::SetCutting(CuttingSwitch::Cutter, allowed) => {
                self.allow_cutter(*allowed, line, sink);
                Ok(())
            }
            Canon::SetCutting(CuttingSwitch::IgnoreArcOk, ignored) => self.ignore_proof(*ignored, line, sink),
            Canon::SetCutting(CuttingSwitch::HeightControl, allowed) => self.hold_height(!*allowed, line, sink),
            Canon::SelectMaterial(material) => {
                self.material = Some(self.pierced_material(material));
                Ok(())
            }
            Canon::MistOn => self.switch("M7", channel::MIST, 1, line, sink),
            Canon::FloodOn => self.switch("M8", channel::FLOOD, 1, line, sink),
            Canon::MistOff => self.switch("M9", channel::MIST, 0, line, sink),
            Canon::FloodOff => self.switch("M9", channel::FLOOD, 0, line, sink),
            Canon::SetSpindleSpeed(speed) if let Some(of) = self.surface_speed => {
                self.set_surface_speed(*speed, of, line, sink)
            }
            // unknown values of a check
            Canon::SetSpindleSpeed(rpm) if rpm.is_nan() => self.change_state(|t| t.set_rpm(f64::NAN)),
            Canon::Dwell(seconds) if seconds.is_nan() => Ok(()),
            Canon::SetSpindleSpeed(rpm) => {
                self.set_rpm(*rpm);
                self.note_spindle_change(channel::SPEED);
                let thousandths = (rpm * 1000.0).clamp(0.0, f64::from(i32::MAX)).round() as i32;
                self.set_speed("S", thousandths, line, sink)
            }
            Canon::SelectTool(tool) => {
                self.selected_tool = *tool;
                self.exclusive(("T", line), &[], self.machine.switching.code("T"), CutStart::default(), sink)
            }
            Canon::ChangeTool { tool, was, comment: remark, .. } => {
                if tool != was {
                    self.forget_entered_length();
                }
                if self.machine.is_on_head(*tool) && self.machine.is_on_head(*was) {
                    // Both tools are on the head: nobody has to change anything, and it is no barrier to reverse run.
                    sink.lasting_action(OutputChange { channel: channel::TOOL, value: *tool as i32 }, line);
                    return Ok(());
                }
                self.return_layer(line, sink)?;
                self.change_tool(*tool, remark.as_deref(), line, sink)
            }
            Canon::SetMotionOutputBit(n) => self.switch_output("M62", digital(*n, 1)?, line, sink),
            Canon::ClearMotionOutputBit(n) => self.switch_output("M63", digital(*n, 0)?, line, sink),
            Canon::SetAuxOutputBit(n) => self.switch_output("M64", digital(*n, 1)?, line, sink),
            Canon::ClearAuxOutputBit(n) => self.switch_output("M65", digital(*n, 0)?, line, sink),
            Canon::Dwell(seconds) => {
                self.cutters.before_dwell(self.machine, *seconds)?;
                self.dwell(*seconds, "G4", line, sink)
            }
            Canon::ProgramStop => {
                // Somebody may lay another sheet.
                self.sensed_at = None;
                let stop = SwitchInstruction {
                    line,
                    kind: ExclusiveKind::ProgramStop,
                    code: "M0",
                    ..SwitchInstruction::default()
                };
                Ok(sink.exclusive(stop)?)
            }
            Canon::OptionalProgramStop => {
                let stop = SwitchInstruction {
                    line,
                    kind: ExclusiveKind::OptionalStop,
                    code: "M1",
                    ..SwitchInstruction::default()
                };
                Ok(sink.exclusive(stop)?)
            }
            // no pallet to move
            Canon::PalletShuttle => Ok(()),
            Canon::SetSpindleMode(highest_rpm) => self.set_spindle_mode(*highest_rpm),
            // Geared motion is collected elsewhere; this is one with unknown values, of a check.
            Canon::StartSpeedFeedSynch { .. } | Canon::RigidTap { .. } => Ok(()),
            Canon::OrientSpindle { degrees, timeout_s, .. } => self.orient_spindle(*degrees, *timeout_s, line, sink),
            // Part of the function before it.
            Canon::WaitSpindleOrientComplete(_) => Ok(()),
            Canon::Wait(wait) => self.read_input(wait, line, sink),
            Canon::SetMotionOutputValue { output, value } => self.set_value("M67", *output, *value, line, sink),
            Canon::SetAuxOutputValue { output, value } => self.set_value("M68", *output, *value, line, sink),
            Canon::EnableFeedOverride | Canon::DisableFeedOverride => {
                self.feed_override.program(*canon == Canon::EnableFeedOverride);
                Ok(())
            }
            Canon::UserCode { number, .. } => self.user_code(*number, line, sink),
            // none of these moves or switches anything on this machine
            Canon::OnReset
            | Canon::Finish
            | Canon::SetFeedMode(_)
            | Canon::SelectPlane(_)
            | Canon::SetFeedReference
            | Canon::StopSpeedFeedSynch
            | Canon::StartChange
            | Canon::ChangeToolNumber { .. }
            | Canon::EnableSpeedOverride
            | Canon::DisableSpeedOverride
            | Canon::EnableAdaptiveFeed
            | Canon::DisableAdaptiveFeed
            | Canon::EnableFeedHold
            | Canon::DisableFeedHold
            | Canon::Comment(_)
            | Canon::Note(_)
            | Canon::TurnProbeOn
            | Canon::TurnProbeOff
            | Canon::SetToolTableEntry { .. }
            | Canon::ReloadToolData
            | Canon::SetPierceValue { .. }
            | Canon::LogOpen { .. }
            | Canon::Log(_)
            | Canon::LogClose => Ok(()),
            Canon::ProgramEnd => {
                self.ignore_proof(false, line, sink)?;
                self.hold_height(false, line, sink)?;
                self.return_layer(line, sink)
            }
            // `run` handles these; the compiler demands a rule here for a new canonical function
            Canon::StraightTraverse(_)
            | Canon::StraightFeed(_)
            | Canon::ArcFeed(_)
            | Canon::NurbsFeed(_)
            | Canon::StraightProbe(..)
            | Canon::UnknownMotion(_)
            | Canon::FollowBranch(_)
            | Canon::UseLengthUnits(_)
            | Canon::SetG5xOffset { .. }
            | Canon::SetG92Offset(_)
            | Canon::UseToolLengthOffset(_)
            | Canon::MachineCoordinates
            | Canon::SetXyRotation(_)
            | Canon::SetFeedRate(_)
            | Canon::SetMotionControlMode(_)
            | Canon::SetNaivecamTolerance(_)
            | Canon::Message(_)
            | Canon::Print(_) => Ok(()),
        }
    }

    /// S: the speed of the spindle, or the power of a beam, which changes in passing while the beam is on (CUT-20).
    pub(super) fn set_speed<const A: usize>(
        &mut self,
        code: &'static str,
        value: i32,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let beam = self.machine.powered_beam().filter(|beam| self.cutters.is_lit(self.machine, beam.fire));
        if beam.is_some() {
            if self.cutters.record_power(value) {
                sink.action(OutputChange { channel: channel::SPEED, value }, line);
            }
            return Ok(());
        }
        self.switch(code, channel::SPEED, value, line, sink)
    }

    /// M67 and M68: the power of a beam, if the machine file names the output for it; otherwise an analog output.
    fn set_value<const A: usize>(
        &mut self,
        code: &'static str,
        index: i32,
        value: f64,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let power = self.machine.powered_beam().and_then(|beam| beam.power?.analog);
        if power.is_none_or(|number| i32::from(number) != index) {
            return self.set_analog_output(code, index, value, line, sink);
        }
        let thousandths = (value * 1000.0).clamp(0.0, f64::from(i32::MAX)).round() as i32;
        match code {
            "M67" => self.set_speed(code, thousandths, line, sink),
            _ => self.switch(code, channel::SPEED, thousandths, line, sink),
        }
    }

    /// M3, M4 and M5 of a spindle or cutter. One that is forbidden (M62 P3) is not lit.
    fn spindle<const A: usize>(
        &mut self,
        code: &'static str,
        spindle: u8,
        value: i32,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let Some(channel) = self.machine.spindle_channel(spindle) else {
            return Err(CanonError::NotSupported("a spindle that the machine file does not declare"));
        };
        let cuts = self.machine.cutter_of(channel).is_some_and(|cutter| cutter.kind.cuts_at_rest());
        if value != 0 && cuts && self.is_cutter_forbidden {
            return Ok(());
        }
        if value != 0 && cuts {
            // Not behind the pierce, where the cutter burns at rest.
            self.switch_feed_override(line, sink)?;
        }
        let pause_s = self.material.as_ref().map_or(0.0, |material| material.pause_at_end_s);
        if value == 0 && cuts && pause_s > 0.0 && self.cutters.is_lit(self.machine, channel) {
            self.dwell(pause_s, code, line, sink)?;
        }
        self.spindle_turns = Some(value != 0);
        if channel == channel::SPINDLE {
            self.note_spindle_change(channel);
            self.release_spindle((code, line), sink)?;
            return self.switch(code, channel, value, line, sink);
        }
        // The machine file describes the spindle's own output as M3; another output is switched as M64 and M65 do it.
        let switching = self.machine.switching.code(if value == 0 { "M65" } else { "M64" });
        self.execute_change(code, OutputChange { channel, value: value.abs() }, switching, line, sink)
    }

    /// Arms a marker before it is switched on, or disarms it behind its switching off (CUT-21).
    fn arm_marker<const A: usize>(
        &self,
        of: (&'static str, u32),
        change: OutputChange,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let Some(cutter) = self.machine.cutter_of(change.channel) else { return Ok(()) };
        let (Some(marker), Some(arm)) = (cutter.marker, cutter.arm) else { return Ok(()) };
        let value = i32::from(change.value != 0);
        let seconds = if value == 0 { 0.0 } else { marker.arm_ms / 1000.0 };
        self.switch_auxiliary(of, OutputChange { channel: arm, value }, seconds, sink)
    }

    pub(super) fn switch_auxiliary<const A: usize>(
        &self,
        of: (&'static str, u32),
        change: OutputChange,
        seconds: f64,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let seconds = if self.machine.skips_waits() { 0.0 } else { seconds };
        let switching = CodeSwitching { periods: self.periods(seconds), ..self.machine.switching.code("M64") };
        self.exclusive(of, &[change], switching, CutStart::default(), sink)
    }

    /// Duration in control periods.
    pub(super) fn periods(&self, seconds: f64) -> u32 {
        (seconds / self.machine.period_s()).ceil().clamp(0.0, f64::from(u32::MAX)) as u32
    }

    fn dwell<const A: usize>(
        &self,
        seconds: f64,
        code: &'static str,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        if self.machine.skips_waits() && self.cutters.is_any_lit() {
            return Ok(());
        }
        let (kind, periods) = (ExclusiveKind::Dwell, self.periods(seconds));
        Ok(sink.exclusive(SwitchInstruction { line, kind, code, periods, ..SwitchInstruction::default() })?)
    }

    /// M62 P3 to M65 P3 with a material table: a forbidden cutter goes off in passing. Allowed again, it stays off
    /// until the next M3.
    fn allow_cutter<const A: usize>(&mut self, allowed: bool, line: u32, sink: &mut impl MotionSink<A>) {
        self.is_cutter_forbidden = !allowed;
        if allowed {
            return;
        }
        let machine = self.machine;
        for cutter in machine.cutters.iter().filter(|cutter| cutter.kind.cuts_at_rest()) {
            let change = OutputChange { channel: cutter.fire, value: 0 };
            if self.cutters.is_lit(machine, cutter.fire) {
                self.cutters.record_switching(machine, &[change]);
                sink.action(change, line);
            }
        }
    }

    /// M62 P1 to M65 P1 with a material table: the input of `ok` is ignored from here on. With a cutter on, that begins
    /// and ends in passing.
    fn ignore_proof<const A: usize>(
        &mut self,
        ignored: bool,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let has_proof = self.machine.cutters.iter().any(|cutter| cutter.proof.is_some());
        if !has_proof || std::mem::replace(&mut self.is_proof_ignored, ignored) == ignored {
            return Ok(());
        }
        self.switch_in_passing(OutputChange { channel: channel::UNWATCHED, value: i32::from(ignored) }, line, sink)
    }

    /// M62 P2 to M65 P2 with height control: the height stays from here on. With a cutter on, that begins and ends in
    /// passing.
    fn hold_height<const A: usize>(
        &mut self,
        held: bool,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let is_controlled = self.machine.height_control().is_some();
        if !is_controlled || std::mem::replace(&mut self.is_height_held, held) == held {
            return Ok(());
        }
        let change = OutputChange { channel: channel::HEIGHT_HOLD, value: i32::from(held) };
        self.switch_in_passing(change, line, sink)
    }

    /// Switches what belongs to a cut: without a stop while a cutter is on.
    fn switch_in_passing<const A: usize>(
        &mut self,
        change: OutputChange,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        if self.cutters.is_any_lit() {
            sink.action(change, line);
            return Ok(());
        }
        let code = if change.value != 0 { "M64" } else { "M65" };
        let switching = CodeSwitching { in_reverse: InReverse::Undone, ..CodeSwitching::AT_REST };
        self.exclusive((code, line), &[change], switching, CutStart::default(), sink)
    }

    /// M6. Where the operator changes the tool, its number is shown where the motion stops.
    fn change_tool<const A: usize>(
        &mut self,
        tool: u32,
        remark: Option<&str>,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let change = OutputChange { channel: channel::TOOL, value: tool as i32 };
        let CodeSwitching { periods, until, in_reverse, .. } = self.machine.switching.code("M6");
        let manual = self.machine.tool_change == ToolChange::Manual;
        if manual {
            let remark = remark.map(|remark| format!(" ({remark})")).unwrap_or_default();
            let what = if tool == 0 { "take the tool out".into() } else { format!("put in tool {tool}{remark}") };
            sink.message(format!("tool change: {what}, then cycle start"), line)?;
        }
        let kind = if manual { ExclusiveKind::ToolChange } else { ExclusiveKind::Switch };
        let one_way = in_reverse == InReverse::Barrier;
        let changes = &[change];
        Ok(sink.exclusive(SwitchInstruction {
            line,
            kind,
            code: "M6",
            changes,
            periods,
            until,
            is_barrier: one_way,
            ..SwitchInstruction::default()
        })?)
    }

    /// M100 to M199 switch the output that the machine file declares for them.
    fn user_code<const A: usize>(
        &mut self,
        number: u8,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let Some(code) = self.machine.switching.user_code(number) else {
            return Err(CanonError::NotSupported("a user code that the machine file does not declare"));
        };
        let change = OutputChange { channel: code.output, value: code.value };
        self.execute_change(code.name, change, code.switching, line, sink)
    }

    /// Switches one output, synchronously or at rest, as the machine file declares for `code`.
    fn switch<const A: usize>(
        &mut self,
        code: &'static str,
        channel: u8,
        value: i32,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        self.execute_change(code, OutputChange { channel, value }, self.machine.switching.code(code), line, sink)
    }

    /// Switches a digital output by M62 … M65.
    fn switch_output<const A: usize>(
        &mut self,
        code: &'static str,
        change: OutputChange,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let enable = self.machine.height_control().and_then(|control| control.config().enable);
        if enable == Some(change.channel) {
            // Outside of a cut another controller would move the tool axis.
            return Err(CanonError::NotSupported(
                "switching the output that enables a height controller, which only the card does,",
            ));
        }
        self.execute_change(code, change, self.machine.switching.code(code), line, sink)
    }

    fn execute_change<const A: usize>(
        &mut self,
        code: &'static str,
        change: OutputChange,
        switching: CodeSwitching,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let in_motion = change.value != 0 && self.pierces_in_motion();
        let whole_pierce_s = self.material.as_ref().map(|material| material.pierce_delay_s);
        let pierce_s = if in_motion { Some(0.0) } else { whole_pierce_s };
        let (periods, until) = self.machine.cutter_switching(change, pierce_s, self.is_proof_ignored);
        if switching.class == CodeClass::Synchronous
            && change.value != 0
            && (periods > 0 || until.is_some())
            && let Some(cutter) = self.machine.cutter_of(change.channel)
        {
            // The feed would begin before the cutter is ready.
            return Err(CanonError::LitInPassing(code, cutter.name.clone()));
        }
        let was_lit = self.cutters.is_lit(self.machine, change.channel);
        if change.value == 0 && was_lit && switching.class == CodeClass::Exclusive {
            self.purge((code, line), change.channel, sink)?;
        } else if change.value != 0 && !was_lit {
            self.arm_marker((code, line), change, sink)?;
            self.prepare_jet((code, line), change.channel, sink)?;
        }
        let layer = match switching.class {
            CodeClass::Exclusive => self.layer_moves(change)?,
            CodeClass::Synchronous => None,
        };
        self.cutters.record_switching(self.machine, &[change]);
        let (periods, until) = (switching.periods.saturating_add(periods), switching.until.or(until));
        let switching = CodeSwitching { periods, until, ..switching };
        match (switching.class, switching.in_reverse) {
            (CodeClass::Synchronous, InReverse::Unchanged) => sink.lasting_action(change, line),
            (CodeClass::Synchronous, _) => sink.action(change, line),
            (CodeClass::Exclusive, _) => {
                // A restart may pierce anywhere, at rest.
                let pierces = in_motion && !was_lit && !self.machine.skips_waits();
                let restart_s = whole_pierce_s.filter(|_| pierces && !self.abrasive_follows(change.channel));
                let restart_pierce = restart_s.map_or(0, |seconds| self.periods(seconds));
                let kerf_um = (change.value != 0 && !was_lit && layer.is_some()).then(|| self.kerf_um());
                let start = CutStart { layer, restart_pierce, kerf_um };
                self.exclusive((code, line), &[change], switching, start, sink)?;
            }
        }
        if change.value == 0 && was_lit {
            self.lower_pressure((code, line), change.channel, sink)?;
            return self.arm_marker((code, line), change, sink);
        }
        if change.value == 0 || was_lit || switching.class == CodeClass::Synchronous {
            return Ok(());
        }
        if layer.is_some() {
            self.add_heights(line, sink);
        }
        self.start_flow((code, line), change.channel, sink)
    }

    pub(super) fn exclusive<const A: usize>(
        &self,
        (code, line): (&'static str, u32),
        changes: &[OutputChange],
        switching: CodeSwitching,
        CutStart { layer, restart_pierce, kerf_um }: CutStart,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let CodeSwitching { periods, until, in_reverse, .. } = switching;
        let [layer, restart_layer] = layer.map_or([None; 2], |[now, restart]| [Some(now), Some(restart)]);
        let (one_way, undone) = (in_reverse == InReverse::Barrier, in_reverse == InReverse::Undone);
        Ok(sink.exclusive(SwitchInstruction {
            line,
            kind: ExclusiveKind::Switch,
            code,
            changes,
            periods,
            until,
            layer,
            restart_layer,
            restart_pierce,
            kerf_um,
            is_barrier: one_way,
            undone_in_reverse: undone,
            question: None,
            spindle: None,
        })?)
    }
}

fn digital(number: i32, value: i32) -> Result<OutputChange, CanonError> {
    match u8::try_from(number) {
        Ok(n) if usize::from(n) < channel::DIGITAL => Ok(OutputChange { channel: n, value }),
        _ => Err(CanonError::NoSuchOutput(number)),
    }
}
