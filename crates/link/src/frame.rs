//! Frames: short payloads on a byte stream, with delimiters and a check, so that they are found again after any
//! disturbance.
//!
//! ```text
//! length ‖ body ‖ check ‖ 0
//! ```
//!
//!  * The zero byte ends a frame and occurs nowhere else, so that a receiver that has lost synchronization regains it
//!    at the next zero.
//!  * *body* is the payload without its zeros, by consistent overhead byte stuffing (Cheshire and Baker, IEEE/ACM
//!    Transactions on Networking 7(2), 1999): each zero, and a virtual one before the payload, becomes a code byte: the
//!    distance to the next code byte, or to the end. That is one byte more than the payload.
//!  * *length* is the number of bytes in the body. It reveals a frame that is cut short by a false zero, or joined with
//!    the next one by a lost zero.
//!  * *check* is the CRC-32C ([`crate::crc`]) of length and body as transmitted, in five bytes of seven bits, low bits
//!    first, the top bit set so that none is zero. The last one carries four bits; its other bits are zero, and are
//!    checked.
//!
//! The check covers the transmitted bytes, not the payload. One flipped bit in a code byte moves zeros and makes an
//! error of many bits in the payload, about which the distance of a code over the payload guarantees nothing. In the
//! transmitted bytes the error is the one that happened.
//!
//! # What is guaranteed
//! If an error leaves the zeros on the line as they are, adds none and destroys none, a frame is rejected with
//! certainty if
//!  * up to 5 of its bits flip, or any odd number, check included; or
//!  * all its flipped bits are within 32 consecutive bits, in transmission order: lowest bit of a byte first.
//!
//! The check's top and unused bits are not part of the code: one flip there is enough to reject. Without them the bits
//! of length, body and CRC are in the order that CRC-32C requires, no further apart than on the line, so that both
//! guarantees are those of the code.
//!
//! If an error adds or destroys a zero:
//!  * a frame that is cut short or joined is rejected as long as its length byte is intact;
//!  * the bytes after a false zero are decoded as a frame of their own. Noise passes there as anywhere with a
//!    probability of 2⁻³² or less, but no distance bounds it: a payload can be constructed whose tail is a frame. The
//!    numbering in the payloads must reject it;
//!  * the frame after the next true zero is decoded, whatever came before.
//!
//! # Keys
//! The frames of an epoch have its key added to the CRC without carry, so that those of another epoch are rejected like
//! damaged ones ([`crate::session_key`]). The guarantees are unaffected: a constant on both sides cancels out. A
//! damaged frame with a key can pass for one without a key only if its error equals the key, and it is then rejected by
//! its kind, which defines whether a key belongs to it.
//!
//! Invariant: no byte of a frame but its last is zero. After a zero byte the decoder is in its initial state, and
//! between zeros its state is a function of the bytes since the last one.

use core::hash::Hash;

use crate::crc;

/// Maximum number of bytes in the payload of a frame between host and card.
pub const MAX_PAYLOAD: usize = 240;
/// Bytes of the check: 32 bits, seven per byte.
const CHECK: u8 = 5;
/// Bytes of a frame in addition to its payload: length, one of stuffing, check, and the zero byte.
pub const OVERHEAD: usize = 3 + CHECK as usize;
/// Bytes of the longest frame between host and card.
pub const MAX_WIRE: usize = MAX_PAYLOAD + OVERHEAD;
/// Maximum payload of this format: a code byte then counts to 254 at most; 255 would mean a run that no zero ends.
const LIMIT: usize = 253;

/// Writes a frame with this payload (1 … `W` − [`OVERHEAD`] bytes) to the beginning of `wire` and returns it, with its
/// closing zero. Returns `None` if the payload is empty or too long; `wire` is unchanged then.
#[must_use]
#[inline(always)] // a proof follows the bytes only where nothing goes through memory
pub fn encode<'w, const W: usize>(payload: &[u8], wire: &'w mut [u8; W]) -> Option<&'w [u8]> {
    encode_with_key(payload, wire, 0)
}

/// Writes a frame as [`encode`] does, with a key mixed into the check ([`FrameDecoder::set_key`]); 0 is no key.
#[must_use]
#[inline(always)] // as above
pub fn encode_with_key<'w, const W: usize>(payload: &[u8], wire: &'w mut [u8; W], key: u32) -> Option<&'w [u8]> {
    const { assert!(W > OVERHEAD && W - OVERHEAD <= LIMIT, "room for a payload of 1 to 253 bytes") }
    let count = payload.len();
    if count == 0 || count > W - OVERHEAD {
        return None;
    }
    wire[0] = count as u8 + 1;
    // Backward from the end, so that each code byte, the distance to the next one, is known when it is written.
    let (mut at, mut distance) = (count, 1);
    while at > 0 {
        at -= 1;
        (wire[at + 2], distance) = if payload[at] == 0 { (distance, 1) } else { (payload[at], distance + 1) };
    }
    wire[1] = distance;

    let (covered, behind) = wire.split_at_mut(count + 2);
    let mut rest = crc::finish(covered.iter().fold(crc::START, |register, &byte| crc::update(register, byte))) ^ key;
    let (check, zero) = behind.split_at_mut(CHECK as usize);
    for byte in check {
        *byte = check_byte(rest);
        rest >>= 7;
    }
    zero[0] = 0;
    Some(&wire[..count + OVERHEAD])
}

