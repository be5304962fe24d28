//! A model of the controller OTG FS as a device in slave mode, and of the bus at it (RM0090, 34.16 and 34.17).
//!
//! Invariant: it is written from the reference manual, not from the driver. What the manual forbids is a panic here: an
//! endpoint that is programmed while it is enabled, words that are left in a queue, queues that overlap.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

use super::registers::*;

/// Words of the memory of all queues.
const MEMORY_WORDS: u32 = 320;
/// Kinds of packets.
pub(super) const DATA_0: bool = false;
pub(super) const DATA_1: bool = true;

/// Answer to a packet of the host.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Handshake {
    Ack,
    Nak,
    Stall,
    /// A packet to the host, of this kind.
    Data(bool, Vec<u8>),
    /// Nobody has this address, or the endpoint does not exist.
    Silence,
}

#[derive(Clone, Debug, Default)]
struct Endpoint {
    /// The bits of its control that are read back.
    control: u32,
    transfer: u32,
    interrupts: u32,
    is_data_1: bool,
    /// Bytes in its queue, of an endpoint to the host.
    queue: VecDeque<u8>,
    /// Words that were written of the packet.
    written: u32,
}

#[derive(Clone, Debug)]
struct Entry {
    status: u32,
    bytes: Vec<u8>,
}

#[derive(Clone, Debug)]
struct Core {
    gusbcfg: u32,
    gccfg: u32,
    gintsts: u32,
    grxfsiz: u32,
    /// Begin and words of the queues to the host.
    areas: [u32; 4],
    dcfg: u32,
    /// The address that counts: a new one is programmed in front of the acknowledgement of its request, and counts
    /// behind it.
    address: u32,
    dctl: u32,
    in_endpoints: [Endpoint; 4],
    out_endpoints: [Endpoint; 4],
    received: VecDeque<Entry>,
    /// Words of the entry that was taken.
    words: VecDeque<u32>,
    /// Whether the end of the request has to be put in front of the next token.
    request_is_open: bool,
    /// Reads of the mode until it is that of a device.
    until_device_mode: u32,
}

/// The controller: a handle to it is the driver's, another one the host's.
#[derive(Clone)]
pub(super) struct Otg(Rc<RefCell<Core>>);

impl Otg {
    pub(super) fn new() -> Self {
        Self(Rc::new(RefCell::new(Core {
            gusbcfg: 0,
            gccfg: 0,
            gintsts: 0,
            grxfsiz: 0x200,
            areas: [0; 4],
            dcfg: 0,
            address: 0,
            dctl: HIDDEN,
            in_endpoints: Default::default(),
            out_endpoints: Default::default(),
            received: VecDeque::new(),
            words: VecDeque::new(),
            request_is_open: false,
            until_device_mode: 1000,
        })))
    }

    /// Whether a host sees a device of full speed.
    pub(super) fn is_visible(&self) -> bool {
        let core = self.0.borrow();
        let is_powered = core.gccfg & (POWERED | NO_VBUS_SENSING) == POWERED | NO_VBUS_SENSING;
        is_powered && core.dctl & HIDDEN == 0 && core.dcfg & 0b11 == FULL_SPEED && core.gusbcfg & DEVICE_MODE != 0
    }

    /// The host resets the bus.
    pub(super) fn reset_bus(&self) {
        let mut core = self.0.borrow_mut();
        core.gintsts |= BUS_RESET | SPEED_KNOWN;
        core.request_is_open = false;
        for number in 1..4 {
            core.in_endpoints[number].control &= !ACTIVE;
            core.out_endpoints[number].control &= !ACTIVE;
        }
    }

    /// The host sends a request.
    pub(super) fn send_setup(&self, address: u32, request: [u8; 8]) -> Handshake {
        let mut core = self.0.borrow_mut();
        if !core.is_at(address) {
            return Handshake::Silence;
        }
        assert!(core.out_endpoints[0].transfer >> 29 > 0, "no request is awaited");
        core.out_endpoints[0].transfer -= 1 << 29;
        // whatever is in its way
        core.push(0, SETUP_PACKET, &request);
        core.request_is_open = true;
        core.in_endpoints[0].control = core.in_endpoints[0].control & !STALL | ANSWERS_NAK;
        core.out_endpoints[0].control = core.out_endpoints[0].control & !STALL | ANSWERS_NAK;
        (core.in_endpoints[0].is_data_1, core.out_endpoints[0].is_data_1) = (true, true);
        Handshake::Ack
    }

