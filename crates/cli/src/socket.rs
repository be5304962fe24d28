//! Program from another computer: `tcp://HOST:PORT` (DNC, *Beyond the source*).
//!
//! This end connects to the sender, which sends the program from its beginning, and again from its beginning after each
//! lost connection: the part that arrived before is compared and skipped.
//!
//! A sender that is connected and silent is awaited, ten minutes unless `?silence_timeout_s=` sets another time; one
//! that has disappeared is detected by keepalive probes within half a minute. Anyone who can send to that address can
//! move the machine: there is no encryption and no authentication.
//!
//! Invariant: the bytes that are passed on are those of one program, each once. A connection that stalls is awaited;
//! one that ends before the program does is established again.

use std::io::{self, ErrorKind, Read};
use std::net::{TcpStream, ToSocketAddrs};
use std::thread;
use std::time::{Duration, Instant};

use retrace_config::NumberedError;
use retrace_gcode::ProgramEndDetector;

/// Prefix of the name of such a program.
const SCHEME: &str = "tcp://";
/// Maximum duration of one attempt to connect.
const ATTEMPT: Duration = Duration::from_secs(3);
/// Maximum silence of a sender that is connected, where its address sets no other.
const SILENCE: Duration = Duration::from_secs(600);
/// Interval of the polls of a silent sender.
const POLL_INTERVAL: Duration = Duration::from_millis(500);
/// Pause between two attempts.
const PAUSE: Duration = Duration::from_millis(200);
/// Maximum duration of reconnecting.
const RECONNECT_TIMEOUT: Duration = Duration::from_secs(600);
/// Number of complete connections without anything new after which the sender has no more to send, whatever the
/// program's end lacks.
const MAX_EMPTY_CONNECTIONS: u32 = 3;

/// Program over a socket.
#[derive(Debug)]
pub struct Socket {
    address: String,
    stream: Option<TcpStream>,
    patience: Duration,
    /// Maximum silence of a sender that is connected; `None` is unlimited.
    silence: Option<Duration>,
    /// Hash of the bytes that have arrived.
    received: u64,
    check: SenderCheck,
    end: ProgramEndDetector,
    /// Number of successive connections that were closed without anything new.
    barren: u32,
    ended: bool,
}

/// Address in a program's name, if it has the prefix.
#[must_use]
pub fn address(program: &str) -> Option<&str> {
    program.strip_prefix(SCHEME)
}

/// Parses an address: host and port, and the maximum silence from `silence_timeout_s`; `None` where that is 0, which is
/// unlimited.
fn parse(address: &str) -> Result<(&str, Option<Duration>), NumberedError> {
    let refused = |what: String| {
        NumberedError::new(
            "E2301",
            what,
            "use tcp://HOST:PORT, or tcp://HOST:PORT?silence_timeout_s=600 (seconds, 0 is unlimited)",
        )
    };
    let Some((host, parameters)) = address.split_once('?') else { return Ok((address, Some(SILENCE))) };
    let seconds = parameters
        .strip_prefix("silence_timeout_s=")
        .and_then(|value| value.parse::<f64>().ok())
        .filter(|seconds| (0.0..=86_400.0).contains(seconds))
        .ok_or_else(|| refused(format!("{SCHEME}{address}: unknown parameter `{parameters}`")))?;
    Ok((host, (seconds > 0.0).then(|| Duration::from_secs_f64(seconds))))
}

/// Whether an address is on another computer, as far as its name can be resolved.
#[must_use]
pub fn is_remote(address: &str) -> bool {
    let host = address.split_once('?').map_or(address, |(host, _)| host);
    host.to_socket_addrs().is_ok_and(|mut addresses| addresses.any(|address| !address.ip().is_loopback()))
}

impl Socket {
    /// Connects to a sender at `HOST:PORT`.
    ///
    /// # Errors
    /// `E2107`: no sender there. `E2301`: an unknown parameter.
    pub fn open(address: &str) -> Result<Self, NumberedError> {
        let (address, silence) = parse(address)?;
        let stream = connect(address).map_err(|error| {
            let remedy = "start the sender first; the address is tcp://HOST:PORT, such as tcp://planner:5000";
            NumberedError::new("E2107", format!("cannot connect to {SCHEME}{address}: {error}"), remedy)
        })?;
        Ok(Self {
            address: address.to_owned(),
            stream: Some(stream),
            patience: RECONNECT_TIMEOUT,
            silence,
            received: 0,
            check: SenderCheck::default(),
            end: ProgramEndDetector::default(),
            barren: 0,
            ended: false,
        })
    }

