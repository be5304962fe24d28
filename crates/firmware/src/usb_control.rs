//! The control requests of the USB line, a serial port of the class CDC-ACM (USB 2.0, chapter 9; CDC 1.2, PSTN 1.2).
//!
//! Invariant: every request has an answer; one that is not known is refused.

/// Largest packet of every endpoint but that of notifications.
pub const PACKET: usize = 64;
/// Endpoints of the line's bytes, to the host and from it, and of notifications, of which there are none.
pub const DATA_ENDPOINT: u8 = 1;
/// See [`DATA_ENDPOINT`].
pub const NOTIFICATION_ENDPOINT: u8 = 2;
/// Largest packet of notifications.
pub const NOTIFICATION_PACKET: usize = 8;
/// Address bit of an endpoint to the host.
pub const TO_HOST: u8 = 0x80;

/// A number of pid.codes for tests: a product needs one of its own.
const VENDOR: u16 = 0x1209;
const PRODUCT: u16 = 0x0001;

const DEVICE: [u8; 18] = device(3);
/// The device without a serial number.
const DEVICE_WITHOUT_SERIAL: [u8; 18] = device(0);

/// Returns the descriptor of the device with this string as its serial number.
const fn device(serial: u8) -> [u8; 18] {
    let ([vendor_low, vendor_high], [product_low, product_high]) = (VENDOR.to_le_bytes(), PRODUCT.to_le_bytes());
    [
        18,
        1,
        0x00,
        0x02,
        2,
        0,
        0,
        PACKET as u8,
        vendor_low,
        vendor_high,
        product_low,
        product_high,
        0,
        1,
        1,
        2,
        serial,
        1,
    ]
}
/// Two interfaces: the serial port's control with its notifications, and its data.
#[rustfmt::skip]
const CONFIGURATION: [u8; 67] = [
    9, 2, 67, 0, 2, 1, 0, 0x80, 50,
    9, 4, 0, 0, 1, 2, 2, 0, 0,
    5, 0x24, 0, 0x10, 0x01,
    5, 0x24, 1, 0, 1,
    4, 0x24, 2, 2,
    5, 0x24, 6, 0, 1,
    7, 5, TO_HOST | NOTIFICATION_ENDPOINT, 3, NOTIFICATION_PACKET as u8, 0, 255,
    9, 4, 1, 0, 2, 10, 0, 0, 0,
    7, 5, DATA_ENDPOINT, 2, PACKET as u8, 0, 0,
    7, 5, TO_HOST | DATA_ENDPOINT, 2, PACKET as u8, 0, 0,
];
/// Languages, manufacturer, product: in UTF-16.
const LANGUAGES: [u8; 4] = [4, 3, 0x09, 0x04];
const MANUFACTURER: [u8; 16] = text(b"retrace");
const PRODUCT_NAME: [u8; 26] = text(b"retrace card");
/// Rate, stop bits, parity, bits: what a host reads before it has set it. Nothing depends on it.
const LINE_CODING: [u8; 7] = [0x40, 0x42, 0x0f, 0, 0, 0, 8];

/// Returns a string descriptor.
const fn text<const N: usize>(ascii: &[u8]) -> [u8; N] {
    assert!(N == 2 + 2 * ascii.len());
    let mut bytes = [0; N];
    (bytes[0], bytes[1]) = (N as u8, 3);
    let mut n = 0;
    while n < ascii.len() {
        bytes[2 + 2 * n] = ascii[n];
        n += 1;
    }
    bytes
}

/// The serial number as a string descriptor: eight hexadecimal digits.
pub type SerialText = [u8; 18];

/// Returns the descriptor of this serial number.
#[must_use]
pub const fn serial_text(serial: u32) -> SerialText {
    let mut digits = [0; 8];
    let mut n = 0;
    while n < digits.len() {
        digits[n] = b"0123456789ABCDEF"[(serial >> (28 - 4 * n) & 15) as usize];
        n += 1;
    }
    text(&digits)
}

/// Answer to a control request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ControlReply {
    /// These bytes, and then the host's acknowledgement.
    Data(&'static [u8]),
    /// An acknowledgement, and then this address.
    Address(u8),
    /// An acknowledgement, and the endpoints begin.
    Configure,
    /// An acknowledgement, and the endpoints end.
    Unconfigure,
    /// An acknowledgement, and the packets of the endpoint of this address begin again.
    Restart(u8),
    /// An acknowledgement.
    Acknowledge,
    /// Bytes of the host, which are ignored, and then an acknowledgement.
    Receive,
    /// A refusal.
    Refuse,
}

