//! A Pico in rp2040js, with its line at a pseudo-terminal.
//!
//! The emulated card is slower than a card, and its host is in real time: it repeats what is not acknowledged as often
//! as with a fast card. What the card cannot take is lost on this line, frame by frame. If it waited, the
//! acknowledgements of reports would wait behind it, until the card could not store its reports any more.
//!
//! Invariant: the emulator ends with the value that started it; every wait is bounded.

use std::collections::VecDeque;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use retrace_hal_serial::Pty;
use retrace_task_support::tools;

use super::build::target_folder;

/// The script that runs an image.
const SCRIPT: &str = "crates/firmware/emulator/card.mjs";
/// Installation of the emulator.
const GET_RP2040JS: &str = "npm install --prefix target/emulator rp2040js@1.4.1 (docs/firmware.md)";
/// Longest wait for the emulator's end.
const PATIENCE: Duration = Duration::from_secs(60);
/// Largest number of bytes on their way to the card.
const UNDER_WAY: usize = 256;
/// Largest number of bytes that wait until the card takes them: a few milliseconds of a line of 1 Mbaud.
const WAITING: usize = 512;

/// Unique number of the emulated flash.
const FLASH_NUMBER: &str = "e4629c1207534b2d";
/// The card's serial number that is mixed from it, as its USB name has it.
pub(super) const SERIAL: &str = "E2D0F33C";

/// A running emulator.
pub(super) struct PicoEmulator {
    child: Child,
    line: PathBuf,
    errors: Option<JoinHandle<String>>,
    bridge: Option<JoinHandle<()>>,
    over: Arc<AtomicBool>,
    events: Receiver<EventState>,
}

/// The card's line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Line {
    /// UART0, at 1 Mbaud.
    Uart,
    /// The USB line, with a host that enumerates it.
    Usb,
}

impl Line {
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Uart => "uart",
            Self::Usb => "usb",
        }
    }
}

/// State of the event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum EventState {
    /// The card can be reached: it was found on USB.
    Ready,
    /// It has happened.
    Happened,
    /// What came of it has been seen; the card can be reached again, if the event allows it.
    Over,
}

