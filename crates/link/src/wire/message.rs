//! The commands of the stream (host to card).
//!
//! Invariant: a command that does not fit leaves writer and record run unchanged.

use super::record::RECORD;
use super::{ByteReader, ByteWriter, RecordRun};
use crate::{
    ArmedStretch, GearStart, HeightControlSettings, HeightControls, HeightSource, HomingCommand, HostCommand, Ignition,
    InputWait, Instruction, LayerMove, MAX_CHANGES, OhmicSensing, OutputAction, OutputChange, ProbeArming,
    RepeatedInstruction, SheetSource, SpeedCurve, SpeedPoint, SpindleControl, SpindleTask,
};
use retrace_core::gear::GearLimits;
use retrace_core::{Distance, FeedShare, Rate, RecordIndex};

mod tag {
    pub(super) const PLACE_AHEAD: u8 = 0x01;
    pub(super) const PLACE_BEHIND: u8 = 0x02;
    pub(super) const TRIM: u8 = 0x03;
    pub(super) const FORGET: u8 = 0x04;
    pub(super) const ACTION: u8 = 0x05;
    pub(super) const REPLAY: u8 = 0x06;
    pub(super) const INSTRUCTION: u8 = 0x07;
    pub(super) const BY_HAND: u8 = 0x08;
    pub(super) const CLEAR_ALARM: u8 = 0x09;
    pub(super) const HOME: u8 = 0x0A;
    pub(super) const ARM_PROBE: u8 = 0x0C;
    pub(super) const FOLLOW: u8 = 0x0D;
    pub(super) const FREE_TOOL: u8 = 0x0E;
    pub(super) const ARM_STRETCH: u8 = 0x0F;
    pub(super) const SPEED_CURVE: u8 = 0x10;
    pub(super) const RESTART: u8 = 0x20;
    pub(super) const REPEAT: u8 = 0x21;
}

/// Appends a command to a payload. Returns `None` if there is no space, or for a rate, which has a frame of its own.
pub fn write_command<const A: usize>(
    writer: &mut ByteWriter<'_>,
    run: &mut RecordRun<A>,
    command: &HostCommand<A>,
) -> Option<()> {
    let (length, was) = (writer.len(), *run);
    let written = write(writer, run, command);
    if written.is_none() {
        writer.truncate(length);
        *run = was;
    }
    written
}

fn write<const A: usize>(writer: &mut ByteWriter<'_>, run: &mut RecordRun<A>, command: &HostCommand<A>) -> Option<()> {
    match command {
        HostCommand::Ahead { place, record } => {
            place_of(writer, run, *place, false)?;
            run.write(writer, record, false, false)
        }
        HostCommand::Behind { place, record, rests } => {
            place_of(writer, run, *place, true)?;
            run.write(writer, record, true, *rests)
        }
        HostCommand::Trim { high } => {
            writer.u8(tag::TRIM)?;
            writer.u32(high.number())
        }
        HostCommand::Forget { low } => {
            writer.u8(tag::FORGET)?;
            writer.u32(low.number())
        }
        HostCommand::Action(action) => {
            writer.u8(tag::ACTION)?;
            writer.u32(action.place.number())?;
            writer.u8(action.channel)?;
            writer.signed(i64::from(action.before))?;
            writer.signed(i64::from(action.after))
        }
        HostCommand::Rate { .. } => None,
        HostCommand::Replay { on } => {
            writer.u8(tag::REPLAY)?;
            writer.u8(u8::from(*on))
        }
        HostCommand::Instruction(instruction) => {
            writer.u8(tag::INSTRUCTION)?;
            write_instruction(writer, instruction)
        }
        HostCommand::ManualOutput(change) => {
            writer.u8(tag::BY_HAND)?;
            write_change(writer, *change)
        }
        HostCommand::ClearAlarm => writer.u8(tag::CLEAR_ALARM),
        HostCommand::Home(homing) => {
            writer.u8(tag::HOME)?;
            write_homing(writer, homing)
        }
        HostCommand::Restart { last } => {
            writer.u8(tag::RESTART)?;
            writer.u32(*last)
        }
        HostCommand::Repeat(repeated) => {
            writer.u8(tag::REPEAT)?;
            writer.u32(repeated.number)?;
            let RepeatedInstruction { periods, until, is_pulse, layer, .. } = *repeated;
            write_switching(writer, periods, repeated.changes(), until, (is_pulse, layer, None))
        }
        HostCommand::ArmProbe(ProbeArming { input, active, filter_periods }) => {
            writer.u8(tag::ARM_PROBE)?;
            writer.u8(input & PROBE_INPUT | if *active { PROBE_ACTIVE } else { 0 })?;
            writer.count(u64::from(*filter_periods))
        }
        HostCommand::FollowSpindle { on } => {
            writer.u8(tag::FOLLOW)?;
            writer.u8(u8::from(*on))
        }
        HostCommand::FreeTool => writer.u8(tag::FREE_TOOL),
        HostCommand::ArmStretch(armed) => {
            writer.u8(tag::ARM_STRETCH)?;
            write_armed_stretch(writer, armed)
        }
        HostCommand::SpeedCurve(curve) => {
            writer.u8(tag::SPEED_CURVE)?;
            writer.u8(curve.points().len() as u8)?;
            curve.points().iter().try_for_each(|point| {
                writer.count(u64::from(point.speed))?;
                writer.count(u64::from(point.duty))
            })
        }
    }
}

