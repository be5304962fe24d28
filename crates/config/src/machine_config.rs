//! The machine configuration: axes, limits, period, history, switching; and the built-in machine.
//!
//! Invariant: a [`MachineConfig`] that exists is valid: every number is in its range, the plan has its reserve, and the
//! rate law fits the card.

use std::collections::BTreeMap;
use std::sync::Arc;

use retrace_core::limits::RateLimits;
use retrace_link::{HomingCommand, InputWait, OutputChange, SpindlePwm};
use retrace_motion::{Blending, MachineLimits};

use crate::analog_output_conflicts::check_analog_outputs;
use crate::axis::{self, AXIS_LETTERS, AxisConfig};
use crate::card_config::CardConfig;
use crate::channel_names::{self, ChannelNames};
use crate::cost_config::CostConfig;
use crate::cutter::{self, CutterConfig};
use crate::cutter_inputs;
use crate::height_control::HeightControlOfCutter;
use crate::machine_file::{MachineFile, OnLostControl, OutputSection, RetraceOutputs};
use crate::manual_config::{ManualConfig, Written};
use crate::material_table::MaterialTable;
use crate::numbered_error::NumberedError;
use crate::pierce_mode::PierceMode;
use crate::plan_mode::PlanMode;
use crate::probe_config::ProbeConfig;
use crate::rate_limits::{self, IN_FLIGHT_RECORDS, StoppingTimes};
use crate::serial::SerialSettings;
use crate::sheet_contacts;
use crate::sheet_sensing::ToolLayer;
use crate::spindle_config::{EncoderConfig, FeedPerTurn};
use crate::spindle_pwm_config::SPINDLE_PWM_OF_A_BEAM;
use crate::spindle_settings::SpindleConfig;
use crate::switching::SwitchingTable;
use crate::tool_change_config::{ToolChange, ToolChangeConfig};

/// A material table with the file that it was read from.
#[derive(Clone, Debug, PartialEq)]
pub struct MaterialFile {
    /// Path of the file, for messages and for the journal.
    pub path: String,
    /// Text of the file.
    pub text: String,
    /// Its materials.
    pub table: MaterialTable,
}

/// Configuration of a machine, checked.
#[derive(Clone, Debug)]
pub struct MachineConfig {
    /// Name of the machine.
    pub name: String,
    /// Axes, in the order of [`AXIS_LETTERS`].
    pub axes: Vec<AxisConfig>,
    /// Control period *T* in microseconds.
    pub period_us: u32,
    /// Maximum velocity along the path, mm/s.
    pub path_velocity_mm_s: f64,
    /// Share of acceleration and jerk that the plan leaves to the rate law.
    pub reserve: f64,
    /// Blend tolerance for G64 without P, mm.
    pub blend_tolerance_mm: f64,
    /// Method by which corners between lines are passed.
    pub blending: Blending,
    /// Number of records retained for reverse run.
    pub history_records: u32,
    /// Maximum number of records planned beyond `reached`.
    pub look_ahead_records: u32,
    /// Setup: homing, tool axis, retract plane.
    pub setting_up: ManualConfig,
    /// Behaviour of outputs while retracing.
    pub retrace_outputs: RetraceOutputs,
    /// Its cutters.
    pub cutters: Vec<CutterConfig>,
    /// Rates for the cost of a program, where the machine file has them.
    pub cost: Option<CostConfig>,
    /// The material table that a cutter names, once [`MachineConfig::with_materials`] has set it.
    pub materials: Option<Arc<MaterialFile>>,
    /// Output channels that cut: the fire channels of torches, jets and beams. Rapid retrace only while they are off.
    pub cutting_outputs: Vec<u8>,
    /// Probing.
    pub probe: ProbeConfig,
    /// Tool change: automatic or manual.
    pub tool_change: ToolChange,
    /// Change of tools by the operator: where, and whether they are measured.
    pub manual_tool_change: ToolChangeConfig,
    /// What the feed of G95 follows.
    pub feed_per_turn: FeedPerTurn,
    /// Encoder of the spindle; `None` without one.
    pub encoder: Option<EncoderConfig>,
    /// Speeds of the spindle under G96, and its orientation.
    pub spindle: SpindleConfig,
    /// What happens to a running program when the page in control loses its link.
    pub on_lost_control: OnLostControl,
    /// How the speed along the path is planned.
    pub plan_mode: PlanMode,
    /// What this run does with the pierces of its program.
    pub pierce_mode: PierceMode,
    /// Names of outputs by channel, other than those of the cutters.
    pub output_names: BTreeMap<u8, String>,
    /// Length of the handwheel's filter in periods.
    pub wheel_periods: u16,
    /// Handwheel counts in that time that give rate 1.
    pub wheel_counts: u16,
    /// Maximum length of a streamed program that is saved, bytes.
    pub stream_quota_bytes: u64,
    /// Settings of serial program sources.
    pub serial: SerialSettings,
    /// Further settings of the card.
    pub card: CardConfig,
    /// Switching by M, S and T codes.
    pub switching: SwitchingTable,
    /// Stopping times under the rate law.
    pub stopping: StoppingTimes,
    /// Whether this is a dry run: every cutter is kept off (CUT-8).
    pub inhibits_outputs: bool,
    /// Whether a dry run takes the time of what it leaves off.
    pub dry_waits: bool,
    /// Position of the axes when a job begins, mm, in the order of `axes`: that of the card's counts.
    pub stands_at_mm: Vec<f64>,
}

