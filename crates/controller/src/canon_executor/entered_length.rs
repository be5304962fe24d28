//! A tool length that was entered in a pause, behind the first move that says where the machine is: part of the tool offset that it was
//! entered for, whenever that is in force, until another tool comes.
//!
//! Invariant: an axis that the program does not move stays where it is; a move to machine coordinates ends there.

use retrace_gcode::{Axis, Canon, Pose};

use super::CanonExecutor;

impl CanonExecutor<'_> {
    /// The tool length offset in force along an axis, mm, with a length that was entered; none where there is no offset.
    #[must_use]
    pub fn tool_length_mm(&self, axis: Axis) -> Option<f64> {
        let entered = self.correction.map_or(0.0, |correction| correction.mm());
        (self.tool != Pose::ZERO).then_some(self.tool[axis] + entered)
    }

    /// Does a path that was moved along the tool axis, because a tool length was entered, end before this one? Moves to machine
    /// coordinates, another tool and another offset are planned from where the machine then stands.
    #[must_use]
    pub fn ends_entered_length(&self, canon: &Canon) -> bool {
        match canon {
            Canon::MachineCoordinates => true,
            Canon::ChangeTool { tool, was, .. } => tool != was,
            Canon::UseToolLengthOffset(offset) => !is_same_offset(&self.in_mm(offset), &self.tool),
            _ => false,
        }
    }

    /// The machine stands `mm` further along `axis` than the program believes, because a tool length was entered. From here on that is a
    /// part of the tool offset in force, whenever that is in force, until another tool comes.
    pub fn correct_length(&mut self, axis: Axis, mm: f64) {
        match &mut self.correction {
            Some(correction) => correction.add(mm, self.tool),
            None => self.correction = Some(LengthCorrection::new(axis, mm, &self.at, self.tool)),
        }
    }

    pub(super) fn set_tool_offset(&mut self, tool_mm: Pose) {
        self.tool = tool_mm;
        if let Some(correction) = &mut self.correction {
            correction.offset_is(&tool_mm);
        }
    }

    /// Another tool is in the spindle.
    pub(super) fn forget_entered_length(&mut self) {
        if let Some(correction) = &mut self.correction {
            correction.forget();
        }
    }

    /// A move has ended where the program believes to be at `at`, and really at `end`.
    pub(super) fn moved(&mut self, at: Pose, end: &Pose) {
        self.at = at;
        if let Some(correction) = &mut self.correction {
            correction.moved_to(end);
        }
        self.correction.take_if(|correction| correction.is_done(&at));
    }
}

/// A length that was entered, behind the first move that it did not simply move along: part of the tool offset that the program believes in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LengthCorrection {
    axis: Axis,
    /// By how much the tool is longer than the offset that it was entered for says, mm.
    entered_mm: f64,
    for_offset: Pose,
    /// To be added to the offset in force, mm: all of that, or nothing.
    mm: f64,
    /// Where the tool axis really stands, mm: where the program does not move it, it stays there.
    stands_mm: f64,
}

impl LengthCorrection {
    /// The program believes that the machine stands at `at`, and it stands `mm` further along `axis`; this offset is in force.
    pub(super) fn new(axis: Axis, mm: f64, at: &Pose, offset: Pose) -> Self {
        Self { axis, entered_mm: mm, for_offset: offset, mm, stands_mm: at[axis] + mm }
    }

    /// This offset is in force from here on.
    pub(super) fn offset_is(&mut self, offset: &Pose) {
        self.mm = if is_same_offset(offset, &self.for_offset) { self.entered_mm } else { 0.0 };
    }

    /// Another tool is in the spindle: nothing is known of its length.
    pub(super) fn forget(&mut self) {
        (self.entered_mm, self.mm) = (0.0, 0.0);
    }

    /// Another length was entered on top, with this offset in force.
    pub(super) fn add(&mut self, mm: f64, offset: Pose) {
        (self.entered_mm, self.for_offset) = (self.mm + mm, offset);
        self.mm = self.entered_mm;
        self.stands_mm += mm;
    }

    /// Is there nothing to correct where the program believes that the machine stands at `at`?
    pub(super) fn is_done(&self, at: &Pose) -> bool {
        self.entered_mm == 0.0 && self.stands_mm == at[self.axis]
    }

    /// Where a straight move really ends that the program has go from `from` to `to`.
    pub(super) fn end_of(&self, from: &Pose, to: &Pose, is_machine: bool) -> Pose {
        let mut end = *to;
        let stays = (to[self.axis] - from[self.axis]).abs() < STAYS_MM;
        end[self.axis] = match (stays, is_machine) {
            (true, _) => self.stands_mm,
            (false, true) => to[self.axis],
            (false, false) => to[self.axis] + self.mm,
        };
        end
    }

    /// By how much the centre and the end of an arc are moved that begins where the program believes to stand at `from`; none where the
    /// arc lies in the tool axis and does not begin there.
    pub(super) fn of_arc(&self, from: &Pose, is_in_plane: bool) -> Option<f64> {
        let begins_there = (self.stands_mm - from[self.axis] - self.mm).abs() < STAYS_MM;
        (!is_in_plane || begins_there).then_some(self.mm)
    }

    pub(super) fn mm(&self) -> f64 {
        self.mm
    }

    pub(super) fn axis(&self) -> Axis {
        self.axis
    }

    /// The tool axis stands here now.
    pub(super) fn moved_to(&mut self, at: &Pose) {
        self.stands_mm = at[self.axis];
    }
}

/// The same offset in other units may differ in its last digit.
fn is_same_offset(one: &Pose, other: &Pose) -> bool {
    Axis::ALL.iter().all(|&axis| (one[axis] - other[axis]).abs() <= 1e-6)
}

/// A move shorter than this moves nothing, mm.
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
        let end = |of: &LengthCorrection, from, to, is_machine| of.end_of(&z(from), &z(to), is_machine)[Axis::Z];
        assert_eq!(end(&longer, -5.0, -5.0, true), -3.0);
        assert_eq!(end(&longer, -5.0, -5.0, false), -3.0);
        assert_eq!(end(&longer, -5.0, -6.0, false), -4.0);
        // to machine coordinates, and from there
        assert_eq!(end(&longer, -5.0, 0.0, true), 0.0);
        longer.moved_to(&z(0.0));
        assert_eq!(end(&longer, 0.0, 0.0, false), 0.0);
        assert_eq!(end(&longer, 0.0, -5.0, false), -3.0);
        assert_eq!(longer.of_arc(&z(0.0), true), None);
        assert_eq!(longer.of_arc(&z(0.0), false), Some(2.0));
        longer.moved_to(&z(-3.0));
        assert_eq!(longer.of_arc(&z(-5.0), true), Some(2.0));
        // another offset: it stays until it is moved; the first one again has the length
        longer.offset_is(&z(0.0));
        assert_eq!((end(&longer, -5.0, -5.0, false), end(&longer, -5.0, -6.0, false)), (-3.0, -6.0));
        longer.offset_is(&z(10.0));
        assert_eq!(end(&longer, -5.0, -6.0, false), -4.0);
        // another tool
        longer.forget();
        longer.offset_is(&z(10.0));
        assert_eq!((end(&longer, -5.0, -5.0, false), end(&longer, -5.0, -6.0, false)), (-3.0, -6.0));
        assert!(!longer.is_done(&z(-5.0)));
        longer.moved_to(&z(-8.0));
        assert!(longer.is_done(&z(-8.0)));
    }
}
