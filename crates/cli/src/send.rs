//! `retrace send`: a program over an RS-232 line to an old control that waits for it (SHP-34).
//!
//! Invariant: a character is sent only while the control allows it, at most two behind its request to pause. Nothing
//! moves by this: the operator starts the old control there.

use std::path::Path;
use std::time::{Duration, Instant};

use retrace_config::{NumberedError, Parity, SerialSettings};
use retrace_controller::tape_of;
use retrace_hal_serial::{Character, CharacterFormat, ParityBit, ProgramPort};

use crate::args::Send;
use crate::{files, serial_source};

const DC1: u8 = 0x11;
const DC3: u8 = 0x13;
/// Interval at which progress is printed.
const PROGRESS_INTERVAL: Duration = Duration::from_secs(5);

/// Runs the command for a program.
///
/// # Errors
/// Those of [`transfer`].
pub fn run(args: &Send) -> Result<(), NumberedError> {
    let program = args.program.clone().unwrap_or_default();
    transfer(args, args.machine.as_deref(), &program, &mut || Ok(()))
}

/// Sends a program. `begins` is called before the first character is sent, and may refuse.
///
/// # Errors
/// `E5041` where the program cannot be sent, `E5042` where the control does not ask for it, `E2301`, `E2309` and those
/// of opening the port; `E2101` where the program cannot be read; the error of `begins`.
pub fn transfer(
    args: &Send,
    machine: Option<&Path>,
    program: &Path,
    begins: &mut dyn FnMut() -> Result<(), NumberedError>,
) -> Result<(), NumberedError> {
    let machine = files::machine(machine)?;
    let address = serial_source::address(&args.port).unwrap_or(&args.port);
    let (path, settings) = serial_source::parse(address, machine.serial)?;
    let text = std::fs::read(program).map_err(|error| {
        let what = format!("{}: {error}", program.display());
        NumberedError::new("E2101", what, "name a program that can be read")
    })?;
    let tape = tape_of(&text, &settings).map_err(|refused| {
        let what = format!("{}: {refused}", program.display());
        NumberedError::new("E5041", what, "send it in another code, or write that line without the character")
    })?;
    let port = ProgramPort::open(&path, format(&settings))
        .map_err(|refused| NumberedError::new(refused.number, refused.what, refused.remedy))?;
    Sender::new(port, settings, args.now).send(&tape, begins)
}

fn format(settings: &SerialSettings) -> CharacterFormat {
    let parity = match settings.parity {
        Parity::Even => ParityBit::Even,
        Parity::Odd => ParityBit::Odd,
        Parity::None => ParityBit::None,
    };
    CharacterFormat { baud: settings.baud, bits: settings.bits, parity, stop: settings.stop }
}

/// What the control allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Permission {
    has_xon_xoff: bool,
    has_rts_cts: bool,
    /// The last of DC1 and DC3.
    is_asked: bool,
    pauses: u32,
}

impl Permission {
    /// Takes a received character; its parity bit is not looked at.
    fn take(&mut self, byte: u8) {
        match byte & 0x7F {
            DC1 => self.is_asked = true,
            DC3 => {
                self.pauses += u32::from(self.is_asked && self.has_xon_xoff);
                self.is_asked = false;
            }
            _ => {}
        }
    }

    fn allows(self, is_clear_to_send: bool) -> bool {
        (!self.has_xon_xoff || self.is_asked) && (!self.has_rts_cts || is_clear_to_send)
    }
}

struct Sender {
    port: ProgramPort,
    settings: SerialSettings,
    permission: Permission,
    sent: usize,
}

impl Sender {
    fn new(port: ProgramPort, settings: SerialSettings, is_now: bool) -> Self {
        let (has_xon_xoff, has_rts_cts) = (settings.handshake.has_xon_xoff(), settings.handshake.has_rts_cts());
        let permission = Permission { has_xon_xoff, has_rts_cts, is_asked: is_now, pauses: 0 };
        Self { port, settings, permission, sent: 0 }
    }