impl MachineConfig {
    /// Returns the machine at the position of these counts.
    #[must_use]
    pub fn standing_at(mut self, counts: &[i64]) -> Self {
        for ((mm, axis), &count) in self.stands_at_mm.iter_mut().zip(&self.axes).zip(counts) {
            *mm = axis.mm_of(count);
        }
        self
    }

    /// The file that a cutter names as its material table, relative to the machine file; `None` where no cutter has
    /// one.
    #[must_use]
    pub fn material_file(&self) -> Option<&str> {
        self.cutters.iter().find_map(|cutter| cutter.materials.as_deref())
    }

    /// Sets the text of the material table, which was read from `path`.
    ///
    /// # Errors
    /// See [`MaterialTable::parse`].
    pub fn with_materials(mut self, text: String, path: String) -> Result<Self, NumberedError> {
        let table = MaterialTable::parse(&text, &path)?;
        self.materials = Some(Arc::new(MaterialFile { path, text, table }));
        Ok(self)
    }

    /// Position at which a job begins, with `A` axes.
    #[must_use]
    pub fn start_mm<const A: usize>(&self) -> [f64; A] {
        let mut start = [0.0; A];
        for (slot, &mm) in start.iter_mut().zip(&self.stands_at_mm) {
            *slot = mm;
        }
        start
    }

    /// The built-in machine: three axes, 1 000 pulses/mm, 100 mm/s, 1 000 mm/s², 20 000 mm/s³, T = 1 ms, and a probe on
    /// input 0 that closes to ground.
    ///
    /// # Errors
    /// None in practice; the built-in machine passes the same checks as every other.
    pub fn built_in() -> Result<Self, NumberedError> {
        Self::check(MachineFile::default())
    }

    /// Parses the text of a machine file. `name` names the file in messages.
    ///
    /// # Errors
    /// `E2111` for text that is not a machine file (syntax, misspelt key, wrong type), with line, column and a
    /// suggestion; `E2112` for a number out of range.
    pub fn parse(text: &str, name: &str) -> Result<Self, NumberedError> {
        let file = MachineFile::read(text, name)?;
        Self::check(file).map_err(|r| NumberedError { cause: format!("{name}: {}", r.cause), ..r })
    }

