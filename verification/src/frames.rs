//! Frames on the serial line: encode and decode are inverse, the decoder recovers after any bytes, and no error within
//! the guarantee of CRC-32C cancels out.
//!
//! Invariant: the errors here are those on the line, in length, body and check as transmitted; by linearity of the
//! register, proved first, the bytes that they strike do not matter.

use crate::choice::Choice;
use crate::harness::{built, cover, harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row, Search, Size};
use retrace_link::crc;
use retrace_link::frame::{FrameDecoder, OVERHEAD, encode};

/// Feeds the frame of any payload of `COUNT` bytes, `W` = `COUNT` + 8. The payload is returned at the last byte, and
/// nothing before. No byte of the frame but the last is zero.
#[inline(always)]
fn comes_back<const COUNT: usize, const W: usize, const N: usize>(c: &mut impl Choice, decoder: &mut FrameDecoder<N>) {
    let payload: [u8; COUNT] = core::array::from_fn(|_| c.word() as u8);
    cover!(c, ZeroByte, payload.contains(&0));
    cover!(c, Full, !payload.contains(&0));
    let mut wire = [0; W];
    holds!(encode(&payload, &mut wire).is_some_and(|frame| frame.len() == W));
    // Three loops, so that each is short enough for the compiler to unroll.
    pass_nothing(decoder, wire[0]);
    let mut at = 1;
    while at < COUNT + 2 {
        pass_nothing(decoder, wire[at]);
        at += 1;
    }
    let mut at = COUNT + 2;
    while at < W - 1 {
        pass_nothing(decoder, wire[at]);
        at += 1;
    }
    holds!(wire[W - 1] == 0);
    holds!(decoder.push(0) == Some(Ok(&payload)));
}

/// A byte in a frame is not zero and yields nothing.
#[inline(always)]
fn pass_nothing<const N: usize>(decoder: &mut FrameDecoder<N>, byte: u8) {
    holds!(byte != 0);
    holds!(decoder.push(byte).is_none());
}

/// Every payload of `COUNT` bytes is returned from its frame.
fn identity<const COUNT: usize, const W: usize>(c: &mut impl Choice) -> Option<()> {
    comes_back::<COUNT, W, COUNT>(c, &mut FrameDecoder::new());
    Some(())
}

/// After any bytes without a zero, the beginning of a good frame among them, and any number of them: no panic. More
/// than 9 are refused, so that longer input leads to no further state. After the zero the next good frame is decoded.
fn finds_back(c: &mut impl Choice) -> Option<()> {
    const MOST: usize = 2 + OVERHEAD;
    let mut start = [0; MOST];
    built!(encode(&[0, 7], &mut start));
    let (good, bytes) = (c.below(MOST as u32) as usize, c.below(MOST as u32 + 1) as usize);
    let mut decoder = FrameDecoder::<2>::new();
    let mut at = 0;
    while at < MOST {
        if at < bytes {
            let byte = if at < good { start[at] } else { c.word() as u8 };
            c.assume(byte != 0)?;
            holds!(decoder.push(byte).is_none());
        }
        at += 1;
    }
    let found = decoder.push(0);
    cover!(c, Empty, found.is_none());
    cover!(c, Accepted, matches!(found, Some(Ok(_))));
    cover!(c, Refused, matches!(found, Some(Err(_))));
    match found {
        None => holds!(bytes == 0),
        Some(Ok(found)) => holds!(bytes == found.len() + OVERHEAD - 1),
        Some(Err(_)) => holds!(bytes > 0),
    }
    comes_back::<2, MOST, 2>(c, &mut decoder);
    Some(())
}

/// Bytes that are accepted as a payload are the frame that is made of it: its length, its body, and their check.
fn accepts_only_frames(c: &mut impl Choice) -> Option<()> {
    const COUNT: usize = 2;
    let mut decoder = FrameDecoder::<COUNT>::new();
    let body = [c.word() as u8, c.word() as u8, c.word() as u8];
    c.assume(body[0] != 0 && body[1] != 0 && body[2] != 0)?;
    let covered = [COUNT as u8 + 1, body[0], body[1], body[2]];
    let register = covered.into_iter().fold(crc::START, crc::update);
    // Each byte of the check is any; natively the right one often enough.
    let right = core::array::from_fn::<u8, 5, _>(|at| 0x80 | (crc::finish(register) >> (7 * at)) as u8);
    let check: [u8; 5] = core::array::from_fn(|at| if c.flag() { right[at] } else { c.word() as u8 });
    c.assume(!check.contains(&0))?;
    // Unrolled, so that the decoder's state is known between them.
    decoder.push(covered[0]);
    decoder.push(covered[1]);
    decoder.push(covered[2]);
    decoder.push(covered[3]);
    decoder.push(check[0]);
    decoder.push(check[1]);
    decoder.push(check[2]);
    decoder.push(check[3]);
    decoder.push(check[4]);
    let found = decoder.push(0);
    cover!(c, Accepted, matches!(found, Some(Ok(_))));
    cover!(c, Refused, !matches!(found, Some(Ok(_))));
    let Some(Ok(found)) = found else { return Some(()) };
    holds!(found.len() == COUNT);
    let found = [found[0], found[1]];
    let mut wire = [0; COUNT + OVERHEAD];
    holds!(encode(&found, &mut wire).is_some());
    holds!(check == right && wire[..4] == covered);
    Some(())
}

