//! The operator's words on their way from the screen to the motion path.
//!
//! Invariant: neither side waits for the other; a word that finds no room is refused at once, and the wheel loses no count.

use std::sync::Arc;
use std::sync::atomic::{AtomicI32, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use crate::operator::OperatorCommand;
use crate::script::ScriptPlayer;

/// So many words may wait.
const WORDS: usize = 64;

/// The two ends.
#[must_use]
pub fn command_channel() -> (CommandSender, CommandReceiver) {
    let (sender, receiver) = sync_channel(WORDS);
    let wheel = Arc::new(AtomicI32::new(0));
    (CommandSender { words: sender, wheel: Arc::clone(&wheel) }, CommandReceiver { words: receiver, wheel })
}

/// Too many words wait already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommandQueueFull;

/// The screen's end; it can be had more than once.
#[derive(Clone, Debug)]
pub struct CommandSender {
    words: SyncSender<OperatorCommand>,
    wheel: Arc<AtomicI32>,
}

impl CommandSender {
    /// Says a word.
    ///
    /// # Errors
    /// [`Busy`]; the word is not on its way then.
    pub fn send(&self, deed: OperatorCommand) -> Result<(), CommandQueueFull> {
        // A session that has ended hears nothing, and needs nothing.
        match self.words.try_send(deed) {
            Err(std::sync::mpsc::TrySendError::Full(_)) => Err(CommandQueueFull),
            _ => Ok(()),
        }
    }

    /// Turns the handwheel by so many counts.
    pub fn turn_wheel(&self, counts: i32) {
        self.wheel.fetch_add(counts, Ordering::Relaxed);
    }
}

/// The motion path's end.
#[derive(Debug)]
pub struct CommandReceiver {
    words: Receiver<OperatorCommand>,
    wheel: Arc<AtomicI32>,
}

impl CommandReceiver {
    /// The next word, if one waits.
    pub fn next_command(&mut self) -> Option<OperatorCommand> {
        self.words.try_recv().ok()
    }

    /// What the wheel was turned by since it was asked last; what does not fit comes the next time.
    pub fn wheel_counts(&mut self) -> i16 {
        let turned = self.wheel.load(Ordering::Relaxed);
        let counts = turned.clamp(i32::from(i16::MIN), i32::from(i16::MAX));
        self.wheel.fetch_sub(counts, Ordering::Relaxed);
        counts as i16
    }
}

/// Who operates the machine: a script, somebody at a screen, or both, or nobody.
#[derive(Debug)]
pub struct CommandSources {
    script: ScriptPlayer,
    heard: Option<CommandReceiver>,
    /// What can stop the job, and is nobody who operates it: the system's signals.
    stops: Option<CommandReceiver>,
    /// A word of that which has come and was not taken yet.
    next_stop: Option<OperatorCommand>,
    /// The job is over only when the operator says so.
    releases: bool,
}

impl CommandSources {
    /// A script; an empty one is nobody.
    #[must_use]
    pub fn script(script: ScriptPlayer) -> Self {
        Self { script, heard: None, stops: None, next_stop: None, releases: false }
    }

    /// The same, and somebody at a screen, who stays to the end.
    #[must_use]
    pub fn and(self, heard: CommandReceiver) -> Self {
        Self { heard: Some(heard), ..self }
    }

    /// The same, and something that can stop the job without being an operator: whether anybody is there does not depend on it.
    #[must_use]
    pub fn stopped_by(self, stops: Option<CommandReceiver>) -> Self {
        Self { stops, ..self }
    }

    /// The same; a program that has come to its end stays open for reverse run until the operator releases it with [`Deed::Stop`].
    #[must_use]
    pub fn releasing_the_end(self) -> Self {
        Self { releases: true, ..self }
    }

    /// Does a program that has come to its end wait for the operator to release it?
    #[must_use]
    pub fn releases_the_end(&self) -> bool {
        self.releases
    }

    /// Is nobody there who has something left to say?
    #[must_use]
    pub fn finished(&self) -> bool {
        self.heard.is_none() && self.script.finished()
    }

    /// Is nobody there who would say something while the machine stands?
    #[must_use]
    pub fn waits_for_motion(&self) -> bool {
        self.heard.is_none() && self.script.waits_for_motion()
    }

    /// The next word, if there is one now: in period `period`, with program line `line` being executed. The script's come first.
    pub fn next_word(&mut self, period: u64, line: u32) -> Option<OperatorCommand> {
        let scripted = self.script.due(period, line).map(|instruction| instruction.command);
        scripted.or_else(|| self.next_live_command())
    }

    /// The next word of somebody who is there; a script says none here.
    pub fn next_live_command(&mut self) -> Option<OperatorCommand> {
        let said = self.heard.as_mut().and_then(CommandReceiver::next_command);
        said.or_else(|| if self.stop_requested() { self.next_stop.take() } else { None })
    }

    /// Does a word wait that stops the job, without being an operator's? For whoever waits outside of the turns of the motion path.
    pub fn stop_requested(&mut self) -> bool {
        if self.next_stop.is_none() {
            self.next_stop = self.stops.as_mut().and_then(CommandReceiver::next_command);
        }
        self.next_stop.is_some()
    }

    /// Counts that the handwheels turn by in this period.
    pub fn wheel_counts(&mut self, period: u64) -> i16 {
        let turned = self.heard.as_mut().map_or(0, CommandReceiver::wheel_counts);
        self.script.wheel_counts(period).saturating_add(turned)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_script_and_somebody_at_a_screen_are_both_heard() {
        let script = crate::operator::parse("at 0.002s hold\nafter 0s wheel 1000 for 1s", "script").expect("valid");
        let (orders, heard) = command_channel();
        let mut operators = CommandSources::script(ScriptPlayer::new(script, 1000)).and(heard);
        orders.send(OperatorCommand::Single).expect("room");
        orders.turn_wheel(5);
        assert_eq!((operators.next_word(1, 0), operators.next_word(1, 0)), (Some(OperatorCommand::Single), None));
        orders.send(OperatorCommand::Stop).expect("room");
        let words = [operators.next_word(2, 0), operators.next_word(2, 0), operators.next_word(2, 0)];
        assert!(
            matches!(
                words,
                [Some(OperatorCommand::Hold), Some(OperatorCommand::Wheel { .. }), Some(OperatorCommand::Stop)]
            ),
            "{words:?}"
        );
        assert_eq!((operators.wheel_counts(2), operators.wheel_counts(3), operators.finished()), (6, 1, false));
    }

    #[test]
    fn words_come_in_order_too_many_are_refused_and_no_count_is_lost() {
        let (orders, mut heard) = command_channel();
        let taken = (0..).take_while(|&n| orders.send(OperatorCommand::BackBy(f64::from(n))).is_ok()).count();
        assert_eq!(taken, WORDS);
        assert_eq!(
            (heard.next_command(), heard.next_command()),
            (Some(OperatorCommand::BackBy(0.0)), Some(OperatorCommand::BackBy(1.0)))
        );
        orders.turn_wheel(40_000);
        orders.turn_wheel(-3);
        assert_eq!([heard.wheel_counts(), heard.wheel_counts(), heard.wheel_counts()], [32_767, 7_230, 0]);
    }
}
