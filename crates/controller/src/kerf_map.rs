//! The kerfs that were cut, in the plane of X and Y: a torch that comes to one does not follow its voltage (CUT-53).
//!
//! Invariant: a place is near a kerf only where a cutter burnt within one kerf of it, in this run of the job or, as far
//! as the journal has it, before. Nothing allocates after the start.

use std::collections::VecDeque;

use retrace_core::RecordIndex;
use retrace_journal::RecordRanges;

/// Width of a cell, mm.
const CELL_MM: f64 = 0.75;
/// Greatest width of a kerf, mm; a wider one counts as such.
const MAX_KERF_MM: f64 = 10.0;
/// Maximum number of tiles of 8 by 8 cells: about a kilometre of cuts. What is cut beyond it is not known.
const MAX_TILES: usize = 1 << 18;
/// Widths of a kerf along the path, behind which the same contour counts as cut before.
const APART: f64 = 3.0;
/// Most places of the path within that distance, which are half a kerf or a cell apart.
const MAX_RECENT: usize = 16;

/// A place in X and Y, mm.
pub(crate) type FlatPlace = [f64; 2];

/// Cells that are closer than one kerf to a cut, and the end of the cut that is being made.
#[derive(Clone, Debug)]
pub(crate) struct KerfMap {
    /// Tiles with their cells, one bit each, by the hash of their place; empty without height control.
    tiles: Vec<(u64, u64)>,
    used: usize,
    /// Places of this contour that are too near behind the torch to be crossed, with the length up to each, mm.
    recent: VecDeque<(FlatPlace, f64)>,
    /// Length of all cuts so far, mm.
    length_mm: f64,
    /// Where the cutter burnt last, while it burns.
    burns_at: Option<FlatPlace>,
    /// Width of the kerf that is being cut; 0 where the height is not controlled.
    kerf_mm: f64,
    /// Length of the path since a kerf was last near, mm.
    since_near_mm: f64,
}

impl KerfMap {
    /// Creates an empty map. It needs memory only where the height is controlled.
    pub(crate) fn new(controls_height: bool) -> Self {
        Self {
            tiles: vec![(0, 0); if controls_height { MAX_TILES } else { 0 }],
            used: 0,
            recent: VecDeque::with_capacity(if controls_height { MAX_RECENT } else { 0 }),
            length_mm: 0.0,
            burns_at: None,
            kerf_mm: 0.0,
            since_near_mm: f64::INFINITY,
        }
    }

    /// Width of the kerf that is being cut, mm; `None` where no kerf is looked for.
    pub(crate) fn kerf_mm(&self) -> Option<f64> {
        Some(self.kerf_mm).filter(|&mm| mm > 0.0 && !self.tiles.is_empty())
    }

    /// Begins a contour with a kerf of this width, µm; 0: the height is not controlled, and its kerf is as wide as the
    /// last one.
    pub(crate) fn begin_contour(&mut self, kerf_um: u32) {
        self.pause();
        while let Some((at, _)) = self.recent.pop_front() {
            self.insert_around(at);
        }
        self.since_near_mm = f64::INFINITY;
        self.kerf_mm = (f64::from(kerf_um) / 1000.0).min(MAX_KERF_MM);
    }

    /// The cutter burns here, and has since the last place that was given, if it burnt there.
    pub(crate) fn burn(&mut self, at: FlatPlace) {
        let Some(kerf_mm) = self.kerf_mm() else { return };
        let is_going_on = self.burns_at.is_some();
        let from = self.burns_at.replace(at).unwrap_or(at);
        let length_mm = distance_mm(from, at);
        let spacing_mm = self.spacing_mm();
        let end_mm = self.length_mm + length_mm;
        // What begins elsewhere is entered from there on.
        let last = self.recent.back().filter(|&&(last, _)| is_going_on || distance_mm(last, from) < spacing_mm);
        let last_mm = last.map_or(f64::NEG_INFINITY, |&(_, mm)| mm);
        let mut next_mm = (last_mm + spacing_mm).max(self.length_mm);
        while next_mm <= end_mm {
            let share = if length_mm > 0.0 { (next_mm - self.length_mm) / length_mm } else { 1.0 };
            self.pass_by(next_mm - APART * kerf_mm);
            self.recent.push_back((between(from, at, share), next_mm));
            next_mm += spacing_mm;
        }
        self.length_mm = end_mm;
        self.pass_by(end_mm - APART * kerf_mm);
    }

    /// The cutter does not burn: where it did last is the end of the cut so far.
    pub(crate) fn pause(&mut self) {
        let Some(at) = self.burns_at.take() else { return };
        let is_entered = self.recent.back().is_some_and(|&(_, mm)| mm >= self.length_mm);
        if self.kerf_mm().is_some() && !is_entered {
            self.pass_by(self.length_mm - APART * self.kerf_mm);
            self.recent.push_back((at, self.length_mm));
        }
    }