    /// Connects to the sender again, until it has sent the part that arrived before.
    fn reconnect(&mut self) -> io::Result<TcpStream> {
        let lost = Instant::now();
        loop {
            match connect(&self.address).and_then(|mut stream| self.compare_known_part(&mut stream).map(|()| stream)) {
                Ok(stream) => return Ok(stream),
                Err(error) if error.kind() == ErrorKind::InvalidData => return Err(error),
                Err(error) if lost.elapsed() > self.patience => return Err(error),
                Err(_) => thread::sleep(PAUSE),
            }
        }
    }

    /// Reads the part that arrived before, and compares it.
    fn compare_known_part(&self, stream: &mut TcpStream) -> io::Result<()> {
        let (mut check, mut end) = (SenderCheck::default(), ProgramEndDetector::default());
        let (mut left, mut bytes, begun) = (self.received, [0; 4096], Instant::now());
        while left > 0 {
            let most = bytes.len().min(usize::try_from(left).unwrap_or(usize::MAX));
            match stream.read(&mut bytes[..most]) {
                Ok(0) if end.is_reached() => {
                    let had_come = self.received - left;
                    let what = format!("it ends after {had_come} bytes, and {} had arrived before", self.received);
                    return Err(self.different_program(&what));
                }
                Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
                Ok(count) => {
                    check.update(&bytes[..count]);
                    end.push(&bytes[..count]);
                    left -= count as u64;
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if is_time_out(&error) => {
                    if self.silence.is_some_and(|silence| begun.elapsed() >= silence) {
                        return Err(self.silence_error(begun.elapsed()));
                    }
                }
                Err(error) => return Err(error),
            }
        }
        if check == self.check {
            return Ok(());
        }
        Err(self
            .different_program(&format!("its first {} bytes differ from those that had arrived before", self.received)))
    }

    /// Error of a sender that has been silent for too long.
    fn silence_error(&self, silent: Duration) -> io::Error {
        let what = format!(
            "E2304: {SCHEME}{} has been silent for {:.0} s inside the program; check the sender and the network",
            self.address,
            silent.as_secs_f64()
        );
        io::Error::new(ErrorKind::TimedOut, what)
    }

    /// Error of a sender that sends a different program after reconnecting.
    fn different_program(&self, how: &str) -> io::Error {
        let what =
            format!("the sender at {SCHEME}{} sends a different program after reconnecting: {how}", self.address);
        io::Error::new(ErrorKind::InvalidData, what)
    }
}

impl Read for Socket {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let begun = Instant::now();
        while !self.ended && !bytes.is_empty() {
            let mut stream = match self.stream.take() {
                Some(stream) => stream,
                None => self.reconnect()?,
            };
            match stream.read(bytes) {
                Ok(0) if self.end.is_reached() => self.ended = true,
                // The connection has ended or failed: it is established again.
                Ok(0) if self.barren < MAX_EMPTY_CONNECTIONS => {
                    self.barren += 1;
                    thread::sleep(PAUSE);
                }
                Ok(0) => self.ended = true,
                Ok(count) => {
                    self.stream = Some(stream);
                    self.barren = 0;
                    self.received += count as u64;
                    self.check.update(&bytes[..count]);
                    self.end.push(&bytes[..count]);
                    return Ok(count);
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => self.stream = Some(stream),
                Err(error) if is_time_out(&error) => {
                    if self.silence.is_some_and(|silence| begun.elapsed() >= silence) {
                        return Err(self.silence_error(begun.elapsed()));
                    }
                    self.stream = Some(stream);
                }
                Err(_) => {}
            }
        }
        Ok(0)
    }
}

fn connect(address: &str) -> io::Result<TcpStream> {
    let mut last = io::Error::new(ErrorKind::NotFound, "the host name has no address");
    for socket in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&socket, ATTEMPT) {
            Ok(stream) => {
                stream.set_read_timeout(Some(POLL_INTERVAL))?;
                keep_alive(&stream)?;
                return Ok(stream);
            }
            Err(error) => last = error,
        }
    }
    Err(last)
}

fn is_time_out(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock)
}

/// Detects a sender that has disappeared: after 10 s of silence it is probed every 5 s, and is gone after three probes.
#[cfg(unix)]
fn keep_alive(stream: &TcpStream) -> io::Result<()> {
    use rustix::net::sockopt;
    sockopt::set_socket_keepalive(stream, true)?;
    sockopt::set_tcp_keepidle(stream, Duration::from_secs(10))?;
    sockopt::set_tcp_keepintvl(stream, Duration::from_secs(5))?;
    Ok(sockopt::set_tcp_keepcnt(stream, 3)?)
}

/// Without keepalive probes only the read timeout detects it.
#[cfg(not(unix))]
fn keep_alive(_: &TcpStream) -> io::Result<()> {
    Ok(())
}

/// Hash of the beginning of a program (Fowler-Noll-Vo, variant 1a, of 64 bits).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct SenderCheck(u64);

