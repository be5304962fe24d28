//! The map of what was really cut, and the contours of the program with what is missing of each (CUT-26 … CUT-28).
//!
//! A record is cut where the cutter burnt in every control period that executed a part of it; what was cut stays cut.
//! A contour reaches from the place where the program lights the cutter to that where it switches it off.
//!
//! Invariant: the ranges are disjoint and in the order of the path; a contour that is executed again keeps its number.
//! Nothing allocates after the start.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use retrace_config::MachineConfig;
use retrace_core::{Distance, Place, RecordIndex};
use retrace_gcode::Side;
use retrace_journal::RecordRanges;

use crate::contour_list::RestoredContour;
use crate::kerf_map::KerfMap;

/// Most ranges that are retained, and most contours. Beyond them the oldest are forgotten.
const MAX_RANGES: usize = 4096;
/// Records in a row that count as none: an input is debounced, and an arc strikes within a period.
const UNNOTICED_RECORDS: u32 = 3;

/// A contour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Contour {
    /// Its number in the program, from 1.
    pub(super) number: u32,
    /// Program line that lights the cutter.
    pub(super) line: u32,
    /// Channel of the cutter.
    pub(super) channel: u8,
    /// Where it begins.
    pub(super) pierce: RecordIndex,
    /// Where it ends, once the program has switched the cutter off.
    pub(super) end: Option<RecordIndex>,
    /// Length that is not cut, µm, as it was when the contour ended last.
    pub(super) not_cut_um: u64,
    /// Length that is cut, nm: a place that is cut twice counts once.
    cut_nm: u64,
    /// Side of the contour on which the tool is, where cutter compensation was on in it.
    pub(super) compensation: Option<Side>,
}

impl Contour {
    /// Length that is cut, µm.
    pub(super) const fn cut_um(&self) -> u64 {
        self.cut_nm / 1000
    }

    /// The contour as the observers are told of it where the job is resumed.
    fn restored(&self) -> RestoredContour {
        let [cut_mm, not_cut_mm] = [self.cut_um(), self.not_cut_um].map(|um| um as f64 / 1000.0);
        let not_cut_mm = self.end.map(|_| not_cut_mm);
        RestoredContour { number: self.number, line: self.line, cut_mm, not_cut_mm }
    }
}

/// What is not cut of some contours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct NotCut {
    /// Length in µm.
    pub(super) um: u64,
    /// Number of those contours of which something is not cut.
    pub(super) contours: u32,
}

impl NotCut {
    /// This, and that of one more contour.
    fn and(self, contour: &Contour) -> Self {
        Self { um: self.um + contour.not_cut_um, contours: self.contours + u32::from(contour.not_cut_um > 0) }
    }
}

/// What is cut of a contour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ContourProgress {
    /// Nothing at its beginning.
    NotBegun,
    /// From its pierce to this place; what is behind is not cut, or only in parts.
    CutUpTo(RecordIndex),
    /// All of it.
    Whole,
}

/// What was cut, and the contours.
#[derive(Clone, Debug)]
pub(super) struct CutMap {
    /// What is cut, but for the last stretch.
    ranges: RecordRanges,
    /// The last stretch in which the cutter burnt without a break.
    stretch: Option<[Place; 2]>,
    contours: Vec<Contour>,
    /// What is not cut of the contours that were forgotten.
    forgotten: NotCut,
    /// Number of contours of the program before the first one, where the job begins within it.
    skipped: Arc<AtomicU32>,
    /// Number of the last contour of the program that was begun.
    last_number: u32,
    /// Number of contours that were begun.
    begun: u32,
    /// Index of the contour that is being cut.
    current: Option<usize>,
    /// Side of cutter compensation in force.
    compensation: Option<Side>,
    /// Contours that were begun before the job was left.
    restored: Vec<RestoredContour>,
    burning: Burning,
    /// Where it was cut.
    pub(super) kerfs: KerfMap,
}

/// Whether a cutter burnt in the last control period.
#[derive(Clone, Copy, Debug)]
pub(super) enum Burning {
    No,
    Yes,
    /// Its output is on and its input inactive in this motion, for less than it takes to be lost.
    Flickers(CutMotion),
}