/// What is connected to the inputs.
#[derive(Clone, Copy, Debug)]
pub(super) enum AtInputs {
    Nothing,
    /// A square wave at input 5, whose frequency the card measures.
    WaveHz(u32),
    /// The step output of an axis at input 5.
    StepsOf(u8),
    /// A probe and surfaces, as `probe.mjs` has them.
    Probe(&'static str),
    /// A torch, and a voltage module at UART0, as `torch.mjs` has them.
    Torch,
    /// A spindle with an encoder, as `spindle.mjs` has it.
    Spindle(&'static str),
}

/// The programs of the emulator: node, and the folder of rp2040js.
///
/// # Errors
/// One of them is not installed; the text says how to install it.
pub(super) fn can_emulate(root: &Path) -> Result<(PathBuf, PathBuf), String> {
    let node = tools::on_path("node").ok_or("no node (Node.js 20 or later) on PATH")?;
    let installed = |folder: PathBuf| folder.join("node_modules/rp2040js");
    let named = tools::variable("RETRACE_RP2040JS").into_iter();
    let usual = std::iter::once(installed(target_folder(root).join("emulator"))).chain(tools::toolbox().map(installed));
    let found = named.chain(usual).find(|folder| folder.join("package.json").is_file());
    Ok((node, found.ok_or_else(|| format!("no rp2040js: {GET_RP2040JS}"))?))
}

impl PicoEmulator {
    /// Starts the image; `event` happens after so many pulses, as the script describes.
    ///
    /// # Errors
    /// The emulator is not installed or does not start, or there is no pseudo-terminal.
    pub(super) fn start(
        root: &Path,
        image: &Path,
        line: Line,
        event: Option<(&str, u32)>,
        at_inputs: AtInputs,
    ) -> Result<Self, String> {
        let (node, rp2040js) = can_emulate(root)?;
        let mut command = Command::new(node);
        command.arg(root.join(SCRIPT)).arg(image).arg(line.name()).env("RETRACE_RP2040JS", rp2040js);
        command.env("RETRACE_FLASH_NUMBER", FLASH_NUMBER);
        match at_inputs {
            AtInputs::Nothing => &mut command,
            AtInputs::WaveHz(hz) => command.env("RETRACE_WAVE_HZ", hz.to_string()),
            AtInputs::StepsOf(axis) => command.env("RETRACE_STEP_WIRE", axis.to_string()),
            AtInputs::Probe(surfaces) => command.env("RETRACE_PROBE", surfaces),
            AtInputs::Torch => command.env("RETRACE_TORCH", "1"),
            AtInputs::Spindle(spindle) => command.env("RETRACE_SPINDLE", spindle),
        };
        if let Some((name, pulses)) = event {
            command.args([name, &pulses.to_string()]);
        }
        let piped = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = piped.spawn().map_err(|error| format!("node cannot be started: {error}"))?;
        let (Some(input), Some(output), Some(mut errors)) =
            (child.stdin.take(), child.stdout.take(), child.stderr.take())
        else {
            return Err("node has no pipes".into());
        };
        let pty = Pty::open().map_err(|error| format!("no pseudo-terminal: {error}"))?;
        let (line, over) = (pty.path().to_owned(), Arc::new(AtomicBool::new(false)));
        let errors = std::thread::spawn(move || {
            let mut text = String::new();
            // what was read before a fault is all there is
            let _ = errors.read_to_string(&mut text);
            text
        });
        let (messages, is_over) = (reader(output), Arc::clone(&over));
        let (sender, events) = channel();
        let bridge = std::thread::spawn(move || bridge(pty, input, &messages, &sender, &is_over));
        let emulator = Self { child, line, errors: Some(errors), bridge: Some(bridge), over, events };
        // a host does not wait as long for a card as this takes on a busy computer
        emulator.wait_for(EventState::Ready)?;
        Ok(emulator)
    }

    /// Waits until the event is in this state.
    ///
    /// # Errors
    /// The event does not reach this state.
    pub(super) fn wait_for(&self, wanted: EventState) -> Result<(), String> {
        loop {
            match self.events.recv_timeout(PATIENCE) {
                Ok(state) if state == wanted => return Ok(()),
                Ok(_) => {}
                Err(_) => return Err(format!("the emulator's event is never {wanted:?}")),
            }
        }
    }

    /// The terminal that is the card's line.
    pub(super) fn line(&self) -> &Path {
        &self.line
    }

    /// Ends the line, waits for the emulator, and returns what it has seen.
    ///
    /// # Errors
    /// It does not end, or ends without a report.
    pub(super) fn finish(mut self) -> Result<serde_json::Value, String> {
        self.over.store(true, Relaxed);
        let until = Instant::now() + PATIENCE;
        while matches!(self.child.try_wait(), Ok(None)) {
            if Instant::now() > until {
                return Err("the emulator does not end".into());
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        let text = self.errors.take().and_then(|errors| errors.join().ok()).unwrap_or_default();
        let report = text.lines().next_back().and_then(|line| serde_json::from_str(line).ok());
        report.ok_or_else(|| format!("the emulator has ended without a report: {text}"))
    }
}

impl Drop for PicoEmulator {
    fn drop(&mut self) {
        self.over.store(true, Relaxed);
        // it may have ended by itself
        let _ = self.child.kill();
        let _ = self.child.wait();
        if let Some(bridge) = self.bridge.take() {
            let _ = bridge.join();
        }
    }
}

/// Messages at the standard output of the emulator.
enum Message {
    /// Bytes from the card.
    Bytes(Vec<u8>),
    /// So many bytes have arrived at the card.
    Received(usize),
    /// The event is in this state now.
    Event(EventState),
}

/// Reads messages in a thread of its own, since a pipe cannot be read without waiting.
fn reader(mut from: impl Read + Send + 'static) -> Receiver<Message> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        while let Ok(message) = read_message(&mut from) {
            if sender.send(message).is_err() {
                break;
            }
        }
    });
    receiver
}

fn read_message(from: &mut impl Read) -> std::io::Result<Message> {
    let mut head = [0; 3];
    from.read_exact(&mut head)?;
    let count = usize::from(u16::from_le_bytes([head[1], head[2]]));
    match head[0] {
        0 => {}
        1 => return Ok(Message::Received(count)),
        _ => {
            return Ok(Message::Event(match count {
                1 => EventState::Happened,
                2 => EventState::Over,
                _ => EventState::Ready,
            }));
        }
    }
    let mut bytes = vec![0; count];
    from.read_exact(&mut bytes)?;
    Ok(Message::Bytes(bytes))
}

/// Carries bytes between the pseudo-terminal and the emulator, until it is over or one of them has ended.
fn bridge(
    mut pty: Pty,
    mut input: impl Write,
    from_card: &Receiver<Message>,
    events: &Sender<EventState>,
    over: &AtomicBool,
) {
    let mut bytes = [0; 4096];
    let (mut room, mut frames) = (UNDER_WAY, FrameQueue::default());
    while !over.load(Relaxed) {
        for message in from_card.try_iter() {
            match message {
                Message::Received(count) => room = (room + count).min(UNDER_WAY),
                Message::Bytes(bytes) if pty.write(&bytes).is_err() => return,
                Message::Bytes(_) => {}
                Message::Event(state) => {
                    // the receiver may be gone already
                    let _ = events.send(state);
                }
            }
        }
        let Ok(count) = pty.read(&mut bytes, Duration::from_millis(1)) else { break };
        frames.push(&bytes[..count]);
        let taken = frames.take(room);
        room -= taken.len();
        if !taken.is_empty() && input.write_all(&taken).and_then(|()| input.flush()).is_err() {
            break;
        }
    }
}

/// Frames that wait for the card. Each ends with a zero byte.
///
/// Invariant: at most [`WAITING`] bytes wait, and a frame that does not fit is lost whole.
#[derive(Default)]
struct FrameQueue {
    waiting: VecDeque<u8>,
    /// The frame whose end has not arrived yet.
    begun: Vec<u8>,
}

impl FrameQueue {
    fn push(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.begun.push(byte);
            if byte == 0 {
                if self.waiting.len() + self.begun.len() <= WAITING {
                    self.waiting.extend(&self.begun);
                }
                self.begun.clear();
            }
        }
    }