/// Returns the answer to a request to the card with this serial number.
#[must_use]
pub fn reply(setup: [u8; 8], serial: Option<&'static SerialText>) -> ControlReply {
    let [kind, request, low, high, index, _, length_low, length_high] = setup;
    let length = usize::from(u16::from_le_bytes([length_low, length_high]));
    let data = |bytes: &'static [u8]| ControlReply::Data(&bytes[..bytes.len().min(length)]);
    match (kind, request) {
        // GET_STATUS of device, interface, endpoint
        (0x80..=0x82, 0) => data(&[0, 0]),
        // CLEAR_FEATURE of an endpoint, which is never halted: that of its halt
        (0x02, 1) if low == 0 => ControlReply::Restart(index),
        // SET_ADDRESS, GET_DESCRIPTOR
        (0x00, 5) => ControlReply::Address(low & 0x7f),
        (0x80, 6) => match (high, low) {
            (1, 0) => data(if serial.is_some() { &DEVICE } else { &DEVICE_WITHOUT_SERIAL }),
            (2, 0) => data(&CONFIGURATION),
            (3, 0) => data(&LANGUAGES),
            (3, 1) => data(&MANUFACTURER),
            (3, 2) => data(&PRODUCT_NAME),
            (3, 3) => serial.map_or(ControlReply::Refuse, |text| data(text)),
            _ => ControlReply::Refuse,
        },
        // GET_CONFIGURATION, SET_CONFIGURATION, GET_INTERFACE, SET_INTERFACE
        (0x80, 8) => data(&[1]),
        (0x00, 9) if low == 0 => ControlReply::Unconfigure,
        (0x00, 9) if low == CONFIGURATION[5] => ControlReply::Configure,
        (0x81, 10) => data(&[0]),
        (0x01, 11) if low == 0 => ControlReply::Acknowledge,
        // SET_LINE_CODING, GET_LINE_CODING, SET_CONTROL_LINE_STATE
        (0x21, 0x20) if length == LINE_CODING.len() => ControlReply::Receive,
        (0xa1, 0x21) => data(&LINE_CODING),
        (0x20 | 0x21, 0x22) => ControlReply::Acknowledge,
        _ => ControlReply::Refuse,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    static SERIAL: SerialText = serial_text(0x00ab_c123);

    /// The descriptors of the configuration, each with its length in front.
    fn descriptors() -> Vec<&'static [u8]> {
        let (mut found, mut rest) = (Vec::new(), &CONFIGURATION[..]);
        while let Some(&length) = rest.first() {
            assert!(length >= 2, "{rest:?}");
            let (descriptor, behind) = rest.split_at(usize::from(length));
            found.push(descriptor);
            rest = behind;
        }
        found
    }

    #[test]
    fn descriptors_have_the_lengths_that_they_name() {
        assert_eq!(usize::from(u16::from_le_bytes([CONFIGURATION[2], CONFIGURATION[3]])), CONFIGURATION.len());
        assert_eq!(usize::from(DEVICE[0]), DEVICE.len());
        for string in [&LANGUAGES[..], &MANUFACTURER, &PRODUCT_NAME] {
            assert_eq!((usize::from(string[0]), string[1]), (string.len(), 3));
        }
        assert_eq!(&PRODUCT_NAME[..6], [26, 3, b'r', 0, b'e', 0]);
        assert_eq!(u32::from_le_bytes(LINE_CODING[..4].try_into().unwrap()), 1_000_000);
    }

    /// What a driver of this class looks for (USB 2.0, 9.6; CDC 1.2, 5.2.3).
    #[test]
    fn a_driver_finds_two_interfaces_and_their_endpoints() {
        let all = descriptors();
        let interfaces: Vec<_> = all.iter().filter(|found| found[1] == 4).collect();
        assert_eq!(interfaces.len(), usize::from(CONFIGURATION[4]));
        for (number, interface) in interfaces.iter().enumerate() {
            assert_eq!(usize::from(interface[2]), number);
            let from = all.iter().position(|found| found == *interface).unwrap() + 1;
            let endpoints = all[from..].iter().take_while(|found| found[1] != 4).filter(|found| found[1] == 5);
            assert_eq!(endpoints.count(), usize::from(interface[4]), "of interface {number}");
        }
        assert_eq!((&interfaces[0][5..7], &interfaces[1][5..7]), (&[2, 2][..], &[10, 0][..]), "control, data");
        let union = all.iter().find(|found| found[1..3] == [0x24, 6]).unwrap();
        assert_eq!(union[3..], [0, 1], "control interface, data interface");
        let bulk: Vec<u8> = all.iter().filter(|found| found[1] == 5 && found[3] == 2).map(|found| found[2]).collect();
        assert_eq!(bulk, [DATA_ENDPOINT, TO_HOST | DATA_ENDPOINT]);
        assert_eq!(DEVICE[4], 2, "the class of a communication device");
    }

    /// A full packet announces another one; an answer of such a length would need an empty one behind it.
    #[test]
    fn no_answer_ends_with_a_full_packet() {
        let answers = [&DEVICE[..], &CONFIGURATION, &LANGUAGES, &MANUFACTURER, &PRODUCT_NAME, &LINE_CODING];
        assert!(answers.iter().all(|answer| answer.len() % PACKET != 0));
    }

    #[test]
    fn a_card_with_a_serial_number_has_it_in_its_descriptors() {
        assert_eq!(SERIAL[2..], *b"0\x000\0A\0B\0C\x001\x002\x003\0");
        let strings = [3, 4].map(|string| reply([0x80, 6, string, 3, 9, 4, 255, 0], Some(&SERIAL)));
        assert_eq!(strings, [ControlReply::Data(&SERIAL), ControlReply::Refuse]);
        assert_eq!(reply([0x80, 6, 3, 3, 9, 4, 255, 0], None), ControlReply::Refuse);
        let device = |serial| match reply([0x80, 6, 0, 1, 0, 0, 18, 0], serial) {
            ControlReply::Data(bytes) => bytes[16],
            other => panic!("{other:?}"),
        };
        assert_eq!([device(Some(&SERIAL)), device(None)], [3, 0], "the number of its string");
    }

    #[test]
    fn a_host_is_answered() {
        assert_eq!(reply([0x80, 6, 0, 2, 0, 0, 9, 0], None), ControlReply::Data(&CONFIGURATION[..9]));
        assert_eq!(reply([0x80, 6, 0, 2, 0, 0, 255, 0], None), ControlReply::Data(&CONFIGURATION));
        assert_eq!(reply([0x00, 5, 17, 0, 0, 0, 0, 0], None), ControlReply::Address(17));
        assert_eq!(reply([0x00, 9, 1, 0, 0, 0, 0, 0], None), ControlReply::Configure);
        assert_eq!(reply([0x00, 9, 0, 0, 0, 0, 0, 0], None), ControlReply::Unconfigure);
        assert_eq!(reply([0x00, 9, 2, 0, 0, 0, 0, 0], None), ControlReply::Refuse, "there is one configuration");
        assert_eq!(reply([0x02, 1, 0, 0, 0x81, 0, 0, 0], None), ControlReply::Restart(0x81));
        assert_eq!(reply([0x21, 0x20, 0, 0, 0, 0, 7, 0], None), ControlReply::Receive);
        assert_eq!(reply([0x21, 0x20, 0, 0, 0, 0, 65, 0], None), ControlReply::Refuse, "more than a packet");
        assert_eq!(reply([0x21, 0x22, 3, 0, 0, 0, 0, 0], None), ControlReply::Acknowledge);
        // the descriptor of a device of high speed
        assert_eq!(reply([0x80, 6, 0, 6, 0, 0, 10, 0], None), ControlReply::Refuse);
    }

    proptest! {
        #[test]
        fn no_answer_is_longer_than_requested(setup: [u8; 8]) {
            if let ControlReply::Data(bytes) = reply(setup, Some(&SERIAL)) {
                prop_assert!(bytes.len() <= usize::from(u16::from_le_bytes([setup[6], setup[7]])));
                prop_assert_eq!(setup[0] & TO_HOST, TO_HOST, "data in the direction of the request");
            }
        }
    }
}
