//! A contour that is being cut: what is held back of it until its end is known, and its beginning for an over cut
//! (CUT-14).
//!
//! Invariant: what is held back is released in its order.

use crate::canon::{ArcFeed, Canon, CanonStep};
use crate::canon_modes::Plane;
use crate::cutting::CuttingTool;
use crate::material::Material;
use crate::move_split::{divided, end};
use crate::pose::{Axis, Pose};
use std::collections::VecDeque;
use std::sync::Arc;

/// Shortest part of a move that is made, mm.
pub(crate) const SHORTEST_MM: f64 = 0.001;

/// Number of steps that are held at most: what is finer has a shorter tail.
const MAX_STEPS: usize = 10_000;

/// A contour that is being cut.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct OpenContour {
    pub(crate) tool: CuttingTool,
    pub(crate) material: Arc<Material>,
    /// Length of its moves so far, mm.
    pub(crate) length_mm: f64,
    /// Whose feed rate is in force.
    pub(crate) stage: Stage,
    /// Whether its first move has been made.
    pub(crate) is_begun: bool,
    /// Where it began, where that is known in the present coordinates.
    pub(crate) start: Option<Pose>,
    /// Its first moves, as far as an over cut goes, and their length in mm.
    head: Vec<Piece>,
    head_mm: f64,
    /// Steps that are held back, and the length of their moves in mm.
    held: VecDeque<(CanonStep, Option<Piece>)>,
    held_mm: f64,
}

/// A part of a contour with a feed rate of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stage {
    /// Behind the others.
    Full,
    /// The pierce in motion.
    Pierce,
    /// The creep.
    Creep,
}

/// A feed move with its beginning and its length.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Piece {
    pub(crate) from: Pose,
    pub(crate) canon: Canon,
    pub(crate) length_mm: f64,
}

impl Piece {
    /// The same way back.
    fn reversed(&self) -> Canon {
        match &self.canon {
            Canon::ArcFeed(arc) => Canon::ArcFeed(ArcFeed { end: self.from, turns: -arc.turns, ..*arc }),
            _ => Canon::StraightFeed(self.from),
        }
    }

    /// Divides it at a length; `None` where one of the parts would be too short.
    pub(crate) fn divided_at(&self, mm: f64) -> Option<[Piece; 2]> {
        if mm < SHORTEST_MM || self.length_mm - mm < SHORTEST_MM {
            return None;
        }
        let [first, second] = divided(&self.from, &self.canon, mm / self.length_mm);
        let middle = end(&first)?;
        let rest_mm = self.length_mm - mm;
        Some([
            Piece { from: self.from, canon: first, length_mm: mm },
            Piece { from: middle, canon: second, length_mm: rest_mm },
        ])
    }
}

/// Whether the feed rate behind the pierce of a contour is another one for some length.
fn creeps(material: &Material) -> bool {
    material.creep_percent > 0.0 || material.creep_feed_mm_per_min > 0.0
}

impl OpenContour {
    /// The contour that begins where this tool is lit, if any of its ends differs from what the program says.
    pub(crate) fn begin(tool: CuttingTool, material: Option<&Arc<Material>>, start: Pose) -> Option<OpenContour> {
        let material = material.cloned().unwrap_or_default();
        let creeps = material.creep_mm > 0.0 && creeps(&material);
        let pierces = material.pierce_mm > 0.0 || material.wiggles > 0.0 || material.circles > 0.0;
        let ends = material.off_before_mm > 0.0
            || material.over_cut_mm > 0.0
            || tool.abrasive_lag_mm > 0.0
            || tool.height_hold_mm > 0.0;
        let differs = creeps || pierces || ends;
        differs.then(|| OpenContour {
            tool,
            material,
            length_mm: 0.0,
            stage: Stage::Full,
            is_begun: false,
            start: Some(start),
            head: Vec::new(),
            head_mm: 0.0,
            held: VecDeque::new(),
            held_mm: 0.0,
        })
    }

    /// The stage in which the contour goes on, and the length in mm to its end.
    pub(crate) fn stage_here(&self) -> (Stage, f64) {
        let Material { pierce_mm, creep_mm, .. } = *self.material;
        let to = |end_mm: f64| end_mm - self.length_mm;
        if to(pierce_mm) >= SHORTEST_MM {
            (Stage::Pierce, to(pierce_mm))
        } else if creeps(&self.material) && to(creep_mm) >= SHORTEST_MM {
            (Stage::Creep, to(creep_mm))
        } else {
            (Stage::Full, f64::INFINITY)
        }
    }

