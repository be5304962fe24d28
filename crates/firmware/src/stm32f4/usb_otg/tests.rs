//! A host at the model of the controller: it enumerates the card as Linux does, and carries bytes.
//!
//! Invariant: what a host would discard or wait for in vain is a panic.

use std::collections::VecDeque;

use super::model::{DATA_0, DATA_1, Handshake, Otg};
use super::*;
use crate::usb_control::serial_text;
use proptest::prelude::*;

static SERIAL: SerialText = serial_text(0x1234_abcd);
const DATA_ENDPOINT: usize = crate::usb_control::DATA_ENDPOINT as usize;

/// Tokens that a host sends until it gives up.
const PATIENCE: usize = 20;

struct Host {
    otg: Otg,
    line: UsbOtg<Otg>,
    address: u32,
    to_host: bool,
    from_host: bool,
    /// Bytes that the card has received.
    received: Vec<u8>,
}

/// The host was refused.
#[derive(Debug, PartialEq, Eq)]
struct Refused;

impl Host {
    fn new() -> Self {
        let otg = Otg::new();
        let line = UsbOtg::start(otg.clone(), Some(&SERIAL));
        Self { otg, line, address: 0, to_host: DATA_0, from_host: DATA_0, received: Vec::new() }
    }

    fn reset(&mut self) {
        self.otg.reset_bus();
        self.address = 0;
        self.line.poll();
    }

    /// Repeats a token while the answer is NAK; the card looks at its controller in between.
    fn token(&mut self, mut token: impl FnMut(&Otg, u32) -> Handshake) -> Handshake {
        for _ in 0..PATIENCE {
            match token(&self.otg, self.address) {
                Handshake::Nak => self.line.poll(),
                Handshake::Silence => panic!("nobody answers at address {}", self.address),
                answer => return answer,
            }
        }
        Handshake::Nak
    }

    /// A request with an answer.
    fn ask(&mut self, request: [u8; 8]) -> Result<Vec<u8>, Refused> {
        assert_eq!(self.otg.send_setup(self.address, request), Handshake::Ack);
        let (mut bytes, mut kind) = (Vec::new(), DATA_1);
        let length = usize::from(u16::from_le_bytes([request[6], request[7]]));
        loop {
            match self.token(|otg, address| otg.fetch(address, 0, true)) {
                Handshake::Data(is, packet) => {
                    assert_eq!(is, kind, "a packet that a host discards");
                    kind = !kind;
                    bytes.extend(&packet);
                    if packet.len() < PACKET || bytes.len() >= length {
                        break;
                    }
                }
                Handshake::Stall => return Err(Refused),
                other => panic!("{request:x?}: {other:?}"),
            }
        }
        assert!(bytes.len() <= length);
        let acknowledged = self.token(|otg, address| otg.send(address, 0, DATA_1, &[]));
        assert_eq!(acknowledged, Handshake::Ack);
        Ok(bytes)
    }

    /// A request without an answer, with bytes of the host.
    fn order(&mut self, request: [u8; 8], data: &[u8]) -> Result<(), Refused> {
        assert_eq!(self.otg.send_setup(self.address, request), Handshake::Ack);
        if !data.is_empty() {
            match self.token(|otg, address| otg.send(address, 0, DATA_1, data)) {
                Handshake::Ack => {}
                Handshake::Stall => return Err(Refused),
                other => panic!("{request:x?}: {other:?}"),
            }
        }
        match self.token(|otg, address| otg.fetch(address, 0, true)) {
            Handshake::Data(DATA_1, packet) if packet.is_empty() => Ok(()),
            Handshake::Stall => Err(Refused),
            other => panic!("{request:x?}: {other:?}"),
        }
    }