    fn take(&mut self, room: usize) -> Vec<u8> {
        self.waiting.drain(..room.min(self.waiting.len())).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_read_and_what_is_cut_short_is_an_error() {
        let mut stream = &[0, 2, 0, 7, 8, 1, 4, 1, 2, 2, 0, 0, 9, 0, 1][..];
        assert!(matches!(read_message(&mut stream), Ok(Message::Bytes(bytes)) if bytes == [7, 8]));
        assert!(matches!(read_message(&mut stream), Ok(Message::Received(260))));
        assert!(matches!(read_message(&mut stream), Ok(Message::Event(EventState::Over))));
        assert!(read_message(&mut stream).is_err());
    }

    #[test]
    fn a_line_that_is_full_loses_whole_frames_and_none_before() {
        let frame = |number: u8| [[number; 99].as_slice(), &[0]].concat();
        let mut queue = FrameQueue::default();
        for number in 1..=7 {
            // a frame arrives in two parts
            let (head, tail) = (&frame(number)[..40], &frame(number)[40..]);
            queue.push(head);
            queue.push(tail);
        }
        let first: Vec<u8> = (1..=5).flat_map(frame).collect();
        assert_eq!([queue.take(250), queue.take(250), queue.take(250)].concat(), first);
        queue.push(&frame(8));
        assert_eq!(queue.take(1000), frame(8), "there is room again");
    }
}
