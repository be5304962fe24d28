//! A tool length that was entered in a pause: behind the first move to a machine position it is part of the tool offset
//! that it was entered for, whenever that is in force, until another tool is loaded.
//!
//! Invariant: an axis that the program does not move stays where it is; a moved path ends at a move to machine
//! coordinates.

use retrace_gcode::{Axis, Canon, Pose};

use super::CanonExecutor;

impl CanonExecutor<'_> {
    /// Tool length offset in force along an axis, mm, including an entered length. None where there is no offset.
    #[must_use]
    pub(crate) fn tool_length_mm(&self, axis: Axis) -> Option<f64> {
        let entered = self.correction.map_or(0.0, |correction| correction.mm());
        (self.tool != Pose::ZERO).then_some(self.tool[axis] + entered)
    }

    /// Whether a path that was moved along the tool axis by an entered tool length ends before this function. Moves to
    /// machine coordinates, another tool and another offset are planned from the machine's position then.
    #[must_use]
    pub(crate) fn ends_entered_length(&self, canon: &Canon) -> bool {
        match canon {
            Canon::MachineCoordinates => true,
            Canon::ChangeTool { tool, was, .. } => tool != was,
            Canon::UseToolLengthOffset(offset) => !is_same_offset(&self.in_mm(offset), &self.tool),
            _ => false,
        }
    }

    /// Corrects the position: the machine is `mm` further along `axis` than the program's position, because a tool
    /// length was entered. From here on this is part of the tool offset, whenever that is in force, until another tool
    /// is loaded.
    pub(crate) fn correct_length(&mut self, axis: Axis, mm: f64) {
        match &mut self.correction {
            Some(correction) => correction.add(mm, self.tool),
            None => self.correction = Some(LengthCorrection::new(axis, mm, &self.at, self.tool)),
        }
    }

    pub(super) fn set_tool_offset(&mut self, tool_mm: Pose) {
        self.tool = tool_mm;
        if let Some(correction) = &mut self.correction {
            correction.set_offset(&tool_mm);
        }
    }

    /// Another tool is in the spindle.
    pub(super) fn forget_entered_length(&mut self) {
        if let Some(correction) = &mut self.correction {
            correction.forget();
        }
    }

    /// Records that a move ended at `at` in the program's view, and at `end` in fact.
    pub(super) fn record_move_end(&mut self, at: Pose, end: &Pose) {
        self.at = at;
        if let Some(correction) = &mut self.correction {
            correction.set_actual(end);
        }
        self.correction.take_if(|correction| correction.is_done(&at));
    }
}

/// An entered length, behind the first move that it did not simply shift: part of the program's tool offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LengthCorrection {
    axis: Axis,
    /// Length by which the tool is longer than the offset that it was entered for, mm.
    entered_mm: f64,
    for_offset: Pose,
    /// Correction to add to the offset in force, mm: all of that, or nothing.
    mm: f64,
    /// Actual position of the tool axis, mm: where the program does not move it, it stays there.
    actual_mm: f64,
}

impl LengthCorrection {
    /// Creates a correction: the machine is `mm` further along `axis` than the program's position `at`; this offset is
    /// in force.
    pub(super) fn new(axis: Axis, mm: f64, at: &Pose, offset: Pose) -> Self {
        Self { axis, entered_mm: mm, for_offset: offset, mm, actual_mm: at[axis] + mm }
    }

    /// Sets the offset that is in force from here on.
    pub(super) fn set_offset(&mut self, offset: &Pose) {
        self.mm = if is_same_offset(offset, &self.for_offset) { self.entered_mm } else { 0.0 };
    }

    /// Forgets the length: another tool is in the spindle.
    pub(super) fn forget(&mut self) {
        (self.entered_mm, self.mm) = (0.0, 0.0);
    }

    /// Adds another entered length, with this offset in force.
    pub(super) fn add(&mut self, mm: f64, offset: Pose) {
        (self.entered_mm, self.for_offset) = (self.mm + mm, offset);
        self.mm = self.entered_mm;
        self.actual_mm += mm;
    }

