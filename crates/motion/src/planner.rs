//! The planner: moves go in, records come out, look-ahead in between.
//!
//! Invariant: what comes out depends on the moves, their modes and the stops, in their order, and on nothing else: never on
//! when records are asked for. A committed record never changes, and what is committed can always be followed by a stop.

use retrace_core::{Flags, Record};

use crate::curve::{Arc, Curve};
use crate::emitter::{Emitter, Item, SetPoint, counts_of};
use crate::envelope::Block;
use crate::error::{LimitError, MoveError};
use crate::limits::{AxisLimits, Limits};
use crate::lookahead::{LookAhead, Span};
use crate::piece::{Joint, Piece};
use crate::profile::Profile;
use crate::stepwise;

/// How fast a move goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Feed {
    /// Along the path, mm/s (G94); degrees/s where only rotary axes move.
    PerSecond(f64),
    /// The whole move takes this long at least, s (G93).
    Duration(f64),
    /// As fast as the machine can (G0).
    Rapid,
}

/// How a move goes over into the next one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PathMode {
    /// Full stop at the end of the move (G61.1).
    ExactStop,
    /// Exactly along the path; full stops only where it is not smooth (G61).
    ExactPath,
    /// Corners may be cut by up to the tolerance (G64 P).
    Blend {
        /// Largest distance from the programmed path, mm.
        tolerance_mm: f64,
    },
}

/// Plans moves and emits one record a control period.
#[derive(Debug)]
pub struct Planner<const A: usize> {
    axes: AxisLimits<A>,
    pulses_per_mm: [f64; A],
    emitter: Emitter<A>,
    run: Run,
    /// The last piece, kept back until the joint at its end is known.
    tail: Option<Tail<A>>,
    /// Where the last move ends.
    at: [f64; A],
    /// Program line of the last move.
    tag: u32,
    /// Where the last stop is, and the flags its record carries.
    rest: ([f64; A], Flags),
}

#[derive(Debug)]
struct Tail<const A: usize> {
    piece: Piece<A>,
    mode: PathMode,
    /// The joint at its start.
    entry: Joint,
}

/// The road since the last stop, as far as it is not committed.
#[derive(Debug, Default)]
struct Run {
    blocks: Vec<Block>,
    /// Sum of their lengths, mm.
    length: f64,
    /// Number of the piece that the first block is, or is the rest of.
    first_piece: u64,
    /// How much of that piece is committed, mm.
    offset: f64,
    /// Speed and acceleration at the start.
    v: f64,
    a: f64,
    /// The plan over the first `planned` blocks; it ends at rest.
    plan: Vec<Span>,
    planned: usize,
    look_ahead: LookAhead,
    /// Spans of the next plan, kept for their memory.
    fresh: Vec<Span>,
    /// Road in mm that is kept back when a part of the plan is committed.
    keep: f64,
}

/// Blocks after which a run is planned and partly committed even if they are short.
const MOST_BLOCKS: usize = 8192;

impl<const A: usize> Planner<A> {
    /// A planner at rest at `start_mm`.
    ///
    /// # Errors
    /// E41xx: a limit is out of its range.
    pub fn new(limits: Limits<A>, start_mm: [f64; A]) -> Result<Self, LimitError> {
        limits.validate()?;
        let axes = limits.planned();
        let least = |of: [f64; A]| of.into_iter().fold(f64::MAX, f64::min);
        let (v, a, j) = (axes.path_v, least(axes.a), least(axes.j));
        let stopping = 0.5 * v * (v / a + a / j);
        Ok(Self {
            axes,
            pulses_per_mm: limits.pulses_per_mm,
            emitter: Emitter::new(limits, start_mm),
            run: Run { keep: 3.0 * stopping, ..Run::default() },
            tail: None,
            at: start_mm,
            tag: 0,
            rest: (start_mm, Flags::NONE),
        })
    }

    /// Where the last move ends, mm.
    #[must_use]
    pub fn commanded_mm(&self) -> [f64; A] {
        self.at
    }

    /// A straight move to `end_mm`; `tag` is its program line.
    ///
    /// # Errors
    /// E4001, E4002; nothing is changed then.
    pub fn line(&mut self, end_mm: [f64; A], feed: Feed, mode: PathMode, tag: u32) -> Result<(), MoveError> {
        check(&end_mm, feed, mode)?;
        let (curve, length) = Curve::line(self.at, end_mm);
        self.add(curve, length, end_mm, feed, mode, tag);
        Ok(())
    }