/// The register is linear: the effect of one flipped bit depends on no other bit, and a byte has the effect of those
/// bits of the register. Bit by bit that holds for any error.
fn linear(c: &mut impl Choice) -> Option<()> {
    let (register, bit, byte) = (c.word(), 1 << c.below(32), c.word() as u8);
    cover!(c, Empty, register == 0);
    cover!(c, Full, register == u32::MAX && byte == u8::MAX);
    holds!(crc::update(register ^ bit, 0) == crc::update(register, 0) ^ crc::update(bit, 0));
    holds!(crc::update(register, byte) == crc::update(register ^ u32::from(byte), 0));
    Some(())
}

/// One more byte equals eight steps of the division by x³² + … + 1, 0x1EDC6F41, with all bits reversed.
fn divides(c: &mut impl Choice) -> Option<()> {
    let (register, byte) = (c.word(), c.word() as u8);
    cover!(c, Empty, register == 0);
    cover!(c, Full, register == u32::MAX && byte == u8::MAX);
    let mut divided = (register ^ u32::from(byte)).reverse_bits();
    let mut bit = 0;
    while bit < 8 {
        divided = (divided << 1) ^ if divided >> 31 == 1 { 0x1EDC_6F41 } else { 0 };
        bit += 1;
    }
    holds!(crc::update(register, byte) == divided.reverse_bits());
    Some(())
}

/// Bytes of length and body that the errors below strike, and the 32 bits of the check behind them.
const STRUCK: u32 = 5;

/// Whether an error of these bits in length and body changes the check as this error of the check itself does.
fn cancels(data: u64, check: u32) -> bool {
    let (mut register, mut at) = (0, 0);
    while at < STRUCK {
        register = crc::update(register, (data >> (8 * at)) as u8);
        at += 1;
    }
    register == check
}

/// No error of one to `FLIPS` bits cancels out.
fn seen_flips<const FLIPS: usize>(c: &mut impl Choice) -> Option<()> {
    let (mut data, mut check, mut flips) = (0u64, 0u32, 0);
    while flips < FLIPS {
        // The last number flips none, so that there are errors of fewer bits.
        let bit = c.below(8 * STRUCK + 33);
        data ^= if bit < 8 * STRUCK { 1 << bit } else { 0 };
        check ^= if bit < 8 * STRUCK || bit == 8 * STRUCK + 32 { 0 } else { 1 << (bit - 8 * STRUCK) };
        flips += 1;
    }
    c.assume(data != 0 || check != 0)?;
    cover!(c, InBody, check == 0);
    cover!(c, InCheck, data == 0);
    cover!(c, Full, data.count_ones() + check.count_ones() == FLIPS as u32);
    holds!(!cancels(data, check));
    Some(())
}

/// No error whose bits are within 32 in a row, wherever they begin, cancels out.
fn seen_burst(c: &mut impl Choice) -> Option<()> {
    let (pattern, first) = (u64::from(c.word()), c.below(8 * STRUCK + 1));
    c.assume(pattern != 0)?;
    let data = (pattern << first) & ((1 << (8 * STRUCK)) - 1);
    let check = (pattern >> (8 * STRUCK - first)) as u32;
    cover!(c, InBody, check == 0);
    cover!(c, InCheck, data == 0);
    cover!(c, Split, data != 0 && check != 0);
    holds!(!cancels(data, check));
    Some(())
}

harnesses! {
    frames_identity_1, unwind 11, covers [ZeroByte, Full] => |c| identity::<1, 9>(c);
    frames_identity_2, unwind 12, covers [ZeroByte, Full] => |c| identity::<2, 10>(c);
    frames_identity_3, unwind 13, covers [ZeroByte, Full] => |c| identity::<3, 11>(c);
    frames_identity_4, unwind 14, covers [ZeroByte, Full] => |c| identity::<4, 12>(c);
    frames_identity_5, unwind 15, covers [ZeroByte, Full] => |c| identity::<5, 13>(c);
    frames_identity_6, unwind 16, covers [ZeroByte, Full] => |c| identity::<6, 14>(c);
    frames_find_back, unwind 13, covers [Empty, Accepted, Refused, ZeroByte, Full] => |c| finds_back(c);
    frames_only, unwind 13, covers [Accepted, Refused] => |c| accepts_only_frames(c);
    frames_linear, unwind 10, covers [Empty, Full] => |c| linear(c);
    frames_divide, unwind 10, covers [Empty, Full] => |c| divides(c);
    frames_see_flips, unwind 10, covers [InBody, InCheck, Full] => |c| seen_flips::<3>(c);
    frames_see_burst, unwind 10, covers [InBody, InCheck, Split] => |c| seen_burst(c);
}

