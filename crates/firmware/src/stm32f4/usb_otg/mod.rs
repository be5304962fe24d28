//! The USB line of an STM32F4: a serial port of the class CDC-ACM on the chip's controller OTG FS (RM0090, 34.17;
//! RM0368 and RM0383, 22.17).
//!
//! Invariant: nothing here waits for the host; a wait for the controller is bounded. There is no interrupt: the main
//! loop looks at the controller, which refuses the host's packets until then, so no byte is lost. A packet is never
//! full, so the host has it at once. A reset of the bus drops what was under way; the line's checksums detect it.

#[cfg(test)]
mod model;
pub mod registers;
#[cfg(test)]
mod tests;

use crate::usb_control::{
    ControlReply, DATA_ENDPOINT, NOTIFICATION_ENDPOINT, NOTIFICATION_PACKET, PACKET, SerialText, TO_HOST, reply,
};
use registers::Direction::{In, Out};
use registers::{
    ACTIVE, ADDRESS_AT, ANSWER_TIME, BULK, BUS_IDLE, BUS_RESET, CLEAR_NAK, COMPLETED, CORE_RESET, DCFG, DCTL,
    DEVICE_MODE, DIEPTXF0, DISABLE, DISABLED, ENABLE, EVERY_QUEUE, FLUSH_RECEIVED, FLUSH_TO_SEND, FULL_SPEED,
    FULL_SPEED_PHY, GCCFG, GINTSTS, GRSTCTL, GRXFSIZ, GRXSTSP, GUSBCFG, HIDDEN, HOST_MODE, INTERRUPT, NAK_EFFECTIVE,
    NO_VBUS_SENSING, ONE_PACKET, OUT_COMPLETED, OUT_PACKET, OtgRegisters, PCGCCTL, POWERED, QUEUE_AT, RECEIVED,
    SET_DATA_0, SET_NAK, SETUP_COMPLETED, SETUP_PACKET, SPEED_KNOWN, STALL, THREE_SETUPS, control, dieptxf, interrupts,
    queue, transfer,
};

/// Words of the queues: of what was received, and of the endpoints 0, 1 and 2. The controller has 320.
const RECEIVED_WORDS: u32 = 128;
const QUEUE_WORDS: [u32; 3] = [32, 32, 16];
/// Reads until the controller has done what takes some of its cycles, and until it is in device mode: 25 ms.
const PATIENCE: u32 = 400;
const MODE_PATIENCE: u32 = 1_000_000;
/// Most entries that are taken at a look: the bytes of a request, of a packet, and their ends.
const ENTRIES_AT_A_LOOK: usize = 8;
/// The endpoint of the line's bytes.
const DATA: u32 = DATA_ENDPOINT as u32;

/// The USB line.
pub struct UsbOtg<R> {
    registers: R,
    /// Serial number as a string descriptor.
    serial: Option<&'static SerialText>,
    /// The last request.
    setup: [u8; 8],
    /// Bytes of an answer that were not sent yet.
    answer: &'static [u8],
    /// Whether the bytes of a request are awaited.
    awaits_data: bool,
    configured: bool,
    /// Whether the host has not fetched the last packet yet.
    is_sending: bool,
    /// Bytes for the next packet.
    sending: [u8; PACKET],
    sending_count: usize,
    /// Bytes of the last packet, and which of them are waiting.
    received: [u8; PACKET],
    next: usize,
    count: usize,
    /// Whether the host may send no packet: the last one has ended.
    has_ended: bool,
}

impl<R: OtgRegisters> UsbOtg<R> {
    /// Starts the controller, whose clocks and pins are there, and shows the host that there is a device.
    pub fn start(registers: R, serial: Option<&'static SerialText>) -> Self {
        let line = Self {
            registers,
            serial,
            setup: [0; 8],
            answer: &[],
            awaits_data: false,
            configured: false,
            is_sending: false,
            sending: [0; PACKET],
            sending_count: 0,
            received: [0; PACKET],
            next: 0,
            count: 0,
            has_ended: false,
        };
        line.await_bits(GRSTCTL, BUS_IDLE, BUS_IDLE);
        line.registers.write(GRSTCTL, CORE_RESET);
        line.await_bits(GRSTCTL, CORE_RESET | BUS_IDLE, BUS_IDLE);
        line.registers.write(GUSBCFG, DEVICE_MODE | FULL_SPEED_PHY | ANSWER_TIME);
        let _ = (0..MODE_PATIENCE).any(|_| line.registers.read(GINTSTS) & HOST_MODE == 0);
        line.registers.write(GCCFG, POWERED | NO_VBUS_SENSING);
        line.registers.write(PCGCCTL, 0);
        line.change(DCTL, 0, HIDDEN);
        line.registers.write(DCFG, FULL_SPEED);
        line.prepare_queues();
        line.registers.write(GINTSTS, BUS_RESET | SPEED_KNOWN);
        line.change(DCTL, HIDDEN, 0);
        line
    }