    pub(crate) fn check(file: MachineFile) -> Result<Self, NumberedError> {
        file.ranges().into_iter().collect::<Result<(), _>>()?;
        let axes = axis::checked(file.axis)?;
        let period_us = (file.control_period_ms * 1000.0).round() as u32;
        let period_s = f64::from(period_us) * 1e-6;
        let periods = |seconds: f64| (seconds / period_s).ceil() as u32;
        let reserve = file.override_reserve_percent / 100.0;
        let limits = rate_limits::rate_limits::<9>(&axes, reserve, period_s);
        let stopping = limits.as_ref().and_then(StoppingTimes::from_limits).ok_or_else(|| {
            NumberedError::new(
                "E2113",
                "the axes brake too slowly for a control period this short: the rate law does not fit the card's \
                    memory",
                "a longer control_period_ms, a lower max_velocity_mm_per_s or a higher max_acceleration_mm_per_s2",
            )
        })?;
        cutter::no_code_starts_a_cutter(&file.cutter, file.code.keys())?;
        let cutters = cutter::checked(file.cutter, &file.cutting_outputs)?;
        let cutting_outputs = cutter::cutting_outputs(&cutters);
        let off_at_fault = cutter::off_at_fault(&cutters, file.spindle.orient_output);
        let mut card = file.card.checked(&axes, &off_at_fault, file.control_period_ms)?;
        file.cost.as_ref().map_or(Ok(()), |cost| cost.check(&cutters))?;
        cutter_inputs::proofs_are_plain_inputs(&cutters, &card)?;
        cutter_inputs::declare_collision_inputs(&cutters, &mut card)?;
        let encoder = file.spindle.checked_encoder(period_us, card.watchdog_periods)?;
        let ahead = encoder.map_or(0, |encoder| u32::from(encoder.records_ahead) + IN_FLIGHT_RECORDS);
        let probe = file.probe.checked(&mut card, &axes, reserve, period_us)?;
        let stop = stopping.look_ahead_records.max(probe.limits.stopping.look_ahead_records);
        let look_ahead = (stop + 2 * IN_FLIGHT_RECORDS).max(ahead).max(periods(file.look_ahead_s));
        let spindle = file.spindle.checked(&cutters, &card, period_us)?;
        let manual_tool_change = file.manual_tool_change.checked(file.tool_change, &probe)?;
        let output_names = output_names(file.output, &cutters)?;
        check_analog_outputs(&card.analog_outputs, &cutters, &output_names)?;
        let written = Written {
            homing: file.homing,
            manual: file.manual,
            homed: file.homed,
            tool_axis: file.tool_axis,
            retract_mm: file.retract_mm,
        };
        let setting_up = ManualConfig::checked(written, &axes, &card)?;
        if let Some(channel) = setting_up.pointer_output
            && (channel > 63 || cutter::inhibited(&cutters).contains(&channel))
        {
            let what = format!("manual.pointer_output = {channel}: not an output from 0 to 63, or a cutter's");
            return Err(NumberedError::new("E2112", what, "give the pointer an output of its own"));
        }
        sheet_contacts::declare_contacts(&cutters, &axes, setting_up.tool_axis, &mut card)?;
        cutter_inputs::check_height_inputs(&cutters, &card)?;
        let wheel_periods = (file.wheel.filter_ms / file.control_period_ms).round() as u16;
        let wheel_counts = file.wheel.full_rate_counts_per_s * f64::from(wheel_periods) * period_s;
        let machine = Self {
            name: file.name,
            period_us,
            path_velocity_mm_s: file.path_velocity_mm_per_s,
            reserve,
            blend_tolerance_mm: file.blend_tolerance_mm,
            blending: file.blending.checked()?,
            history_records: periods(file.history_hours * 3600.0),
            look_ahead_records: look_ahead,
            setting_up,
            probe,
            retrace_outputs: file.retrace_outputs,
            cutters,
            cost: file.cost,
            materials: None,
            cutting_outputs,
            tool_change: file.tool_change,
            manual_tool_change,
            feed_per_turn: file.spindle.feed_per_turn,
            encoder,
            spindle,
            on_lost_control: file.on_lost_control,
            plan_mode: file.plan,
            pierce_mode: PierceMode::Usual,
            output_names,
            card,
            stream_quota_bytes: (file.stream_quota_mib * 1_048_576.0) as u64,
            serial: file.serial.checked()?,
            wheel_periods,
            wheel_counts: wheel_counts.round().clamp(1.0, 65_535.0) as u16,
            switching: SwitchingTable::new(&file.code, period_us)?,
            stopping,
            inhibits_outputs: false,
            dry_waits: file.dry_waits,
            stands_at_mm: vec![0.0; axes.len()],
            axes,
        };
        machine.limits::<9>().validate().map_err(|e| {
            NumberedError::new("E2112", e.to_string(), "change the limits, the pulses per mm or the control period")
        })?;
        Ok(machine)
    }

