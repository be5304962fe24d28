//! The handshake: identity and position of the card, and the settings of an epoch.
//!
//! Invariant: a greeting of another protocol version is still read as far as its version, so that the version can be
//! reported.

use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{FeedShare, Place, RecordIndex};

use super::entry::{read_alarm, write_alarm};
use super::{ByteReader, ByteWriter};
use crate::{
    Alarm, AnalogCounts, BeamPower, CardIdentity, CardSettings, CuttingChannel, CuttingSettings, InputSetting,
    InputUse, LayerSettings, MAX_CUTTING_CHANNELS, MAX_SAFE, OutputChange, PathStart, ProofInput, SpindlePwm,
    SpindleSettings,
};

/// Greeting: a card's answer to a greeting request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Greeting<const A: usize> {
    /// Nonce of the request.
    pub nonce: u32,
    /// Identity of the card.
    pub identity: CardIdentity,
    /// Open epoch, or 0.
    pub epoch: u16,
    /// Last epoch that was opened.
    pub last_epoch: u16,
    /// Place of the cursor.
    pub place: Place,
    /// Whether it is at rest.
    pub at_rest: bool,
    /// The furthest place of the last epoch that was executed, as a record boundary.
    pub reached: RecordIndex,
    /// Number of the last exclusive instruction of that epoch that is complete.
    pub executed: u32,
    /// Net pulses of each axis, with the layer; those beyond the card's axes are zero.
    pub counts: [i64; A],
    /// Axis of the layer, and the layer, which is contained in its count.
    pub layer: (u8, i32),
    /// Latched alarm.
    pub alarm: Option<Alarm>,
}

impl<const A: usize> Greeting<A> {
    /// Writes the message after its kind.
    pub fn write(&self, writer: &mut ByteWriter<'_>) -> Option<()> {
        let of = &self.identity;
        writer.u8(of.protocol)?;
        writer.u32(self.nonce)?;
        writer.slice(&of.name)?;
        writer.u32(of.serial)?;
        writer.u32(of.boot)?;
        let outputs = of.outputs | if of.has_spindle_pwm { SPINDLE_PWM } else { 0 };
        let inputs = of.inputs | if of.has_spindle_encoder { SPINDLE_ENCODER } else { 0 };
        writer.slice(&[of.axes, outputs, inputs, of.analog.outputs(), of.analog.inputs()])?;
        for value in [of.window, of.tick_hz, of.min_period_us, of.max_period_us, of.max_pulses_hz] {
            writer.count(u64::from(value))?;
        }
        writer.u16(of.memory)?;
        writer.u16(self.epoch)?;
        writer.u16(self.last_epoch)?;
        writer.u32(self.place.record.number())?;
        writer.u32(self.place.fraction)?;
        writer.u8(u8::from(self.at_rest))?;
        writer.u32(self.reached.number())?;
        writer.u32(self.executed)?;
        write_alarm(writer, self.alarm)?;
        writer.u8(self.layer.0)?;
        writer.signed(i64::from(self.layer.1))?;
        self.counts.iter().take(usize::from(of.axes)).try_for_each(|&count| writer.signed(count))
    }

    /// Reads a greeting after its kind. Returns `Err` for another version of the protocol and `None` for invalid bytes.
    pub fn read(reader: &mut ByteReader<'_>) -> Option<Result<Self, u8>> {
        let protocol = reader.u8()?;
        if protocol != crate::PROTOCOL {
            return Some(Err(protocol));
        }
        let nonce = reader.u32()?;
        let name = reader.slice(16)?.try_into().ok()?;
        let (serial, boot) = (reader.u32()?, reader.u32()?);
        let (axes, outputs, inputs) = (reader.u8()?, reader.u8()?, reader.u8()?);
        let analog = AnalogCounts::new(reader.u8()?, reader.u8()?);
        let identity = CardIdentity {
            protocol,
            name,
            serial,
            boot,
            axes,
            outputs: outputs & !SPINDLE_PWM,
            inputs: inputs & !SPINDLE_ENCODER,
            analog,
            has_spindle_pwm: outputs & SPINDLE_PWM != 0,
            has_spindle_encoder: inputs & SPINDLE_ENCODER != 0,
            window: reader.count32()?,
            tick_hz: reader.count32()?,
            min_period_us: reader.count32()?,
            max_period_us: reader.count32()?,
            max_pulses_hz: reader.count32()?,
            memory: reader.u16()?,
        };
        let (epoch, last_epoch) = (reader.u16()?, reader.u16()?);
        let place = Place { record: RecordIndex::new(reader.u32()?), fraction: reader.u32()? };
        let at_rest = reader.u8()? != 0;
        let (reached, executed) = (RecordIndex::new(reader.u32()?), reader.u32()?);
        let (alarm, layer) = (read_alarm(reader)?, (reader.u8()?, reader.signed32()?));
        let mut counts = [0; A];
        for axis in 0..usize::from(axes) {
            let count = reader.signed()?;
            if let Some(slot) = counts.get_mut(axis) {
                *slot = count;
            }
        }
        Some(Ok(Self { nonce, identity, epoch, last_epoch, place, at_rest, reached, executed, counts, layer, alarm }))
    }
}

