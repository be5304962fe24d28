//! Text form of the faults of a channel: `rate=1e-4,seed=7,down.stall=1e-6,up.flip@120.3`.
//!
//! Invariant: text that is not valid is refused with the item that contains it.

use crate::faults::LineFault;
use crate::random::{Chance, Random};
use crate::serial_channel::SerialChannelSettings;

/// List of the valid items, for the error message.
const ITEMS: &str = "seed=N, baud=N, latency-us=N, jitter-us=N, stall-ms=N, rate=P, flip=P, drop=P, duplicate=P, \
    cut=P, stall=P, \
    flip@BYTE.BIT, drop@BYTE, duplicate@BYTE, cut@BYTE[+BYTES], stall@BYTE+MS, lose@BYTE+MS, each with `up.` or \
    `down.` before it for one \
    direction; P is a probability a byte";

/// Parses the faults of a serial line: those from host to card, and those from card to host. Items are separated by
/// commas. An item applies to both directions, or to one if it begins with `up.` or `down.`.
///
/// # Errors
/// The item that is not valid, and a list of the valid ones.
pub fn faults(text: &str) -> Result<[SerialChannelSettings; 2], String> {
    let mut lines = [SerialChannelSettings::default(), SerialChannelSettings::default()];
    for item in text.split(',').map(str::trim).filter(|item| !item.is_empty()) {
        let (both, one) = match item.split_once('.') {
            Some(("up", rest)) => (rest, Some(0)),
            Some(("down", rest)) => (rest, Some(1)),
            _ => (item, None),
        };
        for (number, line) in lines.iter_mut().enumerate() {
            if one.is_none_or(|only| only == number) {
                apply(both, line).ok_or_else(|| format!("`{item}` is not a fault of a line; valid are {ITEMS}"))?;
            }
        }
    }
    // One seed for both directions makes two sequences.
    let mut random = Random::new(lines[1].seed);
    lines[1].seed = random.next();
    Ok(lines)
}

fn apply(item: &str, line: &mut SerialChannelSettings) -> Option<()> {
    if let Some((what, place)) = item.split_once('@') {
        line.script.push(scripted(what, place)?);
        return Some(());
    }
    let (key, value) = item.split_once('=')?;
    let number = || value.parse::<u32>().ok();
    let chance = || Chance::new(value.parse().ok()?);
    let rates = &mut line.rates;
    match key {
        "seed" => line.seed = value.parse().ok()?,
        "baud" => line.baud = number()?,
        "latency-us" => line.latency_us = number()?,
        "jitter-us" => line.jitter_us = number()?,
        "stall-ms" => rates.stall_us = number()?.checked_mul(1000)?,
        "rate" => {
            let chance = chance()?;
            for kind in [&mut rates.flip, &mut rates.drop, &mut rates.duplicate, &mut rates.cut, &mut rates.stall] {
                *kind = chance;
            }
        }
        "flip" => rates.flip = chance()?,
        "drop" => rates.drop = chance()?,
        "duplicate" => rates.duplicate = chance()?,
        "cut" => rates.cut = chance()?,
        "stall" => rates.stall = chance()?,
        _ => return None,
    }
    Some(())
}

/// A fault at one byte.
fn scripted(what: &str, place: &str) -> Option<(u64, LineFault)> {
    let tail = |separator: char| match place.split_once(separator) {
        Some((byte, tail)) => Some((byte.parse::<u64>().ok()?, Some(tail.parse::<u32>().ok()?))),
        None => Some((place.parse().ok()?, None)),
    };
    let wait = |lost| {
        let (byte, ms) = tail('+')?;
        Some((byte, LineFault::Stall { us: ms?.checked_mul(1000)?, lost }))
    };
    match what {
        "flip" => {
            let (byte, bit) = tail('.')?;
            let bit = u8::try_from(bit?).ok().filter(|&bit| bit < 8)?;
            Some((byte, LineFault::Flip { bit }))
        }
        "drop" => Some((place.parse().ok()?, LineFault::Drop)),
        "duplicate" => Some((place.parse().ok()?, LineFault::Duplicate)),
        "cut" => tail('+').map(|(byte, bytes)| (byte, LineFault::Cut { bytes: bytes.unwrap_or(0) })),
        "stall" => wait(false),
        "lose" => wait(true),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_is_written_is_what_happens() {
        let [up, down] =
            faults("rate=0.25, up.flip=0.5,down.stall=0,seed=7,baud=230400,up.jitter-us=9,stall-ms=3").expect("good");
        let chance = |p| Chance::new(p).expect("a probability");
        assert_eq!((up.rates.flip, up.rates.drop, up.rates.stall), (chance(0.5), chance(0.25), chance(0.25)));
        assert_eq!((down.rates.flip, down.rates.stall, down.rates.stall_us), (chance(0.25), Chance::NEVER, 3000));
        assert_eq!((up.baud, down.baud, up.jitter_us, down.jitter_us), (230_400, 230_400, 9, 0));
        assert!(up.seed == 7 && down.seed != 7);
        let [up, down] =
            faults("up.flip@120.3,drop@5,up.cut@9,up.cut@10+4,down.stall@7+20,down.lose@8+1").expect("good");
        let cuts = [(9, LineFault::Cut { bytes: 0 }), (10, LineFault::Cut { bytes: 4 })];
        assert_eq!(up.script, [&[(120, LineFault::Flip { bit: 3 }), (5, LineFault::Drop)], &cuts[..]].concat());
        let stalls = [LineFault::Stall { us: 20_000, lost: false }, LineFault::Stall { us: 1000, lost: true }];
        assert_eq!(down.script, [(5, LineFault::Drop), (7, stalls[0]), (8, stalls[1])]);
        assert!(faults("").expect("nothing").iter().all(|line| line.rates.are_none()));
    }

    #[test]
    fn what_is_not_understood_is_named() {
        for bad in
            ["flip", "flip=2", "flip=-1", "side.flip=0", "flip@3", "flip@3.8", "drop@x", "stall@3", "baud=fast", "up."]
        {
            let told = faults(&format!("seed=1,{bad}")).expect_err(bad);
            assert!(told.contains(&format!("`{bad}`")), "{told}");
        }
    }

    proptest! {
        #[test]
        fn any_text_is_taken_or_refused(text in "[a-z@=.,+0-9-]{0,30}") {
            let _ = faults(&text);
        }
    }
}