    fn send(mut self, tape: &[u8], begins: &mut dyn FnMut() -> Result<(), NumberedError>) -> Result<(), NumberedError> {
        say!("{} characters; waiting for the control to ask for them", tape.len());
        if self.settings.handshake.has_rts_cts() {
            self.lost(|port| port.set_request_to_send(true))?;
        }
        let began = Instant::now();
        let (mut printed, mut allowed_at, mut is_told, mut has_begun) = (began, began, false, false);
        while let Some(&byte) = tape.get(self.sent) {
            self.listen(Duration::ZERO)?;
            if !self.permission.allows(self.port.is_clear_to_send()) {
                self.await_permission(allowed_at, &mut is_told)?;
                continue;
            }
            (allowed_at, is_told) = (Instant::now(), false);
            if !has_begun {
                begins()?;
                has_begun = true;
                continue;
            }
            if self.lost(|port| port.send_paced(byte))? {
                self.sent += 1;
            } else {
                std::thread::sleep(self.port.character_time() / 2);
            }
            if printed.elapsed() >= PROGRESS_INTERVAL {
                say!("{} of {} characters", self.sent, tape.len());
                printed = Instant::now();
            }
        }
        // until the line has sent what is on its way
        std::thread::sleep(3 * self.port.character_time());
        say!("{} characters sent; the control has paused {} times", self.sent, self.permission.pauses);
        Ok(())
    }

    /// Waits for what the control sends. Before the first character the wait is bounded.
    fn await_permission(&mut self, since: Instant, is_told: &mut bool) -> Result<(), NumberedError> {
        let waited = since.elapsed().as_secs_f64();
        let SerialSettings { start_timeout_s, silence_timeout_s, .. } = self.settings;
        if self.sent == 0 && start_timeout_s > 0.0 && waited > start_timeout_s {
            let what = format!("the control has not asked for the program within {start_timeout_s} s");
            let remedy = "start its input first; check cable, baud and handshake; --now sends without being asked";
            return Err(NumberedError::new("E5042", what, remedy));
        }
        if self.sent > 0 && silence_timeout_s > 0.0 && waited > silence_timeout_s && !*is_told {
            say!("the control has paused for {silence_timeout_s} s behind {} characters; waiting on", self.sent);
            *is_told = true;
        }
        self.listen(Duration::from_millis(5))
    }

    fn listen(&mut self, wait: Duration) -> Result<(), NumberedError> {
        let mut characters = Vec::new();
        self.lost(|port| port.read(&mut characters, wait))?;
        for character in characters {
            if let Character::Byte(byte) = character {
                self.permission.take(byte);
            }
        }
        Ok(())
    }

    fn lost<T>(
        &mut self,
        call: impl FnOnce(&mut ProgramPort) -> Result<T, retrace_hal_serial::PortLost>,
    ) -> Result<T, NumberedError> {
        let sent = self.sent;
        call(&mut self.port).map_err(|lost| {
            let what = format!("{}: {} behind {sent} characters", lost.port, lost.why);
            let remedy = "the control has a part of the program: delete it there, connect the line, and send it again";
            NumberedError::new("E2309", what, remedy)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_sent_without_the_permission_of_each_handshake() {
        for (has_xon_xoff, has_rts_cts) in [(true, false), (false, true), (true, true), (false, false)] {
            let mut permission = Permission { has_xon_xoff, has_rts_cts, is_asked: false, pauses: 0 };
            assert_eq!(permission.allows(true), !has_xon_xoff);
            // with a parity bit, too
            permission.take(0x91);
            assert!(permission.allows(true));
            assert_eq!(permission.allows(false), !has_rts_cts);
            permission.take(b'x');
            assert!(permission.allows(true));
            permission.take(DC3);
            assert_eq!(permission.allows(true), !has_xon_xoff);
            assert_eq!(permission.pauses, u32::from(has_xon_xoff));
        }
    }
}
