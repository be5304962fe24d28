//! The gates that keep motion and exclusive instructions in order (GMC-3 … GMC-7), in the acknowledged form.
//!
//! No gate looks at a sampled flag of the card. B, which lets records through to the card, is shut from the front marker until
//! the card reports the instruction's *number* executed; C, which lets the instruction through, opens when the card reports the
//! *place* of the marker executed and the cursor at rest there. A, which lets the next instruction in, is open while none
//! is in hand. The literal gates of the source sample a ready flag and take "empty" for a level; both fail (spec, GMC).
//!
//! Invariant: B and C are never open together for the same marker; one instruction is in hand at a time.

use crate::Place;
use crate::place::before;

/// The instruction in hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct PendingInstruction {
    number: u32,
    place: u32,
    sent: bool,
}

/// The gates A, B and C.
#[derive(Clone, Copy, Debug, Default)]
pub struct Gates {
    in_hand: Option<PendingInstruction>,
}

impl Gates {
    /// Gate A: may the next instruction be taken in hand? (GMC-5)
    #[must_use]
    pub const fn a_open(&self) -> bool {
        self.in_hand.is_none()
    }

    /// Takes the instruction `number` in hand, whose front marker stands before record `place`. False, and nothing changed,
    /// where another is in hand.
    pub fn accept(&mut self, number: u32, place: u32) -> bool {
        let open = self.a_open();
        if open {
            self.in_hand = Some(PendingInstruction { number, place, sent: false });
        }
        open
    }

    /// Gate B: may record `place` be sent to the card? (GMC-4)
    #[must_use]
    pub const fn b_open(&self, place: u32) -> bool {
        match self.in_hand {
            Some(marker) => before(place, marker.place),
            None => true,
        }
    }

    /// Gate C: may the instruction in hand be sent? All motion before it is executed and the cursor rests on its place. (GMC-6)
    #[must_use]
    pub fn c_open(&self, cursor: Place, at_rest: bool) -> bool {
        self.in_hand.is_some_and(|marker| !marker.sent && at_rest && cursor == Place::start_of(marker.place))
    }

    /// The card has taken the instruction in hand.
    pub fn sent(&mut self) {
        if let Some(marker) = &mut self.in_hand {
            marker.sent = true;
        }
    }

    /// The card reports instruction `executed` complete: if that is the one in hand, it is done and its marker gone.
    /// Returns its number then.
    pub fn acknowledge(&mut self, executed: u32) -> Option<u32> {
        let marker = self.in_hand.filter(|m| m.sent && m.number == executed)?;
        self.in_hand = None;
        Some(marker.number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn only_the_instruction_that_was_sent_is_acknowledged() {
        let mut gates = Gates::default();
        assert!(gates.accept(7, 3) && !gates.accept(8, 4));
        assert_eq!(gates.acknowledge(7), None);
        gates.sent();
        assert_eq!(gates.acknowledge(6), None);
        assert!(!gates.b_open(3) && gates.b_open(2) && !gates.a_open());
        assert_eq!(gates.acknowledge(7), Some(7));
        assert!(gates.b_open(3) && gates.a_open());
    }

    proptest! {
        /// A card that plays records, stands, executes and reports late: in its own time line no record stands on the wrong side
        /// of an instruction, and the run comes to its end.
        #[test]
        fn order_holds_under_every_delay(
            markers in prop::collection::btree_set(0u32..40, 0..8), start in any::<u32>(),
            lag in 0usize..7, duration in 0u32..5,
        ) {
            let end = start.wrapping_add(40);
            let markers: Vec<u32> = markers.into_iter().map(|m| start.wrapping_add(m)).collect();
            let (mut gates, mut next, mut sent) = (Gates::default(), 0usize, start);
            // the card: played up to, window end, running instruction, executed
            let (mut at, mut busy, mut executed) = (start, None::<(u32, u32)>, 0u32);
            let mut line: Vec<Result<u32, u32>> = Vec::new();
            let mut reports = vec![(start, true, 0u32); lag + 1];
            for _ in 0..4000 {
                // host, with a report that is `lag` periods old
                let (place, rest, done) = reports[reports.len() - 1 - lag];
                if gates.acknowledge(done).is_some() { next += 1; }
                if next < markers.len() { gates.accept(next as u32 + 1, markers[next]); }
                while sent != end && gates.b_open(sent) { sent = sent.wrapping_add(1); }
                if gates.c_open(Place::start_of(place), rest) {
                    gates.sent();
                    prop_assert!(busy.is_none());
                    busy = Some((next as u32 + 1, duration));
                    line.push(Err(markers[next]));
                }
                // card
                match busy {
                    Some((number, 0)) => { executed = number; busy = None; }
                    Some((number, left)) => busy = Some((number, left - 1)),
                    None if at != sent => { line.push(Ok(at)); at = at.wrapping_add(1); }
                    None => {}
                }
                reports.push((at, at == sent, executed));
            }
            let mut expected = Vec::new();
            for k in 0..40 {
                let place = start.wrapping_add(k);
                if markers.contains(&place) { expected.push(Err(place)); }
                expected.push(Ok(place));
            }
            prop_assert_eq!(line, expected);
        }
    }
}