/// Motion with a cutter on.
#[derive(Clone, Copy, Debug)]
pub(super) struct CutMotion {
    pub(super) from: Place,
    pub(super) length_mm: f64,
}

impl CutMotion {
    /// Both, one behind the other.
    pub(super) const fn followed_by(self, next: Self) -> Self {
        Self { from: self.from, length_mm: self.length_mm + next.length_mm }
    }
}

impl CutMap {
    /// Creates an empty map. It needs memory only where the machine has a cutter.
    pub(super) fn new(has_cutter: bool) -> Self {
        let capacity = if has_cutter { MAX_RANGES } else { 0 };
        Self {
            ranges: RecordRanges::with_room_for(capacity),
            stretch: None,
            contours: Vec::with_capacity(capacity),
            forgotten: NotCut::default(),
            skipped: Arc::default(),
            last_number: 0,
            begun: 0,
            current: None,
            compensation: None,
            restored: Vec::new(),
            burning: Burning::No,
            kerfs: KerfMap::new(false),
        }
    }

    /// Creates an empty map for a machine, with its kerfs where the height is controlled.
    pub(super) fn of_machine(machine: &MachineConfig) -> Self {
        let kerfs = KerfMap::new(machine.height_control().is_some());
        Self { kerfs, ..Self::new(!machine.cutting_outputs.is_empty()) }
    }

    /// Sets where the number of contours is found that the program has before the first one of the job.
    pub(super) fn number_from(&mut self, skipped: Arc<AtomicU32>) {
        self.skipped = skipped;
    }

    /// Whether the record that ends at this place, or in which it lies, is known to be cut.
    fn is_cut_before(&self, place: Place) -> bool {
        let in_stretch = |[begin, end]: [Place; 2]| {
            begin.distance_to(place) > Distance::ZERO && place.distance_to(end) >= Distance::ZERO
        };
        let record = if place.fraction == 0 { place.record - 1 } else { place.record };
        self.stretch.is_some_and(in_stretch) || self.ranges.contains(record)
    }

    /// Records a control period in which the cutter burnt, from this place to that; `length_mm` is the length of the
    /// motion. Returns whether it was not cut before.
    pub(super) fn record_cut(&mut self, from: Place, to: Place, length_mm: f64) -> bool {
        let is_new = !self.is_cut_before(to);
        if is_new && let Some(contour) = self.current.and_then(|index| self.contours.get_mut(index)) {
            contour.cut_nm += (length_mm * 1e6).round() as u64;
        }
        self.burning = Burning::Yes;
        let is_within = |[begin, end]: [Place; 2]| {
            begin.distance_to(from) >= Distance::ZERO && from.distance_to(end) >= Distance::ZERO
        };
        match self.stretch.filter(|&stretch| is_within(stretch)) {
            Some([begin, end]) => {
                let end = if end.distance_to(to) > Distance::ZERO { to } else { end };
                self.stretch = Some([begin, end]);
            }
            None => {
                self.store_stretch();
                self.stretch = Some([from, to]);
            }
        }
        is_new
    }

    /// Stores the whole records of the last stretch. The stretch may go on afterwards.
    fn store_stretch(&mut self) {
        if let Some([from, to]) = self.stretch {
            self.ranges.insert(from.boundary_ahead(), to.record);
        }
    }

    /// Records that a lost cutter has burnt from this place to that, `length_um` in length.
    pub(super) fn record_burnt(&mut self, from: Place, to: Place, length_um: u64) {
        if let Some(contour) = self.current.and_then(|index| self.contours.get_mut(index)) {
            contour.cut_nm += length_um * 1000;
        }
        // It is cut before the first place, and behind the last one.
        self.ranges.insert(from.record, to.boundary_ahead());
    }

    /// Where the stretch begins in which the cutter burns; `None` where it did not burn in the last control period.
    pub(super) fn burns_from(&self) -> Option<Place> {
        self.stretch.filter(|_| matches!(self.burning, Burning::Yes)).map(|[begin, _]| begin)
    }

