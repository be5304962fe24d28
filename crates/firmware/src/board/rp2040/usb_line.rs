//! The USB line: a serial port of the class CDC-ACM on the chip's own controller (RP2040 data sheet, 4.1).
//!
//! Invariant: nothing here waits for the host. There is no interrupt: the main loop looks at the controller, which
//! refuses the host's packets until then, so no byte is lost. A packet is never full, so the host has it at once.

use super::registers::{
    TIMER_NOW, USB_ADDRESS, USB_BUFFERS_DONE, USB_CONTROL, USB_FRAME, USB_LINES, USB_POWER, USB_REFUSE,
    USB_SIE_CONTROL, USB_SIE_STATUS, usb_memory,
};
use retrace_firmware::rp2040::usb_frame::UsbFrame;
use retrace_firmware::usb_control::{ControlReply, DATA_ENDPOINT, PACKET, SerialText, TO_HOST, reply, serial_text};

/// Words of the controller's memory, and where things are in it: the control of endpoints, of their buffers, and the
/// buffers of endpoint 0, of data to the host, from the host, and of notifications.
const MEMORY_WORDS: usize = 1024;
const ENDPOINT_CONTROL: usize = 0x08;
const BUFFER_CONTROL: usize = 0x80;
const CONTROL_BUFFER: usize = 0x100;
const TO_HOST_BUFFER: usize = 0x180;
const FROM_HOST_BUFFER: usize = 0x1c0;
const NOTIFICATION_BUFFER: usize = 0x200;

/// In the control of a buffer: it has data, the kind of the packet, a refusal, and that the controller may use it.
const FULL: u32 = 1 << 15;
const DATA_1: u32 = 1 << 13;
const STALL: u32 = 1 << 11;
const AVAILABLE: u32 = 1 << 10;
const LENGTH: u32 = 0x3ff;
/// In the control of an endpoint: enabled, reports every buffer; and its kind.
const ENABLED: u32 = 1 << 31 | 1 << 29;
const BULK: u32 = 2 << 26;
const INTERRUPT: u32 = 3 << 26;
/// In the state of the serial interface: the host has reset the bus, or has sent a request.
const BUS_RESET: u32 = 1 << 19;
const REQUEST: u32 = 1 << 17;

/// A buffer: an endpoint and a direction.
#[derive(Clone, Copy)]
enum Buffer {
    ControlToHost,
    ControlFromHost,
    ToHost,
    FromHost,
}

impl Buffer {
    /// Number in the states and the controls of buffers.
    const fn number(self) -> usize {
        match self {
            Self::ControlToHost => 0,
            Self::ControlFromHost => 1,
            Self::ToHost => 2 * DATA_ENDPOINT as usize,
            Self::FromHost => 2 * DATA_ENDPOINT as usize + 1,
        }
    }

    fn control(self) -> super::registers::Register {
        usb_memory(BUFFER_CONTROL / 4 + self.number())
    }

    /// Gives the buffer to the controller. The last bit needs some cycles of the controller's clock after the others.
    fn give(self, control: u32) {
        self.control().write(control);
        cortex_m::asm::delay(12);
        self.control().write(control | AVAILABLE);
    }
}

/// The USB line.
pub(super) struct UsbLine {
    /// Serial number as a string descriptor.
    serial: Option<&'static SerialText>,
    /// Address that is valid after the acknowledgement of its request.
    address: Option<u8>,
    /// Bytes of an answer that were not sent yet.
    answer: &'static [u8],
    /// Whether the bytes of a request are awaited.
    awaits_data: bool,
    configured: bool,
    /// Kinds of the next packets.
    control_kind: u32,
    to_host_kind: u32,
    from_host_kind: u32,
    /// Whether the host has not fetched the last packet yet.
    is_sending: bool,
    /// Bytes for the next packet.
    sending: [u8; PACKET],
    sending_count: usize,
    frame: UsbFrame,
    /// Position and number of the received bytes in their buffer.
    received: (usize, usize),
}

