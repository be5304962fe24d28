//! The contours of a job with their states, as the observers of a job know them (CUT-12, CUT-27).
//!
//! Invariant: its size is bounded however many contours a program has; a figure that is not known is `None`, never 0.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::contour_list::{ContourList, PlannedContour, RestoredContour};
use crate::event::EventKind;
use crate::telemetry::{PeriodRecord, Telemetry};

/// Maximum number of contours whose state is retained. Beyond it that of the first ones is forgotten.
const MAX_STATES: usize = 10_000;

/// State of a contour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ContourState {
    /// It was not begun in this job.
    NotBegun,
    /// The operator skips it once it is reached.
    Skipped,
    /// It was begun and has not ended: it is being cut, or its cut is interrupted.
    Begun,
    /// It is cut from its pierce to its end.
    Cut,
    /// It has ended, and something of it is not cut.
    NotCut,
}

impl ContourState {
    /// Name of the state as an identifier.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NotBegun => "not_begun",
            Self::Skipped => "skipped",
            Self::Begun => "begun",
            Self::Cut => "cut",
            Self::NotCut => "not_cut",
        }
    }
}

/// A contour that was begun.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct BegunContour {
    /// Program line: that which lights the cutter, or another one of the contour as long as it has not ended.
    line: u32,
    cut_mm: f64,
    /// Length that is not cut; `None` where it has not ended.
    not_cut_mm: Option<f64>,
}

/// A contour of the list.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContourRow<'p> {
    /// Its number in the program, from 1.
    pub number: u32,
    /// Program line that lights the cutter.
    pub line: u32,
    /// The contour as it is planned, where that is known.
    pub planned: Option<&'p PlannedContour<9>>,
    /// Its state.
    pub state: ContourState,
    /// Length that is cut, mm.
    pub cut_mm: f64,
    /// Length that is not cut, mm, where it has ended.
    pub not_cut_mm: Option<f64>,
}

impl ContourRow<'_> {
    /// Text of the state, with the length to this number of decimals.
    #[must_use]
    pub fn state_text(&self, decimals: usize) -> String {
        match self.state {
            ContourState::NotBegun => "not cut yet".into(),
            ContourState::Skipped => "to be skipped".into(),
            ContourState::Begun => format!("{:.decimals$} mm cut so far", self.cut_mm),
            ContourState::Cut => "cut".into(),
            ContourState::NotCut => format!("{:.decimals$} mm NOT CUT", self.not_cut_mm.unwrap_or_default()),
        }
    }
}

/// The states of the contours of a job.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ContourStates {
    /// Contours that were begun, by their numbers. Shared, because the screen copies the states for each redraw.
    begun: Arc<BTreeMap<u32, BegunContour>>,
    /// Number of the contour that is being cut, and its state.
    current: Option<(u32, BegunContour)>,
    /// Number of the contour that was being cut last.
    last: Option<u32>,
    /// Length that is cut of contours whose state is forgotten.
    forgotten_mm: f64,
    /// Numbers of the contours that the operator skips.
    skipped: Arc<BTreeSet<u32>>,
}

impl ContourStates {
    /// Applies a message of the job.
    pub fn observe<const A: usize>(&mut self, message: &Telemetry<A>) {
        match message {
            Telemetry::Period(period) if !period.off_path => self.observe_period(period),
            Telemetry::Event(event) => match &event.kind {
                EventKind::Started => *self = Self::default(),
                &EventKind::Contour { number, cut_mm, not_cut_mm } => {
                    self.current.take_if(|(current, _)| *current == number);
                    // It was passed, or cut.
                    self.skip(number, false);
                    self.store(number, BegunContour { line: event.line, cut_mm, not_cut_mm: Some(not_cut_mm) });
                }
                &EventKind::ContourSkip { number, on } => self.skip(number, on),
                EventKind::ContoursRestored(contours) => {
                    for &RestoredContour { number, line, cut_mm, not_cut_mm } in contours.iter() {
                        self.store(number, BegunContour { line, cut_mm, not_cut_mm });
                    }
                }
                _ => {}
            },
            _ => {}
        }
    }

    /// The operator skips a contour that is not begun, or cuts it after all.
    pub fn skip(&mut self, number: u32, on: bool) {
        let skipped = Arc::make_mut(&mut self.skipped);
        if on {
            skipped.insert(number)
        } else {
            skipped.remove(&number)
        };
    }

    /// Numbers of the contours that the operator skips.
    pub fn skipped(&self) -> impl Iterator<Item = u32> {
        self.skipped.iter().copied()
    }

    fn observe_period<const A: usize>(&mut self, period: &PeriodRecord<A>) {
        if let Some((number, contour)) = self.current.take_if(|(number, _)| *number != period.contour) {
            self.store(number, contour);
        }
        if period.contour != 0 {
            let line = self.current.map_or_else(
                || self.begun.get(&period.contour).map_or(period.line, |contour| contour.line),
                |(_, contour)| contour.line,
            );
            let cut_mm = f64::from(period.cut_um) / 1000.0;
            self.last = Some(period.contour);
            self.current = Some((period.contour, BegunContour { line, cut_mm, not_cut_mm: None }));
        }
    }

