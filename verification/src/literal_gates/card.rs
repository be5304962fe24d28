//! The card in both searches: motion and switching run in parallel, each in the order in which it was sent.
//!
//! Invariant: a failure is permanent once it has occurred; it is determined in the card's own time, by what has begun
//! and ended.

use std::fmt;

use super::Program;

/// Failure in the card's own time line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Failure {
    /// A record began before an instruction ahead of it was complete.
    MotionTooEarly,
    /// An instruction began before the motion ahead of it was complete.
    InstructionTooEarly,
    /// Gates B and C were open together for one marker.
    BothOpen,
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::MotionTooEarly => "motion begins before an instruction that stands before it is complete",
            Self::InstructionTooEarly => "an instruction begins before the motion ahead of it is complete",
            Self::BothOpen => "gates B and C are open together for one marker",
        })
    }
}

/// Progress of motion and switching.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(super) struct Card {
    /// Records in the data buffer, run or not.
    pub(super) records: u8,
    /// Records that fine interpolation has completed.
    pub(super) played: u8,
    /// Whether a record is being played.
    pub(super) is_moving: bool,
    /// Instructions in the card's M buffer, executed or not.
    pub(super) instructions: u8,
    /// Instructions completed.
    pub(super) executed: u8,
    /// Whether an instruction is being executed.
    pub(super) is_switching: bool,
    pub(super) failure: Option<Failure>,
}

/// Possible next step of the card.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Act {
    /// Fine interpolation begins the next record.
    BeginRecord,
    /// … completes it.
    EndRecord,
    /// The executor begins the next instruction.
    BeginInstruction,
    /// … completes it.
    EndInstruction,
}

impl Act {
    const ALL: [Self; 4] = [Self::BeginRecord, Self::EndRecord, Self::BeginInstruction, Self::EndInstruction];

    /// Description of the step as taken from `card`.
    pub(super) fn words(self, card: &Card) -> String {
        let (record, number) = (card.played + 1, card.executed + 1);
        match self {
            Self::BeginRecord => format!("The card begins record {record}"),
            Self::EndRecord => format!("The card has completed record {record}"),
            Self::BeginInstruction => format!("The card begins instruction {number}"),
            Self::EndInstruction => format!("The card has completed instruction {number}"),
        }
    }
}

impl Card {
    /// Whether the switching interface is ready: every instruction that arrived is executed.
    pub(super) fn is_ready(&self) -> bool {
        self.executed == self.instructions
    }

    /// Whether fine interpolation has finished: every record that arrived is executed.
    pub(super) fn has_finished(&self) -> bool {
        self.played == self.records
    }

    /// Whether the whole program has been executed.
    pub(super) fn is_done(&self, program: &Program) -> bool {
        self.played == program.records && usize::from(self.executed) == program.markers.len()
    }

    /// Every possible next step of the card, with its result.
    pub(super) fn acts(self, program: &Program) -> impl Iterator<Item = (Act, Self)> {
        Act::ALL.into_iter().filter_map(move |act| Some((act, self.after(act, program)?)))
    }

    fn after(mut self, act: Act, program: &Program) -> Option<Self> {
        let may = match act {
            Act::BeginRecord => !self.is_moving && self.played < self.records,
            Act::EndRecord => self.is_moving,
            Act::BeginInstruction => !self.is_switching && self.executed < self.instructions,
            Act::EndInstruction => self.is_switching,
        };
        if !may {
            return None;
        }
        match act {
            Act::BeginRecord => {
                let before = program.markers.iter().filter(|marker| **marker <= self.played).count();
                if usize::from(self.executed) < before {
                    self.failure = Some(Failure::MotionTooEarly);
                }
                self.is_moving = true;
            }
            Act::EndRecord => {
                self.is_moving = false;
                self.played += 1;
            }
            Act::BeginInstruction => {
                if self.played < program.markers[usize::from(self.executed)] {
                    self.failure = Some(Failure::InstructionTooEarly);
                }
                self.is_switching = true;
            }
            Act::EndInstruction => {
                self.is_switching = false;
                self.executed += 1;
            }
        }
        Some(self)
    }
}

/// Reports on their way from the card, oldest first; their number is limited.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Line<R> {
    under_way: [Option<R>; 3],
}

impl<R: Copy> Line<R> {
    pub(super) const EMPTY: Self = Self { under_way: [None; 3] };

    /// With another report behind the others; `None` where `delay` of them are under way.
    pub(super) fn sent(mut self, report: R, delay: usize) -> Option<Self> {
        let free = self.under_way.iter_mut().take(delay).find(|place| place.is_none())?;
        *free = Some(report);
        Some(self)
    }

    /// The oldest report, and the line without it.
    pub(super) fn received(self) -> Option<(R, Self)> {
        let [first, second, third] = self.under_way;
        Some((first?, Self { under_way: [second, third, None] }))
    }
}