    /// The host asks for a packet. With `acknowledges` it has received it.
    pub(super) fn fetch(&self, address: u32, number: usize, acknowledges: bool) -> Handshake {
        let mut core = self.0.borrow_mut();
        if !core.is_at(address) {
            return Handshake::Silence;
        }
        core.end_request(number);
        let endpoint = &mut core.in_endpoints[number];
        if number > 0 && endpoint.control & ACTIVE == 0 {
            return Handshake::Silence;
        }
        if endpoint.control & STALL != 0 {
            return Handshake::Stall;
        }
        let length = (endpoint.transfer & 0x7f) as usize;
        let is_ready = endpoint.control & ENABLE != 0 && endpoint.control & ANSWERS_NAK == 0;
        if !is_ready || endpoint.queue.len() < length {
            return Handshake::Nak;
        }
        let packet: Vec<u8> = endpoint.queue.iter().take(length).copied().collect();
        let answer = Handshake::Data(endpoint.is_data_1, packet);
        if acknowledges {
            // whole words were written
            endpoint.queue.clear();
            endpoint.written = 0;
            endpoint.transfer = 0;
            endpoint.control = endpoint.control & !ENABLE | ANSWERS_NAK;
            endpoint.interrupts |= COMPLETED;
            endpoint.is_data_1 ^= true;
            core.address = core.dcfg >> ADDRESS_AT & 0x7f;
        }
        answer
    }

    /// The host sends a packet of this kind.
    pub(super) fn send(&self, address: u32, number: usize, is_data_1: bool, bytes: &[u8]) -> Handshake {
        let mut core = self.0.borrow_mut();
        if !core.is_at(address) {
            return Handshake::Silence;
        }
        core.end_request(number);
        let has_room = core.received_words() + 2 + bytes.len().div_ceil(4) as u32 <= core.grxfsiz;
        let endpoint = &mut core.out_endpoints[number];
        if number > 0 && endpoint.control & ACTIVE == 0 {
            return Handshake::Silence;
        }
        if endpoint.control & STALL != 0 {
            return Handshake::Stall;
        }
        if endpoint.is_data_1 != is_data_1 {
            // sent once more, since the host has not seen the last acknowledgement
            return Handshake::Ack;
        }
        if endpoint.control & ENABLE == 0 || endpoint.control & ANSWERS_NAK != 0 || !has_room {
            return Handshake::Nak;
        }
        let (packets, room) = (endpoint.transfer >> 19 & 1, (endpoint.transfer & 0x7f) as usize);
        assert!(packets == 1 && bytes.len() <= room, "more than the transfer has room for");
        endpoint.transfer = endpoint.transfer & 3 << 29 | (room - bytes.len()) as u32;
        endpoint.control = endpoint.control & !ENABLE | ANSWERS_NAK;
        endpoint.is_data_1 ^= true;
        core.push(number as u32, OUT_PACKET, bytes);
        core.push(number as u32, OUT_COMPLETED, &[]);
        Handshake::Ack
    }
}

impl Core {
    fn is_at(&self, address: u32) -> bool {
        self.dctl & HIDDEN == 0 && self.address == address
    }

    /// Puts the end of a request in front of the token behind it, which disables the endpoint.
    fn end_request(&mut self, number: usize) {
        if number == 0 && std::mem::take(&mut self.request_is_open) {
            self.out_endpoints[0].control &= !ENABLE;
            self.push(0, SETUP_COMPLETED, &[]);
        }
    }

    fn push(&mut self, endpoint: u32, kind: u32, bytes: &[u8]) {
        let status = endpoint | (bytes.len() as u32) << 4 | kind << 17;
        self.received.push_back(Entry { status, bytes: bytes.to_vec() });
        assert!(self.received_words() <= self.grxfsiz, "the queue of what was received overflows");
    }

    fn received_words(&self) -> u32 {
        self.received.iter().map(|entry| 1 + entry.bytes.len().div_ceil(4) as u32).sum()
    }

    /// The words of the queue of an endpoint; no two queues overlap.
    fn queue_words(&self, number: usize) -> u32 {
        let mut end = self.grxfsiz;
        for area in self.areas.iter().filter(|&&area| area != 0) {
            assert!(area & 0xffff >= end && area >> 16 >= 16, "queues overlap, or are too short");
            end = (area & 0xffff) + (area >> 16);
        }
        assert!(end <= MEMORY_WORDS, "queues of {end} words");
        self.areas[number] >> 16
    }

    fn endpoint(&mut self, offset: u32) -> (bool, &mut Endpoint) {
        let (is_in, number) = (offset < 0xb00, (offset >> 5 & 7) as usize);
        (is_in, if is_in { &mut self.in_endpoints[number] } else { &mut self.out_endpoints[number] })
    }

