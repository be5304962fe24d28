//! Holding the height where the torch comes to a kerf that was cut (CUT-53).
//!
//! Invariant: the map has what the card reports to have been cut, so that a kerf that a loss or a skipped contour left
//! uncut holds nothing, and one that a recovery cut does. Where it is in doubt, on a lead-in, the height is held. The
//! card holds it at its place on the path; only the end of a hold needs the computer.

use retrace_core::{Rate, RecordIndex};
use retrace_link::{CardStatus, HostCommand, MotionCard, OutputAction, channel};

use crate::kerf_map::{FlatPlace, cell_of, distance_mm};
use crate::session::Session;

/// Time in s that a command may take to the card.
const COMMAND_S: f64 = 0.1;
/// Most records ahead that are looked at.
const MAX_AHEAD: u32 = 4096;
/// Number of periods after which all records that the card has are looked at again.
const PERIODS_BETWEEN_LOOKS: u32 = 8;

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Maps where a cutter burns, and holds the height from one kerf before a kerf that was cut to one behind it.
    pub(in crate::session) fn watch_kerfs(&mut self, status: &CardStatus<A>) {
        let Some(axes) = self.recovery.plane_axes().filter(|_| self.cut_map.kerfs.kerf_mm().is_some()) else { return };
        let mm_per_pulse = axes.map(|axis| self.config.mm_per_pulse[axis]);
        let mm = |counts: [i64; 2]| [0, 1].map(|at| counts[at] as f64 * mm_per_pulse[at]);
        let here = mm(axes.map(|axis| status.counts[axis]));
        let mut lit =
            self.config.fire_channels.iter().filter(|&&fire| status.outputs[usize::from(fire)] != 0).peekable();
        let is_lit = lit.peek().is_some();
        if lit.any(|&fire| self.is_proven(fire, status)) && status.rate != Rate::ZERO {
            self.cut_map.kerfs.burn(here);
        } else {
            self.cut_map.kerfs.pause();
        }
        let moved = mm(axes.map(|axis| i64::from(status.increments[axis])));
        let is_behind = self.cut_map.kerfs.follow(here, distance_mm([0.0; 2], moved));
        let comes = is_lit && (is_behind || self.is_on_lead_in() || self.comes_to_kerf(status, axes, here));
        self.hold_over_kerf(comes, status);
        if is_lit && !comes {
            self.order_hold_ahead(status, axes, here);
        } else {
            self.height.hold_ahead = None;
        }
    }

    /// Whether the path ahead comes to a kerf in the time in which the height comes to rest, and one kerf more; earlier
    /// by the time of a command, unless the card holds the height by itself there.
    fn comes_to_kerf(&self, status: &CardStatus<A>, axes: [usize; 2], here: FlatPlace) -> bool {
        let (now, command) = (status.place.record, self.records_in(COMMAND_S, status));
        self.hold_before_kerf(status, axes, here, command).is_some_and(|records| {
            let is_in_time = |place: RecordIndex| now.is_before(place) && !(now + records).is_before(place);
            records == 0 || (records <= command && !self.height.hold_ahead.is_some_and(is_in_time))
        })
    }

    /// Orders the hold at its place on the path, as far ahead as the card has records, so that it comes there whatever
    /// the computer does meanwhile. One that has come needs the computer to end it.
    fn order_hold_ahead(&mut self, status: &CardStatus<A>, axes: [usize; 2], here: FlatPlace) {
        let now = status.place.record;
        let is_ordered = self.height.hold_ahead.is_some_and(|place| now.is_before(place));
        if is_ordered || self.height.is_off || !now.number().is_multiple_of(PERIODS_BETWEEN_LOOKS) {
            return;
        }
        let held = self.card.acknowledged_high().since(now);
        let Some(records) = self.hold_before_kerf(status, axes, here, held) else { return };
        let place = now + records;
        let before = status.outputs[usize::from(channel::HEIGHT_OFFSET)];
        let hold = OutputAction { place, channel: channel::HEIGHT_OFFSET, before, after: channel::HEIGHT_STAYS };
        if place.is_before(self.card.acknowledged_high()) && self.card.send(HostCommand::Action(hold)).is_ok() {
            self.height.hold_ahead = Some(place);
        }
    }

    /// Number of records after which the height has to be held, so that it is at rest one kerf before the next kerf on
    /// the path. None where that is more than `most`.
    fn hold_before_kerf(&self, status: &CardStatus<A>, axes: [usize; 2], here: FlatPlace, most: u32) -> Option<u32> {
        let kerf_mm = self.cut_map.kerfs.kerf_mm()?;
        let rest_s = self.recovery.machine().height_control()?.rest_s();
        let rest = self.records_in(rest_s, status);
        let end = self.streamer.next_exclusive();
        let length_of = |n: u32| {
            let index = status.place.record + n;
            let record = self.streamer.record(index).filter(|_| end.is_none_or(|end| index.is_before(end)))?;
            Some(axes.map(|axis| f64::from(record.increments[axis]) * self.config.mm_per_pulse[axis]))
        };
        // The place that is one kerf before the one that is looked at, and the length of the path between them. Each
        // cell is looked at once, so that the result is the same place from wherever the search begins.
        let (mut at, mut cell, mut before, mut between_mm) = (here, None, 0, 0.0);
        for n in 0..MAX_AHEAD {
            let moved = length_of(n)?;
            let length_mm = distance_mm([0.0; 2], moved);
            at = [at[0] + moved[0], at[1] + moved[1]];
            between_mm += length_mm;
            while between_mm > kerf_mm {
                between_mm -= distance_mm([0.0; 2], length_of(before)?);
                before += 1;
            }
            if before > rest.saturating_add(most) {
                return None;
            }
            if cell.replace(cell_of(at)) != Some(cell_of(at)) && self.cut_map.kerfs.is_near(at) {
                return Some(before.saturating_sub(rest));
            }
        }
        None
    }

    /// Number of records that are passed in a time, at an override above 100 % too.
    fn records_in(&self, time_s: f64, status: &CardStatus<A>) -> u32 {
        (time_s / self.config.period_s * f64::from(status.rate).max(1.0)).ceil() as u32
    }
}