    /// Begins a control period: whether the cutter burnt in the one before. In this one it does not, so far.
    pub(super) const fn take_burning(&mut self) -> Burning {
        std::mem::replace(&mut self.burning, Burning::No)
    }

    /// The output is on and its input inactive in this motion; `before` is the state before it.
    pub(super) const fn record_flicker(&mut self, before: Burning, moved: CutMotion) {
        self.burning = match before {
            Burning::No => Burning::No,
            Burning::Yes => Burning::Flickers(moved),
            Burning::Flickers(since) => Burning::Flickers(since.followed_by(moved)),
        };
    }

    /// Length in µm of the stretches of records between two places that are not cut; `length_um` measures records.
    fn not_cut_um(&mut self, begin: RecordIndex, end: RecordIndex, length_um: impl Fn(RecordIndex, u32) -> u64) -> u64 {
        self.store_stretch();
        let (mut at, mut sum_um) = (begin, 0);
        let ends = self.ranges.reaching_beyond(begin).filter(|[from, _]| from.is_before(end)).chain([[end, end]]);
        for [from, to] in ends {
            if at.is_before(from) && from.since(at) >= UNNOTICED_RECORDS {
                sum_um += length_um(at, from.since(at));
            }
            at = RecordIndex::later(at, to);
        }
        sum_um
    }

    /// Cutter compensation is on from here, on this side, or off.
    pub(super) fn record_compensation(&mut self, side: Option<Side>) {
        self.compensation = side;
        if let Some(contour) = self.current.and_then(|index| self.contours.get_mut(index)) {
            contour.compensation = contour.compensation.or(side);
        }
    }

    /// Number of the contour that begins at this place, or will be the next one that is begun.
    pub(super) fn number_at(&self, pierce: RecordIndex) -> u32 {
        let begun = self.contours.iter().rev().find(|contour| contour.pierce == pierce);
        begun.map_or_else(|| self.next_number(), |contour| contour.number)
    }

    /// Number of the contour that will be begun next for the first time.
    pub(super) fn next_number(&self) -> u32 {
        let last = if self.last_number == 0 { self.skipped.load(Ordering::Acquire) } else { self.last_number };
        last + 1
    }

    /// The program has lit the cutter before the record at `pierce`.
    pub(super) fn begin_contour(&mut self, pierce: RecordIndex, line: u32, channel: u8) {
        self.current = self.contours.iter().rposition(|contour| contour.pierce == pierce);
        if self.current.is_none() {
            if self.contours.len() == MAX_RANGES {
                let forgotten = self.contours.remove(0);
                self.forgotten = self.forgotten.and(&forgotten);
            }
            if self.last_number == 0 {
                self.last_number = self.skipped.load(Ordering::Acquire);
            }
            self.last_number += 1;
            self.begun += 1;
            let number = self.last_number;
            let compensation = self.compensation;
            let contour = Contour { number, line, channel, pierce, end: None, not_cut_um: 0, cut_nm: 0, compensation };
            self.contours.push(contour);
            self.current = Some(self.contours.len() - 1);
        }
    }

    /// Takes the kerfs out of it.
    pub(super) fn take_kerfs(&mut self) -> KerfMap {
        std::mem::replace(&mut self.kerfs, KerfMap::new(false))
    }

    /// Begins to execute again without motion what was executed before the job was left: `cut` is what was cut of it.
    pub(super) fn begin_restoring(&mut self, cut: &RecordRanges) {
        self.ranges = cut.clone();
    }

    /// Sets what is cut of the contour that was begun at this place and ends at that.
    pub(super) fn restore_contour(
        &mut self,
        pierce: RecordIndex,
        end: RecordIndex,
        length_um: impl Fn(RecordIndex, u32) -> u64,
    ) {
        let cut = self.ranges.reaching_beyond(pierce).take_while(|[from, _]| from.is_before(end));
        let each = cut.map(|[from, to]| {
            let (from, to) = (RecordIndex::later(from, pierce), if to.is_before(end) { to } else { end });
            length_um(from, to.since(from))
        });
        let cut_um: u64 = each.sum();
        if let Some(contour) = self.contours.iter_mut().rev().find(|contour| contour.pierce == pierce) {
            contour.cut_nm = cut_um * 1000;
            self.restored.push(contour.restored());
        }
    }