    /// An arc or helix; `tag` is its program line.
    ///
    /// # Errors
    /// E4001 … E4004; nothing is changed then.
    pub fn arc(&mut self, arc: &Arc<A>, feed: Feed, mode: PathMode, tag: u32) -> Result<(), MoveError> {
        check(&arc.end_mm, feed, mode)?;
        check(&arc.centre_mm, feed, mode)?;
        let (curve, length) = Curve::arc(self.at, arc)?;
        self.add(curve, length, arc.end_mm, feed, mode, tag);
        Ok(())
    }

    /// A planned stop here: the motion is at rest at the end of the last record, which carries [`Flags::REST`] and `flags`.
    ///
    /// Where nothing has moved since the last stop, and `flags` asks for what that one's record does not carry, the stop
    /// takes one record without motion.
    pub fn stop(&mut self, flags: Flags) {
        let flags = flags.with(Flags::REST);
        let (end, held) = self.rest;
        let moves = self.tail.is_some();
        let counts = |at: &[f64; A]| counts_of(at, &self.pulses_per_mm);
        let elsewhere = counts(&end) != counts(&self.at);
        if moves || elsewhere || !held.has(flags) && flags != Flags::REST {
            self.finish_run(flags);
        }
    }

    /// The next control period's record; `None` where more input, or a stop, is needed first.
    pub fn next_record(&mut self) -> Option<Record<A>> {
        self.emitter.next_record()
    }

    /// The un-rounded set-point at the end of the last record.
    #[must_use]
    pub fn set_point(&self) -> &SetPoint<A> {
        self.emitter.point()
    }

    fn add(&mut self, curve: Curve<A>, length: f64, end: [f64; A], feed: Feed, mode: PathMode, tag: u32) {
        let start = std::mem::replace(&mut self.at, end);
        self.tag = tag;
        if length < 1e-9 {
            return; // no motion; should it end on another pulse, the next stop sees to it
        }
        let feed = match feed {
            Feed::PerSecond(v) => v,
            Feed::Duration(t) => length / t,
            Feed::Rapid => f64::MAX,
        };
        let mut piece = Piece::new(curve, length, feed, tag);
        let mut entry = Joint::STOP;
        if let Some(tail) = &self.tail {
            if tail.mode != PathMode::ExactStop {
                entry = tail.piece.joint(&piece, &self.axes);
            }
            if entry == Joint::STOP {
                self.finish_run_at(start, tail.piece.tag, Flags::REST);
            } else {
                piece.rough_entry = entry.share > 0.0;
                self.push_tail(entry);
                if self.run.is_long() {
                    self.run.replan();
                    self.run.commit_part(&mut self.emitter);
                }
            }
        }
        self.tail = Some(Tail { piece, mode, entry });
    }

    /// The joint at the end of the last piece is known: its block joins the road.
    fn push_tail(&mut self, exit: Joint) {
        if let Some(Tail { piece, entry, .. }) = self.tail.take() {
            let limits = piece.limits(&self.axes, entry.share.max(exit.share));
            let number = self.emitter.append(piece);
            self.run.push(number, Block { length: piece.length, limits, exit_v: exit.v });
        }
    }

    fn finish_run(&mut self, flags: Flags) {
        self.finish_run_at(self.at, self.tag, flags);
    }

    fn finish_run_at(&mut self, end: [f64; A], tag: u32, flags: Flags) {
        self.push_tail(Joint::STOP);
        self.run.replan();
        let piece = self.run.commit_all(&mut self.emitter);
        self.emitter.commit(Item::Stop { piece, end, flags, tag });
        self.rest = (end, flags);
    }
}

fn check(numbers: &[f64], feed: Feed, mode: PathMode) -> Result<(), MoveError> {
    let sound = |x: &f64| x.abs() <= 1e6;
    let tolerance = if let PathMode::Blend { tolerance_mm } = mode { tolerance_mm } else { 0.0 };
    if !numbers.iter().all(sound) || !(0.0..=1e6).contains(&tolerance) {
        return Err(MoveError::NotFinite);
    }
    match feed {
        Feed::PerSecond(value) | Feed::Duration(value) if !(value.is_finite() && value > 0.0) => {
            Err(MoveError::Feed { value })
        }
        _ => Ok(()),
    }
}

