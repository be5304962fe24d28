//! In what order an interrupted on-line program may go on (DNC-1 … DNC-8).
//!
//! A program fed while it is machined is paused, the operator frees the tool, stops the spindle, does what is needed, and undoes
//! it all step by step; only then the axes go back to the breakpoint, and only there the program is read again. Whoever commands
//! the machine says each [`Word`] here first and does what the answer says.
//!
//! | step | pause | stop spindle | start spindle | jog | on line | cycle start | arrived |
//! |---|---|---|---|---|---|---|---|
//! | reading | → paused, latch | – | – | – | – | – | – |
//! | paused: the spindle turns still | – | → spindle stopped | – | yes | – | – | – |
//! | spindle stopped | – | – | → spindle as it was | yes | – | – | – |
//! | spindle as it was | – | → spindle stopped | – | yes | → on line | – | – |
//! | on line again | → paused | → spindle stopped | – | – | – | → approaching | – |
//! | approaching | → paused | – | – | – | – | – | → reading |
//!
//! A dash is a refusal. Where the spindle stood at the breakpoint, *pause* leads to *spindle as it was* at once, and both words for
//! the spindle are refused until the program goes on. The direction, the program and the place of arrival must be those latched.
//! A word that undoes a step leads back to that step, and what comes after it is said again. A pause on the way back to the
//! breakpoint stops the axes and keeps the breakpoint. The spindle is not stopped under moving axes: pause first.
//!
//! Invariant: the program is read while none of the three flags is set, and from a pause to reading there is one order of words
//! alone: spindle stopped, spindle started (both where it turned), on line, cycle start, arrived. A refusal changes nothing.

/// A direction of the spindle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SpindleDirection {
    /// Clockwise, M3.
    Clockwise,
    /// Counterclockwise, M4.
    Counterclockwise,
}

/// A spindle that turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SpindleState {
    /// Which way.
    pub direction: SpindleDirection,
    /// How fast, in thousandths of a revolution a minute.
    pub speed: u32,
}

/// What is kept of the breakpoint (DNC-2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Breakpoint<const A: usize> {
    /// Which program was interrupted: the same number for the same content only.
    pub program: u64,
    /// Machine counts of each axis, in pulses.
    pub counts: [i64; A],
    /// The spindle; `None` where it stood.
    pub spindle: Option<SpindleState>,
}

/// Something that the operator or the machine says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum InterruptionEvent<const A: usize> {
    /// *Pause*, with what is to be latched. On the way back to a breakpoint that one stays, and this is not looked at (DNC-1).
    Pause(Breakpoint<A>),
    /// The spindle is to stop (DNC-3).
    StopSpindle,
    /// The spindle is to turn, by hand (DNC-4).
    StartSpindle(SpindleDirection),
    /// An axis is to be moved by hand (DNC-3).
    Jog,
    /// Back to on-line mode (DNC-5).
    Online,
    /// *Cycle start*, with the program that would be read (DNC-6).
    CycleStart {
        /// As in [`Latch::program`].
        program: u64,
    },
    /// The axes have come to rest at these machine counts, in pulses (DNC-7).
    Arrived([i64; A]),
}

/// What a word that is taken leads to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum InterruptionAction<const A: usize> {
    /// The axes stop, on-line mode is left.
    Halt,
    /// The spindle stops, on-line mode is left.
    StopSpindle,
    /// The spindle turns as it did.
    StartSpindle(SpindleState),
    /// The axis moves.
    Jog,
    /// On-line mode is entered; nothing is read yet.
    Online,
    /// Every axis goes to these machine counts, in pulses.
    Approach([i64; A]),
    /// The program is read on from the breakpoint (DNC-8).
    GoOn,
}