    /// Ends the execution without motion, at the furthest place; `cut` and `length_um` are those of the others.
    pub(super) fn end_restoring(
        &mut self,
        cut: &RecordRanges,
        reached: RecordIndex,
        length_um: impl Fn(RecordIndex, u32) -> u64,
    ) {
        if let Some(pierce) = self.current().map(|contour| contour.pierce) {
            self.restore_contour(pierce, reached, length_um);
        }
        self.ranges = RecordRanges::with_room_for(MAX_RANGES);
        self.ranges.restore(cut);
    }

    /// The contours that were begun before the job was left, once.
    pub(super) fn take_restored(&mut self) -> Vec<RestoredContour> {
        std::mem::take(&mut self.restored)
    }

    /// The program is executed again from this place: the contour in which it lies has not ended yet.
    pub(super) fn reopen_contour(&mut self, place: Place) {
        let is_open_at = |contour: &Contour| {
            let from_pierce = Place::start_of(contour.pierce).distance_to(place);
            let is_before_end = |end| place.distance_to(Place::start_of(end)) > Distance::ZERO;
            from_pierce >= Distance::ZERO && contour.end.is_none_or(is_before_end)
        };
        self.current = self.contours.iter().rposition(is_open_at);
    }

    /// The program has switched the cutter off before the record at `end`; `length_um` measures records. Returns the
    /// contour.
    pub(super) fn end_contour(
        &mut self,
        end: RecordIndex,
        length_um: impl Fn(RecordIndex, u32) -> u64,
    ) -> Option<Contour> {
        let index = self.current.take()?;
        self.measure(index, end, length_um)?;
        let contour = self.contours.get_mut(index)?;
        contour.end = Some(end);
        Some(*contour)
    }

    /// Measures the contour that is being cut up to a place, at the end of the job.
    pub(super) fn measure_current(&mut self, end: RecordIndex, length_um: impl Fn(RecordIndex, u32) -> u64) {
        if let Some(index) = self.current {
            let _ = self.measure(index, end, length_um);
        }
    }

    fn measure(&mut self, index: usize, end: RecordIndex, length_um: impl Fn(RecordIndex, u32) -> u64) -> Option<()> {
        let pierce = self.contours.get(index)?.pierce;
        let not_cut = self.not_cut_um(pierce, end, length_um);
        self.contours.get_mut(index)?.not_cut_um = not_cut;
        Some(())
    }

    /// Whether this place lies in a contour that has ended and is cut from here to its end.
    pub(super) fn is_cut_to_its_end(&mut self, place: Place) -> bool {
        let is_in = |contour: &&Contour| {
            let from_pierce = Place::start_of(contour.pierce).distance_to(place);
            let to_end = contour.end.map_or(Distance::ZERO, |end| place.distance_to(Place::start_of(end)));
            from_pierce >= Distance::ZERO && to_end > Distance::ZERO
        };
        let Some(end) = self.contours.iter().rev().find(is_in).and_then(|contour| contour.end) else { return false };
        self.not_cut_um(place.boundary_ahead(), end, |_, records| u64::from(records)) == 0
    }

    /// Where the contour ends that is being cut, if it was executed to its end before.
    pub(super) fn current_end(&self) -> Option<RecordIndex> {
        self.current.and_then(|index| self.contours.get(index))?.end
    }

    /// The contour of this number, if it was begun.
    pub(super) fn contour(&self, number: u32) -> Option<Contour> {
        self.contours.iter().find(|contour| contour.number == number).copied()
    }

    /// What is cut of the contour that begins at this place; `None` if none was begun there.
    pub(super) fn progress_at(&mut self, pierce: RecordIndex) -> Option<(Contour, ContourProgress)> {
        let contour = self.contours.iter().rev().find(|contour| contour.pierce == pierce).copied()?;
        Some((contour, self.progress_of(&contour)))
    }