impl UsbLine {
    /// Starts the controller and shows the host that there is a device. Once only.
    pub(super) fn start(serial: Option<u32>) -> Self {
        for word in 0..MEMORY_WORDS {
            usb_memory(word).write(0);
        }
        // to the pins, with the presence of the bus's power taken for granted
        USB_LINES.write(1 << 3 | 1);
        USB_POWER.write(1 << 3 | 1 << 2);
        USB_CONTROL.write(1);
        USB_SIE_CONTROL.write(1 << 29);
        USB_SIE_CONTROL.set_bits(1 << 16);
        let serial = serial.and_then(|number| cortex_m::singleton!(: SerialText = serial_text(number)));
        Self {
            serial: serial.map(|text| &*text),
            address: None,
            answer: &[],
            awaits_data: false,
            configured: false,
            control_kind: DATA_1,
            to_host_kind: 0,
            from_host_kind: 0,
            is_sending: false,
            sending: [0; PACKET],
            sending_count: 0,
            frame: UsbFrame::new(),
            received: (0, 0),
        }
    }

    /// Does what the controller has for the processor.
    pub(super) fn poll(&mut self) {
        let status = USB_SIE_STATUS.read();
        if status & BUS_RESET != 0 {
            USB_SIE_STATUS.write(BUS_RESET);
            USB_ADDRESS.write(0);
            USB_BUFFERS_DONE.write(u32::MAX);
            (self.address, self.answer, self.awaits_data) = (None, &[], false);
            self.unconfigure();
        }
        let done = USB_BUFFERS_DONE.read();
        if done != 0 {
            USB_BUFFERS_DONE.write(done);
            self.handle_done(|buffer| done >> buffer.number() & 1 == 1);
        }
        // behind the buffers, which belong to the request before
        if status & REQUEST != 0 {
            USB_SIE_STATUS.write(REQUEST);
            self.handle_request();
        }
        if self.may_offer() {
            self.send_packet();
        }
    }

    /// Whether a packet to the host may be offered now.
    fn may_offer(&mut self) -> bool {
        self.frame.may_offer(USB_FRAME.read(), TIMER_NOW.read())
    }

    /// Handles the buffers that the host has fetched or filled.
    fn handle_done(&mut self, is_done: impl Fn(Buffer) -> bool) {
        if is_done(Buffer::ControlToHost) {
            self.continue_answer();
        }
        if is_done(Buffer::ControlFromHost) && core::mem::take(&mut self.awaits_data) {
            self.acknowledge();
        }
        if is_done(Buffer::ToHost) {
            self.is_sending = false;
        }
        if is_done(Buffer::FromHost) && self.configured {
            self.received = (0, (Buffer::FromHost.control().read() & LENGTH) as usize);
            if self.is_silent() {
                self.await_bytes();
            }
        }
    }

    fn handle_request(&mut self) {
        // what is left of the request before is void; until this one has its answer the controller refuses all else
        Buffer::ControlToHost.control().write(0);
        Buffer::ControlFromHost.control().write(0);
        USB_BUFFERS_DONE.write(1 << Buffer::ControlToHost.number() | 1 << Buffer::ControlFromHost.number());
        let words = [usb_memory(0).read().to_le_bytes(), usb_memory(1).read().to_le_bytes()];
        let setup = core::array::from_fn(|n| words[n / 4][n % 4]);
        self.control_kind = DATA_1;
        (self.address, self.answer, self.awaits_data) = (None, &[], false);
        match reply(setup, self.serial) {
            ControlReply::Data(bytes) => {
                self.answer = bytes;
                // the host's acknowledgement
                Buffer::ControlFromHost.give(DATA_1);
                self.send_answer();
            }
            ControlReply::Address(address) => {
                self.address = Some(address);
                self.acknowledge();
            }
            ControlReply::Configure => {
                self.configure();
                self.acknowledge();
            }
            ControlReply::Unconfigure => {
                self.unconfigure();
                self.acknowledge();
            }
            ControlReply::Restart(endpoint) => {
                self.restart(endpoint);
                self.acknowledge();
            }
            ControlReply::Acknowledge => self.acknowledge(),
            ControlReply::Receive => {
                self.awaits_data = true;
                Buffer::ControlFromHost.give(DATA_1 | PACKET as u32);
            }
            ControlReply::Refuse => {
                USB_REFUSE.write(0b11);
                Buffer::ControlToHost.control().write(STALL);
                Buffer::ControlFromHost.control().write(STALL);
            }
        }
    }

    /// Sends an empty packet, which acknowledges a request.
    fn acknowledge(&mut self) {
        Buffer::ControlToHost.give(FULL | DATA_1);
    }

