//! The jog that a key of the terminal holds: it goes on only while the key repeats itself.
//!
//! Invariant: at most one jog is held. Whatever ends the repeats ends it within [`HELD_JOG_TIMEOUT`] and a poll of the
//! supervision: the key released, the terminal lost, or a screen that is blocked and handles no keys.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use retrace_controller::{JogSpeed, ManualTask, OperatorCommand};
use retrace_tui::{HELD_JOG_TIMEOUT, UiCommand, lock_model};

use super::command_router::CommandRouter;

/// Axis letter, whether it moves in the positive direction, and how fast.
type Direction = (char, bool, JogSpeed);

/// The jog that a key of the terminal holds, and when the key was heard last.
#[derive(Debug, Default)]
pub(super) struct HeldJog {
    held: Mutex<Option<(Direction, Instant)>>,
}

impl HeldJog {
    /// The key is held down: its jog begins, or goes on. One that has ended meanwhile, at a soft limit or by a hold,
    /// does not begin again before the key was released.
    pub(super) fn keep(&self, direction: Direction, now: Instant, router: &CommandRouter) {
        let mut held = self.lock();
        match &mut *held {
            Some((before, heard)) if *before == direction => *heard = now,
            Some(_) => hold(&mut held, router),
            None => {
                let (axis, up, speed) = direction;
                // Refused while the step of the first press moves; the next repeat of the key asks again.
                let has_begun = router.route_command(UiCommand::Task(ManualTask::JogOn { axis, up, speed }));
                *held = has_begun.then_some((direction, now));
            }
        }
    }

    /// Ends the jog, if one is held.
    pub(super) fn end(&self, router: &CommandRouter) {
        hold(&mut self.lock(), router);
    }

    /// The operator's own hold ends the jog, if one is held.
    pub(super) fn forget(&self) {
        *self.lock() = None;
    }

    /// Ends the jog if its key was not heard for too long.
    pub(super) fn end_if_overdue(&self, now: Instant, router: &CommandRouter) {
        let mut held = self.lock();
        if held.is_some_and(|(_, heard)| now.saturating_duration_since(heard) >= HELD_JOG_TIMEOUT) {
            hold(&mut held, router);
        }
    }

    fn lock(&self) -> MutexGuard<'_, Option<(Direction, Instant)>> {
        // The value is valid after a panic of another thread.
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn hold(held: &mut Option<(Direction, Instant)>, router: &CommandRouter) {
    if held.take().is_some() {
        // First: the hold must find it so when it is reported.
        lock_model(&router.model).is_jog_released = true;
        router.send_to_job(OperatorCommand::Hold);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};
    use std::time::Duration;

    use super::*;
    use retrace_config::MachineConfig;
    use retrace_tui::{ProgramFacts, ScreenModel};

    #[test]
    fn a_jog_ends_when_its_key_is_not_heard_and_does_not_begin_again_while_it_is() {
        let machine = MachineConfig::built_in().expect("valid");
        let facts = Arc::new(ProgramFacts::of(&machine, "part.ngc", "M2\n"));
        let (router, commands) = CommandRouter::new(Arc::new(Mutex::new(ScreenModel::new(facts))));
        let (jog, now) = (HeldJog::default(), Instant::now());
        let at = |ms| now + Duration::from_millis(ms);
        let begun = || commands.try_iter().count();
        jog.keep(('x', true, JogSpeed::Full), at(0), &router);
        assert_eq!(begun(), 1);
        let mut receiver = router.begin_job(router.receive_start()).expect("not cancelled");
        for ms in [40, 80, 200] {
            jog.keep(('x', true, JogSpeed::Full), at(ms), &router);
            jog.end_if_overdue(at(ms + 159), &router);
        }
        assert_eq!((receiver.next_command(), begun()), (None, 0));
        jog.end_if_overdue(at(360), &router);
        jog.end_if_overdue(at(380), &router);
        assert_eq!((receiver.next_command(), receiver.next_command()), (Some(OperatorCommand::Hold), None));
        router.end_job();
        router.finish_start();
        // At the soft limit it ends by itself: the key that is still held begins nothing.
        jog.keep(('y', false, JogSpeed::Full), at(1000), &router);
        assert!(begun() == 1 && router.begin_job(router.receive_start()).is_some());
        router.end_job();
        router.finish_start();
        jog.keep(('y', false, JogSpeed::Full), at(1040), &router);
        assert_eq!(begun(), 0);
        // Another direction, or any other key, ends it.
        jog.keep(('x', false, JogSpeed::Full), at(1080), &router);
        jog.keep(('x', false, JogSpeed::Full), at(1120), &router);
        assert!(begun() == 1 && router.begin_job(router.receive_start()).is_some());
        jog.end(&router);
        assert!(jog.lock().is_none());
        // One that has not begun yet is cancelled.
        router.end_job();
        router.finish_start();
        jog.keep(('x', false, JogSpeed::Full), at(2000), &router);
        jog.end(&router);
        assert!(router.begin_job(router.receive_start()).is_none());
        // The operator's own hold is the only one, and is reported as such.
        router.finish_start();
        assert!(std::mem::take(&mut lock_model(&router.model).is_jog_released), "the key ended it");
        jog.keep(('x', false, JogSpeed::Full), at(3000), &router);
        let mut receiver = router.begin_job(router.receive_start()).expect("not cancelled");
        jog.forget();
        jog.end(&router);
        assert_eq!((receiver.next_command(), lock_model(&router.model).is_jog_released), (None, false));
    }
}
