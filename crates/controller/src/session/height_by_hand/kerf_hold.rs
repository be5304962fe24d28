//! Holding the height where the torch comes to a kerf that was cut (CUT-53).
//!
//! Invariant: the map has what the card reports to have been cut, so that a kerf that a loss or a skipped contour left
//! uncut holds nothing, and one that a recovery cut does. Where it is in doubt, on a lead-in, the height is held.

use retrace_core::{Rate, Record};
use retrace_link::{CardStatus, MotionCard};

use crate::kerf_map::{FlatPlace, distance_mm};
use crate::session::Session;

/// Time in s that a command may take to the card.
const COMMAND_S: f64 = 0.1;
/// Most records ahead that are looked at.
const MAX_AHEAD: u32 = 4096;

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
        let holds = is_lit && (is_behind || self.is_on_lead_in() || self.comes_to_kerf(status, axes, here));
        self.hold_over_kerf(holds);
    }

    /// Whether the path ahead comes to a kerf in the time in which the height comes to rest, and one kerf more.
    fn comes_to_kerf(&self, status: &CardStatus<A>, axes: [usize; 2], here: FlatPlace) -> bool {
        let (Some(kerf_mm), Some(control)) = (self.cut_map.kerfs.kerf_mm(), self.recovery.machine().height_control())
        else {
            return false;
        };
        let records = ((control.rest_s() + COMMAND_S) / self.config.period_s).ceil() as u32;
        let end = self.streamer.next_exclusive();
        let (mut at, mut beyond_mm, mut since_mm) = (here, 0.0, f64::INFINITY);
        for n in 0..MAX_AHEAD {
            let index = status.place.record + n;
            let record = self.streamer.record(index).filter(|_| end.is_none_or(|end| index.is_before(end)));
            let Some(Record { increments, .. }) = record else { return false };
            let moved = axes.map(|axis| f64::from(increments[axis]) * self.config.mm_per_pulse[axis]);
            let length_mm = distance_mm([0.0; 2], moved);
            (at, since_mm) = ([at[0] + moved[0], at[1] + moved[1]], since_mm + length_mm);
            if since_mm >= 0.25 * kerf_mm {
                since_mm = 0.0;
                if self.cut_map.kerfs.is_near(at) {
                    return true;
                }
            }
            if n >= records {
                beyond_mm += length_mm;
            }
            if beyond_mm > kerf_mm {
                return false;
            }
        }
        false
    }
}