/// Why a word is not taken: the first thing in the order that is missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum InterruptionError {
    /// The program is not interrupted.
    NotPaused,
    /// The program is interrupted already.
    AlreadyPaused,
    /// The spindle turns; it is stopped first.
    SpindleTurns,
    /// The spindle stands; it is started first, or cannot be stopped.
    SpindleStands,
    /// The spindle stood at the breakpoint; the program goes on with it standing.
    SpindleStood,
    /// The spindle turned in the other direction.
    SpindleDirection,
    /// On-line mode is not restored.
    NotOnline,
    /// On-line mode is restored; no axis is moved by hand in it.
    AlreadyOnline,
    /// Another program is in the place of the interrupted one.
    OtherProgram,
    /// The axes are not on the way to the breakpoint: *cycle start* comes first.
    NotApproaching,
    /// The axes are on the way to the breakpoint; only *pause* stops them.
    Approaching,
    /// The axes are not at the breakpoint; this is the first of them that is not.
    NotThere {
        /// Its index, from 0.
        axis: usize,
    },
}

/// How far the order has been followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Step {
    /// The spindle turns still.
    Paused,
    /// The spindle has been stopped.
    SpindleStopped,
    /// The spindle turns as it did, or stands as it did.
    SpindleAsItWas,
    /// On-line mode is restored.
    OnlineAgain,
    /// The axes are on their way to the breakpoint.
    Approaching,
}

/// An on-line program: read, or interrupted at a breakpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Interruption<const A: usize> {
    breakpoint: Option<(Breakpoint<A>, Step)>,
}

impl<const A: usize> Default for Interruption<A> {
    fn default() -> Self {
        Self::reading()
    }
}

impl<const A: usize> Interruption<A> {
    /// A program that is being read.
    #[must_use]
    pub const fn reading() -> Self {
        Self { breakpoint: None }
    }

    /// May the program be read, and motion begin from it?
    #[must_use]
    pub const fn may_read(&self) -> bool {
        self.breakpoint.is_none()
    }

    /// May an axis be moved by hand?
    #[must_use]
    pub const fn may_jog(&self) -> bool {
        self.mode_changed()
    }

    /// The *DNC-paused flag*: from *pause* until the axes are back (DNC-1, DNC-7).
    #[must_use]
    pub const fn paused(&self) -> bool {
        self.breakpoint.is_some()
    }

    /// The *mode-changed flag*: from *pause* until on-line mode is restored (DNC-2, DNC-5).
    #[must_use]
    pub const fn mode_changed(&self) -> bool {
        matches!(self.breakpoint, Some((_, Step::Paused | Step::SpindleStopped | Step::SpindleAsItWas)))
    }

    /// Is reading the program *inhibited*? From *cycle start* until the axes are back (DNC-6, DNC-7).
    #[must_use]
    pub const fn inhibited(&self) -> bool {
        matches!(self.breakpoint, Some((_, Step::Approaching)))
    }

    /// What is kept of the breakpoint, while there is one.
    #[must_use]
    pub const fn latch(&self) -> Option<&Breakpoint<A>> {
        match &self.breakpoint {
            Some((latch, _)) => Some(latch),
            None => None,
        }
    }

    /// Takes a word, and says what is to be done.
    ///
    /// # Errors
    /// [`Refused`] says why it may not be; nothing has changed then.
    pub const fn apply(&mut self, word: InterruptionEvent<A>) -> Result<InterruptionAction<A>, InterruptionError> {
        let (latch, next) = match (&self.breakpoint, word) {
            (None, InterruptionEvent::Pause(latch)) => (latch, Ok((Self::halted(&latch), InterruptionAction::Halt))),
            (None, _) => return Err(InterruptionError::NotPaused),
            (Some((latch, step)), word) => (*latch, Self::follow(latch, *step, word)),
        };
        match next {
            Ok((step, effect)) => {
                self.breakpoint = if matches!(effect, InterruptionAction::GoOn) { None } else { Some((latch, step)) };
                Ok(effect)
            }
            Err(reason) => Err(reason),
        }
    }