impl Run {
    fn push(&mut self, piece: u64, block: Block) {
        if self.blocks.is_empty() {
            (self.first_piece, self.offset, self.length) = (piece, 0.0, 0.0);
        }
        self.length += block.length;
        self.blocks.push(block);
    }

    fn is_long(&self) -> bool {
        self.length > 2.0 * self.keep || self.blocks.len() >= MOST_BLOCKS
    }

    /// Plans all blocks to rest. Where that fails from the present state, the plan there is stays, and what lies beyond its
    /// end is planned from rest.
    fn replan(&mut self) {
        self.fresh.clear();
        if self.blocks.is_empty() {
            return;
        }
        if self.look_ahead.plan(&self.blocks, self.v, self.a, &mut self.fresh).is_ok() {
            std::mem::swap(&mut self.plan, &mut self.fresh);
        } else if self.planned < self.blocks.len() {
            let rest = &self.blocks[self.planned..];
            if self.look_ahead.plan(rest, 0.0, 0.0, &mut self.fresh).is_err() {
                stepwise::plan(rest, &mut self.fresh);
            }
            let beyond = self.planned;
            self.plan.extend(self.fresh.iter().map(|span| Span {
                first: span.first + beyond,
                last: span.last + beyond,
                profile: span.profile,
            }));
        }
        self.planned = self.blocks.len();
    }

    /// Commits the whole plan, which ends at rest; gives the number of the next piece.
    fn commit_all<const A: usize>(&mut self, emitter: &mut Emitter<A>) -> u64 {
        for span in &self.plan {
            emitter.commit(self.item(span, span.profile, span.last - 1));
        }
        let next = self.first_piece + self.blocks.len() as u64;
        self.plan.clear();
        self.blocks.clear();
        (self.planned, self.v, self.a, self.length, self.offset) = (0, 0.0, 0.0, 0.0, 0.0);
        self.first_piece = next;
        next
    }

    /// Places of all joints, mm from the start.
    fn joints(&self) -> Vec<f64> {
        let mut sum = 0.0;
        let ends = self.blocks.iter().map(|block| {
            sum += block.length;
            sum
        });
        std::iter::once(0.0).chain(ends).collect()
    }

    /// The committed form of `profile`, which starts where `span` starts and ends in block `last`.
    fn item<const A: usize>(&self, span: &Span, profile: Profile, last: usize) -> Item<A> {
        let offset = if span.first == 0 { self.offset } else { 0.0 };
        let (piece, last) = (self.first_piece + span.first as u64, self.first_piece + last as u64);
        Item::Span { piece, last, offset, profile, duration: profile.duration() }
    }

    /// Commits the plan up to a place inside the block that lies `keep` before the end, or in the middle of the blocks where
    /// they are shorter than that.
    fn commit_part<const A: usize>(&mut self, emitter: &mut Emitter<A>) {
        let s = self.joints();
        let target = if self.length > 2.0 * self.keep { self.length - self.keep } else { s[self.blocks.len() / 2] };
        let block = s.partition_point(|&s| s <= target).clamp(1, self.blocks.len()) - 1;
        // Away from the joints, so that no block is left with no length.
        let (from, to) = (s[block], s[block + 1]);
        let target = target.clamp(0.75 * from + 0.25 * to, 0.25 * from + 0.75 * to);
        let cut = self.plan.partition_point(|span| s[span.last] <= target);
        let Some(&crossing) = self.plan.get(cut) else { return };
        for span in &self.plan[..cut] {
            emitter.commit(self.item(span, span.profile, span.last - 1));
        }
        let (before, after) = crossing.profile.cut(crossing.profile.time_at(target - s[crossing.first]));
        emitter.commit(self.item(&crossing, before, block));
        self.plan.drain(..cut);
        self.plan[0].profile = after;
        for span in &mut self.plan {
            span.first = span.first.saturating_sub(block);
            span.last -= block;
        }
        self.blocks.drain(..block);
        let left = to - target;
        self.offset = if block == 0 { self.offset } else { 0.0 } + (self.blocks[0].length - left);
        self.blocks[0].length = left;
        self.first_piece += block as u64;
        self.planned -= block;
        self.length -= target;
        (self.v, self.a) = (after.v0, after.a0);
    }
}