/// Reads a curve of the output for S; whether its points are a curve is checked by the card.
fn read_speed_curve(reader: &mut ByteReader<'_>) -> Option<SpeedCurve> {
    let mut curve = SpeedCurve { count: reader.u8()?, ..SpeedCurve::default() };
    for point in curve.points.get_mut(..usize::from(curve.count))? {
        *point = SpeedPoint { speed: reader.count32()?, duty: reader.count32()? };
    }
    Some(curve)
}

/// Flags of a stretch that is armed again.
const PASSED: u8 = 1;
const HAS_BARRIER: u8 = 2;

fn write_armed_stretch(writer: &mut ByteWriter<'_>, armed: &ArmedStretch) -> Option<()> {
    let ArmedStretch { first, start, speed, is_passed, barrier } = *armed;
    writer.u8(if is_passed { PASSED } else { 0 } | if barrier.is_some() { HAS_BARRIER } else { 0 })?;
    writer.u32(first.number())?;
    if let Some(barrier) = barrier {
        writer.u32(barrier.number())?;
    }
    writer.signed(i64::from(speed))?;
    write_spindle_task(writer, SpindleTask::Gear(start))
}

fn read_armed_stretch(reader: &mut ByteReader<'_>) -> Option<ArmedStretch> {
    let flags = reader.u8().filter(|flags| flags & !(PASSED | HAS_BARRIER) == 0)?;
    let first = RecordIndex::new(reader.u32()?);
    let barrier = if flags & HAS_BARRIER == 0 { None } else { Some(RecordIndex::new(reader.u32()?)) };
    let speed = reader.signed32()?;
    let SpindleTask::Gear(start) = read_task(reader)? else { return None };
    Some(ArmedStretch { first, start, speed, is_passed: flags & PASSED != 0, barrier })
}

/// Number of the probe's input, and the flag that it is to become active.
const PROBE_INPUT: u8 = 0x7F;
const PROBE_ACTIVE: u8 = 0x80;

fn place_of<const A: usize>(
    writer: &mut ByteWriter<'_>,
    run: &mut RecordRun<A>,
    place: RecordIndex,
    behind: bool,
) -> Option<()> {
    if run.needs_place(place, behind) {
        writer.u8(if behind { tag::PLACE_BEHIND } else { tag::PLACE_AHEAD })?;
        writer.u32(place.number())?;
        run.set_place(place, behind);
    }
    Some(())
}