    /// What is cut of a contour.
    pub(super) fn progress_of(&mut self, contour: &Contour) -> ContourProgress {
        self.store_stretch();
        let is_open = |end: RecordIndex, at: RecordIndex| at.is_before(end) && end.since(at) >= UNNOTICED_RECORDS;
        let mut at = contour.pierce;
        for [from, to] in self.ranges.reaching_beyond(contour.pierce) {
            if is_open(from, at) {
                break;
            }
            at = RecordIndex::later(at, to);
        }
        if contour.end.is_some_and(|end| !is_open(end, at)) {
            ContourProgress::Whole
        } else if at == contour.pierce {
            ContourProgress::NotBegun
        } else {
            ContourProgress::CutUpTo(at)
        }
    }

    /// Stretches that are cut and begin behind this place, which is not: where each begins, and ends.
    pub(super) fn stretches_behind(&mut self, place: RecordIndex) -> impl Iterator<Item = [RecordIndex; 2]> {
        self.store_stretch();
        self.ranges.reaching_beyond(place).filter(move |[begin, _]| place.is_before(*begin))
    }

    /// Whether this record is cut.
    pub(super) fn is_cut(&mut self, record: RecordIndex) -> bool {
        self.store_stretch();
        self.ranges.contains(record)
    }

    /// Whether a contour is being cut: its cutter was lit, and not switched off by the program yet.
    pub(super) const fn is_in_contour(&self) -> bool {
        self.current.is_some()
    }

    /// The contour that is being cut.
    pub(super) fn current(&self) -> Option<&Contour> {
        self.current.and_then(|index| self.contours.get(index))
    }

    /// The contours that were begun.
    pub(super) fn contours(&self) -> &[Contour] {
        &self.contours
    }

    /// Number of the contour that is being cut, or was cut last; 0 before the first.
    pub(super) fn current_number(&self) -> u32 {
        self.current().map_or(self.last_number, |contour| contour.number)
    }