    /// Moves the breakpoint by so many pulses of each axis: a tool of another length is in the spindle. The spindle stands for that, and
    /// the axes are free to be moved by hand.
    ///
    /// # Errors
    /// [`Refused`] says why it may not be; nothing has changed then.
    pub const fn displace(&mut self, pulses: [i64; A]) -> Result<(), InterruptionError> {
        let Some((latch, step)) = &mut self.breakpoint else { return Err(InterruptionError::NotPaused) };
        match step {
            Step::SpindleStopped => {}
            Step::SpindleAsItWas if latch.spindle.is_none() => {}
            Step::Paused | Step::SpindleAsItWas => return Err(InterruptionError::SpindleTurns),
            Step::OnlineAgain => return Err(InterruptionError::AlreadyOnline),
            Step::Approaching => return Err(InterruptionError::Approaching),
        }
        let mut moved = 0;
        while moved < A {
            latch.counts[moved] = latch.counts[moved].saturating_add(pulses[moved]);
            moved += 1;
        }
        Ok(())
    }

    /// The step that a pause leads to.
    const fn halted(latch: &Breakpoint<A>) -> Step {
        if latch.spindle.is_some() { Step::Paused } else { Step::SpindleAsItWas }
    }

    /// The step that a word leads to, at a breakpoint.
    const fn follow(
        latch: &Breakpoint<A>,
        step: Step,
        word: InterruptionEvent<A>,
    ) -> Result<(Step, InterruptionAction<A>), InterruptionError> {
        match (step, word) {
            (Step::OnlineAgain | Step::Approaching, InterruptionEvent::Pause(_)) => {
                Ok((Self::halted(latch), InterruptionAction::Halt))
            }
            (_, InterruptionEvent::Pause(_)) => Err(InterruptionError::AlreadyPaused),
            (Step::Approaching, InterruptionEvent::Arrived(counts)) => match first_apart(&latch.counts, &counts) {
                None => Ok((step, InterruptionAction::GoOn)),
                Some(axis) => Err(InterruptionError::NotThere { axis }),
            },
            (_, InterruptionEvent::Arrived(_)) => Err(InterruptionError::NotApproaching),
            (Step::Approaching, _) => Err(InterruptionError::Approaching),
            (_, InterruptionEvent::StopSpindle | InterruptionEvent::StartSpindle(_)) => {
                Self::spindle(latch, step, word)
            }
            (Step::OnlineAgain, InterruptionEvent::Jog | InterruptionEvent::Online) => {
                Err(InterruptionError::AlreadyOnline)
            }
            (_, InterruptionEvent::Jog) => Ok((step, InterruptionAction::Jog)),
            (Step::Paused, _) => Err(InterruptionError::SpindleTurns),
            (Step::SpindleStopped, _) => Err(InterruptionError::SpindleStands),
            (Step::SpindleAsItWas, InterruptionEvent::Online) => Ok((Step::OnlineAgain, InterruptionAction::Online)),
            (Step::SpindleAsItWas, InterruptionEvent::CycleStart { .. }) => Err(InterruptionError::NotOnline),
            (Step::OnlineAgain, InterruptionEvent::CycleStart { program }) if program != latch.program => {
                Err(InterruptionError::OtherProgram)
            }
            (Step::OnlineAgain, InterruptionEvent::CycleStart { .. }) => {
                Ok((Step::Approaching, InterruptionAction::Approach(latch.counts)))
            }
        }
    }

    /// The step that a word for the spindle leads to, while the axes are not on their way.
    const fn spindle(
        latch: &Breakpoint<A>,
        step: Step,
        word: InterruptionEvent<A>,
    ) -> Result<(Step, InterruptionAction<A>), InterruptionError> {
        match (latch.spindle, step, word) {
            (None, _, InterruptionEvent::StartSpindle(_)) => Err(InterruptionError::SpindleStood),
            (None, ..) | (_, Step::SpindleStopped, InterruptionEvent::StopSpindle) => {
                Err(InterruptionError::SpindleStands)
            }
            (_, _, InterruptionEvent::StopSpindle) => Ok((Step::SpindleStopped, InterruptionAction::StopSpindle)),
            (Some(turning), Step::SpindleStopped, InterruptionEvent::StartSpindle(direction)) => {
                if direction as u8 == turning.direction as u8 {
                    Ok((Step::SpindleAsItWas, InterruptionAction::StartSpindle(turning)))
                } else {
                    Err(InterruptionError::SpindleDirection)
                }
            }
            _ => Err(InterruptionError::SpindleTurns),
        }
    }
}