    /// Sends the next packet of an answer.
    fn send_answer(&mut self) {
        let (packet, rest) = self.answer.split_at(self.answer.len().min(PACKET));
        self.answer = rest;
        write_bytes(CONTROL_BUFFER, packet);
        Buffer::ControlToHost.give(FULL | self.control_kind | packet.len() as u32);
        self.control_kind ^= DATA_1;
    }

    fn continue_answer(&mut self) {
        if let Some(address) = self.address.take() {
            USB_ADDRESS.write(u32::from(address));
        } else if !self.answer.is_empty() {
            self.send_answer();
        }
    }

    /// Begins both endpoints of the line.
    fn configure(&mut self) {
        let data = ENDPOINT_CONTROL / 4 + 2 * (DATA_ENDPOINT as usize - 1);
        usb_memory(data).write(ENABLED | BULK | TO_HOST_BUFFER as u32);
        usb_memory(data + 1).write(ENABLED | BULK | FROM_HOST_BUFFER as u32);
        usb_memory(data + 2).write(ENABLED | INTERRUPT | NOTIFICATION_BUFFER as u32);
        self.configured = true;
        self.restart(TO_HOST | DATA_ENDPOINT);
        self.restart(DATA_ENDPOINT);
    }

    /// Ends both endpoints of the line.
    fn unconfigure(&mut self) {
        self.configured = false;
        Buffer::ToHost.control().write(0);
        Buffer::FromHost.control().write(0);
        (self.is_sending, self.sending_count, self.received) = (false, 0, (0, 0));
    }

    /// Begins the packets of one endpoint of the line again. What is lost of the line's bytes with it, the line's
    /// checksums detect.
    fn restart(&mut self, endpoint: u8) {
        if !self.configured {
            return;
        }
        if endpoint == TO_HOST | DATA_ENDPOINT {
            Buffer::ToHost.control().write(0);
            (self.to_host_kind, self.is_sending) = (0, false);
        } else if endpoint == DATA_ENDPOINT {
            (self.from_host_kind, self.received) = (0, (0, 0));
            self.await_bytes();
        }
    }

    /// Lets the host send a packet.
    fn await_bytes(&mut self) {
        Buffer::FromHost.give(self.from_host_kind | PACKET as u32);
        self.from_host_kind ^= DATA_1;
    }

    /// Sends the bytes that are there, once the host has fetched the last packet.
    fn send_packet(&mut self) {
        if !self.configured || self.is_sending || self.sending_count == 0 {
            return;
        }
        write_bytes(TO_HOST_BUFFER, &self.sending[..self.sending_count]);
        // copying a packet takes some microseconds, and so does an interrupt of UART0
        cortex_m::interrupt::free(|_| {
            if self.may_offer() {
                Buffer::ToHost.give(FULL | self.to_host_kind | self.sending_count as u32);
                self.to_host_kind ^= DATA_1;
                (self.is_sending, self.sending_count) = (true, 0);
            }
        });
    }

    /// Whether no received byte is waiting.
    pub(super) fn is_silent(&self) -> bool {
        self.received.0 == self.received.1
    }

    /// Returns the next received byte.
    pub(super) fn receive(&mut self) -> Option<u8> {
        if self.is_silent() {
            return None;
        }
        let at = FROM_HOST_BUFFER + self.received.0;
        let byte = usb_memory(at / 4).read().to_le_bytes()[at % 4];
        self.received.0 += 1;
        if self.is_silent() {
            self.await_bytes();
        }
        Some(byte)
    }

    /// Whether a byte can be sent: never a full packet, after which a host would wait for the next one.
    pub(super) fn can_send(&self) -> bool {
        self.configured && self.sending_count < PACKET - 1
    }

    /// Sends a byte with the next packet.
    pub(super) fn send(&mut self, byte: u8) {
        if self.can_send() {
            self.sending[self.sending_count] = byte;
            self.sending_count += 1;
        }
    }
}

/// Writes bytes to the controller's memory, word by word, from an aligned position on.
fn write_bytes(at: usize, bytes: &[u8]) {
    for (n, chunk) in bytes.chunks(4).enumerate() {
        let mut word = [0; 4];
        word[..chunk.len()].copy_from_slice(chunk);
        usb_memory(at / 4 + n).write(u32::from_le_bytes(word));
    }
}
