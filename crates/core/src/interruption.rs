//! State machine of an interrupted on-line program: the order of the operations between a pause and its continuation
//! (DNC-1 … DNC-8).
//!
//! A program that is executed while it arrives is paused. The operator frees the tool, stops the spindle, does what is
//! needed, and undoes it step by step. Only then do the axes return to the breakpoint, and only there is reading of the
//! program resumed. The caller applies each [`InterruptionEvent`] here first and performs the [`InterruptionAction`]
//! that is returned.
//!
//! | step | pause | stop spindle | start spindle | jog | on line | cycle start | arrived |
//! |---|---|---|---|---|---|---|---|
//! | reading | → paused, latch | – | – | – | – | – | – |
//! | paused: the spindle still runs | – | → spindle stopped | – | yes | – | – | – |
//! | spindle stopped | – | – | → spindle restored | yes | – | – | – |
//! | spindle restored | – | → spindle stopped | – | yes | → on line | – | – |
//! | on line again | → paused | → spindle stopped | – | – | – | → approaching | – |
//! | approaching | → paused | – | – | – | – | – | → reading |
//!
//! A dash is a rejection. If the spindle was stopped at the breakpoint, *pause* leads to *spindle restored* at once,
//! and both spindle events are rejected until the program is resumed. The direction, the program and the place of
//! arrival must equal the latched ones. An event that undoes a step returns to that step, and the later steps must be
//! repeated. A pause during the approach to the breakpoint stops the axes and retains the breakpoint. The spindle
//! cannot be stopped while axes move: pause first.
//!
//! Invariant: the program is read only while none of the three flags is set. From a pause to reading there is exactly
//! one order of events: spindle stopped, spindle started (both only if it was running), on line, cycle start, arrived.
//! A rejected event changes nothing.

/// Direction of spindle rotation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SpindleDirection {
    /// Clockwise, M3.
    Clockwise,
    /// Counterclockwise, M4.
    Counterclockwise,
}

/// State of a running spindle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SpindleState {
    /// Direction of rotation.
    pub direction: SpindleDirection,
    /// Speed, in thousandths of a revolution per minute.
    pub speed: u32,
}

/// The latched state at the breakpoint (DNC-2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Breakpoint<const A: usize> {
    /// Identifier of the interrupted program; equal only for equal content.
    pub program: u64,
    /// Machine counts of each axis, in pulses.
    pub counts: [i64; A],
    /// State of the spindle; `None` if it was stopped.
    pub spindle: Option<SpindleState>,
}

/// Event from the operator or the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum InterruptionEvent<const A: usize> {
    /// *Pause*, with the state to latch. During the approach to a breakpoint that breakpoint is retained, and this
    /// state is ignored (DNC-1).
    Pause(Breakpoint<A>),
    /// The spindle is to be stopped (DNC-3).
    StopSpindle,
    /// The operator requests that the spindle be started (DNC-4).
    StartSpindle(SpindleDirection),
    /// The operator requests a jog of an axis (DNC-3).
    Jog,
    /// The operator requests on-line mode (DNC-5).
    Online,
    /// *Cycle start*, with the program that would be read (DNC-6).
    CycleStart {
        /// Identifier of the program, as in [`Breakpoint::program`].
        program: u64,
    },
    /// The axes have come to rest at these machine counts, in pulses (DNC-7).
    Arrived([i64; A]),
}

/// Action that an accepted event requires.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum InterruptionAction<const A: usize> {
    /// Stop the axes; on-line mode ends.
    Halt,
    /// Stop the spindle; on-line mode ends.
    StopSpindle,
    /// Start the spindle with the latched direction and speed.
    StartSpindle(SpindleState),
    /// Jog the axis.
    Jog,
    /// Enter on-line mode; nothing is read yet.
    Online,
    /// Move every axis to these machine counts, in pulses.
    Approach([i64; A]),
    /// Resume reading the program at the breakpoint (DNC-8).
    ResumeReading,
}