    /// Looks at the controller. To be called often: the host waits for it.
    pub fn poll(&mut self) {
        let status = self.registers.read(GINTSTS);
        if status & BUS_RESET != 0 {
            self.registers.write(GINTSTS, BUS_RESET);
            self.handle_bus_reset();
        }
        if status & SPEED_KNOWN != 0 {
            self.registers.write(GINTSTS, SPEED_KNOWN);
            // packets of 64 bytes, which is 0 in these registers
            self.registers.write(control(In, 0), SET_NAK);
            self.await_control_packet();
        }
        // before what was received: an answer belongs to the request before
        if self.has_completed(0) && !self.answer.is_empty() {
            self.send_answer();
        }
        if self.is_sending && self.has_completed(DATA) {
            self.is_sending = false;
        }
        for _ in 0..ENTRIES_AT_A_LOOK {
            if self.registers.read(GINTSTS) & RECEIVED == 0 {
                break;
            }
            self.handle_entry();
        }
        if self.configured && self.has_ended && self.is_silent() {
            self.has_ended = false;
            // of a configuration before this one a packet may still be awaited
            if self.registers.read(control(Out, DATA)) & ENABLE == 0 {
                self.registers.write(transfer(Out, DATA), ONE_PACKET | PACKET as u32);
            }
            self.change(control(Out, DATA), 0, ENABLE | CLEAR_NAK);
        }
        self.send_packet();
    }

    /// Whether no received byte is waiting.
    pub fn is_silent(&self) -> bool {
        self.next == self.count
    }

    /// Returns the next received byte.
    pub fn receive(&mut self) -> Option<u8> {
        let byte = *self.received[..self.count].get(self.next)?;
        self.next += 1;
        Some(byte)
    }

    /// Whether a byte can be sent: never a full packet, after which a host would wait for the next one.
    pub fn can_send(&self) -> bool {
        self.configured && self.sending_count < PACKET - 1
    }

    /// Sends a byte with the next packet.
    pub fn send(&mut self, byte: u8) {
        if self.can_send() {
            self.sending[self.sending_count] = byte;
            self.sending_count += 1;
        }
    }

    /// Clears and then sets bits of a register.
    fn change(&self, offset: u32, clear: u32, set: u32) {
        self.registers.write(offset, self.registers.read(offset) & !clear | set);
    }

    /// Waits, within bounds, until these bits of a register are so.
    fn await_bits(&self, offset: u32, bits: u32, are: u32) {
        let _ = (0..PATIENCE).any(|_| self.registers.read(offset) & bits == are);
    }

    /// Divides the controller's memory into queues, and empties them.
    fn prepare_queues(&self) {
        self.registers.write(GRXFSIZ, RECEIVED_WORDS);
        let mut begin = RECEIVED_WORDS;
        for (endpoint, words) in (0u32..).zip(QUEUE_WORDS) {
            let offset = if endpoint == 0 { DIEPTXF0 } else { dieptxf(endpoint) };
            self.registers.write(offset, words << 16 | begin);
            begin += words;
        }
        self.flush(EVERY_QUEUE);
        self.registers.write(GRSTCTL, FLUSH_RECEIVED);
        self.await_bits(GRSTCTL, FLUSH_RECEIVED, 0);
    }

    /// Empties a queue of what is to be sent.
    fn flush(&self, number: u32) {
        self.registers.write(GRSTCTL, FLUSH_TO_SEND | number << 6);
        self.await_bits(GRSTCTL, FLUSH_TO_SEND, 0);
    }

    fn handle_bus_reset(&mut self) {
        (self.answer, self.awaits_data) = (&[], false);
        self.stop_sending(0);
        self.unconfigure();
        self.prepare_queues();
        self.change(DCFG, 0x7f << ADDRESS_AT, 0);
        self.change(transfer(Out, 0), 0, THREE_SETUPS);
    }

    /// Whether the host has fetched the packet of this endpoint; once.
    fn has_completed(&self, endpoint: u32) -> bool {
        let has_completed = self.registers.read(interrupts(In, endpoint)) & COMPLETED != 0;
        if has_completed {
            self.registers.write(interrupts(In, endpoint), COMPLETED);
        }
        has_completed
    }

    /// Takes an entry of what was received, with its bytes.
    fn handle_entry(&mut self) {
        let entry = self.registers.read(GRXSTSP);
        let (endpoint, count, kind) = (entry & 0xf, (entry >> 4 & 0x7ff) as usize, entry >> 17 & 0xf);
        let mut bytes = [0; PACKET];
        for at in (0..count).step_by(4) {
            let word = self.registers.read(queue(0)).to_le_bytes();
            // more than a packet is never sent by a host
            bytes.iter_mut().skip(at).zip(word).for_each(|(byte, new)| *byte = new);
        }
        match (kind, endpoint) {
            (SETUP_PACKET, 0) => self.setup.copy_from_slice(&bytes[..8]),
            (SETUP_COMPLETED, 0) => self.handle_request(),
            (OUT_COMPLETED, 0) => {
                // a request has done so, too; drivers of this controller keep the endpoint enabled at any time
                self.await_control_packet();
                if core::mem::take(&mut self.awaits_data) {
                    self.acknowledge();
                }
            }
            (OUT_PACKET, DATA) => (self.received, self.next, self.count) = (bytes, 0, count.min(PACKET)),
            (OUT_COMPLETED, DATA) => self.has_ended = true,
            _ => {}
        }
    }

