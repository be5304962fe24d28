//! The card's line: the USB line or UART0, whichever the host uses; and the voltage module at UART0 while it is not.
//!
//! Invariant: answers go to the line in use. A byte of UART0 is either the card's or the module's.

use super::registers::TIMER_NOW;
use super::serial;
use super::usb_line::UsbLine;
use retrace_firmware::line_selector::{LineKind, LineSelector, NextByte};
use retrace_firmware::rp2040::voltage_module::VoltageModule;

/// Both lines.
pub(super) struct Line {
    usb: UsbLine,
    selector: LineSelector,
    module: VoltageModule,
}

impl Line {
    /// Starts both lines. `serial`: the card's serial number, by which a computer tells two cards from each other.
    pub(super) fn start(serial: Option<u32>) -> Self {
        serial::start();
        Self { usb: UsbLine::start(serial), selector: LineSelector::new(), module: VoltageModule::new() }
    }

    /// Whether neither line has a byte.
    pub(super) fn is_silent(&mut self) -> bool {
        self.usb.poll();
        serial::is_silent() && self.usb.is_silent()
    }

    /// Returns the next byte of the line in use.
    pub(super) fn receive(&mut self) -> Option<u8> {
        self.usb.poll();
        let now_us = TIMER_NOW.read();
        match self.selector.select(!serial::is_silent(), !self.usb.is_silent(), now_us)? {
            NextByte::FrameEnd => Some(0),
            NextByte::Of(LineKind::Uart) => {
                let byte = serial::receive()?;
                self.selector.record_uart_byte(byte, now_us);
                Some(byte)
            }
            NextByte::Of(LineKind::Usb) => self.usb.receive(),
        }
    }

    /// Returns the reading of the voltage module at UART0, in units of 0.01 V, once in a control period; none where the
    /// host is not at USB.
    pub(super) fn module_reading(&mut self) -> Option<u16> {
        let now_us = TIMER_NOW.read();
        if !self.selector.is_uart_free(now_us) {
            self.module = VoltageModule::new();
            return None;
        }
        self.module.read(core::iter::from_fn(serial::receive), now_us)
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
