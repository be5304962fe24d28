//! Branches on unknown conditions: both sides are followed from the same state, and joined where they meet (PRB-18).
//!
//! Invariant: between two lines the interpreter has the state of the path at the least line of the innermost level; the
//! states of the others wait. Without an unknown condition nothing waits, and nothing is different from a run.

use crate::canon::{BranchStart, Canon, CanonStep};
use crate::compiled_code::Jump;
use crate::diag::{BlockError, Span};
use crate::error_codes::ErrorCode;
use crate::flow_controller::FlowController;
use crate::interp::Interpreter;
use crate::path_explorer::{LoopRound, PathExplorer, PathPlace, PlaceKind};
use crate::path_state::PathState;

/// Number of joined rounds after which everything is unknown, so that few more can follow.
const MAX_JOINED_ROUNDS: u32 = 6;

/// Number of joined rounds after which the loop is not followed any more.
const MAX_ROUNDS: u32 = 20;

/// Appends that another path is followed, or the joined one.
fn follow(is_certain: bool, interpreter: Option<&Interpreter>, steps: &mut Vec<CanonStep>) {
    let state = interpreter.map(|interpreter| interpreter.state().branch_state());
    let canon = Canon::FollowBranch(Box::new(BranchStart { is_certain, state }));
    steps.push(CanonStep { line: 0, number: None, canon });
}

impl FlowController {
    /// Follows both sides of branches on unknown values from now on.
    pub(crate) fn explore(&mut self) {
        self.explorer = Some(Box::default());
    }

    /// Lets a copy of the current path wait at line `to` of the level: the other side of a branch.
    pub(crate) fn fork(
        &mut self,
        to: u32,
        is_undecided: bool,
        interpreter: &mut Interpreter,
        steps: &mut Vec<CanonStep>,
    ) {
        let Some(level) = self.levels.last() else { return };
        let mut loops = self.loops.clone();
        loops.leave(to, level.loops);
        let kind = if is_undecided { PlaceKind::Undecided } else { PlaceKind::Executes };
        self.wait(PathPlace { line: to, kind }, interpreter.path_state(loops), interpreter);
        follow(false, None, steps);
    }

    fn wait(&mut self, place: PathPlace, state: PathState, interpreter: &mut Interpreter) {
        let depth = self.levels.len();
        if let Some(explorer) = &mut self.explorer {
            explorer.wait((depth, place), state, |state, other| interpreter.join_states(state, other));
        }
    }

    /// Joins the rounds of the loop that begins at `line`, which is executed now.
    pub(crate) fn begin_joined_loop(&mut self, line: u32, interpreter: &Interpreter) {
        let (depth, loops) = (self.levels.len(), &self.loops);
        if let Some(explorer) = &mut self.explorer {
            explorer.joined_state(depth, line).get_or_insert_with(|| interpreter.path_state(loops.clone()));
        }
    }

    /// Runs `change` on the explorer with the depth of the current level.
    pub(crate) fn with_explorer(&mut self, change: impl FnOnce(&mut PathExplorer, usize)) {
        let depth = self.levels.len();
        if let Some(explorer) = &mut self.explorer {
            change(explorer, depth);
        }
    }

    /// Whether the number of rounds of the loop that begins at this line is unknown.
    pub(crate) fn is_joined_loop(&self, line: u32) -> bool {
        self.explorer.as_ref().is_some_and(|explorer| explorer.is_joined(self.levels.len(), line))
    }

    /// Whether it depends on an answer of the machine that the program comes to the current path.
    pub(crate) fn is_path_uncertain(&self) -> bool {
        self.explorer.as_ref().is_some_and(|explorer| !explorer.is_certain())
    }

    /// Whether other paths wait in the current level, so that it cannot be left yet.
    pub(crate) fn has_waiting(&self) -> bool {
        self.explorer.as_ref().is_some_and(|explorer| explorer.waits_at(self.levels.len()))
    }

    /// Chooses the path to be followed next, behind the line executed last, and joins those that meet. Returns false
    /// where none is left: the program has ended on all of them.
    pub(crate) fn settle(&mut self, interpreter: &mut Interpreter, steps: &mut Vec<CanonStep>) -> bool {
        let (depth_before, line) = self.executed;
        let depth = self.levels.len();
        let Some(mut explorer) = self.explorer.take() else { return true };
        if depth > depth_before {
            explorer.begin_level(depth);
        }
        let is_alive = match self.levels.last() {
            None => true,
            Some(level) if explorer.is_single() && (depth != depth_before || level.next > line) => true,
            Some(level) => {
                let kind = if self.is_undecided { PlaceKind::Undecided } else { PlaceKind::Executes };
                let jumps_back = depth == depth_before && level.next <= line && !self.repeats_call;
                let place = match jumps_back {
                    true => PathPlace { line: line + 1, kind: PlaceKind::JumpsBack(level.next) },
                    false => PathPlace { line: level.next, kind },
                };
                self.choose(&mut explorer, place, interpreter, steps)
            }
        };
        self.repeats_call = false;
        self.explorer = Some(explorer);
        is_alive
    }