    /// Whether there is nothing to correct where the program's position is `at`.
    pub(super) fn is_done(&self, at: &Pose) -> bool {
        self.entered_mm == 0.0 && self.actual_mm == at[self.axis]
    }

    /// Actual end of a straight move that goes from `from` to `to` in the program.
    pub(super) fn move_end(&self, from: &Pose, to: &Pose, is_machine: bool) -> Pose {
        let mut end = *to;
        let stays = (to[self.axis] - from[self.axis]).abs() < STAYS_MM;
        end[self.axis] = match (stays, is_machine) {
            (true, _) => self.actual_mm,
            (false, true) => to[self.axis],
            (false, false) => to[self.axis] + self.mm,
        };
        end
    }

    /// Distance by which the centre and the end of an arc are moved that begins at `from` in the program. None where
    /// the arc is in the tool axis and does not begin there.
    pub(super) fn arc_shift(&self, from: &Pose, is_in_plane: bool) -> Option<f64> {
        let begins_there = (self.actual_mm - from[self.axis] - self.mm).abs() < STAYS_MM;
        (!is_in_plane || begins_there).then_some(self.mm)
    }

    pub(super) fn mm(&self) -> f64 {
        self.mm
    }

    pub(super) fn axis(&self) -> Axis {
        self.axis
    }

    /// Sets the actual position of the tool axis.
    pub(super) fn set_actual(&mut self, at: &Pose) {
        self.actual_mm = at[self.axis];
    }
}

/// The same offset in other units may differ in its last digit.
fn is_same_offset(one: &Pose, other: &Pose) -> bool {
    Axis::ALL.iter().all(|&axis| (one[axis] - other[axis]).abs() <= 1e-6)
}

/// Moves shorter than this move nothing, mm.
const STAYS_MM: f64 = 1e-9;

#[cfg(test)]
mod tests {
    use super::*;

    fn z(mm: f64) -> Pose {
        Pose::xyz(0.0, 0.0, mm)
    }

    #[test]
    fn an_axis_that_the_program_does_not_move_stays() {
        let mut longer = LengthCorrection::new(Axis::Z, 2.0, &z(-5.0), z(10.0));
        let end = |of: &LengthCorrection, from, to, is_machine| of.move_end(&z(from), &z(to), is_machine)[Axis::Z];
        assert_eq!(end(&longer, -5.0, -5.0, true), -3.0);
        assert_eq!(end(&longer, -5.0, -5.0, false), -3.0);
        assert_eq!(end(&longer, -5.0, -6.0, false), -4.0);
        // to machine coordinates, and from there
        assert_eq!(end(&longer, -5.0, 0.0, true), 0.0);
        longer.set_actual(&z(0.0));
        assert_eq!(end(&longer, 0.0, 0.0, false), 0.0);
        assert_eq!(end(&longer, 0.0, -5.0, false), -3.0);
        assert_eq!(longer.arc_shift(&z(0.0), true), None);
        assert_eq!(longer.arc_shift(&z(0.0), false), Some(2.0));
        longer.set_actual(&z(-3.0));
        assert_eq!(longer.arc_shift(&z(-5.0), true), Some(2.0));
        // another offset: the axis stays until it is moved; the first offset again has the length
        longer.set_offset(&z(0.0));
        assert_eq!((end(&longer, -5.0, -5.0, false), end(&longer, -5.0, -6.0, false)), (-3.0, -6.0));
        longer.set_offset(&z(10.0));
        assert_eq!(end(&longer, -5.0, -6.0, false), -4.0);
        // another tool
        longer.forget();
        longer.set_offset(&z(10.0));
        assert_eq!((end(&longer, -5.0, -5.0, false), end(&longer, -5.0, -6.0, false)), (-3.0, -6.0));
        assert!(!longer.is_done(&z(-5.0)));
        longer.set_actual(&z(-8.0));
        assert!(longer.is_done(&z(-8.0)));
    }
}
