//! A computer that sends a program over a socket, badly: it stalls, is cut off, disconnects and connects again.
//!
//! Invariant: every connection is sent the program from its beginning; faults and their times depend on the seed. The
//! last connection is sent all of it.

use std::io::Write;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

/// Faults of a sender: where it cuts a connection, how it stalls.
#[derive(Clone, Debug, Default)]
pub struct SenderFaults {
    /// Number of bytes after which the connection is cut: the first connection after the first number, and so on.
    pub cuts: Vec<usize>,
    /// Whether the sender is absent for a while after a cut.
    pub goes_away: bool,
    /// Stalls: position in bytes of the program, and duration. Each occurs once.
    pub stalls: Vec<(usize, Duration)>,
}

/// Pseudo-random numbers that depend on a seed (xorshift).
#[derive(Clone, Debug)]
pub struct TestRandom(u64);

impl TestRandom {
    /// Numbers that depend on the seed alone.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mut chance = Self(seed ^ 0x9E37_79B9_7F4A_7C15);
        chance.0 = chance.0.max(1);
        (0..8).for_each(|_| _ = chance.below(2));
        chance
    }

    /// A number below `end`, which is at least 1.
    pub fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 16) as usize % end
    }
}

impl SenderFaults {
    /// Up to `count` cuts and stalls of up to `ms` ms each, anywhere in a program of `length` bytes.
    #[must_use]
    pub fn anywhere(chance: &mut TestRandom, length: usize, cuts: usize, stalls: usize, max_ms: usize) -> Self {
        let stall =
            |chance: &mut TestRandom| (chance.below(length), Duration::from_millis(chance.below(max_ms) as u64));
        Self {
            cuts: (0..cuts).map(|_| chance.below(length)).collect(),
            goes_away: true,
            stalls: (0..stalls).map(|_| stall(chance)).collect(),
        }
    }
}

/// Sends a program to every client; returns the name of the program, `tcp://…`. Nothing waits for the sender.
///
/// # Panics
/// Where the system has no port.
#[must_use]
pub fn send(text: Arc<Vec<u8>>, trouble: SenderFaults) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("bound");
    thread::spawn(move || serve(listener, address, &text, trouble));
    format!("tcp://{address}")
}

fn serve(mut listener: TcpListener, address: SocketAddr, text: &[u8], trouble: SenderFaults) {
    let SenderFaults { cuts, goes_away, mut stalls } = trouble;
    stalls.sort_by_key(|&(at, _)| std::cmp::Reverse(at));
    let whole = [text.len()];
    for &end in cuts.iter().chain(&whole) {
        let Ok((mut stream, _)) = listener.accept() else { return };
        // the client may be gone
        if part(&mut stream, &text[..end], &mut stalls).is_err() || end == text.len() {
            return;
        }
        drop(stream);
        if goes_away {
            drop(listener);
            thread::sleep(Duration::from_millis(300));
            let Some(again) = (0..100).find_map(|_| {
                thread::sleep(Duration::from_millis(20));
                TcpListener::bind(address).ok()
            }) else {
                return;
            };
            listener = again;
        }
    }
}

/// Sends a beginning of the program, stalling where that is due for the first time.
fn part(stream: &mut TcpStream, text: &[u8], stalls: &mut Vec<(usize, Duration)>) -> std::io::Result<()> {
    let mut sent = 0;
    while let Some(&(at, stall)) = stalls.last()
        && at < text.len()
    {
        stream.write_all(&text[sent..at])?;
        thread::sleep(stall);
        sent = at;
        stalls.pop();
    }
    stream.write_all(&text[sent..])
}
