//! What the material and the cutter change at both ends of a contour: the creep at its beginning; before its end the
//! cutter off, or the abrasive of a jet; behind it an over cut (CUT-13, CUT-14, CUT-19).
//!
//! Invariant: no move is left out or reordered. Moves are divided and slowed down, and held back until it is known how
//! far the end of the contour is.

use super::interpreter_core::Core;
use crate::canon::{Canon, CanonStep};
use crate::cutting::CuttingSwitch;
use crate::move_split::{end, length};
use crate::open_contour::{OpenContour, Piece, Stage};
use crate::pose::{Axis, Pose};

/// Greatest distance between the ends of a closed contour, mm: programs round their coordinates.
const SAME_PLACE_MM: f64 = 0.005;

impl Core {
    /// Shapes the ends of contours in the steps from `first`: those of a block that began at `before`.
    pub(super) fn shape_contours(&mut self, before: Pose, first: usize, steps: &mut Vec<CanonStep>) {
        let is_first = |step: &CanonStep| {
            matches!(step.canon, Canon::StartSpindleClockwise(_) | Canon::StartSpindleCounterclockwise(_))
        };
        if self.state.contour.is_none() && !steps[first..].iter().any(is_first) {
            for step in &steps[first..] {
                self.follow(&step.canon);
            }
            return;
        }
        for step in steps.split_off(first) {
            let canon = step.canon.clone();
            self.shape_contour(step, &before, steps);
            self.follow(&canon);
        }
    }

    /// Records where the path is, and the feed rate, behind a step.
    fn follow(&mut self, canon: &Canon) {
        let state = &mut self.state.cutting;
        match canon {
            Canon::SetFeedRate(rate) => state.rate = *rate,
            Canon::SetG5xOffset { .. }
            | Canon::SetG92Offset(_)
            | Canon::SetXyRotation(_)
            | Canon::UseToolLengthOffset(_)
            | Canon::UseLengthUnits(_)
            | Canon::NurbsFeed(_)
            | Canon::StraightProbe(..) => state.path_end = None,
            _ => state.path_end = end(canon).or(state.path_end),
        }
    }

    fn shape_contour(&mut self, step: CanonStep, before: &Pose, steps: &mut Vec<CanonStep>) {
        let at = self.state.cutting.path_end.unwrap_or(*before);
        let Some(mut contour) = self.state.contour.take() else {
            if let Canon::StartSpindleClockwise(spindle) | Canon::StartSpindleCounterclockwise(spindle) = step.canon {
                self.begin_contour(spindle, at);
            }
            return steps.push(step);
        };
        match &step.canon {
            Canon::StopSpindleTurning(spindle) if *spindle == contour.tool.spindle => {
                return self.end_contour(&mut contour, &at, step, steps);
            }
            Canon::StraightFeed(_) | Canon::ArcFeed(_) => self.shape_move(&mut contour, &at, step, steps),
            Canon::SetFeedRate(rate) => {
                let canon = Canon::SetFeedRate(contour.rate(contour.stage, *rate, self.state.units.millimetres()));
                contour.pass(CanonStep { canon, ..step }, None, steps);
            }
            Canon::Comment(_)
            | Canon::SetMotionControlMode(_)
            | Canon::SetNaivecamTolerance(_)
            | Canon::SelectMaterial(_)
            | Canon::SetPierceValue { .. } => {
                contour.pass(step, None, steps);
            }
            Canon::SetCutting(CuttingSwitch::Cutter, false) | Canon::ProgramEnd => {
                contour.release(steps);
                return steps.push(step);
            }
            _ => {
                contour.release(steps);
                // Its beginning is not in these coordinates any more.
                contour.start = contour.start.filter(|_| end(&step.canon).is_none() && !moves_origin(&step.canon));
                steps.push(step);
            }
        }
        self.state.contour = Some(contour);
    }

    fn begin_contour(&mut self, spindle: u8, at: Pose) {
        let state = &self.state.cutting;
        let tool = self.cutting.as_ref().and_then(|setup| setup.tool(spindle.into()));
        if let Some(tool) = tool.filter(|tool| tool.cuts && !state.is_forbidden) {
            self.state.contour = OpenContour::begin(tool, state.material.as_ref(), at).map(Box::new);
        }
    }