/// Returns the byte of the check that carries the lowest seven bits of `rest`.
const fn check_byte(rest: u32) -> u8 {
    0x80 | rest as u8
}

/// Reason why the bytes before a zero byte are not a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FrameDamage {
    /// The number of bytes differs from the length, or the length means that there is no payload.
    Length,
    /// The payload is longer than this decoder accepts.
    TooLong,
    /// A code byte points beyond the body.
    Stuffing,
    /// The check does not match the bytes.
    Check,
}

impl core::fmt::Display for FrameDamage {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Length => "the frame has another length than it states",
            Self::TooLong => "the frame is longer than the decoder accepts",
            Self::Stuffing => "a code byte of the frame points beyond its body",
            Self::Check => "the check of the frame does not match",
        })
    }
}

impl core::error::Error for FrameDamage {}

/// Meaning of the next byte for the decoder. `length` is the frame's first byte, the number of bytes in its body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Expected {
    /// The first byte of a frame.
    Length,
    /// The body: byte number `at` of it is next; it is a code byte if `stretch` is 0.
    Body { length: u8, at: u8, stretch: u8, register: u32 },
    /// The check: `left` bytes of it are still to come, with the bits in `rest`.
    Check { length: u8, left: u8, rest: u32 },
    /// The zero byte.
    End { length: u8 },
    /// The zero byte, after any number of bytes: damage was found.
    Damaged(FrameDamage),
}

/// Decoder of frames with payloads of up to `N` bytes (1 … 253) in a stream, byte by byte. Each byte takes the same few
/// steps.
///
/// # Examples
///
/// ```
/// use retrace_link::frame::{FrameDecoder, encode};
///
/// let mut wire = [0; 16];
/// let bytes = encode(b"rate", &mut wire).expect("it fits");
/// let mut decoder = FrameDecoder::<8>::new();
/// let payload = bytes.iter().find_map(|&byte| decoder.push(byte).map(|frame| frame.map(<[u8]>::to_vec)));
/// assert_eq!(payload, Some(Ok(b"rate".to_vec())));
/// ```
#[derive(Clone, Debug)]
pub struct FrameDecoder<const N: usize> {
    expected: Expected,
    /// Key of the frames that are accepted in addition to those without one; 0: none.
    key: u32,
    /// Whether the frame has the key.
    has_key: bool,
    payload: [u8; N],
}

impl<const N: usize> FrameDecoder<N> {
    /// Creates a decoder that treats the first byte as the first of a frame. A sender on a line in use sends a zero
    /// byte first.
    #[must_use]
    pub const fn new() -> Self {
        const { assert!(1 <= N && N <= LIMIT, "a payload of 1 to 253 bytes") }
        Self { expected: Expected::Length, key: 0, has_key: false, payload: [0; N] }
    }

    /// Sets the key (odd): from the next frame on, frames with this key and frames without one are accepted.
    pub const fn set_key(&mut self, key: u32) {
        self.key = key;
    }

    /// Whether the last accepted frame had the key.
    #[must_use]
    pub const fn has_key(&self) -> bool {
        self.has_key
    }

    /// Hashes what decides about later bytes. Between frames that is the key alone.
    #[doc(hidden)]
    pub fn hash_state(&self, state: &mut impl core::hash::Hasher) {
        let Self { expected, key, has_key, payload } = self;
        (expected, key).hash(state);
        if *expected != Expected::Length {
            (has_key, payload).hash(state);
        }
    }

    /// Processes the next byte of the stream. A zero byte yields the payload before it, or the damage of the bytes
    /// since the last zero byte; `None` if there are none.
    #[inline(always)] // as above; and a stream is read in one place
    pub fn push(&mut self, byte: u8) -> Option<Result<&[u8], FrameDamage>> {
        if byte != 0 {
            self.expected = self.next_state(byte);
            return None;
        }
        match core::mem::replace(&mut self.expected, Expected::Length) {
            Expected::Length => None,
            Expected::Body { .. } | Expected::Check { .. } => Some(Err(FrameDamage::Length)),
            Expected::End { length } => Some(Ok(&self.payload[..usize::from(length) - 1])),
            Expected::Damaged(damage) => Some(Err(damage)),
        }
    }