    /// Name of an output channel: by its cutter, by the machine file, or by its purpose.
    #[must_use]
    pub fn channel_name(&self, channel: u8) -> String {
        if let Some(beam) = self.beam_of_speed().filter(|_| channel == retrace_link::channel::SPEED) {
            return format!("{} power", beam.name);
        }
        if let Some(output) = self.card.analog_outputs.iter().find(|output| output.channel() == channel) {
            return output.name.clone();
        }
        let named = || self.output_names.get(&channel).cloned();
        cutter::name_of(&self.cutters, channel).or_else(named).unwrap_or_else(|| channel_names::channel_name(channel))
    }

    /// The beam whose power S is, if any: the one that M3 and M4 switch.
    fn beam_of_speed(&self) -> Option<&CutterConfig> {
        self.cutters
            .iter()
            .find(|cutter| cutter.kind == crate::CutterKind::Beam && cutter.fire == retrace_link::channel::SPINDLE)
    }

    /// The channel of this name; case is ignored.
    #[must_use]
    pub fn channel_named(&self, name: &str) -> Option<u8> {
        let mut channels =
            (0..retrace_link::channel::COUNT as u8).filter(|&number| retrace_link::channel::is_output(number));
        channels.find(|&channel| self.channel_name(channel).eq_ignore_ascii_case(name))
    }

    /// The cutter that this channel lights, opens or starts, if any.
    #[must_use]
    pub fn cutter_of(&self, channel: u8) -> Option<&CutterConfig> {
        self.cutters.iter().find(|cutter| cutter.fire == channel)
    }

    /// What switching an output takes after its own code, where that starts or ends a cut (CUT-13): a duration in
    /// control periods, and the input to wait for. `pierce_s`: the pierce delay in s of the material; `None` for that
    /// of the machine file. `is_unwatched`: the program ignores the input of `ok`, and a start waits for it no more.
    #[must_use]
    pub fn cutter_switching(
        &self,
        change: OutputChange,
        pierce_s: Option<f64>,
        is_unwatched: bool,
    ) -> (u32, Option<InputWait>) {
        let Some(cutter) = self.cutter_of(change.channel) else { return (0, None) };
        if !cutter.kind.cuts_at_rest() {
            let marker = cutter.marker.filter(|_| change.value != 0 && !self.skips_waits());
            return (
                marker.map_or(0, |marker| (marker.on_ms * 1000.0 / f64::from(self.period_us)).ceil() as u32),
                None,
            );
        }
        let pierce_s = pierce_s.unwrap_or(cutter.start.pierce_s);
        match (self.inhibits_outputs, change.value) {
            // its input proves nothing: it takes the time of a pierce
            (true, 1..) if self.dry_waits => ((pierce_s * 1e6 / f64::from(self.period_us)).round() as u32, None),
            (true, _) => (0, None),
            (false, 0) => (0, cutter.end_of_cut(self.period_us)),
            (false, _) => cutter.start_of_cut(pierce_s, self.period_us, is_unwatched),
        }
    }

    /// The beam whose power output is used, if any.
    #[must_use]
    pub fn powered_beam(&self) -> Option<&CutterConfig> {
        self.cutters.iter().find(|cutter| cutter.power.is_some())
    }

    /// Output for S: that of the machine file, or its default where a beam has `power`; `None` if it is not used.
    #[must_use]
    pub fn spindle_pwm(&self) -> Option<SpindlePwm> {
        self.card.spindle_pwm.or_else(|| self.powered_beam().map(|_| SPINDLE_PWM_OF_A_BEAM))
    }

    /// The channels that belong to the start of a cutter: those that fire, and the abrasives and the pressures that are
    /// switched with a jet. They are restored last, in the order of the program.
    #[must_use]
    pub fn cutter_channels(&self) -> Vec<u8> {
        let jets = self.cutters.iter().filter(|cutter| cutter.jet.is_some());
        let flows = jets.flat_map(|cutter| [cutter.abrasive, cutter.pressure].into_iter().flatten());
        self.cutting_outputs.iter().copied().chain(flows).collect()
    }

