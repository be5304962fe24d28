//! Frames: payloads of some bytes on a byte stream, found again and checked, after whatever happened on the line.
//!
//! ```text
//! length ‖ body ‖ check ‖ 0
//! ```
//!
//!  * The zero byte ends a frame and stands nowhere else, so that whoever has lost the thread takes it up at the next one.
//!  * *body* is the payload without its zeros, by consistent overhead byte stuffing (Cheshire and Baker, IEEE/ACM Transactions on
//!    Networking 7(2), 1999): each zero, and one thought before the payload, becomes a code byte: the distance to the next
//!    code byte, or to the end. That is one byte more than the payload.
//!  * *length* is the number of bytes in the body. A frame that a false zero cuts short, or that a lost one joins with the
//!    next, shows by it.
//!  * *check* is the CRC-32C ([`crate::crc`]) of length and body as they stand on the line, in five bytes of seven bits, low bits
//!    first, the top bit set so that none is zero. The last one carries four bits; the others it has are zero, and looked at.
//!
//! The check is over the bytes on the line, not over the payload. One flipped bit in a code byte moves zeros about and
//! makes an error of many bits in the payload, which the distance of a code over the payload says nothing of. Over the line's
//! bytes the error is the one that happened.
//!
//! # What is guaranteed
//! While an error leaves the zeros of the line as they are, makes none and destroys none, a frame is refused with certainty if
//!  * up to 5 of its bits flip, or any odd number, check included; or
//!  * all its flipped bits lie within 32 bits in a row, in the order of the line: lowest bit of a byte first.
//!
//! The check's top and unused bits are no part of the code: one flip there is enough to refuse. Without them the bits of
//! length, body and CRC stand in the order that CRC-32C means, no further apart than on the line, so that both are its own
//! guarantees.
//!
//! If an error makes or destroys a zero:
//!  * a frame cut short or joined is refused while its length byte is whole;
//!  * what follows a false zero is taken as a frame of its own. Noise passes there as anywhere with a chance of 2⁻³² or
//!    less, but no distance bounds it: a payload can be made up whose tail is a frame. The payloads' own numbering has to refuse it;
//!  * the frame after the next zero that is one is decoded, whatever came before.
//!
//! # Keys
//! The frames of an epoch have its key added to the CRC without carry, so that those of another epoch are refused as damaged ones are
//! ([`crate::session_key`]). The guarantees are not touched: a constant on both sides cancels out. A damaged frame with a key can pass for
//! one without a key only if its error amounts to the key, and it is refused then by its kind, which says whether a key belongs to it.
//!
//! Invariant: no byte of a frame but its last is zero. After a zero byte the decoder is as new, and between zeros its state
//! is a function of the bytes since the last one.

use crate::crc;

/// Most bytes in the payload of a frame between host and card.
pub const MAX_PAYLOAD: usize = 240;
/// Bytes of the check: 32 bits, seven a byte.
const CHECK: u8 = 5;
/// Bytes that a frame has besides its payload: length, one of stuffing, check, and the zero byte.
pub const OVERHEAD: usize = 3 + CHECK as usize;
/// Bytes of the longest frame between host and card.
pub const MAX_WIRE: usize = MAX_PAYLOAD + OVERHEAD;
/// Most bytes that a payload can have in this format: a code byte then counts to 254 at most, and 255 would mean a
/// stretch that no zero ends.
const LIMIT: usize = 253;

/// Puts a frame with this payload (1 … `W` − [`OVERHEAD`] bytes) at the beginning of `wire` and returns it, its closing zero
/// included. None if the payload is empty or too long; `wire` is as it was then.
#[must_use]
#[inline(always)] // a proof follows the bytes only where nothing goes through memory
pub fn encode<'w, const W: usize>(payload: &[u8], wire: &'w mut [u8; W]) -> Option<&'w [u8]> {
    encode_with_key(payload, wire, 0)
}

/// The same, with a key mixed into the check ([`Decoder::set_key`]); 0 is none.
#[must_use]
#[inline(always)] // as above
pub fn encode_with_key<'w, const W: usize>(payload: &[u8], wire: &'w mut [u8; W], key: u32) -> Option<&'w [u8]> {
    const { assert!(W > OVERHEAD && W - OVERHEAD <= LIMIT, "room for a payload of 1 to 253 bytes") }
    let count = payload.len();
    if count == 0 || count > W - OVERHEAD {
        return None;
    }
    wire[0] = count as u8 + 1;
    // From the end, so that each code byte, the distance to the next one, is known where it stands.
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

/// The byte of the check that carries the lowest seven bits of what is left of it.
const fn check_byte(rest: u32) -> u8 {
    0x80 | rest as u8
}

/// Why the bytes before a zero byte are no frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameDamage {
    /// There are more or fewer bytes than the length says, or it says that there is no payload.
    Length,
    /// The length says that the payload is longer than this decoder takes.
    TooLong,
    /// A code byte points beyond the body.
    Stuffing,
    /// The check is not that of the bytes.
    Check,
}

/// What the decoder takes the next byte for. `length` is the frame's first byte, the number of bytes in its body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Due {
    /// The first byte of a frame.
    Length,
    /// The body: byte number `at` of it is next, a code byte if `stretch` is 0.
    Body { length: u8, at: u8, stretch: u8, register: u32 },
    /// The check: so many bytes of it are still to come, and these bits.
    Check { length: u8, left: u8, rest: u32 },
    /// The zero byte.
    End { length: u8 },
    /// The zero byte, whatever comes before it: damage was found.
    Nothing(FrameDamage),
}

