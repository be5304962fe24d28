//! The search for a kerf where a torch is to pierce: over a kerf no arc strikes (CUT-38).
//!
//! The history is searched backward from the place where the cut goes on, and then forward, some records in each
//! control period, while the machine is on its way or waits for the arc.
//!
//! Invariant: the search moves nothing and allocates nothing; the operator is warned once a start.

use retrace_config::CutterKind;
use retrace_core::RecordIndex;
use retrace_link::MotionCard;

use super::Session;
use super::lead_in::USUAL_KERF_MM;
use crate::event::EventKind;

/// Records searched per control period.
const RECORDS_A_PERIOD: u32 = 4096;

/// A search for a kerf in X and Y.
#[derive(Clone, Copy, Debug)]
pub(super) struct KerfSearch {
    axes: [usize; 2],
    /// Counts where the torch is to pierce.
    start: [i64; 2],
    /// Half the width of a kerf, mm.
    half_mm: f64,
    /// Where the search began, with its counts.
    origin: (RecordIndex, [i64; 2]),
    /// Where it is, with its counts.
    at: (RecordIndex, [i64; 2]),
    is_forward: bool,
}

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Begins to search for a kerf where this cutter is to pierce, if it is a torch: at these counts, which are given
    /// as those of the place where the cut goes on, and of the start.
    pub(super) fn begin_kerf_search(&mut self, fire: u8, (join, join_counts): (RecordIndex, [i64; A])) {
        self.recovery.kerf_search = None;
        let is_torch = self.recovery.cutter(fire).is_some_and(|cutter| cutter.kind == CutterKind::Torch);
        let Some(axes) = self.recovery.plane_axes().filter(|_| is_torch && !self.config.inhibits_outputs) else {
            return;
        };
        let half_mm = 0.5 * self.recovery.kerf_mm().unwrap_or(USUAL_KERF_MM);
        let join_counts = axes.map(|axis| join_counts[axis]);
        let mut start = join_counts;
        for (plane, axis) in axes.into_iter().enumerate() {
            start[plane] += (self.recovery.lead.shift_mm[plane] / self.config.mm_per_pulse[axis]).round() as i64;
        }
        let origin = (join, join_counts);
        self.recovery.kerf_search = Some(KerfSearch { axes, start, half_mm, origin, at: origin, is_forward: false });
    }

    /// Continues the search, and warns where it finds a kerf.
    pub(super) fn advance_kerf_search(&mut self) {
        let Some(mut search) = self.recovery.kerf_search else { return };
        for _ in 0..RECORDS_A_PERIOD {
            let record = if search.is_forward { search.at.0 } else { search.at.0 - 1 };
            let is_known = search.is_forward || !record.is_before(self.streamer.oldest_recorded());
            let Some(found) = self.streamer.record(record).filter(|_| is_known) else {
                self.recovery.kerf_search =
                    (!search.is_forward).then_some(KerfSearch { at: search.origin, is_forward: true, ..search });
                return;
            };
            let (mut counts, sign) = (search.at.1, if search.is_forward { 1 } else { -1 });
            let mm = |plane: usize, counts: [i64; 2]| {
                (counts[plane] - search.start[plane]) as f64 * self.config.mm_per_pulse[search.axes[plane]]
            };
            let is_near = mm(0, counts).hypot(mm(1, counts)) < search.half_mm;
            if is_near && self.cut_map.is_cut(record) {
                self.recovery.kerf_search = None;
                self.emit(EventKind::StartInKerf);
                return;
            }
            for (count, axis) in counts.iter_mut().zip(search.axes) {
                *count += sign * i64::from(found.increments[axis]);
            }
            search.at = (if search.is_forward { record + 1 } else { record }, counts);
        }
        self.recovery.kerf_search = Some(search);
    }
}
