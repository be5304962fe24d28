//! The card's line: the USB line or USART1, whichever the host uses.
//!
//! Invariant: answers go to the line in use. Without a crystal there is no USB line: the internal oscillator is too
//! inaccurate for it.

use retrace_firmware::line_selector::{LineKind, LineSelector, NextByte};
use retrace_firmware::stm32f4::usb_otg::UsbOtg;
use retrace_firmware::usb_control::{SerialText, serial_text};

use super::registers::OtgFs;
use super::{microseconds, ports, serial};

/// Both lines.
pub(super) struct Line {
    usb: Option<UsbOtg<OtgFs>>,
    selector: LineSelector,
}

impl Line {
    /// Starts both lines. `has_crystal`: the clock is that of a crystal; `serial`: the card's serial number, by which a
    /// computer tells two cards from each other.
    pub(super) fn start(has_crystal: bool, serial: u32) -> Self {
        serial::start();
        microseconds::start();
        let usb = has_crystal.then(|| {
            ports::connect_usb();
            let text = cortex_m::singleton!(: SerialText = serial_text(serial));
            UsbOtg::start(OtgFs::start(), text.map(|text| &*text))
        });
        Self { usb, selector: LineSelector::new() }
    }

    /// Looks at the USB line, and returns whether it has no byte.
    fn poll_usb(&mut self) -> bool {
        self.usb.as_mut().is_none_or(|usb| {
            usb.poll();
            usb.is_silent()
        })
    }

    /// Whether neither line has a byte.
    pub(super) fn is_silent(&mut self) -> bool {
        self.poll_usb() && serial::is_silent()
    }

    /// Returns the next byte of the line in use.
    pub(super) fn receive(&mut self) -> Option<u8> {
        let usb_is_silent = self.poll_usb();
        let now_us = microseconds::now();
        match self.selector.select(!serial::is_silent(), !usb_is_silent, now_us)? {
            NextByte::FrameEnd => Some(0),
            NextByte::Of(LineKind::Uart) => {
                let byte = serial::receive()?;
                self.selector.record_uart_byte(byte, now_us);
                Some(byte)
            }
            NextByte::Of(LineKind::Usb) => self.usb.as_mut()?.receive(),
        }
    }

    /// Whether the line in use can accept a byte.
    pub(super) fn can_send(&self) -> bool {
        match self.selector.used() {
            Some(LineKind::Uart) => serial::can_send(),
            Some(LineKind::Usb) => self.usb.as_ref().is_some_and(UsbOtg::can_send),
            None => false,
        }
    }

    /// Passes a byte to the line in use, which can accept one if [`Line::can_send`] returns true.
    pub(super) fn send(&mut self, byte: u8) {
        match (self.selector.used(), &mut self.usb) {
            (Some(LineKind::Uart), _) => serial::send(byte),
            (Some(LineKind::Usb), Some(usb)) => usb.send(byte),
            _ => {}
        }
    }
}
