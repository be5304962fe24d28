//! Frames on a line that does what lines do: identity, resynchronisation, and what damage is refused for certain.

use proptest::collection::vec;
use proptest::prelude::*;
use retrace_link::crc;
use retrace_link::frame::{FrameDamage, FrameDecoder, MAX_PAYLOAD, MAX_WIRE, OVERHEAD, encode};

/// The longest payload that the format allows, longer than host and card use.
const LONGEST: usize = 253;

fn frame(payload: &[u8]) -> Vec<u8> {
    encode(payload, &mut [0; MAX_WIRE]).expect("a payload of 1 to 240 bytes").to_vec()
}

fn decoded(bytes: &[u8]) -> Vec<Result<Vec<u8>, FrameDamage>> {
    let mut decoder = FrameDecoder::<MAX_PAYLOAD>::new();
    bytes.iter().filter_map(|&byte| decoder.push(byte).map(|found| found.map(<[u8]>::to_vec))).collect()
}

/// How many frames are accepted.
fn accepted(bytes: &[u8]) -> usize {
    let mut decoder = FrameDecoder::<MAX_PAYLOAD>::new();
    bytes.iter().filter(|&&byte| matches!(decoder.push(byte), Some(Ok(_)))).count()
}

/// SplitMix64 (Steele, Lea, Flood 2014): the same numbers every time.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as usize % n
    }

    /// A payload with many zeros and ones, whose neighbours on the line are few bits away from a zero.
    fn payload(&mut self, count: usize) -> Vec<u8> {
        (0..count).map(|_| if self.below(3) == 0 { self.below(256) as u8 } else { self.below(3) as u8 }).collect()
    }
}

fn flip(bytes: &mut [u8], bit: usize) {
    bytes[bit / 8] ^= 1 << (bit % 8);
}

fn zeros(bytes: &[u8]) -> impl Iterator<Item = bool> {
    bytes.iter().map(|&byte| byte == 0)
}

/// Flips these bits of a frame, has the result refused unless a zero was made or destroyed, and flips them back.
fn refused(wire: &mut [u8], bits: &[usize]) -> bool {
    bits.iter().for_each(|&bit| flip(wire, bit));
    let same_zeros = zeros(wire).position(|zero| zero) == Some(wire.len() - 1);
    assert!(!same_zeros || accepted(wire) == 0, "accepted with {bits:?} flipped: {wire:02X?}");
    bits.iter().for_each(|&bit| flip(wire, bit));
    same_zeros
}

/// Payloads of all kinds, and their frames.
fn some_frames(counts: &[usize]) -> Vec<Vec<u8>> {
    let mut random = Random(7);
    let kinds = |count| [vec![0; count], vec![0xFF; count], random.payload(count)];
    counts.iter().copied().flat_map(kinds).map(|payload| frame(&payload)).collect()
}

#[test]
fn every_length_of_every_kind_comes_back() {
    let mut random = Random(1);
    for count in 1..=MAX_PAYLOAD {
        let mut one_zero = vec![1; count];
        one_zero[random.below(count)] = 0;
        for payload in [vec![0; count], vec![1; count], vec![0xFF; count], one_zero, random.payload(count)] {
            let wire = frame(&payload);
            assert_eq!(wire.len(), count + OVERHEAD);
            assert_eq!(zeros(&wire).position(|zero| zero), Some(wire.len() - 1));
            assert_eq!(decoded(&wire), [Ok(payload)]);
        }
    }
}

#[test]
fn every_short_payload_of_telling_bytes_comes_back() {
    const BYTES: [u8; 5] = [0, 1, 2, 3, 0xFF];
    for count in 1..=7u32 {
        for number in 0..5usize.pow(count) {
            let payload: Vec<u8> = (0..count).map(|digit| BYTES[number / 5usize.pow(digit) % 5]).collect();
            assert_eq!(decoded(&frame(&payload)), [Ok(payload)]);
        }
    }
}