    /// The channel that M3, M4 and M5 with this number behind `$` switch; `None` where no cutter has the number.
    #[must_use]
    pub fn spindle_channel(&self, spindle: u8) -> Option<u8> {
        let cutter = self.cutters.iter().find(|cutter| cutter.spindle == Some(spindle));
        cutter.map(|cutter| cutter.fire).or((spindle == 0).then_some(retrace_link::channel::SPINDLE))
    }

    /// Whether this tool of a program is a cutter on the head, which needs no change: its number is that of the cutter
    /// behind `$`, and the machine has a material table.
    #[must_use]
    pub fn is_on_head(&self, tool: u32) -> bool {
        let is_tool = |cutter: &CutterConfig| cutter.spindle.is_some_and(|number| u32::from(number) == tool);
        self.material_file().is_some() && self.cutters.iter().any(is_tool)
    }

    /// Whether this is a dry run that leaves out the time of what it leaves off (CUT-8).
    #[must_use]
    pub const fn skips_waits(&self) -> bool {
        self.inhibits_outputs && !self.dry_waits
    }

    /// Channels that are kept off in a dry run: fire, arm, assist, abrasive and pressure of every cutter. Empty
    /// otherwise.
    #[must_use]
    pub fn inhibited_channels(&self) -> Vec<u8> {
        if self.inhibits_outputs { cutter::inhibited(&self.cutters) } else { Vec::new() }
    }

    /// The layer of the tool axis, if a cutter senses the sheet.
    #[must_use]
    pub fn tool_layer(&self) -> Option<ToolLayer<'_>> {
        let cutter = self.cutters.iter().find(|cutter| cutter.sense.is_used())?;
        let index = self.setting_up.tool_axis?;
        let layer = ToolLayer::new(&cutter.sense, cutter.fire, (index, self.axes.get(index)?));
        Some(layer.with_margin(cutter.height.map_or(0.0, |height| height.margin_mm)))
    }

    /// How the height of the cutter that senses the sheet is controlled, if it is.
    #[must_use]
    pub fn height_control(&self) -> Option<HeightControlOfCutter<'_>> {
        let cutter = self.cutters.iter().find(|cutter| cutter.sense.is_used())?;
        let axis = self.axes.get(self.setting_up.tool_axis?)?;
        Some(HeightControlOfCutter::new(cutter.height.as_ref()?, axis, &self.card.analog_inputs))
    }

    /// Length of a test pulse of the cutter that this channel fires, in control periods; 0 without one.
    #[must_use]
    pub fn test_pulse_periods(&self, fire: u8) -> u32 {
        let cutter = self.cutters.iter().find(|cutter| cutter.fire == fire);
        cutter.map_or(0, |cutter| (cutter.pulse_s * 1e6 / f64::from(self.period_us)).round() as u32)
    }

    /// Channels of the cutters in the order of the card's settings.
    #[must_use]
    pub fn cutting_channels(&self) -> Vec<u8> {
        cutter::inhibited(&self.cutters)
    }

    /// Channels that the end of a job switches off: those of every cutter, the spindle and its orientation, and the
    /// pointer.
    #[must_use]
    pub fn off_at_end(&self) -> Vec<u8> {
        let mut channels = cutter::inhibited(&self.cutters);
        if !channels.contains(&retrace_link::channel::SPINDLE) {
            channels.push(retrace_link::channel::SPINDLE);
        }
        channels.extend(self.spindle.orientation.map(|orientation| orientation.output));
        channels.extend(self.setting_up.pointer_output);
        channels
    }

    /// Control period in seconds.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        f64::from(self.period_us) * 1e-6
    }

    /// Limits for a card's rate law; missing axes have those of the first axis. Not `None` for a machine whose file was
    /// checked.
    #[must_use]
    pub fn rate_limits<const A: usize>(&self) -> Option<RateLimits<A>> {
        rate_limits::rate_limits(&self.axes, self.reserve, self.period_s())
    }

    /// Limits for the planner; missing axes have those of the first axis.
    #[must_use]
    pub fn limits<const A: usize>(&self) -> MachineLimits<A> {
        self.limits_of(&self.axes)
    }

    /// Limits for the planner with the limits of these axes, one for each of the machine.
    pub(crate) fn limits_of<const A: usize>(&self, axes: &[AxisConfig]) -> MachineLimits<A> {
        let each = |value: fn(&AxisConfig) -> f64| {
            let mut all = [value(&axes[0]); A];
            for (slot, axis) in all.iter_mut().zip(axes) {
                *slot = value(axis);
            }
            all
        };
        MachineLimits {
            velocity_mm_s: each(|a| a.max_velocity_mm_per_s),
            acceleration_mm_s2: each(|a| a.max_acceleration_mm_per_s2),
            jerk_mm_s3: each(|a| a.max_jerk_mm_per_s3),
            pulses_per_mm: each(|a| a.pulses_per_mm),
            path_velocity_mm_s: self.path_velocity_mm_s,
            reserve: self.reserve,
            period_s: self.period_s(),
            feed_shares: self.powered_beam().is_some() || self.height_control().is_some(),
        }
    }
}