    fn enumerate(&mut self) {
        assert!(self.otg.is_visible());
        self.reset();
        let device = self.ask([0x80, 6, 0, 1, 0, 0, 64, 0]).expect("its device");
        self.reset();
        self.order([0x00, 5, 7, 0, 0, 0, 0, 0], &[]).expect("an address");
        self.address = 7;
        assert_eq!(self.ask([0x80, 6, 0, 1, 0, 0, 18, 0]), Ok(device));
        assert_eq!(self.ask([0x80, 6, 0, 6, 0, 0, 10, 0]), Err(Refused), "of high speed");
        let configuration = self.ask([0x80, 6, 0, 2, 0, 0, 9, 0]).expect("its configuration");
        let whole = self.ask([0x80, 6, 0, 2, 0, 0, configuration[2], 0]).expect("all of it");
        assert_eq!((whole.len(), &whole[..9]), (67, &configuration[..]), "in two packets");
        let serial = self.ask([0x80, 6, 3, 3, 9, 4, 255, 0]).expect("its number");
        assert_eq!(serial, SERIAL);
        self.order([0x00, 9, whole[5], 0, 0, 0, 0, 0], &[]).expect("configured");
        (self.to_host, self.from_host) = (DATA_0, DATA_0);
        assert_eq!(self.ask([0xa1, 0x21, 0, 0, 0, 0, 7, 0]).map(|coding| coding.len()), Ok(7));
        self.order([0x21, 0x20, 0, 0, 0, 0, 7, 0], &[0x40, 0x42, 0x0f, 0, 0, 0, 8]).expect("a rate");
        self.order([0x21, 0x22, 3, 0, 0, 0, 0, 0], &[]).expect("open");
    }

    /// Sends a packet. Returns whether the card has taken it.
    fn send(&mut self, bytes: &[u8]) -> bool {
        match self.otg.send(self.address, DATA_ENDPOINT, self.from_host, bytes) {
            Handshake::Ack => {
                self.from_host = !self.from_host;
                true
            }
            Handshake::Nak => false,
            other => panic!("{other:?}"),
        }
    }

    /// Fetches a packet; `acknowledges`: the card learns of it.
    fn fetch(&mut self, acknowledges: bool) -> Option<Vec<u8>> {
        match self.otg.fetch(self.address, DATA_ENDPOINT, acknowledges) {
            Handshake::Data(kind, bytes) => {
                assert_eq!(kind, self.to_host, "a packet that a host discards");
                assert!(bytes.len() < PACKET, "a host waits behind a full packet");
                self.to_host ^= acknowledges;
                Some(bytes)
            }
            Handshake::Nak => None,
            other => panic!("{other:?}"),
        }
    }

    /// The card takes up to this many bytes.
    fn take(&mut self, most: usize) {
        self.line.poll();
        for _ in 0..most {
            self.received.extend(self.line.receive());
        }
    }
}

/// Bytes in both directions, so that the line is seen to work.
fn exchange(host: &mut Host) {
    host.received.clear();
    host.line.poll();
    assert!(host.send(b"to the card"));
    for byte in *b"to the host" {
        assert!(host.line.can_send());
        host.line.send(byte);
    }
    host.take(64);
    assert_eq!(host.received, b"to the card");
    assert_eq!(host.fetch(true).as_deref(), Some(&b"to the host"[..]));
    assert_eq!(host.fetch(true), None);
}

#[test]
fn a_host_enumerates_the_card_and_exchanges_bytes() {
    let mut host = Host::new();
    assert!(!host.line.can_send() && host.line.is_silent(), "nobody is there");
    host.enumerate();
    exchange(&mut host);
    exchange(&mut host);
}

/// A request may be broken off by another one at any place.
#[test]
fn a_request_that_is_broken_off_leaves_nothing_behind() {
    let mut host = Host::new();
    host.enumerate();
    let device = [0x80, 6, 0, 1, 0, 0, 18, 0];
    for tokens in 0..3 {
        // two packets, of which the host fetches none, one without an acknowledgement, or one
        assert_eq!(host.otg.send_setup(host.address, [0x80, 6, 0, 2, 0, 0, 67, 0]), Handshake::Ack);
        if tokens > 0 {
            host.token(|otg, address| otg.fetch(address, 0, tokens > 1));
        }
        host.line.poll();
        assert_eq!(host.ask(device).map(|bytes| bytes.len()), Ok(18));
    }
    // its bytes do not come
    assert_eq!(host.otg.send_setup(host.address, [0x21, 0x20, 0, 0, 0, 0, 7, 0]), Handshake::Ack);
    host.line.poll();
    assert_eq!(host.ask(device).map(|bytes| bytes.len()), Ok(18));
    // more than a packet, and an unknown one: refused, and the next one is answered
    assert_eq!(host.order([0x21, 0x20, 0, 0, 0, 0, 65, 0], &[0; 64]), Err(Refused));
    assert_eq!(host.order([0x00, 99, 0, 0, 0, 0, 0, 0], &[]), Err(Refused));
    assert_eq!(host.ask(device).map(|bytes| bytes.len()), Ok(18));
    exchange(&mut host);
}