    /// Feed rate of a stage where the program's is `rate`, in program units of `unit_mm` per minute.
    pub(crate) fn rate(&self, stage: Stage, rate: f64, unit_mm: f64) -> f64 {
        let Material { pierce_feed_mm_per_min, creep_feed_mm_per_min, .. } = *self.material;
        match stage {
            Stage::Pierce if pierce_feed_mm_per_min > 0.0 => pierce_feed_mm_per_min / unit_mm,
            Stage::Creep if creep_feed_mm_per_min > 0.0 => creep_feed_mm_per_min / unit_mm,
            Stage::Creep => rate * self.material.creep_percent / 100.0,
            _ => rate,
        }
    }

    /// The moves of a wiggle along the first move and of a circle about its beginning; they end where they begin.
    pub(crate) fn excursions(&self, first: &Piece, unit_mm: f64) -> Vec<Canon> {
        let Material { wiggle_mm, wiggles, circle_mm, circles, .. } = *self.material;
        let mut moves = Vec::new();
        if wiggle_mm > 0.0 {
            let out = first.divided_at(wiggle_mm).map_or_else(|| first.clone(), |[part, _]| part);
            for _ in 0..wiggles as u32 {
                moves.extend([out.canon.clone(), out.reversed()]);
            }
        }
        if circle_mm > 0.0 && circles > 0.0 {
            let [x, y] = [Axis::X, Axis::Y].map(|axis| first.from[axis]);
            let side = first.from.with(Axis::X, x + circle_mm / unit_mm);
            let turns = circles as i32;
            let turn = ArcFeed { plane: Plane::Xy, end: side, first_centre: x, second_centre: y, turns };
            moves.extend([Canon::StraightFeed(side), Canon::ArcFeed(turn), Canon::StraightFeed(first.from)]);
        }
        moves
    }

    /// Distance in mm before the end at which the cutter, or else the abrasive or height control, is switched off.
    pub(crate) fn tail_mm(&self) -> f64 {
        let lengths = [self.material.off_before_mm, self.tool.abrasive_lag_mm, self.tool.height_hold_mm];
        lengths.into_iter().find(|&mm| mm > 0.0).unwrap_or_default()
    }

    /// Emits a step, or holds it back.
    pub(crate) fn pass(&mut self, step: CanonStep, piece: Option<Piece>, steps: &mut Vec<CanonStep>) {
        if let Some(piece) = &piece {
            if self.head_mm < self.material.over_cut_mm && self.head.len() < MAX_STEPS {
                self.head_mm += piece.length_mm;
                self.head.push(piece.clone());
            }
            self.held_mm += piece.length_mm;
        }
        if self.tail_mm() == 0.0 {
            self.held_mm = 0.0;
            return steps.push(step);
        }
        self.held.push_back((step, piece));
        let mm = |held: &(CanonStep, Option<Piece>)| held.1.as_ref().map_or(0.0, |piece| piece.length_mm);
        while let Some(front) = self.held.front().map(mm)
            && (self.held_mm - front >= self.tail_mm() || self.held.len() > MAX_STEPS)
            && let Some((step, _)) = self.held.pop_front()
        {
            self.held_mm -= front;
            steps.push(step);
        }
    }

    /// Emits what is held back.
    pub(crate) fn release(&mut self, steps: &mut Vec<CanonStep>) {
        steps.extend(self.held.drain(..).map(|(step, _)| step));
        self.held_mm = 0.0;
    }

    /// Emits what is held back, with `switched` at the distance of the tail from the end. Returns whether it was: a
    /// contour that is shorter ends as the program says.
    pub(crate) fn release_with(&mut self, switched: &Canon, steps: &mut Vec<CanonStep>) -> bool {
        let mut before_mm = self.held_mm - self.tail_mm();
        if before_mm < -SHORTEST_MM {
            self.release(steps);
            return false;
        }
        let mut is_switched = false;
        for (step, piece) in std::mem::take(&mut self.held) {
            let Some(piece) = piece.filter(|_| !is_switched) else {
                steps.push(step);
                continue;
            };
            let of = |canon: Canon| CanonStep { canon, ..step.clone() };
            if before_mm < SHORTEST_MM {
                steps.extend([of(switched.clone()), of(piece.canon)]);
                is_switched = true;
            } else if let Some([first, second]) = piece.divided_at(before_mm) {
                steps.extend([of(first.canon), of(switched.clone()), of(second.canon)]);
                is_switched = true;
            } else {
                before_mm -= piece.length_mm;
                steps.push(of(piece.canon));
            }
        }
        self.held_mm = 0.0;
        is_switched
    }

    /// Moves along the beginning of the contour again.
    pub(crate) fn over_cut(&self, step: &CanonStep, steps: &mut Vec<CanonStep>) {
        let mut rest_mm = self.material.over_cut_mm;
        for piece in &self.head {
            let part = piece.divided_at(rest_mm).map(|[first, _]| first);
            let (part, is_last) = part.map_or((piece.clone(), false), |part| (part, true));
            rest_mm -= part.length_mm;
            steps.push(CanonStep { canon: part.canon, ..step.clone() });
            if is_last || rest_mm < SHORTEST_MM {
                return;
            }
        }
    }
}