#[cfg(not(any(kani, verify_wasm)))]
const FRAME: &str = "crates/link/src/frame.rs";
#[cfg(not(any(kani, verify_wasm)))]
const CRC: &str = "crates/link/src/crc.rs";

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[
    Row {
        name: "frames-identity",
        says: "A payload is what its frame decodes to, and what is accepted as a payload is its frame and no other \
            bytes; no byte of a frame but the last is zero",
        requirement: "GMC-2, over a line that can damage bytes",
        bound: "any payload of up to 6 bytes; for the converse, any 9 bytes that begin with the length of 2",
        assumes: "nothing",
        suffices: "a payload byte acts by being zero or not and by its distance to the next zero; lengths up to 200 \
            are drawn in frames_long",
        harnesses: &[
            "frames_identity_1",
            "frames_identity_2",
            "frames_identity_3",
            "frames_identity_4",
            "frames_identity_5",
            "frames_identity_6",
            "frames_only",
        ],
        searches: &[Search { name: "frames_long", run: long }],
        models: &[],
        mutants: &[
            Mutant {
                name: "the distance to the end is one short",
                file: FRAME,
                find: "let (mut at, mut distance) = (count, 1);",
                put: "let (mut at, mut distance) = (count, 0);",
                killer: "frames_identity_3",
            },
            Mutant {
                name: "the check's top bits are not looked at",
                file: FRAME,
                find: "if byte != check_byte(rest)",
                put: "if byte | 0x80 != check_byte(rest)",
                killer: "frames_only",
            },
            Mutant {
                name: "long stretches without a zero lose a bit",
                file: FRAME,
                find: "(payload[at], distance + 1)",
                put: "(payload[at], (distance + 1) & 0x7F)",
                killer: "frames_long",
            },
        ],
    },
    Row {
        name: "frames-resynchronise",
        says: "Any bytes: no panic; a zero ends any frame, only as many bytes as the payload needs are ever accepted, \
            and the next good frame is decoded",
        requirement: "GMC-2, over a line that can damage bytes",
        bound: "a decoder of 2 bytes; any up to 10 bytes since the last zero, then any good frame of 2",
        assumes: "nothing",
        suffices: "after the ninth byte without a zero the decoder waits for one, and a zero resets it: longer input \
            leads to no further state; frames_long does it at 200 bytes",
        harnesses: &["frames_find_back"],
        searches: &[],
        models: &[],
        mutants: &[
            Mutant {
                name: "bytes behind the check are passed over",
                file: FRAME,
                find: "Expected::End { .. } => Expected::Damaged(FrameDamage::Length),",
                put: "Expected::End { length } => Expected::End { length },",
                killer: "frames_find_back",
            },
            Mutant {
                name: "a length beyond the room is believed",
                file: FRAME,
                find: "usize::from(byte) > N + 1",
                put: "usize::from(byte) > N + 2",
                killer: "frames_find_back",
            },
            Mutant {
                name: "a zero byte does not end damage",
                file: FRAME,
                find: "match core::mem::replace(&mut self.expected, Expected::Length) {",
                put: "match self.expected {",
                killer: "frames_find_back",
            },
        ],
    },
    Row {
        name: "frames-check",
        says: "The check is CRC-32C over the bytes of the line; no error of up to 3 bits, proved, or up to 5, \
            counted, and no burst of up to 32 bits cancels out",
        requirement: "GMC-2, over a line that can damage bytes",
        bound: "proofs: length and body of 5 bytes with their check, any error of up to 3 bits, any burst; counting: \
            the longest frame of the format, 255 bytes with their check, every error of up to 5 bits and every burst",
        assumes: "the zeros of the line are not changed; an error that makes or destroys one can yield a tail that \
            passes, with a chance of 2⁻³² for noise (frame.rs says what holds then)",
        suffices: "by linearity the bytes struck do not matter, and row frames-identity shows that nothing passes \
            without its check",
        harnesses: &["frames_linear", "frames_divide", "frames_see_flips", "frames_see_burst"],
        searches: &[Search { name: "frames_distance", run: distance }],
        models: &[],
        mutants: &[
            Mutant {
                name: "the generator of Ethernet",
                file: CRC,
                find: "const GENERATOR: u32 = 0x82F6_3B78;",
                put: "const GENERATOR: u32 = 0xEDB8_8320;",
                killer: "frames_distance",
            },
            Mutant {
                name: "a shift without a division",
                file: CRC,
                find: "const GENERATOR: u32 = 0x82F6_3B78;",
                put: "const GENERATOR: u32 = 0;",
                killer: "frames_see_burst",
            },
            Mutant {
                name: "a generator of few bits",
                file: CRC,
                find: "const GENERATOR: u32 = 0x82F6_3B78;",
                put: "const GENERATOR: u32 = 0x8000_0000;",
                killer: "frames_see_flips",
            },
            Mutant {
                name: "seven steps a byte",
                file: CRC,
                find: "while bits < 8 {",
                put: "while bits < 7 {",
                killer: "frames_divide",
            },
            Mutant {
                name: "a carry in the register",
                file: CRC,
                find: "let mut register = register ^ byte as u32;",
                put: "let mut register = register.wrapping_add(byte as u32);",
                killer: "frames_linear",
            },
        ],
    },
];