    fn handle_request(&mut self) {
        // what is left of the request before is void
        self.stop_sending(0);
        (self.answer, self.awaits_data) = (&[], false);
        let reply = reply(self.setup, self.serial);
        if reply != ControlReply::Refuse {
            // the host's acknowledgement, or its bytes
            self.await_control_packet();
        }
        match reply {
            ControlReply::Data(bytes) => {
                self.answer = bytes;
                self.send_answer();
            }
            ControlReply::Address(address) => {
                // the controller has the old one for the acknowledgement
                self.change(DCFG, 0x7f << ADDRESS_AT, u32::from(address) << ADDRESS_AT);
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
            ControlReply::Receive => self.awaits_data = true,
            ControlReply::Refuse => {
                // until the next request, which ends it by itself
                self.change(transfer(Out, 0), 0, THREE_SETUPS);
                self.change(control(In, 0), 0, STALL);
                self.change(control(Out, 0), 0, STALL);
            }
        }
    }

    /// Lets the host send a packet to endpoint 0.
    fn await_control_packet(&self) {
        if self.registers.read(control(Out, 0)) & ENABLE == 0 {
            self.registers.write(transfer(Out, 0), ONE_PACKET | PACKET as u32);
        }
        self.change(transfer(Out, 0), 0, THREE_SETUPS);
        self.change(control(Out, 0), 0, ENABLE | CLEAR_NAK);
    }

    /// Sends an empty packet, which acknowledges a request.
    fn acknowledge(&self) {
        self.send_from(0, &[]);
    }

    /// Sends the next packet of an answer.
    fn send_answer(&mut self) {
        let (packet, rest) = self.answer.split_at(self.answer.len().min(PACKET));
        self.answer = rest;
        self.send_from(0, packet);
    }

    /// Sends a packet from an endpoint that has none.
    fn send_from(&self, endpoint: u32, bytes: &[u8]) {
        self.registers.write(transfer(In, endpoint), ONE_PACKET | bytes.len() as u32);
        self.change(control(In, endpoint), 0, ENABLE | CLEAR_NAK);
        for chunk in bytes.chunks(4) {
            let mut word = [0; 4];
            word[..chunk.len()].copy_from_slice(chunk);
            self.registers.write(queue(endpoint), u32::from_le_bytes(word));
        }
    }

    /// Takes back the packet of an endpoint that the host has not fetched.
    fn stop_sending(&self, endpoint: u32) {
        if self.registers.read(control(In, endpoint)) & ENABLE != 0 {
            self.change(control(In, endpoint), 0, SET_NAK);
            self.await_bits(interrupts(In, endpoint), NAK_EFFECTIVE, NAK_EFFECTIVE);
            self.change(control(In, endpoint), 0, DISABLE | SET_NAK);
            self.await_bits(interrupts(In, endpoint), DISABLED, DISABLED);
        }
        self.registers.write(interrupts(In, endpoint), COMPLETED | DISABLED);
        self.flush(endpoint);
    }

    /// Begins the endpoints of the line.
    fn configure(&mut self) {
        self.unconfigure();
        let begin = ACTIVE | SET_NAK | SET_DATA_0;
        self.registers.write(control(In, DATA), begin | BULK | DATA << QUEUE_AT | PACKET as u32);
        self.registers.write(control(Out, DATA), begin | BULK | PACKET as u32);
        let number = u32::from(NOTIFICATION_ENDPOINT);
        let notifications = begin | INTERRUPT | number << QUEUE_AT | NOTIFICATION_PACKET as u32;
        self.registers.write(control(In, number), notifications);
        (self.configured, self.has_ended) = (true, true);
    }

    /// Ends the endpoints of the line.
    fn unconfigure(&mut self) {
        self.stop_sending(DATA);
        self.change(control(In, DATA), ACTIVE, SET_NAK);
        self.change(control(In, u32::from(NOTIFICATION_ENDPOINT)), ACTIVE, SET_NAK);
        self.change(control(Out, DATA), ACTIVE, SET_NAK);
        self.configured = false;
        (self.is_sending, self.sending_count, self.next, self.count) = (false, 0, 0, 0);
    }

    /// Begins the packets of one endpoint of the line again.
    fn restart(&self, endpoint: u8) {
        let direction = if endpoint & TO_HOST == 0 { Out } else { In };
        if self.configured && endpoint & !TO_HOST == DATA_ENDPOINT {
            self.change(control(direction, DATA), 0, SET_DATA_0);
        }
    }

    /// Sends the bytes that are there, once the host has fetched the last packet.
    fn send_packet(&mut self) {
        if !self.configured || self.is_sending || self.sending_count == 0 {
            return;
        }
        self.send_from(DATA, &self.sending[..self.sending_count]);
        (self.is_sending, self.sending_count) = (true, 0);
    }
}