#[test]
fn the_longest_payloads_of_the_format_come_back() {
    for byte in [0, 1, 0xFF] {
        let (payload, mut wire) = ([byte; LONGEST], [0; LONGEST + OVERHEAD]);
        let mut decoder = FrameDecoder::<LONGEST>::new();
        let frame = encode(&payload, &mut wire).unwrap();
        let (_, others) = frame.split_last().unwrap();
        assert!(others.iter().all(|&byte| byte != 0 && decoder.push(byte).is_none()));
        assert_eq!(decoder.push(0), Some(Ok(&payload[..])));
    }
}

/// Any body without zeros under its right length and check.
fn framed(body: &[u8]) -> Vec<u8> {
    let mut wire = vec![body.len() as u8];
    wire.extend(body);
    let check = crc::finish(wire.iter().fold(crc::START, |register, &byte| crc::update(register, byte)));
    wire.extend((0..5).map(|seventh| 0x80 | (check >> (7 * seventh)) as u8 & if seventh < 4 { 0x7F } else { 0xF }));
    wire.push(0);
    wire
}

fn payloads() -> impl Strategy<Value = Vec<u8>> {
    vec(prop_oneof![Just(0), Just(1), 0..=3u8, any::<u8>()], 1..=MAX_PAYLOAD)
}

fn noise() -> impl Strategy<Value = Vec<u8>> {
    vec(prop_oneof![2 => Just(0), 3 => 1..12u8, 3 => any::<u8>()], 0..60)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(if cfg!(debug_assertions) { 2000 } else { 20_000 }))]

    #[test]
    fn any_payload_comes_back(payload in payloads()) {
        prop_assert_eq!(decoded(&frame(&payload)), [Ok(payload)]);
    }

    /// Noise up to any zero byte, cut frames among it, costs no frame after that.
    #[test]
    fn frames_come_back_from_among_noise(sent in vec((noise(), payloads(), 0..MAX_WIRE), 1..5)) {
        let mut line = Vec::new();
        for (noise, payload, cut) in &sent {
            let whole = frame(payload);
            line.extend(noise);
            line.extend(&whole[..*cut.min(&whole.len())]);
            line.push(0);
            line.extend(whole);
        }
        let found: Vec<_> = decoded(&line).into_iter().flatten().collect();
        let mut rest = found.iter();
        prop_assert!(sent.iter().all(|(_, payload, _)| rest.any(|other| other == payload)), "{:?}", found);
        prop_assert!(found.iter().all(|found| sent.iter().any(|(_, payload, _)| payload == found)), "{:?}", found);
    }

    /// Nothing is accepted but what `encode` makes of its payload: no two ways to write one, and no byte that says
    /// nothing.
    #[test]
    fn only_the_frame_of_a_payload_is_accepted(body in vec(prop_oneof![1..5u8, 1..=255u8], 1..40)) {
        let wire = framed(&body);
        match &decoded(&wire)[..] {
            [Ok(payload)] => prop_assert_eq!(frame(payload), wire),
            [Err(FrameDamage::Stuffing)] => {}
            [Err(FrameDamage::Length)] => prop_assert_eq!(body.len(), 1),
            other => prop_assert!(false, "{:?}", other),
        }
    }
}

#[test]
fn no_error_of_one_or_two_bits_is_accepted() {
    for mut wire in some_frames(&[1, 2, 5, 40]).into_iter().chain([frame(&Random(2).payload(100))]) {
        let bits = (wire.len() - 1) * 8;
        let mut tried = 0;
        for first in 0..bits {
            tried += usize::from(refused(&mut wire, &[first]));
            for second in first + 1..bits {
                tried += usize::from(refused(&mut wire, &[first, second]));
            }
        }
        assert!(tried > bits * bits / 4, "{tried} errors of {bits} bits");
    }
}

