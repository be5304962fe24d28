//! The window as far as the cursor may run: it ends at the place of an instruction that is not executed.
//!
//! Invariant: it is never longer than the window below.

use retrace_core::drive::RecordWindow;
use retrace_core::{RapidCap, RecordIndex};

/// Window that ends at a place, if the window below extends further.
pub(crate) struct PlayedWindow<'w, R> {
    window: &'w R,
    high: RecordIndex,
}

impl<'w, R> PlayedWindow<'w, R> {
    pub(crate) fn new<const A: usize>(window: &'w R, end: Option<RecordIndex>) -> Self
    where
        R: RecordWindow<A>,
    {
        let high = end.filter(|&end| end.is_before(window.high())).unwrap_or(window.high());
        Self { window, high }
    }
}

impl<const A: usize, R: RecordWindow<A>> RecordWindow<A> for PlayedWindow<'_, R> {
    fn low(&self) -> RecordIndex {
        self.window.low()
    }

    fn high(&self) -> RecordIndex {
        self.high
    }

    fn rests_at(&self, place: RecordIndex) -> bool {
        self.window.rests_at(place)
    }

    fn cap(&self, place: RecordIndex) -> RapidCap {
        self.window.cap(place)
    }

    fn increments(&self, place: RecordIndex) -> [i16; A] {
        self.window.increments(place)
    }

    fn is_rapid(&self, place: RecordIndex) -> bool {
        self.window.is_rapid(place)
    }
}