/// Reason why an event is rejected: the first condition of the order that is not met.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum InterruptionError {
    /// The program is not interrupted.
    NotPaused,
    /// The program is already interrupted.
    AlreadyPaused,
    /// The spindle is running; it must be stopped first.
    SpindleRunning,
    /// The spindle is stopped: it must be started first, or cannot be stopped.
    SpindleNotRunning,
    /// The spindle was stopped at the breakpoint; the program is resumed with the spindle stopped.
    SpindleWasStopped,
    /// The spindle was running in the other direction.
    WrongSpindleDirection,
    /// On-line mode is not restored.
    NotOnline,
    /// On-line mode is restored; no axis can be jogged in it.
    AlreadyOnline,
    /// The program differs from the interrupted one.
    OtherProgram,
    /// The axes are not approaching the breakpoint: *cycle start* is required first.
    NotApproaching,
    /// The axes are approaching the breakpoint; only *pause* stops them.
    Approaching,
    /// The axes are not at the breakpoint; `axis` is the first one that differs.
    NotAtBreakpoint {
        /// Index of the axis, from 0.
        axis: usize,
    },
}

impl core::fmt::Display for InterruptionError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::NotPaused => "the program is not paused; pause it first",
            Self::AlreadyPaused => "the program is already paused",
            Self::SpindleRunning => "the spindle is running; stop it first",
            Self::SpindleNotRunning => "the spindle is stopped; start it first",
            Self::SpindleWasStopped => "the spindle was stopped when the program was paused",
            Self::WrongSpindleDirection => "the spindle was running in the other direction",
            Self::NotOnline => "on-line mode is not restored; restore it first",
            Self::AlreadyOnline => "on-line mode is restored; no axis can be jogged in it",
            Self::OtherProgram => "the program differs from the interrupted one",
            Self::NotApproaching => "the axes are not approaching the breakpoint; cycle start comes first",
            Self::Approaching => "the axes are approaching the breakpoint; pause stops them",
            Self::NotAtBreakpoint { axis } => return write!(f, "axis number {axis} is not at the breakpoint"),
        })
    }
}

impl core::error::Error for InterruptionError {}

/// Step that the interruption has reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Step {
    /// The spindle is still running.
    Paused,
    /// The spindle has been stopped.
    SpindleStopped,
    /// The spindle runs, or is stopped, as it was at the breakpoint.
    SpindleRestored,
    /// On-line mode is restored.
    OnlineRestored,
    /// The axes are approaching the breakpoint.
    Approaching,
}

