//! Two threads that send operator commands, and the motion path that receives them.
//!
//! Runs `crates/controller/src/command_channel.rs`: sending, refusing what does not fit, turning the handwheel and
//! reading it. A command is a number.
//!
//! Invariant: what was accepted is received once, in its sender's order, and the counts add up.

use crate::command_channel::{CommandSender, command_channel_of};
use crate::sync::thread;

/// Shape of a model.
#[derive(Clone, Copy, Debug)]
pub struct Commands {
    /// Capacity of the queue.
    pub capacity: usize,
    /// Number of commands that each thread sends.
    pub commands: u32,
    /// Handwheel counts that each thread turns, one after the other.
    pub counts: [i32; 2],
}

/// First command of each thread.
const FIRST: [u32; 2] = [0, 100];

fn send(sender: &CommandSender, first: u32, commands: u32, counts: [i32; 2]) -> Vec<u32> {
    sender.turn_wheel(counts[0]);
    let accepted = (first..first + commands).filter(|command| sender.send(*command).is_ok()).collect();
    sender.turn_wheel(counts[1]);
    accepted
}

impl Commands {
    /// Runs the three threads. Returns the number of commands that were refused.
    ///
    /// # Panics
    /// Where a command is lost, repeated or out of its sender's order, or a count is lost.
    #[must_use]
    pub fn run(self) -> u32 {
        let Self { capacity, commands, counts } = self;
        let (sender, mut receiver) = command_channel_of(capacity);
        let senders = FIRST.map(|first| {
            let sender = sender.clone();
            thread::spawn(move || send(&sender, first, commands, counts))
        });
        drop(sender);
        // while they send
        let mut turned = i32::from(receiver.wheel_counts());
        let mut received: Vec<u32> = receiver.next_command().into_iter().collect();
        turned += i32::from(receiver.wheel_counts());
        let accepted = senders.map(|sender| sender.join().expect("no sender panics"));
        while let Some(command) = receiver.next_command() {
            received.push(command);
        }
        // whatever does not fit in one call comes with the next
        for _ in 0..8 {
            turned += i32::from(receiver.wheel_counts());
        }
        assert_eq!(turned, 2 * (counts[0] + counts[1]), "handwheel counts");
        for (accepted, first) in accepted.iter().zip(FIRST) {
            let own: Vec<u32> = received.iter().copied().filter(|command| command / 100 == first / 100).collect();
            assert_eq!(own, *accepted, "accepted and received");
        }
        2 * commands - accepted.iter().map(Vec::len).sum::<usize>() as u32
    }
}