/// Reads the next command of a payload. Returns `None` if the bytes are invalid: the rest of the payload is then
/// unusable.
pub fn read_command<const A: usize>(reader: &mut ByteReader<'_>, run: &mut RecordRun<A>) -> Option<HostCommand<A>> {
    loop {
        return Some(match reader.u8()? {
            record if record & RECORD != 0 => return run.read(reader, record),
            tag::PLACE_AHEAD => {
                run.set_place(RecordIndex::new(reader.u32()?), false);
                continue;
            }
            tag::PLACE_BEHIND => {
                run.set_place(RecordIndex::new(reader.u32()?), true);
                continue;
            }
            tag::TRIM => HostCommand::Trim { high: RecordIndex::new(reader.u32()?) },
            tag::FORGET => HostCommand::Forget { low: RecordIndex::new(reader.u32()?) },
            tag::ACTION => {
                let (place, channel) = (RecordIndex::new(reader.u32()?), reader.u8()?);
                HostCommand::Action(OutputAction {
                    place,
                    channel,
                    before: reader.signed32()?,
                    after: reader.signed32()?,
                })
            }
            tag::REPLAY => HostCommand::Replay { on: reader.u8()? != 0 },
            tag::INSTRUCTION => HostCommand::Instruction(read_instruction(reader)?),
            tag::BY_HAND => HostCommand::ManualOutput(read_change(reader)?),
            tag::CLEAR_ALARM => HostCommand::ClearAlarm,
            tag::HOME => HostCommand::Home(read_homing(reader)?),
            tag::RESTART => HostCommand::Restart { last: reader.u32()? },
            tag::REPEAT => HostCommand::Repeat(read_repeated(reader)?),
            tag::ARM_PROBE => {
                let (input, filter_periods) = (reader.u8()?, reader.count16()?);
                let active = input & PROBE_ACTIVE != 0;
                HostCommand::ArmProbe(ProbeArming { input: input & PROBE_INPUT, active, filter_periods })
            }
            tag::FOLLOW => HostCommand::FollowSpindle { on: reader.u8()? != 0 },
            tag::FREE_TOOL => HostCommand::FreeTool,
            tag::ARM_STRETCH => HostCommand::ArmStretch(read_armed_stretch(reader)?),
            tag::SPEED_CURVE => HostCommand::SpeedCurve(read_speed_curve(reader)?),
            _ => return None,
        });
    }
}

pub(super) fn write_change(writer: &mut ByteWriter<'_>, change: OutputChange) -> Option<()> {
    writer.u8(change.channel)?;
    writer.signed(i64::from(change.value))
}

pub(super) fn read_change(reader: &mut ByteReader<'_>) -> Option<OutputChange> {
    Some(OutputChange { channel: reader.u8()?, value: reader.signed32()? })
}

fn write_instruction(writer: &mut ByteWriter<'_>, instruction: &Instruction) -> Option<()> {
    writer.u32(instruction.number)?;
    writer.u32(instruction.place.number())?;
    let Instruction { periods, until, keeps_cutter, layer, spindle, .. } = *instruction;
    write_switching(writer, periods, instruction.changes(), until, (keeps_cutter, layer, spindle))
}

/// Flag in the count of changes: an input follows them.
const AWAITS: u8 = 0x80;
/// Flag in the count of changes of an instruction: time at rest is not counted. Of a repeated one: a test pulse.
const KEEPS_CUTTER: u8 = 0x40;
/// Flag in the count of changes: moves of the layer follow the input.
const MOVES_LAYER: u8 = 0x20;
/// Flag in the count of changes: what is awaited at the spindle follows last.
const SPINDLE: u8 = 0x10;
/// All flags in the count of changes.
const FLAGS: u8 = AWAITS | KEEPS_CUTTER | MOVES_LAYER | SPINDLE;
/// Number of the awaited input.
const AWAITED_INPUT: u8 = 0x3F;
/// Flag of the awaited input: it must become active.
const AWAITED_ACTIVE: u8 = 0x80;
/// Flag of the awaited input: a cutter is started.
const IGNITES: u8 = 0x40;

