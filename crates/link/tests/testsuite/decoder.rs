//! The decoder, with frames of noise and with real ones that were damaged: no panic, and no false frame beyond the
//! checksum's odds.

use crate::dice;

use dice::Dice;
use retrace_link::frame::{FrameDecoder, MAX_PAYLOAD, MAX_WIRE, encode};

fn asked(usual: u64) -> (u64, u64) {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse().ok());
    (number("RETRACE_CASES").unwrap_or(usual), number("RETRACE_FIRST_SEED").unwrap_or(1))
}

/// Noise of the shape of a frame: a true length, and bytes that are not zero.
fn noise(dice: &mut Dice, wire: &mut Vec<u8>) {
    let body = 2 + dice.below(30);
    wire.push(body as u8);
    // a code byte that is right, so that only the check is left to refuse it
    wire.push(body as u8);
    wire.extend((0..body - 1).map(|_| 1 + dice.below(255) as u8));
    for k in 0..5 {
        wire.push(0x80 | if k == 4 { dice.below(16) } else { dice.below(128) } as u8);
    }
    wire.push(0);
}

/// Breaks a frame in one to six places: bits, bytes, order, length.
fn damage(dice: &mut Dice, wire: &mut Vec<u8>) {
    for _ in 0..1 + dice.below(6) {
        if wire.is_empty() {
            return;
        }
        let at = dice.below(wire.len());
        match dice.below(6) {
            0 | 1 => wire[at] ^= 1 << dice.below(8),
            2 => wire[at] = dice.next() as u8,
            3 => {
                wire.remove(at);
            }
            4 => wire.insert(at, dice.next() as u8),
            _ => {
                let other = dice.below(wire.len());
                wire.swap(at, other);
            }
        }
    }
}

/// Half of the frames are noise that only the check can refuse, half are real ones, broken. A frame that is taken and
/// was not sent comes with a chance of 2⁻³² each: three in 10⁸ would be one in 20 million runs.
#[test]
fn no_frame_is_taken_that_was_not_sent() {
    let (cases, seed) = asked(200_000);
    let mut dice = Dice(seed);
    let mut decoder = FrameDecoder::<MAX_PAYLOAD>::new();
    let (mut taken_false, mut taken, mut refused) = (0u64, 0u64, 0u64);
    let mut wire = Vec::new();
    for case in 0..cases {
        let mut payload = [0u8; MAX_PAYLOAD];
        let length = 1 + dice.below(if case % 64 == 0 { MAX_PAYLOAD } else { 24 });
        payload[..length].fill_with(|| if dice.below(4) == 0 { 0 } else { dice.next() as u8 });
        wire.clear();
        if case % 2 == 0 {
            noise(&mut dice, &mut wire);
        } else {
            let mut room = [0; MAX_WIRE];
            wire.extend_from_slice(encode(&payload[..length], &mut room).expect("it fits"));
            damage(&mut dice, &mut wire);
        }
        for &byte in wire.iter().chain(&[0]) {
            match decoder.push(byte) {
                Some(Ok(found)) if case % 2 == 1 && found == &payload[..length] => taken += 1,
                Some(Ok(_)) => taken_false += 1,
                Some(Err(_)) => refused += 1,
                None => {}
            }
        }
    }
    println!("{cases} frames: {refused} refused, {taken} came through whole, {taken_false} false ones taken");
    assert!(taken_false <= 2, "{taken_false} false frames");
    assert!(refused > cases / 2);
}

/// And the decoder finds the next frame that is whole, whatever came before it.
#[test]
fn after_any_noise_the_next_frame_is_found() {
    let (cases, seed) = asked(20_000);
    let mut dice = Dice(seed ^ 0xABCD);
    let mut decoder = FrameDecoder::<MAX_PAYLOAD>::new();
    for _ in 0..cases.min(1_000_000) {
        for _ in 0..dice.below(40) {
            let _ = decoder.push(dice.next() as u8);
        }
        let _ = decoder.push(0);
        let mut room = [0; MAX_WIRE];
        let payload = [dice.next() as u8, 0, dice.next() as u8];
        let frame = encode(&payload, &mut room).expect("it fits");
        let mut found = None;
        for &byte in frame {
            if let Some(result) = decoder.push(byte) {
                found = Some(result.map(<[u8]>::to_vec));
            }
        }
        assert_eq!(found, Some(Ok(payload.to_vec())));
    }
}