/// Finds frames with payloads of up to `N` bytes (1 … 253) in a stream, byte by byte. Each byte takes the same few steps.
#[derive(Clone, Debug)]
pub struct FrameDecoder<const N: usize> {
    due: Due,
    /// Key of the frames that are taken besides those without one; 0: none.
    key: u32,
    /// Does the frame have the key?
    has_key: bool,
    payload: [u8; N],
}

impl<const N: usize> FrameDecoder<N> {
    /// A decoder that has seen nothing: it takes the first byte for the first of a frame. Who opens a line in use sends a
    /// zero byte first.
    #[must_use]
    pub const fn new() -> Self {
        const { assert!(1 <= N && N <= LIMIT, "a payload of 1 to 253 bytes") }
        Self { due: Due::Length, key: 0, has_key: false, payload: [0; N] }
    }

    /// From the next frame on those with this key (odd) are taken, and those without one.
    pub const fn set_key(&mut self, key: u32) {
        self.key = key;
    }

    /// Did the last frame that was taken have the key?
    #[must_use]
    pub const fn has_key(&self) -> bool {
        self.has_key
    }

    /// Takes the next byte of the stream. A zero byte yields the payload before it, or what is wrong with the bytes since
    /// the last zero byte; nothing if there are none.
    #[inline(always)] // as above; and a stream is read in one place
    pub fn take(&mut self, byte: u8) -> Option<Result<&[u8], FrameDamage>> {
        if byte != 0 {
            self.due = self.after(byte);
            return None;
        }
        match core::mem::replace(&mut self.due, Due::Length) {
            Due::Length => None,
            Due::Body { .. } | Due::Check { .. } => Some(Err(FrameDamage::Length)),
            Due::End { length } => Some(Ok(&self.payload[..usize::from(length) - 1])),
            Due::Nothing(damage) => Some(Err(damage)),
        }
    }

    /// What is due after a byte that is not zero.
    #[inline(always)]
    fn after(&mut self, byte: u8) -> Due {
        match self.due {
            Due::Length if byte == 1 => Due::Nothing(FrameDamage::Length),
            Due::Length if usize::from(byte) > N + 1 => Due::Nothing(FrameDamage::TooLong),
            Due::Length => {
                self.has_key = false;
                Due::Body { length: byte, at: 0, stretch: 0, register: crc::update(crc::START, byte) }
            }
            Due::Body { length, at, stretch, register } => {
                let register = crc::update(register, byte);
                // A code byte stands for the zero before its stretch, which the first one only has in thought.
                let (data, stretch) = if stretch == 0 { (0, byte - 1) } else { (byte, stretch - 1) };
                if at > 0 {
                    self.payload[usize::from(at) - 1] = data;
                }
                if at + 1 < length {
                    Due::Body { length, at: at + 1, stretch, register }
                } else if stretch > 0 {
                    Due::Nothing(FrameDamage::Stuffing)
                } else {
                    Due::Check { length, left: CHECK, rest: crc::finish(register) }
                }
            }
            // A key is odd, so the first byte of the check tells whether it is there.
            Due::Check { length, left: CHECK, rest } if self.key != 0 && byte == check_byte(rest ^ self.key) => {
                self.has_key = true;
                Due::Check { length, left: CHECK - 1, rest: (rest ^ self.key) >> 7 }
            }
            Due::Check { rest, .. } if byte != check_byte(rest) => Due::Nothing(FrameDamage::Check),
            Due::Check { length, left: 1, .. } => Due::End { length },
            Due::Check { length, left, rest } => Due::Check { length, left: left - 1, rest: rest >> 7 },
            Due::End { .. } => Due::Nothing(FrameDamage::Length),
            Due::Nothing(damage) => Due::Nothing(damage),
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

    /// Worked out by hand. The payload 11 00 22 has one zero. Code bytes stand in its place and in front: the first is 2 before
    /// the next one, that one 2 before the end: 02 11 02 22, four bytes. CRC-32C of 04 02 11 02 22, by long division:
    /// 0x2970CA37, in sevens from below 0x37, 0x14, 0x43, 0x4B, 0x2.
    #[test]
    fn a_frame_worked_out_by_hand() {
        let mut wire = [0xEE; 3 + OVERHEAD];
        let golden = [0x04, 0x02, 0x11, 0x02, 0x22, 0xB7, 0x94, 0xC3, 0xCB, 0x82, 0x00];
        assert_eq!(encode(&[0x11, 0x00, 0x22], &mut wire), Some(&golden[..]));

        let mut decoder = FrameDecoder::<3>::new();
        let (last, others) = golden.split_last().unwrap();
        for &byte in others {
            assert_eq!(decoder.take(byte), None);
        }
        assert_eq!(decoder.take(*last), Some(Ok(&[0x11, 0x00, 0x22][..])));
    }

    fn said_of<const N: usize>(bytes: &[u8]) -> Option<FrameDamage> {
        let mut decoder = FrameDecoder::<N>::new();
        for &byte in bytes {
            assert_eq!(decoder.take(byte), None);
        }
        decoder.take(0)?.err()
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