fn write_switching(
    writer: &mut ByteWriter<'_>,
    periods: u32,
    changes: &[OutputChange],
    until: Option<InputWait>,
    (keeps_cutter, layer, spindle): (bool, Option<LayerMove>, Option<SpindleTask>),
) -> Option<()> {
    writer.count(u64::from(periods))?;
    let flag = |flag: u8, so: bool| if so { flag } else { 0 };
    let flags = flag(AWAITS, until.is_some())
        | flag(KEEPS_CUTTER, keeps_cutter)
        | flag(MOVES_LAYER, layer.is_some())
        | flag(SPINDLE, spindle.is_some());
    writer.u8(changes.len() as u8 | flags)?;
    changes.iter().try_for_each(|&change| write_change(writer, change))?;
    if let Some(InputWait { input, active, timeout_periods, ignition }) = until {
        writer.u8(input & AWAITED_INPUT | flag(AWAITED_ACTIVE, active) | flag(IGNITES, ignition.is_some()))?;
        writer.count(u64::from(timeout_periods))?;
        if let Some(ignition) = ignition {
            writer.count(u64::from(ignition.stable_periods))?;
            writer.u8(ignition.attempts)?;
            writer.count(u64::from(ignition.retry_periods))?;
            writer.count(u64::from(ignition.delay_periods))?;
        }
    }
    layer.map_or(Some(()), |moves| write_layer(writer, moves))?;
    spindle.map_or(Some(()), |task| write_spindle_task(writer, task))
}

const AT_SPEED: u8 = 0;
const GEAR: u8 = 1;
const HELD_GEAR: u8 = 2;
const TAP: u8 = 3;

fn write_spindle_task(writer: &mut ByteWriter<'_>, task: SpindleTask) -> Option<()> {
    let SpindleTask::Gear(start) = task else { return writer.u8(AT_SPEED) };
    let GearStart { length, records_per_turn, start_angle, ahead, limits, ramp_share, reverse_share, control } = start;
    writer.u8(match control {
        SpindleControl::None => GEAR,
        SpindleControl::Held => HELD_GEAR,
        SpindleControl::Tap(_) => TAP,
    })?;
    let shares = [ramp_share, reverse_share].map(u32::from);
    for value in [length, u32::from(records_per_turn), start_angle, u32::from(ahead), shares[0], shares[1]] {
        writer.count(u64::from(value))?;
    }
    let GearLimits { rate, near_end, tolerance } = limits;
    for value in [rate.units(), near_end.units(), tolerance.units()] {
        writer.signed(value)?;
    }
    if let SpindleControl::Tap(turn) = control {
        writer.count(u64::from(turn))?;
    }
    Some(())
}

/// Reads what is awaited at the spindle, if the count of changes has its flag. Returns `None` if the bytes are invalid.
#[allow(clippy::option_option)]
fn read_spindle_task(reader: &mut ByteReader<'_>, counts: u8) -> Option<Option<SpindleTask>> {
    if counts & SPINDLE == 0 { Some(None) } else { read_task(reader).map(Some) }
}

fn read_task(reader: &mut ByteReader<'_>) -> Option<SpindleTask> {
    Some(match reader.u8()? {
        AT_SPEED => SpindleTask::AtSpeed,
        kind @ (GEAR | HELD_GEAR | TAP) => SpindleTask::Gear(GearStart {
            length: reader.count32()?,
            records_per_turn: reader.count16()?,
            start_angle: reader.count32()?,
            ahead: reader.count16()?,
            ramp_share: reader.count16()?,
            reverse_share: reader.count16()?,
            limits: GearLimits {
                rate: Rate::from_units(reader.signed()?),
                near_end: Distance::from_units(reader.signed()?),
                tolerance: Distance::from_units(reader.signed()?),
            },
            control: match kind {
                GEAR => SpindleControl::None,
                HELD_GEAR => SpindleControl::Held,
                _ => SpindleControl::Tap(reader.count32()?),
            },
        }),
        _ => return None,
    })
}

/// Flags in the kind of a start: the sheet of an earlier start counts; ohmic contacts, the control of the height, or
/// the layer of a known sheet follow.
const KEPT_SHEET: u8 = 4;
const HAS_OHMIC: u8 = 8;
const HAS_CONTROL: u8 = 16;
const KNOWN_SHEET: u8 = 32;
const START_FLAGS: u8 = KEPT_SHEET | HAS_OHMIC | HAS_CONTROL | KNOWN_SHEET;

