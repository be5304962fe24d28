//! The output actions of the records that the card holds (REV-14; GMC, *synchronous*).
//!
//! Invariant: actions are stored in the order of their places. An action is executed when the cursor leaves its place
//! forward and, if actions are replayed, undone when the cursor passes it backward.
use retrace_core::{Distance, Place, RecordIndex};
use retrace_link::{CommandRefusal, OutputAction};

/// Table of at most `N` actions, in order of their places.
#[derive(Clone, Debug)]
pub struct ActionTable<const N: usize> {
    actions: [OutputAction; N],
    count: usize,
}

impl<const N: usize> Default for ActionTable<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> ActionTable<N> {
    /// Creates an empty table.
    #[must_use]
    pub const fn new() -> Self {
        Self { actions: [OutputAction { place: RecordIndex::new(0), channel: 0, before: 0, after: 0 }; N], count: 0 }
    }

    /// Removes all actions.
    pub const fn clear(&mut self) {
        self.count = 0;
    }

    /// Inserts an action at its place, after those of the same place. If the table is full, actions outside the window
    /// (`low … high`) are removed first.
    pub fn insert(&mut self, action: OutputAction, low: RecordIndex, high: RecordIndex) -> Result<(), CommandRefusal> {
        if self.actions[..self.count].contains(&action) {
            return Ok(());
        }
        if self.count == N {
            self.forget_outside(low, high);
        }
        if self.count == N {
            return Err(CommandRefusal::Full);
        }
        let at = self.actions[..self.count].iter().position(|a| action.place.is_before(a.place)).unwrap_or(self.count);
        self.actions.copy_within(at..self.count, at + 1);
        self.actions[at] = action;
        self.count += 1;
        Ok(())
    }

    fn forget_outside(&mut self, low: RecordIndex, high: RecordIndex) {
        let mut retained = 0;
        for k in 0..self.count {
            let place = self.actions[k].place;
            if !place.is_before(low) && !high.is_before(place) {
                self.actions[retained] = self.actions[k];
                retained += 1;
            }
        }
        self.count = retained;
    }

    /// Returns the actions whose place the cursor leaves forward between `from` and `to`, in order.
    pub fn passed_forward(&self, from: Place, to: Place) -> impl Iterator<Item = &OutputAction> {
        let distance = from.distance_to(to);
        self.actions[..self.count].iter().filter(move |a| within(from.distance_to(Place::start_of(a.place)), distance))
    }

    /// Returns the actions that the cursor passes backward between `from` and `to` (`to` is behind), last first.
    pub fn passed_backward(&self, from: Place, to: Place) -> impl Iterator<Item = &OutputAction> {
        let distance = to.distance_to(from);
        self.actions[..self.count]
            .iter()
            .rev()
            .filter(move |a| within(to.distance_to(Place::start_of(a.place)), distance))
    }
}

/// Whether `x` is in 0 … `distance`, the end excluded.
fn within(x: Distance, distance: Distance) -> bool {
    (Distance::ZERO..distance).contains(&x)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn action(place: RecordIndex, after: i32) -> OutputAction {
        OutputAction { place, channel: 1, before: 1 - after, after }
    }

    #[test]
    fn forward_and_backward_meet_the_same_actions_in_opposite_order() {
        let mut table = ActionTable::<4>::default();
        for a in [action(RecordIndex::new(5), 1), action(RecordIndex::new(3), 0), action(RecordIndex::new(5), 0)] {
            table.insert(a, RecordIndex::new(0), RecordIndex::new(10)).expect("room");
        }
        let all: Vec<OutputAction> = table
            .passed_forward(Place::start_of(RecordIndex::new(3)), Place::start_of(RecordIndex::new(6)))
            .copied()
            .collect();
        assert_eq!(
            all,
            [action(RecordIndex::new(3), 0), action(RecordIndex::new(5), 1), action(RecordIndex::new(5), 0)]
        );
        let back: Vec<OutputAction> = table
            .passed_backward(Place::start_of(RecordIndex::new(6)), Place::start_of(RecordIndex::new(3)))
            .copied()
            .collect();
        assert_eq!(
            back,
            [action(RecordIndex::new(5), 0), action(RecordIndex::new(5), 1), action(RecordIndex::new(3), 0)]
        );
        // a place that is only arrived at is not left yet
        assert_eq!(
            table.passed_forward(Place::start_of(RecordIndex::new(4)), Place::start_of(RecordIndex::new(5))).count(),
            0
        );
        assert_eq!(
            table
                .passed_backward(
                    Place { record: RecordIndex::new(5), fraction: 1 },
                    Place::start_of(RecordIndex::new(5))
                )
                .count(),
            2
        );
    }

    #[test]
    fn a_full_table_forgets_what_the_window_has_left() {
        let mut table = ActionTable::<2>::default();
        table.insert(action(RecordIndex::new(1), 1), RecordIndex::new(0), RecordIndex::new(10)).expect("room");
        table.insert(action(RecordIndex::new(2), 0), RecordIndex::new(0), RecordIndex::new(10)).expect("room");
        assert_eq!(
            table.insert(action(RecordIndex::new(3), 1), RecordIndex::new(0), RecordIndex::new(10)),
            Err(CommandRefusal::Full)
        );
        table
            .insert(action(RecordIndex::new(3), 1), RecordIndex::new(2), RecordIndex::new(10))
            .expect("the first is behind the window");
        assert_eq!(
            table.passed_forward(Place::start_of(RecordIndex::new(0)), Place::start_of(RecordIndex::new(9))).count(),
            2
        );
    }
}