    /// Begins a contour with what belongs to its pierce, and divides its moves where a stage ends.
    fn shape_move(&mut self, contour: &mut OpenContour, at: &Pose, step: CanonStep, steps: &mut Vec<CanonStep>) {
        let (mm, rate) = (self.state.units.millimetres(), self.state.cutting.rate);
        let length_mm = length(at, &step.canon).unwrap_or_default() * mm;
        let mut rest = Piece { from: *at, canon: step.canon.clone(), length_mm };
        let of = |canon: Canon| CanonStep { canon, ..step.clone() };
        if !std::mem::replace(&mut contour.is_begun, true) {
            let excursions = contour.excursions(&rest, mm);
            if !excursions.is_empty() {
                contour.pass(of(Canon::SetFeedRate(contour.rate(Stage::Pierce, rate, mm))), None, steps);
                excursions.into_iter().for_each(|canon| contour.pass(of(canon), None, steps));
                contour.pass(of(Canon::SetFeedRate(rate)), None, steps);
            }
        }
        loop {
            let (stage, left_mm) = contour.stage_here();
            if stage != std::mem::replace(&mut contour.stage, stage) {
                contour.pass(of(Canon::SetFeedRate(contour.rate(stage, rate, mm))), None, steps);
            }
            let Some([first, second]) = rest.divided_at(left_mm) else { break };
            contour.length_mm += first.length_mm;
            contour.pass(of(first.canon.clone()), Some(first), steps);
            rest = second;
        }
        contour.length_mm += rest.length_mm;
        contour.pass(of(rest.canon.clone()), Some(rest), steps);
    }

    /// Ends a contour where its cutter is switched off.
    fn end_contour(&mut self, contour: &mut OpenContour, at: &Pose, stop: CanonStep, steps: &mut Vec<CanonStep>) {
        let of = |canon: Canon| CanonStep { canon, ..stop.clone() };
        let off = Canon::SetCutting(CuttingSwitch::Cutter, false);
        let (mut goes_off, mut holds_height) = (false, false);
        if contour.material.off_before_mm > 0.0 {
            goes_off = contour.release_with(&off, steps);
        } else if let Some(output) = contour.tool.abrasive.filter(|_| contour.tool.abrasive_lag_mm > 0.0) {
            contour.release_with(&Canon::ClearMotionOutputBit(output.into()), steps);
        } else if contour.tool.height_hold_mm > 0.0 && !self.state.cutting.is_height_held {
            holds_height = contour.release_with(&Canon::SetCutting(CuttingSwitch::HeightControl, false), steps);
        }
        contour.release(steps);
        if contour.stage != Stage::Full {
            steps.push(of(Canon::SetFeedRate(self.state.cutting.rate)));
        }
        let same = SAME_PLACE_MM / self.state.units.millimetres();
        let is_closed = contour.start.is_some_and(|start| {
            let way = at.minus(&start);
            (way[Axis::X]).hypot(way[Axis::Y]) <= same && contour.length_mm > contour.material.over_cut_mm
        });
        let over_cuts = contour.material.over_cut_mm > 0.0 && is_closed && self.state.compensation.is_none();
        if over_cuts && !self.state.cutting.is_displaced {
            goes_off = true;
            steps.push(of(off));
            contour.over_cut(&stop, steps);
            self.state.cutting.is_displaced = true;
        }
        steps.push(stop.clone());
        if holds_height {
            steps.push(of(Canon::SetCutting(CuttingSwitch::HeightControl, true)));
        }
        if goes_off && !self.state.cutting.is_forbidden {
            steps.push(of(Canon::SetCutting(CuttingSwitch::Cutter, true)));
        }
    }

    /// Emits what is held back: the program ends, or cannot continue.
    pub(crate) fn release_contour(&mut self, steps: &mut Vec<CanonStep>) {
        if let Some(mut contour) = self.state.contour.take() {
            contour.release(steps);
        }
    }
}

fn moves_origin(canon: &Canon) -> bool {
    matches!(
        canon,
        Canon::SetG5xOffset { .. }
            | Canon::SetG92Offset(_)
            | Canon::SetXyRotation(_)
            | Canon::UseToolLengthOffset(_)
            | Canon::UseLengthUnits(_)
    )
}