    fn write_control(&mut self, offset: u32, value: u32) {
        let (is_in, endpoint) = self.endpoint(offset);
        const KEPT: u32 = 0x7ff | ACTIVE | 0b11 << 18 | STALL | 0xf << QUEUE_AT;
        let (kept, old) = (value & KEPT, endpoint.control);
        let mut control = old & (ANSWERS_NAK | ENABLE) | kept;
        if value & SET_NAK != 0 {
            control |= ANSWERS_NAK;
            endpoint.interrupts |= if is_in { NAK_EFFECTIVE } else { 0 };
        }
        if value & CLEAR_NAK != 0 {
            control &= !ANSWERS_NAK;
            endpoint.interrupts &= !NAK_EFFECTIVE;
        }
        if value & SET_DATA_0 != 0 {
            endpoint.is_data_1 = false;
        }
        if value & DISABLE != 0 {
            assert!(is_in && old & (ENABLE | ANSWERS_NAK) == ENABLE | ANSWERS_NAK, "it is disabled behind its NAK");
            endpoint.interrupts |= DISABLED;
            control &= !ENABLE;
        } else if value & ENABLE != 0 {
            control |= ENABLE;
        }
        endpoint.control = control;
    }

    fn write_queue(&mut self, number: usize, value: u32) {
        let room = self.queue_words(number);
        let endpoint = &mut self.in_endpoints[number];
        assert!(endpoint.control & ENABLE != 0, "words for an endpoint that is not enabled");
        endpoint.written += 1;
        assert!(endpoint.written <= (endpoint.transfer & 0x7f).div_ceil(4), "more words than the packet has");
        endpoint.queue.extend(value.to_le_bytes());
        assert!(endpoint.queue.len() as u32 <= 4 * room, "a queue to the host overflows");
    }

    fn flush(&mut self, value: u32) {
        if value & FLUSH_RECEIVED != 0 {
            self.received.clear();
            self.words.clear();
        }
        if value & FLUSH_TO_SEND != 0 {
            let which = value >> 6 & 0x1f;
            for (number, endpoint) in (0..).zip(&mut self.in_endpoints) {
                if which == EVERY_QUEUE || which == number {
                    endpoint.queue.clear();
                    endpoint.written = 0;
                }
            }
        }
    }
}

impl OtgRegisters for Otg {
    fn read(&self, offset: u32) -> u32 {
        let mut core = self.0.borrow_mut();
        match offset {
            GRSTCTL => BUS_IDLE,
            GINTSTS => {
                core.until_device_mode = core.until_device_mode.saturating_sub(1);
                let is_host = u32::from(core.until_device_mode > 0);
                let has_received = if core.received.is_empty() { 0 } else { RECEIVED };
                core.gintsts | is_host | has_received
            }
            GRXSTSP => {
                assert!(core.words.is_empty(), "{} words of the last entry were left", core.words.len());
                let entry = core.received.pop_front().expect("an entry");
                for chunk in entry.bytes.chunks(4) {
                    let mut word = [0xee; 4];
                    word[..chunk.len()].copy_from_slice(chunk);
                    core.words.push_back(u32::from_le_bytes(word));
                }
                entry.status
            }
            DCFG => core.dcfg,
            DCTL => core.dctl,
            0x900..0xd00 if offset & 0x1f == 0 => core.endpoint(offset).1.control,
            0x900..0xd00 if offset & 0x1f == 8 => core.endpoint(offset).1.interrupts,
            0x900..0xd00 if offset & 0x1f == 0x10 => core.endpoint(offset).1.transfer,
            0x1000 => core.words.pop_front().expect("a word of the entry"),
            other => panic!("a read of {other:#x}"),
        }
    }

    fn write(&self, offset: u32, value: u32) {
        let mut core = self.0.borrow_mut();
        match offset {
            GUSBCFG => core.gusbcfg = value,
            GRSTCTL if value & CORE_RESET != 0 => assert_eq!(core.gusbcfg, 0, "the reset comes first"),
            GRSTCTL => core.flush(value),
            GINTSTS => core.gintsts &= !value,
            GRXFSIZ => core.grxfsiz = value,
            DIEPTXF0 => core.areas[0] = value,
            0x104..=0x10c => core.areas[(offset - 0x100) as usize / 4] = value,
            GCCFG => core.gccfg = value,
            DCFG => {
                core.dcfg = value;
                if value >> ADDRESS_AT & 0x7f == 0 {
                    core.address = 0;
                }
            }
            DCTL => core.dctl = value,
            PCGCCTL => assert_eq!(value, 0),
            0x900..0xd00 if offset & 0x1f == 0 => core.write_control(offset, value),
            0x900..0xd00 if offset & 0x1f == 8 => core.endpoint(offset).1.interrupts &= !value,
            0x900..0xd00 if offset & 0x1f == 0x10 => {
                let (_, endpoint) = core.endpoint(offset);
                let is_setup_count = (endpoint.transfer ^ value) & !THREE_SETUPS == 0;
                let is_enabled = endpoint.control & ENABLE != 0;
                assert!(!is_enabled || is_setup_count, "{offset:#x} while the endpoint is enabled");
                endpoint.transfer = value;
                endpoint.written = 0;
            }
            0x1000..0x5000 => core.write_queue((offset >> 12) as usize - 1, value),
            other => panic!("a write of {other:#x}"),
        }
    }
}