/// Flag in the number of outputs: the card has an output for S.
const SPINDLE_PWM: u8 = 0x80;
/// Flag in the number of inputs: the card reads the encoder of a spindle.
const SPINDLE_ENCODER: u8 = 0x80;

/// Settings of an epoch, as they are sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Opening<const A: usize>(pub CardSettings<A>);

impl<const A: usize> Opening<A> {
    /// Writes the message after its kind.
    pub fn write(&self, writer: &mut ByteWriter<'_>) -> Option<()> {
        let of = &self.0;
        writer.u16(of.epoch)?;
        write_start(writer, &of.start)?;
        writer.u8(of.axes)?;
        writer.count(u64::from(of.period_us))?;
        writer.u16(of.limits.average())?;
        writer.u16(of.limits.share())?;
        for axis in of.limits.axes().iter().take(usize::from(of.axes)) {
            [axis.velocity, axis.acceleration, axis.jerk].into_iter().try_for_each(|figure| writer.count(figure))?;
        }
        writer.u8(of.report_periods)?;
        for value in [of.watchdog_periods, of.pulse_ns, of.direction_setup_ns, of.direction_inverted] {
            writer.u16(value)?;
        }
        for &pulses in of.backlash_pulses.iter().take(usize::from(of.axes)) {
            writer.count(u64::from(pulses))?;
        }
        let used = |input: &InputSetting| *input != InputSetting::default();
        writer.u16(
            (0..).zip(&of.inputs).filter(|(_, input)| used(input)).fold(0, |bits, (number, _)| bits | 1 << number),
        )?;
        for input in of.inputs.iter().filter(|input| used(input)) {
            let (code, axis) = match input.used_for {
                InputUse::Plain => (0, 0),
                InputUse::Limit { axis, upper } => (1 + u8::from(upper), axis),
                InputUse::Home { axis } => (3, axis),
                InputUse::Door => (4, 0),
                InputUse::EmergencyStop => (5, 0),
                InputUse::Probe => (6, 0),
                InputUse::Collision { only_lit } => (7, u8::from(only_lit)),
            };
            writer.u8(code | axis << 3 | u8::from(input.active_low) << 7)?;
        }
        writer.u8(of.safe().len() as u8)?;
        of.safe().iter().try_for_each(|&change| write_safe(writer, change))?;
        write_cutting(writer, &of.cutting)?;
        write_layer(writer, of.layer)?;
        write_spindle_pwm(writer, of.spindle_pwm)?;
        write_spindle(writer, of.spindle)
    }

    /// Reads the message after its kind.
    pub fn read(reader: &mut ByteReader<'_>) -> Option<Self> {
        let (epoch, start) = (reader.u16()?, read_start(reader)?);
        let (axes, period_us) = (reader.u8()?, reader.count32()?);
        let limits = read_limits(reader, usize::from(axes))?;
        let mut settings = CardSettings::new(epoch, start, period_us, limits);
        settings.axes = axes;
        settings.report_periods = reader.u8()?;
        settings.watchdog_periods = reader.u16()?;
        settings.pulse_ns = reader.u16()?;
        settings.direction_setup_ns = reader.u16()?;
        settings.direction_inverted = reader.u16()?;
        for pulses in settings.backlash_pulses.get_mut(..usize::from(axes))? {
            *pulses = u16::try_from(reader.count32()?).ok()?;
        }
        let used = reader.u16()?;
        for (_, input) in (0..).zip(&mut settings.inputs).filter(|(number, _)| used >> number & 1 == 1) {
            let byte = reader.u8()?;
            let axis = byte >> 3 & 0x0F;
            let used_for = match byte & 7 {
                0 => InputUse::Plain,
                code @ (1 | 2) => InputUse::Limit { axis, upper: code == 2 },
                3 => InputUse::Home { axis },
                4 => InputUse::Door,
                5 => InputUse::EmergencyStop,
                6 => InputUse::Probe,
                _ => InputUse::Collision { only_lit: axis != 0 },
            };
            *input = InputSetting { used_for, active_low: byte & 0x80 != 0 };
        }
        settings.safe_count = reader.u8()?;
        if usize::from(settings.safe_count) > MAX_SAFE {
            return None;
        }
        for change in &mut settings.safe[..usize::from(settings.safe_count)] {
            *change = read_safe(reader)?;
        }
        settings.cutting = read_cutting(reader)?;
        settings.layer = read_layer(reader)?;
        settings.spindle_pwm = read_spindle_pwm(reader)?;
        settings.spindle = read_spindle(reader)?;
        Some(Self(settings))
    }
}