/// Interruption state of an on-line program: being read, or interrupted at a breakpoint.
///
/// # Examples
///
/// ```
/// use retrace_core::interruption::{Interruption, InterruptionError, InterruptionEvent};
///
/// let mut program = Interruption::<3>::reading();
/// assert!(program.may_read());
/// assert_eq!(program.apply(InterruptionEvent::Online), Err(InterruptionError::NotPaused));
/// ```
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
    /// Returns the state of a program that is being read.
    #[must_use]
    pub const fn reading() -> Self {
        Self { breakpoint: None }
    }

    /// Whether the program may be read and motion may begin from it.
    #[must_use]
    pub const fn may_read(&self) -> bool {
        self.breakpoint.is_none()
    }

    /// Whether an axis may be jogged.
    #[must_use]
    pub const fn may_jog(&self) -> bool {
        self.mode_changed()
    }

    /// Whether the *DNC-paused flag* is set: from *pause* until the axes are back (DNC-1, DNC-7).
    #[must_use]
    pub const fn is_paused(&self) -> bool {
        self.breakpoint.is_some()
    }

    /// Whether the *mode-changed flag* is set: from *pause* until on-line mode is restored (DNC-2, DNC-5).
    #[must_use]
    pub const fn mode_changed(&self) -> bool {
        matches!(self.breakpoint, Some((_, Step::Paused | Step::SpindleStopped | Step::SpindleRestored)))
    }

    /// Whether reading the program is *inhibited*: from *cycle start* until the axes are back (DNC-6, DNC-7).
    #[must_use]
    pub const fn is_inhibited(&self) -> bool {
        matches!(self.breakpoint, Some((_, Step::Approaching)))
    }

    /// Returns the latched breakpoint, if the program is interrupted.
    #[must_use]
    pub const fn breakpoint(&self) -> Option<&Breakpoint<A>> {
        match &self.breakpoint {
            Some((latch, _)) => Some(latch),
            None => None,
        }
    }

    /// Applies an event and returns the action it requires.
    ///
    /// # Errors
    /// Returns the first condition that is not met; the state is unchanged then.
    pub const fn apply(&mut self, event: InterruptionEvent<A>) -> Result<InterruptionAction<A>, InterruptionError> {
        let (latch, next) = match (&self.breakpoint, event) {
            (None, InterruptionEvent::Pause(latch)) => {
                (latch, Ok((Self::step_after_pause(&latch), InterruptionAction::Halt)))
            }
            (None, _) => return Err(InterruptionError::NotPaused),
            (Some((latch, step)), event) => (*latch, Self::transition(latch, *step, event)),
        };
        match next {
            Ok((step, action)) => {
                self.breakpoint =
                    if matches!(action, InterruptionAction::ResumeReading) { None } else { Some((latch, step)) };
                Ok(action)
            }
            Err(reason) => Err(reason),
        }
    }

    /// Moves the breakpoint by `pulses` per axis, for a tool of another length. The spindle must be stopped and the
    /// axes free to be jogged.
    ///
    /// # Errors
    /// Returns the condition that is not met; the state is unchanged then.
    pub const fn displace_breakpoint(&mut self, pulses: [i64; A]) -> Result<(), InterruptionError> {
        let Some((latch, step)) = &mut self.breakpoint else { return Err(InterruptionError::NotPaused) };
        match step {
            Step::SpindleStopped => {}
            Step::SpindleRestored if latch.spindle.is_none() => {}
            Step::Paused | Step::SpindleRestored => return Err(InterruptionError::SpindleRunning),
            Step::OnlineRestored => return Err(InterruptionError::AlreadyOnline),
            Step::Approaching => return Err(InterruptionError::Approaching),
        }
        let mut moved = 0;
        while moved < A {
            latch.counts[moved] = latch.counts[moved].saturating_add(pulses[moved]);
            moved += 1;
        }
        Ok(())
    }

    /// Returns the step that a pause leads to.
    const fn step_after_pause(latch: &Breakpoint<A>) -> Step {
        if latch.spindle.is_some() { Step::Paused } else { Step::SpindleRestored }
    }

    /// Returns the next step and the action for an event at a breakpoint.
    const fn transition(
        latch: &Breakpoint<A>,
        step: Step,
        event: InterruptionEvent<A>,
    ) -> Result<(Step, InterruptionAction<A>), InterruptionError> {
        match (step, event) {
            (Step::OnlineRestored | Step::Approaching, InterruptionEvent::Pause(_)) => {
                Ok((Self::step_after_pause(latch), InterruptionAction::Halt))
            }
            (_, InterruptionEvent::Pause(_)) => Err(InterruptionError::AlreadyPaused),
            (Step::Approaching, InterruptionEvent::Arrived(counts)) => {
                match first_differing_axis(&latch.counts, &counts) {
                    None => Ok((step, InterruptionAction::ResumeReading)),
                    Some(axis) => Err(InterruptionError::NotAtBreakpoint { axis }),
                }
            }
            (_, InterruptionEvent::Arrived(_)) => Err(InterruptionError::NotApproaching),
            (Step::Approaching, _) => Err(InterruptionError::Approaching),
            (_, InterruptionEvent::StopSpindle | InterruptionEvent::StartSpindle(_)) => {
                Self::spindle_transition(latch, step, event)
            }
            (Step::OnlineRestored, InterruptionEvent::Jog | InterruptionEvent::Online) => {
                Err(InterruptionError::AlreadyOnline)
            }
            (_, InterruptionEvent::Jog) => Ok((step, InterruptionAction::Jog)),
            (Step::Paused, _) => Err(InterruptionError::SpindleRunning),
            (Step::SpindleStopped, _) => Err(InterruptionError::SpindleNotRunning),
            (Step::SpindleRestored, InterruptionEvent::Online) => {
                Ok((Step::OnlineRestored, InterruptionAction::Online))
            }
            (Step::SpindleRestored, InterruptionEvent::CycleStart { .. }) => Err(InterruptionError::NotOnline),
            (Step::OnlineRestored, InterruptionEvent::CycleStart { program }) if program != latch.program => {
                Err(InterruptionError::OtherProgram)
            }
            (Step::OnlineRestored, InterruptionEvent::CycleStart { .. }) => {
                Ok((Step::Approaching, InterruptionAction::Approach(latch.counts)))
            }
        }
    }

    /// Returns the next step and the action for a spindle event, outside the approach.
    const fn spindle_transition(
        latch: &Breakpoint<A>,
        step: Step,
        event: InterruptionEvent<A>,
    ) -> Result<(Step, InterruptionAction<A>), InterruptionError> {
        match (latch.spindle, step, event) {
            (None, _, InterruptionEvent::StartSpindle(_)) => Err(InterruptionError::SpindleWasStopped),
            (None, ..) | (_, Step::SpindleStopped, InterruptionEvent::StopSpindle) => {
                Err(InterruptionError::SpindleNotRunning)
            }
            (_, _, InterruptionEvent::StopSpindle) => Ok((Step::SpindleStopped, InterruptionAction::StopSpindle)),
            (Some(turning), Step::SpindleStopped, InterruptionEvent::StartSpindle(direction)) => {
                if direction as u8 == turning.direction as u8 {
                    Ok((Step::SpindleRestored, InterruptionAction::StartSpindle(turning)))
                } else {
                    Err(InterruptionError::WrongSpindleDirection)
                }
            }
            _ => Err(InterruptionError::SpindleRunning),
        }
    }
}