    /// The torch has moved by this length: whether it is closer than one kerf behind a place near a kerf.
    pub(crate) fn follow(&mut self, at: FlatPlace, moved_mm: f64) -> bool {
        self.since_near_mm = if self.is_near(at) { 0.0 } else { self.since_near_mm + moved_mm };
        self.since_near_mm <= self.kerf_mm
    }

    /// Whether a place is closer than one kerf to one that was cut.
    pub(crate) fn is_near(&self, at: FlatPlace) -> bool {
        let (tile, bit) = tile_of(cell_of(at));
        self.slot(tile).is_some_and(|slot| self.tiles[slot].1 & bit != 0)
    }

    /// Enters what was cut up to this length.
    fn pass_by(&mut self, length_mm: f64) {
        while let Some(&(at, mm)) = self.recent.front()
            && (mm <= length_mm || self.recent.len() == MAX_RECENT)
        {
            self.recent.pop_front();
            self.insert_around(at);
        }
    }

    /// Enters the cells that have a place closer than one kerf to the cut around a place, as far as the next ones.
    fn insert_around(&mut self, at: FlatPlace) {
        let within_mm = self.kerf_mm.hypot(0.5 * self.spacing_mm()) + CELL_MM * std::f64::consts::FRAC_1_SQRT_2;
        let reach = (within_mm / CELL_MM).ceil() as i32;
        let [x, y] = cell_of(at);
        for cell in (-reach..=reach).flat_map(|dx| (-reach..=reach).map(move |dy| [x + dx, y + dy])) {
            let centre = cell.map(|n| (f64::from(n) + 0.5) * CELL_MM);
            if distance_mm(centre, at) < within_mm {
                self.insert(cell);
            }
        }
    }

    /// Distance of the places that are entered, along the cut, mm.
    fn spacing_mm(&self) -> f64 {
        (0.5 * self.kerf_mm).max(CELL_MM)
    }

    fn insert(&mut self, cell: [i32; 2]) {
        let (tile, bit) = tile_of(cell);
        let Some(slot) = self.slot(tile) else { return };
        if self.tiles[slot].1 == 0 {
            // A search has to end: some tiles stay free.
            if self.used >= MAX_TILES / 8 * 7 {
                return;
            }
            self.used += 1;
        }
        self.tiles[slot] = (tile, self.tiles[slot].1 | bit);
    }

    /// Where this tile is, or would be.
    fn slot(&self, tile: u64) -> Option<usize> {
        let mask = self.tiles.len().checked_sub(1)?;
        let first = (tile.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as usize;
        (first..=first + mask).map(|slot| slot & mask).find(|&slot| {
            let (of, cells) = self.tiles[slot];
            cells == 0 || of == tile
        })
    }
}

/// The kerfs of a job that is resumed: its plan is replayed over what the journal has of the cuts.
pub(crate) struct KerfReplay<'s> {
    pub(crate) map: &'s mut KerfMap,
    /// X and Y, with the length of a pulse, mm.
    pub(crate) axes: Option<[(usize, f64); 2]>,
    pub(crate) cut: &'s RecordRanges,
}

impl KerfReplay<'_> {
    /// Passes a start of a cutter.
    pub(crate) fn begin_contour(&mut self, kerf_um: u32) {
        self.map.begin_contour(kerf_um);
    }

    /// Passes a record; `counts` are those behind it.
    pub(crate) fn pass(&mut self, record: RecordIndex, counts: &[i64]) {
        let Some(axes) = self.axes.filter(|_| self.map.kerf_mm().is_some()) else { return };
        if self.cut.contains(record) {
            self.map.burn(axes.map(|(axis, mm)| counts[axis] as f64 * mm));
        } else {
            self.map.pause();
        }
    }
}

/// The cell of a place: all places in it are equally near to a kerf.
pub(crate) fn cell_of(at: FlatPlace) -> [i32; 2] {
    at.map(|mm| (mm / CELL_MM).floor() as i32)
}

/// The tile of a cell, and its bit there.
fn tile_of([x, y]: [i32; 2]) -> (u64, u64) {
    let tile = u64::from((x >> 3) as u32) << 32 | u64::from((y >> 3) as u32);
    (tile, 1 << ((x & 7) | (y & 7) << 3))
}

pub(crate) fn distance_mm(from: FlatPlace, to: FlatPlace) -> f64 {
    (to[0] - from[0]).hypot(to[1] - from[1])
}