impl MachineConfig {
    /// Letters of the axes that have to be homed before a program moves them, in the order of homing. Empty where the
    /// machine has its position.
    #[must_use]
    pub fn needs_homing(&self) -> &[char] {
        if self.setting_up.homed { &[] } else { &self.setting_up.homing_order }
    }

    /// Letters of the axes that can be homed, in the order of homing.
    #[must_use]
    pub fn homing_order(&self) -> &[char] {
        &self.setting_up.homing_order
    }

    /// Index of the axis that retracts the tool from the work, if any.
    #[must_use]
    pub fn tool_axis(&self) -> Option<usize> {
        self.setting_up.tool_axis
    }

    /// Index of the axis with this letter, of either case.
    #[must_use]
    pub fn axis_of(&self, letter: char) -> Option<usize> {
        let letter = letter.to_ascii_lowercase();
        AXIS_LETTERS.contains(&letter).then(|| self.axes.iter().position(|axis| axis.name == letter)).flatten()
    }

    /// Pulses nearest to a length on an axis; 0 where the axis does not exist.
    #[must_use]
    pub fn counts_of(&self, axis: usize, mm: f64) -> i64 {
        self.axes.get(axis).map_or(0, |axis| axis.pulses_of(mm))
    }

    /// Command to the card that homes an axis, given as an index of `axes`. None where it has no switch.
    #[must_use]
    pub fn homing(&self, axis: usize) -> Option<HomingCommand> {
        /// In the units of a homing speed.
        const ONE_PULSE: f64 = 4_294_967_296.0;
        let home = (*self.setting_up.homes.get(axis)?)?;
        let (period_s, pulses_per_mm) = (self.period_s(), self.axes.get(axis)?.pulses_per_mm);
        let fixed = |per_period: f64| ((per_period * pulses_per_mm * ONE_PULSE).round() as i64).max(1);
        Some(HomingCommand {
            axis: u8::try_from(axis).ok()?,
            upper: home.upper,
            search_speed: fixed(home.search_mm_per_s * period_s),
            latch_speed: fixed(home.latch_mm_per_s * period_s),
            acceleration: fixed(home.acceleration_mm_per_s2 * period_s * period_s),
            max_travel: (home.max_travel_mm * pulses_per_mm).ceil() as u32,
            count: self.counts_of(axis, home.position_mm),
        })
    }
}

impl ChannelNames {
    /// Names of a machine's channels: a cutter's name, or that of the machine file, if there is one.
    #[must_use]
    pub fn of_machine(machine: &MachineConfig) -> Self {
        let mut units = <[String; retrace_link::channel::ANALOG_OUTPUTS]>::default();
        for output in &machine.card.analog_outputs {
            if let Some(unit) = units.get_mut(usize::from(output.number)) {
                unit.clone_from(&output.unit);
            }
        }
        let names = (0..retrace_link::channel::COUNT as u8).map(|channel| machine.channel_name(channel)).collect();
        Self { names, units }
    }
}

