//! Program over an RS-232 line: `serial:PATH?baud=9600&format=7e2` (SHP-30 … SHP-33).
//!
//! A thread serves the port, so that the sender is paused in time whatever the decoder does.
//!
//! Invariant: every line that arrives undamaged is passed on once; after a damaged character, an overrun or a silence
//! nothing is.

use std::collections::VecDeque;
use std::io::{self, BufRead, Read};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use retrace_config::{NumberedError, Parity, SerialSettings};
use retrace_controller::{ReceivedByte, SourceStatus, TapeReader};
use retrace_gcode::ProgramEndDetector;
use retrace_hal_serial::{Character, CharacterFormat, ParityBit, PortLost, ProgramPort};

/// Prefix of the name of such a program.
const SCHEME: &str = "serial:";
/// Bytes that may wait for the decoder.
const SPACE: usize = 16 << 10;
/// Fill levels at which the sender is paused and resumed.
const PAUSE_AT: usize = SPACE / 4 * 3;
const RESUME_AT: usize = SPACE / 4;
/// Fill level that counts as an overrun: beyond `SPACE`, characters may be under way before the sender pauses.
const OVERRUN_AT: usize = SPACE + (2 << 10);
/// Number of bytes that the decoder reads at a time.
const READ_BYTES: usize = 1024;
/// Longest wait for the port.
const POLL_INTERVAL: Duration = Duration::from_millis(10);
/// Silence after which DC1 is repeated.
const REPEATED_AFTER: Duration = Duration::from_secs(5);
const DC1: u8 = 0x11;
const DC3: u8 = 0x13;

/// Address in a program's name, if it has the prefix: `PATH?setting=value&…`.
#[must_use]
pub fn address(program: &str) -> Option<&str> {
    program.strip_prefix(SCHEME)
}

/// Parses an address: its path, and its settings over those of the machine file.
///
/// # Errors
/// `E2301`: no path, or an unknown setting.
pub fn parse(address: &str, mut settings: SerialSettings) -> Result<(PathBuf, SerialSettings), NumberedError> {
    let (path, parameters) = address.split_once('?').unwrap_or((address, ""));
    if path.is_empty() {
        let what = format!("{SCHEME}{address} has no port");
        return Err(NumberedError::new(
            "E2301",
            what,
            "use serial:PATH, such as serial:/dev/ttyUSB0?baud=9600&format=7e2",
        ));
    }
    for parameter in parameters.split('&').filter(|parameter| !parameter.is_empty()) {
        let (key, value) = parameter.split_once('=').unwrap_or((parameter, ""));
        settings.set(key, value)?;
    }
    Ok((path.into(), settings))
}

/// Text that has arrived and has not been read.
#[derive(Debug, Default)]
struct Queue {
    text: VecDeque<u8>,
    ended: bool,
    error: Option<io::Error>,
}

#[derive(Debug, Default)]
struct Shared {
    queue: Mutex<Queue>,
    changed: Condvar,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Program over a serial line.
#[derive(Debug)]
pub struct SerialSource {
    shared: Arc<Shared>,
    taken: Vec<u8>,
    at: usize,
    given_up: Arc<AtomicBool>,
    status: Arc<SourceStatus>,
}

impl SerialSource {
    /// Opens the port of an address, and resumes the sender.
    ///
    /// # Errors
    /// `E2301`, and any error of opening the port.
    pub fn open(
        address: &str,
        settings: SerialSettings,
        given_up: &Arc<AtomicBool>,
        status: &Arc<SourceStatus>,
    ) -> Result<Self, NumberedError> {
        let (path, settings) = parse(address, settings)?;
        let SerialSettings { baud, bits, stop, .. } = settings;
        let parity = match settings.parity {
            Parity::Even => ParityBit::Even,
            Parity::Odd => ParityBit::Odd,
            Parity::None => ParityBit::None,
        };
        let port = ProgramPort::open(&path, CharacterFormat { baud, bits, parity, stop })
            .map_err(|refused| NumberedError::new(refused.number, refused.what, refused.remedy))?;
        let shared = Arc::<Shared>::default();
        let (given_up, status) = (Arc::clone(given_up), Arc::clone(status));
        let name = format!("{SCHEME}{}", path.display());
        let receiver = Receiver::new(name, port, settings, Arc::clone(&shared), Arc::clone(&given_up));
        thread::Builder::new().name("serial source".into()).spawn(move || receiver.run()).map_err(|error| {
            NumberedError::new("E2104", format!("no thread for the port: {error}"), "end other programs")
        })?;
        Ok(Self { shared, taken: Vec::new(), at: 0, given_up, status })
    }
}

impl BufRead for SerialSource {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.at == self.taken.len() {
            (self.at, self.taken) = (0, Vec::new());
            let mut queue = self.shared.lock();
            while queue.text.is_empty()
                && !queue.ended
                && queue.error.is_none()
                && !self.given_up.load(Ordering::Relaxed)
            {
                self.status.begin_wait();
                queue = self
                    .shared
                    .changed
                    .wait_timeout(queue, Duration::from_millis(20))
                    .map_or_else(|poisoned| poisoned.into_inner().0, |waited| waited.0);
            }
            self.status.end_wait();
            let count = queue.text.len().min(READ_BYTES);
            self.taken.extend(queue.text.drain(..count));
            if count == 0
                && let Some(error) = queue.error.take()
            {
                queue.ended = true;
                return Err(error);
            }
        }
        Ok(&self.taken[self.at..])
    }