    /// Returns the state after a byte that is not zero.
    #[inline(always)]
    fn next_state(&mut self, byte: u8) -> Expected {
        match self.expected {
            Expected::Length if byte == 1 => Expected::Damaged(FrameDamage::Length),
            Expected::Length if usize::from(byte) > N + 1 => Expected::Damaged(FrameDamage::TooLong),
            Expected::Length => {
                self.has_key = false;
                Expected::Body { length: byte, at: 0, stretch: 0, register: crc::update(crc::START, byte) }
            }
            Expected::Body { length, at, stretch, register } => {
                let register = crc::update(register, byte);
                // A code byte represents the zero before its run; for the first one that zero is virtual.
                let (data, stretch) = if stretch == 0 { (0, byte - 1) } else { (byte, stretch - 1) };
                if at > 0 {
                    self.payload[usize::from(at) - 1] = data;
                }
                if at + 1 < length {
                    Expected::Body { length, at: at + 1, stretch, register }
                } else if stretch > 0 {
                    Expected::Damaged(FrameDamage::Stuffing)
                } else {
                    Expected::Check { length, left: CHECK, rest: crc::finish(register) }
                }
            }
            // A key is odd, so the first byte of the check shows whether the frame has it.
            Expected::Check { length, left: CHECK, rest } if self.key != 0 && byte == check_byte(rest ^ self.key) => {
                self.has_key = true;
                Expected::Check { length, left: CHECK - 1, rest: (rest ^ self.key) >> 7 }
            }
            Expected::Check { rest, .. } if byte != check_byte(rest) => Expected::Damaged(FrameDamage::Check),
            Expected::Check { length, left: 1, .. } => Expected::End { length },
            Expected::Check { length, left, rest } => Expected::Check { length, left: left - 1, rest: rest >> 7 },
            Expected::End { .. } => Expected::Damaged(FrameDamage::Length),
            Expected::Damaged(damage) => Expected::Damaged(damage),
        }
    }
}

impl<const N: usize> Default for FrameDecoder<N> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Worked out by hand. The payload 11 00 22 has one zero. Code bytes stand in its place and in front: the first is
    /// 2 before the next one, that one 2 before the end: 02 11 02 22, four bytes. CRC-32C of 04 02 11 02 22, by long
    /// division: 0x2970CA37, in sevens from below 0x37, 0x14, 0x43, 0x4B, 0x2.
    #[test]
    fn a_frame_worked_out_by_hand() {
        let mut wire = [0xEE; 3 + OVERHEAD];
        let golden = [0x04, 0x02, 0x11, 0x02, 0x22, 0xB7, 0x94, 0xC3, 0xCB, 0x82, 0x00];
        assert_eq!(encode(&[0x11, 0x00, 0x22], &mut wire), Some(&golden[..]));

        let mut decoder = FrameDecoder::<3>::new();
        let (last, others) = golden.split_last().unwrap();
        for &byte in others {
            assert_eq!(decoder.push(byte), None);
        }
        assert_eq!(decoder.push(*last), Some(Ok(&[0x11, 0x00, 0x22][..])));
    }

    fn said_of<const N: usize>(bytes: &[u8]) -> Option<FrameDamage> {
        let mut decoder = FrameDecoder::<N>::new();
        for &byte in bytes {
            assert_eq!(decoder.push(byte), None);
        }
        decoder.push(0)?.err()
    }

    #[test]
    fn each_damage_has_its_name() {
        let whole = [0x04, 0x02, 0x11, 0x02, 0x22, 0xB7, 0x94, 0xC3, 0xCB, 0x82];
        assert_eq!(said_of::<3>(&whole), None);
        for cut in 1..whole.len() {
            assert_eq!(said_of::<3>(&whole[..cut]), Some(FrameDamage::Length), "{cut} bytes");
            assert_eq!(said_of::<2>(&whole[..cut]), Some(FrameDamage::TooLong), "{cut} bytes");
        }
        assert_eq!(
            said_of::<3>(&[0x04, 0x02, 0x11, 0x02, 0x22, 0xB7, 0x94, 0xC3, 0xCB, 0x82, 0x01]),
            Some(FrameDamage::Length)
        );
        assert_eq!(said_of::<3>(&[0x01, 0x01, 0x80, 0x80, 0x80, 0x80, 0x80]), Some(FrameDamage::Length), "no payload");
        assert_eq!(
            said_of::<3>(&[0x04, 0x02, 0x11, 0x03, 0x22, 0xB7, 0x94, 0xC3, 0xCB, 0x82]),
            Some(FrameDamage::Stuffing)
        );
        assert_eq!(
            said_of::<3>(&[0x04, 0x02, 0x11, 0x02, 0x23, 0xB7, 0x94, 0xC3, 0xCB, 0x82]),
            Some(FrameDamage::Check)
        );
    }

    #[test]
    fn what_does_not_fit_is_not_encoded() {
        let mut wire = [0xEE; 3 + OVERHEAD];
        assert_eq!(encode(&[], &mut wire), None);
        assert_eq!(encode(&[1; 4], &mut wire), None);
        assert_eq!(wire, [0xEE; 3 + OVERHEAD]);
        assert!(encode(&[1; 3], &mut wire).is_some());
        assert!(encode(&[1; MAX_PAYLOAD], &mut [0; MAX_WIRE]).is_some_and(|frame| frame.len() == MAX_WIRE));
    }
}
