//! Entries of a card's reports, in the order in which the events happened.
//!
//! ```text
//! kind in three bits; of periods: t t s r n   t t: they ran 0, +1, −1, or a rate that follows; s: starved; r: at rest
//! after;
//!                                             n: more than one; how many follows
//! ```
//!
//! Invariant: an entry is self-contained. Events of a period precede the entry of that period.

use retrace_core::{Distance, Place, RecordIndex};

use super::{ByteReader, ByteWriter};
use crate::{ANALOG_INPUTS, Alarm, CutterOff, CutterOffCause, GearState, HeightState, OutputChange, ProbeEdge};

/// One reported event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ReportEntry {
    /// Control periods, all alike.
    Ran {
        /// Distance that the cursor moved in each.
        distance: Distance,
        /// Number of periods.
        count: u32,
        /// Whether the rate was limited by the end of the window.
        starved: bool,
        /// Whether the cursor was at rest afterwards.
        at_rest: bool,
    },
    /// An output changed.
    Output(OutputChange),
    /// The instruction of this number is complete.
    Executed(u32),
    /// The latched alarm changed.
    Alarm(Option<Alarm>),
    /// The active inputs.
    Inputs(u16),
    /// Counts of the handwheel in the period.
    Wheel(i16),
    /// The instruction of this number was rejected: it will never be executed.
    Refused(u32),
    /// Cutting outputs that the permit switched off.
    CutterOff(CutterOff),
    /// The repeated instruction of this number is complete.
    Repeated(u32),
    /// Whether motion is blocked until a restart is complete.
    Blocked(bool),
    /// The repeated instruction of this number was rejected: it will never be executed.
    RepeatRefused(u32),
    /// The layer, where it rests.
    Layer(i32),
    /// The latch of the probe is armed; an edge that was reported before counts no more.
    ProbeArmed,
    /// The probe's first edge.
    ProbeEdge(ProbeEdge),
    /// The edge counts: the probe has touched, and the card brakes.
    ProbeTouched,
    /// Measured speed of the spindle, in thousandths of a revolution per minute.
    SpindleSpeed(i32),
    /// Reading of an analog input.
    AnalogInput {
        /// Number of the input, below [`ANALOG_INPUTS`].
        number: u8,
        /// Reading in units of 2⁻¹⁶ of the range; `None` where the input has none, such as that of a silent module.
        reading: Option<u16>,
    },
    /// State of the control of the height.
    Height(HeightState),
    /// The gear.
    Gear {
        /// Its state.
        state: GearState,
        /// Largest lag of the stretch, in units of 2⁻¹⁶ records.
        largest_lag: u32,
        /// Stretches that were armed again in this epoch, modulo 256.
        armed_again: u8,
    },
}

impl ReportEntry {
    /// No period. Its memory is all zeros, so that an array of it needs no flash.
    pub const NOTHING: Self = Self::Ran { distance: Distance::ZERO, count: 0, starved: false, at_rest: false };
}

const RAN: u8 = 0;
const OUTPUT: u8 = 1;
const EXECUTED: u8 = 2;
const ALARM: u8 = 3;
const INPUTS: u8 = 4;
const WHEEL: u8 = 5;
const REFUSED: u8 = 6;
/// The next byte is the kind: 00–1F are for cutting, 20–2F for probing, 30–3F for the spindle,
/// 40 for analog inputs.
const EXTENDED: u8 = 7;

mod extended {
    pub(super) const CUTTER_OFF: u8 = 0x00;
    pub(super) const REPEATED: u8 = 0x01;
    pub(super) const BLOCKED: u8 = 0x02;
    pub(super) const REPEAT_REFUSED: u8 = 0x03;
    pub(super) const LAYER: u8 = 0x04;
    pub(super) const HEIGHT: u8 = 0x05;
    pub(super) const PROBE_ARMED: u8 = 0x20;
    pub(super) const PROBE_EDGE: u8 = 0x21;
    pub(super) const PROBE_TOUCHED: u8 = 0x22;
    pub(super) const PROBE_EDGE_EARLIER: u8 = 0x23;
    pub(super) const SPINDLE_SPEED: u8 = 0x30;
    pub(super) const GEAR: u8 = 0x31;
    pub(super) const ANALOG_INPUT: u8 = 0x40;
    /// An analog input without a reading.
    pub(super) const NO_READING: u8 = 0x41;
}