    fn store(&mut self, number: u32, contour: BegunContour) {
        let begun = Arc::make_mut(&mut self.begun);
        begun.insert(number, contour);
        if begun.len() > MAX_STATES {
            let first = begun.pop_first();
            self.forgotten_mm += first.map_or(0.0, |(_, contour)| contour.cut_mm);
        }
    }

    fn state_of(&self, number: u32) -> Option<BegunContour> {
        let current = self.current.filter(|(current, _)| *current == number).map(|(_, contour)| contour);
        current.or_else(|| self.begun.get(&number).copied())
    }

    /// Number of the contour that is being cut, and the length of it that is cut, mm.
    #[must_use]
    pub fn current(&self) -> Option<(u32, f64)> {
        self.current.map(|(number, contour)| (number, contour.cut_mm))
    }

    /// Number of the contour that is being cut, or was last.
    #[must_use]
    pub fn last(&self) -> Option<u32> {
        self.last
    }

    /// Length that is cut of all contours, mm.
    #[must_use]
    pub fn cut_mm(&self) -> f64 {
        let current = self.current.map_or(0.0, |(_, contour)| contour.cut_mm);
        let number = self.current.map(|(number, _)| number);
        let others = self.begun.iter().filter(|(other, _)| Some(**other) != number);
        others.map(|(_, contour)| contour.cut_mm).sum::<f64>() + current + self.forgotten_mm
    }

    /// Number of contours that have ended, and of those of which something is not cut.
    #[must_use]
    pub fn ended(&self) -> (usize, usize) {
        let ended = self.begun.values().filter_map(|contour| contour.not_cut_mm);
        ended.fold((0, 0), |(ended, not_cut), mm| (ended + 1, not_cut + usize::from(mm > 0.0)))
    }

    /// Numbers of the contours that are listed: those of the plan, and those that were begun.
    #[must_use]
    pub fn numbers(&self, planned: Option<&ContourList<9>>) -> Vec<u32> {
        let listed = planned.map_or(0, |list| u32::try_from(list.contours.len()).unwrap_or(u32::MAX));
        let mut numbers: Vec<u32> = (1..=listed).collect();
        numbers.extend(self.begun.keys().copied().filter(|&number| number > listed));
        let current = self.current.map(|(number, _)| number).filter(|number| !numbers.contains(number));
        numbers.extend(current);
        numbers.sort_unstable();
        numbers
    }