/// Checks the names of outputs: each output once, each name once, and none that a cutter has.
pub(crate) fn output_names(
    written: Vec<OutputSection>,
    cutters: &[CutterConfig],
) -> Result<BTreeMap<u8, String>, NumberedError> {
    let mut names = BTreeMap::new();
    for OutputSection { number, name } in written {
        let refuse =
            |why: &str| Err(NumberedError::new("E2112", format!("[[output]] {number}: {why}"), "one name each"));
        if usize::from(number) >= retrace_link::channel::DIGITAL {
            return refuse("there is no such output");
        }
        if name.is_empty() || name.chars().any(char::is_control) {
            return refuse("the name is empty or has control characters");
        }
        if cutter::name_of(cutters, number).is_some() {
            return refuse("the output belongs to a cutter, which names it");
        }
        if cutters.iter().any(|cutter| cutter.name == name) || names.values().any(|other| *other == name) {
            return refuse("the name is used twice");
        }
        if names.insert(number, name).is_some() {
            return refuse("the output has two names");
        }
    }
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;
    use retrace_motion::{GlideRatio, RatioOf};

    #[test]
    fn the_built_in_machine_is_the_published_one() {
        let machine = MachineConfig::built_in().expect("valid");
        assert_eq!(machine.axes.len(), 3);
        assert_eq!((machine.period_us, machine.history_records, machine.look_ahead_records), (1000, 1_800_000, 500));
        assert_eq!((machine.wheel_periods, machine.wheel_counts), (100, 10));
        assert_eq!(machine.limits::<4>(), MachineLimits::built_in());
    }

    #[test]
    fn a_misspelt_key_is_named_with_its_line_and_a_suggestion() {
        let text = "name = \"mill\"\n[[axis]]\nname = \"x\"\nmax_velocty_mm_per_s = 3\n";
        let refusal = MachineConfig::parse(text, "mill.toml").expect_err("misspelt");
        assert_eq!(refusal.number, "E2111");
        assert!(refusal.cause.contains("line 4") && refusal.cause.contains("mill.toml"), "{}", refusal.cause);
        assert_eq!(refusal.remedy, "did you mean `max_velocity_mm_per_s`?");
    }

    #[test]
    fn the_method_of_blending_is_chosen_by_name_with_its_ratio() {
        let blending = |text: &str| MachineConfig::parse(text, "m.toml").map(|machine| machine.blending);
        let source = |value, of| Ok(Blending::Source(GlideRatio::new(value, of).expect("in range")));
        assert_eq!(blending(""), Ok(Blending::Optimum));
        assert_eq!(blending("[blending]\nglide_ratio = 0.3\n"), Ok(Blending::Optimum));
        assert_eq!(blending("[blending]\nmethod = \"source\"\n"), source(0.2, RatioOf::Length));
        let text = "[blending]\nmethod = \"source\"\nglide_ratio = 0.5\nratio_of = \"speed\"\n";
        assert_eq!(blending(text), source(0.5, RatioOf::Speed));
        let refused = |text: &str| blending(text).expect_err("wrong");
        assert!(refused(&text.replace("0.5", "0")).cause.contains("blending.glide_ratio = 0"));
        assert_eq!(refused(&text.replace("glide_ratio", "glide_rato")).remedy, "did you mean `glide_ratio`?");
        assert_eq!(refused(&text.replace("source", "sauce")).number, "E2111");
    }

    #[test]
    fn numbers_out_of_range_are_refused_by_name() {
        let what = |text: &str| MachineConfig::parse(text, "m.toml").expect_err("out of range").cause;
        assert!(what("control_period_ms = 0").contains("control_period_ms = 0"));
        assert!(what("history_hours = nan").contains("history_hours"));
        assert!(what("axis = []").contains("no [[axis]]"));
        let axis = "[[axis]]\nname = \"x\"\npulses_per_mm = 1e6\nmax_velocity_mm_per_s = \
            1e3\nmax_acceleration_mm_per_s2 = 1e4\nmax_jerk_mm_per_s3 = 1e6\ntravel_mm = [0, 1]\n";
        assert!(what(axis).contains("pulses"), "{}", what(axis));
        assert!(what(&axis.replace("[0, 1]", "[1, 0]")).contains("travel_mm"));
        assert!(what(&axis.repeat(2).replace("1e6", "1e2")).contains("twice"));
    }
}
