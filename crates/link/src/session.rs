//! Binding of an epoch's frames to its opening: the epoch number, and a key that is mixed into the check of each frame.
//!
//! Invariant: both endpoints calculate the key from the opening. A frame of another epoch, of another opening or of
//! another start of the card has another key, except by chance (one in 2³¹), and its epoch differs as well.

/// Returns the number of the epoch that may be opened next; 0 is not an epoch.
#[must_use]
pub const fn next_epoch(last: u16) -> u16 {
    match last.wrapping_add(1) {
        0 => 1,
        next => next,
    }
}

/// Whether an opening begins a new epoch: it names this start of the card, and the epoch after the last one.
#[must_use]
pub const fn is_next_opening(boot: u32, epoch: u16, own_boot: u32, last_epoch: u16) -> bool {
    boot == own_boot && epoch == next_epoch(last_epoch)
}

/// Whether a frame of this epoch belongs to the open one; 0 is no open epoch.
#[must_use]
pub const fn is_open_epoch(epoch: u16, open_epoch: u16) -> bool {
    epoch == open_epoch && open_epoch != 0
}

/// Returns the key of an epoch's frames, from the card's boot number, the opening's nonce and the epoch's number. It is
/// odd, hence never 0.
#[must_use]
pub const fn session_key(boot: u32, nonce: u32, epoch: u16) -> u32 {
    mix(mix(mix(boot) ^ nonce) ^ epoch as u32) | 1
}

/// A bijection that spreads small differences over all bits: the 32-bit finalizer of MurmurHash3 (Appleby, 2011; public
/// domain).
const fn mix(word: u32) -> u32 {
    let word = (word ^ word >> 16).wrapping_mul(0x85eb_ca6b);
    let word = (word ^ word >> 13).wrapping_mul(0xc2b2_ae35);
    word ^ word >> 16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn openings_that_differ_in_anything_have_other_keys() {
        let of = [(1, 2, 3), (1, 2, 4), (1, 3, 3), (2, 2, 3), (0, 0, 1), (2, 1, 3)];
        for (k, &(boot, nonce, epoch)) in of.iter().enumerate() {
            assert_eq!(session_key(boot, nonce, epoch) & 1, 1);
            for &(boot_2, nonce_2, epoch_2) in &of[k + 1..] {
                assert_ne!(session_key(boot, nonce, epoch), session_key(boot_2, nonce_2, epoch_2));
            }
        }
        assert_eq!((next_epoch(0), next_epoch(7), next_epoch(u16::MAX)), (1, 8, 1));
    }
}