/// The first axis whose counts differ.
const fn first_apart<const A: usize>(wanted: &[i64; A], counts: &[i64; A]) -> Option<usize> {
    let mut axis = 0;
    while axis < A {
        if wanted[axis] != counts[axis] {
            return Some(axis);
        }
        axis += 1;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::{BTreeSet, HashSet, VecDeque};

    const TURNING: SpindleState = SpindleState { direction: SpindleDirection::Clockwise, speed: 12_000_000 };
    const LATCH: Breakpoint<2> = Breakpoint { program: 7, counts: [5, -3], spindle: Some(TURNING) };

    fn after(words: &[InterruptionEvent<2>]) -> Interruption<2> {
        let mut interruption = Interruption::reading();
        for word in words {
            interruption.apply(*word).expect("a word in its order");
        }
        interruption
    }

    #[test]
    fn the_order_of_the_requirements_leads_back_to_reading() {
        let mut interruption = Interruption::reading();
        let steps: [(InterruptionEvent<2>, InterruptionAction<2>, [bool; 4]); 7] = [
            (InterruptionEvent::Pause(LATCH), InterruptionAction::Halt, [true, true, false, true]),
            (InterruptionEvent::Jog, InterruptionAction::Jog, [true, true, false, true]),
            (InterruptionEvent::StopSpindle, InterruptionAction::StopSpindle, [true, true, false, true]),
            (
                InterruptionEvent::StartSpindle(SpindleDirection::Clockwise),
                InterruptionAction::StartSpindle(TURNING),
                [true, true, false, true],
            ),
            (InterruptionEvent::Online, InterruptionAction::Online, [true, false, false, false]),
            (
                InterruptionEvent::CycleStart { program: 7 },
                InterruptionAction::Approach([5, -3]),
                [true, false, true, false],
            ),
            (InterruptionEvent::Arrived([5, -3]), InterruptionAction::GoOn, [false, false, false, false]),
        ];
        for (word, effect, flags) in steps {
            assert_eq!(interruption.apply(word), Ok(effect));
            let i = &interruption;
            assert_eq!([i.paused(), i.mode_changed(), i.inhibited(), i.may_jog()], flags, "{word:?}");
            assert_eq!((i.may_read(), i.latch()), (!flags[0], flags[0].then_some(&LATCH)));
        }
        assert_eq!(interruption, Interruption::default());
    }

    #[test]
    fn the_breakpoint_is_moved_while_the_spindle_stands_and_never_else() {
        let start = InterruptionEvent::StartSpindle(SpindleDirection::Clockwise);
        let refused = |words: &[InterruptionEvent<2>]| {
            let mut interruption = after(words);
            let refused = interruption.displace([1, 2]).expect_err("not now");
            assert_eq!(interruption, after(words), "a refusal changes nothing");
            refused
        };
        assert_eq!(refused(&[]), InterruptionError::NotPaused);
        assert_eq!(refused(&[InterruptionEvent::Pause(LATCH)]), InterruptionError::SpindleTurns);
        assert_eq!(
            refused(&[InterruptionEvent::Pause(LATCH), InterruptionEvent::StopSpindle, start]),
            InterruptionError::SpindleTurns
        );
        let online = [
            InterruptionEvent::Pause(LATCH),
            InterruptionEvent::StopSpindle,
            start,
            InterruptionEvent::Online,
            InterruptionEvent::CycleStart { program: 7 },
        ];
        assert_eq!(refused(&online[..4]), InterruptionError::AlreadyOnline);
        assert_eq!(refused(&online), InterruptionError::Approaching);
        let mut interruption = after(&online[..2]);
        assert_eq!(interruption.displace([10, i64::MIN]), Ok(()));
        assert_eq!(interruption.latch(), Some(&Breakpoint { counts: [15, i64::MIN], ..LATCH }));
        for word in &online[2..] {
            interruption.apply(*word).expect("the order goes on");
        }
        assert_eq!(
            interruption.apply(InterruptionEvent::Arrived([5, -3])),
            Err(InterruptionError::NotThere { axis: 0 })
        );
        assert_eq!(interruption.apply(InterruptionEvent::Arrived([15, i64::MIN])), Ok(InterruptionAction::GoOn));
        let mut stood = after(&[InterruptionEvent::Pause(Breakpoint { spindle: None, ..LATCH })]);
        assert_eq!(stood.displace([0, 1]), Ok(()));
    }

    #[test]
    fn a_wrong_order_is_refused_with_the_first_thing_that_is_missing() {
        let start = InterruptionEvent::StartSpindle(SpindleDirection::Clockwise);
        let cycle = InterruptionEvent::CycleStart { program: 7 };
        let order =
            [InterruptionEvent::Pause(LATCH), InterruptionEvent::StopSpindle, start, InterruptionEvent::Online, cycle];
        let refused = |steps: usize, word| after(&order[..steps]).apply(word).err();
        assert_eq!(refused(0, InterruptionEvent::Online), Some(InterruptionError::NotPaused));
        assert_eq!(refused(1, InterruptionEvent::Pause(LATCH)), Some(InterruptionError::AlreadyPaused));
        assert_eq!(refused(1, InterruptionEvent::Online), Some(InterruptionError::SpindleTurns));
        assert_eq!(refused(1, start), Some(InterruptionError::SpindleTurns));
        assert_eq!(refused(2, cycle), Some(InterruptionError::SpindleStands));
        assert_eq!(refused(2, InterruptionEvent::StopSpindle), Some(InterruptionError::SpindleStands));
        assert_eq!(
            refused(2, InterruptionEvent::StartSpindle(SpindleDirection::Counterclockwise)),
            Some(InterruptionError::SpindleDirection)
        );
        assert_eq!(refused(3, cycle), Some(InterruptionError::NotOnline));
        assert_eq!(refused(4, InterruptionEvent::Jog), Some(InterruptionError::AlreadyOnline));
        assert_eq!(refused(4, InterruptionEvent::CycleStart { program: 8 }), Some(InterruptionError::OtherProgram));
        assert_eq!(refused(4, InterruptionEvent::Arrived(LATCH.counts)), Some(InterruptionError::NotApproaching));
        assert_eq!(refused(5, InterruptionEvent::StopSpindle), Some(InterruptionError::Approaching));
        assert_eq!(refused(5, InterruptionEvent::Arrived([5, -4])), Some(InterruptionError::NotThere { axis: 1 }));
    }

    #[test]
    fn a_spindle_that_stood_is_neither_started_nor_stopped() {
        let mut interruption = after(&[InterruptionEvent::Pause(Breakpoint { spindle: None, ..LATCH })]);
        assert_eq!(
            interruption.apply(InterruptionEvent::StartSpindle(SpindleDirection::Clockwise)),
            Err(InterruptionError::SpindleStood)
        );
        assert_eq!(interruption.apply(InterruptionEvent::StopSpindle), Err(InterruptionError::SpindleStands));
        assert_eq!(interruption.apply(InterruptionEvent::Online), Ok(InterruptionAction::Online));
    }

    #[test]
    fn a_pause_on_the_way_back_keeps_the_breakpoint() {
        let start = InterruptionEvent::StartSpindle(SpindleDirection::Clockwise);
        let (online, cycle) = (InterruptionEvent::Online, InterruptionEvent::CycleStart { program: 7 });
        let mut interruption =
            after(&[InterruptionEvent::Pause(LATCH), InterruptionEvent::StopSpindle, start, online, cycle]);
        let elsewhere = Breakpoint { program: 9, counts: [0, 0], spindle: None };
        assert_eq!(interruption.apply(InterruptionEvent::Pause(elsewhere)), Ok(InterruptionAction::Halt));
        assert_eq!(interruption, after(&[InterruptionEvent::Pause(LATCH)]));
    }

    /// What has been said in the order since the last pause.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    struct Said(usize);

    impl Said {
        /// With a word that was taken. The order stands here once more, as numbers: a word is the next one, undoes a step, or is no
        /// part of the order.
        fn with(self, word: InterruptionEvent<2>, stood: bool) -> Self {
            let number = match word {
                InterruptionEvent::Pause(_) => return Self(if stood { 2 } else { 0 }),
                InterruptionEvent::Jog => return self,
                InterruptionEvent::StopSpindle => return Self(1),
                InterruptionEvent::StartSpindle(_) => 2,
                InterruptionEvent::Online => 3,
                InterruptionEvent::CycleStart { .. } => 4,
                InterruptionEvent::Arrived(_) => 5,
            };
            assert_eq!(self.0 + 1, number, "{word:?} out of order");
            Self(number)
        }
    }

    /// Every word over two values of everything.
    fn words() -> Vec<InterruptionEvent<2>> {
        let directions = [SpindleDirection::Clockwise, SpindleDirection::Counterclockwise];
        let spindles = directions.iter().flat_map(|direction| {
            [
                Some(SpindleState { direction: *direction, speed: 1 }),
                Some(SpindleState { direction: *direction, speed: 2 }),
            ]
        });
        let spindles: Vec<_> = spindles.chain([None]).collect();
        let counts = [[0, 0], [0, 1], [1, 0], [1 << 32, 0]];
        let mut words = vec![InterruptionEvent::StopSpindle, InterruptionEvent::Jog, InterruptionEvent::Online];
        words.extend(directions.map(InterruptionEvent::StartSpindle));
        words.extend(counts.map(InterruptionEvent::Arrived));
        for program in [1, u64::MAX] {
            words.push(InterruptionEvent::CycleStart { program });
            for counts in counts {
                words.extend(
                    spindles
                        .iter()
                        .map(|spindle| InterruptionEvent::Pause(Breakpoint { program, counts, spindle: *spindle })),
                );
            }
        }
        words
    }

    fn check(before: &Interruption<2>, word: InterruptionEvent<2>) -> Option<Interruption<2>> {
        let mut interruption = *before;
        let Ok(effect) = interruption.apply(word) else {
            assert_eq!(interruption, *before, "{word:?} was refused");
            return None;
        };
        let flags = [interruption.paused(), interruption.mode_changed(), interruption.inhibited()];
        assert_eq!(interruption.may_read(), flags == [false; 3]);
        assert!(!interruption.may_jog() || interruption.mode_changed());
        assert!(word != InterruptionEvent::Jog || before.may_jog());
        match (word, before.latch()) {
            (InterruptionEvent::Pause(latch), None) => assert_eq!(interruption.latch(), Some(&latch)),
            (InterruptionEvent::Arrived(counts), Some(latch)) => {
                assert!(effect == InterruptionAction::GoOn && counts == latch.counts)
            }
            (_, latch) => assert_eq!(interruption.latch(), latch),
        }
        assert_eq!(interruption.may_read(), effect == InterruptionAction::GoOn);
        Some(interruption)
    }

    #[test]
    fn no_reachable_state_and_no_word_breaks_the_order() {
        let words = words();
        let begin = (Interruption::<2>::reading(), Said(5));
        let (mut seen, mut open) = (HashSet::from([begin]), VecDeque::from([begin]));
        let (mut taken, mut longest) = (0, BTreeSet::new());
        while let Some((before, said)) = open.pop_front() {
            for word in &words {
                let Some(after) = check(&before, *word) else { continue };
                let latch = after.latch().or(before.latch()).expect("before or after a breakpoint");
                let state = (after, said.with(*word, latch.spindle.is_none()));
                assert_eq!(after.may_read(), state.1 == Said(5));
                taken += 1;
                longest.insert(state.1.0);
                if seen.insert(state) {
                    open.push_back(state);
                }
            }
        }
        // 32 latches that turn have five states each, 8 that stand have three; and reading
        assert_eq!((seen.len(), longest.len()), (32 * 5 + 8 * 3 + 1, 6));
        assert!(taken > seen.len());
    }
}