fn write_layer(writer: &mut ByteWriter<'_>, moves: LayerMove) -> Option<()> {
    let (kind, values) = match moves {
        LayerMove::Start { start, lowest, pierce, cut, sheet, control } => {
            let control = control.first().filter(|control| control.source != HeightSource::None);
            let (flag, ohmic) = match sheet {
                SheetSource::Sensed(ohmic) => (0, ohmic),
                SheetSource::Kept(ohmic) => (KEPT_SHEET, ohmic),
                SheetSource::Known(_) => (KNOWN_SHEET, OhmicSensing::default()),
            };
            let has_ohmic = if ohmic.inputs != 0 { HAS_OHMIC } else { 0 };
            let has_control = if control.is_some() { HAS_CONTROL } else { 0 };
            writer.u8(flag | has_ohmic | has_control)?;
            [start, lowest, pierce, cut].iter().try_for_each(|&value| writer.signed(i64::from(value)))?;
            if ohmic.inputs != 0 {
                writer.u16(ohmic.inputs)?;
                writer.u8(ohmic.tries)?;
                writer.signed(i64::from(ohmic.drop))?;
            }
            if let SheetSource::Known(layer) = sheet {
                writer.signed(i64::from(layer))?;
            }
            return control.map_or(Some(()), |control| write_height_control(writer, control));
        }
        LayerMove::OverSheet { height, highest } => (1, [height, highest]),
        LayerMove::To { layer } => (2, [layer, 0]),
    };
    writer.u8(kind)?;
    values.iter().take(3 - usize::from(kind)).try_for_each(|&value| writer.signed(i64::from(value)))
}

fn write_height_control(writer: &mut ByteWriter<'_>, of: &HeightControlSettings) -> Option<()> {
    match of.source {
        HeightSource::None => return None,
        HeightSource::Volts { input } => writer.slice(&[0, input, 0])?,
        HeightSource::UpDown { up, down } => writer.slice(&[1, up, down])?,
        HeightSource::External { output } => writer.slice(&[2, output, 0])?,
    }
    writer.u16(of.target)?;
    writer.signed(i64::from(of.gain))?;
    for value in [of.speed, of.slope, of.up, of.down] {
        writer.count(u64::from(value))?;
    }
    let periods = [of.void_periods, of.delay_periods, of.samples, of.look_periods, of.limit_periods];
    for value in [of.filter, of.band, of.hold_below.units()].into_iter().chain(periods) {
        writer.count(u64::from(value))?;
    }
    Some(())
}

fn read_height_control(reader: &mut ByteReader<'_>) -> Option<HeightControlSettings> {
    let source = match (reader.u8()?, reader.u8()?, reader.u8()?) {
        (0, input, 0) => HeightSource::Volts { input },
        (1, up, down) => HeightSource::UpDown { up, down },
        (2, output, 0) => HeightSource::External { output },
        _ => return None,
    };
    Some(HeightControlSettings {
        source,
        target: reader.u16()?,
        gain: reader.signed32()?,
        speed: reader.count32()?,
        slope: reader.count32()?,
        up: reader.count32()?,
        down: reader.count32()?,
        filter: reader.count16()?,
        band: reader.count16()?,
        hold_below: FeedShare::from_units(reader.count16()?),
        void_periods: reader.count16()?,
        delay_periods: reader.count16()?,
        samples: reader.count16()?,
        look_periods: reader.count16()?,
        limit_periods: reader.count16()?,
    })
}

/// Reads how a start with these flags finds the sheet.
fn read_sheet(reader: &mut ByteReader<'_>, flags: u8) -> Option<SheetSource> {
    let ohmic = match flags & HAS_OHMIC {
        0 => OhmicSensing::default(),
        _ => OhmicSensing { inputs: reader.u16()?, tries: reader.u8()?, drop: reader.signed32()? },
    };
    Some(match flags & (KEPT_SHEET | HAS_OHMIC | KNOWN_SHEET) {
        KNOWN_SHEET => SheetSource::Known(reader.signed32()?),
        flags if flags & KNOWN_SHEET != 0 => return None,
        flags if flags & KEPT_SHEET != 0 => SheetSource::Kept(ohmic),
        _ => SheetSource::Sensed(ohmic),
    })
}