    fn consume(&mut self, amount: usize) {
        self.at = (self.at + amount).min(self.taken.len());
    }
}

impl Read for SerialSource {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(into)?;
        self.consume(count);
        Ok(count)
    }
}

/// Operations of a receiver on its port; [`ProgramPort`] implements them.
trait ProgramLine {
    fn read(&mut self, characters: &mut Vec<Character>, wait: Duration) -> Result<(), PortLost>;
    fn send(&mut self, byte: u8) -> Result<bool, PortLost>;
    fn set_request_to_send(&mut self, level: bool) -> Result<(), PortLost>;
    fn is_clear_to_send(&mut self) -> bool;
}

impl ProgramLine for ProgramPort {
    fn read(&mut self, characters: &mut Vec<Character>, wait: Duration) -> Result<(), PortLost> {
        Self::read(self, characters, wait)
    }

    fn send(&mut self, byte: u8) -> Result<bool, PortLost> {
        Self::send(self, byte)
    }

    fn set_request_to_send(&mut self, level: bool) -> Result<(), PortLost> {
        Self::set_request_to_send(self, level)
    }

    fn is_clear_to_send(&mut self) -> bool {
        Self::is_clear_to_send(self)
    }
}

/// Thread that serves the port.
struct Receiver<P> {
    name: String,
    port: P,
    settings: SerialSettings,
    reader: TapeReader,
    end: ProgramEndDetector,
    shared: Arc<Shared>,
    given_up: Arc<AtomicBool>,
    /// Whether the sender was last resumed.
    is_asking: bool,
    /// Time of the last character, or of the last resumption.
    heard: Instant,
    /// Time of the last resumption.
    asked: Instant,
    has_begun: bool,
}

impl<P: ProgramLine> Receiver<P> {
    /// Receiver that serves a port from its first character on.
    fn new(name: String, port: P, settings: SerialSettings, shared: Arc<Shared>, given_up: Arc<AtomicBool>) -> Self {
        Self {
            name,
            port,
            settings,
            reader: TapeReader::new(settings),
            end: ProgramEndDetector::default(),
            shared,
            given_up,
            is_asking: false,
            heard: Instant::now(),
            asked: Instant::now(),
            has_begun: false,
        }
    }

    fn run(mut self) {
        let result = self.receive();
        // The sender is paused in any case; a line that is gone needs nothing.
        let _ = self.set_sending(false);
        let mut queue = self.shared.lock();
        match result {
            Ok(()) => queue.ended = true,
            Err(error) => queue.error = Some(error),
        }
        drop(queue);
        self.shared.changed.notify_all();
    }