const STARVED: u8 = 1 << 5;
const AT_REST: u8 = 1 << 6;
const MANY: u8 = 1 << 7;

impl ReportEntry {
    /// Writes the entry. Returns `None` and writes nothing if there is no space.
    pub fn write(&self, writer: &mut ByteWriter<'_>) -> Option<()> {
        let length = writer.len();
        let written = self.write_parts(writer);
        if written.is_none() {
            writer.truncate(length);
        }
        written
    }

    fn write_parts(&self, writer: &mut ByteWriter<'_>) -> Option<()> {
        match *self {
            Self::Ran { distance, count, starved, at_rest } => {
                let how = match distance {
                    Distance::ZERO => 0,
                    Distance::RECORD => 1,
                    BACK => 2,
                    _ => 3,
                };
                let flag = |flag: u8, so: bool| if so { flag } else { 0 };
                writer.u8(RAN | how << 3 | flag(STARVED, starved) | flag(AT_REST, at_rest) | flag(MANY, count != 1))?;
                if how == 3 {
                    writer.signed(distance.units())?;
                }
                if count != 1 {
                    writer.count(u64::from(count))?;
                }
                Some(())
            }
            Self::Output(change) => {
                writer.u8(OUTPUT)?;
                super::message::write_change(writer, change)
            }
            Self::Executed(number) => {
                writer.u8(EXECUTED)?;
                writer.u32(number)
            }
            Self::Alarm(alarm) => {
                writer.u8(ALARM)?;
                write_alarm(writer, alarm)
            }
            Self::Inputs(inputs) => {
                writer.u8(INPUTS)?;
                writer.u16(inputs)
            }
            Self::Wheel(counts) => {
                writer.u8(WHEEL)?;
                writer.signed(i64::from(counts))
            }
            Self::Refused(number) => {
                writer.u8(REFUSED)?;
                writer.u32(number)
            }
            Self::CutterOff(off) => {
                writer.slice(&[EXTENDED, extended::CUTTER_OFF, off.channels, off.cause.to_wire()])?;
                writer.u32(off.place.record.number())?;
                writer.u32(off.place.fraction)
            }
            Self::Repeated(number) => {
                writer.slice(&[EXTENDED, extended::REPEATED])?;
                writer.u32(number)
            }
            Self::Blocked(blocked) => writer.slice(&[EXTENDED, extended::BLOCKED, u8::from(blocked)]),
            Self::RepeatRefused(number) => {
                writer.slice(&[EXTENDED, extended::REPEAT_REFUSED])?;
                writer.u32(number)
            }
            Self::Layer(layer) => {
                writer.slice(&[EXTENDED, extended::LAYER])?;
                writer.signed(i64::from(layer))
            }
            Self::Height(state) => writer.slice(&[EXTENDED, extended::HEIGHT, state.to_wire()]),
            Self::ProbeArmed => writer.slice(&[EXTENDED, extended::PROBE_ARMED]),
            Self::ProbeEdge(ProbeEdge { is_period_earlier, part }) => {
                let code = if is_period_earlier { extended::PROBE_EDGE_EARLIER } else { extended::PROBE_EDGE };
                writer.slice(&[EXTENDED, code])?;
                writer.u16(part)
            }
            Self::ProbeTouched => writer.slice(&[EXTENDED, extended::PROBE_TOUCHED]),
            Self::SpindleSpeed(speed) => {
                writer.slice(&[EXTENDED, extended::SPINDLE_SPEED])?;
                writer.signed(i64::from(speed))
            }
            Self::AnalogInput { number, reading: None } => writer.slice(&[EXTENDED, extended::NO_READING, number]),
            Self::AnalogInput { number, reading: Some(reading) } => {
                writer.slice(&[EXTENDED, extended::ANALOG_INPUT, number])?;
                writer.u16(reading)
            }
            Self::Gear { state, largest_lag, armed_again } => {
                let state = match state {
                    GearState::Off => 0,
                    GearState::Waiting => 1,
                    GearState::Engaged => 2,
                    GearState::Freed => 3,
                };
                writer.slice(&[EXTENDED, extended::GEAR, state, armed_again])?;
                writer.count(u64::from(largest_lag))
            }
        }
    }