fn between(from: FlatPlace, to: FlatPlace, share: f64) -> FlatPlace {
    [0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    /// Cuts along these places; the first is the pierce.
    fn cut(map: &mut KerfMap, kerf_um: u32, places: impl IntoIterator<Item = FlatPlace>) {
        map.begin_contour(kerf_um);
        places.into_iter().for_each(|at| map.burn(at));
        map.pause();
    }

    fn line(from: FlatPlace, to: FlatPlace) -> Vec<FlatPlace> {
        let steps = (distance_mm(from, to) / 0.05).ceil() as u32;
        (0..=steps).map(|n| between(from, to, f64::from(n) / f64::from(steps))).collect()
    }

    #[test]
    fn what_was_not_cut_is_no_kerf() {
        let mut map = KerfMap::new(true);
        // The arc was lost from 20 mm to 40 mm.
        map.begin_contour(1500);
        line([0.0, 0.0], [20.0, 0.0]).into_iter().for_each(|at| map.burn(at));
        map.pause();
        line([40.0, 0.0], [60.0, 0.0]).into_iter().for_each(|at| map.burn(at));
        map.begin_contour(1500);
        for (x, near) in [(-3.0, false), (0.0, true), (19.0, true), (23.0, false), (37.0, false), (41.0, true)] {
            assert_eq!(map.is_near([x, 0.0]), near, "{x}");
        }
        // A recovery cuts the rest.
        cut(&mut map, 1500, line([20.0, 0.0], [40.0, 0.0]));
        map.begin_contour(1500);
        assert!([23.0, 30.0, 37.0].iter().all(|&x| map.is_near([x, 0.0])));
    }

    #[test]
    fn the_end_of_a_cut_is_part_of_its_kerf() {
        for end in 0..40 {
            let (length_mm, (sin, cos)) = (20.0 + f64::from(end) / 20.0, (TAU * f64::from(end) / 39.0).sin_cos());
            let mut map = KerfMap::new(true);
            cut(&mut map, 1400, line([0.0, 0.0], [length_mm * cos, length_mm * sin]));
            map.begin_contour(1400);
            let [behind, beside] = [[length_mm + 1.39, 0.0], [length_mm, 1.39]];
            assert!([behind, beside].iter().all(|[x, y]| map.is_near([x * cos - y * sin, x * sin + y * cos])), "{end}");
        }
    }

    #[test]
    fn a_cut_that_goes_on_elsewhere_is_known_from_there_on() {
        for begin in 0..40 {
            let mut map = KerfMap::new(true);
            map.begin_contour(1400);
            let x = 30.0 + f64::from(begin) / 20.0;
            for piece in [line([0.0, 0.0], [20.3, 0.0]), line([x, 0.0], [x + 20.0, 0.0])] {
                piece.into_iter().for_each(|at| map.burn(at));
                map.pause();
            }
            map.begin_contour(1400);
            assert!(map.is_near([x - 1.4, 0.0]) && map.is_near([x, 1.4]), "{x}");
        }
    }

    #[test]
    fn a_contour_meets_its_own_beginning_and_not_its_end() {
        let mut map = KerfMap::new(true);
        map.begin_contour(1500);
        let circle = |turns: f64| [20.0 * (TAU * turns).cos(), 20.0 * (TAU * turns).sin()];
        for step in 0..=2000 {
            let turns = f64::from(step) / 2000.0;
            map.burn(circle(turns));
            let ahead = [0.5, 1.5, 3.0, 5.0].map(|mm| map.is_near(circle(turns + mm / 20.0 / TAU)));
            // 5 mm before the beginning its kerf is near.
            let length_mm = 20.0 * TAU * turns;
            if length_mm < 20.0 * TAU - 8.0 {
                assert_eq!(ahead, [false; 4], "{length_mm}");
            } else if length_mm > 20.0 * TAU - 5.0 && length_mm < 20.0 * TAU {
                assert!(ahead[3], "{length_mm}");
            }
        }
    }

    #[test]
    fn where_no_height_is_controlled_nothing_is_known() {
        let mut map = KerfMap::new(true);
        cut(&mut map, 0, line([0.0, 0.0], [50.0, 0.0]));
        map.begin_contour(1500);
        assert!(!map.is_near([25.0, 0.0]));
        let mut map = KerfMap::new(false);
        cut(&mut map, 1500, line([0.0, 0.0], [50.0, 0.0]));
        assert!(map.kerf_mm().is_none() && !map.is_near([25.0, 0.0]));
    }

    proptest! {
        /// However fast the torch is: within one kerf of a cut it is near, beyond one and two cells it is not.
        #[test]
        fn the_kerf_is_near_within_its_width(
            steps in prop::collection::vec(0.001..2.0f64, 20..80), kerf in 0.8..6.0f64, angle in 0.0..TAU,
            places in prop::collection::vec((0.0..1.0f64, -20.0..20.0f64), 100),
        ) {
            let mut map = KerfMap::new(true);
            let at = |along: f64, aside: f64| {
                [along * angle.cos() - aside * angle.sin() - 7.0, along * angle.sin() + aside * angle.cos() + 3.0]
            };
            let mut end = 0.0;
            let path: Vec<FlatPlace> = steps.iter().map(|step| { end += step; at(end, 0.0) }).collect();
            cut(&mut map, (kerf * 1000.0) as u32, path);
            map.begin_contour(1500);
            for (share, aside) in places {
                let along = steps[0] + share * (end - steps[0]);
                if aside.abs() < kerf {
                    prop_assert!(map.is_near(at(along, aside)), "{} {}", along, aside);
                } else if aside.abs() > kerf + 2.0 * CELL_MM {
                    prop_assert!(!map.is_near(at(along, aside)), "{} {}", along, aside);
                }
            }
        }
    }
}