    /// The contour of this number, if it is listed.
    #[must_use]
    pub fn row<'p>(&self, number: u32, planned: Option<&'p ContourList<9>>) -> Option<ContourRow<'p>> {
        let (planned, begun) = (planned.and_then(|list| list.contour(number)), self.state_of(number));
        if planned.is_none() && begun.is_none() {
            return None;
        }
        let state = match begun.map(|contour| contour.not_cut_mm) {
            _ if self.skipped.contains(&number) => ContourState::Skipped,
            None => ContourState::NotBegun,
            Some(None) => ContourState::Begun,
            Some(Some(mm)) if mm > 0.0 => ContourState::NotCut,
            Some(Some(_)) => ContourState::Cut,
        };
        let begun = begun.unwrap_or_default();
        let line = planned.map_or(begun.line, |contour| contour.line);
        Some(ContourRow { number, line, planned, state, cut_mm: begun.cut_mm, not_cut_mm: begun.not_cut_mm })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::Event;
    use retrace_core::Place;
    use retrace_core::mode::Mode;
    use retrace_journal::HoldReason;

    fn period(contour: u32, cut_um: u32) -> Telemetry<1> {
        Telemetry::Period(PeriodRecord {
            period: 1,
            place: Place::default(),
            reached: Place::default().record,
            oldest: Place::default().record,
            planned: Place::default().record,
            window: [Place::default().record; 2],
            rate: retrace_core::Rate::ONE,
            line: 5,
            increments: [1],
            counts: [1],
            layer: 0,
            executed: 0,
            at_rest: false,
            starved: false,
            inputs: 0,
            mode: Mode::Run,
            hold_reason: HoldReason::None,
            override_rate: retrace_core::Rate::ONE,
            rapid_override: retrace_core::Rate::ONE,
            speed_override: retrace_core::Rate::ONE,
            override_is_off: false,
            off_path: false,
            contour,
            cut_um,
            cut_from: Some(Place::default()),
            spindle: retrace_link::SpindleStatus::default(),
            height: retrace_link::HeightState::Off,
            analog_inputs: retrace_link::AnalogInputs::default(),
            is_probing: false,
        })
    }

    fn ends(number: u32, cut_mm: f64, not_cut_mm: f64) -> Telemetry<1> {
        let kind = EventKind::Contour { number, cut_mm, not_cut_mm };
        Telemetry::Event(Event { period: 1, time_s: 0.0, place: Place::default(), line: 4, kind })
    }

    fn states(messages: &[Telemetry<1>]) -> ContourStates {
        let mut states = ContourStates::default();
        messages.iter().for_each(|message| states.observe(message));
        states
    }

    #[test]
    fn a_contour_is_begun_then_cut_or_not() {
        let mut list = ContourList::<9>::default();
        for line in [4, 9, 14] {
            list.begin(64, "torch", line, [0.0; 9]);
            list.cut(60.0, [0.0; 9]);
            list.end(64, [60.0; 9]);
        }
        let states =
            states(&[period(1, 500), period(1, 60_000), ends(1, 60.0, 0.0), period(0, 0), period(2, 20_000), {
                ends(2, 20.0, 40.0)
            }]);
        let shown = |states: &ContourStates| -> Vec<_> {
            let row = |number| states.row(number, Some(&list)).map(|row| (row.state, row.cut_mm, row.not_cut_mm));
            states.numbers(Some(&list)).into_iter().filter_map(row).collect()
        };
        use ContourState::{Begun, Cut, NotBegun, NotCut};
        assert_eq!(shown(&states), [(Cut, 60.0, Some(0.0)), (NotCut, 20.0, Some(40.0)), (NotBegun, 0.0, None)]);
        assert_eq!((states.ended(), states.cut_mm(), list.cut_mm()), ((2, 1), 80.0, 180.0));
        let mut again = states.clone();
        again.observe(&period(2, 30_000));
        assert_eq!(shown(&again)[1], (Begun, 30.0, None), "it is executed again");
        assert_eq!((again.current(), again.cut_mm(), again.ended()), (Some((2, 30.0)), 90.0, (2, 1)));
        again.observe(&period(0, 0));
        assert_eq!(again.last(), Some(2));
        assert_eq!((again.current(), shown(&again)[1]), (None, (Begun, 30.0, None)), "and left within it");
    }

    #[test]
    fn without_a_plan_the_contours_are_those_that_were_begun() {
        let states = states(&[period(7, 1000), ends(7, 2.0, 0.0), period(8, 500)]);
        assert_eq!(states.numbers(None), [7, 8]);
        let lines: Vec<_> = [6, 7, 8].iter().map(|&number| states.row(number, None).map(|row| row.line)).collect();
        assert_eq!(lines, [None, Some(4), Some(5)]);
    }

    #[test]
    fn what_was_cut_before_the_job_was_resumed_is_known() {
        let restored = |number, not_cut_mm| RestoredContour { number, line: 4, cut_mm: 10.0, not_cut_mm };
        let contours = [restored(1, Some(0.0)), restored(2, Some(3.0)), restored(3, None)];
        let kind = EventKind::ContoursRestored(contours.into());
        let event = Event { period: 1, time_s: 0.0, place: Place::default(), line: 4, kind };
        let states = states(&[Telemetry::Event(event), period(3, 12_000), ends(3, 60.0, 0.0)]);
        let shown = |number| states.row(number, None).map(|row| (row.state, row.cut_mm));
        use ContourState::{Cut, NotCut};
        assert_eq!([1, 2, 3].map(shown), [Some((Cut, 10.0)), Some((NotCut, 10.0)), Some((Cut, 60.0))]);
        assert_eq!((states.ended(), states.cut_mm()), ((3, 1), 80.0));
    }

    #[test]
    fn a_contour_is_skipped_until_it_has_been_passed() {
        let skip = |number, on| {
            let kind = EventKind::ContourSkip { number, on };
            Telemetry::<1>::Event(Event { period: 1, time_s: 0.0, place: Place::default(), line: 4, kind })
        };
        let mut list = ContourList::<9>::default();
        for line in [4, 9] {
            list.begin(64, "torch", line, [0.0; 9]);
            list.end(64, [60.0; 9]);
        }
        let mut states = states(&[skip(1, true), skip(2, true), skip(1, false)]);
        let shown = |states: &ContourStates| [1, 2].map(|number| states.row(number, Some(&list)).map(|row| row.state));
        use ContourState::{NotBegun, NotCut, Skipped};
        assert_eq!(shown(&states), [Some(NotBegun), Some(Skipped)]);
        assert_eq!(states.skipped().collect::<Vec<_>>(), [2]);
        states.observe(&ends(2, 0.0, 60.0));
        assert_eq!(shown(&states), [Some(NotBegun), Some(NotCut)]);
    }

    #[test]
    fn very_many_contours_take_no_more_room() {
        let mut states = ContourStates::default();
        (1..=MAX_STATES as u32 + 5).for_each(|number| states.observe(&ends(number, 1.0, 0.0)));
        assert_eq!((states.numbers(None).len(), states.numbers(None)[0]), (MAX_STATES, 6));
        assert_eq!(states.cut_mm(), MAX_STATES as f64 + 5.0, "the length of the forgotten ones is retained");
    }
}