    /// Reads an entry; `None` if the bytes are not an entry.
    pub fn read(reader: &mut ByteReader<'_>) -> Option<Self> {
        let tag = reader.u8()?;
        Some(match tag & 7 {
            RAN => {
                let distance = match tag >> 3 & 3 {
                    0 => Distance::ZERO,
                    1 => Distance::RECORD,
                    2 => BACK,
                    _ => Distance::from_units(reader.signed()?),
                };
                let count = if tag & MANY != 0 { reader.count32()? } else { 1 };
                let within = distance.units().unsigned_abs() <= MAX_DISTANCE && count > 0;
                return within.then_some(Self::Ran {
                    distance,
                    count,
                    starved: tag & STARVED != 0,
                    at_rest: tag & AT_REST != 0,
                });
            }
            OUTPUT => Self::Output(super::message::read_change(reader)?),
            EXECUTED => Self::Executed(reader.u32()?),
            ALARM => Self::Alarm(read_alarm(reader)?),
            INPUTS => Self::Inputs(reader.u16()?),
            WHEEL => Self::Wheel(i16::try_from(reader.signed()?).ok()?),
            REFUSED => Self::Refused(reader.u32()?),
            _ => return Self::read_extended(reader),
        })
    }

    fn read_extended(reader: &mut ByteReader<'_>) -> Option<Self> {
        Some(match reader.u8()? {
            extended::CUTTER_OFF => {
                let (channels, cause) = (reader.u8()?, CutterOffCause::from_wire(reader.u8()?)?);
                let place = Place { record: RecordIndex::new(reader.u32()?), fraction: reader.u32()? };
                Self::CutterOff(CutterOff { channels, cause, place })
            }
            extended::REPEATED => Self::Repeated(reader.u32()?),
            extended::BLOCKED => Self::Blocked(reader.u8()? != 0),
            extended::REPEAT_REFUSED => Self::RepeatRefused(reader.u32()?),
            extended::LAYER => Self::Layer(reader.signed32()?),
            extended::HEIGHT => Self::Height(HeightState::from_wire(reader.u8()?)?),
            extended::PROBE_ARMED => Self::ProbeArmed,
            code @ (extended::PROBE_EDGE | extended::PROBE_EDGE_EARLIER) => Self::ProbeEdge(ProbeEdge {
                is_period_earlier: code == extended::PROBE_EDGE_EARLIER,
                part: reader.u16()?,
            }),
            extended::PROBE_TOUCHED => Self::ProbeTouched,
            extended::SPINDLE_SPEED => Self::SpindleSpeed(reader.signed32()?),
            code @ (extended::ANALOG_INPUT | extended::NO_READING) => {
                let number = reader.u8()?;
                let reading = if code == extended::ANALOG_INPUT { Some(reader.u16()?) } else { None };
                (0..ANALOG_INPUTS).contains(&usize::from(number)).then_some(Self::AnalogInput { number, reading })?
            }
            extended::GEAR => {
                let state = match reader.u8()? {
                    0 => GearState::Off,
                    1 => GearState::Waiting,
                    2 => GearState::Engaged,
                    3 => GearState::Freed,
                    _ => return None,
                };
                let armed_again = reader.u8()?;
                Self::Gear { state, largest_lag: reader.count32()?, armed_again }
            }
            _ => return None,
        })
    }
}

const BACK: Distance = Distance::records(-1);
/// Maximum distance of a cursor in a period: eight records, and a little for rounding.
const MAX_DISTANCE: u64 = 9 << 32;

pub(super) fn write_alarm(writer: &mut ByteWriter<'_>, alarm: Option<Alarm>) -> Option<()> {
    let (code, detail) = alarm.map_or((0, 0), Alarm::to_wire);
    writer.u8(code)?;
    if code == 0 { Some(()) } else { writer.u32(detail) }
}

pub(super) fn read_alarm(reader: &mut ByteReader<'_>) -> Option<Option<Alarm>> {
    match reader.u8()? {
        0 => Some(None),
        code => Some(Some(Alarm::from_wire(code, reader.u32()?)?)),
    }
}
