//! A computer that sends a program over a socket, badly: it stalls, is cut off, goes away and comes again.
//!
//! Invariant: every connection is sent the program from its beginning; what goes wrong when follows from the seed. The last connection
//! is sent all of it.

use std::io::Write;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

/// Where a sender cuts a connection, how it stalls.
#[derive(Clone, Debug, Default)]
pub struct Trouble {
    /// Bytes after which the connection is cut: the first connection after the first of them, and so on.
    pub cuts: Vec<usize>,
    /// Is nobody there for a while after a cut?
    pub goes_away: bool,
    /// Stalls: after so many bytes of the program, for so long. Each happens once.
    pub stalls: Vec<(usize, Duration)>,
}

/// A source of numbers that look random, the same for a seed (xorshift).
#[derive(Clone, Debug)]
pub struct Chance(u64);

impl Chance {
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

impl Trouble {
    /// So many cuts and stalls of up to so many ms each, anywhere in a program of `length` bytes.
    #[must_use]
    pub fn anywhere(chance: &mut Chance, length: usize, cuts: usize, stalls: usize, max_ms: usize) -> Self {
        let stall = |chance: &mut Chance| (chance.below(length), Duration::from_millis(chance.below(max_ms) as u64));
        Self {
            cuts: (0..cuts).map(|_| chance.below(length)).collect(),
            goes_away: true,
            stalls: (0..stalls).map(|_| stall(chance)).collect(),
        }
    }
}

/// Sends a program to whoever connects; the name of the program comes back, `tcp://…`. Nobody waits for the sender.
///
/// # Panics
/// Where the system has no port.
#[must_use]
pub fn send(text: Arc<Vec<u8>>, trouble: Trouble) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("bound");
    thread::spawn(move || serve(listener, address, &text, trouble));
    format!("tcp://{address}")
}

fn serve(mut listener: TcpListener, address: SocketAddr, text: &[u8], trouble: Trouble) {
    let Trouble { cuts, goes_away, mut stalls } = trouble;
    stalls.sort_by_key(|&(at, _)| std::cmp::Reverse(at));
    let whole = [text.len()];
    for &end in cuts.iter().chain(&whole) {
        let Ok((mut stream, _)) = listener.accept() else { return };
        // whoever it was sent to may be gone
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