/// A host that gave up an endpoint begins with DATA0 again.
#[test]
fn an_endpoint_begins_again() {
    let mut host = Host::new();
    host.enumerate();
    exchange(&mut host);
    host.order([0x02, 1, 0, 0, 0x01, 0, 0, 0], &[]).expect("from the host");
    host.order([0x02, 1, 0, 0, 0x81, 0, 0, 0], &[]).expect("to the host");
    (host.to_host, host.from_host) = (DATA_0, DATA_0);
    exchange(&mut host);
    // and a whole configuration
    host.order([0x00, 9, 0, 0, 0, 0, 0, 0], &[]).expect("no configuration");
    assert!(!host.line.can_send());
    host.order([0x00, 9, 1, 0, 0, 0, 0, 0], &[]).expect("the configuration");
    (host.to_host, host.from_host) = (DATA_0, DATA_0);
    exchange(&mut host);
}

/// The bus is reset, or the cable pulled out and plugged in, with packets under way in both directions.
#[test]
fn a_reset_of_the_bus_drops_what_was_under_way() {
    let mut host = Host::new();
    host.enumerate();
    for fetches in [false, true] {
        host.line.poll();
        (0..100).for_each(|byte| host.line.send(byte));
        host.line.poll();
        assert!(host.send(&[1, 2, 3]), "before the card looks");
        host.take(1);
        (0..40).for_each(|byte| host.line.send(byte));
        if fetches {
            host.fetch(false);
        }
        // without a host nothing goes on, and the line is not full for ever
        for _ in 0..10 {
            host.take(0);
        }
        host.reset();
        assert!(host.line.is_silent() && !host.line.can_send() && host.line.receive().is_none());
        host.enumerate();
        exchange(&mut host);
    }
    // a request under way
    assert_eq!(host.otg.send_setup(host.address, [0x80, 6, 0, 2, 0, 0, 67, 0]), Handshake::Ack);
    host.token(|otg, address| otg.fetch(address, 0, false));
    host.enumerate();
    exchange(&mut host);
}

/// The card has room for a packet only when it has taken the last one whole: none is lost.
#[test]
fn a_card_that_is_away_refuses_packets() {
    let mut host = Host::new();
    host.enumerate();
    host.line.poll();
    assert!(host.send(&[7; 64]) && !host.send(&[8]));
    host.take(63);
    assert!(!host.send(&[8]));
    host.take(1);
    assert!(!host.send(&[8]));
    host.take(0);
    assert!(host.send(&[8]));
    host.take(1);
    assert_eq!(host.received, [&[7; 64][..], &[8]].concat());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    /// Whatever both sides do, and when: every byte arrives once and in order, with requests and lost acknowledgements
    /// in between.
    #[test]
    fn no_byte_is_lost_or_doubled(
        steps in prop::collection::vec((0u8..6, 0usize..80, any::<bool>()), 1..400),
    ) {
        let mut host = Host::new();
        host.enumerate();
        let (mut sent, mut given, mut fetched, mut counter) = (Vec::new(), Vec::new(), Vec::new(), 0u8);
        let mut pending: VecDeque<u8> = VecDeque::new();
        for (what, count, flag) in steps {
            match what {
                0 => host.take(count),
                1 => for _ in 0..count {
                    counter = counter.wrapping_mul(5).wrapping_add(1);
                    if host.line.can_send() {
                        host.line.send(counter);
                        given.push(counter);
                    }
                },
                2 => fetched.extend(host.fetch(flag).filter(|_| flag).unwrap_or_default()),
                3 => {
                    if pending.is_empty() {
                        pending.extend((0..count.min(PACKET)).map(|n| counter.wrapping_add(n as u8)));
                    }
                    let packet: Vec<u8> = pending.iter().copied().collect();
                    if host.send(&packet) {
                        sent.extend(pending.drain(..));
                        if flag {
                            // the host has not seen the acknowledgement: it sends the packet again
                            host.from_host = !host.from_host;
                            prop_assert!(host.send(&packet));
                        }
                    }
                }
                4 => { host.ask([0x80, 6, 0, 2, 0, 0, 67, 0]).expect("an answer"); }
                _ => host.line.poll(),
            }
        }
        for _ in 0..4 {
            host.take(64);
            fetched.extend(host.fetch(true).unwrap_or_default());
        }
        prop_assert_eq!((host.received.len(), fetched.len()), (sent.len(), given.len()));
        prop_assert!(host.received == sent && fetched == given);
    }
}