    /// Follows the first path of the level, where the current one is at `here`.
    fn choose(
        &mut self,
        explorer: &mut PathExplorer,
        mut here: PathPlace,
        interpreter: &mut Interpreter,
        steps: &mut Vec<CanonStep>,
    ) -> bool {
        let mut is_changed = false;
        loop {
            let depth = self.levels.len();
            match explorer.first_at(depth) {
                Some(first) if first < here => {
                    let state = interpreter.path_state(std::mem::take(&mut self.loops));
                    explorer.wait((depth, here), state, |state, other| interpreter.join_states(state, other));
                    if let Some(state) = explorer.take(depth, first) {
                        self.loops = interpreter.restore_path(state);
                    }
                    (here, is_changed) = (first, true);
                }
                Some(first) if first == here => {
                    if let Some(state) = explorer.take(depth, first) {
                        interpreter.join_path(&state);
                    }
                    is_changed = true;
                }
                _ => match here.kind {
                    PlaceKind::JumpsBack(head) => {
                        if self.begins_round(explorer, (head, here.line - 1), interpreter, &mut is_changed) {
                            explorer.entered = (self.loop_line(here.line - 1) == Some(head)).then_some((depth, head));
                            here = PathPlace { line: head, kind: PlaceKind::Executes };
                            break;
                        }
                        let Some(next) = self.take_first(explorer, interpreter) else { return false };
                        (here, is_changed) = (next, true);
                    }
                    _ => break,
                },
            }
        }
        if let Some(level) = self.levels.last_mut() {
            level.next = here.line;
        }
        self.is_undecided = here.kind == PlaceKind::Undecided;
        if is_changed {
            follow(explorer.is_certain(), Some(interpreter), steps);
        }
        true
    }

    /// Returns the line that begins the loop which the line `end` repeats. That of a do or a repeat is above the line
    /// that is jumped to, which may begin another loop.
    fn loop_line(&self, end: u32) -> Option<u32> {
        let level = self.levels.last()?;
        match level.code.jump(end)? {
            Jump::EndRepeat { begin } | Jump::WhileOfDo { begin } => Some(begin - 1),
            Jump::Leave { to } | Jump::GoTo { to, .. } => Some(to),
            _ => None,
        }
    }

    /// Whether another round of the loop follows, with lines `head` to `end`; its state may be joined with the rounds
    /// before.
    fn begins_round(
        &mut self,
        explorer: &mut PathExplorer,
        (head, end): (u32, u32),
        interpreter: &mut Interpreter,
        is_changed: &mut bool,
    ) -> bool {
        let depth = self.levels.len();
        let head = self.loop_line(end).unwrap_or(head);
        let LoopRound::Joined(rounds) = explorer.jump_back(depth, head, end) else { return true };
        let joined = explorer.joined_state(depth, head);
        if let Some(before) = joined {
            interpreter.join_path(before);
            if rounds == MAX_JOINED_ROUNDS {
                interpreter.forget_all();
            }
        }
        *is_changed = true;
        let now = interpreter.path_state(self.loops.clone());
        if joined.as_ref().is_some_and(|before| before.is_same(&now)) {
            return false;
        }
        if rounds > MAX_ROUNDS {
            let message = "checking stopped here: the values of the loop do not come to rest";
            interpreter.report(BlockError::new(ErrorCode::CheckStopped, Span::default(), message));
            return false;
        }
        *joined = Some(now);
        true
    }

    /// Follows the first waiting path of any level, in place of the current one.
    fn take_first(&mut self, explorer: &mut PathExplorer, interpreter: &mut Interpreter) -> Option<PathPlace> {
        let (depth, place) = explorer.first()?;
        let state = explorer.take(depth, place)?;
        let left = self.levels.drain(depth..).filter(|level| level.call.is_some()).count();
        self.calls = self.calls.saturating_sub(left);
        self.loops = interpreter.restore_path(state);
        if let Some(level) = self.levels.last_mut() {
            level.next = place.line;
        }
        self.is_undecided = place.kind == PlaceKind::Undecided;
        Some(place)
    }

    /// Ends the current path: the program ends on it, or nothing is known about its next line. Returns whether another
    /// path is followed.
    pub(crate) fn end_path(&mut self, interpreter: &mut Interpreter, steps: &mut Vec<CanonStep>) -> bool {
        let Some(mut explorer) = self.explorer.take() else { return false };
        if let Some(ended) = explorer.take_ended() {
            interpreter.join_path(&ended);
        }
        if !explorer.is_single() {
            explorer.end(interpreter.path_state(self.loops.clone()));
        }
        self.follow_next(explorer, interpreter, steps)
    }

    /// Ends the current path at an ABORT: what it leaves does not count. Returns whether another path is followed.
    pub(crate) fn abort_path(&mut self, interpreter: &mut Interpreter, steps: &mut Vec<CanonStep>) -> bool {
        let Some(mut explorer) = self.explorer.take() else { return false };
        if explorer.is_single()
            && let Some(ended) = explorer.take_ended()
        {
            interpreter.restore_path(ended);
        }
        self.follow_next(explorer, interpreter, steps)
    }

    /// Follows the next of the waiting paths. Returns false without one.
    fn follow_next(
        &mut self,
        mut explorer: Box<PathExplorer>,
        interpreter: &mut Interpreter,
        steps: &mut Vec<CanonStep>,
    ) -> bool {
        let mut is_alive = false;
        if let Some(here) = self.take_first(&mut explorer, interpreter) {
            // What follows is not behind the line executed last.
            self.executed = (usize::MAX, 0);
            is_alive = self.choose(&mut explorer, here, interpreter, steps);
            follow(explorer.is_certain(), Some(interpreter), steps);
        }
        self.explorer = Some(explorer);
        is_alive
    }
}