/// Flag in the channel of an output that a fault switches: its value follows; without it the value is 0.
const HAS_VALUE: u8 = 0x80;

fn write_safe(writer: &mut ByteWriter<'_>, change: OutputChange) -> Option<()> {
    if change.value == 0 {
        return writer.u8(change.channel & !HAS_VALUE);
    }
    writer.u8(HAS_VALUE | change.channel)?;
    writer.signed(i64::from(change.value))
}

fn read_safe(reader: &mut ByteReader<'_>) -> Option<OutputChange> {
    let channel = reader.u8()?;
    let value = if channel & HAS_VALUE == 0 { 0 } else { reader.signed32()? };
    Some(OutputChange { channel: channel & !HAS_VALUE, value })
}

/// Flag in the number of an axis: the settings of the layer follow.
const HAS_LAYER: u8 = 0x80;

fn write_layer(writer: &mut ByteWriter<'_>, layer: Option<LayerSettings>) -> Option<()> {
    let Some(LayerSettings { axis, contacts, probe_speed, latch_speed }) = layer else { return writer.u8(0) };
    writer.u8(HAS_LAYER | axis)?;
    writer.u16(contacts)?;
    writer.count(u64::from(probe_speed))?;
    writer.count(u64::from(latch_speed))
}

/// Reads the settings of the layer. Returns `None` if the bytes are cut short.
#[allow(clippy::option_option)]
fn read_layer(reader: &mut ByteReader<'_>) -> Option<Option<LayerSettings>> {
    let axis = reader.u8()?;
    if axis & HAS_LAYER == 0 {
        return Some(None);
    }
    let (contacts, probe_speed, latch_speed) = (reader.u16()?, reader.count32()?, reader.count32()?);
    Some(Some(LayerSettings { axis: axis & !HAS_LAYER, contacts, probe_speed, latch_speed }))
}

/// Writes the settings of the output for S; a full scale of 0: it is not used.
fn write_spindle_pwm(writer: &mut ByteWriter<'_>, pwm: Option<SpindlePwm>) -> Option<()> {
    let Some(SpindlePwm { full_scale, hz }) = pwm else { return writer.u8(0) };
    writer.count(u64::from(full_scale))?;
    writer.u16(hz)
}

/// Reads the settings of the output for S. Returns `None` if the bytes are cut short.
#[allow(clippy::option_option)]
fn read_spindle_pwm(reader: &mut ByteReader<'_>) -> Option<Option<SpindlePwm>> {
    let full_scale = reader.count32()?;
    Some(if full_scale == 0 { None } else { Some(SpindlePwm { full_scale, hz: reader.u16()? }) })
}

/// Flags of a spindle's encoder.
const IS_INVERTED: u8 = 1;
const HAS_INDEX: u8 = 2;

/// Writes the settings of the spindle's encoder; 0 counts a turn: there is none.
fn write_spindle(writer: &mut ByteWriter<'_>, spindle: Option<SpindleSettings>) -> Option<()> {
    let Some(of) = spindle else { return writer.u8(0) };
    writer.count(u64::from(of.counts_per_turn))?;
    writer.u8(if of.is_inverted { IS_INVERTED } else { 0 } | if of.has_index { HAS_INDEX } else { 0 })?;
    for value in [u32::from(of.at_speed_permille), u32::from(of.at_speed_periods), of.timeout_periods, of.highest_speed]
    {
        writer.count(u64::from(value))?;
    }
    Some(())
}

/// Reads the settings of the spindle's encoder. Returns `None` if the bytes are cut short.
#[allow(clippy::option_option)]
fn read_spindle(reader: &mut ByteReader<'_>) -> Option<Option<SpindleSettings>> {
    let counts_per_turn = reader.count32()?;
    if counts_per_turn == 0 {
        return Some(None);
    }
    let flags = reader.u8()?;
    Some(Some(SpindleSettings {
        counts_per_turn,
        is_inverted: flags & IS_INVERTED != 0,
        has_index: flags & HAS_INDEX != 0,
        at_speed_permille: reader.count16()?,
        at_speed_periods: reader.count16()?,
        timeout_periods: reader.count32()?,
        highest_speed: reader.count32()?,
    }))
}