    /// Receives until the end of the program, or until it is no longer needed.
    fn receive(&mut self) -> io::Result<()> {
        let (mut characters, mut text) = (Vec::new(), Vec::new());
        while !self.given_up.load(Ordering::Relaxed) {
            let waiting = self.shared.lock().text.len();
            if self.is_asking && waiting >= PAUSE_AT {
                self.set_sending(false)?;
            } else if !self.is_asking && waiting <= RESUME_AT {
                self.set_sending(true)?;
            }
            characters.clear();
            self.port
                .read(&mut characters, POLL_INTERVAL)
                .map_err(|lost| io::Error::other(format!("E2309: {lost}")))?;
            if characters.is_empty() {
                if self.silence()? {
                    return Ok(());
                }
                continue;
            }
            (self.heard, self.has_begun) = (Instant::now(), true);
            let mut result = Ok(());
            for character in &characters {
                let received = match character {
                    Character::Byte(byte) => ReceivedByte::Byte(*byte),
                    Character::Damaged => ReceivedByte::Damaged,
                };
                result = result.and_then(|()| self.reader.push(received, &mut text));
            }
            self.pass_on(&mut text)?;
            result.map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))?;
            if self.reader.has_ended() {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Passes text to the decoder, as far as there is space for it.
    fn pass_on(&mut self, text: &mut Vec<u8>) -> io::Result<()> {
        let mut queue = self.shared.lock();
        let room = OVERRUN_AT.saturating_sub(queue.text.len());
        let is_overrun = text.len() > room;
        text.truncate(room);
        self.end.push(text);
        queue.text.extend(text.drain(..));
        drop(queue);
        self.shared.changed.notify_all();
        if !is_overrun {
            return Ok(());
        }
        let what = format!(
            "E2306: {} kept sending while paused, and characters were lost; use the same handshake on both sides",
            self.name
        );
        Err(io::Error::new(io::ErrorKind::InvalidData, what))
    }

    /// Handles silence: true where the program may end that way, an error where it lasts too long.
    fn silence(&mut self) -> io::Result<bool> {
        if !self.is_asking {
            return Ok(false);
        }
        let silent = self.heard.elapsed();
        let is_over = |limit_s: f64| limit_s > 0.0 && silent.as_secs_f64() >= limit_s;
        let timed_out = |what: String| Err(io::Error::new(io::ErrorKind::TimedOut, what));
        if !self.has_begun && is_over(self.settings.start_timeout_s) {
            return timed_out(format!(
                "E2303: no character came from {} within {} s; start the sender, check the cable and the settings",
                self.name, self.settings.start_timeout_s
            ));
        }
        if self.has_begun && is_over(self.settings.silence_timeout_s) {
            if self.end.is_reached() {
                return Ok(true);
            }
            return timed_out(format!(
                "E2304: {} has been silent for {} s inside the program; check the sender and the cable",
                self.name, self.settings.silence_timeout_s
            ));
        }
        if self.settings.dc_codes && self.settings.handshake.has_xon_xoff() {
            let last = self.heard.max(self.asked);
            if last.elapsed() >= REPEATED_AFTER {
                self.set_sending(true)?;
            }
        }
        Ok(false)
    }

    /// Resumes or pauses the sender.
    fn set_sending(&mut self, sends: bool) -> io::Result<()> {
        let lost = |lost: PortLost| io::Error::other(format!("E2309: {lost}"));
        let handshake = self.settings.handshake;
        if handshake.has_rts_cts() {
            self.port.set_request_to_send(sends).map_err(lost)?;
        }
        if handshake.has_xon_xoff() {
            // With both handshakes this end sends only while CTS permits it; the next pass tries again.
            let may_send = !handshake.has_rts_cts() || self.port.is_clear_to_send();
            if !may_send || !self.port.send(if sends { DC1 } else { DC3 }).map_err(lost)? {
                return Ok(());
            }
        }
        if sends && !self.is_asking {
            self.heard = Instant::now();
        }
        (self.is_asking, self.asked) = (sends, Instant::now());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Line with RTS and CTS, and a sender that sends while RTS is on and its program lasts.
    #[derive(Default)]
    struct ModemLine {
        program: Vec<u8>,
        at: usize,
        is_requested: bool,
        /// Changes of RTS, with the number of characters that had been sent by then.
        changes: Vec<(bool, usize)>,
        /// Number of polls after which the other end switches CTS on.
        clear_after: u32,
        codes: Vec<u8>,
    }

    impl ProgramLine for &Mutex<ModemLine> {
        fn read(&mut self, characters: &mut Vec<Character>, wait: Duration) -> Result<(), PortLost> {
            let mut line = self.lock().expect("whole");
            let end = if line.is_requested { line.program.len().min(line.at + 100) } else { line.at };
            characters.extend(line.program[line.at..end].iter().map(|&byte| Character::Byte(byte)));
            line.at = end;
            drop(line);
            if characters.is_empty() {
                thread::sleep(wait);
            }
            Ok(())
        }

        fn send(&mut self, byte: u8) -> Result<bool, PortLost> {
            self.lock().expect("whole").codes.push(byte);
            Ok(true)
        }

        fn set_request_to_send(&mut self, level: bool) -> Result<(), PortLost> {
            let mut line = self.lock().expect("whole");
            if line.is_requested != level {
                let at = line.at;
                line.changes.push((level, at));
            }
            line.is_requested = level;
            Ok(())
        }

        fn is_clear_to_send(&mut self) -> bool {
            let mut line = self.lock().expect("whole");
            line.clear_after = line.clear_after.saturating_sub(1);
            line.clear_after == 0
        }
    }

    /// Text that arrives over such a line when the decoder reads nothing until the sender has been paused.
    fn received(handshake: &str, line: &Mutex<ModemLine>) -> Vec<u8> {
        let mut settings = SerialSettings::default();
        settings.set("handshake", handshake).expect("known");
        settings.set("format", "8n1").expect("known");
        let (shared, given_up) = (Arc::<Shared>::default(), Arc::<AtomicBool>::default());
        let receiver = Receiver::new("line".into(), line, settings, Arc::clone(&shared), given_up);
        let mut come = Vec::new();
        thread::scope(|scope| {
            scope.spawn(|| receiver.run());
            let begun = Instant::now();
            while !line.lock().expect("whole").changes.iter().any(|(level, _)| !level) {
                assert!(begun.elapsed() < Duration::from_secs(20), "it is told to pause");
                thread::sleep(Duration::from_millis(1));
            }
            // Nothing is sent while the sender is paused.
            let (paused_at, _) = (line.lock().expect("whole").at, thread::sleep(Duration::from_millis(50)));
            assert_eq!(line.lock().expect("whole").at, paused_at);
            loop {
                let mut queue = shared.lock();
                assert!(queue.error.is_none(), "{:?}", queue.error);
                come.extend(queue.text.drain(..));
                if queue.ended {
                    break;
                }
                drop(queue);
                assert!(begun.elapsed() < Duration::from_secs(40), "it ends");
                thread::sleep(Duration::from_millis(1));
            }
        });
        come
    }

    fn long_program() -> Vec<u8> {
        let mut text = b"%\n".to_vec();
        (0..3000).for_each(|n| text.extend(format!("G1 X{n} F100\n").into_bytes()));
        text.extend_from_slice(b"M30\n%\n");
        text
    }

    #[test]
    fn rts_tells_the_sender_to_pause_and_no_code_is_sent() {
        let line = Mutex::new(ModemLine { program: long_program(), ..ModemLine::default() });
        let come = received("rts-cts", &line);
        let line = line.into_inner().expect("whole");
        assert!(come == long_program(), "every line, once: {} bytes", come.len());
        assert!(line.codes.is_empty(), "neither DC1 nor DC3: {:?}", line.codes);
        assert_eq!(line.changes.first(), Some(&(true, 0)), "the sender is asked first");
        assert!((PAUSE_AT..OVERRUN_AT).contains(&line.changes[1].1), "{:?}", line.changes);
        assert!(!line.is_requested && line.changes.len() >= 4, "and told to pause at the end: {:?}", line.changes);
    }

    #[test]
    fn with_both_handshakes_codes_are_sent_only_where_cts_allows_it() {
        let line = Mutex::new(ModemLine { program: long_program(), clear_after: 5, ..ModemLine::default() });
        let come = received("both", &line);
        let line = line.into_inner().expect("whole");
        assert!(come == long_program(), "every line, once: {} bytes", come.len());
        // CTS was polled until it came on; then DC1, and DC3 at the pause and at the end.
        assert_eq!((line.clear_after, line.codes.first(), line.codes.last()), (0, Some(&DC1), Some(&DC3)));
        assert!(line.codes.contains(&DC3) && line.codes.iter().all(|code| matches!(*code, DC1 | DC3)));
    }

    #[test]
    fn an_address_names_a_port_and_its_settings() {
        let (path, settings) = parse("/dev/ttyUSB0?baud=9600&format=7e2", SerialSettings::default()).expect("known");
        assert_eq!((path.to_str(), settings.baud, settings.bits, settings.stop), (Some("/dev/ttyUSB0"), 9600, 7, 2));
        assert_eq!(parse("/dev/ttyS0", SerialSettings::default()).expect("no settings").1, SerialSettings::default());
        for bad in ["", "?baud=9600", "/dev/ttyS0?baud", "/dev/ttyS0?speed=9600", "/dev/ttyS0?format=7q2"] {
            assert_eq!(parse(bad, SerialSettings::default()).expect_err("refused").number, "E2301", "{bad}");
        }
    }
}
