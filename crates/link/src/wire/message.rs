//! The words of the stream (host to card).
//!
//! Invariant: a word that does not fit leaves writer and run as they were.

use super::record::RECORD;
use super::{Reader, Run, Writer};
use crate::{Action, Await, Change, Homing, Instruction, MAX_CHANGES, Word};

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
}

/// Writes a word behind the others of a payload. `None` where there is no room, or for a rate, which has a frame of its own.
pub fn write_word<const A: usize>(writer: &mut Writer<'_>, run: &mut Run<A>, word: &Word<A>) -> Option<()> {
    let (length, was) = (writer.len(), *run);
    let written = write(writer, run, word);
    if written.is_none() {
        writer.back_to(length);
        *run = was;
    }
    written
}

fn write<const A: usize>(writer: &mut Writer<'_>, run: &mut Run<A>, word: &Word<A>) -> Option<()> {
    match word {
        Word::Ahead { place, record } => {
            place_of(writer, run, *place, false)?;
            run.write(writer, record, false, false)
        }
        Word::Behind { place, record, rests } => {
            place_of(writer, run, *place, true)?;
            run.write(writer, record, true, *rests)
        }
        Word::Trim { high } => {
            writer.u8(tag::TRIM)?;
            writer.u32(*high)
        }
        Word::Forget { low } => {
            writer.u8(tag::FORGET)?;
            writer.u32(*low)
        }
        Word::Action(action) => {
            writer.u8(tag::ACTION)?;
            writer.u32(action.place)?;
            writer.u8(action.channel)?;
            writer.signed(i64::from(action.before))?;
            writer.signed(i64::from(action.after))
        }
        Word::Rate { .. } => None,
        Word::Replay { on } => {
            writer.u8(tag::REPLAY)?;
            writer.u8(u8::from(*on))
        }
        Word::Instruction(instruction) => {
            writer.u8(tag::INSTRUCTION)?;
            write_instruction(writer, instruction)
        }
        Word::ByHand(change) => {
            writer.u8(tag::BY_HAND)?;
            write_change(writer, *change)
        }
        Word::ClearAlarm => writer.u8(tag::CLEAR_ALARM),
        Word::Home(homing) => {
            writer.u8(tag::HOME)?;
            write_homing(writer, homing)
        }
    }
}

fn place_of<const A: usize>(writer: &mut Writer<'_>, run: &mut Run<A>, place: u32, behind: bool) -> Option<()> {
    if run.needs_place(place, behind) {
        writer.u8(if behind { tag::PLACE_BEHIND } else { tag::PLACE_AHEAD })?;
        writer.u32(place)?;
        run.set_place(place, behind);
    }
    Some(())
}

/// Reads the next word of a payload. `None` where the bytes are none: the rest of the payload is not to be trusted then.
pub fn read_word<const A: usize>(reader: &mut Reader<'_>, run: &mut Run<A>) -> Option<Word<A>> {
    loop {
        return Some(match reader.u8()? {
            record if record & RECORD != 0 => return run.read(reader, record),
            tag::PLACE_AHEAD => {
                run.set_place(reader.u32()?, false);
                continue;
            }
            tag::PLACE_BEHIND => {
                run.set_place(reader.u32()?, true);
                continue;
            }
            tag::TRIM => Word::Trim { high: reader.u32()? },
            tag::FORGET => Word::Forget { low: reader.u32()? },
            tag::ACTION => {
                let (place, channel) = (reader.u32()?, reader.u8()?);
                Word::Action(Action { place, channel, before: reader.signed32()?, after: reader.signed32()? })
            }
            tag::REPLAY => Word::Replay { on: reader.u8()? != 0 },
            tag::INSTRUCTION => Word::Instruction(read_instruction(reader)?),
            tag::BY_HAND => Word::ByHand(read_change(reader)?),
            tag::CLEAR_ALARM => Word::ClearAlarm,
            tag::HOME => Word::Home(read_homing(reader)?),
            _ => return None,
        });
    }
}

pub(super) fn write_change(writer: &mut Writer<'_>, change: Change) -> Option<()> {
    writer.u8(change.channel)?;
    writer.signed(i64::from(change.value))
}

pub(super) fn read_change(reader: &mut Reader<'_>) -> Option<Change> {
    Some(Change { channel: reader.u8()?, value: reader.signed32()? })
}

fn write_instruction(writer: &mut Writer<'_>, instruction: &Instruction) -> Option<()> {
    writer.u32(instruction.number)?;
    writer.u32(instruction.place)?;
    writer.count(u64::from(instruction.periods))?;
    let awaits = instruction.until.is_some();
    writer.u8(instruction.changes().len() as u8 | u8::from(awaits) << 7)?;
    instruction.changes().iter().try_for_each(|&change| write_change(writer, change))?;
    if let Some(Await { input, active, at_most }) = instruction.until {
        writer.u8(input | u8::from(active) << 7)?;
        writer.count(u64::from(at_most))?;
    }
    Some(())
}

fn read_instruction(reader: &mut Reader<'_>) -> Option<Instruction> {
    let (number, place, periods, counts) = (reader.u32()?, reader.u32()?, reader.count32()?, reader.u8()?);
    let mut instruction = Instruction { number, place, periods, count: counts & 0x7F, ..Instruction::default() };
    if usize::from(instruction.count) > MAX_CHANGES {
        return None;
    }
    for change in &mut instruction.changes[..usize::from(instruction.count)] {
        *change = read_change(reader)?;
    }
    if counts & 0x80 != 0 {
        let input = reader.u8()?;
        instruction.until = Some(Await { input: input & 0x7F, active: input & 0x80 != 0, at_most: reader.count32()? });
    }
    Some(instruction)
}

fn write_homing(writer: &mut Writer<'_>, homing: &Homing) -> Option<()> {
    writer.u8(homing.axis | u8::from(homing.upper) << 7)?;
    writer.signed(homing.fast)?;
    writer.signed(homing.slow)?;
    writer.signed(homing.acceleration)?;
    writer.count(u64::from(homing.farthest))?;
    writer.signed(homing.count)
}

fn read_homing(reader: &mut Reader<'_>) -> Option<Homing> {
    let axis = reader.u8()?;
    Some(Homing {
        axis: axis & 0x7F,
        upper: axis & 0x80 != 0,
        fast: reader.signed()?,
        slow: reader.signed()?,
        acceleration: reader.signed()?,
        farthest: reader.count32()?,
        count: reader.signed()?,
    })
}
