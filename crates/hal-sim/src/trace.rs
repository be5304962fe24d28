//! Trace of a simulated card for a wave viewer: every edge on every step and direction wire, outputs, inputs, and
//! positions.
//!
//! Invariant: a file is complete up to the last flush; if the program ends, only what was written after it is lost.

use std::io::{self, Write};

use retrace_card::Edge;
use retrace_link::{CardStatus, channel};

use crate::pins::PinEdge;
use crate::vcd::{Signal, Vcd};

#[derive(Clone, Copy, Debug)]
struct AxisSignals {
    step: Signal,
    backward: Signal,
    count: Signal,
}

#[derive(Clone, Copy, Debug)]
struct CardSignals {
    place: Signal,
    rate: Signal,
    line: Signal,
    layer: Signal,
    at_rest: Signal,
    executed: Signal,
    alarm: Signal,
    inputs: Signal,
    beam_power: Signal,
}

/// A trace being written.
#[derive(Debug)]
pub struct Trace<W: Write, const A: usize> {
    vcd: Vcd<W>,
    axes: [AxisSignals; A],
    card: CardSignals,
    /// Each channel and its signal.
    outputs: Vec<(u8, Signal)>,
}

impl<W: Write, const A: usize> Trace<W, A> {
    /// Begins a trace of all axes, with these names as far as there are any.
    ///
    /// # Errors
    /// The error of the writer.
    pub fn new(out: W, names: &[String]) -> io::Result<Self> {
        let mut vcd = Vcd::new(out)?;
        let mut axes = Vec::with_capacity(A);
        for number in 0..A {
            let name = &names.get(number).cloned().unwrap_or_else(|| format!("axis{number}"));
            axes.push(AxisSignals {
                step: vcd.signal(name, "step", 1)?,
                backward: vcd.signal(name, "backward", 1)?,
                count: vcd.signal(name, "count", 64)?,
            });
        }
        let card = CardSignals {
            place: vcd.real("card", "place")?,
            rate: vcd.real("card", "rate")?,
            line: vcd.signal("card", "line", 32)?,
            at_rest: vcd.signal("card", "at_rest", 1)?,
            executed: vcd.signal("card", "executed", 32)?,
            alarm: vcd.signal("card", "alarm", 8)?,
            inputs: vcd.signal("card", "inputs", 16)?,
            layer: vcd.real("card", "layer")?,
            beam_power: vcd.signal("card", "beam_power", 32)?,
        };
        let mut outputs = Vec::with_capacity(channel::COUNT);
        for number in (0..channel::COUNT as u8).filter(|&number| channel::is_output(number)) {
            let signal = match number {
                channel::SPINDLE => vcd.signal("outputs", "spindle", 32)?,
                channel::SPEED => vcd.signal("outputs", "speed", 32)?,
                channel::MIST => vcd.signal("outputs", "mist", 1)?,
                channel::FLOOD => vcd.signal("outputs", "flood", 1)?,
                channel::TOOL => vcd.signal("outputs", "tool", 32)?,
                channel::UNWATCHED => vcd.signal("outputs", "unwatched", 1)?,
                analog if channel::is_analog(analog) => {
                    vcd.signal("outputs", &format!("analog{}", analog - channel::ANALOG), 32)?
                }
                digital => vcd.signal("outputs", &format!("out{digital}"), 1)?,
            };
            outputs.push((number, signal));
        }
        vcd.begin()?;
        let axes: [AxisSignals; A] = axes.try_into().map_err(|_| io::ErrorKind::InvalidData)?;
        for axis in &axes {
            vcd.set(0, axis.step, 0)?;
            vcd.set(0, axis.backward, 0)?;
        }
        Ok(Self { vcd, axes, card, outputs })
    }

    /// Writes a control period that began at `at_ns`: the card's status and its edges in order, in ticks of a clock of
    /// `tick_hz`.
    ///
    /// # Errors
    /// The error of the writer.
    pub fn period(&mut self, at_ns: u64, status: &CardStatus<A>, edges: &[PinEdge], tick_hz: u32) -> io::Result<()> {
        let (vcd, card) = (&mut self.vcd, &self.card);
        let place = f64::from(status.place.record.number()) + status.place.fraction_of_record();
        vcd.set_real(at_ns, card.place, place)?;
        vcd.set_real(at_ns, card.rate, f64::from(status.rate))?;
        vcd.set(at_ns, card.line, u64::from(status.line))?;
        vcd.set_real(at_ns, card.layer, f64::from(status.layer))?;
        vcd.set(at_ns, card.at_rest, u64::from(status.at_rest))?;
        vcd.set(at_ns, card.executed, u64::from(status.executed))?;
        vcd.set(at_ns, card.alarm, status.alarm.map_or(0, |alarm| u64::from(alarm.to_wire().0)))?;
        vcd.set(at_ns, card.inputs, u64::from(status.inputs))?;
        vcd.set(at_ns, card.beam_power, u64::from(status.beam_power as u32))?;
        for &(number, signal) in &self.outputs {
            vcd.set(at_ns, signal, status.outputs[usize::from(number)] as u32 as u64)?;
        }
        for (axis, &count) in self.axes.iter().zip(&status.counts) {
            vcd.set(at_ns, axis.count, count as u64)?;
        }
        for edge in edges {
            let at = at_ns + u64::from(edge.tick) * 1_000_000_000 / u64::from(tick_hz.max(1));
            let axis = &self.axes[usize::from(edge.axis) % A];
            match edge.edge {
                Edge::Direction { backward } => vcd.set(at, axis.backward, u64::from(backward))?,
                Edge::Rise => vcd.set(at, axis.step, 1)?,
                Edge::Fall => vcd.set(at, axis.step, 0)?,
            }
        }
        Ok(())
    }

    /// Flushes the writer.
    ///
    /// # Errors
    /// The error of the writer.
    pub fn flush(&mut self) -> io::Result<()> {
        self.vcd.flush()
    }
}
