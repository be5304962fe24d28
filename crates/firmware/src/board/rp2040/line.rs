//! The card's line: the USB line or UART0, whichever the host uses.
//!
//! Invariant: answers go to the line from which the last byte was taken.

use super::registers::TIMER_NOW;
use super::serial;
use super::usb_line::UsbLine;
use retrace_firmware::rp2040::line_selector::{LineKind, LineSelector};

/// Both lines.
pub(super) struct Line {
    usb: UsbLine,
    selector: LineSelector,
}

impl Line {
    /// Starts both lines. `serial`: the card's serial number, by which a computer tells two cards from each other.
    pub(super) fn start(serial: Option<u32>) -> Self {
        serial::start();
        Self { usb: UsbLine::start(serial), selector: LineSelector::new() }
    }

    /// Whether neither line has a byte.
    pub(super) fn is_silent(&mut self) -> bool {
        self.usb.poll();
        serial::is_silent() && self.usb.is_silent()
    }

    /// Returns the next byte of the line in use.
    pub(super) fn receive(&mut self) -> Option<u8> {
        self.usb.poll();
        match self.selector.select(!serial::is_silent(), !self.usb.is_silent(), TIMER_NOW.read())? {
            LineKind::Uart => serial::receive(),
            LineKind::Usb => self.usb.receive(),
        }
    }

    /// Whether the line in use can accept a byte.
    pub(super) fn can_send(&self) -> bool {
        match self.selector.used() {
            Some(LineKind::Uart) => serial::can_send(),
            Some(LineKind::Usb) => self.usb.can_send(),
            None => false,
        }
    }

    /// Passes a byte to the line in use, which can accept one if [`Line::can_send`] returns true.
    pub(super) fn send(&mut self, byte: u8) {
        match self.selector.used() {
            Some(LineKind::Uart) => serial::send(byte),
            Some(LineKind::Usb) => self.usb.send(byte),
            None => {}
        }
    }
}