/// Frames of up to 200 bytes among noise: each is returned behind the next zero, and nothing else is.
#[cfg(not(any(kani, verify_wasm)))]
fn long(size: Size) -> String {
    use crate::native::Draw;
    use retrace_link::frame::{MAX_PAYLOAD, MAX_WIRE};
    let frames = if size.full { 2_000_000 } else { 20_000 };
    let (mut draw, mut decoder, mut refused) = (Draw::new(size.seed), FrameDecoder::<MAX_PAYLOAD>::new(), 0);
    for _ in 0..frames {
        for _ in 0..draw.below(40) {
            let noise = draw.word() as u8;
            match decoder.push(noise) {
                Some(Ok(found)) => panic!("noise is accepted: {found:02X?}"),
                found => refused += u64::from(found.is_some()),
            }
        }
        refused += u64::from(decoder.push(0).is_some());
        let (count, zeros) = (1 + draw.below(MAX_PAYLOAD as u32) as usize, 1 + draw.below(300));
        let payload: [u8; MAX_PAYLOAD] =
            core::array::from_fn(|_| if draw.below(zeros) == 0 { 0 } else { draw.word() as u8 });
        let mut wire = [0; MAX_WIRE];
        let frame = encode(&payload[..count], &mut wire).expect("a payload of 1 to 200 bytes");
        let (last, others) = frame.split_last().expect("a frame has bytes");
        assert!(others.iter().all(|&byte| byte != 0 && decoder.push(byte).is_none()) && *last == 0);
        assert!(decoder.push(0) == Some(Ok(&payload[..count])));
    }
    format!("{frames} frames of up to {MAX_PAYLOAD} bytes came back, {refused} stretches of noise were refused")
}

/// Effect of one flipped bit on the comparison of check and bytes, for each bit of the longest frame in the order of
/// the line.
#[cfg(not(any(kani, verify_wasm)))]
fn syndromes() -> Vec<u32> {
    const COVERED: usize = 255;
    let crc = |bytes: [u8; COVERED]| bytes.into_iter().fold(crc::START, crc::update);
    let none = crc([0; COVERED]);
    let of_bit = |bit: usize| {
        let mut bytes = [0; COVERED];
        bytes[bit / 8] = 1 << (bit % 8);
        crc(bytes) ^ none
    };
    (0..COVERED * 8).map(of_bit).chain((0..32).map(|bit| 1 << bit)).collect()
}

/// The distance of the code at the longest frame, and its bursts: Koopman's figures, computed again.
#[cfg(not(any(kani, verify_wasm)))]
fn distance(_: Size) -> String {
    let syndromes = syndromes();
    // Odd counts of ones, an odd number of them added without carry, make an odd count: not zero.
    assert!(syndromes.iter().all(|syndrome| syndrome.count_ones() % 2 == 1), "an odd number of bits cancels out");
    let mut pairs = vec![0];
    for (at, first) in syndromes.iter().enumerate() {
        pairs.extend(syndromes[at + 1..].iter().map(|second| first ^ second));
    }
    pairs.sort_unstable();
    assert!(pairs.windows(2).all(|two| two[0] != two[1]), "two or four bits cancel out");
    // The effects of 32 bits in a row are linearly independent, so no choice among them cancels out.
    for window in syndromes.windows(32) {
        let mut by_top = [0u32; 32];
        for &syndrome in window {
            let mut rest = syndrome;
            while rest != 0 && by_top[rest.ilog2() as usize] != 0 {
                rest ^= by_top[rest.ilog2() as usize];
            }
            assert!(rest != 0, "a burst cancels out");
            by_top[rest.ilog2() as usize] = rest;
        }
    }
    format!(
        "distance 6 and every burst of up to 32 bits over {} bits: {} pairs of bits apart",
        syndromes.len(),
        pairs.len() - 1
    )
}