#[test]
fn no_error_of_three_bits_is_accepted_in_a_short_frame() {
    for mut wire in some_frames(&[3]).into_iter().chain([frame(&Random(3).payload(15))]) {
        let bits = (wire.len() - 1) * 8;
        for first in 0..bits {
            for second in first + 1..bits {
                for third in second + 1..bits {
                    refused(&mut wire, &[first, second, third]);
                }
            }
        }
    }
}

#[test]
fn no_error_of_four_or_five_bits_drawn_at_random_is_accepted() {
    let mut random = Random(4);
    for mut wire in some_frames(&[1, 3, 17, 60, MAX_PAYLOAD]) {
        let bits = (wire.len() - 1) * 8;
        for round in 0..20_000 {
            let mut chosen = Vec::new();
            while chosen.len() < 4 + round % 2 {
                let bit = random.below(bits);
                if !chosen.contains(&bit) {
                    chosen.push(bit);
                }
            }
            refused(&mut wire, &chosen);
        }
    }
}

/// Every burst of up to 12 bits, and many of up to 32; `frames_distance` in `verification` weighs all of them.
#[test]
fn no_burst_is_accepted() {
    let mut random = Random(5);
    for mut wire in some_frames(&[1, 9]) {
        let bits = (wire.len() - 1) * 8;
        let within = |first: usize, pattern: u32| -> Vec<usize> {
            (0..32).filter(|bit| pattern >> bit & 1 == 1).map(|bit| first + bit).filter(|&bit| bit < bits).collect()
        };
        for first in 0..bits {
            for pattern in (1..1u32 << 12).step_by(2) {
                refused(&mut wire, &within(first, pattern));
            }
            for _ in 0..500 {
                refused(&mut wire, &within(first, random.below(1 << 32) as u32 | 1));
            }
        }
    }
}

/// Errors that make or destroy zeros: three frames on the line, up to six flips in the first one and its zero.
#[test]
fn a_zero_made_or_destroyed_costs_two_frames_at_most_and_yields_none() {
    let (mut random, mut made, mut destroyed) = (Random(6), 0, 0);
    for _ in 0..100_000 {
        let [first, second, third] = [(); 3].map(|()| {
            let count = 1 + random.below(30);
            random.payload(count)
        });
        let mut struck = frame(&first);
        let whole = struck.clone();
        for _ in 0..=random.below(6) {
            // Next to a zero more often than chance has it.
            let bit = random.below(struck.len() * 8);
            if random.below(2) == 0 { flip(&mut struck, bit) } else { struck[bit / 8] &= 1 << (bit % 8) }
        }
        let makes = zeros(&struck).filter(|&zero| zero).count() > usize::from(struck.last() == Some(&0));
        let destroys = struck.last() != Some(&0);
        made += usize::from(makes);
        destroyed += usize::from(destroys);
        let found: Vec<_> =
            decoded(&[struck.clone(), frame(&second), frame(&third)].concat()).into_iter().flatten().collect();
        let expected = match (struck == whole, destroys) {
            (true, _) => vec![first, second, third],
            (_, false) => vec![second, third],
            (_, true) => vec![third],
        };
        assert_eq!(found, expected, "{struck:02X?}");
    }
    assert!(made > 20_000 && destroyed > 5_000, "{made} with a zero made, {destroyed} with one destroyed");
}

/// The limit of the guarantee: bytes after which the register is as new, a byte that one flip makes zero, and a frame.
/// Whoever chooses payloads can bring this about, and noise by a chance in 2³²; hence payloads that number themselves.
#[test]
fn a_payload_can_be_made_up_whose_tail_is_a_frame() {
    let mut wire = frame(&[0x01, 0xB5, 0xA7, 0x3A, 0xD8, 0x01, 0x03, 0x03, 0x4E, 0x4F]);
    flip(&mut wire, 8 * 7);
    assert_eq!(decoded(&wire), [Err(FrameDamage::Length), Ok(vec![0x4E, 0x4F])]);
}