/// Reads the moves of the layer, if the count of changes has their flag. Returns `None` if the bytes are invalid.
#[allow(clippy::option_option)]
fn read_layer(reader: &mut ByteReader<'_>, counts: u8) -> Option<Option<LayerMove>> {
    if counts & MOVES_LAYER == 0 {
        return Some(None);
    }
    Some(Some(match reader.u8()? {
        flags if flags & !START_FLAGS == 0 => LayerMove::Start {
            start: reader.signed32()?,
            lowest: reader.signed32()?,
            pierce: reader.signed32()?,
            cut: reader.signed32()?,
            sheet: read_sheet(reader, flags)?,
            control: {
                let mut control = HeightControls::default();
                if flags & HAS_CONTROL != 0 {
                    let told = read_height_control(reader)?;
                    // a card without height control refuses it
                    *control.first_mut()? = told;
                }
                control
            },
        },
        1 => LayerMove::OverSheet { height: reader.signed32()?, highest: reader.signed32()? },
        2 => LayerMove::To { layer: reader.signed32()? },
        _ => return None,
    }))
}

fn read_instruction(reader: &mut ByteReader<'_>) -> Option<Instruction> {
    let (number, place) = (reader.u32()?, RecordIndex::new(reader.u32()?));
    let (periods, counts) = (reader.count32()?, reader.u8()?);
    let count = counts & !FLAGS;
    let changes = read_changes(reader, count)?;
    let (until, layer) = (read_until(reader, counts)?, read_layer(reader, counts)?);
    let (keeps_cutter, spindle) = (counts & KEEPS_CUTTER != 0, read_spindle_task(reader, counts)?);
    Some(Instruction { number, place, changes, count, periods, until, keeps_cutter, layer, spindle })
}

fn read_repeated(reader: &mut ByteReader<'_>) -> Option<RepeatedInstruction> {
    let (number, periods, counts) = (reader.u32()?, reader.count32()?, reader.u8()?);
    if counts & SPINDLE != 0 {
        return None;
    }
    let count = counts & !FLAGS;
    let changes = read_changes(reader, count)?;
    let (until, layer) = (read_until(reader, counts)?, read_layer(reader, counts)?);
    Some(RepeatedInstruction { number, changes, count, periods, until, is_pulse: counts & KEEPS_CUTTER != 0, layer })
}

fn read_changes(reader: &mut ByteReader<'_>, count: u8) -> Option<[OutputChange; MAX_CHANGES]> {
    let mut changes = [OutputChange::default(); MAX_CHANGES];
    for change in changes.get_mut(..usize::from(count))? {
        *change = read_change(reader)?;
    }
    Some(changes)
}

/// Reads the awaited input, if the count of changes has its flag. Returns `None` if the bytes are cut short.
#[allow(clippy::option_option)]
fn read_until(reader: &mut ByteReader<'_>, counts: u8) -> Option<Option<InputWait>> {
    if counts & AWAITS == 0 {
        return Some(None);
    }
    let (input, timeout_periods) = (reader.u8()?, reader.count32()?);
    let ignition = if input & IGNITES == 0 {
        None
    } else {
        Some(Ignition {
            stable_periods: reader.count16()?,
            attempts: reader.u8()?,
            retry_periods: reader.count16()?,
            delay_periods: reader.count32()?,
        })
    };
    Some(Some(InputWait {
        input: input & AWAITED_INPUT,
        active: input & AWAITED_ACTIVE != 0,
        timeout_periods,
        ignition,
    }))
}

fn write_homing(writer: &mut ByteWriter<'_>, homing: &HomingCommand) -> Option<()> {
    writer.u8(homing.axis | u8::from(homing.upper) << 7)?;
    writer.signed(homing.search_speed)?;
    writer.signed(homing.latch_speed)?;
    writer.signed(homing.acceleration)?;
    writer.count(u64::from(homing.max_travel))?;
    writer.signed(homing.count)
}

fn read_homing(reader: &mut ByteReader<'_>) -> Option<HomingCommand> {
    let axis = reader.u8()?;
    Some(HomingCommand {
        axis: axis & 0x7F,
        upper: axis & 0x80 != 0,
        search_speed: reader.signed()?,
        latch_speed: reader.signed()?,
        acceleration: reader.signed()?,
        max_travel: reader.count32()?,
        count: reader.signed()?,
    })
}