impl Default for SenderCheck {
    fn default() -> Self {
        Self(0xCBF2_9CE4_8422_2325)
    }
}

impl SenderCheck {
    fn update(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;
    use std::net::TcpListener;

    /// Sender that gives each connection the next of `parts`, then closes it.
    fn sender(parts: Vec<Vec<u8>>) -> String {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("bound").to_string();
        thread::spawn(move || {
            for part in parts {
                let Ok((mut stream, _)) = listener.accept() else { return };
                let _ = stream.write_all(&part);
            }
        });
        address
    }

    fn program() -> Vec<u8> {
        let mut text: Vec<u8> = (0..5000).flat_map(|n| format!("G1 X{n} F100\n").into_bytes()).collect();
        text.extend_from_slice(b"M30 (end)\n");
        text
    }

    #[test]
    fn a_program_comes_whole_however_often_the_connection_is_lost() {
        let text = program();
        let parts = vec![text[..10].to_vec(), text[..5].to_vec(), text[..40_000].to_vec(), Vec::new(), text.clone()];
        let mut socket = Socket::open(&sender(parts)).expect("there");
        let mut come = Vec::new();
        socket.read_to_end(&mut come).expect("whole");
        assert!(come == text);
    }

    #[test]
    fn another_program_in_its_place_is_refused() {
        let text = program();
        let mut other = text.clone();
        other[7] = b'9';
        let mut socket = Socket::open(&sender(vec![text[..100].to_vec(), other])).expect("there");
        let error = socket.read_to_end(&mut Vec::new()).expect_err("another");
        assert_eq!(error.kind(), ErrorKind::InvalidData);
    }

    #[test]
    fn a_different_program_that_is_shorter_is_refused_at_its_end() {
        let parts = vec![program()[..100].to_vec(), b"G21\nM2\n".to_vec()];
        let mut socket = Socket::open(&sender(parts)).expect("there");
        let error = socket.read_to_end(&mut Vec::new()).expect_err("another");
        assert!(error.to_string().contains("different program"), "{error}");
        assert!(error.to_string().contains("ends after 7 bytes, and 100"), "{error}");
    }

    #[test]
    fn a_program_without_an_end_ends_where_its_sender_has_nothing_more() {
        let text = b"G21 G1 X1 F100\nX2\n".to_vec();
        let mut socket = Socket::open(&sender(vec![text.clone(); 6])).expect("there");
        let mut come = Vec::new();
        socket.read_to_end(&mut come).expect("its end");
        assert_eq!(come, text);
    }

    #[test]
    fn a_sender_that_is_silent_for_too_long_is_given_up() {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = format!("{}?silence_timeout_s=1", listener.local_addr().expect("bound"));
        let sender = thread::spawn(move || {
            let (mut stream, _) = listener.accept().expect("a connection");
            stream.write_all(b"G0 X1\n").expect("sent");
            thread::sleep(Duration::from_secs(4));
        });
        let mut socket = Socket::open(&address).expect("there");
        let mut come = Vec::new();
        let error = socket.read_to_end(&mut come).expect_err("silent");
        assert!(come == b"G0 X1\n" && error.to_string().contains("E2304"), "{error}");
        sender.join().expect("it ends");
        assert_eq!(Socket::open("127.0.0.1:1?patience=1").expect_err("unknown").number, "E2301");
    }

    /// A sender whose computer has gone is detected by probes: the first after 10 s of silence, then every 5 s, three
    /// of them.
    #[cfg(unix)]
    #[test]
    fn a_connection_has_keepalive_probes() {
        use rustix::net::sockopt;
        let socket = Socket::open(&sender(vec![program()])).expect("there");
        let stream = socket.stream.as_ref().expect("connected");
        assert_eq!(sockopt::socket_keepalive(stream), Ok(true));
        let times = [sockopt::tcp_keepidle(stream), sockopt::tcp_keepintvl(stream)];
        assert_eq!(times, [Ok(Duration::from_secs(10)), Ok(Duration::from_secs(5))]);
        assert_eq!(sockopt::tcp_keepcnt(stream), Ok(3));
    }

    #[test]
    fn only_this_computer_is_not_remote() {
        assert!(
            !is_remote("127.0.0.1:5000") && !is_remote("[::1]:5000") && !is_remote("127.9.9.9:1?silence_timeout_s=1")
        );
        assert!(is_remote("192.0.2.7:5000") && is_remote("192.0.2.7:5000?silence_timeout_s=1"));
    }

    #[test]
    fn nobody_there_is_refused_with_the_next_step() {
        assert_eq!(Socket::open("127.0.0.1:1").expect_err("nobody").number, "E2107");
        assert_eq!(Socket::open("nonsense").expect_err("no address").number, "E2107");
    }
}
