//! The sources of operator commands: a script, an operator at a screen, the system's signals.
//!
//! Invariant: no source is waited for; a script's commands come first.

use crate::command_channel::CommandReceiver;
use crate::operator::OperatorCommand;
use crate::script::ScriptPlayer;

/// The sources of commands: a script, an operator at a screen, both, or neither.
#[derive(Debug)]
pub struct CommandSources {
    script: ScriptPlayer,
    live: Option<CommandReceiver>,
    /// Source of stop commands that is not an operator: the system's signals.
    stop_receiver: Option<CommandReceiver>,
    /// Stop command that was received from it and is not applied yet.
    next_stop: Option<OperatorCommand>,
    /// Whether the job ends only when the operator releases it.
    waits_for_release: bool,
}

impl CommandSources {
    /// Commands from a script. An empty script means that there is no operator.
    #[must_use]
    pub fn from_script(script: ScriptPlayer) -> Self {
        Self { script, live: None, stop_receiver: None, next_stop: None, waits_for_release: false }
    }

    /// Adds an operator at a screen, who is present until the end.
    #[must_use]
    pub fn with_operator(self, receiver: CommandReceiver) -> Self {
        Self { live: Some(receiver), ..self }
    }

    /// Adds a source of stop commands that is not an operator: it does not count as an operator being present.
    #[must_use]
    pub fn with_stop_receiver(self, stops: Option<CommandReceiver>) -> Self {
        Self { stop_receiver: stops, ..self }
    }

    /// Keeps a completed program open for reverse run until the operator releases it with [`OperatorCommand::Stop`].
    #[must_use]
    pub fn with_release_at_end(self) -> Self {
        Self { waits_for_release: true, ..self }
    }

    /// Whether a completed program waits for the operator to release it.
    #[must_use]
    pub fn waits_for_release_at_end(&self) -> bool {
        self.waits_for_release
    }

    /// Whether no source has a command left to give: the script has ended and no operator is present.
    #[must_use]
    pub fn finished(&self) -> bool {
        self.live.is_none() && self.script.finished()
    }

    /// Whether no source will give a command while the machine is at rest.
    #[must_use]
    pub fn waits_for_motion(&self) -> bool {
        self.live.is_none() && self.script.waits_for_motion()
    }

    /// Next command that is due in period `period`, with program line `line` being executed. Script commands come
    /// first.
    pub fn next_command(&mut self, period: u64, line: u32) -> Option<OperatorCommand> {
        let scripted = self.script.due_instruction(period, line).map(|instruction| instruction.command);
        scripted.or_else(|| self.next_live_command())
    }

    /// Next command of a live operator or a stop source. Script commands are not returned here.
    pub fn next_live_command(&mut self) -> Option<OperatorCommand> {
        let result = self.live.as_mut().and_then(CommandReceiver::next_command);
        result.or_else(|| if self.stop_requested() { self.next_stop.take() } else { None })
    }

    /// Whether a stop command from a source other than an operator is pending. For callers that wait outside of the
    /// motion path's periods.
    pub fn stop_requested(&mut self) -> bool {
        if self.next_stop.is_none() {
            self.next_stop = self.stop_receiver.as_mut().and_then(CommandReceiver::next_command);
        }
        self.next_stop.is_some()
    }

    /// Handwheel counts of all sources in this period.
    pub fn wheel_counts(&mut self, period: u64) -> i16 {
        let turned = self.live.as_mut().map_or(0, CommandReceiver::wheel_counts);
        self.script.wheel_counts(period).saturating_add(turned)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command_channel::{MAX_COMMANDS, command_channel};

    #[test]
    fn a_script_and_somebody_at_a_screen_are_both_heard() {
        let script =
            crate::operator_words::parse_script("at 0.002s hold\nafter 0s wheel 1000 for 1s", "script").expect("valid");
        let (orders, receiver) = command_channel();
        let mut operators = CommandSources::from_script(ScriptPlayer::new(script, 1000)).with_operator(receiver);
        orders.send(OperatorCommand::Single).expect("room");
        orders.turn_wheel(5);
        assert_eq!((operators.next_command(1, 0), operators.next_command(1, 0)), (Some(OperatorCommand::Single), None));
        orders.send(OperatorCommand::Stop).expect("room");
        let words = [operators.next_command(2, 0), operators.next_command(2, 0), operators.next_command(2, 0)];
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
        let (orders, mut receiver) = command_channel();
        let taken = (0..).take_while(|&n| orders.send(OperatorCommand::BackBy(f64::from(n))).is_ok()).count();
        assert_eq!(taken, MAX_COMMANDS);
        assert_eq!(
            (receiver.next_command(), receiver.next_command()),
            (Some(OperatorCommand::BackBy(0.0)), Some(OperatorCommand::BackBy(1.0)))
        );
        orders.turn_wheel(40_000);
        orders.turn_wheel(-3);
        assert_eq!([receiver.wheel_counts(), receiver.wheel_counts(), receiver.wheel_counts()], [32_767, 7_230, 0]);
    }
}