    /// Number of contours that were begun, and length that is not cut of all, µm.
    pub(super) fn totals(&self) -> (u32, NotCut) {
        (self.begun, self.contours.iter().fold(self.forgotten, NotCut::and))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn place(eighths: u64) -> Place {
        Place {
            record: RecordIndex::new(4_294_967_200u32.wrapping_add((eighths / 8) as u32)),
            fraction: ((eighths % 8) << 29) as u32,
        }
    }

    proptest! {
        /// Any stretches: a record is cut exactly where one of them, or one that was continued, covers it.
        #[test]
        fn a_record_is_cut_where_it_was_cut_without_a_break(
            stretches in prop::collection::vec((0u64..1600, 1u64..200), 1..30),
        ) {
            let mut map = CutMap::new(true);
            let mut covered = Vec::new();
            let mut last: Option<[u64; 2]> = None;
            for (from, length) in stretches {
                let to = from + length;
                // in several periods
                map.record_cut(place(from), place(from + length / 2), 0.0);
                map.record_cut(place(from + length / 2), place(to), 0.0);
                let joined = last.filter(|&[begin, end]| (begin..=end).contains(&from));
                let stretch = joined.map_or([from, to], |[begin, end]| [begin, end.max(to)]);
                if joined.is_some() {
                    covered.pop();
                }
                covered.push(stretch);
                last = Some(stretch);
            }
            for record in 0..230u64 {
                let at = place(8 * record).record;
                let is_cut = covered.iter().any(|&[from, to]| from <= 8 * record && 8 * record + 8 <= to);
                prop_assert_eq!(map.is_cut(at), is_cut, "record {}", record);
            }
        }
    }

    /// The report counts what is not cut of contours that are no longer retained.
    #[test]
    fn a_contour_that_is_forgotten_stays_not_cut() {
        let (mut map, contours) = (CutMap::new(true), MAX_RANGES as u32 + 100);
        for number in 0..contours {
            let pierce = RecordIndex::new(number * 20);
            map.begin_contour(pierce, 7, 64);
            map.record_cut(Place::start_of(pierce), Place::start_of(pierce + if number < 3 { 10 } else { 20 }), 1.0);
            map.end_contour(pierce + 20, |_, records| u64::from(records) * 10).expect("it was begun");
        }
        assert_eq!(map.totals(), (contours, NotCut { um: 300, contours: 3 }));
    }

    /// Where an arc was lost and strikes again up to where the lost one was switched off, nothing is missing.
    #[test]
    fn what_a_lost_arc_has_burnt_is_cut() {
        let (mut map, at) = (CutMap::new(true), |n: u32| RecordIndex::new(n));
        map.begin_contour(at(0), 7, 64);
        map.record_cut(Place::start_of(at(0)), Place { record: at(50), fraction: 1 << 31 }, 0.505);
        let struck = Place { record: at(60), fraction: 1 << 31 };
        map.record_cut(struck, Place::start_of(at(100)), 0.395);
        map.record_burnt(Place { record: at(50), fraction: 1 << 31 }, struck, 100);
        let contour = map.end_contour(at(100), |_, records| u64::from(records) * 10).expect("it was begun");
        assert_eq!((contour.not_cut_um, contour.cut_um()), (0, 1000));
        assert!((0..100).all(|record| map.is_cut(at(record))));
    }

    #[test]
    fn a_contour_misses_what_was_not_cut_until_it_is_cut() {
        let (mut map, at) = (CutMap::new(true), |n: u32| RecordIndex::new(n));
        let length = |_, records: u32| u64::from(records) * 10;
        map.begin_contour(at(100), 7, 64);
        map.record_cut(Place::start_of(at(100)), Place::start_of(at(150)), 0.5);
        map.record_cut(Place::start_of(at(160)), Place::start_of(at(198)), 0.38);
        let contour = map.end_contour(at(200), length).expect("it was begun");
        assert_eq!((contour.number, contour.line, contour.not_cut_um), (1, 7, 100), "the last two records are no gap");
        assert_eq!(contour.cut_um(), 880);
        map.begin_contour(at(300), 9, 64);
        map.measure_current(at(320), length);
        assert_eq!(map.totals(), (2, NotCut { um: 300, contours: 2 }));
        map.begin_contour(at(100), 7, 64);
        map.record_cut(Place::start_of(at(140)), Place::start_of(at(150)), 0.1);
        map.record_cut(Place::start_of(at(150)), Place::start_of(at(160)), 0.1);
        map.record_cut(Place::start_of(at(160)), Place::start_of(at(161)), 0.01);
        let contour = map.end_contour(at(200), length).expect("it was begun");
        assert_eq!((contour.number, contour.not_cut_um, map.totals()), (1, 0, (2, NotCut { um: 200, contours: 1 })));
        assert_eq!(contour.cut_um(), 980, "what was cut before counts once");
    }

    #[test]
    fn contours_from_before_the_job_was_resumed_are_known() {
        let (mut map, at) = (CutMap::new(true), |n: u32| RecordIndex::new(n));
        let length = |_, records: u32| u64::from(records) * 10;
        let mut cut = RecordRanges::default();
        [[100, 150], [190, 200], [300, 310]].into_iter().for_each(|[begin, end]| cut.insert(at(begin), at(end)));
        map.begin_restoring(&cut);
        map.begin_contour(at(100), 7, 64);
        map.end_contour(at(200), length).expect("it was begun");
        map.restore_contour(at(100), at(200), length);
        map.begin_contour(at(300), 9, 64);
        map.end_restoring(&cut, at(320), length);
        let told: Vec<_> = map.take_restored().iter().map(|c| (c.number, c.line, c.cut_mm, c.not_cut_mm)).collect();
        assert_eq!(told, [(1, 7, 0.6, Some(0.4)), (2, 9, 0.1, None)]);
        map.record_cut(Place::start_of(at(310)), Place::start_of(at(330)), 0.2);
        let contour = map.end_contour(at(330), length).expect("it was begun");
        assert_eq!(
            (contour.number, contour.not_cut_um, contour.cut_um(), map.totals()),
            (2, 0, 300, (2, NotCut { um: 400, contours: 1 }))
        );
    }

    #[test]
    fn contours_are_numbered_behind_those_that_were_skipped() {
        let mut map = CutMap::new(true);
        map.number_from(Arc::new(AtomicU32::new(6)));
        map.begin_contour(RecordIndex::new(10), 7, 64);
        assert_eq!((map.current_number(), map.totals().0), (7, 1));
    }
}