/// Returns the first axis whose counts differ.
const fn first_differing_axis<const A: usize>(wanted: &[i64; A], counts: &[i64; A]) -> Option<usize> {
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

    fn after(events: &[InterruptionEvent<2>]) -> Interruption<2> {
        let mut interruption = Interruption::reading();
        for event in events {
            interruption.apply(*event).expect("an event in its order");
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
            (InterruptionEvent::Arrived([5, -3]), InterruptionAction::ResumeReading, [false, false, false, false]),
        ];
        for (event, action, flags) in steps {
            assert_eq!(interruption.apply(event), Ok(action));
            let i = &interruption;
            assert_eq!([i.is_paused(), i.mode_changed(), i.is_inhibited(), i.may_jog()], flags, "{event:?}");
            assert_eq!((i.may_read(), i.breakpoint()), (!flags[0], flags[0].then_some(&LATCH)));
        }
        assert_eq!(interruption, Interruption::default());
    }

    #[test]
    fn the_breakpoint_is_moved_while_the_spindle_stands_and_never_else() {
        let start = InterruptionEvent::StartSpindle(SpindleDirection::Clockwise);
        let refused = |events: &[InterruptionEvent<2>]| {
            let mut interruption = after(events);
            let refused = interruption.displace_breakpoint([1, 2]).expect_err("not now");
            assert_eq!(interruption, after(events), "a refusal changes nothing");
            refused
        };
        assert_eq!(refused(&[]), InterruptionError::NotPaused);
        assert_eq!(refused(&[InterruptionEvent::Pause(LATCH)]), InterruptionError::SpindleRunning);
        assert_eq!(
            refused(&[InterruptionEvent::Pause(LATCH), InterruptionEvent::StopSpindle, start]),
            InterruptionError::SpindleRunning
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
        assert_eq!(interruption.displace_breakpoint([10, i64::MIN]), Ok(()));
        assert_eq!(interruption.breakpoint(), Some(&Breakpoint { counts: [15, i64::MIN], ..LATCH }));
        for event in &online[2..] {
            interruption.apply(*event).expect("the order continues");
        }
        assert_eq!(
            interruption.apply(InterruptionEvent::Arrived([5, -3])),
            Err(InterruptionError::NotAtBreakpoint { axis: 0 })
        );
        assert_eq!(
            interruption.apply(InterruptionEvent::Arrived([15, i64::MIN])),
            Ok(InterruptionAction::ResumeReading)
        );
        let mut stood = after(&[InterruptionEvent::Pause(Breakpoint { spindle: None, ..LATCH })]);
        assert_eq!(stood.displace_breakpoint([0, 1]), Ok(()));
    }

    #[test]
    fn a_wrong_order_is_refused_with_the_first_thing_that_is_missing() {
        let start = InterruptionEvent::StartSpindle(SpindleDirection::Clockwise);
        let cycle = InterruptionEvent::CycleStart { program: 7 };
        let order =
            [InterruptionEvent::Pause(LATCH), InterruptionEvent::StopSpindle, start, InterruptionEvent::Online, cycle];
        let refused = |steps: usize, event| after(&order[..steps]).apply(event).err();
        assert_eq!(refused(0, InterruptionEvent::Online), Some(InterruptionError::NotPaused));
        assert_eq!(refused(1, InterruptionEvent::Pause(LATCH)), Some(InterruptionError::AlreadyPaused));
        assert_eq!(refused(1, InterruptionEvent::Online), Some(InterruptionError::SpindleRunning));
        assert_eq!(refused(1, start), Some(InterruptionError::SpindleRunning));
        assert_eq!(refused(2, cycle), Some(InterruptionError::SpindleNotRunning));
        assert_eq!(refused(2, InterruptionEvent::StopSpindle), Some(InterruptionError::SpindleNotRunning));
        assert_eq!(
            refused(2, InterruptionEvent::StartSpindle(SpindleDirection::Counterclockwise)),
            Some(InterruptionError::WrongSpindleDirection)
        );
        assert_eq!(refused(3, cycle), Some(InterruptionError::NotOnline));
        assert_eq!(refused(4, InterruptionEvent::Jog), Some(InterruptionError::AlreadyOnline));
        assert_eq!(refused(4, InterruptionEvent::CycleStart { program: 8 }), Some(InterruptionError::OtherProgram));
        assert_eq!(refused(4, InterruptionEvent::Arrived(LATCH.counts)), Some(InterruptionError::NotApproaching));
        assert_eq!(refused(5, InterruptionEvent::StopSpindle), Some(InterruptionError::Approaching));
        assert_eq!(
            refused(5, InterruptionEvent::Arrived([5, -4])),
            Some(InterruptionError::NotAtBreakpoint { axis: 1 })
        );
    }

    #[test]
    fn a_spindle_that_was_stopped_is_neither_started_nor_stopped() {
        let mut interruption = after(&[InterruptionEvent::Pause(Breakpoint { spindle: None, ..LATCH })]);
        assert_eq!(
            interruption.apply(InterruptionEvent::StartSpindle(SpindleDirection::Clockwise)),
            Err(InterruptionError::SpindleWasStopped)
        );
        assert_eq!(interruption.apply(InterruptionEvent::StopSpindle), Err(InterruptionError::SpindleNotRunning));
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

    /// Number of the last event in the order since the last pause.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    struct Progress(usize);

    impl Progress {
        /// Returns the progress after an accepted event. The order is repeated here as numbers: an event is the next
        /// one, undoes a step, or is not part of the order.
        fn with(self, event: InterruptionEvent<2>, stood: bool) -> Self {
            let number = match event {
                InterruptionEvent::Pause(_) => return Self(if stood { 2 } else { 0 }),
                InterruptionEvent::Jog => return self,
                InterruptionEvent::StopSpindle => return Self(1),
                InterruptionEvent::StartSpindle(_) => 2,
                InterruptionEvent::Online => 3,
                InterruptionEvent::CycleStart { .. } => 4,
                InterruptionEvent::Arrived(_) => 5,
            };
            assert_eq!(self.0 + 1, number, "{event:?} out of order");
            Self(number)
        }
    }

    /// Returns every event over two values of each field.
    fn events() -> Vec<InterruptionEvent<2>> {
        let directions = [SpindleDirection::Clockwise, SpindleDirection::Counterclockwise];
        let spindles = directions.iter().flat_map(|direction| {
            [
                Some(SpindleState { direction: *direction, speed: 1 }),
                Some(SpindleState { direction: *direction, speed: 2 }),
            ]
        });
        let spindles: Vec<_> = spindles.chain([None]).collect();
        let counts = [[0, 0], [0, 1], [1, 0], [1 << 32, 0]];
        let mut events = vec![InterruptionEvent::StopSpindle, InterruptionEvent::Jog, InterruptionEvent::Online];
        events.extend(directions.map(InterruptionEvent::StartSpindle));
        events.extend(counts.map(InterruptionEvent::Arrived));
        for program in [1, u64::MAX] {
            events.push(InterruptionEvent::CycleStart { program });
            for counts in counts {
                events.extend(
                    spindles
                        .iter()
                        .map(|spindle| InterruptionEvent::Pause(Breakpoint { program, counts, spindle: *spindle })),
                );
            }
        }
        events
    }

    fn check(before: &Interruption<2>, event: InterruptionEvent<2>) -> Option<Interruption<2>> {
        let mut interruption = *before;
        let Ok(action) = interruption.apply(event) else {
            assert_eq!(interruption, *before, "{event:?} was refused");
            return None;
        };
        let flags = [interruption.is_paused(), interruption.mode_changed(), interruption.is_inhibited()];
        assert_eq!(interruption.may_read(), flags == [false; 3]);
        assert!(!interruption.may_jog() || interruption.mode_changed());
        assert!(event != InterruptionEvent::Jog || before.may_jog());
        match (event, before.breakpoint()) {
            (InterruptionEvent::Pause(latch), None) => assert_eq!(interruption.breakpoint(), Some(&latch)),
            (InterruptionEvent::Arrived(counts), Some(latch)) => {
                assert!(action == InterruptionAction::ResumeReading && counts == latch.counts)
            }
            (_, latch) => assert_eq!(interruption.breakpoint(), latch),
        }
        assert_eq!(interruption.may_read(), action == InterruptionAction::ResumeReading);
        Some(interruption)
    }

    #[test]
    fn no_reachable_state_and_no_event_breaks_the_order() {
        let events = events();
        let begin = (Interruption::<2>::reading(), Progress(5));
        let (mut seen, mut open) = (HashSet::from([begin]), VecDeque::from([begin]));
        let (mut taken, mut longest) = (0, BTreeSet::new());
        while let Some((before, progress)) = open.pop_front() {
            for event in &events {
                let Some(after) = check(&before, *event) else { continue };
                let latch = after.breakpoint().or(before.breakpoint()).expect("before or after a breakpoint");
                let state = (after, progress.with(*event, latch.spindle.is_none()));
                assert_eq!(after.may_read(), state.1 == Progress(5));
                taken += 1;
                longest.insert(state.1.0);
                if seen.insert(state) {
                    open.push_back(state);
                }
            }
        }
        // 32 breakpoints with a running spindle have five states each, 8 with a stopped one have three; and reading
        assert_eq!((seen.len(), longest.len()), (32 * 5 + 8 * 3 + 1, 6));
        assert!(taken > seen.len());
    }
}
