//! The paths of a check that wait to be followed, and the heads of the loops that are followed until their state
//! repeats (PRB-18).
//!
//! Invariant: of the paths of a level of calls the one with the least line is followed first, and paths that meet at a
//! line are joined there. So no path is multiplied by another, and a level is left by one path. A loop whose number of
//! rounds is not known is left once the joined state at its head repeats.

use crate::path_state::PathState;

/// Line of a level at which its subprogram returns, behind all others.
pub(crate) const RETURN: u32 = u32::MAX;

/// Number of rounds with an unknown way out of a loop after which it is followed by joined states. Before, its values
/// stay known from round to round.
const MAX_EXACT_ROUNDS: u32 = 200;

/// The same, where the only ways out are ends of the program.
const MAX_EXACT_ROUNDS_TO_END: u32 = 10_000;

/// Place in the lines of a level at which a path is followed. Before a line come the jumps back from the line above.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct PathPlace {
    pub(crate) line: u32,
    pub(crate) kind: PlaceKind,
}

/// How a path comes to a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum PlaceKind {
    /// It jumps back to this line, from the line above.
    JumpsBack(u32),
    /// It executes the line.
    Executes,
    /// A condition was false, and the line decides.
    Undecided,
}

/// A path that waits.
#[derive(Clone, Debug)]
struct WaitingPath {
    /// Number of levels of calls and regions.
    depth: usize,
    place: PathPlace,
    state: PathState,
    /// Serial number of the last change.
    changed: u64,
}

/// A line that a loop jumps back to.
#[derive(Clone, Debug)]
struct LoopHead {
    depth: usize,
    line: u32,
    /// Joined state of all rounds; `None` while the rounds are followed one by one.
    state: Option<PathState>,
    /// Whether the rounds are to be joined from the next one on.
    is_unknown: bool,
    /// Serial number at the last round.
    serial: u64,
    /// Number of rounds with an unknown way out, or that were joined.
    rounds: u32,
}

/// What follows from a jump back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LoopRound {
    /// Another round, with the state as it is.
    Exact,
    /// Another round, to be followed with the state joined with those before.
    Joined(u32),
}

/// Paths that wait, and heads of loops.
#[derive(Debug, Default)]
pub(crate) struct PathExplorer {
    waiting: Vec<WaitingPath>,
    heads: Vec<LoopHead>,
    /// Joined state of the paths that have ended the program, and its serial number.
    ended: Option<(PathState, u64)>,
    serial: u64,
    /// The head that was jumped back to last, until it is executed.
    pub(crate) entered: Option<(usize, u32)>,
}

impl PathExplorer {
    /// Whether no other path waits.
    pub(crate) fn is_single(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Whether the program comes to the current path whatever the machine answers: no other one waits, or has ended.
    pub(crate) fn is_certain(&self) -> bool {
        self.waiting.is_empty() && self.ended.is_none()
    }

    /// Whether a path waits in this level.
    pub(crate) fn waits_at(&self, depth: usize) -> bool {
        self.waiting.iter().any(|path| path.depth == depth)
    }

    /// Lets a path wait. `join` joins two states.
    pub(crate) fn wait(
        &mut self,
        (depth, place): (usize, PathPlace),
        state: PathState,
        join: impl FnOnce(PathState, &PathState) -> PathState,
    ) {
        self.serial += 1;
        match self.waiting.iter_mut().find(|path| (path.depth, path.place) == (depth, place)) {
            Some(path) => {
                path.state = join(state, &path.state);
                path.changed = self.serial;
            }
            None => self.waiting.push(WaitingPath { depth, place, state, changed: self.serial }),
        }
    }

    /// Returns the place of the path to be followed first in this level.
    pub(crate) fn first_at(&self, depth: usize) -> Option<PathPlace> {
        self.waiting.iter().filter(|path| path.depth == depth).map(|path| path.place).min()
    }

    /// Takes out the path at a place.
    pub(crate) fn take(&mut self, depth: usize, place: PathPlace) -> Option<PathState> {
        let index = self.waiting.iter().position(|path| (path.depth, path.place) == (depth, place))?;
        Some(self.waiting.swap_remove(index).state)
    }

    /// Returns level and place of the path to be followed first in the innermost level that has one.
    pub(crate) fn first(&self) -> Option<(usize, PathPlace)> {
        let depth = self.waiting.iter().map(|path| path.depth).max()?;
        Some((depth, self.first_at(depth)?))
    }

    /// Records the state of a path that has ended the program.
    pub(crate) fn end(&mut self, state: PathState) {
        self.serial += 1;
        self.ended = Some((state, self.serial));
    }

    /// Takes out the joined state of the paths that have ended the program.
    pub(crate) fn take_ended(&mut self) -> Option<PathState> {
        self.ended.take().map(|(state, _)| state)
    }

    /// Forgets the loops of this level and of those inside of it: a subprogram begins.
    pub(crate) fn begin_level(&mut self, depth: usize) {
        self.heads.retain(|head| head.depth < depth);
    }

    /// Forgets a loop: it begins.
    pub(crate) fn begin_loop(&mut self, depth: usize, line: u32) {
        self.heads.retain(|head| (head.depth, head.line) != (depth, line));
    }

    fn head(&mut self, depth: usize, line: u32) -> &mut LoopHead {
        let known = self.heads.iter().position(|head| (head.depth, head.line) == (depth, line));
        let index = known.unwrap_or_else(|| {
            self.heads.push(LoopHead { depth, line, state: None, is_unknown: false, serial: self.serial, rounds: 0 });
            self.heads.len() - 1
        });
        &mut self.heads[index]
    }

    /// Joins the rounds of a loop from its next one on: how often it is repeated is unknown.
    pub(crate) fn set_unknown(&mut self, depth: usize, line: u32) {
        self.head(depth, line).is_unknown = true;
    }

    /// Whether the rounds of a loop are joined.
    pub(crate) fn is_joined(&self, depth: usize, line: u32) -> bool {
        self.heads.iter().any(|head| (head.depth, head.line) == (depth, line) && head.state.is_some())
    }

    /// Returns the joined state at the head of a loop.
    pub(crate) fn joined_state(&mut self, depth: usize, line: u32) -> &mut Option<PathState> {
        &mut self.head(depth, line).state
    }

    /// Records a jump back from `from` to `line`, and returns what follows.
    pub(crate) fn jump_back(&mut self, depth: usize, line: u32, from: u32) -> LoopRound {
        let is_inner = |head: &LoopHead| head.depth == depth && head.line > line && head.line <= from;
        self.heads.retain(|head| head.depth <= depth && !is_inner(head));
        let serial = self.serial;
        let (last_exit, last_end) = (
            self.waiting.iter().map(|path| path.changed).max().unwrap_or_default(),
            self.ended.as_ref().map_or(0, |(_, serial)| *serial),
        );
        let head = self.head(depth, line);
        if head.state.is_none() {
            let (has_exit, has_end) = (last_exit > head.serial, last_end > head.serial);
            head.rounds += u32::from(has_exit || has_end);
            head.serial = serial;
            let most = if has_exit { MAX_EXACT_ROUNDS } else { MAX_EXACT_ROUNDS_TO_END };
            if !head.is_unknown && head.rounds < most {
                return LoopRound::Exact;
            }
            head.rounds = 0;
            return LoopRound::Joined(0);
        }
        head.rounds += 1;
        LoopRound::Joined(head.rounds)
    }
}
