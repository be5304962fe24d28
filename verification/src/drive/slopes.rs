//! Slopes of the commanded rate over drawn records, judged from the places alone.
//!
//! Invariant: only a native run calls this.

use super::SOFT;
use crate::choice::{Choice, ONE};
use crate::ledger::Size;
use crate::native::Draw;
use retrace_core::drive::{Braking, Drive, RecordWindow};
use retrace_core::limits::RateLimits;
use retrace_core::{Place, RapidCap, Rate, RecordIndex};

/// For any requests at any time, a change of the commanded rate times the speed of any record that the cursor reaches
/// while that change is in its average is within the axis' acceleration, or within the slope that is legal anywhere.
/// Checked from the places alone.
pub(super) fn slopes_leave_room(size: Size) -> String {
    let mut draw = Draw::new(size.seed);
    let (runs, mut judged) = (if size.full { 4000 } else { 400 }, 0u64);
    for _ in 0..runs {
        let limits = RateLimits::new(2 * draw.below(16) as u16 + 3, 20_000 + 1000 * draw.below(40) as u16, [SOFT]);
        let limits = limits.expect("valid");
        let least = Braking::<32>::new(&limits).expect("fast enough");
        let window = Wavy::any(&mut draw);
        let mut drive = Drive::<1, 64>::new(limits).expect("fits");
        let (mut at, mut track) = (Place::start_of(RecordIndex::new(40)), Vec::new());
        while track.len() < 3000 {
            let target = Rate::from_units([ONE, 0, ONE / 3, -ONE, -ONE / 2][draw.below(5) as usize]);
            for _ in 0..=draw.below(200) {
                let commanded = at.moved(drive.lead());
                at = drive.step(at, target, &window).to;
                track.push((at, commanded.distance_to(at.moved(drive.lead())).units()));
            }
        }
        let average = usize::from(limits.average());
        for (i, change) in track.windows(2).map(|pair| pair[1].1 - pair[0].1).enumerate() {
            let fastest = track[i + 1..].iter().take(average).map(|(at, _)| window.speed(*at)).max().unwrap_or(0);
            let (room, slope) = (16 * (3 << 32), least.slope(Rate::from_units(track[i].1.abs().min(ONE)), 16).units());
            let leaves_room = change.abs() * (fastest - 1).max(0) <= room + room / 100;
            assert!(leaves_room || change.abs() <= slope + 3, "{change} at {fastest}/16 pulses, run {:?}", track[i]);
            judged += 1;
        }
    }
    format!("{judged} periods of {runs} drawn runs")
}

/// Records whose increments rise and fall as an axis may.
struct Wavy(Vec<i16>);

impl Wavy {
    fn any(draw: &mut Draw) -> Self {
        let (mut increments, mut speed, mut change) = (Vec::new(), draw.between(-90, 90), 0);
        while increments.len() < 600 {
            change = (change + draw.between(-1, 1)).clamp(-2, 2);
            for _ in 0..=draw.below(30) {
                speed = (speed + change).clamp(-100, 100);
                increments.push(speed as i16);
            }
        }
        Self(increments)
    }

    /// Pulses in the sixteen records around that place, from one multiple of eight to another.
    fn speed(&self, at: Place) -> i64 {
        let first = (at.record.number() as usize / 8 * 8).min(self.0.len() - 16);
        self.0[first..first + 16].iter().map(|&i| i64::from(i)).sum::<i64>().abs()
    }
}

impl RecordWindow<1> for Wavy {
    fn low(&self) -> RecordIndex {
        RecordIndex::new(0)
    }
    fn high(&self) -> RecordIndex {
        RecordIndex::new(self.0.len() as u32)
    }
    fn rests_at(&self, _: RecordIndex) -> bool {
        false
    }
    fn cap(&self, _: RecordIndex) -> RapidCap {
        RapidCap::PLANNED
    }
    fn increments(&self, place: RecordIndex) -> [i16; 1] {
        [self.0[place.number() as usize]]
    }
    fn is_rapid(&self, _: RecordIndex) -> bool {
        false
    }
}