/// Flag in the number of channels: dry run.
const INHIBIT: u8 = 0x80;
/// Flag in the channel of a beam: its power output is used.
const HAS_POWER: u8 = 0x80;
/// Flag in a cutting channel's number: it fires.
const FIRES: u8 = 0x80;

fn write_cutting(writer: &mut ByteWriter<'_>, cutting: &CuttingSettings) -> Option<()> {
    writer.u8(cutting.channels().len() as u8 | if cutting.inhibit { INHIBIT } else { 0 })?;
    writer.count(u64::from(cutting.handover_periods))?;
    cutting.channels().iter().try_for_each(|of| {
        writer.u8(of.channel & !FIRES | if of.fires { FIRES } else { 0 })?;
        let flags = u64::from(of.proof.is_some()) << 1 | u64::from(of.lit_in_reverse);
        writer.count(u64::from(of.standing_periods) << 2 | flags)?;
        let Some(proof) = of.proof else { return Some(()) };
        writer.u8(proof.input)?;
        let periods = [proof.proven_periods, proof.lost_periods, proof.out_periods];
        periods.into_iter().try_for_each(|periods| writer.count(u64::from(periods)))
    })?;
    let Some(BeamPower { channel, least, exponent }) = cutting.beam_power else { return writer.u8(0) };
    writer.u8(HAS_POWER | channel)?;
    writer.u16(least.units())?;
    writer.u8(exponent)
}

fn read_cutting(reader: &mut ByteReader<'_>) -> Option<CuttingSettings> {
    let (count, handover) = (reader.u8()?, reader.count32()?);
    let mut cutting = CuttingSettings {
        count: count & !INHIBIT,
        handover_periods: u16::try_from(handover).ok()?,
        inhibit: count & INHIBIT != 0,
        ..CuttingSettings::default()
    };
    if usize::from(cutting.count) > MAX_CUTTING_CHANNELS {
        return None;
    }
    for slot in cutting.channels.get_mut(..usize::from(cutting.count))? {
        let (channel, standing) = (reader.u8()?, reader.count32()?);
        *slot = CuttingChannel {
            channel: channel & !FIRES,
            fires: channel & FIRES != 0,
            standing_periods: u16::try_from(standing >> 2).ok()?,
            lit_in_reverse: standing & 1 == 1,
            proof: if standing & 2 == 0 {
                None
            } else {
                Some(ProofInput {
                    input: reader.u8()?,
                    proven_periods: reader.count16()?,
                    lost_periods: reader.count16()?,
                    out_periods: reader.count16()?,
                })
            },
        };
    }
    let channel = reader.u8()?;
    if channel & HAS_POWER != 0 {
        let least = FeedShare::from_units(reader.u16()?);
        cutting.beam_power = Some(BeamPower { channel: channel & !HAS_POWER, least, exponent: reader.u8()? });
    }
    Some(cutting)
}

fn write_start(writer: &mut ByteWriter<'_>, start: &PathStart) -> Option<()> {
    for value in [start.place.record.number(), start.place.fraction, start.reached.number(), start.executed] {
        writer.u32(value)?;
    }
    writer.u8(u8::from(start.rests) | u8::from(start.keeps_state) << 1)
}

fn read_start(reader: &mut ByteReader<'_>) -> Option<PathStart> {
    let place = Place { record: RecordIndex::new(reader.u32()?), fraction: reader.u32()? };
    let (reached, executed) = (RecordIndex::new(reader.u32()?), reader.u32()?);
    let flags = reader.u8()?;
    Some(PathStart { place, reached, executed, rests: flags & 1 != 0, keeps_state: flags & 2 != 0 })
}

/// Reads the limits of `told` axes; the others get the limits of the first.
fn read_limits<const A: usize>(reader: &mut ByteReader<'_>, told: usize) -> Option<RateLimits<A>> {
    let (average, share) = (reader.u16()?, reader.u16()?);
    let mut axes = [PulseLimits::default(); A];
    for slot in axes.get_mut(..told)? {
        *slot = PulseLimits { velocity: reader.count()?, acceleration: reader.count()?, jerk: reader.count()? };
    }
    let (told, rest) = axes.split_at_mut(told);
    rest.fill(*told.first()?);
    RateLimits::new(average, share, axes)
}
