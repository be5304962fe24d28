//! The channel of operator commands from the screen to the motion path.
//!
//! Invariant: neither side waits for the other; a command that does not fit is rejected immediately, and no handwheel
//! count is lost. `verification/loom` compiles this file again over the model checker's channel and atomics.

use crate::operator::OperatorCommand;
use crate::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use crate::sync::{Arc, AtomicI32, Ordering};

/// Capacity of the queue, in commands.
pub(crate) const MAX_COMMANDS: usize = 64;

/// Creates a connected sender and receiver.
#[must_use]
pub fn command_channel() -> (CommandSender, CommandReceiver) {
    command_channel_of(MAX_COMMANDS)
}

/// Creates a connected sender and receiver with space for that many commands.
pub(crate) fn command_channel_of(capacity: usize) -> (CommandSender, CommandReceiver) {
    let (sender, receiver) = sync_channel(capacity);
    let wheel = Arc::new(AtomicI32::new(0));
    (CommandSender { commands: sender, wheel: Arc::clone(&wheel) }, CommandReceiver { commands: receiver, wheel })
}

/// The command queue is full.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommandQueueFull;

impl std::fmt::Display for CommandQueueFull {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("too many commands are pending")
    }
}

impl std::error::Error for CommandQueueFull {}

/// The screen's end of the queue. It can be cloned.
#[derive(Clone, Debug)]
pub struct CommandSender {
    commands: SyncSender<OperatorCommand>,
    wheel: Arc<AtomicI32>,
}

impl CommandSender {
    /// Sends a command.
    ///
    /// # Errors
    /// [`CommandQueueFull`]; the command is not sent then.
    pub fn send(&self, command: OperatorCommand) -> Result<(), CommandQueueFull> {
        // A session that has ended needs no commands.
        match self.commands.try_send(command) {
            Err(TrySendError::Full(_)) => Err(CommandQueueFull),
            _ => Ok(()),
        }
    }

    /// Turns the handwheel by this number of counts.
    pub fn turn_wheel(&self, counts: i32) {
        self.wheel.fetch_add(counts, Ordering::Relaxed);
    }
}

/// The motion path's end of the queue.
#[derive(Debug)]
pub struct CommandReceiver {
    commands: Receiver<OperatorCommand>,
    wheel: Arc<AtomicI32>,
}

impl CommandReceiver {
    /// Next command in the queue, if there is one.
    pub fn next_command(&mut self) -> Option<OperatorCommand> {
        self.commands.try_recv().ok()
    }

    /// Handwheel counts since the last call. Counts that do not fit in an `i16` are returned by the next calls.
    pub fn wheel_counts(&mut self) -> i16 {
        let turned = self.wheel.load(Ordering::Relaxed);
        let counts = turned.clamp(i32::from(i16::MIN), i32::from(i16::MAX));
        self.wheel.fetch_sub(counts, Ordering::Relaxed);
        counts as i16
    }
}
